"""One step of many blocks, each at its own pace through a ground motion.

Every lane takes a step at a time by a Taylor polynomial. What a lane does depends on no other.
The state of a lane is `Lanes`; a step leads from one row of this table to another:

    a lane that             takes a step                   and then
    ----------------------  -----------------------------  ----------------------------------
    rests (not `moves`)     to the time at which the       moves from the ground, to the side
                            input lifts it, if this        that is lifted
                            interval lifts it
                            else to the end of the         rests in the next interval that
                            interval                       may lift it; is done if none may
    moves                   as long as the last terms of   moves
                            its polynomial allow, at most
                            to the end of the interval
                            shorter, to an impact, a       moves on the other side (on the
                            root of the polynomial         same one against a wall); or rests,
                                                           if all further bounces would end
                                                           within the step (`_settle`)
                            of length 0 (`blocked`), if    moves, with a shorter `step_limit`
                            impact or peak are not
                            certain
                            as above, but reaches pi / 2,  is done: interval = intervals, and
                            or uses up its steps           no longer `moves`
    rests or moves before   as above, in free motion, at   rests or moves at the beginning of
    the start (elapsed < 0) most to the start              the same interval
    rests or moves          to the end of the duration     is done
    is done                 of length 0                    is done, until the queue gives it
                                                           another block

Blocks begin before the start of the motion if that is later than time 0: those that move in the
first interval, those at rest in the first one that may lift them. Behind the end of the input
(interval = intervals) a block that moves goes on in free motion to the end of its duration; one
that rests is done.
"""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.typing import DTypeLike

from ...impact import side_after_impact, velocity_after_impact
from ...numerics import pick_larger
from ...validation import Booleans, Integers, Reals
from ..overturning_criterion import TOPPLED_ROTATION
from .coincidences import Coincidences
from .flight import LONGEST_STEP, StepFlight
from .ground_input import CountPerBlock, HostNumbers, PerBlock, TruthPerBlock, rounding_margin
from .ground_motions import GroundInput
from .prepared_blocks import MARGIN, Case, InitialState
from .taylor import (
    Coefficients,
    choose_step,
    differentiate,
    evaluate,
    expand_rotation,
    materialize,
)

# Factor on the longest step of a second companion. Where no sample ends its steps, it shows a
# step whose last terms are small by chance.
_SHORTER = 0.75


class Lanes(eqx.Module):
    """The states of the blocks that are followed side by side."""

    interval: CountPerBlock
    elapsed: PerBlock  # time since the beginning of the interval, < 0 before the motion starts
    side: PerBlock  # on which the block stands, 1 or -1
    rotation: PerBlock  # from that side
    velocity: PerBlock
    step_limit: PerBlock  # to the length of the next step
    moves: TruthPerBlock
    peak: PerBlock  # rotation
    impacts: CountPerBlock
    steps: CountPerBlock  # in motion
    # Of the squared velocities before impacts while the input acts, weighted by time; see
    # `SimulatedBatch`.
    impact_sum: PerBlock
    end_rotation: PerBlock  # at the end of the input, or now if that is earlier
    end_velocity: PerBlock
    end_impacts: CountPerBlock
    coincidences: Coincidences | None = None  # where somebody asks for them

    @classmethod
    def at_rest(cls, interval: Integers, dtype: DTypeLike, watched: bool = False) -> "Lanes":
        """Blocks that have not moved, in an interval; with coincidences if `watched`."""
        zero = jnp.zeros(interval.shape, dtype)
        count = jnp.zeros_like(interval)
        return cls(
            interval=interval,
            elapsed=zero,
            side=zero + 1,
            rotation=zero,
            velocity=zero,
            step_limit=zero + jnp.inf,
            moves=jnp.zeros(interval.shape, bool),
            peak=zero,
            impacts=count,
            steps=count,
            impact_sum=zero,
            end_rotation=zero,
            end_velocity=zero,
            end_impacts=count,
            coincidences=Coincidences.none(zero) if watched else None,
        )

    @classmethod
    def begin(
        cls, initial: InitialState | None, case: Case, resting: Integers, watched: bool = False
    ) -> "Lanes":
        """Blocks at time 0; those at rest in the interval `resting`, which may lift them."""
        if initial is None:
            return cls.at_rest(resting, case.duration.dtype, watched)
        intervals = case.excitation.intervals
        toppled = initial.rotation >= TOPPLED_ROTATION
        moves = (initial.rotation != 0) | (initial.velocity != 0)
        return replace(
            cls.at_rest(resting, initial.rotation.dtype, watched),
            interval=jnp.where(toppled, intervals, jnp.where(moves, 0, resting)),
            elapsed=initial.elapsed,
            side=initial.side,
            rotation=initial.rotation,
            velocity=initial.velocity,
            moves=moves & ~toppled,
            peak=initial.rotation,
            end_rotation=initial.rotation,
            end_velocity=initial.velocity,
        )

    def without_next_step(self) -> "Lanes":
        """Return the states without what only the next step needs."""
        return eqx.tree_at(
            lambda lanes: (lanes.interval, lanes.elapsed, lanes.step_limit, lanes.moves),
            self,
            (None,) * 4,
        )

    def are_active(self, case: Case) -> Booleans:
        """Return which motions go on."""
        return self.moves | (self.interval < case.excitation.intervals)


def max_steps(case: Case) -> Integers:
    """Compute the largest number of steps of a lane, which bounds the time.

    A lane that reaches it says so in `BatchResponse.status`.
    """
    return 1000 * jnp.minimum(case.excitation.intervals, 2 * 10**6) + 10**6


def take_step(
    lanes: Lanes,
    case: Case,
    ground: GroundInput,
    order: int,
    line: tuple = (),
) -> Lanes:
    """Take each lane a step further; the table above says where it leads.

    `line` is what has been read of the ground in each lane's interval, if it has been.

    All rows of the table are computed for all lanes, and `where` picks: lanes run on SIMD
    lanes of the processor, which have no branches.
    """
    # Where the step may end: at the start of the motion, the end of the interval, or of the
    # duration.
    intervals = case.excitation.intervals
    before_start = lanes.elapsed < 0
    before_end = lanes.interval < intervals
    acts = before_end & ~before_start
    begin = case.start + lanes.interval.astype(lanes.rotation.dtype) * case.excitation.length
    length = jnp.where(before_start, 0, jnp.where(before_end, case.excitation.length, jnp.inf))
    stop = jnp.minimum(length, case.duration - begin)
    time_left = stop - lanes.elapsed

    # The input from here on. All that follows uses these many times. Without a barrier (here
    # and at each `materialize` in this file), XLA would fuse their computation into every use
    # and repeat it there.
    strength = materialize(jnp.where(acts, case.excitation.strength, 0))
    excitation = replace(case.excitation, strength=strength)
    horizontal, lift = ground.expand(
        excitation,
        line or ground.read(excitation.first_interval + lanes.interval),
        lanes.elapsed,
        order,
    )
    horizontal, lift, push, time_left = materialize(
        (horizontal, lift, tuple(lanes.side * part for part in horizontal), time_left)
    )

    # At rest: uplift within the interval.
    lifts, wait, uplift_side = ground.find_uplift(
        case.excitation, case.equation, lanes.elapsed, horizontal, lift, time_left
    )
    lifted, wait, uplift_side = materialize(
        (~lanes.moves & acts & lifts & (time_left > wait), wait, uplift_side)
    )

    # In motion: the polynomial, how far it is accurate, and what the block does on it.
    tolerance, companion = case.control
    path = expand_rotation(case.equation, lanes.rotation, lanes.velocity, push, lift, order)
    longest = jnp.where(acts, LONGEST_STEP, case.longest_free_step)
    step = jnp.minimum(
        jnp.where(companion == 2, _SHORTER * longest, longest),
        jnp.minimum(time_left, lanes.step_limit),
    )
    step = materialize(
        jnp.where(lanes.moves, jnp.minimum(step, choose_step(path, tolerance)), 0)
    )
    # After the choice of the step, so that it is the same for a response and its companions.
    path = _change_last_terms(path, companion)
    flight = StepFlight.of(path, step, lanes.moves, lanes.peak)
    arriving = jnp.abs(flight.velocity)
    leaving = velocity_after_impact(case.restitution, arriving, case.equation.velocity_unit)
    settles, bounce = materialize(_settle(case, push, lift, flight, step, leaving, lanes.peak))

    # Which row of the table each lane has come to.
    flies_to_end = ~(flight.lands | flight.blocked) & (flight.time >= time_left)
    arrives = jnp.where(lanes.moves, flies_to_end, ~lifted)
    gives_up = (flight.highest >= TOPPLED_ROTATION) | (lanes.steps >= max_steps(case))
    # Not `stop < length`: where NaN has got in, the lane must end as well.
    ended = (arrives & ~(stop >= length)) | (lanes.moves & gives_up)
    interval = jnp.where(arrives & ~before_start, lanes.interval + 1, lanes.interval)
    following = ground.find_next_interval(interval, case.excitation)
    interval = jnp.where(lanes.moves | lifted, interval, following)
    interval = jnp.where(ended, intervals, interval)

    # The new state. For the overturning criterion it is noted until the input ends.
    side = jnp.where(
        flight.lands,
        side_after_impact(case.equation.one_sided, lanes.side),
        jnp.where(lifted, uplift_side, lanes.side),
    )
    velocity = jnp.where(flight.lands, jnp.where(settles, 0, leaving), flight.velocity)
    rotation = jnp.minimum(flight.rotation, TOPPLED_ROTATION)
    # A block at rest that is not lifted at once stays there, whatever derivatives its initial
    # state has: these become 0, and no value changes. Else they are of the lifted side.
    forgets = before_end & ~(lifted & (wait <= 0))
    turns = jnp.where(lifted, lanes.side * uplift_side, 1)
    rotation, velocity = (
        jnp.where(
            lanes.moves, new, jnp.where(forgets, jax.lax.stop_gradient(old), turns * old)
        )
        for new, old in ((rotation, lanes.rotation), (velocity, lanes.velocity))
    )
    impacts = lanes.impacts + flight.lands.astype(jnp.int32)
    taken = jnp.where(lanes.moves, flight.time + bounce, jnp.where(lifted, wait, 0))
    # Bounces after the block settles are summed as a geometric series. Sums that only compare
    # two motions need no derivatives.
    weight = (case.duration + begin + lanes.elapsed + taken) * jnp.where(
        settles, case.bounces, 1
    )
    energy = jnp.where(flight.lands & before_end, weight * arriving * arriving, 0)
    coincidences = lanes.coincidences
    if coincidences is None:
        energy = jax.lax.stop_gradient(energy)
    else:
        new_peak = lanes.moves & (flight.highest > lanes.peak)
        coincidences = coincidences.add_step(
            flight,
            (lanes.rotation, lanes.velocity, lanes.peak),
            moves=lanes.moves,
            lifted=lifted,
            settles=settles,
            time=begin + lanes.elapsed + wait,
            input_ends=before_end & (interval >= intervals),
            counts=jnp.where(case.answer == MARGIN, before_end, new_peak),
        )
    return materialize(
        Lanes(
            interval=interval,
            elapsed=jnp.where(arrives, 0, lanes.elapsed + taken),
            side=side,
            rotation=rotation,
            velocity=velocity,
            step_limit=jnp.where(flight.blocked, flight.step_limit, jnp.inf),
            moves=jnp.where(lanes.moves, ~(settles | ended), lifted),
            peak=jnp.where(lanes.moves, pick_larger(lanes.peak, flight.highest), lanes.peak),
            impacts=impacts,
            steps=lanes.steps + lanes.moves.astype(jnp.int32),
            impact_sum=lanes.impact_sum + materialize(energy),
            end_rotation=jnp.where(before_end, rotation, lanes.end_rotation),
            end_velocity=jnp.where(before_end, velocity, lanes.end_velocity),
            end_impacts=jnp.where(before_end, impacts, lanes.end_impacts),
            coincidences=coincidences,
        )
    )


def _change_last_terms(path: Coefficients, companion: HostNumbers) -> Coefficients:
    """Omit the last term for companions, and the one before for the first of them.

    The second one has it twice: where the errors of both terms cancel in one companion, they add
    up in the other.
    """
    *terms, before_last, last = path
    changed = jnp.where(companion == 2, 2 * before_last, 0)
    before_last = jnp.where(companion == 0, before_last, changed)
    return (*terms, before_last, jnp.where(companion == 0, last, 0))


def _settle(
    case: Case,
    push: Coefficients,
    lift: Coefficients,
    flight: StepFlight,
    step: Reals,
    leaving: Reals,
    peak: Reals,
) -> tuple[Booleans, Reals]:
    """Return whether a block that lands comes to rest, and how long its next bounce takes.

    It does if all further bounces, which are infinitely many, end within the step (Zeno), or
    if the velocity `leaving` the impact is rounding, or 0 as for C = 0, and nothing lifts the
    block on the side to which it goes. Under a constant acceleration `down` to the ground a
    bounce takes 2 leaving / down, and all together take 2 leaving / ((1 - C) down). Here that
    is bounded for an input that changes meanwhile.
    """
    equation = case.equation
    sideways = evaluate(push, flight.time)
    upward = evaluate(lift, flight.time) if lift else 0.0

    # The next bounce goes to the next side, those after it to either one. Gravity brings the
    # block down slowest on the side to which the ground pushes.
    onward = side_after_impact(equation.one_sided, sideways)
    strongest = onward if equation.one_sided else jnp.abs(sideways)
    ground = case.ground_sine, case.ground_cosine
    down = -equation.right_hand_side(*ground, strongest, upward)
    next_down = -equation.right_hand_side(*ground, onward, upward)
    down, next_down, leaving = materialize((down, next_down, leaving))

    # Let the acceleration change by less than (1 - C) down / 8 until the bounces have ended.
    # Each then takes a little longer: 3 instead of 2 leaving / ((1 - C) down) is ample.
    share = (1 - case.restitution) * down
    allowed_change = 0.125 * share
    bounces = 3 * leaving / jnp.where(share > 0, share, 1)
    settled = flight.time + bounces
    change = case.ground_cosine * _bound_slope(push, settled)
    if lift:
        change = change + case.ground_sine * _bound_slope(lift, settled)
    steady = bounces * change * equation.p_squared <= allowed_change

    # The bounces must also be so low that gravity pulls hardly less than on the ground.
    low = equation.p_squared * leaving * leaving <= allowed_change * down
    # The next bounce is not computed any more: it must not be the highest.
    low = low & (leaving * leaving <= down * peak)
    ends = (share > 0) & (settled <= step) & steady & low

    # A bounce with a velocity that is rounding has no root that could be located. Where the
    # ground pushes the block back beyond uplift, it rests for that bounce only: the input
    # lifts it at once. Where the input all but lifts the block, `next_down` is rounding, too.
    tiny = rounding_margin(leaving.dtype)
    weight = equation.p_squared * case.ground_sine
    nothing = leaving <= tiny * equation.critical_velocity
    pressed = next_down >= -2 * tiny * weight
    # Not even for C = 0 is the time of that bounce without a derivative. Elsewhere it is at
    # most rounding: unless the ground falls away with g, its deceleration is twice `weight`.
    returns = (down < 0) & (next_down > 0.01 * weight)
    settles = flight.lands & (ends | (nothing & pressed))
    return settles, jnp.where(settles & returns, 2 * leaving / next_down, 0)


def _bound_slope(series: Coefficients, time: Reals) -> Reals:
    """Bound the magnitude of the derivative of a series up to a time."""
    return evaluate(differentiate(tuple(map(jnp.abs, series))), time)
