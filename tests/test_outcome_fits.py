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
from scipy.special import expit, logit
from scipy.stats import multivariate_normal, norm
from tools.selection import first_before_release

import jaxrock as jr
from jaxrock.calibration import check_campaign
from jaxrock.calibration.outcomes import campaign, likelihood, posterior
from jaxrock.calibration.outcomes.population import NAMES, Population

TESTS = 24
SAMPLES = 512
SPLITS = 2
SLOW = pytest.mark.thorough
DOUBLE = pytest.mark.float64
GROUPS = [f"earthquake {k % 6}" for k in range(TESTS)]
TRUE = {
    "critical_angle": 0.17,
    "frequency_parameter": 4.2,
    "restitution": 0.87,
    "critical_angle_deviation": 0.25,
    "frequency_parameter_deviation": 0.12,
    "restitution_deviation": 0.35,
    "correlation_critical_angle_frequency_parameter": 0.3,
    "correlation_critical_angle_restitution": -0.2,
    "correlation_frequency_parameter_restitution": 0.25,
    "lapse": 0.04,
    "group_deviation": 0.05,
}


def describe_population(**changes):
    """Correlated, with lapses and deviations of groups."""
    return Population(**{k: jnp.asarray(v, float) for k, v in (TRUE | changes).items()})


def list_coordinates(population):
    medians = [float(getattr(population, name)) for name in NAMES]
    return np.array([*np.log(medians[:2]), logit(medians[2])])


def cover(population):
    """The covariance of coordinates, by hand."""
    r21, r31, r32 = (float(v) for k, v in vars(population).items() if k[:11] == "correlation")
    correlation = np.array([[1, r21, r31], [r21, 1, r32], [r31, r32, 1]])
    deviations = np.array([float(getattr(population, f"{name}_deviation")) for name in NAMES])
    return correlation * deviations * deviations[:, None]


def make_blocks(population, number, seed):
    """Draw blocks of a population by NumPy, without deviations of groups."""
    random = np.random.default_rng(seed)
    draws = random.multivariate_normal(list_coordinates(population), cover(population), number)
    angles, frequencies = np.exp(draws[:, 0]), np.exp(draws[:, 1])
    return jr.Block.from_parameters(frequencies, angles), expit(draws[:, 2])


def make_suite(tests=TESTS, seed=0):
    """Wavelets of Ricker, which leave no drift, of many periods and strengths."""
    random = np.random.default_rng(seed)
    periods = np.exp(random.uniform(np.log(0.3), np.log(1.2), tests))
    strengths = np.exp(random.uniform(np.log(1.0), np.log(8.0), tests))
    phases = (np.pi * np.linspace(-1.6, 1.6, 81) / periods[:, None]) ** 2
    waves = strengths[:, None] * (1 - 2 * phases) * np.exp(-phases)
    return jr.Suite([jr.Record(wave, 0.04) for wave in waves])


@functools.cache
def make_tests(tests=TESTS, seed=0, **changes):
    """A test under each motion, each with a block of its own."""
    suite = make_suite(tests, seed)
    blocks = make_blocks(describe_population(**changes), tests, seed)
    return suite, np.diagonal(jr.respond_batch(*blocks, suite).overturned)


def fit_tests(**changes):
    suite, overturned = make_tests()
    options = {"overturned": overturned, "groups": GROUPS, "samples": SAMPLES}
    return jr.calibration.fit_outcomes(suite, **(options | changes))


def halve_by_hand(split):
    """Which tests are fitted."""
    names = sorted(set(GROUPS))
    order = np.random.default_rng(5 + split).permutation(len(names))
    fitted = {names[k] for k in order[: len(names) // 2]}
    return np.array([name in fitted for name in GROUPS])


@functools.cache
def usual_fit():
    """The whole, and the halves of two splits."""
    checked = check_campaign(*make_tests(), GROUPS, samples=SAMPLES, seed=5)
    halves = [halve_by_hand(split) for split in range(SPLITS)]
    return checked, campaign.fit_parts(checked, [np.ones(TESTS, bool), *halves])


def count(part=None):
    """Counts of tests, all by default, padded."""
    return usual_fit()[0].pad(np.ones(TESTS) if part is None else part.astype(float))


# The likelihood


def make_evidence():
    """Blocks that are not simulated: a plane in their coordinates bounds those that overturn."""
    random = np.random.default_rng(1)
    wide = multivariate_normal(list_coordinates(describe_population()), 0.2 * np.eye(3))
    coordinates = wide.rvs(256, random_state=random)
    limits = random.normal(size=TESTS)[:, None]
    outcomes = ((coordinates - wide.mean) @ [2.0, 1.0, -1.0] > limits).astype(float)
    nodes, weights = np.polynomial.hermite_e.hermegauss(5)
    arrays = coordinates, wide.logpdf(coordinates), nodes, weights / weights.sum()
    overturned = (random.random(TESTS) < 0.5).astype(float)
    data = outcomes, overturned, np.arange(TESTS) % 6
    return likelihood.Points(*map(jnp.asarray, arrays)), likelihood.TestData(
        *map(jnp.asarray, data)
    )


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
    shifts = np.linspace(-7, 7, 141)
    weights = norm.pdf(shifts) * 0.1
    if nodes:
        shifts, weights = np.polynomial.hermite_e.hermegauss(nodes)
        weights = weights / weights.sum()
    shifts = float(population.group_deviation) * shifts
    return sum(w * compute(shift) for shift, w in zip(shifts, weights, strict=True))


@DOUBLE
@pytest.mark.parametrize(("nodes", "bound"), [(5, 1e-9), (0, 0.02)])
def test_the_likelihood_is_that_of_a_loop(nodes, bound):
    """Exactly with the same quadrature, and within the error of that with a fine one."""
    points, data = make_evidence()
    population = describe_population()
    lapse = float(population.lapse)
    outcomes, overturned, groups = map(np.asarray, data)
    counts = np.arange(TESTS) % 5 > 0

    def multiply(tests, shift):
        weights = weigh_by_hand(population, points, shift)
        probability = (1 - lapse) * (outcomes[tests] @ weights) + lapse / 2
        return np.prod(np.where(overturned[tests] > 0, probability, 1 - probability))

    expected = 0.0
    for group in range(6):
        compute = functools.partial(multiply, counts & (groups == group))
        expected += np.log(integrate_over_groups(compute, population, nodes))
    counted = jnp.asarray(counts, float)
    computed = likelihood.compute_log_likelihood(population, points, data, counted)
    assert float(computed) == pytest.approx(expected, abs=bound)


@DOUBLE
def test_derivatives_are_those_of_differences():
    points, data = make_evidence()

    def compute(population):
        counts = jnp.ones(TESTS)
        total = likelihood.compute_log_likelihood(population, points, data, counts)
        probability = likelihood.compute_probability(population, points, data.outcomes)
        return jnp.stack([total, probability.sum()])

    population = describe_population()
    compiled = jax.jit(compute)
    gradient = jax.jit(jax.jacrev(compute))(population)
    for name, value in vars(population).items():
        step = 5e-4 * max(abs(float(value)), 0.05)
        at = [
            compiled(eqx.tree_at(lambda p: getattr(p, name), population, value + k * step))  # noqa: B023
            for k in (-2, -1, 1, 2)
        ]
        expected = (8 * (at[2] - at[1]) - (at[3] - at[0])) / (12 * step)
        np.testing.assert_allclose(getattr(gradient, name), expected, rtol=1e-6, atol=1e-5)
    assert float(gradient.group_deviation[0]) != 0


# The posterior


@SLOW
@DOUBLE
def test_the_mode_is_that_of_another_search():
    fitted = usual_fit()[1]

    def compute(standard):
        return posterior.differentiate(standard, fitted.evidence, count())

    mode = fitted.modes[0]
    loss, gradient = compute(mode.standard)
    assert np.linalg.norm(gradient) <= 1e-2
    start = mode.standard + np.random.default_rng(3).normal(0, 0.3, mode.standard.size)
    best = scipy.optimize.minimize(compute, start, jac=True, method="L-BFGS-B")
    assert loss <= best.fun + 1e-3
    # Second derivatives by JAX, which differ where the likelihood is rough.
    arguments = jnp.asarray(mode.standard), fitted.evidence, jnp.asarray(count())
    values, vectors = np.linalg.eigh(jax.hessian(posterior.compute_loss)(*arguments))
    # Less than the curvature of the prior is that of the prior.
    covariance = (vectors / np.maximum(values, 1.0)) @ vectors.T
    computed = posterior.compute_covariance(mode, fitted.evidence, count())
    np.testing.assert_allclose(computed, covariance, atol=0.03)


@SLOW
def test_a_posterior_without_tests_is_the_prior():
    mode = posterior.Mode(np.zeros(11), jr.Status.COMPLETE)
    arguments = (mode, np.eye(11), usual_fit()[1].evidence, 0 * count(), 0)
    drawn = posterior.sample_posterior(*arguments)
    error = 4 * np.sqrt(np.sum(drawn.weights**2))
    np.testing.assert_allclose(drawn.weights @ drawn.standard, 0, atol=error)
    np.testing.assert_allclose(drawn.variances, 1, atol=1.5 * error)


@SLOW
def test_the_uncertain_block_is_that_of_the_population():
    # Groups deviate so much that correlations have to shrink.
    population = describe_population(
        correlation_critical_angle_frequency_parameter=0.6,
        correlation_critical_angle_restitution=-0.5,
        correlation_frequency_parameter_restitution=0.1,
        group_deviation=0.3,
    )
    fit = eqx.tree_at(lambda fit: fit.population, fit_tests(), population)
    drawn = fit.uncertain.draw(fit.block, fit.restitution)
    total = cover(population)
    total[0, 0] += float(population.group_deviation) ** 2
    coordinates = np.log([drawn.block.critical_angle, drawn.block.frequency_parameter])
    # 256 Sobol points: a mean is right to some hundredths of a standard deviation.
    deviations = np.sqrt(np.diag(total))
    standard = (coordinates.T - list_coordinates(population)[:2]) / deviations[:2]
    np.testing.assert_allclose(standard.mean(axis=0), 0, atol=0.05)
    np.testing.assert_allclose(standard.std(axis=0), 1, atol=0.05)
    # The restitution has another distribution there, of the same deviation.
    normal = np.random.default_rng(0).standard_normal(20_000)
    restitution = expit(list_coordinates(population)[2] + deviations[2] * normal)
    assert drawn.restitution.mean() == pytest.approx(restitution.mean(), rel=0.02)
    assert drawn.restitution.std() == pytest.approx(restitution.std(), rel=0.1)
    correlations = np.corrcoef([*coordinates, logit(drawn.restitution)])
    expected = total / deviations / deviations[:, None]
    np.testing.assert_allclose(correlations, expected, atol=0.05)


EDGES = {
    "all overturned": {"overturned": np.ones(TESTS, bool)},
    "one group": {"groups": ["the same"] * TESTS},
    "prior without doubt": {"prior": {"critical_angle": (0.17, 0.0)}},
    "none overturned": {"overturned": np.zeros(TESTS, bool)},
    "against a wall": {"one_sided": True},
}


@SLOW
@pytest.mark.parametrize("edge", first_before_release(EDGES, 3))
def test_an_edge_is_fitted(edge):
    fit = fit_tests(**EDGES[edge])
    assert np.isfinite(jax.tree.leaves(fit.population)).all()
    assert all(low <= high for low, high in fit.compute_intervals().values())
    assert ("from one side only" in str(fit.remarks)) == ("overturned" in edge)
    assert fit.status == jr.Status.COMPLETE
    probabilities = np.asarray(fit.probability(make_tests()[0]))
    assert np.all((probabilities > 0) & (probabilities < 1))
    assert fit.block.one_sided == (edge == "against a wall")
    assert (float(fit.population.group_deviation) > 0) == ("group" not in edge)


# Scores, and campaigns of which the truth is known


@SLOW
@DOUBLE
def test_scores_are_of_the_halves_that_are_documented():
    """From the same sample: the population that fits a half, and a loop for its predictions."""
    fitted = usual_fit()[1]
    suite, overturned = make_tests()
    options = {"splits": SPLITS, "samples": SAMPLES, "seed": 5}
    scores = jr.calibration.cross_validate(suite, overturned, GROUPS, **options)
    prior, points, data = fitted.evidence
    for split in range(SPLITS):
        half = halve_by_hand(split)
        population = posterior.scale_to_prior(
            jnp.asarray(fitted.modes[split + 1].standard), prior
        )
        compute = functools.partial(weigh_by_hand, population, points)
        weights = integrate_over_groups(compute, population, 5)
        lapse = float(population.lapse)
        predicted = (1 - lapse) * (np.asarray(data.outcomes)[:TESTS] @ weights) + lapse / 2
        for name, guess in (("blocks", predicted), ("base rate", overturned[half].mean())):
            expected = np.mean(((guess - overturned) ** 2)[~half])
            computed = float(scores.brier.sel(predictor=name)[split])
            assert computed == pytest.approx(expected, rel=1e-6)
    assert scores.split.values.tolist() == [5, 6]
    never = np.all([halve_by_hand(split) for split in range(SPLITS)], axis=0)
    np.testing.assert_array_equal(np.isnan(scores.probability[0]), never)


@SLOW
def test_probabilities_of_new_motions_are_those_of_the_population():
    """The fit has 64 outcomes: at best the probability is known to some hundredths."""
    changes = {"group_deviation": 0.0, "lapse": 0.0}
    suite, overturned = make_tests(64, 1, **changes)
    fit = jr.calibration.fit_outcomes(suite, overturned, samples=1024)
    motions = make_suite(200, seed=3)
    blocks, restitutions = make_blocks(describe_population(**changes), 4000, seed=4)
    true = [jr.respond_batch(blocks, restitutions, m).overturned.mean() for m in motions]
    difference = np.abs(np.asarray(fit.probability(motions)) - true)
    assert difference.mean() < 0.06
    # Exchanged outcomes fit no block.
    exchanged = overturned ^ (np.random.default_rng(2).permutation(64) < 16)
    disturbed = jr.calibration.fit_outcomes(suite, exchanged, samples=1024)
    assert float(disturbed.population.lapse) > 1.5 * float(fit.population.lapse)
