"""Shares of a suite beyond thresholds, counted from responses, and the curves through them."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..grids import DataType
from ..host import add_names
from .lognormal import fit_lognormal
from .share_intervals import bound_shares

if TYPE_CHECKING:
    import xarray

Threshold = float | int | str
_LazyOrNot = Any  # an array of NumPy, or of Dask, which not every user has
# Characters of the longest remark, and a few more. Fixed, since a lazy dataset and a store
# must know the type of a variable before there is any remark.
_REMARK = 200


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

    The responses may have dimensions of objects and of samples as well. The curves are lazy if
    the responses are.
    """
    dims = [str(dim) for dim in responses.rotation_ratio.dims]
    record = dims.index("record")
    ratio = responses.rotation_ratio.data
    overturned = responses.overturned.data > 0
    beyond = [_exceeds(threshold, ratio, overturned) for threshold in thresholds]
    counts = np.stack([exceeded.sum(axis=record) for exceeded in beyond], axis=-1)
    # The dimensions of the counts: objects and samples where there are any, levels, thresholds.
    of_counts = [*(dim for dim in dims if dim != "record"), "threshold"]
    scattered = "sample" in dims
    axes = tuple(dims.index(dim) for dim in dims if dim in ("record", "sample"))
    within = responses.within_tolerance.data.mean(axis=axes)
    levels = responses.level.values
    number = responses.sizes["record"]
    entries = _list_curves(of_counts, confidence, unit)
    arguments = (levels, number, confidence, of_counts.index("sample") if scattered else None)
    # Curves are fitted to the counts of all levels: one task, which does not see the
    # responses.
    if isinstance(counts, np.ndarray):
        curves = _compute_curves(counts, *arguments)
    else:
        kinds = {
            name: ([of_counts.index(dim) for dim in entry.dims], entry.dtype)
            for name, entry in entries.items()
        }
        from ..grids import apply_lazily

        curves = apply_lazily(_compute_curves, counts, arguments, kinds)
    variables = {}
    for name, (variable_dims, _, long_name, units) in entries.items():
        described = describe_variable(long_name, units) if units else {"long_name": long_name}
        variables[name] = (variable_dims, curves[name], described)
    chaos = describe_variable("share of records whose answer is within tolerance")
    plain = tuple(dim for dim in dims if dim in ("object", "level"))
    variables["share_within_tolerance"] = (plain, within, chaos)
    first = responses.drop_vars(list(responses.data_vars)).assign(variables)
    whole = first.assign({name: responses[name] for name in responses.data_vars})
    return add_names(whole, threshold=(names, "threshold"))


def _list_curves(
    of_counts: Sequence[str], confidence: float, unit: str
) -> dict[str, _CurveVariable]:
    """List the variables made of counts over these dimensions."""
    ends = f"of the interval with a confidence of {confidence:g}"
    plane = tuple(dim for dim in of_counts if dim != "sample")
    line = tuple(dim for dim in plane if dim != "level")
    share = "share of records beyond the threshold"
    entries = {
        "exceedance": _CurveVariable(plane, float, share, "1"),
        "exceedance_low": _CurveVariable(plane, float, f"lower end {ends}", "1"),
        "exceedance_high": _CurveVariable(plane, float, f"upper end {ends}", "1"),
        "lognormal": _CurveVariable(plane, float, "most likely lognormal curve", "1"),
        "lognormal_median": _CurveVariable(line, float, "median of the lognormal curve", unit),
        "lognormal_dispersion": _CurveVariable(
            line, float, "its standard deviation of ln(level)", "1"
        ),
        "remark": _CurveVariable(line, f"<U{_REMARK}", "on the curve", ""),
    }
    if "sample" in of_counts:
        part = "of the standard deviation of ln(level), the part due to"
        entries["dispersion_of_records"] = _CurveVariable(
            line, float, f"{part} the records", "1"
        )
        entries["dispersion_of_parameters"] = _CurveVariable(
            line, float, f"{part} uncertain parameters", "1"
        )
    return entries


def _exceeds(threshold: Threshold, ratio: _LazyOrNot, overturned: _LazyOrNot) -> _LazyOrNot:
    """Tell which responses are beyond a threshold."""
    if threshold == "uplift":
        return ratio > 0
    if threshold == "overturning":
        return overturned
    # A block that overturns is beyond every rotation, also where it was followed no further.
    return (ratio > float(threshold)) | overturned


def _compute_curves(
    counts: np.ndarray,
    levels: np.ndarray,
    number: int,
    confidence: float,
    sample_axis: int | None,
) -> dict[str, np.ndarray]:
    """Compute counted and fitted curves, for counts of shape (..., levels, thresholds).

    The axis of samples, if there is one, is in front of the levels.
    """
    each = counts if sample_axis is None else counts.mean(axis=sample_axis)
    # With samples a record counts by the share of its samples, which scatters less than one
    # outcome with the same mean: the interval is then wider than it need be, and never too
    # narrow.
    low, high = bound_shares(each, number, confidence)
    shape = each.shape[:-2]
    thresholds = each.shape[-1]
    lines = np.moveaxis(each, -1, -2).reshape(-1, len(levels))
    fits = [fit_lognormal(levels, line, number) for line in lines]
    fitted = np.array([fit.at(levels) for fit in fits]).reshape(*shape, thresholds, -1)
    fitted = np.moveaxis(fitted, -1, -2)
    outside = ((fitted < low) | (fitted > high)).sum(axis=-2).ravel()
    # The counts need not rise with the level: a block that a record overturns may survive
    # the same record made stronger. A lognormal curve hides that, so the remark says it.
    falls = (np.diff(lines, axis=-1) < 0).sum(axis=-1)
    remarks = []
    for fit, beyond, fall in zip(fits, outside.tolist(), falls.tolist(), strict=True):
        words = [fit.remark] if fit.remark else []
        if beyond:
            words.append(f"outside of the intervals at {beyond} of {len(levels)} levels")
        if fall:
            where = f"{fall} level{'s' * (fall > 1)}"
            words.append(f"at {where} fewer records exceed it than at the one below")
        remarks.append("; ".join(words))
    medians, dispersions = (
        np.array([fit[k] for fit in fits], float).reshape(*shape, thresholds) for k in range(2)
    )
    curves = {
        "exceedance": each / number,
        "exceedance_low": low,
        "exceedance_high": high,
        "lognormal": fitted,
        "lognormal_median": medians,
        "lognormal_dispersion": dispersions,
        "remark": np.asarray(remarks, f"<U{_REMARK}").reshape(*shape, thresholds),
    }
    if sample_axis is not None:
        parts = _split_dispersion(np.moveaxis(counts, sample_axis, 0), levels, number)
        curves["dispersion_of_records"], curves["dispersion_of_parameters"] = parts
    return curves


def _split_dispersion(
    counts: np.ndarray, levels: np.ndarray, number: int
) -> tuple[np.ndarray, np.ndarray]:
    """Split the dispersion by the law of total variance, for counts (samples, ..., levels, n).

    Within a sample only the records scatter; from sample to sample, the medians do. NaN where
    no more than half of the samples have a curve.
    """
    samples = len(counts)
    lines = np.moveaxis(counts, -1, -2)
    shape = lines.shape[1:-1]
    fits = [fit_lognormal(levels, line, number) for line in lines.reshape(-1, len(levels))]
    medians, dispersions = (
        np.array([fit[k] for fit in fits], float).reshape(samples, -1) for k in range(2)
    )
    of_records = np.full(medians.shape[1], np.nan)
    of_parameters = of_records.copy()
    for column in range(medians.shape[1]):
        found = np.isfinite(medians[:, column])
        # Samples without a curve are never or always beyond: what is left of them would be
        # too narrow if they were many.
        if found.sum() > samples // 2:
            of_records[column] = (dispersions[found, column] ** 2).mean() ** 0.5
            of_parameters[column] = np.log(medians[found, column]).std()
    return of_records.reshape(shape), of_parameters.reshape(shape)
