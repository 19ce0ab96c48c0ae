"""Rocking resonance under pulses of finite duration: fixed points of the half-cycle map.

The map of `repeated_pulses_map` is iterated from rest. Where this motion dies out,
larger fixed points are sought from the top down.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from ..block import Block
from ..ground_motion import Pulse
from ..host import Printed, format_fields
from ..impact import count_half_cycles
from ..numerics import Root, differentiate_implicitly, select_tree
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import Booleans, Integers, Number, Reals
from .repeated_pulses_map import (
    PulsedScene,
    check_pulsed_arguments,
    compute_gap,
    limit_tolerance,
)

# Largest number of evaluations of the map from rest.
_MAX_FROM_REST = 300
# Velocities of a scan, and largest number of evaluations between two of them.
_POINTS = 64
_MAX_BETWEEN = 100
# A motion dies out if its landing velocity falls below this fraction of the first one.
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

    The half-cycle map leads from one landing velocity to the next. The phase is its fixed point
    that a block at rest reaches under successive pulses. If that motion dies out or never
    begins, the phase is the largest stable fixed point, which only a block that already moves
    can reach. If there is none either, the phase is rest. As the duration of the pulse goes to
    0 at constant intensity, the phase tends to that of `Nonlinear`; the difference is
    proportional to the duration.

    Parameters
    ----------
    block, restitution : Block, float
        One block; C [-], between 0 and 1, of a one-sided block its magnitude.
    pulse : Pulse
        Acts from each impact on, outward: a positive amplitude pushes the block away from the
        ground, to whichever side it stands on.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.
    rtol : float
        Tolerance of the integration, at most 0.001.

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
    >>> phase = jr.steady.pulsed_phase(jr.Block(0.434, 8.61), 0.9115, jr.HalfSine(1.301, 0.0606))
    >>> print(f"{phase.rotation_ratio:.3f}", bool(phase.from_rest), bool(phase.settles))
    0.241 False False
    """
    scene = check_pulsed_arguments(block, restitution, pulse, rtol)
    return compute_phase(scene, as_model(model), rtol)


class _Sample(NamedTuple):
    """The gap at one velocity; NaN where no landing follows."""

    velocity: Reals
    gap: Reals
    slope: Reals

    @property
    def newton(self) -> Reals:
        """Step of Newton's method to the fixed point."""
        return self.gap / jnp.where(self.slope == 0, 1e-30, -self.slope)


class _PhaseSearch(NamedTuple):
    """The state of the search; see the tables in `_search_fixed_point` and below it."""

    trial: Reals  # where the map is evaluated next
    last: _Sample
    values: tuple[Reals, ...]  # rate, time of the impact and peak at the last evaluation
    point: Integers  # index in the scan; -1 as long as the map is iterated from rest
    since: Integers  # evaluations since the beginning, or since that point
    goes_on: Booleans
    exists: Booleans  # a stable fixed point was found
    overturns: Booleans  # the pulses overturn the block from rest
    reach: Reals  # longest step, over the step of the map itself
    extrapolates: Booleans  # whether the step was longer than the step of the map
    first: Reals  # first landing velocity, of a block lifted from rest
    left: _Sample  # the lower end of the interval in which a fixed point is sought
    right: _Sample  # the upper end


def _search_fixed_point(scene: PulsedScene, *, model: RockingModel, rtol: float) -> Root:
    """Find the fixed point reached from rest; where motion dies out, the largest stable."""
    # Stage               | What is known                       | What happens next
    # --------------------|-------------------------------------|-----------------------------
    # from rest           | the landings so far                 | `_iterate_from_rest`; at a
    #   (point < 0)       |                                     |   stable fixed point: found;
    #                     |                                     |   overturned: the end; where
    #                     |                                     |   motion dies: the scan
    # scan                | no stable fixed point lies above    | `_scan_downwards`: the next
    #   (point >= 0)      |   this point                        |   point below, or a place
    #                     |                                     |   between two points where
    #                     |                                     |   one may hide; at a stable
    #                     |                                     |   one: found
    # scan at its bottom  | there is none                       | the end: the block settles
    #
    # One loop for both stages, so that the program of a half-cycle is compiled once.
    block, _, pulse = scene
    critical = model.critical_velocity(block)
    p = block.frequency_parameter
    # No block lands faster than gravity and the pulse together allow: the critical velocity
    # for the fall, and p^2 / g times the impulse.
    top = critical + p**2 * jnp.abs(pulse.amplitude) * pulse.duration / block.gravity
    bottom = 0.02 * jnp.minimum(p * (pulse.end - pulse.start), 1) * critical
    tolerance = limit_tolerance(critical, rtol)

    def place_point(index: Reals | int) -> Reals:
        return top * (bottom / top) ** (index / (_POINTS - 1))

    def evaluate_map(search: _PhaseSearch) -> _PhaseSearch:
        velocity = search.trial
        gap, values, overturns = compute_gap(scene, velocity, model=model, rtol=rtol)
        search = search._replace(values=values)
        new = _Sample(velocity, gap, values[0] - 1)
        size = tolerance * velocity
        # Within a few tolerances, a gap that no longer shrinks is the error of the map.
        stuck = (jnp.abs(gap) <= 8 * size) & (jnp.abs(gap) >= 0.5 * jnp.abs(search.last.gap))
        reached = (velocity > 0) & ((jnp.abs(new.newton) <= size) | stuck)
        # An unstable fixed point does not count: no motion stays there.
        stands = reached & (jnp.abs(values[0]) <= 1)
        iterated = _iterate_from_rest(search, new, stands, overturns, place_point(0))
        below = place_point((search.point + 1).astype(top.dtype))
        scanned = _scan_downwards(search, new, reached, stands, below)
        return select_tree(search.point < 0, iterated, scanned)

    zero = jnp.zeros_like(top)
    count = jnp.zeros((), int)
    no = jnp.zeros((), bool)
    # The gap of 0 is not negative: above the first point no fixed point is sought.
    start = _Sample(zero, zero, zero)
    zeros = (zero, zero, zero)
    begin = _PhaseSearch(
        zero, start, zeros, count - 1, count, ~no, no, no, zero + 1, no, zero, start, start
    )
    final = jax.lax.while_loop(lambda search: search.goes_on, evaluate_map, begin)
    answers = (final.last.velocity, final.values)
    root, values = jax.tree.map(lambda x: jnp.where(final.exists, x, 0), answers)
    from_rest = final.point < 0
    flags = from_rest & final.exists, ~from_rest & ~final.exists, final.overturns
    return Root(root, values, final.exists, flags)


def _iterate_from_rest(
    search: _PhaseSearch, new: _Sample, stands: Booleans, overturns: Booleans, top: Reals
) -> _PhaseSearch:
    """Iterate the map, in longer steps while it is nearly linear."""
    # Step before       | What the map shows                   | What happens next
    # ------------------|--------------------------------------|-------------------------------
    # of the map itself | linear, as the velocity before said  | accepted; reach 4 times as far
    # of the map itself | anything else                        | accepted; reach 1
    # extrapolated      | linear                               | accepted; reach 4 times as far
    # extrapolated      | not linear                           | back to the velocity before,
    #                   |                                      |   then a step of the map
    # accepted          | a stable fixed point                 | found
    # accepted          | it overturns, or fails               | the end
    # accepted          | it rests, or lands with a velocity   | dies: the scan begins at its
    #                   |   all but 0 that falls in proportion |   top
    old = search.last
    width = new.velocity - old.velocity
    # Gap and slope agree with the tangent at the velocity before, to half of the gap there.
    shrinks = 0.5 * jnp.abs(old.gap)
    linear = (
        (new.velocity + new.gap > 0)
        & (jnp.abs(new.gap - (old.gap + width * old.slope)) <= shrinks)
        & (jnp.abs((new.slope - old.slope) * width) <= shrinks)
        & (old.velocity > 0)
    )
    accepted = linear | ~search.extrapolates
    sample = select_tree(accepted, new, old)
    gap = sample.gap
    velocity = sample.velocity
    rate = 1 + sample.slope
    reach = jnp.where(linear, 4 * search.reach, 1)
    # The step is at most Newton's step, which is infinite where the map rises as fast as v.
    newton = jnp.where(rate < 1, jnp.abs(sample.newton), jnp.inf)
    step = jnp.sign(gap) * jnp.minimum(newton, reach * jnp.abs(gap))
    # Where the map falls, its iterates alternate: the step of the map is taken, and Newton's
    # step nearby.
    near = (jnp.abs(gap) <= 1e-4 * velocity) & (jnp.abs(rate) < 1)
    step = jnp.where(rate > 0, step, jnp.where(near, sample.newton, gap))
    # Steps go down to 0 gradually, so that a fixed point on the way is found. The map itself
    # may go to 0 at once.
    step = jnp.maximum(step, jnp.minimum(gap, -0.9 * velocity))
    first = jnp.where(velocity == 0, gap, search.first)
    dying = (gap < 0) & (velocity <= _DYING * first)
    # The tangent leads through 0, as under the beginning of a pulse: the motion dies out.
    straight = jnp.abs(gap - sample.slope * velocity) <= 1e-3 * velocity
    stands = stands & accepted
    goes_on = ~stands & ~(accepted & jnp.isnan(new.gap)) & (search.since < _MAX_FROM_REST)
    dies = goes_on & accepted & ((velocity + gap == 0) | (dying & straight))
    return search._replace(
        trial=jnp.where(dies, top, velocity + step),
        last=sample,
        point=jnp.where(dies, 0, search.point),
        since=jnp.where(dies, 0, search.since + 1),
        goes_on=goes_on,
        exists=stands,
        overturns=accepted & overturns,
        reach=reach,
        extrapolates=jnp.abs(step) > (1 + 1e-9) * jnp.abs(gap),
        first=first,
    )


def _scan_downwards(
    search: _PhaseSearch, new: _Sample, reached: Booleans, stands: Booleans, below: Reals
) -> _PhaseSearch:
    """Store the sample at the trial, and choose the next trial, perhaps the next point below."""
    # The trial was       | What happens next
    # --------------------|-------------------------------------------------------------------
    # a point (since = 0) | The sample becomes `left`. Between it and `right`, the point above
    #                     |   it: a trial if a fixed point may hide there, since = 1. Else: on.
    # between the two     | The sample replaces one of them, so that the fixed point stays in
    #                     |   between. If one may still hide: another trial. Else: on.
    # a fixed point       | On.
    #
    # On to the next point: `left`, below which nothing is known, becomes `right`.
    left = search.left
    right = search.right
    # At a stable fixed point the gap falls. The point lies to the right of a gap above 0, and
    # to the left of a gap below 0, unless this gap rises to a hump. An edge beyond which no
    # landing follows stays in the interval as well.
    climbs = (left.gap < 0) & (jnp.isnan(right.gap) | (new.slope > 0))
    stays = jnp.where(jnp.isnan(new.gap), jnp.isnan(left.gap), climbs)
    moves_left = (search.since == 0) | (new.gap >= 0) | stays
    left = select_tree(moves_left, new, left)
    right = select_tree(moves_left, right, new)
    halve = (search.since > 0) & (search.since % 3 == 0)
    hides, between = _propose_velocity(left, right, new, halve)
    # Between neighbouring floats the gap jumps over 0.
    eps = float(jnp.finfo(between.dtype).eps)
    wide = right.velocity - left.velocity > 4 * eps * right.velocity
    hides = hides & wide & (search.since <= _MAX_BETWEEN) & ~reached
    point = jnp.where(hides, search.point, search.point + 1)
    return search._replace(
        trial=jnp.where(hides, between, below),
        last=new,
        point=point,
        since=jnp.where(hides, search.since + 1, 0),
        goes_on=~stands & (point < _POINTS),
        exists=stands,
        left=left,
        right=select_tree(hides, right, left),
    )


def _propose_velocity(
    left: _Sample, right: _Sample, last: _Sample, halve: Booleans
) -> tuple[Booleans, Reals]:
    """Return whether a fixed point may hide in an interval, and propose where to look for it.

    With `halve` this is the middle: Newton's method alone may approach a root slowly from one
    side.
    """
    low = left.velocity
    high = right.velocity
    open_above = ~(right.gap >= 0)
    closed = right.gap < 0
    crosses = (left.gap >= 0) & open_above
    # Next to an edge beyond which no landing follows, the gap may begin above 0 and fall.
    edge = jnp.isnan(left.gap) & closed
    # A hump has no sign change at its ends, but may reach above 0 where their tangents meet.
    # The right side of an open hump is not known.
    bend = left.slope - right.slope
    along = right.gap - left.gap - right.slope * (high - low)
    along = along / jnp.where(bend > 0, bend, 1)
    top = left.gap + left.slope * jnp.where(closed, along, high - low)
    climbs = (left.gap < 0) & (left.slope > 0) & open_above
    hump = climbs & ~(closed & (right.slope >= 0)) & (top > 0)

    # The proposal is Newton's as long as it stays inside; or the top of a hump, at some
    # distance from the ends, so that the interval shrinks; otherwise the middle.
    newton = last.velocity + last.newton
    inside = crosses & closed & (newton > low) & (newton < high) & ~halve
    peak = jnp.clip(low + along, 0.9 * low + 0.1 * high, 0.1 * low + 0.9 * high)
    middle = jnp.where(hump & closed, peak, 0.5 * (low + high))
    return crosses | edge | hump, jnp.where(inside, newton, middle)


_find_fixed_point = differentiate_implicitly(_search_fixed_point, compute_gap)


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
