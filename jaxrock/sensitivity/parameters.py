"""Parameters of an answer by name: paths of a pytree, and sizes of the blocks in it."""

import difflib
import itertools
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

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
    values : OrderedDict of ndarray
        By the last step of a path where that is unique, else by the whole path.
    form, described : PyTreeDef
        The pytree, and the same with a dictionary of its sizes in place of each block.
    """

    values: OrderedDict[str, AnyArray | np.floating]
    form: Any = eqx.field(static=True)
    described: Any = eqx.field(static=True)

    def build(self, changes: Mapping[str, AnyArray]) -> Any:
        """Build the pytree with other values of some parameters; a `ValueError` out of range."""
        return jax.tree.map(
            lambda node, part: block_of(part, node.one_sided) if _is_block(node) else part,
            jax.tree.unflatten(self.form, self.values.values()),
            jax.tree.unflatten(self.described, {**self.values, **changes}.values()),
            is_leaf=_is_block,
        )

    def get_values(self, names: Iterable[str]) -> np.ndarray:
        """Return the values of some parameters, shape (names,); `ValueError` if one is an array."""
        arrays = [name for name, value in self.values.items() if np.ndim(value)]
        if arrays:
            raise ValueError(f"{' and '.join(arrays)} must be single numbers, got arrays")
        return np.array([self.values[name] for name in names], float)


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
    sizes = {name.rpartition(".")[2] for name in names or ()}
    for description, pair in SIZE_NAMES.items():
        by = description if sizes & {*pair} else by
    described = jax.tree.map(
        lambda node: OrderedDict(size_of(node, by)) if _is_block(node) else node,
        at,
        is_leaf=_is_block,
    )
    leaves, form = jax.tree.flatten_with_path(described)
    short = [keystr(path[-1:], simple=True) or "value" for path, _ in leaves]
    values = OrderedDict(
        (name if short.count(name) == 1 else keystr(path, simple=True, separator="."), leaf)
        for name, (path, leaf) in zip(short, leaves, strict=True)
    )
    for name in names or ():
        if name not in values:
            others = {*values, *itertools.chain(*SIZE_NAMES.values())} - {name}
            similar = difflib.get_close_matches(name, others, 1)
            hint = f"; did you mean {similar[0]!r}?" if similar else ""
            raise ValueError(
                f"{argument} has {name!r}, which is none of {', '.join(values)}{hint}"
            )
    return Parameters(values, jax.tree.structure(at), form)


def _is_block(node: object) -> bool:
    return isinstance(node, Block)


def evaluate(
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
    phrases = {**SIZES_IN_WORDS, "factor": "factor on the motion"}
    return phrases.get(name, name.replace("_", " "))
