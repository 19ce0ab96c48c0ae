"""The yearly rate of overturning, from the boundaries under each record of a suite."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..ground_motion import Suite, positive_measures
from ..host import Printed, shown
from ..overturning import Boundaries, Search, boundaries_of, checked
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
    is_traced,
    namespace_of,
)
from .hazard import Hazard

_MEASURES = ("pga", "pgv")
_SPACING = 0.01  # relative, between levels
_UNSEEN = 3  # of events of which none was seen in a sample, as many may be expected at 95 %


class OverturningRate(Printed, eqx.Module):
    """How often a year a block overturns; see `overturning_rate`.

    Attributes
    ----------
    rate : Array, shape ()
        The mean over the records [1/yr].
    contributions : Array, shape (records,)
        What it would be if each motion were like this record [1/yr].
    standard_error : Array, shape ()
        Of the rate, for the scatter from record to record [1/yr]; NaN for one record.
    unseen : Array, shape ()
        Estimated upper limit (95 %) of what windows that no level hits may change, and all
        that levels beyond the last may [1/yr].
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
        low = "\na record overturns it at the lowest level: may be more"
        low = low if self.boundaries.overturns_first.any() else "\nnot complete"
        low = "" if self.complete else low
        return (
            f"overturns at a rate of {shown(self.rate, '1/yr')}\n"
            f"standard error {shown(self.standard_error, '1/yr')} from {len(self.contributions)}"
            f" records, up to {shown(self.unseen, '1/yr')} unseen between {found} boundaries{low}"
        )


def overturning_rate(
    block: Block,
    restitution: Number,
    suite: Suite,
    hazard: Hazard | Callable[[Any], Any],
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
        If an argument is outside of what is allowed, or a record has no intensity.

    Notes
    -----
    What is beyond the last level is taken to be like the last level, and nothing below the
    first counts. Derivatives with respect to the block, the restitution and the hazard, in
    both modes, are those of the boundaries found; a boundary that rounding hides adds nothing
    to them (see `overturning_boundaries`), under `jit` most of those of long records. What
    they say of a change of some per cent, `rate_elasticities` compares.

    What is unseen is estimated as Good and Turing did: a level hits a window between two
    others as often as it is wide. So the windows that one level alone has hit are together as
    wide as those that none has hit, up to scatter, for which twice their standard deviation is
    added, and three windows of the usual width, since there may be so many where none was hit.
    The standard error takes the records for independent samples.

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
    places = levels_of(hazard, levels)
    at_levels = hazard(places)
    if not is_traced(at_levels):
        check("the rates of the hazard", at_levels, POSITIVE)
        if (np.diff(np.asarray(at_levels)) >= 0).any():
            raise ValueError("the rates of the hazard must fall with the level, got others")
    search = Search("factor", model, max_boundaries, drop_unknown=True)
    subject, factors = checked(block, restitution, suite, search.along, places)
    strengths = positive_measures(suite, measure)
    if not is_traced(strengths):
        strengths = np.asarray(strengths)
    motion = subject.motion.scaled(1.0 / strengths)
    found = boundaries_of(dataclasses.replace(subject, motion=motion), factors, search)
    padded = _padded(found)
    levels_found = _levels_found(padded.value, places[0])
    return OverturningRate(
        **_summed(padded, hazard(levels_found), at_levels, places),
        boundaries=found,
    )


def _padded(found: Boundaries) -> Boundaries:
    """With room for more boundaries, so that few programs are compiled."""
    columns = found.value.shape[-1]
    room = max(8, 1 << (columns - 1).bit_length())
    namespace = namespace_of(found)
    missing = {"value": np.nan, "overturns_beyond": False}

    def wide(name: str) -> Any:
        padding = [(0, 0), (0, room - columns)]
        return namespace.pad(getattr(found, name), padding, constant_values=missing[name])

    names = tuple(missing)
    return eqx.tree_at(lambda f: [getattr(f, n) for n in names], found, [*map(wide, names)])


@jax.jit
def _levels_found(value: Reals, any_level: Reals) -> Reals:
    return jnp.where(jnp.isfinite(value), value, any_level)


@eqx.filter_jit
def _summed(
    found: Boundaries, rates: Reals, at_levels: Reals, levels: Reals
) -> dict[str, Any]:
    """Compute the fields of an `OverturningRate` from hazards at boundaries and levels."""
    signs = jnp.where(found.overturns_beyond, 1.0, -1.0).astype(rates.dtype)
    changes = jnp.where(jnp.isfinite(found.value), signs * rates, 0).sum(axis=-1)
    contributions = changes + jnp.where(found.overturns_first, at_levels[0], 0)
    number = len(contributions)
    scatter = (
        contributions.std(ddof=1) if number > 1 else jnp.full_like(contributions[0], jnp.nan)
    )
    listed = jnp.isfinite(found.value).sum(axis=-1)
    complete = found.complete.all() & ~found.overturns_first.any()
    return {
        "rate": contributions.mean(),
        "contributions": contributions,
        "standard_error": scatter / math.sqrt(number),
        "unseen": _unseen(jax.lax.stop_gradient((found, at_levels)), levels),
        "complete": complete & (found.count <= listed).all(),
    }


def levels_of(hazard: Hazard | Callable[[Any], Any], levels: Numbers | None) -> Any:
    """Choose the levels between which to seek boundaries; a `ValueError` if not allowed."""
    ends = None
    if isinstance(hazard, Hazard) and not is_traced(hazard.levels):
        ends = np.asarray(hazard.levels)[[0, -1]].tolist()
    if levels is None:
        if ends is None:
            raise ValueError("levels must be given, since the hazard is a function or traced")
        low, high = ends
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
    slack = 8 * float(jnp.finfo(places.dtype).eps)
    low = float(places[0])
    high = float(places[-1])
    if ends and (low < ends[0] * (1 - slack) or high > ends[1] * (1 + slack)):
        must = f"levels must be inside of those of the hazard, {ends[0]:.6g} to {ends[1]:.6g}"
        raise ValueError(f"{must}, got {low:.6g} to {high:.6g}")
    return jnp.clip(places, *ends) if ends else places


def _unseen(found_and_rates: Any, levels: Any) -> Reals:
    """Estimate what windows that no level hits, and levels beyond, may change."""
    found, rates = found_and_rates
    # NaN is not below anything.
    before = (found.value[:, :, None] < levels[None, None, :]).sum(axis=1)
    overturned = (before % 2 == 1) != found.overturns_first[:, None]
    changed = overturned[:, 1:] != overturned[:, :-1]
    lonely = changed[:, :-1] & changed[:, 1:]
    alone = jnp.where(lonely, 0.5 * (rates[:-2] - rates[2:])[None, :], 0)
    scatter = 2 * jnp.sqrt((alone * alone).sum())
    steps = rates[:-1] - rates[1:]
    number = changed.sum()
    width = jnp.where(changed, steps[None, :], 0).sum()
    typical = jnp.where(
        number > 0, width / jnp.maximum(number, 1).astype(rates.dtype), steps.max()
    )
    return (alone.sum() + scatter + _UNSEEN * typical) / len(overturned) + rates[-1]
