"""Free rocking as a function of few numbers, and the numbers that fit measurements best.

The numbers, in the order of `NUMBERS`: time of the first impact; launch ratio x, velocity after it
over the critical one, as log(artanh(x)), in which durations are nearly linear; logarithms of
C, p and alpha_c; and by how much C changes from the largest impact to the smallest.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from typing_extensions import TypeAliasType

from ..block import Block
from ..resonance import RockingModel
from ..validation import Booleans, Reals

NUMBERS = "first_impact", "launch_ratio", "restitution", "frequency_parameter", "critical_angle"
TIME, LAUNCH, RESTITUTION, FREQUENCY, ANGLE, CHANGE = range(6)
_FREQUENCIES = 33  # that are tried where p is not known
_SHORTEST, _LONGEST = 0.02, 6.0  # half of the longest half-cycle times p that is tried
_MAX_STEPS = 60
_ARRIVED = 0.01  # standard errors from the least squares
_LARGEST = 0.999999  # velocity ratio: from 1 on there is no next impact


# Measurements are in NumPy where they are concrete, which compiles nothing.
Values = TypeAliasType("Values", Float[Array | np.ndarray, "..."])
Flags = TypeAliasType("Flags", Bool[Array | np.ndarray, "..."])
Places = TypeAliasType("Places", Int[Array | np.ndarray, "..."])


class Measured(eqx.Module):
    """Measurements, and which of them count."""

    times: Values
    time_counts: Flags
    impacts: Places  # which one each time belongs to, from 0 on
    peaks: Values
    peak_counts: Flags
    arcs: Places  # the number of the impact before each peak
    room: int = eqx.field(static=True)  # for impacts


class Noises(eqx.Module):
    """Standard deviations of times [s] and of rotations [rad], and which of them are known."""

    times: Values
    rotations: Values
    known: tuple[bool, bool] = eqx.field(static=True)


class Known(eqx.Module):
    """What is given: a block of the right shape, the numbers known, and which ones are free."""

    shape: Block
    numbers: Values
    free: Flags


class Fitted(NamedTuple):
    """The best numbers, and there the residuals over their noises and their Jacobian.

    And the amplitudes of impacts, over their range and about their mean, on which C may depend.
    """

    numbers: Reals
    residuals: Reals
    jacobian: Reals
    amplitudes: Reals
    converged: Booleans


def velocity_ratios(numbers: Reals, amplitudes: Reals) -> Reals:
    """Launch velocities over the critical one, after each impact."""
    launch = jnp.tanh(jnp.exp(numbers[LAUNCH]))
    changing = jnp.exp(numbers[RESTITUTION]) + numbers[CHANGE] * amplitudes[1:]
    shares = jnp.cumprod(jnp.maximum(changing, 1e-6))
    ratios = launch * jnp.concatenate([jnp.ones_like(shares[:1]), shares])
    return jnp.minimum(ratios, _LARGEST)


def dimensionless_durations(model: RockingModel, shape: Block, ratios: Reals) -> Reals:
    """Half-cycle durations times p."""
    velocities = ratios * model.critical_velocity(shape)
    return model.half_cycle_duration(shape, velocities) * shape.frequency_parameter


def residuals(
    numbers: Reals,
    amplitudes: Reals,
    measured: Measured,
    noises: Noises,
    shape: Block,
    model: RockingModel,
) -> Reals:
    """What is computed less what is measured, over the noise; of times, then of peaks."""
    ratios = velocity_ratios(numbers, amplitudes)
    durations = dimensionless_durations(model, shape, ratios) * jnp.exp(-numbers[FREQUENCY])
    sums = jnp.concatenate([jnp.zeros_like(durations[:1]), jnp.cumsum(durations)])
    late = numbers[TIME] + sums[measured.impacts] - measured.times
    velocities = ratios[measured.arcs] * model.critical_velocity(shape)
    rotations = model.peak_rotation(shape, velocities) / shape.critical_angle
    high = rotations * jnp.exp(numbers[ANGLE]) - measured.peaks
    late = jnp.where(measured.time_counts, late / noises.times, 0)
    return jnp.concatenate([late, jnp.where(measured.peak_counts, high / noises.rotations, 0)])


@eqx.filter_jit
def fitted(measured: Measured, known: Known, noises: Noises, model: RockingModel) -> Fitted:
    """The best numbers for each of several sets of measurements, along the first axis."""
    return jax.vmap(lambda m, k: _fitted(m, k, noises, model))(measured, known)


def _fitted(measured: Measured, known: Known, noises: Noises, model: RockingModel) -> Fitted:
    import optimistix  # which loads slowly

    start = _start(measured, known, noises, model)
    amplitudes = _amplitudes(start, measured)

    def at(numbers: Reals, _: Any) -> Reals:
        held = jnp.where(known.free, numbers, jax.lax.stop_gradient(numbers))
        return residuals(held, amplitudes, measured, noises, known.shape, model)

    tolerance = float(jnp.finfo(start.dtype).eps) ** 0.375
    solver = optimistix.LevenbergMarquardt(rtol=tolerance, atol=tolerance)
    found = optimistix.least_squares(at, solver, start, max_steps=_MAX_STEPS, throw=False)
    left, jacobian = at(found.value, None), jax.jacfwd(at)(found.value, None)
    converged = _is_least(left, jacobian, measured, known, noises)
    return Fitted(found.value, left, jacobian, amplitudes, converged)


def rounding_of(dtype: Any) -> float:
    """Part of a measurement below which no misfit is looked at."""
    return max(8 * float(jnp.finfo(dtype).eps), 1e-10)


def _is_least(
    left: Reals, jacobian: Reals, measured: Measured, known: Known, noises: Noises
) -> Booleans:
    """Whether a further Gauss-Newton step is far below the standard errors, or rounding.

    The search itself goes on to its last step where rounding hides that it has arrived.
    """
    scale = jnp.sqrt(jnp.sum(jacobian**2, axis=0))
    held = jnp.diag(jnp.where(known.free, 0, jnp.ones_like(scale)))
    scaled = jacobian / jnp.where(scale > 0, scale, 1)[None]
    directions = jnp.linalg.qr(jnp.concatenate([scaled, held]))[0][: left.size]
    counts = jnp.sum(measured.time_counts) + jnp.sum(measured.peak_counts)
    freedom = jnp.maximum(counts - jnp.sum(jnp.asarray(known.free)), 1).astype(left.dtype)
    extent = jnp.max(jnp.abs(measured.times)) / noises.times
    if measured.peaks.size:
        extent = jnp.maximum(extent, jnp.max(measured.peaks) / noises.rotations)
    rounding = rounding_of(left.dtype) * extent * jnp.sqrt(counts.astype(left.dtype))
    # Measurements may be better than a noise that is known.
    sigma = jnp.sqrt(jnp.sum(left**2) / freedom)
    sigma = jnp.maximum(sigma, 1) if any(noises.known) else sigma
    least = _ARRIVED * sigma + rounding
    return jnp.sqrt(jnp.sum((left @ directions) ** 2)) <= least


def _amplitudes(numbers: Reals, measured: Measured) -> Reals:
    """Velocities before all impacts that matter, over their range and about their mean."""
    ratios = velocity_ratios(numbers, jnp.zeros(measured.room, numbers.dtype))
    last = jnp.maximum(
        jnp.max(jnp.where(measured.time_counts, measured.impacts, 0)),
        jnp.max(jnp.where(measured.peak_counts, measured.arcs + 1, 0), initial=0),
    )
    number = jnp.arange(ratios.size)
    matters = (number > 0) & (number < last)
    before = jnp.concatenate([ratios[:1], ratios[:-1]])
    mean = jnp.sum(jnp.where(matters, before, 0)) / jnp.maximum(jnp.sum(matters), 1).astype(
        ratios.dtype
    )
    extent = ratios[0] - ratios[jnp.maximum(last - 2, 0)]
    wide = extent > 0
    return jnp.where(matters & wide, (before - mean) / jnp.where(wide, extent, 1), 0)


def _start(measured: Measured, known: Known, noises: Noises, model: RockingModel) -> Reals:
    """Numbers to begin with: a line through log(x) of all half-cycles, linearized.

    Of durations tanh(p duration / 2) = x, of peaks 1 - (1 - peak / alpha_c)^2 = x^2, and the
    line falls by log(C) from each to the next. Where p is not known, the best of several.
    """
    times, impacts, counts = measured.times, measured.impacts, measured.time_counts
    place = jnp.arange(times.size)
    last = jax.lax.cummax(jnp.where(counts, place, -1))
    before = jnp.concatenate([jnp.full_like(last[:1], -1), last[:-1]])
    there = jnp.maximum(before, 0)
    whole = counts & (before >= 0) & (impacts - impacts[there] == 1)
    durations = jnp.where(whole, times - times[there], 0)
    longest = jnp.max(durations, initial=0)
    longest = jnp.where(longest > 0, longest, 1)
    first = times[jnp.argmax(counts)]
    angle = jnp.exp(known.numbers[ANGLE])
    square = 1 - (1 - jnp.clip(measured.peaks / angle, 1e-6, 0.999)) ** 2

    def line(log_p: Reals) -> Reals:
        arcs = jnp.clip(jnp.exp(log_p) * durations, 1e-9, 2 * _LONGEST)
        timed = jnp.where(whole, jnp.sinh(jnp.minimum(arcs, 3.0)) ** 2, 0)
        # Peaks count where there are no times.
        high = jnp.where(jnp.any(whole) | ~measured.peak_counts, 0, square**2)
        weight = jnp.concatenate([timed, high])
        number = jnp.concatenate([impacts[there], measured.arcs]).astype(weight.dtype)
        log_x = jnp.concatenate([jnp.log(jnp.tanh(arcs / 2)), 0.5 * jnp.log(square)])
        total = jnp.sum(weight)
        middle, height = jnp.sum(weight * number) / total, jnp.sum(weight * log_x) / total
        spread = jnp.sum(weight * (number - middle) ** 2)
        slope = jnp.sum(weight * (number - middle) * (log_x - height)) / spread
        slope = jnp.clip(jnp.where(spread > 0, slope, -0.1), -3.0, -1e-3)
        x = jnp.exp(jnp.clip(height - slope * middle, -12.0, -1e-4))
        guess = jnp.stack([first, jnp.log(jnp.arctanh(x)), slope, log_p, *known.numbers[4:]])
        return jnp.where(known.free, guess, known.numbers).at[FREQUENCY].set(log_p)

    constant = jnp.zeros(measured.room, times.dtype)
    tried = jnp.geomspace(_SHORTEST, _LONGEST, _FREQUENCIES, dtype=times.dtype)
    free = known.free[FREQUENCY]
    tried = jnp.where(free, jnp.log(2 * tried / longest), known.numbers[FREQUENCY])
    guesses = jax.vmap(line)(tried)

    def misfit(guess: Reals) -> Reals:
        return jnp.sum(residuals(guess, constant, measured, noises, known.shape, model) ** 2)

    misfits = jax.vmap(misfit)(guesses)
    best = guesses[jnp.argmin(jnp.where(jnp.isnan(misfits), jnp.inf, misfits))]
    # The critical angle of a body of which nothing is known: by the largest peak.
    ratios = velocity_ratios(best, constant)[measured.arcs]
    rotations = 1 - jnp.sqrt((1 - ratios) * (1 + ratios))
    rotations = jnp.where(measured.peak_counts, rotations, 0)
    fits = known.free[ANGLE] & jnp.any(rotations > 0)
    square = jnp.sum(rotations**2)
    scale = jnp.sum(rotations * measured.peaks) / jnp.where(fits, square, 1)
    angle = jnp.where(fits, jnp.log(jnp.where(fits, scale, 1)), best[ANGLE])
    return best.at[ANGLE].set(angle)
