"""Roots at which a function of one number falls, sought from the top down.

The function may jump, and have no value in places. It is sampled at points, one after another,
and between two of them where a root may hide. The loop is the caller's, around one evaluation:
so the function, which may be a large program, is compiled once.
"""

from collections.abc import Callable
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from ..validation import Booleans, Reals

ABOVE, BELOW, NOWHERE = range(3)
_MAX_SAMPLES = 100  # between two points
Integer = Int[Array, ""]
_T = TypeVar("_T")


class Sample(NamedTuple):
    """The function at one place, and whether it is ABOVE 0, BELOW 0 or NOWHERE.

    Where it is NOWHERE it has no value: `value` and `slope` mean nothing.
    """

    place: Reals
    value: Reals
    slope: Reals
    kind: Integer

    @property
    def newton(self) -> Reals:
        """Step of Newton's method to the root."""
        return self.value / jnp.where(self.slope == 0, 1e-30, -self.slope)


class Scan(NamedTuple):
    """The place at which the function is wanted next, and the samples that say so."""

    trial: Reals
    last: Sample
    left: Sample  # the lower end of the interval in which a root is sought
    right: Sample  # the upper end
    point: Integer  # number of the last one, -1 before the first
    since: Integer  # samples since then; 0 if the trial is a point itself

    @classmethod
    def start(cls, trial: Reals) -> "Scan":
        """Start a scan at `trial`; no root is sought above it, for which a placeholder stands."""
        zero = jnp.zeros_like(trial)
        count = jnp.zeros((), int)
        above = Sample(zero, zero, zero, count + ABOVE)
        return cls(trial, above, above, above, count - 1, count)

    def advance(self, new: Sample, done: Booleans, points: Callable[[Reals], Reals]) -> "Scan":
        """Take in the sample at the trial, and decide where the next one is wanted.

        Parameters
        ----------
        new : Sample
            At `trial`.
        done : Array
            Whether nothing more is to be sought around it: it is a root, or good enough.
        points : callable
            The place of a point by its number; places decrease.

        Returns
        -------
        Scan
        """
        # state       known                               next
        #
        # since = 0   The trial is a point. `right` is    The sample becomes `left`. If a root
        #             the point above it.                 may hide between the two: a trial
        #                                                 between them, since = 1. Else: on to
        #                                                 the next point.
        # since > 0   The trial is between `left` and     The sample replaces one end, so that
        #             `right`, and a root may hide        a root stays in between. If one may
        #             there.                              still hide: another trial, since + 1.
        #                                                 Else: on to the next point.
        # any, done   The sample is a root.               On to the next point.
        #
        # On to the next point: `left`, below which nothing is known, becomes `right`,
        # point + 1, since = 0. The caller stops when it has found enough, or after the last
        # point.

        # A falling root is to the right of a sample above 0, and to the left of one below 0,
        # unless that one is on the rise to a hump. An edge, beyond which the function has no
        # value, stays in the interval as well.
        climbs = (self.right.kind == NOWHERE) | (new.slope > 0)
        below = (self.left.kind == BELOW) & climbs
        to_left = jnp.where(new.kind == BELOW, below, self.left.kind == new.kind)
        to_left = to_left | (new.kind == ABOVE) | (self.since == 0)
        left = select_tree(to_left, new, self.left)
        right = select_tree(to_left, self.right, new)
        hides, trial = _propose_trial(
            left, right, new, halve=(self.since > 0) & (self.since % 3 == 0)
        )

        # Between neighbouring numbers the function jumps over 0, and has no root.
        eps = float(jnp.finfo(trial.dtype).eps)
        wide = right.place - left.place > 4 * eps * jnp.abs(right.place)
        hides = hides & wide & (self.since <= _MAX_SAMPLES) & ~done
        point = jnp.where(hides, self.point, self.point + 1)
        return Scan(
            trial=jnp.where(hides, trial, points(point.astype(trial.dtype))),
            last=new,
            left=left,
            right=select_tree(hides, right, left),
            point=point,
            since=jnp.where(hides, self.since + 1, 0),
        )


def select_tree(condition: Booleans, first: _T, second: _T) -> _T:
    """Select one of two trees, as `jnp.where` does for arrays."""
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), first, second)


def _propose_trial(
    left: Sample, right: Sample, last: Sample, halve: Booleans
) -> tuple[Booleans, Reals]:
    """Return whether a falling root may hide in an interval, and propose where to look for it.

    With `halve` in the middle: Newton's method alone may creep towards a root from one side.
    """
    low = left.place
    high = right.place
    width = right.place - left.place
    crosses = (left.kind == ABOVE) & (right.kind != ABOVE)
    # Beside an edge, beyond which it has no value, the function may begin above 0 and fall.
    edge = (left.kind == NOWHERE) & (right.kind == BELOW)
    # A hump has no sign change at its ends, but may reach above 0 where their tangents meet.
    # An open one is not known on the right side.
    closed = right.kind == BELOW
    bend = left.slope - right.slope
    along = (right.value - left.value - right.slope * width) / jnp.where(bend > 0, bend, 1)
    top = left.value + left.slope * jnp.where(closed, along, width)
    climbs = (left.kind == BELOW) & (left.slope > 0) & (right.kind != ABOVE)
    hump = climbs & (~closed | (right.slope < 0)) & (top > 0)

    # By Newton's method as long as that stays inside. At the top of a hump, but not so close
    # to an end that the interval would hardly shrink. Else in the middle.
    newton = last.place + last.newton
    inside = crosses & closed & (newton > low) & (newton < high) & ~halve
    peak = jnp.clip(low + along, 0.9 * low + 0.1 * high, 0.1 * low + 0.9 * high)
    middle = jnp.where(hump & closed, peak, 0.5 * (low + high))
    return crosses | edge | hump, jnp.where(inside, newton, middle)
