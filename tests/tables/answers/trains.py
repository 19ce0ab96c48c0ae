"""Trains of pulses of any timing, and the worst ones."""

import jax
import jax.numpy as jnp
import numpy as np

import jaxrock as jr

from .half_cycle_map import MODELS, spread
from .table import group, list_fields

TIMES = np.array([0.0, 0.3, 0.8, 1.1, 1.9])
INTENSITIES = np.array([0.3, -0.2, 0.25, 0.1, -0.3])


def respond_to_trains(model, **side):
    """Twelve blocks under one train, from pulses that hardly lift them on."""

    def respond(half_width, slenderness, c, factor):
        block = jr.Block(half_width, slenderness, **side)
        train = jr.respond_to_train(block, c, TIMES, factor * INTENSITIES, model)
        answers = dict(list_fields(train, "velocity_ratio peak_rotation overturned side"))
        return answers | {"history": jnp.stack(train.history(jnp.asarray(1.3)))}

    numbers = (spread(0.2, 0.8, 1), spread(3.0, 8.0, 5), spread(0.5, 0.9, 11))
    yield from jax.vmap(respond)(*numbers, spread(0.2, 1.6, 7)).items()


group("trains/linearized", 1e-11)(lambda: respond_to_trains(MODELS[0]))
group("trains/nonlinear", 1e-11)(lambda: respond_to_trains(MODELS[1]))
group("trains/one_sided", 1e-11)(lambda: respond_to_trains(MODELS[0], one_sided=True))


@group("trains/derivatives", 1e-10)
def differentiate():
    def compute_peak(at):
        block = jr.Block(at[0], at[1])
        return jr.respond_to_train(block, at[2], TIMES, at[3] * INTENSITIES).peak_rotation

    yield "peak_rotation", jax.jacfwd(compute_peak)(jnp.array([0.4, 5.0, 0.7, 1.0]))


@group("trains/worst", 1e-6)
def search_worst():
    """Searches end where nothing gets better by a millionth."""
    block = jr.Block(0.4, 5.0)
    cases = {
        "smallest_largest": {},
        "smallest_total": {"goal": "smallest total", "impacts_between": 2, "spacing": 0.1},
        "most_rotation": {"goal": "most rotation", "largest": 0.15},
    }
    for name, options in cases.items():
        worst = jr.worst_train(block, 0.7, 3, starts=4, seed=1, **options)
        names = "times intensities largest total peak_rotation overturns"
        yield from list_fields(worst, names, f"{name}/")
