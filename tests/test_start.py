"""What processes of their own do when they start, and what they find of those before them."""

import os
import subprocess
import sys

import pytest

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
def test_a_second_process_finds_what_the_first_one_compiled(tmp_path):
    """Of one block and of a batch, in the folder that the user names."""
    code = (
        "import jaxrock as jr; given = jr.Block(0.2, 5.0), 0.9, jr.Sine(4.0, 0.5), 3.0;"
        "print(*(f(*given).peak_rotation for f in (jr.respond, jr.respond_batch)))"
    )
    # By default JAX keeps only what takes it more than a second.
    folder = {"JAX_COMPILATION_CACHE_DIR": str(tmp_path)}
    folder["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
    first = start("-c", code, **folder)
    kept = {path.name for path in tmp_path.glob("*-cache")}
    assert any("follow_concrete" in name for name in kept)
    assert any("follow_rows" in name for name in kept)
    assert start("-c", code, **folder) == first
    assert {path.name for path in tmp_path.glob("*-cache")} == kept


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
