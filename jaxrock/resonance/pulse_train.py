"""Trains of instantaneous pulses: the block rocks freely, and through impacts, between them."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..host import Printed, listed
from ..impact import velocity_after_impact
from ..numerics import larger
from ..validation import (
    FINITE,
    NON_NEGATIVE,
    UNIT_INTERVAL,
    Booleans,
    Number,
    Numbers,
    Reals,
    as_real,
    check,
    check_kind,
    of_one_precision,
)
from .free_rocking import Linearized, ModelLike, RockingModel, as_model

_MAX_IMPACTS = 10**5


class Flight(NamedTuple):
    """The state of a block between two impacts, velocities over the critical one.

    The squares of the two add up to its energy.
    """

    drop: Reals  # outward velocity lost to gravity since the ground, 0 there
    q: Reals  # outward velocity

    @property
    def x(self) -> Reals:
        """Velocity with which it left the ground and lands."""
        energy = self.drop**2 + self.q**2
        moves = energy > 0
        return jnp.where(moves, jnp.sqrt(jnp.where(moves, energy, 1)), 0)


class Rocker(NamedTuple):
    """A block between pulses; x is the launch velocity over the critical one."""

    block: Block
    restitution: Reals
    model: RockingModel

    @property
    def unit(self) -> Reals:
        """Intensity of the single pulse that just overturns [m/s]."""
        return self.model._critical_velocity(self.block) / self.block.pulse_velocity(1.0)

    def duration(self, x: Reals) -> Reals:
        """Duration of a half-cycle [s]; a long one where the block does not come back."""
        x = jnp.minimum(x, _largest_subcritical(x))
        return self.model._half_cycle_duration(self.block, x, x * self.unit)

    def on_flight(self, x: Reals, since: Reals, duration: Reals) -> Flight:
        """The state at a time since the launch [s] in a half-cycle; see `since_launch`."""
        left = duration - since
        falls = left < since
        # The way down is the way up reversed.
        velocity = jax.jvp(
            lambda time: self.model._rotation(self.block, x, time),
            (jnp.where(falls, left, since),),
            (jnp.ones_like(since),),
        )[1]
        q = jnp.clip(velocity / self.model._critical_velocity(self.block), 0, x)
        return Flight(jnp.sqrt((x - q) * (x + q)), jnp.where(falls, -q, q))

    def velocity_at(self, x: Reals, since: Reals, duration: Reals) -> Reals:
        """The velocity `on_flight`, strictly between launch and impact, with short derivatives.

        Those of Jacobi's functions take a minute to compile: they are of one step of Newton's.
        """
        if isinstance(self.model, Linearized):
            return self.on_flight(x, since, duration).q
        still, *at = jax.lax.stop_gradient((self, x, since, duration))
        q = jnp.clip(abs(still.on_flight(*at).q), 0, at[0] * (1 - jnp.finfo(x.dtype).eps))
        flight, falls = Flight(jnp.sqrt((x - q) * (x + q)), q), duration - since < since
        late = self.ground_time(flight) - jnp.where(falls, duration - since, since)
        lever = jnp.sin(still.block.critical_angle - still.rotation(flight))
        slowing = lever * still.block.frequency_parameter**2
        q = q + jax.lax.stop_gradient(slowing) / still.model._critical_velocity(still.block) * late
        return jnp.where(falls, -q, q)

    def rotation(self, flight: Flight) -> Reals:
        """Rotation from its side [rad]: the peak of a launch with the velocity lost."""
        drop = jnp.minimum(flight.drop, _largest_subcritical(flight.drop))
        return self.model._peak_rotation(self.block, drop, drop * self.unit)

    def ground_time(self, flight: Flight) -> Reals:
        """Time since the launch or, on the way down, to the impact [s]."""
        rotation = self.rotation(flight)
        return self.model._time_from_ground(self.block, rotation, flight.x, abs(flight.q))

    def since_launch(self, flight: Flight, duration: Reals) -> Reals:
        """Time since the launch [s], in a half-cycle of a duration.

        A block that falls faster than critical was never launched from the ground: on the
        way down, what counts is the time to the impact.
        """
        time = self.ground_time(flight)
        return jnp.where(flight.q < 0, duration - time, time)

    def struck(self, flight: Flight, impulse: Reals) -> Flight:
        """The state after an outward pulse, its intensity over `unit`.

        Linearized, a pulse acts the same at all rotations (Eq. 2). In the full equation it
        turns the block the more, the more upright the diagonal to the corner is.
        """
        if isinstance(self.model, Linearized):
            return flight._replace(q=flight.q + impulse)
        angle = self.block.critical_angle
        factor = jnp.cos(angle - self.rotation(flight)) / jnp.cos(angle)
        return flight._replace(q=flight.q + impulse * factor)


def _largest_subcritical(x: Reals) -> float:
    """The largest x of which a duration is computed: at 1 it is infinite."""
    return 1 - float(jnp.finfo(x.dtype).eps) ** 0.6


class TrainResponse(Printed, eqx.Module):
    """Response of a block to a train of pulses.

    Attributes
    ----------
    velocity_ratio, side : Array, shape (pulses,)
        After each pulse, the velocity with which the block would have left the ground (and
        will land) over the critical one [-]; to which side it is rotated, 1 or -1, 0 at rest.
    peak_rotation : Array
        Largest rotation, also after the last pulse [rad]; pi / 2 if it overturns.
    overturned, complete : Array of bool
        Whether it has ever moved outward with more energy than the barrier, even if a later
        pulse would have caught it. False if there were too many impacts to follow: then the
        numbers are NaN.
    """

    velocity_ratio: Reals
    peak_rotation: Reals
    overturned: Booleans
    side: Reals
    complete: Booleans

    def __str__(self) -> str:
        return listed(self, overturned="", peak_rotation="rad", velocity_ratio="", complete="")


def respond_to_train(
    block: Block,
    restitution: Number,
    times: Numbers,
    intensities: Numbers,
    model: ModelLike = Linearized(),
) -> TrainResponse:
    """Response of one block to instantaneous pulses at given times, through every impact.

    Parameters
    ----------
    block, restitution : Block, float
        One block and its C [-], between 0 and 1.
    times, intensities : array_like, shape (pulses,)
        When the pulses come [s], not decreasing, and I of each [m/s], pushing the block to
        positive rotations where positive.
    model : Linearized or Nonlinear
        In the nonlinear equation a pulse acts ``cos(alpha_c - alpha) / cos(alpha_c)`` times
        stronger on a rotated block than Eq. 2 says.

    Returns
    -------
    TrainResponse

    Raises
    ------
    ValueError
        If there are not as many times as intensities, the times decrease, or a concrete
        argument is out of range.

    Examples
    --------
    >>> import jaxrock as jr
    >>> train = jr.respond_to_train(jr.Block(0.4, 5.0), 0.7, [0.0, 0.6], [0.3, -0.3])
    >>> print(train.overturned, f"{train.peak_rotation:.4f} rad")
    False 0.0084 rad
    """
    c, t = as_real("restitution", restitution), as_real("times", times)
    pulses = as_real("intensities", intensities)
    check("restitution", c, UNIT_INTERVAL)
    check("times", t, NON_NEGATIVE)
    check("intensities", pulses, FINITE)
    check_kind("block", block, Block)
    block.check()
    if t.ndim != 1 or t.shape != pulses.shape or not t.size:
        raise ValueError(
            "times and intensities must be two lists of one length, got shapes"
            f" {t.shape} and {pulses.shape}"
        )
    if not isinstance(t, jax.core.Tracer) and (np.diff(np.asarray(t)) < 0).any():
        raise ValueError("times must not decrease")
    block, c, t, pulses = of_one_precision((block, c, t, pulses))
    return follow(Rocker(block, c, as_model(model)), t, pulses)


class _Motion(NamedTuple):
    x: Any  # launch velocity of the half-cycle, over the critical one
    duration: Any  # of the half-cycle
    since: Any  # time since its launch
    side: Any
    peak: Any  # rotation
    overturned: Any
    impacts: Any  # so far


@eqx.filter_jit
def follow(rocker: Rocker, times: Reals, intensities: Reals) -> TrainResponse:
    """`respond_to_train`, with nothing checked."""

    def pulse(motion: _Motion, interval_and_intensity: Any) -> Any:
        interval, intensity = interval_and_intensity
        now = _rocked(rocker, motion, interval)
        flight = rocker.on_flight(now.x, now.since, now.duration)
        peak = larger(now.peak, rocker.rotation(flight))
        side = jnp.where(now.side == 0, jnp.where(intensity < 0, -1, 1), now.side)
        flight = rocker.struck(flight, side * intensity / rocker.unit)
        x = flight.x
        duration = rocker.duration(x)
        after = now._replace(
            x=jnp.where(now.overturned, now.x, x),
            duration=duration,
            since=rocker.since_launch(flight, duration),
            side=side.astype(x.dtype),
            peak=peak,
            overturned=now.overturned | ((x >= 1) & (flight.q >= 0)),
        )
        return after, (x, now.side)

    zero = jnp.zeros_like(times[0])
    at_rest = _Motion(zero, zero, zero, zero, zero, zero > 1, jnp.zeros((), int))
    intervals = jnp.diff(times, prepend=times[:1])
    last, (ratios, sides) = jax.lax.scan(pulse, at_rest, (intervals, intensities))
    # A block that falls after the last pulse may leave the impact faster than it ever was.
    rises = last.since <= 0.5 * last.duration
    x = jnp.where(rises, last.x, velocity_after_impact(rocker.restitution, last.x))
    overturned, peak = last.overturned | (x >= 1), larger(last.peak, _peak(rocker, x))
    complete = last.impacts < _MAX_IMPACTS
    return TrainResponse(
        velocity_ratio=jnp.where(complete, ratios, jnp.nan),
        peak_rotation=jnp.where(complete, jnp.where(overturned, 0.5 * jnp.pi, peak), jnp.nan),
        overturned=overturned & complete,
        side=sides,
        complete=complete,
    )


def _rocked(rocker: Rocker, motion: _Motion, interval: Reals) -> _Motion:
    """Free rocking over an interval, through impacts."""
    # Below this velocity the block counts as resting: its impacts would never end.
    rest = float(jnp.finfo(motion.x.dtype).eps) ** 2

    def highest(motion: _Motion, until: Any) -> Any:
        """With the peak of this half-cycle, if the block passes it until then."""
        half = 0.5 * motion.duration
        passes = (motion.since <= half) & (until >= half)
        return jnp.where(passes, larger(motion.peak, _peak(rocker, motion.x)), motion.peak)

    def lands(carry: Any) -> Any:
        motion, left = carry
        goes_on = (motion.x > rest) & (motion.impacts < _MAX_IMPACTS) & ~motion.overturned
        return goes_on & (motion.since + left >= motion.duration)

    def impact(carry: Any) -> Any:
        motion, left = carry
        x = velocity_after_impact(rocker.restitution, motion.x)
        after = _Motion(
            x=x,
            duration=rocker.duration(x),
            since=jnp.zeros_like(x),
            side=-motion.side,
            peak=highest(motion, motion.duration),
            overturned=x >= 1,
            impacts=motion.impacts + 1,
        )
        return after, jnp.maximum(left - (motion.duration - motion.since), 0)

    motion, left = jax.lax.while_loop(lands, impact, (motion, interval))
    moves = motion.x > rest
    until = motion.since + left
    return motion._replace(
        x=jnp.where(moves, motion.x, 0),
        since=jnp.where(moves, until, 0),
        side=jnp.where(moves, motion.side, 0),
        peak=highest(motion, until),
    )


def _peak(rocker: Rocker, x: Reals) -> Reals:
    return rocker.rotation(Flight(x, jnp.zeros_like(x)))
