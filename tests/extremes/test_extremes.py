"""Every cell of the corners meets its bound or stands among the known limits, not both."""

import closed
import corners
import driven
import jax
import jax.numpy as jnp
import limits
import mpmath as mp
import numpy as np
import pytest
import table
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


def check(failed, subject, precision, quantities):
    known = limits.of(subject, precision, quantities)
    new = {cell: why for cell, why in failed.items() if cell not in known}
    assert not new, "not within the bound"
    assert not known - set(failed), "no limit any more: take it out of the table"


@pytest.mark.parametrize("name", NAMES)
def test_closed_form(name, precision):
    check(closed.failures(name, precision), name, precision, corners.QUANTITIES)


@pytest.mark.float64
@pytest.mark.thorough
@pytest.mark.parametrize("name", corners.FUNCTIONS)
def test_closed_form_in_float32(name):
    check(closed.failures(name, "float32"), name, "float32", corners.QUANTITIES)


@pytest.mark.float64
@pytest.mark.thorough
@pytest.mark.parametrize("name", corners.FUNCTIONS)
def test_closed_form_in_reverse_mode(name):
    found = closed.failures(name, "float64", reverse=True)
    check(found, name, "float64", corners.QUANTITIES)


@pytest.mark.parametrize("model_name", corners.MODELS)
def test_overturning_half_cycle(model_name, precision):
    found = closed.count_failures(model_name, precision)
    check(found, f"{model_name} overturning_half_cycle", precision, corners.QUANTITIES)


@pytest.mark.thorough
def test_respond(precision):
    found = driven.failures("respond", precision)
    check(found, "respond", precision, ("value", "gradient"))


@pytest.mark.thorough
def test_respond_batch(precision):
    found = driven.failures("respond_batch", precision)
    check(found, "respond_batch", precision, ("value", "gradient"))


@pytest.mark.float64
@pytest.mark.thorough
@pytest.mark.parametrize("solver", driven.SOLVERS)
def test_driven_in_float32(solver):
    found = driven.failures(solver, "float32")
    check(found, solver, "float32", ("value", "gradient"))


@pytest.mark.float64
@pytest.mark.thorough
@pytest.mark.release
@pytest.mark.parametrize("solver", driven.SOLVERS)
def test_second_derivatives_of_driven_motion(solver):
    found = driven.failures(solver, "float64", hessian=True)
    check(found, solver, "float64", corners.QUANTITIES)


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


def test_table_is_as_printed():
    assert table.FILE.read_text(encoding="utf-8") == table.text()


def test_limits_name_cells_that_are_there():
    for subject, corner, precision, quantity in limits.KNOWN:
        driven_cells = (
            (corner in driven.CASES[precision]) if subject in driven.SOLVERS else False
        )
        assert driven_cells or (subject in corners.FUNCTIONS and corner in corners.CORNERS)
        assert quantity in corners.QUANTITIES


def test_sum_of_powers():
    for count in (1, 2, 3, 6, 13):
        for ratio in (mp.mpf(0), mp.mpf("0.7"), mp.mpf(1)):
            expected = sum(ratio**k for k in range(count))
            assert mp.almosteq(corners.sum_of_powers(ratio, count), expected, rel_eps=1e-60)
