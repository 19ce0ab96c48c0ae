"""The stable fixed point of a map of one number: the one reached from 0, or the largest.

One loop over one evaluation of the map with its slope, whatever the search is at: so the map
is compiled once.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from ..numerics import through_jacobian
from ..resonance import RockingModel
from ..validation import Booleans, Reals

LANDS, RESTS, OVERTURNS, FAILS = range(4)
_FROM_REST, _SCAN, _REFINE, _DONE = range(4)
_FROM_REST_MOST = 300  # evaluations
_REFINE_MOST = 100
_PLACES = 64  # of a scan
_DYING = 1e-6  # beside the first landing


class Landing(NamedTuple):
    """One evaluation of the map."""

    velocity: Reals
    landing: Reals
    rate: Reals
    outcome: Any  # LANDS, ..., FAILS

    @property
    def gap(self) -> Reals:
        """What one evaluation adds."""
        return self.landing - self.velocity

    @property
    def move(self) -> Reals:
        """Newton's step to the fixed point."""
        return self.gap / jnp.where(self.rate == 1, 1e-30, 1 - self.rate)

    @property
    def rises(self) -> Booleans:
        """Whether the map leads up from here."""
        return (self.outcome == LANDS) & (self.gap >= 0)

    @property
    def falls(self) -> Booleans:
        """Whether it leads down."""
        return (self.outcome <= RESTS) & ~self.rises

    @property
    def beyond(self) -> Booleans:
        """Whether it leads nowhere."""
        return self.outcome > RESTS


class FixedPoint(NamedTuple):
    """Where a search ended."""

    velocity: Reals
    answers: Any  # whatever goes with it
    found: Booleans
    from_rest: Booleans  # reached by the map itself, from 0
    dies_out: Booleans  # the map leads to 0, and nothing else was found
    overturns: Booleans  # the map leads, from 0, to where it has no value


class _Search(NamedTuple):
    stage: Any
    trial: Reals
    count: Any  # of evaluations in this stage
    known: Landing  # the last one that counts
    reach: Reals  # how much further than the map itself a step may go
    bold: Booleans  # whether it does
    scale: Reals  # the first landing
    place: Any  # of the scan
    left: Landing
    right: Landing
    anchor: Landing  # where the scan goes on
    flags: tuple[Booleans, ...]


def stable_fixed_point(
    at: Callable[[Reals], tuple[Landing, tuple[Reals, ...]]],
    answers: int,
    bottom: Reals,
    top: Reals,
    tolerance: float,
) -> FixedPoint:
    """Iterate from 0; where that dies out, scan from `top` down to `bottom`.

    How many numbers `at` answers is given: to find out, it would be traced once more.
    """

    def place(k: Any) -> Reals:
        return top * (bottom / top) ** (k / (_PLACES - 1))

    def settled(new: Landing, old: Landing) -> Booleans:
        """At a fixed point, as well as the accuracy of the map allows to tell."""
        size = tolerance * new.velocity
        stuck = (jnp.abs(new.gap) <= 8 * size) & (jnp.abs(new.gap) >= 0.5 * jnp.abs(old.gap))
        close = (jnp.abs(new.move) <= size) | stuck
        return (new.outcome == LANDS) & (new.velocity > 0) & close

    def ended(c: _Search, **flags: Any) -> _Search:
        values = tuple(jnp.asarray(flags.get(name, False)) for name in FixedPoint._fields[2:])
        return c._replace(stage=jnp.asarray(_DONE), flags=values)

    def from_rest(c: _Search, new: Landing) -> _Search:
        """The map itself; in longer steps where it is as good as linear, which it is often."""
        old = c.known
        predicted = old.gap + (new.velocity - old.velocity) * (old.rate - 1)
        linear = (
            (new.outcome == LANDS)
            & (jnp.abs(new.gap - predicted) <= 0.5 * jnp.abs(old.gap))
            & (
                jnp.abs((new.rate - old.rate) * (new.velocity - old.velocity))
                <= 0.5 * jnp.abs(old.gap)
            )
            & (c.count > 1)
        )
        accepted = linear | ~c.bold
        point = _where(accepted, new, old)
        reach = jnp.where(linear, 4 * c.reach, 1)
        whole = jnp.where(point.rate < 1, jnp.abs(point.move), jnp.inf)
        step = jnp.minimum(whole, reach * jnp.abs(point.gap))
        near = (jnp.abs(point.gap) <= 1e-4 * point.velocity) & (jnp.abs(point.rate) < 1)
        step = jnp.where(
            point.rate > 0, jnp.sign(point.gap) * step, jnp.where(near, point.move, point.gap)
        )
        # To 0 in many steps: what is on the way must be seen.
        step = jnp.maximum(step, jnp.minimum(point.gap, -0.9 * point.velocity))
        scale = jnp.where(c.count == 0, point.landing, c.scale)
        following = c._replace(
            trial=point.velocity + step,
            count=c.count + 1,
            known=point,
            reach=reach,
            bold=jnp.abs(step) > (1 + 1e-9) * jnp.abs(point.gap),
            scale=scale,
        )
        small = point.velocity <= _DYING * scale
        straight = jnp.abs(point.landing - point.rate * point.velocity) <= 1e-3 * point.velocity
        dies = accepted & ((point.landing == 0) | (point.falls & small & straight))
        scan = following._replace(
            stage=jnp.asarray(_SCAN), trial=top, count=jnp.zeros_like(c.count)
        )
        stands = accepted & settled(new, old) & (jnp.abs(new.rate) <= 1)
        following = _where(dies, scan, following)
        following = _where(stands, ended(c, found=True, from_rest=True), following)
        gone = (accepted & new.beyond) | (c.count >= _FROM_REST_MOST)
        return _where(
            gone & ~stands,
            ended(c, overturns=accepted & (new.outcome == OVERTURNS)),
            following,
        )

    def scan(c: _Search, new: Landing) -> _Search:
        """Down from the top, until a fixed point may hide between two places."""
        onward = c._replace(trial=place(c.place + 1), place=c.place + 1, right=new)
        onward = _where(c.place + 1 >= _PLACES, ended(c, dies_out=True), onward)
        first = c.place == 0
        trial = _between(new, c.right, new, jnp.zeros((), bool))
        refine = c._replace(
            stage=jnp.asarray(_REFINE),
            trial=trial,
            count=jnp.zeros_like(c.count),
            known=new,
            left=new,
            anchor=new,
        )
        return _where(~first & _suspicious(new, c.right), refine, onward)

    def refine(c: _Search, new: Landing) -> _Search:
        left, right = c.left, c.right
        lower = jnp.where(
            new.rises,
            True,
            jnp.where(
                new.falls,
                left.falls & right.beyond | left.falls & right.falls & (new.rate > 1),
                left.beyond,
            ),
        )
        left, right = _where(lower, new, left), _where(lower, right, new)
        turn = c.count % 3 == 2
        following = c._replace(
            trial=_between(left, right, new, turn),
            count=c.count + 1,
            known=new,
            left=left,
            right=right,
        )
        eps = float(jnp.finfo(new.velocity.dtype).eps)
        narrow = right.velocity - left.velocity <= 4 * eps * right.velocity
        hopeless = ~_suspicious(left, right) | narrow | (c.count >= _REFINE_MOST)
        here = settled(new, c.known)
        stands = here & (jnp.abs(new.rate) <= 1)
        resumed = c._replace(
            stage=jnp.asarray(_SCAN),
            trial=place(c.place + 1),
            place=c.place + 1,
            right=c.anchor,
        )
        resumed = _where(c.place + 1 >= _PLACES, ended(c, dies_out=True), resumed)
        following = _where(here | hopeless, resumed, following)
        return _where(stands, ended(c, found=True), following)

    def step(state: tuple[_Search, Any]) -> tuple[_Search, Any]:
        c, _ = state
        new, answers = at(c.trial)
        stages = [stage(c, new) for stage in (from_rest, scan, refine)]
        chosen = jax.tree.map(lambda *leaves: jax.lax.select_n(c.stage, *leaves), *stages)
        # The trial that ends the search stays what it was.
        done = chosen.stage == _DONE
        return chosen._replace(trial=jnp.where(done, c.trial, chosen.trial)), answers

    zero, count, no = jnp.zeros_like(top), jnp.zeros((), int), jnp.zeros((), bool)
    nothing = Landing(zero, zero, zero, count)
    begin = _Search(
        stage=count,
        trial=zero,
        count=count,
        known=nothing,
        reach=zero + 1,
        bold=no,
        scale=zero,
        place=count,
        left=nothing,
        right=nothing,
        anchor=nothing,
        flags=(no,) * 4,
    )
    last, found = jax.lax.while_loop(
        lambda state: state[0].stage != _DONE, step, (begin, (zero,) * answers)
    )
    return FixedPoint(last.trial, found, *last.flags)


def _where(condition: Any, first: Any, second: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), first, second)


def _meeting(left: Landing, right: Landing) -> tuple[Reals, Reals]:
    """Where the tangents of the gap meet, and how high."""
    rise, fall = left.rate - 1, 1 - right.rate
    total = jnp.where(rise + fall > 0, rise + fall, 1)
    width = right.velocity - left.velocity
    along = (right.gap - left.gap + fall * width) / total
    return left.velocity + along, left.gap + rise * along


def _suspicious(left: Landing, right: Landing) -> Booleans:
    """Whether there is, or may be, a stable fixed point between two velocities."""
    crosses = left.rises & ~right.rises
    edge = left.beyond & right.falls
    width = right.velocity - left.velocity
    up = left.falls & (left.rate > 1)
    hump = up & right.falls & (right.rate < 1) & (_meeting(left, right)[1] > 0)
    open_hump = up & right.beyond & (left.gap + (left.rate - 1) * width > 0)
    return (crosses | edge | hump | open_hump) & (width > 0)


def _between(left: Landing, right: Landing, last: Landing, halve: Booleans) -> Reals:
    """Where to look next."""
    low, high = left.velocity, right.velocity
    newton = last.velocity + last.move
    inside = left.rises & right.falls & (newton > low) & (newton < high) & ~halve
    top = jnp.clip(_meeting(left, right)[0], 0.9 * low + 0.1 * high, 0.1 * low + 0.9 * high)
    hump = left.falls & right.falls
    return jnp.where(inside, newton, jnp.where(hump, top, 0.5 * (low + high)))


class Solved(NamedTuple):
    """A root and what is answered there: 0 where it has no derivative."""

    root: Reals
    answers: tuple[Reals, ...]
    there: Booleans
    flags: Any


def solved(search: Callable[..., Solved], at: Callable[..., Any]) -> Any:
    """Give `search` the derivatives of the root of what `at` returns first.

    By the implicit function theorem; `at` returns the answers second.
    """

    @eqx.filter_custom_jvp
    def root_of(parts: Any, *, model: RockingModel, rtol: float) -> Solved:
        return search(parts, model, rtol)

    @root_of.def_jvp
    def _(primals: Any, tangents: Any, *, model: RockingModel, rtol: float) -> Any:
        found = root_of(*primals, model=model, rtol=rtol)
        perturbed = jax.tree.map(lambda t: t is not None, tangents[0], is_leaf=lambda t: t is None)
        moving, fixed = eqx.partition(primals[0], perturbed)

        def of(moving: Any, root: Reals) -> Any:
            return at(eqx.combine(moving, fixed), root, model, rtol)[:2]

        def along(direction: Any) -> Any:
            return jax.jvp(of, (moving, found.root), direction)[1]

        # Of the parts at this root, and of the root alone: one program for both.
        zero, one = jnp.zeros_like(found.root), jnp.ones_like(found.root)
        parts = jax.tree.map(lambda t: jnp.stack([t, jnp.zeros_like(t)]), tangents[0])
        residual, answers = jax.vmap(along)((parts, jnp.stack([zero, one])))
        move = -residual[0] / jnp.where(found.there, residual[1], 1)
        total = (move, tuple(slope[0] + slope[1] * move for slope in answers))
        total = jax.tree.map(lambda t: jnp.where(found.there, t, 0), total)
        nothing = jax.tree.map(lambda leaf: None, found)
        return found, nothing._replace(root=total[0], answers=total[1])

    return through_jacobian(root_of)
