"""Free rocking as a function of few parameters, fitted to measurements of it.

The parameters, in the order of `PARAMETERS`: time of the first impact [s]; launch ratio x, the
velocity after that impact over the critical one, as log(artanh(x)); logarithms of C, p and
alpha_c. The last column of each Jacobian belongs to a change of C with the velocity before an
impact: C of the largest impact minus C of the smallest, over C.

Logarithms have no bounds, so that a motion exists after every step of the search. The
linearized half-cycle lasts 2 artanh(x) / p (Housner 1963, 10.1785/BSSA0530020403): its
logarithm is linear in the logarithms of artanh(x) and p, so that the problem is nearly linear.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int
from typing_extensions import TypeAliasType

from ..block import Block
from ..resonance import RockingModel
from ..validation import Reals

Values = TypeAliasType("Values", Float[np.ndarray, "..."])

# The reason why no argument of a fit may be traced.
OUTSIDE = "a fit searches on the host"
PARAMETERS = (
    "first_impact",
    "launch_ratio",
    "restitution",
    "frequency_parameter",
    "critical_angle",
)
TIME, LAUNCH, RESTITUTION, FREQUENCY, ANGLE, CHANGE = range(6)
_ROOM = 128  # number of half-cycles in a program, which serves any number of them
_LARGEST = 0.999999  # largest velocity ratio: from 1 on there is no next impact
_LARGEST_CONDITION = 1e8  # of a Jacobian with columns of length 1
_TOLERANCE = 1e-12  # relative change of parameters and sums of squares at which a search ends
# Values of p that are tried if p is not known, by half of the longest half-cycle times p. The
# tanh of this number is the launch ratio of linearized rocking: from 0.02 to nearly 1, in
# steps of 20 %.
_HALF_ARCS = np.geomspace(0.02, 6.0, 33)


class Measurements(NamedTuple):
    """Times of impacts, peaks between them, NaN where unknown, and their numbering."""

    times: Float[np.ndarray, " impacts"]
    peaks: Float[np.ndarray, " half_cycles"]
    impacts: Int[np.ndarray, " impacts"]  # the number of each impact, from 0 on
    used: Bool[np.ndarray, " impacts"]

    @property
    def successive(self) -> Bool[np.ndarray, " half_cycles"]:
        """Which impacts are followed by the next one."""
        return self.used[1:] & self.used[:-1] & (np.diff(self.impacts) == 1)

    @property
    def peaked(self) -> Bool[np.ndarray, " half_cycles"]:
        """Which peaks count: the half-cycle of all others is not known."""
        return self.successive & ~np.isnan(self.peaks)


class Noises(NamedTuple):
    """Standard deviations of times [s] and of rotations [rad], and which of them are known."""

    times: float
    rotations: float
    known: tuple[bool, bool]


class Known(NamedTuple):
    """The given data: model, a block of the right shape, parameters, and which are free."""

    model: RockingModel
    shape: Block  # in the precision in which the motion is computed
    parameters: Float[np.ndarray, "5"]
    free: Bool[np.ndarray, "5"]

    @property
    def dtype(self) -> np.dtype:
        """The precision in which the motion is computed."""
        return self.shape.half_width.dtype

    def set_free(self, place: int, free: bool) -> "Known":
        """Return a copy in which one parameter is fitted or held."""
        flags = self.free.copy()
        flags[place] = free
        return self._replace(free=flags)


class HalfCycles(NamedTuple):
    """Durations times p, peaks over alpha_c, and their derivatives along the log of the ratio."""

    durations: Values
    rotations: Values
    duration_slopes: Values
    rotation_slopes: Values


@jax.jit
def _compute_half_cycles(
    model: RockingModel, shape: Block, log_ratios: Reals
) -> tuple[Reals, ...]:
    def compute(log_ratios: Reals) -> tuple[Reals, Reals]:
        velocities = jnp.exp(log_ratios) * model.critical_velocity(shape)
        durations = model.half_cycle_duration(shape, velocities)
        rotations = model.peak_rotation(shape, velocities)
        return durations * shape.frequency_parameter, rotations / shape.critical_angle

    # Each quantity depends on its own ratio only: one tangent of ones gives all derivatives.
    values, slopes = jax.jvp(compute, (log_ratios,), (jnp.ones_like(log_ratios),))
    return *values, *slopes


def compute_half_cycles(known: Known, log_ratios: Values) -> HalfCycles:
    """Compute half-cycles after launches at some velocities over the critical one.

    They are in units of the block, and do not depend on p and alpha_c: a fit of p and alpha_c
    uses the same program.
    """
    room = -(-log_ratios.size // _ROOM) * _ROOM
    # The rest is filled with copies, whose motion exists.
    padded = np.resize(log_ratios, room).astype(known.dtype)
    columns = _compute_half_cycles(known.model, known.shape, padded)
    return HalfCycles(*(np.asarray(c)[: log_ratios.size].astype(float) for c in columns))


def compute_log_ratio(launch: Values) -> tuple[Values, Values]:
    """Compute log(x) of log(artanh(x)), and its derivative."""
    growth = np.exp(launch)
    ratio = np.minimum(np.tanh(growth), _LARGEST)
    return np.log(ratio), growth * (1 - ratio**2) / ratio


def compute_values(parameters: Float[np.ndarray, "5"]) -> tuple[dict[str, float], Values]:
    """Compute the parameters themselves by their names, and derivatives of them."""
    growth = np.exp(parameters[LAUNCH])
    exponentials = np.exp(parameters[RESTITUTION:])
    values = [parameters[TIME], np.tanh(growth), *exponentials]
    slopes = np.array([1.0, growth * (1 - values[LAUNCH] ** 2), *exponentials])
    return dict(zip(PARAMETERS, values, strict=True)), slopes


def compute_residuals(
    parameters: Float[np.ndarray, "5"], measured: Measurements, known: Known, noises: Noises
) -> tuple[Float[np.ndarray, " measurements"], Float[np.ndarray, "measurements 6"]]:
    """Compute residuals over the noise, of times, then of peaks, and their Jacobian.

    Residuals are computed minus measured.
    """
    number = np.arange(measured.impacts[-1])
    launch, slope = compute_log_ratio(parameters[LAUNCH : LAUNCH + 1])
    log_ratios = launch + number * parameters[RESTITUTION]
    # Derivatives of the logarithms of all ratios. A change of C is linear in the velocity
    # before an impact. The mean velocity is subtracted, and the rest divided by the range, so
    # that the change is nearly independent of C itself.
    along = np.zeros((number.size, 6))
    along[:, LAUNCH] = slope
    along[:, RESTITUTION] = number
    before = np.exp(log_ratios[:-1])
    extent = np.ptp(before) if before.size > 1 else 0.0
    if extent > 0:
        along[1:, CHANGE] = np.cumsum((before - before.mean()) / extent)
    motion = compute_half_cycles(known, log_ratios)
    unit = np.exp(-parameters[FREQUENCY])
    angle = np.exp(parameters[ANGLE])
    # An impact comes after the half-cycles before it.
    times = np.append(0, np.cumsum(motion.durations)) * unit
    time_slopes = np.cumsum(motion.duration_slopes[:, None] * along * unit, axis=0)
    time_slopes = np.concatenate([np.zeros((1, 6)), time_slopes])
    time_slopes[:, TIME] = 1
    time_slopes[:, FREQUENCY] = -times
    peak_slopes = motion.rotation_slopes[:, None] * along * angle
    peak_slopes[:, ANGLE] = motion.rotations * angle
    used = measured.used
    peaked = measured.peaked
    impacts = measured.impacts[used]
    arcs = measured.impacts[:-1][peaked]
    late = parameters[TIME] + times[impacts] - measured.times[used]
    high = motion.rotations[arcs] * angle - measured.peaks[peaked]
    residuals = [late / noises.times, high / noises.rotations]
    jacobian = [time_slopes[impacts] / noises.times, peak_slopes[arcs] / noises.rotations]
    return np.concatenate(residuals), np.concatenate(jacobian)


class Fitted(NamedTuple):
    """The best parameters, with the residuals over the noises and their Jacobian."""

    measured: Measurements
    known: Known
    noises: Noises
    parameters: Float[np.ndarray, "5"]
    residuals: Float[np.ndarray, " measurements"]
    jacobian: Float[np.ndarray, "measurements 6"]
    converged: bool

    @property
    def squares(self) -> float:
        """The sum of the squares of the residuals."""
        return float(np.sum(self.residuals**2))

    @property
    def free_jacobian(self) -> Float[np.ndarray, "measurements free"]:
        """The columns of the parameters that are fitted."""
        return self.jacobian[:, np.flatnonzero(self.known.free)]

    @property
    def freedom(self) -> int:
        """The number of measurements minus the number of fitted parameters."""
        return self.residuals.size - int(self.known.free.sum())


def fit_parameters(measured: Measurements, known: Known, noises: Noises) -> Fitted:
    """Fit the free parameters by least squares, after Levenberg and Marquardt."""
    from scipy.optimize import least_squares  # which loads slowly

    def set_parameters(values: Values) -> Values:
        parameters = known.parameters.copy()
        parameters[known.free] = values
        return parameters

    @functools.lru_cache(maxsize=1)  # SciPy asks for the Jacobian after the residuals
    def evaluate(*values: float) -> tuple[Values, Values]:
        return compute_residuals(set_parameters(np.array(values)), measured, known, noises)

    # Trial steps may reach blocks that overturn, whose residuals are not finite.
    with np.errstate(all="ignore"):
        result = least_squares(
            lambda values: evaluate(*values)[0],
            _choose_start(measured, known)[known.free],
            jac=lambda values: evaluate(*values)[1][:, :5][:, known.free],  # pyright: ignore[reportArgumentType]
            method="lm",
            x_scale="jac",
            ftol=_TOLERANCE,
            xtol=_TOLERANCE,
            gtol=_TOLERANCE,
        )
    parameters = set_parameters(result.x)
    residuals, jacobian = compute_residuals(parameters, measured, known, noises)
    converged = result.success and bool(np.isfinite(jacobian).all())
    return Fitted(measured, known, noises, parameters, residuals, jacobian, converged)


def _choose_start(measured: Measurements, known: Known) -> Float[np.ndarray, "5"]:
    """Choose initial parameters by a line through log(x) of all half-cycles, linearized.

    There tanh(p duration / 2) = x, and the line falls by log(C) from each half-cycle to the
    next. Weights are reciprocals of the variances of log(x), by the delta method from equal
    variances of all durations.
    Only the curvature of the durations depends on p: each trial value of p has its own line.
    """
    parameters = known.parameters.copy()
    whole = measured.successive
    number = measured.impacts[:-1][whole]
    durations = np.diff(measured.times)[whole]
    frequencies = np.exp(parameters[FREQUENCY : FREQUENCY + 1])
    if known.free[FREQUENCY]:
        frequencies = 2 * _HALF_ARCS / durations.max(initial=1e-9)
    arcs = np.minimum(frequencies[:, None] * durations, 2 * _HALF_ARCS[-1])
    log_x = np.log(np.tanh(arcs / 2))
    # The derivative of log(tanh(arc / 2)) is 1 / sinh(arc). Beyond 3 the weight is constant:
    # otherwise a half-cycle near overturning would decide alone.
    weights = (np.sinh(np.minimum(arcs, 3.0)) / frequencies[:, None]) ** 2
    total = np.maximum(np.sum(weights, axis=1, keepdims=True), np.finfo(float).tiny)
    middle = np.sum(weights * number, axis=1, keepdims=True) / total
    height = np.sum(weights * log_x, axis=1, keepdims=True) / total
    spread = np.sum(weights * (number - middle) ** 2, axis=1, keepdims=True)
    slope = np.sum(weights * (number - middle) * (log_x - height), axis=1, keepdims=True)
    # One half-cycle has no slope: then C is taken as about 0.9. C is held between 0.05 and
    # 0.999, and x below 1, so that a motion exists.
    slope = np.clip(np.where(spread > 0, slope / spread, -0.1), -3.0, -1e-3)
    misfit = np.sum(weights * (log_x - height - slope * (number - middle)) ** 2, axis=1)
    best = np.argmin(misfit)
    x = np.exp(np.clip(height - slope * middle, -12.0, -1e-4))[best, 0]
    parameters[TIME] = measured.times[measured.used][0]
    parameters[LAUNCH] = np.log(np.arctanh(x))
    parameters[RESTITUTION] = slope[best, 0]
    parameters[FREQUENCY] = np.log(frequencies[best])
    if known.free[ANGLE]:
        # Peaks are proportional to the critical angle: linear least squares, by the linearized
        # rotation 1 - sqrt(1 - x^2), the only model that is allowed without a block.
        peaked = measured.peaked
        ratios = x * np.exp(measured.impacts[:-1][peaked] * slope[best, 0])
        rotations = 1 - np.sqrt((1 - ratios) * (1 + ratios))
        scale = np.sum(rotations * measured.peaks[peaked]) / np.sum(rotations**2)
        parameters[ANGLE] = np.log(scale)
    return parameters


def compute_covariance(jacobian: Float[np.ndarray, "measurements free"]) -> Values:
    """Compute the covariance of parameters fitted to residuals of standard deviation 1.

    It is NaN if the residuals do not determine all of them.
    """
    # The Jacobian itself is factored, with columns of length 1: the normal matrix would square
    # its condition number, and lose the error of a p that has little effect.
    scale = np.linalg.norm(jacobian, axis=0)
    scaled = jacobian / np.maximum(scale, np.finfo(float).tiny)
    if not (np.isfinite(jacobian).all() and np.linalg.cond(scaled) < _LARGEST_CONDITION):
        return np.full((scale.size, scale.size), np.nan)
    inverse = np.linalg.pinv(scaled) / scale[:, None]
    return inverse @ inverse.T
