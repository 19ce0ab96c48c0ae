"""The size and shape of a block from what else is known of a rigid body."""

import jax.numpy as jnp
import numpy as np

from .validation import (
    AT_LEAST_ONE,
    NON_NEGATIVE,
    POSITIVE,
    RIGHT_ANGLE,
    AnyArray,
    Number,
    Reals,
    check,
    elementwise,
)

_Real = AnyArray | np.floating

# kappa of a homogeneous rectangle; its reciprocal rounds to 0.75 in every precision.
RECTANGLE_INERTIA_RATIO = 4 / 3


def fraction_in_centre(inertia_ratio: Reals) -> Reals:
    """Compute 1 / kappa: which fraction of the inertia the mass has in its centre."""
    # A plain reciprocal XLA merges with the next quotient, which rounds otherwise than 0.75
    # does.
    return 0.75 * (RECTANGLE_INERTIA_RATIO / inertia_ratio)


@elementwise(
    frequency_parameter=POSITIVE,
    critical_angle=RIGHT_ANGLE,
    gravity=POSITIVE,
    inertia_ratio=AT_LEAST_ONE,
)
def compute_size(
    frequency_parameter: Number, critical_angle: Number, gravity: Number, inertia_ratio: Number
) -> tuple[Reals, Reals]:
    """Compute half-width and slenderness from measured parameters."""
    fraction = fraction_in_centre(jnp.asarray(inertia_ratio))
    half_diagonal = fraction * gravity / jnp.square(frequency_parameter)
    return half_diagonal * jnp.sin(critical_angle), 1 / jnp.tan(critical_angle)


def resolve_size(
    frequency_parameter: Number, critical_angle: Number, gravity: Number, inertia_ratio: Number
) -> tuple[_Real, _Real]:
    """Compute half-width and slenderness as `compute_size` does, in NumPy from NumPy.

    Raises
    ------
    ValueError
        If a concrete value is out of range. A traced one gives NaN.
    """
    numbers = (frequency_parameter, critical_angle, gravity, inertia_ratio)
    if not is_of_numpy(*numbers):
        return compute_size(*numbers)
    frequency, angle, acceleration, ratio = map(np.asarray, numbers)
    check("critical_angle", angle, RIGHT_ANGLE)
    check("frequency_parameter", frequency, POSITIVE)
    half_diagonal = acceleration / (ratio * np.square(frequency))
    return half_diagonal * np.sin(angle), 1 / np.tan(angle)


def compute_dynamics(
    half_width: _Real, slenderness: _Real, gravity: _Real, inertia_ratio: _Real
) -> tuple[_Real, _Real]:
    """Compute critical angle [rad] and frequency parameter [1/s], in NumPy from NumPy."""
    on_host = is_of_numpy(half_width, slenderness, gravity, inertia_ratio)
    library = np if on_host else jnp
    half_diagonal = half_width * library.sqrt(1 + slenderness**2)
    squared_frequency = gravity / (inertia_ratio * half_diagonal)
    return library.arctan2(1.0, slenderness), library.sqrt(squared_frequency)


def is_of_numpy(*numbers: object) -> bool:
    """Return whether all numbers are of NumPy, so that nothing is compiled for them."""
    return all(isinstance(number, np.ndarray | np.generic) for number in numbers)


@elementwise(
    half_width=POSITIVE,
    centre_height=POSITIVE,
    mass=POSITIVE,
    inertia_about_centre=NON_NEGATIVE,
)
def compute_shape(
    half_width: Number, centre_height: Number, mass: Number, inertia_about_centre: Number
) -> tuple[Reals, Reals]:
    """Compute slenderness and inertia ratio from the mass and inertia of a body."""
    square = jnp.square(half_width) + jnp.square(centre_height)
    about_centre = jnp.asarray(inertia_about_centre) / (mass * square)
    return jnp.divide(centre_height, half_width), 1 + about_centre
