"""The gradient with respect to whole records, in processor time, against the response.

Run as ``python tests/benchmarks/reverse_sweep.py``. Least of several calls after the first one.
"""

import time

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp
import numpy as np

import jaxrock as jr


def measure(function, *arguments):
    """Least processor time of a call, after one that compiles."""
    jax.block_until_ready(function(*arguments))
    times = []
    for _ in range(7):
        start = time.process_time()
        jax.block_until_ready(function(*arguments))
        times.append(time.process_time() - start)
    return min(times)


def compare(name, respond, samples):
    """Print the times of responses and of the gradient of all peaks, eager and jitted."""
    response = measure(lambda samples: respond(samples).peak_rotation, np.asarray(samples))
    gradient = jax.grad(lambda samples: respond(samples).peak_rotation.sum())
    eager = measure(gradient, samples)
    jitted = measure(jax.jit(gradient), samples)
    print(
        f"{name}: response {1e3 * response:.1f} ms, gradient {eager / response:.2f} times that,"
        f" jitted {jitted / response:.2f} times"
    )


if __name__ == "__main__":
    record = jr.example_record()
    samples = record.acceleration
    one = jr.Block(0.3, 5.0)
    compare(
        "respond, 6,001 samples",
        lambda samples: jr.respond(one, 0.9, jr.Record(samples, 0.01)),
        samples,
    )
    compare(
        "respond_batch, 6,001 samples",
        lambda samples: jr.respond_batch(one, 0.9, jr.Record(samples, 0.01)),
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
