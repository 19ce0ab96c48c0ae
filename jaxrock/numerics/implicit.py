"""Derivatives in both modes of what has only a forward-mode one: a loop of unknown length.

The Jacobian with respect to whatever is perturbed is computed forward, once, and then applied: a
linear map, which both modes can use.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree


def through_jacobian(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function with derivatives in both modes with respect to its positional arguments.

    They cost one forward derivative per perturbed number.
    """
    wrapped = eqx.filter_custom_jvp(function)

    @wrapped.def_jvp
    def _(primals: Any, tangents: Any, **options: Any) -> tuple[Any, Any]:
        perturbed = jax.tree.map(lambda t: t is not None, tangents, is_leaf=lambda t: t is None)
        moving, fixed = eqx.partition(primals, perturbed)
        numbers, unravel = ravel_pytree(moving)
        direction, _ = ravel_pytree(tangents)

        def run(numbers: Any) -> Any:
            result = function(*eqx.combine(unravel(numbers), fixed), **options)
            return eqx.partition(result, eqx.is_inexact_array)

        def along(basis: Any) -> Any:
            return jax.jvp(run, (numbers,), (basis,), has_aux=True)

        if numbers.size == 1:  # without `vmap`, a program that is a third smaller
            values, slopes, static = along(jnp.ones_like(numbers))
            jacobian = jax.tree.map(lambda slope: slope[None], slopes)
        else:
            eye = jnp.eye(numbers.size, dtype=numbers.dtype)
            values, jacobian, static = jax.vmap(along, out_axes=(None, 0, None))(eye)
        applied = jax.tree.map(lambda slopes: jnp.tensordot(direction, slopes, axes=1), jacobian)
        return eqx.combine(values, static), applied

    return wrapped
