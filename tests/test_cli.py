"""The commands as a user calls them, in this process; one of them in its own."""

import csv
import json
import math
import os
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
from jaxrock.calibration import cross_validate, fit_free_rocking, read_impact_times, read_tests
from jaxrock.cli import application
from jaxrock.cli.answers import Answer
from jaxrock.cli.options import Output
from jaxrock.host import announce
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
    _, details, _ = run(capsys, "assess", *pulses, "--details")
    assert text in details
    assert re.search(
        r"elasticities of the rotation ratio: width at this height +-2\.2", details
    )
    assert re.search(r"stabilized: amplification +11\.", details)
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
def test_rocking_spectrum(capsys, tmp_path):
    few = ("--free-period", 2, 4, "--record", "example", "--out", tmp_path / "out")
    _, text, _ = run(capsys, "rocking-spectrum", *few)
    assert "6 blocks" in text
    assert_follows_cf(tmp_path / "out" / "rocking_spectrum.nc")
    with xarray.open_dataset(tmp_path / "out" / "rocking_spectrum.nc") as dataset:
        expected = jr.rocking_spectrum(jr.example_record(), [2.0, 4.0], [4.0, 6.0, 8.0], 0.9)
        np.testing.assert_array_equal(dataset.rotation_ratio, expected.rotation_ratio)


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


def test_critical(capsys, tmp_path):
    counts = ("--half-cycles", 1, "inf")
    rows = read_answer(capsys, "critical", *SLIM, *counts, "--out", tmp_path / "closed")[
        "rows"
    ]
    assert [row["half_cycles"] for row in rows] == [1, 1, None, None]
    expected = float(jr.critical_intensity(BLOCK, 0.9, 1.0, jr.Nonlinear()))
    assert rows[1]["critical_intensity"] == pytest.approx(expected, rel=1e-12)
    width = float(jr.critical_width(BLOCK, 0.9, 0.15, fixed="height"))
    assert rows[2]["width_at_this_height"] == pytest.approx(width, rel=1e-9)
    _, table = read_csv(tmp_path / "closed" / "critical.csv")
    assert "critical_intensity [m/s]" in table
    sine = ("--pulse", "sine", "--pulse-duration", 0.5, "--out", tmp_path / "pulse")
    _, text, _ = run(capsys, "critical", *SLIM, *sine)
    assert "stands beyond 7.706 m/s2 (0.786 g) (overturning after 1 impact)" in text
    assert "amplitude 1.962 m/s2 (0.2 g) just lifts the block" in text
    _, table = read_csv(tmp_path / "pulse" / "critical.csv")
    assert len(table["amplitude [m/s2]"]) == 3


@pytest.mark.thorough
def test_critical_factors_and_short_pulses(capsys):
    block = jr.Block.from_size(width=0.6, height=1.8)
    cabinet = ("critical", "--width", 0.6, "--height", 1.8, "--restitution", 0.85)
    found = read_answer(capsys, *cabinet, "--record", "example", "--scale", 0.5)
    motion = jr.example_record().scaled(0.5)
    factors = found["uplift_factor"] * np.geomspace(1, 50, 1568)
    first = jr.overturning_boundaries(block, 0.85, motion, "factor", factors).value[0]
    assert found["rows"][0]["factor"] == pytest.approx(float(first), rel=1e-12)
    assert found["examined"][1] == pytest.approx(50 * found["uplift_factor"])
    short = ("--pulse", "half-sine", "--pulse-duration", 0.04)
    amplitude = read_answer(capsys, *cabinet, *short)["rows"][0]["amplitude"]
    assert amplitude > 10 * 9.81 / 3
    for factor, falls in ((0.999, False), (1.001, True)):
        pulse = jr.HalfSine(factor * amplitude, 0.04)
        assert bool(jr.respond(block, 0.85, pulse).overturned) == falls


@pytest.mark.thorough
def test_sensitivity(capsys, tmp_path):
    """alpha_max / alpha_c = (I / I_c)^2 / 2 in weak motion, and more near the verge."""
    asked = ("--restitution", 0.7, "--answer", "rotation-ratio", "--out", tmp_path / "out")
    size = ("--width", 0.8, "--slenderness", 5, "--coefficient-of-variation", 0.04)
    found = read_answer(capsys, "sensitivity", *size, *asked)
    rows = {row["quantity"]: row for row in found["rows"]}
    assert rows.keys() == {"half_width", "slenderness", "restitution", "intensity"}
    assert 2 < rows["intensity"]["elasticity"] < 2.2
    assert rows["restitution"]["at_low"] < found["value"] < rows["restitution"]["at_high"]
    assert found["within_tolerance"] is True
    falls = ("--answer", "stabilized-period", "--intensity", 5, "--out", tmp_path / "falls")
    code, _, err = run(capsys, "sensitivity", *WALL, *falls)
    assert code == 2
    assert "the block overturns" in err


@pytest.mark.thorough
def test_driven_sensitivity(capsys, tmp_path):
    asked = ("--samples", 64, "--answer", "margin", "--out", tmp_path / "out")
    found = read_answer(capsys, "driven-sensitivity", *SLIM, *SINE, *asked)
    coefficients = dict.fromkeys(
        ("half_width", "slenderness", "restitution", "amplitude", "duration"), 0.05
    )
    uncertain = jr.Uncertain(coefficients, samples=64)
    pulse = jr.Sine(3.0, 0.5)
    expected = jr.sensitivity.outcome_probabilities(BLOCK, 0.9, pulse, uncertain)
    printed = [row["probability"] for row in found["probabilities"]]
    assert printed == pytest.approx(expected.probability.tolist())
    by = tuple(coefficients)
    local = jr.derivatives_within(BLOCK, 0.9, pulse, 1e-6, of="margin", by=by)
    rows = {row["quantity"]: row for row in found["rows"]}
    assert rows.keys() == set(coefficients)
    for part in ("derivative", "error", "below", "above"):
        printed = [rows[name][part] for name in coefficients]
        assert printed == pytest.approx([float(x) for x in getattr(local, part).values()])
    suite = ("--records", "example", "--samples", 16, "--scale", 2)
    found = read_answer(capsys, "driven-sensitivity", *SLIM, *suite, *asked[-2:], "--force")
    assert "record" in {row["quantity"] for row in found["rows"]}


@pytest.mark.thorough
def test_harmonic(capsys, tmp_path):
    few = ("--width", 0.4, "--height", 2, "--restitution", 0.9, "--cycles", 20)
    axes = ("--frequency-ratio", 2, 6, "--amplitude-ratio", 0.5, 3, "--out", tmp_path / "out")
    found = read_answer(capsys, "harmonic", *few, *axes)
    assert found["uplift_amplitude"] == pytest.approx(9.81 / 5)
    unit = float(jr.Block.from_size(width=0.4, height=2.0).frequency_parameter) / (2 * np.pi)
    assert [row["frequency"] for row in found["rows"]] == pytest.approx([2 * unit, 6 * unit])
    assert sum(found["region"].values()) == pytest.approx(1)
    assert_follows_cf(tmp_path / "out" / "harmonic.nc")


@pytest.mark.thorough
def test_fit(capsys, tmp_path, monkeypatch):
    """A file and nothing else; the fit is that of the library."""
    monkeypatch.chdir(tmp_path)
    write_inputs(tmp_path)
    code, text, _ = run(capsys, "fit", "times.csv")
    assert code == 0
    times, _ = read_impact_times("times.csv")
    expected = fit_free_rocking(times)
    assert text == f"{expected}\nfit/fit.csv\nfit/fit.png\n"
    _, table = read_csv(Path("fit/fit.csv"))
    np.testing.assert_array_equal([float(cell) for cell in table["time [s]"]], times)
    found = read_answer(capsys, "fit", "times.csv", "--force")
    assert found["critical_angle"] is None
    assert found["restitution"] == pytest.approx(float(expected.restitution), rel=1e-12)
    size = ("--width", 0.2, "--height", 1, "--time-noise", 2e-3, "--force")
    found = read_answer(capsys, "fit", "times.csv", *size)
    block = jr.Block.from_size(width=0.2, height=1.0)
    expected = fit_free_rocking(times, block, time_noise=2e-3)
    assert found["model"] == "nonlinear"
    assert found["restitution"] == pytest.approx(float(expected.restitution), rel=1e-9)


@pytest.mark.thorough
def test_validate(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_inputs(tmp_path)
    options = ("--splits", 2, "--samples", 64, "--seed", 1)
    found = read_answer(capsys, "validate", "tests.csv", *options)
    tests = read_tests("tests.csv")
    scores = cross_validate(
        tests.suite,
        tests.overturned,
        tests.groups,
        splits=2,
        samples=64,
        seed=1,
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
def test_help(capsys, name):
    """Every option says what it is, and every command has an example."""
    code, text, _ = run(capsys, name, "--help")
    assert code == 0
    assert f"Example: jaxrock {name} " in text
    assert "None" not in text
    _, *options = re.split(r"^.? --", text, flags=re.MULTILINE)
    for option in options:
        described = option.split("(default")[0]
        assert sum(word.isalpha() and word.islower() for word in described.split()) > 1, option


def fake(monkeypatch, command):
    """Let a function be the only command."""
    monkeypatch.setattr(application, "COMMANDS", {"Commands": (command,)})


def test_warnings_and_messages_are_lines(capsys, monkeypatch):
    """And no backend is needed that may not exist."""
    monkeypatch.setenv("MPLBACKEND", "nonsense")

    def speak(*, output: Output = Output()) -> Answer:
        warnings.warn("something was left", stacklevel=1)
        announce("timing takes some 6 s")
        return Answer(os.environ["MPLBACKEND"], {"value": math.nan}, output)

    fake(monkeypatch, speak)
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        code, out, err = run(capsys, "speak")
        assert (code, out) == (0, "agg\n")
        lines = ["warning: something was left", "timing takes some 6 s"]
        assert err.splitlines() == [f"jaxrock: {line}" for line in lines]
        _, out, _ = run(capsys, "speak", "--json")
    assert json.loads(out) == {"value": None}
    # Nothing of it stays: the library itself logs, and shows nothing.
    announce("words")
    assert capsys.readouterr() == ("", "")


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
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_standard_output_that_cannot_be_written(capsys, monkeypatch):
    with open("/dev/full", "w") as full:
        monkeypatch.setattr("sys.stdout", full)
        code, _, err = run(capsys, "assess", *WALL)
        assert code == 2
        assert "No space left on device" in err


@pytest.mark.thorough
def test_as_a_module():
    """In a process of its own, where nothing but the command can turn on float64."""
    command = [sys.executable, "-m", "jaxrock", "assess", *map(str, WALL), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    answers = json.loads(done.stdout)
    assert answers["scene"]["critical_angle"] == pytest.approx(0.19739555984988075, rel=1e-15)
    assert done.stderr == ""
