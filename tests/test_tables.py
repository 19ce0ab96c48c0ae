"""Heads of columns, units, statements in text and layouts of tables: one table of cases each."""

import math

import pytest

from jaxrock.tables import (
    find_contents,
    find_steps,
    find_units,
    parse_unit,
    read_head,
    read_table,
)

G = 9.80665
NONE = math.nan
# Spellings, what they measure, and the value in SI.
UNITS = [
    ("m/s2, M / sec^2, m s^{-2}, m/(s^2), m/s/s, m/s*s, mps2, ms-2, m_s2", "acceleration", 1),
    (
        "cm/s2, cm/sec/sec, cm_s_2, cmss, gal, Gals, centimetres per second squared",
        "acceleration",
        0.01,
    ),
    ("nm/s**2", "acceleration", 1e-9),
    ("in/s2", "acceleration", 0.0254),
    ("g, G, g's", "acceleration", G),
    ("%g, % g, pct g, percent of g", "acceleration", G / 100),
    ("mg, milli-g", "acceleration", G / 1000),
    ("cm/s, cm/sec, cm s-1, cm_s", "velocity", 0.01),
    ("g s", "velocity", G),
    ("mm, millimetres", "length", 0.001),
    ("in, inches", "length", 0.0254),
    ("ms, msec, milliseconds", "time", 0.001),
    ("deg, degrees, \u00b0", "angle", math.pi / 180),
    ("deg/s", "angular velocity", math.pi / 180),
    ("1/yr, 1 / year, per year, 1/a", "rate", 1),
    ("yr, years", "years", 1),
    ("kN", "force", 1000),
    ("V, volts", "voltage", 1),
    ("\u00b5\u03b5, microstrain", "strain", 1e-6),
    ("m/s3, V/g, g^2, kg m/s2", "other", None),
    ("foo, [, m foo, 10 g, 1e-3 g, g/10, ", "", NONE),
]


@pytest.mark.parametrize(("spellings", "dimension", "factor"), UNITS)
def test_units(spellings, dimension, factor):
    for spelling in spellings.split(", "):
        unit = parse_unit(spelling)
        assert unit.dimension == dimension, spelling
        if factor is not None:
            assert unit.factor == pytest.approx(factor, rel=1e-15, nan_ok=True), spelling


# Names of columns, their quantity, and the value of the unit: None for no unit, NaN for one that
# is not understood or does not fit.
HEADS = [
    ("acc, a, accX, x-acc, acc (corrected), acc (N)", "acceleration", None),
    (
        "acc_g, acc [g], acc_g_x, a / g, T [g], top (g), acc (N) [g], G, SE [g]",
        "acceleration",
        G,
    ),
    ("acc [cm/s^2], acc_cm_s2, ns / (cm/s2), acc (cm/(s^2))", "acceleration", 0.01),
    (
        "acc [foo], acc (foo), acc [V/g], acc_counts, acc %, acc_rad, acc [1e-3 g]",
        "acceleration",
        NONE,
    ),
    ("A1, 090, up, HNE, E-W, #", "", None),
    ("time, t, Elapsed time, time of the impact, sec", "time", None),
    ("time_s, T (sec), Zeit [s], time/s, t [s], time since trigger [s.]", "time", 1),
    ("time [ms], time_ms, impact time [ms]", "time", 0.001),
    ("time [g]", "time", NONE),
    ("dt [ms], S-P delay [ms]", "duration", 0.001),
    ("time step [ms], time_step_ms, sampling interval (ms)", "time step", 0.001),
    ("file, File name, motion_file", "file", None),
    ("unit, unit of acceleration", "unit", None),
    ("overturned, Outcome", "overturned", None),
    ("group, earthquake, EVENT", "group", None),
    ("scale, scale factor, factor", "scale", None),
    ("Period, frequency, natural period", "period", None),
    ("Sa (g), PSA [g], Spectral acceleration (g), SaRotD50_g", "spectral acceleration", G),
    ("Se, Se(T), PSA, FAS, pseudo-acc", "spectral acceleration", None),
    ("LVDT1 [mm], x [mm], stroke_mm", "displacement", 0.001),
    ("disp, displacement, TableDisp", "displacement", None),
    ("d (in)", "displacement", 0.0254),
    ("phi [deg], table rotation (deg)", "rotation", math.pi / 180),
    ("tilt_deg, peak rotation [deg]", "peak rotation", math.pi / 180),
    ("wz [rad/s]", "rotation", 1),
    ("vel [cm/s], v [cm/s], vel_cm_s", "velocity", 0.01),
    ("ch1 [V]", "voltage", 1),
    ("load (kN), F (kN)", "force", 1000),
    ("weight [g], mass (g)", "mass", NONE),
    ("pga [g], PGA (g), peak ground acceleration [g]", "pga", G),
    ("pgv [m/s], pgv_m/s", "pgv", 1),
    ("width [cm], width_cm, width / cm", "width", 0.01),
    ("height m, height (m), height_m", "height", 1),
]


@pytest.mark.parametrize(("names", "quantity", "factor"), HEADS)
def test_heads(names, quantity, factor):
    for name in names.split(", "):
        head = read_head(name)
        assert head.quantity == quantity, name
        if factor is None:
            assert head.units == (), name
        else:
            assert head.unit.factor == pytest.approx(factor, rel=1e-15, nan_ok=True), name


STEPS = {
    0.005: [
        "Time Step: 0.005", "dt = 5 ms", "dt [ms] = 5", "fs = 200", "# f_s: 200 Hz", "# 200 Hz",
        "sampled at 200 Hz", "sampling at 5 ms", "SAMPLING FREQ. 200", "Rate (Hz): 200",
        "acquisition rate 200", "samples per second: 200", "sps 200", "SPS=200", "# step 0.005",
        "delta 0.005", "\u0394t = 0.005 s", "interval 5 ms", "intervals of 0.005", "5 ms steps",
        "0.005 s per sample", "Sample rate,200", "acc (dt=0.005s)", "200 samples/s",
    ],
    None: [
        "4 Hz low-pass", "samples 200 to 400", "interpolated onto 0.004 s", "shear rate 20",
        "45.00 s cut from 65.00 s", "samples per second; 60.00 s", "frequency 200 Hz",
    ],
}  # fmt: skip


@pytest.mark.parametrize("step", STEPS)
def test_steps_in_text(step):
    for line in STEPS[step]:
        values = sorted({round(value, 12) for _, value in find_steps(line)})
        assert values == ([] if step is None else [step]), line


@pytest.mark.parametrize(
    ("line", "values"),
    [
        ("UNITS: s, cm/s2", [0.01]),
        ("Units,m/s2", [1]),
        ("# gal", [0.01]),
        ("# in counts", [NONE]),
        ("units of volts", [NONE]),
        ("acc. in m s^-2, PGA 0.3 g", [1]),
        ("a weaker burst below 0.09 g left out", []),
    ],
)
def test_units_in_text(line, values):
    found = [value for _, value in find_units(line)]
    assert found == pytest.approx(values, nan_ok=True)


@pytest.mark.parametrize(
    ("lines", "other"),
    [
        (["VELOCITY TIME SERIES"], "velocity time"),
        (["displacement in mm"], "displacement"),
        (["SPECTRAL ACCELERATION IN UNITS OF G"], "spectral acceleration"),
        (["acceleration", "response spectrum, 5 % damping"], "response spectrum"),
        (["acceleration matched to the target spectrum"], None),
        (["ACCELERATION; VELOCITY OF SHEAR WAVES 300 M/S"], None),
    ],
)
def test_what_text_says_of_the_values(lines, other):
    contents = find_contents([*enumerate(lines, 1)])
    assert (contents and contents[1]) == other


ROWS = "0,1\n0.5,-2.5\n"
# Content; names of columns, the line they stand in, and the first row.
LAYOUTS = [
    ("time,acc\n" + ROWS, ["time", "acc"], 1, ["0", "1"]),
    ("# time,acc\n" + ROWS, ["time", "acc"], 1, ["0", "1"]),
    ("# in Italy, 1980\n#time [s], acc\n" + ROWS, ["time [s]", "acc"], 2, ["0", "1"]),
    ("\ufeffsep=;\na;b c\n1,5;2\n", ["a", "b c"], 2, ["1,5", "2"]),
    ("Hall 3, Rome\nname,width,height\nx,2,3\n", ["name", "width", "height"], 2, ["x", "2", "3"]),
    ("Hall 3;;\nname;width\nx, y;2,5\n", ["name", "width"], 2, ["x, y", "2,5"]),
    ("time,acc\ns,g\n" + ROWS, ["time [s]", "acc [g]"], 1, ["0", "1"]),
    ('"time\n[s]","acc\n[g]"\n' + ROWS, ["time [s]", "acc [g]"], 1, ["0", "1"]),
    ("Sample rate,2\ntime,acc\n" + ROWS, ["time", "acc"], 2, ["0", "1"]),
    ("time acc\n  0   1\n", ["time", "acc"], 1, ["0", "1"]),
    ("a\tb,c\n1\t2,5\n", ["a", "b,c"], 1, ["1", "2,5"]),
    ("dt = 0.01\n0.5\n0.7\n", ["column 1"], 2, ["0.5"]),
    ("acc\nx\n0.7\n", ["acc"], 1, ["x"]),
    ("a,b,,\n1,2,,\n", ["a", "b"], 1, ["1", "2"]),
    (ROWS, [], 1, ["0", "1"]),
]  # fmt: skip


@pytest.mark.parametrize("code", ["utf-8", "utf-16", "utf-8-sig"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_layouts(tmp_path, code, end):
    path = tmp_path / "a.csv"
    for content, names, line, cells in LAYOUTS:
        path.write_bytes(content.removeprefix("\ufeff").replace("\n", end).encode(code))
        table = read_table(path)
        assert (table.names, table.line, table.rows[0].cells) == (names, line, cells), content


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("# a\n# b\n", "a line with the names of the columns was expected, all lines are"),
        ("Hall 3\n" + ROWS, "line 2: names of the columns were expected above '0,1'"),
        (
            "a;b\n1,5;2.5\n",
            "line 2: decimals must all stand behind points or all behind commas",
        ),
        (
            "a;b\n1,500;2\n",
            "line 2: '1,500' may be a number with decimals, or one of thousands",
        ),
        ("a,b\n1,2\n3,4,5\n", "line 3: 2 fields separated by commas were expected, got 3"),
        ('a,b\n1,2\n"3,4\n', "line 3: a quote in this line does not end"),
        (
            "a,b\n1.25,2.25\n3.25,4.2",
            "line 3: the file looks truncated: its last number '4.2'",
        ),
        (b"a,b\n\0", "a text file was expected, this one is binary"),
        (b"", "the file is empty"),
    ],
)
def test_tables_that_are_refused(tmp_path, content, message):
    path = tmp_path / "a.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())

    def read():
        table = read_table(path)
        return table.read_samples(range(len(table.heads)))

    with pytest.raises(ValueError, match=r"a\.csv'") as error:
        read()
    assert message in str(error.value)
