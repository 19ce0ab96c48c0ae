"""Candidates for the worst train: the problem, its bounds, and how good a train is."""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .pulse_train import Rocker
from .train_descent import Descended, Descents, descend_all
from .train_through_impacts import MAX_IMPACTS, Evaluation, Outcome, evaluate_with_slopes

Goal = Literal["smallest largest", "smallest total", "most rotation"]

MOST_IMPACTS = 3  # between two pulses, as long as they need not be apart
AT_ONCE = 16  # trains in a program: start and moves of a pulse
NO_GAIN = 1e-9  # improvements of the merit up to this are rounding
# Range of the logarithm of the bound. Over 0 even the first pulse overturns the block. The
# block is followed as if it came back nevertheless, so that a descent always has somewhere to
# begin from which the block overturns.
_RANGE = (-20.0, 5.0)


class TrainProblem(NamedTuple):
    """The problem that a search solves: the block, the goal and the limits.

    Attributes
    ----------
    rocker, rate
        The block, and its frequency parameter [rad/s].
    goal
        See `worst_train`.
    largest
        Bound on the pulses over `Rocker.unit` [-]; 1 unless given.
    fewest_impacts
        Fewest impacts between two pulses.
    spacing, latest
        Shortest time between two pulses, and latest time of the last [s].
    eps
        Relative rounding error of the precision.
    """

    rocker: Rocker
    goal: Goal
    largest: float
    fewest_impacts: int
    spacing: float
    latest: float
    rate: float
    eps: float

    @property
    def seeks_pulses(self) -> bool:
        """True if the smallest pulses are sought, not the highest peak."""
        return self.goal != "most rotation"

    @property
    def constrained(self) -> bool:
        """True if there are limits on the times of the pulses."""
        return self.spacing > 0 or self.latest < np.inf

    @property
    def most_impacts(self) -> int:
        """Most impacts between two pulses."""
        # Waiting for more impacts than these only loses energy, unless the spacing asks for
        # it.
        return MAX_IMPACTS if self.spacing > 0 else MOST_IMPACTS

    @property
    def accuracy(self) -> float:
        """Accuracy to which a descent goes on, and to which it keeps the constraints."""
        return max(1e-11, 50 * self.eps)

    @property
    def tolerance(self) -> float:
        """Violation that still counts as none; of times, this over the frequency parameter."""
        # Half of the digits, and a margin.
        return 10 * self.eps**0.5


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
    loss, violation
        The number that is minimised, and the largest violation of a constraint.
    ended
        Whether the descent has ended by itself.
    path
        The objective in each step so far.
    """

    numbers: np.ndarray
    impacts: np.ndarray
    used: int
    loss: float = np.inf
    violation: float = np.inf
    ended: bool = False
    path: tuple[float, ...] = ()

    @property
    def phases(self) -> np.ndarray:
        """Phases of the pulses in their half-cycles, see `Train`."""
        return self.numbers[: self.impacts.size]

    @property
    def weights(self) -> np.ndarray:
        """The pulses over the bound, outward positive."""
        return self.numbers[self.impacts.size : -1]

    def compute_outcome(self, problem: TrainProblem, raised: float = 0.0) -> Outcome:
        """Compute the outcome if the pulses are raised by a factor exp(`raised`)."""
        numbers = np.append(self.numbers[:-1], self.numbers[-1] + raised)
        return evaluate_candidate(self._replace(numbers=numbers), problem).outcome

    def is_feasible(self, problem: TrainProblem) -> bool:
        """Return whether the train keeps the constraints."""
        return self.violation < problem.tolerance

    def identify(self, problem: TrainProblem) -> tuple[int, bytes, float]:
        """Return a key that is equal for candidates with the same train.

        It consists of the number of pulses, the sequence of impacts, and the merit.
        """
        return self.used, self.impacts.tobytes(), round(self.merit(problem), 6)

    def merit(self, problem: TrainProblem) -> float:
        """Compute the number by which candidates are compared; lower is better.

        Anything feasible is below anything that is not. Of equally good trains the earlier one
        counts as better: a pulse right before an impact does as much as one right after the
        impact before.
        """
        # Heavier than `NO_GAIN`, or a move to the earlier train would not count as a gain.
        lateness = (np.sin(0.5 * np.pi * self.phases[1:]) ** 2).sum()
        merit = self.loss if self.is_feasible(problem) else 100 + self.violation
        return float(merit + 10 * NO_GAIN * lateness)


class Measurement(NamedTuple):
    """The loss and the constraints at one train, with derivatives.

    Attributes
    ----------
    loss, slope
        The number that is minimised, and its derivatives with respect to the numbers.
    log_x
        Logarithm of the velocity in the end over the critical one: from 0 on the block
        overturns.
    room, room_slopes
        Room within each constraint, negative if it is violated, and its derivatives.
    objective
        Size of the pulses if raised until they just overturn the block, nearly; or the
        velocity in the end over the critical one.
    """

    loss: float
    slope: np.ndarray
    log_x: float
    room: np.ndarray
    room_slopes: np.ndarray
    objective: float


def evaluate_candidate(candidate: Candidate, problem: TrainProblem) -> Evaluation:
    """Compute outcome, limited values and their slopes; see `evaluate_with_slopes`."""
    numbers, impacts, used, *_ = candidate
    if problem.constrained:
        return evaluate_with_slopes(
            numbers, impacts, used, problem.rocker, problem.spacing, problem.most_impacts
        )
    # By the program that is there already.
    last = run_descents([candidate], problem, steps=1).last
    return jax.tree.map(lambda part: part[0], last)


def run_descents(
    candidates: Sequence[Candidate], problem: TrainProblem, steps: int
) -> Descended:
    """Let at most `AT_ONCE` trains descend by gradient steps."""
    dtype = problem.rocker.restitution.dtype
    bounds = [compute_bounds(candidate, problem) for candidate in candidates]
    # One program for any number of trains: the padding takes no step.
    spare = AT_ONCE - len(candidates)

    def stack(rows: Sequence[np.ndarray], dtype: np.dtype | type) -> Array:
        """Make an array of one row per train, and of the padding."""
        padded = [*rows, *[np.zeros_like(rows[0])] * spare]
        return jnp.asarray(np.array(padded, dtype))

    descents = Descents(
        numbers=stack([candidate.numbers for candidate in candidates], dtype),
        impacts=stack([candidate.impacts for candidate in candidates], int),
        lows=stack([low for low, _ in bounds], dtype),
        highs=stack([high for _, high in bounds], dtype),
        steps=stack([np.array(steps)] * len(candidates), int),
    )
    seeks = jnp.asarray(problem.seeks_pulses)
    total = jnp.asarray(problem.goal == "smallest total")
    return jax.device_get(
        descend_all(descents, problem.rocker, seeks, total, problem.most_impacts)
    )


def measure_candidate(candidate: Candidate, problem: TrainProblem) -> Measurement:
    """Compute the loss and the constraints of a problem at a train."""
    _, *limited = evaluate_candidate(candidate, problem)
    values, slopes = (np.asarray(part, float) for part in limited)
    log_x = values[0]
    log_x_slope = slopes[0]

    # Times in units of 1 / rate are pure numbers, like the logarithm: one accuracy does for
    # all constraints.
    room = -problem.rate * values[1:]
    room_slopes = -problem.rate * slopes[1:]
    # Without a latest time the room must still be finite.
    room[-1] += min(problem.rate * problem.latest, 1e6)

    if not problem.seeks_pulses:
        return Measurement(-log_x, -log_x_slope, log_x, room, room_slopes, np.exp(log_x))
    room = np.append(room, log_x)
    room_slopes = np.vstack([room_slopes, log_x_slope])

    # The objective is the size of the pulses once they just overturn: the velocity in the end
    # is nearly in proportion to them.
    slope = np.zeros_like(candidate.numbers)
    if problem.goal == "smallest largest":
        loss = candidate.numbers[-1]
        slope[-1] = 1
        return Measurement(loss, slope, log_x, room, room_slopes, np.exp(loss - log_x))
    sizes = abs(candidate.weights[: candidate.used])
    first = candidate.impacts.size
    slope[first : first + sizes.size] = np.sign(candidate.weights[: sizes.size])
    bound = np.exp(candidate.numbers[-1])
    loss = bound * sizes.sum()
    return Measurement(loss, bound * slope, log_x, room, room_slopes, loss * np.exp(-log_x))


def compute_bounds(
    candidate: Candidate, problem: TrainProblem
) -> tuple[np.ndarray, np.ndarray]:
    """Compute the bounds on the numbers of a train; equal for a number that is given."""
    ones = np.ones(candidate.impacts.size)
    lows = -ones
    highs = ones.copy()
    if problem.goal == "smallest total":
        # With given signs: the sum of magnitudes has no slope at 0.
        lows, highs = np.where(candidate.weights < 0, (-ones, 0 * ones), (0 * ones, ones))
    # The first pulse starts the motion, to the positive side; at rest nothing has a slope.
    lows[0] = 1e-9
    highs[0] = 1
    least = np.log(problem.largest)
    most = least
    if problem.goal == "smallest largest":
        least, most = _RANGE
    return np.concatenate([0 * ones, lows, [least]]), np.concatenate([ones, highs, [most]])
