"""Tables of samples: which columns are times and accelerations, and the components they make."""

import math
import re
from collections.abc import Callable

import numpy as np

from ...oldtables import (
    Statement,
    Table,
    TextFile,
    WordsAndValue,
    collect_statements,
    find_contents,
    find_factor,
    find_quantity,
    find_steps,
    find_units,
    quote_names,
    quote_word,
    read_table,
)
from .claims import UNIFORM, Claims
from .components import Component
from .directions import (
    find_clear_direction,
    find_column_direction,
    find_name_direction,
    settle_direction,
)
from .printed_times import find_printed_step, find_uniform_step

# PEER puts it beside the records that a search has found.
_SEARCH_REPORT = re.compile(r'[\s"]*(?:PEER Ground Motion Database\b|-- Summary of )')
# A column T beside accelerations may be of periods, if other names or the text above say so.
_SPECTRUM = re.compile(r"(?<![^\W_])(?:spectr(?:um|a)|response|design)(?![^\W_])", re.I)
# Quantities that have one value for a record or a site, not for a sample.
_NO_SERIES = ("pga", "pgv", "intensity", "rate", "probability", "return period")
# Of fewer numbers nothing can be told.
_FEW = 4


class SampleTable:
    """A table whose rows are samples in time."""

    def __init__(self, text: TextFile):
        """Understand the heads; a `ValueError` if these are not columns of samples."""
        if is_search_report(text):
            raise text.error("this is PEER's report of a search for records, and none itself")
        self.text = text
        self.table: Table = read_table(text)
        if not self.table.heads:
            top = self.table.rows[0].line
            row = quote_word(text.lines[top - 1])
            raise text.error(f"names of the columns were expected, got {row}", top)
        # Where the columns point by their names; None for no acceleration.
        self.directions = [find_column_direction(head.name) for head in self.table.heads]
        # The column of times, and those that may be accelerations.
        self.times: int | None = self._find_times()
        self._refuse_spectra()
        self.accelerations: list[int] = self._list_accelerations()
        # As of other files of one component, the name of the file may say where it points.
        self.is_vertical = False
        if len(self.accelerations) == 1:
            (column,) = self.accelerations
            named = settle_direction(find_name_direction(text.path, [text.path]), "")
            if named in ("up", "down") and not find_clear_direction(
                self.table.heads[column].name
            ):
                self.directions[column] = named
                self.is_vertical = True

    def find_column(self, argument: str, name: str) -> int:
        """Find the column of a name, or the one that points "up" or "down" if none has it."""
        names = self.table.names
        if name not in names and name.lower() in ("up", "down"):
            name = name.lower()
            columns = [k for k in self.accelerations if self.directions[k] == name]
            if len(columns) != 1:
                named = quote_names(names[k] for k in columns) or "none"
                raise self._error(f"one column that points {name} was expected, got {named}")
            return columns[0]
        columns = [k for k, other in enumerate(names) if other == name]
        if len(columns) != 1:
            raise self._error(
                f"{argument} is {name!r}, but there are {len(columns)} such columns among"
                f" {quote_names(names)}"
            )
        if columns[0] == self.times:
            raise self._error(f"{argument} is {name!r}, which is taken for the times")
        return columns[0]

    def choose_horizontal(self, vertical: int | None) -> int:
        """Choose the only column that may be horizontal; a `ValueError` if it is not clear."""
        heads = self.table.heads
        named = [head for k, head in enumerate(heads) if k != self.times]
        if named and not self.accelerations:
            listed = [f"{quote_word(head.words)} ({head.quantity})" for head in named[:6]]
            raise self._error(f"acceleration was expected, got columns {', '.join(listed)}")
        columns = [k for k in self.accelerations if k != vertical]
        names = quote_names(heads[k].words for k in columns) or "no column is left for it"
        if len(columns) != 1:
            raise self._error(f"column must be given, the horizontal component: {names}")
        if self.directions[columns[0]] in ("up", "down"):
            raise self._error(
                f"no component is horizontal; column names a vertical one: {names}"
            )
        return columns[0]

    def read_components(self, columns: dict[int, str], claims: Claims) -> list[Component]:
        """Read columns, each for the argument by which it was asked for."""
        known = all(self.table.heads[k].quantity for k in columns)
        if contents := find_contents(self.table.notes, known):
            raise self.text.error(f"acceleration was expected, not {contents[1]}", contents[0])
        for line, words in self.table.notes:
            if factor := find_factor(words):
                raise self.text.error(
                    f"accelerations in their unit were expected, a comment states {factor!r}:"
                    " multiply the values by it unless that has been done, then remove this",
                    line,
                )
        factors = {k: self._find_unit(k, claims) for k in columns}
        wanted = [*columns] if self.times is None else [*columns, self.times]
        values = self.table.read_samples(wanted)
        if values.shape[1] < 2:
            raise self.text.error(f"at least two samples were expected, got {values.shape[1]}")
        if len(self.table.heads) == 1:
            require_samples_alone(self.text, values[0], self.table.rows[0].line)
        names = [(self.table.line, name) for name in self.table.names]
        for stated in (
            *self._collect_statements(find_steps),
            *collect_statements(find_steps, names, "the name of a column"),
        ):
            claims = claims.add_step(*stated)
        if self.times is not None:
            step = self._find_step(self.times, values[-1], claims)
            words = f"column {self.table.names[self.times]!r} has a step of {step:.6g} s"
            claims = claims.add_step(self.table.line, words, step)
        missing = f"no column of times is among {quote_names(self.table.names)}"
        step = claims.require_step(self.text, missing, self.table.line)
        components: list[Component] = []
        # Not strict: the row of times, if there is one, comes last.
        for (column, argument), row in zip(columns.items(), values, strict=False):
            head = self.table.heads[column]
            # Errors about where it points have to tell it from the horizontal one.
            where = f", column {head.words!r}" if argument == "vertical" else ""
            title = f"{str(self.text.path)!r}{where}"
            direction = find_clear_direction(head.name)
            components.append(Component(title, factors[column], row, step, direction))
        return components

    def _error(self, reason: str) -> ValueError:
        """Make an error about the names of the columns."""
        return self.text.error(reason, self.table.line)

    def _find_times(self) -> int | None:
        """Find the column of times by its name, or else by its unit."""
        heads = self.table.heads
        columns = [k for k, head in enumerate(heads) if head.quantity == "time"]
        named = [k for k in columns if find_quantity(heads[k].name) == "time"]
        columns = named or columns
        if len(columns) > 1:
            names = quote_names(heads[k].words for k in columns)
            raise self._error(f"one column of times was expected, got {names}")
        if columns and math.isnan(heads[columns[0]].factor):
            words = quote_word(heads[columns[0]].words)
            raise self._error(f"the unit of the times is not understood: {words}")
        return columns[0] if columns else None

    def _refuse_spectra(self) -> None:
        """Refuse spectra, intensities and rates, whose periods and values pass for a motion."""
        heads = self.table.heads
        way = "a spectrum over periods or frequencies is no ground motion"
        quantities = [head.quantity for head in heads]
        for words, _, quantity, _ in heads:
            if quantity == "period":
                raise self._error(f"times were expected, got column {words!r}: {way}")
            if quantity == "spectral acceleration" and "acceleration" not in quantities:
                raise self._error(f"accelerations were expected, got column {words!r}: {way}")
            if quantity in _NO_SERIES and self.times is None:
                raise self._error(
                    f"samples in time were expected, got column {words!r} ({quantity})"
                )
        above = [note[1] for note in self.table.notes]
        above += [self.text.path.stem, *self.table.names]
        unclear = self.times is not None and heads[self.times].name == "T"
        if unclear and any(map(_SPECTRUM.search, above)):
            raise self._error(
                "'T' may be periods: the text above, another column or the name of the file"
                f" mentions a spectrum, and {way}: if 'T' is time, name it 'time'"
            )

    def _list_accelerations(self) -> list[int]:
        """List the columns that may be accelerations: where some say so, only these."""
        heads = self.table.heads
        possible = [k for k, head in enumerate(heads) if head.quantity in ("acceleration", "")]
        columns = [k for k in possible if k != self.times]
        stated = [k for k in columns if any(math.isfinite(u.factor) for u in heads[k].units)]
        # One letter, as in a and b, is no name of a quantity.
        named = [k for k in columns if heads[k].quantity and len(heads[k].name) > 1]
        return stated or named or columns

    def _find_unit(self, column: int, claims: Claims) -> float:
        """Find the unit of a column [m/s2]; a `ValueError` if it is no acceleration."""
        head = self.table.heads[column]
        if head.quantity not in ("acceleration", ""):
            raise self._error(
                f"acceleration was expected, column {head.words!r} is of another quantity:"
                f" {head.quantity}"
            )
        # Without a caller's unit, a_g is no statement: it may mean ground acceleration as well.
        if claims.units or head.words.lower() != "a_g":
            for unit in head.units:
                words = f"column {head.words!r} states {unit.words}"
                claims = claims.add_unit(self.table.line, words, unit.factor)
        # Notes may speak of several columns: one that agrees is enough.
        notes = self._collect_statements(find_units)
        ours = claims.units[0].value if claims.units else math.nan
        agreeing = [note for note in notes if math.isclose(note.value, ours)]
        for note in agreeing or notes:
            claims = claims.add_unit(*note)
        return claims.require_unit(self.text, "the file states no unit of this column")

    def _collect_statements(
        self, find: Callable[[str], list[WordsAndValue]]
    ) -> list[Statement]:
        """Collect what the comments and the titles above the names state."""
        comments = [note for note in self.table.notes if note[1].lstrip().startswith("#")]
        titles = [note for note in self.table.notes if note not in comments]
        stated = collect_statements(find, comments, "a comment")
        return stated + collect_statements(find, titles, "a title")

    def _find_step(self, column: int, times: np.ndarray, claims: Claims) -> float:
        """Find the step [s] of the times; an error names the first line that differs."""
        head = self.table.heads[column]
        seconds = head.factor
        step = find_uniform_step(times)
        if step is None:
            # Here only, since it costs time to split the lines anew.
            words = [row.cells[column] for row in self.table.rows]
            stated = [claim.value / seconds for claim in claims.steps]
            step = find_printed_step(words, times, stated)
        if step is not None:
            return seconds * step
        steps = np.diff(times)
        # The median, so that the error names the odd step, not all others.
        usual = float(np.median(steps))
        reason = "must increase"
        odd = steps <= 0
        if not odd.any():
            reason = f"must have a uniform step, mostly {seconds * usual:.6g} s"
            odd = abs(steps - usual) > UNIFORM * usual
        at = int(np.argmax(odd))
        raise self.text.error(
            f"column {head.words!r} {reason}, got {seconds * times[at]} and then"
            f" {seconds * times[at + 1]}",
            self.table.rows[at + 1].line,
        )


def require_samples_alone(text: TextFile, values: np.ndarray, line: int) -> None:
    """Raise a `ValueError` if the numbers of a file without times are no accelerations alone."""
    count = values.size
    if count <= _FEW:
        return
    # Some programs write the number of samples and the time step in front of them.
    if values[0] in (count - 1, count - 2):
        raise text.error(
            f"the first number, {values[0]:g}, is how many follow: leave out what stands in front"
            " of the accelerations, and state time_step",
            line,
        )
    steps = np.diff(values)
    if steps[0] > 0 and np.allclose(steps, steps[0], rtol=UNIFORM, atol=0):
        raise text.error(
            "accelerations were expected, but the numbers rise evenly, as times do", line
        )


def is_search_report(text: TextFile) -> bool:
    """Return whether a table is PEER's report of a search for records."""
    first = next((line for line in text.lines if line.strip()), "")
    return _SEARCH_REPORT.match(first) is not None
