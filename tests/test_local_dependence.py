"""Local dependence: its interval against both outcomes, its derivatives against differences."""

import numpy as np
import pytest

import jaxrock as jr

pytestmark = pytest.mark.float64
SLIM = jr.Block.from_size(width=0.2, height=0.8)
STURDY = jr.Block.from_size(width=0.4, height=1.6)
OF_PULSE = ("width", "height", "restitution", "amplitude", "duration")


def compute_ratio(parameters, motion_class=jr.HalfSine, answer="rotation_ratio"):
    """The answer of blocks under pulses, by the batch alone."""
    sizes = {name: parameters[name] for name in ("width", "height")}
    block = jr.Block.from_size(**sizes)
    motion = motion_class(parameters["amplitude"], parameters["duration"])
    response = jr.respond_batch(block, parameters["restitution"], motion, motion.end + 10)
    if answer == "margin":
        return np.asarray(response.margin)
    ratio = np.asarray(response.peak_rotation / block.critical_angle)
    return np.where(response.overturned, np.nan, ratio)


def differentiate(function, medians, step=1e-4):
    """Central differences with respect to each parameter, steps relative to its value."""
    derivatives = []
    for name, value in medians.items():
        ends = [function(medians | {name: value * (1 + sign * step)}) for sign in (-1, 1)]
        derivatives.append((ends[1] - ends[0]) / (2 * step * value))
    return np.array(derivatives)


@pytest.mark.thorough
def test_a_narrow_interval_of_a_record():
    """The block stands between two factors that are 0.004 apart, and overturns beside them."""
    record = jr.example_record()
    uncertain = jr.Uncertain(dict.fromkeys(("width", "restitution", "scale"), 0.05))
    local = jr.sensitivity.local_dependence(SLIM, 0.8, record, uncertain, scale=2.0)
    assert 1.99 < local.factor_low < 2 < local.factor_high < 2.01
    ends = np.array([local.factor_low, local.factor_high])
    for outward, overturns in ((-1e-4, False), (1e-4, True)):
        motions = record.scaled(ends * [1 - outward, 1 + outward])
        response = jr.respond_batch(SLIM, 0.8, motions)
        assert (np.asarray(response.overturned) == overturns).all()
    grid = np.linspace(1.95, 2.05, 401)
    places = np.asarray(jr.overturning_boundaries(SLIM, 0.8, record, "factor", grid).value)
    # Around an end the outcome changes several times, so that other factors find other places.
    assert abs(places[:, None] - ends).min(axis=0).max() < 1e-5
    assert not local.overturned
    assert not local.meaningful
    assert np.isnan(local.derivatives).all()
    assert np.isnan(local.elasticities).all()
    response = jr.respond_batch(SLIM, 0.8, record.scaled(2.0), record.end + 10)
    assert local.value == float(response.peak_rotation / SLIM.critical_angle)
    assert np.isnan(local.mean)
    assert 0.2 < local.left_out < 0.8
    assert local.reason.startswith(
        "the block stands for scale factors 1.9979 to 2.0017, nearer"
    )
    assert local.reason.endswith("derivatives are not meaningful and are omitted")
    # A motion that is twice as strong is the same question.
    doubled = jr.sensitivity.local_dependence(SLIM, 0.8, record.scaled(2.0), uncertain)
    assert doubled.factor_low == pytest.approx(local.factor_low / 2, rel=1e-12)
    assert doubled.value == local.value


@pytest.mark.thorough
def test_derivatives_under_a_pulse():
    medians = dict(zip(OF_PULSE, (0.4, 1.6, 0.9, 3.0, 0.3), strict=True))
    uncertain = jr.Uncertain(dict.fromkeys(OF_PULSE, 0.05), samples=512)
    local = jr.sensitivity.local_dependence(STURDY, 0.9, jr.HalfSine(3.0, 0.3), uncertain)
    assert local.meaningful
    assert local.names == OF_PULSE
    np.testing.assert_allclose(local.at, list(medians.values()), rtol=1e-12)
    expected = differentiate(compute_ratio, medians)
    np.testing.assert_allclose(local.derivatives, expected, rtol=1e-4, atol=1e-9)
    np.testing.assert_allclose(
        local.elasticities, expected * local.at / local.value, rtol=1e-4, atol=1e-9
    )
    # No boundary within four standard deviations: the block stands at both ends.
    assert np.isnan([local.factor_low, local.factor_high]).all()
    ends = np.exp(4 * np.sqrt(np.log1p(0.05**2)) * np.array([-1, 1]))
    assert np.isfinite(compute_ratio(medians | {"amplitude": 3.0 * ends})).all()
    # The samples are those of the probabilities.
    outcomes = jr.sensitivity.outcome_probabilities(
        STURDY, 0.9, jr.HalfSine(3.0, 0.3), uncertain
    )
    answers = compute_ratio(outcomes.inputs)
    assert local.mean == pytest.approx(answers.mean(), rel=1e-12)
    assert local.standard_deviation == pytest.approx(answers.std(), rel=1e-12)
    steps = np.stack([outcomes.inputs[name] for name in OF_PULSE]) - local.at[:, None]
    left = answers - local.value - expected @ steps
    explained = 1 - (left**2).mean() / answers.var()
    assert local.explained_variance == pytest.approx(explained, rel=1e-4)
    assert "a linear function explains 85.8 % of the variance" in str(local)


@pytest.mark.thorough
def test_a_block_that_overturns():
    """It has a margin, which has derivatives, and no rotation ratio."""
    pulse = jr.HalfSine(9.0, 0.5)
    medians = dict(zip(OF_PULSE, (0.2, 0.8, 0.9, 9.0, 0.5), strict=True))
    uncertain = jr.Uncertain(dict.fromkeys(OF_PULSE, 0.05))
    margin = jr.sensitivity.local_dependence(SLIM, 0.9, pulse, uncertain, answer="margin")
    assert margin.overturned
    assert margin.meaningful
    expected = differentiate(lambda at: compute_ratio(at, answer="margin"), medians)
    np.testing.assert_allclose(margin.derivatives, expected, rtol=1e-4, atol=1e-9)
    ratio = jr.sensitivity.local_dependence(SLIM, 0.9, pulse, uncertain)
    assert ratio.overturned
    assert not ratio.meaningful
    assert np.isnan(ratio.value)
    assert ratio.left_out == 1
    assert ratio.reason.startswith("the block overturns for scale factors below 0.819")


def test_a_block_that_never_lifts():
    pulse = jr.Sine(1.0, 0.3)
    local = jr.sensitivity.local_dependence(
        STURDY, 0.9, pulse, jr.Uncertain({"width": 0.05, "amplitude": 0.05})
    )
    assert not local.meaningful
    assert local.value == local.mean == local.standard_deviation == 0
    assert np.isnan(local.explained_variance)


def test_a_tangent_that_says_little():
    """Impacts make the response rough, far from overturning."""
    uncertain = jr.Uncertain({"width": 0.02, "scale": 0.02})
    local = jr.sensitivity.local_dependence(STURDY, 0.9, jr.example_record(), uncertain)
    assert not local.meaningful
    assert np.isnan(local.derivatives).all()
    assert 0 < local.explained_variance < 0.5
    assert local.left_out == 0


@pytest.mark.thorough
def test_derivatives_under_a_record():
    """Within a small uncertainty they are meaningful; of the peak."""
    record = jr.example_record()
    uncertain = jr.Uncertain({"half_width": 0.002, "slenderness": 0.002, "scale": 0.002})
    local = jr.sensitivity.local_dependence(
        STURDY, 0.9, record, uncertain, answer="peak_rotation", scale=0.6
    )

    def compute_peak(at):
        block = jr.Block(at["half_width"], at["slenderness"])
        motion = record.scaled(at["scale"])
        return float(jr.respond_batch(block, 0.9, motion, motion.end + 10).peak_rotation)

    assert local.meaningful
    medians = {"half_width": 0.2, "slenderness": 4.0, "scale": 0.6}
    expected = differentiate(compute_peak, medians, step=1e-5)
    np.testing.assert_allclose(local.derivatives, expected, rtol=1e-3)
    # Without the scale among the uncertain parameters, the motion is as strong.
    fixed = jr.Uncertain({"half_width": 0.002, "slenderness": 0.002})
    other = jr.sensitivity.local_dependence(STURDY, 0.9, record, fixed, scale=0.6)
    assert other.value == pytest.approx(local.value / float(STURDY.critical_angle), rel=1e-12)


@pytest.mark.thorough
def test_derivatives_on_a_harmonic_floor():
    names = ("slenderness", "amplitude", "frequency")
    floor = jr.Harmonic(2.8, 8.0, 1)
    uncertain = jr.Uncertain(dict.fromkeys(names, 1e-4))
    local = jr.sensitivity.local_dependence(STURDY, 0.9, floor, uncertain, answer="margin")

    def compute_margin(at):
        block = jr.Block(0.2, at["slenderness"])
        motion = jr.Harmonic(at["amplitude"], at["frequency"], 1)
        return float(jr.respond_batch(block, 0.9, motion).margin)

    assert local.meaningful
    medians = {"slenderness": 4.0, "amplitude": 2.8, "frequency": 8.0}
    expected = differentiate(compute_margin, medians, step=1e-5)
    np.testing.assert_allclose(local.derivatives, expected, rtol=1e-3)


def test_the_boundary_is_the_critical_amplitude():
    local = jr.sensitivity.local_dependence(
        SLIM, 0.9, jr.HalfSine(3.7, 0.5), jr.Uncertain({"amplitude": 0.05})
    )
    # Half as strong and scaled by 2, the pulse is the same, also where its amplitude varies.
    doubled = jr.sensitivity.local_dependence(
        SLIM, 0.9, jr.HalfSine(1.85, 0.5), jr.Uncertain({"amplitude": 0.05}), scale=2.0
    )
    assert doubled.value == local.value
    assert doubled.left_out == local.left_out
    (critical,) = jr.critical_amplitude(SLIM, 0.9, jr.HalfSine, 0.5).value
    assert local.factor_high == pytest.approx(float(critical) / 3.7, rel=1e-9)
    assert np.isnan(local.factor_low)
    assert not local.meaningful
