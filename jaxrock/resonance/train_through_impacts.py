"""Trains whose pulses are timed by the impacts of the block.

A pulse has a place in a given half-cycle instead of a time. The number of impacts between two
pulses is a constant then, and everything a train does is a smooth function of the places and
intensities of its pulses: it can be optimised.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from ..impact import require_linear_law, side_after_impact
from ..numerics import select_tree
from ..validation import Booleans, Integers, Reals
from .rocker import Flight, Rocker, root_or_zero


class Train(NamedTuple):
    """A train of pulses, in arrays of shape (pulses,); the first pulse starts the motion.

    The phase of a flight is the angle whose cosine is outward velocity over launch velocity:
    0 at the launch, pi at the impact.

    Attributes
    ----------
    phase
        0 where a pulse comes as early in its half-cycle as it may, 1 at the impact. In
        between, the cosine of the phase of the flight falls like the cosine of pi times this
        number: linearized, the energy after the pulse is linear in that cosine.
    impulse
        Intensity over `Rocker.unit`, outward positive [-]. A pulse of size 0 is left out.
    impacts
        Impacts between a pulse and the one before.
    """

    phase: Reals
    impulse: Reals
    impacts: Integers


class Outcome(NamedTuple):
    """The motion of a block under a train of pulses, in arrays of shape (pulses,).

    Attributes
    ----------
    x
        One number: the velocity in the end over the critical one, after the impact if the
        block moves towards one [-].
    times, sides
        Times of the pulses [s], and sides on which the block is struck, 1 or -1.
    delays
        Time since the impact, in half-cycles [-].
    lacking
        By how much a half-cycle ends before its pulse may come [s].
    impacts
        Impacts between a pulse and the one before.
    """

    x: Reals
    times: Reals
    sides: Reals
    delays: Reals
    lacking: Reals
    impacts: Integers


class _AfterPulse(NamedTuple):
    """The motion right after a pulse."""

    flight: Flight
    from_ground: Reals  # `Rocker.time_from_ground` of the flight [s]
    time: Reals  # since the first pulse [s]
    side: Reals


def follow_phased_train(
    rocker: Rocker, train: Train, spacing: Reals | float, most_impacts: int, waits: Booleans
) -> Outcome:
    """Compute the outcome of a train whose pulses come at least `spacing` apart [s].

    If the train `waits`, there are as many more impacts between two pulses as the spacing takes.
    All half-cycles up to `most_impacts` after a pulse are computed, so a smaller number makes a
    faster program.
    """
    require_linear_law()
    number = jnp.arange(most_impacts + 1)
    powers = rocker.restitution ** number.astype(train.impulse.dtype)

    def advance_to_pulse(
        last: _AfterPulse, pulse: Train
    ) -> tuple[_AfterPulse, tuple[Reals, Reals, Reals, Reals, Integers]]:
        """Go from right after a pulse to right after the next; list what `Outcome` lists."""
        flight, from_ground, time, side = last

        # Launch velocities and durations of all half-cycles in which the pulse may come. Number
        # 0 is the half-cycle of the pulse before.
        xs = flight.x * powers
        durations = rocker.duration(xs)
        launched = jnp.where(flight.q < 0, durations[0] - from_ground, from_ground)
        # No cumulative sum: on CPUs it takes as long as all else.
        ends = jnp.where(number[:, None] >= number[None], durations[None], 0).sum(axis=1)
        required = jnp.where(waits, (ends - launched < spacing).sum(), 0)
        impacts = jnp.clip(required, pulse.impacts, most_impacts)
        x = jnp.where(number == impacts, xs, 0).sum()
        duration = jnp.where(number == impacts, durations, 0).sum()
        # Time from the pulse before to the launch of this half-cycle.
        passed = jnp.where(number < impacts, durations, 0).sum() - launched

        # With no impact in between, the phase of the flight right after the pulse before is
        # the earliest; the spacing may be over only later in the half-cycle.
        moves = x > 0
        earliest = jnp.where((impacts == 0) & moves, flight.q / jnp.where(moves, x, 1), 1)
        wait = spacing - passed
        later = moves & (wait > jnp.where(impacts == 0, launched, 0))
        earliest = _phase_cosine_after(rocker, x, wait, duration, later, earliest)

        # 1 + cosine and 1 - cosine of the phase of the flight, each without cancellation.
        rise = (1 + earliest) * jnp.cos(0.5 * jnp.pi * pulse.phase) ** 2
        fall = (1 - earliest) + (1 + earliest) * jnp.sin(0.5 * jnp.pi * pulse.phase) ** 2
        before = Flight(x * root_or_zero(rise * fall), x * (rise - 1))
        after = rocker.apply_pulse(before, pulse.impulse)

        # Both in one call, since to have each compiled for itself takes long.
        both = jax.tree.map(lambda *parts: jnp.stack(parts), before, after)
        since, from_ground = rocker.time_from_ground(both)
        since = jnp.where(before.q < 0, duration - since, since)
        delay = since / jnp.where(duration > 0, duration, 1)
        other_side = side_after_impact(rocker.block.one_sided, side)
        side = jnp.where(impacts % 2 == 1, other_side, side)
        new = _AfterPulse(after, from_ground, time + passed + since, side)
        # A pulse that is left out changes nothing, and lacks nothing.
        comes = pulse.impulse != 0
        new = select_tree(comes, new, last)
        lacking = jnp.where(comes, wait - duration, -1)
        return new, (new.time, side, delay, lacking, impacts)

    zero = jnp.zeros_like(train.impulse[0])
    first = _AfterPulse(Flight(zero, abs(train.impulse[0])), zero, zero, zero + 1)
    later_pulses = jax.tree.map(lambda column: column[1:], train)
    (flight, *_), later = jax.lax.scan(advance_to_pulse, first, later_pulses)
    x = jnp.where(flight.q < 0, rocker.launch_after_impact(flight.x), flight.x)
    columns = (
        jnp.append(jnp.asarray(begin, column.dtype), column)
        for begin, column in zip((0, 1, 0, -1, 0), later, strict=True)
    )
    return Outcome(x, *columns)


def _phase_cosine_after(
    rocker: Rocker, x: Reals, wait: Reals, duration: Reals, waits: Booleans, otherwise: Reals
) -> Reals:
    """Compute the cosine of the phase of a flight after a wait since its launch [s].

    It is -1, as at the end, after a longer wait than the flight, and `otherwise` without one.
    """
    inside = waits & (wait < duration)
    rate = rocker.block.frequency_parameter
    # Elsewhere some flight whose derivatives are finite.
    fast = jnp.where(inside, x, 0.5)
    duration = jnp.where(inside, duration, 1 / rate)
    cosine = rocker.velocity_at(fast, jnp.where(inside, wait, 0.1 / rate), duration) / fast
    return jnp.where(inside, cosine, jnp.where(waits, -1, otherwise))
