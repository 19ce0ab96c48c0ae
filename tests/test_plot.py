import matplotlib.pyplot as plt
import numpy as np
import pytest
from PIL import Image

import jaxrock as jr
from jaxrock.plot import animate, plot_curves, plot_phase, plot_response, plot_spectrum


@pytest.fixture(scope="module")
def spectrum():
    return jr.resonance_spectrum(np.linspace(3, 10, 29), [0.4, 1.2], [0.6, 0.8], 0.15)


@pytest.fixture(autouse=True)
def close_figures():
    yield
    plt.close("all")


def test_curves_end_where_the_block_overturns(spectrum):
    _, given = plt.subplots()
    data = spectrum.rotation_ratio.sel(restitution=0.8)
    ax = plot_curves(data, hue="width", ax=given)
    assert ax is given
    small, end, large = ax.get_lines()  # a cross where a curve ends
    np.testing.assert_array_equal(small.get_ydata(), data.sel(width=0.4))
    np.testing.assert_array_equal(large.get_ydata(), data.sel(width=1.2))
    assert end.get_xdata().tolist() == [4.75]  # overturns from a slenderness of 4.8
    assert end.get_marker() == "x"
    assert small.get_linestyle() != large.get_linestyle()
    assert ax.get_xlim() == (3, 10)
    assert ax.get_ylim()[0] == 0
    assert ax.get_xlabel() == r"slenderness $\lambda$"
    assert ax.get_ylabel() == r"rotation ratio $\alpha^*_{max}/\alpha_c$"
    legend = ax.get_legend()
    assert legend.get_title().get_text() == "width $2b$ [m]"
    assert [text.get_text() for text in legend.get_texts()] == ["0.4", "1.2"]


def test_curves_begin_where_the_block_stands(spectrum):
    data = spectrum.rotation_ratio.sel(restitution=0.8, slenderness=[10.0, 5.0])
    curve, start, *_ = plot_curves(data, hue="slenderness", along="width").get_lines()
    assert curve.get_xdata().tolist() == [0.4, 1.2]
    assert start.get_xdata().tolist() == [1.2]


def test_any_order_one_point_and_negative_values(spectrum):
    shuffled = spectrum.isel(slenderness=[28, 0, 14]).period.sel(restitution=0.6)
    line = plot_curves(shuffled, hue="width").get_lines()[0]
    assert line.get_xdata().tolist() == [3.0, 6.5, 10.0]
    line = plot_curves(shuffled.isel(slenderness=[0]), hue="width").get_lines()[0]
    assert line.get_marker() == "o"
    figure = plot_spectrum(spectrum, "overturning_margin")
    assert figure.axes[1].get_ylim()[0] < float(spectrum.overturning_margin.min()) < 0
    assert figure.axes[0].get_ylabel() == "overturning margin"


def test_new_axes_and_units(spectrum):
    ax = plot_curves(spectrum.period.sel(width=0.4), hue="restitution")
    assert ax.get_ylabel() == "stabilized period $T^*$ [s]"


def test_curves_refuse_other_dimensions(spectrum):
    with pytest.raises(ValueError, match="variable must have the dimensions"):
        plot_curves(spectrum.period, hue="width")


def test_a_panel_each_restitution(spectrum):
    figure = plot_spectrum(spectrum)
    assert [ax.get_title() for ax in figure.axes] == [
        "$C$ = 0.6, $I$ = 0.15 m/s",
        "$C$ = 0.8, $I$ = 0.15 m/s",
    ]
    assert [ax.get_legend() is None for ax in figure.axes] == [True, False]
    top = np.nanmax(spectrum.rotation_ratio)
    assert all(top < ax.get_ylim()[1] < 1.2 * top for ax in figure.axes)


def test_of_many_values_some_are_drawn():
    many = jr.resonance_spectrum(
        [3.0, 4.0], np.linspace(0.4, 1.2, 20), np.linspace(0.1, 0.6, 9), [0.1, 0.15]
    )
    figure = plot_spectrum(many, "period")
    assert len(figure.axes) == 8
    assert all(len(ax.get_lines()) == 7 for ax in figure.axes)
    assert figure.axes[0].get_title() == "$C$ = 0.1, $I$ = 0.1 m/s"
    assert figure.axes[-1].get_title() == "$C$ = 0.6, $I$ = 0.15 m/s"
    without_pulses = plot_spectrum(many, "critical_intensity")
    assert without_pulses.axes[0].get_title() == "$C$ = 0.1"


@pytest.fixture(scope="module")
def response():
    return jr.respond(jr.Block(0.3, 4.0), 0.8, jr.Sine(3.5, 0.7), 4.0)


def test_rotation_over_time(response):
    _, given = plt.subplots()
    ax = plot_response(response, given)
    assert ax is given
    curve, ticks, *levels = ax.get_lines()
    peak = float(response.peak_rotation / response.scene.block.critical_angle)
    assert np.abs(curve.get_ydata()).max() == pytest.approx(peak, rel=1e-4)
    shown = np.asarray(ticks.get_xdata())
    assert np.isfinite(shown).sum() == response.impacts > 3
    assert sorted(line.get_ydata()[0] for line in levels) == [-1, 1]
    assert ax.get_ylim()[1] > peak
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("time [s]", r"rotation $\alpha/\alpha_c$")


def test_phase_portrait(response):
    ax = plot_phase(response)
    path, *separatrix = ax.get_lines()
    # Broken at impacts: nowhere a line from the velocity before to the one after.
    velocity = path.get_ydata()
    jumps = np.abs(np.diff(velocity)) > 0.1 * np.nanmax(np.abs(velocity))
    assert not jumps.any()
    assert np.isnan(velocity).sum() > 3
    # The separatrix ends upright in the critical velocity, and is at rest at the critical angle.
    critical = jr.Nonlinear().critical_velocity(response.scene.block)
    block = response.scene.block
    scale = float(block.frequency_parameter * block.critical_angle)
    for line in separatrix:
        x, y = line.get_data()
        assert abs(y[0]) == pytest.approx(float(critical) / scale, rel=1e-5)
        assert np.interp(1, np.abs(x), np.abs(y)) == pytest.approx(0, abs=0.01)
    assert len(separatrix) == 4
    assert ax.get_ylabel() == r"velocity $\dot\alpha/(p\,\alpha_c)$"


def test_animation(response, tmp_path):
    animate(response, tmp_path / "block.gif", frames_per_second=5)
    with Image.open(tmp_path / "block.gif") as film:
        assert film.n_frames == 20
        first = np.asarray(film.convert("L"), int)
        film.seek(5)
        assert np.abs(np.asarray(film.convert("L"), int) - first).max() > 50
