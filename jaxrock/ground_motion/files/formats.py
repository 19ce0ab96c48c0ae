"""Formats of whole files, each told by the first lines, and the readers for them.

A new network is a module beside this one that describes its header, and an entry in `FORMATS`.
Tables in .csv files are read beside them, since a caller picks columns.
"""

import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

from ...oldtables import TextFile, read_content
from .at2 import read_peer
from .bbp import find_bbp_names, read_bbp
from .claims import Claims
from .components import Component
from .cosmos import read_cosmos
from .csmip import CSMIP_TITLE, read_csmip
from .directions import find_name_direction, settle_direction
from .esm import read_esm
from .geonet import GEONET_TITLE, read_geonet
from .knet import KNET_SUFFIXES, read_knet
from .obspy_files import TRACE_SUFFIXES, find_trace_format, read_traces
from .plain import read_plain, recognize_plain
from .smc import read_smc


class FileFormat(NamedTuple):
    """A format of text files."""

    name: str
    # `read_suite` picks files with these ends up from a folder; `read_record` ignores the name.
    suffixes: tuple[str, ...]
    # Returns something true for the lines of a text of this format.
    recognize: Callable[[list[str]], object]
    # Reads the components of a text, which must not contradict what the caller states.
    read: Callable[[TextFile, Claims], list[Component]]


def _begin_with(pattern: str) -> Callable[[list[str]], object]:
    """Recognize a text that begins with a pattern, which may go on in its second line."""
    return lambda lines: re.match(pattern, "\n".join(lines[:2]), re.I)


# The first line of SMC files says what they hold.
_SMC_KINDS = r"unknown|(?:un)?corrected acc|velocity|displacement|response|fourier"
_COSMOS_TITLE = r".*\(format v\d+\.\d+ with\b"

FORMATS: tuple[FileFormat, ...] = (
    FileFormat("ESM/ITACA", (".asc",), _begin_with(r"\s*EVENT_NAME:"), read_esm),
    FileFormat("COSMOS", (".v1c", ".v2c"), _begin_with(_COSMOS_TITLE), read_cosmos),
    FileFormat("CSMIP/RENADIC", (".v1", ".v2", ".raw"), _begin_with(CSMIP_TITLE), read_csmip),
    FileFormat("GeoNet", (".v1a", ".v2a"), _begin_with(GEONET_TITLE), read_geonet),
    FileFormat("SMC", (".smc",), _begin_with(rf"\s*\d\s+(?:{_SMC_KINDS})"), read_smc),
    FileFormat("K-NET", KNET_SUFFIXES, _begin_with("Origin Time"), read_knet),
    FileFormat("Broadband Platform", (".bbp",), find_bbp_names, read_bbp),
    # Any file may begin with numbers, so that this one is the last.
    FileFormat("numbers alone", (), recognize_plain, read_plain),
)


# Tables: a caller picks columns of them.
TABLE_SUFFIXES = (".csv", ".tsv")


def list_suffixes() -> tuple[str, ...]:
    """List the ends of names, in lower case, of the files in a folder that are read."""
    known = (suffix for file_format in FORMATS for suffix in file_format.suffixes)
    return (".at2", *TABLE_SUFFIXES, *TRACE_SUFFIXES, *known)


def read_components(path: Path, claims: Claims, paths: Iterable[Path] = ()) -> list[Component]:
    """Read all components of a file that is no table and may lie beside others, the `paths`."""
    content = read_content(path)
    if find_trace_format(content, path.suffix):
        components = read_traces(path, content, claims)
    elif path.suffix.lower() == ".at2":
        return read_peer(TextFile(path, content), claims, paths)
    else:
        text = TextFile(path, content)
        known = next((known for known in FORMATS if known.recognize(text.lines)), None)
        if known is None:
            names = ", ".join(
                [".AT2", ".csv", "miniSEED", "SAC", *(kind[0] for kind in FORMATS)]
            )
            raise text.error(
                f"a file in one of these formats was expected: {names}. Other networks' files may"
                " be read by obspy or gmprocess, for jaxrock.ground_motion.from_obspy; columns"
                " belong in a .csv file"
            )
        components = known.read(text, claims)
    # The name says where a single one points, if the file does not.
    if len(components) == 1 and not components[0].direction:
        direction = settle_direction(find_name_direction(path, paths), "") or ""
        return [components[0]._replace(direction=direction)]
    return components
