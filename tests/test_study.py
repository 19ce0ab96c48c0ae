"""Study files: several commands in one file, checked before the first one runs."""

import json

import pytest
import xarray

from jaxrock.cli import main

pytestmark = pytest.mark.float64

STUDY = """
[common]
restitution = 0.7
intensity = 0.15

[[job]]
command = "spectrum"
slenderness = "3:6:4"
width = [0.4, "0.8:1.2:2"]
out = "spectra"

[[job]]
command = "critical"
width = 0.8
restitution = 0.8
half-cycles = [1, inf]
out = "critical"
intensity = 0.1
"""


def study(folder, text):
    path = folder / "study.toml"
    path.write_text(text, encoding="utf-8")
    return str(path)


def test_a_study_runs_beside_its_file(tmp_path, capsys, monkeypatch):
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    main(["run", study(tmp_path, STUDY), "--json"])
    first, second = json.loads(capsys.readouterr().out)["jobs"]
    assert first["job"] == "job 1 (spectrum)"
    assert first["sizes"] == {"slenderness": 4, "width": 3, "restitution": 1}
    assert [row["half_cycles"] for row in second["rows"]] == [1, 1, None, None]
    with xarray.open_dataset(tmp_path / "spectra" / "spectrum.nc") as dataset:
        assert dataset.width.values.tolist() == [0.4, 0.8, 1.2]
        assert dataset.restitution.values.tolist() == [0.7]
    assert (tmp_path / "critical" / "critical.csv").exists()
    assert not list((tmp_path / "elsewhere").iterdir())


def test_every_fault_is_said_before_anything_runs(tmp_path, capsys):
    text = """
    sweep = 1
    [common]
    colour = "red"
    [[job]]
    command = "spectrum"
    slenderness = "3:6"
    out = "spectra"
    [[job]]
    command = "respond"
    widht = 0.8
    pulse = "sinus"
    amplitude = "strong"
    linearized = 1
    [[job]]
    comand = "assess"
    [[job]]
    command = "critical"
    restitution = 2
    half_cycles = 1.5
    [[job]]
    command = "tradeoff"
    repeats = 1.5
    out = 3
    [[job]]
    command = "spectrum"
    out = "spectra"
    json = true
    """
    with pytest.raises(SystemExit) as end:
        main(["run", study(tmp_path, text)])
    assert end.value.code == 2
    error = capsys.readouterr().err
    for words in (
        "study.toml cannot be run",
        "sweep is unknown; allowed are common, job",
        "common: colour is an option of no job",
        "job 1 (spectrum): slenderness must be numbers or START:STOP:COUNT, got '3:6'",
        "job 2 (respond): widht is unknown; allowed are out, force, width, height",
        "pulse must be one of rectangular, half-sine, sine, cosine, ricker, got 'sinus'",
        "amplitude must be a number, got 'strong'",
        "linearized must be true or false, got 1",
        "job 3: command must be one of assess, spectrum",
        "got only comand",
        "job 4 (critical): restitution must be between 0 and 1, got 2",
        "job 5 (tradeoff): repeats must be a whole number, got 1.5",
        "out must be text, got 3",
        "job 6 (spectrum): json is unknown",
    ):
        assert words in error
    assert [path.name for path in tmp_path.iterdir()] == ["study.toml"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[[job]", "is not TOML"),
        ("", "job is missing"),
        ("\ufeff[[job]]\ncommand = 'x'", "job 1: command must be one of"),
        (
            "[[job]]\ncommand = 'assess'\nwidth = 1" + "0" * 400,
            "width must be a number that is not",
        ),
        (
            "[[job]]\ncommand = 'critical'\nhalf_cycles = 1\nhalf-cycles = 2",
            "half-cycles and half_cycles are the same",
        ),
        (
            "[[job]]\ncommand = 'critical'\npulse = 'sine'\nalong = 'duration'\ntried = [-1, 2]\n"
            "amplitude = 3",
            "job 1 (critical): tried must be finite and",
        ),
        (
            "[[job]]\ncommand = 'critical'\nout = 'd'\n"
            "[[job]]\ncommand = 'spectrum'\nout = 'd/critical.csv'",
            "job 2 (spectrum): out:",
        ),
        ("job = 3", "job must be tables [[job]]"),
        ("common = 3\n[[job]]\ncommand = 'assess'", "common must be a table"),
        (
            "[[job]]\ncommand = 'spectrum'\n[[job]]\ncommand = 'spectrum'",
            "/spectrum/spectrum.nc' is in the way of job 1 (spectrum)",
        ),
    ],
)
def test_what_is_no_study(tmp_path, capsys, text, words):
    with pytest.raises(SystemExit) as end:
        main(["run", study(tmp_path, text)])
    assert end.value.code == 2
    assert words in capsys.readouterr().err


def test_a_study_that_is_missing(tmp_path, capsys):
    with pytest.raises(SystemExit) as end:
        main(["run", str(tmp_path / "none.toml")])
    assert end.value.code == 2
    assert "none.toml' cannot be read: No such file" in capsys.readouterr().err


def test_a_job_that_fails_is_named_and_the_others_are_not_lost(tmp_path, capsys):
    text = """
    [[job]]
    command = "sensitivity"
    intensity = 5
    [[job]]
    command = "critical"
    out = "found"
    """
    with pytest.raises(SystemExit) as end:
        main(["run", study(tmp_path, text), "--json"])
    assert end.value.code == 2
    written = capsys.readouterr()
    words = "answer rotation-ratio does not exist here"
    assert f"job 1 (sensitivity): {words}" in written.err
    first, second = json.loads(written.out)["jobs"]
    assert first["error"].startswith(words)
    assert (first["code"], second["code"]) == (2, 0)
    assert second["files"] == [str(tmp_path / "found" / "critical.csv")]
    assert (tmp_path / "found" / "critical.csv").exists()
    assert not (tmp_path / "sensitivity").exists()
