"""The dataset of an assessed inventory, and sentences about one object of it."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ..block import size_of
from ..ground_motion import MEASURES, describe_suite
from ..host import add_names, format_table, make_dataset
from ..resonance import RockingModel
from .fragility_curves import MEASURE_UNIT, label_variables
from .hazard import describe_end, write_years
from .inventory import Inventory
from .site import Site

if TYPE_CHECKING:
    import xarray

MEETS = "meets the target"
MISSES = "misses the target"
NOT_KNOWN = "not known"
# Dimensions, long name and unit of each answer.
_VARIABLES: dict[str, tuple[str, str, str]] = {
    "one_sided": ("object", "whether it stands against a wall", ""),
    "floor_period": ("object", "period of its floor, 0 on the ground floor", "s"),
    "floor_damping": ("object", "damping ratio of its floor", "1"),
    "width": ("object", "width of the base", "m"),
    "height": ("object", "height, twice the height of the centre of mass", "m"),
    "inertia_ratio": ("object", "inertia ratio", "1"),
    "restitution": ("object", "restitution", "1"),
    "restitution_assumed": ("object", "whether the restitution follows from size", ""),
    "low_restitution": ("object", "low end of the likely restitutions, where assumed", "1"),
    "uplift_intensity": ("object", "median of the lognormal curve of uplift", MEASURE_UNIT),
    "median": ("object", "median of the lognormal curve of overturning", MEASURE_UNIT),
    "dispersion": ("object", "dispersion of the curve: deviation of ln(level)", "1"),
    "rate": ("object", "rate of overturning", "1/yr"),
    "rate_at_low_restitution": ("object", "rate with the low restitution", "1/yr"),
    "standard_error": ("object", "standard error of the rate, over the records", "1/yr"),
    "not_detected": ("object", "bound of undetected windows and the last level", "1/yr"),
    "required_width": ("object", "width beyond which the target is met, same height", "m"),
    "probability_in_50_years": ("object", "probability of overturning in 50 years", "1"),
    "verdict": ("object", "whether it meets the target, where that is known", ""),
    "need": ("object", "change of width that the target needs, in words", ""),
    "remark": ("object", "remark on the object", ""),
    "note": ("object column", "what else its table says of the object", ""),
}


def make_inventory_dataset(
    inventory: Inventory,
    site: Site,
    target: float,
    model: RockingModel,
    answers: dict[str, np.ndarray],
) -> "xarray.Dataset":
    """Make the dataset of the answers, ranked by rate; see `assess_inventory`."""
    answers = {**_describe_objects(inventory), **answers}
    answers |= _judge_rates(answers, target)
    order = np.argsort(-answers["rate"], kind="stable")
    ranked = {name: answers[name][order] for name in _VARIABLES if name in answers}
    rank = ("object", np.arange(1, len(inventory) + 1), {"long_name": "rank"})
    attributes = {
        "measure": site.measure,
        "target": float(target),
        "last_rate": float(site.rates[-1]),
        "record_count": site.suite.recordings,
        **describe_suite(site.suite),
        "hazard_curve": str(site.hazard),
        "model": model.name,
        "simulated_levels": site.levels.size,
        **({"uncertain": str(inventory.uncertain)} if inventory.uncertain else {}),
    }
    title = "Inventory of objects, ranked by the rate of overturning"
    variables = label_variables(_VARIABLES, ranked, MEASURES[site.measure][1])
    dataset = make_dataset(title, variables, {"rank": rank}, attributes)
    names = {"object": ([inventory.names[k] for k in order], "object")}
    if inventory.others:
        names["column"] = ([name for name, _ in inventory.others], "column of the table")
    return add_names(dataset, **names)


def _describe_objects(inventory: Inventory) -> dict[str, np.ndarray]:
    """Describe the objects themselves, and where they stand."""
    names = ("one_sided", "floor_period", "restitution", "restitution_assumed")
    known = size_of(inventory.block, "sides")
    known |= {name: getattr(inventory, name) for name in names}
    is_raised = np.asarray(inventory.floor_period) > 0
    known["floor_damping"] = np.where(is_raised, inventory.floor_damping, np.nan)
    if inventory.others:
        known["note"] = np.array([texts for _, texts in inventory.others]).T
    return {name: np.asarray(values) for name, values in known.items()}


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
    required = answers.get("required_width", np.full(rate.shape, None))
    rate_at_low = answers["rate_at_low_restitution"]
    differs = (rate > target) != (rate_at_low > target)
    differs &= np.isfinite(rate_at_low) & ~is_unknown
    needs = [
        _describe_need(*row) + " (a test of its bounce could change that)" * bool(differs[k])
        for k, row in enumerate(zip(verdict, answers["width"], required, strict=True))
    ]
    return {
        "probability_in_50_years": -np.expm1(-50 * rate),
        "verdict": verdict,
        "need": np.array(needs),
    }


def _describe_need(verdict: str, width: float, required: float | None) -> str:
    """Describe in words whether an object needs another width for the target."""
    if verdict != MISSES or required is None:
        return "suffices" if verdict == MEETS else verdict
    if math.isnan(required):
        return f"required width {NOT_KNOWN}"
    if math.isinf(required):
        return "no width suffices"
    if required > width:
        # Rounded up: a lower width than required does not suffice.
        return f"needs {math.ceil(100 * required - 1e-9) / 100:.2f} m"
    # The width is sought with the median of the restitution, whose uncertainty adds to the rate.
    return "misses the target only because of the uncertainty"


def describe_place(answer: "xarray.Dataset") -> str:
    """Describe where one object stands, if it stands at a wall or on a floor."""
    period = float(answer.floor_period)
    wall = ["at a wall"] * bool(answer.one_sided)
    floor = [f"floor {period:.3g} s ({float(answer.floor_damping):.2g})"] * bool(period)
    return ", ".join(wall + floor)


def tabulate_inventory(assessed: "xarray.Dataset") -> "xarray.Dataset":
    """Make a dataset over the rank alone, with a variable for each column of notes."""
    flat = assessed.swap_dims(object="rank").reset_coords("object").rename(object="name")
    names = ["name", *(name for name in assessed.data_vars if name != "note")]
    labels = flat.column.values if "column" in flat.dims else ()
    notes = {f"note: {label}": flat.note.sel(column=label, drop=True) for label in labels}
    return flat[names].assign(notes)


def describe_inventory(assessed: "xarray.Dataset") -> str:
    """Write the ranked table of an assessed inventory, and remarks on its objects."""
    unit = MEASURES[assessed.attrs["measure"]][1]
    objects = [assessed.isel(object=k) for k in range(assessed.object.size)]
    columns: dict[str, Any] = {
        "width [m]": assessed.width.values,
        "height [m]": assessed.height.values,
        "restitution": assessed.restitution.values,
        f"median [{unit}]": assessed["median"].values,
        "rate [1/yr]": assessed.rate.values,
        "once in [yr]": [describe_years(one) for one in objects],
        "for the target": assessed.need.values.tolist(),
        "stands": [describe_place(one) or "free" for one in objects],
    }
    years = write_years(1 / assessed.attrs["target"])
    missing = f"{int((assessed.verdict == MISSES).sum())} of {len(objects)} objects"
    lines = [f"{missing} overturn more often than once in {years} years"]
    lines += [f"records: {name_records(assessed)}", assessed.attrs["hazard_curve"]]
    lines += ["needs: the width at this height from which on the target is met"]
    names = assessed.object.values.tolist()
    return "\n".join(
        [format_table("\n".join(lines), names, **columns), *list_remarks(assessed)]
    )


def list_remarks(assessed: "xarray.Dataset") -> list[str]:
    """List what is exceptional about objects, and why it is not known what some need."""
    pairs = zip(assessed.object.values, assessed.remark.values, strict=True)
    lines = [f"{name}: {remark}" for name, remark in pairs if remark]
    assumed = assessed.object.values[assessed.restitution_assumed.values]
    if assumed.size:
        lines.append(
            f"nobody gave C: years with that of theory, and with a lower one: {', '.join(assumed)}"
        )
    if any(NOT_KNOWN in need for need in assessed.need.values):
        lines.append(f"{NOT_KNOWN}: {explain_unknown(assessed)}")
    return lines


def explain_unknown(assessed: "xarray.Dataset") -> str:
    """Explain why a verdict is not known, and what would make it known."""
    return describe_end(assessed.attrs["last_rate"], assessed.attrs["target"])


def describe_years(answer: "xarray.Dataset") -> str:
    """Describe in how many years one object overturns once: "1,500", "1,100 to 2,000".

    There are two numbers where its restitution is assumed: those with the assumed one and with
    the low one, the smaller number first. Rates below the last one of the hazard are not known:
    "less than once in 2,475".
    """
    rates = [float(answer.rate)]
    if answer.restitution_assumed:
        rates.append(float(answer.rate_at_low_restitution))
    target, last_rate = answer.attrs["target"], answer.attrs["last_rate"]
    known = sorted((rate for rate in rates if rate > last_rate), reverse=True)
    if not known and last_rate == 0:
        return "never under these records"
    if not known:
        return f"less than once in {write_years(1 / last_rate)}"
    years = dict.fromkeys(_round_years(1 / rate, 1 / target) for rate in known)
    return " to ".join(years) + " or more" * (len(known) < len(rates))


def _round_years(years: float, target: float) -> str:
    """Round years to two digits, which is more than records tell: 2,500.

    More digits stand where two of them would be on the other side of the target.
    """
    rounded = float(f"{years:.2g}")
    if (rounded < target) != (years < target):
        rounded = float(f"{years:.4g}")
    return write_years(rounded)


def name_records(dataset: "xarray.Dataset") -> str:
    """Name the records an inventory was simulated under: their source, or their number."""
    return dataset.attrs.get("record_source", f"{dataset.attrs['record_count']} records")
