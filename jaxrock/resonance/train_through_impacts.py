"""Trains whose pulses are timed by the impacts of the block: what they do, with derivatives."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from ..impact import velocity_after_impact
from ..validation import Booleans, Integers, Reals
from .pulse_train import Flight, Rocker

MAX_IMPACTS = 20  # between two pulses


class Train(NamedTuple):
    """Arrays of shape (pulses,); the first pulse starts the motion.

    `phase` is 0 where a pulse comes as early in its half-cycle as it may, 1 at the impact. In
    between, the cosine of the phase of the flight falls like the cosine of pi times it: the
    energy after the pulse is linear in that.
    """

    phase: Reals
    impulse: Reals  # intensity over `Rocker.unit`, outward positive
    impacts: Integers  # whole numbers, between a pulse and the one before


class Outcome(NamedTuple):
    """What a train does; all but x of shape (pulses,)."""

    x: Reals  # in the end; after the impact, if the block moves towards one
    times: Reals
    sides: Reals  # on which the block is struck
    delays: Reals  # since the impact, in half-cycles
    lacking: Reals  # by how much the half-cycle ends before the pulse may come [s]
    required: Integers  # impacts within the spacing


@jax.jit
def evaluate(
    numbers: Reals, impacts: Integers, count: Integers, rocker: Rocker, spacing: Reals
) -> tuple[Outcome, Reals, Reals]:
    """Compute what the train of optimised numbers does, and what is limited, with derivatives.

    The numbers are the phases, the impulses over a bound and the logarithm of that bound.
    Limited are the logarithm of x, what is lacking for each pulse, and the time of the last.
    """

    def limited(numbers: Reals) -> tuple[Reals, tuple[Outcome, Reals]]:
        phases, weights, log_bound = jnp.split(numbers, [impacts.size, 2 * impacts.size])
        train = Train(phases, jnp.exp(log_bound) * weights, impacts)
        outcome = shot(rocker, train, spacing, count)
        log_x = jnp.log(jnp.maximum(outcome.x, 1e-30))
        values = jnp.concatenate([log_x[None], outcome.lacking, outcome.times[-1:]])
        return values, (outcome, values)

    numbers = numbers.astype(rocker.restitution.dtype)
    slopes, (outcome, values) = jax.jacfwd(limited, has_aux=True)(numbers)
    return outcome, values, slopes


def shot(rocker: Rocker, train: Train, spacing: Any = 0.0, count: Any = None) -> Outcome:
    """Compute what a train does whose pulses come at least `spacing` apart [s].

    Pulses from the number `count` on do not come.
    """
    number = jnp.arange(MAX_IMPACTS + 1)
    powers = rocker.restitution ** number.astype(train.impulse.dtype)

    def pulse(carry: Any, each: Any) -> Any:
        phase, impulse, impacts, comes = each
        flight, ground_time, time, side = carry
        xs = flight.x * powers
        x = jnp.where(number == impacts, xs, 0).sum()
        moves = x > 0
        earliest = jnp.where((impacts == 0) & moves, flight.q / jnp.where(moves, x, 1), 1)
        durations = rocker.duration(xs)
        launched = jnp.where(flight.q < 0, durations[0] - ground_time, ground_time)
        duration = jnp.where(number == impacts, durations, 0).sum()
        # Time from the pulse before to the launch of this half-cycle.
        passed = jnp.where(number < impacts, durations, 0).sum() - launched
        wait = spacing - passed
        lacking = wait - duration
        waits = wait > jnp.where(impacts == 0, launched, 0)
        earliest = _cosine_after(rocker, x, wait, duration, waits, earliest)
        # No cumulative sum: on CPUs it takes as long as all else.
        ends = jnp.where(number[:, None] >= number[None], durations[None], 0).sum(axis=1)
        required = (ends - launched < spacing).sum()
        # 1 + cosine and 1 - cosine of the phase of the flight, each without cancellation.
        rise = (1 + earliest) * jnp.cos(0.5 * jnp.pi * phase) ** 2
        fall = (1 - earliest) + (1 + earliest) * jnp.sin(0.5 * jnp.pi * phase) ** 2
        inside = rise * fall > 0
        drop = x * jnp.where(inside, jnp.sqrt(jnp.where(inside, rise * fall, 1)), 0)
        before = Flight(drop, x * (rise - 1))
        after = rocker.struck(before, impulse)
        # Both in one call, since to have each compiled for itself takes long.
        both = jax.tree.map(lambda *parts: jnp.stack(parts), before, after)
        since, ground_time = rocker.ground_time(both)
        since = jnp.where(before.q < 0, duration - since, since)
        time = time + passed + since
        delay = since / jnp.where(duration > 0, duration, 1)
        new = (after, ground_time, time, jnp.where(impacts % 2 == 1, -side, side))
        carry = jax.tree.map(lambda new, old: jnp.where(comes, new, old), new, carry)
        lacking = jnp.where(comes, lacking, -1)
        return carry, (carry[2], carry[3], delay, lacking, required)

    zero = jnp.zeros_like(train.impulse[0])
    size = train.impulse.size
    first = (Flight(zero, abs(train.impulse[0])), zero, zero, zero + 1)
    comes = jnp.arange(1, size) < (size if count is None else count)
    (flight, *_), later = jax.lax.scan(pulse, first, (*(part[1:] for part in train), comes))
    x = jnp.where(flight.q < 0, velocity_after_impact(rocker.restitution, flight.x), flight.x)
    of_first = (zero, zero + 1, zero, zero - 1, jnp.zeros((), train.impacts.dtype))
    columns = (jnp.append(b, a.astype(b.dtype)) for b, a in zip(of_first, later, strict=True))
    return Outcome(x, *columns)


def _cosine_after(
    rocker: Rocker, x: Reals, wait: Reals, duration: Reals, waits: Booleans, otherwise: Reals
) -> Reals:
    """Cosine of the phase of the flight after a wait since the launch, at its end at most."""
    inside = waits & (wait < duration) & (x > 0)
    rate = rocker.block.frequency_parameter
    # Elsewhere some flight whose derivatives are finite.
    fast = jnp.where(inside, x, 0.5)
    duration = jnp.where(inside, duration, 1 / rate)
    cosine = rocker.velocity_at(fast, jnp.where(inside, wait, 0.1 / rate), duration) / fast
    return jnp.where(inside, cosine, jnp.where(waits & (x > 0), -1, otherwise))
