"""Spectra of driven motion: rocking spectra of records, overturning spectra of pulses."""

import math
from collections.abc import Callable, Mapping
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from .arguments import NON_NEGATIVE, POSITIVE, UNIT_INTERVAL, Domain, as_real, check
from .batch import BatchResponse, respond_batch
from .block import Block, housner_restitution
from .motion import Motion, Pulse
from .spectra import Values, axis, chunks_of, with_progress

if TYPE_CHECKING:
    import xarray

_CHUNK = 2**14

_AXES: Mapping[str, tuple[str, str, Domain]] = {
    "period": ("period 2 pi / p of the block", "s", POSITIVE),
    "slenderness": ("slenderness, height over width", "1", POSITIVE),
    "restitution": ("coefficient of restitution, ratio of velocities", "1", UNIT_INTERVAL),
    "frequency_ratio": ("frequency of the pulse over p", "1", POSITIVE),
    "amplitude_ratio": ("amplitude of the pulse over what just lifts the block", "1", NON_NEGATIVE),
}

_VARIABLES: Mapping[str, tuple[str, str]] = {
    "rotation_ratio": ("peak rotation over critical angle", "1"),
    "peak_rotation": ("peak rotation", "rad"),
    "overturned": ("1 where the block overturns", "1"),
    "margin": ("margin at the end of the input, overturns below 0", "1"),
    "impacts": ("number of impacts", "1"),
}


def rocking_spectrum(
    motion: Motion,
    period: Values,
    slenderness: Values | None = None,
    restitution: Values | None = None,
    *,
    critical_angle: Values | None = None,
    gravity: float = 9.81,
    linearized: bool = False,
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
    linearized : bool
        Linearize the equation of motion; see `respond`.

    Returns
    -------
    xarray.Dataset
        With dimensions period, slenderness (and restitution) the variables rotation_ratio,
        peak_rotation, overturned, margin and impacts, at the end of the input.

    Raises
    ------
    ValueError
        If an argument is outside of what is allowed.

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

    def run(period: Any, slenderness: Any, restitution: Any = None) -> tuple[Block, BatchResponse]:
        half_diagonal = 0.75 * gravity * (period / (2 * math.pi)) ** 2
        block = Block(half_diagonal / np.sqrt(1 + slenderness**2), slenderness, gravity)
        given = restitution is not None
        c = restitution if given else _housner(block)
        return block, respond_batch(block, c, motion, motion.end, linearized=linearized)

    return _dataset("Rocking spectrum", axes, run, gravity, linearized, motion.name)


def overturning_spectrum(
    shape: type[Pulse],
    frequency_ratio: Values,
    amplitude_ratio: Values,
    *,
    slenderness: float = 5.0,
    restitution: float | None = None,
    linearized: bool = False,
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
    linearized : bool
        Linearize the equation of motion; see `respond`.

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
    if not (isinstance(shape, type) and issubclass(shape, Pulse)):
        raise ValueError(f"shape must be a class of pulses, for example Sine, got {shape!r}")
    axes = {
        "frequency_ratio": _axis("frequency_ratio", frequency_ratio),
        "amplitude_ratio": _axis("amplitude_ratio", amplitude_ratio),
    }
    block = Block(0.2, slenderness)
    c = float(_housner(block)[0]) if restitution is None else restitution
    gravity = float(block.gravity)
    just_lifts = gravity * float(block.critical_angle if linearized else 1 / block.slenderness)
    p = float(block.frequency_parameter)

    def run(frequency_ratio: Any, amplitude_ratio: Any) -> tuple[Block, BatchResponse]:
        pulse = shape(amplitude_ratio * just_lifts, shape.angle / (frequency_ratio * p))
        return block, respond_batch(block, c, pulse, pulse.end, linearized=linearized)

    return _dataset("Overturning spectrum", axes, run, gravity, linearized, shape.name)


def _axis(name: str, value: Values) -> np.ndarray:
    return axis(name, value, _AXES[name][2])


def _housner(block: Block) -> np.ndarray:
    return np.maximum(np.atleast_1d(housner_restitution(block)), 0)


def _dataset(
    title: str,
    axes: Mapping[str, np.ndarray],
    run: Callable[..., tuple[Block, BatchResponse]],
    gravity: float,
    linearized: bool,
    motion: str,
) -> "xarray.Dataset":
    import xarray

    sizes = [values.size for values in axes.values()]
    kinds = {"overturned": np.int8, "impacts": int}
    answers = {name: np.empty(sizes, kinds.get(name, float)) for name in _VARIABLES}
    for part in with_progress(list(chunks_of(sizes, _CHUNK)), title.lower()):
        grid = np.meshgrid(
            *(values[where] for values, where in zip(axes.values(), part, strict=True)),
            indexing="ij",
        )
        block, response = run(*grid)
        if not bool(response.complete.all()):
            raise ValueError("motion could not be followed to its end for every block")
        for name in ("peak_rotation", "overturned", "margin", "impacts"):
            answers[name][part] = getattr(response, name)
        answers["rotation_ratio"][part] = response.peak_rotation / block.critical_angle
    variables = {
        name: (tuple(axes), answers[name], {"long_name": long_name, "units": units})
        for name, (long_name, units) in _VARIABLES.items()
    }
    coordinates = {
        name: (name, values, {"long_name": _AXES[name][0], "units": _AXES[name][1]})
        for name, values in axes.items()
    }
    attributes = {
        "title": title,
        "source": f"jaxrock {version('jaxrock')}",
        "equation": "linearized" if linearized else "nonlinear",
        "motion": motion,
        "gravity": gravity,
        "gravity_units": "m s-2",
    }
    return xarray.Dataset(variables, coordinates, attributes)
