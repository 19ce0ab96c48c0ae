"""The yearly rate of overturning, from the boundaries under each record of a suite."""

import dataclasses
import math
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..ground_motion import Suite, require_positive_measures
from ..host import Printed, format_number
from ..overturning import Boundaries, Search, check_subject, find_boundaries
from ..resonance import ModelLike, Nonlinear
from ..validation import (
    POSITIVE,
    Booleans,
    Number,
    Numbers,
    Reals,
    as_real,
    check,
    check_kind,
    choose_namespace,
    is_traced,
)
from .hazard import Hazard

_MEASURES = ("pga", "pgv")
_SPACING = 0.01  # relative, between levels
# The rule of three: where none was seen, a Poisson variable has a mean of at most -ln(0.05),
# about 3, with a confidence of 95 % (Hanley and Lippman-Hand 1983,
# doi:10.1001/jama.1983.03330370053031).
_RULE_OF_THREE = 3


class OverturningRate(Printed, eqx.Module):
    """The yearly rate at which a block overturns; see `overturning_rate`.

    Attributes
    ----------
    rate : Array, shape ()
        The mean over the records [1/yr].
    contributions : Array, shape (records,)
        The rate if each motion were like this record [1/yr].
    standard_error : Array, shape ()
        Standard error of the rate, for the scatter from record to record [1/yr]; NaN for one
        record.
    unseen : Array, shape ()
        Estimated upper limit (95 %) of the change of the rate by windows that no level hits,
        and by all levels beyond the last [1/yr].
    boundaries : Boundaries
        Of each record, in levels of the intensity measure.
    complete : Array of bool, shape ()
        Whether no record overturns the block at the lowest level, all motions were followed to
        their ends, and all boundaries are listed. If not, the rate may be another.
    """

    rate: Reals
    contributions: Reals
    standard_error: Reals
    unseen: Reals
    boundaries: Boundaries
    complete: Booleans

    def __str__(self) -> str:
        found = int(np.asarray(self.boundaries.count).sum())
        rate = format_number(self.rate, "1/yr")
        error = format_number(self.standard_error, "1/yr")
        unseen = format_number(self.unseen, "1/yr")
        low = "\na record overturns it at the lowest level: may be more"
        low = low if self.boundaries.overturns_first.any() else "\nnot complete"
        low = "" if self.complete else low
        return (
            f"overturns at a rate of {rate}\n"
            f"standard error {error} from {len(self.contributions)} records,"
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
) -> OverturningRate:
    """Compute how often a year a block overturns, without a fit between.

    Each record, scaled to a level x of the intensity measure, overturns the block on a union
    of intervals between its boundaries a_0 < a_1 < ..., survival windows included. With the
    hazard H(x), that happens at a rate of H(a_0) - H(a_1) + ... a year. The rate is the
    mean over the records.

    Parameters
    ----------
    block : Block
        One block.
    restitution : float
        C [-], between 0 and 1.
    suite : Suite
    hazard : Hazard or callable
        Rate of exceedance H [1/yr] of a level, falling.
    measure : {"pgv", "pga"}
        The intensity measure of the hazard [m/s], [m/s2].
    levels : array_like, shape (n,), optional
        Increasing levels between which boundaries are sought, inside of the hazard curve. By
        default over all of it, 1 % apart; needed with a hazard that is a function.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.
    max_boundaries : int
        How many of each record are listed under `jit`; if there are more, it is not
        `complete`.

    Returns
    -------
    OverturningRate

    Raises
    ------
    ValueError
        If an argument is out of range, or a record has no intensity.

    Notes
    -----
    Levels beyond the last are taken to be like the last one, and nothing below the first
    counts. Derivatives with respect to the block, the restitution and the hazard, in both
    modes, are those of the boundaries found; a boundary that rounding hides adds nothing to
    them (see `overturning_boundaries`), under `jit` most boundaries of long records. For a
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
    if measure not in _MEASURES:
        raise ValueError(f"measure must be one of {', '.join(_MEASURES)}, got {measure!r}")
    check_kind("hazard", hazard, Hazard, Callable)
    if isinstance(hazard, Hazard) and hazard.measure not in (None, measure):
        raise ValueError(f"measure is {measure!r}, but the hazard is one of {hazard.measure}")
    restitution = as_real("restitution", restitution)
    shapes = [leaf.shape for leaf in jax.tree.leaves((block, restitution))]
    if any(shapes) or any(np.shape(record.scale) for record in suite):
        raise ValueError(
            "block, restitution and scales of records must be single ones, got arrays"
        )
    places = choose_levels(hazard, levels)
    at_levels = hazard(places)
    if not is_traced(at_levels):
        check("the rates of the hazard", at_levels, POSITIVE)
        if (np.diff(np.asarray(at_levels)) >= 0).any():
            raise ValueError("the rates of the hazard must fall with the level, got others")
    # Boundaries are sought along a factor on records of intensity 1, so that the factor is the
    # level itself. The derivative of a boundary that rounding decides is unknown: it is
    # dropped.
    search = Search("factor", model, max_boundaries, drop_unknown=True)
    subject, factors = check_subject(block, restitution, suite, search.along, places)
    strengths = require_positive_measures(suite, measure)
    if not is_traced(strengths):
        strengths = np.asarray(strengths)
    motion = subject.motion.scaled(1.0 / strengths)
    found = find_boundaries(dataclasses.replace(subject, motion=motion), factors, search)
    padded = _pad_boundaries(found)
    levels_found = _fill_missing_levels(padded.value, places[0])
    return OverturningRate(
        **_sum_rates(padded, hazard(levels_found), at_levels, places)._asdict(),
        boundaries=found,
    )


def _pad_boundaries(found: Boundaries) -> Boundaries:
    """Pad boundaries to a power of two of columns, so that few programs are compiled."""
    columns = found.value.shape[-1]
    room = max(8, 1 << (columns - 1).bit_length())
    namespace = choose_namespace(found)
    missing = {"value": np.nan, "overturns_beyond": False}

    def pad(name: str) -> np.ndarray | jax.Array:
        padding = [(0, 0), (0, room - columns)]
        return namespace.pad(getattr(found, name), padding, constant_values=missing[name])

    names = tuple(missing)
    return eqx.tree_at(lambda f: [getattr(f, n) for n in names], found, [*map(pad, names)])


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
    complete = found.complete.all() & ~found.overturns_first.any()
    return _Sums(
        rate=contributions.mean(),
        contributions=contributions,
        standard_error=scatter / math.sqrt(number),
        unseen=_estimate_unseen_by_good_turing(
            *jax.lax.stop_gradient((found, at_levels)), levels
        ),
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


# The population is all levels of shaking beyond the first, each counted by how often a year it
# occurs, which is how much the hazard falls there. A species is a window: a range of levels
# within which the outcome under one record differs from the outcome on both sides, be it that
# the block overturns there or that it survives. The sample is the levels at which the block
# was followed, and each belongs to the window in which it lies. The wider a window is (in rate
# of the hazard), the more likely a level hits it, as a frequent species is more likely to be
# met.
#
# Good and Turing: the species without a member in the sample have together the share N1 / N of
# the population, where N1 species have exactly one member and N is the size of the sample.
# Here a level does not stand for 1 / N but for a share of its own, half of the fall of the
# hazard between its neighbours. So the sum of these shares over the levels that are alone in
# their window estimates the width of all windows that no level hits.
#
# A window that was missed changes the rate by its width, up or down. The sum of the widths is
# thus a bound of the change, in which no signs cancel.
def _estimate_unseen_by_good_turing(found: Boundaries, rates: Reals, levels: Reals) -> Reals:
    """Estimate a bound of the change of the rate by windows between levels and levels beyond.

    After Good (1953, doi:10.1093/biomet/40.3-4.237) and Good and Toulmin (1956,
    doi:10.1093/biomet/43.1-2.45). `rates` are those of the hazard at `levels`.
    """
    # The outcome at each level, from the boundaries below it. NaN, where there is no boundary,
    # is not below anything.
    before = (found.value[:, :, None] < levels[None, None, :]).sum(axis=1)
    overturned = (before % 2 == 1) != found.overturns_first[:, None]

    # Levels alone in their window: the outcome differs from the one before and the one after.
    changed = overturned[:, 1:] != overturned[:, :-1]
    lonely = changed[:, :-1] & changed[:, 1:]
    alone = jnp.where(lonely, 0.5 * (rates[:-2] - rates[2:])[None, :], 0)
    # Twice the standard deviation of their sum, if each of them was met by chance (Poisson).
    scatter = 2 * jnp.sqrt((alone * alone).sum())

    # Without any level alone both are 0, and yet windows may have been missed: up to three,
    # each as wide as steps are where the outcome changes, or as the widest step if it never
    # does.
    steps = rates[:-1] - rates[1:]
    number = changed.sum()
    width = jnp.where(changed, steps[None, :], 0).sum()
    typical = jnp.where(
        number > 0, width / jnp.maximum(number, 1).astype(rates.dtype), steps.max()
    )
    # Averaged over the records, as the rate is. Beyond the last level anything may happen.
    return (alone.sum() + scatter + _RULE_OF_THREE * typical) / len(overturned) + rates[-1]
