"""Volumes 1 and 2 of California's program: files written here from numbers that are known."""

import numpy as np
import pytest
from tools.refused_files import check_contradictions, check_refusal

import jaxrock as jr
from jaxrock.ground_motion.files.claims import Claims
from jaxrock.ground_motion.files.csmip import read_csmip
from jaxrock.tables import TextFile

STEP = 0.01
POINTS = 43
RANDOM = np.random.default_rng(5)
NORTH, EAST, UP = np.round(RANDOM.normal(0, 0.03, (3, POINTS)), 6)
# In volume 2, fields run together.
STRONG, WEAK, RISING = np.round(RANDOM.normal(-150, 120, (3, POINTS)), 5)


def columns(values, single, number=8):
    words = [single % value for value in values]
    lines = ["".join(words[k : k + number]) for k in range(0, len(words), number)]
    return "".join(line + "\n" for line in lines)


def headers(number, code, count):
    integers = np.full(100, -999)
    integers[[0, 26, 27]] = number, code, POINTS
    return columns(integers, "%5d", 16) + columns(np.full(count, -999.0), "%10.5f")


def first(values, number=1, text="360 Deg", code=360, *, unit="g", peak=None, line=None):
    """A channel of volume 1."""
    peak = values[np.argmax(abs(values))] if peak is None else peak
    return (
        "Uncorrected Accelerogram Data             Processed: 07/06/19, CGS  made\n"
        "Rcrd of\n(Origin:  To be determined)\nmade\nStation Id.\nMade for a test\n"
        f"Chan  {number}: {text}                                          \n"
        "Rcrd of\nHypocenter:  To be determined.\nInstr Period =  .0050 sec\n"
        f"No. of Points =  {POINTS}  Record Length =  {POINTS * STEP:.3f} sec   at 100"
        f" Samples/sec\nUnits of uncor data are sec and g.         Max  =  {peak:.3f} g, at"
        "    9.410 sec.\nRMS calc for complete record =        .\n"
        + headers(number, code, 50)
        + (
            line
            or f"    {POINTS} Accelerogram points at 100 pts/sec in units of {unit}."
            "       Format: (8f9.6)  \n"
        )
        + columns(values, "%9.6f")
        + f"/&  ----------  End of Data for Station Channel   {number}  ----------\n"
    )


def second(values, number=1, text="360 Deg", code=360, *, old=False):
    """A channel of volume 2, with velocities and displacements."""
    peak = values[np.argmax(abs(values))]

    def block(quantity, values, unit):
        line = f" {POINTS} points of {quantity} data equally spaced at  .010 sec"
        end = f".  (UNITS: {unit})\n" if old else f", in {unit}. (8f10.5)    \n"
        return line + end + columns(values, "%10.5f")

    content = (
        f"Corrected accelerogram   made       Chan  {number}: {text}     from   \n"
        "Uncorrected Accelerogram Data             Processed: 02/13/12, CGS  made\n"
        "Record of\n(Origin:  To be determined)\nmade\nStation No.\nMade for a test\n"
        f"Chan  {number}: {text}                                          \n"
        "Record of\nHypocenter:  To be determined.\nInstr Period =  .0109 sec\n"
        f"                        Record length =  {POINTS * STEP - STEP:.3f} sec.\n"
        "Uncor Max\nRMS accel\nAccelerogram bandpass filtered with 3 dB pts at   .30\n"
        f" {POINTS} points of instrument- and baseline-corrected accel, veloc and displ data\n"
        "At equally-spaced intervals of    .010  sec.\n"
        f"Peak acceleration =   {peak:.3f}    cm/sec/sec  at   30.585   sec.\n"
        "Peak   velocity\nPeak displacement\nInitial velocity\nRecord of\n\nmade\n\n"
        + headers(number, code, 100)
        + block("accel", values, "cm/sec2")
        + block("veloc", values / 100, "cm/sec")
        + block("displ", values / 1000, "cm")
        + f"/&  ----------  End of Data for Station Channel   {number}  ----------\n"
    )
    return content.upper() if old else content


def pairs(values, number=1, text="EW", *, step=STEP, times=None, unit="G/10", peak=None):
    """A channel of volume 1 with times, as RENADIC writes it and as film was digitized."""
    times = step * np.arange(POINTS) if times is None else times
    peak = 0.1 * values[np.argmax(abs(values))] if peak is None else peak
    both = np.stack([times, values], axis=1).ravel()
    return (
        "UNCORRECTED ACCELEROGRAM DATA              PROCESSED: 05/24/2011\nMADE\nORIGIN\nTRIGGER\n"
        f"STATION NO.\nMADE FOR A TEST\nCHAN  {number}: {text}       (STA CHN:  1)\n"
        "UNIVERSIDAD DE CHILE - RENADIC\nHYPOCENTER\nINSTR PERIOD = 0.0391 SEC\n"
        f"NO. OF POINTS =  {POINTS}  RECORD LENGTH ={POINTS * step:.3f} SEC\n"
        f"UNITS OF UNCOR ACCEL ARE SEC AND {unit}.     MAX  ={peak:7.3f} G, AT  30.160 SEC\n"
        "RMS ACCEL OF COMPLETE RECORD = 0.106 G\n"
        + headers(number, 0, 50)
        + columns(both, "%7.3f", 10)
        + f"/&  ----------  END OF DATA FOR CHANNEL {number}  ----------\n"
    )


VOLUME_1 = first(EAST, 1, " 90 Deg", 90) + first(NORTH, 2) + first(UP, 3, " Up", 500)
VOLUME_2 = second(WEAK, 1, " 90 Deg", 90) + second(STRONG, 2) + second(RISING, 3, " Up", 500)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "made.v2"


def test_volume_1(path):
    path.write_text(VOLUME_1)
    record = jr.read_record(path, column="90", vertical="up")
    np.testing.assert_allclose(record.acceleration, 9.80665 * EAST, rtol=1e-6)
    np.testing.assert_allclose(record.vertical, 9.80665 * UP, rtol=1e-6)
    assert float(record.time_step) == pytest.approx(STEP, rel=1e-6)
    with pytest.raises(ValueError, match=r"column must be given.*'90', '360'"):
        jr.read_record(path)


@pytest.mark.parametrize("ends", ["\n", "\r\n", "          \n"], ids=repr)
def test_volume_2(path, ends):
    path.write_bytes(VOLUME_2.replace("\n", ends).encode())
    record = jr.read_record(path, column="360", vertical="up")
    np.testing.assert_allclose(record.acceleration, STRONG / 100, rtol=1e-6)
    np.testing.assert_allclose(record.vertical, RISING / 100, rtol=1e-6)
    assert float(record.time_step) == pytest.approx(STEP, rel=1e-6)


def test_files_of_the_eighties_state_no_format(path):
    path.write_text(second(STRONG, 1, " 90 deg", 90, old=True))
    np.testing.assert_allclose(jr.read_record(path).acceleration, STRONG / 100, rtol=1e-6)
    # Others have a unit, but no format either.
    path.write_text(TWO.replace(" (8f10.5)", ""))
    np.testing.assert_allclose(jr.read_record(path).acceleration, STRONG / 100, rtol=1e-6)
    line = f"{POINTS} POINTS OF ACCEL DATA EQUALLY SPACED AT .01 SEC.  (UNITS: G)\n"
    path.write_text(first(NORTH, line=line))
    np.testing.assert_allclose(jr.read_record(path).acceleration, 9.80665 * NORTH, rtol=1e-6)


ALONG, ACROSS, ABOVE = np.round(RANDOM.normal(0, 2, (3, POINTS)), 3)
RENADIC = pairs(ALONG) + pairs(ACROSS, 2, "NS") + pairs(ABOVE, 3, "V")


@pytest.mark.parametrize(("unit", "factor"), [("G/10", 0.980665), ("g", 9.80665)])
def test_pairs_of_time_and_acceleration(path, unit, factor):
    path.write_text(RENADIC)
    record = jr.read_record(path, column="NS", vertical="up")
    np.testing.assert_allclose(record.acceleration, 0.980665 * ACROSS, rtol=1e-6)
    np.testing.assert_allclose(record.vertical, 0.980665 * ABOVE, rtol=1e-6)
    assert float(record.time_step) == pytest.approx(STEP, rel=1e-6)
    # A step of more digits than are printed.
    path.write_text(
        pairs(
            ALONG,
            text="INTC",
            unit=unit,
            step=1 / 256,
            peak=factor / 9.80665 * max(ALONG, key=abs),
        )
    )
    record = jr.read_record(path, time_step=1 / 256)
    np.testing.assert_allclose(record.acceleration, factor * ALONG, rtol=1e-6)


@pytest.mark.parametrize(
    ("text", "code", "direction"),
    [("Up", 500, "up"), ("Down", 600, "down"), ("H1", -1, "level"), ("Up", -999, "up")],
)
def test_directions(path, text, code, direction):
    path.write_text(first(NORTH, 1, text, code))
    (component,) = read_csmip(TextFile(path), Claims())
    assert (component.direction, component.channel) == (direction, text)


ONE = first(NORTH)
TWO = second(STRONG)


WHAT_IS_REFUSED = [
    (first(NORTH, unit="counts"), "counts .* by obspy and use jaxrock.ground_motion.from_obspy"),
    (first(NORTH, unit="g/10"), "g/10, which is not one of"),
    (first(NORTH, peak=0.5), "a peak of 0.500, but that of the values is"),
    (first(NORTH, text="Up"), "channel is Up in line 7, but the header .* 360"),
    (first(NORTH, text="90 Deg"), "channel is 90 in line 7, but the header .* 360"),
    (first(NORTH, text="Vert"), "an orientation such as"),
    (ONE.replace("at 100 pts", "at 200 pts"), "200 samples per second.*, but the header"),
    (ONE.replace("Length =  0.430", "Length =  0.530"), "a duration of 0.530 s, but 43"),
    (ONE.replace("Points =  43", "Points =  44"), "43 values in line 28, but the header states 44"),
    (ONE.replace("43 Accel", "42 Accel"), "42 values in line 28, but the header states 43"),
    (ONE.replace("(8f9.6)", "(8f9.6,x)"), "a format such as"),
    (ONE.replace("End of Data", "End"), "'7200 points of accel data"),
    (ONE.replace("Accelerogram points", "points"), "'7200 points of accel data"),
    (pairs(ALONG, times=np.cumsum(RANDOM.uniform(0.008, 0.012, POINTS))),
     "line 28: the times beside the values are not evenly spaced.*: take volume 2"),
    (pairs(ALONG, peak=1.0), r"a peak of 1\.000 in units of 9\.80665 m/s2"),
    (pairs(ALONG, unit="CM"), "'Units of uncor accel are sec and g/10' was expected"),
    (pairs(ALONG, text="NZ"), "an orientation such as .* got 'NZ'"),
    (pairs(ALONG).replace("=0.430", "=0.830"), "a duration of 0.830 s"),
    (pairs(ALONG).replace(" 0.020", " 0.021"), "not evenly spaced, from 0.009"),
    (ONE[:-75], "3 values in columns of 9 characters"),
    (TWO.replace("in cm/sec2", "in rad/sec2"), "rad/sec2, which is not one of"),
    (TWO.replace("    cm/sec/sec  at", "    g  at"), "in units of 9.80665 m/s2, but that"),
    (TWO.replace("points of accel", "points of veloc"), "holds no accelerations"),
    (TWO.replace("intervals of    .010", "intervals of    .020"), "states .010 s .*, but the"),
    (TWO.replace("at  .010 sec, in cm/sec2", "at  .000 sec, in cm/sec2"),
     "a time step from 1e-05 s on was expected, got .000 s"),
]  # fmt: skip


@pytest.mark.parametrize(("content", "message"), WHAT_IS_REFUSED)
def test_what_is_refused(path, content, message):
    path.write_text(content)
    check_refusal(path, f".*{message}")


def test_the_caller_may_not_contradict(path):
    path.write_text(ONE)
    check_contradictions(path, "gal", 0.02, "g")
