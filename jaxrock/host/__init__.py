"""The machine outside: files, signals, threads, progress, printing."""

from . import signals as signals
from .datasets import labelled as labelled
from .datasets import with_names as with_names
from .extras import optional as optional
from .files import check_free as check_free
from .files import read_regular as read_regular
from .files import written_whole as written_whole
from .printing import Printed as Printed
from .printing import derivatives as derivatives
from .printing import listed as listed
from .printing import shown as shown
from .printing import table as table
from .progress import with_clock as with_clock
from .progress import with_progress as with_progress
from .progress import without_progress as without_progress
from .tables import heading as heading
from .tables import is_number as is_number
from .tables import numbered_lines as numbered_lines
from .tables import write_about as write_about
from .tables import write_csv as write_csv
from .threads import mapped as mapped
from .threads import processors as processors
from .threads import settings_of_jax as settings_of_jax
from .threads import under as under
from .version import version as version
