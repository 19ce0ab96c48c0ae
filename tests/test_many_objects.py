"""Fragility and rates of many objects, and of uncertain ones: as alone, and closed forms."""

import jax
import numpy as np
import pytest
from references.half_sine_rates import DURATIONS, closed_rate, hazard, pulses, verge
from scipy import stats

import jaxrock as jr

HALF_WIDTHS = np.array([0.2, 0.25, 0.32])
RESTITUTIONS = np.array([0.8, 0.85, 0.9])
BLOCKS = jr.Block(HALF_WIDTHS, 4.0)
LINEARIZED = {"model": "linearized"}


@pytest.mark.thorough
@pytest.mark.float64
def test_rates_of_many_are_those_of_each():
    """And so are derivatives."""
    site = jr.risk.Site(pulses(50), hazard, levels=np.geomspace(0.9, 6.0, 12))

    def rate(block, restitution):
        return jr.risk.overturning_rate(block, restitution, site, **LINEARIZED).rate

    many = rate(BLOCKS, RESTITUTIONS)
    derivatives = jax.grad(lambda block: rate(block, RESTITUTIONS).sum())(BLOCKS).half_width
    for k, b in enumerate(HALF_WIDTHS):
        alone = jax.value_and_grad(lambda block, k=k: rate(block, RESTITUTIONS[k]))
        value, derivative = alone(jr.Block(b, 4.0))
        assert float(many[k]) == pytest.approx(float(value), rel=1e-12)
        assert float(value) == pytest.approx(
            float(closed_rate("pgv", b, 4.0, 4 / 3)), rel=1e-3
        )
        assert float(derivatives[k]) == pytest.approx(float(derivative.half_width), rel=1e-9)


def find_half_widths(levels, duration):
    """The half-widths that pulses of these levels just overturn, of 0.03 to 1.5 m."""
    sizes = np.geomspace(0.03, 1.5, 100)
    critical = [float(verge("pgv", duration, b, 4.0, 4 / 3)) for b in sizes]
    return np.exp(np.interp(levels, critical, np.log(sizes)))


@pytest.mark.thorough
@pytest.mark.float64
def test_an_uncertain_size_in_closed_form():
    """The probability that a lognormal size is below the one that is just overturned."""
    levels = np.array([1.2, 1.6, 2.0, 2.6])
    uncertain = jr.Uncertain({"half_width": 0.2}, samples=512)
    options = {**LINEARIZED, "thresholds": ["overturning"], "uncertain": uncertain}
    curves = jr.risk.fragility(jr.Block(0.25, 4.0), 0.85, pulses(400), levels, **options)
    critical = np.array([find_half_widths(levels, duration) for duration in DURATIONS])
    exact = stats.norm.cdf(np.log(critical / 0.25) / np.sqrt(np.log1p(0.2**2)))
    np.testing.assert_allclose(curves.overturned.mean("sample"), exact, atol=0.01)
    np.testing.assert_allclose(curves.exceedance[:, 0], exact.mean(axis=0), atol=0.01)
