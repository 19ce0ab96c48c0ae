"""Many objects at a site: ranked by rate, and what would bring each to a target."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import jax
import numpy as np

from ..block import Block, block_of, size_of
from ..ground_motion import choose_floor_step
from ..host import show_progress
from ..impact import compute_low_restitution
from ..overturning import uplift_factor
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import Domain, as_real, check, check_kind
from .inventory import Inventory
from .inventory_dataset import make_inventory_dataset
from .lognormal import fit_boundaries
from .objects import Objects, draw_objects, gather_objects
from .outcome_table import compute_outcomes
from .required_value import search_value
from .site import Site

if TYPE_CHECKING:
    import xarray

# A larger number was a return period.
_TARGET = Domain(
    "greater than 0 and at most 1 per year, not in years", lambda x: (x > 0) & (x <= 1), 1e-3
)
_OVERTURNS_FIRST = "overturns at the lowest level of the site, so that the rate may be more"


def assess_inventory(
    inventory: Inventory,
    site: Site,
    target: float,
    *,
    required_width: bool = True,
    model: ModelLike = Nonlinear(),
) -> "xarray.Dataset":
    """Rank objects by the rate at which they overturn, and find the width that each would need.

    Parameters
    ----------
    inventory : Inventory
    site : Site
        Levels 4 % apart, ``spacing=0.04``, suffice for a ranking.
    target : float
        The rate that is tolerated, greater than 0 and at most 1 [1/yr].
    required_width : bool
        Whether to search the width that each object needs, which takes most of the time.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.

    Returns
    -------
    xarray.Dataset
        Over ``object``, the highest rate first, with ``rank``: ``width``, ``height``,
        ``inertia_ratio``, ``restitution``, ``restitution_assumed``,
        ``one_sided``; ``floor_period`` (0 on the ground floor),
        ``floor_damping``; ``uplift_intensity``, the median of the
        lognormal curve of uplift; ``median`` and ``dispersion`` of the curve of overturning, the
        median NaN where the levels of the site do not reach it; ``rate`` of overturning with its
        ``standard_error`` (from record to record) and ``not_detected`` (see
        `overturning_rate`); ``probability_in_50_years``; ``verdict``, whether it meets the
        target, which is "not known" where ``not_detected`` may carry the rate across; where the
        restitution is assumed, the lower end of its range, ``low_restitution``, and
        ``rate_at_low_restitution``; ``need`` of width in words; a ``remark`` on what is
        exceptional. Over object and ``column`` there is a ``note``, if the inventory has others.

        With `required_width`, ``required_width``, the width at this height from which on the
        rate stays below the target: half the present width where all widths that were examined
        meet it, inf where none does, NaN where the hazard ends before the target.

    Raises
    ------
    ValueError
        If an argument is out of range, objects are on floors where the suite of the site is
        on one already, or an integration does not finish.

    Notes
    -----
    An object on a floor is assessed under ``site.suite.on_floor(period, damping)``, with steps of
    at most 1/30 of the period. Levels and the hazard are those of the ground. A one-sided object
    is assessed under the suite in both directions.

    Rates are those of `overturning_rate`, accurate to 1e-4. Uncertain parameters count in the
    rate and its errors, and in the lognormal curve of overturning. The
    uplift intensity and the required width are computed with the medians, and so is the rate
    with the low end of an assumed restitution, 0.85 times the one that follows from size.
    Widths are examined from half the present width to the larger of twice the present width and
    1.5 times the height, at constant restitution. The answers for an object do not depend on
    the others.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> import jaxrock as jr
    >>> suite = jr.Suite([jr.Record([0.0, 4.0, 4.0, -4.0, -4.0, 0.0], time_step=0.1)])
    >>> site = jr.risk.Site(suite, jr.risk.Hazard(levels=[0.4, 4.0], rates=[1e-2, 1e-4]))
    >>> block = jr.Block.from_size(width=jnp.array([0.4, 0.2]), height=1.0)
    >>> objects = jr.risk.Inventory(["bust", "vase"], block, restitution=0.8)
    >>> answer = jr.risk.assess_inventory(objects, site, target=1e-3)
    >>> print(answer.object.values, (answer.required_width > answer.width).values)
    ['vase' 'bust'] [ True  True]
    """
    check_kind("inventory", inventory, Inventory)
    check_kind("site", site, Site)
    check("target", as_real("target", target), _TARGET)
    model = as_model(model)
    objects = gather_objects(inventory.block, inventory.restitution)
    samples = draw_objects(objects, inventory.uncertain)[:2]
    groups = [*_list_groups(inventory, site)]
    answers = []
    for members, own_site in show_progress(groups, "groups of objects"):
        one_sided = bool(inventory.one_sided[members[0]])
        own, drawn = (_select(part, members, one_sided) for part in (objects, samples))
        answer = _compute_rates(own, drawn, own_site, model)
        assumed = np.asarray(inventory.restitution_assumed)[members]
        answer |= _compute_low_rates(own, own_site, model, assumed)
        if required_width:
            answer |= _search_widths(*own, own_site, target, model)
        answers.append(answer)
    order = np.argsort(np.concatenate([members for members, _ in groups]))
    joined = {
        name: np.concatenate([answer[name] for answer in answers])[order]
        for name in answers[0]
    }
    return make_inventory_dataset(inventory, site, target, model, joined)


def _list_groups(inventory: Inventory, site: Site) -> Iterator[tuple[np.ndarray, Site]]:
    """List objects that feel the same motions, by their numbers, and the site of each group."""
    period = np.asarray(inventory.floor_period)
    damping = np.where(period > 0, inventory.floor_damping, 0)
    motions = np.stack([inventory.one_sided, period, damping])
    different, group = np.unique(motions, axis=1, return_inverse=True)
    for k, (is_one_sided, period, damping) in enumerate(different.T):
        suite = site.suite
        if period:
            suite = suite.on_floor(period, damping, time_step=choose_floor_step(period))
        if is_one_sided and suite.directions == 1:
            suite = suite.both_directions()
        own_site = Site(suite, site.hazard, site.measure, site.levels)
        yield np.flatnonzero(group == k), own_site


def _select(objects: Objects, members: np.ndarray, one_sided: bool) -> Objects:
    """Select objects that are all one-sided, or all free-standing."""
    block, restitution = jax.tree.map(lambda leaf: leaf[members], objects)
    return block_of(size_of(block, "shape"), one_sided), restitution


def _compute_rates(
    objects: Objects, samples: Objects, site: Site, model: RockingModel
) -> dict[str, np.ndarray]:
    """Compute rates and curves from the outcomes of the samples of each object."""
    table = compute_outcomes(*samples, site, model)
    means = table.average(with_samples=True)
    fits = fit_boundaries(table)
    factors = [uplift_factor(objects[0], record, model=model) for record in site.suite]
    lifted = np.stack(factors) * np.asarray(site.intensities)[:, None]
    median = np.array([fit.median for fit in fits])
    reached = (median >= table.levels[0]) & (median <= table.levels[-1])
    overturns_first = np.asarray(means["overturns_first"]).any(axis=0)
    remarks = [
        [f"lognormal curve: {fit.remark}"] * bool(fit.remark)
        + [_OVERTURNS_FIRST] * bool(first)
        for fit, first in zip(fits, overturns_first, strict=True)
    ]
    return {
        "uplift_intensity": np.exp(np.log(lifted).mean(axis=0)),
        "median": np.where(reached, median, np.nan),
        "dispersion": np.array([fit.dispersion for fit in fits]),
        "rate": np.asarray(means["rate"]),
        "standard_error": np.asarray(means["standard_error"]),
        "not_detected": np.asarray(means["not_detected"]),
        "remark": np.array(["; ".join(texts) for texts in remarks]),
    }


def _compute_low_rates(
    objects: Objects, site: Site, model: RockingModel, assumed: np.ndarray
) -> dict[str, np.ndarray]:
    """Compute rates with the low ends of assumed restitutions; NaN for the others."""
    block = objects[0]
    low = rates = np.full(assumed.shape, np.nan)
    if assumed.any():
        low = np.where(assumed, compute_low_restitution(block), np.nan)
        table = compute_outcomes(block, np.where(assumed, low, objects[1]), site, model)
        rates = np.where(assumed, table.contributions.mean(axis=0), np.nan)
    return {"low_restitution": low, "rate_at_low_restitution": rates}


def _search_widths(
    block: Block, restitution: np.ndarray, site: Site, target: float, model: RockingModel
) -> dict[str, np.ndarray]:
    """Search the widths from which on the rate stays below the target."""
    sizes = size_of(block, "sides")
    # A block wider than 1.5 times its height would need more than 1.5 g to be lifted.
    highest = np.maximum(2 * sizes["width"], 1.5 * sizes["height"])
    required = search_value(
        (block, restitution, site, np.asarray(target)),
        bounds=(0.5 * sizes["width"], highest),
        along="width",
        model=model,
        resolution=0.03,
    )
    return {"required_width": np.asarray(required.value)}
