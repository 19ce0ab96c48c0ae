"""An inventory: read, ranked, drawn, as a page; against closed forms of half-sine pulses."""

import json
import re

import matplotlib.pyplot as plt
import numpy as np
import pytest
import scenes
import xarray
from references.half_sine_rates import OFTEN, POWER, closed_rate, pulses
from scipy import optimize
from tools.command import run

import jaxrock as jr
from jaxrock.impact import compute_low_restitution, compute_restitution_by_size
from jaxrock.plot import plot_inventory
from jaxrock.risk import (
    Inventory,
    assess_inventory,
    describe_years,
    list_remarks,
    read_inventory,
    write_inventory_page,
)

pytestmark = pytest.mark.float64

# As a spreadsheet saves it, with columns of its own.
TABLE = """A museum;;;;;;;;
name;width [cm];height [m];depth [mm];inertia ratio;C;restitution cov [%];weight [kg];inv. no.
"Vase; red";20;0,8;;;0,8;5;1,2;1987.24
bust;30;1,2;;1,4;;;;
;;;;;;;;
case;60;1,8;450;;0,9;;;A 3
"""


def write(folder, text, name="objects.csv"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_a_table_is_read(tmp_path):
    inventory = read_inventory(write(tmp_path, TABLE), samples=4, seed=1)
    block = inventory.block
    assert inventory.names == ("Vase; red", "bust", "case")
    np.testing.assert_allclose(2 * block.half_width, [0.2, 0.3, 0.45], rtol=1e-14)
    np.testing.assert_allclose(block.slenderness, [4.0, 4.0, 4.0], rtol=1e-14)
    np.testing.assert_allclose(block.inertia_ratio, [4 / 3, 1.4, 4 / 3], rtol=1e-14)
    # Housner: 1 - (2 / kappa) / (1 + lambda^2).
    housner = 1 - 2 / 1.4 / 17
    np.testing.assert_allclose(inventory.restitution, [0.8, housner, 0.9], rtol=1e-14)
    assert inventory.uncertain == jr.Uncertain(
        {"restitution": [0.05, 0, 0]}, samples=4, seed=1
    )
    assert inventory.restitution_assumed.tolist() == [False, True, False]
    others = (("weight [kg]", ("1,2", "", "")), ("inv. no.", ("1987.24", "", "A 3")))
    assert inventory.others == others
    assert str(inventory) == "3 objects: Vase; red, bust, case"


PLACES = """name,width [cm],height [m],C,one-sided,floor period [ms],floor damping [%]
bust,30,1.2,,no,,
facade,60,6,,Yes,0,
mirror,20,2,-0.6,x,400,3
vase,20,0.8,0.8,,250,
"""


def test_objects_at_a_wall_and_on_floors_are_read(tmp_path):
    inventory = read_inventory(write(tmp_path, PLACES))
    assert inventory.one_sided.tolist() == [False, True, True, False]
    np.testing.assert_allclose(inventory.floor_period, [0, 0, 0.4, 0.25], rtol=1e-14)
    np.testing.assert_allclose(inventory.floor_damping, [0.05, 0.05, 0.03, 0.05], rtol=1e-14)
    # At a wall: (1 - (3/2) / 101)^2 (1 - (3/2) 100 / 101), of which the magnitude counts.
    wall = (1 - 1.5 / 101) ** 2 * (150 / 101 - 1)
    np.testing.assert_allclose(inventory.restitution, [1 - 1.5 / 17, wall, 0.6, 0.8])
    assert inventory.restitution_assumed.tolist() == [True, True, False, False]


HEAD = "name,width [m],height [m],restitution,restitution coefficient of variation"
PLACE = "name,width [m],height [m],C,one-sided,floor period [s],floor damping,depth [m]"
# Tables, and what the error must contain. How all tables are read is tested elsewhere.
REFUSED = [
    (f"{HEAD}\na,-1,2,,\nc,,2,,\n", ("line 2", "'-1'", "line 3", "''")),
    (f"{HEAD}\na,1,2,1.1,\n", ("line 2", "between -1 and 1", "'1.1'")),
    (f"{HEAD}\na,1,2,,-1\n", ("line 2", "at least 0", "'-1'")),
    (f"{HEAD}\na,1,2,,\na,1,2,,\n", ("names must differ", "'a'")),
    (f"{HEAD}\na,3,.3,,\n", ("line 2", "exchanged?", "must be given")),
    (f"{HEAD}\nb,1,2,-.5,\n", ("line 2", "restitution of at least 0")),
    (f"{HEAD}\na,1,2,1,0.1\n", ("restitution must not be 0.1", "mean of 1")),
    (f"{PLACE}\na,1,1.2,,yes,,,\n", ("line 2", "must be given")),
    (f"{PLACE}\na,.2,1,,,,.05,\n", ("line 2", "floor damping needs a floor period")),
    (f"{PLACE}\na,.2,1,,,.4,5,\n", ("line 2", "'floor damping'", "less than 1")),
    (f"{PLACE}\na,.2,1,,,250,,\n", ("line 2", "from 0 to 20, in s", "'250'")),
    (f"{PLACE}\na,1,3,,x,,,.5\n", ("line 2", "no depth", "right angles to the wall")),
]


@pytest.mark.parametrize(("text", "words"), REFUSED)
def test_tables_that_are_refused(tmp_path, text, words):
    with pytest.raises(ValueError, match=r"^'.*objects\.csv'") as error:
        read_inventory(write(tmp_path, text))
    assert all(word in str(error.value) for word in words), str(error.value)


# Half-widths and slendernesses of objects that half-sine pulses overturn without an impact.
NAMES = ("low", "slim", "wide", "small")
HALF_WIDTHS = np.array([0.25, 0.24, 0.4, 0.17])
SLENDERNESSES = np.array([3.6, 5.0, 4.0, 4.5])
BLOCK = jr.Block(HALF_WIDTHS, SLENDERNESSES)
ENDS = np.array([0.7, 8.0])
HAZARD = jr.risk.Hazard(ENDS, OFTEN * ENDS**-POWER)
TARGET = 1.2e-5


def rate_of_sides(width, height):
    return float(closed_rate("pgv", width / 2, height / width, 4 / 3))


@pytest.fixture(scope="module")
def assessed():
    """The objects under half-sine pulses, linearized, at levels 1 % apart."""
    inventory = Inventory(NAMES, BLOCK, 0.85)
    site = jr.risk.Site(pulses(100), HAZARD)
    return assess_inventory(inventory, site, TARGET, model="linearized")


def test_rates_in_closed_form(assessed):
    exact = np.array(
        [
            float(closed_rate("pgv", *shape, 4 / 3))
            for shape in zip(HALF_WIDTHS, SLENDERNESSES, strict=True)
        ]
    )
    order = np.argsort(exact)[::-1]
    assert assessed.object.values.tolist() == [NAMES[k] for k in order]
    assert assessed["rank"].values.tolist() == [1, 2, 3, 4]
    # A hundred straight lines are the half-sine pulse to 1e-4.
    np.testing.assert_allclose(assessed.rate, exact[order], rtol=5e-4)


def test_required_widths_in_closed_form(assessed):
    for k in range(4):
        block = assessed.isel(object=k)
        width = float(block.width)
        height = float(block.height)
        exact = optimize.brentq(
            lambda width, h=height: np.log(rate_of_sides(width, h) / TARGET),
            0.5 * width,
            3 * width,
        )
        required = float(block.required_width)
        # The first width examined beyond the crossing, 3 % apart, which meets the target.
        assert 1 - 1e-4 < required / exact < 1.03
        assert rate_of_sides(required, height) < TARGET * (1 + 5e-4)


NOISE_TARGET = 1.5e-4


@pytest.fixture(scope="module")
def noise_site():
    """Records of noise, under which blocks rock long before they overturn.

    Between neighbouring levels there is at most one boundary: of several, functions that search
    in different ways may locate different ones.
    """
    levels = np.geomspace(0.2, 2.0, 48)[18:]
    return jr.risk.Site(
        scenes.suite(), jr.risk.Hazard([0.2, 2.0], [1e-2, 1e-4]), levels=levels
    )


def assert_close(one, other):
    """Equal words, and numbers to 1e-12."""
    one = np.asarray(one)
    if one.dtype.kind == "U":
        np.testing.assert_array_equal(one, other)
    else:
        np.testing.assert_allclose(one, np.asarray(other), rtol=1e-12, atol=1e-15)


PLACE_COLUMNS = {"one_sided", "floor_period", "floor_damping"}


@pytest.mark.thorough
def test_a_mixed_inventory_is_that_of_its_groups(noise_site):
    """Each under its own motions, as in an inventory of such objects."""
    names = ("free", "wall on a floor", "floor", "free too")
    width = np.array([0.2, 0.4, 0.28, 0.32])
    height = np.array([1.0, 2.4, 1.1, 1.9])
    restitution = np.array([0.8, -0.5, 0.8, 0.9])
    period = np.array([0.0, 0.3, 0.3, 0.0])
    damping = np.array([0.05, 0.05, 0.1, 0.05])
    one_sided = np.array([False, True, False, False])
    coefficients = {"restitution": np.array([0, 0, 0, 0.1])}
    block = jr.Block.from_size(width=width, height=height)
    inventory = Inventory(
        names,
        block,
        restitution,
        jr.Uncertain(coefficients, samples=2),
        one_sided=one_sided.tolist(),
        floor_period=period,
        floor_damping=damping,
    )
    mixed = assess_inventory(inventory, noise_site, NOISE_TARGET)
    assert mixed.attrs["record_count"] == 3
    np.testing.assert_array_equal(mixed.rate, np.sort(mixed.rate)[::-1])
    np.testing.assert_array_equal(mixed["rank"], np.arange(1, 5))
    suite = noise_site.suite
    floors = [suite.on_floor(0.3, ratio, time_step=0.015) for ratio in (0.05, 0.1)]
    groups = {(0, 3): suite, (1,): floors[0].both_directions(), (2,): floors[1]}
    for members, motions in groups.items():
        k = list(members)
        sizes = {"width": width[k], "height": height[k]}
        alone = Inventory(
            [names[member] for member in members],
            jr.Block.from_size(**sizes),
            restitution[k],
            jr.Uncertain({"restitution": coefficients["restitution"][k]}, samples=2),
            one_sided=bool(one_sided[k[0]]),
        )
        site = jr.risk.Site(motions, noise_site.hazard, levels=noise_site.levels)
        expected = assess_inventory(alone, site, NOISE_TARGET)
        block = jr.Block.from_size(**sizes, one_sided=bool(one_sided[k[0]]))
        rate = jr.risk.overturning_rate(block, alone.restitution, site, alone.uncertain)
        for name in ("rate", "standard_error", "not_detected"):
            own = mixed[name].sel(object=list(alone.names))
            np.testing.assert_allclose(own, getattr(rate, name), rtol=5e-3)
        for name in alone.names:
            answer = mixed.sel(object=name)
            for variable in set(expected.data_vars) - PLACE_COLUMNS:
                assert_close(answer[variable], expected[variable].sel(object=name))
            assert bool(answer.one_sided) == one_sided[k[0]]
            assert float(answer.floor_period) == period[k[0]]
            assert np.isnan(answer.floor_damping) == (period[k[0]] == 0)


def test_page(assessed):
    """Whole in one file, with a row of each object in each table, and what to do first."""
    page = write_inventory_page(assessed, [b"picture", b""])
    assert page.count('src="data:image/png;base64,cGljdHVyZQ=="') == 1
    assert page.count("<img ") == 2
    assert not re.search(r"https?:|<script|<link|@import|url\(|<!--|nan<", page)
    row = r'<tr class="(\w+) .*?"><td>\d</td><td class="name">(\w+)<'
    kinds = ["misses" if rate > TARGET else "meets" for rate in assessed.rate]
    assert re.findall(row, page) == 3 * list(zip(kinds, assessed.object.values, strict=True))
    names = ", ".join(assessed.object.values.tolist())
    assert first_sentence(assessed) == f"Fix or widen first: {names}."
    meets = assessed.assign(verdict=("object", ["meets the target"] * 4))
    assert first_sentence(meets).startswith("Nothing needs to be done")
    strange = assessed.assign_coords(object=["<b>", "a & b $x", "{c}", "d"])
    page = write_inventory_page(strange, [])
    for text in ("<h1>Objects in", ">&lt;b&gt;<", ">a &amp; b $x<", ">{c}<"):
        assert text in page


def first_sentence(dataset):
    (sentence,) = re.findall(r'<p class="first">(.*?)</p>', write_inventory_page(dataset, []))
    return sentence


def test_a_hazard_that_ends_before_the_target_says_so(assessed):
    """Where its last rate exceeds the target, no object is called safe and no width enough."""
    site = jr.risk.Site(pulses(50), HAZARD, levels=np.geomspace(0.7, 1.6, 30))
    inventory = Inventory(NAMES, BLOCK, 0.85)
    dataset = assess_inventory(inventory, site, TARGET, model="linearized")
    last_rate = OFTEN * 1.6**-POWER
    assert last_rate > 5 * TARGET
    assert (dataset.verdict == "not known").all()
    assert np.isnan(dataset.required_width).all()
    assert (dataset.need == "not known").all()
    # The rate itself is not known below that of the last level.
    assert (dataset.rate < last_rate).any()
    ends = f"once in {1 / last_rate:,.0f} years"
    for k in np.flatnonzero(dataset.rate < last_rate):
        assert f"{describe_years(dataset.isel(object=k))} years" == f"less than {ends}"
    sentence = f"the hazard ends at {ends}; continue it to {2.5 / TARGET:,.0f} or ask for"
    for text in (first_sentence(dataset), list_remarks(dataset)[-1]):
        assert sentence in text
    # With the whole curve all is known.
    assert (assessed.verdict == "misses the target").all()
    chance = 1 - np.exp(-50 * assessed.rate)
    np.testing.assert_allclose(assessed.probability_in_50_years, chance, rtol=1e-10)


@pytest.fixture(scope="module")
def with_assumed():
    """The objects again, of which two have an assumed restitution, one against a wall."""
    housner = np.asarray(jr.housner_restitution(BLOCK))
    inventory = Inventory(
        NAMES,
        BLOCK,
        [0.85, housner[1], 0.85, housner[3]],
        restitution_assumed=[False, True, False, True],
    )
    hazard = jr.risk.Hazard([0.1, 2.0], [1e-1, 1e-4])
    site = jr.risk.Site(scenes.suite(), hazard, levels=np.geomspace(0.1, 2.0, 40))
    return site, assess_inventory(inventory, site, NOISE_TARGET)


@pytest.mark.thorough
def test_rates_at_both_ends_of_an_assumed_restitution(with_assumed):
    site, dataset = with_assumed
    for k, name in enumerate(NAMES):
        answer = dataset.sel(object=name)
        block = jr.Block(HALF_WIDTHS[k], SLENDERNESSES[k])
        assert bool(answer.restitution_assumed) == (k in (1, 3))
        if k not in (1, 3):
            assert np.isnan(answer.rate_at_low_restitution)
            assert " to " not in describe_years(answer)
            continue
        low = compute_low_restitution(block)
        high = compute_restitution_by_size(block)
        assert float(answer.low_restitution) == float(low)
        for coefficient, rate in ((low, "rate_at_low_restitution"), (high, "rate")):
            expected = float(jr.risk.overturning_rate(block, coefficient, site).rate)
            assert float(answer[rate]) == pytest.approx(expected, rel=1e-3)
    page = write_inventory_page(dataset, [])
    assert page.count("(assumed)</td>") == 2
    ax = plot_inventory(dataset)
    labels = [text.get_text() for legend in ax.figure.legends for text in legend.get_texts()]
    assert "with the low end of an assumed restitution" in labels
    plt.close(ax.figure)


def test_the_edge_of_the_search_is_a_bound(assessed):
    """A target that every width meets: what was examined is no need."""
    inventory = Inventory(NAMES, BLOCK, 0.85)
    site = jr.risk.Site(pulses(50), HAZARD, spacing=0.1)
    dataset = assess_inventory(inventory, site, 0.1, model="linearized")
    answer = dataset.isel(object=0)
    assert (dataset.verdict == "meets the target").all()
    edge = 0.5 * float(answer.width)
    assert float(answer.required_width) == pytest.approx(edge)
    assert str(answer.need.values) == "suffices"


def test_the_example_is_written_and_assessed(tmp_path, capsys, monkeypatch, assessed):
    """Its files are those that were assessed, and nothing is overwritten."""
    calls = []

    def take_known(*arguments, **_):
        calls.append(arguments)
        return assessed.isel(object=np.arange(31) % 4)

    monkeypatch.setattr("jaxrock.risk.assess_inventory", take_known)
    command = ("inventory", "example", "--out", tmp_path)
    assert run(capsys, *command)[0] == 0
    inventory, site, target = calls[0]
    assert target == 1 / 2475
    assert read_inventory(tmp_path / "objects.csv").names == inventory.names
    written = jr.risk.read_hazard(tmp_path / "hazard.csv")
    np.testing.assert_array_equal(written.rates, site.hazard.rates)
    assert "<img " in (tmp_path / "inventory.html").read_text(encoding="utf-8")
    code, _, err = run(capsys, *command)
    assert (code, "exists; --force overwrites it" in err) == (2, True)


RECORDS = (("a", 0.2), ("b", 0.3))


@pytest.fixture
def site(tmp_path):
    """A table, two records and a hazard, as options of the command."""
    records = tmp_path / "records"
    records.mkdir()
    for name, amplitude in RECORDS:
        samples = amplitude * np.sin(np.linspace(0, 2 * np.pi, 150))
        text = "".join(f"{0.004 * k:.3f},{value:.6f}\n" for k, value in enumerate(samples))
        write(records, f"time [s],acc [g]\n{text}", f"{name}.csv")
    hazard = write(tmp_path, "PGV [m/s],rate [1/yr]\n0.2,1e-2\n2,1e-4\n", "hazard.csv")
    table = write(tmp_path, TABLE)
    return (table, "--records", records, "--hazard", hazard, "--target-return-period", 1000)


@pytest.mark.thorough
def test_command(tmp_path, capsys, site):
    out = tmp_path / "out"
    code, text, _ = run(capsys, "inventory", *site, "--out", out, "--json")
    assert code == 0
    expected = assess_inventory(
        read_inventory(site[0]),
        jr.risk.Site(jr.read_suite(site[2]), jr.risk.read_hazard(site[4]), spacing=0.04),
        1e-3,
    )
    answer = json.loads(text)
    assert [each["name"] for each in answer["objects"]] == expected.object.values.tolist()
    assert [each["rate"] for each in answer["objects"]] == expected.rate.values.tolist()
    with xarray.open_dataset(out / "inventory.nc") as dataset:
        for name, variable in expected.data_vars.items():
            np.testing.assert_array_equal(dataset[name], variable)
    lines = (out / "inventory.csv").read_text(encoding="utf-8").splitlines()
    table = [line for line in lines if not line.startswith("#")]
    assert table[0].startswith("rank,name,one_sided,floor_period [s],")
    assert "note: weight [kg],note: inv. no." in table[0]
    assert len(table) == 4
    page = (out / "inventory.html").read_text(encoding="utf-8")
    assert all(name in page for name in ("Vase; red", "bust", "case"))
