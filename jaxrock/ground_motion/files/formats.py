"""Formats of whole files, each told by the first lines, and the readers for them.

A new network is a module beside this one that describes its header, and an entry in `FORMATS`.
Tables in .csv files are read beside them, since a caller picks columns.
"""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

from ...tables import Statement, TextFile, read_content
from .at2 import read_peer
from .bbp import read_bbp, recognize_bbp
from .claims import Claims
from .components import Component
from .cosmos import read_cosmos, recognize_cosmos
from .csmip import read_csmip, recognize_csmip
from .directions import find_name_direction, settle_direction
from .esm import read_esm, recognize_esm
from .geonet import read_geonet, recognize_geonet
from .knet import KNET_SUFFIXES, read_knet, recognize_knet
from .obspy_files import TRACE_SUFFIXES, find_trace_format, read_traces
from .plain import read_plain, recognize_plain
from .smc import read_smc, recognize_smc
from .text import RecordText

# Takes a text, and what the caller states about unit and time step, which the file must not
# contradict; returns its components, one or several.
Reader = Callable[[TextFile, Claims], list[Component]]


class FileFormat(NamedTuple):
    """A format of text files.

    Attributes
    ----------
    name : str
        For messages.
    suffixes : tuple of str
        Ends of names by which files of a folder are taken; any other name is read as well.
    recognize : callable
        Returns by the lines of a text whether it is of this format.
    read : callable
        Reads the components.
    """

    name: str
    suffixes: tuple[str, ...]
    recognize: Callable[[list[str]], bool]
    read: Reader


def _read_knet(text: TextFile, claims: Claims) -> list[Component]:
    """Read a file of K-NET, until its reader takes a text and claims."""
    units, steps = ([tuple(statement) for statement in kind] for kind in claims)
    return read_knet(RecordText(text.path), units, steps)  # pyright: ignore


FORMATS: tuple[FileFormat, ...] = (
    FileFormat("ESM/ITACA", (".asc",), recognize_esm, read_esm),
    FileFormat("COSMOS", (".v1c", ".v2c"), recognize_cosmos, read_cosmos),
    FileFormat("CSMIP/RENADIC", (".v1", ".v2", ".raw"), recognize_csmip, read_csmip),
    FileFormat("GeoNet", (".v1a", ".v2a"), recognize_geonet, read_geonet),
    FileFormat("SMC", (".smc",), recognize_smc, read_smc),
    FileFormat("K-NET", KNET_SUFFIXES, recognize_knet, _read_knet),
    FileFormat("Broadband Platform", (".bbp",), recognize_bbp, read_bbp),
    # Any file may begin with numbers, so that this one is the last.
    FileFormat("numbers alone", (), recognize_plain, read_plain),
)


def list_suffixes() -> tuple[str, ...]:
    """List the ends of names, in lower case, of the files in a folder that are read."""
    return (
        ".at2",
        ".csv",
        *TRACE_SUFFIXES,
        *(suffix for file_format in FORMATS for suffix in file_format.suffixes),
    )


def read_components(
    path: Path, claims: Claims | Any, paths: Any = (), content: Any = None
) -> list[Component]:
    """Read all components of a file that is no .csv file; a `ValueError` if it cannot be.

    Its name, among those of other files, the `paths`, says where a single one points, if the
    file does not. Its `content` is read from it if it is not given.
    """
    if not isinstance(claims, Claims):
        # Until records.py and suites.py have claims: path, units, steps, paths.
        units, steps, paths, content = claims, paths, content or (), None
        claims = Claims(
            tuple(Statement(*s) for s in units), tuple(Statement(*s) for s in steps)
        )
    components = _read_format(path, claims, paths, content)
    if len(components) == 1 and not components[0].direction:
        stated = settle_direction(find_name_direction(path, paths), "")
        return [components[0]._replace(direction=stated or "")]
    return components


def _read_format(
    path: Path, claims: Claims, paths: Iterable[Path], content: bytes | None
) -> list[Component]:
    """Read all components of a file, of a format told by its content or its name."""
    content = read_content(path) if content is None else content
    # Both will take the content instead of reading the file again, and claims.
    if find_trace_format(path):
        units, steps = ([tuple(statement) for statement in kind] for kind in claims)
        return read_traces(path, units, steps)  # pyright: ignore
    text = TextFile(path, content)
    if path.suffix.lower() == ".at2":
        return read_peer(text, claims, paths)
    for file_format in FORMATS:
        if file_format.recognize(text.lines):
            return file_format.read(text, claims)
    names = ", ".join([".AT2", ".csv", "miniSEED", "SAC", *(known.name for known in FORMATS)])
    raise text.error(
        f"a file in one of these formats was expected: {names}. What a network writes otherwise"
        " may be read by obspy or gmprocess, for jaxrock.ground_motion.from_obspy; columns belong"
        " in a .csv file"
    )
