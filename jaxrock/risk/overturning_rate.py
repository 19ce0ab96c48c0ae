"""The yearly rate of overturning, from the boundaries under each record of a suite."""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..ground_motion import Suite, require_positive_measures
from ..host import Printed, format_fields, format_number
from ..overturning import Boundaries
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import (
    NON_NEGATIVE,
    POSITIVE,
    AnyArray,
    Booleans,
    Number,
    Numbers,
    Reals,
    as_name,
    as_real,
    check,
    check_kind,
    is_traced,
)
from .counted_rate import (
    Counting,
    count_rates,
    estimate_error_of_mean,
    find_outcomes,
    plan_counting,
)
from .hazard import Hazard, find_last_point
from .level_boundaries import (
    find_boundaries_in_levels,
    pad_boundaries,
    select_object,
    stack_objects,
)
from .objects import Objects, draw_objects, gather_objects
from .unseen import estimate_unseen_by_good_turing

_MEASURES = ("pga", "pgv")
_SPACING = 0.01  # relative, between levels


class OverturningRate(Printed, eqx.Module):
    """The yearly rate at which a block overturns; see `overturning_rate`.

    Attributes
    ----------
    rate : Array, shape (...)
        The mean over the records [1/yr], of one block or of each object.
    contributions : Array, shape (records, ...)
        The rate if each motion were like this record [1/yr].
    standard_error : Array, shape (...)
        Standard error of the rate, for the scatter from record to record [1/yr]; NaN for one
        record.
    unseen : Array, shape (...)
        Estimated upper limit (95 %) of the change of the rate by windows that no level hits,
        and by all levels beyond the last [1/yr].
    boundaries : Boundaries or None
        Of each record and object, in levels of the intensity measure; None with scatter, when
        the rate is counted.
    sample_rates : Array, shape (..., samples), or None
        With scatter, the rate of each sample of the uncertain numbers [1/yr].
    counting_error : Array, shape (...), or None
        With scatter, the standard error from counting at separate levels [1/yr].
    complete : Array of bool, shape (...)
        Whether no record overturns the block at the lowest level, all motions were followed to
        their ends, and all boundaries are listed. If not, the rate may be another.
    """

    rate: Reals
    contributions: Reals
    standard_error: Reals
    unseen: Reals
    boundaries: Boundaries | None
    complete: Booleans
    sample_rates: Reals | None = None
    counting_error: Reals | None = None

    def __str__(self) -> str:
        if np.ndim(self.rate):
            units = dict.fromkeys(("rate", "standard_error", "unseen"), "1/yr")
            return format_fields(self, **units, complete="")
        rate = format_number(self.rate, "1/yr")
        often = ""
        if not is_traced(self.rate) and self.rate > 0:
            often = f", about once in {float(f'{1 / float(self.rate):.2g}'):,.0f} years"
        error = format_number(self.standard_error, "1/yr")
        unseen = format_number(self.unseen, "1/yr")
        records = f"standard error {error} from {len(self.contributions)} records"
        low = "\na record overturns it at the lowest level: may be more"
        if self.boundaries is None:
            low = "" if self.complete else low
            samples = np.asarray(self.sample_rates)
            deviation = format_number(samples.std(), "1/yr")
            return (
                f"overturns at a rate of {rate}{often}\n"
                f"{records}, standard deviation {deviation} by uncertain numbers"
                f" ({samples.size} samples), up to {unseen} unseen{low}"
            )
        found = int(np.asarray(self.boundaries.count).sum())
        low = low if self.boundaries.overturns_first.any() else "\nnot complete"
        low = "" if self.complete else low
        if not found and not self.boundaries.overturns_first.any():
            low = f"{low}\nno record overturns it within the levels of the hazard"
        return (
            f"overturns at a rate of {rate}{often}\n"
            f"{records},"
            f" up to {unseen} unseen between {found} boundaries{low}"
        )


def overturning_rate(
    block: Block,
    restitution: Number,
    suite: Suite,
    hazard: Hazard | Callable[..., Reals],
    measure: str = "pgv",
    levels: Numbers | None = None,
    *,
    model: ModelLike = Nonlinear(),
    max_boundaries: int = 64,
    scatter: Mapping[str, float] | None = None,
    samples: int = 64,
    seed: int = 0,
) -> OverturningRate:
    """Compute how often a year a block overturns, without fitting a fragility curve.

    Each record, scaled to a level x of the intensity measure, overturns the block on a union
    of intervals between its boundaries a_0 < a_1 < ..., survival windows included. With the
    hazard H(x), that happens at a rate of H(a_0) - H(a_1) + ... a year. The rate is the
    mean over the records.

    Parameters
    ----------
    block : Block
        One block, or many along one axis.
    restitution : array_like
        C [-], between 0 and 1; one, or one for each block.
    suite : Suite
    hazard : Hazard or callable
        Rate of exceedance H [1/yr] of a level, which does not rise with the level.
    measure : {"pgv", "pga"}
        The intensity measure of the hazard [m/s], [m/s2].
    levels : array_like, shape (n,), optional
        Increasing levels between which boundaries are sought, inside of the hazard curve. By
        default over all of it, up to the first rate of 0, 1 % apart; needed with a hazard that
        is a function.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.
    max_boundaries : int
        How many of each record are listed under `jit`; if there are more, it is not
        `complete`.
    scatter, samples, seed : mapping, int, int
        Uncertain numbers, as in `fragility`. The rate is then the mean over samples and
        records, counted from outcomes at the levels, and has no derivatives.

    Returns
    -------
    OverturningRate

    Raises
    ------
    ValueError
        If an argument is out of range, a record has no intensity, or, with scatter, a motion
        could not be followed.

    Notes
    -----
    Levels beyond the last are taken to be like the last one, and nothing below the first
    counts. Boundaries are located to a relative 1e-9. Derivatives with respect to the block,
    the restitution and the hazard, in both modes, are those of the boundaries found; a
    boundary that rounding hides adds nothing to them (see `overturning_boundaries`). For a
    change of some per cent, compare them with `rate_elasticities`.

    The unseen part is estimated as Good and Turing estimate unseen species (I. J. Good,
    Biometrika 40 (1953) 237-264, doi:10.1093/biomet/40.3-4.237; I. J. Good and
    G. H. Toulmin, Biometrika 43 (1956) 45-63, doi:10.1093/biomet/43.1-2.45). The wider a
    window is, the more likely a level hits it. Each level that is alone in its window stands
    for half of the fall of the hazard between its neighbours; the sum of these estimates how
    wide the windows are that no level hits. For its scatter twice its standard deviation is
    added, and three windows of typical width: even if no level was
    alone in a window, up to three may still exist (the rule of three). The standard error
    takes the records for independent samples.

    Examples
    --------
    >>> import jaxrock as jr
    >>> suite = jr.Suite([jr.Record([0.0, 4.0, 4.0, -4.0, -4.0, 0.0], time_step=0.1)])
    >>> hazard = jr.Hazard(levels=[0.4, 4.0], rates=[1e-2, 1e-4])
    >>> found = jr.overturning_rate(jr.Block(0.1, 5.0), 0.8, suite, hazard)
    >>> print(f"{found.rate:.5f} 1/yr")
    0.00552 1/yr
    """
    check_kind("suite", suite, Suite)
    measure = check_hazard(hazard, measure)
    restitution = as_real("restitution", restitution)
    check_kind("block", block, Block)
    leaves = jax.tree.leaves((block, restitution))
    if any(np.ndim(leaf) > 1 for leaf in leaves):
        raise ValueError("block and restitution must be single ones or have one axis")
    if any(np.shape(record.scale) for record in suite):
        raise ValueError("scales of records must be single ones, got arrays of them")
    places = choose_levels(hazard, levels)
    at_levels = hazard(places)
    check_falling(at_levels)
    if scatter is not None:
        return _count_scattered(
            gather_objects(block, restitution),
            (scatter, samples, seed),
            suite,
            measure,
            plan_counting(hazard, np.asarray(places)),
            as_model(model),
        )
    found = find_boundaries_in_levels(
        block, restitution, suite, measure, places, model, max_boundaries
    )
    shape = found.count.shape[1:]
    if not shape:
        sums = _sum_over_records(found, hazard, at_levels, places)
    else:
        # One after the other, so that each has the bits that it has alone.
        each = [
            _sum_over_records(select_object(found, number), hazard, at_levels, places)
            for number in range(*shape)
        ]
        sums = stack_objects(each, axis=-1)
    return OverturningRate(**sums._asdict(), boundaries=found)


def _count_scattered(
    objects: Objects,
    drawing: tuple[Mapping[str, float], int, int],
    suite: Suite,
    measure: str,
    counting: Counting,
    model: RockingModel,
) -> OverturningRate:
    """Count the rates of objects with uncertain numbers, over records and samples."""
    drawn = draw_objects(objects, *drawing)
    strengths = np.asarray(require_positive_measures(suite, measure))
    levels = np.asarray(as_real("levels", counting.levels))
    shape = drawn.restitution.shape
    leaves, form = jax.tree.flatten((drawn.block, drawn.restitution))
    block, restitution = jax.tree.unflatten(
        form, [np.repeat(leaf.reshape(-1), levels.size) for leaf in leaves]
    )
    everywhere = np.tile(levels, math.prod(shape))
    outcomes = find_outcomes(block, restitution, everywhere, suite, strengths, model)
    outcomes = outcomes.reshape(len(suite), *shape, levels.size)
    counted = count_rates(outcomes, counting)
    contributions = counted.contributions.mean(axis=-1)
    number = len(suite)
    spread = np.full(objects.shape, np.nan)
    if number > 1:
        spread = contributions.std(axis=0, ddof=1) / math.sqrt(number)
    # Samples are further records to the estimate of windows, which share their levels.
    rows = np.moveaxis(outcomes, -2, 0).reshape(-1, *objects.shape, levels.size)
    rates = as_real("rates", counting.rates)
    if objects.shape:
        each = [estimate_unseen_by_good_turing(rows[:, k], rates) for k in range(shape[0])]
        unseen = np.stack([np.asarray(value) for value in each])
    else:
        unseen = np.asarray(estimate_unseen_by_good_turing(rows, rates))
    real = {
        "rate": contributions.mean(axis=0),
        "contributions": contributions,
        "standard_error": spread,
        "unseen": unseen,
        "sample_rates": counted.rate,
        "counting_error": estimate_error_of_mean(outcomes, counting),
    }
    dtype = np.asarray(objects.restitution).dtype
    real = {name: np.asarray(value, dtype) for name, value in real.items()}
    complete = ~outcomes[..., 0].any(axis=(0, -1))
    return OverturningRate(**jax.device_put({**real, "complete": complete}), boundaries=None)


def check_falling(rates: AnyArray) -> None:
    """Raise `ValueError` if the rates of a hazard at levels are concrete and rise, or are 0."""
    if is_traced(rates):
        return
    check("the rates of the hazard", rates, NON_NEGATIVE)
    values = np.asarray(as_real("rates", rates))
    if not values[0]:
        raise ValueError(
            "the rate of the hazard must be greater than 0 at the first level, got 0"
        )
    # Where a curve is level, its rates differ by what rounding makes of their logarithms.
    slack = 64 * float(np.finfo(values.dtype).eps)
    for k in np.flatnonzero(np.diff(values) > slack * values[:-1]):
        raise ValueError(
            "the rates of the hazard must fall with the level or stay, got"
            f" {values[k + 1]:.6g} after {values[k]:.6g}"
        )


def check_hazard(hazard: Hazard | Callable[..., Reals], measure: str) -> str:
    """Return the name of the measure; a `ValueError` if this is no hazard, or one of another."""
    measure = as_name("measure", measure, _MEASURES)
    check_kind("hazard", hazard, Hazard, Callable)
    if isinstance(hazard, Hazard) and hazard.measure not in (None, measure):
        raise ValueError(f"measure is {measure!r}, but the hazard is one of {hazard.measure}")
    return measure


def _sum_over_records(
    found: Boundaries, hazard: Callable[..., Reals], at_levels: Reals, places: Reals
) -> "_Sums":
    """Sum the rates at the boundaries of one object."""
    # Padded to a power of two of columns, so that few programs are compiled.
    columns = found.value.shape[-1]
    room = max(8, 1 << (columns - 1).bit_length())
    padded = pad_boundaries(found, room, ("value", "overturns_beyond"))
    levels_found = _fill_missing_levels(padded.value, places[0])
    return _sum_rates(padded, hazard(levels_found), at_levels, places)


@jax.jit
def _fill_missing_levels(value: Reals, any_level: Reals) -> Reals:
    """Put some level where there is no boundary, since a hazard need not be defined at NaN."""
    return jnp.where(jnp.isfinite(value), value, any_level)


class _Sums(NamedTuple):
    """The fields of an `OverturningRate` that are sums over boundaries."""

    complete: Booleans
    contributions: Reals
    rate: Reals
    standard_error: Reals
    unseen: Reals


@eqx.filter_jit
def _sum_rates(found: Boundaries, rates: Reals, at_levels: Reals, levels: Reals) -> _Sums:
    """Sum the rates at the boundaries of each record, and average over the records."""
    signs = jnp.where(found.overturns_beyond, 1.0, -1.0).astype(rates.dtype)
    # Beyond a boundary the block overturns, or it stands again: H(a_0) - H(a_1) + ...
    changes = jnp.where(jnp.isfinite(found.value), signs * rates, 0).sum(axis=-1)
    contributions = changes + jnp.where(found.overturns_first, at_levels[0], 0)
    number = len(contributions)
    scatter = (
        contributions.std(ddof=1) if number > 1 else jnp.full_like(contributions[0], jnp.nan)
    )
    listed = jnp.isfinite(found.value).sum(axis=-1)
    # The outcome at each level, from the boundaries below it. NaN, where there is no boundary,
    # is not below anything. At a boundary itself the block stands: a boundary that is a level
    # is below it where the block stands beyond.
    value = found.value[:, :, None]
    stands_there = (value == levels[None, None, :]) & ~found.overturns_beyond[:, :, None]
    before = ((value < levels[None, None, :]) | stands_there).sum(axis=1)
    overturned = (before % 2 == 1) != found.overturns_first[:, None]
    complete = found.complete.all() & ~found.overturns_first.any()
    return _Sums(
        rate=contributions.mean(),
        contributions=contributions,
        standard_error=scatter / math.sqrt(number),
        unseen=estimate_unseen_by_good_turing(*jax.lax.stop_gradient((overturned, at_levels))),
        complete=complete & (found.count <= listed).all(),
    )


def choose_levels(hazard: Hazard | Callable[..., Reals], levels: Numbers | None) -> Reals:
    """Choose the levels between which to seek boundaries; a `ValueError` if not allowed."""
    ends = None
    if isinstance(hazard, Hazard) and not is_traced(hazard.levels):
        ends = np.asarray(hazard.levels)[[0, -1]].tolist()
    if levels is None:
        if ends is None:
            raise ValueError("levels must be given, since the hazard is a function or traced")
        low, high = ends
        if not is_traced(hazard) and isinstance(hazard, Hazard):
            high = float(hazard.levels[find_last_point(hazard)])
        # The ends as they are: rounded ones could lie outside of the hazard curve.
        inner = np.geomspace(low, high, math.ceil(math.log(high / low) / _SPACING) + 1)
        return as_real("levels", np.concatenate([[low], inner[1:-1], [high]]))
    places = as_real("levels", levels)
    check("levels", places, POSITIVE)
    if places.ndim != 1 or len(places) < 2:
        must = "levels must be one-dimensional, of at least two values"
        raise ValueError(f"{must}, got an array of shape {places.shape}")
    if is_traced(places):
        return places
    if (np.diff(np.asarray(places)) <= 0).any():
        raise ValueError("levels must be increasing, got values that do not increase")
    # Levels that are those of the hazard up to rounding are moved onto it.
    slack = 8 * float(jnp.finfo(places.dtype).eps)
    low = float(places[0])
    high = float(places[-1])
    if ends and (low < ends[0] * (1 - slack) or high > ends[1] * (1 + slack)):
        must = f"levels must be inside of those of the hazard, {ends[0]:.6g} to {ends[1]:.6g}"
        raise ValueError(f"{must}, got {low:.6g} to {high:.6g}")
    return jnp.clip(places, *ends) if ends else places
