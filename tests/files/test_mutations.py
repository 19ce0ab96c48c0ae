"""Files that are cut, shifted, exchanged or encoded otherwise are read right, or refused.

The kinds stand in the table `KINDS`. Files of networks are written by the tests of their formats.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import test_cosmos
import test_csmip
import test_esm
import test_geonet
import test_smc
from references.mutations import read_mutations

import jaxrock as jr

pytestmark = pytest.mark.float64

G = 9.80665
GAL = 0.01
REFUSED = np.nan


class Kind(NamedTuple):
    """A file, how it is read, and what is right.

    Attributes
    ----------
    name : str
        Of the file.
    content : bytes or str
        As it should be.
    read : callable
        Takes the path.
    same : callable
        Takes what was read and perhaps factors by names, and returns whether it is right.
    statements : tuple
        A text, what takes its place, a name, and the factor of this or `REFUSED`.
    """

    name: str
    content: bytes | str
    read: Callable
    same: Callable
    statements: tuple = ()


def read_columns(columns, path, **options):
    return [jr.read_record(path, column=column, **options) for column in columns]


def read_one(path, **options):
    return [jr.read_record(path, **options)]


def match_rows(known, step, samples, row, whole, records, *, acceleration=1.0, time=1.0):
    """Return whether records consist of known rows: which of them changed places, none can say.

    A table without a number of values may be a shorter one.
    """
    known = acceleration * np.concatenate([split_rows(values, row) for values in known])
    for record in records:
        rows = split_rows(np.asarray(record.acceleration), row)
        near = np.isclose(rows[:, None], known, rtol=1e-9, atol=0, equal_nan=True)
        if not near.all(axis=-1).any(axis=1).all():
            return False
        if not abs(float(record.time_step) / (time * step) - 1) < 1e-3:
            return False
        if whole and record.samples != samples:
            return False
    return True


def split_rows(values, row):
    """Split values into rows, the last of which is filled with NaN."""
    return np.append(values, [np.nan] * (-len(values) % row)).reshape(-1, row)


def match_run(right, step, records, *, acceleration=1.0, time=1.0):
    """Return whether a record is the right one, or a part of it without gaps."""
    (record,) = records
    values = np.asarray(record.acceleration)
    right = acceleration * right
    first = int(np.argmin(np.abs(right - values[0])))
    right = right[first : first + values.size]
    fits = right.size == values.size and np.allclose(values, right, rtol=1e-9)
    return fits and abs(float(record.time_step) / (time * step) - 1) < 1e-3


PEER_VALUES = 1e-3 * np.array([1.5, -2, 3, -4.25, 5, -6, 7, -8, 9, -10, 11, -12.5, 13])
PEER_ROWS = ["".join(f"{value:15.7E}" for value in PEER_VALUES[k : k + 5]) for k in (0, 5, 10)]
PEER = (
    "PEER NGA STRONG MOTION DATABASE RECORD\nDuzce, 11/12/1999, Lamont 1061, 090\n"
    "ACCELERATION TIME SERIES IN UNITS OF G\nNPTS=  13, DT=   .0100 SEC\n"
    + "\n".join(PEER_ROWS)
    + "\n"
)


def make_at2():
    right = G * PEER_VALUES
    return Kind(
        "a.AT2",
        PEER,
        read_one,
        partial(match_rows, [right], 0.01, right.size, 1, True),
        (
            ("UNITS OF G", "UNITS OF CM/S2", "acceleration", GAL / G),
            ("UNITS OF G", "UNITS OF CM", "acceleration", REFUSED),
            ("ACCELERATION", "VELOCITY", "acceleration", REFUSED),
            ("ACCELERATION TIME SERIES", "SPECTRAL ACCELERATION", "acceleration", REFUSED),
            (".0100 SEC", ".0100 MSEC", "time", 1e-3),
        ),
    )


SAMPLES = np.random.default_rng(2).normal(size=40).round(6)
SECONDS = 0.01 * np.arange(40)
PRINTED = [f"{t:.2f},{value:.6f}" for t, value in zip(SECONDS, SAMPLES, strict=True)]
SCIENTIFIC = [f"{t:.18e},{value:.18e}" for t, value in zip(SECONDS, SAMPLES, strict=True)]
TABLES = {
    "csv": "# a station, 1999\ntime [s],acc_g\n" + "\n".join(PRINTED) + "\n",
    "numpy": "# a station, 1999\n# time,acc_g\n" + "\n".join(SCIENTIFIC) + "\n",
    "tabs": ("time,acc_g\n" + "\n".join(PRINTED) + "\n").replace(",", "\t"),
    "sep": "sep=,\ntime,acc_g\n" + "\n".join(PRINTED) + "\n",
}


def make_table(layout):
    content = TABLES[layout]
    statements = (
        ("acc_g", "acc_gal", "acceleration", GAL / G),
        ("acc_g", "acc_mm", "acceleration", REFUSED),
        ("acc_g", "Sa_g", "acceleration", REFUSED),
        ("time [s]", "time [ms]", "time", 1e-3),
        ("time", "frequency", "time", REFUSED),
        ("a station, 1999", "sampling rate 50 Hz", "time", REFUSED),
        ("a station, 1999", "Fs = 50 Hz", "time", REFUSED),
        ("a station, 1999", "response spectrum", "acceleration", REFUSED),
    )
    return Kind(
        "a.csv",
        content,
        read_one,
        partial(match_run, G * SAMPLES, 0.01),
        tuple(row for row in statements if row[0] in content),
    )


def make_plain():
    values = np.random.default_rng(3).normal(size=40).round(6)
    numbers = "".join(f"{value:.6f}\n" for value in values)
    return Kind(
        "a.csv",
        "# Time step: 0.01 s\n" + numbers,
        partial(read_one, unit="g", time_step=0.01),
        partial(match_rows, [G * values], 0.01, 40, 1, False),
        (
            ("Time step: 0.01 s", "Time step: 0.005 s", "time", REFUSED),
            ("# Time step: 0.01 s", "Time step: 0.005 s", "time", REFUSED),
            ("Time step: 0.01 s", "fs = 200", "time", REFUSED),
            ("Time step: 0.01 s", "dt = 10 ms", "time", 1),
            ("Time step: 0.01 s", "Accelerations in gal", "acceleration", REFUSED),
            ("Time step: 0.01 s", "Velocities in cm/s", "acceleration", REFUSED),
            # Without this sample all that follow would come too early.
            (f"{values[20]:.6f}", f"# {values[20]:.6f}", "acceleration", REFUSED),
        ),
    )


def make_esm():
    right = test_esm.EAST * GAL
    return Kind(
        test_esm.NAME,
        test_esm.write(),
        read_one,
        partial(match_rows, [right], 0.005, right.size, 1, True),
        (
            ("UNITS: cm/s^2", "UNITS: m/s^2", "acceleration", 100),
            ("UNITS: cm/s^2", "UNITS: cm/s", "acceleration", REFUSED),
            ("TYPE: ACC", "TYPE: VELOCITY OR ACC", "acceleration", REFUSED),
            ("INTERVAL_S: 0.005", "INTERVAL_S: 0.01", "time", REFUSED),
        ),
    )


def make_broadband():
    """A file of SCEC's Broadband Platform: names by blanks, rows by tabs."""
    values = np.random.default_rng(4).normal(0, 30, (3, 40))
    rows = [
        "\t".join([f"{0.02 * k:.6e}", *(f"{value:.6e}" for value in row)])
        for k, row in enumerate(values.T)
    ]
    head = (
        "# Sim stat=S01\n#    time(sec)      N-S(cm/s/s)      E-W(cm/s/s)      U-D(cm/s/s)\n"
    )
    known = [np.array([GAL * float(f"{value:.6e}") for value in row]) for row in values]

    return Kind(
        "s01.acc.bbp",
        head + "".join(row + "\n" for row in rows),
        partial(read_columns, ["NS", "EW", "up"]),
        partial(match_rows, known, 0.02, 40, 1, False),
        (
            ("(cm/s/s)", "(g)", "acceleration", G / GAL),
            ("(cm/s/s)", "(cm/s)", "acceleration", REFUSED),
            ("(cm/s/s)", "(cm)", "acceleration", REFUSED),
            ("time(sec)", "time(ms)", "time", 1e-3),
            ("time(sec)", "freq(Hz)", "time", REFUSED),
            ("Sim stat=S01", "sampling rate 200 Hz", "time", REFUSED),
        ),
    )


def make_cosmos():
    known = [
        GAL * values
        for values in (
            test_cosmos.NORTH,
            test_cosmos.NORTH[:20],
            test_cosmos.EAST,
            test_cosmos.UP,
        )
    ]
    return Kind(
        "made.V2c",
        test_cosmos.STATION,
        partial(read_columns, ["90", "360", "up"]),
        partial(match_rows, known, test_cosmos.STEP, test_cosmos.POINTS, 8, True),
        (
            ("units=cm/sec2", "units=g", "acceleration", REFUSED),
            ("units=cm/sec2 (4)", "units=g (2)", "acceleration", REFUSED),
            ("units=cm/sec2 (4)", "units=counts (50)", "acceleration", REFUSED),
        ),
    )


def make_csmip(volume):
    if volume == 1:
        known = [G * values for values in (test_csmip.EAST, test_csmip.NORTH, test_csmip.UP)]
        statements = (
            ("in units of g.", "in units of cm/sec2.", "acceleration", GAL / G),
            ("in units of g.", "in units of g/10.", "acceleration", 0.1),
            ("at 100 pts/sec", "at 200 pts/sec", "time", REFUSED),
        )
    else:
        motions = test_csmip.WEAK, test_csmip.STRONG, test_csmip.RISING
        # Velocities and displacements are in the file as well.
        known = [GAL * np.round(values / by, 5) for values in motions for by in (1, 100, 1000)]
        statements = (
            ("in cm/sec2.", "in g.", "acceleration", G / GAL),
            ("in cm/sec2.", "in cm/sec.", "acceleration", REFUSED),
            ("at  .010 sec", "at  .020 sec", "time", REFUSED),
        )
    return Kind(
        "made.v2",
        [test_csmip.VOLUME_1, test_csmip.VOLUME_2][volume - 1],
        partial(read_columns, ["90", "360", "up"]),
        partial(match_rows, known, test_csmip.STEP, test_csmip.POINTS, 8, True),
        statements,
    )


def make_geonet():
    known = [test_geonet.ALONG, test_geonet.ACROSS, test_geonet.UP, test_geonet.OTHERS]
    return Kind(
        "made.V2A",
        test_geonet.V2A,
        partial(read_columns, ["N28W", "S62W", "up"]),
        partial(
            match_rows,
            [1e-3 * values for values in known],
            test_geonet.STEP,
            test_geonet.POINTS,
            10,
            True,
        ),
        (
            ("mm/s/s", "cm/s/s", "acceleration", 10),
            ("mm/s/s", "mm/s", "acceleration", REFUSED),
            ("at 0.020 sec", "at 0.010 sec", "time", REFUSED),
        ),
    )


def make_smc():
    right = test_smc.NORTH * GAL
    return Kind(
        "a.smc",
        test_smc.write(),
        read_one,
        partial(match_rows, [right], 0.005, right.size, 1, True),
        (
            ("CORRECTED ACCELEROGRAM", "VELOCITY", "acceleration", REFUSED),
            ("CORRECTED ACCELEROGRAM", "RESPONSE SPECTRUM", "acceleration", REFUSED),
            ("|ref - A. Author", "|acceleration in g", "acceleration", REFUSED),
        ),
    )


def make_knet():
    # Obspy is not there everywhere: then only this kind is left out.
    import test_obspy

    right = test_obspy.COUNTS * test_obspy.KNET_FACTOR
    return Kind(
        "a.ew",
        test_obspy.knet(),
        read_one,
        partial(match_rows, [right], 0.01, right.size, 1, True),
        (
            ("(gal)/", "(g)/", "acceleration", REFUSED),
            ("100Hz", "200Hz", "time", REFUSED),
            ("Dir.              E-W", "Dir.              U-D", "acceleration", REFUSED),
        ),
    )


KINDS = {
    "AT2": make_at2,
    "plain numbers": make_plain,
    "ESM": make_esm,
    "Broadband Platform": make_broadband,
    "COSMOS": make_cosmos,
    "CSMIP volume 1": partial(make_csmip, 1),
    "CSMIP volume 2": partial(make_csmip, 2),
    "GeoNet": make_geonet,
    "SMC": make_smc,
    "K-NET": make_knet,
}
KINDS |= {f"table, {layout}": partial(make_table, layout) for layout in TABLES}


@pytest.mark.parametrize("number", [60, pytest.param(300, marks=pytest.mark.thorough)])
@pytest.mark.parametrize("kind", KINDS)
def test_mutations(tmp_path, kind, number):
    name, content, read, same, statements = KINDS[kind]()
    content = content if isinstance(content, bytes) else content.encode()
    path = Path(tmp_path / name)
    path.write_bytes(content)
    assert same(read(path))
    faults, counts = read_mutations(content, path, read, same, number, statements=statements)
    assert not faults, (len(faults), faults[:3])
    assert min(counts.values()) > number / 20, counts
