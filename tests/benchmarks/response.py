"""Driven motion: jaxrock against a loop in Numba, SciPy with events, and the bare arithmetic.

Run as ``python tests/benchmarks/response.py [blocks]``. Needs numba and gcc, which jaxrock
does not. On a machine with a GPU only jaxrock is timed there, in both precisions.
"""

import sys
import time

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp
import numpy as np
from timing import measure, time_in_turn

import jaxrock as jr

SAMPLES = 4000


def make_batch(count, dtype=jnp.float64):
    """As many random blocks on the north component, 40 s at 100 samples a second."""
    random = np.random.default_rng(0)
    ranges = ((0.1, 0.5), (3, 8), (0.5, 0.95))
    half_width, slenderness, c = (
        jnp.asarray(random.uniform(*ends, count), dtype) for ends in ranges
    )
    record = jr.Record(jnp.asarray(jr.example_record().acceleration[:SAMPLES], dtype), 0.01)
    return jr.Block(half_width, slenderness), c, record


def respond(batch):
    return jr.respond_batch(*batch, 0.01 * SAMPLES)


def list_numbers(block, c, record):
    """What the other programs take."""
    numbers = (block.frequency_parameter, block.critical_angle, c, record.acceleration)
    return (*map(np.asarray, numbers), 0.01, 9.81, SAMPLES - 1)


def compare_batches(count):
    """Print the time of a batch for all contenders."""
    batch = make_batch(count)
    calls = {"jaxrock, float64": lambda: respond(batch)}
    if jax.devices()[0].platform == "cpu":
        from contenders import ceiling, numba_loop

        numbers = list_numbers(*batch)
        calls["Numba, RK4"] = lambda: numba_loop(*numbers)
        calls["C, bare arithmetic"] = lambda: ceiling(*numbers)
        apart = np.abs(numba_loop(*numbers)[0] / np.asarray(respond(batch).peak_rotation) - 1)
        print(f"peaks of Numba's loop and ours: median {np.median(apart):.1e} apart")
    else:
        single = make_batch(count, jnp.float32)
        calls["jaxrock, float32"] = lambda: respond(single)
    times = time_in_turn(calls)
    for name, seconds in times.items():
        ratio = seconds / times["jaxrock, float64"]
        print(f"{name:20} {count:7} blocks {1e3 * seconds:9.1f} ms {ratio:8.2f} times ours")


def compare_single():
    """Print the time of one block, of a derivative to four numbers, and of SciPy."""
    record = jr.example_record()

    def peak(at):
        block = jr.Block(at[0], at[1])
        return jr.respond(block, at[2], record.scaled(at[3]), 60.0).peak_rotation

    at = jnp.asarray([0.2, 5.0, 0.9, 1.0])
    plain, sloped = (
        measure(lambda f=f: f(at)) for f in map(jax.jit, (peak, jax.jacfwd(peak)))
    )
    ratio = sloped / plain
    print(f"one block, 60 s, adaptive {1e3 * plain:.1f} ms, with 4 slopes {ratio:.2f} times")
    if jax.devices()[0].platform == "cpu":
        from contenders import scipy_events

        start = time.perf_counter()
        scipy_events(*list_numbers(jr.Block(0.2, 5.0), 0.9, record))
        print(f"SciPy with events, one block, 40 s: {time.perf_counter() - start:.2f} s")


if __name__ == "__main__":
    for count in map(int, sys.argv[1:] or ["1000", "10000"]):
        compare_batches(count)
    compare_single()
