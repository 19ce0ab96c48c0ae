"""The numbers of a free rocking block that fit measurements best."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy.typing import DTypeLike

from .free_rocking_motion import (
    ANGLE,
    FREQUENCY,
    LAUNCH,
    RESTITUTION,
    TIME,
    Known,
    Measured,
    Noises,
    Rows,
    compute_residuals,
    velocity_ratios,
)
from .least_squares import Flags, Places, Values, directions_of, minimize

_FREQUENCIES = 33  # that are tried where p is not known
# half of the longest half-cycle times p that is tried
_SHORTEST = 0.02
_LONGEST = 6.0
_ARRIVED = 0.01  # standard errors from the least squares


class Fitted(NamedTuple):
    """The best numbers, and there the residuals over their noises and their Jacobian.

    And the amplitudes of impacts, over their range and about their mean, on which C may
    depend.
    """

    numbers: Float[np.ndarray, "6"]
    residuals: Float[np.ndarray, " measurements"]
    jacobian: Float[np.ndarray, "measurements 6"]
    amplitudes: Float[np.ndarray, " impacts"]

    @property
    def squares(self) -> float:
        """The sum of the squares of the residuals."""
        return float(np.sum(self.residuals**2))


def fit_together(
    tests: Sequence[Measured], kinds: Sequence[Known], noises: Noises, most_steps: int = 100
) -> list[Fitted]:
    """Find the best numbers for several numberings of the same measurements, side by side."""
    known = kinds[0]
    rows = Rows.of(tests, kinds)

    def evaluate(numbers: Values, places: Places) -> tuple[Values, Values]:
        return compute_residuals(numbers, amplitudes[places], rows.at(places), known, noises)

    # What is tried in vain may be too large to compute.
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        start = _start(rows, known, noises)
        amplitudes = _amplitudes(start, rows)
        rounding = float(np.finfo(known.dtype).eps) * _extent(rows, noises)
        least = minimize(evaluate, start, rounding**2, most_steps)
    return [Fitted(*parts) for parts in zip(*least, amplitudes, strict=True)]


def _extent(measured: Measured | Rows, noises: Noises) -> float:
    """Compute the norm of all measurements over their noises."""
    largest = np.abs(measured.times).max() / noises.times
    largest = max(largest, measured.peaks.max(initial=0) / noises.rotations)
    return float(largest) * (measured.times.size + measured.peaks.size) ** 0.5


def rounding_of(dtype: DTypeLike) -> float:
    """Part of a measurement below which no misfit is looked at."""
    return max(8 * float(np.finfo(dtype).eps), 1e-10)


def is_least(fit: Fitted, measured: Measured, known: Known, noises: Noises) -> bool:
    """Tell whether a further Gauss-Newton step is far below the standard errors, or rounding."""
    if not (np.isfinite(fit.residuals).all() and np.isfinite(fit.jacobian).all()):
        return False
    freedom = max(measured.counted - known.free.sum(), 1)
    # Measurements may be better than a noise that is known.
    sigma = max((fit.squares / freedom) ** 0.5, 1.0 if any(noises.known) else 0.0)
    least = _ARRIVED * sigma + rounding_of(known.dtype) * _extent(measured, noises)
    return bool(
        np.linalg.norm(fit.residuals @ directions_of(fit.jacobian[:, known.free])) <= least
    )


def _amplitudes(numbers: Values, rows: Rows) -> Values:
    """Velocities before all impacts that matter, over their range and about their mean."""
    ratios, _ = velocity_ratios(numbers, np.zeros((len(numbers), rows.room)))
    last = np.maximum(
        np.max(np.where(rows.time_counts, rows.impacts, 0), axis=1),
        np.max(np.where(rows.peak_counts, rows.arcs + 1, 0), axis=1, initial=0),
    )[:, None]
    number = np.arange(rows.room)
    matters = (number > 0) & (number < last)
    before = np.concatenate([ratios[:, :1], ratios[:, :-1]], axis=1)
    count = np.maximum(matters.sum(axis=1, keepdims=True), 1)
    mean = np.sum(np.where(matters, before, 0), axis=1, keepdims=True) / count
    extent = ratios[:, :1] - np.take_along_axis(ratios, np.maximum(last - 2, 0), 1)
    wide = extent > 0
    return np.where(matters & wide, (before - mean) / np.where(wide, extent, 1), 0)


def _start(rows: Rows, known: Known, noises: Noises) -> Values:
    """Numbers to begin with: the best of several where p is not known."""
    sets = len(rows.free)
    unknown = rows.free[:, FREQUENCY]
    place = np.arange(rows.times.size)
    last = np.maximum.accumulate(np.where(rows.time_counts, place, -1), axis=1)
    before = np.concatenate([np.full((sets, 1), -1), last[:, :-1]], axis=1)
    there = np.maximum(before, 0)
    launches = np.take_along_axis(rows.impacts, there, 1)
    whole = rows.time_counts & (before >= 0) & (rows.impacts - launches == 1)
    durations = np.where(whole, rows.times - rows.times[there], 0)
    longest = durations.max(axis=1, keepdims=True)
    tried = np.geomspace(_SHORTEST, _LONGEST, _FREQUENCIES if unknown.any() else 1)
    tried = np.log(2 * tried / np.where(longest > 0, longest, 1))
    tried = np.where(unknown[:, None], tried, known.numbers[FREQUENCY])
    first = rows.times[np.argmax(rows.time_counts, axis=1)]
    guesses = _lines(tried, durations, launches, whole, first, rows, known)

    several = rows.at(np.repeat(np.arange(sets), tried.shape[1]))
    flat = guesses.reshape(-1, guesses.shape[-1])
    constant = np.zeros((len(flat), rows.room))
    off, _ = compute_residuals(flat, constant, several, known, noises, with_jacobian=False)
    misfits = np.nan_to_num(np.sum(off**2, axis=1).reshape(tried.shape), nan=np.inf)
    best = guesses[np.arange(sets), np.argmin(misfits, axis=1)]

    # The critical angle of a body of which nothing is known: by the largest peak.
    ratios, _ = velocity_ratios(best, constant[:sets])
    ratios = np.take_along_axis(ratios, rows.arcs, 1)
    rotations = np.where(rows.peak_counts, 1 - np.sqrt((1 - ratios) * (1 + ratios)), 0)
    square = np.sum(rotations**2, axis=1)
    angle = np.log(np.sum(rotations * rows.peaks, axis=1) / square)
    best[:, ANGLE] = np.where(rows.free[:, ANGLE] & (square > 0), angle, best[:, ANGLE])
    return best


def _lines(
    log_p: Values,
    durations: Values,
    launches: Places,
    whole: Flags,
    first: Values,
    rows: Rows,
    known: Known,
) -> Values:
    """Numbers for each p that is tried: a line through log(x) of all half-cycles, linearized.

    Of durations tanh(p duration / 2) = x, of peaks 1 - (1 - peak / alpha_c)^2 = x^2, and the
    line falls by log(C) from each to the next.
    """
    arcs = np.clip(np.exp(log_p)[..., None] * durations[:, None], 1e-9, 2 * _LONGEST)
    timed = np.where(whole[:, None], np.sinh(np.minimum(arcs, 3.0)) ** 2, 0)
    square = 1 - (1 - np.clip(rows.peaks / np.exp(known.numbers[ANGLE]), 1e-6, 0.999)) ** 2
    # Peaks count where there are no times.
    high = np.where(whole.any(axis=1, keepdims=True) | ~rows.peak_counts, 0, square**2)
    peaked = (*log_p.shape, square.size)
    weight = np.concatenate([timed, np.broadcast_to(high[:, None], peaked)], axis=2)
    log_x = [np.log(np.tanh(arcs / 2)), np.broadcast_to(0.5 * np.log(square), peaked)]
    log_x = np.concatenate(log_x, axis=2)
    number = np.concatenate([launches, rows.arcs], axis=1)[:, None].astype(float)
    total = np.sum(weight, axis=2, keepdims=True)
    middle = np.sum(weight * number, axis=2, keepdims=True) / total
    height = np.sum(weight * log_x, axis=2, keepdims=True) / total
    spread = np.sum(weight * (number - middle) ** 2, axis=2, keepdims=True)
    slope = (
        np.sum(weight * (number - middle) * (log_x - height), axis=2, keepdims=True) / spread
    )
    slope = np.clip(np.where(spread > 0, slope, -0.1), -3.0, -1e-3)
    x = np.exp(np.clip(height - slope * middle, -12.0, -1e-4))
    guesses = np.empty((*log_p.shape, known.numbers.size))
    guesses[...] = known.numbers
    guesses[..., TIME] = first[:, None]
    guesses[..., LAUNCH] = np.log(np.arctanh(x[..., 0]))
    guesses[..., RESTITUTION] = slope[..., 0]
    guesses = np.where(rows.free[:, None], guesses, known.numbers)
    guesses[..., FREQUENCY] = log_p
    return guesses
