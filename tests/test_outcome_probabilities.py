"""Uncertain parameters and probabilities of outcomes, against SciPy, closed forms, sampling."""

import csv
import json
import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate, stats
from tools.selection import first_by_default

import jaxrock as jr
from jaxrock.cli import main
from jaxrock.plot import plot_outcome_probabilities, plot_sobol_indices, plot_tornado
from jaxrock.sensitivity.distributions import (
    compute_scores,
    draw_normal_numbers,
    map_normal_numbers,
)
from jaxrock.sensitivity.outcome_statistics import (
    compute_derivatives,
    compute_interval,
    compute_sobol_indices,
)

float64 = pytest.mark.float64
BLOCK = jr.Block.from_size(width=0.2, height=0.8)


def find_beta(mean, variation):
    """SciPy's Beta distribution with a mean and a coefficient of variation."""
    total = (1 - mean) / (mean * variation**2) - 1
    return stats.beta(mean * total, (1 - mean) * total)


@float64
def test_draws_are_a_net():
    """One point in each of n strips of equal probability: what random numbers do not have."""
    n = 1024
    coefficients = {"width": 0.1, "restitution": 0.08}
    z, again, others = (
        jr.Uncertain(coefficients, samples=n, seed=seed).draw(BLOCK, 0.8).normal
        for seed in (3, 3, 4)
    )
    for column in z.T:
        assert sorted(np.floor(n * stats.norm.cdf(column)).astype(int)) == list(range(n))
    np.testing.assert_array_equal(z, again)
    assert (z != others).any()


@float64
def test_drawn_sides_leave_the_other_side():
    uncertain = jr.Uncertain({"width": 0.1, "inertia_ratio": 0.02})
    blocks, c, z, _ = uncertain.draw(BLOCK, 0.8)
    assert z.shape == (64, 2)
    np.testing.assert_allclose(2 * blocks.half_width * blocks.slenderness, 0.8, rtol=1e-12)
    assert np.ptp(blocks.half_width) > 0.01
    assert (c == 0.8).all()
    sized = jr.Uncertain({"half_width": 0.1}).draw(BLOCK, 0.8).block
    np.testing.assert_allclose(sized.slenderness, 4.0, rtol=1e-12)


@float64
def test_an_object_is_drawn_as_if_it_were_alone():
    """Medians and coefficients differ from object to object, the points do not."""
    half_width = np.array([0.1, 0.2, 0.3])
    restitution = np.array([0.7, 0.8, 0.9])
    coefficients = np.array([0.0, 0.02, 0.05])
    blocks = jr.Block(half_width, 4.0)
    uncertain = jr.Uncertain({"width": 0.1, "restitution": coefficients}, samples=8, seed=3)
    draws = uncertain.draw(blocks, restitution)
    assert draws.restitution.shape == draws.block.gravity.shape == (3, 8)
    for k in range(3):
        alone = jr.Uncertain({"width": 0.1, "restitution": coefficients[k]}, samples=8, seed=3)
        single = alone.draw(jr.Block(half_width[k], 4.0), restitution[k])
        np.testing.assert_array_equal(draws.normal, single.normal)
        np.testing.assert_allclose(draws.restitution[k], single.restitution, rtol=1e-12)
        for name in ("half_width", "slenderness", "gravity", "inertia_ratio"):
            values = getattr(draws.block, name)[k]
            np.testing.assert_allclose(values, getattr(single.block, name), rtol=1e-12)


def test_what_is_uncertain_is_a_value():
    """Immutable, equal to another one of the same content, and what it prints."""
    uncertain = jr.Uncertain({np.str_("width"): 0.02, "restitution": [0.05, 0.1]}, samples=128)
    again = jr.Uncertain({"width": 0.02, "restitution": np.array([0.05, 0.1])}, samples=128)
    assert uncertain == again != jr.Uncertain({"width": 0.02}, samples=128)
    assert pickle.loads(pickle.dumps(uncertain)) == uncertain
    assert {uncertain: 1}[again] == 1
    with pytest.raises(AttributeError):
        uncertain.samples = 4
    assert str(uncertain) == (
        "coefficients of variation: width 0.02, restitution 0.05 to 0.1; 128 samples, seed 0"
    )
    np.testing.assert_array_equal(
        uncertain.coefficients_of_variation["restitution"], [0.05, 0.1]
    )


@float64
@pytest.mark.parametrize("second", [("restitution", 0.8), ("amplitude", -2.0)])
def test_derivatives_of_a_probability_are_those_of_its_closed_form(second):
    """Of the probability that a product with a lognormal number is large."""
    names = ("width", second[0])
    n = 2**16
    values = np.array([0.5, second[1]])
    limit = 0.525 * second[1]
    variations = np.array([0.1, 0.08])

    def compute_probability(values, variations):
        deviation = np.sqrt(np.log1p(variations[0] ** 2))
        if second[0] == "restitution":
            distribution = find_beta(values[1], variations[1])
        else:
            distribution = stats.norm(values[1], variations[1] * abs(values[1]))

        def integrand(x):
            return stats.norm.sf(np.log(limit / x / values[0]) / deviation) * distribution.pdf(
                x
            )

        ends = distribution.ppf([1e-13, 1 - 1e-13])
        return integrate.quad(integrand, *ends, epsabs=1e-13, points=[distribution.mean()])[0]

    z = draw_normal_numbers(2, n, 0)
    samples = map_normal_numbers(names, z, values, variations).T
    outcome = (abs(samples[0] * samples[1]) > abs(limit)).astype(float)[None]
    assert outcome.mean() == pytest.approx(compute_probability(values, variations), abs=2e-3)
    scores = [*map(compute_scores, names, samples, values, variations)]
    h = 1e-4
    for k in range(2):
        step = h * np.eye(2)[k]
        ends = [compute_probability(values * (1 + s * step), variations) for s in (-1, 1)]
        derivative, error = compute_derivatives(outcome, scores[k][0][:, None])
        assert abs(derivative[0] - (ends[1] - ends[0]) / (2 * h)) < 3 * error[0]
        assert error[0] < 0.05 * abs(derivative[0])
        ends = [compute_probability(values, variations + s * step) for s in (-1, 1)]
        derivative, error = compute_derivatives(outcome, scores[k][1][:, None])
        assert abs(derivative[0] - (ends[1] - ends[0]) / (2 * h)) < 3 * error[0]


@float64
def test_interval_of_a_suite():
    """The records are the units: exact where their shares are 0 or 1, and it covers."""
    for hits in (0, 3, 20):
        shares = np.repeat([1.0, 0.0], [hits, 20 - hits])
        exact = stats.binomtest(hits, 20).proportion_ci(0.95)
        assert compute_interval(shares, 4096, 0.95) == pytest.approx(exact, abs=0.01)
    rng = np.random.default_rng(0)
    mean = 0.2
    covered = widths = 0
    for _ in range(200):
        low, high = compute_interval(rng.beta(0.2, 0.8, 12), 4096, 0.9)
        covered += low <= mean <= high
        widths += (high - low) / 200
    assert covered >= 180
    assert widths < 0.5
    # Of one record, the samples are the units.
    low, high = compute_interval(np.array([0.5]), 4096, 0.95)
    assert (low, high) == pytest.approx((0.4846, 0.5154), abs=1e-4)


@float64
def test_sobol_indices_with_records():
    """Of y = (1 + r) x1 + x2 + x1 x2 + 3 r, r = -1, 0 or 1: variances by hand."""
    rng = np.random.default_rng(0)
    n = 2**15
    first, second = rng.standard_normal((2, 2, n))

    def answer(x):
        r = np.array([-1.0, 0.0, 1.0])[:, None]
        return np.stack([(1 + r) * x[0] + x[1] + x[0] * x[1] + 3 * r, np.ones((3, n))])

    mixed = []
    for k in range(2):
        x = first.copy()
        x[k] = second[k]
        mixed.append(answer(x))
    found = compute_sobol_indices(answer(first), answer(second), np.stack(mixed))
    # E (1 + r)^2 = 5/3, the mean slope is 1; 9 var(r) = 6.
    whole = 5 / 3 + 1 + 1 + 6
    np.testing.assert_allclose(found.first[0], np.array([1, 1, 6]) / whole, atol=0.015)
    total = np.array([5 / 3 + 1, 1 + 1, 6 + 2 / 3]) / whole
    np.testing.assert_allclose(found.total[0], total, atol=0.015)
    assert np.isnan(found.first[1]).all()


# Answers at samples (2, n) under records, as a block gives them: it rarely overturns, or often,
# or with a heavy tail.
ANSWERS = {
    "stands or overturns": lambda x: np.where(x[1] > 1.6, 1.0, 0.4 + 0.05 * np.sign(x[0]))[
        None
    ],
    "overturns": lambda x: (x[0] + 0.5 * x[1] + np.sin(20 * x[0] * x[1]) > 0.5).astype(float)[
        None
    ],
    "a sum": lambda x: (x[0] + 0.7 * x[1])[None],
    "a heavy tail": lambda x: (x[0] + np.exp(0.8 * x[1]))[None],
    "several records": lambda x: np.stack(
        [(x[0] + 0.5 * x[1] > limit).astype(float) for limit in (-0.5, 0.3, 1.5)]
    ),
    "records and a tail": lambda x: np.stack(
        [x[0] + a * np.exp(0.7 * x[1]) for a in (0, 1, 2)]
    ),
}


@float64
@pytest.mark.parametrize("name", first_by_default(ANSWERS))
def test_errors_of_sobol_indices_are_those_of_repetitions(name):
    """With independent samples: those of Sobol points have errors that are mostly smaller."""
    answer = ANSWERS[name]
    rng = np.random.default_rng(0)
    found = []
    for _ in range(800):
        first, second = rng.standard_normal((2, 2, 512))
        mixed = [np.stack([second[0], first[1]]), np.stack([first[0], second[1]])]
        parts = [answer(x)[None] for x in (first, second, *mixed)]
        indices = compute_sobol_indices(parts[0], parts[1], np.stack(parts[2:]))
        found.append([index[0] for index in indices])
    first, first_error, total, total_error = np.swapaxes(found, 0, 1)
    for index, error in ((first, first_error), (total, total_error)):
        stated = np.sqrt(np.mean(error**2, axis=0))
        np.testing.assert_allclose(stated / index.std(axis=0), 1, atol=0.13)


def direct_shares(block, c, record, variations, count, seed, ratio=0.5):
    """By random numbers of another generator, and distributions of SciPy."""
    rng = np.random.default_rng(seed)
    medians = {"width": 2 * block.half_width, "height": 2 * block.half_height, "factor": 1.0}
    values = {name: np.full(count, float(value)) for name, value in medians.items()}
    values["restitution"] = np.full(count, c)
    for name, variation in variations.items():
        if name == "restitution":
            values[name] = find_beta(c, variation).rvs(count, random_state=rng)
        else:
            z = rng.standard_normal(count)
            values[name] *= np.exp(np.sqrt(np.log(1 + variation**2)) * z)
    blocks = jr.Block.from_size(width=values["width"], height=values["height"])
    found = jr.respond_batch(
        blocks, values["restitution"], record.scaled(values["factor"]), record.end + 10
    )
    fell = np.asarray(found.overturned)
    large = np.asarray(found.peak_rotation) > ratio * np.asarray(blocks.critical_angle)
    rocks = np.asarray(found.peak_rotation) > 0
    return values, np.stack([rocks, large | fell, fell]).astype(float)


def check_against_direct_sampling(block, c, record, variations, count, seed, samples=4096):
    uncertain = jr.Uncertain(variations, samples=samples)
    found = jr.sensitivity.outcome_probabilities(block, c, record, uncertain)
    values, outcomes = direct_shares(block, c, record, variations, count, seed)
    direct = outcomes.mean(axis=1)
    noise = np.sqrt(direct * (1 - direct) * (1 / count + 1 / samples)) + 1e-4
    assert (abs(found.probability - direct) < 3.5 * noise).all(), (found.probability, direct)
    assert (found.low <= direct + 3 * noise).all()
    # The slope to a median, from the same random numbers around another one.
    step = 0.5 * variations["width"]
    shifted = []
    for sign in (-1, 1):
        moved = jr.Block.from_size(
            width=2 * block.half_width * np.exp(sign * step), height=2 * block.half_height
        )
        shifted.append(direct_shares(moved, c, record, variations, count, seed)[1][2].mean())
    slope = (shifted[1] - shifted[0]) / (2 * step)
    k = found.names.index("width")
    noise = found.by_median_error[2, k] + np.sqrt(0.25 / count) / step
    assert abs(found.by_median[2, k] - slope) < 4 * noise
    # The first-order index, as the variance of means in bins of equal probability.
    fell = outcomes[2]
    whole = direct[2] * (1 - direct[2])
    for k, name in enumerate(found.names):
        bins = np.array_split(fell[np.argsort(values[name])], 20)
        first = (np.var([each.mean() for each in bins]) - 19 / count * whole) / whole
        assert abs(found.first[3, k] - first) < 4 * found.first_error[3, k] + 1 / count**0.5
    return found.probability[2], direct[2]


@pytest.mark.thorough
@float64
def test_shares_in_a_chaotic_window_against_direct_sampling():
    record = jr.example_record().scaled(2.0)
    variations = {"width": 0.02, "restitution": 0.05, "factor": 0.1}
    share, _ = check_against_direct_sampling(
        BLOCK, 0.8, record, variations, 2048, seed=1, samples=512
    )
    assert 0.4 < share < 0.6


@pytest.mark.thorough
@float64
def test_a_suite_is_its_records():
    records = [jr.example_record().scaled(factor) for factor in (0.5, 2.0)]
    coefficients = {"half_width": 0.05, "gravity": 0.01, "factor": 0.1}
    uncertain = jr.Uncertain(coefficients, samples=256)

    def compute(motion):
        return jr.sensitivity.outcome_probabilities(BLOCK, 0.8, motion, uncertain, ratio=0.3)

    both = compute(jr.Suite(records))
    each = [compute(record) for record in records]
    np.testing.assert_array_equal(both.by_record, [one.probability for one in each])
    np.testing.assert_array_equal(both.peak, [one.peak[0] for one in each])
    assert both.sources == ("half_width", "gravity", "factor", "record")
    assert both.high[2] - both.low[2] > 0.5  # of two records
    assert "half-width at this slenderness" in str(both)
    assert both.answers == ("peak", "rocks", "exceeds 0.3", "overturns")


@pytest.mark.thorough
@float64
def test_pulses_and_noise():
    pulse = jr.HalfSine(3.5, 0.5)
    coefficients = {"duration": 0.1, "restitution": 0.05, "factor": 0.1}
    uncertain = jr.Uncertain(coefficients, samples=512)
    found = jr.sensitivity.outcome_probabilities(BLOCK, 0.8, pulse, uncertain)
    # It overturns without an impact, or not at all: the restitution decides nothing.
    assert found.first[3, 1] == 0
    assert 0.1 < found.probability[2] < 0.9
    assert "within noise" in str(found)
    rare = jr.sensitivity.outcome_probabilities(BLOCK, 0.8, pulse.scaled(0.8), uncertain)
    assert 0 < rare.probability[2] < 20 / 512
    assert np.isnan(rare.first[3]).all()
    assert str(rare).endswith("overturns: too few samples differ for indices and derivatives")
    values = found.inputs
    pulses = jr.HalfSine(3.5 * values["factor"], values["duration"])
    response = jr.respond_batch(BLOCK, values["restitution"], pulses, pulses.end + 10)
    assert found.probability[2] == np.asarray(response.overturned).mean()
    # The rotation is highest after the end of the pulse.
    large = np.asarray(
        response.overturned | (response.peak_rotation > 0.5 * BLOCK.critical_angle)
    )
    assert found.probability[1] == large.mean()


@pytest.mark.thorough
@float64
def test_the_command_gives_probabilities_where_derivatives_say_nothing(capsys, tmp_path):
    """The scene lies in a window of scale factors 0.004 wide."""
    scene = ["--scale", "2", "--width", "0.2", "--height", "0.8", "--restitution", "0.8"]
    words = ["driven-sensitivity", "--record", "example", *scene, "--samples", "512"]
    main([*words, "--out", str(tmp_path), "--json"])
    found = json.loads(capsys.readouterr().out)
    assert 1.997 < found["factor_low"] < 2 < found["factor_high"] < 2.003
    assert found["meaningful"] is False
    assert "nearer than the uncertainty (5 %)" in found["reason"]
    assert found["probabilities"][2]["probability"] == pytest.approx(0.517, abs=0.06)
    rows = {row["quantity"]: row for row in found["rows"]}
    assert set(rows) == {"width", "height", "restitution", "factor"}
    assert {row["derivative"] for row in rows.values()} == {None}
    assert rows["width"]["at_low"] is rows["width"]["at_high"] is None
    lines = (tmp_path / "probabilities.csv").read_text(encoding="utf-8").splitlines()
    table = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    assert [row["outcome"] for row in table] == ["rocks", "exceeds 0.5", "overturns"]
    files = ["probabilities.csv", "probabilities.png", "sensitivity.csv", "tornado.png"]
    assert sorted(path.name for path in tmp_path.iterdir()) == files


def test_pictures_of_shares():
    record = jr.Record([0.0, 3.0, -3.0, 0.0], 0.2)
    suite = jr.Suite([record, record.scaled(0.1)])
    found = jr.sensitivity.outcome_probabilities(
        BLOCK, 0.8, suite, jr.Uncertain({"width": 0.1})
    )
    ax = plot_outcome_probabilities(found)
    labels = [label.get_text() for label in ax.get_yticklabels()]
    assert labels == [
        f"{outcome}: {share:.3f}"
        for outcome, share in zip(found.outcomes, found.probability, strict=True)
    ]
    ends = [bar.get_width() for bar in ax.patches]
    np.testing.assert_allclose(ends, found.probability)
    ax = plot_sobol_indices(found, "peak")
    assert [label.get_text() for label in ax.get_yticklabels()] == [
        "width at this height",
        "record",
    ]
    indices = np.array([*found.first[0], *found.total[0]])
    errors = np.array([*found.first_error[0], *found.total_error[0]])
    # What noise hides has words instead of a bar.
    is_known = (indices >= 2 * errors) & (errors < 0.25)
    np.testing.assert_allclose(
        [bar.get_width() for bar in ax.patches], np.where(is_known, indices, 0)
    )
    assert len(ax.texts) == (~is_known).sum()
    noisy = replace(found, total=np.full_like(found.total, 4.6), total_error=found.total + 9)
    ax = plot_sobol_indices(noisy, "peak")
    assert "within noise" in [text.get_text() for text in ax.texts]
    assert ax.get_xlim()[1] < 1.2
    assert "4.60" not in str(noisy)
    with pytest.raises(ValueError, match="answer must be one of peak, rocks"):
        plot_sobol_indices(found, "sways")


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        (np.nan, "has no value: the block overturns, also at both ends of every range"),
        (0.0, "is 0, also at both ends of every range"),
    ],
)
def test_a_tornado_without_bars_is_a_sentence(answer, sentence):
    same = np.full(2, answer)
    low, high, unknown = (np.full(2, value) for value in (1.0, 2.0, np.nan))
    bars = jr.sensitivity.TornadoBars(
        ("restitution", "factor"), low, high, same, same, unknown, unknown, answer
    )
    assert str(bars) == sentence
    ax = plot_tornado(bars)
    assert not ax.patches
    assert ax.texts[0].get_text().replace("\n", " ") == f"No bars: the answer {sentence}."
