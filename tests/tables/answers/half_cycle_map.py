"""Blocks, impact laws, the half-cycle map, its limits and their inverses: closed forms."""

import functools

import jax
import jax.numpy as jnp
import numpy as np

import jaxrock as jr

from .table import group, list_fields

MODELS = (jr.Linearized(), jr.Nonlinear())


def spread(low, high, step):
    """Twelve numbers from low to high, in an order of their own for 1, 5, 7 and 11."""
    return low + (high - low) * (step * np.arange(12) % 12) / 11


def usual_scenes(**side):
    """Slender and stocky blocks under weak pulses and such that overturn them."""
    gravity = spread(9.78, 9.83, 11)
    block = jr.Block(
        spread(0.1, 1.2, 1), spread(2.0, 12.0, 5), gravity, spread(1.2, 1.5, 7), **side
    )
    return jr.Scene(block, spread(0.1, 0.93, 7), spread(0.02, 0.9, 5)[::-1])


def extreme_scenes():
    """C of 0 and 1, pulses of 0 and beyond all bounds, needles and slabs."""
    half_width = np.array([1e-6, 1e-3, 0.4, 0.4, 0.4, 0.4, 0.4, 0.4, 0.4, 0.4, 1e3, 1e6])
    slenderness = np.array([5.0, 0.1, 5.0, 5.0, 5.0, 1e4, 1e-2, 5.0, 5.0, 1.0, 5.0, 40.0])
    block = jr.Block(half_width, slenderness, np.full(12, 9.81), np.full(12, 4 / 3))
    nearly = 1 - 1e-12
    c = np.array([0.7, 0.7, 0.0, 1.0, nearly, 0.7, 0.7, 0.7, 0.7, 1e-9, 0.99, 0.5])
    intensity = np.array([1e-4, 1e-3, 0.15, 1e-3, 1e-9, 1e-6, 0.2, 0.0, 1e6, 0.2, 0.05, 1e-8])
    return jr.Scene(block, c, intensity)


OF_MODEL = (
    *(jr.stabilized_period, jr.stabilized_rotation, jr.rotation_ratio),
    *(jr.amplification, jr.overturning_margin, jr.overturning_half_cycle),
)


def answer_all(scene, model):
    for function in OF_MODEL:
        yield function.__name__, function(scene, model)
    block = scene.block
    yield "critical_intensity", jr.critical_intensity(block, scene.restitution, model=model)


def invert_all(scene, model):
    """The other three of size, shape, restitution and intensity."""
    block = scene.block
    c = scene.restitution
    for name, half_cycles in (("limit", np.inf), ("three", 3.0)):
        rest = {"half_cycles": half_cycles, "model": model}
        yield f"{name}/critical_intensity", jr.critical_intensity(block, c, **rest)
        restitution = jr.critical_restitution(block, scene.intensity, **rest)
        # It loses digits where it is close to 0.
        yield f"{name}/critical_restitution", restitution, 1e-11
        slenderness = jr.critical_slenderness(block, c, scene.intensity, **rest)
        yield f"{name}/critical_slenderness", slenderness
        for fixed in ("slenderness", "height"):
            width = jr.critical_width(block, c, scene.intensity, fixed=fixed, **rest)
            yield f"{name}/critical_width_at_this_{fixed}", width


@group("block", by_default=True)
def answer_of_blocks():
    scene = usual_scenes()
    names = "half_height half_diagonal critical_angle frequency_parameter"
    yield from list_fields(scene.block, names)
    yield "housner_restitution", jr.housner_restitution(scene.block)
    wall = usual_scenes(one_sided=True).block
    yield "one_sided_restitution", jr.one_sided_restitution(wall)
    by_size = jr.Block.from_size(width=spread(0.2, 1.0, 1), height=spread(1.0, 9.0, 5))
    yield from list_fields(by_size, "half_width slenderness", "from_size/")
    again = jr.Block.from_parameters(spread(1.0, 6.0, 7), spread(0.05, 0.6, 5))
    yield from list_fields(again, "half_width slenderness", "from_parameters/")


@group("resonance/velocities", by_default=True)
def answer_of_velocities():
    scene = usual_scenes()
    yield "launch_velocity", jr.launch_velocity(scene)
    yield "next_velocity", jr.resonance.next_velocity(scene, 0.2)
    yield "half_cycle_velocity", jr.half_cycle_velocity(scene, 4.0)
    yield "stabilized_velocity", jr.stabilized_velocity(scene)
    velocity = 0.4 * scene.block.critical_angle * scene.block.frequency_parameter
    for model in MODELS:
        prefix = f"{model.name}/"
        yield prefix + "critical_velocity", model.critical_velocity(scene.block)
        yield prefix + "peak_rotation", model.peak_rotation(scene.block, velocity)
        yield prefix + "half_cycle_duration", model.half_cycle_duration(scene.block, velocity)
        time = 0.3 * model.half_cycle_duration(scene.block, velocity)
        yield prefix + "motion", jnp.stack(model.motion(scene.block, velocity, time))


group("resonance/linearized", by_default=True)(lambda: answer_all(usual_scenes(), MODELS[0]))
group("resonance/nonlinear", by_default=True)(lambda: answer_all(usual_scenes(), MODELS[1]))


@group("resonance/extremes", by_default=True)
def answer_in_extremes():
    for model in MODELS:
        for name, value in answer_all(extreme_scenes(), model):
            yield f"{model.name}/{name}", value


@group("resonance/one_sided", by_default=True)
def answer_one_sided():
    """Only the period differs from that of a free-standing block."""
    scene = usual_scenes(one_sided=True)
    yield "stabilized_period", jr.stabilized_period(scene)
    yield "rotation_ratio", jr.rotation_ratio(scene, MODELS[1])


group("resonance/inverse_linearized", by_default=True)(
    lambda: invert_all(usual_scenes(), MODELS[0])
)
group("resonance/inverse_nonlinear")(lambda: invert_all(usual_scenes(), MODELS[1]))


@group("resonance/damping", by_default=True)
def answer_equivalent_damping():
    c = spread(0.1, 0.95, 5)
    yield "equivalent_damping", jr.resonance.equivalent_damping(c)
    yield "equivalent_damping_as_printed", jr.resonance.equivalent_damping(c, as_printed=True)


def differentiate_all(model):
    """List derivatives of each scene's answers, a row for each of its six numbers."""

    def intensity(at):
        return jr.critical_intensity(at.block, at.restitution, model=model)

    answers = {"critical_intensity": intensity}
    for function in (jr.rotation_ratio, jr.stabilized_period, jr.overturning_margin):
        answers[function.__name__] = functools.partial(function, model=model)

    @jax.jit
    @jax.vmap
    def differentiate(scene):
        return {name: jax.grad(answer)(scene) for name, answer in answers.items()}

    for name, derivatives in differentiate(usual_scenes()).items():
        yield name, jnp.stack(jax.tree.leaves(derivatives))


group("resonance/derivatives_linearized", 1e-11, by_default=True)(
    lambda: differentiate_all(MODELS[0])
)
group("resonance/derivatives_nonlinear", 1e-11)(lambda: differentiate_all(MODELS[1]))


@group("resonance/second_derivatives", 1e-10)
def differentiate_twice():
    scene = jr.Scene(jr.Block(0.4, 5.0), 0.7, 0.15)
    for model in MODELS:
        found = jr.sensitivities(lambda at, m=model: jr.rotation_ratio(at, m), scene)
        yield from list_fields(found, "value gradient elasticity hessian", f"{model.name}/")
