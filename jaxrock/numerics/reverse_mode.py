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
_Leaves = list[Array]

# The tangents of answers. Cotangents do not go back to them, since their loops have no reverse
# mode, but by `pull` to the tangents of the inputs. The operands are the inputs, as many of their
# tangents as `sizes` says, and the tangents of the answers.
_transposed_by = Primitive("transposed_by")
_transposed_by.multiple_results = True


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
    moved = jax.tree.leaves(tangents[0])
    reals = eqx.filter(answers, eqx.is_inexact_array)
    slopes = jax.tree.map(
        lambda x, t: jnp.zeros_like(x) if t is None else t, reals, tangents[1]
    )
    slopes, answer_form = jax.tree.flatten(slopes)

    def pull_leaves(values: _Leaves, cotangents: _Leaves) -> _Leaves:
        pulled = pull(form.unflatten(values), answer_form.unflatten(cotangents))
        return jax.tree.leaves(eqx.filter(pulled, moves))

    sizes = len(values), len(moved)
    slopes = _transposed_by.bind(*values, *moved, *slopes, pull=pull_leaves, sizes=sizes)
    return answers, answer_form.unflatten(slopes)


def _get_slopes(*operands: Array, sizes: tuple[int, int], **_: object) -> _Leaves:
    return list(operands[sum(sizes) :])


def _transpose(
    cotangents: list, *operands: Array, pull: Callable, sizes: tuple[int, int]
) -> list:
    known, moved = sizes
    if all(isinstance(cotangent, ad.Zero) for cotangent in cotangents):
        return [None] * len(operands)
    cotangents = [ad.instantiate_zeros(cotangent) for cotangent in cotangents]
    return [None] * known + pull([*operands[:known]], cotangents) + [None] * len(cotangents)


def _differentiate(operands: _Leaves, tangents: list, **options: tuple) -> tuple[list, list]:
    # A second derivative goes through the loops themselves.
    slopes = _transposed_by.bind(*operands, **options)
    tangents = map(ad.instantiate_zeros, tangents[sum(options["sizes"]) :])
    return slopes, refuse_reverse_mode("this derivative", list(tangents))


def _batch(
    operands: _Leaves, axes: list[int | None], *, pull: Callable, sizes: tuple[int, int]
) -> tuple[_Leaves, list[int]]:
    known = sizes[0]
    count = next(x.shape[a] for x, a in zip(operands, axes, strict=True) if a is not None)
    moved = [
        batching.bdim_at_front(x, axis, count)
        for x, axis in zip(operands[known:], axes[known:], strict=True)
    ]
    pull = jax.vmap(pull, in_axes=(list(axes[:known]), 0))
    slopes = _transposed_by.bind(*operands[:known], *moved, pull=pull, sizes=sizes)
    return slopes, [0] * len(slopes)


_transposed_by.def_impl(_get_slopes)
_transposed_by.def_abstract_eval(_get_slopes)
ad.primitive_jvps[_transposed_by] = _differentiate
ad.primitive_transposes[_transposed_by] = _transpose
batching.primitive_batchers[_transposed_by] = _batch
mlir.register_lowering(
    _transposed_by, lambda _, *values, **sizes: _get_slopes(*values, **sizes)
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
    return transpose_by((), tree, pull=functools.partial(_refuse, name))


def _refuse(name: str, *_: object) -> NoReturn:
    raise ValueError(
        f"{name} has derivatives in forward mode only: use jax.jacfwd or jax.jvp instead of"
        " jax.grad, jax.vjp or jax.jacrev"
    )
