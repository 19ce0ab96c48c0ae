"""What processes of their own do when they start, and what they find of those before them."""

import os
import subprocess
import sys
from pathlib import Path

import jax
import pytest

from jaxrock.cli import compiled_programs as compiled

HEAVY = {
    *("diffrax", "lineax", "optimistix", "optax", "scipy"),
    *(
        "dask",
        "distributed",
        "zarr",
        "bokeh",
        "obspy",
        "h5py",
        "xarray",
        "pandas",
        "netCDF4",
        "matplotlib",
        "PIL",
        "cyclopts",
        "rich",
        "platformdirs",
    ),
}


@pytest.mark.thorough
def test_the_package_imports_nothing_heavy_and_sets_nothing():
    """In a process of its own: the tests import all of these."""
    code = (
        "import sys, jax; before = dict(jax.config.values); import jaxrock;"
        "assert dict(jax.config.values) == before; print(*sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    imported = {name.partition(".")[0] for name in done.stdout.split()}
    assert "jaxrock" in imported
    assert not HEAVY & imported


def start(home, *arguments, **variables):
    """Start a command in a process of its own, for which `home` is all that there is of a user."""
    inherited = {
        name: value for name, value in os.environ.items() if not name.startswith("JAX_")
    }
    homes = dict.fromkeys(("HOME", "LOCALAPPDATA", "XDG_CACHE_HOME"), str(home))
    return subprocess.Popen(
        [sys.executable, "-W", "error", "-m", "jaxrock", "critical", *arguments],
        env=inherited | homes | variables,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def files(folder):
    """What is kept: names and sizes."""
    return {path.name: path.stat().st_size for path in folder.rglob("*-cache")}


@pytest.mark.thorough
@pytest.mark.float64
def test_commands_start_from_what_is_compiled(tmp_path):
    home = tmp_path / "home"
    said = start(home).communicate()
    assert said[0]
    assert said[1] == ""
    kept = files(home)
    assert len(kept) > 5
    assert start(home).communicate() == said
    # Each was looked for and found.
    assert files(home) == kept
    for path in home.rglob("*-cache"):  # as left by a process killed meanwhile
        path.write_bytes(path.read_bytes()[:-100])
    # They are compiled anew, without a word.
    assert start(home).communicate() == said


@pytest.fixture
def untold():
    """JAX as it is where nobody has told it what to keep."""
    names = ("compilation_cache_dir", "persistent_cache_min_compile_time_secs")
    names = [f"jax_{name}" for name in (*names, "enable_compilation_cache")]
    values = {name: getattr(jax.config, name) for name in names}
    jax.config.update("jax_compilation_cache_dir", None)
    yield
    for name, value in values.items():
        jax.config.update(name, value)


def kept_in(monkeypatch, home):
    """Where commands keep what they compile, of a user who has only a home."""
    for name in ("HOME", "LOCALAPPDATA", "XDG_CACHE_HOME"):
        monkeypatch.setenv(name, str(home))
    with compiled.keep_compiled():
        return jax.config.jax_compilation_cache_dir


def test_where_nothing_is_kept(tmp_path, monkeypatch, untold):
    folder = kept_in(monkeypatch, tmp_path / "home")
    assert Path(folder).is_relative_to(tmp_path / "home")
    jax.config.update("jax_compilation_cache_dir", None)
    (tmp_path / "file").touch()
    assert kept_in(monkeypatch, tmp_path / "file" / "in") is None
    jax.config.update("jax_enable_compilation_cache", False)
    assert kept_in(monkeypatch, tmp_path / "off") is None
    jax.config.update("jax_enable_compilation_cache", True)
    jax.config.update("jax_compilation_cache_dir", str(tmp_path / "own"))
    assert kept_in(monkeypatch, tmp_path / "told") == str(tmp_path / "own")
    assert {path.name for path in tmp_path.iterdir()} == {"home", "file"}


def test_what_is_kept_is_bounded(tmp_path, monkeypatch):
    """What was used last stays."""
    monkeypatch.setattr(compiled, "MAX_BYTES", 25)
    for used, name in enumerate(("b", "a", "c")):
        (tmp_path / name).write_bytes(10 * b"x")
        os.utime(tmp_path / name, (used, 10 - used))
    compiled._drop_oldest(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"a", "c"}
