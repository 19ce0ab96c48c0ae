"""Uncertain parameters of blocks and their impacts, and samples of them."""

import dataclasses
import inspect
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree
from scipy.special import ndtri

from ..block import SHAPE, SIDES, Block, block_of, size_of
from ..host import Printed
from ..impact import read_restitution
from ..validation import (
    NON_NEGATIVE,
    Number,
    Numbers,
    as_real,
    as_text,
    carries_unit,
    check,
    check_kind,
    describe,
)
from .distributions import find_widths, quantiles
from .parameters import (
    Answer,
    ParametricAnswer,
    choose_description,
    make_parametric,
    refuse_name,
)

_ARGUMENT = "coefficients_of_variation"
# Factors on the periods and dampings of all modes of a floor.
FLOOR_NAMES = ("floor_period", "floor_damping")
_BITS = 30  # of a Sobol point, the default of SciPy


class FloorFactors(NamedTuple):
    """Factors on the periods and dampings of a floor, for each sample [-]."""

    period: np.ndarray
    damping: np.ndarray


class Draws(NamedTuple):
    """Samples of blocks and their restitutions; see `Uncertain.draw`.

    Attributes
    ----------
    block, restitution : Block of ndarray, ndarray, shape (..., samples)
    normal : ndarray, shape (samples, names)
        The standard normal numbers, which all objects share.
    floor : FloorFactors or None
        Of shape (..., samples); None where the floor is not uncertain.
    """

    block: Block
    restitution: np.ndarray
    normal: np.ndarray
    floor: FloorFactors | None = None


class Uncertain(Printed, eqx.Module):
    """Uncertain parameters, by coefficients of variation, and how they are sampled.

    The parameters are independent. Each is given by its median, the value it has without
    uncertainty, and by its coefficient of variation: positive ones are lognormal, a
    ``restitution`` or ``damping_ratio`` is logit-normal, all others are normal.

    Parameters
    ----------
    coefficients_of_variation : mapping
        Standard deviation over mean [-], finite and at least 0, by name; one number, or one
        for each object. Of a block the names are ``width`` (at this height) and ``height`` (at
        this width), or ``half_width`` (at this slenderness) and ``slenderness``; ``gravity``
        and ``inertia_ratio``. Of the floor on which a suite is they are ``floor_period`` and
        ``floor_damping``, which are common to all modes. What else has a name the function
        says that takes this.
    samples : int
        Number of samples, a power of 2.
    seed : int
        Of the scrambling of the Sobol points, at least 0.

    Attributes
    ----------
    names, coefficients : tuple
        The names, and the coefficients in the same order: each a number, or a tuple of them.

    Raises
    ------
    ValueError
        If a name is not a string; if a coefficient is out of range, has a unit or more than
        one axis; if `samples` or `seed` are not as above.

    Examples
    --------
    >>> import jaxrock as jr
    >>> print(jr.Uncertain({"width": 0.02, "restitution": 0.05}, samples=1024))
    coefficients of variation: width 0.02, restitution 0.05; 1024 samples, seed 0
    """

    names: tuple[str, ...] = eqx.field(static=True)
    # Of numbers alone, so that this is immutable, and equal to another one of the same values.
    coefficients: tuple[float | tuple[float, ...], ...] = eqx.field(static=True)
    samples: int = eqx.field(static=True)
    seed: int = eqx.field(static=True)

    def __init__(
        self,
        coefficients_of_variation: Mapping[str, Numbers],
        *,
        samples: int = 64,
        seed: int = 0,
    ):
        check_kind(_ARGUMENT, coefficients_of_variation, Mapping)
        checked = dict(
            _check_coefficient(name, value)
            for name, value in coefficients_of_variation.items()
        )
        # The points are balanced in powers of 2 only, and their errors of order 1 / n there.
        if type(samples) is not int or samples < 1 or samples & (samples - 1):
            raise ValueError(f"samples must be a power of 2, got {samples!r:.60}")
        if type(seed) is not int or seed < 0:
            raise ValueError(f"seed must be a whole number from 0 on, got {seed!r:.60}")
        self.names = tuple(checked)
        self.coefficients = tuple(checked.values())
        self.samples = samples
        self.seed = seed

    def __str__(self) -> str:
        words = [
            f"{name} {_write_coefficient(value)}"
            for name, value in zip(self.names, self.coefficients, strict=True)
        ]
        sampled = f"{self.samples} samples, seed {self.seed}"
        return f"coefficients of variation: {', '.join(words) or 'none'}; {sampled}"

    @property
    def coefficients_of_variation(self) -> dict[str, float | np.ndarray]:
        """The coefficients by name, as numbers or arrays of shape (objects,) [-]."""
        return {
            name: np.array(value) if isinstance(value, tuple) else value
            for name, value in zip(self.names, self.coefficients, strict=True)
        }

    def draw(self, block: Block, restitution: Number, *, on_floor: bool = False) -> Draws:
        """Draw samples of a block, or of each of many, by scrambled Sobol points.

        All objects share the points: what differs between two of them is not the noise of two
        samples. What is drawn of an object does not depend on the others.

        Parameters
        ----------
        block, restitution : Block, array_like, shape () or (objects,)
            The medians.
        on_floor : bool
            Whether there is a floor, whose period and damping may be uncertain.

        Returns
        -------
        Draws
            In NumPy and float64.

        Raises
        ------
        ValueError
            If a name is none of the parameters, or is of a floor and there is none; if both
            descriptions of a size are mixed; if there are more axes than one, or not a
            coefficient for each object; if an inertia ratio falls below 1; if the coefficient
            of a restitution is too large: not 0 at a median of 1, or such that the density has
            two peaks.

        Examples
        --------
        >>> import jaxrock as jr
        >>> uncertain = jr.Uncertain({"restitution": 0.05}, samples=4)
        >>> draws = uncertain.draw(jr.Block(0.4, 5.0), 0.8)
        >>> print(draws.restitution.round(3))
        [0.791 0.826 0.806 0.756]
        """
        parameters = list_medians(block, restitution, self.names)
        of_floor = [name for name in self.names if name in FLOOR_NAMES]
        if of_floor and not on_floor:
            raise ValueError(
                f"{_ARGUMENT} has {of_floor[0]!r}, but the suite is on no floor whose period and"
                " damping are known; Suite.on_floor puts it on one"
            )
        if of_floor:
            parameters |= dict.fromkeys(FLOOR_NAMES, np.ones(()))
        medians = np.broadcast_arrays(*parameters.values())
        shape = medians[0].shape
        if len(shape) > 1 or shape == (0,):
            raise ValueError(
                "block and restitution must be single ones or have one axis, of at least one"
                f" object, got shape {shape}"
            )
        for name, values in zip(self.names, self.coefficients, strict=True):
            if isinstance(values, tuple) and (len(values),) != shape:
                raise ValueError(
                    f"{_ARGUMENT} of {name} must be one number, or one for each object, got"
                    f" {len(values)} for shape {shape} of the objects"
                )
        normal = draw_normal_numbers(len(self.names), self.samples, self.seed)
        # Object by object: the last digit of an exponential may depend on its place in the
        # array.
        rows = np.stack(medians, axis=-1).reshape(-1, len(medians)).tolist()
        drawn = [
            map_normal_numbers(
                normal, dict(zip(parameters, row, strict=True)), self._select(k)
            )
            for k, row in enumerate(rows)
        ]
        samples = {
            name: np.stack([sample[name] for sample in drawn]).reshape(*shape, self.samples)
            for name in parameters
        }
        drawn_blocks = make_drawn_blocks(samples, block.one_sided)
        floor = FloorFactors(*(samples[name] for name in FLOOR_NAMES)) if of_floor else None
        return Draws(drawn_blocks, samples["restitution"], normal, floor)

    def _select(self, number: int) -> dict[str, float]:
        """Select the coefficients of one object, by name."""
        return {
            name: value[number] if isinstance(value, tuple) else value
            for name, value in zip(self.names, self.coefficients, strict=True)
        }


def make_uncertain_answer(
    answer: Answer, at: PyTree, uncertain: Uncertain
) -> tuple[ParametricAnswer, np.ndarray]:
    """Make an answer a function of independent standard normal numbers, and draw these."""
    coefficients = list_single_coefficients(uncertain)
    function = make_parametric(answer, at, _ARGUMENT, uncertain.names)
    medians = np.asarray(function.values)[list(function.varied)]
    widths = find_widths(uncertain.names, medians, np.array(list(coefficients.values())))
    width, bounded = map(jnp.asarray, widths)
    normal = draw_normal_numbers(len(coefficients), uncertain.samples, uncertain.seed)
    return dataclasses.replace(function, distribution=(width, bounded)), normal


def list_single_coefficients(uncertain: Uncertain) -> dict[str, float]:
    """List the coefficients of variation; a `ValueError` if one is an array."""
    check_kind("uncertain", uncertain, Uncertain)
    coefficients = dict[str, float]()
    for name, value in uncertain.coefficients_of_variation.items():
        if isinstance(value, np.ndarray):
            raise ValueError(
                f"{_ARGUMENT} of {name} must be one number here, got {value.size} of them"
            )
        coefficients[name] = value
    return coefficients


def list_medians(
    block: Block, restitution: Number, names: Iterable[str]
) -> dict[str, np.ndarray]:
    """List the parameters of blocks and their restitutions, by sides if the names say so.

    In NumPy and float64, of shapes that broadcast.
    """
    check_kind("block", block, Block)
    restitution = read_restitution(block, restitution)
    by = choose_description(names, _ARGUMENT)
    host, coefficient = jax.tree.map(
        lambda leaf: np.asarray(leaf, float), (block, restitution)
    )
    parameters = {**size_of(host, by), "restitution": coefficient}
    return {name: np.asarray(value) for name, value in parameters.items()}


def draw_normal_numbers(dimensions: int, samples: int, seed: int) -> np.ndarray:
    """Draw standard normal numbers, shape (samples, dimensions), by scrambled Sobol points.

    The number of samples is a power of 2.
    """
    from scipy.stats import qmc  # which loads slowly

    if not dimensions:
        return np.empty((samples, 0))
    # SciPy has renamed the argument in version 1.15, and will warn of the old name.
    name = "rng" if "rng" in inspect.signature(qmc.Sobol).parameters else "seed"
    options: dict[str, Any] = {name: seed}
    engine = qmc.Sobol(dimensions, scramble=True, bits=_BITS, **options)
    points = engine.random_base2(samples.bit_length() - 1)
    # A point stands for its cell: at the middle of it no point is 0, whose normal number would
    # be infinite.
    return ndtri(points + 0.5 ** (_BITS + 1))


def map_normal_numbers(
    normal: np.ndarray, medians: Mapping[str, float], coefficients: Mapping[str, float]
) -> dict[str, np.ndarray]:
    """Map standard normal numbers, a column for each uncertain parameter, to all parameters.

    Parameters
    ----------
    normal : ndarray, shape (samples, uncertain)
    medians : mapping
        Of all parameters, by name.
    coefficients : mapping
        Coefficients of variation of the uncertain ones.

    Returns
    -------
    dict of ndarray, shape (samples,)
        All parameters by name; those without uncertainty are constant.
    """
    for name in coefficients:
        if name not in medians:
            refuse_name(name, (*medians, *SHAPE, *SIDES), _ARGUMENT)
    median = np.array([medians[name] for name in coefficients], float)
    width, bounded = find_widths(coefficients, median, np.array(list(coefficients.values())))
    samples = np.asarray(quantiles(normal, median, width, bounded))
    uncertain = dict(zip(coefficients, samples.T, strict=True))
    constant = {name: np.full(len(normal), float(value)) for name, value in medians.items()}
    return {**constant, **uncertain}


def make_drawn_blocks(samples: Mapping[str, np.ndarray], one_sided: bool) -> Block:
    """Make blocks of parameters that were drawn.

    Raises
    ------
    ValueError
        If an inertia ratio is below 1, which no body has.
    """
    ratio = samples["inertia_ratio"]
    if (ratio < 1).any():
        raise ValueError(
            f"{_ARGUMENT} must leave inertia_ratio at 1 or more, got samples down to"
            f" {ratio.min():.3g}"
        )
    return block_of(samples, one_sided)


def _check_coefficient(name: object, value: Any) -> tuple[str, float | tuple[float, ...]]:
    """Return a name and its coefficients as plain numbers; `ValueError` if not allowed."""
    name = as_text(name)
    if not isinstance(name, str):
        raise ValueError(f"{_ARGUMENT} must have names as keys, got {describe(name)}")
    # A unit would be lost: a name of a parameter does not tell its own.
    if carries_unit(value):
        raise ValueError(
            f"{_ARGUMENT} of {name} must be numbers without a unit, got {describe(value)}"
        )
    checked = np.asarray(as_real(f"{_ARGUMENT} of {name}", value))
    # In float64, also where JAX computes in float32.
    values = np.asarray(value, float)
    if checked.ndim > 1:
        raise ValueError(
            f"{_ARGUMENT} of {name} must be one number, or one for each object, got an array"
            f" of shape {checked.shape}"
        )
    check(f"{_ARGUMENT} of {name}", values, NON_NEGATIVE)
    return name, float(values) if not values.ndim else tuple(values.tolist())


def _write_coefficient(value: float | tuple[float, ...]) -> str:
    """Write one coefficient, or the least and the largest of all objects."""
    if isinstance(value, tuple):
        return f"{min(value):g} to {max(value):g}" if value else "none"
    return f"{value:g}"
