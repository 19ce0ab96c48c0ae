"""Search for the numbers of a free rocking block that fit measurements best."""

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
    compute_velocity_ratios,
)
from .least_squares import Flags, Places, Values, minimize, orthonormalize

# Values of p that are tried where it is not known. They are given by half of the longest
# half-cycle times p, the tanh of which is the launch ratio of linearized rocking: from a
# launch at 0.02 of the critical velocity to one that all but overturns, in steps of 20 %.
_FREQUENCIES = 33
_SHORTEST = 0.02
_LONGEST = 6.0
_ARRIVED = 0.01  # standard errors from the least squares: far less than measurements can tell


class Fitted(NamedTuple):
    """The best numbers, and there the residuals over their noises and their Jacobian.

    C may be linear in the amplitudes of impacts: velocities before them, less their mean and
    over their range, so that the slope is C of the largest impact less C of the smallest, and
    nearly independent of C itself.
    """

    numbers: Float[np.ndarray, "6"]
    residuals: Float[np.ndarray, " measurements"]
    jacobian: Float[np.ndarray, "measurements 6"]
    relative_velocities: Float[np.ndarray, " impacts"]

    @property
    def squares(self) -> float:
        """The sum of the squares of the residuals."""
        return float(np.sum(self.residuals**2))


def fit_together(
    tests: Sequence[Measured], kinds: Sequence[Known], noises: Noises, most_steps: int = 100
) -> list[Fitted]:
    """Find the best numbers for several numberings of the same measurements, side by side."""
    # stage               | what is known             | what happens next
    # 1 `_fit_lines`      | measurements, block       | for each p to try a line through log(x)
    # 2 `_choose_start`   | some numbers for each p   | the least misfit, in the model itself
    # 3 amplitudes        | numbers that are near     | held from here on
    # 4 `minimize`        | numbers and amplitudes    | Levenberg-Marquardt, all rows at once
    known = kinds[0]
    rows = Rows.of(tests, kinds)

    def evaluate(numbers: Values, places: Places) -> tuple[Values, Values]:
        return compute_residuals(numbers, amplitudes[places], rows.at(places), known, noises)

    # Numbers that are tried in vain may be too large to compute.
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        start = _choose_start(rows, known, noises)
        # Held while the search goes on, so that derivatives need not follow them. They matter
        # only where C changes, and then as a scale that the start knows well enough.
        amplitudes = _compute_amplitudes(start, rows)
        # Sums of squares that differ by less than rounding of the measurements are the same.
        rounding = float(np.finfo(known.dtype).eps) * _compute_norm(rows, noises)
        least = minimize(evaluate, start, rounding**2, most_steps)
    return [Fitted(*parts) for parts in zip(*least, amplitudes, strict=True)]


def _compute_norm(measured: Measured | Rows, noises: Noises) -> float:
    """Compute the norm of all measurements over their noises."""
    largest = np.abs(measured.times).max() / noises.times
    largest = max(largest, measured.peaks.max(initial=0) / noises.rotations)
    return float(largest) * (measured.times.size + measured.peaks.size) ** 0.5


def estimate_rounding(dtype: DTypeLike) -> float:
    """Estimate the part of a measurement below which no misfit is looked at."""
    return max(8 * float(np.finfo(dtype).eps), 1e-10)


def is_minimum(fit: Fitted, measured: Measured, known: Known, noises: Noises) -> bool:
    """Return whether a further Gauss-Newton step is far below the standard errors, or rounding.

    The projection of the residuals onto the columns of the Jacobian, over the standard
    deviation of a residual, is the length of that step in standard errors. A search may also
    stop because its steps have become short: that alone does not make a minimum.
    """
    if not (np.isfinite(fit.residuals).all() and np.isfinite(fit.jacobian).all()):
        return False
    freedom = max(measured.counted - known.free.sum(), 1)
    # Measurements may be better than a noise that is known, and need not fit better than it.
    sigma = max((fit.squares / freedom) ** 0.5, 1.0 if any(noises.known) else 0.0)
    least = _ARRIVED * sigma + estimate_rounding(known.dtype) * _compute_norm(measured, noises)
    return bool(
        np.linalg.norm(fit.residuals @ orthonormalize(fit.jacobian[:, known.free])) <= least
    )


def _compute_amplitudes(numbers: Values, rows: Rows) -> Values:
    """Compute velocities before all impacts that matter, less their mean, over their range.

    These are the impacts between two measured half-cycles: no launch comes before the first,
    and after the last one nothing is measured.
    """
    ratios, _ = compute_velocity_ratios(numbers, np.zeros((len(numbers), rows.room)))
    last = np.maximum(
        np.max(np.where(rows.time_counts, rows.impacts, 0), axis=1),
        np.max(np.where(rows.peak_counts, rows.arcs + 1, 0), axis=1, initial=0),
    )[:, None]
    number = np.arange(rows.room)
    matters = (number > 0) & (number < last)
    before = np.concatenate([ratios[:, :1], ratios[:, :-1]], axis=1)
    count = np.maximum(matters.sum(axis=1, keepdims=True), 1)
    mean = np.sum(np.where(matters, before, 0), axis=1, keepdims=True) / count
    # The velocity before the last impact that matters is that after the one before it.
    extent = ratios[:, :1] - np.take_along_axis(ratios, np.maximum(last - 2, 0), 1)
    wide = extent > 0
    return np.where(matters & wide, (before - mean) / np.where(wide, extent, 1), 0)


def _choose_start(rows: Rows, known: Known, noises: Noises) -> Values:
    """Choose numbers to begin with: the best of several where p is not known.

    Durations tell p by their curvature only. Each p that is tried has a launch ratio and a C
    of its own, by a line through all half-cycles: from another p with numbers of this one the
    search would have a long way to go.
    """
    # Durations: between each time that counts and the one before it that does, if these belong
    # to impacts in succession.
    sets = len(rows.free)
    unknown = rows.free[:, FREQUENCY]
    place = np.arange(rows.times.size)
    last = np.maximum.accumulate(np.where(rows.time_counts, place, -1), axis=1)
    before = np.concatenate([np.full((sets, 1), -1), last[:, :-1]], axis=1)
    there = np.maximum(before, 0)
    launches = np.take_along_axis(rows.impacts, there, 1)
    whole = rows.time_counts & (before >= 0) & (rows.impacts - launches == 1)
    durations = np.where(whole, rows.times - rows.times[there], 0)

    # Sets with a known p try that one, as often as the others try different ones.
    longest = durations.max(axis=1, keepdims=True)
    tried = np.geomspace(_SHORTEST, _LONGEST, _FREQUENCIES if unknown.any() else 1)
    tried = np.log(2 * tried / np.where(longest > 0, longest, 1))
    tried = np.where(unknown[:, None], tried, known.numbers[FREQUENCY])
    first = rows.times[np.argmax(rows.time_counts, axis=1)]
    guesses = _fit_lines(tried, durations, launches, whole, first, rows, known)

    # The model itself chooses among them, with a constant C.
    several = rows.at(np.repeat(np.arange(sets), tried.shape[1]))
    flat = guesses.reshape(-1, guesses.shape[-1])
    constant = np.zeros((len(flat), rows.room))
    residuals, _ = compute_residuals(
        flat, constant, several, known, noises, with_jacobian=False
    )
    misfits = np.nan_to_num(np.sum(residuals**2, axis=1).reshape(tried.shape), nan=np.inf)
    best = guesses[np.arange(sets), np.argmin(misfits, axis=1)]

    # Peaks are proportional to the critical angle: linear least squares, by the linearized
    # peak rotation 1 - sqrt(1 - x^2), since without a block no other model is allowed.
    ratios, _ = compute_velocity_ratios(best, constant[:sets])
    ratios = np.take_along_axis(ratios, rows.arcs, 1)
    rotations = np.where(rows.peak_counts, 1 - np.sqrt((1 - ratios) * (1 + ratios)), 0)
    square = np.sum(rotations**2, axis=1)
    angle = np.log(np.sum(rotations * rows.peaks, axis=1) / square)
    best[:, ANGLE] = np.where(rows.free[:, ANGLE] & (square > 0), angle, best[:, ANGLE])
    return best


def _fit_lines(
    log_p: Values,
    durations: Values,
    launches: Places,
    whole: Flags,
    first: Values,
    rows: Rows,
    known: Known,
) -> Values:
    """Fit for each p that is tried a line to log(x) of all half-cycles, linearized.

    Of durations tanh(p duration / 2) = x, of peaks 1 - (1 - peak / alpha_c)^2 = x^2, and the
    line falls by log(C) from each half-cycle to the next. Weights are reciprocals of the
    variances of log(x), by the delta method from equal variances of all durations, or peaks.
    """
    # The slope of log(tanh(arc / 2)) is 1 / sinh(arc). Beyond 3 the weight grows no more: a
    # half-cycle near overturning would decide alone.
    arcs = np.clip(np.exp(log_p)[..., None] * durations[:, None], 1e-9, 2 * _LONGEST)
    timed = np.where(whole[:, None], np.sinh(np.minimum(arcs, 3.0)) ** 2, 0)
    # The slope of log(x) is (1 - peak) / x^2, of which the numerator is left out: it differs
    # from 1 for large peaks only. A peak beyond the critical angle has no x, and counts as
    # just below.
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
    # One half-cycle has no slope: C is about 0.9 then. It is held between 0.05 and 0.999, and
    # x below 1, so that there is a motion to begin with.
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
