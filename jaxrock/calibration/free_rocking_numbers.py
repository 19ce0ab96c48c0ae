"""Number the impacts of a test: repairs compete with other explanations of the times."""

from collections.abc import Sequence

import numpy as np

from .free_rocking_motion import ANGLE, CHANGE, FREQUENCY, Known, Measured, Noises
from .free_rocking_search import estimate_rounding, fit_together
from .impact_numbers import Numbering, compute_log_chance, count_choices, repair_numbering

# Steps of each fit, half of the usual: there are many fits, and a numbering that still has not
# arrived is not the one that fits best.
_STEPS = 50


def apply_numbering(measured: Measured, numbering: Numbering) -> Measured:
    """Return the numbered measurements; peaks count between impacts in succession."""
    impacts = numbering.impacts
    used = numbering.used
    # With weights of 0 instead of fewer measurements: all numberings have the same shape.
    renumbered = measured._replace(impacts=impacts, time_counts=used)
    if not measured.peaks.size:
        return renumbered
    # A peak between impacts that are not in succession may belong to any half-cycle between
    # them.
    whole = used[:-1] & used[1:] & (np.diff(impacts) == 1)
    return renumbered._replace(arcs=impacts[:-1], peak_counts=measured.peak_counts & whole)


def number_impacts(
    measured: Measured, known: Known, noises: Noises
) -> tuple[Numbering, float]:
    """Count the impacts by the times alone, and weigh repairs against other explanations.

    Repairs compete with two other explanations, another p and a C that changes, since the
    times of another block are explained by leaving some of them out, too. All are compared
    with the fit in which nothing is repaired and no further number is free; the one wins that
    chance would produce least often. The stages are:

    1. Repair with the numbers that are free. If nothing is repaired, that is all.
    2. Repair with p free as well, then with a change of C. Both count as one number more.
    3. Of the three, take the one of least chance.

    Also return the logarithm of the p-value of the better rival, another p or a change of C,
    against the fit without any repair; 0 if nothing is repaired.
    """
    # Peaks would have to be given to other arcs for each numbering. Without them nothing
    # depends on the critical angle, which must not be free then.
    silent = measured._replace(peak_counts=np.zeros_like(measured.peak_counts))
    known = known.set_free(ANGLE, False)
    times = measured.times
    # In units of the noise, as residuals are.
    rounding = estimate_rounding(known.dtype) * float(np.abs(times).max()) / noises.times

    def repair_with(kind: Known) -> Numbering:
        """Repair the times as far as the free numbers do not explain them."""

        def fit_squares(numberings: Sequence[Numbering]) -> np.ndarray:
            """Fit each numbering, and return the sums of squares."""
            rows = [apply_numbering(silent, numbering) for numbering in numberings]
            fits = fit_together(rows, [kind] * len(rows), noises, _STEPS)
            return np.array([fit.squares for fit in fits])

        unknowns = int(kind.free.sum())
        return repair_numbering(times, unknowns, fit_squares, noises.known[0], rounding)

    best = repair_with(known)
    if not best.repairs:
        return best, 0.0
    unknowns = int(known.free.sum())
    unrepaired = best.unrepaired_squares

    def compute_chance(squares: float, used: int, repairs: int, more: int) -> float:
        """Compare with the fit without repairs and without more free numbers."""
        freedom = used - unknowns - more
        if freedom < 1:
            return 0.0  # the logarithm of 1: measurements as few as numbers explain nothing
        # Repairs are chosen among many, and the chance allows for that. A further number is
        # one of two: that choice is neglected.
        choices = count_choices(times) ** repairs
        return compute_log_chance(
            unrepaired, squares, freedom, repairs + more, choices, noises.known[0]
        )

    def compute_chance_of(numbering: Numbering, more: int) -> float:
        """Compute the chance of a numbering with so many more free numbers."""
        used = int(numbering.used.sum())
        return compute_chance(numbering.squares, used, len(numbering.repairs), more)

    least = compute_chance_of(best, 0)
    otherwise = 0.0
    for place in (FREQUENCY, CHANGE):
        if known.free[place]:
            continue  # the first numbering has it already
        other = repair_with(known.set_free(place))
        otherwise = min(otherwise, compute_chance(other.unrepaired_squares, times.size, 0, 1))
        explained = compute_chance_of(other, 1)
        if explained < least:
            best = other
            least = explained
    return best, otherwise
