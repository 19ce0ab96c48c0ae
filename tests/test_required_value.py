"""The value from which on a rate stays below a target: closed form, brute force, reasons."""

import jax
import mpmath
import numpy as np
import pytest
import scenes
from references.half_sine_rates import closed_rate, hazard, pulses
from scipy import optimize

import jaxrock as jr

DOUBLE = pytest.mark.float64
SLOW = pytest.mark.thorough
HEIGHT = 2.0
TARGET = 6e-5
BOUNDS = (0.3, 1.2)
CABINET = jr.Block.from_size(width=0.5, height=HEIGHT)
LEVELS = np.geomspace(0.5, 12.0, 600)
LINEARIZED = {"model": "linearized"}


def site_of_pulses(samples, levels=LEVELS[::20]):
    return jr.risk.Site(pulses(samples), hazard, levels=levels)


def rate_of_width(width, height=HEIGHT):
    """In closed form."""
    return closed_rate("pgv", width / 2, height / width, 4 / 3)


def find_width(target=TARGET, height=HEIGHT):
    return optimize.brentq(lambda w: float(rate_of_width(w, height)) - target, *BOUNDS)


def sine_suite(cycles=1):
    """Full sines, above whose first boundary there are windows of survival."""
    along = np.sin(np.linspace(0, 2 * np.pi * cycles, 100 * cycles))
    return jr.Suite([jr.Record(along, duration / 100) for duration in (0.4, 0.6)])


@DOUBLE
def test_width_at_this_height_in_closed_form():
    """Within the resolution, on the safe side."""
    exact = find_width()
    answer = jr.risk.required_value(
        CABINET, 0.85, site_of_pulses(200), TARGET, "width", BOUNDS, **LINEARIZED
    )
    assert exact * (1 - 1e-5) < float(answer.value) < exact * 1.005
    assert float(answer.rate) <= TARGET
    assert float(answer.rate) == pytest.approx(
        float(rate_of_width(float(answer.value))), rel=1e-5
    )
    assert int(answer.count) == 1
    assert float(answer.crossings[0]) == float(answer.value)
    assert f"{float(answer.value):.6g} m, width at this height: from there on" in str(answer)


@DOUBLE
@pytest.mark.parametrize(
    ("make_suite", "cases"),
    [
        (sine_suite, 3),
        pytest.param(sine_suite, 23, marks=SLOW),
        pytest.param(scenes.suite, 23, marks=SLOW),
    ],
)
def test_the_rate_at_the_value_is_not_above_the_target(make_suite, cases):
    """It is the one of `overturning_rate` there, and not interpolated."""
    rng = np.random.default_rng(11)
    height = rng.uniform(0.6, 2.0, cases)
    restitution = rng.uniform(0.6, 0.9, cases)
    curve = jr.risk.Hazard([0.1, 0.4, 1.0, 4.0], [1e-2, 1e-3, 1e-4, 1e-6])
    site = jr.risk.Site(make_suite(), curve, spacing=0.02)
    width = height * rng.uniform(0.12, 0.3, cases)
    block = jr.Block.from_size(width=width, height=height)
    target = np.asarray(jr.risk.overturning_rate(block, restitution, site).rate)
    bounds = (0.08 * height, 0.6 * height)
    answer = jr.risk.required_value(block, restitution, site, target, "width", bounds)
    assert np.isfinite(answer.value).all()
    assert (np.asarray(answer.rate) <= target).all()
    changed = jr.Block.from_size(width=np.asarray(answer.value), height=height)
    exact = jr.risk.overturning_rate(changed, restitution, site)
    np.testing.assert_allclose(answer.rate, exact.rate, rtol=1e-9)


@DOUBLE
def test_derivatives_by_the_implicit_function_theorem():
    def value(target, height):
        block = jr.Block.from_size(width=0.5, height=height)
        site = site_of_pulses(400, LEVELS[::10])
        answer = jr.risk.required_value(
            block, 0.85, site, target, "width", BOUNDS, **LINEARIZED
        )
        return answer.value

    derivatives = jax.grad(value, (0, 1))(TARGET, HEIGHT)
    # At the value, which is off by the resolution.
    width = float(value(TARGET, HEIGHT))
    of_width = mpmath.diff(rate_of_width, width)
    of_height = mpmath.diff(lambda h: rate_of_width(width, h), HEIGHT)
    assert float(derivatives[0]) == pytest.approx(float(1 / of_width), rel=1e-3)
    assert float(derivatives[1]) == pytest.approx(float(-of_height / of_width), rel=1e-3)
    forward = jax.jvp(value, (TARGET, HEIGHT), (1e-6, 0.0))[1]
    assert float(forward) == pytest.approx(1e-6 * float(derivatives[0]), rel=1e-9)


@DOUBLE
@pytest.mark.parametrize(
    ("cycles", "objects"),
    [
        pytest.param(1, 1, marks=SLOW),
        pytest.param(1, 20, marks=[SLOW, pytest.mark.release]),
        pytest.param(2, 20, marks=[SLOW, pytest.mark.release]),
    ],
)
def test_against_brute_force(cycles, objects):
    """Beyond the value every rate of a fine grid is below the target, just before it one above.

    Under one cycle all crossings are reported. Under two, windows as narrow as the steps of the
    levels come and go with the width: the rates are known up to what is not detected.
    """
    random = np.random.default_rng(3)
    site = jr.risk.Site(sine_suite(cycles), hazard, levels=np.geomspace(0.2, 4.0, 200))
    for _ in range(objects):
        height = random.uniform(0.8, 2.0)
        restitution = random.uniform(0.7, 0.95)
        bounds = (0.1 * height, 0.8 * height)
        widths = np.geomspace(*bounds, 400)
        blocks = jr.Block.from_size(width=widths, height=height)
        exact = jr.risk.overturning_rate(blocks, restitution, site, **LINEARIZED)
        rates = np.asarray(exact.rate)
        unknown = np.asarray(exact.not_detected)
        target = float(np.quantile(rates, random.uniform(0.2, 0.8))) * 1.0001
        block = jr.Block.from_size(width=1.0, height=height)
        answer = jr.risk.required_value(
            block, restitution, site, target, "width", bounds, **LINEARIZED
        )
        beyond = widths > float(answer.value)
        before = np.flatnonzero(~beyond)[-1]
        slack = unknown if cycles > 1 else np.zeros(400)
        assert (rates[beyond] <= target + slack[beyond]).all()
        # The grid is 0.5 % apart, and so close is the value to the crossing.
        assert max(rates[before - 1 : before + 1]) > target - slack[before]
        if cycles == 1:
            listed = np.asarray(answer.crossings)[: int(answer.count)]
            for at in np.flatnonzero(np.diff((rates > target).astype(int))):
                nearest = np.min(abs(listed / widths[at] - 1))
                assert nearest < 2 * (widths[1] / widths[0] - 1) + 6e-3


@DOUBLE
@pytest.mark.parametrize(
    ("change", "value", "reason"),
    [
        (
            {"target": 1e-7},
            np.inf,
            "none: at the upper bound, 1.2 m, width at this height, the rate",
        ),
        ({"target": 1e-2}, 0.3, "width at this height: the rate is below 0.01 1/yr at all"),
        ({"along": "height", "bounds": (0.5, 5.0)}, None, "up to there the"),
        (
            {"along": "restitution", "bounds": (0.0, 1.0), "target": 5e-5},
            -np.inf,
            "above 5e-05 1/yr",
        ),
    ],
)
def test_what_the_answer_says(change, value, reason):
    arguments = {"target": TARGET, "bounds": BOUNDS, **LINEARIZED} | change
    found = jr.risk.required_value(CABINET, 0.85, site_of_pulses(100), **arguments)
    assert reason in str(found)
    if value is not None:
        assert float(found.value) == value
    else:
        assert np.isfinite(float(found.value))


@DOUBLE
def test_a_hazard_that_ends_before_the_target():
    """No value can be shown to suffice where the last rate exceeds the target."""
    levels = np.geomspace(0.7, 1.6, 30)
    target = 0.5 * float(hazard(levels[-1]))
    site = site_of_pulses(100, levels=levels)
    found = jr.risk.required_value(CABINET, 0.85, site, target, bounds=BOUNDS, **LINEARIZED)
    assert np.isnan(float(found.value))
    assert f"continue it to {2.5 / target:,.0f} or ask for a target above it" in str(found)
