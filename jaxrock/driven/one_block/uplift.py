"""When the ground lifts a block that rests on it."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from ...ground_motion import Motion
from ...numerics import larger, largest
from ...validation import Booleans, Reals
from ..equation import Equation
from .contact_forces import friction

_SIDES = 1.0, -1.0


class Uplifts(eqx.Module):
    """A ground motion at its knots, between which the horizontal acceleration is monotone."""

    equation: Equation
    motion: Motion
    knots: Reals
    lifted: Booleans  # (2, knots): whether a block at rest would be, to each side
    demand: Reals  # of friction by a block at rest
    normal: Reals
    lasting: Reals  # time for which a block that has been lifted stays so

    @classmethod
    def of(cls, equation: Equation, motion: Motion) -> "Uplifts":
        """Make the table of a motion."""
        knots = motion.knots()
        push, lift = (a / equation.gravity for a in motion.value(knots))
        lifted = jnp.stack([equation.uplift_excess(side * push, lift) > 0 for side in _SIDES])
        # Little beside the block's own time and that in which the input changes.
        intervals = jnp.maximum(jnp.sum(knots < motion.end), 1).astype(knots.dtype)
        changes = (motion.end - motion.start) / intervals
        lasting = 1e-6 * jnp.minimum(1 / jnp.sqrt(equation.p_squared), changes)
        forces = friction(push, 1 + lift), 1 + lift
        return cls(equation, motion, knots, lifted, *forces, jax.lax.stop_gradient(lasting))

    def next_knot(self, time: Reals, stop: Reals) -> Reals:
        """Return the first knot after a time, or `stop` if that is earlier."""
        return jnp.min(self.knots, initial=stop, where=self.knots > time)

    def following(self, time: Reals, stop: Reals) -> tuple[Booleans, Reals, Reals]:
        """Whether, when and to which side a block that rests at `time` is lifted before `stop`."""
        later = self.lifted.any(axis=0) & (self.knots > time) & (self.knots <= self.motion.end)
        index = jnp.argmax(later)
        found = later.any()
        upper = self.knots[index]
        lower = larger(time, self.knots[jnp.maximum(index - 1, 0)])
        sides = jnp.asarray(_SIDES, self.knots.dtype)
        both = jnp.ones_like(sides)
        inputs = (self.equation, self.motion)
        fixed, (now, begin, end) = jax.lax.stop_gradient((inputs, (time, lower, upper)))
        excess_now = _excess(*fixed, both * now)
        at_once = (excess_now > 0).any()

        def halve(_: Any, bracket: tuple[Reals, Reals]) -> tuple[Reals, Reals]:
            middle = 0.5 * (bracket[0] + bracket[1])
            below = _excess(*fixed, begin + middle * (end - begin)) < 0
            return jnp.where(below, middle, bracket[0]), jnp.where(below, bracket[1], middle)

        # Halved down to rounding. Where the ground falls away, both sides are lifted between
        # the same knots: the first one counts.
        bits = jnp.finfo(self.knots.dtype).nmant
        ends = jnp.zeros_like(excess_now), jnp.ones_like(excess_now)
        bracket = jax.lax.fori_loop(0, bits, halve, ends)
        first = jnp.argmin(jnp.where(self.lifted[:, index], bracket[1], jnp.inf))
        bracketed = found & (_excess(*fixed, both * begin)[first] < 0) & ~at_once

        def excess(share: Reals) -> Reals:
            return _excess(*inputs, both * (lower + share * (upper - lower)))[first]

        def newton(_: Any, share: Reals) -> Reals:
            value, slope = jax.jvp(excess, (share,), (jnp.ones_like(share),))
            move = jnp.where(slope > 0, value / jnp.where(slope > 0, slope, 1), 0)
            # The derivative counts also where the input is all but flat and the value must
            # not.
            near = jnp.abs(move) <= 1e-3
            return share - jnp.where(near, move, move - jax.lax.stop_gradient(move))

        # Newton's method twice, for two derivatives.
        share = jax.lax.fori_loop(0, 2, newton, bracket[1][first])
        when = jnp.where(bracketed, lower + share * (upper - lower), lower)
        when = jnp.where(at_once, time, when)
        stronger = jnp.where(excess_now[0] >= excess_now[1], sides[0], sides[1])
        return (
            (found | at_once) & (when < stop),
            when,
            jnp.where(at_once, stronger, sides[first]),
        )

    def forces(self, time: Reals, until: Reals, acts: Booleans) -> tuple[Reals, Reals]:
        """Largest friction demand and smallest normal force of a block at rest in between."""
        ends = jnp.stack([time, until])
        push, lift = (
            jnp.where(acts, a / self.equation.gravity, 0) for a in self.motion.value(ends)
        )
        between = acts & (self.knots >= time) & (self.knots <= until)
        demand = jnp.where(between, self.demand, 0)
        normal = jnp.where(between, self.normal, jnp.inf)
        demands = jnp.concatenate([friction(push, 1 + lift), demand])
        return largest(demands), -largest(-jnp.concatenate([1 + lift, normal]))


# Jitted, so that it enters the program once for each shape of its arguments.
@jax.jit
def _excess(equation: Equation, motion: Motion, time: Reals) -> Reals:
    """Push on either side, at a time for each, beyond the one that lifts the block."""
    push, lift = (a / equation.gravity for a in motion.value(time))
    return equation.uplift_excess(jnp.asarray(_SIDES, time.dtype) * push, lift)
