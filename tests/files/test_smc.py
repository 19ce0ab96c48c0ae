"""SMC files of the U.S. Geological Survey, written here in their layout."""

import re

import numpy as np
import pytest
from tools.refused_files import check_refusal

import jaxrock as jr

pytestmark = pytest.mark.float64

# In cm/s2, with five digits; the ground comes to rest, as it should.
PERIOD = [10.25, 66.123, -0.5, -66.123, -10.25, 0.5]
NORTH = np.array([0.0, *PERIOD, *(-x for x in PERIOD), *PERIOD, *(-x for x in PERIOD), 0.0])
UPWARD = NORTH.round() / 2
TEXT = [
    "2 CORRECTED ACCELEROGRAM",
    "*",
    "ABC0A",
    "     2020  01  01    0136 Somewhere, CA",
    "Moment Mag=      6.0 Ms=          Ml=",
    "station = Somewhere, Fire Station        component=    360",
    "epicentral dist =     89.0       pk acc =    66.123",
    "inst type=SMA-1      data source = USGS",
    "*",
    "*",
    "*",
]
COMMENTS = [
    "|",
    "|ref - A. Author, 2020, U.S. Geological Survey Strong-Motion Records",
    "|(Moment Magnitude = 6.04, distance to fault - 72.6 km, from A. Author)",
]


def write(values=NORTH, text=(), integers=(), reals=(), comments=COMMENTS, high=False):
    """Write a file; `text`, `integers` and `reals` have changes by the number of the field."""
    lines = dict(enumerate(TEXT, 1)) | dict(text)
    whole = dict.fromkeys(range(1, 49), -32768)
    whole |= {2: 2020, 3: 1, 13: 90, 14: 360, 16: len(comments), 17: len(values)}
    whole |= dict(integers)
    real = dict.fromkeys(range(1, 51), 1.7e38) | {2: 200.0, 3: 42.7, 4: 13.2}
    # Times of the peaks count from another start, after padding.
    real |= {29: 0.17, 30: max(values), 31: 0.18, 32: min(values)} | dict(reals)
    kind = (5, "{:14.7e}") if high else (8, "{:10.4e}")
    # One digit of the exponent, and a blank for the sign.
    numbers = [re.sub(r"e([+-])0(\d)", r"E\1\2", kind[1].format(x)) for x in values]
    numbers = [number.rjust(14 if high else 10) for number in numbers]
    rows = [
        *lines.values(),
        *join([f"{n:10d}" for n in whole.values()], 8),
        *join([f"{x:15.7E}" for x in real.values()], 5),
        *comments,
        *join(numbers, kind[0]),
    ]
    return ("\n".join(rows) + "\n").encode()


def join(words, number):
    return ["".join(words[k : k + number]) for k in range(0, len(words), number)]


def read(path, content, **options):
    path.write_bytes(content)
    return jr.read_record(path, **options)


def test_two_components(tmp_path):
    upward = tmp_path / "0111b.smc"
    named = {6: "station = Somewhere                      component=   up"}
    upward.write_bytes(write(UPWARD, named, {13: 0, 14: -32768}))
    path = tmp_path / "0111a.smc"
    record = read(path, write(), unit="gal", time_step=0.005, column="360", vertical=upward)
    np.testing.assert_allclose(record.acceleration, NORTH / 100, rtol=1e-15)
    np.testing.assert_allclose(record.vertical, UPWARD / 100, rtol=1e-15)
    assert record.time_step == 0.005
    with pytest.raises(
        ValueError, match="no component is horizontal; column names a vertical one: 'up'"
    ):
        jr.read_record(upward)
    with pytest.raises(ValueError, match=r"0111a.*one vertical component was expected, got 0"):
        jr.read_record(path, vertical=path)
    # By the degrees from upward alone, and by the name alone.
    for downward in ({13: 180}, {}), ({13: -32768}, {6: "component= Down"}):
        upward.write_bytes(write(UPWARD, {6: ""} | downward[1], downward[0]))
        with pytest.raises(ValueError, match=r"0111b.*points downward"):
            jr.read_record(path, vertical=upward)


@pytest.mark.parametrize(
    "changes",
    [
        {"text": {1: "1 UNCORRECTED ACCELEROGRAM"}, "comments": []},
        {"comments": [], "integers": {16: -32768, 13: -32768, 14: -32768}, "text": {6: "*"}},
        {"high": True},
        {"reals": {30: 1.7e38}},
        {"integers": {13: -32768}, "text": {6: "component= N65E"}},
    ],
)
def test_variants(tmp_path, changes):
    record = read(tmp_path / "a.smc", write(**changes))
    np.testing.assert_allclose(record.acceleration, NORTH / 100, rtol=1e-15)
    assert record.time_step == 0.005


REFUSED = [
    ({"text": {1: "3 VELOCITY"}}, {}, "line 1: an accelerogram was expected, this is '3 VELO"),
    (
        {"text": {1: "0 UNKNOWN"}},
        {},
        "line 1: an accelerogram was expected, this is '0 UNKNOWN'",
    ),
    ({"reals": {2: 1.7e38}}, {}, "line 18: the header states no sampling rate, so that the"),
    (
        {"reals": {2: 1e7}},
        {},
        "line 18: a time step from 1e-05 s on was expected, got 1.0000000e+07",
    ),
    ({}, {"time_step": 0.01}, "line 18: time_step is 0.01 s, but the header states 200 sam"),
    ({}, {"unit": "g"}, "line 1: unit is 'g', but an SMC file is in cm/s2"),
    (
        {"comments": ["| acceleration in g"]},
        {},
        "is in cm/s2 in line 1, but a comment states g",
    ),
    (
        {"comments": ["| raw acceleration in counts"]},
        {},
        "a comment states counts, which is not one of",
    ),
    ({"integers": {16: 2}}, {}, "line 13: the header states 2 lines of comments, but 3 begin"),
    (
        {"integers": {17: 18}},
        {},
        "line 33: 2 values in columns of 10 characters were expected",
    ),
    (
        {"integers": {17: 24}},
        {},
        "line 34: the header states 24 values, but more lines follow",
    ),
    (
        {"integers": {17: 30}},
        {},
        "line 34: 6 values in columns of 10 characters were expected",
    ),
    ({"integers": {17: -32768}}, {}, "the header does not state the number of values"),
    ({"integers": {1: 1}}, {}, "line 12: the first integer must mark missing values"),
    ({"reals": {1: 1.0}}, {}, "line 18: the first real must mark missing values"),
    ({"reals": {30: 66.13}}, {}, "line 23: the header states a peak of"),
    ({"reals": {30: 60.0, 32: -66.2}}, {}, "line 24: the header states a peak of"),
    (
        {"integers": {13: 45}},
        {},
        "line 13: the header states an orientation of 45, which is not understood",
    ),
    (
        {"integers": {13: 0}},
        {},
        "line 13: the channel is 360 in line 6, but the header states an orientation of 0",
    ),
    (
        {"integers": {13: -32768}, "text": {6: "component= Vert"}},
        {},
        "line 6: an orientation such as '360 deg', 'N28W', 'Up' or 'Down' was expected, got 'Vert'",
    ),
]


@pytest.mark.parametrize(("changes", "options", "message"), REFUSED)
def test_refused(tmp_path, changes, options, message):
    path = tmp_path / "a.smc"
    path.write_bytes(write(**changes))
    check_refusal(path, ".*" + re.escape(message), **options)


def test_numbers_too_large_for_their_columns_are_refused(tmp_path):
    content = write().replace(b" 6.6123E+1", b"**********", 1)
    with pytest.raises(ValueError, match=r"line 31: a value must be a number, got '\*\*\*"):
        read(tmp_path / "a.smc", content)
