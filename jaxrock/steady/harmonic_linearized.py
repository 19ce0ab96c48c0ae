"""Steady rocking of the linearized block on a harmonic floor, in closed form.

Time is in units of 1 / p, rotation in units of alpha_c and counted from the side on which the
block stands. In a half period, of the duration T = pi / w,

    rotation'' = rotation - 1 + beta sin(w time + phase)

from 0 to 0, and the block lands 1 / C times as fast as it took off. With k = beta / (1 + w^2),
t = tanh(T / 2), and m half of the landing velocity the steady motion satisfies two linear
equations,

    k sin(phase) = t (1 - C) m,    k w cos(phase) = t - (1 + C) m,

and their squares are a quadratic equation for m. Its larger root belongs to the motion that
can be stable; on the lower branch a multiplier exceeds 1. The roots meet at beta_min.

The derivative of the map from one launch to the next, in time and velocity, has the
determinant C^2. Determinant and trace decide stability.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp

from ..block import Block
from ..driven import Equation
from ..impact import require_free_standing, require_linear_law
from ..validation import POSITIVE, UNIT_INTERVAL, Booleans, Number, Reals, elementwise


class HarmonicScene(eqx.Module):
    """One block on a harmonic floor, in units of 1 / p and alpha_c."""

    equation: Equation  # equation with p = 1
    restitution: Reals  # C
    frequency: Reals  # w = omega / p
    amplitude: Reals  # beta, the acceleration of the floor over g alpha_c

    @property
    def half_period(self) -> Reals:
        """Half a period of the floor, T, in units of 1 / p."""
        return math.pi / self.frequency

    def acceleration(self, rotation: Reals, push: Reals) -> Reals:
        """Angular acceleration, of a rotation and a push over alpha_c."""
        angle = self.equation.critical_angle
        lift = jnp.zeros_like(rotation)
        return self.equation.acceleration(angle * rotation, angle * push, lift) / angle


# Maps a fraction of the half period, 0 to 1, to rotation, velocity and acceleration.
Path = Callable[[Reals], tuple[Reals, ...]]


class SteadyMotion(NamedTuple):
    """One half period of a steady motion; arbitrary numbers where there is none."""

    landing: Reals  # velocity, over alpha_c p
    sine: Reals  # beta sin(phase)
    cosine: Reals  # beta cos(phase)
    trace: Reals  # of the derivative of the half-period map
    exists: Booleans
    path: Path


def solve_linearized(scene: HarmonicScene) -> SteadyMotion:
    """Solve for the steady motion of the linearized block on the upper branch."""
    c = scene.restitution
    w = scene.frequency
    t, loss, squares = _compute_coefficients(c, w)
    # A motion exists on one side of beta_min only; the mask keeps NaN out of the derivative of
    # the root.
    strength = scene.amplitude / (1 + w**2)
    least = t**2 * loss / jnp.sqrt(squares)
    exists = strength > least
    above = jnp.where(exists, (strength - least) * (strength + least), 1)
    root = jnp.sqrt(squares * above)
    m = (t * (1 + c) + w * root) / squares
    sine = t * loss * m
    # k w cos(phase) = t - (1 + C) m with m substituted, since the difference would cancel.
    cosine = (t**3 * w * loss**2 - (1 + c) * root) / squares
    length = scene.half_period
    whole = jnp.expm1(-length)

    def path(fraction: Reals) -> tuple[Reals, ...]:
        # Exponentials of negative numbers minus 1: they do not overflow for a slow floor, and
        # `free` does not cancel at both ends, where it is 0.
        gone = jnp.expm1(-fraction * length)
        left = jnp.expm1((fraction - 1) * length)
        odd = -jnp.cos(math.pi * fraction)
        even = jnp.sin(math.pi * fraction)
        free = gone * left / (2 + whole)
        rotation = free - sine * ((gone - left) / whole - odd) - cosine * even
        velocity = (
            (gone - left) / (2 + whole)
            + sine * ((2 + gone + left) / whole + w * even)
            + cosine * w * odd
        )
        push = (1 + w**2) * (cosine * even - sine * odd)
        return rotation, velocity, rotation - 1 + push

    constant_term, reciprocal_term = _compute_trace_terms(c, w)
    return SteadyMotion(
        landing=2 * m,
        sine=(1 + w**2) * sine,
        cosine=(1 + w**2) * cosine,
        trace=reciprocal_term / m - constant_term,
        exists=exists,
        path=path,
    )


def least_amplitude(restitution: Reals, frequency: Reals) -> Reals:
    """Least amplitude beta_min, over g alpha_c, at which a steady motion exists."""
    t, loss, squares = _compute_coefficients(restitution, frequency)
    return (1 + frequency**2) * t**2 * loss / jnp.sqrt(squares)


def _compute_coefficients(c: Reals, w: Reals) -> tuple[Reals, Reals, Reals]:
    """Compute the coefficients of the quadratic equation for m; see the top of this file."""
    t = jnp.tanh(0.5 * math.pi / w)
    loss = 1 - c
    return t, loss, (1 + c) ** 2 + (w * t * loss) ** 2


def _compute_trace_terms(c: Reals, w: Reals) -> tuple[Reals, Reals]:
    """Compute two terms of the trace: the second one divided by m, minus the first one."""
    length = math.pi / w
    # cosh(T) - 1 without the cancellation for a fast floor.
    rise = 2 * jnp.sinh(0.5 * length) ** 2
    constant_term = 2 * c * (1 + rise) + 0.5 * rise * (1 + w**2) * (1 - c) ** 2
    return constant_term, 0.5 * (1 + c) * jnp.sinh(length)


def require_two_sides(arguments: dict[str, Any]) -> None:
    """Raise `ValueError` for a block against a wall, or an impact law that is not linear.

    In half a period the block would have to come back to the other side. The determinant of the
    map of half a period is C squared.
    """
    require_free_standing(arguments["block"], "steady rocking on a harmonic floor")
    require_linear_law()


@elementwise(require_two_sides, restitution=UNIT_INTERVAL, frequency=POSITIVE)
def least_harmonic_amplitude(block: Block, restitution: Number, frequency: Number) -> Reals:
    """Compute the least amplitude of a harmonic floor that keeps the linearized block rocking.

    The block is already in the symmetric motion of `harmonic_orbit`. If it loses little
    energy at impacts, this amplitude is far below the one that lifts it from rest; for a
    restitution of 1 it is 0.

    Parameters
    ----------
    block : Block
    restitution : array_like
        C [-], between 0 and 1.
    frequency : array_like
        Angular frequency omega of the floor [rad/s], finite and greater than 0.

    Returns
    -------
    amplitude : Array, shape (...)
        Amplitude of the acceleration [m/s2], ``g alpha_c beta_min`` with, for w = omega / p
        and t = tanh(pi / (2 w)),
        ``beta_min = (1 + w^2) (1 - C) t^2 / sqrt((1 + C)^2 + (w t (1 - C))^2)``.

    Raises
    ------
    ValueError
        If a concrete `restitution` or `frequency` is out of range. A traced one gives NaN.

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


@elementwise(require_two_sides, restitution=UNIT_INTERVAL, frequency=POSITIVE)
def symmetry_breaking_amplitude(block: Block, restitution: Number, frequency: Number) -> Reals:
    """Compute the amplitude beyond which steady rocking is no longer symmetric.

    At this amplitude a multiplier of the half-period map of the linearized block passes -1.
    Beyond it the symmetric motion of `harmonic_orbit` still exists, but is unstable.

    Parameters
    ----------
    block : Block
    restitution : array_like
        C [-], between 0 and 1.
    frequency : array_like
        Angular frequency omega of the floor [rad/s], finite and greater than 0.

    Returns
    -------
    amplitude : Array, shape (...)
        Amplitude of the acceleration [m/s2].

    Raises
    ------
    ValueError
        If a concrete `restitution` or `frequency` is out of range. A traced one gives NaN.
    """
    c = jnp.asarray(restitution)
    w = jnp.divide(frequency, block.frequency_parameter)
    t, loss, _ = _compute_coefficients(c, w)
    # A multiplier is -1 where 1 + trace + C^2 = 0. This equation is linear in 1 / m; with m
    # the equations for the phase give k.
    constant_term, reciprocal_term = _compute_trace_terms(c, w)
    m = reciprocal_term / (constant_term - (1 + c**2))
    strength = jnp.sqrt((t * loss * m) ** 2 + ((t - (1 + c) * m) / w) ** 2)
    return block.gravity * block.critical_angle * (1 + w**2) * strength
