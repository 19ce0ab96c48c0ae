"""The outcomes of objects under the records of a site, from which all rates follow."""

from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np

from ..block import Block
from ..driven import Batch, require_complete
from ..ground_motion import average_directions
from ..overturning import Boundaries, Search, Subject, find_boundaries
from ..resonance import ModelLike
from ..sensitivity import FloorFactors
from ..validation import AnyArray, choose_namespace, is_traced, unify_precision
from .not_detected import bound_not_detected
from .objects import vary_motions
from .site import Site

# Relative widths of the intervals in which boundaries are located. Where rates are compared
# with others, or averaged over samples, the wider one does.
EXACT = 1e-9
CLOSE = 1e-4


class OutcomeTable(NamedTuple):
    """Outcomes of objects, or of their samples, under each record at every level.

    Above the highest level the outcome there is assumed to persist.

    Attributes
    ----------
    boundaries : Array, shape (records, ..., boundaries)
        Levels at which the outcome changes, NaN beyond their number. At the boundary itself the
        object stands.
    begins : Array of bool, shape (records, ..., boundaries)
        Whether the object overturns beyond the boundary.
    exceedance, location_error : Array, shape (records, ..., boundaries)
        The hazard at the boundaries, and by how much it may be another within the intervals in
        which they are located [1/yr].
    overturns_first, complete : Array of bool, shape (records, ...)
        Whether the object overturns at the lowest level; whether all boundaries are known.
    levels, rates : Array, shape (levels,)
        Levels of the site, and the hazard there [1/yr].
    directions : int
        In which the suite has each record.
    """

    boundaries: AnyArray
    begins: AnyArray
    exceedance: AnyArray
    location_error: AnyArray
    overturns_first: AnyArray
    complete: AnyArray
    levels: AnyArray
    rates: AnyArray
    directions: int

    @property
    def contributions(self) -> AnyArray:
        """The rate if this record stood for all motions, (records, ...) [1/yr].

        With boundaries a_0, a_1, ... and the hazard H it is H(a_0) - H(a_1) + H(a_2) - ...
        """
        library = choose_namespace(self[:-1])
        signed = library.where(self.begins, self.exceedance, -self.exceedance)
        changes = library.where(library.isfinite(self.boundaries), signed, 0).sum(axis=-1)
        return changes + library.where(self.overturns_first, self.rates[0], 0)

    @property
    def overturned(self) -> AnyArray:
        """Whether the object overturns at each level, (records, ..., levels)."""
        levels = self.levels.reshape(*(1 for _ in self.boundaries.shape), -1)
        at = self.boundaries[..., None]
        # NaN, where there is no boundary, is not below anything. A boundary that is a level is
        # below it where the object stands beyond.
        stands_there = (at == levels) & ~self.begins[..., None]
        below = ((at < levels) | stands_there).sum(axis=-2)
        return (below % 2 == 1) != self.overturns_first[..., None]

    def average(self, with_samples: bool = False) -> dict[str, AnyArray | np.generic]:
        """Average over the records, and before over the samples, if they are the last axis.

        Returns the fields of an `OverturningRate` that follow from a table.
        """
        contributions = self.contributions
        overturns_first = self.overturns_first
        # The bound has no derivative where no level is alone in its window.
        rates = jax.lax.stop_gradient(self.rates) if is_traced(self.rates) else self.rates
        bound = bound_not_detected(self.overturned, rates, self.directions)
        complete = self.complete & ~overturns_first
        if with_samples:
            # A bound for each sample, then the mean: samples of one record have the same windows,
            # and do not count as more records.
            contributions, bound = (part.mean(axis=-1) for part in (contributions, bound))
            overturns_first = overturns_first.any(axis=-1)
            complete = complete.all(axis=-1)
        # Only the means over the directions of a record are independent.
        independent = average_directions(contributions, self.directions)
        library = choose_namespace(independent)
        error = library.full_like(independent[0], library.nan)
        if len(independent) > 1:
            error = independent.std(axis=0, ddof=1) / len(independent) ** 0.5
        return {
            "rate": contributions.mean(axis=0),
            "contributions": contributions,
            "standard_error": error,
            "not_detected": bound,
            "complete": complete.all(axis=0),
            "overturns_first": overturns_first,
            "last_rate": self.rates[-1],
        }


average_traced = eqx.filter_jit(OutcomeTable.average)


def find_outcomes(
    block: Block,
    restitution: AnyArray,
    site: Site,
    model: ModelLike,
    max_boundaries: int = 64,
    *,
    tolerance: float = EXACT,
    floors: FloorFactors | None = None,
) -> tuple[OutcomeTable, Boundaries]:
    """Find the outcomes of each record and object, and the boundaries between the levels.

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
    table : OutcomeTable
        In NumPy where all is concrete.
    boundaries : Boundaries, shape (records, ..., boundaries)
    """
    numbers = (block, restitution, vary_motions(site.suite, floors), site.intensities)
    block, restitution, motions, intensities = unify_precision(numbers)
    axes = max(np.ndim(leaf) for leaf in jax.tree.leaves((block, restitution)))
    # Each record scaled to an intensity of 1: a factor on it is then the level itself.
    intensities = choose_namespace(intensities).asarray(intensities)
    batch = Batch.of(block, restitution, motions)
    batch = batch.scaled(1.0 / intensities.reshape(-1, *(1 for _ in range(axes))))
    # The derivative of a boundary that rounding decides is unknown: it is dropped.
    search = Search("factor", model, max_boundaries, drop_unknown=True, tolerance=tolerance)
    subject = Subject(batch.block, batch.restitution, batch.ground)
    boundaries, falls = find_boundaries(subject, site.levels, search)
    return _tabulate(boundaries, falls, site), boundaries


def _tabulate(boundaries: Boundaries, falls: AnyArray, site: Site) -> OutcomeTable:
    """Tabulate the outcomes from both sides of the boundaries."""
    columns = boundaries.value.shape[-1]
    # Padded to a power of two of columns, so that few programs are compiled for derivatives.
    room = max(8, 1 << (columns - 1).bit_length())
    padding = [(0, 0)] * (boundaries.value.ndim - 1) + [(0, room - columns)]
    numbers = (boundaries, falls, site.levels, site.rates)
    if not is_traced((boundaries, site)):
        # In NumPy before anything is computed: JAX would compile a program for each shape.
        numbers = jax.tree.map(np.asarray, numbers)
    boundaries, falls, levels, rates = numbers
    library = choose_namespace(numbers)
    value, falls = (
        library.pad(side, padding, constant_values=np.nan)
        for side in (boundaries.value, falls)
    )
    begins = library.pad(boundaries.overturns_beyond, padding, constant_values=False)
    # A hazard need not be defined at NaN, where there is no boundary.
    at = library.stack([value, falls])
    at = library.where(library.isfinite(at), at, levels[0])
    stands, overturns = library.asarray(site.hazard(at))
    exceedance = 0.5 * (stands + overturns), 0.5 * abs(stands - overturns)
    complete = boundaries.complete & (boundaries.count <= columns)
    outcomes = (value, begins, *exceedance, boundaries.overturns_first, complete)
    return OutcomeTable(*outcomes, levels, rates, site.suite.directions)


def compute_outcomes(
    block: Block,
    restitution: AnyArray,
    site: Site,
    model: ModelLike,
    *,
    tolerance: float = CLOSE,
    floors: FloorFactors | None = None,
) -> OutcomeTable:
    """Compute the outcomes of concrete objects or samples; see `find_outcomes`.

    Raises
    ------
    ValueError
        If an integration does not finish.
    """
    table, boundaries = find_outcomes(
        block, restitution, site, model, tolerance=tolerance, floors=floors
    )
    complete = np.asarray(boundaries.complete).reshape(len(site.suite), -1).all(axis=1)
    require_complete(complete, record=site.suite.names)
    return table
