"""The search for the worst train: gradient steps, moves to other half-cycles, and a polish.

Many trains descend by gradient steps in one compiled program. The steps are those of resilient
backpropagation (Riedmiller and Braun 1993, https://doi.org/10.1109/ICNN.1993.298623), as optax
has it: each number goes by a length of its own, which grows while the sign of its derivative
stays and shrinks when it changes. Most numbers of a worst train lie at their bounds, which such
steps reach exactly. SciPy's sequential quadratic programming (SLSQP; Kraft 1994,
https://doi.org/10.1145/192115.192124) brings the trains that were found to the last digits.
"""

import functools
import itertools
import warnings
from collections.abc import Iterator
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..numerics import select_tree
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

    @property
    def is_timed(self) -> bool:
        """Whether the times of the pulses are limited."""
        return self.spacing > 0 or self.latest < np.inf


class Candidate(NamedTuple):
    """A train, and how good it is.

    Attributes
    ----------
    numbers
        Phases, pulses over the bound, and the logarithm of the bound, (2 pulses + 1,): the
        numbers that a descent changes.
    impacts
        Impacts between a pulse and the one before, (pulses,): only moves change them.
    loss
        The number that is minimised.
    ended
        Whether the polish has ended by itself, with the constraint kept.
    """

    numbers: np.ndarray
    impacts: np.ndarray
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
    def identity(self) -> tuple[bytes, float]:
        """A key that is equal for candidates with the same train."""
        return self.impacts.tobytes(), round(self.merit, 6)


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


def search(candidates: list[Candidate], problem: TrainProblem) -> list[Candidate]:
    """Find the best train that each candidate leads to, by descents and moves between them."""
    # Different starts come to the same trains, which need not be improved again.
    improved: dict[tuple, Candidate] = {}

    def improve(candidate: Candidate, k: int) -> Candidate:
        """Move pulse k to where it leads to the best train; polish the train for k = 0."""
        key = k, *candidate.identity
        if key not in improved:
            method = functools.partial(_find_best_move, k=k) if k else _polish
            improved[key] = method(candidate, problem)
        return improved[key]

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
                moved = improve(candidate, k)
                candidate = moved if candidate.merit - moved.merit > _NO_GAIN else candidate
        ends.append(improve(candidate, 0))
    return ends


def _find_best_move(candidate: Candidate, problem: TrainProblem, k: int) -> Candidate:
    """Find the best of the trains to which moves of pulse k lead."""
    moved = descend(list(_generate_moves(candidate, problem, k)), problem)
    if problem.is_timed:
        # Gradient steps stop where a limit is reached.
        best = sorted(moved, key=lambda end: end.merit)
        promising = 3 if problem.latest < np.inf else 1
        moved = [_polish(end, problem) for end in best[:promising]]
    return min(moved, key=lambda end: end.merit)


def descend(candidates: list[Candidate], problem: TrainProblem) -> list[Candidate]:
    """Find the best trains through the same impacts by gradient steps."""
    starts = []
    for candidate in candidates:
        numbers = np.clip(candidate.numbers, *_compute_bounds(candidate, problem))
        start = candidate._replace(numbers=numbers)
        start.phases[:] = start.phases.clip(_EARLY, _LATE)
        starts.append(start)
    ends = []
    for start, descended in zip(starts, _run_descents(starts, problem, _STEPS), strict=True):
        end = start._replace(
            numbers=descended.numbers.astype(float),
            impacts=descended.evaluation.outcome.impacts,
            loss=float(descended.loss),
        )
        if problem.seeks_total:
            # Only the pulses count, not how they are split into a bound and weights.
            end.weights[:] *= np.exp(end.numbers[-1])
            end.numbers[-1] = 0
        ends.append(end)
    return ends


def evaluate(candidate: Candidate, problem: TrainProblem, raised: float = 0.0) -> Evaluation:
    """Evaluate a train whose pulses are raised by a factor exp(`raised`)."""
    numbers = np.append(candidate.numbers[:-1], candidate.numbers[-1] + raised)
    # By the program that is there already.
    (descended,) = _run_descents([candidate._replace(numbers=numbers)], problem, 1)
    return jax.tree.map(lambda part: np.asarray(part, float), descended.evaluation)


def _run_descents(
    candidates: list[Candidate], problem: TrainProblem, steps: int
) -> Iterator[Descended]:
    """Let trains descend, `_TRAINS` of them in a call of the program."""
    dtype = problem.rocker.restitution.dtype
    for first in range(0, len(candidates), _TRAINS):
        trains = candidates[first : first + _TRAINS]
        rows = [(train.numbers, *_compute_bounds(train, problem)) for train in trains]
        impacts = np.stack([train.impacts for train in trains])
        # One program for any number of trains: the padding takes no step.
        index = np.arange(_TRAINS)
        most_steps = np.where(index < len(trains), steps, 0)
        index = index % len(trains)
        columns = (*np.array(rows, dtype)[index].swapaxes(0, 1), impacts[index], most_steps)
        descended = jax.device_get(_descend_all(columns, problem, problem.most_impacts))
        for k in range(len(trains)):
            yield jax.tree.map(lambda rows, k=k: rows[k], descended)


@functools.partial(jax.jit, static_argnames="most_impacts")
def _descend_all(
    columns: tuple[Reals | Integers, ...], problem: TrainProblem, most_impacts: int
) -> Descended:
    """Improve trains by gradient steps, each until it has settled.

    The columns are numbers, lower and upper bounds, impacts and most steps of the trains. With
    more than one step, a train first gets as many impacts between the pulses as the spacing
    takes. With one step, the same program evaluates it.

    The trains descend one after the other inside of the program. On a CPU that takes no longer
    per step than side by side, where all wait for the slowest, and compiles in two thirds of the
    time.
    """
    import optax  # which only this needs

    optimizer = optax.rprop(_FIRST_STEP, max_step_size=_LARGEST_STEP)
    settled = float(jnp.finfo(columns[0].dtype).eps) ** 0.5

    def evaluate_train(numbers: Reals, impacts: Integers, waits: Booleans) -> Evaluation:
        return _evaluate_train(numbers, impacts, waits, problem, most_impacts)

    def descend(train: tuple) -> Descended:
        """Improve one train."""
        numbers, lows, highs, impacts, most_steps = train

        def advance(state: tuple) -> tuple:
            """Go one step."""
            step, _, numbers, impacts, optimizer_state, best = state
            is_first = step == 0
            evaluation = evaluate_train(numbers, impacts, is_first & (most_steps > 1))
            loss, slope, excess = _reduce_loss(evaluation, problem)
            # Far from what overturns, the loss is not known well.
            uncertain = loss + abs(excess)
            new = Descended(numbers.at[-1].add(-excess), uncertain, evaluation)
            best = select_tree((uncertain < best.loss) | is_first, new, best)
            updates, optimizer_state = optimizer.update(slope, optimizer_state)
            # A step of Newton's method towards pulses that just overturn.
            correction = jnp.clip(excess, -_LARGEST_CORRECTION, _LARGEST_CORRECTION)
            following = jnp.clip(numbers + updates, lows, highs)
            following = following.at[-1].set(numbers[-1] - correction)
            moved = abs(following - numbers).max()
            impacts = evaluation.outcome.impacts
            return step + 1, moved, following, impacts, optimizer_state, best

        shapes = jax.eval_shape(evaluate_train, numbers, impacts, most_steps > 1)
        nothing = Descended(numbers, numbers[0], jax.tree.map(jnp.zeros_like, shapes))
        moved = jnp.full_like(numbers[0], jnp.inf)
        begin = (jnp.zeros_like(most_steps), moved, numbers, impacts, optimizer.init(numbers))
        return jax.lax.while_loop(
            lambda state: (state[0] < most_steps) & (state[1] > settled),
            advance,
            (*begin, nothing),
        )[-1]

    return jax.lax.map(descend, columns)


@functools.partial(jax.jit, static_argnames="most_impacts")
def _evaluate_train(
    numbers: Reals,
    impacts: Integers,
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
        train = Train(phases, jnp.exp(log_bound) * weights, impacts)
        outcome = follow_phased_train(rocker, train, problem.spacing, most_impacts, waits)
        # A train may leave the block at rest, and 0 has no logarithm.
        log_x = jnp.log(jnp.maximum(outcome.x, 1e-30))
        log_total = jnp.where(problem.seeks_total, jnp.log(abs(weights).sum()), 0)
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

    bounds = _compute_bounds(candidate, problem)

    @functools.lru_cache(maxsize=2)
    def evaluate_once(*numbers: float) -> Evaluation:
        """Evaluate a train, once for all that SciPy asks about it."""
        # SciPy may ask a rounding error beyond the bounds.
        return evaluate(candidate._replace(numbers=np.clip(numbers, *bounds)), problem)

    limited = slice(1 if problem.seeks_pulses else 2, None)
    with warnings.catch_warnings():
        # SciPy says so where its own rounding goes beyond the bounds.
        warnings.filterwarnings("ignore", "Values in x were outside bounds")
        minimum = minimize(
            lambda numbers: evaluate_once(*numbers).values[0],
            np.clip(candidate.numbers, *bounds),
            jac=lambda numbers: evaluate_once(*numbers).slopes[0],
            method="SLSQP",
            bounds=np.column_stack(bounds),
            constraints={
                "type": "ineq",
                "fun": lambda numbers: evaluate_once(*numbers).values[limited],
                "jac": lambda numbers: evaluate_once(*numbers).slopes[limited],
            },
            options={"maxiter": _STEPS, "ftol": max(1e-11, 0.5 * problem.tolerance**2)},
        )
    numbers = np.clip(minimum.x, *bounds)
    _, values, slopes = evaluate_once(*numbers)
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
    # For a total with given signs: the sum of magnitudes has no slope at 0.
    inward = candidate.weights < 0
    lows = np.where(problem.seeks_total & ~inward, 0.0, -1.0)
    highs = np.where(problem.seeks_total & inward, 0.0, 1.0)
    # The first pulse starts the motion, to the positive side; at rest nothing has a slope.
    lows[0] = 1e-9
    highs[0] = 1
    least = most = np.log(problem.largest)
    if problem.seeks_pulses and not problem.seeks_total:
        least, most = _RANGE
    phases = np.zeros_like(lows)
    return np.hstack([phases, lows, least]), np.hstack([phases + 1, highs, most])


def _generate_moves(
    candidate: Candidate, problem: TrainProblem, k: int
) -> Iterator[Candidate]:
    """Yield trains with pulse k where no descent leads, since worse trains lie between.

    A pulse does most in the direction in which the block moves: early in a half-cycle outward,
    or late inward.
    """
    # The neighbours of the half-cycle, and the first one that the spacing allows.
    neighbours = np.append(candidate.impacts[k] + np.array([-1, 0, 1]), 0)
    allowed = neighbours.clip(problem.fewest_impacts, problem.most_impacts)
    size = max(abs(candidate.weights[k]), _LEAST_MOVED)
    places = ((_EARLY, size), (_LATE, -size))
    for impacts, (phase, weight) in itertools.product(np.unique(allowed), places):
        moved = Candidate(candidate.numbers.copy(), candidate.impacts.copy())
        moved.impacts[k] = impacts
        moved.phases[k] = phase
        moved.weights[k] = weight
        yield moved
        if problem.is_timed:
            # The pulses after it as early as the limits allow.
            after = moved.impacts.copy()
            after[k + 1 :] = problem.fewest_impacts
            yield moved._replace(impacts=after)
    if problem.is_timed and not candidate.weights[k + 1 :].any():
        # One pulse less.
        left_out = Candidate(candidate.numbers.copy(), candidate.impacts)
        left_out.weights[k] = 0
        yield left_out
