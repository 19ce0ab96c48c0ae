"""An answer as a compiled function of the parameters that it depends on, and their scatter."""

import dataclasses
import difflib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import KeyPath, keystr
from jaxtyping import Array, PyTree
from scipy.special import expit

from ..block import Block
from ..validation import (
    COUNT,
    NON_NEGATIVE,
    AnyArray,
    Number,
    as_real,
    as_text,
    carries_unit,
    check,
    check_kind,
    describe,
)

Answer = Callable[..., Number]  # of a pytree of numbers
Ranges = Mapping[str, tuple[float, float]]
Spread = Mapping[str, float]  # coefficients of variation by name
_Float = TypeVar("_Float", float, np.ndarray)

# The two descriptions of the size of a block: 2b and 2a, or b and lambda.
SIDES = ("width", "height")
SHAPE = ("half_width", "slenderness")
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
    # Places of the widths of blocks that are described by their sides; the height is next.
    widths: tuple[int, ...] = eqx.field(static=True, default=())
    scatter: tuple[Array, Array] | None = None  # `find_widths`

    @property
    def sides(self) -> tuple[str, ...]:
        """The names of all sides of blocks."""
        return tuple(name for k in self.widths for name in self.names[k : k + 2])

    def parameters_at(self, point: Array) -> Array:
        """Return all parameters at a point, also those without scatter or range."""
        varied = np.asarray(self.varied, int)
        if self.scatter is not None:
            point = jnp.asarray(quantiles(point, self.values[varied], *self.scatter))
        return self.values.at[varied].set(point)

    def __call__(self, point: Array) -> Array:
        """Compute the answer at a point."""
        parameters = list(self.parameters_at(point))
        for k in self.widths:
            width, height = parameters[k : k + 2]
            parameters[k : k + 2] = width / 2, height / width
        value = jnp.asarray(self.answer(jax.tree.unflatten(self.form, parameters)))
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
    answer: Answer,
    at: PyTree,
    argument: str = "",
    varied: Iterable[str] | None = None,
    sides: bool = False,
) -> ParametricAnswer:
    """Make the answer a function of the parameters that an `argument` names, or of all.

    A block in `at` is described by its sides if these are named, or all blocks are by `sides`.
    """
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
    paths = [path for path, _ in leaves]
    if isinstance(varied, Mapping):
        _check_numbers(argument, varied)
    varied = None if varied is None else tuple(map(as_text, varied))
    widths = _find_widths_of_blocks(at, paths, varied, argument, sides)
    names = _name_parameters(paths, widths)
    for name in varied or ():
        if name not in names:
            # A block has these as well, in place of half-width and slenderness.
            block = any(each.endswith("half_width") for each in names)
            allowed = dict.fromkeys((*names, *(("width", "height") if block else ())))
            near = difflib.get_close_matches(name, allowed, 1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise ValueError(
                f"{argument} has {name!r}, which is none of {', '.join(allowed)}{hint}"
            )
    numbers = [float(leaf) for _, leaf in leaves]
    for k in widths:
        width = 2 * numbers[k]
        numbers[k : k + 2] = width, width * numbers[k + 1]
    values = jnp.asarray(np.array(numbers))
    places = tuple(map(names.index, names if varied is None else varied))
    return ParametricAnswer(answer, values, names, jax.tree.structure(at), places, widths)


def _check_numbers(argument: str, varied: Mapping[str, object]) -> None:
    """Raise `ValueError` if what is given for a name is not a number, or two for a range."""
    wanted = (2,) if argument == "ranges" else ()
    must = "two numbers" if wanted else "a number"
    for name, value in varied.items():
        # A unit would be lost: a name of a parameter does not tell its own.
        if carries_unit(value) or np.shape(as_real(name, value)) != wanted:
            got = describe(value)
            raise ValueError(f"{argument} of {name} must be {must} without a unit, got {got}")


def _name_parameters(paths: Sequence[KeyPath], widths: Sequence[int]) -> tuple[str, ...]:
    """Name the parameters, shortly where that is unique: "restitution" instead of its path."""
    full = [keystr(path, simple=True, separator=".") for path in paths]
    short = [keystr(path[-1:], simple=True) or "value" for path in paths]
    # Counted before: the sides of one block change no names of other numbers.
    unique = [short.count(name) == 1 for name in short]
    own = set(short)
    for k in widths:
        for place, side in zip((k, k + 1), SIDES, strict=True):
            before, dot, _ = full[place].rpartition(".")
            full[place] = before + dot + side
            short[place] = side
            unique[place] &= side not in own
    return tuple(
        name if alone else path for name, path, alone in zip(short, full, unique, strict=True)
    )


def _find_widths_of_blocks(
    at: PyTree,
    paths: Sequence[KeyPath],
    varied: Sequence[str] | None,
    argument: str,
    sides: bool,
) -> tuple[int, ...]:
    """Find the places of half-widths that are replaced by widths, as are those behind them."""
    nodes = jax.tree.leaves_with_path(at, is_leaf=lambda node: isinstance(node, Block))
    blocks = [path for path, node in nodes if isinstance(node, Block)]
    first = [
        next(k for k, path in enumerate(paths) if path[: len(block)] == block)
        for block in blocks
    ]
    if varied is None:
        return tuple(first) if sides else ()
    # The names as they are come first: a dictionary may have a number called width.
    names = _name_parameters(paths, ())
    found = []
    for k in first:
        described = _name_parameters(paths, [k])[k : k + 2]
        asked = [name for name in varied if name in described and name not in names]
        if asked:
            shape = [name for name in varied if name in names[k : k + 2]]
            choose_sides([_cut(name) for name in asked + shape], argument)
            found.append(k)
    return tuple(found)


def _cut(name: str) -> str:
    """Cut the path off a name."""
    return name.rpartition(".")[2]


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


def choose_sides(names: Iterable[str], argument: str) -> bool:
    """Tell whether the names describe a block by its sides.

    Raises
    ------
    ValueError
        If they also describe it by half-width or slenderness.
    """
    names = list(names)
    by_sides = [name for name in names if name in SIDES]
    by_shape = [name for name in names if name in SHAPE]
    if by_sides and by_shape:
        raise ValueError(
            f"{argument} must have width and height, or half_width and slenderness, which are"
            f" the same two numbers; got {by_sides[0]} and {by_shape[0]}"
        )
    return bool(by_sides)


# A width has two meanings, by what stays as it is.
_WORDS = {
    "width": "width at this height",
    "height": "height at this width",
    "half_width": "size at this slenderness",
    "scale": "factor on the motion",
}


def describe_input(name: str) -> str:
    """Write a parameter in words, a size with what stays as it is where it is changed."""
    return _WORDS.get(name, name.replace("_", " "))


def label_sides(names: Iterable[str], sides: Sequence[str]) -> list[str]:
    """Label the sides of a block in words, other parameters by their names."""
    return [_WORDS.get(name, name) if name in sides else name for name in names]


def quantiles(z: AnyArray, median: AnyArray, width: AnyArray, bounded: AnyArray) -> AnyArray:
    """Compute parameters at standard normal numbers, distributed as `find_widths` says.

    In NumPy where all is concrete and of NumPy.
    """
    host = all(isinstance(each, np.ndarray) for each in (z, median, width, bounded))
    library = np if host else jnp
    sigmoid = expit if host else jax.nn.sigmoid
    # Each branch is computed for all parameters, and the derivative of a branch that is not
    # taken must not be NaN: hence the 1 in place of a median that has no odds.
    odds = library.where(bounded, median / library.where(bounded, 1 - median, 1), 1.0)
    logit_normal = sigmoid(library.log(odds) + width * z)
    lognormal = median * library.exp(width * z)
    normal = median + width * abs(median) * z
    return library.where(bounded, logit_normal, library.where(median > 0, lognormal, normal))


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
