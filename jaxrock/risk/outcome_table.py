"""The outcomes of objects under the records of a site, from which all rates follow."""

from typing import NamedTuple

import jax
import numpy as np

from ..block import Block
from ..driven import require_complete
from ..overturning import Boundaries
from ..resonance import ModelLike
from ..sensitivity import FloorFactors
from ..validation import AnyArray, choose_namespace, is_traced
from .site import Site
from .site_boundaries import CLOSE, find_boundaries_at_site


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
    """

    boundaries: AnyArray
    begins: AnyArray
    exceedance: AnyArray
    location_error: AnyArray
    overturns_first: AnyArray
    complete: AnyArray
    levels: AnyArray
    rates: AnyArray

    @property
    def contributions(self) -> AnyArray:
        """The rate if this record stood for all motions, (records, ...) [1/yr].

        With boundaries a_0, a_1, ... and the hazard H it is H(a_0) - H(a_1) + H(a_2) - ...
        """
        library = choose_namespace(self)
        signed = library.where(self.begins, self.exceedance, -self.exceedance)
        changes = library.where(library.isfinite(self.boundaries), signed, 0).sum(axis=-1)
        return changes + library.where(self.overturns_first, self.rates[0], 0)

    @property
    def overturned(self) -> AnyArray:
        """Whether the object overturns at each level, (records, ..., levels)."""
        along_levels = self.levels.reshape(*(1 for _ in self.boundaries.shape), -1)
        at = self.boundaries[..., None]
        # NaN, where there is no boundary, is not below anything. A boundary that is a level is
        # below it where the object stands beyond.
        stands_there = (at == along_levels) & ~self.begins[..., None]
        below = ((at < along_levels) | stands_there).sum(axis=-2)
        return (below % 2 == 1) != self.overturns_first[..., None]


def tabulate_outcomes(boundaries: Boundaries, falls: AnyArray, site: Site) -> OutcomeTable:
    """Tabulate the outcomes at a site from boundaries there; in NumPy where all is concrete.

    See `find_boundaries_at_site`.
    """
    columns = boundaries.value.shape[-1]
    # Padded to a power of two of columns, so that few programs are compiled for derivatives.
    room = max(8, 1 << (columns - 1).bit_length())
    padding = [(0, 0)] * (boundaries.value.ndim - 1) + [(0, room - columns)]
    # In NumPy before anything is computed: JAX would compile a program for each shape.
    traced = is_traced((boundaries, site))
    ends = (boundaries.value, falls, boundaries.overturns_beyond)
    ends += (boundaries.overturns_first, boundaries.complete, boundaries.count)
    numbers = (*ends, site.levels, site.rates)
    if not traced:
        numbers = jax.tree.map(np.asarray, numbers)
    value, falls, begins, overturns_first, complete, count, levels, rates = numbers
    library = choose_namespace(numbers)
    value, falls = (
        library.pad(end, padding, constant_values=np.nan) for end in (value, falls)
    )
    begins = library.pad(begins, padding, constant_values=False)
    # A hazard need not be defined at NaN, where there is no boundary.
    at = library.stack([value, falls])
    at = library.where(library.isfinite(at), at, levels[0])
    stands, overturns = site.hazard(at) if traced else site.exceed(at)
    return OutcomeTable(
        value,
        begins,
        0.5 * (stands + overturns),
        0.5 * abs(stands - overturns),
        overturns_first,
        complete & (count <= columns),
        levels,
        rates,
    )


def compute_outcomes(
    block: Block,
    restitution: AnyArray,
    site: Site,
    model: ModelLike,
    *,
    tolerance: float = CLOSE,
    floors: FloorFactors | None = None,
) -> OutcomeTable:
    """Tabulate the outcomes of concrete objects or samples; see `find_boundaries_at_site`.

    Raises
    ------
    ValueError
        If an integration does not finish.
    """
    boundaries, falls = find_boundaries_at_site(
        block, restitution, site, model, tolerance=tolerance, floors=floors
    )
    complete = np.asarray(boundaries.complete).reshape(len(site.suite), -1).all(axis=1)
    require_complete(complete, record=site.suite.names)
    return tabulate_outcomes(boundaries, falls, site)
