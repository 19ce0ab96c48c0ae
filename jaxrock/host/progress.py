"""Progress of long work: a bar on a terminal, once it takes seconds."""

import contextlib
import sys
import threading
from collections.abc import Iterable, Iterator

from tqdm import tqdm

_open_bars: list[tqdm] = []  # one at most


@contextlib.contextmanager
def count_work(label: str, amount: int | None = None) -> Iterator[tqdm]:
    """Let the body count what it has done by `update`, of an amount if that is known.

    A step inside of another one shows nothing. What it counts the other one counts, so that
    both have to count the same: motions that are simulated.
    """
    if _open_bars:
        yield _open_bars[0]
        return
    with show_progress(None, label, amount) as bar:
        _open_bars.append(bar)
        try:
            yield bar
        finally:
            _open_bars.clear()


def show_progress(items: Iterable | None, label: str, amount: int | None = None) -> tqdm:
    """Iterate over `items`, each of which counts as much as the others."""
    # Somebody may look at a terminal. A process may have been started without a standard error.
    # The tasks of Dask run in other threads, where bars would write over each other.
    is_seen = sys.stderr is not None and sys.stderr.isatty()
    is_seen &= threading.current_thread() is threading.main_thread()
    # What ends within two seconds needs no bar.
    return tqdm(items, desc=label, total=amount, delay=2, leave=False, disable=not is_seen)
