"""Steady rocking of the linearized block on a harmonic floor, in closed form.

Time is in units of 1 / p, rotation in units of alpha_c and counted from the side on which the
block stands. In a half period, of the duration T = pi / w,

    rotation'' = rotation - 1 + beta sin(w time + phase)

from 0 to 0, and the block lands 1 / C times as fast as it took off. With k = beta / (1 + w^2),
t = tanh(T / 2), and m half of the landing velocity these are two linear equations,

    k sin(phase) = t (1 - C) m,    k w cos(phase) = t - (1 + C) m,

and their squares are a quadratic equation for m. Its larger root is that of the motion which
can be stable; on the lower branch a multiplier exceeds 1. The roots meet at beta_min.
"""

import math
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from ..block import Block
from ..driven import Equation
from ..validation import POSITIVE, UNIT_INTERVAL, Booleans, Number, Reals, elementwise


class HarmonicScene(eqx.Module):
    """One block on a harmonic floor, in units of 1 / p and alpha_c."""

    equation: Equation  # with p = 1
    restitution: Reals
    frequency: Reals  # w, omega / p
    amplitude: Reals  # beta, over g alpha_c

    @property
    def half_period(self) -> Reals:
        """T = pi / w."""
        return math.pi / self.frequency

    def acceleration(self, rotation: Reals, push: Reals) -> Reals:
        """Of a rotation and a push over alpha_c."""
        angle = self.equation.critical_angle
        lift = jnp.zeros_like(rotation)
        return self.equation.acceleration(angle * rotation, angle * push, lift) / angle


class Steady(eqx.Module):
    """What one half period of a steady motion is like; arbitrary where there is none."""

    landing: Reals  # velocity, over alpha_c p
    sine: Reals  # beta sin(phase)
    cosine: Reals  # beta cos(phase)
    trace: Reals  # of the derivative of the half-period map
    exists: Booleans
    path: Any  # rotation, velocity and acceleration `at` a share of the half period


class LinearizedPath(eqx.Module):
    """Rotation over time, in closed form."""

    half_period: Reals
    sine: Reals  # k sin(phase)
    cosine: Reals  # k cos(phase)

    def at(self, share: Reals) -> tuple[Reals, Reals, Reals]:
        """Rotation, velocity and acceleration."""
        length = self.half_period
        frequency = math.pi / self.half_period
        gone = jnp.expm1(-share * length)
        left = jnp.expm1((share - 1) * length)
        whole = jnp.expm1(-length)
        odd = -jnp.cos(math.pi * share)
        even = jnp.sin(math.pi * share)
        hyperbolic = (gone - left) / whole
        free = gone * left / (2 + whole)
        rotation = free - self.sine * (hyperbolic - odd) - self.cosine * even
        velocity = (
            (gone - left) / (2 + whole)
            + self.sine * ((2 + gone + left) / whole + frequency * even)
            + self.cosine * frequency * odd
        )
        push = (1 + frequency**2) * (self.cosine * even - self.sine * odd)
        return rotation, velocity, rotation - 1 + push


def linearized_steady(scene: HarmonicScene) -> Steady:
    """Compute the steady motion on the upper branch."""
    c = scene.restitution
    w = scene.frequency
    t, loss, squares = _coefficients(c, w)
    strength = scene.amplitude / (1 + w**2)
    least = t**2 * loss / jnp.sqrt(squares)
    exists = strength > least
    above = jnp.where(exists, (strength - least) * (strength + least), 1)
    root = jnp.sqrt(squares * above)
    m = (t * (1 + c) + w * root) / squares
    sine = t * loss * m
    # t - (1 + C) m, without cancellation
    cosine = (t**3 * w * loss**2 - (1 + c) * root) / squares
    path = LinearizedPath(scene.half_period, sine, cosine)
    from_parts, from_landing = _trace_terms(c, w)
    return Steady(
        landing=2 * m,
        sine=(1 + w**2) * sine,
        cosine=(1 + w**2) * cosine,
        trace=from_landing / m - from_parts,
        exists=exists,
        path=path,
    )


def least_amplitude(restitution: Reals, frequency: Reals) -> Reals:
    """beta_min."""
    t, loss, squares = _coefficients(restitution, frequency)
    return (1 + frequency**2) * t**2 * loss / jnp.sqrt(squares)


def _coefficients(c: Reals, w: Reals) -> tuple[Reals, Reals, Reals]:
    """t, 1 - C, and (1 + C)^2 + (w t (1 - C))^2."""
    t = jnp.tanh(0.5 * math.pi / w)
    loss = 1 - c
    return t, loss, (1 + c) ** 2 + (w * t * loss) ** 2


def _trace_terms(c: Reals, w: Reals) -> tuple[Reals, Reals]:
    """Compute two terms of the trace of the map's derivative: the second over m, less the first."""
    length = math.pi / w
    rise = 2 * jnp.sinh(0.5 * length) ** 2  # cosh(T) - 1
    from_parts = 2 * c * (1 + rise) + 0.5 * rise * (1 + w**2) * (1 - c) ** 2
    return from_parts, 0.5 * (1 + c) * jnp.sinh(length)


@elementwise(restitution=UNIT_INTERVAL, frequency=POSITIVE)
def least_harmonic_amplitude(block: Block, restitution: Number, frequency: Number) -> Reals:
    """Least amplitude of a harmonic floor that keeps the linearized block rocking.

    Of a block that moves already, in the symmetric motion of `harmonic_orbit`; far below what
    lifts it from rest where it loses little at impacts. 0 for a restitution of 1.

    Parameters
    ----------
    block : Block
    restitution : array_like
        C [-], between 0 and 1.
    frequency : array_like
        Angular frequency omega of the floor [rad/s], greater than 0.

    Returns
    -------
    amplitude : Array, shape (...)
        Of the acceleration [m/s2], ``g alpha_c beta_min`` with, for w = omega / p and t =
        tanh(pi / (2 w)),
        ``beta_min = (1 + w^2) (1 - C) t^2 / sqrt((1 + C)^2 + (w t (1 - C))^2)``.

    Examples
    --------
    >>> import jaxrock as jr
    >>> block = jr.Block(half_width=0.2, slenderness=5.0)
    >>> least = jr.steady.least_harmonic_amplitude(block, 0.9, 10.0)
    >>> print(f"{least:.3f} m/s2 of {block.gravity * block.critical_angle:.3f} m/s2")
    0.240 m/s2 of 1.936 m/s2
    """
    w = jnp.divide(frequency, block.frequency_parameter)
    return block.gravity * block.critical_angle * least_amplitude(jnp.asarray(restitution), w)


@elementwise(restitution=UNIT_INTERVAL, frequency=POSITIVE)
def symmetry_breaking_amplitude(block: Block, restitution: Number, frequency: Number) -> Reals:
    """Amplitude beyond which steady rocking of the linearized block is no longer symmetric.

    There a multiplier of the half-period map passes -1: the symmetric motion of
    `harmonic_orbit` goes on to exist, but is not stable any more.

    Parameters
    ----------
    block, restitution, frequency
        As in `least_harmonic_amplitude`.

    Returns
    -------
    amplitude : Array, shape (...)
        Of the acceleration [m/s2].
    """
    c = jnp.asarray(restitution)
    w = jnp.divide(frequency, block.frequency_parameter)
    t, loss, _ = _coefficients(c, w)
    # Where the trace is -(1 + C^2).
    from_parts, from_landing = _trace_terms(c, w)
    m = from_landing / (from_parts - (1 + c**2))
    strength = jnp.sqrt((t * loss * m) ** 2 + ((t - (1 + c) * m) / w) ** 2)
    return block.gravity * block.critical_angle * (1 + w**2) * strength
