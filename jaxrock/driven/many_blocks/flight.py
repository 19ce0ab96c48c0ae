"""The flight of a block on one Taylor polynomial: its highest rotation, and its impact.

The impact is a root of the polynomial, and the highest rotation one of its slope. Both are sought
by the same iterations, once in a step: one with a new peak and an impact ends at the peak. How
far the polynomial is from a cubic is bounded: where the bounds leave open whether there is a new
peak or an impact, or whether the root is the first one, the step is not taken, and the next one is
shorter. A block that bounces while the input is about to lift it again has bounces that fill an
arbitrarily small part of a step: then the next step is twice as long as the bounce.

An impact may fall on the end of the step, where the input has a corner: it counts if
its time is not later. Then the next step has length 0 and leads into the next interval. If
rounding puts it just behind the end, the block is held above the ground by the smallest number
there is, and lands at the beginning of the next interval.
"""

import functools
import math

import equinox as eqx
import jax
import jax.numpy as jnp

from ...validation import Booleans, Reals
from .ground_input import PerBlock, TruthPerBlock
from .taylor import Coefficients, differentiate, evaluate, evaluate_derivatives, materialize

# Longest step times the fastest rate: on longer ones the bounds are rarely close enough.
LONGEST_STEP = 0.9
# The error of cubic Hermite interpolation is at most this times the fourth power of the length
# of the interval and the largest fourth derivative in it (Birkhoff and Priver 1967,
# doi:10.1002/sapm1967461440).
_FROM_CUBIC = 1 / 384

# What may happen within a step. One array of them is one computation, whereas a boolean array
# for each would repeat it. At the last kind of top the step ends: an impact may follow.
_UNCERTAIN, _NONE, _IMPACT, _TOP, _END_AT_TOP = range(-1, 4)


class StepFlight(eqx.Module):
    """The flight of a block in motion within a step."""

    time: PerBlock  # until its impact, or the end of the step
    rotation: PerBlock  # then
    velocity: PerBlock  # then, before the impact
    highest: PerBlock  # rotation
    lands: TruthPerBlock
    blocked: TruthPerBlock  # whether the step is too long to tell, and is not taken
    step_limit: PerBlock  # to the next step, if this one is blocked

    @classmethod
    def of(cls, path: Coefficients, step: Reals, moves: Booleans, peak: Reals) -> "StepFlight":
        """Describe the flight on a polynomial, up to a time.

        A rotation within the step is sought if it exceeds the peak so far. Not by more than a
        tolerance: from the end of the last step to a top that is higher by a relative 1e-10
        derivatives may change by 1e-5.
        """
        # Decisions have no derivatives. The end of a step may have one: where the input has a
        # corner.
        fixed, length, allowed = jax.lax.stop_gradient((path, step, peak))
        end, end_slope = evaluate_derivatives(fixed, length, 2)
        first = length * fixed[1]
        second = length * length * fixed[2]
        third = length**3 * fixed[3]
        largest = materialize(_bound_fourth_derivative(fixed, length))
        fourth = largest * length**4

        # The cubic with the rotations and slopes of both ends lies between its Bernstein
        # coefficients, and the rotation no further away from it than `apart`.
        apart = fourth * _FROM_CUBIC
        near = fixed[0] + first * (1 / 3)
        far = end - length * end_slope * (1 / 3)
        low = _least(fixed[0], end, near, far) - apart
        high = _greatest(fixed[0], end, near, far) + apart
        # Bernstein coefficients of the chords from the beginning, and of the slope.
        chords = first, first + 0.5 * second, first + second + third - fourth * (1 / 24)
        bend = first + second
        last = first + 2 * second + 3 * third
        rises = _least(first, bend, last - fourth * (1 / 6)) >= 0
        falls = _greatest(first, bend, last + fourth * (1 / 6)) <= 0

        above = (low >= 0) | (_least(*chords) >= 0)
        # Where the slope falls throughout, there is one top, and no higher than that of the
        # parabola with the least curvature: so small bounces in long steps do not end at it.
        curvature = _greatest(second, second + 3 * third + 0.25 * fourth)
        single = curvature <= 0
        small = jnp.maximum(first, 0) ** 2 <= -4 * curvature * (allowed - fixed[0])
        known = rises | falls | (high <= allowed) | (single & small)
        rises_then_falls = ~known & (first > 0) & (end_slope < 0)
        crosses = known & ~above & (end < 0)
        event = jnp.where(known & above, _NONE, jnp.where(crosses, _IMPACT, _UNCERTAIN))
        top = jnp.where(above & single, _TOP, _END_AT_TOP)
        event = jnp.where(rises_then_falls, top, event)
        event = materialize(jnp.where(moves, event, _NONE))

        # The root of the rotation, or of its slope.
        at_top = event >= _TOP
        slope = (*differentiate(path), 0.0)
        sought = materialize(
            tuple(jnp.where(at_top, *pair) for pair in zip(slope, path, strict=True))
        )
        root, located = _locate_root(sought, length, jnp.where(at_top, end_slope, end))
        first_one = _is_first(*jax.lax.stop_gradient((sought, at_top, largest, root)))
        # A step shorter than rounding, or not finite, is taken as it is: no shorter one would
        # tell more, and the lane would never end.
        long = length > 4 * float(jnp.finfo(length.dtype).eps)
        found = (event > _NONE) & located & first_one
        blocked = ~(found | (event == _NONE)) & long & jnp.isfinite(end)
        # A root that is not there may be infinite: cotangents of 0 would become NaN.
        found, blocked, root = materialize((found, blocked, jnp.where(found, root, 0)))
        ends = found & (event != _TOP)
        time = materialize(jnp.where(blocked, 0, jnp.where(ends, root, step)))

        rotation, velocity = evaluate_derivatives(path, time, 2)
        lands = ends & ~at_top
        # Never on the ground without an impact, which could not be located from there.
        positive = jnp.maximum(rotation, float(jnp.finfo(length.dtype).tiny))
        positive = jnp.where(blocked, path[0], positive)

        rotation = materialize(jnp.where(lands, 0, positive))
        top = jnp.where(found & at_top, materialize(evaluate(path, root)), 0)

        # A bounce is as long as this, and half of it is the time of a dip.
        turn = -fixed[1] / jnp.where(fixed[2] == 0, 1, fixed[2])
        bounces = (fixed[0] == 0) & (fixed[2] < 0)
        turn = jnp.where(bounces, 2 * turn, jnp.where(fixed[2] > 0, 0.5 * turn, 0))
        short = (turn > 0) & (turn < 0.5 * length)
        return cls(
            time=time,
            rotation=rotation,
            velocity=jnp.where(ends & at_top, 0, velocity),
            highest=jnp.maximum(rotation, top),
            lands=lands,
            blocked=blocked,
            step_limit=jnp.where(short, turn, 0.5 * length),
        )


def _least(*values: Reals | float) -> Reals:
    return jnp.asarray(functools.reduce(jnp.minimum, values))


def _greatest(*values: Reals | float) -> Reals:
    return jnp.asarray(functools.reduce(jnp.maximum, values))


def _bound_fourth_derivative(path: Coefficients, step: Reals) -> Reals:
    """Bound the magnitude of the fourth derivative within a step."""
    terms = (math.perm(k, 4) * jnp.abs(path[k]) for k in range(4, len(path)))
    return evaluate(tuple(terms), step)


def _locate_root(series: Coefficients, length: Reals, last: Reals) -> tuple[Reals, Booleans]:
    """Locate where a series that is `last` < 0 at `length` falls through 0; return whether it did.

    From the root of a parabola, in two steps. How far the second one goes shows whether they are
    enough.
    """
    fixed = jax.lax.stop_gradient(series)
    # The parabola has the value and slope at the beginning, and ends at `last`; or it has the
    # own curvature of a bounce that is so small that it ends long before.
    a = fixed[0]
    b = fixed[1] * length
    curved = fixed[2] * length * length
    small = (a == 0) & (b + 0.5 * curved < 0)
    c = jnp.where(small, curved, last - a - b)
    root = jnp.sqrt(jnp.maximum(b * b - 4 * a * c, 0))
    up = b >= 0
    below = jnp.where(up, -2 * c, root - b)
    share = jnp.where(up, b + root, 2 * a) / jnp.where(below > 0, below, 1)
    time = materialize(jnp.where(share < 1, share, 0.5) * length)

    # Each step, of fourth order, quadruples the number of digits. The first terms do for the
    # first step.
    close, _ = _approach_root(fixed[:-4], time)
    better, steep = _approach_root(fixed, close)
    # If such a step moves the time by less than this, only rounding is left.
    near = jnp.abs(better - close) <= float(jnp.finfo(time.dtype).eps) ** 0.27 * close
    located = near & (steep < 0) & (better > 0) & (better <= length)
    # A root that is not there may be infinite, and cotangents of 0 would become NaN.
    return _move_root(series, jnp.where(located, better, 0)), located


@jax.custom_jvp
def _move_root(series: Coefficients, root: Reals) -> Reals:
    """Return a root, with its derivatives by the implicit function theorem."""
    del series
    return root


@_move_root.defjvp
def _differentiate_root(primals: tuple, tangents: tuple) -> tuple[Reals, Reals]:
    series, _ = primals
    root = _move_root(*primals)
    slope = evaluate(differentiate(series), root)
    return root, -evaluate(tangents[0], root) / jnp.where(slope < 0, slope, -1)


def _approach_root(series: Coefficients, time: Reals) -> tuple[Reals, Reals]:
    """Improve the time of a root by the inverse series, and return the slope there."""
    value, slope, bend, twist = evaluate_derivatives(series, time, 4)
    inverse = 1 / jnp.where(slope < 0, slope, -1)
    off = -value * inverse
    bend = -0.5 * bend * inverse * off
    twist = -(1 / 6) * twist * inverse * off * off
    return materialize(time + off * (1 + bend + 2 * bend * bend + twist)), slope


def _is_first(
    series: Coefficients, is_slope: Booleans, largest: Reals, root: Reals
) -> Booleans:
    """Certify that a root is the first one: the series over t falls up to it.

    The derivative of p(t) / t is (-c0 + c2 t^2 + 2 c3 t^3 + ...) / t^2, with less than an eighth
    of the `largest` fourth derivative times t^4 for all that follows. If p is the slope of a
    rotation, whose fourth derivative is bounded, a third of this times t^3 follows c2 t^2.
    """
    c0, _, c2, c3 = series[:4]
    rest = 2 * jnp.maximum(c3, 0) + largest * root * (1 / 8)
    rest = jnp.where(is_slope, largest * (1 / 3), rest)
    return (c2 + root * rest) * root * root <= c0
