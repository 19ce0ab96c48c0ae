"""The conformance table: jaxrock computes every value in it."""

import json
import math
from importlib.resources import files

import jax
import numpy as np
import pytest
from tools.selection import some_by_default

import jaxrock as jr
from jaxrock import resonance
from jaxrock.ground_motion import PULSES

pytestmark = pytest.mark.float64
TABLE = json.loads(
    (files("jaxrock") / "data" / "conformance.json").read_text(encoding="utf-8")
)
CLOSED = ("none", "train")


def make_record(name):
    """The ground motion of a file, by the description in the table."""
    if name == "ridgecrest_east_and_up.csv":
        return jr.example_record("east", vertical=True)
    north = jr.example_record("north")
    time = np.arange(201) * 0.01
    decaying = 6.0 * np.exp(-1.5 * time) * np.sin(2 * np.pi * time / 0.8)
    piece = np.asarray(north.acceleration)[1200:1401]
    records = {
        "piece.csv": jr.Record(piece, 0.01),
        "sampled_pulse.csv": jr.Record(decaying, 0.01),
    }
    return records.get(name, north)


def compute_launch(case, block, model):
    """Angular velocity with which the half-cycle of a case begins, in closed form."""
    number = case.get("number", 1)
    if case["input"] == "train":
        scene = jr.Scene(block, case.get("restitution", 0.5), case["intensity"])
        return jr.half_cycle_velocity(scene, number)
    rotation = case["initial_rotation"]
    if not rotation:
        return case["initial_velocity"]
    # Released: it meets the ground by the energy of its rotation.
    angle, p = block.critical_angle, block.frequency_parameter
    squared = rotation * (2 * angle - rotation)
    if case["model"] == "nonlinear":
        squared = 4 * np.sin(rotation / 2) * np.sin(angle - rotation / 2)
    return p * np.sqrt(squared) * case["restitution"] ** (number - 1)


def compute_closed(case, block, model):
    """A quantity of free rocking or of a train of pulses."""
    quantity = case["quantity"].replace("half_cycle_peak", "peak")
    if quantity in ("critical_angle", "frequency_parameter"):
        return getattr(block, quantity)
    if quantity == "housner_restitution":
        return jr.housner_restitution(block)
    if quantity == "critical_velocity":
        return model.critical_velocity(block)
    if quantity == "critical_intensity":
        half_cycles = case.get("number", math.inf)
        return jr.critical_intensity(block, case["restitution"], half_cycles, model)
    if quantity == "impact_time":
        launch = compute_launch({**case, "number": 1}, block, model)
        velocities = launch * case["restitution"] ** np.arange(case["number"])
        durations = model.half_cycle_duration(block, velocities)
        return durations.sum() - durations[0] / 2
    own = (
        "half_cycle_velocity",
        "peak_rotation",
        "half_cycle_duration",
        "rotation",
        "velocity",
    )
    if quantity in own:
        launch = compute_launch(case, block, model)
        if quantity == "half_cycle_velocity":
            return launch
        if quantity in ("rotation", "velocity"):
            return model.motion(block, launch, case["time"])[quantity == "velocity"]
        return getattr(model, quantity)(block, launch)
    scene = jr.Scene(block, case["restitution"], case["intensity"])
    options = () if quantity == "stabilized_velocity" else (model,)
    return getattr(resonance, quantity)(scene, *options)


def compute_driven(case, block, model):
    """A quantity of a motion under a pulse or a record, or a boundary of overturning."""
    if case["input"] == "file":
        motion = make_record(case["file"]).scaled(case.get("scale", 1.0))
    else:
        motion = PULSES[case["input"]](case.get("amplitude", 1.0), case["duration"])
    c = case["restitution"]
    if case["quantity"] in ("critical_amplitude", "critical_scale"):
        factors = np.linspace(case["low"], case["high"], 33)
        found = jr.overturning_boundaries(block, c, motion, "factor", factors, model=model)
        return found.value[..., 0]
    if case["initial_rotation"]:
        start = {"rotation": case["initial_rotation"], "velocity": case["initial_velocity"]}
        response = jr.respond(block, c, motion, case["time"], rtol=1e-10, model=model, **start)
    else:
        response = jr.respond_batch(block, c, motion, case["time"], rtol=1e-12, model=model)
    prefix = "final_" if case["quantity"] in ("rotation", "velocity") else ""
    return getattr(response, prefix + case["quantity"])


def compute(case):
    """The value of a case: by its fields alone."""
    block = jr.Block(case["half_width"], case["slenderness"], case["gravity"])
    model = jr.Linearized() if case["model"] == "linearized" else jr.Nonlinear()
    function = compute_closed if case["input"] in CLOSED else compute_driven
    return function(case, block, model)


# Of each kind, whether it is driven; programs of derivatives and of motions take long.
KINDS = sorted({(case["kind"], case["input"] not in CLOSED) for case in TABLE["cases"]})
USUAL = [(kind, False) for kind in ("free rocking", "geometry", "threshold")]


@pytest.mark.parametrize("kind", some_by_default(KINDS, USUAL))
def test_jaxrock_agrees(kind):
    differing = {}
    for case in TABLE["cases"]:
        if (case["kind"], case["input"] not in CLOSED) != kind:
            continue
        if name := case.get("variable"):
            computed = jax.jacfwd(lambda x, c=case, n=name: compute({**c, n: x}))(case[name])
        else:
            computed = compute(case)
        difference = abs(float(computed) - case["value"])
        if not difference <= case["absolute"] + case["relative"] * abs(case["value"]):
            differing[case["id"]] = (float(computed), case["value"])
    assert not differing
