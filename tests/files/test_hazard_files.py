"""Hazard curves from files: what heads say, layouts of programs, and what is refused."""

import numpy as np
import pytest

import jaxrock as jr
from jaxrock.host.tables import _is_cut

pytestmark = pytest.mark.float64
G = 9.80665


def refuses(message, path, **options):
    """Whether a file is refused with this message, in one sentence that names it."""
    with pytest.raises(ValueError, match=f"^'[^']*{path.name}'{message}") as error:
        jr.read_hazard(path, **options)
    return "\n" not in str(error.value)


def test_a_table_of_levels_and_rates(tmp_path):
    path = tmp_path / "hazard.csv"
    path.write_text(
        "# a site\nPGV [m/s], rate [1/yr]\n0.1,2e-2\n\n# far\n 0.3, 2e-3\n1,1e-4\n"
    )
    for hazard in (jr.read_hazard(path), jr.read_hazard(str(path))):
        np.testing.assert_array_equal(hazard.levels, [0.1, 0.3, 1.0])
        np.testing.assert_array_equal(hazard.rates, [2e-2, 2e-3, 1e-4])


@pytest.mark.parametrize(
    ("head", "options", "factor", "measure"),
    [
        ("pga [g],rate [1/yr]", {}, G, "pga"),
        ("PGV (cm/s),annual rate", {}, 0.01, "pgv"),
        ("pga_cm_s2,mean annual frequency of exceedance", {}, 0.01, "pga"),
        ("peak ground velocity [m s^-1],\u03bb [yr^-1]", {}, 1.0, "pgv"),
        ("pgv,rate", {"unit": "mm/s"}, 1e-3, "pgv"),
        ("level,rate", {"unit": "g", "measure": "pga"}, G, "pga"),
        (
            "intensity measure [gal],rate per year",
            {"unit": "cm/s2", "measure": "pga"},
            0.01,
            "pga",
        ),
        # A comment may name the measure; below a name it may be about other columns.
        ("# PGA at the site\nIML [g],annual rate", {}, G, "pga"),
        ("# PGV, or SA(1.0)\nPGA [g],annual rate", {}, G, "pga"),
        ("# PGA and PGV\nlevel [cm/s],annual rate", {"measure": "pgv"}, 0.01, "pgv"),
        ("# PGA [g],rate [1/yr]", {}, G, "pga"),
    ],
)
def test_heads(tmp_path, head, options, factor, measure):
    """What they say of the measure and the unit is understood."""
    path = tmp_path / "hazard.csv"
    path.write_text(f"{head}\n0.05,1e-2\n2,1e-4\n", encoding="utf-8")
    hazard = jr.read_hazard(path, **options)
    np.testing.assert_allclose(hazard.levels, [0.05 * factor, 2 * factor], rtol=1e-12)
    np.testing.assert_array_equal(hazard.rates, [1e-2, 1e-4])
    assert hazard.measure == measure
    assert f"hazard of {measure} from" in str(hazard)


# 10 % in 50 years is the probability of a return period of 474.6 years.
TEN = 50 / -np.log(0.9)


@pytest.mark.parametrize(
    ("content", "options", "rates"),
    [
        (
            "PGA (g),probability of exceedance in 50 years\n.1,0.1\n1,0.1\n2,0\n",
            {},
            [1 / TEN] * 2 + [0],
        ),
        ("PoE (50 yr) [%],PGA [g]\n10,.1\n10.0,1\n0,2\n", {}, [1 / TEN] * 2 + [0]),
        (
            "PGA [g],probability_of_exceedance_in_50_years\n.1,.1\n1,.1\n2,0\n",
            {},
            [1 / TEN] * 2 + [0],
        ),
        ("pga_g,poe_50yr\n.1,0.1\n1,0.1\n2,0\n", {}, [1 / TEN] * 2 + [0]),
        # From the highest level down.
        ("return period [yr],PGA [g]\n1000,1\n475,.1\n", {}, [1 / 475, 1e-3]),
        ("PGA [g],rate\n2,0\n1,1e-3\n.1,1e-3\n", {}, [1e-3, 1e-3, 0]),
        ("pga [g],annual probability\n.1,1e-9\n1,1e-12\n", {}, [1.0000000005e-9, 1e-12]),
        ("n,return period [yr],PGA [g]\n1,475,.1\n2,1000,1\n", {}, [1 / 475, 1e-3]),
        (
            "RP,recurrence interval (years),SA(0.2) [g],PGV [cm/s],PGA [g]\n"
            "x,475,.2,4,0.1\ny,1000,2,5,1\n",
            {"measure": "pga"},
            [1 / 475, 1e-3],
        ),
        ("sep=;\nnote;rate;pga [g]\na, b;2e-3;0.1\n;1e-3;1\n", {}, [2e-3, 1e-3]),
        ("pga [g]\trate [1/yr]\tlower 5 %\n0.1\t2e-3\t1\n1\t1e-3\t1\n", {}, [2e-3, 1e-3]),
        ('"pga [g]","rate"\n"0.1","2e-3"\n"1","2e-3"\n2,0\n', {}, [2e-3, 2e-3, 0]),
        # A probability of 1 has no rate: the curve begins above it.
        (
            "pga [g],poe in 50 years\n.01,1\n.05,1.0\n.1,0.1\n1,0.1\n2,0\n",
            {},
            [1 / TEN] * 2 + [0],
        ),
    ],
)
def test_columns_by_their_names(tmp_path, content, options, rates):
    path = tmp_path / "hazard.csv"
    path.write_text(content)
    hazard = jr.read_hazard(path, **options)
    np.testing.assert_allclose(hazard.levels, [0.1 * G, G, 2 * G][: len(rates)], rtol=1e-12)
    np.testing.assert_allclose(hazard.rates, rates, rtol=1e-12)
    assert hazard.measure == "pga"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, ": the file cannot be read: No such file"),
        (b"level,rate\n\xff\xfe\x00", ": a text file was expected, this one is binary"),
        (b"", ": a table of levels and rates was expected, got no lines"),
        (b"pga [g],rate\n1,1e-3\n", ": at least two lines .* got 1"),
        (b"level,rate\n1,often\n2,1e-3\n", ", line 2: a level and a rate .* got '1,often'"),
        (b"# site\nlevel,rate\n1,2\n2,1,0\n", ", line 4: 2 fields were .* got '2,1,0'"),
        (b"pgv [m/s],rate\n1,1e-3\n2,2e-3\n", ", line 3: rates must not rise .* 2 and 0.002"),
        (
            b"pgv [m/s],rate\n1,1e-3\n1,2e-4\n",
            ", line 3: levels must increase .* 1 and then 1",
        ),
        (b"pgv [m/s],rate\n3,0\n1,1e-3\n2,2e-4\n", ", line 3: levels .* 3 and then 1$"),
        (b"pgv [m/s],rate\n3,1\n2,1e-3\n1,2\n", ", line 2: rates must not rise .* 3 and 1$"),
        (b"pgv [m/s],rate\n1,1e-3\n2,nan\n", ", line 3: a rate must be finite and at least 0"),
        (b"pgv [m/s],rate\n1,1e-3\n2,-1\n", ", line 3: a rate must be finite and at least 0"),
        (b"pgv [m/s],rate\n0,1e-3\n2,0\n", ", line 2: a level must be finite and greater"),
        (b"pgv [m/s],rate\n1,1e-3\n2,1e-3\n", ": rates must fall with the level, got only"),
        (b"pga [g],poe in 9 years\n1,1.1\n2,1\n", ", line 2: a probability must be from 0 to"),
        (b"pga [g],poe in 9 yr [%]\n1,11\n2,-1\n", ", line 3: a probability .* 0 to 100 %"),
        (b"pga [g],poe in 9 years\n1,.1\n2,1\n", ", line 3: rates must not rise"),
        (b"pga [g],return period [yr]\n1,9\n2,0\n", ", line 3: a period must be greater than"),
        (b"1,1e-2\n2,1e-3\n3,1e-4\n", ", line 1: a line with the names .* got '1,1e-2'"),
        (b"pga [g];rate\n1;1e-2\n2;1e-3\n", ", line 1: columns were .* separated by commas"),
        (b"sep=:\npga [g]:rate\n1:1e-2\n", ", line 1: one column must be a rate"),
        (b"pga [g],rate\n0.1,2.345E-02\n0.2,1.345E-0", ", line 3: the file seems to be cut"),
        (b"pga [g],rate\n0.1,0.0234\n0.2,0.00", ", line 3: the file seems to be cut within"),
    ],
)
def test_tables_that_are_refused(tmp_path, content, message):
    path = tmp_path / "hazard.csv"
    if content is not None:
        path.write_bytes(content)
    assert refuses(message, path)


OFTEN = "one column must be a rate of exceedance per year"
LEVEL = "one column must be pgv or pga with its unit"
SILENT = "the head does not say which measure .* so that measure must be given"


@pytest.mark.parametrize(
    ("head", "options", "message"),
    [
        ("pgv,rate", {}, "the head states no unit, so that unit must be given, got 'pgv'"),
        ("pga [g],rate", {"measure": "pgv"}, "a hazard of pgv was expected, got one of pga"),
        ("pga [g],ln(rate)", {}, OFTEN),
        ("pga [g],rate [1/day]", {}, OFTEN),
        ("pga [g],rate in 50 years", {}, OFTEN),
        ("pga [g],rate [yr]", {}, OFTEN),
        ("pga [g],1/rate [yr]", {}, OFTEN),
        ("pga [g],probability", {}, OFTEN),
        ("pga [g],probability of exceedance in years", {}, OFTEN),
        ("pga [g],probability of non-exceedance in 50 years", {}, OFTEN),
        ("pga [g],1 - probability in 50 years", {}, OFTEN),
        ("pga [g],annual probability in 50 years", {}, OFTEN),
        ("pga [g],poe in 50 days", {}, OFTEN),
        ("pga [g],poe_50", {}, OFTEN),
        # Spectral acceleration is in g as well, Arias intensity in m/s.
        ("level [g],rate", {}, SILENT),
        ("intensity [m/s],rate", {}, SILENT),
        ("level,rate", {"unit": "g"}, SILENT),
        ("level [g],rate", {"measure": "pgv"}, "'g' is not understood as a unit of pgv"),
        ("pga [g],return period", {}, OFTEN),
        ("pga [g],return period [days]", {}, OFTEN),
        ("rate [1/yr],rate [1/yr]", {}, OFTEN),
        ("Sa(1.0 s) [g],rate", {}, LEVEL),
        ("ln pga [g],rate", {}, LEVEL),
        ("pga [g],rate", {"unit": "m/s2"}, "unit is 'm/s2', but the head states 'pga"),
        ("pga [g],rate", {"site": (1.0, 2.0)}, "site goes with a table of several sites only"),
        ("pga [cm/s],rate", {}, "'cm/s' is not understood as a unit of pga"),
        ("pgv [in/s],rate", {}, "'in/s' is not understood as a unit of pgv"),
        ("pga [counts],rate", {}, "'counts' is not understood as a unit of pga"),
        ("pgv,rate", {"unit": "g"}, "'g' is not understood as a unit of pgv"),
        ("pgv,rate", {"unit": "knots"}, "unit must be one like 'm/s', .* got 'knots'"),
        ("pga [g],pgv [m/s],rate", {}, f"{LEVEL}, .* got 2 of them"),
        ("lon,lat,depth,poe-0.1,poe-x", {}, "column 'poe-x' is not understood"),
    ],
)
def test_heads_that_are_refused(tmp_path, head, options, message):
    path = tmp_path / "hazard.csv"
    path.write_text(f"{head}\n0.05,1e-2\n2,1e-4\n", encoding="utf-8")
    message = f", line 1: {message}" if "site" not in message else f": {message}"
    assert refuses(message, path, **options)


@pytest.mark.parametrize(
    ("above", "options", "message"),
    [
        ("# SA(1.0 s), 5 % damping\nIML [g],annual rate", {}, "1: a comment names another"),
        ("# IMT: SA(1.0)\nlevel [g],rate", {"measure": "pga"}, "1: a comment names another"),
        ("# a\n# spectral acceleration\nx [g],rate", {}, "2: a comment names another measure"),
        ("# Arias\nx [m/s],rate", {"measure": "pgv"}, "1: a comment names another measure"),
        ("# probabilities in 50 years\nPGA [g],rate", {}, "1: a comment names a probability"),
        ("# PoE, 50 yr\n# PGA [g],annual rate", {}, "1: a comment names a probability"),
        ("# PGV\nlevel [m/s],rate", {"measure": "pga"}, "2: a hazard of pga was expected"),
        ("# PGV\nlevel [g],rate", {}, "2: 'g' is not understood as a unit of pgv"),
    ],
)
def test_comments_that_contradict_the_names(tmp_path, above, options, message):
    path = tmp_path / "hazard.csv"
    path.write_text(f"{above}\n0.05,1e-2\n2,1e-4\n")
    assert refuses(f", line {message}", path, **options)


def test_measures_that_no_hazard_is_about(tmp_path):
    for call in (
        lambda: jr.Hazard([0.1, 1.0], [1e-2, 1e-4], "pgv_ratio"),
        lambda: jr.read_hazard(tmp_path / "none.csv", measure="pgv_ratio"),
    ):
        with pytest.raises(ValueError, match="must be one of pgv, pga, or None, got 'pgv_r"):
            call()


LEVELS = np.array([0.005, 0.0137, 0.103, 0.556, 1.52])
POES = ["1.000000E+00", "8.123456E-01", "1.000000E-01", "1.000000E-01", "0.000000E+00"]
ELSEWHERE = ["9.000000E-01", "8.000000E-01", "2.000000E-01", "1.000000E-02", "1.000000E-03"]


def openquake(measure="PGA", places=((-122.4, 37.75, POES),), years="50.0"):
    """A curve in the layout of OpenQuake's engine 3."""
    about = "start_date='2026-01-02T03:04:05', checksum=123456789, kind='mean'"
    said = f"{about}, investigation_time={years}, imt='{measure}'"
    names = ["lon", "lat", "depth", *(f"poe-{level:.7f}" for level in LEVELS)]
    lines = [f"#,,,,,,,\"generated_by='OpenQuake engine 3.20.0', {said}\"", ",".join(names)]
    lines += [",".join([f"{x:.5f}", f"{y:.5f}", "0.00000", *poes]) for x, y, poes in places]
    return "\n".join(lines) + "\n"


EXPECTED = np.array([-np.log(1 - 0.8123456) / 50, 1 / TEN, 1 / TEN, 0.0])


@pytest.mark.parametrize(("measure", "factor"), [("PGA", G), ("PGV", 0.01)])
def test_openquake(tmp_path, measure, factor):
    """PGA is in g and PGV in cm/s, and a probability of 1 has no rate."""
    path = tmp_path / "hazard_curve-mean_1.csv"
    path.write_text(openquake(measure))
    hazard = jr.read_hazard(path)
    np.testing.assert_allclose(hazard.levels, factor * LEVELS[1:], rtol=1e-12)
    np.testing.assert_allclose(hazard.rates, EXPECTED, rtol=1e-12)
    assert hazard.measure == measure.lower()
    same = jr.read_hazard(path, unit={"PGA": "g", "PGV": "cm/s"}[measure])
    np.testing.assert_array_equal(same.levels, hazard.levels)
    other = "pgv" if measure == "PGA" else "pga"
    assert refuses(f", line 2: a hazard of {other} was expected, got", path, measure=other)
    has = {"PGA": "PGA in g", "PGV": "PGV in cm/s"}[measure]
    message = f", line 2: unit is 'm/s2', but OpenQuake has {has} by its convention"
    assert refuses(message, path, unit="m/s2")


def test_one_of_several_sites(tmp_path):
    path = tmp_path / "hazard_curve-mean-PGA_1.csv"
    path.write_text(openquake(places=[(-122.4, 37.75, POES), (-122.1, 37.75, ELSEWHERE)]))
    assert refuses(": site must be given, the longitude and latitude of one, got 2", path)
    assert refuses(r": one of them with .* \(1, 2\) was expected, got 2", path, site=(1, 2))
    found = jr.read_hazard(path, site=(-122.10001, 37.75))
    np.testing.assert_allclose(found.rates[-1], -np.log(0.999) / 50, rtol=1e-12)
    assert len(found.levels) == 5


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("'PGA'", "'SA(0.3)'", ", line 2: a hazard of pga or pgv .* got one of 'SA\\(0.3\\)'"),
        ("imt=", "im=", ", line 2: one imt was expected in a comment above"),
        ("=50.0", "=5 0.0", ", line 2: investigation_time must be .* got '5 0.0'"),
        ("=50.0", "=0", ", line 2: investigation_time must be greater than 0"),
        ("investigation_time=50.0, ", "", ", line 2: one investigation_time was expected"),
        ("8.123456E-01", "none", ", line 3: column 'poe-0.0137000' must be a number"),
        ("8.123456E-01", "1.123456E+00", ", line 3: a probability must be from 0 to 1"),
        ("8.123456E-01", "0.000000E+00", ", line 3: rates must not rise"),
        ("-122.40000", "-522.4", ", line 3: one longitude and one latitude"),
        (",0.00000,", ",", ", line 3: 8 fields were expected, as many as names, got 7"),
        ("0.0137000", "0.0030000", ", line 3: levels must increase"),
    ],
)
def test_openquake_that_is_refused(tmp_path, old, new, message):
    path = tmp_path / "hazard_curve-mean-PGA_1.csv"
    path.write_text(openquake().replace(old, new, 1))
    # What is said of the comment stands with the names below it.
    message = message.replace(", line 2: one", "(, line 2)?: one").replace(
        ", line 2: inv", "(, line 2)?: inv"
    )
    message = message.replace(", line 2: a hazard", "(, line 2)?: a hazard")
    assert refuses(message, path)


NSHMP = (
    "name,lon,lat,0.005,0.0137,0.103,0.556,1.52\n"
    "Test Site,-122.40000,37.75000,2.85280770e-03,2.85280770e-03,1.5e-03,1.00000000e-04,0.0\n"
)
YEARLY = np.array([2.8528077e-3, 2.8528077e-3, 1.5e-3, 1e-4, 0.0])


def test_usgs(tmp_path):
    """The folder names the measure, or the caller does, and then the unit as well."""
    (tmp_path / "PGA").mkdir()
    named = tmp_path / "PGA" / "curves.csv"
    silent = tmp_path / "total.csv"
    for path, options in ((named, {}), (silent, {"measure": "pga", "unit": "g"})):
        path.write_text(NSHMP)
        hazard = jr.read_hazard(path, **options)
        np.testing.assert_allclose(hazard.levels, G * LEVELS, rtol=1e-12)
        np.testing.assert_allclose(hazard.rates, YEARLY, rtol=1e-12)
    assert refuses(", line 1: a hazard of pgv was expected", named, measure="pgv")
    assert refuses(": neither the table nor its folder names the measure", silent, unit="g")
    assert refuses(", line 1: the head states no unit", silent, measure="pgv")
    assert refuses(", line 1: 'g' is not .* unit of pgv", silent, measure="pgv", unit="g")
    spectral = tmp_path / "SA0P2.csv"
    spectral.write_text(NSHMP)
    assert refuses(": a hazard of pga .* sa0p2", spectral, measure="pga", unit="g")


@pytest.mark.parametrize(
    ("word", "others", "cut"),
    [
        ("0.12", ["0.123", "0.456"], True),
        ("0.12", ["0.1", "0.456"], False),
        ("1.00E-0", ["1.00E-01", "2.00E-01"], True),
        ("1.00", ["1.00E-01", "2.00E-01"], True),
        ("0.0", ["1.00e-01", "2.00e-01", "0.0"], False),
        ("0.0", ["0.12", "0.05"], True),
        ("9e-1", ["0.5", "0.75"], False),
        ("5", [], False),
        ("x", ["0.5"], False),
    ],
)
def test_numbers_that_were_cut(word, others, cut):
    assert _is_cut(word, others) == cut
