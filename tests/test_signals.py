"""Whatever ends a command, nothing half-written is left: signals, kills, what is short."""

import contextlib
import itertools
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from jaxrock.host import signals
from jaxrock.host.files import CannotWrite, written_whole

HERE = Path(__file__).parent
SLOW = pytest.mark.thorough
DONE = ["done", "done/first", "done/second", "done/third"]
ENDING = ("SIGINT", "SIGTERM", "SIGHUP")


@pytest.fixture(autouse=True)
def _no_signal_is_ignored():
    """Processes ignore what the one that starts them ignores, as in the background of a shell."""
    before = {name: signal.getsignal(getattr(signal, name)) for name in ENDING}
    for name, handler in before.items():
        if handler == signal.SIG_IGN:
            signal.signal(getattr(signal, name), signal.SIG_DFL)
    yield
    for name, handler in before.items():
        signal.signal(getattr(signal, name), handler)


def started(folder, situation):
    arguments = [
        HERE / "tools" / "writing_until_a_signal.py",
        HERE.parent / "jaxrock",
        folder,
        situation,
    ]
    process = subprocess.Popen(
        [sys.executable, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == "ready\n"
    return process


def ended(process, name):
    """What it says and its exit code after a signal."""
    process.send_signal(getattr(signal, name))
    with process:
        _, said = process.communicate(timeout=60)
    return said, process.returncode


def entries(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


@pytest.mark.parametrize(
    ("situation", "name", "line", "code"),
    [
        ("compute", "SIGTERM", "jaxrock: ended by SIGTERM\n", 143),
        pytest.param("collect", "SIGINT", "jaxrock: interrupted\n", 130, marks=SLOW),
        pytest.param("share", "SIGINT", "jaxrock: interrupted\n", 130, marks=SLOW),
        pytest.param("write", "SIGHUP", "jaxrock: ended by SIGHUP\n", 129, marks=SLOW),
    ],
)
def test_nothing_half_written_is_left(tmp_path, situation, name, line, code):
    process = started(tmp_path, situation)
    assert len(entries(tmp_path)) > len(DONE)
    assert ended(process, name) == (line, code)
    assert entries(tmp_path) == DONE


def test_files_are_moved_all_or_none(tmp_path):
    process = started(tmp_path, "move")
    while not (tmp_path / "deep" / "er" / "first").exists():
        time.sleep(0.01)
    assert ended(process, "SIGTERM")[1] == 143
    moved = ["deep", *(f"deep/er{name}" for name in ("", "/first", "/second", "/third"))]
    assert entries(tmp_path) == sorted([*moved, *DONE])


@pytest.mark.thorough
def test_what_killed_processes_left_is_named_and_removed(tmp_path):
    """And what processes have that are alive is not touched."""
    killed, alive = (started(tmp_path / name, "sleep") for name in ("killed", "alive"))
    assert ended(killed, "SIGKILL") == ("", -9)
    folder = tmp_path / "killed" / "deep" / "er"
    (left,) = folder.iterdir()
    (theirs,) = (tmp_path / "alive" / "deep" / "er").iterdir()
    theirs = theirs.rename(folder / theirs.name)
    (folder / ".unfinished-work").mkdir()  # not a name of ours

    def rerun():
        with (
            written_whole("out", folder, ["new"], False) as scratch,
            written_whole("out", folder, ["newer"], False) as other,
        ):
            (scratch / "new").touch()
            (other / "newer").touch()

    with pytest.warns(UserWarning, match=f"{left.name}', left by a process that was killed, is"):
        rerun()
    assert entries(folder) == [
        *sorted([".unfinished-work", theirs.name, *(f"{theirs.name}/{n}" for n in FILES)]),
        "new",
        "newer",
    ]
    assert ended(alive, "SIGTERM")[1] == 143


FILES = (".lock", "first", "second", "third")


@pytest.mark.thorough
def test_once_the_exit_code_is_known_nothing_is_taken_apart(tmp_path):
    """Meanwhile nobody would hear of signals."""
    with started(tmp_path, "finish") as process:
        assert process.communicate(timeout=60) == ("", "")
    assert process.returncode == 3
    assert entries(tmp_path) == DONE


@pytest.mark.thorough
def test_what_is_to_be_ignored_stays_ignored(tmp_path):
    """As under nohup."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    process = started(tmp_path, "sleep")
    process.send_signal(signal.SIGHUP)
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(0.3)
    assert ended(process, "SIGTERM") == ("jaxrock: ended by SIGTERM\n", 143)


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="sees handlers in /proc")
def test_the_command_hears_before_it_imports_anything_else(tmp_path):
    command = [sys.executable, "-m", "jaxrock", "critical", "--out", str(tmp_path / "out")]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    bit = 1 << (signal.SIGTERM - 1)
    while True:
        status = Path(f"/proc/{process.pid}/status").read_text()
        caught = next(line for line in status.splitlines() if line.startswith("SigCgt"))
        if int(caught.split()[1], 16) & bit:
            break
        time.sleep(0.001)
    assert "jaxlib" not in Path(f"/proc/{process.pid}/maps").read_text()
    assert ended(process, "SIGINT") == ("jaxrock: interrupted\n", 130)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("program", "given", "is_command"),
    [
        ("-m", ["python", "-W", "error", "-m", "jaxrock", "run"], True),
        ("-m", ["python", "-m", "other", "-m", "jaxrock"], False),
        ("/usr/bin/jaxrock", ["python", "/usr/bin/jaxrock"], True),
        ("study.py", ["python", "study.py"], False),
        ("", ["python"], False),
        ("/usr/bin/jaxrock", ["python", "-c", "spawn", "--multiprocessing-fork"], False),
    ],
)
def test_only_the_command_takes_signals(monkeypatch, program, given, is_command):
    monkeypatch.setattr("sys.argv", [program])
    monkeypatch.setattr("sys.orig_argv", given)
    assert signals._is_command() == is_command
    assert not signals._heard  # in this process nothing has


def test_too_few_file_descriptors(tmp_path):
    """Whatever is missing, from the folder itself on: a sentence, and nothing is left."""
    resource = pytest.importorskip("resource")
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    with open(os.devnull) as file:
        free = file.fileno()

    def write():
        with (
            written_whole("out", tmp_path / "deep" / "er", ["file"], False) as scratch,
            written_whole("store", scratch, ["inner"], False) as inner,
            contextlib.ExitStack() as opened,
        ):
            for name in itertools.count():
                opened.enter_context(open(inner / str(name), "w"))

    for spare in range(5):
        resource.setrlimit(resource.RLIMIT_NOFILE, (free + spare, hard))
        try:
            with pytest.raises(CannotWrite, match="Too many open files"):
                write()
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
        assert entries(tmp_path) == []


def test_a_full_disk_under_netcdf(tmp_path):
    """It has an error of its own for it."""
    resource = pytest.importorskip("resource")
    xarray = pytest.importorskip("xarray")
    dataset = xarray.Dataset({"x": ("n", [0.0] * 10_000)})
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, hard))
    try:
        with (
            pytest.raises(CannotWrite, match=r"out: .*new' cannot be written to: NetCDF: HDF err"),
            written_whole("out", tmp_path / "new", ["x.nc"], False) as scratch,
        ):
            dataset.to_netcdf(scratch / "x.nc")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert entries(tmp_path) == []


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_a_device_is_no_file_to_replace(tmp_path):
    (tmp_path / "table").symlink_to("/dev/full")
    with (
        pytest.raises(ValueError, match=r"out: .*table' is not a regular file"),
        written_whole("out", tmp_path, ["table"], True),
    ):
        raise AssertionError
    assert entries(tmp_path) == ["table"]
