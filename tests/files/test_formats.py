"""Files of networks are read right, and damaged ones are refused in one sentence."""

import re

import numpy as np
import pytest
from networks import FIRST, NETWORKS, SECOND, STEP, UPWARD, G, make_at2, make_esm, make_knet

import jaxrock as jr

pytestmark = pytest.mark.float64


def test_other_headers_of_at2(write):
    old = "NPTS=  43, DT=   .0050 SEC"
    for new in ("DT= .0050 NPTS= 43", "    43    .0050   NPTS, DT", "NPTS= 43, DT= 5 MSEC"):
        record = jr.read_record(write(make_at2().replace(old, new), "a.AT2"))
        np.testing.assert_allclose(record.acceleration * 981 / G, FIRST, rtol=1e-6)
        assert float(record.time_step) == pytest.approx(STEP)


@pytest.mark.parametrize("network", NETWORKS)
def test_components(tmp_path, write, network):
    name, content, components, vertical = NETWORKS[network]
    path = write(content, name)
    several = len(components) > 1
    for channel, right in components.items():
        record = jr.read_record(path, column=channel if several else None)
        np.testing.assert_allclose(record.acceleration, right, rtol=1e-14)
        assert float(record.time_step) == STEP
    suite = jr.read_suite(tmp_path, vertical=several)
    level = [channel for channel in components if channel != vertical]
    assert len(suite) == len(level)
    if several:
        assert [name.split(" ")[-1] for name in suite.names] == level
        for record in suite:
            np.testing.assert_allclose(record.vertical, components[vertical])
        with pytest.raises(ValueError, match=f"column must be given.*{level[0]}.*{level[1]}"):
            jr.read_record(path)
    # What the caller states, too, must agree.
    for options, reason in (
        ({"unit": "in/s2"}, "unit is 'in/s2', but the file states"),
        ({"time_step": 0.01}, "time_step is 0.01 s, but the file states 0.005 s"),
    ):
        with pytest.raises(ValueError, match=reason):
            jr.read_record(path, column=level[0] or None, **options)


# A number too few, a quantity, a unit or a step that is another one, a number that is none; cut.
DAMAGES = [
    ("AT2", "NPTS=  43", "NPTS=  44", "44 values"),
    ("AT2", " IN UNITS OF G", "", "no unit is stated: give unit"),
    ("AT2", "ACCELERATION TIME", "VELOCITY TIME", "velocity"),
    ("ESM", f"{FIRST[5]:.6f}", f"{FIRST[5]:.6f}x", "number"),
    ("COSMOS", "43 acceleration pts", "42 acceleration pts", "values in columns"),
    ("COSMOS", "units=cm/sec2", "units=counts", "counts"),
    ("CSMIP volume 1", "at 200 pts/sec", "at 0 pts/sec", "time step"),
    ("GeoNet", "mm/s/s", "mm/s", "mm/s"),
    ("SMC", "|a comment\n", "", ""),
    ("K-NET", "s)  0.215", "s)  0.225", "43 values"),
    *((network, cut, "", "") for network in NETWORKS for cut in (1, 9)),
]


@pytest.mark.parametrize(("network", "old", "new", "part"), DAMAGES)
def test_damages(write, network, old, new, part):
    name, content, components, _ = NETWORKS[network]
    if isinstance(old, int):
        # As many characters less; behind the last number nothing is lost.
        damaged = re.sub(r"\n[^\n]*End[^\n]*$", "", content.rstrip())[:-old]
    else:
        assert old in content
        damaged = content.replace(old, new, 1)
    path = write(damaged, name)
    reason = rf"^'[^']*{re.escape(name)}'.*: .*{part}"
    with pytest.raises(ValueError, match=reason) as error:
        jr.read_record(path, column=next(iter(components)) or None)
    assert "\n" not in str(error.value)


# As the NGA databases and networks name the components, level ones in the order of their
# vertical ones, and others beside them. Titles say more than names.
VERTICAL = """RSN57_SFERN_ORRDWN RSN1244_CHICHI_CHY101-V NIGH11UD RSN4228_NIIGATA_NIGH11UD
RSN8123_CCHURCH_RHSCUP CI.CLC.HNZ RSN8000_X_NZ.REHS.BHZ.00 rsn1_a-up x090 x180 BACKUP"""
LEVEL = """RSN57_SFERN_ORR021 RSN1244_CHICHI_CHY101-E NIGH11EW RSN4228_NIIGATA_NIGH11NS
RSN8123_CCHURCH_RHSCN86W CI.CLC.HNE RSN8000_X_NZ.REHS.BHN.00 rsn1_a-n
cloud setup backup x_khz record_v2 LOOKUP GROUP"""
TITLES = {"x090": "a, b, UP (USGS STATION 942)", "x180": "a, DWN"}
TITLES |= {"LOOKUP": "a, b, 140", "GROUP": "a, b, S26W"}


def test_stations_by_the_names_of_their_files(tmp_path, write):
    upright, level = VERTICAL.split(), LEVEL.split()
    for k, name in enumerate(upright + level, 1):
        write(make_at2(k * UPWARD, TITLES.get(name, "a")), f"{name}.AT2")
    suite = jr.read_suite(tmp_path)
    assert set(suite.names) == set(level)
    assert all(f"{name}.AT2" in suite.source for name in upright)


def test_a_folder_of_peer(tmp_path, write):
    for name, values in {"CLS000": FIRST, "CLS090": SECOND, "CLS-UP": UPWARD}.items():
        write(make_at2(values, "a"), f"RSN753_LOMAP_{name}.AT2")
    for name in ("RSN753_LOMAP_CLS000.VT2", "._RSN753_LOMAP_CLS000.AT2", "_readME.txt"):
        write("no record\n", name)
    write(" PEER Ground Motion Database\nMagnitude Min:,6.5\n", "_SearchResults.csv")
    suite = jr.read_suite(tmp_path)
    assert suite.names == ("RSN753_LOMAP_CLS000", "RSN753_LOMAP_CLS090")
    assert re.match("2 records of the folder .*left out: .*_SearchResults.csv", suite.source)
    with pytest.raises(ValueError, match=r"CLS000.AT2': one vertical component .* got 0"):
        jr.read_suite(tmp_path, vertical=True)
    path, up = (tmp_path / f"RSN753_LOMAP_CLS{part}.AT2" for part in ("000", "-UP"))
    record = jr.read_record(path, vertical=up)
    np.testing.assert_allclose(record.vertical * 981 / G, UPWARD, rtol=1e-6)
    down = write(make_at2(title="a"), "RSN754_LOMAP_ANDDWN.AT2")
    with pytest.raises(ValueError, match="points down"):
        jr.read_record(path, vertical=down)


def test_vertical_components_in_other_files(tmp_path, write):
    name = NETWORKS["ESM"].name
    path = write(make_esm(), name)
    upward = write(make_esm(UPWARD, "HNZ"), name.replace("HNE", "HNZ"))
    write(make_esm().replace("TYPE: ACC", "TYPE: VEL"), name.replace("ACC", "VEL"))
    for suffix, direction in {"EW2": "5", "UD2": "6", "EW1": "2", "UD1": "3"}.items():
        write(make_knet(direction=direction), f"HKD.{suffix}")
    suite = jr.read_suite(tmp_path)
    assert suite.names == ("HKD.EW2", name.removesuffix(".ASC"))
    for left_out in ("HKD.EW1", "HKD.UD1", name.replace("ACC", "VEL")):
        assert left_out in suite.source
    record = jr.read_record(path, vertical=upward)
    np.testing.assert_allclose(record.vertical, UPWARD / 100)
    with pytest.raises(ValueError, match="column must be given; its components are 'HNZ'"):
        jr.read_record(upward)
    np.testing.assert_allclose(jr.read_record(upward, column="up").acceleration, UPWARD / 100)
    # An SMC file states degrees from upward.
    smc = NETWORKS["SMC"].content
    up = write(smc.replace(f"{90:10}", f"{0:10}", 1), "up.smc")
    np.testing.assert_allclose(jr.read_record(path, vertical=up).vertical, FIRST / 100)
    down = write(smc.replace(f"{90:10}", f"{180:10}", 1), "down.smc")
    with pytest.raises(ValueError, match="points down"):
        jr.read_record(path, vertical=down)


def test_what_is_no_record(tmp_path, write):
    plain = write("Valley station NS\n400 0.0100\n0.000272\n", "npts_dt.txt")
    (tmp_path / "empty").mkdir()
    for read, name, part in (
        (jr.read_record, plain, r"delete the lines.*jr.Record.*np.loadtxt.*from_obspy"),
        (jr.read_record, "", "folder"),
        (jr.read_suite, "nothing", "No such file"),
        (jr.read_suite, "empty", "no file of a record"),
    ):
        with pytest.raises((OSError, ValueError), match=part):
            read(tmp_path / name)
