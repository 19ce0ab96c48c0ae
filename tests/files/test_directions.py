"""Directions by the names of columns and files."""

from pathlib import Path

import pytest

from jaxrock.ground_motion.files.directions import (
    find_channel_direction,
    find_clear_direction,
    find_name_direction,
    is_same_station,
)


@pytest.mark.parametrize(
    ("direction", "names"),
    [
        ("up", "UD UD1 U-D HNZ HNZ_00 HNZ.10 accZ accv ACCUP accelUD acc_vert"),
        ("down", "DN down accdown acc_dwn"),
        ("level", "EW NS2 E-W HNE_00 HNN.10 N90E"),
        ("", "HN1 HN3 acc ch1 accuracy accelerogram"),
    ],
)
def test_columns(direction, names):
    assert {name: find_clear_direction(name) for name in names.split()} == dict.fromkeys(
        names.split(), direction
    )


@pytest.mark.parametrize(
    ("direction", "names"),
    [
        ("up", "UD2 U-D up Z HNZ"),
        ("down", "DN down"),
        ("level", "NS1 E-W HNE H1 TRAN N28W 090"),
        (None, "V VERT U 3 HN3 OTHR"),
    ],
)
def test_channels(direction, names):
    for name in names.split():
        assert find_channel_direction(name, {"X": "level"}) == direction, name
    assert find_channel_direction("x", {"X": "level"}) == "level"


@pytest.mark.parametrize(
    ("direction", "names"),
    [
        ("up", "HKD100-UD1 AOM004.UD"),
        ("vertical", "STA_HNZ STA.HNZ.00 STA.00.HNZ CI.CLC.HNZ.--"),
        ("level", "CI.CLC.HN1 CI.CLC.HNE.-- CI.CLC.--.HNN STA.HN2.10"),
        ("", "CI.CLC.HN3 SETUP STA--"),
    ],
)
def test_files(direction, names):
    paths = [Path(f"{name}.txt") for name in names.split()]
    assert {path: find_name_direction(path, paths) for path in paths} == dict.fromkeys(
        paths, direction
    )


@pytest.mark.parametrize(
    ("level", "vertical", "same"),
    [
        ("A.EW1", "A.UD1", True),
        ("A.NS2", "A.UD1", False),
        ("STA_00_HNE.csv", "STA_00_HNZ.csv", True),
        ("STA_00_HNE.csv", "STA_10_HNZ.csv", False),
        ("CI.CLC.HNN.--.csv", "CI.CLC.HNZ.--.csv", True),
        ("STA1_HNE.csv", "STA2_HNZ.csv", False),
    ],
)
def test_stations(level, vertical, same):
    assert is_same_station(Path(level), Path(vertical)) == same
