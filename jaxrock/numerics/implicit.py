"""Derivatives in both modes of what only runs forward: a loop of unknown length."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree

from ..validation import Booleans, Reals


def through_jacobian(function: Callable[..., Any]) -> Callable[..., Any]:
    """Give a function derivatives in both modes with respect to its positional arguments.

    The Jacobian is computed forward, once, at the cost of one forward derivative per perturbed
    number, and then applied: a linear map, which both modes can use.
    """
    wrapped = eqx.filter_custom_jvp(function)

    @wrapped.def_jvp
    def _(primals: Any, tangents: Any, **options: Any) -> tuple[Any, Any]:
        perturbed = jax.tree.map(
            lambda t: t is not None, tangents, is_leaf=lambda t: t is None
        )
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
        applied = jax.tree.map(
            lambda slopes: jnp.tensordot(direction, slopes, axes=1), jacobian
        )
        return eqx.combine(values, static), applied

    return wrapped


class Root(NamedTuple):
    """A root and further values there: 0 where there is none."""

    root: Reals
    values: tuple[Reals, ...]
    exists: Booleans
    flags: Any  # without derivatives


def through_residual(
    search: Callable[..., Root], residual: Callable[..., Any]
) -> Callable[..., Root]:
    """`search` of a scene, differentiated by the implicit function theorem.

    `residual`, of the scene and the root, returns what is 0 there, and the further values.
    """
    root_of = eqx.filter_custom_jvp(search)

    @root_of.def_jvp
    def _(primals: Any, tangents: Any, **options: Any) -> Any:
        found = root_of(*primals, **options)

        def at(scene: Any, root: Reals) -> Any:
            return residual(scene, root, **options)[:2]

        def along(*direction: Any) -> Any:
            return eqx.filter_jvp(at, (*primals, found.root), direction)[1]

        # Along the scene at this root, and along the root alone: one program for both.
        both = jax.tree.map(lambda t: jnp.stack([t, jnp.zeros_like(t)]), tangents[0])
        change, values = jax.vmap(along)(both, jnp.array([0, 1], found.root.dtype))
        move = -change[0] / jnp.where(found.exists, change[1], 1)
        total = (move, tuple(slope[0] + slope[1] * move for slope in values))
        root, values = jax.tree.map(lambda t: jnp.where(found.exists, t, 0), total)
        nothing = jax.tree.map(lambda leaf: None, found)
        return found, nothing._replace(root=root, values=values)

    return through_jacobian(root_of)
