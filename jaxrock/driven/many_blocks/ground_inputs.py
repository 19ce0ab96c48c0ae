"""Ground motion for the batch: power series from any time on, and when it lifts a block at rest.

A pulse is one interval, whose series is known at any time in it. A harmonic motion is a
one-sine pulse, interval after interval: the phase begins anew in each, so that it keeps its
digits however many there are. A record is a line in each interval between two samples; a table
says which interval is the next one strong enough to lift a block. Several records lie one
after the other.
"""

import math
from operator import sub
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ...ground_motion import Pulse
from .taylor import Coefficients, evaluate, sine_cosine

GRADES = 16  # of strength, each sqrt(2) below the one before
STRIDE = 8  # intervals that are passed over together


def negligible(dtype: Any) -> float:
    """Return the number below which something is nothing beside 1."""
    return 64 * float(jnp.finfo(dtype).eps)


class PulseInput(eqx.Module):
    """Intervals with a pulse of amplitude 1 each, which lasts for `extent` of its durations."""

    harmonic: tuple[Any, Any] | None  # see `Pulse.harmonic`
    extent: Any
    intervals: Any
    vertical: tuple[Any, ...] = ()

    @classmethod
    def of(cls, kind: type[Pulse], dtype: Any, intervals: Any = 1) -> "PulseInput":
        """Make the input for pulses of a kind, or for as many of them without a break."""
        harmonic = jax.tree.map(lambda part: np.asarray(part, dtype), kind.harmonic)
        extent = np.asarray(kind.extremes[-1], dtype)
        return cls(harmonic, extent, np.asarray(intervals, np.int32))

    def rate(self, length: Any) -> Any:
        """Rate of the phase in time, for intervals of a length."""
        return (math.pi if self.harmonic is None else self.harmonic[0]) * self.extent / length

    def series(self, case: Any, _: Any, along: Any, order: int) -> tuple[Coefficients, ...]:
        """Horizontal and vertical acceleration over g in powers of the time from `along` on."""
        phase = self.phase(case.rate, along)
        rate = case.rate
        c: list[Any]
        if self.harmonic is not None:
            sine, cosine = _periodic(phase)
            c = [case.strength * sine, case.strength * cosine * rate]
            square = rate * rate
            for k in range(2, order - 1):
                c.append(c[k - 2] * square * (-1 / (k * (k - 1))))
        else:
            # The wavelet is -1/2 of the second derivative of a bell exp(-phase^2).
            bell = [case.strength * jnp.exp(-phase * phase)]
            bell.append(-2 * phase * bell[0])
            for k in range(1, order):
                bell.append((phase * bell[k] + bell[k - 1]) * (-2 / (k + 1)))
            c = []
            unit = 1.0
            for k in range(order - 1):
                c.append(bell[k + 2] * unit * (-0.5 * (k + 1) * (k + 2)))
                unit = unit * rate
        return tuple(c), ()

    def phase(self, rate: Any, along: Any) -> Any:
        """Phase at a time, of the sine, or of the wavelet from its peak."""
        return rate * along + (-2 * math.pi if self.harmonic is None else self.harmonic[1])

    def uplifts(self, rate: Any, ratio: Any) -> tuple[Any, ...]:
        """Compute when the magnitude of the pulse rises through a ratio, inf for never."""
        if self.harmonic is None:
            inner, outer = _wavelet_crossings(ratio)
            phases = (-outer, -inner[0], inner[1])
        else:
            first = jnp.where(ratio < 1, jnp.arcsin(jnp.where(ratio < 1, ratio, 0)), jnp.inf)
            phases = tuple(k * math.pi + first for k in range(3))
        moving = jnp.where(rate > 0, rate, 1)
        begin = self.phase(rate, jnp.zeros_like(rate))

        def time(phase: Any) -> Any:
            return jnp.where((rate > 0) & (phase > begin), (phase - begin) / moving, jnp.inf)

        return tuple(map(time, phases))

    def uplift(self, case: Any, lanes: Any, horizontal: Any, *_: Any) -> tuple[Any, Any, Any]:
        """Tell whether a block at rest is lifted in the interval, when, and to which side."""
        at_once = jnp.abs(horizontal[0]) > case.equation.tangent * (
            1 + negligible(lanes.rotation.dtype)
        )
        time = jnp.full_like(lanes.along, jnp.inf)
        side = jnp.ones_like(lanes.along)
        # The sign of the first extreme, and of the third.
        first = 1.0 if self.harmonic is not None else -1.0
        for rise, sign in reversed(
            list(zip(case.uplifts, (first, -first, first), strict=True))
        ):
            sooner = (rise >= lanes.along) & (rise <= time)
            time = jnp.where(sooner, rise, time)
            side = jnp.where(sooner, sign, side)
        side = jnp.where(at_once, horizontal[0], side * case.strength) < 0
        lifted = at_once | (time < case.length)
        wait = jnp.where(at_once | ~lifted, 0, time - lanes.along)
        return lifted, wait, jnp.where(side, -1.0, 1.0)

    def extent_of(self, motion: Any) -> tuple[Any, Any]:
        """Return the place of the first interval, and the number of intervals."""
        return jnp.zeros_like(motion), jnp.broadcast_to(self.intervals, motion.shape)

    def is_finite(self, motion: Any) -> Any:
        """Tell whether a motion is finite, by its amplitude."""
        return jnp.ones(motion.shape, bool)

    def grade(self, needed: Any) -> Any:
        """Nothing that `next_interval` would need."""
        return jnp.zeros(needed.shape, jnp.int32)

    def next_interval(self, interval: Any, case: Any) -> Any:
        """Return the interval itself: all are equally strong."""
        return jnp.minimum(interval, case.intervals)


def _periodic(phase: Any) -> tuple[Any, Any]:
    """Sine and cosine of a phase of a few periods."""
    turns = jnp.round(phase * (1 / math.pi))
    # pi in two parts, the first of few bits.
    sine, cosine = sine_cosine((phase - turns * 3.140625) - turns * (math.pi - 3.140625))
    odd = turns != 2 * jnp.round(0.5 * turns)
    return jnp.where(odd, -sine, sine), jnp.where(odd, -cosine, cosine)


def _wavelet_crossings(ratio: Any) -> tuple[tuple[Any, Any], Any]:
    """Phases at which the magnitude of Ricker's wavelet is a ratio, all positive.

    On the slope of the main peak, and on both of the side peaks. inf where there is none.
    """
    tail = 2 * math.exp(-1.5)  # height of the side peaks, where the square is 1.5

    def solved(square: Any, exists: Any, sign: float, iterations: int) -> Any:
        """By Newton's method for the square of the phase, in logarithms."""
        target = jnp.log(jnp.where(exists, jax.lax.stop_gradient(ratio), 0.1))

        def newton(square: Any, target: Any) -> Any:
            inside = sign * (1 - 2 * square)
            return square - (jnp.log(inside) - square - target) / (-2 * sign / inside - 1)

        for _ in range(iterations):
            square = newton(square, target)
        # Once more for the derivative.
        square = newton(jax.lax.stop_gradient(square), jnp.log(jnp.where(exists, ratio, 0.1)))
        return jnp.where(exists, jnp.sqrt(jnp.where(exists, square, 1)), jnp.inf)

    fixed = jax.lax.stop_gradient(ratio)
    low = fixed < tail
    # From where Newton's method is monotone, the functions being concave.
    main = solved(0.5 * (1 - fixed), fixed < 1, 1.0, 5)
    gap = jnp.sqrt(jnp.maximum(tail - fixed, 0) * math.exp(1.5))
    near = solved(jnp.maximum(1.5 - gap, 0.5 + 0.25 * fixed), low, -1.0, 10)
    far = solved(1.5 + gap - 1.5 * jnp.log(jnp.where(low, fixed, tail) / tail), low, -1.0, 10)
    return (main, near), far


class RecordInput(eqx.Module):
    """The intervals of one or more records, one after the other in flat arrays.

    `horizontal` and `vertical` have an array for every power of the time (in intervals);
    `vertical` has none where there is no such component.
    """

    horizontal: tuple[Any, ...]
    vertical: tuple[Any, ...]
    strongest: Any
    finite: Any  # whether each motion is
    following: Any  # (strides x grades) the next stride in which an interval exceeds the grade
    first: Any  # place of the first interval of each motion
    intervals: Any  # of each motion

    def series(self, case: Any, interval: Any, along: Any, _: int) -> tuple[Coefficients, ...]:
        """Horizontal and vertical acceleration over g in powers of the time from `along` on."""
        index = case.first + interval
        share = along * case.rate

        def line(powers: tuple[Any, ...]) -> Coefficients:
            c = tuple(power.at[index].get(mode="clip") * case.strength for power in powers)
            return (evaluate(c, share), c[1] * case.rate) if c else ()

        return line(self.horizontal), line(self.vertical)

    def rate(self, length: Any) -> Any:
        """Rate of the samples."""
        return 1 / length

    def uplifts(self, rate: Any, ratio: Any) -> tuple[Any, ...]:
        """None: `following` says where to look."""
        del rate, ratio
        return ()

    def uplift(
        self, case: Any, lanes: Any, horizontal: Any, lift: Any, step: Any
    ) -> tuple[Any, Any, Any]:
        """Tell whether a block at rest is lifted in the interval, when, and to which side."""
        del lanes
        tangent = case.equation.tangent
        needed = (tangent * (1 + negligible(step.dtype)), jnp.zeros_like(step))
        if lift:
            needed = tuple(a + tangent * b for a, b in zip(needed, lift, strict=True))
        last = evaluate(horizontal, step)
        at_once = jnp.abs(horizontal[0]) > needed[0]
        lifted = at_once | (jnp.abs(last) > evaluate(needed, step))
        side = jnp.where(jnp.where(at_once, horizontal[0], last) < 0, -1.0, 1.0)
        if lift:
            # Where the ground falls away, both sides are lifted within the step: the first
            # counts.
            begin, end = (
                [one * part - need for one in (1.0, -1.0)]
                for part, need in ((horizontal[0], needed[0]), (last, evaluate(needed, step)))
            )
            first = begin[0] * (end[1] - begin[1]) >= begin[1] * (end[0] - begin[0])
            both = (end[0] > 0) & (end[1] > 0) & ~at_once
            side = jnp.where(both, jnp.where(first, 1.0, -1.0), side)
        excess = tuple(map(sub, (side * part for part in horizontal), needed))
        wait = -excess[0] / jnp.where(excess[1] > 0, excess[1], 1)
        return lifted, jnp.where(at_once, 0, wait), side

    def extent_of(self, motion: Any) -> tuple[Any, Any]:
        """Return the place of the first interval of a motion, and its number of intervals."""
        return self.first[motion], self.intervals[motion]

    def is_finite(self, motion: Any) -> Any:
        """Tell whether all samples of a motion are finite."""
        return self.finite[motion]

    def grade(self, needed: Any) -> Any:
        """Choose the highest grade that passes over no interval as strong as a block needs."""
        steps = jnp.ceil(2 * jnp.log2(self.strongest / needed))
        return jnp.clip(steps, 0, GRADES - 1).astype(jnp.int32)

    def next_interval(self, interval: Any, case: Any) -> Any:
        """Find the first interval from `interval` on that may be strong enough, or the end."""
        place = case.first + interval
        index = (place // STRIDE) * GRADES + case.grade
        following = self.following.at[index].get(mode="clip") * STRIDE
        place = jnp.where(place % STRIDE == 0, following, place)
        return jnp.minimum(place - case.first, case.intervals)
