"""Many blocks at once, against the adaptive integrator and the independent ones."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_response import cases

import jaxrock as jr


@pytest.mark.float64
@pytest.mark.parametrize("component", ["east", "north"])
@pytest.mark.parametrize("vertical", [0, 1])
def test_record_against_independent_integration(component, vertical):
    """All stable cases of the table, of which there are 120."""
    rows = [r for r in cases(1) if (r["component"], r["vertical"]) == (component, vertical)]
    column = {k: np.array([row[k] for row in rows]) for k in rows[0] if k != "component"}
    record = jr.example_record(component, vertical=bool(vertical)).scaled(column["scale"])
    found = jr.respond_batch(
        jr.Block(column["half_width"], column["slenderness"]), column["restitution"], record, 60.0
    )
    assert len(rows) >= 10
    assert found.complete.all()
    np.testing.assert_array_equal(found.overturned, column["overturned"] == 1)
    stands = column["overturned"] == 0
    np.testing.assert_allclose(
        found.peak_rotation[stands], column["peak_rotation"][stands], rtol=1e-4
    )


@pytest.mark.float64
@pytest.mark.parametrize(
    ("shape", "linearized"),
    [
        pytest.param(jr.Cosine, False, marks=pytest.mark.thorough),
        (jr.Ricker, False),
        pytest.param(jr.Rectangular, False, marks=pytest.mark.thorough),
        pytest.param(jr.Sine, True, marks=pytest.mark.thorough),
    ],
)
def test_pulses_against_adaptive(shape, linearized):
    block, amplitude = jr.Block(0.4, 5.0), np.linspace(1.5, 6.0, 10)
    found = jr.respond_batch(block, 0.9, shape(amplitude, 0.6), 4.0, linearized=linearized)
    for k, a in enumerate(amplitude):
        r = jr.respond(block, 0.9, shape(a, 0.6), 4.0, rtol=1e-11, linearized=linearized)
        assert bool(found.overturned[k]) == bool(r.overturned)
        assert float(found.margin[k]) == pytest.approx(float(r.margin), rel=1e-8, abs=1e-8)
        if not r.overturned:
            assert float(found.peak_rotation[k]) == pytest.approx(float(r.peak_rotation), rel=1e-6)


SHAKEN = np.asarray(jr.example_record("north", vertical=True).acceleration)[1200:1300]
RISING = np.asarray(jr.example_record("north", vertical=True).vertical)[1200:1300]
UPLIFT = 9.81 / 5

CORNERS = {
    "vertical, negative, later, other gravity": (
        jr.Block(0.2, 5.0, 8.0),
        0.6,
        jr.Record(SHAKEN, 0.01, RISING, scale=-1.3, start=0.4),
        1.4,
    ),
    "duration inside": (jr.Block(0.2, 5.0), 0.6, jr.Record(SHAKEN, 0.01), 0.653),
    "squat": (jr.Block(0.5, 1.0), 0.9, jr.Record(SHAKEN, 0.01, scale=4.0), 0.99),
    "linearly up to uplift and down": (
        jr.Block(0.4, 5.0),
        0.7,
        jr.Record([1.1 * UPLIFT, 0.0], 0.02),
        0.02,
    ),
    "up and down in a step": (
        jr.Block(0.4, 5.0),
        0.6,
        jr.Record([1.05 * UPLIFT, 0.2 * UPLIFT, UPLIFT, 0.0], 0.2),
        0.6,
    ),
    # In its steps of 0.02 s the block lands and is lifted again.
    "an impact within a step": (
        jr.Block(0.1035, 8.5649),
        0.3558,
        jr.Record(
            [
                0.326,
                -2.498,
                -1.013,
                -0.123,
                0.614,
                -3.687,
                0.469,
                0.661,
                -2.531,
                2.566,
                3.945,
                0.805,
            ],
            0.02,
        ),
        0.22,
    ),
}


@pytest.mark.float64
@pytest.mark.parametrize(
    "corner",
    # Every length of record compiles anew.
    [
        name
        if name == "an impact within a step"
        else pytest.param(name, marks=pytest.mark.thorough)
        for name in CORNERS
    ],
)
def test_corners_against_adaptive(corner):
    scene = CORNERS[corner]
    r, found = jr.respond(*scene), jr.respond_batch(*scene)
    assert found.complete
    scale = float(r.peak_rotation)
    assert float(found.peak_rotation) == pytest.approx(scale, rel=1e-5)
    for name in ("final_rotation", "final_velocity"):
        assert float(getattr(found, name)) == pytest.approx(
            float(getattr(r, name)), rel=1e-5, abs=1e-5 * scale
        )
    assert float(found.margin) == pytest.approx(float(r.margin), rel=1e-5)
    # Those in which it comes to rest, many and small, are not counted.
    assert found.impacts == r.impacts or 2 < found.impacts < r.impacts > 20


@pytest.mark.float64
def test_input_that_just_lifts():
    """Exactly so, where a block would chatter for ever, and by very little."""
    period = np.random.default_rng(0).uniform(0.05, 3, 500)
    block = jr.Block(0.3, 5.0)
    for shape in (jr.Sine, jr.Ricker):
        exactly = jr.respond_batch(block, 0.9, shape(UPLIFT, period), 10.0)
        assert exactly.complete.all()
        assert (exactly.peak_rotation == 0).all()
        beyond = jr.respond_batch(block, 0.9, shape(UPLIFT * (1 + 1e-9), period), 10.0)
        assert beyond.complete.all()
        assert (beyond.peak_rotation < 1e-6).all()


def test_a_block_does_not_depend_on_its_batch():
    rng = np.random.default_rng(0)
    block = jr.Block(rng.uniform(0.1, 0.5, 301), rng.uniform(3, 8, 301))
    c, record = rng.uniform(0.5, 0.95, 301), jr.example_record()
    together = jr.respond_batch(block, c, record, 20.0)
    for part in (slice(0, 1), slice(7, 60), slice(0, 301, 5)):
        some = jax.tree.map(lambda leaf, part=part: leaf[part] if leaf.ndim else leaf, block)
        alone = jr.respond_batch(some, c[part], record, 20.0)
        np.testing.assert_array_equal(alone.peak_rotation, together.peak_rotation[part])
        np.testing.assert_array_equal(alone.impacts, together.impacts[part])


def test_several_records_and_shapes():
    north, east = jr.example_record("north"), jr.example_record("east")
    both = jr.Record(jnp.stack([north.acceleration, east.acceleration]), 0.01)
    block = jr.Block(np.array([[0.1], [0.2], [0.3]]), 6.0)
    found = jr.respond_batch(block, 0.8, both, 15.0)
    assert found.peak_rotation.shape == (3, 2)
    for k, record in enumerate((north, east)):
        one = jr.respond_batch(block, 0.8, record, 15.0)
        np.testing.assert_array_equal(one.peak_rotation[:, 0], found.peak_rotation[:, k])


@pytest.mark.thorough
@pytest.mark.float64
def test_derivative():
    def peak(amplitude):
        return jr.respond_batch(jr.Block(0.4, 5.0), 0.9, jr.Sine(amplitude, 0.7), 6.0).peak_rotation

    def adaptive(amplitude):
        return jr.respond(jr.Block(0.4, 5.0), 0.9, jr.Sine(amplitude, 0.7), 6.0).peak_rotation

    found = jax.jvp(peak, (3.2,), (1.0,))[1]
    difference = (adaptive(3.2 + 1e-3) - adaptive(3.2 - 1e-3)) / 2e-3
    assert float(found) == pytest.approx(float(difference), rel=1e-4)


def test_never_lifted_and_traced_bad_values():
    found = jr.respond_batch(jr.Block(0.3, 5.0), 0.9, jr.Sine(np.array([0.0, 1.0]), 0.5), 2.0)
    assert (found.peak_rotation == 0).all()
    assert not found.overturned.any()
    assert found.complete.all()

    def run(c):
        return jr.respond_batch(jr.Block(0.3, 5.0), c, jr.Sine(4.0, 0.5), 2.0)

    mixed = jax.jit(run)(jnp.asarray([0.9, jnp.nan, 1.5]))
    assert mixed.complete.tolist() == [True, False, False]
    assert np.isnan(mixed.peak_rotation).tolist() == [False, True, True]

    def shaken(samples, start):
        record = jr.Record(samples, 0.01, start=start)
        return jr.respond_batch(jr.Block(0.3, 5.0), 0.9, record, 2.0)

    samples = jnp.asarray(np.stack([SHAKEN, SHAKEN]), np.float32).at[1, 50].set(jnp.nan)
    broken = jax.jit(shaken)(samples, jnp.float32(0.1))
    assert broken.complete.tolist() == [True, False]
    assert np.isnan(broken.peak_rotation).tolist() == [False, True]
    assert not jax.jit(shaken)(samples, jnp.float32(-0.1)).complete.any()


@pytest.mark.parametrize(
    ("c", "duration", "words"),
    [(1.2, 1.0, "restitution must be between 0 and 1"), (0.9, 0.0, "duration must be finite")],
)
def test_bad_input(c, duration, words):
    with pytest.raises(ValueError, match=words):
        jr.respond_batch(jr.Block(0.3, 5.0), c, jr.Sine(4.0, 0.5), duration)
