"""The promise of `choose`: what it picks keeps the tolerance, and cheaper would not do."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tables.random_scenes import NUMBER, apart, computed, each, lasting_scenes, scenes

import jaxrock as jr
from jaxrock.accuracy.cheapest_setting import CLOSED

pytestmark = pytest.mark.float64


@pytest.fixture(scope="module")
def errors():
    """Of every closed form on offer, for each scene: the worst of the three answers."""
    given = scenes(5, NUMBER)
    truth = computed(given, CLOSED[-1])  # which is good to 1e-12: test_accuracy
    return given, np.array(
        [
            np.max(jax.tree.leaves(jax.tree.map(apart, computed(given, setting), truth)), 0)
            for setting in CLOSED
        ]
    )


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-8])
def test_promise(errors, tolerance):
    given, true = errors
    choice = jr.choose(given, tolerance)
    index = np.asarray(choice.index)
    assert np.asarray(choice.within_tolerance).all()
    assert (true[index, np.arange(NUMBER)] <= tolerance).all()
    assert (true[index, np.arange(NUMBER)] <= choice.error).all()
    cheaper = [(true[:i, k] <= tolerance).any() for k, i in enumerate(index)]
    assert np.mean(cheaper) < 0.1


@pytest.mark.thorough
@pytest.mark.parametrize("shape", [jr.HalfSine, jr.Rectangular])
def test_promise_of_closed_forms_under_pulses_that_last(shape):
    """Stocky blocks, too, where those are not on offer."""
    given, duration, truth, lifted = lasting_scenes(6, NUMBER, shape)
    found = [computed(given, setting) for setting in CLOSED]
    true = np.array(
        [np.max(jax.tree.leaves(jax.tree.map(apart, answers, truth)), 0) for answers in found]
    )
    for tolerance in (1e-1, 3e-2, 1e-3):
        choice = jr.choose(given, tolerance, shape, duration)
        index = np.asarray(choice.index)
        stocky = np.asarray(given.block.slenderness) < 0.5
        closed = np.asarray(choice.within_tolerance) & (index < len(CLOSED))
        assert not (closed & stocky).any()
        assert closed.sum() > 20
        error = true[index[closed], np.nonzero(closed)[0]][lifted[closed]]
        assert (error <= np.asarray(choice.error)[closed & lifted] + 1e-8).all()
        assert (error <= tolerance + 1e-8).all()


def test_nothing_keeps_it():
    wall = jr.Scene(jr.Block(0.4, 5.0), 0.7, 0.15)
    choice = jr.choose(wall, 1e-16)
    assert not choice.within_tolerance
    assert choice.setting == CLOSED[-1]
    assert "no setting is within 1e-16" in str(choice)


def test_reasons_in_words():
    wall = jr.Scene(jr.Block(0.4, 5.0), 0.7, 0.15)
    assert str(jr.choose(wall, 1e-3)).startswith("nonlinear in float32: off by at most ")
    assert "linearizing costs -0.61 % of the rotation ratio" in str(jr.choose(wall, 1e-3))
    many = jr.choose(scenes(1, NUMBER), 1e-3)
    assert "of them beyond 0.001" in str(many)
    with pytest.raises(ValueError, match="setting needs a single scene"):
        many.setting  # noqa: B018


@pytest.mark.thorough
@pytest.mark.parametrize("number", [10, 100])
def test_promise_under_pulses_that_last(number):
    rng = np.random.default_rng(number)
    given = jax.tree.map(lambda leaf: jnp.minimum(leaf, 30.0), scenes(number, number))
    strength = 10 ** rng.uniform(-6, 0.3, number)
    duration = strength * given.intensity * given.block.slenderness / 9.81
    kinds = set()
    for tolerance in (1e-1, 1e-3, 1e-5):
        choice = jr.choose(given, tolerance, jr.HalfSine, duration)
        for k in range(number):
            scene = each(given, k)
            setting = choice.settings[int(choice.index[k])]
            if not choice.within_tolerance[k] or setting.level == "pulsed":
                kinds.add("pulsed")
                continue
            pulse = jr.HalfSine(scene.intensity * np.pi / 2 / duration[k], duration[k])
            phase = jr.pulsed_phase(scene.block, scene.restitution, pulse, rtol=1e-11)
            found = computed(scene, setting)
            for name in ("rotation_ratio", "period"):
                error = apart(getattr(found, name), getattr(phase, name))
                assert error <= tolerance, (k, setting, name)
            kinds.add(setting.level)
    assert kinds == {"linearized", "nonlinear", "pulsed"}


@pytest.mark.thorough
def test_pulsed_keeps_what_is_predicted():
    given = scenes(2, 8)
    given = jax.tree.map(lambda leaf: jnp.minimum(leaf, 30.0), given)
    duration = 0.5 * given.intensity * given.block.slenderness / 9.81
    choice = jr.choose(given, 1e-7, jr.HalfSine, duration)
    compared = 0
    for k in range(8):
        if choice.settings[int(choice.index[k])].level != "pulsed":
            continue
        scene = each(given, k)
        pulse = jr.HalfSine(scene.intensity * np.pi / 2 / duration[k], duration[k])
        usual = jr.pulsed_phase(scene.block, scene.restitution, pulse)
        strict = jr.pulsed_phase(scene.block, scene.restitution, pulse, rtol=1e-12)
        assert apart(usual.rotation_ratio, strict.rotation_ratio) <= choice.error[k]
        compared += 1
    assert compared > 3


def driven_scenes(number):
    rng = np.random.default_rng(number)
    block = jr.Block(10 ** rng.uniform(-1, 0.3, number), rng.uniform(2, 10, number))
    restitution = rng.uniform(0.4, 0.99, number)
    lifting = 9.81 / np.asarray(block.slenderness)
    length = 10 ** rng.uniform(-1, 0.3, number)
    return {
        "half-sine": (
            block,
            restitution,
            jr.HalfSine(lifting * rng.uniform(1, 8, number), length),
        ),
        "Ricker": (block, restitution, jr.Ricker(lifting * rng.uniform(1, 5, number), length)),
        "record": (
            block,
            restitution,
            jr.example_record().scaled(10 ** rng.uniform(-0.5, 0.5, number)),
        ),
    }


def one(tree, k):
    def part(leaf):
        return leaf if leaf.ndim == 0 or leaf.size > 1000 else leaf[k]

    return jax.tree.map(part, tree)


@pytest.mark.parametrize(
    ("kind", "number"),
    [
        pytest.param("half-sine", 100, marks=pytest.mark.thorough),
        pytest.param("Ricker", 100, marks=pytest.mark.thorough),
        pytest.param("record", 100, marks=[pytest.mark.thorough, pytest.mark.release]),
    ],
)
def test_promise_of_the_tolerance(kind, number):
    block, restitution, motion = driven_scenes(number)[kind]
    truth, again = (
        [
            jr.respond(
                one(block, k), restitution[k], one(motion, k), rtol=rtol, solver="Dopri8"
            )
            for k in range(number)
        ]
        for rtol in (1e-11, 1e-13)
    )
    peaks = np.array([float(r.peak_rotation) for r in truth])
    # Rounding, amplified by the impacts: what the truth itself is good to.
    unsure = 4 * apart([float(r.peak_rotation) for r in again], peaks)
    fallen = np.array([bool(r.overturned) for r in truth])

    def off(response):
        error = np.maximum(apart(response.peak_rotation, peaks) - unsure, 0)
        error = np.where(fallen & np.asarray(response.overturned), 0, error)
        return np.where(fallen == np.asarray(response.overturned), error, np.inf)

    assert np.median(unsure) < 1e-11
    levels = (1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 1e-13)
    by_level = {
        rtol: off(jr.respond_batch(block, restitution, motion, rtol=rtol)) for rtol in levels
    }
    for tolerance in (1e-2, 1e-5, 1e-8):
        choice = jr.choose(jr.DrivenScene(block, restitution, motion), tolerance)
        within = jr.respond_within(block, restitution, motion, tolerance)
        assert (choice.within_tolerance == within.within_tolerance).all()
        assert np.mean(within.within_tolerance) > 0.9
        picked = np.array([choice.settings[i].rtol for i in np.asarray(choice.index)])
        error = np.array([by_level[rtol][k] for k, rtol in enumerate(picked)])
        assert (error <= tolerance)[within.within_tolerance].all()
        assert (error <= np.asarray(choice.error))[within.within_tolerance].all()
        assert (off(within.response) <= tolerance)[within.within_tolerance].all()
        # What is asked for is enough for nearly all: few take more.
        assert np.mean(picked < max(rtol for rtol in levels if rtol <= tolerance)) <= 0.1


@pytest.mark.thorough
def test_chaos_is_not_promised():
    """Where impacts make answers of rounding itself, no tolerance agrees with the next."""
    block = jr.Block(0.05, 8.0)
    record = jr.example_record().scaled(np.linspace(0.2, 3.0, 600))
    within = jr.respond_within(block, 0.98, record, 1e-9)
    assert 0 < np.mean(~within.within_tolerance) < 0.7
    assert (within.error[~within.within_tolerance] > 1e-9).all()
    choice = jr.choose(jr.DrivenScene(block, 0.98, record), 1e-9)
    assert (np.asarray(choice.within_tolerance) == within.within_tolerance).all()


@pytest.mark.thorough
def test_a_single_driven_scene():
    scene = jr.DrivenScene(jr.Block(0.2, 5.0), 0.9, jr.Sine(3.0, 0.5))
    choice = jr.choose(scene, 1e-3)
    assert choice.setting.level == "batch"
    assert str(choice).startswith(f"batch at rtol {choice.setting.rtol:g} in float64: off by")
    truth = jr.respond(scene.block, 0.9, scene.motion, rtol=1e-12)
    found = jr.respond_batch(scene.block, 0.9, scene.motion, rtol=choice.setting.rtol)
    assert apart(found.peak_rotation, truth.peak_rotation) <= choice.error <= 1e-3
    assert jr.respond_within(scene.block, 0.9, scene.motion, 1e-3).response.impacts.shape == ()
