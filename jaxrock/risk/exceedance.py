"""Shares of a suite beyond thresholds, counted from responses, and the curves through them."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..grids import DataType
from ..host import add_names
from .lognormal import fit_lognormal

if TYPE_CHECKING:
    import xarray

Threshold = float | int | str
_LazyOrNot = Any  # an array of NumPy, or of Dask, which not every user has
# Characters of the longest remark, and a few more. Fixed, since a lazy dataset and a store
# must know the type of a variable before there is any remark.
_REMARK = 160


class _CurveVariable(NamedTuple):
    """A variable made of counts: its dimensions, type, long name, and unit if it has one."""

    dims: tuple[str, ...]
    dtype: DataType
    long_name: str
    units: str


def describe_variable(long_name: str, units: str = "1") -> dict[str, str]:
    """Make the attributes of a variable, with its unit as CF writes it."""
    return {
        "long_name": long_name,
        "units": units.replace("m/s2", "m s-2").replace("m/s", "m s-1"),
    }


def add_curves(
    responses: "xarray.Dataset",
    thresholds: Sequence[Threshold],
    names: Sequence[str],
    confidence: float,
    unit: str,
) -> "xarray.Dataset":
    """Add the curves over the levels to responses over record and level, before these.

    The curves are lazy if the responses are.
    """
    ratio = responses.rotation_ratio.data
    overturned = responses.overturned.data > 0
    beyond = [_exceeds(threshold, ratio, overturned) for threshold in thresholds]
    counts = np.stack([exceeded.sum(axis=0) for exceeded in beyond], axis=-1)
    within = responses.within_tolerance.data.mean(axis=0)
    levels = responses.level.values
    number = responses.sizes["record"]
    ends = f"of the interval with a confidence of {confidence:g}"
    plane = ("level", "threshold")
    line = ("threshold",)
    entries = {
        "exceedance": _CurveVariable(
            plane, float, "share of records beyond the threshold", "1"
        ),
        "exceedance_low": _CurveVariable(plane, float, f"lower end {ends}", "1"),
        "exceedance_high": _CurveVariable(plane, float, f"upper end {ends}", "1"),
        "lognormal": _CurveVariable(plane, float, "most likely lognormal curve", "1"),
        "lognormal_median": _CurveVariable(line, float, "median of the lognormal curve", unit),
        "lognormal_dispersion": _CurveVariable(
            line, float, "its standard deviation of ln(level)", "1"
        ),
        "remark": _CurveVariable(line, f"<U{_REMARK}", "on the curve", ""),
    }
    arguments = (levels, number, confidence)
    # Curves are fitted to the counts of all levels: one task, which does not see the
    # responses.
    if isinstance(counts, np.ndarray):
        curves = _compute_curves(counts, *arguments)
    else:
        kinds = {
            name: ([plane.index(dim) for dim in entry.dims], entry.dtype)
            for name, entry in entries.items()
        }
        from ..grids import apply_lazily

        curves = apply_lazily(_compute_curves, counts, arguments, kinds)
    variables = {}
    for name, (dims, _, long_name, units) in entries.items():
        described = describe_variable(long_name, units) if units else {"long_name": long_name}
        variables[name] = (dims, curves[name], described)
    chaos = describe_variable("share of records whose answer is within tolerance")
    variables["share_within_tolerance"] = (("level",), within, chaos)
    first = responses.drop_vars(list(responses.data_vars)).assign(variables)
    whole = first.assign({name: responses[name] for name in responses.data_vars})
    return add_names(whole, threshold=(names, "threshold"))


def _exceeds(threshold: Threshold, ratio: _LazyOrNot, overturned: _LazyOrNot) -> _LazyOrNot:
    """Tell which responses are beyond a threshold."""
    if threshold == "uplift":
        return ratio > 0
    if threshold == "overturning":
        return overturned
    # A block that overturns is beyond every rotation, also where it was followed no further.
    return (ratio > float(threshold)) | overturned


def _compute_curves(
    counts: np.ndarray, levels: np.ndarray, number: int, confidence: float
) -> dict[str, np.ndarray]:
    """Compute counted and fitted curves, for counts of shape (levels, thresholds)."""
    from scipy.special import betaincinv

    # The exact interval of Clopper and Pearson (1934), doi:10.1093/biomet/26.4.404, for every
    # count that there can be. At its ends the beta distribution degenerates: to 0 and 1.
    tail = 0.5 * (1 - confidence)
    every = np.arange(number + 1)
    lower = np.append(0.0, betaincinv(every[1:], number - every[1:] + 1, tail))
    upper = np.append(betaincinv(every[:-1] + 1, number - every[:-1], 1 - tail), 1.0)
    low = lower[counts]
    high = upper[counts]
    fits = [fit_lognormal(levels, column, number) for column in counts.T]
    fitted = np.stack([fit.at(levels) for fit in fits], axis=-1)
    remarks = []
    for k, fit in enumerate(fits):
        outside = int(((fitted[:, k] < low[:, k]) | (fitted[:, k] > high[:, k])).sum())
        # The counts need not rise with the level: a block that a record overturns may survive
        # the same record made stronger. A lognormal curve hides that, so the remark says it.
        falls = int((np.diff(counts[:, k]) < 0).sum())
        words = [fit.remark] if fit.remark else []
        if outside:
            words.append(f"outside of the intervals at {outside} of {len(levels)} levels")
        if falls:
            words.append(f"the counted share falls {falls} time{'s' * (falls > 1)}")
        remarks.append("; ".join(words))
    medians, dispersions = ([fit[k] for fit in fits] for k in range(2))
    return {
        "exceedance": counts / number,
        "exceedance_low": low,
        "exceedance_high": high,
        "lognormal": fitted,
        "lognormal_median": np.asarray(medians, float),
        "lognormal_dispersion": np.asarray(dispersions, float),
        "remark": np.asarray(remarks, f"<U{_REMARK}"),
    }
