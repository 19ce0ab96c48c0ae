"""Driven motion: jaxrock against a loop in Numba, SciPy with events, and the bare arithmetic.

Run as ``python tests/benchmarks/response.py [blocks]``. Needs numba and gcc, which jaxrock
does not. All are timed in turn in one run, after compilation; the ratio of the medians
counts. On a machine with a GPU only jaxrock is timed there, in both precisions.
"""

import statistics
import sys
import time

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp
import numpy as np

import jaxrock as jr

SAMPLES = 4000


def median(run, repeats=21):
    """Median time of a call, after one that compiles."""
    run()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def batch(count, dtype):
    """As many random blocks on the north component, 40 s at 100 samples a second."""
    rng = np.random.default_rng(0)
    draws = (
        rng.uniform(0.1, 0.5, count),
        rng.uniform(3, 8, count),
        rng.uniform(0.5, 0.95, count),
    )
    half_width, slenderness, c = (jnp.asarray(draw, dtype) for draw in draws)
    record = jr.example_record()
    record = jr.Record(jnp.asarray(record.acceleration[:SAMPLES], dtype), 0.01)
    return jr.Block(half_width, slenderness), c, record


def many(count):
    """Print the time of a batch for all contenders."""
    block, c, record = batch(count, jnp.float64)

    def ours():
        return jax.block_until_ready(jr.respond_batch(block, c, record, 0.01 * SAMPLES))

    contenders = {"jaxrock, float64": ours}
    if jax.devices()[0].platform == "cpu":
        from contenders import ceiling, numba_loop

        numbers = (
            np.asarray(block.frequency_parameter),
            np.asarray(block.critical_angle),
            np.asarray(c),
            np.asarray(record.acceleration),
            0.01,
            9.81,
            SAMPLES - 1,
        )
        contenders["Numba, RK4"] = lambda: numba_loop(*numbers)
        contenders["C, bare arithmetic"] = lambda: ceiling(*numbers)
        peaks = np.asarray(numba_loop(*numbers)[0])
        exact = np.asarray(ours().peak_rotation)
        apart = np.abs(peaks / exact - 1)
        print(f"peaks of Numba's loop and ours: median {np.median(apart):.1e} apart")
    else:
        single = batch(count, jnp.float32)
        contenders["jaxrock, float32"] = lambda: jax.block_until_ready(
            jr.respond_batch(*single, 0.01 * SAMPLES)
        )
    times = {name: median(run) for name, run in contenders.items()}
    for name, taken in times.items():
        ratio = taken / times["jaxrock, float64"]
        print(f"{name:20} {count:7} blocks {1e3 * taken:9.1f} ms {ratio:8.2f} times ours")


def memory(count):
    """Print what a batch takes beside its input, for records of different lengths."""
    for samples in (SAMPLES, 10 * SAMPLES):
        block, c, record = batch(count, jnp.float64)
        record = jr.Record(jnp.resize(record.acceleration, samples), 0.01)

        def peak(block, c, record, duration=0.01 * samples):
            return jr.respond_batch(block, c, record, duration).peak_rotation

        needed = jax.jit(peak).lower(block, c, record).compile().memory_analysis()
        taken = needed.temp_size_in_bytes / 2**20
        print(f"{count} blocks, {samples:6} samples: {taken:.1f} MiB of working memory")


def one():
    """Print the time of one block, of SciPy's, and of a derivative to four numbers."""
    record = jr.example_record()

    def peak(parameters):
        half_width, slenderness, c, scale = parameters
        block = jr.Block(half_width, slenderness)
        return jr.respond(block, c, record.scaled(scale), 60.0).peak_rotation

    at = jnp.asarray([0.2, 5.0, 0.9, 1.0])
    plain = jax.jit(peak)
    slopes = jax.jit(jax.jacfwd(peak))
    taken = median(lambda: plain(at).block_until_ready())
    sloped = median(lambda: slopes(at).block_until_ready())
    print(
        f"one block, 60 s, adaptive {1e3 * taken:.1f} ms, with 4 slopes {sloped / taken:.2f} times"
    )
    if jax.devices()[0].platform == "cpu":
        from contenders import scipy_events

        block = jr.Block(0.2, 5.0)
        start = time.perf_counter()
        scipy_events(
            float(block.frequency_parameter),
            float(block.critical_angle),
            0.9,
            np.asarray(record.acceleration[:SAMPLES]),
            0.01,
            9.81,
            SAMPLES - 1,
        )
        print(f"SciPy with events, one block, 40 s: {time.perf_counter() - start:.2f} s")


if __name__ == "__main__":
    for count in map(int, sys.argv[1:] or ["1000", "10000"]):
        many(count)
    memory(1000)
    one()
