"""A block that rocks freely between two pulses, and what a pulse does to it."""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from ..block import Block
from ..impact import velocity_after_impact
from ..validation import Booleans, Reals
from .free_rocking import Linearized
from .rocking_model import RockingModel


def root_or_zero(square: Reals) -> Reals:
    """Take the root of a number, or 0 where it is not positive, with a derivative of 0 there."""
    positive = square > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, square, 1)), 0)


class Flight(NamedTuple):
    """The state of a block between two impacts: two velocities over the critical one [-].

    Their squares add up to the energy of the block over the barrier. A pulse changes `q` and
    leaves `drop`, which only depends on the rotation.

    Attributes
    ----------
    drop
        Launch velocity that just reaches the rotation, 0 on the ground.
    q
        Outward velocity, negative on the way down.
    """

    drop: Reals
    q: Reals

    @property
    def x(self) -> Reals:
        """Velocity over the critical one with which the block left the ground and lands."""
        return root_or_zero(self.drop**2 + self.q**2)


class Rocker(NamedTuple):
    """A block that rocks freely between pulses.

    In all methods `x` is the launch velocity of a half-cycle over the critical one [-],
    `since` the time since that launch and `duration` the duration of the half-cycle [s].
    """

    block: Block
    restitution: Reals
    model: RockingModel

    @property
    def unit(self) -> Reals:
        """Intensity of the single pulse that just overturns [m/s]."""
        return self.model._critical_velocity(self.block) / self.block.pulse_velocity(1.0)

    def launch_after_impact(self, x: Reals) -> Reals:
        """Compute the launch velocity after an impact, over the critical one [-]."""
        critical = self.model._critical_velocity(self.block)
        return velocity_after_impact(self.restitution, x, critical)

    def duration(self, x: Reals) -> Reals:
        """Compute the duration of a half-cycle [s]; a long one where the block overturns."""
        x = jnp.minimum(x, _largest_subcritical(x))
        return self.model._half_cycle_duration(self.block, x, x * self.unit)

    def motion(self, x: Reals, since: Reals, duration: Reals) -> tuple[Reals, Reals, Booleans]:
        """Compute rotation [rad] and its rate [rad/s], and tell where the block falls.

        There the rate is the one on the way up, at the same rotation.
        """
        left = duration - since
        falls = left < since
        # The way down is the way up reversed: so a block that falls faster than critical, and
        # was never launched from the ground, has a motion too.
        rotation, velocity = jax.jvp(
            lambda time: self.model._rotation(self.block, x, time),
            (jnp.where(falls, left, since),),
            (jnp.ones_like(since),),
        )
        return rotation, velocity, falls

    def flight_at(self, x: Reals, since: Reals, duration: Reals) -> Flight:
        """Compute the state at a time since the launch [s]; see `time_since_launch`."""
        _, velocity, falls = self.motion(x, since, duration)
        # Unless the block has overturned, only rounding takes the velocity out of its bounds.
        q = jnp.clip(velocity / self.model._critical_velocity(self.block), 0, x)
        return Flight(root_or_zero((x - q) * (x + q)), jnp.where(falls, -q, q))

    def velocity_at(self, x: Reals, since: Reals, duration: Reals) -> Reals:
        """Compute `q` of `flight_at` at a time strictly between launch and impact.

        Derivatives of Jacobi's functions take a minute to compile. Here the derivatives are
        those of one step of Newton's method, which starts at the solution.
        """
        if isinstance(self.model, Linearized):
            return self.flight_at(x, since, duration).q
        # The velocity is held below x: on the ground the root has no derivative.
        still, *at = jax.lax.stop_gradient((self, x, since, duration))
        q = jnp.clip(abs(still.flight_at(*at).q), 0, at[0] * (1 - jnp.finfo(x.dtype).eps))
        flight = Flight(jnp.sqrt((x - q) * (x + q)), q)
        falls = duration - since < since
        # `late` is 0 but for rounding. Its derivatives, times the rate at which q falls, are
        # the derivatives of q by the implicit function theorem.
        late = self.time_from_ground(flight) - jnp.where(falls, duration - since, since)
        lever = jnp.sin(still.block.critical_angle - still.rotation(flight))
        slowing = lever * still.block.frequency_parameter**2
        q = q + slowing / still.model._critical_velocity(still.block) * late
        return jnp.where(falls, -q, q)

    def rotation(self, flight: Flight) -> Reals:
        """Compute the rotation from the side on which the block stands [rad].

        It is the peak rotation after a launch with the velocity that has been lost.
        """
        drop = jnp.minimum(flight.drop, _largest_subcritical(flight.drop))
        return self.model._peak_rotation(self.block, drop, drop * self.unit)

    def launch_peak(self, x: Reals) -> Reals:
        """Compute the peak rotation after a launch [rad], where all of the velocity is lost."""
        return self.rotation(Flight(x, jnp.zeros_like(x)))

    def time_from_ground(self, flight: Flight) -> Reals:
        """Compute the time since the launch or, on the way down, to the impact [s]."""
        rotation = self.rotation(flight)
        return self.model._time_from_ground(self.block, rotation, flight.x, abs(flight.q))

    def time_since_launch(self, flight: Flight, duration: Reals) -> Reals:
        """Compute the time since the launch [s], in a half-cycle of a duration.

        A block that falls faster than critical was never launched from the ground: on the way
        down, what counts is the time to the impact.
        """
        time = self.time_from_ground(flight)
        return jnp.where(flight.q < 0, duration - time, time)

    def time_to_critical_angle(self, x: Reals) -> Reals:
        """Compute the time from a launch that overturns to the critical angle [s]."""
        angle = self.block.critical_angle
        # Launched with exactly the critical velocity it would take for ever.
        q = jnp.sqrt(jnp.maximum((x - 1) * (x + 1), jnp.finfo(x.dtype).eps ** 2))
        return self.model._time_from_ground(self.block, angle, x, q)

    def strike(self, side: Reals, intensity: Reals) -> tuple[Reals, Reals]:
        """Return the side on which a pulse finds a block, and its outward intensity [m/s].

        A block at rest, on the side 0, is struck to the side to which the pulse pushes it. One
        that rests against a wall stays there if that is the side of the wall.
        """
        rests = side == 0
        if self.block.one_sided:
            return jnp.ones_like(side), jnp.where(rests, jnp.maximum(intensity, 0), intensity)
        side = jnp.where(rests, jnp.where(intensity < 0, -1, 1), side)
        return side, side * intensity

    def apply_pulse(self, flight: Flight, impulse: Reals) -> Flight:
        """Apply an outward pulse, its intensity over `unit`.

        Linearized, a pulse acts the same at all rotations (Eq. 2). In the full equation it
        turns the block the more, the more upright the diagonal through the pivot is.
        """
        if isinstance(self.model, Linearized):
            return flight._replace(q=flight.q + impulse)
        angle = self.block.critical_angle
        factor = jnp.cos(angle - self.rotation(flight)) / jnp.cos(angle)
        return flight._replace(q=flight.q + impulse * factor)


def _largest_subcritical(x: Reals) -> float:
    """Return the largest x that is computed with: at 1 durations and slopes are infinite."""
    return 1 - float(jnp.finfo(x.dtype).eps) ** 0.6
