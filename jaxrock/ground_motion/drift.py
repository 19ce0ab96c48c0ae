"""Remarks on records whose ground does not come to rest, since their baseline is off."""

import warnings
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..validation import is_traced
from .record import Record

# Removing the drift changes PGV by at most 0.6 % in the 100 corrected components of FEMA P695,
# and by at most 7.5 % in the 22 components of the examples, some of them uncorrected. An
# offset of 0.003 g raises PGV of FEMA's components 2.5 times in the median, and 182 of 200 are
# then detected.
_TOLERANCE = 0.25
# A motion of fewer samples or seconds is no record of an earthquake, but perhaps a pulse,
# after which the ground goes on moving.
_LEAST_SAMPLES = 100
_LEAST_DURATION = 5.0


_WAY_OUT = (
    "Correct the baseline, by obspy or gmprocess for example, or subtract the mean before the"
    " event"
)
_LISTED = 3  # number of records of a suite that are named


class Drift(NamedTuple):
    """Velocity at the end, PGV, and PGV without the drift [m/s], of a record of scale 1."""

    end: float
    peak: float
    steady: float


def measure_drift(record: Record) -> Drift:
    """Measure the velocity of a concrete, single record with and without its drift.

    An offset of the acceleration lets the velocity grow until the end. The drift is taken to be
    a straight line from rest to the velocity at the end. Peaks are exact for lines between
    samples, as in `intensity_measure`.
    """
    # NumPy is used: JAX would compile a program for every number of samples.
    samples = np.asarray(record.acceleration, float)
    step = float(record.time_step)
    with np.errstate(over="ignore", invalid="ignore"):
        end, peak = _integrate_samples(samples)
        # A line in the velocity is a constant in the acceleration.
        _, steady = _integrate_samples(samples - end / (samples.size - 1))
    return Drift(step * end, step * peak, step * steady)


def _integrate_samples(samples: np.ndarray) -> tuple[float, float]:
    """Compute the velocity at the end and its largest magnitude, both over the time step."""
    before = samples[:-1]
    after = samples[1:]
    velocity = np.cumsum(0.5 * (before + after))
    # Where the acceleration changes its sign, the velocity has an extreme between two samples:
    # the velocity at the second one minus a triangle.
    crosses = before * after < 0
    triangle = 0.5 * after[crosses] ** 2 / (before - after)[crosses]
    extremes = np.abs(velocity[crosses] + triangle)
    peak = max(float(np.abs(velocity).max()), float(extremes.max(initial=0.0)))
    return float(velocity[-1]), peak


def find_drift(record: Record) -> Drift | None:
    """Find the drift of a record if its peak ground velocity is due to it; None if not.

    Traced records and arrays of records give None.
    """
    if is_traced(record) or record.acceleration.ndim > 1:
        return None
    step = float(record.time_step)
    if record.samples < _LEAST_SAMPLES or record.samples * step < _LEAST_DURATION:
        return None
    drift = measure_drift(record)
    return drift if drift.peak > (1 + _TOLERANCE) * drift.steady else None


def warn_of_drift(name: str, record: Record) -> None:
    """Warn if the peak ground velocity of a record, called `name`, is due to a drift."""
    if drift := find_drift(record):
        warnings.warn(
            f"{name}: the ground still moves at {drift.end:.3g} m/s at the end, and PGV is"
            f" {drift.peak:.3g} m/s; without this drift it is {drift.steady:.3g} m/s. {_WAY_OUT}",
            stacklevel=2,
        )


def warn_of_drifts(names: Sequence[str], records: Sequence[Record]) -> None:
    """Warn, in one sentence, of records of a suite whose PGV is due to a drift."""
    drifting = [
        f"{name!r} ({drift.peak:.3g} m/s, without the drift {drift.steady:.3g} m/s)"
        for name, record in zip(names, records, strict=True)
        if (drift := find_drift(record))
    ]
    if drifting:
        listed = ", ".join(drifting[:_LISTED]) + (", ..." if drifting[_LISTED:] else "")
        warnings.warn(
            f"PGV of {len(drifting)} of {len(records)} records is due to a drift: {listed}."
            f" {_WAY_OUT}",
            stacklevel=2,
        )
