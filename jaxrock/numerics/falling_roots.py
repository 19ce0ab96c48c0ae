"""Roots at which a function of one number falls, sought from the top down.

The function, which may jump and have no value in places, is sampled at points, one after
another, and between two of them where a root may hide. The loop is the caller's, around one
evaluation: so the function, which may be a large program, is compiled once.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from ..validation import Booleans, Reals

ABOVE, BELOW, NOWHERE = range(3)
_MOST = 100  # samples between two points
Ints = Int[Array, ""]


class Sample(NamedTuple):
    """The function at one place, and whether it is ABOVE 0, BELOW 0 or NOWHERE."""

    place: Reals
    value: Reals
    slope: Reals
    kind: Ints

    @property
    def newton(self) -> Reals:
        """Newton's step to the root."""
        return self.value / jnp.where(self.slope == 0, 1e-30, -self.slope)


class Scan(NamedTuple):
    """Where the function is wanted next, and what is known of it."""

    trial: Reals
    last: Sample
    left: Sample  # and `right`: of the interval in which a root is sought
    right: Sample
    point: Ints  # number of the last one, -1 before the first
    since: Ints  # samples since then

    @classmethod
    def beginning(cls, trial: Reals) -> "Scan":
        """Before the first sample, at `trial`; at 0 the function counts as above 0."""
        zero = jnp.zeros_like(trial)
        count = jnp.zeros((), int)
        above = Sample(zero, zero, zero, count + ABOVE)
        return cls(trial, above, above, above, count - 1, count)

    def after(self, new: Sample, done: Booleans, points: Callable[[Reals], Reals]) -> "Scan":
        """After one more sample; with `done`, nothing more is sought around it."""
        climbs = (self.right.kind == NOWHERE) | (new.slope > 0)
        below = (self.left.kind == BELOW) & climbs
        to_left = jnp.where(new.kind == BELOW, below, self.left.kind == new.kind)
        to_left = to_left | (new.kind == ABOVE) | (self.since == 0)
        left = chosen(to_left, new, self.left)
        right = chosen(to_left, self.right, new)
        hides, trial = _between(
            left, right, new, halve=(self.since > 0) & (self.since % 3 == 0)
        )
        eps = float(jnp.finfo(trial.dtype).eps)
        wide = right.place - left.place > 4 * eps * jnp.abs(right.place)
        hides = hides & wide & (self.since <= _MOST) & ~done
        point = jnp.where(hides, self.point, self.point + 1)
        return Scan(
            trial=jnp.where(hides, trial, points(point.astype(trial.dtype))),
            last=new,
            left=left,
            right=chosen(hides, right, left),
            point=point,
            since=jnp.where(hides, self.since + 1, 0),
        )


def chosen(condition: Any, first: Any, second: Any) -> Any:
    """`jnp.where` for trees."""
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), first, second)


def _between(
    left: Sample, right: Sample, last: Sample, halve: Booleans
) -> tuple[Booleans, Reals]:
    """Tell whether a falling root may hide in an interval, and where to look for it."""
    low = left.place
    high = right.place
    width = right.place - left.place
    crosses = (left.kind == ABOVE) & (right.kind != ABOVE)
    edge = (left.kind == NOWHERE) & (right.kind == BELOW)
    # A hump, where the tangents meet above 0; of an open one the right side is not known.
    closed = right.kind == BELOW
    bend = left.slope - right.slope
    along = (right.value - left.value - right.slope * width) / jnp.where(bend > 0, bend, 1)
    top = left.value + left.slope * jnp.where(closed, along, width)
    climbs = (left.kind == BELOW) & (left.slope > 0) & (right.kind != ABOVE)
    hump = climbs & (~closed | (right.slope < 0)) & (top > 0)
    newton = last.place + last.newton
    inside = crosses & closed & (newton > low) & (newton < high) & ~halve
    peak = jnp.clip(low + along, 0.9 * low + 0.1 * high, 0.1 * low + 0.9 * high)
    middle = jnp.where(hump & closed, peak, 0.5 * (low + high))
    return crosses | edge | hump, jnp.where(inside, newton, middle)
