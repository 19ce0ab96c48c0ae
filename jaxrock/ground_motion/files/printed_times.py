"""Times that are printed with few digits: the step that explains them all, if there is one."""

import math
import re
from collections.abc import Sequence

import numpy as np

from .claims import UNIFORM

_PRINTED = r"[-+]?(?P<whole>\d*)(?:\.(?P<decimals>\d*))?(?P<exponent>[ed][-+]?\d+)?"
# Steps of a golden section: each shortens the interval by more than a third.
_ITERATIONS = 60


def find_printed_halves(words: Sequence[str], times: np.ndarray) -> np.ndarray:
    """Find half the unit of the last printed digit of each time; NaN if a word is no number.

    Zeros at the end may be left out, so that the word with most digits says how many all have:
    after the point, or of significant ones, which leaves large numbers the larger unit.
    """
    decimals = 0.0
    digits = 1
    for word in words:
        match = re.fullmatch(_PRINTED, word.strip(), re.I)
        if match is None:
            return np.full(times.size, np.nan)
        after = match["decimals"] or ""
        # With an exponent only the number of significant digits counts.
        decimals = math.inf if match["exponent"] else max(decimals, len(after))
        digits = max(digits, len((match["whole"] + after).lstrip("0")))
    with np.errstate(divide="ignore"):
        powers = np.floor(np.log10(np.abs(times)) + 1e-12)
    return 0.5 * 10.0 ** np.maximum(-decimals, powers + 1 - digits)


def explain_times(times: np.ndarray, halves: np.ndarray, step: float) -> bool:
    """Tell whether times with this step, from any first one on, would be printed like that.

    The step has to be larger than two units of the last digit, or a time that is missing
    could not be noticed.
    """
    return step > 4 * float(np.max(halves)) and _find_excess(times, halves, step) <= 0


def find_printed_step(times: np.ndarray, halves: np.ndarray) -> float | None:
    """Find the mean step if one explains the times and all that do are nearly the same."""
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
        one = high - ratio * (high - low)
        other = low + ratio * (high - low)
        if _find_excess(times, halves, one) < _find_excess(times, halves, other):
            high = other
        else:
            low = one
        if explain_times(times, halves, one) or explain_times(times, halves, other):
            return mean
    return None


def _find_excess(times: np.ndarray, halves: np.ndarray, step: float) -> float:
    """Find by how much times are outside of what half a unit of the last digit explains."""
    rest = times - step * np.arange(times.size)
    # Numbers that are printed just at half a unit are not exact in binary.
    slack = 1e-9 * np.max(halves) + 4 * np.finfo(float).eps * np.max(np.abs(times))
    return float(np.max(rest - halves) - np.min(rest + halves) - slack)
