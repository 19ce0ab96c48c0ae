"""The record and the suite that come with the library."""

import tempfile
import zipfile
from importlib.resources import as_file, files

from ...validation import as_name
from ..record import Record
from ..suite import Suite
from .fema_p695 import FEMA_SETS, fema_p695_suite
from .records import read_record
from .suites import read_suite

# Stated wherever answers depend on these records, which are nobody's choice for a site.
EXAMPLE_SOURCE = (
    "the 20 example records of jaxrock, from eight earthquakes in California, Alaska and New"
    " Zealand, not selected for this site"
)


def example_record(component: str = "north", *, vertical: bool = False) -> Record:
    """Return the Ridgecrest earthquake as recorded at China Lake, California.

    Moment magnitude 7.1, 2019-07-06 03:19:53 UTC, station CI.CLC of the Southern California
    Seismic Network: 60 s of uncorrected acceleration, minus the mean before the event.
    Distributed by the Center for Engineering Strong Motion Data; taken from the demonstration
    data of gmprocess 2.8.0 by the U.S. Geological Survey.

    Parameters
    ----------
    component : {"north", "east"}
        The horizontal component, positive in the direction of its name.
    vertical : bool
        Whether to include the vertical component.

    Returns
    -------
    Record
        6001 samples [m/s2], 0.01 s apart.

    Raises
    ------
    ValueError
        If there is no such component.

    Examples
    --------
    >>> from jaxrock import example_record
    >>> record = example_record()
    >>> print(f"{record.samples} samples, at most {abs(record.acceleration).max():.3f} m/s2")
    6001 samples, at most 5.009 m/s2
    """
    component = as_name("component", component, ("north", "east"))
    upward = "up [g]" if vertical else None
    with as_file(files("jaxrock") / "data" / "ridgecrest_2019_clc.csv") as path:
        return read_record(path, column=f"{component} [g]", vertical=upward)


def example_suite(*, vertical: bool = False) -> Suite:
    """Return twenty horizontal components of eight earthquakes, magnitudes 5.9 to 7.8.

    Ten stations of the California Strong Motion Instrumentation Program, the U.S. Geological
    Survey, the Southern California Seismic Network and GeoNet, New Zealand, with peak ground
    velocities of 0.04 to 1.0 m/s. All are free: in the public domain, CC0, or CC BY 3.0 NZ,
    which asks for the attribution "GeoNet programme and its sponsors EQC, GNS Science, LINZ".
    Station, source, processing and licence of each are in the head of its file and in
    ``index.csv`` of ``example_suite.zip`` in the folder ``data`` of the package. Some are
    uncorrected: in one, ``northridge_1994_la_116th_st north``, the ground still moves at 0.64
    of its PGV at the end. Without this drift its PGV is 7 % less.

    Parameters
    ----------
    vertical : bool
        Whether to include the vertical components.

    Returns
    -------
    Suite
        2,000 to 9,000 samples [m/s2], 0.005 to 0.02 s apart.

    Examples
    --------
    >>> from jaxrock import example_suite
    >>> print(example_suite())
    suite of 20 records of 2000 to 9000 samples, 0.005 to 0.02 s apart
    """
    # Unpacked into files, so that the records are read as a user's are.
    archive = files("jaxrock") / "data" / "example_suite.zip"
    with tempfile.TemporaryDirectory() as folder:
        with archive.open("rb") as stream, zipfile.ZipFile(stream) as packed:
            packed.extractall(folder)
        suite = read_suite(folder, vertical=vertical)
    return Suite(suite.records, suite.names, source=EXAMPLE_SOURCE)


def find_suite(name: str) -> Suite:
    """Find a suite by its name: ``"example"``, or ``"fema-"`` and a set of FEMA P695.

    Raises
    ------
    ValueError
        If there is no such suite.
    """
    if name == "example":
        return example_suite()
    names = {f"fema-{record_set}": record_set for record_set in FEMA_SETS}
    if name not in names:
        raise ValueError(
            f"records must be a folder that exists, example, {', '.join(names)}, got {name!r}"
        )
    return fema_p695_suite(names[name])
