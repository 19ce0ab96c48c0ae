"""Spectra of driven motion: rocking spectra of records, overturning spectra of pulses."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..accuracy import respond_within
from ..block import RECTANGLE_INERTIA_RATIO, Block
from ..dynamics import respond_batch, uplift_acceleration
from ..ground_motion import Motion, Pulse, Suite, pulse_class
from ..host import along_records, labelled
from ..impact import housner_restitution
from ..overturning import critical_amplitude
from ..resonance import ModelLike, Nonlinear, as_model
from ..validation import AT_LEAST_ONE, POSITIVE, as_real, check
from .grid import Values, axis, filled, label

if TYPE_CHECKING:
    import xarray

_CHUNK = 2**14  # blocks of a spectrum that are followed at once

# Type, long name and unit.
_VARIABLES: dict[str, tuple[Any, str, str]] = {
    "rotation_ratio": (float, "peak rotation over critical angle", "1"),
    "peak_rotation": (float, "peak rotation", "rad"),
    "overturned": (np.int8, "1 where the block overturns", "1"),
    "margin": (float, "margin at the end of the input, overturns below 0", "1"),
    "impacts": (int, "number of impacts", "1"),
}
_ESTIMATES: dict[str, tuple[Any, str, str]] = {
    "rtol": (float, "tolerance that this block is computed with", "1"),
    "error": (float, "upper bound of the relative error of the peak rotation", "1"),
    "within_tolerance": (np.int8, "1 where that is within the tolerance", "1"),
}
_BOUNDARIES = {  # long names
    "overturns_beyond": "1 where the block overturns beyond the boundary",
    "impacts": "impacts before it overturns, -1 for none",
    "overturns_first": "1 where it overturns at the lowest amplitude",
}


def rocking_spectrum(
    motion: Motion | Suite,
    period: Values,
    slenderness: Values | None = None,
    restitution: Values | None = None,
    *,
    critical_angle: Values | None = None,
    gravity: float = 9.81,
    inertia_ratio: float = RECTANGLE_INERTIA_RATIO,
    model: ModelLike = Nonlinear(),
    tolerance: float | None = None,
) -> "xarray.Dataset":
    """Response of blocks of many sizes and shapes to one ground motion, or to several.

    Parameters
    ----------
    motion : Motion or Suite
        A pulse, a `Harmonic` or a `Record`, the same for all; or a `Suite`, each record of which
        all meet.
    period : array_like
        2 pi / p of the blocks [s], a number or one-dimensional.
    slenderness, critical_angle : array_like
        lambda [-] or alpha_c [rad] of the blocks: one of the two.
    restitution : array_like, optional
        C [-]; by default Housner's of each block, without a dimension of its own.
    gravity, inertia_ratio : float
        g [m/s2] and kappa [-] of all blocks; see `Block`.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.
    tolerance : float, optional
        Compute each block to this relative error of the peak rotation; see `respond_within`. The
        dataset then has the variables rtol, error and within_tolerance, 0 where the response is
        so chaotic that no tolerance is good enough.

    Returns
    -------
    xarray.Dataset
        With dimensions (record,) period, slenderness (and restitution) the variables
        rotation_ratio, peak_rotation, overturned, margin and impacts, at the end of the input.

    Raises
    ------
    ValueError
        If an argument is out of range, or a motion could not be followed.

    Examples
    --------
    >>> import jaxrock as jr
    >>> spectrum = jr.rocking_spectrum(jr.Sine(4.0, 0.5), [2.0, 4.0], slenderness=5.0)
    >>> print(spectrum.overturned.values.ravel())
    [1 0]
    """
    if isinstance(motion, Suite):
        return along_records(
            [
                rocking_spectrum(
                    record,
                    period,
                    slenderness,
                    restitution,
                    critical_angle=critical_angle,
                    gravity=gravity,
                    inertia_ratio=inertia_ratio,
                    model=model,
                    tolerance=tolerance,
                )
                for record in motion.bucketed()
            ],
            motion.names,
        )
    check("gravity", as_real("gravity", gravity), POSITIVE)
    check("inertia_ratio", as_real("inertia_ratio", inertia_ratio), AT_LEAST_ONE)
    if (slenderness is None) == (critical_angle is None):
        raise ValueError("slenderness or critical_angle must be given, one of the two")
    if critical_angle is not None:
        angle = np.asarray(critical_angle, float)
        if not ((angle > 0) & (angle < 0.5 * math.pi)).all():
            raise ValueError("critical_angle must be between 0 and pi / 2")
        slenderness = 1 / np.tan(angle)
    values = {"period": period, "slenderness": slenderness, "restitution": restitution}
    axes = {name: axis(name, given) for name, given in values.items() if given is not None}

    def problem(period: Any, slenderness: Any, restitution: Any = None) -> tuple[Any, ...]:
        half_diagonal = 1 / inertia_ratio * gravity * (period / (2 * math.pi)) ** 2
        half_width = half_diagonal / np.sqrt(1 + slenderness**2)
        block = Block(half_width, slenderness, gravity, inertia_ratio)
        return block, _restitution(block) if restitution is None else restitution, motion

    about = {"motion": motion.name, "gravity": gravity, "inertia_ratio": inertia_ratio}
    return _spectrum("Rocking spectrum", axes, problem, model, tolerance, about)


def overturning_spectrum(
    shape: type[Pulse],
    frequency_ratio: Values,
    amplitude_ratio: Values,
    *,
    slenderness: float = 5.0,
    restitution: float | None = None,
    inertia_ratio: float = RECTANGLE_INERTIA_RATIO,
    model: ModelLike = Nonlinear(),
    tolerance: float | None = None,
) -> "xarray.Dataset":
    """Which pulses of one shape overturn a block, in the plane of the literature.

    Parameters
    ----------
    shape : type
        `Rectangular`, `HalfSine`, `Sine`, `Cosine` or `Ricker`.
    frequency_ratio : array_like
        omega_p / p [-], a number or one-dimensional; see `Pulse.frequency`.
    amplitude_ratio : array_like
        a_p / (g tan(alpha_c)), linearized a_p / (g alpha_c) [-]: lifts from 1 on.
    slenderness, restitution, inertia_ratio : float
        lambda [-], C [-], Housner's by default, and kappa [-], on which only that depends.
    model, tolerance
        As in `rocking_spectrum`.

    Returns
    -------
    xarray.Dataset
        With dimensions frequency_ratio and amplitude_ratio the variables of
        `rocking_spectrum`; the same for every size of block.

    Raises
    ------
    ValueError
        If an argument is out of range, or a motion could not be followed.
    """
    given = {"frequency_ratio": frequency_ratio, "amplitude_ratio": amplitude_ratio}
    axes = {name: axis(name, values) for name, values in given.items()}
    kind = pulse_class(shape)
    block, c, uplift = _unit_block(slenderness, restitution, inertia_ratio, model)
    p = float(block.frequency_parameter)

    def problem(frequency_ratio: Any, amplitude_ratio: Any) -> tuple[Any, ...]:
        return block, c, kind(amplitude_ratio * uplift, kind.angle / (frequency_ratio * p))

    about = {"motion": kind.name, "gravity": float(block.gravity), "inertia_ratio": inertia_ratio}
    return _spectrum("Overturning spectrum", axes, problem, model, tolerance, about)


def overturning_map(
    shape: type[Pulse],
    frequency_ratio: Values,
    amplitude_ratios: Sequence[float] = (1.0, 10.0),
    *,
    slenderness: float = 5.0,
    restitution: float | None = None,
    inertia_ratio: float = RECTANGLE_INERTIA_RATIO,
    resolution: float = 0.01,
    model: ModelLike = Nonlinear(),
) -> "xarray.Dataset":
    """Every boundary between standing and overturning, in the plane of the literature.

    Parameters
    ----------
    shape, frequency_ratio, slenderness, restitution, inertia_ratio, model
        As in `overturning_spectrum`.
    amplitude_ratios : sequence of two floats
        The range of a_p / (g tan(alpha_c)), linearized a_p / (g alpha_c) [-].
    resolution : float
        Windows wider than this share of their amplitude are found; see `critical_amplitude`.

    Returns
    -------
    xarray.Dataset
        With dimensions frequency_ratio and boundary the variables amplitude_ratio (NaN where
        there are fewer boundaries), overturns_beyond and impacts, and along frequency_ratio
        alone overturns_first; see `Boundaries`. The same for every size of block.

    Raises
    ------
    ValueError
        If an argument is outside of what is allowed.
    """
    model, ratios = as_model(model), axis("frequency_ratio", frequency_ratio)
    block, c, uplift = _unit_block(slenderness, restitution, inertia_ratio, model)
    durations = pulse_class(shape).angle / (ratios * float(block.frequency_parameter))
    found = critical_amplitude(
        block, c, shape, durations, amplitude_ratios, resolution=resolution, model=model
    )
    if not bool(found.complete.all()):
        raise ValueError("motion could not be followed to its end for every pulse")
    dims = ("frequency_ratio", "boundary")
    ratio = (dims, np.asarray(found.value) / uplift, label("amplitude_ratio"))
    variables: dict[str, Any] = {"amplitude_ratio": ratio}
    for name, long_name in _BOUNDARIES.items():
        values = np.asarray(getattr(found, name))
        values = values.astype(np.int8) if values.dtype == bool else values
        variables[name] = (dims[: values.ndim], values, {"long_name": long_name, "units": "1"})
    attributes = {
        "model": model.name,
        "motion": shape.name,
        "slenderness": slenderness,
        "restitution": c,
        "inertia_ratio": inertia_ratio,
        "lowest_amplitude_ratio": float(amplitude_ratios[0]),
        "highest_amplitude_ratio": float(amplitude_ratios[1]),
        "resolution": resolution,
    }
    coordinates = {"frequency_ratio": (dims[:1], ratios, label("frequency_ratio"))}
    return labelled("Overturning map", variables, coordinates, attributes)


def _unit_block(
    slenderness: float, restitution: float | None, inertia_ratio: float, model: ModelLike
) -> tuple[Block, float, float]:
    """A block of any size, its restitution, and the acceleration that just lifts it."""
    block = Block(0.2, slenderness, inertia_ratio=inertia_ratio)
    c = float(_restitution(block)) if restitution is None else restitution
    return block, c, float(uplift_acceleration(block, as_model(model)))


def _restitution(block: Block) -> Any:
    return np.maximum(housner_restitution(block), 0)


def _spectrum(
    title: str,
    axes: Mapping[str, np.ndarray],
    problem: Callable[..., tuple[Any, ...]],
    model: ModelLike,
    tolerance: float | None,
    about: Mapping[str, Any],
) -> "xarray.Dataset":
    """Responses over a grid, where `problem` says of which blocks to which motions."""
    model, table = as_model(model), _VARIABLES
    attributes = {"model": model.name, **about, "gravity_units": "m s-2"}
    if tolerance is not None:
        check("tolerance", as_real("tolerance", tolerance), POSITIVE)
        attributes["tolerance"] = tolerance
        table = _VARIABLES | _ESTIMATES

    def compute(*parts: np.ndarray) -> dict[str, Any]:
        blocks, c, motions = problem(*np.meshgrid(*parts, indexing="ij"))
        if tolerance is None:
            response = estimate = respond_batch(blocks, c, motions, model=model)
        else:
            estimate = respond_within(blocks, c, motions, tolerance, model=model)
            response = estimate.response
        if not bool(response.complete.all()):
            raise ValueError("motion could not be followed to its end for every block")
        ratio = response.peak_rotation / blocks.critical_angle
        return {"rotation_ratio": ratio, **vars(estimate), **vars(response)}

    variables = {
        name: (tuple(axes), dtype, {"long_name": long_name, "units": units})
        for name, (dtype, long_name, units) in table.items()
    }
    return filled(title, axes, variables, attributes, compute, _CHUNK)
