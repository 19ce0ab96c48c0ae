"""Bound of the change of a rate by windows of overturning or survival that no level hits."""

import jax
import jax.numpy as jnp

from ..validation import Booleans, Reals

# The rule of three: where none was seen, a Poisson variable has a mean of at most -ln(0.05),
# about 3, with a confidence of 95 % (Hanley and Lippman-Hand 1983,
# doi:10.1001/jama.1983.03330370053031).
_RULE_OF_THREE = 3


# The population is all levels of shaking beyond the first, each counted by how often a year it
# occurs, which is how much the hazard falls there. A species is a window: a range of levels
# within which the outcome under one record differs from the outcome on both sides, be it that
# the block overturns there or that it survives. The sample is the levels at which the block
# was followed, and each belongs to the window in which it lies. The wider a window is (in rate
# of the hazard), the more likely a level hits it, as a frequent species is more likely to be
# met.
#
# Good and Turing: the species without a member in the sample have together the share N1 / N of
# the population, where N1 species have exactly one member and N is the size of the sample.
# Here a level does not stand for 1 / N but for a share of its own, half of the fall of the
# hazard between its neighbours. So the sum of these shares over the levels that are alone in
# their window estimates the width of all windows that no level hits.
#
# A window that was missed changes the rate by its width, up or down. The sum of the widths is
# thus a bound of the change, in which no signs cancel.
@jax.jit
def estimate_unseen_by_good_turing(overturned: Booleans, rates: Reals) -> Reals:
    """Estimate a bound of the change of the rate by windows between levels and levels beyond.

    After Good (1953, doi:10.1093/biomet/40.3-4.237) and Good and Toulmin (1956,
    doi:10.1093/biomet/43.1-2.45). `overturned` has the shape (records, levels); `rates` are
    those of the hazard at the levels.
    """
    # Levels alone in their window: the outcome differs from the one before and the one after.
    changed = overturned[:, 1:] != overturned[:, :-1]
    lonely = changed[:, :-1] & changed[:, 1:]
    alone = jnp.where(lonely, 0.5 * (rates[:-2] - rates[2:])[None, :], 0)
    # Twice the standard deviation of their sum, if each of them was met by chance (Poisson).
    scatter = 2 * jnp.sqrt((alone * alone).sum())

    # Without any level alone both are 0, and yet windows may have been missed: up to three,
    # each as wide as steps are where the outcome changes, or as the widest step if it never
    # does.
    steps = rates[:-1] - rates[1:]
    number = changed.sum()
    width = jnp.where(changed, steps[None, :], 0).sum()
    typical = jnp.where(
        number > 0, width / jnp.maximum(number, 1).astype(rates.dtype), steps.max()
    )
    # Averaged over the records, as the rate is. Beyond the last level anything may happen.
    return (alone.sum() + scatter + _RULE_OF_THREE * typical) / len(overturned) + rates[-1]
