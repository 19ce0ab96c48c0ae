"""What is computed as it stands, but said: drifts of the ground, and sizes hardly meant."""

from types import SimpleNamespace

import jax
import numpy as np
import pytest
import scenes

import jaxrock as jr
from jaxrock.ground_motion import from_obspy

BLOCK = jr.Block(0.3, 4.0)
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
    with pytest.warns(UserWarning, match=DRIFT) as said:
        jr.read_suite(tmp_path, time_step=STEP)
    assert len(said) == 1

    def trace(samples):
        return SimpleNamespace(data=samples, stats=SimpleNamespace(delta=STEP))

    from_obspy(trace(CORRECTED), unit="m/s2", vertical=trace(RAW))
    with pytest.warns(UserWarning, match=f"trace.* {DRIFT}"):
        from_obspy(trace(RAW), unit="m/s2")


def test_a_drift_is_said_where_pgv_scales_a_record():
    suite = jr.Suite([jr.Record(a, STEP) for a in (CORRECTED, RAW)], ["good", "raw"])
    suite.factors(1.0, "pga")
    for scaled, measure in ((suite, "pgv"), (suite.scaled(0.5), "pgv_ratio")):
        with pytest.warns(UserWarning, match=rf"1 of 2 .*'raw' \({DRIFT}") as said:
            scaled.factors([0.1, 0.2], measure, BLOCK)
        assert len(said) == 1
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
    jax.jit(lambda width: jr.Block.from_size(width=width, height=1.0).half_width)(600.0)
