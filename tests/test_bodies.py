"""Bodies other than rectangles: the inertia ratio, from first principles and by exact laws."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from references import stepping
from tools.selection import first_by_default, some_by_default

import jaxrock as jr
from jaxrock.driven import Equation

RATIOS = [1.0, 1.1, 1.25, 1.6, 2.5]
MODELS = [jr.Linearized(), jr.Nonlinear()]
GRAVITY = 9.81


class Masses:
    """Point masses, symmetric about the middle, on massless legs that stand on two edges."""

    def __init__(self, half_width, across, up, mass):
        self.half_width = half_width
        self.place = np.array([[*across, *np.negative(across)], [*up, *up]])
        self.mass = np.array([*mass, *mass])
        self.total = self.mass.sum()
        self.centre = (self.place * self.mass).sum(axis=1) / self.total
        self.inertia = (self.mass * ((self.place.T - self.centre) ** 2).sum(axis=1)).sum()
        self.block = jr.Block.from_body(half_width, self.centre[1], self.total, self.inertia)

    def from_edge(self, side=1):
        return self.place - np.array([[side * self.half_width], [0.0]])


def cross(first, second):
    return first[0] * second[1] - first[1] * second[0]


VASE = Masses(0.2, [0.1, 0.35, 0.2], [0.1, 1.1, 1.6], [30.0, 12.0, 5.0])
COLUMN = Masses(0.3, [0.3, 0.3, 0.3, 0.3], [0.0, 1.0, 2.0, 3.0], [9.0, 10.0, 11.0, 12.0])
HEAVY_FOOT = Masses(0.5, [0.1, 0.4], [0.3, 2.5], [40.0, 4.0])
BODIES = [VASE, COLUMN, HEAVY_FOOT]


@pytest.mark.parametrize("body", BODIES)
def test_impact_conserves_the_angular_momentum_about_the_new_edge(body, eps):
    """Before it, the masses turn about the old edge with unit velocity, after it about the new."""
    old = body.from_edge(-1)
    new = body.from_edge(1)
    before = (body.mass * cross(new, np.stack([-old[1], old[0]]))).sum()
    after = (body.mass * cross(new, np.stack([-new[1], new[0]]))).sum()
    assert jr.housner_restitution(body.block) == pytest.approx(before / after, abs=20 * eps)


@pytest.mark.parametrize("ratio", RATIOS)
def test_housner_where_it_vanishes(ratio, eps):
    exists = ratio < 2
    crossing = math.sqrt(2 / ratio - 1) if exists else 0.5
    slenderness = crossing * np.array([0.5, 0.999, 1.0, 1.001, 2.0])
    found = jr.housner_restitution(jr.Block(0.4, slenderness, inertia_ratio=ratio))
    expected = (slenderness**2 + 1 - 2 / ratio) / (1 + slenderness**2)
    np.testing.assert_allclose(found, expected, atol=4 * eps)
    assert (found[0] < 0) == exists


@pytest.mark.parametrize("body", BODIES)
def test_a_pulse_conserves_the_angular_momentum_about_the_edge(body, eps):
    """The ground moves the masses by as much as it changes its velocity, seen from the edge."""
    place = body.from_edge()
    given = (body.mass * place[1]).sum() * 0.15
    about_edge = (body.mass * (place**2).sum(axis=0)).sum()
    launch = jr.launch_velocity(jr.Scene(body.block, 0.5, 0.15))
    assert launch == pytest.approx(given / about_edge, rel=20 * eps)


@pytest.mark.float64
@pytest.mark.parametrize("body", BODIES)
def test_acceleration_is_that_of_newton_and_euler(body):
    """Two forces at the edge and one acceleration, from the balance of forces and moments."""
    rng = np.random.default_rng(7)
    equation = Equation.of(body.block, jr.Nonlinear())
    for _ in range(20):
        rotation = rng.uniform(0, 0.5)
        velocity = rng.normal()
        push, lift = rng.normal(0, 0.5, 2)
        tilt = float(body.block.critical_angle) - rotation
        radius = float(body.block.half_diagonal)
        # The centre, seen from the edge to the right, on which the body turns clockwise.
        x = -radius * math.sin(tilt)
        y = radius * math.cos(tilt)
        # Unknown are the force from the ground and the acceleration.
        matrix = [[1, 0, -body.total * y], [0, 1, body.total * x], [y, -x, body.inertia]]
        weight = body.total * GRAVITY
        inertial = body.total * velocity**2 * np.array([-x, -y])
        ground = [-push * weight, weight * (1 + lift)]
        right = [inertial[0] + ground[0], inertial[1] + ground[1], 0]
        acceleration = np.linalg.solve(matrix, right)[2]
        expected = equation.acceleration(*map(jnp.asarray, (rotation, push, lift)))
        assert acceleration == pytest.approx(float(expected), rel=1e-12, abs=1e-12)


@pytest.mark.thorough
@pytest.mark.float64
@pytest.mark.parametrize("ratio", [1.0, 1.6, 2.5])
def test_driven_response(ratio):
    """Against steps that know of radius, angle and inertia only."""
    rng = np.random.default_rng(int(100 * ratio))
    for _ in range(4):
        b = 10 ** rng.uniform(-1, 0)
        slenderness = rng.uniform(2, 8)
        c = rng.uniform(0.5, 0.9)
        amplitude = GRAVITY / slenderness * rng.uniform(1.1, 2.0)
        duration = rng.uniform(0.3, 1.0)
        rocker = stepping.Rocker(b, slenderness, c, share=1 / ratio)
        ground = stepping.pulse("Sine", amplitude, duration)
        expected = stepping.follow(rocker, ground, settle=1.0)
        block = jr.Block(b, slenderness, inertia_ratio=ratio)
        motion = jr.Sine(amplitude, duration)
        found = jr.respond(block, c, motion, duration + 1.0, rtol=1e-11)
        batch = jr.respond_batch(block, c, motion, duration + 1.0)
        assert bool(found.overturned) == bool(batch.overturned) == expected.overturned[0]
        for answer in (found, batch):
            assert answer.peak_rotation == pytest.approx(expected.peak[0], rel=1e-8)
            assert answer.margin == pytest.approx(expected.margin[0], abs=1e-8)
        n = min(found.impact_times.size, expected.impacts[0], 10)
        assert n
        times, velocities = expected.impact_times[0], expected.impact_velocities[0]
        np.testing.assert_allclose(found.impact_times[:n], times[:n], rtol=1e-8)
        np.testing.assert_allclose(found.impact_velocities[:n], velocities[:n], rtol=1e-7)


ANSWERS = {
    "rotation_ratio": lambda block, model: jr.rotation_ratio(jr.Scene(block, 0.7, 0.1), model),
    "period": lambda block, model: jr.stabilized_period(jr.Scene(block, 0.7, 0.1), model),
    "amplification": lambda block, model: jr.amplification(jr.Scene(block, 0.7, 0.1), model),
    "critical_intensity": lambda block, model: jr.critical_intensity(block, 0.7, 4.0, model),
    "critical_restitution": lambda block, model: jr.critical_restitution(block, 0.2, 6, model),
    "boundary": lambda block, model: jr.critical_amplitude(
        block, 0.8, jr.HalfSine, 0.5, model=model, max_boundaries=1
    ).value[0],
}


@pytest.mark.float64
@pytest.mark.parametrize("model", first_by_default(reversed(MODELS)), ids=repr)
@pytest.mark.parametrize(
    "name",
    some_by_default(ANSWERS, {"period", "critical_intensity"}),
)
def test_inertia_acts_as_width(name, model):
    """A body of kappa moves like a rectangle that is wider by kappa over 4 / 3.

    So that it does not matter to elasticities which of the two changes.
    """

    @jax.jit
    def at(b, ratio):
        def answer(numbers):
            return ANSWERS[name](jr.Block(numbers[0], 4.0, inertia_ratio=numbers[1]), model)

        numbers = jnp.stack([b, ratio])
        return answer(numbers), jax.jacfwd(answer)(numbers)

    for ratio in (1.05, 1.7):
        value, slopes = at(jnp.asarray(0.3), jnp.asarray(ratio))
        same, _ = at(jnp.asarray(0.3 * ratio * 0.75), jnp.asarray(4 / 3))
        assert value == pytest.approx(float(same), rel=1e-8)
        assert ratio * slopes[1] == pytest.approx(0.3 * float(slopes[0]), rel=1e-6, abs=1e-12)
        assert name == "amplification" or slopes[1] != 0


@pytest.mark.float64
def test_derivatives_with_respect_to_the_inertia_ratio():
    """Of what the law does not cover: Housner's restitution and the critical width."""
    step = 1e-5

    @jax.jit
    def closed(ratio):
        block = jr.Block(0.3, 4.0, inertia_ratio=ratio)
        width = jr.critical_width(block, 0.7, 0.2, 4.0, jr.Nonlinear())
        stocky = jr.Block(0.3, 0.6, inertia_ratio=ratio)
        housner = [jr.housner_restitution(each) for each in (block, stocky)]
        return jnp.stack([width, *housner])

    for ratio in (1.1, 2.2):
        expected = (closed(ratio + step) - closed(ratio - step)) / (2 * step)
        np.testing.assert_allclose(jax.jacfwd(closed)(ratio), expected, rtol=1e-8)


def test_from_parameters(eps):
    once = jr.Block(0.4, np.array([0.5, 5.0]), 3.7, inertia_ratio=1.2)
    again = jr.Block.from_parameters(
        once.frequency_parameter, once.critical_angle, once.gravity, once.inertia_ratio
    )
    np.testing.assert_allclose(again.half_width, once.half_width, rtol=20 * eps)
    np.testing.assert_allclose(again.slenderness, once.slenderness, rtol=10 * eps)
