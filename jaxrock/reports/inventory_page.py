"""The page of an inventory: what to do first, on one sheet; pictures and details behind.

What is the same for all inventories stands in ``data/inventory_page.html``.
"""

import base64
import datetime
import html
import math
import re
from collections.abc import Callable, Sequence
from importlib.resources import files
from string import Template
from typing import TYPE_CHECKING

from ..ground_motion import MEASURES
from ..risk import (
    MISSES,
    NOT_KNOWN,
    describe_end,
    describe_place,
    describe_years,
    name_records,
    round_width_up,
    write_years,
)

if TYPE_CHECKING:
    import xarray

# A number stays in one line with its unit, or with the letter that it is a value of.
_NUMBER_WITH_UNIT = re.compile(
    r"(?<=\d) (?=(?:m/s2?|cm|m|s|1/yr|per year|years?|%)(?!\w))|(?<=\bC) (?==)|(?<=C =) (?=\d)"
)
_TIMES = "\N{MULTIPLICATION SIGN}"
_DASH = "\N{EN DASH}"
_FIRST = 5  # objects that the first sentence names
_COUNTS = {2: "two", 3: "three", 4: "four", 5: "five"}


def write_inventory_page(
    dataset: "xarray.Dataset",
    pictures: Sequence[bytes],
    *,
    title: str | None = None,
    date: datetime.date | None = None,
) -> str:
    """Write an assessed inventory as one page of HTML that needs no other file.

    Parameters
    ----------
    dataset : "xarray.Dataset"
        From `jaxrock.risk.assess_inventory`.
    pictures : sequence of bytes
        PNG files, such as those of `jaxrock.plot.plot_inventory`.
    title : str, optional
        By default the number of objects.
    date : datetime.date, optional
        Date of the page; today by default.

    Returns
    -------
    str
        The page: what to do first, a row for each object, then pictures and details.
    """
    number = dataset.object.size
    measure, unit, _ = MEASURES[dataset.attrs["measure"]]
    texts = dataset.attrs | {
        "title": title or f"{number} object{'s' * (number > 1)} in earthquakes",
        "date": (datetime.date.today() if date is None else date).isoformat(),
        "years": write_years(1 / dataset.attrs["target"]),
        # The curve itself stands with the assumptions.
        "hazard": dataset.attrs.get("hazard", dataset.attrs["hazard_curve"]),
        "records": name_records(dataset),
        "first": _write_first_sentence(dataset),
        "measure": measure,
        "unit": unit,
    }
    levels = zip(dataset.written.values, dataset.return_period.values, strict=True)
    elements = {
        "actions": _write_rows(dataset, _describe_action),
        "pictures": "\n".join(map(_write_picture, pictures)),
        "matters": '<th class="words">matters most</th>' * ("elasticity" in dataset),
        "objects": _write_rows(dataset, _describe_object),
        "levels": "".join(
            f"<th>at {html.escape(level)}, {write_years(years)} years</th>"
            for level, years in levels
        ),
        "rates": _write_rows(dataset, _describe_rates),
        "remarks": "\n".join(
            f"<li>{html.escape(remark)}</li>" for remark in list_remarks(dataset) or ["None."]
        ),
    }
    page = Template((files("jaxrock") / "data" / "inventory_page.html").read_text("utf-8"))
    escaped = {name: html.escape(str(value)) for name, value in texts.items()}
    return _NUMBER_WITH_UNIT.sub("&nbsp;", page.substitute(escaped | elements))


def _write_picture(picture: bytes) -> str:
    """Write a picture into the page."""
    image = base64.b64encode(picture).decode("ascii")
    words = "Objects ranked by the rate of overturning, with the target"
    return f'<figure><img alt="{words}" src="data:image/png;base64,{image}"></figure>'


def _write_rows(
    dataset: "xarray.Dataset", describe: Callable[["xarray.Dataset"], dict[str, str]]
) -> str:
    """Write a row for each object: its rank, its name, and cells of named kinds."""
    rows = []
    for k in range(dataset.object.size):
        answer = dataset.isel(object=k)
        cells = {
            "rank": f"{int(answer['rank'])}",
            "name": str(answer.object.values),
        }
        row = "".join(
            f'<td class="{kind}">{html.escape(cell)}</td>'
            for kind, cell in (cells | describe(answer)).items()
        )
        rows.append(f'<tr class="{str(answer.verdict.values).partition(" ")[0]}">{row}</tr>')
    return "\n".join(rows)


def _write_first_sentence(dataset: "xarray.Dataset") -> str:
    """Write what to do first, in one sentence or two."""
    above = dataset.isel(object=dataset.verdict.values == MISSES)
    unknown = dataset.object.values[dataset.verdict.values == NOT_KNOWN].tolist()
    names = [str(name) for name in above.object.values]
    years = write_years(1 / dataset.attrs["target"])
    doubt = ""
    if unknown:
        listed = ", ".join(unknown[:_FIRST]) + ", ..." * (len(unknown) > _FIRST)
        doubt = f"Not known of {listed}: {_describe_end(dataset)}."
    if not names:
        every = "it overturns" if dataset.object.size == 1 else "all objects overturn"
        return doubt or f"Nothing needs to be done: {every} at most once in {years} years."
    first = names[:_FIRST]
    widened = any(str(need).startswith("needs") for need in above.need.values[:_FIRST])
    verb = "Fix or widen" if widened else "Fix"
    listed = " and ".join(filter(None, [", ".join(first[:-1]), first[-1]]))
    remainder = f"; then {len(names) - _FIRST} more" if len(names) > _FIRST else ""
    which = f"these {_COUNTS[len(first)]}" if len(first) > 1 else "this one"
    sentence = f"{verb} {which} first: {listed}{remainder}."
    if dataset.object.size == 1:
        sentence = f"{verb} it: {listed} overturns more often than once in {years} years."
    return f"{sentence} {doubt}".rstrip()


def _describe_end(dataset: "xarray.Dataset") -> str:
    """Describe why a verdict is not known, and what would make it known."""
    return describe_end(dataset.attrs["last_rate"], dataset.attrs["target"])


def _describe_action(answer: "xarray.Dataset") -> dict[str, str]:
    """Describe what to do about one object."""
    target = float(answer.attrs["target"])
    at_low = float(answer.get("rate_at_low_restitution", math.nan))
    verdict = str(answer.verdict.values)
    need = str(answer.need.values)
    if verdict == NOT_KNOWN:
        action = f"not known: {_describe_end(answer)}"
    elif verdict != MISSES:
        action = "nothing: it meets the target"
        if at_low > target:
            action = "measure its restitution: with a low one it misses the target"
    elif need.startswith("needs"):
        action = f"fix it, or widen it to {need.removeprefix('needs ')}"
    else:
        action = "fix it" if need == MISSES else f"fix it: {need}"
    if verdict == MISSES and at_low <= target:
        action += f", unless C is {float(answer.low_restitution):.2f} or less"
    size = f"{float(answer.width):.4g} {_TIMES} {float(answer.height):.4g} m"
    return {"size": size, "rate": describe_years(answer, " years"), "words": action}


def _describe_object(answer: "xarray.Dataset") -> dict[str, str]:
    """Describe an object and what moves it."""
    coefficient = float(answer.coefficient_of_variation)
    notes = [f"{100 * coefficient:.0f} %"] * bool(coefficient)
    notes += [f"{name_theory(answer)}, assumed"] * bool(answer.restitution_assumed)
    cells = {
        "size": f"{float(answer.width):.4g} {_TIMES} {float(answer.height):.4g}",
        "words": describe_place(answer) or "free",
        "restitution": f"{float(answer.restitution):.3f}{_bracket(*notes)}",
        "uplift": _write_number(answer.uplift_intensity),
        "median": f"{_write_number(answer['median'])}{_bracket(_write_number(answer.dispersion))}",
    }
    if "elasticity" in answer:
        most = answer.elasticity[int(abs(answer.elasticity).fillna(0).argmax("parameter"))]
        number = f"{float(most):+.1f}" if math.isfinite(most) else _DASH
        cells["important"] = f"{most.parameter.values} ({number})"
    return cells


def _describe_rates(answer: "xarray.Dataset") -> dict[str, str]:
    """Describe how often and how likely an object overturns."""
    probabilities = zip(
        answer.probability.values,
        answer.probability_low.values,
        answer.probability_high.values,
        strict=True,
    )
    cells = {
        f"level{k}": f"{middle:.2f} ({low:.2f}{_DASH}{high:.2f})"
        for k, (middle, low, high) in enumerate(probabilities)
    }
    low = _DASH
    if bool(answer.restitution_assumed):
        low = f"{1e4 * float(answer.rate_at_low_restitution):.3g}"
        low += _bracket(f"{float(answer.low_restitution):.3f}")
    need = str(answer.need.values)
    if need == "suffices" and math.isfinite(float(answer.get("required_width", math.nan))):
        bound = "≤ " * bool(answer.required_width_is_bound)
        need += f" ({bound}{round_width_up(float(answer.required_width)):.2f} m)"
    rate = f"{1e4 * float(answer.rate):.3g} ± {1e4 * float(answer.standard_error):.2g}"
    if float(answer.rate) == 0:
        rate = f"< {1e4 * float(answer.attrs['last_rate']):.2g}"
    return cells | {
        "rate": rate,
        "low": low,
        "years": f"{100 * float(answer.probability_in_50_years):.2g} %",
        "bound": f"{1e4 * float(answer.not_detected):.2g}",
        "words": need,
    }


def _bracket(*notes: str) -> str:
    """Write notes in brackets, if there are any."""
    return f" ({', '.join(notes)})" if notes else ""


def _write_number(value: "xarray.DataArray") -> str:
    """Write a number; a dash where there is none."""
    return f"{float(value):.2f}" if math.isfinite(float(value)) else _DASH


def name_theory(assessed: "xarray.Dataset") -> str:
    """Name the theory that gives the restitution of one object from its size."""
    return "from size" if bool(assessed.get("one_sided", False)) else "Housner's"


def list_remarks(dataset: "xarray.Dataset") -> list[str]:
    """List what is exceptional about objects: a remark on several once, with their names."""
    names_by_remark: dict[str, list[str]] = {}
    for k, name in enumerate(dataset.object.values.tolist()):
        answer = dataset.isel(object=k)
        remarks = str(answer.remark.values).split("; ")
        if str(answer.need.values).endswith(NOT_KNOWN):
            remarks.append(f"{answer.need.values}: {_describe_end(dataset)}")
        for remark in filter(None, remarks):
            names_by_remark.setdefault(remark, []).append(name)
    return [f"{remark}: {', '.join(names)}" for remark, names in names_by_remark.items()]
