"""One side, one direction: the motion between two cuts, and steps through it.

A *span* goes from a cut to the next. Its time is counted from where it begins, so that the
smallest bounce keeps all its digits.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from ..ground_motion import Motion
from ..validation import Booleans, Reals
from .equation import Equation

TURNS, TOPS, CROSSES, LASTS = range(4)  # how a span ends; the last: with its time


class Method(NamedTuple):
    """How the equation is integrated: what `measure_tradeoff` compares with the default."""

    solver: str = "Tsit5"  # of diffrax
    # Where a span ends: "step", by a last step of its own; "interpolant", on that of the
    # solver; "end", at the end of the step in which it does.
    locate: str = "step"


DEFAULT = Method()


class Span(eqx.Module):
    """The equation of motion on one side, in a time counted from `origin`."""

    equation: Equation
    motion: Motion
    origin: Reals
    side: Reals
    acts: Booleans  # whether the input does

    def ground(self, time: Reals) -> tuple[Reals, Reals]:
        """Acceleration over g, towards the side of the block and upward."""
        return _ground(self, time)

    def field(self, time: Reals, y: Reals) -> Reals:
        """Rates of lean and speed."""
        return _field(self, time, y)


# Each is traced, and part of the program, once for a shape, however often it is called.
@jax.jit
def _ground(span: Span, time: Reals) -> tuple[Reals, Reals]:
    horizontal, vertical = span.motion.value(span.origin + time)
    over_g = jnp.where(span.acts, 1 / span.equation.gravity, 0)
    return span.side * horizontal * over_g, vertical * over_g


@jax.jit
def _field(span: Span, time: Reals, y: Reals) -> Reals:
    return jnp.stack([y[1], span.equation.acceleration(y[0], *_ground(span, time))])


class Limits(NamedTuple):
    """What is positive until a span ends, for each way it can end: linear in the state."""

    constant: Reals
    of_lean: Reals
    of_speed: Reals

    @classmethod
    def of(cls, equation: Equation, rising: Booleans, crossed: Booleans) -> "Limits":
        """Those of a rising or falling block, which may be beyond the critical angle."""
        unit = 1 / equation.critical_angle
        up, none = jnp.where(rising, unit, -unit), jnp.zeros_like(unit)
        crosses = rising & ~crossed
        return cls(
            constant=jnp.stack(
                [none, jnp.where(rising, 0.5 * jnp.pi * unit, 0), jnp.where(crosses, 1, jnp.inf)]
            ),
            of_lean=jnp.stack([none, -up, jnp.where(crosses, -unit, 0)]),
            of_speed=jnp.stack([up / jnp.sqrt(equation.square), none, none]),
        )

    def left(self, y: Reals) -> Reals:
        """What is left."""
        return self.constant + self.rate(y)

    def rate(self, change: Reals) -> Reals:
        """How fast it changes with the state."""
        return self.of_lean * change[0] + self.of_speed * change[1]


class Step(NamedTuple):
    """A step that was tried, and what follows from it."""

    there: Reals  # the state at its end
    good: Booleans  # whether it is exact enough
    following: Reals  # length of the next one, or of this one again
    between: Any  # what the solver knows of the states between
    memory: Any  # of the solver, for the next step


class Stepper:
    """Diffrax's solver and step-size control, one step at a time."""

    def __init__(self, method: Method, rtol: Any, atol: Any):
        import diffrax  # which loads slowly

        # Of the ways to run over the stages, the one that has a forward derivative.
        self.solver = getattr(diffrax, method.solver)(scan_kind="lax")
        self.term = diffrax.ODETerm(lambda t, y, span: span.field(t, y))
        self.controller = diffrax.PIDController(rtol=rtol, atol=atol)
        self.order = self.solver.error_order(self.term)

    def memory(self, span: Span, y: Reals) -> Any:
        """Of the solver, before the first step of a span."""
        zero = jnp.zeros_like(y[0])
        return self.solver.init(self.term, zero, zero + 1, y, span)

    def step(self, span: Span, begin: Reals, until: Reals, y: Reals, memory: Any) -> Step:
        """From one time to another."""
        there, error, between, memory, _ = self.solver.step(
            self.term, begin, until, y, span, memory, made_jump=False
        )
        one = jnp.ones_like(begin)
        # The length of a step has no derivative.
        done = jax.lax.stop_gradient((begin, until, y, there, None, error))
        good, start, end, *_ = self.controller.adapt_step_size(
            *done, self.order, (one, one, jnp.array(False))
        )
        return Step(there, jnp.asarray(good), jnp.asarray(end - start), between, memory)

    def between(self, begin: Reals, until: Reals, step: Step, time: Reals) -> Reals:
        """The state at a time within a step."""
        interpolation = self.solver.interpolation_cls(t0=begin, t1=until, **step.between)
        return interpolation.evaluate(time)


def close_to(motion: Motion, time: Reals) -> Reals:
    """Up to which a time coincides with a corner of the motion, rounded as the corner is."""
    return 16 * float(jnp.finfo(time.dtype).eps) * (time + motion.end)


@jax.jit
def limited(span: Span, length: Reals, start: Reals, end: Reals, y: Reals, rate: Reals) -> Reals:
    """The end of a step: at every kink and at the end of the span, and over at most one turn."""
    start, end, y, rate = jax.lax.stop_gradient((start, end, y, rate))
    slowing = y[1] * rate < 0
    brake = 2 * jnp.abs(y[1] / jnp.where(slowing, rate, 1))
    end = jnp.where(slowing, jnp.minimum(end, start + brake), end)
    kink = span.motion.next_kink(span.origin + start) - span.origin
    last = length - close_to(span.motion, span.origin + length)
    stop = jnp.where((kink > start) & (kink < last), kink, length)
    # A step that ends at a kink goes with it: the slope of the input on this side of the kink
    # and on that must not both count there.
    return jnp.where(stop <= end, stop, end)


def first_step(span: Span, length: Reals, y: Reals, lifted: Any) -> Reals:
    """The end of the first step: a quarter of the arc, or what leaves the acceleration its sign.

    Of a block that has just been lifted it has none, up to rounding.
    """
    zero, whole, last = jnp.zeros_like(length), span, length
    span, length, y = jax.lax.stop_gradient((span, length, y))
    step = jnp.minimum(length, 0.05 / jnp.sqrt(span.equation.square))
    kink = span.motion.next_kink(span.origin) - span.origin
    step = jnp.where(kink > 0, jnp.minimum(step, kink), step)
    times, states = jnp.stack([zero, step]), jnp.stack([y, y], axis=1)
    here, there = span.field(times, states)[1]
    flips = (here * there < 0) & ~lifted
    share = here / jnp.where(flips, here - there, 1)
    step = jnp.where(flips, 0.5 * share * step, step)
    strongest = jnp.maximum(jnp.abs(here), jnp.abs(there))
    quarter = 0.5 * jnp.abs(y[1]) / jnp.where(strongest > 0, strongest, 1)
    step = jnp.where((strongest > 0) & (quarter > 0), jnp.minimum(step, quarter), step)
    return limited(whole, last, zero, step, y, here)
