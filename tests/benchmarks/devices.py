"""Grids and batches on one, two and four devices of the processor: the same numbers, as fast.

Run as ``python tests/benchmarks/devices.py``. One process for each number of devices, taking
turns; compilation, which each device needs once, is not in the times. A processor has the same
cores however many devices it is cut into: the bar is that nothing becomes slower.
"""

import hashlib
import json
import os
import statistics
import subprocess
import sys
import time

COUNTS = (1, 2, 4)
TURNS = 2
REPEATS = 5


def measure():
    """In a process of its own: times, and a digest of every number."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import numpy as np

    import jaxrock as jr

    rng = np.random.default_rng(0)
    blocks = jr.Block(rng.uniform(0.1, 0.5, 20_000), rng.uniform(3, 8, 20_000))
    axes = (np.linspace(3, 10, 128), np.linspace(0.4, 1.2, 64), np.linspace(0.5, 0.8, 128))
    jobs = {
        "spectrum, 1,048,576 points": lambda: jr.resonance_spectrum(
            *axes, 0.15, model=jr.Nonlinear()
        ),
        "batch, 20,000 blocks": lambda: jr.respond_batch(
            blocks, 0.9, jr.example_record(), 20.0
        ),
    }
    found = {}
    for name, job in jobs.items():
        taken = []
        for repeat in range(REPEATS + 1):
            begin = time.perf_counter()
            answer = job()
            if repeat:
                taken.append(time.perf_counter() - begin)
        numbers = hashlib.sha256()
        arrays = jax.tree.leaves(answer) if "batch" in name else answer.data_vars.values()
        for array in arrays:
            numbers.update(np.asarray(array).tobytes())
        found[name] = (statistics.median(taken), numbers.hexdigest())
    print(json.dumps(found))


def main():
    """Print the times, the ratio to one device, and whether the numbers are the same."""
    results = {count: [] for count in COUNTS}
    for _ in range(TURNS):
        for count in COUNTS:
            flags = f"--xla_force_host_platform_device_count={count}"
            done = subprocess.run(
                [sys.executable, __file__, "measure"],
                env=os.environ | {"XLA_FLAGS": flags},
                check=True,
                capture_output=True,
                text=True,
            )
            results[count].append(json.loads(done.stdout))
    for name in results[1][0]:
        digests = {found[name][1] for turns in results.values() for found in turns}
        print(f"{name}: {'the same numbers' if len(digests) == 1 else 'NUMBERS DIFFER'}")
        single = statistics.median(found[name][0] for found in results[1])
        for count, turns in results.items():
            median = statistics.median(found[name][0] for found in turns)
            ratio = median / single
            print(
                f"  {count} devices {1e3 * median:8.0f} ms, {ratio:.2f} times (bar: 1, as slow)"
            )


if __name__ == "__main__":
    measure() if sys.argv[1:] else main()
