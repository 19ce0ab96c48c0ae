"""Many blocks side by side, each at its own pace through the cells of a `Grid`.

A turn is one step of every lane: by a Taylor polynomial to the end of its cell or, if the
block lands before, to the impact, which is a root of that polynomial. A block at rest goes
to the next cell that might lift it. What a lane does depends on no other.
"""

from operator import sub
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from .arguments import Booleans
from .block import Block
from .equation import Equation
from .grid import Grid
from .series import Coefficients, derivative, evaluate, kept, lean_series

_ORDER = 6
_LONGEST = 0.15  # step times p


class Arguments(NamedTuple):
    """What a lane is asked to compute, as it comes in."""

    block: Block
    restitution: Any
    factor: Any  # on the ground motion: its amplitude or scale
    length: Any  # of a cell
    start: Any
    duration: Any
    first: Any  # cell of the motion


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
    first: Any
    grade: Any  # of the cells that might lift the block

    @classmethod
    def of(cls, grid: Grid, arguments: Arguments, linearized: bool) -> "Case":
        """The case of the arguments, elementwise."""
        block, restitution, factor, length, start, duration, first = arguments
        equation = Equation.of(block, linearized)
        angle, strength = equation.critical_angle, factor / equation.gravity
        needed = equation.tangent / jnp.abs(strength)
        if grid.vertical:
            needed = needed / (1 + equation.tangent)
        return cls(
            equation=equation,
            foot=(angle, jnp.ones_like(angle)) if linearized else (jnp.sin(angle), jnp.cos(angle)),
            longest=_LONGEST / jnp.sqrt(equation.square),
            restitution=restitution,
            strength=strength,
            length=length,
            frequency=1 / length,
            start=start,
            duration=duration,
            first=first,
            grade=grid.grade(needed),
        )

    def valid(self) -> Booleans:
        """Whether all arguments are what they may be."""
        equation = self.equation
        finite = equation.square + equation.tangent + self.strength + self.start
        return (
            jnp.isfinite(finite + self.restitution + self.length + self.duration)
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
        return cls(cell, zero, zero + 1, zero, zero, moves, zero, count, count, zero, zero)

    def active(self, grid: Grid) -> Booleans:
        """Whether there is anything left to do."""
        return self.moves | (self.cell < grid.cells)


def most_turns(grid: Grid) -> int:
    """Most turns that a lane may take: a bound on the time, reported where it is hit."""
    return 1000 * grid.cells + 10**6


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
    excess = tuple(map(sub, (side * part for part in horizontal), needed))
    rise = evaluate(excess[1:], step)
    wait = -excess[0] / jnp.where(rise > 0, rise, 1)
    if len(excess) > 2:
        for _ in range(3):
            slope = evaluate(derivative(excess), wait)
            better = wait - evaluate(excess, wait) / jnp.where(slope > 0, slope, 1)
            wait = jnp.where(slope > 0, jnp.clip(better, 0, step), wait)
    return lifted, jnp.where(at_once, 0, wait), side


def _turning(slope: Coefficients, step: Any) -> Any:
    """When a lean is extreme within a step, if it is: where its slope is 0.

    A maximum from where a parabola has it, a minimum from the end. Without a derivative,
    which the extreme value does not need.
    """
    slope, step = jax.lax.stop_gradient((slope, step))
    bend = derivative(slope)
    end = evaluate(slope, step)
    maximum = (slope[0] > 0) & (end < 0)
    time = step * jnp.where(maximum, slope[0] / jnp.where(maximum, slope[0] - end, 1), 1)
    for _ in range(2):
        steep, curved = evaluate(slope, time), evaluate(bend, time)
        converges = jnp.where(maximum, curved < 0, (curved > 0) & (steep > 0))
        better = time - steep / jnp.where(converges, curved, 1)
        time = jnp.where(converges, jnp.clip(better, 0, step), time)
    return time


def _landing(path: Coefficients, wanted: Any, latest: Any) -> Any:
    """When a lean falls through 0, if it is positive before and negative at `latest`.

    Newton's method, which is done after a few steps from the root of a parabola; in a
    bracket for those that are not. The last step gives the time its derivative.
    """
    a, b, c = path[:3]
    # A block that has just been launched is on the ground: divide that root out.
    reduced = kept(
        tuple(
            jnp.where(a == 0, after, here)
            for here, after in zip(path, (*path[1:], jnp.zeros_like(a)), strict=True)
        )
    )
    slope = derivative(reduced)

    def newton(time: Any) -> tuple[Any, Any, Any]:
        value, steep = evaluate(reduced, time), evaluate(slope, time)
        return value, steep < 0, time - value / jnp.where(steep < 0, steep, -1)

    def unsolved(before: Any, after: Any) -> Any:
        # Convergence is quadratic, and one more step is still to come.
        return wanted & ~(jnp.abs(after - before) <= jnp.sqrt(jnp.finfo(after.dtype).eps) * latest)

    def better(state: Any) -> Any:
        time, low, high, left, count = state
        value, falling, there = newton(time)
        low, high = jnp.where(value > 0, time, low), jnp.where(value > 0, high, time)
        inside = falling & (there >= low) & (there <= high)
        there = jnp.where(inside, there, 0.5 * (low + high))
        still = left & unsolved(time, there)
        # One that has its root waits, so that no other changes it.
        return jnp.where(left, there, time), low, high, still, count + 1

    root = jnp.sqrt(jnp.maximum(b * b - 4 * a * c, 0))
    up = b >= 0
    below = jnp.where(up, -2 * c, root - b)
    parabola = jnp.where(up, b + root, 2 * a) / jnp.where(below > 0, below, 1)
    guess = kept(
        jnp.where((below > 0) & (parabola > 0) & (parabola < latest), parabola, 0.5 * latest)
    )
    before = guess
    for _ in range(2):
        before = jnp.clip(newton(before)[2], 0, latest)
    before = kept(before)
    _, falling, after = newton(before)
    inside = falling & (after >= 0) & (after <= latest)
    time = jnp.where(inside, after, 0.5 * latest)
    left = wanted & (~inside | unsolved(before, time))
    time, left = kept((time, left))
    time, *_ = jax.lax.while_loop(
        lambda state: state[3].any() & (state[4] < 80),
        better,
        (time, jnp.zeros_like(time), latest, left, 0),
    )
    _, falling, there = newton(jax.lax.stop_gradient(time))
    return jnp.where(falling, jnp.clip(there, 0, latest), time)


def turn(lanes: Lanes, case: Case, grid: Grid) -> Lanes:
    """One step of every lane: to the end of its cell, its impact, or its uplift."""
    equation, dtype = case.equation, lanes.lean.dtype
    acts = lanes.cell < grid.cells
    begin = case.start + lanes.cell.astype(dtype) * case.length
    length = jnp.where(acts, case.length, jnp.inf)
    stop = jnp.minimum(length, case.duration - begin)
    left = stop - lanes.along
    step = jnp.where(lanes.moves, jnp.minimum(left, case.longest), jnp.where(acts, left, 0))
    strength = kept(jnp.where(acts, case.strength, 0))
    horizontal, lift = grid.ahead(case.first + lanes.cell, lanes.along, case.frequency, strength)
    push = tuple(lanes.side * part for part in horizontal)
    horizontal, lift, push, step, left = kept((horizontal, lift, push, step, left))

    lifted, wait, lifted_side = _lift(case, horizontal, lift, step)
    lifted = ~lanes.moves & lifted & (left > 0)
    lifted, wait, lifted_side = kept((lifted, wait, lifted_side))

    path = lean_series(equation, lanes.lean, lanes.speed, push, lift, _ORDER)
    slope = derivative(path)
    turning = kept(_turning(slope, step))
    end, extreme = kept((evaluate(path, step), evaluate(path, turning)))
    lands = lanes.moves & (jnp.minimum(end, extreme) < 0)
    lands, latest = kept((lands, jnp.where(extreme < 0, turning, step)))
    flight = kept(jnp.where(lands, _landing(path, lands, latest), step))
    speed = kept(evaluate(slope, flight))
    lean = kept(jnp.where(lands, 0, evaluate(path, flight)))
    peak = kept(jnp.maximum(lean, jnp.where(turning < flight, extreme, 0)))

    # Impact, and rest if the bounces left are over in no time, or are nothing.
    leaving = case.restitution * jnp.abs(speed)
    lift_then = evaluate(lift, flight) if lift else 0.0
    onward = equation.lean_acceleration(*case.foot, -evaluate(push, flight), lift_then)
    onward, leaving = kept((onward, leaving))
    negligible = 1e-6 if dtype == jnp.float64 else 1e-4
    lost = -negligible * onward * (1 - case.restitution)
    over_soon = 2 * _LONGEST * leaving <= lost * case.longest
    nothing = leaving <= _tiny(dtype) * equation.critical_velocity
    level = onward <= 2 * _tiny(dtype) * equation.square * case.foot[0]
    settles = kept(lands & (over_soon | (nothing & level)))

    over = peak >= 0.5 * jnp.pi
    arrives = jnp.where(lanes.moves, ~lands & (step >= left), ~lifted)
    ended = (arrives & ~(stop >= length)) | (
        lanes.moves & (over | (lanes.turns >= most_turns(grid)))
    )
    cell = jnp.where(arrives, lanes.cell + 1, lanes.cell)
    cell = jnp.where(lanes.moves | lifted, cell, grid.next_cell(case.first, cell, case.grade))
    lean = jnp.where(lanes.moves, lean, lanes.lean)
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
            moves=jnp.where(lanes.moves, ~(settles | ended), lifted),
            peak=jnp.where(lanes.moves, jnp.maximum(lanes.peak, peak), lanes.peak),
            impacts=lanes.impacts + lands,
            turns=lanes.turns + lanes.moves,
            fate_lean=jnp.where(acts, lean, lanes.fate_lean),
            fate_speed=jnp.where(acts, speed, lanes.fate_speed),
        )
    )
