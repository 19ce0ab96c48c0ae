"""Files .bbp of SCEC's Broadband Platform, written here in their layouts."""

import numpy as np
import pytest
from tools.refused_files import check_refusal

import jaxrock as jr

STEP = 0.025
POINTS = 41
TIMES = STEP * np.arange(POINTS)
NORTH, EAST, UP = np.random.default_rng(9).normal(0, 30, (3, POINTS)).round(3)
NAMES = "# Sim stat=s01\n#    time(sec)      N-S(cm/s/s)      E-W(cm/s/s)      U-D(cm/s/s)\n"
COLUMNS = """\
# Strong motion recording
# Vs30 (m/s): 345
# Column 1: Time (s)
# Column 2: North-south acceleration (cm/s/s) (+ is northward)
# Column 3: East-west acceleration (cm/s/s) (+ is eastward)
# Column 4: Up-down acceleration (cm/s/s) (+ is upward)
#
"""


def write(head=NAMES, separator="\t", times=TIMES, form="%.6e", values=(NORTH, EAST, UP)):
    rows = np.stack([times, *values], axis=1)
    return head + "".join(separator.join(form % x for x in row) + "\n" for row in rows)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "s01.acc.bbp"


@pytest.mark.parametrize(
    ("content", "factor"),
    [
        (write(), 0.01),
        (write(COLUMNS, "   "), 0.01),
        (write(NAMES.replace("#", "%").replace("cm/s/s", "g"), " "), 9.80665),
        (write(NAMES.replace("N-S", "NS ").replace("U-D", "UP ")), 0.01),
        # Times of three digits, of which 1/40 needs all.
        (write(form="%.3f"), 0.01),
    ],
    ids=["names", "columns", "blanks", "other-names", "few-digits"],
)
def test_three_components(path, content, factor):
    path.write_text(content)
    record = jr.read_record(path, column="ew", vertical="up", time_step=STEP)
    np.testing.assert_allclose(record.acceleration, factor * EAST, rtol=1e-6)
    np.testing.assert_allclose(record.vertical, factor * UP, rtol=1e-6)
    suite = jr.read_suite(path.parent, vertical=True)
    assert suite.names == ("s01.acc NS", "s01.acc EW")
    np.testing.assert_allclose(suite[0].acceleration, factor * NORTH, rtol=1e-6)
    assert float(suite[0].time_step) == pytest.approx(STEP, rel=1e-6)


WHAT_IS_REFUSED = [
    (write(NAMES.replace("cm/s/s", "cm/s")), {}, "line 2: the columns are velocities in cm/s"),
    (write(COLUMNS.replace("cm/s/s", "cm/s")), {}, "line 4: the columns are velocities in"),
    (write(NAMES.replace("U-D(cm/s/s)", "U-D(cm/")), {}, "line 2: the columns are velocities"),
    (write(NAMES.replace("E-W(cm/s/s)", "E-W(g)")), {}, r"cm/s/s in line 2, but .* g"),
    (write(NAMES.replace("cm/s/s", "counts")), {}, "the values are counts"),
    (write(COLUMNS.replace("North-south", "X").replace("East-west", "North-south")), {},
     "a file in one of these formats"),
    (write(), {"unit": "g"}, "line 2: unit is 'g', but a comment states cm/s/s"),
    (write(), {"time_step": 0.02}, "line 3: time_step is 0.02 s, but the times .* 0.025 s"),
    (write(times=np.delete(np.arange(POINTS + 1), 9) * STEP), {}, "not evenly spaced"),
    (write().replace("\t", ",", 1), {}, "line 3: .* got 3 words"),
    (write(values=(NORTH, EAST, UP * np.nan)), {}, "line 3: a value must be finite"),
    (write(times=TIMES[:1], values=np.ones((3, 1))), {}, "at least two samples"),
    (write()[:-2], {}, "line 43: the file looks truncated: its last number"),
]  # fmt: skip


@pytest.mark.parametrize(("content", "options", "message"), WHAT_IS_REFUSED)
def test_what_is_refused(path, content, options, message):
    path.write_text(content)
    check_refusal(path, f".*{message}", column="NS", **options)
