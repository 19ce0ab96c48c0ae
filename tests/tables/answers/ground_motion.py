"""Motions: pulses, floors, and the records, objects and hazard that come with the package."""

import jax
import jax.numpy as jnp
import numpy as np
from scenes import record, suite

import jaxrock as jr
from jaxrock.risk import read_example_inventory

from .half_cycle_map import spread
from .table import group, list_fields

PULSES = (jr.Rectangular, jr.HalfSine, jr.Sine, jr.Cosine, jr.Ricker)


def list_records(motions, prefix=""):
    """A few samples of each, sums over all, and steps."""
    parts = {"": [motion.acceleration for motion in motions]}
    if motions[0].vertical is not None:
        parts["vertical_"] = [motion.vertical for motion in motions]
    for part, accelerations in parts.items():
        samples = [
            np.asarray(acceleration, float) * float(motion.scale)
            for motion, acceleration in zip(motions, accelerations, strict=True)
        ]
        places = [np.linspace(0, one.size - 1, 9).astype(int) for one in samples]
        few = [one[at] for one, at in zip(samples, places, strict=True)]
        yield f"{prefix}{part}samples", few
        # The sum of positive and negative samples is close to 0, as many digits as it loses.
        yield f"{prefix}{part}sums", [one.sum() for one in samples], 1e-9
        yield f"{prefix}{part}sums_of_magnitudes", [np.abs(one).sum() for one in samples]
        yield f"{prefix}{part}sums_of_squares", [one @ one for one in samples]
    yield f"{prefix}steps", [float(motion.time_step) for motion in motions]
    yield f"{prefix}starts", [float(motion.start) for motion in motions]
    yield f"{prefix}ends", [float(motion.end) for motion in motions]
    yield f"{prefix}counts", [motion.samples for motion in motions]


@group("ground_motion/pulses", by_default=True)
def answer_of_pulses():
    time = spread(0.05, 1.1, 1)
    for shape in PULSES:
        pulse = shape(3.0, 0.7).scaled(1.5).shifted(0.2)
        yield f"{shape.__name__}/horizontal", pulse.horizontal(time)
        yield f"{shape.__name__}/numbers", [pulse.intensity, pulse.end, shape.area]
    harmonic = jr.Harmonic(3.0, 8.0, 3).scaled(1.5).shifted(0.2)
    yield "Harmonic/horizontal", harmonic.horizontal(time)
    yield "Harmonic/numbers", [harmonic.intensity, harmonic.end, harmonic.period]


@group("ground_motion/example_records", by_default=True)
def read_records():
    components = ("north", "east")
    yield from list_records([jr.example_record(name, vertical=True) for name in components])
    yield "north/horizontal", jr.example_record().horizontal(spread(20.003, 30.007, 1))
    for measure in ("pga", "pgv"):
        intensity = jr.ground_motion.intensity_measure(jr.example_record(), measure)
        yield f"north/{measure}", intensity


@group("ground_motion/example_suite", by_default=True)
def read_suite():
    motions = jr.example_suite(vertical=True)
    yield "names", motions.names
    yield from list_records(motions.records)
    for measure in ("pga", "pgv"):
        yield measure, motions.measure(measure)
    yield "pga_ratio", motions.measure("pga_ratio", jr.Block(0.3, 4.0))
    yield "factors", motions.factors(0.3, "pgv")


@group("ground_motion/example_inventory", by_default=True)
def read_inventory():
    inventory, hazard = read_example_inventory()
    yield from list_fields(inventory, "names restitution one_sided floor_period floor_damping")
    yield from list_fields(inventory.block, "half_width slenderness", "block/")
    yield from list_fields(hazard, "levels rates measure", "hazard/")
    yield "hazard/at_levels", hazard(spread(0.06, 1.5, 1))
    yield "hazard/derivative", jax.grad(hazard)(0.3)


@group("ground_motion/floors", 1e-10)
def move_floors():
    ground = record()
    floors = (
        ground.on_floor(0.4),
        ground.on_floor([0.5, 0.2], [0.05, 0.1], [1.3, -0.4]),
        ground.on_floor(0.3, 0.0),
        ground.on_floor(0.1, 0.05, time_step=0.005),
    )
    yield from list_records(floors)
    floor = suite().on_floor(0.4, 0.05, 1.2)
    yield "suite/pga_of_the_ground", floor.measure("pga")
    yield from list_records(floor.records, "suite/")

    slopes = jax.jacfwd(
        lambda at: ground.on_floor(at[0], at[1], at[2], free_vibration=0.2).acceleration[50]
    )
    yield "derivatives", slopes(jnp.array([0.4, 0.05, 1.2])), 1e-9
