"""The worst train of pulses, found by optimisation."""

import math
from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .arguments import (
    NON_NEGATIVE,
    POSITIVE,
    UNIT_INTERVAL,
    Number,
    as_real,
    check,
    of_one_precision,
)
from .block import Block
from .free import FreeRocking, Linearized
from .progress import with_clock
from .train import Flight, Rocker, TrainResponse, follow

Goal = Literal["smallest largest", "smallest total", "most rotation"]

_SKIPS = 3  # impacts between two pulses, at most, as long as they need not be apart
_MANY_SKIPS = 20  # if they have to
_STEPS = 40  # of BFGS at a time
_ROUNDS = 30  # of corrections to strength and multipliers
_TURNS = 8  # of moves that are tried, of those that look good
_LENGTHS = 3.0 * 0.35 ** np.arange(9)  # of a step, over Newton's
_ENOUGH = 1e-9  # relative improvement that is none
_PRESSURE = 30.0  # of a train that takes too long
_HARD = 300.0  # of a half-cycle that ends before the pulse may come


class Train(NamedTuple):
    """A train as it is optimised; the first pulse starts the motion.

    `phase` says where a pulse comes in what is left of its half-cycle: 0 as early as it may,
    1 at the impact; in between, the cosine of the phase of the flight is what falls like
    the cosine of pi times it, since the energy after the pulse is linear in that. `skips` is
    how many impacts lie between a pulse and the one before, `weight` its intensity over the
    bound on it, outward positive.
    """

    phase: Any  # (pulses,)
    weight: Any  # (pulses,)
    skips: Any  # (pulses,) whole numbers


class _Outcome(NamedTuple):
    x: Any  # in the end; after the impact, if the block moves towards one
    times: Any  # (pulses,)
    sides: Any  # (pulses,) on which the block is struck
    late: Any  # (pulses,) time since the impact, in half-cycles
    lacking: Any  # (pulses,) by how much the half-cycle ends before the pulse may come [s]
    required: Any  # (pulses,) impacts within the spacing


class _Search(NamedTuple):
    """One start: what is optimised, and how far that got."""

    angles: Any  # (pulses,) pi times the phase
    sizes: Any  # (pulses,) what gives the weights
    strength: Any  # logarithm of the bound on the pulses, over `Rocker.unit`
    skips: Any  # (pulses,)
    length: Any  # pulses of the train, the others are left out
    multipliers: Any  # (pulses,) of the constraints
    loss: Any
    slope: Any  # largest component of its gradient
    ended: Any  # whether nothing is left to correct


class _Limits(NamedTuple):
    spacing: Any  # [s]
    latest: Any  # [s]


def shot(
    rocker: Rocker,
    train: Train,
    strength: Any,
    *,
    timed: bool,
    spacing: Any = 0.0,
    length: Any = None,
    most: int = _SKIPS,
) -> _Outcome:
    """What a train does, with the bound on its pulses over `Rocker.unit`.

    Without the times, which cost most of it, if these are not asked for; then `spacing`,
    before which no pulse comes after the one before it [s], does not count. At most `most`
    impacts lie between two pulses; from the pulse `length` on, none is counted.
    """
    impulses = strength * train.weight
    rate = rocker.block.frequency_parameter
    number = jnp.arange(most + 1)
    powers = rocker.restitution ** number.astype(impulses.dtype)

    def pulse(carry: Any, each: Any) -> Any:
        phase, impulse, skips, counts = each
        flight, ground, time, side = carry
        again = skips == 0
        xs = flight.x * powers
        x = jnp.where(number == skips, xs, 0).sum()
        moves = x > 0
        earliest = jnp.where(again & moves, flight.q / jnp.where(moves, x, 1), 1)
        passed = late = lacking = last = jnp.zeros_like(x)
        required = jnp.zeros_like(skips)
        if timed:
            whole = rocker.duration(xs)
            launched = jnp.where(flight.q < 0, whole[0] - ground, ground)
            last = jnp.where(number == skips, whole, 0).sum()
            # From the pulse before to the launch of this flight, and from that on.
            passed = jnp.where(number < skips, whole, 0).sum() - launched
            wait = spacing - passed
            lacking = wait - last
            held = wait > jnp.where(again, launched, 0)
            inside = held & (lacking < 0) & moves
            fast = jnp.where(inside, x, 0.5)
            timed_at = jnp.where(inside, wait, 0.1 / rate), jnp.where(inside, last, 1 / rate)
            cosine = rocker.velocity_at(fast, *timed_at) / fast
            earliest = jnp.where(inside, cosine, jnp.where(held & moves, -1, earliest))
            required = (jnp.cumsum(whole) - launched < spacing).sum()
        # 1 + cosine and 1 - cosine of the phase of the flight.
        rise = (1 + earliest) * jnp.cos(0.5 * jnp.pi * phase) ** 2
        fall = (1 - earliest) + (1 + earliest) * jnp.sin(0.5 * jnp.pi * phase) ** 2
        inside = rise * fall > 0
        drop = x * jnp.where(inside, jnp.sqrt(jnp.where(inside, rise * fall, 1)), 0)
        there = Flight(drop, x * (rise - 1))
        struck = rocker.struck(there, impulse)
        ground_after = ground
        if timed:
            # Both at once, since to have each compiled for itself takes long.
            both = jax.tree.map(lambda *parts: jnp.stack(parts), there, struck)
            since, ground_after = rocker.ground_time(both)
            since = jnp.where(there.q < 0, last - since, since)
            time_after = time + passed + since
            late = since / jnp.where(last > 0, last, 1)
        else:
            time_after = time
        after = (struck, ground_after, time_after, jnp.where(skips % 2 == 1, -side, side))
        carry = jax.tree.map(lambda new, old: jnp.where(counts, new, old), after, carry)
        lacking = jnp.where(counts, lacking, -1)
        return carry, (carry[2], carry[3], late, lacking, required)

    first, zero = jnp.abs(impulses[0]), jnp.zeros_like(impulses[0])
    begin = (Flight(zero, first), zero, zero, zero + 1)
    counts = jnp.arange(1, impulses.size) < (impulses.size if length is None else length)
    (flight, *_), later = jax.lax.scan(
        pulse, begin, (train.phase[1:], impulses[1:], train.skips[1:], counts)
    )
    x = jnp.where(flight.q < 0, rocker.restitution * flight.x, flight.x)
    before = (zero, zero + 1, zero, zero - 1, jnp.zeros((), train.skips.dtype))
    return _Outcome(
        x, *(jnp.append(b, a.astype(b.dtype)) for b, a in zip(before, later, strict=True))
    )


def _train_of(search: _Search, goal: Goal) -> Train:
    """A train from free variables: at its best, the slope to each of them is 0.

    Weights are at most 1 each, or 1 together where the total counts.
    """
    sizes = search.sizes
    if goal == "smallest total":
        counted = jnp.where(jnp.arange(sizes.size) < search.length, sizes, 0)
        weight = counted * jnp.abs(counted) / (counted**2).sum()
    else:
        weight = jnp.sin(sizes)
    return Train(search.angles / jnp.pi, weight, search.skips)


class _Question(NamedTuple):
    """What is asked of every start alike."""

    rocker: Rocker
    limits: _Limits | None
    goal: Goal
    most: int

    def loss(self, free: Any, search: _Search) -> tuple[Any, tuple[_Outcome, Any]]:
        """Minus the logarithm of the final velocity, and what broken constraints add to it."""
        search = _with(search, free)
        limits, rate = self.limits, self.rocker.block.frequency_parameter
        outcome = shot(
            self.rocker,
            _train_of(search, self.goal),
            jnp.exp(search.strength),
            timed=limits is not None,
            spacing=0.0 if limits is None else limits.spacing,
            length=search.length,
            most=self.most,
        )
        loss = -jnp.log(jnp.maximum(outcome.x, 1e-30))
        if limits is None:
            return loss, (outcome, jnp.zeros_like(search.multipliers))
        # Where positive, not kept.
        over = outcome.times[-1] - limits.latest
        broken = jnp.append(outcome.lacking[1:], over) * rate
        pressure = jnp.asarray([_HARD] * (broken.size - 1) + [_PRESSURE], broken.dtype)
        pressed = jnp.maximum(search.multipliers + pressure * broken, 0)
        added = (pressed**2 - search.multipliers**2) / (2 * pressure)
        return loss + added.sum(), (outcome, broken)


def _free(search: _Search) -> Any:
    return jnp.concatenate([search.angles, search.sizes, search.strength[None]])


def _with(search: _Search, free: Any) -> _Search:
    count = search.angles.size
    return search._replace(angles=free[:count], sizes=free[count : 2 * count], strength=free[-1])


class _Descent(NamedTuple):
    """Of BFGS: where it is, where it was evaluated last, and what was found there."""

    here: Any
    before: Any
    loss: Any
    slope: Any
    inverse: Any  # of the Hessian, as it is known
    outcome: Any
    broken: Any
    step: Any
    stuck: Any  # times in turn that no length of step led lower
    path: Any  # (_STEPS,)


def _descended(search: _Search, question: _Question, steps: Any) -> _Descent:
    """Some steps of BFGS at a given strength, until there is no slope."""
    free = _free(search)
    eps = jnp.finfo(free.dtype).eps
    eye = jnp.eye(free.size, dtype=free.dtype)
    fixed = jnp.arange(free.size) == free.size - 1

    def loss(free: Any) -> Any:
        return question.loss(free, search)

    def goes_on(state: _Descent) -> Any:
        slope = jnp.where(fixed, 0, state.slope)
        steep = (state.step == 0) | (abs(slope).max() > 8 * eps)
        return (state.step < steps) & steep & (state.stuck < 2)

    def step(state: _Descent) -> _Descent:
        (value, found), slope = jax.value_and_grad(loss, has_aux=True)(state.here)
        moved = state.here - state.before
        turned = jnp.where(fixed, 0, slope - state.slope)
        curvature = moved @ turned
        curved = curvature > eps * jnp.linalg.norm(moved) * jnp.linalg.norm(turned)
        scale = 1 / jnp.where(curved, curvature, 1)
        side = eye - scale * jnp.outer(moved, turned)
        updated = side @ state.inverse @ side.T + scale * jnp.outer(moved, moved)
        inverse = jnp.where(curved & (state.step > 0), updated, state.inverse)
        downhill = jnp.where(fixed, 0, slope)
        towards = -inverse @ downhill
        descends = (towards @ downhill < 0) & jnp.isfinite(towards).all()
        inverse = jnp.where(descends, inverse, eye)
        towards = jnp.where(descends, towards, -downhill)
        # No further than a radian.
        towards = towards / jnp.maximum(abs(towards).max(), 1)
        lengths = jnp.asarray(_LENGTHS, free.dtype)
        tried = state.here[None] + lengths[:, None] * towards[None]
        values = jax.vmap(lambda free: loss(free)[0])(tried)
        values = jnp.where(jnp.isfinite(values), values, jnp.inf)
        k = values.argmin()
        lower = values[k] < value
        there = jnp.where(lower, tried[k], state.here)
        # The second time straight down.
        inverse = jnp.where(lower, inverse, eye)
        stuck = jnp.where(lower, 0, state.stuck + 1)
        path = jnp.where(jnp.arange(_STEPS) >= state.step, value, state.path)
        outcome, broken = found
        count = state.step + 1
        return _Descent(
            there, state.here, value, slope, inverse, outcome, broken, count, stuck, path
        )

    zero = jnp.zeros_like(free[0])
    shapes = jax.eval_shape(loss, free)[1]
    outcome, broken = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)
    path, none = jnp.zeros(_STEPS, free.dtype), jnp.zeros((), int)
    begin = _Descent(free, free, zero, 0 * free, eye, outcome, broken, none, none, path)
    return jax.lax.while_loop(goes_on, step, begin)


@eqx.filter_jit
def _solve(
    searches: _Search, question: _Question, rounds: Any, steps: Any
) -> tuple[_Search, Any, Any]:
    """Descents, each followed by a correction of strength and multipliers.

    Also by how much constraints are broken in the end, and the loss in each step of the
    first descent.
    """
    return jax.vmap(lambda search: _solved(search, question, rounds, steps))(searches)


def _solved(
    search: _Search, question: _Question, rounds: Any, steps: Any
) -> tuple[_Search, Any, Any]:
    eps = jnp.finfo(search.angles.dtype).eps
    seeks, count = question.goal != "most rotation", search.angles.size
    # Of what is corrected: with constraints, as exactly as the descents end.
    free = question.limits is None
    near, steady = (8 * eps, jnp.inf) if free else (0.01 * eps**0.5, 10 * eps**0.5)

    def goes_on(carry: Any) -> Any:
        search, _, _, number, *_ = carry
        return ~search.ended & (number < rounds)

    def one(carry: Any) -> Any:
        search, _, path, number, lowest, highest = carry
        # Off the ends of the half-cycles, where the slope is 0 whatever is broken.
        pushed = (number > 0) & (search.loss > eps**0.5) & (question.limits is not None)
        folded = jnp.arccos(jnp.cos(search.angles))
        angles = jnp.where(pushed, jnp.clip(folded, 0.1, jnp.pi - 0.1), folded)
        descent = _descended(search._replace(angles=angles), question, steps)
        search = _with(search, descent.before)
        # By the envelope theorem, the loss at its best changes with the strength like that.
        gain = jnp.clip(-descent.slope[-1], 0.3, 1e4)
        short = -jnp.log(jnp.maximum(descent.outcome.x, 1e-30))
        change = jnp.clip(short / gain, -1, 1)
        # A flight that ends too early is that of too weak a train.
        early = (descent.broken[:-1] > 1e-3).any()
        lowest = jnp.where(early | (short > 0), jnp.maximum(lowest, search.strength), lowest)
        highest = jnp.where(early | (short > 0), highest, search.strength)
        outside = search.strength + change
        outside = (outside <= lowest) | (outside >= highest)
        halved = early | (outside & (lowest > -40) & (highest - lowest > 1e-6))
        halfway = 0.5 * (lowest + highest) - search.strength
        change = jnp.where(halved, halfway, change) if seeks else 0 * change
        pressure = jnp.asarray([_HARD] * (count - 1) + [_PRESSURE], search.loss.dtype)
        multipliers = jnp.maximum(search.multipliers + pressure * descent.broken, 0)
        if question.limits is None:
            multipliers = search.multipliers
        multipliers = jnp.where(early & seeks, 0, multipliers)
        still = abs(multipliers - search.multipliers).max() < steady
        slope = abs(descent.slope[:-1]).max()
        search = search._replace(
            strength=search.strength + change,
            multipliers=multipliers,
            loss=descent.loss,
            slope=slope,
            ended=(abs(change) < near) & still,
        )
        path = jnp.where(number == 0, descent.path, path)
        return search, descent.broken.max(), path, number + 1, lowest, highest

    zero = jnp.zeros_like(search.loss)
    begin = (
        search._replace(ended=zero > 1),
        zero,
        jnp.zeros(_STEPS, zero.dtype),
        jnp.zeros((), int),
        zero - 50,
        jnp.maximum(search.strength, 0) + 0.1,
    )
    search, broken, path, *_ = jax.lax.while_loop(goes_on, one, begin)
    return search, broken, path


@eqx.filter_jit
def _outcomes(searches: _Search, question: _Question) -> _Outcome:
    def outcome(search: _Search) -> _Outcome:
        limits = question.limits
        return shot(
            question.rocker,
            _train_of(search, question.goal),
            jnp.exp(search.strength),
            timed=True,
            spacing=0.0 if limits is None else limits.spacing,
            length=search.length,
            most=question.most,
        )

    return jax.vmap(outcome)(searches)


def _moved(searches: _Search, fewest: int, question: _Question) -> list[_Search]:
    """Each pulse put to where descent does not lead: there are valleys between."""
    parts = (searches.angles, searches.sizes, searches.skips)
    start, end = 0.3, np.pi - 0.3  # of a half-cycle; at its very ends nothing has a slope

    def skipping(k: int, by: int, angle: float | None = None) -> Any:
        def change(angles: Any, sizes: Any, skips: Any) -> None:
            skips[:, k] = np.clip(skips[:, k] + by, fewest, question.most)
            if angle is not None:
                angles[:, k] = angle
                sizes[:, k] = abs(sizes[:, k]) * (1 if angle < 0.5 * np.pi else -1)

        return change

    def soon(k: int, by: int, angle: float) -> Any:
        def change(angles: Any, sizes: Any, skips: Any) -> None:
            # The first that the spacing allows, or the one after that.
            skips[:, k] = np.clip(required[:, k] + by, fewest, question.most)
            angles[:, k] = angle
            sizes[:, k] = abs(sizes[:, k]) * (1 if angle == start else -1)

        return change

    def other_way(k: int, mirrored: bool) -> Any:
        def change(angles: Any, sizes: Any, skips: Any) -> None:
            sizes[:, k] *= -1
            if mirrored:
                angles[:, k] = np.pi - angles[:, k]

        return change

    changes: list[list[Any]] = []
    last = searches.angles.shape[1] - 1
    limited = question.limits is not None
    required = np.asarray(_outcomes(searches, question).required) if limited else searches.skips
    for k in range(1, last + 1):
        changes += [
            [other_way(k, False)],
            [other_way(k, True)],
            [skipping(k, 1)],
            [skipping(k, -1)],
        ]
        if limited:
            changes += [[skipping(k, by, start)] for by in (-1, 0, 1)]
            changes += [[skipping(k, by, end)] for by in (-1, 0)]
            changes += [[soon(k, by, angle)] for by, angle in ((0, start), (0, end), (1, start))]
        if limited and k < last:
            # What comes earlier after one pulse, comes later after the next, and so on.
            changes += [
                [skipping(k, this, start), skipping(k + 1, next, start)]
                for this in (-1, 1)
                for next in (-1, 1)
            ]
    found = []
    for each in changes:
        new = [np.array(part) for part in parts]
        for change in each:
            change(*new)
        found.append(searches._replace(**dict(zip(("angles", "sizes", "skips"), new, strict=True))))
    if limited and last:
        found.append(searches._replace(length=np.maximum(searches.length - 1, 1)))
    return found


class WorstTrain(NamedTuple):
    """The worst train of pulses that was found; see `worst_train`.

    Attributes
    ----------
    times : ndarray, shape (pulses,)
        When the pulses come, the first at 0 [s].
    intensities : ndarray, shape (pulses,)
        I of each [m/s], signed as the ground moves.
    impacts_between : ndarray of int, shape (pulses,)
        Impacts between a pulse and the one before it.
    delays : ndarray, shape (pulses,)
        Time from the last impact to the pulse, over the half-cycle that it falls into [-].
    largest, total : float
        Largest and total magnitude of the pulses [m/s].
    peak_rotation : float
        After the last pulse [rad]; NaN if the block overturns.
    overturns : bool
        Whether it is on the verge of overturning, or beyond.
    converged : bool
        Whether the search came to an end, at a train that keeps the constraints.
    objectives : ndarray, shape (starts,)
        What each start arrived at: the largest or total intensity [m/s], or the velocity
        after the last pulse over the critical one.
    history : ndarray, shape (starts, steps)
        The same in each step of the descent.
    goal : str
        What was sought.
    """

    times: np.ndarray
    intensities: np.ndarray
    impacts_between: np.ndarray
    delays: np.ndarray
    largest: float
    total: float
    peak_rotation: float
    overturns: bool
    converged: bool
    objectives: np.ndarray
    history: np.ndarray
    goal: str

    def __str__(self) -> str:
        lines = [
            f"{self.goal}: largest pulse {self.largest:.5g} m/s, together {self.total:.5g} m/s,"
            + (" overturns" if self.overturns else f" peak rotation {self.peak_rotation:.6g} rad")
            + ("" if self.converged else ", NOT converged"),
            "  time [s]  intensity [m/s]  after impact [half-cycles]",
        ]
        lines += [
            f"{time:10.4f}  {intensity:15.5g}  {round(float(delay), 5) + 0.0:.5f}"
            for time, intensity, delay in zip(
                self.times, self.intensities, self.delays, strict=True
            )
        ]
        return "\n".join(lines)


@with_clock("worst train")
def worst_train(
    block: Block,
    restitution: Number,
    count: int,
    goal: Goal = "smallest largest",
    *,
    largest: float | None = None,
    impacts_between: int = 1,
    spacing: float = 0.0,
    latest: float = math.inf,
    model: FreeRocking = Linearized(),
    starts: int = 10,
    seed: int = 0,
) -> WorstTrain:
    """The worst train of instantaneous pulses, over their times, signs and intensities.

    Between the pulses the block moves freely, and through impacts. From random trains, each
    descends by L-BFGS (optax) and then tries what descent cannot do: to strike a pulse the
    other way, before or after the peak, or a half-cycle earlier or later.

    Parameters
    ----------
    block, restitution : Block, float
        One block and its C [-], between 0 and 1.
    count : int
        Number of pulses, at least 1.
    goal : str
        ``"smallest largest"``: overturn the block with the smallest largest pulse;
        ``"smallest total"``: with the smallest sum of magnitudes; ``"most rotation"``: the
        highest peak with pulses of at most `largest`.
    largest : float, optional
        Bound on the pulses [m/s] for ``"most rotation"``.
    impacts_between : int
        Fewest impacts between a pulse and the next, 0 to 3. With 0 and no spacing the worst
        is that all come at once.
    spacing : float
        Shortest time between a pulse and the next [s].
    latest : float
        When the last pulse comes at the latest, after the first [s].
    model : Linearized or Nonlinear
        Equation of the motion between the pulses.
    starts : int
        Number of random trains to start from.
    seed : int
        Of the random numbers.

    Returns
    -------
    WorstTrain
        The best of all starts, and what each arrived at.

    Raises
    ------
    ValueError
        If an argument is outside of what is allowed, or the constraints contradict each
        other.

    Notes
    -----
    With one impact between pulses the paper's input comes out: equal pulses right after the
    impacts, each ``critical_intensity(block, restitution, count)``. The smallest total is
    that of a single pulse: every impact wastes a part of what came before.

    Examples
    --------
    >>> import jaxrock as jr
    >>> print(jr.worst_train(jr.Block(0.4, 5.0), 0.7, 3))
    smallest largest: largest pulse 0.47477 m/s, together 1.4243 m/s, overturns
      time [s]  intensity [m/s]  after impact [half-cycles]
        0.0000          0.47477  0.00000
        0.5192         -0.47477  0.00000
        1.6100          0.47477  0.00000
    """
    restitution = as_real("restitution", restitution)
    check("restitution", restitution, UNIT_INTERVAL)
    block.check()
    for name, value, low in (("count", count, 1), ("starts", starts, 1)):
        if value < low:
            raise ValueError(f"{name} must be at least {low}, got {value}")
    if goal not in ("smallest largest", "smallest total", "most rotation"):
        raise ValueError(
            f"goal must be smallest largest, smallest total or most rotation, got {goal!r}"
        )
    if (largest is None) == (goal == "most rotation"):
        raise ValueError('largest must be given for the goal "most rotation", and only for it')
    if not 0 <= impacts_between <= _SKIPS:
        raise ValueError(f"impacts_between must be from 0 to {_SKIPS}, got {impacts_between}")
    check("spacing", as_real("spacing", spacing), NON_NEGATIVE)
    if not latest >= 0:
        raise ValueError(f"latest must be at least 0, got {latest:g}")
    if (count - 1) * spacing > latest:
        raise ValueError(
            f"count, spacing and latest contradict each other: {count} pulses {spacing:g} s"
            f" apart take {(count - 1) * spacing:g} s, which is more than {latest:g} s"
        )
    block, restitution = of_one_precision((block, restitution))
    dtype = restitution.dtype
    if any(jnp.ndim(leaf) for leaf in jax.tree.leaves((block, restitution))):
        raise ValueError("block and restitution must be one, not arrays")
    rocker = Rocker(block, restitution, model)
    unit = float(rocker.unit)
    limited = spacing > 0 or latest < math.inf
    # A constraint that is not there must not be infinite.
    far = min(latest, 1e6 * count / float(block.frequency_parameter))
    limits = _Limits(jnp.asarray(spacing, dtype), jnp.asarray(far, dtype)) if limited else None
    if largest is not None:
        check("largest", as_real("largest", largest), POSITIVE)
        strength = largest / unit
    else:
        strength = 0.5 if goal == "smallest total" else 0.9 / count

    random = np.random.default_rng(seed)
    shape, most = (starts, count), _MANY_SKIPS if spacing > 0 else _SKIPS
    # A weak train comes to rest where a stronger one has its impacts just in time.
    strengths = np.full(starts, strength)
    if spacing > 0 and goal == "smallest largest":
        strengths = np.geomspace(strength, 0.97, starts)
    skips = random.integers(impacts_between, min(impacts_between + 2, _SKIPS) + 1, shape)
    searches = _Search(
        angles=random.uniform(0, np.pi, shape).astype(dtype),
        sizes=random.uniform(-1.5, 1.5, shape).astype(dtype),
        strength=np.log(strengths).astype(dtype),
        skips=skips,
        length=np.full(starts, count),
        multipliers=np.zeros(shape, dtype),
        loss=np.zeros(starts, dtype),
        slope=np.zeros(starts, dtype),
        ended=np.zeros(starts, bool),
    )
    question = _Question(rocker, limits, goal, most)
    searches, history = _searched(searches, question, impacts_between)
    if latest < math.inf:
        searches, question = _with_time_to_try(searches, question, spacing, latest)
    return _result(searches, question, history, spacing, latest)


def _searched(searches: _Search, question: _Question, fewest: int) -> tuple[_Search, np.ndarray]:
    """The best that every start leads to, and the objective on the way."""
    seeks = question.goal != "most rotation"
    unit, count = float(question.rocker.unit), searches.angles.shape[1]
    history: list[np.ndarray] = []

    def solved(option: _Search, rounds: int = _ROUNDS) -> tuple[_Search, np.ndarray, np.ndarray]:
        found, broken, losses = jax.device_get(
            _solve(option, question, *(jnp.asarray(n) for n in (rounds, _STEPS)))
        )
        # Nearly what a train needs, which is in proportion to the velocity it leads to.
        with np.errstate(over="ignore"):
            path = np.exp(option.strength[:, None] + losses) * unit if seeks else np.exp(-losses)
        return found, broken, path

    def later(searches: _Search) -> Any:
        # Right before an impact a pulse does as much as right after the one before, later.
        return 10 * _ENOUGH * (np.sin(0.5 * searches.angles[:, 1:]) ** 2).sum(axis=1)

    def rank(searches: _Search, broken: np.ndarray) -> Any:
        reached = searches.strength if seeks else searches.loss
        kept = broken < _tolerance(searches)
        return np.nan_to_num(np.where(kept, reached, 100 + broken), nan=np.inf) + later(searches)

    if question.limits is not None:
        for _ in range(count):
            required = np.asarray(_outcomes(searches, question).required)
            skips = np.clip(np.maximum(searches.skips, required), None, question.most)
            if (skips == searches.skips).all():
                break
            searches = searches._replace(skips=skips)
    searches, broken, path = solved(searches)
    history.append(path)
    each = np.arange(broken.size)
    for _ in range(8 * count):
        # Of starts that keep no constraint yet, the multipliers only grow.
        kept = broken < _tolerance(searches)
        begin = searches._replace(multipliers=np.where(kept[:, None], searches.multipliers, 0))
        options = [solved(option, 1)[0] for option in _moved(begin, fewest, question)]
        if not options:
            break
        # Of the best at the same strength and multipliers, several in turn are solved.
        ranks = np.stack([np.nan_to_num(o.loss, nan=np.inf) + later(o) for o in options])
        least = np.where(kept, searches.loss + later(searches), np.inf)
        order = ranks.argsort(axis=0)
        better = np.zeros(broken.size, bool)
        for turn in range(min(_TURNS, len(options))):
            hopeful = ~better & (ranks[order[turn], each] < least - _ENOUGH)
            if not hopeful.any():
                break

            picked = jax.tree.map(lambda *of: np.stack(of)[order[turn], each], *options)  # noqa: B023
            picked = picked._replace(strength=begin.strength, multipliers=begin.multipliers)
            candidates = _where(hopeful, picked, searches)
            found, found_broken, path = solved(candidates)
            gained = hopeful & (rank(found, found_broken) < rank(searches, broken) - _ENOUGH)
            better |= gained
            searches = _where(gained, found, searches)
            broken = np.where(gained, found_broken, broken)
            if gained.any():
                history.append(np.where(gained[:, None], path, history[-1][:, -1:]))
        if not better.any():
            break
    return searches, np.concatenate(history, axis=1)


def _with_time_to_try(
    searches: _Search, question: _Question, spacing: float, latest: float
) -> tuple[_Search, _Question]:
    """The same searches, ended so early that the best train may be raised to try it.

    The impacts of a train that is raised come later: by how much depends on the train, and
    any time more than that would make the pulses larger than need be.
    """
    rate, trial = float(question.rocker.block.frequency_parameter), _trial(searches.angles.dtype)
    # As exactly as the multipliers keep the limit; the hairs of `_proved` come on top.
    inexact = _tolerance(searches) / (_PRESSURE * rate)
    for _ in range(3):
        best = _best(searches, question)
        ends = [
            np.asarray(_outcomes(searches._replace(strength=strength), question).times)[best, -1]
            for strength in (searches.strength, searches.strength + 1.01 * trial)
        ]
        if ends[1] <= latest:
            break
        far = max(latest - (ends[1] - ends[0]) - inexact, (searches.angles.shape[1] - 1) * spacing)
        limits = question.limits._replace(latest=jnp.asarray(far, searches.angles.dtype))
        question = question._replace(limits=limits)
        found = _solve(searches, question, *(jnp.asarray(n) for n in (_ROUNDS, _STEPS)))
        searches = jax.device_get(found[0])
    return searches, question


def _where(condition: np.ndarray, ones: _Search, others: _Search) -> _Search:
    """Start by start."""

    def chosen(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        return np.where(condition.reshape(-1, *(1,) * (one.ndim - 1)), one, other)

    return jax.tree.map(chosen, ones, others)


def _tolerance(searches: _Search) -> float:
    """Of constraints, times the frequency parameter."""
    return 10 * float(np.finfo(searches.angles.dtype).eps) ** 0.5


def _reached(
    searches: _Search, question: _Question
) -> tuple[_Outcome, np.ndarray, np.ndarray, np.ndarray]:
    """What trains do, their pulses, what they come to, and whether they keep the constraints."""
    outcome = jax.device_get(_outcomes(searches, question))
    kept = outcome.lacking.max(axis=1) * float(question.rocker.block.frequency_parameter)
    kept = kept < _tolerance(searches)
    if question.limits is not None:
        kept &= outcome.times[:, -1] < float(question.limits.latest) + _tolerance(searches)
    weights = np.asarray(jax.vmap(lambda search: _train_of(search, question.goal).weight)(searches))
    magnitudes = np.exp(searches.strength)[:, None] * weights * float(question.rocker.unit)
    magnitudes[:, 0] = abs(magnitudes[:, 0])
    counted = np.arange(weights.shape[1]) < searches.length[:, None]
    if question.goal == "smallest largest":
        objectives = np.where(counted, abs(magnitudes), 0).max(axis=1)
    elif question.goal == "smallest total":
        objectives = np.where(counted, abs(magnitudes), 0).sum(axis=1)
    else:
        objectives = outcome.x
    return outcome, magnitudes, objectives, kept


def _best(searches: _Search, question: _Question) -> int:
    """Which start came to the best train."""
    _, _, objectives, kept = _reached(searches, question)
    sign = -1 if question.goal == "most rotation" else 1
    return int(np.argmin(np.where(kept, sign * objectives, np.inf)))


def _result(
    searches: _Search, question: _Question, history: np.ndarray, spacing: float, latest: float
) -> WorstTrain:
    rocker, goal = question.rocker, question.goal
    seeks = goal != "most rotation"
    outcome, magnitudes, objectives, kept = _reached(searches, question)
    best = _best(searches, question)
    length = int(searches.length[best])
    intensities = (outcome.sides * magnitudes)[best, :length]
    overturns = seeks or bool(outcome.x[best] >= 1)
    top = Flight(jnp.asarray(outcome.x[best]), jnp.zeros_like(outcome.x[best]))
    peak = math.nan if overturns else float(rocker.lean(top))
    times, proved = _proved(searches, question, best, intensities, peak)
    limits_kept = (np.diff(times) >= spacing * (1 - 1e-9)).all() and times[-1] <= latest
    within = (searches.skips[best, 1:length] < _MANY_SKIPS).all()
    return WorstTrain(
        times=times,
        intensities=intensities,
        impacts_between=np.append(0, searches.skips[best, 1:length]),
        delays=outcome.late[best, :length],
        largest=float(abs(intensities).max()),
        total=float(abs(intensities).sum()),
        peak_rotation=peak,
        overturns=overturns,
        converged=bool(kept[best] and searches.ended[best] and proved and limits_kept and within),
        objectives=np.where(kept, objectives, np.nan),
        history=history,
        goal=goal,
    )


def _proved(
    searches: _Search, question: _Question, best: int, intensities: np.ndarray, peak: float
) -> tuple[np.ndarray, bool]:
    """When the pulses come, and whether that train does, followed over time, what it is to.

    It is tried raised and lowered by a little, each time in the rhythm of its own impacts,
    since these come later in a stronger train, and a pulse on the wrong side of an impact
    acts the other way. The times are those of the train that is raised, a hair later where
    a pulse comes right after an impact, a hair earlier where it comes right before.
    """
    rocker, trial = question.rocker, _trial(searches.angles.dtype)
    before = np.cos(searches.angles[best]) < 0

    def followed(by: float, margin: float) -> tuple[np.ndarray, TrainResponse]:
        hairs = (
            _outcomes(searches._replace(strength=searches.strength + by + hair), question)
            for hair in (-margin, margin)
        )
        times = np.where(before, *(np.asarray(outcome.times)[best] for outcome in hairs))
        times = np.maximum.accumulate(times)[: intensities.size]
        raised = jnp.asarray(intensities * (1 + by))
        return times, follow(rocker, jnp.asarray(times), raised)

    times, proved = np.zeros(0), False
    for margin in (1e-4 * trial, 1e-3 * trial, 1e-2 * trial, 1e-1 * trial):
        times, higher = followed(trial, margin)
        _, lower = followed(-trial, margin)
        if question.goal != "most rotation":
            proved = bool(higher.overturned) and not bool(lower.overturned)
        elif math.isnan(peak):
            proved = bool(higher.overturned)
        else:
            proved = float(lower.peak_rotation) <= peak <= float(higher.peak_rotation)
        if proved:
            break
    return times, proved


def _trial(dtype: Any) -> float:
    """By how much a train is raised and lowered to try it."""
    return max(1e-6, float(np.finfo(dtype).eps) ** 0.5)
