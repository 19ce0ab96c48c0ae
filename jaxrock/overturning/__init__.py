"""Inverse questions in driven motion: every boundary between standing and overturning."""

from .boundaries import Boundaries, overturning_boundaries
from .boundaries import find_boundaries as find_boundaries
from .factor_search import critical_factor, uplift_factor
from .pulse_thresholds import (
    SurvivalWindows,
    critical_amplitude,
    critical_duration,
    survival_windows,
)
from .pulse_thresholds import check_range as check_range
from .pulse_thresholds import search_amplitudes_alone as search_amplitudes_alone
from .quantities import UNITS as UNITS
from .quantities import Search as Search
from .quantities import Subject as Subject
from .quantities import check_subject as check_subject
from .quantities import format_value as format_value

__all__ = ["Boundaries", "SurvivalWindows"]
__all__ += [
    "critical_amplitude",
    "critical_duration",
    "critical_factor",
    "overturning_boundaries",
    "survival_windows",
    "uplift_factor",
]
