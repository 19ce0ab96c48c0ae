"""Tables of objects from files, whose heads must leave no doubt about columns and units."""

import csv
import math
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..block import RECTANGLE_INERTIA_RATIO, Block
from ..host import is_number, read_numbered_lines
from ..impact import housner_restitution
from ..validation import AT_LEAST_ONE, NON_NEGATIVE, POSITIVE, UNIT_INTERVAL, Domain
from .inventory import Inventory, check_scatter

_LENGTHS = {
    r"m|met(?:er|re)s?": 1.0,
    r"cm|centimet(?:er|re)s?": 0.01,
    r"mm|millimet(?:er|re)s?": 1e-3,
}
_RATIOS = {r"|-|1": 1.0}
_SHARES = {r"|-|1": 1.0, r"%|per ?cent": 0.01}


class _Column(NamedTuple):
    """A column of numbers: names that it may have, units, and the values allowed."""

    pattern: str
    units: Mapping[str, float]
    domain: Domain
    needed: bool = False


# A column that is not understood is refused, and not left out: it may be the one that the user
# relies on, such as a scatter under another name.
_COLUMNS = {
    "width": _Column(r"(?:full )?width|base", _LENGTHS, POSITIVE, needed=True),
    "height": _Column(r"(?:full )?height", _LENGTHS, POSITIVE, needed=True),
    "depth": _Column(r"(?:full )?depth", _LENGTHS, POSITIVE),
    "inertia ratio": _Column(r"inertia ratio|kappa", _RATIOS, AT_LEAST_ONE),
    "restitution": _Column(r"(?:coefficient of )?restitution|c", _RATIOS, UNIT_INTERVAL),
    "restitution scatter": _Column(
        r"restitution (?:scatter|cov)|(?:scatter|cov|coefficient of variation)"
        r" of (?:the )?(?:restitution|c)",
        _SHARES,
        NON_NEGATIVE,
    ),
}
_NAME = r"names?|objects?"
_ALLOWED = (
    "name, width [m], height [m], and perhaps depth [m], inertia ratio, restitution,"
    " restitution scatter, with lengths in m, cm or mm"
)


class _Head(NamedTuple):
    """A column as its head describes it: its name, its words, its unit in SI."""

    name: str
    words: str
    factor: float


def read_inventory(path: str | os.PathLike[str]) -> Inventory:
    r"""Read a table of objects from a .csv file.

    Parameters
    ----------
    path : str or path
        A file with columns separated by commas, in any order, below one line with their names
        and units, such as ``name,width [cm],height [m]``, and perhaps lines that begin with #.

        Each object has a ``name`` of its own, a ``width`` and a ``height``, which is twice
        that of the centre of mass. It may have a ``depth``: then the
        shorter of the two sides of its base is the width over which it rocks. An ``inertia
        ratio`` that is missing is 4/3, a ``restitution`` that is missing Housner's. The
        ``restitution scatter`` is the coefficient of variation of an uncertain restitution, 0
        if it is missing, as a number or in %. A column or a cell may be missing, but for the
        first three columns.

        Lengths are in m, cm or mm, in brackets or behind the name.

    Returns
    -------
    Inventory

    Raises
    ------
    ValueError
        With file, line and column, if the file cannot be read, a head is not understood, a
        value is missing, no number or out of range, a name is there twice, or an object is so
        stocky that Housner's restitution is negative.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import jaxrock as jr
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "objects.csv"
    ...     _ = path.write_text("name,width [cm],height [m]\nvase,20,0.6\nbust,30,0.9\n")
    ...     print(jr.risk.read_inventory(path))
    2 objects
                             width [m]    height [m]   restitution       scatter
    vase                           0.2           0.6          0.85             0
    bust                           0.3           0.9          0.85             0
    """
    path = Path(path)
    lines = read_numbered_lines(path)
    if not lines:
        raise ValueError(
            f"{str(path)!r}: a line with the names of columns was expected, got none"
        )
    number, line = lines[0]
    try:
        heads = _read_heads(_split_line(line))
    except ValueError as error:
        raise ValueError(f"{str(path)!r}, line {number}: {error}") from None
    if len(lines) < 2:
        raise ValueError(f"{str(path)!r}: at least one object was expected, got none")
    rows: list[_Row] = []
    for number, line in lines[1:]:
        try:
            row = _read_row(heads, _split_line(line))
            if row.name in {before.name for before in rows}:
                raise ValueError(f"column 'name': names must differ, got {row.name!r} twice")
        except ValueError as error:
            raise ValueError(f"{str(path)!r}, line {number}, {error}") from None
        rows.append(row)
    numbers = np.array([row.numbers for row in rows])
    width, height, ratio, restitution, scatter = numbers.T
    block = Block.from_size(width=width, height=height, inertia_ratio=ratio)
    remarks = [row.remark for row in rows]
    return Inventory([row.name for row in rows], block, restitution, scatter, remarks)


def _split_line(line: str) -> list[str]:
    """Split a line at its commas, but for those between quotes."""
    # A semicolon comes with decimal commas, at which the numbers would be cut in two.
    if ";" in line:
        must = "columns were expected to be separated by commas and decimals by points"
        raise ValueError(f"{must}, got {line[:60]!r}")
    return [field.strip() for field in next(csv.reader([line], skipinitialspace=True))]


def _read_heads(fields: Sequence[str]) -> list[_Head]:
    """Read the heads of all columns; a `ValueError` if one is not understood."""
    heads = [_read_head(field) for field in fields]
    names = [head.name for head in heads]
    for k, head in enumerate(heads):
        if head.name in names[:k]:
            raise ValueError(f"column {head.words!r}: a column {head.name!r} is there already")
    needed = ["name", *(name for name, column in _COLUMNS.items() if column.needed)]
    missing = [name for name in needed if name not in names]
    if missing:
        raise ValueError(f"column {missing[0]!r} is missing; columns are {_ALLOWED}")
    return heads


def _read_head(words: str) -> _Head:
    """Read the head of a column: what it is, and its unit."""
    # An underscore stands for a space, as in width_cm.
    plain = " ".join(words.replace("_", " ").split())
    split = re.fullmatch(r"(?P<name>.*?) ?[\[(] ?(?P<unit>[^\])]*?) ?[\])]", plain)
    name = split["name"] if split else plain
    unit = split["unit"] if split else ""
    if re.fullmatch(_NAME, name, re.I) and not unit:
        return _Head("name", words, 1.0)
    for kind, column in _COLUMNS.items():
        behind = re.fullmatch(rf"(?:{column.pattern})(?P<unit>(?: \S+)?)", name, re.I)
        if behind is None or (unit and behind["unit"]):
            continue
        said = unit or behind["unit"].strip()
        for pattern, factor in column.units.items():
            if re.fullmatch(pattern, said, re.I):
                return _Head(kind, words, factor)
        # Another column may have the longer name, such as "restitution scatter".
        if unit or not said:
            must = "a unit m, cm or mm" if column.units is _LENGTHS else "no unit"
            must = "no unit or %" if column.units is _SHARES else must
            raise ValueError(f"column {words!r}: {must} was expected, as in {_ALLOWED}")
    raise ValueError(f"column {words!r} is not understood; columns are {_ALLOWED}")


class _Row(NamedTuple):
    """An object: its name; width, height, inertia ratio, restitution, scatter; a remark."""

    name: str
    numbers: tuple[float, float, float, float, float]
    remark: str


def _read_row(heads: Sequence[_Head], fields: Sequence[str]) -> _Row:
    """Read an object; a `ValueError` that names the column if a value is not allowed."""
    if len(fields) != len(heads):
        missing = heads[min(len(fields), len(heads) - 1)].words
        raise ValueError(
            f"column {missing!r}: {len(heads)} columns were expected, got {len(fields)}"
        )
    values: dict[str, float] = {}
    name = ""
    for head, field in zip(heads, fields, strict=True):
        if head.name == "name":
            name = field
            if not name:
                raise ValueError("column 'name': a name was expected, got none")
        elif field or _COLUMNS[head.name].needed:
            values[head.name] = _read_number(head, field)
    width = values["width"]
    remarks = []
    # The shorter side of the base is the width: over the longer one it is harder to overturn.
    if "depth" in values:
        rocks = min(width, values["depth"])
        other = "depth" if rocks < width else "width"
        remarks.append(f"rocks over its {other}, {rocks:.4g} m")
        width = rocks
    ratio = values.get("inertia ratio", RECTANGLE_INERTIA_RATIO)
    if "restitution" not in values:
        block = Block.from_size(width=width, height=values["height"], inertia_ratio=ratio)
        housner = float(housner_restitution(block))
        if housner < 0:
            raise ValueError(
                "column 'restitution': a restitution must be given for an object this stocky,"
                f" since Housner's is {housner:.3g}"
            )
        values["restitution"] = housner
        remarks.append("Housner's restitution")
    scatter = values.get("restitution scatter", 0.0)
    try:
        check_scatter(values["restitution"], scatter)
    except ValueError as error:
        raise ValueError(f"column 'restitution scatter': {error}") from None
    numbers = (width, values["height"], ratio, values["restitution"], scatter)
    return _Row(name, numbers, "; ".join(remarks))


def _read_number(head: _Head, field: str) -> float:
    """Read a number of a column in SI; a `ValueError` if it is not allowed."""
    domain = _COLUMNS[head.name].domain
    value = head.factor * float(field) if is_number(field) else math.nan
    if not np.isfinite(value) or not bool(domain.contains(np.asarray(value))):
        got = repr(field[:60]) if field else "an empty cell"
        raise ValueError(f"column {head.words!r}: must be {domain.allowed}, got {got}")
    return value
