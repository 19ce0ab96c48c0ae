"""Thresholds, probabilities of exceeding them, and curves fitted to these."""

from collections.abc import Iterable, Sequence

import numpy as np

from ..numerics import bound_probabilities
from ..validation import POSITIVE, as_real, as_text, check
from .lognormal import BoundarySums, LognormalFit, fit_lognormal

Threshold = float | int | str
# Rotation ratios beyond which a response exceeds a threshold that has a name. Whatever
# overturns exceeds all of them.
NAMED_THRESHOLDS: dict[Threshold, float] = {"uplift": 0.0, "overturning": np.inf}


def name_thresholds(thresholds: Sequence[Threshold]) -> list[str]:
    """Name the thresholds; a `ValueError` if they are not allowed."""
    if isinstance(thresholds, str) or not isinstance(thresholds, Iterable):
        raise ValueError(f"thresholds must be a list, got {thresholds!r:.60}")
    names = [_name_threshold(threshold) for threshold in thresholds]
    if not names or len(set(names)) < len(names):
        listed = ", ".join(names) or "none"
        raise ValueError(f"thresholds must be at least one, each only once, got {listed}")
    return names


def _name_threshold(threshold: Threshold) -> str:
    """Name a threshold; a `ValueError` if it is none."""
    threshold = as_text(threshold)
    if isinstance(threshold, str):
        if threshold not in NAMED_THRESHOLDS:
            allowed = f"rotation ratios, {' or '.join(map(repr, NAMED_THRESHOLDS))}"
            raise ValueError(f"thresholds must be {allowed}, got {threshold!r}")
        return threshold
    check("thresholds", as_real("thresholds", threshold), POSITIVE)
    return f"{float(threshold):g}"


def describe_variable(long_name: str, units: str = "1") -> dict[str, str]:
    """Make the attributes of a variable, with its unit, if any, as CF writes it."""
    units = units.replace("m/s2", "m s-2").replace("m/s", "m s-1")
    return {"long_name": long_name} | ({"units": units} if units else {})


def compute_curve(
    counts: np.ndarray,
    sums: np.ndarray,
    is_uplift: bool,
    levels: np.ndarray,
    records: int,
    confidence: float,
) -> dict[str, np.ndarray | float | str]:
    """Compute the variables of one threshold: counted and fitted probabilities.

    Parameters
    ----------
    counts : ndarray, shape (samples, levels)
        Numbers of records under which it is exceeded. They need not be whole.
    sums : ndarray, shape (samples, 3)
        Sums over the boundaries under all records; see `BoundarySums`.
    is_uplift : bool
        Whether any rotation exceeds it: its boundaries are known also outside of the levels.
    levels : ndarray, shape (levels,)
    records : int
        Number of independent records.
    confidence : float
        Of the intervals.
    """
    # A record counts by the fraction of its samples, whose variance is smaller than that of a
    # single outcome with the same mean: the interval is too wide, never too narrow.
    mean = counts.mean(axis=0)
    low, high = bound_probabilities(mean, records, confidence)
    ends = (float(levels[0]), float(levels[-1]))

    def fit(count: float, powers: np.ndarray) -> LognormalFit:
        """Fit a curve where `count` records exceed at the lowest level."""
        below = 0.0 if is_uplift else float(count)
        above = max(records - below - float(powers[0]), 0.0)
        return fit_lognormal(BoundarySums(below, above, powers), ends)

    curve = fit(float(mean[0]), sums.mean(axis=0))
    fitted = curve.at(levels)
    remarks = [curve.remark] if curve.remark else []
    if not is_uplift and not ends[0] <= curve.median <= ends[1] and curve.median > 0:
        remarks.append("the median lies outside of the levels")
    outside = int(((fitted < low) | (fitted > high)).sum())
    if outside:
        remarks.append(
            f"the curve is outside of the intervals at {outside} of {levels.size} levels"
        )
    # Counts need not increase with the level: a block that a record overturns may survive the
    # same record made stronger. A lognormal curve hides that, so the remark says it.
    falls = int((np.diff(mean) < 0).sum())
    if falls:
        places = f"{falls} level{'s' * (falls > 1)}"
        remarks.append(f"at {places} fewer records exceed it than at the next lower level")
    samples = [fit(float(count), part) for count, part in zip(counts[:, 0], sums, strict=True)]
    of_records, of_parameters = _split_dispersion(samples if len(counts) > 1 else [curve])
    return {
        "exceedance": mean / records,
        "exceedance_low": low,
        "exceedance_high": high,
        "lognormal": fitted,
        "lognormal_median": curve.median,
        "lognormal_dispersion": curve.dispersion,
        "remark": "; ".join(remarks),
        "dispersion_of_records": of_records,
        "dispersion_of_parameters": of_parameters,
    }


def _split_dispersion(fits: Sequence[LognormalFit]) -> tuple[float, float]:
    """Split the dispersion by the law of total variance, given the curve of each sample.

    Within a sample only the records differ; from sample to sample, the medians do. NaN where
    no more than half of the samples have a curve.
    """
    # Samples without a curve never or always exceed: without them, if they were many, the
    # dispersion would be too small.
    parameters = np.array([fit[:2] for fit in fits if np.isfinite(fit.median)])
    if len(parameters) <= len(fits) // 2:
        return np.nan, np.nan
    medians, dispersions = parameters.T
    return (dispersions**2).mean() ** 0.5, np.log(medians).std()
