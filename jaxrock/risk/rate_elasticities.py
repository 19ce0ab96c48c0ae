"""Elasticities of the rate of overturning, over a finite change of each parameter."""

from collections.abc import Mapping, Sequence
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

    def table(self) -> dict[str, float]:
        """List the elasticities of one block by the names of its parameters.

        Returns
        -------
        dict
        """
        return dict(zip(self.names, self.elasticity.tolist(), strict=True))

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
    objects = gather_objects(block, restitution)
    rate = overturning_rate(block, restitution, site, model=model)
    parameters = list_parameters(*objects, by)
    names = tuple(parameters)
    changed = change_parameters(parameters, names, change, objects[0].one_sided)
    table = compute_outcomes(*changed, site, model, tolerance=_TOLERANCE)
    rates = np.asarray(table.contributions.mean(axis=0))
    elasticity = compute_elasticities(parameters, names, change, rates, np.asarray(rate.rate))
    elasticity = jax.device_put(np.moveaxis(elasticity, -1, 0).astype(rates.dtype))
    return RateElasticities(names, elasticity, float(change), rate)


def list_parameters(
    block: Block, restitution: np.ndarray, by: SizeDescription
) -> dict[str, np.ndarray]:
    """List the parameters of concrete objects by their names, the restitution last."""
    block = jax.tree.map(np.asarray, block)
    sizes = {name: np.asarray(value) for name, value in size_of(block, by).items()}
    return {**sizes, "restitution": np.asarray(restitution)}


def change_parameters(
    parameters: Mapping[str, np.ndarray], names: Sequence[str], change: float, one_sided: bool
) -> tuple[Block, np.ndarray]:
    """Change one parameter after the other to a lower and to a higher value.

    Returns blocks and restitutions of shape (..., 2 names): all lower values, then all higher.
    """
    changed = {}
    for name, values in parameters.items():
        changed[name] = np.repeat(values[..., None], 2 * len(names), axis=-1)
        if name in names:
            k = names.index(name)
            changed[name][..., [k, k + len(names)]] = _choose_values(name, values, change)
    return block_of(changed, one_sided), changed["restitution"]


def _choose_values(name: str, values: np.ndarray, change: float) -> np.ndarray:
    """Choose a lower and a higher value of a parameter, (..., 2)."""
    low = values * (1 - change)
    high = values * (1 + change)
    if name == "inertia_ratio":
        low = np.maximum(low, 1.0)
    if name == "restitution":
        # With C = 1 a block would bounce without end: it goes halfway there at most.
        high = np.minimum(high, 0.5 * (1 + values))
    return np.stack([low, high], axis=-1)


def compute_elasticities(
    parameters: Mapping[str, np.ndarray],
    names: Sequence[str],
    change: float,
    changed_rates: np.ndarray,
    rate: np.ndarray,
) -> np.ndarray:
    """Compute elasticities from the rates (..., 2 names) at the values of `change_parameters`.

    Returns an array of shape (..., names): NaN where the rate or the parameter is 0.
    """
    low, high = np.moveaxis(changed_rates.reshape(*rate.shape, 2, len(names)), -2, 0)
    values = np.stack([parameters[name] for name in names], axis=-1)
    spans = [
        np.diff(_choose_values(name, parameters[name], change), axis=-1)[..., 0]
        for name in names
    ]
    with np.errstate(invalid="ignore", divide="ignore"):
        elasticities = (high - low) / (np.stack(spans, axis=-1) / values) / rate[..., None]
    return np.where(np.isfinite(elasticities), elasticities, np.nan)
