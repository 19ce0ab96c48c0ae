"""What is computed as it stands, but said: drifts of the ground, and sizes hardly meant."""

import re
import warnings
from types import SimpleNamespace

import jax
import numpy as np
import pytest
import scenes

import jaxrock as jr
from jaxrock.cli import main
from jaxrock.ground_motion import Suite, from_obspy

G = 9.80665
BLOCK = jr.Block(0.3, 4.0)
STEP = 0.01
# A push and its reverse: PGV is (2 / pi) / 2 m/s, at 0.5 s, and the ground is at rest at 1 s.
CORRECTED = np.zeros(1001)
CORRECTED[:101] = np.sin(2 * np.pi * np.linspace(0, 1, 101))
# 0.3 m/s2 for 10 s leave 3 m/s, and without this line PGV is 1 / pi again.
RAW = CORRECTED + 0.3
OF_SUITE = (
    "PGV of 1 of 2 records is due to a drift: 'raw' (3 m/s, without the drift 0.318 m/s)"
)
SAID = "moves at 3 m/s at the end, and PGV is 3 m/s; without this drift it is 0.318 m/s"


def write(folder, name, samples):
    path = folder / name
    path.write_text("acc [g]\n" + "\n".join(f"{a / G:.9f}" for a in samples), encoding="utf-8")
    return path


def test_a_drift_is_said_where_a_record_is_read(tmp_path):
    good = write(tmp_path, "good.csv", CORRECTED)
    bad = write(tmp_path, "raw.csv", RAW)
    jr.read_record(good, time_step=STEP)
    with pytest.warns(UserWarning, match=rf"raw\.csv'.* {SAID}"):
        record = jr.read_record(bad, time_step=STEP)
    np.testing.assert_allclose(record.acceleration, RAW, atol=1e-6)
    with pytest.warns(UserWarning, match=SAID) as said:
        jr.read_suite(tmp_path, time_step=STEP)
    assert len(said) == 1

    def trace(samples):
        return SimpleNamespace(data=samples, stats=SimpleNamespace(delta=STEP))

    from_obspy(trace(CORRECTED), unit="m/s2", vertical=trace(RAW))
    with pytest.warns(UserWarning, match=f"trace: the ground still {SAID}"):
        from_obspy(trace(RAW), unit="m/s2")


def test_a_drift_is_said_where_pgv_scales_a_record():
    suite = Suite([jr.Record(samples, STEP) for samples in (CORRECTED, RAW)], ["good", "raw"])
    suite.factors(1.0, "pga")
    # Whatever the scale: the same words, which Python shows once.
    for each, measure in ((suite, "pgv"), (suite.scaled(0.5), "pgv_ratio")):
        with pytest.warns(UserWarning, match=re.escape(OF_SUITE)) as said:
            each.factors([0.1, 0.2], measure, BLOCK)
        assert len(said) == 1
    # A drift that hides from PGV, pulses, and traced records are as they are.
    slight = jr.Record(CORRECTED + 0.005, STEP)
    pulse = jr.Record(np.sin(np.linspace(0, np.pi, 400)), STEP)
    jr.Suite([slight, pulse]).factors(1.0, "pgv")
    jax.jit(lambda suite: suite.factors(1.0, "pgv"))(suite)


@pytest.mark.thorough
def test_a_command_prints_a_drift_once_for_each_use(tmp_path, capsys):
    write(tmp_path, "raw.csv", RAW)
    words = [
        "fragility",
        "--records",
        str(tmp_path),
        "--time-step",
        str(STEP),
        "--levels",
        "0.1",
    ]
    size = ["--width", "0.6", "--height", "2.4", "--restitution", "0.8"]
    of_suite = OF_SUITE.replace("of 2 records", "of 1 records")
    for measure, uses in (("pga", [SAID]), ("pgv", [SAID, of_suite])):
        with warnings.catch_warnings():
            warnings.simplefilter("default")
            main([*words, *size, "--out", str(tmp_path / measure), "--measure", measure])
        said = capsys.readouterr().err.splitlines()
        assert len(said) == len(uses)
        for line, words_of_it in zip(said, uses, strict=True):
            assert line.startswith("jaxrock: warning: ")
            assert words_of_it in line


@pytest.mark.parametrize(
    ("unit", "factor"), [("g", G), ("%g", 0.01 * G), ("cm/s^2", 0.01), ("m/s2", 1.0)]
)
def test_a_record_in_another_unit(unit, factor):
    samples = np.array([0.0, 0.5, -0.25])
    upward = np.array([0.1, 0.0, 0.2])
    record = jr.Record(samples, 0.1, upward, unit=unit)
    np.testing.assert_allclose(record.acceleration, factor * samples, rtol=1e-6)
    np.testing.assert_allclose(record.vertical, factor * upward, rtol=1e-6)
    assert record.scale == 1
    traced = jax.jit(lambda a: jr.Record(a, 0.1, unit=unit).acceleration)(samples)
    np.testing.assert_allclose(traced, record.acceleration, rtol=1e-6)
    assert not hasattr(record, "unit")


def test_sizes_that_are_hardly_meant_in_metres():
    with pytest.warns(UserWarning, match="width is 600 m: sizes are in metres"):
        jr.Block.from_size(width=600.0, height=50.0)
    with pytest.warns(UserWarning, match="height is 2400 m: sizes are in metres"):
        jr.Block.from_size(width=6.0, height=np.array([2.4, 2400.0]))
    with pytest.warns(UserWarning, match="width is 80 m: sizes are in metres"):
        jr.resonance_spectrum(5.0, [40.0, 80.0], 0.6, 0.15)
    jr.Block.from_size(width=30.0, height=100.0)
    assert jr.Block.from_size(width=np.zeros(0), height=1.0).width.shape == (0,)
    jax.jit(lambda width: jr.Block.from_size(width=width, height=1.0).half_width)(600.0)


def test_intensities_that_are_hardly_meant_in_metres():
    suite = scenes.suite()
    sentence = (
        r"the hazard reaches a peak ground velocity of 150 m/s, more than any earthquake: is the"
        r" unit right\?"
    )
    with pytest.warns(UserWarning, match=f"^{sentence}$"):
        jr.Site(suite, jr.Hazard([10.0, 150.0], [1e-2, 1e-4]), "pgv")
    with pytest.warns(UserWarning, match="acceleration of 600 m/s2, more"):
        jr.Site(suite, jr.Hazard([10.0, 600.0], [1e-2, 1e-4]), "pga")
    for measure, largest in (("pgv", 20.0), ("pga", 100.0)):
        jr.Site(suite, jr.Hazard([0.1, largest], [1e-2, 1e-4]), measure)
