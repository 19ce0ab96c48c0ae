"""Checks of the measurements in a test of free rocking, and of the block as far as known."""

import jax
import numpy as np
from jaxtyping import Array

from ..block import Block
from ..resonance import Linearized, RockingModel
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
from .free_rocking_motion import ANGLE, FREQUENCY, Known, Measured, Noises
from .least_squares import OUTSIDE, Values

_ANY_SHAPE = 5.0  # slenderness where none is known: the linearized equation has no shape


def check_measurements(
    impact_times: Numbers | None, peak_rotations: Numbers | None, one_sided: bool
) -> tuple[Measured, np.dtype]:
    """Check the measurements, and return them and the precision in which they are given."""
    times = None
    peaks = None
    if impact_times is not None:
        times = as_real("impact_times", impact_times, unit="s")
    if peak_rotations is not None:
        peaks = as_real("peak_rotations", peak_rotations, unit="rad")
    given = [part for part in (times, peaks) if part is not None]
    if not given:
        raise ValueError("impact_times or peak_rotations must be given, got neither")
    check_concrete(given, OUTSIDE)
    for name, values in (("impact_times", times), ("peak_rotations", peaks)):
        if values is not None and values.ndim != 1:
            raise ValueError(
                f"{name} must be one-dimensional, got an array of shape {values.shape}"
            )
    if times is not None and peaks is not None and peaks.size != times.size - 1:
        raise ValueError(
            f"peak_rotations must have one value less than impact_times, {times.size - 1},"
            f" got {peaks.size}"
        )
    # Peaks without times get one dummy time of weight 0, so that arrays are never empty.
    t = _as_float(times, 1)
    a = _as_float(peaks, 0)
    _check_times(t)
    _check_peaks(a, one_sided)
    # The equation is the same on both sides: only the size of a peak matters.
    known = ~np.isnan(a)
    measured = Measured(
        times=t,
        time_counts=np.full(t.shape, times is not None),
        impacts=np.arange(t.size),
        peaks=np.where(known, np.abs(a), 0),
        peak_counts=known,
        arcs=np.arange(a.size),
    )
    return measured, given[0].dtype


def _as_float(values: Array | None, size: int) -> Values:
    """Convert values to float64, in which the search runs; without any, as many zeros."""
    return np.zeros(size) if values is None else np.asarray(values, float)


def _check_times(times: Values) -> None:
    """Raise `ValueError` if times are not finite or do not increase."""
    check("impact_times", times, FINITE)
    check_increasing("impact_times", times)


def _check_peaks(peaks: Values, one_sided: bool) -> None:
    """Raise `ValueError` if a peak rotation is 0 or cannot be in radians; NaN is allowed."""
    behind = peaks[peaks < 0]
    if one_sided and behind.size:
        raise ValueError(
            f"peak_rotations of a one-sided block must be positive, got {behind[0]:g}"
        )
    out_of_range = (peaks == 0) | (np.abs(peaks) > np.pi / 2)
    if out_of_range.any():
        raise ValueError(
            "peak_rotations must be between -pi / 2 and pi / 2 and not 0, or NaN where unknown,"
            f" got {peaks[out_of_range][0]:g}"
        )


def gather_known(
    block: Block | None,
    measured: Measured,
    model: RockingModel,
    frequency_known: bool,
    dtype: np.dtype,
) -> Known:
    """Gather the numbers that need not be fitted, and tell which ones are free."""
    timed = measured.times.size > 1
    peaked = measured.peaks.size > 0
    if block is None and not isinstance(model, Linearized):
        raise ValueError(
            "block must be given for the nonlinear model, which depends on its shape"
        )
    if block is None and not timed:
        raise ValueError("block must be given if there are peak_rotations only, got None")
    if block is not None:
        check_kind("block", block, Block)
        check_concrete(block, OUTSIDE)
    # In the order of `NUMBERS`. Durations alone know no critical angle, peaks alone no p, and
    # a change of C is fitted beside, never at first.
    free = [timed, True, True, timed and (block is None or not frequency_known)]
    free += [block is None and peaked, False]
    numbers = np.zeros(6)
    if block is not None:
        frequency = block.frequency_parameter
        angle = block.critical_angle
        if frequency.ndim:
            raise ValueError("block must be one block, got several")
        numbers[FREQUENCY] = np.log(float(frequency))
        numbers[ANGLE] = np.log(float(angle))
    unknowns = sum(free)
    # One measurement more than numbers, or nothing says how large the noise is.
    of_times = measured.times.size * timed
    of_peaks = measured.peaks.size
    if of_times + of_peaks <= unknowns:
        name, given = ("impact_times", of_times) if timed else ("peak_rotations", of_peaks)
        least = unknowns + 1 - (of_peaks if timed else 0)
        raise ValueError(
            f"{name} must have at least {least} values to fit {unknowns} parameters, got {given}"
        )
    shape = Block(0.2, _ANY_SHAPE) if block is None else block
    # At once to the device, in the precision of the measurements: one program for all tests.
    shape = jax.device_put(jax.tree.map(lambda leaf: np.asarray(leaf, dtype), shape))
    return Known(model, shape, numbers, np.array(free))


def choose_noises(
    measured: Measured, times: Number | None, rotations: Number | None
) -> Noises:
    """Return the noises given; to begin with 1 % of the mean half-cycle and the largest peak.

    Of one kind of measurement alone, the noise only scales the residuals; of both, it is the
    weight between them, which is found by `reestimate`.
    """
    span = (measured.times[-1] - measured.times[0]) / measured.times.size
    guesses = span, measured.peaks.max(initial=0)
    sizes = []
    for name, unit, value, guess in zip(
        ("time_noise", "rotation_noise"),
        ("s", "rad"),
        (times, rotations),
        guesses,
        strict=True,
    ):
        array = as_real(
            name, (0.01 * guess if guess > 0 else 1.0) if value is None else value, unit=unit
        )
        check_concrete(array, OUTSIDE)
        check(name, array, POSITIVE)
        if array.ndim:
            raise ValueError(f"{name} must be one number, got an array of shape {array.shape}")
        sizes.append(float(array))
    return Noises(sizes[0], sizes[1], (times is not None, rotations is not None))
