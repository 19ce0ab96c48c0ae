"""A test on a shaking table, fitted to one more part of the motion after another."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ..block import Block
from ..driven import Status, respond
from ..ground_motion import Motion
from ..resonance import RockingModel
from ..validation import Integers, Reals
from .least_squares import Flags, Places, Values, covariance_of, minimize

RESTITUTIONS = tuple(0.5 + 0.0025 * k for k in range(193))  # to begin with
_STARTS = 4  # of them from which the first part is fitted
_STAGES = (0.03, 0.06, 0.1, 0.2, 0.3, 0.4, 0.55, 0.7, 0.85, 1.0)  # of the impacts, by parts
_STEP_LEFT = 0.1  # that the search would still make, in standard errors
_BENDING = 0.5  # part by which a change of one standard error may differ from its derivative
_ROUGHER = 1.3  # times the noise of the part before: then it is another motion
_MOVED = 5.0  # standard errors of the part before, too
_OFF = 1.5  # times the noise that is seen in the measurements: then it is not their motion
_EXACT = 1e-9  # differences of what has no noise
_ROUNDING = {8: 1e-9, 4: 1e-6}  # part of a rotation, by the bytes of a number
_MAX_STEPS = 30
_SEEN = 4.0  # rotations over the noise, from which on they tell the side
_LEAST_TIMES = 1024  # there is room for, at least
_PIECE = (
    16  # times whose rotations are computed together: they take as long as the last of them
)


class ShakingTest(NamedTuple):
    """A test: what is measured, what is known, and which numbers are fitted.

    The search runs in numbers without bounds: logarithms, of C / (1 - C), of the inertia ratio
    less 1, and of lengths.
    """

    time: Float[np.ndarray, " times"]
    measured: Float[np.ndarray, " times"]
    counts: Bool[np.ndarray, " times"]
    noise: float
    known: dict[str, float]  # by the names that can be fitted
    gravity: Reals
    motion: Motion
    initial: tuple[Reals, Reals]
    parameters: tuple[str, ...]
    model: RockingModel
    room: int  # for impacts

    @property
    def dtype(self) -> np.dtype:
        """The precision in which the motion is computed."""
        return self.gravity.dtype

    def numbers(self, restitution: float) -> Values:
        """Return the numbers of the block that is given, with some restitution."""
        restitution = min(max(restitution, 0.01), 0.999)
        known = self.known | {
            "restitution": restitution / (1 - restitution),
            # From a point mass the search would never move away.
            "inertia_ratio": max(self.known["inertia_ratio"] - 1, 0.01),
        }
        return np.log([known[name] for name in self.parameters])

    def values(self, numbers: Values) -> tuple[Values, Values]:
        """Return the parameters themselves, and their slopes along the numbers."""
        with np.errstate(over="ignore", invalid="ignore"):
            growth = np.exp(numbers)
            shares = growth / (1 + growth)
        values = growth.copy()
        slopes = growth.copy()
        for k, name in enumerate(self.parameters):
            if name == "restitution":
                values[k] = shares[k]
                slopes[k] = shares[k] * (1 - shares[k])
            elif name == "inertia_ratio":
                values[k] = 1 + growth[k]
        return values, slopes

    def follow(self, numbers: Values, end: float) -> tuple[Values, Values, int]:
        """Rotations at the times up to an end [rad], their Jacobian, and how many impacts."""
        values, slopes = self.values(numbers)
        known = self.known | dict(zip(self.parameters, values, strict=True))
        until = int(np.searchsorted(self.time, end, side="right"))
        room = _LEAST_TIMES
        while room < self.time.size:
            room *= 4  # so that few lengths are compiled
        times = np.pad(self.time[:until], (0, room - until))
        pieces = np.asarray(-(-until // _PIECE))
        jacobian = np.empty((until, len(self.parameters)))
        rotation = jacobian[:, 0]
        impacts = 0
        for k, name in enumerate(self.parameters):
            along = {other: slopes[k] if other == name else 0.0 for other in known}
            parts = (known, along, times, np.asarray(end))
            parts = jax.tree.map(lambda leaf: np.asarray(leaf, self.dtype), parts)
            fixed = self.gravity, self.motion, self.initial
            found = _rotations(*parts, pieces, *fixed, self.model, room=self.room)
            rotation, slope, impacts = (np.asarray(part) for part in found)
            jacobian[:, k] = slope[:until]
        return rotation[:until].astype(float), jacobian, int(impacts)


@functools.partial(jax.jit, static_argnames="room")
def _rotations(
    known: dict[str, Reals],
    along: dict[str, Reals],
    times: Reals,
    end: Reals,
    pieces: Integers,
    gravity: Reals,
    motion: Motion,
    initial: tuple[Reals, Reals],
    model: RockingModel,
    room: int,
) -> tuple[Reals, Reals, Integers]:
    """Rotations [rad], their slopes along a change of what is known, and how many impacts.

    One direction at a time: a Jacobian would be another program for each set of parameters.
    """

    def rotations(known: dict[str, Reals]) -> tuple[Reals, Integers]:
        size = known["half_width"], known["slenderness"], gravity, known["inertia_ratio"]
        response = respond(
            Block(*size),
            known["restitution"],
            motion,
            end,
            rotation=initial[0],
            velocity=initial[1],
            model=model,
            max_impacts=room,
        )
        complete = response.status == Status.COMPLETE
        asked = jnp.where(complete, times, 0)

        def piece(k: Integers, found: Reals) -> Reals:
            some = jax.lax.dynamic_slice(asked, (k * _PIECE,), (_PIECE,))
            return jax.lax.dynamic_update_slice(
                found, response.history(some)[0], (k * _PIECE,)
            )

        rotations = jax.lax.fori_loop(0, pieces, piece, jnp.zeros_like(times))
        return jnp.where(complete, rotations, jnp.nan), response.impacts

    return jax.jvp(rotations, (known,), (along,), has_aux=True)


class Stage(NamedTuple):
    """The fit to a part of the motion."""

    end: float
    numbers: Values
    values: Values
    covariance: Values
    noise: float
    off: float  # root of the mean square of the residuals
    converged: bool

    def follows(self, last: "Stage") -> bool:
        """Tell whether a fit follows the motion of the part before, and still tells something."""
        if not self.converged or not last.converged:
            return self.converged
        errors = np.sqrt(np.diagonal(last.covariance))
        near = np.abs(self.values - last.values) <= _MOVED * errors + _EXACT
        return self.off <= _ROUGHER * last.off + _EXACT and bool(near.all())

    def closer(self, other: "Stage") -> bool:
        """Tell whether it is the better one of two fits to the same part."""
        if self.converged != other.converged:
            return self.converged
        return not self.off >= other.off


def _fit(test: ShakingTest, start: Values, end: float, noise: float | None) -> Stage:
    """Fit a part of the motion, up to a time; the noise is that which is known."""
    counts = test.counts[test.time <= end]
    measured = test.measured[: counts.size][counts]

    def evaluate(numbers: Values, places: Places) -> tuple[Values, Values]:
        rotation, jacobian, _ = test.follow(numbers[0], end)
        off = rotation[counts] - measured
        return off[None] / test.noise, jacobian[counts][None] / test.noise

    rounding = _ROUNDING[test.dtype.itemsize] * np.abs(measured).max(initial=0)
    negligible = counts.sum() * (rounding / test.noise) ** 2
    least = minimize(evaluate, start[None], negligible, _MAX_STEPS)
    numbers = least.numbers[0]
    values, slopes = test.values(numbers)
    off = least.residuals[0] * test.noise
    steep = least.jacobian[0] * test.noise
    mean_square = float(np.mean(off**2))
    sigma = noise
    if sigma is None:
        sigma = float(np.sqrt(np.sum(off**2) / max(1, off.size - values.size)))
    covariance = sigma**2 * covariance_of(steep)
    converged = False
    if np.isfinite(covariance).all() and np.isfinite(off).all():
        step = np.linalg.lstsq(steep, off)[0]
        errors = np.sqrt(np.diagonal(covariance))
        exact = (errors <= 64 * np.finfo(test.dtype).eps) | (mean_square**0.5 <= rounding)
        seen = _seen_noise(measured) if noise is None else noise
        converged = bool(np.all(exact | (np.abs(step) <= _STEP_LEFT * errors)))
        converged = converged and mean_square**0.5 <= _OFF * seen
        converged = converged and (
            bool(exact.all())
            or all(
                _is_straight(
                    test, numbers, k, errors[k], end, counts, off + measured, steep[:, k]
                )
                for k in range(values.size)
            )
        )
    covariance = covariance * np.outer(slopes, slopes) if converged else covariance * np.nan
    return Stage(end, numbers, values, covariance, sigma, mean_square**0.5, converged)


def _is_straight(
    test: ShakingTest,
    numbers: Values,
    place: int,
    error: float,
    end: float,
    counts: Flags,
    rotation: Values,
    slope: Values,
) -> bool:
    """Tell whether a change of one standard error does what the derivative says."""
    moved = numbers.copy()
    moved[place] += error
    change = test.follow(moved, end)[0][counts] - rotation
    expected = slope * error
    return bool(np.linalg.norm(change - expected) <= _BENDING * np.linalg.norm(expected))


def _first_numbers(test: ShakingTest, restitution: float | None, end: float) -> list[Values]:
    """Numbers to begin with, those with restitutions that fit best up to a time first."""
    if restitution is not None or "restitution" not in test.parameters:
        return [test.numbers(test.known["restitution"])]
    trials = [test.numbers(value) for value in RESTITUTIONS]
    squares = []
    for trial in trials:
        rotation, _, _ = test.follow(trial, end)
        off = (rotation - test.measured[: rotation.size])[test.counts[: rotation.size]]
        squares.append(float(np.sum(off**2)))
    order = np.argsort(np.nan_to_num(squares, nan=np.inf))
    return [trials[k] for k in order[:_STARTS]]


def _ends(time: np.ndarray, sides: np.ndarray) -> list[float]:
    """Return times up to which one more part of the impacts is over."""
    seen = np.flatnonzero(sides)
    changes = seen[1:][np.diff(sides[seen]) != 0]
    if not changes.size:
        raise ValueError("rotation must be of a block that rocks, got one without an impact")
    places = [min(changes.size - 1, int(share * changes.size) + 1) for share in _STAGES[:-1]]
    return [*dict.fromkeys(float(time[changes[place]]) for place in places), float(time[-1])]


def sides_of(test: ShakingTest, rotation: np.ndarray) -> np.ndarray:
    """Tell on which side a block is seen at each time, 0 where it is not."""
    seen = np.abs(rotation) > _SEEN * test.noise
    return np.where(seen & test.counts, np.sign(rotation), 0)


def rough_noise(rotation: np.ndarray) -> float:
    """Return a noise beyond which a rotation tells the side."""
    return max(_seen_noise(rotation), 0.01 * float(np.max(np.abs(rotation))))


def _seen_noise(rotation: np.ndarray) -> float:
    """By the second differences, in which smooth motion nearly vanishes; at least rounding."""
    bends = np.abs(np.diff(rotation, 2))
    by_bends = float(np.median(bends)) / (0.6745 * 6**0.5) if bends.size else 0.0
    return max(by_bends, 1e-6 * float(np.max(np.abs(rotation))))


def fit_in_parts(test: ShakingTest, restitution: float | None, noise: float | None) -> Stage:
    """Fit as much of the motion as can be followed from one part to the next."""
    first, *ends = _ends(test.time, sides_of(test, test.measured))
    start, *others = _first_numbers(test, restitution, first)
    last = _fit(test, start, first, noise)
    for numbers in others:
        stage = _fit(test, numbers, first, noise)
        if stage.closer(last):
            last = stage
    for end in ends:
        stage = _fit(test, last.numbers, end, noise)
        if not stage.follows(last):
            break
        last = stage
    return last
