"""The conformance table as files: ``python tests/tools/conformance.py FOLDER`` writes it.

The table itself is ``jaxrock/data/conformance.json``, which the page ``docs/conformance.md`` is
about. Here it becomes files for programs that read no Python: ``cases.json``, the same with the
version of jaxrock and each case with all fields; ``cases.csv``, the same cases, one a line, empty
where the JSON has null; and the ground motions, ``time [s],acceleration [m/s2]`` and, where
there is one, ``acceleration up [m/s2]``. ``tests/references/conformance_with_scipy.py`` computes
the cases from these files alone.
"""

import csv
import json
import sys
from collections.abc import Iterable, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

import jaxrock as jr
from jaxrock import Record, example_record

RECORDS = (
    "ridgecrest_north.csv",
    "ridgecrest_east_and_up.csv",
    "piece.csv",
    "sampled_pulse.csv",
)
FILES = ("cases.csv", "cases.json", *RECORDS)


def read_table() -> dict[str, Any]:
    """Read the content of ``cases.json``, each case with all fields."""
    resource = files("jaxrock") / "data" / "conformance.json"
    stored = json.loads(resource.read_text(encoding="utf-8"))
    # Stored without what a case has not, which makes changes readable; programs get all
    # fields.
    cases = [
        {field: case.get(field) for field in stored["fields"]} for case in stored["cases"]
    ]
    return {"version": jr.__version__} | stored | {"cases": cases}


def make_records() -> dict[str, Record]:
    """Make the ground motions that are written as files, by the names of the files."""
    north = example_record("north")
    east = example_record("east", vertical=True)
    time = np.arange(201) * 0.01
    decaying = 6.0 * np.exp(-1.5 * time) * np.sin(2 * np.pi * time / 0.8)
    piece = np.asarray(north.acceleration)[1200:1401]
    motions = (north, east, Record(piece, 0.01), Record(decaying, 0.01))
    return dict(zip(RECORDS, motions, strict=True))


def write(folder: Path) -> int:
    """Write `FILES` into a folder, which is made if need be; return the number of cases."""
    folder.mkdir(parents=True, exist_ok=True)
    content = read_table()
    # NaN is no JSON: a stored value that is not finite is a mistake, and not written.
    text = json.dumps(content, indent=1, allow_nan=False)
    (folder / "cases.json").write_text(text + "\n", encoding="utf-8")
    rows = (case.values() for case in content["cases"])
    _write_csv(folder / "cases.csv", list(content["fields"]), rows)
    for name, motion in make_records().items():
        columns = {
            "time [s]": np.arange(motion.samples) * float(motion.time_step),
            "acceleration [m/s2]": np.asarray(motion.acceleration),
        }
        if motion.vertical is not None:
            columns["acceleration up [m/s2]"] = np.asarray(motion.vertical)
        rows = zip(*(column.tolist() for column in columns.values()), strict=True)
        _write_csv(folder / name, list(columns), rows)
    return len(content["cases"])


def _write_csv(path: Path, header: Sequence[str], rows: Iterable[Iterable[object]]) -> None:
    """Write a table whose lines end with LF on every system, so that files can be compared."""
    with open(path, "w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([header, *rows])


if __name__ == "__main__":
    print(write(Path(sys.argv[1])), "cases")
