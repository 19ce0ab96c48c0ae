"""Restitution and frequency parameter of a block from a test in which it rocks freely."""

import jax
import numpy as np

from ..block import Block
from ..resonance import Linearized, ModelLike, Nonlinear, RockingModel, as_model
from ..validation import (
    FINITE,
    POSITIVE,
    Number,
    Numbers,
    as_real,
    check,
    check_concrete,
    check_increasing,
    check_kind,
)
from .free_rocking_answer import NEGLIGIBLE, SIGNIFICANT, FreeRockingFit
from .free_rocking_motion import (
    ANGLE,
    CHANGE,
    FREQUENCY,
    LAUNCH,
    OUTSIDE,
    PARAMETERS,
    RESTITUTION,
    Fitted,
    Known,
    Measurements,
    Noises,
    Values,
    compute_covariance,
    compute_half_cycles,
    compute_log_ratio,
    compute_residuals,
    compute_values,
    fit_parameters,
)
from .impact_numbering import number_impacts

_ROUNDS = 6  # rounds in which the noises of times and of rotations are estimated together
# Smallest factor on a noise in a round: an exact fit would make the noise 0, and the weights
# infinite.
_LEAST_FACTOR = 1e-3
# Fewest degrees of freedom of one kind of residuals. If there are only as many peaks as
# parameters that depend on peaks alone, they are fitted exactly, and 0 / 0 would be their noise.
_LEAST_FREEDOM = 0.1
_NEWTON = 8  # Newton's steps to the velocity of a duration or a peak
# Noise over the median half-cycle above which there is no free rocking: random times are off
# by 1 / sqrt(12) = 0.29 of a half-cycle.
_ROUGH = 0.25


def fit_free_rocking(
    impact_times: Numbers,
    block: Block | None = None,
    *,
    peak_rotations: Numbers | None = None,
    model: ModelLike | None = None,
    frequency_known: bool = True,
    time_noise: Number | None = None,
    rotation_noise: Number | None = None,
    repair: bool = True,
) -> FreeRockingFit:
    """Fit the restitution of a block, and if need be p, to a test in which it rocks freely.

    The block is tilted and let go. The times of its impacts are enough, as a microphone or an
    accelerometer beside it records them: the launch velocity after an impact determines when
    the next impact comes, and each launch velocity is C times the previous one. The fit is by
    least squares.

    Parameters
    ----------
    impact_times : array_like, shape (n,)
        Times of successive impacts [s], increasing.
    block : Block, optional
        The block, if it is known. Without it, p is fitted too, and alpha_c if there are peaks
        as well as times. For a one-sided block C is a magnitude, and peaks are positive.
    peak_rotations : array_like, shape (n - 1,), optional
        Largest rotation between each impact and the next [rad], to either side; NaN where
        unknown.
    model : Linearized or Nonlinear, or their names, optional
        Equation of motion. By default nonlinear with a block. Without a block it is always
        linearized, since the nonlinear motion depends on the shape.
    frequency_known : bool
        Whether p is taken from the block. If not, p is fitted, and only the shape is taken.
    time_noise, rotation_noise : float, optional
        Standard deviations of the measured times [s] and peaks [rad], where they are known;
        by default estimated from the residuals.
    repair : bool
        Whether to search for impacts that are missing, counted twice or outliers. The fit
        makes at most four repairs, and a repair only if chance alone would suggest it in less
        than one of a thousand tests.

    Returns
    -------
    FreeRockingFit

    Raises
    ------
    ValueError
        If there are too few measurements, times do not increase or a peak is 0, if an
        argument is traced, if the motion does not decay, or if no free rocking motion is near
        the measurements.

    Notes
    -----
    Errors of times are assumed independent, with a common standard deviation. Standard errors
    come from least squares.

    If the two models differ in C by more than its standard error, `remarks` states the
    difference. For 12 impacts with 1 ms of noise, b = 0.3 m and C = 0.85, this occurs up to a
    slenderness of 15 if the first launch is 0.9 of the critical velocity, and up to 3 if it
    is half of the critical velocity.

    If p is unknown, only the nonlinear dependence of the durations on the rotation shows it.
    For this, the first half-cycles must begin near overturning. For 13 impacts with 1 ms of
    noise, b = 0.1 m, lambda = 5 and C = 0.9, C is known to 0.0003 and p to 0.3 % if the first
    launch is 0.95 of the critical velocity. If it is half of the critical velocity, C is known
    to 0.001 and p to 8 %.

    Examples
    --------
    >>> import jaxrock as jr
    >>> times = [0.0, 0.777, 1.372, 1.861, 2.276, 2.635, 2.948, 3.223, 3.466, 3.683, 3.875, 4.047]
    >>> fit = jr.calibration.fit_free_rocking(times, jr.Block(half_width=0.1, slenderness=5.0))
    >>> print(f"{fit.restitution:.5f} +- {fit.standard_errors['restitution']:.5f}")
    0.89998 +- 0.00002
    """
    times, peaks = _check_measurements(impact_times, peak_rotations, block)
    measured = Measurements(times, peaks, np.arange(times.size), np.full(times.size, True))
    if model is None:
        model = Linearized() if block is None else Nonlinear()
    known = _gather_known(block, measured, as_model(model), frequency_known)
    # The first guess is 1 % of the mean half-cycle and of the largest peak.
    noises = Noises(
        _choose_noise("time_noise", "s", time_noise, np.ptp(times) / times.size),
        _choose_noise("rotation_noise", "rad", rotation_noise, np.nanmax(peaks, initial=0)),
        known=(time_noise is not None, rotation_noise is not None),
    )
    repairs: tuple[str, ...] = ()
    if repair:
        measured, repairs = number_impacts(measured, known, noises)
    # The numbering is settled: from here on peaks count as well. With one kind of measurement
    # the noise only scales the residuals; with both it is the weight between them.
    fit = fit_parameters(measured, known, noises)
    weighted = measured.peaked.any() and not all(noises.known)
    for _ in range(_ROUNDS if weighted else 0):
        fit = fit_parameters(measured, known, _reestimate(fit))
    return _make_free_rocking_fit(fit, block, repairs)


def _check_measurements(
    impact_times: Numbers, peak_rotations: Numbers | None, block: Block | None
) -> tuple[Values, Values]:
    """Check the measurements, and the block; return times and sizes of peaks."""
    if block is not None:
        check_kind("block", block, Block)
    times = as_real("impact_times", impact_times, unit="s")
    unknown = np.full(max(times.size - 1, 0), np.nan)
    given = unknown if peak_rotations is None else peak_rotations
    peaks = as_real("peak_rotations", given, unit="rad")
    check_concrete((times, peaks, block), OUTSIDE)
    if times.ndim != 1 or peaks.shape != unknown.shape:
        raise ValueError(
            "impact_times must be one-dimensional, and peak_rotations have one value less,"
            f" got shapes {times.shape} and {peaks.shape}"
        )
    check("impact_times", times, FINITE)
    check_increasing("impact_times", times)
    least = 0 if block is not None and block.one_sided else -np.pi / 2
    angles = np.asarray(peaks)
    invalid = (angles == 0) | (angles < least) | (angles > np.pi / 2)
    if invalid.any():
        raise ValueError(
            f"peak_rotations must be between {least:.3g} and pi / 2 and not 0, or NaN where"
            f" unknown, got {angles[invalid][0]:g}"
        )
    # The equation is the same on both sides: only the size of a peak matters.
    return np.asarray(times), np.abs(angles)


def _gather_known(
    block: Block | None, measured: Measurements, model: RockingModel, frequency_known: bool
) -> Known:
    """Gather the known parameters, and mark the free ones."""
    if block is None and not isinstance(model, Linearized):
        raise ValueError("block must be given for the nonlinear model, got None")
    peaks = int(measured.peaked.sum())
    # Durations alone do not depend on the critical angle.
    free = np.array([True, True, True, True, block is None and peaks > 0])
    parameters = np.zeros(5)
    if block is not None:
        if np.ndim(block.half_width + block.slenderness):
            raise ValueError("block must be one block, got several")
        free[FREQUENCY] = not frequency_known
        parameters[FREQUENCY] = np.log(float(block.frequency_parameter))
        parameters[ANGLE] = np.log(float(block.critical_angle))
    # The noise can be estimated only if there are more measurements than parameters.
    unknowns = int(free.sum())
    if measured.times.size + peaks <= unknowns:
        raise ValueError(
            f"impact_times must have at least {unknowns + 1 - peaks} values to fit {unknowns}"
            f" parameters, got {measured.times.size}"
        )
    # The linearized equation does not depend on the shape. The arrays have the precision of
    # the measurements, and go to the device at once: one program serves all tests.
    shape = Block(0.2, 5.0) if block is None else block
    dtype = measured.times.dtype
    shape = jax.device_put(jax.tree.map(lambda leaf: np.asarray(leaf, dtype), shape))
    return Known(model, shape, parameters, free)


def _choose_noise(name: str, unit: str, value: Number | None, guess: float) -> float:
    """Return the noise that is given, or a guess."""
    if value is None:
        return 0.01 * guess if guess > 0 else 1.0
    array = as_real(name, value, unit=unit)
    check_concrete(array, OUTSIDE)
    check(name, array, POSITIVE)
    if array.ndim:
        raise ValueError(f"{name} must be one number, got an array of shape {array.shape}")
    return float(array)


def _reestimate(fit: Fitted) -> Noises:
    """Estimate the noises from the residuals of times and rotations.

    The degrees of freedom of each kind are its number minus its leverages.
    """
    kinds = [fit.measured.used.sum()]
    leverages = np.sum(np.linalg.qr(fit.free_jacobian)[0] ** 2, axis=1)
    freedom = np.split(1 - leverages, kinds)
    squares = np.split(fit.residuals**2, kinds)
    sizes = [fit.noises.times, fit.noises.rotations]
    for k in range(2):
        if not fit.noises.known[k]:
            mean = np.sum(squares[k]) / max(np.sum(freedom[k]), _LEAST_FREEDOM)
            sizes[k] *= max(mean**0.5, _LEAST_FACTOR)
    return Noises(sizes[0], sizes[1], fit.noises.known)


def _make_free_rocking_fit(
    fit: Fitted, block: Block | None, repairs: tuple[str, ...]
) -> FreeRockingFit:
    """Make the answer: arrays in the precision of the measurements, NaN where unknown."""
    measured, known, noises = fit.measured, fit.known, fit.noises
    count = int(measured.used.sum())
    peaked = bool(measured.peaked.any())
    # With both kinds the rounds have scaled the residuals to a variance of 1.
    scaled = noises.known[0] or peaked
    variance = 1.0 if scaled else fit.squares / fit.freedom
    values, slopes = compute_values(fit.parameters)
    covariance = np.zeros((5, 5))
    covariance[np.ix_(known.free, known.free)] = compute_covariance(fit.free_jacobian)
    covariance *= variance * np.outer(slopes, slopes)
    errors = dict(zip(PARAMETERS, np.sqrt(np.diagonal(covariance)), strict=True))
    time_noise = noises.times * variance**0.5
    restitution = values["restitution"]
    _refuse(fit, restitution, errors["restitution"], time_noise)

    notes = []
    if fit.freedom <= 2 and not scaled:
        notes.append(
            f"degrees of freedom: only {fit.freedom}; the noise, and with it every standard"
            " error, is a guess"
        )
    step, error = _estimate_addition(fit, FREQUENCY, scaled)
    if abs(step) > max(SIGNIFICANT * error, NEGLIGIBLE):
        notes.append(
            "the durations are not those of this block, or C is not constant: a p that is"
            f" {abs(step) / error:.2g} standard errors away explains them better;"
            " frequency_known=False fits it"
        )
    if block is not None or peaked:
        notes += _compare_models(fit, errors["restitution"])
    # p and alpha_c determine a block up to its inertia ratio and gravity.
    size = values["frequency_parameter"], values["critical_angle"]
    if block is None and peaked:
        block = Block.from_parameters(*size)
    elif block is None:
        values["critical_angle"] = errors["critical_angle"] = np.nan
    elif known.free[FREQUENCY]:
        constants = block.gravity, block.inertia_ratio
        block = Block.from_parameters(*size, *constants, one_sided=block.one_sided)
    # Measurements that were left out have no residuals.
    time_residuals = np.full(measured.times.size, np.nan)
    time_residuals[measured.used] = fit.residuals[:count] * noises.times
    peak_residuals = np.full(measured.peaks.size, np.nan)
    peak_residuals[measured.peaked] = fit.residuals[count:] * noises.rotations
    ratios, restitutions, ratio_errors = _estimate_by_impact(fit)
    change, change_error = _estimate_addition(fit, CHANGE, scaled)
    reals = {
        **values,
        "standard_errors": errors,
        "covariance": covariance,
        "time_residuals": time_residuals,
        "rotation_residuals": peak_residuals[: None if peaked else 0],
        "time_noise": time_noise,
        "rotation_noise": noises.rotations * variance**0.5 if peaked else np.nan,
        "impact_times": measured.times,
        "velocity_ratios": ratios,
        "restitutions": restitutions,
        "restitution_errors": ratio_errors * variance**0.5,
        "restitution_change": change * restitution,
        "restitution_change_error": change_error * restitution,
        "degrees_of_freedom": fit.freedom,
    }
    reals = jax.tree.map(lambda leaf: np.asarray(leaf, known.dtype), reals)
    discrete = {"impact_numbers": measured.impacts, "used": measured.used}
    arrays = jax.device_put({**reals, **discrete})  # at once, which is ten times faster
    return FreeRockingFit(
        **arrays, block=block, model=known.model.name, repairs=repairs, notes=tuple(notes)
    )


def _refuse(fit: Fitted, restitution: float, error: float, time_noise: float) -> None:
    """Raise `ValueError` if the measurements are of no free rocking."""
    typical = np.median(np.diff(fit.measured.times[fit.measured.used]))
    # Any times have a closest motion: the noise shows whether it is close. The C of a nearly
    # elastic block may be slightly above 1 by noise alone.
    near = fit.converged and time_noise <= _ROUGH * typical
    if not (near and restitution - 2 * error <= 1):
        raise ValueError(
            "impact_times must be from free rocking, which decays, but the nearest such motion has"
            f" C = {restitution:.4g} +- {error:.2g}: check that times are in seconds and"
            " rotations in radians, and give the block if it is known"
        )


def _estimate_addition(fit: Fitted, place: int, scaled: bool) -> tuple[float, float]:
    """Estimate one more parameter and its error, by a Gauss-Newton step from this fit.

    NaN without degrees of freedom, or if the parameter has no effect or is fitted.
    """
    jacobian = np.column_stack([fit.free_jacobian, fit.jacobian[:, place]])
    covariance = compute_covariance(jacobian)
    if (
        fit.freedom < 2
        or fit.known.free[place : place + 1].any()
        or np.isnan(covariance).any()
    ):
        return np.nan, np.nan
    step = -covariance @ (jacobian.T @ fit.residuals)
    squares = np.sum((fit.residuals + jacobian @ step) ** 2)
    variance = 1.0 if scaled else squares / (fit.freedom - 1)
    return float(step[-1]), float((covariance[-1, -1] * variance) ** 0.5)


def _compare_models(fit: Fitted, error: float) -> list[str]:
    """Report the C of the other model if it differs by more than a standard error.

    It is estimated by one Gauss-Newton step from this fit: a difference of many standard
    errors need not be exact.
    """
    known = fit.known
    model = Nonlinear() if isinstance(known.model, Linearized) else Linearized()
    p_and_angle = np.exp(fit.parameters[FREQUENCY:]).astype(known.dtype)
    shape = jax.tree.map(np.asarray, Block.from_parameters(*p_and_angle))
    alternative = known._replace(model=model, shape=shape)
    residuals, _ = compute_residuals(fit.parameters, fit.measured, alternative, fit.noises)
    parameters = fit.parameters.copy()
    jacobian = fit.free_jacobian
    parameters[known.free] -= compute_covariance(jacobian) @ (jacobian.T @ residuals)
    restitution = np.exp(fit.parameters[RESTITUTION])
    elsewhere = np.exp(parameters[RESTITUTION])
    difference = abs(elsewhere - restitution)
    if not difference > max(error, NEGLIGIBLE):
        return []
    return [
        f"the model matters: the {model.name} one gives a C of about {elsewhere:.4g},"
        f" {difference / error:.2g} standard errors from this one"
    ]


def _estimate_by_impact(fit: Fitted) -> tuple[Values, Values, Values]:
    """Estimate the velocity before each impact, C of that impact alone, and its error.

    C is the ratio of the launch velocities of the half-cycles after and before an impact.
    The launch velocity of a duration is found by Newton's method.
    """
    measured = fit.measured
    exists = measured.successive
    unit = np.exp(-fit.parameters[FREQUENCY])
    durations = np.diff(measured.times) / unit
    log_ratios, _ = compute_log_ratio(fit.parameters[LAUNCH : LAUNCH + 1])
    log_ratios = log_ratios + measured.impacts[:-1] * fit.parameters[RESTITUTION]
    launch = np.log(np.arctanh(np.exp(log_ratios)))
    # In logarithms durations are nearly linear: few steps from the fitted motion suffice.
    for _ in range(_NEWTON):
        log_ratios, slope = compute_log_ratio(launch)
        motion = compute_half_cycles(fit.known, log_ratios)
        computed = motion.durations
        logarithm = np.log(np.where(exists, durations, computed) / computed)
        step = computed / (motion.duration_slopes * slope) * logarithm
        launch = launch + np.clip(step, -1, 1)
    log_ratios, _ = compute_log_ratio(launch)
    motion = compute_half_cycles(fit.known, log_ratios)
    ratios = np.exp(log_ratios)
    both = exists[1:] & exists[:-1]
    restitution = np.where(both, ratios[1:] / ratios[:-1], np.nan)
    # Errors of the logarithms of ratios. Two neighbouring durations share one time, with
    # opposite signs, and each has a second time of its own: their variances are 2 and their
    # covariance is -1, which enters the ratio as +1.
    errors = fit.noises.times / unit / motion.duration_slopes
    square = errors[:-1] ** 2 + errors[1:] ** 2 + errors[:-1] * errors[1:]
    return np.where(both, ratios[:-1], np.nan), restitution, restitution * np.sqrt(2 * square)
