"""Records in tables: what a head states is read, what it does not state is asked for."""

import re

import numpy as np
import pytest

import jaxrock as jr

pytestmark = pytest.mark.float64

G = 9.80665
VALUES = np.array([0.0, 0.3, -0.25, 0.1])


def rows(heads, *columns, separator=",", step=0.01):
    """Write a table of samples with a first column of times."""
    lines = [
        separator.join([f"{step * k:.2f}", *map(str, row)])
        for k, row in enumerate(zip(*columns, strict=True))
    ]
    return "\n".join([heads, *lines]) + "\n"


# As a spreadsheet saves it: a title, empty rows, decimal commas, a column without a head.
SHEET = rows("Versuch 7: Düse\n;\n\ntime [s];acc (cm/s²);", VALUES, separator=";")
PLAIN = rows("time [s],acc [g]", VALUES)
TABLES = [
    (rows("time [s],acceleration [g]", VALUES), {}, G),
    (rows("# made\nTime (s),A_X [mg]", VALUES), {"time_step": 0.01}, G / 1000),
    (rows("t [ms]\tacc-ns [m/s2]", VALUES, step=10, separator="\t"), {}, 1),
    (re.sub(r"(?m)^(0.*)$", r"\1;", SHEET.replace(".", ",")), {}, 0.01),
    (rows("time [s],acc,note", VALUES, VALUES), {"unit": "gal"}, 0.01),
    (rows("t,acc 270 [%g]", VALUES), {"time_step": 0.01}, G / 100),
    ("acc [g]\n" + "".join(f"{x}\n" for x in VALUES), {"time_step": 0.01}, G),
    (PLAIN.replace("acc [g]\n", "acc [g]\n# a comment\n") + ",\n,\n\n", {}, G),
]


@pytest.mark.parametrize(("content", "options", "factor"), TABLES)
def test_heads_and_layouts(write, content, options, factor):
    record = jr.read_record(write(content), **options)
    np.testing.assert_allclose(record.acceleration, factor * VALUES, rtol=1e-14)
    assert float(record.time_step) == pytest.approx(0.01, rel=1e-12)


COMPONENTS = [
    ("acc_x [g],acc_y [g],acc_z [g]", ["acc x", "acc y"], "up"),
    ("a-1 [g],a-2 [g],a-3 [g]", ["a-1", "a-2"], "up"),
    ("north [g],east [g],up [g]", ["north", "east"], "up"),
    ("090 [g],h180 [g],UD [g]", ["090", "h180"], "up"),
    ("n [g],e [g],down [g]", ["n", "e"], "down"),
    ("a_x,a_y,g_x [deg/s]", ["a x", "a y"], ""),
    ("acc [g],trigger level [g],vel [cm/s]", [], ""),
]


@pytest.mark.parametrize(("heads", "names", "third"), COMPONENTS)
def test_components_of_a_suite(write, heads, names, third):
    path = write(rows(f"time [s],{heads}", VALUES, 2 * VALUES, 3 * VALUES))
    suite = jr.read_suite([path], unit="g")
    assert suite.names == (tuple(f"a {name}" for name in names) or ("a",))
    if third == "up":
        suite = jr.read_suite([path], vertical=True)
        np.testing.assert_allclose(suite[0].vertical, 3 * G * VALUES)
    elif third == "down":
        with pytest.raises(ValueError, match="points down"):
            jr.read_suite([path], vertical=True)


# Heads beside that of times; and what the error says.
OTHERS = """g_x,g_y; 5% damped acceleration [g]; Table acceleration [g],Block acceleration [g]; n;
acc [deg]; acc [furlong]; ch1 [g],ch2 [g]; acc -z [g]"""
UNCLEAR = dict.fromkeys(re.split(r";\s", OTHERS), "column names another one")
UNCLEAR |= {
    "acc": "unit",
    "acc [g],a [g]": r"column names it: 'acc \[g\]', 'a \[g\]'",
    "t [ms],acc [g]": "one column of times",
}


@pytest.mark.parametrize("heads", UNCLEAR)
def test_what_is_not_stated_is_asked_for(write, heads):
    columns = [VALUES] * (heads.count(",") + 1)
    with pytest.raises(ValueError, match=UNCLEAR[heads]) as error:
        jr.read_suite([write(rows(f"time [s],{heads}", *columns))])
    assert "a.csv" in str(error.value)


GOOD = rows("time [s],acc [g]", np.round(np.linspace(-1, 1, 40) ** 3, 4))
DAMAGES = [
    ("time [s]", "T [s]", "give time_step"),
    ("0.05,", "0.06,", "equal steps"),
    ("0.05,", "\n0.05,", "all lines"),
    ("0.05,", '"0.05,', "cells"),
    ("0.05,", "nan,", "finite number"),
    ("0.05,", "0.0_5,", "finite number"),
    ("0.05,", "0.39\n0.05,", "2 cells"),
]


@pytest.mark.parametrize(("old", "new", "part"), DAMAGES)
def test_damages(write, old, new, part):
    with pytest.raises(ValueError, match=f"a.csv'.*{part}"):
        jr.read_record(write(GOOD.replace(old, new, 1)))


@pytest.mark.parametrize(("form", "step"), [(".2f", 0.01), (".2f", 1 / 128), (".6e", 1 / 128)])
def test_times_printed_with_few_digits(write, form, step):
    times = 37 + step * np.arange(500)
    lines = [f"{t:{form}},{(-1) ** k}\n" for k, t in enumerate(times)]
    path = write("".join(["time [s],a [m/s2]\n", *lines]))
    if form == ".2f" and step < 0.01:
        with pytest.raises(ValueError, match="equal steps"):
            jr.read_record(path)
        return
    for given in (None, step):
        record = jr.read_record(path, time_step=given)
        assert float(record.time_step) == pytest.approx(step, rel=1e-3)


def test_a_column_and_a_vertical_one(write):
    heads = "time [s],acc x [g],acc y [g],acc z [g]"
    path = write(rows(heads, VALUES, 2 * VALUES, 3 * VALUES))
    for vertical in ("acc z [g]", "up"):
        record = jr.read_record(path, column="acc y [g]", vertical=vertical)
        np.testing.assert_allclose(record.acceleration, 2 * G * VALUES)
        np.testing.assert_allclose(record.vertical, 3 * G * VALUES)
    for options, part in (
        ({"column": "acc w [g]"}, "acc w"),
        ({"column": "acc x [g]", "vertical": "acc y [g]"}, "points level"),
        ({"column": "acc x [g]", "unit": "gal"}, "unit is 'gal'"),
        ({"column": "acc x [g]", "time_step": 0.02}, "time_step is 0.02 s"),
    ):
        with pytest.raises(ValueError, match=part):
            jr.read_record(path, **options)


def test_names_of_files_say_nothing_of_tables(write, tmp_path):
    for name in ("round_up.csv", "x_khz.csv", "vel.csv"):
        write(GOOD, name)
    write("station,vs30 [m/s]\nA,400\n", "index.csv")
    suite = jr.read_suite(tmp_path)
    assert suite.names == ("round_up", "vel", "x_khz")
    assert "left out: 'index.csv'" in suite.source


def test_example_record():
    north, east = jr.example_record(vertical=True), jr.example_record("east")
    assert north.samples == east.samples == 6001
    assert float(north.time_step) == 0.01
    assert east.vertical is None
    rows = (north.acceleration, east.acceleration, north.vertical)
    peaks = [float(abs(row).max()) / G for row in rows]
    assert peaks == pytest.approx([0.510801, 0.344256, 0.347188], rel=1e-12)
