"""The dataset of an assessed inventory, and what it says of an object in words."""

import math
from typing import TYPE_CHECKING

import numpy as np

from ..block import SIZES_IN_WORDS
from ..ground_motion import MEASURES, describe_suite
from ..host import add_names, make_dataset
from ..resonance import RockingModel
from .exceedance import describe_variable
from .hazard import Hazard, compute_return_periods, describe_end, write_years
from .inventory import Inventory
from .site import Site

if TYPE_CHECKING:
    import xarray

MEETS = "meets the target"
MISSES = "misses the target"
NOT_KNOWN = "not known"
# Parameters whose importance is told: what can be built or chosen for an object.
INVENTORY_PARAMETERS = ("width", "height", "restitution")
# Long names and units of the answers, and their dimension beside "object", if they have one;
# the unit of the measure is not known here.
_OF_MEASURE = "measure"
_WORDS: dict[str, tuple[str, ...]] = {
    "one_sided": ("whether it stands against a wall", ""),
    "floor_period": ("period of its floor, 0 on the ground floor", "s"),
    "floor_damping": ("damping ratio of its floor", "1"),
    "width": ("width of the base", "m"),
    "height": ("height, twice the height of the centre of mass", "m"),
    "slenderness": ("height over width", "1"),
    "inertia_ratio": ("inertia ratio", "1"),
    "restitution": ("restitution", "1"),
    "restitution_assumed": ("whether the restitution follows from size, none being known", ""),
    "low_restitution": ("low end of the likely restitutions, where assumed", "1"),
    "coefficient_of_variation": ("coefficient of variation of the restitution", "1"),
    "critical_angle": ("critical angle", "rad"),
    "uplift_intensity": ("median of the lognormal fragility curve of uplift", _OF_MEASURE),
    "median": ("median of the lognormal fragility curve of overturning", _OF_MEASURE),
    "dispersion": ("dispersion of the curve: standard deviation of ln(level)", "1"),
    "probability": ("probability of overturning at this level", "1", "level"),
    "probability_low": ("lower end of its Clopper-Pearson interval", "1", "level"),
    "probability_high": ("upper end of its Clopper-Pearson interval", "1", "level"),
    "rate": ("rate of overturning", "1/yr"),
    "rate_at_low_restitution": ("rate of overturning with the low restitution", "1/yr"),
    "standard_error": ("standard error of the rate, from record to record", "1/yr"),
    "not_detected": (
        "upper bound of the change by undetected windows and levels beyond the last",
        "1/yr",
    ),
    "elasticity": ("elasticity: change of the rate in % for 1 % more", "1", "parameter"),
    "required_width": ("width beyond which the rate is below the target, same height", "m"),
    "required_width_is_bound": (
        "whether the required width is the narrowest that was examined, and may be less",
        "",
    ),
    "required_width_reason": ("reason for the required width", ""),
    "probability_in_50_years": ("probability of overturning in 50 years", "1"),
    "verdict": ("whether the object meets the target, where that is known", ""),
    "need": ("change of width that the target needs, in words", ""),
    "most_important": ("parameter with the largest elasticity", ""),
    "remark": ("remark on the object", ""),
    "note": ("what else its table says of the object", "", "column"),
}


def make_inventory_dataset(
    inventory: Inventory,
    site: Site,
    target: float,
    model: RockingModel,
    reported: np.ndarray,
    answers: dict[str, np.ndarray],
) -> "xarray.Dataset":
    """Make the dataset of the answers, ranked by rate; see `assess_inventory`."""
    assert isinstance(site.hazard, Hazard)
    last_rate = float(site.rates[-1])
    answers = answers | _judge_rates(answers, target)
    order = np.argsort(-answers["rate"], kind="stable")
    measure_in_words, unit, _ = MEASURES[site.measure]
    if inventory.others:
        answers = answers | {"note": np.array([words for _, words in inventory.others]).T}
    variables = {}
    for name, values in answers.items():
        long_name, units, *along = _WORDS[name]
        described = {"long_name": long_name}
        if units:
            units = unit if units == _OF_MEASURE else units
            described = describe_variable(long_name, units)
        variables[name] = (("object", *along), values[order], described)
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
            "last_rate": last_rate,
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
        "parameter": (
            [SIZES_IN_WORDS.get(name, name) for name in INVENTORY_PARAMETERS],
            "parameter",
        ),
    }
    if inventory.others:
        names["column"] = ([name for name, _ in inventory.others], "column of the table")
    dataset = add_names(dataset, **names)
    needs = [describe_need(dataset.isel(object=k)) for k in range(len(inventory))]
    long_name, _ = _WORDS["need"]
    return dataset.assign(need=("object", needs, {"long_name": long_name}))


def _judge_rates(answers: dict[str, np.ndarray], target: float) -> dict[str, np.ndarray]:
    """Judge rates by the target.

    A verdict is not known where what was not detected, or lies beyond the end of the hazard, is
    larger than the rate or the target and may carry the rate across the target.
    """
    rate = answers["rate"]
    bound = answers["not_detected"]
    may_cross = (rate - bound <= target) & (rate + bound > target)
    is_unknown = may_cross & (bound > np.minimum(rate, target))
    verdict = np.select([is_unknown, rate > target], [NOT_KNOWN, MISSES], MEETS)
    return {"probability_in_50_years": -np.expm1(-50 * rate), "verdict": verdict}


def describe_end_of_hazard(dataset: "xarray.Dataset") -> str:
    """Describe why a verdict is not known, and what would make it known."""
    target, last_rate = (float(dataset.attrs[name]) for name in ("target", "last_rate"))
    if last_rate <= target:
        return "what was not detected may carry the rate across the target"
    return describe_end(last_rate, target)


def describe_place(answer: "xarray.Dataset") -> str:
    """Describe where one object stands, if it stands at a wall or on a floor."""
    places = ["at a wall"] * bool(answer.get("one_sided", False))
    if float(answer.get("floor_period", 0.0)):
        period, damping = float(answer.floor_period), float(answer.floor_damping)
        places.append(f"floor {period:.3g} s ({damping:.2g})")
    return ", ".join(places)


def describe_need(answer: "xarray.Dataset") -> str:
    """Describe in words whether an object needs another width for the target.

    Parameters
    ----------
    answer : "xarray.Dataset"
        Of one object, from `assess_inventory`.
    """
    required = float(answer.required_width)
    verdict = str(answer.verdict.values)
    if verdict != MISSES:
        return "suffices" if verdict == MEETS else NOT_KNOWN
    if math.isnan(required):
        return "which width suffices is not known"
    if math.isinf(required):
        return "no width suffices"
    if required > float(answer.width):
        return f"needs {round_width_up(required):.2f} m"
    # The width is sought with the median of the restitution, whose uncertainty adds to the
    # rate.
    return "misses the target only because of the uncertainty"


def round_width_up(width: float) -> float:
    """Round a width up to the next centimetre: a lower one than required does not suffice."""
    return math.ceil(100 * width - 1e-9) / 100


def describe_required_width(answer: "xarray.Dataset") -> str:
    """Describe the required width of one object as a number, "<= 0.2", "none" or "not known".

    It is a bound where the target is met even at the narrowest width that was examined.
    """
    required = float(answer.required_width)
    if not math.isfinite(required):
        return "none" if math.isinf(required) else NOT_KNOWN
    return f"{'<= ' if bool(answer.required_width_is_bound) else ''}{required:.6g}"


def describe_years(answer: "xarray.Dataset", unit: str = "") -> str:
    """Describe in how many years one object overturns once: "1,500", "1,100 to 2,000".

    There are two numbers where its restitution is assumed: those with the assumed one and with
    the low one, the smaller number first. Rates below the last one of the hazard are not known:
    "less than once in 2,475".
    """
    rates = [float(answer.rate)]
    if "rate_at_low_restitution" in answer and bool(answer.restitution_assumed):
        rates.append(float(answer.rate_at_low_restitution))
    target = 1 / float(answer.attrs["target"])
    last_rate = float(answer.attrs["last_rate"])
    years = [
        _round_years(1 / rate, target)
        for rate in sorted(rates, reverse=True)
        if rate > last_rate
    ]
    if not years and last_rate == 0:
        return "never under these records"
    if not years:
        return f"less than once in {write_years(1 / last_rate)}{unit}"
    if len(years) < len(rates):
        return f"{years[0]}{unit} or more"
    return " to ".join(dict.fromkeys(years)) + unit


def name_records(dataset: "xarray.Dataset") -> str:
    """Name the records an inventory was simulated under: their source, or their number."""
    return dataset.attrs.get("record_source", f"{dataset.attrs['record_count']} records")


def _round_years(years: float, target: float) -> str:
    """Round years to two digits, which is more than records tell: 2,500.

    More digits stand where two of them would be on the other side of the target.
    """
    rounded = float(f"{years:.2g}")
    if (rounded < target) != (years < target):
        rounded = float(f"{years:.4g}")
    return write_years(rounded)
