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
    Grid,
    GridVariable,
    Values,
    apply_in_tiles,
    as_axis,
    describe_axis,
    expand_scalars,
    list_points,
)
from ..ground_motion import Harmonic
from ..impact import housner_restitution, require_free_standing
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..steady import HarmonicOrbit, harmonic_orbit
from ..validation import UNIT_INTERVAL, Reals, as_real, check, check_concrete, check_kind

if TYPE_CHECKING:
    import xarray

    from ..grids import Chunks

_LARGEST = 2**12  # points of a spectrum that are computed at once
_TILE = 2**6  # points whose orbits go through a program at once
# Of the programs for orbits only one runs at a time: in JAX 0.10 the threads of several wait
# for each other.
_turns = threading.Lock()
# Relative change of the launch velocity, by which a block leaves an orbit that is not stable.
# Small enough to be near the orbit, and far above rounding, which would need many periods to
# grow to a motion of another kind.
_DISTURBANCE = 1e-3
_MAX_LINES = 5  # frequencies that are printed

_AXES = {  # long names
    "frequency_ratio": "frequency of the floor over p",
    "amplitude_ratio": "amplitude of the floor over the one that just lifts the block",
}
_VARIABLES = {  # long names and units
    "velocity_ratio": ("launch velocity over critical velocity", "1"),
    "rotation_ratio": ("peak rotation over critical angle", "1"),
    "phase": ("phase of the floor at an impact, after which rotation is positive", "rad"),
    "trace": ("sum of the two multipliers of the half-period map", "1"),
    "multiplier": ("larger modulus of the two multipliers", "1"),
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
    chunks: "Chunks | None" = None,
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
    >>> found = jr.harmonic_spectrum([2.0, 4.0], [0.01, 1.5, 8.0], cycles=20)
    >>> print(found.region.values.tolist())
    [[0, 1, 3], [0, 1, 1]]
    """
    given = {"frequency_ratio": frequency_ratio, "amplitude_ratio": amplitude_ratio}
    axes = {name: as_axis(name, values) for name, values in given.items()}
    model = as_model(model)
    block = Block(0.2, slenderness, inertia_ratio=inertia_ratio)
    if restitution is None:
        restitution = max(float(housner_restitution(block)), 0.0)
    check_concrete(restitution, "a spectrum is a dataset")
    check("restitution", as_real("restitution", restitution, unit=""), UNIT_INTERVAL)
    uplift = float(uplift_acceleration(block, model))
    rate = float(block.frequency_parameter)
    critical = float(model.critical_velocity(block))
    Harmonic(1.0, 1.0, cycles)  # raises here, before any work, if `cycles` is not allowed

    variables = {
        name: GridVariable(tuple(axes), float, {"long_name": long_name, "units": units})
        for name, (long_name, units) in _VARIABLES.items()
    }
    for name, (long_name, meanings) in _FLAGS.items():
        values = np.arange(len(meanings.split()), dtype=np.int8)
        described = {"long_name": long_name, "flag_values": values, "flag_meanings": meanings}
        variables[name] = GridVariable(tuple(axes), np.int8, described)
    attributes = {
        "model": model.name,
        "motion": Harmonic.name,
        "slenderness": slenderness,
        "restitution": restitution,
        "inertia_ratio": inertia_ratio,
        "cycles": cycles,
    }
    compute = functools.partial(_compute_floors, uplift, rate, critical, cycles, model)
    shared = (block, as_real("restitution", restitution, unit=""))
    grid = Grid(
        "Harmonic spectrum",
        axes,
        variables,
        attributes,
        compute,
        _LARGEST,
        shared=shared,
    )
    spectrum = grid.build_dataset(chunks)
    # The axes are called after pulses, which these names have in other spectra.
    for name, long_name in _AXES.items():
        spectrum[name].attrs["long_name"] = long_name
    return spectrum


def add_size(spectrum: "xarray.Dataset", block: Block) -> "xarray.Dataset":
    """Add the frequencies and amplitudes of one block to a harmonic spectrum.

    Parameters
    ----------
    spectrum : xarray.Dataset
        From `harmonic_spectrum`.
    block : Block
        A single one, of the slenderness and the inertia ratio of the spectrum.

    Returns
    -------
    xarray.Dataset
        With the coordinates frequency [Hz] along frequency_ratio and amplitude [m/s2] along
        amplitude_ratio, and the attributes width and height [m], gravity and
        uplift_amplitude [m/s2].

    Raises
    ------
    ValueError
        If the slenderness or the inertia ratio of `block` is not that of the spectrum, or if
        it is an array or one-sided.

    Examples
    --------
    >>> import jaxrock as jr
    >>> found = jr.harmonic_spectrum([2.0, 4.0], [0.01, 1.5, 8.0], cycles=20)
    >>> sized = jr.spectra.add_size(found, jr.Block(0.2, 5.0))
    >>> print(sized.frequency.values.round(2), f"Hz, {sized.uplift_amplitude:.3f} m/s2")
    [0.85 1.71] Hz, 1.962 m/s2
    """
    check_kind("block", block, Block)
    require_free_standing(block, "a harmonic spectrum")
    for name in ("slenderness", "inertia_ratio"):
        given = np.asarray(getattr(block, name))
        expected = spectrum.attrs[name]
        # The attributes may be of another precision than the block.
        if given.ndim or not np.isclose(given, expected, rtol=1e-6):
            raise ValueError(
                f"block must have the {name} of the spectrum, {expected:g}, got {given}"
            )
    uplift = float(uplift_acceleration(block, as_model(spectrum.attrs["model"])))
    hertz = float(block.frequency_parameter) / (2 * np.pi)
    numbers = {name: float(getattr(block, name)) for name in ("width", "height", "gravity")}
    sized = spectrum.assign_coords(
        frequency=spectrum.frequency_ratio * hertz, amplitude=spectrum.amplitude_ratio * uplift
    ).assign_attrs(**numbers, uplift_amplitude=uplift)
    for name, units in (("frequency", "Hz"), ("amplitude", "m s-2")):
        sized[name].attrs = describe_axis(name) | {"units": units}
        # The CF conventions allow none for coordinates, of which no value is missing.
        sized[name].encoding["_FillValue"] = None
    return sized


def _compute_floors(
    uplift: float,
    rate: float,
    critical: float,
    cycles: int,
    model: RockingModel,
    shared: tuple[Block, Reals],
    *parts: np.ndarray,
) -> dict[str, np.ndarray]:
    """Compute orbits and regions over a part of the plane."""
    block, restitution = shared
    shape, (ratios, strengths) = list_points(*parts)
    amplitude = strengths * uplift
    frequency = ratios * rate

    def compute_tile(_: int, floors: np.ndarray) -> HarmonicOrbit:
        with _turns:
            return jax.block_until_ready(
                harmonic_orbit(block, restitution, *floors, model=model)
            )

    orbit = apply_in_tiles(compute_tile, _TILE, np.stack([amplitude, frequency]))
    motion = Harmonic(amplitude, frequency, cycles)
    region, peak_near_orbit = _classify_orbits(
        block, restitution, amplitude, frequency, cycles, orbit, model
    )
    # A velocity, though it is 0: with one the program compiled for launched blocks serves.
    from_rest = Batch.of(block, restitution, motion, velocity=np.zeros_like(amplitude))
    peak_from_rest = np.asarray(follow_batch(from_rest, model).peak_rotation)
    known = ~np.isnan(peak_near_orbit + peak_from_rest)
    labels = dict(zip(_AXES, map(np.atleast_1d, parts), strict=True))
    require_complete(known.reshape([values.size for values in labels.values()]), **labels)
    answers = {
        "velocity_ratio": np.asarray(orbit.launch_velocity) / critical,
        "rotation_ratio": orbit.rotation_ratio,
        "phase": orbit.phase,
        "trace": orbit.trace,
        "multiplier": abs(np.asarray(orbit.multipliers[..., 0])),
        "region": region + _flag_toppled(peak_near_orbit),
        "from_rest": (peak_from_rest > 0) + _flag_toppled(peak_from_rest),
    }
    return {name: np.asarray(values).reshape(shape) for name, values in answers.items()}


def _classify_orbits(
    block: Block,
    restitution: Reals,
    amplitude: np.ndarray,
    frequency: np.ndarray,
    cycles: int,
    orbit: HarmonicOrbit,
    model: RockingModel,
) -> tuple[np.ndarray, np.ndarray]:
    """Classify the orbits, and simulate blocks near orbits that are not stable.

    Returns
    -------
    region : ndarray of int8
        As in `_FLAGS`, where the block does not overturn.
    peak : ndarray
        Peak rotation near an orbit that is not stable [rad]; 0 elsewhere, NaN where the
        integration did not finish.
    """
    region = np.asarray(orbit.stable, np.int8)
    peaks = np.zeros(region.shape, np.asarray(orbit.phase).dtype)
    exists = np.asarray(orbit.exists)
    unstable = np.flatnonzero(exists & (region == 0))
    if unstable.size:
        motion = Harmonic(amplitude.flat[unstable], frequency.flat[unstable], cycles)
        phase = np.asarray(orbit.phase).flat[unstable]
        launch = np.asarray(orbit.launch_velocity).flat[unstable]
        batch = Batch.of(block, restitution, motion, velocity=(1 + _DISTURBANCE) * launch)
        # Launched at its phase of the first period.
        launched = batch.advance(np.mod(phase, 2 * np.pi) / np.asarray(motion.frequency))
        peaks.flat[unstable] = follow_batch(launched, model).peak_rotation
        region.flat[unstable] = 2
    return region, peaks


def _flag_toppled(peak: np.ndarray) -> np.ndarray:
    """Flag blocks that have fallen by 1, others by 0."""
    # By rotation and not by energy: the floor goes on moving, so that it does not count what
    # the block would do on a floor at rest.
    return (peak >= np.asarray(TOPPLED_ROTATION, peak.dtype)).astype(np.int8)


def lowest_stable_amplitude(dataset: "xarray.Dataset") -> "xarray.DataArray":
    """Find the lowest amplitude of a grid at which steady rocking is stable.

    Parameters
    ----------
    dataset : xarray.Dataset
        A harmonic spectrum with the units of one block, of `add_size`.

    Returns
    -------
    xarray.DataArray
        Amplitude [m/s2] over the increasing frequency, NaN where it is stable at none.
    """
    dataset = expand_scalars(dataset, *_AXES)
    stable = dataset.region == _FLAGS["region"][1].split().index("stable")
    return dataset.amplitude.where(stable).min("amplitude_ratio").sortby("frequency_ratio")


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
        table["rows"] = [
            {"frequency": float(lowest.frequency), "rocks_on_from": float(lowest)}
            for lowest in lowest_stable_amplitude(dataset)
        ]
    return table


def describe_regions(dataset: "xarray.Dataset") -> str:
    """Write what `tabulate_regions` lists, of a few of the frequencies.

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
