"""The responses of objects to the records of a suite at levels, and what they exceed."""

import math
from typing import NamedTuple

import jax
import numpy as np

from ..driven import (
    Batch,
    BatchResponse,
    EstimatedResponse,
    follow_batch,
    follow_within,
    require_complete,
)
from ..grids import apply_padded
from ..ground_motion import Suite, require_positive_measures
from ..host import count_work
from ..numerics import EvaluatedMargin, find_brackets, refine_brackets
from ..resonance import RockingModel
from ..sensitivity import Uncertain
from ..validation import AnyArray
from .floor_samples import vary_motions
from .lognormal import sum_powers
from .objects import Objects
from .uplift_levels import find_uplift_levels

# Relative width of the interval in which a boundary is located, times the root of the number
# of samples, over which errors cancel. Over 20 records, the median of a curve is then known
# to 3e-4.
_WIDTH = 4e-3
_ORIGIN = 100.0
# Motions near a boundary last long, and most lanes of a batch wait for the last one: so many
# take about as long as one.
_LANES = 512


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
    factor : ndarray, shape (records, objects, 1, levels)
        Of the records [-].
    estimate : EstimatedResponse, shape (records, objects, samples, levels)
    uplift : ndarray, shape (records, objects, samples)
        Level from which on each record lifts each sample.
    """

    batch: Batch
    model: RockingModel
    levels: np.ndarray
    critical_angle: np.ndarray
    factor: np.ndarray
    estimate: EstimatedResponse
    uplift: np.ndarray

    @property
    def rotation_ratio(self) -> np.ndarray:
        """Peak rotation over critical angle [-]."""
        return np.asarray(self.estimate.response.peak_rotation) / self.critical_angle

    def list_responses(self) -> dict[str, np.ndarray]:
        """List all responses by their names, each (records, objects, samples, levels)."""
        ratio = self.rotation_ratio
        responses = vars(self.estimate) | vars(self.estimate.response)
        responses |= {
            "rotation_ratio": ratio,
            "factor": np.broadcast_to(self.factor, ratio.shape),
        }
        del responses["response"]
        arrays = {name: np.asarray(values) for name, values in responses.items()}
        # Files have no booleans.
        return {n: v.astype(np.int8) if v.dtype == bool else v for n, v in arrays.items()}

    def exceed(self, limits: np.ndarray) -> np.ndarray:
        """Return which rotation ratios are exceeded, (records, objects, samples, n, levels)."""
        exceeded = _exceed(self.estimate.response, self.rotation_ratio, limits)
        return np.moveaxis(exceeded, -1, -2)

    def sum_boundaries(self, limits: np.ndarray) -> np.ndarray:
        """Locate boundaries of exceedance, and sum powers of ln(level) over them.

        Parameters
        ----------
        limits : ndarray, shape (n,)
            Rotation ratios.

        Returns
        -------
        ndarray, shape (records, objects, samples, n, 3)
            See `BoundarySums`.
        """
        exceeded = self.exceed(limits)
        *shape, _ = exceeded.shape
        # The level of uplift is known exactly: nothing has to be located.
        is_uplift = limits == 0
        rows = (exceeded & ~is_uplift[:, None]).reshape(-1, self.levels.size)
        angles = np.broadcast_to(self.critical_angle, self.batch.shape).reshape(-1)

        # In logarithms, as curves are fitted; from 100 on, where the relative width that the
        # search takes is nearly the same for all.
        places = _ORIGIN + np.log(self.levels / self.levels[0])

        def look_up(row: AnyArray, place: AnyArray) -> EvaluatedMargin:
            return _as_margin(rows[row, np.searchsorted(places, place)])

        def simulate(row: AnyArray, place: AnyArray) -> EvaluatedMargin:
            # One simulation answers for all thresholds with a boundary in the same interval.
            case, threshold = np.divmod(row, limits.size)
            pairs = np.stack([case, place])
            (case, place), which = np.unique(pairs, axis=1, return_inverse=True)
            case = case.astype(int)
            level = self.levels[0] * np.exp(place - _ORIGIN)
            response = follow_batch(self.batch.select(case).scaled(level), self.model)
            require_complete(response.complete, level=level)
            ratio = np.asarray(response.peak_rotation) / angles[case]
            outcomes = _exceed(response, ratio, limits)
            return _as_margin(outcomes[which.reshape(-1), threshold])

        pairs = find_brackets(look_up, np.broadcast_to(places, rows.shape), 0)
        width = _WIDTH * shape[2] ** 0.5 / _ORIGIN
        ends = refine_brackets(
            simulate, pairs, traced=False, alone=True, tolerance=width, lanes=_LANES
        )
        middles = self.levels[0] * np.exp(0.5 * (ends.stands + ends.falls) - _ORIGIN)
        signs = np.where(ends.falls > ends.stands, 1.0, -1.0)
        sums = np.zeros((len(rows), 3))
        np.add.at(sums, pairs.case, sum_powers(middles[:, None], signs[:, None]))
        sums = sums.reshape(*shape, 3)
        is_lifted = np.isfinite(self.uplift)[..., None]
        uplift = sum_powers(np.where(is_lifted, self.uplift[..., None], 1.0), is_lifted)
        sums[..., is_uplift, :] = uplift[..., None, :]
        return sums


def simulate_responses(
    objects: Objects,
    suite: Suite,
    levels: np.ndarray,
    measure: str,
    uncertain: Uncertain | None,
    tolerance: float,
    model: RockingModel,
) -> ResponseTable:
    """Simulate objects, or their samples, under all records at all levels, to a tolerance.

    Raises
    ------
    ValueError
        If a record has no intensity, or an integration does not finish.
    """
    parameters = (objects.block, objects.restitution, None)
    if uncertain is not None:
        draws = uncertain.draw(*parameters[:2], on_floor=suite.floor is not None)
        parameters = (draws.block, draws.restitution, draws.floor)
    # Samples are drawn in float64, and simulated in the precision of their medians.
    dtype = objects.restitution.dtype
    block, restitution, floors = jax.tree.map(
        lambda leaf: np.asarray(leaf, dtype).reshape(objects.number, -1, 1), parameters
    )
    motions = vary_motions(suite, floors)
    strengths = np.asarray(require_positive_measures(suite, measure, objects.block))
    strengths = np.broadcast_to(
        strengths.reshape(len(suite), -1), (len(suite), objects.number)
    )[..., None]
    shape = (len(suite), *restitution.shape[:2])
    flat = jax.tree.map(np.ravel, block)
    intensities = np.broadcast_to(strengths, shape).reshape(len(suite), -1)
    uplift = find_uplift_levels(flat, motions, intensities, model).reshape(shape)
    angle = apply_padded(lambda padded: padded.critical_angle, flat).reshape(restitution.shape)
    batch = Batch.of(block, restitution, motions)
    factor = levels / strengths[..., None]
    scaled = batch.scaled(factor)
    # A response has two companions at most, and few are simulated in a second round.
    with count_work("motions and their errors", 3 * math.prod(scaled.shape)):
        estimate = follow_within(scaled, tolerance, model)
    complete = np.asarray(estimate.response.complete).swapaxes(0, 1).all(axis=2)
    names = {"object": objects.names} if objects.shape else {}
    require_complete(
        complete if names else complete[0], **names, record=suite.names, level=levels
    )
    batch = batch.scaled(1 / strengths[..., None])
    return ResponseTable(batch, model, levels, angle, factor, estimate, uplift)


def _exceed(response: BatchResponse, ratio: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """Return which rotation ratios responses exceed, along a last axis."""
    return (ratio[..., None] > limits) | np.asarray(response.overturned)[..., None]


def _as_margin(exceeded: np.ndarray) -> EvaluatedMargin:
    """Return what a search asks for: a margin that is negative beyond the threshold."""
    zeros = np.zeros(exceeded.shape)
    return EvaluatedMargin(np.where(exceeded, -1.0, 1.0), zeros, zeros)
