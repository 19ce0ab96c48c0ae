"""Impact times from a file to a fit, its files and its picture."""

import csv
import json

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import pytest
from tools.command import run

import jaxrock as jr
from jaxrock.calibration import fit_free_rocking, read_impact_times
from jaxrock.plot import plot_free_rocking_fit

pytestmark = pytest.mark.float64

# of the block that the tests are about
P = 3.8
ANGLE = 0.2
BLOCK = jr.Block.from_parameters(P, ANGLE)
SIZE = ("--width", 2 * float(BLOCK.half_width), "--height", 2 * float(BLOCK.half_height))


def decay(count, launch=0.9, restitution=0.9, change=0.0, noise=1e-4):
    """Impact times and peaks of the linearized equation, in closed form, C linear in velocity."""
    ratios = [launch]
    for _ in range(count - 2):
        ratios.append(ratios[-1] * (restitution + change * (ratios[-1] - launch / 2)))
    ratios = np.array(ratios)
    times = np.cumsum(np.append(0.5, 2 / P * np.arctanh(ratios)))
    errors = np.random.default_rng(count).normal(0, noise, count)
    return times + errors, ANGLE * (1 - np.sqrt(1 - ratios**2))


def written(path, times, peaks=None):
    columns = [times] if peaks is None else [times, np.append(peaks, np.nan)]
    header = ",".join(["time [s]", "peak [rad]"][: len(columns)])
    np.savetxt(path, np.transpose(columns), "%.8f", ",", header=header, comments="")
    return path


@pytest.mark.thorough
def test_of_an_unknown_block(capsys, tmp_path, monkeypatch):
    """A file and nothing else; the fit is that of the library."""
    monkeypatch.chdir(tmp_path)
    times, _ = decay(14)
    written("times.csv", times)
    code, text, err = run(capsys, "fit", "times.csv")
    assert (code, err) == (0, "")
    times, peaks = read_impact_times("times.csv")
    assert peaks is None
    fit = fit_free_rocking(times)
    assert text == f"{fit}\nfit/fit.csv\nfit/fit.png\n"
    assert "\nby the linearized model, the only one without a block\n" in text
    assert "frequency parameter" in text
    with open("fit/fit.csv", encoding="utf-8") as file:
        lines = [line for line in file if not line.startswith("#")]
    rows = list(csv.DictReader(lines))
    assert [int(row["impact"]) for row in rows] == list(range(14))
    assert {row["used"] for row in rows} == {"True"}
    columns = {name: [float(row[name]) for row in rows] for name in rows[0] if name != "used"}
    np.testing.assert_array_equal(columns["time [s]"], times)
    np.testing.assert_allclose(columns["residual [s]"], fit.time_residuals, atol=1e-12)
    assert np.isnan([columns["restitution [-]"][k] for k in (0, -1)]).all()
    np.testing.assert_allclose(columns["restitution [-]"][1:-1], fit.restitutions, rtol=1e-9)
    np.testing.assert_allclose(
        columns["velocity_ratio [-]"][1:-1], fit.velocity_ratios, rtol=1e-9
    )


@pytest.mark.thorough
def test_of_a_block_as_json(capsys, tmp_path):
    times, _ = decay(12)
    path = written(tmp_path / "times.csv", times)
    # The times are those of the linearized equation.
    linear = ("--model", "linearized")
    command = ("fit", path, *SIZE, *linear, "--out", tmp_path / "out", "--json")
    code, text, _ = run(capsys, *command)
    assert code == 0
    found = json.loads(text)
    errors = found["standard_errors"]
    assert found["frequency_parameter"] == pytest.approx(P)
    assert errors["frequency_parameter"] == errors["critical_angle"] == 0
    assert abs(found["restitution"] - 0.9) < 4 * errors["restitution"] < 0.001
    assert found["time_noise"] == pytest.approx(1e-4, rel=0.6)
    assert found["rotation_noise"] is None
    assert 0 < found["frequency_p_value"] < 1
    assert (found["impacts"], found["used"], found["model"]) == (12, 12, "linearized")
    (remark,) = found["remarks"]
    assert remark.startswith("the model matters: the nonlinear one")
    assert len(found["rows"]) == 12
    assert found["rows"][0]["restitution"] is None
    assert [path.rpartition("/")[2] for path in found["files"]] == ["fit.csv", "fit.png"]


@pytest.mark.thorough
def test_of_a_block_the_model_is_nonlinear(capsys, tmp_path):
    """Of a stocky block, whose restitution the linearized equation would miss."""
    body = jr.Block(0.2, 2.0)
    velocities = jr.Nonlinear().critical_velocity(body) * 0.95 * 0.9 ** np.arange(9)
    halves = jr.Nonlinear().half_cycle_duration(body, velocities)
    noise = np.random.default_rng(3).normal(0, 1e-4, 10)
    path = written(tmp_path / "times.csv", np.append(0, np.cumsum(halves)) + noise)
    command = ("fit", path, "--width", 0.4, "--slenderness", 2, "--out", tmp_path / "out")
    code, text, _ = run(capsys, *command)
    assert code == 0
    assert "\nby the nonlinear model\n" in text
    found = {}
    for options in ((), ("--model", "linearized")):
        _, text, _ = run(capsys, *command, *options, "--force", "--json")
        answer = json.loads(text)
        found[answer["model"]] = abs(answer["restitution"] - 0.9)
    assert found["nonlinear"] < 3e-4 < found["linearized"]


@pytest.mark.thorough
def test_of_no_block_as_json(capsys, tmp_path):
    """Without the block the critical angle is unknown, and so is its error."""
    path = written(tmp_path / "times.csv", decay(12)[0])
    code, text, _ = run(capsys, "fit", path, "--out", tmp_path / "other", "--json")
    assert code == 0
    found = json.loads(text)
    assert found["critical_angle"] is found["standard_errors"]["critical_angle"] is None
    assert found["frequency_p_value"] is None


@pytest.mark.thorough
def test_options_reach_the_fit(capsys, tmp_path):
    times, peaks = decay(12)
    peaks[3] = np.nan
    path = written(tmp_path / "times.csv", times, peaks)
    options = ("--frequency-unknown", "--model", "nonlinear", "--no-repair")
    options += ("--time-noise", 2e-4, "--rotation-noise", 1e-3, "--out", tmp_path / "out")
    code, text, _ = run(capsys, "fit", path, *SIZE, *options, "--json")
    assert code == 0
    found = json.loads(text)
    assert found["standard_errors"]["frequency_parameter"] > 0
    assert (found["time_noise"], found["rotation_noise"]) == (2e-4, 1e-3)
    times, peaks = read_impact_times(path)
    fit = fit_free_rocking(
        times,
        BLOCK,
        peak_rotations=peaks,
        model="nonlinear",
        frequency_known=False,
        time_noise=2e-4,
        rotation_noise=1e-3,
        repair=False,
    )
    for name in fit.names:
        assert found[name] == pytest.approx(float(getattr(fit, name)), rel=1e-6, abs=1e-6)
    of_peaks = [row["rotation_residual"] for row in found["rows"]]
    assert [k for k, value in enumerate(of_peaks) if value is None] == [3, 11]
    assert [row["peak_rotation"] for row in found["rows"]][3] is None


@pytest.mark.thorough
def test_a_moon_and_a_statue(capsys, tmp_path):
    """Gravity and inertia ratio make the block, and thereby its p."""
    body = jr.Block(0.1, 5.0, gravity=1.62, inertia_ratio=1.2)
    velocities = body.critical_angle * body.frequency_parameter * 0.9 * 0.9 ** np.arange(9)
    durations = jr.Linearized().half_cycle_duration(body, velocities)
    noise = np.random.default_rng(2).normal(0, 1e-4, 10)
    path = written(tmp_path / "times.csv", np.append(0, np.cumsum(durations)) + noise)
    options = ("--width", 0.2, "--slenderness", 5, "--gravity", 1.62, "--inertia-ratio", 1.2)
    code, text, _ = run(capsys, "fit", path, *options, "--out", tmp_path / "out", "--json")
    assert code == 0
    found = json.loads(text)
    assert found["frequency_parameter"] == pytest.approx(float(body.frequency_parameter))
    assert found["restitution"] == pytest.approx(0.9, abs=1e-3)


def test_too_few_times(capsys, tmp_path):
    path = written(tmp_path / "times.csv", np.array([0, 0.5, 0.9]))
    sentence = f"times in {str(path)!r} must have at least 5 values to fit 4 parameters, got 3"
    answer = run(capsys, "fit", path, "--out", tmp_path / "out")
    assert answer == (2, "", f"jaxrock: error: {sentence}\n")
    assert not (tmp_path / "out").exists()


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
    assert "weighted line; p-value of" not in lines
    # The band is as wide as the scatter of single impacts, so that it can be seen.
    corners = restitutions.collections[-1].get_paths()[0].vertices
    slowest = np.nanargmin(np.where(known, fit.velocity_ratios, np.nan))
    at = corners[np.isclose(corners[:, 0], fit.velocity_ratios[slowest]), 1]
    reach = 1.96 * float(fit.restitution_errors[slowest])
    constant = float(fit.restitution)
    np.testing.assert_allclose([at.min(), at.max()], [constant - reach, constant + reach])


@pytest.mark.thorough
def test_picture_of_a_restitution_that_changes():
    """The line lies on the C that was put in."""
    change = 0.1
    launch = 0.9
    times = decay(12, launch, 0.9, change, noise=1e-5)[0]
    fit = fit_free_rocking(times, BLOCK, model="linearized")
    line = list_lines(plot_free_rocking_fit(fit).axes[1])["weighted line; p-value of"]
    true = 0.9 + change * (np.asarray(line.get_xdata()) - launch / 2)
    np.testing.assert_allclose(line.get_ydata(), true, atol=0.004)
    assert np.ptp(true) > 0.04


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


@pytest.mark.thorough
def test_picture_of_peaks_alone():
    fit = fit_free_rocking(None, BLOCK, peak_rotations=decay(10)[1], model="linearized")
    given = plt.figure()
    assert plot_free_rocking_fit(fit, given) is given
    (ax,) = given.axes
    points = list_lines(ax)["each impact, with standard"]
    np.testing.assert_allclose(points.get_ydata(), 0.9, rtol=1e-6)


@pytest.mark.thorough
def test_several_fits_are_no_picture():
    one = fit_free_rocking(decay(12)[0], BLOCK, model="linearized")
    fits = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), one)
    assert "restitution" in str(fits)
    with pytest.raises(
        ValueError, match=r"fit must be of one test, got an array of shape \(2,\)"
    ):
        plot_free_rocking_fit(fits)
