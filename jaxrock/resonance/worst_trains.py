"""The worst train of pulses, found by optimisation."""

import math
from dataclasses import dataclass
from typing import Any, get_args

import jax
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..host import Printed, with_clock
from ..validation import (
    NON_NEGATIVE,
    POSITIVE,
    UNIT_INTERVAL,
    Number,
    as_real,
    check,
    check_kind,
    of_one_precision,
)
from .free_rocking import Linearized, ModelLike, as_model
from .pulse_train import Flight, Rocker, TrainResponse, follow
from .train_optimization import (
    PENALTY,
    Goal,
    Problem,
    Search,
    feasible,
    outcomes,
    searched,
    solved,
    tolerance,
)
from .train_through_impacts import MAX_IMPACTS

_MAX_IMPACTS_APART = 20  # between two pulses, if they have to be apart


@dataclass(frozen=True, repr=False)
class WorstTrain(Printed):
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

    Between the pulses the block moves freely, and through impacts. Random trains descend by
    BFGS, and then try what descent cannot do: to strike a pulse the other way, before or after
    the peak, or a half-cycle earlier or later. The best is verified over time, raised and
    lowered a little.

    Parameters
    ----------
    block, restitution : Block, float
        One block and its C [-], between 0 and 1.
    count : int
        Number of pulses, at least 1.
    goal, largest : str, float
        ``"smallest largest"``: overturn the block with the smallest largest pulse;
        ``"smallest total"``: with the smallest sum of magnitudes; ``"most rotation"``: the
        highest peak with pulses of at most `largest` [m/s].
    impacts_between : int
        Fewest impacts between a pulse and the next, 0 to 3. With 0 and no spacing the worst
        is that all come at once.
    spacing, latest : float
        Shortest time between two pulses, and when the last comes at the latest [s].
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
    check_kind("block", block, Block)
    block.check()
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
    block, restitution = of_one_precision((block, restitution))
    if any(jnp.ndim(leaf) for leaf in jax.tree.leaves((block, restitution))):
        raise ValueError("block and restitution must be one, not arrays")
    dtype, rocker = restitution.dtype, Rocker(block, restitution, as_model(model))
    problem = Problem(
        rocker=rocker,
        goal=goal,
        max_impacts=_MAX_IMPACTS_APART if spacing > 0 else MAX_IMPACTS,
        constrained=bool(spacing > 0 or latest < math.inf),
        spacing=jnp.asarray(spacing, dtype),
        # In a Lagrangian even a constraint that is not there must not be infinite.
        latest=jnp.asarray(min(latest, 1e6 * count / float(block.frequency_parameter)), dtype),
    )

    bound = 0.5 if goal == "smallest total" else 0.9 / count
    bounds = np.full(starts, largest / float(rocker.unit) if largest else bound)
    if spacing > 0 and goal == "smallest largest":
        # A weak train comes to rest where a stronger one has its impacts just in time.
        bounds = np.geomspace(bound, 0.97, starts)
    begin = _random_starts(np.log(bounds), count, impacts_between, seed, dtype)
    searches, history = searched(begin, problem, impacts_between)
    train = _result(searches, problem, history, spacing, latest)
    for _ in range(3):
        # The times are those of a train that is raised, whose impacts come later: by how much
        # depends on the train, and any more would make the pulses larger than need be.
        late = float(train.times[-1]) - latest
        if late <= 0:
            break
        # As exactly as the multipliers keep the limit.
        late += tolerance(searches) / (PENALTY * float(block.frequency_parameter))
        earlier = max(float(problem.latest) - late, (count - 1) * spacing)
        problem = problem._replace(latest=jnp.asarray(earlier, dtype))
        searches, _ = solved(searches, problem)
        train = _result(searches, problem, history, spacing, latest)
    return train


def _random_starts(
    log_bounds: np.ndarray, count: int, fewest: int, seed: int, dtype: Any
) -> Search:
    random, starts = np.random.default_rng(seed), log_bounds.size
    impacts = random.integers(fewest, min(fewest + 2, MAX_IMPACTS) + 1, (starts, count))
    angles, sizes = (random.uniform(*ends, impacts.shape) for ends in ((0, np.pi), (-1.5, 1.5)))
    zeros = np.zeros(starts, dtype)
    return Search(
        free=np.column_stack([angles, sizes, log_bounds]).astype(dtype),
        impacts=impacts,
        count=np.full(starts, count),
        multipliers=np.zeros((starts, count + 1), dtype),
        loss=zeros,
        violation=zeros,
        ended=zeros > 0,
    )


def _result(
    searches: Search, problem: Problem, history: np.ndarray, spacing: float, latest: float
) -> WorstTrain:
    """The best train of all searches, verified."""
    trains, outcome = jax.device_get(outcomes(searches, problem))
    unit, sign = (float(problem.rocker.unit), 1) if problem.seeks_bound else (1.0, -1)
    reached = np.exp(searches.free[:, -1]) * unit if problem.seeks_bound else outcome.x
    objectives = np.where(feasible(searches), reached, np.nan)
    # Of equally good ones, one whose search has ended.
    losses = np.nan_to_num(sign * objectives, nan=np.inf)
    equal = losses <= losses.min() + tolerance(searches) * abs(losses.min())
    ended = equal & searches.ended
    best = int(np.argmin(np.where(ended, losses, np.inf) if ended.any() else losses))

    count = int(searches.count[best])
    impulses = np.append(abs(trains.impulse[best, :1]), trains.impulse[best, 1:count])
    intensities = outcome.sides[best, :count] * impulses * float(problem.rocker.unit)
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
        converged=bool(np.isfinite(losses[best]) and searches.ended[best] and verified and in_time),
        objectives=objectives,
        history=history * unit,
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
    count, dtype = intensities.size, searches.free.dtype
    trial = max(1e-6, float(np.finfo(dtype).eps) ** 0.5)
    early = np.cos(searches.free[best, :count]) < 0

    def times_of(raised: float) -> np.ndarray:
        free = searches.free + np.append(np.zeros(searches.free.shape[1] - 1), raised)
        _, outcome = outcomes(searches._replace(free=free.astype(dtype)), problem)
        return np.asarray(outcome.times)[best, :count]

    def followed(by: float, margin: float) -> tuple[np.ndarray, TrainResponse]:
        times = np.where(early, times_of(by - margin), times_of(by + margin))
        times = np.maximum.accumulate(times)
        return times, follow(
            problem.rocker, jnp.asarray(times), jnp.asarray(intensities * (1 + by))
        )

    times, verified = np.zeros(0), False
    for margin in (1e-4 * trial, 1e-3 * trial, 1e-2 * trial, 1e-1 * trial):
        times, higher = followed(trial, margin)
        _, lower = followed(-trial, margin)
        verified = bool(higher.overturned)
        if problem.seeks_bound:
            verified &= not lower.overturned
        elif not math.isnan(peak):
            verified = float(lower.peak_rotation) <= peak <= float(higher.peak_rotation)
        if verified:
            break
    return times, verified
