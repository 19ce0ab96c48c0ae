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
from tools.selection import first_by_default

import jaxrock as jr
from jaxrock.cli import application
from jaxrock.reports import paper

ROOT = Path(__file__).parent.parent
TEXTS = {
    path.stem: path.read_text(encoding="utf-8")
    for path in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
}
PRINTED = (
    "README",
    "paper",
    "calibration",
    "concepts",
    "driven_motion",
    "floors",
    "sensitivities",
    "gradients",
    "batching",
    "extending",
)


def code(page):
    """All blocks of Python of a page, one after the other."""
    return "".join(re.findall(r"```python\n(.*?)```", TEXTS[page], re.DOTALL))


def compared(code, namespace):
    """Run it; how many answers begin as the comment beside them says."""
    count = 0
    for statement in ast.parse(code).body:
        source = ast.get_source_segment(code, statement)
        if not isinstance(statement, ast.Expr):
            exec(source, namespace)
            continue
        value = np.ravel(eval(source, namespace))
        comment = code.splitlines()[statement.end_lineno - 1].partition("#")[2]
        for said in re.findall(r"\b(?:True|False|nan)|-?\b0?\d+\.\d+(?:e[-+]\d+)?", comment):
            found = value[0]
            value = value[1:]
            if said in ("True", "False"):
                assert bool(found) == (said == "True"), source
            else:
                assert float(found) == pytest.approx(float(said), rel=6e-3, nan_ok=True), (
                    source
                )
                digits = len(said.partition("e")[0].partition(".")[2])
                kind = "e" if "e" in said else "f"
                assert f"{found:.{digits}{kind}}" == said, source
            count += 1
            if not value.size:
                break
    return count


@pytest.mark.float64
@pytest.mark.parametrize(
    ("page", "count"),
    [
        pytest.param("getting_started", 9, marks=pytest.mark.thorough),
        ("records", 0),
        ("paper", 4),
        ("conformance", 0),
        pytest.param("one_sided", 4, marks=pytest.mark.thorough),
    ],
)
def test_code_gives_what_it_says(page, count):
    with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
        assert compared(code(page), {}) == count


def run(page, capsys, before="", after=""):
    """What the code of a page makes, and what it prints; its pictures are those that are kept.

    Not compared where the code is changed, to be run faster.
    """
    namespace = {}
    assert before in code(page)
    pictures, said = draw_pictures(TEXTS[page].replace(before, after), namespace)
    assert list(pictures) == NAMES.findall(TEXTS[page])
    for name, picture in pictures.items():
        if page != "suites":
            # Another version of Matplotlib makes up to 2, another number in the code 5 or more.
            assert find_difference(picture, name) < 3, name
    for printed, expected in said:
        assert printed == expected
    return namespace, capsys.readouterr().out


@pytest.mark.float64
@pytest.mark.parametrize("page", first_by_default(PRINTED, 2))
def test_code_prints_and_draws_what_stands_below_it(page, capsys):
    with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
        run(page, capsys)


def test_claims_are_shown_by_tests_that_exist():
    script = [sys.executable, "docs/claims.py", "--check"]
    done = subprocess.run(script, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_every_picture_is_small_and_on_a_page_and_in_the_gallery():
    shown = {name for text in TEXTS.values() for name in NAMES.findall(text)}
    drawn = {path.name for path in FOLDER.glob("*.png")}
    assert drawn == shown
    assert drawn - {"statue.png"} == set(NAMES.findall(TEXTS["gallery"]))
    assert max(path.stat().st_size for path in FOLDER.glob("*.png")) < 60_000


@pytest.mark.parametrize("page", TEXTS)
def test_links_lead_to_files_that_are_there(page):
    folder = ROOT if page == "README" else ROOT / "docs"
    for link in re.findall(r"\]\((?!http|pictures|#)([^)#]+)", TEXTS[page]):
        assert (folder / link).exists(), link


@pytest.mark.float64
@pytest.mark.thorough
def test_code_runs_with_fewer_records(capsys):
    run("suites", capsys, "jr.example_suite()", "jr.example_suite()[:6]")


@pytest.mark.float64
@pytest.mark.thorough
def test_validation(capsys):
    printed = run("validation", capsys)[1]
    shown = "".join(re.findall(r"```text\n(.*?)```", TEXTS["validation"], re.DOTALL))
    found, expected = (
        [float(word) for word in re.findall(r"\d+\.\d+", text)] for text in (printed, shown)
    )
    # Motions are chaotic: other processors end some of them otherwise, which moves the ends of
    # the widest intervals by a tenth and more.
    assert found == pytest.approx(expected, rel=0.25, abs=0.05)


@pytest.mark.float64
@pytest.mark.thorough
def test_restitution(capsys):
    first, second = re.findall(r"```python\n(.*?)```", TEXTS["restitution"], re.DOTALL)
    namespace = {}
    with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
        assert compared(first, namespace) == 4
        exec(second, namespace)
    table = re.search(r"```text\n(.*?)```", TEXTS["restitution"], re.DOTALL)[1]
    shown, printed = (
        [float(word) for word in re.findall(r"\d+\.?\d*", text)]
        for text in (table, capsys.readouterr().out)
    )
    # Rates are sums over chaotic motions: other processors end some of them otherwise.
    assert printed == pytest.approx(shown, rel=0.1)


def test_all_code_is_run_by_a_test():
    tested = {"README", "getting_started", "records", "paper", "gradients", "calibration"}
    tested |= {"suites", "driven_motion", "concepts", "sensitivities", "batching", "extending"}
    tested |= {"architecture", "conformance", "floors", "one_sided", "validation"}
    tested |= {"restitution"}
    assert {page for page in TEXTS if code(page)} == tested


def expand_script(script):
    """List the command lines of a script, as the shell passes them on."""
    printing = 'jaxrock() { echo "jaxrock $*"; }\n'
    done = subprocess.run(
        ["sh", "-c", printing + script], capture_output=True, text=True, check=True
    )
    return done.stdout.splitlines()


def test_every_command_line_is_understood():
    """In blocks, in sentences and in help; `tests/tools/examples.py` runs those of blocks."""
    lines = examples.list_help_examples()
    for text in TEXTS.values():
        for example in examples.list_page_examples(text):
            script = example.startswith("#!")
            lines += expand_script(example) if script else [example]
        lines += re.findall(r"`(jaxrock [\w-]+ [^`]*)`", text)
    assert len(lines) > 40
    parser = application.make_application()
    for line in lines:
        words = shlex.split(line.replace("COMMAND", "assess"))[1:]
        parser.parse_args(words, print_error=False, exit_on_error=False)


def test_the_new_command_of_the_architecture_works(tmp_path, monkeypatch, capsys):
    namespace = {"__name__": "jaxrock.cli.uplift", "__package__": "jaxrock.cli"}
    exec(code("architecture"), namespace)
    monkeypatch.setattr(application, "COMMANDS", {"Commands": (namespace["uplift"],)})
    monkeypatch.chdir(tmp_path)
    line = re.search(r"Example: jaxrock (.*)", namespace["uplift"].__doc__)[1]
    exit_code, output, _ = run_command(capsys, *line.split())
    assert exit_code == 0
    assert "lifts" in output


@pytest.mark.float64
@pytest.mark.thorough
def test_faults_and_limited_claims_of_the_paper_are_those_of_the_report():
    report = paper.regenerate()
    for fault in report.faults:
        row = f"| {fault['where']} | {fault['what']} | {fault['figure']} |"
        assert row in TEXTS["paper"]
    limited = [claim for claim in report.claims if claim["verdict"] != "holds"]
    assert "Of the ten claims in words six hold. Four" in " ".join(TEXTS["paper"].split())
    assert (len(report.claims), len(limited)) == (10, 4)
    for claim in limited:
        assert f"| {' | '.join(claim.values())} |" in TEXTS["paper"]


@pytest.mark.float64
@pytest.mark.thorough
def test_the_study_by_workers_runs_and_is_continued(tmp_path):
    """As a file that is run, twice; the port of the dashboard may be taken."""
    script = code("batching").rpartition("import jax\n")
    (tmp_path / "study.py").write_text("".join(script[1:]), encoding="utf-8")
    flags = []
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-W", "ignore::UserWarning", "study.py"],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stdout == "2,282,229 points\n"
        written = (tmp_path / "spectrum.zarr" / "written").glob("[0-9]")
        flags.append({file.name: file.stat().st_mtime_ns for file in written})
    assert len(flags[0]) == 3
    assert flags[0] == flags[1]
    with xarray.open_zarr(tmp_path / "spectrum.zarr") as found:
        sizes = dict(found.rotation_ratio.sizes)
        assert sizes == {"slenderness": 1401, "width": 181, "restitution": 9}


def test_the_recipe_asks_for_what_the_package_asks_for():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    recipe = (ROOT / "packaging" / "recipe.yaml").read_text(encoding="utf-8")
    run = recipe.partition("  run:\n")[2].partition("\ntests:")[0]
    asked = set(re.findall(r"- (\S+) >=(\d\S*)", run.replace("-base ", " ").lower()))
    assert asked == {tuple(each.lower().split(">=")) for each in project["dependencies"]}
    for path in (ROOT / "CITATION.cff", ROOT / "packaging" / "recipe.yaml"):
        stated = re.search(r"^ *version: \"?([\w.]+)", path.read_text(encoding="utf-8"), re.M)[
            1
        ]
        assert stated == project["version"], path
    assert jr.__version__ == project["version"]
