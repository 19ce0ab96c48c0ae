"""Friction demand and normal force at the base, and their extremes within a step.

Between the ends of a step rotation and velocity are interpolated (`Arc`), and the forces follow
from the equation of motion. In most steps a few nodes show that the extremes cannot change,
and nothing more is computed.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ...block import RECTANGLE_INERTIA_RATIO
from ...numerics import pick_larger, pick_largest, pick_smaller
from ...validation import Reals
from .solver_steps import Arc, Segment

# Points of a step at which the forces are computed, as fractions of its length.
_NODES = np.arange(9) / 8
# Rounds that narrow down the loss of contact, to 8^-5, which is 3e-5 of the step.
_LOSS_ROUNDS = 5


class ForceExtremes(NamedTuple):
    """Extremes of the forces between base and ground so far, over the weight."""

    demand: Reals  # largest friction demand: horizontal over normal force
    normal: Reals  # smallest normal force
    loss_time: Reals  # first time without a normal force, inf before

    def combine(self, demand: Reals, normal: Reals, loss_time: Reals) -> "ForceExtremes":
        """Combine these extremes with others."""
        return ForceExtremes(
            pick_larger(self.demand, demand),
            pick_smaller(self.normal, normal),
            pick_smaller(self.loss_time, loss_time),
        )


def friction_demand(horizontal: Reals, normal: Reals) -> Reals:
    """Friction demand: horizontal over normal force, inf without a normal force."""
    # Where the quotient is not used, the divisor is 1: NaN would enter derivatives.
    presses = normal > 0
    return jnp.where(presses, jnp.abs(horizontal) / jnp.where(presses, normal, 1), jnp.inf)


def add_step(extremes: ForceExtremes, segment: Segment, arc: Arc) -> ForceExtremes:
    """Combine the extremes so far with the extremes in a step.

    The extremes are sought at nodes, and at the vertex of the parabola through each three
    successive nodes, once for the demand and once for the normal force. The loss time lies
    before the first node without a normal force, or where this is smallest; that interval is
    divided again and again.
    """
    nodes = jnp.asarray(_NODES, arc.y.dtype)
    # In the shortest steps, which change nothing, the quintic's velocity between the ends is a
    # quotient of rounding errors: only their ends count. A step is short if p times its length
    # is less than sqrt(eps) times the rotation.
    eps = float(jnp.finfo(nodes.dtype).eps)
    scaled_length = (arc.end - arc.begin) * jnp.sqrt(segment.equation.p_squared)
    long = eps**0.5 * jnp.abs(arc.y[0]) <= scaled_length
    used = long | (_NODES == 0) | (_NODES == 1)

    @jax.jit
    def find_largest(horizontal: Reals, normal: Reals) -> Reals:
        # Not `max`: its derivative divides by the number of elements equal to the maximum, which
        # is 0 if XLA has recomputed them with different rounding.
        forces = jnp.stack([friction_demand(horizontal, normal), -normal])
        return pick_largest(jnp.where(used[None], forces, -jnp.inf))

    horizontal, normal = _compute_forces(segment, arc, nodes)
    largest = find_largest(horizontal, normal)
    # Most steps come nowhere near the extremes so far, which values at nodes show: between
    # nodes the forces exceed those values by much less than half their spread. The demand
    # is compared as a product, demand times normal force, since the quotient may be
    # infinite. Once it is, nothing can exceed it.
    finite = extremes.demand < jnp.inf
    slides = jnp.abs(horizontal) - jnp.where(finite, extremes.demand, 0) * normal
    steeper = finite & (1.5 * slides.max() - 0.5 * slides.min() >= 0)
    lighter = 1.5 * normal.min() - 0.5 * normal.max() <= extremes.normal
    matters = steeper | lighter

    def add_vertices() -> Reals:
        first, second = (
            find_largest(*_compute_forces(segment, arc, points))
            for points in _find_vertices(horizontal, normal)
        )
        return pick_larger(largest, pick_larger(first, second))

    def narrow(_: object, bracket: Reals) -> Reals:
        points = bracket[0] + bracket[1] * nodes
        first = jnp.argmin(jnp.maximum(_compute_forces(segment, arc, points)[1], 0))
        return jnp.stack([points[jnp.maximum(first - 1, 0)], bracket[1] * nodes[1]])

    largest = jax.lax.cond(matters, add_vertices, lambda: largest)
    rounds = jnp.where(matters & (largest[1] >= 0), _LOSS_ROUNDS, 0)
    # Where the loss of contact may begin, and the width from there, as fractions of the step.
    bracket = jax.lax.fori_loop(0, rounds, narrow, jnp.array([0, 1], nodes.dtype))
    time = segment.origin + arc.begin + bracket.sum() * (arc.end - arc.begin)
    loss_time = jnp.where(largest[1] < 0, jnp.inf, jax.lax.stop_gradient(time))
    return extremes.combine(largest[0], -largest[1], loss_time)


def _find_vertices(horizontal: Reals, normal: Reals) -> Reals:
    """Find the vertices of the parabolas through each three nodes, for both forces."""
    # The angle of the force is smooth where the normal force vanishes, the demand is not.
    curves = jnp.stack([jnp.arctan2(jnp.abs(horizontal), normal), normal])
    slope = 0.5 * (curves[:, 2:] - curves[:, :-2])
    curvature = curves[:, 2:] - 2 * curves[:, 1:-1] + curves[:, :-2]
    vertex = jnp.clip(-slope / jnp.where(curvature == 0, 1, curvature), -1, 1)
    nodes = jnp.asarray(_NODES, normal.dtype)
    return nodes[None] + nodes[1] * jnp.pad(vertex, ((0, 0), (1, 1)))


# Jitted, so that a program has it once.
@jax.jit
def _compute_forces(segment: Segment, arc: Arc, points: Reals) -> Reals:
    """Compute horizontal and normal force, over the weight, at points of a step."""
    # At both ends the states themselves are used: interpolation would round them.
    rotation, velocity = (
        jnp.where(points == 0, first, jnp.where(points == 1, last, inside))
        for first, last, inside in zip(arc.y, arc.last, arc.interpolate(points), strict=True)
    )

    # The forces are mass times the acceleration of the centre of mass. The centre is at the
    # distance R from the edge on which the block turns. For a rectangle p^2 R / g = 3 / 4; for
    # other blocks it is inversely proportional to the inertia.
    equation = segment.equation
    push, lift = segment.ground(arc.begin + points * (arc.end - arc.begin))
    acceleration = equation.acceleration(rotation, push, lift)
    tilt = equation.critical_angle - rotation
    # This order of operations keeps all bits of the forces on a rectangle and their
    # derivatives.
    radius_over_g = (
        0.75 / equation.p_squared * (RECTANGLE_INERTIA_RATIO / equation.inertia_ratio)
    )
    sine, cosine = radius_over_g * jnp.sin(tilt), radius_over_g * jnp.cos(tilt)
    square = velocity**2
    forces = (
        cosine * acceleration + sine * square - push,
        1 + lift + sine * acceleration - cosine * square,
    )
    # One array: if it were two, a program would have this again for each use of one of them.
    return jnp.stack(forces)
