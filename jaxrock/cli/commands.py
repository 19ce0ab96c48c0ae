"""Commands about many blocks, measured trade-offs and tables; all commands by name."""

import functools
import math
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from ..accuracy import make_default_scene, measure_tradeoff
from ..block import RECTANGLE_INERTIA_RATIO
from ..driven import DrivenScene
from ..grids import as_axis, compute_overturned_fraction, write_table
from ..reports import paper
from ..resonance import Scene
from ..spectra import RESONANCE_AXES, resonance_spectrum, rocking_spectrum
from ..validation import AT_LEAST_ONE, POSITIVE, check
from .command import Answer, Command, Count, Folder, Grid, Steps, Writing, save_picture
from .critical import Critical
from .dependence import Sensitivity
from .harmonic import HarmonicFloor
from .inventory import AssessInventory
from .measurements import Fit
from .one_block import Assess, Respond
from .options import BlockOptions, MotionOptions, RecordOptions
from .storing import Storing
from .suites import Fragility

if TYPE_CHECKING:
    import xarray


class Spectrum(Storing):
    """Resonance spectra over a grid of blocks, as NetCDF, CSV and a picture.

    Writes spectrum.nc, spectrum.csv and spectrum.png. Values of the grid are given one by
    one, or as START:STOP:COUNT. A grid too large for that goes to a Zarr store.

    Example: jaxrock spectrum --slenderness 3:10:15 --width 0.4 0.8 --restitution 0.7
    """

    command = "spectrum"

    slenderness: Grid = ("3:10:141",)
    """Height over width [-]."""
    width: Grid = (0.4, 0.6, 0.8, 1.0, 1.2)
    """Full widths 2b of the base [m]."""
    restitution: Grid = (0.6, 0.7, 0.8)
    """Coefficients of restitution [-], 0 to 1."""
    intensity: Grid = (0.15,)
    """Change of ground velocity in each pulse [m/s]."""
    gravity: float = 9.81
    """Acceleration of gravity [m/s2]."""
    inertia_ratio: float = RECTANGLE_INERTIA_RATIO
    """Moment of inertia about an edge over m R^2 [-], at least 1; 4/3 for a rectangle."""
    model: Literal["linearized", "nonlinear", "auto"] = "linearized"
    """Equation of free rocking; auto takes at each point the cheapest within the tolerance."""
    tolerance: float = 1e-3
    """Relative error that is allowed; for the model auto."""
    out: Folder = Path("spectrum")

    def _carry_out(self) -> Steps:
        *axes, intensity = (as_axis(name, self.read_numbers(name)) for name in RESONANCE_AXES)
        check("gravity", self.gravity, POSITIVE)
        check("inertia_ratio", self.inertia_ratio, AT_LEAST_ONE)
        check("tolerance", self.tolerance, POSITIVE)
        if self.model != "auto":
            self.refuse("tolerance", only_with="the model auto")
        compute = functools.partial(
            resonance_spectrum,
            *axes,
            intensity[0] if len(intensity) == 1 else intensity,  # a single one is no dimension
            model=self.model,
            tolerance=self.tolerance,
            gravity=self.gravity,
            inertia_ratio=self.inertia_ratio,
        )
        if self.store:
            # Nothing is computed yet, but chunks that are wrong are found by the check.
            lazy = compute(chunks=self.lengths)
            yield ()
            return self.write_store(
                lazy,
                lambda found: self._make_answer(
                    found, _compute_share(found.overturning_margin <= 0)
                ),
            )
        folder = yield "spectrum.nc", "spectrum.csv", "spectrum.png"
        from ..plot import plot_spectrum

        # Into the file, part by part: a large grid need not fit into memory.
        with compute(store=folder / "spectrum.nc") as dataset:
            write_table(dataset, folder / "spectrum.csv")
            save_picture(plot_spectrum(dataset), folder / "spectrum.png")
            return self._make_answer(dataset, compute_overturned_fraction(dataset))

    def _make_answer(self, dataset: "xarray.Dataset", overturned: float) -> Answer:
        """Say how many scenes there are and which share of them overturns."""
        sizes = {str(name): size for name, size in dataset.sizes.items()}
        return Answer(
            f"{math.prod(sizes.values())} scenes, {100 * overturned:.1f} % of them overturn",
            {"sizes": sizes, "model": self.model, "overturned": overturned},
        )


def _compute_share(true: "xarray.DataArray") -> float:
    """Compute the share of truths in an array, by Dask if it is lazy."""
    return float(true.mean())


class RockingSpectrum(RecordOptions, Storing):
    """Rocking spectrum of a record: peak rotation over the size of the block.

    Writes rocking_spectrum.nc, .csv and .png.

    Example: jaxrock rocking-spectrum --record example --scale 1.5
    """

    command = "rocking-spectrum"

    record: str | None = "example"
    period: Grid = ("1:4:241", "4.05:8:80")
    """2 pi / p of the blocks [s]."""
    slenderness: Grid = (4.0, 6.0, 8.0)
    """Height over width [-]."""
    restitution: Grid = (0.9,)
    """Velocity after an impact over velocity before it [-]."""
    inertia_ratio: float = RECTANGLE_INERTIA_RATIO
    """Moment of inertia about an edge over m R^2 [-], at least 1; 4/3 for a rectangle."""
    out: Folder = Path("rocking_spectrum")

    def _carry_out(self) -> Steps:
        motion = self.motion
        grid = [
            as_axis(n, self.read_numbers(n)) for n in ("period", "slenderness", "restitution")
        ]
        check("inertia_ratio", self.inertia_ratio, AT_LEAST_ONE)
        ratio = self.inertia_ratio
        if self.store:
            lazy = rocking_spectrum(motion, *grid, inertia_ratio=ratio, chunks=self.lengths)
            yield ()
            return self.write_store(lazy, self._make_answer)
        folder = yield [f"rocking_spectrum.{kind}" for kind in ("nc", "csv", "png")]
        from ..plot import plot_rocking_spectrum

        dataset = rocking_spectrum(motion, *grid, inertia_ratio=ratio)
        dataset = dataset.assign_attrs(self.about)
        dataset.to_netcdf(folder / "rocking_spectrum.nc")
        write_table(dataset, folder / "rocking_spectrum.csv")
        save_picture(plot_rocking_spectrum(dataset), folder / "rocking_spectrum.png")
        return self._make_answer(dataset)

    def _make_answer(self, dataset: "xarray.Dataset") -> Answer:
        """Say how many blocks there are and which share of them overturns."""
        share = 100 * _compute_share(dataset.overturned)
        return Answer(
            f"{dataset.overturned.size} blocks, {share:.1f} % of them overturn",
            {"sizes": {str(name): size for name, size in dataset.sizes.items()}},
        )


class MeasureTradeoff(MotionOptions, BlockOptions, Writing):
    """Speed against accuracy on this machine: every dial turned, errors and times measured.

    Of a block under a pulse or a record, with --intensity under the pulses of resonance, by
    default under a short half-sine pulse. Writes tradeoff.nc, tradeoff.csv and tradeoff.png.

    Example: jaxrock tradeoff --record example
    """

    command = "tradeoff"

    intensity: float | None = None
    """Change of ground velocity in each instantaneous pulse [m/s]."""
    repeats: Count = 15
    """Number of times each setting is timed."""
    out: Folder = Path("tradeoff")

    def _carry_out(self) -> Steps:
        if self.repeats < 1:
            raise ValueError(f"repeats must be at least 1, got {self.repeats}")
        if self.shaken and self.intensity is not None:
            raise ValueError("intensity excludes a pulse or a record")
        # Without anything that shakes it the block gets the pulse of the default scene.
        block = self.block
        c = self.coefficient
        if self.intensity is not None:
            scene = Scene(block, c, self.intensity)
        else:
            scene = DrivenScene(
                block, c, self.motion if self.shaken else make_default_scene().motion
            )
        folder = yield "tradeoff.nc", "tradeoff.csv", "tradeoff.png"
        from ..plot import plot_tradeoff

        tradeoff = measure_tradeoff(scene, repeats=self.repeats)
        dataset = tradeoff.dataset.assign_attrs(self.about)
        dataset.to_netcdf(folder / "tradeoff.nc")
        write_table(dataset, folder / "tradeoff.csv")
        save_picture(plot_tradeoff(tradeoff.dataset), folder / "tradeoff.png")
        data = {"sentence": tradeoff.sentence(), "notes": tradeoff.notes()}
        return Answer(
            str(tradeoff), {"rows": dataset.to_dataframe().to_dict("records"), **data}
        )


class Paper(Writing):
    """Regenerate the paper's tables and figures and compare them with what it prints.

    Writes report.md, the tables as CSV and the figures as PNG. Exits with 1 if anything
    disagrees that is not a known fault of the paper.

    Example: jaxrock paper --out paper
    """

    command = "paper"

    out: Folder = Path("paper")

    def _carry_out(self) -> Steps:
        folder = yield paper.FILES
        report = paper.regenerate()
        paper.write(report, folder)
        data = {
            "printed": len(report.entries),
            "agreeing": sum(entry.agrees for entry in report.entries),
            "known_faults_in_tables": sum(bool(entry.fault) for entry in report.entries),
            "claims_that_hold": sum(claim.valid for claim in report.claims),
            "claims": len(report.claims),
            "faults_reproduced": sum(fault.valid for fault in report.faults),
            "faults": len(report.faults),
            "mismatches": report.mismatches,
        }
        # Exit code 1, by which a test run can tell that something disagrees.
        mismatches = [f"mismatch: {line}" for line in report.mismatches]
        text = "\n".join([paper.summarize(report), *mismatches])
        return Answer(text, data, code=1 if mismatches else 0)


_ALL = (
    Assess,
    Spectrum,
    Respond,
    RockingSpectrum,
    Fragility,
    AssessInventory,
    Critical,
    Sensitivity,
    HarmonicFloor,
    Fit,
    MeasureTradeoff,
    Paper,
)
COMMANDS: dict[str, type[Command]] = {each.command: each for each in _ALL}
