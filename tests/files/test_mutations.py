"""Files that are cut, shifted, exchanged or encoded otherwise are read right, or refused.

The kinds stand in the table `KINDS`. Files of networks are written by the tests of their formats.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import test_cosmos
import test_csmip
import test_esm
import test_geonet
import test_smc
from references.mutations import read_mutations
from test_hazard_files import LEVELS, NEWER, NSHMP, POINTS, SITES

import jaxrock as jr
from jaxrock.calibration import read_impact_times, read_tests

pytestmark = pytest.mark.float64

G = 9.80665
GAL = 0.01
REFUSED = np.nan


class Kind(NamedTuple):
    """A file, how it is read, and what is right.

    Attributes
    ----------
    name : str
        Of the file.
    content : bytes or str
        As it should be.
    read : callable
        Takes the path.
    same : callable
        Takes what was read and perhaps factors by names, and returns whether it is right.
    statements : tuple
        A text, what takes its place, a name, and the factor of this or `REFUSED`.
    """

    name: str
    content: bytes | str
    read: Callable
    same: Callable
    statements: tuple = ()


def read_columns(columns, path, **options):
    return [jr.read_record(path, column=column, **options) for column in columns]


def read_one(path, **options):
    return [jr.read_record(path, **options)]


def match_rows(known, step, samples, row, whole, records, *, acceleration=1.0, time=1.0):
    """Return whether records consist of known rows: which of them changed places, none can say.

    A table without a number of values may be a shorter one.
    """
    known = acceleration * np.concatenate([split_rows(values, row) for values in known])
    for record in records:
        rows = split_rows(np.asarray(record.acceleration), row)
        near = np.isclose(rows[:, None], known, rtol=1e-9, atol=0, equal_nan=True)
        if not near.all(axis=-1).any(axis=1).all():
            return False
        if not abs(float(record.time_step) / (time * step) - 1) < 1e-3:
            return False
        if whole and record.samples != samples:
            return False
    return True


def split_rows(values, row):
    """Split values into rows, the last of which is filled with NaN."""
    return np.append(values, [np.nan] * (-len(values) % row)).reshape(-1, row)


def match_run(right, step, records, *, acceleration=1.0, time=1.0):
    """Return whether a record is the right one, or a part of it without gaps."""
    (record,) = records
    values = np.asarray(record.acceleration)
    right = acceleration * right
    first = int(np.argmin(np.abs(right - values[0])))
    right = right[first : first + values.size]
    fits = right.size == values.size and np.allclose(values, right, rtol=1e-9)
    return fits and abs(float(record.time_step) / (time * step) - 1) < 1e-3


PEER_VALUES = 1e-3 * np.array([1.5, -2, 3, -4.25, 5, -6, 7, -8, 9, -10, 11, -12.5, 13])
PEER_ROWS = ["".join(f"{value:15.7E}" for value in PEER_VALUES[k : k + 5]) for k in (0, 5, 10)]
PEER = (
    "PEER NGA STRONG MOTION DATABASE RECORD\nDuzce, 11/12/1999, Lamont 1061, 090\n"
    "ACCELERATION TIME SERIES IN UNITS OF G\nNPTS=  13, DT=   .0100 SEC\n"
    + "\n".join(PEER_ROWS)
    + "\n"
)


def make_at2():
    right = G * PEER_VALUES
    return Kind(
        "a.AT2",
        PEER,
        read_one,
        partial(match_rows, [right], 0.01, right.size, 1, True),
        (
            ("UNITS OF G", "UNITS OF CM/S2", "acceleration", GAL / G),
            ("UNITS OF G", "UNITS OF CM", "acceleration", REFUSED),
            ("ACCELERATION", "VELOCITY", "acceleration", REFUSED),
            ("ACCELERATION TIME SERIES", "SPECTRAL ACCELERATION", "acceleration", REFUSED),
            (".0100 SEC", ".0100 MSEC", "time", 1e-3),
        ),
    )


SAMPLES = np.random.default_rng(2).normal(size=40).round(6)
SECONDS = 0.01 * np.arange(40)
PRINTED = [f"{t:.2f},{value:.6f}" for t, value in zip(SECONDS, SAMPLES, strict=True)]
SCIENTIFIC = [f"{t:.18e},{value:.18e}" for t, value in zip(SECONDS, SAMPLES, strict=True)]
TABLES = {
    "csv": "# a station, 1999\ntime [s],acc_g\n" + "\n".join(PRINTED) + "\n",
    "numpy": "# a station, 1999\n# time,acc_g\n" + "\n".join(SCIENTIFIC) + "\n",
    "tabs": ("time,acc_g\n" + "\n".join(PRINTED) + "\n").replace(",", "\t"),
    "sep": "sep=,\ntime,acc_g\n" + "\n".join(PRINTED) + "\n",
}


def make_table(layout):
    content = TABLES[layout]
    statements = (
        ("acc_g", "acc_gal", "acceleration", GAL / G),
        ("acc_g", "acc_mm", "acceleration", REFUSED),
        ("acc_g", "Sa_g", "acceleration", REFUSED),
        ("time [s]", "time [ms]", "time", 1e-3),
        ("time", "frequency", "time", REFUSED),
        ("a station, 1999", "sampling rate 50 Hz", "time", REFUSED),
        ("a station, 1999", "Fs = 50 Hz", "time", REFUSED),
        ("a station, 1999", "response spectrum", "acceleration", REFUSED),
    )
    return Kind(
        "a.csv",
        content,
        read_one,
        partial(match_run, G * SAMPLES, 0.01),
        tuple(row for row in statements if row[0] in content),
    )


def make_plain():
    values = np.random.default_rng(3).normal(size=40).round(6)
    numbers = "".join(f"{value:.6f}\n" for value in values)
    return Kind(
        "a.csv",
        "# Time step: 0.01 s\n" + numbers,
        partial(read_one, unit="g", time_step=0.01),
        partial(match_rows, [G * values], 0.01, 40, 1, False),
        (
            ("Time step: 0.01 s", "Time step: 0.005 s", "time", REFUSED),
            ("# Time step: 0.01 s", "Time step: 0.005 s", "time", REFUSED),
            ("Time step: 0.01 s", "fs = 200", "time", REFUSED),
            ("Time step: 0.01 s", "dt = 10 ms", "time", 1),
            ("Time step: 0.01 s", "Accelerations in gal", "acceleration", REFUSED),
            ("Time step: 0.01 s", "Velocities in cm/s", "acceleration", REFUSED),
            # Without this sample all that follow would come too early.
            (f"{values[20]:.6f}", f"# {values[20]:.6f}", "acceleration", REFUSED),
        ),
    )


def make_esm():
    right = test_esm.EAST * GAL
    return Kind(
        test_esm.NAME,
        test_esm.write(),
        read_one,
        partial(match_rows, [right], 0.005, right.size, 1, True),
        (
            ("UNITS: cm/s^2", "UNITS: m/s^2", "acceleration", 100),
            ("UNITS: cm/s^2", "UNITS: cm/s", "acceleration", REFUSED),
            ("TYPE: ACC", "TYPE: VELOCITY OR ACC", "acceleration", REFUSED),
            ("INTERVAL_S: 0.005", "INTERVAL_S: 0.01", "time", REFUSED),
        ),
    )


def make_broadband():
    """A file of SCEC's Broadband Platform: names by blanks, rows by tabs."""
    values = np.random.default_rng(4).normal(0, 30, (3, 40))
    rows = [
        "\t".join([f"{0.02 * k:.6e}", *(f"{value:.6e}" for value in row)])
        for k, row in enumerate(values.T)
    ]
    head = (
        "# Sim stat=S01\n#    time(sec)      N-S(cm/s/s)      E-W(cm/s/s)      U-D(cm/s/s)\n"
    )
    known = [np.array([GAL * float(f"{value:.6e}") for value in row]) for row in values]

    return Kind(
        "s01.acc.bbp",
        head + "".join(row + "\n" for row in rows),
        partial(read_columns, ["NS", "EW", "up"]),
        partial(match_rows, known, 0.02, 40, 1, False),
        (
            ("(cm/s/s)", "(g)", "acceleration", G / GAL),
            ("(cm/s/s)", "(cm/s)", "acceleration", REFUSED),
            ("(cm/s/s)", "(cm)", "acceleration", REFUSED),
            ("time(sec)", "time(ms)", "time", 1e-3),
            ("time(sec)", "freq(Hz)", "time", REFUSED),
            ("Sim stat=S01", "sampling rate 200 Hz", "time", REFUSED),
        ),
    )


def make_cosmos():
    known = [
        GAL * values
        for values in (
            test_cosmos.NORTH,
            test_cosmos.NORTH[:20],
            test_cosmos.EAST,
            test_cosmos.UP,
        )
    ]
    return Kind(
        "made.V2c",
        test_cosmos.STATION,
        partial(read_columns, ["90", "360", "up"]),
        partial(match_rows, known, test_cosmos.STEP, test_cosmos.POINTS, 8, True),
        (
            ("units=cm/sec2", "units=g", "acceleration", REFUSED),
            ("units=cm/sec2 (4)", "units=g (2)", "acceleration", REFUSED),
            ("units=cm/sec2 (4)", "units=counts (50)", "acceleration", REFUSED),
        ),
    )


def make_csmip(volume):
    if volume == 1:
        known = [G * values for values in (test_csmip.EAST, test_csmip.NORTH, test_csmip.UP)]
        statements = (
            ("in units of g.", "in units of cm/sec2.", "acceleration", GAL / G),
            ("in units of g.", "in units of g/10.", "acceleration", 0.1),
            ("at 100 pts/sec", "at 200 pts/sec", "time", REFUSED),
        )
    else:
        motions = test_csmip.WEAK, test_csmip.STRONG, test_csmip.RISING
        # Velocities and displacements are in the file as well.
        known = [GAL * np.round(values / by, 5) for values in motions for by in (1, 100, 1000)]
        statements = (
            ("in cm/sec2.", "in g.", "acceleration", G / GAL),
            ("in cm/sec2.", "in cm/sec.", "acceleration", REFUSED),
            ("at  .010 sec", "at  .020 sec", "time", REFUSED),
        )
    return Kind(
        "made.v2",
        [test_csmip.VOLUME_1, test_csmip.VOLUME_2][volume - 1],
        partial(read_columns, ["90", "360", "up"]),
        partial(match_rows, known, test_csmip.STEP, test_csmip.POINTS, 8, True),
        statements,
    )


def make_geonet():
    known = [test_geonet.ALONG, test_geonet.ACROSS, test_geonet.UP, test_geonet.OTHERS]
    return Kind(
        "made.V2A",
        test_geonet.V2A,
        partial(read_columns, ["N28W", "S62W", "up"]),
        partial(
            match_rows,
            [1e-3 * values for values in known],
            test_geonet.STEP,
            test_geonet.POINTS,
            10,
            True,
        ),
        (
            ("mm/s/s", "cm/s/s", "acceleration", 10),
            ("mm/s/s", "mm/s", "acceleration", REFUSED),
            ("at 0.020 sec", "at 0.010 sec", "time", REFUSED),
        ),
    )


def make_smc():
    right = test_smc.NORTH * GAL
    return Kind(
        "a.smc",
        test_smc.write(),
        read_one,
        partial(match_rows, [right], 0.005, right.size, 1, True),
        (
            ("CORRECTED ACCELEROGRAM", "VELOCITY", "acceleration", REFUSED),
            ("CORRECTED ACCELEROGRAM", "RESPONSE SPECTRUM", "acceleration", REFUSED),
            ("|ref - A. Author", "|acceleration in g", "acceleration", REFUSED),
        ),
    )


def make_knet():
    # Obspy is not there everywhere: then only this kind is left out.
    import test_obspy

    right = test_obspy.COUNTS * test_obspy.KNET_FACTOR
    return Kind(
        "a.ew",
        test_obspy.knet(),
        read_one,
        partial(match_rows, [right], 0.01, right.size, 1, True),
        (
            ("(gal)/", "(g)/", "acceleration", REFUSED),
            ("100Hz", "200Hz", "time", REFUSED),
            ("Dir.              E-W", "Dir.              U-D", "acceleration", REFUSED),
        ),
    )


RETURN_PERIODS = (
    "# a site\nreturn period [yr],PGA [g],PGV [cm/s]\n"
    "10.50,0.0250,2.10\n100.00,0.0880,8.00\n475.00,0.1900,16.50\n2475.00,0.4100,40.10\n"
)
PERIODS = np.array([[0.025, 1 / 10.5], [0.088, 0.01], [0.19, 1 / 475], [0.41, 1 / 2475]])
HAZARDS = {
    "rates": "pgv [m/s],rate [1/yr]\n0.10,2.00e-02\n0.30,2.00e-03\n1.00,2.00e-03\n3.00,0\n",
    "periods": RETURN_PERIODS,
    "openquake": NEWER,
    "sites": SITES,
    "usgs": NSHMP,
}
RIGHT = {
    "rates": np.array([[0.1, 2e-2], [0.3, 2e-3], [1, 2e-3], [3, 0]]),
    "periods": PERIODS * [G, 1],
    "openquake": POINTS,
    "usgs": np.transpose([G * LEVELS, [2.8528077e-3, 2.8528077e-3, 1.5e-3, 1e-4, 0.0]]),
}
RIGHT["sites"] = RIGHT["openquake"]
OPTIONS = {
    "periods": {"measure": "pga"},
    "sites": {"site": (-122.4, 37.75)},
    "usgs": {"measure": "pga", "unit": "g"},
}


def make_hazard(layout, name="hazard.csv", statements=()):
    right = RIGHT[layout]
    options = OPTIONS.get(layout, {})

    def same(hazard, *, level=1.0, rate=1.0):
        # A table that lost whole lines is a shorter curve, of the same points.
        points = np.transpose([hazard.levels, hazard.rates])
        near = np.isclose(points[:, None], right * [level, rate], rtol=1e-9, atol=0)
        shorter = layout in ("rates", "periods") or len(points) == len(right)
        return shorter and near.all(axis=-1).any(axis=1).all()

    content = HAZARDS[layout]
    return Kind(name, content, lambda path: jr.read_hazard(path, **options), same, statements)


def make_openquake(layout):
    statements = (
        ("imt='PGA'", "imt='PGV'", "level", GAL / G),
        ("imt='PGA'", "imt='SA(0.1)'", "level", REFUSED),
        ("kind='mean'", "kind='std'", "rate", REFUSED),
        ("time=50.0", "time=1.0", "rate", 50),
    )
    return make_hazard(layout, "hazard_curve.csv", statements)


def make_rates():
    statements = (
        ("pgv [m/s]", "pgv [cm/s]", "level", 0.01),
        ("pgv [m/s]", "pgv [m/s2]", "level", REFUSED),
        ("pgv [m/s]", "Sa [m/s2]", "level", REFUSED),
        ("rate [1/yr]", "standard deviation of rate [1/yr]", "rate", REFUSED),
        ("pgv [m/s]", "# standard deviations\npgv [m/s]", "rate", REFUSED),
    )
    return make_hazard("rates", statements=statements)


def make_periods():
    statements = (
        ("PGA [g]", "PGA [cm/s2]", "level", GAL / G),
        ("PGA [g]", "Sa [g]", "level", REFUSED),
        ("period [yr]", "period [s]", "rate", REFUSED),
        ("a site", "spectral accelerations", "level", REFUSED),
    )
    return make_hazard("periods", statements=statements[:3])


def make_inventory():
    content = (
        "# a museum\nname,width [cm],height [m],restitution\n"
        "vase,20.25,0.615,0.81\nbust of a man,30.50,0.925,0.82\nchest,61.00,1.250,0.83\n"
    )
    right = np.array([[0.2025, 0.615, 0.81], [0.305, 0.925, 0.82], [0.61, 1.25, 0.83]])

    def same(inventory, *, width=1.0, height=1.0):
        block = inventory.block
        sizes = 2 * block.half_width, 2 * block.half_height, inventory.restitution
        rows = np.transpose([np.broadcast_to(size, len(inventory.names)) for size in sizes])
        near = np.isclose(rows[:, None], right * [width, height, 1], rtol=1e-9, atol=0)
        # Of a single row nothing shows that its last number was cut.
        numbers = 2 if len(rows) == 1 else 3
        return len(rows) <= len(right) and near[..., :numbers].all(axis=-1).any(axis=1).all()

    statements = (
        ("width [cm]", "width [mm]", "width", 0.1),
        ("width [cm]", "half width [cm]", "width", REFUSED),
        ("width [cm]", "width [g]", "width", REFUSED),
        ("height [m]", "weight [kg]", "height", REFUSED),
        ("height [m]", "height [cm]", "height", 0.01),
        ("0.83\n", "0.83\nTotal,111.75,2.790,0.82\n", "height", REFUSED),
    )
    return Kind("objects.csv", content, jr.risk.read_inventory, same, statements)


DEGREE = np.pi / 180
IMPACT_TIMES = np.array([0.5123, 1.4471, 2.2310, 2.9014, 3.4875])
PEAKS = np.array([9.1234, 7.5012, 6.2345, 5.1876])  # [deg]
COLUMNS = [[f"{t:.4f}" for t in IMPACT_TIMES], [f"{p:.4f}" for p in PEAKS] + [""]]
MILLISECONDS = [f"{1000 * t:.1f}" for t in IMPACT_TIMES]
IMPACTS = {
    "times": ["time [s]", *COLUMNS[0]],
    "without names": COLUMNS[0],
    "peaks": ["time [s],peak rotation [deg]", *map(",".join, zip(*COLUMNS, strict=True))],
    "counter": [
        "# a test of a cabinet",
        "impact,time [ms],velocity [m/s],peak rotation [deg],notes",
        *(
            f"{n},{t},{0.5 - 0.1 * n:.2f},{p},{'phone, moved'[:5]}"
            for n, t, p in zip(range(5), MILLISECONDS, COLUMNS[1], strict=True)
        ),
    ],
    "tabs": [
        "No.\ttime [ms]\tpeak [deg]",
        *map("\t".join, zip("12345", MILLISECONDS, COLUMNS[1], strict=True)),
    ],
    "semicolons": [
        "sep=;",
        "peak [deg];time [s]",
        *map(";".join, zip(*COLUMNS[::-1], strict=True)),
    ],
}


def make_impacts(layout):
    content = "".join(line + "\n" for line in IMPACTS[layout])

    def same(measurements, *, time=1.0, rotation=1.0):
        # A table that lost a line has the same times and peaks, as it would of a missed impact.
        times, peaks = measurements
        right = time * IMPACT_TIMES
        at = abs(times[:, None] - right).argmin(axis=1)
        if not np.allclose(times, right[at], rtol=1e-12) or len(np.unique(at)) < len(at):
            return False
        if peaks is None:
            return layout in ("times", "without names")
        expected = rotation * np.append(PEAKS, np.nan)[at[:-1]] * DEGREE
        return np.isclose(peaks, expected, rtol=1e-12, atol=0).all()

    statements = (
        ("time [s]", "time [ms]", "time", 1e-3),
        ("time [ms]", "time [s]", "time", 1e3),
        ("time [", "interval [", "time", REFUSED),
        ("[deg]", "[mm]", "rotation", REFUSED),
        ("[deg]", "[mrad]", "rotation", 1e-3 / DEGREE),
        ("a test of a cabinet", "rotations in radians", "rotation", REFUSED),
    )
    statements = tuple(row for row in statements if row[0] in content)
    return Kind("times.csv", content, read_impact_times, same, statements)


TESTS = (
    "# a shaking table\nfile,unit,time step [ms],overturned,peak rotation [deg],earthquake,scale\n"
    "a.csv,gal,5.0,no,4.50,Kobe,1.250\na.csv,gal,5.0,yes,,Kobe,-2.500\n"
    "a.csv,gal,5.0,no,7.25,Izmit,0.750\na.csv,gal,5.0,yes,,Izmit,3.125\n"
)
# Factor, peak [deg] and outcome.
RIGHT_TESTS = np.array([[1.25, 4.5, 0], [-2.5, -1, 1], [0.75, 7.25, 0], [3.125, -1, 1]])


def read_one_fault(path):
    """Read a table of tests beside its motion; of several faults, the first."""
    (path.parent / "a.csv").write_text("acc\n0.5\n1.0\n-2.5\n")
    try:
        return read_tests(path)
    except ValueError as error:
        raise ValueError(str(error).split("\n")[0]) from None


def make_tests():
    def same(tests, *, acceleration=1.0, time=1.0, rotation=1.0):
        # A table that lost a line has fewer tests.
        factors = [float(record.scale * record.acceleration[1]) for record in tests.suite]
        steps = [float(record.time_step) for record in tests.suite]
        peaks = np.full(len(factors), np.nan)
        if tests.peak_rotations is not None:
            peaks = np.asarray(tests.peak_rotations)
        rows = np.transpose([factors, np.nan_to_num(peaks, nan=-1), tests.overturned])
        right = RIGHT_TESTS * [acceleration * GAL, rotation * DEGREE, 1]
        right[:, 1] = np.where(RIGHT_TESTS[:, 1] < 0, -1, right[:, 1])
        near = np.isclose(rows[:, None], right, rtol=1e-9).all(axis=-1).any(axis=1)
        return near.all() and np.allclose(steps, 0.005 * time, rtol=1e-9)

    statements = (
        (",gal,", ",g,", "acceleration", G / GAL),
        (",gal,", ",cm,", "acceleration", REFUSED),
        ("[ms]", "[s]", "time", 1e3),
        ("time step", "time", "time", REFUSED),
        ("[deg]", "[mrad]", "rotation", 1e-3 / DEGREE),
        ("peak", "mean", "rotation", REFUSED),
        ("scale", "weight", "acceleration", REFUSED),
        (",yes,", ",perhaps,", "acceleration", REFUSED),
        ("Izmit,0.750", ",0.750", "acceleration", REFUSED),
    )
    return Kind("tests.csv", TESTS, read_one_fault, same, statements)


KINDS = {
    "AT2": make_at2,
    "plain numbers": make_plain,
    "ESM": make_esm,
    "Broadband Platform": make_broadband,
    "COSMOS": make_cosmos,
    "CSMIP volume 1": partial(make_csmip, 1),
    "CSMIP volume 2": partial(make_csmip, 2),
    "GeoNet": make_geonet,
    "SMC": make_smc,
    "K-NET": make_knet,
    "hazard by rates": make_rates,
    "hazard by return periods": make_periods,
    "OpenQuake": partial(make_openquake, "openquake"),
    "OpenQuake, two sites": partial(make_openquake, "sites"),
    "nshmp-haz": partial(make_hazard, "usgs"),
    "inventory": make_inventory,
    "tests": make_tests,
}
KINDS |= {f"table, {layout}": partial(make_table, layout) for layout in TABLES}
KINDS |= {f"impacts, {layout}": partial(make_impacts, layout) for layout in IMPACTS}


# A size in another unit is as small as no object is, which is said and not refused.
@pytest.mark.filterwarnings("ignore:.*if another unit was meant")
@pytest.mark.parametrize("number", [60, pytest.param(300, marks=pytest.mark.thorough)])
@pytest.mark.parametrize("kind", KINDS)
def test_mutations(tmp_path, kind, number):
    name, content, read, same, statements = KINDS[kind]()
    content = content if isinstance(content, bytes) else content.encode()
    path = Path(tmp_path / name)
    path.write_bytes(content)
    assert same(read(path))
    faults, counts = read_mutations(content, path, read, same, number, statements=statements)
    assert not faults, (len(faults), faults[:3])
    assert min(counts.values()) > number / 20, counts
