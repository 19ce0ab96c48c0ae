"""The flight of a block on one Taylor polynomial: its highest rotation, and its impact.

The impact is a root of that polynomial, and the highest rotation one of its slope. Both are
sought from the cubic through both ends of the step. How far the polynomial is from a cubic is
bounded: where the bounds leave open whether there is an impact, whether it is the first, or
how high the block rises, the step is not taken, and the next one is shorter. A block that
bounces while the input is about to lift it again has bounces that fill an arbitrarily small
part of a step: then the next step is twice as long as the bounce.

An impact may fall on the end of the step, where the input has a corner: it counts if
its time is not later. Then the next step has length 0 and leads into the next interval. If
rounding puts it just behind the end, the block is held above the ground by the smallest number
there is, and lands at the beginning of the next interval.
"""

import math
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from ...validation import Booleans, Number, Reals
from .ground_input import PerBlock, TruthPerBlock
from .taylor import Coefficients, differentiate, evaluate, materialize

# Longest step times the fastest rate: on longer ones the cubic is rarely close enough.
LONGEST_STEP = 0.9
# The error of cubic Hermite interpolation is at most this times the fourth power of the length
# of the interval and the largest fourth derivative in it (Birkhoff and Priver 1967,
# doi:10.1002/sapm1967461440).
_FROM_CUBIC = 1 / 384
# The error of its slope is at most sqrt(3) / 216 < 1 / 120 times the third power of the length
# and the same derivative.
_FROM_ITS_SLOPE = 1 / 120


class _Cubic(NamedTuple):
    """The cubic with the rotations and slopes of both ends of a step, from time 0 on."""

    step: Reals
    rotation: Reals | float
    slope: Reals | float
    end_rotation: Reals
    end_slope: Reals

    def bounds(self) -> tuple[Reals, Reals]:
        """Bound the cubic by its smallest and its largest Bernstein coefficient."""
        third = self.step * (1 / 3)
        near = self.rotation + third * self.slope
        far = self.end_rotation - third * self.end_slope
        low = jnp.minimum(
            jnp.minimum(self.rotation, self.end_rotation), jnp.minimum(near, far)
        )
        high = jnp.maximum(
            jnp.maximum(self.rotation, self.end_rotation), jnp.maximum(near, far)
        )
        return low, high

    def slope_bounds(self) -> tuple[Reals, Reals]:
        """Bound its slope in the same way."""
        mean = (self.end_rotation - self.rotation) / jnp.where(self.step > 0, self.step, 1)
        middle = 3 * mean - self.slope - self.end_slope
        low = jnp.minimum(jnp.minimum(self.slope, self.end_slope), middle)
        high = jnp.maximum(jnp.maximum(self.slope, self.end_slope), middle)
        return low, high

    def extreme(self, sign: float) -> tuple[Reals, Booleans]:
        """Find the time of its maximum (sign 1) or minimum (-1), and whether the step has one."""
        mean = (self.end_rotation - self.rotation) / jnp.where(self.step > 0, self.step, 1)
        a = sign * self.slope
        b = sign * (3 * mean - 2 * self.slope - self.end_slope)
        c = sign * 3 * (self.slope + self.end_slope - 2 * mean)
        square = b * b - a * c
        up = b > 0
        root = jnp.sqrt(jnp.maximum(square, 0))
        # -(root + b) / c, without cancellation
        above = jnp.where(up, -(root + b), a)
        below = jnp.where(up, c, root - b)
        share = above / jnp.where(below == 0, 1, below)
        inside = (square > 0) & (below != 0) & (share > 0) & (share < 1)
        return jnp.where(inside, share * self.step, self.step), inside


def _improve_extreme(
    slope: Coefficients, time: Reals, inside: Booleans, latest: Reals
) -> Reals:
    """Improve the time of an extreme by Newton's method, if that stays before `latest`."""
    curved = evaluate(differentiate(slope), time)
    better = time - evaluate(slope, time) / jnp.where(curved == 0, 1, curved)
    return materialize(jnp.where(inside & (better > 0) & (better < latest), better, time))


def _locate_landing(
    path: Coefficients, slope: Coefficients, parabola: Coefficients, latest: Reals
) -> tuple[Reals, Booleans]:
    """Locate where a rotation that is negative at `latest` falls through 0; tell whether it did.

    By Halley's method from the root of a parabola. One more step shows whether that was
    enough, and gives the time its derivatives.
    """
    a, b, c = parabola
    bend = differentiate(slope)
    root = jnp.sqrt(jnp.maximum(b * b - 4 * a * c, 0))
    up = b >= 0
    below = jnp.where(up, -2 * c, root - b)
    time = jnp.where(up, b + root, 2 * a) / jnp.where(below > 0, below, 1)
    inside = (below > 0) & (time > 0) & (time < latest)
    time = materialize(jnp.where(inside, time, 0.5 * latest))
    # Twice: the parabola is right to a few digits, and each step of Halley's method triples
    # their number.
    for _ in range(2):
        value, steep, bent = (
            evaluate(coefficients, time) for coefficients in (path, slope, bend)
        )
        below = steep * steep - 0.5 * value * bent
        time = materialize(time - value * steep / jnp.where(below > 0, below, jnp.inf))
    before = jax.lax.stop_gradient(time)
    steep, bent = materialize((evaluate(slope, before), evaluate(bend, before)))
    below = jnp.where(steep < 0, steep, -1)
    off = evaluate(path, before) / below
    # The square matters only in the second derivative of the time.
    time = materialize(before - off - 0.5 * off * off * bent / below)
    # If a step of third order moves the time by less than sqrt(eps), only rounding is left.
    near = jnp.abs(time - before) <= float(jnp.finfo(time.dtype).eps) ** 0.5 * time
    return time, near & (steep < 0) & (time > 0) & (time <= latest)


def _fit_parabola(path: Coefficients, latest: Reals, depth: Reals) -> Coefficients:
    """Fit a parabola that is close to a path down to its depth at `latest`.

    With the path's value and slope at the beginning; it ends at the depth, or has the path's
    own curvature if the bounce is so small that it falls below the ground long before.
    """
    width = jnp.where(latest > 0, latest, 1)
    chord = (depth - path[0] - path[1] * width) / (width * width)
    small = (path[0] == 0) & (path[1] + 0.5 * path[2] * latest < 0)
    return path[0], path[1], jnp.where(small, path[2], chord)


def _bound_fourth_derivative(path: Coefficients, step: Reals) -> Reals:
    """Bound the magnitude of the fourth derivative within a step."""
    terms = (math.perm(k, 4) * jnp.abs(path[k]) for k in range(4, len(path)))
    return evaluate(tuple(terms), step)


def _stays_above(path: Coefficients, cubic: _Cubic, fourth: Reals, lowest: Reals) -> Booleans:
    """Certify that a rotation stays above the ground in a step; at its dip it is `lowest`."""
    step = cubic.step
    _, c1, c2, c3 = path[:4]
    # Because the chords from its beginning rise: Bernstein coefficients of their slope, with
    # less than a 24th of the fourth derivative for all terms beyond the third.
    third = step * (1 / 3)
    chords = jnp.minimum(c1, c1 + third * c2)
    chords = jnp.minimum(chords, c1 + 2 * third * c2 + third * step * c3)
    chords = jnp.minimum(chords, c1 + step * (c2 + step * (c3 - step * fourth * (1 / 24))))
    # Or because the cubic does, which is no further away than this.
    apart = fourth * step**4 * _FROM_CUBIC
    low, _ = cubic.bounds()
    lowest = jnp.minimum(jnp.minimum(cubic.rotation, cubic.end_rotation), lowest)
    return (chords >= 0) | (low >= apart) | (lowest >= 2 * apart)


def _is_first(path: Coefficients, fourth: Reals, landing: Reals) -> Booleans:
    """Certify that a root is the first one: p(t) / t falls up to it.

    Its derivative is (-c0 + c2 t^2 + 2 c3 t^3 + ...) / t^2, with less than an eighth of the
    fourth derivative times t^4 for all that follows.
    """
    c0, _, c2, c3 = path[:4]
    rises = c2 + landing * (2 * jnp.maximum(c3, 0) + landing * fourth * (1 / 8))
    return rises * landing * landing <= c0


def _is_top(slope: Coefficients, time: Reals, missing: Number) -> Booleans:
    """Check that a maximum is found: the rotation there is too low by `missing` at most."""
    # By the parabola through it, the top is slope^2 / (-2 curvature) higher.
    bend = jnp.minimum(evaluate(differentiate(slope), time), 0)
    return evaluate(slope, time) ** 2 <= -2 * bend * missing


def _is_monotone(path: Coefficients, cubic: _Cubic, fourth: Reals) -> Booleans:
    """Certify that a rotation rises, or falls, throughout a step."""
    step = cubic.step
    _, c1, c2, c3 = path[:4]
    # Bernstein coefficients of the slope, with a sixth of the fourth derivative for what
    # follows.
    third = step * (1 / 3)
    middle = c1 + 2 * third * c2, c1 + third * (4 * c2 + 3 * step * c3)
    last = c1 + step * (2 * c2 + step * 3 * c3)
    remainder = step**3 * fourth * (1 / 6)
    rises = (
        jnp.minimum(jnp.minimum(c1, middle[0]), jnp.minimum(middle[1], last - remainder)) >= 0
    )
    falls = (
        jnp.maximum(jnp.maximum(c1, middle[0]), jnp.maximum(middle[1], last + remainder)) <= 0
    )
    # Or the slope of the cubic is not further away than this.
    apart = fourth * step**3 * _FROM_ITS_SLOPE
    slow, fast = cubic.slope_bounds()
    return rises | falls | (slow >= apart) | (fast <= -apart)


class StepFlight(eqx.Module):
    """The flight of a block in motion within a step."""

    time: PerBlock  # until its impact or the end of the step
    rotation: PerBlock  # then
    velocity: PerBlock  # then, before the impact
    highest: PerBlock  # rotation
    lands: TruthPerBlock
    blocked: TruthPerBlock  # whether the step is too long to tell, and is not taken
    step_limit: PerBlock  # to the next step, if this one is blocked

    @classmethod
    def of(
        cls, path: Coefficients, step: Reals, moves: Booleans, peak: Reals, tolerance: Number
    ) -> "StepFlight":
        """Describe the flight on a polynomial, up to a time.

        A highest rotation above the peak so far is found to the tolerance. Four questions are
        answered one after the other: does the block stay above the ground? if not, when does
        it land? is that its first impact? how high does it rise until then? Where one of the
        answers is not certain, the step is blocked.
        """
        slope = differentiate(path)
        end, end_slope = materialize((evaluate(path, step), evaluate(slope, step)))
        # Decisions have no derivatives. The end of a step may have one: where the input has a
        # corner.
        fixed, fixed_slope, peak = jax.lax.stop_gradient((path, slope, peak))
        cubic = _Cubic(*jax.lax.stop_gradient((step, path[0], path[1], end, end_slope)))
        fourth = materialize(_bound_fourth_derivative(fixed, cubic.step))

        # Does it stay above the ground? The cubic's dip, improved, is the lowest candidate.
        dip, dips = cubic.extreme(-1.0)
        dip = _improve_extreme(fixed_slope, dip, dips, cubic.step)
        lowest = materialize(evaluate(fixed, dip))
        above = _stays_above(fixed, cubic, fourth, lowest)
        above, lowest = materialize((above, lowest))
        crosses = moves & ~above & (jnp.minimum(lowest, cubic.end_rotation) < 0)

        # When does it land? Before the dip, or before the end where that is below the ground.
        latest = materialize(jnp.where(lowest < 0, dip, cubic.step))
        depth = jnp.where(lowest < 0, lowest, cubic.end_rotation)
        landing, located = _locate_landing(
            path, slope, _fit_parabola(fixed, latest, depth), latest
        )
        # A root of the polynomial is an impact only if the block was above the ground before.
        first = _is_first(fixed, fourth, jax.lax.stop_gradient(landing))
        lands = crosses & located & first
        uncertain = moves & ~above & ~lands
        time = materialize(jnp.where(lands, landing, step))

        velocity = materialize(evaluate(slope, time))
        # Never on the ground without an impact, which could not be located from there.
        positive = jnp.maximum(evaluate(path, time), float(jnp.finfo(step.dtype).tiny))
        rotation = materialize(jnp.where(lands, 0, positive))

        # How high does it rise? The cubic now ends at the impact.
        cubic = _Cubic(*jax.lax.stop_gradient((time, path[0], path[1], rotation, velocity)))
        top, inside = cubic.extreme(1.0)
        top = _improve_extreme(fixed_slope, top, inside, cubic.step)
        # Only this step has a derivative, which the second derivative of the rotation needs.
        top = _improve_extreme(slope, top, inside, cubic.step)
        highest = jnp.where(inside, materialize(evaluate(path, top)), 0)
        highest = materialize(jnp.maximum(rotation, highest))
        highest_so_far = jnp.maximum(peak, jax.lax.stop_gradient(highest))
        reached = inside & _is_top(
            fixed_slope, jax.lax.stop_gradient(top), tolerance * highest_so_far
        )
        # It is known if it was found, if there is none inside, or if it cannot exceed the
        # peak.
        higher = cubic.bounds()[1] + fourth * cubic.step**4 * _FROM_CUBIC
        known = reached | _is_monotone(fixed, cubic, fourth) | (higher <= highest_so_far)
        uncertain = uncertain | (moves & ~known)

        # What the next step may be. One shorter than rounding, or not finite, is taken as it
        # is: no shorter one would tell more, and the lane would never end.
        long = step > 4 * float(jnp.finfo(step.dtype).eps)
        blocked = materialize(uncertain & long & jnp.isfinite(end))
        # After a bounce that fills less than a quarter of the step: twice its own length,
        # which is -c1 / c2, so that the next step reaches beyond its end.
        bounce = -2 * fixed[1] / jnp.where(fixed[2] < 0, fixed[2], -1)
        small = (fixed[0] == 0) & (fixed[2] < 0) & (bounce < 0.5 * latest)
        return cls(
            time=jnp.where(blocked, 0, time),
            rotation=jnp.where(blocked, path[0], rotation),
            velocity=jnp.where(blocked, path[1], velocity),
            highest=jnp.where(blocked, 0, highest),
            lands=lands & ~blocked,
            blocked=blocked,
            step_limit=jnp.where(small, bounce, 0.5 * jnp.minimum(latest, cubic.step)),
        )
