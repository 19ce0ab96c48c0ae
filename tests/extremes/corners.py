"""The corners of the closed forms: where, of what, how accurate, and what is known not to be.

A cell is a function at a corner in one precision: its value, its gradient to the five
numbers of a scene, or its Hessian. It meets the bounds below.
"""

import functools
from collections.abc import Callable, Iterator
from typing import NamedTuple

import jax
import mpmath as mp
import numpy as np
from references import closed_forms

import jaxrock as jr

PRECISIONS = {"float64": np.float64, "float32": np.float32}
MODELS = {"Linearized": jr.Linearized(), "Nonlinear": jr.Nonlinear()}
BASE = {"b": 0.4, "slenderness": 5.0, "gravity": 9.81, "restitution": 0.7, "intensity": 0.15}

# Digits of the reference; where launches are as weak as the smallest numbers, their squares
# and the squares of steps for derivatives must still be told from 0.
DIGITS = 200
DIGITS_OF_WEAK = 1600
STEP = mp.mpf(10) ** -45

# Derivatives are within so many eps, relative to themselves, over 1 - x^2 where they have a
# singularity on the verge of overturning (x = 1): as much as rounding takes from 1 - x^2.
OF_DERIVATIVES = 50
# So many times the smallest normal number may be 0: subnormal numbers are flushed on the way.
FLUSHED = 100


def _corner(**numbers):
    return BASE | numbers


# A corner may be given by words where it depends on the precision or on the model.
CORNERS = {
    "in the middle": _corner(),
    "C = 0": _corner(restitution=0.0),
    "C = 1 - 1e-15": _corner(restitution=1 - 1e-15),
    "C = 1 - 1e-15, standing": _corner(restitution=1 - 1e-15, intensity="half of critical"),
    "C = 1": _corner(restitution=1.0),
    "λ = 0.1": _corner(slenderness=0.1),
    "λ = 1e4": _corner(slenderness=1e4),
    "λ = 1e4, standing": _corner(slenderness=1e4, intensity="half of critical"),
    "b = 0.1 mm": _corner(b=1e-4),
    "b = 0.1 mm, standing": _corner(b=1e-4, intensity="half of critical"),
    "b = 1 km": _corner(b=1e3),
    "I the smallest subnormal": _corner(intensity="subnormal"),
    "I the smallest normal": _corner(intensity="normal"),
    "I a millionth below critical": _corner(intensity="a millionth below critical"),
    "I next below critical": _corner(intensity="below critical"),
    "I critical": _corner(intensity="critical"),
    "I next above critical": _corner(intensity="above critical"),
    "I = 1e6": _corner(intensity=1e6),
    "on the Moon": _corner(gravity=1.62),
    "in a centrifuge": _corner(gravity=981.0),
    "tiny, slender, C = 0, on the Moon": _corner(
        b=1e-4, slenderness=1e4, gravity=1.62, restitution=0.0, intensity="half of critical"
    ),
    "huge, stocky, C = 1 - 1e-15, in a centrifuge": _corner(
        b=1e3,
        slenderness=0.1,
        gravity=981.0,
        restitution=1 - 1e-15,
        intensity="half of critical",
    ),
}


def arguments(corner: str, model_name: str, dtype: type) -> tuple[float, ...]:
    """b, slenderness, gravity, C and I as numbers of a precision."""
    numbers = CORNERS[corner]
    b, slenderness, gravity, restitution = (
        float(dtype(v)) for v in list(numbers.values())[:-1]
    )
    if restitution == 1 > numbers["restitution"]:
        restitution = float(np.nextafter(dtype(1), dtype(0)))
    intensity = numbers["intensity"]
    if isinstance(intensity, str):
        block = tuple(map(mp.mpf, (b, slenderness, gravity, restitution)))
        exact = closed_forms.critical_intensity(
            getattr(closed_forms, model_name), *block, mp.inf
        )
        critical = dtype(float(exact))
        intensity = {
            "subnormal": np.nextafter(dtype(0), dtype(1)),
            "normal": np.finfo(dtype).tiny,
            "half of critical": critical / 2,
            "a millionth below critical": dtype(float(exact * (1 - mp.mpf(10) ** -6))),
            "below critical": np.nextafter(critical, dtype(0)),
            "critical": critical,
            "above critical": np.nextafter(critical, dtype(np.inf)),
        }[intensity]
    return b, slenderness, gravity, restitution, float(dtype(intensity))


class Function(NamedTuple):
    ours: Callable  # of the five numbers
    theirs: Callable  # of the same in mpmath
    model_name: str
    kind: str  # what becomes of it where the block overturns, see `expected`


def scene(b, slenderness, gravity, restitution, intensity):
    return jr.Scene(jr.Block(b, slenderness, gravity), restitution, intensity)


def sum_of_powers(ratio, count):
    """1 + C + ... + C^(n - 1), by doubling."""
    total = mp.mpf(1)
    power = ratio
    for digit in bin(count)[3:]:
        total = total * (1 + power)
        power = power**2
        if digit == "1":
            total = 1 + ratio * total
            power = ratio * power
    return total


def velocity_of(b, slenderness, gravity, restitution, intensity, count):
    """Launch velocity of a half-cycle, or of the stabilized phase where `count` is inf."""
    first = closed_forms.launch_velocity(b, slenderness, gravity, intensity)
    if count == mp.inf:
        return first / (1 - restitution)
    return first * sum_of_powers(restitution, count)


def _functions() -> Iterator[tuple]:
    for name, ours, count, kind in (
        ("launch_velocity", jr.launch_velocity, 1, "finite"),
        (
            "half_cycle_velocity(1e6)",
            lambda s: jr.half_cycle_velocity(s, 1e6),
            10**6,
            "finite",
        ),
        ("stabilized_velocity", jr.stabilized_velocity, mp.inf, "velocity"),
    ):
        yield (
            name,
            lambda *a, f=ours: f(scene(*a)),
            lambda *a, n=count: velocity_of(*a, n),
            "Linearized",
            kind,
        )
    for model_name, model in MODELS.items():
        theirs = getattr(closed_forms, model_name)
        for name in (
            "stabilized_period",
            "stabilized_rotation",
            "rotation_ratio",
            "amplification",
            "overturning_margin",
        ):
            yield (
                f"{model_name} {name}",
                lambda *a, f=getattr(jr, name), m=model: f(scene(*a), m),
                lambda *a, f=closed_forms.stabilized(name), t=theirs: f(t, *a),
                model_name,
                "margin" if name == "overturning_margin" else "standing",
            )
        for count in (1, 10**6, mp.inf):
            yield (
                f"{model_name} critical_intensity({float(count):.4g})",
                lambda *a, n=float(count), m=model: jr.critical_intensity(
                    jr.Block(*a[:3]), a[3], n, m
                ),
                lambda *a, n=count, t=theirs: _critical_intensity(t, *a[:4], n),
                model_name,
                "finite",
            )


def _critical_intensity(theirs, b, slenderness, gravity, restitution, count):
    critical = theirs.critical_velocity(b, slenderness, gravity)
    if count == mp.inf:
        unit = closed_forms.launch_velocity(b, slenderness, gravity, mp.mpf(1))
        return critical * (1 - restitution) / unit
    return critical / velocity_of(b, slenderness, gravity, restitution, mp.mpf(1), count)


FUNCTIONS = {name: Function(*rest) for name, *rest in _functions()}


class Exact(NamedTuple):
    """What a cell should be."""

    x: mp.mpf  # stabilized over critical velocity, inf for C = 1
    undecided: bool  # stands or overturns: closer to the verge than rounding allows to tell
    value: mp.mpf
    gradient: list | None  # None where the value has none
    hessian: list | None


def speed_ratio(numbers, model_name):
    """Stabilized over critical velocity, and by how much its rounding may change it."""
    b, slenderness, gravity, restitution, _ = numbers
    if restitution == 1:
        return mp.inf, mp.mpf(0)
    critical = getattr(closed_forms, model_name).critical_velocity
    x = velocity_of(*numbers, mp.inf) / critical(b, slenderness, gravity)
    # Units in the last place as of any value: 2 (1 + condition number). The elasticities are 1
    # of the pulse and of 1 - C, a half of width and gravity, at most 1.5 of the slenderness.
    return x, 2 * (1 + 4.5) * x


def expected(function: Function, corner: str, dtype: type) -> Exact:
    weak = "smallest" in corner
    with mp.workdps(DIGITS_OF_WEAK if weak else DIGITS):
        numbers = tuple(map(mp.mpf, arguments(corner, function.model_name, dtype)))
        x, roundings = speed_ratio(numbers, function.model_name)
        undecided = abs(x - 1) <= roundings * float(np.finfo(dtype).eps)
        if x == mp.inf and function.kind != "finite":
            value = {"velocity": mp.inf, "margin": -mp.inf, "standing": mp.nan}[function.kind]
            return Exact(x, False, value, None, None)
        if x >= 1 and function.kind == "standing":
            return Exact(x, undecided, mp.nan, None, None)
        steps = [STEP * (n if n > 0 else 1) for n in numbers]
        exact = differentiate(function.theirs, numbers, steps)
        return Exact(x, undecided and function.kind == "standing", *exact)


def differentiate(function, numbers, steps, second=True):
    """Value and first and second derivatives, from forward differences by very small steps."""

    @functools.cache
    def at(*raised):
        return function(*(n + raised.count(k) * steps[k] for k, n in enumerate(numbers)))

    def bend(i, j):
        return (at(i, j) - at(i) - at(j) + at()) / (steps[i] * steps[j])

    size = range(len(numbers))
    gradient = [(at(i) - at()) / steps[i] for i in size]
    hessian = [[bend(max(i, j), min(i, j)) for j in size] for i in size] if second else []
    return at(), gradient, hessian


def with_derivatives(function, second=True, mode=jax.jacfwd):
    """A function with its first and second derivatives along its first argument, as one program.

    Second derivatives are those forward of the first ones, which are in the `mode`.
    """

    def value(*given):
        answer = function(*given)
        return answer, (answer,)

    def slope(*given):
        gradient, known = mode(value, has_aux=True)(*given)
        return gradient, (*known, gradient)

    def bend(*given):
        hessian, known = jax.jacfwd(slope, has_aux=True)(*given)
        return *known, hessian

    return bend if second else lambda *given: slope(*given)[1]


def scales(numbers) -> tuple:
    """What a change of each number is measured by: itself, and of C its distance to 1."""
    b, slenderness, gravity, restitution, intensity = map(mp.mpf, numbers)
    return b, slenderness, gravity, (1 - restitution) or mp.mpf(1), intensity
