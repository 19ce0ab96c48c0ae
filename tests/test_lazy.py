"""Lazy datasets are those in memory, and a store of one is continued after whatever ended a run."""

import functools
import os
import signal
import subprocess
import sys
from pathlib import Path

import dask
import dask.array as da
import jax
import pytest
import xarray
from tables.grids import AXES, GRIDS
from tools.selection import some_by_default

import jaxrock as jr
from jaxrock.grids import write_zarr, zarr_store


def assert_equal(found, expected):
    """To rounding, which chunks may change."""
    rtol = 1e-12 if jax.config.jax_enable_x64 else 1e-5
    xarray.testing.assert_allclose(found, expected, rtol=rtol)
    assert found.attrs == expected.attrs
    for name, variable in expected.variables.items():
        assert found[name].dtype == variable.dtype
        assert repr(found[name].attrs) == repr(variable.attrs)


def grid(**changes):
    names = ("slenderness", "width", "restitution")
    axes = dict(zip(names, AXES, strict=True)) | {"intensity": 0.15}
    return jr.resonance_spectrum(**axes | {"chunks": {"slenderness": 2}} | changes)


@pytest.mark.parametrize("name", some_by_default(GRIDS, {"resonance"}))
def test_chunks_change_nothing(name):
    function, chunks = GRIDS[name]
    whole = function()
    made = function(chunks=chunks)
    assert all(isinstance(variable.data, da.Array) for variable in made.data_vars.values())
    assert {dim: max(lengths) for dim, lengths in made.chunks.items()} == {
        **whole.sizes,
        **chunks,
    }
    assert_equal(made.compute(scheduler="synchronous"), whole)
    assert_equal(function(chunks="auto").compute(), whole)


@pytest.mark.float64
def test_precision_is_the_one_of_who_made_the_dataset():
    made = grid()
    jax.config.update("jax_enable_x64", False)
    try:
        found = made.compute()
    finally:
        jax.config.update("jax_enable_x64", True)
    assert_equal(found, grid(chunks=None))


@pytest.mark.parametrize("intensity", [0.15, 30.0])  # where all overturn: NaN throughout
def test_a_store_is_continued(tmp_path, monkeypatch, intensity):
    """A region without its flag is computed again, whatever was written of it."""
    path = tmp_path / "new" / "grid.zarr"
    whole = grid(intensity=intensity, chunks=None)
    assert_equal(write_zarr(grid(intensity=intensity), path).drop_attrs(), whole.drop_attrs())
    (path / zarr_store._WRITTEN / "1").unlink()
    (path / "rotation_ratio" / "1.0.0").write_bytes(b"half")
    numbers = []

    def count(part, path, region, number, single=zarr_store._write_region):
        numbers.append(number)
        single(part, path, region, number)

    monkeypatch.setattr(zarr_store, "_write_region", count)
    stored = write_zarr(grid(intensity=intensity), path)
    assert numbers == [1]
    assert_equal(stored.drop_attrs(), whole.drop_attrs())
    assert whole.attrs.items() <= stored.attrs.items()


def begin_and_be_killed(path):
    calls = []

    def write(*arguments, single=zarr_store._write_region):
        single(*arguments)
        calls.append(arguments)
        if len(calls) == 2:
            os.kill(os.getpid(), signal.SIGKILL)

    zarr_store._write_region = write
    with dask.config.set(scheduler="synchronous"):
        write_zarr(grid(chunks={"slenderness": 1}), path)


@pytest.mark.thorough
def test_a_run_that_is_killed_is_continued(tmp_path):
    """By another process, whose question has to be known as the same one."""
    path = tmp_path / "grid.zarr"
    code = f"import test_lazy; test_lazy.begin_and_be_killed({str(path)!r})"
    env = os.environ | {"JAX_ENABLE_X64": str(jax.config.jax_enable_x64)}
    run = functools.partial(subprocess.run, cwd=Path(__file__).parent, env=env, check=False)
    assert run([sys.executable, "-c", code]).returncode == -signal.SIGKILL
    before = {flag: flag.stat().st_mtime_ns for flag in (path / "written").glob("[0-9]")}
    assert len(before) == 2
    stored = write_zarr(grid(chunks={"slenderness": 1}), path)
    assert {flag: flag.stat().st_mtime_ns for flag in before} == before
    assert_equal(stored.drop_attrs(), grid(chunks=None).drop_attrs())


def test_what_is_something_else_stays_as_it_is(tmp_path):
    """Stores of other questions and what is no store."""
    write_zarr(grid(), tmp_path / "grid.zarr")
    grid(chunks=None).to_zarr(tmp_path / "other.zarr", zarr_format=2)
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("in the way")
    files = [file for file in tmp_path.rglob("*") if file.is_file()]
    content = [file.read_bytes() for file in files]
    other = [
        (grid(width=[0.4, 0.8, 1.3]), "grid.zarr"),
        (grid(gravity=1.62), "grid.zarr"),
        (grid(chunks={"slenderness": 3}), "grid.zarr"),
        *((grid(), name) for name in ("other.zarr", "folder", "file")),
    ]
    for made, name in other:
        with pytest.raises(ValueError, match=r"is not of this grid.*; it is left as it is"):
            write_zarr(made, tmp_path / name)
    assert [file.read_bytes() for file in files] == content
    assert {*files} == {file for file in tmp_path.rglob("*") if file.is_file()}
