"""Statistics of fitted numbers: covariance, tests of a constant C and of p, C of each impact.

Errors follow from the Jacobian by the delta method: the covariance of the numbers as searched
for, times the slopes of the numbers as stated. Tests compare the fit with one that has one
number more, by F (Student's distribution squared), or by chi-square where the noise is known.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .free_rocking_motion import (
    ANGLE,
    CHANGE,
    FREQUENCY,
    LAUNCH,
    RESTITUTION,
    TIME,
    Known,
    Measured,
    Noises,
    compute_half_cycles,
    compute_velocity_ratios,
)
from .free_rocking_search import Fitted
from .least_squares import Values, compute_covariance, orthonormalize

_NEWTON = 8  # steps at most to the velocity that a duration or a peak belongs to
# Of the residuals of one kind. Peaks as few as the numbers that only they know have none: they
# are fitted exactly, and their noise would be 0 / 0.
_LEAST_FREEDOM = 0.1
# By which a noise falls at once: an exact fit would make it 0, and the weights infinite.
_LEAST_FACTOR = 1e-3


class Summary(NamedTuple):
    """Fields of `FreeRockingFit`, and the variance of a residual over its noise."""

    values: Float[np.ndarray, "5"]
    covariance: Float[np.ndarray, "5 5"]
    variance: float
    freedom: int
    restitution_change: float
    restitution_change_error: float
    restitution_change_p_value: float
    frequency_p_value: float
    velocity_ratios: Float[np.ndarray, " each"]
    restitutions: Float[np.ndarray, " each"]
    restitution_errors: Float[np.ndarray, " each"]


def reestimate(measured: Measured, known: Known, fit: Fitted, noises: Noises) -> Noises:
    """Estimate noises by the residuals of times and rotations.

    Each kind has its share of the degrees of freedom: its number less its leverages.
    """
    leverage = np.sum(orthonormalize(fit.jacobian[:, known.free]) ** 2, axis=1)
    parts = np.split(fit.residuals**2, [measured.times.size])
    shares = np.split(1 - leverage, [measured.times.size])
    counts = measured.time_counts, measured.peak_counts
    sizes = [noises.times, noises.rotations]
    for k, there in enumerate(noises.known):
        if there:
            continue
        freedom = max(float(np.sum(shares[k][counts[k]])), _LEAST_FREEDOM)
        sizes[k] *= max((float(np.sum(parts[k])) / freedom) ** 0.5, _LEAST_FACTOR)
    return noises._replace(times=sizes[0], rotations=sizes[1])


def summarize(
    measured: Measured,
    known: Known,
    constant: Fitted,
    changing: Fitted,
    tuned: Fitted | None,
    noises: Noises,
    noise_known: bool,
) -> Summary:
    """Summarize fits with a constant C, with one that changes, and with a free p if known."""
    numbers = constant.numbers
    free = known.free
    freedom = measured.counted - int(free.sum())
    variance = 1.0 if noise_known else _compute_mean_square(constant, freedom)
    growth = np.exp(numbers[LAUNCH])
    exponentials = np.exp(numbers[RESTITUTION : ANGLE + 1])
    values = np.array([numbers[TIME], np.tanh(growth), *exponentials])
    # From log(artanh(x)) and the logarithms to the numbers themselves.
    slopes = np.array([1.0, growth * (1 - values[LAUNCH] ** 2), *exponentials])
    covariance = (
        _compute_covariance(constant, free)[:5, :5] * variance * np.outer(slopes, slopes)
    )

    change = error = of_change = of_frequency = np.nan
    # A further number needs a further measurement, and a change impacts that differ.
    if freedom > 1 and changing.relative_velocities.any():
        change = float(changing.numbers[CHANGE])
        square = 1.0 if noise_known else _compute_mean_square(changing, freedom - 1)
        of_all = _compute_covariance(changing, known.set_free(CHANGE).free)
        error = float(np.sqrt(of_all[CHANGE, CHANGE] * square))
        of_change = _compute_p_value(constant, changing, freedom - 1, noise_known)
    if freedom > 1 and tuned is not None and free[TIME]:
        of_frequency = _compute_p_value(constant, tuned, freedom - 1, noise_known)
    ratios, restitutions, errors = _estimate_by_impact(measured, known, numbers, noises)
    return Summary(
        values,
        covariance,
        variance,
        freedom,
        change,
        error,
        of_change,
        of_frequency,
        ratios,
        restitutions,
        errors * variance**0.5,
    )


def _compute_mean_square(fit: Fitted, freedom: int) -> float:
    """Compute the variance of a residual over its noise; NaN without a degree of freedom."""
    return fit.squares / freedom if freedom > 0 else np.nan


def _compute_covariance(fit: Fitted, free: np.ndarray) -> Values:
    """Compute the covariance by residuals of standard deviation 1; 0 for held numbers."""
    covariance = np.zeros((free.size, free.size))
    covariance[np.ix_(free, free)] = compute_covariance(fit.jacobian[:, free])
    return covariance


def _compute_p_value(
    constant: Fitted, freer: Fitted, freedom: int, noise_known: bool
) -> float:
    """Compute the chance that one more number lowers the sum of squares as much.

    By Student's distribution, or by the normal one where the noise is known.
    """
    from scipy.special import betainc, erfc  # which load slowly

    # Not below 0: the freer search may end a rounding above the other one. The smallest float
    # keeps 0 / 0, of two exact fits, from being NaN.
    gain = max(constant.squares - freer.squares, 0.0)
    if noise_known:
        return float(erfc((gain / 2) ** 0.5))
    share = freer.squares / (freer.squares + gain + np.finfo(float).tiny)
    return float(betainc(freedom / 2, 0.5, share))


def _estimate_by_impact(
    measured: Measured, known: Known, numbers: Values, noises: Noises
) -> tuple[Values, Values, Values]:
    """Estimate the velocity before each impact, C of that impact alone, and its error.

    C is the ratio of the launch velocities of the half-cycles after and before an impact.
    The launch that belongs to a duration, or a peak, is found by Newton's method.
    """
    timed = measured.times.size > 1
    room = 1 + int(max(measured.impacts.max(), measured.arcs.max(initial=0)))
    ratios, _ = compute_velocity_ratios(numbers, np.zeros(room))
    if timed:
        counts = measured.time_counts
        impacts = measured.impacts
        exists = counts[1:] & counts[:-1] & (np.diff(impacts) == 1)
        unit = np.exp(-numbers[FREQUENCY])
        noise = noises.times
        value = np.diff(measured.times) / unit
        guess = ratios[impacts[:-1]]
    else:
        exists = measured.peak_counts
        unit = np.exp(numbers[ANGLE])
        noise = noises.rotations
        value = measured.peaks / unit
        guess = ratios[measured.arcs]

    def evaluate(launch: Values) -> tuple[Values, Values]:
        """Compute duration or peak of each, and its slope along log(artanh(x))."""
        growth = np.exp(launch)
        ratio = np.minimum(np.tanh(growth), 1 - 1e-9)
        motion = compute_half_cycles(known, ratio)
        along = growth * (1 - ratio**2)
        if timed:
            return motion.durations, motion.duration_slopes * along
        return motion.rotations, motion.rotation_slopes * along

    # Logarithms on both sides, in which durations are nearly linear: few steps from the fitted
    # motion suffice. Half-cycles that are not measured begin at their solution, and stay
    # there.
    launch = np.log(np.arctanh(guess))
    value = np.where(exists, value, evaluate(launch)[0])
    for _ in range(_NEWTON):
        here, slope = evaluate(launch)
        step = np.clip(here / slope * np.log(value / here), -1, 1)
        launch = launch + step
        if np.abs(step).max() <= np.finfo(known.dtype).eps ** 0.5:  # whose square is left
            break
    _, slope = evaluate(launch)
    growth = np.exp(launch)
    x = np.tanh(growth)
    error = growth * (1 - x**2) / (x * slope) * noise / unit  # of log(x)
    both = exists[1:] & exists[:-1]
    restitution = np.where(both, x[1:] / x[:-1], np.nan)
    first = error[:-1]
    second = error[1:]
    # Two durations share the time between them, with opposite signs, and each has another one
    # besides: variances of 2, and a covariance of -1 which the ratio turns to +1.
    square = first**2 + second**2
    square = 2 * (square + first * second) if timed else square
    return np.where(both, x[:-1], np.nan), restitution, restitution * np.sqrt(square)
