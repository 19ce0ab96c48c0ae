"""The half-cycle map under pulses of finite duration, from one landing velocity to the next.

A pulse begins right after each impact and ends at the next impact at the latest. Small bounces
see only its beginning: under a pulse that rises from 0 the map P of landing velocities is
P(v) = C v + O(v^2) for small v > 0, while P(0) is the first landing after a whole pulse has
acted on a block at rest. P is discontinuous at 0 wherever the pulse lifts the block, and may
lead back to 0: bounces then die out in finite time, no further pulse begins, and the block
stays at rest.
"""

import equinox as eqx
import jax
import jax.numpy as jnp

from ..block import Block
from ..driven import Driven, FollowedMotion, follow_driven
from ..ground_motion import Pulse
from ..host import Status
from ..impact import read_restitution, velocity_after_impact
from ..numerics import differentiate_by_jacobian
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import (
    NON_NEGATIVE,
    Integers,
    Number,
    Reals,
    as_real,
    check,
    check_kind,
    unify_precision,
)

# Time to wait for an impact after the pulse, times p. A block that has not landed until then
# lies on its side, or all but balances.
LONGEST_WAIT = 200.0
# How a half-cycle ends: with an impact, at rest, on the side (or still in motion), in failure.
LANDS, RESTS, OVERTURNS, FAILS = range(4)

PulsedScene = tuple[Block, Reals, Pulse]
# Outcome, time of the impact, and peak rotation.
Landing = tuple[Integers, Reals, Reals]


def pulsed_next_velocity(
    block: Block,
    restitution: Number,
    pulse: Pulse,
    velocity: Number,
    *,
    model: ModelLike = Nonlinear(),
    rtol: float = 1e-9,
) -> Reals:
    """Apply the half-cycle map: compute the next landing velocity from the present one.

    Parameters
    ----------
    block, restitution : Block, float
        One block; C [-], between 0 and 1, of a one-sided block its magnitude.
    pulse : Pulse
        Acts from each impact on, outward: a positive amplitude pushes the block away from the
        ground, to whichever side it stands on.
    velocity : float
        Angular velocity just before the impact [rad/s], at least 0.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.
    rtol : float
        Tolerance of the integration, at most 0.001.

    Returns
    -------
    Array
        Angular velocity just before the next impact [rad/s]; 0 where the block stays at rest,
        NaN where it overturns. At velocity 0 the block is at rest until the pulse lifts it,
        to either side; a one-sided block is lifted only away from its wall.

    Raises
    ------
    ValueError
        If an argument is not scalar, or a concrete one is out of range.
    """
    scene, velocity = check_pulsed_arguments(block, restitution, pulse, velocity, rtol)
    return _compute_next_velocity(scene, velocity, model=as_model(model), rtol=rtol)


def check_pulsed_arguments(
    block: Block, restitution: Number, pulse: Pulse, velocity: Number, rtol: float
) -> tuple[PulsedScene, Reals]:
    """Bring scene and velocity to one precision; a `ValueError` if they are not allowed."""
    check_kind("block", block, Block)
    check_kind("pulse", pulse, Pulse)
    if not 0 < rtol <= 1e-3:
        raise ValueError(f"rtol must be greater than 0 and at most 0.001, got {rtol:g}")
    restitution = read_restitution(block, restitution)
    velocity = as_real("velocity", velocity, unit="rad/s")
    check("velocity", velocity, NON_NEGATIVE)
    block.check()
    pulse.check()
    arguments = ((block, restitution, pulse), velocity)
    for leaf in jax.tree.leaves(arguments):
        if leaf.ndim:
            raise ValueError(f"arguments must be scalar, got an array of shape {leaf.shape}")
    return unify_precision(arguments)


def follow_half_cycle(
    scene: PulsedScene, velocity: Reals, wait: Reals | float, model: RockingModel, rtol: float
) -> FollowedMotion:
    """Follow a block from an impact to the next one, for `wait` / p beyond the pulse at most.

    `velocity` is the one just before the impact, as in the map.
    """
    block, restitution, pulse = scene
    pulse = eqx.tree_at(lambda p: p.start, pulse, jnp.zeros_like(velocity))
    driven = Driven(
        block=block,
        restitution=restitution,
        motion=pulse,
        duration=pulse.end + wait / block.frequency_parameter,
        rotation=jnp.zeros_like(velocity),
        velocity=velocity_after_impact(restitution, velocity),
    )
    # The absolute tolerance lets small bounces be followed as exactly as large ones.
    rtol = limit_tolerance(velocity, rtol)
    return follow_driven(
        driven,
        rtol=rtol,
        atol=1e-9 * rtol,
        model=model,
        until_first_impact=True,
        with_forces=False,
    )


def limit_tolerance(like: Reals, rtol: float) -> float:
    """Limit a tolerance to what the precision of an array can deliver."""
    return max(rtol, 20 * float(jnp.finfo(like.dtype).eps))


def compute_landing(
    scene: PulsedScene, velocity: Reals, model: RockingModel, rtol: float
) -> tuple[Reals, Landing]:
    """Compute the next landing velocity, and what else the half-cycle ended with."""
    return read_landing(follow_half_cycle(scene, velocity, LONGEST_WAIT, model, rtol))


def read_landing(followed: FollowedMotion) -> tuple[Reals, Landing]:
    """Read from a half-cycle its landing velocity, and what else it ended with."""
    response = followed.response
    landed = response.impacts > 0
    time, arriving = followed.last_impact
    # Where there is no impact its numbers are no factors of a derivative.
    landing = jnp.where(landed, jnp.abs(jnp.where(landed, arriving, 1)), 0)
    over = jnp.where(response.status <= Status.LIST_FULL, OVERTURNS, FAILS)
    outcome = jnp.where(landed, LANDS, jnp.where(response.at_rest, RESTS, over))
    return landing, (outcome, jnp.where(landed, time, 0), followed.response.peak_rotation)


@eqx.filter_jit
@differentiate_by_jacobian
def _compute_next_velocity(
    scene: PulsedScene, velocity: Reals, *, model: RockingModel, rtol: float
) -> Reals:
    """Apply the half-cycle map, compiled; NaN where the block does not land or rest."""
    landing, (outcome, *_) = compute_landing(scene, velocity, model, rtol)
    return jnp.where(outcome <= RESTS, landing, jnp.nan)
