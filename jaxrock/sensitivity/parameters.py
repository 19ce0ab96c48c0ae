"""An answer as a compiled function of the parameters that it depends on."""

import difflib
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NoReturn

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import KeyPath, keystr
from jaxtyping import Array, PyTree

from ..block import (
    SHAPE,
    SIDES,
    SIZES_IN_WORDS,
    Block,
    SizeDescription,
    block_of,
    size_of,
)
from ..validation import (
    Number,
    as_real,
    as_text,
    carries_unit,
    check_kind,
    describe,
)
from .distributions import quantiles

Answer = Callable[..., Number]  # of a pytree of numbers
Ranges = Mapping[str, tuple[float, float]]

# The parameters of a block that is described by its sides, as `size_of` lists them.
_BY_SIDES = (*SIDES, "gravity", "inertia_ratio")
_CHUNK = 2**14  # points evaluated at once, for which there is memory


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
    distribution: tuple[Array, Array] | None = None  # widths and bounds, by `find_widths`

    @property
    def sides(self) -> tuple[str, ...]:
        """The names of all sides of blocks."""
        return tuple(name for k in self.widths for name in self.names[k : k + 2])

    def parameters_at(self, point: Array) -> Array:
        """Return all parameters at a point, also those without uncertainty or range."""
        varied = np.asarray(self.varied, int)
        if self.distribution is not None:
            point = jnp.asarray(quantiles(point, self.values[varied], *self.distribution))
        return self.values.at[varied].set(point)

    def __call__(self, point: Array) -> Array:
        """Compute the answer at a point."""
        parameters = list(self.parameters_at(point))
        for k in self.widths:
            # Its numbers alone count: whether it is one-sided, the form says.
            block = block_of(dict(zip(_BY_SIDES, parameters[k : k + 4], strict=True)), False)
            parameters[k : k + 4] = jax.tree.leaves(block)
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
        _check_ranges(varied)
    varied = None if varied is None else tuple(map(as_text, varied))
    widths = _find_widths_of_blocks(at, paths, varied, argument, sides)
    names = _name_parameters(paths, widths)
    # A block has its sides as well, in place of half-width and slenderness.
    has_block = any(name.endswith(SHAPE[0]) for name in names)
    allowed = (*names, *SIDES) if has_block else names
    for name in varied or ():
        if name not in names:
            refuse_name(name, allowed, argument)
    numbers = [np.float64(leaf) for _, leaf in leaves]
    for k in widths:
        block = Block(*numbers[k : k + 4])
        block = jax.tree.unflatten(jax.tree.structure(block), numbers[k : k + 4])
        numbers[k : k + 4] = map(np.float64, size_of(block, "sides").values())
    values = jnp.asarray(np.array(numbers))
    places = tuple(map(names.index, names if varied is None else varied))
    return ParametricAnswer(answer, values, names, jax.tree.structure(at), places, widths)


def _check_ranges(ranges: Mapping[str, object]) -> None:
    """Raise `ValueError` if what is given for a name are not two numbers."""
    for name, value in ranges.items():
        # A unit would be lost: a name of a parameter does not tell its own.
        if carries_unit(value) or np.shape(as_real(name, value)) != (2,):
            raise ValueError(
                f"ranges of {name} must be two numbers without a unit, got {describe(value)}"
            )


def _name_parameters(paths: Sequence[KeyPath], widths: Sequence[int]) -> tuple[str, ...]:
    """Name the parameters, shortly where that is unique: "restitution" instead of its path."""
    full = [keystr(path, simple=True, separator=".") for path in paths]
    short = [keystr(path[-1:], simple=True) or "value" for path in paths]
    # Counted before: the sides of one block change no names of other numbers.
    unique = [short.count(name) == 1 for name in short]
    short_names = set(short)
    for k in widths:
        for place, side in zip((k, k + 1), SIDES, strict=True):
            before, dot, _ = full[place].rpartition(".")
            full[place] = before + dot + side
            short[place] = side
            unique[place] &= side not in short_names
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
    places = []
    for k in first:
        described = _name_parameters(paths, [k])[k : k + 2]
        asked = [name for name in varied if name in described and name not in names]
        if asked:
            shape = [name for name in varied if name in names[k : k + 2]]
            choose_description([_cut(name) for name in asked + shape], argument)
            places.append(k)
    return tuple(places)


def _cut(name: str) -> str:
    """Cut the path off a name."""
    return name.rpartition(".")[2]


def refuse_name(name: object, allowed: Iterable[str], argument: str) -> NoReturn:
    """Raise `ValueError` for a name that is not allowed; it suggests one that is similar."""
    allowed = list(dict.fromkeys(allowed))
    similar = difflib.get_close_matches(str(name), allowed, 1)
    hint = f"; did you mean {similar[0]!r}?" if similar else ""
    raise ValueError(f"{argument} has {name!r}, which is none of {', '.join(allowed)}{hint}")


def choose_description(names: Iterable[str], argument: str) -> SizeDescription:
    """Choose the description of a block that the names belong to, its shape if none does.

    Raises
    ------
    ValueError
        If some describe it by its sides, and others by half-width or slenderness.
    """
    names = list(names)
    sides = [name for name in names if name in SIDES]
    shape = [name for name in names if name in SHAPE]
    if sides and shape:
        raise ValueError(
            f"{argument} must have width and height, or half_width and slenderness, which are"
            f" the same two numbers; got {sides[0]} and {shape[0]}"
        )
    return "sides" if sides else "shape"


_IN_WORDS = {**SIZES_IN_WORDS, "scale": "factor on the motion"}


def describe_parameter(name: str) -> str:
    """Write a parameter in words, a size with what stays as it is where it is changed."""
    return _IN_WORDS.get(name, name.replace("_", " "))


def label_sides(names: Iterable[str], sides: Sequence[str]) -> list[str]:
    """Label the sides of a block in words, other parameters by their names."""
    return [SIZES_IN_WORDS.get(name, name) if name in sides else name for name in names]
