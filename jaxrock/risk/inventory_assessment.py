"""Many objects at a site: ranked by rate, and what would bring each to a target."""

from typing import TYPE_CHECKING, NamedTuple

import jax
import numpy as np

from ..block import SIZES_IN_WORDS, Block
from ..driven import follow_batch, require_complete
from ..ground_motion import warn_of_large_intensities
from ..host import name_work, show_progress
from ..impact import compute_low_restitution
from ..numerics import bound_probabilities
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import POSITIVE, Numbers, as_real, check, check_kind
from .hazard import Hazard
from .inventory import Inventory
from .inventory_dataset import INVENTORY_PARAMETERS, make_inventory_dataset
from .inventory_groups import ObjectGroup, describe_places, group_objects
from .lognormal import BoundarySums, fit_lognormal, sum_powers
from .outcome_table import OutcomeTable, compute_outcomes
from .overturning_rate import average_records
from .rate_elasticities import compute_elasticities, list_parameters
from .required_value import search_value
from .site import Site, check_levels
from .site_boundaries import make_batch_at_site
from .uplift_levels import find_uplift_levels

if TYPE_CHECKING:
    import xarray

_CONFIDENCE = 0.95  # of the intervals of probabilities
_CHANGE = 0.1  # relative, to either side, for elasticities
# Return periods in years of the levels for probabilities: those of codes, 10 % and 2 % in 50
# years.
_RETURN_PERIODS = (475.0, 2475.0)
_RESOLUTION = 0.03  # relative, of required widths
# Widths that are examined, over the present one, and over the height. A block wider than 1.5
# times its height would need more than 1.5 g to be lifted.
_NARROWEST = 0.5
_WIDEST = 2.0
_WIDEST_OF_HEIGHT = 1.5


def assess_inventory(
    inventory: Inventory,
    site: Site,
    target: float,
    *,
    reported_levels: Numbers | None = None,
    model: ModelLike = Nonlinear(),
) -> "xarray.Dataset":
    """Rank objects by the rate at which they overturn, and find the width that each would need.

    Parameters
    ----------
    inventory : Inventory
    site : Site
        Levels 4 % apart, ``spacing=0.04``, suffice for a ranking.
    target : float
        The rate that is tolerated, greater than 0 [1/yr].
    reported_levels : array_like, shape (n,), optional
        Increasing levels of the measure for which probabilities are given. By default the
        levels with return periods of 475 and 2,475 years, where the hazard has them.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.

    Returns
    -------
    xarray.Dataset
        Over ``object``, the highest rate first, with ``rank``: ``width``, ``height``,
        ``slenderness``, ``inertia_ratio``, ``restitution``, its ``coefficient_of_variation``,
        ``restitution_assumed``, ``critical_angle``; ``uplift_intensity``, the median of the
        lognormal curve of uplift; ``median`` and ``dispersion`` of the curve of overturning;
        ``rate`` of overturning with its ``standard_error`` (from record to record) and
        ``not_detected`` (see `overturning_rate`); ``required_width``, the width at this height
        from which on the rate stays below the target, inf where there is none, with
        ``required_width_reason``, and ``required_width_is_bound`` where even the narrowest
        width that was examined meets the target; NaN where the hazard ends before the target;
        ``probability_in_50_years``; ``verdict``, whether it meets the target, which is "not
        known" where ``not_detected`` may carry the rate across; ``need`` of width in words;
        ``most_important``, the parameter with the largest elasticity; a ``remark`` on what is
        exceptional. If some objects are one-sided, ``one_sided``; if some are on floors,
        ``floor_period`` (0 on the ground floor) and ``floor_damping``; if some restitutions
        are assumed, the lower end of their range, ``low_restitution``, and
        ``rate_at_low_restitution``. Over object and ``column`` there is a ``note``, if the
        inventory has others.

        Over object and ``level``, with its ``return_period``, the ``probability`` of
        overturning, with its Clopper-Pearson interval ``probability_low`` to
        ``probability_high`` (95 %), which assumes independent records. Over object and
        ``parameter`` there is the ``elasticity``: by how many per cent the rate changes if the
        parameter changes by 1 %. It follows from the rates at a parameter 10 % lower and 10 %
        higher.

    Raises
    ------
    ValueError
        If an argument is out of range, objects are on floors where the suite of the site is
        on one already, or an integration does not finish.

    Notes
    -----
    An object on a floor is assessed under ``site.suite.on_floor(period, damping)``, with steps
    of at most 1/30 of the period: a floor of one mode with participation 1. Levels and the
    hazard are those of the ground. A one-sided object is assessed under the suite in both
    directions. An uncertain ``floor_period`` or ``floor_damping`` counts for objects on floors.

    Rates are those of `overturning_rate`, accurate to 1e-4. Uncertain parameters count in the
    rate and its errors, in the probabilities and in the lognormal curve of overturning. The
    uplift intensity, the required width and the elasticities are computed with the medians,
    and so is the rate with the low end of an assumed restitution, 0.85 times the one that
    follows from size. For an elasticity, a restitution is raised at most halfway to 1. Widths
    are examined from half the present width to the larger of twice the present width and 1.5
    times the height, at constant restitution. The answers for an object do not depend on the
    others.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> import jaxrock as jr
    >>> suite = jr.Suite([jr.Record([0.0, 4.0, 4.0, -4.0, -4.0, 0.0], time_step=0.1)])
    >>> site = jr.Site(suite, jr.Hazard(levels=[0.4, 4.0], rates=[1e-2, 1e-4]))
    >>> block = jr.Block.from_size(width=jnp.array([0.4, 0.2]), height=1.0)
    >>> objects = jr.risk.Inventory(["bust", "vase"], block, restitution=0.8)
    >>> answer = jr.risk.assess_inventory(objects, site, target=1e-3)
    >>> print(answer.object.values, (answer.required_width > answer.width).values)
    ['vase' 'bust'] [ True  True]
    """
    check_kind("inventory", inventory, Inventory)
    check_kind("site", site, Site)
    if not isinstance(site.hazard, Hazard):
        raise ValueError("site must have a Hazard, got a function")
    check("target", as_real("target", target), POSITIVE)
    # It was perhaps given as a return period.
    if target > 1:
        raise ValueError(
            f"target must be a rate of at most 1 per year, got {target:g} 1/yr; that of a return"
            f" period of {target:g} years is {1 / target:.3g} 1/yr (--target-return-period on the"
            " command line)"
        )
    model = as_model(model)
    if reported_levels is not None:
        warn_of_large_intensities("a reported level", reported_levels, site.measure)
    reported = _choose_reported_levels(site.hazard, reported_levels)
    groups = group_objects(inventory, site)
    in_turn = show_progress(groups, "groups of objects")
    separate = [_assess_group(group, target, reported, model) for group in in_turn]
    order = np.argsort(np.concatenate([group.places for group in groups]))
    answers = {
        name: np.concatenate([answer[name] for answer in separate])[order]
        for name in separate[0]
    }
    if not any(inventory.restitution_assumed):
        del answers["low_restitution"], answers["rate_at_low_restitution"]
    answers = describe_places(inventory) | answers
    return make_inventory_dataset(inventory, site, target, model, reported, answers)


def _assess_group(
    group: ObjectGroup, target: float, reported: np.ndarray, model: RockingModel
) -> dict[str, np.ndarray]:
    """Assess objects that feel the same motions."""
    inventory = group.inventory
    site = group.site
    objects = inventory.objects
    parameters = list_parameters(objects, "sides")
    table = _simulate_objects(inventory, site, reported, model)
    width = parameters["width"]
    highest = np.maximum(_WIDEST * width, _WIDEST_OF_HEIGHT * parameters["height"])
    with name_work("required width"):
        required = search_value(
            (objects.block, objects.restitution, site, np.asarray(target)),
            ends=(_NARROWEST * width, highest),
            along="width",
            model=model,
            resolution=_RESOLUTION,
        )
    elasticity = compute_elasticities(
        parameters,
        INVENTORY_PARAMETERS,
        objects.block.one_sided,
        site,
        model,
        _CHANGE,
        table.median_rate,
    ).T
    remarks = [
        "; ".join(filter(None, pair))
        for pair in zip(inventory.remarks, table.remarks, strict=True)
    ]
    narrowest = np.isfinite(required.value) & (np.asarray(required.count) == 0)
    return {
        **{name: parameters[name] for name in ("width", "height")},
        "slenderness": np.asarray(objects.block.slenderness),
        "inertia_ratio": np.asarray(objects.block.inertia_ratio),
        "restitution": parameters["restitution"],
        "restitution_assumed": np.array(inventory.restitution_assumed),
        "coefficient_of_variation": _list_coefficients(inventory),
        "critical_angle": np.asarray(objects.block.critical_angle),
        "uplift_intensity": _find_uplift_intensities(inventory.block, site, model),
        **table.answers,
        "elasticity": elasticity,
        "required_width": np.asarray(required.value),
        "required_width_is_bound": narrowest,
        "required_width_reason": np.array(required.reasons),
        "most_important": np.array([_name_most_important(row) for row in elasticity]),
        "remark": np.array(remarks),
    }


class _Simulated(NamedTuple):
    """Answers that outcomes give, and the rates with the medians of all parameters."""

    answers: dict[str, np.ndarray]
    median_rate: np.ndarray
    remarks: list[str]


def _simulate_objects(
    inventory: Inventory, site: Site, reported: np.ndarray, model: RockingModel
) -> _Simulated:
    """Simulate all objects and their samples, and sum rates, probabilities and curves."""
    objects = inventory.objects
    number = objects.number
    suite = site.suite
    sampled = (objects.block, objects.restitution, None)
    if inventory.uncertain is not None:
        draws = inventory.uncertain.draw(*sampled[:2], on_floor=suite.floor is not None)
        sampled = (draws.block, draws.restitution, draws.floor)
    # Of shape (objects, samples); without uncertainty the medians are the only sample.
    block, restitution, floors = jax.tree.map(
        lambda leaf: np.asarray(leaf, objects.restitution.dtype).reshape(number, -1), sampled
    )
    table = compute_outcomes(block, restitution, site, model, floors=floors)
    means = average_records(table, suite.directions, with_samples=True)
    median_rate = np.asarray(means.rate)
    if inventory.uncertain is not None:
        medians = compute_outcomes(objects.block, objects.restitution, site, model)
        median_rate = np.asarray(medians.contributions.mean(axis=0))
    ends = (float(site.levels[0]), float(site.levels[-1]))
    fits = [fit_lognormal(sums, ends) for sums in _sum_boundaries(table, suite.directions)]
    # A record counts by the fraction of its samples, and its directions by their mean.
    batch = make_batch_at_site(block, restitution, site, floors)
    counts = np.empty((number, reported.size))
    for k, level in enumerate(reported):
        response = follow_batch(batch.scaled(level), model)
        complete = np.asarray(response.complete).reshape(len(suite), -1).all(axis=1)
        require_complete(complete, record=suite.names)
        overturned = np.asarray(response.overturned)
        counts[:, k] = overturned.mean(axis=-1).sum(axis=0) / suite.directions
    low, high = bound_probabilities(counts, suite.recordings, _CONFIDENCE)
    answers = {
        "median": np.array([fit.median for fit in fits]),
        "dispersion": np.array([fit.dispersion for fit in fits]),
        "probability": counts / suite.recordings,
        "probability_low": low,
        "probability_high": high,
        "rate": means.rate,
        "standard_error": means.standard_error,
        "not_detected": means.not_detected,
        **_compute_rates_at_low_restitution(inventory, site, model),
    }
    remarks = [
        "; ".join(
            [f"lognormal curve: {fit.remark}"] * bool(fit.remark)
            + ["overturns at the lowest level of the site, so that the rate may be more"]
            * first
        )
        for fit, first in zip(fits, means.overturns_first.any(axis=0).tolist(), strict=True)
    ]
    return _Simulated(answers, median_rate, remarks)


def _compute_rates_at_low_restitution(
    inventory: Inventory, site: Site, model: RockingModel
) -> dict[str, np.ndarray]:
    """Compute the low ends of assumed restitutions, and the rates there; NaN of others."""
    objects = inventory.objects
    low_restitution = np.full(objects.number, np.nan)
    rate = low_restitution.copy()
    assumed = np.flatnonzero(inventory.restitution_assumed)
    if assumed.size:
        low = np.asarray(compute_low_restitution(inventory.block))[assumed]
        block = jax.tree.map(lambda leaf: leaf[assumed], objects.block)
        low_restitution[assumed] = low
        rate[assumed] = compute_outcomes(block, low, site, model).contributions.mean(axis=0)
    return {"low_restitution": low_restitution, "rate_at_low_restitution": rate}


def _sum_boundaries(table: OutcomeTable, directions: int) -> list[BoundarySums]:
    """Sum for each object what its curve is fitted to, by the mean over its samples."""
    exists = np.isfinite(table.boundaries)
    signs = np.where(exists, np.where(table.begins, 1.0, -1.0), 0.0)
    powers = sum_powers(np.where(exists, table.boundaries, 1.0), signs)
    stands_last = ~table.overturned[..., -1]
    number = table.overturns_first.shape[-1] * directions
    sums = (
        part.sum(axis=(0, 2)) / number for part in (table.overturns_first, stands_last, powers)
    )
    return [BoundarySums(*parts) for parts in zip(*sums, strict=True)]


def _list_coefficients(inventory: Inventory) -> np.ndarray:
    """List the coefficients of variation of the restitutions."""
    coefficient = 0.0
    if inventory.uncertain is not None:
        coefficients = inventory.uncertain.coefficients_of_variation
        coefficient = coefficients.get("restitution", 0.0)
    return np.broadcast_to(np.asarray(coefficient, float), (len(inventory),))


def _choose_reported_levels(hazard: Hazard, levels: Numbers | None) -> np.ndarray:
    """Choose the levels for probabilities; a `ValueError` if they are not allowed."""
    if levels is None:
        rates = np.asarray(hazard.rates, float)
        rates = rates[rates > 0]
        of_codes = np.array([1 / years for years in _RETURN_PERIODS])
        inside = of_codes[(of_codes <= rates[0]) & (of_codes >= rates[-1])]
        # A hazard that ends before both: the middle of it.
        wanted = inside if inside.size else np.sqrt(rates[:1] * rates[-1:])
        logarithms = np.log(np.asarray(hazard.levels, float)[: rates.size])
        return np.exp(np.interp(-np.log(wanted), -np.log(rates), logarithms))
    check_levels("reported_levels", levels)
    return np.asarray(levels, float)


def _find_uplift_intensities(block: Block, site: Site, model: RockingModel) -> np.ndarray:
    """Find the level that lifts each block: the median of the lognormal curve of uplift."""
    levels = find_uplift_levels(block, site.suite, np.asarray(site.intensities), model)
    return np.exp(np.log(levels).mean(axis=0))


def _name_most_important(elasticity: np.ndarray) -> str:
    """Name the parameter with the largest elasticity; "none" where the rate is 0."""
    if not np.isfinite(elasticity).any():
        return "none"
    name = INVENTORY_PARAMETERS[int(np.nanargmax(abs(elasticity)))]
    return SIZES_IN_WORDS.get(name, name)
