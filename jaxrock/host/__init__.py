"""The machine outside: files, threads, progress, printing of results and of their status."""

from .datasets import add_names as add_names
from .datasets import make_dataset as make_dataset
from .extras import import_optional as import_optional
from .files import defer_interrupts as defer_interrupts
from .files import end_process as end_process
from .files import write_whole as write_whole
from .printing import Printed as Printed
from .printing import Shown as Shown
from .printing import describe_status as describe_status
from .printing import format_fields as format_fields
from .printing import format_number as format_number
from .printing import format_outside as format_outside
from .printing import format_table as format_table
from .progress import count_work as count_work
from .progress import show_progress as show_progress
from .status import Status as Status
from .threads import count_processors as count_processors
from .threads import map_in_threads as map_in_threads
