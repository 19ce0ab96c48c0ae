"""The work-precision diagram: errors and times as they are measured, the front, the picture."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

import jaxrock as jr
from jaxrock.accuracy.cheapest_setting import Setting
from jaxrock.accuracy.tradeoff import tabulate_tradeoff
from jaxrock.plot import plot_tradeoff

pytestmark = pytest.mark.float64

ROWS = [  # setting, error, seconds of a call
    (Setting("nonlinear", 64), 1e-2, 1e-5),
    (Setting("adaptive", 64, 1e-8, "Tsit5"), 1e-6, 2e-3),
    (Setting("adaptive", 64, 1e-8, "Dopri8"), 1e-5, 3e-3),
    (Setting("adaptive", 64, 1e-11, "Tsit5"), 1e-10, 4e-3),
    (Setting("adaptive", 64, 1e-3, "Dopri8"), np.inf, 1e-6),
    (Setting("batch", 64, 1e-9, batch=1000), 1e-9, 7e-3),
]


def table():
    settings, errors, seconds = zip(*ROWS, strict=True)
    return tabulate_tradeoff(settings, np.array(errors), np.array([seconds] * 3))


def test_front():
    dataset = table()
    assert dataset.front.values.tolist() == [1, 1, 0, 1, 0, 1]
    assert dataset.default.values.tolist() == [0, 1, 0, 0, 0, 1]
    np.testing.assert_allclose(dataset.behind.values[2], 1.5)
    assert dataset.seconds.values[-1] == pytest.approx(7e-6)  # of an answer, not of the batch


@pytest.mark.thorough
@pytest.mark.parametrize("resonance", [False, True])
def test_measured(resonance):
    """Errors do not depend on the machine: five orders between the ends, defaults as said."""
    scene = jr.Scene(jr.Block(0.4, 5.0), 0.7, 0.15) if resonance else None
    rows = jr.accuracy.measure_tradeoff(scene, repeats=1)
    _, ax = plt.subplots()
    assert plot_tradeoff(rows, ax=ax) is ax
    plt.close("all")
    on_front = rows.error.values[rows.front.values == 1]
    assert on_front.max() / on_front.min() > 1e5
    default = rows.where((rows.default == 1) & (rows.bits == 64), drop=True)
    assert float(default.error.max()) < 1e-8
