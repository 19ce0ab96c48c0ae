"""Steady rocking on a floor that moves harmonically without end, and its stability."""

import dataclasses
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex

from ..block import Block
from ..driven import TOPPLED_ROTATION, Equation, uplift_acceleration
from ..host import Printed, format_fields
from ..resonance import ModelLike, Nonlinear, as_model
from ..validation import (
    NON_NEGATIVE,
    POSITIVE,
    UNIT_INTERVAL,
    AnyArray,
    Booleans,
    Number,
    Reals,
    elementwise,
    is_traced,
    unify_precision,
)
from .harmonic_linearized import HarmonicScene, Path, require_two_sides, solve_linearized
from .harmonic_nonlinear import solve_nonlinear

# Orbits that are computed at once: all wait for the slowest one, and each has a matrix in
# memory.
_TOGETHER = 64
# Intervals of the half period; the search for the peak begins at the highest of their ends.
_INSTANTS = 128
# Newton's steps to the peak, including the last one, which has a derivative.
_PEAK_STEPS = 6


class HarmonicOrbit(Printed, eqx.Module):
    """Symmetric steady rocking on a harmonic floor, an impact per half period; NaN if none exists.

    Attributes
    ----------
    launch_velocity : Array
        Angular velocity just after an impact [rad/s].
    phase : Array
        Phase of the floor's sine [rad], between 0 and pi, at an impact after which the
        rotation is positive.
    peak_rotation, rotation_ratio : Array
        Largest rotation [rad], and its ratio to the critical angle [-].
    trace, determinant : Array
        Sum and product of the multipliers, smooth where the multipliers are not. The product
        is the square of the restitution.
    uplift_margin : Array
        Acceleration that lifts the block from rest, beyond the amplitude of the floor [m/s2].
    """

    launch_velocity: Reals
    phase: Reals
    peak_rotation: Reals
    rotation_ratio: Reals
    trace: Reals
    determinant: Reals
    uplift_margin: Reals

    # Comparisons with NaN, where no motion exists, are False.
    @property
    def exists(self) -> AnyArray:
        """Whether such a motion exists, with a rotation between 0 and pi / 2 between impacts."""
        return self.launch_velocity >= 0

    @property
    def stable(self) -> AnyArray:
        """Whether small perturbations decay: both multipliers are inside the unit circle."""
        return (abs(self.trace) < 1 + self.determinant) & (self.determinant < 1)

    @property
    def symmetry_broken(self) -> AnyArray:
        """Whether a multiplier is below -1, so that half periods alternate."""
        return self.trace < -1 - self.determinant

    @property
    def below_uplift(self) -> AnyArray:
        """Whether the floor is too weak to lift a block from rest, as it keeps it rocking."""
        return self.uplift_margin > 0

    @property
    def multipliers(self) -> Complex[Array, "... 2"]:
        """Eigenvalues of the derivative of the map from one launch to the next; (..., 2).

        By these factors perturbations shrink in half a period. The one of larger modulus is
        first.
        """
        return _compute_multipliers(self.trace, self.determinant)

    def __str__(self) -> str:
        units = {"launch_velocity": "rad/s", "phase": "rad", "peak_rotation": "rad"}
        names = "rotation_ratio trace determinant exists stable symmetry_broken below_uplift"
        text = format_fields(self, **units, **dict.fromkeys(names.split(), ""))
        if not is_traced(self.below_uplift) and self.below_uplift.any():
            text += "\nBelow uplift the motion goes on once begun, but cannot begin from rest."
        return text


@elementwise(
    require_two_sides,
    restitution=UNIT_INTERVAL,
    amplitude=NON_NEGATIVE,
    frequency=POSITIVE,
    model=as_model,
)
def harmonic_orbit(
    block: Block,
    restitution: Number,
    amplitude: Number,
    frequency: Number,
    *,
    model: ModelLike = Nonlinear(),
) -> HarmonicOrbit:
    """Compute symmetric steady rocking on a floor that accelerates as an endless sine.

    The block hits the ground once in each half period, alternately on both sides. If there are
    two such motions, the one with the faster launch is returned; the other one is never stable.

    Parameters
    ----------
    block : Block
    restitution : array_like
        C, velocity after an impact over velocity before it [-], between 0 and 1.
    amplitude : array_like
        Amplitude of the acceleration of the floor [m/s2], finite and at least 0.
    frequency : array_like
        Angular frequency omega of the floor [rad/s], finite and greater than 0.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`. The linearized motion has a closed form.

    Returns
    -------
    HarmonicOrbit
        Its arrays have the shape to which the arguments broadcast.

    Raises
    ------
    ValueError
        If a concrete `restitution`, `amplitude` or `frequency` is out of range (a traced one
        gives NaN), or if the block is one-sided.

    Notes
    -----
    The floor accelerates with ``amplitude sin(omega t)``. The derivatives grow without bound
    towards the least amplitude at which the motion exists. Nonlinear motions are computed by
    collocation with 36 nodes. A motion that these nodes do not resolve counts as nonexistent:
    this occurs at frequencies below 0.3 p, and at somewhat higher ones with large amplitudes.

    Examples
    --------
    >>> import jaxrock as jr
    >>> block = jr.Block(half_width=0.2, slenderness=5.0)
    >>> orbit = jr.steady.harmonic_orbit(block, 0.9, amplitude=1.5, frequency=12.0)
    >>> print(f"{orbit.rotation_ratio:.3f}", bool(orbit.stable), bool(orbit.below_uplift))
    0.094 True True
    """
    model = as_model(model)
    angle = block.critical_angle
    rate = block.frequency_parameter
    equation = dataclasses.replace(Equation.of(block, model), p_squared=jnp.ones_like(rate))
    strength = jnp.divide(amplitude, block.gravity * angle)
    ratio = jnp.divide(frequency, rate)
    scenes = HarmonicScene(equation, jnp.asarray(restitution), ratio, strength)
    scenes = unify_precision(scenes)
    shape = np.broadcast_shapes(*(leaf.shape for leaf in jax.tree.leaves(scenes)))
    size = math.prod(shape)
    # Rows of nearly equal length; the last one is filled with the first orbits once more.
    rows = max(1, -(-size // _TOGETHER))
    width = -(-size // rows)

    def divide_into_rows(leaf: Reals) -> Reals:
        return jnp.resize(jnp.broadcast_to(leaf, shape), (rows, width))

    # Row by row, each row side by side.
    solved = jax.lax.map(jax.vmap(_solve_scene), jax.tree.map(divide_into_rows, scenes))
    landing, phase, peak, trace, exists = (p.reshape(-1)[:size].reshape(shape) for p in solved)
    orbit = HarmonicOrbit(
        launch_velocity=jnp.multiply(restitution, landing * angle * rate),
        phase=phase,
        peak_rotation=peak * angle,
        rotation_ratio=peak,
        trace=trace,
        determinant=jnp.square(restitution),
        uplift_margin=uplift_acceleration(block, model) - amplitude,
    )
    # The mask comes last, so that no NaN is a factor of a derivative.
    return jax.tree.map(lambda part: jnp.where(exists, part, jnp.nan), orbit)


def _solve_scene(scene: HarmonicScene) -> tuple[Reals, Reals, Reals, Reals, Booleans]:
    """Solve one scene; return landing velocity, phase, peak, trace, and if it exists.

    All in units of 1 / p and alpha_c.
    """
    steady = solve_linearized(scene) if scene.equation.linearized else solve_nonlinear(scene)
    instants = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, _INSTANTS) / _INSTANTS)
    instants = jnp.asarray(instants, scene.amplitude.dtype)
    rotations = steady.path(instants)[0]
    peak = _find_peak(steady.path, scene.half_period, instants, rotations)
    # A solution of the equations counts only if the block stays above the ground and does not
    # overturn: otherwise there would be other impacts, or none.
    toppled = scene.equation.critical_angle * peak >= TOPPLED_ROTATION
    exists = steady.exists & (rotations.min() > 0) & ~toppled
    moves = (steady.sine != 0) | (steady.cosine != 0)
    # The phase is counted from the cosine axis, so that rounding does not turn pi into -pi:
    # the sine is not negative.
    phase = 0.5 * math.pi - jnp.arctan2(jnp.where(moves, steady.cosine, -1), steady.sine)
    return steady.landing, phase, peak, steady.trace, exists


def _find_peak(path: Path, half_period: Reals, instants: Reals, rotations: Reals) -> Reals:
    """Find the highest rotation by Newton's method, starting at the highest of some instants."""
    top = jnp.argmax(rotations)
    low, high = (instants[jnp.clip(top + k, 0, instants.size - 1)] for k in (-1, 1))
    instant = instants[top]
    for _ in range(_PEAK_STEPS):
        # Only the last step has a derivative. The first derivative of the peak needs no
        # derivative of the instant, since the velocity is 0 there; the second derivative needs
        # its first derivative.
        instant = jax.lax.stop_gradient(instant)
        _, velocity, acceleration = path(instant)
        falling = acceleration < 0
        step = velocity / (half_period * jnp.where(falling, acceleration, -1))
        instant = jnp.clip(jnp.where(falling, instant - step, instant), low, high)
    return path(instant)[0]


@jax.jit
def _compute_multipliers(trace: Reals, determinant: Reals) -> Complex[Array, "... 2"]:
    """Compute both eigenvalues, first the larger in modulus or the one of positive phase."""
    exists = ~jnp.isnan(trace)
    half = jnp.where(exists, 0.5 * trace, 0)
    product = jnp.where(exists, determinant, 0)
    square = half**2 - product
    differ = square != 0
    # Where the root is not used, it is taken of 1: the root of 0 would make derivatives NaN.
    root = jnp.where(differ, jnp.sqrt(jnp.where(differ, jnp.abs(square), 1)), 0)
    # The smaller eigenvalue is computed as a quotient: a difference would cancel.
    larger = half + jnp.where(half < 0, -root, root)
    smaller = product / jnp.where(larger == 0, 1, larger)
    real = jnp.where(square[..., None] > 0, jnp.stack([larger, smaller], -1), half[..., None])
    imaginary = jnp.where(square < 0, root, 0)
    multipliers = jax.lax.complex(real, jnp.stack([imaginary, -imaginary], -1))
    return jnp.where(exists[..., None], multipliers, jnp.nan)
