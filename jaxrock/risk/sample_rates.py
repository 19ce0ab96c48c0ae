"""Rates of samples of uncertain parameters, and their means over the samples of an object."""

import math
from typing import NamedTuple

import numpy as np

from ..block import Block
from ..ground_motion import average_directions
from ..resonance import RockingModel
from ..sensitivity import FloorFactors
from ..validation import AnyArray, choose_namespace
from .not_detected import bound_not_detected
from .objects import Objects
from .outcome_table import (
    Cases,
    Crossings,
    Rates,
    list_crossings,
    locate_crossings,
    sum_rates,
    tabulate_outcomes,
)
from .site import Site


class SimulatedSamples(NamedTuple):
    """Samples along one axis, their outcomes and their rates.

    Attributes
    ----------
    cases : Cases
    overturned : ndarray of bool, shape (records, samples, levels)
    crossings : Crossings
        Located.
    rates : Rates
    """

    cases: Cases
    overturned: np.ndarray
    crossings: Crossings
    rates: Rates


def simulate_samples(
    objects: Objects,
    block: Block,
    restitution: AnyArray,
    site: Site,
    model: RockingModel,
    accuracy: float,
    floors: FloorFactors | None = None,
) -> SimulatedSamples:
    """Simulate samples of objects, given along one axis, at all levels of a site.

    `accuracy` is that of the rate of a sample, relative; see `locate_crossings`. Samples may have
    floors of their own.
    """
    samples = objects._replace(block=block, restitution=restitution, names=())
    cases = Cases.of(samples, site, model, floors)
    levels = np.asarray(site.levels)
    overturned = tabulate_outcomes(cases, levels)
    crossings = list_crossings(overturned, levels)
    crossings = locate_crossings(cases, overturned, crossings, accuracy)
    rates = sum_rates(cases, overturned, crossings)
    return SimulatedSamples(cases, overturned, crossings, rates)


class SampleMeans(NamedTuple):
    """Means over the samples of each object.

    Attributes
    ----------
    rate : ndarray, shape (...)
        [1/yr]
    contributions : ndarray, shape (records, ...)
        The rate if each motion were like this record [1/yr].
    standard_error : ndarray, shape (...)
        From record to record [1/yr].
    not_detected : ndarray, shape (...)
        See `bound_not_detected` [1/yr].
    """

    rate: np.ndarray | np.floating
    contributions: np.ndarray
    standard_error: AnyArray | np.floating
    not_detected: np.ndarray | np.floating


def average_samples(
    contributions: np.ndarray, overturned: np.ndarray, site: Site
) -> SampleMeans:
    """Average over samples.

    Parameters
    ----------
    contributions : ndarray, shape (records, ..., samples)
        The rate of each sample if each motion were like this record [1/yr].
    overturned : ndarray of bool, shape (records, ..., samples, levels)
    site : Site
    """
    means = contributions.mean(axis=-1)
    # A bound for each sample, then the mean: samples of one record have the same windows, and do
    # not count as more records.
    directions = site.suite.directions
    bounds = np.asarray(bound_not_detected(overturned, np.asarray(site.rates), directions))
    return SampleMeans(
        rate=means.mean(axis=0),
        contributions=means,
        standard_error=compute_standard_error(means, directions),
        not_detected=bounds.mean(axis=-1),
    )


def compute_standard_error(
    contributions: AnyArray, directions: int = 1
) -> AnyArray | np.floating:
    """Compute the standard error of a mean over records; NaN for one record.

    Parameters
    ----------
    contributions : array_like, shape (records, ...)
    directions : int
        Number of directions of each record in the suite. Only the means over the directions
        are independent.

    Returns
    -------
    array, shape (...)
    """
    contributions = average_directions(contributions, directions)
    records = len(contributions)
    if records == 1:
        library = choose_namespace(contributions)
        return library.full_like(contributions[0], library.nan)
    return contributions.std(axis=0, ddof=1) / math.sqrt(records)
