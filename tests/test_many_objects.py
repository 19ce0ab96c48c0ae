"""Fragility and rates of many objects, and of uncertain ones: as alone, and closed forms."""

import jax
import numpy as np
import pytest
from references.half_sine_rates import DURATIONS, closed_rate, hazard, pulses, verge
from scipy import optimize, stats

import jaxrock as jr

DOUBLE = pytest.mark.float64
SLOW = pytest.mark.thorough
HALF_WIDTHS = np.array([0.2, 0.25, 0.32])
RESTITUTIONS = np.array([0.8, 0.85, 0.9])
BLOCKS = jr.Block(HALF_WIDTHS, 4.0)
LEVELS = np.geomspace(0.9, 6.0, 12)
LINEARIZED = {"model": "linearized"}


def assert_close(one, other, name=""):
    """Equal words, and numbers to 1e-12."""
    one, other = np.asarray(one), np.asarray(other)
    if one.dtype.kind == "U":
        assert (one == other).all(), name
    else:
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-14, err_msg=name)


@pytest.mark.thorough
@DOUBLE
@pytest.mark.parametrize(
    "uncertain", [None, jr.Uncertain({"half_width": 0.1, "restitution": 0.05}, samples=4)]
)
def test_fragility_of_many_is_that_of_each(uncertain):
    options = {**LINEARIZED, "uncertain": uncertain}
    arguments = (BLOCKS, RESTITUTIONS, pulses(50), LEVELS[:5])
    many = jr.fragility(*arguments, **options)
    assert many.exceedance.dims == ("object", "level", "threshold")
    assert many.object.values.tolist() == ["1", "2", "3"]
    for k in (0, 2):
        block = jr.Block(HALF_WIDTHS[k], 4.0)
        one = jr.fragility(block, RESTITUTIONS[k], *arguments[2:], **options)
        assert one.exceedance.dims == ("level", "threshold")
        for name in one:
            assert_close(one[name], many[name].isel(object=k), name)


@pytest.mark.thorough
def test_fragility_over_a_measure_of_the_block():
    """Each object has its own levels of motion where the measure is relative to it."""
    options = {**LINEARIZED, "measure": "pga_ratio", "thresholds": ["uplift"]}
    many = jr.fragility(BLOCKS, 0.8, pulses(50), [0.9, 1.1], **options)
    np.testing.assert_array_equal(many.exceedance[..., 0], [[0, 1]] * 3)
    alone = jr.fragility(jr.Block(0.32, 4.0), 0.8, pulses(50), [0.9, 1.1], **options)
    assert_close(alone.rotation_ratio, many.rotation_ratio[2])


@DOUBLE
@SLOW
def test_rates_of_many_are_those_of_each():
    """And so are derivatives."""
    site = jr.Site(pulses(50), hazard, levels=LEVELS)

    def rates(block, restitution):
        return jr.overturning_rate(block, restitution, site, **LINEARIZED)

    many = rates(BLOCKS, RESTITUTIONS)
    derivatives = jax.grad(lambda block: rates(block, RESTITUTIONS).rate.sum())(BLOCKS)
    for k in range(3):
        block = jr.Block(HALF_WIDTHS[k], 4.0)
        single = rates(block, RESTITUTIONS[k])
        for name in ("rate", "standard_error", "not_detected", "complete"):
            assert_close(getattr(single, name), getattr(many, name)[k], name)
        assert_close(single.contributions, many.contributions[:, k])
        assert float(single.rate) == pytest.approx(
            float(closed_rate("pgv", HALF_WIDTHS[k], 4.0, 4 / 3)), rel=1e-3
        )
        derivative = jax.grad(lambda block, k=k: rates(block, RESTITUTIONS[k]).rate)(block)
        expected = float(derivative.half_width)
        assert float(derivatives.half_width[k]) == pytest.approx(expected, rel=1e-9)


def find_half_width(level, duration):
    """The half-width that a pulse of this level just overturns, at slenderness 4."""
    ends = (0.03, 1.5)
    low, high = (float(verge("pgv", duration, b, 4.0, 4 / 3)) for b in ends)
    # Of sizes beyond the ends there are none in the samples.
    if not low < level < high:
        return ends[0] if level <= low else ends[1]
    return optimize.brentq(
        lambda b: float(verge("pgv", duration, b, 4.0, 4 / 3)) - level, *ends
    )


@DOUBLE
@SLOW
def test_an_uncertain_size_in_closed_form():
    """The probability that a lognormal size is below the one that is just overturned."""
    coefficient = 0.2
    levels = np.array([1.2, 1.6, 2.0, 2.6])
    options = {**LINEARIZED, "thresholds": ["overturning"]}
    block = jr.Block(0.25, 4.0)
    suite = pulses(400)
    uncertain = jr.Uncertain({"half_width": coefficient}, samples=512)
    curves = jr.fragility(block, 0.85, suite, levels, uncertain=uncertain, **options)
    width = np.sqrt(np.log1p(coefficient**2))
    critical = np.array([[find_half_width(x, d) for x in levels] for d in DURATIONS])
    exact = stats.norm.cdf(np.log(critical / 0.25) / width)
    of_records = curves.overturned.mean("sample")
    np.testing.assert_allclose(of_records, exact, atol=0.01)
    np.testing.assert_allclose(curves.exceedance[:, 0], exact.mean(axis=0), atol=0.01)
    # Of the binomial interval: the count of records, which are 3, need not be whole.
    low = stats.beta.ppf(0.025, 3 * exact.mean(axis=0), 4 - 3 * exact.mean(axis=0))
    np.testing.assert_allclose(curves.exceedance_low[:, 0], low, atol=0.01)
