"""The impact that each recorded time belongs to: some are missed, counted twice, or mistimed.

One repair follows another, each the best of all that are possible: a time is left out because
it counts an impact again; an impact is passed over because nobody recorded it; a time is left
out because it is wrong. Repairs are kept as long as together they explain more than chance
would, by an F test (a chi-square test where the noise is known) that allows for the choice
among all of them, after Bonferroni: the probability is multiplied by the number of choices.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

MAX_REPAIRS = 4
# Probability of a repair where nothing is wrong. A repair changes what was measured: it has to
# be much less likely by chance than the 5 % at which a mere remark is made.
_LEVEL = 1e-3


class Numbering(NamedTuple):
    """The number of the impact at each time, the times that count, and the repairs made."""

    impacts: np.ndarray
    used: np.ndarray
    repairs: tuple[str, ...] = ()
    squares: float = np.nan  # sum of squares, where it was computed
    unrepaired_squares: float = np.nan

    def leave_out(self, place: int, again: bool) -> "Numbering":
        """Leave out a time, which counts the impact before it again or is wrong.

        If it counts an impact again, all later impacts have a number less.
        """
        used = self.used.copy()
        impacts = self.impacts.copy()
        used[place] = False
        if again:
            impacts[place:] -= 1
        return self._replace(impacts=impacts, used=used)

    def skip_impact(self, place: int) -> "Numbering":
        """Pass over an impact before a time."""
        impacts = self.impacts.copy()
        impacts[place:] += 1
        return self._replace(impacts=impacts)


def repair_numbering(
    times: np.ndarray,
    unknowns: int,
    fit_squares: Callable[[Sequence[Numbering]], np.ndarray],
    noise_known: bool,
    rounding: float,
) -> Numbering:
    """Find the numbering of impacts that explains the times.

    `fit_squares` gives sums of squares, in units of the noise where that is known; `rounding`
    is how far off a time may be, in these units, because of the arithmetic.

    The search has two stages.

    1. Forwards: to the numbering so far add the one repair that lowers the sum of squares
       most, up to `MAX_REPAIRS` of them, whether or not it is significant.
    2. Backwards: keep the longest sequence that explains more than each shorter one, and more
       than no repair at all, at a level of `_LEVEL`.

    It goes to the end before it judges, because two impacts that are missing one after the
    other may explain the times only together.
    """
    path = [Numbering(np.arange(times.size), np.ones(times.size, bool))]
    # Exact times leave nothing but rounding, of which any repair would explain a large part.
    floor = times.size * rounding**2
    squares = [float(fit_squares(path)[0]) + floor]
    # A repair may cost a degree of freedom, and two have to remain by which noise is told.
    while len(path) <= MAX_REPAIRS and path[-1].used.sum() - unknowns >= 3:
        trials = _list_trials(path[-1], times)
        values = np.nan_to_num(fit_squares(trials), nan=np.inf) + floor
        best = int(np.argmin(values))
        if not values[best] < squares[-1]:
            break
        path.append(trials[best])
        squares.append(float(values[best]))

    # Each repair has to earn its place beside all that were made before it: the largest of the
    # probabilities counts.
    freedom = [int(numbering.used.sum()) - unknowns for numbering in path]
    choices = count_choices(times)
    for last in range(len(path) - 1, 0, -1):
        chances = (
            compute_log_chance(
                squares[k],
                squares[last],
                freedom[last],
                last - k,
                choices ** (last - k),
                noise_known,
            )
            for k in range(last)
        )
        if max(chances) < math.log(_LEVEL):
            break
    else:
        last = 0
    return path[last]._replace(squares=squares[last], unrepaired_squares=squares[0])


def count_choices(times: np.ndarray) -> int:
    """Count the repairs among which one is chosen, at most: three kinds at each time."""
    return 3 * times.size


def compute_log_chance(
    before: float, after: float, freedom: int, numbers: int, choices: int, noise_known: bool
) -> float:
    """Return the logarithm of the probability that chance lowers a sum of squares so much.

    `numbers` repairs or free numbers lower it from `before` to `after`. They were chosen among
    `choices` sets of as many, and the probability is multiplied by that.

    A time that is left out fits as well as one with a number of its own that shifts it: the
    two explanations are nested, and their ratio has an F distribution. A missing impact counts
    as one number as well.
    """
    from scipy.special import chdtrc, fdtrc  # which load slowly

    if numbers == 0 or before <= after:
        return 0.0
    if noise_known:
        chance = chdtrc(numbers, before - after)
    else:
        chance = fdtrc(numbers, freedom, (before - after) / numbers / (after / freedom))
    # Chances are compared, also those too small for a float: the logarithm of 0 is below all.
    return (math.log(chance) if chance > 0 else -math.inf) + math.log(choices)


def _list_trials(numbering: Numbering, times: np.ndarray) -> list[Numbering]:
    """List all numberings with one more repair."""
    places = np.flatnonzero(numbering.used).tolist()
    trials = list[Numbering]()

    def add(trial: Numbering, sentence: str) -> None:
        trials.append(trial._replace(repairs=(*numbering.repairs, sentence)))

    for previous, place in zip([None, *places[:-1]], places, strict=True):
        at = f"{times[place]:.4f} s"
        # Before the first time there is no impact that it could count again, and an
        # impact that is missing there changes nothing.
        if previous is not None:
            again = numbering.leave_out(place, again=True)
            add(again, f"the time {at} counts an impact again: left out")
            between = f"between {times[previous]:.4f} s and {at}"
            add(numbering.skip_impact(place), f"an impact {between} is missing")
        without_outlier = numbering.leave_out(place, again=False)
        add(without_outlier, f"the time {at} is out of line: left out")
    return trials
