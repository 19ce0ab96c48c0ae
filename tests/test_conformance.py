"""The conformance table: well formed, right, and checked by a program that would notice."""

import csv
import json
import math
import re
import subprocess
import sys
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from tables import conformance_cases
from tools import conformance

import jaxrock as jr

pytestmark = pytest.mark.float64
SCRIPT = Path(__file__).parent / "references" / "conformance_with_scipy.py"
PAGE = (SCRIPT.parents[2] / "docs" / "conformance.md").read_text(encoding="utf-8")
# Numbers that are computed again, by a program that was compiled in another way: some thousand
# operations, each rounded by up to 1.1e-16.
ROUNDING = 1e-12
QUICK = (
    "_geometry",
    "_free_rocking",
    "_half_cycles",
    "_published_tables",
    "_closed_derivatives",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("table")
    assert conformance.write(path) == len(cases_in(path))
    return path


def whole(folder):
    return json.loads((folder / "cases.json").read_text(encoding="utf-8"))


def cases_in(folder):
    return whole(folder)["cases"]


def tolerance(case):
    return case["absolute"] + case["relative"] * abs(case["value"])


def checked(folder, *arguments):
    command = [sys.executable, str(SCRIPT), str(folder), *arguments]
    return subprocess.run(
        command, capture_output=True, text=True, encoding="utf-8", check=False
    )


def test_well_formed(folder):
    assert sorted(path.name for path in folder.iterdir()) == sorted(conformance.FILES)
    table = whole(folder)
    cases = cases_in(folder)
    assert table["version"] == jr.__version__
    ids = [case["id"] for case in cases]
    assert len(set(ids)) == len(ids)
    kinds = {case["kind"] for case in cases}
    quantities = {case["quantity"] for case in cases}
    inputs = {case["input"] for case in cases}
    named = {case["file"] for case in cases} - {None}
    assert quantities <= set(table["quantities"])
    assert inputs <= set(table["inputs"])
    assert named <= set(conformance.RECORDS)
    for case in cases:
        check(case, table["fields"])
    assert kinds == {
        "geometry",
        "free rocking",
        "threshold",
        "survival window",
        "half-cycle map",
        "pulse",
        "record",
        "derivative",
    }
    assert {case["from"] for case in cases} == {"closed form", "converged", "published"}
    assert quantities == set(table["quantities"])
    assert inputs == set(table["inputs"])
    assert named == set(conformance.RECORDS)


def test_the_header_explains_the_cases():
    """In the file of the package, which is read without any program of jaxrock."""
    resource = files("jaxrock") / "data" / "conformance.json"
    table = json.loads(resource.read_text(encoding="utf-8"))
    header = ("conventions", "equations", "inputs", "quantities", "files", "fields")
    assert tuple(table) == (*header, "cases")
    assert tuple(conformance.read_table()) == ("version", *header, "cases")
    assert all(f"`{key}`" in PAGE for key in ("version", *table))
    assert set().union(*table["cases"]) == set(table["fields"])
    for name in header:
        for key, explanation in table[name].items():
            assert not re.match(r"(read|write|make|compute|get)_", key), key
            # A sentence of its own: "of the value" goes on from a word that stands elsewhere.
            assert not re.match(r"(of|to|with)\b", explanation), key
            assert len(explanation) > 3, key
    assert tuple(table["files"]) == conformance.RECORDS


def check(case, fields):
    assert list(case) == list(fields), case["id"]
    assert math.isfinite(case["value"]), case["id"]
    assert case["value"] != 0 or case["quantity"] == "overturned", case["id"]
    assert (case["from"] == "converged") <= (case["difference"] is not None), case["id"]
    if case["difference"] is not None:
        assert case["difference"] <= 0.1 * tolerance(case), case["id"]
    if case["low"] is not None and case["variable"] is None:
        assert case["low"] < case["value"] < case["high"], case["id"]
    assert case["variable"] is None or case[case["variable"]] is not None, case["id"]


def test_csv_agrees_with_json(folder):
    with open(folder / "cases.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    for row, case in zip(rows, cases_in(folder), strict=True):
        for field, value in case.items():
            given = row[field]
            if isinstance(value, float | int):
                assert float(given) == value, (case["id"], field)
            else:
                assert given == (value or ""), (case["id"], field)


def test_the_page_reads_the_table(capsys):
    exec(re.search(r"```python\n(.*?)```", PAGE, re.DOTALL)[1], {})
    printed = capsys.readouterr().out
    cases = conformance.read_table()["cases"]
    assert printed.startswith(f"{len(cases)} cases\nid ")
    assert f"{len(cases)} cases" in PAGE.splitlines()[2]


@pytest.mark.parametrize("name", conformance.RECORDS)
def test_files_are_the_motions(folder, name):
    motion = conformance.make_records()[name]
    vertical = None if motion.vertical is None else "up"
    read = jr.read_record(folder / name, vertical=vertical)
    np.testing.assert_array_equal(read.acceleration, motion.acceleration)
    assert float(read.time_step) == pytest.approx(0.01, rel=1e-12)
    if vertical:
        np.testing.assert_array_equal(read.vertical, motion.vertical)


def test_published_cases(folder):
    """What is computed here is within the tolerance of what is printed."""
    cases = {case["id"]: case for case in cases_in(folder)}
    published = [case for case in cases.values() if case["from"] == "published"]
    assert len(published) == 5
    model = jr.Linearized()
    for case in published:
        block = jr.Block(case["half_width"], case["slenderness"])
        if case["quantity"] == "critical_amplitude":
            sibling = {"half-sine-published": "half-sine-linearized"}.get(
                case["id"], "sine-housner"
            )
            own = cases[sibling]["value"]
        elif case["quantity"] == "amplification":
            scene = jr.Scene(block, case["restitution"], case["intensity"])
            own = jr.amplification(scene, model)
        else:
            name = case["quantity"].replace("half_cycle_peak", "peak")
            own = getattr(model, name)(block, block.pulse_velocity(case["intensity"]))
        assert float(own) == pytest.approx(case["value"], rel=0, abs=tolerance(case)), case[
            "id"
        ]
    for name in ("double-impulse", "double-impulse-housner"):
        case = cases[name]
        angle = math.atan(1 / case["slenderness"])
        radius = case["half_width"] * math.hypot(1, case["slenderness"])
        root = math.sqrt(4 * case["gravity"] * radius / 3)
        expected = (
            2 * math.sin(angle / 2) * root / (math.cos(angle) * (1 + case["restitution"]))
        )
        assert case["value"] == pytest.approx(expected, rel=1e-13)


@pytest.mark.thorough
@pytest.mark.parametrize("part", ["closed", pytest.param("driven", marks=pytest.mark.release)])
def test_computed_again(folder, part):
    """What is frozen is what jaxrock computes."""
    driven = [each for each in conformance_cases._PARTS if each.__name__ not in QUICK]
    closed = [getattr(conformance_cases, name) for name in QUICK]
    known = {case["id"]: case for case in cases_in(folder)}
    found = list(conformance_cases.cases(closed if part == "closed" else driven))
    assert len(found) > 30
    for case in found:
        frozen = known[case["id"]]
        off = abs(case.pop("value") - frozen["value"])
        assert off <= 0.1 * tolerance(frozen), case["id"]
        assert set(case) < set(frozen), case["id"]
        for key in set(case) - {"difference", "what", "source"}:
            expected = frozen[key]
            if isinstance(expected, float):
                # Ends of a range follow from boundaries that are searched anew.
                expected = pytest.approx(expected, rel=ROUNDING, abs=0)
            assert case[key] == expected, (case["id"], key)


@pytest.mark.thorough
@pytest.mark.release
def test_scipy_agrees_on_every_case(folder):
    result = checked(folder)
    assert result.returncode == 0, result.stdout + result.stderr
    count = len(cases_in(folder))
    assert f"{count} of {count} agree" in result.stdout


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["free-peak-linearized-slender-half", "piece-peak_rotation"])
def test_a_wrong_value_is_noticed(folder, tmp_path, name):
    table = whole(folder)
    (case,) = (case for case in table["cases"] if case["id"] == name)
    for file in conformance.RECORDS:
        (tmp_path / file).write_bytes((folder / file).read_bytes())
    for factor, code in ((0.5, 0), (2.0, 1)):
        wrong = case | {"value": case["value"] + factor * tolerance(case)}
        text = json.dumps(table | {"cases": [wrong]})
        (tmp_path / "cases.json").write_text(text, encoding="utf-8")
        result = checked(tmp_path, "--only", name)
        assert result.returncode == code, result.stdout + result.stderr
        assert (f"off: {name}" in result.stdout) == bool(code)


@pytest.mark.thorough
def test_what_cannot_be_computed_is_off(folder, tmp_path):
    """Neither a missing file nor an unknown quantity passes."""
    table = whole(folder)
    cases = [
        next(case for case in table["cases"] if case["id"] == "piece-peak_rotation"),
        table["cases"][0] | {"quantity": "colour"},
    ]
    (tmp_path / "cases.json").write_text(
        json.dumps(table | {"cases": cases}), encoding="utf-8"
    )
    result = checked(tmp_path)
    assert result.returncode == 1
    assert result.stdout.count("could not be computed") == 2


@pytest.mark.thorough
def test_the_script_does_not_import_jaxrock():
    code = (
        f"import runpy, sys; runpy.run_path({str(SCRIPT)!r}); assert 'jax' not in sys.modules"
    )
    environment = [
        sys.executable,
        "-c",
        f"import sys; sys.path.insert(0, {str(SCRIPT.parents[1])!r}); {code}",
    ]
    assert subprocess.run(environment, check=False).returncode == 0
