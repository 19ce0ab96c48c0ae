"""Friction demand and normal force at the base, and their extremes within a step."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ...block import RECTANGLE_INERTIA_RATIO
from ...numerics import larger, smaller
from ...validation import Booleans, Reals
from .solver_steps import Segment

_NODES = np.arange(9) / 8
# Coefficients of the third, fourth and fifth power of a quintic: what the first three powers
# miss at the end of a step in the rotation, in its slope, and in half its second derivative.
_QUINTIC = ((10, -4, 1), (-15, 7, -2), (6, -3, 1))


class Forces(NamedTuple):
    """Between the base and the ground, over the weight."""

    demand: Reals  # of friction, the largest
    normal: Reals  # the smallest
    loss: Reals  # time when nothing presses any longer, inf before

    def and_also(self, demand: Reals, normal: Reals, loss: Reals) -> "Forces":
        """Combine these extremes with others."""
        return Forces(
            larger(self.demand, demand), smaller(self.normal, normal), smaller(self.loss, loss)
        )


def friction(horizontal: Reals, normal: Reals) -> Reals:
    """Friction demand: horizontal over normal force, inf where nothing presses."""
    presses = normal > 0
    return jnp.where(presses, jnp.abs(horizontal) / jnp.where(presses, normal, 1), jnp.inf)


def with_step(
    extremes: Forces,
    segment: Segment,
    times: Reals,
    states: Reals,
    accelerations: Reals,
    counts: Booleans,
) -> Forces:
    """Combine the extremes so far with those in a step, if that counts."""
    # Most steps come nowhere near the extremes so far, which values at nodes show: between
    # nodes the forces exceed those values by much less than half their spread.
    step = jax.lax.stop_gradient((segment, times, states, accelerations))
    horizontal, normal = _at_shares(*step, jnp.asarray(_NODES, times.dtype))
    demand, least, _ = jax.lax.stop_gradient(extremes)
    finite = demand < jnp.inf
    slides = jnp.abs(horizontal) - jnp.where(finite, demand, 0) * normal
    steeper = finite & (1.5 * slides.max() - 0.5 * slides.min() >= 0)
    lighter = 1.5 * normal.min() - 0.5 * normal.max() <= least

    def changed() -> Forces:
        demand, normal = _extremes_of_step(segment, times, states)
        loss = jnp.where(normal > 0, jnp.inf, segment.origin + _time_of_loss(*step))
        return extremes.and_also(demand, normal, loss)

    return jax.lax.cond(counts & (steeper | lighter), changed, lambda: extremes)


def _extremes_of_step(segment: Segment, times: Reals, states: Reals) -> tuple[Reals, Reals]:
    """Largest friction demand and smallest normal force within a step.

    On the quintic through the states and accelerations of both ends: at nodes, and at the
    vertex of the parabola through each three successive nodes.
    """
    nodes = jnp.asarray(_NODES, times.dtype)
    accelerations = segment.field(times, states)[1]
    horizontal, normal = _at_shares(segment, times, states, accelerations, nodes)
    # The angle of the force is smooth where the normal force vanishes, the demand is not.
    curves = jnp.stack([jnp.arctan2(jnp.abs(horizontal), normal), normal])
    slope = 0.5 * (curves[:, 2:] - curves[:, :-2])
    curvature = curves[:, 2:] - 2 * curves[:, 1:-1] + curves[:, :-2]
    vertex = jnp.clip(-slope / jnp.where(curvature == 0, 1, curvature), -1, 1) / (
        _NODES.size - 1
    )
    shares = nodes[None] + jnp.pad(vertex, ((0, 0), (1, 1)))
    refined = [_at_shares(segment, times, states, accelerations, shares[k]) for k in range(2)]
    horizontal, normal = map(jnp.stack, zip((horizontal, normal), *refined, strict=True))
    # In the shortest steps, which change nothing, the velocity between the ends is rounding.
    eps = float(jnp.finfo(nodes.dtype).eps)
    step = times[1] - times[0]
    long = eps**0.5 * jnp.abs(states[0, 0]) <= step * jnp.sqrt(segment.equation.p_squared)
    counts = (long | (nodes == 0) | (nodes == 1))[None]
    demand = jnp.where(counts, friction(horizontal, normal), 0).max()
    return demand, jnp.where(counts, normal, jnp.inf).min()


def _time_of_loss(
    segment: Segment, times: Reals, states: Reals, accelerations: Reals
) -> Reals:
    """Find when the normal force vanishes in a step, or is smallest; without derivative."""

    def narrower(_: Any, bracket: tuple[Reals, Reals]) -> tuple[Reals, Reals]:
        share, width = bracket
        shares = share + width * jnp.asarray(_NODES, times.dtype)
        normal = _at_shares(segment, times, states, accelerations, shares)[1]
        gone = normal <= 0
        first = jnp.where(gone.any(), jnp.argmax(gone), jnp.argmin(normal))
        return shares[jnp.maximum(first - 1, 0)], width / (_NODES.size - 1)

    whole = jnp.zeros_like(times[0]), jnp.ones_like(times[0])
    share, width = jax.lax.fori_loop(0, 5, narrower, whole)
    return times[0] + (share + width) * (times[1] - times[0])


@jax.jit
def _at_shares(
    segment: Segment, times: Reals, states: Reals, accelerations: Reals, share: Reals
) -> tuple[Reals, Reals]:
    """Horizontal and normal force over weight at shares of a step, on its quintic."""
    begin = times[0]
    step = times[1] - times[0]
    drift = step * states[1]
    bend = 0.5 * step**2 * accelerations
    excess = states[0, 1] - states[0, 0] - drift[0] - bend[0]
    missed = jnp.stack([excess, drift[1] - drift[0] - 2 * bend[0], bend[1] - bend[0]])
    higher: Any = (jnp.asarray(_QUINTIC, missed.dtype) * missed[None]).sum(axis=1)
    coefficients = jnp.concatenate([drift[:1], bend[:1], higher])[:, None]
    powers = [jnp.ones_like(share)]
    for _ in range(4):
        powers.append(powers[-1] * share)
    terms = coefficients * jnp.stack(powers)
    rotation = states[0, 0] + share * terms.sum(axis=0)
    exponents = jnp.arange(1, 6, dtype=missed.dtype)[:, None]
    velocity = (exponents * terms).sum(axis=0) / jnp.where(step > 0, step, 1)
    inside = jnp.stack([rotation, velocity])
    # At the ends the states themselves, which rounding would not return.
    first = share[None] == 0
    last = share[None] == 1
    y = jnp.where(first, states[:, :1], jnp.where(last, states[:, 1:], inside))
    # From the acceleration of the centre of mass.
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
