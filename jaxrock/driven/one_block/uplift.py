"""Uplift: the time at which the ground lifts a block that rests on it, and the side."""

import equinox as eqx
import jax
import jax.numpy as jnp

from ...ground_motion import Motion
from ...numerics import pick_larger, pick_largest
from ...validation import Booleans, Reals
from ..equation import Equation
from .contact_forces import friction_demand

_SIDES = 1.0, -1.0


class UpliftTable(eqx.Module):
    """A block at rest at the knots of a motion, computed once for all waits.

    Between two knots the horizontal acceleration is monotone. So an uplift lies in an interval
    whose second knot lifts the block, and the forces are extreme at knots.
    """

    equation: Equation
    motion: Motion
    knots: Reals
    lifted: Booleans  # (2, knots): whether the motion lifts the block there, to each side
    demand: Reals  # friction demand of the block at rest
    normal: Reals  # normal force on the block at rest, over the weight
    grace_time: Reals  # time after an uplift in which an impact or a peak does not count

    @classmethod
    def of(cls, equation: Equation, motion: Motion) -> "UpliftTable":
        """Make the table of a motion."""
        knots = motion.knots()
        push, lift = (a / equation.gravity for a in motion.value(knots))
        lifted = jnp.stack([equation.uplift_excess(side * push, lift) > 0 for side in _SIDES])
        # Little beside the block's own time and the time in which the input changes: in it a
        # block that has just been lifted only rises, whatever rounding makes of it. Records
        # are padded with knots at their end, which count for no interval.
        intervals = jnp.maximum(jnp.sum(knots < motion.end), 1).astype(knots.dtype)
        changes = (motion.end - motion.start) / intervals
        grace_time = 1e-6 * jnp.minimum(1 / jnp.sqrt(equation.p_squared), changes)
        forces = friction_demand(push, 1 + lift), 1 + lift
        return cls(equation, motion, knots, lifted, *forces, jax.lax.stop_gradient(grace_time))

    def next_knot(self, time: Reals, stop: Reals) -> Reals:
        """Return the first knot after a time, or `stop` if that is earlier."""
        return jnp.min(self.knots, initial=stop, where=self.knots > time)

    def find_next(self, time: Reals, stop: Reals) -> tuple[Booleans, Reals, Reals]:
        """Find the next uplift of a block that rests at a time.

        Like the end of a segment it is sought without derivatives, and then refined by
        Newton's method, which brings them.

        Returns
        -------
        lifted : Array of bool
            Whether there is an uplift before `stop`.
        time : Array
            Time of the uplift [s].
        side : Array
            Side to which the block is lifted, +1 or -1.
        """
        # The first knot after `time` at which the motion lifts, and the interval before it.
        later = self.lifted.any(axis=0) & (self.knots > time) & (self.knots <= self.motion.end)
        index = jnp.argmax(later)
        found = later.any()
        upper = self.knots[index]
        lower = pick_larger(time, self.knots[jnp.maximum(index - 1, 0)])
        sides = jnp.asarray(_SIDES, self.knots.dtype)
        both = jnp.ones_like(sides)
        inputs = (self.equation, self.motion)
        fixed, (now, begin, end) = jax.lax.stop_gradient((inputs, (time, lower, upper)))

        # The motion may lift already now: behind an edge of the input, or after an impact that
        # left the block at rest.
        excess_now = _excess_to_both_sides(*fixed, both * now)
        at_once = (excess_now > 0).any()

        def halve(_: object, bracket: tuple[Reals, Reals]) -> tuple[Reals, Reals]:
            middle = 0.5 * (bracket[0] + bracket[1])
            below = _excess_to_both_sides(*fixed, begin + middle * (end - begin)) < 0
            return jnp.where(below, middle, bracket[0]), jnp.where(below, bracket[1], middle)

        # For both sides at once, in shares of the interval, halved down to rounding. Where the
        # ground falls away, both sides are lifted between the same knots: the first counts.
        bits = jnp.finfo(self.knots.dtype).nmant
        ends = jnp.zeros_like(excess_now), jnp.ones_like(excess_now)
        bracket = jax.lax.fori_loop(0, bits, halve, ends)
        first = jnp.argmin(jnp.where(self.lifted[:, index], bracket[1], jnp.inf))
        is_inside = found & (_excess_to_both_sides(*fixed, both * begin)[first] < 0) & ~at_once

        def excess(share: Reals) -> Reals:
            return _excess_to_both_sides(*inputs, both * (lower + share * (upper - lower)))[
                first
            ]

        def take_newton_step(_: object, share: Reals) -> Reals:
            value, slope = jax.jvp(excess, (share,), (jnp.ones_like(share),))
            move = jnp.where(slope > 0, value / jnp.where(slope > 0, slope, 1), 0)
            # Where the input is all but flat, rounding makes the step long. It must not change
            # the value then, but it still gives the derivative.
            near = jnp.abs(move) <= 1e-3
            return share - jnp.where(near, move, move - jax.lax.stop_gradient(move))

        # Each step of Newton's method makes one more derivative exact: two of them for a first
        # and a second one. The value is exact already.
        share = jax.lax.fori_loop(0, 2, take_newton_step, bracket[1][first])
        when = jnp.where(is_inside, lower + share * (upper - lower), lower)
        when = jnp.where(at_once, time, when)
        # The ground may also fall away and lift to both sides.
        stronger = jnp.where(excess_now[0] >= excess_now[1], sides[0], sides[1])
        return (
            (found | at_once) & (when < stop),
            when,
            jnp.where(at_once, stronger, sides[first]),
        )

    def find_force_extremes(
        self, time: Reals, until: Reals, acts: Booleans
    ) -> tuple[Reals, Reals]:
        """Find the largest friction demand and smallest normal force of a block at rest.

        They are sought at both times and at the knots between them. While the input does not
        act, the block presses with its weight.
        """
        ends = jnp.stack([time, until])
        push, lift = (
            jnp.where(acts, a / self.equation.gravity, 0) for a in self.motion.value(ends)
        )
        between = acts & (self.knots >= time) & (self.knots <= until)
        demand = jnp.where(between, self.demand, 0)
        normal = jnp.where(between, self.normal, jnp.inf)
        demands = jnp.concatenate([friction_demand(push, 1 + lift), demand])
        return pick_largest(demands), -pick_largest(-jnp.concatenate([1 + lift, normal]))


# Jitted, so that it enters the program once for each shape of its arguments, however often it
# is called.
@jax.jit
def _excess_to_both_sides(equation: Equation, motion: Motion, time: Reals) -> Reals:
    """Push beyond the one that lifts the block, to both sides, at a time for each."""
    push, lift = (a / equation.gravity for a in motion.value(time))
    return equation.uplift_excess(jnp.asarray(_SIDES, time.dtype) * push, lift)
