"""Hazard curves from files: what heads say, layouts of programs, and what is refused."""

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
    """Write a file, perhaps in a folder of its own; text as UTF-8."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


HEADS = [
    ("pga [g],rate [1/yr]", {}, G, "pga"),
    ("PGV (cm/s),annual rate", {}, 0.01, "pgv"),
    ("PGV m/s,rate 1/yr", {}, 1.0, "pgv"),
    ("pga_cm_s2,mean annual frequency of exceedance", {}, 0.01, "pga"),
    ("peak ground velocity [m s^-1],\u03bb [yr^-1]", {}, 1.0, "pgv"),
    ("Peak horizontal ground acceleration (m/s\u00b2),MAFE", {}, 1.0, "pga"),
    ("geometric mean PGA [%g],exceedance rate [1/a]", {}, 0.01 * G, "pga"),
    ("pgv [in/s],rate", {}, 0.0254, "pgv"),
    ("pgv [ft/s],frequency [1/yr]", {}, 0.3048, "pgv"),
    ("pgv,rate", {"unit": "in/s"}, 0.0254, "pgv"),
    ("pgv [cm/s],rate", {"unit": "cm/s"}, 0.01, "pgv"),
    ("level,rate", {"unit": "g", "measure": "pga"}, G, "pga"),
    ("intensity measure [gal],rate per year", PGA, 0.01, "pga"),
    # A comment may name the measure; below a name it may be about other columns.
    ("# PGA at the site\nIML [g],annual rate", {}, G, "pga"),
    ("PGA at the site\n\nIML [g],annual rate", {}, G, "pga"),
    ("# PGA, SA(1.0)\nPGA [g],annual rate", {}, G, "pga"),
    ("PGA (g),MAF", {}, G, "pga"),
    ("# PGA (g) and PGV (cm/s)\nPGA [g],annual rate", {}, G, "pga"),
    ("# units: gal\nPGA [cm/s2],rate", {}, 0.01, "pga"),
    ("# interpolate log(rate)\n# truncated at 3 sigma\nPGA [g],rate", {}, G, "pga"),
    ("# PGA and PGV\nlevel [cm/s],annual rate", PGV, 0.01, "pgv"),
    ("# PGA [g],rate [1/yr]", {}, G, "pga"),
    ("# PGA [g],annual rate", {}, G, "pga"),
    ("PGA,rate\n[g],[1/yr]", {}, G, "pga"),
]  # fmt: skip


@pytest.mark.parametrize(("head", "options", "factor", "measure"), HEADS)
def test_heads(tmp_path, head, options, factor, measure):
    """What they say of the measure and the unit is understood."""
    hazard = jr.read_hazard(write(tmp_path, f"{head}\n0.05,1e-2\n2,1e-4\n"), **options)
    np.testing.assert_allclose(hazard.levels, [0.05 * factor, 2 * factor], rtol=1e-12)
    np.testing.assert_array_equal(hazard.rates, [1e-2, 1e-4])
    assert hazard.measure == measure
    assert str(hazard).startswith(f"hazard of {measure} from")


FLAT = [TEN, TEN, 0]


TABLES = [
    ("PGA (g),probability of exceedance in 50 years\n.1,0.1\n1,0.1\n2,0\n", {}, FLAT),
    ("PoE (50 yr) [%],PGA [g]\n10,.1\n10.0,1\n0,2\n", {}, FLAT),
    ("PGA [g],probability_of_exceedance_in_50_years\n.1,.1\n1,.1\n2,0\n", {}, FLAT),
    ("pga_g,poe_50yr\n.1,0.1\n1,0.1\n2,0\n", {}, FLAT),
    ("pga [g],exceedance probability [50 yrs]\n.1,0.1\n1,0.1\n2,0\n", {}, FLAT),
    # A probability of 1 has no rate: the curve begins above it.
    ("pga [g],poe in 50 years\n.01,1\n.05,1.0\n.1,0.1\n1,0.1\n2,0\n", {}, FLAT),
    ("pga [g],annual probability\n.1,1e-9\n1,1e-12\n", {}, [1.0000000005e-9, 1e-12]),
    ("pga [g],probability per year\n.1,1e-9\n1,1e-12\n", {}, [1.0000000005e-9, 1e-12]),
    # From the highest level down.
    ("return period [yr],PGA [g]\n1000,1\n475,.1\n", {}, [1 / 475, 1e-3]),
    ("# mean, std\npga [g],rate,std\n.1,2e-3,1\n1,1e-3,1\n", {}, [2e-3, 1e-3]),
    ("PGA [g],return period in years\n1,1000\n.1,475\n", {}, [1 / 475, 1e-3]),
    ("n,return period [yr],PGA [g]\n1,475,.1\n2,1000,1\n", {}, [1 / 475, 1e-3]),
    ("recurrence interval (years),SA [g],PGV [m/s],PGA [g]\n475,2,4,0.1\n1000,2,5,1\n", PGA,
     [1 / 475, 1e-3]),
    # Of a curve and what else is known of the logic tree the curve is meant.
    ("pga [g],rate std [1/yr],mean rate,84th rate,rate (max)\n.1,1,2e-3,3,4\n1,1,1e-3,3,4\n", {},
     [2e-3, 1e-3]),
    ("return period [yr],PGA [g],id\n475,.1,1 2\n1000,1,1 3\n", {}, [1 / 475, 1e-3]),
    ("sep=;\nnote;rate;pga [g]\na, b;2e-3;0.1\n;1e-3;1\n", {}, [2e-3, 1e-3]),
    ("pga [g];rate\n0,1;2,0e-3\n1,0;1,0e-3\n", {}, [2e-3, 1e-3]),
    ("pga [g];rate;\n0,1;0,002;\n1,0;0,001;\n", {}, [2e-3, 1e-3]),
    ("Site A\nby us\n\npga [g];rate\n0.1;2d-3\n1;1D-3\n", {}, [2e-3, 1e-3]),
    ("# a\n# pga[g] rate[1/yr]\n0.1 2e-3\n1 1e-3\n", {}, [2e-3, 1e-3]),
    ("# a\npga_g rate\n# b\n 0.1  2e-3\n\n 1 1e-3\n", {}, [2e-3, 1e-3]),
    ("pga [g]\trate [1/yr]\tlower 5 %\n0.1\t2e-3\t1\n1\t1e-3\t1\n", {}, [2e-3, 1e-3]),
    ('"pga [g]","rate"\n"0.1","2e-3"\n"1","2e-3"\n2,0\n', {}, [2e-3, 2e-3, 0]),
    ('pga [g],note,rate\n.1,"a\nb",2e-3\n1,,1e-3\n', {}, [2e-3, 1e-3]),
    ("pga [g],rate\r\n.1,2e-3\r\n1,1e-3".encode("utf-16"), {}, [2e-3, 1e-3]),
    ("\ufeffpga [g],rate\n.1,2e-3\n1,1e-3\n", {}, [2e-3, 1e-3]),
]  # fmt: skip


@pytest.mark.parametrize(("content", "options", "rates"), TABLES)
def test_tables(tmp_path, content, options, rates):
    hazard = jr.read_hazard(str(write(tmp_path, content)), **options)
    np.testing.assert_allclose(hazard.levels, [0.1 * G, G, 2 * G][: len(rates)], rtol=1e-12)
    np.testing.assert_allclose(hazard.rates, rates, rtol=1e-12)
    assert hazard.measure == "pga"


TABLES_THAT_ARE_REFUSED = [
    (b"level,rate\n\xff\xfe\x00", ": a text file was expected, this one is binary"),
    ("", ": the file is empty"),
    ("# a\n", ": a line with the names .* comments"),
    ("<?xml?>\n<nrml/>", ", line 1: .* got XML or JSON: let OpenQuake export"),
    ('{"type": "FeatureCollection"}', ", line 1: .* got XML or JSON"),
    ("lon lat,PGA\n0.0 0.0,4.5E-01 5.8E-02 6.8E-03\n",
     ".*: a field .* first versions of OpenQuake"),
    ("lon,lat,PGA\n0.0,0.0,4.5E-01 5.8E-02 6.8E-03\n",
     ".*: a field .* first versions of OpenQuake"),
    ("0.0 0.0,4.5E-01 5.8E-02,6.8E-01 0.1\n", ".*: a field .* first versions of OpenQuake"),
    ("4.5E-01 5.8E-02 6.8E-03\n", ", line 1: names of the columns .* '4.5E-01 5.8E-02"),
    ("1,1e-2\n2,1e-3\n3,1e-4\n", ", line 1: names of the columns .* above '1,1e-2'"),
    ("pga [g],rate\n", ": at least two levels .* got 0"),
    ("pga [g],rate\n1,1e-3\n", ": at least two levels .* got 1"),
    ("pga [g],rate\n1,often\n2,1e-3\n", ", line 2: column 'rate' must be .* got 'often'"),
    ("# site\npga [g],rate\n1,2\n2,1,0\n", ", line 4: 2 fields .* commas .* got 3"),
    ("pga [g],a,rate\n1,2,3\n2,1\n", ", line 3: 3 fields .* commas .* got 2"),
    ("pgv [m/s],rate\n1,.1\n2,.2\n", ", line 3: rates must not rise .* 0.2 after 0.1$"),
    ("pgv [m/s],rate\n.8,.1\n.5,.2\n.9,0\n", ", line 3: levels must increase, got 0.5 a"),
    ("pgv [m/s],rate\n1,.1\n1,.2\n", ", line 3: levels must increase, got 1 after 1$"),
    ("pgv [m/s],rate\n3,1\n2,.1\n1,2\n", ", line 2: rates must not rise .* 1 after 0.1$"),
    ("pgv [m/s],rate\n1,.1\n2,nan\n", ", line 3: a rate must be .* at least 0, got nan"),
    ("pgv [m/s],rate\n1,.1\n2,-1\n", ", line 3: a rate must be .* at least 0, got -1"),
    ("pgv [m/s],rate\n0,.1\n2,0\n", ", line 2: a level must be .* than 0, got 0"),
    ("pgv [m/s],rate\n1,.1\n2,.1\n", ": rates must fall with the level, got 0.1 at all"),
    ("pga [g],poe in 9 years\n1,1.1\n2,1\n", ", line 2: a probability .* got 1.1"),
    ("pga [g],poe in 9 yr [%]\n1,11\n2,-1\n", ", line 3: a probability .* 100 %, got -1"),
    ("pga [g],poe in 9 years\n1,.1\n2,1\n", ", line 3: rates must not rise"),
    ("pga [g],poe in 9 years\n1,1\n2,1\n3,.1\n", ": at least two levels .* got 1"),
    ("pga [g],return period [yr]\n1,9\n2,0\n", ", line 3: a return period .* got 0"),
    ("pga [g]:rate\n1:1e-2\n", ".*: rows of numbers .*expected"),
    ("pga [g];rate\n0,100;2\n0,200;1.5\n", ", line 3: decimals must all stand behind"),
    ("pga [g],rate\n0.1,2.345E-02\n0.2,1.345E-0", ", line 3: the file looks truncated"),
    ("pga [g],rate\n0.1,0.0234\n0.2,0.00", ", line 3: the file looks truncated"),
]  # fmt: skip


@pytest.mark.parametrize(("content", "message"), TABLES_THAT_ARE_REFUSED)
def test_tables_that_are_refused(tmp_path, content, message):
    check_refusal(write(tmp_path, content), message, jr.read_hazard)


OFTEN = "one column must be a rate per year, a probability"
LEVEL = "one column must be pgv or pga with its unit"
SILENT = "the head does not say which measure .* so that measure must be given"


HEADS_THAT_ARE_REFUSED = [
    *[
        (f"pga [g],{name}", {}, f"1: {OFTEN}")
        for name in (
            *("ln(rate)", "rate [1/day]", "rate in 50 years", "rate [yr]", "1/rate [yr]"),
            *("rate std [1/yr]", "std [1/yr]", "std of rate", "median rate", "max rate"),
            *("rate (84th)", "84th percentile rate [1/yr]", "upper rate", "rate 0.84"),
            *(
                "probability",
                "probability of exceedance in years",
                "annual poe in 9 years",
            ),
            *("probability of non-exceedance in 50 years", "1 - probability in 50 years"),
            *("poe in 50 days", "poe_50", "poe in 0 years", "poe std in 50 years"),
            *("return period", "return period [days]", "period [s]", "frequency [Hz]"),
            *("rate,rate [1/yr]", "rate,return period [yr]"),
        )
    ],
    *[
        (f"{name},rate", {}, f"1: {LEVEL}")
        for name in (
            *("Sa(1.0 s) [g]", "PSA [g]", "ln pga [g]", "pga std [g]", "[g]", "pgd [m]"),
            *("median pga [g]", "acceleration [g]", "pga [g],pgv [m/s]"),
        )
    ],
    # Spectral acceleration is in g as well, Arias intensity in m/s.
    ("level [g],rate", {}, f"1: {SILENT}"),
    ("intensity [m/s],rate", {}, f"1: {SILENT}"),
    ("pgv,rate", {}, "1: the head states no unit, so that unit must be given, got 'pgv'"),
    ("pga [g],rate", PGV, "1: a hazard of pgv was expected, got one of pga"),
    ("level [g],rate", PGV, "1: 'g' is not understood as a unit of pgv"),
    ("pga [g],rate", {"unit": "m/s2"}, "1: unit is 'm/s2', but the head states 'pga"),
    ("pga [g],rate", {"unit": "cm/s"}, "1: unit is 'cm/s', but the head states 'pga"),
    ("pga [cm/s],rate", {}, "1: 'cm/s' is not understood as a unit of pga"),
    ("pga [counts],rate", {}, "1: 'counts' is not understood as a unit of pga"),
    ("pgv,rate", {"unit": "g"}, "1: 'g' is not understood as a unit of pgv"),
    ("lon,lat,depth,poe-0.1,poe-x", {}, "1: column 'poe-x' is not understood"),
    # What a comment or a title names instead.
    ("# SA(1.0 s), 5 % damping\nIML [g],annual rate", {}, "1: .* names another measure"),
    ("# IMT: SA(1.0)\nlevel [g],rate", PGA, "1: .* names another measure"),
    ("# a\n# spectral acceleration\nlevel [g],rate", {}, "2: .* names another measure"),
    ("Arias\n\nlevel [m/s],rate", PGV, "1: 'Arias' names another"),
    ("# probabilities in 50 years\nPGA [g],rate", {}, "1: .* names a probability"),
    ("# PoE, 50 yr\n# PGA [g],annual rate", {}, "1: .* names a probability"),
    ("# standard deviations\nPGA [g],rate", {}, "1: .* names standard deviations"),
    ("# std of rates\nPGA [g],rate", {}, "1: .* names standard deviations"),
    ("# spectral acceleration at 1 s\nPGA [g],rate", {}, "1: .* names another measure"),
    ("# PGV, or SA(1.0)\nPGA [g],rate", {}, "1: .* names another measure .* and pgv"),
    ("# per 50 years\nPGA [g],rate", {}, "1: 'per 50 years' .* names a number of years"),
    ("# investigation time 50\nPGA [g],rate", {}, "1: .* names a number of years"),
    ("# log10 values\nPGA [g],rate", {}, "1: .*log10' .* names logarithms"),
    ("# ln\nPGA [g],poe in 50 years", {}, "1: .*ln' .* names logarithms"),
    ("# frequency of non-exceedance\nPGA [g],rate", {}, "1: .* where exceedance was expected"),
    ("# units: m/s2\nPGA [g],rate", {}, "1: .* states m/s2, but levels are in g"),
    ("# PGA in m/s2\nPGA [g],rate", {}, "1: .* states m/s2, but levels are in g"),
    ("# peak ground velocity (m/s)\nPGV [cm/s],rate", {}, "1: .* states m/s, but"),
    ("# stdev\nPGA [g],rate", {}, "1: 'stdev' .* names standard deviations"),
    ("# unit cm/s2\nPGA,rate", {"unit": "g"}, "1: .* states cm/s2, but levels are in g"),
    ("# units: m/s\nPGV [cm/s],rate", {}, "1: .* states m/s, but levels are in cm/s"),
    ("PGA [g],rate [%/yr]", {}, f"1: {OFTEN}"),
    ("# PGV\nlevel [m/s],rate", PGA, "2: a hazard of pga was expected"),
    ("# PGV\nlevel [g],rate", {}, "2: 'g' is not understood as a unit of pgv"),
]  # fmt: skip


@pytest.mark.parametrize(("head", "options", "message"), HEADS_THAT_ARE_REFUSED)
def test_heads_that_are_refused(tmp_path, head, options, message):
    width = head.splitlines()[-1].count(",") - 1
    rows = "".join(f"{level}{',1e-2' * width},{rate}\n" for level, rate in ((1, 0.1), (2, 0)))
    check_refusal(
        write(tmp_path, f"{head}\n{rows}"), f", line {message}", jr.read_hazard, **options
    )


def test_arguments(tmp_path):
    path = write(tmp_path, "pga [g],rate\n1,.1\n2,0\n")
    check_refusal(
        tmp_path / "none.csv", ": the file cannot be read: No such file", jr.read_hazard
    )
    several = ": site goes with a table of several sites only, got"
    check_refusal(path, several, jr.read_hazard, site=(1, 2))
    with pytest.raises(ValueError, match="must be one of pgv, pga, or None, got 'pgv_r"):
        jr.read_hazard(path, measure="pgv_ratio")
    for unit in ("knots", "m"):
        with pytest.raises(ValueError, match=f"^unit must be one like 'm/s', .* got '{unit}'"):
            jr.read_hazard(path, unit=unit)


@pytest.mark.parametrize(
    ("head", "cells", "statistic"),
    [
        ("# statistic=max\nPGA [g],rate", "", "max"),
        ("# Median hazard\nPGA [g],rate", "", "median"),
        ("# kind='quantile-0.84'\nPGA [g],rate", "", "quantile-0.84"),
        ("# 84th percentile\nPGA [g],rate", "", "quantile-0.84"),
        ("# mean, 84th percentile\nPGA [g],rate,84th rate", ",1", "mean"),
        ("PGA hazard, quantile 0.84,\nPGA [g],rate", "", "quantile-0.84"),
        ("# max. distance 200 km, mean magnitude\nPGA [g],rate", "", ""),
        ("PGA [g],rate,kind", ",mean", "mean"),
        ("PGA [g],rate,percentile", ",16", "quantile-0.16"),
        ("PGA [g],rate,imt", ",PGA", ""),
        ("level [g],rate,imt", ",PGA", ""),
    ],
)
def test_statistic(tmp_path, head, cells, statistic):
    """Of which curves of a logic tree it is, comments, titles and columns of words may say."""
    path = write(tmp_path, f"{head}\n.1,2e-3{cells}\n1,1e-3{cells}\n")
    assert jr.read_hazard(path).statistic == statistic


@pytest.mark.parametrize(
    ("head", "cells", "message"),
    [
        ("PGA [g],rate,kind", (",mean", ",max"), "column 'kind' must be the same"),
        ("PGA [g],rate,imt", (",PGA", ",SA(1)"), "column 'imt' must be the same"),
        ("PGA [g],rate,imt", (",SA(1)",) * 2, "'imt=SA.1.' names another measure"),
        ("PGA [g],rate,kind", (",std",) * 2, "'std' beside the columns"),
        ("PGA [g],rate,unit", (",m/s2",) * 2, ".* states m/s2, but levels are in g"),
        ("# 16th and 84th percentile\nPGA [g],rate", ("", ""), "one kind of curve"),
        ("# percentiles\nPGA [g],rate", ("", ""), "one kind of curve"),
        ("# kind='mode'\nPGA [g],rate", ("", ""), "one kind .* got 'mode'"),
    ],
)
def test_notes_that_are_refused(tmp_path, head, cells, message):
    path = write(tmp_path, f"{head}\n.1,2e-3{cells[0]}\n1,1e-3{cells[1]}\n")
    check_refusal(path, f".*: {message}", jr.read_hazard)


LEVELS = np.array([0.005, 0.0137, 0.103, 0.556, 1.52])
POES = "1.000000E+00,8.123456E-01,1.000000E-01,1.000000E-01,0.000000E+00"
NEWER = (
    "#,,,,,,,\"generated_by='OpenQuake engine 3.20.0', start_date='2026-01-02T03:04:05',"
    " checksum=123456789, kind='mean', investigation_time=50.0, imt='PGA'\"\n"
    f"lon,lat,depth,{','.join(f'poe-{level:.7f}' for level in LEVELS)}\n"
    f"-122.40000,37.75000,0.00000,{POES}\n"
)
SITES = NEWER + "-122.10000,37.75000,0.00000,9.0E-01,8.0E-01,2.0E-01,1.0E-02,1.0E-03\n"
COMMENT = NEWER.splitlines()[0]
OLDER = NEWER.replace(COMMENT, '# mean, investigation_time=50.0, imt="PGA"')
TREE = (
    "source_model_tree_path=('b1',), gsim_tree_path=('b1',), investigation_time=50.0,imt=PGA"
)
NAMES = NEWER.splitlines()[1]
TYPES = NEWER.replace(NAMES, NAMES.replace(",", ":float32,") + ":float32")
SEMICOLONS = COMMENT + NEWER.removeprefix(COMMENT).replace(",", ";")
SECOND = (
    "# max, investigation_time=50.0\nlon,lat,PGA-0.005,PGA-0.0137,PGA-0.103,PGA-0.556,PGA-1.52"
    f",SA(0.1)-0.01,SA(0.1)-0.2\n-122.4,37.75,{POES},9E-1,1E-1\n"
)
BOTH = SECOND.replace("SA(0.1)", "PGV")
POINTS = np.transpose([G * LEVELS[1:], [-np.log(1 - 0.8123456) / 50, TEN, TEN, 0.0]])


@pytest.mark.parametrize(
    ("content", "name", "statistic"),
    [
        (NEWER, "hazard_curve-mean-PGA_1.csv", "mean"),
        (NEWER.replace("'mean'", "'max'"), "hazard_curve-max-PGA_1.csv", "max"),
        (NEWER.replace("'mean'", "'quantile-0.85'"), "curve.csv", "quantile-0.85"),
        (NEWER.replace("'mean'", "'rlz-012'"), "hazard_curve-rlz-012-PGA_1.csv", "rlz-012"),
        (NEWER.replace("kind='mean', ", ""), "hazard_curve-max-PGA_1.csv", "max"),
        (NEWER.replace("kind='mean', ", ""), "a.csv", ""),
        (OLDER, "hazard_curve-mean-PGA.csv", "mean"),
        (OLDER.replace("mean", "quantile-0.1"), "quantile_curve-0.1.csv", "quantile-0.1"),
        (NEWER.replace(COMMENT, f"# {TREE}"), "curve.csv", "single realization"),
        (TYPES, "a.csv", "mean"),
        (SEMICOLONS, "a.csv", "mean"),
        (SECOND, "hazard_curve-max.csv", "max"),
    ],
)
def test_openquake(tmp_path, content, name, statistic):
    """What curve of a logic tree this is, is printed; a probability of 1 has no rate."""
    hazard = jr.read_hazard(write(tmp_path, content, name))
    np.testing.assert_allclose(np.transpose([hazard.levels, hazard.rates]), POINTS, rtol=1e-12)
    assert hazard.statistic == statistic
    assert str(hazard).startswith(f"{statistic} hazard of pga from".lstrip())


CHANGED_OPENQUAKE = [
    ("'PGA'", "'PGV'", {}, 0.01),
    ("", "", PGA | {"unit": "g"}, G),
    ("", "", PGV, ", line 2: a hazard of pgv was expected, got one of pga"),
    ("", "", {"unit": "m/s2"}, ", line 2: unit is 'm/s2', but OpenQuake has PGA in g"),
    ("'mean'", "'std'", {}, ", line 1: .std. beside .* standard deviations, .* take the mean"),
    ("'mean'", "'max'", {}, ": one kind of curve was expected .* got 'max', 'mean'"),
    ("'mean'", "'other'", {}, ": one kind of curve was expected .* got 'mean', 'other'"),
    ("'PGA'", "'SA(0.3)'", {}, ": a hazard of pga or pgv .* got one of 'SA\\(0.3\\)'"),
    ("imt=", "im=", {}, ": one imt was expected in comments, .* got none"),
    ("=50.0", "=5 0.0", {}, ": investigation_time must be .* got '5 0.0'"),
    ("=50.0", "=0", {}, ": investigation_time must be greater than 0, got '0'"),
    ("investigation_time=50.0, ", "", {}, ": one investigation_time was expected"),
    ("8.123456E-01", "none", {}, ", line 3: column 'poe-0.0137000' must be a number"),
    ("8.123456E-01", "1.1E+00", {}, ", line 3: a probability must be .* got 1.1"),
    ("8.123456E-01", "0.000000E+00", {}, ", line 3: rates must not rise"),
    ("-122.40000", "-522.4", {}, ", line 3: a longitude must be .* got -522.4"),
    ("lat", "lon", {}, ", line 2: one longitude was expected, got 2"),
    (",0.00000,", ",", {}, ", line 3: 8 fields separated by commas were expected, got 7"),
    ("0.0137000", "0.0030000", {}, ", line 3: levels must increase, got 0.003 a"),
    ("poe-0.0137000", "0.2~PGA", {}, ", line 2: column '0.2~PGA' is not understood"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "options", "message"), CHANGED_OPENQUAKE)
def test_changed_openquake(tmp_path, old, new, options, message):
    path = write(tmp_path, NEWER.replace(old, new, 1), "hazard_curve-mean_1.csv")
    if isinstance(message, str):
        check_refusal(path, message, jr.read_hazard, **options)
    else:
        levels = jr.read_hazard(path, **options).levels
        np.testing.assert_allclose(levels, message * LEVELS[1:], rtol=1e-12)


NSHMP = (
    "name,lon,lat,0.005,0.0137,0.103,0.556,1.52\n"
    "Test Site,-122.40000,37.75000,2.85280770e-03,2.85280770e-03,1.5e-03,1.00000000e-04,0.0\n"
)


CURVES_OF_SITES = [
    # One of several sites.
    (SITES, "a.csv", {}, ": site must be given, the longitude .* 2 curves: -122"),
    (SITES, "a.csv", {"site": (1, 2)}, ": site must be .* of its 2 .*, got 1 2,"),
    (SITES, "a.csv", {"site": (-122.10001, 37.75)}, "mean hazard of pga"),
    # Of engine 2 the name says whether it is a curve, and there may be several measures.
    (SECOND, "hazard_map-max.csv", {}, ", line 2: columns .* in its hazard maps"),
    (SECOND, "curve.csv", PGV, ", line 2: columns of .* pgv, got"),
    (BOTH, "curve.csv", {}, ", line 2: .* got those of 'pga', "),
    (BOTH, "curve.csv", PGV, "max hazard of pgv"),
    (SECOND.replace("max", "std"), "curve.csv", {}, ", line 1: .* standard deviations"),
    # The folder of nshmp-haz names the measure, or the caller does, and then the unit as well.
    (NSHMP, "PGA/curves.csv", {}, "hazard of pga"),
    (NSHMP, "PGA/source/FAULT/curves.csv", {}, "source FAULT hazard of pga"),
    (NSHMP, "PGA/gmm/CY_08.csv", {}, "gmm CY_08 hazard of pga"),
    (NSHMP, "SA0P2/gmm/CY_08.csv", {}, ": .*SA0P2. names another measure"),
    (NSHMP, "total.csv", PGA | {"unit": "g"}, "hazard of pga"),
    (NSHMP, "PGA/curves.csv", PGV, ", line 1: a hazard of pgv was"),
    (NSHMP, "total.csv", {"unit": "g"}, f", line 1: {SILENT}"),
    (NSHMP, "total.csv", PGV, ", line 1: the head states no unit"),
    (NSHMP, "a.csv", PGV | {"unit": "g"}, ", line 1: 'g' is not .* unit of pgv"),
    (NSHMP, "PGA/quantile-0.84.csv", {}, "quantile-0.84 hazard of pga"),
    (NSHMP, "PGA/total-std.csv", {}, ": 'std' beside .* standard deviations"),
    (NSHMP, "PGA/curves-sigma.csv", {}, ": 'sigma' beside .* standard deviations"),
    (NSHMP, "pga-poe-50yr.csv", {}, ": 'poe' beside .* a probability"),
    (NEWER, "hazard_curve-mean-SA(0.1).csv", {}, ": .* names another measure"),
    (NSHMP, "SA0P2.csv", PGA | {"unit": "g"}, ": .*SA0P2. names another measure"),
]  # fmt: skip


@pytest.mark.parametrize(("content", "name", "options", "answer"), CURVES_OF_SITES)
def test_sites(tmp_path, content, name, options, answer):
    path = write(tmp_path, content, name)
    if answer[0] in ":,":
        check_refusal(path, answer, jr.read_hazard, **options)
        return
    hazard = jr.read_hazard(path, **options)
    assert str(hazard).startswith(f"{answer} from")
    levels = 0.01 * np.array([0.01, 0.2]) if "pgv" in answer else G * LEVELS[-2:]
    np.testing.assert_allclose(hazard.levels[-2:], levels, rtol=1e-12)
    last = {NSHMP: 1e-4, SITES: -np.log(0.99) / 50}.get(content, hazard.rates[-2])
    np.testing.assert_allclose(hazard.rates[-2], last, rtol=1e-12)
