"""Files of networks are read right, and damaged ones are refused in one sentence."""

import re

import numpy as np
import pytest
from networks import FIRST, NETWORKS, POINTS, SECOND, UPWARD, make_at2, make_esm, make_knet

import jaxrock as jr

pytestmark = pytest.mark.float64


def write(folder, name, content):
    path = folder / name
    path.write_text(content, encoding="utf-8")
    return path


@pytest.mark.parametrize("network", NETWORKS)
def test_components(tmp_path, network):
    sample = NETWORKS[network]
    path = write(tmp_path, sample.name, sample.content)
    several = len(sample.components) > 1
    for channel, right in sample.components.items():
        record = jr.read_record(path, column=channel if several else None)
        np.testing.assert_allclose(record.acceleration, right, rtol=1e-14)
        assert float(record.time_step) == sample.step
    suite = jr.read_suite(tmp_path, vertical=several)
    level = [channel for channel in sample.components if channel != sample.vertical]
    assert [name.split(" ")[-1] for name in suite.names] == (
        level if several else [*suite.names]
    )
    for record in suite:
        if several:
            np.testing.assert_allclose(record.vertical, sample.components[sample.vertical])
    if several:
        with pytest.raises(ValueError, match=f"column must be given.*{level[0]}.*{level[1]}"):
            jr.read_record(path)


DAMAGES = [(name, *damage) for name, sample in NETWORKS.items() for damage in sample.damages]


@pytest.mark.parametrize(("network", "old", "new", "part"), DAMAGES)
def test_damages(tmp_path, network, old, new, part):
    sample = NETWORKS[network]
    assert old in sample.content
    path = write(tmp_path, sample.name, sample.content.replace(old, new, 1))
    column = next(iter(sample.components)) or None
    with pytest.raises(
        ValueError, match=rf"^'.*{re.escape(sample.name)}'.*: .*{part}"
    ) as error:
        jr.read_record(path, column=column)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("network", NETWORKS)
def test_the_caller_must_agree(tmp_path, network):
    sample = NETWORKS[network]
    path = write(tmp_path, sample.name, sample.content)
    column = next(iter(sample.components)) or None
    with pytest.raises(ValueError, match="unit is 'in/s2', but the file states"):
        jr.read_record(path, column=column, unit="in/s2")
    with pytest.raises(ValueError, match=r"time_step is 0.01 s, but the file states 0.005 s"):
        jr.read_record(path, column=column, time_step=0.01)


@pytest.mark.parametrize(
    ("old", "new", "step"),
    [
        ("NPTS=  43, DT=   .0050 SEC", "DT= .0050 NPTS= 43", 0.005),
        ("NPTS=  43, DT=   .0050 SEC", "    43    .0050   NPTS, DT", 0.005),
        ("NPTS=  43, DT=   .0050 SEC", "NPTS= 43, DT= 5 MSEC", 0.005),
    ],
)
def test_older_headers_of_at2(tmp_path, old, new, step):
    path = write(tmp_path, "a.AT2", make_at2().replace(old, new))
    record = jr.read_record(path)
    assert (record.samples, float(record.time_step)) == (POINTS, pytest.approx(step))


def test_at2_that_states_no_unit(tmp_path):
    path = write(tmp_path, "a.AT2", make_at2().replace(" IN UNITS OF G", ""))
    with pytest.raises(ValueError, match=r"no unit is stated: give unit"):
        jr.read_record(path)
    np.testing.assert_allclose(
        jr.read_record(path, unit="cm/s2").acceleration * 981, FIRST / 100, rtol=1e-6
    )


@pytest.mark.parametrize(
    ("name", "title", "direction"),
    [
        ("RSN1_X_Y-UP", "a, b, UP (USGS STATION 942)", "up"),
        ("RSN1_X_YDWN", "a, b", "down"),
        ("RSN1_X_IU.CCM.BHZ.00", "a", "up"),
        ("ABBAR--V", "a", "up"),
        ("BACKUP", "a, b, 140", ""),
        ("BACKUP", "a", "up"),
        ("rsn1_a-up", "a", "up"),
        ("backup", "a, b, S26W", ""),
        ("x_khz", "a", ""),
        ("x090", "a, b, DWN", "down"),
    ],
)
def test_directions_of_at2(tmp_path, name, title, direction):
    write(tmp_path, "other.AT2", make_at2())
    write(tmp_path, f"{name}.AT2", make_at2(UPWARD, title))
    suite = jr.read_suite(tmp_path)
    assert (len(suite) == 1) == bool(direction)
    assert (f"{name}.AT2" in suite.source) == bool(direction)


# As the NGA databases and networks name the vertical components, and others beside them.
VERTICAL = """RSN57_SFERN_ORRDWN RSN1244_CHICHI_CHY101-V NIGH11UD RSN4228_NIIGATA_NIGH11UD
RSN8123_CCHURCH_RHSCUP CI.CLC.HNZ RSN8000_X_NZ.REHS.BHZ.00"""
HORIZONTAL = """RSN57_SFERN_ORR021 RSN1244_CHICHI_CHY101-E NIGH11EW RSN4228_NIIGATA_NIGH11NS
RSN8123_CCHURCH_RHSCN86W CI.CLC.HNE RSN8000_X_NZ.REHS.BHN.00 cloud setup record_v2"""


def test_stations_by_the_names_of_their_files(tmp_path):
    for k, name in enumerate(VERTICAL.split()):
        write(tmp_path, f"{name}.AT2", make_at2((k + 1) * UPWARD, "a"))
    for name in HORIZONTAL.split():
        write(tmp_path, f"{name}.AT2", make_at2())
    assert set(jr.read_suite(tmp_path).names) == set(HORIZONTAL.split())
    for k, (level, upward) in enumerate(
        zip(HORIZONTAL.split(), VERTICAL.split(), strict=False)
    ):
        if "DWN" not in upward:
            files = [tmp_path / f"{name}.AT2" for name in (level, *VERTICAL.split())]
            (record,) = jr.read_suite(files, vertical=True)
            np.testing.assert_allclose(
                record.vertical * 981 / 9.80665, (k + 1) * UPWARD, rtol=1e-6
            )


def test_a_folder_of_peer(tmp_path):
    for name, values in {"CLS000": FIRST, "CLS090": SECOND, "CLS-UP": UPWARD}.items():
        write(tmp_path, f"RSN753_LOMAP_{name}.AT2", make_at2(values, "a"))
    for name in ("RSN753_LOMAP_CLS000.VT2", "._RSN753_LOMAP_CLS000.AT2", "_readME.txt"):
        write(tmp_path, name, "no record\n")
    write(tmp_path, "_SearchResults.csv", " PEER Ground Motion Database\nMagnitude Min:,6.5\n")
    suite = jr.read_suite(tmp_path, vertical=True)
    assert suite.names == ("RSN753_LOMAP_CLS000", "RSN753_LOMAP_CLS090")
    assert "2 records of the folder" in suite.source
    assert "_SearchResults.csv" in suite.source
    for record in suite:
        np.testing.assert_allclose(record.vertical * 981 / 9.80665, UPWARD, rtol=1e-6)
    write(tmp_path, "RSN754_LOMAP_AND000.AT2", make_at2())
    with pytest.raises(
        ValueError, match=r"AND000.AT2': one vertical component was expected, got 0"
    ):
        jr.read_suite(tmp_path, vertical=True)
    write(tmp_path, "RSN754_LOMAP_ANDDWN.AT2", make_at2(title="a"))
    with pytest.raises(ValueError, match="points down"):
        jr.read_suite(tmp_path, vertical=True)


def test_vertical_components_in_other_files(tmp_path):
    name = NETWORKS["ESM"].name
    write(tmp_path, name, make_esm())
    upward = write(tmp_path, name.replace("HNE", "HNZ"), make_esm(UPWARD, "HNZ"))
    write(tmp_path, name.replace("ACC", "VEL"), make_esm().replace("TYPE: ACC", "TYPE: VEL"))
    write(tmp_path, "HKD.EW2", make_knet(direction="5"))
    write(tmp_path, "HKD.UD2", make_knet(direction="6"))
    write(tmp_path, "HKD.EW1", make_knet(direction="2"))
    write(tmp_path, "HKD.UD1", make_knet(direction="3"))
    suite = jr.read_suite(tmp_path, vertical=True)
    assert suite.names == ("HKD.EW2", name.removesuffix(".ASC"))
    for left_out in ("HKD.EW1", "HKD.UD1", name.replace("ACC", "VEL")):
        assert left_out in suite.source
    np.testing.assert_allclose(suite[1].vertical, UPWARD / 100)
    record = jr.read_record(tmp_path / name, vertical=upward)
    np.testing.assert_allclose(record.vertical, UPWARD / 100)
    with pytest.raises(ValueError, match="column must be given; its components are 'HNZ'"):
        jr.read_record(upward)
    np.testing.assert_allclose(jr.read_record(upward, column="up").acceleration, UPWARD / 100)


@pytest.mark.parametrize("cut", [1, 2, 9])
@pytest.mark.parametrize("network", NETWORKS)
def test_a_file_that_is_cut(tmp_path, network, cut):
    sample = NETWORKS[network]
    # Behind the last number nothing is lost.
    content = re.sub(r"\n[^\n]*End.*", "", sample.content.rstrip())
    path = write(tmp_path, sample.name, content[:-cut])
    with pytest.raises(ValueError, match=re.escape(sample.name)):
        jr.read_record(path, column=next(iter(sample.components)) or None)


def test_other_files(tmp_path):
    plain = write(tmp_path, "npts_dt.txt", "Valley station NS\n400 0.0100\n0.000272\n")
    for part in ("delete the lines", "np.loadtxt", "jr.Record", "from_obspy"):
        with pytest.raises(ValueError, match=part):
            jr.read_record(plain, unit="m/s2", time_step=0.01)
    film = NETWORKS["CSMIP volume 1"].content.replace(
        " Accelerogram points at 200 pts/sec", ""
    )
    with pytest.raises(ValueError, match="was expected"):
        jr.read_record(write(tmp_path, "film.v1", film))
    for path in (tmp_path, tmp_path / "nothing.AT2"):
        with pytest.raises(ValueError, match=r"folder|cannot be read"):
            jr.read_record(path)


@pytest.mark.parametrize(
    ("network", "old", "new"),
    [
        ("AT2", "DT=   .0050 SEC", "DT=   .0050 SE4"),
        ("AT2", "DT=   .0050 SEC", "DT=   . SEC"),
        ("ESM", "0.005000", "nan"),
        ("ESM", "PGA_CM/S^2: ", "PGA_CM/S^2: absent"),
        ("CSMIP volume 1", "at 200 pts/sec", "at 0 pts/sec"),
        ("CSMIP volume 2", "at  .005 sec", "at  . sec"),
        ("SMC", "2.0000000E+02", "0.0000000E+00"),
    ],
)
def test_numbers_of_headers(tmp_path, network, old, new):
    sample = NETWORKS[network]
    path = write(tmp_path, sample.name, sample.content.replace(old, new, 1))
    assert old in sample.content
    with pytest.raises(ValueError, match=re.escape(sample.name)):
        jr.read_record(path, column=next(iter(sample.components)) or None)


def test_an_at2_file_with_a_header_of_three_lines(tmp_path):
    content = make_at2().replace("PEER NGA STRONG MOTION DATABASE RECORD\n", "")
    path = write(tmp_path, "a.AT2", content)
    with pytest.raises(ValueError, match="unit is 'gal', but the file states 'G'"):
        jr.read_record(path, unit="gal")
    assert jr.read_record(path).samples == POINTS
