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

import jaxrock as jr
from jaxrock import plot
from jaxrock.sensitivity.measures import arrange_bars

DOUBLE = pytest.mark.float64
SLOW = pytest.mark.thorough
WALL = jr.Scene(jr.Block(0.4, 5.0), restitution=0.7, intensity=0.15)


def draw(function, *arguments, **options):
    """Draw on new axes; whose labels have units, unless they are names of numbers."""
    ax = function(*arguments, **options)
    for each in (ax, *ax.figure.axes, *ax.child_axes):
        for axis in (each.xaxis, each.yaxis):
            label = axis.get_label().get_text()
            # Without a label: names of numbers, or the neighbour's.
            assert re.search(r"\s\[[^ ]+\]$", label) or label in ("", "answer"), label
    return ax


@pytest.fixture(scope="module")
def spectrum():
    return jr.resonance_spectrum(np.linspace(3, 10, 29), [0.4, 1.2], [0.6, 0.8], 0.15)


def respond(amplitude, duration):
    """Under a sine, as a record of 100 samples."""
    samples = amplitude * np.sin(2 * np.pi * np.arange(100) * 0.05 / duration)
    samples[np.arange(100) * 0.05 > duration] = 0.0
    return jr.respond(jr.Block(0.3, 4.0), 0.8, jr.Record(samples, 0.05, start=0.5), 5.5)


@pytest.fixture(scope="module")
def boundaries():
    return jr.overturning_map(jr.Sine, [2.0, 3.0], (1.0, 12.0), restitution=0.9)


@pytest.fixture(scope="module")
def curves():
    pulse = np.sin(np.linspace(0, 2 * np.pi, 200))
    suite = jr.Suite([jr.Record(a * pulse, a / 400) for a in (1.0, 2.0, 3.0)])
    return jr.risk.fragility(jr.Block(0.1, 5.0), 0.8, suite, np.geomspace(0.2, 3, 7))


def make_scores():
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


def make_windows():
    """Boundaries as a search would give them."""
    values = np.array([4.0, 8.0, 8.4])
    fields = (values, np.array([True, False, True]), np.zeros(3, int), np.zeros(3, bool))
    single = (np.asarray(3), np.asarray(False), np.asarray(True))
    return jr.overturning.Boundaries(*jax.device_put((*fields, *single)), "width")


def make_bars(*answers):
    """Bars from the answer with all parameters unchanged, and both answers of each parameter."""
    middle, *pairs = answers
    names = ("slenderness", "half_width", "a parameter that somebody named at great length")
    ranges = dict.fromkeys(names[: len(pairs)], (0.12345, 12345.6))
    return arrange_bars(np.array([middle, *np.ravel(pairs)]), ranges)


def make_map(values):
    """A map of these values, 20 by 30."""
    axes = {"half_width": np.linspace(0.2, 0.6, 20), "slenderness": np.linspace(3, 10, 30)}
    attributes = {"long_name": "elasticity", "units": "1"}
    return xarray.DataArray(np.reshape(values, (20, 30)), axes, list(axes), attrs=attributes)


@SLOW
@DOUBLE
def test_all_draw_on_the_axes_given_with_units_and_texts_apart(spectrum, boundaries, curves):
    floor = jr.spectra.harmonic_spectrum(np.linspace(1, 5, 12), np.geomspace(0.02, 9, 14))
    slopes = make_map(np.where(np.arange(600) < 580, 1.0 - np.arange(600) / 200, np.nan))
    calls = {
        plot.plot_curves: (spectrum.stabilized_period.sel(restitution=0.6), "width"),
        plot.plot_boundaries: (make_windows(), (2.0, 20.0)),
        plot.plot_critical_intensity: (WALL.block, 0.7, 0.15),
        plot.plot_fragility: (curves,),
        plot.plot_harmonic: (floor,),
        plot.plot_outcomes: (make_scores(),),
        plot.plot_overturning_map: (boundaries,),
        plot.plot_reliability: (make_scores(),),
        plot.plot_resonance: (WALL,),
        plot.plot_response: (respond(3.5, 0.7),),
        plot.plot_sensitivity_map: (slopes,),
        plot.plot_tornado: (make_bars(0.3, (0.1, np.nan), (0.2, 0.5), (0.31, 0.3)),),
    }
    for function, arguments in calls.items():
        _, given = plt.subplots()
        assert function(*arguments, ax=given) is given
        new = draw(function, *arguments)
        assert new.get_xlabel()
        assert find_clashes(new.figure) == [], function.__name__
        plt.close("all")
    figure, (left, right) = plt.subplots(1, 2, figsize=(12, 5), layout="constrained")
    panels = plot.plot_spectrum(spectrum, ax=right).axes
    assert figure.axes == [left, *panels]
    assert find_clashes(figure) == []


def test_every_picture_says_what_it_is_drawn_of(monkeypatch):
    # Without the types that the tests check, which would answer before the package does.
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    for name in plot.__all__:
        function = getattr(plot, name)
        parameters = inspect.signature(function).parameters.values()
        needed = [each.name for each in parameters if each.default is each.empty]
        with pytest.raises(ValueError, match=r"got 'a block'.*; .+ gives one"):
            function("a block", *needed[1:])


def test_curves_end_where_the_block_overturns(spectrum):
    data = spectrum.rotation_ratio.sel(restitution=0.8)
    ax = draw(plot.plot_curves, data, hue="width")
    small, end, large, _ = ax.get_lines()  # a cross where a curve ends
    np.testing.assert_array_equal(small.get_ydata(), data.sel(width=0.4))
    np.testing.assert_array_equal(large.get_ydata(), data.sel(width=1.2))
    assert end.get_xdata().tolist() == [4.75]  # overturns from a slenderness of 4.8
    assert ax.get_legend_handles_labels()[1] == ["0.4", "1.2", "overturns beyond"]
    with pytest.raises(ValueError, match="variable must have the dimensions"):
        plot.plot_curves(spectrum.stabilized_period, hue="width")


def test_rotation_ratios_are_drawn_up_to_the_threshold(spectrum):
    curve, cross, *_ = plot.plot_spectrum(spectrum).axes[1].get_lines()
    threshold = float(jr.critical_slenderness(jr.Block(0.2, 1.0), 0.8, 0.15))
    for line in (curve, cross):
        np.testing.assert_allclose(np.asarray(line.get_data())[:, -1], [threshold, 1])
    # Between the last point of the grid and the threshold, too, the curve is right.
    x, y = np.asarray(curve.get_data())[:, -15]
    between = jr.rotation_ratio(jr.Scene(jr.Block(0.2, x), 0.8, 0.15))
    assert y == pytest.approx(float(between), abs=0.005)


@DOUBLE
def test_rotation_over_time():
    response = respond(3.5, 0.7)
    slopes = np.linspace(-1, 2, 100)
    ax = draw(plot.plot_response, response, sensitivity=slopes)
    peak = float(response.peak_rotation / response.scene.block.critical_angle)
    assert np.abs(ax.get_lines()[0].get_ydata()).max() == pytest.approx(peak, rel=1e-4)
    feet, tips = np.transpose([line[:, 1] for line in ax.collections[0].get_segments()])
    assert tips.size == response.impacts > 3
    speeds = np.abs(np.asarray(response.impact_velocities))
    np.testing.assert_allclose((tips - feet) / (tips - feet).max(), speeds / speeds.max())
    levels = [line.get_ydata()[0] for line in ax.child_axes[0].get_lines()[2:]]
    np.testing.assert_allclose(levels, [9.81 / 4, -9.81 / 4])
    # Derivatives with respect to the samples stand over the time of the record.
    strip = np.asarray(ax.child_axes[1].collections[0].get_paths()[0].vertices)
    np.testing.assert_allclose(strip[strip[:, 1].argmax()], [0.5 + 99 * 0.05, 2])
    with pytest.raises(ValueError, match=r"each sample of the record, got .* \(99,\)"):
        plot.plot_response(response, sensitivity=slopes[1:])
    # A motion that overturns is drawn until it does, not for all of the time.
    falls = respond(9.0, 1.2)
    ax = plot.plot_response(falls)
    when = float(falls.overturning_time)
    assert abs(np.interp(when, *ax.get_lines()[0].get_data())) == pytest.approx(1, abs=0.01)
    assert when < ax.get_xlim()[1] < 5


@DOUBLE
@SLOW
def test_resonance():
    model = jr.Nonlinear()
    ax = draw(plot.plot_resonance, WALL, 6, model)
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


@SLOW
@DOUBLE
def test_overturning_map(boundaries):
    ax = draw(plot.plot_overturning_map, boundaries)
    edges = boundaries.amplitude_ratio.values
    # At the first ratio: shaded from the first edge to the second, and from the third on.
    first = edges[0][np.isfinite(edges[0])]
    areas = [
        [(bar.get_y(), bar.get_y() + bar.get_height()) for bar in bars if bar.get_x() < 2]
        for bars in ax.containers
    ]
    assert areas == [[(first[0], first[1]), (first[2], 12)], [(first[1], first[2])]]


@DOUBLE
def test_boundaries_and_critical_intensities():
    ax = draw(plot.plot_boundaries, make_windows(), (2.0, 20.0), uplift=0.2)
    stands, overturns = (
        [np.sort(path.vertices[:, 0][[0, 2]]) for path in area.get_paths()]
        for area in ax.collections
    )
    np.testing.assert_allclose(stands, [[2, 4], [8, 8.4]])
    np.testing.assert_allclose(overturns, [[4, 8], [8.4, 20]])
    assert ax.get_xlim()[0] < 0.2 < 20 < ax.get_xlim()[1]
    ax = draw(plot.plot_critical_intensity, WALL.block, 0.7, 0.15)
    nonlinear, linearized, limit, _ = ax.lines
    # One pulse does it if it is as strong as all: 1 + C + C^2 ... together.
    together = linearized.get_ydata() * np.cumsum(0.7 ** np.arange(20))
    np.testing.assert_allclose(together, linearized.get_ydata()[0])
    np.testing.assert_allclose(limit.get_ydata(), 0.3 * nonlinear.get_ydata()[0], rtol=4e-3)


@pytest.mark.parametrize("middle", [0.3, np.nan])
def test_tornado(middle):
    bars = make_bars(middle, (0.1, np.nan), (0.2, 0.35))
    ax = draw(plot.plot_tornado, bars, label="rotation ratio [-]")
    ends = [bar.get_x() + bar.get_width() for bar in ax.patches]
    answers = np.append(bars.at_low, bars.at_high)
    start = 0.35 if np.isnan(middle) else middle
    np.testing.assert_allclose(ends, np.nan_to_num(answers, nan=start))
    text = ax.get_yticklabels()[bars.names.index("slenderness")].get_text()
    assert "0.1235 to 1.235e+04 (overturns)" in text


STEEP = 1 / np.linspace(1, 0.001, 600) ** 1.5  # as derivatives are at a threshold


@pytest.mark.parametrize("case", ["below zero", "both signs"])
def test_a_map_uses_its_colours(case):
    both = np.append(1 - STEEP[::-2], STEEP[::2] - 1)
    values = both if case == "both signs" else -STEEP
    mesh = draw(plot.plot_sensitivity_map, make_map(values)).collections[0]
    # In ten classes of colours none has more than a third of the map.
    taken = np.asarray(mesh.norm(values)).clip(0, 1)
    assert np.histogram(taken, 10, (0, 1))[0].max() < 200
    # Signs are told by colour, white being zero where there are two.
    zero, end = (min(mesh.cmap(x)[:3]) for x in (0.5, 1.0))
    assert (zero > 0.9) == (case == "both signs")
    assert (end > 0.9) == (case == "below zero")


def test_reliability_and_outcomes():
    ax = draw(plot.plot_reliability, make_scores())
    # A bin without tests has no mark.
    np.testing.assert_array_equal(ax.lines[1].get_xydata(), [[0.1, 0.0], [0.85, 0.5]])
    ends = [[[0.1, 0], [0.1, 0.95]], [[0.85, 0.03], [0.85, 0.97]]]
    np.testing.assert_allclose(ax.collections[0].get_segments(), ends)
    # Mean and standard deviation over the splits that have a score.
    assert ax.get_title() == r"Brier score 0.050 $\pm$ 0.014"
    base_rate, stood, overturned = draw(plot.plot_outcomes, make_scores()).lines
    # Of the tests that some split has predicted.
    np.testing.assert_allclose(base_rate.get_ydata(), [1 / 3, 1 / 3])
    np.testing.assert_array_equal(stood.get_xydata(), [[0.1, 0.1], [0.5, 0.75]])
    np.testing.assert_array_equal(overturned.get_xydata(), [[2.0, 0.95]])


def test_probabilities_stand_at_their_levels_and_intervals_are_bands(curves):
    ax = draw(plot.plot_fragility, curves)
    marks = [line for line in ax.get_lines() if line.get_linestyle() == "None"]
    curve = curves.isel(threshold=-1)
    np.testing.assert_allclose(marks[-1].get_xdata(), curve.level)
    np.testing.assert_array_equal(marks[-1].get_ydata(), curve.exceedance)
    corners = ax.collections[0].get_paths()[0].vertices
    third = corners[np.isclose(corners[:, 0], curves.level[2]), 1]
    ends = float(curve.exceedance_low[2]), float(curve.exceedance_high[2])
    np.testing.assert_allclose([third.min(), third.max()], ends)
