"""What the figures show: their lines against the answers, units, legends, texts apart."""

import inspect
import re

import jax
import jaxtyping
import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray
from tools.pictures import find_clashes

import jaxrock as jr
from jaxrock import plot

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


def make_map(values):
    """A map of these values, 20 by 30."""
    axes = {"half_width": np.linspace(0.2, 0.6, 20), "slenderness": np.linspace(3, 10, 30)}
    attributes = {"long_name": "elasticity", "units": "1"}
    return xarray.DataArray(np.reshape(values, (20, 30)), axes, list(axes), attrs=attributes)


@SLOW
@DOUBLE
def test_all_draw_on_the_axes_given_with_units_and_texts_apart(spectrum, boundaries, curves):
    uncertain = jr.Uncertain({"width": 0.1})
    suite = jr.Suite([jr.Record([0.0, a, -a, 0.0], 0.2) for a in (3.0, 0.3)])
    chances = jr.sensitivity.outcome_probabilities(WALL.block, 0.8, suite, uncertain)
    floor = jr.spectra.harmonic_spectrum(np.linspace(1, 5, 12), np.geomspace(0.02, 9, 14))
    slopes = make_map(np.where(np.arange(600) < 580, 1.0 - np.arange(600) / 200, np.nan))
    calls = {
        plot.plot_curves: (spectrum.stabilized_period.sel(restitution=0.6), "width"),
        plot.plot_boundaries: (make_windows(), (2.0, 20.0)),
        plot.plot_critical_intensity: (WALL.block, 0.7, 0.15),
        plot.plot_fragility: (curves,),
        plot.plot_harmonic: (floor,),
        plot.plot_outcome_probabilities: (chances,),
        plot.plot_outcomes: (make_scores(),),
        plot.plot_overturning_map: (boundaries,),
        plot.plot_reliability: (make_scores(),),
        plot.plot_resonance: (WALL,),
        plot.plot_response: (respond(3.5, 0.7),),
        plot.plot_sensitivity_map: (slopes,),
        plot.plot_sobol_indices: (chances, "peak"),
        plot.plot_tornado: (
            jr.tornado(
                jr.rotation_ratio, WALL, {"restitution": (0.6, 0.97), "width": (0.6, 1)}
            ),
        ),
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
