"""The promise of `choose`: what it picks keeps the tolerance, and cheaper would not do."""

import jax
import numpy as np
import pytest
from tables.random_scenes import NUMBER, apart, computed, lasting_scenes, scenes

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
    choice = jr.accuracy.choose(given, tolerance)
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
        choice = jr.accuracy.choose(given, tolerance, shape, duration)
        index = np.asarray(choice.index)
        stocky = np.asarray(given.block.slenderness) < 0.5
        closed = np.asarray(choice.within_tolerance) & (index < len(CLOSED))
        assert not (closed & stocky).any()
        assert closed.sum() > 20
        error = true[index[closed], np.nonzero(closed)[0]][lifted[closed]]
        assert (error <= np.asarray(choice.error)[closed & lifted] + 1e-8).all()
        assert (error <= tolerance + 1e-8).all()


def one(tree, k):
    """The k-th scene of an array, whose record is the same for all."""
    return jax.tree.map(lambda leaf: leaf[k] if leaf.ndim and leaf.size < 1000 else leaf, tree)


def driven_scene(kind, number):
    rng = np.random.default_rng(number)
    block = jr.Block(10 ** rng.uniform(-1, 0.3, number), rng.uniform(2, 10, number))
    lifting = 9.81 / np.asarray(block.slenderness)
    length = 10 ** rng.uniform(-1, 0.3, number)
    motion = {
        "half-sine": jr.HalfSine(lifting * rng.uniform(1, 8, number), length),
        "Ricker": jr.Ricker(lifting * rng.uniform(1, 5, number), length),
        "record": jr.example_record().scaled(10 ** rng.uniform(-0.5, 0.5, number)),
    }[kind]
    return block, rng.uniform(0.4, 0.99, number), motion


@pytest.mark.thorough
@pytest.mark.parametrize(
    "kind", ["half-sine", "Ricker", pytest.param("record", marks=pytest.mark.release)]
)
def test_promise_of_the_tolerance(kind):
    number = 100
    given = driven_scene(kind, number)
    truth, again = (
        [jr.respond(*one(given, k), rtol=rtol, solver="Dopri8") for k in range(number)]
        for rtol in (1e-11, 1e-13)
    )
    peaks = np.array([float(response.peak_rotation) for response in truth])
    fallen = np.array([bool(response.overturned) for response in truth])
    # Rounding, amplified by the impacts: what the truth itself is good to.
    unsure = 4 * apart([float(response.peak_rotation) for response in again], peaks)
    assert np.median(unsure) < 1e-11

    def find_error(response):
        overturned = np.asarray(response.overturned)
        error = np.maximum(apart(response.peak_rotation, peaks) - unsure, 0)
        return np.where(fallen == overturned, np.where(fallen, 0, error), np.inf)

    levels = (1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 1e-13)
    by_level = {rtol: find_error(jr.respond_batch(*given, rtol=rtol)) for rtol in levels}
    for tolerance in (1e-2, 1e-5, 1e-8):
        choice = jr.accuracy.choose(given, tolerance)
        within = np.asarray(choice.within_tolerance)
        assert np.mean(within) > 0.9
        picked = np.array([choice.settings[index].rtol for index in np.asarray(choice.index)])
        error = np.array([by_level[rtol][k] for k, rtol in enumerate(picked)])
        assert (error <= np.minimum(tolerance, choice.error))[within].all()
        # What is asked for is enough for nearly all: few take more.
        assert np.mean(picked < max(rtol for rtol in levels if rtol <= tolerance)) <= 0.1
