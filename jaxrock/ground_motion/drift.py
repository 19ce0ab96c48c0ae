"""Remarks on records whose ground does not come to rest, since their baseline is off."""

import warnings

import numpy as np

from ..validation import is_traced
from .record import Record

# In the 100 corrected components of FEMA P695, PGV changes by 0.6 % at most if the drift is taken
# out; in the 22 of the examples, some of them uncorrected, by 7.5 %. An offset of 0.003 g on
# FEMA's makes PGV 2.5 times as large in the median, and 182 of 200 are then told.
_TOLERANCE = 0.25
# Fewer samples, or seconds, are no record of an earthquake but made by hand, perhaps a pulse,
# after which the ground moves on.
_LEAST_SAMPLES = 100
_LEAST_DURATION = 5.0


def warn_of_drift(name: str, record: Record) -> None:
    """Warn if the peak ground velocity of a record is due to a drift of its velocity.

    An offset of the acceleration lets the velocity grow until the end. Nothing is corrected.
    The drift is taken to be a straight line from rest to the velocity at the end.

    Parameters
    ----------
    name : str
        Of the record, as the warning calls it.
    record : Record
        Concrete, with one-dimensional samples; nothing is said of others.
    """
    if is_traced(record) or record.acceleration.ndim > 1:
        return
    step = float(record.time_step)
    if record.samples < _LEAST_SAMPLES or record.samples * step < _LEAST_DURATION:
        return
    # In NumPy: JAX would compile a program for every number of samples.
    samples = np.asarray(record.acceleration, float)
    largest = float(np.max(np.abs(np.asarray(record.scale))))
    with np.errstate(over="ignore", invalid="ignore"):
        velocity = np.cumsum(0.5 * (samples[1:] + samples[:-1]))
        velocity *= step * largest
        end = velocity[-1]
        peak = np.abs(velocity).max()
        drift = end * np.arange(1, samples.size) / (samples.size - 1)
        steady = np.abs(velocity - drift).max()
        drifts = abs(peak - steady) > _TOLERANCE * min(peak, steady)
    if not drifts:
        return
    # From this line, whoever asks: Python shows the same text from one line once.
    warnings.warn(
        f"{name}: the ground still moves at {end:.3g} m/s at the end, and PGV is {peak:.3g} m/s;"
        f" without this drift it is {steady:.3g} m/s. Correct the baseline, by obspy or"
        " gmprocess for example, or subtract the mean before the event",
        stacklevel=1,
    )
