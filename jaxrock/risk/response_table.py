"""The responses of objects to the records of a suite at levels, and what they exceed."""

from typing import NamedTuple

import jax
import numpy as np

from ..driven import Batch, BatchResponse, follow_batch, require_complete
from ..ground_motion import Suite, require_positive_measures
from ..resonance import RockingModel
from ..sensitivity import Uncertain
from .objects import Objects, draw_objects, vary_motions

# Width in ln(level) of the interval in which a boundary is located, times the root of the
# number of samples, over which errors cancel. Over 20 records, the median of a curve is then
# known to 3e-4.
_WIDTH = 4e-3


class ResponseTable(NamedTuple):
    """Responses over records, objects, samples and levels.

    Attributes
    ----------
    batch : Batch, shape (records, objects, samples, 1)
        Each record scaled to an intensity of 1.
    model : Nonlinear or Linearized
    levels : ndarray, shape (levels,)
    critical_angle : ndarray, shape (objects, samples, 1)
        [rad]
    response : BatchResponse, shape (records, objects, samples, levels)
    """

    batch: Batch
    model: RockingModel
    levels: np.ndarray
    critical_angle: np.ndarray
    response: BatchResponse

    @property
    def rotation_ratio(self) -> np.ndarray:
        """Peak rotation over critical angle, (records, objects, samples, levels) [-]."""
        return np.asarray(self.response.peak_rotation) / self.critical_angle

    def exceed(self, limits: np.ndarray) -> np.ndarray:
        """Return which rotation ratios are exceeded, (records, objects, samples, n, levels)."""
        return np.moveaxis(_exceed(self.response, self.critical_angle, limits), -1, -2)

    def locate_boundaries(
        self, limits: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Locate the levels at which limits of the rotation ratio are exceeded, or cease to be.

        Returns the object and the limit of each boundary, by their numbers, its level, and 1
        where exceedance begins or -1 where it ends.
        """
        exceeded = self.exceed(limits)
        # No record lifts a block at a level that is low enough: uplift is sought down to there.
        lowest = exceeded[..., :1] & (limits > 0)[:, None]
        exceeded = np.concatenate([lowest, exceeded], axis=-1)
        *where, before = np.nonzero(exceeded[..., 1:] != exceeded[..., :-1])
        begins = exceeded[(*where, before + 1)]
        logarithms = np.log(np.append(1e-3 * self.levels[0], self.levels))
        low, high = logarithms[before], logarithms[before + 1]
        case = np.ravel_multi_index(where[:3], exceeded.shape[:3])
        width = _WIDTH * exceeded.shape[2] ** 0.5
        while (high - low).max(initial=0) > width:
            # Each interval by itself: it is where it is, whatever the others are.
            (wide,) = np.nonzero(high - low > width)
            middle = 0.5 * (low[wide] + high[wide])
            outcomes = self._simulate(case[wide], middle, limits)
            is_beyond = outcomes[np.arange(wide.size), where[3][wide]] == begins[wide]
            high[wide] = np.where(is_beyond, middle, high[wide])
            low[wide] = np.where(is_beyond, low[wide], middle)
        return where[1], where[3], np.exp(0.5 * (low + high)), np.where(begins, 1.0, -1.0)

    def _simulate(
        self, case: np.ndarray, logarithm: np.ndarray, limits: np.ndarray
    ) -> np.ndarray:
        """Simulate cases at values of ln(level), and return which limits each exceeds."""
        # One simulation answers for all thresholds with a boundary in the same interval.
        pairs, which = np.unique(np.stack([case, logarithm]), axis=1, return_inverse=True)
        case = pairs[0].astype(int)
        level = np.exp(pairs[1])
        response = follow_batch(self.batch.select(case).scaled(level), self.model)
        require_complete(response.complete, level=level)
        angle = np.broadcast_to(self.critical_angle, self.batch.shape).reshape(-1)[case]
        return _exceed(response, angle, limits)[which.reshape(-1)]


def simulate_responses(
    objects: Objects,
    suite: Suite,
    levels: np.ndarray,
    measure: str,
    uncertain: Uncertain | None,
    model: RockingModel,
) -> ResponseTable:
    """Simulate objects, or their samples, under all records at all levels.

    Raises
    ------
    ValueError
        If a record has no intensity, or an integration does not finish.
    """
    number = objects[1].size
    drawn = draw_objects(objects, uncertain, suite.floor is not None)
    block, restitution, floors = jax.tree.map(lambda leaf: leaf.reshape(number, -1, 1), drawn)
    motions = vary_motions(suite, floors)
    strengths = np.asarray(require_positive_measures(suite, measure, objects[0]))
    strengths = strengths.reshape(len(suite), -1, 1, 1)
    batch = Batch.of(block, restitution, motions).scaled(1 / strengths)
    response = follow_batch(batch.scaled(levels), model)
    complete = np.asarray(response.complete).swapaxes(0, 1).all(axis=2)
    names = [str(k + 1) for k in range(number)]
    require_complete(complete, object=names, record=suite.names, level=levels)
    return ResponseTable(batch, model, levels, np.arctan(1 / block.slenderness), response)


def _exceed(response: BatchResponse, angle: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """Return which rotation ratios responses exceed, along a last axis."""
    ratio = np.asarray(response.peak_rotation) / angle
    return (ratio[..., None] > limits) | np.asarray(response.overturned)[..., None]
