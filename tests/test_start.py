"""What processes of their own do when they start, and what they find of those before them."""

import os
import subprocess
import sys

import jax
import pytest

from jaxrock.cli import compiled_programs as compiled

HEAVY = (
    "diffrax lineax optimistix optax scipy dask zarr obspy h5py xarray pandas netCDF4 matplotlib"
    " PIL cyclopts rich platformdirs"
)


def start(*arguments, **variables):
    """Run Python in a process of its own: the tests import everything."""
    inherited = {name: text for name, text in os.environ.items() if name[:4] != "JAX_"}
    command = [sys.executable, "-W", "error", *arguments]
    return subprocess.run(
        command, env=inherited | variables, capture_output=True, text=True, check=True
    )


@pytest.mark.thorough
def test_the_package_imports_nothing_heavy_and_sets_nothing():
    code = (
        "import sys, jax; before = dict(jax.config.values); import jaxrock;"
        "assert dict(jax.config.values) == before; print(*sys.modules)"
    )
    imported = {name.partition(".")[0] for name in start("-c", code).stdout.split()}
    assert "jaxrock" in imported
    assert not imported.intersection(HEAVY.split())


@pytest.mark.thorough
@pytest.mark.float64
def test_a_second_command_compiles_nothing(tmp_path):
    words = ["-m", "jaxrock", "critical", "--width", "0.8", "--height", "4"]
    homes = dict.fromkeys(("HOME", "LOCALAPPDATA", "XDG_CACHE_HOME"), str(tmp_path))
    first = start(*words, **homes)
    assert (first.stdout != "", first.stderr) == (True, "")
    kept = {path: path.stat().st_size for path in tmp_path.rglob("*-cache")}
    assert len(kept) > 5
    assert start(*words, **homes).stdout == first.stdout
    assert {path: path.stat().st_size for path in tmp_path.rglob("*-cache")} == kept
    for path in kept:  # as left by a process that was killed
        path.write_bytes(path.read_bytes()[:-100])
    words = ["-W", "default", *words]  # JAX warns, and the program is compiled anew
    assert start(*words, **homes).stdout == first.stdout


def test_nothing_is_changed_for_who_has_told_jax_where_to_keep_programs(monkeypatch):
    def refuse(*words, **options):
        raise AssertionError(words)

    monkeypatch.setattr(compiled.Path, "mkdir", refuse)
    before = dict(jax.config.values)
    compiled.keep_compiled()
    assert jax.config.values == before


def test_the_folder_is_bounded_and_what_was_used_last_stays(tmp_path, monkeypatch):
    monkeypatch.setattr(compiled, "MAX_BYTES", 25)
    for used, name in enumerate(("b", "a", "c")):
        (tmp_path / name).write_bytes(10 * b"x")
        os.utime(tmp_path / name, (used, 10 - used))
    compiled._drop_oldest(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"a", "c"}
