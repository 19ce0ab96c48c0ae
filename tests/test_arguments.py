"""What is not allowed: NaN where it cannot be refused; and what is said of odd arguments."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scenes
from tools.selection import first_by_default

import jaxrock as jr
from jaxrock.ground_motion import from_obspy

BLOCK = jr.Block(0.4, 5.0)
PULSE = jr.HalfSine(4.0, 0.4)


def total_and_answers(shared, numbers, model):
    """Spoiled is one of the numbers; all elements share a factor of another."""
    b, slenderness, gravity, restitution, intensity = numbers
    block = jr.Block(b * shared["b"], slenderness * shared["slenderness"], gravity)
    scene = jr.Scene(block, restitution, intensity)
    functions = (
        *(jr.rotation_ratio, jr.stabilized_period, jr.stabilized_rotation),
        *(jr.amplification, jr.overturning_margin, jr.overturning_half_cycle),
    )
    answers = [function(scene, model) for function in functions]
    return sum(jnp.nansum(jnp.where(jnp.isinf(a), 0, a)) for a in answers), answers


differentiate = jax.jit(jax.value_and_grad(total_and_answers, has_aux=True))


@pytest.mark.parametrize(
    "model", first_by_default([jr.Linearized(), jr.Nonlinear()]), ids=repr
)
@pytest.mark.parametrize("position", range(5))
def test_traced_values_become_nan_and_leave_their_neighbours_alone(model, position):
    numbers = np.full((5, 3), [[0.4], [5.0], [9.81], [0.6], [0.1]])
    shared = {"b": 1.0, "slenderness": 1.0}
    (_, good), whole = differentiate(shared, numbers, model)
    for wrong in (-1.0, np.nan, np.inf):
        spoiled = numbers.copy()
        spoiled[position, 1] = wrong
        (_, bad), slopes = differentiate(shared, spoiled, model)
        for expected, answer in zip(good, bad, strict=True):
            assert jnp.isnan(answer[1])
            assert (expected[::2] == answer[::2]).all()
        other = "b" if position == 1 else "slenderness"
        np.testing.assert_allclose(slopes[other], whole[other] * 2 / 3, rtol=1e-5)


def test_integers_take_the_precision_of_the_rest():
    single = np.float32(0.4)
    scene = jr.Scene(jr.Block(single, np.arange(3, 6)), np.float32(0.5), np.float32(0.1))
    assert jr.rotation_ratio(scene).dtype == np.float32


@pytest.mark.thorough
def test_a_model_is_given_itself_or_by_its_name():
    for answer in (
        lambda model: jr.critical_intensity(BLOCK, 0.7, model=model),
        lambda model: jr.respond_batch(BLOCK, 0.7, PULSE, model=model).peak_rotation,
        lambda model: jr.resonance_spectrum(5.0, 0.8, 0.7, 0.1, model=model)["rotation_ratio"],
    ):
        linearized = answer(jr.Linearized())
        nonlinear = answer(jr.Nonlinear())
        assert answer("linearized") == linearized != nonlinear == answer("nonlinear")


STEP = 0.01
# A push and its reverse: PGV is (2 / pi) / 2 m/s, at 0.5 s, and the ground is at rest at 1 s.
CORRECTED = np.zeros(1001)
CORRECTED[:101] = np.sin(2 * np.pi * np.linspace(0, 1, 101))
# 0.3 m/s2 for 10 s leave 3 m/s, and without this line PGV is 1 / pi again.
RAW = CORRECTED + 0.3
DRIFT = r"3 m/s.* without .*drift.* 0\.318 m/s"


def test_a_drift_is_said_where_a_record_is_read(tmp_path):
    path = tmp_path / "raw.csv"
    path.write_text("acc [m/s2]\n" + "\n".join(f"{a:.9f}" for a in RAW), encoding="utf-8")
    with pytest.warns(UserWarning, match=rf"raw\.csv'.* {DRIFT}"):
        record = jr.read_record(path, time_step=STEP)
    np.testing.assert_allclose(record.acceleration, RAW, atol=1e-6)

    def trace(samples):
        return SimpleNamespace(data=samples, stats=SimpleNamespace(delta=STEP))

    from_obspy(trace(CORRECTED), unit="m/s2", vertical=trace(RAW))
    with pytest.warns(UserWarning, match=f"trace.* {DRIFT}"):
        from_obspy(trace(RAW), unit="m/s2")


def test_a_drift_is_said_where_pgv_scales_a_record():
    suite = jr.Suite([jr.Record(a, STEP) for a in (CORRECTED, RAW)], ["good", "raw"])
    suite.factors(1.0, "pga")
    with pytest.warns(UserWarning, match=rf"1 of 2 .*'raw' \({DRIFT}") as warnings:
        suite.scaled(0.5).factors([0.1, 0.2], "pgv_ratio", BLOCK)
    assert len(warnings) == 1
    # A drift that hides from PGV, pulses, and traced records are as they are.
    slight = jr.Record(CORRECTED + 0.005, STEP)
    pulse = jr.Record(np.sin(np.linspace(0, np.pi, 400)), STEP)
    jr.Suite([slight, pulse]).factors(1.0, "pgv")
    jax.jit(lambda suite: suite.factors(1.0, "pgv"))(suite)


def test_sizes_and_intensities_that_are_hardly_meant_in_metres():
    with pytest.warns(UserWarning, match="width is 600 m.* in metres"):
        jr.Block.from_size(width=600.0, height=50.0)
    with pytest.warns(UserWarning, match="width is 80 m.* in metres"):
        jr.resonance_spectrum(5.0, [40.0, 80.0], 0.6, 0.15)
    with pytest.warns(UserWarning, match="velocity of 150 m/s"):
        jr.risk.Site(scenes.suite(), jr.risk.Hazard([10.0, 150.0], [1e-2, 1e-4]), "pgv")
    jr.risk.Site(scenes.suite(), jr.risk.Hazard([0.1, 100.0], [1e-2, 1e-4]), "pga")
    jr.Block.from_size(width=30.0, height=100.0)
