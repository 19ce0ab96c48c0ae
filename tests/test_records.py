"""Ground motions from files and traces: what is read, exactly, and what is refused."""

import re
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from jaxrock.records import example_record, from_obspy, read_record

G = 9.80665
TITLE = "PEER STRONG MOTION DATABASE RECORD\nSAN FERNANDO 02/09/71, PACOIMA DAM, UNIT 1, 164\n"
IN_G = "ACCELERATION TIME SERIES IN UNITS OF G\n"
HEADER = TITLE + IN_G


@pytest.fixture
def write(tmp_path):
    def to_file(name, content):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return to_file


@pytest.fixture
def holds(eps):
    """Whether a record has these accelerations [m/s2], to rounding of a product."""

    def compare(record, time_step, horizontal, vertical=None):
        np.testing.assert_allclose(record.time_step, time_step, rtol=eps)
        np.testing.assert_allclose(record.acceleration, horizontal, rtol=2 * eps)
        assert record.acceleration.dtype == record.time_step.dtype
        assert (record.vertical is None) == (vertical is None)
        if vertical is not None:
            np.testing.assert_allclose(record.vertical, vertical, rtol=2 * eps)

    return compare


NINE = 1e-3 * np.array([1, -2, 3, -4, 5, -6, 7, -8, 9])
FIVE_COLUMNS = """\
  .1000000E-02  -.2000000E-02   .3000000E-02  -.4000000E-02   .5000000E-02
 -.6000000E-02   .7000000E-02  -.8000000E-02   .9000000E-02
"""
EIGHT_COLUMNS = """\
  .001000 -.002000  .003000 -.004000  .005000 -.006000  .007000 -.008000
  .009000

"""
GLUED = """\
  .1000000E-02-.2000000E-02 0.3000000D-02-4.0000000E-03+.5000000e-02
-.006000-.007000+.014000
"""
HEADED_NINE = HEADER + "NPTS=     9, DT=   .0100 SEC\n" + FIVE_COLUMNS


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("a.AT2", HEADED_NINE, NINE),
        ("a.at2", HEADER + "NPTS=9,DT=.01SEC, 0 POLE @ 30. HZ\n" + EIGHT_COLUMNS, NINE),
        ("a.At2", HEADER + "   9    0.0100    NPTS, DT\n" + EIGHT_COLUMNS, NINE),
        (
            "filter.AT2",
            TITLE
            + "Acceleration time history in units of g. Filter points: HP=0.1 Hz\n"
            + "PRESS Ctrl-C: VELOCITY OF SHEAR WAVES 300 M/S\n9 0.01 NPTS, DT\n"
            + EIGHT_COLUMNS,
            NINE,
        ),
        (
            "glued.AT2",
            HEADER + "8 .01 NPTS, DT\n" + GLUED,
            [1e-3, -2e-3, 3e-3, -4e-3, 5e-3, -6e-3, -7e-3, 14e-3],
        ),
        ("exponent.AT2", HEADER + "3 .01 NPTS, DT\n.50-101-1.0+001-.250", [0, -10, -0.25]),
        ("dos.AT2", HEADED_NINE.replace("\n", "\r\n").encode() + b"\x1a", NINE),
        ("latin.AT2", "D\u00fczce\n".encode("latin-1") + HEADED_NINE.encode(), NINE),
    ],
)
def test_at2(write, holds, name, content, expected):
    expected = np.asarray(expected) * G
    record = read_record(write(name, content))
    np.testing.assert_allclose(record.acceleration[0], expected[0], atol=1e-37)
    holds(record, 0.01, np.where(expected == 0, record.acceleration, expected))


def test_at2_with_a_vertical_component(write, holds):
    path = write("a.AT2", HEADED_NINE)
    up = write("a-up.AT2", HEADED_NINE.replace("-.2000000", "0.3000000"))
    upward = np.where(NINE == -2e-3, 3e-3, NINE)
    holds(read_record(path, vertical=up), 0.01, NINE * G, upward * G)
    holds(read_record(str(path), vertical=str(up), unit="G"), 0.01, NINE * G, upward * G)


def test_at2_without_a_unit(write, holds):
    path = write("a.AT2", TITLE + "2 0.02 NPTS, DT\n 50. -25.\n")
    holds(read_record(path, unit="cm/s2", time_step=0.02), 0.02, [0.5, -0.25])


@pytest.mark.parametrize(
    ("content", "options", "expected"),
    [
        ("time,a\n0,1\n0.5,-2.5\n1,3e-1\n", {}, ([1, -2.5, 0.3],)),
        ("# one\n#two\n\na\n1\n-2.5\n\n\n", {"time_step": 0.5}, ([1, -2.5],)),
        ("a,T [s],b\n1,3.0,2\n2,3.5,4", {"column": "b"}, ([2, 4],)),
        (
            '"a", "up, z"\n"1", "2"\n3,4\n',
            {"vertical": "up, z", "time_step": 0.5},
            ([1, 3], [2, 4]),
        ),
        (
            "\ufeff# \u00e9\r\nup, a ,Time_S,station\r\n1,2,0.0000,CLC\r\n3,4,0.4996,\r\n5,6,1,nan",
            {"vertical": "up", "column": "a", "time_step": 0.5},
            ([2, 4, 6], [1, 3, 5]),
        ),
        ("time (sec),090,360\n0,1,2\n0.5,3,4\n", {"column": "360"}, ([2, 4],)),
    ],
)
def test_csv(write, holds, content, options, expected):
    holds(read_record(write("a.CSV", content), unit="m/s2", **options), 0.5, *expected)


@pytest.mark.parametrize(
    ("unit", "factor"),
    [
        *((unit, 1) for unit in ("m/s2", "m/s^2", "m/s\u00b2", "m/s**2", "M / sec^2", "m/s/s")),
        *((unit, 0.01) for unit in ("cm/s2", "cm/s^2", "cm/sec/sec", "gal", "Gal")),
        ("mm/s2", 0.001),
        *((unit, G) for unit in ("g", "G")),
    ],
)
def test_units(write, holds, unit, factor):
    values = np.array([3.0, -7.0])
    holds(read_record(write("a.csv", "a\n3\n-7"), unit=unit, time_step=2), 2, values * factor)


CSV = "time,a,b\n0,1,2\n0.5,3,4\n1,5,6\n"
A, B = {"unit": "g", "column": "a"}, {"unit": "g", "time_step": 0.5}
PAIR = HEADER + "2 .01 NPTS, DT\n1 2"


@pytest.mark.parametrize(
    ("name", "content", "options", "message"),
    [
        # The file as a whole
        ("a.txt", "1", {}, ": .AT2 and .csv files are read, not '.txt'"),
        ("a", "1", {}, ": .AT2 and .csv files are read, not ''"),
        ("a.csv", None, {}, ": the file cannot be read: No such file or directory"),
        ("a.AT2", None, {}, ": the file cannot be read: No such file or directory"),
        ("a.AT2", b"\x89PNG\r\n\x1a\n\0", {}, ": a text file was expected, this one is binary"),
        ("a.csv", " \r\n", A, ": the file is empty"),
        ("a.AT2", "", {}, ": the file is empty"),
        ("a.AT2", "<html>\n", {}, ": an .AT2 file was expected, with 'NPTS= ..., DT= ...' or"),
        # The header of an .AT2 file
        ("a.AT2", PAIR.replace(".01", "0."), {}, ", line 4: DT must be greater than 0, got 0."),
        ("a.AT2", PAIR.replace(".01", "-1"), {}, ", line 4: DT must be greater than 0, got -1"),
        ("a.AT2", PAIR.replace(".01", "inf"), {}, ", line 4: DT must be finite, got 'INF'"),
        ("a.AT2", PAIR.replace(".01", "s"), {}, ", line 4: DT must be a number, got 'S'"),
        ("a.AT2", PAIR.replace("2 .", "1 ."), {}, ", line 4: NPTS must be a whole number from 2"),
        ("a.AT2", PAIR.replace("2 .", "2.5 ."), {}, ", line 4: NPTS must be a whole number from"),
        ("a.AT2", PAIR.replace("2 .", "3 ."), {}, ", line 4: NPTS is 3, but 2 values follow"),
        ("a.AT2", PAIR + "\n3", {}, ", line 4: NPTS is 2, but 3 values follow"),
        (
            "a.AT2",
            PAIR.replace(" G", " CM/S/S"),
            {},
            ", line 3: acceleration in units of g was exp",
        ),
        (
            "a.AT2",
            PAIR.replace("ACCELERATION", "VELOCITY"),
            {},
            ", line 3: acceleration was expected, not velocity",
        ),
        (
            "a.AT2",
            PAIR.replace(IN_G, "DISPLACEMENT\n"),
            {"unit": "g"},
            ", line 3: acceleration was expected, not displacement",
        ),
        (
            "a.AT2",
            PAIR.replace(IN_G, "UNCORRECTED ACCELERATION\nVELOCITY TIME HISTORY\n"),
            {"unit": "g"},
            ", line 4: acceleration was expected, not velocity",
        ),
        ("a.AT2", PAIR.replace(IN_G, ""), {}, ": the header states no unit, so that unit must be"),
        ("a.AT2", PAIR, {"unit": "gal"}, ": unit is 'gal', but the header states G"),
        ("a.AT2", PAIR, {"time_step": 0.02}, ": time_step is 0.02 s, but the file has 0.01 s"),
        ("a.AT2", PAIR, {"column": "a"}, "column is for .csv files, {path} has only one"),
        ("a.AT2", PAIR, {"vertical": "b"}, "vertical must be an .AT2 file, as {path} is, got 'b'"),
        ("a.AT2", PAIR, {"vertical": "none.AT2"}, "'none.AT2': the file cannot be read: No such"),
        # The values of an .AT2 file
        ("a.AT2", PAIR + "\n****", {}, ", line 6: a value must be a number, got '****'"),
        ("a.AT2", PAIR + "\n0,5", {}, ", line 6: a value must be a number, got '0,5'"),
        ("a.AT2", PAIR + "\n1_0", {}, ", line 6: a value must be a number, got '1_0'"),
        ("a.AT2", PAIR + "\nNaN", {}, ", line 6: a value must be finite, got 'NaN'"),
        ("a.AT2", PAIR.replace("1 2", "1 9e307"), {}, ": acceleration must be finite, got inf"),
        # The columns of a .csv file
        ("a.csv", "# a\n#b", A, ": a line with the names of the columns was expected, all are com"),
        ("a.csv", "#\n0,1\n1,2", A, ", line 2: names of the columns were expected, got '0,1'"),
        (
            "a.csv",
            CSV,
            B,
            ", line 1: column must be given, the name of the horizontal acceleration",
        ),
        ("a.csv", CSV, B, "acceleration: 'a', 'b'"),
        ("a.csv", "t\n0\n1", B, ", line 1: column must be given, the name of the horizontal accel"),
        ("a.csv", CSV, B | {"column": "c"}, ", line 1: column is 'c', but there are 0 such colu"),
        ("a.csv", CSV, A | {"vertical": "c"}, "vertical is 'c', but there are 0 such columns amon"),
        ("a.csv", "a,a\n1,2", B | {"column": "a"}, ", line 1: column is 'a', but there are 2 such"),
        ("a.csv", CSV, A | {"vertical": "a"}, ", line 1: column and vertical are the same, 'a'"),
        ("a.csv", CSV, A | {"column": "time"}, ", line 1: column is 'time', which is taken for th"),
        ("a.csv", "#\nt,time_s,a\n1,1,1", A, ", line 2: one column of times was expected, got 't'"),
        # The values of a .csv file
        (
            "a.csv",
            CSV + "1.5,7,8,9",
            A,
            ", line 5: 3 fields separated by commas were expected, got 4",
        ),
        (
            "a.csv",
            CSV + "\n1.5,7,8",
            A,
            ", line 5: 3 fields separated by commas were expected, got 1",
        ),
        ("a.csv", CSV + "1.5,,8", A, ", line 5: column 'a' must be a number, got an empty field"),
        ("a.csv", CSV + "1.5,x,8", A, ", line 5: column 'a' must be a number, got 'x'"),
        ("a.csv", CSV + "1.5,inf,8", A, ", line 5: column 'a' must be finite, got 'inf'"),
        ("a.csv", CSV + "nan,7,8", A, ", line 5: column 'time' must be finite, got 'nan'"),
        ("a.csv", "t;a\n0;1\n1;2", B, ", line 2: column 't;a' must be a number, got '0;1'"),
        (
            "a.csv",
            "a\n" + 999 * "x",
            B,
            f", line 2: column 'a' must be a number, got '{57 * 'x'}...'",
        ),
        ("a.csv", "a\n1", B, ": at least two samples were expected, got 1"),
        # Its times
        (
            "a.csv",
            CSV + "1.6,7,8",
            A,
            "line 5: column 'time' must have a uniform step, mostly 0.5 s",
        ),
        (
            "a.csv",
            CSV + "1.502,7,8",
            A,
            "line 5: column 'time' must have a uniform step, mostly 0.5 s",
        ),
        ("a.csv", CSV + "1,7,8", A, ", line 5: column 'time' must increase, got 1.0 and then 1.0"),
        ("a.csv", "t,a\n2,1\n1,2", A, ", line 3: column 't' must increase, got 2.0 and then 1.0"),
        ("a.csv", "a\n1\n2", A, ", line 1: time_step must be given, since no column of times is"),
        ("a.csv", CSV, A | {"time_step": 0.501}, ": time_step is 0.501 s, but the file has 0.5 s"),
        (
            "a.csv",
            CSV,
            A | {"time_step": 0.0},
            "time_step must be finite and greater than 0, got 0",
        ),
        # The unit
        (
            "a.csv",
            CSV,
            {},
            ": unit must be given for a .csv file: one of 'm/s2', 'cm/s2', 'mm/s2',",
        ),
        (
            "a.csv",
            CSV,
            {"unit": "ft/s2"},
            "unit must be one of 'm/s2', 'cm/s2', 'mm/s2', 'gal', 'g'",
        ),
    ],
)
def test_what_is_wrong_is_said(write, tmp_path, monkeypatch, name, content, options, message):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / name if content is None else write(name, content)
    message = message.replace("{path}", repr(str(path)))
    with pytest.raises(ValueError, match=re.escape(message)) as error:
        read_record(path, **options)
    if message.startswith((":", ", line", "line")):
        assert str(error.value).startswith(repr(str(path)))
    assert "\n" not in str(error.value)


def test_a_folder_is_not_read(tmp_path):
    (tmp_path / "a.csv").mkdir()
    with pytest.raises(ValueError, match=r"a\.csv': the file cannot be read"):
        read_record(tmp_path / "a.csv", unit="g")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (PAIR.replace("2 .", "3 .") + " 3", "up.AT2' has 3 samples, but {path} has 2"),
        (PAIR.replace(".01", ".02"), "up.AT2' has a step of 0.02 s, but {path} of 0.01 s"),
        (PAIR + " x", "up.AT2', line 5: a value must be a number, got 'x'"),
    ],
)
def test_a_vertical_file_that_does_not_match(write, content, message):
    path = write("a.AT2", PAIR)
    message = re.escape(message.replace("{path}", repr(str(path))))
    with pytest.raises(ValueError, match=message):
        read_record(path, vertical=write("up.AT2", content))


def trace(data, delta=0.01, **stats):
    """As obspy has it."""
    return SimpleNamespace(data=data, stats=SimpleNamespace(delta=delta, **stats))


def test_obspy(holds):
    big_endian = trace(np.array([1.5, -2], ">f4"), starttime=7)
    counts = trace(np.ma.array([3, 4], np.int32), starttime=7)
    holds(from_obspy(big_endian, unit="cm/s2"), 0.01, [0.015, -0.02])
    holds(
        from_obspy(big_endian, unit="g", vertical=counts), 0.01, [1.5 * G, -2 * G], [3 * G, 4 * G]
    )
    holds(from_obspy(counts, unit="m/s2", vertical=trace(np.ones(2))), 0.01, [3, 4], [1, 1])


PLAIN = trace(np.ones(3), starttime=0)


@pytest.mark.parametrize(
    ("horizontal", "vertical", "message"),
    [
        (
            trace(np.ma.array(np.ones(3), mask=[0, 1, 0])),
            None,
            "trace must have no gaps, got 1 mas",
        ),
        (PLAIN, trace(np.ma.masked_greater(np.ones(3), 0)), "vertical must have no gaps, got 3"),
        (trace(np.array([1, 2, np.nan])), None, "trace must be finite, got nan as sample 2"),
        (
            trace(np.ones((2, 3))),
            None,
            r"trace must be a row of real numbers, got float64 of shape",
        ),
        (trace(np.ones(3) * 1j), None, "trace must be a row of real numbers, got complex128"),
        (trace(np.ones(1)), None, "trace: acceleration must have at least two samples"),
        (trace(np.ones(3), 0.0), None, "stats.delta of trace must be finite and greater than 0"),
        (PLAIN, trace(np.ones(4)), "vertical has 4 samples, but trace has 3"),
        (PLAIN, trace(np.ones(3), 0.02), "vertical has a step of 0.02 s, but trace of 0.01 s"),
        (PLAIN, trace(np.ones(3), starttime=1), "vertical starts at 1, but trace at 0"),
    ],
)
def test_traces_that_are_refused(horizontal, vertical, message):
    with pytest.raises(ValueError, match=message):
        from_obspy(horizontal, unit="m/s2", vertical=vertical)


def test_a_trace_needs_a_unit():
    with pytest.raises(ValueError, match=r"unit must be one of .* got 'counts'"):
        from_obspy(PLAIN, unit="counts")


def test_example_record(eps):
    north, east = example_record(vertical=True), example_record("east")
    assert north.samples == east.samples == 6001
    assert float(north.time_step) == pytest.approx(0.01, rel=eps)
    assert east.vertical is None
    for values, largest in (
        (north.acceleration, 0.510801),
        (east.acceleration, 0.344256),
        (north.vertical, 0.347188),
    ):
        assert float(abs(values).max()) == pytest.approx(largest * G, rel=2 * eps)
    with pytest.raises(ValueError, match="component must be 'north' or 'east', got 'up'"):
        example_record("up")


def test_reading_needs_nothing_heavy():
    """In a process of its own: the tests import all of these."""
    code = "import sys; before = set(sys.modules); import jaxrock.records; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"pandas", "obspy", "xarray"} & set(done.stdout.split())
