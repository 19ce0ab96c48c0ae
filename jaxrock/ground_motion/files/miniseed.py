"""Records of miniSEED 2: that they hold the samples which they state.

obspy reads on behind a record that states too many samples, up to the end of the process, and
passes over a last record that is cut. The fields are described in chapter 8 of the manual,
https://www.fdsn.org/pdf/SEEDManual_V2.4.pdf.
"""

import re
import struct
from typing import NamedTuple

from ...oldtables import NamedFile

# Sequence number, quality and a blank.
_START = re.compile(rb"[\d \0]{6}[DRQM][ \0]")
_VERSION_3 = b"MS\x03"
# Bytes of a sample by its encoding: only floats can be accelerations.
_FLOATS = {4: 4, 5: 8}
# Where fields stand in the head of a record, and the first blockette behind it.
_CODES = slice(8, 20)
_BLOCKETTES = 39
_YEAR = 20
# From the year on: year, day, samples, and where they and the first blockette begin.
_FIELDS = "HH6xH12xHH"
_HEAD = 48
# Lengths of records, as powers of 2.
_EXPONENTS = range(7, 17)


class _Layout(NamedTuple):
    """The bytes of a record, where its samples begin, and SEED's codes for how they are written."""

    length: int
    offset: int
    encoding: int
    word_order: int


def is_miniseed(content: bytes) -> bool:
    """Return whether a file begins with a record of miniSEED, also of version 3."""
    return bool(_START.match(content)) or content.startswith(_VERSION_3)


def count_samples(file: NamedFile, content: bytes) -> int:
    """Count the samples that the records of a file state, and hold as floating-point numbers."""
    if content.startswith(_VERSION_3):
        raise file.error("miniSEED of version 3 is not read: convert it to version 2")
    # All records of a channel have one layout, unless some have more blockettes.
    layouts: dict[tuple[bytes, int], _Layout] = {}
    start = 0
    samples = 0
    while start < len(content):
        if not _START.match(content, start):
            raise file.error(f"a record of miniSEED was expected at byte {start}")
        record = content[start : start + 2 ** _EXPONENTS[-1]]
        try:
            layout, stated = _measure_record(record)
        except ValueError as error:
            raise file.error(f"the record at byte {start} {error}") from None
        first = layouts.setdefault((record[_CODES], record[_BLOCKETTES]), layout)
        if layout != first:
            raise file.error(
                f"the record at byte {start} is damaged: it has {layout._asdict()}, an earlier"
                f" one of its channel {first._asdict()}"
            )
        start += layout.length
        samples += stated
    return samples


def _measure_record(record: bytes) -> tuple[_Layout, int]:
    """Return the layout and the number of samples of the record with which some bytes begin."""
    # obspy finds by the date which byte of a number comes first.
    order = ">" if 1900 <= int.from_bytes(record[_YEAR : _YEAR + 2], "big") <= 2100 else "<"
    try:
        year, day, samples, offset, at = struct.unpack_from(order + _FIELDS, record, _YEAR)
        encoding, word_order, exponent = _read_blockette_1000(record, at, order)
    except struct.error:
        raise ValueError("is cut") from None
    if not 1900 <= year <= 2100 or not 1 <= day <= 366:
        raise ValueError(f"is damaged: its date is day {day} of {year}")
    # obspy loses its warnings of a record if it cannot decode the codes.
    if not record[_CODES].isascii():
        raise ValueError(f"is damaged: its station and channel are {record[_CODES]!r}")
    if encoding not in _FLOATS:
        raise ValueError(
            "has no floating-point numbers, but counts of an instrument: remove the response in"
            " obspy and use jaxrock.ground_motion.from_obspy"
        )
    length = 2**exponent
    if len(record) < length:
        raise ValueError(f"is cut: it has {len(record)} bytes of {length}")
    if offset < _HEAD or offset + _FLOATS[encoding] * samples > length:
        raise ValueError(
            f"is damaged: it states {samples} samples from byte {offset} of {length} on"
        )
    return _Layout(length, offset, encoding, word_order), samples


def _read_blockette_1000(record: bytes, at: int, order: str) -> tuple[int, int, int]:
    """Follow the chain of blockettes; return encoding, word order and exponent of the length."""
    before = _HEAD - 1
    # A chain that leads back would never end.
    while at > before:
        before = at
        kind, at = struct.unpack_from(f"{order}HH", record, before)
        if kind == 1000:
            encoding, word_order, exponent = struct.unpack_from("BBB", record, before + 4)
            if exponent not in _EXPONENTS or before + 8 > 2**exponent:
                raise ValueError(f"is damaged: its length is 2 to the power of {exponent}")
            return encoding, word_order, exponent
    raise ValueError("has no blockette 1000, which states its length and what its samples are")
