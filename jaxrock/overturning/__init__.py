"""What just overturns a block: every boundary between standing and overturning.

Names beside those in ``__all__`` are for the other packages.
"""

from .boundaries import Boundaries, overturning_boundaries
from .boundaries import boundaries_of as boundaries_of
from .pulse_thresholds import (
    SurvivalWindows,
    critical_amplitude,
    critical_duration,
    survival_windows,
)
from .pulse_thresholds import check_range as check_range
from .pulse_thresholds import each_critical_amplitude as each_critical_amplitude
from .quantities import UNITS as UNITS
from .quantities import Search as Search
from .quantities import checked as checked

__all__ = ["Boundaries", "SurvivalWindows"]
__all__ += [
    "critical_amplitude",
    "critical_duration",
    "overturning_boundaries",
    "survival_windows",
]
