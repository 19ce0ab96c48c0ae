"""A block that rocks freely between two pulses, and what a pulse does to it."""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from ..block import Block
from ..validation import Booleans, Reals
from .free_rocking import Linearized, RockingModel


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

    def motion(self, x: Reals, since: Reals, duration: Reals) -> tuple[Reals, Reals, Booleans]:
        """Rotation [rad] and its rate [rad/s], both outward as on the way up; whether it falls."""
        left = duration - since
        falls = left < since
        # The way down is the way up reversed.
        rotation, velocity = jax.jvp(
            lambda time: self.model._rotation(self.block, x, time),
            (jnp.where(falls, left, since),),
            (jnp.ones_like(since),),
        )
        return rotation, velocity, falls

    def on_flight(self, x: Reals, since: Reals, duration: Reals) -> Flight:
        """Compute the state at a time since the launch [s]; see `since_launch`."""
        _, velocity, falls = self.motion(x, since, duration)
        q = jnp.clip(velocity / self.model._critical_velocity(self.block), 0, x)
        square = (x - q) * (x + q)
        # On the ground the root has no derivative.
        drop = jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1)), 0)
        return Flight(drop, jnp.where(falls, -q, q))

    def velocity_at(self, x: Reals, since: Reals, duration: Reals) -> Reals:
        """Compute the velocity `on_flight`, strictly between launch and impact.

        Derivatives of Jacobi's functions take a minute to compile: those here are of one step of
        Newton's method.
        """
        if isinstance(self.model, Linearized):
            return self.on_flight(x, since, duration).q
        still, *at = jax.lax.stop_gradient((self, x, since, duration))
        q = jnp.clip(abs(still.on_flight(*at).q), 0, at[0] * (1 - jnp.finfo(x.dtype).eps))
        flight = Flight(jnp.sqrt((x - q) * (x + q)), q)
        falls = duration - since < since
        late = self.ground_time(flight) - jnp.where(falls, duration - since, since)
        lever = jnp.sin(still.block.critical_angle - still.rotation(flight))
        slowing = lever * still.block.frequency_parameter**2
        q = (
            q
            + jax.lax.stop_gradient(slowing)
            / still.model._critical_velocity(still.block)
            * late
        )
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

    def passing_time(self, x: Reals) -> Reals:
        """Compute the time from the launch of an overturning block to the critical angle [s]."""
        angle = self.block.critical_angle
        # Launched with exactly the critical velocity it would take for ever.
        q = jnp.sqrt(jnp.maximum((x - 1) * (x + 1), jnp.finfo(x.dtype).eps ** 2))
        return self.model._time_from_ground(self.block, angle, x, q)

    def struck(self, flight: Flight, impulse: Reals) -> Flight:
        """Apply an outward pulse, its intensity over `unit`.

        Linearized, a pulse acts the same at all rotations (Eq. 2). In the full equation it
        turns the block the more, the more upright the diagonal to the corner is.
        """
        if isinstance(self.model, Linearized):
            return flight._replace(q=flight.q + impulse)
        angle = self.block.critical_angle
        factor = jnp.cos(angle - self.rotation(flight)) / jnp.cos(angle)
        return flight._replace(q=flight.q + impulse * factor)


def _largest_subcritical(x: Reals) -> float:
    """Return the largest x of which a duration is computed: at 1 it is infinite."""
    return 1 - float(jnp.finfo(x.dtype).eps) ** 0.6
