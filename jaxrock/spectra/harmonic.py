"""Spectra of steady rocking on a harmonic floor, and of motion where it is not stable."""

import functools
import math
import threading
from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from ..block import RECTANGLE_INERTIA_RATIO, Block
from ..driven import (
    TOPPLED_ROTATION,
    Batch,
    follow_batch,
    require_complete,
    uplift_acceleration,
)
from ..grids import (
    Chunks,
    Grid,
    GridVariable,
    Values,
    apply_in_tiles,
    describe_axis,
    expand_scalars,
    list_points,
)
from ..ground_motion import Harmonic
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..steady import HarmonicOrbit, harmonic_orbit
from .blocks import SharedBlock, VariableTable, make_axes, make_unit_block, make_variables

if TYPE_CHECKING:
    import xarray

_LARGEST = 2**12  # number of points that are computed at once
_TILE = 2**6  # number of orbits in a program
# Only one program for orbits runs at a time: in JAX 0.10 the threads of several programs wait
# for each other.
_turns = threading.Lock()
# Relative change of the launch velocity at which a block starts to leave an unstable orbit. It
# is small enough to start near the orbit, and far above rounding, which would take many
# periods to grow.
_DISTURBANCE = 1e-3
_MAX_LINES = 5  # number of frequencies that are printed

_AXES = {  # long names
    "frequency_ratio": "frequency of the floor over p",
    "amplitude_ratio": "amplitude of the floor over the one that just lifts the block",
}
_VARIABLES: VariableTable = {
    "velocity_ratio": (float, "launch velocity over critical velocity", "1"),
    "rotation_ratio": (float, "peak rotation over critical angle", "1"),
    "phase": (float, "phase of the floor at impacts before positive rotation", "rad"),
    "trace": (float, "sum of the two multipliers of the half-period map", "1"),
    "multiplier": (float, "larger modulus of the two multipliers", "1"),
}
_FLAGS = {  # long names and meanings
    "region": (
        "symmetric steady rocking, and the outcome of a launch near it",
        "no_orbit stable symmetry_broken overturned",
    ),
    "from_rest": (
        "outcome of a block that starts from rest",
        "stays_at_rest rocks overturned",
    ),
}


def harmonic_spectrum(
    frequency_ratio: Values,
    amplitude_ratio: Values,
    *,
    slenderness: float = 5.0,
    restitution: float | None = None,
    inertia_ratio: float = RECTANGLE_INERTIA_RATIO,
    model: ModelLike = Nonlinear(),
    cycles: int = 100,
    chunks: Chunks | None = None,
) -> "xarray.Dataset":
    """Compute steady rocking on a harmonic floor, over its frequency and amplitude.

    Parameters
    ----------
    frequency_ratio : array_like
        omega / p [-], a number or one-dimensional.
    amplitude_ratio : array_like
        Amplitude over g tan(alpha_c), or over g alpha_c with `Linearized` [-], a number or
        one-dimensional. Above 1 the floor lifts the block.
    slenderness, restitution, inertia_ratio : float
        lambda [-]; C [-], by default Housner's; and kappa [-], which affects only this
        default.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.
    cycles : int
        Number of simulated periods, at least 1.
    chunks : mapping of str to int or "auto", optional
        For a lazy dataset; see `resonance_spectrum`.

    Returns
    -------
    xarray.Dataset
        Has frequency_ratio and amplitude_ratio as dimensions or scalar coordinates. The
        variables velocity_ratio (launch velocity over critical velocity), rotation_ratio,
        phase, trace and multiplier (the larger modulus) describe the motion of
        `harmonic_orbit`; NaN where there is no orbit. The variable region is no_orbit or
        stable or, for an unstable orbit, the outcome of a block launched near it:
        symmetry_broken if it continues to rock in another way, overturned if it reaches
        pi / 2. The variable from_rest is the outcome of a block that starts from rest. All
        hold for every size of block.

    Raises
    ------
    ValueError
        If an argument is out of range, or an integration did not finish.

    Notes
    -----
    A launch near an orbit has its phase but is 0.1 % faster. At a restitution of 1 no orbit
    is stable: a perturbed motion stays nearby at best. Where motions are chaotic, rounding
    decides single points of the regions.

    Examples
    --------
    >>> import jaxrock as jr
    >>> found = jr.spectra.harmonic_spectrum([2.0, 4.0], [0.01, 1.5, 8.0], cycles=20)
    >>> print(found.region.values.tolist())
    [[0, 1, 3], [0, 1, 1]]
    """
    axes = make_axes(frequency_ratio=frequency_ratio, amplitude_ratio=amplitude_ratio)
    model = as_model(model)
    shared, about = make_unit_block(slenderness, restitution, inertia_ratio)
    Harmonic(1.0, 1.0, cycles)  # raises here, before any work, if `cycles` is not allowed
    variables = make_variables((*axes,), _VARIABLES)
    for name, (long_name, meanings) in _FLAGS.items():
        values = np.arange(len(meanings.split()), dtype=np.int8)
        described = {"long_name": long_name, "flag_values": values, "flag_meanings": meanings}
        variables[name] = GridVariable((*axes,), np.int8, described)
    spectrum = Grid(
        "Harmonic spectrum",
        axes,
        variables,
        {"model": model.name, "motion": Harmonic.name, **about, "cycles": cycles},
        functools.partial(_compute_floors, cycles, model),
        _LARGEST,
        shared=shared,
    ).build_dataset(chunks)
    # In other spectra these axes describe pulses, and so do their default long names.
    for name, long_name in _AXES.items():
        spectrum[name].attrs["long_name"] = long_name
    return spectrum


def add_size(spectrum: "xarray.Dataset", block: Block) -> "xarray.Dataset":
    """Add the frequencies [Hz] and amplitudes [m/s2] of one block to its harmonic spectrum."""
    uplift = float(uplift_acceleration(block, as_model(spectrum.attrs["model"])))
    hertz = float(block.frequency_parameter) / (2 * np.pi)
    numbers = {name: float(getattr(block, name)) for name in ("width", "height", "gravity")}
    sized = spectrum.assign_coords(
        frequency=spectrum.frequency_ratio * hertz, amplitude=spectrum.amplitude_ratio * uplift
    ).assign_attrs(**numbers, uplift_amplitude=uplift)
    for name, units in (("frequency", "Hz"), ("amplitude", "m s-2")):
        sized[name].attrs = describe_axis(name) | {"units": units}
        # The CF conventions allow no fill value for coordinates, which have no missing values.
        sized[name].encoding["_FillValue"] = None
    return sized


def _compute_floors(
    cycles: int, model: RockingModel, shared: SharedBlock, *coordinates: np.ndarray
) -> dict[str, np.ndarray]:
    """Compute orbits and regions over a part of the plane."""
    block, restitution = shared
    shape, (ratios, strengths) = list_points(*coordinates)
    amplitude = strengths * float(uplift_acceleration(block, model))
    frequency = ratios * float(block.frequency_parameter)

    def compute_tile(_: int, floors: np.ndarray) -> HarmonicOrbit:
        with _turns:
            orbit = harmonic_orbit(block, restitution, *floors, model=model)
            return jax.block_until_ready(orbit)

    orbit = apply_in_tiles(compute_tile, _TILE, np.stack([amplitude, frequency]))
    # A velocity is given, although it is 0: so the program for launched blocks serves as well.
    motion = Harmonic(amplitude, frequency, cycles)
    resting = Batch.of(block, restitution, motion, velocity=np.zeros_like(amplitude))
    peak_from_rest = np.asarray(follow_batch(resting, model).peak_rotation)
    # 0 where no orbit is unstable, and NaN where the integration did not finish.
    peak_near_orbit = np.zeros_like(peak_from_rest)
    unstable = np.flatnonzero(np.asarray(orbit.exists) & ~np.asarray(orbit.stable))
    if unstable.size:
        motion = Harmonic(amplitude[unstable], frequency[unstable], cycles)
        launch = (1 + _DISTURBANCE) * np.asarray(orbit.launch_velocity)[unstable]
        # The block is launched at its phase of the first period.
        phase = np.mod(np.asarray(orbit.phase)[unstable], 2 * np.pi)
        batch = Batch.of(block, restitution, motion, velocity=launch)
        launched = batch.advance(phase / np.asarray(motion.frequency))
        peak_near_orbit[unstable] = follow_batch(launched, model).peak_rotation
    known = ~np.isnan(peak_near_orbit + peak_from_rest)
    labels = dict(zip(_AXES, map(np.atleast_1d, coordinates), strict=True))
    require_complete(known.reshape([values.size for values in labels.values()]), **labels)
    region = np.asarray(orbit.stable, np.int8)
    region[unstable] = 2
    answers = {
        "velocity_ratio": orbit.launch_velocity / float(model.critical_velocity(block)),
        "rotation_ratio": orbit.rotation_ratio,
        "phase": orbit.phase,
        "trace": orbit.trace,
        "multiplier": abs(np.asarray(orbit.multipliers[..., 0])),
        "region": region + _flag_toppled(peak_near_orbit),
        "from_rest": (peak_from_rest > 0) + _flag_toppled(peak_from_rest),
    }
    return {name: np.asarray(values).reshape(shape) for name, values in answers.items()}


def _flag_toppled(peak: np.ndarray) -> np.ndarray:
    """Flag blocks that have fallen by 1, others by 0."""
    # The rotation decides and not the energy: the floor goes on moving, so that the motion on
    # a floor at rest does not matter.
    return (peak >= np.asarray(TOPPLED_ROTATION, peak.dtype)).astype(np.int8)


def tabulate_regions(dataset: "xarray.Dataset") -> dict[str, object]:
    """List the fractions of the points that rock in each way, and where steady rocking begins.

    Parameters
    ----------
    dataset : xarray.Dataset
        A harmonic spectrum.

    Returns
    -------
    dict
        ``region`` and ``from_rest`` by class [-]. With the units of one block also the
        ``uplift_amplitude`` [m/s2], and ``rows`` of the ``frequency`` [Hz] and of the lowest
        amplitude at which the block goes on rocking [m/s2].
    """
    table: dict[str, object] = {"model": dataset.attrs["model"], "sizes": dict(dataset.sizes)}
    for name, (_, meanings) in _FLAGS.items():
        counted = enumerate(meanings.split())
        table[name] = {word: float((dataset[name] == k).mean()) for k, word in counted}
    if "amplitude" in dataset.coords:
        table["uplift_amplitude"] = dataset.attrs["uplift_amplitude"]
        dataset = expand_scalars(dataset, *_AXES)
        stable = dataset.region == _FLAGS["region"][1].split().index("stable")
        lowest = dataset.amplitude.where(stable).min("amplitude_ratio")
        table["rows"] = [
            {"frequency": float(amplitude.frequency), "rocks_on_from": float(amplitude)}
            for amplitude in lowest.sortby("frequency_ratio")
        ]
    return table


def describe_regions(dataset: "xarray.Dataset") -> str:
    """Write the table of `tabulate_regions` at a few of the frequencies.

    Parameters
    ----------
    dataset : xarray.Dataset
        A harmonic spectrum.

    Returns
    -------
    str
    """
    table: Any = tabulate_regions(dataset)
    lines = [f"{dataset.region.size} points"]
    for name, title in (("region", "steady rocking"), ("from_rest", "from rest")):
        fractions = (f"{x:.1%} {word.replace('_', ' ')}" for word, x in table[name].items())
        lines.append(f"{title}: {', '.join(fractions)}")
    rows = table.get("rows", [])
    shown = np.linspace(0, len(rows) - 1, min(len(rows), _MAX_LINES)).round().astype(int)
    for row in (rows[k] for k in shown):
        amplitude = row["rocks_on_from"]
        lowest = " (the lowest examined)" * (amplitude == float(dataset.amplitude.min()))
        keeps = f"keeps rocking from {amplitude:.3g} m/s2{lowest} on"
        if math.isnan(amplitude):
            keeps = "does not keep rocking steadily"
        lines.append(f"at {row['frequency']:.3g} Hz: {keeps}")
    if rows:
        lines.append(f"lifted from rest at {table['uplift_amplitude']:.3g} m/s2")
    return "\n".join(lines)
