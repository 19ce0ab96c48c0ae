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
    SIZE_NAMES,
    SIZES_IN_WORDS,
    Block,
    SizeDescription,
    block_of,
    size_of,
)
from ..validation import (
    Number,
    as_real,
    carries_unit,
    check_concrete,
    check_kind,
    describe,
)
from .distributions import quantiles

Answer = Callable[..., Number]  # of a pytree of numbers
Ranges = Mapping[str, tuple[float, float]]

# The parameters of a block as `size_of` lists them, behind the two of its size.
_WITH_SIZE = ("gravity", "inertia_ratio")
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
    # Of blocks that are not described by their shape: the place of their first parameter.
    descriptions: tuple[tuple[int, SizeDescription], ...] = eqx.field(static=True, default=())
    distribution: tuple[Array, Array] | None = None  # widths and bounds, by `find_widths`
    factor: Array | None = None  # of correlations, by `factor_correlations`

    def get_size_names(self, by: SizeDescription) -> tuple[str, ...]:
        """Return the names of the sizes of all blocks that are described in one way."""
        places = [k for k, description in self.descriptions if description == by]
        return tuple(name for k in places for name in self.names[k : k + 2])

    def parameters_at(self, point: Array) -> Array:
        """Return all parameters at a point, also those without uncertainty or range."""
        varied = np.asarray(self.varied, int)
        if self.factor is not None:
            point = self.factor @ point
        if self.distribution is not None:
            point = jnp.asarray(quantiles(point, self.values[varied], *self.distribution))
        return self.values.at[varied].set(point)

    def __call__(self, point: Array) -> Array:
        """Compute the answer at a point."""
        parameters = list(self.parameters_at(point))
        for k, by in self.descriptions:
            names = (*SIZE_NAMES[by], *_WITH_SIZE)
            # Its numbers alone count: whether it is one-sided, the form says.
            block = block_of(dict(zip(names, parameters[k : k + 4], strict=True)), False)
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

    A block in `at` is described by the two sizes that are named, else by its shape, or all
    blocks are by their `sides`.
    """
    check_kind("answer", answer, Callable)
    check_concrete(
        at, "the answer is described by plain numbers; jax.value_and_grad works under jit"
    )
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
        check_ranges(varied)
    varied = None if varied is None else tuple(varied)
    descriptions = _find_descriptions(at, paths, varied, argument, sides)
    names = _name_parameters(paths, descriptions)
    # A block has other sizes as well, in place of half-width and slenderness.
    has_block = any(name.endswith(SHAPE[0]) for name in names)
    sizes = [size for by in SIZE_NAMES.values() for size in by if size not in SHAPE]
    allowed = (*names, *sizes) if has_block else names
    for name in varied or ():
        if name not in names:
            refuse_name(name, allowed, argument)
    numbers = [np.float64(leaf) for _, leaf in leaves]
    for k, by in descriptions:
        block = Block(*numbers[k : k + 4])
        block = jax.tree.unflatten(jax.tree.structure(block), numbers[k : k + 4])
        numbers[k : k + 4] = map(np.float64, size_of(block, by).values())
    values = jnp.asarray(np.array(numbers))
    places = tuple(map(names.index, names if varied is None else varied))
    form = jax.tree.structure(at)
    return ParametricAnswer(answer, values, names, form, places, descriptions)


def check_ranges(ranges: Mapping[str, object]) -> None:
    """Raise `ValueError` if no name is given, or what is given for one are not two numbers."""
    if not ranges:
        raise ValueError("ranges must not be empty: they name the parameters to vary")
    for name, value in ranges.items():
        # A unit would be lost: a name of a parameter does not tell its own.
        if carries_unit(value) or np.shape(as_real(name, value)) != (2,):
            raise ValueError(
                f"ranges of {name} must be two numbers without a unit, got {describe(value)}"
            )


def _name_parameters(
    paths: Sequence[KeyPath], descriptions: Sequence[tuple[int, SizeDescription]]
) -> tuple[str, ...]:
    """Name the parameters, shortly where that is unique: "restitution" instead of its path."""
    full = [keystr(path, simple=True, separator=".") for path in paths]
    short = [keystr(path[-1:], simple=True) or "value" for path in paths]
    # Counted before: the sizes of one block change no names of other numbers.
    unique = [short.count(name) == 1 for name in short]
    short_names = set(short)
    for k, by in descriptions:
        for place, size in zip((k, k + 1), SIZE_NAMES[by], strict=True):
            before, dot, _ = full[place].rpartition(".")
            full[place] = before + dot + size
            short[place] = size
            unique[place] &= size not in short_names
    return tuple(
        name if alone else path for name, path, alone in zip(short, full, unique, strict=True)
    )


def _find_descriptions(
    at: PyTree,
    paths: Sequence[KeyPath],
    varied: Sequence[str] | None,
    argument: str,
    sides: bool,
) -> tuple[tuple[int, SizeDescription], ...]:
    """Find the places and descriptions of blocks that are not described by their shape."""
    nodes = jax.tree.leaves_with_path(at, is_leaf=lambda node: isinstance(node, Block))
    blocks = [path for path, node in nodes if isinstance(node, Block)]
    first = [
        next(k for k, path in enumerate(paths) if path[: len(block)] == block)
        for block in blocks
    ]
    if varied is None:
        return tuple((k, "sides") for k in first) if sides else ()
    # The names as they are come first: a dictionary may have a number called width.
    names = _name_parameters(paths, ())
    descriptions = list[tuple[int, SizeDescription]]()
    for k in first:
        sizes = set(names[k : k + 2])
        for by in SIZE_NAMES:
            sizes |= set(_name_parameters(paths, [(k, by)])[k : k + 2]) - set(names)
        chosen = choose_description((_cut(name) for name in varied if name in sizes), argument)
        if chosen != "shape":
            descriptions.append((k, chosen))
    return tuple(descriptions)


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
        If the names belong to several descriptions.
    """
    names = list(names)
    named: dict[SizeDescription, str] = {}
    for by, sizes in SIZE_NAMES.items():
        for name in names:
            if name in sizes:
                named.setdefault(by, name)
    if len(named) > 1:
        pairs = ", or ".join(" and ".join(sizes) for sizes in SIZE_NAMES.values())
        raise ValueError(
            f"{argument} must describe the size by {pairs}, got {' and '.join(named.values())}"
        )
    return next(iter(named)) if named else "shape"


_IN_WORDS = {**SIZES_IN_WORDS, "scale": "factor on the motion"}


def describe_parameter(name: str) -> str:
    """Write a parameter in words, a size with what stays as it is where it is changed."""
    return _IN_WORDS.get(name, name.replace("_", " "))


def label_sides(names: Iterable[str], sides: Sequence[str]) -> list[str]:
    """Label the sides of a block in words, other parameters by their names."""
    return [SIZES_IN_WORDS.get(name, name) if name in sides else name for name in names]
