"""Wrong calls, as people make them: one sentence each, with argument, value and what is allowed."""

import re

import jaxtyping
import numpy as np
import pytest

import jaxrock as jr
from jaxrock.cli import main


@pytest.fixture(autouse=True)
def as_users_have_it():
    """Without the types that the tests check, which would answer before the package does."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


BLOCK = jr.Block(0.4, 5.0)
PULSE = jr.Sine(3.0, 0.5)
SCENE = jr.Scene(BLOCK, 0.7, 0.1)
RECORD = jr.Record([0.0, 1.0, 0.0], 0.01)
SUITE = jr.Suite([RECORD, RECORD])
TWO = jr.Block(np.array([0.1, 0.2]), 5.0)
THREE = np.array([0.7, 0.8, 0.9])
MODELS = 'model must be Linearized(), Nonlinear(), "linearized" or "nonlinear"'
REAL = "must be a real number or an array of them"
MANY = "; one Block of arrays stands for many"


WAVE = np.sin(np.arange(200.0))
ROWS = "acceleration must be samples along the last axis, got an array of shape"
TIMES = "are times by their rise; pass the rows of accelerations alone, as rows"


class Quantity(float):
    """As pint, astropy and unyt have them."""

    units = "centimeter"

    def __repr__(self):
        return f"{float(self)} {self.units}"


LIBRARY = {
    # models
    "a class of models": (
        lambda: jr.rotation_ratio(SCENE, jr.Linearized),
        f"{MODELS}, got the class Linearized",
    ),
    "a misspelled model": (
        lambda: jr.critical_intensity(BLOCK, 0.7, model="linearised"),
        f"{MODELS}, got 'linearised'",
    ),
    "a model of no equation": (
        lambda: jr.respond(BLOCK, 0.7, PULSE, model="cubic"),
        f"{MODELS}, got 'cubic'",
    ),
    "a class of models for a batch": (
        lambda: jr.respond_batch(BLOCK, 0.7, PULSE, model=jr.Nonlinear),
        f"{MODELS}, got the class Nonlinear",
    ),
    # shapes
    "shapes of a block": (
        lambda: jr.Block([0.1, 0.2], [3.0, 4.0, 5.0]),
        "shapes must broadcast against each other, got half_width of (2,), slenderness of (3,)",
    ),
    "shapes of a scene": (
        lambda: jr.Scene(TWO, THREE, 0.1),
        "shapes must broadcast against each other, got half_width of (2,), restitution of (3,)",
    ),
    "shapes of a pulse": (
        lambda: jr.Sine([1.0, 2.0, 3.0], [0.5, 1.0]),
        "shapes must broadcast against each other, got amplitude of (3,), duration of (2,)",
    ),
    "shapes of arguments": (
        lambda: jr.critical_intensity(TWO, THREE),
        "shapes must broadcast against each other, got half_width of (2,), restitution of (3,)",
    ),
    "shapes of a batch": (
        lambda: jr.respond_batch(TWO, 0.7, jr.Sine(THREE, 0.5)),
        "shapes must broadcast against each other, got half_width of (2,), amplitude of (3,)",
    ),
    "shapes of records": (
        lambda: jr.respond_batch(TWO, 0.7, jr.Record(np.zeros((3, 9)), 0.01)),
        "shapes must broadcast against each other, got half_width of (2,), acceleration of (3,)",
    ),
    "columns of a file as samples": (
        lambda: jr.Record(np.zeros((200, 2)), 0.01),
        "acceleration must be samples along the last axis, got an array of shape (200, 2), which"
        " would be records of two samples; pass the column of accelerations alone",
    ),
    "times and samples as rows": (
        lambda: jr.Record(np.stack([0.01 * np.arange(200), WAVE]), 0.01),
        f"{ROWS} (2, 200) whose row 1 {TIMES}",
    ),
    "times and samples as rows in g": (
        lambda: jr.Record(np.stack([WAVE, 0.01 * np.arange(200)]), 0.02, unit="g"),
        f"{ROWS} (2, 200) whose row 2 {TIMES}",
    ),
    "times of few digits above two components": (
        lambda: jr.Record(np.stack([np.round(np.arange(200) / 256, 2), WAVE, -WAVE]), 1 / 256),
        f"{ROWS} (3, 200) whose row 1 {TIMES}",
    ),
    "times and two components as columns": (
        lambda: jr.Record(np.stack([np.arange(200), WAVE, -WAVE], 1), 0.01),
        f"{ROWS} (200, 3) whose column 1 {TIMES.replace('the rows', 'the columns')}",
    ),
    "times for a time step": (
        lambda: jr.Record(WAVE, 0.01 * np.arange(1, 201)),
        "time_step must be one number, the time from one sample to the next, got an array of"
        " shape (200,): as many as samples, as times are",
    ),
    "a range of one number": (
        lambda: jr.tornado(jr.rotation_ratio, SCENE, {"restitution": 0.1}),
        "ranges of restitution must be two numbers without a unit, got 0.1",
    ),
    "a misspelled parameter": (
        lambda: jr.tornado(jr.rotation_ratio, SCENE, {"widht": (0.1, 0.2)}),
        "ranges has 'widht', which is none of half_width, slenderness, gravity, inertia_ratio,"
        " restitution, intensity, width, height; did you mean 'width'?",
    ),
    "a truth for a vertical component": (
        lambda: jr.read_record("a.AT2", vertical=True),
        "vertical must be one name of a file or column, got True",
    ),
    "files for a file": (
        lambda: jr.read_record(["a.AT2"]),
        "path must be one name of a file or column, got ['a.AT2']",
    ),
    "arguments in another order": (
        lambda: jr.respond(BLOCK, RECORD, 0.7),
        "motion must be a Motion, got 0.7",
    ),
    "a list of records for a suite": (
        lambda: jr.fragility(BLOCK, 0.7, [RECORD], [0.1]),
        "suite must be a Suite, got a list of 1 Records; Suite([...]) makes one",
    ),
    "a file for a record": (
        lambda: jr.respond(BLOCK, 0.7, "file.AT2"),
        "motion must be a Motion, got 'file.AT2'; read_record reads one from files",
    ),
    "a folder for a suite": (
        lambda: jr.fragility(BLOCK, 0.7, "records", [0.1]),
        "suite must be a Suite, got 'records'; read_suite reads one from files",
    ),
    "a file for a hazard": (
        lambda: jr.Site(SUITE, "hazard.csv"),
        "hazard must be a Hazard or a function, got 'hazard.csv'; read_hazard reads one from files",
    ),
    "a number for a folder": (
        lambda: jr.read_suite(5),
        "source must be a folder or a list of files, got 5",
    ),
    "numbers with units": (
        lambda: jr.Block.from_size(width=Quantity(60.0), height=Quantity(180.0)),
        "width must be a number in SI, or one with a unit like m, got 60.0 centimeter",
    ),
    "half precision": (
        lambda: jr.respond(jr.Block(np.float16(0.4), np.float16(5)), 0.7, PULSE),
        f"half_width {REAL}, in float32 or float64, got dtype('float16')",
    ),
    # one thing for another
    "a block for a scene": (
        lambda: jr.rotation_ratio(BLOCK),
        "scene must be a Scene, got a Block",
    ),
    "a block to assess": (lambda: jr.assess(BLOCK), "scene must be a Scene, got a Block"),
    "a block to choose for": (
        lambda: jr.choose(BLOCK, 1e-3),
        "scene must be a Scene or a DrivenScene, got a Block",
    ),
    "a block with an error": (
        lambda: jr.model_error(BLOCK),
        "scene must be a Scene, got a Block",
    ),
    "a scene for a block": (
        lambda: jr.critical_intensity(SCENE, 0.7),
        "block must be a Block, got a Scene",
    ),
    "a scene to respond": (
        lambda: jr.respond_batch(SCENE, 0.7, PULSE),
        "blocks must be a Block, got a Scene",
    ),
    "a number for a block": (
        lambda: jr.Scene(0.4, 0.7, 0.1),
        "block must be a Block, got 0.4",
    ),
    "a list of blocks": (
        lambda: jr.respond_batch([BLOCK, BLOCK], 0.7, PULSE),
        f"blocks must be a Block, got a list of 2 Blocks{MANY}",
    ),
    "a list of blocks in a scene": (
        lambda: jr.Scene([BLOCK, BLOCK], 0.7, 0.1),
        f"block must be a Block, got a list of 2 Blocks{MANY}",
    ),
    "a list of blocks in closed form": (
        lambda: jr.critical_intensity([BLOCK, BLOCK], 0.7),
        f"block must be a Block, got a list of 2 Blocks{MANY}",
    ),
    "a suite for one block": (
        lambda: jr.respond(BLOCK, 0.7, SUITE),
        "motion must be a Motion, got a Suite; respond_batch takes several",
    ),
    "a list of records": (
        lambda: jr.respond_batch(BLOCK, 0.7, [RECORD, RECORD]),
        "motion must be a Pulse, a Harmonic, a Record or a Suite, got a list of 2 Records",
    ),
    "samples for a motion": (
        lambda: jr.respond(BLOCK, 0.7, np.zeros(1000)),
        "motion must be a Motion, got array([",
    ),
    "a class of pulses for a motion": (
        lambda: jr.respond(BLOCK, 0.7, jr.Sine),
        "motion must be a Motion, got the class Sine; Sine(...) makes one",
    ),
    "a pulse for a class of them": (
        lambda: jr.critical_amplitude(BLOCK, 0.7, PULSE, 0.5),
        "shape must be a class of pulses, for example Sine, got one-sine pulse",
    ),
    "a record for a suite": (
        lambda: jr.fragility(BLOCK, 0.7, RECORD, [0.1, 0.2]),
        "suite must be a Suite, got a Record; Suite([record]) makes one",
    ),
    "no function": (
        lambda: jr.sensitivities(SCENE, {"half_width": 0.4}),
        "answer must be a function, got a Scene",
    ),
    # numbers
    "a string for a number": (lambda: jr.Block("0.4", 5.0), f"half_width {REAL}, got '0.4'"),
    "a string for a tolerance": (
        lambda: jr.respond(BLOCK, 0.7, PULSE, rtol="1e-5"),
        f"rtol {REAL}, got '1e-5'",
    ),
    "a string for an axis": (
        lambda: jr.resonance_spectrum("5", 0.8, 0.7, 0.1),
        f"slenderness {REAL}, got '5'",
    ),
    "strings for numbers": (
        lambda: jr.sensitivities(lambda at: at["b"], {"b": "0.4"}),
        f"b {REAL}, got '0.4'",
    ),
    "half a number of impacts": (
        lambda: jr.respond(BLOCK, 0.7, PULSE, max_impacts=2.5),
        "max_impacts must be a whole number from 0 on, got 2.5",
    ),
    "ragged samples": (
        lambda: jr.Record([list(range(500)), list(range(400))], 0.01),
        f"acceleration {REAL}, got rows of different lengths, 400 to 500",
    ),
    "words for samples": (
        lambda: jr.Record(["much"] * 500, 0.01),
        f"acceleration {REAL}, got ['much', 'much', ",
    ),
    "no such quantity": (
        lambda: jr.overturning_boundaries(BLOCK, 0.7, PULSE, "mass", [1.0, 2.0]),
        "along must be one of amplitude, duration, factor, half_width, slenderness, width,"
        " height, inertia_ratio, restitution, got 'mass'",
    ),
}


@pytest.mark.parametrize("name", LIBRARY)
def test_a_wrong_call_of_the_library(name):
    call, sentence = LIBRARY[name]
    with pytest.raises(ValueError, match=r"^[^\n]{1,200}$") as raised:
        call()
    assert str(raised.value).startswith(sentence)


def test_another_function_or_name_is_suggested():
    with pytest.raises(TypeError, match=r"got width and height; Block\.from_size\(width="):
        jr.Block(width=0.6, height=1.8)
    with pytest.raises(AttributeError, match=r"jaxrock has no .Blok.; did you mean .Block.\?"):
        jr.Blok  # noqa: B018
    with pytest.raises(AttributeError, match=r"jaxrock has no .xyzzy.$"):
        jr.xyzzy  # noqa: B018


def test_width_and_height_cannot_be_swapped():
    with pytest.raises(TypeError, match="positional"):
        jr.Block.from_size(4.0, 0.8)


FILES = {
    "semicolons": (
        "r.csv",
        "t;a\n0;1\n",
        "at least two samples were expected, got 1",
    ),
    "decimal commas": (
        "r.csv",
        "t;a\n0,1;1.2\n",
        "line 2: decimals must all stand behind points or all behind commas, got '0,1'",
    ),
    "columns without names": (
        "r.csv",
        "0,1\n1,2\n",
        "line 1: names of the columns were expected",
    ),
    "a column without a step": (
        "r.csv",
        "0.1\n0.2\n",
        "no column of times is among 'column 1', so that time_step must be given",
    ),
    "another suffix": (
        "r.txt",
        "0.1\n0.2\n",
        "the file holds nothing but numbers, so that time_step must be given",
    ),
    "a word": (
        "r.csv",
        "# dt = 0.1 s\n0.1\nmuch\n",
        "line 3: column 'column 1' must be a number",
    ),
}


@pytest.mark.parametrize("name", FILES)
def test_a_file_that_cannot_be_read(tmp_path, name):
    file, text, sentence = FILES[name]
    path = tmp_path / file
    path.write_text(text)
    with pytest.raises(ValueError, match=r"^[^\n]+$") as raised:
        jr.read_record(path, unit="g")
    assert str(raised.value).startswith(repr(str(path)))
    assert sentence in str(raised.value)


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
