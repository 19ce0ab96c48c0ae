"""Files that are cut, shifted, exchanged or encoded otherwise are read right, or refused.

The samples of a network's file, which states their number, must all be right, in any order. A
table has to be read as the csv module reads what its text now says.
"""

import csv
import re
from functools import partial

import numpy as np
import pytest
from networks import NETWORKS, STEP, G
from test_hazard_files import OPENQUAKE

import jaxrock as jr
from jaxrock.calibration import read_impact_times, read_tests
from jaxrock.risk import read_inventory

pytestmark = [
    pytest.mark.float64,
    pytest.mark.filterwarnings("ignore:.*(PGA of|still moves|sizes are|divide by zero)"),
]
# Units in SI, with rates per year.
FACTORS = {"m": 1, "cm": 0.01, "mm": 0.001, "s": 1, "ms": 0.001, "min": 60, "yr": 1, "1/yr": 1}
FACTORS |= {"m/s2": 1, "cm/s2": 0.01, "gal": 0.01, "g": G, "mg": G / 1000, "m/s": 1}
FACTORS |= {"rad": 1, "mrad": 0.001, "deg": np.pi / 180, "%": 0.01, "-": 1, "": 1}


def cut(content, random):
    return content[: random.integers(len(content))]


def damage_lines(content, random):
    """A line is lost, is there twice, or changes places with another one."""
    lines = content.splitlines(keepends=True)
    one, other = random.choice(len(lines), 2, replace=False)
    lines[one], lines[other] = lines[other], lines[one]
    lines[one : one + 1] *= random.integers(3)
    return "".join(lines)


def shift(content, random):
    """Letters or a blank too many, or a blank that is lost."""
    at = int(random.integers(len(content)))
    new = ["", " ", "Düzce", "x", "\0", "_", ";"][random.integers(7)]
    end = content[at:] if new else content[at:].replace(" ", "", 1)
    return content[:at] + new + end


def exchange_columns(content, random):
    """Two fields of every line that has both change places, names of columns as well."""
    sign = ";" if ";" in content else ","
    fields = [line.split(sign) for line in content.splitlines()]
    one, other = random.integers(max(map(len, fields)), size=2)
    for line in fields:
        if max(one, other) < len(line):
            line[one], line[other] = line[other], line[one]
    return "\n".join(map(sign.join, fields)) + "\n"


def write_otherwise(content, random):
    """With other separators, decimal signs and ends of lines."""
    content = content.replace(",", random.choice([",", ";", "\t", "|", " ", ", "]))
    content = re.sub(r"\.(?=\d)", random.choice([".", ","]), content)
    return content.replace("\n", random.choice(["\n", "\r\n", "\r", "\n\n", " \n"]))


def exchange_a_unit(content, random):
    units = re.findall(r"\[.*?\]", content) or [""]
    return content.replace(random.choice(units), f"[{random.choice([*FACTORS])}]", 1)


def change_a_character(content, random):
    at = int(random.integers(len(content)))
    return content[:at] + str(random.choice(["", *'0157.,;-e"#[gm'])) + content[at + 1 :]


MUTATIONS = [cut, damage_lines, shift, exchange_columns, write_otherwise, exchange_a_unit]
MUTATIONS += [change_a_character]
# A name and perhaps a unit; with brackets that are damaged it is another name.
HEAD = re.compile(r"(.*?) ?(?:[\[(]([^\[\]()]*)[\])])?")


class Plain:
    """A table as the csv module reads it, below the first line with all names needed."""

    def __init__(self, text, *needed):
        lines = [line for line in re.split("\r\n?|\n", text) if re.match(r"\s*[^\s#]", line)]
        self.heads = []
        while not {*needed} <= {*self.heads}:
            self.sign = next((sign for sign in ";\t" if sign in lines[0]), ",")
            rows = csv.reader(lines, delimiter=self.sign, skipinitialspace=True)
            heads, *self.rows = ([cell.strip() for cell in row] for row in rows)
            plain = [" ".join(head.replace("_", " ").split()).lower() for head in heads]
            matches = [HEAD.fullmatch(head) for head in plain]
            self.heads = [match[1] for match in matches]
            self.units = [(match[2] or "").replace(" ", "") for match in matches]
            del lines[0]
        self.rows = [row for row in self.rows if any(row)]

    def words(self, name):
        return [row[self.heads.index(name)] if name in self.heads else "" for row in self.rows]

    def numbers(self, name, default=np.nan):
        sign = "." if self.sign == "," else ","
        words = [word.replace(sign, ".") for word in self.words(name)]
        unit = self.units[self.heads.index(name)] if name in self.heads else ""
        return np.array([FACTORS[unit] * float(word) if word else default for word in words])


def compare_samples(record, text):
    table = Plain(text, "time")
    yield record.acceleration, table.numbers("north")
    yield record.vertical, table.numbers("up")
    yield record.time_step, np.diff(table.numbers("time")).mean()


def compare_levels(hazard, text):
    table = Plain(text, "pga")
    levels, rates = table.numbers("pga"), table.numbers("rate")
    if "return period" in table.heads:
        rates = 1 / table.numbers("return period")
    for name in table.heads:
        if name.startswith("probability in"):
            rates = -np.log1p(-table.numbers(name)) / float(name.split()[2])
    order = [k for k in np.argsort(levels) if 0 < rates[k] < np.inf]
    yield [hazard.levels, hazard.rates], [levels[order], rates[order]]


def compare_sites(hazard, text):
    table = Plain(text, "lon", "lat")
    names = [name for name in table.heads if re.search(r"\d", name)]
    levels = np.array([G * float(name.removeprefix("poe-")) for name in names])
    rates = np.concatenate([table.numbers(name) for name in names])
    if years := re.search(r"investigation_time=([\d.]+)", text):
        rates = -np.log1p(-rates) / float(years[1])
    known = (rates > 0) & (rates < np.inf)
    yield [hazard.levels, hazard.rates], [levels[known], rates[known]]


def compare_objects(found, text):
    table = Plain(text, "name", "width", "height")
    width = np.fmin(table.numbers("width"), table.numbers("depth"))
    yield 2 * found.block.half_width, width
    yield found.block.slenderness, table.numbers("height") / width
    yield found.block.inertia_ratio, table.numbers("inertia ratio", 4 / 3)
    is_assumed = np.array(found.restitution_assumed)
    yield np.where(is_assumed, np.nan, found.restitution), abs(table.numbers("c"))
    yield found.floor_period, table.numbers("floor period", 0.0)
    yield found.one_sided, [word in ("yes", "x", "1") for word in table.words("one-sided")]


def compare_tests(tests, text):
    table = Plain(text, "file", "overturned")
    overturned = [word in ("yes", "x", "1") for word in table.words("overturned")]
    words = (table.words(name) for name in ("column", "unit"))
    rows = zip(tests.suite, table.numbers("scale", 1), *words, strict=True)
    for record, scale, column, unit in rows:
        samples = FACTORS[unit or "g"] * SAMPLES[int("y" in column)]
        yield record.scale * record.acceleration, scale * samples
    yield [record.time_step for record in tests.suite], table.numbers("time step", 0.01)
    yield tests.overturned, overturned


def compare_times(found, text):
    table = Plain(text, "time")
    yield found[0], table.numbers("time")
    yield np.nan if found[1] is None else found[1], table.numbers("peak rotation")[:-1]


def compare_network(suite, components):
    known = np.concatenate([*components.values()])
    # Below the accelerations there may be velocities, a tenth as large, and in headers zeros.
    known = np.concatenate([known, known / 10, 0 * known])
    for record in suite:
        rows = [x for x in (record.acceleration, record.vertical) if x is not None]
        near = np.isclose(np.ravel(rows)[:, None], known, rtol=1e-9, atol=1e-12)
        yield near.any(axis=1), True
        yield record.samples, known.size / len(components) / 3
        yield round(float(record.time_step), 5), STEP


SAMPLES = np.random.default_rng(2).normal(size=(3, 40)).round(6)
ROWS = "".join(f"{0.01 * k:.2f},{x},{y},{z}\n" for k, (x, y, z) in enumerate(SAMPLES.T))
HEADS = "# a station, 1999\nof 2 sensors\n\ntime [s],north [m/s2],no,up [cm/s2]\n"
RATES = "A site\nPGA [g],sd,rate [1/yr]\n0.05,1,1e-2\n0.1,2,0.0025\n0.5,2,4e-4\n1.25,3,0\n"
PERIODS = "return period [yr],pga [cm/s2]\n2475,291.3\n475,164.5\n101,95.25\n30,47.5\n"
CHANCES = "pga [mg],n,Probability in 50 years [%]\n20,4,100\n50,4,60.5\n150,4,10\n400,4,2\n"
OBJECTS = """A museum
Name,width [cm],height [m],depth [mm],inertia ratio,C,one-sided,floor period [ms],kg
vase,20.5,0.8,,,0.8,no,,1.2
bust,30,1.2,,1.4,,,250,
facade,60.5,4.8,,,-0.6,yes,,
case,60,1.8,450.5,,0.9,,0,x
"""
TESTS = """file,unit,time step [ms],column,scale,overturned,group,peak rotation [deg],name
m.csv,g,10,x [g],1.5,no,A,4.5,first
m.csv,,,y [g],,yes,A,,
n.csv,gal,20.5,acc x,-0.5,0,B,,c
m.csv,,10,y [g],2,no,B,9.25,
"""
TIMES = "# a\nimpact,time [s],peak rotation [deg]\n1,.5,10.5\n2,0.9,\n3,1.25,-5.25\n4,1.5,\n"
# Tables, how they are read, and what is compared.
TABLES = {
    "samples": (HEADS + ROWS, partial(jr.read_record, vertical="up"), compare_samples),
    "rates": (RATES, jr.risk.read_hazard, compare_levels),
    "periods": (PERIODS, jr.risk.read_hazard, compare_levels),
    "chances": (CHANCES, jr.risk.read_hazard, compare_levels),
    "objects": (OBJECTS, read_inventory, compare_objects),
    "tests": (TESTS, read_tests, compare_tests),
    "times": (TIMES, read_impact_times, compare_times),
}
# As spreadsheets write them in other countries.
TABLES |= {
    f"{name}; semicolons": (re.sub(r"\.(?=\d)", ",", content.replace(",", ";")), *others)
    for name, (content, *others) in TABLES.items()
}
for sign in ",;":
    TABLES[f"OpenQuake{sign}"] = (
        OPENQUAKE.replace(",", sign),
        jr.risk.read_hazard,
        compare_sites,
    )
KINDS = {name: ("a.csv", *table) for name, table in TABLES.items()}
for name, sample in NETWORKS.items():
    read = partial(jr.read_suite, vertical=bool(sample.vertical))
    KINDS[name] = (*sample[:2], read, compare_network, sample.components)


def is_right(found, compare, *right):
    """Return whether all numbers are right."""
    try:
        pairs = compare(found, *right)
        return all(np.allclose(*pair, rtol=1e-9, atol=1e-12, equal_nan=True) for pair in pairs)
    # The csv module finds no such table.
    except (IndexError, KeyError, ValueError):
        return False


@pytest.mark.parametrize("number", [14, pytest.param(200, marks=pytest.mark.thorough)])
@pytest.mark.parametrize("kind", KINDS)
def test_mutations(write, kind, number):
    # Motions of tests.
    write(f"time [s],x [g],y [g],z [g]\n{ROWS}", "m.csv")
    write(f"time,acc x,acc y,acc z\n{ROWS}", "n.csv")
    name, content, read, compare, *right = KINDS[kind]
    random = np.random.default_rng(0)
    counts = {"read": 0, "refused": 0}
    faults = []
    for k in range(number):
        # In a network's file another digit is not noticed.
        mutation = MUTATIONS[k % (len(MUTATIONS) - len(right))]
        text = mutation(content, random)
        path = write(text, name, ["utf-8", "utf-16"][k % 7 == 0])
        try:
            found = read(path)
        except ValueError as error:
            counts["refused"] += 1
            if not all(name in line for line in str(error).split("\n")):
                faults.append((mutation.__name__, str(error)))
            continue
        counts["read"] += 1
        if not is_right(found, compare, *(right or [text])):
            faults.append((mutation.__name__, text[:300], found))
    assert not faults, (len(faults), faults[:3])
    assert min(counts.values()) > number / 20, counts
