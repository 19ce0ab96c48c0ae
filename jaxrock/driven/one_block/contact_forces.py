"""Friction demand and normal force at the base, and their extremes within a step.

The integrator gives the state at both ends of a step only. Between them the rotation is taken
from the quintic through the rotation, velocity and acceleration of both ends, and the forces
from the equation of motion at its states. `add_step` looks at a few nodes first: most steps
cannot change the extremes, and no more is computed for them.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ...block import RECTANGLE_INERTIA_RATIO
from ...numerics import pick_larger, pick_largest, pick_smaller
from ...validation import Booleans, Reals
from .solver_steps import Segment

# Shares of a step at which the forces are computed.
_NODES = np.arange(9) / 8
# The quintic in the share s of a step is a parabola through the state at the beginning,
#   rotation(s) = r + r' s + r'' / 2 s^2 + c3 s^3 + c4 s^4 + c5 s^5,
# whose last terms make up for the error of the parabola at the end, s = 1: e0 of the rotation,
# e1 of the first derivative, e2 of half the second one. The three equations
#   c3 + c4 + c5 = e0,   3 c3 + 4 c4 + 5 c5 = e1,   3 c3 + 6 c4 + 10 c5 = e2
# have this inverse: each row gives one coefficient from e0, e1, e2.
_QUINTIC = ((10, -4, 1), (-15, 7, -2), (6, -3, 1))


class ForceExtremes(NamedTuple):
    """Extremes of the forces between base and ground so far, over the weight."""

    demand: Reals  # largest friction demand: horizontal over normal force
    normal: Reals  # smallest normal force
    loss_time: Reals  # first time at which nothing presses any longer, inf before

    def combine(self, demand: Reals, normal: Reals, loss_time: Reals) -> "ForceExtremes":
        """Combine these extremes with others."""
        return ForceExtremes(
            pick_larger(self.demand, demand),
            pick_smaller(self.normal, normal),
            pick_smaller(self.loss_time, loss_time),
        )


def friction_demand(horizontal: Reals, normal: Reals) -> Reals:
    """Friction demand: horizontal over normal force, inf where nothing presses."""
    # A harmless divisor where the quotient is not used: NaN would get into derivatives.
    presses = normal > 0
    return jnp.where(presses, jnp.abs(horizontal) / jnp.where(presses, normal, 1), jnp.inf)


def add_step(
    extremes: ForceExtremes,
    segment: Segment,
    times: Reals,
    states: Reals,
    accelerations: Reals,
    counts: Booleans,
) -> ForceExtremes:
    """Combine the extremes so far with the extremes in a step, if that counts.

    Parameters
    ----------
    extremes : ForceExtremes
        So far.
    segment : Segment
    times, states, accelerations : Array, shape (2,), (2, 2), (2,)
        At both ends of the step; `states` has rotation and velocity in its rows.
    counts : Array of bool
        Whether the step counts; a step that is rejected or repeated does not.
    """
    # Most steps come nowhere near the extremes so far, which values at nodes show: between
    # nodes the forces exceed those values by much less than half their spread.
    step = jax.lax.stop_gradient((segment, times, states, accelerations))
    horizontal, normal = _compute_forces_at(*step, jnp.asarray(_NODES, times.dtype))
    demand, least, _ = jax.lax.stop_gradient(extremes)
    # The demand is compared as a product, demand times normal force, since the quotient may be
    # infinite. Once it is, nothing can exceed it.
    finite = demand < jnp.inf
    slides = jnp.abs(horizontal) - jnp.where(finite, demand, 0) * normal
    steeper = finite & (1.5 * slides.max() - 0.5 * slides.min() >= 0)
    lighter = 1.5 * normal.min() - 0.5 * normal.max() <= least

    def combine_with_step() -> ForceExtremes:
        demand, normal = _find_extremes_of_step(segment, times, states, accelerations)
        loss_time = jnp.where(normal > 0, jnp.inf, segment.origin + _find_loss_time(*step))
        return extremes.combine(demand, normal, loss_time)

    return jax.lax.cond(counts & (steeper | lighter), combine_with_step, lambda: extremes)


def _find_extremes_of_step(
    segment: Segment, times: Reals, states: Reals, accelerations: Reals
) -> tuple[Reals, Reals]:
    """Find the largest friction demand and smallest normal force within a step.

    They are sought at nodes, and at the vertex of the parabola through each three successive
    nodes, once for the demand and once for the normal force.
    """
    nodes = jnp.asarray(_NODES, times.dtype)
    horizontal, normal = _compute_forces_at(segment, times, states, accelerations, nodes)
    # The angle of the force is smooth where the normal force vanishes, the demand is not.
    curves = jnp.stack([jnp.arctan2(jnp.abs(horizontal), normal), normal])
    slope = 0.5 * (curves[:, 2:] - curves[:, :-2])
    curvature = curves[:, 2:] - 2 * curves[:, 1:-1] + curves[:, :-2]
    vertex = jnp.clip(-slope / jnp.where(curvature == 0, 1, curvature), -1, 1) / (
        _NODES.size - 1
    )
    shares = nodes[None] + jnp.pad(vertex, ((0, 0), (1, 1)))
    refined = _compute_forces_at(segment, times, states, accelerations, shares.reshape(-1))
    horizontal, normal = (
        jnp.concatenate([at_nodes, at_vertices])
        for at_nodes, at_vertices in zip((horizontal, normal), refined, strict=True)
    )
    # In the shortest steps, which change nothing, the quintic's velocity between the ends is a
    # quotient of rounding errors: only their ends count. A step is short if p times its length
    # is less than sqrt(eps) times the rotation.
    eps = float(jnp.finfo(nodes.dtype).eps)
    step = times[1] - times[0]
    long = eps**0.5 * jnp.abs(states[0, 0]) <= step * jnp.sqrt(segment.equation.p_squared)
    counts = jnp.tile(long | (nodes == 0) | (nodes == 1), 3)
    # Not `max`: its derivative divides by the number of elements equal to the maximum, which is
    # 0 if XLA has recomputed them with different rounding.
    demand = pick_largest(jnp.where(counts, friction_demand(horizontal, normal), 0))
    return demand, -pick_largest(-jnp.where(counts, normal, jnp.inf))


def _find_loss_time(
    segment: Segment, times: Reals, states: Reals, accelerations: Reals
) -> Reals:
    """Find when the normal force vanishes in a step, or is smallest; without derivative.

    Each of five rounds keeps the interval before the first node without a normal force, and
    divides it again into eight: to 8^-5, which is 3e-5 of the step.
    """

    def narrow(_: object, bracket: tuple[Reals, Reals]) -> tuple[Reals, Reals]:
        share, width = bracket
        shares = share + width * jnp.asarray(_NODES, times.dtype)
        normal = _compute_forces_at(segment, times, states, accelerations, shares)[1]
        gone = normal <= 0
        first = jnp.where(gone.any(), jnp.argmax(gone), jnp.argmin(normal))
        return shares[jnp.maximum(first - 1, 0)], width / (_NODES.size - 1)

    whole = jnp.zeros_like(times[0]), jnp.ones_like(times[0])
    share, width = jax.lax.fori_loop(0, 5, narrow, whole)
    return times[0] + (share + width) * (times[1] - times[0])


@jax.jit
def _compute_forces_at(
    segment: Segment, times: Reals, states: Reals, accelerations: Reals, share: Reals
) -> tuple[Reals, Reals]:
    """Compute horizontal and normal force over weight at shares of a step, on its quintic."""
    # Time in units of the step: `drift` is the first derivative, `bend` half the second one.
    begin = times[0]
    step = times[1] - times[0]
    drift = step * states[1]
    bend = 0.5 * step**2 * accelerations
    excess = states[0, 1] - states[0, 0] - drift[0] - bend[0]
    missed = jnp.stack([excess, drift[1] - drift[0] - 2 * bend[0], bend[1] - bend[0]])
    higher = (jnp.asarray(_QUINTIC, missed.dtype) * missed[None]).sum(axis=1)
    coefficients = jnp.concatenate([drift[:1], bend[:1], higher])[:, None]
    powers = [jnp.ones_like(share)]
    for _ in range(4):
        powers.append(powers[-1] * share)
    terms = coefficients * jnp.stack(powers)
    rotation = states[0, 0] + share * terms.sum(axis=0)
    exponents = jnp.arange(1, 6, dtype=missed.dtype)[:, None]
    velocity = (exponents * terms).sum(axis=0) / jnp.where(step > 0, step, 1)
    inside = jnp.stack([rotation, velocity])
    # At the ends the states themselves, which rounding would not give back.
    first = share[None] == 0
    last = share[None] == 1
    y = jnp.where(first, states[:, :1], jnp.where(last, states[:, 1:], inside))

    # The forces are mass times the acceleration of the centre of mass. That is at the distance
    # R from the edge on which the block turns, with p^2 R / g = 3 / 4 for a rectangle, and in
    # proportion to the inverse of the inertia for other blocks.
    equation = segment.equation
    push, lift = segment.ground(begin + share * step)
    acceleration = equation.acceleration(y[0], push, lift)
    sine, cosine = (f(equation.critical_angle - y[0]) for f in (jnp.sin, jnp.cos))
    # In this order, so that forces on a rectangle and their derivatives keep all bits.
    radius_over_g = (
        0.75 / equation.p_squared * (RECTANGLE_INERTIA_RATIO / equation.inertia_ratio)
    )
    horizontal = radius_over_g * (cosine * acceleration + sine * y[1] ** 2) - push
    normal = 1 + lift + radius_over_g * (sine * acceleration - cosine * y[1] ** 2)
    return horizontal, normal
