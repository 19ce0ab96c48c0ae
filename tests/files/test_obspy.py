"""Traces of obspy and gmprocess, and the files that obspy reads: miniSEED and SAC."""

import io
import sys
import warnings
from types import SimpleNamespace

import numpy as np
import pytest

import jaxrock as jr
from jaxrock.ground_motion import from_obspy

with warnings.catch_warnings():
    # As the library does: one of obspy's imports is deprecated in Python 3.11.
    warnings.simplefilter("ignore")
    obspy = pytest.importorskip("obspy")

pytestmark = pytest.mark.float64

G = 9.80665
# Samples in cm/s2, which float32 holds exactly: no rounding stands between file and record.
GALS = {
    channel: np.random.default_rng(7).normal(0, 100, 400).round() + k + 0.25
    for k, channel in enumerate(("HNE", "HNN", "HNZ"))
}


def make_trace(channel="HNE", data=None, start=0.0, **more):
    header = {"network": "XX", "station": "ABC", "channel": channel, "delta": 0.005}
    header["starttime"] = obspy.UTCDateTime(2020, 1, 1) + start
    data = GALS[channel].astype(np.float32) if data is None else data
    return obspy.Trace(data, header | more)


def pack(kind, *traces):
    buffer = io.BytesIO()
    options = {"reclen": 512} if kind == "MSEED" else {}
    obspy.Stream(list(traces)).write(buffer, kind, **options)
    return buffer.getvalue()


def test_miniseed(write):
    # By its beginning, where its name says nothing.
    path = write(pack("MSEED", *map(make_trace, GALS)), "a.bin")
    record = jr.read_record(path, unit="gal", column="HNN", vertical="up")
    np.testing.assert_allclose(record.acceleration, GALS["HNN"] / 100, rtol=1e-14)
    np.testing.assert_allclose(record.vertical, GALS["HNZ"] / 100, rtol=1e-14)
    assert float(record.time_step) == 0.005
    assert jr.read_suite([path], unit="gal", vertical=True).names == ("a HNE", "a HNN")


def test_sac(write):
    content = pack("SAC", make_trace())
    record = jr.read_record(write(content, "a.sac"), unit="gal")
    np.testing.assert_allclose(record.acceleration, GALS["HNE"] / 100, rtol=1e-14)
    assert float(record.time_step) == pytest.approx(0.005, rel=1e-7)
    # A miniSEED file that is cut is a shorter one to obspy.
    for size in np.random.default_rng(1).integers(1, len(content), 12).tolist():
        with pytest.raises(ValueError, match=r"a\.sac"):
            jr.read_record(write(content[:size], "a.sac"), unit="cm/s2")


REFUSED = {
    "give unit": ([make_trace()], {"unit": None}),
    "column must be given.*'HNE', 'HNN'": ([make_trace(), make_trace("HNN")], {}),
    "counts of an instrument": ([make_trace(data=np.arange(9, dtype=np.int32))], {}),
    "in pieces": ([make_trace(), make_trace(start=9.0)], {}),
    "starts 1 s apart": ([make_trace(), make_trace("HNN", start=1.0)], {}),
}


@pytest.mark.parametrize("reason", REFUSED)
def test_files_that_are_refused(write, reason):
    traces, options = REFUSED[reason]
    path = write(pack("MSEED", *traces), "a")
    with pytest.raises(ValueError, match=reason):
        jr.read_record(path, **({"unit": "gal"} | options))


def trace(data, delta=0.01, **stats):
    """As obspy has it."""
    return SimpleNamespace(data=data, stats=SimpleNamespace(delta=delta, **stats))


def test_traces():
    big_endian = trace(np.array([1.5, -2], ">f4"), starttime=7)
    counts = trace(np.ma.array([3, 4], np.int32), starttime=7)
    record = from_obspy(big_endian, unit="g", vertical=counts)
    np.testing.assert_allclose(record.acceleration, [1.5 * G, -2 * G])
    np.testing.assert_allclose(record.vertical, [3 * G, 4 * G])
    by_gmprocess = trace(np.array([3, 4]), standard={"units": "cm/s^2"})
    np.testing.assert_allclose(from_obspy(by_gmprocess, unit="gal").acceleration, [0.03, 0.04])
    for calibrated, factor in ((False, 2.4e-6), (True, 1.0)):
        counts = trace(np.array([35.31, -20]), calib=2.4e-6)
        record = from_obspy(counts, unit="m/s2", calibrated=calibrated)
        np.testing.assert_allclose(record.acceleration, factor * counts.data)
    later = trace(np.ones(2), starttime=8)
    for wrong, part in (
        ([trace(np.ones(2))], "must be one trace"),
        (trace(np.ones(2), standard={"units": "g"}), "states 'g'"),
        (trace(np.ones(2), calib=2.0), "calibrated must be given"),
        (trace(np.ma.array([1.0, 2, 3], mask=[0, 1, 0])), "without gaps"),
        (trace(np.ones(2), starttime=7), "vertical starts at 8, but trace at 7"),
    ):
        with pytest.raises(ValueError, match=part):
            from_obspy(wrong, unit="gal", vertical=later if "vertical" in part else None)


def test_without_obspy(write, monkeypatch):
    path = write(pack("MSEED", make_trace()), "a.mseed")
    monkeypatch.setitem(sys.modules, "obspy", None)
    with pytest.raises(ModuleNotFoundError, match=r"jaxrock\[records\]"):
        jr.read_record(path, unit="gal")
