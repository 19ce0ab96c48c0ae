"""Stands or overturns: what energy says once the ground is at rest."""

import jax.numpy as jnp

from ..block import Block
from ..resonance import ModelLike, Nonlinear, as_model
from ..validation import FINITE, UNIT_INTERVAL, Number, Reals, elementwise
from .equation import Equation


def margins_of(
    equation: Equation, restitution: Reals, lean: Reals, speed: Reals
) -> tuple[Reals, Reals]:
    """How far a lean and its rate are from overturning at once, and after one more impact."""
    critical = equation.critical_velocity
    here = (equation.returning_speed(lean) - speed) / critical
    # A block that comes back with more than it left with may go over on the other side.
    beyond = 1 - restitution * equation.landing_speed(lean, speed) / critical
    return here, beyond


@elementwise(restitution=UNIT_INTERVAL, rotation=FINITE, velocity=FINITE, model=as_model)
def free_motion_margin(
    block: Block,
    restitution: Number,
    rotation: Number,
    velocity: Number,
    model: ModelLike = Nonlinear(),
) -> Reals:
    """How far a block in free motion is from overturning; negative where it overturns.

    Being beyond the critical angle is not overturning: a block that moves back fast enough
    comes back, and may then overturn on the other side. Smooth through the verge, and
    continuous everywhere.

    Parameters
    ----------
    block : Block
    restitution : array_like
        C [-], between 0 and 1.
    rotation, velocity : array_like
        State [rad], [rad/s], with the ground at rest from now on.
    model : Nonlinear or Linearized
        Equation of the free motion.

    Returns
    -------
    margin : Array, shape (...)
        The smaller of ``(D - v) / v_c`` and ``1 - C v_i / v_c`` [-]: v outward velocity, D =
        2 p sin((alpha_c - abs(alpha)) / 2) the one that just fails to come back, v_i the
        one at the next impact, v_c the critical velocity. 1 at rest.

    Raises
    ------
    ValueError
        If a concrete restitution, rotation or velocity is out of range; traced, it gives NaN.

    Examples
    --------
    >>> import jaxrock as jr
    >>> block = jr.Block(half_width=0.2, slenderness=5.0)
    >>> critical = jr.Nonlinear().critical_velocity(block)
    >>> print(f"{jr.dynamics.free_motion_margin(block, 0.9, 0.0, 0.25 * critical):.2f}")
    0.75
    """
    model = as_model(model)
    equation = Equation.of(block, model)
    backward = jnp.where(rotation == 0, velocity, rotation) < 0
    speed = jnp.where(backward, -jnp.asarray(velocity), velocity)
    return jnp.minimum(*margins_of(equation, jnp.asarray(restitution), jnp.abs(rotation), speed))
