"""Elasticities of the rate of overturning, over a finite change of each parameter."""

from typing import cast, get_args

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from ..block import SIZES_IN_WORDS, Block, SizeDescription, block_of, size_of
from ..host import Printed, format_fields, format_table
from ..resonance import ModelLike, Nonlinear
from ..validation import Number, as_name, check_kind
from .objects import gather_objects
from .outcome_table import compute_outcomes
from .overturning_rate import OverturningRate, overturning_rate
from .site import Site

# Relative width of the intervals in which the boundaries at both ends of a change are located:
# an elasticity is then accurate to some 1e-4.
_TOLERANCE = 1e-5


class RateElasticities(Printed, eqx.Module):
    """Elasticities of the rate of overturning, in % for 1 %; see `rate_elasticities`.

    Attributes
    ----------
    names : tuple of str
        Names of the parameters of the block, and the restitution.
    elasticity : Array, shape (names, ...)
        From the rates at both ends of the change [-].
    change : float
        Relative change of a parameter, to either side.
    rate : OverturningRate
        The rate itself.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    elasticity: Float[Array, " names ..."]
    change: float = eqx.field(static=True)
    rate: OverturningRate

    def __str__(self) -> str:
        if np.ndim(self.rate.rate):
            return format_fields(self, elasticity="")
        labels = [SIZES_IN_WORDS.get(name, name) for name in self.names]
        columns = {f"over_+-{100 * self.change:g}%": np.asarray(self.elasticity)}
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
    """Compute how much the rate of overturning changes with each parameter.

    From the rates at both ends of a change. If a block rocks for long before it overturns, many
    boundaries enclose narrow windows and move fast in unrelated directions. The derivative of
    `overturning_rate`, exact for the boundaries that were detected, is then irregular and does
    not predict the effect of a larger change; the difference averages over such windows.

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
    >>> site = jr.risk.Site(suite, jr.risk.Hazard(levels=[0.4, 4.0], rates=[1e-2, 1e-4]))
    >>> answer = jr.risk.rate_elasticities(jr.Block(0.1, 5.0), 0.8, site)
    >>> print(answer.names[4], f"{answer.elasticity[4]:.2f}")
    restitution 2.30
    """
    if not isinstance(change, float | int) or not 0 < change < 0.5:
        raise ValueError(
            f"change must be greater than 0 and less than 0.5, got {change!r:.60}"
        )
    check_kind("site", site, Site)
    by = cast("SizeDescription", as_name("by", by, get_args(SizeDescription)))
    block, restitution = gather_objects(block, restitution)
    rate = overturning_rate(block, restitution, site, model=model)
    sizes = size_of(jax.tree.map(np.asarray, block), by)
    parameters = {**sizes, "restitution": restitution}
    names = tuple(parameters)
    values = np.stack([*parameters.values()])
    low, high = values * (1 - change), values * (1 + change)
    # The inertia ratio and the restitution are the last. With C = 1 a block would bounce without
    # end: it goes halfway there at most.
    low[-2] = np.maximum(low[-2], 1.0)
    high[-1] = np.minimum(high[-1], 0.5 * (1 + restitution))
    # One parameter after the other at its lower and at its higher value, on the last two axes.
    changed = np.tile(values[..., None, None], (2, len(names)))
    for k in range(len(names)):
        changed[k, ..., k] = np.stack([low[k], high[k]], axis=-1)
    blocks = block_of(dict(zip(names, changed, strict=True)), block.one_sided)
    table = compute_outcomes(blocks, changed[-1], site, model, tolerance=_TOLERANCE)
    rates = np.moveaxis(np.asarray(table.contributions.mean(axis=0)), -1, 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        relative = (rates[..., 1] - rates[..., 0]) / np.asarray(rate.rate)
        elasticity = relative / ((high - low) / values)
    elasticity = np.where(np.isfinite(elasticity), elasticity, np.nan)
    elasticity = jax.device_put(elasticity.astype(rates.dtype))
    return RateElasticities(names, elasticity, float(change), rate)
