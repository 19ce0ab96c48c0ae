"""Friction demand and normal force of a block, and what they come to within a step."""

from typing import Any

import jax
import jax.numpy as jnp

from ..validation import Booleans, Reals
from .segment import Span

_NODES = 9
# Third, fourth and fifth power of the time, of what the first three leave at the end of a step of
# the lean, of its slope and of half its second derivative.
_QUINTIC = ((10, -4, 1), (-15, 7, -2), (6, -3, 1))


def larger(kept: Reals, new: Reals, counts: Any = True) -> Reals:
    """The larger one; of two that are equal the first, with the whole of its derivative."""
    return jnp.where(counts & (new > kept), new, kept)


def smaller(kept: Reals, new: Reals, counts: Any = True) -> Reals:
    """The smaller one, as in `larger`."""
    return jnp.where(counts & (new < kept), new, kept)


def largest(values: Reals) -> Reals:
    """The largest of a row, as in `larger`: `max` of equal ones takes the mean derivative."""
    return values[jnp.argmax(values)]


def friction(horizontal: Reals, normal: Reals) -> Reals:
    """Friction demand: horizontal over normal force, inf where nothing presses."""
    presses = normal > 0
    return jnp.where(presses, jnp.abs(horizontal) / jnp.where(presses, normal, 1), jnp.inf)


def forces(span: Span, time: Reals, y: Reals) -> tuple[Reals, Reals]:
    """Horizontal and normal force over weight, from the acceleration of the centre of mass."""
    push, lift = span.ground(time)
    equation = span.equation
    rate = equation.acceleration(y[0], push, lift)
    sine, cosine = (f(equation.critical_angle - y[0]) for f in (jnp.sin, jnp.cos))
    radius_over_g = 0.75 / equation.square
    horizontal = radius_over_g * (cosine * rate + sine * y[1] ** 2) - push
    normal = 1 + lift + radius_over_g * (sine * rate - cosine * y[1] ** 2)
    return horizontal, normal


def beyond(
    span: Span,
    times: Reals,
    states: Reals,
    rates: Reals,
    kept: tuple[Reals, Reals],
    counts: Booleans,
) -> tuple[Reals, Reals]:
    """The extremes that are kept, or those of a step, if it counts, where they are beyond them.

    Most steps come nowhere near: what lies between the nodes is beyond them by much less than
    a part of their spread.
    """
    step = jax.lax.stop_gradient((span, times, states, rates))
    horizontal, normal = _at_shares(*step, _nodes(times))
    demand, least = jax.lax.stop_gradient(kept)
    finite = demand < jnp.inf
    slides = jnp.abs(horizontal) - jnp.where(finite, demand, 0) * normal
    steeper = finite & (1.5 * slides.max() - 0.5 * slides.min() >= 0)
    lighter = 1.5 * normal.min() - 0.5 * normal.max() <= least

    def changed() -> tuple[Reals, Reals]:
        demand, normal = extremes(span, times, states)
        return larger(kept[0], demand), smaller(kept[1], normal)

    return jax.lax.cond(counts & (steeper | lighter), changed, lambda: kept)


def extremes(span: Span, times: Reals, states: Reals) -> tuple[Reals, Reals]:
    """Largest friction demand and smallest normal force within a step.

    At its ends, and between them on the polynomial that has their states and accelerations:
    at nodes, and at the extreme value of the parabola through each three of them that follow
    one another.
    """
    nodes = _nodes(times)
    rates = span.field(times, states)[1]
    horizontal, normal = _at_shares(span, times, states, rates, nodes)
    # The angle of the force is smooth where the normal force vanishes.
    curves = jnp.stack([jnp.arctan2(jnp.abs(horizontal), normal), normal])
    rise = 0.5 * (curves[:, 2:] - curves[:, :-2])
    bent = curves[:, 2:] - 2 * curves[:, 1:-1] + curves[:, :-2]
    moved = jnp.clip(-rise / jnp.where(bent == 0, 1, bent), -1, 1) / (_NODES - 1)
    shares = nodes[None] + jnp.pad(moved, ((0, 0), (1, 1)))
    found = [_at_shares(span, times, states, rates, shares[k]) for k in range(2)]
    found = zip((horizontal, normal), *found, strict=True)
    horizontal, normal = map(jnp.stack, found)
    # In the shortest steps, which change nothing, the speed in between is lost to rounding.
    eps, step = float(jnp.finfo(nodes.dtype).eps), times[1] - times[0]
    long = eps**0.5 * jnp.abs(states[0, 0]) <= step * jnp.sqrt(span.equation.square)
    counts = (long | (nodes == 0) | (nodes == 1))[None]
    demand = jnp.where(counts, friction(horizontal, normal), 0).max()
    return demand, jnp.where(counts, normal, jnp.inf).min()


def _nodes(like: Reals) -> Reals:
    return jnp.arange(_NODES, dtype=like.dtype) / (_NODES - 1)


@jax.jit
def _at_shares(
    span: Span, times: Reals, states: Reals, rates: Reals, share: Reals
) -> tuple[Reals, Reals]:
    """Forces at some shares of a step."""
    begin, step = times[0], times[1] - times[0]
    drift, bend = step * states[1], 0.5 * step**2 * rates
    excess = states[0, 1] - states[0, 0] - drift[0] - bend[0]
    left = jnp.stack([excess, drift[1] - drift[0] - 2 * bend[0], bend[1] - bend[0]])
    rest = (jnp.asarray(_QUINTIC, left.dtype) * left[None]).sum(axis=1)
    powers = jnp.concatenate([drift[:1], bend[:1], rest])[:, None]
    shares = [jnp.ones_like(share)]
    for _ in range(4):
        shares.append(shares[-1] * share)
    terms = powers * jnp.stack(shares)
    lean = states[0, 0] + share * terms.sum(axis=0)
    exponents = jnp.arange(1, 6, dtype=left.dtype)[:, None]
    speed = (exponents * terms).sum(axis=0) / jnp.where(step > 0, step, 1)
    # Of the ends, the states themselves.
    first, last = share[None] == 0, share[None] == 1
    y = jnp.where(first, states[:, :1], jnp.where(last, states[:, 1:], jnp.stack([lean, speed])))
    return forces(span, begin + share * step, y)
