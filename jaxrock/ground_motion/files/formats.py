"""Formats of whole files, each told by the first lines, and the readers for them.

Tables in .csv files are read beside it, since a caller picks columns of them.
"""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

from .at2 import read_at2
from .components import Component
from .cosmos import read_cosmos, recognize_cosmos
from .csmip import read_csmip, recognize_csmip
from .directions import find_name_direction, settle_direction
from .esm import read_esm, recognize_esm
from .geonet import read_geonet, recognize_geonet
from .knet import KNET_SUFFIXES, read_knet, recognize_knet
from .obspy_files import TRACE_SUFFIXES, find_trace_format, read_traces
from .smc import read_smc, recognize_smc
from .text import RecordText, Statements

# Takes a text, and what the caller states about unit and time step, which the file must not
# contradict; returns its components, one or several.
Reader = Callable[[RecordText, Statements, Statements], list[Component]]


class FileFormat(NamedTuple):
    """A format of text files.

    Attributes
    ----------
    name : str
        For messages.
    suffixes : tuple of str
        Ends of names by which files of a folder are taken; any other name is read as well.
    recognize : callable
        Tells by the lines of a text whether it is of this format.
    read : callable
        Reads the components.
    """

    name: str
    suffixes: tuple[str, ...]
    recognize: Callable[[list[str]], bool]
    read: Reader


FORMATS: tuple[FileFormat, ...] = (
    FileFormat("ESM/ITACA", (".asc",), recognize_esm, read_esm),
    FileFormat("COSMOS", (".v1c", ".v2c"), recognize_cosmos, read_cosmos),
    FileFormat("CSMIP", (".v1", ".v2", ".raw"), recognize_csmip, read_csmip),
    FileFormat("GeoNet", (".v1a", ".v2a"), recognize_geonet, read_geonet),
    FileFormat("SMC", (".smc",), recognize_smc, read_smc),
    FileFormat("K-NET", KNET_SUFFIXES, recognize_knet, read_knet),
)


def list_suffixes() -> tuple[str, ...]:
    """List the ends of names, in lower case, of the files in a folder that are read."""
    return (
        ".at2",
        ".csv",
        *TRACE_SUFFIXES,
        *(suffix for each in FORMATS for suffix in each.suffixes),
    )


def read_components(
    path: Path, units: Statements, steps: Statements, paths: Iterable[Path] = ()
) -> list[Component]:
    """Read all components of a file that is no .csv file; a `ValueError` if it cannot be.

    Its name, among those of other files, the `paths`, says where a single one points, if the
    file does not.
    """
    components = _read_format(path, units, steps, paths)
    if len(components) == 1 and not components[0].direction:
        stated = settle_direction(find_name_direction(path, paths), "")
        return [components[0]._replace(direction=stated or "")]
    return components


def _read_format(
    path: Path, units: Statements, steps: Statements, paths: Iterable[Path]
) -> list[Component]:
    """Read all components of a file, of a format told by its content or its name."""
    if find_trace_format(path):
        return read_traces(path, units, steps)
    text = RecordText(path)
    if path.suffix.lower() == ".at2":
        return read_at2(text, units, steps, paths)
    for each in FORMATS:
        if each.recognize(text.lines):
            return each.read(text, units, steps)
    names = ", ".join([".AT2", ".csv", "miniSEED", "SAC", *(each.name for each in FORMATS)])
    raise text.make_error(
        f"a file in one of these formats was expected: {names}; columns with commas, or one,"
        " are a .csv file"
    )
