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
from .train import Flight, Rocker

Goal = Literal["smallest largest", "smallest total", "most rotation"]

_SKIPS = 3  # impacts between two pulses, at most
_STEPS = 40  # of L-BFGS at a time
_ROUNDS = 60
_ENOUGH = 1e-9  # relative improvement that is none
_PRESSURE = 30.0  # of a constraint that is broken


class Train(NamedTuple):
    """A train as it is optimised; the first pulse starts the motion.

    `phase` says where in its half-cycle a pulse comes, `skips` how many impacts lie between
    it and the one before, `weight` its intensity over the bound on it, outward positive.
    """

    phase: Any  # (pulses,)
    weight: Any  # (pulses,)
    skips: Any  # (pulses,) whole numbers


class _Outcome(NamedTuple):
    x: Any  # in the end; after the impact, if the block moves towards one
    times: Any  # (pulses,)
    sides: Any  # (pulses,) on which the block is struck
    late: Any  # (pulses,) time since the impact, in half-cycles


class _Search(NamedTuple):
    """One start: what is optimised, and how far that got."""

    angles: Any  # (pulses,) the phase is the square of their sine
    sizes: Any  # (pulses,) what gives the weights
    skips: Any  # (pulses,)
    strength: Any  # the bound on the pulses, over `Rocker.unit`
    multipliers: Any  # (pulses,) of the constraints
    loss: Any
    slope: Any  # largest component of its gradient


def shot(rocker: Rocker, train: Train, strength: Any, *, timed: bool) -> _Outcome:
    """What a train does, with the bound on its pulses over `Rocker.unit`.

    Without the times, which cost most of it, if these are not asked for.
    """
    impulses = strength * train.weight

    def pulse(carry: Any, each: Any) -> Any:
        phase, impulse, skips = each
        flight, time, side = carry
        again = skips == 0
        # From one half-cycle to the next, as many as there are impacts to come.
        x = flight.x
        for k in range(1, _SKIPS + 1):
            x = jnp.where(skips >= k, rocker.restitution * x, x)
        begin = jnp.where(again, flight.phase, 0)
        there = Flight.at(x, begin + phase * (1 - begin))
        late = jnp.zeros_like(x)
        if timed:
            # All at once, since to have each compiled for itself takes long.
            xs = flight.x * rocker.restitution ** jnp.arange(_SKIPS, dtype=x.dtype)
            whole = rocker.duration(jnp.append(xs, x))
            both = jax.tree.map(lambda *parts: jnp.stack(parts), flight, there)
            since = rocker.since_launch(both)
            passed = jnp.where(skips > jnp.arange(_SKIPS), whole[:-1], 0).sum()
            time = time - since[0] + passed + since[1]
            late = since[1] / jnp.where(whole[-1] > 0, whole[-1], 1)
        side = jnp.where(skips % 2 == 1, -side, side)
        return (rocker.struck(there, impulse), time, side), (time, side, late)

    first, zero = jnp.abs(impulses[0]), jnp.zeros_like(impulses[0])
    begin = (Flight(zero, first), zero, zero + 1)
    (flight, *_), later = jax.lax.scan(
        pulse, begin, (train.phase[1:], impulses[1:], train.skips[1:])
    )
    x = jnp.where(flight.q < 0, rocker.restitution * flight.x, flight.x)
    before = (zero, zero + 1, zero)
    return _Outcome(x, *(jnp.append(b, a) for b, a in zip(before, later, strict=True)))


def _train_of(search: _Search, goal: Goal) -> Train:
    """A train from free variables: at its best, the slope to each of them is 0.

    Weights are at most 1 each, or 1 together where the total counts.
    """
    sizes = search.sizes
    if goal == "smallest total":
        weight = sizes * jnp.abs(sizes) / (sizes**2).sum()
    else:
        weight = jnp.sin(sizes)
    return Train(jnp.sin(search.angles) ** 2, weight, search.skips)


class _Limits(NamedTuple):
    spacing: Any  # [s]
    latest: Any  # [s]

    def broken(self, outcome: _Outcome, rocker: Rocker) -> Any:
        """By how much, times p: where positive, not kept."""
        gaps = self.spacing - jnp.diff(outcome.times)
        over = outcome.times[-1] - self.latest
        return jnp.append(gaps, over) * rocker.block.frequency_parameter


def _loss(
    free: tuple[Any, Any], search: _Search, rocker: Rocker, limits: _Limits | None, goal: Goal
) -> Any:
    """Minus the logarithm of the final velocity, and what broken constraints add to it."""
    search = search._replace(angles=free[0], sizes=free[1])
    outcome = shot(rocker, _train_of(search, goal), search.strength, timed=limits is not None)
    loss = -jnp.log(jnp.maximum(outcome.x, 1e-30))
    if limits is None:
        return loss
    pressed = search.multipliers + _PRESSURE * limits.broken(outcome, rocker)
    return loss + (jnp.maximum(pressed, 0) ** 2).sum() / (2 * _PRESSURE)


def _descended(
    search: _Search, rocker: Rocker, limits: _Limits | None, goal: Goal
) -> tuple[_Search, Any]:
    """After some steps of L-BFGS, and the loss in each."""
    import optax

    def loss(free: Any) -> Any:
        return _loss(free, search, rocker, limits, goal)

    solver = optax.lbfgs()
    sloped = optax.value_and_grad_from_state(loss)

    def step(carry: Any, _: Any) -> Any:
        free, state = carry
        value, slope = sloped(free, state=state)
        change, state = solver.update(slope, state, free, value=value, grad=slope, value_fn=loss)
        return (optax.apply_updates(free, change), state), value

    free = (search.angles, search.sizes)
    with jax.numpy_dtype_promotion("standard"):  # optax adds 32-bit counts to others
        (free, _), values = jax.lax.scan(step, (free, solver.init(free)), length=_STEPS)
    value, slope = jax.value_and_grad(loss)(free)
    steepest = jnp.max(jnp.abs(jnp.concatenate(slope)))
    found = search._replace(angles=free[0], sizes=free[1], loss=value, slope=steepest)
    return found, values


@eqx.filter_jit
def _descend(searches: _Search, rocker: Rocker, limits: _Limits | None, goal: Goal) -> Any:
    return jax.vmap(lambda search: _descended(search, rocker, limits, goal))(searches)


@eqx.filter_jit
def _outcomes(searches: _Search, rocker: Rocker, goal: Goal, timed: bool) -> _Outcome:
    def outcome(search: _Search) -> _Outcome:
        return shot(rocker, _train_of(search, goal), search.strength, timed=timed)

    return jax.vmap(outcome)(searches)


def _moved(searches: _Search, fewest: int) -> list[_Search]:
    """Each pulse put to where descent does not lead: there are valleys between."""
    found = []
    angles, sizes, skips = (
        np.asarray(part) for part in (searches.angles, searches.sizes, searches.skips)
    )
    for k in range(1, angles.shape[1]):
        other = {
            "struck the other way": (angles[:, k], -sizes[:, k], skips[:, k]),
            "before or after the peak": (np.pi / 2 - angles[:, k], -sizes[:, k], skips[:, k]),
            "earlier": (angles[:, k], sizes[:, k], np.maximum(skips[:, k] - 1, fewest)),
            "later": (angles[:, k], sizes[:, k], np.minimum(skips[:, k] + 1, _SKIPS)),
        }
        for angle, size, skip in other.values():
            parts = [angles.copy(), sizes.copy(), skips.copy()]
            for part, new in zip(parts, (angle, size, skip), strict=True):
                part[:, k] = new
            found.append(
                searches._replace(**dict(zip(("angles", "sizes", "skips"), parts, strict=True)))
            )
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
    shape = (starts, count)
    searches = _Search(
        angles=random.uniform(0, np.pi / 2, shape).astype(dtype),
        sizes=random.uniform(-1.5, 1.5, shape).astype(dtype),
        skips=random.integers(impacts_between, min(impacts_between + 2, _SKIPS) + 1, shape),
        strength=np.full(starts, strength, dtype),
        multipliers=np.zeros(shape, dtype),
        loss=np.zeros(starts, dtype),
        slope=np.zeros(starts, dtype),
    )
    return _found(searches, rocker, limits, goal, impacts_between)


def _found(
    searches: _Search, rocker: Rocker, limits: _Limits | None, goal: Goal, fewest: int
) -> WorstTrain:
    seeks = goal != "most rotation"
    eps = float(np.finfo(searches.angles.dtype).eps)
    history: list[np.ndarray] = []

    def objective(searches: _Search, loss: Any) -> Any:
        # Nearly what a train needs, which is in proportion to the velocity it leads to.
        with np.errstate(over="ignore"):
            needed = searches.strength * np.exp(loss) * float(rocker.unit)
            return needed if seeks else np.exp(-loss)

    def descended(searches: _Search) -> tuple[_Search, np.ndarray]:
        found, losses = jax.device_get(_descend(searches, rocker, limits, goal))
        return found, objective(searches, losses.T).T

    def rank(searches: _Search) -> Any:
        # Right before an impact a pulse does as much as right after the one before, later.
        later = (np.sin(searches.angles[:, 1:]) ** 2).sum(axis=1)
        return np.nan_to_num(searches.loss, nan=np.inf) + 10 * _ENOUGH * later

    def adopt(searches: _Search, path: np.ndarray) -> _Search:
        history.append(path)
        return searches

    searches = adopt(*descended(searches))
    for _ in range(1 if limits is None else 4):
        for _ in range(4 * searches.angles.shape[1]):
            options = [descended(option) for option in _moved(searches, fewest)]
            if not options:
                break
            ranks = np.stack([rank(option) for option, _ in options])
            best, each = ranks.argmin(axis=0), np.arange(ranks.shape[1])
            better = ranks.min(axis=0) < rank(searches) - _ENOUGH
            if not better.any():
                break

            def chosen(
                *parts: Any, best: Any = best, each: Any = each, better: Any = better
            ) -> Any:
                old, *new = parts
                picked = np.stack(new)[best, each]
                return np.where(better.reshape(-1, *(1,) * (old.ndim - 1)), picked, old)

            path = np.stack([path for _, path in options])[best, each]
            path = np.where(better[:, None], path, history[-1][:, -1:])
            searches = adopt(jax.tree.map(chosen, searches, *(s for s, _ in options)), path)
        for _ in range(_ROUNDS):
            outcome = jax.device_get(_outcomes(searches, rocker, goal, limits is not None))
            strength, multipliers = searches.strength, searches.multipliers
            before = multipliers
            if seeks:
                strength = strength / outcome.x
            if limits is not None:
                broken = np.stack([limits.broken(*each) for each in _each(outcome, rocker)])
                multipliers = np.maximum(multipliers + _PRESSURE * broken, 0)
                # Off the ends of the half-cycles, where the slope is 0 whatever is broken.
                pushed = np.append(np.zeros_like(broken[:, :1]), broken[:, :-1], axis=1) > eps**0.5
                angles = np.where(pushed, np.clip(searches.angles, 0.1, 1.4), searches.angles)
                searches = searches._replace(angles=angles)
            searches = searches._replace(strength=strength, multipliers=multipliers)
            searches = adopt(*descended(searches))
            still = not seeks or (abs(outcome.x - 1) < 8 * eps).all()
            if limits is not None:
                still &= np.allclose(multipliers, before, rtol=0, atol=0.1 * eps**0.5)
            if still:
                break

    outcome = jax.device_get(_outcomes(searches, rocker, goal, limits is not None))
    kept = np.ones(outcome.x.size, bool)
    if limits is not None:
        broken = np.stack([limits.broken(*each) for each in _each(outcome, rocker)])
        kept = broken.max(axis=1) < 100 * eps**0.5
    ended = kept & (searches.slope < 100 * eps**0.5)
    if seeks:
        ended &= abs(outcome.x - 1) < 100 * eps**0.5
    weights = jax.vmap(lambda search: _train_of(search, goal).weight)(searches)
    magnitudes = searches.strength[:, None] * np.asarray(weights) * float(rocker.unit)
    if goal == "smallest largest":
        objectives = abs(magnitudes).max(axis=1)
    elif goal == "smallest total":
        objectives = abs(magnitudes).sum(axis=1)
    else:
        objectives = outcome.x
    ranked = objectives if seeks else -objectives
    best = int(np.argmin(np.where(ended if ended.any() else kept, ranked, np.inf)))
    chosen_one = jax.tree.map(lambda part: part[best : best + 1], searches)
    train = jax.tree.map(lambda part: part[0], _outcomes(chosen_one, rocker, goal, True))
    times, delays = np.asarray(train.times), np.asarray(train.late)
    magnitudes[:, 0] = abs(magnitudes[:, 0])
    intensities = np.asarray(train.sides) * magnitudes[best]
    overturns = seeks or bool(train.x >= 1)
    peak = rocker.lean(Flight(train.x, jnp.zeros_like(train.x)))
    return WorstTrain(
        times=times,
        intensities=intensities,
        impacts_between=np.append(0, searches.skips[best, 1:]),
        delays=delays,
        largest=float(abs(intensities).max()),
        total=float(abs(intensities).sum()),
        peak_rotation=math.nan if overturns else float(peak),
        overturns=overturns,
        converged=bool(ended[best]),
        objectives=np.where(kept, objectives, np.nan),
        history=np.concatenate(history, axis=1),
        goal=goal,
    )


def _each(outcome: _Outcome, rocker: Rocker) -> list[tuple[_Outcome, Rocker]]:
    count = outcome.x.size
    return [(jax.tree.map(lambda part, k=k: part[k], outcome), rocker) for k in range(count)]
