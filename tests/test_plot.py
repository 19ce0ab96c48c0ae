"""What the figures show: their lines against the answers, limits, labels and legends."""

import inspect
import re

import jax
import jax.numpy as jnp
import jaxtyping
import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from PIL import Image
from references.half_sine_rates import pulses as half_sines
from tools.pictures import find_clashes
from tools.selection import first_by_default

import jaxrock as jr
from jaxrock import plot
from jaxrock.accuracy import tradeoff
from jaxrock.plot import (
    animate,
    plot_block,
    plot_boundaries,
    plot_critical_intensity,
    plot_curves,
    plot_fragility,
    plot_free_rocking_fit,
    plot_harmonic,
    plot_inventory,
    plot_outcome_probabilities,
    plot_outcomes,
    plot_overturning_map,
    plot_phase,
    plot_reliability,
    plot_resonance,
    plot_response,
    plot_rocking_spectrum,
    plot_sensitivity_map,
    plot_sobol_indices,
    plot_spectrum,
    plot_tornado,
    plot_tradeoff,
)

WALL = jr.Scene(jr.Block(0.4, 5.0), restitution=0.7, intensity=0.15)


@pytest.fixture(scope="module")
def spectrum():
    return jr.resonance_spectrum(np.linspace(3, 10, 29), [0.4, 1.2], [0.6, 0.8], 0.15)


@pytest.fixture(scope="module")
def response():
    return jr.respond(jr.Block(0.3, 4.0), 0.8, jr.Sine(3.5, 0.7), 4.0)


@pytest.fixture(scope="module")
def boundaries():
    return jr.overturning_map(jr.Sine, [2.0, 3.0], (1.0, 12.0), restitution=0.9)


@pytest.fixture(scope="module")
def rocking():
    """As of `rocking_spectrum`, the smaller blocks overturning."""
    dimensions = ("free_period", "slenderness", "restitution")
    ratio = np.linspace(0.9, 0.1, 20).reshape(5, 2, 2)
    attributes = {"free_period": "s", "slenderness": "1", "restitution": "1"}
    coordinates = {
        "free_period": np.linspace(2, 6, 5),
        "slenderness": [4, 6.0],
        "restitution": [0.8, 0.9],
    }
    return xarray.Dataset(
        {"rotation_ratio": (dimensions, ratio), "overturned": (dimensions, 1 * (ratio > 0.5))},
        {k: (k, v, {"units": attributes[k]}) for k, v in coordinates.items()},
    )


@pytest.fixture(scope="module")
def bars():
    ranges = {"slenderness": (4.0, 6.0), "intensity": (0.1, 0.4)}
    return jr.tornado(jr.rotation_ratio, WALL, ranges)


SLOPES = xarray.DataArray(
    np.array([[1.0, -2.0, 3.0], [np.nan, 0.0, -4.0]]),
    {"half_width": [0.5, 0.6], "slenderness": [3.0, 4.0, 5.0]},
    ("half_width", "slenderness"),
    attrs={"long_name": "elasticity", "units": "1"},
)


def legend_of(ax):
    return [text.get_text() for text in ax.get_legend().get_texts()]


def looks_of(ax):
    """What tells the entries of the legend apart but colour."""
    looks = []
    for handle in ax.get_legend().legend_handles:
        if hasattr(handle, "get_linestyle") and hasattr(handle, "get_marker"):
            dashes = handle._unscaled_dash_pattern[1]
            dashes = tuple(dashes) if dashes else handle.get_linestyle()
            looks.append((dashes, handle.get_marker(), handle.get_fillstyle()))
        else:
            grey = np.dot(np.ravel(handle.get_facecolor())[:3], (0.299, 0.587, 0.114))
            looks.append((round(float(grey), 1), handle.get_hatch()))
    return looks


@pytest.fixture(scope="module")
def curves():
    pulse = np.sin(np.linspace(0, 2 * np.pi, 200))
    suite = jr.Suite([jr.Record(a * pulse, a / 400) for a in (1.0, 2.0, 3.0)])
    return jr.fragility(jr.Block(0.1, 5.0), 0.8, suite, np.geomspace(0.2, 3, 7))


@pytest.fixture(scope="module")
def probabilities():
    record = jr.Record([0.0, 3.0, -3.0, 0.0], 0.2)
    suite = jr.Suite([record, record.scaled(0.1)])
    return jr.sensitivity.outcome_probabilities(
        jr.Block(0.1, 4.0), 0.8, suite, jr.Uncertain({"half_width": 0.1})
    )


@pytest.fixture(scope="module")
def calls(spectrum, response, boundaries, bars, curves, probabilities):
    """A call of every function that takes axes, and the number of entries in its legend."""
    nine = jr.resonance_spectrum([3.0, 4.0], np.linspace(0.4, 1.2, 9), 0.6, 0.15)
    floor = jr.harmonic_spectrum(
        np.linspace(1, 5, 12), np.geomspace(0.02, 9, 14), restitution=0.9
    )
    table = tradeoff_table()
    return {
        plot_block: (lambda ax: plot_block(jr.Block(0.4, 5.0), ax=ax), 0),
        plot_curves: (
            lambda ax: plot_curves(nine.stabilized_period.squeeze(drop=True), "width", ax=ax),
            9,
        ),
        plot_boundaries: (
            lambda ax: plot_boundaries(windows(), (2.0, 20.0), ax, uplift=2.5),
            3,
        ),
        plot_critical_intensity: (
            lambda ax: plot_critical_intensity(WALL.block, 0.7, 0.15, ax),
            4,
        ),
        plot_inventory: (lambda ax: plot_inventory(museum(), ax), 0),  # outside of the axes
        plot_fragility: (lambda ax: plot_fragility(curves, ax), 3),
        plot_harmonic: (lambda ax: plot_harmonic(floor, ax), 6),
        plot_outcome_probabilities: (
            lambda ax: plot_outcome_probabilities(probabilities, ax),
            3,
        ),
        plot_outcomes: (lambda ax: plot_outcomes(scores(), ax), 3),
        plot_overturning_map: (lambda ax: plot_overturning_map(boundaries, ax), 4),
        plot_phase: (lambda ax: plot_phase(response, ax), 2),
        plot_reliability: (lambda ax: plot_reliability(scores(), ax), 2),
        plot_resonance: (lambda ax: plot_resonance(WALL, ax=ax), 1),
        plot_response: (lambda ax: plot_response(response, ax), 2),
        plot_sensitivity_map: (lambda ax: plot_sensitivity_map(SLOPES, ax), 1),
        plot_sobol_indices: (lambda ax: plot_sobol_indices(probabilities, "peak", ax), 2),
        plot_tornado: (lambda ax: plot_tornado(bars, ax, "rotation ratio [-]"), 2),
        plot_tradeoff: (lambda ax: plot_tradeoff(table, ax), 3),
    }


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


def museum():
    """Two objects, of which one overturns less often than the target."""
    objects = jr.risk.Inventory(["bust", "vase"], jr.Block(np.array([0.3, 0.2]), 4.0), 0.85)
    hazard = jr.Hazard([0.5, 12.0], [1e-3, 6e-7])
    site = jr.Site(half_sines(50), hazard, spacing=0.1)
    return jr.risk.assess_inventory(objects, site, 5e-5, model="linearized")


def windows(values=(4.0, 8.0, 8.4), first=False, along="factor"):
    """Boundaries as a search would give them."""
    beyond = np.arange(len(values)) % 2 == int(first)
    number = len(values)
    fields = (np.array(values, float), beyond, np.zeros(number, int), np.zeros(number, bool))
    single = (np.asarray(number), np.asarray(first), np.asarray(True))
    return jr.overturning.Boundaries(*jax.device_put((*fields, *single)), along)


def tradeoff_table():
    """Batches of nine sizes."""
    rows = [
        {
            **{"label": "", "level": "batch", "bits": 64, "batch": 10**k, "solver": "-"},
            **{"tolerance": np.nan, "default": k == 2},
            **{"error": 10.0 ** (-k), "seconds": 10.0 ** (k - 9)},
            **{"spread": 0.1, "compilation": 1.0},
        }
        for k in range(9)
    ]
    return tradeoff._tabulate(rows, tradeoff.make_default_scene(), 1e-14)


@pytest.mark.thorough
@pytest.mark.float64
def test_all_draw_on_the_axes_given_with_units_and_legible_in_grey(calls):
    whole = {animate, plot_free_rocking_fit, plot_spectrum, plot_rocking_spectrum}
    assert {getattr(plot, name) for name in plot.__all__} == whole | set(calls)
    for function, (call, entries) in calls.items():
        name = function.__name__
        _, given = plt.subplots()
        assert call(given) is given, name
        new = call(None)
        assert new is not given, name
        for ax in (new, *new.figure.axes, *new.child_axes):
            for axis in (ax.xaxis, ax.yaxis):
                label = axis.get_label().get_text()
                # Without a label: names of numbers, or the neighbour's.
                assert re.search(r" \[[^ ]+\]$", label) or not label, (name, label)
        assert new.get_xlabel(), name
        assert bool(new.get_ylabel()) == (
            function
            not in (
                *(plot_tornado, plot_boundaries),
                *(plot_outcome_probabilities, plot_sobol_indices, plot_inventory),
            )
        ), name
        looks = looks_of(new) if new.get_legend() else []
        assert len(looks) == entries, name
        assert len(set(looks)) == len(looks), (name, looks)
        assert find_clashes(new.figure) == [], name
        plt.close("all")


def test_docstrings_say_what_all_have_in_common():
    for name in plot.__all__:
        function = getattr(plot, name)
        doc = inspect.getdoc(function)
        parameters = inspect.signature(function).parameters
        described = re.findall(r"^(\w.*) : ", doc, re.MULTILINE)
        assert set(parameters) == set(", ".join(described).split(", ")), name
        returns = "matplotlib.axes.Axes" if "ax" in parameters else "matplotlib.figure.Figure"
        assert name == "animate" or f"Returns\n-------\n{returns}" in doc, name
        assert doc.count("Parameters\n---") == 1, name


def test_curves_end_where_the_block_overturns(spectrum):
    data = spectrum.rotation_ratio.sel(restitution=0.8)
    ax = plot_curves(data, hue="width")
    small, large, end, _ = ax.get_lines()  # a cross where a curve ends
    np.testing.assert_array_equal(small.get_ydata(), data.sel(width=0.4))
    np.testing.assert_array_equal(large.get_ydata(), data.sel(width=1.2))
    assert end.get_xdata().tolist() == [4.75]  # overturns from a slenderness of 4.8
    assert end.get_marker() == "x"
    assert ax.get_xlim() == (3, 10)
    assert ax.get_ylim()[0] == 0
    assert ax.get_xlabel() == r"slenderness $\lambda$ [-]"
    assert ax.get_ylabel() == r"rotation ratio $\alpha^*_{max}/\alpha_c$ [-]"
    assert ax.get_legend().get_title().get_text() == "width $2b$ [m]"
    assert legend_of(ax) == ["0.4", "1.2", "overturns beyond"]


def test_rotation_ratios_are_drawn_up_to_the_threshold(spectrum):
    left, right = plot_spectrum(spectrum).axes
    curve, _, cross, _ = right.get_lines()
    threshold = float(jr.critical_slenderness(jr.Block(0.2, 1.0), 0.8, 0.15))
    for line in (curve, cross):
        x, y = np.asarray(line.get_data())[:, -1]
        assert (x, y) == (pytest.approx(threshold), 1)
    # Between the last point of the grid and the threshold, too, the curve is right.
    x, y = np.asarray(curve.get_data())[:, -15]
    between = jr.rotation_ratio(jr.Scene(jr.Block(0.2, x), 0.8, 0.15))
    assert y == pytest.approx(float(between), abs=0.005)
    assert legend_of(right)[-1] == "overturning threshold"
    assert f"{threshold:.3g}" in [text.get_text() for text in right.texts]
    assert left.get_legend() is None


def test_curves_begin_where_the_block_stands(spectrum):
    data = spectrum.rotation_ratio.sel(restitution=0.8, slenderness=[10.0, 5.0])
    curve, _, start, *_ = plot_curves(data, hue="slenderness", along="width").get_lines()
    assert curve.get_xdata().tolist() == [0.4, 1.2]
    assert start.get_xdata().tolist() == [1.2]


def test_any_order_one_point_and_negative_values(spectrum):
    shuffled = spectrum.isel(slenderness=[28, 0, 14]).stabilized_period.sel(restitution=0.6)
    line = plot_curves(shuffled, hue="width").get_lines()[0]
    assert line.get_xdata().tolist() == [3.0, 6.5, 10.0]
    ax = plot_curves(shuffled.isel(slenderness=[0]), hue="width")
    assert [line.get_marker() for line in ax.get_lines()] == ["o", "s"]
    assert ax.get_ylabel() == "stabilized period $T^*$ [s]"
    figure = plot_spectrum(spectrum, "overturning_margin")
    assert figure.axes[1].get_ylim()[0] < float(spectrum.overturning_margin.min()) < 0
    assert figure.axes[0].get_ylabel() == "overturning margin [-]"


def test_curves_refuse_other_dimensions(spectrum):
    with pytest.raises(ValueError, match="variable must have the dimensions"):
        plot_curves(spectrum.stabilized_period, hue="width")


def test_a_panel_each_restitution(spectrum):
    figure = plot_spectrum(spectrum)
    assert [ax.get_title() for ax in figure.axes] == [
        "$C$ = 0.6, $I$ = 0.15 m/s",
        "$C$ = 0.8, $I$ = 0.15 m/s",
    ]
    assert [ax.get_legend() is None for ax in figure.axes] == [True, False]
    assert all(1 < ax.get_ylim()[1] < 1.2 for ax in figure.axes)


def test_of_many_values_some_are_drawn():
    many = jr.resonance_spectrum(
        [3.0, 4.0], np.linspace(0.4, 1.2, 20), np.linspace(0.1, 0.6, 9), [0.1, 0.15]
    )
    figure = plot_spectrum(many, "stabilized_period")
    assert len(figure.axes) == 8
    assert all(len(ax.get_lines()) == 7 for ax in figure.axes)
    assert figure.axes[0].get_title() == "$C$ = 0.1, $I$ = 0.1 m/s"
    assert figure.axes[-1].get_title() == "$C$ = 0.6, $I$ = 0.15 m/s"
    without_pulses = plot_spectrum(many, "critical_intensity")
    assert without_pulses.axes[0].get_title() == "$C$ = 0.1"


def test_rocking_spectrum(rocking):
    figure = plot_rocking_spectrum(rocking)
    ax = figure.axes[1]
    chosen = rocking.sel(restitution=0.9, slenderness=6.0)
    assert 0 < int(chosen.overturned.sum()) < 5
    expected = np.where(chosen.overturned == 0, chosen.rotation_ratio, np.nan)
    drawn = next(line for line in ax.get_lines() if line.get_label() == "6")
    np.testing.assert_array_equal(drawn.get_ydata(), expected)
    # A bar halfway to the blocks that stand, at the same height for a slenderness.
    bars = [bar.get_segments() for bar in ax.collections]
    falls = rocking.sel(restitution=0.9).overturned.sum("free_period").values
    assert [[tuple(bar[:, 0]) for bar in each] for each in bars] == [
        [(2, 1.5 + n)] for n in falls
    ]
    assert legend_of(ax)[-1] == "overturns"
    none = rocking.assign(overturned=0 * rocking.overturned + 1)
    assert legend_of(plot_rocking_spectrum(none).axes[1])[-1] == "overturns"
    left, right = figure.axes
    assert right.get_xlabel() == r"period $2\pi/p$ of the block [s]"
    assert left.get_ylabel() == r"peak rotation $|\alpha|_{max}/\alpha_c$ [-]"
    assert [panel.get_title() for panel in figure.axes] == ["$C$ = 0.8", "$C$ = 0.9"]
    assert [panel.get_legend() is None for panel in figure.axes] == [True, False]
    # Without a restitution of its own, Housner's.
    one = rocking.isel(restitution=0, drop=True)
    assert [panel.get_title() for panel in plot_rocking_spectrum(one).axes] == [
        "Housner's $C$"
    ]


def test_rotation_over_time(response):
    ax = plot_response(response)
    curve, *levels, _ = ax.get_lines()
    peak = float(response.peak_rotation / response.scene.block.critical_angle)
    assert np.abs(curve.get_ydata()).max() == pytest.approx(peak, rel=1e-4)
    feet, tips = np.transpose([line[:, 1] for line in ax.collections[0].get_segments()])
    assert tips.size == response.impacts > 3
    speeds = np.abs(np.asarray(response.impact_velocities))
    np.testing.assert_allclose((tips - feet) / (tips - feet).max(), speeds / speeds.max())
    assert sorted(line.get_ydata()[0] for line in levels) == [-1, 1]
    assert ax.get_ylim()[1] > peak
    assert (ax.get_xlabel(), ax.get_ylabel()) == (
        "time [s]",
        r"rotation ratio $\alpha/\alpha_c$ [-]",
    )
    # The critical angle lies outside.
    assert legend_of(ax) == ["impacts (height: velocity)", "lifts the block"]
    _, push, *lifting = ax.child_axes[0].get_lines()
    assert abs(push.get_ydata()).max() == pytest.approx(3.5, rel=1e-4)
    np.testing.assert_allclose(
        [line.get_ydata()[0] for line in lifting], [9.81 / 4, -9.81 / 4]
    )


def test_overturning_over_time():
    response = jr.respond(jr.Block(0.3, 4.0), 0.8, jr.Sine(5.5, 0.9), 4.0)
    ax = plot_response(response)
    assert legend_of(ax)[1:] == ["critical angle", "overturning", "lifts the block"]
    when = ax.get_lines()[-2].get_xdata()[0]
    assert when == float(response.overturning_time)
    curve = ax.get_lines()[0]
    assert abs(np.interp(when, *curve.get_data())) == pytest.approx(1, abs=0.01)
    assert when < ax.get_xlim()[1] < 1.5 * when  # not all four seconds
    # The fall, much faster, does not set the limits of the phase portrait.
    assert 1.5 < plot_phase(response).get_ylim()[1] < 2


def test_phase_portrait(response):
    ax = plot_phase(response)
    path, *separatrix = ax.get_lines()
    # Broken at impacts: nowhere a line from the velocity before to the one after.
    velocity = path.get_ydata()
    jumps = np.abs(np.diff(velocity)) > 0.1 * np.nanmax(np.abs(velocity))
    assert not jumps.any()
    assert np.isnan(velocity).sum() > 3
    # The separatrix ends upright in the critical velocity, and is at rest at the critical
    # angle.
    critical = jr.Nonlinear().critical_velocity(response.scene.block)
    block = response.scene.block
    scale = float(block.frequency_parameter * block.critical_angle)
    for line in separatrix:
        x, y = line.get_data()
        assert abs(y[0]) == pytest.approx(float(critical) / scale, rel=1e-5)
        assert np.interp(1, np.abs(x), np.abs(y)) == pytest.approx(0, abs=0.01)
    assert len(separatrix) == 4
    assert ax.get_ylabel() == r"velocity ratio $\dot\alpha/(p\,\alpha_c)$ [-]"


def outline_of(ax):
    return next(patch for patch in ax.patches if isinstance(patch, Polygon)).get_xy()[:4]


@pytest.mark.parametrize("rotation", [0.1, -0.1])
def test_block(rotation):
    block = jr.Block(0.4, 5.0)
    ax = plot_block(block, rotation)
    corners = outline_of(ax)
    side = np.sign(rotation)
    # It stands on the corner O, leaning to its side, and keeps its size.
    lowest = corners[np.argmin(corners[:, 1])]
    np.testing.assert_allclose(lowest, [0.4 * side, 0], atol=1e-12)
    top = corners[int(np.argmin(corners[:, 1])) ^ 3]  # the other end of that side
    assert np.arctan2(top[0] - lowest[0], top[1]) == pytest.approx(rotation)
    sides = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    np.testing.assert_allclose(sides, [0.8, 4.0, 0.8], rtol=1e-6)
    # The lines have the lengths of their symbols.
    lengths = [np.hypot(*np.ptp(line.get_xydata(), axis=0)) for line in ax.get_lines()[1:4]]
    np.testing.assert_allclose(lengths, [float(block.half_diagonal), 2.0, 0.4], rtol=1e-6)
    # And the arcs the angles.
    angle, critical = [
        patch.theta2 - patch.theta1 for patch in ax.patches if hasattr(patch, "theta1")
    ]
    assert np.radians(angle) == pytest.approx(0.1)
    assert np.radians(critical) == pytest.approx(float(block.critical_angle), rel=1e-6)
    symbols = {"$R$", "$a$", "$b$", "$G$", "$O$", r"$\alpha$", r"$\alpha_c$", r"$\ddot y$"}
    assert {text.get_text() for text in ax.texts} - {""} == symbols
    low, high = ax.get_xlim()
    assert low < corners[:, 0].min() < corners[:, 0].max() < high
    assert ax.get_aspect() == 1


@pytest.mark.parametrize(("ratio", "known"), [(4 / 3, True), (1.2, False)])
def test_a_rectangle_that_stands_in_for_an_outline_says_so(ratio, known):
    ax = plot_block(jr.Block(0.4, 5.0, inertia_ratio=ratio))
    shape = next(
        p for p in ax.patches if isinstance(p, Polygon) and p.get_xy().shape == (5, 2)
    )
    assert (shape.get_linestyle() in ("-", "solid")) == known
    notes = [
        text for text in ax.texts if text.get_text().startswith("a rectangle stands in for")
    ]
    assert len(notes) == (not known)


@pytest.mark.parametrize("slenderness", [0.5, 2.0, 5.0])
def test_a_block_that_falls_stays_in_the_picture(slenderness):
    block = jr.Block(0.4, slenderness)
    for rotation in np.linspace(-np.pi / 2, np.pi / 2, 11):
        ax = plot_block(block, float(rotation))
        x0, x1 = ax.get_xlim()
        y0, y1 = ax.get_ylim()
        x, y = outline_of(ax).T
        assert x0 < x.min() <= x.max() < x1
        assert y0 < y.min() <= y.max() < y1
        plt.close("all")


@pytest.mark.float64
@pytest.mark.parametrize("model", first_by_default([jr.Linearized(), jr.Nonlinear()]))
def test_resonance(model):
    ax = plot_resonance(WALL, 6, model)
    time, ratio = ax.get_lines()[0].get_data()
    launches = jr.half_cycle_velocity(WALL, jnp.arange(1.0, 7.0))
    peaks = model.peak_rotation(WALL.block, launches) / WALL.block.critical_angle
    durations = np.asarray(model.half_cycle_duration(WALL.block, launches))
    starts = np.cumsum(durations) - durations
    assert time[-1] == pytest.approx(durations.sum())
    for k in range(6):
        part = ratio[(time >= starts[k]) & (time <= starts[k] + durations[k])]
        assert part[np.argmax(abs(part))] == pytest.approx(
            (-1) ** k * float(peaks[k]), rel=2e-3
        )
    # Pulses of either sign in turn, right after the impacts, where the rotation is 0.
    (above,) = ax.child_axes
    ups, downs = (line.get_xydata() for line in above.get_lines()[1:])
    pulses = np.concatenate([ups, downs])[np.array([0, 3, 1, 4, 2, 5])]
    np.testing.assert_allclose(pulses[:, 0], starts, rtol=1e-6)
    np.testing.assert_allclose(pulses[:, 1], 0.15 * np.array([1, -1] * 3), rtol=1e-6)
    np.testing.assert_allclose(np.interp(starts, time, ratio), 0, atol=1e-9)
    assert above.get_ylabel() == "$I$ [m/s]"
    assert legend_of(ax) == ["stabilized peak"]
    level = ax.get_lines()[2].get_ydata()[0]
    assert level == pytest.approx(float(jr.rotation_ratio(WALL, model)))


@pytest.mark.float64
def test_resonance_until_it_overturns():
    scene = jr.Scene(WALL.block, 0.7, 0.4)
    assert int(jr.overturning_half_cycle(scene)) == 5
    ax = plot_resonance(scene)
    ratio = ax.get_lines()[0].get_ydata()
    assert 1.19 < ratio[-1] < 1.2
    assert sum(line.get_xdata().size for line in ax.child_axes[0].get_lines()[1:]) == 5
    assert legend_of(ax) == ["critical angle"]
    with pytest.raises(ValueError, match="half_cycles must be at least 1, got 0"):
        plot_resonance(WALL, 0)
    with pytest.raises(ValueError, match="intensity must be greater than 0"):
        plot_resonance(jr.Scene(WALL.block, 0.7, 0.0))


@pytest.mark.thorough
def test_animation(response, tmp_path, monkeypatch):
    animate(response, tmp_path / "block.gif", frames_per_second=5)
    with Image.open(tmp_path / "block.gif") as film:
        assert film.n_frames == 20
        first = np.asarray(film.convert("L"), int)
        film.seek(5)
        assert np.abs(np.asarray(film.convert("L"), int) - first).max() > 50
        assert film.info["duration"] == 200
    monkeypatch.setattr(plot.block, "_FRAMES", 5)
    titles = []
    monkeypatch.setattr(Axes, "set_title", lambda _, title: titles.append(title))
    animate(response, tmp_path / "part.gif", frames_per_second=10, span=(1.0, 2.0))
    assert titles[-1].endswith("°, 2.0 times as fast")
    with Image.open(tmp_path / "part.gif") as film:
        assert film.n_frames == 5
    with pytest.raises(ValueError, match="span must be increasing and within 0 and 4 s"):
        animate(response, tmp_path / "never.gif", span=(1.0, 5.0))
    assert not (tmp_path / "never.gif").exists()


def test_the_ground_of_a_film_moves_against_its_acceleration():
    # The mean over two seconds of t^2 is 1/3 more than its middle.
    steady = jr.Record(np.ones(1000), 0.01)
    shift = plot.block._compute_ground_shift(steady, np.linspace(3, 7, 5))
    np.testing.assert_allclose(shift, 1 / 6, rtol=0.02)


@pytest.mark.thorough
@pytest.mark.float64
def test_overturning_map(boundaries):
    ax = plot_overturning_map(boundaries)
    edges = boundaries.amplitude_ratio.values
    drawn = np.concatenate([line.get_ydata() for line in ax.get_lines()])
    np.testing.assert_array_equal(np.sort(drawn), np.sort(edges[np.isfinite(edges)]))
    shaded, hatched = ax.collections
    # At the first ratio: shaded from the first edge to the second, and from the third on.
    first = edges[0][np.isfinite(edges[0])]
    assert first.size == 3
    areas = [path.get_extents() for path in shaded.get_paths()]
    areas = [(area.y0, area.y1) for area in areas if area.x0 < 2 < area.x1]
    assert areas == [(first[0], first[1]), (first[2], 12)]
    windows = [path.get_extents() for path in hatched.get_paths()]
    windows = [(window.y0, window.y1) for window in windows if window.x0 < 2 < window.x1]
    assert windows == [(first[1], first[2])]
    assert ax.get_yscale() == "log"
    assert ax.get_ylim() == (1, 12)
    assert ax.get_xlim() == (1.5, 3.5)
    assert ax.get_xlabel() == r"frequency ratio $\omega_p/p$ [-]"
    assert legend_of(ax)[:2] == ["overturns", "survives again"]
    assert "boundary: after one impact" in legend_of(ax)
    one = plot_overturning_map(boundaries.isel(frequency_ratio=[0]))
    assert one.get_xlim() == pytest.approx((1.9, 2.1))


def spans_of(ax):
    """From where to where each look of the bar goes."""
    return {
        area.get_label(): [
            tuple(path.vertices[:, 0][[0, 2]].tolist()) for path in area.get_paths()
        ]
        for area in ax.collections
    }


@pytest.mark.float64
def test_boundaries_along_a_factor():
    ax = plot_boundaries(windows(), (2.0, 20.0), uplift=2.5)
    assert {name: np.sort(spans, axis=1).tolist() for name, spans in spans_of(ax).items()} == {
        "stands": [[2, 4], [8, 8.4]],
        "overturns": [[4, 8], [8.4, 20]],
    }
    assert legend_of(ax) == ["stands", "overturns", "lifts off from 2.5"]
    assert ax.get_xscale() == "log"
    # The window is too narrow for labels of both of its ends.
    assert [text.get_text() for text in ax.texts] == [
        "4",
        "8.4",
        "1 of 3 boundaries are not labelled",
    ]
    low, high = ax.get_xlim()
    assert low < 2
    assert high > 20


@pytest.mark.float64
def test_boundaries_along_a_width():
    """Where it overturns at the first value; on a linear axis; without what lifts it."""
    ax = plot_boundaries(windows((0.6,), True, "width"), (0.3, 1.2))
    assert {name: np.sort(spans, axis=1).tolist() for name, spans in spans_of(ax).items()} == {
        "stands": [[0.6, 1.2]],
        "overturns": [[0.3, 0.6]],
    }
    assert ax.get_xlabel() == "width at this height, $2b$ [m]"
    assert ax.get_xscale() == "linear"
    alone = plot_boundaries(windows((), False, "restitution"), (0.3, 0.9))
    assert legend_of(alone) == ["stands"]
    many = np.linspace(1, 2, 40)
    ax = plot_boundaries(windows(many), (0.5, 20.0), uplift=0.2)
    labels = [text for text in ax.texts if hasattr(text, "xy")]
    places = sorted(text.xy[0] for text in labels)
    missing = f"{40 - len(labels)} of 40 boundaries are not labelled"
    assert missing in [text.get_text() for text in ax.texts]
    assert places[0] == 1
    assert places[-1] == 2
    assert np.diff(np.log(places)).min() > 0.025 * np.log(20 / 0.2)
    assert ax.get_xlim()[0] < 0.2
    several = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), windows())
    with pytest.raises(
        ValueError, match="boundaries must be of one block, got an array of shape"
    ):
        plot_boundaries(several, (1.0, 9.0))


@pytest.mark.float64
def test_critical_intensities():
    ax = plot_critical_intensity(WALL.block, 0.7, 0.15)
    lines = {line.get_label().partition(":")[0]: line for line in ax.get_lines()}
    for model in ("nonlinear", "linearized"):
        count, intensity = lines[model].get_data()
        assert count.tolist() == list(range(1, 21))
        # One pulse does it if it is as strong as all: 1 + C + C^2 ... together.
        series = np.cumsum(0.7 ** np.arange(20))
        np.testing.assert_allclose(intensity * series, intensity[0], rtol=1e-12)
        np.testing.assert_allclose(
            lines["pulses without end"].get_ydata(), intensity[0] * 0.3, rtol=4e-3
        )
    assert set(lines["given"].get_ydata()) == {0.15}


def test_tornado(bars):
    ax = plot_tornado(bars, label="rotation ratio [-]")
    assert ax.get_xlabel() == "rotation ratio [-]"
    names = [label.get_text() for label in ax.get_yticklabels()]
    assert names == ["pulse intensity $I$ [m/s]", r"slenderness $\lambda$ [-]"]
    ends = [bar.get_x() + bar.get_width() for bar in ax.patches]
    answers = np.append(bars.at_low, bars.at_high)
    np.testing.assert_allclose(ends, np.nan_to_num(answers, nan=bars.value), rtol=1e-6)
    texts = {text.get_text(): text for text in ax.texts}
    assert set(texts) == {"0.1", "0.4: overturns", "4", "6"}
    # The bar to the low end points to the left, what has none stands to the right.
    assert texts["0.1"].get_ha() == "right"
    assert texts["0.4: overturns"].get_ha() == "left"


def test_sensitivity_map():
    ax = plot_sensitivity_map(SLOPES)
    mesh, lines = ax.collections
    low, high = mesh.get_clim()
    assert low == -high < 0  # white is zero
    assert high == pytest.approx(np.quantile([1, 2, 3, 0, 4], 0.95))
    wide = [
        w for level, w in zip(lines.levels, lines.get_linewidths(), strict=True) if level == 0
    ]
    assert wide == [max(lines.get_linewidths())]
    assert (ax.get_xlabel(), ax.get_ylabel()) == (
        r"slenderness $\lambda$ [-]",
        "half-width $b$ [m]",
    )
    # Above, not beside it, where it would belong to the next map.
    assert [other.get_xlabel() for other in ax.figure.axes[1:]] == ["elasticity [-]"]
    assert legend_of(ax) == ["no value: overturns"]
    # Numbers and lines can be read on the darkest colours.
    dark = min(np.dot(mesh.cmap(end)[:3], (0.299, 0.587, 0.114)) for end in (0.0, 1.0))
    assert dark > 0.3
    with pytest.raises(ValueError, match="two dimensions"):
        plot_sensitivity_map(SLOPES[0])
    row = (
        SLOPES[:1].rename("derivative of the peak").drop_attrs()
    )  # no contours in one dimension
    figure = plot_sensitivity_map(row, limit=2.0).figure
    assert figure.axes[0].collections[0].get_clim() == (-2, 2)
    assert figure.axes[1].get_xlabel() == "derivative of the peak"
    nothing = plot_sensitivity_map(SLOPES * np.nan)
    assert len(nothing.collections) == 1


@pytest.mark.float64
def test_tradeoff():
    ax = plot_tradeoff(tradeoff_table())
    assert legend_of(ax) == ["batch", "filled: on the front", "default"]
    # Written on the lines.
    texts = [text.get_text() for text in ax.texts]
    assert texts[::8] == ["100,000,000 at once", "one at a time"]
    ring = ax.get_lines()[-1]
    assert (ring.get_xdata().item(), ring.get_ydata().item()) == (1e-7, 1e-2)


def test_reliability():
    ax = plot_reliability(scores())
    diagonal, marks = ax.lines[:2]
    np.testing.assert_array_equal(diagonal.get_xydata(), [[0, 0], [1, 1]])
    # A bin without tests has no mark.
    np.testing.assert_array_equal(marks.get_xydata(), [[0.1, 0.0], [0.85, 0.5]])
    (intervals,) = ax.collections
    ends = [[[0.1, 0], [0.1, 0.95]], [[0.85, 0.03], [0.85, 0.97]]]
    np.testing.assert_allclose(intervals.get_segments(), ends)
    assert [text.get_text() for text in ax.texts] == ["1", "2"]
    # Mean and standard deviation over the splits that have a score.
    assert ax.get_title() == r"Brier score 0.050 $\pm$ 0.014 over 2 splits"
    assert legend_of(ax)[1] == "observed, with\n90% interval and\nnumber of tests"
    plain = plot_reliability(scores().isel(split=[0]).drop_attrs())
    assert plain.get_title() == "Brier score 0.040"
    assert legend_of(plain)[1] == "observed, with\ninterval and\nnumber of tests"


def test_outcomes():
    ax = plot_outcomes(scores())
    base_rate, stood, overturned = ax.lines
    # Of the tests that some split has predicted.
    np.testing.assert_allclose(base_rate.get_ydata(), [1 / 3, 1 / 3])
    np.testing.assert_array_equal(stood.get_xydata(), [[0.1, 0.1], [0.5, 0.75]])
    np.testing.assert_array_equal(overturned.get_xydata(), [[2.0, 0.95]])
    assert stood.get_marker() != overturned.get_marker()
    assert legend_of(ax) == ["base rate, 0.333", "stood, 2", "overturned, 1"]
    assert (ax.get_xscale(), ax.get_xlabel()) == ("log", "PGV [m/s]")
    other = plot_outcomes(scores(), measure="pga")
    np.testing.assert_array_equal(other.lines[1].get_xdata(), [1.0, 9.0])
    assert other.get_xlabel() == "PGA [m/s²]"
    with pytest.raises(ValueError, match=r"^measure must be one of pgv, pga, got 'sa'$"):
        plot_outcomes(scores(), measure="sa")


@pytest.mark.parametrize("name", jr.plot.__all__)
def test_every_picture_says_what_it_is_drawn_of(name, monkeypatch):
    # Without the types that the tests check, which would answer before the package does.
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    draw = getattr(jr.plot, name)
    parameters = inspect.signature(draw).parameters.values()
    # The parameters without a default: what is drawn, and perhaps more.
    others = [None for parameter in parameters if parameter.default is parameter.empty][1:]
    with pytest.raises(
        ValueError, match=r"must be an? \w+, got 'a block'.*; .+ (gives|makes) one"
    ):
        draw("a block", *others)
