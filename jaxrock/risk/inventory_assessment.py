"""Many objects under many records: ranked by rate, and what would bring each to a target."""

import functools
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import jax
import numpy as np

from ..block import SIZES_IN_WORDS, Block
from ..ground_motion import MEASURES, Suite, require_positive_measures
from ..host import add_names, make_dataset
from ..overturning import uplift_factor
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import POSITIVE, Numbers, as_real, check, check_kind
from .counted_rate import Counting, plan_counting
from .exceedance import describe_variable
from .hazard import Hazard, find_last_point
from .inventory import Inventory
from .inventory_outcomes import CONFIDENCE, PARAMETERS, ObjectRisk, follow_objects, follow_rows
from .overturning_rate import check_hazard, choose_levels
from .required_value import RequiredValue, required_value

if TYPE_CHECKING:
    import xarray

# Return periods in years of the levels for probabilities: those of codes, 10 % and 2 % in 50
# years.
_RETURN_PERIODS = (475.0, 2475.0)
_RESOLUTION = 0.03  # relative, of required widths
# Widths that are examined, over the present one, and over the height. A block wider than 1.5
# times its height would need more than 1.5 g to be lifted.
_NARROWEST = 0.5
_WIDEST = 2.0
_WIDEST_OF_HEIGHT = 1.5
# Objects whose uplift is computed at once: of one size, so that one program does for any
# number of objects.
_TOGETHER = 32

# Dimensions, values and attributes of variables by name.
_Described = dict[str, tuple[tuple[str, ...], np.ndarray, Mapping[str, str]]]


def assess_inventory(
    inventory: Inventory,
    suite: Suite,
    hazard: Hazard,
    target: float,
    *,
    measure: str = "pgv",
    levels: Numbers | None = None,
    samples: int = 16,
    seed: int = 0,
    spacing: float = 0.04,
    model: ModelLike = Nonlinear(),
) -> "xarray.Dataset":
    """Rank objects by the yearly rate at which they overturn, and say what each would need.

    Parameters
    ----------
    inventory : Inventory
    suite : Suite
    hazard : Hazard
    target : float
        The rate that is tolerated, greater than 0 [1/yr].
    measure : {"pgv", "pga"}
        The intensity measure of the hazard [m/s], [m/s2].
    levels : array_like, shape (n,), optional
        Increasing levels of the measure for which probabilities are given; by default those
        with the return periods of 475 and 2,475 years, where the hazard has them.
    samples, seed : int
        Number of samples of each uncertain restitution, a power of 2, and the seed that they
        are drawn with. All records and levels share them.
    spacing : float
        Relative distance between the levels at which outcomes are counted, from 0.001 to 0.2.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.

    Returns
    -------
    xarray.Dataset
        Over ``object``, the highest rate first, with ``rank``: ``width``, ``height``,
        ``slenderness``, ``inertia_ratio``, ``restitution``, ``restitution_scatter``,
        ``critical_angle``; ``uplift_level``, the median over the records of the level that
        lifts it; ``median`` and ``dispersion`` of the most likely lognormal curve;
        ``rate`` of overturning with its ``standard_error`` (from record to record),
        ``counting_error`` (by the distance between levels) and ``unseen`` (see
        `overturning_rate`); ``required_width``, the width at this height from which on the
        rate stays below the target, inf where there is none, with ``required_width_reason``;
        ``most_important``, the parameter with the largest elasticity; a ``remark``.

        Over object and ``level``, with its ``return_period``, the ``probability`` to overturn,
        with its exact interval ``probability_low`` to ``probability_high`` (95 %), which takes
        the records for independent. Over object and ``parameter`` the ``elasticity``, the
        change of the rate in per cent for one per cent, over 10 % to either side, with
        ``elasticity_error``.

    Raises
    ------
    ValueError
        If an argument is out of range, a record has no intensity, or a motion could not be
        followed.

    Notes
    -----
    An uncertain restitution enters the rate and the probabilities. The required width and the
    elasticities are computed with the median restitution; no change of a restitution goes
    further than halfway to 1. Widths are examined from half the present one to the larger of
    twice the present one and 1.5 times the height, and the restitution stays what it is. The
    answers for an object do not depend on the others.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> import jaxrock as jr
    >>> suite = jr.Suite([jr.Record([0.0, 4.0, 4.0, -4.0, -4.0, 0.0], time_step=0.1)])
    >>> hazard = jr.Hazard(levels=[0.4, 4.0], rates=[1e-2, 1e-4])
    >>> block = jr.Block.from_size(width=jnp.array([0.4, 0.2]), height=1.0)
    >>> objects = jr.risk.Inventory(["bust", "vase"], block, restitution=0.8)
    >>> found = jr.risk.assess_inventory(objects, suite, hazard, target=1e-3)
    >>> print(found.object.values, (found.required_width > found.width).values)
    ['vase' 'bust'] [ True  True]
    """
    check_kind("inventory", inventory, Inventory)
    check_kind("suite", suite, Suite)
    check_kind("hazard", hazard, Hazard)
    measure = check_hazard(hazard, measure)
    if any(np.shape(record.scale) for record in suite):
        raise ValueError("scales of records must be single ones, got arrays of them")
    check("target", as_real("target", target), POSITIVE)
    if not isinstance(spacing, float | int) or not 1e-3 <= spacing <= 0.2:
        raise ValueError(f"spacing must be from 0.001 to 0.2, got {spacing!r:.60}")
    model = as_model(model)
    strengths = np.asarray(require_positive_measures(suite, measure))
    counting = _plan_levels(hazard, spacing)
    chosen = _choose_shown_levels(hazard, levels)
    follow = functools.partial(
        follow_rows, suite, strengths, np.concatenate([counting.levels, chosen]), model
    )
    each = follow_objects(inventory, follow, counting, samples, seed)
    required = _require_widths(inventory, suite, hazard, target, measure, counting, model)
    uplift = _find_uplift_levels(inventory.block, suite, strengths, model)
    rates = np.array([one.rate for one in each])
    order = np.argsort(-rates, kind="stable")
    found = _describe_objects(inventory)
    found |= _describe_answers(inventory, each, required, uplift, measure)
    ranked = {
        name: (dims, np.asarray(values)[order], about)
        for name, (dims, values, about) in found.items()
    }
    unit = describe_variable(*MEASURES[measure][:2])
    years = describe_variable("return period of the level", "yr")
    whole = make_dataset(
        "Inventory of objects, ranked by the rate at which they overturn",
        ranked,
        {
            "level": ("level", chosen, unit),
            "return_period": ("level", _compute_return_periods(hazard, chosen), years),
            "rank": ("object", np.arange(1, len(inventory) + 1), {"long_name": "rank"}),
        },
        {
            "measure": measure,
            "target": float(target),
            "record_count": len(suite),
            "hazard_curve": str(hazard),
            "model": model.name,
            "counting_levels": counting.levels.size,
            "samples": samples,
            "seed": seed,
        },
    )
    meant = [SIZES_IN_WORDS.get(name, name) for name in PARAMETERS]
    names = {
        "object": ([inventory.names[k] for k in order], "object"),
        "parameter": (meant, "parameter"),
    }
    return add_names(whole, **names)


def describe_need(found: "xarray.Dataset") -> str:
    """Describe in words whether an object needs another width for the target."""
    width = float(found.width)
    required = float(found.required_width)
    if float(found.rate) <= float(found.attrs["target"]):
        return "suffices"
    if math.isinf(required):
        return "no width suffices"
    if required > width:
        return f"needs {required:.2f} m"
    # The width is sought without the scatter of the restitution, which adds to the rate.
    return "misses the target by the scatter alone"


def _plan_levels(hazard: Hazard, spacing: float) -> Counting:
    """Plan the levels at which outcomes are counted, over all of the hazard curve."""
    low, high = np.asarray(hazard.levels, float)[[0, find_last_point(hazard)]].tolist()
    number = math.ceil(math.log(high / low) / spacing) + 1
    places = choose_levels(hazard, np.geomspace(low, high, max(3, number)))
    return plan_counting(hazard, np.asarray(places))


def _choose_shown_levels(hazard: Hazard, levels: Numbers | None) -> np.ndarray:
    """Choose the levels for probabilities; a `ValueError` if they are not allowed."""
    if levels is None:
        rates = np.asarray(hazard.rates, float)
        rates = rates[rates > 0]
        of_codes = np.array([1 / years for years in _RETURN_PERIODS])
        inside = of_codes[(of_codes <= rates[0]) & (of_codes >= rates[-1])]
        # A hazard that ends before both: the middle of it.
        wanted = inside if inside.size else np.sqrt(rates[:1] * rates[-1:])
        logarithms = np.log(np.asarray(hazard.levels, float)[: rates.size])
        return np.exp(np.interp(-np.log(wanted), -np.log(rates), logarithms))
    check("levels", as_real("levels", levels), POSITIVE)
    places = np.asarray(levels, float)
    if places.ndim != 1 or not places.size:
        must = "levels must be one-dimensional, of at least one value"
        raise ValueError(f"{must}, got an array of shape {places.shape}")
    if (np.diff(places) <= 0).any():
        raise ValueError("levels must be increasing, got values that do not increase")
    return places


def _compute_return_periods(hazard: Hazard, levels: np.ndarray) -> np.ndarray:
    """Compute return periods of levels: inf at a rate of 0, NaN outside of the hazard curve."""
    low, high = np.asarray(hazard.levels)[[0, -1]]
    # Levels that were found from the rates at the ends are outside by rounding.
    near = np.clip(levels, low, high)
    inside = np.isclose(near, levels, rtol=1e-6, atol=0)
    with np.errstate(divide="ignore"):
        periods = 1 / np.asarray(hazard(near.astype(low.dtype)))
    return np.where(inside, periods, np.nan)


def _require_widths(
    inventory: Inventory,
    suite: Suite,
    hazard: Hazard,
    target: float,
    measure: str,
    counting: Counting,
    model: RockingModel,
) -> RequiredValue:
    """Find the width at this height from which on the rate stays below the target."""
    width = 2 * np.asarray(inventory.block.half_width)
    height = width * np.asarray(inventory.block.slenderness)
    widest = np.maximum(_WIDEST * width, _WIDEST_OF_HEIGHT * height)
    return required_value(
        inventory.block,
        inventory.restitution,
        suite,
        hazard,
        target,
        "width",
        (_NARROWEST * width, widest),
        measure,
        counting.levels,
        resolution=_RESOLUTION,
        model=model,
    )


def _find_uplift_levels(
    block: Block, suite: Suite, strengths: np.ndarray, model: RockingModel
) -> np.ndarray:
    """Find the level that lifts each block: the median over the records."""
    number = len(np.asarray(block.half_width))
    found = []
    for start in range(0, number, _TOGETHER):
        # The last group is filled up with the last block.
        which = np.minimum(np.arange(start, start + _TOGETHER), number - 1)
        group = jax.tree.map(lambda leaf, which=which: np.asarray(leaf)[which], block)
        levels = [
            np.asarray(uplift_factor(group, record, model=model)) * strength
            for record, strength in zip(suite, strengths, strict=True)
        ]
        found.append(np.median(levels, axis=0))
    return np.concatenate(found)[:number]


def _describe_objects(inventory: Inventory) -> _Described:
    """Describe the geometry and the impacts of the objects."""
    block = inventory.block
    width = 2 * np.asarray(block.half_width)
    slenderness = np.asarray(block.slenderness)
    entries: dict[str, tuple[np.ndarray, str, str]] = {
        "width": (width, "width of the base", "m"),
        "height": (width * slenderness, "height, twice that of the centre of mass", "m"),
        "slenderness": (slenderness, "height over width", "1"),
        "inertia_ratio": (np.asarray(block.inertia_ratio), "inertia ratio", "1"),
        "restitution": (np.asarray(inventory.restitution), "restitution", "1"),
        "restitution_scatter": (
            np.asarray(inventory.restitution_scatter),
            "coefficient of variation of the restitution",
            "1",
        ),
        "critical_angle": (np.arctan(1 / slenderness), "critical angle", "rad"),
    }
    return {
        name: (("object",), values, describe_variable(long_name, units))
        for name, (values, long_name, units) in entries.items()
    }


def _describe_answers(
    inventory: Inventory,
    each: Sequence[ObjectRisk],
    required: RequiredValue,
    uplift: np.ndarray,
    measure: str,
) -> _Described:
    """Describe what was found for each object."""
    unit = MEASURES[measure][1]
    ends = f"of the interval with a confidence of {CONFIDENCE:g}"
    share = "probability to overturn at this level"
    # Long names and units, of fields of `ObjectRisk` by their names.
    fields: dict[str, tuple[tuple[str, ...], str, str]] = {
        "median": ((), "median of the lognormal curve of overturning", unit),
        "dispersion": (
            (),
            "dispersion of the lognormal curve: standard deviation of ln(level)",
            "1",
        ),
        "probability": (("level",), share, "1"),
        "probability_low": (("level",), f"{share}, lower end {ends}", "1"),
        "probability_high": (("level",), f"{share}, upper end {ends}", "1"),
        "rate": ((), "rate at which it overturns", "1/yr"),
        "standard_error": ((), "standard error of the rate, from record to record", "1/yr"),
        "counting_error": (
            (),
            "standard error of the rate, from counting at separate levels",
            "1/yr",
        ),
        "unseen": ((), "upper limit of what the levels miss of the rate", "1/yr"),
        "elasticity": (("parameter",), "change of the rate in % for 1 % more", "1"),
        "elasticity_error": (("parameter",), "standard error of it, by the levels", "1"),
    }
    found: _Described = {
        "uplift_level": (
            ("object",),
            uplift,
            describe_variable("level that lifts it, median over the records", unit),
        )
    }
    for name, (dims, long_name, units) in fields.items():
        values = np.array([getattr(one, name) for one in each])
        found[name] = (("object", *dims), values, describe_variable(long_name, units))
    found["required_width"] = (
        ("object",),
        np.asarray(required.value),
        describe_variable(
            "width at this height from which on the rate is below the target", "m"
        ),
    )
    texts = {
        "required_width_reason": (required.reasons, "reason of the required width"),
        "most_important": (
            [_name_most_important(one.elasticity) for one in each],
            "parameter with the largest elasticity",
        ),
        "remark": (
            [
                "; ".join(filter(None, (remark, one.remark)))
                for remark, one in zip(inventory.remarks, each, strict=True)
            ],
            "what was assumed and found",
        ),
    }
    for name, (words, long_name) in texts.items():
        found[name] = (("object",), np.asarray(words, str), {"long_name": long_name})
    return found


def _name_most_important(elasticity: np.ndarray) -> str:
    """Name the parameter with the largest elasticity; "none" where the rate is 0."""
    if not np.isfinite(elasticity).any():
        return "none"
    name = PARAMETERS[int(np.nanargmax(abs(elasticity)))]
    return SIZES_IN_WORDS.get(name, name)
