"""Spectra of driven motion are the batch's answers with their labels."""

import numpy as np
import pytest

import jaxrock as jr


@pytest.mark.float64
def test_responses_over_the_plane():
    """Housner's threshold lies between the amplitudes on its sides, for every size."""
    ratio = np.pi / np.array([0.5, 1.0, 2.0])  # of frequencies, for p t1
    for k, edge in enumerate((2.5414941, 1.5819768, 1.1565177)):
        sides = [0.999 * edge, 1.001 * edge]
        found = jr.overturning_map(
            jr.Rectangular, ratio, amplitude_ratio=sides, model="linearized"
        )
        assert found.overturned.values[k].tolist() == [0, 1]


@pytest.mark.thorough
@pytest.mark.float64
def test_overturning_map():
    """Its boundaries are those of the outcomes over the plane, and Housner's closed form."""
    ratio = np.array([1.0, 3.0, 6.0])
    found = jr.overturning_map(jr.Sine, ratio, (1.0, 12.0), restitution=0.9)
    levels = np.geomspace(1.01, 11.9, 57)
    plane = jr.overturning_map(jr.Sine, ratio, amplitude_ratio=levels, restitution=0.9)
    edges = found.amplitude_ratio.values
    passed = (edges[:, :, None] < levels).sum(axis=1)
    np.testing.assert_array_equal((passed + found.overturns_first.values[:, None]) % 2,
                                  plane.overturned.values)  # fmt: skip
    assert int((found.overturns_beyond == 0).sum()) > (np.isnan(edges)).sum()  # a window
    assert set(found.impacts.values[np.isfinite(edges)].tolist()) <= {0, 1, 2}
    linear = jr.overturning_map(jr.Rectangular, np.pi, model="linearized")  # p t1 = 1
    assert float(linear.amplitude_ratio[0]) == pytest.approx(1.5819767068693265, rel=1e-9)


@pytest.mark.float64
@pytest.mark.thorough
def test_each_block_at_its_tolerance():
    """What "auto" says of a block is true of it, and the tolerance is kept where it says so."""
    record = jr.example_record().scaled(1.5)
    grid = (np.linspace(1.0, 6.0, 12), np.array([4.0, 8.0]), [0.9])
    usual = jr.rocking_spectrum(record, *grid)
    auto = jr.rocking_spectrum(record, *grid, tolerance=1e-5)
    assert auto.attrs["tolerance"] == 1e-5
    kept = auto.within_tolerance.values == 1
    assert kept.mean() > 0.8
    assert len(np.unique(auto.rtol)) > 1
    assert (auto.error.values[kept] <= 1e-5).all()
    off = np.abs(auto.peak_rotation / usual.peak_rotation - 1).values
    assert (off[kept] <= auto.error.values[kept] + 1e-9).all()
    for rtol in np.unique(auto.rtol):
        at = auto.to_dataframe().reset_index()
        (k, *_) = np.flatnonzero(at["rtol"] == rtol)
        size = 0.75 * 9.81 * (at["free_period"][k] / (2 * np.pi)) ** 2
        block = jr.Block(size / np.sqrt(1 + at["slenderness"][k] ** 2), at["slenderness"][k])
        alone = jr.respond_batch(block, 0.9, record, rtol=float(rtol))
        assert float(alone.peak_rotation) == at["peak_rotation"][k]
