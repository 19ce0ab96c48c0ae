"""The paper regenerated: its tables, figures and claims, and its faults.

C. Casapulla, On the Resonance Conditions of Rigid Rocking Blocks. The tables as printed are in
``data/paper.json``; everything else is computed.
"""

import csv
import math
from collections.abc import Iterator
from dataclasses import astuple, dataclass, fields
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..block import Block
from ..resonance import (
    Oscillator,
    Scene,
    amplification,
    damping_from_decay,
    equivalent_damping_as_printed,
)
from ..spectra import resonance_spectrum
from .paper_claims import (
    CLAIMS,
    FAULTS,
    INTENSITY,
    SLENDERNESS,
    WIDTHS,
    Check,
    Grid,
    both,
    paper_scene,
    printed_tables,
)

if TYPE_CHECKING:
    import xarray


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
        entries = [entry for entry in self.entries if entry.agrees == bool(entry.fault)]
        findings = [finding for finding in (*self.claims, *self.faults) if not finding.valid]
        return [
            *(
                f"Table {e.table}, {e.quantity}, {e.row}, {e.column}:"
                f" printed {e.printed}, computed {e.computed:.6g}"
                for e in entries
            ),
            *(f"{f.where}: {f.statement} ({f.figure})" for f in findings),
        ]


def regenerate() -> Report:
    """Recompute all that the paper states. Float64 is needed for the printed digits."""
    grid = Grid()

    def checked(where: str, statement: str, check: Check) -> Finding:
        valid, figure = check(grid)
        return Finding(where, statement, bool(valid), figure)

    claims, faults = ([checked(*row) for row in table] for table in (CLAIMS, FAULTS))
    return Report(list(_entries()), claims, faults)


def figures() -> dict[str, tuple["xarray.DataArray", str, str]]:
    """Figs. 3 to 8: the variable drawn over slenderness, what tells the curves apart, a title."""
    slenderness = np.linspace(*SLENDERNESS, 701)
    spectrum = resonance_spectrum(
        slenderness, WIDTHS, [0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8], INTENSITY
    )
    drawn = {
        "figure_3": (spectrum.period.sel(restitution=0.6), "width", "$C$ = 0.6"),
        "figure_4a": (spectrum.amplification.sel(width=0.4), "restitution", "$2b$ = 0.4 m"),
        "figure_4b": (spectrum.amplification.sel(width=1.2), "restitution", "$2b$ = 1.2 m"),
        "figure_5": (spectrum.period.sel(width=0.8), "restitution", "$2b$ = 0.8 m"),
    }
    for number, restitution in ((6, 0.6), (7, 0.7), (8, 0.8)):
        ratio = spectrum.rotation_ratio.sel(restitution=restitution)
        drawn[f"figure_{number}"] = (ratio, "width", f"$C$ = {restitution}")
    return drawn


FILES = (
    "report.md",
    "table_1.csv",
    "table_2.csv",
    "table_3.csv",
    *(f"figure_{name}.png" for name in ("1", "2", "3", "4a", "4b", "5", "6", "7", "8")),
)


def write(report: Report, folder: Path) -> None:
    """Write `FILES` into an existing folder: the report, its tables and the figures."""
    import matplotlib.pyplot as plt

    from ..plot import plot_block, plot_curves, plot_resonance

    for number, table in (("1", "I"), ("2", "II"), ("3", "III")):
        path = folder / f"table_{number}.csv"
        with open(path, "w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow([*(field.name for field in fields(Entry)[1:]), "agrees"])
            for entry in report.entries:
                if entry.table == table:
                    writer.writerow([*astuple(entry)[1:], entry.agrees])
    curves, scene = figures(), paper_scene(3.0, 0.8, 0.7)
    pulses = f"$I$ = {INTENSITY} m/s"
    titles = {
        "figure_1": r"a block, $\lambda$ = 3, $2b$ = 0.8 m",
        "figure_2": rf"$\lambda$ = 3, $2b$ = 0.8 m, $C$ = 0.7, {pulses}",
        **{name: f"{title}, {pulses}" for name, (_, _, title) in curves.items()},
    }
    for name, title in titles.items():
        figure, ax = plt.subplots(figsize=(5.5, 4), layout="constrained")
        if name == "figure_1":
            plot_block(scene.block, ax=ax)
        elif name == "figure_2":
            plot_resonance(scene, ax=ax)
        else:
            variable, hue, _ = curves[name]
            plot_curves(variable, hue, ax=ax)
        ax.set_title(f"Fig. {name.removeprefix('figure_')}: {title}")
        figure.savefig(folder / f"{name}.png", dpi=150)
        plt.close(figure)
    (folder / "report.md").write_text(_markdown(report, titles), encoding="utf-8")


def _entries() -> Iterator[Entry]:
    tables = printed_tables()
    for key, numeral, method in (
        ("table_1", "I", "peak_rotation"),
        ("table_2", "II", "half_cycle_duration"),
    ):
        table = tables[key]
        widths, columns = table["width"], [f"lambda = {value}" for value in table["slenderness"]]
        block = Block(
            np.asarray(widths)[:, None] / 2, np.asarray(table["slenderness"], float)[None]
        )
        velocity = block.pulse_velocity(table["intensity"])
        values = both(lambda model, m=method, b=block, v=velocity: getattr(model, m)(b, v))
        rows = [(table["quantity"], f"2b = {width} m") for width in widths]
        printed = list(table["printed"])
        if numeral == "II":
            rows.append(("difference from smallest to largest width [%]", "all"))
            printed.append(table["difference_percent"])
            values = tuple(np.vstack([v, 100 * (1 - v[-1] / v[0])]) for v in values)
        for i, row in enumerate(rows):
            for j, column in enumerate(columns):
                linearized, nonlinear = (float(of_model[i, j]) for of_model in values)
                yield Entry(numeral, *row, column, printed[i][j], linearized, nonlinear)
    table = tables["table_3"]
    damping, decay, restitution = (np.asarray(table[name], float) for name in ("xi", "B", "C"))
    oscillator = Oscillator(1.0, damping)
    block = Block(table["width"] / 2, table["slenderness"])
    zeta = both(lambda m: amplification(Scene(block, restitution, table["intensity"]), m))
    none = np.full(damping.shape, np.nan)
    for name, quantity, argument, values, nonlinear in (
        ("B", "elastic velocity decay, Eq. 18", "xi", oscillator.velocity_decay, none),
        ("xi", "elastic damping ratio, Eq. 19", "B", damping_from_decay(decay), none),
        ("psi", "elastic amplification, Eqs. 18 and 23", "xi", oscillator.amplification, none),
        ("beta", "damping, Eq. 13", "C", equivalent_damping_as_printed(restitution), none),
        ("zeta", "rocking amplification, Eqs. 6 and 12", "C", *zeta),
    ):
        for i, printed in enumerate(table[name]):
            row = f"{argument} = {table[argument][i]}"
            fault = "the block overturns" if (name, row) == ("zeta", "C = 0.9") else ""
            computed = float(values[i])
            yield Entry("III", quantity, row, name, printed, computed, float(nonlinear[i]), fault)


def summary(report: Report) -> str:
    """What agrees, in a sentence."""
    known = sum(bool(entry.fault) for entry in report.entries)
    return (
        f"{sum(entry.agrees for entry in report.entries)} of {len(report.entries)} printed"
        f" numbers agree to the digits printed ({known} known to be wrong),"
        f" {sum(c.valid for c in report.claims)} of {len(report.claims)} claims hold,"
        f" {sum(f.valid for f in report.faults)} of {len(report.faults)} known faults reproduced."
    )


def _markdown(report: Report, titles: dict[str, str]) -> str:
    lines = [
        "# On the Resonance Conditions of Rigid Rocking Blocks, recomputed",
        "",
        f"{summary(report)} Gravity 9.81 m/s2, pulses of 0.15 m/s.",
        "",
    ]
    if report.mismatches:
        lines += ["## Mismatches", "", *(f"- {line}" for line in report.mismatches), ""]
    for title, findings, verdict in (
        ("Claims", report.claims, "valid"),
        ("Faults", report.faults, "reproduced"),
    ):
        lines += [f"## {title}", "", f"| where | what | {verdict} | figure |", "|---|---|---|---|"]
        lines += [
            f"| {f.where} | {f.statement} | {'yes' if f.valid else '**no**'} | {f.figure} |"
            for f in findings
        ]
        lines.append("")
    for table in ("I", "II", "III"):
        lines += [
            f"## Table {table}",
            "",
            "The last column is the same quantity without linearizing the equation of motion.",
            "",
            "| quantity | row | column | printed | computed | agrees | nonlinear |",
            "|---|---|---|---|---|---|---|",
        ]
        for entry in report.entries:
            if entry.table == table:
                agrees = "yes" if entry.agrees else f"**no**: {entry.fault or 'unexplained'}"
                lines.append(
                    f"| {entry.quantity} | {entry.row} | {entry.column} | {entry.printed} |"
                    f" {_shown(entry.computed)} | {agrees} | {_shown(entry.nonlinear, '')} |"
                )
        lines.append("")
    lines.append("## Figures")
    for name, title in titles.items():
        lines += ["", f"![Fig. {name.removeprefix('figure_')}, {title}]({name}.png)"]
    return "\n".join(lines) + "\n"


def _shown(value: float, missing: str = "overturns") -> str:
    return missing if math.isnan(value) else f"{value + 0.0:.5g}"  # no "-0"
