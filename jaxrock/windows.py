"""Survival above the first overturning amplitude: windows in the strength of a motion."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .arguments import NON_NEGATIVE, POSITIVE, Number, Numbers, as_real, check
from .batch import respond_batch
from .block import Block
from .motion import Motion


class SurvivalWindows(NamedTuple):
    """Where a block stands and where it overturns, over the strength of a motion.

    Attributes
    ----------
    first_overturning : float
        Smallest factor in the range that overturns the block, which is the first one of it
        if that does; inf if none does.
    windows : ndarray, shape (windows, 2)
        Factors between which it stands again, above that; inf where the range ends before
        the window does.
    """

    first_overturning: float
    windows: np.ndarray


def survival_windows(
    block: Block,
    restitution: Number,
    motion: Motion,
    factors: Numbers,
    *,
    linearized: bool = False,
    tolerance: float = 1e-9,
) -> SurvivalWindows:
    """Windows above the first overturning strength in which a block survives.

    The ground can pull a block back from beyond the critical angle, so that what overturns
    it need not overturn it if it is stronger.

    Parameters
    ----------
    block : Block
        One block.
    restitution : float
        C [-], between 0 and 1.
    motion : Motion
        A pulse or a `Record`.
    factors : array_like, shape (n,)
        Increasing factors on the motion to try. A window between two of them goes unseen.
    linearized : bool
        Linearize the equation of motion; see `respond`.
    tolerance : float
        To which the edges are located, relative to the factor.

    Returns
    -------
    SurvivalWindows

    Raises
    ------
    ValueError
        If an argument is outside of what is allowed, or `factors` does not increase.
    """
    tried = np.asarray(as_real("factors", factors), float)
    check("factors", tried, NON_NEGATIVE)
    if tried.ndim != 1 or tried.size < 2 or (np.diff(tried) <= 0).any():
        raise ValueError(
            "factors must be increasing and at least two, got an array of shape"
            f" {tried.shape}" + (" that does not increase" if tried.ndim == 1 else "")
        )

    check("tolerance", as_real("tolerance", tolerance), POSITIVE)
    numbers = {"block": block, "restitution": restitution}
    for name, value in (numbers | {"motion": (motion.end, motion.intensity)}).items():
        if any(jnp.ndim(part) for part in jax.tree.leaves(value)):
            raise ValueError(f"{name} must be one, not an array")

    def overturns(factor: np.ndarray) -> np.ndarray:
        scaled = motion.scaled(factor)
        answer: Any = respond_batch(block, restitution, scaled, scaled.end, linearized=linearized)
        if not bool(answer.complete.all()):
            raise ValueError("motion could not be followed to its end for every factor")
        return np.asarray(answer.overturned)

    falls = overturns(tried)
    changes = np.flatnonzero(falls[1:] != falls[:-1])
    low, high, before = tried[changes], tried[changes + 1], falls[changes]
    while changes.size and (high - low > tolerance * high).any():
        middle = 0.5 * (low + high)
        if ((middle <= low) | (middle >= high)).all():
            break
        same = overturns(middle) == before
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    edges = 0.5 * (low + high)
    if falls[0]:
        edges = np.concatenate([tried[:1], edges])
    if edges.size == 0:
        return SurvivalWindows(np.inf, np.empty((0, 2)))
    rest = edges[1:]
    if rest.size % 2:
        rest = np.append(rest, np.inf)
    return SurvivalWindows(float(edges[0]), rest.reshape(-1, 2))
