"""Names from NumPy, pandas and xarray: the same answers, and plain strings in results."""

import tempfile
from pathlib import Path

import jaxtyping
import numpy as np
import pytest
import xarray
from tools.selection import some_by_default

import jaxrock as jr
from jaxrock.calibration import fit_driven_rocking, fit_free_rocking
from jaxrock.plot import plot_curves, plot_sobol_indices, plot_spectrum
from jaxrock.risk import Inventory, assess_inventory
from jaxrock.sensitivity import outcome_probabilities

BLOCK = jr.Block(0.2, 5.0)
SCENE = jr.Scene(BLOCK, 0.8, 0.1)
RECORD = jr.Record([0.0, 4.0, 4.0, -4.0, -4.0, 0.0], 0.1)
HAZARD = jr.Hazard([0.4, 4.0], [1e-2, 1e-4])
SINE = jr.Sine(4.0, 0.5)
SPREAD = {"width": 0.1}
TIME = np.linspace(0, 2, 41)
ROTATION = 0.05 * np.exp(-TIME) * np.cos(8 * TIME)


def suite(text=str):
    return jr.Suite([RECORD, RECORD.scaled(0.7)], [text("a"), text("b")])


def read(reader, table, **options):
    """Read a file that holds a table."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "table.csv"
        path.write_text(table)
        return reader(path, **options)


def spectrum():
    return jr.resonance_spectrum([3.0, 10.0], [0.4, 1.2], 0.6, 0.15)


def site(text=str):
    return jr.Site(suite(text), HAZARD, text("pgv"), [0.5, 1.0, 2.0])


SAMPLES = "time [s],a,b\n0,0,0\n0.1,1,2\n0.2,-1,1\n0.3,0,0\n"
CURVE = "PGA,rate [1/yr]\n0.1,1e-2\n1,1e-4\n"
# Those that are asked with arrays without axes as well.
OF_ANY_STRING = {
    "model": lambda text: jr.critical_intensity(BLOCK, 0.8, model=text("nonlinear")),
    "columns": lambda text: read(
        jr.read_record, SAMPLES, unit=text("g"), column=text("a"), vertical=text("b")
    ),
    "hazard file": lambda text: read(
        jr.read_hazard, CURVE, unit=text("g"), measure=text("pga"), statistic=text("max")
    ),
    "statistic": lambda text: jr.Hazard([0.4, 4.0], [1e-2, 1e-4], statistic=text("mean")),
    "names and remarks": lambda text: Inventory(
        [text("vase")], jr.Block(np.array([0.2]), 5.0), 0.8, remarks=[text("glass")]
    ),
    "cost of a model": lambda text: jr.model_error(SCENE).total(text("linearized"), 64),
    "curves": lambda text: plot_curves(
        spectrum().rotation_ratio, text("width"), text("slenderness")
    ).get_xlabel(),
    "variable": lambda text: (
        plot_spectrum(spectrum(), text("amplification")).axes[0].get_ylabel()
    ),
}


# Every argument that is a name, of one question each; `text` makes the name.
QUESTIONS = {
    "measure of a record": lambda text: jr.ground_motion.intensity_measure(
        RECORD, text("pgv")
    ),
    "measure of a suite": lambda text: suite().measure(text("pga_ratio"), BLOCK),
    "factors": lambda text: suite().factors(0.4, text("pgv")),
    "a record of a suite": lambda text: suite(text)[text("b")],
    "names of records": lambda text: suite(text),
    "unit": lambda text: jr.Record([0.0, 1.0, 0.0], 0.1, unit=text("g")),
    "component": lambda text: jr.example_record(text("east")),
    "hazard": lambda text: jr.Hazard([0.4, 4.0], [1e-2, 1e-4], measure=text("pgv")),
    "site": lambda text: site(text),
    "rate": lambda text: jr.overturning_rate(BLOCK, 0.8, site(text), model=text("linearized")),
    "fragility": lambda text: jr.fragility(
        BLOCK,
        0.8,
        suite(text),
        [0.5, 1.0],
        measure=text("pgv"),
        thresholds=[text("uplift")],
        model=text("linearized"),
        uncertain=jr.Uncertain({text("half_width"): 0.1}, samples=2),
    ),
    "required value": lambda text: jr.required_value(
        BLOCK,
        0.8,
        site(text),
        1e-3,
        text("width"),
        (0.2, 1.0),
    ),
    "elasticities": lambda text: jr.risk.rate_elasticities(
        BLOCK, 0.8, site(text), by=text("sides")
    ),
    "inventory": lambda text: assess_inventory(
        Inventory([text("vase")], jr.Block(np.array([0.2]), 5.0), 0.8),
        jr.Site(suite(text), HAZARD, text("pgv"), spacing=0.2),
        1e-3,
    ),
    "boundaries": lambda text: jr.overturning_boundaries(
        BLOCK, 0.8, SINE, text("slenderness"), [2.0, 5.0, 9.0], model=text("nonlinear")
    ),
    "critical amplitude": lambda text: jr.critical_amplitude(
        BLOCK, 0.8, jr.Sine, 0.5, (1.0, 4.0), resolution=0.2, model=text("linearized")
    ),
    "respond": lambda text: jr.respond(
        BLOCK, 0.8, SINE, solver=text("Tsit5"), model=text("linearized")
    ),
    "respond_batch": lambda text: jr.respond_batch(BLOCK, 0.8, SINE, model=text("linearized")),
    "respond_within": lambda text: jr.respond_within(
        BLOCK, 0.8, SINE, 1e-3, model=text("linearized")
    ),
    "stabilized": lambda text: jr.rotation_ratio(SCENE, text("nonlinear")),
    "critical width": lambda text: jr.critical_width(
        BLOCK, 0.8, 0.1, model=text("nonlinear"), fixed=text("height")
    ),
    "worst train": lambda text: jr.worst_train(
        BLOCK, 0.7, 2, text("smallest largest"), starts=2, model=text("linearized")
    ),
    "spectrum": lambda text: jr.resonance_spectrum([4.0], [0.4], 0.8, 0.1, model=text("auto")),
    "orbit": lambda text: jr.harmonic_orbit(BLOCK, 0.9, 1.5, 12.0, model=text("linearized")),
    "sensitivities": lambda text: jr.tornado(
        jr.rotation_ratio, SCENE, {text("restitution"): (0.7, 0.9), text("width"): (0.3, 0.5)}
    ),
    "uncertain": lambda text: jr.sensitivity.propagate(
        jr.rotation_ratio, SCENE, jr.Uncertain({text("restitution"): 0.1})
    ),
    "free rocking": lambda text: fit_free_rocking(
        [0.0, 0.777, 1.372, 1.861, 2.276, 2.635], jr.Block(0.1, 5.0), model=text("linearized")
    ),
    "driven rocking": lambda text: fit_driven_rocking(
        TIME, ROTATION, BLOCK, SINE, 0.8, parameters=(text("slenderness"),)
    ),
    **OF_ANY_STRING,
    "probabilities": lambda text: outcome_probabilities(
        BLOCK, 0.8, RECORD, jr.Uncertain({text("width"): 0.1}), model=text("linearized")
    ),
}


def strings(tree):
    """All strings in an answer: static fields, keys, attributes and coordinates."""
    if isinstance(tree, str):
        return [tree]
    if isinstance(tree, xarray.Dataset):
        return strings({**tree.attrs, **{name: None for name in tree.dims}})
    if isinstance(tree, dict):
        return [text for pair in tree.items() for text in strings(list(pair))]
    if isinstance(tree, list | tuple):
        return [text for part in tree for text in strings(part)]
    return strings(vars(tree)) if hasattr(tree, "__dict__") else []


SMALL = {
    "measure of a suite",
    "factors",
    "a record of a suite",
    "unit",
    "component",
    "hazard",
    "columns",
    "variable",
}


@pytest.mark.parametrize("question", some_by_default(QUESTIONS, SMALL))
def test_names_of_numpy_are_names(question):
    ask = QUESTIONS[question]
    answer = ask(np.str_)
    assert {type(text) for text in strings(answer)} <= {str}
    expected = ask(str)
    assert str(answer) == str(expected)


@pytest.fixture
def any_type():
    """Without the types that the tests check: an array is no `str` for them."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


def test_an_element_of_a_coordinate_is_a_name(any_type):
    """An array without axes: what a loop over a coordinate of xarray gives."""
    coordinate = xarray.DataArray(["pga", "pgv"], dims="measure")
    for measure in coordinate:
        measures = suite().measure(measure)
        np.testing.assert_array_equal(measures, suite().measure(str(measure.values)))
    with pytest.raises(ValueError, match=r"measure must be one of pga, pgv, .* got 'pgd'"):
        suite().measure(xarray.DataArray("pgd"))
    with pytest.raises(ValueError, match=r"measure must be one of .* got array"):
        suite().measure(np.array(["pga", "pgv"]))


@pytest.mark.parametrize("make", [np.array, xarray.DataArray])
@pytest.mark.parametrize("question", OF_ANY_STRING)
def test_arrays_without_axes_are_names(question, make, any_type):
    answer = OF_ANY_STRING[question](make)
    assert {type(text) for text in strings(answer)} <= {str}
    assert str(answer) == str(OF_ANY_STRING[question](str))


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (
            lambda: jr.rotation_ratio(SCENE, np.array(["linearized", "nonlinear"])),
            r"model must be Linearized\(\), .* got array",
        ),
        (
            lambda: jr.resonance_spectrum(
                [4.0], [0.4], 0.8, 0.1, model=np.array(["auto"] * 2)
            ),
            r"model must be Linearized\(\), .* got array",
        ),
        (
            lambda: jr.model_error(SCENE).total("cubic", 64),
            "model must be one of linearized, nonlinear, got 'cubic'",
        ),
        (
            lambda: read(jr.read_record, SAMPLES, unit="g", column=3.0),
            "column must name one file or one column, got 3.0",
        ),
        (
            lambda: fit_driven_rocking(
                TIME, ROTATION, BLOCK, SINE, 0.8, parameters=[np.array(["slenderness"] * 2)]
            ),
            "parameters must be different names of .* got array",
        ),
        (lambda: jr.tornado(jr.rotation_ratio, SCENE, {3.0: (0.7, 0.9)}), "ranges has 3.0, "),
        (
            lambda: plot_spectrum(spectrum(), "height"),
            "variable must be one of rotation_ratio, .* got 'height'",
        ),
    ],
)
def test_what_is_no_name_is_refused_by_argument(ask, message, any_type):
    with pytest.raises(ValueError, match=f"^{message}"):
        ask()


def test_names_of_answers():
    result = outcome_probabilities(BLOCK, 0.8, RECORD, jr.Uncertain(SPREAD))
    plot_sobol_indices(result, np.str_("peak"))
