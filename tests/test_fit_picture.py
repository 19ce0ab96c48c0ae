"""The picture of a test of free rocking."""

import numpy as np
import pytest

import jaxrock as jr
from jaxrock.calibration import fit_free_rocking
from jaxrock.plot import plot_free_rocking_fit

pytestmark = pytest.mark.float64

P = 3.8
ANGLE = 0.2
BLOCK = jr.Block.from_parameters(P, ANGLE)


def decay(count):
    """Impact times of the linearized equation, in closed form."""
    times = np.cumsum(np.append(0.5, 2 / P * np.arctanh(0.9 * 0.9 ** np.arange(count - 1))))
    return times + np.random.default_rng(count).normal(0, 1e-4, count)


def list_lines(ax):
    """The lines of a panel, by the first words of their entries in the legend."""
    return {line.get_label().split("\n")[0].split(":")[0]: line for line in ax.get_lines()}


@pytest.mark.thorough
def test_picture():
    """Of a test with two impacts missing and two wrong times."""
    clean = decay(24)
    faulty = np.insert(np.delete(clean, [5, 6]), 10, clean[11] + 0.005)
    faulty[16] += 0.02
    fit = fit_free_rocking(faulty, BLOCK, model="linearized")
    assert len(fit.repairs) == 4
    durations, restitutions = plot_free_rocking_fit(fit).axes
    lines = list_lines(durations)
    assert lines["impact missing"].get_xdata().tolist() == [5, 6]
    assert lines["time left out"].get_xdata().tolist() == [11, 17]
    there = np.asarray(lines["measured"].get_xdata())
    assert not set(there) & {4.5, 5.5, 6.5, 16.5, 17.5}
    measured = np.diff(clean)[there.astype(int)]
    np.testing.assert_allclose(lines["measured"].get_ydata(), measured)
    ratios = float(fit.launch_ratio) * float(fit.restitution) ** (there - 0.5)
    computed = 2 / P * np.arctanh(ratios)
    np.testing.assert_allclose(lines["fitted"].get_ydata(), computed, rtol=1e-6)
    lines = list_lines(restitutions)
    known = np.isfinite(fit.restitutions)
    points = lines["each impact, with standard"].get_xdata()
    np.testing.assert_allclose(np.sort(points), np.sort(fit.velocity_ratios[known]))
    np.testing.assert_allclose(lines["constant"].get_ydata(), float(fit.restitution))
    assert "weighted line" not in lines
