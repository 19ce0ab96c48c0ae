"""Floors of a building: linear oscillators that the ground accelerates, and their motion."""

import math
import warnings
from typing import Any, NamedTuple, TypeVar, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..host import Printed, format_number
from ..validation import (
    FINITE,
    NON_NEGATIVE,
    POSITIVE,
    AnyArray,
    Checked,
    Domain,
    Number,
    Numbers,
    Reals,
    as_array,
    as_field,
    as_real,
    check,
    choose_namespace,
    is_traced,
    quantity,
    replace_invalid,
    unify_precision,
)
from .oscillator_response import compute_absolute_accelerations
from .samples import refuse_empty

_Record = TypeVar("_Record", bound=Checked)

# Damping far beyond the critical one is no building, but likely a number of per cent.
_DAMPING = Domain(
    "between 0 and 1.5, a ratio, not in per cent",
    lambda ratio: (ratio >= 0) & (ratio <= 1.5),
    0.05,
)
# The free vibration is over where the floor stays below this part of its peak.
_NEGLIGIBLE = 1e-3
# Part of the peak that straight lines between samples may miss without a warning.
_MISSED = 0.03
FLOOR_DAMPING = 0.05  # of a floor of which it is not given
# No floor of a building swings more slowly: a longer period was given in another unit.
FLOOR_PERIOD = Domain("from 0 to 20, in s", lambda x: (x >= 0) & (x <= 20), 0.5)
# Samples of a floor in a period, where nobody gives a time step: lines miss 0.5 % of it.
_SAMPLES_OF_PERIOD = 30
# A time step that is given may be rounded.
_ROUNDING = 1e-6


class Floor(Printed, Checked):
    """Linear oscillators whose absolute accelerations make up the motion of a floor.

    Parameters
    ----------
    period, damping, participation, time_step, free_vibration
        As in `Record.on_floor`.

    Raises
    ------
    ValueError
        If a value is out of range, or shapes do not broadcast.

    Examples
    --------
    >>> import jaxrock as jr
    >>> print(jr.ground_motion.Floor(0.4, 0.03))
    floor of period 0.4 s, damping 0.03
    """

    period: Reals = quantity(POSITIVE, "s")
    damping: Reals = quantity(_DAMPING, "")
    participation: Reals = quantity(FINITE, "")
    time_step: float | None = eqx.field(static=True, default=None)
    free_vibration: float | None = eqx.field(static=True, default=None)

    def __init__(
        self,
        period: Numbers = 0.5,
        damping: Numbers = FLOOR_DAMPING,
        participation: Numbers = 1.0,
        *,
        time_step: Number | None = None,
        free_vibration: Number | None = None,
    ):
        self.period = as_field(Floor, "period", period)
        self.damping = as_field(Floor, "damping", damping)
        self.participation = as_field(Floor, "participation", participation)
        refuse_empty(**vars(self))
        self.time_step = _read_time("time_step", time_step, POSITIVE)
        self.free_vibration = _read_time("free_vibration", free_vibration, NON_NEGATIVE)

    def __str__(self) -> str:
        words = [
            f"period {format_number(self.period, 's')}",
            f"damping {format_number(self.damping)}",
        ]
        if self.participation.ndim or is_traced(self.participation) or self.participation != 1:
            words.append(f"participation {format_number(self.participation)}")
        return f"floor of {', '.join(words)}"

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the floors, without the axis of the modes."""
        shapes = [value.shape for value in (self.period, self.damping, self.participation)]
        shape = np.broadcast_shapes(*shapes)
        return shape[:-1] if self.participation.ndim else shape


def choose_floor_step(period: float) -> float:
    """Choose a time step [s] that is fine enough for a floor of a period [s]."""
    return period / _SAMPLES_OF_PERIOD


def _read_time(name: str, value: Number | None, domain: Domain) -> float | None:
    """Read a time [s] on which the number of samples depends; None if it is not given."""
    if value is None:
        return None
    if is_traced(value) or np.ndim(value):
        kind = "a tracer" if is_traced(value) else f"an array of shape {np.shape(value)}"
        raise ValueError(
            f"{name} must be one concrete number, since it decides the number of samples,"
            f" got {kind}"
        )
    as_real(name, value, unit="s")  # raises for anything but a number
    # No array of JAX: within a transformation it would be traced.
    time = float(cast("Any", value))
    check(name, time, domain)
    return time


def require_finer_step(floor: Floor, time_step: Reals) -> None:
    """Raise `ValueError` if a floor has a time step that is longer than one [s] of a record."""
    if floor.time_step is None or is_traced(time_step):
        return
    step = float(np.max(np.asarray(time_step)))
    if floor.time_step > step * (1 + _ROUNDING):
        raise ValueError(
            f"time_step must be at most the step of the record, {step:g} s, got"
            f" {floor.time_step:g} s"
        )


def multiply_floor(floor: Floor, period_factor: Numbers, damping_factor: Numbers) -> Floor:
    """Multiply the periods and dampings of all modes; one floor for each factor."""
    factors = [np.asarray(factor) for factor in (period_factor, damping_factor)]
    if floor.participation.ndim:
        factors = [factor[..., None] for factor in factors]
    return Floor(
        np.asarray(floor.period) * factors[0],
        np.asarray(floor.damping) * factors[1],
        floor.participation,
        time_step=floor.time_step,
        free_vibration=floor.free_vibration,
    )


class FloorMotion(NamedTuple):
    """Motion of a floor under a record.

    Attributes
    ----------
    acceleration : Array, shape (..., samples)
    vertical : Array, shape (..., samples), or None
    time_step : Array
        [s]
    missed : float
        Part of the peak that straight lines between the samples miss; 0 if traced.
    sufficient_step : float
        Time step [s] with which the lines would miss the part `_MISSED` of the peak.
    """

    acceleration: AnyArray
    vertical: AnyArray | None
    time_step: AnyArray
    missed: float
    sufficient_step: float


def compute_floor_motion(
    acceleration: Reals, vertical: Reals | None, time_step: Reals, floor: Floor
) -> FloorMotion:
    """Compute the motion of a floor under the samples of a record; see `Record.on_floor`."""
    numbers = (acceleration, vertical, time_step, floor)
    # The precision that JAX promotes all to together.
    unified = unify_precision(numbers)
    if not is_traced(numbers):
        # In float64, and rounded once.
        dtype = unified[0].dtype
        host = jax.tree.map(lambda leaf: np.asarray(leaf, float), numbers)
        components, missed = _filter_samples(*host)
        motion, upward, step = jax.tree.map(
            lambda leaf: as_array(np.asarray(leaf, dtype)), components
        )
        return FloorMotion(motion, upward, step, *missed)
    guarded, valid = replace_invalid(unified[3])
    (motion, upward, step), missed = _filter_samples(*unified[:3], guarded)
    if not isinstance(valid, bool):
        of_floors = valid.all(axis=-1) if floor.participation.ndim else valid
        motion = jnp.where(of_floors[..., None], motion, jnp.nan)
    return FloorMotion(motion, upward, step, *missed)


_Components = tuple[AnyArray, AnyArray | None, AnyArray]


def _filter_samples(
    acceleration: AnyArray, vertical: AnyArray | None, time_step: AnyArray, floor: Floor
) -> tuple[_Components, tuple[float, float]]:
    """Filter samples; both components and the time step, and what lines between them miss."""
    modes: list[AnyArray] = [floor.period, floor.damping, floor.participation]
    if not floor.participation.ndim:
        # One mode; other axes are floors.
        modes = [value[..., None] for value in modes]
    division = _choose_division(time_step, floor.time_step)
    acceleration = _interpolate_samples(acceleration, division)
    library = choose_namespace((acceleration, time_step, modes))
    time_step = library.asarray(time_step / division)
    last = acceleration.shape[-1] - 1
    extension = _choose_extension(last, time_step, floor.free_vibration)
    # All of one rank: the leading axes, then the modes, then the samples.
    steps = time_step[..., None]
    shapes = [value.shape for value in (acceleration[..., :1], steps, *modes)]
    shape = np.broadcast_shapes(*shapes)
    steps, period, damping, participation = (
        library.broadcast_to(value, shape) for value in (steps, *modes)
    )
    x = 2 * math.pi * steps / period
    missing = [1] * (len(shape) - acceleration.ndim)
    ground = acceleration.reshape(*missing, *acceleration.shape[:-1], 1, last + 1)
    of_modes = compute_absolute_accelerations(ground, x, damping, extension)
    ground = _extend(ground, extension)
    without_modes = (1 - participation.sum(axis=-1))[..., None]
    motion = without_modes * ground[..., 0, :]
    motion = motion + (participation[..., None] * of_modes).sum(axis=-2)
    missed = (0.0, math.inf)
    if isinstance(motion, np.ndarray):
        if floor.free_vibration is None:
            motion = motion[..., : _find_end(motion, last)]
        relative = participation[..., None] * (of_modes - ground)
        missed = _estimate_missed(relative, motion, x, steps)
    if vertical is not None:
        vertical = _interpolate_samples(vertical, division)
        vertical = _extend(vertical, motion.shape[-1] - last - 1)
    return (motion, vertical, time_step), missed


def _extend(samples: AnyArray, extension: int) -> AnyArray:
    """Add zeros behind the last sample."""
    padding = [(0, 0)] * (samples.ndim - 1) + [(0, extension)]
    return choose_namespace(samples).pad(samples, padding)


def _choose_division(time_step: AnyArray, longest: float | None) -> int:
    """Choose into how many parts a step is divided, so that none is longer than asked for."""
    if longest is None:
        return 1
    if is_traced(time_step):
        raise ValueError(
            "time_step can only be given if the step of the record is concrete, since the"
            f" number of samples depends on both, got {longest:g} s"
        )
    step = float(time_step.max())
    return max(1, math.ceil(step / longest * (1 - _ROUNDING)))


def _choose_extension(last: int, time_step: AnyArray, duration: float | None) -> int:
    """Choose how many samples are added, of a duration or as many as there are steps."""
    if duration is None:
        return last
    if duration == 0:
        return 0
    if is_traced(time_step):
        raise ValueError(
            "free_vibration can only be given where the time step of the record is concrete,"
            f" since the number of samples depends on both, got {duration:g} s"
        )
    return math.ceil(duration / float(time_step.min()) * (1 - _ROUNDING))


def _interpolate_samples(samples: AnyArray, division: int) -> AnyArray:
    """Add samples on the straight lines between samples."""
    if division == 1:
        return samples
    library = choose_namespace(samples)
    along = np.arange(division, dtype=samples.dtype) / division
    along = along.reshape(*[1] * samples.ndim, division)
    before = samples[..., :-1, None]
    lines = before + along * (samples[..., 1:, None] - before)
    lines = lines.reshape(*samples.shape[:-1], -1)
    return library.concatenate([lines, samples[..., -1:]], axis=-1)


def _find_end(motion: np.ndarray, last: int) -> int:
    """Find the number of samples until all floors stay below a small part of their peaks."""
    size = abs(motion)
    moves = size > _NEGLIGIBLE * size.max(axis=-1, keepdims=True)
    (places,) = np.nonzero(moves.reshape(-1, motion.shape[-1]).any(axis=0))
    # With the first sample that is below it.
    return max(last, int(places[-1]) + 1 if places.size else 0) + 1


def _estimate_missed(
    relative: AnyArray, motion: AnyArray, x: AnyArray, steps: AnyArray
) -> tuple[float, float]:
    """Estimate which part of the peak straight lines between samples miss.

    Returns as well the time step [s] with which it would be as much as is tolerated.
    """
    # The lines miss x^2 / 8 of the amplitude of an oscillation, and not more than all of it.
    # The ground is linear between samples: only the motion of a mode relative to it is missed.
    amplitude = abs(relative).max(axis=-1)
    peak = abs(motion).max(axis=-1)[..., None]
    part = amplitude / np.where(peak > 0, peak, np.inf)
    missed = np.minimum(x**2 / 8, 1) * part
    worst = int(np.argmax(missed))
    with np.errstate(divide="ignore"):
        sufficient = steps / x * np.sqrt(8 * _MISSED / part)
    return float(np.ravel(missed)[worst]), float(np.ravel(sufficient)[worst])


def replace_motion(record: _Record, motion: FloorMotion) -> _Record:
    """Replace both components of a record and the time step by those of a floor."""
    # By `tree_at`, which checks nothing: rows of samples of floors are no table. A vertical
    # component of None is no leaf, but stays what it is.
    return eqx.tree_at(
        lambda record: (record.acceleration, record.vertical, record.time_step),
        record,
        (motion.acceleration, motion.vertical, motion.time_step),
        is_leaf=lambda leaf: leaf is None,
    )


def warn_of_coarse_step(motion: FloorMotion, name: str = "") -> None:
    """Warn where straight lines between samples miss much of the motion of a floor."""
    if motion.missed <= _MISSED:
        return
    # Rounded down to two digits.
    unit = 10.0 ** (math.floor(math.log10(motion.sufficient_step)) - 1)
    step = math.floor(motion.sufficient_step / unit * (1 + _ROUNDING)) * unit
    record = f" under record {name!r}" if name else ""
    apart = float(np.max(np.asarray(motion.time_step)))
    warnings.warn(
        f"straight lines between samples {apart:g} s apart miss up to"
        f" {100 * motion.missed:.2g} % of the peak of the floor{record};"
        f" time_step={step:.2g} would do",
        stacklevel=4,  # past the method, and what Equinox calls it by
    )
