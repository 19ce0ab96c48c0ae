"""Boundaries of overturning under the records of a site, in levels of its measure."""

import jax
import numpy as np

from ..block import Block
from ..driven import Batch
from ..overturning import Boundaries, Search, Subject, find_boundaries
from ..resonance import ModelLike
from ..sensitivity import FloorFactors
from ..validation import AnyArray, is_traced, unify_precision
from .floor_samples import vary_motions
from .site import Site

# Relative widths of the intervals in which boundaries are located. Where rates are compared
# with others, or averaged over samples, the wider one does.
EXACT = 1e-9
CLOSE = 1e-4


def find_boundaries_at_site(
    block: Block,
    restitution: AnyArray,
    site: Site,
    model: ModelLike,
    max_boundaries: int = 64,
    *,
    tolerance: float = EXACT,
    floors: FloorFactors | None = None,
) -> tuple[Boundaries, AnyArray]:
    """Find the boundaries of each record and object between the levels of a site.

    Parameters
    ----------
    block, restitution : Block, array_like, shape (...)
        Objects, or their samples.
    site, model, max_boundaries
        As in `overturning_rate`.
    tolerance : float
        Relative width of the interval in which a boundary is located [-].
    floors : FloorFactors of shape (...), optional
        Samples may have floors of their own.

    Returns
    -------
    boundaries : Boundaries, shape (records, ..., boundaries)
    falls : Array, shape (records, ..., boundaries)
        The other end of the interval of each boundary, at which the object overturns.
    """
    batch = make_batch_at_site(block, restitution, site, floors)
    # The derivative of a boundary that rounding decides is unknown: it is dropped.
    search = Search("factor", model, max_boundaries, drop_unknown=True, tolerance=tolerance)
    subject = Subject(batch.block, batch.restitution, batch.ground)
    return find_boundaries(subject, site.levels, search)


def make_batch_at_site(
    block: Block, restitution: AnyArray, site: Site, floors: FloorFactors | None = None
) -> Batch:
    """Make the batch of all records and objects, each record scaled to an intensity of 1.

    A factor on the motions is then the level itself.
    """
    motions = vary_motions(site.suite, floors)
    intensities = site.intensities
    block, restitution, motions, intensities = unify_precision(
        (block, restitution, motions, intensities)
    )
    leaves = jax.tree.leaves((block, restitution))
    axes = len(np.broadcast_shapes(*(np.shape(leaf) for leaf in leaves)))
    if not is_traced(intensities):
        intensities = np.asarray(intensities)
    batch = Batch.of(block, restitution, motions)
    return batch.scaled(1.0 / intensities.reshape(-1, *(1 for _ in range(axes))))
