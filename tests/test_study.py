"""Study files: several commands in one file, checked before the first one runs."""

import json
import os
import sys
import threading
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
import xarray
from jaxrock.cli.command import Answer
from jaxrock.cli.commands import Critical, RockingSpectrum
from jaxrock.cli.study import Run, _make_job

from jaxrock.cli import main
from jaxrock.cli import study as study_file
from jaxrock.tables import text as text_files

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
    slendernes = 5
    [[job]]
    command = "spectrum"
    slenderness = "3:6"
    out = "spectra"
    [[job]]
    command = "respond"
    widht = 0.8
    [[job]]
    command = "respond"
    pulse = "sinus"
    [[job]]
    command = "respond"
    amplitude = "strong"
    [[job]]
    command = "respond"
    model = 1
    [[job]]
    comand = "assess"
    [[job]]
    command = "asess"
    [[job]]
    command = "critical"
    restitution = 2
    half_cycles = 1.5
    [[job]]
    command = "tradeoff"
    repeats = 1.5
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
        'common: slendernes is an option of no job. Did you mean "slenderness"?',
        "job 1 (spectrum): slenderness must be numbers or START:STOP:COUNT, got '3:6'",
        "job 2 (respond): Unknown option: --widht. Did you mean --width?",
        'job 3 (respond): Invalid value "sinus" for --pulse. Choose from: "rectangular"',
        'job 4 (respond): Invalid value for --amplitude: unable to convert "strong" into float',
        'job 5 (respond): Invalid value "1" for --model. Choose from: "linearized", "nonlinear"',
        "job 6: command must be one of assess, spectrum",
        "got only comand",
        "got 'asess'. Did you mean \"assess\"?",
        "job 8 (critical): restitution must be between 0 and 1, got 2",
        "job 9 (tradeoff): Invalid value for --repeats: '1.5' is not a whole number",
        "job 10 (spectrum): json is no option of a job",
    ):
        assert words in error
    assert [path.name for path in tmp_path.iterdir()] == ["study.toml"]


def test_paths_start_at_the_folder_of_the_study(tmp_path):
    """Also files of any name, and folders; words that are no paths stay."""
    given = {"record": "quake.dat", "vertical": "b.UD", "column": "a.raw"}
    job = _make_job("respond", {}, given, tmp_path)
    assert job.record == str(tmp_path / "quake.dat")
    assert job.vertical == str(tmp_path / "b.UD")
    assert job.column == "a.raw"
    for word in ("example", "fema-far-field"):
        assert _make_job("fragility", {}, {"records": word}, tmp_path).records == word
    job = _make_job("fragility", {}, {"records": "recs"}, tmp_path)
    assert job.records == str(tmp_path / "recs")


def test_records_are_read_once_and_jobs_checked_once(tmp_path, capsys, monkeypatch):
    (tmp_path / "a.csv").write_text("t,acc_g\n0,0.1\n0.5,-0.2\n1,0.1\n")
    job = "[[job]]\ncommand = 'rocking-spectrum'\nrecord = 'a.csv'\nout = '{}'\n"
    # The last one asks otherwise.
    text = "".join(job.format(i) for i in range(4)) + "unit = 'g'\n"
    text += "[[job]]\ncommand = 'critical'\nrecord = 'a.csv'\n"
    counted = Counter()

    def count(owner, name, of):
        original = getattr(owner, name)

        def counting(*arguments, **options):
            counted[of(*arguments)] += 1
            return original(*arguments, **options)

        monkeypatch.setattr(owner, name, counting)

    count(text_files, "read_regular", lambda path: path.name)
    count(RockingSpectrum, "check", lambda job: f"check {job.out.name}")
    count(study_file, "show_progress", lambda items, label: label)

    def answer(job):
        return Answer(f"{job.motion.samples}", {"scaled": float(job.motion.scale)})

    for command in (RockingSpectrum, Critical):  # their answers are for other tests
        monkeypatch.setattr(command, "run", answer)
    main(["run", study(tmp_path, text)])
    assert capsys.readouterr().out.count("3\n") == 5
    checks = {f"check {i}": 1 for i in range(4)}
    assert counted == {"a.csv": 2, "checking jobs": 1, "jobs": 1, **checks}
    alone = RockingSpectrum(record=str(tmp_path / "a.csv"))
    alone.check()
    assert replace(alone, scale=2.0).motion.scale == 2 * alone.motion.scale
    assert counted["a.csv"] == 2
    (tmp_path / "a.csv").write_text("t,acc_g\n0,0.1\n0.5,-0.2\n")
    main(["run", study(tmp_path, text)])  # the next command reads anew
    assert capsys.readouterr().out.count("2\n") == 5
    assert counted["a.csv"] == 4


def test_a_record_that_is_faulty_is_read_once(tmp_path, monkeypatch):
    (tmp_path / "a.csv").write_text("t,acc_g\n0,x\n")
    read = []
    monkeypatch.setattr(
        text_files, "read_regular", lambda path: read.append(path) or path.read_bytes()
    )
    text = "".join(f"[[job]]\ncommand = 'rocking-spectrum'\nout = '{i}'\n" for i in range(3))
    with pytest.raises(ValueError, match=r"(?s)(job \d .*column 'acc_g' must be a num.*){3}"):
        Run(study=Path(study(tmp_path, "[common]\nrecord = 'a.csv'\n" + text))).check()
    assert len(read) == 1


def test_checking_takes_a_time_in_proportion_to_the_jobs(tmp_path):
    """Calls of functions are counted: their number is the same in every run."""

    def calls(jobs):
        text = "".join(f"[[job]]\ncommand = 'spectrum'\nout = 'd/{i}'\n" for i in range(jobs))
        run = Run(study=Path(study(tmp_path, text)))
        count = 0

        def counting(_frame, event, _argument):
            nonlocal count
            count += event in ("call", "c_call")

        sys.setprofile(counting)
        try:
            run.check()
        finally:
            sys.setprofile(None)
        return count

    calls(1)  # what is done once only
    few = calls(20)
    some = calls(40)
    many = calls(60)
    assert many - some == pytest.approx(some - few, rel=0.02)


@pytest.mark.parametrize(
    "value", ["[" * 500 + "]" * 500, "{a=" * 500 + "1" + "}" * 500], ids=["lists", "tables"]
)
def test_a_study_that_is_nested_too_deeply(tmp_path, capsys, value):
    for text in (f"common = {value}", f"[[job]]\ncommand = {value}"):
        with pytest.raises(SystemExit):
            main(["run", study(tmp_path, text)])
        error = capsys.readouterr().err
        assert "study.toml' is nested too deeply" in error
        assert error.count("\n") == 1


def test_a_study_is_a_regular_file(tmp_path, capsys):
    pipe = tmp_path / "pipe.toml"
    os.mkfifo(pipe)
    writer = threading.Thread(target=pipe.write_text, args=("a = 1",), daemon=True)
    writer.start()
    with pytest.raises(SystemExit):
        main(["run", str(pipe)])
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)  # lets the writer go
    writer.join(10)
    os.close(reader)
    assert "pipe.toml' cannot be read: a regular file was expected" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "[[job]]\ncommand = 'spectrum'\nout = 'd/critical.csv/e'\n"
            "[[job]]\ncommand = 'critical'\nout = 'd'",
            "/d/critical.csv' is in the way of job 1 (spectrum)",
        ),
        ("[[job]", "is not TOML"),
        ("", "job is missing"),
        ("\ufeff[[job]]\ncommand = 'x'", "job 1: command must be one of"),
        (
            "[[job]]\ncommand = 'assess'\nwidth = 1" + "0" * 400,
            "width must be finite and greater than 0, got inf",
        ),
        (
            "[[job]]\ncommand = 'critical'\nhalf_cycles = 1\nhalf-cycles = 2",
            "an option is given twice, with dashes and with underscores",
        ),
        (
            "[[job]]\ncommand = 'critical'\npulse = 'sine'\nalong = 'duration'\nvalues = [-1, 2]\n"
            "amplitude = 3",
            "job 1 (critical): values must be finite and",
        ),
        (
            "[[job]]\ncommand = 'critical'\nout = 'd'\n"
            "[[job]]\ncommand = 'spectrum'\nout = 'd/critical.csv'",
            "job 2 (spectrum): out:",
        ),
        ("[[job]]\ncommand = 'assess'\nhelp = true", "help is no option of a job"),
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


@pytest.mark.thorough
def test_a_job_that_fails_is_named_and_the_others_are_not_lost(tmp_path, capsys):
    text = """
    [[job]]
    command = "sensitivity"
    answer = "period"
    intensity = 5
    [[job]]
    command = "critical"
    out = "found"
    """
    with pytest.raises(SystemExit) as end:
        main(["run", study(tmp_path, text), "--json"])
    assert end.value.code == 2
    written = capsys.readouterr()
    words = "answer period does not exist here"
    assert f"job 1 (sensitivity): {words}" in written.err
    first, second = json.loads(written.out)["jobs"]
    assert first["error"].startswith(words)
    assert (first["code"], second["code"]) == (2, 0)
    names = ("critical.csv", "critical.png")
    assert second["files"] == [str(tmp_path / "found" / name) for name in names]
    assert all((tmp_path / "found" / name).exists() for name in names)
    assert not (tmp_path / "sensitivity").exists()


def test_stores_are_jobs_too(tmp_path):
    """Of a study in another folder, and in the way of each other."""
    text = """
[[job]]
command = "spectrum"
store = "grid.zarr"
chunks = "width=1"

[[job]]
command = "rocking-spectrum"
store = "{other}.zarr"
"""
    first, second = Run(study=Path(study(tmp_path, text.format(other="other")))).jobs.values()
    assert [job.targets for job in (first, second)] == [
        [tmp_path / "grid.zarr"],
        [tmp_path / "other.zarr"],
    ]
    with pytest.raises(ValueError, match=r"grid.zarr' is in the way of job 1 \(spectrum\)"):
        _ = Run(study=Path(study(tmp_path, text.format(other="grid")))).jobs
