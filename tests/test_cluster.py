"""Worker processes, and stores that are continued: whatever is killed, the same bits in the end."""

import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import dask
import jax
import numpy as np
import pytest
import xarray
import zarr
from distributed import Client
from tables.grids import AXES, GRIDS, blocks, record, same_bits

import jaxrock as jr
from jaxrock.grids import local_cluster, write_zarr
from jaxrock.grids.workers import choose_accelerator, choose_processors, read_worker_number

OWN = ("identity", "computed_with")  # attributes of a store


@pytest.fixture(scope="module")
def client():
    """Of two workers with a processor each."""
    with local_cluster(2, dashboard_address=":0") as cluster, Client(cluster) as client:
        yield client


def opened(path):
    """A store in memory, without what only a store has."""
    with xarray.open_zarr(path, zarr_format=2) as found:
        loaded = found.load()
    assert {*OWN} <= loaded.attrs.keys()
    assert "unfinished" not in loaded.attrs
    loaded.attrs = {name: value for name, value in loaded.attrs.items() if name not in OWN}
    return loaded


@pytest.mark.thorough
def test_each_worker_has_processors_of_its_own(client):
    mine = sorted(os.sched_getaffinity(0))
    shares = [*client.run(lambda: sorted(os.sched_getaffinity(0))).values()]
    assert sorted(shares) == sorted(choose_processors(mine, number, 2) for number in range(2))
    assert [*client.run(lambda: jax.config.jax_enable_x64).values()] == [False, False]


@pytest.mark.thorough
def test_workers_change_no_bit(client):
    """Whatever precision they have by themselves."""
    function, (*_, chunks) = GRIDS["resonance"]
    same_bits(function(chunks=chunks).compute(), function())


@pytest.mark.thorough
def test_a_worker_that_is_killed(client):
    whole = blocks()
    number, other = client.run(os.getpid).values()
    with dask.config.set({"distributed.scheduler.allowed-failures": 10}):
        future = client.compute(blocks(chunks={"free_period": 1}))
        while not any(client.has_what().values()):
            time.sleep(0.01)
        os.kill(number, signal.SIGKILL)
        same_bits(future.result(), whole)
    assert other in client.run(os.getpid).values()
    assert number not in client.run(os.getpid).values()


def same_bits_but_attributes(found, expected):
    """What a store keeps: numbers, and attributes that are numbers or words."""
    for name in (*expected.coords, *expected.data_vars):
        assert found[name].values.tobytes() == expected[name].values.tobytes(), name
        assert found[name].dtype == expected[name].dtype
    assert found.attrs == expected.attrs


RUN = """
import sys, jax
jax.config.update("jax_enable_x64", {double})
sys.path.insert(0, {here!r})
import dask
dask.config.set(scheduler="synchronous")
from tables.grids import blocks, jr
jr.grids.write_zarr(blocks(chunks={{"free_period": 1}}), {path!r})
"""


@pytest.mark.thorough
def test_a_run_that_is_killed_is_continued(tmp_path):
    """A chunk of which a part is written counts as none."""
    path = tmp_path / "grid.zarr"
    here = str(Path(__file__).parent)
    double = jax.config.jax_enable_x64
    code = RUN.format(double=double, here=here, path=str(path))
    process = subprocess.Popen([sys.executable, "-c", code])
    while not (path / "margin").exists() or len([*(path / "margin").glob("[0-9]*.0")]) < 4:
        time.sleep(0.005)
        assert process.poll() is None
    process.kill()
    process.wait()
    with xarray.open_zarr(path, zarr_format=2) as found:
        assert found.attrs["unfinished"] == "chunks are missing"
        assert found.source == blocks(chunks="auto").source
    (path / "impacts" / "2.0").unlink(missing_ok=True)
    (path / "impacts" / "3.0.partial").write_bytes(b"what a killed writer leaves")
    variables = ("rotation_ratio", "peak_rotation", "overturned", "margin", "impacts")
    there = set.intersection(*({f.name for f in (path / v).glob("*.0")} for v in variables))
    written = {name: (path / "margin" / name).stat().st_mtime_ns for name in there}
    stored = write_zarr(blocks(chunks={"free_period": 1}), path)
    assert (stored.chunks, stored.taken_over) == (15, len(there))
    assert 3 <= len(there) < 15
    assert str(stored) == f"{path}: 15 chunks, {len(there)} from an earlier run"
    for name, when in written.items():
        assert (path / "margin" / name).stat().st_mtime_ns == when
    assert not [*path.rglob("*.partial")]
    same_bits_but_attributes(opened(path), blocks())
    assert write_zarr(blocks(chunks={"free_period": 1}), path).taken_over == 15


def grid(**changes):
    axes = {
        "slenderness": AXES[0],
        "width": AXES[1],
        "restitution": AXES[2],
        "intensity": 0.15,
    }
    return jr.resonance_spectrum(**axes | {"chunks": {"slenderness": 2}} | changes)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"width": [0.4, 0.8, 1.3]}, "belongs to another grid: its width differs"),
        ({"width": [0.4, 0.8]}, "belongs to another grid: its width differs"),
        ({"gravity": 1.62}, "belongs to another grid: its gravity is 9.81, not 1.62"),
        ({"model": "nonlinear"}, "its model is linearized, not nonlinear"),
        (
            {"chunks": {"slenderness": 3}},
            "was begun in chunks of slenderness 2, .* slenderness 3",
        ),
        ({"intensity": [0.15, 0.2]}, "belongs to another grid: "),
    ],
)
def test_a_store_of_another_grid_stays_as_it_is(tmp_path, changes, message):
    path = tmp_path / "grid.zarr"
    write_zarr(grid(), path)
    refused(grid(**changes), path, message)


def refused(lazy, path, message):
    """One sentence, and nothing in the folder is touched."""

    def content():
        return {
            f: (f.stat().st_mtime_ns, f.read_bytes()) for f in path.rglob("*") if f.is_file()
        }

    before = content()
    with pytest.raises(ValueError, match=message) as error:
        write_zarr(lazy, path)
    assert str(error.value).endswith("it is left as it is")
    assert "\n" not in str(error.value)
    assert content() == before


def test_other_versions_and_what_is_no_store(tmp_path, monkeypatch):
    path = tmp_path / "grid.zarr"
    write_zarr(grid(), path)
    monkeypatch.setattr("jaxrock.grids.zarr_store_identity.name_versions", lambda: "JAX 99.0")
    refused(grid(), path, "was begun by JAX .*, and this is JAX 99.0")
    group = zarr.open_group(path, mode="r+", zarr_format=2)
    group.attrs["source"] = "jaxrock 0.1"
    zarr.consolidate_metadata(group.store, zarr_format=2)
    refused(grid(), path, r"was begun by jaxrock 0\.1, and this is jaxrock \d")
    for name in ("folder", "other.zarr"):
        (tmp_path / name).mkdir()
    (tmp_path / "folder" / "file").write_text("something else")
    grid().compute().to_zarr(tmp_path / "other.zarr", zarr_format=2)
    (tmp_path / "file").write_text("something else")
    for name in ("folder", "other.zarr", "file"):
        refused(grid(), tmp_path / name, "is no Zarr store that write_zarr has begun")


def test_what_is_missing_in_the_end_is_said(tmp_path, monkeypatch):
    """As where a worker writes to another disk of the same path."""
    monkeypatch.setattr(
        "jaxrock.grids.zarr_store._write_chunk", lambda *_, block_id, **__: np.ones(1)
    )
    with pytest.raises(
        ValueError, match="3 chunks of rotation_ratio are not there; do all work"
    ):
        write_zarr(grid(), tmp_path / "grid.zarr")
    with xarray.open_zarr(tmp_path / "grid.zarr", zarr_format=2) as found:
        assert "unfinished" in found.attrs


@pytest.mark.thorough
def test_names_of_records_are_part_of_a_study(tmp_path):
    def study(*names):
        records = jr.Suite([record(150, 0), record(200, 1)], names)
        return jr.rocking_spectrum(records, 1.0, 5.0, chunks={"record": 1})

    write_zarr(study("first", "second"), tmp_path / "grid.zarr")
    refused(study("second", "first"), tmp_path / "grid.zarr", "its record differs")


def test_what_cannot_be_written(tmp_path):
    with pytest.raises(ValueError, match="dataset must be lazy"):
        write_zarr(grid(chunks=None), tmp_path / "grid.zarr")
    uneven = grid(chunks={"slenderness": (1, 3, 1)})
    with pytest.raises(
        ValueError, match=r"chunks along slenderness must have one length, .* \(1"
    ):
        write_zarr(uneven, tmp_path / "grid.zarr")
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(ValueError, match=r"store: the folder .*file.* cannot be written to"):
        write_zarr(grid(), tmp_path / "file" / "grid.zarr")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: b"",
        lambda content: content[:-3],
        lambda content: content[:-6] + bytes([content[-6] ^ 1]) + content[-5:],
        None,
    ],
    ids=["empty", "cut", "flipped", "missing"],
)
def test_damaged_chunks_are_computed_again(tmp_path, damage):
    path = tmp_path / "grid.zarr"
    chunk = tmp_path / "grid.zarr" / "stabilized_period" / "1.0.0"
    write_zarr(grid(), path)
    content = chunk.read_bytes()
    if damage is None:
        chunk.unlink()
    else:
        chunk.write_bytes(damage(content))
    stored = write_zarr(grid(), path)
    assert (stored.chunks, stored.taken_over) == (3, 2)
    assert chunk.read_bytes() == content


def test_a_store_that_is_damaged_beside_its_chunks(tmp_path):
    path = tmp_path / "grid.zarr"
    write_zarr(grid(), path)
    (path / "slenderness" / "0").unlink()
    refused(grid(), path, "is damaged: slenderness is not what was written")
    chunk = tmp_path / "other.zarr" / "stabilized_period" / "1.0.0"
    write_zarr(grid(), tmp_path / "other.zarr")
    chunk.unlink()
    chunk.mkdir()
    with pytest.raises(
        ValueError, match=r"1\.0\.0' is in the place of a chunk, and is no file"
    ):
        write_zarr(grid(), tmp_path / "other.zarr")


@pytest.mark.parametrize("name", ["a#b.zarr", "a?b.zarr"])
def test_paths_that_zarr_takes_for_addresses(tmp_path, name):
    with pytest.raises(ValueError, match=r"has a # or a \?, which Zarr takes for an address"):
        write_zarr(grid(), tmp_path / name)
    assert not [*tmp_path.iterdir()]


def test_a_disk_that_is_full(tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("jaxrock.grids.zarr_store._write_chunk", full)
    with pytest.raises(
        ValueError, match=r"store: .* cannot be written to: No space left"
    ) as error:
        write_zarr(grid(), tmp_path / "grid.zarr")
    assert "\n" not in str(error.value)


def test_two_runs_that_begin_a_store(tmp_path, monkeypatch):
    """The one that comes second says so."""
    path = tmp_path / "grid.zarr"
    begun = []
    lexists = os.path.lexists

    def not_yet(place):
        if not begun and Path(place) == path:
            begun.append(True)
            write_zarr(grid(), path)
            return False
        return lexists(place)

    monkeypatch.setattr("os.path.lexists", not_yet)
    with pytest.raises(ValueError, match=r"grid\.zarr' is a folder"):
        write_zarr(grid(), path)
    assert write_zarr(grid(), path).taken_over == 3


def test_chunks_that_are_nothing_but_nan(tmp_path):
    """All of these blocks overturn."""
    lazy = grid(intensity=30.0)
    assert np.isnan(lazy.stabilized_period.values).all()
    assert write_zarr(lazy, tmp_path / "grid.zarr").taken_over == 0
    assert write_zarr(lazy, tmp_path / "grid.zarr").taken_over == 3


def test_shares_of_a_machine():
    assert [choose_processors([0, 1, 2, 3, 8], k, 2) for k in (0, 1)] == [[0, 1], [2, 3, 8]]
    assert [choose_processors([4, 5], k, 3) for k in range(3)] == [[4], [5], [4]]
    with pytest.raises(ValueError, match="workers must be at least 1, got 0"):
        local_cluster(0)


def test_workers_are_told_apart_by_their_names():
    assert [read_worker_number(name) for name in (3, "2", "first-0-12")] == [3, 2, 12]
    for name in ("tcp://127.0.0.1:43159", "first"):
        with pytest.raises(ValueError, match="workers must have names that end in a number"):
            read_worker_number(name)


def test_accelerators(monkeypatch, tmp_path):
    monkeypatch.setattr("jaxrock.grids.workers._GPUS", tmp_path / "none")
    assert choose_accelerator(0, 2, {}) == {}
    assert choose_accelerator(0, 2, {"CUDA_VISIBLE_DEVICES": ""}) == {}
    two = {"CUDA_VISIBLE_DEVICES": "4,7"}
    assert choose_accelerator(1, 2, two) == {"CUDA_VISIBLE_DEVICES": "7"}
    shared = choose_accelerator(2, 3, two)
    assert shared == {"CUDA_VISIBLE_DEVICES": "4", "XLA_PYTHON_CLIENT_PREALLOCATE": "false"}
    for name in ("first", "second"):
        (tmp_path / "gpus" / name).mkdir(parents=True)
    monkeypatch.setattr("jaxrock.grids.workers._GPUS", tmp_path / "gpus")
    assert choose_accelerator(1, 2, {}) == {"CUDA_VISIBLE_DEVICES": "1"}
