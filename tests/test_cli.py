"""The commands as a user calls them, in this process; one of them in its own."""

import csv
import json
import re
import shlex
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
import xarray
from tools.cf_conventions import assert_follows_cf
from tools.command import run

import jaxrock as jr
from jaxrock.calibration import cross_validate, read_tests
from jaxrock.cli import application
from jaxrock.reports import paper

TABLES = Path(__file__).parent / "tables"
COMMANDS = [command for panel in application.COMMANDS.values() for command in panel]
WALL = ("--width", 0.8, "--height", 4)
SLIM = ("--width", 0.2, "--slenderness", 5, "--restitution", 0.9)
SINE = ("--pulse", "sine", "--amplitude", 3, "--pulse-duration", 0.5)
BLOCK = jr.Block(0.1, 5.0)

pytestmark = pytest.mark.float64


def read_answer(capsys, *words):
    """What a command answers as JSON."""
    code, text, err = run(capsys, *words, "--json")
    assert code == 0, err
    return json.loads(text)


def read_csv(path):
    """The inputs above a table, and its columns by their heads."""
    lines = path.read_text(encoding="utf-8").splitlines()
    about = [line for line in lines if line.startswith("#")]
    names, *rows = csv.reader(line for line in lines if not line.startswith("#"))
    return about, {name: [row[k] for row in rows] for k, name in enumerate(names)}


def write_inputs(folder):
    """Write the files that commands read."""
    (folder / "objects.csv").write_text("name,width [m],height [m]\nbust,0.4,1.6\n")
    (folder / "hazard.csv").write_text("pga [g],rate [1/yr]\n0.1,2e-2\n1,1e-4\n")
    (folder / "motion.csv").write_text("time [s],acc [g]\n0,0\n0.2,0.4\n0.4,-0.4\n0.6,0\n")
    (folder / "motion.xlsx").write_bytes(b"PK\x03\x04\x14\x00\x06\x00")
    (folder / "tests.csv").write_text(
        "file,scale,overturned\n"
        "motion.csv,0.3,no\nmotion.csv,2,yes\nmotion.csv,0.5,no\nmotion.csv,3,yes\n"
    )
    (folder / "short.csv").write_text("time [s]\n0\n0.964\n")
    times = "time [s]\n0\n0.964\n1.636\n2.173\n2.623\n3.007\n3.34\n"
    (folder / "times.csv").write_text(times)


def read_wrong_commands():
    """Each command line that is refused, and what the sentence must contain."""
    lines = (TABLES / "wrong_commands.txt").read_text(encoding="utf-8").splitlines()
    lines = [line for line in lines if line and not line.startswith("#")]
    return dict(zip(lines[::2], (line.split("|") for line in lines[1::2]), strict=True))


def test_wrong_commands_end_with_one_sentence(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_inputs(tmp_path)
    before = sorted(tmp_path.iterdir())
    for words, needed in read_wrong_commands().items():
        code, out, err = run(capsys, *shlex.split(words))
        assert (code, out) == (2, ""), words
        sentence = err.splitlines()[-1]
        assert sentence.startswith("jaxrock: error: "), words
        assert "Traceback" not in err
        missing = [part.strip() for part in needed if part.strip() not in sentence]
        assert not missing, f"{words}: {sentence}"
    assert sorted(tmp_path.iterdir()) == before


def test_assess(capsys):
    """For an engineer in m/s2 and g; everything with --details; numbers of the library."""
    pulses = (*WALL, "--restitution", 0.7, "--intensity", 0.15)
    _, text, _ = run(capsys, "assess", *pulses)
    assert text.startswith("0.8 m wide, 4 m high, C = 0.7\nlifts from 1.96 m/s2 (0.2 g)")
    assert "settles at 12.4 % of the critical angle" in text
    assert not re.search(r"zeta|Eq\.|linearized|none|nan", text)
    assert text in run(capsys, "assess", *pulses, "--details")[1]
    answer = read_answer(capsys, "assess", *pulses)
    block = jr.Block.from_size(width=0.8, height=4.0)
    ratio = float(jr.rotation_ratio(jr.Scene(block, 0.7, 0.15), jr.Nonlinear()))
    found = answer["models"]["nonlinear"]["stabilized"]["rotation_ratio"]
    assert found == pytest.approx(ratio, rel=1e-12)
    # A rectangular pulse in closed form, doi:10.1785/BSSA0530020403, against the integrator.
    push = float(re.search(r"under (\S+) m/s2 \(.*\) held for 0.5 s", text)[1])
    falls = [
        bool(jr.respond(block, 0.7, jr.Rectangular(factor * push, 0.5)).overturned)
        for factor in (0.97, 1.03)
    ]
    assert falls == [False, True]
    _, text, _ = run(capsys, "assess", *WALL, "--intensity", 0.15)
    assert "C = 0.942 (Housner's, assumed)" in text
    assert "overturns in half-cycle" in text
    answer = read_answer(capsys, "assess", *WALL, "--gravity", 1.62)
    assert answer["scene"]["gravity"] == 1.62
    assert answer["scene"]["restitution_assumed"] is True
    assert answer["models"]["nonlinear"].keys() == {"critical_velocity", "critical_intensity"}


def test_spectrum(capsys, tmp_path):
    grid = ("--slenderness", "3:10:8", "--width", 0.4, 1.2, "--restitution", 0.6, 0.8)
    command = ("spectrum", *grid, "--out", tmp_path / "deep" / "er")
    answer = read_answer(capsys, *command)
    assert answer["sizes"] == {"slenderness": 8, "width": 2, "restitution": 2}
    names = ["spectrum.csv", "spectrum.nc", "spectrum.png"]
    assert sorted(path.name for path in (tmp_path / "deep" / "er").iterdir()) == names
    with xarray.open_dataset(tmp_path / "deep" / "er" / "spectrum.nc") as dataset:
        assert answer["overturned"] == float((dataset.overturning_margin <= 0).mean())
    assert_follows_cf(tmp_path / "deep" / "er" / "spectrum.nc")
    code, _, err = run(capsys, *command)
    assert code == 2
    assert "--force" in err
    changed = read_answer(capsys, *command, "--force", "--model", "nonlinear")
    assert changed["model"] == "nonlinear"
    _, text, _ = run(capsys, "spectrum", "--slenderness", 5, "--out", tmp_path / "other")
    assert "C = 0.6, 0.7, 0.8 (assumed)" in text


@pytest.mark.thorough
def test_respond(capsys, tmp_path):
    """What happens around the answer says how many of its digits count."""
    out = ("--out", tmp_path / "out")
    answer = read_answer(capsys, "respond", *SLIM, *SINE, "--duration", 1, *out)
    expected = jr.respond(BLOCK, 0.9, jr.Sine(3.0, 0.5), 1.0)
    assert answer["peak_rotation"] == pytest.approx(float(expected.peak_rotation), rel=1e-12)
    assert answer["impacts"] == expected.impacts
    assert answer["status"] == "complete"
    assert answer["uplift_factor"] == pytest.approx(9.81 / 5 / 3, rel=1e-9)
    assert_follows_cf(tmp_path / "out" / "response.nc")
    about, table = read_csv(tmp_path / "out" / "impacts.csv")
    assert any(line.startswith("# command: jaxrock respond --width 0.2") for line in about)
    assert len(table["time [s]"]) == int(expected.impacts)
    parapet = ("--width", 0.25, "--height", 1.2, "--record", "example")
    _, text, _ = run(capsys, "respond", *parapet, *out, "--force")
    assert re.search(r"PGA \S+ m/s2 \(\S+ g\), PGV \S+ m/s, \S+ s long", text)
    block = jr.Block.from_size(width=0.25, height=1.2)
    factors = np.linspace(0.9, 1.1, 41)
    scaled = jr.example_record().scaled(factors)
    batch = jr.respond_batch(block, jr.housner_restitution(block), scaled)
    ratio = np.asarray(batch.peak_rotation / block.critical_angle)[~batch.overturned]
    assert f"{ratio.min():.2g} to {ratio.max():.2g} of the critical angle" in text


@pytest.mark.thorough
def test_a_wall_and_a_floor_reach_the_library(capsys, tmp_path):
    wall = ("--width", 0.6, "--height", 6, "--one-sided", "--record", "example")
    floor = ("--scale", -1, "--floor-period", 0.4, "--floor-damping", 0.1)
    answer = read_answer(capsys, "respond", *wall, *floor, "--out", tmp_path)
    block = jr.Block.from_size(width=0.6, height=6.0, one_sided=True)
    motion = jr.example_record().on_floor(0.4, 0.1).scaled(-1.0)
    expected = jr.respond(block, jr.one_sided_restitution(block), motion, motion.end + 10)
    assert answer["peak_rotation"] == pytest.approx(float(expected.peak_rotation), rel=1e-9)


@pytest.mark.thorough
def test_fragility(capsys, tmp_path, monkeypatch):
    """The hazard says that it is one of PGA; the width of one wall that the target needs."""
    monkeypatch.chdir(tmp_path)
    write_inputs(tmp_path)
    for name in ("a", "b"):
        (tmp_path / "records").mkdir(exist_ok=True)
        (tmp_path / "records" / f"{name}.csv").write_text(Path("motion.csv").read_text())
    asked = ("--records", "records", "--hazard", "hazard.csv")
    asked += ("--target-return-period", 475, "--levels", 1, 3, 6)
    asked += ("--uncertain", "restitution=0.05", "--samples", 4)
    answer = read_answer(capsys, "fragility", *SLIM, *asked)
    suite = jr.read_suite("records")
    site = jr.risk.Site(suite, jr.risk.read_hazard("hazard.csv"))
    assert site.measure == "pga"
    uncertain = jr.Uncertain({"restitution": 0.05}, samples=4)
    rate = jr.risk.overturning_rate(BLOCK, 0.9, site, uncertain)
    assert answer["rate"] == pytest.approx(float(rate.rate), rel=1e-12)
    required = jr.risk.required_value(BLOCK, 0.9, site, 1 / 475)
    assert answer["required_width"] == pytest.approx(float(required.value), rel=1e-12)
    curves = jr.risk.fragility(BLOCK, 0.9, suite, [1.0, 3.0, 6.0], "pga", uncertain=uncertain)
    assert answer["dispersion"] == curves.lognormal_dispersion.values.tolist()
    with xarray.open_dataset("fragility/fragility.nc") as dataset:
        np.testing.assert_array_equal(dataset.exceedance, curves.exceedance)
    _, table = read_csv(Path("fragility/fragility.csv"))
    assert len(table["threshold"]) == 3 * 4


@pytest.mark.thorough
def test_validate(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_inputs(tmp_path)
    options = ("--splits", 2, "--samples", 64, "--seed", 1)
    found = read_answer(capsys, "validate", "tests.csv", *options)
    tests = read_tests("tests.csv")
    scores = cross_validate(
        tests.suite, tests.overturned, tests.groups, splits=2, samples=64, seed=1
    )
    means = [row["brier"] for row in found["scores"]]
    np.testing.assert_allclose(means, scores.brier.mean("split"), rtol=1e-12)
    with xarray.open_dataset("validation/validation.nc") as dataset:
        np.testing.assert_array_equal(dataset.probability, scores.probability)
    _, table = read_csv(Path("validation/population.csv"))
    assert table["parameter"][-1] == "lapse"
    assert len(list(Path("validation").iterdir())) == 6


@pytest.mark.thorough
def test_paper_fails_on_a_mismatch(capsys, tmp_path, monkeypatch):
    assert read_answer(capsys, "paper", "--out", tmp_path / "right")["agreeing"] == 93
    table = paper.PRINTED["tables"][0]
    wrong = [["3.84e-3", *table["printed"][0][1:]], *table["printed"][1:]]
    monkeypatch.setitem(table, "printed", wrong)
    code, text, _ = run(capsys, "paper", "--out", tmp_path / "wrong")
    assert code == 1
    assert "\nmismatch: Table I, peak rotation" in text
    assert "3.84e-3" in (tmp_path / "wrong" / "report.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", [c.__name__.replace("_", "-") for c in COMMANDS])
def test_help_shows_an_example(capsys, name):
    code, text, _ = run(capsys, name, "--help")
    assert code == 0
    assert f"Example: jaxrock {name} " in text


def test_a_warning_is_a_line(capsys, tmp_path):
    wide = ("spectrum", "--slenderness", 5, "--width", 80, "--out", tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        code, _, err = run(capsys, *wide)
    assert code == 0
    assert err.splitlines()[-1] == "jaxrock: warning: width is 80 m: sizes are in metres"


def test_a_folder_or_a_disk_that_cannot_be_written(capsys, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("in the way")
    small = ("spectrum", "--slenderness", 5, "--out")
    for folder in (tmp_path / "file" / "inside", tmp_path / ("x" * 300)):
        code, _, err = run(capsys, *small, folder)
        assert code == 2
        assert "cannot be written to" in err

    def fill(*_, **__):
        raise RuntimeError("NetCDF: HDF error")

    monkeypatch.setattr("jaxrock.spectra.resonance._apply_to_scenes", fill)
    code, _, err = run(capsys, *small, tmp_path / "new")
    assert code == 2
    assert "cannot be written to: NetCDF" in err
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.thorough
def test_as_a_module():
    """In a process of its own, where nothing but the command can turn on float64."""
    command = [sys.executable, "-m", "jaxrock", "assess", *map(str, WALL), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    answers = json.loads(done.stdout)
    assert answers["scene"]["critical_angle"] == pytest.approx(0.19739555984988075, rel=1e-15)
    assert done.stderr == ""
