"""Scenes of any kind, drawn at random: what models cost is predicted for them and compared."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from references import finite_pulses as lasting

import jaxrock as jr
from jaxrock.accuracy.model_errors import Answers, compute_answers

NUMBER = 2000  # one number, since each takes seconds to compile


def scenes(seed, number, stocky=1.0):
    """Scenes of any kind, some on the verge of overturning, some over it."""
    rng = np.random.default_rng(seed)
    slenderness = 10 ** rng.uniform(0, 2.5, number)
    half_width = 10 ** rng.uniform(-2, 0.5, number)
    near_one = 1 - 10 ** rng.uniform(-4, -1, number)
    restitution = np.where(rng.random(number) < 0.8, rng.uniform(0, 0.95, number), near_one)
    x = np.where(rng.random(number) < 0.8, rng.uniform(0.001, 1.2, number), near_one)
    block = jr.Block(half_width, slenderness * stocky)
    single = jr.Nonlinear().critical_velocity(block) / block.pulse_velocity(1.0)
    return jr.Scene(block, restitution, x * np.asarray(single) * (1 - restitution))


def apart(found, truth):
    """Relative error: 0 where neither exists, inf where one does."""
    found = np.asarray(found, float)
    truth = np.asarray(truth, float)
    here = np.isfinite(found)
    there = np.isfinite(truth)
    with np.errstate(all="ignore"):
        error = np.where(found == truth, 0, np.abs(found / truth - 1))
    return np.where(here & there, error, np.where(here == there, 0, np.inf))


def computed(scene, setting):
    """The three answers by a closed form in a precision."""
    dtype = {32: jnp.float32, 64: jnp.float64}[setting.bits]
    scene = jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype), scene)
    # The inertia ratio of a rectangle in this precision: the truth takes it as exact.
    ratio = jnp.asarray(4 / 3, dtype)
    scene = eqx.tree_at(lambda s: s.block.inertia_ratio, scene, ratio)
    return compute_answers(scene, jr.resonance.as_model(setting.level))


def each(scene, k):
    return jax.tree.map(lambda leaf: leaf[k] if leaf.ndim else leaf, scene)


def lasting_scenes(seed, number, shape):
    """Scenes of known answers under pulses that last, some just over the verge."""
    rng = np.random.default_rng(seed)
    slenderness = np.where(rng.random(number) < 0.6, 10 ** rng.uniform(-0.6, 0.5, number), 1)
    slenderness = np.where(slenderness == 1, 10 ** rng.uniform(0, 2.5, number), slenderness)
    near_one = 1 - 10 ** rng.uniform(-4, -1, number)
    restitution = np.where(rng.random(number) < 0.8, rng.uniform(0, 0.98, number), near_one)
    near_one = 1 - 10 ** rng.uniform(-6, -1, number)
    x = np.where(rng.random(number) < 0.7, rng.uniform(0.01, 1, number), near_one)
    over = rng.random(number) < 0.1
    strength = 10 ** rng.uniform(-2, 0, number)
    verge = lasting.critical_velocity(slenderness)
    velocity = np.where(over, 1, x) * verge
    # As it is for instantaneous pulses.
    tangent = 1 / slenderness
    cosine = 1 / np.hypot(1, 1 / slenderness)
    duration = strength * (1 - restitution) * velocity / (cosine * tangent)
    found, critical = (
        lasting.steady(slenderness, restitution, v, duration, shape) for v in (velocity, verge)
    )
    half_width = 10 ** rng.uniform(-2, 0.5, number)
    block = jr.Block(half_width, slenderness)
    rate = np.asarray(block.frequency_parameter)
    stronger = np.where(over, 1 + 10 ** rng.uniform(-6, -1, number), 1)
    scene = jr.Scene(block, restitution, found.intensity * stronger * 9.81 / rate)
    truth = Answers(
        jnp.where(over, jnp.nan, found.ratio),
        jnp.where(over, jnp.nan, found.period / rate),
        jnp.asarray(critical.intensity * 9.81 / rate),
    )
    return scene, duration / rate, truth, found.lifted & critical.lifted
