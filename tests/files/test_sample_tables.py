"""Tables of samples as programs write them: heads, separators, digits, and files cut short."""

import numpy as np
import pytest

import jaxrock as jr

G = 9.80665


@pytest.fixture
def read(tmp_path):
    def from_text(content, name="a.csv", **options):
        path = tmp_path / name
        path.write_text(content)
        return jr.read_record(path, **options)

    return from_text


ROWS = "0,1\n0.5,-2.5\n1,0.25\n"


HEADS_AND_SEPARATORS = [
    "time,acc_g\n" + ROWS,
    "# time,acc_g\n" + ROWS,
    "# a station, in Italy\n#time [s], acc [g]\n" + ROWS,
    "# time,acc_g\n\n\n" + ROWS,
    "time,acc_g\n\n \n" + ROWS,
    "sep=,\ntime,acc_g\n" + ROWS,
    '"sep=,"\r\ntime,acc_g\r\n' + ROWS,
    "SEP=,\n# time,acc_g\n" + ROWS,
    ("time,acc_g\n" + ROWS).replace(",", "\t"),
    ("# time [s],acc [g]\n" + ROWS).replace(",", "\t"),
    "sep=\t\n" + ("time,acc_g\n" + ROWS).replace(",", "\t"),
    ("time,acc_g\n" + ROWS).replace(",", ",\t"),
    "time,acc_g\n0,1.0D+00\n.5d0,-25.0d-1\n1.0D0,2.5D-01\n",
    "sep=;\ntime;acc_g\n0;1\n0.5;-2.5\n1;0.25\n",
    "sep=|\ntime|acc_g\n0|1\n0.5|-2.5\n1|0.25\n",
    "time;acc_g\n0;1\n0,5;-2,5\n1;0,25\n",
    "time\tacc_g\n0\t1,0\n0,5\t-2,5\n1\t0,25\n",
    'time,acc_g\n0,1\n"0,5","-2,5"\n1,"0,25"\n',
    "time acc_g\n 0.0  1.0\n 0.5 -2.5\n 1.0  0.25\n",
    "Shaking table, test 3\ntime,acc_g\n" + ROWS,
    "Sample rate,2\nUnits,g\ntime,acc\n" + ROWS,
    "time,acc\n[s],[g]\n" + ROWS,
    '"time\n[s]","acc\n[g]"\n' + ROWS,
    "time,acc_g,\n0,1,\n0.5,-2.5,\n1,0.25,\n",
    "time,acc_g\n0,1.0D+00\n0.5,-2.5\n1,.25\n",
]  # fmt: skip


@pytest.mark.parametrize("content", HEADS_AND_SEPARATORS)
def test_heads_and_separators(read, content):
    record = read(content)
    np.testing.assert_allclose(record.acceleration, G * np.array([1, -2.5, 0.25]), rtol=1e-6)
    assert float(record.time_step) == 0.5


TABLES_THAT_ARE_REFUSED = [
    (ROWS, "line 1: names of the columns were expected, got '0,1'"),
    ("# accelerations, in g\n" + ROWS, "line 2: names of the columns were expected"),
    ("# time,acc_g,up_g\n" + ROWS, "line 2: names of the columns were expected"),
    ("# 0.0,acc_g\n" + ROWS, "line 2: names of the columns were expected"),
    ("# time,acc_g\n# of a station\n" + ROWS, "line 3: names of the columns were"),
    ("time;acc_g\n0;1,5\n1;2.5\n",
     "line 3: decimals must all stand behind points or all behind commas, got '1,5'"),
    ("time;acc_g\n0;1,500\n1;2,500\n", "line 2: '1,500' may be a number with decimals"),
    ("time\tacc_g\n0\t1\n1\n2\t3\n", "line 3: 2 fields separated by tabs were expected, got 1"),
    ("time,acc_g\n0,1\n\n1,2\n", "line 3: 2 fields separated by commas were expected"),
    ("time,acc_g\n0,1.0-02\n1,2\n", "line 2: column 'acc_g' must be a number, got '1.0-02'"),
    ("# multiply by 9.81\ntime,acc_g\n" + ROWS, "line 1: accelerations in their unit were"),
    ("time,acc_g\n0,1\n#0.5,2\n1,2\n", "line 3: '#0.5,2' is a comment, but looks like a"),
    ("time,acc_g\n0,1\n# x\n1,2\n", "line 3: samples were expected up to the end, got a"),
    ("time,acc_g\n0,1.0D\n1,2\n", "line 2: column 'acc_g' must be a number, got '1.0D'"),
    ("time,acc_g\n0,1.0D999\n1,2\n", "line 2: column 'acc_g' must be finite"),
]  # fmt: skip


@pytest.mark.parametrize(("content", "message"), TABLES_THAT_ARE_REFUSED)
def test_tables_that_are_refused(read, content, message):
    with pytest.raises(ValueError, match=r"a\.csv', ") as caught:
        read(content)
    assert message in str(caught.value)


LETTERS = "time [s],N [g],E [g],up [g],down [g],b [g]\n0,1,2,3,4,5\n.5,6,7,8,9,0\n"


@pytest.mark.parametrize(
    ("options", "right"),
    [
        ({"vertical": "up [g]"}, (1, 3)),
        ({"vertical": "up"}, (1, 3)),
        ({"vertical": "b [g]"}, (1, 5)),
        ({"column": "b [g]", "vertical": "up"}, (5, 3)),
        ({"column": "up [g]"}, (3, None)),
        ({"column": "down"}, (4, None)),
    ],
)
def test_columns_by_where_they_point(read, options, right):
    record = read(LETTERS, **{"column": "N [g]", **options})
    assert float(record.acceleration[0]) == pytest.approx(G * right[0])
    assert (record.vertical is None) == (right[1] is None)
    if right[1] is not None:
        assert float(record.vertical[0]) == pytest.approx(G * right[1])


COLUMNS_THAT_POINT_ELSEWHERE = [
    (LETTERS, {"vertical": "down [g]"}, "'down [g]' points downward"),
    (LETTERS, {"vertical": "down"}, "'down [g]' points downward"),
    (LETTERS, {"vertical": "E [g]"}, "'E [g]' is horizontal, a vertical component was"),
    (LETTERS.replace("E [", "HNE ["), {"vertical": "HNE [g]"}, "'HNE [g]' is horizontal"),
    (LETTERS.replace("b [", "Z ["), {"vertical": "up"},
     "line 1: one column that points up was expected, got 'up [g]', 'Z [g]'"),
    ("time,N [g],E [g]\n0,1,2\n.5,3,4\n", {"vertical": "up"},
     "line 1: one column that points up was expected, got none"),
    ("time,up [g]\n0,1\n.5,2\n", {"column": None},
     "line 1: no component is horizontal; column names a vertical one: 'up [g]'"),
]  # fmt: skip


@pytest.mark.parametrize(("content", "options", "message"), COLUMNS_THAT_POINT_ELSEWHERE)
def test_columns_that_point_elsewhere(read, content, options, message):
    with pytest.raises(ValueError, match=r"a\.csv', ") as caught:
        read(content, **{"column": "N [g]", **options})
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("heads", "right"),
    [
        # A transverse component in g, not the times.
        ("time [s],L [g],T [g],V [g]", {"a L": (1, 3), "a T": (2, 3)}),
        # A velocity and a displacement beside an acceleration.
        ("time [s],a [g],v [cm/s],d [cm]", {"a": (1, None)}),
    ],
)
def test_columns_of_a_suite(tmp_path, heads, right):
    path = tmp_path / "a.csv"
    path.write_text(f"{heads}\n0,1,2,3\n.5,4,5,6\n")
    suite = jr.read_suite([path], vertical="V" in heads)
    assert suite.names == (*right,)
    for record, (level, rising) in zip(suite, right.values(), strict=True):
        assert float(record.acceleration[0]) == pytest.approx(G * level)
        if rising is not None:
            assert float(record.vertical[0]) == pytest.approx(G * rising)


def make_table(steps, form, first=0.0):
    times = first + np.asarray(steps)
    return "time,acc_g\n" + "".join(f"{form % t},{(-1) ** k}\n" for k, t in enumerate(times))


@pytest.mark.parametrize(
    ("samples", "step", "form", "given"),
    [
        (8, 1 / 256, "%.3f", 1 / 256),
        (1000, 1 / 256, "%.3f", 1 / 256),
        (1000, 1 / 256, "%.3f", None),  # no other step, to a thousandth, explains them
        (20000, 1 / 120, "%.3f", None),
        (300, 1 / 75, "%.4g", 1 / 75),
        (500, 1 / 75, "%.3e", 1 / 75),
    ],
)
def test_times_printed_with_few_digits(read, samples, step, form, given):
    content = make_table(step * np.arange(1, samples + 1), form)
    record = read(content, time_step=given)
    assert float(record.time_step) == pytest.approx(step, rel=1e-6 if given else 1e-3)
    stated = "" if given is None else f"# sampling rate {1 / step:.9g} Hz\n"
    assert float(read(stated + content).time_step) == pytest.approx(step, rel=1e-3)


def test_times_that_no_step_explains(read):
    right = np.arange(1, 1001) / 256
    lost = np.delete(right, 500)
    late = right + 0.002 * (np.arange(1000) > 500)
    for times, options, message in (
        (right[:6], {}, "must have a uniform step"),  # 0.0036 to 0.004 s explain them
        (right, {"time_step": 0.004}, "time_step is 0.004 s, but column 'time' has a step"),
        (right[:6], {"time_step": 0.0045}, "must have a uniform step"),
        (lost, {"time_step": 1 / 256}, "must have a uniform step"),
        (lost, {}, "must have a uniform step"),
        (late, {"time_step": 1 / 256}, "must have a uniform step"),
        (late, {}, "must have a uniform step"),
        # Times that are printed twice may as well have been repeated.
        (right / 4, {"time_step": 1 / 1024}, "must increase"),
    ):
        with pytest.raises(ValueError, match=f"a.csv'.*{message}"):
            read(make_table(times, "%.3f"), **options)


def test_a_table_that_is_cut_in_its_last_number(read):
    random = np.random.default_rng(0)
    values = random.normal(size=50)
    for form in ("%.6f", "%.18e", "%12.5E"):
        rows = [f"{k / 100:.2f},{form % value}" for k, value in enumerate(values)]
        whole = "\n".join(["time,acc_g", *rows])
        assert read(whole).samples == read(whole + "\n").samples == 50
        for cut in range(1, len(form % values[-1])):
            with pytest.raises(ValueError, match=r"a\.csv'"):
                read(whole[:-cut])
        seems = (
            "line 51: the file looks truncated: its last number .* has fewer digits than the"
        )
        way = " others and no newline follows; add a newline if it is complete"
        with pytest.raises(ValueError, match=f"{seems}{way}"):
            read(whole[:-1])


@pytest.mark.parametrize(
    "form", [repr, lambda value: f"{value:g}", lambda value: f"{value:.3g}"]
)
def test_varying_digits_are_no_sign_of_a_cut(read, form):
    random = np.random.default_rng(1)
    for _ in range(20):
        values = [form(float(value)) for value in random.normal(size=30).round(4)]
        rows = [f"{k / 100},{value}" for k, value in enumerate(values)]
        assert read("\n".join(["time,acc_g", *rows])).samples == 30
    # A number so much shorter than all others is one.
    with pytest.raises(ValueError, match="the file looks truncated"):
        read("time,acc_g\n0.00,0.12345\n0.01,-0.3456\n0.02,0.2")


SPECTRUM = "0.0,0.3\n0.1,0.6\n0.2,0.8\n0.3,0.7\n"
G_GIVEN = {"unit": "g"}
LATER = {"unit": "g", "time_step": 0.02}
# Names and statements of other quantities, units and steps; all of these were once read as motions.
OTHER_QUANTITIES = [
    ("T (s),Sa (g)\n" + SPECTRUM, {}, "'Sa (g)': a spectrum over periods or frequencies is no"),
    ("T (sec),Spectral acceleration (g)\n" + SPECTRUM, {}, "a spectrum over periods"),
    ("T [s],PSA\n" + SPECTRUM, G_GIVEN, "got column 'PSA': a spectrum over periods"),
    ("T,Se\n" + SPECTRUM, G_GIVEN, "got column 'Se': a spectrum over periods"),
    ("Period [s],a [g]\n" + SPECTRUM, LATER, "got column 'Period [s]': a spectrum over"),
    ("# response spectrum, 5 % damping\nT [s],A [g]\n" + SPECTRUM, {}, "'T' may be periods"),
    ("T [s],design acceleration [g]\n" + SPECTRUM, {}, "'T' may be periods: the text above"),
    ("PGA [g],rate\n" + SPECTRUM, LATER, "samples in time were expected, got column 'PGA [g]'"),
    ("time,LVDT1 [mm]\n" + SPECTRUM, G_GIVEN, "got columns 'LVDT1 [mm]' (displacement)"),
    ("time,phi [deg]\n" + SPECTRUM, G_GIVEN, "got columns 'phi [deg]' (rotation)"),
    ("time,tilt (rad)\n" + SPECTRUM, G_GIVEN, "got columns 'tilt (rad)' ("),
    ("time,ch1 [V]\n" + SPECTRUM, G_GIVEN, "got columns 'ch1 [V]' (voltage)"),
    ("time,N (kN)\n" + SPECTRUM, G_GIVEN, "got columns 'N (kN)' (force)"),
    ("time,x [m]\n" + SPECTRUM, G_GIVEN, "got columns 'x [m]' (displacement)"),
    ("time,d (in)\n" + SPECTRUM, G_GIVEN, "got columns 'd (in)' (displacement)"),
    ("time,acc [V/g]\n" + SPECTRUM, G_GIVEN, "column 'acc [V/g]' states V/g, which is not one of"),
    ("time,acc [1e-3 g]\n" + SPECTRUM, {}, "states 1e-3 g, which is not one of"),
    ("time [g],acc [g]\n" + SPECTRUM, {}, "the unit of the times is not understood: 'time [g]'"),
    ("VELOCITY TIME SERIES\ntime,a\n" + SPECTRUM, G_GIVEN, "line 1: acceleration was expected"),
    ("Time Step: 0.005\n0.1\n0.3\n0.2\n", LATER, "line 1: time_step is 0.02 s, but a title"),
    ("# fs = 200\n0.1\n0.3\n0.2\n", LATER, "line 1: time_step is 0.02 s, but a comment states fs"),
    ("acc [g] at 200 samples/s\n0.1\n0.3\n0.2\n", LATER, "but the name of a column states 200"),
    ("# in gal\n0.1\n0.3\n0.2\n", LATER, "line 1: unit is 'g', but a comment states gal"),
    ("0.1\n0.2\n0.3\n0.4\n0.5\n", LATER, "the numbers rise evenly, as times do"),
    ("5\n0.01\n0.3\n0.2\n-0.3\n.1\n0.4\n", LATER, "the first number, 5, is how many follow"),
]  # fmt: skip


@pytest.mark.parametrize(("content", "options", "message"), OTHER_QUANTITIES)
def test_what_is_no_motion(tmp_path, read, content, options, message):
    with pytest.raises(ValueError, match=r"a\.csv', ") as caught:
        read(content, **options)
    assert message in str(caught.value)
    # Nor is it one beside records.
    step = options.get("time_step", 0.5)
    (tmp_path / "b.csv").write_text(f"time,acc [g]\n0,1\n{step},-2\n")
    with pytest.raises(ValueError, match=r"^'[^'\n]*a\.csv'[^\n]*$"):
        jr.read_suite(tmp_path, **options)


def test_a_log_of_a_shake_table(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,LVDT1 [mm],A1 [g],tilt (deg),load [kN]\n" + "0,9,1,8,7\n.5,9,2,8,7\n")
    suite = jr.read_suite(tmp_path)
    assert suite.names == ("log",)
    np.testing.assert_allclose(suite[0].acceleration, [G, 2 * G], rtol=1e-6)
    with pytest.raises(
        ValueError, match=r"column 'LVDT1 \[mm\]' is of another quantity: disp"
    ):
        jr.read_record(path, column="LVDT1 [mm]")


def test_names_of_files_say_where_a_column_points(tmp_path):
    for name, value in (("STA090.csv", 1), ("STA-UP.csv", 3)):
        (tmp_path / name).write_text(f"time [s],acc [g]\n0,{value}\n.5,0\n")
    assert jr.read_suite(tmp_path).names == ("STA090",)
    (record,) = jr.read_suite(tmp_path, vertical=True)
    assert float(record.vertical[0]) == pytest.approx(3 * G)
    with pytest.raises(
        ValueError, match="no component is horizontal; column names a vertical"
    ):
        jr.read_record(tmp_path / "STA-UP.csv")
    (tmp_path / "b.tsv").write_text("time [s]\tacc [g]\n0\t1\n.5\t0\n")
    assert jr.read_suite(tmp_path).names == ("STA090", "b")
