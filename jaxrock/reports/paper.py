"""The paper regenerated: its tables, figures and claims, and its faults.

C. Casapulla, On the Resonance Conditions of Rigid Rocking Blocks. What it prints and claims is
in ``data/paper.json``, with the bounds by which a claim is judged. The numbers are computed
here, by the names they have there; shares and changes in percent, pairs the least and the
largest.
"""

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
from ..resonance import Linearized, Nonlinear, Oscillator, Scene
from ..spectra import resonance_spectrum

if TYPE_CHECKING:
    import xarray

_LINEARIZED = Linearized()
_MODELS = (_LINEARIZED, Nonlinear())
_INTENSITY = 0.15
_WIDTHS = np.array([0.4, 0.6, 0.8, 1.0, 1.2])
_SLENDERNESS = np.linspace(3.0, 10.0, 701)
_RESTITUTION = np.append(np.linspace(0.5, 0.7, 41).round(3), [0.75, 0.8, 0.85])
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
        """True if `computed` is `printed` to the digits given there."""
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
        """Disagreements that are no known faults, and known faults that do not show."""
        entries = [
            f"Table {e.table}, {e.quantity}, {e.row}, {e.column}:"
            f" printed {e.printed}, computed {e.computed:.6g}"
            for e in self.entries
            if e.agrees == bool(e.fault)
        ]
        findings = [f for f in (*self.claims, *self.faults) if not f.valid]
        return entries + [f"{f.where}: {f.statement} ({f.figure})" for f in findings]


def printed_tables() -> dict[str, Any]:
    """Read the printed tables, the claims and the faults, with the bounds that judge them."""
    return json.loads((files("jaxrock") / "data" / "paper.json").read_text(encoding="utf-8"))


def regenerate() -> Report:
    """Recompute all that the paper states. Float64 is needed for the printed digits."""
    parts = (
        _of_tables,
        _of_one_pulse,
        _of_the_spectrum,
        _of_the_map,
        _of_damping,
        _of_linearizing,
    )
    numbers = {name: np.asarray(value) for part in parts for name, value in part().items()}
    data = printed_tables()
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
        [finding(row, numbers) for row in data[key]] for key in ("claims", "faults")
    )
    return Report(entries, claims, faults)


def finding(row: Mapping[str, Any], numbers: Mapping[str, np.ndarray]) -> Finding:
    """Check that the numbers of a claim are within their bounds."""
    valid = True
    for name, bounds in row["within"].items():
        # NaN where there is none
        value = numbers[name]
        low, high = np.asarray(bounds, float).T
        valid &= bool(np.all(np.isfinite(value) & ~(value <= low) & ~(value >= high)))
    return Finding(row["where"], row["statement"], valid, row["figure"].format_map(numbers))


def figures() -> dict[str, tuple["xarray.DataArray", str, str]]:
    """Figs. 3 to 8: the variable drawn over slenderness, what tells the curves apart, a title."""
    spectrum = _spectrum()
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
    scene = _scene(3.0, 0.8, 0.7)
    pulses = f"$I$ = {_INTENSITY} m/s"
    size = r"$\lambda$ = 3, $2b$ = 0.8 m"
    drawings = {
        "figure_1": (f"a block, {size}", functools.partial(plot_block, scene.block)),
        "figure_2": (f"{size}, $C$ = 0.7, {pulses}", functools.partial(plot_resonance, scene)),
    }
    for name, (variable, hue, title) in figures().items():
        draw = functools.partial(plot_curves, variable, hue, thresholds=_thresholds(variable))
        drawings[name] = f"{title}, {pulses}", draw
    for name, (title, draw) in drawings.items():
        figure, ax = plt.subplots(figsize=(5.5, 4), layout="constrained")
        draw(ax=ax)
        ax.set_title(f"Fig. {name.removeprefix('figure_')}: {title}")
        figure.savefig(folder / f"{name}.png", dpi=150)
        plt.close(figure)
    titles = {name: title for name, (title, _) in drawings.items()}
    (folder / "report.md").write_text(_markdown(report, titles), encoding="utf-8")


def _thresholds(variable: "xarray.DataArray") -> "xarray.DataArray | None":
    """Find the slenderness from which on each block overturns, where ratios are drawn."""
    if variable.name != "rotation_ratio":
        return None
    blocks = Block(variable.width.values / 2, 1.0)
    c = float(variable.restitution)
    limits = resonance.critical_slenderness(blocks, c, _INTENSITY)
    return variable.width.copy(data=np.asarray(limits))


def summary(report: Report) -> str:
    """Say what agrees, in a sentence."""
    known = sum(bool(entry.fault) for entry in report.entries)
    return (
        f"{sum(entry.agrees for entry in report.entries)} of {len(report.entries)} printed"
        f" numbers agree to the digits printed ({known} known to be wrong),"
        f" {sum(c.valid for c in report.claims)} of {len(report.claims)} claims hold,"
        f" {sum(f.valid for f in report.faults)} of {len(report.faults)} known faults reproduced."
    )


def _markdown(report: Report, titles: Mapping[str, str]) -> str:
    lines = ["# On the Resonance Conditions of Rigid Rocking Blocks, recomputed", ""]
    lines += [f"{summary(report)} Gravity 9.81 m/s2, pulses of {_INTENSITY} m/s.", ""]
    if report.mismatches:
        lines += ["## Mismatches", "", *(f"- {line}" for line in report.mismatches), ""]
    for title, verdict in (("Claims", "valid"), ("Faults", "reproduced")):
        findings = getattr(report, title.lower())
        rows = [
            (f.where, f.statement, "yes" if f.valid else "**no**", f.figure) for f in findings
        ]
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
    computed = shown(entry.computed, "overturns")
    nonlinear = shown(entry.nonlinear, "")
    return entry.quantity, entry.row, entry.column, entry.printed, computed, agrees, nonlinear


def _scene(slenderness: Any, width: Any, restitution: Any) -> Scene:
    """Make a block under the pulses of the paper."""
    return Scene(Block(width / 2, slenderness), restitution, _INTENSITY)


def _spectrum() -> "xarray.Dataset":
    """Compute the stabilized phase over all that the paper draws and makes claims about."""
    return resonance_spectrum(_SLENDERNESS, _WIDTHS, _RESTITUTION, _INTENSITY)


def _of_tables() -> dict[str, Any]:
    """Compute the tables by both models; NaN where no block is involved."""
    block = Block(_WIDTHS[:, None] / 2, np.array([[3.0, 5.0, 8.0, 10.0]]))
    velocity = block.pulse_velocity(_INTENSITY)
    durations = np.stack([model.half_cycle_duration(block, velocity) for model in _MODELS])
    oscillator = Oscillator(1.0, np.append(0.0, np.arange(1, 18, 2) / 100))
    decay = np.array([1.0, 0.97, 0.91, 0.85, 0.80, 0.75, 0.71, 0.66, 0.62, 0.58])
    restitution = np.arange(100, 50, -5) / 100
    elastic = {
        "velocity_decay": oscillator.velocity_decay,
        "damping_from_decay": resonance.damping_from_decay(decay),
        "elastic_amplification": oscillator.amplification,
        "equivalent_damping": resonance.equivalent_damping_as_printed(restitution),
    }
    scene = _scene(4.0, 1.2, restitution)
    rocking = np.stack([resonance.amplification(scene, model) for model in _MODELS])
    return {
        "peaks": [model.peak_rotation(block, velocity) for model in _MODELS],
        "durations": durations,
        "duration_differences": 100 * (1 - durations[:, -1:] / durations[:, :1]),
        **{n: np.stack([v, np.full_like(v, np.nan)])[..., None] for n, v in elastic.items()},
        "rocking_amplification": rocking[..., None],
    }


def _of_one_pulse() -> dict[str, Any]:
    """Eq. 2, Tables I and II: axis 0 is the slenderness, axis 1 the width."""
    scene = _scene(_SLENDERNESS[:, None], _WIDTHS[None], 0.6)
    block = scene.block
    launch = np.asarray(resonance.launch_velocity(scene))
    peak = np.asarray(_LINEARIZED.peak_rotation(block, launch))
    duration = np.asarray(_LINEARIZED.half_cycle_duration(block, launch))
    doubled = np.asarray(resonance.launch_velocity(Scene(block, 0.6, 2 * _INTENSITY)))
    return {
        "launch": (launch[-1, -1], launch[0, 0]),
        "launch_doubled": _range(doubled / launch),
        "launch_by_slenderness": _steps(launch, 0),
        "launch_by_size": _steps(launch, 1),
        "peak_by_slenderness": _steps(peak, 0),
        "peak_by_size": _steps(peak, 1),
        "peak_growth": _range(100 * (peak[-1] / peak[0] - 1)),
        "duration_by_slenderness": _steps(duration, 0),
        "duration_and_size": 100 * (1 - duration[:, -1] / duration[:, 0]).max(),
    }


def _of_the_spectrum() -> dict[str, Any]:
    """Figs. 3 to 8 and the amplification of Table III."""
    spectrum = _spectrum()
    at_05, at_06, at_08 = (spectrum.sel(restitution=c) for c in (0.5, 0.6, 0.8))
    upward = spectrum.sel(restitution=slice(0.5, 0.7))
    period, ratio, zeta = (
        at_06[name].values for name in ("period", "rotation_ratio", "amplification")
    )
    of_08 = upward.period.sel(width=0.8).values
    growth = (at_08.amplification / at_05.amplification)[0]
    by_size = (each.amplification.sel(slenderness=4.0).values for each in (at_05, at_08))
    limits = np.where(at_08.overturning_margin > 0, _SLENDERNESS[:, None], 0).max(axis=0)
    highest = float(spectrum.amplification.sel(slenderness=4.0, width=1.2, restitution=0.85))
    elastic = float(Oscillator(1.0, 0.05).amplification)
    return {
        "period_by_slenderness": _steps(period, 0),
        "period_growth": _range(period[-1] / period[0]),
        "period_and_size": _range(100 * (1 - period[:, -1] / period[:, 0])),
        "period_by_restitution": _steps(of_08, 1),
        "period_stocky": of_08[0, [0, -1]],
        "period_slender": of_08[-1, [0, -1]],
        "amplification_growth": _range(growth),
        "amplification_and_slenderness": 100 * (zeta[-1] / zeta[0] - 1).max(),
        "amplification_and_size": [100 * np.ptp(each) / each.min() for each in by_size],
        "margin": _range(at_06.overturning_margin),
        "limits": limits,
        "ratio_by_slenderness": _steps(ratio, 0),
        "ratio_by_size": _steps(ratio, 1),
        "ratio_by_restitution": _steps(upward.rotation_ratio.sel(width=1.2), 1),
        "ratio_power": _range(
            np.gradient(np.log(ratio), np.log(_SLENDERNESS), axis=0, edge_order=2)
        ),
        "amplifications": (highest, elastic, highest / elastic),
    }


def _of_the_map() -> dict[str, Any]:
    """Eq. 8, whose sum as printed stands beside its recursion, and Table III at C = 0.9."""
    scene = _scene(4.0, 1.2, 0.6)
    recursion = sum(0.6**j for j in range(5))
    fifth = float(resonance.half_cycle_velocity(scene, 5) / resonance.launch_velocity(scene))
    printed = recursion - 0.6**4
    scene = _scene(4.0, 1.2, 0.9)
    settled = resonance.stabilized_velocity(scene) / _LINEARIZED.critical_velocity(scene.block)
    velocity = resonance.half_cycle_velocity(scene, np.array([1.0, 30.0]))
    first, last = np.asarray(_LINEARIZED.peak_rotation(scene.block, velocity))
    return {
        "sums": (printed, recursion),
        "sum_share": (printed / recursion, fifth / recursion),
        "settled": settled,
        "overturns": resonance.overturning_half_cycle(scene),
        "last_amplification": last / first,
    }


def _of_damping() -> dict[str, Any]:
    """Eqs. 13, 18 and 22."""
    printed = float(resonance.equivalent_damping_as_printed(0.85))
    meant = float(resonance.equivalent_damping(0.85))
    elastic = float(resonance.damping_from_decay(0.85))
    oscillator = Oscillator(2 * math.pi, np.array([0.05, 0.17]))
    largest = oscillator.peak_displacement(1.0)
    return {
        "dampings": (printed, meant, elastic),
        "damping_ratios": (meant / printed, printed / elastic, meant / elastic),
        "psi": (Oscillator(1.0, 0.01).amplification, 1 / (1 - 0.97)),
        "excess": 100 * (largest / oscillator.quarter_cycle_displacement(1.0) - 1),
    }


def _of_linearizing() -> dict[str, Any]:
    """Compute what linearizing costs at slenderness 3, up to 0.9 of v_c and close to it."""
    block = Block(0.5, 3.0)
    critical, true = (float(model.critical_velocity(block)) for model in _MODELS)
    velocity = np.append(np.linspace(1e-3, 0.9, 200), 0.995) * critical
    peak, true_peak = (np.asarray(model.peak_rotation(block, velocity)) for model in _MODELS)
    time, true_time = (
        np.asarray(model.half_cycle_duration(block, velocity)) for model in _MODELS
    )
    peak = 100 * (1 - peak / true_peak)
    time = 100 * (1 - time / true_time)
    return {
        "short_peak": _range(peak[:-1]),
        "short_duration": _range(time[:-1]),
        "at_the_verge": (peak[-1], time[-1], 100 * (critical / true - 1)),
    }


def _range(values: Any) -> tuple[Any, Any]:
    return np.min(values), np.max(values)


def _steps(values: Any, axis: int) -> tuple[Any, Any]:
    """From one value to the next: above 0 where they rise, below 0 where they fall."""
    return _range(np.diff(values, axis=axis))
