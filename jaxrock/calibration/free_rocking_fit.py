"""Restitution and frequency parameter of a block from a test in which it rocks freely."""

import math
from typing import NamedTuple

import jax
import numpy as np

from ..block import Block
from ..resonance import Linearized, ModelLike, Nonlinear, as_model
from ..validation import Number, Numbers
from .free_rocking_answer import NEGLIGIBLE, OTHER_BLOCK, FreeRockingFit
from .free_rocking_input import check_measurements, choose_noises, gather_known
from .free_rocking_motion import (
    ANGLE,
    CHANGE,
    FREQUENCY,
    NUMBERS,
    RESTITUTION,
    Known,
    Measured,
    Noises,
    compute_change_by_model,
)
from .free_rocking_numbers import apply_numbering, number_impacts
from .free_rocking_search import Fitted, fit_together, is_minimum
from .free_rocking_summary import Summary, reestimate, summarize

_ROUNDS = 6  # in which the noises of times and rotations are found beside each other
# Noise beside the median half-cycle, from which on there is no free rocking: times without any
# order are 1 / sqrt(12) = 0.29 of a half-cycle off.
_ROUGH = 0.25
_NO_SUCH_MOTION = (
    "{} must be from free rocking, but no such motion fits them: check that times are in"
    " seconds and rotations in radians"
)


def fit_free_rocking(
    impact_times: Numbers | None = None,
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
    impact_times : array_like, shape (n,), optional
        Times of successive impacts [s], increasing.
    block : Block, optional
        The block, if it is known. Without it, p is fitted too, and alpha_c if there are peaks
        as well as times. For a one-sided block C is a magnitude, and peaks are positive.
    peak_rotations : array_like, shape (n - 1,), optional
        Largest rotation between each impact and the next [rad], to either side; NaN where
        unknown. Without times, the peaks of successive half-cycles, any number of them.
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
    are those of least squares; p-values account for the degrees of freedom.

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
    >>> fit = jr.fit_free_rocking(times, jr.Block(half_width=0.1, slenderness=5.0))
    >>> print(f"{fit.restitution:.5f} +- {fit.standard_errors['restitution']:.5f}")
    0.89998 +- 0.00002
    """
    one_sided = isinstance(block, Block) and block.one_sided
    measured, dtype = check_measurements(impact_times, peak_rotations, one_sided)
    if model is None:
        model = Linearized() if block is None else Nonlinear()
    known = gather_known(block, measured, as_model(model), frequency_known, dtype)
    noises = choose_noises(measured, time_noise, rotation_noise)
    repairs: tuple[str, ...] = ()
    log_chance_unrepaired = 0.0  # the logarithm of a probability of 1
    if repair and measured.times.size > 1:
        numbering, log_chance_unrepaired = number_impacts(measured, known, noises)
        measured = apply_numbering(measured, numbering)
        repairs = numbering.repairs
    # The numbering is settled: from here on peaks count as well as times.
    result = _search(measured, known, noises)
    _refuse(result, measured)
    notes = _list_notes(measured, block, result) + _compare_models(measured, block, result)
    if math.exp(log_chance_unrepaired) < OTHER_BLOCK:
        notes += (
            "before the repairs, another p or a changing C explained the times better (p-value"
            f" {math.exp(log_chance_unrepaired):.2g}); repair=False shows that fit",
        )
    return _make_free_rocking_fit(result, measured, block, repairs, notes)


class _SearchResult(NamedTuple):
    """The outcome of a search: the fit, statistics of it, and the noises it ended with."""

    about: Summary
    fit: Fitted
    known: Known
    noises: Noises

    @property
    def time_noise(self) -> float:
        """Given or estimated [s]."""
        return self.noises.times * self.about.variance**0.5

    @property
    def rotation_noise(self) -> float:
        """Given or estimated [rad]."""
        return self.noises.rotations * self.about.variance**0.5


def _search(measured: Measured, known: Known, noises: Noises) -> _SearchResult:
    """Fit the numbers, and in turn with them the noises that are not given.

    Of one kind of measurement, the noise follows from the residuals once the numbers are
    found. Of both kinds it is their weight in the fit, so that numbers and noises are found in
    turn.
    """
    timed = measured.times.size > 1
    peaked = measured.peaks.size > 0
    both = timed and peaked and not all(noises.known)
    for _ in range(_ROUNDS if both else 0):
        (fit,) = fit_together([measured], [known], noises)
        noises = reestimate(measured, known, fit, noises)
    # The three fits that are compared differ in one free number, and run side by side.
    kinds = [known, known.set_free(CHANGE)]
    if not known.free[FREQUENCY]:
        kinds.append(known.set_free(FREQUENCY))
    constant, changing, *tuned_fits = fit_together([measured] * len(kinds), kinds, noises)
    if not is_minimum(constant, measured, known, noises):
        raise ValueError(_NO_SUCH_MOTION.format(_name_argument(measured)))
    tuned = tuned_fits[0] if tuned_fits else None
    # Of both kinds the rounds have scaled the residuals to a variance of 1.
    given = noises.known[0 if timed else 1] or (timed and peaked)
    about = summarize(measured, known, constant, changing, tuned, noises, given)
    return _SearchResult(about, constant, known, noises)


def _list_notes(
    measured: Measured, block: Block | None, result: _SearchResult
) -> tuple[str, ...]:
    """Say in sentences what the measurements leave in doubt."""
    notes = []
    if block is not None and measured.peaks.size:
        angle = float(block.critical_angle)
        above = int((measured.peaks[measured.peak_counts] >= angle).sum())
        if above:
            are = "peak rotation is" if above == 1 else "peak rotations are"
            notes.append(
                f"{above} {are} at or above the critical angle of this block, {angle:.4g} rad,"
                " beyond which the block overturns: check the block, and that rotations are in rad"
            )
    freedom = result.about.freedom
    there = measured.times.size > 1, measured.peaks.size > 0
    # A noise that is given needs no degree of freedom to be estimated by.
    known = [k for k, given in zip(result.noises.known, there, strict=True) if given]
    if freedom in (1, 2) and not all(known):
        word = "degree" if freedom == 1 else "degrees"
        notes.append(
            f"{freedom} {word} of freedom: the noise, and with it every standard error, is a guess"
        )
    return tuple(notes)


def _compare_models(
    measured: Measured, block: Block | None, result: _SearchResult
) -> tuple[str, ...]:
    """Say what C the other model would give, if it differs by more than a standard error.

    By one Gauss-Newton step from this fit: a search in the other model would take another
    program, and a difference of many standard errors need not be known to all digits.
    """
    known = result.known
    if block is None and not measured.peaks.size:
        return ()  # whether the model matters depends on the shape, which times do not tell
    other = Nonlinear() if isinstance(known.model, Linearized) else Linearized()
    shape = known.shape
    if block is None:
        p, angle = np.exp(result.fit.numbers[[FREQUENCY, ANGLE]]).astype(known.dtype)
        shape = jax.tree.map(np.asarray, Block.from_parameters(p, angle))
    change = compute_change_by_model(
        result.fit.numbers,
        measured,
        known,
        result.noises,
        known._replace(model=other, shape=shape),
    )
    jacobian = result.fit.jacobian[:, known.free]
    scale = np.linalg.norm(jacobian, axis=0)
    step = np.zeros(known.free.size)
    step[known.free] = -np.linalg.lstsq(jacobian / scale, change)[0] / scale
    restitution = result.about.values[RESTITUTION]
    elsewhere = restitution * np.exp(step[RESTITUTION])
    error = result.about.covariance[RESTITUTION, RESTITUTION] ** 0.5
    if not abs(elsewhere - restitution) > max(error, NEGLIGIBLE):
        return ()
    validity = ", which is valid for any slenderness," if isinstance(other, Nonlinear) else ""
    return (
        f"the model matters: the {other.name} one{validity} gives a C of about {elsewhere:.4g},"
        f" {abs(elsewhere - restitution) / error:.2g} standard errors from this one",
    )


def _make_free_rocking_fit(
    result: _SearchResult,
    measured: Measured,
    block: Block | None,
    repairs: tuple[str, ...],
    notes: tuple[str, ...],
) -> FreeRockingFit:
    """Make the answer: arrays in the precision of the measurements, NaN where unknown."""
    about = result.about
    times = measured.times.size if measured.times.size > 1 else 0
    peaks = measured.peaks.size
    late, high = np.split(result.fit.residuals, [measured.times.size])
    free = dict(zip(NUMBERS, result.known.free, strict=False))
    values = dict(zip(NUMBERS, about.values, strict=True))
    p = values["frequency_parameter"]
    angle = values["critical_angle"]
    # A block of p and alpha_c is known by them alone, up to its inertia ratio and gravity.
    if block is None and peaks:
        block = Block.from_parameters(p, angle)
    elif block is None:
        values["critical_angle"] = np.nan
    elif free["frequency_parameter"]:
        block = Block.from_parameters(
            p, angle, block.gravity, block.inertia_ratio, one_sided=block.one_sided
        )
    if not free["first_impact"]:
        values["first_impact"] = np.nan
    errors = np.sqrt(np.diagonal(about.covariance))
    reals: dict[str, object] = {
        **values,
        "standard_errors": dict(zip(NUMBERS, errors, strict=True)),
        "covariance": about.covariance,
        "time_residuals": np.where(measured.time_counts, late * result.noises.times, np.nan)[
            :times
        ],
        "rotation_residuals": np.where(
            measured.peak_counts, high * result.noises.rotations, np.nan
        ),
        "time_noise": result.time_noise if times else np.nan,
        "rotation_noise": result.rotation_noise if peaks else np.nan,
        "impact_times": measured.times[:times],
        "velocity_ratios": about.velocity_ratios,
        "restitutions": about.restitutions,
        "restitution_errors": about.restitution_errors,
        "restitution_change": about.restitution_change,
        "restitution_change_error": about.restitution_change_error,
        "restitution_change_p_value": about.restitution_change_p_value,
        "frequency_p_value": about.frequency_p_value,
        "degrees_of_freedom": about.freedom,
    }
    reals = jax.tree.map(lambda leaf: np.asarray(leaf, result.known.dtype), reals)
    discrete = {
        "impact_numbers": measured.impacts,
        "used": measured.time_counts,
    }
    arrays = jax.device_put({**reals, **discrete})  # at once, which is ten times faster
    return FreeRockingFit(
        **arrays, block=block, model=result.known.model.name, repairs=repairs, notes=notes
    )


def _name_argument(measured: Measured) -> str:
    """Name the argument that the motion was sought for."""
    return "impact_times" if measured.times.size > 1 else "peak_rotations"


def _refuse(result: _SearchResult, measured: Measured) -> None:
    """Raise `ValueError` if the measurements are of no free rocking."""
    restitution = result.about.values[RESTITUTION]
    error = result.about.covariance[RESTITUTION, RESTITUTION] ** 0.5
    name = _name_argument(measured)
    if not np.isfinite(restitution + error):
        raise ValueError(_NO_SUCH_MOTION.format(name))
    # A nearly elastic block may come out a little above 1, by the noise alone.
    if restitution - 2 * error > 1:
        raise ValueError(
            f"{name} must be from a decaying motion, but each launch velocity is"
            f" {restitution:.4g} times the previous one"
        )
    # There is a nearest motion to any times: the noise says whether it is near.
    if measured.times.size > 1:
        noise = result.time_noise
        typical = float(np.median(np.diff(measured.times[measured.time_counts])))
        if noise > _ROUGH * typical:
            raise ValueError(
                f"impact_times must be from free rocking, but they differ by {noise:.2g} s"
                f" from the nearest such motion, whose half-cycles last {typical:.2g} s"
            )
