"""The command about harmonic floors."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..block import Block
from ..driven import uplift_acceleration
from ..grids import write_table
from ..ground_motion import Harmonic
from ..host import write_whole
from ..impact import describe_assumed_restitution
from ..resonance import as_model
from ..spectra import add_size, harmonic_spectrum, lowest_stable_amplitude
from ..validation import UNIT_INTERVAL, check
from .answers import Answer, save_picture
from .options import (
    Count,
    FileOutput,
    Folder,
    Grid,
    ModelName,
    SizeOptions,
    read_axis,
    refuse,
)

if TYPE_CHECKING:
    import xarray

_FILES = ("harmonic.nc", "harmonic.csv", "harmonic.png")
_MAX_LINES = 5  # of frequencies that are printed; JSON has all


def harmonic(  # noqa: PLR0913
    *,
    restitution: float | None = None,
    frequency_ratio: Grid | None = None,
    amplitude_ratio: Grid | None = None,
    frequency: Grid | None = None,
    amplitude: Grid | None = None,
    model: ModelName = "nonlinear",
    cycles: Count = 100,
    size_options: SizeOptions = SizeOptions(),
    out: Folder = Path("harmonic"),
    output: FileOutput = FileOutput(),
) -> Answer:
    """Map steady rocking on a harmonic floor, over its frequency and amplitude.

    The map shows where the block rocks steadily with one impact in every half period, whether
    this motion is stable, and how high the block rocks. Where it is not stable, the map shows
    the outcome of a launch near it. The files also have the outcome of a start from rest. With
    a width, the axes are in Hz and m/s2. Without a width they are ratios, and the map holds
    for every size of block. Writes harmonic.nc, harmonic.csv and harmonic.png.

    Example: jaxrock harmonic --slenderness 5 --restitution 0.9 --frequency-ratio 1:12:45

    Example: jaxrock harmonic --width 0.4 --height 2 --frequency 0.5:5:46

    Parameters
    ----------
    restitution
        Velocity after an impact over velocity before it [-], 0 to 1; Housner's if not given.
    frequency_ratio
        Frequency of the floor over p [-], if no width is given. 1:12:45 if not given.
    amplitude_ratio
        Amplitude of the floor over the amplitude that just lifts the block [-]. If not given,
        60 logarithmically spaced values from 0.05 to 12.
    frequency
        Frequency of the floor [Hz], if a width is given. If not given, 45 values from 1 to 12
        times p / (2 pi).
    amplitude
        Amplitude of the floor [m/s2], if a width is given. If not given, the amplitudes of
        the default amplitude_ratio.
    model
        Equation of motion.
    cycles
        Number of simulated periods of the floor.
    out
        Folder to write to; made if it is missing.
    """
    width = size_options.width
    if width is None:
        of_size = {"height": size_options.height, "gravity": size_options.gravity}
        refuse("--width", **of_size, frequency=frequency, amplitude=amplitude)
    elif frequency_ratio is not None or amplitude_ratio is not None:
        raise ValueError(
            "--frequency-ratio and --amplitude-ratio exclude --width; with --width give"
            " --frequency in Hz and --amplitude in m/s2"
        )
    # Ratios do not depend on the size: 1 m stands in.
    block = size_options.make_block(1.0 if width is None else width, 5.0)
    Harmonic(1.0, 1.0, cycles)  # raises if `cycles` is not allowed
    if restitution is not None:
        check("restitution", restitution, UNIT_INTERVAL)
    frequencies = _read_frequencies(block, frequency_ratio or ("1:12:45",), frequency)
    amplitudes = _read_amplitudes(block, model, amplitude_ratio, amplitude)
    with write_whole("out", out, _FILES, output.force) as folder:
        from ..plot import plot_harmonic

        dataset = harmonic_spectrum(
            frequencies,
            amplitudes,
            slenderness=float(block.slenderness),
            restitution=restitution,
            inertia_ratio=float(block.inertia_ratio),
            model=model,
            cycles=cycles,
        )
        if width is not None:
            dataset = _add_axes(add_size(dataset, block), frequency, amplitude)
        dataset.to_netcdf(folder / "harmonic.nc")
        write_table(dataset, folder / "harmonic.csv")
        save_picture(plot_harmonic(dataset), folder / "harmonic.png")
    lines, data = _describe_regions(dataset)
    if restitution is None:
        lines.insert(1, describe_assumed_restitution(block))
    if width is not None:
        lowest = lowest_stable_amplitude(dataset)
        lines += _describe_frequencies(dataset, lowest)
        data["uplift_amplitude"] = dataset.attrs["uplift_amplitude"]
        data["rows"] = [
            {"frequency": float(value.frequency), "rocks_on_from": float(value)}
            for value in lowest
        ]
    return Answer("\n".join(lines), data, output, [out / name for name in _FILES])


def _read_frequencies(block: Block, ratios: Grid, frequencies: Grid | None) -> np.ndarray:
    """Read the frequencies of the floor over p [-]."""
    if frequencies is None:
        return read_axis("frequency_ratio", ratios)
    ratio = 2 * np.pi / float(block.frequency_parameter)
    return np.asarray(read_axis("frequency", frequencies) * ratio)


def _read_amplitudes(
    block: Block, model: ModelName, ratios: Grid | None, amplitudes: Grid | None
) -> np.ndarray:
    """Read the amplitudes of the floor over what just lifts the block [-]."""
    if ratios is not None:
        return read_axis("amplitude_ratio", ratios)
    if amplitudes is not None:
        uplift = float(uplift_acceleration(block, as_model(model)))
        return np.asarray(read_axis("amplitude", amplitudes) / uplift)
    # Evenly in logarithms, from gently to far beyond what lifts the block.
    return np.geomspace(0.05, 12, 60)


def _add_axes(dataset: "xarray.Dataset", *axes: Grid | None) -> "xarray.Dataset":
    """Put frequencies and amplitudes as they were asked for, which ratios lose a digit of."""
    for name, values in zip(("frequency", "amplitude"), axes, strict=True):
        if values is not None:
            exact = dataset[name].copy(data=read_axis(name, values))
            dataset = dataset.assign_coords({name: exact})
    return dataset


def _describe_regions(dataset: "xarray.Dataset") -> tuple[list[str], dict[str, object]]:
    """Describe which fraction of the points rocks how: lines of text, and data."""
    lines = [f"{dataset.region.size} points"]
    data: dict[str, object] = {
        "sizes": {str(name): size for name, size in dataset.sizes.items()},
        "model": dataset.attrs["model"],
    }
    for name, title in (("region", "steady rocking"), ("from_rest", "from rest")):
        fractions = _compute_fractions(dataset[name])
        parts = [
            f"{fraction:.1%} {meaning.replace('_', ' ')}"
            for meaning, fraction in fractions.items()
        ]
        lines.append(f"{title}: {', '.join(parts)}")
        data[name] = fractions
    return lines, data


def _compute_fractions(flags: "xarray.DataArray") -> dict[str, float]:
    """Compute the fraction of points of each class."""
    # The classes are flags of the CF conventions: numbers, whose meanings are in attributes.
    attributes: Any = flags.attrs
    return {
        str(meaning): float((flags == flag).mean())
        for flag, meaning in zip(
            attributes["flag_values"], attributes["flag_meanings"].split(), strict=True
        )
    }


def _describe_frequencies(dataset: "xarray.Dataset", lowest: "xarray.DataArray") -> list[str]:
    """Describe for a few frequencies from which amplitude on a block goes on rocking."""
    uplift = dataset.attrs["uplift_amplitude"]
    least = float(dataset.amplitude.min())
    lines = []
    # From the first to the last.
    count = min(lowest.size, _MAX_LINES)
    for k in np.linspace(0, lowest.size - 1, count).round().astype(int):
        amplitude = float(lowest[k])
        if np.isnan(amplitude):
            rocks = "does not keep rocking steadily"
        elif amplitude > least:
            rocks = f"keeps rocking from {amplitude:.3g} m/s2 on"
        else:
            rocks = f"keeps rocking at the lowest amplitude, {amplitude:.3g} m/s2"
        frequency = float(lowest.frequency[k])
        lines.append(f"at {frequency:.3g} Hz: {rocks}, lifted from rest at {uplift:.3g} m/s2")
    return lines
