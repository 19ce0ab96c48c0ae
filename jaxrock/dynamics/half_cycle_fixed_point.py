"""The stable fixed point of a map of one number: the one reached from 0, or the largest.

One loop goes through all stages of the search, around one evaluation of the map with its
slope: so the map, which is a large program, is compiled once.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from ..validation import Booleans, Reals

LANDS, RESTS, OVERTURNS, FAILS = range(4)
_FROM_REST, _SCAN, _REFINE, _DONE = range(4)
_MAX_FROM_REST = 300  # evaluations
_MAX_REFINE = 100
_POINTS = 64  # of a scan
_DYING = 1e-6  # beside the first landing
Ints = Int[Array, ""]


class Landing(NamedTuple):
    """One evaluation of the map."""

    velocity: Reals
    landing: Reals
    rate: Reals
    outcome: Ints  # LANDS, ..., FAILS

    @property
    def gap(self) -> Reals:
        """What one evaluation adds."""
        return self.landing - self.velocity

    @property
    def newton(self) -> Reals:
        """Newton's step to the fixed point."""
        return self.gap / jnp.where(self.rate == 1, 1e-30, 1 - self.rate)

    @property
    def rises(self) -> Booleans:
        """Whether the map leads up from here, not down or nowhere."""
        return (self.outcome == LANDS) & (self.gap >= 0)

    @property
    def falls(self) -> Booleans:
        """Whether the map leads down."""
        return (self.outcome <= RESTS) & ~self.rises

    @property
    def beyond(self) -> Booleans:
        """Whether the map leads nowhere."""
        return self.outcome > RESTS


class FixedPoint(NamedTuple):
    """Where a search ended."""

    velocity: Reals
    values: tuple[Reals, ...]  # what the evaluation returned there
    exists: Booleans
    from_rest: Booleans  # reached by the map itself, from 0
    dies_out: Booleans  # the map leads to 0, and no other fixed point is seen
    overturns: Booleans  # the map leads, from 0, to where it has no value


class _Range(NamedTuple):
    """Where fixed points are sought, and how accurately."""

    bottom: Reals
    top: Reals
    tolerance: float

    def point(self, index: Ints) -> Reals:
        """A velocity of the scan, from the top down."""
        return self.top * (self.bottom / self.top) ** (index / (_POINTS - 1))

    def reached(self, new: Landing, old: Landing) -> Booleans:
        """At a fixed point, as far as the accuracy of the map shows."""
        size = self.tolerance * new.velocity
        # Within a few tolerances, a gap that no longer shrinks is the error of the map.
        stuck = (jnp.abs(new.gap) <= 8 * size) & (jnp.abs(new.gap) >= 0.5 * jnp.abs(old.gap))
        close = (jnp.abs(new.newton) <= size) | stuck
        return (new.outcome == LANDS) & (new.velocity > 0) & close


class _Search(NamedTuple):
    stage: Ints
    trial: Reals
    evaluations: Ints  # in this stage
    last: Landing  # that was accepted
    reach: Reals  # length of a step beside that of the map itself, at most
    extrapolates: Booleans  # whether the step is longer than that of the map
    scale: Reals  # the first landing
    place: Ints  # of the scan
    left: Landing  # and `right`: of a bracket
    right: Landing
    anchor: Landing  # from which the scan goes on
    flags: tuple[Booleans, ...]

    def ended(self, **flags: Any) -> "_Search":
        """With the flags of a `FixedPoint` that hold."""
        values = tuple(jnp.asarray(flags.get(name, False)) for name in FixedPoint._fields[2:])
        return self._replace(stage=jnp.asarray(_DONE), flags=values)

    def scanned(self, scope: _Range, right: Landing) -> "_Search":
        """On to the next point of the scan, if there is one."""
        place = self.place + 1
        onward = self._replace(
            stage=jnp.asarray(_SCAN), trial=scope.point(place), place=place, right=right
        )
        return _where(place >= _POINTS, self.ended(dies_out=True), onward)


def stable_fixed_point(
    evaluated: Callable[[Reals], tuple[Landing, tuple[Reals, ...]]],
    number: int,
    bottom: Reals,
    top: Reals,
    tolerance: float,
) -> FixedPoint:
    """Iterate from 0; where that dies out, scan from `top` down to `bottom`.

    `evaluated` returns `number` values with the landing; to count them, it would be traced twice.
    """
    scope = _Range(bottom, top, tolerance)

    def step(state: tuple[_Search, Any]) -> tuple[_Search, Any]:
        search, _ = state
        new, values = evaluated(search.trial)
        stages = [stage(scope, search, new) for stage in (_from_rest, _scan, _refine)]
        chosen = jax.tree.map(lambda *leaves: jax.lax.select_n(search.stage, *leaves), *stages)
        # The trial with which the search ends is the fixed point.
        done = chosen.stage == _DONE
        return chosen._replace(trial=jnp.where(done, search.trial, chosen.trial)), values

    zero, count, no = jnp.zeros_like(top), jnp.zeros((), int), jnp.zeros((), bool)
    nothing = Landing(zero, zero, zero, count)
    begin = _Search(
        stage=count,
        trial=zero,
        evaluations=count,
        last=nothing,
        reach=zero + 1,
        extrapolates=no,
        scale=zero,
        place=count,
        left=nothing,
        right=nothing,
        anchor=nothing,
        flags=(no,) * 4,
    )
    last, values = jax.lax.while_loop(
        lambda state: state[0].stage != _DONE, step, (begin, (zero,) * number)
    )
    return FixedPoint(last.trial, values, *last.flags)


def _from_rest(scope: _Range, search: _Search, new: Landing) -> _Search:
    """The map itself, in longer steps while it is nearly linear, which it often is."""
    old = search.last
    width, shrinks = new.velocity - old.velocity, 0.5 * jnp.abs(old.gap)
    linear = (
        (new.outcome == LANDS)
        & (jnp.abs(new.gap - (old.gap + width * (old.rate - 1))) <= shrinks)
        & (jnp.abs((new.rate - old.rate) * width) <= shrinks)
        & (search.evaluations > 1)
    )
    accepted = linear | ~search.extrapolates
    point = _where(accepted, new, old)
    reach = jnp.where(linear, 4 * search.reach, 1)
    newton = jnp.where(point.rate < 1, jnp.abs(point.newton), jnp.inf)
    step = jnp.sign(point.gap) * jnp.minimum(newton, reach * jnp.abs(point.gap))
    # Where the map alternates, its own step, or Newton's from nearby.
    near = (jnp.abs(point.gap) <= 1e-4 * point.velocity) & (jnp.abs(point.rate) < 1)
    step = jnp.where(point.rate > 0, step, jnp.where(near, point.newton, point.gap))
    # Down to 0 in many steps, so that a fixed point on the way is seen.
    step = jnp.maximum(step, jnp.minimum(point.gap, -0.9 * point.velocity))
    scale = jnp.where(search.evaluations == 0, point.landing, search.scale)
    following = search._replace(
        trial=point.velocity + step,
        evaluations=search.evaluations + 1,
        last=point,
        reach=reach,
        extrapolates=jnp.abs(step) > (1 + 1e-9) * jnp.abs(point.gap),
        scale=scale,
    )
    small = point.velocity <= _DYING * scale
    straight = jnp.abs(point.landing - point.rate * point.velocity) <= 1e-3 * point.velocity
    dies = accepted & ((point.landing == 0) | (point.falls & small & straight))
    scan = following._replace(
        stage=jnp.asarray(_SCAN), trial=scope.top, evaluations=jnp.zeros_like(search.evaluations)
    )
    stands = accepted & scope.reached(new, old) & (jnp.abs(new.rate) <= 1)
    following = _where(dies, scan, following)
    following = _where(stands, search.ended(exists=True, from_rest=True), following)
    gone = (accepted & new.beyond) | (search.evaluations >= _MAX_FROM_REST)
    overturns = accepted & (new.outcome == OVERTURNS)
    return _where(gone & ~stands, search.ended(overturns=overturns), following)


def _scan(scope: _Range, search: _Search, new: Landing) -> _Search:
    """Down from the top, until a fixed point may hide between two points."""
    refine = search._replace(
        stage=jnp.asarray(_REFINE),
        trial=_between(new, search.right, new, jnp.zeros((), bool)),
        evaluations=jnp.zeros_like(search.evaluations),
        last=new,
        left=new,
        anchor=new,
    )
    hides = (search.place > 0) & _may_hide(new, search.right)
    return _where(hides, refine, search.scanned(scope, new))


def _refine(scope: _Range, search: _Search, new: Landing) -> _Search:
    """Between two points, until the fixed point is reached or cannot be there."""
    left, right = search.left, search.right
    falling = left.falls & right.beyond | left.falls & right.falls & (new.rate > 1)
    lower = new.rises | jnp.where(new.falls, falling, left.beyond)
    left, right = _where(lower, new, left), _where(lower, right, new)
    following = search._replace(
        trial=_between(left, right, new, search.evaluations % 3 == 2),
        evaluations=search.evaluations + 1,
        last=new,
        left=left,
        right=right,
    )
    eps = float(jnp.finfo(new.velocity.dtype).eps)
    narrow = right.velocity - left.velocity <= 4 * eps * right.velocity
    hopeless = ~_may_hide(left, right) | narrow | (search.evaluations >= _MAX_REFINE)
    reached = scope.reached(new, search.last)
    following = _where(reached | hopeless, search.scanned(scope, search.anchor), following)
    return _where(reached & (jnp.abs(new.rate) <= 1), search.ended(exists=True), following)


def _where(condition: Any, first: Any, second: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), first, second)


def _tangents_meet(left: Landing, right: Landing) -> tuple[Reals, Reals]:
    """Where the tangents of the gap meet, and how high."""
    rise, fall = left.rate - 1, 1 - right.rate
    total = jnp.where(rise + fall > 0, rise + fall, 1)
    width = right.velocity - left.velocity
    along = (right.gap - left.gap + fall * width) / total
    return left.velocity + along, left.gap + rise * along


def _may_hide(left: Landing, right: Landing) -> Booleans:
    """Whether there is, or may be, a stable fixed point between two velocities."""
    crosses = left.rises & ~right.rises
    edge = left.beyond & right.falls
    width = right.velocity - left.velocity
    up = left.falls & (left.rate > 1)
    hump = up & right.falls & (right.rate < 1) & (_tangents_meet(left, right)[1] > 0)
    open_hump = up & right.beyond & (left.gap + (left.rate - 1) * width > 0)
    return (crosses | edge | hump | open_hump) & (width > 0)


def _between(left: Landing, right: Landing, last: Landing, halve: Booleans) -> Reals:
    """The next trial: Newton's inside of a bracket, the top of a hump, or the middle."""
    low, high = left.velocity, right.velocity
    newton = last.velocity + last.newton
    inside = left.rises & right.falls & (newton > low) & (newton < high) & ~halve
    meeting = _tangents_meet(left, right)[0]
    top = jnp.clip(meeting, 0.9 * low + 0.1 * high, 0.1 * low + 0.9 * high)
    hump = left.falls & right.falls
    return jnp.where(inside, newton, jnp.where(hump, top, 0.5 * (low + high)))
