"""Files of networks, written here in their layouts from numbers that are known."""

from typing import NamedTuple

import numpy as np

G = 9.80665
POINTS = 43
STEP = 0.005
# In cm/s2; in fixed columns of nine characters some run together.
FIRST, SECOND, UPWARD = np.round(np.random.default_rng(3).normal(-60, 90, (3, POINTS)), 2)
# In counts of 0.001 gal.
COUNTS = np.round(1000 * FIRST).astype(int)


class Sample(NamedTuple):
    """A file, its components [m/s2] by their channels, and the channel that is vertical."""

    name: str
    content: str
    components: dict[str, np.ndarray]
    vertical: str | None = None


def lay_out(*parts):
    """Join what a file says; a number is one of lines that no reader needs."""
    return "".join("text\n" * part if isinstance(part, int) else part for part in parts)


def columns(values, form, number):
    """Print numbers in lines, by a format of Python and how many stand in a line."""
    words = [form % value for value in values]
    rows = ["".join(words[k : k + number]) for k in range(0, len(words), number)]
    return "".join(row + "\n" for row in rows)


def peak(values):
    return values[np.argmax(abs(values))]


def make_at2(values=FIRST, title="Made for a test, 1/2/2003, Somewhere, 90"):
    return lay_out(
        f"PEER NGA STRONG MOTION DATABASE RECORD\n{title}\n",
        f"ACCELERATION TIME SERIES IN UNITS OF G\nNPTS=  {POINTS}, DT=   .0050 SEC\n",
        columns(values / 981, "%15.7E", 5),
    )


def make_esm(values=FIRST, channel="HNE"):
    return lay_out(
        "EVENT_NAME: CENTRAL ITALY\nSTATION_NAME: Düzce: town hall\n",
        f"SAMPLING_INTERVAL_S: 0.005000\nNDATA: {POINTS}\nSTREAM: {channel}\n",
        f"UNITS: cm/s^2\nPGA_CM/S^2: {peak(values):.6f}\nDATA_TYPE: ACCELERATION\nUSER2:\n",
        columns(values, "%.6f", 1),
    )


def make_cosmos(values, number, channel):
    integers, reals = np.full(100, -999), np.full(100, -999.0)
    integers[53] = 400 if channel == "Up" else int(channel.split()[0])
    reals[[61, 63]] = 5.0, peak(values)
    parts = [
        lay_out(
            f"Corrected {quantity}    (Format v01.20 with 13 text lines) Src: made\n",
            7,
            f"Sta Chan  {number}: {channel} (Rcrdr Chan  {number}) Location:\n",
            4,
            " 100 Integer-header values follow on  10 lines, Format= (10I8)\n",
            columns(integers, "%8d", 10),
            " 100 Real-header values follow on  17 lines, Format= (6F13.6)\n",
            columns(reals, "%13.6f", 6),
            '   1 Comment line(s) follow, each starting with a "|":\n| comment\n',
            f"  {POINTS} {quantity} pts, approx  1 secs, units=cm/sec2 (4), Format=(8f10.3)\n",
            columns(series, "%10.3f", 8),
            f"End-of-data for Chan  {number} {quantity}\n",
        )
        for quantity, series in (("acceleration", values), ("velocity", values / 10))
    ]
    return lay_out(*parts)


TITLE = "Uncorrected Accelerogram Data             Processed: 07/06/19, CGS  made\n"


def make_csmip_1(values, number, channel):
    values = values / 1000
    return lay_out(
        TITLE,
        5,
        f"Chan  {number}: {channel}      \n",
        4,
        f"Units of uncor data are sec and g.  Max  = {peak(values):.6f} g, at 9.410 sec.\n",
        15,
        f"    {POINTS} Accelerogram points at 200 pts/sec in units of g.  Format: (8f9.6)\n",
        columns(values, "%9.6f", 8),
        f"/&  ----------  End of Data for Channel   {number}  ----------\n",
    )


def make_csmip_2(values, number, channel):
    line = f" {POINTS} points of %s data equally spaced at  .005 sec, in %s. (8f10.3)    \n"
    series = [
        line % names + columns(values, "%10.3f", 8)
        for names in (("accel", "cm/sec2"), ("veloc", "cm/sec"), ("displ", "cm"))
    ]
    return lay_out(
        f"Corrected accelerogram   made\n{TITLE}",
        5,
        f"Chan  {number}: {channel}      \n",
        9,
        f"Peak acceleration =   {peak(values):.3f}    cm/sec/sec  at   30.585   sec.\n",
        27,
        *series,
        f"/&  ----------  End of Data for Channel   {number}  ----------\n",
    )


def make_geonet(values, number, channel):
    numbers = np.zeros(100)
    numbers[[33, 34, 47, 65]] = POINTS, POINTS, 1, 0.005
    return lay_out(
        "Corrected accelerogram 20161113_110256_MADE_20 GNS Science\n",
        11,
        f"Component {channel}  Accelerometer Axis\n",
        f"Acceleration:  Peak {10 * peak(values):9.1f} mm/s/s at  44.88 sec     rms  7.0\n",
        2,
        columns(numbers[:30], "%8.3f", 10),
        columns(numbers[30:40], "%8d", 10),
        columns(numbers[40:], "%8.3f", 10),
        columns(10 * values, "%8.1f", 10),
        columns(values, "%8.2f", 10),
    )


def make_smc(values=FIRST):
    integers, reals = np.full(48, -32768), np.full(50, 1.7e38)
    integers[[12, 15, 16]] = 90, 1, POINTS
    reals[[1, 29, 31]] = 200.0, max(values), min(values)
    return lay_out(
        "2 CORRECTED ACCELEROGRAM\n",
        4,
        "station = Somewhere, Fire Station        component=    360\n",
        5,
        columns(integers, "%10d", 8),
        columns(reals, "%15.7E", 5),
        "|a comment\n",
        columns(values, "%10.3f", 8),
    )


def make_knet(counts=COUNTS, direction="E-W"):
    top = abs(counts - counts.mean()).max() / 1000
    return lay_out(
        "Origin Time       2003/09/26 04:50:00\n",
        9,
        f"Sampling Freq(Hz) 200Hz\nDuration Time(s)  {POINTS / 200}\n",
        f"Dir.              {direction}\nScale Factor      1000(gal)/1000000\n",
        f"Max. Acc. (gal)   {top:.3f}\nLast Correction   2003/09/26 04:00:00\nMemo.\n",
        columns(counts, "%8d ", 8),
    )


def make_three(name, make, channels, unit):
    """Three components of a file, one after the other, of which the last one is vertical."""
    parts = (FIRST, SECOND, UPWARD)
    words = [channel.split()[0] for channel in channels]
    return Sample(
        name,
        lay_out(*map(make, parts, (1, 2, 3), channels)),
        {word: unit * values for word, values in zip(words, parts, strict=True)},
        words[-1],
    )


DEGREES = ("90 Deg", "360 Deg", "Up")
# As many digits as the file has.
AT2 = G * np.array([float(f"{x:.7E}") for x in FIRST / 981])
NETWORKS = {
    "AT2": Sample("RSN1_MADE_X090.AT2", make_at2(), {"": AT2}),
    "ESM": Sample("XX.ABC..HNE.D.20200101.C.ACC.ASC", make_esm(), {"HNE": 0.01 * FIRST}),
    "COSMOS": make_three("made.V2c", make_cosmos, DEGREES, 0.01),
    "CSMIP volume 1": make_three("made.V1", make_csmip_1, DEGREES, G / 1000),
    "CSMIP volume 2": make_three("made.V2", make_csmip_2, DEGREES, 0.01),
    "GeoNet": make_three("made.V2A", make_geonet, ("N28W", "S62W", "Up"), 0.01),
    "SMC": Sample("a.smc", make_smc(), {"360": 0.01 * FIRST}),
    "K-NET": Sample("HKD100.EW", make_knet(), {"EW": 1e-5 * COUNTS}),
}
