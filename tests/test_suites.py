"""Suites of records: their measures, what is computed with them, and their files."""

import csv
import io
import os
import re
import zipfile
from fractions import Fraction
from importlib.resources import files
from itertools import pairwise

import hypothesis
import hypothesis.strategies as st
import jax
import numpy as np
import pytest
import xarray as xr

import jaxrock as jr
from jaxrock.driven.many_blocks import ground_motions
from jaxrock.ground_motion import intensity_measure

G = 9.80665
BLOCK = jr.Block(0.2, 5.0)
BLOCKS = jr.Block(np.array([0.2, 0.4]), np.array([5.0, 4.0]))


def shaking(samples, step, cycles, upward=False):
    """A few cycles that swell and die away, of up to 4 m/s2."""
    along = np.linspace(0, 1, samples)
    envelope = 4 * np.sin(np.pi * along)
    vertical = 0.5 * envelope * np.sin(9 * np.pi * along) if upward else None
    return jr.Record(envelope * np.sin(2 * np.pi * cycles * along), step, vertical)


SHORT = jr.Suite([shaking(120, 0.02, 3), shaking(200, 0.015, 4)])  # padded as they are alone
# Here the second one is padded further than alone, because of the third.
LONGER = shaking(300, 0.01, 4, upward=True), shaking(600, 0.005, 5)
SUITE = jr.Suite([SHORT[0], *LONGER], ["a", "b", "c"])


def exact_peaks(samples, step):
    """PGA and PGV of lines between samples, from rest on."""
    velocity = Fraction(0)
    fastest = Fraction(0)
    for before, after in pairwise(map(Fraction, samples)):
        if before * after < 0:
            fastest = max(fastest, abs(velocity + before**2 / (before - after) / 2))
        velocity += (before + after) / 2
        fastest = max(fastest, abs(velocity))
    return float(max(map(abs, map(Fraction, samples)))), float(fastest * Fraction(step))


WHOLE = st.integers(-20, 20).map(float)


@hypothesis.given(st.lists(WHOLE, min_size=2, max_size=30), st.sampled_from([1.0, -2.5, 0.0]))
@hypothesis.example([float(n * 7 % 11 - 4) for n in range(257)], -2.0)
def test_peaks_against_exact_arithmetic(samples, scale):
    record = jr.Record(np.array(samples), 0.01, scale=scale)
    eps = float(np.finfo(record.acceleration.dtype).eps)
    expected = exact_peaks(samples, float(record.time_step))
    for measure, peak in zip(("pga", "pgv"), expected, strict=True):
        found = float(intensity_measure(record, measure))
        assert found == pytest.approx(abs(scale) * peak, rel=16 * eps), measure


def test_measures_have_the_shape_of_scale_and_block(eps):
    record = shaking(50, 0.02, 2).scaled(np.array([[1.0], [-2.0], [0.0]]))
    for measure in ("pga", "pgv"):
        value = np.asarray(intensity_measure(record, measure))
        assert value.shape == (3, 1)
        np.testing.assert_allclose(value[:, 0], value[0] * [1, 2, 0], rtol=4 * eps)
        blocks = jr.Block(np.array([[0.2, 0.4]]), np.array([[5.0, 4.0]]))
        uplift = 9.81 / np.array([5.0, 4.0])  # g tan(alpha_c)
        frequency = np.asarray(blocks.frequency_parameter) if measure == "pgv" else 1.0
        ratio = intensity_measure(record, f"{measure}_ratio", blocks)
        np.testing.assert_allclose(ratio, value * frequency / uplift, rtol=8 * eps)


def test_derivative_of_a_measure(eps):
    record = shaking(50, 0.02, 2)
    slope = jax.grad(lambda factor: intensity_measure(record.scaled(factor), "pgv"))(-2.0)
    assert float(slope) == pytest.approx(
        -float(intensity_measure(record, "pgv")), rel=64 * eps
    )


ONE = jr.Record(np.array([0.0, 1.0]), 0.1)


def test_a_suite_is_a_sequence():
    assert len(SUITE) == 3
    assert [record.samples for record in SUITE] == [120, 300, 600]
    assert SUITE["b"] is SUITE[1] is SUITE[1:][0]
    assert SUITE[1:].names == ("b", "c")
    assert jr.Suite([ONE, ONE]).names == ("1", "2")
    assert str(SUITE) == "suite of 3 records of 120 to 600 samples, 0.005 to 0.02 s apart"
    assert str(SUITE[:1]) == "suite of 1 record of 120 samples, 0.02 s apart"


def test_records_are_scaled_to_levels(eps):
    levels = np.array([0.2, 0.5])
    for measure in ("pga", "pgv_ratio"):
        plain = SUITE.measure(measure, BLOCK)
        each = [intensity_measure(record, measure, BLOCK) for record in SUITE]
        np.testing.assert_array_equal(plain, each)
        scaled = SUITE.scaled(SUITE.factors(levels, measure, BLOCK))
        assert scaled.names == SUITE.names
        reached = scaled.measure(measure, BLOCK)
        np.testing.assert_allclose(reached, np.tile(levels, (3, 1)), rtol=8 * eps)
        np.testing.assert_allclose(
            SUITE.scaled(-2.0).measure(measure, BLOCK), 2 * plain, rtol=eps
        )
        turned = SUITE.scaled(np.array([1.0, 0.0, -1.0])).measure(measure, BLOCK)
        np.testing.assert_allclose(turned, plain * np.array([1.0, 0.0, 1.0]), rtol=eps)
    assert SUITE.measure("pgv_ratio", BLOCKS).shape == (3, 2)
    assert SUITE.factors(levels, "pgv_ratio", BLOCKS).shape == (3, 2, 2)


def assert_row(found, k, single, rtol=0.0):
    for rows, theirs in zip(jax.tree.leaves(found), jax.tree.leaves(single), strict=True):
        np.testing.assert_allclose(rows[k], theirs, rtol=rtol)


@pytest.mark.thorough
def test_responses_are_those_of_the_records(eps):
    strong = SUITE.scaled(np.tile([[0.8], [1.5], [3.0]], (3, 1, 1)))
    found = jr.respond_batch(BLOCKS, 0.8, strong)
    assert found.overturned.shape == (3, 3, 2)
    assert 0 < found.overturned.sum() < 18
    for k, record in enumerate(strong):
        rtol = max(1e-9, 100 * eps) if k == 1 else 0.0
        assert_row(found, k, jr.respond_batch(BLOCKS, 0.8, record), rtol)
    found = jr.respond_within(BLOCKS, 0.8, SHORT, 1e-2, duration=2.0)
    for k, record in enumerate(SHORT):
        assert_row(found, k, jr.respond_within(BLOCKS, 0.8, record, 1e-2, duration=2.0))


@pytest.mark.thorough
def test_groups_of_records_change_no_bit(monkeypatch):
    """A suite that is too large for memory is followed in groups."""
    strong = SUITE.scaled(np.array([0.8, 1.5, 3.0]))
    factors = np.linspace(0.2, 2.0, 7)
    whole = jr.respond_batch(BLOCKS, 0.8, strong)
    found = jr.overturning_boundaries(BLOCKS, 0.8, strong, "factor", factors)
    asked = []

    def lay_out(*arguments, lay_out=ground_motions._lay_out):
        parts, begins = lay_out(*arguments)
        asked.append(begins)
        return parts, begins

    monkeypatch.setattr(ground_motions, "_lay_out", lay_out)
    monkeypatch.setattr(ground_motions, "_GROUP_ROOM", 1)
    for ours, theirs in (
        (jr.respond_batch(BLOCKS, 0.8, strong), whole),
        (jr.overturning_boundaries(BLOCKS, 0.8, strong, "factor", factors), found),
    ):
        for each, other in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
            np.testing.assert_array_equal(each, other)
    assert asked == [(0, 1, 2)] * 2


@pytest.mark.thorough
def test_rocking_spectrum(eps, tmp_path):
    found = jr.rocking_spectrum(SUITE, [1.0, 2.0], 4.0)
    assert found.peak_rotation.dims == ("record", "free_period")
    assert found.record.values.tolist() == ["a", "b", "c"]
    for name, record in zip(SUITE.names, SUITE, strict=True):
        single = jr.rocking_spectrum(record, [1.0, 2.0], 4.0)
        row = found.sel(record=name)
        xr.testing.assert_allclose(row.drop_vars("record"), single, rtol=max(1e-9, 100 * eps))
        assert {"Conventions": "CF-1.9", **row.attrs} == single.attrs
    found.to_netcdf(tmp_path / "suite.nc")
    with xr.open_dataset(tmp_path / "suite.nc") as again:
        xr.testing.assert_equal(again, found)


@pytest.mark.thorough
@pytest.mark.float64
@pytest.mark.parametrize(
    ("along", "values"),
    [
        ("factor", np.linspace(0.5, 2.5, 11)),
        ("half_width", np.geomspace(0.05, 0.6, 15)),
    ],
)
def test_boundaries_are_those_of_the_records(along, values):
    found = jr.overturning_boundaries(BLOCKS, 0.8, SUITE, along, values)
    count = np.asarray(found.count)
    assert count.shape == (3, 2)
    assert len(set(count.max(axis=1).tolist())) > 1
    assert found.value.shape == (3, 2, count.max())
    missing = {"value": np.nan, "overturns_beyond": False, "impacts": -1, "toppled": False}
    for k, record in enumerate(SUITE):
        single = jr.overturning_boundaries(BLOCKS, 0.8, record, along, values)
        listed = single.value.shape[-1]
        assert found.along == along
        for name, rows in vars(found).items():
            if name == "along":
                continue
            if name in missing:
                np.testing.assert_array_equal(rows[k, :, listed:], missing[name])
                rows = rows[..., :listed]
            assert_row(rows, k, getattr(single, name), 1e-9 if k == 1 else 0.0)


@pytest.mark.float64
@pytest.mark.thorough
def test_derivatives_of_the_boundaries_of_a_suite():
    def slopes(motion):
        def edges(restitution):
            factors = np.linspace(0.5, 2.5, 11)
            return jr.overturning_boundaries(
                BLOCK, restitution, motion, "factor", factors
            ).value

        return jax.jvp(edges, (0.8,), (1.0,))

    found = slopes(SHORT)
    for k, record in enumerate(SHORT):
        value, slope = slopes(record)
        assert value.size > 0
        assert (abs(slope) > 1e-3).any()
        assert_row([each[:, : value.size] for each in found], k, [value, slope])


@pytest.mark.thorough
@pytest.mark.float64
def test_derivative_of_a_boundary_long_before_the_end_of_a_record():
    """This block balances for ten seconds, until the record ends and rounding has decided."""
    suite = jr.example_suite()
    record = suite.scaled(1 / suite.measure("pgv"))[8]
    edge = 1.5034582935571408
    step = 1e-6

    def edges(restitution):
        block = jr.Block.from_size(width=0.6, height=2.4)
        factors = np.linspace(edge - 4e-7, edge + 4e-7, 5)  # there are others near by
        found = jr.overturning_boundaries(block, restitution, record, "factor", factors)
        return found.value[..., 0]

    value, slope = jax.jvp(edges, (np.array([0.8 - step, 0.8, 0.8 + step]),), (np.ones(3),))
    assert float(value[1]) == pytest.approx(edge, rel=1e-12)
    assert float(slope[1]) == pytest.approx(-0.0921831, abs=1e-7)
    assert float(slope[1]) == pytest.approx(float(value[2] - value[0]) / (2 * step), rel=1e-6)


AT2 = "PEER\nRSN1\nUNITS OF G\nNPTS= 3, DT= .01 SEC\n{} .2 -.3\n"
CONTENTS = {
    "a.csv": "# time step 0.01 s\neast_g,north_g,up_g\n1,4,7\n2,5,8\n3,6,9\n",
    "b.csv": "time [s],acc [cm/s2]\n0,10\n0.5,-20\n",
    "RSN1_A-000.AT2": AT2.format(".1"),
    "RSN1_A-090.AT2": AT2.format(".4"),
    "RSN1_A-UP.AT2": AT2.format(".7"),
    "index.csv": "file,magnitude\na.csv,6.1\n",
    "within/c.csv": "acc_g\nx\n",
}


@pytest.fixture
def folder(tmp_path):
    def made(contents=CONTENTS):
        for name, content in contents.items():
            (tmp_path / name).parent.mkdir(exist_ok=True)
            (tmp_path / name).write_text(content)
        return tmp_path

    return made


def test_a_folder_is_read(folder, eps):
    expected = {
        "RSN1_A-000": (0.01, [0.1, 0.2, -0.3], [0.7, 0.2, -0.3]),
        "RSN1_A-090": (0.01, [0.4, 0.2, -0.3], [0.7, 0.2, -0.3]),
        "a east": (0.01, [1, 2, 3], [7, 8, 9]),
        "a north": (0.01, [4, 5, 6], [7, 8, 9]),
        "b": (0.5, [0.1 / G, -0.2 / G], None),
    }
    path = folder()
    level = jr.read_suite(path)
    listed = jr.read_suite([path / "b.csv", str(path / "a.csv")])
    both = jr.read_suite([path / name for name in CONTENTS if name[0] in "aR"], vertical=True)
    assert level.names == tuple(expected)
    assert listed.names == ("b", "a east", "a north")
    assert both.names == ("a east", "a north", "RSN1_A-000", "RSN1_A-090")
    assert jr.read_suite(path / "b.csv", time_step=0.5).names == ("b",)
    for suite in (level, listed, both):
        for name, record in zip(suite.names, suite, strict=True):
            step, horizontal, vertical = expected[name]
            np.testing.assert_allclose(record.time_step, step, rtol=2 * eps)
            np.testing.assert_allclose(
                record.acceleration, G * np.array(horizontal), rtol=4 * eps
            )
            assert (record.vertical is not None) == (suite is both)
            if suite is both:
                np.testing.assert_allclose(
                    record.vertical, G * np.array(vertical), rtol=4 * eps
                )


WORDS = "Dear reader\nthese are words\n"
LEVEL, UP, ALONE = (CONTENTS[name] for name in ("RSN1_A-000.AT2", "RSN1_A-UP.AT2", "b.csv"))
NONE = ": the folder has no file of a record: .at2, .csv"


FOLDERS_THAT_ARE_REFUSED = [
    ({}, {}, [NONE]),
    ({"index.csv": WORDS, "a.txt": WORDS}, {}, [NONE]),
    ({"a.csv": WORDS}, {"unit": "g", "time_step": 1.0},
     ["a.csv': at least two samples were expected, got 0"]),
    ({"a.csv": "acc_g\n1\n"}, {"time_step": 1.0}, ["at least two samples were expected, got"]),
    ({"b.csv": ALONE}, {"unit": "g"}, ["unit is 'g', but column 'acc [cm/s2]' states"]),
    ({"a.csv": "", "b.AT2": WORDS}, {},
     [": none of the 2 files is a record", "a.csv': the file is empty", "b.AT2': an .AT2 file"]),
    ({"a-UP.AT2": UP}, {}, ["a suite needs at least one horizontal component, got 1 files"]),
    ({"a.csv": "t,up_g\n0,1\n1,2\n"}, {}, ["a.csv': no column is a horizontal acceleration"]),
    ({"a.csv": ALONE}, {"vertical": True},
     ["a.csv': no file is its vertical component by the name"]),
    ({"a.AT2": LEVEL}, {"vertical": True}, ["a.AT2': no file is its vertical component by"]),
    ({"a.AT2": LEVEL, "a.csv": ALONE}, {}, ["a.csv': another record is named 'a' as well"]),
]  # fmt: skip


@pytest.mark.parametrize(("contents", "options", "messages"), FOLDERS_THAT_ARE_REFUSED)
def test_folders_that_are_refused(folder, contents, options, messages):
    """One line for each file."""
    with pytest.raises(ValueError, match=re.escape(messages[0])) as error:
        jr.read_suite(folder(contents), **options)
    lines = str(error.value).splitlines()
    assert all(message in line for message, line in zip(messages, lines, strict=True))


def test_example_suite():
    """Against its index; where it is from and on what terms, GeoNet's attribution included."""
    packed = (files("jaxrock") / "data" / "example_suite.zip").read_bytes()
    assert len(packed) < 0.5e6
    with zipfile.ZipFile(io.BytesIO(packed)) as archive:
        texts = {name: archive.read(name).decode() for name in archive.namelist()}
    rows = {row["file"]: row for row in csv.DictReader(io.StringIO(texts.pop("index.csv")))}
    assert rows.keys() == texts.keys()
    expected = {}
    for name in sorted(rows):
        head = [line for line in texts[name].splitlines() if line.startswith("#")]
        for word in ("Licence: ", "Source: "):
            assert any(word in line for line in head), (name, word)
        if "GeoNet" in rows[name]["network"]:
            assert "GeoNet programme and its sponsors EQC, GNS Science, LINZ" in "".join(head)
        for which in ("first", "second"):
            expected[f"{name}, {which}"] = G * float(rows[name][f"pga_g_{which}"])
    assert sum("kaikoura" in name for name in expected) == 4
    suite = jr.example_suite(vertical=True)
    assert len(suite) == 20
    np.testing.assert_allclose(suite.measure("pga"), [*expected.values()], rtol=1e-3)
    assert all(record.vertical is not None for record in suite)


@pytest.mark.parametrize(
    ("columns", "horizontal", "upward"),
    [
        ("HNE,HNN,HNZ", ["HNE", "HNN"], "HNZ"),
        ("ax,ay,az", ["ax", "ay"], "az"),
        ("accX,accY,accZ", ["accX", "accY"], "accZ"),
        ("N-S (g),EW [g],U-D (g)", ["N-S", "EW"], "U-D (g)"),
        ("acc (g) EW,acc (g) NS,acc (g) UD", ["acc EW", "acc NS"], "acc (g) UD"),
        ("acc_g_x,acc_g_y,acc_g_z", ["acc x", "acc y"], "acc_g_z"),
        ("sample,acc_g,vx", [""], None),
        ("north,down", [""], None),
    ],
)
def test_columns_by_their_names(tmp_path, columns, horizontal, upward):
    path = tmp_path / "s.csv"
    count = columns.count(",") + 1
    rows = "".join(",".join(str(k + j) for j in range(count)) + "\n" for k in range(3))
    path.write_text(f"{columns}\n{rows}", encoding="utf-8")
    suite = jr.read_suite([path], unit="g", time_step=0.01)
    assert list(suite.names) == [f"s {name}".strip() for name in horizontal]
    if upward is not None:
        place = columns.split(",").index(upward)
        for record in jr.read_suite([path], unit="g", time_step=0.01, vertical=True):
            np.testing.assert_allclose(
                record.vertical, 9.80665 * (np.arange(3) + place), rtol=1e-6
            )


def test_more_than_two_horizontal_columns(tmp_path):
    path = tmp_path / "s.csv"
    path.write_text("one,two,three\n1,2,3\n1,2,3\n", encoding="utf-8")
    with pytest.raises(
        ValueError, match="at most two horizontal columns were expected: 'one', "
    ):
        jr.read_suite([path], unit="g", time_step=0.01)


def test_vertical_components_by_the_names_of_files(tmp_path):
    """Of the station whose name it is, not of one whose name begins alike; and not downward."""
    for name, value in (("STA1-000", 1), ("STA1-UP", 2), ("STA10-000", 3), ("STA10-UP", 4)):
        head = f"{name}\nacceleration in units of g\n\nNPTS= 3, DT= .01 SEC\n"
        (tmp_path / f"{name}.AT2").write_text(
            f"{head}{value} {value} {value}\n", encoding="utf-8"
        )
    (tmp_path / "santa_cruz.AT2").write_text(f"{head}5 5 5\n", encoding="utf-8")
    assert jr.read_suite(tmp_path).names == ("STA1-000", "STA10-000", "santa_cruz")
    files = sorted(tmp_path.glob("STA*"))
    found = jr.read_suite(iter(files), vertical=True)
    assert [round(float(record.vertical[0]) / 9.80665) for record in found] == [2, 4]
    (tmp_path / "STA1-UP.AT2").rename(tmp_path / "STA1-DWN.AT2")
    with pytest.raises(ValueError, match=r"STA1-DWN.* points downward by its name"):
        jr.read_suite([tmp_path / "STA1-000.AT2", tmp_path / "STA1-DWN.AT2"], vertical=True)


# As the NGA databases and networks name them.
VERTICAL = (
    "RSN57_SFERN_ORRDWN RSN1244_CHICHI_CHY101-V RSN1633_MANJIL_ABBAR--V NIGH11UD site-V1"
)
VERTICAL += (
    " RSN4228_NIIGATA_NIGH11UD RSN6890_DARFIELD_CMHSV RSN8123_CCHURCH_RHSCUP CI.CLC.HNZ"
)
VERTICAL += " RSN8000_X_NZ.REHS.BHZ.00 RSN292_ITALY_A-STUVRT"
HORIZONTAL = (
    "RSN57_SFERN_ORR021 RSN1244_CHICHI_CHY101-E RSN1633_MANJIL_ABBAR--T NIGH11EW site-H1"
)
HORIZONTAL += (
    " RSN4228_NIIGATA_NIGH11NS RSN6890_DARFIELD_CMHSN10E RSN8123_CCHURCH_RHSCN86W CI.CLC.HNE"
)
HORIZONTAL += " RSN8000_X_NZ.REHS.BHN.00 RSN292_ITALY_A-STU270 group cloud setup record_v2"


def test_vertical_components_are_not_taken_for_horizontal_ones(tmp_path):
    for name in f"{VERTICAL} {HORIZONTAL}".split():
        (tmp_path / f"{name}.AT2").write_text(LEVEL, encoding="utf-8")
    assert set(jr.read_suite(tmp_path).names) == set(HORIZONTAL.split())
    pair = [tmp_path / f"RSN4228_NIIGATA_NIGH11{end}.AT2" for end in ("NS", "UD")]
    assert jr.read_suite(pair, vertical=True)[0].vertical is not None


def test_what_lies_in_a_folder_beside_records(tmp_path):
    """Hidden files and pipes are nobody's records; a link to nowhere is said."""
    (tmp_path / "a.AT2").write_text(LEVEL, encoding="utf-8")
    (tmp_path / ".b.AT2").write_text("left by an editor", encoding="utf-8")
    assert jr.read_suite(tmp_path).names == ("a",)
    os.mkfifo(tmp_path / "d.csv")
    assert jr.read_suite(tmp_path).names == ("a",)
    (tmp_path / "c.csv").symlink_to(tmp_path / "nowhere")
    with pytest.raises(ValueError, match=r"c\.csv': the file cannot be read: No such"):
        jr.read_suite(tmp_path)


def test_scales_and_levels_are_not_mixed():
    suite = jr.Suite([jr.Record([0.0, 1.0, 0.0], 0.1, scale=np.array([1.0, 2.0]))])
    assert suite.factors(1.0, "pga").shape == (1, 2)
