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
from jaxrock.calibration.outcomes import posterior
from jaxrock.calibration.outcomes.campaign import check_campaign, fit_parts
from jaxrock.calibration.outcomes.likelihood import (
    compute_log_likelihood,
)
from jaxrock.calibration.outcomes.population import NAMES, make_population
from jaxrock.calibration.outcomes.prior import make_prior
from jaxrock.calibration.outcomes.sample import NormalComponent, Simulator, draw_sample

TESTS = 24
SAMPLES = 512
SPLITS = 2
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
    "group_deviation": 0.1,
}


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


def describe_population(**changes):
    """Correlated, with lapses and deviations of groups."""
    return Population(**{k: jnp.asarray(v, float) for k, v in (TRUE | changes).items()})


def make_blocks(population, number, seed):
    """Draw blocks of a population by NumPy, without deviations of groups."""
    random = np.random.default_rng(seed)
    normal = random.standard_normal((number, 3))
    factor = np.linalg.cholesky(cover(population))
    coordinates = list_coordinates(population) + normal @ factor.T
    angles = np.exp(coordinates[:, 0])
    frequency_parameters = np.exp(coordinates[:, 1])
    return jr.Block.from_parameters(frequency_parameters, angles), expit(coordinates[:, 2])


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
    r21 = float(population.correlation_critical_angle_frequency_parameter)
    r31 = float(population.correlation_critical_angle_restitution)
    r32 = float(population.correlation_frequency_parameter_restitution)
    correlation = np.array([[1, r21, r31], [r21, 1, r32], [r31, r32, 1]])
    deviations = np.array([float(getattr(population, f"{name}_deviation")) for name in NAMES])
    return correlation * deviations * deviations[:, None]


def simulate_tests(population, suite, seed=0):
    """Simulate a test under each motion, each with a block of its own."""
    blocks = make_blocks(population, len(suite), seed)
    return np.diagonal(jr.respond_batch(*blocks, suite).overturned)


@functools.cache
def make_tests():
    suite = make_suite()
    return suite, simulate_tests(describe_population(), suite)


def fit_tests(**changes):
    suite, overturned = make_tests()
    options = {"overturned": overturned, "groups": GROUPS, "samples": SAMPLES}
    return jr.calibration.fit_outcomes(suite, **(options | changes))


@functools.cache
def usual_campaign():
    return check_campaign(*make_tests(), GROUPS, samples=SAMPLES, seed=5)


@functools.cache
def usual_fit():
    """The whole, and the halves of two splits."""
    halves = [halve_by_hand(split) for split in range(SPLITS)]
    return fit_parts(usual_campaign(), [np.ones(TESTS, bool), *halves])


def halve_by_hand(split):
    """Which tests are fitted."""
    names = sorted(set(GROUPS))
    order = np.random.default_rng(5 + split).permutation(len(names))
    fitted = {names[k] for k in order[: len(names) // 2]}
    return np.array([name in fitted for name in GROUPS])


def count(part=None):
    """Counts of tests, all by default, padded."""
    return usual_campaign().pad(np.ones(TESTS) if part is None else part.astype(float))


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


@pytest.mark.thorough
@pytest.mark.float64
@pytest.mark.parametrize(("nodes", "bound"), [(5, 1e-9), (0, 0.02)])
def test_the_likelihood_is_that_of_a_loop(nodes, bound):
    """Exactly with the same quadrature, and within the error of that with a fine one."""
    _, points, data = usual_fit().evidence
    population = describe_population(group_deviation=0.05)
    lapse = float(population.lapse)
    outcomes = np.asarray(data.outcomes)
    overturned = make_tests()[1]

    def of_group(tests, shift):
        weights = weigh_by_hand(population, points, shift)
        probability = (1 - lapse) * (outcomes[tests] @ weights) + lapse / 2
        return np.prod(np.where(overturned[tests], probability, 1 - probability))

    expected = 0.0
    for name in sorted(set(GROUPS)):
        tests = [k for k, group in enumerate(GROUPS) if group == name]
        compute = functools.partial(of_group, tests)
        expected += np.log(integrate_over_groups(compute, population, nodes))
    computed = compute_log_likelihood(population, points, data, jnp.asarray(count()))
    assert float(computed) == pytest.approx(expected, abs=bound)


@pytest.mark.thorough
@pytest.mark.float64
@pytest.mark.parametrize("question", ["likelihood", "probability"])
def test_derivatives_are_those_of_differences(question):
    _, points, data = usual_fit().evidence
    fit = fit_tests()

    def compute(population):
        if question == "likelihood":
            return compute_log_likelihood(population, points, data, jnp.asarray(count()))
        given = eqx.tree_at(lambda f: f.population, fit, population)
        return given.probability(make_tests()[0]).sum()

    population = describe_population()
    compiled = jax.jit(compute)
    gradient = jax.grad(compute)(population)
    scale = max(1.0, *(abs(float(value)) for value in vars(gradient).values()))
    for name, value in vars(population).items():
        step = 5e-4 * max(abs(float(value)), 0.05)

        def at(k, name=name, value=value, step=step):
            moved = eqx.tree_at(lambda p: getattr(p, name), population, value + k * step)
            return float(compiled(moved))

        expected = (8 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12 * step)
        assert getattr(gradient, name) == pytest.approx(expected, rel=1e-6, abs=1e-6 * scale)
    assert float(gradient.group_deviation) != 0


# Populations


@pytest.mark.float64
def test_a_population_is_normal_with_its_deviations_and_correlations():
    population = describe_population()
    factor = np.asarray(population.factor)
    np.testing.assert_allclose(population.mean, list_coordinates(population), rtol=1e-12)
    np.testing.assert_allclose(factor @ factor.T, cover(population), rtol=1e-12)
    assert np.all(np.triu(factor, 1) == 0)


@pytest.mark.float64
def test_all_unbounded_parameters_make_a_population():
    values = np.random.default_rng(0).normal(0, 2, (11, 50))
    unbounded = jax.tree.unflatten(jax.tree.structure(describe_population()), list(values))
    population = make_population(unbounded)
    r21 = population.correlation_critical_angle_frequency_parameter
    r31 = population.correlation_critical_angle_restitution
    r32 = population.correlation_frequency_parameter_restitution
    partial = (r32 - r21 * r31) / np.sqrt((1 - r21**2) * (1 - r31**2))
    np.testing.assert_allclose(np.arctanh(partial), values[8], rtol=1e-6)
    np.testing.assert_allclose(logit(population.lapse), unbounded.lapse, rtol=1e-9)
    np.testing.assert_allclose(np.log(population.group_deviation), values[10], rtol=1e-9)


# The posterior


@pytest.mark.thorough
@pytest.mark.float64
def test_the_mode_is_that_of_another_search():
    fitted = usual_fit()

    def compute(standard):
        return posterior.differentiate(standard, fitted.evidence, count())

    mode = fitted.modes[0]
    assert mode.status == jr.Status.COMPLETE
    loss, gradient = compute(mode.standard)
    assert np.linalg.norm(gradient) <= 1e-2
    start = mode.standard + np.random.default_rng(3).normal(0, 0.3, mode.standard.size)
    best = scipy.optimize.minimize(compute, start, jac=True, method="L-BFGS-B")
    assert loss <= best.fun + 1e-3
    # Second derivatives by JAX, which differ where the likelihood is rough.
    arguments = jnp.asarray(mode.standard), fitted.evidence, jnp.asarray(count())
    hessian = jax.hessian(posterior.compute_loss)(*arguments)
    values, vectors = np.linalg.eigh(hessian)
    # Less than the curvature of the prior is that of the prior.
    covariance = (vectors / np.maximum(values, 1.0)) @ vectors.T
    computed = posterior.compute_covariance(mode, fitted.evidence, count())
    np.testing.assert_allclose(computed, covariance, atol=0.03)


@pytest.mark.thorough
def test_a_posterior_without_tests_is_the_prior():
    mode = posterior.Mode(np.zeros(11), jr.Status.COMPLETE)
    arguments = (mode, np.eye(11), usual_fit().evidence, 0 * count(), 0)
    drawn = posterior.sample_posterior(*arguments)
    error = 4 * np.sqrt(np.sum(drawn.weights**2))
    np.testing.assert_allclose(drawn.weights @ drawn.standard, 0, atol=error)
    np.testing.assert_allclose(drawn.variances, 1, atol=1.5 * error)


# The sample


class StandingBlocks(Simulator):
    """Blocks that are not simulated."""

    __slots__ = ()

    def simulate(self, coordinates, suite):
        return np.zeros((len(suite), len(coordinates)), bool)


STANDING = StandingBlocks(9.81, 4 / 3, False, jr.Nonlinear())


def test_blocks_of_all_components_are_weighed_alike():
    """Two far apart, of different width and numbers."""
    suite = make_tests()[0][:1]
    means = np.array([[-3.0, 1.0, 2.0], [-1.0, 0.0, 0.0]])
    components = [
        NormalComponent(means[0], np.diag([0.3, 0.2, 0.4]), 4096),
        NormalComponent(means[1], np.diag([0.05, 0.1, 0.1]), 1024),
    ]
    coordinates, log_density, _ = draw_sample(STANDING, suite, components, 0)
    # The target has three parts in ten at the first component, and the others at the second.
    density = 0.3 * multivariate_normal(means[0] + 0.05, 0.04).pdf(coordinates)
    density += 0.7 * multivariate_normal(means[1] + 0.01, 0.002).pdf(coordinates)
    weights = density * np.exp(-log_density)
    weights /= weights.sum()
    exact = 0.3 * (means[0] + 0.05) + 0.7 * (means[1] + 0.01)
    # Of independent points the error would be 0.02 of a coordinate; Sobol points have less.
    np.testing.assert_allclose(weights @ coordinates, exact, atol=0.06)
    assert weights[coordinates[:, 0] < -2].sum() == pytest.approx(0.3, abs=0.03)


# What goes elsewhere


@pytest.mark.thorough
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
    random = np.random.default_rng(0)
    known = random.multivariate_normal(list_coordinates(population), total, 20000).T
    block = drawn.block
    angle, frequency = np.log(block.critical_angle), np.log(block.frequency_parameter)
    # 256 Sobol points: a mean is right to some hundredths of a standard deviation.
    deviations = np.sqrt(np.diag(total))
    for values, mean, deviation in zip((angle, frequency), known, deviations, strict=False):
        assert (values.mean() - mean.mean()) / deviation == pytest.approx(0, abs=0.05)
        assert values.std() == pytest.approx(deviation, rel=0.05)
    # The restitution has another distribution there, of the same deviation.
    restitution = expit(known[2])
    assert drawn.restitution.mean() == pytest.approx(restitution.mean(), rel=0.02)
    assert drawn.restitution.std() == pytest.approx(restitution.std(), rel=0.1)
    correlations = np.corrcoef([angle, frequency, logit(drawn.restitution)])
    expected = total / deviations / deviations[:, None]
    np.testing.assert_allclose(correlations, expected, atol=0.05)


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
    assert np.isfinite(jax.tree.leaves(fit.population)).all()
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
    assert float(other.block.critical_angle) > float(fit_tests().block.critical_angle)


@pytest.mark.thorough
def test_a_free_rocking_test_is_a_prior():
    block = jr.Block(0.1, 5.0)
    random = np.random.default_rng(0)
    times = impact_times(block, 0.9, 0.9) + random.normal(0, 3e-3, 12)
    known = jr.calibration.fit_free_rocking(times, block, model="linearized")
    prior = make_prior(known)
    error = known.standard_errors["restitution"] / (
        known.restitution * (1 - known.restitution)
    )
    assert float(prior.width.restitution) == pytest.approx(float(error), rel=1e-5)
    assert expit(float(prior.mean.restitution)) == pytest.approx(float(known.restitution))


# Scores


@functools.cache
def usual_scores():
    return jr.calibration.cross_validate(
        *make_tests(), GROUPS, splits=SPLITS, samples=SAMPLES, seed=5
    )


@pytest.mark.thorough
def test_scores_are_of_the_halves_that_are_documented():
    scores = usual_scores()
    _, overturned = make_tests()
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


@pytest.mark.thorough
def test_nothing_of_a_held_out_test_is_fitted():
    evidence = usual_fit().evidence
    fitted = halve_by_hand(0)

    def search(changed):
        overturned = evidence.data.overturned.at[np.flatnonzero(changed)].set(0.5)
        overturned = jnp.where(overturned == 0.5, 1 - evidence.data.overturned, overturned)
        data = evidence.data._replace(overturned=overturned)
        start = np.zeros(11)
        return posterior.search_mode(
            evidence._replace(data=data), count(fitted), start
        ).standard

    nothing = np.zeros(TESTS, bool)
    np.testing.assert_array_equal(search(~fitted), search(nothing))
    assert np.any(search(fitted) != search(nothing))


@pytest.mark.thorough
@pytest.mark.float64
def test_a_score_is_that_of_the_half_by_hand():
    """From the same sample: the population that fits a half, and a loop for its predictions."""
    fitted = usual_fit()
    prior, points, data = fitted.evidence
    overturned = make_tests()[1]
    for split in range(SPLITS):
        population = posterior.scale_to_prior(
            jnp.asarray(fitted.modes[split + 1].standard), prior
        )
        compute = functools.partial(weigh_by_hand, population, points)
        weights = integrate_over_groups(compute, population, 5)
        lapse = float(population.lapse)
        outcomes = np.asarray(data.outcomes)[:TESTS]
        predicted = (1 - lapse) * (outcomes @ weights) + lapse / 2
        expected = np.mean((predicted - overturned)[~halve_by_hand(split)] ** 2)
        computed = float(usual_scores().brier.sel(predictor="blocks")[split])
        assert computed == pytest.approx(expected, rel=1e-6)


# Campaigns of which the truth is known


@pytest.mark.thorough
def test_probabilities_of_new_motions_are_those_of_the_population():
    """The fit has 64 outcomes: at best the probability is known to some hundredths."""
    population = describe_population(group_deviation=0.0, lapse=0.0)
    suite = make_suite(64, seed=1)
    overturned = simulate_tests(population, suite, seed=1)
    fit = jr.calibration.fit_outcomes(suite, overturned, samples=1024)
    motions = make_suite(200, seed=3)
    blocks, restitutions = make_blocks(population, 4000, seed=4)
    true = [jr.respond_batch(blocks, restitutions, m).overturned.mean() for m in motions]
    difference = np.abs(np.asarray(fit.probability(motions)) - true)
    assert difference.mean() < 0.06
    # Exchanged outcomes fit no block.
    exchanged = overturned ^ (np.random.default_rng(2).permutation(64) < 16)
    disturbed = jr.calibration.fit_outcomes(suite, exchanged, samples=1024)
    assert float(disturbed.population.lapse) > 1.5 * float(fit.population.lapse)
