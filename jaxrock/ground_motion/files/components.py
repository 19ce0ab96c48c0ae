"""Components of ground motions as they stand in files, and the records that they make."""

import math
from typing import Literal, NamedTuple

import numpy as np

from ..drift import warn_of_drift
from ..record import Record
from ..units import require_unit as require_unit

Direction = Literal["level", "up", "down", ""]


class Component(NamedTuple):
    """A row of accelerations."""

    # For errors.
    name: str
    # Unit of the values [m/s2].
    factor: float
    # As they stand in the file, shape (samples,).
    values: np.ndarray
    # Time step [s].
    step: float
    # Where it points, empty if the file does not say so.
    direction: Direction = ""
    # Its name in the file, empty if there is only one.
    channel: str = ""


def make_record(horizontal: Component, *upward: Component) -> Record:
    """Make the record of one or two components; a `ValueError` if they do not fit together.

    A warning says if the peak ground velocity is due to a drift.
    """
    name, _, values, step = horizontal[:4]
    for other in upward:
        if other.values.size != values.size:
            samples = f"{other.name} has {other.values.size} samples"
            raise ValueError(f"{samples}, but {name} has {values.size}")
        if not math.isclose(other.step, step, rel_tol=1e-6):
            raise ValueError(
                f"{other.name} has a step of {other.step} s, but {name} of {step} s"
            )
    # What overflows is inf, which the record refuses.
    with np.errstate(over="ignore"):
        accelerations, *upwards = (
            component.factor * component.values for component in (horizontal, *upward)
        )
    try:
        record = Record(accelerations, step, *upwards)
    # Too few samples, or accelerations too large for the precision of JAX.
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from error
    warn_of_drift(name, record)
    return record


def require_upward(component: Component) -> Component:
    """Return a vertical component; a `ValueError` if it is known to point elsewhere."""
    if component.direction == "down":
        raise ValueError(
            f"{component.name} points downward by its name or header, but a vertical component"
            " must be positive upward: give its values times -1 as Record(vertical=)"
        )
    if component.direction == "level":
        raise ValueError(f"{component.name} is horizontal, a vertical component was expected")
    return component
