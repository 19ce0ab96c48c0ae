"""``jaxrock spectrum``."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from ..spectra import RESONANCE_AXES, axis, overturned_share, resonance_spectrum, write_table
from ..validation import POSITIVE, check
from .options import Answer, Grid, Writing, numbers
from .output import picture


@dataclass(frozen=True, kw_only=True)
class Spectrum(Writing):
    """Resonance spectra over a grid of blocks, as NetCDF, CSV and a picture.

    Writes spectrum.nc, spectrum.csv and spectrum.png. Values of the grid are given one by
    one, or as START:STOP:COUNT.

    Example: jaxrock spectrum --slenderness 3:10:15 --width 0.4 0.8 --restitution 0.7
    """

    FILES = ("spectrum.nc", "spectrum.csv", "spectrum.png")

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
    model: Literal["linearized", "nonlinear", "auto"] = "linearized"
    """Equation of free rocking; auto takes at each point the cheapest within the tolerance."""
    tolerance: float = 1e-3
    """Relative error that is allowed; for the model auto."""
    out: Path = Path("spectrum")

    def check(self) -> None:
        """The grid, gravity, the tolerance and the files."""
        for name, values in self._grid.items():
            axis(name, values)
        check("gravity", self.gravity, POSITIVE)
        check("tolerance", self.tolerance, POSITIVE)
        if self.model != "auto":
            self.refuse("tolerance", only_with="the model auto")
        super().check()

    def run(self) -> Answer:
        """Compute the grid part by part into the files."""
        from ..plot import plot_spectrum

        grid: dict[str, Any] = self._grid
        if len(grid["intensity"]) == 1:  # then it is no dimension
            grid["intensity"] = grid["intensity"][0]
        grid |= {"model": self.model, "tolerance": self.tolerance, "gravity": self.gravity}
        with (
            self.written() as scratch,
            resonance_spectrum(**grid, store=scratch / "spectrum.nc") as dataset,
        ):
            write_table(dataset, scratch / "spectrum.csv")
            picture(plot_spectrum(dataset), scratch / "spectrum.png")
            sizes = {str(name): size for name, size in dataset.sizes.items()}
            overturned = overturned_share(dataset)
        return self.finished(
            f"{math.prod(sizes.values())} scenes, {100 * overturned:.1f} % of them overturn",
            {"sizes": sizes, "model": self.model, "overturned": overturned},
        )

    @property
    def _grid(self) -> dict[str, list[float]]:
        return {name: numbers(name, getattr(self, name)) for name in RESONANCE_AXES}
