"""Uncertain parameters of blocks and their impacts, and samples of them."""

import dataclasses
from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ..block import Block
from ..host import Printed
from ..validation import (
    NON_NEGATIVE,
    Number,
    Numbers,
    as_real,
    carries_unit,
    check,
    check_kind,
    describe,
)
from .correlations import Pair, check_correlations, factor_correlations
from .distributions import find_widths, quantiles
from .parameters import Answer, ParametricAnswer, make_parametric
from .samples import (
    ARGUMENT,
    draw_normal_numbers,
    list_medians,
    make_drawn_blocks,
    map_normal_numbers,
    refuse_wide_angles,
)

# Factors on the periods and dampings of all modes of a floor.
FLOOR_NAMES = ("floor_period", "floor_damping")


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
        The standard normal variable from which each sample of each uncertain parameter
        follows, correlated as the parameters are. It is the same for all objects.
    floor : FloorFactors or None
        Of shape (..., samples); None where the floor is not uncertain.
    """

    block: Block
    restitution: np.ndarray
    normal: np.ndarray
    floor: FloorFactors | None = None


class Uncertain(Printed, eqx.Module):
    """Uncertain parameters, by coefficients of variation, and how they are sampled.

    Each parameter has a median, its value without uncertainty, and a coefficient of
    variation. Positive parameters are lognormal, a ``restitution`` or ``damping_ratio`` is
    logit-normal, all others are normal. They are independent except for the given
    correlations.

    Parameters
    ----------
    coefficients_of_variation : mapping
        Standard deviation over mean [-], finite and at least 0, by name; one number, or one
        for each object. Of a block the names are ``width`` (at this height) and ``height``
        (at this width), or ``half_width`` (at this slenderness) and ``slenderness``, or
        ``critical_angle`` and ``frequency_parameter``, which can be measured; ``gravity`` and
        ``inertia_ratio``. For the floor of a suite the names are ``floor_period`` and
        ``floor_damping``, which are common to all modes. Functions that take an `Uncertain`
        list any further names.
    correlations : mapping, optional
        Correlation coefficients [-], between -1 and 1, by pairs of names: of the logarithms
        of lognormal parameters, the logits of logit-normal ones, normal ones themselves.
        Pairs that are not given are uncorrelated. All objects have the same correlations.
    samples : int
        Number of samples, a power of 2.
    seed : int
        Seed of the scrambling of the Sobol points, at least 0.

    Attributes
    ----------
    names, coefficients : tuple
        The names, and the coefficients in the same order: each a number, or a tuple of them.
    correlated_pairs : tuple
        Pairs of names that are correlated, each with its correlation coefficient.

    Raises
    ------
    ValueError
        If a name is not a string; if a coefficient is out of range, has a unit or more than
        one axis; if `correlations` are not of two different names each, or form no positive
        semi-definite matrix; if `samples` or `seed` are not as above.

    Notes
    -----
    Correlated parameters are a linear map of independent standard normal variables, by the
    Cholesky factor of the correlations. The first name keeps its own points, and so does
    every name that is correlated with none before it.

    Examples
    --------
    >>> import jaxrock as jr
    >>> print(jr.Uncertain({"width": 0.02, "restitution": 0.05}, samples=1024))
    coefficients of variation: width 0.02, restitution 0.05; 1024 samples, seed 0
    >>> coefficients = {"critical_angle": 0.1, "frequency_parameter": 0.05}
    >>> correlations = {("critical_angle", "frequency_parameter"): 0.4}
    >>> print(jr.Uncertain(coefficients, correlations=correlations))
    coefficients of variation: critical_angle 0.1, frequency_parameter 0.05; correlations:\
 critical_angle and frequency_parameter 0.4; 64 samples, seed 0
    """

    names: tuple[str, ...] = eqx.field(static=True)
    # Of numbers alone, so that this is immutable, and equal to another one of the same values.
    coefficients: tuple[float | tuple[float, ...], ...] = eqx.field(static=True)
    correlated_pairs: tuple[tuple[Pair, float], ...] = eqx.field(static=True)
    samples: int = eqx.field(static=True)
    seed: int = eqx.field(static=True)

    def __init__(
        self,
        coefficients_of_variation: Mapping[str, Numbers],
        *,
        correlations: Mapping[Pair, Number] | None = None,
        samples: int = 64,
        seed: int = 0,
    ):
        check_kind(ARGUMENT, coefficients_of_variation, Mapping)
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
        self.correlated_pairs = check_correlations(correlations or {}, self.names)
        self.samples = samples
        self.seed = seed

    def __str__(self) -> str:
        words = [
            f"{name} {_write_coefficient(value)}"
            for name, value in zip(self.names, self.coefficients, strict=True)
        ]
        parts = [f"coefficients of variation: {', '.join(words) or 'none'}"]
        if self.correlated_pairs:
            pairs = [
                f"{first} and {second} {value:g}"
                for (first, second), value in self.correlated_pairs
            ]
            parts.append(f"correlations: {', '.join(pairs)}")
        return "; ".join([*parts, f"{self.samples} samples, seed {self.seed}"])

    @property
    def coefficients_of_variation(self) -> dict[str, float | np.ndarray]:
        """The coefficients by name, as numbers or arrays of shape (objects,) [-]."""
        return {
            name: np.array(value) if isinstance(value, tuple) else value
            for name, value in zip(self.names, self.coefficients, strict=True)
        }

    @property
    def correlations(self) -> dict[Pair, float]:
        """The correlation coefficients that are not 0, by pairs of names [-]."""
        return dict(self.correlated_pairs)

    def correlate(self, normal: np.ndarray) -> np.ndarray:
        """Correlate independent standard normal variables, as those of `Draws` are.

        Parameters
        ----------
        normal : ndarray, shape (samples, names)
            Independent standard normal variables, a column for each name.

        Returns
        -------
        ndarray, shape (samples, names)
            The same numbers where nothing is correlated.
        """
        if not self.correlated_pairs:
            return normal
        return normal @ factor_correlations(self.correlated_pairs, self.names).T

    def draw(self, block: Block, restitution: Number, *, on_floor: bool = False) -> Draws:
        """Draw samples of a block, or of each of many, by scrambled Sobol points.

        All objects share the points, so that a difference between two objects is not sampling
        noise. The samples of an object do not depend on the other objects.

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
            If a name is no parameter, or names a floor although there is none; if
            descriptions of a size are mixed; if medians have more than one axis, or
            coefficients are not one for each object; if an inertia ratio falls below 1, or a
            critical angle reaches pi / 2; if the coefficient of variation of a restitution is
            too large: above 0 at a median of 1, or so large that the density has two peaks.

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
                f"{ARGUMENT} has {of_floor[0]!r}, but the suite is on no floor whose period and"
                " damping are known; Suite.on_floor puts it on one"
            )
        if of_floor:
            parameters |= dict.fromkeys(FLOOR_NAMES, np.ones(()))
        medians = np.broadcast_arrays(*parameters.values())
        shape = medians[0].shape
        if len(shape) > 1 or shape == (0,):
            raise ValueError(
                "block and restitution must be single or have one axis, of at least one"
                f" object, got shape {shape}"
            )
        for name, values in zip(self.names, self.coefficients, strict=True):
            if isinstance(values, tuple) and (len(values),) != shape:
                raise ValueError(
                    f"{ARGUMENT} of {name} must be one number, or one for each object, got"
                    f" {len(values)} for objects of shape {shape}"
                )
        independent = draw_normal_numbers(len(self.names), self.samples, self.seed)
        normal = self.correlate(independent)
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
    """Make an answer a function of independent standard normal numbers, and draw these.

    Correlations are within the function.
    """
    coefficients = list_single_coefficients(uncertain)
    function = make_parametric(answer, at, ARGUMENT, uncertain.names)
    medians = np.asarray(function.values)[list(function.varied)]
    widths = find_widths(uncertain.names, medians, np.array(list(coefficients.values())))
    width, bounded = map(jnp.asarray, widths)
    normal = draw_normal_numbers(len(coefficients), uncertain.samples, uncertain.seed)
    samples = np.asarray(quantiles(uncertain.correlate(normal), medians, *widths))
    for critical_angle in function.get_size_names("dynamics")[::2]:
        if critical_angle in uncertain.names:
            column = uncertain.names.index(critical_angle)
            refuse_wide_angles(critical_angle, samples[:, column])
    factor = None
    if uncertain.correlated_pairs:
        factor = jnp.asarray(factor_correlations(uncertain.correlated_pairs, uncertain.names))
    function = dataclasses.replace(function, distribution=(width, bounded), factor=factor)
    return function, normal


def list_single_coefficients(uncertain: Uncertain) -> dict[str, float]:
    """List the coefficients of variation; a `ValueError` if one is an array."""
    check_kind("uncertain", uncertain, Uncertain)
    coefficients = dict[str, float]()
    for name, value in uncertain.coefficients_of_variation.items():
        if isinstance(value, np.ndarray):
            raise ValueError(
                f"{ARGUMENT} of {name} must be one number here, got {value.size} of them"
            )
        coefficients[name] = value
    return coefficients


def _check_coefficient(name: object, value: Any) -> tuple[str, float | tuple[float, ...]]:
    """Return a name and its coefficients as plain numbers; `ValueError` if not allowed."""
    if not isinstance(name, str):
        raise ValueError(f"{ARGUMENT} must have names as keys, got {describe(name)}")
    # A unit would be lost: a name of a parameter does not tell its own.
    if carries_unit(value):
        raise ValueError(
            f"{ARGUMENT} of {name} must be numbers without a unit, got {describe(value)}"
        )
    checked = np.asarray(as_real(f"{ARGUMENT} of {name}", value))
    # In float64, also where JAX computes in float32.
    values = np.asarray(value, float)
    if checked.ndim > 1 or not checked.size:
        raise ValueError(
            f"{ARGUMENT} of {name} must be one number, or one for each object, got an array"
            f" of shape {checked.shape}"
        )
    check(f"{ARGUMENT} of {name}", values, NON_NEGATIVE)
    return str(name), float(values) if not values.ndim else tuple(values.tolist())


def _write_coefficient(value: float | tuple[float, ...]) -> str:
    """Write one coefficient, or the least and the largest of all objects."""
    if isinstance(value, tuple):
        return f"{min(value):g} to {max(value):g}"
    return f"{value:g}"
