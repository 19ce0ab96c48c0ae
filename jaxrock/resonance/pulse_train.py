"""Trains of instantaneous pulses: the block moves freely, and through impacts, between them."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..host import listed
from ..validation import (
    FINITE,
    NON_NEGATIVE,
    UNIT_INTERVAL,
    Number,
    Numbers,
    as_real,
    check,
    of_one_precision,
)
from .free_rocking import Linearized, ModelLike, RockingModel, as_model

_BOUNCES = 10**5


def _whole(x: Any) -> Any:
    """Of the critical velocity, at most, for the time that a flight takes."""
    return 1 - float(jnp.finfo(x.dtype).eps) ** 0.6


class Flight(NamedTuple):
    """Where a block is on a free flight.

    Attributes
    ----------
    drop : Array
        Outward velocity that it has lost to gravity since the ground, over the critical one,
        so that the squares of `drop` and `q` add up to its energy: 0 on the ground.
    q : Array
        Outward velocity, over the critical one.
    """

    drop: Any
    q: Any

    @property
    def x(self) -> Any:
        """Velocity with which it left the ground and lands, over the critical one."""
        energy = self.drop**2 + self.q**2
        moves = energy > 0
        return jnp.where(moves, jnp.sqrt(jnp.where(moves, energy, 1)), 0)

    @property
    def phase(self) -> Any:
        """0 where it leaves the ground, 1/2 at the peak, 1 where it lands."""
        moves = (self.drop > 0) | (self.q != 0)
        return jnp.arctan2(self.drop, jnp.where(moves, self.q, 1)) / jnp.pi

    @classmethod
    def at(cls, x: Any, phase: Any) -> "Flight":
        """The point of a flight at a phase."""
        return cls(x * jnp.sin(jnp.pi * phase), x * jnp.cos(jnp.pi * phase))


class Rocker(NamedTuple):
    """A block between pulses."""

    block: Block
    restitution: Any
    model: RockingModel

    @property
    def unit(self) -> Any:
        """The intensity of the one pulse that just overturns [m/s]."""
        return self.model._critical_velocity(self.block) / self.block.pulse_velocity(1.0)

    def duration(self, x: Any) -> Any:
        """Of a half-cycle [s]; a long one of a flight that does not come back."""
        x = jnp.minimum(x, _whole(x))
        return self.model._half_cycle_duration(self.block, x, x * self.unit)

    def on_flight(self, x: Any, since: Any, whole: Any) -> Flight:
        """Where it is, some time after it was launched [s], on a flight of duration `whole`.

        See `since_launch`.
        """
        left = whole - since
        falls = left < since
        # The way down is the way up reversed.
        velocity = jax.jvp(
            lambda time: self.model._rotation(self.block, x, time),
            (jnp.where(falls, left, since),),
            (jnp.ones_like(since),),
        )[1]
        q = jnp.clip(velocity / self.model._critical_velocity(self.block), 0, x)
        return Flight(jnp.sqrt((x - q) * (x + q)), jnp.where(falls, -q, q))

    def velocity_at(self, x: Any, since: Any, whole: Any) -> Any:
        """What `on_flight` says of the velocity, where that is to be differentiated often.

        In the full equation by Newton's method, since the derivatives of Jacobi's functions
        take a minute to compile: over asinh(q / k) the time is all but linear. The last
        step carries the derivatives. Strictly within the flight only, of duration `whole`.
        """
        if isinstance(self.model, Linearized):
            return self.on_flight(x, since, whole).q
        falls = whole - since < since
        goal = jnp.where(falls, whole - since, since)
        k = jnp.sqrt(jnp.maximum((1 - x) * (1 + x), jnp.finfo(x.dtype).eps ** 0.6))
        rate = self.block.frequency_parameter
        unit = self.model._critical_velocity(self.block) / rate**2

        def closer(_: Any, s: Any) -> Any:
            s = jax.lax.stop_gradient(s)
            q = jnp.clip(k * jnp.sinh(s), 0, x * (1 - jnp.finfo(x.dtype).eps))
            lean = self.lean(Flight(jnp.sqrt((x - q) * (x + q)), q))
            time = self.model._time_from_ground(self.block, lean, x, q)
            slope = unit * k * jnp.cosh(s) / jnp.sin(self.block.critical_angle - lean)
            return s + (time - goal) / slope

        s = jax.lax.fori_loop(0, 7, closer, jnp.arcsinh(x / k) * (1 - 2 * goal / whole))
        q = jnp.clip(k * jnp.sinh(s), 0, x)
        return jnp.where(falls, -q, q)

    def lean(self, flight: Flight) -> Any:
        """Rotation on its side [rad]: a launch with the velocity lost leads just as high."""
        drop = jnp.minimum(flight.drop, _whole(flight.drop))
        return self.model._peak_rotation(self.block, drop, drop * self.unit)

    def since_launch(self, flight: Flight, whole: Any) -> Any:
        """Time since it left the ground [s], on a flight of duration `whole`.

        A block that falls towards the ground faster than critical was never launched from
        it: what counts is the time left.
        """
        time = self.ground_time(flight)
        return jnp.where(flight.q < 0, whole - time, time)

    def ground_time(self, flight: Flight) -> Any:
        """Time since it left the ground or, on the way down, until it lands [s]."""
        lean = self.lean(flight)
        return self.model._time_from_ground(self.block, lean, flight.x, abs(flight.q))

    def struck(self, flight: Flight, impulse: Any) -> Flight:
        """The flight after an outward pulse, its intensity over `unit`."""
        return flight._replace(q=flight.q + impulse * self.effect(flight))

    def effect(self, flight: Flight) -> Any:
        """What a pulse does to the velocity, over what it does on the ground.

        In the linearized equation it is the same everywhere (Eq. 2). In the full one it
        turns the block the more, the more upright the diagonal to the corner is.
        """
        if isinstance(self.model, Linearized):
            return jnp.ones_like(flight.q)
        angle = self.block.critical_angle
        return jnp.cos(angle - self.lean(flight)) / jnp.cos(angle)


class TrainResponse(NamedTuple):
    """What a block does under a train of pulses.

    Attributes
    ----------
    velocity_ratio : Array, shape (pulses,)
        After each pulse, the velocity with which the block would have left the ground (and
        will land) over the critical one [-].
    peak_rotation : Array
        Largest rotation, also after the last pulse [rad]; pi / 2 if it overturns.
    overturned : Array of bool
        Whether it overturns: has ever moved outward with more energy than the barrier, even
        if a later pulse would have caught it.
    side : Array, shape (pulses,)
        To which side it leans at each pulse, 1 or -1; 0 at rest.
    complete : Array of bool
        Whether all was followed; if not, for too many impacts, the rest is NaN.
    """

    velocity_ratio: Any
    peak_rotation: Any
    overturned: Any
    side: Any
    complete: Any

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
    block : Block
        One block.
    restitution : float
        C, velocity after an impact over velocity before it [-], between 0 and 1.
    times : array_like, shape (pulses,)
        When the pulses come [s], not decreasing.
    intensities : array_like, shape (pulses,)
        I of each [m/s], signed: a positive one pushes the block to positive rotations.
    model : Linearized or Nonlinear
        Equation of the motion between the pulses. In the full equation a pulse does more to
        a block that leans: ``cos(alpha_c - alpha) / cos(alpha_c)`` times what Eq. 2 says.

    Returns
    -------
    TrainResponse

    Raises
    ------
    ValueError
        If there are not as many times as intensities, if the times decrease, or if a
        concrete argument is out of range.

    Examples
    --------
    >>> import jaxrock as jr
    >>> block = jr.Block(0.4, 5.0)
    >>> train = jr.respond_to_train(block, 0.7, [0.0, 0.6], [0.3, -0.3])
    >>> print(train.overturned, f"{train.peak_rotation / block.critical_angle:.3f}")
    False 0.043
    """
    numbers = [
        as_real(name, value)
        for name, value in (
            ("restitution", restitution),
            ("times", times),
            ("intensities", intensities),
        )
    ]
    check("restitution", numbers[0], UNIT_INTERVAL)
    check("times", numbers[1], NON_NEGATIVE)
    check("intensities", numbers[2], FINITE)
    block.check()
    if numbers[1].ndim != 1 or numbers[1].shape != numbers[2].shape or not numbers[1].size:
        raise ValueError(
            "times and intensities must be two lists of one length, got shapes"
            f" {numbers[1].shape} and {numbers[2].shape}"
        )
    concrete = not isinstance(numbers[1], jax.core.Tracer)
    if concrete and (np.diff(np.asarray(numbers[1])) < 0).any():
        raise ValueError("times must not decrease")
    block, numbers = of_one_precision((block, numbers))
    return follow(Rocker(block, numbers[0], as_model(model)), numbers[1], numbers[2])


class _Moving(NamedTuple):
    x: Any  # of the flight
    whole: Any  # its duration
    since: Any  # its launch
    side: Any
    peak: Any
    over: Any
    bounces: Any


@eqx.filter_jit
def follow(rocker: Rocker, times: Any, intensities: Any) -> TrainResponse:
    """What `respond_to_train` does, with nothing checked."""
    zero = jnp.zeros_like(times[0])
    nothing = float(jnp.finfo(times.dtype).eps) ** 2

    def wait(state: _Moving, length: Any) -> _Moving:
        """Free motion, over impacts."""

        def lands(carry: Any) -> Any:
            state, left = carry
            again = (state.x > nothing) & (state.bounces < _BOUNCES) & ~state.over
            return again & (state.since + left >= state.whole)

        def land(carry: Any) -> Any:
            state, left = carry
            left = left - (state.whole - state.since)
            x = rocker.restitution * state.x
            rises = state.since <= 0.5 * state.whole
            peak = jnp.where(rises, jnp.maximum(state.peak, summit(state.x)), state.peak)
            return (
                _Moving(x, rocker.duration(x), zero, -state.side, peak, x >= 1, state.bounces + 1),
                jnp.maximum(left, 0),
            )

        state, left = jax.lax.while_loop(lands, land, (state, length))
        moves = state.x > nothing
        return state._replace(
            x=jnp.where(moves, state.x, 0),
            since=jnp.where(moves, state.since + left, 0),
            side=jnp.where(moves, state.side, 0),
        )

    def summit(x: Any) -> Any:
        return rocker.lean(Flight(x, jnp.zeros_like(x)))

    def pulse(state: _Moving, each: Any) -> Any:
        length, intensity = each
        before = state
        state = wait(state, length)
        flight = rocker.on_flight(state.x, state.since, state.whole)
        # The last peak was passed if it lies between the pulses.
        half = 0.5 * state.whole
        began = jnp.where(state.bounces == before.bounces, before.since, 0)
        reached = jnp.where((began <= half) & (state.since > half), summit(state.x), 0)
        reached = jnp.maximum(reached, rocker.lean(flight))
        side = jnp.where(state.side == 0, jnp.where(intensity < 0, -1, 1), state.side)
        flight = rocker.struck(flight, side * intensity / rocker.unit)
        x = flight.x
        over = state.over | ((x >= 1) & (flight.q >= 0))
        whole = rocker.duration(x)
        struck = _Moving(
            x=jnp.where(state.over, state.x, x),
            whole=whole,
            since=rocker.since_launch(flight, whole),
            side=side.astype(x.dtype),
            peak=jnp.maximum(state.peak, jnp.where(state.over, 0, reached)),
            over=over,
            bounces=state.bounces,
        )
        return struck, (x, state.side)

    rest = _Moving(zero, zero, zero, zero, zero, zero > 1, jnp.zeros((), int))
    lengths = jnp.diff(times, prepend=times[:1])
    last, (ratios, sides) = jax.lax.scan(pulse, rest, (lengths, intensities))
    # A block that falls after the last pulse may leave the impact faster than it ever was.
    rises = last.since <= 0.5 * last.whole
    x = jnp.where(rises, last.x, rocker.restitution * last.x)
    over, peak = last.over | (x >= 1), jnp.maximum(last.peak, summit(x))
    complete = last.bounces < _BOUNCES
    return TrainResponse(
        velocity_ratio=jnp.where(complete, ratios, jnp.nan),
        peak_rotation=jnp.where(complete, jnp.where(over, 0.5 * jnp.pi, peak), jnp.nan),
        overturned=over & complete,
        side=sides,
        complete=complete,
    )
