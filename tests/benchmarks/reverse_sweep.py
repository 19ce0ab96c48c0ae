"""The gradient with respect to whole records, in processor time, against the response.

Run as ``python tests/benchmarks/reverse_sweep.py``. Medians of several calls after the first one.
"""

import time

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp
import numpy as np
from timing import measure

import jaxrock as jr


def compare(name, respond, samples):
    """Print the times of responses and of the gradient of all peaks, eager and jitted."""

    def compute_total(samples):
        return respond(samples).peak_rotation.sum()

    gradient = jax.grad(compute_total)
    jitted = jax.jit(gradient)
    response, eager, jitted = (
        measure(lambda call=call: call(samples), 7, time.process_time)
        for call in (lambda samples: respond(np.asarray(samples)), gradient, jitted)
    )
    print(
        f"{name}: response {1e3 * response:.1f} ms, gradient {eager / response:.2f} times that,"
        f" jitted {jitted / response:.2f} times"
    )


if __name__ == "__main__":
    record = jr.example_record()
    samples = record.acceleration
    one = jr.Block(0.3, 5.0)
    for function in (jr.respond, jr.respond_batch):
        compare(
            f"{function.__name__}, 6,001 samples",
            lambda samples, f=function: f(one, 0.9, jr.Record(samples, 0.01)),
            samples,
        )
    many = jr.Block(jnp.linspace(0.1, 0.8, 1000), 5.0)
    noise = np.random.default_rng(1).normal(size=(1000, 600))
    strengths = jnp.linspace(1, 3, 1000)[:, None]
    compare(
        "respond_batch, 1,000 blocks x 600 samples",
        lambda samples: jr.respond_batch(many, 0.9, jr.Record(samples, 0.01)),
        strengths * samples[700:1300] + 0.1 * noise,
    )
