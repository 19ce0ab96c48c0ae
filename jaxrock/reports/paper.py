"""The paper regenerated: its tables, figures and claims, and its faults.

C. Casapulla, On the Resonance Conditions of Rigid Rocking Blocks. What it prints is in
``data/paper.json``; everything else is computed.
"""

import csv
import functools
import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, fields
from decimal import Decimal
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..block import Block
from ..resonance import (
    Oscillator,
    Scene,
    amplification,
    damping_from_decay,
    equivalent_damping_as_printed,
)
from .paper_numbers import INTENSITY, MODELS, paper_numbers, paper_scene, paper_spectrum

if TYPE_CHECKING:
    import xarray

_TABLES = {"I": "table_1", "II": "table_2", "III": "table_3"}
FILES = (
    "report.md",
    *(f"{table}.csv" for table in _TABLES.values()),
    *(f"figure_{name}.png" for name in ("1", "2", "3", "4a", "4b", "5", "6", "7", "8")),
)


@dataclass(frozen=True)
class Entry:
    """A printed number and what it should be."""

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
        """Whether `computed` is `printed` to the digits given there."""
        if self.printed == "overturning":
            return math.isnan(self.computed)
        if self.printed == "inf":
            return math.isinf(self.computed)
        unit = Decimal(1).scaleb(int(Decimal(self.printed).as_tuple().exponent))
        return abs(self.computed - float(self.printed)) <= 0.5 * float(unit)


@dataclass(frozen=True)
class Finding:
    """A claim or a fault of the paper, with the figure that it rests on."""

    where: str
    statement: str
    valid: bool
    figure: str


@dataclass(frozen=True)
class Report:
    """Everything that `jaxrock paper` compares."""

    entries: list[Entry]
    claims: list[Finding]
    faults: list[Finding]

    @property
    def mismatches(self) -> list[str]:
        """What disagrees without being a known fault, and known faults that do not show."""
        entries = [
            f"Table {e.table}, {e.quantity}, {e.row}, {e.column}:"
            f" printed {e.printed}, computed {e.computed:.6g}"
            for e in self.entries
            if e.agrees == bool(e.fault)
        ]
        findings = [f for f in (*self.claims, *self.faults) if not f.valid]
        return entries + [f"{f.where}: {f.statement} ({f.figure})" for f in findings]


def printed_tables() -> dict[str, Any]:
    """The tables as printed, the claims and the faults, with the bounds that tell them."""
    return json.loads((files("jaxrock") / "data" / "paper.json").read_text(encoding="utf-8"))


def regenerate() -> Report:
    """Recompute all that the paper states. Float64 is needed for the printed digits."""
    data, numbers = printed_tables(), paper_numbers()
    claims, faults = ([finding(row, numbers) for row in data[key]] for key in ("claims", "faults"))
    return Report(list(_entries(data)), claims, faults)


def finding(row: Mapping[str, Any], numbers: Mapping[str, np.ndarray]) -> Finding:
    """Whether the numbers that a claim is about are within their bounds."""
    valid = True
    for name, bounds in row["within"].items():
        value, (low, high) = numbers[name], np.asarray(bounds, float).T  # NaN where there is none
        valid &= bool(np.all(np.isfinite(value) & ~(value <= low) & ~(value >= high)))
    return Finding(row["where"], row["statement"], valid, row["figure"].format_map(numbers))


def _entries(data: Mapping[str, Any]) -> Iterator[Entry]:
    for numeral, method in (("I", "peak_rotation"), ("II", "half_cycle_duration")):
        table = data[_TABLES[numeral]]
        widths, slenderness = (np.asarray(table[key], float) for key in ("width", "slenderness"))
        block = Block(widths[:, None] / 2, slenderness[None])
        velocity = block.pulse_velocity(table["intensity"])
        values = [np.asarray(getattr(model, method)(block, velocity)) for model in MODELS]
        rows = [f"2b = {width} m" for width in table["width"]]
        columns = [f"lambda = {value}" for value in table["slenderness"]]
        yield from _sheet(numeral, table["quantity"], rows, columns, table["printed"], values)
        if "difference_percent" in table:
            quantity = "difference from smallest to largest width [%]"
            values = [100 * (1 - each[-1:] / each[:1]) for each in values]
            printed = [table["difference_percent"]]
            yield from _sheet(numeral, quantity, ["all"], columns, printed, values)
    table = data["table_3"]
    damping, decay, restitution = (np.asarray(table[key], float) for key in ("xi", "B", "C"))
    oscillator, none = Oscillator(1.0, damping), np.full(damping.shape, np.nan)
    scene = Scene(Block(table["width"] / 2, table["slenderness"]), restitution, table["intensity"])
    computed = {
        "B": [oscillator.velocity_decay, none],
        "xi": [damping_from_decay(decay), none],
        "psi": [oscillator.amplification, none],
        "beta": [equivalent_damping_as_printed(restitution), none],
        "zeta": [amplification(scene, model) for model in MODELS],
    }
    for name, (quantity, argument) in table["quantities"].items():
        rows = [f"{argument} = {value}" for value in table[argument]]
        printed = [[value] for value in table[name]]
        values = [np.asarray(each)[:, None] for each in computed[name]]
        yield from _sheet("III", quantity, rows, [name], printed, values, table["faults"])


def _sheet(
    table: str,
    quantity: str,
    rows: Sequence[str],
    columns: Sequence[str],
    printed: Sequence[Sequence[str]],
    values: Sequence[np.ndarray],
    faults: Mapping[str, str] = {},
) -> Iterator[Entry]:
    """The entries of one quantity; `values` are linearized and nonlinear."""
    for i, row in enumerate(rows):
        for j, column in enumerate(columns):
            computed, nonlinear = (float(of_model[i, j]) for of_model in values)
            fault = faults.get(f"{column}, {row}", "")
            yield Entry(table, quantity, row, column, printed[i][j], computed, nonlinear, fault)


def figures() -> dict[str, tuple["xarray.DataArray", str, str]]:
    """Figs. 3 to 8: the variable drawn over slenderness, what tells the curves apart, a title."""
    spectrum = paper_spectrum()
    zeta, period, ratio = (
        spectrum[name].sel(restitution=[0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8])
        for name in ("amplification", "period", "rotation_ratio")
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
    import matplotlib.pyplot as plt

    from ..plot import plot_block, plot_curves, plot_resonance

    for numeral, name in _TABLES.items():
        entries = [entry for entry in report.entries if entry.table == numeral]
        with open(folder / f"{name}.csv", "w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow([*(field.name for field in fields(Entry)[1:]), "agrees"])
            writer.writerows([*astuple(entry)[1:], entry.agrees] for entry in entries)
    scene, pulses = paper_scene(3.0, 0.8, 0.7), f"$I$ = {INTENSITY} m/s"
    size = r"$\lambda$ = 3, $2b$ = 0.8 m"
    drawings = {
        "figure_1": (f"a block, {size}", functools.partial(plot_block, scene.block)),
        "figure_2": (f"{size}, $C$ = 0.7, {pulses}", functools.partial(plot_resonance, scene)),
    }
    for name, (variable, hue, title) in figures().items():
        drawings[name] = f"{title}, {pulses}", functools.partial(plot_curves, variable, hue)
    for name, (title, draw) in drawings.items():
        figure, ax = plt.subplots(figsize=(5.5, 4), layout="constrained")
        draw(ax=ax)
        ax.set_title(f"Fig. {name.removeprefix('figure_')}: {title}")
        figure.savefig(folder / f"{name}.png", dpi=150)
        plt.close(figure)
    titles = {name: title for name, (title, _) in drawings.items()}
    (folder / "report.md").write_text(_markdown(report, titles), encoding="utf-8")


def summary(report: Report) -> str:
    """What agrees, in a sentence."""
    known = sum(bool(entry.fault) for entry in report.entries)
    return (
        f"{sum(entry.agrees for entry in report.entries)} of {len(report.entries)} printed"
        f" numbers agree to the digits printed ({known} known to be wrong),"
        f" {sum(c.valid for c in report.claims)} of {len(report.claims)} claims hold,"
        f" {sum(f.valid for f in report.faults)} of {len(report.faults)} known faults reproduced."
    )


def _markdown(report: Report, titles: Mapping[str, str]) -> str:
    lines = ["# On the Resonance Conditions of Rigid Rocking Blocks, recomputed", ""]
    lines += [f"{summary(report)} Gravity 9.81 m/s2, pulses of {INTENSITY} m/s.", ""]
    if report.mismatches:
        lines += ["## Mismatches", "", *(f"- {line}" for line in report.mismatches), ""]
    for title, verdict in (("Claims", "valid"), ("Faults", "reproduced")):
        findings = getattr(report, title.lower())
        rows = [(f.where, f.statement, "yes" if f.valid else "**no**", f.figure) for f in findings]
        lines += [f"## {title}", "", *_table(("where", "what", verdict, "figure"), rows), ""]
    shown = ("quantity", "row", "column", "printed", "computed", "agrees", "nonlinear")
    same = "The last column is the same quantity without linearizing the equation of motion."
    for table in _TABLES:
        rows = [_cells(entry) for entry in report.entries if entry.table == table]
        lines += [f"## Table {table}", "", same, "", *_table(shown, rows), ""]
    lines.append("## Figures")
    for name, title in titles.items():
        lines += ["", f"![Fig. {name.removeprefix('figure_')}, {title}]({name}.png)"]
    return "\n".join(lines) + "\n"


def _table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    first, *others = (f"| {' | '.join(cells)} |" for cells in (header, *rows))
    return [first, "|" + "---|" * len(header), *others]


def _cells(entry: Entry) -> tuple[str, ...]:
    def shown(value: float, missing: str) -> str:
        return missing if math.isnan(value) else f"{value + 0.0:.5g}"  # no "-0"

    agrees = "yes" if entry.agrees else f"**no**: {entry.fault or 'unexplained'}"
    computed, nonlinear = shown(entry.computed, "overturns"), shown(entry.nonlinear, "")
    return entry.quantity, entry.row, entry.column, entry.printed, computed, agrees, nonlinear
