"""Inverse design of a rate: the value from which on it stays below a target."""

import functools
import itertools
import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ..block import SIZES_IN_WORDS, Block
from ..host import Printed, format_fields
from ..impact import read_restitution
from ..overturning import UNITS
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..tables import QUANTITIES
from ..validation import (
    AT_LEAST_ONE,
    POSITIVE,
    UNIT_INTERVAL,
    AnyArray,
    Integers,
    Number,
    Reals,
    as_name,
    as_real,
    check,
    check_concrete,
    check_kind,
    is_traced,
)
from .hazard import describe_end
from .not_detected import estimate_windows
from .objects import Objects, change_objects, change_parameter, gather_objects
from .outcome_table import CLOSE, EXACT, compute_outcomes
from .overturning_rate import overturning_rate
from .site import Site

# Parameters that may be designed.
_NAMES = ("width", "height", "half_width", "slenderness", "inertia_ratio", "restitution")
# Relative distance of neighbouring values at a crossing.
_RESOLUTION = 5e-3
# Two derivatives of the rate, at the value and over 5 % to either side of it, that differ by
# less than this fraction: then the rate is smooth there.
_SMOOTH = 0.25
_OVER = 0.05
# Distance of the values that are examined at first, in logarithms, and their least number.
_SPACING = 0.1
_FIRST = 13
# The widest distance between levels, in logarithms, and the relative width of the intervals in
# which boundaries are located, at which a value is examined first.
_COARSE = 0.16
_COARSE_WIDTH = 0.02
# A rate from few levels is on one side of the target if it is so many standard errors away.
_ERRORS = 3.0
# Quantities of which lower values are safe; of the others, higher ones.
_SAFE_BELOW = ("height", "slenderness", "restitution")


class RequiredValue(Printed, eqx.Module):
    """The value beyond which a rate stays below a target.

    See `required_value`.

    Attributes
    ----------
    value : Array, shape (...)
        In the unit of the parameter; inf (or -inf, where lower values are safe) if there is
        none within the bounds.
    rate : Array, shape (...)
        The rate of overturning there [1/yr], not above the target; NaN where there is no
        value.
    crossings : Array, shape (..., crossings)
        The crossings of the target that were found, each at its safe end, in increasing order;
        NaN beyond their number.
    count : Array of int, shape (...)
        Number of crossings.
    reasons : tuple of str
        For each object, why the value is what it is.
    along : str
        The parameter.
    """

    value: Reals
    rate: Reals
    crossings: Reals
    count: Integers
    reasons: tuple[str, ...] = eqx.field(static=True)
    along: str = eqx.field(static=True)

    def __str__(self) -> str:
        if np.ndim(self.value) or is_traced(self.value):
            unit = UNITS.get(self.along, "")
            return format_fields(self, value=unit, rate="1/yr", count="")
        return self.reasons[0]


def required_value(
    block: Block,
    restitution: Number,
    site: Site,
    target: Number,
    along: str = "width",
    bounds: tuple[Number, Number] = (0.1, 10.0),
    *,
    model: ModelLike = Nonlinear(),
) -> RequiredValue:
    """Find the value of a parameter from which on the rate stays below a target.

    The rate is computed on a grid between the bounds, and the grid is refined at every crossing
    of the target until neighbouring values are 0.5 % apart. The rate need not be monotone, so
    there may be several crossings; the outermost one on the safe side is returned. Lower values
    are safe of a height, a slenderness or a restitution, higher values of anything else.

    Parameters
    ----------
    block : Block
        One block, or many along one axis.
    restitution : array_like
        C [-], between 0 and 1; one, or one for each block.
    site : Site
    target : float, or one for each block
        Greater than 0 [1/yr].
    along : str
        ``"width"`` [m] at this height, ``"height"`` [m] at this width, ``"half_width"`` [m] at
        this slenderness, ``"slenderness"`` at this width, ``"inertia_ratio"`` or
        ``"restitution"``.
    bounds : pair of array_like
        The lowest and the highest value to examine, for all objects or for each.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.

    Returns
    -------
    RequiredValue

    Raises
    ------
    ValueError
        If an argument is out of range or traced by `jit`, or an integration does not finish.

    Notes
    -----
    The rate at the value is the one of `overturning_rate`, not interpolated, and does not
    exceed the target. Rates far from the target are estimated from part of the levels.
    Crossings between two values of the first grid, 10 % apart, are not detected if the rate is
    far from the target at both, nor are crossings closer together than 0.5 %.

    Under records the rate changes by a few per cent from one width to the next, as narrow
    windows appear and disappear. Between the examined values it may exceed the target by a few
    per cent. A test with two blocks under the example suite computed the rate at 150 widths
    above the value. For one block it exceeded the target at 4 % of these widths, by up to
    1.3 %.

    Derivatives with respect to the target, the block, the restitution and the hazard follow
    from the implicit function theorem and the derivatives of `overturning_rate`. They are NaN
    where the rate is not smooth: where its derivative at the value differs by more than a
    quarter from its difference quotient over 5 % to either side, as under records with many
    narrow windows.

    Examples
    --------
    >>> import jaxrock as jr
    >>> suite = jr.Suite([jr.Record([0.0, 4.0, 4.0, -4.0, -4.0, 0.0], time_step=0.1)])
    >>> site = jr.risk.Site(suite, jr.risk.Hazard(levels=[0.4, 4.0], rates=[1e-2, 1e-4]))
    >>> cabinet = jr.Block.from_size(width=0.2, height=1.0)
    >>> print(jr.risk.required_value(cabinet, 0.8, site, 1e-3, "width", (0.2, 1.0)))
    0.446391 m, width at this height: from there on the rate stays below 0.001 1/yr
    """
    along = as_name("along", along, _NAMES)
    check_kind("site", site, Site)
    target = as_real("target", target)
    check("target", target, POSITIVE)
    for bound in bounds:
        check("bounds", as_real("bounds", bound), QUANTITIES[along].domain)
    low, high = (np.asarray(bound, float) for bound in bounds)
    if not (low < high).all():
        raise ValueError(f"bounds must be a lower and a higher value, got {low} and {high}")
    parts = (block, read_restitution(block, restitution), site, target)
    return search_value(parts, bounds=(low, high), along=along, model=as_model(model))


_Parts = tuple[Block, AnyArray, Site, AnyArray]


@eqx.filter_custom_jvp
def search_value(
    parts: _Parts,
    *,
    bounds: tuple[AnyArray, AnyArray],
    along: str,
    model: RockingModel,
    resolution: float = _RESOLUTION,
) -> RequiredValue:
    """Search the value, for arguments that have been checked but for those of objects.

    `resolution` is the relative distance of neighbouring values at a crossing.
    """
    block, restitution, site, target = parts
    check_concrete(parts, "the search depends on the answers")
    objects = gather_objects(block, restitution)
    number = objects[1].size
    low, high, targets = (
        np.broadcast_to(np.asarray(given, float), number) for given in (*bounds, target)
    )
    scans = _scan_values(objects, along, site, model, (low, high), targets, resolution)
    last_rate = float(site.rates[-1])
    answers = [_read_scan(*scan, along, last_rate) for scan in scans]
    values, crossings, reasons = zip(*answers, strict=True)
    columns = itertools.zip_longest(*crossings, fillvalue=np.nan)
    listed = np.array([*columns]).T.reshape(number, -1)
    # Those without a value are simulated at their lower bound, and taken out afterwards.
    exists = np.isfinite(values)
    changed = change_objects(objects, slice(None), np.where(exists, values, low), along)
    table = compute_outcomes(*changed, site, model, tolerance=EXACT)
    fields = {
        "value": np.array(values),
        "rate": np.where(exists, table.contributions.mean(axis=0), np.nan),
        "crossings": listed,
    }
    for name, entries in fields.items():
        shaped = entries.reshape((*objects[1].shape, *entries.shape[1:]))
        fields[name] = jax.device_put(shaped.astype(table.levels.dtype))
    count = jnp.isfinite(fields["crossings"]).sum(axis=-1)
    return RequiredValue(**fields, count=count, reasons=reasons, along=along)


@search_value.def_jvp
def _differentiate_value(
    primals: tuple[_Parts],
    tangents: tuple[tuple[PyTree, ...]],
    *,
    bounds: tuple[AnyArray, AnyArray],
    along: str,
    **options: Any,
) -> tuple[RequiredValue, RequiredValue]:
    """Differentiate the value by the implicit function theorem: the rate stays the target."""
    (parts,) = primals
    (changes,) = tangents
    fixed = parts[:3]
    answer = search_value(parts, bounds=bounds, along=along, **options)
    value = answer.value
    safe = jnp.where(jnp.isfinite(value), value, jnp.asarray(bounds[0], value.dtype))

    def compute_rate(block: Block, restitution: AnyArray, site: Site, value: Reals) -> Reals:
        changed = change_parameter(block, restitution, along, value)
        return overturning_rate(*changed, site, model=options["model"]).rate

    # No value, or one at a bound because there is no crossing, does not move.
    still = ~jnp.isfinite(value) | (answer.count == 0)
    domain = QUANTITIES[along].domain
    around = jnp.clip(
        jnp.stack([safe * (1 - _OVER), safe * (1 + _OVER)]),
        1.0 if domain is AT_LEAST_ONE else 0.0,
        1.0 if domain is UNIT_INTERVAL else jnp.inf,
    )
    # The derivative at the value, and the difference over a change to either side.
    _, at_point = jax.jvp(
        functools.partial(compute_rate, *fixed), (safe,), (jnp.ones_like(safe),)
    )
    low, high = (compute_rate(*fixed, end) for end in around)
    over = (high - low) / (around[1] - around[0])
    smooth = (at_point != 0) & (abs(at_point - over) <= _SMOOTH * abs(over))
    _, moved = eqx.filter_jvp(
        lambda block, restitution, site: compute_rate(block, restitution, site, safe),
        fixed,
        tuple(changes[:3]),
    )
    goal = jnp.zeros_like(value) if changes[3] is None else changes[3]
    # NaN as a factor: in place of the product it would be 0 in reverse mode.
    per_rate = jnp.where(smooth, 1 / jnp.where(smooth, at_point, 1), jnp.nan)
    change = (goal - (0 if moved is None else moved)) * jnp.where(still, 0, per_rate)
    nothing = jax.tree.map(lambda leaf: None, answer)
    return answer, eqx.tree_at(
        lambda tree: tree.value, nothing, change, is_leaf=lambda leaf: leaf is None
    )


# Most values are far from where the rate crosses the target, and few levels tell on which side
# of it they are. So a value is examined at few levels, and at all levels only if the target is
# not further away than windows and location leave unknown, or if the rate crosses it beside the
# value. Then a value is added between neighbours if the rate crosses the target there, or might,
# until they are as close as the resolution.
def _scan_values(
    objects: Objects,
    along: str,
    site: Site,
    model: RockingModel,
    bounds: tuple[np.ndarray, np.ndarray],
    targets: np.ndarray,
    resolution: float,
) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """Compute rates at values between the bounds of each object, many near its target.

    Returns for each object values in increasing order, the rates there, and the target [1/yr].
    """
    levels = np.asarray(site.levels)
    stride = max(1, int(_COARSE / np.diff(np.log(levels)).max()))
    # The last level stands for all beyond.
    chosen = np.append(np.arange(0, levels.size - 1, stride), levels.size - 1)
    few_levels = Site(site.suite, site.hazard, site.measure, levels[chosen])

    def estimate(owner: np.ndarray, value: np.ndarray, finely: bool) -> np.ndarray:
        """Estimate rates, what is unknown of them, and their errors by narrow windows.

        Windows that few levels miss come and go with the value, and so do the errors.
        """
        changed = change_objects(objects, owner, value, along)
        tolerance = CLOSE if finely else _COARSE_WIDTH
        own_site = site if finely else few_levels
        table = compute_outcomes(*changed, own_site, model, tolerance=tolerance)
        _, deviation = estimate_windows(table.overturned, table.rates, table.directions)
        rate = table.contributions.mean(axis=0)
        located = table.location_error.sum(axis=-1).mean(axis=0)
        if finely:
            # Within what location leaves unknown, the rate counts as above the target.
            return np.stack([rate + located, 0 * located, deviation])
        return np.stack([rate, located + _ERRORS * deviation, deviation])

    grids = [_choose_first(low, high) for low, high in zip(*bounds, strict=True)]
    owner = np.repeat(np.arange(targets.size), [grid.size for grid in grids])
    value = np.concatenate(grids)
    is_fine = np.zeros(value.size, bool)
    estimates = estimate(owner, value, finely=False)
    while True:
        rate, unknown, deviation = estimates
        distance = rate - targets[owner]
        same = owner[1:] == owner[:-1]
        crosses = same & ((distance[1:] > 0) != (distance[:-1] > 0))
        beside = np.append(crosses, False) | np.append(False, crosses)
        (near,) = np.nonzero(~is_fine & (beside | (abs(distance) <= unknown)))
        if near.size:
            is_fine[near] = True
            estimates[:, near] = estimate(owner[near], value[near], finely=True)
            continue
        # It might cross the target and come back: if the nearer end is closer to the target
        # than half of what both are apart and two standard errors, or what is unknown.
        error = np.maximum(2 * deviation, unknown)
        apart = 0.5 * abs(np.diff(rate)) + np.maximum(error[1:], error[:-1])
        might = np.minimum(abs(distance[1:]), abs(distance[:-1])) <= apart
        # Near 0, which a restitution may be, no interval would be narrow beside its end.
        least = resolution * np.maximum(value[1:], 0.01 * bounds[1][owner[1:]])
        (left,) = np.nonzero(same & (crosses | might) & (np.diff(value) > least))
        if not left.size:
            own = [owner == k for k in range(targets.size)]
            return [(value[k], rate[k], float(t)) for k, t in zip(own, targets, strict=True)]
        middle = 0.5 * (value[left] + value[left + 1])
        added = estimate(owner[left], middle, finely=False)
        estimates = np.insert(estimates, left + 1, added, axis=1)
        owner = np.insert(owner, left + 1, owner[left])
        value = np.insert(value, left + 1, middle)
        is_fine = np.insert(is_fine, left + 1, False)


def _choose_first(low: float, high: float) -> np.ndarray:
    """Choose the values that are examined at first."""
    # Evenly in logarithms, since a rate is about a power of the size; a restitution of 0 has
    # no logarithm.
    if low == 0:
        return np.linspace(low, high, _FIRST)
    return np.geomspace(low, high, max(_FIRST, math.ceil(math.log(high / low) / _SPACING) + 1))


def _read_scan(
    values: np.ndarray, rates: np.ndarray, target: float, along: str, last_rate: float
) -> tuple[float, np.ndarray, str]:
    """Read the value of one object from a scan, its crossings, and why it is what it is.

    The value is NaN if the hazard ends before the target.
    """
    is_above = rates > target
    (before,) = np.nonzero(is_above[1:] != is_above[:-1])
    # On the safe side of each crossing, where the rate was computed to be below the target.
    crossings = values[np.where(is_above[before], before + 1, before)]
    bound, end, safe_side = ("upper", -1, "from there on")
    if along in _SAFE_BELOW:
        bound, end, safe_side = ("lower", 0, "up to there")
    quantity = f"{UNITS.get(along, '')}, {SIZES_IN_WORDS.get(along, along)}".removeprefix(", ")
    if is_above[end]:
        at_bound = f"at the {bound} bound, {values[end]:.6g} {quantity}"
        above = f"the rate is still about {rates[end]:.3g} 1/yr, above {target:g} 1/yr"
        return (-math.inf if end == 0 else math.inf), crossings, f"none: {at_bound}, {above}"
    if last_rate > target:
        return math.nan, crossings, f"not known: {describe_end(last_rate, target)}"
    reason = f"{safe_side} the rate stays below {target:g} 1/yr"
    if not crossings.size:
        reason = f"the rate is below {target:g} 1/yr at all values examined"
    value = float(crossings[end] if crossings.size else values[-1 - end])
    return value, crossings, f"{value:.6g} {quantity}: {reason}"
