"""Inverse design of a rate: the value from which on it stays below a target."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ..block import Block
from ..host import Printed, format_fields, name_work
from ..impact import read_restitution
from ..overturning import UNITS
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import (
    AT_LEAST_ONE,
    POSITIVE,
    UNIT_INTERVAL,
    AnyArray,
    Booleans,
    Domain,
    Integers,
    Number,
    Reals,
    as_name,
    as_real,
    check,
    check_concrete,
    check_kind,
    is_traced,
)
from .objects import change_objects, change_parameter, gather_objects
from .outcome_table import compute_outcomes
from .overturning_rate import average_records, overturning_rate
from .site import Site
from .site_boundaries import EXACT
from .value_scan import read_scan, scan_values

# What may be designed, and the values that it may have.
_QUANTITIES: dict[str, Domain] = {
    **dict.fromkeys(("width", "height", "half_width", "slenderness"), POSITIVE),
    "inertia_ratio": AT_LEAST_ONE,
    "restitution": UNIT_INTERVAL,
}
# Relative distance of neighbouring values at a crossing.
_RESOLUTION = 5e-3
# Two derivatives of the rate, at the value and over 5 % to either side of it, that differ by
# less than this fraction: then the rate is smooth there.
_SMOOTH = 0.25
_OVER = 0.05


class RequiredValue(Printed, eqx.Module):
    """The value beyond which a rate stays below a target.

    See `required_value`.

    Attributes
    ----------
    value : Array, shape (...)
        In the unit of the parameter; inf (or -inf, where lower values are safe) if there is
        none within the bounds.
    rate : Array, shape (...)
        The rate of overturning there [1/yr], not above the target; NaN where there is no
        value.
    not_detected : Array, shape (...)
        See `OverturningRate` [1/yr].
    crossings : Array, shape (..., crossings)
        The crossings of the target that were found, each at its safe end, in increasing order;
        NaN beyond their number.
    count : Array of int, shape (...)
        Number of crossings.
    complete : Array of bool, shape (...)
        As in `OverturningRate`; False where there is no value.
    reasons : tuple of str
        For each object, why the value is what it is.
    along : str
        The parameter.
    """

    value: Reals
    rate: Reals
    not_detected: Reals
    crossings: Reals
    count: Integers
    complete: Booleans
    reasons: tuple[str, ...] = eqx.field(static=True)
    along: str = eqx.field(static=True)

    def __str__(self) -> str:
        if np.ndim(self.value) or is_traced(self.value):
            unit = UNITS.get(self.along, "")
            return format_fields(self, value=unit, rate="1/yr", count="", complete="")
        return self.reasons[0]


def required_value(
    block: Block,
    restitution: Number,
    site: Site,
    target: Number,
    along: str = "width",
    bounds: tuple[Number, Number] = (0.1, 10.0),
    *,
    model: ModelLike = Nonlinear(),
) -> RequiredValue:
    """Find the value of a parameter from which on the rate stays below a target.

    The rate is computed on a grid between the bounds, and the grid is refined at every crossing
    of the target until neighbouring values are 0.5 % apart. The rate need not be monotone, so
    there may be several crossings; the outermost one on the safe side is returned. Lower values
    are safe of a height, a slenderness or a restitution, higher values of anything else.

    Parameters
    ----------
    block : Block
        One block, or many along one axis.
    restitution : array_like
        C [-], between 0 and 1; one, or one for each block.
    site : Site
    target : float, or one for each block
        Greater than 0 [1/yr].
    along : str
        ``"width"`` [m] at this height, ``"height"`` [m] at this width, ``"half_width"`` [m] at
        this slenderness, ``"slenderness"`` at this width, ``"inertia_ratio"`` or
        ``"restitution"``.
    bounds : pair of array_like
        The lowest and the highest value to examine, for all objects or for each.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.

    Returns
    -------
    RequiredValue

    Raises
    ------
    ValueError
        If an argument is out of range or traced by `jit`, or an integration does not finish.

    Notes
    -----
    The rate at the value is the one of `overturning_rate`, not interpolated, and does not
    exceed the target. Rates far from the target are estimated from part of the levels.
    Crossings between two values of the first grid, 10 % apart, are not detected if the rate is
    far from the target at both, nor are crossings closer together than 0.5 %.

    Under records the rate changes by a few per cent from one width to the next, as narrow
    windows appear and disappear. Between the examined values it may exceed the target by a few
    per cent. A test with two blocks under the example suite computed the rate at 150 widths
    above the value. For one block it exceeded the target at 4 % of these widths, by up to
    1.3 %.

    Derivatives with respect to the target, the block, the restitution and the hazard follow
    from the implicit function theorem and the derivatives of `overturning_rate`. They are NaN
    where the rate is not smooth: where its derivative at the value differs by more than a
    quarter from its difference quotient over 5 % to either side, as under records with many
    narrow windows.

    Examples
    --------
    >>> import jaxrock as jr
    >>> suite = jr.Suite([jr.Record([0.0, 4.0, 4.0, -4.0, -4.0, 0.0], time_step=0.1)])
    >>> site = jr.Site(suite, jr.Hazard(levels=[0.4, 4.0], rates=[1e-2, 1e-4]))
    >>> cabinet = jr.Block.from_size(width=0.2, height=1.0)
    >>> print(jr.required_value(cabinet, 0.8, site, 1e-3, "width", (0.2, 1.0)))
    0.446391 m, width at this height: from there on the rate stays below 0.001 1/yr
    """
    along = as_name("along", along, _QUANTITIES)
    check_kind("site", site, Site)
    target = as_real("target", target)
    check("target", target, POSITIVE)
    ends = _check_bounds(bounds, along)
    parts = (block, read_restitution(block, restitution), site, target)
    with name_work(f"required {along.replace('_', '-')}"):
        return search_value(parts, ends=ends, along=along, model=as_model(model))


def _check_bounds(bounds: tuple[Number, Number], along: str) -> tuple[np.ndarray, np.ndarray]:
    """Return both bounds as arrays; a `ValueError` if they are not allowed."""
    if len(bounds) != 2:
        raise ValueError(f"bounds must be two values, low and high, got {len(bounds)} of them")
    for bound in bounds:
        check("bounds", as_real("bounds", bound), _QUANTITIES[along])
    low, high = (np.asarray(bound, float) for bound in bounds)
    if not (low < high).all():
        raise ValueError(f"bounds must be a lower and a higher value, got {low} and {high}")
    return low, high


_Parts = tuple[Block, AnyArray, Site, AnyArray]


@eqx.filter_custom_jvp
def search_value(
    parts: _Parts,
    *,
    ends: tuple[AnyArray, AnyArray],
    along: str,
    model: RockingModel,
    resolution: float = _RESOLUTION,
) -> RequiredValue:
    """Search the value, for arguments that have been checked but for those of objects.

    `resolution` is the relative distance of neighbouring values at a crossing.
    """
    block, restitution, site, target = parts
    check_concrete(parts, "the search depends on the answers")
    objects = gather_objects(block, restitution)
    low, high, targets = _broadcast_to_objects(objects.number, *ends, target)
    scans = scan_values(objects, along, site, model, (low, high), targets, resolution)
    answers = [
        read_scan(*scan, float(goal), along, float(site.rates[-1]))
        for scan, goal in zip(scans, targets, strict=True)
    ]
    values = np.array([answer.value for answer in answers])
    columns = max(answer.crossings.size for answer in answers)
    crossings = np.full((objects.number, columns), np.nan)
    for row, answer in zip(crossings, answers, strict=True):
        row[: answer.crossings.size] = answer.crossings
    # Those without a value are simulated at their lower bound, and taken out afterwards.
    exists = np.isfinite(values)
    indices = np.arange(objects.number)
    changed = change_objects(objects, indices, np.where(exists, values, low), along)
    table = compute_outcomes(changed.block, changed.restitution, site, model, tolerance=EXACT)
    means = average_records(table, site.suite.directions)
    real = {
        "value": values,
        "rate": np.where(exists, means.rate, np.nan),
        "not_detected": np.where(exists, means.not_detected, np.nan),
        "crossings": crossings,
    }
    fields = {name: entries.astype(table.levels.dtype) for name, entries in real.items()}
    fields["count"] = np.array([answer.crossings.size for answer in answers])
    fields["complete"] = exists & means.complete
    for name, entries in fields.items():
        fields[name] = jax.device_put(entries.reshape((*objects.shape, *entries.shape[1:])))
    reasons = tuple(answer.reason for answer in answers)
    return RequiredValue(**fields, reasons=reasons, along=along)


def _broadcast_to_objects(number: int, *arrays: Number) -> list[np.ndarray]:
    """Give every object a value of each array; a `ValueError` if they do not fit."""
    try:
        return [np.broadcast_to(np.asarray(values, float), (number,)) for values in arrays]
    except ValueError:
        shapes = ", ".join(str(np.shape(values)) for values in arrays)
        raise ValueError(
            "bounds and target must be single values, or one for each object, got shapes"
            f" {shapes}, where the number of objects is {number}"
        ) from None


@search_value.def_jvp
def _differentiate_value(
    primals: tuple[_Parts],
    tangents: tuple[tuple[PyTree, ...]],
    *,
    ends: tuple[AnyArray, AnyArray],
    along: str,
    model: RockingModel,
    resolution: float = _RESOLUTION,
) -> tuple[RequiredValue, RequiredValue]:
    """Differentiate the value by the implicit function theorem: the rate stays the target."""
    (parts,) = primals
    (changes,) = tangents
    fixed = parts[:3]
    answer = search_value(parts, ends=ends, along=along, model=model, resolution=resolution)
    value = answer.value
    safe = jnp.where(jnp.isfinite(value), value, jnp.asarray(ends[0], value.dtype))

    def compute_rate(block: Block, restitution: AnyArray, site: Site, value: Reals) -> Reals:
        changed = change_parameter(block, restitution, along, value)
        return overturning_rate(*changed, site, model=model).rate

    # No value, or one at a bound because there is no crossing, does not move.
    still = ~jnp.isfinite(value) | (answer.count == 0)
    domain = _QUANTITIES[along]
    around = jnp.clip(
        jnp.stack([safe * (1 - _OVER), safe * (1 + _OVER)]),
        1.0 if domain is AT_LEAST_ONE else 0.0,
        1.0 if domain is UNIT_INTERVAL else jnp.inf,
    )
    # The derivative at the value, and the difference over a change to either side.
    _, at_point = jax.jvp(
        functools.partial(compute_rate, *fixed), (safe,), (jnp.ones_like(safe),)
    )
    low, high = (compute_rate(*fixed, end) for end in around)
    over = (high - low) / (around[1] - around[0])
    smooth = (at_point != 0) & (abs(at_point - over) <= _SMOOTH * abs(over))
    _, moved = eqx.filter_jvp(
        lambda block, restitution, site: compute_rate(block, restitution, site, safe),
        fixed,
        tuple(changes[:3]),
    )
    goal = jnp.zeros_like(value) if changes[3] is None else changes[3]
    # NaN as a factor: in place of the product it would be 0 in reverse mode.
    per_rate = jnp.where(smooth, 1 / jnp.where(smooth, at_point, 1), jnp.nan)
    change = (goal - (0 if moved is None else moved)) * jnp.where(still, 0, per_rate)
    nothing = jax.tree.map(lambda leaf: None, answer)
    return answer, eqx.tree_at(
        lambda tree: tree.value, nothing, change, is_leaf=lambda leaf: leaf is None
    )
