"""Layout of a table: what separates its cells, where its names stand, and what is above them."""

import itertools
import re
from collections import Counter
from typing import NamedTuple

from .heads import match_whole, read_head
from .quantities import QUANTITIES
from .rows import SEPARATORS, Row, is_comment, is_number, split_line, split_lines
from .text import TextFile, quote_word
from .units import parse_unit

# By the first line, as Excel understands it, or else what fits best.
_SEPARATOR_LINE = re.compile(r'\s*"?sep=(?P<separator>[,;|\t]?)"?\s*', re.I)
# As many lines tell how a table is laid out.
_SAMPLE = 30
# In a comment above numbers: a word, and perhaps its unit in brackets.
_NAME_IN_COMMENT = re.compile(r"[^\s\[\]()]+(?:\s*[\[(][^\[\]()]*[\])])?")
# A line above one column that is no name of it: "Time Step: 0.005", "dt = 0.01".
_STATEMENT = re.compile(r"[^:=]*[:=].*")


class Layout(NamedTuple):
    """Layout of a table, as `Table` describes it; `top` is the line above the first row."""

    # With their units.
    names: list[str]
    line: int
    notes: list[tuple[int, str]]
    separator: str
    top: int


def find_layout(text: TextFile) -> Layout:
    """Find the layout of a table; a `ValueError` if it has no rows, or titles but no names."""
    # Few files have any, and few of their lines.
    lines = enumerate(text.lines if "#" in text.content else [], 1)
    notes = [(number, line) for number, line in lines if "#" in line and is_comment(line)]
    stated = _SEPARATOR_LINE.fullmatch(text.lines[0])
    top = 1 if stated else 0
    # A tab after "sep=" may have been stripped with the blanks at the end of the line.
    separator = (stated["separator"] or "\t") if stated else _find_separator(text)
    sample = [*itertools.islice(split_lines(text, top, separator), _SAMPLE)]
    if not sample:
        raise text.error(
            "a line with the names of the columns was expected, all lines are comments"
        )
    head, first = _find_head(sample)
    titles = [row for k, row in enumerate(sample[:first]) if k != head]
    top = sample[first].line - 1 if first < len(sample) else len(text.lines)
    if head is not None:
        line, names = sample[head]
        units = titles[-1].cells if titles and head + 1 < first else []
        if _are_units(units, len(names)):
            del titles[-1]
            names = [
                f"{n} [{u.strip('[]()')}]" if u else n
                for n, u in zip(names, units, strict=True)
            ]
        # Spreadsheets end lines with separators of empty cells.
        while len(names) > 1 and not names[-1]:
            del names[-1]
    elif first == len(sample):
        last = quote_word(text.lines[sample[-1].line - 1])
        raise text.error(f"rows of numbers were expected below {last}", sample[-1].line)
    else:
        names, line = _find_names_in_comments(notes, sample[first:], separator)
        if not names and titles:
            row = quote_word(text.lines[top])
            raise text.error(f"names of the columns were expected above {row}", top + 1)
    notes = [note for note in notes if note[0] != line]
    notes += [(row.line, text.lines[row.line - 1]) for row in titles]
    return Layout(names, line, sorted(notes), separator, top)


def _find_head(sample: list[Row]) -> tuple[int | None, int]:
    """Find the row of the names, None if there is none, and the first row below it."""
    if all(map(is_number, filter(None, sample[0].cells))):
        return None, 0
    numbered = [k for k, row in enumerate(sample) if k and any(map(is_number, row.cells))]
    leading = range(numbered[0] if numbered else len(sample))
    width = Counter(len(row.cells) for row in sample).most_common(1)[0][0]
    # Titles have one cell, or are statements.
    names = [
        k
        for k in leading
        if (width == 1 or any(sample[k].cells[1:])) and not _is_statement(sample[k].cells)
    ]
    if not names:
        return None, leading[-1] + 1
    known = {k: _count_quantities(sample[k].cells) for k in names}
    fitting = [k for k in names if len(sample[k].cells) == width] or names
    head = max(names, key=lambda k: known[k])
    if not any(known[head]):
        head = fitting[-1 if width == 1 else 0]
    first = head + 1
    # Below the names units may stand, or statements.
    for row in sample[first:]:
        if not (_are_units(row.cells, len(sample[head].cells)) or _is_statement(row.cells)):
            break
        first += 1
    return head, first


def _count_quantities(cells: list[str]) -> tuple[int, int]:
    """Count quantities in a row; of equal rows, the one with more quantities of numbers wins.

    Above names, "unit,m/s2" is a statement.
    """
    heads = [read_head(cell) for cell in cells]
    known = [head.quantity for head in heads if head.quantity]
    words = [name for name in known if name in QUANTITIES and not QUANTITIES[name].dimensions]
    return len(known), len(known) - len(words)


def _is_statement(cells: list[str]) -> bool:
    """Return whether a row is a statement, such as "Time Step: 0.005"."""
    return len(cells) == 1 and _STATEMENT.fullmatch(cells[0]) is not None


def _are_units(cells: list[str], width: int) -> bool:
    """Return whether all cells that are not empty are units, as below names in some logs."""
    words = [*filter(None, (cell.strip("[]() ") for cell in cells))]
    return (
        len(cells) == width
        and bool(words)
        and not any(map(is_number, words))
        and all(parse_unit(word).dimension for word in words)
    )


def _find_names_in_comments(
    notes: list[tuple[int, str]], rows: list[Row], separator: str
) -> tuple[list[str], int]:
    """Find names in the last comment above numbers, and its line; else names of one column."""
    first = rows[0].line
    width = max(len(row.cells) for row in rows)
    above = [note for note in notes if note[0] < first]
    if above and width > 1:
        line, comment = above[-1]
        names = split_line(comment.strip(), separator)
        # Between blanks the # is a word of its own, if it names no counter.
        if separator == " " and names[0] == "#" and len(names) == width + 1:
            del names[0]
        # A lone # is the name of a counter.
        names[0] = names[0].lstrip("# ") or "#"
        # Of sentences, which have commas as well, the parts are seldom single words.
        plain = all(
            _NAME_IN_COMMENT.fullmatch(name)
            or (name.endswith(("]", ")")) and read_head(name).units)
            or match_whole(read_head(name).name)
            for name in names
        )
        if plain and len(names) == width and not any(map(is_number, names)):
            return names, line
    # One column needs no name.
    return (["column 1"] if width == 1 else []), first


def _find_separator(text: TextFile) -> str:
    """Find the separator that splits most lines into the same number of fields."""
    candidates: dict[str, tuple[float, float, bool]] = {}
    for separator in SEPARATORS:
        if separator not in text.content:
            continue
        rows = [*itertools.islice(split_lines(text, 0, separator), _SAMPLE)]
        if not rows:
            return ","
        counts = Counter(len(row.cells) for row in rows)
        width, number = counts.most_common(1)[0]
        if width == 1 or (separator == " " and (candidates or number < len(rows))):
            continue
        # Better is a separator whose fields contain none of the others.
        inside = any(
            set(cell) & (set(SEPARATORS) - {separator, " "})
            for row in rows
            for cell in row.cells
        )
        # "0,5;0,1" has as many commas as semicolons, but only these leave numbers.
        cells = [cell for row in rows for cell in row.cells if cell]
        numbers = sum(map(is_number, cells)) / max(len(cells), 1)
        candidates[separator] = (number / len(rows), numbers, not inside)
    if not candidates:
        # None fits: lines stay whole.
        return next((s for s in SEPARATORS if s in text.lines[0] and s != " "), ",")
    # Ties go to the first in SEPARATORS.
    return max(candidates, key=lambda separator: candidates[separator])
