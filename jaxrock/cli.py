"""The command line: ``jaxrock assess``, ``jaxrock spectrum``, ``jaxrock paper``."""

import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import jax
import tyro

_Grid = tuple[str, ...]
_Model = Literal["linearized", "nonlinear"]
_Force = Annotated[bool, tyro.conf.FlagCreatePairsOff]
_Json = Annotated[bool, tyro.conf.FlagCreatePairsOff, tyro.conf.arg(name="json")]


def assess(
    width: float = 0.8,
    height: float | None = None,
    slenderness: float | None = None,
    restitution: float | None = None,
    intensity: float = 0.15,
    gravity: float = 9.81,
    as_json: _Json = False,
) -> None:
    """Assess one block under pulses timed to its impacts.

    Geometry, the response to one pulse, the stabilized phase or the half-cycle in which the
    block overturns, critical pulse intensities and sensitivities, by the linearized and the
    nonlinear equation side by side.

    Example: jaxrock assess --width 0.8 --height 4 --restitution 0.7

    Args:
        width: Full width 2b of the base [m].
        height: Full height 2a [m]. Give this or the slenderness.
        slenderness: Height over width [-]. 5 if neither is given.
        restitution: Velocity after an impact over velocity before it [-], 0 to 1.
            Housner's value for the block if not given.
        intensity: Change of ground velocity in each pulse [m/s].
        gravity: Acceleration of gravity [m/s2].
        as_json: Print JSON; null stands for what does not exist or never happens.
    """
    from . import assessment
    from .arguments import POSITIVE, check
    from .block import Block, housner_restitution
    from .resonance import Scene

    check("width", width, POSITIVE)
    if height is not None and slenderness is not None:
        raise ValueError("height and slenderness exclude each other, got both")
    if height is not None:
        block = Block.from_size(width, height, gravity)
    else:
        block = Block(width / 2, 5.0 if slenderness is None else slenderness, gravity)
    if restitution is None:
        restitution = float(housner_restitution(block))
        if restitution < 0:
            raise ValueError(
                f"restitution must be given for a block this stocky: Housner's is"
                f" {restitution:.3g}, and it must be between 0 and 1"
            )
    result = assessment.assess(Scene(block, restitution, intensity))
    print(_dumps(result) if as_json else assessment.text(result))


def spectrum(
    out: Path = Path("spectrum"),
    slenderness: _Grid = ("3:10:141",),
    width: _Grid = ("0.4", "0.6", "0.8", "1.0", "1.2"),
    restitution: _Grid = ("0.6", "0.7", "0.8"),
    intensity: _Grid = ("0.15",),
    gravity: float = 9.81,
    model: _Model = "linearized",
    force: _Force = False,
    as_json: _Json = False,
) -> None:
    """Resonance spectra over a grid of blocks, as NetCDF, CSV and a picture.

    Writes spectrum.nc, spectrum.csv and spectrum.png. Values of the grid are given one by
    one, or as START:STOP:COUNT.

    Example: jaxrock spectrum --slenderness 3:10:15 --width 0.4 0.8 --restitution 0.7

    Args:
        out: Folder to write to; made if it is missing.
        slenderness: Height over width [-].
        width: Full widths 2b of the base [m].
        restitution: Coefficients of restitution [-], 0 to 1.
        intensity: Change of ground velocity in each pulse [m/s].
        gravity: Acceleration of gravity [m/s2].
        model: Equation of free rocking between the impacts.
        force: Overwrite existing files.
        as_json: Print the list of files and the size of the grid as JSON.
    """
    from .files import written_whole
    from .free import Linearized, Nonlinear
    from .spectra import overturned_share, resonance_spectrum, write_table

    grid: dict[str, Any] = {
        "slenderness": _values("slenderness", slenderness),
        "width": _values("width", width),
        "restitution": _values("restitution", restitution),
        "intensity": _values("intensity", intensity),
    }
    if len(grid["intensity"]) == 1:
        grid["intensity"] = grid["intensity"][0]
    rung = Nonlinear() if model == "nonlinear" else Linearized()
    names = ("spectrum.nc", "spectrum.csv", "spectrum.png")
    with written_whole("out", out, names, force) as scratch:
        store = scratch / names[0]
        with resonance_spectrum(**grid, model=rung, gravity=gravity, store=store) as dataset:
            write_table(dataset, scratch / names[1])
            _plot_spectrum(dataset, scratch / names[2])
            sizes = {str(name): size for name, size in dataset.sizes.items()}
            overturned = overturned_share(dataset)
    written = [str(out / name) for name in names]
    if as_json:
        summary = {"files": written, "sizes": sizes, "model": model, "overturned": overturned}
        print(_dumps(summary))
    else:
        print(f"{math.prod(sizes.values())} scenes, {100 * overturned:.1f} % of them overturn")
        print("\n".join(written))


def paper(
    out: Path = Path("paper"),
    force: _Force = False,
    as_json: _Json = False,
) -> None:
    """Regenerate the paper's tables and figures and compare them with what it prints.

    Writes report.md, the tables as CSV and Figs. 3 to 8 as PNG. Exits with 1 if anything
    disagrees that is not a known fault of the paper.

    Args:
        out: Folder to write to; made if it is missing.
        force: Overwrite existing files.
        as_json: Print the outcome as JSON.
    """
    from . import paper as regenerated
    from .files import written_whole

    with written_whole("out", out, regenerated.FILES, force) as scratch:
        report = regenerated.regenerate()
        regenerated.write(report, scratch)
    agreeing = sum(entry.agrees for entry in report.entries)
    if as_json:
        outcome = {
            "printed": len(report.entries),
            "agreeing": agreeing,
            "known_faults_in_tables": sum(bool(entry.fault) for entry in report.entries),
            "claims_that_hold": sum(claim.holds for claim in report.claims),
            "claims": len(report.claims),
            "faults_reproduced": sum(fault.holds for fault in report.faults),
            "faults": len(report.faults),
            "mismatches": report.mismatches,
            "files": [str(out / name) for name in regenerated.FILES],
        }
        print(_dumps(outcome))
    else:
        print(regenerated.summary(report))
        for line in report.mismatches:
            print(f"mismatch: {line}")
        print(out / "report.md")
    if report.mismatches:
        raise SystemExit(1)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command; an argument that is not allowed ends it with exit code 2."""
    jax.config.update("jax_enable_x64", True)
    try:
        tyro.extras.subcommand_cli_from_dict(
            {"assess": assess, "spectrum": spectrum, "paper": paper},
            prog="jaxrock",
            description="Rocking of rigid blocks: will it rock, how far, and what overturns it.",
            args=arguments,
        )
    except ValueError as error:
        print(f"jaxrock: error: {error}", file=sys.stderr)
        raise SystemExit(2) from None


def _values(name: str, given: _Grid) -> list[float]:
    import numpy as np

    values: list[float] = []
    for word in given:
        parts = word.split(":")
        try:
            if len(parts) == 3 and int(parts[2]) > 0:
                start, stop = float(parts[0]), float(parts[1])
                if not math.isfinite(start) or not math.isfinite(stop):
                    raise ValueError
                values += np.linspace(start, stop, int(parts[2])).tolist()
            elif len(parts) == 1:
                values.append(float(word))
            else:
                raise ValueError
        except ValueError:
            raise ValueError(f"{name} must be numbers or START:STOP:COUNT, got {word!r}") from None
    return values


def _plot_spectrum(dataset: Any, path: Path) -> None:
    import matplotlib

    matplotlib.use("agg")
    from .plot import plot_spectrum

    plot_spectrum(dataset).savefig(path, dpi=150)


def _dumps(value: Any) -> str:
    def plain(item: Any) -> Any:
        if isinstance(item, dict):
            return {key: plain(inner) for key, inner in item.items()}
        if isinstance(item, list):
            return [plain(inner) for inner in item]
        return None if isinstance(item, float) and not math.isfinite(item) else item

    return json.dumps(plain(value), indent=2, allow_nan=False)
