"""Trains in the rhythm of their own impacts: what they do, with slopes."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from .pulse_train import Flight, Rocker

SKIPS = 3  # impacts between two pulses, at most, as long as they need not be apart


class Train(NamedTuple):
    """A train as it is optimised; the first pulse starts the motion.

    `phase` says where a pulse comes in what is left of its half-cycle: 0 as early as it may,
    1 at the impact; in between, the cosine of the phase of the flight is what falls like
    the cosine of pi times it, since the energy after the pulse is linear in that. `skips` is
    how many impacts lie between a pulse and the one before, `weight` its intensity over the
    bound on it, outward positive.
    """

    phase: Any  # (pulses,)
    weight: Any  # (pulses,)
    skips: Any  # (pulses,) whole numbers


class Outcome(NamedTuple):
    """What a train does."""

    x: Any  # in the end; after the impact, if the block moves towards one
    times: Any  # (pulses,)
    sides: Any  # (pulses,) on which the block is struck
    late: Any  # (pulses,) time since the impact, in half-cycles
    lacking: Any  # (pulses,) by how much the half-cycle ends before the pulse may come [s]
    required: Any  # (pulses,) impacts within the spacing


def shot(
    rocker: Rocker,
    train: Train,
    strength: Any,
    *,
    timed: bool,
    spacing: Any = 0.0,
    length: Any = None,
    most: int = SKIPS,
) -> Outcome:
    """What a train does, with the bound on its pulses over `Rocker.unit`.

    Without the times, which cost most of it, if these are not asked for; then `spacing`,
    before which no pulse comes after the one before it [s], does not count. At most `most`
    impacts lie between two pulses; from the pulse `length` on, none is counted.
    """
    impulses = strength * train.weight
    rate = rocker.block.frequency_parameter
    number = jnp.arange(most + 1)
    powers = rocker.restitution ** number.astype(impulses.dtype)

    def pulse(carry: Any, each: Any) -> Any:
        phase, impulse, skips, counts = each
        flight, ground, time, side = carry
        again = skips == 0
        xs = flight.x * powers
        x = jnp.where(number == skips, xs, 0).sum()
        moves = x > 0
        earliest = jnp.where(again & moves, flight.q / jnp.where(moves, x, 1), 1)
        passed = late = lacking = last = jnp.zeros_like(x)
        required = jnp.zeros_like(skips)
        if timed:
            whole = rocker.duration(xs)
            launched = jnp.where(flight.q < 0, whole[0] - ground, ground)
            last = jnp.where(number == skips, whole, 0).sum()
            # From the pulse before to the launch of this flight, and from that on.
            passed = jnp.where(number < skips, whole, 0).sum() - launched
            wait = spacing - passed
            lacking = wait - last
            held = wait > jnp.where(again, launched, 0)
            inside = held & (lacking < 0) & moves
            fast = jnp.where(inside, x, 0.5)
            timed_at = jnp.where(inside, wait, 0.1 / rate), jnp.where(inside, last, 1 / rate)
            cosine = rocker.velocity_at(fast, *timed_at) / fast
            earliest = jnp.where(inside, cosine, jnp.where(held & moves, -1, earliest))
            required = (jnp.cumsum(whole) - launched < spacing).sum()
        # 1 + cosine and 1 - cosine of the phase of the flight.
        rise = (1 + earliest) * jnp.cos(0.5 * jnp.pi * phase) ** 2
        fall = (1 - earliest) + (1 + earliest) * jnp.sin(0.5 * jnp.pi * phase) ** 2
        inside = rise * fall > 0
        drop = x * jnp.where(inside, jnp.sqrt(jnp.where(inside, rise * fall, 1)), 0)
        there = Flight(drop, x * (rise - 1))
        struck = rocker.struck(there, impulse)
        ground_after = ground
        if timed:
            # Both at once, since to have each compiled for itself takes long.
            both = jax.tree.map(lambda *parts: jnp.stack(parts), there, struck)
            since, ground_after = rocker.ground_time(both)
            since = jnp.where(there.q < 0, last - since, since)
            time_after = time + passed + since
            late = since / jnp.where(last > 0, last, 1)
        else:
            time_after = time
        after = (struck, ground_after, time_after, jnp.where(skips % 2 == 1, -side, side))
        carry = jax.tree.map(lambda new, old: jnp.where(counts, new, old), after, carry)
        lacking = jnp.where(counts, lacking, -1)
        return carry, (carry[2], carry[3], late, lacking, required)

    first, zero = jnp.abs(impulses[0]), jnp.zeros_like(impulses[0])
    begin = (Flight(zero, first), zero, zero, zero + 1)
    counts = jnp.arange(1, impulses.size) < (impulses.size if length is None else length)
    (flight, *_), later = jax.lax.scan(
        pulse, begin, (train.phase[1:], impulses[1:], train.skips[1:], counts)
    )
    x = jnp.where(flight.q < 0, rocker.restitution * flight.x, flight.x)
    before = (zero, zero + 1, zero, zero - 1, jnp.zeros((), train.skips.dtype))
    return Outcome(
        x, *(jnp.append(b, a.astype(b.dtype)) for b, a in zip(before, later, strict=True))
    )
