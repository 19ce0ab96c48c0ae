"""Names from NumPy, pandas and xarray: the same answers, and plain strings in results."""

import jaxtyping
import numpy as np
import pytest
import xarray
from tools.selection import some_by_default

import jaxrock as jr
from jaxrock.calibration import fit_driven_rocking
from jaxrock.plot import plot_curves, plot_spectrum
from jaxrock.risk import Inventory, assess_inventory

BLOCK = jr.Block(0.2, 5.0)
SCENE = jr.Scene(BLOCK, 0.8, 0.1)
RECORD = jr.Record([0.0, 4.0, 4.0, -4.0, -4.0, 0.0], 0.1)
HAZARD = jr.Hazard([0.4, 4.0], [1e-2, 1e-4])
TIME = np.linspace(0, 2, 41)
ROTATION = 0.05 * np.exp(-TIME) * np.cos(8 * TIME)


def suite(text=str):
    return jr.Suite([RECORD, RECORD.scaled(0.7)], [text("a"), text("b")])


def spectrum(text=str):
    return jr.resonance_spectrum([3.0, 10.0], [0.4, 1.2], 0.6, 0.15, model=text("auto"))


# Every kind of argument that is a name, of one question each; `text` makes the name. The first
# are asked with arrays without axes as well, which are no names of records or keys.
OF_ANY_STRING = {
    "model": lambda text: jr.critical_intensity(BLOCK, 0.8, model=text("nonlinear")),
    "hazard": lambda text: jr.Hazard(
        [0.4, 4.0], [1e-2, 1e-4], measure=text("pgv"), statistic=text("mean")
    ),
    "remark": lambda text: Inventory(
        [text("vase")], jr.Block(np.array([0.2]), 5.0), 0.8, remarks=[text("glass")]
    ),
    "measure": lambda text: suite().measure(text("pga_ratio"), BLOCK),
    "dimensions of a picture": lambda text: plot_curves(
        spectrum().rotation_ratio, text("width"), text("slenderness")
    ).get_xlabel(),
    "variable of a picture": lambda text: (
        plot_spectrum(spectrum(), text("amplification")).axes[0].get_ylabel()
    ),
}
QUESTIONS = OF_ANY_STRING | {
    "names of records": lambda text: (suite(text), suite(text)[text("b")]),
    "unit": lambda text: jr.Record([0.0, 1.0, 0.0], 0.1, unit=text("g")),
    "component": lambda text: jr.example_record(text("east")),
    "fragility": lambda text: jr.fragility(
        BLOCK,
        0.8,
        suite(text),
        [0.5, 1.0],
        measure=text("pgv"),
        thresholds=[text("uplift")],
        uncertain=jr.Uncertain({text("half_width"): 0.1}, samples=2),
    ),
    "inventory": lambda text: assess_inventory(
        Inventory([text("vase")], jr.Block(np.array([0.2]), 5.0), 0.8),
        jr.Site(suite(text), HAZARD, text("pgv"), spacing=0.2),
        1e-3,
    ),
    "along": lambda text: jr.overturning_boundaries(
        BLOCK, 0.8, jr.Sine(4.0, 0.5), text("slenderness"), [2.0, 5.0, 9.0]
    ),
    "worst train": lambda text: jr.worst_train(
        BLOCK, 0.7, 2, text("smallest largest"), starts=2, model=text("linearized")
    ),
    "spectrum": spectrum,
    "tornado": lambda text: jr.tornado(
        jr.rotation_ratio, SCENE, {text("restitution"): (0.7, 0.9), text("width"): (0.3, 0.5)}
    ),
    "parameters of a fit": lambda text: fit_driven_rocking(
        TIME, ROTATION, BLOCK, jr.Sine(4.0, 0.5), 0.8, parameters=(text("slenderness"),)
    ),
}
SMALL = {"model", "hazard", "measure", "names of records", "unit", "component"}


def list_strings(tree):
    """List all strings in an answer: static fields, keys, attributes and coordinates."""
    if isinstance(tree, str):
        return [tree]
    if isinstance(tree, xarray.Dataset):
        return list_strings({**tree.attrs, **{name: None for name in tree.dims}})
    if isinstance(tree, dict):
        return [text for pair in tree.items() for text in list_strings(list(pair))]
    if isinstance(tree, list | tuple):
        return [text for element in tree for text in list_strings(element)]
    return list_strings(vars(tree)) if hasattr(tree, "__dict__") else []


@pytest.mark.parametrize("question", some_by_default(QUESTIONS, SMALL))
def test_names_of_numpy_are_names(question):
    answer = QUESTIONS[question](np.str_)
    assert {type(text) for text in list_strings(answer)} <= {str}
    assert str(answer) == str(QUESTIONS[question](str))


@pytest.mark.parametrize("make", [np.array, xarray.DataArray])
@pytest.mark.parametrize("question", OF_ANY_STRING)
def test_arrays_without_axes_are_names(question, make, monkeypatch):
    """As a loop over a coordinate gives them; for the types that the tests check they are none."""
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    answer = OF_ANY_STRING[question](make)
    assert {type(text) for text in list_strings(answer)} <= {str}
    assert str(answer) == str(OF_ANY_STRING[question](str))
