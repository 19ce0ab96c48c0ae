"""Fit of a test on a shaking table, to one more part of the motion after another.

Small changes grow from impact to impact: over the whole of a long test the misfit as a
function of C has many minima, and derivatives say nothing about the next one. Over the first
impacts it has few. Numbers that fit these are near enough to fit a few impacts more, and so
on.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ..block import Block
from ..driven import respond
from ..ground_motion import Motion
from ..host import Status
from ..resonance import RockingModel
from ..validation import Integers, Reals
from .least_squares import Flags, Places, Values, compute_covariance, minimize

# Values of C to begin with, so close together that one of them is near the best one even where
# the first part of the motion has several impacts.
RESTITUTIONS = tuple(0.5 + 0.0025 * k for k in range(193))
_STARTS = 4  # of them from which the first part is fitted
# Of the impacts, by parts. The first ones are short: there a start that is a step of
# `RESTITUTIONS` away still has its impacts in the order of the measured ones.
_STAGES = (0.03, 0.06, 0.1, 0.2, 0.3, 0.4, 0.55, 0.7, 0.85, 1.0)
# A part counts as fitted if the search has arrived there, if the derivatives mean something
# over one standard error, and if the residuals look like noise.
_STEP_LEFT = 0.1  # that the search would still make, in standard errors
_BENDING = 0.5  # part by which a change of one standard error may differ from its derivative
_OFF = 1.5  # times the noise that is seen in the measurements: then it is not their motion
# It follows the part before if neither the residuals nor the numbers have jumped.
_ROUGHER = 1.3  # times the noise of the part before: then it is another motion
_MOVED = 5.0  # standard errors of the part before, too
_EXACT = 1e-9  # differences of what has no noise
_ROUNDING = {8: 1e-9, 4: 1e-6}  # part of a rotation, by the bytes of a number
_MAX_STEPS = 30
_SEEN = 4.0  # rotations over the noise, from which on they tell the side
_LEAST_TIMES = 1024  # there is room for, at least, so that most tests take the same program
# Times whose rotations are computed together: mapped over, they take as long as the last of
# them.
_PIECE = 16


class ShakingTest(NamedTuple):
    """A test: its measurements, all that is known, and which numbers are fitted.

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

    def to_numbers(self, restitution: float) -> Values:
        """Convert the block that is given, with some restitution, to numbers."""
        # At 0 and 1 there is no number, and near them the search would not move.
        restitution = min(max(restitution, 0.01), 0.999)
        known = self.known | {
            "restitution": restitution / (1 - restitution),
            # From a point mass the search would never move away.
            "inertia_ratio": max(self.known["inertia_ratio"] - 1, 0.01),
        }
        return np.log([known[name] for name in self.parameters])

    def to_values(self, numbers: Values) -> tuple[Values, Values]:
        """Convert numbers to the parameters, and to their slopes along the numbers."""
        # A trial step may be as far off as it likes; its motion is then refused.
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
        """Compute rotations up to a time [rad], their Jacobian, and the number of impacts."""
        values, slopes = self.to_values(numbers)
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
            outputs = _compute_rotations(*parts, pieces, *fixed, self.model, room=self.room)
            rotation, slope, impacts = map(np.asarray, outputs)
            jacobian[:, k] = slope[:until]
        return rotation[:until].astype(float), jacobian, int(impacts)


@functools.partial(jax.jit, static_argnames="room")
def _compute_rotations(  # noqa: PLR0913
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
    """Compute rotations [rad], their slopes along a change, and the number of impacts.

    One direction at a time: a Jacobian would be another program for each set of parameters.
    """

    def compute(known: dict[str, Reals]) -> tuple[Reals, Integers]:
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
        # Where the integration did not finish, the motion is known at time 0 only.
        asked = jnp.where(complete, times, 0)

        # The number of pieces is an argument: room for times that is not used costs nothing.
        def fill_piece(k: Integers, rotations: Reals) -> Reals:
            some = jax.lax.dynamic_slice(asked, (k * _PIECE,), (_PIECE,))
            return jax.lax.dynamic_update_slice(
                rotations, response.history(some)[0], (k * _PIECE,)
            )

        rotations = jax.lax.fori_loop(0, pieces, fill_piece, jnp.zeros_like(times))
        return jnp.where(complete, rotations, jnp.nan), response.impacts

    return jax.jvp(compute, (known,), (along,), has_aux=True)


class Stage(NamedTuple):
    """The fit to a part of the motion."""

    end: float  # time [s]
    numbers: Values
    values: Values
    covariance: Values
    noise: float
    misfit: float  # root of the mean square of the residuals [rad]
    converged: bool

    def continues(self, last: "Stage") -> bool:
        """Return whether the fit follows the motion of the part before, and says something."""
        # After a part that was too short to fit, any part that is fitted is a beginning.
        if not self.converged or not last.converged:
            return self.converged
        errors = np.sqrt(np.diagonal(last.covariance))
        near = np.abs(self.values - last.values) <= _MOVED * errors + _EXACT
        return self.misfit <= _ROUGHER * last.misfit + _EXACT and bool(near.all())

    def is_better_than(self, other: "Stage") -> bool:
        """Return whether this is the better one of two fits to the same part."""
        if self.converged != other.converged:
            return self.converged
        return not self.misfit >= other.misfit


def _fit_part(test: ShakingTest, start: Values, end: float, noise: float | None) -> Stage:
    """Fit a part of the motion, up to a time, from a start; `noise` is None if not known."""
    counts = test.counts[test.time <= end]
    measured = test.measured[: counts.size][counts]

    def evaluate(numbers: Values, places: Places) -> tuple[Values, Values]:
        rotation, jacobian, _ = test.follow(numbers[0], end)
        residuals = rotation[counts] - measured
        return residuals[None] / test.noise, jacobian[counts][None] / test.noise

    # Sums of squares that differ by what the integrator leaves are the same.
    rounding = _ROUNDING[test.dtype.itemsize] * np.abs(measured).max(initial=0)
    negligible = counts.sum() * (rounding / test.noise) ** 2
    least = minimize(evaluate, start[None], negligible, _MAX_STEPS)
    numbers = least.numbers[0]
    values, slopes = test.to_values(numbers)
    residuals = least.residuals[0] * test.noise
    jacobian = least.jacobian[0] * test.noise
    mean_square = float(np.mean(residuals**2))

    # Errors of the numbers, from residuals in radians.
    sigma = noise
    if sigma is None:
        sigma = float(np.sqrt(np.sum(residuals**2) / max(1, residuals.size - values.size)))
    covariance = sigma**2 * compute_covariance(jacobian)

    # A motion whose integration does not finish is NaN, and the search has not converged.
    converged = False
    if np.isfinite(covariance).all() and np.isfinite(residuals).all():
        step = np.linalg.lstsq(jacobian, residuals)[0]
        errors = np.sqrt(np.diagonal(covariance))
        # Errors of exact rotations are no more than rounding, and so are their steps and
        # bends.
        exact = (errors <= 64 * np.finfo(test.dtype).eps) | (mean_square**0.5 <= rounding)
        # Residuals are compared with the scatter of the measurements themselves: a noise
        # estimated from the residuals would fit any motion.
        seen = _estimate_noise(measured) if noise is None else noise
        converged = bool(np.all(exact | (np.abs(step) <= _STEP_LEFT * errors)))
        converged = converged and mean_square**0.5 <= _OFF * seen
        converged = converged and (
            bool(exact.all())
            or all(
                _is_straight(
                    test,
                    numbers,
                    k,
                    errors[k],
                    end,
                    counts,
                    residuals + measured,
                    jacobian[:, k],
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
    """Return whether a change of one standard error does what the derivative says."""
    # Where a standard error changes the motion otherwise than its derivative does, least
    # squares says nothing about errors, and nothing about where to go: impacts come in another
    # order, or small changes have grown too much.
    moved = numbers.copy()
    moved[place] += error
    change = test.follow(moved, end)[0][counts] - rotation
    expected = slope * error
    return bool(np.linalg.norm(change - expected) <= _BENDING * np.linalg.norm(expected))


def _choose_starts(test: ShakingTest, restitution: float | None, end: float) -> list[Values]:
    """Choose numbers to begin with: restitutions that fit best up to a time come first."""
    if restitution is not None or "restitution" not in test.parameters:
        return [test.to_numbers(test.known["restitution"])]
    trials = [test.to_numbers(value) for value in RESTITUTIONS]
    squares = []
    for trial in trials:
        rotation, _, _ = test.follow(trial, end)
        residuals = (rotation - test.measured[: rotation.size])[test.counts[: rotation.size]]
        squares.append(float(np.sum(residuals**2)))
    # One is not enough: with noise, or a block that is not quite the right one, the best start
    # need not lie beside the best fit.
    order = np.argsort(np.nan_to_num(squares, nan=np.inf))
    return [trials[k] for k in order[:_STARTS]]


def _divide_motion(time: np.ndarray, sides: np.ndarray) -> list[float]:
    """Divide the motion: return times up to which one more part of the impacts is over."""
    # An impact is over where the block is first seen on the other side.
    seen = np.flatnonzero(sides)
    changes = seen[1:][np.diff(sides[seen]) != 0]
    if not changes.size:
        raise ValueError("rotation must show a block that rocks, got no impact")
    places = [min(changes.size - 1, int(share * changes.size) + 1) for share in _STAGES[:-1]]
    return [*dict.fromkeys(float(time[changes[place]]) for place in places), float(time[-1])]


def detect_sides(test: ShakingTest, rotation: np.ndarray) -> np.ndarray:
    """Detect the side of a block at each time, by its sign; 0 where it is not seen."""
    seen = np.abs(rotation) > _SEEN * test.noise
    return np.where(seen & test.counts, np.sign(rotation), 0)


def estimate_rough_noise(rotation: np.ndarray) -> float:
    """Estimate the noise; rotations of more than `_SEEN` times as much tell the side.

    It is at least a hundredth of the largest rotation. Exact rotations would otherwise show
    sides so small that no computed motion needs to share them.
    """
    return max(_estimate_noise(rotation), 0.01 * float(np.max(np.abs(rotation))))


def _estimate_noise(rotation: np.ndarray) -> float:
    """Estimate the noise by second differences, in which smooth motion nearly vanishes.

    It is at least a millionth of the largest rotation, as rounding.
    """
    # The variance of 1, -2, 1 times noise is 6, and the median of the sizes of normal numbers
    # is 0.6745. The median passes over the few times at which an impact bends the motion.
    bends = np.abs(np.diff(rotation, 2))
    by_bends = float(np.median(bends)) / (0.6745 * 6**0.5) if bends.size else 0.0
    return max(by_bends, 1e-6 * float(np.max(np.abs(rotation))))


def fit_in_parts(test: ShakingTest, restitution: float | None, noise: float | None) -> Stage:
    """Fit as much of the motion as the model reproduces from one part to the next."""
    # state         | what is known                     | what happens next
    # first part    | a C, or those that fit it best    | fit from each, keep the better one
    # next part     | numbers of the part before        | fit from these
    # it follows    | numbers of a longer part          | go on to the next part, if any
    # it does not   | the motion goes another way, or   | stop: the numbers of the part before
    #               | derivatives mean nothing          | are the answer
    # end           | numbers of the whole motion       | they are the answer
    first, *ends = _divide_motion(test.time, detect_sides(test, test.measured))
    start, *other_starts = _choose_starts(test, restitution, first)
    last = _fit_part(test, start, first, noise)
    for numbers in other_starts:
        stage = _fit_part(test, numbers, first, noise)
        if stage.is_better_than(last):
            last = stage
    for end in ends:
        stage = _fit_part(test, last.numbers, end, noise)
        if not stage.continues(last):
            break
        last = stage
    return last
