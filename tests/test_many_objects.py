"""Fragility and rates of many objects, and of uncertain ones: as alone, and closed forms."""

import equinox as eqx
import jax
import mpmath
import numpy as np
import pytest
from references.half_sine_rates import DURATIONS, closed_rate, hazard, pulses, verge
from scipy import optimize, stats

import jaxrock as jr
from jaxrock.driven import follow_within

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
    options = {**LINEARIZED, "uncertain": uncertain, "tolerance": 1e-2}
    names = ["vase", "bust", "case"]
    arguments = (BLOCKS, RESTITUTIONS, pulses(50), LEVELS[:5])
    many = jr.fragility(*arguments, names=names, **options)
    assert many.exceedance.dims == ("object", "level", "threshold")
    assert many.object.values.tolist() == names
    for k in (0, 2):
        block = jr.Block(HALF_WIDTHS[k], 4.0)
        one = jr.fragility(block, RESTITUTIONS[k], *arguments[2:], **options)
        assert one.exceedance.dims == ("level", "threshold")
        for name in one:
            # Estimates of errors are differences.
            if name != "error":
                assert_close(one[name], many[name].isel(object=k), name)


def test_an_integration_that_does_not_finish_is_named(monkeypatch):
    """By its object, its record and its level."""

    def fail_at_last(*arguments):
        estimate = follow_within(*arguments)
        status = np.array(estimate.response.status)
        status.flat[-1] = jr.Status.STOPPED
        return eqx.tree_at(lambda found: found.response.status, estimate, status)

    monkeypatch.setattr("jaxrock.risk.response_table.follow_within", fail_at_last)
    suite = jr.Suite([*pulses(50)][:2], ["napa", "kobe"])
    arguments = (BLOCKS, 0.8, suite, [1.0, 2.0])
    options = {**LINEARIZED, "names": ["vase", "bust", "case"], "tolerance": 1e-2}
    message = r"did not finish for object 'case'.* record 'kobe' at level 2$"
    with pytest.raises(ValueError, match=message):
        jr.fragility(*arguments, **options)


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


@DOUBLE
def test_rates_of_samples_in_closed_form():
    """However far apart the levels are: boundaries are located between them."""
    block = jr.Block(0.25, 4.0)
    uncertain = jr.Uncertain({"half_width": 0.1}, samples=8)
    site = jr.Site(pulses(400), hazard, levels=LEVELS)
    answer = jr.overturning_rate(block, 0.85, site, uncertain, **LINEARIZED)
    half_widths = uncertain.draw(block, 0.85).block.half_width
    exact = np.array([float(closed_rate("pgv", b, 4.0, 4 / 3)) for b in half_widths])
    # 400 straight lines are the half-sine pulse to 1e-5.
    np.testing.assert_allclose(answer.sample_rates, exact, rtol=5e-4)
    assert float(answer.rate) == pytest.approx(exact.mean(), rel=1e-4)


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
    # Rate: the mean of the closed form over the same distribution, by quadrature.
    z = np.linspace(-4, 4, 41)
    weights = stats.norm.pdf(z) / stats.norm.pdf(z).sum()
    rates = [float(closed_rate("pgv", 0.25 * np.exp(width * x), 4.0, 4 / 3)) for x in z]
    mean = weights @ rates
    site = jr.Site(suite, hazard, levels=np.geomspace(0.5, 8.0, 60))
    fewer = jr.Uncertain({"half_width": coefficient}, samples=64)
    answer = jr.overturning_rate(block, 0.85, site, fewer, **LINEARIZED)
    assert float(answer.rate) == pytest.approx(mean, rel=0.02)
    deviation = np.sqrt(weights @ (np.array(rates) - mean) ** 2)
    assert answer.sample_rates.std() == pytest.approx(deviation, rel=0.1)


@DOUBLE
@SLOW
def test_dispersion_is_split_by_its_causes():
    """Without uncertainty all is due to the records, with one record none is."""
    levels = np.geomspace(0.8, 4.0, 40)
    options = {**LINEARIZED, "thresholds": ["overturning"]}
    block = jr.Block(0.25, 4.0)
    equal_samples = jr.Uncertain({"half_width": 0.0}, samples=2)
    certain = jr.fragility(block, 0.85, pulses(50), levels, uncertain=equal_samples, **options)
    assert float(certain.dispersion_of_parameters[0]) == 0
    assert float(certain.dispersion_of_records[0]) == pytest.approx(
        float(certain.lognormal_dispersion[0]), rel=1e-9
    )
    different_samples = jr.Uncertain({"half_width": 0.2}, samples=64)
    uncertain = jr.fragility(
        block, 0.85, pulses(50)[:1], levels, uncertain=different_samples, **options
    )
    width = np.sqrt(np.log1p(0.04))
    verges = [
        float(mpmath.log(verge("pgv", DURATIONS[0], 0.25 * np.exp(width * x), 4.0, 4 / 3)))
        for x in stats.norm.ppf((np.arange(64) + 0.5) / 64)
    ]
    assert float(uncertain.dispersion_of_records[0]) < 0.01
    assert float(uncertain.dispersion_of_parameters[0]) == pytest.approx(
        np.std(verges), rel=0.1
    )
