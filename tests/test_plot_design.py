"""What the figures of inverse design and sensitivity show."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

import jaxrock as jr
from jaxrock.plot_design import (
    plot_convergence,
    plot_overturning_map,
    plot_sensitivity_map,
    plot_tornado,
)


@pytest.fixture(autouse=True)
def close_figures():
    yield
    plt.close("all")


@pytest.mark.float64
def test_overturning_map():
    found = jr.overturning_map(jr.Sine, [2.0, 3.0], (1.0, 12.0), restitution=0.9)
    _, given = plt.subplots()
    ax = plot_overturning_map(found, ax=given)
    assert ax is given
    edges = found.amplitude_ratio.values
    drawn = np.concatenate([line.get_ydata() for line in ax.get_lines()])
    np.testing.assert_array_equal(np.sort(drawn), np.sort(edges[np.isfinite(edges)]))
    (shade,) = ax.collections
    shaded = ~np.ma.getmaskarray(np.ma.masked_invalid(shade.get_array()))
    assert shaded.shape == (600, 2)
    # Shaded from the first edge to the second.
    levels = np.geomspace(1, 12, 600)
    first, second = edges[0, :2]
    np.testing.assert_array_equal(shaded[levels < second, 0], levels[levels < second] >= first)
    assert ax.get_yscale() == "log"
    assert ax.get_ylim() == (1, 12)
    assert ax.get_xlabel() == r"frequency ratio $\omega_p/p$ [-]"
    assert "after one impact" in [text.get_text() for text in ax.get_legend().get_texts()]


def test_tornado():
    wall = jr.Scene(jr.Block(0.4, 5.0), restitution=0.7, intensity=0.15)
    ranges = {"slenderness": (4.0, 6.0), "intensity": (0.1, 0.4)}
    swing = jr.tornado(jr.rotation_ratio, wall, ranges)
    ax = plot_tornado(swing, label="rotation ratio [-]")
    assert ax.get_xlabel() == "rotation ratio [-]"
    names = [label.get_text() for label in ax.get_yticklabels()]
    assert names == [name.replace("_", " ") for name in swing.names]
    ends = [bar.get_x() + bar.get_width() for bar in ax.patches]
    np.testing.assert_allclose(
        ends, np.nan_to_num(np.append(swing.at_low, swing.at_high), nan=float(swing.value)),
        rtol=1e-6,
    )  # fmt: skip
    assert [text.get_text() for text in ax.texts if "overturns" in text.get_text()] == [
        " high: overturns "
    ]


def test_sensitivity_map():
    import xarray

    slopes = xarray.DataArray(
        np.array([[1.0, -2.0, 3.0], [np.nan, 0.0, -4.0]]),
        {"restitution": [0.5, 0.6], "slenderness": [3.0, 4.0, 5.0]},
        ("restitution", "slenderness"),
        attrs={"long_name": "elasticity"},
    )
    ax = plot_sensitivity_map(slopes)
    mesh = ax.collections[0]
    low, high = mesh.get_clim()
    assert low == -high  # white is zero
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("slenderness", "restitution")
    with pytest.raises(ValueError, match="two dimensions"):
        plot_sensitivity_map(slopes[0])


@pytest.mark.float64
def test_convergence():
    train = jr.worst_train(jr.Block(0.4, 5.0), 0.7, 2, starts=3)
    ax = plot_convergence(train)
    assert len(ax.get_lines()) == 3
    assert all(line.get_ydata()[-1] < 1e-6 for line in ax.get_lines())
    assert ax.get_yscale() == "log"
