"""Whatever ends a command, nothing half-written is left: signals, kills, what is short."""

import contextlib
import itertools
import os
import random
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from jaxrock.host.files import CannotWrite, write_whole

HERE = Path(__file__).parent
SLOW = pytest.mark.thorough
DONE = ["done", "done/first", "done/second", "done/third"]
FILES = ("first", "second", "third")
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
    arguments = [HERE / "tools" / "writing_until_a_signal.py", folder, situation]
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
        ("write", "SIGTERM", "jaxrock: ended by SIGTERM\n", 143),
        pytest.param("collect", "SIGINT", "jaxrock: interrupted\n", 130, marks=SLOW),
        pytest.param("share", "SIGINT", "jaxrock: interrupted\n", 130, marks=SLOW),
        pytest.param("sleep", "SIGHUP", "jaxrock: ended by SIGHUP\n", 129, marks=SLOW),
    ],
)
def test_nothing_half_written_is_left(tmp_path, situation, name, line, code):
    process = started(tmp_path, situation)
    assert len(entries(tmp_path)) > len(DONE)
    assert ended(process, name) == (line, code)
    assert entries(tmp_path) == DONE


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
            write_whole("out", folder, ["new"], False) as scratch,
            write_whole("out", folder, ["newer"], False) as other,
        ):
            (scratch / "new").touch()
            (other / "newer").touch()

    with pytest.warns(
        UserWarning, match=f"{left.name}', left by a process that was killed, is"
    ):
        rerun()
    assert entries(folder) == [
        *sorted([".unfinished-work", theirs.name, *(f"{theirs.name}/{n}" for n in FILES)]),
        "new",
        "newer",
    ]
    assert ended(alive, "SIGTERM")[1] == 143


@pytest.mark.thorough
def test_what_is_to_be_ignored_stays_ignored(tmp_path):
    """As under nohup."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    process = started(tmp_path, "sleep")
    process.send_signal(signal.SIGHUP)
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(0.3)
    assert ended(process, "SIGTERM") == ("jaxrock: ended by SIGTERM\n", 143)


def test_the_package_starts_nothing():
    """No thread, no handler, no file: only `main` does."""
    code = (
        "import signal, threading; kinds = range(1, signal.NSIG);"
        "before = [signal.getsignal(k) for k in kinds]; import jaxrock, jaxrock.cli;"
        "[getattr(jaxrock, name) for name in jaxrock.__all__];"
        "assert threading.active_count() == 1;"
        "assert [signal.getsignal(k) for k in kinds] == before"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


SMALL = ("--slenderness", "3:10:15", "--width", "0.4:1.2:9")
STORED = ("--store", "s.zarr", "--chunks", "slenderness=20")
COMMANDS = {  # with the seconds that they take, about
    "a spectrum": (5, ["spectrum", *SMALL]),
    "curves": (5, ["fragility"]),
    "a response": (5, ["respond", "--record", "example"]),
    "a store": (9, ["spectrum", "--slenderness", "3:10:400", *STORED]),
    "a store by workers": (
        9,
        ["spectrum", "--slenderness", "3:10:400", *STORED, "--workers", "2"],
    ),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.parametrize("how", ["Ctrl-C", "SIGTERM"])
def test_signals_at_random_moments(request, tmp_path, name, how):
    """A terminal sends Ctrl-C to workers as well, among them those that are just starting."""
    seconds, words = COMMANDS[name]
    moments = random.Random(f"{name} {how}")
    for number in range(3):
        folder = tmp_path / str(number)
        folder.mkdir()
        process = subprocess.Popen(
            [sys.executable, "-m", "jaxrock", *words],
            cwd=folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        # Not in the first moments, in which Python itself starts, and would be interrupted.
        time.sleep(moments.uniform(0.3, seconds))
        with process:
            ended_before = process.poll() is not None
            if how == "SIGTERM":
                process.send_signal(signal.SIGTERM)
            elif not ended_before:
                os.killpg(process.pid, signal.SIGINT)
            _, said = process.communicate(timeout=60)
        assert ended_before or process.returncode != 0
        assert re.fullmatch(r"(jaxrock: (interrupted|ended by SIGTERM)\n)?", said)
        assert not list(folder.rglob(".unfinished*"))


def test_too_few_file_descriptors(tmp_path):
    """Whatever is missing, from the folder itself on: a sentence, and nothing is left."""
    resource = pytest.importorskip("resource")
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    with open(os.devnull) as file:
        free = file.fileno()

    def write():
        with (
            write_whole("out", tmp_path / "deep" / "er", ["file"], False) as scratch,
            write_whole("store", scratch, ["inner"], False) as inner,
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
            pytest.raises(
                CannotWrite, match=r"out: .*new' cannot be written to: NetCDF: HDF err"
            ),
            write_whole("out", tmp_path / "new", ["x.nc"], False) as scratch,
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
        write_whole("out", tmp_path, ["table"], True),
    ):
        raise AssertionError
    assert entries(tmp_path) == ["table"]
