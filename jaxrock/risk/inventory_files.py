"""Tables of objects from files, whose heads must leave no doubt about columns and units."""

import math
import os
import re
import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..block import RECTANGLE_INERTIA_RATIO, Block
from ..ground_motion import FLOOR_DAMPING
from ..impact import ONE_SIDED_RESTITUTION, compute_restitution_by_size
from ..sensitivity import Uncertain
from ..oldtables import QUANTITIES, Row, Table, quote_word, read_table
from ..validation import AT_LEAST_ONE, NON_NEGATIVE, POSITIVE, UNIT_INTERVAL
from .inventory import Inventory

_COEFFICIENT = "restitution coefficient of variation"
# The columns of numbers, and their values in SI.
_DOMAINS = {
    "width": POSITIVE,
    "height": POSITIVE,
    "depth": POSITIVE,
    "inertia ratio": AT_LEAST_ONE,
    "restitution": UNIT_INTERVAL,
    _COEFFICIENT: NON_NEGATIVE,
    "floor period": NON_NEGATIVE,
    # Above critical damping the number is one of per cent.
    "floor damping": UNIT_INTERVAL,
}
# Below these sizes [m] the unit of a column is perhaps another one.
_SMALLEST_SIZES = {"width": 1e-3, "height": 1e-2, "depth": 1e-3}
_PERCENTAGES = (_COEFFICIENT, "floor damping")
# What stands in the column of one-sided objects, besides an empty cell.
_FLAGS = {
    **dict.fromkeys(("yes", "true", "1", "x"), True),
    **dict.fromkeys(("no", "false", "0", ""), False),
}
# What spreadsheets call rows below the objects, in a few languages.
_TOTALS = (
    r"(?:sub|grand )?totals?|sums?|means?|averages?|max(?:imum)?|min(?:imum)?|median|std\.?"
    r"|summe|gesamt|mittelwert|totale|moyenne|media|promedio|somme?"
)
_NEEDED = ("name", "width", "height")
_ALLOWED = (
    "name, width [m], height [m], and perhaps depth [m], inertia ratio, restitution,"
    f" {_COEFFICIENT}, one-sided, floor period [s], floor damping, with lengths in m, cm, mm,"
    " in or ft, and periods in s or ms"
)


class _Object(NamedTuple):
    """An object of a table.

    Attributes
    ----------
    name : str
    numbers : tuple of float
        Width, height, inertia ratio, restitution, its coefficient of variation, period and
        damping of the floor.
    one_sided : bool
    restitution_assumed : bool
    remark : str
    """

    name: str
    numbers: tuple[float, ...]
    one_sided: bool
    restitution_assumed: bool
    remark: str


def read_inventory(
    path: str | os.PathLike[str], *, samples: int = 16, seed: int = 0
) -> Inventory:
    r"""Read a table of objects from a text file, as .csv.

    Parameters
    ----------
    path : str or path
        A file with columns separated by commas, semicolons or tabs, in any order, below a
        line with their names and units, such as ``name,width [cm],height [m]``. Titles may
        stand above that line and units below it. Lines that begin with # are comments, and
        rows of empty cells are left out. The decimal separator is a point, or a comma in all
        numbers.

        Each object has a ``name`` of its own, a ``width`` and a ``height``, which is twice
        the height of the centre of mass. It may have a ``depth``; it then rocks over the
        shorter of the two sides of its base. A missing ``inertia ratio`` stands for 4/3. A
        missing ``restitution`` stands for Housner's, and the inventory marks it as assumed. A
        missing ``restitution coefficient of variation``, also ``restitution cov``, stands for
        0. Only name, width and height may not be missing.

        The column ``one-sided`` has yes, true, 1 or x for an object against a wall, such as a
        facade, and no, false, 0 or nothing for all others. Its width is its side at right
        angles to the wall; it has no depth. Its restitution may be negative; if it is
        missing, `one_sided_restitution` gives it. An object on an upper floor has a ``floor
        period``; without one, or with 0, it stands on the ground floor. It may have a ``floor
        damping``, a ratio, 0.05 if it is missing.

        Lengths are in m, cm, mm, in or ft, periods in s or ms; a coefficient of variation and
        a damping are a number or in %. The heads of the columns state the units, in brackets
        or after the name.
    samples, seed : int
        Number and seed of the samples of uncertain restitutions; see `Uncertain`.

    Returns
    -------
    Inventory

    Raises
    ------
    ValueError
        With file and line, if the file cannot be read or seems to be cut, a head is not
        understood, a value is missing, no number or out of range, a name occurs twice, or an
        object is so stocky that Housner's restitution is negative, or that a wall does not
        throw it back.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import jaxrock as jr
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "objects.csv"
    ...     _ = path.write_text("name,width [cm],height [m]\nvase,20,0.6\nbust,30,0.9\n")
    ...     print(jr.risk.read_inventory(path))
    2 objects
                             width [m]    height [m]   restitution
    vase                           0.2           0.6          0.85
    bust                           0.3           0.9          0.85
    """
    table = read_table(Path(path))
    columns = _find_columns(table)
    objects: dict[str, _Object] = {}
    for row in table.rows:
        if not any(row.cells):
            continue
        described = _read_object(table, row, columns)
        if described.name in objects:
            reason = f"names must differ, got {quote_word(described.name)} twice"
            raise table.text.error(reason, row.line)
        objects[described.name] = described
    if not objects:
        raise table.text.error("at least one object was expected, got none")
    table.refuse_cut()
    last = table.rows[-1]
    if not table.text.ends and not last.cells[-1]:
        reason = (
            "the file looks truncated: its last cell is empty and no newline follows; add a"
        )
        raise table.text.error(f"{reason} newline if it is complete", last.line)
    numbers = np.array([described.numbers for described in objects.values()])
    width, height, ratio, restitution, coefficient, period, damping = numbers.T
    block = Block.from_size(width=width, height=height, inertia_ratio=ratio)
    remarks = [described.remark for described in objects.values()]
    uncertain = None
    if coefficient.any():
        uncertain = Uncertain({"restitution": coefficient}, samples=samples, seed=seed)
    return Inventory(
        [*objects],
        block,
        restitution,
        uncertain,
        remarks,
        one_sided=[described.one_sided for described in objects.values()],
        floor_period=period,
        floor_damping=damping if period.any() else None,
        restitution_assumed=[described.restitution_assumed for described in objects.values()],
    )


def _find_columns(table: Table) -> dict[str, int]:  # noqa: C901
    """Find the column of each quantity; a `ValueError` if one is not understood."""
    if not table.heads:
        reason = (
            f"a line with the names of the columns was expected above; they are {_ALLOWED}"
        )
        raise table.text.error(reason, table.rows[0].line)
    columns: dict[str, int] = {}
    for column, head in enumerate(table.heads):
        name = f"column {quote_word(head.words)}"
        is_empty = not any("".join(row.cells[column : column + 1]) for row in table.rows)
        if not head.words and is_empty:
            continue
        # It is not left out: it may be one that the user relies on, under another name.
        if head.quantity not in ("name", "one-sided", *_DOMAINS):
            reason = f"{name} is not understood: leave it out or rename it; columns are"
            raise table.text.error(f"{reason} {_ALLOWED}", table.line)
        if head.quantity in columns:
            reason = f"{name}: a column {head.quantity!r} is there already"
            raise table.text.error(reason, table.line)
        (dimension,) = QUANTITIES[head.quantity].dimensions
        if dimension in ("length", "time"):
            has_unit = head.units and not math.isnan(head.factor)
            allowed = "" if has_unit else f"a unit of {dimension}"
        elif head.quantity in _PERCENTAGES:
            allowed = "no unit or %" if math.isnan(head.factor) else ""
        else:
            allowed = "no unit" if head.factor != 1 else ""
        if allowed:
            reason = f"{name}: {allowed} was expected, as in {_ALLOWED}"
            raise table.text.error(reason, table.line)
        columns[head.quantity] = column
    for quantity in _NEEDED:
        if quantity not in columns:
            reason = f"column {quantity!r} is missing; columns are {_ALLOWED}"
            raise table.text.error(reason, table.line)
    return columns


def _read_object(table: Table, row: Row, columns: dict[str, int]) -> _Object:
    """Read an object; a `ValueError` with the line if a value is not allowed."""
    if len(row.cells) < len(table.heads):
        raise table.error_of_width(row)
    name = row.cells[columns["name"]]
    if not name or re.fullmatch(_TOTALS, name, re.I):
        reason = "leave out rows of totals and the like, and give each object a name"
        raise table.text.error(f"a name was expected, got {name!r}: {reason}", row.line)
    one_sided = _read_flag(table, row, columns)
    values = {
        quantity: _read_number(table, row, columns[quantity], quantity, one_sided)
        for quantity in _DOMAINS
        if quantity in columns and (row.cells[columns[quantity]] or quantity in _NEEDED)
    }
    width = values["width"]
    remarks = []
    # The shorter side of the base is the width: over the longer one it is harder to overturn.
    if "depth" in values:
        if one_sided:
            raise table.text.error(
                "a one-sided object must have no depth: its width is its side at right angles"
                f" to the wall, got a depth of {values['depth']:.4g} m",
                row.line,
            )
        if values["depth"] < width:
            width = values["depth"]
            remarks.append("rocks over its depth, the shorter side of its base")
    ratio = values.get("inertia ratio", RECTANGLE_INERTIA_RATIO)
    block = Block.from_size(
        width=width, height=values["height"], inertia_ratio=ratio, one_sided=one_sided
    )
    is_assumed = "restitution" not in values
    if is_assumed:
        values["restitution"] = _compute_restitution(table, row, block)
    coefficient = values.get(_COEFFICIENT, 0.0)
    try:
        # What cannot be drawn is refused with its line.
        Uncertain({"restitution": coefficient}, samples=1).draw(block, values["restitution"])
    except ValueError as error:
        raise table.text.error(str(error), row.line) from None
    period = values.get("floor period", 0.0)
    if "floor damping" not in values and period:
        remarks.append(f"damping of its floor not given, {FLOOR_DAMPING:g} assumed")
    elif "floor damping" in values and not period:
        damping = quote_word(row.cells[columns["floor damping"]])
        reason = f"a floor damping goes with a floor period, got {damping} without one"
        raise table.text.error(reason, row.line)
    numbers = (
        width,
        values["height"],
        ratio,
        values["restitution"],
        coefficient,
        period,
        values.get("floor damping", FLOOR_DAMPING),
    )
    return _Object(name, numbers, one_sided, is_assumed, "; ".join(remarks))


def _compute_restitution(table: Table, row: Row, block: Block) -> float:
    """Compute a restitution that is not given; a `ValueError` if size does not give one."""
    restitution = float(compute_restitution_by_size(block))
    if restitution < 0:
        reason = f"since Housner's is {restitution:.3g}"
        if block.one_sided:
            by_size = f"by its size the restitution is {-restitution:.3g}"
            reason = f"since a wall does not throw it back: {by_size}"
        raise table.text.error(
            f"a restitution must be given for an object this stocky, {reason}", row.line
        )
    return restitution


def _read_flag(table: Table, row: Row, columns: dict[str, int]) -> bool:
    """Read whether an object is one-sided; a `ValueError` with the line if it is not clear."""
    if "one-sided" not in columns:
        return False
    column = columns["one-sided"]
    cell = row.cells[column]
    if cell.lower() not in _FLAGS:
        name = f"column {quote_word(table.heads[column].words)}"
        reason = f"{name} must be yes, no, true, false, 1, 0, x or empty, got"
        raise table.text.error(f"{reason} {quote_word(cell)}", row.line)
    return _FLAGS[cell.lower()]


def _read_number(table: Table, row: Row, column: int, quantity: str, one_sided: bool) -> float:
    """Read a number in SI; a `ValueError` with the line if it is not allowed."""
    head = table.heads[column]
    domain = _DOMAINS[quantity]
    if quantity == "restitution" and one_sided:
        domain = ONE_SIDED_RESTITUTION
    cell = row.cells[column]
    number = table.parse_number(row, column)
    name = f"column {quote_word(head.words)}"
    if number is None:
        seen = quote_word(cell) if cell else "an empty cell"
        reason = f"{name} must have a number, its unit in the head only, got {seen}"
        raise table.text.error(reason, row.line)
    value = number * head.factor
    if not domain.contains(np.asarray(value)):
        reason = f"{name} must be {domain.allowed}, got {quote_word(cell)}"
        raise table.text.error(reason, row.line)
    if value < _SMALLEST_SIZES.get(quantity, -math.inf):
        reason = (
            f"{name} has {quote_word(cell)}, a {quantity} of {1000 * value:.3g} mm; if another"
            " unit was meant, it must stand in the head of the column"
        )
        warnings.warn(str(table.text.error(reason, row.line)), stacklevel=4)
    return value
