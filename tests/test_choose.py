"""The promise of `choose`: what it picks keeps the tolerance, and cheaper would not do."""

import jax
import numpy as np
import pytest
from tables.random_scenes import NUMBER, apart, computed, lasting_scenes, scenes

import jaxrock as jr

pytestmark = pytest.mark.float64


@pytest.fixture(scope="module")
def errors():
    """Of every closed form on offer, for each scene: the worst of the three answers."""
    given = scenes(5, NUMBER)
    settings = jr.accuracy.choose(given, 1e-2).settings
    truth = computed(given, settings[-1])  # which is good to 1e-12: test_accuracy
    return given, np.array(
        [
            np.max(jax.tree.leaves(jax.tree.map(apart, computed(given, setting), truth)), 0)
            for setting in settings
        ]
    )


@pytest.mark.thorough
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
    settings = jr.accuracy.choose(given, 1e-2).settings
    found = [computed(given, setting) for setting in settings]
    true = np.array(
        [np.max(jax.tree.leaves(jax.tree.map(apart, answers, truth)), 0) for answers in found]
    )
    for tolerance in (1e-1, 3e-2, 1e-3):
        choice = jr.accuracy.choose(given, tolerance, shape, duration)
        index = np.asarray(choice.index)
        stocky = np.asarray(given.block.slenderness) < 0.5
        closed = np.asarray(choice.within_tolerance) & (index < len(settings))
        assert not (closed & stocky).any()
        assert closed.sum() > 20
        error = true[index[closed], np.nonzero(closed)[0]][lifted[closed]]
        assert (error <= np.asarray(choice.error)[closed & lifted] + 1e-8).all()
        assert (error <= tolerance + 1e-8).all()


@pytest.mark.thorough
@pytest.mark.parametrize("tolerance", [1e-2, 1e-5, 1e-8])
def test_promise_for_driven_motion(tolerance):
    """Each block at the tolerance that is picked for it, against the tightest one."""
    given = jr.Block(np.linspace(0.1, 0.6, 40), 5.0), 0.85, jr.Ricker(6.0, 0.4)
    truth = jr.respond_batch(*given, rtol=1e-13)
    choice = jr.accuracy.choose(given, tolerance)
    assert np.asarray(choice.within_tolerance).all()
    picked = np.array([choice.settings[index].rtol for index in np.asarray(choice.index)])
    for rtol in np.unique(picked):
        found = jr.respond_batch(*given, rtol=rtol)
        np.testing.assert_array_equal(found.overturned, truth.overturned)
        off = np.where(truth.overturned, 0, apart(found.peak_rotation, truth.peak_rotation))
        assert (off <= np.minimum(tolerance, choice.error))[picked == rtol].all()
