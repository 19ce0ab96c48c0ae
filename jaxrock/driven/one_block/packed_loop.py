"""A loop whose state travels in few arrays."""

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ...validation import Booleans

_State = TypeVar("_State", bound=PyTree)
# Arrays of more numbers than this, such as lists of events, stay on their own.
_MOST = 8


def repeat_packed(
    goes_on: Callable[[_State], Booleans], take_turn: Callable[[_State], _State], begin: _State
) -> _State:
    """Repeat as `jax.lax.while_loop` does, with one array for all small numbers of a type.

    On a processor XLA runs at least one kernel or copy for each array of the state in each
    iteration. Before JAX 0.11, dispatching twenty of these takes as long as their computation.
    From then on XLA makes one kernel of the whole loop, if nothing is packed.
    """
    if jax.__version_info__ >= (0, 11):
        return jax.lax.while_loop(goes_on, take_turn, begin)
    leaves, structure = jax.tree.flatten(begin)
    leaves = [jnp.asarray(leaf) for leaf in leaves]
    groups: dict[object, list[int]] = {}
    for place, leaf in enumerate(leaves):
        key = leaf.dtype if leaf.size <= _MOST else place
        groups.setdefault(key, []).append(place)

    def pack(state: _State) -> list[Array]:
        parts = jax.tree.leaves(state)
        return [
            jnp.concatenate([jnp.reshape(parts[place], -1) for place in places])
            if len(places) > 1
            else jnp.asarray(parts[places[0]])
            for places in groups.values()
        ]

    def unpack(packed: list[Array]) -> _State:
        parts = list(leaves)
        for places, row in zip(groups.values(), packed, strict=True):
            if len(places) == 1:
                parts[places[0]] = row
                continue
            begins = 0
            for place in places:
                ends = begins + leaves[place].size
                parts[place] = row[begins:ends].reshape(leaves[place].shape)
                begins = ends
        return jax.tree.unflatten(structure, parts)

    packed = jax.lax.while_loop(
        lambda packed: goes_on(unpack(packed)),
        lambda packed: pack(take_turn(unpack(packed))),
        pack(begin),
    )
    return unpack(packed)
