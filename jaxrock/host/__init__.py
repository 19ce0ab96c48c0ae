"""The machine outside: files, signals, threads, progress, printing."""

from . import signals
from .files import check_free, read_regular, written_whole
from .labelled import labelled
from .printing import listed, shown, table
from .progress import with_clock, with_progress
from .threads import mapped

__all__ = [
    "check_free",
    "labelled",
    "listed",
    "mapped",
    "read_regular",
    "shown",
    "signals",
    "table",
    "with_clock",
    "with_progress",
    "written_whole",
]
