"""Whether a block stands or overturns: what energy says once the ground is at rest."""

import math

import jax.numpy as jnp

from ..block import Block
from ..impact import velocity_after_impact
from ..resonance import ModelLike, Nonlinear, as_model
from ..validation import FINITE, UNIT_INTERVAL, Number, Reals, elementwise
from .equation import Equation

# Rotation at which a block lies on its side, whatever the ground does [rad].
TOPPLED_ROTATION = 0.5 * math.pi


def free_motion_margins(
    equation: Equation, restitution: Reals, rotation: Reals, velocity: Reals
) -> tuple[Reals, Reals]:
    """Margins to overturning before the next impact, and on the other side after it."""
    critical = equation.critical_velocity
    before = (equation.returning_velocity(rotation) - velocity) / critical
    # A block that lands with more than the critical velocity may overturn on the other side.
    landing = equation.landing_velocity(rotation, velocity)
    after = 1 - velocity_after_impact(restitution, landing) / critical
    return before, after


def smaller_margin(before: Reals, after: Reals) -> Reals:
    """Return the smaller of `free_motion_margins`, and the first where they differ by rounding.

    With C = 1 both vanish at one threshold. A smaller C moves only the second margin there, so
    the first one has the derivative of the threshold.
    """
    rounding = 64 * float(jnp.finfo(before.dtype).eps)
    return jnp.where(after < before - rounding, after, before)


@elementwise(restitution=UNIT_INTERVAL, rotation=FINITE, velocity=FINITE, model=as_model)
def free_motion_margin(
    block: Block,
    restitution: Number,
    rotation: Number,
    velocity: Number,
    model: ModelLike = Nonlinear(),
) -> Reals:
    """Compute how far a block in free motion is from overturning; negative where it overturns.

    From a rotation [rad] and velocity [rad/s] on, with the ground at rest. A block beyond the
    critical angle has not overturned yet: one that moves back fast enough returns, and may
    then overturn on the other side. The margin is continuous everywhere and smooth through 0.

    Returns the smaller of ``(D - v) / v_c`` and ``1 - C v_i / v_c`` [-]: v outward velocity, D
    = 2 p sin((alpha_c - abs(alpha)) / 2) the one that just fails to come back, v_i the one at
    the next impact, v_c the critical velocity. 1 at rest.

    Examples
    --------
    >>> import jaxrock as jr
    >>> block = jr.Block(half_width=0.2, slenderness=5.0)
    >>> critical = jr.Nonlinear().critical_velocity(block)
    >>> print(f"{jr.driven.free_motion_margin(block, 0.9, 0.0, 0.25 * critical):.2f}")
    0.75
    """
    equation = Equation.of(block, as_model(model))
    backward = jnp.where(rotation == 0, velocity, rotation) < 0
    outward = jnp.where(backward, -jnp.asarray(velocity), velocity)
    margins = free_motion_margins(
        equation, jnp.asarray(restitution), jnp.abs(rotation), outward
    )
    return smaller_margin(*margins)
