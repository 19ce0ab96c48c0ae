"""Blocks under pulses: jaxrock against heyoka and a loop in Numba, and error against tolerance.

Run as ``python tests/benchmarks/pulses.py [blocks]``. heyoka and numba are left out where they
are not installed. All are timed in turn in one run, after compilation; the ratio of the
medians counts. Set ``taskset -c 0`` and ``NUMBA_NUM_THREADS=1`` for one core.
"""

import importlib.util
import statistics
import sys
import time

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np
from pulse_contenders import heyoka_batch, numba_taylor

import jaxrock as jr

LENGTH = 0.5
END = 1.0
SHAPES = (jr.Rectangular, jr.HalfSine, jr.Sine, jr.Cosine, jr.Ricker)


def scene(count):
    """Random blocks, restitutions, and amplitudes over g."""
    rng = np.random.default_rng(0)
    half_width = rng.uniform(0.1, 0.5, count)
    slenderness = rng.uniform(3, 8, count)
    restitution = rng.uniform(0.5, 0.95, count)
    ratio = rng.uniform(1.2, 4, count)
    return jr.Block(half_width, slenderness), restitution, ratio / slenderness


def interleaved(calls, repeats=11):
    """Median time of each call, taken in turn, after one that compiles."""
    taken = {name: [] for name in calls}
    for repeat in range(repeats + 1):
        for name, call in calls.items():
            start = time.perf_counter()
            call()
            if repeat:
                taken[name].append(time.perf_counter() - start)
    return {name: statistics.median(times) for name, times in taken.items()}


def contenders(count):
    """Print the time of a block under one sine for all that are there."""
    block, c, level = scene(count)

    def ours(rtol=1e-9):
        response = jr.respond_batch(block, c, jr.Sine(9.81 * level, LENGTH), END, rtol=rtol)
        return jax.block_until_ready(response)

    numbers = np.asarray(block.frequency_parameter), np.asarray(block.critical_angle), c, level
    calls = {"jaxrock, rtol 1e-9": ours, "jaxrock, rtol 1e-6": lambda: ours(1e-6)}
    if importlib.util.find_spec("numba"):
        calls["Numba, order 12, 1e-11"] = lambda: numba_taylor(*numbers, LENGTH, END)
    if importlib.util.find_spec("heyoka"):
        calls["heyoka, 1e-9"] = lambda: heyoka_batch(*numbers, LENGTH, END)
    exact = np.asarray(ours(1e-14).peak_rotation)
    for name, taken in interleaved(calls).items():
        found = calls[name]()
        error = "" if name.startswith("heyoka") else f", {off(found, exact)}"
        print(f"{count:7} blocks {name:24} {1e6 * taken / count:7.2f} us a block{error}")


def off(found, exact):
    """Error of peak rotations, in words."""
    peaks = np.asarray(getattr(found, "peak_rotation", found))
    error = np.abs(peaks / exact - 1)[exact < 0.5 * np.pi]
    return f"peaks {np.median(error):.0e} off in the median, {np.quantile(error, 0.99):.0e} at 99 %"


def work_precision(count):
    """Print error and time against the tolerance, for every shape and a record."""
    block, c, level = scene(count)
    motions = {shape.name: (shape(9.81 * level, LENGTH), 2 * LENGTH) for shape in SHAPES[:-1]}
    motions[jr.Ricker.name] = jr.Ricker(9.81 * level, LENGTH), 5 * LENGTH
    motions["record"] = jr.example_record("north").scaled(1.5), None
    for name, (motion, end) in motions.items():
        calls = {
            rtol: lambda rtol=rtol, motion=motion, end=end: jax.block_until_ready(
                jr.respond_batch(block, c, motion, end, rtol=rtol)
            )
            for rtol in 10.0 ** -np.arange(3, 14)
        }
        exact = np.asarray(
            jr.respond_batch(block, c, motion, end, rtol=1e-15).peak_rotation, dtype=float
        )
        for rtol, taken in interleaved(calls, 3).items():
            print(
                f"{name:24} {rtol:.0e} {1e6 * taken / count:7.2f} us, {off(calls[rtol](), exact)}"
            )


if __name__ == "__main__":
    for number in map(int, sys.argv[1:] or ["2000", "100000"]):
        contenders(number)
    work_precision(2000)
