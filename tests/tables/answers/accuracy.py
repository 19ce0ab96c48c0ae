"""What a simpler model costs, and the cheapest that is good enough."""

import numpy as np

import jaxrock as jr

from .half_cycle_map import spread, usual_scenes
from .table import group

ANSWERS = ("rotation_ratio", "period", "critical_intensity")


def list_answers(errors, prefix, *tolerance):
    for name in ANSWERS:
        yield f"{prefix}{name}", getattr(errors, name), *tolerance


@group("accuracy/model_error", 1e-9)
def predict_errors():
    """Differences of two models lose digits where these are close."""
    error = jr.accuracy.model_error(usual_scenes())
    yield from list_answers(error.linearization, "linearization/")
    # Bounds on rounding in 64 bits are themselves differences of that size.
    yield from list_answers(error.total("linearized", 64), "total/linearized_64/", 1e-6)
    yield from list_answers(error.total("nonlinear", 32), "total/nonlinear_32/", 1e-6)


@group("accuracy/duration", 1e-8)
def predict_errors_of_durations():
    error = jr.accuracy.model_error(usual_scenes(), jr.HalfSine, spread(0.001, 0.02, 7))
    yield from list_answers(error.duration, "duration/")
    yield from list_answers(error.duration_bound, "duration_bound/", 1e-6)


def list_choice(choice, prefix):
    picked = np.ravel(choice.index)
    yield f"{prefix}settings", [str(choice.settings[index]) for index in picked]
    yield f"{prefix}error", np.where(choice.error > 1e-12, choice.error, 0.0)
    yield f"{prefix}within_tolerance", choice.within_tolerance


@group("accuracy/choose", 1e-6)
def choose_settings():
    scene = usual_scenes()
    for tolerance in (1e-1, 1e-3, 1e-9):
        yield from list_choice(jr.accuracy.choose(scene, tolerance), f"{tolerance:g}/")
    durations = spread(0.001, 0.02, 7)
    choice = jr.accuracy.choose(scene, 1e-2, jr.HalfSine, durations)
    yield from list_choice(choice, "half_sine/")


@group("accuracy/choose_driven", 1e-6)
def choose_tolerances():
    block = jr.Block(spread(0.1, 0.6, 1), spread(3.0, 8.0, 5))
    pulse = jr.Sine(spread(1.1, 6.0, 11) * 9.81 / block.slenderness, spread(0.2, 1.0, 5))
    scene = (block, spread(0.5, 0.9, 7), pulse)
    choice = jr.accuracy.choose(scene, 1e-4)
    yield "within_tolerance", choice.within_tolerance
    yield "settings", [str(choice.settings[index]) for index in np.ravel(choice.index)]
