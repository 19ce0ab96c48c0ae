"""How the ground moves: pulses, records, and the files that records are read from.

Names beside those in ``__all__`` are for the other packages.
"""

from .motion import Motion
from .pulses import PULSES as PULSES
from .pulses import Cosine, HalfSine, Pulse, Rectangular, Ricker, Sine
from .pulses import pulse_class as pulse_class
from .record import Record
from .record import padded as padded
from .record import room_for as room_for
from .record_files import example_record, from_obspy, read_record

__all__ = [
    "Cosine",
    "HalfSine",
    "Motion",
    "Pulse",
    "Record",
    "Rectangular",
    "Ricker",
    "Sine",
    "example_record",
    "from_obspy",
    "read_record",
]
