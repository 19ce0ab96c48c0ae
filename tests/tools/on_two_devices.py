"""Numbers do not depend on how many devices share the work.

Run by ``test_devices.py``, or as ``pytest --devices 2 tests/tools/on_two_devices.py``.
"""

import jax
import numpy as np
import pytest
from scenes import GRID

import jaxrock as jr


@pytest.fixture
def devices():
    both = jax.local_devices()
    assert len(both) == 2
    return both


def test_spectrum(tmp_path, monkeypatch, devices):
    monkeypatch.setattr("jaxrock.spectra.resonance._TILES", (60, 60))
    grid = GRID | {"slenderness": np.linspace(3, 10, 37)}
    shared = jr.resonance_spectrum(**grid)
    stored = jr.resonance_spectrum(**grid, store=tmp_path / "spectrum.nc")
    monkeypatch.setattr(jax, "local_devices", lambda **_: devices[:1])
    single = jr.resonance_spectrum(**grid)
    with stored:
        for name in single:
            np.testing.assert_allclose(shared[name], single[name], rtol=1e-12, err_msg=name)
            np.testing.assert_allclose(stored[name], single[name], rtol=1e-12, err_msg=name)


def test_batch(monkeypatch, devices):
    """In four parts, which the devices take in turns."""
    rooms = "jaxrock.driven.many_blocks"
    monkeypatch.setattr(f"{rooms}.respond_many.count_processors", lambda: 4)
    few = f"{rooms}.pulse_inputs.PulseInput.fewest_for_two_threads"
    monkeypatch.setattr(few, lambda _: 1)
    pulses = jr.Sine(np.linspace(1.5, 6.0, 30), 0.6)
    shared = jr.respond_batch(jr.Block(0.4, 5.0), 0.9, pulses, 4.0)
    monkeypatch.setattr(jax, "local_devices", lambda **_: devices[:1])
    single = jr.respond_batch(jr.Block(0.4, 5.0), 0.9, pulses, 4.0)
    assert np.ptp(single.peak_rotation) > 0
    for ours, theirs in zip(jax.tree.leaves(shared), jax.tree.leaves(single), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-12)


def test_inside_of_shard_map(devices):
    """The numbers of `vmap`, with the option that the page on many devices names."""
    along = jax.sharding.PartitionSpec("device")

    def respond(amplitudes):
        block = jr.Block(0.4, 5.0)
        many = jr.respond_batch(block, 0.9, jr.Sine(amplitudes, 0.6), 4.0).peak_rotation
        single = jax.vmap(lambda a: jr.respond(block, 0.9, jr.Sine(a, 0.6), 4.0).peak_rotation)
        return many, single(amplitudes)

    mapped = jax.shard_map(
        respond,
        mesh=jax.sharding.Mesh(np.array(devices), ("device",)),
        in_specs=along,
        out_specs=along,
        check_vma=False,
    )
    amplitudes = np.linspace(1.5, 6.0, 4)
    for ours, theirs in zip(jax.jit(mapped)(amplitudes), respond(amplitudes), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-12)
