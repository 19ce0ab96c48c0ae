"""Lazy datasets are those in memory, to the last bit, and an xarray user finds what they expect."""

import importlib
import inspect
import sys

import dask
import dask.array as da
import equinox as eqx
import numpy as np
import pytest
import xarray
from tables.grids import AXES, GRIDS, record, same_bits, suite
from tools.selection import some_by_default

import jaxrock as jr
from jaxrock.driven import follow_batch
from jaxrock.grids import apply_padded
from jaxrock.grids.lazy import choose_chunks
from jaxrock.spectra import resonance

SHORT = {"resonance", "rocking"}  # to compile


@pytest.mark.parametrize("name", some_by_default(GRIDS, SHORT))
def test_chunks_change_no_bit(name):
    function, several = GRIDS[name]
    whole = function()
    for chunks in several:
        lazy = function(chunks=chunks)
        for variable in lazy.data_vars.values():
            assert isinstance(variable.data, da.Array)
        kinds = {name: (v.dims, v.shape, v.dtype) for name, v in lazy.data_vars.items()}
        assert kinds == {
            name: (v.dims, v.shape, v.dtype) for name, v in whole.data_vars.items()
        }
        if chunks != "auto":
            for dim, length in chunks.items():
                assert max(lazy.chunks[dim]) == min(length, whole.sizes[dim])
        assert all(
            len(lengths) == 1 for dim, lengths in lazy.chunks.items() if dim not in chunks
        )
        same_bits(lazy.compute(), whole)


@pytest.mark.parametrize("scheduler", ["synchronous", "threads"])
def test_schedulers(tmp_path, scheduler):
    function, (_, chunks, _) = GRIDS["resonance"]
    whole = function()
    lazy = function(chunks=chunks)
    with dask.config.set(scheduler=scheduler):
        same_bits(lazy.compute(), whole)
        lazy.to_zarr(tmp_path / "grid.zarr", zarr_format=2)
    with xarray.open_zarr(tmp_path / "grid.zarr") as stored:
        for name in whole:
            assert stored[name].values.tobytes() == whole[name].values.tobytes()


@pytest.mark.thorough
@pytest.mark.parametrize("model", ["linearized", "nonlinear"])
def test_tiles_of_all_sizes_round_alike(monkeypatch, model):
    """On one processor they are smaller than on several."""
    axes = (np.linspace(3, 9, 40), np.linspace(0.2, 2, 30), np.linspace(0.5, 0.9, 10), 0.15)
    found = []
    for tile in resonance._TILES:
        monkeypatch.setattr(resonance, "_TILES", (tile, tile))
        found.append(jr.resonance_spectrum(*axes, model=model))
    same_bits(*found)


def test_nothing_is_computed_before_it_is_asked_for(monkeypatch):
    asked = []

    def counted(points, *rest, single=resonance._compute_by_model, **options):
        asked.append(points.shape[1])
        return single(points, *rest, **options)

    monkeypatch.setattr(resonance, "_compute_by_model", counted)
    lazy = jr.resonance_spectrum(*AXES, 0.15, chunks={"slenderness": 2})
    assert str(lazy.stabilized_period.data).startswith("dask.array")
    assert asked == []
    with dask.config.set(scheduler="synchronous"):
        point = lazy.sel(slenderness=9.0, width=0.8, restitution=0.6).compute()
    assert asked == [6]  # the last chunk, one slenderness
    assert float(point.stabilized_period) == float(
        jr.resonance_spectrum(9.0, 0.8, 0.6, 0.15).stabilized_period
    )


def test_equal_grids_have_equal_names():
    """So that Dask and stores know them again, in every process."""

    def names(**options):
        axes = {"slenderness": 5.0, "restitution": 0.8} | options
        lazy = jr.rocking_spectrum(suite(), [1.0, 2.0], chunks={"record": 1}, **axes)
        return [variable.data.name for variable in lazy.data_vars.values()]

    assert names() == names()
    for other in (
        {"slenderness": 5.1},
        {"gravity": 1.62},
        {"factor": 2.0},
        {"model": "linearized"},
    ):
        assert not {*names()} & {*names(**other)}
    first, other = (
        jr.rocking_spectrum(record(150, k), [1.0, 2.0], 5.0, chunks="auto").margin.data.name
        for k in (0, 1)
    )
    assert first != other


@pytest.mark.thorough
def test_a_map_lists_what_there_is():
    """As many boundaries as there are, or the lowest of them; the count says so."""
    found = jr.overturning_map(jr.Sine, [0.5, 4.0], restitution=0.9)
    assert found["count"].values.tolist() == [1, 3]
    assert found.sizes["boundary"] == 3
    lazy = jr.overturning_map(
        jr.Sine, [0.5, 4.0], restitution=0.9, chunks={"frequency_ratio": 1}
    )
    assert lazy.sizes["boundary"] == 16
    same_bits(lazy.compute().isel(boundary=slice(3)), found)
    listed = jr.overturning_map(jr.Sine, [0.5, 4.0], restitution=0.9, max_boundaries=2)
    same_bits(listed, found.isel(boundary=slice(2)))


def test_factors_are_those_on_the_motion():
    motion = record(200, 3)
    axes = ([1.0, 2.0], [4.0, 6.0], 0.8)
    found = jr.rocking_spectrum(motion, *axes, factor=[0.5, 2.0])
    for factor in (0.5, 2.0):
        alone = jr.rocking_spectrum(motion.scaled(factor), *axes)
        for name in alone:
            values = found[name].sel(factor=factor).values
            assert values.tobytes() == alone[name].values.tobytes()


def test_what_goes_wrong_in_a_task_comes_back(monkeypatch):
    lazy = jr.overturning_spectrum(jr.Sine, [1.0, 2.0], 2.0, chunks={"frequency_ratio": 1})
    monkeypatch.setattr("jaxrock.spectra.driven.follow_batch", incomplete)
    with pytest.raises(
        ValueError, match=r"not finish for frequency ratio [12], amplitude ratio 2$"
    ):
        lazy.compute(scheduler="synchronous")


def incomplete(*arguments, **options):
    response = follow_batch(*arguments, **options)
    stopped = np.full_like(response.status, jr.Status.STOPPED)
    return eqx.tree_at(lambda r: r.status, response, stopped)


def test_without_the_extra(monkeypatch):
    for name in [
        name for name in sys.modules if name == "jaxrock.grids.lazy" or "zarr_store" in name
    ]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "dask", None)
    said = r"dask is not installed; .* 'jaxrock\[cluster\]' brings it"
    with pytest.raises(ModuleNotFoundError, match=said):
        jr.resonance_spectrum(*AXES, 0.15, chunks="auto")
    with pytest.raises(ModuleNotFoundError, match=said):
        _ = jr.grids.write_zarr


def test_without_the_extra_what_needs_it_is_not_listed(monkeypatch):
    """`help` and a star import get all that is listed."""
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    try:
        importlib.reload(jr.grids)
        assert dir(jr.grids) == jr.grids.__all__ == ["write_table"]
        assert inspect.getmembers(jr.grids) == [("write_table", jr.write_table)]
    finally:
        monkeypatch.undo()
        importlib.reload(jr.grids)
    assert "write_zarr" in dir(jr.grids)


@pytest.mark.parametrize(
    ("sizes", "largest", "expected"),
    [
        ({"a": 10, "b": 4}, 12, {"a": (3, 3, 3, 1), "b": (4,)}),
        ({"a": 10, "b": 4}, 3, {"a": (1,) * 10, "b": (3, 1)}),
        ({"a": 2, "b": 4}, 100, {"a": (2,), "b": (4,)}),
    ],
)
def test_usual_chunks(sizes, largest, expected):
    assert choose_chunks("auto", sizes, largest) == expected
    explicit = choose_chunks({"a": expected["a"], "b": expected["b"][0]}, sizes, largest)
    assert explicit == expected


def test_functions_see_few_shapes():
    seen = []

    def twice(values):
        seen.append(values.shape)
        return 2 * values

    for size in (1, 100, 256, 257, 400):
        values = np.arange(size, dtype=float)
        np.testing.assert_array_equal(apply_padded(twice, values), 2 * values)
    assert {*seen} == {(256,), (512,)}
