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
from ..resonance import ModelLike, Nonlinear
from ..validation import Number, Reals, as_name, check_kind
from .objects import Objects, gather_objects
from .outcome_table import compute_outcomes
from .overturning_rate import OverturningRate, overturning_rate
from .site import Site

# Relative width of the intervals in which the boundaries at both ends of a change are located:
# an elasticity is then accurate to some 1e-4.
_TOLERANCE = 1e-5
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
    rates = np.asarray(rate.rate)
    over_change = compute_elasticities(
        parameters, tuple(parameters), objects.block.one_sided, site, model, change, rates
    )
    derivative = np.stack([derivatives[name] for name in parameters])
    # A rate of 0 has no elasticity: NaN, without a warning.
    with np.errstate(invalid="ignore", divide="ignore"):
        at_point = derivative * np.stack([*parameters.values()]) / rates
    at_point, over_change = (
        jax.device_put(part.astype(rates.dtype)) for part in (at_point, over_change)
    )
    return RateElasticities(tuple(parameters), at_point, over_change, float(change), rate)


def list_parameters(objects: Objects, by: SizeDescription) -> dict[str, np.ndarray]:
    """List the parameters of objects by their names, the restitution last."""
    block = jax.tree.map(np.asarray, objects.block)
    sizes = {name: np.asarray(value) for name, value in size_of(block, by).items()}
    return {**sizes, "restitution": np.asarray(objects.restitution)}


def compute_elasticities(
    parameters: Mapping[str, np.ndarray],
    names: Sequence[str],
    one_sided: bool,
    site: Site,
    model: ModelLike,
    change: float,
    rate: np.ndarray,
) -> np.ndarray:
    """Compute elasticities of rates from those at both ends of a change.

    Parameters
    ----------
    parameters : mapping
        All parameters of the objects; see `list_parameters`.
    names : sequence of str
        Those that are changed.
    one_sided : bool
        Whether the objects stand against a wall.
    site, model : Site, Nonlinear or Linearized
    change : float
        Relative change of a parameter, to either side.
    rate : ndarray
        Of the shape of the objects [1/yr].

    Returns
    -------
    ndarray, shape (names, ...)
        NaN where the rate is 0.
    """
    values = np.stack([*parameters.values()])
    # Of shape (parameters, ends, names, ...): in each, one parameter is changed.
    changed = np.repeat(np.repeat(values[:, None, None], 2, axis=1), len(names), axis=2)
    spans = np.empty((len(names), *rate.shape))
    for k, name in enumerate(names):
        value = parameters[name]
        low, high = (value * (1 + sign * change) for sign in (-1, 1))
        if name == "inertia_ratio":
            low = np.maximum(low, 1.0)
        if name == "restitution":
            # With C = 1 a block would bounce without end: it goes halfway there at most.
            high = np.minimum(high, 0.5 * (1 + value))
        changed[list(parameters).index(name), :, k] = low, high
        spans[k] = high - low
    *sizes, restitution = changed.reshape(len(parameters), -1)
    block = block_of(dict(zip(parameters, sizes, strict=False)), one_sided)
    # A block feels its half-width and its inertia ratio by the frequency parameter alone: rows
    # that differ in nothing else are simulated once.
    product = np.asarray(block.inertia_ratio) * np.asarray(block.half_width)
    felt = np.stack([product, block.slenderness, block.gravity, restitution]).round(_DIGITS)
    _, first, place = np.unique(felt, axis=1, return_index=True, return_inverse=True)
    block = jax.tree.map(lambda leaf: np.asarray(leaf)[first], block)
    with name_work("elasticities"):
        table = compute_outcomes(block, restitution[first], site, model, tolerance=_TOLERANCE)
    rates = table.contributions.mean(axis=0)[place.reshape(-1)]
    low, high = rates.reshape(2, len(names), *rate.shape)
    own = np.stack([parameters[name] for name in names])
    # Nor has a restitution of 0 an elasticity.
    with np.errstate(invalid="ignore", divide="ignore"):
        elasticities = (high - low) / (spans / own) / rate
    return np.where(np.isfinite(elasticities), elasticities, np.nan)
