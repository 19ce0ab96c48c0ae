"""Fragility: how many motions of a suite bring a block beyond a limit, over their intensity."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from ..accuracy import respond_within
from ..block import Block
from ..ground_motion import MEASURES, Suite
from ..host import labelled, with_names
from ..resonance import ModelLike, Nonlinear, as_model
from ..validation import POSITIVE, Number, Numbers, as_real, check, check_kind
from .lognormal import fit_lognormal

if TYPE_CHECKING:
    import xarray

Threshold = float | int | str
_WORDS = ("uplift", "overturning")
# Long name and unit of what is said of every record at every level.
_RESPONSES = {
    "rotation_ratio": ("peak rotation over critical angle", "1"),
    "peak_rotation": ("peak rotation", "rad"),
    "overturned": ("1 where the block overturns", "1"),
    "margin": ("margin at the end of the input, overturns below 0", "1"),
    "impacts": ("number of impacts", "1"),
    "error": ("upper bound of the relative error of the peak rotation", "1"),
    "within_tolerance": ("1 where that is within the tolerance", "1"),
}


def fragility(
    block: Block,
    restitution: Number,
    suite: Suite,
    levels: Numbers,
    measure: str = "pgv",
    thresholds: Sequence[Threshold] = ("uplift", 0.5, 1.0, "overturning"),
    *,
    tolerance: float = 1e-3,
    confidence: float = 0.95,
    model: ModelLike = Nonlinear(),
) -> "xarray.Dataset":
    """Shares of a suite that bring a block beyond thresholds, at levels of an intensity measure.

    Parameters
    ----------
    block : Block
        One block.
    restitution : float
        C [-], between 0 and 1.
    suite : Suite
    levels : array_like, shape (n,)
        Increasing levels to which each record is scaled [unit of the measure].
    measure : str
        ``"pgv"``, ``"pga"``, ``"pgv_ratio"`` or ``"pga_ratio"``; see `intensity_measure`.
    thresholds : sequence of float or str
        Rotation ratios alpha_max / alpha_c [-], greater than 0, ``"uplift"``, which is any
        rotation, or ``"overturning"``, which is beyond every ratio as well.
    tolerance : float
        On peak rotations, relative; see `respond_within`.
    confidence : float
        Of the intervals, between 0 and 1.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.

    Returns
    -------
    xarray.Dataset
        Over level and threshold ``exceedance``, the share of records, with the exact (binomial)
        interval ``exceedance_low`` to ``exceedance_high``, and ``lognormal``, the most likely
        lognormal curve; both take the records for independent. Over threshold its
        ``lognormal_median`` and ``lognormal_dispersion``, and a ``remark``, which says where it
        does not fit: overturning is not monotone in the level. Over level
        ``share_within_tolerance``; elsewhere the response is chaotic. Over record and level
        every response, and the factor on the record.

    Raises
    ------
    ValueError
        If an argument is outside of what is allowed, a record has no intensity, or a motion
        could not be followed.

    Examples
    --------
    >>> import jaxrock as jr
    >>> suite = jr.Suite([jr.Record([0.0, a, a, -a, -a, 0.0], 0.1) for a in (2.0, 3.0)])
    >>> curves = jr.fragility(jr.Block(0.1, 5.0), 0.8, suite, [0.2, 0.8])
    >>> print(curves.exceedance.sel(threshold="overturning").values)
    [0. 1.]
    """
    check_kind("block", block, Block)
    check_kind("suite", suite, Suite)
    restitution = as_real("restitution", restitution)
    if any(leaf.shape for leaf in jax.tree.leaves((block, restitution))):
        raise ValueError("block and restitution must be single ones, got arrays of them")
    if any(np.shape(record.scale) for record in suite):
        raise ValueError("scales of records must be single ones, got arrays of them")
    check("levels", as_real("levels", levels), POSITIVE)
    places = np.asarray(levels, float)
    if places.ndim != 1 or not places.size:
        raise ValueError(f"levels must be one-dimensional, got an array of shape {places.shape}")
    if (np.diff(places) <= 0).any():
        raise ValueError("levels must be increasing, got values that do not increase")
    if not 0 < confidence < 1:
        raise ValueError(f"confidence must be between 0 and 1, got {confidence!r}")
    names = threshold_names(thresholds)
    model = as_model(model)
    factors = suite.factors(places, measure, block)
    estimate = respond_within(block, restitution, suite.scaled(factors), tolerance, model=model)
    response = estimate.response
    if not bool(response.complete.all()):
        raise ValueError("motion could not be followed to its end for every record and level")
    ratio = np.asarray(response.peak_rotation / block.critical_angle)
    values = {"rotation_ratio": ratio, **vars(estimate), **vars(response)}
    each = {"factor": (("record", "level"), np.asarray(factors), _about("factor on the record"))}
    for name, about in _RESPONSES.items():
        entries = np.asarray(values[name])
        entries = entries.astype(np.int8) if entries.dtype == bool else entries
        each[name] = (("record", "level"), entries, _about(*about))
    overturned = np.asarray(response.overturned)
    beyond = [_exceeds(threshold, ratio, overturned) for threshold in thresholds]
    counts = np.stack([exceeded.sum(axis=0) for exceeded in beyond], axis=-1)
    within = np.asarray(estimate.within_tolerance).mean(axis=0)
    chaos = _about("share of records whose answer is within tolerance")
    attributes = {
        "model": model.name,
        "half_width": float(block.half_width),
        "slenderness": float(block.slenderness),
        "gravity": float(block.gravity),
        "inertia_ratio": float(block.inertia_ratio),
        "restitution": float(restitution),
        "measure": measure,
        "records": len(suite),
        "tolerance": tolerance,
        "confidence": confidence,
    }
    dataset = labelled(
        "Fragility",
        {
            **_curves(counts, places, len(suite), confidence, MEASURES[measure][1]),
            "share_within_tolerance": (("level",), within, chaos),
            **each,
        },
        {"level": (("level",), places, _about(*MEASURES[measure][:2]))},
        attributes,
    )
    return with_names(
        dataset, record=(suite.names, "ground motion"), threshold=(names, "threshold")
    )


def _about(long_name: str, units: str = "1") -> dict[str, str]:
    return {"long_name": long_name, "units": units.replace("m/s2", "m s-2").replace("m/s", "m s-1")}


def threshold_names(thresholds: Sequence[Threshold]) -> list[str]:
    """Thresholds as their labels; a `ValueError` if they are not allowed."""
    names = [_name(threshold) for threshold in thresholds]
    if not names or len(set(names)) < len(names):
        got = ", ".join(names) or "none"
        raise ValueError(f"thresholds must be at least one, each only once, got {got}")
    return names


def _name(threshold: Threshold) -> str:
    """A threshold as its label; a `ValueError` if it is none."""
    if isinstance(threshold, str):
        if threshold not in _WORDS:
            must = f"thresholds must be rotation ratios, {' or '.join(map(repr, _WORDS))}"
            raise ValueError(f"{must}, got {threshold!r}")
        return threshold
    check("thresholds", as_real("thresholds", threshold), POSITIVE)
    return f"{float(threshold):g}"


def _exceeds(threshold: Threshold, ratio: np.ndarray, overturned: np.ndarray) -> np.ndarray:
    if threshold == "uplift":
        return ratio > 0
    if threshold == "overturning":
        return overturned
    return (ratio > float(threshold)) | overturned


def _curves(
    counts: np.ndarray, levels: np.ndarray, number: int, confidence: float, unit: str
) -> dict[str, Any]:
    """Counted and fitted curves, for counts of shape (levels, thresholds)."""
    from scipy.stats import binomtest

    def interval(count: int) -> tuple[float, float]:
        found = binomtest(count, number).proportion_ci(confidence)
        return found.low, found.high

    of_count = np.array([interval(count) for count in range(number + 1)])
    low, high = of_count[counts, 0], of_count[counts, 1]
    fits = [fit_lognormal(levels, column, number) for column in counts.T]
    fitted = np.stack([fit.at(levels) for fit in fits], axis=-1)
    remarks = []
    for k, fit in enumerate(fits):
        outside = int(((fitted[:, k] < low[:, k]) | (fitted[:, k] > high[:, k])).sum())
        falls = int((np.diff(counts[:, k]) < 0).sum())
        words = [fit.remark] if fit.remark else []
        if outside:
            words.append(f"outside of the intervals at {outside} of {len(levels)} levels")
        if falls:
            words.append(f"the counted share falls {falls} time{'s' * (falls > 1)}")
        remarks.append("; ".join(words))
    both, ends = ("level", "threshold"), f"of the interval with a confidence of {confidence:g}"
    medians, dispersions = ([fit[k] for fit in fits] for k in range(2))
    return {
        "exceedance": (both, counts / number, _about("share of records beyond the threshold")),
        "exceedance_low": (both, low, _about(f"lower end {ends}")),
        "exceedance_high": (both, high, _about(f"upper end {ends}")),
        "lognormal": (both, fitted, _about("most likely lognormal curve")),
        "lognormal_median": (
            ("threshold",),
            medians,
            _about("median of the lognormal curve", unit),
        ),
        "lognormal_dispersion": (
            ("threshold",),
            dispersions,
            _about("its standard deviation of ln(level)"),
        ),
        "remark": (("threshold",), np.asarray(remarks, str), {"long_name": "on the curve"}),
    }
