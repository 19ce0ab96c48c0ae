"""Files that are cut, shifted, exchanged or encoded otherwise are read right, or refused.

What no reader can notice is right here: a digit that is another one is not tried, lines and columns
may have changed places, and a table, which states no number of rows, may end within a number.
"""

import re

import numpy as np
import pytest
from networks import NETWORKS

import jaxrock as jr

pytestmark = [
    pytest.mark.float64,
    pytest.mark.filterwarnings("ignore:.*(PGA of|the ground still moves)"),
]


def cut(content, random):
    return content[: random.integers(len(content))]


def lose_a_line(content, random):
    lines = content.splitlines(keepends=True)
    del lines[random.integers(len(lines))]
    return "".join(lines)


def repeat_a_line(content, random):
    lines = content.splitlines(keepends=True)
    at = random.integers(len(lines))
    return "".join([*lines[:at], lines[at], *lines[at:]])


def exchange_lines(content, random):
    lines = content.splitlines(keepends=True)
    one, other = random.choice(len(lines), 2, replace=False)
    lines[one], lines[other] = lines[other], lines[one]
    return "".join(lines)


def shift(content, random):
    """A blank too many, or one that is lost."""
    at = int(random.integers(len(content)))
    blanks = [match.start() for match in re.finditer(" ", content)]
    if random.integers(2) and blanks:
        at = blanks[random.integers(len(blanks))]
        return content[:at] + content[at + 1 :]
    return content[:at] + " " + content[at:]


def insert_letters(content, random):
    at = int(random.integers(len(content)))
    return content[:at] + ["Düzce", "x", "\x00", "_", ";"][random.integers(5)] + content[at:]


def exchange_columns(content, random):
    """Two fields of every line that has both change places, names of columns as well."""
    fields = [line.split(",") for line in content.splitlines()]
    width = max(map(len, fields))
    one, other = random.integers(width, size=2)
    for line in fields:
        if max(one, other) < len(line):
            line[one], line[other] = line[other], line[one]
    return "\n".join(map(",".join, fields)) + "\n"


def separate_otherwise(content, random):
    return content.replace(",", [";", "\t", "|", " ", ", "][random.integers(5)])


def write_decimal_commas(content, random):
    separator = [";", "\t", ","][random.integers(3)]
    return re.sub(r"\.(?=\d)", ",", content.replace(",", separator))


def end_lines_otherwise(content, random):
    return content.replace("\n", ["\r\n", "\r", "\n\n", " \n"][random.integers(4)])


MUTATIONS = [
    cut,
    lose_a_line,
    repeat_a_line,
    exchange_lines,
    shift,
    insert_letters,
    exchange_columns,
    separate_otherwise,
    write_decimal_commas,
    end_lines_otherwise,
]
SAMPLES = np.random.default_rng(2).normal(size=(3, 40)).round(6)
ROWS = "".join(
    f"{0.01 * k:.2f}," + ",".join(f"{x:.6f}" for x in row) + "\n"
    for k, row in enumerate(SAMPLES.T)
)
KINDS = {
    name: (sample.name, sample.content, sample.components, 0.005)
    for name, sample in NETWORKS.items()
}
KINDS |= {
    name: ("a.csv", f"{head}\n{ROWS}", dict(zip(columns, SAMPLES, strict=True)), 0.01)
    for name, head, columns in (
        (
            "table",
            "time [s],acc x [m/s2],acc y [m/s2],acc z [m/s2]",
            ("acc x [m/s2]", "acc y [m/s2]", "acc z [m/s2]"),
        ),
        (
            "titles",
            "# a station, 1999\nof 2 sensors\n\ntime [s],north [m/s2],east [m/s2],up [m/s2]",
            ("north [m/s2]", "east [m/s2]", "up [m/s2]"),
        ),
    )
}


def is_right(record, components, step, is_table):
    """Return whether all samples are some of the right ones, and all of them but in tables."""
    values = np.asarray(record.acceleration)
    known = np.concatenate([*components.values()])
    # Below the accelerations there may be velocities, a tenth as large, and in headers zeros.
    known = np.concatenate([known, known / 10, 0 * known])
    whole = values[:-1] if is_table else values
    near = np.isclose(whole[:, None], known, rtol=1e-9, atol=1e-12).any(axis=1).all()
    is_whole = is_table or values.size == known.size / len(components) / 3
    return near and is_whole and abs(float(record.time_step) / step - 1) < 1e-3


@pytest.mark.parametrize("number", [30, pytest.param(200, marks=pytest.mark.thorough)])
@pytest.mark.parametrize("kind", KINDS)
def test_mutations(tmp_path, kind, number):
    name, content, components, step = KINDS[kind]
    is_table = name == "a.csv"
    random = np.random.default_rng(0)
    faults = []
    counts = {"read": 0, "refused": 0}
    for k in range(number):
        mutation = MUTATIONS[k % len(MUTATIONS)]
        mutated = mutation(content, random)
        (tmp_path / name).write_bytes(mutated.encode(["utf-8", "utf-16"][k % 7 == 0]))
        column = [*components][k % len(components)] or None
        try:
            record = jr.read_record(tmp_path / name, column=column)
        except ValueError as error:
            counts["refused"] += 1
            if name not in str(error) or "\n" in str(error):
                faults.append((mutation.__name__, str(error)))
            continue
        counts["read"] += 1
        if not is_right(record, components, step, is_table):
            faults.append((mutation.__name__, mutated[:300], record))
    assert not faults, (len(faults), faults[:3])
    assert min(counts.values()) > number / 20, counts
