"""What fitted numbers are worth: covariance, a constant C or not, C of each impact."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from ..block import Block
from ..resonance import RockingModel
from ..validation import Booleans, Reals
from .least_squares import (
    ANGLE,
    CHANGE,
    FREQUENCY,
    LAUNCH,
    RESTITUTION,
    TIME,
    Fitted,
    Known,
    Measured,
    Noises,
    dimensionless_durations,
    velocity_ratios,
)

_NEWTON = 8  # steps to the velocity that a duration or a peak belongs to
_LEAST_FREEDOM = 0.1  # of the residuals of one kind
_LEAST_FACTOR = 1e-3  # by which a noise changes at once


class Summary(NamedTuple):
    """What `FreeRockingFit` says of numbers, and the variance of a residual over its noise."""

    values: Reals
    covariance: Reals
    variance: Reals
    freedom: Reals
    restitution_change: Reals
    restitution_change_error: Reals
    restitution_change_p_value: Reals
    frequency_p_value: Reals
    velocity_ratios: Reals
    restitutions: Reals
    restitution_errors: Reals


@eqx.filter_jit
def reestimated(measured: Measured, known: Known, fits: Fitted, noises: Noises) -> Noises:
    """Noises by the residuals of times and rotations, each with its share of the freedom."""
    jacobian, residuals = jnp.where(known.free[None], fits.jacobian[0], 0), fits.residuals[0]
    directions = jnp.linalg.svd(jacobian, full_matrices=False)[0]
    fitted = jnp.arange(directions.shape[1]) < jnp.sum(known.free)
    leverage = jnp.sum(jnp.where(fitted[None], directions, 0) ** 2, axis=1)
    parts = jnp.split(residuals**2, [measured.times.size])
    shares = jnp.split(1 - leverage, [measured.times.size])
    counts = measured.time_counts, measured.peak_counts
    sizes = []
    for k, size in enumerate((noises.times, noises.rotations)):
        freedom = jnp.maximum(jnp.sum(jnp.where(counts[k], shares[k], 0)), _LEAST_FREEDOM)
        factor = jnp.maximum(jnp.sqrt(jnp.sum(parts[k]) / freedom), _LEAST_FACTOR)
        sizes.append(size if noises.known[k] else size * factor)
    return Noises(sizes[0], sizes[1], noises.known)


@eqx.filter_jit
def summary(
    measured: Measured,
    known: Known,
    fits: Fitted,
    noises: Noises,
    model: RockingModel,
    noise_known: bool,
) -> Summary:
    """Of fits with a constant C, with one that changes, and with a free p."""
    third = min(2, fits.converged.size - 1)  # not looked at where p is free anyway
    constant, changing, tuned = (jax.tree.map(lambda x, k=k: x[k], fits) for k in (0, 1, third))
    free, numbers = jnp.asarray(known.free), constant.numbers
    counts = jnp.sum(measured.time_counts) + jnp.sum(measured.peak_counts)
    freedom = (counts - jnp.sum(free)).astype(numbers.dtype)
    one, nothing = jnp.ones_like(freedom), jnp.full_like(freedom, jnp.nan)
    variance = one if noise_known else _mean_square(constant, freedom)

    launch = jnp.exp(numbers[LAUNCH])
    rest = jnp.exp(numbers[RESTITUTION : ANGLE + 1])
    values = jnp.concatenate([jnp.stack([numbers[TIME], jnp.tanh(launch)]), rest])
    slopes = jnp.concatenate([jnp.stack([one, launch / jnp.cosh(launch) ** 2]), rest])
    covariance = _covariance(constant, free)[:5, :5] * variance * slopes[:, None] * slopes[None]

    # A further number needs a further measurement, and a change impacts that differ.
    changes = (freedom > 1) & jnp.any(changing.amplitudes != 0)
    spare = (freedom > 1) & ~free[FREQUENCY] & free[TIME]
    square = one if noise_known else _mean_square(changing, freedom - 1)
    error = jnp.sqrt(_covariance(changing, free.at[CHANGE].set(True))[CHANGE, CHANGE] * square)
    of_change, of_frequency = (
        _chance(constant, other, freedom - 1, noise_known) for other in (changing, tuned)
    )
    ratios, restitutions, errors = _by_impact(measured, known.shape, numbers, noises, model)
    return Summary(
        values,
        covariance,
        variance,
        freedom,
        jnp.where(changes, changing.numbers[CHANGE], nothing),
        jnp.where(changes, error, nothing),
        jnp.where(changes, of_change, nothing),
        jnp.where(spare, of_frequency, nothing),
        ratios,
        restitutions,
        errors * jnp.sqrt(variance),
    )


def _mean_square(fit: Fitted, freedom: Reals) -> Reals:
    positive = freedom > 0
    return jnp.where(positive, jnp.sum(fit.residuals**2) / jnp.where(positive, freedom, 1), jnp.nan)


def _covariance(fit: Fitted, free: Booleans) -> Reals:
    """Inverse of the normal equations of the free numbers, 0 elsewhere."""
    jacobian = jnp.where(free[None], fit.jacobian, 0)
    scale = jnp.sqrt(jnp.sum(jacobian**2, axis=0))
    scale = jnp.where(scale > 0, scale, 1)
    # With a row of its own for each number that is held.
    held = jnp.diag(jnp.where(free, 0, jnp.ones_like(scale)))
    triangle = jnp.linalg.qr(jnp.concatenate([jacobian / scale[None], held]), mode="r")
    inverse = jax.scipy.linalg.solve_triangular(triangle, jnp.eye(scale.size, dtype=scale.dtype))
    inverse = jnp.where(free[:, None], inverse / scale[:, None], 0)
    return inverse @ inverse.T


def _chance(constant: Fitted, freer: Fitted, freedom: Reals, noise_known: bool) -> Reals:
    """How often one more number lowers the sum of squares as much by chance.

    By Student's distribution, or by the normal one where the noise is known.
    """
    squares = jnp.sum(freer.residuals**2)
    gain = jnp.maximum(jnp.sum(constant.residuals**2) - squares, 0)
    if noise_known:
        return jax.scipy.special.erfc(jnp.sqrt(gain / 2))
    freedom = jnp.maximum(freedom, 1)
    share = squares / (squares + gain + jnp.finfo(gain.dtype).tiny)
    return jax.scipy.special.betainc(freedom / 2, jnp.full_like(share, 0.5), share)


def _by_impact(
    measured: Measured, shape: Block, numbers: Reals, noises: Noises, model: RockingModel
) -> tuple[Reals, Reals, Reals]:
    """Velocity before each impact, C of that impact alone, and its error by the noise."""
    ratios = velocity_ratios(numbers, jnp.zeros(measured.room, numbers.dtype))
    timed = measured.times.size > 1
    if timed:
        counts, impacts = measured.time_counts, measured.impacts
        exists = counts[1:] & counts[:-1] & (jnp.diff(impacts) == 1)
        unit, noise = jnp.exp(-numbers[FREQUENCY]), noises.times
        value, guess = jnp.diff(measured.times) / unit, ratios[impacts[:-1]]
    else:
        exists, unit, noise = measured.peak_counts, jnp.exp(numbers[ANGLE]), noises.rotations
        value, guess = measured.peaks / unit, ratios[measured.arcs]

    def quantity(launch: Reals) -> Reals:
        ratio = jnp.minimum(jnp.tanh(jnp.exp(launch)), 1 - 1e-9)
        if timed:
            return dimensionless_durations(model, shape, ratio)
        velocity = ratio * model.critical_velocity(shape)
        return model.peak_rotation(shape, velocity) / shape.critical_angle

    def with_slope(launch: Reals) -> tuple[Reals, Reals]:
        return jax.jvp(quantity, (launch,), (jnp.ones_like(launch),))

    start = jnp.log(jnp.arctanh(guess))
    value = jnp.where(exists, value, quantity(start))

    def newton(_: Any, launch: Reals) -> Reals:
        here, slope = with_slope(launch)
        return launch + jnp.clip(here / slope * jnp.log(value / here), -1, 1)

    launch = jax.lax.fori_loop(0, _NEWTON, newton, start)
    _, slope = with_slope(launch)
    width = jnp.exp(launch)
    x = jnp.tanh(width)
    error = width / (jnp.cosh(width) ** 2 * x * slope) * noise / unit  # of log(x)
    both = exists[1:] & exists[:-1]
    restitution = jnp.where(both, x[1:] / x[:-1], jnp.nan)
    first, second = error[:-1], error[1:]
    # Two durations share the time between them, and each has another one besides.
    square = 2 * (first**2 + second**2 + first * second) if timed else first**2 + second**2
    return jnp.where(both, x[:-1], jnp.nan), restitution, restitution * jnp.sqrt(square)
