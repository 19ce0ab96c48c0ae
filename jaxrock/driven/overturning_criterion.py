"""The overturning criterion: by energy, once the ground is at rest."""

import math

import jax.numpy as jnp

from ..block import Block
from ..impact import prepare_restitution, velocity_after_impact
from ..resonance import ModelLike, Nonlinear, as_model
from ..validation import FINITE, UNIT_INTERVAL, Number, Reals, elementwise
from .equation import Equation

# Rotation at which a block lies on its side, whatever the ground does [rad].
TOPPLED_ROTATION = 0.5 * math.pi


def free_motion_margins(
    equation: Equation, restitution: Reals, rotation: Reals, velocity: Reals
) -> tuple[Reals, Reals]:
    """Margins to overturning before the next impact, and on the other side after it.

    Both are differences of velocities over the critical velocity, 1 at rest and 0 at the
    threshold.
    """
    critical = equation.critical_velocity
    before = (equation.returning_velocity(rotation) - velocity) / critical
    # A block that lands with more than the critical velocity may overturn on the other side.
    landing = equation.landing_velocity(rotation, velocity)
    after = 1 - velocity_after_impact(restitution, landing, equation.velocity_unit) / critical
    return before, after


def pick_smaller_margin(before: Reals, after: Reals) -> Reals:
    """Pick the smaller of `free_motion_margins`, or the first if they differ by rounding.

    With C = 1 both vanish at one threshold. A smaller C moves only the second margin there, so
    the first one has the derivative of the threshold.
    """
    # This exceeds the rounding of both margins, each a root of a sum of a few terms.
    rounding = 64 * float(jnp.finfo(before.dtype).eps)
    return jnp.where(after < before - rounding, after, before)


@elementwise(
    prepare_restitution,
    restitution=UNIT_INTERVAL,
    rotation=FINITE,
    velocity=FINITE,
    model=as_model,
)
def free_motion_margin(
    block: Block,
    restitution: Number,
    rotation: Number,
    velocity: Number,
    model: ModelLike = Nonlinear(),
) -> Reals:
    """Compute how far a block in free motion is from overturning; negative where it overturns.

    The motion begins with a rotation [rad] and velocity [rad/s], with the ground at rest. A
    block beyond the critical angle has not overturned yet: one that moves back fast enough
    returns, and may then overturn on the other side. The margin is smooth through 0. It is
    continuous except at rotation 0: for C < 1 a block that moves towards the ground loses
    velocity there, and a block on the ground does not.

    Parameters
    ----------
    block : Block
    restitution : array_like
        C, velocity after an impact over velocity before it [-], between 0 and 1.
    rotation : array_like
        Rotation alpha [rad], finite; of a one-sided block at least 0, else NaN.
    velocity : array_like
        Angular velocity [rad/s], finite.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.

    Returns
    -------
    Array, shape (...)
        The smaller of ``(D - v) / v_c`` and ``1 - C v_i / v_c`` [-]: v is the outward velocity,
        D = 2 p sin((alpha_c - abs(alpha)) / 2) the outward velocity from which the block just
        fails to come back, v_i the velocity at the next impact, and v_c the critical velocity.
        The margin is 1 at rest.

    Raises
    ------
    ValueError
        If a concrete `restitution` or `rotation` or `velocity` is out of range. A traced one
        gives NaN.

    Examples
    --------
    >>> import jaxrock as jr
    >>> block = jr.Block(half_width=0.2, slenderness=5.0)
    >>> critical = jr.Nonlinear().critical_velocity(block)
    >>> print(f"{jr.driven.free_motion_margin(block, 0.9, 0.0, 0.25 * critical):.2f}")
    0.75
    """
    equation = Equation.of(block, as_model(model))
    # A block on the ground stands on the side to which it moves.
    backward = (jnp.where(rotation == 0, velocity, rotation) < 0) & (not block.one_sided)
    speed = jnp.where(backward, -jnp.asarray(velocity), velocity)
    margins = free_motion_margins(equation, jnp.asarray(restitution), jnp.abs(rotation), speed)
    margin = pick_smaller_margin(*margins)
    # A negative rotation lies behind the wall.
    return jnp.where(jnp.asarray(rotation) < 0, jnp.nan, margin) if block.one_sided else margin
