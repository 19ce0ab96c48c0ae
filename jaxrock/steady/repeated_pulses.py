"""Rocking resonance under pulses of finite duration: fixed points of the half-cycle map.

`repeated_pulses_map` has the map. From rest it is iterated; where that motion dies out, its
larger fixed points are sought from the top down.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import ArrayLike

from ..block import Block
from ..ground_motion import Pulse
from ..host import Printed, format_fields
from ..impact import count_half_cycles
from ..numerics import (
    ABOVE,
    BELOW,
    NOWHERE,
    Root,
    Sample,
    Scan,
    differentiate_implicitly,
    select_tree,
)
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import Booleans, Integers, Number, Reals
from .repeated_pulses_map import (
    LANDS,
    OVERTURNS,
    RESTS,
    Landing,
    PulsedScene,
    check_pulsed_arguments,
    compute_landing,
    limit_tolerance,
)

# Evaluations of the map from rest, at most.
_MAX_FROM_REST = 300
# Velocities at which a scan looks at the map.
_POINTS = 64
# A landing velocity that is less than this part of the first one, and falls, dies out.
_DYING = 1e-6


class PulsedPhase(Printed, eqx.Module):
    """The stabilized phase under pulses of finite duration; NaN where there is none.

    Attributes
    ----------
    velocity : Array
        v*, velocity with which the block lands [rad/s]; for short pulses it is the launch
        velocity.
    rate : Array
        Derivative of the half-cycle map there: the factor that a half-cycle applies to a
        perturbation.
    period : Array
        T*, the duration of two half-cycles, or of one for a one-sided block [s]; NaN where
        the motion settles.
    peak_rotation, rotation_ratio : Array
        alpha*_max [rad], and its ratio to the critical angle [-].
    stands : Array of bool
        Whether there is a stabilized phase; rest counts as one if the block settles.
    from_rest : Array of bool
        Whether the pulses lead to this phase from rest. If not, the motion from rest dies out
        or never begins: the pulses only sustain a block that already moves.
    settles : Array of bool
        Whether the motion dies out and no other stable phase was found: velocity and
        rotations are 0, and the rate is C.
    overturns : Array of bool
        Whether the pulses overturn the block from rest. If it neither overturns nor stands,
        its half-cycles never become equal, or the integration failed.
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
        return format_fields(self, **dict.fromkeys(self.__dataclass_fields__, "") | units)


def pulsed_phase(
    block: Block,
    restitution: Number,
    pulse: Pulse,
    *,
    model: ModelLike = Nonlinear(),
    rtol: float = 1e-9,
) -> PulsedPhase:
    """Find the stabilized phase under pulses of finite duration.

    The phase is the fixed point of `pulsed_next_velocity` that a block at rest reaches under
    successive pulses. If that motion dies out or never begins, the phase is the largest stable
    fixed point, which only a block that already moves can reach. If there is none either, the
    phase is rest. As the duration
    of the pulse goes to 0 at constant intensity, the phase tends to that of `Nonlinear`; the
    difference is proportional to the duration.

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
        If an argument is not scalar, or a concrete one is out of range.

    Notes
    -----
    From rest the map is iterated with at most 300 evaluations, in longer steps where it is
    nearly linear. Larger fixed points are sought at 64 velocities in geometric progression,
    and between neighbours where the map and its derivatives do not exclude one.

    Examples
    --------
    Bounces that die out from rest, and the orbit of a block that moves already:

    >>> import jaxrock as jr
    >>> phase = jr.pulsed_phase(jr.Block(0.434, 8.61), 0.9115, jr.HalfSine(1.301, 0.0606))
    >>> print(f"{phase.rotation_ratio:.3f}", bool(phase.from_rest), bool(phase.settles))
    0.241 False False
    """
    scene, _ = check_pulsed_arguments(block, restitution, pulse, 0.0, rtol)
    return compute_phase(scene, as_model(model), rtol)


def _compute_gap(
    scene: PulsedScene, velocity: Reals, *, model: RockingModel, rtol: float
) -> tuple[Reals, tuple[Reals, ...], Integers]:
    """Compute the gap P(v) - v, 0 at a fixed point; its rate, time, peak and outcome."""

    def land(velocity: Reals) -> tuple[Reals, Landing]:
        return compute_landing(scene, velocity, model, rtol)

    direction = jnp.ones_like(velocity)
    value, rate, (outcome, time, peak) = jax.jvp(land, (velocity,), (direction,), has_aux=True)
    return value - velocity, (rate, time, peak), outcome


class _PhaseSearch(NamedTuple):
    """The state of the search; see the table in `_search_fixed_point`."""

    scan: Scan  # its point is -1 as long as the map is iterated from rest
    reach: Reals  # how many times as long as the map's own step a step may be
    extrapolates: Booleans  # whether the step was longer than the step of the map
    first: Reals  # first landing velocity, of a block lifted from rest
    goes_on: Booleans
    exists: Booleans  # a stable fixed point was found
    overturns: Booleans  # the pulses overturn the block from rest


_PhaseAndValues = tuple[_PhaseSearch, tuple[Reals, ...]]


def _search_fixed_point(scene: PulsedScene, *, model: RockingModel, rtol: float) -> Root:
    """Find the fixed point reached from rest; where motion dies out, the largest stable."""
    # Stage               | What is known                       | What happens next
    # --------------------|-------------------------------------|-----------------------------
    # from rest           | the landings so far                 | `_iterate_from_rest`; at a
    #   (scan.point < 0)  |                                     |   stable fixed point: found;
    #                     |                                     |   overturned: the end; where
    #                     |                                     |   motion dies: the scan
    # scan                | no stable fixed point lies above    | the next point below, or a
    #   (scan.point >= 0) |   this point                        |   place between two points
    #                     |                                     |   where one may hide; at a
    #                     |                                     |   stable one: found
    # scan at its bottom  | there is none                       | the end: the block settles
    #
    # One loop for both stages, so that the program of a half-cycle is compiled once.
    block, _, pulse = scene
    critical = model.critical_velocity(block)
    p = block.frequency_parameter
    # No block lands faster than by all that gravity and the pulse can give: the critical
    # velocity for the fall, and p^2 / g times the impulse.
    top = critical + p**2 * jnp.abs(pulse.amplitude) * pulse.duration / block.gravity
    bottom = 0.02 * jnp.minimum(p * (pulse.end - pulse.start), 1) * critical
    tolerance = limit_tolerance(critical, rtol)

    def place_point(index: ArrayLike) -> Reals:
        return top * (bottom / top) ** (index / (_POINTS - 1))

    def evaluate_map(state: _PhaseAndValues) -> _PhaseAndValues:
        search = state[0]
        velocity = search.scan.trial
        gap, values, outcome = _compute_gap(scene, velocity, model=model, rtol=rtol)
        lands = outcome == LANDS
        size = tolerance * velocity
        kind = jnp.where(lands & (gap >= 0), ABOVE, BELOW)
        new = Sample(velocity, gap, values[0] - 1, jnp.where(outcome > RESTS, NOWHERE, kind))
        # Within a few tolerances, a gap that no longer shrinks is the error of the map.
        stuck = (jnp.abs(gap) <= 8 * size) & (
            jnp.abs(gap) >= 0.5 * jnp.abs(search.scan.last.value)
        )
        reached = lands & (velocity > 0) & ((jnp.abs(new.newton) <= size) | stuck)
        # An unstable fixed point is none: no motion stays there.
        stands = reached & (jnp.abs(values[0]) <= 1)
        from_rest = _iterate_from_rest(search, new, outcome, stands, place_point(0))
        scan = search.scan.advance(new, reached, place_point)
        goes_on = ~stands & (scan.point < _POINTS)
        scanned = search._replace(scan=scan, goes_on=goes_on, exists=stands)
        return select_tree(search.scan.point < 0, from_rest, scanned), values

    zero = jnp.zeros_like(top)
    no = jnp.zeros((), bool)
    begin = _PhaseSearch(Scan.start(zero), zero + 1, no, zero, ~no, no, no)
    start = begin, (zero, zero, zero)
    end, values = jax.lax.while_loop(lambda state: state[0].goes_on, evaluate_map, start)
    root, *values = (jnp.where(end.exists, x, 0) for x in (end.scan.last.place, *values))
    at_rest = end.scan.point < 0
    return Root(
        root,
        tuple(values),
        end.exists,
        (at_rest & end.exists, ~at_rest & ~end.exists, end.overturns),
    )


def _iterate_from_rest(
    search: _PhaseSearch, new: Sample, outcome: Integers, stands: Booleans, top: Reals
) -> _PhaseSearch:
    """Iterate the map, in longer steps while it is nearly linear, which it often is."""
    # Step before       | What the map shows                   | What happens next
    # ------------------|--------------------------------------|-------------------------------
    # of the map itself | linear, as the place before said     | accepted; reach 4 times as far
    # of the map itself | anything else                        | accepted; reach 1
    # extrapolated      | linear                               | accepted; reach 4 times as far
    # extrapolated      | not linear                           | back to the place before, from
    #                   |                                      |   there a step of the map
    # accepted          | a stable fixed point                 | found
    # accepted          | it overturns, or fails               | the end
    # accepted          | it rests, or lands with a velocity   | dies: the scan begins at its
    #                   |   all but 0 that falls in proportion |   top
    scan = search.scan
    old = search.scan.last
    width = new.place - old.place
    # Value and slope are what the place before said, to half of the gap there.
    shrinks = 0.5 * jnp.abs(old.value)
    linear = (
        (outcome == LANDS)
        & (jnp.abs(new.value - (old.value + width * old.slope)) <= shrinks)
        & (jnp.abs((new.slope - old.slope) * width) <= shrinks)
        & (old.place > 0)
    )
    accepted = linear | ~search.extrapolates
    at = select_tree(accepted, new, old)
    gap = at.value
    rate = 1 + at.slope
    reach = jnp.where(linear, 4 * search.reach, 1)
    # No further than Newton's step, which is infinite where the map climbs as fast as v.
    newton = jnp.where(rate < 1, jnp.abs(at.newton), jnp.inf)
    step = jnp.sign(gap) * jnp.minimum(newton, reach * jnp.abs(gap))
    # Where the map falls, so that its iterates alternate, its own step; Newton's from nearby.
    near = (jnp.abs(gap) <= 1e-4 * at.place) & (jnp.abs(rate) < 1)
    step = jnp.where(rate > 0, step, jnp.where(near, at.newton, gap))
    # Down to 0 in many steps, so that a fixed point on the way is seen. The map itself may go
    # there at once.
    step = jnp.maximum(step, jnp.minimum(gap, -0.9 * at.place))
    first = jnp.where(at.place == 0, gap, search.first)
    dying = (at.kind == BELOW) & (at.place <= _DYING * first)
    # The tangent leads through 0, as under the beginning of a pulse: the motion dies out.
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
        overturns=accepted & (outcome == OVERTURNS),
    )


_find_fixed_point = differentiate_implicitly(_search_fixed_point, _compute_gap)


@eqx.filter_jit
def compute_phase(scene: PulsedScene, model: RockingModel, rtol: float) -> PulsedPhase:
    """Compute the stabilized phase of checked arguments; see `pulsed_phase`."""
    block, restitution, _ = scene
    root = _find_fixed_point(scene, model=model, rtol=rtol)
    rate, time, peak = root.values
    from_rest, settles, overturns = root.flags
    stands = root.exists | settles

    def mask_missing(value: Reals) -> Reals:
        return jnp.where(stands, value, jnp.nan)

    return PulsedPhase(
        velocity=mask_missing(root.root),
        rate=mask_missing(jnp.where(settles, restitution, rate)),
        period=jnp.where(root.exists, count_half_cycles(block) * time, jnp.nan),
        peak_rotation=mask_missing(peak),
        rotation_ratio=mask_missing(peak / block.critical_angle),
        stands=stands,
        from_rest=from_rest | settles,
        settles=settles,
        overturns=overturns,
    )
