"""Many objects at a site: ranked by rate, and what would bring each to a target."""

import math
from typing import TYPE_CHECKING, NamedTuple

import jax
import numpy as np

from ..block import SIZES_IN_WORDS, Block
from ..ground_motion import MEASURES, describe_suite
from ..host import add_names, make_dataset
from ..numerics import bound_probabilities
from ..overturning import uplift_factor
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import POSITIVE, Numbers, as_real, check, check_increasing, check_kind
from .drawn_objects import draw_objects
from .exceedance import describe_variable
from .hazard import Hazard, compute_return_periods
from .inventory import Inventory
from .inventory_groups import ObjectGroup, describe_places, group_objects
from .lognormal import fit_lognormal
from .outcome_table import tabulate_outcomes
from .rate_elasticities import compute_elasticities, list_parameters
from .required_value import required_value
from .sample_rates import average_samples, simulate_samples
from .site import Site

if TYPE_CHECKING:
    import xarray

# Parameters whose importance is told: what can be built or chosen for an object.
_PARAMETERS = ("width", "height", "restitution")
_CONFIDENCE = 0.95  # of the intervals of probabilities
_CHANGE = 0.1  # relative, to either side, for elasticities
# Standard errors of rates by the width of the intervals in which boundaries are located,
# relative: of the objects, and of those that are changed for elasticities, for which it is 1 %
# of the change.
_ACCURACY = 1e-4
_ACCURACY_OF_ENDS = 2e-3
# Return periods in years of the levels for probabilities: those of codes, 10 % and 2 % in 50
# years.
_RETURN_PERIODS = (475.0, 2475.0)
_RESOLUTION = 0.03  # relative, of required widths
# Widths that are examined, over the present one, and over the height. A block wider than 1.5
# times its height would need more than 1.5 g to be lifted.
_NARROWEST = 0.5
_WIDEST = 2.0
_WIDEST_OF_HEIGHT = 1.5
# Objects whose uplift is computed at once: of one size, so that one program does for any
# number of objects.
_TOGETHER = 32
# Long names and units of the answers; the unit of the measure is not known here.
_OF_MEASURE = "measure"
_WORDS = {
    "one_sided": ("whether it stands against a wall", ""),
    "floor_period": ("period of its floor, 0 on the ground floor", "s"),
    "floor_damping": ("damping ratio of its floor", "1"),
    "width": ("width of the base", "m"),
    "height": ("height, twice that of the centre of mass", "m"),
    "slenderness": ("height over width", "1"),
    "inertia_ratio": ("inertia ratio", "1"),
    "restitution": ("restitution", "1"),
    "coefficient_of_variation": ("coefficient of variation of the restitution", "1"),
    "critical_angle": ("critical angle", "rad"),
    "uplift_intensity": ("uplift intensity, median over the records", _OF_MEASURE),
    "median": ("median of the lognormal fragility curve of overturning", _OF_MEASURE),
    "dispersion": ("dispersion of the curve: standard deviation of ln(level)", "1"),
    "probability": ("probability of overturning at this level", "1"),
    "probability_low": ("lower end of its Clopper-Pearson interval", "1"),
    "probability_high": ("upper end of its Clopper-Pearson interval", "1"),
    "rate": ("rate of overturning", "1/yr"),
    "standard_error": ("standard error of the rate, from record to record", "1/yr"),
    "not_detected": ("upper bound of the change by windows that are not detected", "1/yr"),
    "elasticity": ("change of the rate in % for 1 % more", "1"),
    "required_width": ("width at this height from which on the rate is below the target", "m"),
    "required_width_reason": ("reason of the required width", ""),
    "most_important": ("parameter with the largest elasticity", ""),
    "remark": ("what was assumed and found", ""),
}


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
        ``critical_angle``; ``uplift_intensity``, the median over the records; ``median`` and
        ``dispersion`` of the maximum-likelihood lognormal curve; ``rate`` of overturning with
        its ``standard_error`` (from record to record) and ``not_detected`` (see
        `overturning_rate`); ``required_width``, the width at this height from which on the
        rate stays below the target, inf where there is none, with ``required_width_reason``;
        ``most_important``, the parameter with the largest elasticity; a ``remark``. If some
        objects are one-sided, ``one_sided``; if some are on floors, ``floor_period`` (0 on the
        ground floor) and ``floor_damping``.

        Over object and ``level``, with its ``return_period``, the ``probability`` of
        overturning, with its Clopper-Pearson interval ``probability_low`` to
        ``probability_high`` (95 %), which assumes independent records. Over object and
        ``parameter`` the ``elasticity``, the change of the rate in per cent for one per cent,
        between the rates 10 % to either side.

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
    directions. The remark of each such object says so. An uncertain ``floor_period``
    or ``floor_damping`` counts for objects on floors.

    Rates are those of `overturning_rate`, accurate to 1e-4. Uncertain parameters enter the
    rate with its errors, the probabilities and the curve. The required width and the
    elasticities are computed with the medians. A change of a restitution ends at the latest
    halfway between its value and 1. Widths are examined from half the present width to the
    larger of twice the present width and 1.5 times the height, at constant restitution. The
    answers for an object do not depend on the others.

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
    model = as_model(model)
    reported = _choose_reported_levels(site.hazard, reported_levels)
    groups = group_objects(inventory, site)
    separate = [_assess_group(group, target, reported, model) for group in groups]
    order = np.argsort(np.concatenate([group.places for group in groups]))
    answers = {
        name: np.concatenate([answer[name] for answer in separate])[order]
        for name in separate[0]
    }
    answers = describe_places(inventory) | answers
    return _make_dataset(inventory, site, target, model, reported, answers)


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
    required = required_value(
        inventory.block,
        inventory.restitution,
        site,
        target,
        "width",
        (
            _NARROWEST * width,
            np.maximum(_WIDEST * width, _WIDEST_OF_HEIGHT * parameters["height"]),
        ),
        resolution=_RESOLUTION,
        model=model,
    )
    elasticity = compute_elasticities(
        objects,
        parameters,
        _PARAMETERS,
        site,
        model,
        _CHANGE,
        _ACCURACY_OF_ENDS,
        table.median_rate,
    ).T
    remarks = [
        "; ".join(filter(None, (before, group.remark, after)))
        for before, after in zip(inventory.remarks, table.remarks, strict=True)
    ]
    return {
        **{name: parameters[name] for name in ("width", "height")},
        "slenderness": np.asarray(objects.block.slenderness),
        "inertia_ratio": np.asarray(objects.block.inertia_ratio),
        "restitution": parameters["restitution"],
        "coefficient_of_variation": _list_coefficients(inventory),
        "critical_angle": np.asarray(objects.block.critical_angle),
        "uplift_intensity": _find_uplift_intensities(inventory.block, site, model),
        **table.answers,
        "elasticity": elasticity,
        "required_width": np.asarray(required.value),
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
    drawn = draw_objects(objects, inventory.uncertain, site.suite)
    cases, overturned, rates = simulate_samples(
        objects, drawn.block, drawn.restitution, site, model, _ACCURACY, drawn.floors
    )
    levels = np.asarray(site.levels)
    at_reported = tabulate_outcomes(cases, reported)
    # The directions of a record count as one record, by their mean.
    directions = site.suite.directions
    recordings = site.suite.recordings
    separate = []
    remarks = []
    for k in range(number):
        (samples,) = np.nonzero(drawn.owner == k)
        # The median stands first. Of samples it is not one.
        samples = samples[1:] if samples.size > 1 else samples
        outcomes = overturned[:, samples]
        means = average_samples(rates.contributions[:, samples], outcomes, site)
        # A record counts by the fraction of its samples.
        fractions = outcomes.mean(axis=1).sum(axis=0) / directions
        fit = fit_lognormal(levels, fractions, recordings)
        counts = at_reported[:, samples].mean(axis=1).sum(axis=0) / directions
        low, high = bound_probabilities(counts, recordings, _CONFIDENCE)
        separate.append(
            {
                "median": fit.median,
                "dispersion": fit.dispersion,
                "probability": counts / recordings,
                "probability_low": low,
                "probability_high": high,
                "rate": means.rate,
                "standard_error": means.standard_error,
                "not_detected": means.not_detected,
            }
        )
        words = [f"lognormal curve: {fit.remark}"] if fit.remark else []
        if outcomes[..., 0].any():
            words.append(
                "overturns at the lowest level of the site, so that the rate may be more"
            )
        remarks.append("; ".join(words))
    answers = {name: np.array([answer[name] for answer in separate]) for name in separate[0]}
    return _Simulated(answers, rates.rate[:number], remarks)


def _list_coefficients(inventory: Inventory) -> np.ndarray:
    """List the coefficients of variation of the restitutions."""
    coefficient = 0.0
    if inventory.uncertain is not None:
        coefficients = inventory.uncertain.coefficients_of_variation
        coefficient = coefficients.get("restitution", 0.0)
    return np.broadcast_to(np.asarray(coefficient, float), (len(inventory),))


def _make_dataset(
    inventory: Inventory,
    site: Site,
    target: float,
    model: RockingModel,
    reported: np.ndarray,
    answers: dict[str, np.ndarray],
) -> "xarray.Dataset":
    """Make the dataset of the answers, ranked by rate."""
    assert isinstance(site.hazard, Hazard)
    order = np.argsort(-answers["rate"], kind="stable")
    measure_in_words, unit, _ = MEASURES[site.measure]
    dims = {
        name: ("object", "level") for name in answers if name.startswith("probability")
    } | {"elasticity": ("object", "parameter")}
    variables = {}
    for name, values in answers.items():
        long_name, units = _WORDS[name]
        described = {"long_name": long_name}
        if units:
            units = unit if units == _OF_MEASURE else units
            described = describe_variable(long_name, units)
        variables[name] = (dims.get(name, ("object",)), values[order], described)
    uncertain = inventory.uncertain
    drawn: dict[str, float] = {}
    if uncertain is not None:
        for (first, second), value in uncertain.correlations.items():
            drawn[f"correlation_of_{first}_and_{second}"] = value
        drawn |= {"samples": uncertain.samples, "seed": uncertain.seed}
    assumed = {}
    if "one_sided" in answers:
        assumed["one_sided_objects"] = "under each record in both directions"
    if "floor_period" in answers:
        assumed["floors"] = "each of one mode with participation 1"
    periods = compute_return_periods(site.hazard, reported)
    dataset = make_dataset(
        "Inventory of objects, ranked by the rate of overturning",
        variables,
        {
            "level": ("level", reported, describe_variable(measure_in_words, unit)),
            "return_period": (
                "level",
                periods,
                describe_variable("return period of the level", "yr"),
            ),
            "rank": ("object", np.arange(1, len(inventory) + 1), {"long_name": "rank"}),
        },
        {
            "measure": site.measure,
            "target": float(target),
            "record_count": site.suite.recordings,
            **describe_suite(site.suite),
            "hazard_curve": str(site.hazard),
            "model": model.name,
            "simulated_levels": site.levels.size,
            **assumed,
            **drawn,
        },
    )
    names = {
        "object": ([inventory.names[k] for k in order], "object"),
        "parameter": ([SIZES_IN_WORDS.get(name, name) for name in _PARAMETERS], "parameter"),
    }
    return add_names(dataset, **names)


def describe_need(answer: "xarray.Dataset") -> str:
    """Describe in words whether an object needs another width for the target."""
    width = float(answer.width)
    required = float(answer.required_width)
    if float(answer.rate) <= float(answer.attrs["target"]):
        return "suffices"
    if math.isinf(required):
        return "no width suffices"
    if required > width:
        # Not to the nearest centimetre: a width below the required one does not suffice.
        return f"needs {math.ceil(100 * required) / 100:.2f} m"
    # The width is sought with the median of the restitution, whose uncertainty adds to the
    # rate.
    return "misses the target by the uncertainty alone"


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
    check("reported_levels", as_real("reported_levels", levels), POSITIVE)
    places = np.asarray(levels, float)
    if places.ndim != 1 or not places.size:
        raise ValueError(
            "reported_levels must be one-dimensional, of at least one value, got an array of"
            f" shape {places.shape}"
        )
    check_increasing("reported_levels", places)
    return places


def _find_uplift_intensities(block: Block, site: Site, model: RockingModel) -> np.ndarray:
    """Find the level from which on each block is lifted: the median over the records."""
    number = len(np.asarray(block.half_width))
    medians = []
    for start in range(0, number, _TOGETHER):
        # The last group is filled up with the last block.
        which = np.minimum(np.arange(start, start + _TOGETHER), number - 1)
        group = jax.tree.map(lambda leaf, which=which: np.asarray(leaf)[which], block)
        levels = [
            np.asarray(uplift_factor(group, record, model=model)) * float(intensity)
            for record, intensity in zip(site.suite, site.intensities, strict=True)
        ]
        medians.append(np.median(levels, axis=0))
    return np.concatenate(medians)[:number]


def _name_most_important(elasticity: np.ndarray) -> str:
    """Name the parameter with the largest elasticity; "none" where the rate is 0."""
    if not np.isfinite(elasticity).any():
        return "none"
    name = _PARAMETERS[int(np.nanargmax(abs(elasticity)))]
    return SIZES_IN_WORDS.get(name, name)
