"""Hazard, fragility and rates of overturning: closed forms, definitions, counting, differences."""

import jax
import jax.numpy as jnp
import jaxtyping
import mpmath
import numpy as np
import pytest
from references.half_sine_rates import DURATIONS, OFTEN, POWER, closed_rate, pulses, verge
from scipy import optimize, stats
from tools.selection import first_by_default

import jaxrock as jr
from jaxrock.risk.hazard import find_last_point
from jaxrock.risk.lognormal import fit_lognormal

DOUBLE, SLOW = pytest.mark.float64, pytest.mark.thorough
NAN = float("nan")


def refuses(message, function, *args, **kwargs):
    """Whether a call is refused with this message, in one sentence."""
    with pytest.raises(ValueError, match=message) as error:
        function(*args, **kwargs)
    return "\n" not in str(error.value)


def test_hazard_is_straight_in_logarithms(eps):
    hazard = jr.Hazard([0.1, 1.0, 10.0], [1e-2, 1e-4, 1e-5])
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
    hazard = jr.Hazard([0.1, 10.0], [1e-2, 1e-5], "pgv", statistic="quantile-0.85")
    assert str(hazard).startswith("quantile-0.85 hazard of pgv from")
    assert jax.grad(lambda curve: curve(1.0))(hazard).statistic == "quantile-0.85"


@pytest.mark.parametrize(
    ("levels", "rates", "message"),
    [
        ([1.0], [1.0], r"of at least two values, got an array of shape \(1,\)"),
        ([[1.0, 2.0]], [[2.0, 1.0]], r"levels must be one-dimensional, .* of shape \(1, 2\)"),
        ([1.0, 2.0, 3.0], [2.0, 1.0], r"rates must be as many as levels, 3, got \(2,\)"),
        ([1.0, 2.0, 2.0], [3.0, 2.0, 1.0], "levels must increase, got 2 after 2"),
        ([1.0, 2.0, 3.0], [3.0, 0.5, 1.0], "rates must not rise .* got 1 after 0.5"),
        ([1.0, 2.0, 3.0], [3.0, 0.0, 1.0], "rates must not rise .* got 1 after 0"),
        ([1.0, 2.0, 3.0], [3.0, 3.0, 3.0], "rates must fall with the level, got only 3"),
        ([1.0, 2.0, 3.0], [0.0, 0.0, 0.0], "the first two rates must be greater than 0, got"),
        ([1.0, 2.0], [3.0, -0.5], "rates must be finite and at least 0, got -0.5"),
        ([0.0, 2.0], [3.0, 2.0], "levels must be finite and greater than 0, got 0"),
        ([1.0, 2.0], [3.0, 0.0], "the first two rates must be greater than 0, got 0"),
        ([1.0, NAN], [3.0, 2.0], "levels must be finite and greater than 0, got nan"),
    ],
)
def test_curves_that_are_no_hazard(levels, rates, message):
    assert refuses(message, jr.Hazard, levels, rates)


# A curve as programs compute it: level at first, level again, and 0 at the end.
BENDS = np.array([0.5, 1.3, 1.75, 2.2, 3.0, 6.0, 8.0])
BENT = np.array([1e-2, 1e-2, 1e-3, 1e-3, 2e-5, 0.0, 0.0])


def bent_rate(level):
    """The rate at a level, by the definition of the curve, in many digits."""
    level = mpmath.mpf(level)
    at = max(0, int(np.searchsorted(BENDS, float(level))) - 1)
    low, high, often, seldom = map(mpmath.mpf, (*BENDS[at : at + 2], *BENT[at : at + 2]))
    share = mpmath.log(level / low) / mpmath.log(high / low)
    return often * (seldom / often) ** share if seldom else often * (1 - share)


def test_a_hazard_with_level_stretches_and_zeros(eps):
    """A straight line in logarithms, and over the logarithm of the level down to the first 0."""
    hazard = jr.Hazard(BENDS, BENT)
    levels = np.array([0.6, 1.5, 2.0, 2.5, 3.5, 5.9, 7.0])
    exact = [float(bent_rate(x)) for x in levels[:-1]] + [0.0]
    np.testing.assert_allclose(hazard(levels), exact, rtol=100 * eps, atol=1e-5 * eps)
    np.testing.assert_allclose(hazard(BENDS), BENT, rtol=40 * eps)
    slopes = [float(mpmath.diff(bent_rate, x)) for x in levels[:-1]] + [0.0]
    found = jax.vmap(jax.grad(hazard))(jnp.asarray(levels))
    np.testing.assert_allclose(found, slopes, rtol=300 * eps, atol=1e-30)
    # Proportional to its rates, and finite derivatives, where a rate is 0 as well.
    of_rates = jax.jacrev(lambda rates: jr.Hazard(BENDS, rates)(levels))(jnp.asarray(BENT))
    np.testing.assert_allclose(of_rates @ BENT, exact, rtol=100 * eps, atol=1e-5 * eps)
    assert np.isfinite(np.asarray(jax.vmap(jax.grad(hazard))(jnp.asarray(BENDS)))).all()
    assert str(hazard) == "hazard from 0.01 1/yr at 0.5 to 0 1/yr at 6"


def test_rates_too_small_for_normal_numbers():
    """They count as 0, in single precision sooner; interpolated they would be 1."""
    tiny = 0.1 * np.finfo(jnp.ones(()).dtype).tiny
    hazard = jr.Hazard([0.1, 1.0, 3.0, 5.0], [1e-2, 1e-4, tiny, tiny / 10])
    assert find_last_point(hazard) == 2
    assert "at 3" in str(hazard)
    assert hazard(4.0) < 1e-30
    message = "the first two rates must be greater than 0, got .* which counts as 0 in float"
    assert refuses(message, jr.Hazard, [0.1, 0.3], [tiny, tiny / 10])


@pytest.mark.parametrize(
    ("levels", "counts", "trials"),
    [
        ([0.5, 1.0, 2.0, 4.0], [1, 4, 9, 10], 10),
        ([0.5, 1.0, 2.0, 4.0], [3, 1, 6, 5], 10),
        ([1.0, 2.0, 3.0, 4.0], [0, 10, 0, 10], 10),
        ([1e-3, 1.0, 1e3], [1, 4, 9], 10),
        ([1.0, 1.001, 1.002], [10, 40, 75], 80),
        (np.geomspace(0.1, 3, 9), [0, 0, 1, 0, 2, 1, 3, 5, 4], 20),
    ],
)
def test_lognormal_fit_maximizes_the_likelihood(levels, counts, trials):
    levels, counts = np.array(levels), np.array(counts)
    fit = fit_lognormal(levels, counts, trials)
    middle, width = np.log(levels).mean(), np.log(levels).std()

    def at(parameters):
        return stats.norm.cdf(
            (np.log(levels) - middle) / width * parameters[1] - parameters[0]
        )

    found = optimize.minimize(
        lambda parameters: -stats.binom.logpmf(counts, trials, at(parameters)).sum(),
        [0.0, 1.0],
        method="Nelder-Mead",
        options={"xatol": 1e-9, "fatol": 1e-13, "maxiter": 2000, "maxfev": 2000},
    )
    np.testing.assert_allclose(fit.at(levels), at(found.x), atol=1e-6)
    assert fit.median == pytest.approx(
        np.exp(middle + found.x[0] / found.x[1] * width), rel=1e-5
    )
    assert fit.dispersion == pytest.approx(width / found.x[1], rel=1e-5)
    assert fit.remark == ""


def test_lognormal_fit_recovers_a_curve():
    levels = np.geomspace(0.2, 5, 15)
    probabilities = stats.norm.cdf(np.log(levels / 0.8) / 0.45)
    fit = fit_lognormal(levels, np.round(1e9 * probabilities).astype(int), 10**9)
    assert fit.median == pytest.approx(0.8, rel=1e-6)
    assert fit.dispersion == pytest.approx(0.45, rel=1e-6)


@pytest.mark.parametrize(
    ("counts", "expected"),
    [
        ([0, 0, 0], (NAN, NAN, "never exceeded")),
        ([5, 5, 5], (NAN, NAN, "always exceeded")),
        ([0, 5, 5], (2.0, 0.0, "from none to all between two levels")),
        ([0, 2, 5], (4.0, 0.0, "from none to all around one level")),
        ([0, 0, 3], (NAN, NAN, "the levels end where exceedance begins")),
        ([2, 2, 2], (NAN, NAN, "the probability does not increase with the level")),
        ([4, 2, 1], (NAN, NAN, "the probability does not increase with the level")),
        ([5, 5, 0], (NAN, NAN, "the probability does not increase with the level")),
    ],
)
def test_counts_without_a_curve(counts, expected):
    levels = np.array([1.0, 4.0, 9.0])
    fit = fit_lognormal(levels, np.array(counts), 5)
    np.testing.assert_allclose(fit[:2], expected[:2], rtol=1e-15)
    assert fit.remark == expected[2]
    step = [0.0, 1.0] if fit.dispersion == 0 else [NAN] * 2
    np.testing.assert_array_equal(fit.at(np.array([1.9, 9.1])), step)


SHAPE = (0.25, 4.0, 4 / 3)  # half-width, slenderness, inertia ratio
BLOCK, RESTITUTION = jr.Block(*SHAPE[:2]), 0.85
LEVELS = np.geomspace(0.9, 6.0, 40)


def rate_of_pulses(
    shape, restitution, suite, measure="pgv", levels=LEVELS, curve=(OFTEN, POWER)
):
    block = jr.Block(*shape[:2], inertia_ratio=shape[2])
    arguments = (
        block,
        restitution,
        suite,
        lambda x: curve[0] * x ** -curve[1],
        measure,
        levels,
    )
    return jr.overturning_rate(*arguments, model="linearized")


@DOUBLE
def test_rate_in_closed_form():
    found = rate_of_pulses(SHAPE, RESTITUTION, pulses(400))
    assert float(found.rate) == pytest.approx(float(closed_rate("pgv", *SHAPE)), rel=1e-6)


@DOUBLE
@SLOW
def test_derivatives_of_a_rate_in_closed_form():
    suite, numbers = pulses(400), (*SHAPE, OFTEN, POWER, RESTITUTION)

    def rate(*at):
        return rate_of_pulses(at[:3], at[5], suite, curve=at[3:5]).rate

    def exact(*at):
        return closed_rate("pgv", *at[:3], often=at[3], power=at[4])

    value, reverse = jax.value_and_grad(rate, range(6))(*numbers)
    assert float(value) == pytest.approx(float(exact(*SHAPE, OFTEN, POWER)), rel=1e-6)
    expected = [
        float(mpmath.diff(exact, numbers[:5], tuple(int(k == of) for k in range(5))))
        for of in range(5)
    ]
    np.testing.assert_allclose(reverse[:5], expected, rtol=1e-6)
    assert abs(float(reverse[5])) < 1e-12 * float(value)  # no impact comes before
    forward = jax.jvp(rate, numbers, (*SHAPE, 0.0, 0.0, 0.0))[1]
    assert float(forward) == pytest.approx(np.dot(expected[:3], SHAPE), rel=1e-6)


@DOUBLE
def test_the_verge_is_that_of_a_pulse():
    """Without records: the critical amplitude of a half-sine."""
    found = jr.critical_amplitude(
        BLOCK, RESTITUTION, jr.HalfSine, np.array(DURATIONS), model="linearized"
    )
    expected = [float(verge("pga", duration, *SHAPE)) for duration in DURATIONS]
    np.testing.assert_allclose(found.value[:, 0], expected, rtol=1e-10)
    np.testing.assert_array_equal(found.impacts[:, 0], 0)


@pytest.mark.thorough
@DOUBLE
def test_rate_converges_with_the_samples():
    """In levels of PGV what straight lines take from pulse and velocity cancels, not of PGA."""
    expected, levels = float(closed_rate("pga", *SHAPE)), np.geomspace(2.5, 9.0, 40)
    coarse, fine = (
        float(rate_of_pulses(SHAPE, RESTITUTION, pulses(n), "pga", levels).rate) - expected
        for n in (100, 200)
    )
    assert 3.5 < coarse / fine < 4.5
    assert abs(fine) < 1e-3 * expected


@DOUBLE
@pytest.mark.thorough
def test_a_rate_is_proportional_to_the_hazard():
    """Also to the rates of a curve, since it is straight in logarithms; and under `jit`."""
    levels, rates = np.array([0.9, 2.0, 6.0]), np.array([1e-2, 1e-3, 1e-4])
    suite = pulses(100)

    def rate(rates, restitution=RESTITUTION):
        options = {"levels": LEVELS[:30], "model": "linearized"}
        return jr.overturning_rate(
            BLOCK, restitution, suite, jr.Hazard(levels, rates), **options
        ).rate

    value, slopes = jax.value_and_grad(rate)(rates)
    assert float(slopes @ rates) == pytest.approx(float(value), rel=1e-12)
    compiled = jax.jit(lambda c: rate(rates, c))(RESTITUTION)
    assert float(compiled) == pytest.approx(float(value), rel=1e-9)


@pytest.mark.thorough
@DOUBLE
def test_what_a_rate_cannot_see():
    """Nothing between two levels, and under `jit` no more boundaries than are listed."""
    suite = pulses(100)

    def rate(restitution, levels):
        return rate_of_pulses(SHAPE, restitution, suite, levels=levels)

    assert rate(RESTITUTION, [0.1, 0.2]).unseen >= OFTEN * 0.1**-POWER * (1 - 1e-15)
    pulse = np.sin(np.linspace(0, 2 * np.pi, 400))
    suite, ends = jr.Suite([jr.Record(pulse, 0.5 / 400)]), np.linspace(0.3, 1.5, 41)
    slim = jr.Block(0.1, 5.0)

    def of_sine(c, listed):
        options = {"levels": ends, "max_boundaries": listed}
        return jr.overturning_rate(slim, c, suite, lambda x: OFTEN * x**-POWER, **options)

    assert of_sine(0.9, 1).boundaries.count[0] == 3
    assert of_sine(0.9, 1).complete
    cut = jax.jit(lambda c: of_sine(c, 1))(0.9)
    assert not cut.complete
    with pytest.raises(ValueError, match="must fall with the level"):
        jr.overturning_rate(slim, 0.9, suite, lambda x: x, levels=ends)


@pytest.mark.thorough
@DOUBLE
def test_elasticities_at_the_point_and_over_a_change():
    """Where no window is narrow the two agree, up to what is counted between levels."""
    fine = np.geomspace(0.9, 6.0, 4000)
    found = jr.risk.rate_elasticities(
        BLOCK,
        RESTITUTION,
        pulses(100),
        lambda x: OFTEN * x**-POWER,
        levels=fine,
        model="linearized",
    )
    assert found.names == (
        "half_width",
        "slenderness",
        "gravity",
        "inertia_ratio",
        "restitution",
    )
    exact = float(closed_rate("pgv", *SHAPE))
    for name, k in (("half_width", 0), ("slenderness", 1), ("inertia_ratio", 2)):
        ends = [
            float(
                closed_rate(
                    "pgv", *(x * (1 + s * 0.05 * (k == j)) for j, x in enumerate(SHAPE))
                )
            )
            for s in (-1, 1)
        ]
        place = found.names.index(name)
        over = (ends[1] - ends[0]) / 0.1 / exact
        assert float(found.differences[place]) == pytest.approx(over, abs=0.01)
        assert float(found.slopes[place]) == pytest.approx(over, rel=0.02)
    assert float(found.differences[-1]) == 0
    assert str(found).splitlines()[1].split() == ["over", "+-5%", "at", "the", "point"]
    with pytest.raises(ValueError, match=r"greater than 0 and less than 0\.5, got 1"):
        jr.risk.rate_elasticities(BLOCK, RESTITUTION, pulses(100), SITE, change=1.0)


@pytest.mark.thorough
def test_elasticities_by_sides():
    """The chain rule, in both precisions; of two objects each has its own."""
    options = {"levels": LEVELS[::4], "model": "linearized"}
    blocks = jr.Block(np.array([0.25, 0.3]), np.array([4.0, 3.5]))
    arguments = (blocks, RESTITUTION, pulses(50), lambda x: OFTEN * x**-POWER)
    shape = jr.risk.rate_elasticities(*arguments, **options)
    sides = jr.risk.rate_elasticities(*arguments, sides=True, **options)
    assert sides.names[:2] == ("width", "height")
    assert sides.slopes.shape == sides.differences.shape == (5, 2)
    # ln b = ln w - ln 2 and ln lambda = ln h - ln w.
    np.testing.assert_allclose(sides.slopes[0], shape.slopes[0] - shape.slopes[1], rtol=1e-3)
    np.testing.assert_allclose(sides.slopes[1], shape.slopes[1], rtol=1e-3)


@DOUBLE
@pytest.mark.parametrize("change", first_by_default([0.005, 0.02, 0.05]))
def test_elasticities_do_not_depend_on_the_levels(change):
    """Levels 5 % apart and a change of less: what is between two levels counts."""
    found = jr.risk.rate_elasticities(
        BLOCK,
        RESTITUTION,
        pulses(100),
        lambda x: OFTEN * x**-POWER,
        levels=np.geomspace(0.9, 6.0, 40),
        change=change,
        model="linearized",
    )
    exact = float(closed_rate("pgv", *SHAPE))
    for name, k in (("half_width", 0), ("slenderness", 1)):
        ends = [
            float(
                closed_rate(
                    "pgv", *(x * (1 + s * change * (k == j)) for j, x in enumerate(SHAPE))
                )
            )
            for s in (-1, 1)
        ]
        over = (ends[1] - ends[0]) / (2 * change) / exact
        place = found.names.index(name)
        assert float(found.differences[place]) == pytest.approx(over, rel=0.03)


@pytest.mark.thorough
@DOUBLE
def test_what_a_rate_says():
    """Every record has one boundary: what is unseen is as much as three mean steps of one."""
    verges = np.array([float(verge("pgv", duration, *SHAPE)) for duration in DURATIONS])
    found = rate_of_pulses(SHAPE, RESTITUTION, pulses(400))
    np.testing.assert_allclose(found.boundaries.value[:, 0], verges, rtol=1e-7)
    np.testing.assert_allclose(found.contributions, OFTEN * verges**-POWER, rtol=1e-6)
    error = np.std(OFTEN * verges**-POWER, ddof=1) / np.sqrt(3)
    assert float(found.standard_error) == pytest.approx(error, rel=1e-6)
    at, rates = np.searchsorted(LEVELS, verges), OFTEN * LEVELS**-POWER
    unseen = (rates[at - 1] - rates[at]).mean() + rates[-1]
    assert float(found.unseen) == pytest.approx(unseen, rel=1e-9)
    assert bool(found.complete)
    assert str(found) == (
        f"overturns at a rate of {float(closed_rate('pgv', *SHAPE)):.6g} 1/yr,"
        " about once in 17,000 years\n"
        f"standard error {error:.6g} 1/yr from 3 records, up to {unseen:.6g} 1/yr unseen"
        " between 3 boundaries"
    )
    late = rate_of_pulses(SHAPE, RESTITUTION, pulses(400), levels=LEVELS[LEVELS > 1.5])
    assert not late.complete
    assert str(late).endswith("\na record overturns it at the lowest level: may be more")
    np.testing.assert_allclose(late.contributions[1:], found.contributions[1:], rtol=1e-9)
    assert float(late.contributions[0]) == pytest.approx(rates[LEVELS > 1.5][0], rel=1e-12)
    ends = np.array([LEVELS[0], LEVELS[-1]])
    hazard = jr.Hazard(ends, OFTEN * ends**-POWER)
    for levels in (None, LEVELS):
        options = {"levels": levels, "model": "linearized"}
        of_curve = jr.overturning_rate(BLOCK, RESTITUTION, pulses(400), hazard, **options)
        np.testing.assert_allclose(of_curve.contributions, found.contributions, rtol=1e-9)


@DOUBLE
@pytest.mark.thorough
@pytest.mark.parametrize("move", [1.0, 2.4, 4.0])
def test_rate_under_a_hazard_with_zeros(move):
    """Summed over boundaries, counted, and differentiated: verges in all parts of the curve."""
    hazard = jr.Hazard(BENDS * move / 2, BENT)

    def rate(b, curve=hazard, **options):
        options = {"model": "linearized", **options}
        return jr.overturning_rate(
            jr.Block(b, SHAPE[1]), RESTITUTION, pulses(400), curve, **options
        )

    verges = [verge("pgv", d, *SHAPE) * 2 / move for d in DURATIONS]
    exact = [float(bent_rate(x)) if x < BENDS[-2] else 0.0 for x in verges]
    found = rate(SHAPE[0])
    np.testing.assert_allclose(found.contributions, exact, rtol=1e-5, atol=1e-12)
    assert bool(found.complete)

    def exact_rate(b):
        levels = [verge("pgv", d, b, *SHAPE[1:]) * 2 / move for d in DURATIONS]
        return sum(bent_rate(x) for x in levels if x < BENDS[-2]) / 3

    slope = float(jax.grad(lambda b: rate(b).rate)(SHAPE[0]))
    assert slope == pytest.approx(float(mpmath.diff(exact_rate, SHAPE[0])), rel=1e-4)
    # A function of the user's, with more levels than there is hazard.
    places = np.geomspace(BENDS[0], BENDS[-1], 300)[1:-1] * move / 2
    plain = rate(SHAPE[0], lambda level: hazard(level), levels=places)
    np.testing.assert_allclose(plain.contributions, exact, rtol=1e-5, atol=1e-12)
    counted = rate(SHAPE[0], scatter={"restitution": 1e-9}, samples=2)
    error = float(counted.counting_error) + 1e-12
    assert abs(float(counted.rate) - np.mean(exact)) < 3 * error < 3e-4
    assert float(found.unseen) >= 0 <= float(counted.unseen)


@pytest.mark.thorough
def test_fragility_of_pulses_is_a_staircase(eps):
    suite, levels = pulses(200), np.array([0.3, 0.8, 1.2, 1.5, 1.72, 2.0, 2.5])
    curves = jr.fragility(
        BLOCK, RESTITUTION, suite, levels, confidence=0.9, model="linearized", tolerance=1e-2
    )
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
            [[0.05], [0.95]], [counts, counts + 1], [4 - counts, 3 - counts]
        )
        np.testing.assert_allclose(of_one.exceedance_low, np.where(counts, low, 0), rtol=1e-9)
        np.testing.assert_allclose(
            of_one.exceedance_high, np.where(counts < 3, high, 1), rtol=1e-9
        )
        assert str(of_one.remark.values) == ""
        fit = fit_lognormal(curves.level.values, counts, 3)
        assert (float(of_one.lognormal_median), float(of_one.lognormal_dispersion)) == fit[:2]
    assert (curves.exceedance.diff("threshold") <= 0).all()
    np.testing.assert_allclose(curves.factor, suite.factors(levels, "pgv"), rtol=4 * eps)


def test_a_remark_says_where_exceedance_decreases():
    """Between 1.20 and 1.26 m/s this pulse of a full sine does not overturn the block."""
    pulse, block = jr.Record(np.sin(np.linspace(0, 2 * np.pi, 101)), 0.005), jr.Block(0.1, 5.0)
    options = {"model": "linearized", "thresholds": ["overturning"]}
    curves = jr.fragility(block, 0.9, jr.Suite([pulse] * 2), [0.3, 0.8, 1.23, 1.6], **options)
    np.testing.assert_array_equal(curves.exceedance[:, 0], [0, 1, 0, 1])
    assert str(curves.remark.values[0]).endswith(
        "at 1 level fewer records exceed it than at the one below"
    )


STILL = jr.Suite([jr.Record(np.zeros(3), 0.1)])
STRETCHED = pulses(4).scaled(np.ones((3, 2)))
TABLE = jr.Block(np.full((2, 3), 0.2), 4.0)
OF_BOTH = [
    ({"suite": pulses(4)[0]}, "suite must be a Suite, got a Record"),
    ({"suite": STILL}, "must have a pgv greater than 0 to be scaled, got 0 for '1'"),
    ({"suite": STRETCHED}, "scales of records must be single ones"),
    ({"block": TABLE}, "block and restitution must be single ones or have one axis"),
    ({"restitution": np.ones((2, 2))}, "must be single ones or have one axis"),
    ({"restitution": 1.5}, "restitution must be between 0 and 1, got 1.5"),
    ({"measure": "pgd"}, "measure must be one of .* got 'pgd'"),
    ({"levels": [0.0, 2.0]}, "levels must be finite and greater than 0, got 0"),
    ({"levels": [2.0, 1.0]}, r"levels must .*increas"),
]
OF_FRAGILITY = [
    (
        {"uncertain": jr.Uncertain({"mass": 0.1})},
        "coefficients_of_variation has 'mass'",
    ),
    (
        {"uncertain": jr.Uncertain({"width": 0.1, "slenderness": 0.1})},
        "coefficients_of_.*width.*slenderness",
    ),
    ({"uncertain": {"restitution": 0.1}}, "uncertain must be an? Uncertain, got"),
    ({"levels": [0.5, 0.8, 0.5]}, "levels must increase, got 0.5 after 0.8"),
    ({"levels": 1.0}, "levels must be one-dimensional"),
    ({"thresholds": ["topple"]}, "ratios, 'uplift' or 'overturning', got 'topple'"),
    ({"thresholds": [0.0]}, "thresholds must be finite and greater than 0, got 0"),
    ({"thresholds": [1, "uplift", 1.0]}, "each only once, got 1, uplift, 1$"),
    ({"thresholds": []}, "thresholds must be at least one, each only once, got none"),
    ({"thresholds": 0.5}, "thresholds must be a list of them, got 0.5"),
    ({"confidence": "a"}, "confidence must be a number between 0 and 1, got 'a'"),
    ({"confidence": 1.0}, "confidence must be a number between 0 and 1, got 1.0"),
]
OF_RATES = [
    (
        {"scatter": {"mass": 0.1}},
        "coefficients_of_variation has 'mass'",
    ),
    (
        {"scatter": {"width": 0.1, "slenderness": 0.1}},
        "coefficients_of_.*width.*slenderness",
    ),
    ({"scatter": {"restitution": 0.1}, "samples": 3}, "samples must be a power of 2, got 3"),
    ({"measure": "pgv_ratio"}, "measure must be one of pga, pgv, got 'pgv_ratio'"),
    ({"hazard": 0.01}, "hazard must be a Hazard or a function, got 0.01"),
    (
        {"hazard": jr.Hazard([0.5, 5.0], [1e-2, 1e-4], "pga")},
        "measure is 'pgv', but the hazard is one of pga",
    ),
    (
        {"hazard": np.exp, "levels": None},
        "levels must be given, since the hazard is a function",
    ),
    ({"hazard": lambda x: 0 * x}, "must be greater than 0 at the first level, got 0"),
    ({"hazard": lambda x: 1 - x}, "the rates of the hazard must be finite and at least 0"),
    ({"hazard": lambda x: 0.1 + 1e-5 * x}, "the rates of the hazard must fall with the level"),
    ({"levels": [2.0]}, r"of at least two values, got an array of shape \(1,\)"),
    ({"levels": [0.4, 4.0]}, "inside of those of the hazard, 0.5 to 5, got 0.4 to 4"),
    ({"max_boundaries": 0}, "max_boundaries must be at least 1, got 0"),
]


@pytest.mark.parametrize(
    ("function", "change", "message"),
    [(jr.fragility, *row) for row in OF_BOTH + OF_FRAGILITY]
    + [(jr.overturning_rate, *row) for row in OF_BOTH + OF_RATES],
)
def test_what_is_refused(monkeypatch, function, change, message):
    """Also where types are not checked, as for those who use the library."""
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    arguments = {
        "block": BLOCK,
        "restitution": 0.8,
        "suite": pulses(4),
        "levels": [1.0, 2.0, 3.0],
    }
    if function is jr.overturning_rate:
        arguments["hazard"] = jr.Hazard([0.5, 5.0], [1e-2, 1e-4], "pgv")
    arguments |= {"model": "linearized"} | change
    assert refuses(message, function, arguments.pop("block"), **arguments)


# The block in the example suite.
SIZE, SITE = (0.3, 4.0), jr.Hazard([0.1, 0.3, 1.0, 3.0], [2e-2, 2e-3, 1e-4, 4e-6])
ALL_LEVELS = (0.1, 3.0)


@pytest.mark.thorough
@DOUBLE
def test_rate_of_recorded_motions():
    """A wider and a less slender block overturns more seldom."""
    suite = jr.example_suite()[18:]

    def rate(block, restitution):
        return jr.overturning_rate(block, restitution, suite, SITE).rate

    value, slopes = jax.value_and_grad(rate, (0, 1))(jr.Block(*SIZE), 0.8)
    assert 0 < float(value) < 1e-4
    assert all(np.isfinite(slope) for slope in jax.tree.leaves(slopes))
    assert float(slopes[0].half_width) < 0 < float(slopes[0].slenderness)


@DOUBLE
@SLOW
@pytest.mark.release
def test_rate_against_counting():
    """Outcomes at 10,000 levels of each record; what is missed is within its bound."""
    suite, block = jr.example_suite(), jr.Block(*SIZE)
    levels = np.clip(np.geomspace(*ALL_LEVELS, 10_000), *ALL_LEVELS)
    rates, factors = np.asarray(SITE(levels)), suite.factors(levels, "pgv")
    overturned = np.asarray(
        jr.respond_batch(block, 0.8, suite.scaled(factors)).overturned, float
    )
    share = 0.5 * (overturned[:, 1:] + overturned[:, :-1])
    counted = (share @ -np.diff(rates) + rates[-1] * overturned[:, -1]).mean()
    for number in (None, 100, 250):
        some = (
            None if number is None else np.clip(np.geomspace(*ALL_LEVELS, number), *ALL_LEVELS)
        )
        found = jr.overturning_rate(block, 0.8, suite, SITE, levels=some)
        assert bool(found.complete)
        assert abs(float(found.rate) - counted) < float(found.unseen) < counted / 3, number


@DOUBLE
@SLOW
@pytest.mark.parametrize(
    "which",
    [
        pytest.param(0, id="half_width", marks=pytest.mark.release),
        pytest.param(1, id="restitution"),
    ],
)
def test_slopes_of_boundaries_under_records(which):
    """Against differences of boundaries sought again, where the slopes say that they are.

    Some boundaries have others nearby or bend sharply: several steps, of which the best counts
    of those that two in a row agree on. Beside some the true boundary jumps by 1e-9 when C
    does, as an integration in 80 bits says: of these no difference is one.
    """
    suite, at = jr.example_suite(), (SIZE[0], 0.8)
    suite = suite.scaled(1 / suite.measure("pgv"))
    levels = np.clip(np.geomspace(*ALL_LEVELS, 342), *ALL_LEVELS)
    errors, unknown = [], 0
    for number in (2, 7, 8, 14):

        def edges(half_width, restitution, levels=levels, record=suite[number]):
            block = jr.Block(half_width, SIZE[1])
            found = jr.overturning_boundaries(block, restitution, record, "factor", levels)
            return found.value, found.count

        direction = tuple(float(k == which) for k in range(2))
        (edge, _), (slope, _) = jax.jvp(edges, at, direction)
        edge, slope = np.asarray(edge), np.asarray(slope)
        known = np.isfinite(slope)
        unknown += (~known).sum()
        best, last = np.full(edge.size, np.inf), np.full(edge.size, np.nan)
        for step in np.geomspace(1e-6, 1e-10, 9):
            both = np.array([[step], [-step]])
            moved = [np.full((2, edge.size), value) for value in at]
            moved[which] = moved[which] + both
            change = both * np.where(known, slope, 1)
            width = 0.5 * abs(change) + 1e-13
            sides = np.linspace(edge + change - width, edge + change + width, 5, axis=-1)
            value, count = edges(*moved, sides)
            alone = (np.asarray(count) == 1).all(axis=0) & known
            if alone.any():
                difference = np.diff(np.asarray(value[..., 0])[::-1], axis=0)[0] / (2 * step)
                scale = np.maximum(abs(difference), 1e-2 * edge / at[which])
                error = abs(difference - slope) / scale
                agree = alone & (abs(difference - last) <= 1e-3 * scale)
                best = np.where(agree, np.fmin(best, error), best)
                last = np.where(alone, difference, np.nan)
        errors.append(best)
    errors = np.concatenate(errors)
    compared = np.isfinite(errors)
    assert compared.mean() >= 0.8
    assert unknown == 0
    np.testing.assert_array_less(errors[compared], 1e-5)
