"""Hazard curves from files: what heads and arguments state, two programs, and what is refused."""

import numpy as np
import pytest
from tools.refused_files import check_refusal

import jaxrock as jr

pytestmark = pytest.mark.float64
G = 9.80665
PGA = {"measure": "pga"}
PGV = {"measure": "pgv"}
# 10 % in 50 years is the probability of a return period of 474.6 years.
TEN = -np.log(0.9) / 50


def write(folder, content, name="hazard.csv"):
    (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    return folder / name


HEADS = [
    ("pga [g],rate [1/yr]", {}, G, "pga"),
    ("# PGV, or what else a comment says\nag (cm/s2),Rate (1/year)", {}, 0.01, "pga"),
    ("PGA of the site\n\nvg [in/s],rate [1/a]", {}, 0.0254, "pgv"),
    ("pgv,rate [1/yr]", {"unit": "cm/s"}, 0.01, "pgv"),
    ("pgv [cm/s],rate [1/yr]", {"unit": "cm s-1"} | PGV, 0.01, "pgv"),
    ("level [gal],rate [1/yr]", PGA, 0.01, "pga"),
    ("level,rate [1/yr]", {"unit": "g"} | PGA, G, "pga"),
]


@pytest.mark.parametrize(("head", "options", "factor", "measure"), HEADS)
def test_heads(tmp_path, head, options, factor, measure):
    """What they and the arguments state of the measure and the unit."""
    path = write(tmp_path, f"{head}\n0.05,1e-2\n2,1e-4\n")
    hazard = jr.read_hazard(path, statistic="mean", **options)
    np.testing.assert_allclose(hazard.levels, [0.05 * factor, 2 * factor], rtol=1e-12)
    np.testing.assert_array_equal(hazard.rates, [1e-2, 1e-4])
    assert (hazard.measure, hazard.statistic) == (measure, "mean")


CODE = "TR [anni];ag [g];TC* [s]\n30;0,048;0,27\n475;0,168;0,34\n2475;0,297;0,37\n"
PERIODS = ([0.048, 0.168, 0.297], [1 / 30, 1 / 475, 1 / 2475])
FLAT = ([0.1, 1, 2], [TEN, TEN, 0])
TABLES = [
    (CODE, {}, PERIODS),
    (CODE.encode("utf-16"), {}, PERIODS),
    # From the highest level down.
    ("return period [yr],PGA [g]\n1000,1\n475,.1\n", {}, ([0.1, 1], [1 / 475, 1e-3])),
    ("PGA [g],probability of exceedance in 50 years [%]\n.1,10\n1,10.0\n2,0\n", {}, FLAT),
    ("Sa [g]\tpoe_in_50_yr [-]\tPGA [g]\n9\t0.1\t.1\n9\t0.1\t1\n9\t0\t2\n", {}, FLAT),
    # A probability of 1 has no rate: the curve begins above it.
    ("pga [g],probability in 50 years [-]\n.01,1\n.05,1.0\n.1,0.1\n1,0.1\n2,0\n", {}, FLAT),
    ("pga [g],poe in 1 year [-]\n.1,1e-9\n1,1e-12\n", {}, ([0.1, 1], [1.0000000005e-9, 1e-12])),
    ("pgv [m/s],TR [yr],pga [g],std\n1,475,0.1,9\n2,1000,1,9\n", PGA, ([0.1, 1], [1 / 475, 1e-3])),
]  # fmt: skip


@pytest.mark.parametrize(("content", "options", "curve"), TABLES)
def test_tables(tmp_path, content, options, curve):
    hazard = jr.read_hazard(str(write(tmp_path, content)), **options)
    np.testing.assert_allclose(hazard.levels / G, curve[0], rtol=1e-12)
    np.testing.assert_allclose(hazard.rates, curve[1], rtol=1e-12)
    assert (hazard.measure, hazard.statistic) == ("pga", "")


LEVELS = np.array([0.005, 0.0137, 0.103, 0.556, 1.52])
COMMENT = (
    "#,,,,,,,\"generated_by='OpenQuake engine 3.20.0', start_date='2026-01-02T03:04:05',"
    " checksum=123456789, kind='mean', investigation_time=50.0, imt='PGA'\"\n"
)
OPENQUAKE = (
    f"{COMMENT}lon,lat,depth,{','.join(f'poe-{level:.7f}' for level in LEVELS)}\n"
    "-122.40000,37.75000,0.00000,1.000000E+00,8.123456E-01,1.000000E-01,1.000000E-01,0.0E+00\n"
)
SITES = f"{OPENQUAKE}-122.10000,37.75000,0.00000,9.0E-01,8.0E-01,2.0E-01,1.0E-02,1.0E-03\n"
FIRST = ([*LEVELS[1:]], [-np.log(1 - 0.8123456) / 50, TEN, TEN, 0.0])
NSHMP = (
    "name,lon,lat,0.005,0.0137,0.103,0.556,1.52\n"
    "Test Site,-122.40000,37.75000,2.85280770e-03,2.85280770e-03,1.5e-03,1.0e-04,0.0\n"
)
ANNUAL = ([*LEVELS], [2.8528077e-3, 2.8528077e-3, 1.5e-3, 1e-4, 0.0])
CM = 0.01 / G
PROGRAMS = [
    (OPENQUAKE, {}, "mean hazard of pga", 1, FIRST),
    (OPENQUAKE.replace("'PGA'", "'PGV'"), {"unit": "cm/s"}, "mean hazard of pgv", CM, FIRST),
    (OPENQUAKE.replace("'mean'", "'quantile-0.85'"), PGA, "quantile-0.85 hazard of pga", 1, FIRST),
    (OPENQUAKE.replace(",", ";"), {"statistic": "mean"}, "mean hazard of pga", 1, FIRST),
    (SITES, {"site": (-122.40001, 37.75)}, "mean hazard of pga", 1, FIRST),
    (NSHMP, PGA | {"unit": "g"}, "hazard of pga", 1, ANNUAL),
    (NSHMP, PGV | {"statistic": "max", "unit": "cm/s"}, "max hazard of pgv", CM, ANNUAL),
]  # fmt: skip


@pytest.mark.parametrize(("content", "options", "words", "factor", "curve"), PROGRAMS)
def test_curves_of_programs(tmp_path, content, options, words, factor, curve):
    hazard = jr.read_hazard(write(tmp_path, content, "SA0P2-std.csv"), **options)
    np.testing.assert_allclose(hazard.levels / G, factor * np.array(curve[0]), rtol=1e-12)
    np.testing.assert_allclose(hazard.rates, curve[1], rtol=1e-12)
    assert str(hazard).startswith(f"{words} from")


HEAD = "pga [g],rate [1/yr]"
# Contents, arguments, and what the error says after the name of the file.
REFUSED = [
    ("<?xml?>\n<nrml/>", {}, ".* 'pga .g.' .* 'rate .1/yr.'.* got '<.xml"),
    ("1,1e-2\n2,1e-3\n", {}, ", line 1: .* 'pga .g.' .* got '1,1e-2'"),
    ("level [g],rate [1/yr]\n1,2\n2,1\n", {}, ", line 1: measure must be given, .* 'level"),
    ("pgv,rate [1/yr]\n1,2\n2,1\n", {}, ", line 1: unit must be given, such as 'cm/s', .*'pgv'"),
    ("pgv [g],rate [1/yr]\n1,2\n2,1\n", {}, ", line 1: column 'pgv .g.' .* 'pgv .m/s.'"),
    (f"{HEAD}\n1,2\n2,1\n", {"unit": "m/s2"}, ", line 1: unit is 'm/s2', but .* 'pga .g.'"),
    (f"{HEAD}\n1,2\n2,1\n", PGV, ", line 1: one column of levels of pgv .* got 0"),
    (f"{HEAD},pgv [m/s]\n1,2,1\n2,1,1\n", {}, ", line 1: one column of levels .* got 2"),
    (f"{HEAD},TR [yr]\n1,2,1\n2,1,1\n", {}, ", line 1: one column of rates, .* got 2"),
    ("pga [g],poe in 0 years\n1,.2\n2,.1\n", {}, ", line 1: .* 'probability in 50 years"),
    ("pga [g],poe in 50 days\n1,.2\n2,.1\n", {}, ", line 1: .* 'probability in 50 years"),
    (f"{HEAD}\n1,2\n2,1\n", {"site": (1, 2)}, ": site goes with a table of several"),
    (f"{HEAD}\n1,often\n2,1e-3\n", {}, ", line 2: column 'rate .1/yr.' must be finite .*, got 'of"),
    ("pga [g],poe in 9 years [%]\n1,110\n2,1\n", {}, ", line 2: column 'poe in .* got '110'"),
    (f"{HEAD}\n3,1\n2,.1\n1,2\n", {}, ": rates must not rise with the level, got 1 after 0.1"),
    (f"{HEAD}\n.8,.1\n.5,.2\n.9,0\n", {}, ": levels must increase, got 4.9\\d* after"),
    ("pga [g],poe in 9 years [-]\n1,.1\n2,1\n3,.1\n", {}, ": rates must be finite and"),
    (f"{HEAD}\n0.1,2.345E-02\n0.2,1.345E-0", {}, ": rates must not rise"),
    (SITES, {}, ": site must be .* one of its 2 curves, .* -122.4 37.75, .* got none"),
    (SITES, {"site": (1, 2)}, ": site must be .* got 1 2"),
    (OPENQUAKE, PGV, ": measure is 'pgv', but the first line states 'pga'"),
    (OPENQUAKE, {"statistic": "max"}, ": statistic is 'max', but the first line states 'mean'"),
    (OPENQUAKE, {"unit": "m/s2"}, ": unit is 'm/s2', but pga is in g"),
    (OPENQUAKE.replace("'mean'", "'std'"), {}, ": .* standard deviations: take the mean"),
    (OPENQUAKE.replace("'PGA'", "'SA(0.3)'"), {}, ": measure must be .* got 'sa.0.3.'"),
    (OPENQUAKE.replace("=50.0", "=0"), {}, ": investigation_time must be stated"),
    (OPENQUAKE.replace("8.123456E-01", "none"), {}, ", line 3: column 'poe-0.0137000' .* 'none'"),
    (OPENQUAKE.replace("8.123456E-01", "1.1"), {}, ": probability must be between 0 and 1"),
    (OPENQUAKE.replace("poe-0.0137000", "0.2~PGA"), {}, ", line 2: .* poe-0.1, got '0.2~pga'"),
    (OPENQUAKE.replace(",0.00000,", ","), {}, ", line 3: 8 cells were expected, got 7"),
    (NSHMP, {}, ": measure must be given, as 'pga' or 'pgv', got none"),
    (NSHMP, PGV, ": unit must be given, 'g' for pga or 'cm/s' for pgv"),
]  # fmt: skip


@pytest.mark.parametrize(("content", "options", "message"), REFUSED)
def test_what_is_refused(tmp_path, content, options, message):
    check_refusal(write(tmp_path, content), message, jr.read_hazard, **options)


def test_arguments_that_are_refused(tmp_path):
    path = write(tmp_path, f"{HEAD}\n1,.1\n2,0\n")
    for name, value in (("measure", "pgv_ratio"), ("unit", "knots"), ("unit", "m")):
        with pytest.raises(ValueError, match=f"^{name} must be one .* got '{value}'"):
            jr.read_hazard(path, **{name: value})
