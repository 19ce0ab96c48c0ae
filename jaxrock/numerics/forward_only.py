"""Answers whose derivatives exist in forward mode only, and the sentence about the other."""

from typing import NoReturn, TypeVar

import jax
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

_T = TypeVar("_T")

# The identity. JAX says of a loop without a known number of steps that it has no derivative in
# reverse mode, in words about loops. Behind this the cotangents arrive here first.
_forward_only = Primitive("forward_only")


def _refuse_reverse(*_: object, name: str) -> NoReturn:
    raise ValueError(
        f"{name} has derivatives in forward mode only: use jax.jacfwd or jax.jvp instead of"
        " jax.grad, jax.vjp or jax.jacrev"
    )


_forward_only.def_impl(lambda value, **_: value)
_forward_only.def_abstract_eval(lambda value, **_: value)
ad.deflinear2(_forward_only, _refuse_reverse)
batching.defvectorized(_forward_only)
mlir.register_lowering(_forward_only, lambda _, value, **__: [value])


def refuse_reverse_mode(name: str, tree: _T) -> _T:
    """Return a pytree of traced arrays as it is; reverse mode through it is a `ValueError`.

    Parameters
    ----------
    name : str
        The function whose answer it is, or what it is, for the message.
    tree : pytree
        Leaves that are no floating-point numbers have no derivatives, and stay as they are.
    """

    def wrap(leaf: jax.Array) -> jax.Array:
        is_real = jax.numpy.issubdtype(leaf.dtype, jax.numpy.floating)
        return _forward_only.bind(leaf, name=name) if is_real else leaf

    return jax.tree.map(wrap, tree)
