"""The paper recomputed by public functions: its tables, figures and claims, and its faults.

C. Casapulla, On the Resonance Conditions of Rigid Rocking Blocks. What it prints and claims, the
numbers that this is about, and the bounds that judge them are in ``data/paper.json``.
"""

import csv
import inspect
import itertools
import json
from collections import Counter
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .. import resonance
from ..block import Block
from ..resonance import Scene, as_model
from ..spectra import resonance_spectrum

PRINTED = json.loads((files("jaxrock") / "data" / "paper.json").read_text(encoding="utf-8"))
FILES = ("report.md", *PRINTED["files"], *PRINTED["figures"])
_NOT_CONFIRMED = "not confirmed"
_GRID = {
    "intensity": 0.15,
    "width": [0.4, 0.6, 0.8, 1.0, 1.2],
    "slenderness": np.linspace(3.0, 10.0, 701),
}


class Report(NamedTuple):
    """Rows of what the paper prints, claims and errs in, with what is computed."""

    entries: list[dict[str, Any]]
    claims: list[dict[str, str]]
    faults: list[dict[str, str]]

    def summarize(self) -> dict[str, Any]:
        """Count what agrees, and list mismatches: also known faults that do not show."""
        findings = [*self.claims, *self.faults]
        mismatches = [row for row in self.entries if row["agrees"] == bool(row["fault"])]
        mismatches += [row for row in findings if row["verdict"] == _NOT_CONFIRMED]
        return {
            "printed": len(self.entries),
            "agreeing": sum(row["agrees"] for row in self.entries),
            "known_faults_in_tables": sum(bool(row["fault"]) for row in self.entries),
            "claims": Counter(row["verdict"] for row in self.claims),
            "faults": Counter(row["verdict"] for row in self.faults),
            "mismatches": [", ".join(map(str, row.values())) for row in mismatches],
        }

    def __str__(self) -> str:
        count = self.summarize()
        lines = [f"{count['agreeing']} of {count['printed']} printed numbers agree."]
        for name in ("claims", "faults"):
            verdicts = (f"{verdict} ({number})" for verdict, number in count[name].items())
            lines.append(f"{name.capitalize()}: {', '.join(verdicts)}.")
        return "\n".join(lines + [f"mismatch: {row}" for row in count["mismatches"]])


def regenerate() -> Report:
    """Compute anew all that the paper states. Float64 is needed for the printed digits."""
    entries = [entry for table in PRINTED["tables"] for entry in compare(table)]
    claims, faults = ([judge(claim) for claim in PRINTED[key]] for key in ("claims", "faults"))
    return Report(entries, claims, faults)


def compare(table: dict[str, Any]) -> list[dict[str, Any]]:
    """Compare the numbers of a table with the computed ones, to the digits printed."""
    texts = np.ravel(table["printed"])
    printed = np.char.replace(texts, "overturning", "nan").astype(float)
    computed = compute(table).ravel()
    # Right is the computed number, rounded.
    agrees = np.isclose(computed, printed, rtol=0, atol=0.5 * table["unit"], equal_nan=True)
    # The same without linearizing, where a block is involved.
    nonlinear = np.nan * computed
    if "model" in table:
        nonlinear = compute({**table, "model": "nonlinear"}).ravel()
    places = itertools.product(table["rows"], table["columns"])
    return [
        {
            "table": table["table"],
            "quantity": table["title"],
            "row": row,
            "column": column,
            "printed": str(texts[k]),
            "computed": float(computed[k]),
            "nonlinear": float(nonlinear[k]),
            "fault": PRINTED["known"].get(f"{table['table']}, {row}, {column}", ""),
            "agrees": bool(agrees[k]),
        }
        for k, (row, column) in enumerate(places)
    ]


def judge(claim: dict[str, Any]) -> dict[str, str]:
    """Judge a claim or a fault by its numbers, which its figure shows.

    Those with bounds "within" have to be within them. Those with bounds "beyond" have not to be:
    a claim that held for them too would have no limit, and its verdict were wrong.
    """
    row = {key: claim[key] for key in ("where", "what", "verdict")}
    ranges = {}
    for name, number in claim["numbers"].items():
        numbers = compute(number)
        ranges[name] = np.array([np.nanmin(numbers), np.nanmax(numbers)])
        # A bound that is missing is NaN, to which every comparison is false.
        low, high = np.array(number.get("within", number.get("beyond", [None, None])), float)
        outside = ~np.isfinite(ranges[name]) | (ranges[name] <= low) | (ranges[name] >= high)
        if outside.any() != ("beyond" in number):
            row["verdict"] = _NOT_CONFIRMED
    return row | {"figure": claim["figure"].format_map(ranges)}


def compute(number: dict[str, Any]) -> np.ndarray:
    """Compute a quantity as ``data/paper.json`` describes it: a function and its arguments.

    It is divided by the one "over" which it stands, or its "change" [%] against one is taken:
    both are described by what differs. "steps" are those along an axis, a "power" is the one by
    which it goes with slenderness.
    """
    grid = _GRID | {"restitution": 0.6, "half_cycle": 1.0} | number.get("at", {})
    arguments: dict[str, Any] = dict(
        zip(grid, np.meshgrid(*grid.values(), indexing="ij"), strict=True)
    )
    block = Block(arguments["width"] / 2, arguments["slenderness"])
    scene = Scene(block, arguments["restitution"], arguments["intensity"])
    velocity = resonance.half_cycle_velocity(scene, arguments["half_cycle"])
    model = as_model(number.get("model", "linearized"))
    arguments |= {"block": block, "scene": scene, "velocity": velocity, "model": model}
    quantity = number["quantity"]
    owners = (model, resonance, resonance.elastic_oscillator)
    function = next(getattr(owner, quantity) for owner in owners if hasattr(owner, quantity))
    names = inspect.signature(function).parameters
    numbers = np.asarray(function(**{n: arguments[n] for n in names if n in arguments}))
    same = {"quantity": quantity, "model": model}
    if "over" in number:
        return numbers / compute(same | number["over"])
    if "change" in number:
        return 100 * abs(numbers / compute(same | number["change"]) - 1)
    if "steps" in number:
        return np.diff(numbers, axis=list(grid).index(number["steps"]))
    if "power" in number:
        # The derivative of one logarithm with respect to the other.
        return np.gradient(np.log(numbers), np.log(grid["slenderness"]), axis=2, edge_order=2)
    return numbers


def write(report: Report, folder: Path) -> None:
    """Write `FILES` into an existing folder: the report, the tables and the figures."""
    # It loads slowly, and to compare numbers needs no pictures.
    import matplotlib.pyplot as plt

    from ..plot import plot_curves, plot_resonance

    lines = [
        "# On the Resonance Conditions of Rigid Rocking Blocks, recomputed",
        "",
        str(report),
    ]
    for title, rows in (("Claims", report.claims), ("Faults", report.faults)):
        table = [list(rows[0]), ["---"] * len(rows[0]), *(row.values() for row in rows)]
        lines += ["", f"## {title}", "", *(f"| {' | '.join(row)} |" for row in table)]
    for name, numeral in PRINTED["files"].items():
        rows = [entry for entry in report.entries if entry["table"] == numeral]
        with open(folder / name, "w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, rows[0])
            writer.writeheader()
            writer.writerows(rows)
        lines += ["", f"[{numeral}]({name})"]
    spectrum = resonance_spectrum(**_GRID, restitution=np.arange(50, 85, 5) / 100)
    for name, figure in PRINTED["figures"].items():
        drawing, ax = plt.subplots(figsize=(5.5, 4), layout="constrained")
        if "at" in figure:
            plot_curves(spectrum[figure["variable"]].sel(figure["at"]), figure["hue"], ax=ax)
        else:
            plot_resonance(Scene(Block(0.4, 3.0), 0.7, _GRID["intensity"]), ax=ax)
        ax.set_title(figure["title"])
        drawing.savefig(folder / name, dpi=150)
        # pyplot keeps every figure until it is closed.
        plt.close(drawing)
        lines += ["", f"![{figure['title']}]({name})"]
    (folder / "report.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
