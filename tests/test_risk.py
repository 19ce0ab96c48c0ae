"""Hazard, fragility and rates of overturning: closed forms, definitions, outcomes at levels."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from references.half_sine_rates import (
    DURATIONS,
    OFTEN,
    POWER,
    closed_rate,
    hazard,
    pulses,
    verge,
)
from scipy import optimize, stats

import jaxrock as jr
from jaxrock.risk.lognormal import fit_lognormal

DOUBLE = pytest.mark.float64
SLOW = pytest.mark.thorough


def test_hazard_is_straight_in_logarithms(eps):
    hazard = jr.risk.Hazard([0.1, 1.0, 10.0], [1e-2, 1e-4, 1e-5])
    levels = jnp.asarray([0.1, 10**-0.5, 1.0, 10**0.5, 10.0])
    rates = np.array([1e-2, 1e-3, 1e-4, 10**-4.5, 1e-5])
    np.testing.assert_allclose(hazard(levels), rates, rtol=40 * eps)
    assert np.isnan(hazard(jnp.asarray([0.09, 11.0, -1.0, 0.0]))).all()
    for level, power in ((0.4, 2), (4.0, 1)):
        slope = -power * float(hazard(level)) / level
        assert float(jax.grad(hazard)(level)) == pytest.approx(slope, rel=40 * eps)
        assert float(jax.jvp(hazard, (level,), (1.0,))[1]) == pytest.approx(
            slope, rel=40 * eps
        )
    assert float(jax.grad(hazard)(20.0)) == 0
    assert str(hazard) == "hazard from 0.01 1/yr at 0.1 to 1e-05 1/yr at 10"
    hazard = jr.risk.Hazard([0.1, 10.0], [1e-2, 1e-5], "pgv", statistic="quantile-0.85")
    assert str(hazard).startswith("quantile-0.85 hazard of pgv from")
    assert jax.grad(lambda curve: curve(1.0))(hazard).statistic == "quantile-0.85"


def fit(boundaries, ends, signs=1.0, below=0, above=0):
    boundaries = np.atleast_1d(boundaries).astype(float)
    weights = np.broadcast_to(signs, boundaries.shape).astype(float)
    return fit_lognormal(boundaries, weights, float(below), float(above), np.unique(ends))


@pytest.mark.parametrize(
    ("boundaries", "below", "above"),
    [
        ([0.6, 0.9, 1.4, 1.5], 0, 0),
        ([0.6, 0.9, 1.4, 1.5], 0, 3),
        ([0.6, 0.9, 1.4, 1.5], 2, 1),
        ([0.51, 1.9], 0, 18),
        ([1.0, 1.0, 1.0], 1, 0),
    ],
)
def test_lognormal_fit_maximizes_the_likelihood(boundaries, below, above):
    """Of densities at the boundaries, and of what is not seen beyond the ends."""
    ends = (0.5, 2.0)
    found = fit(boundaries, ends, below=below, above=above)

    def compute_likelihood(parameters):
        curve = stats.norm(parameters[0], np.exp(parameters[1]))
        return (
            curve.logpdf(np.log(boundaries)).sum()
            + below * curve.logcdf(np.log(ends[0]))
            + above * curve.logsf(np.log(ends[1]))
        )

    best = optimize.minimize(
        lambda parameters: -compute_likelihood(parameters),
        [np.log(found.median) + 0.1, np.log(found.dispersion) - 0.1],
        method="Nelder-Mead",
        options={"xatol": 1e-9, "fatol": 1e-13, "maxiter": 4000, "maxfev": 4000},
    )
    assert found.median == pytest.approx(np.exp(best.x[0]), rel=1e-5)
    assert found.dispersion == pytest.approx(np.exp(best.x[1]), rel=1e-5)
    assert found.remark == ""


def test_a_fit_with_survival_windows_has_the_moments_of_the_counts():
    """Mean and variance of ln(level), by the counted probability as a distribution."""
    boundaries = [0.6, 1.1, 0.8, 0.9, 1.5]
    signs = [1, 1, 1, -1, 1]
    found = fit(boundaries, (0.5, 2.0), signs)
    x = np.linspace(np.log(0.5), np.log(2.0), 200_001)
    probability = sum(s * (x > np.log(b)) for b, s in zip(boundaries, signs, strict=True)) / 3
    mean = x[-1] - np.trapezoid(probability, x)
    variance = x[-1] ** 2 - np.trapezoid(2 * x * probability, x) - mean**2
    assert np.log(found.median) == pytest.approx(mean, abs=1e-4)
    assert found.dispersion == pytest.approx(variance**0.5, rel=1e-4)


SHAPE = (0.25, 4.0, 4 / 3)  # half-width, slenderness, inertia ratio
BLOCK = jr.Block(*SHAPE[:2])
RESTITUTION = 0.85
LEVELS = np.geomspace(0.9, 6.0, 40)


def site_of_pulses(samples, measure="pgv", levels=LEVELS, often=OFTEN, power=POWER):
    ends = np.array([0.1, 20.0])
    return jr.risk.Site(
        pulses(samples), jr.risk.Hazard(ends, often * ends**-power), measure, levels
    )


def rate_of_pulses(shape, restitution, site):
    block = jr.Block(*shape[:2], inertia_ratio=shape[2])
    return jr.risk.overturning_rate(block, restitution, site, model="linearized")


@DOUBLE
def test_rate_in_closed_form():
    answer = rate_of_pulses(SHAPE, RESTITUTION, site_of_pulses(400))
    assert float(answer.rate) == pytest.approx(float(closed_rate("pgv", *SHAPE)), rel=1e-6)


@SLOW
@DOUBLE
def test_the_fields_and_the_words_of_a_rate():
    """Every record has one boundary: three windows of the widest step may not be detected."""
    verges = np.array([float(verge("pgv", duration, *SHAPE)) for duration in DURATIONS])
    answer = rate_of_pulses(SHAPE, RESTITUTION, site_of_pulses(400))
    assert answer.boundaries is not None
    np.testing.assert_allclose(answer.boundaries.value[:, 0], verges, rtol=1e-7)
    np.testing.assert_allclose(answer.contributions, hazard(verges), rtol=1e-6)
    error = np.std(np.asarray(hazard(verges)), ddof=1) / np.sqrt(3)
    assert float(answer.standard_error) == pytest.approx(error, rel=1e-6)
    rates = np.asarray(hazard(LEVELS))
    at = np.searchsorted(LEVELS, verges)
    bound = (rates[at - 1] - rates[at]).max() + rates[-1]
    assert float(answer.not_detected) == pytest.approx(bound, rel=1e-9)
    assert bool(answer.complete)
    first, *_ = str(answer).splitlines()
    assert first.endswith("1/yr, about once in 17,000 years, 0.3 % in 50 years")


@DOUBLE
def test_a_rate_below_the_end_of_the_hazard_is_not_known():
    """No level reaches a boundary: what is known is where the hazard ends, not a rate of 0."""
    lowest = min(float(verge("pgv", duration, *SHAPE)) for duration in DURATIONS)
    levels = LEVELS[: np.searchsorted(LEVELS, lowest)]
    answer = rate_of_pulses(SHAPE, RESTITUTION, site_of_pulses(400, levels=levels))
    assert float(answer.rate) == 0
    last_rate = float(hazard(levels[-1]))
    assert float(answer.last_rate) == pytest.approx(last_rate, rel=1e-12)
    first = (
        f"overturns less often than once in {1 / last_rate:,.0f} years, where the hazard ends"
    )
    assert str(answer).splitlines()[0] == first


@DOUBLE
def test_an_incomplete_rate_names_the_record():
    """What overturns the block at the lowest level contributes the rate there, and may be more."""
    levels = LEVELS[LEVELS > 1.5]
    answer = rate_of_pulses(SHAPE, RESTITUTION, site_of_pulses(400, levels=levels))
    assert not answer.complete
    assert str(answer).endswith("incomplete: record '1' overturns it at the lowest level")
    assert float(answer.contributions[0]) == pytest.approx(float(hazard(levels[0])), rel=1e-12)
    verges = np.array([float(verge("pgv", duration, *SHAPE)) for duration in DURATIONS[1:]])
    np.testing.assert_allclose(answer.contributions[1:], hazard(verges), rtol=1e-6)


def lifted_by(suite):
    """Logarithms of the PGV with which each record lifts the block, linearized."""
    peak = np.array([np.abs(np.asarray(record.acceleration)).max() for record in suite])
    return np.log(9.81 * np.arctan(0.25) * np.asarray(suite.measure("pgv")) / peak)


@pytest.mark.thorough
@pytest.mark.float64
def test_fragility_of_pulses_is_a_staircase(eps):
    suite = pulses(200)
    levels = np.array([0.3, 0.8, 1.2, 1.5, 1.72, 2.0, 2.5])
    curves = jr.risk.fragility(BLOCK, RESTITUTION, suite, levels, model="linearized")
    assert curves.threshold.values.tolist() == ["uplift", "0.5", "1", "overturning"]
    assert curves.exceedance.dims == ("level", "threshold")
    durations = np.array(DURATIONS)
    falls = np.array([float(verge("pgv", duration, *SHAPE)) for duration in DURATIONS])
    lifted = 2 * 9.81 * np.arctan(0.25) * durations / np.pi  # at a PGA of g alpha_c
    for threshold, at in (("uplift", lifted), ("overturning", falls)):
        counts = (levels[:, None] > at).sum(axis=1)
        assert {0, 1, 2, 3} == {*counts}
        of_one = curves.sel(threshold=threshold)
        np.testing.assert_allclose(of_one.exceedance, counts / 3, rtol=eps)
        low, high = stats.beta.ppf(
            [[0.025], [0.975]], [counts, counts + 1], [4 - counts, 3 - counts]
        )
        np.testing.assert_allclose(of_one.exceedance_low, np.where(counts, low, 0), rtol=1e-9)
        np.testing.assert_allclose(
            of_one.exceedance_high, np.where(counts < 3, high, 1), rtol=1e-9
        )
        assert str(of_one.remark.values) == ""
        # Boundaries are located to 4e-3, at most half of it beside.
        measured = lifted_by(suite) if threshold == "uplift" else np.log(at)
        assert np.log(of_one.lognormal_median) == pytest.approx(measured.mean(), abs=2e-3)
        assert float(of_one.lognormal_dispersion) == pytest.approx(measured.std(), abs=2e-3)
    assert (curves.exceedance.diff("threshold") <= 0).all()


@pytest.mark.float64
def test_medians_of_located_boundaries():
    """As bisected with `respond`; an inventory has the same."""
    suite = pulses(50)[:2]
    levels = np.geomspace(2.0, 60.0, 12)
    options = {"measure": "pga", "thresholds": ["uplift", "overturning"]}
    curves = jr.risk.fragility(BLOCK, RESTITUTION, suite, levels, **options)
    assert float(curves.lognormal_median[0]) == pytest.approx(9.81 / 4, rel=2e-3)
    # Uplift is located below the levels as well, and is no guess of a curve.
    above = jr.risk.fragility(BLOCK, RESTITUTION, suite, levels[4:], **options)
    assert float(above.lognormal_median[0]) == pytest.approx(9.81 / 4, rel=2e-3)
    assert levels[4] > 9.81 / 4
    assert "outside" not in str(above.remark.values[0])
    boundaries = []
    for record, peak in zip(suite, np.asarray(suite.measure("pga")), strict=True):
        low = 9.81 / 4
        high = 60.0
        while high / low > 1 + 1e-4:
            middle = (low * high) ** 0.5
            scaled = record.scaled(middle / peak)
            overturned = jr.respond(BLOCK, RESTITUTION, scaled, 8.0).overturned
            if overturned:
                high = middle
            else:
                low = middle
        boundaries.append(np.log(low * high) / 2)
    assert np.log(curves.lognormal_median[1]) == pytest.approx(np.mean(boundaries), abs=2e-3)
    assert float(curves.lognormal_dispersion[1]) == pytest.approx(np.std(boundaries), abs=2e-3)
    site = jr.risk.Site(suite, jr.risk.Hazard([2.0, 60.0], [1e-2, 1e-5]), "pga", levels)
    block = jr.Block(*(np.array([number]) for number in SHAPE[:2]))
    inventory = jr.risk.Inventory(["vase"], block, RESTITUTION)
    assessed = jr.risk.assess_inventory(inventory, site, 1e-3)
    medians = [float(assessed.uplift_intensity[0]), float(assessed["median"][0])]
    np.testing.assert_allclose(medians, curves.lognormal_median, rtol=2e-3)


# The block in the example suite.
SIZE = (0.3, 4.0)
HAZARD = jr.risk.Hazard([0.1, 0.3, 1.0, 3.0], [2e-2, 2e-3, 1e-4, 4e-6])
ALL_LEVELS = (0.1, 3.0)


@DOUBLE
@SLOW
@pytest.mark.release
def test_rate_against_outcomes_at_many_levels():
    """At 10,000 levels of each record; what is missed is within its bound."""
    suite = jr.example_suite()
    block = jr.Block(*SIZE)
    levels = np.clip(np.geomspace(*ALL_LEVELS, 10_000), *ALL_LEVELS)
    rates = np.asarray(HAZARD(levels))
    factors = suite.factors(levels, "pgv")
    overturned = np.asarray(
        jr.respond_batch(block, 0.8, suite.scaled(factors)).overturned, float
    )
    fraction = 0.5 * (overturned[:, 1:] + overturned[:, :-1])
    by_outcomes = (fraction @ -np.diff(rates) + rates[-1] * overturned[:, -1]).mean()
    for number in (None, 100, 250):
        some = (
            None if number is None else np.clip(np.geomspace(*ALL_LEVELS, number), *ALL_LEVELS)
        )
        answer = jr.risk.overturning_rate(block, 0.8, jr.risk.Site(suite, HAZARD, levels=some))
        assert bool(answer.complete)
        change = abs(float(answer.rate) - by_outcomes)
        assert change < float(answer.not_detected) < by_outcomes / 3, number
