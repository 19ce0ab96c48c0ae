"""Every cell of the corners meets its bound or stands among the known limits, not both."""

import closed
import corners
import driven
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tools.selection import some_by_default

import jaxrock as jr

# One of each kind; the others take long to compile.
OF_EACH_KIND = {
    "half_cycle_velocity(1e6)",
    "Linearized rotation_ratio",
    "Nonlinear rotation_ratio",
    "Nonlinear critical_intensity(inf)",
}
LONG = {name for name in corners.FUNCTIONS if "linear" in name.lower()} - OF_EACH_KIND
NAMES = some_by_default(corners.FUNCTIONS, corners.FUNCTIONS.keys() - LONG)


@pytest.fixture
def precision():
    """The precision of this run."""
    return jnp.result_type(float).name


# The known limit, see README.md; a cell that is within its bound must not be here.
LIMITS = {("for an hour", "gradient")}


@pytest.mark.parametrize("name", NAMES)
def test_closed_form(name, precision):
    assert closed.failures(name, precision) == {}


@pytest.mark.float64
@pytest.mark.thorough
@pytest.mark.parametrize("name", corners.FUNCTIONS)
def test_closed_form_in_float32_and_in_reverse_mode(name):
    assert closed.failures(name, "float32") == {}
    assert closed.failures(name, "float64", jax.jacrev) == {}


@pytest.mark.parametrize("model_name", corners.MODELS)
def test_overturning_half_cycle(model_name, precision):
    assert closed.count_failures(model_name, precision) == {}


@pytest.mark.float64
@pytest.mark.thorough
@pytest.mark.parametrize("solver", driven.SOLVERS)
@pytest.mark.parametrize("precision", corners.PRECISIONS)
def test_driven_motion(solver, precision):
    assert driven.failures(solver, precision).keys() == LIMITS


@pytest.mark.float64
@pytest.mark.thorough
@pytest.mark.release
@pytest.mark.parametrize("solver", driven.SOLVERS)
def test_second_derivatives_of_driven_motion(solver):
    assert driven.failures(solver, "float64", hessian=True).keys() == LIMITS


@pytest.mark.float64
@pytest.mark.thorough
@pytest.mark.release
def test_a_million_half_cycles():
    block = jr.Block(0.4, 5.0)
    model = jr.Nonlinear()
    launch = 0.6 * model.critical_velocity(block)
    half = model.half_cycle_duration(block, launch)
    still = jr.Rectangular(0.0, 1e-3)
    million = 1_000_000

    @jax.jit
    def run(seconds):
        r = jr.respond(block, 1.0, still, seconds, velocity=launch, rtol=1e-11, max_impacts=8)
        margin = jr.driven.free_motion_margin(block, 1.0, r.final_rotation, r.final_velocity)
        return r.impacts, r.peak_rotation, margin

    impacts, peak, margin = run((million + 0.5) * half)
    # Of the time, less than 1e-6 is lost: up to one half-cycle. The energy is what it was.
    assert abs(int(impacts) - million) <= 1
    np.testing.assert_allclose(peak, model.peak_rotation(block, launch), rtol=1e-8)
    np.testing.assert_allclose(margin, 1 - launch / model.critical_velocity(block), rtol=1e-5)


@pytest.mark.float64
@pytest.mark.thorough
@pytest.mark.parametrize("solver", driven.SOLVERS)
def test_record_at_10_khz(solver):
    """A sine in 7,000 samples, whose chords are off by less than 1e-7 of it."""
    samples = np.sin(2 * np.pi * np.linspace(0, 1, 7001))
    respond = getattr(jr, solver)
    options = {"rtol": 1e-11} if solver == "respond" else {}

    def of_record(numbers):
        b, slenderness, restitution, amplitude = numbers
        record = jr.Record(samples, 1e-4, scale=amplitude)
        r = respond(jr.Block(b, slenderness), restitution, record, 2.0, **options)
        return jnp.stack([r.peak_rotation, r.margin, r.final_rotation])

    def of_pulse(numbers):
        b, slenderness, restitution, amplitude = numbers
        pulse = jr.Sine(amplitude, 0.7)
        r = jr.respond(jr.Block(b, slenderness), restitution, pulse, 2.0, rtol=1e-11)
        return jnp.stack([r.peak_rotation, r.margin, r.final_rotation])

    at = jnp.asarray([0.4, 5.0, 0.9, 3.2])
    np.testing.assert_allclose(of_record(at), of_pulse(at), rtol=2e-6)
    slopes = jax.jit(jax.jacfwd(of_record))(at)
    expected = jax.jit(jax.jacfwd(of_pulse))(at)
    np.testing.assert_allclose(slopes, expected, rtol=2e-5, atol=1e-6)
