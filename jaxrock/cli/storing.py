"""Base class of commands whose datasets can go to a Zarr store, computed by workers."""

import contextlib
import math
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from ..host import count_processors
from .command import OF_STORE, Answer, Count, Writing
from .signals import shield_from_interrupts

if TYPE_CHECKING:
    import xarray


class Storing(Writing):
    """A command that writes files, or a Zarr store that another run of it can go on with."""

    store: Annotated[Path | None, OF_STORE] = None
    """Zarr store to write instead of the files; one that this command has begun is continued."""
    chunks: Annotated[tuple[str, ...], OF_STORE] = ()
    """Points along a dimension in one task, as NAME=COUNT; some seconds of work if not given."""
    workers: Annotated[Count | None, OF_STORE] = None
    """Processes of this machine that compute the store; one for each processor if not given."""
    scheduler: Annotated[str | None, OF_STORE] = None
    """Address of a Dask scheduler, whose workers compute the store then."""

    def check(self) -> None:
        """Raise `ValueError` also for options that go with a store only, or without one."""
        if self.store is None:
            self.refuse("chunks", "workers", "scheduler", only_with="a store")
        elif Path(self.out or "").name != str(type(self).out) or self.force:
            raise ValueError("out and force go without a store only, which is not overwritten")
        if self.scheduler == "":
            raise ValueError("scheduler must be an address, such as tcp://host:8786, got ''")
        if self.workers is not None and self.scheduler is not None:
            raise ValueError("workers and scheduler exclude each other, got both")
        if self.workers is not None and self.workers < 1:
            raise ValueError(f"workers must be at least 1, got {self.workers}")
        # A property that checks; it is used below the `yield` of some commands only.
        _ = self.lengths
        super().check()

    def run(self) -> Answer:
        """Compute and write files, or the store."""
        # A store need not be written whole: the same command goes on with a part of it.
        return super().run() if self.store is None else self._finish(None)

    @property
    def targets(self) -> list[Path]:
        """The paths that it writes: its files, or the store."""
        return super().targets if self.store is None else [self.store]

    @property
    def lengths(self) -> dict[str, int] | Literal["auto"]:
        """The lengths of chunks by dimension, or "auto"."""
        lengths = dict[str, int]()
        for word in self.chunks:
            name, equals, count = word.partition("=")
            if not (name and equals and count.isdecimal() and int(count) > 0):
                raise ValueError(
                    f"chunks must be NAME=COUNT, such as width=50, got {word!r:.60}"
                )
            if (name := name.replace("-", "_")) in lengths:
                raise ValueError(f"chunks must name a dimension once, got {name} twice")
            lengths[name] = int(count)
        return lengths or "auto"

    def write_store(
        self, lazy: "xarray.Dataset", answer: Callable[["xarray.Dataset"], Answer]
    ) -> Answer:
        """Write a lazy dataset to the store, and say how much of it was there before."""
        import xarray

        from ..grids import write_zarr

        (store,) = self.targets
        self._compare_with_workers(lazy)
        dataset = lazy.assign_attrs(self.about)
        with self._connect():
            stored = write_zarr(dataset, store)
            # The answer is made from the store, inside of the workers' lifetime: Dask computes
            # its shares by them, and no number is computed twice.
            with xarray.open_zarr(store, zarr_format=2) as found:
                said = answer(found)
        data = {
            "store": str(store),
            "chunks": stored.chunks,
            "taken_over": stored.taken_over,
        }
        return Answer(f"{said.text}\n{stored}", {**said.data, **data}, said.code, said.errors)

    def _compare_with_workers(self, lazy: "xarray.Dataset") -> None:
        """Remark on workers that have nothing to do, for want of chunks."""
        # How many workers a scheduler has may change while they work.
        if self.scheduler is not None:
            return
        workers = self.workers or count_processors()
        chunks = math.prod(len(lengths) for lengths in lazy.chunks.values())
        if chunks < workers:
            count = "is 1 chunk" if chunks == 1 else f"are {chunks} chunks"
            warnings.warn(
                f"there {count} for {workers} workers: with --chunks there are more",
                stacklevel=2,
            )

    @contextlib.contextmanager
    def _connect(self) -> Iterator[None]:
        """Connect Dask to workers: those of the scheduler, or some that are started here."""
        # Dask takes a second to import, and only stores need it.
        from concurrent.futures import CancelledError

        from distributed import Client
        from distributed.scheduler import KilledWorker

        from ..grids import local_cluster

        # The client is closed before the cluster that it belongs to.
        with contextlib.ExitStack() as stack:
            if self.scheduler is None:
                with shield_from_interrupts():
                    where = stack.enter_context(local_cluster(self.workers))
            else:
                where = self.scheduler
            client = stack.enter_context(Client(where))
            # Only for somebody who watches: in a log the address would be a line that differs.
            if sys.stderr.isatty():
                print(f"jaxrock: dashboard at {client.dashboard_link}", file=sys.stderr)
            try:
                yield
            # Errors of Dask are long and about its insides: each becomes one sentence.
            except KilledWorker as error:
                reason = (
                    "workers ended again and again at one chunk, perhaps for want of memory"
                )
                raise ValueError(f"{reason}: {error}") from error
            except CancelledError as error:
                raise ValueError("the scheduler was lost; the same command goes on") from error
            except RuntimeError as error:  # such as where workers have no jaxrock
                raise ValueError(f"the workers cannot do it: {error}") from error
