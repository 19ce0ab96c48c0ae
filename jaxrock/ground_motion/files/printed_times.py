"""Times beside samples: their even step, also where they are printed with few digits."""

import math
import re
from collections.abc import Iterable, Sequence

import numpy as np

from .claims import UNIFORM

_PRINTED = r"[-+]?(?P<whole>\d*)(?:\.(?P<decimals>\d*))?(?P<exponent>[ed][-+]?\d+)?"
# As many are enough to see how times are printed.
_MANY = 1000
# Steps of a golden section: each shortens the interval by more than a third.
_ITERATIONS = 60


def find_uniform_step(times: np.ndarray) -> float | None:
    """Find the step of times whose steps are equal within 0.1 %; None of others."""
    steps = np.diff(times)
    usual = float(np.median(steps))
    if not ((steps > 0).all() and (abs(steps - usual) <= UNIFORM * usual).all()):
        return None
    # The mean, whose error by printed digits falls with the number of steps.
    return float(times[-1] - times[0]) / steps.size


def find_printed_step(
    words: Sequence[str], times: np.ndarray, stated: Iterable[float]
) -> float | None:
    """Find a step, `stated` or the mean, with which times would be printed as these words."""
    halves = _find_halves(words[:: 1 + len(words) // _MANY], times)
    explaining = (step for step in stated if _find_excess(times, halves, step) <= 0)
    return next(explaining, None) or _search_step(times, halves)


def _find_halves(words: Sequence[str], times: np.ndarray) -> np.ndarray:
    """Find half the unit of the last printed digit of each time; NaN if a word is no number."""
    # Zeros at the end may be left out, so that the word with most digits says how many all have:
    # after the point, or of significant ones, which leaves large numbers the larger unit.
    decimals = 0.0
    digits = 1
    for word in words:
        match = re.fullmatch(_PRINTED, word.strip().replace(",", "."), re.I)
        if match is None:
            return np.full(times.size, np.nan)
        after = match["decimals"] or ""
        # With an exponent only the number of significant digits counts.
        decimals = math.inf if match["exponent"] else max(decimals, len(after))
        digits = max(digits, len((match["whole"] + after).lstrip("0")))
    with np.errstate(divide="ignore"):
        powers = np.floor(np.log10(np.abs(times)) + 1e-12)
    return 0.5 * 10.0 ** np.maximum(-decimals, powers + 1 - digits)


def _search_step(times: np.ndarray, halves: np.ndarray) -> float | None:
    """Return the mean step if one explains the times and all that do are nearly the same."""
    intervals = times.size - 1
    mean = float(times[-1] - times[0]) / intervals
    spread = 2 * float(np.max(halves)) / intervals
    if not 2 * spread <= UNIFORM * mean:
        return None
    # The excess is convex: a golden section finds the step at which it is least.
    low = mean - spread
    high = mean + spread
    ratio = (5**0.5 - 1) / 2
    for _ in range(_ITERATIONS):
        lower = high - ratio * (high - low)
        upper = low + ratio * (high - low)
        excesses = [_find_excess(times, halves, step) for step in (lower, upper)]
        if min(excesses) <= 0:
            return mean
        if excesses[0] < excesses[1]:
            high = upper
        else:
            low = lower
    return None


def _find_excess(times: np.ndarray, halves: np.ndarray, step: float) -> float:
    """Find by how much times are outside of what half a unit of the last digit explains."""
    # With a step of two units of the last digit a time that is missing could not be noticed.
    if not step > 4 * float(np.max(halves)):
        return math.inf
    shifts = times - step * np.arange(times.size)
    # Numbers that are printed just at half a unit are not exact in binary.
    slack = 1e-9 * np.max(halves) + 4 * np.finfo(float).eps * np.max(np.abs(times))
    return float(np.max(shifts - halves) - np.min(shifts + halves) - slack)
