"""Tables of tests that overturned or stood: motions, scales, groups, peaks, and refusals."""

import re

import numpy as np
import pytest

import jaxrock as jr
from jaxrock.calibration import Outcomes, read_tests
from jaxrock.calibration.outcomes import outcome_files

pytestmark = pytest.mark.float64
G = 9.80665
SAMPLES = np.array([0, 0.1, -0.2, 0.05])


@pytest.fixture
def folder(tmp_path):
    """A folder of motions: one that states everything, one of numbers alone, one of two columns."""
    motions = tmp_path / "motions"
    motions.mkdir()
    times = 0.01 * np.arange(SAMPLES.size)
    rows = [f"{t:g},{a:g}" for t, a in zip(times, SAMPLES, strict=True)]
    (motions / "a.csv").write_text("\n".join(["time [s],acc [g]", *rows, ""]))
    (motions / "b.csv").write_text("\n".join(["acc", *(f"{a:g}" for a in SAMPLES), ""]))
    both = [f"{t:g},{a:g},{2 * a:g}" for t, a in zip(times, SAMPLES, strict=True)]
    (motions / "c.csv").write_text("\n".join(["time [s],east [g],north [g]", *both, ""]))
    return tmp_path


def write(folder, text):
    path = folder / "tests.csv"
    path.write_text(text, encoding="utf-8")
    return path


TABLE = """# on the table of a laboratory
file,unit,time step [ms],column,scale,overturned,earthquake,max rotation [deg],name
motions/a.csv,,,,,no,Kobe,9,first
motions/a.csv,g,,,-2,Yes,Kobe,90,
motions/a.csv,,,,0.5,stood,Kobe,,a 2

motions/b.csv,gal,20,,,TRUE,Izmit,nan,
motions/c.csv,,,north [g],,0,Izmit,4.5,
motions/b.csv,gal,20,,,overturned,Izmit,fell,
"""


def test_a_table_is_read(folder):
    tests = read_tests(write(folder, TABLE))
    assert tests.suite.names == ("first", "a", "a 2", "b", "c", "b 2")
    motions = [record.scale * record.acceleration for record in tests.suite]
    factors = [G, -2 * G, 0.5 * G, 0.01, 2 * G, 0.01]
    for motion, factor in zip(motions, factors, strict=True):
        np.testing.assert_allclose(motion, factor * SAMPLES, rtol=1e-14, atol=1e-14)
    steps = [float(record.time_step) for record in tests.suite]
    np.testing.assert_allclose(steps, [0.01, 0.01, 0.01, 0.02, 0.01, 0.02], rtol=1e-12)
    assert tests.overturned.tolist() == [False, True, False, True, False, True]
    assert tests.groups == ("Kobe",) * 3 + ("Izmit",) * 3
    # A block that overturned has no peak, whatever was measured.
    peaks = np.deg2rad([9, np.nan, np.nan, np.nan, 4.5, np.nan])
    np.testing.assert_allclose(tests.peak_rotations, peaks, rtol=1e-14)
    assert str(tests).splitlines() == [
        "6 tests in 2 groups: 3 overturned, 3 stood",
        "suite of 6 records of 4 samples, 0.01 to 0.02 s apart",
        "peak rotations of 2 tests",
    ]


def test_each_motion_is_read_once(folder, monkeypatch):
    paths = []

    def read(path, **options):
        paths.append(path.name)
        return jr.read_record(path, **options)

    monkeypatch.setattr(outcome_files, "read_record", read)
    read_tests(write(folder, TABLE))
    assert sorted(paths) == ["a.csv", "a.csv", "b.csv", "c.csv"]  # a.csv also with a unit


SMALL = "file,overturned\nmotions/a.csv,1\nmotions/a.csv,0\n"


@pytest.mark.parametrize(
    "text",
    [
        SMALL,
        SMALL.replace(",", "\t"),
        SMALL.replace(",", ";"),
        SMALL.replace("overturned", "Outcome")
        .replace("0", "stood")
        .replace("1", "overturned"),
        f"Shaking table tests, 2026\n\n{SMALL}",
        "overturned,motion file,scale\nyes,motions/a.csv,1\nno,motions/a.csv,\n",
        "file;overturned;scale\nmotions/a.csv;yes;1,0\nmotions/a.csv;no;\n",
        "file,group,overturned,peak rotation [rad]\nmotions/a.csv,,yes,\nmotions/a.csv,,no,\n",
        "file,overturned,max rotation\n,,[deg]\nmotions/a.csv,yes,3\nmotions/a.csv,no,\n",
    ],
)
def test_layouts(folder, text):
    tests = read_tests(str(write(folder, text)))
    assert isinstance(tests, Outcomes)
    assert tests.suite.names == ("a", "a 2")
    assert tests.overturned.tolist() == [True, False]
    assert tests.groups is None
    assert tests.peak_rotations is None


def test_a_file_of_an_absolute_path(folder, tmp_path_factory):
    path = write(
        tmp_path_factory.mktemp("elsewhere"), f"file,overturned\n{folder}/motions/a.csv,1\n"
    )
    np.testing.assert_allclose(read_tests(path).suite[0].acceleration, G * SAMPLES, rtol=1e-14)


HEAD = "file,unit,time step [s],scale,overturned,group,peak rotation [deg],name"
FILE = "motions/a.csv"


TABLES_THAT_ARE_REFUSED = [
    ("", ": the file is empty"),
    (f"{HEAD}\n", ": at least one test was expected, got none"),
    (f"{HEAD}\n,,,,,,,\n", ": at least one test was expected, got none"),
    (f"1,{FILE}\n2,{FILE}\n", ", line 1: column '1' is not understood: leave it out or"),
    # Heads.
    ("file,group\na,b\n", ", line 1: column 'overturned' is missing; columns are file, over"),
    ("unit,overturned\ng,1\n", ", line 1: column 'file' is missing; columns are file,"),
    (f"file,overturned,duration [s]\n{FILE},1,2\n", ", line 1: column 'duration .s.' is not und"),
    (f"file,overturned,tilt [deg]\n{FILE},1,2\n", ", line 1: column 'tilt .deg.' is not unders"),
    (f"file,overturned,remarks\n{FILE},1,2\n", ", line 1: column 'remarks' is not understood"),
    (f"file,overturned,outcome\n{FILE},1,1\n", ", line 1: column 'outcome': a column 'overtu"),
    (f"file,overturned,time step\n{FILE},1,2\n", ", line 1: column 'time step': a unit of time"),
    (f"file,overturned,max rotation\n{FILE},1,2\n", ", line 1: column 'max rotation': a unit of"),
    (f"file,overturned,peak [m]\n{FILE},1,2\n", ", line 1: column 'peak .m.': a unit of angle"),
    (f"file,overturned,scale [%]\n{FILE},1,2\n", ", line 1: column 'scale .%.': no unit was"),
    # Cells.
    (f"{HEAD}\n{FILE},,,,,,,\n", ", line 2: column 'overturned' must be yes, no, .* got ''"),
    (f"{HEAD}\n{FILE},,,,maybe,,,\n", ", line 2: column 'overturned' must be .* got 'maybe'"),
    (f"{HEAD}\n,,,,yes,,,\n", ", line 2: a file with the motion was expected, got ''"),
    (f"{HEAD}\n{FILE},cm,,,yes,,,\n", ", line 2: column 'unit' must be one of 'm/s2', .* 'cm'"),
    (f"{HEAD}\n{FILE},,0,,yes,,,\n", ", line 2: column 'time step .s.' must be finite and gr"),
    (f"{HEAD}\n{FILE},,,0,yes,,,\n", ", line 2: column 'scale' must be finite and not 0, got"),
    (f"{HEAD}\n{FILE},,,inf,yes,,,\n", ", line 2: column 'scale' must be finite and not 0, got"),
    (f"{HEAD}\n{FILE},,,2x,yes,,,\n", ", line 2: column 'scale' must have a number, .* '2x'"),
    (f"{HEAD}\n{FILE},,,,no,,95,\n", ", line 2: column 'peak rotation .deg.' must be .* '95'"),
    (f"{HEAD}\n{FILE},,,,no,,-1,\n", ", line 2: column 'peak rotation .deg.' must be .* '-1'"),
    (f"{HEAD}\n{FILE},,,,yes,\n", ", line 2: 8 fields .* were expected, got 6"),
    (f"{HEAD}\n{FILE},,,,yes,,,x\n{FILE},,,,no,,,x\n", ", line 3: names must differ, got 'x' twi"),
    (f"{HEAD}\n{FILE},,,,yes,A,,\n{FILE},,,,no,,,\n", ", line 3: a group was expected, since"),
    # Motions.
    ("file,overturned\nd.csv,1\n", ", line 2: '.*d.csv': the file cannot be read"),
    ("file,overturned\nmotions,1\n", ", line 2: '.*motions' is a folder"),
    ("file,overturned\nmotions/b.csv,1\n", ", line 2: '.*b.csv': .* unit must be given"),
    ("file,overturned\nmotions/c.csv,1\n", ", line 2: '.*c.csv', line 1: column must be given"),
    (f"file,unit,overturned\n{FILE},gal,1\n", ", line 2: '.*a.csv', line 1: unit is 'gal', but"),
    # Cut files.
    (f"file,overturned,group\n{FILE},1,Kobe\n{FILE},1,K", ", line 3: .* truncated: .* 'K' is the"),
    ("file,overturned,time step [s],unit\nmotions/b.csv,1,1,gal\nmotions/b.csv,1,1,g",
     ", line 3: .* truncated: .* 'g' is the"),
    (f"file,overturned,scale\n{FILE},1,1.25\n{FILE},1,1.", ", line 3: .* truncated: .* '1.' has"),
    (f"file,overturned,scale\n{FILE},1,1.25\n{FILE},1,", ", line 3: .* truncated: .* is empty"),
    (f"{SMALL}{FILE},ye", ", line 4: column 'overturned' must be .* got 'ye'"),
    (f"{SMALL}{FILE}", ", line 4: 2 fields separated by commas were expected, got 1"),
    ("file;overturned;scale\na;1;0,5\na;0;1.5\n", ", line 3: decimals must all stand behind"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "message"), TABLES_THAT_ARE_REFUSED)
def test_tables_that_are_refused(folder, text, message):
    path = write(folder, text)
    with pytest.raises(ValueError, match=rf"^'{re.escape(str(path))}'{message}") as error:
        read_tests(path)
    assert "\n" not in str(error.value)


def test_all_faults_are_named_at_once(folder):
    rows = [f"{FILE},1,A", "no.csv,1,A", "motions/b.csv,1,A", "no.csv,0,A", f"{FILE},2,A"]
    path = write(folder, "\n".join(["file,overturned,group", *rows, f"{FILE},0,", ""]))
    with pytest.raises(ValueError, match="line 3") as error:
        read_tests(path)
    lines = [
        re.search(r"tests\.csv', line (\d)", fault)[1]
        for fault in str(error.value).split("\n")
    ]
    # A file that is missing is named where it occurs first.
    assert lines == ["3", "4", "6", "7"]


def test_a_table_without_a_last_newline(folder):
    """A last word that is whole, and a comment behind it."""
    for text in (SMALL.rstrip("\n"), f"{SMALL}# end"):
        assert len(read_tests(write(folder, text)).suite) == 2
