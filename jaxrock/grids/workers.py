"""Workers on this machine, each with processors of its own, and perhaps an accelerator."""

import contextlib
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
from distributed import LocalCluster, Worker, WorkerPlugin

from ..host import count_processors

_GPUS = Path("/proc/driver/nvidia/gpus")
# Settings of JAX that a worker takes over, and the environment variables by which a new
# process learns them, since it imports JAX before it could be told anything. With the same
# folder for compiled programs a worker need not compile what this process or another worker
# has compiled.
_OF_CACHE = {
    "jax_compilation_cache_dir": "JAX_COMPILATION_CACHE_DIR",
    "jax_persistent_cache_min_compile_time_secs": "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS",
}


def local_cluster(workers: int | None = None, **options: Any) -> LocalCluster:
    """Start worker processes on this machine, and divide its processors among them.

    Each worker runs one task at a time, with as many threads as it has processors. All
    workers use the compilation cache of this process.

    Parameters
    ----------
    workers : int, optional
        How many, at least 1; by default one for each processor.
    options
        Further options of ``distributed.LocalCluster``.

    Returns
    -------
    distributed.LocalCluster
        A cluster, which a ``distributed.Client`` takes.

    Raises
    ------
    ValueError
        If `workers` is less than 1.
    """
    count = count_processors() if workers is None else workers
    if count < 1:
        raise ValueError(f"workers must be at least 1, got {workers}")
    settings = {variable: getattr(jax.config, name) for name, variable in _OF_CACHE.items()}
    environment = {name: str(value) for name, value in settings.items() if value is not None}
    usual = {"threads_per_worker": 1, "plugins": (OwnProcessors(count),), "env": environment}
    return LocalCluster(n_workers=count, processes=True, **usual | options)


class OwnProcessors(WorkerPlugin):
    """Divide the processors and accelerators of a machine among its workers, by their names.

    XLA starts as many threads as its process has processors, so workers that share all
    processors would slow each other down. Where a batch system gives each worker its own
    processors, this plugin is not needed.

    Parameters
    ----------
    workers : int
        How many there are on the machine, with names that end in a number from 0 on, such as
        ``dask worker --name 0``.
    """

    name = "jaxrock-own-processors"

    def __init__(self, workers: int):
        self.workers = workers

    def setup(self, worker: Worker) -> None:
        """Give the worker its own processors; called before its first task.

        Parameters
        ----------
        worker : distributed.Worker

        Raises
        ------
        ValueError
            If its name has no number.
        """
        # Modulo, because a cluster that has shrunk and grows again goes on counting.
        number = read_worker_number(worker.name) % self.workers
        os.environ.update(choose_accelerator(number, self.workers, os.environ))
        if hasattr(os, "sched_setaffinity"):
            processors = choose_processors(
                sorted(os.sched_getaffinity(0)), number, self.workers
            )
            # Affinity belongs to threads. New ones inherit it, running ones need a
            # call each, and some may end meanwhile.
            threads = Path("/proc/self/task")
            for thread in threads.iterdir() if threads.exists() else [Path("0")]:
                with contextlib.suppress(ProcessLookupError):
                    os.sched_setaffinity(int(thread.name), processors)


def read_worker_number(name: object) -> int:
    """Read the number at the end of a worker's name; a `ValueError` if it has none."""
    # A worker without a name has its address for one, whose port is no number of a worker.
    digits = re.search(r"\d+$", str(name))
    if not digits or ":" in str(name):
        raise ValueError(
            f"workers must have names that end in a number from 0 on, got {name!r}"
        )
    return int(digits[0])


def choose_processors(available: list[int], number: int, workers: int) -> list[int]:
    """Choose the processors of a worker: at least one, several next to each other."""
    # Neighbours often share a cache. More workers than processors share these in
    # turn.
    size = len(available)
    if workers >= size:
        return [available[number % size]]
    return available[number * size // workers : (number + 1) * size // workers]


def choose_accelerator(
    number: int, workers: int, environment: Mapping[str, str]
) -> dict[str, str]:
    """Return the environment by which a worker sees one accelerator, if there are any."""
    # By environment variables, which JAX reads when it first looks for accelerators: before
    # that no task has run. Counted by the files of the driver, since asking JAX would be
    # looking.
    visible = environment.get("CUDA_VISIBLE_DEVICES")
    if visible is None:
        visible = (
            ",".join(str(k) for k, _ in enumerate(_GPUS.iterdir())) if _GPUS.exists() else ""
        )
    names = [name for name in visible.split(",") if name]
    if not names:
        return {}
    variables = {"CUDA_VISIBLE_DEVICES": names[number % len(names)]}
    # JAX would take most of its memory, which several have to share.
    return variables | (
        {"XLA_PYTHON_CLIENT_PREALLOCATE": "false"} if workers > len(names) else {}
    )
