"""The rate of overturning at a site, from the boundaries under each of its records."""

import math
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np

from ..block import Block
from ..ground_motion import average_directions
from ..host import Printed, format_fields, format_number
from ..impact import read_restitution
from ..overturning import Boundaries
from ..resonance import ModelLike, Nonlinear
from ..sensitivity import Uncertain
from ..validation import (
    AnyArray,
    Booleans,
    Number,
    Reals,
    check_kind,
    check_shapes,
    choose_namespace,
    is_traced,
)
from .hazard import write_years
from .not_detected import bound_not_detected
from .objects import Objects, gather_objects
from .outcome_table import OutcomeTable, compute_outcomes, tabulate_outcomes
from .site import Site
from .site_boundaries import find_boundaries_at_site


class OverturningRate(Printed, eqx.Module):
    """The rate at which a block overturns; see `overturning_rate`.

    Attributes
    ----------
    rate : Array, shape (...)
        The mean over the records [1/yr], of one block or of each object.
    contributions : Array, shape (records, ...)
        The rate if this record stood for all motions [1/yr].
    standard_error : Array, shape (...)
        Standard error of the rate, from record to record [1/yr]; NaN for one record.
    not_detected : Array, shape (...)
        Upper bound (95 %) of the error of the rate due to windows between levels that are not
        detected, and due to all levels beyond the last [1/yr].
    boundaries : Boundaries or None
        Of each record and object, in levels of the intensity measure; None with uncertain
        parameters.
    sample_rates : Array, shape (..., samples), or None
        The rate of each sample of uncertain parameters [1/yr].
    complete : Array of bool, shape (...)
        Whether no record overturns the block at the lowest level, all integrations finished,
        and all boundaries are listed. If not, the rate may be wrong.
    overturns_first : Array of bool, shape (records, ...)
        Whether each record overturns the block at the lowest level.
    last_rate : Array
        The hazard at the last level [1/yr]; a rate below it is not known.
    records : tuple of str
        Names of the records.
    directions : int
        2 if the suite has each record in both directions; their mean counts as one record.
    """

    rate: Reals
    contributions: Reals
    standard_error: Reals
    not_detected: Reals
    boundaries: Boundaries | None
    complete: Booleans
    sample_rates: Reals | None
    overturns_first: Booleans
    last_rate: Reals
    records: tuple[str, ...] = eqx.field(static=True)
    directions: int = eqx.field(static=True)

    def __str__(self) -> str:
        if np.ndim(self.rate):
            units = dict.fromkeys(("rate", "standard_error", "not_detected"), "1/yr")
            return format_fields(self, **units, complete="")
        rate = format_number(self.rate, "1/yr")
        period = ""
        if not is_traced(self.rate) and self.rate > 0:
            chance = -100 * math.expm1(-50 * float(self.rate))
            period = f", about once in {float(f'{1 / float(self.rate):.2g}'):,.0f} years"
            period += f", {chance:.2g} % in 50 years"
        lines = [f"overturns at a rate of {rate}{period}"]
        error = format_number(self.standard_error, "1/yr")
        records = f"{len(self.records) // self.directions} records"
        ways = " in both directions" * (self.directions == 2)
        if not is_traced(self) and self.rate < self.last_rate:
            years = write_years(1 / float(self.last_rate))
            lines = [f"overturns less often than once in {years} years, where the hazard ends"]
            lines.append(f"by the levels before at a rate of {rate}")
        lines.append(f"standard error {error} from {records}{ways}")
        bound = format_number(self.not_detected, "1/yr")
        changes = f"undetected windows, and levels beyond the last, change it by {bound}"
        lines.append(f"{changes} at most (95 %)")
        if self.sample_rates is not None:
            deviation = format_number(self.sample_rates.std(), "1/yr")
            samples = f"{self.sample_rates.size} samples of uncertain parameters"
            lines.append(f"standard deviation {deviation} over {samples}")
        if not is_traced(self):
            lines += self._explain()
        return "\n".join(lines)

    def _explain(self) -> list[str]:
        """List why the rate of one block may be another."""
        first = np.asarray(self.overturns_first)
        lines = []
        if first.any():
            name = self.records[int(np.argmax(first))]
            more = int(first.sum()) - 1
            also = f" (and {more} other{'s' * (more > 1)})" if more else ""
            lines.append(
                f"incomplete: record {name!r}{also} overturns it at the lowest level, so that"
                " the rate may be higher"
            )
        if self.boundaries is None:
            return lines
        unfinished = ~np.asarray(self.boundaries.complete)
        if unfinished.any():
            name = self.records[int(np.argmax(unfinished))]
            lines.append(f"incomplete: integration did not finish for record {name!r}")
        elif not self.complete and not first.any():
            lines.append("incomplete: there are more boundaries than are listed")
        if not (np.asarray(self.boundaries.count).any() or first.any()):
            lines.append("no record overturns it within the levels of the site")
        return lines


def overturning_rate(
    block: Block,
    restitution: Number,
    site: Site,
    uncertain: Uncertain | None = None,
    *,
    model: ModelLike = Nonlinear(),
    max_boundaries: int = 64,
) -> OverturningRate:
    """Compute the rate at which a block overturns, without fitting a fragility curve.

    A record that is scaled to the level x of the intensity measure overturns the block
    between its boundaries a_0 and a_1, a_2 and a_3, and so on; it survives in the windows
    between. With the hazard H(x), this record overturns the block at a rate of H(a_0) -
    H(a_1) + H(a_2) - ... per year. The rate is the mean over the records.

    Parameters
    ----------
    block : Block
        One block, or many along one axis.
    restitution : array_like
        C [-], between 0 and 1; one, or one for each block.
    site : Site
    uncertain : Uncertain, optional
        Uncertain parameters of the block, the restitution and, under a suite on a floor, the
        ``floor_period`` and ``floor_damping``. The rate is then the mean over samples as well,
        and has no derivatives.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.
    max_boundaries : int
        Number of boundaries of each record that are listed under `jit`. If there are more,
        the result is not `complete`.

    Returns
    -------
    OverturningRate

    Raises
    ------
    ValueError
        If an argument is out of range or, with uncertain parameters, an integration does not
        finish.

    Notes
    -----
    Boundaries are located to a relative 1e-9, with uncertain parameters to 1e-4. Above the
    highest level the outcome there is assumed to persist; below the lowest level the
    contribution is zero. Derivatives with respect to the block, the restitution and the
    hazard, in both modes, are those of the detected boundaries. A boundary whose derivative
    is lost in rounding adds nothing to them (see `overturning_boundaries`). For a change of
    some per cent, compare them with `rate_elasticities`.

    By Good-Turing, the hazard mass of windows hit by exactly one level estimates the mass of
    windows that were missed (I. J. Good, Biometrika 40 (1953) 237-264,
    doi:10.1093/biomet/40.3-4.237; I. J. Good and G. H. Toulmin, Biometrika 43 (1956) 45-63,
    doi:10.1093/biomet/43.1-2.45). To this estimate the bound adds two standard deviations and,
    by the rule of three, three windows as wide as the widest step at which an outcome changes.
    With uncertain
    parameters it is the mean over the samples. Windows far below the first change of outcome
    are not covered. The standard error assumes independent records. Under a suite in both
    directions the mean of both counts as one record, and the bound is the mean of the bounds
    of both directions.

    Examples
    --------
    >>> import jaxrock as jr
    >>> suite = jr.Suite([jr.Record([0.0, 4.0, 4.0, -4.0, -4.0, 0.0], time_step=0.1)])
    >>> site = jr.Site(suite, jr.Hazard(levels=[0.4, 4.0], rates=[1e-2, 1e-4]))
    >>> answer = jr.overturning_rate(jr.Block(0.1, 5.0), 0.8, site)
    >>> print(f"{answer.rate:.5f} 1/yr")
    0.00552 1/yr
    """
    check_kind("site", site, Site)
    check_kind("block", block, Block)
    restitution = read_restitution(block, restitution)
    shapes = [np.shape(leaf) for leaf in jax.tree.leaves((block, restitution))]
    if longest := next((shape for shape in shapes if len(shape) > 1), None):
        raise ValueError(
            f"block and restitution must be single or have one axis, of objects, got {longest}"
        )
    check_shapes(block=block, restitution=restitution)
    if uncertain is not None:
        check_kind("uncertain", uncertain, Uncertain)
        return _average_samples(gather_objects(block, restitution), uncertain, site, model)
    boundaries, falls = find_boundaries_at_site(
        block, restitution, site, model, max_boundaries
    )
    table = tabulate_outcomes(boundaries, falls, site)
    average = _average_traced if is_traced(table) else average_records
    means = average(table, site.suite.directions)
    return OverturningRate(
        **jax.device_put(means._asdict()),
        boundaries=boundaries,
        sample_rates=None,
        records=site.suite.names,
        directions=site.suite.directions,
    )


class RecordMeans(NamedTuple):
    """The fields of an `OverturningRate` that follow from a table of outcomes."""

    rate: AnyArray | np.floating
    contributions: AnyArray
    standard_error: AnyArray | np.floating
    not_detected: AnyArray | np.floating
    complete: AnyArray | np.bool
    overturns_first: AnyArray
    last_rate: AnyArray


def average_records(
    table: OutcomeTable, directions: int, with_samples: bool = False
) -> RecordMeans:
    """Average over the records, and before over the samples, if they are the last axis."""
    contributions = table.contributions
    overturns_first = table.overturns_first
    rates = table.rates
    if is_traced(rates):
        # The bound has no derivative where no level is alone in its window.
        rates = jax.lax.stop_gradient(rates)
    bound = bound_not_detected(table.overturned, rates, directions)
    complete = table.complete & ~overturns_first
    if with_samples:
        # A bound for each sample, then the mean: samples of one record have the same windows,
        # and do not count as more records.
        contributions, bound = (part.mean(axis=-1) for part in (contributions, bound))
        overturns_first = overturns_first.any(axis=-1)
        complete = complete.all(axis=-1)
    return RecordMeans(
        rate=contributions.mean(axis=0),
        contributions=contributions,
        standard_error=compute_standard_error(contributions, directions),
        not_detected=bound,
        complete=complete.all(axis=0),
        overturns_first=overturns_first,
        last_rate=table.rates[-1],
    )


_average_traced = eqx.filter_jit(average_records)


def compute_standard_error(contributions: AnyArray, directions: int) -> AnyArray | np.floating:
    """Compute the standard error of a mean over records (records, ...); NaN for one record.

    Only the means over the directions of a record are independent.
    """
    contributions = average_directions(contributions, directions)
    records = len(contributions)
    if records == 1:
        library = choose_namespace(contributions)
        return library.full_like(contributions[0], library.nan)
    return contributions.std(axis=0, ddof=1) / math.sqrt(records)


def _average_samples(
    objects: Objects, uncertain: Uncertain, site: Site, model: ModelLike
) -> OverturningRate:
    """Compute the rates of samples of objects, and average over them."""
    on_floor = site.suite.floor is not None
    draws = uncertain.draw(objects.block, objects.restitution, on_floor=on_floor)
    # Samples are drawn in float64, and simulated in the precision of their medians.
    dtype = np.asarray(objects.restitution).dtype
    block, restitution = jax.tree.map(
        lambda leaf: leaf.astype(dtype), (draws.block, draws.restitution)
    )
    table = compute_outcomes(block, restitution, site, model, floors=draws.floor)
    means = average_records(table, site.suite.directions, with_samples=True)
    fields = means._asdict() | {"sample_rates": table.contributions.mean(axis=0)}
    return OverturningRate(
        **jax.device_put(fields),
        boundaries=None,
        records=site.suite.names,
        directions=site.suite.directions,
    )
