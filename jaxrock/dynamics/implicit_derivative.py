"""Derivatives of a root that a search finds: by the implicit function theorem."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from ..numerics import through_jacobian
from ..resonance import RockingModel
from ..validation import Booleans, Reals


class Root(NamedTuple):
    """A root and further values there: 0 where there is none."""

    root: Reals
    values: tuple[Reals, ...]
    exists: Booleans
    flags: Any  # without derivatives


def with_implicit_derivatives(
    search: Callable[..., Root], residual: Callable[..., Any]
) -> Callable[..., Root]:
    """`search`, with the derivatives of the root of `residual`, which it finds.

    `residual` returns what is 0 at the root, and the further values there.
    """

    @eqx.filter_custom_jvp
    def root_of(scene: Any, *, model: RockingModel, rtol: float) -> Root:
        return search(scene, model, rtol)

    @root_of.def_jvp
    def _(primals: Any, tangents: Any, *, model: RockingModel, rtol: float) -> Any:
        found = root_of(*primals, model=model, rtol=rtol)
        perturbed = jax.tree.map(lambda t: t is not None, tangents[0], is_leaf=lambda t: t is None)
        moving, fixed = eqx.partition(primals[0], perturbed)

        def values_at(moving: Any, root: Reals) -> Any:
            return residual(eqx.combine(moving, fixed), root, model, rtol)[:2]

        def along(direction: Any) -> Any:
            return jax.jvp(values_at, (moving, found.root), direction)[1]

        # Along the scene at this root, and along the root alone: one program for both.
        zero, one = jnp.zeros_like(found.root), jnp.ones_like(found.root)
        scene = jax.tree.map(lambda t: jnp.stack([t, jnp.zeros_like(t)]), tangents[0])
        change, values = jax.vmap(along)((scene, jnp.stack([zero, one])))
        move = -change[0] / jnp.where(found.exists, change[1], 1)
        total = (move, tuple(slope[0] + slope[1] * move for slope in values))
        total = jax.tree.map(lambda t: jnp.where(found.exists, t, 0), total)
        nothing = jax.tree.map(lambda leaf: None, found)
        return found, nothing._replace(root=total[0], values=total[1])

    return through_jacobian(root_of)
