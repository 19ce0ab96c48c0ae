"""What is compiled: nothing where nothing new is asked, and no more than a bounded program."""

import jax
import jax.monitoring
import numpy as np
import pytest
from scenes import record, suite
from tools.selection import first_by_default, some_by_default

import jaxrock as jr

STOUT = jr.Block(1.5, 1.0)
_NAMES = []  # of the programs that were compiled


def _hear(event, seconds, **details):
    if event == "/jax/core/compile/backend_compile_duration":
        _NAMES.append(details.get("fun_name", ""))


jax.monitoring.register_event_duration_secs_listener(_hear)


@pytest.fixture
def compiled():
    """Names of the programs that were compiled."""
    _NAMES.clear()
    return _NAMES


def site(k):
    hazard = jr.risk.Hazard([0.1 + 0.01 * k, 1.0], [1e-2, 1e-4])
    return jr.risk.Site(suite(k), hazard, levels=[0.2, 0.9])


def block(k):
    return jr.Block(0.2 + 0.01 * k, 5.0 + 0.1 * k)


def scene(k):
    return jr.Scene(jr.Block(0.4 + 0.01 * k, 5.0), 0.7 + 0.01 * k, 0.15)


def pulse(k, shape=jr.Sine):
    return shape(3.0 + 0.1 * k, 0.5)


def pulses(k):
    return jr.Sine(np.linspace(2, 4, 5) + k, 0.5)


# What is called first with 0 and then with 1: with other numbers of the same shapes. One of each
# kind: closed form, root, spectrum, slopes, train, orbit, floor, one and many blocks, boundaries.
CALLS = {
    "rotation_ratio": lambda k: jr.rotation_ratio(scene(k)),
    "half_cycle_velocity": lambda k: jr.half_cycle_velocity(scene(k), 2.0 + k),
    "critical_restitution": lambda k: jr.critical_restitution(block(k), 0.15),
    "record": lambda k: (
        record(seed=k).scaled(1.0 + k).intensity,
        record(seed=k).on_floor(1.0 + 0.1 * k, 0.05, [1.2 + k]),
    ),
    "respond_batch": lambda k: jr.respond_batch(block(k), 0.9, pulses(k), 3.0 + k),
    "boundaries": lambda k: jr.overturning_boundaries(
        jr.Block(0.05 + 0.003 * k, 5.0), 0.9, record(seed=k), "factor", np.linspace(0.2, 4, 9)
    ),
    "respond": lambda k: jr.respond(
        block(k), 0.9, pulse(k), 2.0 + k, rtol=1e-4 * (1 + k), atol=1e-9 * (1 + k)
    ).history(np.linspace(0, 1, 10 + k)),
    "respond_within": lambda k: jr.respond_within(block(k), 0.9, pulses(k), 1e-3),
    "respond_to_train": lambda k: jr.respond_to_train(
        block(k), 0.7, np.array([0.0, 0.5 + 0.1 * k, 1.5]), np.array([0.3, -0.3, 0.3])
    ).history(np.linspace(0, 1 + k, 10)),
    "sensitivities": lambda k: jr.sensitivities(jr.rotation_ratio, scene(k)),
    "resonance_spectrum": lambda k: jr.resonance_spectrum(
        5.0, np.linspace(0.2, 1, 5) + 0.1 * k, 0.7, 0.15
    ),
    "rocking_spectrum": lambda k: jr.rocking_spectrum(
        record(seed=k), np.linspace(1.0 + k, 3, 6), 5.0
    ),
    "harmonic_orbit": lambda k: jr.steady.harmonic_orbit(block(k), 0.9, 3.0 + k, 10.0 + k),
    "overturning_rate": lambda k: jr.risk.overturning_rate(block(k), 0.8, site(k)),
    "fit_outcomes": lambda k: jr.calibration.fit_outcomes(
        suite(k), [k == 0, True, False], samples=64
    ).probability(suite(k)),
}
BY_DEFAULT = {
    "rotation_ratio", "half_cycle_velocity", "critical_restitution", "record", "respond_batch"
}  # fmt: skip


@pytest.mark.parametrize("name", some_by_default(CALLS, BY_DEFAULT))
def test_a_second_call_compiles_nothing(name, compiled):
    CALLS[name](0)
    compiled.clear()
    CALLS[name](1)
    assert compiled == []


def test_batches_of_all_sizes_take_one_program(compiled):
    def follow(size):
        blocks = jr.Block(np.linspace(0.2, 0.3, size), 5.0)
        jr.respond_batch(blocks, 0.9, jr.HalfSine(3.0, 0.1), rtol=1e-13 * size)

    follow(1)
    compiled.clear()
    for size in (2, 700, 3333):
        follow(size)
    assert compiled == []


QUESTIONS = {
    "respond_batch": lambda motion: jr.respond_batch(STOUT, 0.3, motion, 2.0),
    "respond": lambda motion: jr.respond(STOUT, 0.3, motion, 2.0),
    "boundaries": lambda motion: jr.overturning_boundaries(
        STOUT, 0.3, motion, "factor", [0.1, 0.2]
    ),
    "jvp": lambda motion: jax.jvp(
        lambda c: jr.respond_batch(STOUT, c, motion, 2.0).peak_rotation, (0.3,), (1.0,)
    ),
    "grad": lambda motion: jax.grad(lambda c: jr.respond(STOUT, c, motion, 2.0).peak_rotation)(
        0.3
    ),
}


@pytest.mark.parametrize("name", first_by_default(QUESTIONS))
def test_records_of_all_lengths_take_two_programs(name, compiled):
    """One for those of up to 16,384 samples, and one for those of up to 65,536."""
    for samples in (300, 17000):
        QUESTIONS[name](record(samples))
    compiled.clear()
    for samples in (301, 5000, 16384, 20000):
        QUESTIONS[name](record(samples))
    assert compiled == []


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore:PGV of 2 of . records is due to a drift")
def test_questions_about_suites_share_a_program(compiled):
    """Whatever the suite, the tolerances, and the numbers of blocks and levels."""
    hazard = jr.risk.Hazard([0.1, 1.0], [1e-2, 1e-4])
    two = jr.Suite([record(500), record(900)])
    three = jr.Suite([record(3000), record(200), record(5000)])
    jax.clear_caches()
    for some in (two, three):
        jr.respond_batch(block(0), 0.3, some, 2.0, rtol=1e-5)
        jr.respond_within(jr.Block(np.array([0.5, 1.5]), 1.0), 0.3, some, 1e-6, 2.0)
        jr.risk.fragility(block(0), 0.8, some, [0.1, 0.3])
        jr.risk.overturning_rate(block(0), 0.8, jr.risk.Site(some, hazard, levels=[0.2, 0.9]))
    assert sum("_follow_rows" in name for name in compiled) == 1


def respond(restitution):
    return jr.respond(block(0), restitution, pulse(0), 5.0)


# Functions of C, and how many lines of StableHLO they may have: what a compiler has to work
# through at every first call.
PROGRAMS = {
    "respond": (respond, 3100),
    "slope": (jax.jacfwd(lambda c: respond(c).peak_rotation), 2900),
    "second": (jax.jacfwd(jax.grad(lambda c: respond(c).peak_rotation)), 20000),
    "phase": (lambda c: jr.steady.pulsed_phase(block(0), c, pulse(0, jr.HalfSine)), 3700),
    "verge": (
        lambda c: jr.steady.critical_pulsed_amplitude(block(0), c, jr.HalfSine, 0.1), 6800
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", first_by_default(PROGRAMS))
def test_programs_do_not_grow(name):
    function, most = PROGRAMS[name]
    assert jax.jit(function).lower(0.9).as_text().count("\n") <= most
