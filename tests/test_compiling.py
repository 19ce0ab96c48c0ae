"""What is compiled: nothing where nothing new is asked."""

import inspect

import jax
import jax.monitoring
import numpy as np
import pytest
import scenes
from scenes import record, suite
from tools.selection import some_by_default

import jaxrock as jr
from jaxrock.driven.many_blocks import respond_many, single_kernels

_WHOLE = 'xla_cpu_small_call="true"'  # an attribute of a call that is one function
_EVENT = "/jax/core/compile/backend_compile_duration"
STOUT = jr.Block(1.5, 1.0)
SLOW = pytest.mark.thorough


_NAMES = []  # of the programs that were compiled


def _hear(event, seconds, **details):
    if event == _EVENT:
        _NAMES.append(details.get("fun_name", ""))


jax.monitoring.register_event_duration_secs_listener(_hear)


@pytest.fixture
def compiled():
    """Names of the programs that were compiled."""
    _NAMES.clear()
    return _NAMES


def site(k, levels):
    return jr.risk.Site(
        suite(k), jr.risk.Hazard([0.1 + 0.01 * k, 1.0], [1e-2, 1e-4]), levels=levels
    )


def block(k):
    return jr.Block(0.2 + 0.01 * k, 5.0 + 0.1 * k)


def scene(k):
    return jr.Scene(jr.Block(0.4 + 0.01 * k, 5.0), 0.7 + 0.01 * k, 0.15)


def pulse(k, shape=jr.Sine):
    return shape(3.0 + 0.1 * k, 0.5)


def pulses(k):
    return jr.Sine(np.linspace(2, 4, 5) + k, 0.5)


def wall(k):
    return jr.Scene(jr.Block(0.4 + 0.01 * k, 5.0), 0.7, 0.28)


def impact_times(k):
    """Of a block that loses a tenth of its velocity at each impact."""
    return scenes.impact_times(jr.Block(0.1 + 0.01 * k, 5), 0.9, 0.9 - 0.01 * k)


def shaking_test(k):
    """A rotation measured on a shaking table, the block, and the motion of the table."""
    pulse = jr.Sine(2.5 + 0.01 * k, 0.8)
    time = np.linspace(0, 4, 101)
    rotation, _ = jr.respond(jr.Block(0.2, 5.0), 0.85, pulse, 4.0).history(time)
    return time, rotation, jr.Block(0.2, 5.0), pulse


_COEFFICIENTS = {"restitution": 0.05}
_RANGES = {"intensity": (0.1, 0.16)}
_slopes = jr.value_and_slopes(jr.rotation_ratio)

# What is called first with 0 and then with 1: with other numbers of the same shapes.
CALLS = {
    "Block": lambda k: (block(k).critical_angle, block(k).pulse_velocity(0.1 + k)),
    "Sine": lambda k: (pulse(k).horizontal(0.1 + k), pulse(k).shifted(k).scaled(k).knots()),
    "Cosine": lambda k: pulse(k, jr.Cosine).horizontal(0.1 + k),
    "HalfSine": lambda k: pulse(k, jr.HalfSine).intensity,
    "Floor": lambda k: (
        record(seed=k).on_floor(1.0 + 0.1 * k, 0.05, [1.2 + k]),
        suite(k).on_floor(1.0 + 0.1 * k).both_directions().measure("pga"),
    ),
    "Harmonic": lambda k: (
        jr.Harmonic(3.0 + 0.1 * k, 8.0).shifted(k).scaled(k).horizontal(0.1 + k)
    ),
    "Rectangular": lambda k: pulse(k, jr.Rectangular).upward(0.1 + k),
    "Ricker": lambda k: pulse(k, jr.Ricker).horizontal(0.1 + k),
    "Record": lambda k: (
        record(seed=k).horizontal(0.1 + k),
        record(seed=k).scaled(1.0 + k).intensity,
        record(seed=k).knots(),
    ),
    "Suite": lambda k: suite(k).scaled(1.0 + k).measure("pga_ratio", block(k)),
    "Hazard": lambda k: jr.risk.Hazard([0.1 + 0.01 * k, 1.0], [1e-2, 1e-4])(0.2 + 0.1 * k),
    "amplification": lambda k: jr.amplification(scene(k)),
    "assess": lambda k: (
        jr.reports.assess(block(k), 0.7, 0.15),
        jr.reports.assess(block(k), 0.7 + 0.01 * k),
    ),
    "choose": lambda k: jr.accuracy.choose(scene(k), 0.01 + 0.01 * k),
    "critical_amplitude": lambda k: jr.critical_amplitude(
        jr.Block(0.1 + 0.02 * k, 5.0), 0.9, jr.Sine, 0.5
    ),
    "critical_intensity": lambda k: jr.critical_intensity(block(k), 0.7 + 0.01 * k),
    "critical_pulsed_amplitude": lambda k: jr.steady.critical_pulsed_amplitude(
        block(k), 0.7, jr.HalfSine, 0.1 + 0.01 * k
    ),
    "critical_restitution": lambda k: jr.critical_restitution(block(k), 0.15),
    "critical_slenderness": lambda k: jr.critical_slenderness(block(k), 0.7, 0.15 + 0.01 * k),
    "critical_values": lambda k: jr.resonance.critical_values(block(k), 0.7, 0.15 + 0.01 * k),
    "critical_width": lambda k: [
        jr.critical_width(block(k), 0.7, 0.15 + 0.01 * k, fixed=fixed)
        for fixed in ("slenderness", "height")
    ],
    "cross_validate": lambda k: jr.calibration.cross_validate(
        suite(k), [k == 0, True, False], splits=1, samples=64
    ),
    "equivalent_damping": lambda k: jr.resonance.equivalent_damping(0.5 + 0.1 * k),
    "example_record": lambda k: jr.example_record(("north", "east")[k]),
    "required_value": lambda k: jr.risk.required_value(
        block(k),
        0.8,
        site(k, [0.2, 0.5, 0.9]),
        1e-3 + 1e-4 * k,
        "width",
        (0.1, 0.5),
    ),
    "outcome_probabilities": lambda k: jr.sensitivity.outcome_probabilities(
        block(k), 0.8, record(500 + k), jr.Uncertain({"restitution": 0.05 + 0.01 * k})
    ),
    "derivatives_within": lambda k: jr.derivatives_within(
        block(k), 0.8, record(500 + k), 1e-3 + 1e-4 * k
    ),
    "driven_tornado": lambda k: jr.sensitivity.driven_tornado(
        block(k), 0.8, record(500 + k), {"restitution": (0.7, 0.8 + 0.01 * k)}
    ),
    "fragility": lambda k: jr.risk.fragility(block(k), 0.8, suite(k), [0.1, 0.2 + 0.1 * k]),
    "fit_driven_rocking": lambda k: jr.calibration.fit_driven_rocking(*shaking_test(k)),
    "fit_free_rocking": lambda k: jr.calibration.fit_free_rocking(
        impact_times(k), jr.Block(0.1 + 0.01 * k, 5)
    ),
    "fit_outcomes": lambda k: jr.calibration.fit_outcomes(
        suite(k), [k == 0, True, False], samples=64
    ).probability(suite(k)),
    "free_motion_margin": lambda k: jr.driven.free_motion_margin(block(k), 0.8, 0.01 * k, 0.1),
    "half_cycle_velocity": lambda k: jr.half_cycle_velocity(scene(k), 2.0 + k),
    "harmonic_orbit": lambda k: jr.steady.harmonic_orbit(block(k), 0.9, 3.0 + k, 10.0 + k),
    "harmonic_spectrum": lambda k: jr.spectra.harmonic_spectrum(
        [2.0, 6.0 + k], [1.0, 6.0 + k], cycles=5
    ),
    "housner_restitution": lambda k: jr.housner_restitution(block(k)),
    "one_sided_restitution": lambda k: jr.one_sided_restitution(block(k)),
    "intensity_measure": lambda k: jr.ground_motion.intensity_measure(record(seed=k), "pgv"),
    "launch_velocity": lambda k: jr.launch_velocity(scene(k)),
    "least_harmonic_amplitude": lambda k: jr.steady.least_harmonic_amplitude(
        block(k), 0.9, 10.0 + k
    ),
    "model_error": lambda k: jr.accuracy.model_error(scene(k)),
    "next_velocity": lambda k: jr.resonance.next_velocity(scene(k), 0.1 + 0.1 * k),
    "overturning_boundaries": lambda k: jr.overturning_boundaries(
        jr.Block(0.05 + 0.003 * k, 5.0), 0.9, record(seed=k), "factor", np.linspace(0.2, 4, 9)
    ),
    "overturning_half_cycle": lambda k: jr.overturning_half_cycle(wall(k)),
    "overturning_map": lambda k: jr.overturning_map(jr.HalfSine, np.linspace(2.0 + k, 4, 3)),
    "overturning_margin": lambda k: jr.overturning_margin(scene(k)),
    "overturning_rate": lambda k: jr.risk.overturning_rate(block(k), 0.8, site(k, [0.2, 0.9])),
    "propagate": lambda k: jr.sensitivity.propagate(
        jr.rotation_ratio, scene(k), jr.Uncertain(_COEFFICIENTS)
    ),
    "pulsed_phase": lambda k: jr.steady.pulsed_phase(
        block(k), 0.7, jr.HalfSine(3.0, 0.1 + 0.01 * k)
    ),
    "rate_elasticities": lambda k: jr.risk.rate_elasticities(
        block(k), 0.8, site(k, [0.2, 0.9])
    ),
    "resonance_spectrum": lambda k: jr.resonance_spectrum(
        5.0, np.linspace(0.2, 1, 5) + 0.1 * k, 0.7, 0.15
    ),
    "respond": lambda k: jr.respond(
        block(k), 0.9, pulse(k), 2.0 + k, rtol=1e-4 * (1 + k), atol=1e-9 * (1 + k)
    ).history(np.linspace(0, 1, 10 + k)),
    "respond_batch": lambda k: jr.respond_batch(block(k), 0.9, pulses(k), 3.0 + k),
    "respond_to_train": lambda k: jr.respond_to_train(
        block(k), 0.7, np.array([0.0, 0.5 + 0.1 * k, 1.5]), np.array([0.3, -0.3, 0.3])
    ).history(np.linspace(0, 1 + k, 10)),
    "respond_within": lambda k: jr.respond_within(block(k), 0.9, pulses(k), 1e-3),
    "rocking_spectrum": lambda k: jr.rocking_spectrum(
        record(seed=k), np.linspace(1.0 + k, 3, 6), 5.0
    ),
    "rotation_ratio": lambda k: jr.rotation_ratio(scene(k)),
    "sensitivities": lambda k: jr.sensitivities(jr.rotation_ratio, scene(k)),
    "stabilized_period": lambda k: jr.stabilized_period(scene(k)),
    "stabilized_rotation": lambda k: jr.stabilized_rotation(scene(k)),
    "stabilized_velocity": lambda k: jr.stabilized_velocity(scene(k)),
    "symmetry_breaking_amplitude": lambda k: jr.steady.symmetry_breaking_amplitude(
        block(k), 0.9, 10.0 + k
    ),
    "tornado": lambda k: jr.tornado(jr.rotation_ratio, scene(k), _RANGES),
    "uplift_factor": lambda k: jr.overturning.uplift_factor(block(k), record(150 + k, seed=k)),
    "value_and_slopes": lambda k: _slopes(scene(k)),
    "worst_train": lambda k: jr.worst_train(
        jr.Block(0.4 + 0.01 * k, 5.0), 0.7, 2, starts=2, seed=k
    ),
}

# What computes nothing, or is not called here, and why.
LEFT_OUT = {
    "Scene": "holds numbers",
    "Assessment": "holds numbers",
    "CriticalValues": "holds numbers",
    "Linearized": "what computes with it is called",
    "Nonlinear": "what computes with it is called",
    "Motion": "is abstract",
    "RockingModel": "is abstract",
    "Pulse": "is abstract",
    "Status": "names numbers",
    "example_suite": "reads without JAX",
    "fema_p695_suite": "reads without JAX",
    "from_obspy": "reads without JAX",
    "read_hazard": "reads without JAX",
    "read_inventory": "reads without JAX",
    "write_inventory_page": "writes without JAX",
    "Inventory": "holds numbers",
    "Site": "holds numbers",
    "Uncertain": "holds numbers",
    "Population": "holds numbers",
    "assess_inventory": "what computes for it is called: outcomes, required values",
    "read_impact_times": "reads without JAX",
    "read_suite": "reads without JAX",
    "read_tests": "reads, and scales by a program of one size",
    "read_record": "reads without JAX",
    "write_table": "writes without JAX",
    "write_zarr": "writes what others compute",
    "measure_tradeoff": "measures first calls too",
}

# Only functions make them.
ANSWERS = {
    jr.risk.RequiredValue,
    jr.sensitivity.OutcomeProbabilities,
    jr.sensitivity.Derivatives,
    jr.sensitivity.Draws,
    jr.driven.BatchResponse,
    jr.overturning.Boundaries,
    jr.accuracy.Choice,
    jr.accuracy.ModelError,
    jr.calibration.DrivenFit,
    jr.calibration.FreeRockingFit,
    jr.calibration.OutcomeFit,
    jr.calibration.Outcomes,
    jr.steady.HarmonicOrbit,
    jr.steady.PulsedPhase,
    jr.steady.PulsedThreshold,
    jr.driven.Response,
    jr.sensitivity.MomentEstimate,
    jr.sensitivity.Sensitivities,
    jr.sensitivity.TornadoBars,
    jr.risk.OverturningRate,
    jr.risk.RateElasticities,
    jr.resonance.TrainResponse,
    jr.driven.EstimatedResponse,
    jr.resonance.WorstTrain,
}


def test_everything_public_is_called():
    rooms = [getattr(jr, name) for name in dir(jr) if name != "plot"]
    everything = {name: getattr(jr, name) for name in jr.__all__}
    for room in rooms:
        everything |= {name: getattr(room, name) for name in getattr(room, "__all__", ())}
    public = {name for name, thing in everything.items() if not inspect.ismodule(thing)}
    public -= {kind.__name__ for kind in ANSWERS}
    assert public == CALLS.keys() | LEFT_OUT.keys()
    assert not CALLS.keys() & LEFT_OUT.keys()


def test_an_answer_of_another_length_is_a_limit(compiled):
    """The knots of a record are as many as its samples: few small programs for each length."""
    record(600).knots()
    compiled.clear()
    record(601).knots()
    assert 0 < len(compiled) <= 5


# One of each kind is for the default run: closed form, root, spectrum, slopes, one block,
# many blocks, boundaries.
OF_EACH_KIND = {
    "Record",
    "critical_intensity",
    "critical_restitution",
    "half_cycle_velocity",
    "overturning_boundaries",
    "respond_batch",
    "rotation_ratio",
    "stabilized_period",
}


@pytest.mark.parametrize("name", some_by_default(CALLS, OF_EACH_KIND))
def test_a_second_call_compiles_nothing(name, compiled):
    CALLS[name](0)
    compiled.clear()
    CALLS[name](1)
    assert compiled == []


@pytest.mark.parametrize(
    "call",
    [
        pytest.param(lambda motion: jr.respond_batch(STOUT, 0.3, motion, 2.0), marks=SLOW),
        lambda motion: (motion.horizontal(3.0), motion.intensity, motion.end),
        pytest.param(lambda motion: jr.respond(STOUT, 0.3, motion, 2.0), marks=SLOW),
        pytest.param(
            lambda motion: jr.overturning_boundaries(STOUT, 0.3, motion, "factor", [0.1, 0.2]),
            marks=SLOW,
        ),
        pytest.param(
            lambda motion: jr.rocking_spectrum(motion, [6.0], 1.0, restitution=0.3), marks=SLOW
        ),
    ],
    ids=["respond_batch", "record", "respond", "boundaries", "spectrum"],
)
def test_twenty_lengths_of_record_take_two_programs(call, compiled):
    """One for records of up to 16,384 samples, and one for those of up to 65,536."""
    for samples in (300, 17000):
        call(record(samples))
    compiled.clear()
    for samples in np.linspace(300, 20000, 20).astype(int):
        call(record(samples))
    assert compiled == []


@pytest.mark.parametrize(
    "question",
    [
        lambda motion: jr.respond_within(STOUT, 0.3, motion, 1e-6, 2.0),
        pytest.param(
            lambda motion: jr.risk.fragility(
                STOUT, 0.3, jr.Suite([motion, motion]), [0.1, 0.2], measure="pga"
            ),
            marks=SLOW,
        ),
        pytest.param(
            lambda motion: jax.jvp(
                lambda c: jr.respond_batch(STOUT, c, motion, 2.0).peak_rotation,
                (0.3,),
                (1.0,),
            ),
            marks=SLOW,
        ),
        pytest.param(
            lambda motion: jax.jacfwd(
                lambda c: jr.respond(STOUT, c, motion, 2.0).peak_rotation
            )(0.3),
            marks=SLOW,
        ),
        pytest.param(
            lambda motion: jax.grad(lambda c: jr.respond(STOUT, c, motion, 2.0).peak_rotation)(
                0.3
            ),
            marks=SLOW,
        ),
    ],
    ids=["respond_within", "fragility", "jvp_of_respond_batch", "jacfwd_of_respond", "grad"],
)
def test_another_length_of_record_takes_no_program(question, compiled):
    """Derivatives included, where the samples themselves are not traced."""
    question(record(300))
    compiled.clear()
    for samples in (301, 400):
        question(record(samples))
    assert compiled == []


def programs_of_the_batch(compiled):
    """How many programs of the batch, whose names differ between versions of JAX."""
    return sum("_follow_rows" in name for name in compiled)


@pytest.mark.filterwarnings("ignore:PGV of 2 of . records is due to a drift")
def test_questions_about_suites_share_programs(compiled):
    """Whatever the suite, the tolerances, and the numbers of blocks and levels."""
    hazard = jr.risk.Hazard([0.1, 1.0], [1e-2, 1e-4])
    questions = [
        lambda some: jr.respond_batch(STOUT, 0.3, some, 2.0),
        lambda some: jr.respond_batch(block(0), 0.3, some, 2.0, rtol=1e-5),
        lambda some: jr.respond_within(
            jr.Block(np.array([0.5, 1.5]), 1.0), 0.3, some, 1e-6, 2.0
        ),
        lambda some: jr.risk.fragility(block(0), 0.8, some, [0.1, 0.3]),
        lambda some: jr.overturning_boundaries(block(0), 0.8, some, "half_width", [0.1, 0.2]),
        lambda some: jr.risk.overturning_rate(
            block(0), 0.8, jr.risk.Site(some, hazard, levels=[0.2, 0.9])
        ),
        lambda some: jr.rocking_spectrum(some, [1.0, 6.0], 5.0, restitution=0.3),
    ]
    two = jr.Suite([record(500), record(900)])
    fast = jr.Record(record(200).acceleration, 0.01)
    three = jr.Suite([record(3000), fast, record(5000)])
    jax.clear_caches()
    for some in (two, three, record(700)):
        for question in questions[: 3 if isinstance(some, jr.Record) else None]:
            question(some)
    assert programs_of_the_batch(compiled) == 1


@pytest.mark.thorough
def test_a_large_suite_takes_one_more_program(compiled):
    """Twenty records of 2,000 to 9,000 samples and three time steps."""
    examples = jr.example_suite()
    jax.clear_caches()
    jr.respond_batch(STOUT, 0.3, examples.scaled(np.full((20, 20), 0.1)))
    jr.respond_batch(STOUT, 0.3, examples[:1])
    assert programs_of_the_batch(compiled) == 2
    compiled.clear()
    jr.respond_batch(STOUT, 0.3, examples[2:], rtol=1e-4)
    assert compiled == []


@pytest.mark.thorough
def test_derivatives_of_a_rate_take_one_program_whatever_moves(compiled):
    place = site(0, [0.2, 0.9])

    def rate(half_width, slenderness, restitution):
        short = jr.Block(half_width, slenderness)
        return jr.risk.overturning_rate(short, restitution, place).rate

    jax.clear_caches()
    for numbers in (0, 1, (0, 2), (0, 1, 2)):
        jax.grad(rate, numbers)(0.1, 6.0, 0.8)
    assert sum("_differentiate_residual" in name for name in compiled) == 1


def test_batches_of_all_sizes_take_one_program(compiled):
    def followed(size):
        blocks = jr.Block(np.linspace(0.2, 0.3, size), 5.0)
        jr.respond_batch(blocks, 0.9, jr.HalfSine(3.0, 0.1), rtol=1e-13 * size)

    followed(1)
    compiled.clear()
    for size in (2, 17, 512, 700, 1000, 3333, 10000):
        followed(size)
    assert compiled == []


@pytest.mark.thorough
def test_blocks_in_motion_take_one_program_more(compiled):
    """Whichever part of the initial state is given, and how."""
    for motion in (pulses(0), record()):
        jr.respond_batch(block(0), 0.9, motion, 3.0, rotation=0.1)
        compiled.clear()
        jr.respond_batch(block(1), 0.9, motion, 3.0, rotation=0.1, velocity=np.zeros(5))
        jr.respond_batch(block(1), 0.9, motion, 3.0, velocity=0.1)
        assert compiled == []


@pytest.mark.thorough
def test_pulses_of_all_shapes_take_two_programs(compiled):
    """One for those made of sines, and one for the wavelet."""
    jax.clear_caches()
    for shape in (jr.Rectangular, jr.HalfSine, jr.Sine, jr.Cosine, jr.Ricker):
        jr.respond_batch(jr.Block(0.2, 5.0), 0.9, shape(3.0, 0.1))
    assert programs_of_the_batch(compiled) == 2


@pytest.mark.thorough
def test_free_fits_of_all_kinds_take_one_program(compiled):
    """Of any number of times and peaks, with repairs and without."""
    slim = jr.Block(0.1, 5)
    jr.calibration.fit_free_rocking(impact_times(0), slim, frequency_known=False)
    compiled.clear()
    for count in (6, 9, 30):
        times = scenes.impact_times(slim, 0.9, 0.9, count)
        jr.calibration.fit_free_rocking(times, slim)
        jr.calibration.fit_free_rocking(times, slim, frequency_known=False, repair=False)
        jr.calibration.fit_free_rocking(
            times, slim, peak_rotations=0.1 * 0.8 ** np.arange(count - 1)
        )
    jr.calibration.fit_free_rocking(np.delete(impact_times(0), 5), slim, time_noise=1e-3)
    assert compiled == []


@pytest.mark.thorough
def test_driven_fits_of_all_parameters_take_one_program(compiled):
    """And of any number of samples."""
    time, rotation, slim, pulse = shaking_test(0)
    rotation = np.asarray(rotation)
    jr.calibration.fit_driven_rocking(time, rotation, slim, pulse)
    compiled.clear()
    for names in (("slenderness",), ("restitution", "half_width"), ("inertia_ratio",)):
        jr.calibration.fit_driven_rocking(
            time[:-9], rotation[:-9], slim, pulse, 0.85, parameters=names
        )
    assert compiled == []


@pytest.mark.parametrize("motion", [pulse(0), record()], ids=["pulse", "record"])
def test_xla_makes_one_function_of_the_steps(motion, monkeypatch):
    """Not one of each of its hundred fused loops: to call these takes longer than they do."""
    texts = []

    def compile_and_note(platform):
        program = compile_batch(platform)

        def call(*arguments, **options):
            texts.append(program.lower(*arguments, **options).compile().as_text())
            return program(*arguments, **options)

        return call

    compile_batch = respond_many._compile
    monkeypatch.setattr(respond_many, "_compile", compile_and_note)
    jr.respond_batch(block(0), 0.9, motion, 2.0)
    (text,) = texts
    calls = [line for line in text.splitlines() if " call(" in line and _WHOLE in line]
    assert len(calls) == 1


def test_barriers_and_loops_may_be_calls():
    """As before JAX 0.12, with arguments that are not used, which had XLA break off."""

    def take_steps(x, unused, count):
        def step(x):
            y, z = single_kernels.materialize((x * closed, x + 1))
            return y * z - count

        return jax.lax.while_loop(lambda x: x[0] < 10, step, x), unused * 2

    def follow(x, unused, count):
        result, _ = single_kernels.call_as_one_function(take_steps, x, unused, count)
        return result

    closed = np.linspace(1.0, 2.0, 8)
    arguments = np.linspace(2.0, 3.0, 8), np.ones(8), np.asarray(1.0)
    as_calls = jax.jit(single_kernels.write_as_calls(follow))
    text = as_calls.lower(*arguments).compile().as_text()
    assert _WHOLE in text
    assert " opt-barrier(" not in text
    np.testing.assert_array_equal(as_calls(*arguments), jax.jit(follow)(*arguments))


def respond(restitution):
    return jr.respond(block(0), restitution, pulse(0), 5.0)


@pytest.mark.parametrize(
    ("function", "most"),
    [
        # Of these a thousand are the Taylor polynomial that reaches events.
        (respond, 3100),
        pytest.param(jax.jacfwd(lambda c: respond(c).peak_rotation), 2900, marks=SLOW),
        pytest.param(
            lambda c: jr.respond(block(0), c, jr.example_record(), 5.0), 3500, marks=SLOW
        ),
        pytest.param(
            lambda c: jr.steady.pulsed_phase(block(0), c, pulse(0, jr.HalfSine)),
            3700,
            marks=SLOW,
        ),
        pytest.param(
            lambda c: jr.steady.critical_pulsed_amplitude(block(0), c, jr.HalfSine, 0.1),
            6800,
            marks=SLOW,
        ),
    ],
    ids=["respond", "slope", "record", "phase", "verge"],
)
def test_programs_do_not_grow(function, most):
    """Lines of StableHLO: what a compiler has to work through at every first call."""
    lines = jax.jit(function).lower(0.9).as_text().count("\n")
    assert 0.5 * most < lines <= most
