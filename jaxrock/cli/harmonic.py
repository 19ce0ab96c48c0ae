"""The command about harmonic floors."""

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..block import RECTANGLE_INERTIA_RATIO, Block
from ..driven import uplift_acceleration
from ..grids import as_axis, write_table
from ..resonance import as_model
from ..spectra import add_size, harmonic_spectrum
from ..validation import COUNT, POSITIVE, UNIT_INTERVAL, as_real, check
from .command import Answer, Count, Folder, Grid, ModelName, Steps, Writing, save_picture

if TYPE_CHECKING:
    import xarray

_FREQUENCIES_TOLD = 5


class HarmonicFloor(Writing):
    """Steady rocking on a harmonic floor, in the plane of its frequency and amplitude.

    Where one impact in every half period goes on for ever, whether that is stable, how high
    the block rocks then, and what it does elsewhere and from rest. With a width, in Hz and
    m/s2; without, in ratios that are the same for every size of block. Writes harmonic.nc,
    harmonic.csv and harmonic.png.

    Example: jaxrock harmonic --slenderness 5 --restitution 0.9 --frequency-ratio 1:12:45

    Example: jaxrock harmonic --width 0.4 --height 2 --frequency 0.5:5:46
    """

    command = "harmonic"

    width: float | None = None
    """Full width 2b of the base [m]; if not given, the answer is for every size of block."""
    height: float | None = None
    """Full height 2a, twice that of the centre of mass [m]. Give this or the slenderness."""
    slenderness: float | None = None
    """Height over width [-]. 5 if neither is given."""
    gravity: float = 9.81
    """Acceleration of gravity [m/s2]."""
    restitution: float | None = None
    """Velocity after an impact over velocity before it [-], 0 to 1; Housner's if not given."""
    inertia_ratio: float = RECTANGLE_INERTIA_RATIO
    """Moment of inertia about an edge over m R^2 [-], at least 1, for Housner's restitution."""
    frequency_ratio: Grid = ("1:12:45",)
    """Frequency of the floor over p [-], without a width."""
    amplitude_ratio: Grid | None = None
    """Amplitude of the floor over what just lifts the block [-]; 60, 0.05 to 12, if not given."""
    frequency: Grid | None = None
    """Frequency of the floor [Hz], with a width; 45, from 1 to 12 p / 2 pi, if not given."""
    amplitude: Grid | None = None
    """Amplitude of the floor [m/s2], with a width; as with amplitude_ratio if not given."""
    model: ModelName = "nonlinear"
    """Equation of motion."""
    cycles: Count = 100
    """Periods for which blocks are followed."""
    out: Folder = Path("harmonic")

    def _carry_out(self) -> Steps:
        block = self._make_block()
        frequencies, amplitudes = self._read_axes(block)
        check("cycles", np.asarray(self.cycles), COUNT)
        if self.restitution is not None:
            check("restitution", as_real("restitution", self.restitution), UNIT_INTERVAL)
        folder = yield [f"harmonic.{kind}" for kind in ("nc", "csv", "png")]
        from ..plot import plot_harmonic

        alike = "restitution", "inertia_ratio", "model", "cycles"
        options = {name: getattr(self, name) for name in alike}
        slenderness = float(block.slenderness)
        found = harmonic_spectrum(frequencies, amplitudes, slenderness=slenderness, **options)
        if self.width is not None:
            found = add_size(found, block)
            # To the last digit as they were asked for, which ratios are not.
            for name in ("frequency", "amplitude"):
                if getattr(self, name) is not None:
                    exact = found[name].copy(data=self.read_numbers(name))
                    found = found.assign_coords({name: exact})
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
        data = {"sizes": sizes, "model": self.model, **shares}
        if self.width is not None:
            sized, rows = _describe_frequencies(found)
            lines += sized
            data |= {"uplift_amplitude": found.attrs["uplift_amplitude"], "rows": rows}
        return Answer("\n".join(lines), data)

    def _make_block(self) -> Block:
        """Make the block; without a width one of any size, 1 m wide."""
        if self.width is None:
            self.refuse("height", "gravity", "frequency", "amplitude", only_with="a width")
        elif self.amplitude_ratio or self.frequency_ratio != type(self).frequency_ratio:
            raise ValueError(
                "frequency_ratio and amplitude_ratio exclude a width, with which frequency in"
                " Hz and amplitude in m/s2 are given"
            )
        width = 1.0 if self.width is None else self.width
        check("width", width, POSITIVE)
        if self.height is not None and self.slenderness is not None:
            raise ValueError("height and slenderness exclude each other, got both")
        slenderness = 5.0 if self.slenderness is None else self.slenderness
        if self.height is not None:
            check("height", self.height, POSITIVE)
            slenderness = self.height / width
        return Block(width / 2, slenderness, self.gravity, self.inertia_ratio)

    def _read_axes(self, block: Block) -> tuple[np.ndarray, np.ndarray]:
        """Read frequencies over p, and amplitudes over what just lifts the block."""
        p = float(block.frequency_parameter)
        uplift = float(uplift_acceleration(block, as_model(self.model)))
        if self.frequency is None:
            frequencies = as_axis("frequency_ratio", self.read_numbers("frequency_ratio"))
        else:
            given = as_axis("frequency", self.read_numbers("frequency"))
            frequencies = given * (2 * np.pi / p)
        if self.amplitude is not None:
            amplitudes = as_axis("amplitude", self.read_numbers("amplitude")) / uplift
        elif self.amplitude_ratio is not None:
            amplitudes = as_axis("amplitude_ratio", self.read_numbers("amplitude_ratio"))
        else:
            # Evenly in logarithms, from gently to far beyond what lifts the block.
            amplitudes = np.geomspace(0.05, 12, 60)
        return frequencies, amplitudes


def _describe_frequencies(
    found: "xarray.Dataset",
) -> tuple[list[str], list[dict[str, float]]]:
    """Describe from which amplitude on a block goes on rocking: lines of text, and data.

    That is the lowest one of the grid with steady rocking that is stable.
    """
    uplift = found.attrs["uplift_amplitude"]
    found = found.sortby(["frequency_ratio", "amplitude_ratio"])
    count = found.sizes["frequency_ratio"]
    lowest = float(found.amplitude.values[0])
    rows = []
    lines = []
    # Data for every frequency, text for a few from the first to the last.
    told = set(np.linspace(0, count - 1, min(count, _FREQUENCIES_TOLD)).round().astype(int))
    for k, frequency in enumerate(found.frequency.values):
        stable = found.amplitude.values[found.region.values[k] == 1]
        least = float(stable[0]) if stable.size else math.nan
        rows.append({"frequency": float(frequency), "rocks_on_from": least})
        if k in told:
            begins = "rocks on from" if least > lowest else "rocks on at the lowest amplitude,"
            rocks = (
                f"{begins} {least:.3g} m/s2" if stable.size else "does not rock on steadily"
            )
            lines.append(
                f"at {frequency:.3g} Hz: {rocks}, lifted from rest at {uplift:.3g} m/s2"
            )
    return lines, rows
