"""Whatever ends a process, nothing half-written is left: signals, kills, what is short."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import xarray

from jaxrock.host import write_whole


@pytest.fixture(autouse=True)
def _no_signal_is_ignored(monkeypatch, tmp_path):
    """Processes ignore what the one that starts them ignores, as in the background of a shell."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    monkeypatch.chdir(tmp_path)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.thorough
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_command_that_writes(number):
    """With the exit code of a shell, and no file or folder is left."""
    words = f"{sys.executable} -m jaxrock spectrum --slenderness 3:10:281 --width 0.2:2:181"
    process = subprocess.Popen(words.split(), stderr=subprocess.PIPE, text=True)
    while not [*Path().glob(".unfinished-*/spectrum.*")]:
        time.sleep(0.01)
        assert process.poll() is None
    process.send_signal(number)
    _, messages = process.communicate(timeout=60)
    assert process.returncode == 128 + number
    assert messages.endswith("jaxrock: interrupted\n")
    assert [*Path().iterdir()] == []


def test_a_full_disk_under_netcdf(tmp_path):
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, limits[1]))
    try:
        with (
            pytest.raises(ValueError, match=r"out: .*new' cannot be written to: NetCDF"),
            write_whole("out", tmp_path / "new", ["x.nc"], False) as scratch,
        ):
            xarray.Dataset({"x": ("n", [0.0] * 10_000)}).to_netcdf(scratch / "x.nc")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert [*tmp_path.iterdir()] == []
