"""Reverse mode where JAX finds none: by a function of its own, or refused in one sentence."""

import functools
from collections.abc import Callable, Sequence
from typing import NoReturn, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.extend.core import Primitive
from jax.flatten_util import ravel_pytree
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array, PyTree

_T = TypeVar("_T")
_Pull = Callable[[list, Array], Array]

# The tangent of answers, its last operand. Cotangents do not go back to it, whose loops have no
# reverse mode, but by `pull` to the operand before, the tangent of the inputs. All operands
# before are the inputs.
_transposed_by = Primitive("transposed_by")


@eqx.filter_custom_jvp
def transpose_by(inputs: PyTree, answers: _T, *, pull: Callable[..., PyTree]) -> _T:
    """Return answers as they are, with reverse mode by a function.

    Parameters
    ----------
    inputs, answers : pytree
        Of arrays. The answers follow from the inputs under `jax.jit`, with derivatives in
        forward mode.
    pull : callable
        Of the inputs, and of cotangents of the real leaves of the answers, None for the other
        leaves. Returns cotangents of the inputs, None for leaves that are never perturbed.
    """
    del inputs, pull
    return answers


@transpose_by.def_jvp
def _give_tangents(
    primals: tuple[PyTree, _T], tangents: tuple[PyTree, PyTree], *, pull: Callable[..., PyTree]
) -> tuple[_T, PyTree]:
    inputs, answers = primals
    values, form = jax.tree.flatten(inputs)
    # Equinox writes None for the tangent of a leaf that is not perturbed.
    moves = jax.tree.map(lambda t: t is not None, tangents[0], is_leaf=lambda t: t is None)
    moved, _ = ravel_pytree(tangents[0])
    reals = eqx.filter(answers, eqx.is_inexact_array)
    slopes = jax.tree.map(
        lambda x, t: jnp.zeros_like(x) if t is None else t, reals, tangents[1]
    )
    slope, unravel = ravel_pytree(slopes)

    def pull_flat(values: list[Array], cotangent: Array) -> Array:
        pulled = pull(form.unflatten(values), unravel(cotangent))
        return ravel_pytree(eqx.filter(pulled, moves))[0]

    return answers, unravel(_transposed_by.bind(*values, moved, slope, pull=pull_flat))


def _transpose(
    cotangent: Array | ad.Zero, *operands: Array | ad.UndefinedPrimal, pull: _Pull
) -> list[Array | None]:
    none = [None] * len(operands[:-2])
    if isinstance(cotangent, ad.Zero):
        return [*none, None, None]
    return [*none, pull([*operands[:-2]], cotangent), None]


def _differentiate(
    operands: Sequence[Array], tangents: Sequence[Array | ad.Zero], pull: _Pull
) -> tuple[Array, Array]:
    # A second derivative goes through the loops themselves.
    tangent = refuse_reverse_mode("this derivative", ad.instantiate_zeros(tangents[-1]))
    return _transposed_by.bind(*operands, pull=pull), tangent


def _batch(
    operands: Sequence[Array], axes: Sequence[int | None], pull: _Pull
) -> tuple[Array, int]:
    *values, moved, slope = operands
    *value_axes, moved_axis, slope_axis = axes
    count = next(x.shape[a] for x, a in zip(operands, axes, strict=True) if a is not None)
    moved = batching.bdim_at_front(moved, moved_axis, count)
    slope = batching.bdim_at_front(slope, slope_axis, count)
    pull = jax.vmap(pull, in_axes=(value_axes, 0))
    return _transposed_by.bind(*values, moved, slope, pull=pull), 0


_transposed_by.def_impl(lambda *operands, pull: operands[-1])
_transposed_by.def_abstract_eval(lambda *operands, pull: operands[-1])
ad.primitive_jvps[_transposed_by] = _differentiate
ad.primitive_transposes[_transposed_by] = _transpose
batching.primitive_batchers[_transposed_by] = _batch
mlir.register_lowering(_transposed_by, lambda _, *operands, pull: [operands[-1]])


def refuse_reverse_mode(name: str, tree: _T) -> _T:
    """Return a pytree of traced arrays as it is; reverse mode through it is a `ValueError`.

    Parameters
    ----------
    name : str
        The function whose answer it is, or what it is, for the message.
    tree : pytree
        Leaves that are no floating-point numbers have no derivatives, and stay as they are.
    """
    refuse = functools.partial(_refuse, name)
    # Leaf by leaf: together they would be written into one array.
    return jax.tree.map(lambda leaf: transpose_by((), leaf, pull=refuse), tree)


def _refuse(name: str, *_: object) -> NoReturn:
    raise ValueError(
        f"{name} has derivatives in forward mode only: use jax.jacfwd or jax.jvp instead of"
        " jax.grad, jax.vjp or jax.jacrev"
    )
