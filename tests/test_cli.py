"""The commands as a user calls them, in this process; one of them in its own."""

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
from tools.selection import first_by_default

import jaxrock as jr
from jaxrock.cli import application, main
from jaxrock.cli.answers import Answer, describe_options
from jaxrock.cli.motion_options import MotionOptions, SuiteOptions
from jaxrock.cli.options import BlockOptions, Output
from jaxrock.host import announce

TABLES = Path(__file__).parent / "tables"

pytestmark = pytest.mark.float64


def without_remarks(path):
    """The lines at the top that say what a table was computed from, and the table."""
    lines = path.read_text(encoding="utf-8").splitlines()
    return [x for x in lines if x.startswith("#")], [x for x in lines if not x.startswith("#")]


def test_assess(capsys):
    pulses = ("--restitution", 0.7, "--intensity", 0.15)
    code, out, _ = run(capsys, "assess", "--width", 0.8, "--height", 4, *pulses)
    assert code == 0
    assert "slenderness 5), C = 0.7, pulses of 0.15 m/s\n" in out
    assert "settles at 12.4 %" in out
    assert "width at this height [1/m]" in out
    code, out, _ = run(capsys, "assess", "--width", 0.8, "--slenderness", 5, *pulses)
    assert "half-width at this slenderness [1/m]" in out
    overturned = ("assess", "--width", 0.8, "--slenderness", 5, "--intensity", 0.15)
    code, out, _ = run(capsys, *overturned)
    assert "C = 0.942 (Housner's, assumed), pulses of 0.15 m/s\n" in out
    assert not re.search(r"none|derivative|period|zeta", out)
    code, out, _ = run(capsys, *overturned, "--json")
    assert code == 0
    answers = json.loads(out)
    assert answers["scene"]["restitution"] == answers["scene"]["housner_restitution"]
    assert answers["scene"]["restitution_assumed"] is True
    assert answers["models"]["nonlinear"]["stabilized"]["period"] is None


def test_without_an_intensity_nothing_is_said_of_pulses(capsys):
    code, out, _ = run(capsys, "assess", "--width", 0.8, "--slenderness", 5)
    assert code == 0
    assert not re.search(r"none|0\.15|half-cycle \d|margin|derivative|after one pulse", out)
    assert out.splitlines()[-3].startswith("  unlimited [m/s]")
    assert out.endswith(
        "A single pulse overturns it above 1.04 m/s (nonlinear). Unlimited pulses do above"
        " 0.0599 m/s, each right after an impact.\n"
    )
    _, out, _ = run(capsys, "assess", "--width", 0.8, "--slenderness", 5, "--json")
    answers = json.loads(out)
    assert "intensity" not in answers["scene"]
    assert answers["models"]["nonlinear"].keys() == {"critical_velocity", "critical_intensity"}
    assert "null" not in out


@pytest.mark.thorough
def test_an_assumed_restitution_is_named(capsys, tmp_path):
    """By every command that answers for one block, and in the files."""
    slim = ("--width", 0.2, "--slenderness", 5)
    pulse = ("--pulse", "half-sine", "--amplitude", 3, "--pulse-duration", 0.2)
    few = ("--frequency", 1, 2, "--amplitude", 3, "--cycles", 5)
    lines = (
        ("assess", *slim),
        ("critical", *slim),
        ("respond", *slim, *pulse, "--out", tmp_path / "respond"),
        ("sensitivity", *slim, "--out", tmp_path / "sensitivity"),
        ("harmonic", *slim, *few, "--out", tmp_path / "harmonic"),
    )
    for line in lines:
        code, out, _ = run(capsys, *line)
        assert code == 0
        assert out.count("C = 0.942 (Housner's, assumed)") == 1, line
    about, _ = without_remarks(tmp_path / "respond" / "impacts.csv")
    assert "# restitution_assumed: 1" in about
    _, out, _ = run(capsys, *lines[3], "--restitution", 0.9, "--force")
    assert "assumed)" not in out
    about, _ = without_remarks(tmp_path / "sensitivity" / "sensitivity.csv")
    assert not any("assumed" in line for line in about)
    given = ("--along", "restitution", "--values", 0.5, 0.9)
    _, out, _ = run(capsys, "critical", *slim, *pulse, *given)
    assert "assumed)" not in out
    for command, assumed in (("spectrum", "0.6, 0.7, 0.8"), ("rocking-spectrum", "0.9")):
        axis = ("--slenderness", 5, "--out", tmp_path / command)
        axis += ("--free-period", 2) if command == "rocking-spectrum" else ()
        _, out, _ = run(capsys, command, *axis)
        assert f"\nC = {assumed} (assumed)\n" in out


SINE = ("--pulse", "sine", "--pulse-duration", 0.5)
SMALL = ("--slenderness", "3:10:8", "--width", 0.4, 1.2, "--restitution", 0.6, 0.8)


def test_spectrum(capsys, tmp_path):
    out = tmp_path / "deep" / "er"
    code, text, _ = run(capsys, "spectrum", "--out", out, *SMALL)
    assert code == 0
    names = ["spectrum.csv", "spectrum.nc", "spectrum.png"]
    assert sorted(path.name for path in out.iterdir()) == names
    assert "32 scenes" in text
    with xarray.open_dataset(out / "spectrum.nc") as dataset:
        assert dict(dataset.sizes) == {"slenderness": 8, "width": 2, "restitution": 2}
        overturned = float((dataset.overturning_margin <= 0).mean())
    before = (out / "spectrum.nc").read_bytes()
    code, _, err = run(capsys, "spectrum", "--out", out, *SMALL)
    assert code == 2
    assert "spectrum.nc' exists; --force overwrites it" in err
    assert (out / "spectrum.nc").read_bytes() == before
    nonlinear = ("--model", "nonlinear", "--force", "--json")
    code, text, _ = run(capsys, "spectrum", "--out", out, *SMALL, *nonlinear)
    assert code == 0
    assert json.loads(text)["overturned"] == overturned
    with xarray.open_dataset(out / "spectrum.nc") as dataset:
        assert dataset.attrs["model"] == "nonlinear"


def fake(monkeypatch, command):
    """Let a function be the only command."""
    monkeypatch.setattr(application, "COMMANDS", (command,))


def read_wrong_commands():
    """Each command line that is refused, and the sentence."""
    lines = (TABLES / "wrong_commands.txt").read_text(encoding="utf-8").splitlines()
    lines = [line for line in lines[3:] if line and not line.startswith("#")]
    return list(zip(lines[::2], (line.strip() for line in lines[1::2]), strict=True))


def write_inputs(folder):
    """Write the files that commands read."""
    (folder / "objects.csv").write_text("name,width [m],height [m]\nbust,0.4,1.6\n")
    (folder / "facade.csv").write_text(
        "name,width [m],height [m],one-sided,floor period [s]\nfacade,0.4,4,yes,0.3\n"
    )
    (folder / "hazard.csv").write_text("pgv [m/s],rate [1/yr]\n0.1,2e-2\n1,1e-4\n")
    (folder / "motion.csv").write_text("time [s],acc [g]\n0,0\n0.2,0.4\n0.4,-0.4\n0.6,0\n")
    (folder / "tests.csv").write_text(
        "file,scale,overturned\nmotion.csv,1,no\nmotion.csv,2,yes\n"
    )
    (folder / "sites.csv").write_text(
        "# investigation_time=50.0, imt=PGA\nlon,lat,poe-0.1,poe-0.3\n10.5,45,0.5,0.1\n"
        "11.5,46,0.4,0.05\n"
    )
    (folder / "short.csv").write_text("time [s]\n0\n0.964\n")
    times = "time [s]\n0\n0.964\n1.636\n2.173\n2.623\n3.007\n3.34\n"
    (folder / "times.csv").write_text(times)


@pytest.mark.parametrize("part", first_by_default(range(4)))
def test_every_wrong_command_ends_with_one_sentence(part, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_inputs(tmp_path)
    before = sorted(tmp_path.iterdir())
    wrong_commands = read_wrong_commands()[part::4]
    assert len(wrong_commands) > 25
    answers = {}
    for words, _ in wrong_commands:
        code, out, err = run(capsys, *shlex.split(words))
        # A slow machine says how long it has read records.
        lines = err.splitlines(keepends=True)
        said = "".join(line for line in lines if "reading records: " not in line)
        answers[words] = (code, out, said)
    expected = {
        words: (2, "", f"jaxrock: error: {sentence}\n") for words, sentence in wrong_commands
    }
    assert answers == expected
    assert sorted(tmp_path.iterdir()) == before
    sentence = "jaxrock: error: a command must be given; --help lists them\n"
    assert run(capsys) == (2, "", sentence)


def test_ctrl_c_is_one_line(capsys, monkeypatch):
    def interrupted(*, output: Output = Output()) -> Answer:
        raise KeyboardInterrupt

    fake(monkeypatch, interrupted)
    assert run(capsys, "interrupted") == (130, "", "jaxrock: interrupted\n")


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


def test_the_current_folder_may_be_gone(capsys, tmp_path, monkeypatch):
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    here.rmdir()
    said = "jaxrock: error: the current folder is gone; change to one that exists\n"
    assert run(capsys, "critical") == (2, "", said)


def test_options_are_written_into_files():
    """What was given or is used; neither what was not, nor where the answer goes."""
    options = {
        "intensity": 0.0,
        "values": ("1:2:3", 5.0),
        "model": None,
        "animate": False,
        "out": Path("folder"),
        "output": Output(json=True),
        "block_options": BlockOptions(width=0.4, height=2.0),
        "motion_options": MotionOptions(pulse="sine"),
    }
    about = describe_options("critical", options)
    block = jr.Block(0.2, 5.0)
    assert about.pop("restitution") == pytest.approx(float(jr.housner_restitution(block)))
    inertia = about.pop("inertia_ratio")
    assert inertia == pytest.approx(4 / 3)
    assert about == {
        "source": f"jaxrock {jr.__version__}",
        "command": "critical",
        "intensity": 0.0,
        "values": "1:2:3 5.0",
        "width": 0.4,
        "height": 2.0,
        "slenderness": 5.0,
        "restitution_assumed": 1,
        "gravity": 9.81,
        "pulse": "sine",
    }


@pytest.mark.parametrize("name", [f.__name__.replace("_", "-") for f in application.COMMANDS])
def test_help(capsys, name):
    """Every option says what it is, and every command has an example."""
    code, text, _ = run(capsys, name, "--help")
    assert code == 0
    assert f"Example: jaxrock {name} " in text
    _, *options = re.split(r"^.? --", text, flags=re.MULTILINE)
    assert options
    for option in options:
        described = option.split("(default")[0]
        assert sum(word.isalpha() and word.islower() for word in described.split()) > 1, option


def test_help_is_grouped_and_hides_what_is_none(capsys):
    _, text, _ = run(capsys, "critical", "--help")
    titles = re.findall(r"^╭─ ([A-Za-z ]+) ─", text, re.M)
    assert titles == ["Parameters", "Block", "Ground motion", "Output"]
    assert "None" not in text
    assert "--width FLOAT" in text.partition("─ Block")[2].partition("─ Ground motion")[0]
    assert "Full width 2b of the base [m]" in text
    assert max(map(len, text.splitlines())) <= 100


def test_gravity_reaches_the_answers(capsys, tmp_path):
    for size in (("--height", 4), ("--slenderness", 5)):
        _, out, _ = run(capsys, "assess", *size, "--gravity", 1.62, "--json")
        assert json.loads(out)["scene"]["gravity"] == 1.62
    run(capsys, "spectrum", "--out", tmp_path, *SMALL, "--gravity", 1.62)
    with xarray.open_dataset(tmp_path / "spectrum.nc") as dataset:
        assert dataset.attrs["gravity"] == 1.62


@pytest.mark.thorough
def test_inertia_ratio_reaches_the_answers(capsys, tmp_path):
    body = ("--inertia-ratio", 1.1)
    block = jr.Block(0.4, 5.0, inertia_ratio=1.1)
    for size in (("--height", 4), ("--slenderness", 5)):
        _, out, _ = run(capsys, "assess", *size, *body, "--json")
        scene = json.loads(out)["scene"]
        assert scene["inertia_ratio"] == 1.1
        assert scene["height"] == 4
        assert scene["frequency_parameter"] == pytest.approx(float(block.frequency_parameter))
        assert scene["restitution"] == pytest.approx(float(jr.housner_restitution(block)))
    _, out, _ = run(capsys, "critical", "--restitution", 0.7, *body, "--json")
    intensity = json.loads(out)["rows"][0]["critical_intensity"]
    assert intensity == pytest.approx(float(jr.critical_intensity(block, 0.7, 1.0)))
    run(capsys, "spectrum", "--out", tmp_path, *SMALL, *body)
    few = ("--free-period", 2, 4, "--slenderness", 5, "--scale", 0.1)
    run(capsys, "rocking-spectrum", "--out", tmp_path, *few, *body)
    for name in ("spectrum", "rocking_spectrum"):
        with xarray.open_dataset(tmp_path / f"{name}.nc") as dataset:
            assert dataset.attrs["inertia_ratio"] == 1.1
    for command in ("assess", "spectrum", "rocking-spectrum"):
        code, _, err = run(capsys, command, "--inertia-ratio", 0.9)
        assert code == 2
        assert "--inertia-ratio must be finite and at least 1, got 0.9" in err


def test_a_folder_that_cannot_be_written(capsys, tmp_path):
    (tmp_path / "file").write_text("in the way")
    for command in (("spectrum", *SMALL), ("paper",)):
        code, _, err = run(capsys, *command, "--out", tmp_path / "file" / "inside")
        assert code == 2
        assert "cannot be written to" in err
    long = "x" * 300
    code, _, err = run(capsys, "spectrum", *SMALL, "--out", tmp_path / long)
    assert code == 2
    assert "cannot be written to: File name too long" in err
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_disk_that_fills_up(capsys, tmp_path, monkeypatch):
    def full(*_, **__):
        raise RuntimeError("NetCDF: HDF error")

    monkeypatch.setattr("jaxrock.spectra.resonance._apply_to_scenes", full)
    code, _, err = run(capsys, "spectrum", "--out", tmp_path / "new", *SMALL)
    assert code == 2
    assert f"out: the folder {str(tmp_path / 'new')!r} cannot be written to: NetCDF" in err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.thorough
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
@pytest.mark.parametrize("arguments", first_by_default([["critical"], ["critical", "--json"]]))
def test_standard_output_that_cannot_be_written(capsys, monkeypatch, arguments):
    with open("/dev/full", "w") as full:
        monkeypatch.setattr("sys.stdout", full)
        code, _, err = run(capsys, *arguments)
        assert code == 2
        said = "standard output cannot be written to: No space left on device"
        assert err == f"jaxrock: error: {said}\n"
    reader, writer = os.pipe()
    os.close(reader)
    with open(writer, "w") as pipe:
        monkeypatch.setattr("sys.stdout", pipe)
        code, _, err = run(capsys, *arguments)
        assert (code, err) == (141, "")


@pytest.mark.thorough
def test_paper(capsys, tmp_path):
    code, text, _ = run(capsys, "paper", "--out", tmp_path / "paper", "--json")
    assert code == 0
    outcome = json.loads(text)
    assert (outcome["agreeing"], outcome["printed"]) == (93, 94)
    assert outcome["mismatches"] == []
    code, _, err = run(capsys, "paper", "--out", tmp_path / "paper")
    assert code == 2
    assert "report.md' exists; --force overwrites it" in err


@pytest.mark.thorough
def test_paper_fails_on_a_mismatch(capsys, tmp_path, monkeypatch):
    from jaxrock.reports import paper

    tables = paper.read_printed_tables()
    tables["tables"][0]["printed"][0][0] = "3.84e-3"
    monkeypatch.setattr(paper, "read_printed_tables", lambda: tables)
    code, text, _ = run(capsys, "paper", "--out", tmp_path / "paper")
    assert code == 1
    assert "\nmismatch: Table I, peak rotation" in text
    assert str(tmp_path / "paper" / "report.md") in text.splitlines()
    assert "printed 3.84e-3" in (tmp_path / "paper" / "report.md").read_text(encoding="utf-8")


@pytest.mark.thorough
def test_as_a_module():
    """In a process of its own, where nothing but the command can turn on float64."""
    command = [sys.executable, "-m", "jaxrock", "assess", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    answers = json.loads(done.stdout)
    assert answers["scene"]["critical_angle"] == pytest.approx(0.19739555984988075, rel=1e-15)
    done = subprocess.run(
        [sys.executable, "-m", "jaxrock", "--help"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0
    assert all(command in done.stdout for command in ("assess", "spectrum", "paper"))
    assert done.stderr == ""


@pytest.mark.thorough
@pytest.mark.float64
def test_respond(tmp_path, capsys):
    out = tmp_path / "out"
    pulse = "respond --pulse sine --amplitude 3 --pulse-duration 0.5 --duration 1"
    main([*pulse.split(), "--out", str(out), "--animate", "--json"])
    answer = json.loads(capsys.readouterr().out)
    block = jr.Block(0.4, 5.0)
    expected = jr.respond(block, float(jr.housner_restitution(block)), jr.Sine(3.0, 0.5), 1.0)
    assert answer["peak_rotation"] == pytest.approx(float(expected.peak_rotation), rel=1e-9)
    assert answer["impacts"] == expected.impacts
    assert answer["status"] == "complete"
    assert answer["uplift_factor"] == pytest.approx(9.81 / 5 / 3, rel=1e-9)
    weak = "respond --pulse sine --amplitude 1 --scale 0.5 --pulse-duration 0.5 --duration 1"
    main([*weak.split(), "--out", str(tmp_path / "weak")])
    sentence = (
        "the block is not lifted; it lifts once the motion is multiplied by 3.924 or more"
        " (--scale 1.962)"
    )
    assert sentence in capsys.readouterr().out.splitlines()
    assert_follows_cf(out / "response.nc")
    names = {"response.csv", "impacts.csv", "response.nc", "response.png", "response.gif"}
    assert {path.name for path in out.iterdir()} == names
    about, rows = without_remarks(out / "impacts.csv")
    assert "# pulse: sine" in about
    assert rows[0] == "time [s],velocity_before [rad/s]"
    assert len(rows) == int(expected.impacts) + 1


@pytest.mark.thorough
def test_rocking_spectrum(tmp_path, capsys):
    out = tmp_path / "out"
    main(["rocking-spectrum", "--free-period", "2", "4", "--out", str(out)])
    assert "6 blocks" in capsys.readouterr().out
    assert len(list(out.iterdir())) == 3
    assert_follows_cf(out / "rocking_spectrum.nc")


@pytest.mark.thorough
def test_fragility(tmp_path, capsys):
    """Of two records, on which a hazard curve makes a rate."""
    for name, amplitude in (("a", 0.2), ("b", 0.3)):
        samples = amplitude * np.sin(np.linspace(0, 2 * np.pi, 150))
        rows = "".join(f"{4 * k},{value:.6f}\n" for k, value in enumerate(samples))
        (tmp_path / f"{name}.csv").write_text(f"time [ms],acc [g]\n{rows}")
    hazard = tmp_path / "hazard" / "curve.csv"
    hazard.parent.mkdir()
    hazard.write_text(
        "# kind='max', investigation_time=1, imt='PGV'\nlon,lat,poe-20,poe-200\n1,2,1e-2,1e-4\n"
    )
    options = ("--records", tmp_path, "--width", 0.2, "--slenderness", 5, "--restitution", 0.8)
    options += ("--threshold", 0.5, "overturning", "--levels", 0.2, 0.5, 0.8, "--json")
    out = tmp_path / "out"
    code, text, _ = run(
        capsys, "fragility", *options, "--hazard", hazard, "--elasticities", "--out", out
    )
    assert code == 0
    answer = json.loads(text)
    suite = jr.read_suite(tmp_path)
    block = jr.Block(0.1, 5.0)
    expected = jr.overturning_rate(block, 0.8, jr.Site(suite, jr.read_hazard(hazard)))
    assert answer["rate"] == pytest.approx(float(expected.rate), rel=1e-12)
    assert answer["hazard"].startswith("max hazard of pgv")
    assert answer["thresholds"] == ["0.5", "overturning"]
    assert answer["elasticities"]["half_width"] < 0
    assert len(list(out.iterdir())) == 3
    with xarray.open_dataset(out / "fragility.nc") as dataset:
        assert list(dataset.record.values) == ["a", "b"]
    _, table = without_remarks(out / "fragility.csv")
    assert len(table) == 1 + 3 * 2
    # The same with an uncertain restitution: as the library has it.
    with_uncertainty = (*options, "--uncertain", "restitution=0.05", "--samples", 4)
    code, text, _ = run(
        capsys, "fragility", *with_uncertainty, "--out", tmp_path / "uncertain"
    )
    assert code == 0
    uncertain = jr.Uncertain({"restitution": 0.05}, samples=4)
    curves = jr.fragility(
        block,
        0.8,
        suite,
        [0.2, 0.5, 0.8],
        "pgv",
        (0.5, "overturning"),
        uncertain=uncertain,
    )
    with xarray.open_dataset(tmp_path / "uncertain" / "fragility.nc") as dataset:
        np.testing.assert_array_equal(dataset.exceedance, curves.exceedance)
    assert json.loads(text)["dispersion"] == curves.lognormal_dispersion.values.tolist()


@pytest.mark.thorough
def test_a_wall_and_a_floor_reach_the_library(capsys, tmp_path):
    wall = ("--width", 0.6, "--height", 6, "--one-sided")
    motion = ("--record", "example", "--scale", -1, "--floor-period", 0.4)
    others = ("--floor-damping", 0.1, "--json", "--out", tmp_path / "out")
    code, text, _ = run(capsys, "respond", *wall, *motion, *others)
    assert code == 0
    block = jr.Block.from_size(width=0.6, height=6.0, one_sided=True)
    motion = jr.example_record().on_floor(0.4, 0.1).scaled(-1.0)
    expected = jr.respond(block, jr.one_sided_restitution(block), motion, motion.end + 10)
    answer = json.loads(text)
    assert answer["peak_rotation"] == pytest.approx(float(expected.peak_rotation), rel=1e-9)
    with xarray.open_dataset(tmp_path / "out" / "response.nc") as dataset:
        assert dataset.attrs["one_sided"] == 1
        assert dataset.attrs["floor_period"] == 0.4
        assert float(dataset.rotation.min()) >= 0
    # Records come in both directions where the direction matters.
    suite = SuiteOptions(floor_period=0.4)
    assert suite.read_suite(one_sided=True).directions == 2
    assert suite.read_suite().directions == 1
    assert float(suite.read_suite().floor.damping) == pytest.approx(0.05)
    reversed_suite = SuiteOptions(direction="reversed").read_suite(one_sided=True)
    assert reversed_suite.names == tuple(f"{n} reversed" for n in jr.example_suite().names)


def test_critical(capsys, tmp_path):
    block = ("--width", 0.8, "--slenderness", 5, "--restitution", 0.7)
    code, text, _ = run(capsys, "critical", *block, "--half-cycles", 1, 5, "--json")
    assert code == 0
    rows = json.loads(text)["rows"]
    assert [(row["half_cycles"], row["model"]) for row in rows] == [
        (1, "linearized"), (1, "nonlinear"), (5, "linearized"), (5, "nonlinear")
    ]  # fmt: skip
    expected = float(jr.critical_intensity(jr.Block(0.4, 5.0), 0.7, 5.0))
    assert rows[2]["critical_intensity"] == pytest.approx(expected, rel=1e-12)
    sine = ("critical", "--width", 0.2, "--pulse", "sine", "--pulse-duration", 0.5)
    code, text, _ = run(capsys, *sine, "--restitution", 0.9, "--out", tmp_path / "found")
    assert code == 0
    assert "stands beyond 7.706 m/s2 (0.786 g) (overturning after 1 impact)" in text
    about, table = without_remarks(tmp_path / "found" / "critical.csv")
    assert table[0] == "amplitude [m/s2],overturns_beyond,impacts,toppled"
    assert len(table) == 4
    assert {"# command: critical", "# restitution: 0.9", "# slenderness: 5.0"} <= set(about)
    mild = ("--along", "slenderness", "--values", "1", "1.5", "--amplitude", 0.5)
    code, text, _ = run(capsys, *sine, *mild, "--out", tmp_path / "none")
    assert code == 0
    assert (
        "the block as given lifts once the motion is multiplied by 3.924 or more\n"
        "no boundary: it stands at all of the values examined; --values sets other values"
    ) in text
    _, table = without_remarks(tmp_path / "none" / "critical.csv")
    assert table == ["slenderness [-],overturns_beyond,impacts,toppled"]


@pytest.mark.thorough
def test_critical_factors_of_a_record(capsys, tmp_path):
    """From uplift on until it overturns, however weak the record is."""
    block = jr.Block.from_size(width=0.6, height=1.8)
    weak = ("critical", "--record", "example", "--scale", 0.5, "--width", 0.6, "--height", 1.8)
    code, text, _ = run(capsys, *weak, "--restitution", 0.85, "--out", tmp_path / "out")
    assert code == 0
    motion = jr.example_record().scaled(0.5)
    uplift = float(jr.overturning.uplift_factor(block, motion))
    lines = text.splitlines()
    assert lines[0] == ("block 0.6 m wide, 1.8 m high, C = 0.85; record example times 0.5")
    assert lines[1] == f"the block lifts once the motion is multiplied by {uplift:.4g} or more"
    first = jr.overturning.critical_factor(block, 0.85, motion).value[0]
    assert first > 5
    assert lines[2].startswith(f"overturns beyond {first:.6g} ")
    assert f"the search ended at factor {50 * uplift:.4g}, 50 times uplift" in lines
    files = {path.name for path in (tmp_path / "out").iterdir()}
    assert files == {"critical.csv", "critical.png"}
    # A block as heavy as a house stands; the bound is named, and the uplift is said in JSON.
    house = ("critical", "--record", "example", "--width", 900, "--height", 900)
    warnings.simplefilter("default")
    code, text, err = run(capsys, *house, "--restitution", 0.3, "--json")
    assert code == 0
    sentence = "the block is 900 m wide and 900 m high; lengths are in metres"
    assert err == f"jaxrock: warning: {sentence}\n"
    found = json.loads(text)
    assert found["rows"] == []
    assert found["examined"][1] == pytest.approx(50 * found["uplift_factor"])
    code, text, _ = run(capsys, *house, "--restitution", 0.3)
    assert "\nthe block stands up to factor " in text
    assert ", 50 times uplift; --values sets other values\n" in text


@pytest.mark.thorough
def test_a_record_that_never_lifts(capsys, tmp_path):
    (tmp_path / "still.csv").write_text("acc [g]\n" + "0\n" * 50)
    still = ("--record", tmp_path / "still.csv", "--time-step", 0.01, "--width", 0.4)
    code, _, err = run(capsys, "critical", *still)
    assert code == 2
    assert err == (
        "jaxrock: error: motion must lift the block at some factor, but no factor on it does\n"
    )
    code, text, _ = run(capsys, "respond", *still, "--out", tmp_path / "out")
    assert code == 0
    assert "\nno factor on the motion lifts the block\n" in text


@pytest.mark.thorough
def test_a_short_pulse_is_followed_beyond_ten_times_uplift(capsys):
    short = ("--pulse", "half-sine", "--pulse-duration", 0.04, "--restitution", 0.8)
    code, text, _ = run(capsys, "critical", "--width", 0.6, "--height", 1.8, *short, "--json")
    assert code == 0
    found = json.loads(text)
    assert found["uplift_amplitude"] == pytest.approx(9.81 / 3)
    amplitude = found["rows"][0]["amplitude"]
    assert amplitude > 10 * 9.81 / 3
    block = jr.Block.from_size(width=0.6, height=1.8)
    for factor, falls in ((0.999, False), (1.001, True)):
        pulse = jr.HalfSine(factor * amplitude, 0.04)
        assert bool(jr.respond(block, 0.8, pulse).overturned) == falls


def test_widths_at_this_height_and_at_this_slenderness(capsys, tmp_path):
    sides = ("critical", "--width", 0.6, "--height", 1.8, "--restitution", 0.9)
    block = jr.Block.from_size(width=0.6, height=1.8)
    _, text, _ = run(capsys, *sides, "--half-cycles", "inf", "--json")
    row = json.loads(text)["rows"][0]
    for fixed in ("height", "slenderness"):
        expected = float(jr.critical_width(block, 0.9, 0.15, fixed=fixed))
        assert row[f"width_at_this_{fixed}"] == pytest.approx(expected, rel=1e-9)
    assert row["height_at_this_width"] == pytest.approx(0.6 * row["critical_slenderness"])
    _, text, _ = run(capsys, *sides, "--out", tmp_path / "closed")
    assert text.startswith("block 0.6 m wide, 1.8 m high, C = 0.9\n")
    about, table = without_remarks(tmp_path / "closed" / "critical.csv")
    # What was used by default is written, too: the numbers depend on it.
    assert {"# intensity: 0.15", "# half_cycles: 1.0 2.0 5.0 inf"} <= set(about)
    heads = "width_at_this_height [m],width_at_this_slenderness [m]"
    assert heads in table[0]
    assert "height_at_this_width [m]" in table[0]
    pulse = ("--pulse", "half-sine", "--pulse-duration", 0.4, "--amplitude", 7)
    for along, said in (
        ("width", "width at this height of 1.8 m"),
        ("height", "height at this width of 0.6 m"),
        ("half_width", "half-width at this slenderness of 3"),
    ):
        _, text, _ = run(capsys, *sides, *pulse, "--along", along, "--values", "0.2:3:29")
        assert said in text.splitlines()


def test_a_block_of_a_size_that_is_hardly_meant_gets_a_warning(capsys):
    with pytest.warns(UserWarning, match="the block is 800 m wide and 4000 m high; lengths"):
        assert BlockOptions(width=800.0).block.half_width == 400
    assert BlockOptions(width=8.0).block.half_width == 4


@pytest.mark.thorough
def test_sensitivity(capsys, tmp_path):
    out = tmp_path / "out"
    question = "--answer", "rotation-ratio", "--restitution", 0.7
    code, text, _ = run(capsys, "sensitivity", *question, "--out", out, "--json")
    assert code == 0
    found = json.loads(text)
    names = ["map.png", "sensitivity.csv", "tornado.png"]
    assert sorted(path.name for path in out.iterdir()) == names
    rows = {row["quantity"]: row for row in found["rows"]}
    # alpha_max / alpha_c = (I / I_c)^2 / 2 in weak motion, and more near the verge.
    assert 2 < rows["intensity"]["elasticity"] < 2.2
    assert rows["restitution"]["at_low"] < found["value"] < rows["restitution"]["at_high"]
    assert found["within_tolerance"] is True


@pytest.mark.thorough
def test_sensitivity_of_a_block_that_falls(capsys, tmp_path):
    """Its peak is where it lies, which depends on nothing."""
    falls = ("sensitivity", *SINE, "--amplitude", 9, "--width", 0.2, "--restitution", 0.9)
    code, _, err = run(capsys, *falls, "--out", tmp_path / "out")
    assert code == 2
    assert "--answer rotation-ratio does not exist here: the block overturns" in err
    assert not (tmp_path / "out").exists()


@pytest.mark.thorough
@pytest.mark.release
def test_sensitivity_of_a_driven_answer(capsys, tmp_path):
    pulse = ("--pulse", "half-sine", "--amplitude", 3.5, "--pulse-duration", 0.1)
    code, text, _ = run(
        capsys, "sensitivity", "--answer", "margin", *pulse, "--out", tmp_path / "out"
    )
    assert code == 0
    assert "; by the nonlinear model\n" in text
    assert "\nmargin 0." in text
    assert "the tangent explains" in text
    assert "\nduration  " in text


@pytest.mark.thorough
def test_tolerance(capsys, tmp_path):
    code, out, _ = run(capsys, "assess", "--intensity", 0.15, "--tolerance", 1e-3, "--json")
    assert code == 0
    assert json.loads(out)["choice"]["level"] == "nonlinear"
    auto = ("--model", "auto", "--tolerance", 0.01, "--out", tmp_path / "auto")
    code, _, _ = run(capsys, "spectrum", *SMALL, *auto)
    assert code == 0
    with xarray.open_dataset(tmp_path / "auto" / "spectrum.nc") as dataset:
        assert set(dataset.model.values.ravel()) == {0, 1}


@pytest.mark.thorough
def test_tradeoff(capsys, tmp_path):
    code, out, _ = run(capsys, "tradeoff", "--out", tmp_path / "t")
    assert code == 0
    assert "for 1e-04 use" in out
    assert_follows_cf(tmp_path / "t" / "tradeoff.nc")
    names = ["tradeoff.csv", "tradeoff.nc", "tradeoff.png"]
    assert sorted(path.name for path in (tmp_path / "t").iterdir()) == names


SINE_PULSE = ("--pulse", "sine", "--amplitude", 3, "--pulse-duration", 0.5)
# Every command that writes files, with what it cannot do without.
WRITING = {
    "spectrum": ("spectra", ()),
    "respond": ("respond", SINE_PULSE),
    "rocking-spectrum": ("spectra", ()),
    "fragility": ("fragility", ()),
    "inventory": (
        "inventory",
        ("objects.csv", "--hazard", "hazard.csv", "--target", 1e-4),
    ),
    "critical": ("critical", ()),
    "sensitivity": ("sensitivity", ()),
    "sensitivity of a driven answer": ("driven_sensitivity", SINE_PULSE),
    "harmonic": ("harmonic", ()),
    "fit": ("fit", ("times.csv",)),
    "validate": ("validate", ("tests.csv",)),
    "tradeoff": ("tradeoff", ()),
    "paper": ("paper", ()),
}


@pytest.mark.parametrize("name", WRITING)
def test_commands_write_where_and_how_they_are_told(capsys, tmp_path, monkeypatch, name):
    module, words = WRITING[name]
    monkeypatch.chdir(tmp_path)
    write_inputs(tmp_path)
    told = []

    def write_nothing(*arguments):
        told.append(arguments)
        raise ValueError("nothing is written")

    monkeypatch.setattr(f"jaxrock.cli.{module}.write_whole", write_nothing)
    command = (name.split(" ")[0], *words, "--out", "target")
    for force in (False, True):
        code, _, err = run(capsys, *command, *(["--force"] if force else []))
        # Before it there may be lines of progress, on a slow machine.
        assert (code, err.splitlines()[-1]) == (2, "jaxrock: error: nothing is written")
        assert told[-1][:2] == ("out", Path("target"))
        assert told[-1][3] is force


# Command lines, the function of the library that they call, and some of its arguments.
CALLS = {
    "spectrum": (
        "--model auto --tolerance 0.02 --gravity 1.62 --inertia-ratio 1.2",
        "jaxrock.cli.spectra.resonance_spectrum",
        {"model": "auto", "tolerance": 0.02, "gravity": 1.62, "inertia_ratio": 1.2},
    ),
    "rocking-spectrum": (
        "--inertia-ratio 1.2",
        "jaxrock.cli.spectra.compute_rocking_spectrum",
        {"inertia_ratio": 1.2},
    ),
    "fragility": (
        "--model linearized",
        "jaxrock.risk.fragility",
        {"model": "linearized", "uncertain": None},
    ),
    "fragility on a floor": (
        "--floor-period 0.3 --uncertain floor_period=0.2 --samples 4",
        "jaxrock.risk.fragility",
        {"uncertain": jr.Uncertain({"floor_period": 0.2}, samples=4)},
    ),
    "fragility of what is measured": (
        "--uncertain critical_angle=0.2 frequency_parameter=0.1",
        "jaxrock.risk.fragility",
        {"uncertain": jr.Uncertain({"critical_angle": 0.2, "frequency_parameter": 0.1})},
    ),
    "rocking-spectrum of walls": (
        "--one-sided --free-period 2 --slenderness 5",
        "jaxrock.cli.spectra.compute_rocking_spectrum",
        {"one_sided": True},
    ),
    "sensitivity in both directions": (
        "--records example --one-sided --slenderness 8 --scale -2",
        "jaxrock.cli.driven_sensitivity.outcome_probabilities",
        {"ratio": 0.5},
    ),
    "harmonic": (
        "--restitution 0.8 --cycles 7 --model linearized --slenderness 4 --inertia-ratio 1.2",
        "jaxrock.cli.harmonic.harmonic_spectrum",
        {
            "restitution": 0.8,
            "cycles": 7,
            "model": "linearized",
            "slenderness": 4.0,
            "inertia_ratio": 1.2,
        },
    ),
    "fit": (
        "times.csv --width 0.2 --height 1 --frequency-unknown --model linearized"
        " --time-noise 0.01 --no-repair",
        "jaxrock.cli.fit.fit_free_rocking",
        {
            "frequency_known": False,
            "model": "linearized",
            "time_noise": 0.01,
            "repair": False,
            "rotation_noise": None,
        },
    ),
    "respond": (
        "--pulse sine --amplitude 3 --pulse-duration 0.5 --model linearized",
        "jaxrock.driven.respond",
        {"model": "linearized"},
    ),
    "validate": (
        "tests.csv --seed 3 --samples 128 --model linearized --one-sided --gravity 9.8"
        " --prior critical_angle=0.2:0.1 restitution=0.8:0.05 --inertia-ratio 1.2",
        "jaxrock.cli.validate.check_campaign",
        {
            "seed": 3,
            "samples": 128,
            "model": "linearized",
            "one_sided": True,
            "prior": {"critical_angle": (0.2, 0.1), "restitution": (0.8, 0.05)},
            "peak_rotations": None,
            "gravity": 9.8,
            "inertia_ratio": 1.2,
        },
    ),
    "validate a block of a size": (
        "tests.csv --width 0.2 --height 1",
        "jaxrock.cli.validate.check_campaign",
        {"prior": jr.Block(0.1, 5.0), "one_sided": False, "gravity": 9.81},
    ),
    "inventory": (
        "objects.csv --hazard hazard.csv --target 1e-4 --model linearized --elasticities"
        " --no-required-width",
        "jaxrock.cli.inventory.assess_inventory",
        {"model": "linearized", "required_width": False, "elasticities": True},
    ),
}


@pytest.mark.parametrize("name", CALLS)
def test_options_arrive_in_the_library(capsys, tmp_path, monkeypatch, name):
    words, function, expected = CALLS[name]
    monkeypatch.chdir(tmp_path)
    write_inputs(tmp_path)
    calls = []

    def compute_nothing(*arguments, **named):
        calls.append((arguments, named))
        raise ValueError("nothing is computed")

    monkeypatch.setattr(function, compute_nothing)
    code, _, err = run(capsys, name.split()[0], *words.split())
    assert (code, err) == (2, "jaxrock: error: nothing is computed\n")
    arguments, named = calls[0]
    assert {key: named[key] for key in expected} == expected
    if "directions" in name:
        suite = next(part for part in arguments if isinstance(part, jr.Suite))
        assert suite.directions == 2
        assert float(suite.records[0].scale) == -2
    if "walls" in name:
        assert arguments[3] is None  # the restitution: that of the size
