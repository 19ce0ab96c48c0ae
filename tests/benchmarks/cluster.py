"""Two worker processes with a processor each against one process with two threads.

Run as ``python tests/benchmarks/cluster.py``; with ``small`` a tenth of it. Two grids: 20 million
points in closed form, and 20 records x 1,000 blocks x 20 factors. In memory, and by workers:
added up there, gathered here, written to a Zarr store. After compilation, in turns, medians. Then
what a chunk costs beside its work, and the memory of a worker over the length of its chunks.
"""

import os
import shutil
import statistics
import sys
import tempfile
import time
from pathlib import Path

import jax
import numpy as np

ROUNDS = 3


def closed_form(share):
    """Of 20 million points, and chunks of 2^20."""
    import jaxrock as jr

    axes = (np.linspace(3, 10, 400), np.linspace(0.2, 2, int(500 * share)))
    axes += (np.linspace(0.5, 0.9, 100), 0.15)

    def grid(**options):
        return jr.resonance_spectrum(*axes, model="nonlinear", **options)

    return grid, {"slenderness": 20}


def driven(share):
    """Of 20 records, 1,000 blocks and 20 factors, and chunks of two records."""
    import jaxrock as jr

    suite, factors = jr.example_suite(), np.linspace(0.5, 3, 20)
    axes = (np.linspace(1, 6, int(50 * share)), np.linspace(3, 10, 20))

    def grid(**options):
        return jr.rocking_spectrum(suite, *axes, 0.85, factor=factors, **options)

    return grid, {"record": 1}


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
    import jaxrock as jr
    from distributed import Client

    store = folder / "grid.zarr"

    def afresh(write):
        shutil.rmtree(store, ignore_errors=True)
        return taken(write)

    with jr.cluster.local_cluster(2) as cluster, Client(cluster) as client:
        idle = max(client.run(peak_memory).values())

        def by_workers():
            return grid(chunks=chunks)

        jobs = {
            "in memory": lambda: taken(grid),
            "workers, added up there": lambda: taken(lambda: added_up(by_workers())),
            "in memory, added up": lambda: taken(lambda: added_up(grid())),
            "workers, gathered": lambda: taken(lambda: by_workers().compute()),
            "in memory, stored": lambda: afresh(lambda: grid().to_zarr(store, zarr_format=2)),
            "workers, stored": lambda: afresh(
                lambda: jr.cluster.write_zarr(by_workers(), store)
            ),
        }
        seconds = {job: [] for job in jobs}
        for number in range(ROUNDS + 1):
            for job, time_of in jobs.items():
                found = time_of()
                if number:  # before that it compiles
                    seconds[job].append(found)
        medians = {job: statistics.median(found) for job, found in seconds.items()}
        size = max(v.size for v in by_workers().data_vars.values())
        weight = sum(f.stat().st_size for f in store.rglob("*") if f.is_file())
        count = len(by_workers().rotation_ratio.data.dask.layers) and by_workers().rotation_ratio.data.npartitions
        print(f"{name}: {size:,} answers in {count} chunks, {ROUNDS} rounds")
        for job, median in medians.items():
            against = medians["in memory" + ("" if "gathered" in job else job[7:].replace(" there", ""))]  # fmt: skip
            ratio = f", {median / against:.2f} of in memory" if job.startswith("workers") else ""
            print(f"  {job:26} {median:7.2f} s{ratio}")
        peak = max(client.run(peak_memory).values())
        print(f"  store: {weight / size:.0f} bytes an answer")
        print(f"  memory of a worker: {peak:.0f} MB, {idle:.0f} MB before")


def overhead():
    """Print what a chunk costs beside its work: of tiny ones, and the memory over their length."""
    import jaxrock as jr
    from distributed import Client

    def grid(count):
        axes = (np.linspace(3, 10, 1000), np.linspace(0.2, 2, 10), [0.6, 0.7], 0.15)
        return jr.resonance_spectrum(*axes, chunks={"slenderness": 1000 // count})

    with jr.cluster.local_cluster(2) as cluster, Client(cluster), tempfile.TemporaryDirectory() as f:
        grid(10).compute()
        for name, job in (
            ("added up", lambda count: added_up(grid(count))),
            ("stored", lambda count: jr.cluster.write_zarr(grid(count), f"{f}/{count}-{time.time()}.zarr")),
        ):
            few, many = (min(taken(lambda c=c: job(c)) for _ in range(3)) for c in (10, 500))
            print(f"a chunk, {name}: {1e3 * (many - few) / 490:.1f} ms beside its work")


def memory(folder):
    """Print the memory of a worker over the length of its chunks."""
    import jaxrock as jr
    from distributed import Client

    for length in (5, 20, 80):
        grid, _ = closed_form(1.0)
        with jr.cluster.local_cluster(2) as cluster, Client(cluster) as client:
            lazy = grid(chunks={"slenderness": length})
            jr.cluster.write_zarr(lazy, folder / f"{length}.zarr")
            found = [*client.run(peak_memory).values()]
            points = length * 50_000
            print(f"chunks of {points:,} points ({points * 7 * 8 / 1e6:.0f} MB): {max(found):.0f} MB")


def main():
    """Measure all of it."""
    jax.config.update("jax_enable_x64", True)
    share = 0.1 if "small" in sys.argv else 1.0
    with tempfile.TemporaryDirectory(dir=os.environ.get("TMPDIR")) as name:
        folder = Path(name)
        compare("closed form", *closed_form(share), folder)
        compare("records", *driven(share), folder)
        overhead()
        memory(folder)


if __name__ == "__main__":
    main()
