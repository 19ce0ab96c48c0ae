"""The block: its geometry and inertia, and the numbers that follow from them and gravity."""

import warnings
from collections.abc import Mapping
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .body import RECTANGLE_INERTIA_RATIO as RECTANGLE_INERTIA_RATIO
from .body import compute_shape, compute_size, fraction_in_centre
from .host import Printed, format_number, format_outside
from .numerics import angle
from .validation import (
    AT_LEAST_ONE,
    NON_NEGATIVE,
    POSITIVE,
    AnyArray,
    Checked,
    Number,
    Reals,
    as_field,
    as_flag,
    as_real,
    check,
    elementwise,
    is_traced,
    quantity,
)

# The descriptions of the size of a block: 2b and 2a, b and lambda, or alpha_c and p.
SizeDescription = Literal["sides", "shape", "dynamics"]
SIDES = ("width", "height")
SHAPE = ("half_width", "slenderness")
DYNAMICS = ("critical_angle", "frequency_parameter")
SIZE_NAMES: Mapping[SizeDescription, tuple[str, str]] = {
    "sides": SIDES,
    "shape": SHAPE,
    "dynamics": DYNAMICS,
}
# A width has two meanings, by what stays as it is where it is changed.
SIZES_IN_WORDS = {
    "width": "width at this height",
    "height": "height at this width",
    "half_width": "half-width at this slenderness",
}
# Larger full sizes [m] are hardly those of a free-standing object.
LARGEST_SIZES = {"width": 30.0, "height": 100.0}


class Block(Printed, Checked):
    """A rigid body standing on two edges on a rigid base (Fig. 1), by default a rectangle.

    It can be any body that is symmetric about its middle: a column, a vase, a display case, a
    statue on its pedestal. Its centre of mass is at the height a, which is half the height of
    a homogeneous rectangle; b is half the distance between the edges.

    Parameters
    ----------
    half_width, slenderness, gravity : array_like
        Half the width of the base b [m]; height over width, lambda = a / b [-]; acceleration
        of gravity g [m/s2]. All are finite and greater than 0. They broadcast. `from_size`
        takes the full width and height instead.
    inertia_ratio : array_like
        kappa = I_O / (m R^2) [-], the moment of inertia about the edge, divided by what it
        would be if the whole mass m were at the centre of mass, at the distance R from the
        edge; finite and at least 1. It is 4 / 3 for a homogeneous
        rectangle, less where the mass is closer to its centre, more where it is further away.
    one_sided : bool
        Whether it stands against a wall and rocks about one edge only, as a facade does in
        front of its transverse walls. It rotates to positive angles, and an impact throws it
        back; see `one_sided_restitution`. It is one static value for all blocks of an array.

    Examples
    --------
    >>> import jaxrock as jr
    >>> block = jr.Block(half_width=0.4, slenderness=5.0)
    >>> print(f"{block.critical_angle:.4f} rad")
    0.1974 rad
    """

    half_width: Reals = quantity(POSITIVE, "m")
    slenderness: Reals = quantity(POSITIVE, "")
    gravity: Reals = quantity(POSITIVE, "m/s2")
    inertia_ratio: Reals = quantity(AT_LEAST_ONE, "")
    # Static: on which side a block goes on decides which program is compiled.
    # Type checkers take the declarations above for default values.
    one_sided: bool = eqx.field(static=True)  # pyright: ignore[reportGeneralTypeIssues]

    def __init__(
        self,
        half_width: Number,
        slenderness: Number,
        gravity: Number = 9.81,
        inertia_ratio: Number = RECTANGLE_INERTIA_RATIO,
        *,
        one_sided: bool = False,
    ):
        self.half_width = as_field(Block, "half_width", half_width)
        self.slenderness = as_field(Block, "slenderness", slenderness)
        self.gravity = as_field(Block, "gravity", gravity)
        self.inertia_ratio = as_field(Block, "inertia_ratio", inertia_ratio)
        self.one_sided = as_flag("one_sided", one_sided)

    def __str__(self) -> str:
        if words := format_outside(self):
            return words
        parts = [
            f"half-width {format_number(self.half_width, 'm')}",
            f"slenderness {format_number(self.slenderness)}",
            f"gravity {format_number(self.gravity, 'm/s2')}",
        ]
        if not is_rectangle(self):
            parts.append(f"inertia ratio {format_number(self.inertia_ratio)}")
        return ", ".join(parts + ["one-sided"] * self.one_sided)

    @classmethod
    def from_size(
        cls,
        *,
        width: Number,
        height: Number,
        gravity: Number = 9.81,
        inertia_ratio: Number = RECTANGLE_INERTIA_RATIO,
        one_sided: bool = False,
    ) -> "Block":
        """Make the block with a given full width 2b [m] and height 2a [m].

        Derivatives with respect to the width are at fixed height, those with respect to the
        height at fixed width. A warning is given for a side so long that it is probably in
        centimetres or millimetres.

        Parameters
        ----------
        width, height, gravity : array_like
            2b [m]; 2a [m], which is twice the height of the centre of mass; and g [m/s2]. All
            are finite and greater than 0.
            They are given by their names only, since width and height are
            easily swapped.
        inertia_ratio : array_like
            kappa [-], finite and at least 1; 4 / 3 for a homogeneous rectangle.
        one_sided : bool
            Whether it stands against a wall; see `Block`.

        Returns
        -------
        Block

        Raises
        ------
        ValueError
            If a concrete value is out of range. A traced one gives NaN.
        """
        parameters = {"gravity": gravity, "inertia_ratio": inertia_ratio}
        for name, value in (("width", width), ("height", height)):
            size = as_real(name, value, unit="m")
            check(name, size, POSITIVE)
            warn_of_size(name, size)
            parameters[name] = size
        return block_of(parameters, one_sided)

    @classmethod
    def from_parameters(
        cls,
        frequency_parameter: Number,
        critical_angle: Number,
        gravity: Number = 9.81,
        inertia_ratio: Number = RECTANGLE_INERTIA_RATIO,
        *,
        one_sided: bool = False,
    ) -> "Block":
        """Make the block with a frequency parameter p [1/s] and a critical angle alpha_c [rad].

        Both can be measured without knowing how the mass is distributed. They determine how
        the body rocks on moving ground. The inertia ratio then determines only its size, the
        forces on the ground and Housner's restitution.

        Parameters
        ----------
        frequency_parameter : array_like
            p [1/s], finite and greater than 0.
        critical_angle : array_like
            alpha_c [rad], between 0 and pi / 2.
        gravity : array_like
            g [m/s2], finite and greater than 0.
        inertia_ratio : array_like
            kappa [-], finite and at least 1.
        one_sided : bool
            Whether it stands against a wall; see `Block`.

        Returns
        -------
        Block

        Raises
        ------
        ValueError
            If a concrete value is out of range. A traced one gives NaN.

        Examples
        --------
        >>> import jaxrock as jr
        >>> statue = jr.Block.from_parameters(2.0, 0.2, inertia_ratio=1.25)
        >>> print(f"{statue.half_width:.4f} m, {statue.half_height:.4f} m")
        0.3898 m, 1.9229 m
        """
        size = compute_size(frequency_parameter, critical_angle, gravity, inertia_ratio)
        return cls(*size, gravity, inertia_ratio, one_sided=one_sided)

    @classmethod
    def from_body(
        cls,
        half_width: Number,
        centre_height: Number,
        mass: Number,
        inertia_about_centre: Number,
        gravity: Number = 9.81,
        *,
        one_sided: bool = False,
    ) -> "Block":
        """Make the block that rocks like a body whose mass and inertia are known.

        Parameters
        ----------
        half_width, centre_height : array_like
            Half the distance between the edges, and the height of the centre of mass [m],
            finite and greater than 0.
        mass : array_like
            m [kg], finite and greater than 0. Mass and moment of inertia may both be per unit
            of length.
        inertia_about_centre : array_like
            The moment of inertia I_c about the axis through the centre of mass, parallel to
            the edges [kg m2], finite and at least 0.
        gravity : array_like
            g [m/s2], finite and greater than 0.
        one_sided : bool
            Whether it stands against a wall; see `Block`.

        Returns
        -------
        Block
            Its inertia ratio is ``1 + I_c / (m R^2)``.

        Raises
        ------
        ValueError
            If a concrete value is out of range. A traced one gives NaN.

        Examples
        --------
        >>> import jaxrock as jr
        >>> print(jr.Block.from_body(0.3, 1.2, mass=500.0, inertia_about_centre=306.0))
        half-width 0.3 m, slenderness 4, gravity 9.81 m/s2, inertia ratio 1.4
        """
        shape = compute_shape(half_width, centre_height, mass, inertia_about_centre)
        return cls(half_width, shape[0], gravity, shape[1], one_sided=one_sided)

    @property
    @elementwise()
    def width(self) -> Reals:
        """Full width of the base, 2b [m]."""
        return 2 * self.half_width

    @property
    @elementwise()
    def height(self) -> Reals:
        """Full height, twice the height of the centre of mass, 2a = 2 lambda b [m]."""
        return 2 * self.slenderness * self.half_width

    @property
    @elementwise()
    def half_height(self) -> Reals:
        """Height of the centre of mass, half the height of a rectangle, a = lambda b [m]."""
        return self.slenderness * self.half_width

    @property
    @elementwise()
    def half_diagonal(self) -> Reals:
        """Distance from the centre of mass to an edge, R = sqrt(a^2 + b^2) [m]."""
        return self.half_width * diagonal_ratio(self)

    @property
    @elementwise()
    def critical_angle(self) -> Reals:
        """Rotation of unstable equilibrium, alpha_c = arctan(1 / lambda) [rad]."""
        return angle(1.0, self.slenderness)

    @property
    @elementwise()
    def frequency_parameter(self) -> Reals:
        """Frequency parameter, p = sqrt(g / (kappa R)) [1/s]."""
        fraction = fraction_in_centre(self.inertia_ratio)
        return jnp.sqrt(fraction * self.gravity / (self.half_width * diagonal_ratio(self)))

    @elementwise(intensity=NON_NEGATIVE)
    def pulse_velocity(self, intensity: Number) -> Reals:
        """Compute the angular velocity that an instantaneous pulse gives to the block at rest.

        The angular momentum about the edge is conserved, for any slenderness (Eq. 2).

        Parameters
        ----------
        intensity : array_like
            I, change of the ground velocity [m/s], finite and at least 0.

        Returns
        -------
        velocity : Array, shape (...)
            ``lambda I / (kappa b (1 + lambda^2))`` [rad/s].

        Raises
        ------
        ValueError
            If a concrete `intensity` is out of range. A traced one gives NaN.
        """
        shape = self.slenderness / (1 + self.slenderness**2)
        return fraction_in_centre(self.inertia_ratio) * shape * intensity / self.half_width


def warn_of_size(name: str, value: AnyArray, stacklevel: int = 2) -> None:
    """Warn if a width or a height is hardly meant in metres; `stacklevel` is the caller's."""
    if is_traced(value):
        return
    largest = float(np.max(np.asarray(value), initial=0.0))
    if largest > LARGEST_SIZES[name]:
        text = f"{name} is {largest:.4g} m: sizes are in metres"
        warnings.warn(text, stacklevel=stacklevel + 1)


def size_of(block: Block, by: SizeDescription) -> dict[str, AnyArray | np.floating]:
    """List all parameters of a block, with one description of its size.

    Parameters
    ----------
    block : Block
        Leaves of NumPy give width and height in NumPy, for which nothing is compiled.
    by : {"sides", "shape", "dynamics"}
        Whether the size is ``width`` and ``height`` [m], or ``half_width`` [m] and
        ``slenderness`` [-], or ``critical_angle`` [rad] and ``frequency_parameter`` [1/s].

    Returns
    -------
    dict of Array
        The two parameters of the size, ``gravity`` [m/s2], ``inertia_ratio`` [-]; in order.
    """
    if by == "sides":
        width = 2 * block.half_width
        size = {"width": width, "height": width * block.slenderness}
    else:
        size = {name: getattr(block, name) for name in SIZE_NAMES[by]}
    return {**size, "gravity": block.gravity, "inertia_ratio": block.inertia_ratio}


def block_of(parameters: Mapping[str, Number], one_sided: bool) -> Block:
    """Make the block of its parameters, by any description of its size.

    Parameters
    ----------
    parameters : mapping
        As `size_of` lists them; other entries are not read.
    one_sided : bool
        Whether it stands against a wall.

    Returns
    -------
    Block
        With leaves of NumPy where the numbers it has as fields are of NumPy, else of JAX.

    Raises
    ------
    ValueError
        If a concrete value is out of range.
    """
    if "width" in parameters:
        half_width = parameters["width"] / 2
        slenderness = parameters["height"] / parameters["width"]
    elif "critical_angle" in parameters:
        names = ("frequency_parameter", "critical_angle", "gravity", "inertia_ratio")
        half_width, slenderness = compute_size(*(parameters[name] for name in names))
    else:
        half_width = parameters["half_width"]
        slenderness = parameters["slenderness"]
    # Gravity and the inertia ratio have one description.
    numbers = (half_width, slenderness, parameters["gravity"], parameters["inertia_ratio"])
    block = Block(*numbers, one_sided=one_sided)
    if all(isinstance(number, np.ndarray | np.generic) for number in numbers):
        # A block moves its numbers to the device, where each operation on them would compile a
        # program for each shape.
        return jax.tree.unflatten(jax.tree.structure(block), numbers)
    return block


def change_block(block: Block, name: str, value: AnyArray) -> Block:
    """Replace one parameter of a block: a field, or one of its sides while the other stays.

    Parameters
    ----------
    block : Block
    name : str
        A field of `Block`; or ``"width"``, the full width at this height; or ``"height"``, the
        full height at this width. The inertia ratio stays as it is.
    value : Array, shape (...)
        The new value, which has been checked.

    """
    by = "sides" if name in SIDES else "shape"
    return block_of({**size_of(block, by), name: value}, block.one_sided)


def diagonal_ratio(block: Block) -> Reals:
    """Compute R / b = sqrt(1 + lambda^2); ``1 / (R / b)`` is sin(alpha_c)."""
    return jnp.sqrt(1 + block.slenderness**2)


def is_rectangle(block: Block) -> bool:
    """Return whether the inertia ratio is known to belong to a homogeneous rectangle."""
    ratio = block.inertia_ratio
    # Some transformations put other objects in the place of arrays.
    if is_traced(ratio) or not isinstance(ratio, jax.Array | np.ndarray):
        return False
    return bool(np.allclose(ratio, RECTANGLE_INERTIA_RATIO, rtol=1e-6, atol=0))
