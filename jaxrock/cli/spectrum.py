"""``jaxrock spectrum``."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from ..spectra import RESONANCE_AXES, axis, overturned_share, resonance_spectrum, write_table
from ..validation import POSITIVE, check
from .options import Answer, Grid, Writing, numbers, picture


@dataclass(frozen=True, kw_only=True)
class Spectrum(Writing):
    """Resonance spectra over a grid of blocks, as NetCDF, CSV and a picture.

    Writes spectrum.nc, spectrum.csv and spectrum.png. Values of the grid are given one by
    one, or as START:STOP:COUNT.

    Example: jaxrock spectrum --slenderness 3:10:15 --width 0.4 0.8 --restitution 0.7
    """

    slenderness: Grid = ("3:10:141",)
    """Height over width [-]."""
    width: Grid = ("0.4", "0.6", "0.8", "1.0", "1.2")
    """Full widths 2b of the base [m]."""
    restitution: Grid = ("0.6", "0.7", "0.8")
    """Coefficients of restitution [-], 0 to 1."""
    intensity: Grid = ("0.15",)
    """Change of ground velocity in each pulse [m/s]."""
    gravity: float = 9.81
    """Acceleration of gravity [m/s2]."""
    model: Literal["linearized", "nonlinear", "auto"] = "linearized"
    """Equation of free rocking; auto takes at each point the cheapest that keeps the tolerance."""
    tolerance: float = 1e-3
    """For auto: relative error that is allowed."""
    out: Path = Path("spectrum")

    @property
    def names(self) -> tuple[str, ...]:
        """A dataset, a table and a picture."""
        return ("spectrum.nc", "spectrum.csv", "spectrum.png")

    def check(self) -> None:
        """The grid, gravity, tolerance and files."""
        for name in RESONANCE_AXES:
            axis(name, numbers(name, getattr(self, name)))
        check("gravity", self.gravity, POSITIVE)
        check("tolerance", self.tolerance, POSITIVE)
        if self.model != "auto":
            self.refuse("tolerance", only_with="the model auto")
        super().check()

    def run(self) -> Answer:
        """Compute the grid part by part into the files."""
        from ..plot import plot_spectrum

        grid: dict[str, Any] = {name: numbers(name, getattr(self, name)) for name in RESONANCE_AXES}
        if len(grid["intensity"]) == 1:
            grid["intensity"] = grid["intensity"][0]
        with self.written() as scratch:
            dataset_path, table_path, picture_path = (scratch / name for name in self.names)
            with resonance_spectrum(
                **grid,
                model=self.model,
                tolerance=self.tolerance,
                gravity=self.gravity,
                store=dataset_path,
            ) as dataset:
                write_table(dataset, table_path)
                picture(plot_spectrum(dataset), picture_path)
                sizes = {str(name): size for name, size in dataset.sizes.items()}
                overturned = overturned_share(dataset)
        return self.finished(
            f"{math.prod(sizes.values())} scenes, {100 * overturned:.1f} % of them overturn",
            {"sizes": sizes, "model": self.model, "overturned": overturned},
        )
