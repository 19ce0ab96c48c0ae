"""The impact law: the velocity after an impact, the side, and coefficients of restitution.

Every single impact is computed here, of closed forms and of integrated motions. Sums over many
impacts contain powers of C instead, such as ``(1 - C^i) / (1 - C)``: they require a linear law.

Velocities are counted from the side on which the block stands, so that one law serves both
kinds of block: after an impact it moves away from the ground at C times the velocity with
which it came. A free-standing block then stands on the other side; a one-sided one, which the
wall has thrown back, stands where it stood.
"""

from typing import Any, ClassVar

import jax.numpy as jnp

from .block import Block, is_rectangle
from .body import fraction_in_centre
from .validation import (
    UNIT_INTERVAL,
    Domain,
    Number,
    Reals,
    as_array,
    as_real,
    check,
    choose_namespace,
    elementwise,
)

ONE_SIDED_RESTITUTION = Domain(
    "between -1 and 1 for a one-sided block", lambda x: abs(x) <= 1, 0.5
)


class ImpactLaw:
    """The impact law: which coefficient of restitution an impact has.

    For a law of your own, set `LAW` of this module to an object of a subclass, before anything
    is compiled.
    """

    # Whether the coefficient is C at all velocities. What rests on that, such as a sum over many
    # impacts, refuses another law.
    linear: ClassVar[bool] = True

    def restitution_at(self, restitution: Reals, velocity: Reals) -> Reals:
        """Compute the coefficient of an impact at a velocity [rad/s], here C."""
        return restitution


LAW = ImpactLaw()


def velocity_after_impact(
    restitution: Reals, velocity: Reals, unit: Reals | None = None
) -> Reals:
    """Compute the velocity with which a block leaves the ground after an impact.

    The `unit` of both velocities is given in rad/s, where it is another one.
    """
    return LAW.restitution_at(restitution, velocity * (1 if unit is None else unit)) * velocity


def require_linear_law(arguments: object = None) -> None:
    """Raise `ValueError` if the impact law is not linear; `elementwise` gives arguments."""
    if not LAW.linear:
        raise ValueError("restitution must not depend on velocity for a sum over impacts")


def side_after_impact(one_sided: bool, side: Reals) -> Reals:
    """Return the side on which a block stands after an impact, 1 or -1."""
    return side if one_sided else -side


def require_free_standing(block: Block, subject: str) -> None:
    """Raise `ValueError` for a one-sided block, which a subject leaves out."""
    if block.one_sided:
        raise ValueError(f"block must be free-standing for {subject}, got a one-sided one")


def count_half_cycles(block: Block) -> int:
    """Count the half-cycles of a full period: two, and one of a block against a wall."""
    return 1 if block.one_sided else 2


def read_restitution(block: Block, restitution: Number) -> Reals:
    """Read a coefficient of restitution, and take its magnitude for a one-sided block.

    The velocity of such a block is reversed, so that its coefficient is negative. Inside of
    the package it is not.

    Raises
    ------
    ValueError
        If a concrete value is not between 0 and 1, or -1 and 1 for a one-sided block.
    """
    coefficient = as_real("restitution", restitution, unit="")
    # The kind of the block is checked by the caller, perhaps later.
    one_sided = getattr(block, "one_sided", False)
    check("restitution", coefficient, ONE_SIDED_RESTITUTION if one_sided else UNIT_INTERVAL)
    # The derivative of the magnitude at 0 is 1 in JAX, as for larger values.
    magnitude = choose_namespace(coefficient).abs  # NumPy compiles nothing
    return as_array(magnitude(coefficient)) if one_sided else coefficient


def prepare_restitution(arguments: dict[str, Any]) -> None:
    """Replace the restitution of a one-sided block among arguments by its magnitude."""
    arguments["restitution"] = read_restitution(arguments["block"], arguments["restitution"])


@elementwise()
def housner_restitution(block: Block) -> Reals:
    """Compute Housner's coefficient of restitution, a ratio of angular velocities.

    It follows from the angular momentum about the new edge, which the impact conserves
    (Housner 1963, doi:10.1785/BSSA0530020403). It is negative for a stocky block, a rectangle
    below a slenderness of 0.707: such a block does not rock on.

    It is an upper bound for a block that touches a hard floor at its edges only: on concrete
    0.95 to 0.97 of it were measured, on rubber 0.67 (doi:10.1201/9781003060888-45). Blocks
    that touch the floor inside of their edges lose less. More measurements stand on the
    page "Which restitution?" of the documentation.

    Parameters
    ----------
    block : Block

    Returns
    -------
    restitution : Array, shape (...)
        ``1 - (2 / kappa) sin(alpha_c)^2`` [-]; ``1 - (3/2) sin(alpha_c)^2`` of a rectangle.

    Examples
    --------
    >>> import jaxrock as jr
    >>> print(f"{jr.housner_restitution(jr.Block(half_width=0.4, slenderness=5.0)):.3f}")
    0.942
    """
    square = block.slenderness**2
    twice = 2 * fraction_in_centre(block.inertia_ratio)
    # For stocky blocks the first form cancels (a rectangle: near 0.707), for tall ones the
    # second.
    stocky = twice * square / (1 + square) - (twice - 1)
    return jnp.where(square > 1, 1 - twice / (1 + square), stocky)


@elementwise()
def one_sided_restitution(block: Block) -> Reals:
    """Compute the coefficient of restitution of a block that rocks against a wall.

    As the block comes back, it meets the ground with the back edge of its base, then the wall
    with its top, then the ground with the front edge. Each of these impacts conserves the
    angular momentum about the point of contact; between the last two the block is assumed to
    rotate about the back edge again (Sorrentino, AlShawa and Decanini 2011,
    doi:10.1007/s10518-011-9291-1, for a rectangle). The velocity is reversed, so that the
    coefficient is negative. Tests of walls gave a magnitude some 5 % smaller. The coefficient
    is positive for a stocky block, a rectangle below a slenderness of 1.414, which the wall
    does not throw back.

    Parameters
    ----------
    block : Block

    Returns
    -------
    restitution : Array, shape (...)
        ``(1 - (2 / kappa) sin(alpha_c)^2)^2 (1 - (2 / kappa) cos(alpha_c)^2)`` [-].

    Examples
    --------
    >>> import jaxrock as jr
    >>> facade = jr.Block.from_size(width=0.6, height=6.0, one_sided=True)
    >>> print(f"{jr.one_sided_restitution(facade):.3f}")
    -0.471
    """
    square = block.slenderness**2
    twice = 2 * fraction_in_centre(block.inertia_ratio)
    # The first and the third impact are Housner's, the second one is at the wall.
    return housner_restitution(block) ** 2 * (1 - twice * square / (1 + square))


def compute_restitution_by_size(block: Block) -> Reals:
    """Compute the restitution of a block of either kind from its size.

    It is Housner's, or the magnitude of `one_sided_restitution`; negative for a block so
    stocky that an impact stops it.
    """
    return -one_sided_restitution(block) if block.one_sided else housner_restitution(block)


def assume_restitution(block: Block) -> float:
    """Compute the restitution of one block from its size; a `ValueError` if it has none."""
    restitution = float(compute_restitution_by_size(block))
    if restitution < 0:
        size = f"{float(block.width):.6g} m wide and {float(block.height):.6g} m high"
        raise ValueError(f"{size}: exchanged? If not, restitution must be given: none by size")
    return restitution


def compute_low_restitution(block: Block) -> Reals:
    """Compute a low restitution for a block of which only the size is known.

    From it up to `compute_restitution_by_size` it holds for hard flat bases that touch the
    floor at their edges. Soft layers are below, contacts inside of the edges above.
    """
    # The low end to compute with where neither the material nor the support is known. Measured
    # over theory were 0.95 and 0.97 of concrete on concrete (doi:10.1201/9781003060888-45),
    # 0.95 of walls (doi:10.1007/s10518-011-9291-1), 0.75 to 0.97 of two rocks
    # (docs/validation.md); rubber 0.67. See docs/restitution.md.
    return 0.85 * compute_restitution_by_size(block)


def describe_assumed_restitution(block: Block) -> str:
    """Describe the restitution that follows from the size of one block, as an assumption."""
    theory = "from size against a wall" if block.one_sided else "Housner's"
    return f"C = {assume_restitution(block):.3f} ({theory}, assumed)"


def describe_scene(block: Block, restitution: float | Reals | None = None) -> str:
    """Describe one block and its restitution in words, as all texts and titles do.

    Parameters
    ----------
    block : Block
    restitution : float, optional
        C [-]; by default the one that follows from the size, which is named as assumed.

    Returns
    -------
    str
    """
    high = f"{float(block.height):.6g} m high"
    if not is_rectangle(block):  # of another body, the height itself is not known
        high = f"centre of mass {float(block.half_height):.6g} m high, inertia ratio"
        high = f"{high} {float(block.inertia_ratio):.4g}"
    size = f"{float(block.width):.6g} m wide, {high}"
    wall = ", one-sided" * block.one_sided
    if restitution is None:
        return f"{size}{wall}, {describe_assumed_restitution(block)}"
    return f"{size}{wall}, C = {float(restitution):.6g}"
