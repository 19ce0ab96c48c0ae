"""What the figures show: their lines against the answers, units, legends, texts apart."""

import inspect
import re

import jax
import jax.numpy as jnp
import jaxtyping
import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray
from tools.pictures import find_clashes
from tools.selection import first_by_default

import jaxrock as jr
from jaxrock import plot
from jaxrock.sensitivity.measures import arrange_bars

WALL = jr.Scene(jr.Block(0.4, 5.0), restitution=0.7, intensity=0.15)


@pytest.fixture(scope="module")
def spectrum():
    return jr.resonance_spectrum(np.linspace(3, 10, 29), [0.4, 1.2], [0.6, 0.8], 0.15)


def respond(amplitude, duration):
    return jr.respond(jr.Block(0.3, 4.0), 0.8, jr.Sine(amplitude, duration), 4.0)


@pytest.fixture(scope="module")
def boundaries():
    return jr.overturning_map(jr.Sine, [2.0, 3.0], (1.0, 12.0), restitution=0.9)


@pytest.fixture(scope="module")
def curves():
    pulse = np.sin(np.linspace(0, 2 * np.pi, 200))
    suite = jr.Suite([jr.Record(a * pulse, a / 400) for a in (1.0, 2.0, 3.0)])
    return jr.risk.fragility(jr.Block(0.1, 5.0), 0.8, suite, np.geomspace(0.2, 3, 7))


def scores():
    """As of `cross_validate`: four tests, one of which no split has predicted, in three bins."""
    probability = [[0.1, 0.75, 0.95, np.nan], [0.5, 0.4, 0.6, 0.7]]
    return xarray.Dataset(
        {
            "brier": (("predictor", "split"), [[0.04, 0.06, np.nan], [0.2, 0.2, 0.2]]),
            "probability": (("predictor", "test"), probability),
            "overturned": ("test", np.array([0, 0, 1, 1], np.int8)),
            "pgv": ("test", [0.1, 0.5, 2.0, 1.0]),
            "pga": ("test", [1.0, 9.0, 8.0, 5.0]),
            "predicted": ("bin", [0.1, np.nan, 0.85]),
            "observed": ("bin", [0.0, np.nan, 0.5]),
            "observed_low": ("bin", [0.0, np.nan, 0.03]),
            "observed_high": ("bin", [0.95, np.nan, 0.97]),
            "tests": ("bin", [1, 0, 2]),
        },
        {"predictor": ["blocks", "pgv"]},
        {"confidence": 0.9},
    )


def windows():
    """Boundaries as a search would give them."""
    values = np.array([4.0, 8.0, 8.4])
    fields = (values, np.array([True, False, True]), np.zeros(3, int), np.zeros(3, bool))
    single = (np.asarray(3), np.asarray(False), np.asarray(True))
    return jr.overturning.Boundaries(*jax.device_put((*fields, *single)), "width")


def bars_of(*answers):
    """Bars from the answer with all parameters unchanged, and both answers of each parameter."""
    middle, *pairs = answers
    names = ("slenderness", "half_width", "a parameter that somebody named at great length")
    ranges = dict.fromkeys(names[: len(pairs)], (0.12345, 12345.6))
    return arrange_bars(np.array([middle, *np.ravel(pairs)]), ranges)


def map_of(values):
    """A map of these values, 20 by 30."""
    axes = {"half_width": np.linspace(0.2, 0.6, 20), "slenderness": np.linspace(3, 10, 30)}
    attributes = {"long_name": "elasticity", "units": "1"}
    return xarray.DataArray(np.reshape(values, (20, 30)), axes, list(axes), attrs=attributes)


@pytest.mark.thorough
@pytest.mark.float64
def test_all_draw_on_the_axes_given_with_units_and_texts_apart(spectrum, boundaries, curves):
    period = spectrum.stabilized_period.sel(restitution=0.6)
    floor = jr.spectra.harmonic_spectrum(np.linspace(1, 5, 12), np.geomspace(0.02, 9, 14))
    slopes = map_of(np.where(np.arange(600) < 580, 1.0 - np.arange(600) / 200, np.nan))
    bars = bars_of(0.3, (0.1, np.nan), (0.2, 0.5), (0.31, 0.3))
    calls = {
        plot.plot_curves: (period, "width"),
        plot.plot_boundaries: (windows(), (2.0, 20.0)),
        plot.plot_critical_intensity: (WALL.block, 0.7, 0.15),
        plot.plot_fragility: (curves,),
        plot.plot_harmonic: (floor,),
        plot.plot_outcomes: (scores(),),
        plot.plot_overturning_map: (boundaries,),
        plot.plot_reliability: (scores(),),
        plot.plot_resonance: (WALL,),
        plot.plot_response: (respond(3.5, 0.7),),
        plot.plot_sensitivity_map: (slopes,),
        plot.plot_tornado: (bars,),
    }
    for function, arguments in calls.items():
        name = function.__name__
        _, given = plt.subplots()
        assert function(*arguments, ax=given) is given, name
        new = function(*arguments)
        assert new.get_xlabel(), name
        for ax in (new, *new.figure.axes, *new.child_axes):
            for axis in (ax.xaxis, ax.yaxis):
                label = axis.get_label().get_text()
                # Without a label: names of numbers, or the neighbour's.
                assert re.search(r" \[[^ ]+\]$", label) or label in ("", "answer"), label
        assert find_clashes(new.figure) == [], name
        plt.close("all")


@pytest.mark.thorough
def test_panels_stand_in_the_place_of_the_axes_given(spectrum):
    figure, (left, right) = plt.subplots(1, 2, figsize=(12, 5), layout="constrained")
    left.plot([1, 2])
    panels = plot.plot_spectrum(spectrum, ax=right).axes
    assert figure.axes == [left, *panels]
    figure.draw_without_rendering()
    assert min(panel.get_window_extent().x0 for panel in panels) > left.get_window_extent().x1
    assert find_clashes(figure) == []
    plt.close("all")


def test_every_picture_says_what_it_is_drawn_of(monkeypatch):
    # Without the types that the tests check, which would answer before the package does.
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    for name in plot.__all__:
        draw = getattr(plot, name)
        parameters = inspect.signature(draw).parameters.values()
        needed = [each.name for each in parameters if each.default is each.empty]
        with pytest.raises(ValueError, match=r"got 'a block'.*; .+ gives one"):
            draw("a block", *needed[1:])


def test_curves_end_where_the_block_overturns(spectrum):
    data = spectrum.rotation_ratio.sel(restitution=0.8)
    ax = plot.plot_curves(data, hue="width")
    small, end, large, _ = ax.get_lines()  # a cross where a curve ends
    np.testing.assert_array_equal(small.get_ydata(), data.sel(width=0.4))
    np.testing.assert_array_equal(large.get_ydata(), data.sel(width=1.2))
    assert end.get_xdata().tolist() == [4.75]  # overturns from a slenderness of 4.8
    assert (ax.get_xlim(), ax.get_ylim()[0]) == ((3, 10), 0)
    assert ax.get_xlabel() == r"slenderness $\lambda$ [-]"
    assert ax.get_ylabel() == r"rotation ratio $\alpha^*_{max}/\alpha_c$ [-]"
    assert ax.get_legend_handles_labels()[1] == ["0.4", "1.2", "overturns beyond"]
    with pytest.raises(ValueError, match="variable must have the dimensions"):
        plot.plot_curves(spectrum.stabilized_period, hue="width")


def test_rotation_ratios_are_drawn_up_to_the_threshold(spectrum):
    left, right = plot.plot_spectrum(spectrum).axes
    curve, cross, *_ = right.get_lines()
    threshold = float(jr.critical_slenderness(jr.Block(0.2, 1.0), 0.8, 0.15))
    for line in (curve, cross):
        x, y = np.asarray(line.get_data())[:, -1]
        assert (x, y) == (pytest.approx(threshold), 1)
    # Between the last point of the grid and the threshold, too, the curve is right.
    x, y = np.asarray(curve.get_data())[:, -15]
    between = jr.rotation_ratio(jr.Scene(jr.Block(0.2, x), 0.8, 0.15))
    assert y == pytest.approx(float(between), abs=0.005)
    assert left.get_legend() is None


def test_of_many_values_some_are_drawn_and_the_figure_says_so():
    axes = np.linspace(3, 4, 600), np.linspace(0.4, 1.2, 20), np.linspace(0.1, 0.6, 9)
    many = jr.resonance_spectrum(*axes, intensity=[0.1, 0.15])
    figure = plot.plot_spectrum(many, "stabilized_period")
    drawn = "width 7 of 20, slenderness 500 of 600, restitution 4 of 9"
    assert figure.get_supxlabel() == f"drawn: {drawn}"
    lines = [line.get_xdata() for ax in figure.axes for line in ax.get_lines()]
    assert len(lines) == 8 * 7
    assert {(x.size, x[0], x[-1]) for x in lines} == {(500, 3, 4)}
    assert find_clashes(figure) == []


def test_rocking_spectrum():
    axes = np.linspace(2, 6, 5), [4.0, 6.0], [0.8, 0.9]
    dataset = jr.rocking_spectrum(jr.Sine(4.0, 0.9), *axes)
    figure = plot.plot_rocking_spectrum(dataset)
    chosen = dataset.sel(restitution=0.9, slenderness=6.0)
    assert 0 < int(chosen.overturned.sum()) < 5
    drawn = {line.get_label(): line for line in figure.axes[1].get_lines()}
    expected = np.where(chosen.overturned == 0, chosen.rotation_ratio, np.nan)
    np.testing.assert_array_equal(drawn["6"].get_ydata(), expected)
    assert find_clashes(figure) == []


def test_rotation_over_time():
    response = respond(3.5, 0.7)
    ax = plot.plot_response(response)
    peak = float(response.peak_rotation / response.scene.block.critical_angle)
    assert np.abs(ax.get_lines()[0].get_ydata()).max() == pytest.approx(peak, rel=1e-4)
    feet, tips = np.transpose([line[:, 1] for line in ax.collections[0].get_segments()])
    assert tips.size == response.impacts > 3
    speeds = np.abs(np.asarray(response.impact_velocities))
    np.testing.assert_allclose((tips - feet) / (tips - feet).max(), speeds / speeds.max())
    levels = [line.get_ydata()[0] for line in ax.child_axes[0].get_lines()[2:]]
    np.testing.assert_allclose(levels, [9.81 / 4, -9.81 / 4])
    # A motion that overturns is drawn until it does, not for all four seconds.
    falls = respond(5.5, 0.9)
    ax = plot.plot_response(falls)
    assert "overturning" in ax.get_legend_handles_labels()[1]
    when = float(falls.overturning_time)
    assert abs(np.interp(when, *ax.get_lines()[0].get_data())) == pytest.approx(1, abs=0.01)
    assert when < ax.get_xlim()[1] < 1.5 * when


def test_derivatives_with_respect_to_a_record_are_drawn_over_its_time():
    record = jr.Record(4 * np.sin(np.arange(100.0)), 0.05, start=0.5)
    response = jr.respond(WALL.block, 0.7, record)
    slopes = np.linspace(-1, 2, 100)
    ax = plot.plot_response(response, sensitivity=slopes)
    strip = np.asarray(ax.child_axes[1].collections[0].get_paths()[0].vertices)
    assert strip[:, 1].max() == 2
    assert strip[strip[:, 1].argmax(), 0] == pytest.approx(0.5 + 99 * 0.05)
    with pytest.raises(ValueError, match=r"each sample of the record, got .* \(99,\)"):
        plot.plot_response(response, sensitivity=slopes[1:])


@pytest.mark.float64
@pytest.mark.parametrize("model", first_by_default([jr.Linearized(), jr.Nonlinear()]))
def test_resonance(model):
    ax = plot.plot_resonance(WALL, 6, model)
    time, ratio = ax.get_lines()[0].get_data()
    launches = jr.half_cycle_velocity(WALL, jnp.arange(1.0, 7.0))
    peaks = model.peak_rotation(WALL.block, launches) / WALL.block.critical_angle
    durations = np.asarray(model.half_cycle_duration(WALL.block, launches))
    starts = np.cumsum(durations) - durations
    for k in range(6):
        part = ratio[(time >= starts[k]) & (time <= starts[k] + durations[k])]
        peak = (-1) ** k * float(peaks[k])
        assert part[np.argmax(abs(part))] == pytest.approx(peak, rel=2e-3)
    # Pulses of either sign in turn, right after the impacts.
    (arrows,) = ax.child_axes[0].collections
    np.testing.assert_allclose(arrows.get_offsets()[:, 0], starts, rtol=1e-6)
    np.testing.assert_allclose(arrows.V, 0.15 * np.array([1, -1] * 3), rtol=1e-6)
    level = ax.get_lines()[2].get_ydata()[0]
    assert level == pytest.approx(float(jr.rotation_ratio(WALL, model)))
    # Of a block that overturns, up to the critical angle and a little beyond.
    scene = jr.Scene(WALL.block, 0.7, 0.4)
    ax = plot.plot_resonance(scene)
    assert 1.19 < np.nanmax(ax.get_lines()[0].get_ydata()) < 1.2
    assert len(ax.child_axes[0].collections[0].V) == int(jr.overturning_half_cycle(scene)) == 5


@pytest.mark.thorough
@pytest.mark.float64
def test_overturning_map(boundaries):
    ax = plot.plot_overturning_map(boundaries)
    edges = boundaries.amplitude_ratio.values
    # At the first ratio: shaded from the first edge to the second, and from the third on.
    first = edges[0][np.isfinite(edges[0])]
    assert first.size == 3
    areas = [
        [(bar.get_y(), bar.get_y() + bar.get_height()) for bar in bars if bar.get_x() < 2]
        for bars in ax.containers
    ]
    assert areas == [[(first[0], first[1]), (first[2], 12)], [(first[1], first[2])]]
    assert (ax.get_xlim(), ax.get_ylim(), ax.get_yscale()) == ((1.5, 3.5), (1, 12), "log")


@pytest.mark.float64
def test_boundaries():
    ax = plot.plot_boundaries(windows(), (2.0, 20.0), uplift=0.2)
    stands, overturns = (
        [np.sort(path.vertices[:, 0][[0, 2]]) for path in area.get_paths()]
        for area in ax.collections
    )
    np.testing.assert_allclose(stands, [[2, 4], [8, 8.4]])
    np.testing.assert_allclose(overturns, [[4, 8], [8.4, 20]])
    assert ax.get_xlim()[0] < 0.2 < 20 < ax.get_xlim()[1]
    assert ax.get_xlabel() == "width at this height, $2b$ [m]"


@pytest.mark.float64
def test_critical_intensities():
    ax = plot.plot_critical_intensity(WALL.block, 0.7, 0.15)
    nonlinear, linearized, limit, _ = ax.lines
    # One pulse does it if it is as strong as all: 1 + C + C^2 ... together.
    together = linearized.get_ydata() * np.cumsum(0.7 ** np.arange(20))
    np.testing.assert_allclose(together, linearized.get_ydata()[0])
    np.testing.assert_allclose(limit.get_ydata(), 0.3 * nonlinear.get_ydata()[0], rtol=4e-3)


@pytest.mark.parametrize("middle", [0.3, np.nan])
def test_tornado(middle):
    bars = bars_of(middle, (0.1, np.nan), (0.2, 0.35))
    ax = plot.plot_tornado(bars, label="rotation ratio [-]")
    start = 0.35 if np.isnan(middle) else middle
    ends = [bar.get_x() + bar.get_width() for bar in ax.patches]
    answers = np.append(bars.at_low, bars.at_high)
    np.testing.assert_allclose(ends, np.nan_to_num(answers, nan=start))
    text = ax.get_yticklabels()[bars.names.index("slenderness")].get_text()
    assert text == "slenderness $\\lambda$ [-]\n0.1235 to 1.235e+04 (overturns)"


STEEP = 1 / np.linspace(1, 0.001, 600) ** 1.5  # as derivatives are at a threshold
SKEWED = {
    "one sign": STEEP,
    "below zero": -STEEP,
    "both signs": np.append(1 - STEEP[::-2], STEEP[::2] - 1),
    "nearly alike": np.linspace(2.0, 2.5, 600),
}


@pytest.mark.parametrize("case", SKEWED)
def test_a_map_uses_its_colours(case):
    values = SKEWED[case]
    ax = plot.plot_sensitivity_map(map_of(values))
    mesh = ax.collections[0]
    # In ten classes of colours none has more than a third of the map.
    taken = np.asarray(mesh.norm(values)).clip(0, 1)
    assert np.histogram(taken, 10, (0, 1))[0].max() < 200
    # Signs are told by colour, white being zero where there are two.
    zero, end = (min(mesh.cmap(x)[:3]) for x in (0.5, 1.0))
    assert (zero > 0.9) == (case == "both signs")
    assert (end > 0.9) == (case == "below zero")


def test_maps_share_a_limit_and_may_be_empty():
    steep = map_of(STEEP)
    assert plot.plot_sensitivity_map(steep, limit=2.0).collections[0].get_clim() == (-2, 2)
    assert len(plot.plot_sensitivity_map(steep * np.nan).collections) == 1


def test_reliability_and_outcomes():
    ax = plot.plot_reliability(scores())
    # A bin without tests has no mark.
    np.testing.assert_array_equal(ax.lines[1].get_xydata(), [[0.1, 0.0], [0.85, 0.5]])
    ends = [[[0.1, 0], [0.1, 0.95]], [[0.85, 0.03], [0.85, 0.97]]]
    np.testing.assert_allclose(ax.collections[0].get_segments(), ends)
    assert [text.get_text() for text in ax.texts] == ["1", "2"]
    # Mean and standard deviation over the splits that have a score.
    assert ax.get_title() == r"Brier score 0.050 $\pm$ 0.014"
    base_rate, stood, overturned = plot.plot_outcomes(scores()).lines
    # Of the tests that some split has predicted.
    np.testing.assert_allclose(base_rate.get_ydata(), [1 / 3, 1 / 3])
    np.testing.assert_array_equal(stood.get_xydata(), [[0.1, 0.1], [0.5, 0.75]])
    np.testing.assert_array_equal(overturned.get_xydata(), [[2.0, 0.95]])
    assert plot.plot_outcomes(scores(), measure="pga").get_xlabel() == "PGA [m/s²]"


def test_probabilities_stand_at_their_levels_and_intervals_are_bands(curves):
    ax = plot.plot_fragility(curves)
    marks = [line for line in ax.get_lines() if line.get_linestyle() == "None"]
    curve = curves.isel(threshold=-1)
    np.testing.assert_allclose(marks[-1].get_xdata(), curves.level)
    np.testing.assert_array_equal(marks[-1].get_ydata(), curve.exceedance)
    corners = ax.collections[0].get_paths()[0].vertices
    third = corners[np.isclose(corners[:, 0], curves.level[2]), 1]
    ends = float(curve.exceedance_low[2]), float(curve.exceedance_high[2])
    np.testing.assert_allclose([third.min(), third.max()], ends)
