"""The rate of overturning at a site, from the boundaries under each of its records."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..host import Printed, format_fields, format_number
from ..impact import read_restitution
from ..overturning import Boundaries
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..sensitivity import Uncertain
from ..validation import (
    AnyArray,
    Booleans,
    Number,
    Reals,
    check_kind,
    choose_namespace,
    is_traced,
)
from .not_detected import bound_not_detected
from .objects import Objects, gather_objects
from .sample_rates import average_samples, compute_standard_error, simulate_samples
from .site import Site
from .site_boundaries import find_boundaries_at_site, pad_boundaries

# Standard error of the rate of a sample by the width of the intervals in which boundaries are
# located, relative: far less than the uncertainty that samples are there for.
_ACCURACY_OF_SAMPLES = 1e-4


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
    records: tuple[str, ...] = eqx.field(static=True)
    directions: int = eqx.field(static=True)

    def __str__(self) -> str:
        if np.ndim(self.rate):
            units = dict.fromkeys(("rate", "standard_error", "not_detected"), "1/yr")
            return format_fields(self, **units, complete="")
        rate = format_number(self.rate, "1/yr")
        period = ""
        if not is_traced(self.rate) and self.rate > 0:
            period = f", about once in {float(f'{1 / float(self.rate):.2g}'):,.0f} years"
        lines = [f"overturns at a rate of {rate}{period}"]
        error = format_number(self.standard_error, "1/yr")
        records = f"{len(self.records) // self.directions} records"
        ways = " in both directions" * (self.directions == 2)
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
    Boundaries are located to a relative 1e-9; with uncertain parameters only so closely that
    the rate is accurate to 1e-4.
    Above the highest level the outcome there is assumed to persist; below
    the lowest level the contribution is zero. Derivatives with respect to the block, the
    restitution and the hazard, in both modes, are those of the detected boundaries. A
    boundary whose derivative is lost in rounding adds nothing to them (see
    `overturning_boundaries`). For a change of some per cent, compare them with
    `rate_elasticities`.

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
    if uncertain is not None:
        check_kind("uncertain", uncertain, Uncertain)
        return _average_samples(
            gather_objects(block, restitution), uncertain, site, as_model(model)
        )
    boundaries = find_boundaries_at_site(block, restitution, site, model, max_boundaries)
    sums = _sum_boundaries(boundaries, site)
    return OverturningRate(
        **sums._asdict(),
        boundaries=boundaries,
        sample_rates=None,
        records=site.suite.names,
        directions=site.suite.directions,
    )


class _Sums(NamedTuple):
    """The fields of an `OverturningRate` that are sums over boundaries."""

    complete: AnyArray
    contributions: AnyArray
    rate: AnyArray
    standard_error: AnyArray | np.floating
    not_detected: AnyArray
    overturns_first: AnyArray


class _RateEdges(NamedTuple):
    """The fields of `Boundaries` on which rates depend, padded to few numbers of columns."""

    value: AnyArray
    overturns_beyond: AnyArray
    overturns_first: AnyArray
    complete: AnyArray
    is_listed: AnyArray


def _sum_boundaries(boundaries: Boundaries, site: Site) -> _Sums:
    """Sum the hazard over the boundaries of each record, and average over the records."""
    # Padded to a power of two of columns: traced, few programs are compiled; in NumPy, the sum
    # has the same bits whatever other objects add to the columns.
    columns = boundaries.value.shape[-1]
    room = max(8, 1 << (columns - 1).bit_length())
    padded = pad_boundaries(boundaries, room, ("value", "overturns_beyond"))
    edges = _RateEdges(
        padded.value,
        padded.overturns_beyond,
        padded.overturns_first,
        padded.complete,
        padded.count <= columns,
    )
    traced = is_traced((edges, site))
    if not traced:
        edges, rates, levels = jax.tree.map(np.asarray, (edges, site.rates, site.levels))
        # A hazard need not be defined at NaN, where there is no boundary.
        value = np.where(np.isfinite(edges.value), edges.value, levels[0])
        sums = _sum_edges(edges, site.exceed(value), rates, levels, site.suite.directions)
        return jax.device_put(sums)
    value = jnp.where(jnp.isfinite(edges.value), edges.value, site.levels[0])
    return _sum_traced(
        edges, site.hazard(value), site.rates, site.levels, site.suite.directions
    )


def _sum_edges(
    edges: _RateEdges,
    at_edges: AnyArray,
    rates: AnyArray,
    levels: AnyArray,
    directions: int,
) -> _Sums:
    """Sum the rates at the boundaries, H(a_0) - H(a_1) + ..."""
    library = choose_namespace((edges, at_edges, rates))
    exists = library.isfinite(edges.value)
    # Beyond a boundary the block overturns, or it stands again.
    signed = library.where(edges.overturns_beyond, at_edges, -at_edges)
    changes = library.where(exists, signed, 0).sum(axis=-1)
    contributions = changes + library.where(edges.overturns_first, rates[0], 0)
    # The outcome at each level, from the boundaries below it. NaN, where there is no boundary,
    # is not below anything. At a boundary itself the block stands: one that is a level is
    # below it where the block stands beyond.
    along_levels = levels.reshape(*(1 for _ in edges.value.shape), -1)
    value = edges.value[..., None]
    stands_there = (value == along_levels) & ~edges.overturns_beyond[..., None]
    before = ((value < along_levels) | stands_there).sum(axis=-2)
    overturned = (before % 2 == 1) != edges.overturns_first[..., None]
    complete = edges.complete & edges.is_listed & ~edges.overturns_first
    if library is jnp:
        # The bound has no derivative where no level is alone in its window.
        rates = jax.lax.stop_gradient(rates)
    return _Sums(
        rate=contributions.mean(axis=0),
        contributions=contributions,
        standard_error=compute_standard_error(contributions, directions),
        not_detected=bound_not_detected(overturned, rates, directions),
        complete=complete.all(axis=0),
        overturns_first=edges.overturns_first,
    )


_sum_traced = eqx.filter_jit(_sum_edges)


def _average_samples(
    objects: Objects, uncertain: Uncertain, site: Site, model: RockingModel
) -> OverturningRate:
    """Compute the rates of samples of objects, and average over them."""
    has_floor = site.suite.floor is not None
    draws = uncertain.draw(objects.block, objects.restitution, on_floor=has_floor)
    shape = draws.restitution.shape
    block, restitution, floors = jax.tree.map(
        lambda leaf: leaf.reshape(-1), (draws.block, draws.restitution, draws.floor)
    )
    simulated = simulate_samples(
        objects, block, restitution, site, model, _ACCURACY_OF_SAMPLES, floors
    )
    rates = simulated.rates
    records = simulated.cases.records
    outcomes = simulated.overturned.reshape(records, *shape, -1)
    means = average_samples(rates.contributions.reshape(records, *shape), outcomes, site)
    overturns_first = outcomes[..., 0].any(axis=-1)
    real = means._asdict() | {"sample_rates": rates.rate.reshape(shape)}
    dtype = np.asarray(objects.restitution).dtype
    fields = {name: np.asarray(value, dtype) for name, value in real.items()}
    fields |= {"overturns_first": overturns_first, "complete": ~overturns_first.any(axis=0)}
    return OverturningRate(
        **jax.device_put(fields),
        boundaries=None,
        records=site.suite.names,
        directions=site.suite.directions,
    )
