"""Suites of records: the twenty that come with jaxrock at a thousand levels each, and a rate.

Of many objects: twelve assessed, and the rates of two hundred between 342 levels.

Run as ``python tests/benchmarks/suites.py``: times of first and next calls, the programs
compiled, and the memory at its largest.
"""

import resource
import statistics
import time

import jax

jax.config.update("jax_enable_x64", True)

import jax.monitoring
import jax.numpy as jnp
import numpy as np

import jaxrock as jr

PROGRAMS = []


def hear(event, seconds, **details):
    """Note the programs that are compiled."""
    del seconds
    name = details.get("fun_name", "")
    if event == "/jax/core/compile/backend_compile_duration" and "_follow_rows" in name:
        PROGRAMS.append(name)


def show(name, run, repeats):
    """Print the time of the first call and the median of the next ones."""
    PROGRAMS.clear()
    times = []
    for _ in range(repeats + 1):
        start = time.perf_counter()
        jax.block_until_ready(jax.tree.leaves(run()))
        times.append(time.perf_counter() - start)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**10
    next_calls = statistics.median(times[1:])
    print(
        f"{name:36} first {times[0]:6.2f} s, next {next_calls:6.2f} s,"
        f" {len(PROGRAMS)} programs, {memory:,.0f} MB"
    )


def make_objects(number):
    """Objects of a museum, 0.6 to 2.2 m high."""
    rng = np.random.default_rng(0)
    height = rng.uniform(0.6, 2.2, number)
    block = jr.Block.from_size(width=height / rng.uniform(2.5, 6.0, number), height=height)
    names = [f"object {k}" for k in range(number)]
    return jr.risk.Inventory(names, block, jr.housner_restitution(block))


def main():
    """Print all."""
    jax.monitoring.register_event_duration_secs_listener(hear)
    block = jr.Block.from_size(width=0.6, height=2.4)
    suite = jr.example_suite()
    levels = jnp.geomspace(0.1, 3.0, 1000)
    hazard = jr.risk.Hazard([0.1, 0.3, 1.0, 3.0], [2e-2, 2e-3, 1e-4, 4e-6])
    site = jr.risk.Site(suite, hazard)
    scaled = suite.scaled(suite.factors(levels, "pgv"))
    show("20 records x 1,000 levels", lambda: jr.respond_batch(block, 0.8, scaled), 5)
    twice = jr.Suite([*scaled, *scaled])
    show("40 records x 1,000 levels", lambda: jr.respond_batch(block, 0.8, twice), 2)
    show(
        "fragility, 25 levels",
        lambda: jr.risk.fragility(block, 0.8, suite, levels[::40]).level.data,
        3,
    )
    show("overturning_rate", lambda: jr.risk.overturning_rate(block, 0.8, site).rate, 1)
    show(
        "its derivatives",
        lambda: jax.grad(lambda b: jr.risk.overturning_rate(b, 0.8, site).rate)(block),
        1,
    )
    # Bars: the first call below 30 s with all imports, the next below 5 s.
    twelve = make_objects(12)

    def assess():
        return jr.risk.assess_inventory(twelve, site, 1e-4).rate.data

    show("12 objects assessed", assess, 1)
    # Bar: below 60 s, with memory that does not grow with the number of objects.
    many = make_objects(200)
    show(
        "200 objects x 342 levels",
        lambda: jr.risk.overturning_rate(many.block, many.restitution, site).rate,
        1,
    )


if __name__ == "__main__":
    main()
