"""Derivatives against differences, tornados against single answers, moments against samples."""

import math

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest
from references import closed_forms
from scipy import stats
from tools.selection import first_by_default

import jaxrock as jr

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
    sided = jr.tornado(answer, two, {"a.width": (0.7, 0.9), "b.height": (2.3, 2.5)})
    assert sided.at_low[sided.names.index("a.width")] == pytest.approx(0.35 * 4 + 2)
    single = {"block": jr.Block(0.4, 5.0), "width": 2.0}
    found = jr.sensitivities(lambda at: at["block"].half_width, single, sides=True)
    assert found.names == ("block.width", "height", "gravity", "inertia_ratio", "width")
    with pytest.raises(ValueError, match=r"'height', which is none of a\.width"):
        jr.tornado(answer, two, {"height": (1.0, 2.0)})  # of which of the two?


def beyond_the_threshold():
    return jr.Scene(WALL.block, 0.9, 0.15)


def test_no_derivatives_beyond_the_threshold():
    found = jr.sensitivities(jr.rotation_ratio, beyond_the_threshold())
    for part in (found.gradient, found.hessian, found.error, found.below, found.above):
        assert np.isnan(part).all()


def test_a_tornado_says_where_it_overturns():
    bars = jr.tornado(jr.rotation_ratio, WALL, {"restitution": (0.6, 0.99)})
    assert str(bars).endswith(" overturns   0 to 0.8557")
    threshold = float(jr.critical_restitution(WALL.block, 0.15))
    assert bars.above[0] == pytest.approx(threshold, rel=1e-15)
    assert "overturns" in str(jr.sensitivities(jr.rotation_ratio, beyond_the_threshold()))


def test_tornado():
    ranges = {"slenderness": (4.0, 6.0), "restitution": (0.6, 0.8), "gravity": (9.81, 9.81)}
    found = jr.tornado(jr.rotation_ratio, WALL, ranges)
    assert found.names == ("restitution", "slenderness", "gravity")
    slender = [
        float(jr.rotation_ratio(jr.Scene(jr.Block(0.4, s), 0.7, 0.15))) for s in (4.0, 6.0)
    ]
    np.testing.assert_allclose([found.at_low[1], found.at_high[1]], slender, rtol=1e-12)
    assert found.value == found.at_low[2] == found.at_high[2]


NAMES = ("half_width", "slenderness", "restitution", "intensity")
ANSWERS = (
    jr.overturning_margin,
    jr.rotation_ratio,
    jr.stabilized_period,
    jr.amplification,
    jr.stabilized_rotation,
)


def differentiate_exactly(name, kind, numbers):
    """Derivatives at exactly these numbers, by differences in 120 digits."""

    def compute(half_width, slenderness, gravity, inertia_ratio, restitution, intensity):
        # The equations are those of a rectangle, of which others differ by g and I alone.
        ratio = mp.mpf(4) / 3 / inertia_ratio
        block = half_width, slenderness, gravity * ratio
        if name == "critical_intensity":
            critical = closed_forms.critical_intensity(kind, *block, restitution, mp.inf)
            return critical / ratio
        if name == "critical_restitution":
            given = restitution, intensity * ratio, mp.inf
            return closed_forms.critical_restitution(kind, *block, *given)
        function = closed_forms.stabilized(name)
        return function(kind, *block, restitution, intensity * ratio)

    with mp.workdps(120):
        exact = [mp.mpf(float(number)) for number in numbers]
        value = compute(*exact)
        slopes = []
        for k, number in enumerate(exact):
            moved = exact.copy()
            moved[k] += mp.mpf(10) ** -60 * (number or 1)
            slopes.append((compute(*moved) - value) / (moved[k] - number))
    return slopes


def draw_scene(rng, kind):
    """Of any size, with C near 0 and 1, up to 1e-14 of the threshold."""
    gap = 10 ** rng.uniform([-12, -14], 0)
    c = rng.choice([0.0, 10 ** rng.uniform(-15, 0), rng.uniform(), 1 - gap[0]])
    ratio = rng.choice([10 ** rng.uniform(-12, 0), 1 - gap[1]], p=[0.3, 0.7])
    half_width, slenderness = 10 ** rng.uniform([-4, -1], [3, 4])
    block = jr.Block(half_width, slenderness, inertia_ratio=rng.uniform(1, 2))
    b, height_ratio, gravity, inertia, c = map(
        mp.mpf, map(float, (*jax.tree.leaves(block), c))
    )
    gravity *= mp.mpf(4) / 3 / inertia
    critical = closed_forms.critical_intensity(kind, b, height_ratio, gravity, c, mp.inf)
    return jr.Scene(block, float(c), float(critical * inertia * 3 / 4) * ratio)


def critical_intensity(scene, model):
    return jr.critical_intensity(scene.block, scene.restitution, model=model)


def critical_restitution(scene, model):
    return jr.critical_restitution(scene.block, scene.intensity, model=model)


CRITICAL = (critical_intensity, critical_restitution)


@pytest.mark.parametrize("model", [jr.Linearized(), jr.Nonlinear()])
@pytest.mark.parametrize("answer", first_by_default((*CRITICAL, *ANSWERS), 3))
def test_errors_by_rounding_bound_those_against_exact_arithmetic(answer, model):
    """And near the threshold, where they matter, are 5 to 30 times too large in the median."""
    rng = np.random.default_rng(1)
    kind = getattr(closed_forms, type(model).__name__)

    def compute(scene):
        return answer(scene, model)

    factors = []
    for _ in range(100):
        scene = draw_scene(rng, kind)
        found = jr.sensitivities(compute, scene)
        if answer is not jr.overturning_margin and np.isnan(found.value):
            continue  # rounding has taken it beyond the threshold
        exact = differentiate_exactly(answer.__name__, kind, found.at)
        pairs = zip(found.gradient, exact, strict=True)
        errors = np.array([float(abs(mp.mpf(slope) - other)) for slope, other in pairs])
        assert (errors <= found.error).all(), (scene, found, errors)
        matters = (found.error > 1e-10 * abs(found.gradient)) & (errors > 0)
        factors += [*(found.error[matters] / errors[matters])]
    if answer not in (*CRITICAL, jr.overturning_margin):
        assert 5 < np.median(factors) < 30
        assert len(factors) > 100


@pytest.mark.parametrize("model", [jr.Linearized(), jr.Nonlinear()])
def test_ranges_end_at_the_threshold_and_at_the_ends_of_domains(model):
    scene = jr.Scene(jr.Block(0.4, 5.0, inertia_ratio=1.3), restitution=0.7, intensity=0.15)
    found = jr.sensitivities(lambda at: jr.rotation_ratio(at, model), scene)
    given = scene.block, 0.7, 0.15
    ends = {
        "half_width": (jr.critical_width(*given, model=model) / 2, np.inf),
        "slenderness": (0, jr.critical_slenderness(*given, model=model)),
        "inertia_ratio": (1, np.inf),
        "restitution": (0, jr.critical_restitution(scene.block, 0.15, model=model)),
        "intensity": (0, jr.critical_intensity(scene.block, 0.7, model=model)),
    }
    for name, expected in ends.items():
        k = found.names.index(name)
        np.testing.assert_allclose((found.below[k], found.above[k]), expected, rtol=1e-14)
    # Nearer than any distance tried first; and many points are as each of them.
    near = float(ends["intensity"][1]) * (1 - np.array([1e-13, 0.5]))
    answer = jr.rotation_ratio
    found = jr.derivatives_within(scene.block, 0.7, near, 1e-9, of=answer, model=model)
    np.testing.assert_array_equal(found.below["intensity"], 0)
    limit = float(ends["intensity"][1])
    np.testing.assert_allclose(found.above["intensity"], limit, rtol=1e-15)


def draw_answers(answer, scene, variations, count, seed=1):
    """Compute answers at samples by another generator and the distributions of SciPy."""
    rng = np.random.default_rng(seed)
    names = ("half_width", "slenderness")
    values = {name: np.full(count, float(getattr(scene.block, name))) for name in names}
    values |= {name: np.full(count, float(getattr(scene, name))) for name in NAMES[2:]}
    for name, variation in variations.items():
        mean = values[name][0]
        if name == "restitution":
            total = (1 - mean) / (mean * variation**2) - 1
            values[name] = rng.beta(mean * total, (1 - mean) * total, count)
        else:
            values[name] *= np.exp(np.log1p(variation**2) ** 0.5 * rng.standard_normal(count))
    block = jr.Block(values["half_width"], values["slenderness"])
    return np.asarray(answer(jr.Scene(block, values["restitution"], values["intensity"])))


@pytest.mark.thorough
def test_moments():
    coefficients = {"half_width": 0.03, "restitution": 0.01, "intensity": 0.04}
    uncertain = jr.Uncertain(coefficients, samples=1024)
    found = jr.sensitivity.propagate(jr.rotation_ratio, WALL, uncertain)
    samples = draw_answers(jr.rotation_ratio, WALL, coefficients, 2**20)
    assert found.mean == pytest.approx(samples.mean(), rel=1e-3)
    assert found.standard_deviation == pytest.approx(samples.std(), rel=1e-2)
    assert found.within_tolerance
    # Near the overturning threshold, samples that overturn have no answer: no derivative sees
    # it.
    near = jr.Scene(WALL.block, 0.7, 0.28)
    uncertain = jr.Uncertain({"restitution": 0.05, "intensity": 0.1}, samples=2048)
    moments = jr.sensitivity.propagate(jr.rotation_ratio, near, uncertain)
    assert moments.left_out > 0.2
    assert not moments.within_tolerance
    # Second order is nearer than first.
    assert abs(found.mean - samples.mean()) < 0.2 * abs(
        found.first_order_mean - samples.mean()
    )
    assert sum(found.variance_fractions.values()) == pytest.approx(1)


@pytest.mark.thorough
@pytest.mark.parametrize("model", [jr.Linearized(), jr.Nonlinear()])
@pytest.mark.parametrize("answer", ANSWERS)
def test_what_is_within_tolerance_is_as_good_as_is_said(answer, model):
    """Mean to a tenth of the deviation, deviation to 10 %, against 20,000 other samples."""
    rng = np.random.default_rng(20)
    held = well = 0
    samples = 1024

    def compute(scene):
        return answer(scene, model)

    for _ in range(100):
        block = jr.Block(10 ** rng.uniform(-1.3, 0), 10 ** rng.uniform(0.3, 1.3))
        c = rng.uniform(0.2, 0.97)
        critical = float(jr.critical_intensity(block, c, model=jr.Nonlinear()))
        scene = jr.Scene(block, c, rng.uniform(0.02, 1.05) * critical)
        largest = 10 ** rng.uniform(-2, -0.5) * np.array([1, 1, 0.3, 1])
        variations = dict(zip(NAMES, largest * rng.uniform(0.1, 1, 4), strict=True))
        uncertain = jr.Uncertain(variations, samples=samples)
        moments = jr.sensitivity.propagate(compute, scene, uncertain)
        others = draw_answers(compute, scene, variations, 20_000)
        missing = np.isnan(others).mean()
        others = others[np.isfinite(others)]
        off = [np.inf, np.inf]
        if others.size and moments.standard_deviation > 0:
            off = [others.mean() - moments.mean, others.std() - moments.standard_deviation]
            off = [abs(error) / moments.standard_deviation for error in off]
        well += max(off) <= 0.09 and not missing
        if moments.within_tolerance:
            held += 1
            assert max(off) <= 0.1 + 0.01  # the noise of 20,000
            assert missing <= 5 / samples
    assert held > 0.85 * well > 25


def test_an_offset_is_an_error_of_the_mean_alone():
    """What all samples have in common, and the medians not, is no deviation."""

    def answer(at):
        offset = jnp.where(at["x"] == 2.0, 0.0, 0.05)
        return 1.0 + 0.1 * jnp.log(at["x"] / 2) / np.log1p(0.01) ** 0.5 + offset

    uncertain = jr.Uncertain({"x": 0.1}, samples=4096)
    moments = jr.sensitivity.propagate(answer, {"x": 2.0}, uncertain)
    # Two standard errors are part of it.
    assert moments.mean_error == pytest.approx(0.5, abs=1e-9)
    assert moments.standard_deviation_error < 0.05


def test_moments_of_correlated_parameters():
    """Of a sum of logarithms, against its closed form."""
    uncertain = jr.Uncertain(
        {"x": 0.1, "y": 0.2}, correlations={("x", "y"): 0.6}, samples=1024
    )

    def answer(at):
        return 0.6 + jnp.log(at["x"] / 2) - 0.8 * jnp.log(at["y"] / 3)

    parts = np.log1p(np.array([0.1, 0.2]) ** 2) ** 0.5 * np.array([1.0, -0.8])
    deviation = np.sqrt(parts @ np.array([[1.0, 0.6], [0.6, 1.0]]) @ parts)
    moments = jr.sensitivity.propagate(answer, {"x": 2.0, "y": 3.0}, uncertain)
    assert moments.mean == pytest.approx(0.6, rel=1e-9)
    assert moments.first_order_standard_deviation == pytest.approx(deviation, rel=1e-9)
    assert moments.standard_deviation == pytest.approx(deviation, rel=1e-9)
    assert moments.within_tolerance
    assert moments.variance_fractions == {}
    assert "variance fractions" not in str(moments)
    # Of z + z^2, where z is normal, the second order is exact: variances w^2 + 2 w^4.
    single = jr.Uncertain({"x": 0.1}, samples=1024)
    moments = jr.sensitivity.propagate(
        lambda at: jnp.log(at["x"] / 2) + jnp.log(at["x"] / 2) ** 2, {"x": 2.0}, single
    )
    square = np.log1p(0.01)
    assert moments.mean == pytest.approx(square, rel=1e-9)
    assert moments.standard_deviation**2 == pytest.approx(square + 2 * square**2, rel=1e-9)


@pytest.mark.parametrize(("name", "value"), [("restitution", 0.8), ("x", 2.0), ("x", -2.0)])
def test_second_order_of_one_parameter(name, value):
    """Expansions of quantiles, against differences of SciPy's."""
    variation = 0.1
    distribution = {
        0.8: stats.beta(0.8 * 24, 0.2 * 24),
        2.0: stats.lognorm(np.log1p(variation**2) ** 0.5, scale=2.0),
    }[abs(value)]
    h = 1e-3
    low, middle, high = np.sign(value) * distribution.ppf(stats.norm.cdf([-h, 0.0, h]))
    expected = (middle, (high - low) / (2 * h), (high - 2 * middle + low) / h**2)
    found = jr.sensitivity.distributions.expand_quantile(name, value, variation)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)


@pytest.mark.float64
def test_a_driven_tornado_against_single_responses():
    """Of a record and of a pulse, by sides and by shape; a block that falls has no answer."""
    block = jr.Block.from_size(width=0.4, height=2.0)
    record = jr.Record(1.5 * jr.example_record().acceleration[1000:1600], 0.01)
    ranges = {"width": (0.36, 0.44), "restitution": (0.7, 0.9), "factor": (0.8, 5.0)}
    bars = jr.sensitivity.driven_tornado(block, 0.8, record, ranges)
    lines = dict(zip(bars.names, zip(bars.at_low, bars.at_high, strict=True), strict=True))

    def compute_ratio(width=0.4, restitution=0.8, factor=1.0):
        changed = jr.Block.from_size(width=width, height=2.0)
        motion = record.scaled(factor)
        response = jr.respond(changed, restitution, motion, motion.end + 10.0)
        if response.overturned:
            return math.nan
        return float(response.peak_rotation / changed.critical_angle)

    assert bars.value == pytest.approx(compute_ratio(), rel=1e-6)
    for name, ends in ranges.items():
        expected = [compute_ratio(**{name: end}) for end in ends]
        np.testing.assert_allclose(lines[name], expected, rtol=1e-6)
    assert math.isnan(lines["factor"][1])
    assert bars.names[0] == "factor"
    pulse = jr.Sine(3.0, 0.5)
    shape = {"half_width": (0.19, 0.21), "amplitude": (2.9, 3.1)}
    bars = jr.sensitivity.driven_tornado(
        block, 0.8, pulse, shape, answer="margin", model="linearized"
    )
    changed = jr.Block(0.21, 5.0)
    response = jr.respond(changed, 0.8, pulse, pulse.end, model="linearized")
    row = bars.names.index("half_width")
    assert bars.at_high[row] == pytest.approx(float(response.margin), rel=1e-6)
    with pytest.raises(ValueError, match=r"ranges has 'mass', which is none of"):
        jr.sensitivity.driven_tornado(block, 0.8, pulse, {"mass": (1.0, 2.0)})
