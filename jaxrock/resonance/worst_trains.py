"""The worst train of pulses, found by optimisation."""

import math
from typing import NamedTuple

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
from .timed_train import SKIPS
from .train_descent import Goal, Limits, Question, Search, outcomes
from .train_moves import best_start, reached, searched, trial_of, with_time_to_try

_MANY_SKIPS = 20  # impacts between two pulses, at most, if they have to be apart


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
    model: ModelLike = Linearized(),
    starts: int = 10,
    seed: int = 0,
) -> WorstTrain:
    """The worst train of instantaneous pulses, over their times, signs and intensities.

    Between the pulses the block moves freely, and through impacts. From random trains, each
    descends by BFGS and then tries what descent cannot do: to strike a pulse the
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
    if not 0 <= impacts_between <= SKIPS:
        raise ValueError(f"impacts_between must be from 0 to {SKIPS}, got {impacts_between}")
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
    rocker = Rocker(block, restitution, as_model(model))
    unit = float(rocker.unit)
    limited = spacing > 0 or latest < math.inf
    # A constraint that is not there must not be infinite.
    far = min(latest, 1e6 * count / float(block.frequency_parameter))
    limits = Limits(jnp.asarray(spacing, dtype), jnp.asarray(far, dtype)) if limited else None
    if largest is not None:
        check("largest", as_real("largest", largest), POSITIVE)
        strength = largest / unit
    else:
        strength = 0.5 if goal == "smallest total" else 0.9 / count

    random = np.random.default_rng(seed)
    shape, most = (starts, count), _MANY_SKIPS if spacing > 0 else SKIPS
    # A weak train comes to rest where a stronger one has its impacts just in time.
    strengths = np.full(starts, strength)
    if spacing > 0 and goal == "smallest largest":
        strengths = np.geomspace(strength, 0.97, starts)
    skips = random.integers(impacts_between, min(impacts_between + 2, SKIPS) + 1, shape)
    searches = Search(
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
    question = Question(rocker, limits, goal, most)
    searches, history = searched(searches, question, impacts_between)
    if latest < math.inf:
        searches, question = with_time_to_try(searches, question, spacing, latest)
    return _result(searches, question, history, spacing, latest)


def _result(
    searches: Search, question: Question, history: np.ndarray, spacing: float, latest: float
) -> WorstTrain:
    rocker, goal = question.rocker, question.goal
    seeks = goal != "most rotation"
    outcome, magnitudes, objectives, kept = reached(searches, question)
    best = best_start(searches, question)
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
    searches: Search, question: Question, best: int, intensities: np.ndarray, peak: float
) -> tuple[np.ndarray, bool]:
    """When the pulses come, and whether that train does, followed over time, what it is to.

    It is tried raised and lowered by a little, each time in the rhythm of its own impacts,
    since these come later in a stronger train, and a pulse on the wrong side of an impact
    acts the other way. The times are those of the train that is raised, a hair later where
    a pulse comes right after an impact, a hair earlier where it comes right before.
    """
    rocker, trial = question.rocker, trial_of(searches.angles.dtype)
    before = np.cos(searches.angles[best]) < 0

    def followed(by: float, margin: float) -> tuple[np.ndarray, TrainResponse]:
        hairs = (
            outcomes(searches._replace(strength=searches.strength + by + hair), question)
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
