"""The size and shape of a block from what else is known of a rigid body."""

import jax.numpy as jnp

from .validation import (
    AT_LEAST_ONE,
    NON_NEGATIVE,
    POSITIVE,
    RIGHT_ANGLE,
    Number,
    Reals,
    elementwise,
)

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
