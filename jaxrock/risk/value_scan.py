"""Values of a parameter at which the rate of an object crosses its target."""

import math
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np

from ..block import SIZES_IN_WORDS
from ..overturning import UNITS
from ..resonance import RockingModel
from .hazard import describe_end
from .not_detected import estimate_windows
from .objects import Objects, change_objects
from .outcome_table import compute_outcomes
from .site import Site
from .site_boundaries import EXACT

# Distance of the values that are examined at first, in logarithms, at least and over the
# resolution; and their least number.
_SPACING = 0.1
_SPACING_OVER_RESOLUTION = 8.0
_FIRST = 13
# The widest distance between levels, in logarithms, at which a value is examined first.
_COARSE = 0.16
# Relative widths of the intervals in which boundaries are located: between few levels, and
# between all of them for a first and for a final estimate.
_WIDTHS = (0.02, 3e-4, EXACT)
# A rate from few levels is on one side of the target if it is so many standard errors away.
_ERRORS = 3.0
# Quantities of which lower values are safe; of the others, higher ones.
_SAFE_BELOW = ("height", "slenderness", "restitution")


# Most values are far from where the rate crosses the target, and few levels tell on which side
# of it they are. So a value goes through three stages, as far as its rate requires:
#
#   stage  levels   boundaries       ends where
#   -----  -------  ---------------  ------------------------------------------------
#   0      few      to 2 %           the target is further than windows and location leave
#                                    unknown, and the rate does not cross it beside the value
#   1      all      to 0.03 %        the target is further than location leaves unknown
#   2      all      to 1e-9          always
#
# Then a value is added between neighbours if the rate crosses the target there, or might, until
# they are as close as the resolution.
def scan_values(
    objects: Objects,
    along: str,
    site: Site,
    model: RockingModel,
    bounds: tuple[np.ndarray, np.ndarray],
    targets: np.ndarray,
    resolution: float,
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Compute rates at values between the bounds of each object, many near its target.

    Returns for each object values in increasing order, and the rates there [1/yr].
    """
    sites = (_thin_out(site), site, site)

    def estimate(owner: np.ndarray, value: np.ndarray, stage: int) -> np.ndarray:
        """Estimate rates, what is unknown of them, and their errors by narrow windows.

        Windows that few levels miss come and go with the value, and so do the errors.
        """
        changed = change_objects(objects, owner, value, along)
        parts = (changed.block, changed.restitution)
        table = compute_outcomes(*parts, sites[stage], model, tolerance=_WIDTHS[stage])
        windows = estimate_windows(table.overturned, table.rates, site.suite.directions)
        error = table.location_error
        unknown = error.sum(axis=(0, -1)) / len(error) * (stage < 2)
        unknown += (stage == 0) * _ERRORS * windows.deviation
        return np.stack([table.contributions.mean(axis=0), unknown, windows.deviation])

    grids = [_choose_first(low, high, resolution) for low, high in zip(*bounds, strict=True)]
    owner = np.repeat(np.arange(objects.number), [grid.size for grid in grids])
    value = np.concatenate(grids)
    stage = np.zeros(value.size, int)
    estimates = estimate(owner, value, 0)
    while True:
        rate, unknown, deviation = estimates
        distance = rate - targets[owner]
        same = owner[1:] == owner[:-1]
        crosses = same & ((distance[1:] > 0) != (distance[:-1] > 0))
        beside = np.append(crosses, False) | np.append(False, crosses)
        (near,) = np.nonzero((stage == 0) & beside | (stage < 2) & (abs(distance) <= unknown))
        if near.size:
            first = int(stage[near].min())
            near = near[stage[near] == first]
            stage[near] = first + 1
            estimates[:, near] = estimate(owner[near], value[near], first + 1)
            continue
        # It might cross the target and come back: if the nearer end is closer to the target
        # than half of what the ends are apart and two standard errors, or what is unknown.
        error = np.maximum(2 * deviation, unknown)
        apart = 0.5 * abs(np.diff(rate)) + np.maximum(error[1:], error[:-1])
        might = np.minimum(abs(distance[1:]), abs(distance[:-1])) <= apart
        # Near 0, which a restitution may be, no interval would be narrow beside its end.
        least = resolution * np.maximum(value[1:], 0.01 * bounds[1][owner[1:]])
        (left,) = np.nonzero(same & (crosses | might) & (np.diff(value) > least))
        if not left.size:
            return [(value[owner == k], rate[owner == k]) for k in range(objects.number)]
        middle = 0.5 * (value[left] + value[left + 1])
        estimates = np.insert(estimates, left + 1, estimate(owner[left], middle, 0), axis=1)
        owner = np.insert(owner, left + 1, owner[left])
        value = np.insert(value, left + 1, middle)
        stage = np.insert(stage, left + 1, 0)


def _thin_out(site: Site) -> Site:
    """Return the site with a part of its levels, the last one included."""
    levels = np.asarray(site.levels)
    halvings = math.floor(math.log2(_COARSE / np.diff(np.log(levels)).max()))
    stride = 2 ** max(halvings, 0)
    # The last level stands for all beyond.
    place = np.append(np.arange(0, levels.size - 1, stride), levels.size - 1)
    some = jax.device_put((levels[place], np.asarray(site.rates)[place]))
    return eqx.tree_at(lambda site: (site.levels, site.rates), site, some)


def _choose_first(low: float, high: float, resolution: float) -> np.ndarray:
    """Choose the values that are examined at first."""
    # Evenly in logarithms, since a rate is about a power of the size; a restitution of 0 has
    # no logarithm.
    if low > 0:
        spacing = max(_SPACING, _SPACING_OVER_RESOLUTION * resolution)
        number = max(_FIRST, math.ceil(math.log(high / low) / spacing) + 1)
        values = np.geomspace(low, high, number)
    else:
        values = np.linspace(low, high, _FIRST)
    # The bounds as they are: rounded ones could lie outside of what is allowed.
    values[[0, -1]] = low, high
    return values


class ScanAnswer(NamedTuple):
    """The value of one object, the crossings of its target, and why the value is what it is."""

    value: float
    crossings: np.ndarray
    reason: str


def read_scan(
    values: np.ndarray, rates: np.ndarray, target: float, along: str, last_rate: float
) -> ScanAnswer:
    """Read the value of one object from a scan; NaN if the hazard ends before the target."""
    is_above = rates > target
    (before,) = np.nonzero(is_above[1:] != is_above[:-1])
    # On the safe side of each crossing, where the rate was computed to be below the target.
    crossings = values[np.where(is_above[before], before + 1, before)]
    upwards = along not in _SAFE_BELOW
    end, bound, where = (
        (-1, "upper", "from there on") if upwards else (0, "lower", "up to there")
    )
    quantity = f"{UNITS.get(along, '')}, {SIZES_IN_WORDS.get(along, along)}".removeprefix(", ")
    if is_above[end]:
        reason = (
            f"none: at the {bound} bound, {values[end]:.6g} {quantity}, the rate is still"
            f" about {rates[end]:.3g} 1/yr, above {target:g} 1/yr"
        )
        return ScanAnswer(math.inf if upwards else -math.inf, crossings, reason)
    if last_rate > target:
        reason = f"not known: {describe_end(last_rate, target)}"
        return ScanAnswer(math.nan, crossings, reason)
    if not crossings.size:
        value = values[0 if upwards else -1]
        said = f"the rate is below {target:g} 1/yr at all values examined"
    else:
        value = crossings[end]
        said = f"{where} the rate stays below {target:g} 1/yr"
        if crossings.size > 1:
            said += f", which it crosses {crossings.size} times"
    return ScanAnswer(float(value), crossings, f"{value:.6g} {quantity}: {said}")
