"""Trains whose pulses are timed by the impacts of the block, with derivatives.

A pulse has a place in a given half-cycle instead of a time. The number of impacts between two
pulses is a constant then, and everything a train does is a smooth function of the places and
intensities of its pulses: it can be optimised.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp

from ..impact import require_linear_law, side_after_impact
from ..validation import Booleans, Integers, Reals
from .pulse_train import Flight, Rocker

MAX_IMPACTS = 20  # between two pulses


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
        Intensity over `Rocker.unit`, outward positive [-].
    impacts
        Number of impacts between a pulse and the one before.
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
    required
        Number of impacts within the spacing, from the pulse before on.
    """

    x: Reals
    times: Reals
    sides: Reals
    delays: Reals
    lacking: Reals
    required: Integers


class Evaluation(NamedTuple):
    """The outcome of a train and its limited values, with derivatives.

    Attributes
    ----------
    outcome
        The outcome of the train.
    values
        The logarithm of x, `lacking` of each pulse, and the time of the last pulse,
        (pulses + 2,).
    slopes
        Derivatives of the values with respect to the numbers that are optimised.
    """

    outcome: Outcome
    values: Reals
    slopes: Reals


class _AfterPulse(NamedTuple):
    """The motion right after a pulse."""

    flight: Flight
    from_ground: Reals  # `Rocker.time_from_ground` of the flight [s]
    time: Reals  # since the first pulse [s]
    side: Reals


class _TrainPulse(NamedTuple):
    """A pulse of a `Train`; `comes` is False where it is left out."""

    phase: Reals
    impulse: Reals
    impacts: Integers
    comes: Booleans


@functools.partial(jax.jit, static_argnames="most_impacts")
def evaluate_with_slopes(
    numbers: Reals,
    impacts: Integers,
    count: Integers,
    rocker: Rocker,
    spacing: Reals,
    most_impacts: int,
) -> Evaluation:
    """Compute the outcome of a train from the numbers that are optimised, with derivatives.

    Parameters
    ----------
    numbers
        Phases, impulses over a bound, and the logarithm of that bound, (2 pulses + 1,).
    impacts
        Impacts between a pulse and the one before, (pulses,).
    count
        Pulses that come; the others are left out.
    rocker, spacing
        The block, and the shortest time between two pulses [s].
    most_impacts
        Most impacts between two pulses.
    """

    def compute_limited(numbers: Reals) -> tuple[Reals, tuple[Reals, Outcome]]:
        """Compute the values, and once more to pass on undifferentiated, with the outcome."""
        phases, weights, log_bound = jnp.split(numbers, [impacts.size, 2 * impacts.size])
        train = Train(phases, jnp.exp(log_bound) * weights, impacts)
        outcome = follow_phased_train(rocker, train, spacing, count, most_impacts)
        # A train may leave the block at rest, and 0 has no logarithm.
        log_x = jnp.log(jnp.maximum(outcome.x, 1e-30))
        values = jnp.concatenate([log_x[None], outcome.lacking, outcome.times[-1:]])
        return values, (values, outcome)

    numbers = numbers.astype(rocker.restitution.dtype)
    slopes, (values, outcome) = jax.jacfwd(compute_limited, has_aux=True)(numbers)
    return Evaluation(outcome, values, slopes)


def follow_phased_train(
    rocker: Rocker,
    train: Train,
    spacing: Reals | float = 0.0,
    count: Integers | int | None = None,
    most_impacts: int = MAX_IMPACTS,
) -> Outcome:
    """Compute the outcome of a train whose pulses come at least `spacing` apart [s].

    Pulses from the number `count` on do not come. All half-cycles up to `most_impacts` after a
    pulse are computed, so a smaller number makes a faster program.
    """
    require_linear_law()
    number = jnp.arange(most_impacts + 1)
    powers = rocker.restitution ** number.astype(train.impulse.dtype)

    def advance_to_pulse(
        last: _AfterPulse, pulse: _TrainPulse
    ) -> tuple[_AfterPulse, tuple[Reals, Reals, Reals, Reals, Integers]]:
        """Go from right after a pulse to right after the next; list what `Outcome` lists."""
        phase, impulse, impacts, comes = pulse
        flight, from_ground, time, side = last

        # The half-cycle of the pulse: its launch velocity and its duration. Number 0 is the
        # half-cycle of the pulse before. All there can be are computed, and one is picked.
        xs = flight.x * powers
        x = jnp.where(number == impacts, xs, 0).sum()
        moves = x > 0
        # With no impact in between, the phase of the flight right after the pulse before is
        # the earliest.
        earliest = jnp.where((impacts == 0) & moves, flight.q / jnp.where(moves, x, 1), 1)
        durations = rocker.duration(xs)
        launched = jnp.where(flight.q < 0, durations[0] - from_ground, from_ground)
        duration = jnp.where(number == impacts, durations, 0).sum()
        # Time from the pulse before to the launch of this half-cycle.
        passed = jnp.where(number < impacts, durations, 0).sum() - launched

        # The spacing may be over only later in the half-cycle, or after its end.
        wait = spacing - passed
        lacking = wait - duration
        waits = wait > jnp.where(impacts == 0, launched, 0)
        earliest = _phase_cosine_after(rocker, x, wait, duration, waits, earliest)
        # No cumulative sum: on CPUs it takes as long as all else.
        ends = jnp.where(number[:, None] >= number[None], durations[None], 0).sum(axis=1)
        required = (ends - launched < spacing).sum()

        # 1 + cosine and 1 - cosine of the phase of the flight, each without cancellation.
        rise = (1 + earliest) * jnp.cos(0.5 * jnp.pi * phase) ** 2
        fall = (1 - earliest) + (1 + earliest) * jnp.sin(0.5 * jnp.pi * phase) ** 2
        inside = rise * fall > 0
        drop = x * jnp.where(inside, jnp.sqrt(jnp.where(inside, rise * fall, 1)), 0)
        before = Flight(drop, x * (rise - 1))
        after = rocker.apply_pulse(before, impulse)

        # Both in one call, since to have each compiled for itself takes long.
        both = jax.tree.map(lambda *parts: jnp.stack(parts), before, after)
        since, from_ground = rocker.time_from_ground(both)
        since = jnp.where(before.q < 0, duration - since, since)
        time = time + passed + since
        delay = since / jnp.where(duration > 0, duration, 1)
        other_side = side_after_impact(rocker.block.one_sided, side)
        side = jnp.where(impacts % 2 == 1, other_side, side)
        new = _AfterPulse(after, from_ground, time, side)
        # A pulse that is left out changes nothing, and lacks nothing.
        new = jax.tree.map(lambda new, old: jnp.where(comes, new, old), new, last)
        lacking = jnp.where(comes, lacking, -1)
        return new, (new.time, new.side, delay, lacking, required)

    zero = jnp.zeros_like(train.impulse[0])
    size = train.impulse.size
    first = _AfterPulse(Flight(zero, abs(train.impulse[0])), zero, zero, zero + 1)
    comes = jnp.arange(1, size) < (size if count is None else count)
    later_pulses = _TrainPulse(train.phase[1:], train.impulse[1:], train.impacts[1:], comes)
    (flight, *_), later = jax.lax.scan(advance_to_pulse, first, later_pulses)
    x = jnp.where(flight.q < 0, rocker.launch_after_impact(flight.x), flight.x)
    # The first pulse keeps any spacing: what it lacks is negative, and nothing is required.
    first_values = (zero, zero + 1, zero, zero - 1, jnp.zeros((), train.impacts.dtype))
    columns = (
        jnp.append(b, a.astype(b.dtype)) for b, a in zip(first_values, later, strict=True)
    )
    return Outcome(x, *columns)


def _phase_cosine_after(
    rocker: Rocker, x: Reals, wait: Reals, duration: Reals, waits: Booleans, otherwise: Reals
) -> Reals:
    """Compute the cosine of the phase of a flight after a wait since its launch [s].

    It is -1, as at the end, after a longer wait than the flight, and `otherwise` without one.
    """
    inside = waits & (wait < duration) & (x > 0)
    rate = rocker.block.frequency_parameter
    # Elsewhere some flight whose derivatives are finite.
    fast = jnp.where(inside, x, 0.5)
    duration = jnp.where(inside, duration, 1 / rate)
    cosine = rocker.velocity_at(fast, jnp.where(inside, wait, 0.1 / rate), duration) / fast
    return jnp.where(inside, cosine, jnp.where(waits & (x > 0), -1, otherwise))
