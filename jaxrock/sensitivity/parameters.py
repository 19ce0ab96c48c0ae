"""An answer as a compiled function of the parameters that it depends on, and their scatter."""

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import keystr
from jaxtyping import Array, PyTree

from ..validation import COUNT, NON_NEGATIVE, Number, as_real, check, check_kind

Answer = Callable[..., Number]  # of a pytree of numbers
Ranges = Mapping[str, tuple[float, float]]
Spread = Mapping[str, float]  # coefficients of variation by name
_Float = TypeVar("_Float", float, np.ndarray)

_CHUNK = 2**14  # points evaluated at once, for which there is memory
_BETWEEN_0_AND_1 = ("restitution", "damping_ratio")  # how the names of such parameters end


class ParametricAnswer(eqx.Module):
    """An answer as a function of its varied parameters, or of standard normal numbers.

    The static fields decide which program is compiled; other values use the same one.
    """

    answer: Answer
    values: Array  # of all parameters
    names: tuple[str, ...] = eqx.field(static=True)
    form: Any = eqx.field(static=True)  # of the pytree that the answer takes
    varied: tuple[int, ...] = eqx.field(static=True)
    scatter: tuple[Array, Array] | None = None  # `find_widths`

    def parameters_at(self, point: Array) -> Array:
        """Return all parameters at a point, also those without scatter or range."""
        varied = np.asarray(self.varied, int)
        if self.scatter is not None:
            point = quantiles(point, self.values[varied], *self.scatter)
        return self.values.at[varied].set(point)

    def __call__(self, point: Array) -> Array:
        """Compute the answer at a point."""
        parameters = jax.tree.unflatten(self.form, list(self.parameters_at(point)))
        value = jnp.asarray(self.answer(parameters))
        if value.ndim:
            raise ValueError(f"answer must be one number, got an array of shape {value.shape}")
        return value

    def evaluate(self, points: np.ndarray, order: int = 0) -> list[np.ndarray]:
        """Compute value, gradient and Hessian up to an order, at one point or at many."""
        if points.ndim == 1:
            return [np.asarray(part) for part in _evaluate(self, jnp.asarray(points), order)]
        # In chunks, since the Hessians of many points would not fit into memory together.
        chunks = (points[k : k + _CHUNK] for k in range(0, len(points), _CHUNK))
        parts = [_evaluate(self, jnp.asarray(chunk), order) for chunk in chunks]
        return [np.concatenate(part) for part in zip(*parts, strict=True)]


@eqx.filter_jit
def _evaluate(answer: ParametricAnswer, points: Array, order: int) -> list[Array]:
    """Compute value, gradient and Hessian up to an order in one program."""
    # Forward mode: the parameters are few, and some answers, such as those of a search, are
    # differentiated in forward mode only.
    gradient = jax.jacfwd(answer)
    functions = (answer, gradient, jax.jacfwd(gradient))[: order + 1]

    def evaluate_at(point: Array) -> list[Array]:
        return [function(point) for function in functions]

    return jax.vmap(evaluate_at)(points) if points.ndim > 1 else evaluate_at(points)


def make_parametric(
    answer: Answer, at: PyTree, argument: str = "", varied: Iterable[str] | None = None
) -> ParametricAnswer:
    """Make the answer a function of the parameters that an `argument` names, or of all."""
    check_kind("answer", answer, Callable)
    leaves = jax.tree.leaves_with_path(at)
    if not leaves:
        raise ValueError("at must contain at least one number")
    for path, leaf in leaves:
        as_real(keystr(path, simple=True, separator="."), leaf)  # raises for strings
        if jnp.ndim(leaf):
            raise ValueError(
                f"at must consist of single numbers, got an array in {keystr(path)}"
            )
    # Short names where they are unique: "restitution" instead of the path to it.
    last = [keystr(path[-1:], simple=True) or "value" for path, _ in leaves]
    names = tuple(
        short if last.count(short) == 1 else keystr(path, simple=True, separator=".")
        for short, (path, _) in zip(last, leaves, strict=True)
    )
    varied = names if varied is None else tuple(varied)
    for name in varied:
        if name not in names:
            raise ValueError(f"{argument} has {name!r}, which is none of {', '.join(names)}")
    values = jnp.asarray(np.array([float(leaf) for _, leaf in leaves]))
    places = tuple(map(names.index, varied))
    return ParametricAnswer(answer, values, names, jax.tree.structure(at), places)


def sample_scatter(
    answer: Answer, at: PyTree, variations: Spread, samples: int, seed: int
) -> tuple[ParametricAnswer, np.ndarray]:
    """Make the answer a function of independent standard normal numbers, and sample these."""
    function = make_parametric(answer, at, "coefficients_of_variation", variations)
    wanted = np.asarray(list(variations.values()), float)
    check("coefficients_of_variation", wanted, NON_NEGATIVE)
    check("samples", samples, COUNT)
    medians = np.asarray(function.values)[list(function.varied)]
    width, bounded = map(jnp.asarray, find_widths(variations, medians, wanted))
    z = np.random.default_rng(seed).standard_normal((samples, wanted.size))
    return dataclasses.replace(function, scatter=(width, bounded)), z


def quantiles(z: Array, median: Array, width: Array, bounded: Array) -> Array:
    """Compute parameters at standard normal numbers, distributed as `find_widths` says."""
    # Each branch is computed for all parameters, and the derivative of a branch that is not
    # taken must not be NaN: hence the 1 in place of a median that has no odds.
    odds = jnp.where(bounded, median / jnp.where(bounded, 1 - median, 1), 1.0)
    logit_normal = jax.nn.sigmoid(jnp.log(odds) + width * z)
    lognormal = median * jnp.exp(width * z)
    normal = median + width * abs(median) * z
    return jnp.where(bounded, logit_normal, jnp.where(median > 0, lognormal, normal))


def find_widths(
    names: Iterable[str], median: np.ndarray, variation: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Find widths of distributions from coefficients of variation; tell which are bounded.

    Parameters between 0 and 1 are logit-normal, and thus bounded. Others are lognormal where
    the median is positive, else normal. The width is the standard deviation of the logit, of
    the logarithm, or (normal) of the parameter over its median.
    """
    bounded = np.asarray([name.endswith(_BETWEEN_0_AND_1) for name in names], bool)
    # At a median of 0, or without scatter, there is no logit to be spread.
    bounded &= (median > 0) & (variation > 0)
    width = np.where(median > 0, np.log1p(variation**2) ** 0.5, variation)
    for k, name in enumerate(names):
        if bounded[k]:
            width[k] = _find_logit_width(name, float(median[k]), float(variation[k]))
    return width, bounded


def _find_logit_width(name: str, median: float, variation: float) -> float:
    """Find the logit's standard deviation for a coefficient of variation, by quadrature."""
    must_be = f"coefficient of variation of {name} must be"
    if median >= 1:
        raise ValueError(f"{must_be} 0 at {median:g}, got {variation:g}")
    logit = abs(math.log(median) - math.log1p(-median))
    z = np.linspace(-9, 9, 1801)
    weight = np.exp(-0.5 * z**2)
    weight /= weight.sum()

    def compute_variation(width: _Float) -> _Float:
        # Of median e^u / (1 - median + median e^u) above the median, u = width z, in a form
        # that keeps its digits where the width is small.
        growth = np.expm1(np.multiply.outer(width, z))
        above = median * (1 - median) * growth / (1 + median * growth)
        mean = above @ weight
        return ((above - mean[..., None]) ** 2 @ weight) ** 0.5 / (median + mean)

    def bisect(condition: Callable[[float], bool], high: float) -> float:
        """Find where a condition that is true at 0 ceases to be."""
        low = 0.0
        # 60 halvings are more than the 53 bits of a number.
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if condition(middle) else (low, middle)
        return low

    # The density has one peak up to here: the equation of its extremes, logit(x) =
    # logit(median) + width^2 (2 x - 1), solved together with its derivative.
    apart = bisect(lambda u: math.sinh(u) - u <= logit, 4 + math.log1p(logit))
    tried = np.linspace(0, 2**0.5 * math.cosh(0.5 * apart), 201)
    variations = compute_variation(tried)
    # Beyond its maximum the coefficient decreases: the mean grows faster than the deviation.
    largest = int(np.argmax(variations))
    if variation > variations[largest]:
        raise ValueError(
            f"{must_be} at most {variations[largest]:.3g} at {median:g}, since with"
            f" more the density has two peaks, near 0 and near 1; got {variation:g}"
        )
    return bisect(lambda width: compute_variation(width) <= variation, float(tried[largest]))
