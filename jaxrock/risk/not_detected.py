"""Bound of the change of a rate by windows of overturning or survival that no level hits."""

import numpy as np

from ..validation import AnyArray, choose_namespace

# The rule of three: where none was detected, a Poisson variable has a mean of at most
# -ln(0.05), about 3, with a confidence of 95 % (Hanley and Lippman-Hand 1983,
# doi:10.1001/jama.1983.03330370053031).
_RULE_OF_THREE = 3


# The population is all levels of shaking beyond the first, each counted by how often per year
# it occurs, which is how much the hazard falls there. A species is a window: a range of levels
# within which the outcome under one record differs from the outcome on both sides, be it that
# the block overturns there or that it survives. The sample is the levels at which the block
# was simulated, and each belongs to the window in which it lies. The wider a window is (in
# rate of the hazard), the more likely a level hits it, as a frequent species is more likely to
# be met.
#
# Good and Turing: the species without a member in the sample have together the fraction N1 / N
# of the population, where N1 species have exactly one member and N is the size of the sample.
# Here a level does not stand for 1 / N but for a fraction of its own, half of the fall of the
# hazard between its neighbours. So the sum of these fractions over the levels that are alone
# in their window estimates the width of all windows that no level hits.
#
# A window that was missed changes the rate by its width, up or down. The sum of the widths is
# thus a bound of the change, in which no signs cancel.
def bound_not_detected(
    overturned: AnyArray, rates: AnyArray, directions: int = 1
) -> AnyArray | np.floating:
    """Bound the change of rates by windows that no level hits, and beyond the last level.

    After Good (1953, doi:10.1093/biomet/40.3-4.237) and Good and Toulmin (1956,
    doi:10.1093/biomet/43.1-2.45).

    Parameters
    ----------
    overturned : Array of bool, shape (records, ..., levels)
    rates : Array, shape (levels,)
        The hazard at the levels [1/yr].
    directions : int
        Number of directions of each record in the suite. The bound is the mean over the
        directions, which may have the same windows and do not count as more records.

    Returns
    -------
    Array, shape (...)
        Upper bound (95 %) of the change of the mean over the records [1/yr].
    """
    width, deviation = estimate_windows(overturned, rates, directions)
    library = choose_namespace((overturned, rates))
    # Without any level alone both are 0, and yet windows may have been missed: up to three,
    # each as wide as the widest step where the outcome changes, or as the widest of all if it
    # never does. Windows at levels far below these are wider, and not covered.
    steps = rates[:-1] - rates[1:]
    changed = _split_changes(overturned, directions)
    all_steps = library.broadcast_to(steps, changed.shape)
    widest = library.where(changed, all_steps, 0).max(axis=-1).max(axis=1)
    widest = library.where(changed.any(axis=-1).any(axis=1), widest, steps.max()).mean(axis=0)
    # Beyond the last level anything may happen.
    return width + 2 * deviation + _RULE_OF_THREE * widest / changed.shape[1] + rates[-1]


def estimate_windows(
    overturned: AnyArray, rates: AnyArray, directions: int = 1
) -> tuple[AnyArray | np.floating, AnyArray | np.floating]:
    """Estimate the width of windows that exactly one level hits; see `bound_not_detected`.

    Returns their sum and its standard deviation, if each of them was met by chance (Poisson);
    both are means over the records (...) [1/yr].
    """
    library = choose_namespace((overturned, rates))
    # Levels alone in their window: the outcome differs from the one before and the one after.
    changed = _split_changes(overturned, directions)
    is_alone = changed[..., :-1] & changed[..., 1:]
    widths = library.broadcast_to(0.5 * (rates[:-2] - rates[2:]), is_alone.shape)
    alone = library.where(is_alone, widths, 0)
    width = alone.sum(axis=-1).sum(axis=1)
    deviation = library.sqrt((alone * alone).sum(axis=-1).sum(axis=1))
    records = changed.shape[1]
    return width.mean(axis=0) / records, deviation.mean(axis=0) / records


def _split_changes(overturned: AnyArray, directions: int) -> AnyArray:
    """Find changes of the outcome between levels, (directions, records, ..., levels - 1)."""
    split = overturned.reshape(directions, -1, *overturned.shape[1:])
    return split[..., 1:] != split[..., :-1]
