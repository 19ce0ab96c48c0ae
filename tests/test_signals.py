"""Whatever ends a command, nothing half-written is left: signals, kills, what is short."""

import contextlib
import itertools
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import xarray
from tools.selection import first_before_release

from jaxrock.host.files import CannotWrite, write_whole

HERE = Path(__file__).parent
SLOW = pytest.mark.thorough
DONE = ["done", "done/first", "done/second", "done/third"]


@pytest.fixture(autouse=True)
def _no_signal_is_ignored():
    """Processes ignore what the one that starts them ignores, as in the background of a shell."""
    before = signal.getsignal(signal.SIGINT)
    if before == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def started(folder):
    process = subprocess.Popen(
        [sys.executable, HERE / "tools" / "writing_until_a_signal.py", folder],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == "ready\n"
    return process


def ended(process, name):
    """Its exit code after a signal."""
    process.send_signal(getattr(signal, name))
    with process:
        process.communicate(timeout=60)
    return process.returncode


def entries(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def test_ctrl_c_leaves_nothing(tmp_path):
    process = started(tmp_path)
    assert len(entries(tmp_path)) == len(DONE) + 4
    # Python ends with the signal itself, which a shell reports as 130.
    assert ended(process, "SIGINT") == -signal.SIGINT
    assert entries(tmp_path) == DONE


@pytest.mark.parametrize("name", ["SIGTERM", pytest.param("SIGKILL", marks=SLOW)])
def test_what_a_killed_process_left_is_named_and_removed(tmp_path, name):
    """One folder beside the target; what belongs to others is not touched."""
    process = started(tmp_path)
    assert ended(process, name) == -getattr(signal, name)
    (left,) = set(tmp_path.iterdir()) - {tmp_path / "done"}
    assert left.name.startswith(".unfinished-")
    (tmp_path / ".unfinished-work").mkdir()  # not a name of ours
    theirs = left.name.replace(f"-{process.pid}-", f"-{os.getpid()}-")
    (tmp_path / theirs).mkdir()
    sentence = f"{left.name}', left by a process that was killed, is now removed"
    with (
        pytest.warns(UserWarning, match=sentence),
        write_whole("out", tmp_path / "deep" / "er", ["new"], False) as scratch,
    ):
        (scratch / "new").touch()
    expected = {*DONE, ".unfinished-work", theirs, "deep", "deep/er", "deep/er/new"}
    assert set(entries(tmp_path)) == expected


def test_a_run_beside_another_overwrites_nothing(tmp_path):
    def write():
        with write_whole("out", tmp_path, ["table"], False) as scratch:
            (scratch / "table").write_text("mine")
            (tmp_path / "table").write_text("theirs")

    with pytest.raises(ValueError, match=r"table' exists; --force overwrites it"):
        write()
    assert entries(tmp_path) == ["table"]
    assert (tmp_path / "table").read_text() == "theirs"


@pytest.mark.thorough
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


STORE = ("--store", "s.zarr", "--workers", "2")
COMMANDS = {  # with the seconds that they take, about
    "spectrum": (5, ["--slenderness", "3:10:15", "--width", "0.4:1.2:9"]),
    "fragility": (5, []),
    "respond": (5, ["--record", "example"]),
    "rocking-spectrum": (12, ["--free-period", "1:4:200", *STORE]),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", first_before_release(COMMANDS, 2))
@pytest.mark.parametrize("how", ["SIGINT", "SIGTERM"])
def test_signals_at_random_moments(tmp_path, name, how):
    """Exit codes are as a shell expects; no file is there in parts, under its own name."""
    seconds, words = COMMANDS[name]
    moments = random.Random(f"{name} {how}")
    for number in range(3):
        folder = tmp_path / str(number)
        folder.mkdir()
        process = subprocess.Popen(
            [sys.executable, "-m", "jaxrock", name, *words],
            cwd=folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        # Not in the first moments, in which Python itself starts, and would be interrupted.
        time.sleep(moments.uniform(0.3, seconds))
        with process:
            has_ended = process.poll() is not None
            if how == "SIGTERM":
                process.send_signal(signal.SIGTERM)
            elif not has_ended:
                os.killpg(process.pid, signal.SIGINT)  # a terminal sends it to workers as well
            sent = time.monotonic()
            _, messages = process.communicate(timeout=60)
        # It may be about to end by itself when the signal comes.
        is_late = process.returncode == 0 and time.monotonic() - sent < 1
        if has_ended or is_late:
            continue
        if how == "SIGTERM":
            assert process.returncode == -signal.SIGTERM
        else:
            assert process.returncode in (130, -signal.SIGINT)
            assert messages in ("jaxrock: interrupted\n", "")
            assert not list(folder.rglob(".unfinished*"))
        assert len(list(folder.glob(".unfinished*"))) <= 1
        for path in folder.rglob("*.nc"):
            if ".unfinished" not in str(path):
                xarray.load_dataset(path)


def test_too_few_file_descriptors(tmp_path):
    """A sentence, and nothing is left."""
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

    # Removing a folder takes a few itself: without any it stays for the next run.
    for spare in range(3, 8):
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
