"""Number the impacts of a test: repairs compete with other explanations of the times."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np

from ..resonance import RockingModel
from .free_rocking_input import with_numbers
from .impact_numbers import Numbering, choices_of, log_chance, repaired
from .least_squares import (
    ANGLE,
    CHANGE,
    FREQUENCY,
    Fitted,
    Known,
    Measured,
    Noises,
    fitted,
    rounding_of,
)


def freed(known: Known, place: int) -> Known:
    """The same with one more number that is fitted."""
    free = known.free.copy()
    free[place] = True
    return eqx.tree_at(lambda k: k.free, known, free)


def fit_together(
    measured: Sequence[Measured],
    known: Sequence[Known],
    noises: Noises,
    model: RockingModel,
    lanes: int,
) -> Fitted:
    """Fits side by side, filled up to a number of them for which there is a program."""
    spare = max(lanes - len(measured), 0)

    def stacked(trees: Sequence[Any]) -> Any:
        def stack(*leaves: Any) -> Any:
            traced = any(isinstance(leaf, jax.core.Tracer) for leaf in leaves)
            return jnp.stack(leaves) if traced else np.stack(leaves)

        return jax.tree.map(stack, *trees, *[trees[0]] * spare)

    return fitted(stacked(measured), stacked(known), noises, model)


def number_impacts(
    measured: Measured, count: int, known: Known, noises: Noises, model: RockingModel, lanes: int
) -> tuple[Numbering, float]:
    """Number the impacts by the times alone.

    Repairs compete with two other explanations, another p and a C that changes. The explanation
    wins that chance would produce least often. Also returns the logarithm of the probability
    that chance fits the times as well as these two do without a repair; 0 if nothing is repaired.
    """
    # Peaks would have to be given to other arcs for each numbering.
    silent = eqx.tree_at(lambda m: m.peak_counts, measured, np.zeros_like(measured.peak_counts))
    free = known.free.copy()
    free[ANGLE] = False
    times = np.asarray(measured.times)[:count]
    rounding = rounding_of(times.dtype) * float(np.abs(times).max()) / float(noises.times)

    def with_free(*places: int) -> Numbering:
        now = free.copy()
        now[list(places)] = True
        kind = eqx.tree_at(lambda k: k.free, known, now)

        def squares_of(numberings: Sequence[Numbering]) -> np.ndarray:
            rows = [with_numbers(silent, numbering) for numbering in numberings]
            fits = fit_together(rows, [kind] * len(rows), noises, model, lanes)
            return np.sum(np.asarray(fits.residuals)[: len(rows)] ** 2, axis=1)

        return repaired(times, int(now.sum()), squares_of, noises.known[0], rounding)

    best = with_free()
    if not best.repairs:
        return best, 0.0
    unknowns, before = int(free.sum()), best.unrepaired_squares

    def chance(squares: float, used: int, repairs: int, more: int) -> float:
        freedom, choices = used - unknowns - more, choices_of(times) ** repairs
        if freedom < 1:
            return 0.0
        return log_chance(before, squares, freedom, repairs + more, choices, noises.known[0])

    def of_repaired(numbering: Numbering, more: int) -> float:
        used = int(numbering.used.sum())
        return chance(numbering.squares, used, len(numbering.repairs), more)

    least, otherwise = of_repaired(best, 0), 0.0
    for place in (FREQUENCY, CHANGE):
        if free[place]:
            continue
        other = with_free(place)
        otherwise = min(otherwise, chance(other.unrepaired_squares, count, 0, 1))
        if (explained := of_repaired(other, 1)) < least:
            best, least = other, explained
    return best, otherwise
