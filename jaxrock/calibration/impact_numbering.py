"""Numbering of the impacts of recorded times, some missed, counted twice or mistimed.

Repairs follow one another, each the best possible one: a time is left out because it counts an
impact again; an impact is skipped because it was not recorded; a time is left out because it
is wrong. Repairs are kept as long as together they explain more than chance would, by an F
test (a chi-square test where the noise is known) that allows for the choice among all of them,
after Bonferroni: the probability is multiplied by the number of choices.
"""

import math
from typing import NamedTuple

import numpy as np

from .free_rocking_motion import (
    ANGLE,
    FREQUENCY,
    Known,
    Measurements,
    Noises,
    fit_parameters,
)

_MAX_REPAIRS = 4
# Probability of a repair without a fault. A repair changes measurements: it has to be much
# less likely by chance than the 5 % of a remark.
_LEVEL = 1e-3


class _Numbering(NamedTuple):
    """A numbering of the impacts, its sum of squares, and the repairs that led to it."""

    measured: Measurements
    squares: float
    freedom: int
    repairs: tuple[str, ...]


def number_impacts(
    measured: Measurements, known: Known, noises: Noises
) -> tuple[Measurements, tuple[str, ...]]:
    """Find the numbers of impacts by their times alone, and describe the repairs.

    The search goes forwards to `_MAX_REPAIRS`, whether or not a repair is significant, since
    two impacts that are missing one after the other may explain the times only together. It
    then goes back to the longest sequence that explains more than each shorter one.

    Leaving times out would explain the times of another block, too: if a free p without
    repairs explains more than the repairs, no repair is made.
    """
    # Without peaks the times do not depend on the critical angle, which must not be free then.
    silent = measured._replace(peaks=np.full_like(measured.peaks, np.nan))
    known = known.set_free(ANGLE, False)
    # Residuals of exact times are rounding, and any repair would explain a large part of it.
    eps = max(8 * np.finfo(known.dtype).eps, 1e-10)
    floor = measured.times.size * (eps * np.abs(measured.times).max() / noises.times) ** 2

    def fit(measured: Measurements, repairs: tuple[str, ...], known: Known) -> _Numbering:
        fitted = fit_parameters(measured, known, noises)
        squares = np.nan_to_num(fitted.squares, nan=math.inf) + floor
        return _Numbering(measured, squares, fitted.freedom, repairs)

    def explain(before: _Numbering, after: _Numbering, choices: int) -> float:
        added = max(len(after.repairs) - len(before.repairs), 1)
        return _compute_log_chance(before, after, added, choices**added, noises.known[0])

    unrepaired = fit(silent, (), known)
    path = [unrepaired]
    # A repair may cost a degree of freedom, and two have to remain to estimate the noise.
    while len(path) <= _MAX_REPAIRS and path[-1].freedom >= 3:
        trials = [
            fit(*trial, known) for trial in _list_trials(path[-1].measured, path[-1].repairs)
        ]
        best = min(trials, key=lambda trial: trial.squares)
        if not best.squares < path[-1].squares:
            break
        path.append(best)
    choices = 3 * measured.times.size  # at most three kinds of repairs at each time
    chosen = unrepaired
    for count, numbering in enumerate(path):
        chances = [explain(shorter, numbering, choices) for shorter in path[:count]]
        if chances and max(chances) < math.log(_LEVEL):
            chosen = numbering
    if chosen.repairs and not known.free[FREQUENCY]:
        tuned = fit(silent, (), known.set_free(FREQUENCY, True))
        if explain(unrepaired, tuned, 1) < explain(unrepaired, chosen, choices):
            chosen = unrepaired
    return chosen.measured._replace(peaks=measured.peaks), chosen.repairs


def _compute_log_chance(
    before: _Numbering, after: _Numbering, added: int, choices: int, noise_known: bool
) -> float:
    """Compute the log-probability that chance lowers a sum of squares by as much.

    Leaving a time out is like shifting it by a parameter of its own: the two models are
    nested, and the ratio of their variances has an F distribution. A missing impact counts as
    one parameter as well.
    """
    from scipy.special import chdtrc, fdtrc  # which load slowly

    gain = before.squares - after.squares
    if gain <= 0 or after.freedom < 1:
        return 0.0
    if noise_known:
        chance = chdtrc(added, gain)
    else:
        chance = fdtrc(added, after.freedom, gain / added / (after.squares / after.freedom))
    # Probabilities too small for a float are compared as well: the logarithm of 0 is below all
    # others.
    return (math.log(chance) if chance > 0 else -math.inf) + math.log(choices)


def _list_trials(
    measured: Measurements, repairs: tuple[str, ...]
) -> list[tuple[Measurements, tuple[str, ...]]]:
    """List all numberings with one more repair."""
    indices = np.flatnonzero(measured.used).tolist()
    trials = list[tuple[Measurements, tuple[str, ...]]]()

    def add(index: int, sentence: str, leave_out: bool, shift: int) -> None:
        """Shift the numbers from one impact on, and perhaps leave its time out."""
        used = measured.used.copy()
        used[index] = not leave_out
        impacts = measured.impacts.copy()
        impacts[index:] += shift
        trial = measured._replace(used=used, impacts=impacts)
        trials.append((trial, (*repairs, sentence)))

    for previous, index in zip([None, *indices[:-1]], indices, strict=True):
        time = f"{measured.times[index]:.4f} s"
        # The first time cannot count an impact again, and an impact that is missing before it
        # changes nothing.
        if previous is not None:
            between = f"between {measured.times[previous]:.4f} s and {time}"
            add(index, f"the time {time} counts an impact again: left out", True, -1)
            add(index, f"an impact {between} is missing", False, 1)
        add(index, f"the time {time} is out of line: left out", True, 0)
    return trials
