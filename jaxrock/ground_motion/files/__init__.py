"""Files of ground motions: readers, a file each for a kind of source."""

from .examples import example_record as example_record
from .examples import example_suite as example_suite
from .examples import find_suite as find_suite
from .fema_p695 import FEMA_SETS as FEMA_SETS
from .fema_p695 import fema_p695_suite as fema_p695_suite
from .obspy_traces import from_obspy as from_obspy
from .records import list_suffixes as list_suffixes
from .records import read_record as read_record
from .suites import read_suite as read_suite
