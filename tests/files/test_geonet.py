"""GeoNet's .V1A and .V2A: files written here, in their layout, from numbers that are known."""

import numpy as np
import pytest
from tools.refused_files import check_contradictions, check_refusal

import jaxrock as jr
from jaxrock.ground_motion.files.claims import Claims
from jaxrock.ground_motion.files.geonet import read_geonet
from jaxrock.tables import TextFile

STEP = 0.02
POINTS = 43
RANDOM = np.random.default_rng(7)
# As in the 2016 Kaikoura earthquake, some numbers fill their columns.
ALONG, ACROSS, UP = np.round(RANDOM.normal(-9000, 3000, (3, POINTS)), 1)
# Velocities and displacements.
OTHERS = np.round(RANDOM.normal(0, 90, POINTS), 2)


def columns(values, single="%8.1f"):
    words = [single % value for value in values]
    lines = ["".join(words[k : k + 10]) for k in range(0, len(words), 10)]
    return "".join(line + "\n" for line in lines)


def component(  # noqa: PLR0913
    values,
    name="N28W",
    azimuth=332,
    *,
    raw=False,
    peak=None,
    unit="mm/s/s",
    scale=1.0,
    step=STEP,
    stated=None,
    counted=POINTS,
    duration=(POINTS - 1) * STEP,
):
    peak = values[np.argmax(abs(values))] if peak is None else peak
    stated = step if stated is None else stated
    others = 0 if raw else POINTS
    counts = [65536, 250, 250, counted, others, others, 0, 0, 2, 19715]
    place = [42, 37, 10, 173, 3, 13, 332, azimuth, 198, 9]
    sensor = [200, 0.7, 0, 0, 0, 0, 0, scale, 0, 0]
    times = [327.68, 5, 5, 163.82, 0.005, step, 0, 0, 0, 9806.6]
    how = "Instrument corrected data at %.3f sec intervals\nBand-pass filter\n"
    if raw:
        how = "Raw readings in units of 1.00 mm/s/s  at intervals of %.3f s\nData is unfiltered\n"
    return (
        f"{'Unc' if raw else 'C'}orrected accelerogram 20161113_110256_MADE_20 GNS Science\n"
        "Site MADE      42 37 10S  173 03 13E     Cusp file:  made\nMade for a test\n"
        "Instrument Cusp_1\nResolution: 18-bit\nAccelerogram made\nnear here\n"
        "2016 November 13         11:02:56 UT\nEpicentre  42 41 33S 173 01 19E\n"
        f"Number of points  {POINTS}    Duration {duration:.2f} sec\n{how % stated}"
        f"Component {name}  Longitudinal Accelerometer Axis\n"
        f"Acceleration:  {'P' if raw else 'p'}eak {peak:9.1f} {unit} at  44.88 sec     rms  7.0\n"
        "Velocity:\nDisplacement:\n"
        + columns([2016, 11, 13, 11, 2, 560, 0, 0, 2016, 11], "%8d")
        + columns([42, 41, 33, 173, 1, 19, 15, 0, 13, 11], "%8d")
        + columns(place, "%8d")
        + columns(counts, "%8d")
        + columns(sensor, "%8.3f")
        + columns(np.zeros(10), "%8.3f")
        + columns(times, "%8.3f")
        + columns(np.zeros(30), "%8.2f")
        + columns(values)
        + columns(OTHERS[:others], "%8.2f") * 2
    )


V2A = component(ALONG) + component(ACROSS, "S62W", 242) + component(UP, "Up", 0)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "made.V2A"


def test_components_of_a_station(path):
    path.write_text(V2A)
    record = jr.read_record(path, column="S62W", vertical="up")
    np.testing.assert_allclose(record.acceleration, ACROSS / 1000, rtol=1e-6)
    np.testing.assert_allclose(record.vertical, UP / 1000, rtol=1e-6)
    assert float(record.time_step) == pytest.approx(STEP, rel=1e-6)
    with pytest.raises(ValueError, match=r"column must be given.*'N28W', 'S62W'"):
        jr.read_record(path)


def test_volume_1(path):
    # Here the duration is that of the points, not of the steps between them.
    path.write_text(component(ALONG, raw=True, duration=POINTS * STEP))
    record = jr.read_record(path, unit="mm/s2")
    np.testing.assert_allclose(record.acceleration, ALONG / 1000, rtol=1e-6)


@pytest.mark.parametrize(
    ("name", "azimuth", "direction"),
    [
        ("S90E", 90, "level"),
        ("S14E", 166, "level"),
        ("N05E", 5, "level"),
        ("S62W", 242, "level"),
        ("N", 0, "level"),
        ("W", 270, "level"),
        ("Up", 0, "up"),
        ("Down", 0, "down"),
    ],
)
def test_directions(path, name, azimuth, direction):
    path.write_text(component(ALONG, name, azimuth))
    (found,) = read_geonet(TextFile(path), Claims())
    assert (found.direction, found.channel) == (direction, name)


def test_same_components_are_told_apart_by_their_number(path):
    path.write_text(component(ALONG) + component(ACROSS))
    found = [each.channel for each in read_geonet(TextFile(path), Claims())]
    assert found == ["1: N28W", "2: N28W"]


WHAT_IS_REFUSED = [
    (component(ALONG, peak=12345.6), "a peak of 12345.6, but that of the values is"),
    (component(ALONG, peak=-ALONG.min()), None),
    (component(ALONG, unit="units"), "the header states units, which is not one of"),
    (component(ALONG, unit="cm/s/s", raw=True),
     "states mm/s/s in line 11, but the header states cm/s/s"),
    (component(ALONG, scale=0.1), "multiplied by 0.100 are not read"),
    (component(ALONG, raw=True).replace("of 1.00", "of 0.10"), "multiplied by 0.10 are"),
    (component(ALONG, stated=0.01), "states 0.010 s in line 11, but the header states 0.020 s"),
    (component(ALONG, step=0.0), "from 1e-05 s on was expected, got 0.000 s"),
    (component(ALONG, duration=5), "a duration of 5.00 s, but 43 points"),
    (component(ALONG, counted=42), "43 values in line 10, but the header states 42"),
    (component(ALONG, azimuth=28), "N28W in line 13, but the header states an orientation of 28"),
    (component(ALONG, "North"), "a line with the component was expected"),
    (component(np.round(ALONG[:-1], 1)), "3 values in columns of 8 characters"),
    (component(np.append(ALONG[:-1], np.inf), peak=1), "must be finite|must be a number"),
    (component(np.append(ALONG[:-1], 1e7)), "columns of 8 characters"),
    (component(ALONG)[:-30], "columns of 8|the file ends"),
    (component(ALONG) + "more\n", "a title with"),
]  # fmt: skip


@pytest.mark.parametrize(("content", "message"), WHAT_IS_REFUSED)
def test_what_is_refused(path, content, message):
    path.write_text(content)
    if message is None:  # a peak without its sign
        assert jr.read_record(path).samples == POINTS
        return
    check_refusal(path, f".*{message}")


def test_the_caller_may_not_contradict(path):
    path.write_text(component(ALONG))
    check_contradictions(path, "g", 0.01, "mm/s/s")
