"""The rate of overturning at a site, from the boundaries under each of its records."""

import math

import equinox as eqx
import jax
import numpy as np

from ..block import Block
from ..host import Printed, format_fields
from ..impact import read_restitution
from ..overturning import Boundaries
from ..resonance import ModelLike, Nonlinear
from ..sensitivity import Uncertain
from ..validation import Booleans, Number, Reals, check_kind, is_traced
from .hazard import write_years
from .objects import draw_objects, gather_objects
from .outcome_table import average_traced, compute_outcomes, find_outcomes
from .site import Site


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

    def table(self) -> dict[str, float]:
        """List the numbers of one block by name.

        Returns
        -------
        dict
            Rates and errors [1/yr], and whether they are complete, as 0 or 1.
        """
        names = ("rate", "standard_error", "not_detected", "complete")
        return {name: np.asarray(getattr(self, name)).item() for name in names}

    def __str__(self) -> str:
        if np.ndim(self.rate) or is_traced(self):
            units = dict.fromkeys(("rate", "standard_error", "not_detected"), "1/yr")
            return format_fields(self, **units, complete="")
        rate, last_rate = float(self.rate), float(self.last_rate)
        first = f"overturns at a rate of {rate:.6g} 1/yr"
        if rate < last_rate:
            years = write_years(1 / last_rate)
            first = f"overturns less often than once in {years} years, where the hazard ends"
        elif rate:
            chance = f"{-100 * math.expm1(-50 * rate):.2g} % in 50 years"
            first += f", about once in {float(f'{1 / rate:.2g}'):,.0f} years, {chance}"
        both = " in both directions" * (self.directions == 2)
        number = f"{len(self.records) // self.directions} records{both}"
        lines = [
            first,
            f"standard error {self.standard_error:.6g} 1/yr from {number}",
            "with windows between levels, and shaking beyond the last, it changes by"
            f" {self.not_detected:.6g} 1/yr at most (95 %)",
        ]
        if self.sample_rates is not None:
            samples = f"{self.sample_rates.size} samples of uncertain parameters"
            lines.append(
                f"standard deviation {self.sample_rates.std():.6g} 1/yr over {samples}"
            )
        if not self.complete:
            overturned = [self.records[k] for k in np.flatnonzero(self.overturns_first)]
            reason = "an integration did not finish, or a boundary is not listed"
            if overturned:
                reason = f"record {overturned[0]!r} overturns it at the lowest level"
            lines.append(f"incomplete: {reason}")
        return "\n".join(lines)


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
    >>> site = jr.risk.Site(suite, jr.risk.Hazard(levels=[0.4, 4.0], rates=[1e-2, 1e-4]))
    >>> answer = jr.risk.overturning_rate(jr.Block(0.1, 5.0), 0.8, site)
    >>> print(f"{answer.rate:.5f} 1/yr")
    0.00552 1/yr
    """
    check_kind("site", site, Site)
    check_kind("block", block, Block)
    sample_rates = boundaries = None
    if uncertain is None:
        objects = block, read_restitution(block, restitution)
        if not is_traced(objects):
            objects = gather_objects(*objects)
        table, boundaries = find_outcomes(*objects, site, model, max_boundaries)
        fields = average_traced(table) if is_traced(table[:-1]) else table.average()
    else:
        objects = gather_objects(block, restitution)
        drawn = draw_objects(objects, uncertain, site.suite.floor is not None)
        table = compute_outcomes(*drawn[:2], site, model, floors=drawn[2])
        sample_rates = jax.device_put(table.contributions.mean(axis=0))
        fields = table.average(with_samples=True)
    return OverturningRate(
        **jax.device_put(fields),
        boundaries=boundaries,
        sample_rates=sample_rates,
        records=site.suite.names,
        directions=site.suite.directions,
    )
