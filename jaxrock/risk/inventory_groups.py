"""Groups of objects that feel the same motions, and the site of each group."""

from typing import NamedTuple

import numpy as np

from ..block import Block
from ..ground_motion import Suite, choose_floor_step
from ..sensitivity import FLOOR_NAMES, Uncertain
from .inventory import Inventory
from .site import Site


class ObjectGroup(NamedTuple):
    """Objects of an inventory that are all one-sided or all free-standing, on one floor.

    Attributes
    ----------
    places : ndarray of int
        Of the objects in the inventory.
    inventory : Inventory
        These objects alone.
    site : Site
        Whose suite is on their floor, and in both directions if they are one-sided.
    """

    places: np.ndarray
    inventory: Inventory
    site: Site


def group_objects(inventory: Inventory, site: Site) -> list[ObjectGroup]:
    """Group the objects of an inventory by the motions that they feel at a site.

    Raises
    ------
    ValueError
        If objects are on floors, and the suite of the site is on a floor already.
    """
    periods = np.asarray(inventory.floor_period, float)
    dampings = np.asarray(inventory.floor_damping, float)
    on_floor = periods > 0
    if on_floor.any() and site.suite.ground is not None:
        first = int(np.argmax(on_floor))
        raise ValueError(
            "floor_period must be 0 for all objects where the suite is on a floor already, got"
            f" {periods[first]:g} s for {inventory.names[first]!r}"
        )
    if not on_floor.any() and not any(inventory.one_sided):
        return [ObjectGroup(np.arange(len(inventory)), inventory, site)]
    places: dict[tuple[bool, float, float], list[int]] = {}
    for k, is_one_sided in enumerate(inventory.one_sided):
        damping = float(dampings[k]) if on_floor[k] else 0.0
        places.setdefault((is_one_sided, float(periods[k]), damping), []).append(k)
    suites: dict[tuple[float, float], Suite] = {(0.0, 0.0): site.suite}
    groups = []
    for (is_one_sided, period, damping), numbers in places.items():
        members = np.array(numbers)
        if (period, damping) not in suites:
            suites[period, damping] = site.suite.on_floor(
                period, damping, time_step=choose_floor_step(period)
            )
        suite = suites[period, damping]
        if is_one_sided and suite.directions == 1:
            suite = suite.both_directions()
        selected = _select_objects(
            inventory, members, is_one_sided, bool(on_floor.any() and not period)
        )
        group_site = site if suite is site.suite else site.replace_suite(suite)
        groups.append(ObjectGroup(members, selected, group_site))
    return groups


def _select_objects(
    inventory: Inventory, places: np.ndarray, one_sided: bool, without_floor: bool
) -> Inventory:
    """Select the objects of a group, without their floor: the suite of its site is on it.

    For a group on the ground floor, where other groups are on upper floors, the uncertainty
    of `floor_period` and `floor_damping` is left out, with its correlations.
    """
    objects = inventory.objects
    block = Block(
        objects.block.half_width[places],
        objects.block.slenderness[places],
        objects.block.gravity[places],
        objects.block.inertia_ratio[places],
        one_sided=one_sided,
    )
    uncertain = inventory.uncertain
    if uncertain is not None:
        coefficients = {
            name: value[places] if isinstance(value, np.ndarray) else value
            for name, value in uncertain.coefficients_of_variation.items()
            if not (without_floor and name in FLOOR_NAMES)
        }
        correlations = {
            pair: value
            for pair, value in uncertain.correlations.items()
            if coefficients.keys() >= set(pair)
        }
        uncertain = Uncertain(
            coefficients,
            correlations=correlations,
            samples=uncertain.samples,
            seed=uncertain.seed,
        )
    return Inventory(
        [inventory.names[k] for k in places],
        block,
        objects.restitution[places],
        uncertain,
        [inventory.remarks[k] for k in places],
        restitution_assumed=[inventory.restitution_assumed[k] for k in places],
    )


def describe_places(inventory: Inventory) -> dict[str, np.ndarray]:
    """List where objects stand, as far as some stand against a wall or on a floor."""
    answers: dict[str, np.ndarray] = {}
    if any(inventory.one_sided):
        answers["one_sided"] = np.array(inventory.one_sided)
    periods = np.asarray(inventory.floor_period)
    if periods.any():
        answers["floor_period"] = periods
        answers["floor_damping"] = np.where(periods > 0, inventory.floor_damping, np.nan)
    return answers
