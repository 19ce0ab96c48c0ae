"""A site: fragility, rates of overturning, required values, inventories."""

import jax
import numpy as np
from scenes import suite

import jaxrock as jr
from jaxrock.risk import Inventory, assess_inventory, rate_elasticities, read_example_inventory

from .table import group, list_fields, list_variables, stack_fields

OF_RATE = "rate contributions standard_error not_detected complete overturns_first"
OF_NEED = "value rate crossings count"
BLOCK = jr.Block(0.25, 5.0)
CURVE = jr.risk.Hazard([0.1, 0.4, 1.0, 4.0], [1e-2, 1e-3, 1e-4, 1e-6], "pgv")


def make_pulses():
    """Half-sines of three durations, under which a block has few boundaries."""
    along = np.sin(np.linspace(0, np.pi, 31))
    return jr.Suite([jr.Record(along, duration / 30) for duration in (0.4, 0.7, 1.1)])


def make_site(motions=None, count=16, **options):
    levels = np.geomspace(0.2, 3.0, count)
    return jr.risk.Site(motions or make_pulses(), CURVE, levels=levels, **options)


@group("risk/rate", 1e-6, by_default=True)
def compute_rates():
    blocks = jr.Block(np.array([0.15, 0.25, 0.4]), np.array([6.0, 5.0, 4.0]))
    site = make_site()
    yield from list_fields(jr.risk.overturning_rate(blocks, 0.8, site), OF_RATE)
    yield from list_fields(site, "rates intensities", "site/")


@group("risk/rate_otherwise", 1e-6)
def compute_rates_otherwise():
    site = make_site()
    linearized = jr.risk.overturning_rate(BLOCK, 0.8, site, model="linearized")
    yield from list_fields(linearized, OF_RATE, "linearized/")
    uncertain = jr.Uncertain({"restitution": 0.05, "width": 0.1}, samples=8, seed=1)
    found = jr.risk.overturning_rate(BLOCK, 0.8, site, uncertain)
    yield from list_fields(found, f"{OF_RATE} sample_rates", "uncertain/")
    walls = jr.Block(0.25, 5.0, one_sided=True)
    both = make_site(make_pulses().both_directions())
    found = jr.risk.overturning_rate(walls, -0.6, both)
    yield from list_fields(found, OF_RATE, "one_sided/")
    floors = make_site(make_pulses().on_floor(0.4, 0.05, 1.2))
    yield from list_fields(jr.risk.overturning_rate(BLOCK, 0.8, floors), OF_RATE, "floor/")
    noise = make_site(suite())
    found = jr.risk.overturning_rate(jr.Block(0.15, 4.0), 0.6, noise)
    yield from list_fields(found, "rate standard_error overturns_first", "noise/")
    levels = np.geomspace(1.0, 20.0, 16)
    by_pga = jr.risk.Site(
        make_pulses(), jr.risk.Hazard(levels, 1e-3 / levels**2), "pga", levels
    )
    found = jr.risk.overturning_rate(BLOCK, 0.8, by_pga)
    yield from list_fields(found, OF_RATE, "pga/")


@group("risk/derivatives", 1e-6)
def differentiate_rates():
    site = make_site()

    def rate(half_width, slenderness, c):
        return jr.risk.overturning_rate(jr.Block(half_width, slenderness), c, site).rate

    yield "rate", jax.grad(rate, (0, 1, 2))(0.25, 5.0, 0.8)
    for by in ("shape", "sides", "dynamics"):
        found = rate_elasticities(BLOCK, 0.8, site, by=by)
        yield from list_fields(found, "names", f"elasticities/{by}/")
        # By a difference of two rates that are known to a five-thousandth of the change.
        yield f"elasticities/{by}/over_change", found.elasticity, 1e-3


@group("risk/required_value", 1e-6)
def search_required_values():
    site = make_site()
    cases = {
        "width": (0.3, 1.2),
        "height": (0.8, 3.0),
        "restitution": (0.3, 0.95),
        "half_width": (0.15, 0.6),
        "slenderness": (2.0, 8.0),
    }
    answers = []
    for along, bounds in cases.items():
        answers.append(jr.risk.required_value(BLOCK, 0.8, site, 1e-4, along, bounds))
    yield from stack_fields(answers, OF_NEED)

    def width(target):
        return jr.risk.required_value(BLOCK, 0.8, site, target, "width", (0.3, 1.2)).value

    yield "derivative", jax.grad(width)(1e-4), 1e-5


@group("risk/fragility", 1e-6, by_default=True)
def compute_fragility():
    levels = np.geomspace(0.2, 3.0, 6)
    curves = jr.risk.fragility(BLOCK, 0.8, make_pulses(), levels)
    yield from list_variables(curves)


@group("risk/fragility_otherwise", 1e-6)
def compute_fragility_otherwise():
    levels = np.geomspace(0.2, 3.0, 6)
    uncertain = jr.Uncertain({"restitution": 0.05, "width": 0.1}, samples=8, seed=1)
    curves = jr.risk.fragility(BLOCK, 0.8, make_pulses(), levels, uncertain=uncertain)
    yield from list_variables(curves, "uncertain/")
    blocks = jr.Block(np.array([0.1, 0.2]), 6.0)
    options = {"measure": "pga", "thresholds": (0.3, "overturning")}
    curves = jr.risk.fragility(blocks, 0.7, suite(), np.geomspace(2.0, 20.0, 6), **options)
    yield from list_variables(curves, "pga/")


@group("risk/inventory", 1e-6)
def assess_objects():
    """Rates and medians; widths are located to less."""
    uncertain = jr.Uncertain({"restitution": [0.05, 0.0, 0.1]}, samples=4, seed=1)
    objects = Inventory(
        ["vase", "bust", "case"],
        jr.Block(np.array([0.1, 0.15, 0.3]), np.array([4.0, 5.0, 3.0])),
        np.array([0.8, 0.85, 0.9]),
        uncertain,
        one_sided=[False, False, True],
        floor_period=np.array([0.0, 0.3, 0.0]),
    )
    table = assess_inventory(objects, make_site(), 1e-4)
    for name, value in list_variables(table):
        rough = "required_width" in name
        yield name, value, 1e-3 if rough else 1e-6
    yield "order", table["object"].values


@group("risk/example_inventory", 1e-4)
def assess_example():
    """The objects and the hazard that come with the package under records that do so, too.

    Only three records, of which the boundaries above the first ones are chaotic.
    """
    inventory, hazard = read_example_inventory()
    site = jr.risk.Site(jr.example_suite()[:3], hazard, spacing=0.1)
    table = assess_inventory(inventory, site, 1e-4)
    yield "order", table["object"].values
    for name in ("restitution", "uplift_intensity", "median", "rate"):
        yield name, table[name].values
