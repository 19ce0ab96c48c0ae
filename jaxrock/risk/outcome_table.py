"""Outcomes of objects under records at levels, and the rates that follow from them.

Everything here is concrete and computed in NumPy: the batch is the only program.
"""

import math
from typing import NamedTuple

import jax
import numpy as np

from ..block import Block
from ..driven import Batch, follow_batch, require_complete
from ..host import count_work
from ..numerics import compute_middle
from ..resonance import RockingModel
from ..sensitivity import FloorFactors
from ..validation import AnyArray
from .floor_samples import vary_motions
from .lognormal import BoundarySums, sum_powers
from .objects import Objects
from .site import Site

# Responses that are simulated at once: so many that a batch is efficient, and so few that
# their arrays take 100 MB.
AT_ONCE = 2**18
# The end of the refinement of a crossing, relative: it is as good as exact in double
# precision.
_EXACT = 1e-13
# Halvings of an interval between two levels, at most.
_HALVINGS = 45
# So many standard errors away from a target a rate is on one side of it.
_DECIDED = 5.0


class Cases(NamedTuple):
    """Objects under the records of a site, ready to be simulated at any level.

    Attributes
    ----------
    site : Site
    model : Nonlinear or Linearized
    batch : Batch
        Of shape (records, objects), each record scaled to an intensity of 1.
    names : tuple of str
        Of the objects; empty where they are samples, or there is only one.
    """

    site: Site
    model: RockingModel
    batch: Batch
    names: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        objects: Objects,
        site: Site,
        model: RockingModel,
        floors: FloorFactors | None = None,
    ) -> "Cases":
        """Make the cases of objects, or of the samples of objects, along one axis.

        The floor may differ from sample to sample.
        """
        motions = vary_motions(site.suite, floors)
        batch = Batch.of(*_list_along_axis(objects), motions, axes=1)
        intensities = np.asarray(site.intensities, batch.dtype)[:, None]
        return cls(site, model, batch.scaled(1 / intensities), objects.names)

    def replace_objects(self, objects: Objects) -> "Cases":
        """Return the cases of other objects, for which records are not converted again."""
        batch = Batch.of(*_list_along_axis(objects), self.batch.ground)
        return self._replace(batch=batch, names=objects.names)

    @property
    def records(self) -> int:
        """Number of records."""
        return self.batch.shape[0]

    def simulate(
        self, records: np.ndarray, objects: np.ndarray, levels: np.ndarray
    ) -> np.ndarray:
        """Return which objects overturn, by indices of records and objects along one axis.

        Raises
        ------
        ValueError
            If an integration does not finish.
        """
        index = records * self.batch.shape[1] + objects
        levels = levels.astype(self.batch.dtype)
        batch = self.batch.select(index).scaled(levels)
        response = follow_batch(batch, self.model)
        self._require_complete(np.asarray(response.complete), records, objects, levels)
        return np.asarray(response.overturned)

    def _require_complete(
        self,
        complete: AnyArray,
        records: np.ndarray,
        objects: np.ndarray,
        levels: np.ndarray,
    ) -> None:
        """Raise `ValueError` if an integration has not finished, with what it belongs to."""
        (incomplete,) = np.nonzero(~np.asarray(complete))
        if not incomplete.size:
            return
        first = incomplete[0]
        names = [self.site.suite.names[k] for k in records[incomplete]]
        labels = {"record": names, "level": f"{levels[first]:.6g}"}
        if self.names:
            labels["object"] = repr(self.names[objects[first]])
        require_complete(np.zeros(incomplete.size, bool), **labels)


def _list_along_axis(objects: Objects) -> tuple[Block, AnyArray]:
    """Return blocks and restitutions along an axis, which a single one does not have."""
    return jax.tree.map(np.atleast_1d, (objects.block, objects.restitution))


class Crossings(NamedTuple):
    """Changes of the outcome between two levels, along one axis, by object, record and level.

    Attributes
    ----------
    objects, records : ndarray of int
    low, high : ndarray
        Levels on both sides.
    begins : ndarray of bool
        Whether the object overturns at the higher level.
    """

    objects: np.ndarray
    records: np.ndarray
    low: np.ndarray
    high: np.ndarray
    begins: np.ndarray


class Rates(NamedTuple):
    """Rates of overturning of objects, each the mean over the records.

    Attributes
    ----------
    rate : ndarray, shape (objects,)
        [1/yr]
    contributions : ndarray, shape (records, objects)
        The rate if each motion were like this record [1/yr].
    error : ndarray, shape (objects,)
        Standard error due to the width of the intervals in which boundaries are located
        [1/yr].
    """

    rate: np.ndarray
    contributions: np.ndarray
    error: np.ndarray


def tabulate_outcomes(cases: Cases, levels: np.ndarray) -> np.ndarray:
    """Simulate all objects under all records at levels; bool, (records, objects, levels)."""
    shape = (*cases.batch.shape, levels.size)
    size = math.prod(shape)
    overturned = np.empty(size, bool)
    # In parts, since indices of all would take more memory than outcomes.
    with count_work("outcomes at levels", size):
        for k in range(0, size, AT_ONCE):
            part = np.arange(k, min(k + AT_ONCE, size))
            records, objects, places = np.unravel_index(part, shape)
            overturned[part] = cases.simulate(records, objects, levels[places])
    return overturned.reshape(shape)


def list_crossings(overturned: np.ndarray, levels: np.ndarray) -> Crossings:
    """List the changes of the outcome between neighbouring levels."""
    changed = overturned[..., 1:] != overturned[..., :-1]
    objects, records, places = np.nonzero(changed.swapaxes(0, 1))
    begins = overturned[records, objects, places + 1]
    return Crossings(objects, records, levels[places], levels[places + 1], begins)


# A boundary lies anywhere between the two levels, uniformly in the rate of the hazard: 1 / 12
# is the variance of that.
def locate_crossings(
    cases: Cases,
    overturned: np.ndarray,
    crossings: Crossings,
    accuracy: float,
    targets: np.ndarray | None = None,
) -> Crossings:
    """Halve the intervals of crossings until the rates of all objects are accurate.

    Parameters
    ----------
    cases : Cases
    overturned : ndarray of bool, shape (records, objects, levels)
    crossings : Crossings
    accuracy : float
        Standard error of a rate by the width of the intervals, relative.
    targets : ndarray, shape (objects,), optional
        Rates [1/yr]; an object whose rate is known to be on one side of it is done.
    """
    low = crossings.low.copy()
    high = crossings.high.copy()
    number = np.bincount(crossings.objects, minlength=overturned.shape[1])
    with count_work("boundaries between levels", low.size) as work:
        while True:
            located = crossings._replace(low=low, high=high)
            rates = sum_rates(cases, overturned, located)
            # Each interval of an object may be so wide, measured in the rate of the hazard.
            allowed = (
                accuracy * cases.records * rates.rate * np.sqrt(12 / np.maximum(number, 1))
            )
            if targets is not None:
                allowed[abs(rates.rate - targets) > _DECIDED * rates.error] = math.inf
            fall = cases.site.exceed(low) - cases.site.exceed(high)
            is_wide = (fall > allowed[crossings.objects]) & (high > low * (1 + _EXACT))
            (wide,) = np.nonzero(is_wide)
            if not wide.size:
                return located
            # Each halving halves the fall of the hazard too, nearly.
            too_wide = fall[wide] / np.maximum(allowed[crossings.objects[wide]], 1e-300)
            work.expect(float(np.ceil(np.log2(too_wide)).clip(1, _HALVINGS).sum()))
            # As `refine_brackets` does with a tolerance, to the same bits: of several
            # boundaries between two levels both find the same.
            middle = np.asarray(compute_middle(low[wide], high[wide]), cases.batch.dtype)
            outcome = cases.simulate(crossings.records[wide], crossings.objects[wide], middle)
            is_beyond = outcome == crossings.begins[wide]
            high[wide[is_beyond]] = middle[is_beyond]
            low[wide[~is_beyond]] = middle[~is_beyond]


def sum_rates(cases: Cases, overturned: np.ndarray, crossings: Crossings) -> Rates:
    """Sum the hazard over crossings, with a minus sign where overturning ends.

    Above the highest level the outcome there is assumed to persist; below the lowest level the
    contribution is zero.
    """
    site = cases.site
    shape = overturned.shape[:2]
    place = crossings.records * shape[1] + crossings.objects
    middle = site.exceed(np.sqrt(crossings.low * crossings.high))
    fall = site.exceed(crossings.low) - site.exceed(crossings.high)
    signs = np.where(crossings.begins, 1.0, -1.0)
    # One after the other along the levels, so that the bits do not depend on other objects.
    size = overturned[..., 0].size
    changes = np.bincount(place, signs * middle, size).reshape(shape)
    contributions = changes + np.where(overturned[..., 0], float(site.rates[0]), 0.0)
    rate = np.zeros(shape[1])
    for of_record in contributions:
        rate += of_record / shape[0]
    variance = np.bincount(crossings.objects, fall**2 / 12, shape[1])
    return Rates(rate, contributions, np.sqrt(variance) / shape[0])


def sum_crossings(
    crossings: Crossings, overturned: np.ndarray, samples: np.ndarray, directions: int
) -> BoundarySums:
    """Sum what a fragility curve of some samples is fitted to, by the mean over them.

    Parameters
    ----------
    crossings : Crossings
    overturned : ndarray of bool, shape (records, samples, levels)
    samples : ndarray of int
        Indices of the samples of one object.
    directions : int
        Number of directions of each record, whose mean counts as one record.
    """
    of_object = np.isin(crossings.objects, samples)
    middles = np.sqrt(crossings.low * crossings.high)[of_object]
    powers = sum_powers(middles, np.where(crossings.begins[of_object], 1.0, -1.0))
    outcomes = overturned[:, samples]
    number = samples.size * directions
    below = outcomes[..., 0].sum() / number
    above = (~outcomes[..., -1]).sum() / number
    return BoundarySums(float(below), float(above), powers / number)


def compute_rates(
    cases: Cases,
    overturned: np.ndarray,
    levels: np.ndarray,
    accuracy: float,
    targets: np.ndarray | None = None,
) -> Rates:
    """Compute rates of overturning from outcomes at levels, to a relative accuracy.

    With an infinite accuracy boundaries are taken to be in the middle between levels. See
    `locate_crossings`.
    """
    crossings = list_crossings(overturned, levels)
    if not math.isinf(accuracy):
        crossings = locate_crossings(cases, overturned, crossings, accuracy, targets)
    return sum_rates(cases, overturned, crossings)
