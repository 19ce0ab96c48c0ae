"""Spectra of driven motion: rocking spectra of records, overturning spectra of pulses."""

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..accuracy import EstimatedResponse, respond_within
from ..block import Block, housner_restitution
from ..dynamics import BatchResponse, respond_batch, uplift_acceleration
from ..ground_motion import Motion, Pulse, pulse_class
from ..host import labelled, with_progress
from ..overturning import critical_amplitude
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import NON_NEGATIVE, POSITIVE, UNIT_INTERVAL, Domain, as_real, check
from .closed_form import Values, axis, chunks_of

if TYPE_CHECKING:
    import xarray

_CHUNK = 2**14

ROCKING_AXES: Mapping[str, tuple[str, str, Domain]] = {
    "period": ("period 2 pi / p of the block", "s", POSITIVE),
    "slenderness": ("slenderness, height over width", "1", POSITIVE),
    "restitution": ("coefficient of restitution, ratio of velocities", "1", UNIT_INTERVAL),
    "frequency_ratio": ("frequency of the pulse over p", "1", POSITIVE),
    "amplitude_ratio": ("amplitude of the pulse over what just lifts the block", "1", NON_NEGATIVE),
}

_VARIABLES: dict[str, tuple[str, str]] = {
    "rotation_ratio": ("peak rotation over critical angle", "1"),
    "peak_rotation": ("peak rotation", "rad"),
    "overturned": ("1 where the block overturns", "1"),
    "margin": ("margin at the end of the input, overturns below 0", "1"),
    "impacts": ("number of impacts", "1"),
}

_WITHIN: dict[str, tuple[str, str]] = {
    "order": ("order of the polynomials that this block is computed with", "1"),
    "error": ("what the peak rotation is off by at most, relative", "1"),
    "within_tolerance": ("1 where that is within the tolerance", "1"),
}


def rocking_spectrum(
    motion: Motion,
    period: Values,
    slenderness: Values | None = None,
    restitution: Values | None = None,
    *,
    critical_angle: Values | None = None,
    gravity: float = 9.81,
    model: ModelLike = Nonlinear(),
    tolerance: float | None = None,
) -> "xarray.Dataset":
    """Response of blocks of many sizes and shapes to one ground motion.

    Parameters
    ----------
    motion : Motion
        A pulse or a `Record`, the same for all.
    period : array_like
        2 pi / p of the blocks [s], a number or one-dimensional.
    slenderness, critical_angle : array_like
        lambda [-] or alpha_c [rad] of the blocks: one of the two.
    restitution : array_like, optional
        C [-]; by default Housner's of each block, without a dimension of its own.
    gravity : float
        g [m/s2].
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.
    tolerance : float, optional
        Compute each block at the order that this relative error of the peak rotation needs; see
        `respond_within`. The
        dataset then says in the variables order and error which one that is and how good,
        and in within_tolerance, 0 where the response is so chaotic that no order is good enough.

    Returns
    -------
    xarray.Dataset
        With dimensions period, slenderness (and restitution) the variables rotation_ratio,
        peak_rotation, overturned, margin and impacts, at the end of the input.

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
    check("gravity", as_real("gravity", gravity), POSITIVE)
    if (slenderness is None) == (critical_angle is None):
        raise ValueError("slenderness or critical_angle must be given, one of the two")
    if critical_angle is not None:
        angle = np.asarray(critical_angle, float)
        if not ((angle > 0) & (angle < 0.5 * math.pi)).all():
            raise ValueError("critical_angle must be between 0 and pi / 2")
        slenderness = 1 / np.tan(angle)
    assert slenderness is not None
    axes = {"period": _axis("period", period), "slenderness": _axis("slenderness", slenderness)}
    if restitution is not None:
        axes["restitution"] = _axis("restitution", restitution)

    model = as_model(model)
    respond = _responding(model, tolerance)

    def run(period: Any, slenderness: Any, restitution: Any = None) -> tuple[Block, Any]:
        half_diagonal = 0.75 * gravity * (period / (2 * math.pi)) ** 2
        block = Block(half_diagonal / np.sqrt(1 + slenderness**2), slenderness, gravity)
        given = restitution is not None
        c = restitution if given else _housner(block)
        return block, respond(block, c, motion)

    found = _dataset("Rocking spectrum", axes, run, gravity, model, motion.name)
    return found.assign_attrs(_promise(tolerance))


def overturning_spectrum(
    shape: type[Pulse],
    frequency_ratio: Values,
    amplitude_ratio: Values,
    *,
    slenderness: float = 5.0,
    restitution: float | None = None,
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
    slenderness : float
        lambda [-].
    restitution : float, optional
        C [-]; Housner's by default.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.
    tolerance : float, optional
        As in `rocking_spectrum`.

    Returns
    -------
    xarray.Dataset
        With dimensions frequency_ratio and amplitude_ratio the variables of
        `rocking_spectrum`; the same for every size of block.

    Raises
    ------
    ValueError
        If an argument is outside of what is allowed.
    """
    axes = {
        "frequency_ratio": _axis("frequency_ratio", frequency_ratio),
        "amplitude_ratio": _axis("amplitude_ratio", amplitude_ratio),
    }
    model = as_model(model)
    block, c, just_lifts = _normal_block(slenderness, restitution, model)
    p, of = float(block.frequency_parameter), pulse_class(shape)

    respond = _responding(model, tolerance)

    def run(frequency_ratio: Any, amplitude_ratio: Any) -> tuple[Block, Any]:
        pulse = of(amplitude_ratio * just_lifts, of.angle / (frequency_ratio * p))
        return block, respond(block, c, pulse)

    gravity = float(block.gravity)
    found = _dataset("Overturning spectrum", axes, run, gravity, model, of.name)
    return found.assign_attrs(_promise(tolerance))


def overturning_map(
    shape: type[Pulse],
    frequency_ratio: Values,
    amplitude_ratios: Sequence[float] = (1.0, 10.0),
    *,
    slenderness: float = 5.0,
    restitution: float | None = None,
    resolution: float = 0.01,
    model: ModelLike = Nonlinear(),
) -> "xarray.Dataset":
    """Every boundary between standing and overturning, in the plane of the literature.

    Parameters
    ----------
    shape : type
        `Rectangular`, `HalfSine`, `Sine`, `Cosine` or `Ricker`.
    frequency_ratio : array_like
        omega_p / p [-], a number or one-dimensional; see `Pulse.frequency`.
    amplitude_ratios : sequence of two floats
        The range of a_p / (g tan(alpha_c)), linearized a_p / (g alpha_c) [-].
    slenderness : float
        lambda [-].
    restitution : float, optional
        C [-]; Housner's by default.
    resolution : float
        Windows wider than this share of their amplitude are found; see `critical_amplitude`.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.

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
    model = as_model(model)
    ratios = _axis("frequency_ratio", frequency_ratio)
    block, c, just_lifts = _normal_block(slenderness, restitution, model)
    title, parts = "Overturning map", []
    for (part,) in with_progress(list(chunks_of([ratios.size], 256)), title.lower()):
        duration = pulse_class(shape).angle / (ratios[part] * float(block.frequency_parameter))
        found = critical_amplitude(
            block,
            c,
            shape,
            duration,
            amplitude_ratios,
            resolution=resolution,
            model=model,
        )
        if not bool(found.complete.all()):
            raise ValueError("motion could not be followed to its end for every pulse")
        parts.append(found)
    most = max(found.value.shape[-1] for found in parts)

    def joined(name: str, missing: Any) -> np.ndarray:
        columns = [np.asarray(getattr(found, name)) for found in parts]
        return np.concatenate(
            [np.pad(c, ((0, 0), (0, most - c.shape[1])), constant_values=missing) for c in columns]
        )

    both = ("frequency_ratio", "boundary")
    first = np.concatenate([np.asarray(found.overturns_first) for found in parts])
    long_name, units, _ = ROCKING_AXES["amplitude_ratio"]
    variables = {
        "amplitude_ratio": (
            both,
            joined("value", np.nan) / just_lifts,
            {"long_name": long_name, "units": units},
        ),
        "overturns_beyond": (
            both,
            joined("overturns_beyond", 0).astype(np.int8),
            {"long_name": "1 where the block overturns beyond the boundary", "units": "1"},
        ),
        "impacts": (
            both,
            joined("impacts", -1),
            {"long_name": "impacts before it overturns, -1 for none", "units": "1"},
        ),
        "overturns_first": (
            "frequency_ratio",
            first.astype(np.int8),
            {"long_name": "1 where it overturns at the lowest amplitude", "units": "1"},
        ),
    }
    long_name, units, _ = ROCKING_AXES["frequency_ratio"]
    attributes = {
        "model": model.name,
        "motion": shape.name,
        "slenderness": slenderness,
        "restitution": c,
        "lowest_amplitude_ratio": float(amplitude_ratios[0]),
        "highest_amplitude_ratio": float(amplitude_ratios[1]),
        "resolution": resolution,
    }
    coordinates = {
        "frequency_ratio": ("frequency_ratio", ratios, {"long_name": long_name, "units": units})
    }
    return labelled(title, variables, coordinates, attributes)


def _normal_block(
    slenderness: float, restitution: float | None, model: RockingModel
) -> tuple[Block, float, float]:
    """A block of any size, its restitution, and the acceleration that just lifts it."""
    block = Block(0.2, slenderness)
    c = float(_housner(block)[0]) if restitution is None else restitution
    return block, c, float(uplift_acceleration(block, model))


def _responding(
    model: RockingModel, tolerance: float | None
) -> Callable[..., BatchResponse | EstimatedResponse]:
    if tolerance is None:
        return functools.partial(respond_batch, model=model)
    check("tolerance", as_real("tolerance", tolerance), POSITIVE)
    return functools.partial(respond_within, tolerance=tolerance, model=model)


def _promise(tolerance: float | None) -> dict[str, float]:
    return {} if tolerance is None else {"tolerance": tolerance}


def _axis(name: str, value: Values) -> np.ndarray:
    return axis(name, value, ROCKING_AXES[name][2])


def _housner(block: Block) -> np.ndarray:
    return np.maximum(np.atleast_1d(housner_restitution(block)), 0)


def _dataset(
    title: str,
    axes: Mapping[str, np.ndarray],
    run: Callable[..., tuple[Block, BatchResponse | EstimatedResponse]],
    gravity: float,
    model: RockingModel,
    motion: str,
) -> "xarray.Dataset":
    sizes = [values.size for values in axes.values()]
    kinds = {"overturned": np.int8, "impacts": int, "order": np.int8, "within_tolerance": np.int8}
    extra: dict[str, np.ndarray] = {}
    answers = {name: np.empty(sizes, kinds.get(name, float)) for name in _VARIABLES}
    for part in with_progress(list(chunks_of(sizes, _CHUNK)), title.lower()):
        grid = np.meshgrid(
            *(values[where] for values, where in zip(axes.values(), part, strict=True)),
            indexing="ij",
        )
        block, response = run(*grid)
        if isinstance(response, EstimatedResponse):
            for name in _WITHIN:
                whole = extra.setdefault(name, np.empty(sizes, kinds.get(name, float)))
                whole[part] = getattr(response, name)
            response = response.response
        if not bool(response.complete.all()):
            raise ValueError("motion could not be followed to its end for every block")
        for name in ("peak_rotation", "overturned", "margin", "impacts"):
            answers[name][part] = getattr(response, name)
        answers["rotation_ratio"][part] = response.peak_rotation / block.critical_angle
    variables = {
        name: (tuple(axes), (answers | extra)[name], {"long_name": long_name, "units": units})
        for name, (long_name, units) in (_VARIABLES | _WITHIN if extra else _VARIABLES).items()
    }
    coordinates = {
        name: (name, values, {"long_name": ROCKING_AXES[name][0], "units": ROCKING_AXES[name][1]})
        for name, values in axes.items()
    }
    attributes = {
        "model": model.name,
        "motion": motion,
        "gravity": gravity,
        "gravity_units": "m s-2",
    }
    return labelled(title, variables, coordinates, attributes)
