"""A population before its tests: medians known by other means, usual deviations."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ...block import Block
from ...sensitivity import find_widths, refuse_name
from ...validation import (
    NON_NEGATIVE,
    POSITIVE,
    RIGHT_ANGLE,
    UNIT_INTERVAL,
    AnyArray,
    as_real,
    check,
    describe,
)
from ..free_rocking_answer import FreeRockingFit
from .population import NAMES

PriorLike = Block | FreeRockingFit | Mapping[str, tuple[float, float]]

_DOMAINS = {
    "critical_angle": RIGHT_ANGLE,
    "frequency_parameter": POSITIVE,
    "restitution": UNIT_INTERVAL,
}
# Objects of laboratories, museums and the field, as long as nothing else is known. Within two
# standard deviations: alpha_c of 0.05 to 0.8 rad, p of 1.2 to 13 1/s (half-diagonals of 0.04 to
# 5 m), C of 0.45 to 0.95.
_MEDIANS = (0.2, 4.0, 0.8)
_WIDTHS = (0.7, 0.6, 0.8)
# Tests of one object, whose contact with the ground differs from test to test.
_DEVIATIONS = (0.2, 0.1, 0.3)
_WIDTH_OF_DEVIATIONS = 0.5
_WIDTH_OF_CORRELATIONS = 0.4
_LAPSE = (0.03, 1.0)  # median, and standard deviation of the logit
_GROUP_DEVIATION = (0.15, 0.7)  # median, and standard deviation of the logarithm
_PEAK_DEVIATION = (0.3, 0.7)
# Coefficient of variation of alpha_c and p by the size of a block, whose edges are rounded and
# whose base is uneven.
_BY_SIZE = 0.05
# Standard deviation of a coordinate that is known exactly: a normal density needs some.
_LEAST_WIDTH = 1e-3


class Prior(NamedTuple):
    """Independent normal distributions of the free numbers of a population.

    Attributes
    ----------
    mean, width : ndarray or Array, shape (12,)
        In the order of `pack_population`.
    """

    mean: AnyArray
    width: AnyArray


def make_prior(prior: PriorLike | None) -> Prior:
    """Make the prior of what is known of a block; see `fit_outcomes`.

    Raises
    ------
    ValueError
        If a name, a median or a coefficient of variation is not allowed.
    """
    mean = [math.log(_MEDIANS[0]), math.log(_MEDIANS[1]), _compute_logit(_MEDIANS[2])]
    width = list(_WIDTHS)
    for name, (median, variation) in _list_known(prior).items():
        place = NAMES.index(name)
        known_width, _ = find_widths([name], np.array([median]), np.array([variation]))
        is_bounded = name == "restitution"
        mean[place] = _compute_logit(median) if is_bounded else math.log(median)
        width[place] = max(float(known_width[0]), _LEAST_WIDTH)
    return Prior(
        mean=np.array(
            [
                *mean,
                *(math.log(deviation) for deviation in _DEVIATIONS),
                *(0.0, 0.0, 0.0),
                _compute_logit(_LAPSE[0]),
                math.log(_GROUP_DEVIATION[0]),
                math.log(_PEAK_DEVIATION[0]),
            ]
        ),
        width=np.array(
            [
                *width,
                *[_WIDTH_OF_DEVIATIONS] * 3,
                *[_WIDTH_OF_CORRELATIONS] * 3,
                _LAPSE[1],
                _GROUP_DEVIATION[1],
                _PEAK_DEVIATION[1],
            ]
        ),
    )


def _compute_logit(fraction: float) -> float:
    """Compute the logarithm of the odds."""
    return math.log(fraction / (1 - fraction))


def _list_known(prior: PriorLike | None) -> dict[str, tuple[float, float]]:
    """List medians and coefficients of variation of what is known, by name."""
    if prior is None:
        return {}
    if isinstance(prior, Block):
        return {
            "critical_angle": (_to_number("prior", prior.critical_angle), _BY_SIZE),
            "frequency_parameter": (_to_number("prior", prior.frequency_parameter), _BY_SIZE),
        }
    if isinstance(prior, FreeRockingFit):
        fitted = {name: float(getattr(prior, name)) for name in NAMES}
        return {
            name: (value, float(prior.standard_errors[name]) / value)
            for name, value in fitted.items()
            if math.isfinite(value) and math.isfinite(float(prior.standard_errors[name]))
        }
    if not isinstance(prior, Mapping):
        raise ValueError(
            "prior must be a Block, a FreeRockingFit, or a mapping of names to medians and"
            f" coefficients of variation, got {describe(prior)}"
        )
    return dict(_check_known(name, pair) for name, pair in prior.items())


def _check_known(name: object, pair: object) -> tuple[str, tuple[float, float]]:
    """Check one entry of a prior."""
    if not isinstance(name, str) or name not in NAMES:
        refuse_name(name, NAMES, "prior")
    values = np.asarray(as_real(f"prior of {name}", pair), float)
    if values.shape != (2,):
        raise ValueError(
            f"prior of {name} must be a median and a coefficient of variation, got"
            f" {describe(pair)}"
        )
    median, variation = values.tolist()
    check(f"median of {name} in prior", np.asarray(median), _DOMAINS[name])
    check(f"coefficient of variation of {name} in prior", np.asarray(variation), NON_NEGATIVE)
    if name == "restitution" and not 0 < median < 1:
        raise ValueError(
            "median of restitution in prior must be greater than 0 and less than 1, got"
            f" {median:g}"
        )
    return name, (median, variation)


def _to_number(name: str, value: object) -> float:
    """Convert a concrete single number; `ValueError` for arrays."""
    array = np.asarray(value)
    if array.ndim:
        raise ValueError(f"{name} must be a single block, got shape {array.shape}")
    return float(array)
