"""What a block in motion does on one Taylor polynomial: its highest rotation, and its impact.

The impact is a root of that polynomial. It is found in parts of the step that are close to
parabolas: a cubic through both ends of a part tells whether the block might land in it.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from ..validation import Booleans
from .taylor import Coefficients, derivative, evaluate, materialized

# Longest part of a step times the fastest rate: on it, the rotation is close to a parabola.
LONGEST = 0.45


class _Piece(NamedTuple):
    """A part of a step, or what of it comes before the impact."""

    start: Any
    end: Any
    rotation: Any
    end_rotation: Any
    slope: Any
    end_slope: Any

    def until(self, time: Any, rotation: Any, slope: Any) -> "_Piece":
        """The piece up to a time, if that is in it."""
        ends = (self.end, self.end_rotation, self.end_slope)
        cut = [
            jnp.where(time < self.end, new, old)
            for new, old in zip((time, rotation, slope), ends, strict=True)
        ]
        return self._replace(end=cut[0], end_rotation=cut[1], end_slope=cut[2])


class _Parts(NamedTuple):
    """A step in parts of equal length."""

    part: Any  # their length
    times: list[Any]
    rotations: list[Any]
    slopes: list[Any]

    @classmethod
    def of(cls, path: Coefficients, slope: Coefficients, step: Any, parts: int) -> "_Parts":
        part = step * (1 / parts)
        times = [k * part for k in range(1, parts)] + [step]
        rotations = materialized([evaluate(path, time) for time in times])
        slopes = materialized([evaluate(slope, time) for time in times])
        start = jnp.zeros_like(step)
        return cls(part, [start, *times], [path[0], *rotations], [slope[0], *slopes])

    def piece(self, number: Any) -> _Piece:
        """The part of a number."""
        ends = (self.times, self.rotations, self.slopes)
        chosen = [_chosen(number, end[k : len(end) - 1 + k]) for end in ends for k in (0, 1)]
        return _Piece(*chosen)

    def bounds(self, k: int) -> tuple[Any, Any]:
        """Between which the cubic through both ends of a part is."""
        third = self.part * (1 / 3)
        left, right = self.rotations[k], self.rotations[k + 1]
        near, far = left + third * self.slopes[k], right - third * self.slopes[k + 1]
        low = jnp.minimum(jnp.minimum(left, right), jnp.minimum(near, far))
        return low, jnp.maximum(jnp.maximum(left, right), jnp.maximum(near, far))


def _chosen(index: Any, values: list[Any]) -> Any:
    """The values at an index, by comparisons, which run on SIMD lanes."""
    chosen = values[-1]
    for k in reversed(range(len(values) - 1)):
        chosen = jnp.where(index == k, values[k], chosen)
    return chosen


def _extreme(slope: Coefficients, piece: _Piece, sign: float, newtons: int) -> Any:
    """When a rotation is highest (sign 1) or lowest (-1) in a piece; its end if never.

    From the parabola that the slope of a cubic is, and Newton's method. Only its last step has a
    derivative, which the second derivative of the extreme value needs.
    """
    changing = slope
    slope, piece = jax.lax.stop_gradient((slope, piece))
    start, width = piece.start, piece.end - piece.start
    mean = (piece.end_rotation - piece.rotation) / jnp.where(width > 0, width, 1)
    a = sign * piece.slope
    b = sign * (3 * mean - 2 * piece.slope - piece.end_slope)
    c = sign * 3 * (piece.slope + piece.end_slope - 2 * mean)
    square, up = b * b - a * c, b > 0
    root = jnp.sqrt(jnp.maximum(square, 0))
    # -(root + b) / c, without cancellation
    above, below = jnp.where(up, -(root + b), a), jnp.where(up, c, root - b)
    share = above / jnp.where(below == 0, 1, below)
    inside = (square > 0) & (below != 0) & (share > 0) & (share < 1)
    time = materialized(jnp.where(inside, start + share * width, piece.end))
    bend = derivative(slope)
    for k in range(newtons):
        value = evaluate(changing if k == newtons - 1 else slope, time)
        curved = evaluate(bend, time)
        better = time - value / jnp.where(curved == 0, 1, curved)
        inside = inside & (better > start) & (better < piece.end)
        time = materialized(jnp.where(inside, better, time))
    return time


def _landing(
    path: Coefficients, slope: Coefficients, start: Any, parabola: Any, latest: Any
) -> tuple[Any, Booleans]:
    """When a rotation falls through 0 that is negative at `latest`, and whether that was located.

    By Halley's method from the root of a parabola. One more step shows whether that was enough,
    and gives the time its derivatives.
    """
    a, b, c = parabola
    bend = derivative(slope)
    root = jnp.sqrt(jnp.maximum(b * b - 4 * a * c, 0))
    up = b >= 0
    below = jnp.where(up, -2 * c, root - b)
    time = start + jnp.where(up, b + root, 2 * a) / jnp.where(below > 0, below, 1)
    inside = (below > 0) & (time > start) & (time < latest)
    time = materialized(jnp.where(inside, time, 0.5 * (start + latest)))
    for _ in range(2):
        value, steep, bent = (evaluate(each, time) for each in (path, slope, bend))
        below = steep * steep - 0.5 * value * bent
        time = materialized(time - value * steep / jnp.where(below > 0, below, jnp.inf))
    before = jax.lax.stop_gradient(time)
    steep, bent = materialized((evaluate(slope, before), evaluate(bend, before)))
    below = jnp.where(steep < 0, steep, -1)
    off = evaluate(path, before) / below
    # The square matters only in the second derivative of the time.
    time = materialized(before - off - 0.5 * off * off * bent / below)
    near = jnp.abs(time - before) <= float(jnp.finfo(time.dtype).eps) ** 0.5 * time
    return time, near & (steep < 0) & (time > start) & (time <= latest)


class Flight(NamedTuple):
    """What a block in motion does in a step."""

    time: Any  # until its impact or the end of the step
    rotation: Any  # then
    velocity: Any  # then, before the impact
    highest: Any  # rotation
    lands: Any
    blocked: Any  # whether it lands at a time that was not located
    latest: Any  # time at which it would be below the ground

    @classmethod
    def of(cls, path: Coefficients, step: Any, parts: int, moves: Any) -> "Flight":
        """The flight on a polynomial, up to a time."""
        slope = derivative(path)
        split = _Parts.of(path, slope, step, parts)
        bounds = [split.bounds(k) for k in range(parts)]
        # The first part in which the block might land.
        number = jnp.full(step.shape, parts, jnp.int32)
        for k in reversed(range(parts)):
            number = jnp.where(bounds[k][0] < 0, k, number)
        suspect = moves & (number < parts)
        number = materialized(jnp.minimum(number, parts - 1))
        part = split.piece(number)
        dip = _extreme(slope, part, -1.0, 1)
        lowest = materialized(evaluate(path, dip))
        below = lowest < 0
        lands = suspect & (jnp.minimum(part.end_rotation, lowest) < 0)
        latest = jnp.where(below, dip, part.end)
        lands, latest = materialized((lands, latest))
        width = jnp.where(latest > part.start, latest - part.start, 1)
        depth = jnp.where(below, lowest, part.end_rotation)
        chord = (depth - part.rotation - part.slope * width) / (width * width)
        # A small bounce fills little of the first part.
        bend = jnp.where(number == 0, path[2], chord)
        parabola = (part.rotation, part.slope, bend)
        landing, located = _landing(path, slope, part.start, parabola, latest)
        # Where the impact is not located, the next step begins here and is half as long.
        blocked, lands = lands & ~located, lands & located
        # Behind a part that was suspected wrongly, there may be another one.
        time = jnp.where(suspect, part.end, step)
        time = jnp.where(lands, landing, jnp.where(blocked, 0, time))
        time, blocked, lands = materialized((time, blocked, lands))

        velocity = materialized(evaluate(slope, time))
        # Never on the ground without an impact, which could not be located from there.
        above = jnp.maximum(evaluate(path, time), float(jnp.finfo(step.dtype).tiny))
        rotation = materialized(jnp.where(lands, 0, above))
        # The highest rotation is in the part with the highest bound, before the impact.
        bound, number = bounds[0][1], jnp.zeros_like(number)
        for k in range(1, parts):
            higher = (bounds[k][1] > bound) & (split.times[k] < time)
            bound, number = jnp.where(higher, bounds[k][1], bound), jnp.where(higher, k, number)
        part = split.piece(materialized(number)).until(time, rotation, velocity)
        top = _extreme(slope, part, 1.0, 1 if parts == 1 else 2)
        highest = jnp.where(top < time, materialized(evaluate(path, top)), 0)
        highest = materialized(jnp.maximum(rotation, highest))
        return cls(time, rotation, velocity, highest, lands, blocked, latest)
