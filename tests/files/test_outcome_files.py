"""Tables of tests that overturned or stood: motions, scales, groups, peaks, and refusals."""

import numpy as np
import pytest

from jaxrock.calibration import read_tests

pytestmark = pytest.mark.float64
G = 9.80665
SAMPLES = np.array([0, 0.1, -0.2, 0.05])
TABLE = """Laboratory;;;;;;;;
file;unit;time step [ms];column;scale;overturned;earthquake;max rotation [deg];name
a.csv;;;;;no;Kobe;9,0;first
a.csv;g;;;-2;Yes;Kobe;90,0;
a.csv;;;;0,5;stood;Kobe;;a 2

b.csv;gal;20;;;TRUE;Izmit;nan;
c.csv;;;north [g];;0;Izmit;4,5;
"""
HEAD = "file,unit,time step [s],scale,overturned,group,peak rotation [deg],name"
# Tables, or rows below the head, and what the error must contain.
REFUSED = [
    ("1,a.csv\n", ("line 1", "file, overturned", "'1,a.csv'")),
    ("file,overturned,time step\na.csv,1,2\n", ("line 1", "'time step'", "'time step [s]'")),
    ("file,overturned,scal\na.csv,1,2\n", ("line 1", "'scal'", "'scale' meant")),
    ("a.csv,,0,0,maybe,,,", ("line 2", "greater than 0", "not 0", "yes or no", "'maybe'")),
    ("a.csv,,,,no,,95,\na.csv,,,,no,,-1,", ("line 2", "line 3", "peak rotation")),
    ("a.csv,,,,yes,,,x\na.csv,,,,no,,,x", ("names must differ", "'x'")),
    ("a.csv,,,,yes,A,,\na.csv,,,,no,,,", ("line 3", "a group was expected")),
    # Motions: of all rows at once, each where it occurs first.
    ("d.csv,,,,1,,,\nd.csv,,,,1,,,\nb.csv,,,,1,,,", ("line 2: '", "d.csv", "line 4: '", "b.csv")),
]  # fmt: skip


@pytest.fixture
def folder(tmp_path):
    """A folder of motions: one that states everything, one of numbers alone, one of two columns."""
    columns = [f"{0.01 * k:g},{a:g},{2 * a:g}\n" for k, a in enumerate(SAMPLES)]
    rows = [f"{line.rpartition(',')[0]}\n" for line in columns]
    (tmp_path / "a.csv").write_text("".join(["time [s],acc [g]\n", *rows]))
    (tmp_path / "b.csv").write_text("acc\n" + "".join(f"{a:g}\n" for a in SAMPLES))
    (tmp_path / "c.csv").write_text("".join(["time [s],east [g],north [g]\n", *columns]))
    return tmp_path


def test_a_table_is_read(folder):
    path = folder / "tests.csv"
    path.write_text(TABLE)
    tests = read_tests(path)
    assert tests.suite.names == ("first", "a", "a 2", "b", "c")
    motions = [record.scale * record.acceleration for record in tests.suite]
    for motion, factor in zip(motions, [G, -2 * G, 0.5 * G, 0.01, 2 * G], strict=True):
        np.testing.assert_allclose(motion, factor * SAMPLES, rtol=1e-14, atol=1e-14)
    steps = [float(record.time_step) for record in tests.suite]
    np.testing.assert_allclose(steps, [0.01, 0.01, 0.01, 0.02, 0.01], rtol=1e-12)
    assert tests.overturned.tolist() == [False, True, False, True, False]
    assert tests.groups == ("Kobe",) * 3 + ("Izmit",) * 2
    # A block that overturned has no peak, whatever was measured.
    peaks = np.deg2rad([9, np.nan, np.nan, np.nan, 4.5])
    np.testing.assert_allclose(tests.peak_rotations, peaks, rtol=1e-14)
    assert str(tests).startswith("5 tests in 2 groups: 2 overturned, 3 stood\n")
    path.write_text(f"overturned,remark,file\n1,x,a.csv\n0,,{folder}/a.csv\n")
    few = read_tests(str(path))
    assert few.suite.names == ("a", "a 2")
    assert few.groups is few.peak_rotations is None


@pytest.mark.parametrize(("text", "words"), REFUSED)
def test_tables_that_are_refused(folder, text, words):
    path = folder / "tests.csv"
    path.write_text(text if text[:2] in ("1,", "fi") else f"{HEAD}\n{text}\n")
    with pytest.raises(ValueError, match=r"^'.*tests\.csv'") as error:
        read_tests(path)
    assert all(word in str(error.value) for word in words), str(error.value)
