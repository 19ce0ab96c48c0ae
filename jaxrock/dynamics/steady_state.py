"""Rocking resonance under pulses that last: the half-cycle map through the driven equation.

The input is that of the paper, except that a pulse, starting right after each impact, takes
its time. One that still acts at the next impact ends there, and a new one begins, so that
small bounces under a pulse that rises from 0 see nothing but its beginning: P, the map of
landing velocities, is P(v) = C v + O(v^2) for small v > 0, while P(0) is that of the first
landing after the whole pulse has acted on a block at rest. It is discontinuous at 0 wherever
such a pulse lifts the block, and may lead from there back to 0: bounces then die out in
finite time, each with a pulse of its own. What comes after that is not in this model: no
impact follows, no pulse begins, and the block stays at rest.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from ..block import Block
from ..ground_motion import Pulse
from ..host import listed, with_clock
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import (
    NON_NEGATIVE,
    UNIT_INTERVAL,
    Booleans,
    Number,
    Reals,
    as_real,
    check,
    of_one_precision,
)
from .event_loop import Driven, Followed, Status, follow, run
from .fixed_points import (
    FAILS,
    LANDS,
    OVERTURNS,
    RESTS,
    Landing,
    Solved,
    solved,
    stable_fixed_point,
)

_LONGEST = 200.0  # time to wait for an impact, times p


class PulsedPhase(NamedTuple):
    """The stabilized phase under pulses that last; NaN where there is none.

    Attributes
    ----------
    velocity : Array
        v*, with which the block lands [rad/s]; for short pulses the launch velocity.
    rate : Array
        Slope of the map there: what is left of a deviation after each half-cycle.
    period : Array
        T*, two half-cycles [s]; NaN where the motion settles.
    peak_rotation, rotation_ratio : Array
        alpha*_max [rad], and over the critical angle.
    stands : Array of bool
        Whether there is a stabilized phase, be it that the block settles.
    from_rest : Array of bool
        Whether it is what the pulses lead to from rest. If not, the motion from rest dies
        out, or the first pulse does not lift the block: it has to be in motion to be kept in
        motion.
    settles : Array of bool
        Whether the motion dies out and nothing else was found that lasts: velocity and
        rotations are 0, and the rate is C.
    overturns : Array of bool
        Whether the pulses overturn the block from rest. Where it neither overturns nor
        stands, its half-cycles go on without becoming equal, or the integration failed.
    """

    velocity: Reals
    rate: Reals
    period: Reals
    peak_rotation: Reals
    rotation_ratio: Reals
    stands: Booleans
    from_rest: Booleans
    settles: Booleans
    overturns: Booleans

    def __str__(self) -> str:
        units = {"velocity": "rad/s", "period": "s", "peak_rotation": "rad"}
        return listed(self, **dict.fromkeys(self._fields, "") | units)


def pulsed_next_velocity(
    block: Block,
    restitution: Number,
    pulse: Pulse,
    velocity: Number,
    *,
    model: ModelLike = Nonlinear(),
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
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.
    rtol : float
        Tolerance of the integration, at most 0.001.

    Returns
    -------
    Array
        Angular velocity just before the next impact [rad/s]; 0 where the block stays at
        rest, NaN where it overturns. From velocity 0 it is at rest until the pulse lifts it,
        to whichever side.

    Raises
    ------
    ValueError
        If an argument is not scalar, or a concrete one is out of range.
    """
    block, restitution, pulse, velocity = checked(block, restitution, pulse, velocity, rtol)
    return _next(block, restitution, pulse, velocity, as_model(model), rtol)


@with_clock("pulsed phase")
def pulsed_phase(
    block: Block,
    restitution: Number,
    pulse: Pulse,
    *,
    model: ModelLike = Nonlinear(),
    rtol: float = 1e-9,
) -> PulsedPhase:
    """The stabilized phase under pulses that last: the fixed point of `pulsed_next_velocity`.

    The one reached from rest: by the first pulse, on a block at rest, and by the next ones.
    Where that dies out or never begins, the largest stable one with which a block already in
    motion is kept in motion; where there is none either, rest. As the duration of the pulse
    goes to 0 at the same intensity it becomes that of `Nonlinear` in proportion to the
    duration.

    Parameters
    ----------
    block, restitution, pulse, model, rtol
        As in `pulsed_next_velocity`.

    Returns
    -------
    PulsedPhase

    Raises
    ------
    ValueError
        As there.

    Notes
    -----
    From rest the map is followed for at most 300 evaluations, in longer steps where it is as
    good as linear. Larger fixed points are sought at 64 velocities, in constant ratio, and
    between two of them where the map and its slopes show that one may hide.

    Examples
    --------
    Bounces that die out from rest, and the orbit of a block that moves already:

    >>> import jaxrock as jr
    >>> phase = jr.pulsed_phase(jr.Block(0.434, 8.61), 0.9115, jr.HalfSine(1.301, 0.0606))
    >>> print(f"{phase.rotation_ratio:.3f}", bool(phase.from_rest), bool(phase.settles))
    0.241 False False
    """
    block, restitution, pulse, _ = checked(block, restitution, pulse, 0.0, rtol)
    return phase_of(block, restitution, pulse, as_model(model), rtol)


def checked(
    block: Block, restitution: Number, pulse: Pulse, velocity: Number, rtol: float
) -> tuple[Block, Reals, Pulse, Reals]:
    """The arguments in one precision; a `ValueError` if they are not allowed."""
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


Parts = tuple[Block, Reals, Pulse]


def half_cycle(
    parts: Parts,
    velocity: Reals,
    wait: float,
    model: RockingModel,
    rtol: float,
    followed: Callable[..., Followed] = run,
) -> Followed:
    """From just before an impact to the next one, or so many 1 / p after the pulse.

    `followed` by `run`, which has forward derivatives, or by `follow`.
    """
    block, restitution, pulse = parts
    pulse = eqx.tree_at(lambda p: p.start, pulse, jnp.zeros_like(velocity))
    driven = Driven(
        block=block,
        restitution=restitution,
        motion=pulse,
        duration=pulse.end + wait / block.frequency_parameter if wait else pulse.end,
        rotation=jnp.zeros_like(velocity),
        velocity=restitution * velocity,
    )
    rtol = tolerance_of(velocity, rtol)
    return followed(driven, rtol=rtol, atol=1e-9 * rtol, model=model, once=True, forced=False)


def tolerance_of(like: Reals, rtol: float) -> float:
    """A tolerance that the precision of an array can deliver."""
    return max(rtol, 20 * float(jnp.finfo(like.dtype).eps))


def _landing(
    parts: Parts,
    velocity: Reals,
    model: RockingModel,
    rtol: float,
    followed: Callable[..., Followed] = run,
) -> tuple[Reals, tuple[Any, Reals, Reals]]:
    """The next landing velocity; outcome, time of the impact and peak rotation."""
    end = half_cycle(parts, velocity, _LONGEST, model, rtol, followed)
    landed = end.impacts > 0
    time, arriving = end.struck
    landing = jnp.where(landed, jnp.abs(jnp.where(landed, arriving, 1)), 0)
    time = jnp.where(landed, time, 0)
    over = jnp.where(end.status <= Status.LIST_FULL, OVERTURNS, FAILS)
    outcome = jnp.where(landed, LANDS, jnp.where(end.at_rest, RESTS, over))
    return landing, (outcome, time, end.peak)


@eqx.filter_jit
def _next(
    block: Block,
    restitution: Reals,
    pulse: Pulse,
    velocity: Reals,
    model: RockingModel,
    rtol: float,
) -> Reals:
    parts = (block, restitution, pulse)
    landing, (outcome, *_) = _landing(parts, velocity, model, rtol, follow)
    return jnp.where(outcome <= RESTS, landing, jnp.nan)


def _landed(
    parts: Parts, velocity: Reals, model: RockingModel, rtol: float
) -> tuple[Reals, tuple[Reals, ...], Landing]:
    """What is 0 at a fixed point, what is answered there, and all of it."""
    landing, rate, (outcome, time, peak) = jax.jvp(
        lambda v: _landing(parts, v, model, rtol),
        (velocity,),
        (jnp.ones_like(velocity),),
        has_aux=True,
    )
    return landing - velocity, (rate, time, peak), Landing(velocity, landing, rate, outcome)


def _search_orbit(parts: Parts, model: RockingModel, rtol: float) -> Solved:
    block, _, pulse = parts
    critical = model.critical_velocity(block)
    # No block lands faster than with all that gravity and the pulse can give.
    rate = block.frequency_parameter
    push = rate**2 * jnp.abs(pulse.amplitude) * pulse.duration / block.gravity
    bottom = 0.02 * jnp.minimum(rate * (pulse.end - pulse.start), 1) * critical

    def at(velocity: Reals) -> tuple[Landing, tuple[Reals, ...]]:
        _, answers, landing = _landed(parts, velocity, model, rtol)
        return landing, answers

    found = stable_fixed_point(
        at,
        3,
        bottom,
        critical + push,
        tolerance_of(critical, rtol),
    )
    root, *answers = (jnp.where(found.found, x, 0) for x in (found.velocity, *found.answers))
    flags = (found.from_rest, found.dies_out, found.overturns)
    return Solved(root, tuple(answers), found.found, flags)


_orbit = solved(_search_orbit, _landed)


@eqx.filter_jit
def phase_of(
    block: Block, restitution: Reals, pulse: Pulse, model: RockingModel, rtol: float
) -> PulsedPhase:
    """`pulsed_phase`, compiled."""
    solved = _orbit((block, restitution, pulse), model=model, rtol=rtol)
    from_rest, settles, overturns = solved.flags
    stands = solved.there | settles
    rate, time, peak = solved.answers
    rate = jnp.where(settles, restitution, rate)
    # As factors: what does not exist has no slope either.
    exists = jnp.where(stands, 1.0, jnp.nan)
    repeats = jnp.where(solved.there, 2.0, jnp.nan)
    return PulsedPhase(
        velocity=exists * solved.root,
        rate=exists * rate,
        period=repeats * time,
        peak_rotation=exists * peak,
        rotation_ratio=exists * peak / block.critical_angle,
        stands=stands,
        from_rest=from_rest | settles,
        settles=settles,
        overturns=overturns,
    )
