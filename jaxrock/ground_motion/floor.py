"""Floors of a building: linear oscillators that the ground accelerates, and their motion."""

import math
from typing import Any, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..host import Printed, format_number
from ..validation import (
    BELOW_ONE,
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
    check_concrete,
    choose_namespace,
    is_traced,
    quantity,
    replace_invalid,
    unify_precision,
)
from .oscillator_response import compute_absolute_accelerations

# The free vibration is over where the floor stays below this part of its peak.
_NEGLIGIBLE = 1e-3
FLOOR_DAMPING = 0.05  # default damping of a floor
# No floor of a building swings more slowly: a longer period is probably in another unit.
FLOOR_PERIOD = Domain("from 0 to 20, in s", lambda x: (x >= 0) & (x <= 20), 0.5)
# Default number of samples in a period of a floor: straight lines between them miss 0.5 %.
_SAMPLES_OF_PERIOD = 30
# Relative rounding of a time step that is given.
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
    damping: Reals = quantity(BELOW_ONE, "")
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
        self.time_step = _read_time("time_step", time_step, POSITIVE)
        self.free_vibration = _read_time("free_vibration", free_vibration, NON_NEGATIVE)

    def __str__(self) -> str:
        descriptions = [
            f"period {format_number(self.period, 's')}",
            f"damping {format_number(self.damping)}",
        ]
        if self.participation.ndim or is_traced(self.participation) or self.participation != 1:
            descriptions.append(f"participation {format_number(self.participation)}")
        return f"floor of {', '.join(descriptions)}"

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the floors, without the axis of the modes."""
        shape = np.broadcast_shapes(
            self.period.shape, self.damping.shape, self.participation.shape
        )
        return shape[:-1] if self.participation.ndim else shape


def _read_time(name: str, value: Number | None, domain: Domain) -> float | None:
    """Read a time [s] on which the number of samples depends; None if it is not given."""
    if value is None:
        return None
    check_concrete(value, f"{name} decides the number of samples")
    check(name, as_real(name, value, unit="s"), domain)
    # A float and no JAX array, which would be traced within a transformation.
    return float(cast("Any", value))


def choose_floor_step(period: float) -> float:
    """Choose a time step [s] that is fine enough for a floor of a period [s]."""
    return period / _SAMPLES_OF_PERIOD


# Both components of an acceleration and the time step.
Components = tuple[AnyArray, AnyArray | None, AnyArray]


def compute_floor_motion(components: Components, floor: Floor) -> Components:
    """Compute the motion of a floor under the samples of a record; see `Record.on_floor`."""
    numbers = (components, floor)
    # The common precision by the rules of JAX.
    unified = unify_precision(numbers)
    if not is_traced(numbers):
        # Computed in float64, and rounded once.
        dtype = unified[0][0].dtype
        motion = _filter_samples(*jax.tree.map(lambda leaf: np.asarray(leaf, float), numbers))
        return jax.tree.map(lambda leaf: as_array(np.asarray(leaf, dtype)), motion)
    guarded, valid = replace_invalid(unified[1])
    motion, upward, step = _filter_samples(unified[0], guarded)
    if not isinstance(valid, bool):
        valid_floors = valid.all(axis=-1) if floor.participation.ndim else valid
        motion = jnp.where(valid_floors[..., None], motion, jnp.nan)
    return motion, upward, step


def _filter_samples(components: Components, floor: Floor) -> Components:
    """Compute the motion of a floor, or of floors along the leading axes, in one precision."""
    acceleration, vertical, time_step = components
    if floor.time_step is not None or floor.free_vibration is not None:
        check_concrete(time_step, "the number of samples of a floor depends on the time step")
    if floor.time_step is not None:
        longest = float(np.max(time_step))
        division = max(1, math.ceil(longest / floor.time_step * (1 - _ROUNDING)))
        acceleration = _interpolate_samples(acceleration, division)
        vertical = None if vertical is None else _interpolate_samples(vertical, division)
        time_step = choose_namespace(time_step).asarray(time_step / division)
    last = acceleration.shape[-1] - 1
    extension = last
    if floor.free_vibration is not None:
        shortest = float(np.min(time_step))
        extension = math.ceil(floor.free_vibration / shortest * (1 - _ROUNDING))

    library = choose_namespace((acceleration, time_step, floor))
    modes: list[AnyArray] = [floor.period, floor.damping, floor.participation]
    if not floor.participation.ndim:
        # One mode; other axes are floors.
        modes = [value[..., None] for value in modes]
    # All arrays get one rank: the leading axes, then the modes or the samples.
    numbers = (time_step[..., None], *modes)
    shape = np.broadcast_shapes(acceleration[..., :1].shape, *(a.shape for a in numbers))
    steps, period, damping, participation = (
        library.broadcast_to(value, shape) for value in numbers
    )
    ground = acceleration.reshape(*[1] * (len(shape) - acceleration.ndim), *acceleration.shape)
    motion = compute_absolute_accelerations(
        ground, 2 * math.pi * steps / period, damping, participation, last + extension
    )
    without_modes = 1 - participation.sum(axis=-1, keepdims=True)
    motion = motion + without_modes * _extend(ground, extension)
    if floor.free_vibration is None and isinstance(motion, np.ndarray):
        motion = motion[..., : _find_end(motion, last)]
    if vertical is not None:
        vertical = _extend(vertical, motion.shape[-1] - last - 1)
    return motion, vertical, time_step


def _extend(samples: AnyArray, extension: int) -> AnyArray:
    """Add zeros behind the last sample."""
    padding = [(0, 0)] * (samples.ndim - 1) + [(0, extension)]
    return choose_namespace(samples).pad(samples, padding)


def _interpolate_samples(samples: AnyArray, division: int) -> AnyArray:
    """Add samples on the straight lines between samples."""
    along = np.arange(division, dtype=samples.dtype) / division
    along = along.reshape(*[1] * samples.ndim, division)
    before = samples[..., :-1, None]
    lines = before + along * (samples[..., 1:, None] - before)
    lines = lines.reshape(*samples.shape[:-1], -1)
    return choose_namespace(samples).concatenate([lines, samples[..., -1:]], axis=-1)


def _find_end(motion: np.ndarray, last: int) -> int:
    """Find the number of samples until all floors stay below a small fraction of their peaks."""
    size = abs(motion)
    moves = size > _NEGLIGIBLE * size.max(axis=-1, keepdims=True)
    (indices,) = np.nonzero(moves.reshape(-1, motion.shape[-1]).any(axis=0))
    # The first sample below it is included.
    return max(last, int(indices[-1]) + 1 if indices.size else 0) + 1
