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


def decay(count, launch=0.9, restitution=0.9, change=0.0, noise=1e-4):
    """Impact times and peaks of the linearized equation, in closed form, C linear in velocity."""
    ratios = [launch]
    for _ in range(count - 2):
        ratios.append(ratios[-1] * (restitution + change * (ratios[-1] - launch / 2)))
    ratios = np.array(ratios)
    times = np.cumsum(np.append(0.5, 2 / P * np.arctanh(ratios)))
    errors = np.random.default_rng(count).normal(0, noise, count)
    return times + errors, ANGLE * (1 - np.sqrt(1 - ratios**2))


def list_lines(ax):
    """The lines of a panel, by the first words of their entries in the legend."""
    return {line.get_label().split("\n")[0].split(":")[0]: line for line in ax.get_lines()}


@pytest.mark.thorough
def test_picture_of_a_constant_restitution():
    fit = fit_free_rocking(decay(12)[0], BLOCK, model="linearized")
    durations, restitutions = plot_free_rocking_fit(fit).axes
    lines = list_lines(durations)
    np.testing.assert_array_equal(lines["measured"].get_xdata(), np.arange(11) + 0.5)
    np.testing.assert_allclose(lines["measured"].get_ydata(), np.diff(decay(12)[0]))
    ratios = float(fit.launch_ratio) * float(fit.restitution) ** np.arange(11)
    computed = 2 / P * np.arctanh(ratios)
    np.testing.assert_allclose(lines["fitted"].get_ydata(), computed, rtol=1e-6)
    lines = list_lines(restitutions)
    points = lines["each impact, with standard"]
    known = np.isfinite(fit.restitutions)
    np.testing.assert_allclose(
        np.sort(points.get_xdata()), np.sort(fit.velocity_ratios[known])
    )
    np.testing.assert_allclose(lines["constant"].get_ydata(), float(fit.restitution))
    assert "weighted line" not in lines
    # The band is as wide as the scatter of single impacts, so that it can be seen.
    corners = restitutions.collections[-1].get_paths()[0].vertices
    slowest = np.nanargmin(np.where(known, fit.velocity_ratios, np.nan))
    at = corners[np.isclose(corners[:, 0], fit.velocity_ratios[slowest]), 1]
    reach = 1.96 * float(fit.restitution_errors[slowest])
    constant = float(fit.restitution)
    np.testing.assert_allclose([at.min(), at.max()], [constant - reach, constant + reach])


@pytest.mark.thorough
def test_picture_of_what_was_repaired():
    clean = decay(24)[0]
    faulty = np.insert(np.delete(clean, [5, 6]), 10, clean[11] + 0.005)
    faulty[16] += 0.02
    fit = fit_free_rocking(faulty, BLOCK, model="linearized")
    assert len(fit.repairs) == 4
    lines = list_lines(plot_free_rocking_fit(fit).axes[0])
    assert lines["impact missing"].get_xdata().tolist() == [5, 6]
    assert lines["time left out"].get_xdata().tolist() == [11, 17]
    there = np.asarray(lines["measured"].get_xdata())
    assert not set(there) & {4.5, 5.5, 6.5, 16.5, 17.5}
    durations = np.diff(clean)[there.astype(int)]
    np.testing.assert_allclose(lines["measured"].get_ydata(), durations)
