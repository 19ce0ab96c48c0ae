"""The page of an inventory: what to do first, on one sheet; pictures and details behind."""

import base64
import datetime
import html
import math
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..risk import describe_years, name_records, round_width_up, write_years
from .inventory_details import write_details

if TYPE_CHECKING:
    import xarray

# A page of its own: no style, script, font or picture from elsewhere. Sizes are those of a
# printed page. A head is repeated on every sheet, and a row is never cut in two.
_STYLE = """
@page { size: A4; margin: 14mm 12mm; @bottom-right { content: counter(page); font-size: 9pt; } }
body { font: 10.5pt/1.3 Georgia, serif; color: #111; max-width: 186mm; margin: 0 auto; }
h1 { font-size: 18pt; margin: 0 0 1mm; }
h2 { font-size: 13pt; margin: 6mm 0 1mm; break-after: avoid; }
p { margin: 0 0 2mm; }
p.first { font-size: 14pt; font-weight: bold; margin: 4mm 0; }
p.about, p.below { font-size: 9.5pt; color: #333; }
figure { margin: 3mm 0; break-inside: avoid; }
img { display: block; width: 100%; }
table { border-collapse: collapse; width: 100%; margin: 2mm 0 3mm; font-size: 10pt; }
table.details { font-size: 8.5pt; }
thead { display: table-header-group; }
tr { break-inside: avoid; }
th, td { padding: 0.8mm 1.2mm; text-align: right; border-bottom: 0.2mm solid #ccc; }
td { white-space: nowrap; }
th { vertical-align: bottom; font-weight: normal; color: #444; }
th.size { white-space: nowrap; }
td.name, th.name, td.words, th.words { text-align: left; white-space: normal; }
td.need, th.need { text-align: left; }
tr.above td.rate { font-weight: bold; color: #8a4a10; }
section { break-before: page; }
div { break-inside: avoid; }
dl { columns: 2; font-size: 8.5pt; margin: 0 0 3mm; }
dt { font-weight: bold; break-after: avoid; }
dd { margin: 0 0 1mm; break-inside: avoid; }
ul { margin: 0 0 2mm; padding-left: 5mm; font-size: 9.5pt; }
"""
# A number stays in one line with its unit, or with the letter that it is a value of.
_NUMBER_WITH_UNIT = re.compile(
    r"(?<=\d) (?=(?:m/s2?|cm|m|s|1/yr|per year|years?|%)(?!\w))|(?<=\bC) (?==)|(?<=C =) (?=\d)"
)
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
        PNG files, such as those of the axes of `jaxrock.plot.plot_inventory_parts`.
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
    if title is None:
        title = f"{number} object{'s' * (number > 1)} in earthquakes"
    heading = html.escape(title)
    date = datetime.date.today() if date is None else date
    body = "\n".join(
        [
            f"<h1>{heading}</h1>",
            f'<p class="about">{date.isoformat()}. {_write_sources(dataset)}</p>',
            f'<p class="first">{html.escape(_write_first_sentence(dataset))}</p>',
            _write_actions(dataset),
            *map(_write_picture, pictures),
            f"<section>\n<h2>Details</h2>\n{write_details(dataset)}\n</section>",
        ]
    )
    return "\n".join(
        [
            '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
            f"<title>{heading}</title>\n<style>{_STYLE}</style>\n</head>\n<body>",
            _NUMBER_WITH_UNIT.sub("&nbsp;", body),
            "</body>\n</html>\n",
        ]
    )


def _write_picture(picture: bytes) -> str:
    """Write a picture into the page."""
    image = base64.b64encode(picture).decode("ascii")
    words = "Objects ranked by the rate of overturning, with the target"
    return f'<figure><img alt="{words}" src="data:image/png;base64,{image}"></figure>'


def _write_sources(dataset: "xarray.Dataset") -> str:
    """Write the target, the hazard and the records."""
    about = dataset.attrs
    # The curve itself stands with the assumptions.
    hazard = about.get("hazard", about["hazard_curve"])
    if "hazard_site" in about:
        hazard += f", site {about['hazard_site']}"
    return html.escape(
        f"Target: overturns at most once in {write_years(1 / about['target'])} years."
        f" Hazard: {hazard}. Ground motions: {name_records(dataset)}."
    )


def _write_first_sentence(dataset: "xarray.Dataset") -> str:
    """Write what to do first, in one sentence."""
    above = dataset.isel(object=dataset.rate.values > dataset.attrs["target"])
    names = [str(name) for name in above.object.values]
    years = write_years(1 / dataset.attrs["target"])
    if not names:
        every = "it overturns" if dataset.object.size == 1 else "all objects overturn"
        return f"Nothing needs to be done: {every} at most once in {years} years."
    required = above.required_width.values[:_FIRST]
    widened = (required > above.width.values[:_FIRST]) & (required < math.inf)
    verb = "Fix or widen" if widened.any() else "Fix"
    first = names[:_FIRST]
    listed = " and ".join(filter(None, [", ".join(first[:-1]), first[-1]]))
    more = len(names) - len(first)
    remainder = f"; then {more} more" if more else ""
    which = f"these {_COUNTS[len(first)]}" if len(first) > 1 else "this one"
    if dataset.object.size == 1:
        return f"{verb} it: {listed} overturns more often than once in {years} years."
    return f"{verb} {which} first: {listed}{remainder}."


def _write_actions(dataset: "xarray.Dataset") -> str:
    """Write the first table: a row for each object, and what to do about it."""
    lines = [
        "<table>\n<thead>",
        '<tr><th>rank</th><th class="name">object</th><th class="size">width &times; height</th>'
        '<th>overturns once in</th><th class="words">what to do</th></tr>',
        "</thead>\n<tbody>",
    ]
    for k in range(dataset.object.size):
        answer = dataset.isel(object=k)
        kind = "above" if float(answer.rate) > dataset.attrs["target"] else "below"
        years = describe_years(answer, " years")
        lines.append(
            f'<tr class="{kind}"><td>{int(answer["rank"])}</td>'
            f'<td class="name">{html.escape(str(answer.object.values))}</td>'
            f"<td>{float(answer.width):.4g} &times; {float(answer.height):.4g} m</td>"
            f'<td class="rate">{years}</td>'
            f'<td class="words">{html.escape(_describe_action(answer))}</td></tr>'
        )
    lines += ["</tbody>\n</table>", '<p class="below">']
    lines.append(
        "To fix an object is to hold it so that it cannot rock. Once in 475 years is an average:"
        " a chance of 10 % in 50 years."
    )
    if "rate_at_low_restitution" in dataset:
        lines.append(
            "The restitution C of an object is the part of its velocity that it keeps at an"
            " impact. Two numbers of years mean that nobody has measured C: one is for the C"
            " of theory, mostly the smaller number, the other for a low C."
        )
    return "\n".join([*lines, "</p>"])


def _describe_action(answer: "xarray.Dataset") -> str:
    """Describe what to do about one object."""
    target = float(answer.attrs["target"])
    required = float(answer.required_width)
    at_low = math.nan
    if "rate_at_low_restitution" in answer:
        at_low = float(answer.rate_at_low_restitution)
    if float(answer.rate) <= target:
        if at_low > target:
            return "measure its restitution: with a low one it misses the target"
        return "nothing: it meets the target"
    if math.isinf(required):
        action = "fix it: widening alone does not help"
    elif required > float(answer.width):
        action = f"fix it, or widen it to {round_width_up(required):.2f} m"
    else:
        action = (
            "fix it, or measure its restitution, whose uncertainty makes it miss the target"
        )
    if at_low <= target:
        action += f", unless C is {float(answer.low_restitution):.2f} or less"
    return action
