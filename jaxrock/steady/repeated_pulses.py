"""Rocking resonance under pulses of finite duration: the half-cycle map of the driven equation.

A pulse begins right after each impact and ends at the next impact at the latest. Small bounces
see only its beginning: under a pulse that rises from 0 the map P of landing velocities is
P(v) = C v + O(v^2) for small v > 0, while P(0) is the first landing after a whole pulse has
acted on a block at rest. P is discontinuous at 0 wherever the pulse lifts the block, and may
lead back to 0: bounces then die out in finite time, no further pulse begins, and the block
stays at rest.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from ..block import Block
from ..driven import Driven, Followed, Status, run
from ..ground_motion import Pulse
from ..host import Printed, listed, with_clock
from ..impact import velocity_after_impact
from ..numerics import (
    ABOVE,
    BELOW,
    NOWHERE,
    Root,
    Sample,
    Scan,
    chosen,
    through_jacobian,
    through_residual,
)
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import (
    NON_NEGATIVE,
    UNIT_INTERVAL,
    Booleans,
    Number,
    Reals,
    as_real,
    check,
    check_kind,
    of_one_precision,
)

LONGEST = 200.0  # time to wait for an impact, times p
LANDS, RESTS, _OVERTURNS, _FAILS = range(4)
_MAX_FROM_REST = 300  # evaluations
_POINTS = 64  # of a scan
_DYING = 1e-6  # beside the first landing

PulsedScene = tuple[Block, Reals, Pulse]


class PulsedPhase(Printed, eqx.Module):
    """The stabilized phase under pulses of finite duration; NaN where there is none.

    Attributes
    ----------
    velocity : Array
        v*, with which the block lands [rad/s]; for short pulses the launch velocity.
    rate : Array
        Slope of the map there: the part of a perturbation that is left after a half-cycle.
    period : Array
        T*, two half-cycles [s]; NaN where the motion settles.
    peak_rotation, rotation_ratio : Array
        alpha*_max [rad], and over the critical angle.
    stands : Array of bool
        Whether there is a stabilized phase, be it that the block settles.
    from_rest : Array of bool
        Whether the pulses lead to it from rest. If not, the motion from rest dies out or never
        begins: only a block in motion is kept in motion.
    settles : Array of bool
        Whether the motion dies out and no other stable phase was found: velocity and
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
        return listed(self, **dict.fromkeys(self.__dataclass_fields__, "") | units)


def pulsed_next_velocity(
    block: Block,
    restitution: Number,
    pulse: Pulse,
    velocity: Number,
    *,
    model: ModelLike = Nonlinear(),
    rtol: float = 1e-9,
) -> Reals:
    """Apply the half-cycle map: one landing velocity to the next.

    Parameters
    ----------
    block, restitution : Block, float
        One block; C [-], between 0 and 1.
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
    scene, velocity = checked(block, restitution, pulse, velocity, rtol)
    return _next_velocity(scene, velocity, model=as_model(model), rtol=rtol)


@with_clock("pulsed phase")
def pulsed_phase(
    block: Block,
    restitution: Number,
    pulse: Pulse,
    *,
    model: ModelLike = Nonlinear(),
    rtol: float = 1e-9,
) -> PulsedPhase:
    """Find the stabilized phase under pulses of finite duration.

    The fixed point of `pulsed_next_velocity` that is reached from rest: by the first pulse, on
    a block at rest, and by the next ones. Where that motion dies out or never begins, the
    largest stable fixed point, of a block already in motion; where there is none either, rest.
    As the duration of the pulse goes to 0 at the same intensity, the phase tends to that of
    `Nonlinear` in proportion to the duration.

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
    From rest the map is followed for at most 300 evaluations, in longer steps where it is
    nearly linear. Larger fixed points are sought at 64 velocities in constant ratio, and
    between neighbours where the map and its slopes show that one may hide.

    Examples
    --------
    Bounces that die out from rest, and the orbit of a block that moves already:

    >>> import jaxrock as jr
    >>> phase = jr.pulsed_phase(jr.Block(0.434, 8.61), 0.9115, jr.HalfSine(1.301, 0.0606))
    >>> print(f"{phase.rotation_ratio:.3f}", bool(phase.from_rest), bool(phase.settles))
    0.241 False False
    """
    scene, _ = checked(block, restitution, pulse, 0.0, rtol)
    return phase_of(scene, as_model(model), rtol)


def checked(
    block: Block, restitution: Number, pulse: Pulse, velocity: Number, rtol: float
) -> tuple[PulsedScene, Reals]:
    """Bring scene and velocity to one precision; a `ValueError` if they are not allowed."""
    check_kind("block", block, Block)
    check_kind("pulse", pulse, Pulse)
    if not 0 < rtol <= 1e-3:
        raise ValueError(f"rtol must be greater than 0 and at most 0.001, got {rtol:g}")
    restitution = as_real("restitution", restitution)
    velocity = as_real("velocity", velocity)
    check("restitution", restitution, UNIT_INTERVAL)
    check("velocity", velocity, NON_NEGATIVE)
    block.check()
    pulse.check()
    arguments = ((block, restitution, pulse), velocity)
    for leaf in jax.tree.leaves(arguments):
        if leaf.ndim:
            raise ValueError(f"arguments must be scalar, got an array of shape {leaf.shape}")
    return of_one_precision(arguments)


def half_cycle(
    scene: PulsedScene, velocity: Reals, wait: Any, model: RockingModel, rtol: float
) -> Followed:
    """From just before an impact to the next one, up to `wait` / p after the end of the pulse."""
    block, restitution, pulse = scene
    pulse = eqx.tree_at(lambda p: p.start, pulse, jnp.zeros_like(velocity))
    driven = Driven(
        block=block,
        restitution=restitution,
        motion=pulse,
        duration=pulse.end + wait / block.frequency_parameter,
        rotation=jnp.zeros_like(velocity),
        velocity=velocity_after_impact(restitution, velocity),
    )
    rtol = tolerance_of(velocity, rtol)
    return run(driven, rtol=rtol, atol=1e-9 * rtol, model=model, once=True, forced=False)


def tolerance_of(like: Reals, rtol: float) -> float:
    """Return a tolerance that the precision of an array can deliver."""
    return max(rtol, 20 * float(jnp.finfo(like.dtype).eps))


def _landing(
    scene: PulsedScene, velocity: Reals, model: RockingModel, rtol: float
) -> tuple[Reals, tuple[Any, Reals, Reals]]:
    """Compute the next landing velocity; outcome, time of the impact and peak rotation."""
    return landing_of(half_cycle(scene, velocity, LONGEST, model, rtol))


def landing_of(followed: Followed) -> tuple[Reals, tuple[Any, Reals, Reals]]:
    """Compute the landing velocity after a half-cycle; outcome, time of impact and peak."""
    response = followed.response
    landed = followed.response.impacts > 0
    time, arriving = followed.struck
    landing = jnp.where(landed, jnp.abs(jnp.where(landed, arriving, 1)), 0)
    over = jnp.where(response.status <= Status.LIST_FULL, _OVERTURNS, _FAILS)
    outcome = jnp.where(landed, LANDS, jnp.where(response.at_rest, RESTS, over))
    return landing, (outcome, jnp.where(landed, time, 0), followed.peak)


@eqx.filter_jit
@through_jacobian
def _next_velocity(
    scene: PulsedScene, velocity: Reals, *, model: RockingModel, rtol: float
) -> Reals:
    landing, (outcome, *_) = _landing(scene, velocity, model, rtol)
    return jnp.where(outcome <= RESTS, landing, jnp.nan)


def _residual(
    scene: PulsedScene, velocity: Reals, *, model: RockingModel, rtol: float
) -> tuple[Reals, tuple[Reals, ...], Int[Array, ""]]:
    """Compute what a half-cycle adds, 0 at a fixed point; its rate, time, peak and outcome."""

    def landing(velocity: Reals) -> tuple[Reals, Any]:
        return _landing(scene, velocity, model, rtol)

    one = jnp.ones_like(velocity)
    value, rate, (outcome, time, peak) = jax.jvp(landing, (velocity,), (one,), has_aux=True)
    return value - velocity, (rate, time, peak), outcome


class _PhaseSearch(NamedTuple):
    """From rest, or with the first point of its scan for the largest fixed point."""

    scan: Scan
    reach: Reals  # length of a step beside that of the map itself, at most
    extrapolates: Booleans  # whether the step is longer than that of the map
    first: Reals  # landing
    goes_on: Booleans
    exists: Booleans
    overturns: Booleans


def _search(scene: PulsedScene, *, model: RockingModel, rtol: float) -> Root:
    """Find the fixed point reached from rest; where motion dies out, the largest stable."""
    block, _, pulse = scene
    critical = model.critical_velocity(block)
    p = block.frequency_parameter
    # No block lands faster than by all that gravity and the pulse can give.
    top = critical + p**2 * jnp.abs(pulse.amplitude) * pulse.duration / block.gravity
    bottom = 0.02 * jnp.minimum(p * (pulse.end - pulse.start), 1) * critical
    tolerance = tolerance_of(critical, rtol)

    def points(index: Any) -> Reals:
        return top * (bottom / top) ** (index / (_POINTS - 1))

    def step(state: tuple[_PhaseSearch, Any]) -> tuple[_PhaseSearch, Any]:
        search = state[0]
        velocity = state[0].scan.trial
        gap, values, outcome = _residual(scene, velocity, model=model, rtol=rtol)
        lands = outcome == LANDS
        size = tolerance * velocity
        kind = jnp.where(lands & (gap >= 0), ABOVE, BELOW)
        new = Sample(velocity, gap, values[0] - 1, jnp.where(outcome > RESTS, NOWHERE, kind))
        # Within a few tolerances, a gap that no longer shrinks is the error of the map.
        stuck = (jnp.abs(gap) <= 8 * size) & (
            jnp.abs(gap) >= 0.5 * jnp.abs(search.scan.last.value)
        )
        reached = lands & (velocity > 0) & ((jnp.abs(new.newton) <= size) | stuck)
        stands = reached & (jnp.abs(values[0]) <= 1)
        from_rest = _from_rest(search, new, outcome, stands, points(0))
        scan = search.scan.after(new, reached, points)
        goes_on = ~stands & (scan.point < _POINTS)
        scanned = search._replace(scan=scan, goes_on=goes_on, exists=stands)
        return chosen(search.scan.point < 0, from_rest, scanned), values

    zero = jnp.zeros_like(top)
    no = jnp.zeros((), bool)
    begin = _PhaseSearch(Scan.beginning(zero), zero + 1, no, zero, ~no, no, no)
    start = begin, (zero, zero, zero)
    end, values = jax.lax.while_loop(lambda state: state[0].goes_on, step, start)
    root, *values = (jnp.where(end.exists, x, 0) for x in (end.scan.last.place, *values))
    at_rest = end.scan.point < 0
    return Root(
        root,
        tuple(values),
        end.exists,
        (at_rest & end.exists, ~at_rest & ~end.exists, end.overturns),
    )


def _from_rest(
    search: _PhaseSearch, new: Sample, outcome: Int[Array, ""], stands: Booleans, top: Reals
) -> _PhaseSearch:
    """Iterate the map, in longer steps while it is nearly linear, which it often is."""
    scan = search.scan
    old = search.scan.last
    width = new.place - old.place
    shrinks = 0.5 * jnp.abs(old.value)
    linear = (
        (outcome == LANDS)
        & (jnp.abs(new.value - (old.value + width * old.slope)) <= shrinks)
        & (jnp.abs((new.slope - old.slope) * width) <= shrinks)
        & (old.place > 0)
    )
    accepted = linear | ~search.extrapolates
    at = chosen(accepted, new, old)
    gap = at.value
    rate = 1 + at.slope
    reach = jnp.where(linear, 4 * search.reach, 1)
    newton = jnp.where(rate < 1, jnp.abs(at.newton), jnp.inf)
    step = jnp.sign(gap) * jnp.minimum(newton, reach * jnp.abs(gap))
    # Where the map alternates, its own step, or Newton's from nearby.
    near = (jnp.abs(gap) <= 1e-4 * at.place) & (jnp.abs(rate) < 1)
    step = jnp.where(rate > 0, step, jnp.where(near, at.newton, gap))
    # Down to 0 in many steps, so that a fixed point on the way is seen.
    step = jnp.maximum(step, jnp.minimum(gap, -0.9 * at.place))
    first = jnp.where(at.place == 0, gap, search.first)
    dying = (at.kind == BELOW) & (at.place <= _DYING * first)
    straight = jnp.abs(gap - at.slope * at.place) <= 1e-3 * at.place
    dies = accepted & ((at.place + gap == 0) | (dying & straight))
    stands = stands & accepted
    goes_on = ~stands & ~(accepted & (new.kind == NOWHERE)) & (scan.since < _MAX_FROM_REST)
    dies = dies & goes_on
    following = scan._replace(
        trial=jnp.where(dies, top, at.place + step),
        last=at,
        point=jnp.where(dies, 0, scan.point),
        since=jnp.where(dies, 0, scan.since + 1),
    )
    return _PhaseSearch(
        scan=following,
        reach=reach,
        extrapolates=jnp.abs(step) > (1 + 1e-9) * jnp.abs(gap),
        first=first,
        goes_on=goes_on,
        exists=stands,
        overturns=accepted & (outcome == _OVERTURNS),
    )


_fixed_point = through_residual(_search, _residual)


@eqx.filter_jit
def phase_of(scene: PulsedScene, model: RockingModel, rtol: float) -> PulsedPhase:
    """`pulsed_phase`, compiled."""
    block, restitution, _ = scene
    root = _fixed_point(scene, model=model, rtol=rtol)
    rate, time, peak = root.values
    from_rest, settles, overturns = root.flags
    stands = root.exists | settles

    def where_it_stands(value: Reals) -> Reals:
        return jnp.where(stands, value, jnp.nan)

    return PulsedPhase(
        velocity=where_it_stands(root.root),
        rate=where_it_stands(jnp.where(settles, restitution, rate)),
        period=jnp.where(root.exists, 2 * time, jnp.nan),
        peak_rotation=where_it_stands(peak),
        rotation_ratio=where_it_stands(peak / block.critical_angle),
        stands=stands,
        from_rest=from_rest | settles,
        settles=settles,
        overturns=overturns,
    )
