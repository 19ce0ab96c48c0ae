"""miniSEED, SAC and K-NET: written by obspy, or here in their layout."""

import io
import struct
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from tools.command import run

import jaxrock as jr
from jaxrock.cli.motion_options import RecordOptions
from jaxrock.ground_motion.files.claims import make_claims
from jaxrock.ground_motion.files.obspy_files import read_traces

with warnings.catch_warnings():
    # As the library does: one of obspy's imports is deprecated in Python 3.11.
    warnings.simplefilter("ignore")
    obspy = pytest.importorskip("obspy")

pytestmark = pytest.mark.float64

RANDOM = np.random.default_rng(7)
# Samples in cm/s2, which float32 holds exactly: no rounding stands between file and record.
GALS = {
    channel: RANDOM.normal(0, 100, 400).round().astype(np.float32) + np.float32(0.25)
    for channel in ("HNE", "HNN", "HNZ")
}
COUNTS = -4000 + RANDOM.integers(-30000, 30000, 200)
KNET_FACTOR = 2000 / 8388608 * 0.01


def make_trace(channel="HNE", data=None, start=0.0, step=0.005, **more):
    header = {"network": "XX", "station": "ABC", "channel": channel, "delta": step}
    header["starttime"] = obspy.UTCDateTime(2020, 1, 1) + start
    return obspy.Trace(GALS[channel] if data is None else data, header | more)


def pack(kind, *traces, **more):
    buffer = io.BytesIO()
    options = {"reclen": 512} if kind == "MSEED" else {}
    obspy.Stream(list(traces)).write(buffer, kind, **options, **more)
    return buffer.getvalue()


def pack_sac(data=None, step=0.005, **header):
    trace = make_trace(data=data, step=step, **header.pop("stats", {}))
    trace.stats.sac = header
    return pack("SAC", trace)


def pack_records(blockettes, order=">", samples=100):
    """Records of miniSEED with these blockettes in their order, and perhaps wrong `samples`."""
    size = {100: 12, 500: 200, 1000: 8, 1001: 8}
    begin = 48 + sum(size[kind] for kind in blockettes)
    content = b""
    for number, rows in enumerate(GALS["HNE"].reshape(-1, 100)):
        start = (number // 2, 0, 5000 * (number % 2))
        record = struct.pack("8s5s2s3s2s", b"%06dD " % number, b"ABC  ", b"  ", b"HNE", b"XX")
        record += struct.pack(order + "HHBBBBH", 2020, 1, 0, 0, *start)
        record += struct.pack(order + "HhhBBBBi", samples, 200, 1, 0, 0, 0, len(blockettes), 0)
        record += struct.pack(order + "HH", begin, 48 if blockettes else 0)
        for place, kind in enumerate(blockettes, 1):
            following = len(record) + size[kind] if place < len(blockettes) else 0
            fields = {
                1000: bytes([4, order == ">", 10, 0]),
                100: struct.pack(order + "f", 200),
            }
            blockette = struct.pack(order + "HH", kind, following) + fields.get(kind, b"")
            record += blockette.ljust(size[kind], b"\0")
        content += (record + rows.astype(order + "f4").tobytes()).ljust(1024, b"\0")
    return content


def knet(direction="E-W", **changes):
    """A file of K-NET: 17 lines with names in 18 columns, then 8 numbers in each."""
    gals = COUNTS * KNET_FACTOR * 100
    header = {
        "Origin Time": "2003/09/26 04:50:00",
        "Lat.": "41.780",
        "Long.": "144.079",
        "Depth. (km)": "42",
        "Mag.": "8.0",
        "Station Code": "HKD100",
        "Station Lat.": "42.1321",
        "Station Long.": "143.1331",
        "Station Height(m)": "14",
        "Record Time": "2003/09/26 04:50:40",
        "Sampling Freq(Hz)": "100Hz",
        "Duration Time(s)": "2",
        "Dir.": direction,
        "Scale Factor": "2000(gal)/8388608",
        "Max. Acc. (gal)": f"{np.abs(gals - gals.mean()).max():.3f}",
        "Last Correction": "2003/09/26 04:00:00",
        "Memo.": "",
    }
    lines = [f"{name:18}{value}" for name, value in (header | changes).items()]
    lines += ["".join(f"{x:8d} " for x in row) for row in COUNTS.reshape(-1, 8)]
    return ("\n".join(lines) + "\n").encode()


def read(path, content, **options):
    path.write_bytes(content)
    return jr.read_record(path, **options)


@pytest.mark.parametrize("name", ["a.mseed", "station.001"])
def test_miniseed(tmp_path, name):
    content = pack("MSEED", *(make_trace(channel) for channel in GALS))
    record = read(
        tmp_path / name, content, unit="cm/s2", column="HNN", vertical="HNZ", time_step=0.005
    )
    assert record.time_step == 0.005
    np.testing.assert_allclose(
        record.acceleration, 0.01 * GALS["HNN"].astype(float), rtol=1e-14
    )
    np.testing.assert_allclose(record.vertical, 0.01 * GALS["HNZ"].astype(float), rtol=1e-14)
    alone = read(tmp_path / name, pack("MSEED", make_trace()), unit="gal")
    np.testing.assert_allclose(
        alone.acceleration, 0.01 * GALS["HNE"].astype(float), rtol=1e-14
    )


@pytest.mark.parametrize("order", [">", "<"])
@pytest.mark.parametrize(
    "blockettes", [[1000], [1000, 1001], [1001, 1000], [100, 1001, 1000], [500, 100, 1000]]
)
def test_blockettes_in_any_order(blockettes, order):
    """Blockette 1001 comes first in the files of SCEDC and NCEDC."""
    content = pack_records(blockettes, order)
    # Its name is of no file: the content is not read again.
    (component,) = read_traces(Path("a.mseed"), content, make_claims("gal", None))
    (trace,) = obspy.read(io.BytesIO(content))
    np.testing.assert_array_equal(component.values, trace.data)
    np.testing.assert_array_equal(component.values, GALS["HNE"])
    assert (component.factor, component.step) == (0.01, trace.stats.delta)


def test_sac(tmp_path):
    # obspy makes 0.003906 s of this step, and says so.
    path = tmp_path / "a.SAC"
    record = read(path, pack_sac(step=1 / 256), unit="mm/s2")
    assert record.time_step == 1 / 256
    np.testing.assert_allclose(
        record.acceleration, 0.001 * GALS["HNE"].astype(float), rtol=1e-14
    )
    record = read(tmp_path / "HNE", pack_sac(idep=8, cmpinc=90), unit="mm/s2")
    assert record.time_step == 0.005
    assert record.samples == 400


@pytest.mark.parametrize(
    ("channel", "angle", "message"),
    [
        ("HNZ", 0.0, None),
        ("HNZ", -12345.0, None),
        ("V", 0.0, None),
        ("HNZ", 180.0, "a.sac' HNZ points downward"),
        ("V", 180.0, "a.sac' V points downward"),
        ("V", 90.0, "a.sac': one vertical component was expected, got 0"),
        ("HNZ", 90.0, "a.sac': CMPINC is 90, but KCMPNM is 'HNZ': CMPINC must be 0 for up"),
        ("HNZ", 45.0, "a.sac': CMPINC is 45, .*: CMPINC must be 0 for upward"),
        ("HNE", 0.0, "a.sac': CMPINC is 0, but KCMPNM is 'HNE'"),
        ("V", -90.0, "a.sac': CMPINC is -90, .*: CMPINC must be 0 for upward"),
    ],
)
def test_directions_of_sac(tmp_path, channel, angle, message):
    path = tmp_path / "a.sac"
    data = GALS["HNE"]
    path.write_bytes(pack_sac(data, cmpinc=angle, stats={"channel": channel}))
    options = {"unit": "gal", "vertical": path}
    if message:
        with pytest.raises(ValueError, match=message):
            read(tmp_path / "b.sac", pack_sac(), **options)
        return
    record = read(tmp_path / "b.sac", pack_sac(), **options)
    np.testing.assert_allclose(record.vertical, record.acceleration, rtol=1e-14)


def test_knet_that_is_cut_in_its_last_number(tmp_path):
    content = knet().rstrip()
    digits = len(str(abs(COUNTS[-1])))
    assert read(tmp_path / "a.ew", content).samples == COUNTS.size
    for cut in range(1, digits):
        seems = rf"a\.ew', line 42: .* truncated: its last number '{str(COUNTS[-1])[:-cut]}'"
        with pytest.raises(ValueError, match=seems):
            read(tmp_path / "a.ew", content[:-cut])


@pytest.mark.parametrize(("direction", "axis"), [("E-W", "EW"), ("U-D", "UD"), ("6", "UD2")])
def test_knet(tmp_path, direction, axis):
    # A record needs a horizontal component: a vertical one goes with the other direction.
    path = tmp_path / f"HKD100.{axis}"
    path.write_bytes(knet(direction))
    right = COUNTS * KNET_FACTOR
    if direction == "E-W":
        record = jr.read_record(path, unit="gal", time_step=0.01, column=axis)
        np.testing.assert_allclose(record.acceleration, right, rtol=1e-14)
        assert record.time_step == 0.01
        return
    with pytest.raises(
        ValueError, match=f"no component is horizontal; column names a vertical one: '{axis}'"
    ):
        jr.read_record(path)
    record = read(tmp_path / "HKD100.EW", knet("N-S"), vertical=path)
    np.testing.assert_allclose(record.vertical, right, rtol=1e-14)


INTEGERS = np.arange(400, dtype=np.int32)


def change(content, at, new):
    return content[:at] + new + content[at + len(new) :]


REFUSED = {
    "unit must be given": ("a.mseed", pack("MSEED", make_trace()), {}),
    "column must be given": (
        "a.mseed",
        pack("MSEED", *(make_trace(channel) for channel in GALS)),
        {"unit": "gal"},
    ),
    "time_step is 0.01 s, but the file states 0.005 s": (
        "a.mseed",
        pack("MSEED", make_trace()),
        {"unit": "gal", "time_step": 0.01},
    ),
    "counts of an instrument: remove the response": (
        "a.mseed",
        pack("MSEED", make_trace(data=INTEGERS)),
        {"unit": "gal"},
    ),
    "whole numbers, as counts": (
        "a.mseed",
        pack("MSEED", make_trace(data=INTEGERS.astype(float))),
        {"unit": "gal"},
    ),
    "XX.ABC..HNE is in 2 pieces, with gaps": (
        "a.mseed",
        pack("MSEED", make_trace(), make_trace(start=2.1)),
        {"unit": "gal"},
    ),
    "XX.ABC..HNN starts 0.0025 s apart": (
        "a.mseed",
        pack("MSEED", make_trace(), make_trace("HNN", start=0.0025)),
        {"unit": "gal", "column": "HNE"},
    ),
    "miniSEED of version 3": ("a.bin", b"MS\x03" + bytes(600), {"unit": "gal"}),
    "a record of miniSEED was expected": ("a.mseed", b"time,acc\n" * 100, {"unit": "gal"}),
    "a record of miniSEED was expected at byte 2048": (
        "a.mseed",
        pack("MSEED", make_trace()) + b"?" * 512,
        {"unit": "gal"},
    ),
    "record at byte 0 has no blockette 1000": (
        "a.mseed",
        pack_records([1001]),
        {"unit": "gal"},
    ),
    "record at byte 1024 has no blockette 1000": (
        "a.mseed",
        # The chain leads back to its beginning.
        change(pack_records([1001, 1000]), 1024 + 50, b"\0\x30"),
        {"unit": "gal"},
    ),
    "record at byte 3072 is cut": (
        "a.mseed",
        pack_records([1001, 1000])[:-1],
        {"unit": "gal"},
    ),
    "its length is 2 to the power of 99": (
        "a.mseed",
        change(pack_records([1001, 1000]), 62, b"c"),
        {"unit": "gal"},
    ),
    "its date is day 999 of 2020": (
        "a.mseed",
        change(pack_records([1000]), 22, (999).to_bytes(2, "big")),
        {"unit": "gal"},
    ),
    r"its station and channel are b'ABC  .*H.xcbEXX'": (
        "a.mseed",
        change(pack_records([1000]), 16, b"\xcb"),
        {"unit": "gal"},
    ),
    "record at byte 1024 is damaged: .*'offset': 66, .*'offset': 64": (
        "a.mseed",
        change(pack_records([1001, 1000]), 1024 + 45, b"\x42"),
        {"unit": "gal"},
    ),
    # obspy would read on behind the end of the file, through other memory.
    "record at byte 0 is damaged: it states 65000 samples from byte 64 of 1024 on": (
        "a.mseed",
        pack_records([1001, 1000], samples=65000),
        {"unit": "gal"},
    ),
    "obspy warns: .*Number of blockettes": (
        "a.mseed",
        change(pack("MSEED", make_trace()), 39, b"\x05"),
        {"unit": "gal"},
    ),
    "IDEP says velocity": ("a.sac", pack_sac(idep=7), {"unit": "gal"}),
    "a factor of 2 is stated": ("a.sac", pack_sac(stats={"calib": 2.0}), {"unit": "gal"}),
    "HNE: all samples are whole": ("a.sac", pack_sac(data=INTEGERS), {"unit": "gal"}),
    "obspy cannot read it as SAC": ("a.sac", pack_sac()[:-4], {"unit": "gal"}),
    "unit is 'g', but the file is in gal": ("a.ew", knet(), {"unit": "g"}),
    "time_step is 0.02 s, but the header states 100 samples": (
        "a.ew",
        knet(),
        {"time_step": 0.02},
    ),
    "line 12: the header states 2 s at 62.5 samples per second, but 200 values": (
        "a.ew",
        knet(**{"Sampling Freq(Hz)": "62.5Hz"}),
        {},
    ),
    "line 15: the header states a peak of 7.177, but that of the values less their mean": (
        "a.ew",
        knet(**{"Scale Factor": "2001(gal)/8388608", "Max. Acc. (gal)": "7.177"}),
        {},
    ),
    "line 13: 'Dir.' with one of N-S, .*, 6 was expected, got 'Dir.  *X'": (
        "a.ew",
        knet("X"),
        {},
    ),
    "line 14: 'Scale Factor' with a factor .* was expected, got 'Scala": (
        "a.ew",
        knet().replace(b"Scale", b"Scala"),
        {},
    ),
    "line 11: .* with a number above 0 was expected, got 'Sampling .* 0Hz'": (
        "a.ew",
        knet(**{"Sampling Freq(Hz)": "0Hz"}),
        {},
    ),
    "the file ends before 'Dir.' with one of N-S": (
        "a.ew",
        b"\n".join(knet().split(b"\n")[:12]),
        {},
    ),
}


@pytest.mark.parametrize("reason", REFUSED)
def test_refused(tmp_path, capfd, reason):
    name, content, options = REFUSED[reason]
    with pytest.raises(ValueError, match=rf"(?s)^'[^']*{name}.*{reason}") as caught:
        read(tmp_path / name, content, **options)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_without_obspy(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "obspy", None)
    brings = r"a.sac': obspy is not installed; pip install 'jaxrock\[records\]' brings it"
    with pytest.raises(ValueError, match=brings):
        read(tmp_path / "a.sac", pack_sac(), unit="gal")
    assert read(tmp_path / "a.ew", knet()).samples == COUNTS.size


def test_knet_as_obspy_reads_it():
    """A file of a station, as it comes from the network."""
    path = Path(obspy.__file__).parent / "io/nied/tests/data/test.knet"
    (trace,) = obspy.read(path)
    with pytest.warns(UserWarning, match="drift"):
        record = jr.read_record(path)
    assert record.time_step == trace.stats.delta
    np.testing.assert_allclose(
        record.acceleration, trace.data * trace.stats.calib, rtol=1e-14, atol=0
    )


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        # The sample that is furthest from the mean.
        (b" 377 ", b" 397 ", "line 15: the header states a peak"),
        (b"2000(gal)", b"2001(gal)", "line 15: the header states a peak"),
        (b"8388608", b"8386608", "line 15: the header states a peak"),
        (b"100Hz", b"200Hz", "states 59 s at 200 samples per second, but 5900 values follow"),
    ],
)
def test_changes_in_a_file_of_k_net(tmp_path, old, new, message):
    content = (Path(obspy.__file__).parent / "io/nied/tests/data/test.knet").read_bytes()
    with pytest.raises(ValueError, match=message):
        read(tmp_path / "a.ew", content.replace(old, new, 1))


def test_boreholes(tmp_path):
    """Of KiK-net's archive the sensors at the surface, and those at depth only where alone."""
    for number, axis in enumerate(("NS1", "EW1", "UD1", "NS2", "EW2", "UD2"), 1):
        (tmp_path / f"A.{axis}").write_bytes(knet(str(number)))
    (tmp_path / "B.NS1").write_bytes(knet("1"))
    for source in (tmp_path, [*tmp_path.iterdir()]):
        said = r"3 files are left out, .* in a borehole .*: 'A\.[^B]*'\. read_record reads one"
        with pytest.warns(UserWarning, match=said) as warned:
            suite = jr.read_suite(source)
        assert len(warned) == 1
        assert sorted(suite.names) == ["A.EW2", "A.NS2", "B.NS1"]
    (tmp_path / "B.NS1").unlink()
    with pytest.warns(UserWarning, match="3 files are left out"):
        assert jr.read_suite(tmp_path, vertical=True).records[0].vertical is not None
    assert jr.read_record(tmp_path / "A.NS1").samples == COUNTS.size
    deep = [tmp_path / name for name in ("A.NS1", "A.UD1")]
    assert jr.read_suite(deep, vertical=True).names == ("A.NS1",)


def test_commands(tmp_path, capsys):
    """They take such a file as they take others."""
    path = tmp_path / "a.mseed"
    path.write_bytes(pack("MSEED", make_trace()))
    block = ("--width", 0.4, "--slenderness", 5)
    code, _, said = run(capsys, "respond", *block, "--record", path)
    assert code == 2
    assert "miniSEED states no unit" in said
    options = dict.fromkeys(("column", "vertical", "time_step"))
    record = RecordOptions(record=str(path), unit="cm/s2", **options).read()
    assert is_same(record, GALS["HNE"], 0.005)


def is_same(record, data, step):
    return (
        record.samples == data.size
        and abs(record.time_step / step - 1) < 1e-3
        and np.allclose(record.acceleration, 0.01 * data.astype(float), rtol=1e-14, atol=0)
    )


@pytest.mark.parametrize("kind", ["MSEED", "SAC"])
def test_cut_files(tmp_path, kind):
    content = pack(kind, make_trace()) if kind == "MSEED" else pack_sac()
    path = tmp_path / "a.bin"
    for size in np.random.default_rng(1).integers(1, len(content), 60).tolist():
        # A miniSEED file that ends after a record of 512 bytes is a shorter one.
        if kind == "SAC" or size % 512:
            with pytest.raises(ValueError, match=r"a\.bin"):
                read(path, content[:size], unit="cm/s2")


@pytest.mark.parametrize(("kind", "header"), [("MSEED", 55), ("SAC", 440)])
def test_mutated_headers(tmp_path, kind, header):
    """A byte in the header, of miniSEED in that of the first record, is another."""
    content = pack(kind, make_trace()) if kind == "MSEED" else pack_sac()
    path = tmp_path / "a.bin"
    random = np.random.default_rng(2)
    counts = {"read": 0, "refused": 0}
    faults = []
    for _ in range(150):
        at = int(random.integers(header))
        mutated = bytearray(content)
        mutated[at] = int(random.integers(256))
        try:
            record = read(path, bytes(mutated), unit="cm/s2")
        except ValueError as error:
            counts["refused"] += 1
            if "a.bin" not in str(error):
                faults.append((at, mutated[at], error))
            continue
        counts["read"] += 1
        if not is_same(record, GALS["HNE"], 0.005):
            faults.append((at, mutated[at], record))
    assert not faults
    assert min(counts.values()) > 10
