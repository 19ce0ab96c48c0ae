"""The details of an inventory's page: tables, remarks, the meanings of columns, assumptions."""

import html
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from ..ground_motion import MEASURES
from ..risk import name_records, round_width_up, write_years

if TYPE_CHECKING:
    import xarray

# Columns of the first table; all others are in the second, behind rank and name.
_OF_OBJECT = ("size", "one_sided", "floor", "restitution", "uplift_intensity", "median")
_OF_OBJECT += ("most_important",)
_TEXTS = ("name", "need", "most_important")


def write_details(dataset: "xarray.Dataset") -> str:
    """Write what was computed of each object, what is exceptional, and how to read it."""
    columns = _name_columns(dataset)
    of_rates = [name for name in columns if name not in (*_OF_OBJECT, "rank", "name")]
    of_objects = [name for name in _OF_OBJECT if name in columns]
    return "\n".join(
        [
            _write_table(dataset, columns, ["rank", "name", *of_objects]),
            _write_table(dataset, columns, ["rank", "name", *of_rates]),
            _write_notes(dataset),
            _write_meanings(columns),
            _write_assumptions(dataset),
        ]
    )


def _name_columns(dataset: "xarray.Dataset") -> dict[str, tuple[str, str]]:
    """Name the columns of the table, each with its head and a sentence that explains it."""
    measure, unit, _ = MEASURES[dataset.attrs["measure"]]
    columns = {
        "rank": ("rank", "1 has the highest rate."),
        "name": ("object", "The name in the table that was read."),
        "size": (
            "width &times; height [m]",
            "The base, and twice the height of the centre of mass.",
        ),
        **_name_places(dataset),
        "restitution": (
            "C",
            "Restitution: velocity after an impact over velocity before it. In brackets its"
            " coefficient of variation or, where none was given, how it was assumed.",
        ),
        "uplift_intensity": (
            f"uplift [{unit}]",
            f"The {measure} at which half of the records lift it, by the maximum-likelihood"
            " lognormal curve.",
        ),
        "median": (
            f"median [{unit}]",
            f"The {measure} at which half of the records overturn it, by the maximum-likelihood"
            " lognormal curve, with its dispersion in brackets.",
        ),
    }
    for k, level in enumerate(dataset.level.values):
        head = f"at {level:.3g} {unit}"
        years = float(dataset.return_period[k])
        if math.isfinite(years):
            head += f", {write_years(years)} years"
        columns[f"probability {k}"] = (
            head,
            "Probability of overturning at this level, which has this return period, with its"
            " 95 % Clopper-Pearson interval.",
        )
    columns["rate"] = (
        "rate [10<sup>-4</sup>/yr]",
        "Rate of overturning, with its standard error, from record to record.",
    )
    if "rate_at_low_restitution" in dataset:
        columns["low"] = (
            "with a low C",
            "The rate with the low restitution in brackets, where C was assumed.",
        )
    columns["not_detected"] = (
        "not detected",
        "Upper bound (95 %) of the change of the rate by undetected survival or overturning"
        " windows, and by levels beyond the last.",
    )
    columns["need"] = (
        "for the target",
        "The width that the target needs at this height: with it and with any larger width the"
        " rate stays below the target. In brackets where the present width suffices.",
    )
    columns["most_important"] = (
        "matters most",
        "The parameter with the largest elasticity: the change of the rate in % for 1 % more.",
    )
    return columns


def _name_places(dataset: "xarray.Dataset") -> dict[str, tuple[str, str]]:
    """Name the columns about walls and floors, as far as objects stand there."""
    columns = {}
    if "one_sided" in dataset:
        columns["one_sided"] = (
            "at a wall",
            "Whether it stands against a wall, and rocks to the other side only.",
        )
    if "floor_period" in dataset:
        columns["floor"] = (
            "floor [s]",
            "Period of its floor, with its damping ratio in brackets; a dash on the ground.",
        )
    return columns


def _write_table(
    dataset: "xarray.Dataset", columns: Mapping[str, tuple[str, str]], names: list[str]
) -> str:
    """Write a table with the columns of these names."""
    mark = {name: ' class="words"' for name in _TEXTS}
    mark |= {"rate": ' class="rate"', "need": ' class="need"'}
    heads = "".join(
        f"<th{mark[name] if name in _TEXTS else ''}>{columns[name][0]}</th>" for name in names
    )
    lines = [f'<table class="details">\n<thead>\n<tr>{heads}</tr>\n</thead>\n<tbody>']
    for k in range(dataset.object.size):
        answer = dataset.isel(object=k)
        cells = _write_cells(answer)
        row = "".join(f"<td{mark.get(name, '')}>{cells[name]}</td>" for name in names)
        kind = "above" if float(answer.rate) > dataset.attrs["target"] else "below"
        lines.append(f'<tr class="{kind}">{row}</tr>')
    return "\n".join([*lines, "</tbody>\n</table>"])


def _write_cells(assessed: "xarray.Dataset") -> dict[str, str]:
    """Write the cells of one object."""
    coefficient = float(assessed.coefficient_of_variation)
    notes = [f"{100 * coefficient:.0f} %"] if coefficient else []
    if bool(assessed.restitution_assumed):
        notes.append(f"{name_theory(assessed)}, assumed")
    restitution = f"{float(assessed.restitution):.3f}"
    if notes:
        restitution += f" ({html.escape(', '.join(notes))})"
    most_important = html.escape(str(assessed.most_important.values))
    if most_important in assessed.parameter.values:
        elasticity = float(assessed.elasticity.sel(parameter=most_important))
        most_important += f" ({elasticity:+.1f})"
    rate = f"{1e4 * float(assessed.rate):.3g}"
    cells = {
        "rank": f"{int(assessed['rank'])}",
        "name": html.escape(str(assessed.object.values)),
        "size": f"{float(assessed.width):.4g} &times; {float(assessed.height):.4g}",
        "restitution": restitution,
        "uplift_intensity": _write_number(assessed.uplift_intensity),
        "median": f"{_write_number(assessed['median'])} ({_write_number(assessed.dispersion)})",
        "rate": f"{rate} &plusmn; {1e4 * float(assessed.standard_error):.2g}",
        "not_detected": f"{1e4 * float(assessed.not_detected):.2g}",
        "need": _describe_need_and_width(assessed),
        "most_important": most_important,
    }
    if "rate_at_low_restitution" in assessed:
        low = f"{1e4 * float(assessed.rate_at_low_restitution):.3g}"
        low += f" ({float(assessed.low_restitution):.3f})"
        cells["low"] = low if bool(assessed.restitution_assumed) else "&ndash;"
    if "one_sided" in assessed:
        cells["one_sided"] = "yes" if bool(assessed.one_sided) else "no"
    if "floor_period" in assessed:
        floor = f"{float(assessed.floor_period):.3g} ({float(assessed.floor_damping):.2g})"
        cells["floor"] = floor if float(assessed.floor_period) else "&ndash;"
    for k in range(assessed.level.size):
        low, middle, high = (
            f"{float(assessed[name][k]):.2f}"
            for name in ("probability_low", "probability", "probability_high")
        )
        cells[f"probability {k}"] = f"{middle} ({low}&ndash;{high})"
    return cells


def name_theory(assessed: "xarray.Dataset") -> str:
    """Name the theory that gives the restitution of one object from its size."""
    one_sided = "one_sided" in assessed and bool(assessed.one_sided)
    return "from size" if one_sided else "Housner's"


def _describe_need_and_width(assessed: "xarray.Dataset") -> str:
    """Describe what the target needs, and the width that does where the present one does."""
    need = html.escape(str(assessed.need.values))
    if need != "suffices":
        return need
    bound = "&le; " if bool(assessed.required_width_is_bound) else ""
    return f"{need} ({bound}{round_width_up(float(assessed.required_width)):.2f} m)"


def _write_number(value: "xarray.DataArray") -> str:
    """Write a number; a dash where there is none."""
    number = float(value)
    return f"{number:.2f}" if math.isfinite(number) else "&ndash;"


def list_remarks(dataset: "xarray.Dataset") -> list[str]:
    """List what is exceptional about objects: a remark on several once, with their names."""
    names_by_remark: dict[str, list[str]] = {}
    reasons = []
    for k, name in enumerate(dataset.object.values.tolist()):
        assessed = dataset.isel(object=k)
        for remark in filter(None, str(assessed.remark.values).split("; ")):
            names_by_remark.setdefault(remark, []).append(name)
        if math.isinf(float(assessed.required_width)):
            reasons.append(f"{name}: {assessed.required_width_reason.values}")
    remarks = [f"{remark}: {', '.join(names)}" for remark, names in names_by_remark.items()]
    return [*reasons, *remarks]


def _write_notes(dataset: "xarray.Dataset") -> str:
    """Write what is exceptional about objects."""
    notes = [f"<li>{html.escape(remark)}</li>" for remark in list_remarks(dataset)]
    return "\n".join(["<h2>Remarks</h2>\n<ul>", *notes, "</ul>"]) if notes else ""


def _write_meanings(columns: Mapping[str, tuple[str, str]]) -> str:
    """Write the meaning of each column in a sentence."""
    # Columns of the same meaning, as probabilities at several levels, are explained together.
    heads_by_meaning: dict[str, list[str]] = {}
    for head, meaning in columns.values():
        heads_by_meaning.setdefault(meaning, []).append(head)
    lines = [
        f"<dt>{', '.join(heads)}</dt><dd>{meaning}</dd>"
        for meaning, heads in heads_by_meaning.items()
    ]
    return "\n".join(["<div>\n<h2>The columns</h2>\n<dl>", *lines, "</dl>\n</div>"])


def _write_assumptions(dataset: "xarray.Dataset") -> str:
    """Write the assumptions, and the inputs of the simulations."""
    about = dataset.attrs
    wall = ""
    if "one_sided" in dataset:
        wall = (
            " Objects against a wall rock about their outer edge, and each impact throws them"
            " back; where no restitution was given, it follows from their size. Each record"
            " acts on them in both directions."
        )
    floors = ""
    if "floor_period" in dataset:
        floors = (
            " An upper floor moves as a linear oscillator of its period and damping on the"
            f" ground, to which the {MEASURES[about['measure']][0]} and the hazard belong; the"
            " objects do not act back on it."
        )
    records = f"{about['record_count']} records"
    stands = "stands free, unless the table says otherwise," if wall else "stands free"
    return (
        f"<h2>Assumptions</h2>\n<p>Every object is a rigid block that {stands} on a rigid base,"
        " rocks about the edges of its base and neither slides nor turns; where no restitution"
        " was given, it is assumed to be Housner&rsquo;s, which is a high one; the restitution"
        f" stays when the width changes.{wall}{floors}"
        f" Simulated under {html.escape(name_records(dataset))}; each"
        f" of {records} scaled to"
        f" {about['simulated_levels']} levels of the {MEASURES[about['measure']][0]}, by the"
        f" {html.escape(str(about['model']))} equation of motion, for a"
        f" {html.escape(str(about['hazard_curve']))}. {html.escape(str(about['source']))}.</p>"
    )
