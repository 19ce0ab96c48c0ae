"""The search for the worst train: gradient steps, moves to other half-cycles, and a polish.

Many trains descend by gradient steps in one compiled program. The steps are those of resilient
backpropagation (Riedmiller and Braun 1993, https://doi.org/10.1109/ICNN.1993.298623), as optax
has it: each number goes by a length of its own, which grows while the sign of its derivative
stays and shrinks when it changes. Most numbers of a worst train lie at their bounds, which such
steps reach exactly. SciPy's sequential quadratic programming (SLSQP; Kraft 1994,
https://doi.org/10.1145/192115.192124) brings the trains that were found to the last digits.
"""

import functools
import warnings
from collections.abc import Iterator, Sequence
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..validation import Booleans, Integers, Reals
from .rocker import Rocker
from .train_through_impacts import Outcome, Train, follow_phased_train

Goal = Literal["smallest largest", "smallest total", "most rotation"]

MOST_IMPACTS = 3  # between two pulses, as long as they need not be apart
_MOST_IMPACTS_APART = 20
_TRAINS = 16  # in a program
_STEPS = 50  # of a descent, far more than most take
_FIRST_STEP = 0.1
_LARGEST_STEP = 0.5
_LEAST_RISE = 0.1  # smallest d(log x) / d(log bound) that is used; it is about 1
_LARGEST_CORRECTION = 0.5  # of the logarithm of the bound, in one step
_LATENESS_WEIGHT = 3.0  # of times the frequency parameter, in the loss
# Range of the logarithm of the bound. Over 0 even the first pulse overturns the block. The
# block is followed as if it came back nevertheless, so that a descent always has somewhere to
# begin from which the block overturns.
_RANGE = (-20.0, 5.0)
# Phases of a pulse early and late in its half-cycle. No descent begins closer to the ends,
# where the slope is 0: the energy depends on the cosine of pi times the phase.
_EARLY = 0.1
_LATE = 0.9
_LEAST_MOVED = 0.1  # size over the bound: of a pulse of size 0 the phase has no slope
_NO_GAIN = 1e-9  # improvements up to this are rounding


class TrainProblem(NamedTuple):
    """The problem that a search solves: the block, the goal and the limits.

    Attributes
    ----------
    rocker
        The block.
    seeks_pulses, seeks_total
        Whether the smallest pulses are sought, not the highest peak; and the smallest total.
    largest
        Bound on the pulses over `Rocker.unit` [-]; 1 unless given.
    fewest_impacts
        Fewest impacts between two pulses.
    spacing, latest
        Shortest time between two pulses, and latest time of the last [s].
    tolerance
        Violation of a constraint, or difference of losses, that counts as none.
    raise_by, margin
        By how much the train is raised in the end, as a logarithm; and by how much more or less,
        to tell what comes after an impact or before.
    """

    rocker: Rocker
    seeks_pulses: Booleans | bool
    seeks_total: Booleans | bool
    largest: float
    fewest_impacts: int
    spacing: float
    latest: float
    tolerance: float
    raise_by: float
    margin: float

    @property
    def most_impacts(self) -> int:
        """Most impacts between two pulses."""
        # Waiting for more impacts than these only loses energy, unless the spacing asks for
        # it.
        return _MOST_IMPACTS_APART if self.spacing > 0 else MOST_IMPACTS


class Candidate(NamedTuple):
    """A train, and how good it is.

    Attributes
    ----------
    numbers
        Phases, pulses over the bound, and the logarithm of the bound, (2 pulses + 1,): the
        numbers that a descent changes.
    impacts
        Impacts between a pulse and the one before, (pulses,): only moves change them.
    used
        Number of pulses of the train; the others are left out.
    loss
        The number that is minimised.
    ended
        Whether the polish has ended by itself, with the constraint kept.
    """

    numbers: np.ndarray
    impacts: np.ndarray
    used: int
    loss: float = np.inf
    ended: bool = False

    @property
    def phases(self) -> np.ndarray:
        """Phases of the pulses in their half-cycles, see `Train`."""
        return self.numbers[: self.impacts.size]

    @property
    def weights(self) -> np.ndarray:
        """The pulses over the bound, outward positive."""
        return self.numbers[self.impacts.size : -1]

    @property
    def merit(self) -> float:
        """The number by which candidates are compared; lower is better.

        Of equally good trains the earlier one counts as better: a pulse right before an impact
        does as much as one right after the impact before.
        """
        # Heavier than `_NO_GAIN`, or a move to the earlier train would not count as a gain.
        lateness = (np.sin(0.5 * np.pi * self.phases[1:]) ** 2).sum()
        return float(self.loss + 10 * _NO_GAIN * lateness)

    @property
    def identity(self) -> tuple[int, bytes, float]:
        """A key that is equal for candidates with the same train."""
        return self.used, self.impacts.tobytes(), round(self.merit, 6)


class Evaluation(NamedTuple):
    """What a train does, with derivatives with respect to its numbers.

    Attributes
    ----------
    outcome
        The motion.
    values
        (pulses + 3,): the logarithm of the size of the pulses, or of the critical velocity over
        the velocity in the end, which is minimised; the logarithm of the latter velocity over
        the critical one, from 0 on the block overturns; what is left within the limits on the
        times of the raised train, times the frequency parameter [-].
    slopes
        Their derivatives, (pulses + 3, numbers).
    """

    outcome: Outcome
    values: Reals
    slopes: Reals


class Descended(NamedTuple):
    """The best train of a descent.

    Attributes
    ----------
    numbers
        The train, raised until it nearly just overturns the block.
    loss
        The number that is minimised, with a penalty for pulses that do not keep the limits.
    evaluation
        The evaluation of the train before it was raised.
    """

    numbers: Reals
    loss: Reals
    evaluation: Evaluation


class _Descent(NamedTuple):
    """Where a descent begins, its bounds, and its most steps; without steps it is padding.

    With more than one step, it first puts as many impacts between the pulses as the spacing takes.
    """

    numbers: Reals
    impacts: Integers
    comes: Booleans
    lows: Reals
    highs: Reals
    steps: Integers


class _State(NamedTuple):
    """A descent under way; `moved` is the largest change of a number in the last step."""

    step: Integers
    moved: Reals
    numbers: Reals
    impacts: Integers
    optimizer: Any
    best: Descended


def search(candidates: list[Candidate], problem: TrainProblem) -> list[Candidate]:
    """Find the best train that each candidate leads to, by descents and moves between them."""
    # Different starts come to the same trains, whose moves need not be tried again.
    best_after_move: dict[tuple, Candidate] = {}
    polished: dict[tuple, Candidate] = {}

    def make_best_move(candidate: Candidate, k: int) -> Candidate:
        """Move pulse k to where it leads to the best train, if that is better."""
        key = k, *candidate.identity
        if key not in best_after_move:
            moved = descend(list(_generate_moves(candidate, problem, k)), problem)
            if problem.spacing > 0 or problem.latest < np.inf:
                # Gradient steps stop where a limit is reached.
                best = sorted(moved, key=lambda end: end.merit)
                promising = 3 if problem.latest < np.inf else 1
                moved = [_polish(end, problem) for end in best[:promising]]
            best_after_move[key] = min(moved, key=lambda end: end.merit)
        gain = candidate.merit - best_after_move[key].merit
        return best_after_move[key] if gain > _NO_GAIN else candidate

    # state     | known                                      | next
    # descended | no train nearby, through the same impacts, | a pass: each pulse in turn makes
    #           | is better                                  | its best move, if that is better
    # improved  | the last pass has made it better           | another pass
    # settled   | the last pass has changed nothing          | ends, polished
    ends = []
    for candidate in descend(candidates, problem):
        before = np.inf
        while candidate.merit < before:
            before = candidate.merit
            for k in range(1, candidate.impacts.size):
                candidate = make_best_move(candidate, k)
        if candidate.identity not in polished:
            polished[candidate.identity] = _polish(candidate, problem)
        ends.append(polished[candidate.identity])
    return ends


def descend(candidates: Sequence[Candidate], problem: TrainProblem) -> list[Candidate]:
    """Find the best trains through the same impacts by gradient steps."""
    ends = []
    for first in range(0, len(candidates), _TRAINS):
        starts = []
        for candidate in candidates[first : first + _TRAINS]:
            numbers = np.clip(candidate.numbers, *_compute_bounds(candidate, problem))
            pulses = candidate.impacts.size
            numbers[:pulses] = np.clip(numbers[:pulses], _EARLY, _LATE)
            starts.append(candidate._replace(numbers=numbers))
        descended = _run_descents(starts, problem, _STEPS)
        for k, start in enumerate(starts):
            numbers = descended.numbers[k].astype(float)
            if problem.seeks_total:
                # Only the pulses count, not how they are split into a bound and weights.
                numbers[start.impacts.size : -1] *= np.exp(numbers[-1])
                numbers[-1] = 0
            ends.append(
                start._replace(
                    numbers=numbers,
                    impacts=descended.evaluation.outcome.impacts[k],
                    loss=float(descended.loss[k]),
                )
            )
    return ends


def evaluate(candidate: Candidate, problem: TrainProblem, raised: float = 0.0) -> Evaluation:
    """Evaluate a train whose pulses are raised by a factor exp(`raised`)."""
    numbers = np.append(candidate.numbers[:-1], candidate.numbers[-1] + raised)
    # By the program that is there already.
    descended = _run_descents([candidate._replace(numbers=numbers)], problem, 1)
    return jax.tree.map(lambda part: np.asarray(part[0], float), descended.evaluation)


def _run_descents(
    candidates: Sequence[Candidate], problem: TrainProblem, steps: int
) -> Descended:
    """Let at most `_TRAINS` trains descend."""
    dtype = problem.rocker.restitution.dtype
    rows = [
        (
            candidate.numbers.astype(dtype),
            candidate.impacts,
            np.arange(candidate.impacts.size) < candidate.used,
            *(bound.astype(dtype) for bound in _compute_bounds(candidate, problem)),
            steps,
        )
        for candidate in candidates
    ]
    # One program for any number of trains: the padding takes no step.
    rows += [(*rows[0][:-1], 0)] * (_TRAINS - len(rows))
    stacked = _Descent(*(jnp.asarray(np.stack(column)) for column in zip(*rows, strict=True)))
    return jax.device_get(_descend_all(stacked, problem, problem.most_impacts))


@functools.partial(jax.jit, static_argnames="most_impacts")
def _descend_all(descents: _Descent, problem: TrainProblem, most_impacts: int) -> Descended:
    """Improve trains by gradient steps, each until it has settled.

    The trains descend one after the other inside of the program. On a CPU that takes no longer
    per step than side by side, where all wait for the slowest, and compiles in two thirds of the
    time. With one step the same program evaluates a train.
    """
    import optax  # which only this needs

    optimizer = optax.rprop(_FIRST_STEP, max_step_size=_LARGEST_STEP)
    settled = float(jnp.finfo(descents.numbers.dtype).eps) ** 0.5

    def descend(descent: _Descent) -> Descended:
        """Improve one train."""

        def advance(state: _State) -> _State:
            """Go one step."""
            waits = (descent.steps > 1) & (state.step == 0)
            evaluation = _evaluate_train(
                state.numbers, state.impacts, descent.comes, waits, problem, most_impacts
            )
            loss, slope, excess = _reduce_loss(evaluation, problem)
            updates, optimizer_state = optimizer.update(slope, state.optimizer, state.numbers)
            moved_to = jnp.asarray(optax.apply_updates(state.numbers, updates))
            numbers = jnp.clip(moved_to, descent.lows, descent.highs)
            # A step of Newton's method towards pulses that just overturn.
            correction = jnp.clip(excess, -_LARGEST_CORRECTION, _LARGEST_CORRECTION)
            numbers = numbers.at[-1].set(state.numbers[-1] - correction)
            # Far from what overturns, the loss is not known well.
            uncertain = loss + abs(excess)
            better = (uncertain < state.best.loss) | (state.step == 0)
            new = Descended(state.numbers.at[-1].add(-excess), uncertain, evaluation)
            best = jax.tree.map(lambda new, old: jnp.where(better, new, old), new, state.best)
            moved = abs(numbers - state.numbers).max()
            impacts = evaluation.outcome.impacts
            return _State(state.step + 1, moved, numbers, impacts, optimizer_state, best)

        first = _State(
            step=jnp.zeros_like(descent.steps),
            moved=jnp.full_like(descent.numbers[0], jnp.inf),
            numbers=descent.numbers,
            impacts=descent.impacts,
            optimizer=optimizer.init(descent.numbers),
            best=jax.tree.map(jnp.zeros_like, shapes),
        )
        last = jax.lax.while_loop(
            lambda state: (state.step < descent.steps) & (state.moved > settled),
            advance,
            first,
        )
        return last.best

    one = jax.tree.map(lambda rows: rows[0], descents)
    evaluation = jax.eval_shape(
        lambda: _evaluate_train(*one[:3], one.steps > 1, problem, most_impacts)
    )
    shapes = Descended(one.numbers, one.numbers[0], evaluation)
    return jax.lax.map(descend, descents)


@functools.partial(jax.jit, static_argnames="most_impacts")
def _evaluate_train(
    numbers: Reals,
    impacts: Integers,
    comes: Booleans,
    waits: Booleans,
    problem: TrainProblem,
    most_impacts: int,
) -> Evaluation:
    """Evaluate a train."""
    rocker = problem.rocker
    size = impacts.size

    def compute_values(numbers: Reals) -> tuple[Reals, tuple[Reals, Outcome]]:
        """Compute the values, and once more to pass on undifferentiated, with the outcome."""
        phases, weights, log_bound = jnp.split(numbers, [size, 2 * size])
        train = Train(phases, jnp.exp(log_bound) * weights, impacts, comes)
        outcome = follow_phased_train(rocker, train, problem.spacing, most_impacts, waits)
        # A train may leave the block at rest, and 0 has no logarithm.
        log_x = jnp.log(jnp.maximum(outcome.x, 1e-30))
        log_total = jnp.where(
            problem.seeks_total, jnp.log(abs(jnp.where(comes, weights, 0)).sum()), 0
        )
        log_size = log_bound[0] + log_total
        loss = jnp.where(problem.seeks_pulses, log_size, -log_x)
        # In units of 1 / p times are pure numbers, like the logarithm. Without a latest time
        # the room must still be finite.
        room = jnp.append(-outcome.lacking, problem.latest - outcome.times[-1])
        room = jnp.minimum(rocker.block.frequency_parameter * room, 1e6)
        values = jnp.concatenate([jnp.stack([loss, log_x]), room])
        return values, (values, outcome)

    slopes, (values, outcome) = jax.jacfwd(compute_values, has_aux=True)(numbers)
    # Impacts of a stronger train come later.
    raised = values + (problem.raise_by + 2 * problem.margin) * slopes[:, -1]
    return Evaluation(outcome, jnp.append(values[:2], raised[2:]), slopes)


def _reduce_loss(evaluation: Evaluation, problem: TrainProblem) -> tuple[Reals, Reals, Reals]:
    """Compute the loss with penalty, its derivatives, and how much larger pulses are than need be.

    The last is a logarithm. Where the smallest pulses are sought, the bound follows from the
    other numbers: the derivatives are those with the bound that just overturns (reduced
    gradient).
    """
    _, values, slopes = evaluation
    per_bound = jnp.maximum(slopes[1, -1], _LEAST_RISE)
    excess = jnp.where(problem.seeks_pulses, values[1] / per_bound, 0)
    excess_slope = jnp.where(problem.seeks_pulses, slopes[1] / per_bound, 0)
    values = values - excess * slopes[:, -1]
    slopes = slopes - slopes[:, -1:] * excess_slope[None]
    loss = values[0] - _LATENESS_WEIGHT * jnp.minimum(values[2:], 0).sum()
    late_slopes = jnp.where(values[2:, None] < 0, slopes[2:], 0)
    slope = slopes[0] - _LATENESS_WEIGHT * late_slopes.sum(axis=0)
    slope = slope.at[-1].set(0)
    return loss, jnp.where(jnp.isfinite(slope), slope, 0), excess


def _polish(candidate: Candidate, problem: TrainProblem) -> Candidate:
    """Find the best train through the same impacts to the last digits, by SLSQP."""
    from scipy.optimize import minimize  # which loads slowly

    lows, highs = _compute_bounds(candidate, problem)

    @functools.lru_cache(maxsize=2)
    def evaluate_once(numbers: bytes) -> Evaluation:
        """Evaluate a train, once for all that SciPy asks about it."""
        # SciPy may ask a rounding error beyond the bounds.
        within = np.clip(np.frombuffer(numbers), lows, highs)
        return evaluate(candidate._replace(numbers=within), problem)

    limited = slice(1 if problem.seeks_pulses else 2, None)
    with warnings.catch_warnings():
        # SciPy says so where its own rounding goes beyond the bounds.
        warnings.filterwarnings("ignore", "Values in x were outside bounds")
        minimum = minimize(
            lambda numbers: evaluate_once(numbers.tobytes()).values[0],
            np.clip(candidate.numbers, lows, highs),
            jac=lambda numbers: evaluate_once(numbers.tobytes()).slopes[0],
            method="SLSQP",
            bounds=np.column_stack([lows, highs]),
            constraints={
                "type": "ineq",
                "fun": lambda numbers: evaluate_once(numbers.tobytes()).values[limited],
                "jac": lambda numbers: evaluate_once(numbers.tobytes()).slopes[limited],
            },
            options={"maxiter": _STEPS, "ftol": max(1e-11, 0.5 * problem.tolerance**2)},
        )
    numbers = np.clip(minimum.x, lows, highs)
    _, values, slopes = evaluate_once(numbers.tobytes())
    if problem.seeks_pulses:
        # A step of Newton's method, to the last digits.
        numbers[-1] -= values[1] / slopes[1, -1]
        values = evaluate(candidate._replace(numbers=numbers), problem).values
    kept = bool((values[limited] > -problem.tolerance).all())
    # Converged, or rounding hides any descent.
    ended = minimum.status in (0, 8) and kept
    loss = float(values[0]) if kept else np.inf
    return candidate._replace(numbers=numbers, loss=loss, ended=ended)


def _compute_bounds(
    candidate: Candidate, problem: TrainProblem
) -> tuple[np.ndarray, np.ndarray]:
    """Compute the bounds on the numbers of a train; equal for a number that is given."""
    ones = np.ones(candidate.impacts.size)
    lows = -ones
    highs = ones.copy()
    if problem.seeks_total:
        # With given signs: the sum of magnitudes has no slope at 0.
        lows, highs = np.where(candidate.weights < 0, (-ones, 0 * ones), (0 * ones, ones))
    # The first pulse starts the motion, to the positive side; at rest nothing has a slope.
    lows[0] = 1e-9
    highs[0] = 1
    least = most = np.log(problem.largest)
    if problem.seeks_pulses and not problem.seeks_total:
        least, most = _RANGE
    return np.concatenate([0 * ones, lows, [least]]), np.concatenate([ones, highs, [most]])


def _generate_moves(
    candidate: Candidate, problem: TrainProblem, k: int
) -> Iterator[Candidate]:
    """Yield trains with pulse k where no descent leads, since worse trains lie between.

    A pulse does most early in a half-cycle outward, or late inward.
    """
    # The neighbours of the half-cycle, and the first one that the spacing allows.
    neighbours = np.append(candidate.impacts[k] + np.array([-1, 0, 1]), 0)
    allowed = neighbours.clip(problem.fewest_impacts, problem.most_impacts)
    for impacts in np.unique(allowed).tolist():
        for phase in (_EARLY, _LATE):
            moved = _place_pulse(candidate, k, impacts, phase)
            yield moved
            if problem.spacing > 0 or problem.latest < np.inf:
                # The pulses after it as early as the limits allow.
                after = moved.impacts.copy()
                after[k + 1 :] = problem.fewest_impacts
                yield moved._replace(impacts=after)
    if k == candidate.used - 1 and (problem.spacing > 0 or problem.latest < np.inf):
        # One pulse less.
        yield candidate._replace(used=k)


def _place_pulse(candidate: Candidate, k: int, impacts: int, phase: float) -> Candidate:
    """Put pulse k into another half-cycle, in the direction in which the block moves there."""
    numbers = candidate.numbers.copy()
    between = candidate.impacts.copy()
    size = max(abs(candidate.weights[k]), _LEAST_MOVED)
    between[k] = impacts
    numbers[k] = phase
    numbers[between.size + k] = size if phase == _EARLY else -size
    return candidate._replace(numbers=numbers, impacts=between)
