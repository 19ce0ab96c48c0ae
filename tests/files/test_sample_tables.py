"""Records in tables: what a head states is read, what it does not state is asked for."""

import os
import re
import subprocess
import sys

import numpy as np
import pytest

import jaxrock as jr

pytestmark = pytest.mark.float64

G = 9.80665
VALUES = np.array([0.0, 0.3, -0.25, 0.1])


@pytest.fixture
def write(tmp_path):
    def write(content, name="a.csv", encoding="utf-8"):
        path = tmp_path / name
        path.write_bytes(content.encode(encoding))
        return path

    return write


def rows(heads, *columns, separator=",", step=0.01):
    """Write a table of samples with a first column of times."""
    lines = [
        separator.join([f"{step * k:.2f}", *map(str, row)])
        for k, row in enumerate(zip(*columns, strict=True))
    ]
    return "\n".join([heads, *lines]) + "\n"


SHEET = rows("Zeit;Kräfte", VALUES, separator=";").replace(
    "Zeit;Kräfte", "Versuch 7: Düse\n;\n\ntime [s];acc (cm/s²);"
)


@pytest.mark.parametrize(
    ("content", "options", "factor"),
    [
        (rows("time [s],acceleration [g]", VALUES), {}, G),
        (rows("# made\nTime (s),A_X [mg]", VALUES), {"time_step": 0.01}, G / 1000),
        (rows("t [ms]\tacc-ns [m/s2]", VALUES, step=10, separator="\t"), {}, 1),
        (re.sub(r"(?m)^(0.*)$", r"\1;", SHEET.replace(".", ",")), {}, 0.01),
        (rows("sep=;\nt [s];north [cm/s/s]", VALUES, separator=";"), {}, 0.01),
        (rows("time [s],acc,note", VALUES, VALUES), {"unit": "gal"}, 0.01),
        (rows("t,acc 270 [%g]", VALUES), {"time_step": 0.01}, G / 100),
        ("acc [g]\n" + "".join(f"{x}\n" for x in VALUES), {"time_step": 0.01}, G),
        (rows("time [s],ax (m/s^2)", VALUES), {"column": "ax (m/s^2)"}, 1),
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "utf-8-sig"])
def test_heads_and_layouts(write, content, options, factor, encoding):
    record = jr.read_record(write(content, encoding=encoding), **options)
    np.testing.assert_allclose(record.acceleration, factor * VALUES, rtol=1e-14)
    assert float(record.time_step) == pytest.approx(0.01, rel=1e-12)


@pytest.mark.parametrize(
    ("heads", "names", "upward"),
    [
        ("acc_x [g],acc_y [g],acc_z [g]", ["acc x", "acc y"], True),
        ("a-1 [g],a-2 [g],a-3 [g]", ["a-1", "a-2"], True),
        ("h1 acc [g],h2 acc [g],v acc [g]", ["h1 acc", "h2 acc"], True),
        ("north [g],east [g],up [g]", ["north", "east"], True),
        ("090 [g],h180 [g],UD [g]", ["090", "h180"], True),
        ("n [g],e [g],down [g]", ["n", "e"], False),
        ("a_x,a_y,g_x [deg/s]", ["a x", "a y"], False),
        ("acc [g],trigger level [g],vel [cm/s]", [], False),
    ],
)
def test_components_of_a_suite(write, heads, names, upward):
    content = rows(f"time [s],{heads}", VALUES, 2 * VALUES, 3 * VALUES)
    suite = jr.read_suite([write(content)], unit="g")
    assert suite.names == (tuple(f"a {name}" for name in names) or ("a",))
    if upward:
        assert heads.split(",")[-1] in suite.source
        suite = jr.read_suite([write(content)], vertical=True)
        np.testing.assert_allclose(suite[0].vertical, 3 * G * VALUES)
    elif "down" in heads:
        with pytest.raises(ValueError, match="points down"):
            jr.read_suite([write(content)], vertical=True)


REFUSED = {
    "acc": "unit",
    "acc [g],a [g]": "column names it: 'acc \\[g\\]', 'a \\[g\\]'",
    "acc [g],acc_x [g]": "column names it",
    "Table acceleration [g],Block acceleration [g]": "column names another one",
    "base acc [g],roof acc [g]": "column names another one",
    "g_x,g_y": "column names another one",
    "5% damped acceleration [g]": "column names another one",
    "spectral acceleration [g]": "column names another one",
    "relative acc [m/s2]": "column names another one",
    "acc [deg]": "column names another one",
    "n": "column names another one",
    "x [mm],y [mm]": "column names another one",
    "x [g],y [g],1 [g]": "column names it",
    "time [s],acc [g]": "one column of times",
    "acc [furlong]": "column names another one",
}


@pytest.mark.parametrize("heads", REFUSED)
def test_what_is_not_stated_is_asked_for(write, heads):
    columns = [VALUES] * (heads.count(",") + 1)
    with pytest.raises(ValueError, match=REFUSED[heads]) as error:
        jr.read_suite([write(rows(f"time [s],{heads}", *columns))])
    assert "a.csv" in str(error.value)


GOOD = rows("time [s],acc [g]", np.round(np.linspace(-1, 1, 40) ** 3, 4))


@pytest.mark.parametrize(
    ("old", "new", "part"),
    [
        ("time [s]", "T [s]", "give time_step"),
        ("time [s]", "time", "time \\[s\\]"),
        ("0.05,", "0.06,", "equal steps"),
        ("0.05,", "\n0.05,", "all lines"),
        ("0.05,", "# 0.05,", "equal steps"),
        ("0.05,", "0.05,,", "2 cells"),
        ("0.05,", "0,05,", "2 cells"),
        ("0.05,", "0.05;", "cells"),
        ("0.05,", "x,", "finite number"),
        ("0.05,", "nan,", "finite number"),
        ("0.05,", "0.0_5,", "finite number"),
        ("acc [g]\n", "acc [g]\n0,0,", ""),
        ("acc", "vel", "column names another one"),
        ("0.05,", '"0.05,', "cells"),
    ],
)
def test_damages(write, old, new, part):
    assert old in GOOD
    with pytest.raises(ValueError, match=f"a.csv'.*{part}"):
        jr.read_record(write(GOOD.replace(old, new, 1)))


def test_a_table_that_is_cut(write):
    lines = GOOD.splitlines(keepends=True)
    for content in ("".join(lines[:-1]) + "0.39", "".join(lines[:9] + lines[10:])):
        with pytest.raises(ValueError, match=r"a.csv'"):
            jr.read_record(write(content))
    # Nothing tells that these are not whole.
    for content, samples in ((GOOD[:-1], 40), (GOOD[:-2], 40), ("".join(lines[:9]), 8)):
        assert jr.read_record(write(content)).samples == samples


@pytest.mark.parametrize("form", [".2f", ".3f", ".17g", ".6e"])
@pytest.mark.parametrize("step", [0.01, 1 / 128, 0.05])
def test_times_printed_with_few_digits(write, form, step):
    times = 37 + step * np.arange(500)
    content = "time [s],a [m/s2]\n" + "".join(
        f"{t:{form}},{(-1) ** k}\n" for k, t in enumerate(times)
    )
    if (form == ".2f" and step < 0.01) or (form == ".6e" and step < 0.005):
        with pytest.raises(ValueError, match="equal steps"):
            jr.read_record(write(content))
        return
    record = jr.read_record(write(content))
    assert float(record.time_step) == pytest.approx(step, rel=1e-3)
    assert float(jr.read_record(write(content), time_step=step).time_step) == pytest.approx(
        step, rel=1e-3
    )


def test_a_column_and_a_vertical_one(write):
    path = write(
        rows("time [s],acc x [g],acc y [g],acc z [g]", VALUES, 2 * VALUES, 3 * VALUES)
    )
    for vertical in ("acc z [g]", "up"):
        record = jr.read_record(path, column="acc y [g]", vertical=vertical)
        np.testing.assert_allclose(record.acceleration, 2 * G * VALUES)
        np.testing.assert_allclose(record.vertical, 3 * G * VALUES)
    for options, part in (
        ({"column": "acc w [g]"}, "acc w"),
        ({"column": "acc x [g]", "vertical": "acc y [g]"}, "points level"),
        ({}, "column must be given"),
        ({"column": "acc x [g]", "unit": "gal"}, "unit is 'gal'"),
        ({"column": "acc x [g]", "time_step": 0.02}, "time_step is 0.02 s"),
        ({"unit": "furlong"}, "unit must be"),
    ):
        with pytest.raises(ValueError, match=part):
            jr.read_record(path, **options)


def test_a_peak_beyond_belief_is_told(write):
    path = write(rows("time [s],acc", 1000 * VALUES))
    with pytest.warns(UserWarning, match="PGA of 2942 m/s2"):
        jr.read_record(path, unit="g")


def test_names_of_files_say_nothing_of_tables(write, tmp_path):
    for name in ("round_up.csv", "x_khz.csv", "vel.csv"):
        write(GOOD, name)
    write("station,vs30 [m/s]\nA,400\n", "index.csv")
    suite = jr.read_suite(tmp_path)
    assert suite.names == ("round_up", "vel", "x_khz")
    assert "left out: 'index.csv'" in suite.source


def test_a_suite_needs_files(tmp_path):
    for source, part in (
        (tmp_path, "no file of a record"),
        ([], "at least one"),
        (tmp_path / "nothing", "cannot be read"),
    ):
        with pytest.raises(ValueError, match=part):
            jr.read_suite(source)
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(ValueError, match="regular file"):
        jr.read_record(tmp_path / "pipe.csv")


def test_example_record():
    north = jr.example_record(vertical=True)
    east = jr.example_record("east")
    assert north.samples == east.samples == 6001
    assert float(north.time_step) == 0.01
    assert east.vertical is None
    peaks = [
        float(abs(x).max()) / G
        for x in (north.acceleration, east.acceleration, north.vertical)
    ]
    assert peaks == pytest.approx([0.510801, 0.344256, 0.347188], rel=1e-12)


@pytest.mark.thorough
def test_reading_needs_nothing_heavy():
    """In a process of its own: the tests import all of these."""
    code = "import sys, jaxrock.ground_motion; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert not {"pandas", "obspy", "xarray"} & set(done.stdout.split())


@pytest.mark.parametrize(
    ("content", "part"),
    [
        (rows("time [s],ch1 [g],ch2 [g]", VALUES, VALUES), "column names another one"),
        (rows("time [s],acc l,acc r", VALUES, VALUES), "column names another one"),
        (rows("time [s],acc -z [g]", VALUES), "column names another one"),
        (rows("time [s],t [ms],acc [g]", 10 * np.arange(4), VALUES), "one column of times"),
        (rows("time [s],acc [g]", VALUES).replace("0.02", "\n0.02"), "all lines"),
    ],
)
def test_what_is_not_clear(write, content, part):
    with pytest.raises(ValueError, match=part):
        jr.read_suite([write(content)], unit="g", time_step=0.01)


@pytest.mark.parametrize(
    "change",
    [
        lambda table: table.replace("time [s],acc [g]", '"time [s]","acc [g]"'),
        lambda table: table.replace("acc [g]\n", "acc [g]\n# a comment\n"),
        lambda table: f"{table},\n,\n\n",
    ],
)
def test_what_spreadsheets_add(write, change):
    record = jr.read_record(write(change(rows("time [s],acc [g]", VALUES))))
    np.testing.assert_allclose(record.acceleration, G * VALUES)
