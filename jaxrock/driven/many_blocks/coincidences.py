"""How far a derivative holds: the events before an answer, and how near they are to changing.

A derivative of an answer ends where an event appears, vanishes or changes places with another:
where an impact or a low point above the ground becomes the other, where another bounce becomes
the highest, where the input lifts the block at another moment. Each event has a margin that
vanishes there. To first order it does so at the distance ``margin / abs(slope of margin)``, on
the side on which it decreases.

The slope of a margin is its tangent, which exists in forward mode only. So the nearest
coincidences are kept in numbers that are 0 and whose tangents are the largest
``-slope / margin`` so far, one for each parameter: no derivatives, but maxima over events.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from ...numerics import pick_larger
from ...validation import Booleans, Integers, Reals
from .flight import StepFlight
from .ground_input import CountPerBlock, PerBlock

# Kinds of events, digits of the number that describes their sequence. It is exact in float32.
_IMPACT, _LOW, _INPUT_END = 1, 2, 3
_BASE = 31
_LARGEST = 2**22 - 1


class Nearest(NamedTuple):
    """The nearest coincidences on both sides, as tangents: 1 / distance above and below."""

    above: PerBlock
    below: PerBlock

    def include(self, margin: Reals, happens: Booleans) -> "Nearest":
        """Include an event with a margin, where it happens."""
        margin = jnp.where(happens, margin, jnp.inf)
        return Nearest(_approach(self.above, -margin), _approach(self.below, margin))


@jax.custom_jvp
def _approach(nearest: Reals, margin: Reals) -> Reals:
    del margin
    return nearest


@_approach.defjvp
def _keep_largest_rate(
    primals: tuple[Reals, Reals], tangents: tuple[Reals, Reals]
) -> tuple[Reals, Reals]:
    nearest, margin = primals
    rate, slope = tangents
    # Of a margin below 0 the sign turns the side; where it is 0 the coincidence is here.
    relative = slope / jnp.abs(jnp.where(margin == 0, jnp.finfo(margin.dtype).tiny, margin))
    return nearest, jnp.maximum(rate, jnp.where(slope == 0, 0, relative))


class AnswerEvents(NamedTuple):
    """What an answer has come from."""

    sequence: CountPerBlock  # of the events since the block was last lifted, as one number
    lifted: PerBlock  # time at which it was
    nearest: Nearest


class Coincidences(eqx.Module):
    """The events of a block so far, and those from which its answer comes."""

    now: AnswerEvents
    answer: AnswerEvents
    hump: PerBlock  # highest rotation since the last event
    before_hump: PerBlock  # highest rotation until the last event
    second: PerBlock  # the highest rotation of another hump than the highest one
    later: Nearest  # where a hump after the highest one becomes higher

    @classmethod
    def none(cls, zero: Reals) -> "Coincidences":
        """Return those of a block that has not moved."""
        events = AnswerEvents(jnp.zeros(zero.shape, jnp.int32), zero, Nearest(zero, zero))
        return cls(events, events, zero, zero, zero, events.nearest)

    def add_step(
        self,
        flight: StepFlight,
        begin: tuple[Reals, Reals, Reals],
        *,
        moves: Booleans,
        lifted: Booleans,
        settles: Booleans,
        time: Reals,
        input_ends: Booleans,
        counts: Booleans,
    ) -> "Coincidences":
        """Add the events of a step.

        `begin` are rotation, velocity and peak before the step, and `time` is when the block is
        `lifted`. The answer so far comes from this step where it `counts`.
        """
        rotation, velocity, peak = begin
        lands = moves & flight.lands
        low = moves & ~lands & (velocity < 0) & (flight.velocity > 0)
        # A top that is no new peak has not been located: under a constant deceleration it is
        # this high.
        turns = moves & (velocity > 0) & (flight.velocity <= 0)
        slowed = jnp.where(turns, velocity - flight.velocity, 1)
        top = rotation + 0.5 * velocity * velocity * flight.time / slowed
        top = jnp.where(turns, jnp.minimum(top, peak), 0)
        highest = pick_larger(pick_larger(self.hump, flight.highest), top)
        hump = jnp.where(moves, highest, self.hump)
        ends = lands | low
        is_peak = hump > self.before_hump
        other = jnp.where(is_peak, self.before_hump, hump)
        # All of them, not the highest alone: the later, the more they vary.
        later = self.later.include(peak - hump, ends & ~is_peak & (hump > 0))
        later = jax.tree.map(lambda rate: jnp.where(is_peak, 0, rate), later)

        def enter(sequence: Integers, happens: Booleans, kind: int) -> Integers:
            return jnp.where(happens, (_BASE * sequence + kind) & _LARGEST, sequence)

        sequence = enter(self.now.sequence, lands, _IMPACT)
        sequence = enter(sequence, low, _LOW)
        sequence = enter(sequence, moves & input_ends, _INPUT_END)
        # Near a grazing impact the square of its velocity is linear.
        nearest = self.now.nearest.include(flight.velocity**2, lands)
        nearest = nearest.include(flight.rotation, low)
        # A block that stands still has forgotten what was before.
        forgets = lifted | settles
        now = AnswerEvents(
            sequence=jnp.where(forgets, 0, sequence),
            lifted=jnp.where(lifted, time, self.now.lifted),
            nearest=jax.tree.map(lambda rate: jnp.where(forgets, 0, rate), nearest),
        )
        return Coincidences(
            now=now,
            answer=jax.tree.map(
                lambda new, old: jnp.where(counts, new, old), now, self.answer
            ),
            hump=jnp.where(ends, 0, hump),
            before_hump=jnp.where(ends, pick_larger(self.before_hump, hump), self.before_hump),
            second=jnp.where(ends, pick_larger(self.second, other), self.second),
            later=later,
        )

    def find_second_peak(self) -> Reals:
        """Find the second highest of all tops."""
        is_peak = self.hump > self.before_hump
        return pick_larger(self.second, jnp.where(is_peak, self.before_hump, self.hump))
