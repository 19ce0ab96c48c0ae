"""Two worker processes with a processor each against one process with two threads.

Run as ``python tests/benchmarks/cluster.py``; with ``small`` a tenth of it. Two grids: 20
million points in closed form, and 20 records x 1,000 blocks x 20 factors. In memory, and by
workers: added up there, gathered here, written to a Zarr store. After compilation, in turns,
medians. Then what a chunk costs beside its work, and the memory of a worker over the length of
its chunks.
"""

import shutil
import statistics
import sys
import tempfile
import time
from pathlib import Path

import jax
import numpy as np
from distributed import Client

import jaxrock as jr

ROUNDS = 3
AGAINST = {
    "workers, added up there": "in memory, added up",
    "workers, gathered": "in memory",
    "workers, stored": "in memory, stored",
}


def closed_form(share=1.0):
    """A function that makes the grid of 20 million points, and its chunks."""
    axes = (np.linspace(3, 10, 400), np.linspace(0.2, 2, int(500 * share)))
    axes += (np.linspace(0.5, 0.9, 100), 0.15)
    return lambda **options: jr.resonance_spectrum(*axes, model="nonlinear", **options), 40


def driven(share=1.0):
    """A function that makes the grid of 20 records, and its chunks."""
    suite = jr.example_suite()
    factors = np.linspace(0.5, 3, 20)
    axes = (np.linspace(1, 6, int(50 * share)), np.linspace(3, 10, 20), 0.85)
    return lambda **options: jr.rocking_spectrum(suite, *axes, factor=factors, **options), 1


def taken(function):
    """Seconds."""
    begin = time.perf_counter()
    function()
    return time.perf_counter() - begin


def added_up(dataset):
    """The mean of every variable, which needs all of them."""
    return dataset.mean().compute()


def peak_memory():
    """Of this process [MB]."""
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def compare(name, grid, chunks, folder):
    """Print the times of one grid."""
    store = folder / "grid.zarr"

    def afresh(write):
        shutil.rmtree(store, ignore_errors=True)
        return taken(write)

    def lazy():
        return grid(chunks=chunks)

    with jr.grids.local_cluster(2) as cluster, Client(cluster) as client:
        idle = max(client.run(peak_memory).values())
        jobs = {
            "in memory": lambda: taken(grid),
            "in memory, added up": lambda: taken(lambda: added_up(grid())),
            "workers, added up there": lambda: taken(lambda: added_up(lazy())),
            "workers, gathered": lambda: taken(lambda: lazy().compute()),
            "in memory, stored": lambda: afresh(lambda: grid().to_zarr(store, zarr_format=2)),
            "workers, stored": lambda: afresh(lambda: jr.grids.write_zarr(lazy(), store)),
        }
        seconds = {job: [] for job in jobs}
        for number in range(ROUNDS + 1):
            for job, time_of in jobs.items():
                found = time_of()
                if number:  # before that it compiles
                    seconds[job].append(found)
        peak = max(client.run(peak_memory).values())
    medians = {job: statistics.median(found) for job, found in seconds.items()}
    largest = lazy().rotation_ratio
    weight = sum(f.stat().st_size for f in store.rglob("*") if f.is_file()) / largest.size
    print(f"{name}: {largest.size:,} answers in {largest.data.npartitions} chunks")
    for job, median in medians.items():
        ratio = f", {median / medians[AGAINST[job]]:.2f} of that" if job in AGAINST else ""
        print(f"  {job:24} {median:7.2f} s{ratio}")
    print(f"  store: {weight:.0f} bytes an answer", flush=True)
    print(f"  memory of a worker: {peak:.0f} MB, {idle:.0f} MB before", flush=True)


def overhead(folder):
    """Print what a chunk costs beside its work, by many small ones."""

    def grid(count):
        axes = (np.linspace(3, 10, 1000), np.linspace(0.2, 2, 10), [0.6, 0.7], 0.15)
        return jr.resonance_spectrum(*axes, chunks={"slenderness": 1000 // count})

    def stored(count):
        return jr.grids.write_zarr(grid(count), folder / f"{time.time()}.zarr")

    with jr.grids.local_cluster(2) as cluster, Client(cluster):
        for name, job in (
            ("added up", lambda count: added_up(grid(count))),
            ("stored", stored),
        ):
            job(10)
            few, many = (min(times(job, count)) for count in (10, 500))
            print(f"a chunk, {name}: {1e3 * (many - few) / 490:.1f} ms", flush=True)


def times(job, argument):
    """Seconds, three times."""
    return [taken(lambda: job(argument)) for _ in range(3)]


def memory(folder):
    """Print the memory of a worker over the length of its chunks, and over their number."""
    axes = np.linspace(0.2, 2, 500), np.linspace(0.5, 0.9, 100), 0.15
    for length, count in ((5, 20), (20, 8), (20, 40), (80, 5)):
        slenderness = np.linspace(3, 10, length * count)
        chunks = {"slenderness": length}
        with jr.grids.local_cluster(2) as cluster, Client(cluster) as client:
            lazy = jr.resonance_spectrum(slenderness, *axes, model="nonlinear", chunks=chunks)
            jr.grids.write_zarr(lazy, folder / f"{length}-{count}.zarr")
            peak = max(client.run(peak_memory).values())
        points = length * 50_000
        about = f"{count} chunks of {points:,} points, {points * 56 / 1e6:.0f} MB"
        print(f"{about}: {peak:.0f} MB", flush=True)


def main():
    """Measure all of it."""
    jax.config.update("jax_enable_x64", True)
    share = 0.1 if "small" in sys.argv else 1.0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        grid, length = closed_form(share)
        compare("closed form", grid, {"slenderness": length}, folder)
        grid, length = driven(share)
        compare("records", grid, {"record": length}, folder)
        overhead(folder)
        memory(folder)


if __name__ == "__main__":
    main()
