"""The half-cycle map under pulses of finite duration, from one landing velocity to the next.

A pulse begins right after each impact and ends at the next impact at the latest. Small bounces
see only the beginning of the pulse: under a pulse that rises from 0 the map P of landing
velocities is P(v) = C v + O(v^2) for small v > 0, while P(0) is the first landing after a
whole pulse has acted on a block at rest. P is discontinuous at 0 wherever the pulse lifts the
block, and may lead back to 0: bounces then die out in finite time, no further pulse begins,
and the block stays at rest.
"""

import equinox as eqx
import jax
import jax.numpy as jnp

from ..block import Block
from ..driven import Driven, FollowedMotion, follow_driven
from ..ground_motion import Pulse
from ..host import Status
from ..impact import read_restitution, velocity_after_impact
from ..resonance import RockingModel
from ..validation import Booleans, Number, Reals, check_kind, unify_precision

# Time to wait for an impact after the pulse, times p. A block that has not landed by then lies
# on its side, or nearly balances.
_MAX_WAIT = 200.0

PulsedScene = tuple[Block, Reals, Pulse]


def check_pulsed_arguments(
    block: Block, restitution: Number, pulse: Pulse, rtol: float
) -> PulsedScene:
    """Bring a scene to one precision; a `ValueError` if it is not allowed."""
    check_kind("block", block, Block)
    check_kind("pulse", pulse, Pulse)
    if not 0 < rtol <= 1e-3:
        raise ValueError(f"rtol must be greater than 0 and at most 0.001, got {rtol:g}")
    restitution = read_restitution(block, restitution)
    block.check()
    pulse.check()
    for leaf in jax.tree.leaves((block, restitution, pulse)):
        if leaf.ndim:
            raise ValueError(f"arguments must be scalar, got an array of shape {leaf.shape}")
    return unify_precision((block, restitution, pulse))


def follow_half_cycle(
    scene: PulsedScene, velocity: Reals, wait: float, model: RockingModel, rtol: float
) -> FollowedMotion:
    """Follow a block from an impact to the next one, for `wait` / p beyond the pulse at most.

    `velocity` is the velocity just before the impact, as in the map.
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
    # With this absolute tolerance small bounces are as accurate as large ones.
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
    """Limit a tolerance by the precision of an array."""
    return max(rtol, 20 * float(jnp.finfo(like.dtype).eps))


def compute_gap(
    scene: PulsedScene, velocity: Reals, *, model: RockingModel, rtol: float
) -> tuple[Reals, tuple[Reals, ...], Booleans]:
    """Compute the gap P(v) - v of the map, 0 at a fixed point.

    Returns
    -------
    gap : Array
        NaN where the block overturns, or where the integration failed. P(v) is 0 where the
        block stays at rest.
    values : tuple of Array
        Rate of the map, time of the impact, and peak rotation.
    overturns : Array of bool
        Whether the block overturns.
    """

    def find_landing(velocity: Reals) -> tuple[Reals, tuple[Reals, Reals, Booleans]]:
        response, (time, arriving) = follow_half_cycle(scene, velocity, _MAX_WAIT, model, rtol)
        landed = response.impacts > 0
        # Without an impact, NaN of its time and velocity must not enter derivatives.
        landing = jnp.where(landed, jnp.abs(jnp.where(landed, arriving, 1)), 0)
        stays = landed | response.at_rest
        overturns = ~stays & (response.status <= Status.LIST_FULL)
        details = jnp.where(landed, time, 0), response.peak_rotation, overturns
        return jnp.where(stays, landing, jnp.nan), details

    landing, rate, (time, peak, overturns) = jax.jvp(
        find_landing, (velocity,), (jnp.ones_like(velocity),), has_aux=True
    )
    return landing - velocity, (rate, time, peak), overturns
