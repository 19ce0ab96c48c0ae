"""Inverse design of a rate: the value from which on it stays below a target."""

import functools
from collections.abc import Callable, Sequence
from typing import Any, Literal, NamedTuple, cast, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ..block import Block, change_block
from ..ground_motion import Suite, require_positive_measures
from ..host import Printed, format_fields
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
    Numbers,
    Reals,
    as_name,
    as_real,
    check,
    check_kind,
    is_traced,
)
from .counted_rate import CountedRate, Counting, count_rates, find_outcomes, plan_counting
from .hazard import Hazard
from .objects import Objects, gather_objects
from .overturning_rate import check_falling, check_hazard, choose_levels, overturning_rate
from .rate_scan import Follow, plan_depths, read_scan, scan_values

Side = Literal["above", "below"]
# What may be designed, and the values that it may have.
_QUANTITIES: dict[str, Domain] = {
    **dict.fromkeys(("width", "height", "half_width", "slenderness"), POSITIVE),
    "inertia_ratio": AT_LEAST_ONE,
    "restitution": UNIT_INTERVAL,
}
# Two slopes of the rate, at the value and over 5 % to either side of it, that differ by less
# than this share: then the rate is smooth there.
_SMOOTH = 0.25
_OVER = 0.05


class RequiredValue(Printed, eqx.Module):
    """The value beyond which, or up to which, a rate stays below a target; see `required_value`.

    Attributes
    ----------
    value : Array, shape (...)
        In the unit of the quantity; inf (or -inf, where lower values are safe) if there is
        none within the bounds.
    rate, recount : Array, shape (...)
        The rate counted there, at the levels that were given and at levels halfway between
        them [1/yr]; or the probability. NaN where there is no value.
    error : Array, shape (...)
        Standard error of a count at separate levels.
    crossings : Array, shape (..., crossings)
        Every value at which the rate crosses the target, in increasing order; NaN beyond their
        number.
    count : Array of int, shape (...)
        Number of crossings.
    reasons : tuple of str
        For each object, why the value is what it is.
    along : str
        The quantity.
    """

    value: Reals
    rate: Reals
    recount: Reals
    error: Reals
    crossings: Reals
    count: Integers
    reasons: tuple[str, ...] = eqx.field(static=True)
    along: str = eqx.field(static=True)

    def __str__(self) -> str:
        if np.ndim(self.value) or is_traced(self.value):
            unit = UNITS.get(self.along, "")
            return format_fields(self, value=unit, rate="", recount="", count="")
        return self.reasons[0]


def required_value(
    block: Block,
    restitution: Number,
    suite: Suite,
    hazard: Hazard | Callable[..., Reals] | float,
    target: Number,
    along: str = "width",
    bounds: tuple[Number, Number] = (0.1, 10.0),
    measure: str = "pgv",
    levels: Numbers | None = None,
    *,
    side: Side = "above",
    resolution: float = 5e-3,
    model: ModelLike = Nonlinear(),
) -> RequiredValue:
    """Find the value of a quantity from which on the rate of overturning stays below a target.

    The rate is counted at values between the bounds. Where it crosses the target, or might
    between two values, more are examined, until neighbours are as close as the resolution. A
    rate need not fall with the width: a wider block may survive less of a record. So the value
    is not a place where the rate crosses the target, but the last of them.

    Parameters
    ----------
    block : Block
        One block, or many along one axis.
    restitution : array_like
        C [-], between 0 and 1; one, or one for each block.
    suite : Suite
    hazard : Hazard, callable or float
        As in `overturning_rate`; or one level of the measure, for a probability.
    target : float, or one for each block
        Greater than 0 [1/yr]; of a probability less than 1.
    along : str
        ``"width"`` [m] at this height, ``"height"`` [m] at this width, ``"half_width"`` [m] at
        this slenderness, ``"slenderness"`` at this width, ``"inertia_ratio"`` or
        ``"restitution"``.
    bounds : pair of array_like
        The lowest and the highest value to examine, for all objects or for each.
    measure, levels, model
        As in `overturning_rate`.
    side : {"above", "below"}
        Where the rate is to stay below the target: above the value, as for a width, or below
        it, as for a height or a slenderness.
    resolution : float
        Relative distance of neighbouring values at a crossing, at least 1e-6 and less than
        0.1. Crossings that are closer together go unseen, and so may those between two first
        values, 10 % apart, if the rate is far from the target at both.

    Returns
    -------
    RequiredValue

    Raises
    ------
    ValueError
        If an argument is out of range or traced by `jit`, or a motion could not be followed.

    Notes
    -----
    The value itself was counted, and stays below the target. An outcome at a level stands for
    all levels nearer to it than to others, so that the count is right on average whatever
    their distance is, with the standard error ``error``; ``recount`` is another one.

    Derivatives with respect to the target, the block, the restitution and the hazard are those
    of the implicit function theorem, with the rate's derivatives of `overturning_rate`. They
    are NaN where the rate is not smooth: where its slope at the value and its slope over 5 %
    to either side differ by more than a quarter, as under records with many narrow windows.
    The derivatives of a probability, which has steps, are NaN.

    Examples
    --------
    >>> import jaxrock as jr
    >>> suite = jr.Suite([jr.Record([0.0, 4.0, 4.0, -4.0, -4.0, 0.0], time_step=0.1)])
    >>> hazard = jr.Hazard(levels=[0.4, 4.0], rates=[1e-2, 1e-4])
    >>> cabinet = jr.Block.from_size(width=0.2, height=1.0)
    >>> print(jr.required_value(cabinet, 0.8, suite, hazard, 1e-3, "width", (0.2, 1.0)))
    0.447715 m, width at this height: from there on the rate stays below 0.001
    """
    search = _check_search(along, side, resolution, measure, model)
    check_kind("suite", suite, Suite)
    if any(np.shape(record.scale) for record in suite):
        raise ValueError("scales of records must be single ones, got arrays of them")
    level = None
    if isinstance(hazard, float | int):
        check("hazard", as_real("hazard", hazard), POSITIVE)
        if levels is not None:
            raise ValueError("levels go with a hazard only, not with one level")
        level = float(hazard)
        hazard = _make_certain
    else:
        check_hazard(hazard, search.measure)
    target = as_real("target", target)
    check("target", target, POSITIVE)
    if level is not None and not is_traced(target) and not (np.asarray(target) < 1).all():
        largest = float(np.max(np.asarray(target)))
        raise ValueError(f"target must be less than 1 for a probability, got {largest:g}")
    numbers = (block, as_real("restitution", restitution), hazard, target)
    ends = _check_bounds(bounds, search.along)
    return _search_value(
        numbers, suite=suite, ends=ends, levels=levels, level=level, search=search
    )


class _ValueSearch(NamedTuple):
    """The kind of a search for a value; see `required_value` for its fields."""

    along: str
    side: Side
    resolution: float
    measure: str
    model: RockingModel


def _make_certain(level: Any) -> Any:
    """Stand in for a hazard: once a year, so that the rate at one level is a probability."""
    return 0 * level + 1


def _check_search(
    along: str, side: Side, resolution: float, measure: str, model: ModelLike
) -> _ValueSearch:
    """Check how to search; a `ValueError` if that is not allowed."""
    along = as_name("along", along, _QUANTITIES)
    measure = as_name("measure", measure, ("pga", "pgv"))
    side = cast("Side", as_name("side", side, get_args(Side)))
    # Below 1e-6 neighbours would be equal in float32.
    if not isinstance(resolution, float | int) or not 1e-6 <= resolution < 0.1:
        raise ValueError(
            f"resolution must be at least 1e-6 and less than 0.1, got {resolution!r:.60}"
        )
    return _ValueSearch(along, side, float(resolution), measure, as_model(model))


def _check_bounds(bounds: tuple[Number, Number], along: str) -> tuple[np.ndarray, np.ndarray]:
    """Return both bounds as arrays; a `ValueError` if they are not allowed."""
    if len(bounds) != 2:
        raise ValueError(f"bounds must be two, a lower and an upper one, got {len(bounds)}")
    for bound in bounds:
        check("bounds", as_real("bounds", bound), _QUANTITIES[along])
    low, high = (np.asarray(bound, float) for bound in bounds)
    if not (low < high).all():
        raise ValueError(f"bounds must be a lower and a higher value, got {low} and {high}")
    return low, high


_Numbers = tuple[Block, Reals, Hazard | Callable[..., Reals], Reals]


@eqx.filter_custom_jvp
def _search_value(
    numbers: _Numbers,
    *,
    suite: Suite,
    ends: tuple[AnyArray, AnyArray],
    levels: Numbers | None,
    level: float | None,
    search: _ValueSearch,
) -> RequiredValue:
    """Search the value, for arguments that have been checked but for those of objects."""
    block, restitution, hazard, target = numbers
    if is_traced(numbers):
        raise ValueError("arguments must be concrete here: the search follows the answers")
    objects = gather_objects(block, restitution)
    strengths = np.asarray(require_positive_measures(suite, search.measure))
    plan = functools.partial(plan_counting, hazard)
    if level is None:
        places = np.asarray(choose_levels(hazard, levels))
        check_falling(hazard(places))
        middles = (places[1:] * places[:-1]) ** 0.5
        between = np.concatenate([places[:1], middles, places[-1:]])
    else:
        places = between = np.array([level])
    follow = functools.partial(_follow_values, objects, suite, strengths, search)
    number = objects.number
    low, high, targets = _broadcast_to_objects(number, *ends, target)
    depths = plan_depths(plan, places)
    scans = scan_values(follow, depths, len(suite), low, high, targets, search.resolution)
    found = [
        read_scan(scan, float(goal), search.along, search.side)
        for scan, goal in zip(scans, targets, strict=True)
    ]
    values = np.array([each.value for each in found])
    counted = [
        _count_at_values(follow, plan(chosen), len(suite), values, low)
        for chosen in (places, between)
    ]
    columns = max((each.crossings.size for each in found), default=0)
    crossings = np.full((number, columns), np.nan)
    for row, each in zip(crossings, found, strict=True):
        row[: each.crossings.size] = each.crossings
    dtype = np.asarray(objects.restitution).dtype
    shape = objects.shape
    arrays = {
        "value": values,
        "rate": counted[0].rate,
        "recount": counted[1].rate,
        "error": counted[0].error,
        "crossings": crossings,
    }
    real = {
        name: entries.astype(dtype).reshape((*shape, *entries.shape[1:]))
        for name, entries in arrays.items()
    }
    counts = np.array([each.crossings.size for each in found]).reshape(shape)
    reasons = tuple(each.reason for each in found)
    return RequiredValue(
        **jax.device_put({**real, "count": counts}), reasons=reasons, along=search.along
    )


def _broadcast_to_objects(number: int, *arrays: Number) -> list[np.ndarray]:
    """Give every object a value of each array; a `ValueError` if they do not fit."""
    try:
        return [np.broadcast_to(np.asarray(values, float), (number,)) for values in arrays]
    except ValueError:
        must = "bounds and target must be single ones, or one for each object"
        shapes = ", ".join(str(np.shape(values)) for values in arrays)
        raise ValueError(f"{must}, got shapes {shapes} for {number}") from None


def _follow_values(
    objects: Objects,
    suite: Suite,
    strengths: np.ndarray,
    search: _ValueSearch,
    which: np.ndarray,
    values: np.ndarray,
    levels: np.ndarray,
) -> np.ndarray:
    """Find which objects, by their numbers, overturn at values and levels."""
    dtype = np.asarray(objects.restitution).dtype
    block = objects.block
    restitution = objects.restitution
    if objects.shape:
        block, restitution = jax.tree.map(lambda leaf: leaf[which], (block, restitution))
    block, restitution = _change_number(block, restitution, search.along, values.astype(dtype))
    return find_outcomes(
        block, restitution, levels.astype(dtype), suite, strengths, search.model
    )


def _count_at_values(
    follow: Follow, counting: Counting, records: int, values: np.ndarray, low: np.ndarray
) -> CountedRate:
    """Count rates at one value of each object, at all levels; NaN where there is no value."""
    which = np.arange(values.size)
    number = counting.levels.size
    # Those without a value are followed at their lower bound, and taken out afterwards.
    exists = np.isfinite(values)
    at = np.where(exists, values, low)
    outcomes = follow(
        np.repeat(which, number), np.repeat(at, number), np.tile(counting.levels, which.size)
    )
    counted = count_rates(outcomes.reshape(records, -1, number), counting)
    return CountedRate(*(np.where(exists, entries, np.nan) for entries in counted))


def _change_number(
    block: Block, restitution: AnyArray, along: str, value: AnyArray
) -> tuple[Block, AnyArray]:
    """Give a block, or its impacts, a value of the quantity."""
    if along == "restitution":
        return block, value
    return change_block(block, along, value), restitution


@_search_value.def_jvp
def _differentiate_value(
    primals: tuple[_Numbers],
    tangents: tuple[tuple[PyTree, ...]],
    *,
    suite: Suite,
    ends: tuple[AnyArray, AnyArray],
    levels: Numbers | None,
    level: float | None,
    search: _ValueSearch,
) -> tuple[RequiredValue, RequiredValue]:
    """Differentiate the value by the implicit function theorem: the rate stays the target."""
    (numbers,) = primals
    (changes,) = tangents
    found = _search_value(
        numbers, suite=suite, ends=ends, levels=levels, level=level, search=search
    )
    value = found.value
    safe = jnp.where(jnp.isfinite(value), value, jnp.asarray(ends[0], value.dtype))

    def compute_rate(
        block: Block, restitution: Reals, hazard: Callable[..., Reals], value: Reals
    ) -> Reals:
        changed = _change_number(block, restitution, search.along, value)
        return overturning_rate(
            *changed, suite, hazard, search.measure, levels, model=search.model
        ).rate

    nothing = jax.tree.map(lambda leaf: None, found)
    # No value, or one at a bound because there is no crossing, does not move.
    still = ~jnp.isfinite(value) | (found.count == 0)
    target_change = changes[3]
    if level is not None:
        # Times the tangents, or the derivative in reverse mode would be 0.
        total = sum(jnp.sum(leaf) for leaf in jax.tree.leaves(changes))
        change = jnp.where(still, jnp.zeros_like(value), jnp.nan) * total
    else:
        domain = _QUANTITIES[search.along]
        around = jnp.clip(
            jnp.stack([safe * (1 - _OVER), safe * (1 + _OVER)]),
            1.0 if domain is AT_LEAST_ONE else 0.0,
            1.0 if domain is UNIT_INTERVAL else jnp.inf,
        )
        change = _move_value(
            compute_rate, numbers[:3], changes[:3], target_change, safe, around, still
        )
    return found, eqx.tree_at(
        lambda f: f.value, nothing, change, is_leaf=lambda leaf: leaf is None
    )


def _move_value(
    compute_rate: Callable[..., Reals],
    numbers: Sequence[object],
    changes: Sequence[object],
    target_change: Reals | None,
    value: Reals,
    around: Reals,
    still: Booleans,
) -> Reals:
    """Compute how far the value moves when numbers and the target change; NaN if not smooth.

    Those that are `still` do not move.
    """
    # The slope at the value, and over a change to either side.
    _, at_point = jax.jvp(
        functools.partial(compute_rate, *numbers), (value,), (jnp.ones_like(value),)
    )
    low, high = (compute_rate(*numbers, end) for end in around)
    over = (high - low) / (around[1] - around[0])
    smooth = (at_point != 0) & (abs(at_point - over) <= _SMOOTH * abs(over))
    _, moved = eqx.filter_jvp(
        lambda *at: compute_rate(*at, value), tuple(numbers), tuple(changes)
    )
    goal = jnp.zeros_like(value) if target_change is None else target_change
    # NaN as a factor: in place of the product it would be 0 in reverse mode.
    per_rate = jnp.where(smooth, 1 / jnp.where(smooth, at_point, 1), jnp.nan)
    per_rate = jnp.where(still, 0, per_rate)
    return (goal - (0 if moved is None else moved)) * per_rate
