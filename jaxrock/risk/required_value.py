"""Inverse design of a rate: the value from which on it stays below a target."""

import functools
import math
from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple, cast, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ..block import Block
from ..host import Printed, format_fields, name_work
from ..impact import read_restitution
from ..overturning import UNITS
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import (
    AT_LEAST_ONE,
    POSITIVE,
    UNIT_INTERVAL,
    AnyArray,
    Booleans,
    Domain,
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
from .not_detected import bound_not_detected, estimate_windows
from .objects import Objects, change_objects, change_parameter, gather_objects
from .outcome_table import Cases, compute_rates, tabulate_outcomes
from .overturning_rate import overturning_rate
from .site import Site
from .value_search import RateEstimate, ValueSearch, choose_strides, read_scan

Side = Literal["above", "below"]
# What may be designed, and the values that it may have.
_QUANTITIES: dict[str, Domain] = {
    **dict.fromkeys(("width", "height", "half_width", "slenderness"), POSITIVE),
    "inertia_ratio": AT_LEAST_ONE,
    "restitution": UNIT_INTERVAL,
}
# Two derivatives of the rate, at the value and over 5 % to either side of it, that differ by
# less than this fraction: then the rate is smooth there.
_SMOOTH = 0.25
_OVER = 0.05
# Standard error of a rate at all levels by the width of the intervals in which boundaries are
# located, relative. So much below the target a rate has to be, so that the one at the value,
# which is more accurate, is below it as well.
_ACCURACY = 1e-6
_BELOW = 1 - 10 * _ACCURACY


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
    not_detected : Array, shape (...)
        See `OverturningRate` [1/yr].
    crossings : Array, shape (..., crossings)
        The crossings of the target that were found, each at its safe end, in increasing order;
        NaN beyond their number.
    count : Array of int, shape (...)
        Number of crossings.
    complete : Array of bool, shape (...)
        As in `OverturningRate`; False where there is no value.
    reasons : tuple of str
        For each object, why the value is what it is.
    along : str
        The parameter.
    """

    value: Reals
    rate: Reals
    not_detected: Reals
    crossings: Reals
    count: Integers
    complete: Booleans
    reasons: tuple[str, ...] = eqx.field(static=True)
    along: str = eqx.field(static=True)

    def __str__(self) -> str:
        if np.ndim(self.value) or is_traced(self.value):
            unit = UNITS.get(self.along, "")
            return format_fields(self, value=unit, rate="1/yr", count="", complete="")
        return self.reasons[0]


def required_value(  # noqa: PLR0913
    block: Block,
    restitution: Number,
    site: Site,
    target: Number,
    along: str = "width",
    bounds: tuple[Number, Number] = (0.1, 10.0),
    *,
    side: Side = "above",
    resolution: float = 5e-3,
    model: ModelLike = Nonlinear(),
) -> RequiredValue:
    """Find the value of a parameter from which on the rate stays below a target.

    The rate is computed on a grid between the bounds, and the grid is refined at every crossing
    of the target down to `resolution`. The rate need not be monotone, so there may be several
    crossings; the outermost one on the requested side is returned.

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
    side : {"above", "below"}
        Where the rate is to stay below the target: above the value, as for a width, or below
        it, as for a height or a slenderness.
    resolution : float
        Relative distance of neighbouring values at a crossing, at least 1e-6 and less than
        0.1. Crossings that are closer together are not detected. Crossings between two values
        of the first grid, 10 % or 8 resolutions apart, are not detected either if the rate is
        far from the target at both values.
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
    The rate at the value is computed to 1e-6, not interpolated, and does not exceed the
    target. Rates far from the target are estimated from part of the levels.

    Under records the rate changes by a few per cent from one width to the next, as narrow
    windows appear and disappear. Between the examined values it may exceed the target by a few
    per cent. A test with two blocks under the example suite computed the rate at 150 widths
    above the value. For one block it exceeded the target at 4 % of these widths, by up to
    1.3 %. A finer `resolution` finds such excursions.

    Derivatives with respect to the target, the block, the restitution and the hazard follow
    from the implicit function theorem and the derivatives of `overturning_rate`. They are NaN
    where the rate is not smooth: where its derivative at the value differs by more than a
    quarter from its difference quotient over 5 % to either side, as under records with many
    narrow windows.

    Examples
    --------
    >>> import jaxrock as jr
    >>> suite = jr.Suite([jr.Record([0.0, 4.0, 4.0, -4.0, -4.0, 0.0], time_step=0.1)])
    >>> site = jr.Site(suite, jr.Hazard(levels=[0.4, 4.0], rates=[1e-2, 1e-4]))
    >>> cabinet = jr.Block.from_size(width=0.2, height=1.0)
    >>> print(jr.required_value(cabinet, 0.8, site, 1e-3, "width", (0.2, 1.0)))
    0.446391 m, width at this height: from there on the rate stays below 0.001 1/yr
    """
    search = _check_search(along, side, resolution, model)
    check_kind("site", site, Site)
    target = as_real("target", target)
    check("target", target, POSITIVE)
    ends = _check_bounds(bounds, search.along)
    parts = (block, read_restitution(block, restitution), site, target)
    with name_work(f"required {search.along.replace('_', '-')}"):
        return _search_value(parts, ends=ends, search=search)


class _ValueKind(NamedTuple):
    """The kind of a search for a value; see `required_value` for its fields."""

    along: str
    side: Side
    resolution: float
    model: RockingModel


def _check_search(along: str, side: str, resolution: float, model: ModelLike) -> _ValueKind:
    """Check how to search; a `ValueError` if that is not allowed."""
    along = as_name("along", along, _QUANTITIES)
    side = cast("Side", as_name("side", side, get_args(Side)))
    # Below 1e-6 neighbours would be equal in float32.
    if not isinstance(resolution, float | int) or not 1e-6 <= resolution < 0.1:
        raise ValueError(
            f"resolution must be at least 1e-6 and less than 0.1, got {resolution!r:.60}"
        )
    return _ValueKind(along, side, float(resolution), as_model(model))


def _check_bounds(bounds: tuple[Number, Number], along: str) -> tuple[np.ndarray, np.ndarray]:
    """Return both bounds as arrays; a `ValueError` if they are not allowed."""
    if len(bounds) != 2:
        raise ValueError(f"bounds must be two values, low and high, got {len(bounds)} of them")
    for bound in bounds:
        check("bounds", as_real("bounds", bound), _QUANTITIES[along])
    low, high = (np.asarray(bound, float) for bound in bounds)
    if not (low < high).all():
        raise ValueError(f"bounds must be a lower and a higher value, got {low} and {high}")
    return low, high


_Parts = tuple[Block, Reals, Site, Reals]


@eqx.filter_custom_jvp
def _search_value(
    parts: _Parts, *, ends: tuple[AnyArray, AnyArray], search: _ValueKind
) -> RequiredValue:
    """Search the value, for arguments that have been checked but for those of objects."""
    block, restitution, site, target = parts
    check_concrete(parts, "the search depends on the answers")
    objects = gather_objects(block, restitution)
    low, high, targets = _broadcast_to_objects(objects.number, *ends, target)
    limits = targets * _BELOW
    cases = Cases.of(objects, site, search.model)
    levels = np.asarray(site.levels)
    strides = choose_strides(levels)
    used = [_choose_places_of_levels(levels, stride).size for stride in strides]
    value_search = ValueSearch(
        functools.partial(_estimate_rates, objects, cases, search.along, strides, limits),
        cases.records * np.diff([0, *used]),
        limits,
        search.resolution,
    )
    scans = value_search.scan(low, high)
    answers = [
        read_scan(scan, float(goal), search.along, search.side)
        for scan, goal in zip(scans, targets, strict=True)
    ]
    values = np.array([answer.value for answer in answers])
    columns = max((answer.crossings.size for answer in answers), default=0)
    crossings = np.full((objects.number, columns), np.nan)
    for row, answer in zip(crossings, answers, strict=True):
        row[: answer.crossings.size] = answer.crossings
    # Those without a value are simulated at their lower bound, and taken out afterwards.
    exists = np.isfinite(values)
    changed = change_objects(
        objects, np.arange(objects.number), np.where(exists, values, low), search.along
    )
    cases = cases.replace_objects(changed)
    overturned = tabulate_outcomes(cases, levels)
    rates = compute_rates(cases, overturned, levels, _ACCURACY)
    bound = bound_not_detected(overturned, np.asarray(site.rates), site.suite.directions)
    arrays = {
        "value": values,
        "rate": np.where(exists, rates.rate, np.nan),
        "not_detected": np.where(exists, bound, np.nan),
        "crossings": crossings,
    }
    dtype = np.asarray(objects.restitution).dtype
    fields = {
        name: entries.astype(dtype).reshape((*objects.shape, *entries.shape[1:]))
        for name, entries in arrays.items()
    }
    fields["count"] = np.array([a.crossings.size for a in answers]).reshape(objects.shape)
    fields["complete"] = (exists & ~overturned[..., 0].any(axis=0)).reshape(objects.shape)
    reasons = tuple(answer.reason for answer in answers)
    return RequiredValue(**jax.device_put(fields), reasons=reasons, along=search.along)


def _broadcast_to_objects(number: int, *arrays: Number) -> list[np.ndarray]:
    """Give every object a value of each array; a `ValueError` if they do not fit."""
    try:
        return [np.broadcast_to(np.asarray(values, float), (number,)) for values in arrays]
    except ValueError:
        shapes = ", ".join(str(np.shape(values)) for values in arrays)
        raise ValueError(
            "bounds and target must be single values, or one for each object, got shapes"
            f" {shapes}, where the number of objects is {number}"
        ) from None


def _estimate_rates(  # noqa: PLR0913
    objects: Objects,
    cases: Cases,
    along: str,
    strides: Sequence[int],
    limits: np.ndarray,
    indices: np.ndarray,
    values: np.ndarray,
    stage: int,
    known: Sequence[np.ndarray],
) -> RateEstimate:
    """Estimate the rates of objects at values of the parameter, from a part of the levels."""
    cases = cases.replace_objects(change_objects(objects, indices, values, along))
    site = cases.site
    levels = np.asarray(site.levels)
    place = _choose_places_of_levels(levels, strides[stage])
    if not stage:
        overturned = tabulate_outcomes(cases, levels[place])
    else:
        before = np.isin(place, _choose_places_of_levels(levels, strides[stage - 1]))
        overturned = np.empty((*cases.batch.shape, place.size), bool)
        overturned[..., before] = np.stack(known, axis=1)
        overturned[..., ~before] = tabulate_outcomes(cases, levels[place][~before])
    # Windows narrower than these levels are met by chance.
    windows = estimate_windows(
        overturned, np.asarray(site.rates)[place], site.suite.directions
    )
    if stage == len(strides) - 1:
        rates = compute_rates(cases, overturned, levels[place], _ACCURACY, limits[indices])
        return RateEstimate(rates.rate, np.asarray(windows.deviation), overturned)
    rates = compute_rates(cases, overturned, levels[place], math.inf)
    error = np.hypot(rates.error, windows.deviation)
    return RateEstimate(rates.rate, error, overturned)


def _choose_places_of_levels(levels: np.ndarray, stride: int) -> np.ndarray:
    """Choose the places of every so many levels; each longer stride uses some of these."""
    # The last level stands for all beyond, so that it is never left out.
    last = levels.size - 1
    return np.unique(np.append(np.arange(0, last, stride), last))


@_search_value.def_jvp
def _differentiate_value(
    primals: tuple[_Parts],
    tangents: tuple[tuple[PyTree, ...]],
    *,
    ends: tuple[AnyArray, AnyArray],
    search: _ValueKind,
) -> tuple[RequiredValue, RequiredValue]:
    """Differentiate the value by the implicit function theorem: the rate stays the target."""
    (parts,) = primals
    (changes,) = tangents
    answer = _search_value(parts, ends=ends, search=search)
    value = answer.value
    safe = jnp.where(jnp.isfinite(value), value, jnp.asarray(ends[0], value.dtype))

    def compute_rate(block: Block, restitution: Reals, site: Site, value: Reals) -> Reals:
        changed = change_parameter(block, restitution, search.along, value)
        return overturning_rate(*changed, site, model=search.model).rate

    # No value, or one at a bound because there is no crossing, does not move.
    still = ~jnp.isfinite(value) | (answer.count == 0)
    domain = _QUANTITIES[search.along]
    around = jnp.clip(
        jnp.stack([safe * (1 - _OVER), safe * (1 + _OVER)]),
        1.0 if domain is AT_LEAST_ONE else 0.0,
        1.0 if domain is UNIT_INTERVAL else jnp.inf,
    )
    change = _move_value(compute_rate, parts[:3], changes[:3], changes[3], safe, around, still)
    nothing = jax.tree.map(lambda leaf: None, answer)
    return answer, eqx.tree_at(
        lambda tree: tree.value, nothing, change, is_leaf=lambda leaf: leaf is None
    )


def _move_value(
    compute_rate: Callable[..., Reals],
    parts: Sequence[object],
    changes: Sequence[object],
    target_change: Reals | None,
    value: Reals,
    around: Reals,
    still: Booleans,
) -> Reals:
    """Compute how far the value moves with parameters and target; NaN if not smooth.

    Those that are `still` do not move.
    """
    # The derivative at the value, and the difference over a change to either side.
    _, at_point = jax.jvp(
        functools.partial(compute_rate, *parts), (value,), (jnp.ones_like(value),)
    )
    low, high = (compute_rate(*parts, end) for end in around)
    over = (high - low) / (around[1] - around[0])
    smooth = (at_point != 0) & (abs(at_point - over) <= _SMOOTH * abs(over))
    _, moved = eqx.filter_jvp(
        lambda *at: compute_rate(*at, value), tuple(parts), tuple(changes)
    )
    goal = jnp.zeros_like(value) if target_change is None else target_change
    # NaN as a factor: in place of the product it would be 0 in reverse mode.
    per_rate = jnp.where(smooth, 1 / jnp.where(smooth, at_point, 1), jnp.nan)
    per_rate = jnp.where(still, 0, per_rate)
    return (goal - (0 if moved is None else moved)) * per_rate
