"""Two worker processes against one process: time, and memory over the number of chunks.

Run as ``python tests/benchmarks/cluster.py``; with ``small`` a tenth of it. Two grids: 20
million points in closed form, and 20 records x 1,000 blocks x 20 factors. In memory, by Dask's
threads into a Zarr store, and by two workers into one. After compilation, in turns, medians.
"""

import resource
import statistics
import sys
import tempfile
import time
from pathlib import Path

import jax
import numpy as np
from distributed import Client, LocalCluster

import jaxrock as jr

ROUNDS = 3


def closed_form(fraction=1.0):
    """A function that makes the grid of 20 million points, and its chunks."""
    axes = (np.linspace(3, 10, 400), np.linspace(0.2, 2, int(500 * fraction)))
    axes += (np.linspace(0.5, 0.9, 100), 0.15)
    chunks = {"slenderness": 20}
    return lambda **options: jr.resonance_spectrum(*axes, model="nonlinear", **options), chunks


def driven(fraction=1.0):
    """A function that makes the grid of 20 records, and its chunks."""
    suite = jr.example_suite()
    factors = np.linspace(0.5, 3, 20)
    axes = (np.linspace(1, 6, int(50 * fraction)), np.linspace(3, 10, 20), 0.85)
    chunks = {"record": 1}
    return lambda **options: jr.rocking_spectrum(
        suite, *axes, factor=factors, **options
    ), chunks


def peak_memory():
    """Of this process [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def measure(function):
    """Seconds."""
    begin = time.perf_counter()
    function()
    return time.perf_counter() - begin


def compare(name, grid, chunks, folder):
    """Print the times of one grid, and the memory of a worker."""

    def store():
        jr.grids.write_zarr(grid(chunks=chunks), folder / f"{time.time()}.zarr")

    def store_by_workers():
        with client.as_current():
            store()

    jobs = {"in memory": grid, "threads, stored": store, "workers, stored": store_by_workers}
    seconds = {job: [] for job in jobs}
    options = {"n_workers": 2, "threads_per_worker": 1}
    with LocalCluster(**options) as cluster, Client(cluster, set_as_default=False) as client:
        for number in range(ROUNDS + 1):
            for job, function in jobs.items():
                passed = measure(function)
                if number:  # before that it compiles
                    seconds[job].append(passed)
        peak = max(client.run(peak_memory).values())
    lazy = grid(chunks=chunks).rotation_ratio
    print(f"{name}: {lazy.size:,} answers in {lazy.data.npartitions} chunks")
    for job, passed in seconds.items():
        print(f"  {job:16} {statistics.median(passed):7.2f} s")
    print(f"  memory of a worker: {peak:.0f} MB", flush=True)


def main():
    """Measure all of it."""
    jax.config.update("jax_enable_x64", True)
    fraction = 0.1 if "small" in sys.argv else 1.0
    for name, make in (("closed form", closed_form), ("records", driven)):
        with tempfile.TemporaryDirectory() as folder:
            compare(name, *make(fraction), Path(folder))


if __name__ == "__main__":
    main()
