"""Wrong calls of the command line, as people make them: one sentence each, and exit status 2."""

import re

import jaxtyping
import pytest

import jaxrock as jr
from jaxrock.cli import main


@pytest.fixture(autouse=True)
def as_users_have_it():
    """Without the types that the tests check, which would answer before the package does."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


def test_one_column_needs_no_name(tmp_path):
    path = tmp_path / "r.csv"
    path.write_text("# recorded somewhere\n0.5\n-1\n2\n")
    record = jr.read_record(path, unit="m/s2", time_step=0.01)
    assert record.acceleration.tolist() == [0.5, -1, 2]
    assert jr.read_suite([path], unit="m/s2", time_step=0.01)[0].samples == 3
    path.write_text("# dt = 0.02 s, in m/s2\n0.5\n-1\n")
    assert jr.read_record(path).time_step == 0.02


CANNOT = "Invalid value for"
UNABLE = "unable to convert"
WORDS = {
    "no command": ("", "a command must be given; --help lists them"),
    "no such command": ("asess", 'Unknown command "asess". Did you mean "assess"?'),
    "a misspelled option": (
        "assess --widht 0.8",
        "Unknown option: --widht. Did you mean --width?",
    ),
    "no such option": ("assess --colour=red", "Unknown option: --colour"),
    "a word for a number": (
        "assess --width broad",
        f'{CANNOT} --width: {UNABLE} "broad" into float',
    ),
    "the same with =": (
        "assess --width=broad",
        f'{CANNOT} --width: {UNABLE} "broad" into float',
    ),
    "a fraction for a count": (
        "tradeoff --repeats 1.5",
        f"{CANNOT} --repeats: '1.5' is not a whole number",
    ),
    "a word among numbers": (
        "critical --half-cycles 1 two",
        f'{CANNOT} --half-cycles: {UNABLE} "two" into float',
    ),
    "no number": (
        "assess --height --json",
        'Command "assess" parameter --height requires an arg',
    ),
    "no choice": (
        "critical --model cubic",
        'Invalid value "cubic" for --model. Choose from: "linearized", "nonlinear"',
    ),
    "a name that another option has": (
        "critical --pulse sine --pulse-duration 0.5 --along scale",
        'Invalid value "scale" for --along. Choose from: "amplitude", "duration", "factor",'
        ' "width", "height", "half_width", "slenderness", "inertia_ratio", "restitution"',
    ),
    "a number too many": ("assess --width 0.8 0.9", "Unused Tokens: ['0.9']"),
    "a flag with a word": ("assess --json yes", "Unused Tokens: ['yes']"),
    "an option twice": (
        "assess --width 1 --width 2",
        "Parameter --width specified multiple times",
    ),
    "a file too few": ("fit", 'Command "fit" parameter --file requires an argument'),
    "the unit of the example": (
        "respond --record example --unit g",
        'record "example" has its unit and time step: leave out --unit',
    ),
    "the step of the examples": (
        "fragility --unit g --time-step 0.01",
        'records "example" have their unit and time step: leave out --unit and --time-step',
    ),
    "a set that is none": (
        "fragility --records fema-farfield",
        "records must be a folder, example, or one of fema-far-field, fema-near-field,",
    ),
    "a column of the example": (
        "respond --record example --column up",
        'column of the record "example" must be north or east, and vertical up if given',
    ),
}


@pytest.mark.float64
@pytest.mark.parametrize("name", WORDS)
def test_a_wrong_call_of_the_command_line(capsys, name):
    words, sentence = WORDS[name]
    with pytest.raises(SystemExit) as stop:
        main(words.split())
    out, err = capsys.readouterr()
    assert (stop.value.code, out) == (2, "")
    assert re.fullmatch(r"jaxrock: error: [^\n]{1,200}\n", err)
    assert err.startswith(f"jaxrock: error: {sentence}")


@pytest.mark.float64
def test_help_is_grouped_and_hides_what_is_none(capsys):
    main(["critical", "--help"])
    said = capsys.readouterr().out
    titles = re.findall(r"^╭─ ([A-Za-z ]+) ─", said, re.M)
    assert titles == ["Parameters", "Block", "Ground motion", "Output"]
    assert "None" not in said
    assert "--width FLOAT" in said.partition("─ Block")[2].partition("─ Ground motion")[0]
    assert "Full width 2b of the base [m]" in said
    assert max(map(len, said.splitlines())) <= 100
