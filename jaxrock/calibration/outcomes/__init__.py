"""Populations of blocks from tests that overturned or stood, and scores of their predictions."""

from .outcome_files import Outcomes as Outcomes
from .outcome_files import read_tests as read_tests
