"""Reverse mode where JAX finds none: by a function of its own, or refused in one sentence."""

import functools
from collections.abc import Callable
from typing import NoReturn, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array, PyTree

_T = TypeVar("_T")
_Pull = Callable[[list[Array], list[Array]], list[Array]]

# Tangents of answers as they are. Cotangents do not go back to them, whose loops have no reverse
# mode, but by `pull` to the tangents of the inputs. The operands are `sizes[0]` values of the
# inputs, `sizes[1]` tangents of the inputs, and the tangents of the answers.
_transposed_by = Primitive("transposed_by")
_transposed_by.multiple_results = True


def transpose_by(pull: Callable[[PyTree, PyTree], PyTree], inputs: PyTree, answers: _T) -> _T:
    """Return answers as they are, with another reverse mode.

    Parameters
    ----------
    pull : callable
        Of the inputs and the cotangents of the answers, None for an answer that has no
        derivative. Returns the cotangents of the inputs.
    inputs, answers : pytree
        `answers` have been computed from `inputs`, under `jax.jit`, with derivatives in forward
        mode.
    """
    return _transpose_by(inputs, answers, pull=pull)


@eqx.filter_custom_jvp
def _transpose_by(inputs: PyTree, answers: _T, *, pull: Callable) -> _T:
    del inputs, pull
    return answers


@_transpose_by.def_jvp
def _move_answers(
    primals: tuple[PyTree, _T], tangents: tuple[PyTree, PyTree], *, pull: Callable
) -> tuple[_T, PyTree]:
    inputs, answers = primals
    values, form = jax.tree.flatten(inputs)
    # Equinox writes None for the tangent of a leaf that is not perturbed.
    moves = [tangent is not None for tangent in jax.tree.leaves(tangents[0], is_leaf=_is_none)]
    real = eqx.filter(answers, eqx.is_inexact_array)
    full = jax.tree.map(lambda x, t: jnp.zeros_like(x) if t is None else t, real, tangents[1])
    slopes, answer_form = jax.tree.flatten(full)

    def pull_leaves(values: list[Array], cotangents: list[Array]) -> list[Array]:
        pulled = pull(form.unflatten(values), answer_form.unflatten(cotangents))
        leaves = jax.tree.leaves(pulled, is_leaf=_is_none)
        return [leaf for leaf, moved in zip(leaves, moves, strict=True) if moved]

    moved = jax.tree.leaves(tangents[0])
    sizes = len(values), len(moved)
    slopes = _transposed_by.bind(*values, *moved, *slopes, pull=pull_leaves, sizes=sizes)
    return answers, answer_form.unflatten(slopes)


def _is_none(leaf: object) -> bool:
    return leaf is None


def _get_slopes(*operands: Array, sizes: tuple[int, int], **_: object) -> list[Array]:
    return list(operands[sum(sizes) :])


def _transpose(
    cotangents: list, *operands: object, pull: _Pull, sizes: tuple[int, int]
) -> list:
    known, moved = sizes
    pulled = [None] * moved
    if not all(isinstance(cotangent, ad.Zero) for cotangent in cotangents):
        pulled = pull(list(operands[:known]), [ad.instantiate_zeros(c) for c in cotangents])
    ours = zip(pulled, operands[known:], strict=False)
    pulled = [part if ad.is_undefined_primal(operand) else None for part, operand in ours]
    return [None] * known + pulled + [None] * len(cotangents)


def _differentiate(
    operands: list[Array], tangents: list, *, sizes: tuple[int, int], **options: object
) -> tuple[list[Array], list]:
    # A second derivative goes through the loops themselves.
    slopes = _transposed_by.bind(*operands, sizes=sizes, **options)
    tangents = [
        tangent
        if isinstance(tangent, ad.Zero)
        else refuse_reverse_mode("this derivative", tangent)
        for tangent in tangents[sum(sizes) :]
    ]
    return slopes, tangents


def _batch(
    operands: list[Array], axes: list[int | None], *, pull: _Pull, sizes: tuple[int, int]
) -> tuple[list[Array], list[int]]:
    pairs = list(zip(operands, axes, strict=True))
    count = next(x.shape[axis] for x, axis in pairs if axis is not None)
    known = sizes[0]
    # Each element has tangents of its own, but not values.
    moved = [
        jnp.broadcast_to(x, (count, *x.shape)) if axis is None else jnp.moveaxis(x, axis, 0)
        for x, axis in pairs[known:]
    ]
    pull = jax.vmap(pull, in_axes=(list(axes[:known]), 0))
    slopes = _transposed_by.bind(*operands[:known], *moved, pull=pull, sizes=sizes)
    return slopes, [0] * len(slopes)


_transposed_by.def_impl(_get_slopes)
_transposed_by.def_abstract_eval(_get_slopes)
ad.primitive_transposes[_transposed_by] = _transpose
ad.primitive_jvps[_transposed_by] = _differentiate
batching.primitive_batchers[_transposed_by] = _batch
mlir.register_lowering(
    _transposed_by, lambda _, *operands, **rest: _get_slopes(*operands, **rest)
)


def refuse_reverse_mode(name: str, tree: _T) -> _T:
    """Return a pytree of traced arrays as it is; reverse mode through it is a `ValueError`.

    Parameters
    ----------
    name : str
        The function whose answer it is, or what it is, for the message.
    tree : pytree
        Leaves that are no floating-point numbers have no derivatives, and stay as they are.
    """
    return transpose_by(functools.partial(_refuse, name), (), tree)


def _refuse(name: str, *_: object) -> NoReturn:
    raise ValueError(
        f"{name} has derivatives in forward mode only: use jax.jacfwd or jax.jvp instead of"
        " jax.grad, jax.vjp or jax.jacrev"
    )
