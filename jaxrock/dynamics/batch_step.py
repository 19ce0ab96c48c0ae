"""Many blocks side by side, each at its own pace through the cells of a `Grid`.

A turn is one step of every lane: by a Taylor polynomial to the end of its cell or, if the
block lands before, to the impact, which is a root of that polynomial. A block at rest goes
to the next cell that might lift it. What a lane does depends on no other.
"""

import math
from operator import sub
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from ..block import Block
from ..resonance import Linearized, RockingModel
from ..validation import Booleans
from .equation import Equation
from .intervals import Grid
from .taylor import Coefficients, derivative, evaluate, kept, lean_series

_LONGEST = 0.15  # step times p
# Below this part of the critical angle, polynomials of less than order 6 may be off by more:
# right after uplift the third power is all there is, whatever the step.
_COARSE = 1e-3


class Arguments(NamedTuple):
    """What a lane is asked to compute, as it comes in."""

    block: Block
    restitution: Any
    factor: Any  # on the ground motion: its amplitude or scale
    length: Any  # of a cell
    start: Any
    duration: Any
    motion: Any  # its number, where there are several


class Case(NamedTuple):
    """What follows from the arguments once for all turns."""

    equation: Equation
    foot: tuple[Any, Any]  # sine and cosine of the tilt on the ground
    longest: Any  # step
    restitution: Any
    strength: Any  # factor over g
    length: Any  # of a cell
    frequency: Any  # 1 / length
    start: Any
    duration: Any
    first: Any  # cell of the motion
    trail: Any  # of cells that might lift the block
    given: Any  # whether the motion is finite

    @classmethod
    def of(cls, grid: Grid, arguments: Arguments, model: RockingModel) -> "Case":
        """The case of the arguments, elementwise."""
        block, restitution, factor, length, start, duration, motion = arguments
        motion = motion.astype(jnp.int32)
        equation = Equation.of(block, model)
        angle, strength = equation.critical_angle, factor / equation.gravity
        needed = equation.tangent / jnp.abs(strength)
        if grid.vertical:
            needed = needed / (1 + equation.tangent)
        return cls(
            equation=equation,
            foot=(angle, jnp.ones_like(angle))
            if isinstance(model, Linearized)
            else (jnp.sin(angle), jnp.cos(angle)),
            longest=_LONGEST / jnp.sqrt(equation.square),
            restitution=restitution,
            strength=strength,
            length=length,
            frequency=1 / length,
            start=start,
            duration=duration,
            first=motion * grid.room,
            trail=grid.trail(motion, needed),
            given=grid.finite[motion],
        )

    def valid(self) -> Booleans:
        """Whether all arguments are what they may be."""
        equation = self.equation
        finite = equation.square + equation.tangent + self.strength + self.start
        return (
            jnp.isfinite(finite + self.restitution + self.length + self.duration)
            & self.given
            & (self.start >= 0)
            & (equation.square > 0)
            & (self.restitution >= 0)
            & (self.restitution <= 1)
            & (self.length > 0)
            & (self.duration > 0)
        )


class Lanes(NamedTuple):
    """Where the blocks are."""

    cell: Any
    along: Any  # time in the cell
    side: Any
    lean: Any
    speed: Any
    reach: Any  # longest step
    moves: Any
    peak: Any
    impacts: Any
    turns: Any  # in motion
    fate_lean: Any  # at the end of the input, or now if that is earlier
    fate_speed: Any

    @classmethod
    def at_rest(cls, cell: Any, dtype: Any) -> "Lanes":
        """Blocks that have not moved, in a cell."""
        zero, count = jnp.zeros(cell.shape, dtype), jnp.zeros_like(cell)
        moves = jnp.zeros(cell.shape, bool)
        return cls(
            cell, zero, zero + 1, zero, zero, zero + jnp.inf, moves, zero, count, count, zero, zero
        )

    def active(self, grid: Grid) -> Booleans:
        """Whether there is anything left to do."""
        return self.moves | (self.cell < grid.cells)


def most_turns(grid: Grid) -> Any:
    """Most turns that a lane may take: a bound on the time, reported where it is hit."""
    return 1000 * jnp.minimum(grid.cells, 2 * 10**6) + 10**6


def _tiny(dtype: Any) -> float:
    """What is nothing beside 1."""
    return 64 * float(jnp.finfo(dtype).eps)


def _lift(
    case: Case, horizontal: Coefficients, lift: Coefficients, step: Any
) -> tuple[Any, Any, Any]:
    """Whether a block at rest is lifted within a step, when, and to which side."""
    tangent = case.equation.tangent
    needed = (tangent * (1 + _tiny(step.dtype)), *(jnp.zeros_like(step) for _ in horizontal[1:]))
    if lift:
        needed = tuple(a + tangent * b for a, b in zip(needed, lift, strict=True))
    last = evaluate(horizontal, step)
    at_once = jnp.abs(horizontal[0]) > needed[0]
    lifted = at_once | (jnp.abs(last) > evaluate(needed, step))
    side = jnp.where(jnp.where(at_once, horizontal[0], last) < 0, -1.0, 1.0)
    if lift:
        # Where the ground falls away both sides are lifted within the step: the first counts.
        begin, end = (
            [one * part - need for one in (1.0, -1.0)]
            for part, need in ((horizontal[0], needed[0]), (last, evaluate(needed, step)))
        )
        first = begin[0] * (end[1] - begin[1]) >= begin[1] * (end[0] - begin[0])
        both = (end[0] > 0) & (end[1] > 0) & ~at_once
        side = jnp.where(both, jnp.where(first, 1.0, -1.0), side)
    excess = tuple(map(sub, (side * part for part in horizontal), needed))
    rise = evaluate(excess[1:], step)
    wait = -excess[0] / jnp.where(rise > 0, rise, 1)
    if len(excess) > 2:
        for _ in range(3):
            slope = evaluate(derivative(excess), wait)
            better = wait - evaluate(excess, wait) / jnp.where(slope > 0, slope, 1)
            wait = jnp.where(slope > 0, jnp.clip(better, 0, step), wait)
    return lifted, jnp.where(at_once, 0, wait), side


def _accurate(equation: Equation, path: Coefficients, step: Any) -> Any:
    """The step, or as much of it as the polynomial is good for.

    Its last term has to be a tenth as small beside the others as that of a free motion is in
    the longest step, since a rough input comes with many such steps; the one before counts
    too, since every other term may vanish.
    """
    order = len(path) - 1
    allowed = 0.1 * _LONGEST**order / math.factorial(order)
    path, length, rate = jax.lax.stop_gradient((path, step, jnp.sqrt(equation.square)))
    sizes = tuple(map(jnp.abs, path))
    moved = evaluate(sizes, length)
    if order < 6:
        moved = moved + _COARSE * jax.lax.stop_gradient(equation.critical_angle)
    last = (sizes[-1] + sizes[-2] * rate) * length**order
    excess = last / (allowed * jnp.where(moved > 0, moved, 1))
    # The length of a step may have any value: a power in float32 is cheaper. The motion grows
    # with the third power of the time at most.
    excess = jnp.maximum(excess, 1).astype(jnp.float32)
    shorter = length * jnp.exp2(jnp.log2(excess) * (-1 / max(order - 3, 1))).astype(length.dtype)
    return jnp.where(excess > 1, shorter, step)


def _turnings(slope: Coefficients, step: Any) -> tuple[Any, Any]:
    """When a lean is lowest and highest within a step: where its slope rises, falls through 0.

    `step` where it does not. From a parabola, improved once, which is much for a value that
    does not change there. Only the last step has a derivative: the extreme value does not need
    one, its second derivative does.
    """
    changing = slope
    slope, step = jax.lax.stop_gradient((slope, step))
    a, b, c = slope[0], 0.5 * slope[1], slope[2]
    square, up = b * b - a * c, b > 0
    root = jnp.sqrt(jnp.maximum(square, 0))

    def improved(above: Any, below: Any) -> Any:
        time = above / jnp.where(below == 0, 1, below)
        inside = (square > 0) & (below != 0) & (time > 0) & (time < step)
        time = jnp.where(inside, time, step)
        curved = evaluate(derivative(slope), time)
        better = time - evaluate(changing, time) / jnp.where(curved == 0, 1, curved)
        return jnp.where(inside & (better > 0) & (better < step), better, time)

    # (root - b) / c and -(root + b) / c, without cancellation
    low = improved(jnp.where(up, -a, root - b), jnp.where(up, root + b, c))
    high = improved(jnp.where(up, -(root + b), a), jnp.where(up, c, root - b))
    return low, high


def _landing(path: Coefficients, latest: Any) -> tuple[Any, Booleans]:
    """When a lean falls through 0, if it is positive before and negative at `latest`.

    From the root of a parabola by Halley's method, and by one more step, which shows whether
    that was enough and gives the time its derivatives.
    """
    a, b, c = path[:3]
    slope = derivative(path)
    root = jnp.sqrt(jnp.maximum(b * b - 4 * a * c, 0))
    up = b >= 0
    below = jnp.where(up, -2 * c, root - b)
    time = jnp.where(up, b + root, 2 * a) / jnp.where(below > 0, below, 1)
    time = jnp.where((below > 0) & (time > 0) & (time < latest), time, 0.5 * latest)
    for _ in range(2):
        value, steep, bent = (evaluate(each, time) for each in (path, slope, derivative(slope)))
        below = steep * steep - 0.5 * value * bent
        time = time - value * steep / jnp.where(below > 0, below, jnp.inf)
    before = kept(jax.lax.stop_gradient(time))
    steep, bent = evaluate(slope, before), evaluate(derivative(slope), before)
    below = jnp.where(steep < 0, steep, -1)
    off = evaluate(path, before) / below
    # The square is nothing but its second derivative.
    time = kept(before - off - 0.5 * off * off * bent / below)
    near = jnp.abs(time - before) <= float(jnp.finfo(time.dtype).eps) ** 0.5 * time
    return time, near & (steep < 0) & (time > 0) & (time <= latest)


def turn(lanes: Lanes, case: Case, grid: Grid, order: int) -> Lanes:
    """One step of every lane: to the end of its cell, its impact, or its uplift.

    `order` is that of the Taylor polynomial, at least 3.
    """
    equation, dtype = case.equation, lanes.lean.dtype
    acts = lanes.cell < grid.cells
    begin = case.start + lanes.cell.astype(dtype) * case.length
    length = jnp.where(acts, case.length, jnp.inf)
    stop = jnp.minimum(length, case.duration - begin)
    left = stop - lanes.along
    step = jnp.minimum(jnp.minimum(left, case.longest), lanes.reach)
    step = jnp.where(lanes.moves, step, jnp.where(acts, left, 0))
    strength = kept(jnp.where(acts, case.strength, 0))
    horizontal, lift = grid.ahead(case.first + lanes.cell, lanes.along, case.frequency, strength)
    push = tuple(lanes.side * part for part in horizontal)
    horizontal, lift, push, step, left = kept((horizontal, lift, push, step, left))

    lifted, wait, lifted_side = _lift(case, horizontal, lift, step)
    lifted = ~lanes.moves & lifted & (left > 0)
    lifted, wait, lifted_side = kept((lifted, wait, lifted_side))

    path = lean_series(equation, lanes.lean, lanes.speed, push, lift, order)
    step = kept(jnp.where(lanes.moves, _accurate(equation, path, step), step))
    slope = derivative(path)
    dip, top = kept(_turnings(slope, step))
    end, lowest, highest = kept(tuple(evaluate(path, time) for time in (step, dip, top)))
    lands = lanes.moves & (jnp.minimum(end, lowest) < 0)
    lands, latest = kept((lands, jnp.where(lowest < 0, dip, step)))
    landing, found = kept(_landing(path, latest))
    # Where the impact is not found, the next step is half as long and begins here.
    blocked, lands = lands & ~found, lands & found
    flight = jnp.where(lands, landing, jnp.where(blocked, 0, step))
    flight, blocked, lands = kept((flight, blocked, lands))
    speed = kept(evaluate(slope, flight))
    # Never on the ground without an impact: from there it could not be found.
    above = jnp.maximum(evaluate(path, flight), float(jnp.finfo(dtype).tiny))
    lean = kept(jnp.where(lands, 0, above))
    peak = kept(jnp.maximum(lean, jnp.where(top < flight, highest, 0)))

    # Impact. The block comes to rest if the bounces that are left end within the step. They
    # do so in the time of those on the side where the ground presses less, under an
    # acceleration which then must not change much.
    leaving = case.restitution * jnp.abs(speed)

    def onward(time: Any) -> Any:
        sideways = jnp.abs(evaluate(push, time))
        upward = evaluate(lift, time) if lift else 0.0
        return equation.lean_acceleration(*case.foot, sideways, upward)

    down, leaving = kept((-onward(flight), leaving))
    little = 0.125 * (1 - case.restitution) * down
    rest = flight + 3 * leaving / jnp.where(little > 0, 8 * little, 1)
    steady = jnp.abs(onward(rest) + down) <= little
    low = equation.square * leaving * leaving <= little * down
    nothing = leaving <= _tiny(dtype) * equation.critical_velocity
    level = -down <= 2 * _tiny(dtype) * equation.square * case.foot[0]
    # The bounce that follows is not computed: it must not be the highest.
    low = low & (leaving * leaving <= down * lanes.peak)
    settles = (little > 0) & (rest <= step) & steady & low
    settles = kept(lands & (settles | (nothing & level)))

    over = peak >= 0.5 * jnp.pi
    arrives = jnp.where(lanes.moves, ~(lands | blocked) & (step >= left), ~lifted)
    ended = (arrives & ~(stop >= length)) | (
        lanes.moves & (over | (lanes.turns >= most_turns(grid)))
    )
    cell = jnp.where(arrives, lanes.cell + 1, lanes.cell)
    cell = jnp.where(lanes.moves | lifted, cell, grid.next_cell(cell, case.trail))
    lean = jnp.where(lanes.moves, jnp.minimum(lean, 0.5 * jnp.pi), lanes.lean)
    speed = jnp.where(lands, jnp.where(settles, 0, leaving), speed)
    speed = jnp.where(lanes.moves, speed, lanes.speed)
    taken = jnp.where(lanes.moves, flight, jnp.where(lifted, wait, 0))
    # The fate is read where the input ends.
    return kept(
        Lanes(
            cell=jnp.where(ended, grid.cells, cell),
            along=jnp.where(arrives, 0, lanes.along + taken),
            side=jnp.where(lands, -lanes.side, jnp.where(lifted, lifted_side, lanes.side)),
            lean=lean,
            speed=speed,
            reach=jnp.where(blocked, 0.5 * latest, jnp.inf),
            moves=jnp.where(lanes.moves, ~(settles | ended), lifted),
            peak=jnp.where(lanes.moves, jnp.maximum(lanes.peak, peak), lanes.peak),
            impacts=lanes.impacts + lands.astype(jnp.int32),
            turns=lanes.turns + lanes.moves.astype(jnp.int32),
            fate_lean=jnp.where(acts, lean, lanes.fate_lean),
            fate_speed=jnp.where(acts, speed, lanes.fate_speed),
        )
    )
