"""Driven motion: one block by the adaptive integrator, many by the batch."""

import jax
import jax.numpy as jnp
import numpy as np
from scenes import record, suite

import jaxrock as jr

from .half_cycle_map import spread
from .table import group, list_fields, stack, stack_fields

OF_ONE = (
    "peak_rotation peak_time final_rotation final_velocity overturned overturning_time margin"
    " impacts at_rest friction_demand normal_force"
)
OF_MANY = "peak_rotation final_rotation final_velocity overturned margin impacts mode complete"
HISTORY = np.linspace(0.1, 1.9, 10)


def respond_one(motion, block=None, c=0.85, duration=2.0, **options):
    """Integrate to a tolerance that is well below that of the answers."""
    block = block or jr.Block(0.2, 5.0)
    return jr.respond(block, c, motion, duration, rtol=1e-11, **options)


def list_responses(*responses):
    """List all that is known of some motions."""
    yield from stack_fields(responses, OF_ONE)
    # Located along the motion that is known, to half of its digits.
    yield "contact_loss_time", stack([found.contact_loss_time for found in responses]), 1e-7
    yield "first_impacts", stack([found.impact_times[:4] for found in responses])
    yield "their_velocities", stack([found.impact_velocities[:4] for found in responses])
    yield "history", stack([jnp.stack(found.history(HISTORY)) for found in responses])


@group("driven/one/sine", 1e-9, by_default=True)
def respond_to_sine():
    """It stands, overturns after an impact, and overturns without one; it is launched."""
    yield from list_responses(
        respond_one(jr.Sine(3.0, 0.5)),
        respond_one(jr.Sine(4.2, 0.5), duration=6.0),
        respond_one(jr.Sine(8.0, 0.5), duration=6.0),
        respond_one(jr.Sine(2.5, 0.8), c=0.9, rotation=0.05, velocity=-0.3),
    )


@group("driven/one/other_pulses", 1e-9)
def respond_to_pulses():
    yield from list_responses(
        respond_one(jr.HalfSine(4.0, 0.4)),
        respond_one(jr.Rectangular(2.5, 0.4)),
        respond_one(jr.Cosine(3.0, 0.4)),
        respond_one(jr.Ricker(3.5, 0.4), duration=3.0),
        respond_one(jr.Record([0.0, 0.0], 0.001), rotation=0.1),
        respond_one(jr.Harmonic(3.0, 8.0, 4), duration=4.0),
    )


@group("driven/one/models_and_sides", 1e-9)
def respond_otherwise():
    pulse = jr.Sine(3.2, 0.5)
    yield from list_responses(
        respond_one(pulse, model="linearized"),
        respond_one(pulse, jr.Block(0.2, 5.0, one_sided=True), -0.5),
        respond_one(pulse, jr.Block(0.2, 5.0, 9.78, 1.45)),
    )


def make_vertical_record():
    return jr.Record(record().acceleration, 0.02, 0.5 * record(seed=1).acceleration)


@group("driven/one/record", 1e-8)
def respond_to_record():
    """Through a few dozen impacts, which multiply what an integration leaves."""
    block = jr.Block(0.4, 4.0)
    yield from list_responses(
        respond_one(record(), block, 0.7, 4.0),
        respond_one(make_vertical_record(), block, 0.7, 4.0),
    )


def spread_blocks(**side):
    return jr.Block(spread(0.1, 0.6, 1), spread(3.0, 8.0, 5), **side)


def spread_amplitudes(most):
    return spread(1.1, most, 11) * 9.81 / spread(3.0, 8.0, 5)


@group("driven/batch/pulses", 1e-11, by_default=True)
def respond_to_pulses_in_batch():
    pulse = jr.Sine(spread_amplitudes(6.0), spread(0.2, 1.0, 5))
    found = jr.respond_batch(spread_blocks(), spread(0.5, 0.95, 7), pulse, 4.0)
    yield from list_fields(found, OF_MANY)


@group("driven/batch/other_pulses", 1e-11)
def respond_to_other_pulses_in_batch():
    blocks = spread_blocks()
    c = spread(0.5, 0.95, 7)
    amplitude = spread_amplitudes(3.0)
    for shape in (jr.HalfSine, jr.Cosine, jr.Ricker, jr.Rectangular):
        pulse = shape(amplitude, spread(0.2, 1.0, 5))
        found = jr.respond_batch(blocks, c, pulse, 4.0)
        yield from list_fields(found, OF_MANY, f"{shape.__name__}/")
    floor = jr.Harmonic(amplitude, spread(6.0, 20.0, 7), 5)
    yield from list_fields(jr.respond_batch(blocks, c, floor), OF_MANY, "Harmonic/")


@group("driven/batch/models_and_sides", 1e-11)
def respond_otherwise_in_batch():
    blocks = spread_blocks()
    c = spread(0.5, 0.95, 7)
    pulse = jr.Sine(spread_amplitudes(4.0), spread(0.2, 1.0, 5))
    found = jr.respond_batch(blocks, c, pulse, 4.0, model="linearized")
    yield from list_fields(found, OF_MANY, "linearized/")
    walls = spread_blocks(one_sided=True)
    yield from list_fields(jr.respond_batch(walls, -c, pulse, 4.0), OF_MANY, "one_sided/")
    start = {"rotation": spread(-0.08, 0.08, 5), "velocity": spread(-0.4, 0.4, 7)}
    found = jr.respond_batch(blocks, c, pulse, 4.0, **start)
    yield from list_fields(found, OF_MANY, "launched/")


@group("driven/batch/records", 1e-9, by_default=True)
def respond_to_records_in_batch():
    """Impacts multiply rounding, the more the less they take."""
    blocks = spread_blocks()
    c = spread(0.4, 0.75, 7)
    found = jr.respond_batch(blocks, c, record().scaled(spread(0.5, 1.5, 11)))
    yield from list_fields(found, OF_MANY, "record/")
    found = jr.respond_batch(blocks, c, suite())
    yield from list_fields(found, "peak_rotation overturned margin impacts", "suite/")


@group("driven/batch/vertical_and_walls", 1e-9)
def respond_to_vertical_records_in_batch():
    blocks = spread_blocks()
    c = spread(0.4, 0.75, 7)
    found = jr.respond_batch(blocks, c, make_vertical_record())
    yield from list_fields(found, OF_MANY, "vertical/")
    walls = spread_blocks(one_sided=True)
    found = jr.respond_batch(walls, -c, suite().both_directions())
    yield from list_fields(found, "peak_rotation overturned margin impacts", "one_sided/")


@group("driven/batch/example", 1e-8, by_default=True)
def respond_to_example():
    """Sturdy blocks of little restitution, none of which is chaotic, under sixty seconds."""
    blocks = jr.Block(spread(0.3, 0.8, 1), spread(2.5, 4.0, 5))
    found = jr.respond_batch(blocks, spread(0.4, 0.6, 7), jr.example_record().scaled(1.5))
    yield from list_fields(found, OF_MANY)


@group("driven/within", 1e-6, by_default=True)
def respond_within_tolerance():
    """Errors are estimates, of which the first digits count."""
    blocks = spread_blocks()
    c = spread(0.5, 0.9, 7)
    pulse = jr.Sine(spread_amplitudes(6.0), spread(0.2, 1.0, 5))
    for name, motion in (("pulses", pulse), ("record", record().scaled(spread(0.5, 1.5, 11)))):
        found = jr.respond_within(blocks, c, motion, 1e-4)
        yield f"{name}/within_tolerance", found.within_tolerance
        yield f"{name}/rtol", found.rtol
        yield f"{name}/cheapest", found.cheapest
        outcome = found.response
        yield f"{name}/overturned", outcome.overturned
        # To the tolerance that was asked for, not to that of a better way.
        yield f"{name}/peak_rotation", outcome.peak_rotation, 2e-4


@group("driven/derivatives/one", 1e-7)
def differentiate_one():
    at = jnp.array([0.2, 5.0, 0.85, 3.0, 0.5])

    def answer(at):
        block = jr.Block(at[0], at[1])
        found = jr.respond(block, at[2], jr.Sine(at[3], at[4]), 2.0, rtol=1e-11)
        return jnp.stack([found.peak_rotation, found.final_rotation, found.margin])

    yield "forward", jax.jacfwd(answer)(at)
    yield "reverse", jax.grad(lambda at: answer(at)[0])(at)


@group("driven/derivatives/batch", 1e-9)
def differentiate_batch():
    blocks = spread_blocks()
    c = spread(0.5, 0.95, 7)
    numbers = (blocks.half_width, blocks.slenderness, jnp.asarray(c))
    amplitude = spread(1.1, 4.0, 11) * 9.81 / blocks.slenderness

    def answer(half_width, slenderness, c, amplitude):
        pulse = jr.Sine(amplitude, spread(0.2, 1.0, 5))
        found = jr.respond_batch(jr.Block(half_width, slenderness), c, pulse, 4.0)
        return jnp.stack([found.peak_rotation, found.margin])

    at = (*numbers, amplitude)
    for k, name in enumerate(("half_width", "slenderness", "restitution", "amplitude")):
        tangents = [jnp.ones(12) if i == k else jnp.zeros(12) for i in range(4)]
        yield name, jax.jvp(answer, at, tuple(tangents))[1]


@group("driven/derivatives/record", 1e-7)
def differentiate_with_respect_to_samples():
    """One sweep backwards along the known motion."""
    block = jr.Block(0.4, 4.0)
    ground = record()

    def answer(scale, c):
        moved = jr.Record(scale * jnp.asarray(ground.acceleration), 0.02)
        found = jr.respond(block, c, moved, rtol=1e-11)
        return found.peak_rotation

    scale = jnp.ones(ground.samples)
    of_samples, of_restitution = jax.grad(answer, (0, 1))(scale, 0.7)
    yield "samples", of_samples[::20]
    yield "sum_of_samples", of_samples.sum()
    yield "restitution", of_restitution
