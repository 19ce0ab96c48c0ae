"""A closed-form spectrum of a million points: jaxrock against the same formulas in NumPy.

Run as ``python tests/benchmarks/spectrum.py``. Both are timed in turn in one run, after
compilation; the ratio of the medians counts, since single times depend on what else runs.
"""

import statistics
import time

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp
import numpy as np

import jaxrock as jr

AXES = (np.linspace(3, 10, 100), np.linspace(0.2, 0.6, 100), np.linspace(0.5, 0.8, 100))
INTENSITY, GRAVITY = 0.15, 9.81


def with_numpy(slenderness, half_width, restitution):
    """The rotation ratio of the linearized block, by hand."""
    square = 1 + slenderness**2
    critical = np.arctan(1 / slenderness) * np.sqrt(0.75 * GRAVITY / (half_width * np.sqrt(square)))
    launch = 0.75 * slenderness * INTENSITY / (half_width * square)
    x = launch / (1 - restitution) / critical
    return np.where(x < 1, x**2 / (1 + np.sqrt(np.maximum((1 - x) * (1 + x), 0))), np.nan)


def with_jaxrock(model):
    def ratio(slenderness, half_width, restitution):
        return jr.rotation_ratio(
            jr.Scene(jr.Block(half_width, slenderness), restitution, INTENSITY), model
        )

    return jax.jit(ratio)


def with_derivatives(model):
    ratio = with_jaxrock(model)

    def both(*arguments):
        value, back = jax.vjp(lambda *a: ratio(*jnp.broadcast_arrays(*a)), *arguments)
        return value, back(jnp.ones_like(value))

    return jax.jit(both)


def main():
    """Print the median time of each and its ratio to NumPy."""
    grid = [a.ravel() for a in np.meshgrid(*AXES, indexing="ij")]
    on_device = [jnp.asarray(a) for a in grid]
    contenders = {
        "NumPy, linearized": lambda: with_numpy(*grid),
        "jaxrock, linearized": lambda f=with_jaxrock(jr.Linearized()): f(*on_device),
        "jaxrock, nonlinear": lambda f=with_jaxrock(jr.Nonlinear()): f(*on_device),
        "jaxrock, linearized, 3 slopes": lambda f=with_derivatives(jr.Linearized()): f(*on_device),
        "jaxrock, nonlinear, 3 slopes": lambda f=with_derivatives(jr.Nonlinear()): f(*on_device),
    }
    times = {name: [] for name in contenders}
    for repeat in range(16):
        for name, run in contenders.items():
            start = time.perf_counter()
            jax.block_until_ready(run())
            if repeat:
                times[name].append(time.perf_counter() - start)
    reference = statistics.median(times["NumPy, linearized"])
    for name, taken in times.items():
        median = statistics.median(taken)
        print(f"{name:32} {1e3 * median:7.1f} ms   {reference / median:5.2f} times NumPy's speed")


if __name__ == "__main__":
    main()
