"""A population before its tests: medians known by other means, usual deviations."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.special import logit

from ...block import Block
from ...validation import (
    NON_NEGATIVE,
    POSITIVE,
    RIGHT_ANGLE,
    Domain,
    as_array,
    as_name,
    as_real,
    check,
    describe,
)
from ..free_rocking_answer import FreeRockingFit
from .population import FRACTIONS, NAMES, Population

PriorLike = Block | FreeRockingFit | Mapping[str, tuple[float, float]]

# Median, and standard deviation of the unbounded parameter. The medians are typical of objects
# in laboratories, museums and the field, and serve if nothing else is known. Within two
# standard deviations: alpha_c of 0.05 to 0.8 rad, p of 1.2 to 13 1/s (half-diagonals of 0.04
# to 5 m), C of 0.45 to 0.95. The deviations are typical of tests of one object, whose contact
# with the ground varies.
_USUAL = {
    "critical_angle": (0.2, 0.7),
    "frequency_parameter": (4.0, 0.6),
    "restitution": (0.8, 0.8),
    "critical_angle_deviation": (0.2, 0.5),
    "frequency_parameter_deviation": (0.1, 0.5),
    "restitution_deviation": (0.3, 0.5),
    "correlation_critical_angle_frequency_parameter": (0.0, 0.4),
    "correlation_critical_angle_restitution": (0.0, 0.4),
    "correlation_frequency_parameter_restitution": (0.0, 0.4),
    "lapse": (0.03, 1.0),
    "group_deviation": (0.15, 0.7),
}
# Coefficient of variation of alpha_c and p by the size of a block, whose edges are rounded and
# whose base is uneven.
_BY_SIZE = 0.05
# Standard deviation of a parameter that is known exactly: a normal density needs one above 0.
_LEAST_WIDTH = 1e-3
_DOMAINS = {
    "critical_angle": RIGHT_ANGLE,
    "frequency_parameter": POSITIVE,
    "restitution": Domain("greater than 0 and less than 1", lambda x: (x > 0) & (x < 1), 0.5),
}


class Prior(NamedTuple):
    """Means and standard deviations of the unbounded parameters, which are independent."""

    mean: Population
    width: Population


def make_prior(prior: PriorLike | None) -> Prior:
    """Make the prior from the known parameters of a block; see `fit_outcomes`.

    Raises
    ------
    ValueError
        If a name, a median or a coefficient of variation is not allowed.
    """
    table = dict(_USUAL)
    for name, (median, variation) in _list_known(prior).items():
        width = math.sqrt(math.log1p(variation**2))
        if name == "restitution":
            width = variation / (1 - median)  # of the logit, to first order
        table[name] = median, max(width, _LEAST_WIDTH)
    means = {name: _transform(name, median) for name, (median, _) in table.items()}
    widths = {name: width for name, (_, width) in table.items()}
    mean, width = (
        Population(**{name: as_array(np.asarray(value)) for name, value in values.items()})
        for values in (means, widths)
    )
    return Prior(mean, width)


def _transform(name: str, value: float) -> float:
    """Transform a parameter to the unbounded one of `make_population`."""
    if name in FRACTIONS:
        return float(logit(value))
    return math.atanh(value) if name.startswith("correlation") else math.log(value)


def _list_known(prior: PriorLike | None) -> dict[str, tuple[float, float]]:
    """List medians and coefficients of variation of known parameters, by name."""
    if prior is None:
        return {}
    if isinstance(prior, Block):
        if np.ndim(prior.critical_angle):
            shape = np.shape(prior.critical_angle)
            raise ValueError(f"prior must be a single block, got shape {shape}")
        return {name: (float(getattr(prior, name)), _BY_SIZE) for name in NAMES[:2]}
    if isinstance(prior, FreeRockingFit):
        values = {name: float(getattr(prior, name)) for name in NAMES}
        errors = {name: float(prior.standard_errors[name]) / values[name] for name in NAMES}
        return {name: (values[name], e) for name, e in errors.items() if math.isfinite(e)}
    if not isinstance(prior, Mapping):
        raise ValueError(
            "prior must be a Block, a FreeRockingFit, or a mapping of names to medians and"
            f" coefficients of variation, got {describe(prior)}"
        )
    known = {}
    for name, pair in prior.items():
        as_name("name in prior", name, NAMES)
        values = np.asarray(as_real(f"prior of {name}", pair), float)
        if values.shape != (2,):
            raise ValueError(
                f"prior of {name} must be a median and a coefficient of variation, got"
                f" {describe(pair)}"
            )
        check(f"median of {name} in prior", values[0], _DOMAINS[name])
        check(f"coefficient of variation of {name} in prior", values[1], NON_NEGATIVE)
        known[name] = float(values[0]), float(values[1])
    return known
