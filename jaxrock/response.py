"""Driven motion, adaptively: any ground motion, through every impact.

The motion is cut where it has a corner: at uplift, at every impact, at every turn from
rising to falling and back, and at the ends of the input. Between two cuts the lean is
monotone, and one `diffrax.diffeqsolve` with an event goes from cut to cut, in a time of its
own, so that the smallest bounce keeps all its digits.
"""

import contextlib
import enum
import functools
from collections.abc import Iterator
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from .arguments import (
    FINITE,
    POSITIVE,
    UNIT_INTERVAL,
    Booleans,
    Number,
    Numbers,
    Reals,
    as_real,
    check,
    of_one_precision,
)
from .block import Block
from .equation import Equation
from .fate import margins_of
from .forward import through_jacobian
from .motion import Motion
from .printing import listed

REST, RISING, FALLING, OVER = range(4)
_MAX_STEPS = 2**20
_MAX_CUTS = 2**22
SOLVERS = ("Tsit5", "Dopri5", "Dopri8", "Bosh3", "Heun")
_TIMES = 512  # of a history at once
_CLOSE = 1e-6  # to which a cut is sought before it is stepped to


class Status(enum.IntEnum):
    """How a computation ended."""

    COMPLETE = 0  # nothing ran out
    LIST_FULL = 1  # all is right, but not all impacts are listed
    STOPPED = 2  # the integrator ran out of steps, or could not go on
    INVALID = 3  # an argument was outside of what is allowed


class Response(eqx.Module):
    """What a block did under a ground motion; see `respond`.

    Attributes
    ----------
    final_rotation, final_velocity : Array
        alpha [rad] and its rate [rad/s] at the end of the duration.
    peak_rotation, peak_time : Array
        Largest abs(alpha) [rad], at most pi / 2, and when [s].
    overturned : Array of bool
        Whether it falls: by reaching pi / 2, or by energy once the input has ended (or the
        duration, if that is shorter, as if the input ended there).
    overturning_time : Array
        When it passed the critical angle for the last time [s]; NaN if it stands, or if that
        comes after the duration.
    margin : Array
        `fate_margin` at the end of the input [-]: negative where the block falls.
    impacts : Array of int
        Number of impacts.
    impact_times, impact_velocities : Array, shape (impacts,)
        When [s], and the angular velocity just before [rad/s], signed as alpha is. Under a
        transformation the shape is (`listed`,), filled up with NaN.
    at_rest : Array of bool
        Whether it rests on the ground at the end of the duration.
    friction_demand, normal_force : Array
        Largest ratio of horizontal to normal force at the base, and smallest normal force
        over weight [-], over all of the motion, from the accelerations of the centre of mass:
        at rest, in motion, just before and after every impact, and of a block that overturns
        up to the moment in which abs(alpha) reaches pi / 2. The impulses of impacts do not
        count. A normal force of 0 or less means that the block would have left the ground: the
        friction demand is inf then, and from there on the model is broken. 0 and inf for a
        block that lies on its side from the beginning.
    status : Array of int
        A `Status`; other than 0 or 1, the answers are NaN.
    cuts, scene, linearized
        What `history` integrates from.
    """

    final_rotation: Reals
    final_velocity: Reals
    peak_rotation: Reals
    peak_time: Reals
    overturned: Booleans
    overturning_time: Reals
    margin: Reals
    impacts: Int[Array, "..."]
    impact_times: Reals
    impact_velocities: Reals
    at_rest: Booleans
    friction_demand: Reals
    normal_force: Reals
    status: Int[Array, "..."]
    cuts: "Cuts"
    scene: "Driven"
    linearized: bool = eqx.field(static=True)

    def history(self, time: Numbers) -> tuple[Reals, Reals]:
        """Rotation and angular velocity over time, to the accuracy of the integration.

        Parameters
        ----------
        time : array_like
            Times [s], from 0 to the duration.

        Returns
        -------
        rotation, velocity : Array, shape (...)
            alpha [rad] and its rate [rad/s]; NaN outside. A block that has overturned stays
            where it lies.
        """
        times = as_real("time", time).astype(self.cuts.time.dtype)
        flat, cuts = times.reshape(-1), self.cuts
        leaves = jax.tree.leaves((self, times))
        if any(isinstance(leaf, jax.core.Tracer) for leaf in leaves):
            found = _history(self.scene, cuts, self.linearized, flat)
        else:
            # Few different shapes, so that little is compiled.
            size = max(1, -(-flat.size // _TIMES)) * _TIMES
            pieces = _padded(flat, size, 0.0).reshape(-1, _TIMES)
            room = max(64, 1 << (cuts.time.size - 1).bit_length())
            cuts = jax.tree.map(lambda part: jnp.asarray(_padded(part, room, np.nan)), cuts)
            parts = [
                _history(self.scene, cuts, self.linearized, jnp.asarray(piece)) for piece in pieces
            ]
            found = jnp.asarray(np.concatenate(parts, axis=-1)[:, : flat.size])
        rotation, velocity = found
        return rotation.reshape(times.shape), velocity.reshape(times.shape)

    def __str__(self) -> str:
        if jnp.ndim(self.status) or isinstance(self.status, jax.core.Tracer):
            return listed(
                self,
                status="",
                overturned="",
                margin="",
                peak_rotation="rad",
                peak_time="s",
                impacts="",
                friction_demand="",
                normal_force="of the weight",
            )
        status = Status(int(self.status))
        if status not in (Status.COMPLETE, Status.LIST_FULL):
            return f"no response: {status.name.lower()}"
        angle = self.scene.block.critical_angle
        fallen = abs(self.final_rotation) >= 0.5 * jnp.pi
        still = "lies on its side" if fallen else "at rest" if self.at_rest else "in motion"
        lines = [
            f"{'overturns' if self.overturned else 'stands'}, margin {self.margin:.4g}",
            f"peak rotation {self.peak_rotation:.6g} rad = {self.peak_rotation / angle:.4g}"
            f" alpha_c at {self.peak_time:.4g} s",
            f"{self.impacts} impacts, {still} at the end",
            f"friction demand {self.friction_demand:.4g}, smallest normal force"
            f" {self.normal_force:.4g} of the weight",
        ]
        if self.overturned and jnp.isfinite(self.overturning_time):
            lines[0] += f", beyond return from {self.overturning_time:.4g} s"
        return "\n".join(lines)


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


class _Carry(NamedTuple):
    time: Any
    side: Any
    lean: Any
    speed: Any
    phase: Any
    count: Any  # cuts
    impacts: Any
    peak: Any
    peak_time: Any
    crossing: Any
    margin: Any
    demand: Any
    normal: Any
    failed: Any
    impact_times: Any
    impact_velocities: Any
    cuts: Any


def _pacing() -> Any:
    """The class of the step-size controller; made on first use, since diffrax loads slowly."""
    import diffrax

    class Pace(diffrax.AbstractStepSizeController):
        """Diffrax's controller, stepping to every kink and to the end, and over at most one turn.

        It also keeps the extremes of the forces: no other part of diffrax sees every step.
        """

        controller: diffrax.PIDController
        until: Any  # end of the span
        extremes: Any  # up to its begin: friction demand, normal force

        def wrap(self, direction: Any) -> Any:
            return self

        def init(
            self,
            terms: Any,
            t0: Any,
            t1: Any,
            y0: Any,
            dt0: Any,
            args: Any,
            func: Any,
            error_order: Any,
        ) -> Any:
            end, inner = self.controller.init(terms, t0, t1, y0, dt0, args, func, error_order)
            state = (inner, end - t0, (t0, y0), self.extremes)
            return self._limit(t0, end, y0, args.field(t0, y0)[1], args), state

        def adapt_step_size(
            self,
            t0: Any,
            t1: Any,
            y0: Any,
            y1_candidate: Any,
            args: Any,
            y_error: Any,
            error_order: Any,
            controller_state: Any,
        ) -> Any:
            inner, wish, begin, extremes = controller_state
            keep, start, end, jump, inner, result = self.controller.adapt_step_size(
                t0, t1, y0, y1_candidate, args, y_error, error_order, inner
            )
            # A step cut short says nothing against the length wished for before.
            step = jnp.where(keep, jnp.maximum(end - start, wish), end - start)
            y = jnp.where(keep, y1_candidate, y0)
            times, states = jnp.stack([t0, t1]), jnp.stack([y0, y1_candidate], axis=1)
            accelerations = args.field(times, states)[1]
            # Most steps come nowhere near the extremes so far, and a look is much cheaper.
            extremes = jax.lax.cond(
                keep & args.may_exceed(times, states, accelerations, extremes),
                lambda: args.beyond(times, states, accelerations, extremes),
                lambda: extremes,
            )
            acceleration = jnp.where(keep, accelerations[1], accelerations[0])
            end = self._limit(start, start + step, y, acceleration, args)
            wish = jnp.where(keep, step, 0)
            begin = jax.tree.map(lambda new, old: jnp.where(keep, new, old), (t0, y0), begin)
            # Nothing is left: diffrax stops by itself only at an end that it clips steps to.
            start = jnp.where(keep & (t1 >= self.until), 2 * start, start)
            return keep, start, end, jump, (inner, wish, begin, extremes), result

        def _limit(self, start: Any, end: Any, y: Any, acceleration: Any, args: Any) -> Any:
            slowing = y[1] * acceleration < 0
            brake = 2 * jnp.abs(y[1] / jnp.where(slowing, acceleration, 1))
            end = jnp.where(slowing, jnp.minimum(end, start + brake), end)
            kink = args.motion.next_kink(args.origin + start) - args.origin
            last = self.until - _close_to(args.motion, args.origin + self.until)
            stop = jnp.where((kink > start) & (kink < last), kink, self.until)
            # A step that ends at a kink goes with it: the slope of the input on this side of
            # the kink and on that must not both count there.
            return jnp.where(stop <= end, stop, jax.lax.stop_gradient(end))

    return Pace


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


class _Span(eqx.Module):
    """The equation of motion on one side, in a time counted from `origin`."""

    equation: Equation
    motion: Motion
    origin: Reals
    side: Reals
    acts: Booleans
    rising: Booleans
    crossed: Booleans  # starts beyond the critical angle
    grace: Reals  # time in which nothing ends the span

    def ground(self, time: Reals) -> tuple[Reals, Reals]:
        horizontal, vertical = self.motion.value(self.origin + time)
        over_g = jnp.where(self.acts, 1 / self.equation.gravity, 0)
        return self.side * horizontal * over_g, vertical * over_g

    def field(self, time: Reals, y: Reals) -> Reals:
        return jnp.stack([y[1], self.equation.acceleration(y[0], *self.ground(time))])

    def forces(self, time: Reals, y: Reals) -> tuple[Reals, Reals]:
        """Horizontal and normal force over weight, from the acceleration of the centre."""
        push, lift = self.ground(time)
        equation = self.equation
        rate = equation.acceleration(y[0], push, lift)
        sine, cosine = (f(equation.critical_angle - y[0]) for f in (jnp.sin, jnp.cos))
        radius_over_g = 0.75 / equation.square
        horizontal = radius_over_g * (cosine * rate + sine * y[1] ** 2) - push
        normal = 1 + lift + radius_over_g * (sine * rate - cosine * y[1] ** 2)
        return horizontal, normal

    def may_exceed(
        self,
        times: Reals,
        states: Reals,
        accelerations: Reals,
        kept: tuple[Reals, Reals],
    ) -> Booleans:
        """Whether the forces in a step come near the extremes that are kept.

        From both ends and the middle: twice their spread beyond them, nothing is looked for.
        """
        step, change, bend = times[1] - times[0], states[:, 1] - states[:, 0], accelerations
        lean, speed = 0.5 * states.sum(axis=1)
        lean = lean - step * (5 / 32) * change[1] + step**2 / 64 * bend.sum()
        speed = 15 / 8 * change[0] / step - 7 / 8 * speed + step / 32 * (bend[1] - bend[0])
        middle = jnp.stack([lean, speed])
        share = jnp.array([0.0, 0.5, 1.0], step.dtype)
        at = jnp.stack([states[:, 0], middle, states[:, 1]], axis=1)
        horizontal, normal = self.forces(times[0] + share * step, at)
        demand, least = kept
        finite = demand < jnp.inf
        slides = jnp.abs(horizontal) - jnp.where(finite, demand, 0) * normal
        steeper = finite & (3 * slides.max() - 2 * slides.min() >= 0)
        return steeper | (3 * normal.min() - 2 * normal.max() <= least)

    def beyond(
        self,
        times: Reals,
        states: Reals,
        accelerations: Reals,
        kept: tuple[Reals, Reals],
    ) -> tuple[Reals, Reals]:
        """The extremes that are kept, or those of a step where they are beyond them."""
        demand, normal = self.extremes(times, states, accelerations)
        return larger(kept[0], demand), smaller(kept[1], normal)

    def extremes(self, times: Reals, states: Reals, accelerations: Reals) -> tuple[Reals, Reals]:
        """Largest friction demand and smallest normal force in a step, before the span ends.

        From the state at both ends of the step, on the polynomial that has their leans, speeds
        and accelerations: at nine times, and at the extreme value of the parabola through each
        three of them that follow one another.
        """
        begin, step = times[0], times[1] - times[0]
        lean, drift, bend = states[0], step * states[1], 0.5 * step**2 * accelerations
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

        def at(share: Reals) -> tuple[Reals, Reals, Booleans]:
            time = begin + share * step
            lean, drift = (
                functools.reduce(lambda value, c: value * share + c, reversed(each))
                for each in (powers, slopes)
            )
            y = jnp.stack([lean, drift / step])
            before = (time <= self.grace) | (self.ends(y).min(axis=0) >= 0)
            return (*self.forces(time, y), before)

        nodes = jnp.linspace(0, 1, 9, dtype=lean.dtype)
        horizontal, normal, before = at(nodes)
        # The angle of the force is smooth where the normal force vanishes.
        curves = jnp.stack([jnp.arctan2(jnp.abs(horizontal), normal), normal])
        rise = 0.5 * (curves[:, 2:] - curves[:, :-2])
        bent = curves[:, 2:] - 2 * curves[:, 1:-1] + curves[:, :-2]
        moved = jnp.clip(-rise / jnp.where(bent == 0, 1, bent), -1, 1)
        between = (jnp.stack([nodes[1:-1]] * 2) + 0.125 * moved).reshape(-1)
        found = zip((horizontal, normal, before), at(between), strict=True)
        horizontal, normal, before = map(jnp.concatenate, found)
        # In the shortest steps, which change nothing, the speed in between is lost to rounding.
        eps = float(jnp.finfo(lean.dtype).eps)
        long = eps**0.5 * jnp.abs(lean[0]) <= step * jnp.sqrt(self.equation.square)
        before = before & (long | (jnp.arange(before.size) == 0))
        demand = jnp.where(before, friction(horizontal, normal), 0).max()
        return demand, jnp.where(before, normal, jnp.inf).min()

    def ends(self, y: Reals) -> Reals:
        """What is positive until the span ends, for each way it can end."""
        angle = self.equation.critical_angle
        lean, speed = y[0] / angle, y[1] / (jnp.sqrt(self.equation.square) * angle)
        top = jnp.where(self.rising, 0.5 * jnp.pi / angle - lean, lean)
        crossing = jnp.where(self.rising & ~self.crossed, 1 - lean, jnp.inf)
        return jnp.stack([jnp.where(self.rising, speed, -speed), top, crossing])


def _close_to(motion: Motion, time: Reals) -> Reals:
    """Up to which a time coincides with a corner of the motion, rounded as the corner is."""
    return 16 * float(jnp.finfo(time.dtype).eps) * (time + motion.end)


def _field(t: Any, y: Any, args: Any) -> Any:
    return args.field(t, y)


def _until_cut(t: Reals, y: Reals, args: _Span, **_: Any) -> Reals:
    # Positive at the start by decree: there the span has just begun, whatever rounding says.
    value = jnp.where(t > args.grace, args.ends(y).min(), 1)
    # Diffrax compares it with a Python number, which has the precision of JAX's settings.
    return value.astype(jnp.result_type(float))


class Method(NamedTuple):
    """How the equation is integrated: what `measure_tradeoff` compares with the default."""

    solver: str = "Tsit5"  # of diffrax
    # Where a span ends: "step", by a last step of its own; "interpolant", on that of the
    # solver; "end", at the end of the step in which it does.
    locate: str = "step"


_DEFAULT = Method()


def _solve(
    span: _Span,
    length: Reals,
    y: Reals,
    rtol: Any,
    atol: Any,
    extremes: tuple[Reals, Reals],
    method: Method = _DEFAULT,
) -> Any:
    """From a cut to the next: time, state, which end (3: none), friction, normal, success.

    The friction demand and the normal force are the extremes up to now.
    """
    import diffrax
    import optimistix

    eps = float(jnp.finfo(y.dtype).eps)
    tiny = float(jnp.finfo(y.dtype).tiny)
    close = max(_CLOSE, 2 * eps) if method.locate == "step" else 2 * eps

    class Halving(optimistix.Bisection):
        """Bisection until the interval is small beside the time since the last cut."""

        def terminate(self, fn: Any, y: Any, args: Any, options: Any, state: Any, tags: Any) -> Any:
            width = jnp.abs(state.upper - state.lower)
            small = width <= close * jnp.maximum(jnp.abs(y), tiny / eps)
            return small, optimistix.RESULTS.successful

    # Of the ways to run over the stages, the one that has a forward derivative.
    solver = getattr(diffrax, method.solver)(scan_kind="lax")
    term = diffrax.ODETerm(_field)
    finder = None if method.locate == "end" else Halving(rtol=eps, atol=0.0, flip=True)
    Pace = _pacing()
    solution = diffrax.diffeqsolve(
        term,
        solver,
        jnp.zeros_like(length),
        2 * length,  # never reached: see `Pace`
        _first_step(span, length, y),
        y,
        span,
        saveat=diffrax.SaveAt(t1=True, controller_state=True),
        stepsize_controller=Pace(diffrax.PIDController(rtol=rtol, atol=atol), length, extremes),
        event=diffrax.Event(_until_cut, finder, direction=False),
        adjoint=diffrax.ForwardMode(),
        max_steps=_MAX_STEPS,
        throw=False,
    )
    assert solution.ts is not None
    assert solution.ys is not None
    time, y = smaller(length, solution.ts[0]), solution.ys[0]
    happened = jnp.asarray(solution.event_mask)
    end = jnp.argmin(span.ends(y))
    assert solution.controller_state is not None
    _, _, begin, (demand, normal) = solution.controller_state
    fine = diffrax.is_successful(solution.result) | diffrax.is_event(solution.result)
    if method.locate == "step":

        def stepped(until: Reals) -> Reals:
            state = solver.init(term, begin[0], until, begin[1], span)
            return solver.step(term, begin[0], until, begin[1], span, state, made_jump=False)[0]

        def better(until: Reals) -> Reals:
            """By Newton's method, if that goes no further than the bisection was good for."""
            there = stepped(until)
            rate = span.field(until, there)
            value, slope = jax.jvp(lambda y: span.ends(y)[end], (there,), (rate,))
            move = value / jnp.where(slope < 0, slope, -1)
            near = jnp.abs(move) <= 1e3 * _CLOSE * until
            # Its derivative is always that of the time, also where the span ends as it begins.
            move = jnp.where(near, move, move - jax.lax.stop_gradient(move))
            return jnp.where(slope < 0, until - move, until)

        # Twice, which gives the time two derivatives.
        closer = jax.lax.fori_loop(0, 2, lambda _, t: better(t), jax.lax.stop_gradient(time))
        time = jnp.where(happened, closer, length)
        y = jnp.where(happened, stepped(closer), y)
    return time, y, jnp.where(happened, end, 3), demand, normal, fine


def _first_step(span: _Span, length: Reals, y: Reals) -> Reals:
    """A quarter of the arc, or what leaves the acceleration its sign."""
    step = jnp.minimum(length, 0.05 / jnp.sqrt(span.equation.square))
    kink = span.motion.next_kink(span.origin) - span.origin
    step = jnp.where(kink > 0, jnp.minimum(step, kink), step)
    here, there = span.field(jnp.zeros_like(step), y)[1], span.field(step, y)[1]
    flips = (here * there < 0) & (span.grace == 0)
    share = here / jnp.where(flips, here - there, 1)
    step = jnp.where(flips, 0.5 * share * step, step)
    strongest = jnp.maximum(jnp.abs(here), jnp.abs(there))
    quarter = 0.5 * jnp.abs(y[1]) / jnp.where(strongest > 0, strongest, 1)
    step = jnp.where((strongest > 0) & (quarter > 0), jnp.minimum(step, quarter), step)
    # One that goes to the end of the span is cut there by the solver, which then knows that the
    # end is given: of a tie it would take half the derivative.
    return jax.lax.stop_gradient(jnp.where(step < length, step, 2 * length))


@through_jacobian
def follow(
    driven: Driven,
    *,
    rtol: Any,
    atol: Any,
    linearized: bool,
    listed: int,
    once: bool = False,
    method: Method = _DEFAULT,
) -> Response:
    """Follow a block to the end, or with `once` to its first impact; see `respond`."""
    dtype = driven.duration.dtype
    driven, valid = _valid(driven)
    motion, duration = driven.motion, driven.duration
    equation = Equation.of(driven.block, linearized)
    rate = jnp.sqrt(equation.square)
    input_end = jnp.minimum(motion.end, duration)
    knots = motion.knots()
    # Of a block just lifted: little beside its own time and that in which the input changes.
    grace = 1e-6 * jnp.minimum(1 / rate, (motion.end - motion.start) / knots.size)
    grace = jax.lax.stop_gradient(grace)

    def span_at(c: _Carry) -> _Span:
        return _Span(
            equation,
            motion,
            c.time,
            c.side,
            motion.acts(c.time),
            c.phase == RISING,
            c.lean >= equation.critical_angle,
            # A block that is just being lifted has an acceleration of 0, up to rounding.
            jnp.where((c.lean == 0) & (c.speed == 0), grace, 0),
        )

    def stop_after(time: Any) -> Any:
        """The next edge of the input, or the end; of those that coincide, the end."""
        latest = duration - _close_to(motion, duration)
        stop = duration
        for edge in (motion.end, motion.start):
            stop = jnp.where((edge > time) & (edge < latest), edge, stop)
        return stop

    def with_corner(c: _Carry, acted: Any) -> _Carry:
        """Go with the corner that the state coincides with, not a time before or after it.

        That changes derivatives only: up to the corner the block moves for no time, but one
        that has a derivative, under the input as it is before the corner.
        """
        near = _close_to(motion, c.time)
        kink = motion.next_kink(c.time - near)
        corner = jnp.where(kink <= c.time + near, kink, c.time)
        corner = jnp.where(~acted & (c.time == motion.start), motion.start, corner)
        corner = jnp.where(acted & (c.time == motion.end), motion.end, corner)
        corner = jnp.where(c.time >= duration, duration, corner)
        move = corner - c.time
        move = move - jax.lax.stop_gradient(move)
        span = eqx.tree_at(lambda s: s.acts, span_at(c), acted)
        acceleration = span.field(jnp.zeros_like(move), jnp.stack([c.lean, c.speed]))[1]
        move_by = jnp.where((c.phase == REST) | (c.phase == OVER), 0, move)
        return c._replace(
            time=c.time + move,
            lean=c.lean + move_by * c.speed,
            speed=c.speed + move_by * acceleration,
        )

    def at_rest(c: _Carry) -> _Carry:
        """Wait for the input to lift the block, or for the next edge of the input."""
        stop = stop_after(c.time)
        found, time, side = _uplift(equation, motion, knots, c.time, stop)
        found = found & motion.acts(c.time)
        until = jnp.where(found, time, stop)
        waiting = jnp.where(knots < c.time, c.time, jnp.where(knots > until, until, knots))
        # A block at rest is held by the ground: only what the ground gives counts.
        accelerations = motion.value(waiting)
        acts = motion.acts(c.time)
        push, lift = (jnp.where(acts, a / equation.gravity, 0) for a in accelerations)
        return c._replace(
            time=until,
            side=jnp.where(found, side, c.side),
            phase=jnp.where(found, RISING, REST),
            demand=larger(c.demand, largest(friction(push, 1 + lift))),
            normal=smaller(c.normal, -largest(-1 - lift)),
        )

    def moving(c: _Carry) -> _Carry:
        """From a cut to the next."""
        stop = stop_after(c.time)
        span = span_at(c)
        length = stop - c.time
        tau, y, which, demand, normal, fine = _solve(
            span,
            length,
            jnp.stack([c.lean, c.speed]),
            rtol,
            atol,
            (c.demand, c.normal),
            method,
        )
        # The forces just before an impact or at a turn are those of no step.
        last_horizontal, last_normal = span.forces(tau, y)
        rising = c.phase == RISING
        ended = which == 3
        time = jnp.where(ended, stop, c.time + tau)
        lean, speed = y[0], y[1]
        turned = which == 0
        crossing = rising & (which == 2)
        over = rising & (which == 1)
        landed = ~rising & (which == 1)
        speed = jnp.where(turned, 0, speed)
        lean = jnp.where(turned, jnp.maximum(lean, 0), lean)
        lean = jnp.where(crossing, equation.critical_angle, lean)
        lean = jnp.where(over, 0.5 * jnp.pi, lean)
        higher = lean > c.peak
        phase = jnp.where(turned, jnp.where(rising, FALLING, RISING), c.phase)
        phase = jnp.where(over, OVER, phase)

        # Impact: the block goes on to the other side with what restitution leaves.
        arriving = -speed
        leaving = jnp.where(landed, driven.restitution * arriving, 0)
        here = span_at(c._replace(time=time, side=-c.side, lean=jnp.zeros_like(lean)))
        onward = here.field(jnp.zeros_like(time), jnp.stack([jnp.zeros_like(time), leaving]))[1]
        held = onward < 0
        lost = (1 - driven.restitution) * jnp.where(held, -onward, 1)
        bounces = 2 * leaving * rate  # time that all further bounces take, times p and `lost`
        rests = landed & held & (bounces <= 1e-3 * rtol * lost)
        index = jnp.where(landed, c.impacts, listed)
        return c._replace(
            time=time,
            side=jnp.where(landed, -c.side, c.side),
            lean=jnp.where(landed, 0, lean),
            speed=jnp.where(rests, 0, jnp.where(landed, leaving, speed)),
            phase=jnp.where(landed, jnp.where(rests, REST, RISING), phase),
            impacts=jnp.where(landed, c.impacts + 1, c.impacts),
            peak=jnp.where(higher, lean, c.peak),
            peak_time=jnp.where(higher, time, c.peak_time),
            crossing=jnp.where(crossing, time, c.crossing),
            demand=larger(demand, friction(last_horizontal, last_normal)),
            normal=smaller(normal, last_normal),
            failed=c.failed | ~fine,
            impact_times=c.impact_times.at[index].set(time, mode="drop"),
            impact_velocities=c.impact_velocities.at[index].set(-c.side * arriving, mode="drop"),
        )

    def turn_first(c: _Carry) -> _Carry:
        """A state whose next move is not that of its phase, after an edge of the input."""
        rate = span_at(c).field(jnp.zeros_like(c.time), jnp.stack([c.lean, c.speed]))[1]
        still = c.speed == 0
        # One that has just been lifted stays so: its acceleration is 0, up to rounding.
        down = jnp.where(c.lean > 0, FALLING, jnp.where(c.phase == FALLING, REST, c.phase))
        phase = jnp.where(still & (rate < 0), down, c.phase)
        phase = jnp.where(still & (rate > 0), RISING, phase)
        return c._replace(phase=phase)

    def moving_or_at_rest(c: _Carry) -> _Carry:
        return jax.lax.cond(c.phase == REST, lambda c: c, moving, c)

    def step(c: _Carry) -> _Carry:
        before = c
        c = jax.lax.cond(c.phase == REST, at_rest, lambda c: moving_or_at_rest(turn_first(c)), c)
        c = with_corner(c, motion.acts(before.time))
        # The fate is read where the input ends.
        now = (before.time < input_end) & ((c.time >= input_end) | (c.phase == OVER))
        margin = smaller(*margins_of(equation, driven.restitution, c.lean, c.speed))
        fresh = _cuts_at(c)
        cuts = jax.tree.map(
            lambda kept, new: kept.at[c.count].set(new, mode="drop"), before.cuts, fresh
        )
        return c._replace(margin=jnp.where(now, margin, c.margin), count=c.count + 1, cuts=cuts)

    def goes_on(c: _Carry) -> Any:
        wanted = (c.impacts == 0) | (not once)
        going = (c.time < duration) & (c.phase != OVER) & wanted
        return going & ~c.failed & (c.count < _MAX_CUTS)

    # The initial state, on the side on which it leans or to which it moves.
    zero = jnp.zeros((), dtype)
    towards = jnp.where(driven.rotation == 0, driven.velocity, driven.rotation)
    side = jnp.where(towards < 0, -1, 1).astype(dtype)
    lean, speed = side * driven.rotation, side * driven.velocity
    phase = jnp.where(speed < 0, FALLING, RISING)
    phase = jnp.where((lean == 0) & (speed == 0), REST, phase)
    first = _Carry(
        time=zero,
        side=side,
        lean=lean,
        speed=speed,
        phase=jnp.where(lean >= 0.5 * jnp.pi, OVER, phase),
        count=jnp.zeros((), int),
        impacts=jnp.zeros((), int),
        peak=lean,
        peak_time=zero,
        crossing=jnp.where(lean >= equation.critical_angle, zero, jnp.nan),
        margin=smaller(*margins_of(equation, driven.restitution, lean, speed)),
        demand=zero,
        normal=zero + jnp.inf,
        failed=~valid,
        impact_times=jnp.full(listed, jnp.nan, dtype),
        impact_velocities=jnp.full(listed, jnp.nan, dtype),
        cuts=Cuts(*(jnp.full(4 * listed, jnp.nan, dtype),) * 4),
    )
    first = with_corner(first, jnp.zeros((), bool))
    cuts = jax.tree.map(lambda kept, new: kept.at[0].set(new), first.cuts, _cuts_at(first))
    last = jax.lax.while_loop(goes_on, step, first._replace(cuts=cuts, count=jnp.ones((), int)))

    broken = (last.failed & valid) | (last.count >= _MAX_CUTS)
    full = (last.impacts > listed) | (last.count > 4 * listed)
    status = jnp.where(broken, Status.STOPPED, jnp.where(full, Status.LIST_FULL, Status.COMPLETE))
    status = jnp.where(valid, status, Status.INVALID)
    good = valid & ~broken

    def known(value: Any) -> Any:
        return jnp.where(good, value, jnp.nan)

    overturned = good & ((last.phase == OVER) | (last.margin < 0))
    return Response(
        final_rotation=known(last.side * last.lean + 0.0),  # no negative zero
        final_velocity=known(last.side * last.speed + 0.0),
        peak_rotation=known(last.peak),
        peak_time=known(last.peak_time),
        overturned=overturned,
        overturning_time=jnp.where(overturned, last.crossing, jnp.nan),
        margin=known(last.margin),
        impacts=last.impacts,
        impact_times=last.impact_times,
        impact_velocities=last.impact_velocities,
        at_rest=good & (last.phase == REST),
        friction_demand=known(last.demand),
        normal_force=known(last.normal),
        status=status,
        cuts=last.cuts,
        scene=driven,
        linearized=linearized,
    )


def _cuts_at(c: _Carry) -> Cuts:
    return Cuts(c.time, c.side, c.lean, c.speed)


def _uplift(
    equation: Equation, motion: Motion, knots: Any, time: Any, stop: Any
) -> tuple[Any, Any, Any]:
    """Whether, when and to which side the input lifts a block that rests at `time`."""
    import optimistix

    def excess(t: Any, side: Any) -> Any:
        horizontal, vertical = motion.value(t)
        return equation.lifting(side * horizontal / equation.gravity, vertical / equation.gravity)

    sides = jnp.asarray([1.0, -1.0], knots.dtype)
    later = (knots > time) & (knots <= motion.end)
    at_knots = jax.vmap(lambda side: jax.vmap(lambda t: excess(t, side))(knots))(sides)
    lifted = (at_knots > 0).any(axis=0) & later
    found = lifted.any()
    index = jnp.argmax(lifted)
    side = jnp.where(at_knots[0, index] >= at_knots[1, index], 1, -1).astype(knots.dtype)
    upper = knots[index]
    lower = larger(time, knots[jnp.maximum(index - 1, 0)])
    now = jnp.stack([excess(time, s) for s in sides])
    at_once = (now > 0).any()
    bracketed = found & (excess(lower, side) < 0) & ~at_once
    eps = float(jnp.finfo(knots.dtype).eps)

    def beyond(share: Any, _: Any) -> Any:
        value = excess(lower + share * (upper - lower), side)
        return jnp.where(bracketed, value, share - 0.5)

    # Newton's method finds it only from nearby where the input is all but flat before.
    inside = {"lower": jnp.zeros_like(lower), "upper": jnp.ones_like(lower)}
    near = optimistix.root_find(
        beyond,
        optimistix.Bisection(rtol=0.0, atol=1e-3, flip=False),
        jnp.full_like(lower, 0.5),
        options=inside,
        throw=False,
    ).value
    share = optimistix.root_find(
        beyond,
        optimistix.Newton(rtol=4 * eps, atol=4 * eps),
        jax.lax.stop_gradient(near),
        options=inside,
        max_steps=64,
        throw=False,
    ).value
    root = lower + share * (upper - lower)
    when = jnp.where(bracketed, root, lower)
    when = jnp.where(at_once, time, when)
    side = jnp.where(at_once, jnp.where(now[0] >= now[1], sides[0], sides[1]), side)
    return (found | at_once) & (when < stop), when, side


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


def _padded(values: Reals, size: int, fill: float) -> np.ndarray:
    return np.pad(np.asarray(values), (0, size - values.size), constant_values=fill)


@eqx.filter_jit
def _history(scene: Driven, cuts: Cuts, linearized: bool, times: Reals) -> tuple[Reals, Reals]:
    """From the last cut before every time on."""
    equation = Equation.of(scene.block, linearized)
    known = jnp.where(jnp.isnan(cuts.time), jnp.inf, cuts.time)
    eps = float(jnp.finfo(times.dtype).eps)

    def at(asked: Any) -> Any:
        inside = (asked >= 0) & (asked <= scene.duration)
        time = jnp.where(inside, asked, 0)
        index = jnp.maximum(jnp.searchsorted(known, time, side="right") - 1, 0)
        origin, side, lean, speed = (part[index] for part in jax.tree.leaves(cuts))
        acts = scene.motion.acts(origin)
        moves = (lean != 0) | (speed != 0)
        # What has just been lifted is on the ground as well: it moves if the next cut is a turn.
        following = cuts.lean[jnp.minimum(index + 1, known.size - 1)]
        moves = (moves | (following > 0)) & (lean < 0.5 * jnp.pi) & (time > origin)
        span = _Span(
            equation, scene.motion, origin, side, acts, jnp.array(True), jnp.array(True), time
        )
        length = jnp.where(moves, time - origin, 1e-3 / jnp.sqrt(equation.square))
        y = jnp.stack([lean, speed])
        # Every time is beyond the grace: nothing ends this span.
        _, there, *_ = _solve(
            eqx.tree_at(lambda s: s.grace, span, jnp.full_like(time, jnp.inf)),
            length,
            y,
            max(1e-9, 100 * eps),
            0.0,
            (jnp.full_like(time, jnp.inf), jnp.full_like(time, -jnp.inf)),  # of no interest
        )
        there = side * jnp.where(moves, there, y)
        return tuple(jnp.where(inside, part + 0.0, jnp.nan) for part in there)

    return jax.vmap(at)(times)


@eqx.filter_jit
def compiled(
    driven: Driven, rtol: Any, atol: Any, linearized: bool, listed: int, method: Method = _DEFAULT
) -> Response:
    """`follow`, compiled once for all tolerances."""
    return follow(driven, rtol=rtol, atol=atol, linearized=linearized, listed=listed, method=method)


@contextlib.contextmanager
def _unchecked() -> Iterator[None]:
    """Without JAX's checks of a NaN, which here stands for none, and of equinox's caches."""
    with contextlib.ExitStack() as stack:
        # Only where they are on: a setting of its own compiles anew.
        if jax.config.jax_debug_nans:
            stack.enter_context(jax.debug_nans(False))
        if jax.config.jax_check_tracer_leaks:
            stack.enter_context(jax.check_tracer_leaks(False))
        yield


def respond(
    block: Block,
    restitution: Number,
    motion: Motion,
    duration: Number | None = None,
    *,
    rotation: Number = 0.0,
    velocity: Number = 0.0,
    rtol: float | None = None,
    atol: float | None = None,
    solver: str = "Tsit5",
    linearized: bool = False,
    listed: int = 4096,
) -> Response:
    """Response of one block to a ground motion, through every impact.

    Parameters
    ----------
    block : Block
        One block; `respond_batch` and `jax.vmap` take many.
    restitution : float
        C, velocity after an impact over velocity before it [-], between 0 and 1.
    motion : Motion
        A pulse or a `Record`.
    duration : float, optional
        Time to follow the block for [s], greater than 0. To the end of the motion unless
        given.
    rotation, velocity : float, optional
        Initial rotation [rad] and angular velocity [rad/s]; at rest by default.
    rtol, atol : float, optional
        Tolerances of each integration step, relative, and absolute in rad and rad/s. By
        default 1e-8 (1e-5 in float32), and 1e-9 of the relative one: small bounces are
        followed as exactly as large ones.
    solver : str
        Name of diffrax's solver: "Tsit5", "Dopri5", "Dopri8", "Bosh3" or "Heun". On records,
        where steps end at every sample, "Dopri8" with a loose `rtol` is more exact.
    linearized : bool
        Linearize the equation of motion, in the form of the literature (``ground / g``
        instead of ``ground cos(alpha_c) / g``).
    listed : int
        Most impacts whose time and velocity are kept under `jit`, `vmap` and derivatives.
        Outside of them all are.

    Returns
    -------
    Response

    Raises
    ------
    ValueError
        If a concrete argument is outside of what is allowed or not scalar, or if the
        precision cannot deliver the tolerance. Traced values outside give NaN and
        `Status.INVALID`.

    Notes
    -----
    Eq. 1, by diffrax; each impact is reached by a step of its own, which ends there.
    Derivatives, in both modes, cost one forward derivative a perturbed number. Where two of
    the end of the input, its start, a sample, an impact and the duration coincide, answers
    may have another slope on either side. Given is that for a duration not longer, and an end
    of the input not earlier, than the other; for a start not earlier than 0; for a sample the
    same on both sides; and for an impact at the start, at the end or at the duration that of
    either order of the two, for all numbers the same one.
    Extremes have the derivative of the moment in which they are taken, the first of equal ones.

    NaN stands for none, and diffrax keeps what it traced: a call outside of transformations
    switches off `jax.debug_nans` and `jax.checking_leaks` for its time. Inside of `jit` they
    report both, and have to be off.

    Examples
    --------
    >>> import jaxrock as jr
    >>> block = jr.Block(half_width=0.2, slenderness=5.0)
    >>> pulse = jr.Sine(amplitude=2.5, duration=0.8)
    >>> response = jr.respond(block, 0.9, pulse, duration=5.0, rtol=1e-5)
    >>> print(bool(response.overturned), int(response.status))
    False 0
    """
    for name, value, kind in (("block", block, Block), ("motion", motion, Motion)):
        if not isinstance(value, kind):
            raise ValueError(f"{name} must be a {kind.__name__}, got {value!r:.60}")
    given = {
        "restitution": (restitution, UNIT_INTERVAL),
        "duration": (motion.end if duration is None else duration, POSITIVE),
        "rotation": (rotation, FINITE),
        "velocity": (velocity, FINITE),
    }
    numbers = {}
    for name, (value, domain) in given.items():
        numbers[name] = as_real(name, value)
        check(name, numbers[name], domain)
    block.check()
    motion.check()
    driven = of_one_precision(Driven(block=block, motion=motion, **numbers))
    dtype = driven.restitution.dtype
    scalars: dict[str, Any] = {"block": block, "motion": (motion.end, motion.intensity)}
    for name, leaf in (scalars | numbers).items():
        if any(jnp.ndim(part) for part in jax.tree.leaves(leaf)):
            raise ValueError(f"{name} must be scalar here; respond_batch takes arrays")
    eps = float(jnp.finfo(dtype).eps)
    rtol = (1e-8 if dtype == np.float64 else 1e-5) if rtol is None else float(rtol)
    atol = 1e-9 * rtol if atol is None else float(atol)
    if not 20 * eps <= rtol < 1:
        raise ValueError(
            f"rtol must be less than 1 and at least {20 * eps:.1g}, which is what {dtype}"
            f" can deliver, got {rtol:g}"
        )
    if not 0 <= atol < 1:
        raise ValueError(f"atol must be at least 0 and less than 1, got {atol:g}")
    if solver not in SOLVERS:
        raise ValueError(f"solver must be one of {', '.join(SOLVERS)}, got {solver!r}")
    if listed < 1:
        raise ValueError(f"listed must be at least 1, got {listed}")
    tolerances = jnp.asarray(rtol, dtype), jnp.asarray(atol, dtype)
    method = Method(solver)
    with _unchecked():
        response = compiled(driven, *tolerances, linearized, listed, method)
        if isinstance(response.status, jax.core.Tracer):
            return response
        while response.status == Status.LIST_FULL:
            listed *= 8
            response = compiled(driven, *tolerances, linearized, listed, method)
    count = int(response.impacts)
    return eqx.tree_at(
        lambda r: (r.impact_times, r.impact_velocities),
        response,
        (response.impact_times[:count], response.impact_velocities[:count]),
    )
