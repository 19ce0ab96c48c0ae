"""Blocks under pulses: jaxrock against heyoka and a loop in Numba.

Run as ``python tests/benchmarks/pulses.py [blocks]``. heyoka and numba are left out where they
are not installed. Set ``taskset -c 0`` and ``NUMBA_NUM_THREADS=1`` for one core.
"""

import importlib.util
import sys

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np
from pulse_contenders import heyoka_batch, numba_taylor
from timing import time_in_turn

import jaxrock as jr

DURATION = 0.5


def make_scene(count):
    """Random blocks, restitutions, and amplitudes over g."""
    random = np.random.default_rng(0)
    block = jr.Block(random.uniform(0.1, 0.5, count), random.uniform(3, 8, count))
    restitution = random.uniform(0.5, 0.95, count)
    return block, restitution, random.uniform(1.2, 4, count) / np.asarray(block.slenderness)


def describe_error(response, exact):
    """Error of peak rotations, in words."""
    error = np.abs(np.asarray(getattr(response, "peak_rotation", response)) / exact - 1)
    error = error[exact < 0.5 * np.pi]
    return f"peaks {np.median(error):.0e} off in the median, {np.quantile(error, 0.99):.0e} at 99 %"


def compare(count):
    """Print the time of a block under one sine for all that are there."""
    block, c, level = make_scene(count)

    def respond(rtol):
        return jr.respond_batch(block, c, jr.Sine(9.81 * level, DURATION), 1.0, rtol=rtol)

    numbers = np.asarray(block.frequency_parameter), np.asarray(block.critical_angle), c, level
    calls = {f"jaxrock, rtol {rtol}": lambda rtol=rtol: respond(rtol) for rtol in (1e-9, 1e-6)}
    if importlib.util.find_spec("numba"):
        calls["Numba, order 12, 1e-11"] = lambda: numba_taylor(*numbers, DURATION, 1.0)
    if importlib.util.find_spec("heyoka"):
        calls["heyoka, 1e-9"] = lambda: heyoka_batch(*numbers, DURATION, 1.0)
    exact = np.asarray(respond(1e-14).peak_rotation)
    for name, seconds in time_in_turn(calls).items():
        # heyoka's loop knows no peaks.
        error = "" if name.startswith("heyoka") else describe_error(calls[name](), exact)
        print(f"{count:7} blocks {name:24} {1e6 * seconds / count:7.2f} us a block, {error}")


if __name__ == "__main__":
    for number in map(int, sys.argv[1:] or ["2000", "100000"]):
        compare(number)
