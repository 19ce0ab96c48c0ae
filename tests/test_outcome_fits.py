"""Populations of blocks from tests that overturned or stood.

Numbers are compared with loops in NumPy and SciPy, derivatives with differences, the search with
another one, predictions with the population that made the tests.
"""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize
from scenes import impact_times
from scipy.special import expit, logit
from scipy.stats import multivariate_normal, norm
from tools.selection import first_before_release

import jaxrock as jr
from jaxrock.calibration import Population
from jaxrock.calibration.outcomes.campaign import check_campaign, fit_parts
from jaxrock.calibration.outcomes.likelihood import average_weights
from jaxrock.calibration.outcomes.population import (
    pack_population,
    to_normal,
    unpack_population,
)
from jaxrock.calibration.outcomes.posterior import sample_posterior
from jaxrock.calibration.outcomes.prior import Prior
from jaxrock.calibration.outcomes.sample import NormalComponent, Simulator, draw_sample
from jaxrock.calibration.outcomes.search import (
    Searched,
    compute_covariance,
    compute_loss,
    search_population,
)

TESTS = 24
SAMPLES = 512
GROUPS = [f"earthquake {k % 6}" for k in range(TESTS)]
FIELDS = [field.name for field in Population.__dataclass_fields__.values()]


def make_suite(tests=TESTS, seed=0):
    """Wavelets of Ricker, which leave no drift, of many periods and strengths."""
    random = np.random.default_rng(seed)
    periods = np.exp(random.uniform(np.log(0.3), np.log(1.2), tests))
    strengths = np.exp(random.uniform(np.log(1.0), np.log(8.0), tests))
    time = np.linspace(-1.6, 1.6, 81)
    phases = (np.pi * time / periods[:, None]) ** 2
    waves = strengths[:, None] * (1 - 2 * phases) * np.exp(-phases)
    records = [jr.Record(wave, 0.04) for wave in waves]
    return jr.Suite(records, [f"test {k}" for k in range(tests)])


def make_population(**changes):
    """Correlated, with lapses and deviations of groups."""
    fields = {
        "critical_angle": 0.17,
        "frequency_parameter": 4.2,
        "restitution": 0.87,
        "deviations": [0.25, 0.12, 0.35],
        "correlations": [0.3, -0.2, 0.25],
        "lapse": 0.04,
        "group_deviation": 0.1,
        "peak_deviation": 0.3,
    } | changes
    return Population(**{name: jnp.asarray(value, float) for name, value in fields.items()})


def make_blocks(population, number, seed):
    """Draw blocks of a population by NumPy, without deviations of groups."""
    random = np.random.default_rng(seed)
    normal = random.standard_normal((number, 3))
    factor = np.linalg.cholesky(cover(population))
    coordinates = list_coordinates(population) + normal @ factor.T
    angles = np.exp(coordinates[:, 0])
    frequency_parameters = np.exp(coordinates[:, 1])
    return jr.Block.from_parameters(frequency_parameters, angles), expit(coordinates[:, 2])


def take(tree, place):
    """Take a block of many; what all have in common stays."""
    return jax.tree.map(lambda leaf: leaf[place] if np.ndim(leaf) else leaf, tree)


def list_coordinates(population):
    return np.array(
        [
            np.log(population.critical_angle),
            np.log(population.frequency_parameter),
            logit(float(population.restitution)),
        ]
    )


def cover(population):
    """The covariance of coordinates, by hand."""
    r21, r31, r32 = np.asarray(population.correlations, float)
    correlation = np.array([[1, r21, r31], [r21, 1, r32], [r31, r32, 1]])
    deviations = np.asarray(population.deviations, float)
    return correlation * deviations * deviations[:, None]


def simulate_tests(population, suite, seed=0):
    """Simulate a test under each motion, each with a block of its own; outcomes and peaks."""
    blocks = make_blocks(population, len(suite), seed)
    responses = [jr.respond_batch(*take(blocks, k), suite[k]) for k in range(len(suite))]
    overturned = np.array([bool(response.overturned) for response in responses])
    peaks = np.array([float(response.peak_rotation) for response in responses])
    return overturned, np.where(overturned, np.nan, peaks)


@functools.cache
def make_tests():
    """Suite, outcomes, and peaks: that of a block that overturned, and one unknown."""
    suite = make_suite()
    overturned, peaks = simulate_tests(make_population(), suite)
    peaks[np.flatnonzero(overturned)[0]] = 0.05
    peaks[np.flatnonzero(~overturned)[0]] = np.nan
    return suite, overturned, peaks


def fit_tests(**changes):
    suite, overturned, peaks = make_tests()
    options = {
        "overturned": overturned,
        "peak_rotations": peaks,
        "groups": GROUPS,
        "samples": SAMPLES,
    }
    return jr.fit_outcomes(suite, **(options | changes))


@functools.cache
def usual_fit():
    return fit_tests()


def arguments_of_search(fit):
    """All that its functions take beside a population."""
    prior = Prior(fit.prior_mean, fit.prior_width)
    return prior, fit.points, fit.data, fit.counts


# Weights and the likelihood


def weigh_by_hand(population, points, shift):
    """Normalized weights of the blocks for groups that deviate by a shift of ln(alpha_c)."""
    mean = list_coordinates(population)
    mean[0] += shift
    log_weights = multivariate_normal(mean, cover(population)).logpdf(points.coordinates)
    log_weights = log_weights - np.asarray(points.log_density)
    weights = np.exp(log_weights - log_weights.max())
    return weights / weights.sum()


def integrate_over_groups(compute, population, nodes):
    """Integrate over the deviation of a group: by a given number of nodes, or finely."""
    deviation = float(population.group_deviation)
    if nodes:
        places, weights = np.polynomial.hermite_e.hermegauss(nodes)
        weights = weights / weights.sum()
    else:
        places = np.linspace(-7, 7, 141)
        weights = norm.pdf(places) * 0.1
    return sum(w * compute(deviation * z) for z, w in zip(places, weights, strict=True))


def compute_likelihood_by_hand(fit, population, nodes, groups):
    """A loop over groups and tests."""
    data = jax.tree.map(lambda leaf: np.asarray(leaf), fit.data)
    lapse = float(population.lapse)
    deviation = float(population.peak_deviation)

    def of_test(k, weights):
        outcomes = data.outcomes[k]
        probability = (1 - lapse) * (outcomes @ weights) + lapse / 2
        if data.overturned[k]:
            return probability
        if np.isnan(data.log_peak[k]):
            return 1 - probability
        kernel = norm(data.log_peaks[k], deviation).pdf(data.log_peak[k])
        stand = (1 - outcomes) * weights
        return (1 - lapse) * (stand @ kernel) + lapse / 2 / np.log(1000)

    def of_group(tests, shift):
        weights = weigh_by_hand(population, fit.points, shift)
        return np.prod([of_test(k, weights) for k in tests])

    total = 0.0
    for name in sorted(set(groups)):
        tests = [k for k, group in enumerate(groups) if group == name]
        compute = functools.partial(of_group, tests)
        total += np.log(integrate_over_groups(compute, population, nodes))
    return total


@pytest.mark.thorough
@pytest.mark.float64
@pytest.mark.parametrize(("nodes", "bound"), [(5, 1e-9), (0, 0.02)])
def test_the_likelihood_is_that_of_a_loop(nodes, bound):
    """Exactly with the same quadrature, and within the error of that with a fine one."""
    fit = usual_fit()
    population = make_population(group_deviation=0.05)
    expected = compute_likelihood_by_hand(fit, population, nodes, GROUPS)
    assert float(fit.log_likelihood(population)) == pytest.approx(expected, abs=bound)


@pytest.mark.thorough
@pytest.mark.float64
@pytest.mark.parametrize(("nodes", "bound"), [(5, 1e-12), (0, 2e-3)])
def test_a_probability_is_that_of_a_loop(nodes, bound):
    fit = usual_fit()
    population = make_population(group_deviation=0.05)
    outcomes = np.asarray(fit.data.outcomes)[:TESTS]

    def compute(shift):
        return outcomes @ weigh_by_hand(population, fit.points, shift)

    lapse = float(population.lapse)
    expected = (1 - lapse) * integrate_over_groups(compute, population, nodes) + lapse / 2
    computed = fit.probability(make_tests()[0], population)
    np.testing.assert_allclose(computed, expected, atol=bound, rtol=0)


@pytest.mark.thorough
def test_a_peak_of_an_overturned_block_and_padding_count_nothing():
    """Nor does what a block of the sample does in tests that do not count."""
    fit = usual_fit()
    overturned = np.flatnonzero(np.asarray(fit.data.overturned))
    assert np.isnan(np.asarray(fit.data.log_peak)[overturned]).all()
    outcomes = fit.data.outcomes.at[TESTS:].set(1.0)
    other = eqx.tree_at(lambda f: f.data.outcomes, fit, outcomes)
    assert other.log_likelihood() == fit.log_likelihood()


def differentiate(compute, population, field, place):
    """Central differences of fourth order."""
    value = np.atleast_1d(np.asarray(getattr(population, field), float))
    step = 5e-4 * max(abs(value[place]), 0.05)

    def at(k):
        moved = value.copy()
        moved[place] += k * step
        shaped = jnp.asarray(moved.reshape(np.shape(getattr(population, field))))
        return float(compute(eqx.tree_at(lambda p: getattr(p, field), population, shaped)))

    return (8 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12 * step)


@pytest.mark.thorough
@pytest.mark.float64
@pytest.mark.parametrize("question", ["log_likelihood", "probability"])
def test_derivatives_are_those_of_differences(question):
    fit = usual_fit()
    population = make_population()
    suite = make_tests()[0]
    answers = {
        "log_likelihood": fit.log_likelihood,
        "probability": lambda population: fit.probability(suite, population).sum(),
    }
    answer = answers[question]
    # `jit` keeps a program for each function, and a method of a fit has no hash.
    compute = jax.jit(lambda population: answer(population))
    gradient = jax.grad(answer)(population)
    tangents = jax.jit(jax.jacfwd(lambda population: answer(population)))(population)
    for field in FIELDS:
        derivatives = np.atleast_1d(np.asarray(getattr(gradient, field)))
        for place, derivative in enumerate(derivatives):
            expected = differentiate(compute, population, field, place)
            scale = max(1.0, np.abs(derivatives).max())
            assert derivative == pytest.approx(expected, rel=1e-6, abs=1e-6 * scale), field
        np.testing.assert_allclose(
            getattr(tangents, field), getattr(gradient, field), rtol=1e-9, atol=1e-9
        )
    no_peaks = question == "probability"
    assert (float(gradient.peak_deviation) == 0) == no_peaks
    assert float(gradient.group_deviation) != 0
    assert float(compute(population)) == pytest.approx(float(answer(population)), rel=1e-12)


# Populations


@pytest.mark.float64
def test_a_population_is_packed_and_unpacked():
    population = make_population()
    free = pack_population(population)
    unpacked = unpack_population(jnp.asarray(free))
    for field in FIELDS:
        np.testing.assert_allclose(
            getattr(unpacked, field), getattr(population, field), rtol=1e-12
        )
    np.testing.assert_allclose(pack_population(unpacked), free, rtol=1e-12, atol=1e-14)
    random = np.random.default_rng(0)
    for free in random.normal(size=(20, 12)):
        packed = pack_population(unpack_population(jnp.asarray(free)))
        np.testing.assert_allclose(packed, free, rtol=1e-9, atol=1e-9)


@pytest.mark.float64
def test_a_population_is_normal_with_its_deviations_and_correlations():
    population = make_population()
    normal = to_normal(population)
    factor = np.asarray(normal.factor)
    np.testing.assert_allclose(normal.mean, list_coordinates(population), rtol=1e-12)
    np.testing.assert_allclose(factor @ factor.T, cover(population), rtol=1e-12)
    assert np.all(np.triu(factor, 1) == 0)


# The search


@pytest.mark.thorough
@pytest.mark.float64
def test_the_mode_is_that_of_another_search():
    fit = usual_fit()
    prior, *others = arguments_of_search(fit)

    @jax.jit
    def compute(standard):
        return jax.value_and_grad(compute_loss)(standard, prior, *others, True)

    def compute_on_host(standard):
        loss, gradient = compute(jnp.asarray(standard))
        return float(loss), np.asarray(gradient)

    mode = np.asarray((fit.free - fit.prior_mean) / fit.prior_width)
    loss, gradient = compute_on_host(mode)
    assert np.linalg.norm(gradient) <= 1.1e-3
    start = mode + np.random.default_rng(3).normal(0, 0.3, mode.size)
    best = scipy.optimize.minimize(compute_on_host, start, jac=True, method="BFGS")
    assert loss <= best.fun + 1e-3
    # Second derivatives by differences of the gradient, of fourth order.
    step = 1e-3
    rows = [
        (
            8 * (compute_on_host(mode + unit)[1] - compute_on_host(mode - unit)[1])
            - (compute_on_host(mode + 2 * unit)[1] - compute_on_host(mode - 2 * unit)[1])
        )
        / (12 * step)
        for unit in step * np.eye(mode.size)
    ]
    values, vectors = np.linalg.eigh(0.5 * (np.array(rows) + np.transpose(rows)))
    # Less than the curvature of the prior is that of the prior.
    covariance = (vectors / np.maximum(values, 1.0)) @ vectors.T
    width = np.asarray(fit.prior_width)
    searched = Searched(fit.free, jnp.asarray(loss), jnp.asarray(True), jnp.asarray(0))
    computed = compute_covariance(
        searched, prior, fit.points, fit.data, np.asarray(fit.counts), grouped=True
    )
    np.testing.assert_allclose(computed / width / width[:, None], covariance, atol=1e-3)


@pytest.mark.thorough
@pytest.mark.float64
def test_a_posterior_without_tests_is_the_prior():
    fit = usual_fit()
    prior = Prior(np.asarray(fit.prior_mean), np.asarray(fit.prior_width))
    searched = Searched(fit.prior_mean, jnp.asarray(0.0), jnp.asarray(True), jnp.asarray(0))
    covariance = np.diag(np.square(prior.width))
    posterior = sample_posterior(
        searched,
        covariance,
        prior,
        fit.points,
        fit.data,
        np.zeros(fit.counts.size),
        0,
        grouped=True,
    )
    mean = posterior.weights @ posterior.free
    error = 4 / np.sqrt(posterior.effective_draws)
    np.testing.assert_allclose((mean - prior.mean) / prior.width, 0, atol=error)
    standard = posterior.covariance / prior.width / prior.width[:, None]
    np.testing.assert_allclose(standard, np.eye(12), atol=1.5 * error)


# The sample


class StandingBlocks(Simulator):
    """Blocks that are not simulated."""

    __slots__ = ()

    def simulate(self, coordinates, suite):
        return np.zeros((len(suite), len(coordinates)), bool), None


def test_blocks_of_all_components_are_weighed_alike():
    """Two far apart and of different width, and another number of them in a second stage."""
    simulator = StandingBlocks(9.81, 4 / 3, False, jr.Nonlinear(), False)
    suite = make_tests()[0][:1]
    means = np.array([[-3.0, 1.0, 2.0], [-1.0, 0.0, 0.0]])
    factors = np.array([np.diag([0.3, 0.2, 0.4]), np.diag([0.05, 0.1, 0.1])])
    components = [
        NormalComponent(mean, factor, 0.0) for mean, factor in zip(means, factors, strict=True)
    ]
    sample = draw_sample(simulator, suite, components, 4096, 0)
    sample = draw_sample(simulator, suite, components[:1], 1024, 1, sample)
    assert len(sample.coordinates) == 5120
    assert [component.number for component in sample.components] == [2048, 2048, 1024]
    # The target has three parts in ten at the first component, and the others at the second.
    coordinates = sample.coordinates
    density = 0.3 * multivariate_normal(means[0] + 0.05, 0.04).pdf(coordinates)
    density += 0.7 * multivariate_normal(means[1] + 0.01, 0.002).pdf(coordinates)
    weights = density * np.exp(-np.asarray(sample.points.log_density, float))
    weights /= weights.sum()
    exact = 0.3 * (means[0] + 0.05) + 0.7 * (means[1] + 0.01)
    # Of independent points the error would be 0.02 of a coordinate; Sobol points have less.
    np.testing.assert_allclose(weights @ coordinates, exact, atol=0.06)
    assert weights[coordinates[:, 0] < -2].sum() == pytest.approx(0.3, abs=0.03)


def test_blocks_that_cannot_rock_do_not_count():
    simulator = StandingBlocks(9.81, 4 / 3, False, jr.Nonlinear(), False)
    component = NormalComponent(np.zeros(3), np.eye(3), 0.0)
    sample = draw_sample(simulator, make_tests()[0][:1], [component], 64, 0)
    wide = sample.coordinates[:, 0] > np.log(1.2)
    assert wide.any()
    weights = np.asarray(average_weights(make_population(), sample.points))
    assert np.all(weights[wide] == 0)
    assert np.isfinite(weights).all()


# What goes elsewhere


@pytest.mark.thorough
def test_the_uncertain_block_is_that_of_the_population():
    # Groups deviate so much that correlations have to shrink.
    population = make_population(correlations=[0.6, -0.5, 0.1], group_deviation=0.3)
    fit = eqx.tree_at(lambda fit: fit.population, usual_fit(), population)
    block = jr.Block.from_parameters(population.frequency_parameter, population.critical_angle)
    drawn = fit.uncertain.draw(block, population.restitution)
    coordinates = np.stack(
        [
            np.log(drawn.block.critical_angle),
            np.log(drawn.block.frequency_parameter),
            logit(drawn.restitution),
        ]
    )
    total = cover(population)
    total[0, 0] += float(population.group_deviation) ** 2
    deviations = np.sqrt(np.diag(total))
    medians = np.median(coordinates, axis=1)
    # 256 Sobol points: a mean is right to some hundredths of a standard deviation. The
    # restitution is mapped by a coefficient of variation, a little rounded.
    # The restitution of the population is the mean of a Beta distribution, near its median.
    np.testing.assert_allclose(
        (medians - list_coordinates(population)) / deviations, 0, atol=0.15
    )
    np.testing.assert_allclose(coordinates.std(axis=1), deviations, rtol=0.1)
    correlations = total / deviations / deviations[:, None]
    np.testing.assert_allclose(np.corrcoef(coordinates), correlations, atol=0.05)


@pytest.mark.thorough
def test_the_uncertain_block_goes_into_fragilities_and_rates():
    fit = usual_fit()
    suite = make_tests()[0][:4]
    hazard = jr.Hazard([0.1, 1.0], [1e-2, 1e-4])
    site = jr.Site(suite, hazard, levels=[0.2, 0.9])
    alone = jr.overturning_rate(fit.block, fit.restitution, site).rate
    uncertain = jr.overturning_rate(fit.block, fit.restitution, site, fit.uncertain).rate
    assert np.isfinite(float(uncertain))
    assert float(uncertain) != float(alone)
    curves = jr.fragility(
        fit.block, fit.restitution, suite, [0.1, 0.5, 2.0], uncertain=fit.uncertain
    )
    assert curves.sizes["level"] == 3


@pytest.mark.thorough
def test_a_fit_is_printed():
    fit = usual_fit()
    text = str(fit)
    assert "24 tests in 6 groups, 9 overturned" in text
    assert all(remark in text for remark in fit.remarks)
    intervals = fit.compute_intervals()
    assert intervals["critical_angle"][0] < float(fit.block.critical_angle)
    assert float(fit.block.critical_angle) < intervals["critical_angle"][1]


# Edges


EDGES = {
    "all overturned": (
        {"overturned": np.ones(TESTS, bool)},
        "all tests overturned: they bound the population from one side only",
    ),
    "none overturned": (
        {"overturned": np.zeros(TESTS, bool)},
        "no test overturned: they bound the population from one side only",
    ),
    "one group": ({"groups": ["the same"] * TESTS}, None),
    "each test its own group": ({"groups": range(TESTS)}, None),
    "no peak": ({"peak_rotations": np.full(TESTS, np.nan)}, None),
    "a peak of nothing": ({"peak_rotations": np.zeros(TESTS)}, None),
    "against a wall": ({"one_sided": True}, None),
    "linearized": ({"model": jr.Linearized()}, None),
    "prior of a block": ({"prior": jr.Block(0.1, 6.0)}, None),
    "prior of a restitution": ({"prior": {"restitution": (0.85, 0.02)}}, None),
    "prior without doubt": ({"prior": {"critical_angle": (0.17, 0.0)}}, None),
}


@pytest.mark.thorough
@pytest.mark.parametrize("edge", first_before_release(EDGES, 3))
def test_an_edge_is_fitted(edge):
    changes, remark = EDGES[edge]
    fit = fit_tests(**changes)
    assert np.isfinite(np.asarray(fit.free)).all()
    assert np.isfinite(np.asarray(fit.covariance)).all()
    assert all(low <= high for low, high in fit.compute_intervals().values())
    assert remark is None or remark in fit.remarks
    assert fit.status == jr.Status.COMPLETE
    probabilities = np.asarray(fit.probability(make_tests()[0]))
    assert np.all((probabilities > 0) & (probabilities < 1))
    assert fit.block.one_sided == changes.get("one_sided", False)
    grouped = edge not in ("one group", "each test its own group")
    assert (float(fit.population.group_deviation) > 0) == grouped


@pytest.mark.thorough
def test_a_prior_decides_what_it_knows():
    fit = fit_tests(prior={"critical_angle": (0.2, 0.0), "restitution": (0.8, 0.01)})
    assert float(fit.block.critical_angle) == pytest.approx(0.2, rel=0.01)
    assert float(fit.restitution) == pytest.approx(0.8, rel=0.03)
    other = fit_tests(prior=jr.Block.from_parameters(3.0, 0.3))
    assert float(other.block.critical_angle) > float(usual_fit().block.critical_angle)


@pytest.mark.thorough
def test_a_single_test_is_fitted():
    suite, overturned, _ = make_tests()
    fit = jr.fit_outcomes(suite[:1], overturned[:1], samples=SAMPLES)
    assert "there is one test only: most of the answer is the prior" in fit.remarks
    assert np.isfinite(np.asarray(fit.free)).all()
    assert fit.tests == fit.groups == 1


@pytest.mark.thorough
def test_a_free_rocking_test_is_a_prior():
    block = jr.Block(0.1, 5.0)
    random = np.random.default_rng(0)
    times = impact_times(block, 0.9, 0.9) + random.normal(0, 3e-3, 12)
    known = jr.fit_free_rocking(times, block, model="linearized")
    fit = fit_tests(prior=known)
    width = known.standard_errors["restitution"] / (
        known.restitution * (1 - known.restitution)
    )
    assert float(fit.prior_width[2]) == pytest.approx(float(width), rel=0.02)
    assert float(jax.nn.sigmoid(fit.prior_mean[2])) == pytest.approx(float(known.restitution))


@pytest.mark.thorough
@pytest.mark.parametrize("kind", first_before_release(["vertical", "floor"], 1))
def test_other_motions_are_fitted(kind):
    suite, overturned, _ = make_tests()
    if kind == "floor":
        suite = suite.on_floor(0.2, 0.05, [1.0], time_step=0.008)
    else:
        records = [
            jr.Record(
                record.acceleration, 0.04, vertical=0.3 * np.asarray(record.acceleration)
            )
            for record in suite.records
        ]
        suite = jr.Suite(records, suite.names)
    fit = jr.fit_outcomes(suite, overturned, groups=GROUPS, samples=SAMPLES)
    assert np.isfinite(np.asarray(fit.free)).all()
    scores = jr.calibration.cross_validate(
        suite, overturned, GROUPS, samples=SAMPLES, splits=2
    )
    assert np.isfinite(scores.brier).all()


# Scores


SPLITS = 2


@functools.cache
def usual_scores():
    suite, overturned, peaks = make_tests()
    return jr.calibration.cross_validate(
        suite, overturned, GROUPS, splits=SPLITS, samples=SAMPLES, peak_rotations=peaks, seed=5
    )


def halve_by_hand(split):
    """Which tests are fitted."""
    names = sorted(set(GROUPS))
    order = np.random.default_rng(5 + split).permutation(len(names))
    fitted = {names[k] for k in order[: len(names) // 2]}
    return np.array([name in fitted for name in GROUPS])


@pytest.mark.thorough
def test_scores_are_of_the_halves_that_are_documented():
    scores = usual_scores()
    _, overturned, _ = make_tests()
    assert scores.brier.dims == ("predictor", "split")
    for split in range(SPLITS):
        fitted = halve_by_hand(split)
        base_rate = overturned[fitted].mean()
        expected = np.mean((base_rate - overturned[~fitted]) ** 2)
        computed = float(scores.brier.sel(predictor="base rate")[split])
        assert computed == pytest.approx(expected, rel=1e-6)
    assert scores.split.values.tolist() == [5, 6]
    assert scores.group.values.tolist() == GROUPS
    np.testing.assert_array_equal(scores.overturned, overturned)
    never = np.all([halve_by_hand(split) for split in range(SPLITS)], axis=0)
    np.testing.assert_array_equal(np.isnan(scores.probability[0]), never)


def search_half(data, fitted):
    fit = usual_fit()
    counts = np.zeros(fit.counts.size)
    counts[:TESTS] = fitted
    prior = Prior(fit.prior_mean, fit.prior_width)
    return search_population(prior, fit.points, data, counts, grouped=True)


@pytest.mark.thorough
def test_nothing_of_a_held_out_test_is_fitted():
    fit = usual_fit()
    fitted = halve_by_hand(0)
    held_out = np.flatnonzero(~fitted)
    data = fit.data
    changed = data._replace(
        overturned=data.overturned.at[held_out].set(1 - data.overturned[held_out]),
        log_peak=data.log_peak.at[held_out].set(-1.0),
    )
    np.testing.assert_array_equal(
        search_half(changed, fitted).free, search_half(data, fitted).free
    )
    kept = np.flatnonzero(fitted)
    changed = data._replace(overturned=data.overturned.at[kept].set(1 - data.overturned[kept]))
    assert np.any(search_half(changed, fitted).free != search_half(data, fitted).free)


@pytest.mark.thorough
@pytest.mark.float64
def test_a_score_is_that_of_the_half_by_hand():
    """From the same sample: the population that fits a half, and a loop for its predictions."""
    suite, overturned, peaks = make_tests()
    campaign = check_campaign(
        suite, overturned, GROUPS, peaks, None, SAMPLES, 5, "nonlinear", 9.81, 4 / 3, False
    )
    halves = [halve_by_hand(split) for split in range(SPLITS)]
    fitted = fit_parts(campaign, [np.ones(TESTS, bool), *halves])
    points = fitted.sample.points
    for split, half in enumerate(halves):
        population = unpack_population(fitted.searched[split + 1].free)
        compute = functools.partial(weigh_by_hand, population, points)
        weights = integrate_over_groups(compute, population, 5)
        lapse = float(population.lapse)
        predicted = (1 - lapse) * (fitted.sample.overturned @ weights) + lapse / 2
        expected = np.mean((predicted - overturned)[~half] ** 2)
        computed = float(usual_scores().brier.sel(predictor="blocks")[split])
        assert computed == pytest.approx(expected, rel=1e-6)


@pytest.mark.thorough
def test_scores_are_written_and_read(tmp_path):
    import xarray

    scores = usual_scores()
    scores.to_netcdf(tmp_path / "scores.nc")
    with xarray.open_dataset(tmp_path / "scores.nc") as read:
        xarray.testing.assert_equal(read.load(), scores)
        assert read.attrs.keys() == scores.attrs.keys()


# Campaigns of which the truth is known


def fit_campaign(population, tests=64, exchanged=0.0):
    """Simulate a campaign, exchange some outcomes, and fit it."""
    suite = make_suite(tests, seed=1)
    overturned, _ = simulate_tests(population, suite, seed=1)
    exchanges = np.random.default_rng(2).permutation(tests) < exchanged * tests
    return jr.fit_outcomes(suite, overturned ^ exchanges, samples=1024)


@pytest.mark.thorough
def test_probabilities_of_new_motions_are_those_of_the_population():
    """The fit has 64 outcomes: at best the probability is known to some hundredths."""
    population = make_population(group_deviation=0.0, lapse=0.0)
    fit = fit_campaign(population)
    motions = make_suite(200, seed=3)
    blocks, restitutions = make_blocks(population, 4000, seed=4)
    overturned = [
        jr.respond_batch(blocks, restitutions, motion).overturned for motion in motions
    ]
    true = np.mean(overturned, axis=1)
    difference = np.abs(np.asarray(fit.probability(motions)) - true)
    assert difference.mean() < 0.06


@pytest.mark.thorough
def test_exchanged_outcomes_raise_the_lapse():
    population = make_population(group_deviation=0.0, lapse=0.0)
    honest = fit_campaign(population)
    exchanged = fit_campaign(population, exchanged=0.25)
    assert float(exchanged.population.lapse) > 1.5 * float(honest.population.lapse)


@pytest.mark.thorough
def test_different_blocks_have_a_larger_deviation():
    alike = make_population(group_deviation=0.0, deviations=[0.02, 0.02, 0.05])
    different = make_population(group_deviation=0.0, deviations=[0.6, 0.1, 0.3])
    deviations = [
        float(fit_campaign(population).population.deviations[0])
        for population in (alike, different)
    ]
    assert deviations[1] > 1.5 * deviations[0]
