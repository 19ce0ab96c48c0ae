"""Tables of measurements: impact times, and tests that overturned or stood."""

import numpy as np
import pytest

from jaxrock.calibration import read_impact_times, read_tests

pytestmark = pytest.mark.float64
G = 9.80665
NAN = np.nan
IMPACTS = [
    ("time [s]\n0.5\n0.9\n1.2\n", [0.5, 0.9, 1.2], None),
    # A peak is unknown, and the one after the last impact is not used.
    (
        "# a\nn,time [min],max rotation [mrad]\n1,0,.5\n2,1,\n3,2,nan\n",
        [0, 60, 120],
        [5e-4, NAN],
    ),
    ("A;\nimpact time [ms];Peak (deg)\n5;-4,5\n\n9,5;9\n;\n", [5e-3, 9.5e-3], [-np.pi / 40]),
    ("t [s]\tNo.\tpeak [deg]\n.5\t1\t\n.9\t2\t\n", [0.5, 0.9], None),
]


@pytest.mark.parametrize(("content", "times", "peaks"), IMPACTS)
def test_impact_times_are_read(write, content, times, peaks):
    found = read_impact_times(write(content))
    np.testing.assert_allclose(found[0], times, rtol=1e-15)
    assert (found[1] is None) == (peaks is None)
    if peaks is not None:
        np.testing.assert_allclose(found[1], peaks, rtol=1e-15)


SAMPLES = np.array([0, 0.1, -0.2, 0.05])
TABLE = """Laboratory;;;;;;;;
file;unit;time step [ms];column;scale;overturned;earthquake;max rotation [deg];name
a.csv;;;;;no;Kobe;9,0;first
a.csv;g;;;-2;Yes;Kobe;90,0;
a.csv;;;;0,5;stood;Kobe;;a 2

b.csv;gal;20;;;TRUE;Izmit;nan;
c.csv;;;north [g];;0;Izmit;4,5;
"""


@pytest.fixture
def folder(tmp_path, write):
    """Motions: one that states everything, one of numbers alone, one of two columns."""
    columns = [f"{0.01 * k:g},{a:g},{2 * a:g}\n" for k, a in enumerate(SAMPLES)]
    rows = [f"{line.rpartition(',')[0]}\n" for line in columns]
    write("".join(["time [s],acc [g]\n", *rows]))
    write("acc\n" + "".join(f"{a:g}\n" for a in SAMPLES), "b.csv")
    write("".join(["time [s],east [g],north [g]\n", *columns]), "c.csv")
    return tmp_path


def test_a_table_of_tests_is_read(folder, write):
    tests = read_tests(write(TABLE, "tests.csv"))
    assert tests.suite.names == ("first", "a", "a 2", "b", "c")
    motions = [record.scale * record.acceleration for record in tests.suite]
    for motion, factor in zip(motions, [G, -2 * G, 0.5 * G, 0.01, 2 * G], strict=True):
        np.testing.assert_allclose(motion, factor * SAMPLES, rtol=1e-14, atol=1e-14)
    steps = [float(record.time_step) for record in tests.suite]
    np.testing.assert_allclose(steps, [0.01, 0.01, 0.01, 0.02, 0.01], rtol=1e-12)
    assert tests.overturned.tolist() == [False, True, False, True, False]
    assert tests.groups == ("Kobe",) * 3 + ("Izmit",) * 2
    assert str(tests).startswith("5 tests in 2 groups: 2 overturned, 3 stood\n")


HEAD = "file,unit,time step [s],scale,overturned,group,remark,name\n"
# What is read, and what the error must contain. How all tables are read is tested elsewhere.
REFUSED = [
    (read_impact_times, "t [s],peak [rad]\n0.5,9.1\n", ("line 2", "must be between", "'9.1'")),
    (read_impact_times, "time [s]\n0\n1\n1\n", ("line 4", "times must increase")),
    (read_tests, f"{HEAD}a.csv,,,0,1,,,", ("line 2", "not 0", "'0'")),
    (read_tests, f"{HEAD}a.csv,,,,yes,,,x\na.csv,,,,no,,,x", ("different names", "'x'")),
    (
        read_tests,
        f"{HEAD}a.csv,,,,yes,A,,\na.csv,,,,no,,,",
        ("line 3", "a group was expected"),
    ),
    (read_tests, HEAD + "a.csv,,,,1,,,\nd.csv,,,,1,,,", ("line 3: ", "d.csv")),
]


@pytest.mark.parametrize(("read", "content", "words"), REFUSED)
def test_tables_that_are_refused(folder, write, read, content, words):
    with pytest.raises(ValueError, match=r"^'.*tests\.csv'") as error:
        read(write(content, "tests.csv"))
    assert all(word in str(error.value) for word in words), str(error.value)
