"""Files of nothing but numbers, as OpenSees' examples have them: a series, or refused."""

import numpy as np
import pytest
from tools.refused_files import check_refusal

import jaxrock as jr

pytestmark = pytest.mark.filterwarnings("ignore:.*the ground still moves")

SERIES = np.convolve(np.random.default_rng(4).normal(size=53), np.ones(6) / 6).round(5)
TIMES = 0.02 * np.arange(SERIES.size)
STATED = {"unit": "g", "time_step": 0.02}


def write(values, number=1, form="%10.5f"):
    words = [form % value for value in values]
    return "".join("".join(words[k : k + number]) + "\n" for k in range(0, len(words), number))


def stack(*columns):
    return write(np.stack(columns, axis=1).ravel(), len(columns), "%12.5f")


@pytest.mark.parametrize(
    "content",
    [
        write(SERIES),
        write(SERIES, 8),
        write(SERIES, 5, "%13.5e").replace("e", "D"),
        write(SERIES, 2, " %.5f"),
        write(SERIES, 8).replace("\n", "\r\n"),
        write(SERIES, 8) + "*** End Data ***\n",
        "\n" + write(SERIES, 8),
        write(SERIES, 58),
    ],
)
@pytest.mark.parametrize("name", ["elCentro.dat", "ARL360.g3", "tabasFN.txt", "BM68elc"])
def test_a_series(tmp_path, content, name):
    path = tmp_path / name
    path.write_text(content)
    record = jr.read_record(path, **STATED)
    np.testing.assert_allclose(record.acceleration, 9.80665 * SERIES, rtol=1e-5)
    for missing in STATED:
        with pytest.raises(ValueError, match=rf"nothing but numbers, so that {missing} must"):
            jr.read_record(path, **{**STATED, missing: None})


def test_zeros_without_a_point(tmp_path):
    path = tmp_path / "record01.txt"
    path.write_text("0\n" + write(SERIES) + "0\n")
    assert jr.read_record(path, **STATED).samples == SERIES.size + 2


SMOOTH = np.sin(10 * TIMES)
TABLE = stack(0.1 * SMOOTH, np.cos(10 * TIMES), -SMOOTH)


WHAT_IS_REFUSED = [
    # Headers
    (f"{SERIES.size} 0.02\n{write(SERIES, 5)}", f"line 1: the first line '{SERIES.size} 0.02'"),
    (f"{SERIES.size} 0.02\n{write(SERIES, 2)}", "line 1: the first line .* may be a header"),
    (f"{SERIES.size}\n{write(SERIES)}", "line 1: the first line '58' may be a header"),
    (f"0.02\n{write(SERIES, 8)}", "line 1: the first line '0.02' may be a header"),
    (f"0.02\n{write(SERIES)}", "line 1: the first line '0.02' may be a header"),
    (f"4000\n{write(SERIES)}", "line 1: the first line '4000' may be a header"),
    # Columns
    (stack(TIMES, SERIES), "column 1 of 2 increases .*: write one number a line if"),
    (stack(SERIES, np.cumsum(SERIES**2)), "column 2 of 2 increases .*, or name the columns"),
    (write(TIMES), "column 1 of 1 increases"),
    (TABLE, "look like 3 columns side by side"),
    # Words
    (write(SERIES, 8) + "END\n", "line 9: a value must be a number, got 'END'"),
    (write(SERIES, 8) + "1 2 3\n0.5\n", "line 8: 8 numbers a line were expected, .* got 2"),
    (write(SERIES) + "1.0 2.0\n", "line 59: 1 numbers a line were expected, .* got 2"),
    (write(SERIES)[:-3], r"line 58: the file looks truncated: its last number '-?0\.\d\d\d'"),
    ("acc\n" + write(SERIES), "a file in one of these formats was expected: .AT2, .csv"),
]  # fmt: skip


@pytest.mark.parametrize(("content", "message"), WHAT_IS_REFUSED)
def test_what_is_refused(tmp_path, content, message):
    path = tmp_path / "a.txt"
    path.write_text(content)
    check_refusal(path, f".*{message}", **STATED)
