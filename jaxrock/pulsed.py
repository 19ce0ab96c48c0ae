"""Rocking resonance under pulses that last: the half-cycle map through the driven equation.

The input is that of the paper, except that a pulse, starting right after each impact, takes
its time. One that still acts at the next impact ends there.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from .arguments import (
    NON_NEGATIVE,
    UNIT_INTERVAL,
    Booleans,
    Number,
    Reals,
    as_real,
    check,
    of_one_precision,
)
from .block import Block
from .free import Linearized, Nonlinear
from .motion import Pulse, pulse_class
from .printing import listed
from .progress import with_clock
from .response import Driven, Response, Status, follow

_LONGEST = 200.0  # time to wait for an impact, times p
_ITERATIONS = 30


class PulsedPhase(NamedTuple):
    """The stabilized phase under pulses that last; NaN where there is none.

    Attributes
    ----------
    velocity : Array
        v*, with which the block lands [rad/s]; for short pulses the launch velocity.
    rate : Array
        Slope of the map there: what is left of a deviation after each half-cycle.
    period : Array
        T*, two half-cycles [s].
    peak_rotation, rotation_ratio : Array
        alpha*_max [rad], and over the critical angle.
    stands : Array of bool
        Whether there is a stabilized phase.
    """

    velocity: Reals
    rate: Reals
    period: Reals
    peak_rotation: Reals
    rotation_ratio: Reals
    stands: Booleans

    def __str__(self) -> str:
        units = {"velocity": "rad/s", "period": "s", "peak_rotation": "rad"}
        return listed(self, **dict.fromkeys(self._fields, "") | units)


def pulsed_next_velocity(
    block: Block,
    restitution: Number,
    pulse: Pulse,
    velocity: Number,
    *,
    linearized: bool = False,
    rtol: float = 1e-9,
) -> Reals:
    """The half-cycle map: one landing velocity to the next.

    Parameters
    ----------
    block : Block
        One block.
    restitution : float
        C [-], between 0 and 1.
    pulse : Pulse
        What acts from each impact on, outward.
    velocity : float
        Angular velocity just before the impact [rad/s], at least 0.
    linearized : bool
        Linearize the equation of motion; see `respond`.
    rtol : float
        Tolerance of the integration, at most 0.001.

    Returns
    -------
    Array
        Angular velocity just before the next impact [rad/s]; 0 where the block stays at
        rest, NaN where it overturns.

    Raises
    ------
    ValueError
        If an argument is not scalar, or a concrete one is out of range.
    """
    block, restitution, pulse, velocity = _checked(block, restitution, pulse, velocity, rtol)
    return _next(block, restitution, pulse, velocity, linearized, rtol)


@with_clock("pulsed phase")
def pulsed_phase(
    block: Block,
    restitution: Number,
    pulse: Pulse,
    *,
    linearized: bool = False,
    rtol: float = 1e-9,
) -> PulsedPhase:
    """The stabilized phase under pulses that last: the fixed point of `pulsed_next_velocity`.

    Reached from rest. As the duration of the pulse goes to 0 at the same intensity it
    becomes that of `Nonlinear` in proportion to the duration.

    Parameters
    ----------
    block, restitution, pulse, linearized, rtol
        As in `pulsed_next_velocity`.

    Returns
    -------
    PulsedPhase

    Raises
    ------
    ValueError
        As there.
    """
    block, restitution, pulse, _ = _checked(block, restitution, pulse, 0.0, rtol)
    return _phase(block, restitution, pulse, linearized, rtol)


class PulsedVerge(NamedTuple):
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
    """

    amplitude: Reals
    intensity: Reals
    rate: Reals
    lifts: Booleans

    def __str__(self) -> str:
        return listed(self, amplitude="m/s2", intensity="m/s", rate="", lifts="")


@with_clock("critical amplitude of pulses")
def critical_pulsed_amplitude(
    block: Block,
    restitution: Number,
    shape: type[Pulse],
    duration: Number,
    *,
    linearized: bool = False,
    rtol: float = 1e-10,
) -> PulsedVerge:
    """Amplitude at which the fixed point of `pulsed_next_velocity` disappears.

    There a block that lands with the critical velocity is brought to the verge again by the
    next pulse. For short pulses its intensity is that of `critical_intensity`.

    Parameters
    ----------
    block, restitution, linearized, rtol
        As in `pulsed_next_velocity`.
    shape : type
        `Rectangular`, `HalfSine`, `Sine`, `Cosine` or `Ricker`.
    duration : float
        Duration of the pulses [s], greater than 0.

    Returns
    -------
    PulsedVerge
        NaN for pulses so long that the fixed point is unstable there (its rate above 1):
        then it disappears before, by meeting another one.

    Raises
    ------
    ValueError
        If `shape` is no class of pulses, or a concrete argument is out of range.
    """
    pulse = pulse_class(shape)(1.0, duration)
    block, restitution, pulse, _ = _checked(block, restitution, pulse, 0.0, rtol)
    return _verge(block, restitution, pulse, linearized, rtol)


@eqx.filter_jit
def _verge(
    block: Block, restitution: Reals, pulse: Pulse, linearized: bool, rtol: float
) -> PulsedVerge:
    import optimistix

    eps = float(jnp.finfo(restitution.dtype).eps)
    tolerance = max(rtol, 20 * eps)
    model = Linearized() if linearized else Nonlinear()

    def left(logarithm: Reals, parts: tuple[Block, Reals, Pulse]) -> Reals:
        block, restitution, pulse = parts
        critical = model.critical_velocity(block)
        pulse = pulse.scaled(jnp.exp(logarithm))
        driven = Driven(
            block=block,
            restitution=restitution,
            motion=pulse,
            duration=pulse.end,
            rotation=jnp.zeros_like(critical),
            velocity=restitution * critical,
        )
        return follow(
            driven, rtol=tolerance, atol=0.0, linearized=linearized, listed=1, once=True
        ).margin

    parts = (block, restitution, pulse)
    fixed = jax.lax.stop_gradient(parts)
    tangent = block.critical_angle if linearized else 1 / block.slenderness
    lifting = block.gravity * tangent
    # Up from next to nothing until it overturns.
    first = jax.lax.stop_gradient(jnp.log(lifting) + 4 * jnp.log(eps) / 10)
    high = jax.lax.while_loop(
        lambda high: (left(high, fixed) > 0) & (high < first + 60),
        lambda high: high + 0.2,
        first,
    )
    exists = jnp.isfinite(high) & (high < first + 60)
    high = jnp.where(exists, high, 0)
    near = optimistix.root_find(
        lambda a, p: jnp.where(exists, left(a, p), -a),
        optimistix.Bisection(rtol=0.0, atol=1e-6, flip=True),
        high - 0.1,
        fixed,
        options={"lower": high - 0.2, "upper": high},
        throw=False,
    ).value
    logarithm = optimistix.root_find(
        lambda a, p: jnp.where(exists, left(a, p), -a),
        optimistix.Newton(rtol=tolerance, atol=tolerance),
        jax.lax.stop_gradient(jnp.where(exists, near, 0)),
        parts,
        throw=False,
    ).value
    amplitude = jnp.exp(logarithm)
    # The slope a little below, where the block still comes back.
    critical = model.critical_velocity(block)
    weaker = pulse.scaled(jax.lax.stop_gradient(amplitude) * (1 - 1e-4))
    _, rate = jax.jvp(
        lambda v: _next(block, restitution, weaker, v, linearized, rtol),
        (critical * (1 - 1e-4),),
        (jnp.ones_like(critical),),
    )
    known = exists & (rate <= 1)
    return PulsedVerge(
        jnp.where(known, amplitude, jnp.nan),
        jnp.where(known, pulse.scaled(amplitude).intensity, jnp.nan),
        jnp.where(exists, rate, jnp.nan),
        known & (amplitude > lifting),
    )


def _checked(
    block: Block, restitution: Number, pulse: Pulse, velocity: Number, rtol: float
) -> tuple[Block, Reals, Pulse, Reals]:
    if not isinstance(pulse, Pulse):
        raise ValueError(f"pulse must be a Pulse, got a {type(pulse).__name__}")
    if not 0 < rtol <= 1e-3:
        raise ValueError(f"rtol must be greater than 0 and at most 0.001, got {rtol:g}")
    restitution, velocity = as_real("restitution", restitution), as_real("velocity", velocity)
    check("restitution", restitution, UNIT_INTERVAL)
    check("velocity", velocity, NON_NEGATIVE)
    block.check()
    pulse.check()
    parts = (block, restitution, pulse, velocity)
    for leaf in jax.tree.leaves(parts):
        if leaf.ndim:
            raise ValueError(f"arguments must be scalar, got an array of shape {leaf.shape}")
    return of_one_precision(parts)


def _half_cycle(
    block: Block, restitution: Reals, pulse: Pulse, velocity: Reals, linearized: bool, rtol: float
) -> Response:
    pulse = eqx.tree_at(lambda p: p.start, pulse, jnp.zeros_like(velocity))
    duration = pulse.end + _LONGEST / block.frequency_parameter
    driven = Driven(
        block=block,
        restitution=restitution,
        motion=pulse,
        duration=duration,
        rotation=jnp.zeros_like(velocity),
        velocity=restitution * velocity,
    )
    rtol = max(rtol, 20 * float(jnp.finfo(velocity.dtype).eps))
    return follow(driven, rtol=rtol, atol=1e-9 * rtol, linearized=linearized, listed=1, once=True)


@eqx.filter_jit
def _next(
    block: Block, restitution: Reals, pulse: Pulse, velocity: Reals, linearized: bool, rtol: float
) -> Reals:
    response = _half_cycle(block, restitution, pulse, velocity, linearized, rtol)
    landed = response.impacts > 0
    landing = jnp.abs(jnp.where(landed, response.impact_velocities[0], 1))
    still = (response.status <= Status.LIST_FULL) & response.at_rest
    return jnp.where(landed, landing, jnp.where(still, 0, jnp.nan))


@eqx.filter_jit
def _phase(
    block: Block, restitution: Reals, pulse: Pulse, linearized: bool, rtol: float
) -> PulsedPhase:
    import optimistix

    def after(velocity: Reals, parts: tuple[Block, Reals, Pulse]) -> Reals:
        return _next(*parts, velocity, linearized, rtol)

    parts = (block, restitution, pulse)
    fixed = jax.lax.stop_gradient(parts)
    nothing = jnp.zeros_like(restitution)
    before, near = jax.lax.fori_loop(
        0, _ITERATIONS, lambda _, last: (last[1], after(last[1], fixed)), (nothing, nothing)
    )
    critical = (Linearized() if linearized else Nonlinear()).critical_velocity(block)
    # With a restitution close to 1 it is still far away: on as if the map were linear.
    gain = near - before
    limit = jnp.minimum(before + gain / jnp.maximum(1 - restitution, 1e-6), 0.98 * critical)
    near = jax.lax.stop_gradient(jnp.where(gain > 1e-3 * near, limit, near))
    tolerance = max(rtol, 20 * float(jnp.finfo(near.dtype).eps))
    reached = jnp.isfinite(near)
    solution = optimistix.root_find(
        lambda v, p: jnp.where(reached, after(v, p) - v, v),
        optimistix.Newton(rtol=tolerance, atol=tolerance * 1e-3),
        jnp.where(reached, near, 0),
        parts,
        throw=False,
        max_steps=50,
    )
    velocity = solution.value
    landing, rate = jax.jvp(lambda v: after(v, parts), (velocity,), (jnp.ones_like(velocity),))
    close = jnp.abs(landing - velocity) <= 1e3 * tolerance * critical
    stands = reached & close & (jnp.abs(rate) <= 1)
    response = _half_cycle(*parts, velocity, linearized, rtol)
    moves = response.impacts > 0
    period = 2 * jnp.where(moves, response.impact_times[0], 0)
    answers = (velocity, rate, period, response.peak_rotation)
    ratio = response.peak_rotation / block.critical_angle
    velocity, rate, period, peak, ratio = (
        jnp.where(stands, answer, jnp.nan) for answer in (*answers, ratio)
    )
    return PulsedPhase(velocity, rate, period, peak, ratio, stands)
