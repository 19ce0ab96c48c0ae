"""The page of an inventory: what to do first, on one sheet; pictures and details behind.

What is the same for all inventories stands in ``data/inventory_page.html``, with a row of each
table: numbers of the dataset by their names, and what is said in words here.
"""

import base64
import datetime
import html
import re
from collections.abc import Sequence
from importlib.resources import files
from string import Template
from typing import TYPE_CHECKING

from ..ground_motion import MEASURES
from .hazard import write_years
from .inventory_dataset import (
    MISSES,
    NOT_KNOWN,
    describe_place,
    describe_years,
    explain_unknown,
    list_remarks,
    name_records,
)

if TYPE_CHECKING:
    import xarray

_ROW = re.compile("<!-- a row for each object -->\n(.*?)<!-- end -->\n", re.DOTALL)


def write_inventory_page(dataset: "xarray.Dataset", pictures: Sequence[bytes]) -> str:
    """Write an assessed inventory as one page of HTML that needs no other file.

    Parameters
    ----------
    dataset : "xarray.Dataset"
        From `jaxrock.risk.assess_inventory`.
    pictures : sequence of bytes
        PNG files, such as those of `jaxrock.plot.plot_inventory`.

    Returns
    -------
    str
        The page: what to do first, a row for each object, then pictures and details.
    """
    texts = dataset.attrs | {
        "title": f"Objects in earthquakes: {dataset.object.size}",
        "date": datetime.date.today(),
        "years": write_years(1 / dataset.attrs["target"]),
        "records": name_records(dataset),
        "first": _write_first_sentence(dataset),
        "measure": MEASURES[dataset.attrs["measure"]][0],
        "unit": MEASURES[dataset.attrs["measure"]][1],
        "remarks": "\n".join(list_remarks(dataset)) or "None.",
    }
    texts = {name: html.escape(str(text)) for name, text in texts.items()}
    images = [base64.b64encode(picture).decode() for picture in pictures]
    start = '<img alt="Objects ranked by their rates" src="data:image/png;base64,'
    texts["pictures"] = "".join(f'{start}{image}">' for image in images)
    rows = [_describe_object(dataset.isel(object=k)) for k in range(dataset.object.size)]
    page = Template((files("jaxrock") / "data" / "inventory_page.html").read_text("utf-8"))
    text = _ROW.sub(lambda row: "".join(map(row[1].format_map, rows)), page.substitute(texts))
    return text.replace(">nan<", "><")


def _describe_object(answer: "xarray.Dataset") -> dict[str, object]:
    """Describe an object by its numbers, and by what the page says of it in words."""
    numbers = {str(name): a.item() for name, a in answer.data_vars.items() if not a.ndim}
    return numbers | {
        "rank": int(answer["rank"]),
        "name": html.escape(answer.object.item()),
        "years": describe_years(answer),
        "place": describe_place(answer) or "free",
        "assumed": "(assumed)" if answer.restitution_assumed else "",
    }


def _write_first_sentence(dataset: "xarray.Dataset") -> str:
    """Write what to do first, in one sentence or two."""
    starts = {
        MISSES: "Fix or widen first",
        NOT_KNOWN: f"Not known ({explain_unknown(dataset)})",
    }
    sentences = []
    for verdict, start in starts.items():
        names = dataset.object.values[dataset.verdict.values == verdict].tolist()
        more = f", and {len(names) - 5} more" if len(names) > 5 else ""
        sentences += [f"{start}: {', '.join(names[:5])}{more}."] * bool(names)
    years = write_years(1 / dataset.attrs["target"])
    nothing = f"Nothing needs to be done: all overturn at most once in {years} years."
    return " ".join(sentences) or nothing
