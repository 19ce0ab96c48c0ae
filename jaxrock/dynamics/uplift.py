"""When the ground lifts a block that rests on it."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from ..ground_motion import Motion
from ..validation import Reals
from .contact_forces import friction, larger, largest
from .equation import Equation

_SIDES = 1.0, -1.0


class Uplifts(eqx.Module):
    """What is known of a motion at its knots, once for all times at which a block rests."""

    equation: Equation
    motion: Motion
    knots: Reals
    lifted: Any  # whether it would be there, for each side
    demand: Reals  # of friction, by a block at rest
    normal: Reals

    @classmethod
    def of(cls, equation: Equation, motion: Motion) -> "Uplifts":
        """The table of a motion."""
        knots = motion.knots()
        push, lift = (a / equation.gravity for a in motion.value(knots))
        lifted = jnp.stack([equation.lifting(side * push, lift) > 0 for side in _SIDES])
        return cls(equation, motion, knots, lifted, friction(push, 1 + lift), 1 + lift)

    def excess(self, time: Reals) -> Reals:
        """What the ground gives to either side, at a time for each, over what lifts the block."""
        return _excess(self.equation, self.motion, time)

    def following(self, time: Reals, stop: Reals) -> tuple[Any, Reals, Reals]:
        """Whether, when and to which side a block that rests at `time` is lifted before `stop`."""
        later = self.lifted.any(axis=0) & (self.knots > time) & (self.knots <= self.motion.end)
        index, found = jnp.argmax(later), later.any()
        upper = self.knots[index]
        lower = larger(time, self.knots[jnp.maximum(index - 1, 0)])
        sides = jnp.asarray(_SIDES, self.knots.dtype)
        both = jnp.ones_like(sides)
        still, edges = jax.lax.stop_gradient((self, (time, lower, upper)))
        now = still.excess(both * edges[0])
        at_once = (now > 0).any()

        def halve(_: Any, bracket: Any) -> Any:
            middle = 0.5 * (bracket[0] + bracket[1])
            below = still.excess(edges[1] + middle * (edges[2] - edges[1])) < 0
            return jnp.where(below, middle, bracket[0]), jnp.where(below, bracket[1], middle)

        # Halved down to rounding. Where the ground falls away both sides are lifted: the first.
        bits = jnp.finfo(self.knots.dtype).nmant
        bracket = jax.lax.fori_loop(0, bits, halve, (jnp.zeros_like(now), jnp.ones_like(now)))
        first = jnp.argmin(jnp.where(self.lifted[:, index], bracket[1], jnp.inf))
        side = sides[first]
        bracketed = found & (still.excess(both * edges[1])[first] < 0) & ~at_once

        def beyond(share: Any) -> Any:
            return self.excess(both * (lower + share * (upper - lower)))[first]

        def polish(_: Any, share: Any) -> Any:
            value, slope = jax.jvp(beyond, (share,), (jnp.ones_like(share),))
            move = jnp.where(slope > 0, value / jnp.where(slope > 0, slope, 1), 0)
            # Its derivative counts, also where the input is all but flat.
            near = jnp.abs(move) <= 1e-3
            return share - jnp.where(near, move, move - jax.lax.stop_gradient(move))

        # Twice Newton's method, for two derivatives.
        share = jax.lax.fori_loop(0, 2, polish, bracket[1][first])
        when = jnp.where(bracketed, lower + share * (upper - lower), lower)
        when = jnp.where(at_once, time, when)
        side = jnp.where(at_once, jnp.where(now[0] >= now[1], sides[0], sides[1]), side)
        return (found | at_once) & (when < stop), when, side

    def at_rest(self, time: Reals, until: Reals, acts: Any) -> tuple[Reals, Reals]:
        """Largest friction demand and smallest normal force of a block at rest in between.

        The ground holds it: only what the ground gives counts.
        """
        ends = jnp.stack([time, until])
        push, lift = (
            jnp.where(acts, a / self.equation.gravity, 0) for a in self.motion.value(ends)
        )
        between = acts & (self.knots >= time) & (self.knots <= until)
        demand = jnp.where(between, self.demand, 0)
        normal = jnp.where(between, self.normal, jnp.inf)
        demands = jnp.concatenate([friction(push, 1 + lift), demand])
        return largest(demands), -largest(-jnp.concatenate([1 + lift, normal]))


@jax.jit
def _excess(equation: Equation, motion: Motion, time: Reals) -> Reals:
    push, lift = (a / equation.gravity for a in motion.value(time))
    return equation.lifting(jnp.asarray(_SIDES, time.dtype) * push, lift)
