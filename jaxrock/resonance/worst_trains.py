"""The worst train of pulses, found by optimisation."""

import math
from dataclasses import dataclass
from typing import get_args

import jax
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..host import with_clock
from ..validation import (
    NON_NEGATIVE,
    POSITIVE,
    UNIT_INTERVAL,
    Number,
    as_real,
    check,
    of_one_precision,
)
from .free_rocking import Linearized, ModelLike, as_model
from .pulse_train import Flight, Rocker, TrainResponse, follow
from .train_optimization import Goal, Problem, Search, outcomes
from .train_sequences import best_start, evaluated, searched, trial_of, with_time_to_verify
from .train_through_impacts import MAX_IMPACTS

_MAX_IMPACTS_APART = 20  # between two pulses, if they have to be apart


@dataclass(frozen=True)
class WorstTrain:
    """The worst train of pulses that was found; see `worst_train`.

    Attributes
    ----------
    times, intensities : ndarray, shape (pulses,)
        When the pulses come, the first at 0 [s], and I of each [m/s], signed as the ground moves.
    impacts_between, delays : ndarray, shape (pulses,)
        Impacts between a pulse and the one before it, and time from the last impact to the
        pulse over the half-cycle that it falls into [-].
    largest, total, peak_rotation : float
        Largest and total magnitude of the pulses [m/s], and the peak after the last [rad]; NaN
        if the block overturns.
    overturns, converged : bool
        Whether the train just overturns the block, or more; whether the search has ended, at
        a train that keeps the constraints.
    objectives : ndarray, shape (starts,)
        What each start arrived at: the largest or total intensity [m/s], or the velocity
        after the last pulse over the critical one.
    history : ndarray, shape (starts, steps)
        The same in each step of the descent.
    goal : str
        That of the search.
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
        pulses = zip(self.times, self.intensities, self.delays, strict=True)
        lines += [
            f"{time:10.4f}  {intensity:15.5g}  {round(float(delay), 5) + 0.0:.5f}"
            for time, intensity, delay in pulses
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
    model: ModelLike = Linearized(),
    starts: int = 10,
    seed: int = 0,
) -> WorstTrain:
    """The worst train of instantaneous pulses, over their times, signs and intensities.

    Between the pulses the block moves freely, and through impacts. From random trains, each
    descends by BFGS and then tries what descent cannot do: to strike a pulse the other way,
    before or after the peak, or a half-cycle earlier or later. The result is verified over
    time, raised and lowered a little.

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
    spacing, latest : float
        Shortest time between two pulses, and when the last comes at the latest [s].
    model : Linearized or Nonlinear
        Equation of the motion between the pulses.
    starts, seed : int
        Number of random trains to start from, and seed of the random numbers.

    Returns
    -------
    WorstTrain
        The best of all starts, and what each arrived at.

    Raises
    ------
    ValueError
        If an argument is out of range, or the constraints contradict each other.

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
    _check_arguments(count, starts, goal, largest, impacts_between, spacing, latest)
    block, restitution = of_one_precision((block, restitution))
    if any(jnp.ndim(leaf) for leaf in jax.tree.leaves((block, restitution))):
        raise ValueError("block and restitution must be one, not arrays")
    dtype, rocker = restitution.dtype, Rocker(block, restitution, as_model(model))
    problem = Problem(
        rocker=rocker,
        goal=goal,
        max_impacts=_MAX_IMPACTS_APART if spacing > 0 else MAX_IMPACTS,
        constrained=spacing > 0 or latest < math.inf,
        spacing=jnp.asarray(spacing, dtype),
        # In a Lagrangian even a constraint that is not there must not be infinite.
        latest=jnp.asarray(min(latest, 1e6 * count / float(block.frequency_parameter)), dtype),
    )

    bound = 0.5 if goal == "smallest total" else 0.9 / count
    bounds = np.full(starts, largest / float(rocker.unit) if largest else bound)
    if spacing > 0 and goal == "smallest largest":
        # A weak train comes to rest where a stronger one has its impacts just in time.
        bounds = np.geomspace(bound, 0.97, starts)
    begin = _random_starts(np.log(bounds).astype(dtype), count, impacts_between, seed)
    searches, history = searched(begin, problem, impacts_between)
    if latest < math.inf:
        searches, problem = with_time_to_verify(searches, problem)
    return _result(searches, problem, history, spacing, latest)


def _check_arguments(
    count: int,
    starts: int,
    goal: str,
    largest: float | None,
    impacts_between: int,
    spacing: float,
    latest: float,
) -> None:
    for name, value in (("count", count), ("starts", starts)):
        if value < 1:
            raise ValueError(f"{name} must be at least 1, got {value}")
    if goal not in get_args(Goal):
        raise ValueError(
            f"goal must be smallest largest, smallest total or most rotation, got {goal!r}"
        )
    if (largest is None) == (goal == "most rotation"):
        raise ValueError('largest must be given for the goal "most rotation", and only for it')
    if largest is not None:
        check("largest", as_real("largest", largest), POSITIVE)
    if not 0 <= impacts_between <= MAX_IMPACTS:
        raise ValueError(f"impacts_between must be from 0 to {MAX_IMPACTS}, got {impacts_between}")
    check("spacing", as_real("spacing", spacing), NON_NEGATIVE)
    if not latest >= 0:
        raise ValueError(f"latest must be at least 0, got {latest:g}")
    if (count - 1) * spacing > latest:
        raise ValueError(
            f"count, spacing and latest contradict each other: {count} pulses {spacing:g} s"
            f" apart take {(count - 1) * spacing:g} s, which is more than {latest:g} s"
        )


def _random_starts(log_bounds: np.ndarray, count: int, fewest: int, seed: int) -> Search:
    starts, dtype = log_bounds.size, log_bounds.dtype
    random, shape = np.random.default_rng(seed), (starts, count)
    impacts = random.integers(fewest, min(fewest + 2, MAX_IMPACTS) + 1, shape)
    return Search(
        angles=random.uniform(0, np.pi, shape).astype(dtype),
        sizes=random.uniform(-1.5, 1.5, shape).astype(dtype),
        log_bound=log_bounds,
        impacts=impacts,
        count=np.full(starts, count),
        multipliers=np.zeros(shape, dtype),
        loss=np.zeros(starts, dtype),
        violation=np.zeros(starts, dtype),
        ended=np.zeros(starts, bool),
    )


def _result(
    searches: Search, problem: Problem, history: np.ndarray, spacing: float, latest: float
) -> WorstTrain:
    """The best train of all searches, verified."""
    outcome, impulses, objectives, feasible = evaluated(searches, problem)
    best = best_start(searches, problem)
    count = int(searches.count[best])
    intensities = (outcome.sides * impulses)[best, :count]
    impacts = searches.impacts[best, 1:count]
    overturns = problem.seeks_bound or bool(outcome.x[best] >= 1)
    top = Flight(jnp.asarray(outcome.x[best]), jnp.zeros_like(outcome.x[best]))
    peak = math.nan if overturns else float(problem.rocker.rotation(top))
    times, verified = _verified(searches, problem, best, intensities, peak)
    in_time = (np.diff(times) >= spacing * (1 - 1e-9)).all() and times[-1] <= latest
    # At the limit, even more impacts between two pulses might be worse.
    in_time = in_time and (impacts < _MAX_IMPACTS_APART).all()
    return WorstTrain(
        times=times,
        intensities=intensities,
        impacts_between=np.append(0, impacts),
        delays=outcome.delays[best, :count],
        largest=float(abs(intensities).max()),
        total=float(abs(intensities).sum()),
        peak_rotation=peak,
        overturns=overturns,
        converged=bool(feasible[best] and searches.ended[best] and verified and in_time),
        objectives=np.where(feasible, objectives, np.nan),
        history=history,
        goal=problem.goal,
    )


def _verified(
    searches: Search, problem: Problem, best: int, intensities: np.ndarray, peak: float
) -> tuple[np.ndarray, bool]:
    """When the pulses come, and whether the train, followed over time, does what it should.

    Raised a little it has to overturn, lowered a little not. Each is timed by its own impacts,
    which come later in a stronger train: a pulse on the wrong side of an impact acts the other
    way. The times are those of the raised train, with a margin: a little later where a pulse
    comes right after an impact, a little earlier where it comes right before.
    """
    rocker, trial = problem.rocker, trial_of(searches.angles.dtype)
    early = np.cos(searches.angles[best]) < 0

    def followed(by: float, margin: float) -> tuple[np.ndarray, TrainResponse]:
        bounds = (searches.log_bound + by + slight for slight in (-margin, margin))
        trains = (outcomes(searches._replace(log_bound=bound), problem) for bound in bounds)
        times = np.where(early, *(np.asarray(train.times)[best] for train in trains))
        times = np.maximum.accumulate(times)[: intensities.size]
        return times, follow(rocker, jnp.asarray(times), jnp.asarray(intensities * (1 + by)))

    times, verified = np.zeros(0), False
    for margin in (1e-4 * trial, 1e-3 * trial, 1e-2 * trial, 1e-1 * trial):
        times, higher = followed(trial, margin)
        _, lower = followed(-trial, margin)
        if problem.seeks_bound:
            verified = bool(higher.overturned) and not bool(lower.overturned)
        elif math.isnan(peak):
            verified = bool(higher.overturned)
        else:
            verified = float(lower.peak_rotation) <= peak <= float(higher.peak_rotation)
        if verified:
            break
    return times, verified
