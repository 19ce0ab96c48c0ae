"""Rocking resonance: the half-cycle map under the paper's input, and its limit.

The input is an unlimited train of equal, alternating, instantaneous pulses: the first starts
the motion, each further one comes right after an impact (Fig. 2). Each pushes the block away
from the ground, on the side to which the impact sends it. Against a wall that is always the
same side: there the pulses do not alternate, and all else is the same.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp

from ..block import Block
from ..impact import count_half_cycles, require_linear_law, velocity_after_impact
from ..numerics import one_minus_square, quotient, quotient_or_infinite, share_of_one
from ..validation import COUNT, NON_NEGATIVE, Booleans, Number, Reals, elementwise
from .free_rocking import Linearized, ModelLike, as_model
from .rocking_model import RockingModel
from .scene import Scene


@elementwise()
def launch_velocity(scene: Scene) -> Reals:
    """Compute the velocity at the beginning of the first half-cycle (Eq. 2).

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    Array, shape (...)
        `Block.pulse_velocity` of the intensity [rad/s].

    Examples
    --------
    >>> import jaxrock as jr
    >>> print(f"{jr.launch_velocity(jr.Scene(jr.Block(0.4, 5.0), 0.7, 0.15)):.4f} rad/s")
    0.0541 rad/s
    """
    return scene.block.pulse_velocity(scene.intensity)


@elementwise(velocity=NON_NEGATIVE)
def next_velocity(scene: Scene, velocity: Number) -> Reals:
    """Apply the half-cycle map, from one launch velocity to the next (Eq. 8).

    The block lands with its launch velocity, the impact reduces it to ``C velocity``, and the
    next pulse adds `launch_velocity`. This is exact in both models.

    Parameters
    ----------
    scene : Scene
    velocity : array_like
        Launch velocity of a half-cycle [rad/s], finite and at least 0.

    Returns
    -------
    Array, shape (...)
        Launch velocity of the next half-cycle [rad/s].

    Raises
    ------
    ValueError
        If a concrete `velocity` is out of range. A traced one gives NaN.

    Examples
    --------
    >>> import jaxrock as jr
    >>> scene = jr.Scene(jr.Block(0.4, 5.0), 0.7, 0.15)
    >>> print(f"{jr.resonance.next_velocity(scene, 0.1):.4f} rad/s")
    0.1241 rad/s
    """
    after = velocity_after_impact(scene.restitution, jnp.asarray(velocity))
    return after + launch_velocity(scene)


@elementwise(require_linear_law, half_cycle=COUNT)
def half_cycle_velocity(scene: Scene, half_cycle: Number) -> Reals:
    """Compute the launch velocity of half-cycle i, even if an earlier one overturns (Eq. 8).

    It follows from the recursion of Eq. 8. The closed sum printed there lacks its last term.

    Parameters
    ----------
    scene : Scene
    half_cycle : array_like
        i, a whole number from 1 on, or inf.

    Returns
    -------
    Array, shape (...)
        ``launch_velocity (1 - C^i) / (1 - C)`` [rad/s]; inf for the limit at C = 1.

    Raises
    ------
    ValueError
        If a concrete `half_cycle` is out of range. A traced one gives NaN.

    Examples
    --------
    >>> import jaxrock as jr
    >>> wall = jr.Scene(jr.Block(half_width=0.4, slenderness=5.0), 0.7, 0.15)
    >>> print(*(f"{jr.half_cycle_velocity(wall, i):.3f}" for i in (1.0, 2.0, 3.0)), "rad/s")
    0.054 0.092 0.118 rad/s
    """
    share = share_of_one(scene.restitution, half_cycle)
    return quotient_or_infinite(launch_velocity(scene), share)


@elementwise(require_linear_law)
def stabilized_velocity(scene: Scene) -> Reals:
    """Compute the limit of the launch velocity, even if the block overturns earlier (Eq. 10).

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    Array, shape (...)
        ``launch_velocity / (1 - C)`` [rad/s]; inf for C = 1, and 0 without pulses.

    Examples
    --------
    >>> import jaxrock as jr
    >>> print(f"{jr.stabilized_velocity(jr.Scene(jr.Block(0.4, 5.0), 0.7, 0.15)):.4f} rad/s")
    0.1803 rad/s
    """
    return quotient_or_infinite(launch_velocity(scene), 1 - scene.restitution)


@elementwise(require_linear_law, model=as_model)
def stabilized_period(scene: Scene, model: ModelLike = Linearized()) -> Reals:
    """Compute the full period of the stabilized phase (Eq. 11).

    With `Linearized`, T* is 0.65 % too short at slenderness 5, for weak pulses. The motion of
    a one-sided block repeats after each half-cycle, so its period is half of Eq. 11.

    Parameters
    ----------
    scene : Scene
    model : ModelLike
        `Linearized` by default, as in the paper; driven motion is `Nonlinear` by default.

    Returns
    -------
    Array, shape (...)
        T* [s], twice the duration of a half-cycle, or that duration if the block is one-sided;
        NaN where the block overturns.

    Examples
    --------
    >>> import jaxrock as jr
    >>> print(f"{jr.stabilized_period(jr.Scene(jr.Block(0.4, 5.0), 0.7, 0.15)):.3f} s")
    1.104 s
    """
    half = _compute_where_stabilized(scene, model, lambda m, *at: m._half_cycle_duration(*at))
    return count_half_cycles(scene.block) * half


@elementwise(require_linear_law, model=as_model)
def stabilized_rotation(scene: Scene, model: ModelLike = Linearized()) -> Reals:
    """Compute the peak rotation in the stabilized phase (Eq. 12).

    With `Linearized`, it is 0.65 % too small at slenderness 5, for weak pulses.

    Parameters
    ----------
    scene : Scene
    model : ModelLike
        `Linearized` by default, as in the paper; driven motion is `Nonlinear` by default.

    Returns
    -------
    Array, shape (...)
        alpha*_max [rad]; NaN where the block overturns.

    Examples
    --------
    >>> import jaxrock as jr
    >>> print(f"{jr.stabilized_rotation(jr.Scene(jr.Block(0.4, 5.0), 0.7, 0.15)):.4f} rad")
    0.0243 rad
    """
    return _compute_where_stabilized(scene, model, lambda m, *at: m._peak_rotation(*at))


@elementwise(require_linear_law, model=as_model)
def rotation_ratio(scene: Scene, model: ModelLike = Linearized()) -> Reals:
    """Compute the stabilized peak rotation over the critical angle (Figs. 6 to 8).

    With `Linearized`, it is 0.65 % too small at slenderness 5, for weak pulses.

    Parameters
    ----------
    scene : Scene
    model : ModelLike
        `Linearized` by default, as in the paper; driven motion is `Nonlinear` by default.

    Returns
    -------
    Array, shape (...)
        alpha*_max / alpha_c [-], below 1; NaN where the block overturns.

    Examples
    --------
    >>> import jaxrock as jr
    >>> wall = jr.Scene(jr.Block(half_width=0.4, slenderness=5.0), 0.7, 0.15)
    >>> print(f"{jr.rotation_ratio(wall):.4f}, {jr.rotation_ratio(wall, jr.Nonlinear()):.4f}")
    0.1232, 0.1240
    """
    return _compute_where_stabilized(
        scene, model, lambda m, block, x, _: m._rotation_ratio(block, x)
    )


@elementwise(require_linear_law, model=as_model)
def amplification(scene: Scene, model: ModelLike = Linearized()) -> Reals:
    """Compute the stabilized peak rotation over the peak after the first pulse (Fig. 4).

    With `Linearized`, its error vanishes for weak pulses.

    Parameters
    ----------
    scene : Scene
    model : ModelLike
        `Linearized` by default, as in the paper; driven motion is `Nonlinear` by default.

    Returns
    -------
    Array, shape (...)
        zeta = alpha*_max / alpha_1max [-]; NaN where the block overturns. For weak pulses it
        tends to ``1 / (1 - C)^2``.

    Examples
    --------
    >>> import jaxrock as jr
    >>> print(f"{jr.amplification(jr.Scene(jr.Block(0.4, 5.0), 0.7, 0.15)):.2f}")
    11.78
    """
    model = as_model(model)
    x_limit, limited = _stabilized_ratio(scene, model)
    # Without pulses the block stands even with C = 1, but the amplification has no limit.
    stands = limited & (x_limit < 1) & (scene.restitution < 1)
    x = launch_velocity(scene) / model._critical_velocity(scene.block)
    # The limit is 1 / (1 - C) = 1 + growth times as fast as the first launch.
    growth = scene.restitution / jnp.where(stands, 1 - scene.restitution, 1)
    x = jnp.where(stands, x, 0)
    growth = jnp.where(stands, growth, 0)
    return jnp.where(stands, model._peak_amplification(scene.block, x, growth), jnp.nan)


@elementwise(require_linear_law, model=as_model)
def overturning_margin(scene: Scene, model: ModelLike = Linearized()) -> Reals:
    """Compute the fraction of the energy barrier that is left in the stabilized phase.

    It is smooth through the overturning threshold, where the derivative of the peak rotation
    is infinite. Use it for searches and optimization. With `Linearized`, the critical velocity
    v_c is 0.16 % too large at slenderness 5, which is unsafe.

    Parameters
    ----------
    scene : Scene
    model : ModelLike

    Returns
    -------
    Array, shape (...)
        ``1 - (v* / v_c)^2`` [-]: 1 without pulses, at most 0 where the block overturns, -inf
        for C = 1.

    Examples
    --------
    >>> import jaxrock as jr
    >>> print(f"{jr.overturning_margin(jr.Scene(jr.Block(0.4, 5.0), 0.7, 0.15)):.3f}")
    0.769
    """
    x, limited = _stabilized_ratio(scene, as_model(model))
    return jnp.where(limited, one_minus_square(x), -jnp.inf)


@elementwise(require_linear_law, model=as_model)
def overturning_half_cycle(scene: Scene, model: ModelLike = Linearized()) -> Reals:
    """Find the first half-cycle in which the block overturns.

    With `Linearized`, it may be too late, since the critical velocity is too large.

    Parameters
    ----------
    scene : Scene
    model : ModelLike

    Returns
    -------
    Array, shape (...)
        Smallest whole i with ``half_cycle_velocity(i) >= critical_velocity``, as a
        floating-point number; inf where there is none. Its derivative is zero.

    Examples
    --------
    >>> import jaxrock as jr
    >>> print(f"{jr.overturning_half_cycle(jr.Scene(jr.Block(0.4, 5.0), 0.7, 0.4)):.0f}")
    5
    """
    # The answer is a whole number: its derivative is zero, whatever those on the way are.
    scene = jax.lax.stop_gradient(scene)
    model = as_model(model)
    launch = launch_velocity(scene)
    critical = model._critical_velocity(scene.block)
    x = launch / critical
    restitution = scene.restitution

    def is_critical(half_cycle: Reals) -> Booleans:
        return launch / share_of_one(restitution, half_cycle) >= critical

    # x (1 - C^i) / (1 - C) >= 1, solved for i: 1 - C^i >= (1 - C) / x, the remainder. From a
    # remainder of 1 on, or NaN without pulses, not even the limit overturns. With C = 1 every
    # pulse adds x.
    remainder = (1 - restitution) / x
    count = jnp.log1p(-remainder) / jnp.log(restitution)
    count = jnp.where(restitution == 1, 1 / x, count)
    # The rounding of the solution may have gone past a whole number, to either side: what
    # counts is the recursion at the numbers around it.
    count = jnp.maximum(jnp.ceil(count), 1)
    earlier = jnp.maximum(count - 1, 1)
    count = jnp.where(is_critical(earlier), earlier, count)
    count = jnp.where(is_critical(count), count, count + 1)
    return jnp.where(x >= 1, 1.0, jnp.where(remainder < 1, count, jnp.inf))


def _stabilized_ratio(scene: Scene, model: RockingModel) -> tuple[Reals, Booleans]:
    """Compute x* = v* / v_c [-], and tell where it is finite; it is 0 where it is not."""
    velocity = stabilized_velocity(scene)
    limited = velocity < jnp.inf
    velocity = jnp.where(limited, velocity, 0)
    return quotient(velocity, model._critical_velocity(scene.block)), limited


def _compute_where_stabilized(
    scene: Scene,
    model: ModelLike,
    quantity: Callable[[RockingModel, Block, Reals, Reals], Reals],
) -> Reals:
    """Compute a quantity from x* and the pulse that launches as fast.

    It is NaN where the block overturns or the launch velocity has no limit.
    """
    model = as_model(model)
    x, limited = _stabilized_ratio(scene, model)
    stands = limited & (x < 1)
    # The single pulse that launches the block at rest as fast as the stabilized phase does.
    pulse = quotient_or_infinite(scene.intensity, 1 - scene.restitution)
    value = quantity(model, scene.block, jnp.where(stands, x, 0), jnp.where(stands, pulse, 0))
    return jnp.where(stands, value, jnp.nan)
