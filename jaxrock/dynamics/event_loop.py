"""Driven motion, step by step, through every impact.

The motion is cut where it has a corner: at uplift, at every impact, at every turn from
rising to falling and back, and at the ends of the input. Between two cuts the lean is
monotone, and an inner loop tries step after step. A step in which the span ends is tried again
with the length that ends there, up to where Halley's method changes nothing.
"""

import enum
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..ground_motion import Motion
from ..numerics import through_jacobian
from ..resonance import RockingModel
from ..validation import (
    FINITE,
    POSITIVE,
    UNIT_INTERVAL,
    Booleans,
    Checked,
    Reals,
    guarding,
    module_within,
    quantity,
)
from .contact_forces import beyond, larger, smaller
from .equation import Equation
from .overturning_criterion import margins_of
from .segment import (
    CROSSES,
    DEFAULT,
    LASTS,
    TOPS,
    TURNS,
    Limits,
    Method,
    Span,
    Step,
    Stepper,
    close_to,
    first_step,
    limited,
)
from .uplift import Uplifts

REST, RISING, FALLING, OVER = range(4)
_BEGIN, _WAIT, _MOVE = range(3)  # what a turn of the loop does
_MOST_STEPS = 2**20  # between two cuts
_MOST_CUTS = 2**22
_CLOSE = 1e-6  # to which the end of a span is sought before it is stepped to


class Status(enum.IntEnum):
    """How a computation ended."""

    COMPLETE = 0  # nothing ran out
    LIST_FULL = 1  # all is right, but not all impacts are listed
    STOPPED = 2  # the integrator ran out of steps, or could not go on
    INVALID = 3  # an argument was outside of what is allowed


class Driven(Checked):
    """All that a driven motion depends on."""

    block: Block
    motion: Motion
    restitution: Reals = quantity(UNIT_INTERVAL)
    duration: Reals = quantity(POSITIVE)
    rotation: Reals = quantity(FINITE)
    velocity: Reals = quantity(FINITE)


class Cuts(eqx.Module):
    """The state after every cut, in the order of time; NaN where there is none."""

    time: Reals
    side: Reals
    lean: Reals
    speed: Reals


class Carry(NamedTuple):
    """From cut to cut."""

    time: Any
    side: Any
    lean: Any
    speed: Any
    phase: Any
    count: Any  # cuts
    impacts: Any
    struck: Any  # time of the last impact, and velocity just before it
    peak: Any
    peak_time: Any
    crossing: Any
    margin: Any
    demand: Any
    normal: Any
    failed: Any

    @classmethod
    def beginning(cls, dtype: Any) -> "Carry":
        """Before the first cut; in NumPy, which need not be asked for anything."""
        zero, none = np.zeros((), dtype), np.zeros((), int)
        return cls(
            time=zero,
            side=zero,
            lean=zero,
            speed=zero,
            phase=none,
            count=none,
            impacts=none,
            struck=np.zeros(2, dtype),
            peak=zero,
            peak_time=zero,
            crossing=zero,
            margin=zero,
            demand=zero,
            normal=zero,
            failed=np.zeros((), bool),
        )


class Followed(NamedTuple):
    """What `follow` comes to; NaN where it is not known."""

    rotation: Any
    velocity: Any
    peak: Any
    peak_time: Any
    overturned: Any
    crossing: Any
    margin: Any
    impacts: Any
    impact_times: Any
    impact_velocities: Any
    at_rest: Any
    demand: Any
    normal: Any
    status: Any
    struck: Any  # time of the last impact, and velocity just before it
    cuts: Cuts
    driven: Driven  # with stand-ins for what is not allowed
    last: Carry  # from which it could go on


class _Point(NamedTuple):
    """From step to step of a span."""

    along: Any  # time since it began
    y: Any  # lean and speed
    until: Any  # end of the next step
    wish: Any  # length of a step, before it was cut short
    refined: Any  # steps tried to the end of the span, 0 before there is one
    which: Any  # way in which it ends
    done: Any
    demand: Any
    normal: Any
    steps: Any
    memory: Any  # of the solver


def run(
    driven: Driven,
    *,
    rtol: Any,
    atol: Any,
    model: RockingModel,
    max_impacts: int = 0,
    once: bool = False,
    forced: bool = True,
    method: Method = DEFAULT,
    begin: Carry | None = None,
) -> Followed:
    """Follow a block to the end, or with `once` to its first impact: the motion of `respond`.

    With `begin`, where the last call ended, until the list is full. Without `forced`, friction
    demand and normal force stay out.
    """
    with guarding():
        driven, valid = module_within(driven)
        equation = Equation.of(driven.block, model)
    valid = jnp.all(valid)
    dtype = driven.duration.dtype
    one = _Loop(driven, equation, Stepper(method, rtol, atol), method, rtol, forced)
    pauses = begin is not None
    begin = begin or Carry.beginning(dtype)
    begin = begin._replace(failed=begin.failed | ~valid)
    rows = 4 * max_impacts

    def going(c: Carry) -> Any:
        wanted = (c.impacts == 0) | (not once)
        wanted = wanted & (c.time < driven.duration) & (c.phase != OVER)
        return ((c.count == 0) | wanted) & ~c.failed & (c.count < _MOST_CUTS)

    def full(c: Carry) -> Any:
        return (c.count - begin.count >= rows) | (c.impacts - begin.impacts >= max_impacts)

    def goes_on(state: tuple[Carry, Any]) -> Any:
        c, _ = state
        return going(c) & ~full(c) if pauses else going(c)

    def turn(state: tuple[Carry, Any]) -> tuple[Carry, Any]:
        before, lists = state
        c = one.turn(before)
        if lists:
            # Not inside of what is chosen: there the lists would be copied. What has no place
            # any more goes to the last row.
            cuts, impacts = lists
            place = jnp.where(
                c.impacts > before.impacts, before.impacts - begin.impacts, max_impacts
            )
            lists = (
                _with_row(cuts, before.count - begin.count, _row(c)),
                _with_row(impacts, place, c.struck),
            )
        return c, lists

    unknown = jnp.full((rows + 1, 4), jnp.nan, dtype)
    lists = (unknown, unknown[: max_impacts + 1, :2]) if max_impacts else None
    last, lists = jax.lax.while_loop(goes_on, turn, (begin, lists))
    cuts, impacts = (part[:-1] for part in lists or (unknown, unknown[:, :2]))

    broken = (last.failed & valid) | (last.count >= _MOST_CUTS)
    short = going(last) if pauses else (last.impacts > max_impacts) | (last.count > rows)
    status = jnp.where(broken, Status.STOPPED, jnp.where(short, Status.LIST_FULL, Status.COMPLETE))
    status = jnp.where(valid, status, Status.INVALID)
    good = valid & ~broken

    def known(value: Any) -> Any:
        return jnp.where(good, value, jnp.nan)

    overturned = good & ((last.phase == OVER) | (last.margin < 0))
    return Followed(
        rotation=known(last.side * last.lean + 0.0),  # no negative zero
        velocity=known(last.side * last.speed + 0.0),
        peak=known(last.peak),
        peak_time=known(last.peak_time),
        overturned=overturned,
        crossing=jnp.where(overturned, last.crossing, jnp.nan),
        margin=known(last.margin),
        impacts=last.impacts,
        impact_times=impacts[:, 0],
        impact_velocities=impacts[:, 1],
        at_rest=good & (last.phase == REST),
        demand=known(last.demand),
        normal=known(last.normal),
        status=status,
        struck=last.struck,
        cuts=Cuts(*cuts.T),
        driven=driven,
        last=last._replace(phase=last.phase.astype(int)),
    )


follow = through_jacobian(run)


def _with_row(rows: Reals, place: Any, row: Reals) -> Reals:
    return jax.lax.dynamic_update_slice(rows, row[None], (place, 0))


class _Loop:
    """What the turns of the loop have in common."""

    def __init__(
        self,
        driven: Driven,
        equation: Equation,
        stepper: Stepper,
        method: Method,
        rtol: Any,
        forced: bool,
    ):
        motion = driven.motion
        self.driven, self.equation, self.motion = driven, equation, motion
        self.stepper, self.method, self.rtol, self.forced = stepper, method, rtol, forced
        # To the end of a span: each but the last improves the time of the next, the first its
        # value, the second its two derivatives as well.
        self.tries = 3 if method.locate == "step" else 1
        self.rate = jnp.sqrt(equation.square)
        self.uplifts = Uplifts.of(equation, motion)
        # Of a block just lifted: little beside its own time and that in which the input changes.
        cells = jnp.sum(self.uplifts.knots < motion.end).astype(self.rate.dtype)
        changes = (motion.end - motion.start) / cells
        self.grace = jax.lax.stop_gradient(1e-6 * jnp.minimum(1 / self.rate, changes))

    def turn(self, before: Carry) -> Carry:
        """From a cut to the next."""
        begins, stop = before.count == 0, self.stop_after(before.time)
        does = jnp.where(before.phase == REST, _WAIT, _MOVE)
        c = jax.lax.switch(
            jnp.where(begins, _BEGIN, does),
            [self.begin, lambda c: self.wait(c, stop), lambda c: self.move(c, stop)],
            before,
        )
        c = self.with_corner(c, self.motion.acts(before.time) & ~begins)
        # Where the input ends, the fate is read.
        input_end = smaller(self.motion.end, self.driven.duration)
        now = (before.time < input_end) & ((c.time >= input_end) | (c.phase == OVER))
        margin = smaller(*margins_of(self.equation, self.driven.restitution, c.lean, c.speed))
        return c._replace(margin=jnp.where(now | begins, margin, c.margin), count=before.count + 1)

    def begin(self, c: Carry) -> Carry:
        """The initial state, on the side on which it leans or to which it moves."""
        driven = self.driven
        towards = jnp.where(driven.rotation == 0, driven.velocity, driven.rotation)
        side = jnp.where(towards < 0, -1, 1).astype(towards.dtype)
        lean, speed = side * driven.rotation, side * driven.velocity
        phase = jnp.where(speed < 0, FALLING, RISING)
        phase = jnp.where((lean == 0) & (speed == 0), REST, phase)
        return c._replace(
            side=side,
            lean=lean,
            speed=speed,
            phase=jnp.where(lean >= 0.5 * jnp.pi, OVER, phase),
            peak=lean,
            crossing=jnp.where(lean >= self.equation.critical_angle, c.time, jnp.nan),
            normal=jnp.full_like(lean, jnp.inf),
        )

    def span(self, c: Carry, acts: Booleans) -> Span:
        """What begins at a cut."""
        return Span(self.equation, self.motion, c.time, c.side, acts)

    def stop_after(self, time: Any) -> Any:
        """The next edge of the input, or the end; of those that coincide, the end."""
        stop = duration = self.driven.duration
        latest = duration - close_to(self.motion, duration)
        for edge in (self.motion.end, self.motion.start):
            stop = jnp.where((edge > time) & (edge < latest), edge, stop)
        return stop

    def with_corner(self, c: Carry, acted: Any) -> Carry:
        """Go with the corner that the state coincides with, not a time before or after it.

        That changes derivatives only: up to the corner the block moves for no time, but one
        that has a derivative, under the input as it is before the corner.
        """
        motion, duration = self.motion, self.driven.duration
        near = close_to(motion, c.time)
        kink = motion.next_kink(c.time - near)
        corner = jnp.where(kink <= c.time + near, kink, c.time)
        corner = jnp.where(~acted & (c.time == motion.start), motion.start, corner)
        corner = jnp.where(acted & (c.time == motion.end), motion.end, corner)
        corner = jnp.where(c.time >= duration, duration, corner)
        move = corner - c.time
        move = move - jax.lax.stop_gradient(move)
        y = jnp.stack([c.lean, c.speed])
        stays = (c.phase == REST) | (c.phase == OVER)
        rate = self.span(c, acted).field(jnp.zeros_like(move), y)
        lean, speed = y + jnp.where(stays, 0, move) * rate
        return c._replace(time=c.time + move, lean=lean, speed=speed)

    def wait(self, c: Carry, stop: Any) -> Carry:
        """For the input to lift the block, or for the next edge of the input."""
        found, time, side = self.uplifts.following(c.time, stop)
        acts = self.motion.acts(c.time)
        found = found & acts
        until = jnp.where(found, time, stop)
        if self.forced:
            demand, normal = self.uplifts.at_rest(c.time, until, acts)
            c = c._replace(demand=larger(c.demand, demand), normal=smaller(c.normal, normal))
        return c._replace(
            time=until,
            side=jnp.where(found, side, c.side),
            phase=jnp.where(found, RISING, REST),
        )

    def move(self, c: Carry, stop: Any) -> Carry:
        """Through a span, unless the block has come to rest."""
        span, length = self.span(c, self.motion.acts(c.time)), stop - c.time
        y, zero = jnp.stack([c.lean, c.speed]), jnp.zeros_like(c.time)
        # One that has just been lifted stays so: its acceleration is 0, up to rounding.
        lifted = (c.lean == 0) & (c.speed == 0)
        rate = jax.lax.stop_gradient(span).field(zero, jax.lax.stop_gradient(y))[1]
        c = c._replace(phase=self.next_phase(c, rate))
        limits = Limits.of(self.equation, c.phase == RISING, c.lean >= self.equation.critical_angle)
        # What the clock cannot resolve is no time for it.
        grace = jnp.where(lifted, self.grace + close_to(self.motion, c.time), 0)
        none = jnp.zeros((), int)
        start = _Point(
            along=zero,
            y=y,
            until=first_step(span, length, y, lifted),
            wish=zero,
            refined=none,
            which=none + LASTS,
            done=c.phase == REST,
            demand=c.demand,
            normal=c.normal,
            steps=none,
            memory=self.stepper.memory(span, y),
        )
        last = jax.lax.while_loop(
            lambda p: ~p.done & (p.steps < _MOST_STEPS),
            lambda p: self.advance(span, limits, grace, length, p),
            start,
        )
        return jax.lax.cond(
            c.phase == REST,
            lambda: c,
            lambda: self.finish(stop, c, last),
        )

    def next_phase(self, c: Carry, rate: Any) -> Any:
        """Of a state that may have stopped at an edge of the input."""
        still = c.speed == 0
        down = jnp.where(c.lean > 0, FALLING, jnp.where(c.phase == FALLING, REST, c.phase))
        phase = jnp.where(still & (rate < 0), down, c.phase)
        return jnp.where(still & (rate > 0), RISING, phase)

    def advance(self, span: Span, limits: Limits, grace: Any, length: Any, p: _Point) -> _Point:
        """One step, or one more to the end of the span."""
        step = self.stepper.step(span, p.along, p.until, p.y, p.memory)
        refines = p.refined > 0
        left = jax.lax.stop_gradient(limits).left(jax.lax.stop_gradient(step.there))
        goes = step.good & ~refines
        ends = goes & (p.until > grace) & (left.min() <= 0)
        goes = goes & ~ends
        refined = jnp.where(refines | ends, p.refined + 1, 0)
        which = jnp.where(ends | (p.refined == 1), jnp.argmin(left), p.which)
        done = (goes & (p.until >= length)) | (refined > self.tries)
        counts = goes | done

        times, states = jnp.stack([p.along, p.until]), jnp.stack([p.y, step.there], axis=1)
        rates = jax.lax.stop_gradient(span).field(*jax.lax.stop_gradient((times, states)))[1]
        extremes = p.demand, p.normal
        if self.forced:
            extremes = beyond(span, times, states, rates, extremes, counts)
        along, y = jnp.where(counts, p.until, p.along), jnp.where(counts, step.there, p.y)
        wish = jnp.where(goes, jnp.maximum(step.following, p.wish), step.following)
        until = limited(span, length, along, along + wish, y, jnp.where(goes, rates[1], rates[0]))
        until = jax.lax.switch(
            jnp.where(ends, 2, jnp.where(refines, 1, 0)),
            [
                lambda: until,
                lambda: self.refine(span, limits, p.until, step.there, which),
                lambda: self.sought(limits, grace, p, step),
            ],
        )
        stuck = ~done & ~refines & ~ends & ~(until > along)
        return _Point(
            along=along,
            y=jnp.where(stuck, jnp.nan, y),
            until=until,
            wish=jnp.where(goes, wish, 0),
            refined=refined,
            which=which,
            done=done | stuck,
            demand=extremes[0],
            normal=extremes[1],
            steps=p.steps + 1,
            memory=jax.tree.map(lambda a, b: jnp.where(goes, a, b), step.memory, p.memory),
        )

    def sought(self, limits: Limits, grace: Any, p: _Point, step: Step) -> Reals:
        """Where the span ends within a step, nearly."""
        if self.method.locate == "end":
            return p.until
        limits, grace, p, step = jax.lax.stop_gradient((limits, grace, p, step))
        eps = float(jnp.finfo(p.along.dtype).eps)
        tiny = float(jnp.finfo(p.along.dtype).tiny)
        close = max(_CLOSE, 2 * eps) if self.method.locate == "step" else 2 * eps

        def wide(bracket: Any) -> Any:
            return bracket[1] - bracket[0] > close * jnp.maximum(bracket[1], tiny / eps)

        def halve(bracket: Any) -> Any:
            middle = 0.5 * (bracket[0] + bracket[1])
            left = limits.left(self.stepper.between(p.along, p.until, step, middle))
            ended = (left.min() <= 0) & (middle > grace)
            return jnp.where(ended, bracket[0], middle), jnp.where(ended, middle, bracket[1])

        return jax.lax.while_loop(wide, halve, (p.along, p.until))[1]

    def refine(self, span: Span, limits: Limits, time: Reals, there: Reals, which: Any) -> Reals:
        """By Halley's method, if that goes no further than the search was good for."""
        rate = span.field(time, there)
        _, change = jax.jvp(span.field, (time, there), (jnp.ones_like(time), rate))
        parts = jnp.stack([limits.left(there), limits.rate(rate), limits.rate(change)])
        value, slope, bend = parts[:, which]
        below = jnp.where(slope < 0, slope, -1)
        off = value / below
        # The square is little more than its second derivative.
        move = off + 0.5 * off * off * bend / below
        near = jnp.abs(move) <= 1e3 * _CLOSE * time
        # Its derivative is always that of the time, also where the span ends as it begins.
        move = jnp.where(near, move, move - jax.lax.stop_gradient(move))
        return jnp.where(slope < 0, time - move, time)

    def finish(self, stop: Any, c: Carry, p: _Point) -> Carry:
        """From the end of a span to what follows it."""
        equation, rising = self.equation, c.phase == RISING
        time = jnp.where(p.which == LASTS, stop, c.time + p.along)
        lean, speed = p.y
        turned = p.which == TURNS
        crossing = rising & (p.which == CROSSES)
        over = rising & (p.which == TOPS)
        landed = ~rising & (p.which == TOPS)
        speed = jnp.where(turned, 0, speed)
        lean = jnp.where(turned, jnp.maximum(lean, 0), lean)
        lean = jnp.where(crossing, equation.critical_angle, lean)
        lean = jnp.where(over, 0.5 * jnp.pi, lean)
        higher = lean > c.peak
        phase = jnp.where(turned, jnp.where(rising, FALLING, RISING), c.phase)
        phase = jnp.where(over, OVER, phase)

        # Impact: the block goes on to the other side with what restitution leaves.
        arriving = -speed
        restitution = self.driven.restitution
        leaving = jnp.where(landed, restitution * arriving, 0)
        zero = jnp.zeros_like(time)
        there = self.span(c._replace(time=time, side=-c.side), self.motion.acts(time))
        there, after = jax.lax.stop_gradient((there, jnp.stack([zero, leaving])))
        onward = there.field(zero, after)[1]
        held = onward < 0
        lost = (1 - restitution) * jnp.where(held, -onward, 1)
        bounces = 2 * leaving * self.rate  # time that all further bounces take, times p and `lost`
        rests = landed & held & (bounces <= 1e-3 * self.rtol * lost)
        return c._replace(
            time=time,
            side=jnp.where(landed, -c.side, c.side),
            lean=jnp.where(landed, 0, lean),
            speed=jnp.where(rests, 0, jnp.where(landed, leaving, speed)),
            phase=jnp.where(landed, jnp.where(rests, REST, RISING), phase),
            impacts=jnp.where(landed, c.impacts + 1, c.impacts),
            struck=jnp.where(landed, jnp.stack([time, -c.side * arriving]), c.struck),
            peak=jnp.where(higher, lean, c.peak),
            peak_time=jnp.where(higher, time, c.peak_time),
            crossing=jnp.where(crossing, time, c.crossing),
            demand=p.demand,
            normal=p.normal,
            failed=~(p.done & jnp.isfinite(time + lean + speed)),
        )


def _row(c: Carry) -> Reals:
    return jnp.stack([c.time, c.side, c.lean, c.speed])


def resumed(
    driven: Driven, cuts: Cuts, times: Reals, model: RockingModel, rtol: float
) -> tuple[Reals, Reals]:
    """Rotation and velocity at some times, from the last cut before each on."""
    equation = Equation.of(driven.block, model)
    stepper = Stepper(DEFAULT, rtol, 0.0)
    known = jnp.where(jnp.isnan(cuts.time), jnp.inf, cuts.time)

    def at(asked: Any) -> Any:
        inside = (asked >= 0) & (asked <= driven.duration)
        time = jnp.where(inside, asked, 0)
        index = jnp.maximum(jnp.searchsorted(known, time, side="right") - 1, 0)
        origin, side, lean, speed = (part[index] for part in jax.tree.leaves(cuts))
        moves = (lean != 0) | (speed != 0)
        # What has just been lifted is on the ground as well: it moves if the next cut is a turn.
        following = cuts.lean[jnp.minimum(index + 1, known.size - 1)]
        moves = (moves | (following > 0)) & (lean < 0.5 * jnp.pi) & (time > origin)
        span = Span(equation, driven.motion, origin, side, driven.motion.acts(origin))
        length = jnp.where(moves, time - origin, 0)
        first = jnp.stack([lean, speed])

        def turn(state: Any) -> Any:
            along, until, y, wish, memory = state
            step = stepper.step(span, along, until, y, memory)
            arrived = jnp.where(step.good, until, along)
            y = jnp.where(step.good, step.there, y)
            wish = jnp.where(step.good, jnp.maximum(step.following, wish), step.following)
            rate = span.field(arrived, y)[1]
            memory = jax.tree.map(lambda a, b: jnp.where(step.good, a, b), step.memory, memory)
            end = limited(span, length, arrived, arrived + wish, y, rate)
            return arrived, end, y, jnp.where(step.good, wish, 0), memory

        def goes_on(state: Any) -> Any:
            return (state[0] < length) & (state[1] > state[0])

        zero = jnp.zeros_like(length)
        step = first_step(span, length, first, (lean == 0) & (speed == 0))
        start = (zero, step, first, zero, stepper.memory(span, first))
        along, _, y, *_ = jax.lax.while_loop(goes_on, turn, start)
        fine = inside & (along >= length)
        return tuple(jnp.where(fine, side * part + 0.0, jnp.nan) for part in y)

    return jax.vmap(at)(times)
