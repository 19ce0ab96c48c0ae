"""The value from which on a rate stays below a target: closed form, brute force, reasons."""

import sys

import jax
import mpmath
import numpy as np
import pytest
from references.half_sine_rates import DURATIONS, closed_rate, hazard, pulses, verge
from scipy import optimize

import jaxrock as jr

DOUBLE, SLOW = pytest.mark.float64, pytest.mark.thorough
HEIGHT, TARGET, BOUNDS = 2.0, 6e-5, (0.3, 1.2)
CABINET = jr.Block.from_size(width=0.5, height=HEIGHT)
LEVELS = np.geomspace(0.5, 12.0, 600)
OPTIONS = {"levels": LEVELS, "model": "linearized"}


def rate_of_width(width, height=HEIGHT):
    """In closed form."""
    return closed_rate("pgv", width / 2, height / width, 4 / 3)


def find_width(target=TARGET, height=HEIGHT):
    return optimize.brentq(lambda w: float(rate_of_width(w, height)) - target, *BOUNDS)


@DOUBLE
def test_width_at_this_height_in_closed_form():
    """Within the resolution and the error of the count, for one target and for several."""
    suite = pulses(200)
    exact = find_width()
    found = jr.required_value(CABINET, 0.85, suite, hazard, TARGET, bounds=BOUNDS, **OPTIONS)
    steepness = abs(float(mpmath.diff(rate_of_width, exact)))
    assert abs(float(found.value) - exact) < 0.005 * exact + 3 * found.error / steepness
    assert float(found.error) < 0.02 * TARGET
    assert float(found.rate) <= TARGET
    assert float(found.recount) == pytest.approx(float(found.rate), abs=4 * float(found.error))
    assert int(found.count) == 1
    assert float(found.crossings[0]) == float(found.value)
    assert f"{float(found.value):.6g} m, width at this height: from there on" in str(found)


@DOUBLE
def test_many_objects_at_once():
    """Each has the bits that it has alone; bounds and targets may be its own."""
    suite, heights = pulses(100), np.array([1.5, 2.0])
    blocks = jr.Block.from_size(width=0.5, height=heights)
    options = {**OPTIONS, "levels": LEVELS[::20]}
    low = np.array([0.25, 0.3])
    many = jr.required_value(
        blocks, 0.85, suite, hazard, np.array([6e-5, 5e-5]), bounds=(low, 1.2), **options
    )
    alone = jr.required_value(CABINET, 0.85, suite, hazard, 5e-5, bounds=(0.3, 1.2), **options)
    for name in ("value", "rate", "recount", "error", "count"):
        one, all_ = np.asarray(getattr(alone, name)), np.asarray(getattr(many, name))
        assert one.tobytes() == all_[1].tobytes(), name
    assert len(many.reasons) == 2


@DOUBLE
@SLOW
def test_derivatives_by_the_implicit_function_theorem():
    suite = pulses(400)

    def value(target, height):
        block = jr.Block.from_size(width=0.5, height=height)
        arguments = (block, 0.85, suite, hazard, target, "width", BOUNDS)
        return jr.required_value(*arguments, **{**OPTIONS, "levels": LEVELS[::10]}).value

    slopes = jax.grad(value, (0, 1))(TARGET, HEIGHT)
    # At the value that was found, which is off by the error of the count.
    found = float(value(TARGET, HEIGHT))
    assert found == pytest.approx(find_width(), rel=0.02)
    of_width = mpmath.diff(rate_of_width, found)
    of_height = mpmath.diff(lambda h: rate_of_width(found, h), HEIGHT)
    assert float(slopes[0]) == pytest.approx(float(1 / of_width), rel=1e-3)
    assert float(slopes[1]) == pytest.approx(float(-of_height / of_width), rel=1e-3)
    forward = jax.jvp(value, (TARGET, HEIGHT), (1e-6, 0.0))[1]
    assert float(forward) == pytest.approx(1e-6 * float(slopes[0]), rel=1e-9)


def sine_suite():
    """Pulses of a full sine, above whose first boundary there are windows of survival."""
    along = np.sin(np.linspace(0, 2 * np.pi, 100))
    return jr.Suite([jr.Record(along, duration / 100) for duration in (0.4, 0.6)])


def count_by_hand(widths, height, restitution, suite, levels):
    """Rates at all widths, from the outcomes of `respond_batch`, by midpoints in the level."""
    middle = np.sqrt(levels[1:] * levels[:-1])
    edges = np.concatenate([[hazard(levels[0])], hazard(middle), [0.0]])
    blocks = jr.Block.from_size(width=widths[:, None], height=height)
    scaled = suite.scaled(suite.factors(levels, "pgv"))
    outcomes = jr.respond_batch(blocks, restitution, scaled, model="linearized").overturned
    return (np.asarray(outcomes) @ (edges[:-1] - edges[1:])).mean(axis=0)


@DOUBLE
@pytest.mark.parametrize("objects", [1, pytest.param(20, marks=[SLOW, pytest.mark.release])])
def test_against_brute_force(objects):
    """Beyond the value every rate of a fine grid is below the target, just before it one above.

    Under sines a wider block may overturn where a narrower one survives: there are several
    crossings, all of which are reported.
    """
    random, suite, levels = np.random.default_rng(3), sine_suite(), np.geomspace(0.2, 4.0, 25)
    number = 400 if objects == 1 else 2000
    crossings = 0
    for _ in range(objects):
        height = random.uniform(0.8, 2.0)
        restitution = random.uniform(0.7, 0.95)
        bounds = (0.1 * height, 0.8 * height)
        widths = np.geomspace(*bounds, number)
        rates = count_by_hand(widths, height, restitution, suite, levels)
        target = float(np.quantile(rates, random.uniform(0.2, 0.8))) * 1.0001
        block = jr.Block.from_size(width=1.0, height=height)
        found = jr.required_value(
            block,
            restitution,
            suite,
            hazard,
            target,
            bounds=bounds,
            levels=levels,
            resolution=1e-3,
            model="linearized",
        )
        last = np.flatnonzero(rates > target)[-1]
        assert widths[last] * 0.998 < float(found.value) < widths[last + 1] * 1.002
        changes = np.flatnonzero(np.diff((rates > target).astype(int)))
        listed = np.asarray(found.crossings)[: int(found.count)]
        for at in changes:
            nearest = np.min(abs(listed / widths[at] - 1))
            assert nearest < 2 * (widths[1] / widths[0] - 1) + 2e-3
        crossings += changes.size
    assert crossings > objects


@DOUBLE
@pytest.mark.parametrize(
    ("change", "value", "reason"),
    [
        (
            {"target": 1e-7},
            np.inf,
            "none: at the upper bound, 1.2 m, width at this height, it",
        ),
        ({"target": 1e-2}, 0.3, "0.3 m, width at this height: the rate is below 0.01 at all"),
        ({"along": "height", "side": "below", "bounds": (0.5, 5.0)}, None, "up to there the"),
        ({"along": "height", "bounds": (0.5, 5.0)}, np.inf, "none: at the upper bound, 5 m,"),
        (
            {"along": "half_width", "bounds": (0.1, 2.0)},
            None,
            "half-width at this slenderness",
        ),
        ({"along": "restitution", "bounds": (0.0, 1.0)}, np.inf, "1 restitution, it is still"),
    ],
)
def test_what_the_answer_says(change, value, reason):
    arguments = {"target": TARGET, "bounds": BOUNDS, **OPTIONS, "levels": LEVELS[::20]}
    found = jr.required_value(CABINET, 0.85, pulses(100), hazard, **(arguments | change))
    assert reason in str(found)
    if value is not None:
        assert float(found.value) == value
    else:
        assert np.isfinite(float(found.value))


@DOUBLE
@SLOW
def test_derivatives_where_the_rate_is_not_smooth(monkeypatch):
    """NaN in both modes; 0 where the value does not move, and nothing of one in another."""
    suite, levels = sine_suite(), np.geomspace(0.2, 4.0, 25)
    blocks = jr.Block.from_size(width=1.0, height=np.array([1.2, 1.2, 1.2]))
    # The first counts as rough here, the second has no value, the third is safe at all.
    module = sys.modules["jaxrock.risk.required_value"]
    monkeypatch.setattr(module, "_SMOOTH", 0.0)
    targets = np.array([6.3e-4, 1e-7, 1.0])

    def values(targets):
        return jr.required_value(
            blocks,
            0.9,
            suite,
            hazard,
            targets,
            bounds=(0.15, 0.9),
            levels=levels,
            model="linearized",
        ).value

    found, pull = jax.vjp(values, targets)
    reverse = np.asarray(pull(np.ones(3))[0])
    _, forward = jax.jvp(values, (targets,), (np.ones(3),))
    np.testing.assert_array_equal(np.isfinite(found), [True, False, True])
    np.testing.assert_array_equal(reverse, [np.nan, 0.0, 0.0])
    np.testing.assert_array_equal(forward, [np.nan, 0.0, 0.0])


@DOUBLE
@SLOW
def test_a_probability():
    """At one level: two of three pulses at most, from the width that the second one needs."""
    level = 1.6
    widths = sorted(
        optimize.brentq(
            lambda w, d=d: float(verge("pgv", d, w / 2, HEIGHT / w, 4 / 3)) - level, 0.1, 3.0
        )
        for d in DURATIONS
    )
    for target, exact in ((0.5, widths[1]), (0.9, widths[0]), (0.1, widths[2])):
        found = jr.required_value(
            CABINET,
            0.85,
            pulses(400),
            level,
            target,
            bounds=(0.1, 3.0),
            resolution=1e-4,
            model="linearized",
        )
        assert float(found.value) == pytest.approx(exact, rel=2e-4)
    slope = jax.grad(
        lambda t: (
            jr.required_value(
                CABINET, 0.85, pulses(400), level, t, bounds=(0.1, 3.0), model="linearized"
            ).value
        )
    )(0.5)
    assert np.isnan(float(slope))


@pytest.mark.thorough
def test_under_a_hazard_with_zeros():
    """A width whose rate is the target, on a curve with level stretches that ends in zeros."""
    levels = [0.5, 2.5, 3.0, 5.0, 6.0, 12.0, 20.0]
    curve = jr.Hazard(levels, [1e-2, 1e-4, 1e-4, 2e-5, 2e-5, 0.0, 0.0])
    arguments = {"bounds": (0.3, 2.0), "model": "linearized"}
    found = jr.required_value(CABINET, 0.85, pulses(400), curve, 3e-5, **arguments)

    def rate(width):
        shape = width / 2, HEIGHT / width, 4 / 3
        verges = [float(verge("pgv", duration, *shape)) for duration in DURATIONS]
        places = np.log(verges)
        rates = np.asarray(curve.rates)
        in_logarithms = np.exp(np.interp(places, np.log(levels[:5]), np.log(rates[:5])))
        falling = np.interp(places, np.log(levels), rates)
        return np.where(places < np.log(6.0), in_logarithms, falling).mean()

    assert rate(float(found.value) * 1.01) < 3e-5 < rate(float(found.value) * 0.98)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"along": "mass"}, "along must be one of width, height, .*, got 'mass'"),
        ({"bounds": (1.0, 0.5)}, "bounds must be a lower and a higher value, got 1.0 and 0.5"),
        ({"bounds": (0.0, 0.5)}, "bounds must be finite and greater than 0, got 0"),
        ({"bounds": (0.5,)}, "bounds must be two, a lower and an upper one, got 1"),
        ({"target": 0.0}, "target must be finite and greater than 0, got 0"),
        ({"target": 1.5, "hazard": 0.5}, "target must be less than 1 for a probability"),
        ({"hazard": -0.5}, "hazard must be finite and greater than 0, got -0.5"),
        ({"hazard": "often"}, "hazard must be a Hazard or a function"),
        ({"side": "left"}, "side must be one of above, below, got 'left'"),
        ({"resolution": 0.5}, "resolution must be at least 1e-6 and less than 0.1, got 0.5"),
        ({"resolution": 1e-17}, "resolution must be at least 1e-6 and less than 0.1"),
        ({"hazard": lambda x: x}, "the rates of the hazard must fall with the level"),
        ({"hazard": lambda x: x * np.nan}, "the rates of the hazard must be finite and"),
        ({"hazard": 0.5, "target": 0.5}, "levels go with a hazard only, not with one level"),
        (
            {"target": np.array([1e-5, 2e-5])},
            "single ones, or one for each object, got shapes",
        ),
        ({"measure": "pgv_ratio"}, "measure must be one of pga, pgv, got 'pgv_ratio'"),
    ],
)
def test_what_is_refused(monkeypatch, change, message):
    import jaxtyping

    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    arguments = {"hazard": hazard, "target": TARGET, "bounds": BOUNDS, "levels": LEVELS}
    # One level has none beside it, but where that is what is refused.
    if isinstance(change.get("hazard"), float) and "levels go" not in message:
        arguments["levels"] = None
    with pytest.raises(ValueError, match=message) as error:
        jr.required_value(CABINET, 0.85, pulses(4), **(arguments | change))
    assert "\n" not in str(error.value)


def test_not_under_jit():
    with pytest.raises(ValueError, match="arguments must be concrete here"):
        jax.jit(
            lambda c: (
                jr.required_value(
                    CABINET, c, pulses(4), hazard, TARGET, bounds=BOUNDS, levels=LEVELS
                ).value
            )
        )(0.8)
