"""How the ground moves: pulses, records and suites of them, and the files that these are read from.

Names beside those in ``__all__`` are for the other packages.
"""

from .harmonic import Harmonic
from .intensity import MEASURES as MEASURES
from .intensity import intensity_measure
from .motion import Motion
from .pulses import PULSES as PULSES
from .pulses import Cosine, HalfSine, Pulse, Rectangular, Ricker, Sine
from .pulses import pulse_class as pulse_class
from .record import Record
from .record_files import example_record, from_obspy, read_record
from .record_units import speeds_in_name as speeds_in_name
from .record_units import times_in as times_in
from .record_units import units_in_name as units_in_name
from .still import Still
from .suite import Suite
from .suite import positive_measures as positive_measures
from .suite_files import example_suite, read_suite

__all__ = [
    "Cosine",
    "HalfSine",
    "Harmonic",
    "Motion",
    "Pulse",
    "Record",
    "Rectangular",
    "Ricker",
    "Sine",
    "Still",
    "Suite",
    "example_record",
    "example_suite",
    "from_obspy",
    "intensity_measure",
    "read_record",
    "read_suite",
]
