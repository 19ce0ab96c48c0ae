"""Parameters of an answer by name: paths of a pytree, and sizes of the blocks in it."""

import difflib
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NoReturn

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import keystr
from jaxtyping import Array, PyTree

from ..block import SIZE_NAMES, SIZES_IN_WORDS, Block, SizeDescription, block_of, size_of
from ..validation import AnyArray, Number, check_concrete

Answer = Callable[..., Number]  # a function of a pytree of numbers


class Parameters(eqx.Module):
    """The numbers of a pytree by name, each block described by two sizes.

    Attributes
    ----------
    names : tuple of str
        The last step of a path where that is unique, else the whole path.
    values : list of ndarray
    form, described : PyTreeDef
        The pytree, and the same with a dictionary of its sizes in place of each block.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    values: list[AnyArray | np.floating]
    form: Any = eqx.field(static=True)
    described: Any = eqx.field(static=True)

    def build(self, changes: Mapping[str, AnyArray]) -> Any:
        """Build the pytree with other values of some parameters; a `ValueError` out of range."""
        values = [changes.get(*pair) for pair in zip(self.names, self.values, strict=True)]
        return jax.tree.map(
            lambda node, part: block_of(part, node.one_sided) if _is_block(node) else part,
            jax.tree.unflatten(self.form, self.values),
            jax.tree.unflatten(self.described, values),
            is_leaf=_is_block,
        )

    def get_values(self, names: Iterable[str]) -> np.ndarray:
        """Return the values of some parameters, shape (names,); `ValueError` if one is an array."""
        arrays = [
            pair[0] for pair in zip(self.names, self.values, strict=True) if pair[1].ndim
        ]
        if arrays:
            raise ValueError(f"{' and '.join(arrays)} must be single numbers, got arrays")
        return np.array([self.values[self.names.index(name)] for name in names], float)


def name_parameters(
    at: PyTree, names: Iterable[str] | None, argument: str, by: SizeDescription = "shape"
) -> Parameters:
    """Name the parameters of a pytree.

    Parameters
    ----------
    at : pytree of numbers or arrays
    names : iterable of str, optional
        Parameters that are varied. Blocks are described by the sizes among them.
    argument : str
        The argument that has the names, for messages.
    by : {"shape", "sides", "dynamics"}
        How blocks are described if no names are given.

    Raises
    ------
    ValueError
        If a name is unknown, or sizes belong to several descriptions.
    """
    check_concrete(at, "jax.value_and_grad works under jit")
    at = jax.tree.map(lambda leaf: np.asarray(leaf, float), at)
    if names is not None:
        by = _choose_description(names, argument)
    described = _describe_blocks(at, by)
    known = _name_leaves(described)
    values, form = jax.tree.flatten(described)
    for name in names or ():
        if name not in known:
            sizes = [size for pair in SIZE_NAMES.values() for size in pair]
            refuse_name(name, (*known, *sizes), argument)
    return Parameters(known, values, jax.tree.structure(at), form)


def _is_block(node: object) -> bool:
    return isinstance(node, Block)


def _describe_blocks(at: PyTree, by: SizeDescription) -> PyTree:
    """Replace each block by a dictionary of its parameters, in the order of `size_of`."""
    return jax.tree.map(
        lambda node: OrderedDict(size_of(node, by)) if _is_block(node) else node,
        at,
        is_leaf=_is_block,
    )


def _name_leaves(tree: PyTree) -> tuple[str, ...]:
    """Name the leaves, by their last step where it is unique: "restitution", not its path."""
    paths = [path for path, _ in jax.tree.leaves_with_path(tree)]
    short = [keystr(path[-1:], simple=True) or "value" for path in paths]
    return tuple(
        name if short.count(name) == 1 else keystr(path, simple=True, separator=".")
        for name, path in zip(short, paths, strict=True)
    )


def refuse_name(name: object, allowed: Iterable[str], argument: str) -> NoReturn:
    """Raise `ValueError` for a name that is not allowed; it suggests one that is similar."""
    allowed = list(dict.fromkeys(allowed))
    similar = difflib.get_close_matches(str(name), allowed, 1)
    hint = f"; did you mean {similar[0]!r}?" if similar else ""
    raise ValueError(f"{argument} has {name!r}, which is none of {', '.join(allowed)}{hint}")


def _choose_description(names: Iterable[str], argument: str) -> SizeDescription:
    """Choose the description of a block that the names belong to, its shape if none does.

    Raises
    ------
    ValueError
        If the names belong to several descriptions.
    """
    sizes = [name.rpartition(".")[2] for name in names]
    named: dict[SizeDescription, str]
    named = {by: name for by, pair in SIZE_NAMES.items() for name in sizes if name in pair}
    if len(named) > 1:
        pairs = ", or ".join(" and ".join(pair) for pair in SIZE_NAMES.values())
        raise ValueError(
            f"{argument} must describe the size by {pairs}, got {' and '.join(named.values())}"
        )
    return next(iter(named), "shape")


def evaluate_answer(
    answer: Answer,
    parameters: Parameters,
    names: Sequence[str],
    points: np.ndarray,
    order: int = 0,
) -> list[np.ndarray]:
    """Compute an answer, and its gradient and Hessian up to an order.

    Parameters
    ----------
    answer, parameters : callable, Parameters
    names : sequence of str
        The parameters that vary.
    points : ndarray, shape (..., names)
        Their values.
    order : {0, 1, 2}

    Returns
    -------
    list of ndarray, shape (...), (..., names), (..., names, names)
    """
    flat = points.reshape(-1, len(names))
    results = _evaluate(answer, parameters, tuple(names), flat, order)
    return [np.asarray(part).reshape(points.shape[:-1] + part.shape[1:]) for part in results]


@eqx.filter_jit
def _evaluate(
    answer: Answer,
    parameters: Parameters,
    names: tuple[str, ...],
    points: Any,
    order: int,
) -> list[Array]:
    """Compute value, gradient and Hessian up to an order in one program."""

    def compute(point: Array) -> Array:
        changes = dict(zip(names, point, strict=True))
        value = jnp.asarray(answer(parameters.build(changes)))
        if value.ndim:
            raise ValueError(f"answer must be one number, got an array of shape {value.shape}")
        return value

    # Forward mode is used, since parameters are few, and some answers, such as the results of
    # a search, have no other derivatives.
    gradient = jax.jacfwd(compute)
    functions = (compute, gradient, jax.jacfwd(gradient))[: order + 1]

    return jax.vmap(lambda point: [function(point) for function in functions])(points)


def describe_parameter(name: str) -> str:
    """Write a parameter in words, a size with the size that stays fixed."""
    return SIZES_IN_WORDS.get(name, name.replace("_", " "))
