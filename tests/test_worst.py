"""Trains of pulses: against SciPy, and the worst ones against the paper's input."""

import math

import numpy as np
import pytest
from references import stepping, train_search
from scipy.integrate import solve_ivp
from tools.selection import first_by_default

import jaxrock as jr

pytestmark = pytest.mark.float64
SLOW = pytest.mark.thorough
BOTH = pytest.mark.parametrize(
    "model", [jr.Linearized(), pytest.param(jr.Nonlinear(), marks=SLOW)], ids=repr
)


def scipy_train(rocker, block, times, intensities):  # noqa: C901
    """Peak rotation and whether it overturns: jumps of the velocity, SciPy's events between."""
    alpha = velocity = peak = 0.0
    side = 0
    now = 0.0
    shape = 0.75 * float(block.slenderness) / (1 + float(block.slenderness) ** 2)

    def move(alpha, velocity, side, length):
        highest = abs(alpha)
        begin = 0.0
        while begin < length and side:

            def field(t, y, side=side):
                return [y[1], rocker.acceleration(y[0], side, (0.0, 0.0))]

            def lands(t, y, side=side, begin=begin):
                return side * y[0] if t > begin + 1e-9 else 1.0

            def over(t, y):
                return abs(y[0]) - 1.5

            def top(t, y):
                return y[1]

            lands.terminal = over.terminal = True
            lands.direction = -1
            found = solve_ivp(
                field, (begin, length), [alpha, velocity], "DOP853",
                rtol=1e-11, atol=1e-14, events=(lands, over, top),
            )  # fmt: skip
            begin = found.t[-1]
            alpha, velocity = found.y[:, -1]
            highest = max([highest, abs(alpha), *(abs(y[0]) for y in found.y_events[2])])
            if found.t_events[1].size:
                return alpha, velocity, side, highest, True
            if found.t_events[0].size:
                alpha = 0.0
                velocity = rocker.c * velocity
                side = -side
            if alpha == 0 and abs(velocity) < 1e-7:
                velocity = 0.0
                side = 0
        return alpha, velocity, side, highest, False

    for time, intensity in zip(times, intensities, strict=True):
        alpha, velocity, side, highest, over = move(alpha, velocity, side, time - now)
        peak = max(peak, highest)
        now = time
        if over:
            return peak, True
        side = side or (1 if intensity > 0 else -1)
        factor = 1.0
        if not rocker.linearized:
            factor = math.cos(rocker.angle - abs(alpha)) / math.cos(rocker.angle)
        velocity += shape * intensity / float(block.half_width) * factor
    *_, highest, over = move(alpha, velocity, side, 30.0)
    return max(peak, highest), over


@BOTH
def test_trains_against_scipy(model):
    rng = np.random.default_rng(2)
    outcomes = []
    for _ in range(12):
        block = jr.Block(rng.uniform(0.1, 0.6), rng.uniform(1.5, 6))
        c = rng.uniform(0.5, 0.95)
        count = 4
        rocker = stepping.Rocker(
            float(block.half_width), float(block.slenderness), c, model == jr.Linearized()
        )
        times = np.sort(rng.uniform(0, 3, count))
        critical = float(jr.critical_intensity(block, c, 1, model))
        intensities = rng.uniform(-0.6, 0.6, count) * critical
        ours = jr.respond_to_train(block, c, times, intensities, model)
        peak, overturned = scipy_train(rocker, block, times, intensities)
        outcomes.append(overturned)
        assert bool(ours.overturned) == overturned
        if not overturned:
            assert float(ours.peak_rotation) == pytest.approx(peak, rel=1e-7)
    assert not all(outcomes)


@pytest.mark.thorough
@BOTH
@pytest.mark.parametrize(
    "count",
    [2, pytest.param(3, marks=SLOW), pytest.param(5, marks=SLOW), pytest.param(8, marks=SLOW)],
)
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

    latest = 1.2 / float(block.frequency_parameter)
    timed = jr.worst_train(block, c, 3, latest=latest, starts=2, model=model)
    replayed = jr.respond_to_train(block, c, timed.times, timed.intensities, model)
    assert replayed.overturned

    largest = 0.9 * worst.largest
    strongest = jr.worst_train(block, c, 3, "most rotation", largest=largest, model=model)
    replayed = jr.respond_to_train(block, c, strongest.times, strongest.intensities, model)
    assert not replayed.overturned
    assert replayed.peak_rotation >= strongest.peak_rotation
    assert float(replayed.peak_rotation) == pytest.approx(strongest.peak_rotation, rel=1e-3)


def worst_of(case, starts):
    """The worst train with the limits of a case, and what it is to be best in."""
    limits = {"latest": case.latest, "largest": case.largest}
    worst = jr.worst_train(
        jr.Block(case.half_width, case.slenderness), case.restitution, case.count, case.goal,
        impacts_between=case.impacts_between, spacing=case.spacing, starts=starts,
        model=getattr(jr, case.model)(),
        **{name: limit for name, limit in limits.items() if limit is not None},
    )  # fmt: skip
    return worst, worst.total if "total" in case.goal else worst.largest


def no_worse_than_scipy(case, starts):
    """Nor does it break a limit, and it does what it is to if followed without JAX."""
    theirs = train_search.found()[case]
    worst, ours = worst_of(case, starts)
    assert worst.status == jr.Status.COMPLETE, case
    gaps = np.diff(worst.times)
    assert (gaps >= case.spacing - 1e-9).all(), case
    assert case.latest is None or worst.times[-1] <= case.latest, case
    block = jr.Block(case.half_width, case.slenderness)
    rocker = stepping.Rocker(
        case.half_width, case.slenderness, case.restitution, case.model == "Linearized"
    )
    if case.goal == "most rotation":
        assert worst.objectives.max() >= theirs.reached * (1 - 1e-6), case
        peak, _ = scipy_train(rocker, block, worst.times, worst.intensities)
        assert peak == pytest.approx(worst.peak_rotation, rel=1e-4), case
        return
    assert ours <= theirs.reached * (1 + 1e-6), case
    if case.count > 1 and gaps.min() < 1e-8:
        return  # pulses right before and after one impact, which `scipy_train` cannot tell apart
    for by, falls in ((0, True), (-1e-5, False)):
        _, over = scipy_train(rocker, block, worst.times, worst.intensities * (1 + by))
        assert over == falls, (case, by)


@pytest.mark.thorough
@pytest.mark.parametrize("case", train_search.TELLING[: train_search.DEFAULT])
def test_no_train_is_worse(case):
    """SciPy's search over all times, signs and sizes finds none, with limits."""
    no_worse_than_scipy(case, starts=3)


@pytest.mark.thorough
@pytest.mark.release
@pytest.mark.parametrize("case", train_search.CASES)
def test_no_train_is_worse_of_a_bigger_sample(case):
    no_worse_than_scipy(case, starts=10)


def test_what_scipy_found_overturns():
    """Followed by another integrator than the search used."""
    for case, theirs in list(train_search.found().items())[: train_search.DEFAULT]:
        rocker = stepping.Rocker(
            case.half_width, case.slenderness, case.restitution, case.model == "Linearized"
        )
        block = jr.Block(case.half_width, case.slenderness)
        assert scipy_train(rocker, block, theirs.times, theirs.intensities)[1], case


@pytest.mark.thorough
@pytest.mark.release
def test_the_frozen_trains_are_what_scipy_finds_today():
    for case in train_search.TELLING[:3]:
        now = train_search.best_of(case).reached
        assert now == pytest.approx(train_search.found()[case].reached, rel=1e-7), case


@BOTH
@pytest.mark.thorough
def test_the_least_in_total_is_a_single_pulse(model):
    block = jr.Block(0.4, 4.0)
    c = 0.7
    worst = jr.worst_train(block, c, 4, "smallest total", model=model)
    single = float(jr.critical_intensity(block, c, 1, model))
    assert worst.status == jr.Status.COMPLETE
    assert worst.total == pytest.approx(single, rel=1e-9)
    assert (abs(worst.objectives / single - 1) < 1e-6).sum() >= 8
    assert np.sort(abs(worst.intensities))[-2] < 1e-6 * single


@pytest.mark.thorough
def test_most_rotation():
    block = jr.Block(0.4, 4.0)
    c = 0.7
    model = jr.Nonlinear()
    largest = 0.9 * float(jr.critical_intensity(block, c, 3, model))
    worst = jr.worst_train(block, c, 3, "most rotation", largest=largest, model=model)
    velocity = jr.half_cycle_velocity(jr.Scene(block, c, largest), 3.0)
    assert worst.status == jr.Status.COMPLETE
    assert not worst.overturns
    assert worst.peak_rotation == pytest.approx(
        float(model.peak_rotation(block, velocity)), 1e-9
    )


@pytest.mark.thorough
def test_constraints():
    """Kept, and they cost something; without any, all pulses come at once."""
    block = jr.Block(0.4, 4.0)
    c = 0.7
    single = float(jr.critical_intensity(block, c, 1))
    at_once = jr.worst_train(block, c, 2, impacts_between=0)
    assert at_once.largest == pytest.approx(single / 2, rel=1e-9)
    free = jr.worst_train(block, c, 2)
    apart = jr.worst_train(block, c, 2, spacing=float(free.times[1]) + 0.2)
    assert apart.status == jr.Status.COMPLETE
    assert np.diff(apart.times)[0] >= float(free.times[1]) + 0.2 - 1e-5
    assert apart.largest > 1.01 * free.largest
    # A hair after the impact, which is where it is to come.
    for factor in (0.999, 1.001):
        intensities = apart.intensities * np.array([1, factor])
        train = jr.respond_to_train(block, c, apart.times + np.array([0, 1e-9]), intensities)
        assert bool(train.overturned) == (factor > 1)
