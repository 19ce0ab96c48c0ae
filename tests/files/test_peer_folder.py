"""Folders as PEER's database and networks hand them out, and the components in them."""

import os

import numpy as np
import pytest

import jaxrock as jr
from jaxrock.ground_motion.files import formats
from jaxrock.ground_motion.files.components import Component

G = 9.80665
# Names of a horizontal component and of the vertical one beside it, after those in the flat
# files of PEER's databases and of networks. Stations end in what looks like a component.
PAIRS = """
PEL090 PEL-UP|C12050 C12DWN|H-CHI012 H-CHIDWN|SOD015 SODDWN|L09021 L09DWN|HEC000 HECVER
BKSAOHLN BKSAOHLZ|CLW-LN CLW-UP|PAR--L PAR-UP|VFS-90 VFS-UP|A-RO3000 A-RO3-UP|SCS052 SCSUP
H-PTS225 H-PTS-UP|A-E01140 A-E01-UP|B-BRA315 B-BRA-UP|I-ELC180 I-ELC-UP|PTS360 PTSVRT
TULV180 TULVUP|SETUP000 SETUP-UP|TROUP270 TROUPDWN|KUZ090 KUZVER|CLOUD-NS CLOUD-UD
DENVER045 DENVERVER|DIVER-E DIVER-V|CULVERT-L CULVERT-V|LETDOWN-T LETDOWN-Z|BLITZ-N BLITZ-DN
GROUP-H1 GROUP-V1|CUP-H2 CUP-VERT|site.HNE site.HNZ|CI.CLC.HN1 CI.CLC.HNZ
NZ.WTMC.HNN.20 NZ.WTMC.HNZ.20|NIGH11NS NIGH11UD|IBRH12EW2 IBRH12UD2|IBRH13NS1 IBRH13UD1
AOMH05-EW AOMH05-UD|obs_N obs_UP|obs2_e obs2_down|mesa.L mesa.ver|lab 90 lab vertical
N-S U-D|TARZ360 TARZ-UP|DUV000 DUVV
RSN1_HELENA.A_A-HMC180 RSN1_HELENA.A_A-HMCDWN
RSN12_KERN.PEL_PEL090 RSN12_KERN.PEL_PEL-UP|RSN28_PARKF_C12050 RSN28_PARKF_C12DWN
RSN57_SFERN_ORR021 RSN57_SFERN_ORRDWN|RSN68_SFERN_PEL180 RSN68_SFERN_PEL-UP
RSN97_PTMUGU_PHN180 RSN97_PTMUGU_PHNDWN|RSN100_NCALIF.AG_D-CPM030 RSN100_NCALIF.AG_D-CPMDWN
RSN125_FRIULI.A_A-TMZ000 RSN125_FRIULI.A_A-TMZ-UP|RSN126_GAZLI_GAZ090 RSN126_GAZLI_GAZ-UP
RSN139_TABAS_DAY-L1 RSN139_TABAS_DAY-UP|RSN143_TABAS_TAB-T1 RSN143_TABAS_TAB-UP
RSN160_IMPVALL.H_H-BCR140 RSN160_IMPVALL.H_H-BCRDWN
RSN169_IMPVALL.H_H-DLT352 RSN169_IMPVALL.H_H-DLT-Z
RSN292_ITALY_A-STU270 RSN292_ITALY_A-STUVRT|RSN495_NAHANNI_S1280 RSN495_NAHANNI_S1-UP
RSN587_NEWZEAL_A-MAT083 RSN587_NEWZEAL_A-MATDN|RSN732_LOMAP_A02043 RSN732_LOMAP_A02-UP
RSN753_LOMAP_CLS000 RSN753_LOMAP_CLS-UP|RSN825_CAPEMEND_CPM000 RSN825_CAPEMEND_CPM-UP
RSN848_LANDERS_CLW-LN RSN848_LANDERS_CLW-UP|RSN864_LANDERS_JOS090 RSN864_LANDERS_JOS-UP
RSN960_NORTHR_LOS270 RSN960_NORTHR_LOS-UP|RSN1063_NORTHR_RRS228 RSN1063_NORTHR_RRS-UP
RSN1111_KOBE_NIS000 RSN1111_KOBE_NISVERT|RSN1116_KOBE_SHI090 RSN1116_KOBE_SHI-UP
RSN1148_KOCAELI_ARE000 RSN1148_KOCAELI_AREDWN|RSN1158_KOCAELI_DZC270 RSN1158_KOCAELI_DZC-UP
RSN1165_KOCAELI_IZT180 RSN1165_KOCAELI_IZT-UP|RSN1244_CHICHI_CHY101-E RSN1244_CHICHI_CHY101-V
RSN1485_CHICHI_TCU045-N RSN1485_CHICHI_TCU045-V|RSN1503_CHICHI_TCU065-E RSN1503_CHICHI_TCU065-Z
RSN1602_DUZCE_BOL090 RSN1602_DUZCE_BOLVER|RSN1605_DUZCE_DZC270 RSN1605_DUZCE_DZC-VER
RSN1614_DUZCE_1061-N RSN1614_DUZCE_1061-V|RSN1633_MANJIL_ABBAR--T RSN1633_MANJIL_ABBAR--V
RSN1787_HECTOR_HEC000 RSN1787_HECTOR_HECVER|RSN2114_DENALI_PS10-047 RSN2114_DENALI_PS10-UP
RSN3548_LOMAP_LEX000 RSN3548_LOMAP_LEXUP|RSN4040_BAM_BAM-L RSN4040_BAM_BAM-V
RSN4228_NIIGATA_NIGH11EW RSN4228_NIIGATA_NIGH11UD|RSN4875_CHUETSU_65057EW RSN4875_CHUETSU_65057UD
RSN5264_CHUETSU_NIG019NS RSN5264_CHUETSU_NIG019UD|RSN5657_IWATE_IWTH25NS1 RSN5657_IWATE_IWTH25UD1
RSN5832_SIERRA.MEX_MDO000 RSN5832_SIERRA.MEX_MDO-UP|RSN6890_DARFIELD_CMHSN10E RSN6890_DARFIELD_CMHSV
RSN6915_DARFIELD_HVSCS26W RSN6915_DARFIELD_HVSCUP|RSN6966_DARFIELD_SHLCS50E RSN6966_DARFIELD_SHLCUP
RSN8000_X_NZ.REHS.BHN.00 RSN8000_X_NZ.REHS.BHZ.00|RSN8119_CCHURCH_PRPCW RSN8119_CCHURCH_PRPCUP
RSN8123_CCHURCH_RHSCN86W RSN8123_CCHURCH_RHSCUP|RSN8161_SIERRA.MEX_E12360 RSN8161_SIERRA.MEX_E12-V
RSN8606_SIERRA.MEX_CIWESHNN RSN8606_SIERRA.MEX_CIWESHNZ|RSN9001_X_TULV-N RSN9001_X_TULV-UP
RSN9002_X_SETUP090 RSN9002_X_SETUPUP|RSN9003_X_KUZ--L RSN9003_X_KUZ--Z
"""
NAMES = [pair.split(" ") for pair in PAIRS.strip().replace("\n", "|").split("|")]
# A blank stands in one station's name.
NAMES = [
    [" ".join(words[: len(words) // 2]), " ".join(words[len(words) // 2 :])] for words in NAMES
]
DOWNWARD = ("DWN", "DN", "down")


def make_at2(value, title="EVENT, 1/1/2000, STATION", step=0.01):
    head = f"PEER NGA STRONG MOTION DATABASE RECORD\n{title}\n"
    head += f"ACCELERATION TIME SERIES IN UNITS OF G\nNPTS= 3, DT= {step} SEC\n"
    return f"{head}{value} .2 -.3\n"


@pytest.fixture
def write(tmp_path):
    def to_files(contents):
        for name, content in contents.items():
            (tmp_path / name).write_text(content)
        return tmp_path

    return to_files


def test_components_by_the_names_of_98_stations(write):
    assert len(NAMES) == 98
    contents = {}
    for k, (level, vertical) in enumerate(NAMES):
        contents |= {f"{level}.AT2": make_at2(-1), f"{vertical}.AT2": make_at2(k)}
    folder = write(contents)
    assert set(jr.read_suite(folder).names) == {level for level, _ in NAMES}
    # Which of them points down is said; all others have the vertical of their station.
    known = {level: k for k, (level, up) in enumerate(NAMES) if not up.endswith(DOWNWARD)}
    with pytest.raises(ValueError, match="points downward by its name") as caught:
        jr.read_suite(folder, vertical=True)
    assert len(str(caught.value).splitlines()) == 98 - len(known)
    paths = [folder / f"{name}.AT2" for level, up in NAMES for name in (level, up)]
    paths = [path for path in paths if not path.stem.endswith(DOWNWARD)]
    downward = {level for level, _ in NAMES} - known.keys()
    suite = jr.read_suite([path for path in paths if path.stem not in downward], vertical=True)
    found = {
        name: round(float(record.vertical[0]) / G)
        for name, record in zip(suite.names, suite, strict=True)
    }
    assert found == known


SEARCH = """\
 PEER Ground Motion Database, Time Series Search Report -- NGA-West2 -- 2024-05-06


 -- Summary of PEER Ground Motion Database Search Criteria --
Magnitude Min:,6.5

 -- Summary of Metadata of Selected Records --
Result ID, Spectral Ordinate, Record Sequence Number, Horizontal-1 Acc. Filename
1, SRSS,753, RSN753_LOMAP_CLS000.AT2
"""


def test_a_folder_as_downloaded(write):
    station = {"CLS000": "0", "CLS090": "90", "CLS-UP": "UP"}
    contents = {
        f"RSN753_LOMAP_{name}.AT2": make_at2(
            k, f"Loma Prieta, 10/18/1989, Corralitos, {title}"
        )
        for k, (name, title) in enumerate(station.items())
    }
    junk = {
        name: "no record\n"
        for name in (
            "RSN753_LOMAP_CLS000.VT2",
            "RSN753_LOMAP_CLS000.DT2",
            "._RSN753_LOMAP_CLS000.AT2",
            ".hidden.csv",
            "_readME.txt",
            "readme.at2",
            "index.csv",
        )
    }
    folder = write(contents | junk | {"_SearchResults.csv": SEARCH, "again (1).csv": SEARCH})
    os.mkfifo(folder / "pipe.AT2")
    suite = jr.read_suite(folder, vertical=True)
    assert suite.names == ("RSN753_LOMAP_CLS000", "RSN753_LOMAP_CLS090")
    assert [round(float(record.vertical[0]) / G) for record in suite] == [2, 2]
    for read in (jr.read_record, lambda path: jr.read_suite([path])):
        with pytest.raises(ValueError, match=r"_SearchResults.csv': this is PEER's report"):
            read(folder / "_SearchResults.csv")
    # A table that may be a record is not passed over.
    write({"stations.csv": "name,vs30\nCLS,462\n"})
    with pytest.raises(ValueError, match=r"stations.csv': the file states no unit"):
        jr.read_suite(folder)


@pytest.mark.parametrize(
    ("title", "direction"),
    [
        ("IMPERIAL VALLEY 10/15/79 2319, EL CENTRO ARRAY #6, UP (USGS STATION 942)", "up"),
        ("Imperial Valley-06, 10/15/1979, El Centro Array #6, DWN", "down"),
        ("Duzce Turkey, 11/12/1999, Lamont 1061, V", "up"),
        ("Imperial Valley-06, 10/15/1979, El Centro Array #6, 140", "level"),
        ("Darfield New Zealand, 9/3/2010, Heathcote Valley, S26W", "level"),
        ("Manjil Iran, 6/20/1990, Abbar, L", "level"),
        ("1559 points at equal spacing of 0.02 sec, with 5 decimal places", ""),
        ("SETUP", ""),
    ],
)
def test_the_header_tells_the_component(write, title, direction):
    folder = write({"BACKUP.AT2": make_at2(1, title), "other.AT2": make_at2(2)})
    names = jr.read_suite(folder).names
    assert names == (("other",) if direction in ("up", "down") else ("BACKUP", "other"))
    for name, agreeing in (
        ("RSN1_X_Y-UP", ("up", "")),
        ("RSN1_X_YDWN", ("down", "")),
        ("RSN1_X_Y-V", ("up", "down", "")),
        ("RSN1_X_Y090", ("level", "")),
    ):
        if title.endswith(" V") and name == "RSN1_X_YDWN":
            agreeing = ("up",)  # V alone says neither
        (folder / f"{name}.AT2").write_text(make_at2(3, title))
        if direction in agreeing:
            jr.read_suite(folder)
        else:
            with pytest.raises(
                ValueError, match=f"{name}.AT2': the component is .* by its name"
            ):
                jr.read_suite(folder)
        (folder / f"{name}.AT2").unlink()


def test_a_vertical_component_that_may_be_of_two_files(write):
    folder = write({f"A{end}.AT2": make_at2(1) for end in ("090", "-UP", "-VER")})
    with pytest.raises(ValueError, match="several files may be its vertical component"):
        jr.read_suite(folder, vertical=True)


def read_fake(text, claims):
    """Lines such as `HNE level 1`."""
    read_fake.count += 1
    found = []
    for line in text.lines[1:]:
        channel, direction, value = line.split()
        direction = direction.removeprefix("?")
        name = f"{str(text.path)!r}"
        values = float(value) * np.ones(3)
        found.append(Component(name, 1.0, values, 0.01, direction, channel.strip("-")))
    return found


@pytest.fixture
def fake(monkeypatch):
    known = formats.FileFormat(
        "fake", (".fake", ".ns", ".ew", ".ud"), lambda lines: lines[0] == "FAKE", read_fake
    )
    monkeypatch.setattr(formats, "FORMATS", (known,))
    read_fake.count = 0


@pytest.mark.usefixtures("fake")
def test_files_of_other_formats(write):
    three = "FAKE\nHNE level 1\nHNN level 2\nHNZ up 3\n"
    folder = write(
        {
            "three.fake": three,
            "IV.AQK..HNE.D.2009.fake": "FAKE\n- level 4\n",
            "IV.AQK..HNN.D.2009.fake": "FAKE\n- level 5\n",
            "IV.AQK..HNZ.D.2009.fake": "FAKE\n- up 6\n",
            "AOM001.NS": "FAKE\n- ? 7\n",
            "AOM001.EW": "FAKE\n- ? 8\n",
            "AOM001.UD": "FAKE\n- up 9\n",
            "notes.dat": "no record\n",
        }
    )
    suite = jr.read_suite(folder, vertical=True)
    assert read_fake.count == 7
    found = {
        name: (float(record.acceleration[0]), float(record.vertical[0]))
        for name, record in zip(suite.names, suite, strict=True)
    }
    assert found == {
        "AOM001.EW": (8, 9),
        "AOM001.NS": (7, 9),
        "IV.AQK..HNE.D.2009": (4, 6),
        "IV.AQK..HNN.D.2009": (5, 6),
        "three HNE": (1, 3),
        "three HNN": (2, 3),
    }
    assert jr.read_suite(folder).names == suite.names
    assert jr.read_suite([folder / "three.fake"]).names == ("three HNE", "three HNN")
    for content, message in (
        ("FAKE\nHNE level 1\nHN2 ? 2\n", "does not say where 'HN2' points"),
        ("FAKE\nHNZ up 1\nHN2 down 2\n", "no component is horizontal"),
        ("FAKE\nHNE level 1\nHNN level 2\n", "one vertical component was expected, got 0"),
        ("FAKE\nHNE level 1\nHNZ down 2\n", "points downward"),
        ("words\n", "a file in one of these formats was expected"),
    ):
        (folder / "three.fake").write_text(content)
        with pytest.raises(ValueError, match=rf"three\.fake': .*{message}|{message}"):
            jr.read_suite(folder, vertical=True)


AT2 = "PEER\n{}\nACCELERATION IN UNITS OF G\nNPTS= 3, DT= .5 SEC\n.1 .2 -.3\n"


@pytest.mark.parametrize(
    ("name", "title", "message"),
    [
        ("S-DWN", "E, Site", "S-DWN.AT2' points downward"),
        ("SDN", "E, Site", "SDN.AT2' points downward"),  # beside S090
        ("S180", "E, Site", "S180.AT2': one vertical component was expected, got 0"),
        (
            "S-UP",
            "E, Site, 180",
            "S-UP.AT2': the component is up by its name, but level by its",
        ),
        ("S-UP", "E, Site", None),
        ("S-V", "E, Site, UP", None),
        ("other", "E, Site", None),
    ],
)
def test_one_vertical_file(write, name, title, message):
    folder = write({"S090.AT2": AT2.format("E, Site, 090"), f"{name}.AT2": AT2.format(title)})
    if message:
        with pytest.raises(ValueError, match=message):
            jr.read_record(folder / "S090.AT2", vertical=folder / f"{name}.AT2")
        return
    record = jr.read_record(folder / "S090.AT2", vertical=folder / f"{name}.AT2")
    assert float(record.vertical[0]) == pytest.approx(0.1 * G)


def test_a_vertical_file_is_no_horizontal_one_by_itself(write):
    path = write({"S-UP.AT2": AT2.format("E, Site")}) / "S-UP.AT2"
    with pytest.raises(ValueError, match="no component is horizontal; column names a vert"):
        jr.read_record(path)
    assert jr.read_record(path, column="up").samples == 3


def test_two_files_of_one_name(write):
    folder = write({"S.AT2": AT2.format("E, Site"), "S.csv": "time,a [g]\n0,1\n1,2\n"})
    with pytest.raises(ValueError, match=r"S\.csv': another .* 'S' as well, from '.*S\.AT2'"):
        jr.read_suite(folder)


ELCENTRO = """\
Data for El Centro 1940 North South Component (Peknold Version)
11 points at equal spacing of 0.02 sec Points are listed in the format of 8F10.5
The units are (g)
NPTS=  11, DT= .02000 SEC
   0.00630   0.00364   0.00099   0.00428   0.00758   0.01087   0.00682   0.00277
  -0.00128   0.00368   0.00864
*** End Data ***
"""


def test_a_line_that_ends_the_data(write):
    folder = write({"elCentro.at2": ELCENTRO})
    record = jr.read_record(folder / "elCentro.at2")
    assert record.samples == 11
    assert float(record.acceleration[-1]) == pytest.approx(0.00864 * G)
    lines = ELCENTRO.splitlines(keepends=True)
    for wrong in (
        [*lines, lines[-1]],
        [*lines[:-2], *lines[:-3:-1]],
        [*lines[:-1], "*** Data ***"],
        [*lines[:-2], lines[-1]],
    ):
        write({"elCentro.at2": "".join(wrong)})
        with pytest.raises(ValueError, match=r"elCentro\.at2', line [467]: "):
            jr.read_record(folder / "elCentro.at2")
