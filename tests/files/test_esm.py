"""Files of the European Strong-Motion database and ITACA, written here in their layout."""

import re

import numpy as np
import pytest
from tools.refused_files import check_refusal

import jaxrock as jr

pytestmark = pytest.mark.float64

# In cm/s2, with as many digits as the files have; the ground comes to rest, as it should.
PERIOD = [10.25, 66.123456, -0.5, -66.123456, -10.25, 0.5]
HALF = [*PERIOD, *(-x for x in PERIOD)]
# The last one has digits for a cut to take away.
EAST = np.array([0.0, *HALF, *HALF, -0.123456])
UPWARD = np.round(0.6 * EAST, 6)
HEADER = {
    "EVENT_NAME": "CENTRAL ITALY",
    "EVENT_ID": "EMSC-20200101_0000001",
    "EVENT_DATE_YYYYMMDD": "20200101",
    "EVENT_TIME_HHMMSS": "013632",
    "EVENT_LATITUDE_DEGREE": "42.7000",
    "MAGNITUDE_W": "6.0",
    "MAGNITUDE_L": "",
    "NETWORK": "XX",
    "STATION_CODE": "ABC",
    "STATION_NAME": "Düzce: town hall",
    "STATION_ELEVATION_M": "34",
    "LOCATION": "",
    "VS30_M/S": "",
    "DATE_TIME_FIRST_SAMPLE_YYYYMMDD_HHMMSS": "20200101_013619.870",
    "SAMPLING_INTERVAL_S": "0.005000",
    "NDATA": "26",
    "DURATION_S": "0.130",
    "STREAM": "HNE",
    "UNITS": "cm/s^2",
    "INSTRUMENT": "sensor = ETNA [Unknown] | digitizer = ETNA [Unknown]",
    "FULL_SCALE_G": "",
    "PGA_CM/S^2": "-66.123456",
    "TIME_PGA_S": "0.020000",
    "BASELINE_CORRECTION": "BASELINE REMOVED",
    "FILTER_TYPE": "BUTTERWORTH",
    "LATE/NORMAL_TRIGGERED": "NT",
    "DATABASE_VERSION": "DYNA 1.0",
    "HEADER_FORMAT": "DYNA 1.2",
    "DATA_TYPE": "ACCELERATION",
    "PROCESSING": "manual (Paolucci et al., 2011)",
    "DATA_CITATION": "",
    "USER1": "/home/processing.py --le 0.100 --he 30.000 --rf 0.005 --tr NT",
    "USER2": "",
}
NAME = "XX.ABC..HNE.D.20200101.013632.C.ACC.ASC"


def write(values=EAST, **changes):
    """Write a file; changes are by the first word of a key, and None leaves a line out."""
    header = dict(HEADER)
    for name, value in changes.items():
        header[next((key for key in header if key.startswith(name)), name)] = value
    lines = [f"{key}: {value}" for key, value in header.items() if value is not None]
    return ("\n".join([*lines, *(f"{value:.6f}" for value in values)]) + "\n").encode()


def read(path, content, **options):
    path.write_bytes(content)
    return jr.read_record(path, **options)


def test_three_components(tmp_path):
    upward = tmp_path / NAME.replace("HNE", "HNZ")
    upward.write_bytes(write(UPWARD, STREAM="HNZ", PGA=f"{UPWARD.max():.6f}"))
    path = tmp_path / NAME
    record = read(path, write(), unit="gal", time_step=0.005, column="hne", vertical=upward)
    np.testing.assert_allclose(record.acceleration, EAST / 100, rtol=1e-15)
    np.testing.assert_allclose(record.vertical, UPWARD / 100, rtol=1e-15)
    assert record.time_step == 0.005
    with pytest.raises(
        ValueError, match="no component is horizontal; column names a vertical one: 'HNZ'"
    ):
        jr.read_record(upward)
    with pytest.raises(ValueError, match=r"HNE.*one vertical component was expected, got 0"):
        jr.read_record(path, vertical=path)


# Older headers, other units, what may be missing, and a duration from the first to the last.
@pytest.mark.parametrize(
    ("changes", "factor"),
    [
        ({"STREAM": None, "COMPONENT": "NS", "DATA_TYPE": "UNPROCESSED ACCELERATION"}, 0.01),
        ({"UNITS": "m/s^2", "PGA": "6612.3456"}, 1.0),
        ({"PGA": "", "DURATION": "", "DATA_TYPE": None, "EVENT_ID": None}, 0.01),
        ({"DURATION": "0.125", "PGA": "66.12"}, 0.01),
    ],
)
def test_variants(tmp_path, changes, factor):
    record = read(tmp_path / "a.asc", write(**changes))
    np.testing.assert_allclose(record.acceleration, EAST * factor, rtol=1e-15)


def test_what_the_header_lacks_is_stated(tmp_path):
    content = write(UNITS="", SAMPLING="")
    record = read(tmp_path / NAME, content, unit="cm/s2", time_step=0.005)
    np.testing.assert_allclose(record.acceleration, EAST / 100, rtol=1e-15)


REFUSED = [
    (
        {"DATA_TYPE": "VELOCITY"},
        {},
        "line 29: acceleration was expected, DATA_TYPE is 'VELOCITY'",
    ),
    ({"DATA_TYPE": "ACCELERATION RESPONSE SPECTRUM"}, {}, "DATA_TYPE is 'ACCELERATION RESP"),
    ({"UNITS": "cm/s"}, {}, "line 19: the header states cm/s, which is not one of 'm/s2'"),
    ({"UNITS": "counts"}, {}, "line 19: the values are counts of an instrument"),
    ({"UNITS": ""}, {}, "the header states no unit, so that unit must be given"),
    ({}, {"unit": "g"}, "line 19: unit is 'g', but the header states cm/s^2"),
    ({"SAMPLING": ""}, {}, "the header states no time step, so that time_step must be given"),
    (
        {"SAMPLING": "-0.005"},
        {},
        "line 15: a time step from 1e-05 s on was expected, got -0.005 s",
    ),
    ({"SAMPLING": "0.010"}, {}, "line 17: the header states a duration of 0.130 s, but"),
    ({}, {"time_step": 0.01}, "time_step is 0.01 s, but the header states 0.005000 s"),
    ({"NDATA": ""}, {}, "the header does not state the number of values"),
    ({"NDATA": "27"}, {}, "line 16: the header states 27 values, but 26 follow"),
    ({"PGA": "67.1"}, {}, "line 22: the header states a peak of 67.1"),
    ({"PGA": "much"}, {}, "line 22: the peak must be a number, got 'much'"),
    ({" UNITS": "g"}, {}, "line 34: UNITS is 'cm/s^2' in line 19, but 'g'"),
    ({"values": [*EAST[:-1], np.nan]}, {}, "line 59: a value must be finite, got 'nan'"),
    ({}, {"column": "HNN"}, "column is 'HNN', but there are 'HNE'"),
]


def test_the_name_says_what_the_header_does_not(tmp_path):
    path = tmp_path / NAME.replace(".ACC.", ".VEL.")
    assert path.name != NAME
    with pytest.raises(ValueError, match=r"no DATA_TYPE and the name says VEL"):
        read(path, write(DATA_TYPE=None))


@pytest.mark.parametrize(("changes", "options", "message"), REFUSED)
def test_refused(tmp_path, changes, options, message):
    path = tmp_path / NAME
    path.write_bytes(write(**changes))
    check_refusal(path, ".*" + re.escape(message), **options)


def test_a_cut_last_number(tmp_path):
    content = write().rstrip()
    assert read(tmp_path / NAME, content).samples == EAST.size
    for cut in range(1, 6):
        seems = f"line 59: the file looks truncated: its last number '{EAST[-1]}' has"
        with pytest.raises(ValueError, match=seems.replace("123456", "123456"[:-cut])):
            read(tmp_path / NAME, content[:-cut])


def test_what_is_no_acceleration_in_a_folder(tmp_path):
    """Each quantity is a file beside the others; VEL may be a station's code as well."""
    for station in ("ABC", "VEL"):
        for quantity in ("ACC", "VEL", "DIS", "SA", "SD"):
            for processed in (".MP", ""):
                name = f"XX.{station}..HNE.D.INT-2023_08.{quantity}{processed}.ASC"
                kind = "ACCELERATION" if quantity == "ACC" else "VELOCITY"
                (tmp_path / name).write_bytes(write(DATA_TYPE=kind))
    found = [f"XX.{s}..HNE.D.INT-2023_08.ACC" for s in ("ABC", "VEL")]
    assert {*jr.read_suite(tmp_path).names} == {*found, *(f"{name}.MP" for name in found)}


def test_two_values_that_run_together(tmp_path):
    """A sign tells them apart, and their number is that of the header."""
    together = write().replace(b"\n-", b"-", 1)
    assert together.count(b"\n") == write().count(b"\n") - 1
    record = read(tmp_path / NAME, together)
    np.testing.assert_allclose(record.acceleration, EAST / 100, rtol=1e-15)
