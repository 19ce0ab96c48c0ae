"""Every public closed-form function, what it should be, and where to ask.

A case evaluates the library at floating-point arguments and the reference at exactly the same
numbers. The arguments stand beside the answers in ``frozen_values/samples.jsonl``, a hundred for
each case and precision, drawn at random: half-widths from 1e-4 to 1e3 m, slenderness from 0.1 to
1e4 and intensities from 1e-12 to 100 m/s, log-uniform; C from 0 and launch velocities from 1e-15
of the critical one, both up to 1 - 1e-12; times up to the next impact, or until a block that
overturns lies on its side. `x` says how close to the verge of overturning each sample is.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest
from references import closed_forms

import jaxrock as jr

from . import frozen

NUMBER = 100  # of samples


class Samples(NamedTuple):
    arguments: tuple[np.ndarray, ...]
    x: np.ndarray


class Case(NamedTuple):
    name: str
    ours: Callable
    theirs: Callable
    path: bool = False  # over time: its derivatives pass through zero
    ulps: int = 2


def read_samples(name, precision):
    """The frozen arguments of a case, with answers."""
    asked, answers = frozen.entry("samples", name, precision)
    arguments, x = zip(*asked, strict=True)
    return Samples(tuple(np.array(arguments).T), np.array(x)), answers


def _scene(b, slenderness, g, restitution, intensity):
    return jr.Scene(jr.Block(b, slenderness, g), restitution, intensity)


def _cases():
    for name, theirs in {
        "half_height": lambda b, s, g: s * b,
        "half_diagonal": lambda b, s, g: closed_forms.half_diagonal(b, s),
        "critical_angle": lambda b, s, g: closed_forms.critical_angle(s),
        "frequency_parameter": closed_forms.frequency,
    }.items():
        yield Case(f"Block.{name}", lambda *b, name=name: getattr(jr.Block(*b), name), theirs)
    yield Case(
        "housner_restitution",
        lambda *b: jr.housner_restitution(jr.Block(*b)),
        lambda b, s, g: 1 - mp.mpf(3) / 2 * mp.sin(closed_forms.critical_angle(s)) ** 2,
    )
    launch = closed_forms.launch_velocity
    yield Case(
        "Block.pulse_velocity", lambda *a: jr.Block(*a[:3]).pulse_velocity(a[3]), launch
    )
    for name, ours, theirs in (
        ("launch_velocity", jr.launch_velocity, lambda b, s, g, c, i: launch(b, s, g, i)),
        (
            "next_velocity",
            lambda scene: jr.resonance.next_velocity(scene, scene.block.half_width),
            lambda b, s, g, c, i: c * b + launch(b, s, g, i),
        ),
        (
            "stabilized_velocity",
            jr.stabilized_velocity,
            lambda *a: closed_forms.half_cycle_velocity(*a, mp.inf),
        ),
    ):
        yield Case(name, lambda *a, ours=ours: ours(_scene(*a)), theirs)
    for count in (1, 2, 5, 30, mp.inf):
        yield Case(
            f"half_cycle_velocity({count})",
            lambda *a, n=float(count): jr.half_cycle_velocity(_scene(*a), n),
            lambda *a, n=count: closed_forms.half_cycle_velocity(*a, n),
        )
    for model in (jr.Linearized(), jr.Nonlinear()):
        yield from _cases_of_model(model)
    for name, factor in (("", "-0.68"), ("_as_printed", "-0.34")):
        yield Case(
            f"equivalent_damping{name}",
            lambda omega, xi, v, t, printed=bool(name): jr.resonance.equivalent_damping(
                xi, printed
            ),
            lambda omega, xi, v, t, factor=factor: mp.mpf(factor) * mp.log(xi),
        )


def _cases_of_model(model):
    kind = type(model).__name__
    theirs = getattr(closed_forms, kind)

    def method(name):
        return lambda b, s, g, *a: getattr(model, name)(jr.Block(b, s, g), *a)

    for name in ("critical_velocity", "peak_rotation", "half_cycle_duration"):
        yield Case(f"{kind}.{name}", method(name), getattr(theirs, name))
    for index, name in enumerate(("rotation", "velocity")):
        yield Case(
            f"{kind}.motion {name}",
            lambda *a, index=index: method("motion")(*a)[index],
            lambda *a, index=index: theirs.motion(*a)[index],
            path=True,
            ulps=4,
        )
    for name in (
        "stabilized_rotation",
        "stabilized_period",
        "rotation_ratio",
        "amplification",
        "overturning_margin",
    ):
        yield Case(
            f"{kind} {name}",
            lambda *a, f=getattr(jr, name): f(_scene(*a), model),
            lambda *a, f=closed_forms.stabilized(name): f(theirs, *a),
        )
    inverses = [("critical_intensity", count, 2) for count in (1, 2, 5, 30, mp.inf)]
    count = 5 if kind == "Linearized" else mp.inf
    # Newton's method, on logarithms, loses some digits.
    inverses += [("critical_width", count, 2), ("critical_slenderness", count, 8)]
    inverses.append(("critical_restitution", count, 8))
    for name, count, ulps in inverses:
        first = 4 if name == "critical_restitution" else 3
        yield Case(
            f"{kind} {name}({count})",
            lambda *a, f=getattr(jr, name), n=float(count), first=first: f(
                jr.Block(*a[:3]), *a[first:], n, model
            ),
            lambda *a, f=getattr(closed_forms, name), n=count: f(theirs, *a, n),
            ulps=ulps,
        )


CASES = {case.name: case for case in _cases()}


def evaluate(case, samples, dtype):
    return np.asarray(case.ours(*(jnp.asarray(a, dtype) for a in samples.arguments)))


# The default run has one function of each kind.
OF_EACH_KIND = {
    "Block.frequency_parameter",
    "half_cycle_velocity(5)",
    "Nonlinear.half_cycle_duration",
    "Nonlinear stabilized_period",
    "Linearized critical_intensity(5)",
    "Nonlinear critical_width(inf)",
}
NAMES = [
    pytest.param(name, marks=pytest.mark.thorough) if name not in OF_EACH_KIND else name
    for name in CASES
]

# Arguments on the edges: b, lambda, g, C, I.
EDGES = {
    "no restitution": (0.4, 5.0, 9.81, 0.0, 0.15),
    "hardly any restitution": (0.4, 5.0, 9.81, 1e-300, 0.15),
    "no pulse": (0.4, 5.0, 9.81, 0.7, 0.0),
    "hardly any pulse": (0.4, 5.0, 9.81, 0.7, 1e-15),
    "neither": (0.4, 5.0, 9.81, 0.0, 0.0),
    "very slender": (0.4, 1e4, 9.81, 0.7, 0.15 / 1000),
    "very slender, hardly any pulse": (0.4, 1e4, 9.81, 0.0, 0.15e-12),
    "very stocky": (1e3, 0.1, 9.81, 0.99, 0.15),
}
# Functions of all or the first four of them.
ON_SCENES = list(dict.fromkeys(name for name, _ in frozen.table("edges") if name in CASES))
