"""Ground motions: pulses, records and suites of them, and the files they are read from."""

from .drift import measure_drift as measure_drift
from .files import FEMA_SETS as FEMA_SETS
from .files import (
    example_record,
    example_suite,
    fema_p695_suite,
    from_obspy,
    read_record,
    read_suite,
)
from .files import find_suite as find_suite
from .files import list_suffixes as list_suffixes
from .floor import FLOOR_DAMPING as FLOOR_DAMPING
from .floor import FLOOR_PERIOD as FLOOR_PERIOD
from .floor import Floor
from .floor import choose_floor_step as choose_floor_step
from .harmonic import Harmonic
from .intensity import MEASURES as MEASURES
from .intensity import describe_strength as describe_strength
from .intensity import intensity_measure
from .intensity import warn_of_large_intensities as warn_of_large_intensities
from .motion import Motion
from .pulses import PULSES as PULSES
from .pulses import Cosine, HalfSine, Pulse, Rectangular, Ricker, Sine
from .pulses import check_pulse_class as check_pulse_class
from .record import Record
from .suite import REVERSED as REVERSED
from .suite import Suite
from .suite import average_directions as average_directions
from .suite import describe_suite as describe_suite
from .suite import require_positive_measures as require_positive_measures
from .suite import vary_floor as vary_floor

__all__ = [
    "Cosine",
    "Floor",
    "HalfSine",
    "Harmonic",
    "Motion",
    "Pulse",
    "Record",
    "Rectangular",
    "Ricker",
    "Sine",
    "Suite",
    "example_record",
    "example_suite",
    "fema_p695_suite",
    "from_obspy",
    "intensity_measure",
    "read_record",
    "read_suite",
]
