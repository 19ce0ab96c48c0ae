"""``jaxrock rocking-spectrum``."""

from dataclasses import dataclass
from pathlib import Path

from ..spectra import axis, rocking_spectrum
from .options import Answer, Grid, RecordOptions, Writing, numbers, picture


@dataclass(frozen=True, kw_only=True)
class RockingSpectrum(RecordOptions, Writing):
    """Rocking spectrum of a record: peak rotation over the size of the block.

    Writes rocking_spectrum.nc, .csv and .png.

    Example: jaxrock rocking-spectrum --record example --scale 1.5
    """

    record: str | None = "example"
    period: Grid = ("1:8:71",)
    """2 pi / p of the blocks [s]."""
    slenderness: Grid = ("4", "6", "8")
    """Height over width [-]."""
    restitution: Grid = ("0.9",)
    """Velocity after an impact over velocity before it [-]."""
    out: Path = Path("rocking_spectrum")

    @property
    def names(self) -> list[str]:
        """A dataset, a table and a picture."""
        return [f"rocking_spectrum.{kind}" for kind in ("nc", "csv", "png")]

    def check(self) -> None:
        """The record, the grid and the files."""
        _ = self.motion
        for name, given in self._grid.items():
            axis(name, given)
        super().check()

    def run(self) -> Answer:
        """Compute the grid."""
        from ..plot import plot_rocking_spectrum

        dataset = rocking_spectrum(self.motion, *self._grid.values())
        with self.written() as scratch:
            dataset.to_netcdf(scratch / self.names[0])
            dataset.to_dataframe().to_csv(scratch / self.names[1])
            picture(plot_rocking_spectrum(dataset), scratch / self.names[2])
        share = float(dataset.overturned.mean())
        return self.finished(
            f"{dataset.overturned.size} blocks, {100 * share:.1f} % of them overturn",
            {"sizes": {str(name): size for name, size in dataset.sizes.items()}},
        )

    @property
    def _grid(self) -> dict[str, list[float]]:
        names = ("period", "slenderness", "restitution")
        return {name: numbers(name, getattr(self, name)) for name in names}
