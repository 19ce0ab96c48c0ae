"""The work-precision diagram: what is on the front, said in words and drawn."""

import numpy as np
import pytest
import xarray

import jaxrock as jr
from jaxrock.accuracy import tradeoff
from jaxrock.plot import plot_tradeoff

pytestmark = pytest.mark.float64

ROWS = [
    # kind, solver, batch, error, seconds, default
    ("nonlinear", "-", 1, 1e-2, 1e-5, 0),
    ("adaptive", "Tsit5", 1, 1e-6, 2e-3, 1),
    ("adaptive", "Dopri8", 1, 1e-5, 3e-3, 0),
    ("adaptive", "Tsit5", 1, 1e-10, 4e-3, 0),
    ("adaptive", "Euler", 1, np.inf, 1e-6, 0),
    ("batch", "-", 1000, 1e-9, 7e-6, 1),
]


def table():
    rows = [
        {
            "label": f"{kind}, {solver}",
            "level": kind,
            "bits": 64,
            "batch": batch,
            "solver": solver,
            "tolerance": np.nan,
            "default": bool(default),
            "error": error,
            "seconds": seconds,
            "spread": 0.1,
            "compilation": 1.0,
        }
        for kind, solver, batch, error, seconds, default in ROWS
    ]
    return tradeoff.Tradeoff(tradeoff._tabulate(rows, tradeoff.make_default_scene(), 1e-14))


def test_front():
    found = table()
    assert found.dataset.front.values.tolist() == [1, 1, 0, 1, 0, 1]
    assert found.dataset.behind.values[2] == pytest.approx(1.5)
    assert found.best(1e-4, batch=1) == "adaptive, Tsit5 (2 ms per answer)"
    assert found.best(1e-4) == "batch, - (7 us per answer)"
    assert found.best(1e-12) is None
    assert "for 1e-10 nothing is enough" in found.sentence(1000)
    assert found.notes() == ["never the fastest: the solver Dopri8, Euler"]
    assert (
        "default in batches of 1: adaptive, Tsit5, error 1.0e-06, takes 1.00 times as"
        in str(found)
    )


def test_plot(tmp_path):
    ax = plot_tradeoff(table().dataset)
    assert ax.get_xscale() == ax.get_yscale() == "log"
    assert "[s]" in ax.get_xlabel()
    labels = {text.get_text() for text in ax.get_legend().get_texts()}
    assert {"adaptive, Tsit5", "adaptive, Dopri8", "filled: on the front", "default"} < labels
    table().dataset.to_netcdf(tmp_path / "tradeoff.nc")
    with xarray.open_dataset(tmp_path / "tradeoff.nc") as again:
        assert again.error.attrs["units"] == "1"


@pytest.mark.thorough
@pytest.mark.parametrize("resonance", [False, True])
def test_measured(resonance):
    """Errors do not depend on the machine: five orders between the ends, defaults as said."""
    scene = jr.Scene(jr.Block(0.4, 5.0), 0.7, 0.15) if resonance else None
    rows = jr.accuracy.measure_tradeoff(scene, repeats=1).dataset
    on_front = rows.error.values[rows.front.values == 1]
    assert on_front.max() / on_front.min() > 1e5
    adaptive = rows.where((rows.default == 1) & (rows.level == "adaptive"), drop=True)
    wide = adaptive.where(adaptive.bits == 64, drop=True)
    assert float(wide.error.max()) < 1e-8
    if not resonance:
        lockstep = rows.where((rows.default == 1) & (rows.level == "batch"), drop=True)
        assert float(lockstep.error.max()) < 1e-9
