"""Number the impacts of a test: repairs compete with other explanations of the times."""

from collections.abc import Sequence

import numpy as np

from .free_rocking_motion import ANGLE, CHANGE, FREQUENCY, Known, Measured, Noises
from .free_rocking_search import fit_together, rounding_of
from .impact_numbers import Numbering, choices_of, log_chance, repair

_STEPS = 50  # of each fit: they are many, and only the best one counts


def with_numbers(measured: Measured, numbering: Numbering) -> Measured:
    """Return the numbered measurements; peaks count between impacts in succession."""
    impacts = numbering.impacts
    used = numbering.used
    renumbered = measured._replace(impacts=impacts, time_counts=used)
    if not measured.peaks.size:
        return renumbered
    whole = used[:-1] & used[1:] & (np.diff(impacts) == 1)
    return renumbered._replace(arcs=impacts[:-1], peak_counts=measured.peak_counts & whole)


def number_impacts(
    measured: Measured, known: Known, noises: Noises
) -> tuple[Numbering, float]:
    """Count the impacts by the times alone.

    Repairs compete with two other explanations, another p and a C that changes. The
    explanation wins that chance would produce least often. Also returns the logarithm of the
    probability that chance fits the times as well as these two do without a repair; 0 if
    nothing is repaired.
    """
    # Peaks would have to be given to other arcs for each numbering.
    silent = measured._replace(peak_counts=np.zeros_like(measured.peak_counts))
    known = known.freed(ANGLE, False)
    times = measured.times
    rounding = rounding_of(known.dtype) * float(np.abs(times).max()) / noises.times

    def with_free(kind: Known) -> Numbering:
        def squares_of(numberings: Sequence[Numbering]) -> np.ndarray:
            rows = [with_numbers(silent, numbering) for numbering in numberings]
            fits = fit_together(rows, [kind] * len(rows), noises, _STEPS)
            return np.array([fit.squares for fit in fits])

        unknowns = int(kind.free.sum())
        return repair(times, unknowns, squares_of, noises.known[0], rounding)

    best = with_free(known)
    if not best.repairs:
        return best, 0.0
    unknowns = int(known.free.sum())
    before = best.unrepaired_squares

    def chance(squares: float, used: int, repairs: int, more: int) -> float:
        freedom = used - unknowns - more
        if freedom < 1:
            return 0.0
        choices = choices_of(times) ** repairs
        return log_chance(before, squares, freedom, repairs + more, choices, noises.known[0])

    def of_repaired(numbering: Numbering, more: int) -> float:
        used = int(numbering.used.sum())
        return chance(numbering.squares, used, len(numbering.repairs), more)

    least = of_repaired(best, 0)
    otherwise = 0.0
    for place in (FREQUENCY, CHANGE):
        if known.free[place]:
            continue
        other = with_free(known.freed(place))
        otherwise = min(otherwise, chance(other.unrepaired_squares, times.size, 0, 1))
        explained = of_repaired(other, 1)
        if explained < least:
            best = other
            least = explained
    return best, otherwise
