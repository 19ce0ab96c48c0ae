"""Tables of impact times: names, units, counters, and what is refused."""

import numpy as np
import pytest
from tools.refused_files import check_refusal

from jaxrock.calibration import read_impact_times

pytestmark = pytest.mark.float64
DEGREE = np.pi / 180


FILES_THAT_ARE_READ = [
    ("0\n0.5\n0.9\n", [0, 0.5, 0.9], None),
    ("# phone\n\ntime\n 0\n# far\n.5\r\n9e-1", [0, 0.5, 0.9], None),
    ("\ufeffZeit [s]\n-1.5\n+.5\n", [-1.5, 0.5], None),
    ('"t","peak [rad]"\n"0.1","-0.02"\n"0.2"\n', [0.1, 0.2], [-0.02]),
    ("0,0.1\n1,\n2,nan\n3\n4,-0.05\n", [0, 1, 2, 3, 4], [0.1, np.nan, np.nan, np.nan]),
    ("time [ms]\n0\n250\n", [0, 0.25], None),
    ("times of impacts (min),largest rotation (rad)\n0,0.1\n1,\n", [0, 60], [0.1]),
    ("t_s,peak_mrad\n0,500\n1,\n", [0, 1], [0.5]),
    ("Zeit [s],\u03b8 max [deg]\n0,-45\n1,\n", [0, 1], [-np.pi / 4]),
    ("impact,time\n0,1\n1,2\n", [1, 2], None),
    ("time,velocity\n0,1\n1,2\n", [0, 1], None),
    ("t,a,b\n0\n1\n", [0, 1], None),
    ("#,time [ms],peak [deg]\n1,500,9\n2,900,\n", [0.5, 0.9], [9 * DEGREE]),
    ("# time [ms],peak [mrad]\n500,90\n900,nan\n", [0.5, 0.9], [0.09]),
    ("# time_ms\n500\n900\n", [0.5, 0.9], None),
    ("peak [deg]\tNo.\ttime of impact [s]\n9\t1\t.5\n\t2\t.9\n", [0.5, 0.9], [9 * DEGREE]),
    ('sep=;\nn;notes;t [s];rotation [deg]\n1;a, b;.5;9\n2;"c;d";.9;\n', [0.5, 0.9], [9 * DEGREE]),
    ("No.,Zeit [s],half cycle [s],speed [deg/s]\n1,.5,.4,3\n2,.9,.3,2\n", [0.5, 0.9], None),
    ("impact,peak time [s],time [s],max (rad)\n1,.6,.5,.1\n2,.9,.8,\n", [0.5, 0.8], [0.1]),
    # Other rotations are ignored beside peaks.
    ("t,min rotation [rad],peak rotation after impact [rad],theta0 [rad],rms tilt\n"
     "0,7,.1,8,9\n1,7,,8,9\n", [0, 1], [0.1]),
    ("0,\n1,nan\n2,0.1\n", [0, 1, 2], None),  # the only peak is beyond the last impact
    # Spreadsheets in many languages, and what loggers write.
    ("t [s];peak [rad]\n0,5;0,1\n0,9;\n;\n", [0.5, 0.9], [0.1]),
    ("0,5;0,1\n0,9;0,1\n", [0.5, 0.9], [0.1]),
    ('t,"peak\n[deg]"\n"0,5","9"\n"0,9",\n', [0.5, 0.9], [9 * DEGREE]),
    ("0.5 0.1\n0.9 0.1\n", [0.5, 0.9], [0.1]),
    ("t|peak_rad\n.5|1d-1\n.9|\n", [0.5, 0.9], [0.1]),
    ("Cabinet 3\nt [s],peak [rad]\n.5,.1\n.9,\n", [0.5, 0.9], [0.1]),
    ("t,peak\n[ms],[deg]\n500,9\n900,\n", [0.5, 0.9], [9 * DEGREE]),
    ("time in ms,maximum angle / deg,n\n500,9,\n900,,\n", [0.5, 0.9], [9 * DEGREE]),
    ("# t [ms],peak [deg]\n# by phone\n500,9\n900,\n", [0.5, 0.9], [9 * DEGREE]),
    ("# NS, 21 \u00b0C, 3 min, by us\n.5,.1\n.9,\n", [0.5, 0.9], [0.1]),
    ("# Cabinet, left\n.5,.1\n.9,\n", [0.5, 0.9], [0.1]),
    ("# at 240 fps\ncamera time [s],time\n.6,.5\n.8,.9\n", [0.5, 0.9], None),
    ("t,rotation time [s],tilt rate [deg/s]\n.5,1,1\n.9,1,1\n", [0.5, 0.9], None),
]  # fmt: skip


@pytest.mark.parametrize(("content", "times", "peaks"), FILES_THAT_ARE_READ)
def test_files_that_are_read(tmp_path, content, times, peaks):
    path = tmp_path / "times.csv"
    for encoding in ("utf-8", "utf-16"):
        path.write_bytes(content.removeprefix("\ufeff").encode(encoding))
        found = read_impact_times(path if encoding == "utf-8" else str(path))
        np.testing.assert_array_equal(found[0], times)
        assert (found[1] is None) == (peaks is None)
        if peaks is not None:
            np.testing.assert_allclose(found[1], peaks, rtol=1e-15)


PEAK = "a peak rotation must be between -pi/2 and pi/2 rad and not 0"


UNCLEAR = ", line 1: names of the columns were expected, .* since"


FILES_THAT_ARE_REFUSED = [
    (None, ": the file cannot be read: No such file or directory"),
    (..., ": the file cannot be read: Is a directory"),
    (b"1\n\xff\xfe\x00", ": a text file was expected, this one is binary"),
    (b"", ": the file is empty"),
    (b"# none\n", ": a line with the names of the columns was expected, all lines are comments"),
    (b"time\n# none\n", ": at least two lines, each with the time of an impact, .* got 0"),
    (b"0.5\n", ": at least two lines, each with the time of an impact, .* got 1"),
    (b"0,5;0.1\n0,9;0.1\n", ", line 1: decimals must all stand behind points or all behind"),
    (b"1,234;\n1,238;\n", ", line 1: '1,234' may be a number with decimals, or one of thous"),
    (b"0\n1,0.1,3\n", ", line 2: without names .* at most one peak .* got '1,0.1,3'"),
    (b"t\n0\n1,0.1,3\n", ", line 3: 1 fields .* were expected, got 3"),
    (b"counter\n0\n1\n", ", line 1: one column must be times, .* got 'counter'"),
    (b"time between impacts [s],n\n1,1\n2,2\n", ", line 1: one column must be times"),
    (b"# rotations in radians\ntime [s],peak [deg]\n0,1\n1,2\n",
     ", line 1: a comment states the unit 'radians', but the column is 'peak .deg.'"),
    (b"\n".join(b"%d,0.1" % k for k in range(2, 12)),
     ", line 1: times of impacts were expected, .* got evenly spaced times, 1 s apart"),
    (b"time [furlong]\n0\n1\n", ", line 1: one column must be times, .* got 'time"),
    (b"time,t\n0,1\n1,2\n", ", line 1: one column must be times, .* got 'time,t'"),
    (b"peak time [s],n\n1,1\n2,2\n", ", line 1: one column must be times, .* 'peak time"),
    (b"interval [s],n\n1,1\n2,2\n", ", line 1: one column must be times, .* 'interval"),
    (b"time,\n0,1\n1,2\n", ", line 2: names of the columns were expected above '0,1'"),
    (b"time,peak [cm]\n0,1\n1,2\n", ", line 1: rotations must be peaks with their unit, .* got"),
    (b"time,tilt_angle_deg_left\n0,1\n",
     ", line 1: rotations must be peaks with their unit, .* got"),
    (b"t,peak [deg],theta [rad]\n0,1,1\n", ", line 1: at most one column .* got 2 in"),
    (b"# time [s]\n# t [ms]\n0\n9\n", ", line 2: one comment with the names .* another"),
    (b"1,0.52\n2,0.94\n3,1.27\n", ", line 1: names of the columns .* may be a counter"),
    (b"0,0.52\n1,0.94\n2,\n", ", line 1: names of the columns .* may be a counter"),
    (b"500\n900\n1200\n", ", line 1: names of the columns .* are 350 s apart"),
    (b"0.512\n0.987\n1.2", ", line 3: the file looks truncated: its last number '1.2' has"),
    (b"0.5,.091\n0.9,.071\n1", ", line 3: the file looks truncated: its last number '1'"),
    (b"t;n\n0,512;1\n0,987;2\n1,2", ", line 4: the file looks truncated: its last number"),
    # Units that no column has would be lost.
    (b"# time [s],peak, deg\n0.5,0.9\n1,0.7\n", f"{UNCLEAR} 'deg' may be the unit of one"),
    (b"# all times in ms\n5\n9\n", f"{UNCLEAR} 'ms' may be the unit of one"),
    (b"# interval [s],theta [deg]\n0.5,0.9\n1,0.7\n", ", line 1: one column must be times"),
    (b"Unit: ms\n5\n9\n", ", line 1: names of the columns .* got 'Unit: ms'"),
    (b"time [s] [ms]\n5\n9\n", ", line 1: one column must be times, .* got"),
    (b"time [g]\n5\n9\n", ", line 1: one column must be times, .* got"),
    (b"0.5s\n1\n", ", line 1: one column must be times, .* got '0.5s'"),
    (b"t\n0\nsoon\n", ", line 3: the time of an impact was expected, .* got 'soon'"),
    (b"0\n1 2\n", ", line 2: the time of an impact was expected, .* got '1 2'"),
    (b"0\n1_0\n", ", line 2: the time of an impact was expected, .* got '1_0'"),
    (b"0,0.1\n,0.1\n", ", line 2: the time of an impact was expected, .* got ',0.1'"),
    (b"0,high\n1\n", ", line 1: one column must be times, .* got '0,high'"),
    (b"0\nnan\n", ", line 2: a time must be finite, got 'nan'"),
    (b"0\ninf,1\n", ", line 2: a time must be finite, got 'inf,1'"),
    (b"0,0\n1\n", f", line 1: {PEAK}, or empty if unknown, got '0,0'"),
    (b"0,0.1\n1,-3\n2\n", f", line 2: {PEAK}, or empty if unknown, got '1,-3'"),
    (b"0,inf\n1\n", f", line 1: {PEAK}, or empty if unknown, got '0,inf'"),
    (b"0,574\n1,066\n", f", line 1: {PEAK}, or empty if unknown, got '0,574'"),
    (b"t\n0\n# x\n1\n1\n", ", line 5: a time after 1 s was expected, got 1 s"),
    (b"1700000000.25\n1700000000.125\n", ", line 2: .* 1700000000 s was expected, got"),
]  # fmt: skip


@pytest.mark.parametrize(("content", "message"), FILES_THAT_ARE_REFUSED)
def test_files_that_are_refused(tmp_path, content, message):
    path = tmp_path / "times.csv"
    if content is ...:
        path.mkdir()
    elif content is not None:
        path.write_bytes(content)
    check_refusal(path, message, read_impact_times)


@pytest.mark.parametrize(
    "name",
    [
        "peak rotation",
        "theta",
        "max",
        "min rotation [rad]",
        "rotation at impact [rad]",
        "theta0 [rad]",
        "initial_angle_deg",
        "mean peak [mrad]",
        "rms tilt [deg]",
        "slope [\u00b0]",
        "peak time [deg]",
        "Winkel [deg]",
    ],
)
def test_rotations_without_a_unit_or_of_another_kind(tmp_path, name):
    """Degrees would pass for radians, and other rotations for peaks: both give another block."""
    path = tmp_path / "times.csv"
    path.write_text(f"time [s],{name}\n0.5,0.9\n1.2,0.7\n1.7,0.5\n", encoding="utf-8")
    must = (
        r"'[^']*times.csv', line 1: rotations must be peaks with their unit, .* \[rad\], got"
    )
    with pytest.raises(ValueError, match=must):
        read_impact_times(path)
