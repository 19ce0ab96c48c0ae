"""The page of an inventory: a picture, the ranked table, the meanings of its columns."""

import base64
import html
import math
from typing import TYPE_CHECKING

from ..ground_motion import MEASURES
from ..risk import describe_need

if TYPE_CHECKING:
    import xarray

# A page of its own: no style, script, font or picture from elsewhere. Sizes are those of a
# printed page, on which about a dozen objects have room.
_STYLE = """
@page { size: A4; margin: 12mm; }
body { font: 9.5pt/1.3 Georgia, serif; color: #111; max-width: 186mm; margin: 0 auto; }
h1 { font-size: 15pt; margin: 0 0 2mm; }
p { margin: 0 0 2mm; }
img { display: block; width: 100%; max-height: 88mm; object-fit: contain; }
table { border-collapse: collapse; width: 100%; font-size: 8pt; margin: 2mm 0; }
th, td { padding: 0.5mm 1mm; text-align: right; border-bottom: 0.2mm solid #ccc; }
th { vertical-align: bottom; font-weight: normal; color: #555; }
td.name, th.name { text-align: left; }
tr.above td.rate { font-weight: bold; color: #8a4a10; }
tr { page-break-inside: avoid; }
dl { columns: 2; font-size: 8pt; margin: 0; }
dt { font-weight: bold; float: left; margin-right: 1.5mm; }
dd { margin: 0 0 0.7mm; break-inside: avoid; }
"""


def write_inventory_page(dataset: "xarray.Dataset", picture: bytes) -> str:
    """Write an assessed inventory as one page of HTML that needs no other file.

    Parameters
    ----------
    dataset : "xarray.Dataset"
        Of `jaxrock.risk.assess_inventory`.
    picture : bytes
        A PNG, as of `jaxrock.plot.plot_inventory`.

    Returns
    -------
    str
        The page. With about a dozen objects it fits on one sheet of A4.
    """
    target = dataset.attrs["target"]
    above = int((dataset.rate > target).sum())
    number = dataset.object.size
    objects = f"{number} object{'s' * (number > 1)}"
    verb = "overturn" if above != 1 else "overturns"
    summary = f"{above} of {objects} {verb} more often than the target of {target:g} per year"
    image = base64.b64encode(picture).decode("ascii")
    parts = [
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
        f"<title>{objects} in earthquakes</title>\n<style>{_STYLE}</style>\n</head>\n<body>",
        f"<h1>{objects} in earthquakes</h1>",
        f"<p>{summary}, once in {1 / target:,.0f} years.</p>",
        '<img alt="Objects ranked by the rate of overturning, with the target"'
        f' src="data:image/png;base64,{image}">',
        _write_table(dataset),
        _write_notes(dataset),
        _write_meanings(dataset),
        _write_assumptions(dataset),
        "</body>\n</html>\n",
    ]
    return "\n".join(parts)


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
            "Restitution: velocity after an impact over the one before it, with its coefficient"
            " of variation in brackets.",
        ),
        "uplift_intensity": (
            f"uplift [{unit}]",
            f"The {measure} from which on the block is lifted, the median over the records.",
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
            head += f", {years:,.0f} years"
        columns[f"probability {k}"] = (
            head,
            "Probability of overturning at this level, which has this return period, with its"
            " 95 % Clopper-Pearson interval.",
        )
    columns["rate"] = (
        "rate [10<sup>-4</sup>/yr]",
        "Rate of overturning, with its standard error, from record to record.",
    )
    columns["not_detected"] = (
        "not detected",
        "Upper bound (95 %) of the change of the rate by windows that were not detected.",
    )
    columns["need"] = (
        "for the target",
        "The width at this height from which on the rate stays below the target.",
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


def _write_table(dataset: "xarray.Dataset") -> str:
    """Write the ranked table."""
    columns = _name_columns(dataset)
    texts = ("name", "need", "most_important")
    mark = {name: ' class="name"' for name in texts} | {"rate": ' class="rate"'}
    heads = "".join(
        f"<th{mark.get(name, '') if name in texts else ''}>{head}</th>"
        for name, (head, _) in columns.items()
    )
    lines = ["<table>", f"<tr>{heads}</tr>"]
    for k in range(dataset.object.size):
        assessed = dataset.isel(object=k)
        cells = _write_cells(assessed)
        row = "".join(f"<td{mark.get(name, '')}>{cells[name]}</td>" for name in columns)
        kind = "above" if float(assessed.rate) > dataset.attrs["target"] else "below"
        lines.append(f'<tr class="{kind}">{row}</tr>')
    return "\n".join([*lines, "</table>"])


def _write_cells(assessed: "xarray.Dataset") -> dict[str, str]:
    """Write the cells of one object."""
    coefficient = float(assessed.coefficient_of_variation)
    restitution = f"{float(assessed.restitution):.2f}"
    if coefficient:
        restitution += f" ({100 * coefficient:.0f} %)"
    most_important = html.escape(str(assessed.most_important.values))
    if most_important in assessed.parameter.values:
        elasticity = float(assessed.elasticity.sel(parameter=most_important))
        most_important += f" ({elasticity:+.1f})"
    rate = f"{1e4 * float(assessed.rate):.3g}"
    cells = {
        "rank": f"{int(assessed['rank'])}",
        "name": html.escape(str(assessed.object.values)),
        "size": f"{float(assessed.width):.2f} &times; {float(assessed.height):.2f}",
        "restitution": restitution,
        "uplift_intensity": _write_number(assessed.uplift_intensity),
        "median": f"{_write_number(assessed['median'])} ({_write_number(assessed.dispersion)})",
        "rate": f"{rate} &plusmn; {1e4 * float(assessed.standard_error):.2g}",
        "not_detected": f"{1e4 * float(assessed.not_detected):.2g}",
        "need": html.escape(describe_need(assessed)),
        "most_important": most_important,
    }
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


def _write_number(value: "xarray.DataArray") -> str:
    """Write a number; a dash where there is none."""
    number = float(value)
    return f"{number:.2f}" if math.isfinite(number) else "&ndash;"


def list_remarks(dataset: "xarray.Dataset") -> list[str]:
    """List the remarks on objects: a remark on several of them once, with their names."""
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
    """Write the remarks on objects."""
    notes = [html.escape(remark) for remark in list_remarks(dataset)]
    return f"<p>{'; '.join(notes)}.</p>" if notes else ""


def _write_meanings(dataset: "xarray.Dataset") -> str:
    """Write the meaning of each column in a sentence."""
    # Columns of the same meaning, as probabilities at several levels, are explained together.
    heads_by_meaning: dict[str, list[str]] = {}
    for head, meaning in _name_columns(dataset).values():
        heads_by_meaning.setdefault(meaning, []).append(head)
    lines = [
        f"<dt>{', '.join(heads)}</dt><dd>{meaning}</dd>"
        for meaning, heads in heads_by_meaning.items()
    ]
    return "\n".join(["<dl>", *lines, "</dl>"])


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
    stands = "stands free, unless the table says otherwise," if wall else "stands free"
    return (
        f"<p>Assumed: every object is a rigid block that {stands} on a rigid base, rocks"
        " about the edges of its base and neither slides nor turns; where no restitution was"
        f" given, Housner&rsquo;s; the restitution stays when the width changes.{wall}{floors}"
        f" Simulated under {about['record_count']} records, each scaled to"
        f" {about['simulated_levels']} levels of the {MEASURES[about['measure']][0]}, by the"
        f" {html.escape(str(about['model']))} equation of motion; hazard:"
        f" {html.escape(str(about['hazard_curve']))}. {html.escape(str(about['source']))}.</p>"
    )
