"""Ground motion for `batch` as polynomials, one in each interval of a grid.

And, for blocks at rest, which interval is the next one strong enough to lift them.
"""

import functools
import math
from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp

from ..ground_motion import Pulse, Record, padded, room_for
from .taylor import derivative, evaluate

_PULSE_INTERVALS = 128  # per period
_PULSE_ROOM = 4 * _PULSE_INTERVALS  # for the longest of them
_GRADES = 16  # of strength, each sqrt(2) below the one before


class Grid(eqx.Module):
    """The intervals of one or more ground motions, one after the other in flat arrays.

    `horizontal` and `vertical` have an array for every power of the time (in intervals);
    `vertical` has none where there is no such component. Each motion has `intervals` of them,
    and room for `room`.
    """

    horizontal: tuple[Any, ...]
    vertical: tuple[Any, ...]
    strongest: Any
    finite: Any  # whether each motion is
    following: Any  # (room x motions x grades) next interval that exceeds the grade
    intervals: Any
    room: int = eqx.field(static=True)
    motions: tuple[int, ...] = eqx.field(static=True)

    def ahead(
        self, index: Any, along: Any, frequency: Any, factor: Any
    ) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        """Both components times a factor, in powers of the time from `along` on in an interval."""
        xi = along * frequency  # which is 1 over the length of an interval

        def shifted(powers: tuple[Any, ...]) -> tuple[Any, ...]:
            c = tuple(power.at[index].get(mode="clip") for power in powers)
            shifted_powers, unit = [], factor
            for k in range(len(powers)):
                shifted_powers.append(unit * evaluate(c, xi))
                c = tuple(part * (1 / (k + 1)) for part in derivative(c))
                unit = unit * frequency
            return tuple(shifted_powers)

        return shifted(self.horizontal), shifted(self.vertical)

    def trail(self, motion: Any, needed: Any) -> Any:
        """Index by which `next_interval` finds the motion and the strength that a block needs."""
        # The highest grade that passes over no interval in which the motion is stronger.
        steps = jnp.ceil(2 * jnp.log2(self.strongest / needed))
        grade = jnp.clip(steps, 0, _GRADES - 1).astype(jnp.int32)
        return motion * _GRADES + grade

    def next_interval(self, interval: Any, trail: Any) -> Any:
        """The first interval from `interval` on that may be strong enough, or `intervals`."""
        index = interval * (math.prod(self.motions) * _GRADES) + trail
        following = self.following.at[index].get(mode="clip")
        return jnp.where(interval < self.intervals, following, self.intervals)


def factor_length_and_end(motion: Pulse | Record) -> tuple[Any, Any, Any]:
    """The factor on the grid of a motion, the length of its intervals, and the end of the last."""
    if isinstance(motion, Record):
        end = motion.start + motion._last * motion.time_step
        return motion.scale, motion.time_step, end
    length = motion.duration / _intervals_per_duration(type(motion))
    return motion.amplitude, length, motion.start + _intervals_of(type(motion)) * length


def grid_of(motion: Pulse | Record) -> Grid:
    """The intervals of a motion, which may be several records, for a factor of 1."""
    if isinstance(motion, Pulse):
        return _pulse_grid(type(motion), motion.amplitude.dtype)
    # Few different shapes, so that few programs are compiled.
    samples = motion.acceleration, motion.vertical
    if not any(isinstance(part, jax.core.Tracer) for part in samples):
        room = room_for(motion.acceleration.shape[-1])
        samples = jax.tree.map(lambda part: padded(part, room), samples)
    return _record_grid(*samples, motion._last)


@functools.partial(jax.jit, static_argnames=("kind", "dtype"))
def _pulse_grid(kind: type[Pulse], dtype: Any) -> Grid:
    quintics, intervals = _quintics(kind, dtype), _intervals_of(kind)
    # The same room for all kinds of pulses, so that one program serves all.
    behind = max(0, _PULSE_ROOM - intervals)
    return _grid(tuple(jnp.pad(power, (0, behind)) for power in quintics), (), intervals)


@jax.jit
def _record_grid(acceleration: Any, vertical: Any, last: Any) -> Grid:
    if vertical is None:
        return _grid(_lines(acceleration), (), last)
    both = jnp.broadcast_arrays(acceleration, vertical)
    return _grid(_lines(both[0]), _lines(both[1]), last)


def _grid(horizontal: tuple[Any, ...], vertical: tuple[Any, ...], intervals: Any) -> Grid:
    room, intervals = horizontal[0].shape[-1], jnp.asarray(intervals).astype(jnp.int32)
    numbers = jnp.arange(room, dtype=jnp.int32)
    exists = numbers < intervals
    finite = jnp.isfinite(sum(horizontal + vertical))
    strength = _bound(horizontal)
    if vertical:
        strength = jnp.maximum(strength, _bound(vertical))
    # Behind the last sample, the room is filled with no intervals.
    strength = jnp.where(finite & jnp.broadcast_to(exists, finite.shape), strength, 0)
    strongest = strength.max()
    if strength.size * _GRADES >= 2**31:
        raise ValueError(
            f"motion has {strength.size} samples, more than {2**31 // _GRADES} in one batch"
        )
    grades = strongest * 2 ** (-0.5 * jnp.arange(_GRADES, dtype=strength.dtype))
    grades = grades.at[-1].set(0).reshape(1, 1, -1)
    # With the grades last, the minimum over all that follows runs on SIMD lanes.
    by_interval = strength.reshape(-1, room, 1).swapaxes(0, 1)
    numbers = numbers.reshape(-1, 1, 1)
    following = jax.lax.cummin(jnp.where(by_interval > grades, numbers, intervals), reverse=True)
    return Grid(
        tuple(power.reshape(-1) for power in horizontal),
        tuple(power.reshape(-1) for power in vertical),
        strongest,
        finite.reshape(-1, room).all(axis=-1),
        following.reshape(-1),
        intervals,
        room,
        strength.shape[:-1],
    )


def _lines(samples: Any) -> tuple[Any, ...]:
    return samples[..., :-1], jnp.diff(samples)


def _intervals_per_duration(kind: type[Pulse]) -> int:
    return round(_PULSE_INTERVALS * kind.angle / (2 * math.pi))


def _intervals_of(kind: type[Pulse]) -> int:
    return int(_intervals_per_duration(kind) * kind.extremes[-1])


def _quintics(kind: type[Pulse], dtype: Any) -> tuple[Any, ...]:
    """Quintics with the values and two derivatives of the shape at both ends of every interval."""
    each = _intervals_per_duration(kind)
    edges = jnp.linspace(0, kind.extremes[-1], _intervals_of(kind) + 1, dtype=dtype)
    along = jnp.full_like(edges, 1 / each)

    def sloped(edges: Any) -> Any:
        return jax.jvp(kind.shape, (edges,), (along,))

    (value, slope), (_, bend) = jax.jvp(sloped, (edges,), (along,))
    # What the parabola at the near end misses at the far one.
    a, b, c = value[:-1], slope[:-1], 0.5 * bend[:-1]
    rise, steeper, bent = value[1:] - a - b - c, slope[1:] - b - 2 * c, 0.5 * bend[1:] - c
    return (
        a,
        b,
        c,
        10 * rise - 4 * steeper + bent,
        -15 * rise + 7 * steeper - 2 * bent,
        6 * rise - 3 * steeper + bent,
    )


def _bound(powers: tuple[Any, ...]) -> Any:
    """A bound on the magnitude in each interval: the largest Bernstein coefficient."""
    degree = len(powers) - 1
    corners = [
        sum(math.comb(i, k) / math.comb(degree, k) * powers[k] for k in range(i + 1))
        for i in range(degree + 1)
    ]
    return jnp.max(jnp.abs(jnp.stack(corners)), axis=0)
