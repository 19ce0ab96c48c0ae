"""Uplift: the time at which the ground lifts a block that rests on it, and the side."""

import equinox as eqx
import jax
import jax.numpy as jnp

from ...ground_motion import Motion
from ...numerics import pick_larger, pick_largest, pick_smaller
from ...validation import Booleans, Integers, Reals
from ..equation import Equation
from .contact_forces import friction_demand


class UpliftTable(eqx.Module):
    """A block at rest at the knots of a motion, computed once for all waits.

    Between two knots the horizontal acceleration is monotone. So an uplift lies in an interval
    whose second knot lifts the block, and the forces are extreme at knots.
    """

    equation: Equation
    motion: Motion
    knots: Reals
    excess: Reals  # push beyond the one that lifts the block at each knot
    next_lifting: Integers  # index of the first knot, from each one on, that lifts the block
    demand: Reals  # friction demand of the block at rest
    normal: Reals  # normal force on the block at rest, over the weight
    grace_time: Reals  # time after an uplift in which an impact or a peak does not count

    @classmethod
    def of(cls, equation: Equation, motion: Motion) -> "UpliftTable":
        """Make the table of a motion."""
        knots = motion.knots()
        excess, _, demand, normal = _describe_rest(equation, motion, knots)
        # The index after the last knot means that no knot lifts the block.
        indices = jnp.where(excess > 0, jnp.arange(knots.size), knots.size)
        next_lifting = jax.lax.cummin(indices, reverse=True)
        # A time much shorter than 1 / p and than the changes of the input: during it a block
        # that has just been lifted only rises, whatever rounding shows. Records are padded
        # with knots at their end, which count for no interval.
        intervals = jnp.maximum(jnp.sum(knots < motion.end), 1).astype(knots.dtype)
        changes = (motion.end - motion.start) / intervals
        grace_time = 1e-6 * jnp.minimum(1 / jnp.sqrt(equation.p_squared), changes)
        grace_time = jax.lax.stop_gradient(grace_time)
        return cls(equation, motion, knots, excess, next_lifting, demand, normal, grace_time)

    def next_knot(self, time: Reals, stop: Reals) -> Reals:
        """Return the first knot after a time, or `stop` if that is earlier."""
        index = _count_until(self.knots, time)
        knot = self.knots[jnp.minimum(index, self.knots.size - 1)]
        return jnp.where((index < self.knots.size) & (knot < stop), knot, stop)

    def find_next(self, time: Reals, stop: Reals) -> tuple[Booleans, Reals, Reals]:
        """Find the next uplift of a block that rests at a time.

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
        before = jnp.maximum(index - 1, 0)
        lower = pick_larger(time, self.knots[before])
        length = self.knots[index] - lower

        # The input may lift the block at once: after an edge, or after an impact that left the
        # block at rest.
        excess_now, side_now, *_ = _describe_rest(self.equation, self.motion, time)
        lifts_now = excess_now > 0
        excess_begin = jnp.where(lower > time, self.excess[before], excess_now)
        is_inside = lifts & (excess_begin < 0) & ~lifts_now

        def compute_excess(fraction: Reals) -> tuple[Reals, Reals]:
            return _describe_rest(self.equation, self.motion, lower + fraction * length)[:2]

        # In fractions of the interval. Bisection down to rounding makes the value exact; then
        # each of two steps of Newton's method makes one more derivative exact.
        bits = jnp.finfo(self.knots.dtype).nmant
        zero = jnp.zeros_like(lower)

        def refine(turn: Integers, state: tuple[Reals, Reals, Reals]) -> tuple:
            begin, end, _ = state
            halves = turn < bits
            middle = jnp.where(halves, 0.5 * (begin + end), end)
            value, slope, side = jax.jvp(
                compute_excess, (middle,), (jnp.ones_like(middle),), has_aux=True
            )
            move = jnp.where(slope > 0, value / jnp.where(slope > 0, slope, 1), 0)
            # Where the input is nearly flat, rounding makes the step long. The step must not
            # change the value then, but it still gives the derivative.
            near = jnp.abs(move) <= 1e-3
            newton = middle - jnp.where(near, move, move - jax.lax.stop_gradient(move))
            below = value < 0
            begin = jnp.where(halves & below, middle, begin)
            return begin, jnp.where(halves, jnp.where(below, end, middle), newton), side

        _, fraction, side = jax.lax.fori_loop(0, bits + 2, refine, (zero, zero + 1, side_now))
        when = jnp.where(is_inside, lower + fraction * length, lower)
        when = jnp.where(lifts_now, time, when)
        lifted = (lifts | lifts_now) & (when < stop)
        return lifted, when, jnp.where(lifts_now, side_now, side)

    def find_force_extremes(
        self, time: Reals, until: Reals, acts: Booleans
    ) -> tuple[Reals, Reals]:
        """Find the largest friction demand and smallest normal force of a block at rest.

        They are sought at both times and at the knots between them. While the input does not
        act, the block presses with its weight.
        """
        limits = jnp.stack([time, until])
        _, _, demand, normal = _describe_rest(self.equation, self.motion, limits)
        demand = pick_largest(jnp.where(acts, demand, 0))
        normal = -pick_largest(-jnp.where(acts, normal, 1))
        # The choice of knots has no derivative. A wait passes over few of perhaps thousands of
        # knots: the loop is over these alone.
        first = _count_until(self.knots, time)
        behind = jnp.where(acts, _count_until(self.knots, until), 0)

        def compare(index: Integers, extremes: tuple[Reals, Reals]) -> tuple[Reals, Reals]:
            demand, normal = extremes
            return (
                pick_larger(demand, self.demand[index]),
                pick_smaller(normal, self.normal[index]),
            )

        return jax.lax.fori_loop(first, behind, compare, (demand, normal))


@jax.jit
def _count_until(knots: Reals, time: Reals) -> Integers:
    """Count the knots up to a time: the index of the first one after it."""
    return jnp.searchsorted(*jax.lax.stop_gradient((knots, time)), side="right")


# Jitted, so that the function enters a program once for each shape of its arguments, however
# often it is called.
@jax.jit
def _describe_rest(
    equation: Equation, motion: Motion, time: Reals
) -> tuple[Reals, Reals, Reals, Reals]:
    """Describe a block at rest.

    Returns
    -------
    excess : Array
        Push beyond the one that lifts the block; positive lifts.
    side : Array
        Side to which the input pushes it, +1 or -1.
    demand, normal : Array
        Friction demand, and normal force over the weight.
    """
    push, lift = (a / equation.gravity for a in motion.value(time))
    side = jnp.where((push < 0) & (not equation.one_sided), -1, 1).astype(time.dtype)
    strength = side * push
    # The wall carries a push into it.
    pushed = jnp.maximum(push, 0) if equation.one_sided else push
    demand = friction_demand(pushed, 1 + lift)
    return equation.uplift_excess(strength, lift), side, demand, 1 + lift
