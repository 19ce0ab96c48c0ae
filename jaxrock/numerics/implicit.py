"""Derivatives in both modes of what only runs forward: a loop of unknown length."""

from collections.abc import Callable
from typing import NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, PyTree

from ..validation import Booleans, Reals
from .reverse_mode import refuse_reverse_mode

_R = TypeVar("_R")
_COLUMNS = 64  # of a Jacobian, for one array


def differentiate_by_jacobian(
    function: Callable[..., _R], for_arrays: Callable[..., _R] | None = None
) -> Callable[..., _R]:
    """Give a function derivatives in both modes with respect to its positional arguments.

    The Jacobian is computed forward, once, at the cost of one forward derivative per perturbed
    number, and then applied: a linear map, which both modes can use. A derivative of that
    exists in forward mode only. Options, by keyword, have no derivatives.

    `for_arrays` is the same function with derivatives of its own. They count instead where an
    array of more than 64 numbers is perturbed: a Jacobian would have too many columns.
    """
    wrapped = eqx.filter_custom_jvp(function)

    @wrapped.def_jvp
    def apply_jacobian(
        primals: PyTree, tangents: PyTree, **options: object
    ) -> tuple[PyTree, PyTree]:
        largest = max(tangent.size for tangent in jax.tree.leaves(tangents))
        if for_arrays and largest > _COLUMNS:
            return eqx.filter_jvp(for_arrays, primals, tangents, **options)
        # Equinox writes None for the tangent of a leaf that is not perturbed.
        moves = jax.tree.map(lambda t: t is not None, tangents, is_leaf=lambda t: t is None)
        moving, fixed = eqx.partition(primals, moves)
        numbers, unravel = ravel_pytree(moving)
        direction, _ = ravel_pytree(tangents)

        def compute(numbers: Array) -> tuple[PyTree, PyTree]:
            """Compute the answer, its real arrays apart from the rest."""
            result = function(*eqx.combine(unravel(numbers), fixed), **options)
            return eqx.partition(result, eqx.is_inexact_array)

        def differentiate_along(basis: Array) -> tuple[PyTree, PyTree, PyTree]:
            return jax.jvp(compute, (numbers,), (basis,), has_aux=True)

        if numbers.size == 1:  # without `vmap`, a program that is a third smaller
            values, slopes, static = differentiate_along(jnp.ones_like(numbers))
            jacobian = jax.tree.map(lambda slope: slope[None], slopes)
        else:
            along_each = jax.vmap(differentiate_along, out_axes=(None, 0, None))
            values, jacobian, static = along_each(jnp.eye(numbers.size, dtype=numbers.dtype))
        # A second derivative goes through the loops themselves.
        values, jacobian = refuse_reverse_mode("this derivative", (values, jacobian))
        # The directions enter here only, linearly: that is what reverse mode transposes.
        applied = jax.tree.map(lambda slope: jnp.tensordot(direction, slope, axes=1), jacobian)
        return eqx.combine(values, static), applied

    return wrapped


class Root(NamedTuple):
    """A root and further values there; all are 0 where there is no root."""

    root: Reals
    values: tuple[Reals, ...]
    exists: Booleans
    flags: tuple[Array, ...]  # without derivatives


def differentiate_implicitly(
    search: Callable[..., Root], residual: Callable[..., tuple[PyTree, ...]]
) -> Callable[..., Root]:
    """Give the search for a root of a scene derivatives by the implicit function theorem.

    Parameters
    ----------
    search : callable
        Of the scene; it is not differentiated itself.
    residual : callable
        Of the scene and the root. Returns a number that is 0 at the root, then the further
        values of the `Root`, then anything.

    Returns
    -------
    callable
        As `search`, with derivatives in both modes.
    """
    find_root = eqx.filter_custom_jvp(search)

    @find_root.def_jvp
    def move_root(
        primals: PyTree, tangents: PyTree, **options: object
    ) -> tuple[PyTree, PyTree]:
        solution = find_root(*primals, **options)

        def evaluate(scene: PyTree, root: Reals) -> tuple[PyTree, ...]:
            return residual(scene, root, **options)[:2]

        def differentiate_along(*direction: PyTree) -> PyTree:
            return eqx.filter_jvp(evaluate, (*primals, solution.root), direction)[1]

        # Along the scene at this root, and along the root alone: one program for both.
        both = jax.tree.map(lambda t: jnp.stack([t, jnp.zeros_like(t)]), tangents[0])
        change, values = jax.vmap(differentiate_along)(
            both, jnp.array([0, 1], solution.root.dtype)
        )
        # Where there is no root the slope may be 0, and the quotient NaN.
        move = -change[0] / jnp.where(solution.exists, change[1], 1)
        total = (move, tuple(slope[0] + slope[1] * move for slope in values))
        root, values = jax.tree.map(lambda t: jnp.where(solution.exists, t, 0), total)
        nothing = jax.tree.map(lambda leaf: None, solution)
        return solution, nothing._replace(root=root, values=values)

    return differentiate_by_jacobian(find_root)
