"""The paper regenerated: its tables, figures and claims, and where it errs.

C. Casapulla, On the Resonance Conditions of Rigid Rocking Blocks. What it prints is in
``data/paper.json``; everything else here is computed.
"""

import csv
import json
import math
from collections.abc import Iterator
from decimal import Decimal
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..block import Block
from ..resonance import (
    Linearized,
    Nonlinear,
    Oscillator,
    Scene,
    amplification,
    damping_from_decay,
    equivalent_damping,
    equivalent_damping_as_printed,
    half_cycle_velocity,
    launch_velocity,
    overturning_half_cycle,
    overturning_margin,
    rotation_ratio,
    stabilized_period,
    stabilized_velocity,
)
from ..spectra import resonance_spectrum

if TYPE_CHECKING:
    import xarray

SLENDERNESS = (3.0, 10.0)
WIDTHS = (0.4, 0.6, 0.8, 1.0, 1.2)
INTENSITY = 0.15
_LINEARIZED, _NONLINEAR = Linearized(), Nonlinear()


class Entry(NamedTuple):
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


class Finding(NamedTuple):
    """A claim or a fault of the paper, with the figure that it rests on."""

    where: str
    statement: str
    valid: bool
    figure: str


class Report(NamedTuple):
    """Everything that `jaxrock paper` compares."""

    entries: list[Entry]
    claims: list[Finding]
    faults: list[Finding]

    @property
    def mismatches(self) -> list[str]:
        """What disagrees without being a known fault, and known faults that do not show."""
        return [
            *(
                f"Table {entry.table}, {entry.quantity}, {entry.row}, {entry.column}:"
                f" printed {entry.printed}, computed {entry.computed:.6g}"
                for entry in self.entries
                if entry.agrees == bool(entry.fault)
            ),
            *(
                f"{finding.where}: {finding.statement} ({finding.figure})"
                for finding in (*self.claims, *self.faults)
                if not finding.valid
            ),
        ]


def regenerate() -> Report:
    """Recompute all that the paper states. Float64 is needed for the printed digits."""
    return Report(list(_entries()), list(_claims()), list(_faults()))


def printed_tables() -> dict:
    """The tables as printed, with their source."""
    return json.loads((files("jaxrock") / "data" / "paper.json").read_text(encoding="utf-8"))


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
            writer.writerow((*Entry._fields[1:], "agrees"))
            for entry in report.entries:
                if entry.table == table:
                    writer.writerow((*entry[1:], entry.agrees))
    curves, scene = figures(), _scene(3.0, 0.8, 0.7)
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


def _scene(slenderness, width, restitution) -> Scene:
    return Scene(Block(width / 2, slenderness), restitution, INTENSITY)


def _both(function) -> tuple[np.ndarray, np.ndarray]:
    return np.asarray(function(_LINEARIZED)), np.asarray(function(_NONLINEAR))


def _entries() -> Iterator[Entry]:
    tables = printed_tables()
    for key, numeral, method in (
        ("table_1", "I", "peak_rotation"),
        ("table_2", "II", "half_cycle_duration"),
    ):
        table = tables[key]
        slenderness = np.asarray(table["slenderness"], float)
        width = np.asarray(table["width"])[:, None]
        scene = Scene(Block(width / 2, slenderness[None]), 0.0, table["intensity"])
        velocity = launch_velocity(scene)
        values = _both(
            lambda model, name=method, scene=scene, velocity=velocity: getattr(model, name)(
                scene.block, velocity
            )
        )
        for i, row in enumerate(table["printed"]):
            for j, printed in enumerate(row):
                yield Entry(
                    numeral,
                    table["quantity"],
                    f"2b = {table['width'][i]} m",
                    f"lambda = {table['slenderness'][j]}",
                    printed,
                    float(values[0][i, j]),
                    float(values[1][i, j]),
                )
        if numeral == "II":
            linearized, nonlinear = (100 * (1 - value[-1] / value[0]) for value in values)
            for j, printed in enumerate(table["difference_percent"]):
                yield Entry(
                    numeral,
                    "difference from smallest to largest width [%]",
                    "all",
                    f"lambda = {table['slenderness'][j]}",
                    printed,
                    float(linearized[j]),
                    float(nonlinear[j]),
                )
    yield from _entries_of_table_3(tables["table_3"])


def _entries_of_table_3(table: dict) -> Iterator[Entry]:
    damping = np.asarray(table["xi"], float)
    decay = np.asarray(table["B"], float)
    restitution = np.asarray(table["C"], float)
    oscillator = Oscillator(1.0, damping)
    block = Block(table["width"] / 2, table["slenderness"])
    zeta = _both(lambda m: amplification(Scene(block, restitution, table["intensity"]), m))
    columns = {
        "B": (oscillator.velocity_decay, "elastic velocity decay, Eq. 18", "xi", None),
        "xi": (damping_from_decay(decay), "elastic damping ratio, Eq. 19", "B", None),
        "psi": (oscillator.amplification, "elastic amplification, Eqs. 18 and 23", "xi", None),
        "beta": (equivalent_damping_as_printed(restitution), "damping, Eq. 13", "C", None),
        "zeta": (zeta[0], "rocking amplification, Eqs. 6 and 12", "C", zeta[1]),
    }
    for name, (values, quantity, given, nonlinear) in columns.items():
        for i, printed in enumerate(table[name]):
            overturned = name == "zeta" and table["C"][i] == "0.9"
            yield Entry(
                "III",
                quantity,
                f"{given} = {table[given][i]}",
                name,
                printed,
                float(values[i]),
                math.nan if nonlinear is None else float(nonlinear[i]),
                "the block overturns" if overturned else "",
            )


def _claims() -> Iterator[Finding]:
    slenderness = np.linspace(*SLENDERNESS, 701)[:, None]
    first, last = SLENDERNESS
    scene = _scene(slenderness, np.asarray(WIDTHS)[None], 0.6)
    block = scene.block
    # Each quantity at once for all that is said of it: a shape of its own is compiled anew. What
    # is computed is looked at with NumPy, for the same reason.
    restitution = np.append(np.linspace(0.5, 0.7, 41), [0.8, 0.85])
    every = _scene(*np.meshgrid(slenderness, WIDTHS, restitution, indexing="ij", sparse=True))
    periods, zetas, margins, ratios = (
        np.asarray(quantity(every))
        for quantity in (stabilized_period, amplification, overturning_margin, rotation_ratio)
    )
    c_05, c_06, c_07, c_08, c_085 = 0, 20, 40, 41, 42
    slenderness_4, width_08, width_12 = 100, 2, 4
    launch = np.asarray(launch_velocity(scene))
    double = np.asarray(launch_velocity(Scene(block, 0.6, 2 * INTENSITY)))
    yield Finding(
        "Eq. 2",
        "the launch velocity is proportional to I and falls with size and slenderness",
        bool(np.allclose(double, 2 * launch, rtol=1e-12) & _falls(launch, 0) & _falls(launch, 1)),
        f"from {launch[0, 0]:.4f} to {launch[-1, -1]:.4f} rad/s over the paper's grid",
    )
    peak = np.asarray(_LINEARIZED.peak_rotation(block, launch))
    growth = peak[-1] / peak[0] - 1
    yield Finding(
        "Table I",
        "the peak after one pulse falls with size and rises slightly with slenderness",
        bool(_falls(peak, 1) & _rises(peak, 0) & np.all(growth < 0.15)),
        f"by at most {100 * growth.max():.1f} % from slenderness {first:g} to {last:g}",
    )
    duration = np.asarray(_LINEARIZED.half_cycle_duration(block, launch))
    size_effect = 1 - duration[:, -1] / duration[:, 0]
    yield Finding(
        "Table II",
        "the half-cycle rises with slenderness and hardly depends on size, at most by 1.97 %",
        bool(_rises(duration, 0) & (np.round(100 * size_effect.max(), 2) == 1.97)),
        f"size changes it by at most {100 * size_effect.max():.2f} %",
    )
    period = periods[..., c_06]
    size_effect = 1 - period[:, -1] / period[:, 0]
    rise = period[-1] / period[0]
    yield Finding(
        "Fig. 3",
        "the stabilized period rises sharply with slenderness and hardly depends on size",
        bool(_rises(period, 0) & np.all(rise > 3) & np.all(size_effect < 0.2)),
        f"{rise.min():.2f} to {rise.max():.2f} times from slenderness {first:g} to {last:g};"
        f" size changes it by {100 * size_effect.min():.1f} to {100 * size_effect.max():.1f} %",
    )
    period = periods[:, width_08, : c_07 + 1]
    yield Finding(
        "Fig. 5",
        "the stabilized period rises with C",
        _rises(period, 1),
        f"from {period[0, 0]:.3f} to {period[0, -1]:.3f} s at slenderness {first:g}"
        f" for C from 0.5 to 0.7, from {period[-1, 0]:.3f} to {period[-1, -1]:.3f} s at {last:g}",
    )
    zeta_of_c = zetas[0][:, [c_05, c_08]]
    zeta = zetas[..., c_06]
    slenderness_effect = zeta[-1] / zeta[0] - 1
    low, high = (zetas[slenderness_4, :, c] for c in (c_05, c_08))
    yield Finding(
        "Fig. 4",
        "the amplification rises sharply with C, hardly depends on slenderness, and on size"
        " slightly where C is large",
        bool(
            np.all(zeta_of_c[:, 1] > 6 * zeta_of_c[:, 0])
            & np.all(slenderness_effect < 0.15)
            & (np.ptp(low) / low.min() < 0.02)
            & (np.ptp(high) / high.min() > np.ptp(low) / low.min())
        ),
        f"{(zeta_of_c[:, 1] / zeta_of_c[:, 0]).min():.1f} times from C = 0.5 to 0.8;"
        f" slenderness changes it by at most {100 * slenderness_effect.max():.1f} % at C = 0.6;"
        f" size by {100 * np.ptp(low) / low.min():.1f} % at C = 0.5"
        f" and {100 * np.ptp(high) / high.min():.0f} % at C = 0.8 (slenderness 4)",
    )
    margin = margins[..., c_06]
    yield Finding(
        "Fig. 6",
        "for C = 0.6 every block reaches the stabilized phase",
        bool(np.all(margin > 0)),
        f"smallest margin {margin.min():.3f}",
    )
    stands = margins[..., c_08] > 0
    limits = [float(np.where(stands[:, i], slenderness[:, 0], 0).max()) for i in range(5)]
    yield Finding(
        "Fig. 8",
        "for C = 0.8 the width 0.6 m reaches it up to slenderness 7, and only widths above"
        " 0.8 m reach it up to 10",
        math.floor(limits[1]) == 7 and max(limits[:3]) < 10 and min(limits[3:]) == 10,
        "up to slenderness "
        + ", ".join(f"{lim:.2f} ({w} m)" for lim, w in zip(limits, WIDTHS, strict=True)),
    )
    ratio = ratios[..., c_06]
    elasticity = np.asarray(_elasticity_to_slenderness(scene, ratio.shape))
    of_c = ratios[:, width_12, : c_07 + 1]
    yield Finding(
        "Figs. 6 to 8",
        "the rotation ratio rises as size falls, almost in proportion to slenderness, and with C",
        bool(
            _falls(ratio, 1)
            & _rises(ratio, 0)
            & _rises(of_c, 1)
            & np.all((elasticity > 0.95) & (elasticity < 1.5))
        ),
        f"it goes as slenderness to the power {elasticity.min():.2f} to {elasticity.max():.2f}"
        " at C = 0.6",
    )
    zeta_085 = zetas[slenderness_4, width_12, c_085]
    psi = float(Oscillator(1.0, 0.05).amplification)
    yield Finding(
        "Table III",
        "at about 5 % of damping the block amplifies 52 times, nearly eight times as much as"
        " the oscillator",
        bool((np.round(zeta_085) == 52) & (np.round(psi, 2) == 6.87) & (zeta_085 / psi > 7)),
        f"{zeta_085:.2f} against {psi:.2f}, {zeta_085 / psi:.2f} times",
    )


def _faults() -> Iterator[Finding]:
    # Eq. 8: the sum as printed, against the recursion printed beside it.
    scene = _scene(4.0, 1.2, 0.6)
    first = float(launch_velocity(scene))
    recursion = first
    for _ in range(4):
        recursion = 0.6 * recursion + first
    printed = first * ((1 + sum(0.6**j for j in range(1, 5))) - 0.6**4)
    ours = float(half_cycle_velocity(scene, 5))
    yield Finding(
        "Eq. 8",
        "the closed sum lacks its last power of C; the limit is not affected",
        bool(np.isclose(ours, recursion, rtol=1e-12) & (printed < 0.96 * recursion)),
        f"half-cycle 5 at C = 0.6: printed sum {printed / first:.4f}, recursion"
        f" {recursion / first:.4f} times the first velocity",
    )
    scene = _scene(4.0, 1.2, 0.9)
    block = scene.block
    ratio = float(stabilized_velocity(scene)) / float(_LINEARIZED.critical_velocity(block))
    half_cycle = float(overturning_half_cycle(scene))
    velocity = half_cycle_velocity(scene, np.asarray([30.0, 1.0]))
    peak = np.asarray(_LINEARIZED.peak_rotation(block, velocity))
    yield Finding(
        "Table III, C = 0.9",
        "the block overturns; the amplification printed is that of the last half-cycle it"
        " survives, not a stabilized one",
        bool((ratio > 1) & (half_cycle == 31) & (abs(peak[0] / peak[1] - 182.37) < 0.5)),
        f"v*/v_c = {ratio:.4f}, overturns in half-cycle {half_cycle:.0f}, amplification"
        f" {peak[0] / peak[1]:.2f} in half-cycle 30, printed 182.37",
    )
    printed, meant, elastic = (
        float(damping(0.85))
        for damping in (equivalent_damping_as_printed, equivalent_damping, damping_from_decay)
    )
    yield Finding(
        "Eq. 13",
        "the source fits the ratio of kinetic energies, C squared; as printed, with C, the"
        " damping is half of what is meant, and only so comes close to Eq. 19",
        bool(np.isclose(meant, 2 * printed) & (printed < 1.1 * elastic) & (meant > 2 * elastic)),
        f"C = 0.85: {printed:.4f} as printed, {meant:.4f} as meant, Eq. 19 gives {elastic:.4f}",
    )
    table = printed_tables()["table_3"]
    index = table["xi"].index("0.01")
    from_damping = float(Oscillator(1.0, 0.01).amplification)
    from_decay = 1 / (1 - float(table["B"][index]))
    yield Finding(
        "Table III, psi",
        "computed from the damping through the exact Eq. 18, not from the rounded B beside it",
        bool((np.round(from_damping, 2) == 32.33) & (abs(from_decay - 32.33) > 0.5)),
        f"xi = 0.01: {from_damping:.2f} from xi, {from_decay:.2f} from B = 0.97, printed 32.33",
    )
    oscillator = Oscillator(2 * math.pi, np.asarray([0.05, 0.17]))
    largest, at_quarter = (
        np.asarray(displacement(1.0))
        for displacement in (oscillator.peak_displacement, oscillator.quarter_cycle_displacement)
    )
    excess = largest / at_quarter - 1
    yield Finding(
        "Eq. 22",
        "the displacement at a quarter of the damped period, not the largest, which comes"
        " earlier; the ratio (Eq. 23) is not affected",
        bool(np.all(excess > 0)),
        f"the maximum is {100 * excess[0]:.3f} % larger at xi = 0.05, {100 * excess[1]:.2f} %"
        " at 0.17",
    )
    block = Block(0.5, 3.0)
    critical, true_critical = _both(lambda model: model.critical_velocity(block))
    # Up to 0.9 of the critical velocity, then close to it.
    speed = np.append(np.linspace(1e-3, 0.9, 200), 0.995) * critical
    peak, true_peak = _both(lambda model: model.peak_rotation(block, speed))
    duration, true_duration = _both(lambda model: model.half_cycle_duration(block, speed))
    short_peak, short_duration = 100 * (1 - peak / true_peak), 100 * (1 - duration / true_duration)
    excess = 100 * (critical / true_critical - 1)
    ranges = [
        (float(short[:-1].min()), float(short[:-1].max())) for short in (short_peak, short_duration)
    ]
    (low_peak, high_peak), (low_duration, high_duration) = ranges
    yield Finding(
        "Eq. 4, slenderness 3",
        "a size rather than a fault: what linearizing costs at the limit given for it, where"
        " the critical velocity is on the unsafe side",
        bool(
            min(low_peak, low_duration) > 1.5
            and max(high_peak, high_duration) < 1.95
            and round(float(short_peak[-1]), 1) == 6.5
            and round(float(short_duration[-1])) == 25
            and round(float(excess), 2) == 0.43
        ),
        f"peak {low_peak:.2f} to {high_peak:.2f} % and duration {low_duration:.2f} to"
        f" {high_duration:.2f} % too small up to 0.9 v_c, {short_peak[-1]:.1f} and"
        f" {short_duration[-1]:.0f} % at 0.995 v_c; critical velocity {excess:.2f} % too large",
    )


def _elasticity_to_slenderness(scene: Scene, shape: tuple[int, ...]) -> Array:
    def logarithm(log_slenderness):
        block = Block(scene.block.half_width, jnp.exp(log_slenderness))
        return jnp.log(rotation_ratio(Scene(block, scene.restitution, scene.intensity)))

    at = np.log(np.broadcast_to(scene.block.slenderness, shape))
    return jax.jvp(logarithm, (at,), (np.ones_like(at),))[1]


def _rises(values: np.ndarray, axis: int) -> bool:
    return bool(np.all(np.diff(values, axis=axis) > 0))


def _falls(values: np.ndarray, axis: int) -> bool:
    return _rises(-values, axis)


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
