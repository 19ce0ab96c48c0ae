"""The pulses of finite duration that just overturn in resonance."""

import math
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from ..block import Block
from ..ground_motion import Pulse, pulse_class
from ..host import listed, with_clock
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import Booleans, Number, Reals
from .equation import Equation, uplift_acceleration
from .fixed_points import Solved, solved
from .steady_state import Parts, PulsedPhase, checked, half_cycle, phase_of, tolerance_of

_STEP = 0.2  # of the amplitude's logarithm, on the way up
_HIGHEST = 60.0  # how far up
_NARROWING = 100  # evaluations
_BELOW = 1e-6  # the verge, where it is asked what pulses do from rest
_NEAR = 1e-3  # how close the block lands there to where it should, in critical velocities


class PulsedThreshold(NamedTuple):
    """Where the stabilized phase under pulses that last ends; NaN where that is not so.

    Attributes
    ----------
    amplitude, intensity : Array
        Of the pulses [m/s2], [m/s].
    rate : Array
        Slope of the half-cycle map there.
    lifts : Array of bool
        Whether pulses of that amplitude lift the block from rest. If not, it has to be in
        motion to be kept in motion.
    from_rest : Array of bool
        Whether pulses a little weaker (by 1e-6) lead to that fixed point from rest. If not,
        they do not lift the block, or its motion dies out; or they overturn it, and so do
        weaker ones: a one-sine pulse can overturn a block at rest and keep one in motion
        that it meets at the right speed.
    """

    amplitude: Reals
    intensity: Reals
    rate: Reals
    lifts: Booleans
    from_rest: Booleans

    def __str__(self) -> str:
        units = {"amplitude": "m/s2", "intensity": "m/s"}
        return listed(self, **dict.fromkeys(self._fields, "") | units)


@with_clock("critical amplitude of pulses")
def critical_pulsed_amplitude(
    block: Block,
    restitution: Number,
    shape: type[Pulse],
    duration: Number,
    *,
    model: ModelLike = Nonlinear(),
    rtol: float = 1e-10,
) -> PulsedThreshold:
    """Amplitude at which the fixed point of `pulsed_next_velocity` disappears.

    There a block that lands with the critical velocity is brought to the verge again by the
    next pulse. For short pulses its intensity is that of `critical_intensity`.

    Parameters
    ----------
    block, restitution, model, rtol
        As in `pulsed_next_velocity`.
    shape : type
        `Rectangular`, `HalfSine`, `Sine`, `Cosine` or `Ricker`.
    duration : float
        Duration of the pulses [s], greater than 0.

    Returns
    -------
    PulsedThreshold
        NaN where the fixed point is unstable there. With a rate above 1, under long pulses,
        it disappears before, by meeting another one; with one below -1 half-cycles alternate
        before. NaN also where no amplitude brings the block to the verge: one that loses most
        of its velocity at impacts is caught by long pulses or not, and overturns at once.

    Raises
    ------
    ValueError
        If `shape` is no class of pulses, or a concrete argument is out of range.
    """
    pulse = pulse_class(shape)(1.0, duration)
    block, restitution, pulse, _ = checked(block, restitution, pulse, 0.0, rtol)
    model = as_model(model)
    verge, weaker, expected = _verge(block, restitution, pulse, model, rtol)
    # Only asked whether, so that no derivative of the orbit is computed; and apart, since that
    # program is likely to be compiled already.
    fixed = jax.lax.stop_gradient((block, restitution, weaker))
    phase = phase_of(*fixed, model, max(rtol, 1e-9))
    there = _leads_there(*jax.lax.stop_gradient((block, phase, expected)), model)
    return verge._replace(from_rest=verge.from_rest & there)


class _Try(NamedTuple):
    """A block that lands with the critical velocity, under the next pulse."""

    margin: Reals  # what is left to the verge when the pulse ends, in critical velocities
    slope: Reals  # of that, with respect to the logarithm of the amplitude
    speed: Reals  # when the pulse ends
    lands: Booleans  # while the pulse acts: there is no such margin

    @property
    def falls(self) -> Booleans:
        return ~self.lands & ~(self.margin >= 0)

    @property
    def move(self) -> Reals:
        """Newton's step to the verge."""
        known = ~self.lands & (self.slope != 0)
        return jnp.where(known, -self.margin / jnp.where(known, self.slope, 1), jnp.inf)


class _Search(NamedTuple):
    count: Any  # of evaluations, and then of those since there is a bracket
    trial: Reals
    low: Reals
    high: Reals
    last: _Try
    bracketed: Booleans
    goes_on: Booleans
    found: Booleans
    rate: Reals  # of the half-cycle map at the verge: the last evaluation is for that


def _left(
    parts: Parts, direction: Any, logarithm: Reals, model: RockingModel, rtol: float
) -> tuple[Reals, Reals, tuple[Reals, Booleans]]:
    """What is left to the verge when the pulse ends, and its slope.

    In a direction of the logarithm of the amplitude and of the velocity.
    """
    block, restitution, pulse = parts
    equation = Equation.of(block, model)

    def left(logarithm: Reals, velocity: Reals) -> tuple[Reals, tuple[Reals, Booleans]]:
        stronger = pulse.scaled(jnp.exp(logarithm))
        end = half_cycle((block, restitution, stronger), velocity, 0.0, model, rtol)
        side = jnp.where(end.rotation < 0, -1, 1)
        speed = side * end.velocity
        back = equation.returning_speed(side * end.rotation)
        return (back - speed) / equation.critical_velocity, (speed, end.impacts > 0)

    at = (logarithm, equation.critical_velocity)
    return jax.jvp(left, at, tuple(direction), has_aux=True)


def _at_verge(
    parts: Parts, logarithm: Reals, model: RockingModel, rtol: float
) -> tuple[Reals, tuple[Reals, ...]]:
    """What is 0 on the verge, and what is answered there: the rate of the half-cycle map."""
    along_velocity = jnp.zeros_like(logarithm), jnp.ones_like(logarithm)
    margin, slope, (speed, _) = _left(parts, along_velocity, logarithm, model, rtol)
    # It lands with sqrt(v_c^2 + v^2 - D^2), and on the verge its velocity v is D.
    return margin, (-speed * slope,)


def _search_verge(parts: Parts, model: RockingModel, rtol: float) -> Solved:
    """Up from next to nothing until it overturns, and back to the verge."""
    block, _, pulse = parts
    eps = float(jnp.finfo(pulse.amplitude.dtype).eps)
    tolerance = tolerance_of(pulse.amplitude, rtol)
    first = jnp.log(uplift_acceleration(block, model)) + 0.4 * math.log(eps)

    def step(c: _Search) -> _Search:
        along = jnp.where(c.found, 0, one), jnp.where(c.found, one, 0)
        margin, slope, (speed, lands) = _left(parts, along, c.trial, model, rtol)
        new = _Try(margin, slope, speed, lands)
        bracketed = c.bracketed | new.falls
        low = jnp.where(new.falls, c.low, c.trial)
        high = jnp.where(new.falls, c.trial, c.high)
        newton = c.trial + new.move
        inside = (newton > low) & (newton < high) & (c.count % 3 != 2)
        inner = jnp.where(inside, newton, 0.5 * (low + high))
        stuck = (jnp.abs(new.move) <= 1e3 * tolerance) & (
            jnp.abs(new.move) >= 0.5 * jnp.abs(c.last.move)
        )
        found = bracketed & ((jnp.abs(new.move) <= tolerance) | stuck)
        # Where the block begins to be caught before it lands, it may overturn at once: there
        # is no verge in between.
        narrow = high - low <= 4 * eps * jnp.abs(high)
        nowhere = jnp.where(
            bracketed,
            narrow | (c.count >= _NARROWING) | ~jnp.isfinite(low),
            c.trial > first + _HIGHEST,
        )
        following = _Search(
            count=jnp.where(c.bracketed, c.count + 1, 0),
            trial=jnp.where(found, c.trial, jnp.where(bracketed, inner, c.trial + _STEP)),
            low=low,
            high=high,
            last=new,
            bracketed=bracketed,
            goes_on=found | ~nowhere,
            found=found,
            rate=c.rate,
        )
        done = c._replace(goes_on=no, rate=-speed * slope)
        return jax.tree.map(lambda a, b: jnp.where(c.found, a, b), done, following)

    no, yes = jnp.zeros((), bool), jnp.ones((), bool)
    zero, one = jnp.zeros_like(first), jnp.ones_like(first)
    begin = _Search(
        count=jnp.zeros((), int),
        trial=first,
        low=zero - jnp.inf,
        high=zero + jnp.inf,
        last=_Try(zero, zero, zero, yes),
        bracketed=no,
        goes_on=yes,
        found=no,
        rate=zero,
    )
    last = jax.lax.while_loop(lambda c: c.goes_on, step, begin)
    found, verge = last.found, last.last
    root, rate = (jnp.where(found, x, 0) for x in (last.trial, last.rate))
    # Of the map, by the logarithm of the amplitude: see what is said of its rate.
    gain = jnp.where(found, -verge.speed * verge.slope, 0)
    return Solved(root, (rate,), found, (gain,))


_verge_of = solved(_search_verge, _at_verge)


@eqx.filter_jit
def _verge(
    block: Block, restitution: Reals, pulse: Pulse, model: RockingModel, rtol: float
) -> tuple[PulsedThreshold, Pulse, Reals]:
    """The verge, pulses a little weaker, and with what velocity the block should land then."""
    found = _verge_of((block, restitution, pulse), model=model, rtol=rtol)
    (rate,), (gain,) = found.answers, found.flags
    amplitude = jnp.exp(found.root)
    known = found.there & (jnp.abs(rate) <= 1)
    # As factors: what does not exist has no slope either.
    exists, there = (jnp.where(flag, 1.0, jnp.nan) for flag in (known, found.there))
    verge = PulsedThreshold(
        amplitude=exists * amplitude,
        intensity=exists * pulse.scaled(amplitude).intensity,
        rate=there * rate,
        lifts=known & (amplitude > uplift_acceleration(block, model)),
        from_rest=known,
    )
    weaker = pulse.scaled(jnp.where(known, amplitude, 1) * (1 - _BELOW))
    critical = Equation.of(block, model).critical_velocity
    # Of a cosine the amplitude says little, so that a little less of it is far from the verge.
    expected = critical - _BELOW * gain / jnp.where(rate < 1, 1 - rate, 1)
    return verge, weaker, expected


@eqx.filter_jit
def _leads_there(
    block: Block, phase: PulsedPhase, expected: Reals, model: RockingModel
) -> Booleans:
    critical = Equation.of(block, model).critical_velocity
    off = jnp.abs(phase.velocity - expected)
    near = off <= _NEAR * critical + 0.5 * jnp.abs(critical - expected)
    return phase.stands & phase.from_rest & near
