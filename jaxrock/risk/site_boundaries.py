"""Boundaries of overturning in levels of an intensity measure, for one block or many."""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import numpy as np

from ..block import Block
from ..host import show_progress
from ..overturning import Boundaries, Search, check_subject, find_boundaries
from ..resonance import ModelLike
from ..validation import Reals, choose_namespace, is_traced
from .outcome_table import AT_ONCE
from .site import Site

# Relative width of the interval in which a boundary is located.
_TOLERANCE = 1e-9
# Entries where there is no boundary.
_MISSING = {"value": np.nan, "overturns_beyond": False, "impacts": -1, "toppled": False}


def find_boundaries_at_site(
    block: Block, restitution: Reals, site: Site, model: ModelLike, max_boundaries: int
) -> Boundaries:
    """Find the boundaries of each record and object between the levels of a site."""
    # Boundaries are sought along a factor on records of intensity 1, so that the factor is the
    # level itself. The derivative of a boundary that rounding decides is unknown: it is
    # dropped.
    search = Search("factor", model, max_boundaries, drop_unknown=True, tolerance=_TOLERANCE)
    subject, factors = check_subject(block, restitution, site.suite, search.along, site.levels)
    intensities = site.intensities
    if not is_traced(intensities):
        intensities = np.asarray(intensities)
    parts = (subject.block, subject.restitution)
    shape = np.broadcast_shapes(*(np.shape(leaf) for leaf in jax.tree.leaves(parts)))
    motion = subject.motion.scaled(1.0 / intensities.reshape(-1, *(1 for _ in shape)))
    subject = dataclasses.replace(subject, motion=motion)
    together = max(1, AT_ONCE // (len(site.suite) * len(site.levels)))
    if not shape or shape[0] <= together or is_traced(subject):
        return find_boundaries(subject, factors, search)
    block, restitution = jax.tree.map(
        lambda leaf: np.broadcast_to(np.asarray(leaf), shape), parts
    )
    groups = [
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
    return _join_boundaries(groups)


def _join_boundaries(groups: Sequence[Boundaries]) -> Boundaries:
    """Join the boundaries of several groups of objects, padded to the same number."""
    columns = max(group.value.shape[-1] for group in groups)
    padded = [pad_boundaries(group, columns, names=tuple(_MISSING)) for group in groups]
    # The axis of the objects follows the one of the records.
    joined = jax.tree.map(
        lambda *leaves: np.concatenate([np.asarray(leaf) for leaf in leaves], axis=1), *padded
    )
    return jax.device_put(joined)


def pad_boundaries(boundaries: Boundaries, room: int, names: tuple[str, ...]) -> Boundaries:
    """Pad the last axis of some fields to a number of columns."""
    namespace = choose_namespace(boundaries)

    def pad(name: str) -> np.ndarray | jax.Array:
        entries = getattr(boundaries, name)
        padding = [(0, 0)] * (entries.ndim - 1) + [(0, room - entries.shape[-1])]
        return namespace.pad(entries, padding, constant_values=_MISSING[name])

    return eqx.tree_at(
        lambda tree: [getattr(tree, name) for name in names], boundaries, [*map(pad, names)]
    )
