"""The cost of pulses that do not come right after the impacts.

The paper's input is timed by the motion of the block. Here trains of equal pulses are timed
differently, and made just as strong as it takes to overturn the block.
"""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..impact import read_restitution, require_free_standing
from ..validation import (
    Booleans,
    Number,
    Reals,
    check_kind,
    unify_precision,
)
from .free_rocking import Linearized, ModelLike, as_model
from .pulse_train import Rocker, follow_timed_train
from .train_through_impacts import Train, follow_phased_train

_DELAYS = (0.05, 0.1, 0.2)  # half-cycles
_MAX_CORRECTIONS = 200
_STEP = 0.005  # relative, of the grid of spacings and strengths: the 0.5 % that is promised
_TRAINS_AT_ONCE = 1024


def timing_costs(
    block: Block, restitution: Number, count: int, model: ModelLike = Linearized()
) -> dict[str, float]:
    """Compute the intensities at which equal pulses overturn a block, for several timings.

    Parameters
    ----------
    block : Block
        One block.
    restitution : float
        Its C [-], between 0 and 1.
    count : int
        Number of pulses, at least 2.
    model : Linearized or Nonlinear
        Equation of the motion between the pulses.

    Returns
    -------
    dict
        Intensity [m/s] by timing: pulses at the impacts, pulses a fraction of a half-cycle
        after them, and alternating pulses at the best of equal spacings. The best spacing is
        accurate to 0.5 %, and the intensity is high enough for a spacing with this error. No
        intensity exceeds the one with which a single pulse overturns the block. NaN where the
        search did not converge.

    Raises
    ------
    ValueError
        If `restitution` is not between 0 and 1, if `count` is less than 2, or if the block is
        one-sided: pulses in one direction overturn it sooner the closer they are.

    Examples
    --------
    >>> import jaxrock as jr
    >>> for timing, intensity in jr.resonance.timing_costs(jr.Block(0.4, 5.0), 0.7, 3).items():
    ...     print(f"{intensity:.3f} m/s {timing}")
    0.475 m/s right after the impacts
    0.619 m/s right before the impacts
    0.495 m/s 0.05 half-cycles after the impacts
    0.517 m/s 0.1 half-cycles after the impacts
    0.568 m/s 0.2 half-cycles after the impacts
    0.577 m/s at the best of equal spacings
    """
    check_kind("block", block, Block)
    require_free_standing(block, "the cost of timing")
    restitution = read_restitution(block, restitution)
    block.check()
    if count < 2:
        raise ValueError(f"count must be at least 2, got {count}")
    block, restitution = unify_precision((block, restitution))
    rocker = Rocker(block, restitution, as_model(model))
    number = jnp.arange(count)
    ones = jnp.ones(count, restitution.dtype)
    after = Train(0 * ones, ones, jnp.ones(count, int))
    # The second pulse comes before the first impact, each further one before the next.
    before = Train(ones, jnp.where(number == 0, ones, -ones), jnp.where(number > 1, 1, 0))
    strengths = {
        "right after the impacts": _find_needed_strength(rocker, after),
        "right before the impacts": _find_needed_strength(rocker, before),
    }
    for delay in _DELAYS:
        strengths[f"{delay:g} half-cycles after the impacts"] = _find_needed_strength(
            rocker, after, delay
        )
    equal = _find_equally_spaced_strength(rocker, count, strengths["right after the impacts"])
    strengths["at the best of equal spacings"] = equal
    return {timing: strength * float(rocker.unit) for timing, strength in strengths.items()}


@jax.jit
def _compute_end_and_delays(rocker: Rocker, train: Train) -> tuple[Reals, Reals]:
    """Compute the velocity in the end over the critical one, and the delays in half-cycles."""
    outcome = follow_phased_train(rocker, train)
    return outcome.x, outcome.delays


def _find_needed_strength(rocker: Rocker, train: Train, delay: float | None = None) -> float:
    """Find the factor with which a train just overturns, its pulses so late; at most 1.

    Strength and phases are corrected in proportion, which is nearly how they act. The factor
    is NaN if that does not converge.

    Parameters
    ----------
    rocker, train
        The block, and the pulses at a factor of 1.
    delay
        Time of the pulses since the impacts, in half-cycles; None to leave the phases as they
        are.
    """
    tolerance = float(jnp.finfo(rocker.restitution.dtype).eps) ** 0.75
    strength = 1 / train.impulse.size * jnp.ones_like(rocker.restitution)
    # From launch to impact the velocity changes from x to -x. This is the share of that change
    # that is over when the pulse comes; in weak motion, where gravity slows the block evenly,
    # it is the delay.
    lost = jnp.full_like(train.phase, delay or 0.0)
    for _ in range(_MAX_CORRECTIONS):
        if delay is not None:
            train = train._replace(phase=jnp.arccos(1 - 2 * jnp.minimum(lost, 0.5)) / jnp.pi)
        x, delays = _compute_end_and_delays(
            rocker, train._replace(impulse=strength * train.impulse)
        )
        if not x > 0:
            return 1.0  # impacts leave nothing: only a single pulse overturns

        # Linearized and without delays the velocity is in proportion to the strength, and one
        # correction does.
        strength = strength / x
        change = abs(float(x) - 1)
        if delay is not None:
            factor = delay / jnp.where(delays > 0, delays, delay)
            lost = lost * factor
            change = change + float(abs(factor - 1).max())
        if change < tolerance:
            return min(float(strength), 1.0)
    return math.nan


def _find_equally_spaced_strength(rocker: Rocker, count: int, least: float) -> float:
    """Find the smallest strength, from `least` on, with which alternating pulses overturn.

    It is NaN if it is not inside of the range that was searched.
    """
    if math.isnan(least):
        return math.nan
    rate = float(rocker.block.frequency_parameter)
    linearized = Linearized()
    spacing, strength = _find_weakest_train(
        rocker._replace(model=linearized), count, (0.05 / rate, 4 / rate), (least, 1.0)
    )
    if rocker.model == linearized or spacing == 0:
        return strength
    # The nonlinear search takes longer, and only looks around the linearized optimum.
    around = (0.95 * spacing, 1.05 * spacing)
    low = max(least, 0.95 * strength)
    high = min(1.1 * strength, 1.0)
    spacing, strength = _find_weakest_train(rocker, count, around, (low, high))
    # At an end of a range there may be a weaker train beyond it.
    at_end = spacing in around or strength <= low * (1 + 1e-9) or (spacing == 0 and high < 1)
    return math.nan if at_end else strength


def _find_weakest_train(
    rocker: Rocker, count: int, spacings: tuple[float, float], strengths: tuple[float, float]
) -> tuple[float, float]:
    """Find spacing [s] and strength of the weakest train in a range that overturns.

    They are 0 and 1 if there is none. Trains whose spacing is a step longer or shorter have to
    overturn, too: over the spacings there are narrow wedges, whose very tips cannot be hit.
    """
    spacing, strength = (
        np.geomspace(low, high, 1 + round(np.log(high / low) / _STEP))
        for low, high in (spacings, strengths)
    )
    # From the weakest on, the same number in every call, so that one program serves all.
    rows = max(1, _TRAINS_AT_ONCE // spacing.size)
    for start in range(0, strength.size, rows):
        row = strength[start : start + rows]
        row = np.pad(row, (0, rows - row.size), mode="edge")
        grid = np.meshgrid(spacing, row)
        trains = (jnp.asarray(part.reshape(-1), rocker.restitution.dtype) for part in grid)
        overturn = np.asarray(_tell_overturning(rocker, count, *trains)).reshape(grid[0].shape)
        overturn = overturn[:, :-2] & overturn[:, 1:-1] & overturn[:, 2:]
        if overturn.any():
            k = int(overturn.any(axis=1).argmax())
            return float(spacing[1 + overturn[k].argmax()]), float(row[k])
    return 0.0, 1.0


@eqx.filter_jit
def _tell_overturning(
    rocker: Rocker, count: int, spacings: Reals, strengths: Reals
) -> Booleans:
    """Tell which of many trains of alternating pulses, equally spaced, overturn the block."""
    number = jnp.arange(count).astype(spacings.dtype)
    alternating = rocker.unit * jnp.where(number % 2 == 0, 1, -1)

    def is_overturning(spacing: Reals, strength: Reals) -> Booleans:
        """Return whether one train overturns the block."""
        return follow_timed_train(rocker, spacing * number, strength * alternating).overturned

    return jax.vmap(is_overturning)(spacings, strengths)
