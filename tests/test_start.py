"""What processes of their own do when they start, and what they find of those before them."""

import os
import subprocess
import sys

import pytest

from jaxrock.cli import compiled_programs as compiled

HEAVY = {"diffrax", "lineax", "optimistix", "optax", "scipy", "xarray", "pandas", "matplotlib"}
HEAVY |= {"dask", "zarr", "obspy", "h5py", "netCDF4", "PIL", "cyclopts", "rich"}


def start(*arguments, **variables):
    inherited = {name: text for name, text in os.environ.items() if name[:4] != "JAX_"}
    env = inherited | variables
    return subprocess.check_output([sys.executable, *arguments], env=env, text=True)


@pytest.mark.thorough
def test_the_package_imports_nothing_heavy_and_sets_nothing():
    code = (
        "import sys, jax; before = dict(jax.config.values); import jaxrock;"
        "assert dict(jax.config.values) == before; print(*sys.modules)"
    )
    imported = {name.partition(".")[0] for name in start("-c", code).split()}
    assert "jaxrock" in imported
    assert not HEAVY & imported


@pytest.mark.thorough
@pytest.mark.float64
def test_a_second_command_compiles_nothing(tmp_path):
    words = ["-m", "jaxrock", "critical", "--width", "0.8", "--height", "4"]
    homes = dict.fromkeys(("HOME", "LOCALAPPDATA", "XDG_CACHE_HOME"), str(tmp_path))
    first = start(*words, **homes)
    kept = {path: path.stat().st_size for path in tmp_path.rglob("*-cache")}
    assert len(kept) > 5
    assert start("-W", "error", *words, **homes) == first
    assert {path: path.stat().st_size for path in tmp_path.rglob("*-cache")} == kept


def test_the_folder_is_bounded_and_what_was_used_last_stays(tmp_path, monkeypatch):
    monkeypatch.setattr(compiled, "MAX_BYTES", 25)
    for used, name in enumerate(("b", "a", "c")):
        (tmp_path / name).write_bytes(10 * b"x")
        os.utime(tmp_path / name, (used, 10 - used))
    compiled._drop_oldest(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"a", "c"}
