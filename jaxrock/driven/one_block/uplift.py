"""Uplift: the time at which the ground lifts a block that rests on it, and the side."""

import equinox as eqx
import jax
import jax.numpy as jnp

from ...ground_motion import Motion
from ...numerics import pick_larger, pick_largest, pick_smaller
from ...validation import Booleans, Integers, Reals
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
    excess: Reals  # (2, knots): push beyond the one that lifts the block there, to each side
    next_lifting: Integers  # index of the first knot, from each one on, that lifts the block
    demand: Reals  # friction demand of the block at rest
    normal: Reals  # normal force on the block at rest, over the weight
    grace_time: Reals  # time after an uplift in which an impact or a peak does not count

    @classmethod
    def of(cls, equation: Equation, motion: Motion) -> "UpliftTable":
        """Make the table of a motion."""
        knots = motion.knots()
        push, lift = (a / equation.gravity for a in motion.value(knots))
        excess = jnp.stack([equation.uplift_excess(side * push, lift) for side in _SIDES])
        excess = _leave_out_wall(equation, excess)
        # A knot behind the last one stands for none.
        indices = jnp.where((excess > 0).any(axis=0), jnp.arange(knots.size), knots.size)
        next_lifting = jax.lax.cummin(indices, reverse=True)
        # Little beside the block's own time and the time in which the input changes: in it a
        # block that has just been lifted only rises, whatever rounding makes of it. Records
        # are padded with knots at their end, which count for no interval.
        intervals = jnp.maximum(jnp.sum(knots < motion.end), 1).astype(knots.dtype)
        changes = (motion.end - motion.start) / intervals
        grace_time = 1e-6 * jnp.minimum(1 / jnp.sqrt(equation.p_squared), changes)
        forces = friction_demand(_carry_by_wall(equation, push), 1 + lift), 1 + lift
        grace_time = jax.lax.stop_gradient(grace_time)
        return cls(equation, motion, knots, excess, next_lifting, *forces, grace_time)

    def next_knot(self, time: Reals, stop: Reals) -> Reals:
        """Return the first knot after a time, or `stop` if that is earlier."""
        index = _count_until(self.knots, time)
        knot = self.knots[jnp.minimum(index, self.knots.size - 1)]
        return jnp.where((index < self.knots.size) & (knot < stop), knot, stop)

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
        last = self.knots.size - 1
        after = _count_until(self.knots, time)
        index = self.next_lifting[jnp.minimum(after, last)]
        lifts = (after <= last) & (index <= last)
        index = jnp.minimum(index, last)
        upper = self.knots[index]
        before = jnp.maximum(index - 1, 0)
        lower = pick_larger(time, self.knots[before])
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
        first = jnp.argmin(jnp.where(self.excess[:, index] > 0, bracket[1], jnp.inf))
        excess_begin = jnp.where(begin > now, self.excess[:, before], excess_now)
        is_inside = lifts & (excess_begin[first] < 0) & ~at_once

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
            (lifts | at_once) & (when < stop),
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
        demand = pick_largest(friction_demand(_carry_by_wall(self.equation, push), 1 + lift))
        normal = -pick_largest(-(1 + lift))
        # Which knots count has no derivative. There may be thousands of knots, of which a wait
        # passes over few: a loop over these, not over all.
        first = _count_until(self.knots, time)
        behind = jnp.where(acts, _count_until(self.knots, until), 0)
        table = jax.lax.stop_gradient((self.demand, self.normal))

        def compare(index: Integers, extremes: tuple[Integers, Integers]) -> tuple:
            most, least = extremes
            larger = table[0][index] > table[0][most]
            smaller = table[1][index] < table[1][least]
            return jnp.where(larger, index, most), jnp.where(smaller, index, least)

        start = jnp.minimum(first, self.knots.size - 1)
        most, least = jax.lax.fori_loop(start, behind, compare, (start, start))
        passes = first < behind
        demand = jnp.where(passes, pick_larger(demand, self.demand[most]), demand)
        normal = jnp.where(passes, pick_smaller(normal, self.normal[least]), normal)
        return demand, normal


@jax.jit
def _count_until(knots: Reals, time: Reals) -> Integers:
    """Count the knots up to a time: the index of the first one after it."""
    return jnp.searchsorted(*jax.lax.stop_gradient((knots, time)), side="right")


# Jitted, so that it enters the program once for each shape of its arguments, however often it
# is called.
@jax.jit
def _excess_to_both_sides(equation: Equation, motion: Motion, time: Reals) -> Reals:
    """Push beyond the one that lifts the block, to both sides, at a time for each."""
    push, lift = (a / equation.gravity for a in motion.value(time))
    excess = equation.uplift_excess(jnp.asarray(_SIDES, time.dtype) * push, lift)
    return _leave_out_wall(equation, excess)


def _leave_out_wall(equation: Equation, excess: Reals) -> Reals:
    """Replace the push to the side of a wall, the second one, by one that never lifts."""
    return excess.at[1].set(-jnp.inf) if equation.one_sided else excess


def _carry_by_wall(equation: Equation, push: Reals) -> Reals:
    """Return the push on the base of a block at rest: what pushes into a wall the wall carries."""
    return jnp.maximum(push, 0) if equation.one_sided else push
