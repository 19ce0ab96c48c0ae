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

from .arguments import FINITE, POSITIVE, UNIT_INTERVAL, Reals
from .block import Block
from .equation import Equation
from .fate import margins_of
from .forces import beyond, forces, friction, larger, may_exceed, smaller
from .forward import through_jacobian
from .motion import Motion
from .span import (
    CROSSES,
    DEFAULT,
    LASTS,
    TOPS,
    TURNS,
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
_MOST_STEPS = 2**20  # between two cuts
_MOST_CUTS = 2**22
_CLOSE = 1e-6  # to which the end of a span is sought before it is stepped to


class Status(enum.IntEnum):
    """How a computation ended."""

    COMPLETE = 0  # nothing ran out
    LIST_FULL = 1  # all is right, but not all impacts are listed
    STOPPED = 2  # the integrator ran out of steps, or could not go on
    INVALID = 3  # an argument was outside of what is allowed


class Driven(eqx.Module):
    """All that a driven motion depends on."""

    block: Block
    restitution: Reals
    motion: Motion
    duration: Reals
    rotation: Reals
    velocity: Reals


class Cuts(eqx.Module):
    """The state after every cut, in the order of time; NaN where there is none."""

    time: Reals
    side: Reals
    lean: Reals
    speed: Reals


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
    cuts: Cuts
    driven: Driven  # with stand-ins for what is not allowed


class _Carry(NamedTuple):
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


@through_jacobian
def follow(
    driven: Driven,
    *,
    rtol: Any,
    atol: Any,
    linearized: bool,
    listed: int,
    once: bool = False,
    method: Method = DEFAULT,
) -> Followed:
    """Follow a block to the end, or with `once` to its first impact; see `respond`."""
    driven, valid = _valid(driven)
    equation = Equation.of(driven.block, linearized)
    one = _Loop(driven, equation, Stepper(method, rtol, atol), method, rtol)
    first = one.with_corner(one.first(valid), jnp.zeros((), bool))

    def goes_on(state: tuple[_Carry, Reals, Reals]) -> Any:
        c, *_ = state
        wanted = (c.impacts == 0) | (not once)
        going = (c.time < driven.duration) & (c.phase != OVER) & wanted
        return going & ~c.failed & (c.count < _MOST_CUTS)

    def turn(state: tuple[_Carry, Reals, Reals]) -> tuple[_Carry, Reals, Reals]:
        before, cuts, impacts = state
        c = one.turn(before)
        # Not inside of what is chosen: there the lists would be copied.
        index = jnp.where(c.impacts > before.impacts, before.impacts, listed)
        return (
            c,
            cuts.at[before.count].set(_row(c), mode="drop"),
            impacts.at[index].set(c.struck, mode="drop"),
        )

    unknown = jnp.full((4 * listed, 4), jnp.nan, driven.duration.dtype)
    cuts, impacts = unknown.at[0].set(_row(first)), unknown[:listed, :2]
    last, cuts, impacts = jax.lax.while_loop(goes_on, turn, (first, cuts, impacts))

    broken = (last.failed & valid) | (last.count >= _MOST_CUTS)
    full = (last.impacts > listed) | (last.count > 4 * listed)
    status = jnp.where(broken, Status.STOPPED, jnp.where(full, Status.LIST_FULL, Status.COMPLETE))
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
        cuts=Cuts(*cuts.T),
        driven=driven,
    )


class _Loop:
    """What the turns of the loop have in common."""

    def __init__(
        self, driven: Driven, equation: Equation, stepper: Stepper, method: Method, rtol: Any
    ):
        motion = driven.motion
        self.driven, self.equation, self.motion = driven, equation, motion
        self.stepper, self.method, self.rtol = stepper, method, rtol
        # To the end of a span: each but the last improves the time of the next, the first its
        # value, the second its two derivatives as well.
        self.tries = 3 if method.locate == "step" else 1
        self.rate = jnp.sqrt(equation.square)
        self.uplifts = Uplifts.of(equation, motion)
        # Of a block just lifted: little beside its own time and that in which the input changes.
        changes = (motion.end - motion.start) / self.uplifts.knots.size
        self.grace = jax.lax.stop_gradient(1e-6 * jnp.minimum(1 / self.rate, changes))

    def first(self, valid: Any) -> _Carry:
        """The initial state, on the side on which it leans or to which it moves."""
        driven, equation = self.driven, self.equation
        zero = jnp.zeros_like(driven.duration)
        towards = jnp.where(driven.rotation == 0, driven.velocity, driven.rotation)
        side = jnp.where(towards < 0, -1, 1).astype(zero.dtype)
        lean, speed = side * driven.rotation, side * driven.velocity
        phase = jnp.where(speed < 0, FALLING, RISING)
        phase = jnp.where((lean == 0) & (speed == 0), REST, phase)
        none = jnp.zeros((), int)
        return _Carry(
            time=zero,
            side=side,
            lean=lean,
            speed=speed,
            phase=jnp.where(lean >= 0.5 * jnp.pi, OVER, phase),
            count=none + 1,
            impacts=none,
            struck=jnp.stack([zero, zero]),
            peak=lean,
            peak_time=zero,
            crossing=jnp.where(lean >= equation.critical_angle, zero, jnp.nan),
            margin=smaller(*margins_of(equation, driven.restitution, lean, speed)),
            demand=zero,
            normal=zero + jnp.inf,
            failed=~valid,
        )

    def turn(self, c: _Carry) -> _Carry:
        """From a cut to the next."""
        before, stop = c, self.stop_after(c.time)
        c = jax.lax.cond(
            c.phase == REST,
            lambda: self.wait(c, stop),
            lambda: self.move(self.turned_first(c), stop),
        )
        c = self.with_corner(c, self.motion.acts(before.time))
        # Where the input ends, the fate is read.
        input_end = smaller(self.motion.end, self.driven.duration)
        now = (before.time < input_end) & ((c.time >= input_end) | (c.phase == OVER))
        margin = smaller(*margins_of(self.equation, self.driven.restitution, c.lean, c.speed))
        return c._replace(margin=jnp.where(now, margin, c.margin), count=c.count + 1)

    def span(self, c: _Carry) -> Span:
        """What begins at a cut."""
        return Span(
            self.equation,
            self.motion,
            c.time,
            c.side,
            self.motion.acts(c.time),
            c.phase == RISING,
            c.lean >= self.equation.critical_angle,
            # A block that is just being lifted has an acceleration of 0, up to rounding.
            jnp.where(
                (c.lean == 0) & (c.speed == 0), self.grace + close_to(self.motion, c.time), 0
            ),
        )

    def stop_after(self, time: Any) -> Any:
        """The next edge of the input, or the end; of those that coincide, the end."""
        stop = duration = self.driven.duration
        latest = duration - close_to(self.motion, duration)
        for edge in (self.motion.end, self.motion.start):
            stop = jnp.where((edge > time) & (edge < latest), edge, stop)
        return stop

    def with_corner(self, c: _Carry, acted: Any) -> _Carry:
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
        span = eqx.tree_at(lambda s: s.acts, self.span(c), acted)
        y = jnp.stack([c.lean, c.speed])
        stays = (c.phase == REST) | (c.phase == OVER)
        rate = span.field(jnp.zeros_like(move), y)
        lean, speed = y + jnp.where(stays, 0, move) * rate
        return c._replace(time=c.time + move, lean=lean, speed=speed)

    def wait(self, c: _Carry, stop: Any) -> _Carry:
        """For the input to lift the block, or for the next edge of the input."""
        found, time, side = self.uplifts.following(c.time, stop)
        acts = self.motion.acts(c.time)
        found = found & acts
        until = jnp.where(found, time, stop)
        demand, normal = self.uplifts.at_rest(c.time, until, acts)
        return c._replace(
            time=until,
            side=jnp.where(found, side, c.side),
            phase=jnp.where(found, RISING, REST),
            demand=larger(c.demand, demand),
            normal=smaller(c.normal, normal),
        )

    def turned_first(self, c: _Carry) -> _Carry:
        """A state whose next move is not that of its phase, after an edge of the input."""
        y = jnp.stack([c.lean, c.speed])
        rate = self.span(c).field(jnp.zeros_like(c.time), y)[1]
        still = c.speed == 0
        # One that has just been lifted stays so: its acceleration is 0, up to rounding.
        down = jnp.where(c.lean > 0, FALLING, jnp.where(c.phase == FALLING, REST, c.phase))
        phase = jnp.where(still & (rate < 0), down, c.phase)
        return c._replace(phase=jnp.where(still & (rate > 0), RISING, phase))

    def move(self, c: _Carry, stop: Any) -> _Carry:
        """Through a span, unless the block has come to rest."""
        span, length = self.span(c), stop - c.time
        y, zero = jnp.stack([c.lean, c.speed]), jnp.zeros_like(c.time)
        none = jnp.zeros((), int)
        start = _Point(
            along=zero,
            y=y,
            until=first_step(span, length, y),
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
            lambda p: self.advance(span, length, p),
            start,
        )
        return jax.lax.cond(
            c.phase == REST,
            lambda: c,
            lambda: self.finish(span, stop, c, last),
        )

    def advance(self, span: Span, length: Any, p: _Point) -> _Point:
        """One step, or one more to the end of the span."""
        step = self.stepper.step(span, p.along, p.until, p.y, p.memory)
        refines = p.refined > 0
        good = step.good & ~refines
        values = span.ends(step.there)
        ends = good & (p.until > span.grace) & (values.min() <= 0)
        refined = jnp.where(refines | ends, p.refined + 1, 0)
        which = jnp.where(ends | (p.refined == 1), jnp.argmin(values), p.which)
        goes = good & ~ends
        done = (goes & (p.until >= length)) | (refined > self.tries)

        # The forces of what is done for good.
        times, states = jnp.stack([p.along, p.until]), jnp.stack([p.y, step.there], axis=1)
        rates = span.field(times, states)[1]
        counts = goes | done
        # Most steps come nowhere near the extremes so far, and a look is much cheaper.
        demand, normal = jax.lax.cond(
            counts & may_exceed(span, times, states, rates, (p.demand, p.normal)),
            lambda: beyond(span, times, states, rates, (p.demand, p.normal)),
            lambda: (p.demand, p.normal),
        )
        along, y = jnp.where(counts, p.until, p.along), jnp.where(counts, step.there, p.y)
        wish = jnp.where(goes, jnp.maximum(step.following, p.wish), step.following)
        until = limited(span, length, along, along + wish, y, jnp.where(goes, rates[1], rates[0]))
        until = jax.lax.cond(
            refines | ends,
            lambda: jax.lax.cond(
                ends,
                lambda: self.sought(span, p, step),
                lambda: self.refine(span, p.until, step.there, which),
            ),
            lambda: until,
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
            demand=demand,
            normal=normal,
            steps=p.steps + 1,
            memory=jax.tree.map(lambda a, b: jnp.where(goes, a, b), step.memory, p.memory),
        )

    def sought(self, span: Span, p: _Point, step: Step) -> Reals:
        """Where the span ends within a step, nearly."""
        if self.method.locate == "end":
            return p.until
        span, p, step = jax.lax.stop_gradient((span, p, step))
        eps = float(jnp.finfo(p.along.dtype).eps)
        tiny = float(jnp.finfo(p.along.dtype).tiny)
        close = max(_CLOSE, 2 * eps) if self.method.locate == "step" else 2 * eps

        def wide(bracket: Any) -> Any:
            return bracket[1] - bracket[0] > close * jnp.maximum(bracket[1], tiny / eps)

        def halve(bracket: Any) -> Any:
            middle = 0.5 * (bracket[0] + bracket[1])
            ended = span.ends(self.stepper.between(p.along, p.until, step, middle)).min() <= 0
            ended = ended & (middle > span.grace)
            return jnp.where(ended, bracket[0], middle), jnp.where(ended, middle, bracket[1])

        return jax.lax.while_loop(wide, halve, (p.along, p.until))[1]

    def refine(self, span: Span, time: Reals, there: Reals, which: Any) -> Reals:
        """By Halley's method, if that goes no further than the search was good for."""
        rate = span.field(time, there)
        _, change = jax.jvp(span.field, (time, there), (jnp.ones_like(time), rate))
        value, slope = jax.jvp(lambda y: span.ends(y)[which], (there,), (rate,))
        _, bend = jax.jvp(lambda y: span.ends(y)[which], (there,), (change,))
        below = jnp.where(slope < 0, slope, -1)
        off = value / below
        # The square is little more than its second derivative.
        move = off + 0.5 * off * off * bend / below
        near = jnp.abs(move) <= 1e3 * _CLOSE * time
        # Its derivative is always that of the time, also where the span ends as it begins.
        move = jnp.where(near, move, move - jax.lax.stop_gradient(move))
        return jnp.where(slope < 0, time - move, time)

    def finish(self, span: Span, stop: Any, c: _Carry, p: _Point) -> _Carry:
        """From the end of a span to what follows it."""
        equation = self.equation
        # The forces just before an impact or at a turn.
        last_horizontal, last_normal = forces(span, p.along, p.y)
        time = jnp.where(p.which == LASTS, stop, c.time + p.along)
        lean, speed = p.y
        turned = p.which == TURNS
        crossing = span.rising & (p.which == CROSSES)
        over = span.rising & (p.which == TOPS)
        landed = ~span.rising & (p.which == TOPS)
        speed = jnp.where(turned, 0, speed)
        lean = jnp.where(turned, jnp.maximum(lean, 0), lean)
        lean = jnp.where(crossing, equation.critical_angle, lean)
        lean = jnp.where(over, 0.5 * jnp.pi, lean)
        higher = lean > c.peak
        phase = jnp.where(turned, jnp.where(span.rising, FALLING, RISING), c.phase)
        phase = jnp.where(over, OVER, phase)

        # Impact: the block goes on to the other side with what restitution leaves.
        arriving = -speed
        restitution = self.driven.restitution
        leaving = jnp.where(landed, restitution * arriving, 0)
        zero = jnp.zeros_like(time)
        there = c._replace(time=time, side=-c.side)
        onward = self.span(there).field(zero, jnp.stack([zero, leaving]))[1]
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
            struck=jnp.stack([time, -c.side * arriving]),
            peak=jnp.where(higher, lean, c.peak),
            peak_time=jnp.where(higher, time, c.peak_time),
            crossing=jnp.where(crossing, time, c.crossing),
            demand=larger(p.demand, friction(last_horizontal, last_normal)),
            normal=smaller(p.normal, last_normal),
            failed=~(p.done & jnp.isfinite(time + lean + speed)),
        )


def _row(c: _Carry) -> Reals:
    return jnp.stack([c.time, c.side, c.lean, c.speed])


def _valid(driven: Any) -> tuple[Driven, Any]:
    """The scene with stand-ins for what is not allowed, and whether all is."""
    from .arguments import _module_within, _within

    block: Any
    motion: Any
    block, valid = _module_within(driven.block)
    restitution, ok = _within(driven.restitution, UNIT_INTERVAL)
    duration, long = _within(driven.duration, POSITIVE)
    motion, moves = _module_within(driven.motion)
    rotation, there = _within(driven.rotation, FINITE)
    velocity, going = _within(driven.velocity, FINITE)
    valid = valid & ok & long & jnp.all(moves) & there & going
    return Driven(block, restitution, motion, duration, rotation, velocity), valid


def resumed(
    driven: Driven, cuts: Cuts, times: Reals, linearized: bool, rtol: float
) -> tuple[Reals, Reals]:
    """Rotation and velocity at some times, from the last cut before each on."""
    equation = Equation.of(driven.block, linearized)
    stepper = Stepper(DEFAULT, rtol, 0.0)
    known = jnp.where(jnp.isnan(cuts.time), jnp.inf, cuts.time)

    def at(asked: Any) -> Any:
        inside = (asked >= 0) & (asked <= driven.duration)
        time = jnp.where(inside, asked, 0)
        index = jnp.maximum(jnp.searchsorted(known, time, side="right") - 1, 0)
        origin, side, lean, speed = (part[index] for part in jax.tree.leaves(cuts))
        acts, yes = driven.motion.acts(origin), jnp.array(True)
        moves = (lean != 0) | (speed != 0)
        # What has just been lifted is on the ground as well: it moves if the next cut is a turn.
        following = cuts.lean[jnp.minimum(index + 1, known.size - 1)]
        moves = (moves | (following > 0)) & (lean < 0.5 * jnp.pi) & (time > origin)
        never = jnp.full_like(time, jnp.inf)
        span = Span(equation, driven.motion, origin, side, acts, yes, yes, never)
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
        start = (zero, first_step(span, length, first), first, zero, stepper.memory(span, first))
        along, _, y, *_ = jax.lax.while_loop(goes_on, turn, start)
        fine = inside & (along >= length)
        return tuple(jnp.where(fine, side * part + 0.0, jnp.nan) for part in y)

    return jax.vmap(at)(times)
