"""Which impact each recorded time belongs to: impacts missed, counted twice, or mistimed.

One repair after another, each the best of all that are possible: a time is left out because it
counts an impact again; one is passed over because nobody recorded it; a time is left out
because it is wrong. Repairs are kept as long as together they explain more than chance would,
by an F test that allows for the choice among all of them.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

MAX_REPAIRS = 4
_LEVEL = 1e-3  # probability of a repair where nothing is wrong


class Numbering(NamedTuple):
    """The number of the impact at each time, whether the time counts, and what was repaired."""

    impacts: np.ndarray
    used: np.ndarray
    repairs: tuple[str, ...] = ()
    squares: float = np.nan  # sum of squares, where it was computed
    unrepaired_squares: float = np.nan

    def without(self, place: int, again: bool) -> "Numbering":
        """Leave out a time, which counts the impact before it again or is wrong."""
        used = self.used.copy()
        impacts = self.impacts.copy()
        used[place] = False
        if again:
            impacts[place:] -= 1
        return self._replace(impacts=impacts, used=used)

    def passing(self, place: int) -> "Numbering":
        """Pass over an impact before a time."""
        impacts = self.impacts.copy()
        impacts[place:] += 1
        return self._replace(impacts=impacts)


def repair(
    times: np.ndarray,
    unknowns: int,
    squares_of: Callable[[Sequence[Numbering]], np.ndarray],
    noise_known: bool,
    rounding: float,
) -> Numbering:
    """Find the numbering of impacts that explains the times.

    `squares_of` gives sums of squares, in units of the noise where that is known; `rounding`
    is how far off a time may be, in these units, because of the arithmetic.
    """
    path = [Numbering(np.arange(times.size), np.ones(times.size, bool))]
    floor = times.size * rounding**2
    squares = [float(squares_of(path)[0]) + floor]
    while len(path) <= MAX_REPAIRS and path[-1].used.sum() - unknowns >= 3:
        trials = _trials(path[-1], times)
        values = np.nan_to_num(squares_of(trials), nan=np.inf) + floor
        best = int(np.argmin(values))
        if not values[best] < squares[-1]:
            break
        path.append(trials[best])
        squares.append(float(values[best]))
    freedom = [int(numbering.used.sum()) - unknowns for numbering in path]
    choices = choices_of(times)
    for last in range(len(path) - 1, 0, -1):
        chances = (
            log_chance(
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


def choices_of(times: np.ndarray) -> int:
    """Among how many a repair is chosen, at most."""
    return 3 * times.size


def log_chance(
    before: float, after: float, freedom: int, numbers: int, choices: int, noise_known: bool
) -> float:
    """Return the logarithm of the probability that chance lowers a sum of squares so much.

    `numbers` repairs or free numbers lower it from `before` to `after`. They were chosen among
    `choices` sets of as many, and the probability is multiplied by that.
    """
    from scipy.special import chdtrc, fdtrc  # which load slowly

    if numbers == 0 or before <= after:
        return 0.0
    if noise_known:
        chance = chdtrc(numbers, before - after)
    else:
        chance = fdtrc(numbers, freedom, (before - after) / numbers / (after / freedom))
    return (math.log(chance) if chance > 0 else -math.inf) + math.log(choices)


def _trials(numbering: Numbering, times: np.ndarray) -> list[Numbering]:
    """All numberings with one more repair."""
    places = np.flatnonzero(numbering.used).tolist()
    trials = list[Numbering]()

    def add(trial: Numbering, said: str) -> None:
        trials.append(trial._replace(repairs=(*numbering.repairs, said)))

    for previous, place in zip([None, *places[:-1]], places, strict=True):
        at = f"{times[place]:.4f} s"
        if previous is not None:
            again = numbering.without(place, again=True)
            add(again, f"the time {at} counts an impact again: left out")
            between = f"between {times[previous]:.4f} s and {at}"
            add(numbering.passing(place), f"an impact {between} is missing")
        wrong = numbering.without(place, again=False)
        add(wrong, f"the time {at} is out of line: left out")
    return trials
