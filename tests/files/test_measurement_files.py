"""Tables of impact times: names, units, other columns, and what is refused."""

import numpy as np
import pytest
from tools.refused_files import check_refusal

import jaxrock as jr
from jaxrock.calibration import read_impact_times

pytestmark = pytest.mark.float64
DEGREE = np.pi / 180
EXACT = """0.418553634813 0.998723613128 1.452847205662 1.823799227249 2.133470039794
2.395333882480 2.618611839790 2.810057255420 2.974850458425"""
IMPACTS = [
    ("time [s]\n0.5\n0.9\n1.2\n", [0.5, 0.9, 1.2], None),
    # A peak is unknown, and the one after the last impact is not used.
    ("# by phone\nimpact,time [min],velocity,max rotation [mrad]\n1,0,3,500\n2,1,2,\n3,2,1,nan\n",
     [0, 60, 120], [0.5, np.nan]),
    ("Cabinet 3;;\nimpact time [ms];Peak (deg);n\n500;-4,5;1\n\n900,5;9,0;2\n;;\n",
     [0.5, 0.9005], [-4.5 * DEGREE]),
    ("t [s]\tNo.\tpeak [deg]\n.5\t1\t\n.9\t2\t\n", [0.5, 0.9], None),
]  # fmt: skip


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
@pytest.mark.parametrize(("content", "times", "peaks"), IMPACTS)
def test_files_that_are_read(tmp_path, content, times, peaks, encoding):
    path = tmp_path / "times.csv"
    path.write_bytes(content.encode(encoding))
    found = read_impact_times(path)
    np.testing.assert_allclose(found[0], times, rtol=1e-15)
    expected = np.nan if peaks is None else peaks
    np.testing.assert_allclose(np.nan if found[1] is None else found[1], expected, rtol=1e-15)


def test_a_restitution_from_a_file(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("time [s]\n" + EXACT.replace(" ", "\n"))
    fit = jr.fit_free_rocking(read_impact_times(path)[0], jr.Block(0.1, 5.0))
    np.testing.assert_allclose(fit.restitution, 0.87, rtol=1e-12)


REFUSED = [
    ("0.5\n0.9\n", ", line 1: .* time .s. .* '0.5'"),
    ("time\n0.5\n0.9\n", ", line 1: column 'time' .* 'time .s.'"),
    ("t [s],peak rotatoin [deg]\n0.5,1\n", ", line 1: .* 'peak rotation' meant"),
    (
        "time [s],peak [rad]\n0.5,9.1\n",
        ", line 2: column 'peak .rad.' must be between .* '9.1'",
    ),
    ("time [s]\n0\n1\n1\n", ", line 4: times must increase"),
]


@pytest.mark.parametrize(("content", "message"), REFUSED)
def test_files_that_are_refused(tmp_path, content, message):
    path = tmp_path / "times.csv"
    path.write_text(content)
    check_refusal(path, message, read_impact_times)
