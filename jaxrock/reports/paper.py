"""The paper regenerated: its tables, figures and claims, and its faults.

C. Casapulla, On the Resonance Conditions of Rigid Rocking Blocks. Its printed numbers and its
claims are in ``data/paper.json``, with the bounds by which a claim is judged. The functions
here compare them with the numbers of ``paper_numbers.py``, and write tables, figures and a
report.
"""

import collections
import csv
import functools
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass, fields
from decimal import Decimal
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import resonance
from ..block import Block
from ..host import show_progress
from .paper_numbers import INTENSITY, compute_numbers, compute_spectrum, make_scene

if TYPE_CHECKING:
    import xarray

_TABLES = {"I": "table_1", "II": "table_2", "III": "table_3"}
_NOT_CONFIRMED = "not confirmed"
FILES = (
    "report.md",
    *(f"{table}.csv" for table in _TABLES.values()),
    *(f"figure_{name}.png" for name in ("1", "2", "3", "4a", "4b", "5", "6", "7", "8")),
)


@dataclass(frozen=True)
class Entry:
    """A printed number and its computed value."""

    table: str
    quantity: str
    row: str
    column: str
    printed: str
    computed: float
    nonlinear: float  # the same from `Nonlinear`; NaN where no block is involved
    fault: str = ""  # why the printed number is known to be wrong

    @property
    def agrees(self) -> bool:
        """True if `computed` is `printed` to the digits given there."""
        if self.printed == "overturning":
            return math.isnan(self.computed)
        if self.printed == "inf":
            return math.isinf(self.computed)
        # Right is the computed number, rounded: within half a unit of the last digit printed.
        unit = Decimal(1).scaleb(int(Decimal(self.printed).as_tuple().exponent))
        return abs(self.computed - float(self.printed)) <= 0.5 * float(unit)


@dataclass(frozen=True)
class Finding:
    """A claim or a fault of the paper, its verdict, and the figure that this rests on."""

    where: str
    statement: str
    verdict: str  # of a claim "holds" or how far it does, of a fault "reproduced"
    figure: str


@dataclass(frozen=True)
class Report:
    """Everything that `jaxrock paper` compares."""

    entries: list[Entry]
    claims: list[Finding]
    faults: list[Finding]

    @property
    def mismatches(self) -> list[str]:
        """Disagreements that are no known faults, and known faults that do not show."""
        # Both ways: a fault that does not show any more would be a change of the answers.
        entries = [
            f"Table {entry.table}, {entry.quantity}, {entry.row}, {entry.column}:"
            f" printed {entry.printed}, computed {entry.computed:.6g}"
            for entry in self.entries
            if entry.agrees == bool(entry.fault)
        ]
        findings = [
            f"{finding.where}: {finding.statement} ({finding.figure})"
            for finding in (*self.claims, *self.faults)
            if finding.verdict == _NOT_CONFIRMED
        ]
        return entries + findings

    def count(self) -> dict[str, object]:
        """Count what was compared, and list the mismatches."""
        return {
            "printed": len(self.entries),
            "agreeing": sum(entry.agrees for entry in self.entries),
            "known_faults_in_tables": sum(bool(entry.fault) for entry in self.entries),
            "claims": collections.Counter(claim.verdict for claim in self.claims),
            "faults": collections.Counter(fault.verdict for fault in self.faults),
            "mismatches": self.mismatches,
        }


def read_printed_tables() -> dict[str, Any]:
    """Read the printed tables, the claims and the faults, with the bounds that judge them."""
    return json.loads((files("jaxrock") / "data" / "paper.json").read_text(encoding="utf-8"))


def regenerate() -> Report:
    """Compute anew all that the paper states. Float64 is needed for the printed digits."""
    numbers = compute_numbers()
    data = read_printed_tables()
    entries = [
        Entry(
            table=table["table"],
            quantity=table["quantity"],
            row=row,
            column=column,
            printed=table["printed"][i][j],
            computed=float(numbers[table["computed"]][0, i, j]),
            nonlinear=float(numbers[table["computed"]][1, i, j]),
            fault=data["known"].get(f"Table {table['table']}, {row}, {column}", ""),
        )
        for table in data["tables"]
        for i, row in enumerate(table["rows"])
        for j, column in enumerate(table["columns"])
    ]
    claims, faults = (
        [judge(row, numbers) for row in data[key]] for key in ("claims", "faults")
    )
    return Report(entries, claims, faults)


def judge(row: Mapping[str, Any], numbers: Mapping[str, np.ndarray]) -> Finding:
    """Judge a claim or a fault by its numbers.

    Those in "within" have to be within their bounds. Those in "limited" have not to be: a
    claim that held for them too would have no limit, and its verdict were wrong.
    """

    def are_within(name: str, bounds: Sequence[object]) -> bool:
        # A bound that is missing is NaN, to which every comparison is false: hence the
        # negations.
        value = numbers[name]
        low, high = np.asarray(bounds, float).T
        return bool(np.all(np.isfinite(value) & ~(value <= low) & ~(value >= high)))

    valid = all(are_within(*item) for item in row["within"].items())
    limited = not any(are_within(*item) for item in row.get("limited", {}).items())
    verdict = row["verdict"] if valid and limited else _NOT_CONFIRMED
    return Finding(row["where"], row["statement"], verdict, row["figure"].format_map(numbers))


def select_figures() -> dict[str, tuple["xarray.DataArray", str, str]]:
    """Select for Figs. 3 to 8 a variable over slenderness, the hue of its curves, a title."""
    spectrum = compute_spectrum()
    zeta, period, ratio = (
        spectrum[name].sel(restitution=[0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8])
        for name in ("amplification", "stabilized_period", "rotation_ratio")
    )
    return {
        "figure_3": (period.sel(restitution=0.6), "width", "$C$ = 0.6"),
        "figure_4a": (zeta.sel(width=0.4), "restitution", "$2b$ = 0.4 m"),
        "figure_4b": (zeta.sel(width=1.2), "restitution", "$2b$ = 1.2 m"),
        "figure_5": (period.sel(width=0.8), "restitution", "$2b$ = 0.8 m"),
        "figure_6": (ratio.sel(restitution=0.6), "width", "$C$ = 0.6"),
        "figure_7": (ratio.sel(restitution=0.7), "width", "$C$ = 0.7"),
        "figure_8": (ratio.sel(restitution=0.8), "width", "$C$ = 0.8"),
    }


def write(report: Report, folder: Path) -> None:
    """Write `FILES` into an existing folder: the report, its tables and the figures."""
    # It loads slowly, and to compare numbers needs no pictures.
    import matplotlib.pyplot as plt

    from ..plot import plot_block, plot_curves, plot_resonance

    for numeral, name in _TABLES.items():
        entries = [entry for entry in report.entries if entry.table == numeral]
        with open(folder / f"{name}.csv", "w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow([*(field.name for field in fields(Entry)[1:]), "agrees"])
            writer.writerows([*astuple(entry)[1:], entry.agrees] for entry in entries)
    scene = make_scene(3.0, 0.8, 0.7)
    pulses = f"$I$ = {INTENSITY} m/s"
    size = r"$\lambda$ = 3, $2b$ = 0.8 m"
    drawings = {
        "figure_1": (f"a block, {size}", functools.partial(plot_block, scene.block)),
        "figure_2": (f"{size}, $C$ = 0.7, {pulses}", functools.partial(plot_resonance, scene)),
    }
    # All are drawn the same way: what differs is bound before.
    for name, (variable, hue, title) in select_figures().items():
        draw = functools.partial(
            plot_curves, variable, hue, thresholds=_find_thresholds(variable)
        )
        drawings[name] = f"{title}, {pulses}", draw
    for name, (title, draw) in show_progress(drawings.items(), "drawing figures"):
        figure, ax = plt.subplots(figsize=(5.5, 4), layout="constrained")
        draw(ax=ax)
        ax.set_title(f"{_name_figure(name)}: {title}")
        figure.savefig(folder / f"{name}.png", dpi=150)
        # pyplot keeps every figure until it is closed.
        plt.close(figure)
    titles = {name: title for name, (title, _) in drawings.items()}
    (folder / "report.md").write_text(_write_markdown(report, titles), encoding="utf-8")


def _find_thresholds(variable: "xarray.DataArray") -> "xarray.DataArray | None":
    """Find the slenderness from which on a block overturns, for each curve of a figure.

    None for amplifications, which the thresholds are not written beside.
    """
    if variable.name == "amplification":
        return None
    blocks = Block(variable.width.values / 2, 1.0)
    limits = resonance.critical_slenderness(blocks, variable.restitution.values, INTENSITY)
    # One of the two is a single number: the other one tells the curves apart.
    along = variable.width if variable.width.ndim else variable.restitution
    return along.copy(data=np.asarray(limits))


def summarize(report: Report) -> str:
    """Summarize in two sentences what agrees."""
    count: dict[str, Any] = report.count()
    claims, faults = (
        ", ".join(f"{verdict}: {number}" for verdict, number in count[name].items())
        for name in ("claims", "faults")
    )
    return (
        f"{count['agreeing']} of {count['printed']} printed numbers agree to the digits printed"
        f" ({count['known_faults_in_tables']} known to be wrong)."
        f" Claims in words ({claims}), known faults ({faults})."
    )


def _write_markdown(report: Report, titles: Mapping[str, str]) -> str:
    """Write the report: mismatches first, then claims, faults, tables and figures."""
    lines = ["# On the Resonance Conditions of Rigid Rocking Blocks, recomputed", ""]
    lines += [f"{summarize(report)} Gravity 9.81 m/s2, pulses of {INTENSITY} m/s.", ""]
    if report.mismatches:
        lines += ["## Mismatches", "", *(f"- {line}" for line in report.mismatches), ""]
    for title, findings in (("Claims", report.claims), ("Faults", report.faults)):
        rows = map(astuple, findings)
        table = _write_markdown_table(("where", "what", "verdict", "figure"), rows)
        lines += [f"## {title}", "", *table, ""]
    shown = ("quantity", "row", "column", "printed", "computed", "agrees", "nonlinear")
    same = "The last column is the same quantity without linearizing the equation of motion."
    for table in _TABLES:
        rows = [_write_cells(entry) for entry in report.entries if entry.table == table]
        lines += [f"## Table {table}", "", same, "", *_write_markdown_table(shown, rows), ""]
    lines.append("## Figures")
    for name, title in titles.items():
        lines += ["", f"![{_name_figure(name)}, {title}]({name}.png)"]
    return "\n".join(lines) + "\n"


def _name_figure(name: str) -> str:
    """Name a figure as the paper does, such as Fig. 4a, by the name of its file."""
    return f"Fig. {name.removeprefix('figure_')}"


def _write_markdown_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Write the lines of a table in Markdown."""
    head, *lines = (f"| {' | '.join(cells)} |" for cells in (header, *rows))
    return [head, "|" + "---|" * len(header), *lines]


def _write_cells(entry: Entry) -> tuple[str, ...]:
    """Write the cells of an entry of a table."""

    def write(value: float, missing: str) -> str:
        """Write a number to more digits than the paper prints; + 0.0 makes 0 of -0."""
        return missing if math.isnan(value) else f"{value + 0.0:.5g}"

    agrees = "yes" if entry.agrees else f"**no**: {entry.fault or 'unexplained'}"
    computed = write(entry.computed, "overturns")
    nonlinear = write(entry.nonlinear, "")
    return entry.quantity, entry.row, entry.column, entry.printed, computed, agrees, nonlinear
