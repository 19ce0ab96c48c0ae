"""Files of networks, written here in their layouts from numbers that are known.

Each is a `Sample`: the name and the content of a file, its components [m/s2] by their channels, the
time step [s], the channel that is vertical, and damages that its reader has to notice.
"""

from typing import NamedTuple

import numpy as np

G = 9.80665
POINTS = 43
# In cm/s2; in fixed columns of ten characters some run together.
FIRST, SECOND, UPWARD = np.round(np.random.default_rng(3).normal(-60, 90, (3, POINTS)), 3)


class Sample(NamedTuple):
    """A file, what is right, and what is refused: a text, another one, part of the message."""

    name: str
    content: str
    components: dict[str, np.ndarray]
    step: float
    vertical: str = ""
    damages: tuple[tuple[str, str, str], ...] = ()


def columns(values, form, number):
    """Print numbers in lines, by a format of Python and how many stand in a line."""
    words = [form % value for value in values]
    rows = ["".join(words[k : k + number]) for k in range(0, len(words), number)]
    return "".join(row + "\n" for row in rows)


def peak(values):
    return values[np.argmax(abs(values))]


def make_at2(values=FIRST, title="Made for a test, 1/2/2003, Somewhere, 90"):
    values = values / 981
    return (
        f"PEER NGA STRONG MOTION DATABASE RECORD\n{title}\n"
        f"ACCELERATION TIME SERIES IN UNITS OF G\nNPTS=  {POINTS}, DT=   .0050 SEC\n"
        + columns(values, "%15.7E", 5)
    )


def make_esm(values=FIRST, channel="HNE"):
    header = {
        "EVENT_NAME": "CENTRAL ITALY",
        "STATION_NAME": "Düzce: town hall",
        "SAMPLING_INTERVAL_S": "0.005000",
        "NDATA": POINTS,
        "STREAM": channel,
        "UNITS": "cm/s^2",
        "PGA_CM/S^2": f"{peak(values):.6f}",
        "DATA_TYPE": "ACCELERATION",
        "USER2": "",
    }
    lines = [f"{key}: {value}\n" for key, value in header.items()]
    return "".join(lines) + columns(values, "%.6f", 1)


def make_cosmos(values, number, channel, code, quantity="acceleration"):
    integers, reals = np.full(100, -999), np.full(100, -999.0)
    integers[53] = code
    reals[[61, 63]] = 5.0, peak(values)
    return (
        f"Corrected {quantity}    (Format v01.20 with 13 text lines) Src: made\n"
        + "text\n" * 7
        + f"Sta Chan  {number}: {channel} (Rcrdr Chan  {number}) Location:\n"
        + "text\n" * 4
        + " 100 Integer-header values follow on  10 lines, Format= (10I8)\n"
        + columns(integers, "%8d", 10)
        + " 100 Real-header values follow on  17 lines, Format= (6F13.6)\n"
        + columns(reals, "%13.6f", 6)
        + '   1 Comment line(s) follow, each starting with a "|":\n| comment\n'
        + f"  {POINTS} {quantity} pts, approx  1 secs, units=cm/sec2 (4), Format=(8f10.3)\n"
        + columns(values, "%10.3f", 8)
        + f"End-of-data for Chan  {number} {quantity}\n"
    )


def make_csmip(values, number, channel, volume):
    title = "Uncorrected Accelerogram Data             Processed: 07/06/19, CGS  made\n"
    end = f"/&  ----------  End of Data for Channel   {number}  ----------\n"
    chan = f"Chan  {number}: {channel}      \n"
    if volume == 1:
        values = values / 1000
        line = f"    {POINTS} Accelerogram points at 200 pts/sec in units of g.  Format: (8f9.6)\n"
        top = (
            f"Units of uncor data are sec and g.  Max  = {peak(values):.6f} g, at 9.410 sec.\n"
        )
        lines = [title, *["text\n"] * 5, chan, *["text\n"] * 4, top, "text\n"]
        return "".join([*lines, *["numbers\n"] * 14, line, columns(values, "%9.6f", 8), end])
    top = f"Peak acceleration =   {peak(values):.3f}    cm/sec/sec  at   30.585   sec.\n"
    line = f" {POINTS} points of %s data equally spaced at  .005 sec, in %s. (8f10.3)    \n"
    lines = [
        "Corrected accelerogram   made\n",
        title,
        *["text\n"] * 5,
        chan,
        *["text\n"] * 9,
        top,
    ]
    lines += [*["text\n"] * 7, *["numbers\n"] * 20]
    for quantity, unit in (("accel", "cm/sec2"), ("veloc", "cm/sec"), ("displ", "cm")):
        lines += [line % (quantity, unit), columns(values, "%10.3f", 8)]
    return "".join([*lines, end])


def make_geonet(values, channel):
    # One digit, in columns of eight characters.
    values = 10 * np.round(values, 2)
    numbers = np.zeros(100)
    numbers[[33, 34, 47, 65]] = POINTS, POINTS, 1, 0.005
    return (
        "Corrected accelerogram 20161113_110256_MADE_20 GNS Science\n"
        + "text\n" * 11
        + f"Component {channel}  Accelerometer Axis\n"
        + f"Acceleration:  Peak {peak(values):9.1f} mm/s/s at  44.88 sec     rms  7.0\n"
        + "text\n" * 2
        + columns(numbers[:30], "%8.3f", 10)
        + columns(numbers[30:40], "%8d", 10)
        + columns(numbers[40:], "%8.3f", 10)
        + columns(values, "%8.1f", 10)
        + columns(values / 10, "%8.2f", 10)
    )


def make_smc(values=FIRST):
    integers, reals = np.full(48, -32768), np.full(50, 1.7e38)
    integers[[12, 15, 16]] = 90, 1, POINTS
    reals[[1, 29, 31]] = 200.0, max(values), min(values)
    return (
        "2 CORRECTED ACCELEROGRAM\n"
        + "text\n" * 4
        + "station = Somewhere, Fire Station        component=    360\n"
        + "text\n" * 5
        + columns(integers, "%10d", 8)
        + columns(reals, "%15.7E", 5)
        + "|a comment\n"
        + columns(values, "%10.3f", 8)
    )


# In counts of 0.001 gal.
COUNTS = np.round(1000 * FIRST).astype(int)


def make_knet(counts=COUNTS, direction="E-W"):
    header = {
        "Origin Time": "2003/09/26 04:50:00",
        **{f"{name}": "0" for name in "abcdefghi"},
        "Sampling Freq(Hz)": "200Hz",
        "Duration Time(s)": f"{POINTS / 200}",
        "Dir.": direction,
        "Scale Factor": "1000(gal)/1000000",
        "Max. Acc. (gal)": f"{abs(counts - counts.mean()).max() / 1000:.3f}",
        "Last Correction": "2003/09/26 04:00:00",
        "Memo.": "",
    }
    lines = [f"{name:18}{value}\n" for name, value in header.items()]
    return "".join(lines) + columns(counts, "%8d ", 8)


ALL = {"one": FIRST, "two": SECOND, "up": UPWARD}
PARTS = list(ALL.values())
NETWORKS = {
    "AT2": Sample(
        "RSN1_MADE_X090.AT2",
        make_at2(),
        {"": np.array([float(f"{x:.7E}") for x in FIRST / 981]) * G},
        0.005,
        damages=(
            ("NPTS=  43", "NPTS=  44", "44 values"),
            ("UNITS OF G", "UNITS OF CM/S", "CM/S"),
            ("ACCELERATION TIME", "VELOCITY TIME", "velocity"),
        ),
    ),
    "ESM": Sample(
        "XX.ABC..HNE.D.20200101.013632.C.ACC.ASC",
        make_esm(),
        {"HNE": 0.01 * FIRST},
        0.005,
        damages=(
            ("NDATA: 43", "NDATA: 42", "42 values"),
            ("cm/s^2\n", "m/s^2\n", "peak"),
            ("TYPE: ACC", "TYPE: VELOCITY OR ACC", ""),
            (f"{FIRST[5]:.6f}", f"{FIRST[5]:.6f}x", "number"),
        ),
    ),
    "COSMOS": Sample(
        "made.V2c",
        make_cosmos(FIRST, 1, "360 deg", 360)
        + make_cosmos(FIRST / 10, 1, "360 deg", 360, "velocity")
        + make_cosmos(SECOND, 2, " 90 deg", 90)
        + make_cosmos(UPWARD, 3, "Up", 400),
        dict(zip(("360", "90", "Up"), (0.01 * values for values in PARTS), strict=True)),
        0.005,
        "Up",
        (
            ("43 acceleration pts", "42 acceleration pts", "values in columns"),
            ("units=cm/sec2", "units=counts", "counts"),
            ("with 13 text", "with 12 text", ""),
        ),
    ),
    "CSMIP volume 1": Sample(
        "made.V1",
        "".join(
            make_csmip(v, k, c, 1)
            for k, (v, c) in enumerate(
                zip(PARTS, (" 90 Deg", "360 Deg", " Up"), strict=True), 1
            )
        ),
        dict(
            zip(("90", "360", "Up"), (G * np.round(v / 1000, 6) for v in PARTS), strict=True)
        ),
        0.005,
        "Up",
        (
            ("43 Accelerogram", "44 Accelerogram", "values in columns"),
            ("units of g.", "units of cm/sec2.", "peak"),
            ("(8f9.6)", "(8f8.6)", "values in columns"),
        ),
    ),
    "CSMIP volume 2": Sample(
        "made.V2",
        "".join(
            make_csmip(v, k, c, 2)
            for k, (v, c) in enumerate(
                zip(PARTS, (" 90 Deg", "360 Deg", " Up"), strict=True), 1
            )
        ),
        dict(zip(("90", "360", "Up"), (0.01 * v for v in PARTS), strict=True)),
        0.005,
        "Up",
        (
            ("43 points of accel", "42 points of accel", "values in columns"),
            ("in cm/sec2", "in g", "peak"),
            ("End of Data", "Start of Data", "accel data"),
        ),
    ),
    "GeoNet": Sample(
        "made.V2A",
        make_geonet(FIRST, "N28W") + make_geonet(SECOND, "S62W") + make_geonet(UPWARD, "Up"),
        dict(
            zip(
                ("N28W", "S62W", "Up"),
                (0.001 * np.round(10 * np.round(v, 2), 1) for v in PARTS),
                strict=True,
            )
        ),
        0.005,
        "Up",
        (
            ("      43      43", "      42      43", "values in columns"),
            ("mm/s/s", "mm/s", "mm/s"),
            ("   1.000", "   0.100", "0.1"),
        ),
    ),
    "SMC": Sample(
        "a.smc",
        make_smc(),
        {"360": 0.01 * FIRST},
        0.005,
        damages=(
            ("        43", "        44", "values in columns"),
            ("CORRECTED ACCELEROGRAM", "VELOCITY", "VELOCITY"),
            ("|a comment\n", "", "comments"),
        ),
    ),
    "K-NET": Sample(
        "HKD100.EW",
        make_knet(),
        {"EW": 1e-5 * COUNTS},
        0.005,
        damages=(
            ("s)  0.215", "s)  0.225", "43 values"),
            ("(gal)/1000000", "(gal)/8388608", "peak"),
            ("E-W", "W-E", "direction"),
        ),
    ),
}
