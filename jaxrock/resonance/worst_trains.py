"""The worst train of pulses, found by optimisation."""

import math
from dataclasses import dataclass
from typing import get_args

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
from .pulse_train import TrainResponse, follow_timed_train
from .rocker import Rocker
from .train_optimization import (
    MOST_IMPACTS,
    Candidate,
    Goal,
    TrainProblem,
    evaluate,
    search,
)


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
    goal: str

    def __str__(self) -> str:
        peak = f"peak rotation {self.peak_rotation:.6g} rad"
        outcome = "overturns" if self.overturns else peak
        if self.status != Status.COMPLETE:
            outcome += f"; {self.status.description}"
        lines = [
            f"{self.goal}: largest pulse {self.largest:.5g} m/s,"
            f" together {self.total:.5g} m/s, {outcome}",
            "  time [s]  intensity [m/s]  after impact [half-cycles]",
        ]
        for time, intensity, delay in zip(
            self.times, self.intensities, self.delays, strict=True
        ):
            lines.append(f"{time:10.4f}  {intensity:15.5g}  {abs(delay):.5f}")
        return "\n".join(lines)


def worst_train(  # noqa: PLR0913
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
    random trains and descends by gradient steps. Then it tries discrete changes that descent
    cannot make: it reverses a pulse, moves it to the other side of the peak, or moves it to the
    previous or next half-cycle. Sequential quadratic programming brings what is found to the
    last digits. The best train is verified by simulation, with intensities a little higher and
    a little lower.

    Parameters
    ----------
    block : Block
        One block.
    restitution : float
        Its C [-], between 0 and 1; of a one-sided block its magnitude counts.
    count : int
        Number of pulses, at least 1. The train has fewer if these do more.
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
        If an argument is out of range.

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
    as_name("goal", goal, get_args(Goal))
    if (largest is None) == (goal == "most rotation"):
        raise ValueError('largest must be given for the goal "most rotation", and only for it')
    if largest is not None:
        check("largest", as_real("largest", largest), POSITIVE)
    if not 0 <= impacts_between <= MOST_IMPACTS:
        raise ValueError(
            f"impacts_between must be from 0 to {MOST_IMPACTS}, got {impacts_between}"
        )
    check("spacing", as_real("spacing", spacing), NON_NEGATIVE)
    block, restitution = unify_precision((block, restitution))
    if any(jnp.ndim(leaf) for leaf in jax.tree.leaves((block, restitution))):
        raise ValueError("block and restitution must be a single block and number, got arrays")
    rocker = Rocker(block, restitution, as_model(model))
    half_digits = float(np.finfo(restitution.dtype).eps) ** 0.5
    problem = TrainProblem(
        rocker=rocker,
        seeks_pulses=goal != "most rotation",
        seeks_total=goal == "smallest total",
        largest=largest / float(rocker.unit) if largest is not None else 1.0,
        fewest_impacts=impacts_between,
        spacing=float(spacing),
        latest=float(latest),
        tolerance=10 * half_digits,
        # No less than 1e-6, since a simulation in time computes the same train in another way.
        raise_by=max(1e-6, half_digits),
        margin=max(1e-10, 5 * half_digits**1.5),
    )
    candidates = search(_draw_candidates(problem, count, starts, seed), problem)
    return _make_result(candidates, problem, goal)


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
    # One as strong and as early as may be.
    impacts[-1, 1:] = fewest
    phases[-1] = 0
    weights[-1] = 1
    numbers = np.column_stack([phases, weights, log_bounds])
    return list(map(Candidate, numbers, impacts))


def _make_result(candidates: list[Candidate], problem: TrainProblem, goal: Goal) -> WorstTrain:
    """Pick the best train of all candidates, verify it, and make it the answer."""
    unit = float(problem.rocker.unit)
    losses = np.array([candidate.loss for candidate in candidates])
    # Of equally good trains, one whose search has ended.
    equal = [c for c in candidates if c.loss <= losses.min() + problem.tolerance]
    best = min(equal, key=lambda candidate: (not candidate.ended, candidate.loss))
    objectives = np.exp(losses) * unit if problem.seeks_pulses else np.exp(-losses)
    outcome = evaluate(best, problem).outcome
    # What the train does, from the numbers that were optimised.
    intensities = outcome.sides * best.weights * (np.exp(best.numbers[-1]) * unit)
    overturns = bool(problem.seeks_pulses or outcome.x >= 1)
    x = jnp.asarray(outcome.x)
    peak = math.nan if overturns else float(problem.rocker.launch_peak(x))
    times, raised, higher = _simulate_raised(best, problem, intensities, problem.raise_by)
    *_, lower = _simulate_raised(best, problem, intensities, -problem.raise_by)
    if problem.seeks_pulses:
        verified = bool(higher.overturned & ~lower.overturned)
    else:
        verified = overturns or float(lower.peak_rotation) <= peak <= higher.peak_rotation
    comes = intensities != 0
    in_time = (np.diff(times[comes]) >= problem.spacing * (1 - 1e-9)).all()
    verified &= bool(in_time and times[-1] <= problem.latest)
    status = Status.COMPLETE if verified else Status.NOT_VALIDATED
    return WorstTrain(
        times=times[comes],
        intensities=raised[comes],
        impacts_between=np.asarray(outcome.impacts, int)[comes],
        delays=np.asarray(outcome.delays)[comes],
        largest=float(abs(intensities).max()),
        total=float(abs(intensities).sum()),
        peak_rotation=peak,
        overturns=overturns,
        status=status if best.ended else Status.NOT_CONVERGED,
        objectives=np.where(np.isfinite(losses), objectives, np.nan),
        goal=goal,
    )


def _simulate_raised(
    best: Candidate, problem: TrainProblem, intensities: np.ndarray, by: float
) -> tuple[np.ndarray, np.ndarray, TrainResponse]:
    """Simulate the train in time, raised by a fraction; return its times and intensities too.

    It is timed by its own impacts, which come later in a stronger train: a pulse on the wrong
    side of an impact acts the other way. So pulses come a little later where they follow an
    impact, a little earlier where they precede one.
    """
    before = evaluate(best, problem, by - problem.margin).outcome.times
    after = evaluate(best, problem, by + problem.margin).outcome.times
    times = np.maximum.accumulate(np.where(best.phases > 0.5, before, after))
    raised = intensities * (1 + by)
    columns = jnp.asarray([times, raised], problem.rocker.restitution.dtype)
    return times, raised, follow_timed_train(problem.rocker, *columns)
