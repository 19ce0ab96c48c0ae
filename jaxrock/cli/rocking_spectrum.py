"""``jaxrock rocking-spectrum``."""

from dataclasses import dataclass
from pathlib import Path

from ..spectra import axis, rocking_spectrum
from .options import Answer, Grid, RecordOptions, Writing, numbers
from .output import picture


@dataclass(frozen=True, kw_only=True)
class RockingSpectrum(RecordOptions, Writing):
    """Rocking spectrum of a record: peak rotation over the size of the block.

    Writes rocking_spectrum.nc, .csv and .png.

    Example: jaxrock rocking-spectrum --record example --scale 1.5
    """

    FILES = ("rocking_spectrum.nc", "rocking_spectrum.csv", "rocking_spectrum.png")

    record: str | None = "example"
    period: Grid = ("1:8:71",)
    """2 pi / p of the blocks [s]."""
    slenderness: Grid = (4.0, 6.0, 8.0)
    """Height over width [-]."""
    restitution: Grid = (0.9,)
    """Velocity after an impact over velocity before it [-]."""
    out: Path = Path("rocking_spectrum")

    def check(self) -> None:
        """The record, the grid and the files."""
        _ = self.motion
        for name, values in self._grid.items():
            axis(name, values)
        super().check()

    def run(self) -> Answer:
        """Compute the grid."""
        from ..plot import plot_rocking_spectrum

        dataset = rocking_spectrum(self.motion, *self._grid.values())
        with self.written() as scratch:
            dataset.to_netcdf(scratch / "rocking_spectrum.nc")
            dataset.to_dataframe().to_csv(scratch / "rocking_spectrum.csv")
            picture(plot_rocking_spectrum(dataset), scratch / "rocking_spectrum.png")
        share = float(dataset.overturned.mean())
        return self.finished(
            f"{dataset.overturned.size} blocks, {100 * share:.1f} % of them overturn",
            {"sizes": {str(name): size for name, size in dataset.sizes.items()}},
        )

    @property
    def _grid(self) -> dict[str, list[float]]:
        names = ("period", "slenderness", "restitution")
        return {name: numbers(name, getattr(self, name)) for name in names}
