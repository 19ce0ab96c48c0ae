"""Records of miniSEED 2: that they hold the samples which they state.

obspy reads on behind a record that states too many samples, up to the end of the process, and
passes over a last record that is cut.
"""

import re
import struct

import numpy as np

# Sequence number, quality and a blank.
_START = re.compile(rb"[\d \0]{6}[DRQM][ \0]")
_VERSION_3 = b"MS\x03"
# Bytes of a sample by its encoding: only floats can be accelerations.
_FLOATS = {4: 4, 5: 8}
# Where fields stand in the head of a record.
_YEAR = 20
_DAY = 22
_SAMPLES = 30
_OFFSETS = 44
_HEAD = 48


def is_miniseed(content: bytes) -> bool:
    """Tell whether a file begins with a record of miniSEED, also of version 3."""
    return bool(_START.match(content)) or content.startswith(_VERSION_3)


def find_fault(content: bytes) -> str:
    """Find out why a file cannot be read safely; empty if it can."""
    if content.startswith(_VERSION_3):
        return "miniSEED of version 3 is not read: convert it to version 2"
    if not _START.match(content):
        return "a record of miniSEED was expected at the start"
    order = ">" if 1900 <= int.from_bytes(content[_YEAR : _YEAR + 2], "big") <= 2100 else "<"
    try:
        offset, blockette = struct.unpack_from(f"{order}HH", content, _OFFSETS)
        kind, _, encoding, _, exponent = struct.unpack_from(
            f"{order}HHBBB", content, blockette
        )
    except struct.error:
        return "its first record is cut"
    if kind != 1000 or not 7 <= exponent <= 16 or blockette + 7 > 2**exponent:
        return "blockette 1000 was expected first, with the length of its records"
    length = 2**exponent
    if len(content) % length:
        return (
            f"it has {len(content)} bytes, in records of {length}: its end is cut or damaged"
        )
    if encoding not in _FLOATS:
        return (
            "its samples are no floating-point numbers, but counts of an instrument: remove the"
            " response in obspy and use jaxrock.from_obspy"
        )
    records = np.frombuffer(content, np.uint8).reshape(-1, length)
    # Where samples begin and what they are is the same in all records.
    fields = [*range(_OFFSETS, _HEAD), *range(blockette, blockette + 7)]
    same = (records[:, fields] == records[0, fields]).all()
    year, day, samples = (
        records[:, at : at + 2].copy().view(f"{order}u2").astype(int)
        for at in (_YEAR, _DAY, _SAMPLES)
    )
    # By the date obspy tells which byte of a number comes first.
    dated = ((year >= 1900) & (year <= 2100) & (day >= 1) & (day <= 366)).all()
    inside = offset >= _HEAD and (offset + _FLOATS[encoding] * samples <= length).all()
    return "" if same and dated and inside else "a record in it is damaged"
