"""What simplifying costs, predicted: never less than the truth, and not much more."""

import functools
import itertools

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest
from references import closed_forms
from tables.random_scenes import NUMBER, Answers, apart, computed, each, lasting_scenes, scenes
from tools.selection import first_by_default

import jaxrock as jr
from jaxrock.accuracy.cheapest_setting import CLOSED

pytestmark = pytest.mark.float64
COMPARED = 60


def exactly(scene):
    block = scene.block
    numbers = (block.half_width, block.slenderness, block.gravity, scene.restitution)
    return tuple(mp.mpf(float(number)) for number in (*numbers, scene.intensity))


@functools.cache
def given_in(precision):
    """Scenes in a precision, what is predicted for them, and the answers of the first few."""
    given = jax.tree.map(lambda leaf: jnp.asarray(leaf, precision), scenes(3, NUMBER))
    truth = {name: [] for name in Answers.__dataclass_fields__}
    for k in range(COMPARED):
        arguments = exactly(each(given, k))
        for name in ("rotation_ratio", "stabilized_period"):
            exact = closed_forms.stabilized(name)(closed_forms.Nonlinear, *arguments)
            truth[name.removeprefix("stabilized_")].append(exact)
        exact = closed_forms.critical_intensity(closed_forms.Nonlinear, *arguments[:4], mp.inf)
        truth["critical_intensity"].append(exact)
    return given, jr.accuracy.model_error(given), truth


@pytest.mark.parametrize("precision", first_by_default(["float64", "float32"]))
@pytest.mark.parametrize("setting", CLOSED, ids=str)
def test_prediction_against_mpmath(setting, precision):
    """What is predicted from a scene in float32 bounds what is computed from it in float64."""
    given, error, truths = given_in(precision)
    predicted = error.total(setting.level, setting.bits)
    found = computed(given, setting)
    ratios = []
    for name, truth in truths.items():
        for k, exact in enumerate(truth):
            ours = float(getattr(found, name)[k])
            bound = float(getattr(predicted, name)[k])
            if isinstance(exact, mp.mpc):
                assert np.isnan(ours) or bound == np.inf
                continue
            off = abs(mp.mpf(ours) / exact - 1) if np.isfinite(ours) else mp.inf
            assert off <= bound, (name, k)
            if 0 < off < mp.inf and bound < np.inf:
                ratios.append(float(bound / off))
    # A sure bound on rounding is several times what usually happens; that of a model is exact.
    assert np.median(ratios) < (1.1 if setting.level == "linearized" else 15)


@pytest.mark.thorough
@pytest.mark.parametrize("shape", [jr.HalfSine, jr.Rectangular])
def test_cost_of_the_duration_within_its_bound(shape):
    """All three answers of stocky and slender blocks, standing and overturning."""
    stockiest = 0.5
    scene, duration, truth, lifted = lasting_scenes(11, NUMBER, shape)
    error = jr.accuracy.model_error(scene, shape, duration)
    closed = computed(scene, CLOSED[-1])
    stocky = np.asarray(scene.block.slenderness) < stockiest
    weak = duration * 9.81 / np.asarray(scene.block.slenderness * scene.intensity) > 0.8
    assert min(stocky.mean(), weak.mean()) > 0.02
    for name, exact in vars(truth).items():
        cost = apart(getattr(closed, name), exact)
        estimate = getattr(error.duration, name)
        unsure = getattr(error.duration_bound, name)
        total = np.asarray(getattr(error.total("nonlinear", 64), name))
        known = np.isfinite(np.asarray(unsure)) & ~np.isnan(total)
        assert not (known & stocky).any()
        if name != "critical_intensity":
            assert not (known & weak).any()
        checked = known & lifted & np.isfinite(np.asarray(estimate))
        assert checked.mean() > 0.4
        signed = np.asarray(getattr(closed, name)) / exact - 1
        off = np.where(np.isfinite(cost) & (cost > 0), np.abs(signed - estimate), cost)
        assert (off <= unsure + 1e-8)[checked].all(), name
        assert (cost <= total + 1e-8).all(), name
        some = checked & (cost > 1e-6) & (cost < np.inf)
        assert np.median(total[some] / cost[some]) < 1.2


@pytest.mark.parametrize("duration", [0.2, -0.2])
def test_errors_are_errors_of_what_others_have_left(duration):
    """Factors that are off, each by no more than it says, are off by no more than the total."""
    linearization = 0.3
    bound = 0.05
    coarse = 2e-3
    fine = 1e-3

    def answers(value):
        return Answers(*[jnp.asarray(value)] * 3)

    rounding = {
        name: {32: answers(coarse), 64: answers(fine)} for name in ("linearized", "nonlinear")
    }
    parts = answers(linearization), answers(duration), answers(bound)
    error = jr.accuracy.ModelError(*parts, rounding)
    for signs in itertools.product((-1, 1), repeat=4):
        off = np.multiply(signs, (bound, coarse, fine, fine))
        instantaneous = (1 + duration + off[0]) * (1 + off[1])
        assert abs(instantaneous - 1) <= error.total("nonlinear", 32).period * (1 + 1e-12)
        linearized = instantaneous * (1 + linearization) * (1 + off[2]) * (1 + off[3])
        assert abs(linearized - 1) <= error.total("linearized", 32).period * (1 + 1e-12)


def test_what_is_not_finite_has_no_finite_bound():
    """Beside the threshold: the estimate says that the block falls, and it may stand."""
    block = jr.Block(0.3, 0.53)
    critical = jr.critical_intensity(block, 0.31, model=jr.Nonlinear())
    scene = jr.Scene(block, 0.31, critical * np.linspace(0.97, 1.03, 61))
    error = jr.accuracy.model_error(scene, jr.HalfSine, 0.01)
    for name in ("rotation_ratio", "period"):
        estimate = getattr(error.duration, name)
        bound = getattr(error.duration_bound, name)
        unknown = ~np.isfinite(np.asarray(estimate))
        assert np.isinf(np.asarray(bound)[unknown]).all()
