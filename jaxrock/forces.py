"""Friction demand and normal force of a block, and what they come to within a step."""

import functools
from typing import Any

import jax.numpy as jnp

from .arguments import Booleans, Reals
from .span import Span


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


def may_exceed(
    span: Span, times: Reals, states: Reals, rates: Reals, kept: tuple[Reals, Reals]
) -> Booleans:
    """Whether the forces in a step come near the extremes that are kept.

    From both ends and the middle: twice their spread beyond them, nothing is looked for.
    """
    step, change = times[1] - times[0], states[:, 1] - states[:, 0]
    lean, speed = 0.5 * states.sum(axis=1)
    lean = lean - step * (5 / 32) * change[1] + step**2 / 64 * rates.sum()
    speed = 15 / 8 * change[0] / step - 7 / 8 * speed + step / 32 * (rates[1] - rates[0])
    middle = jnp.stack([lean, speed])
    share = jnp.array([0.0, 0.5, 1.0], step.dtype)
    at = jnp.stack([states[:, 0], middle, states[:, 1]], axis=1)
    horizontal, normal = forces(span, times[0] + share * step, at)
    demand, least = kept
    finite = demand < jnp.inf
    slides = jnp.abs(horizontal) - jnp.where(finite, demand, 0) * normal
    steeper = finite & (3 * slides.max() - 2 * slides.min() >= 0)
    return steeper | (3 * normal.min() - 2 * normal.max() <= least)


def beyond(
    span: Span, times: Reals, states: Reals, rates: Reals, kept: tuple[Reals, Reals]
) -> tuple[Reals, Reals]:
    """The extremes that are kept, or those of a step where they are beyond them."""
    demand, normal = extremes(span, times, states, rates)
    return larger(kept[0], demand), smaller(kept[1], normal)


def extremes(span: Span, times: Reals, states: Reals, rates: Reals) -> tuple[Reals, Reals]:
    """Largest friction demand and smallest normal force within a step.

    From the states and accelerations at both of its ends, on the polynomial that has them: at
    nine times, and at the extreme value of the parabola through each three of them that follow
    one another.
    """
    begin, step = times[0], times[1] - times[0]
    lean, drift, bend = states[0], step * states[1], 0.5 * step**2 * rates
    excess = lean[1] - lean[0] - drift[0] - bend[0]
    steepening, bending = drift[1] - drift[0] - 2 * bend[0], bend[1] - bend[0]
    powers = (
        lean[0],
        drift[0],
        bend[0],
        10 * excess - 4 * steepening + bending,
        -15 * excess + 7 * steepening - 2 * bending,
        6 * excess - 3 * steepening + bending,
    )
    slopes = tuple(k * power for k, power in enumerate(powers))[1:]

    def at(share: Reals) -> tuple[Reals, Reals]:
        lean, drift = (
            functools.reduce(lambda value, c: value * share + c, reversed(each))
            for each in (powers, slopes)
        )
        return forces(span, begin + share * step, jnp.stack([lean, drift / step]))

    nodes = jnp.linspace(0, 1, 9, dtype=lean.dtype)
    horizontal, normal = at(nodes)
    # The angle of the force is smooth where the normal force vanishes.
    curves = jnp.stack([jnp.arctan2(jnp.abs(horizontal), normal), normal])
    rise = 0.5 * (curves[:, 2:] - curves[:, :-2])
    bent = curves[:, 2:] - 2 * curves[:, 1:-1] + curves[:, :-2]
    moved = jnp.clip(-rise / jnp.where(bent == 0, 1, bent), -1, 1)
    between = (jnp.stack([nodes[1:-1]] * 2) + 0.125 * moved).reshape(-1)
    found = zip((horizontal, normal), at(between), strict=True)
    horizontal, normal = map(jnp.concatenate, found)
    # In the shortest steps, which change nothing, the speed in between is lost to rounding.
    eps = float(jnp.finfo(lean.dtype).eps)
    long = eps**0.5 * jnp.abs(lean[0]) <= step * jnp.sqrt(span.equation.square)
    counts: Booleans = long | (jnp.arange(normal.size) == 0)
    demand = jnp.where(counts, friction(horizontal, normal), 0).max()
    return demand, jnp.where(counts, normal, jnp.inf).min()
