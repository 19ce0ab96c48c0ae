"""Commands, by the JSON that they print, and the reports."""

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import jaxrock as jr
from jaxrock.reports import paper

from .table import group, run_command

# An error is a difference of rounding.
LEFT_OUT = ("error", "files", "reason", "record_source", "sizes")
SIZE = "--width 0.8 --slenderness 5 --restitution 0.7"
SLIM = "--width 0.2 --slenderness 5 --restitution 0.9"
SINE = "--pulse sine --pulse-duration 0.5"
GRID = "--slenderness 3:10:8 --width 0.4 1.2 --restitution 0.6 0.8"
# Sturdy blocks, whose boundaries under the record are not chaotic.
STURDY = "--width 0.8 --height 2.4 --restitution 0.5 --record example"
COLUMN = "--width 0.4 --height 1.6 --restitution 0.5 --records example"
# 1 and 2 Hz and 3 m/s2: over p, and over the amplitude that just lifts the block.
RATIO = 2 * np.pi / np.sqrt(0.75 * 9.81 / np.hypot(0.1, 0.5))
RATIOS = f"--frequency-ratio {RATIO} {2 * RATIO} --amplitude-ratio {3 / 1.962} --cycles 5"
FEW = "--restitution 0.5 --free-period 2 4 --slenderness 3"


def list_json(tree: Any, prefix: str) -> Iterator[tuple]:
    """List an answer in JSON: single numbers and words together, rows by their columns.

    Paths, sentences and names of dimensions are left out, and columns without any number.
    """
    if isinstance(tree, dict):
        told = {name: value for name, value in tree.items() if name not in LEFT_OUT}
        single = {name: value for name, value in told.items() if is_single(value)}
        if single:
            yield prefix, {name: fill_gap(value) for name, value in single.items()}
        for name in told.keys() - single.keys():
            yield from list_json(tree[name], f"{prefix}/{name}")
    elif tree and isinstance(tree[0], dict):
        for name in (name for name in tree[0] if name not in LEFT_OUT):
            yield from list_json([row[name] for row in tree], f"{prefix}/{name}")
    elif any(value is not None for value in tree):
        yield prefix, [fill_gap(value) for value in tree]


def is_single(value: Any) -> bool:
    return value is None or isinstance(value, str | int | float)


def fill_gap(value: Any) -> Any:
    """Null is a number that does not exist."""
    return np.nan if value is None else value


def run_all(**commands: str) -> Iterator[tuple]:
    with tempfile.TemporaryDirectory() as folder:
        for name, line in commands.items():
            writes = line.split()[0] not in ("assess", "critical")
            out = ("--out", Path(folder) / name) if writes else ()
            yield from list_json(run_command(*line.split(), *out), name)


def run_group(name: str, tolerance: float, by_default: bool = False, **commands: str) -> None:
    group(name, tolerance, by_default=by_default)(lambda: run_all(**commands))


run_group("commands/critical_pulse", 1e-9, by_default=True, sine=f"critical {SLIM} {SINE}")
run_group(
    "commands/closed",
    1e-10,
    assess_one_sided="assess --width 0.8 --height 4 --one-sided",
    critical=f"critical {SIZE} --half-cycles 1 5 inf",
)
run_group(
    "commands/closed_with_files",
    1e-9,
    spectrum=f"spectrum {GRID}",
    sensitivity=f"sensitivity {SIZE} --coefficient-of-variation 0.03 --answer rotation-ratio",
)
run_group(
    "commands/driven",
    1e-7,
    respond=f"respond {SLIM} {SINE} --amplitude 2.5",
    harmonic=f"harmonic {SLIM} {RATIOS}",
    outcomes=f"driven-sensitivity {SLIM} {SINE} --amplitude 2.5 --samples 64 --seed 1",
)
run_group(
    "commands/records",
    1e-6,
    respond=f"respond {STURDY}",
    rocking_spectrum=f"rocking-spectrum --record example {FEW}",
    fragility=f"fragility {COLUMN} --levels 0.3 0.6 1.2",
)


@group("commands/fit", 1e-5)
def answer_of_fits():
    ratios = 0.9 * 0.9 ** np.arange(11)
    times = np.cumsum(np.append(0.5, 2 / 3.8 * np.arctanh(ratios)))
    times = times + np.random.default_rng(12).normal(0, 1e-3, 12)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "times.csv"
        path.write_text("time [s]\n" + "".join(f"{time:.6f}\n" for time in times))
        answer = run_command("fit", path, "--out", Path(folder) / "out")
        yield from list_json(answer, "fit")


@group("reports/assess", 1e-10)
def assess():
    for model, restitution in (("settles", 0.7), ("overturns", 0.95)):
        yield from list_json(
            jr.reports.assess(jr.Block(0.4, 5.0), restitution, 0.15), f"{model}"
        )


@group("reports/paper", 1e-9)
def regenerate_paper():
    """The paper's tables and claims: what they print, what is computed, and the verdicts."""
    report = paper.regenerate()
    tables = {}
    for entry in report.entries:
        name = f"{entry['table']}/{entry['quantity']}".replace("Table ", "table_").replace(
            " ", "_"
        )
        tables.setdefault(name, []).append(entry)
    for name, entries in tables.items():
        for column in ("computed", "nonlinear", "agrees"):
            yield f"{name}/{column}", [entry[column] for entry in entries]
    for name in ("claims", "faults"):
        findings = getattr(report, name)
        for column in ("verdict", "figure"):
            yield f"{name}/{column}", [finding[column] for finding in findings]
