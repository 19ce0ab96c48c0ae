"""Zarr stores that commands write, computed by workers of this machine."""

import contextlib
import logging
import signal
import sys
from collections.abc import Callable, Iterator
from multiprocessing import resource_tracker
from typing import TYPE_CHECKING

from .answers import Answer
from .options import StoreOptions

if TYPE_CHECKING:
    import xarray


def write_store(
    lazy: "xarray.Dataset",
    options: StoreOptions,
    make_answer: Callable[["xarray.Dataset"], Answer],
) -> Answer:
    """Write a lazy dataset to a store, or the chunks of it that are missing.

    Parameters
    ----------
    lazy : xarray.Dataset
        Of Dask arrays.
    options : StoreOptions
        The store, and how many workers compute it.
    make_answer : callable
        Makes the answer from the dataset in the store, on which Dask computes by the workers.

    Returns
    -------
    Answer
        The same, and how much of the store was there before.

    Raises
    ------
    ValueError
        If the workers cannot do it; what they have written stays for the next run.
    """
    # Dask takes a second to import, and only stores need it.
    import xarray
    from distributed import Client
    from distributed.scheduler import KilledWorker

    from ..grids import local_cluster, write_zarr

    assert options.store is not None
    # What Ctrl-C leaves undone in Dask would be reported in many lines.
    logging.getLogger("asyncio").setLevel(logging.CRITICAL)
    try:
        with contextlib.ExitStack() as stack:
            with _shield_from_interrupts():
                # Whatever goes wrong is said once, below, and not by each worker.
                cluster = stack.enter_context(
                    local_cluster(
                        options.workers,
                        silence_logs=logging.CRITICAL,
                        dashboard_address=":0",  # any port that is free
                    )
                )
            # The client is closed before the cluster that it belongs to.
            client = stack.enter_context(Client(cluster))
            # Only for somebody who watches: in a log the address would be a line that differs.
            if sys.stderr.isatty():
                print(f"jaxrock: dashboard at {client.dashboard_link}", file=sys.stderr)
            try:
                stored = write_zarr(lazy, options.store)
            except RuntimeError as error:  # such as where workers have no jaxrock
                raise ValueError(f"the workers failed: {error}") from error
            with xarray.open_zarr(options.store, zarr_format=2) as dataset:
                answer = make_answer(dataset)
    # Errors of Dask are long and about its insides.
    except KilledWorker as error:
        raise ValueError(
            f"workers ended repeatedly at one chunk, perhaps for lack of memory: {error}"
        ) from error
    data = {
        "store": str(options.store),
        "chunks": stored.chunks,
        "taken_over": stored.taken_over,
    }
    return Answer(
        f"{answer.text}\n{stored}", {**answer.data, **data}, answer.output, (), answer.code
    )


@contextlib.contextmanager
def _shield_from_interrupts() -> Iterator[None]:
    """Let processes that are started inside never hear of Ctrl-C.

    A terminal sends it to all processes of a command. Each worker would print a traceback of
    its own, while this process ends them anyway.
    """
    if not hasattr(signal, "pthread_sigmask"):  # on Windows
        yield
        return
    # Started with the first worker, it would unblock signals of this process.
    resource_tracker.ensure_running()
    # Threads and processes that are started inside inherit the mask, and keep it.
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        # One that came meanwhile was kept back, and is delivered now.
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
