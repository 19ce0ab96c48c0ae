"""What a reader sees in pictures: what is left out is said, and no text lies on another."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray
from tools.command import run
from tools.pictures import find_clashes

import jaxrock as jr
from jaxrock.cli import respond as response_command
from jaxrock.plot import (
    plot_curves,
    plot_fragility,
    plot_rocking_spectrum,
    plot_sensitivity_map,
    plot_spectrum,
    plot_tornado,
)
from jaxrock.sensitivity.measures import arrange_bars


def spectrum_of(slenderness, widths=(0.4,), restitutions=(0.6,), intensities=(0.1,)):
    """A resonance spectrum whose ratio is the slenderness over 10, whatever the block."""
    axes = {
        "slenderness": np.asarray(slenderness),
        "width": np.asarray(widths),
        "restitution": np.asarray(restitutions),
        "intensity": np.asarray(intensities),
    }
    ratio = np.broadcast_to(
        axes["slenderness"][:, None, None, None] / 10, [each.size for each in axes.values()]
    )
    units = dict(zip(axes, ("1", "m", "1", "m s-1"), strict=True))
    return xarray.Dataset(
        {"rotation_ratio": (list(axes), ratio), "critical_intensity": (list(axes), ratio)},
        {name: (name, values, {"units": units[name]}) for name, values in axes.items()},
        {"model": "linearized", "gravity": 9.81, "inertia_ratio": 4 / 3},
    )


def notes_of(figure):
    return figure.get_supxlabel()


def test_a_spectrum_says_what_it_leaves_out():
    many = spectrum_of(
        np.linspace(3, 10, 2001),
        np.linspace(0.4, 1.4, 20),
        np.linspace(0.1, 0.5, 9),
    )
    figure = plot_spectrum(many, "critical_intensity")
    assert notes_of(figure) == (
        "7 of 20 widths, 500 of 2,001 slenderness values, 4 of 9 restitutions shown"
    )
    lines = [line for ax in figure.axes for line in ax.get_lines()]
    assert len(lines) == 7 * 4
    # Thinned, and still from end to end.
    assert {line.get_xdata().size for line in lines} == {500}
    assert {(line.get_xdata()[0], line.get_xdata()[-1]) for line in lines} == {(3, 10)}
    # Widths in digits that tell them apart, not in all that they have.
    texts = figure.axes[3].get_legend().get_texts()
    assert texts[1].get_text() == "0.5579"
    assert find_clashes(figure) == []
    assert notes_of(plot_spectrum(spectrum_of([3.0, 4.0]), "critical_intensity")) == ""


def test_a_rocking_spectrum_says_what_it_leaves_out():
    slenderness = np.linspace(3, 10, 8)
    axes = {"free_period": np.linspace(1, 4, 700), "slenderness": slenderness}
    ratio = np.full((700, 8), 0.5)
    found = xarray.Dataset(
        {"rotation_ratio": (list(axes), ratio), "overturned": (list(axes), 0 * ratio)}, axes
    )
    figure = plot_rocking_spectrum(found)
    assert notes_of(figure) == "5 of 8 slenderness values shown"
    # Its curves are rough: a point that is left out may be a peak.
    assert figure.axes[0].get_lines()[0].get_xdata().size == 700


@pytest.mark.float64
def test_thresholds_close_together_are_written_apart():
    spectrum = jr.resonance_spectrum(
        np.linspace(3, 10, 15), np.linspace(0.6, 0.9, 7), [0.75, 0.9], [0.11, 0.3]
    )
    figure = plot_spectrum(spectrum)
    assert find_clashes(figure) == []
    texts = [[text.get_text() for text in ax.texts] for ax in figure.axes]
    # One that is not written would lie on the one before; its cross is drawn.
    assert 1 < len(texts[1]) < sum(line.get_marker() == "x" for line in figure.axes[1].lines)
    assert texts[3] == ["overturn throughout:\nall"]


@pytest.mark.float64
def test_a_period_without_bound_is_an_arrow():
    spectrum = jr.resonance_spectrum(np.linspace(3, 10, 29), [0.8], [0.6, 0.8], 0.15)
    period = spectrum.stabilized_period.sel(width=0.8)
    limits = xarray.DataArray([20.0, 9.39], {"restitution": [0.6, 0.8]})
    ax = plot_curves(period, "restitution", thresholds=limits)
    marks = [line for line in ax.get_lines() if line.get_marker() in ("x", "^")]
    assert {line.get_marker() for line in marks} == {"^"}
    # At the last value of the curve, within the axes.
    at = float(period.sel(restitution=0.8).max())
    assert marks[0].get_ydata().tolist() == [at]
    assert at < ax.get_ylim()[1]
    assert [text.get_text() for text in ax.texts] == ["9.39"]
    names = [text.get_text() for text in ax.get_legend().get_texts()]
    assert names == ["0.6", "0.8", "grows without bound,\noverturns beyond"]


def test_probabilities_stand_at_their_levels_and_intervals_are_bands():
    pulse = np.sin(np.linspace(0, 2 * np.pi, 200))
    suite = jr.Suite([jr.Record(a * pulse, a / 400) for a in (1.0, 2.0, 3.0)])
    levels = np.geomspace(0.2, 3, 7)
    curves = jr.fragility(jr.Block(0.1, 5.0), 0.8, suite, levels)
    ax = plot_fragility(curves)
    marks = [line for line in ax.get_lines() if line.get_linestyle() == "None"]
    assert not ax.containers  # no bars
    names = [text.get_text() for text in ax.get_legend().get_texts()]
    # Thresholds with the same probabilities are drawn once, and the legend names them.
    assert len(marks) == len(names) < curves.threshold.size
    named = sum(name.count("the same within one record") for name in names)
    assert named == curves.threshold.size - len(names)
    curve = curves.isel(threshold=-1)
    np.testing.assert_allclose(marks[-1].get_xdata(), levels)
    np.testing.assert_array_equal(marks[-1].get_ydata(), curve.exceedance)
    (band,) = ax.collections
    corners = band.get_paths()[0].vertices
    third = corners[np.isclose(corners[:, 0], levels[2]), 1]
    ends = float(curve.exceedance_low[2]), float(curve.exceedance_high[2])
    np.testing.assert_allclose([third.min(), third.max()], ends)
    assert "band: 95% interval of\noverturning" in ax.get_legend().get_title().get_text()
    assert find_clashes(ax.figure) == []
    # Of a single level there is no band: the interval is a line.
    (segment,) = (
        plot_fragility(curves.isel(level=[2], threshold=[1])).collections[0].get_segments()
    )
    ends = curves.isel(level=2, threshold=1)
    np.testing.assert_allclose(segment[:, 1], [ends.exceedance_low, ends.exceedance_high])


def bars_of(answers, names=None):
    """Bars from the answer with all parameters unchanged, and both answers of each parameter."""
    middle, *pairs = answers
    names = names or [f"number_{k}" for k in range(len(pairs))]
    ranges = {name: (0.12345, 12345.6) for name in names}
    return arrange_bars(np.array([middle, *np.ravel(pairs)]), ranges, ())


LONG = "the_largest_acceleration_of_the_floor_that_was_ever_measured_in_this_hall"
TORNADOES = {
    "tiny": bars_of([1.0, (1.0, 1.0), (1 - 1e-9, 1 + 1e-9), (0.5, 2.0)]),
    "one side": bars_of([1.0, (1.2, 1.4), (0.9, 0.8), (1.1, 1.1)]),
    "long names": bars_of([1.0, (0.9, 1.2), (0.8, 1.3)], [LONG, f"{LONG}_and_beside_it"]),
    "overturns": bars_of([0.3, (0.1, np.nan), (np.nan, 0.2), (np.nan, np.nan)]),
    "overturns unchanged": bars_of([np.nan, (0.1, np.nan), (0.2, 0.3)]),
    "many": bars_of([1.0, *((1 - 0.01 * k, 1 + 0.02 * k) for k in range(1, 21))]),
}


@pytest.mark.parametrize("case", TORNADOES)
def test_texts_of_a_tornado_lie_apart(case):
    """Also on axes that are given, the half of a figure."""
    bars = TORNADOES[case]
    _, given = plt.subplots(1, 2, layout="constrained", figsize=(12, 4.8))
    for ax in (plot_tornado(bars), plot_tornado(bars, given[0])):
        assert find_clashes(ax.figure) == []
        assert len(ax.texts) == 2 * len(bars.names)


def test_bars_of_a_narrow_tornado_are_seen():
    _, ax = plt.subplots(figsize=(3.6, 3.0), layout="constrained")
    plot_tornado(TORNADOES["overturns"], ax)
    low, high = ax.get_xlim()
    assert high - low < 3 * (0.3 - 0.1)


def map_of(values):
    """A map of these values, 20 by 30."""
    axes = {"half_width": np.linspace(0.2, 0.6, 20), "slenderness": np.linspace(3, 10, 30)}
    attributes = {"long_name": "elasticity", "units": "1"}
    return xarray.DataArray(np.reshape(values, (20, 30)), axes, list(axes), attrs=attributes)


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
    ax = plot_sensitivity_map(map_of(values))
    mesh = ax.collections[0]
    taken = np.asarray(mesh.norm(values)).clip(0, 1)
    # In ten classes of colours none has more than a third of the map.
    assert np.histogram(taken, 10, (0, 1))[0].max() < 200
    bar = mesh.colorbar
    low, high = mesh.get_clim()
    outside = {(True, True): "both", (True, False): "min", (False, True): "max"}
    assert bar.extend == outside[bool((values < low).any()), bool((values > high).any())]
    # Signs are told by colour where there are two.
    assert (low == -high) == (case == "both signs")
    zero, end = (np.array(mesh.cmap(x)[:3]) for x in (0.5, 1.0))
    if case == "both signs":
        assert zero.min() > 0.9
    assert (end.min() > 0.9) == (case == "below zero")
    assert find_clashes(ax.figure) == []


@pytest.mark.thorough
def test_respond_names_the_scene_in_picture_and_text(tmp_path, capsys, monkeypatch):
    titles = []
    keep = response_command.save_picture

    def save(drawn, path):
        titles.append(drawn.figure.get_suptitle())
        assert find_clashes(drawn.figure) == []
        keep(drawn, path)

    monkeypatch.setattr(response_command, "save_picture", save)
    record = tmp_path / "hall.csv"
    times = np.arange(0, 1, 0.01)
    record.write_text(
        "time [s],north [m/s2]\n"
        + "".join(f"{t:.2f},{3 * np.sin(6 * t):.5f}\n" for t in times)
    )
    block = ("--width", 0.6, "--height", 2.4, "--restitution", 0.85, "--duration", 1)
    for k, (motion, named) in enumerate(
        (
            (("--record", record, "--scale", 1.5), "hall.csv, scaled by 1.5"),
            (
                ("--pulse", "sine", "--amplitude", 4, "--pulse-duration", 0.5),
                "sine pulse of 4 m/s2, 0.5 s, scaled by 1",
            ),
        )
    ):
        code, text, _ = run(capsys, "respond", *block, *motion, "--out", tmp_path / str(k))
        assert code == 0
        expected = f"0.6 m wide, 2.4 m high, C = 0.85, {named}"
        assert text.split("\n")[0] == expected
        assert titles[-1] == expected
