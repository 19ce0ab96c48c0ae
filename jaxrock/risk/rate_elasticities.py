"""Elasticities of the rate of overturning, at a point and over a change."""

from collections.abc import Mapping, Sequence
from typing import cast, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..block import SIZES_IN_WORDS, Block, SizeDescription, block_of, size_of
from ..host import Printed, format_fields, format_table, name_work
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import Number, Reals, as_name, check_kind
from .objects import Objects, gather_objects
from .outcome_table import Cases, compute_rates, tabulate_outcomes
from .overturning_rate import OverturningRate, overturning_rate
from .site import Site

# Standard error of the rates at both ends of a change by the width of the intervals in which
# boundaries are located, over the change: an elasticity is accurate to about as much.
_ACCURACY = 2e-4
# Decimal places to which two blocks are the same, beyond the digits of single precision.
_DIGITS = 12


class RateElasticities(Printed, eqx.Module):
    """Elasticities of the rate of overturning, in % for 1 %; see `rate_elasticities`.

    Attributes
    ----------
    names : tuple of str
        Names of the parameters of the block, and the restitution.
    at_point : Array, shape (names, ...)
        From the derivatives of the detected boundaries [-].
    over_change : Array, shape (names, ...)
        From the rates at both ends of the change [-].
    change : float
        Relative change of a parameter, to either side.
    rate : OverturningRate
        The rate itself.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    at_point: Float[Array, " names ..."]
    over_change: Float[Array, " names ..."]
    change: float = eqx.field(static=True)
    rate: OverturningRate

    def __str__(self) -> str:
        if np.ndim(self.rate.rate):
            return format_fields(self, at_point="", over_change="")
        over = {f"over_+-{100 * self.change:g}%": np.asarray(self.over_change)}
        columns = {**over, "at_the_point": np.asarray(self.at_point)}
        labels = [SIZES_IN_WORDS.get(name, name) for name in self.names]
        return format_table("elasticities of the rate", labels, **columns)


def rate_elasticities(
    block: Block,
    restitution: Number,
    site: Site,
    *,
    change: float = 0.05,
    by: SizeDescription = "shape",
    model: ModelLike = Nonlinear(),
) -> RateElasticities:
    """Compute how much the rate of overturning changes with each parameter, in two ways.

    The derivative of `overturning_rate` is exact for the detected boundaries. If a block
    rocks for long before it overturns, many of these enclose narrow windows and move fast in
    unrelated directions. The derivative is then irregular, and does not predict the effect of
    a larger change. The difference of the rates at both ends of a change averages over such
    windows. Use the derivative where the two agree, else the difference.

    Parameters
    ----------
    block, restitution, site, model
        As in `overturning_rate`.
    change : float
        Relative change to either side, greater than 0 and less than 0.5. The inertia ratio is
        lowered to 1 at most, and C is raised at most halfway to 1.
    by : {"shape", "sides", "dynamics"}
        Parameters that describe the block: half-width at this slenderness and slenderness;
        width at this height and height at this width; or critical angle and frequency
        parameter.

    Returns
    -------
    RateElasticities
        NaN where the rate is 0.

    Raises
    ------
    ValueError
        As in `overturning_rate`, or if `change` or `by` is out of range.

    Examples
    --------
    >>> import jaxrock as jr
    >>> suite = jr.Suite([jr.Record([0.0, 4.0, 4.0, -4.0, -4.0, 0.0], time_step=0.1)])
    >>> site = jr.Site(suite, jr.Hazard(levels=[0.4, 4.0], rates=[1e-2, 1e-4]))
    >>> answer = jr.risk.rate_elasticities(jr.Block(0.1, 5.0), 0.8, site)
    >>> print(answer.names[4], f"{answer.over_change[4]:.2f} {answer.at_point[4]:.2f}")
    restitution 2.30 2.22
    """
    if not isinstance(change, float | int) or not 0 < change < 0.5:
        raise ValueError(
            f"change must be greater than 0 and less than 0.5, got {change!r:.60}"
        )
    check_kind("site", site, Site)
    by = cast("SizeDescription", as_name("by", by, get_args(SizeDescription)))
    objects = gather_objects(block, restitution)
    parameters = list_parameters(objects, by)

    def sum_rates(parameters: Mapping[str, Reals]) -> tuple[Reals, OverturningRate]:
        changed = block_of(parameters, objects.block.one_sided)
        rate = overturning_rate(changed, parameters["restitution"], site, model=model)
        # Each rate depends on the parameters of its own object only.
        return rate.rate.sum(), rate

    derivatives, rate = jax.grad(sum_rates, has_aux=True)(
        {name: jnp.asarray(value) for name, value in parameters.items()}
    )
    names = tuple(parameters)
    at = np.stack([np.asarray(value, float) for value in parameters.values()])
    derivative = np.stack([np.asarray(derivatives[name], float) for name in names])
    over_change = compute_elasticities(
        objects,
        parameters,
        names,
        site,
        as_model(model),
        change,
        change * _ACCURACY,
        np.asarray(rate.rate),
    )
    # A rate of 0 has no elasticity: NaN, without a warning.
    with np.errstate(invalid="ignore", divide="ignore"):
        at_point = derivative * at / np.asarray(rate.rate)
    dtype = rate.rate.dtype
    return RateElasticities(
        names,
        jax.device_put(at_point.astype(dtype)),
        jax.device_put(over_change.astype(dtype)),
        float(change),
        rate,
    )


def list_parameters(objects: Objects, by: SizeDescription) -> dict[str, np.ndarray]:
    """List the parameters of objects by their names, the restitution last."""
    block = jax.tree.map(np.asarray, objects.block)
    sizes = {name: np.asarray(value) for name, value in size_of(block, by).items()}
    return {**sizes, "restitution": np.asarray(objects.restitution)}


def compute_elasticities(
    objects: Objects,
    parameters: Mapping[str, np.ndarray],
    names: Sequence[str],
    site: Site,
    model: RockingModel,
    change: float,
    accuracy: float,
    rate: np.ndarray,
) -> np.ndarray:
    """Compute elasticities of rates from those at both ends of a change.

    Parameters
    ----------
    objects : Objects
    parameters : mapping
        All parameters of the objects; see `list_parameters`.
    names : sequence of str
        Those that are changed.
    site, model : Site, Nonlinear or Linearized
    change : float
        Relative change of a parameter, to either side.
    accuracy : float
        Relative, of the rates at the ends.
    rate : ndarray
        Of the shape of the objects [1/yr].

    Returns
    -------
    ndarray, shape (names, ...)
        NaN where the rate is 0.
    """
    changed: dict[str, list[np.ndarray]] = {name: [] for name in parameters}
    spans = []
    for name in names:
        value = parameters[name]
        low, high = (value * (1 + sign * change) for sign in (-1, 1))
        if name == "inertia_ratio":
            low = np.maximum(low, 1.0)
        if name == "restitution":
            # With C = 1 a block would bounce without end: it goes halfway there at most.
            high = np.minimum(high, 0.5 * (1 + value))
        # A restitution of 0 has no elasticity: NaN, without a warning.
        with np.errstate(invalid="ignore", divide="ignore"):
            spans.append((high - low) / value)
        for end in (low, high):
            for other, values in parameters.items():
                changed[other].append(end if other == name else values)
    dtype = np.asarray(objects.restitution).dtype
    rows = {name: np.stack(ends).reshape(-1).astype(dtype) for name, ends in changed.items()}
    block = block_of(rows, objects.block.one_sided)
    # A block feels its half-width and its inertia ratio by the frequency parameter alone: rows
    # that differ in nothing else are simulated once.
    product = np.asarray(block.inertia_ratio) * np.asarray(block.half_width)
    felt = np.stack([product, block.slenderness, block.gravity, rows["restitution"]])
    _, first, place = np.unique(
        felt.round(_DIGITS), axis=1, return_index=True, return_inverse=True
    )
    block = jax.tree.map(lambda leaf: np.asarray(leaf)[first], block)
    ends = objects._replace(block=block, restitution=rows["restitution"][first], names=())
    cases = Cases.of(ends, site, model)
    levels = np.asarray(site.levels)
    with name_work("elasticities"):
        rates = compute_rates(cases, tabulate_outcomes(cases, levels), levels, accuracy)
    at_ends = rates.rate[place.reshape(-1)].reshape(len(names), 2, *objects.shape)
    low, high = at_ends.swapaxes(0, 1)
    # A rate of 0 has no elasticity: NaN, without a warning.
    with np.errstate(invalid="ignore", divide="ignore"):
        elasticities = (high - low) / np.stack(spans) / rate
    return np.where(np.isfinite(elasticities), elasticities, np.nan)
