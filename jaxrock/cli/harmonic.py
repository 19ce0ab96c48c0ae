"""The command about harmonic floors."""

from pathlib import Path

import numpy as np

from ..block import RECTANGLE_INERTIA_RATIO
from ..grids import as_axis, write_table
from ..spectra import harmonic_spectrum
from ..validation import AT_LEAST_ONE, COUNT, POSITIVE, UNIT_INTERVAL, as_real, check
from .command import Answer, Count, Folder, Grid, ModelName, Steps, Writing, save_picture


class HarmonicFloor(Writing):
    """Steady rocking on a harmonic floor, in the plane of its frequency and amplitude.

    Where one impact in every half period goes on for ever, whether that is stable, how high
    the block rocks then, and what it does elsewhere and from rest. The same for every size of
    block. Writes harmonic.nc, harmonic.csv and harmonic.png.

    Example: jaxrock harmonic --slenderness 5 --restitution 0.9 --frequency-ratio 1:12:45
    """

    command = "harmonic"

    slenderness: float = 5.0
    """Height over width [-]."""
    restitution: float | None = None
    """Velocity after an impact over velocity before it [-], 0 to 1; Housner's if not given."""
    inertia_ratio: float = RECTANGLE_INERTIA_RATIO
    """Moment of inertia about an edge over m R^2 [-], at least 1, for Housner's restitution."""
    frequency_ratio: Grid = ("1:12:45",)
    """Frequency of the floor over p [-]."""
    amplitude_ratio: Grid | None = None
    """Amplitude of the floor over what just lifts the block [-]; 60, 0.05 to 12, if not given."""
    model: ModelName = "nonlinear"
    """Equation of motion."""
    cycles: Count = 100
    """Periods for which blocks are followed."""
    out: Folder = Path("harmonic")

    def _carry_out(self) -> Steps:
        frequencies = as_axis("frequency_ratio", self.read_numbers("frequency_ratio"))
        # By default evenly in logarithms, from gently to far beyond what lifts the block.
        usual = self.amplitude_ratio is None
        given = np.geomspace(0.05, 12, 60) if usual else self.read_numbers("amplitude_ratio")
        amplitudes = as_axis("amplitude_ratio", given)
        check("slenderness", as_real("slenderness", self.slenderness), POSITIVE)
        check("inertia_ratio", as_real("inertia_ratio", self.inertia_ratio), AT_LEAST_ONE)
        check("cycles", np.asarray(self.cycles), COUNT)
        if self.restitution is not None:
            check("restitution", as_real("restitution", self.restitution), UNIT_INTERVAL)
        folder = yield [f"harmonic.{kind}" for kind in ("nc", "csv", "png")]
        from ..plot import plot_harmonic

        alike = "slenderness", "restitution", "inertia_ratio", "model", "cycles"
        options = {name: getattr(self, name) for name in alike}
        found = harmonic_spectrum(frequencies, amplitudes, **options)
        found.to_netcdf(folder / "harmonic.nc")
        write_table(found, folder / "harmonic.csv")
        save_picture(plot_harmonic(found), folder / "harmonic.png")
        sizes = {str(name): size for name, size in found.sizes.items()}
        # The classes are flags of the CF conventions: numbers, whose meanings are in
        # attributes.
        shares = {
            name: {
                str(meaning): float((found[name] == flag).mean())
                for flag, meaning in zip(
                    found[name].flag_values, found[name].flag_meanings.split(), strict=True
                )
            }
            for name in ("region", "from_rest")
        }
        lines = [f"{np.prod(list(sizes.values()))} points"]
        for name, title in (("region", "steady rocking"), ("from_rest", "from rest")):
            parts = [
                f"{share:.1%} {word.replace('_', ' ')}" for word, share in shares[name].items()
            ]
            lines.append(f"{title}: {', '.join(parts)}")
        return Answer("\n".join(lines), {"sizes": sizes, "model": self.model, **shares})
