"""The worst train of pulses, found by optimisation."""

import math
from dataclasses import dataclass
from typing import cast, get_args

import jax
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..host import Printed, Status
from ..impact import read_restitution
from ..validation import (
    NON_NEGATIVE,
    POSITIVE,
    Number,
    as_name,
    as_real,
    check,
    check_concrete,
    check_kind,
    unify_precision,
)
from .free_rocking import Linearized, ModelLike, as_model
from .pulse_train import Flight, Rocker, TrainResponse, follow_timed_train
from .train_candidates import MOST_IMPACTS, Candidate, Goal, TrainProblem
from .train_optimization import descend, search
from .train_through_impacts import MAX_IMPACTS


@dataclass(frozen=True, repr=False)
class WorstTrain(Printed):
    """The worst train of pulses that was found; see `worst_train`.

    If the status is COMPLETE, `respond_to_train` with `times`, `intensities` and the same
    model overturns the block, or reaches `peak_rotation`. For this, the intensities of the
    worst train are raised by a relative 1e-6 (3.5e-4 in float32), for "most rotation" beyond
    `largest`. `times` and `intensities` describe this raised train, all other attributes the
    train before it is raised. Do not change the intensities alone: the impacts
    of a stronger train come later, so that a pulse meant to come right after an impact would
    come before it, and slow the block.

    Attributes
    ----------
    times : ndarray, shape (pulses,)
        Times of the pulses, the first at 0 [s].
    intensities : ndarray, shape (pulses,)
        I of each pulse [m/s], with the sign of the ground motion; raised, see above.
    impacts_between : ndarray, shape (pulses,)
        Impacts between a pulse and the one before it.
    delays : ndarray, shape (pulses,)
        Time from the last impact to the pulse, over the duration of that half-cycle [-].
    largest, total : float
        Largest magnitude, and sum of magnitudes, of the pulses that just suffice [m/s].
    peak_rotation : float
        Peak after the last pulse [rad]; NaN if the block overturns.
    overturns : bool
        Whether the train overturns the block, just or by more.
    status : Status
        NOT_CONVERGED if the search has not converged, or if its train violates a constraint.
        NOT_VALIDATED if `respond_to_train` contradicts the result, or if the times violate a
        constraint.
    objectives : ndarray, shape (starts,)
        Best objective reached from each start: the largest or total intensity [m/s], or the
        velocity after the last pulse over the critical one [-].
    history : ndarray, shape (starts, steps)
        Objective in each step of the descent from each start.
    goal : str
        Goal of the search.
    """

    times: np.ndarray
    intensities: np.ndarray
    impacts_between: np.ndarray
    delays: np.ndarray
    largest: float
    total: float
    peak_rotation: float
    overturns: bool
    status: Status
    objectives: np.ndarray
    history: np.ndarray
    goal: str

    def __str__(self) -> str:
        lines = [
            f"{self.goal}: largest pulse {self.largest:.5g} m/s,"
            f" together {self.total:.5g} m/s,"
            + (
                " overturns"
                if self.overturns
                else f" peak rotation {self.peak_rotation:.6g} rad"
            )
            + ("" if self.status == Status.COMPLETE else f"; {self.status.description}"),
            "  time [s]  intensity [m/s]  after impact [half-cycles]",
        ]
        pulses = zip(self.times, self.intensities, self.delays, strict=True)
        lines += [
            f"{time:10.4f}  {intensity:15.5g}  {round(float(delay), 5) + 0.0:.5f}"
            for time, intensity, delay in pulses
        ]
        return "\n".join(lines)


def worst_train(  # noqa: C901, PLR0913
    block: Block,
    restitution: Number,
    count: int,
    goal: Goal = "smallest largest",
    *,
    largest: float | None = None,
    impacts_between: int = 1,
    spacing: float = 0.0,
    latest: float = math.inf,
    model: ModelLike = Linearized(),
    starts: int = 10,
    seed: int = 0,
) -> WorstTrain:
    """Find the worst train of instantaneous pulses, over their times, signs and intensities.

    Between the pulses the block moves freely, through its impacts. The search starts from
    random trains and descends by gradient steps or, with limits on the times, by sequential
    quadratic programming. Then it tries discrete changes that descent cannot make: it
    reverses a pulse, moves it to the other side of the peak, or moves it to the previous or
    next half-cycle. The best train is verified by simulation, with intensities a little higher
    and a little lower.

    Parameters
    ----------
    block : Block
        One block.
    restitution : float
        Its C [-], between 0 and 1; of a one-sided block its magnitude counts.
    count : int
        Number of pulses, at least 1.
    goal : str
        ``"smallest largest"``: overturn the block with the largest pulse as small as
        possible; ``"smallest total"``: with the sum of magnitudes as small as possible;
        ``"most rotation"``: reach the highest peak with pulses of at most `largest`.
    largest : float
        Bound on the pulses [m/s], finite and greater than 0; for ``"most rotation"`` only.
    impacts_between : int
        Least number of impacts between a pulse and the next, 0 to 3. With 0 and no spacing,
        all pulses of the worst train come at once.
    spacing : float
        Shortest time between two pulses [s], finite and at least 0.
    latest : float
        Latest time of the last pulse [s], at least 0.
    model : Linearized or Nonlinear
        Equation of the motion between the pulses.
    starts, seed : int
        Number of random trains to start from, and their seed.

    Returns
    -------
    WorstTrain

    Raises
    ------
    ValueError
        If an argument is out of range, or the constraints contradict each other.

    Notes
    -----
    With one impact between pulses, the worst train is the paper's input: equal pulses right
    after the impacts, each of ``critical_intensity(block, restitution, count)``. They
    alternate in direction; on a one-sided block all push away from its wall. The smallest
    total is a single pulse, since every impact dissipates part of the energy of earlier
    pulses.

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
    check_kind("block", block, Block)
    check_concrete((block, restitution), "the search depends on the answers")
    restitution = read_restitution(block, restitution)
    block.check()
    for name, value in (("count", count), ("starts", starts)):
        if value < 1:
            raise ValueError(f"{name} must be at least 1, got {value}")
    goal = cast("Goal", as_name("goal", goal, get_args(Goal)))
    if (largest is None) == (goal == "most rotation"):
        raise ValueError('largest must be given for the goal "most rotation", and only for it')
    if largest is not None:
        check("largest", as_real("largest", largest), POSITIVE)
    if not 0 <= impacts_between <= MOST_IMPACTS:
        raise ValueError(
            f"impacts_between must be from 0 to {MOST_IMPACTS}, got {impacts_between}"
        )
    check("spacing", as_real("spacing", spacing), NON_NEGATIVE)
    if not latest >= 0:
        raise ValueError(f"latest must be at least 0, got {latest:g}")
    if (count - 1) * spacing > latest:
        raise ValueError(
            f"count, spacing and latest contradict each other: {count} pulses {spacing:g} s"
            f" apart take {(count - 1) * spacing:g} s, which is more than {latest:g} s"
        )

    block, restitution = unify_precision((block, restitution))
    if any(jnp.ndim(leaf) for leaf in jax.tree.leaves((block, restitution))):
        raise ValueError("block and restitution must be a single block and number, got arrays")
    rocker = Rocker(block, restitution, as_model(model))
    problem = TrainProblem(
        rocker=rocker,
        goal=goal,
        largest=largest / float(rocker.unit) if largest is not None else 1.0,
        fewest_impacts=impacts_between,
        spacing=float(spacing),
        latest=float(latest),
        rate=float(block.frequency_parameter),
        eps=float(np.finfo(restitution.dtype).eps),
    )
    candidates = search(_draw_candidates(problem, count, starts, seed), problem)
    train = _make_result(candidates, problem, latest)

    for _ in range(3):
        # The times are those of a train that is raised, whose impacts come later: by how much
        # depends on the train, and any more would make the pulses larger than need be.
        late = float(train.times[-1]) - latest
        if late <= 0:
            break
        earlier = problem.latest - late - problem.accuracy / problem.rate
        problem = problem._replace(latest=max(earlier, (count - 1) * spacing))
        candidates = [descend(candidate, problem) for candidate in candidates]
        train = _make_result(candidates, problem, latest)
    return train


def _draw_candidates(
    problem: TrainProblem, count: int, starts: int, seed: int
) -> list[Candidate]:
    """Draw random trains to start from, of few impacts between the pulses."""
    random = np.random.default_rng(seed)
    fewest = problem.fewest_impacts
    impacts = random.integers(fewest, min(fewest + 2, MOST_IMPACTS) + 1, (starts, count))
    impacts[:, 0] = 0
    phases = random.uniform(0, 1, impacts.shape)
    weights = random.uniform(-1, 1, impacts.shape)
    # Some weak, some almost as strong as a single pulse: a weak train comes to rest where
    # a stronger one has its impacts just in time.
    log_bounds = np.log(np.geomspace(0.9 / count, 0.97, starts))
    numbers = np.column_stack([phases, weights, log_bounds])
    return [
        Candidate(train_numbers, train_impacts, count)
        for train_numbers, train_impacts in zip(numbers, impacts, strict=True)
    ]


def _make_result(
    candidates: list[Candidate], problem: TrainProblem, latest: float
) -> WorstTrain:
    """Pick the best train of all candidates, verify it, and make it the answer."""
    unit = float(problem.rocker.unit)
    losses = np.array([c.loss if c.is_feasible(problem) else np.inf for c in candidates])
    objectives = {
        "smallest largest": np.exp(losses) * unit,
        "smallest total": losses * unit,
        "most rotation": np.exp(-losses),
    }[problem.goal]
    # Of equally good trains, one whose search has ended.
    equal = losses <= losses.min() + problem.tolerance
    ended = equal & np.array([candidate.ended for candidate in candidates])
    best = candidates[
        int(np.argmin(np.where(ended, losses, np.inf) if ended.any() else losses))
    ]

    count = best.used
    outcome = jax.device_get(best.compute_outcome(problem))
    # What the train does, from the numbers that were optimised.
    impulses = best.weights[:count] * np.exp(best.numbers[-1])
    intensities = outcome.sides[:count] * impulses * unit
    impacts = best.impacts[1:count]
    overturns = problem.seeks_pulses or bool(outcome.x >= 1)
    # At the peak the velocity is 0: all of the launch velocity is lost.
    top = Flight(jnp.asarray(outcome.x), jnp.zeros_like(outcome.x))
    peak = math.nan if overturns else float(problem.rocker.rotation(top))
    times, raised, verified = _verify(best, problem, intensities, peak)
    in_time = (np.diff(times) >= problem.spacing * (1 - 1e-9)).all() and times[-1] <= latest
    # At the limit, even more impacts between two pulses might be worse.
    searched = best.ended and best.is_feasible(problem) and (impacts < MAX_IMPACTS).all()
    status = Status.COMPLETE if verified and in_time else Status.NOT_VALIDATED
    steps = max(len(candidate.path) for candidate in candidates)
    paths = [np.pad(c.path, (0, steps - len(c.path)), mode="edge") for c in candidates]
    return WorstTrain(
        times=times,
        intensities=raised,
        impacts_between=np.append(0, impacts),
        delays=outcome.delays[:count],
        largest=float(abs(intensities).max()),
        total=float(abs(intensities).sum()),
        peak_rotation=peak,
        overturns=overturns,
        status=status if searched else Status.NOT_CONVERGED,
        objectives=np.where(np.isfinite(losses), objectives, np.nan),
        history=np.array(paths) * (unit if problem.seeks_pulses else 1),
        goal=problem.goal,
    )


def _verify(
    best: Candidate, problem: TrainProblem, intensities: np.ndarray, peak: float
) -> tuple[np.ndarray, np.ndarray, bool]:
    """Time and raise the pulses, and check whether the train then does as it should.

    Simulated in time, the train must overturn the block if raised a little, and must not if
    lowered a little; where the most rotation is sought, the two peaks must enclose the peak. Each
    train is timed by its own impacts, which come later in a stronger train: a pulse on the wrong
    side of an impact acts the other way. Return the times and intensities of the raised train.
    The times have a margin: they are a little later where a pulse comes right after an impact, a
    little earlier where it comes right before.
    """
    # By how much the intensities are raised: half of the digits, but no less than 1e-6, since a
    # simulation in time computes the same train in another way.
    raise_by = max(1e-6, problem.eps**0.5)
    before_impact = best.phases[: best.used] > 0.5

    def compute_times(raised: float) -> np.ndarray:
        """Compute when the pulses of the train come if it is raised by exp(`raised`)."""
        return np.asarray(best.compute_outcome(problem, raised).times)[: best.used]

    def simulate_raised(
        by: float, margin: float
    ) -> tuple[np.ndarray, np.ndarray, TrainResponse]:
        """Simulate the train raised by a fraction, its pulses off the impacts by a margin."""
        # The margin is a fraction of the strength, too: a stronger train has its impacts later.
        times = np.where(before_impact, compute_times(by - margin), compute_times(by + margin))
        times = np.maximum.accumulate(times)
        raised = (intensities * (1 + by)).astype(times.dtype)
        response = follow_timed_train(problem.rocker, jnp.asarray(times), jnp.asarray(raised))
        return times, raised, response

    # The smallest margin with which the train does as it should.
    times = raised = np.zeros(0)
    verified = False
    for margin in (1e-4 * raise_by, 1e-3 * raise_by, 1e-2 * raise_by, 1e-1 * raise_by):
        times, raised, higher = simulate_raised(raise_by, margin)
        *_, lower = simulate_raised(-raise_by, margin)
        verified = bool(higher.overturned)
        if problem.seeks_pulses:
            verified &= not lower.overturned
        elif not math.isnan(peak):
            verified = float(lower.peak_rotation) <= peak <= float(higher.peak_rotation)
        if verified:
            break
    return times, raised, verified
