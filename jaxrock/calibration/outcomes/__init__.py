"""Blocks from outcomes: motions under which they overturned or stood."""

from .outcome_files import Outcomes as Outcomes
from .outcome_files import read_tests as read_tests
