"""Hazard curves from files: tables, curves of OpenQuake, and what is refused."""

import numpy as np
import pytest

import jaxrock as jr

pytestmark = pytest.mark.float64
G = 9.80665
PGA = {"measure": "pga"}
PGV = {"measure": "pgv"}
# 10 % in 50 years is the probability of a return period of 474.6 years.
TEN = -np.log(0.9) / 50
HEADS = [
    ("pga [g],rank,rate [1/yr]", {}, G, "hazard of pga"),
    ("# PGV, or what else\nag (cm/s2),n,Rate (1/year)", {}, 0.01, "hazard of pga"),
    ("PGA of the site\n\nvg [in/s],n,rate [1/a]", {}, 0.0254, "hazard of pgv"),
    ("pgv [cm/s],pga [g],rate [1/yr]", {"unit": "cm s-1"} | PGV, 0.01, "hazard of pgv"),
    ("level [gal],n,rate [1/yr]", {"statistic": "max"} | PGA, 0.01, "max hazard of pga"),
    ("level,n,rate [1/yr]", {"unit": "g"} | PGA, G, "hazard of pga"),
]
CODE = "TR [anni];ag [g];TC* [s]\n30;0,048;0,27\n475;0,168;0,34\n2475;0,297;0,37\n"
PERIODS = ([0.048, 0.168, 0.297], [1 / 30, 1 / 475, 1 / 2475])
# A rate that is printed as 0 is not known.
FLAT = ([0.1, 1], [TEN, TEN])
TABLES = [
    (CODE, PERIODS),
    (CODE.encode("utf-16"), PERIODS),
    # From the highest level down.
    ("return period [yr],PGA [g]\n1000,1\n475,.1\n", ([0.1, 1], [1 / 475, 1e-3])),
    ("PGA [g],probability of exceedance in 50 years [%]\n.1,10\n1,10.0\n2,0\n", FLAT),
    ("Sa [g]\tpoe_in_50_yr [-]\tPGA [g]\n9\t0.1\t.1\n9\t0.1\t1\n9\t0\t2\n", FLAT),
    # A probability of 1 has no rate: the curve begins above it.
    ("pga [g],probability in 50 years [-]\n.01,1\n.05,1.0\n.1,0.1\n1,0.1\n2,0\n", FLAT),
    ("pga [g],poe in 1 year [-]\n.1,1e-9\n1,1e-12\n", ([0.1, 1], [1.0000000005e-9, 1e-12])),
]
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
FIRST = ([*LEVELS[1:-1]], [-np.log(1 - 0.8123456) / 50, TEN, TEN])
IN_PGV, QUANTILE = (
    OPENQUAKE.replace(*words) for words in (("PGA", "PGV"), ("mean", "q-0.85"))
)
# Contents, arguments, the unit of the levels that are right, and what is printed.
READ = [
    *(
        (f"{head}\n0.05,1,1e-2\n2,2,1e-4\n", options, factor, ([0.05, 2], [1e-2, 1e-4]), words)
        for head, options, factor, words in HEADS
    ),
    *((content, {}, G, curve, "hazard of pga") for content, curve in TABLES),
    (OPENQUAKE, {}, G, FIRST, "mean hazard of pga"),
    (IN_PGV, {"unit": "cm/s"}, 0.01, FIRST, "mean hazard of pgv"),
    (QUANTILE, PGA, G, FIRST, "q-0.85 hazard of pga"),
    (OPENQUAKE.replace(",", ";"), {"statistic": "mean"}, G, FIRST, "mean hazard of pga"),
    (SITES, {"site": (-122.40001, 37.75)}, G, FIRST, "mean hazard of pga"),
]


@pytest.mark.parametrize(("content", "options", "factor", "curve", "words"), READ)
def test_what_is_read(write, content, options, factor, curve, words):
    hazard = jr.risk.read_hazard(write(content, "SA0P2-std.csv"), **options)
    np.testing.assert_allclose(hazard.levels, factor * np.array(curve[0]), rtol=1e-12)
    np.testing.assert_allclose(hazard.rates, curve[1], rtol=1e-12)
    assert str(hazard).startswith(f"{words} from")


HEAD = "pga [g],rate [1/yr]"
ROWS = "\n1,2\n2,1\n"
# Contents, arguments, and what the error says after the name of the file, one of each kind.
REFUSED = [
    ("<?xml?>\n<nrml/>", {}, ".* 'pga .g.' .* 'rate .1/yr.'.* got '<.xml"),
    (f"level [g],rate [1/yr]{ROWS}", {}, ", line 1: measure must be given, .* 'level"),
    (f"pgv,rate [1/yr]{ROWS}", {}, ", line 1: unit must be given for 'pgv'"),
    (HEAD + ROWS, {"unit": "m/s2"}, ", line 1: unit must be .* got 'm/s2'"),
    (HEAD + ROWS, PGV, ", line 1: one column of levels of pgv, .* got 'pga"),
    (f"pga [g],poe in 50 days{ROWS}", {}, ", line 1: .* 'probability in 50 years"),
    (HEAD + ROWS, {"site": (1, 2)}, ": site goes with a table of several"),
    ("pga [g],poe in 9 years [%]\n1,110\n2,1\n", {}, ", line 2: column 'poe in .* got '110'"),
    (f"{HEAD}\n3,1\n2,.1\n1,2\n", {}, ": rates must not rise with the level, got 1 after 0.1"),
    (f"{HEAD}\n0.1,2.345E-02\n0.2,1.345E-0", {}, ": rates must not rise"),
    (SITES, {}, ": site must be .* one of its 2 curves, .* -122.4 37.75, .* got none"),
    (OPENQUAKE, PGV, ": the first line states pga mean in g, another"),
    (OPENQUAKE.replace("mean", "std"), {}, ": its first line must .* no standard deviation"),
    (OPENQUAKE.replace("PGA", "SA(0.3)"), {}, ": its first line must .* 'sa.0.3.'"),
    (HEAD + ROWS, {"unit": "knots"}, None),
]


@pytest.mark.parametrize(("content", "options", "message"), REFUSED)
def test_what_is_refused(write, content, options, message):
    pattern = rf"^'[^']*a\.csv'{message}" if message else "^unit must be one .* got 'knots'"
    with pytest.raises(ValueError, match=pattern) as error:
        jr.risk.read_hazard(write(content), **options)
    assert "\n" not in str(error.value)
