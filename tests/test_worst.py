"""Trains of pulses: against SciPy, and the worst ones against the paper's input."""

import numpy as np
import pytest
from references import stepping, train_search
from references.trains import follow_train
from tools.selection import first_before_release, first_by_default

import jaxrock as jr

pytestmark = pytest.mark.float64
SLOW = pytest.mark.thorough
BOTH = pytest.mark.parametrize(
    "model", [jr.Linearized(), pytest.param(jr.Nonlinear(), marks=SLOW)], ids=repr
)


def followed(rocker, times, intensities):
    """A train without JAX, until half a minute after its last pulse."""
    return follow_train(rocker, times, intensities, [times[-1] + 30])


@BOTH
def test_trains_against_scipy(model):
    rng = np.random.default_rng(2)
    outcomes = []
    for _ in range(12):
        b = rng.uniform(0.1, 0.6)
        slenderness = rng.uniform(1.5, 6)
        c = rng.uniform(0.5, 0.95)
        block = jr.Block(b, slenderness)
        rocker = stepping.Rocker(b, slenderness, c, model == jr.Linearized())
        times = np.sort(rng.uniform(0, 3, 4))
        critical = float(jr.critical_intensity(block, c, 1, model))
        intensities = rng.uniform(-0.6, 0.6, 4) * critical
        ours = jr.respond_to_train(block, c, times, intensities, model)
        theirs = followed(rocker, times, intensities)
        outcomes.append(theirs.overturned)
        assert bool(ours.overturned) == theirs.overturned
        if not theirs.overturned:
            assert float(ours.peak_rotation) == pytest.approx(theirs.peak, rel=1e-7)
    assert not all(outcomes)


@pytest.mark.thorough
@BOTH
@pytest.mark.parametrize("count", [2, 3, 5, 8])
def test_the_papers_input_comes_out(model, count):
    """From at least eight of ten random starts: equal pulses right after the impacts."""
    block = jr.Block(0.4, 4.0)
    c = 0.7
    worst = jr.worst_train(block, c, count, model=model)
    closed = float(jr.critical_intensity(block, c, count, model))
    assert worst.status == jr.Status.COMPLETE
    assert worst.largest == pytest.approx(closed, rel=1e-9)
    assert (abs(worst.objectives / closed - 1) < 1e-6).sum() >= 8
    assert abs(worst.delays).max() < 1e-4
    assert (worst.impacts_between[1:] == 1).all()
    np.testing.assert_allclose(abs(worst.intensities), closed * (1 + 1e-6), rtol=1e-8)
    # Alternating as the ground moves.
    assert (np.sign(worst.intensities) == (-1.0) ** np.arange(count)).all()


@pytest.mark.parametrize(
    "model", first_by_default([jr.Linearized(), jr.Nonlinear()]), ids=repr
)
def test_a_worst_train_does_as_told_when_it_is_replayed(model):
    """With its own times and intensities; those that are just enough are a little smaller."""
    rng = np.random.default_rng(49)
    for _ in range(4):
        block = jr.Block(rng.uniform(0.1, 1), rng.uniform(1.5, 8))
        c = rng.uniform(0.4, 0.95)
        worst = jr.worst_train(block, c, 3, model=model)
        assert worst.status == jr.Status.COMPLETE
        assert worst.overturns
        replayed = jr.respond_to_train(block, c, worst.times, worst.intensities, model)
        assert replayed.overturned
        weaker = jr.respond_to_train(block, c, worst.times, worst.intensities * 0.999, model)
        assert not weaker.overturned
        raised = abs(worst.intensities).max() / worst.largest - 1
        assert raised == pytest.approx(1e-6, rel=1e-6)
        closed = float(jr.critical_intensity(block, c, 3, model))
        assert worst.largest == pytest.approx(closed, rel=1e-9)

    # Further apart than the impacts of that train, which costs something.
    spacing = 1.1 * float(worst.times[1])
    apart = jr.worst_train(block, c, 3, spacing=spacing, model=model)
    assert apart.status == jr.Status.COMPLETE
    assert (np.diff(apart.times) >= spacing - 1e-9).all()
    assert apart.largest > 1.001 * worst.largest
    assert jr.respond_to_train(block, c, apart.times, apart.intensities, model).overturned


@pytest.mark.thorough
@pytest.mark.parametrize(
    "case", first_before_release(train_search.TELLING, train_search.DEFAULT)
)
def test_no_train_is_worse(case):
    """SciPy's search finds none, with limits, which are kept; followed without JAX it overturns."""
    theirs = train_search.found()[case]
    given = {"latest": case.latest, "largest": case.largest}
    worst = jr.worst_train(
        jr.Block(case.half_width, case.slenderness), case.restitution, case.count, case.goal,
        impacts_between=case.impacts_between, spacing=case.spacing, starts=10,
        model=case.model.lower(),
        **{name: limit for name, limit in given.items() if limit is not None},
    )  # fmt: skip
    assert worst.status == jr.Status.COMPLETE
    gaps = np.diff(worst.times)
    assert (gaps >= case.spacing - 1e-9).all()
    assert case.latest is None or worst.times[-1] <= case.latest
    rocker = stepping.Rocker(*case[:3], case.model == "Linearized")
    if case.goal == "most rotation":
        assert worst.objectives.max() >= theirs.reached * (1 - 1e-6)
        peak = followed(rocker, worst.times, worst.intensities).peak
        assert peak == pytest.approx(worst.peak_rotation, rel=1e-4)
        return
    ours = worst.total if "total" in case.goal else worst.largest
    assert ours <= theirs.reached * (1 + 1e-6)
    if gaps.size and gaps.min() < 1e-8:
        return  # pulses right before and after one impact, which `follow_train` cannot tell apart
    for by, falls in ((0, True), (-1e-5, False)):
        path = followed(rocker, worst.times, worst.intensities * (1 + by))
        assert path.overturned == falls, by
