"""The scale factors around a motion at which a block keeps its outcome."""

from typing import NamedTuple

import numpy as np

from ..block import Block
from ..driven import require_complete
from ..ground_motion import Motion
from ..overturning import overturning_boundaries
from ..resonance import ModelLike
from ..validation import Number

# Boundaries are sought up to so many standard deviations of the logarithm away, at so many
# factors. Odd, so that the motion itself is among them, however narrow its interval is.
_RANGE = 4.0
_FACTORS = 257


class OutcomeInterval(NamedTuple):
    """The scale factors around a motion at which the outcome stays.

    Attributes
    ----------
    scale : float
        The factor on the motion itself.
    low, high : float
        The ends, NaN where there is no boundary within the range.
    range : tuple of float
        The factors between which boundaries were sought.
    overturned : bool
        The outcome.
    uncertainty : float
        The largest coefficient of variation.
    """

    scale: float
    low: float
    high: float
    range: tuple[float, float]
    overturned: bool
    uncertainty: float

    @property
    def nearest(self) -> float:
        """The distance to the nearest boundary over the scale, inf if there is none."""
        ends = np.array([self.low, self.high])
        return float(np.nan_to_num(abs(ends / self.scale - 1), nan=np.inf).min())

    @property
    def has_near_boundary(self) -> bool:
        """True if a boundary is nearer than the uncertainty."""
        return self.nearest < self.uncertainty

    def __str__(self) -> str:
        block = f"the block {write_outcome(self.overturned)}"
        if np.isnan(self.low) and np.isnan(self.high):
            low, high = self.range
            return f"{block} for all scale factors from {low:.3g} to {high:.3g}"
        uncertainty = f"than the assumed uncertainty ({100 * self.uncertainty:.3g} %)"
        compared = f"{'nearer' if self.has_near_boundary else 'further away'} {uncertainty}"
        if np.isnan(self.low):
            return f"{block} up to a scale factor of {self.high:.5g}, which is {compared}"
        if np.isnan(self.high):
            return f"{block} from a scale factor of {self.low:.5g} on, which is {compared}"
        factors = f"{block} only for scale factors {self.low:.5g} to {self.high:.5g}"
        if self.high - self.low < self.uncertainty * self.scale:
            return f"{factors}, a range narrower {uncertainty}"
        if self.has_near_boundary:
            return f"{factors}; one of these is {compared}"
        return f"{factors}, a range wider {uncertainty}"


def find_outcome_interval(
    block: Block,
    restitution: Number,
    motion: Motion,
    *,
    scale: float,
    uncertainty: float,
    model: ModelLike,
) -> OutcomeInterval:
    """Find the scale factors around a motion at which the outcome stays.

    Parameters
    ----------
    block, restitution, motion : Block, float, Motion
        One scene.
    scale : float
        The factor on the motion around which boundaries are sought, greater than 0.
    uncertainty : float
        The largest coefficient of variation, greater than 0.
    model : Nonlinear or Linearized, or their names

    Returns
    -------
    OutcomeInterval

    Raises
    ------
    ValueError
        If an integration did not finish.
    """
    width = _RANGE * float(np.log1p(uncertainty**2) ** 0.5)
    factors = np.exp(np.linspace(-width, width, _FACTORS))
    boundaries = overturning_boundaries(
        block, restitution, motion.scaled(scale), "factor", factors, model=model
    )
    low, high = (scale * factors[[0, -1]]).tolist()
    require_complete(boundaries.complete, scale_factors=f"from {low:.3g} to {high:.3g}")
    places = np.asarray(boundaries.value, float)
    below = places[places <= 1]
    above = places[places > 1]
    return OutcomeInterval(
        scale=scale,
        low=scale * float(below[-1]) if below.size else np.nan,
        high=scale * float(above[0]) if above.size else np.nan,
        range=(low, high),
        # The outcome changes at each boundary below the scene.
        overturned=bool(boundaries.overturns_first) != bool(len(below) % 2),
        uncertainty=uncertainty,
    )


def write_outcome(overturned: bool) -> str:
    """Write what the block does."""
    return "overturns" if overturned else "stands"
