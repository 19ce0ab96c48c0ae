"""Tables of samples: which columns are times and accelerations, and the components they make."""

import math
import re

import numpy as np

from ...tables import (
    Statement,
    Table,
    TextFile,
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
from .components import Component, Direction
from .directions import find_clear_direction, find_column_direction
from .printed_times import find_printed_step, find_uniform_step

# PEER puts it beside the records that a search has found.
_SEARCH_REPORT = re.compile(r'[\s"]*(?:PEER Ground Motion Database\b|-- Summary of )')
# A column T beside accelerations may be of periods, if other names or the text above say so.
_SPECTRUM = re.compile(r"(?<![^\W_])(?:spectr(?:um|a)|response|design)(?![^\W_])", re.I)
# Of which there is one for a record or a site, and not one for a sample.
_NO_SERIES = ("pga", "pgv", "intensity", "rate", "probability", "return period")
# Of fewer numbers nothing can be told.
_FEW = 4


class SampleTable:
    """A table whose rows are samples in time.

    Attributes
    ----------
    table : Table
        Its heads and rows.
    text : TextFile
        The file, whose `error` names it.
    times : int or None
        The column of times.
    accelerations : list of int
        The columns that may be accelerations: where some state a unit of acceleration, or are
        named so, only these.
    """

    def __init__(self, text: TextFile):
        """Understand the heads; a `ValueError` if these are not columns of samples."""
        if is_search_report(text):
            raise text.error(
                "this is PEER's report of a search for records, which is none itself"
            )
        self.text = text
        self.table: Table = read_table(text)
        if not self.table.heads:
            top = self.table.rows[0].line
            line = quote_word(text.lines[top - 1])
            raise text.error(f"names of the columns were expected, got {line}", top)
        self.times: int | None = self._find_times()
        self._refuse_spectra()
        self.accelerations: list[int] = self._list_accelerations()

    @property
    def states_unit(self) -> bool:
        """True if a name or a note states a unit, understood or not."""
        return any(head.units for head in self.table.heads) or any(
            find_units(note[1]) for note in self.table.notes
        )

    def find_column(self, argument: str, name: str) -> int:
        """Find the column of a name, or the one that points "up" or "down" if none has it.

        Raises a `ValueError` that names the argument if there is no such column, several, or
        if it holds no accelerations.
        """
        names = self.table.names
        if name not in names and name.lower() in ("up", "down"):
            columns = [k for k in self.accelerations if self.find_direction(k) == name.lower()]
            if len(columns) != 1:
                named = quote_names(names[k] for k in columns) or "none"
                raise self._error(
                    f"one column that points {name.lower()} was expected, got {named}"
                )
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
        columns = [k for k in self.accelerations if k != vertical]
        names = quote_names(self.table.names[k] for k in columns)
        named = [head for k, head in enumerate(self.table.heads) if k != self.times]
        if not self.accelerations and named:
            listed = ", ".join(
                f"{quote_word(head.words)} ({head.quantity})" for head in named[:6]
            )
            raise self._error(f"acceleration was expected, got columns {listed}")
        if len(columns) != 1:
            raise self._error(
                "column must be given, the name of the horizontal acceleration: "
                + (names or "no column is left for it")
            )
        if find_clear_direction(self.table.heads[columns[0]].name) in ("up", "down"):
            raise self._error(
                f"no component is horizontal; column names a vertical one: {names}"
            )
        return columns[0]

    def find_direction(self, column: int) -> Direction | None:
        """Find where a column points by its name; None for no acceleration."""
        return find_column_direction(self.table.heads[column].name)

    def read_components(self, columns: dict[int, str], claims: Claims) -> list[Component]:
        """Read columns, each for the argument by which it was asked for."""
        known = all(self.table.heads[k].quantity for k in columns)
        contents = find_contents(self.table.notes, known)
        if contents is not None:
            line, other = contents
            raise self.text.error(f"acceleration was expected, not {other}", line)
        for line, words in self.table.notes:
            if factor := find_factor(words):
                raise self.text.error(
                    f"accelerations in their unit were expected, a comment states {factor!r}:"
                    " apply the factor, if it is not, and leave the statement out",
                    line,
                )
        factors = {k: self._find_unit(k, claims) for k in columns}
        wanted = [*columns] if self.times is None else [*columns, self.times]
        values = self.table.read_samples(wanted)
        if values.shape[1] < 2:
            raise self.text.error(f"at least two samples were expected, got {values.shape[1]}")
        if len(self.table.heads) == 1:
            require_samples_alone(self.text, values[0], self.table.rows[0].line)
        for stated in self._collect_steps():
            claims = claims.add_step(*stated)
        if self.times is not None:
            name = self.table.names[self.times]
            step = self._find_step(values[-1], claims)
            # Behind what the caller states, but before the file's other statements.
            words = f"column {name!r} has a step of {step:.6g} s"
            claims = claims.add_step(self.table.line, words, step)
        names = quote_names(self.table.names)
        missing = f"no column of times is among {names}"
        step = claims.require_step(self.text, missing, self.table.line)
        components: list[Component] = []
        # Not strict: the row of times, if there is one, comes last.
        for (column, argument), row in zip(columns.items(), values, strict=False):
            head = self.table.heads[column]
            direction = find_clear_direction(head.name)
            # Errors about where it points have to tell it from the horizontal one.
            where = f", column {head.words!r}" if argument == "vertical" else ""
            title = f"{str(self.text.path)!r}{where}"
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
        if columns and (unit := heads[columns[0]].unit) and math.isnan(unit.factor):
            words = quote_word(heads[columns[0]].words)
            raise self._error(f"the unit of the times is not understood: {words}")
        return columns[0] if columns else None

    def _refuse_spectra(self) -> None:
        """Refuse spectra, and tables of intensities and of rates.

        Their periods pass for times, and their accelerations for motion.
        """
        heads = self.table.heads
        way = "a spectrum over periods or frequencies is no ground motion"
        for head in heads:
            if head.quantity == "period":
                raise self._error(f"times were expected, got column {head.words!r}: {way}")
            if head.quantity in _NO_SERIES and self.times is None:
                raise self._error(
                    f"samples in time were expected, got column {head.words!r} ({head.quantity})"
                )
        spectral = [head for head in heads if head.quantity == "spectral acceleration"]
        if spectral and not any(head.quantity == "acceleration" for head in heads):
            raise self._error(
                f"accelerations were expected, got column {spectral[0].words!r}: {way}"
            )
        above = [note[1] for note in self.table.notes]
        above += [self.text.path.stem, *self.table.names]
        unclear = self.times is not None and heads[self.times].name == "T"
        if unclear and any(map(_SPECTRUM.search, above)):
            raise self._error(
                "'T' may be the periods of the spectrum of which the text above, another column or"
                f" the name of the file speaks, and {way}: name the times 'time'"
            )

    def _list_accelerations(self) -> list[int]:
        """List the columns that may be accelerations."""
        heads = self.table.heads
        columns = [
            k
            for k, head in enumerate(heads)
            if k != self.times and head.quantity in ("acceleration", "")
        ]
        stated = [k for k in columns if any(math.isfinite(u.factor) for u in heads[k].units)]
        # One letter, as in a and b, is no name of a quantity.
        named = [k for k in columns if heads[k].quantity and len(heads[k].name) > 1]
        return stated or named or columns

    def _find_unit(self, column: int, claims: Claims) -> float:
        """Find the unit of a column [m/s2]; a `ValueError` if it is no acceleration."""
        head = self.table.heads[column]
        line = self.table.line
        if head.quantity not in ("acceleration", ""):
            raise self._error(
                f"acceleration was expected, column {head.words!r} is of another quantity:"
                f" {head.quantity}"
            )
        # Without a caller's unit, a_g is no statement: it may mean ground acceleration as well.
        if claims.units or head.words.lower() != "a_g":
            for unit in head.units:
                claims = claims.add_unit(
                    line, f"column {head.words!r} states {unit.words}", unit.factor
                )
        # Notes may speak of several columns: one that agrees is enough.
        notes = collect_statements(find_units, self.table.notes, "a comment")
        ours = claims.units[0].value if claims.units else math.nan
        agreeing = [note for note in notes if math.isclose(note.value, ours)]
        for note in agreeing or notes:
            claims = claims.add_unit(*note)
        return claims.require_unit(self.text, "the file states no unit of this column")

    def _collect_steps(self) -> list[Statement]:
        """Collect what the text above and the names of the columns state of the time step."""
        stated = collect_statements(find_steps, self.table.notes, "a comment")
        names = [(self.table.line, name) for name in self.table.names]
        return stated + collect_statements(find_steps, names, "the name of a column")

    def _find_step(self, times: np.ndarray, claims: Claims) -> float:
        """Find the step [s] of the times; an error names the first line that differs."""
        column = self.times or 0
        head = self.table.heads[column]
        seconds = head.unit.factor if head.unit else 1.0
        step = find_uniform_step(times)
        if step is not None:
            return seconds * step
        rows = self.table.rows
        words = [row.cells[column] for row in rows]
        stated = [claim.value / seconds for claim in claims.steps]
        step = find_printed_step(words, times, stated)
        if step is not None:
            return seconds * step
        steps = np.diff(times)
        # The median, so that the error names the odd step, not all others.
        usual = float(np.median(steps))
        increase = bool((steps > 0).all())
        at = int(np.argmax(abs(steps - usual) > UNIFORM * usual if increase else steps <= 0))
        reason = (
            f"must have a uniform step, mostly {seconds * usual:.6g} s" if increase else ""
        )
        raise self.text.error(
            f"column {head.words!r} {reason or 'must increase'}, got {seconds * times[at]} and"
            f" then {seconds * times[at + 1]}",
            rows[at + 1].line,
        )


def require_samples_alone(text: TextFile, values: np.ndarray, line: int) -> None:
    """Raise a `ValueError` if the numbers of a file without times are more than accelerations.

    Some programs write the number of samples and the time step in front of them, and a column
    of times alone is no motion.
    """
    count = values.size
    if count > _FEW and values[0] in (count - 1, count - 2):
        raise text.error(
            f"the first number, {values[0]:g}, is how many follow: leave out what stands in front"
            " of the accelerations, and state time_step",
            line,
        )
    steps = np.diff(values)
    if count > _FEW and steps[0] > 0 and np.allclose(steps, steps[0], rtol=UNIFORM, atol=0):
        raise text.error(
            "accelerations were expected, but the numbers rise evenly, as times do", line
        )


def is_search_report(text: TextFile) -> bool:
    """Return whether a table is PEER's report of a search for records."""
    first = next((line for line in text.lines if line.strip()), "")
    return _SEARCH_REPORT.match(first) is not None
