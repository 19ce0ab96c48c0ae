"""Slopes against differences, scatter against samples, global measures against known indices."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import integrate, stats

import jaxrock as jr
from jaxrock.sensitivity.distributions import find_widths, quantiles
from jaxrock.sensitivity.moments import _estimate_moments
from jaxrock.sensitivity.samples import draw_normal_numbers

pytestmark = pytest.mark.float64
WALL = jr.Scene(jr.Block(0.4, 5.0), restitution=0.7, intensity=0.15)


def test_sensitivities():
    found = jr.sensitivities(jr.rotation_ratio, WALL)
    assert found.names == (
        *("half_width", "slenderness", "gravity", "inertia_ratio"),
        *("restitution", "intensity"),
    )
    at = dict(zip(found.names, found.at, strict=True))

    def value(**change):
        n = at | change
        block = jr.Block(n["half_width"], n["slenderness"], n["gravity"], n["inertia_ratio"])
        return float(jr.rotation_ratio(jr.Scene(block, n["restitution"], n["intensity"])))

    for k, (name, x) in enumerate(at.items()):
        h = 1e-4 * x
        low = value(**{name: x - h})
        middle = value()
        high = value(**{name: x + h})
        assert found.gradient[k] == pytest.approx((high - low) / (2 * h), rel=1e-5)
        assert found.elasticity[k] == pytest.approx(found.gradient[k] * x / middle, rel=1e-12)
        curvature = (high - 2 * middle + low) / h**2
        assert found.hessian[k, k] == pytest.approx(curvature, rel=1e-3)
    assert "restitution" in str(found)


def ratio_by_sides(width, height):
    block = jr.Block.from_size(width=width, height=height)
    return float(jr.rotation_ratio(jr.Scene(block, 0.7, 0.15)))


def test_sides_are_parameters_of_their_own():
    """The width at this height is not the half-width at this slenderness."""
    found = jr.sensitivities(jr.rotation_ratio, WALL, sides=True)
    assert found.names[:3] == ("width", "height", "gravity")
    np.testing.assert_allclose(found.at[:2], (0.8, 4.0), rtol=1e-14)
    h = 1e-4
    of_width = (ratio_by_sides(0.8 + h, 4.0) - ratio_by_sides(0.8 - h, 4.0)) / (2 * h)
    of_height = (ratio_by_sides(0.8, 4.0 + h) - ratio_by_sides(0.8, 4.0 - h)) / (2 * h)
    np.testing.assert_allclose(found.gradient[:2], (of_width, of_height), rtol=1e-6)
    assert "width at this height" in str(found)
    ranges = {"width": (0.7, 0.9), "restitution": (0.6, 0.8)}
    bars = jr.tornado(jr.rotation_ratio, WALL, ranges)
    assert bars.names == ("restitution", "width")
    ends = [ratio_by_sides(width, 4.0) for width in (0.7, 0.9)]
    np.testing.assert_allclose([bars.at_low[1], bars.at_high[1]], ends, rtol=1e-12)


def test_names_of_sides_where_there_are_other_widths():
    two = {"a": jr.Block(0.4, 5.0), "b": jr.Block(0.3, 4.0), "width": 2.0}

    def answer(at):
        return at["a"].half_width * at["b"].slenderness + at["width"]

    own = jr.tornado(answer, two, {"width": (1.0, 3.0)})  # the number, of no block
    assert (own.at_low[0], own.at_high[0]) == pytest.approx((2.6, 4.6))
    sided = jr.tornado(answer, two, {"a.width": (0.7, 0.9), "b.half_width": (0.2, 0.4)})
    assert sided.at_low[0] == pytest.approx(0.35 * 4 + 2)
    single = {"block": jr.Block(0.4, 5.0), "width": 2.0}
    found = jr.sensitivities(lambda at: at["block"].half_width, single, sides=True)
    assert found.names == ("block.width", "height", "gravity", "inertia_ratio", "width")
    assert found.sides == ("block.width", "height")
    with pytest.raises(ValueError, match=r"'height', which is none of a\.half_width"):
        jr.tornado(answer, two, {"height": (1.0, 2.0)})  # of which of the two?


def test_a_tornado_says_where_it_overturns():
    bars = jr.tornado(jr.rotation_ratio, WALL, {"restitution": (0.6, 0.99)})
    assert str(bars).endswith(" overturns")


@pytest.mark.thorough
def test_sensitivities_of_a_driven_answer():
    def peak(at):
        pulse = jr.HalfSine(at["amplitude"], 0.3)
        return jr.respond(jr.Block(0.2, 5.0), at["restitution"], pulse, 3.0).peak_rotation

    found = jr.sensitivities(peak, {"amplitude": 4.0, "restitution": 0.9})
    h = 1e-4
    for k, name in enumerate(found.names):
        at = dict(zip(found.names, found.at, strict=True))
        difference = peak(at | {name: at[name] + h}) - peak(at | {name: at[name] - h})
        assert found.gradient[k] == pytest.approx(
            float(difference) / (2 * h), rel=1e-5, abs=1e-9
        )


def test_tornado():
    ranges = {"slenderness": (4.0, 6.0), "restitution": (0.6, 0.8), "gravity": (9.81, 9.81)}
    found = jr.tornado(jr.rotation_ratio, WALL, ranges)
    assert found.names == ("restitution", "slenderness", "gravity")
    slender = [
        float(jr.rotation_ratio(jr.Scene(jr.Block(0.4, s), 0.7, 0.15))) for s in (4.0, 6.0)
    ]
    np.testing.assert_allclose([found.at_low[1], found.at_high[1]], slender, rtol=1e-12)
    assert found.value == found.at_low[2] == found.at_high[2]


@pytest.mark.thorough
def test_scatter():
    coefficients = {"half_width": 0.03, "restitution": 0.01, "intensity": 0.04}
    uncertain = jr.Uncertain(coefficients, samples=1024)
    found = jr.sensitivity.propagate(jr.rotation_ratio, WALL, uncertain)
    many = jr.Uncertain(coefficients, samples=2**17, seed=1)
    samples = jr.sensitivity.monte_carlo(jr.rotation_ratio, WALL, many)
    assert found.mean == pytest.approx(samples.mean(), rel=1e-3)
    assert found.standard_deviation == pytest.approx(samples.std(), rel=1e-2)
    assert found.within_tolerance
    # Near the overturning threshold, samples that overturn have no answer: no derivative sees
    # it.
    near = jr.Scene(WALL.block, 0.7, 0.28)
    uncertain = jr.Uncertain({"restitution": 0.05, "intensity": 0.1}, samples=2048)
    missing = np.isnan(jr.sensitivity.monte_carlo(jr.rotation_ratio, near, uncertain))
    assert missing.mean() > 0.2
    assert not jr.sensitivity.propagate(jr.rotation_ratio, near, uncertain).within_tolerance
    # Second order is nearer than first.
    assert abs(found.mean - samples.mean()) < 0.2 * abs(
        found.first_order_mean - samples.mean()
    )
    assert abs(found.standard_deviation - samples.std()) < abs(
        found.first_order_standard_deviation - samples.std()
    )
    assert sum(found.variance_fractions.values()) == pytest.approx(1)


NAMES = ("half_width", "slenderness", "restitution", "intensity")
ANSWERS = (
    jr.overturning_margin,
    jr.rotation_ratio,
    jr.stabilized_period,
    jr.amplification,
    jr.stabilized_rotation,
    jr.critical_intensity,
)
SCATTERING = 150
SAMPLES = 1024
MANY = 20_000


def scattering_scenes():
    """Medians and coefficients of variation, up to 0.3."""
    rng = np.random.default_rng(20)
    block = jr.Block(
        10 ** rng.uniform(-1.3, 0, SCATTERING), 10 ** rng.uniform(0.3, 1.3, SCATTERING)
    )
    restitution = rng.uniform(0.2, 0.97, SCATTERING)
    critical = jr.critical_intensity(block, restitution, model=jr.Nonlinear())
    intensity = rng.uniform(0.02, 1.05, SCATTERING) * critical
    median = np.stack([block.half_width, block.slenderness, restitution, intensity], axis=1)
    largest = 10 ** rng.uniform(-2, -0.5, (SCATTERING, 1)) * np.array([1, 1, 0.3, 1])
    return median, largest * rng.uniform(0.1, 1, (SCATTERING, 4))


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("answer", "model"),
    [
        (jr.overturning_margin, jr.Nonlinear()),
        pytest.param(jr.rotation_ratio, jr.Linearized(), marks=pytest.mark.thorough),
        *(
            pytest.param(answer, model, marks=pytest.mark.thorough)
            for answer in ANSWERS
            for model in (jr.Linearized(), jr.Nonlinear())
        ),
    ],
)
def test_what_holds_is_as_good_as_is_said(answer, model):
    """Mean to a tenth of the deviation, deviation to 10 %, against 20,000 other samples."""
    median, variation = scattering_scenes()
    width = [find_widths(NAMES, m, v)[0] for m, v in zip(median, variation, strict=True)]
    bounded = jnp.array([name == "restitution" for name in NAMES])

    def asked(median, width, z):
        b, slenderness, c, intensity = quantiles(z, median, width, bounded)
        block = jr.Block(b, slenderness)
        if answer is jr.critical_intensity:
            return answer(block, c, model=model)
        return answer(jr.Scene(block, c, intensity), model)

    @jax.jit
    def all_of(median, width, z):
        def one(median, width):
            def of(z):
                return asked(median, width, z)

            nothing = jnp.zeros(4)
            slope = jax.jacfwd(of)
            return of(nothing), slope(nothing), jax.jacfwd(slope)(nothing), jax.vmap(of)(z)

        return jax.vmap(one)(median, width)

    others = np.random.default_rng(1).standard_normal((MANY, 4))
    z = np.concatenate([draw_normal_numbers(4, SAMPLES, 0), others])
    found = [np.asarray(part) for part in all_of(median, np.array(width), z)]
    held = well = 0
    for value, slope, curvature, values in zip(*found, strict=True):
        drawn = values[:SAMPLES]
        others = values[SAMPLES:]
        series = (np.asarray(value), slope, curvature)
        scatter = _estimate_moments(NAMES, series, z[:SAMPLES], drawn)
        missing = np.isnan(others).mean()
        others = others[np.isfinite(others)]
        off = [np.inf, np.inf]
        if others.size and scatter.standard_deviation > 0:
            off = [others.mean() - scatter.mean, others.std() - scatter.standard_deviation]
            off = [abs(error) / scatter.standard_deviation for error in off]
        well += max(off) <= 0.09 and not missing
        if scatter.within_tolerance:
            held += 1
            assert max(off) <= 0.1 + 0.01  # the noise of 20,000
            assert missing <= 5 / SAMPLES
    assert held > 0.9 * well > 0.3 * SCATTERING


def test_an_offset_is_an_error_of_the_mean_alone():
    """What all samples have in common, and the medians not, does not scatter."""
    z = np.random.default_rng(0).normal(size=(4096, 1))
    series = (np.array(1.0), np.array([0.1]), np.zeros((1, 1)))
    moments = _estimate_moments(("intensity",), series, z, 1.0 + 0.1 * z[:, 0] + 0.05)
    # Two standard errors are part of it.
    assert moments.mean_error == pytest.approx(0.5, abs=1e-9)
    assert moments.standard_deviation_error < 0.05


@pytest.mark.thorough
def test_a_deviation_that_is_missed_by_a_third():
    """A margin with a long tail, which first and second order both see the least of."""
    scene = jr.Scene(jr.Block(0.106, 9.33), 0.776, 0.0717)
    variation = {"slenderness": 0.132, "restitution": 0.089, "intensity": 0.261}

    def margin(scene):
        return jr.overturning_margin(scene, jr.Nonlinear())

    found = jr.sensitivity.propagate(margin, scene, jr.Uncertain(variation, samples=1024))
    many = jr.Uncertain(variation, samples=2**17, seed=3)
    samples = jr.sensitivity.monte_carlo(margin, scene, many)
    missed = samples.std() / found.standard_deviation - 1
    assert missed > 0.2
    assert not found.within_tolerance
    assert found.standard_deviation_error > 0.8 * missed
    assert found.left_out == 0
    still = jr.sensitivity.propagate(margin, scene, jr.Uncertain({"intensity": 0.0}))
    assert (still.within_tolerance, still.standard_deviation, still.mean_error) == (True, 0, 0)


def test_scatter_is_what_was_asked_for():
    """Medians and coefficients of variation over the whole domain, by quadrature."""
    medians = [1e-6, 1e-3, 0.05, 0.3, 0.5, 0.7, 0.9, 0.99, 0.999, 1 - 1e-6]
    asked = [
        (name, median, variation)
        for name in ("restitution", "damping_ratio")
        for median in medians
        for variation in (1e-8, 1e-3, 0.05, 0.2)
        if not (median > 0.99 and variation > 0.01)
        and not (median == 0.99 and variation == 0.2)
    ]
    asked += [("half_width", m, v) for m in (1e-3, 1.0, 1e3) for v in (1e-8, 0.05, 0.9)]
    asked += [("start", m, v) for m in (-2.0, 0.0) for v in (0.05, 0.9)]
    asked += [
        ("restitution", 0.99, 0.05),
        ("restitution", 0.0, 0.05),
        ("restitution", 1.0, 0.0),
    ]
    names, median, variation = zip(*asked, strict=True)
    median = np.array(median)
    drawn = [
        jnp.asarray(x) for x in (median, *find_widths(names, median, np.array(variation)))
    ]
    # Gauss's formula; of half as many numbers, since there are poles beside the real axis.
    z, weight = np.polynomial.hermite_e.hermegauss(300)
    found = np.asarray(
        jax.vmap(lambda z: quantiles(z, *drawn))(jnp.asarray(np.append(z, 0.0)))
    )
    weight /= weight.sum()
    np.testing.assert_allclose(found[-1], median, rtol=1e-13)
    above = found[:-1] - found[-1]
    mean = weight @ above
    deviation = (weight @ (above - mean) ** 2) ** 0.5
    realized = deviation / np.maximum(abs(mean + found[-1]), 1e-300)
    expected = np.where(np.asarray(median) == 0, 0, variation)
    np.testing.assert_allclose(realized, expected, rtol=1e-6, atol=1e-15 / 1e-6)
    between = np.array([name != "half_width" and name != "start" for name in names])
    assert (found[:, between] >= 0).all()
    assert (found[:, between] <= 1).all()


def scenes():
    rng = np.random.default_rng(0)
    for k in range(10):
        block = jr.Block(rng.uniform(0.1, 0.8), rng.uniform(2.5, 9))
        c = rng.uniform(0.4, 0.93)
        model = (jr.Linearized(), jr.Nonlinear())[k % 2]
        critical = float(jr.critical_intensity(block, c, jnp.inf, model))
        yield (
            jr.Scene(block, c, critical * rng.uniform(0.7, 1.2)),
            model,
            rng.uniform(0.02, 0.1),
        )


@pytest.mark.thorough
def test_probability_of_overturning():
    """Ten scenes, coefficients of variation of up to 10 %, against 100,000 samples."""
    seen = []
    for scene, model, variation in scenes():

        def margin(scene, model=model):
            return jr.overturning_margin(scene, model)

        scatter = dict.fromkeys(("half_width", "slenderness", "intensity"), 0.1)
        scatter["restitution"] = variation
        uncertain = jr.Uncertain(scatter, samples=2048)
        found = jr.sensitivity.failure_probability(margin, scene, uncertain)
        many = jr.Uncertain(scatter, samples=2**17, seed=1)
        share = (jr.sensitivity.monte_carlo(margin, scene, many) < 0).mean()
        assert found.status == jr.Status.COMPLETE
        assert abs(found.probability - share) < 0.01
        seen.append(found.probability)
    assert min(seen) < 0.1
    assert max(seen) > 0.6


@pytest.mark.thorough
@pytest.mark.release
def test_probability_of_a_driven_outcome():
    block = jr.Block(0.1, 5.0)

    def margin(at):
        pulse = jr.HalfSine(at["amplitude"], at["duration"])
        return jr.respond_batch(block, 0.9, pulse, pulse.end).margin

    at = {"amplitude": 5.0, "duration": 0.27}
    uncertain = jr.Uncertain({"amplitude": 0.1, "duration": 0.1}, samples=2048)
    found = jr.sensitivity.failure_probability(margin, at, uncertain)
    assert found.status == jr.Status.COMPLETE
    rng = np.random.default_rng(4)
    width = np.sqrt(np.log1p(0.1**2))
    many = {k: v * np.exp(width * rng.standard_normal(100_000)) for k, v in at.items()}
    pulses = jr.HalfSine(many["amplitude"], many["duration"])
    share = float(jr.respond_batch(block, 0.9, pulses, pulses.end).overturned.mean())
    assert 0.05 < share < 0.95
    assert abs(found.probability - share) < 0.01


def test_where_the_method_does_not_hold_it_says_so():
    """A margin with a window of survival narrower than the scatter."""

    def margin(at):
        return (at["x"] - 1.05) * (at["x"] - 1.1) * (at["x"] - 0.95)

    def constant(at):
        return 1.0 + 0 * at["x"]

    uncertain = jr.Uncertain({"x": 0.1}, samples=2048)
    contradicted, flat = (
        jr.sensitivity.failure_probability(answer, {"x": 1.0}, uncertain)
        for answer in (margin, constant)
    )
    assert contradicted.status == jr.Status.NOT_VALIDATED
    assert "status              a check contradicts the answer" in str(contradicted)
    assert flat.status == jr.Status.NOT_CONVERGED


def test_global_sensitivities():
    """A sum, whose Sobol indices are the shares of the variance."""
    ranges = {"a": (0.0, 1.0), "b": (0.0, 3.0)}
    found = jr.sensitivity.derivative_based_measures(
        lambda at: at["a"] + at["b"], {"a": 0.5, "b": 0.5}, ranges, samples=50_000
    )
    np.testing.assert_allclose(found.measure, 1)
    np.testing.assert_allclose(found.bound, 12 / np.pi**2 * np.array([0.1, 0.9]), rtol=0.02)
    assert found.left_out == 0


@pytest.mark.float64
def test_a_driven_tornado_against_single_responses():
    """Of a record and of a pulse, by sides and by shape; a block that falls has no answer."""
    block = jr.Block.from_size(width=0.4, height=2.0)
    record = jr.Record(jr.example_record().acceleration[1000:1600], 0.01)
    ranges = {"width": (0.36, 0.44), "restitution": (0.7, 0.9), "scale": (1.2, 8.0)}
    bars = jr.sensitivity.driven_tornado(block, 0.8, record, ranges, scale=1.5)
    assert bars.sides == ("width",)
    lines = dict(zip(bars.names, zip(bars.at_low, bars.at_high, strict=True), strict=True))

    def compute_ratio(width=0.4, restitution=0.8, scale=1.5):
        changed = jr.Block.from_size(width=width, height=2.0)
        motion = record.scaled(scale)
        response = jr.respond(changed, restitution, motion, motion.end + 10.0)
        if response.overturned:
            return math.nan
        return float(response.peak_rotation / changed.critical_angle)

    assert bars.value == pytest.approx(compute_ratio(), rel=1e-6)
    for name, ends in ranges.items():
        expected = [compute_ratio(**{name: end}) for end in ends]
        np.testing.assert_allclose(lines[name], expected, rtol=1e-6)
    assert math.isnan(lines["scale"][1])
    assert bars.names[0] == "scale"
    pulse = jr.Sine(3.0, 0.5)
    shape = {"half_width": (0.19, 0.21), "amplitude": (2.9, 3.1)}
    bars = jr.sensitivity.driven_tornado(
        block, 0.8, pulse, shape, answer="margin", model="linearized"
    )
    changed = jr.Block(0.21, 5.0)
    response = jr.respond(changed, 0.8, pulse, pulse.end, model="linearized")
    row = bars.names.index("half_width")
    assert bars.at_high[row] == pytest.approx(float(response.margin), rel=1e-6)
    # Half as strong and scaled by 2, the pulse is the same, whichever number is varied.
    halves = shape | {"amplitude": (1.45, 1.55)}
    doubled = jr.sensitivity.driven_tornado(
        block, 0.8, pulse.scaled(0.5), halves, answer="margin", scale=2.0, model="linearized"
    )
    assert doubled.value == bars.value
    np.testing.assert_array_equal(
        [doubled.at_low, doubled.at_high], [bars.at_low, bars.at_high]
    )
    with pytest.raises(ValueError, match=r"ranges must be one of .*, got 'mass'"):
        jr.sensitivity.driven_tornado(block, 0.8, pulse, {"mass": (1.0, 2.0)})


@pytest.mark.float64
@pytest.mark.parametrize("curvature", [-0.3, 0.3])
def test_curvature_of_a_limit_state_against_quadrature(curvature):
    """A paraboloid in normal numbers: SORM is near the integral, FORM is not."""
    deviation = 0.1  # of the logarithms
    distance = 1.5

    def margin(at):
        first = jnp.log(at["x"]) / deviation
        second = jnp.log(at["y"]) / deviation
        return distance - first - 0.5 * curvature * second**2

    coefficient = math.sqrt(math.expm1(deviation**2))
    uncertain = jr.Uncertain({"x": coefficient, "y": coefficient}, samples=256)
    result = jr.sensitivity.failure_probability(margin, {"x": 1.0, "y": 1.0}, uncertain)

    def fail(second):
        level = distance - 0.5 * curvature * second**2
        return stats.norm.pdf(second) * stats.norm.sf(level)

    exact = integrate.quad(fail, -10, 10)[0]
    assert result.first_order_probability == pytest.approx(stats.norm.sf(distance), rel=1e-6)
    assert abs(result.probability - exact) < 0.3 * abs(result.first_order_probability - exact)
