"""Boundaries of overturning in levels of an intensity measure, for one block or many."""

import dataclasses
from collections.abc import Sequence
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..ground_motion import Suite, require_positive_measures
from ..host import show_progress
from ..overturning import Boundaries, Search, check_subject, find_boundaries
from ..resonance import ModelLike
from ..validation import Integers, Reals, choose_namespace, is_traced
from .counted_rate import AT_ONCE

_Tree = TypeVar("_Tree")
# Relative, of the boundaries: far below what a rate can tell.
_TOLERANCE = 1e-9
# Entries where there is no boundary.
_MISSING = {"value": np.nan, "overturns_beyond": False, "impacts": -1, "toppled": False}


def find_boundaries_in_levels(
    block: Block,
    restitution: Reals,
    suite: Suite,
    measure: str,
    places: Reals,
    model: ModelLike,
    max_boundaries: int,
) -> Boundaries:
    """Find the boundaries of each record and object between levels of the measure."""
    # Boundaries are sought along a factor on records of intensity 1, so that the factor is the
    # level itself. The derivative of a boundary that rounding decides is unknown: it is
    # dropped.
    search = Search("factor", model, max_boundaries, drop_unknown=True, tolerance=_TOLERANCE)
    subject, factors = check_subject(block, restitution, suite, search.along, places)
    strengths = require_positive_measures(suite, measure)
    if not is_traced(strengths):
        strengths = np.asarray(strengths)
    numbers = (subject.block, subject.restitution)
    shape = np.broadcast_shapes(*(np.shape(leaf) for leaf in jax.tree.leaves(numbers)))
    motion = subject.motion.scaled(1.0 / strengths.reshape(-1, *(1 for _ in shape)))
    subject = dataclasses.replace(subject, motion=motion)
    together = max(1, AT_ONCE // (len(suite) * len(places)))
    if not shape or shape[0] <= together or is_traced(subject):
        return find_boundaries(subject, factors, search)
    block, restitution = jax.tree.map(
        lambda leaf: np.broadcast_to(np.asarray(leaf), shape), numbers
    )
    parts = [
        find_boundaries(
            dataclasses.replace(
                subject,
                block=jax.tree.map(lambda leaf, k=k: leaf[k : k + together], block),
                restitution=restitution[k : k + together],
            ),
            factors,
            search,
        )
        for k in show_progress(range(0, shape[0], together), "objects")
    ]
    return _join_boundaries(parts)


def _join_boundaries(parts: Sequence[Boundaries]) -> Boundaries:
    """Join the boundaries of several groups of objects, padded to the same number."""
    columns = max(part.value.shape[-1] for part in parts)
    padded = [pad_boundaries(part, columns, names=tuple(_MISSING)) for part in parts]
    # The axis of the objects follows the one of the records.
    joined = jax.tree.map(
        lambda *leaves: np.concatenate([np.asarray(leaf) for leaf in leaves], axis=1), *padded
    )
    return jax.device_put(joined)


@eqx.filter_jit
def _take_object(found: Boundaries, number: Integers) -> Boundaries:
    """Take the boundaries of one object, whose number may differ in one program."""
    return jax.tree.map(
        lambda leaf: jax.lax.dynamic_index_in_dim(leaf, number, 1, keepdims=False), found
    )


def select_object(found: Boundaries, number: int) -> Boundaries:
    """Select the boundaries of one object, as many columns as it has alone."""
    if is_traced(found):
        return _take_object(found, jnp.asarray(number))
    one = jax.tree.map(lambda leaf: np.asarray(leaf)[:, number], found)
    columns = int(one.count.max(initial=0))
    names = tuple(_MISSING)
    return eqx.tree_at(
        lambda f: [getattr(f, n) for n in names],
        one,
        [getattr(one, n)[..., :columns] for n in names],
    )


def stack_objects(each: Sequence[_Tree], axis: int) -> _Tree:
    """Stack the answers for single objects along a new axis."""
    if is_traced(each):
        return jax.tree.map(lambda *leaves: jnp.stack(leaves, axis=axis), *each)
    # `jnp.stack` would compile a program for each number of objects.
    return jax.device_put(
        jax.tree.map(
            lambda *leaves: np.stack([np.asarray(leaf) for leaf in leaves], axis=axis), *each
        )
    )


def pad_boundaries(found: Boundaries, room: int, names: tuple[str, ...]) -> Boundaries:
    """Pad the last axis of some fields to a number of columns."""
    namespace = choose_namespace(found)

    def pad(name: str) -> np.ndarray | jax.Array:
        entries = getattr(found, name)
        padding = [(0, 0)] * (entries.ndim - 1) + [(0, room - entries.shape[-1])]
        return namespace.pad(entries, padding, constant_values=_MISSING[name])

    return eqx.tree_at(lambda f: [getattr(f, n) for n in names], found, [*map(pad, names)])
