"""Ground motions from files and traces: what is read, exactly, and what is refused."""

import os
import re
import subprocess
import sys
import threading
from types import SimpleNamespace

import numpy as np
import pytest

from jaxrock.ground_motion import example_record, from_obspy, read_record, read_suite

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


AT2 = [
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
    ("glued.AT2", HEADER + "8 .01 NPTS, DT\n" + GLUED, [1e-3, -2e-3, 3e-3, -4e-3, 5e-3, -6e-3,
     -7e-3, 14e-3]),
    ("exponent.AT2", HEADER + "3 .01 NPTS, DT\n.50-101-1.0+001-.250", [0, -10, -0.25]),
    ("dos.AT2", HEADED_NINE.replace("\n", "\r\n").encode() + b"\x1a", NINE),
    ("latin.AT2", "D\u00fczce\n".encode("latin-1") + HEADED_NINE.encode(), NINE),
]  # fmt: skip


@pytest.mark.parametrize(("name", "content", "expected"), AT2)
def test_at2(write, holds, name, content, expected):
    expected = np.asarray(expected) * G
    record = read_record(write(name, content))
    np.testing.assert_allclose(record.acceleration[0], expected[0], atol=1e-37)
    holds(record, 0.01, np.where(expected == 0, record.acceleration, expected))


def test_at2_with_a_vertical_component(write, holds):
    path = write("a.AT2", HEADED_NINE)
    content = HEADED_NINE.replace("-.2000000", "0.3000000")
    up = write("a-up.AT2", content.replace("UNIT 1, 164", "UNIT 1, UP"))
    upward = np.where(NINE == -2e-3, 3e-3, NINE)
    holds(read_record(path, vertical=up), 0.01, NINE * G, upward * G)
    holds(read_record(str(path), vertical=str(up), unit="G"), 0.01, NINE * G, upward * G)


def test_at2_without_a_unit(write, holds):
    path = write("a.AT2", TITLE + "2 0.02 NPTS, DT\n 50. -25.\n")
    holds(read_record(path, unit="cm/s2", time_step=0.02), 0.02, [0.5, -0.25])


TABLES = [
    ("time,a\n0,1\n0.5,-2.5\n1,3e-1\n", {}, ([1, -2.5, 0.3],)),
    ("# one\n#two\n\na\n1\n-2.5\n\n\n", {"time_step": 0.5}, ([1, -2.5],)),
    ("a,T [s],b\n1,3.0,2\n2,3.5,4", {"column": "b"}, ([2, 4],)),
    ('"a", "up, z"\n"1", "2"\n3,4\n', {"vertical": "up, z", "time_step": 0.5}, ([1, 3], [2, 4])),
    ("\ufeff# \u00e9\r\nup, a ,Time_S,station\r\n1,2,0.0000,CLC\r\n3,4,0.4996,\r\n5,6,1,nan",
     {"vertical": "up", "column": "a", "time_step": 0.5}, ([2, 4, 6], [1, 3, 5])),
    ("time (sec),090,360\n0,1,2\n0.5,3,4\n", {"column": "360"}, ([2, 4],)),
]  # fmt: skip


@pytest.mark.parametrize(("content", "options", "expected"), TABLES)
def test_csv(write, holds, content, options, expected):
    holds(read_record(write("a.CSV", content), unit="m/s2", **options), 0.5, *expected)


@pytest.mark.parametrize(
    ("unit", "factor"),
    [
        *(
            (unit, 1)
            for unit in ("m/s2", "m/s^2", "m/s\u00b2", "m/s**2", "M / sec^2", "m/s/s")
        ),
        *((unit, 0.01) for unit in ("cm/s2", "cm/s^2", "cm/sec/sec", "gal", "Gal")),
        ("mm/s2", 0.001),
        *((unit, G) for unit in ("g", "G")),
    ],
)
def test_units(write, holds, unit, factor):
    values = np.array([3.0, -7.0])
    holds(read_record(write("a.csv", "a\n3\n-7"), unit=unit, time_step=2), 2, values * factor)


CSV = "time,a,b\n0,1,2\n0.5,3,4\n1,5,6\n"
A = {"unit": "g", "column": "a"}
B = {"unit": "g", "time_step": 0.5}
G_UNIT = {"unit": "g"}
PAIR = HEADER + "2 .01 NPTS, DT\n1 2"


WHAT_IS_WRONG_IS_SAID = [
    # The file as a whole
    ("a.txt", "x", {}, ": a file in one of these formats was expected: .AT2, .csv"),
    ("a", "x", {}, ": a file in one of these formats was expected: .AT2, .csv"),
    ("a.csv", None, {}, ": the file cannot be read: No such file or directory"),
    ("a.AT2", None, {}, ": the file cannot be read: No such file or directory"),
    ("a.AT2", b"\x89PNG\r\n\x1a\n\0", {}, ": a text file was expected, this one is binary"),
    ("a.csv", " \r\n", A, ": the file is empty"),
    ("a.AT2", "", {}, ": the file is empty"),
    ("a.AT2", "<html>\n", {}, ": an .AT2 file was expected, with 'NPTS= ..., DT= ...' or"),
    # The header of an .AT2 file
    ("a.AT2", PAIR.replace(".01", "0."), {}, ", line 4: DT must be a time above 0, got '0.'"),
    ("a.AT2", PAIR.replace(".01", "-1"), {}, ", line 4: DT must be a time above 0, got '-1'"),
    ("a.AT2", PAIR.replace(".01", "inf"), {}, ", line 4: DT must be a time above 0, got 'INF'"),
    ("a.AT2", PAIR.replace(".01", "s"), {}, ", line 4: DT must be a time above 0, got 'S'"),
    ("a.AT2", PAIR.replace("2 .", "1 ."), {}, ", line 4: the header states 1 values, where"),
    ("a.AT2", PAIR.replace("2 .", "2.5 ."), {}, ", line 4: the header states 2.5 values, where"),
    ("a.AT2", PAIR.replace("2 .", "3 ."), {}, ", line 4: the header states 3 values, but 2"),
    ("a.AT2", PAIR + "\n3", {}, ", line 4: the header states 2 values, but 3 follow"),
    ("a.AT2", PAIR.replace(" G", " CM/S/S"), {"unit": "g"},
     ", line 3: unit is 'g', but the header states CM/S/S"),
    ("a.AT2", PAIR.replace("ACCELERATION", "VELOCITY"), {},
     ", line 3: acceleration was expected, not velocity"),
    ("a.AT2", PAIR.replace(IN_G, "DISPLACEMENT\n"), {"unit": "g"},
     ", line 3: acceleration was expected, not displacement"),
    ("a.AT2", PAIR.replace(IN_G, "UNCORRECTED ACCELERATION\nVELOCITY TIME HISTORY\n"),
     {"unit": "g"}, ", line 4: acceleration was expected, not velocity"),
    ("a.AT2", PAIR.replace(IN_G, ""), {}, ": the header states no unit, so that unit must be"),
    ("a.AT2", PAIR, {"unit": "gal"}, ": unit is 'gal', but the header states G"),
    ("a.AT2", PAIR, {"time_step": 0.02},
     ", line 4: time_step is 0.02 s, but the header states DT= 0.01 s"),
    ("a.AT2", PAIR, {"column": "a"}, "column is for .csv files, {path} has only one"),
    ("a.AT2", PAIR, {"vertical": "b"},
     "vertical must be a component of the file, or another file, got 'b' for {path}"),
    ("a.AT2", PAIR, {"vertical": "none.AT2"}, "'none.AT2': the file cannot be read: No such"),
    # The values of an .AT2 file
    ("a.AT2", PAIR + "\n****", {}, ", line 6: a value must be a number, got '****'"),
    ("a.AT2", PAIR + "\n0,5", {}, ", line 6: a value must be a number, got '0,5'"),
    ("a.AT2", PAIR + "\n1_0", {}, ", line 6: a value must be a number, got '1_0'"),
    ("a.AT2", PAIR + "\nNaN", {}, ", line 6: a value must be finite, got 'NaN'"),
    ("a.AT2", PAIR.replace("1 2", "1 9e307"), {}, ": acceleration must be finite, got inf"),
    # The columns of a .csv file
    ("a.csv", "# a\n#b", A,
     ": a line with the names of the columns was expected, all lines are com"),
    ("a.csv", "#\n0,1\n1,2", A, ", line 2: names of the columns were expected, got '0,1'"),
    ("a.csv", CSV, B, ", line 1: column must be given, the horizontal component"),
    ("a.csv", CSV, B, "component: 'a', 'b'"),
    ("a.csv", "t\n0\n1", B, ", line 1: column must be given, the horizontal component"),
    ("a.csv", CSV, B | {"column": "c"}, ", line 1: column is 'c', but there are 0 such colu"),
    ("a.csv", CSV, A | {"vertical": "c"}, "vertical is 'c', but there are 0 such columns amon"),
    ("a.csv", "a,a\n1,2", B | {"column": "a"}, ", line 1: column is 'a', but there are 2 such"),
    ("a.csv", CSV, A | {"vertical": "a"}, ", line 1: column and vertical are the same, 'a'"),
    ("a.csv", CSV, A | {"column": "time"}, ", line 1: column is 'time', which is taken for th"),
    ("a.csv", "#\nt,time_s,a\n1,1,1", A, ", line 2: one column of times was expected, got 't'"),
    # The values of a .csv file
    ("a.csv", CSV + "1.5,7,8,9", A, ", line 5: 3 fields separated by commas were expected, got 4"),
    ("a.csv", CSV + "\n1.5,7,8", A, ", line 5: 3 fields separated by commas were expected, got 1"),
    ("a.csv", CSV + "1.5,,8", A, ", line 5: column 'a' must be a number, got an empty field"),
    ("a.csv", CSV + "1.5,x,8", A, ", line 5: column 'a' must be a number, got 'x'"),
    ("a.csv", CSV + "1.5,inf,8", A, ", line 5: column 'a' must be finite, got 'inf'"),
    ("a.csv", CSV + "nan,7,8", A, ", line 5: column 'time' must be finite, got 'nan'"),
    ("a.csv", "a\n" + 999 * "x", B, f", line 2: column 'a' must be a number, got '{57 * 'x'}...'"),
    ("a.csv", "a\n1", B, ": at least two samples were expected, got 1"),
    # Its times
    ("a.csv", CSV + "1.6,7,8", A, "line 5: column 'time' must have a uniform step, mostly 0.5 s"),
    ("a.csv", CSV + "1.502,7,8", A, "line 5: column 'time' must have a uniform step, mostly 0.5 s"),
    ("a.csv", CSV + "1,7,8", A, ", line 5: column 'time' must increase, got 1.0 and then 1.0"),
    ("a.csv", "t,a\n2,1\n1,2", A, ", line 3: column 't' must increase, got 2.0 and then 1.0"),
    ("a.csv", "a\n1\n2", A, ", line 1: no column of times is among 'a', so that time_step must be"),
    ("a.csv", CSV, A | {"time_step": 0.501},
     ": time_step is 0.501 s, but column 'time' has a step of 0.5 s"),
    ("a.csv", CSV, A | {"time_step": 0.0}, "time_step must be finite and greater than 0, got 0"),
    # The unit
    ("a.csv", CSV, {"column": "a"}, "the file states no unit of this column, so that unit mus"),
    ("a.csv", CSV, {"unit": "rad/s2"},
     "unit must be one of 'm/s2', 'cm/s2', 'mm/s2', 'nm/s2', 'gal', 'g'"),
    # As they arrive
    ("a.csv", "t;a\n0;1\n", G_UNIT, ": at least two samples were expected, got 1"),
    ("a.csv", "t;a\n0,1;1.2\n", G_UNIT,
     ", line 2: decimals must all stand behind points or all behind commas, got '0,1'"),
    ("a.csv", "0,1\n1,2\n", G_UNIT, ", line 1: names of the columns were expected"),
    ("a.csv", "0.1\n0.2\n", G_UNIT,
     "no column of times is among 'column 1', so that time_step must be given"),
    ("a.txt", "0.1\n0.2\n", G_UNIT,
     ": the file holds nothing but numbers, so that time_step must be given"),
    ("a.csv", "# dt = 0.1 s\n0.1\nmuch\n", G_UNIT,
     ", line 3: column 'column 1' must be a number"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "content", "options", "message"), WHAT_IS_WRONG_IS_SAID)
def test_what_is_wrong_is_said(write, tmp_path, monkeypatch, name, content, options, message):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / name if content is None else write(name, content)
    message = message.replace("{path}", repr(str(path)))
    with pytest.raises(ValueError, match=re.escape(message)) as error:
        read_record(path, **options)
    if message.startswith((":", ", line", "line")):
        assert str(error.value).startswith(repr(str(path)))
    assert "\n" not in str(error.value)


OF_UNIT = {
    "m/s2": 1,
    "cm/s2": 0.01,
    "mm/s2": 1e-3,
    "gal": 0.01,
    "g": G,
    "%g": G / 100,
    "mg": G / 1e3,
}
SAID = {  # the unit, and how headers, comments and names of columns say it
    "m/s2": (
        ["UNITS: M/S^2", "ACCELERATION (M/SEC**2)", "acc. in m s^-2", "Accel [m/s\u00b2]"],
        ["acc_m_s2", "acc (m/s\u00b2)", "a_ms-2", "acc_mps2", "acc [m/s/s]"],
    ),
    "cm/s2": (
        ["ACCELERATION (CM/S2)", "TIME SERIES IN UNITS OF CM/SEC/SEC", "CM/S/S", "acc [gal]"],
        ["acc_cm_s2", "acc_cm_s_2", "a (cm/sec^2)", "acc_gal", "ns / (cm/s2)", "acc_cmss"],
    ),
    "mm/s2": (["UNITS=MM/S2", "acceleration in mm/s/s, filtered"], ["x [mm/s2]", "top_mm_s2"]),
    "g": (
        [
            IN_G.strip(),
            "ACCELERATION IN G",
            "Acceleration, g",
            "ACC (G)",
            "units are g's",
            "(g)",
        ],
        ["acc_g", "north [g]", "090_g", "G", "acc_g_north", "top (g)"],
    ),
    "%g": (["UNITS OF %G", "ACCELERATION (% G)"], ["acc_%g", "a [percent of g]", "acc_pct_g"]),
    "mg": (["ACCELERATION IN MG"], ["acc_mg", "acc [milli-g]"]),
}


@pytest.mark.parametrize("unit", SAID)
def test_a_unit_that_is_stated_is_used_and_not_contradicted(write, holds, unit):
    lines, names = SAID[unit]
    contents = [("a.AT2", f"PEER\n{line}\nNPTS= 2, DT= .5\n3 -7") for line in lines]
    contents += [("a.csv", f"# {line}\nt,a\n0,3\n.5,-7") for line in lines]
    contents += [("a.csv", f"t,{name}\n0,3\n.5,-7") for name in names]
    for name, content in contents:
        path = write(name, content)
        for given in (None, *OF_UNIT):
            if given is None or OF_UNIT[given] == OF_UNIT[unit]:
                holds(
                    read_record(path, unit=given), 0.5, [3 * OF_UNIT[unit], -7 * OF_UNIT[unit]]
                )
                continue
            with pytest.raises(
                ValueError, match=r"line [123]: unit is .*, but .* states"
            ) as error:
                read_record(path, unit=given)
            assert repr(given) in str(error.value)


@pytest.mark.parametrize(
    "line",
    [
        "SAN FERNANDO, PACOIMA DAM, UNIT 1, 164",
        "ACCELERATION; VELOCITY OF SHEAR WAVES 300 M/S",
        "Uncorrected: divided by the sensitivity (213180 counts per m/s2)",
        "PEAK ACCELERATION = -34.2 CM/S2 AT 3.2 S, PGA (MG): 35",
        "start-up spike of 0.086 g; a weaker burst below 0.09 g left out",
        "UNCORRECTED ACCELEROGRAM, G. SMITH, ACCELERATION IN THE NORTH DIRECTION",
        "UNITS OF TIME: SEC, times rounded to 0.001 s, interpolated onto 0.004 s",
        "Cut: 45.00 s cut from 65.00 s, 4 Hz low-pass, samples 200 to 400",
    ],
)
def test_what_says_nothing_of_unit_and_step(write, holds, line):
    holds(
        read_record(write("a.AT2", f"{line}\n2 .5 NPTS, DT\n3 -7"), unit="m/s2"), 0.5, [3, -7]
    )
    holds(read_record(write("a.csv", f"# {line}\nt,a\n0,3\n.5,-7"), unit="m/s2"), 0.5, [3, -7])


STEPS = {  # of 0.01 s, in headers of .AT2 files; in comments; as names of columns of times
    "header": [
        "NPTS= 2, DT= 10 MSEC",
        "NPTS= 2, DT=10MS",
        "NPTS= 2, DT= 1.-02 SEC",
        "NPTS= 2, DT= 1.0D-2 (SEC), 0 POLE",
        "NPTS=2,DT=.01",
        "DT= .01 SEC, NPTS= 2",
        "2 10 NPTS, DT (MSEC)",
        "2 10MSEC NPTS, DT",
        "2 .01 NPTS, DT SEC",
    ],
    "comment": [
        "time step 0.01 s",
        "dt_ms = 10",
        "dt [ms]: 10",
        "DT= .01 NPTS= 2",
        "100 samples per second",
        "sampling rate: 100 Hz",
        "Sampling frequency (Hz): 100",
        "sampling interval of 10 msec.",
        "DELTA= 1.0E-02",
    ],
    "times": [
        "t|0|.01",
        "time_ms|0|10",
        "Time [msec]|5|15",
        "time(\u00b5s)|0|1e4",
        "t/s|1|1.01",
    ],
}


SAYS = {
    "header": "the header states ",
    "comment": "a comment states ",
    "times": ".* a step of 0.01 ",
}


@pytest.mark.parametrize("kind", STEPS)
def test_a_time_step_that_is_stated_is_used_and_not_contradicted(write, holds, kind):
    for text in STEPS[kind]:
        if kind == "header":
            path = write("a.AT2", f"UNITS OF G\n{text}\n3 -7")
        elif kind == "comment":
            path = write("a.csv", f"# {text}\na_g2,acc_g\n1,3\n2,-7")
        else:
            name, first, second = text.split("|")
            path = write("a.csv", f"{name},acc_g\n{first},3\n{second},-7")
        column = None if kind == "header" else "acc_g"
        for given in (None, 0.01):
            record = read_record(path, column=column, time_step=given)
            assert float(record.time_step) == pytest.approx(0.01, rel=1e-6)
        for given in (10.0, 0.1, 0.02):
            with pytest.raises(ValueError, match=f"time_step is {given} s, but {SAYS[kind]}"):
                read_record(path, column=column, time_step=given)


WHAT_A_FILE_SAYS_AND_IS_NOT_UNDERSTOOD_OR_CONTRADICTS_ITSELF = [
    ("a.AT2", "UNITS: COUNTS\n2 .01 NPTS, DT\n1 2", "line 1: .* states COUNTS, which is not"),
    ("a.AT2", "ACC (FT/S)\n2 .01 NPTS, DT\n1 2", "line 1: .* states FT/S, which is not"),
    ("a.AT2", "ACC (G)\nUNITS: GAL\n2 1 NPTS, DT\n1 2",
     "2: the header states G in line 1, but .* GAL"),
    ("a.AT2", "(G)\nNPTS= 2, DT= 10 FOO\n1 2", "line 2: DT must be .*, got '10 FOO'"),
    ("a.AT2", "(G)\nNPTS= 2, DT= 200 HZ\n1 2", "line 2: DT must be .*, got '200 HZ'"),
    ("a.AT2", "(G)\nNPTS= 2, DT= 1,5 MSEC\n1 2", "line 2: DT must be .*, got '1,5 MSEC'"),
    ("a.AT2", "(G)\nDT= 10 MS\n2 .1 NPTS, DT\n1 2",
     "2: the header states DT= 0.1 s in line 3, but .* DT= 10 MS"),
    ("a.csv", "t,acc [counts]\n0,1\n1,2", "line 1: column .* states counts, which is not"),
    ("a.csv", "t,acc [cm/s]\n0,1\n1,2", "line 1: column .* states cm/s, which is not"),
    ("a.csv", "t,x_g,a_g2 [g]\n0,1,1\n1,2,2", "column must be given"),
    ("a.csv", "# in G\nt,velocity\n0,1\n1,2", "acceleration was expected, got columns 'velocity'"),
    ("a.csv", "# (gal)\nt,acc_g\n0,1\n1,2",
     "line 1: column .* states g in line 2, but a comment .* gal"),
    ("a.csv", "time [ticks],acc_g\n0,1\n1,2", "the unit of the times is not understood"),
    ("a.csv", "# time step 0,01 s\nacc_g\n1\n2", "line 1: .* time step 0, which is not"),
    ("a.csv", "# sampling rate 0.01\nacc_g\n1\n2", "line 1: .* rate 0.01, which is not"),
    ("a.csv", "# dt = 2 s\nt,acc_g\n0,1\n1,2",
     "line 2: a comment states dt = 2 s in line 1, but column 't' has a step of 1 s"),
    ("a.csv", "t,a_g\n0,1\n1,2", "unit must be given"),  # ground acceleration as well
]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "content", "message"),
    WHAT_A_FILE_SAYS_AND_IS_NOT_UNDERSTOOD_OR_CONTRADICTS_ITSELF,
)
def test_what_a_file_says_and_is_not_understood_or_contradicts_itself(
    write, name, content, message
):
    with pytest.raises(ValueError, match=message):
        read_record(write(name, content))


@pytest.mark.parametrize(
    ("word", "numbers"),
    [
        (".1-02", [1e-3]),
        ("-.1-02-.2+02", [-1e-3, -20]),
        (".5-12.5", [0.5, -12.5]),
        ("-1.0-1.0-12.50", [-1, -1, -12.5]),
        (".1E-02-.2d-02", [1e-3, -2e-3]),
        (".1-02.3-02", None),  # two numbers either way
        (".1-02.3", None),
        (".5-101-12.5", None),
        (".1-2", None),
        ("1-02", None),
        (".1E-024.5", None),
    ],
)
def test_numbers_that_run_together(write, holds, word, numbers):
    content = "UNITS: M/S2\n{} .5 NPTS, DT\n7.0 " + word
    if numbers is not None:
        path = write("a.AT2", content.format(1 + len(numbers)))
        holds(read_record(path), 0.5, [7, *numbers])
        return
    for points in (2, 3):  # whether or not it fits
        with pytest.raises(ValueError, match="line 3: .* got '" + re.escape(word)):
            read_record(write("a.AT2", content.format(points)))


@pytest.mark.filterwarnings("ignore:.*the ground still moves")
def test_unusual_files_are_read_line_by_line_with_progress(write, holds, monkeypatch):
    values = np.arange(1, 200) / 8
    at2 = "\r\n".join(f"{a:.3f}-{a:.3f}" if a % 1 else f"{a} -{a:.6e}" for a in values)
    at2 = write("a.AT2", f"UNITS: M/S2\r\n398 .5 NPTS, DT\r\n{at2}\r\n\r\n")
    rows = [f"{i / 2},{a},{2 * a}" for i, a in enumerate(values)]
    quotes = [f'{i / 2},"{a}",{2 * a}' for i, a in enumerate(values)]
    tables = [
        write("a.csv", "\n".join(["t,a,b", *rows])),
        write("b.csv", "\n".join(["t,a,b", *rows[:9], *quotes[9:20], *rows[20:]])),
    ]
    broken = write("c.csv", "\n".join(["t,a,b", *rows, "199,x,2"]))
    shown = []
    for module in ("text", "table"):
        monkeypatch.setattr(
            f"jaxrock.tables.{module}.show_progress",
            lambda items, label: shown.append((len(items), label)) or items,
        )
    drifts = "the ground still moves at "
    with pytest.warns(UserWarning, match=drifts):
        read = read_record(at2)
    holds(read, 0.5, np.stack([values, -values], 1).ravel())
    for table in tables:
        with pytest.warns(UserWarning, match=drifts):
            read = read_record(table, unit="m/s2", column="a", vertical="b")
        holds(read, 0.5, values, 2 * values)
    with pytest.raises(ValueError, match=r"c\.csv', line 201: column 'a' must be a number"):
        read_record(broken, unit="g", column="a")
    assert shown == [
        (199, "reading a.AT2"),
        (199, "reading b.csv"),
        (200, "reading c.csv"),
    ]


def test_only_regular_files_are_read(tmp_path):
    """A pipe or a device may never end, and a pipe can be read only once."""
    pipe = tmp_path / "pipe.csv"
    device = tmp_path / "device.csv"
    os.mkfifo(pipe)
    device.symlink_to(os.devnull)
    writer = threading.Thread(target=pipe.write_text, args=("acc_g\n1\n2\n",), daemon=True)
    writer.start()
    for path in (pipe, device):
        with pytest.raises(
            ValueError, match="a regular file was expected, not a pipe or a dev"
        ):
            read_record(path, time_step=1)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)  # lets the writer go
    writer.join(10)
    os.close(reader)


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
    content = content.replace("UNIT 1, 164", "UNIT 1, UP")
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
        from_obspy(big_endian, unit="g", vertical=counts),
        0.01,
        [1.5 * G, -2 * G],
        [3 * G, 4 * G],
    )
    of_gmprocess = trace(np.array([3, 4]), standard={"units": "cm/s^2"})
    holds(from_obspy(of_gmprocess, unit="gal"), 0.01, [0.03, 0.04])
    holds(from_obspy(counts, unit="m/s2", vertical=trace(np.ones(2))), 0.01, [3, 4], [1, 1])


@pytest.mark.parametrize(("calibrated", "factor"), [(False, 2.4e-6), (True, 1.0)])
def test_a_calibration_factor_that_obspy_leaves_in_place(holds, calibrated, factor):
    """Whether it has been applied nobody can tell from the trace."""
    counts = trace(np.array([35310, -2e4]), calib=2.4e-6)
    found = from_obspy(counts, unit="m/s2", calibrated=calibrated)
    holds(found, 0.01, [35310 * factor, -2e4 * factor])
    holds(from_obspy(trace(np.ones(2), calib=1.0), unit="m/s2"), 0.01, [1, 1])


def test_example_record(eps):
    north = example_record(vertical=True)
    east = example_record("east")
    assert north.samples == east.samples == 6001
    assert float(north.time_step) == pytest.approx(0.01, rel=eps)
    assert east.vertical is None
    for values, largest in (
        (north.acceleration, 0.510801),
        (east.acceleration, 0.344256),
        (north.vertical, 0.347188),
    ):
        assert float(abs(values).max()) == pytest.approx(largest * G, rel=2 * eps)


@pytest.mark.thorough
def test_reading_needs_nothing_heavy():
    """In a process of its own: the tests import all of these."""
    code = "import sys, jaxrock.ground_motion; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert not {"pandas", "obspy", "xarray"} & set(done.stdout.split())


def test_one_column_needs_no_name(tmp_path):
    path = tmp_path / "r.csv"
    path.write_text("# recorded somewhere\n0.5\n-1\n2\n")
    record = read_record(path, unit="m/s2", time_step=0.01)
    assert record.acceleration.tolist() == [0.5, -1, 2]
    assert read_suite([path], unit="m/s2", time_step=0.01)[0].samples == 3
    path.write_text("# dt = 0.02 s, in m/s2\n0.5\n-1\n")
    assert read_record(path).time_step == 0.02
