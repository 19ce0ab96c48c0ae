"""The README and the pages in `docs`: their code runs and gives the numbers beside it."""

import ast
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import jax
import numpy as np
import pytest
import xarray
from tools import examples
from tools.command import run as run_command
from tools.drawn_pages import FOLDER, NAMES, draw_pictures, find_difference

import jaxrock as jr
from jaxrock.cli import application
from jaxrock.reports import paper

ROOT = Path(__file__).parent.parent
TEXTS = {
    path.stem: path.read_text(encoding="utf-8")
    for path in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
}
# What is replaced so that a page runs faster; its numbers and pictures are not compared.
SHORTER = {
    "driven_motion": ("1_000_000", "20_000"),
    "suites": ("jr.example_suite()", "jr.example_suite()[:6]"),
}
# Sums over chaotic motions: other processors end some of them otherwise.
CHAOTIC = {"validation": 0.25, "restitution": 0.1}
# Pages with answers beside the code that gives them.
COMPARED = ("getting_started", "one_sided", "paper", "restitution", "sharp_edges")
BY_DEFAULT = ("records", "paper", "conformance")
OTHERWISE = ("architecture",)  # it has a test of its own


def list_code(page):
    """All blocks of Python of a page, one after the other."""
    return "".join(re.findall(r"```python\n(.*?)```", TEXTS[page], re.DOTALL))


def list_numbers(text):
    return [float(word) for word in re.findall(r"\d+\.?\d*", text)]


def run_and_compare(code, names):
    """Run code, and check that answers begin as the comments beside them say."""
    for statement in ast.parse(code).body:
        source = ast.get_source_segment(code, statement)
        if not isinstance(statement, ast.Expr):
            exec(source, names)
            continue
        values = np.ravel(eval(source, names))
        comment = code.splitlines()[statement.end_lineno - 1].partition("#")[2]
        numbers = re.findall(r"\b(?:True|False|nan)|-?\b0?\d+\.\d+(?:e[-+]\d+)?", comment)
        for number, value in zip(numbers, values, strict=False):
            if number in ("True", "False"):
                assert bool(value) == (number == "True"), source
            elif value is not None:
                digits = len(number.partition("e")[0].partition(".")[2])
                assert f"{value:.{digits}{'e' if 'e' in number else 'f'}}" == number, source


PAGES = [page for page in TEXTS if list_code(page) and page not in OTHERWISE]


@pytest.mark.float64
@pytest.mark.parametrize(
    "page",
    [p if p in BY_DEFAULT else pytest.param(p, marks=pytest.mark.thorough) for p in PAGES],
)
def test_code_gives_prints_and_draws_what_stands_beside_it(page):
    text = TEXTS[page].replace(*SHORTER.get(page, ("", "")))
    with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
        execute = run_and_compare if page in COMPARED else exec
        pictures, printed = draw_pictures(text, {}, execute)
    assert list(pictures) == NAMES.findall(TEXTS[page])
    if page in SHORTER:
        return
    for name, picture in pictures.items():
        # Another version of Matplotlib makes up to 2, another number in the code 5 or more.
        assert find_difference(picture, name) < 3, name
    for said, expected in printed:
        if page in CHAOTIC:
            numbers = pytest.approx(list_numbers(expected), rel=CHAOTIC[page], abs=0.05)
            assert list_numbers(said) == numbers
        else:
            assert said == expected


def test_every_picture_is_small_and_on_a_page_and_in_the_gallery():
    shown = {name for text in TEXTS.values() for name in NAMES.findall(text)}
    drawn = {path.name for path in FOLDER.glob("*.png")}
    assert drawn == shown
    assert drawn - {"statue.png"} == set(NAMES.findall(TEXTS["gallery"]))
    assert max(path.stat().st_size for path in FOLDER.glob("*.png")) < 60_000


def test_links_lead_to_files_that_are_there():
    for page, text in TEXTS.items():
        folder = ROOT if page == "README" else ROOT / "docs"
        for link in re.findall(r"\]\((?!http|pictures|#)([^)#]+)", text):
            assert (folder / link).exists(), (page, link)


def test_every_command_line_is_understood():
    """In blocks, in sentences and in help; `tests/tools/examples.py` runs those of blocks."""
    lines = examples.list_help_examples()
    for text in TEXTS.values():
        for example in examples.list_page_examples(text):
            # A script's command lines are those that the shell passes on.
            echo = 'jaxrock() { echo "jaxrock $*"; }\n'
            script = ["sh", "-c", echo + example]
            is_script = example.startswith("#!")
            lines += (
                subprocess.check_output(script, text=True).splitlines()
                if is_script
                else [example]
            )
        lines += re.findall(r"`(jaxrock [\w-]+ [^`]*)`", text)
    assert len(lines) > 40
    parser = application.make_application()
    for line in lines:
        words = shlex.split(line.replace("COMMAND", "assess"))[1:]
        parser.parse_args(words, print_error=False, exit_on_error=False)


def test_the_new_command_of_the_architecture_works(tmp_path, monkeypatch, capsys):
    names = {"__name__": "jaxrock.cli.uplift", "__package__": "jaxrock.cli"}
    exec(list_code("architecture"), names)
    monkeypatch.setattr(application, "COMMANDS", {"Commands": (names["uplift"],)})
    monkeypatch.chdir(tmp_path)
    line = re.search(r"Example: jaxrock (.*)", names["uplift"].__doc__)[1]
    exit_code, output, _ = run_command(capsys, *line.split())
    assert exit_code == 0
    assert "lifts" in output


@pytest.mark.float64
@pytest.mark.thorough
def test_faults_and_limited_claims_of_the_paper_are_those_of_the_report():
    report = paper.regenerate()
    limited = [claim for claim in report.claims if claim["verdict"] != "holds"]
    rows = [(fault["where"], fault["what"], fault["figure"]) for fault in report.faults]
    for row in (*rows, *(claim.values() for claim in limited)):
        assert f"| {' | '.join(row)} |" in TEXTS["paper"]
    assert (len(report.claims), len(limited)) == (10, 4)


@pytest.mark.float64
@pytest.mark.thorough
def test_the_study_by_workers_runs_and_is_continued(tmp_path):
    """As a file that is run, twice; the port of the dashboard may be taken."""
    (page,) = (page for page in TEXTS if "Client(" in list_code(page))
    study = "".join(list_code(page).rpartition("import jax\n")[1:])
    (tmp_path / "study.py").write_text(study, encoding="utf-8")
    times = []
    for _ in range(2):
        command = [sys.executable, "-W", "ignore::UserWarning", "study.py"]
        printed = subprocess.check_output(command, cwd=tmp_path, text=True)
        assert printed == "2,282,229 points\n"
        written = (tmp_path / "spectrum.zarr" / "written").glob("[0-9]")
        times.append({file.name: file.stat().st_mtime_ns for file in written})
    assert len(times[0]) == 3
    assert times[0] == times[1]
    with xarray.open_zarr(tmp_path / "spectrum.zarr") as found:
        assert found.rotation_ratio.size == 1401 * 181 * 9


@pytest.mark.skipif(not (ROOT / "docs" / "claims.py").exists(), reason="no table of claims")
def test_claims_are_shown_by_tests_that_exist():
    subprocess.run([sys.executable, "docs/claims.py", "--check"], cwd=ROOT, check=True)


def test_the_recipe_asks_for_what_the_package_asks_for():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    recipe, citation = (
        (ROOT / name).read_text(encoding="utf-8")
        for name in ("packaging/recipe.yaml", "CITATION.cff")
    )
    run = recipe.partition("  run:\n")[2].partition("\ntests:")[0]
    asked = set(re.findall(r"- (\S+) >=(\d\S*)", run.replace("-base ", " ").lower()))
    assert asked == {tuple(each.lower().split(">=")) for each in project["dependencies"]}
    for text in (recipe, citation):
        stated = re.search(r"^ *version: \"?([\w.]+)", text, re.M)[1]
        assert stated == project["version"] == jr.__version__
