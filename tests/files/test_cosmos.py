"""The COSMOS format: files written here, in its layout, from numbers that are known."""

import numpy as np
import pytest
from tools.refused_files import check_contradictions, check_refusal

import jaxrock as jr
from jaxrock.ground_motion.files.claims import Claims
from jaxrock.ground_motion.files.cosmos import read_cosmos
from jaxrock.tables import TextFile

STEP = 0.005
POINTS = 43
RANDOM = np.random.default_rng(3)
NORTH, EAST, UP = np.round(RANDOM.normal(0, 30, (3, POINTS)), 3)


def columns(values, form):
    """Numbers in lines, by a format of Python and how many stand in a line."""
    number, single = form
    words = [single % value for value in values]
    lines = ["".join(words[k : k + number]) for k in range(0, len(words), number)]
    return "".join(line + "\n" for line in lines)


def channel(  # noqa: PLR0913
    values,
    number=1,
    text="360 deg",
    code=360,
    *,
    quantity="acceleration",
    unit="cm/sec2 (4)",
    unit_code=4,
    fortran="(8f10.3)",
    form=(8, "%10.3f"),
    peak=None,
    scnl="",
    step=STEP,
    relative=-999,
):
    integers = np.full(100, -999)
    reals = np.full(100, -999.0)
    parameter = ["acceleration", "velocity", "displacement"].index(quantity) + 1
    integers[[0, 1, 2, 3, 49, 53, 54]] = 2, parameter, unit_code, 120, number, code, relative
    largest = values[np.argmax(abs(values))]
    # The recorder's step is another one: the record has been resampled.
    reals[[33, 61, 62]] = 0.01, 1000 * step, len(values) * step
    reals[[63, 64]] = largest if peak is None else peak, 0.1
    comments = ["| comment", *([f"|<SCNL>{scnl}  <AUTH>"] if scnl else [])]
    return (
        f"Corrected {quantity}    (Format v01.20 with 13 text lines) Src: made\n"
        "Made for a test\nHypocenter: none\nOrigin: none\nStatn No: 05-    1\nCoords:\n"
        "Recorder:\nRcrd start time:\n"
        f"Sta Chan  {number}: {text} (Rcrdr Chan  {number}) Location:\n"
        "Raw record length\nProcessed:\nRecord not filtered.\n"
        "Values used when parameter or data value is unknown/unspecified:   -999, -999.0\n"
        " 100 Integer-header values follow on  10 lines, Format= (10I8)\n"
        + columns(integers, (10, "%8d"))
        + " 100 Real-header values follow on  17 lines, Format= (6F13.6)\n"
        + columns(reals, (6, "%13.6f"))
        + f'   {len(comments)} Comment line(s) follow, each starting with a "|":\n'
        + "".join(comment + "\n" for comment in comments)
        + f"  {len(values)} {quantity} pts, approx  {len(values) * step:.0f} secs,"
        f" units={unit}, Format={fortran}\n"
        + columns(values, form)
        + f"End-of-data for Chan  {number} {quantity}\n"
    )


@pytest.fixture
def path(tmp_path):
    return tmp_path / "made.V2c"


STATION = (
    channel(NORTH)
    + channel(NORTH[:20], quantity="velocity", unit="cm/sec (5)", unit_code=5)
    + channel(EAST, 2, " 90 deg", 90)
    + channel(UP, 3, "Up", 400)
)


def test_channels_of_a_station(path):
    path.write_text(STATION)
    record = jr.read_record(path, column="90", vertical="up")
    np.testing.assert_allclose(record.acceleration, EAST / 100, rtol=1e-6)
    np.testing.assert_allclose(record.vertical, UP / 100, rtol=1e-6)
    assert float(record.time_step) == pytest.approx(STEP, rel=1e-6)
    np.testing.assert_allclose(
        jr.read_record(path, column="360", unit="gal").acceleration, NORTH / 100, rtol=1e-6
    )
    with pytest.raises(ValueError, match=r"column must be given.*'360', '90'"):
        jr.read_record(path)


@pytest.mark.parametrize(
    ("options", "factor"),
    [
        # Nothing stands between the numbers.
        ({"fortran": "(10F8.3)", "form": (10, "%8.3f"), "unit": "cm/s^2"}, 0.01),
        ({"fortran": "(1E15.6)", "form": (1, "%15.6e"), "unit": "cm/sec2(04)"}, 0.01),
        ({"fortran": "(8f9.3)", "form": (8, "%9.3f"), "unit": "g.     (02)"}, 9.80665),
        ({"unit": "mg (11)"}, 9.80665e-3),
    ],
    ids=lambda each: str(each.get("fortran", each["unit"])) if isinstance(each, dict) else "",
)
def test_units_and_formats(path, options, factor):
    code = {"g": 2, "m": 11}.get(options["unit"][0], 4)
    content = channel(-abs(NORTH) - 100, unit_code=code, **options)
    path.write_text(content.replace("\n", "      \n"))
    record = jr.read_record(path)
    np.testing.assert_allclose(record.acceleration, factor * (-abs(NORTH) - 100), rtol=1e-6)


@pytest.mark.parametrize(
    ("options", "direction", "name"),
    [
        ({"text": "Up", "code": 400}, "up", "Up"),
        ({"text": "Down", "code": 401}, "down", "Down"),
        ({"text": " 90 Deg", "code": -999, "relative": 90}, "level", "90"),
        ({"text": "H1", "code": 700}, "level", "H1"),
        ({"text": "0 deg", "code": 0}, "level", "0"),
        ({"text": "Other", "code": 0, "scnl": "BMR.BNZ.AK.--"}, "up", "BNZ"),
        ({"text": "Other", "code": 0}, "", "Other"),
    ],
)
def test_directions(path, options, direction, name):
    path.write_text(channel(NORTH, **options))
    (component,) = read_cosmos(TextFile(path), Claims())
    assert (component.direction, component.channel) == (direction, name)


def test_same_orientations_are_told_apart_by_the_channel(path):
    path.write_text(channel(NORTH) + channel(EAST, 7))
    found = [each.channel for each in read_cosmos(TextFile(path), Claims())]
    assert found == ["1: 360", "7: 360"]


# Five decimals, of which the header of the format's own example states three and pads them.
LARGE = np.append(NORTH, -161.96180)
PADDED = {"fortran": "(8f10.5)", "form": (8, "%10.5f")}
RAW = channel(NORTH).replace("43 acceleration pts", "43 raw accel.   pts")
COUNTS = "counts .* by obspy and use jaxrock.ground_motion.from_obspy"


def test_the_example_of_the_format(path):
    content = channel(LARGE, peak=-161.962, **PADDED)
    assert "  -161.962000" in content
    path.write_text(content.replace("End-of-data for Chan", "/& ---  End of data for Chan"))
    assert jr.read_record(path).samples == POINTS + 1


WHAT_IS_REFUSED = [
    (channel(NORTH, unit="counts (50)", unit_code=50), COUNTS),
    (channel(NORTH, unit_code=50), COUNTS),
    (channel(NORTH, unit_code=2), "states cm/sec2.* but the header states unit 2"),
    (channel(NORTH, unit="rad/s/s (7)", unit_code=7), "rad/s/s, which is not one of"),
    (channel(NORTH, quantity="velocity"), "holds no accelerations"),
    (channel(NORTH, peak=50), r"states a peak of 50\.0+, but that of the values is"),
    (channel(NORTH).replace("     5.000000", "  -999.000000"), "states no time step"),
    (channel(NORTH, fortran="(8f10.3,f8.1)"), "a format such as"),
    (channel(NORTH, fortran="(8f11.3)"), "8 values in columns of 11 characters"),
    (channel(NORTH).replace(f"\n{NORTH[0]:10.3f}", f"\n{NORTH[0]:9.3f} "),
     "columns of 10 characters were expected, got"),
    (channel(NORTH, text="Vert", code=402), "not said to point up or down"),
    (channel(NORTH, text="Up"), "channel is Up in line 9, but the header .* 360"),
    (channel(NORTH, text="90 deg"), "channel is 90 in line 9, but the header .* 360"),
    (channel(NORTH, code=900), "orientation of 900, which is not understood"),
    (channel(NORTH, scnl="A.HNZ.CE.--"), "states 360, but the channel is HNZ"),
    (channel(NORTH).replace("  43 acc", "  42 acc"), "but 42 points are 0.005 s apart"),
    (channel(NORTH).replace("approx  0 secs", "approx  9 secs"), "a duration of 9 s"),
    (channel(NORTH).replace("     5.000000", "     4.000000"), "a duration of 0.2150"),
    (channel(NORTH).replace("End-of-data for", "End of"), "'End-of-data for"),
    (channel(NORTH)[:-60], "the file ends|columns of"),
    (channel(NORTH).replace("|", "!"), "a comment that begins with"),
    (channel(np.array([1e9, *NORTH]), peak=-999), "columns of 10 characters"),
    (channel(np.array([np.nan, *NORTH]), peak=-999), "must be finite"),
]  # fmt: skip


@pytest.mark.parametrize(("content", "message"), WHAT_IS_REFUSED)
def test_what_is_refused(path, content, message):
    path.write_text(content)
    check_refusal(path, f".*{message}")


def test_the_caller_may_not_contradict(path):
    path.write_text(channel(NORTH))
    check_contradictions(path, "g", 0.01, "cm/sec2", "the header states 5.0+ ms")
