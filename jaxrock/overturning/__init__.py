"""Inverse questions in driven motion: every boundary between standing and overturning."""

from .boundaries import Boundaries, overturning_boundaries
from .boundaries import find_boundaries as find_boundaries
from .pulse_thresholds import critical_amplitude
from .pulse_thresholds import make_ratios as make_ratios
from .quantities import UNITS as UNITS
from .quantities import Search as Search
from .quantities import Subject as Subject
from .quantities import format_value as format_value
from .uplift import check_single as check_single
from .uplift import uplift_factor

__all__ = ["Boundaries", "critical_amplitude", "overturning_boundaries", "uplift_factor"]
