"""The work-precision diagram: errors and times as they are measured, the front, the picture."""

import matplotlib.pyplot as plt
import pytest

import jaxrock as jr
from jaxrock.plot import plot_tradeoff

pytestmark = pytest.mark.float64


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
