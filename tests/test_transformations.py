"""Closed forms under jit, vmap and grad, and broadcasting.

Of every function shapes and precision, for which nothing has to be compiled; the numbers of
one of each kind: a property, broadcast here or inside, by elliptic integrals, by Newton's
method, over time, of a count.
"""

import functools
import inspect
import re
from pathlib import Path

import jax
import jax.numpy as jnp
import jaxtyping
import numpy as np
import pytest
from tables.closed_form_cases import CASES, NAMES, read_samples
from tools.selection import first_by_default, some_by_default

import jaxrock as jr

ONE_OF_EACH_KIND = (
    "Block.frequency_parameter",
    "half_cycle_velocity(5)",
    "Linearized amplification",
    "Nonlinear.peak_rotation",
    "Nonlinear.half_cycle_duration",
    "Linearized critical_slenderness(5)",
)


@functools.cache
def arguments_of(name):
    samples, _ = read_samples(name, "float32")
    return tuple(jnp.asarray(a[:6], np.float32) for a in samples.arguments)


@pytest.mark.parametrize("name", NAMES)
def test_shapes_and_precision(name):
    """Of a grid of the first argument against the others, and of one point."""
    function = CASES[name].ours
    size = len(arguments_of(name))

    def given(shape):
        return jax.ShapeDtypeStruct(shape, np.float32)

    grid = jax.eval_shape(function, given((6, 1)), *[given((1, 6))] * (size - 1))
    assert grid.shape in ((6, 6), (1, 6))  # the first argument may not matter
    one = jax.eval_shape(function, *[given(())] * size)
    assert one.shape == ()
    assert grid.dtype == one.dtype == np.float32


@pytest.mark.parametrize("name", first_by_default(ONE_OF_EACH_KIND, 2))
def test_transformations(name):
    """A grid of the first argument against the others, point by point; one program for all."""
    dtype = jnp.result_type(float)
    function = CASES[name].ours
    arguments = [jnp.asarray(a, dtype) for a in arguments_of(name)]
    direct = np.asarray(function(*arguments))
    assert direct.shape == (6,)
    assert direct.dtype == dtype

    def total(first, *others):
        grid = function(first[:, None], *(a[None, :] for a in others))
        return grid.sum(), jnp.broadcast_to(grid, (6, 6))

    @jax.jit
    def transformed(first, *others):
        points = jnp.broadcast_arrays(first[:, None], *(a[None, :] for a in others))
        one_by_one = jax.vmap(function)(*(a.ravel() for a in points)).reshape(6, 6)
        slopes, grid = jax.grad(total, range(len(arguments)), has_aux=True)(first, *others)
        return grid, one_by_one, slopes

    grid, one_by_one, slopes = transformed(*arguments)
    # Some points are so close to the verge that rounding shows in float32.
    rtol = 1e-11 if dtype == np.float64 else 0.02
    np.testing.assert_allclose(grid, one_by_one, rtol=rtol)
    np.testing.assert_allclose(np.diagonal(grid), direct, rtol=rtol)
    assert all(slope.shape == (6,) and slope.dtype == dtype for slope in slopes)


BLOCK = jr.Block(0.4, 5.0)


PULSE = jr.HalfSine(4.0, 0.4)
RECORD = jr.Record([0.0, 1.0, -1.0, 0.0], 0.1)
SUITE = jr.Suite([RECORD])
SITE = jr.risk.Site(SUITE, jr.risk.Hazard([0.1, 1.0], [1e-2, 1e-4]))
PAGE = Path(__file__).parent.parent / "docs" / "reference" / "index.md"


def scene_of(c):
    return jr.Scene(BLOCK, c, 0.15)


# Functions of the page that are called otherwise than with a scene, as functions of C.
CALLED_WITH = {
    "Block": lambda c: jr.Block(c, 5.0).height,
    "Scene": lambda c: scene_of(c).restitution,
    "next_velocity": lambda c: jr.resonance.next_velocity(scene_of(c), 0.1),
    "half_cycle_velocity": lambda c: jr.half_cycle_velocity(scene_of(c), 3),
    "critical_intensity": lambda c: jr.critical_intensity(BLOCK, c),
    "critical_restitution": lambda c: jr.critical_restitution(BLOCK, c),
    "critical_slenderness": lambda c: jr.critical_slenderness(BLOCK, c, 0.15),
    "critical_width": lambda c: jr.critical_width(BLOCK, c, 0.15),
    "housner_restitution": lambda c: jr.housner_restitution(jr.Block(c, 5.0)),
    "one_sided_restitution": lambda c: jr.one_sided_restitution(jr.Block(c, 5.0)),
    "value_and_slopes": lambda c: jr.value_and_slopes(lambda x: 2 * x)(c)[0],
    "assess": lambda c: jr.reports.assess(BLOCK, c, 0.15),
    "pulsed_phase": lambda c: jr.steady.pulsed_phase(BLOCK, c, PULSE).rotation_ratio,
    "critical_pulsed_amplitude": lambda c: (
        jr.steady.critical_pulsed_amplitude(BLOCK, c, jr.HalfSine, 0.1).amplitude
    ),
    "harmonic_orbit": lambda c: jr.steady.harmonic_orbit(BLOCK, c, 4.0, 4.0).peak_rotation,
    "respond": lambda c: jr.respond(BLOCK, c, PULSE).peak_rotation,
    "overturning_boundaries": lambda c: jr.overturning_boundaries(
        BLOCK, c, PULSE, "amplitude", [1.0, 5.0]
    ).value[0],
    "critical_amplitude": lambda c: jr.critical_amplitude(BLOCK, c, jr.HalfSine, 0.4).value[0],
    "respond_batch": lambda c: jr.respond_batch(BLOCK, c, PULSE).peak_rotation,
    "respond_to_train": lambda c: (
        jr.respond_to_train(BLOCK, c, [0.0, 0.5], [0.3, -0.3]).peak_rotation
    ),
    "respond_within": lambda c: jr.respond_within(BLOCK, c, PULSE, 1e-3).error,
    "derivatives_within": lambda c: jr.derivatives_within(BLOCK, c, PULSE, 1e-3).value,
    "worst_train": lambda c: jr.worst_train(BLOCK, c, 3).intensities[0],
    "choose": lambda c: jr.accuracy.choose(scene_of(c), 1e-3).index,
    "sensitivities": lambda c: jr.sensitivities(jr.rotation_ratio, scene_of(c)).value,
    "tornado": lambda c: (
        jr.tornado(jr.rotation_ratio, scene_of(c), {"restitution": (0.6, 0.8)}).value
    ),
    "resonance_spectrum": lambda c: jr.resonance_spectrum([3.0], [0.4], c, 0.15),
    "rocking_spectrum": lambda c: jr.rocking_spectrum(RECORD, [2.0], [5.0], c),
    "harmonic_spectrum": lambda c: jr.spectra.harmonic_spectrum([3.0], [1.0], restitution=c),
    "fragility": lambda c: jr.risk.fragility(BLOCK, c, SUITE),
    "overturning_map": lambda c: jr.overturning_map(jr.HalfSine, [2.0], restitution=c),
    "model_error": lambda c: jr.accuracy.model_error(scene_of(c)).linearization.rotation_ratio,
    "Hazard": lambda level: SITE.hazard(level),
    "overturning_rate": lambda c: jr.risk.overturning_rate(BLOCK, c, SITE).rate,
    "required_value": lambda c: jr.risk.required_value(BLOCK, c, SITE, 1e-3).value,
    "fit_free_rocking": lambda time: jr.calibration.fit_free_rocking(
        time * jnp.arange(1.0, 4.0), BLOCK
    ),
    "fit_driven_rocking": lambda time: jr.calibration.fit_driven_rocking(
        time * jnp.arange(4.0), jnp.zeros(4), BLOCK, PULSE
    ),
    "fit_outcomes": lambda factor: jr.calibration.fit_outcomes(SUITE.scaled(factor), [True]),
}
ROWS = re.findall(r"^\| (`.+) \| (\w+) \| (\w+) \| (\w+) \|$", PAGE.read_text(), re.MULTILINE)
STATED = {name: marks for names, *marks in ROWS for name in re.findall(r"`(\w+)`", names)}


def test_the_page_states_all_functions():
    files = ("read_", "write_", "example_")
    functions = [n for n in dir(jr) if inspect.isroutine(getattr(jr, n))]
    assert [n for n in functions if n not in STATED and not n.startswith(files)] == []


@pytest.mark.float64
@pytest.mark.parametrize(
    "name",
    some_by_default(STATED, {"rotation_ratio", "respond_batch", "choose", "worst_train"}),
)
def test_the_page_says_which_transformations_work(name, monkeypatch):
    """Traced only, which shows it: nothing is compiled."""
    # Without the types that the tests check, which would answer before the package does.
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    function = CALLED_WITH.get(name, lambda c: getattr(jr, name)(scene_of(c)))
    transformed = {
        "jit": lambda: jax.eval_shape(function, 0.7),
        "vmap": lambda: jax.eval_shape(jax.vmap(function), jnp.full(2, 0.7)),
        "grad": lambda: jax.make_jaxpr(jax.grad(function))(0.7),
    }
    if STATED[name] == ["no", "no", "yes"]:  # what is concrete has a derivative nevertheless
        transformed["grad"] = lambda: jax.grad(function)(0.7)
    for transform, mark in zip(transformed, STATED[name], strict=True):
        if mark == "yes":
            transformed[transform]()
            continue
        with pytest.raises(ValueError, match=r"must be concrete here|in forward mode only"):
            transformed[transform]()
    if STATED[name][2] == "forward":
        jax.make_jaxpr(jax.jacfwd(function))(0.7)
