"""Driven motion in the corners: cases, their closed forms in mpmath, and which cells fail.

All motions are a rectangular pulse on a block that rests or is launched: a constant push
only turns gravity and makes it stronger, so that a block under it, too, is a pendulum.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
from corners import BASE, CORNERS, differentiate, with_derivatives
from references import closed_forms

import jaxrock as jr

ANSWERS = ("peak", "margin", "first impact", "its velocity", "final rotation")
OF_BATCH = ("peak", "margin", "final rotation")
QUANTITIES = ("value", "gradient", "Hessian")
DIGITS = 100
STEP = mp.mpf(10) ** -25

# Relative to the answer and all its sensitivities, each times the number concerned.
BOUNDS = {
    ("respond", "float64"): {"value": 1e-8, "gradient": 1e-6, "Hessian": 1e-4},
    ("respond", "float32"): {"value": 1e-3, "gradient": 1e-2},
    ("respond_batch", "float64"): {"value": 1e-7, "gradient": 1e-6, "Hessian": 1e-4},
    ("respond_batch", "float32"): {"value": 1e-3, "gradient": 2e-2},
}
# By how much the push that just lifts exceeds the one that does not.
JUST = {"float64": 1e-9, "float32": 1e-4}


class Case(NamedTuple):
    """Half-width, slenderness, gravity, C, amplitude and duration of the push, launch."""

    b: float = 0.4
    slenderness: float = 5.0
    gravity: float = 9.81
    restitution: float = 0.7
    amplitude: float = 0.0
    duration: float = 1e-3
    velocity: float = 0.0
    followed: float = 0.0  # for so long, and with so many impacts; not differentiated
    impacts: int = 1
    fate: str = ""  # where there is no closed form: "falls" or "rests"

    @property
    def numbers(self) -> tuple:
        """Those that answers are differentiated to."""
        return self[:7]


def _launched(**numbers):
    """At 0.6 of the critical velocity, on ground that does not move."""
    case = Case(**numbers)
    block = tuple(map(mp.mpf, case[:3]))
    critical = closed_forms.Nonlinear.critical_velocity(*block)
    rate = closed_forms.frequency(*block)
    return case._replace(velocity=float(0.6 * critical), duration=float(0.01 / rate))


def _pushed(duration=None, **numbers):
    """As much as by an instantaneous pulse of half the critical intensity."""
    case = Case(**numbers)
    block = tuple(map(mp.mpf, case[:3]))
    single = closed_forms.critical_intensity(closed_forms.Nonlinear, *block, mp.mpf(0), 1)
    duration = duration or float(0.05 / closed_forms.frequency(*block))
    push = 0.5 * single / duration + case.gravity / case.slenderness
    return case._replace(amplitude=float(push), duration=duration)


def _cases(excess):
    for name, corner in CORNERS.items():
        if corner["intensity"] != BASE["intensity"]:
            continue
        numbers = {key: value for key, value in corner.items() if key != "intensity"}
        yield f"{name}, launched", _followed(_launched(**numbers))
        yield f"{name}, pushed", _followed(_pushed(**numbers))
    yield "pushed for 1 µs", _followed(_pushed(1e-6))
    yield "pushed with 1e6 m/s2", _followed(Case(amplitude=1e6, duration=4e-7))
    yield "just lifted", _followed(Case(amplitude=9.81 / 5 * (1 + excess), duration=0.3))
    yield "for an hour", _followed(_launched(restitution=1.0), 3600.0)
    needed = 9.81 / 5
    hour = {"duration": 3600.0, "followed": 3600.0}
    yield (
        "not quite lifted in an hour",
        Case(amplitude=needed * (1 - excess), fate="rests", **hour),
    )
    yield "pushed over in an hour", Case(amplitude=1.5 * needed, fate="falls", **hour)
    over = Case(amplitude=1e6, duration=1.0, followed=10.0, fate="falls")
    yield "pushed over with 1e6 m/s2", over


def state(b, slenderness, gravity, restitution, amplitude, duration, velocity):
    """Rotation and velocity where the push ends: a pendulum in the gravity the block feels."""
    push = amplitude / gravity
    angle = closed_forms.critical_angle(slenderness) - mp.atan(push)
    p = closed_forms.frequency(b, slenderness, gravity) * mp.root(1 + push**2, 4)
    modulus = mp.cos(angle / 2) ** 2 + velocity**2 / (4 * p**2)
    launch = mp.asin(mp.cos(angle / 2) / mp.sqrt(modulus))
    phase = mp.ellipf(launch if angle > 0 else -launch, modulus) + p * duration
    sn, cn, dn = (mp.re(mp.ellipfun(name, phase, m=modulus)) for name in ("sn", "cn", "dn"))
    around = -mp.pi if angle > 0 else mp.pi
    rotation = angle + around + 2 * mp.atan2(mp.sqrt(modulus) * sn, dn)
    return rotation, 2 * p * mp.sqrt(modulus) * cn


class Flight(NamedTuple):
    """What follows from the state where the push ends."""

    launch: mp.mpf  # velocity with which it would have left the ground
    landing: mp.mpf  # time of the next impact
    margin: mp.mpf


def flight(numbers) -> Flight:
    b, slenderness, gravity, restitution, _, duration, _ = numbers
    block = b, slenderness, gravity
    angle = closed_forms.critical_angle(slenderness)
    p = closed_forms.frequency(*block)
    critical = closed_forms.Nonlinear.critical_velocity(*block)
    rotation, velocity = state(*numbers)
    launch = mp.sqrt(velocity**2 + 2 * p**2 * (mp.cos(angle - rotation) - mp.cos(angle)))
    modulus = mp.cos(angle / 2) ** 2 + launch**2 / (4 * p**2)
    here, ground = (
        mp.ellipf(mp.asin(mp.cos((angle - lean) / 2) / mp.sqrt(modulus)), modulus)
        for lean in (rotation, mp.mpf(0))
    )
    landing = duration + (2 * mp.ellipk(modulus) - here - ground) / p
    outward = (2 * p * mp.sin((angle - rotation) / 2) - velocity) / critical
    return Flight(launch, landing, min(outward, 1 - restitution * launch / critical))


def closed_form(case: Case, *numbers) -> np.ndarray:
    """All answers at numbers near those of the case."""
    model = closed_forms.Nonlinear
    block = numbers[:3]
    restitution = numbers[3]
    launch, landing, margin = flight(numbers)
    rotation = mp.mpf(0)
    if case.restitution > 0:
        last = landing + _bounces(block, restitution, launch, case.impacts - 1)
        left = restitution**case.impacts * launch
        rotation = (-1) ** case.impacts * model.motion(*block, left, case.followed - last)[0]
    peak = model.peak_rotation(*block, launch)
    return np.array([peak, margin, landing, -launch, rotation])


def _bounces(block, restitution, launch, number):
    """Time that so many half-cycles take after an impact, to second order in log(C)."""
    if number == 0:
        return mp.mpf(0)
    loss = mp.log(restitution)

    def duration(factor):
        return closed_forms.Nonlinear.half_cycle_duration(*block, launch * mp.exp(factor))

    terms = mp.taylor(duration, 0, 2)
    sums = number, number * (number + 1) // 2, number * (number + 1) * (2 * number + 1) // 6
    return sum(
        term * loss**k * total for k, (term, total) in enumerate(zip(terms, sums, strict=True))
    )


def _followed(case: Case, seconds: float | None = None) -> Case:
    """For a third of the half-cycle after the first impact, or for so long."""
    numbers = tuple(map(mp.mpf, case.numbers))
    launch, landing, _ = flight(numbers)
    left = max(numbers[3], mp.mpf(1) / 10) * launch
    half = closed_forms.Nonlinear.half_cycle_duration(*numbers[:3], left)
    if seconds is None:
        return case._replace(followed=float(landing + half / 3))
    return case._replace(followed=seconds, impacts=1 + int((seconds - landing) / half))


with mp.workdps(DIGITS):
    CASES = {precision: dict(_cases(excess)) for precision, excess in JUST.items()}


def scales(case: Case) -> tuple:
    """What a change of each number is measured by; of C, by how often it counts."""
    block = tuple(map(mp.mpf, case.numbers[:3]))
    return (
        *block,
        mp.mpf(1) / case.impacts,
        mp.mpf(case.amplitude or case.gravity / case.slenderness),
        mp.mpf(case.duration),
        mp.mpf(case.velocity) or closed_forms.Nonlinear.critical_velocity(*block),
    )


def adaptive(numbers, followed):
    b, slenderness, gravity, restitution, amplitude, duration, velocity = numbers
    found = jr.respond(
        jr.Block(b, slenderness, gravity),
        restitution,
        jr.Rectangular(amplitude, duration),
        followed,
        velocity=velocity,
        rtol=1e-11 if numbers.dtype == np.float64 else None,
        max_impacts=8,
    )
    impact = found.impact_times[0], found.impact_velocities[0]
    return jnp.stack([found.peak_rotation, found.margin, *impact, found.final_rotation])


def batch(numbers, followed):
    b, slenderness, gravity, restitution, amplitude, duration, velocity = numbers
    block = jr.Block(b, slenderness, gravity)
    push = jr.Rectangular(amplitude, duration)
    found = jr.respond_batch(block, restitution, push, followed, velocity=velocity)
    return jnp.stack([found.peak_rotation, found.margin, found.final_rotation])


SOLVERS = {"respond": (adaptive, ANSWERS), "respond_batch": (batch, OF_BATCH)}


def failures(solver: str, precision: str, hessian: bool = False) -> dict[tuple[str, str], str]:
    """Case and quantity of the cells that fail, with what is wrong."""
    dtype = np.dtype(precision)
    run, names = SOLVERS[solver]
    kept = [ANSWERS.index(name) for name in names]
    compiled = jax.jit(with_derivatives(run, hessian))
    failed = {}
    for name, case in CASES[precision].items():
        numbers = jnp.asarray(case.numbers, dtype)
        followed = jnp.asarray(case.followed, dtype)
        given = Case(*map(float, numbers), float(followed), case.impacts)
        found = [np.asarray(part) for part in compiled(numbers, followed)]
        if case.fate:
            failed |= _not_its_fate(name, case.fate, names, found)
            continue
        with mp.workdps(DIGITS):
            at = tuple(map(mp.mpf, given.numbers))
            scale = np.array(scales(given))
            closed = functools.partial(closed_form, given)
            exact = differentiate(closed, at, STEP * scale, hessian)
        for k, which in enumerate(kept):
            for what, error in _list_errors(
                [np.array(cell)[..., which] for cell in exact if len(cell)],
                [cell[k] for cell in found],
                [1, scale, np.outer(scale, scale)],
            ):
                if not error <= BOUNDS[solver, precision][what]:
                    words = f" {names[k]} off by {mp.nstr(error, 3)}"
                    failed[name, what] = failed.get((name, what), "") + words
    return failed


def _not_its_fate(name, fate, names, found):
    """It stays where it is, or lies on its side in the end; in neither way has it a slope."""
    end = np.pi / 2 if fate == "falls" else 0
    margin = found[0][names.index("margin")]
    failed = {}
    if margin >= 0 if fate == "falls" else not np.isclose(margin, 1, rtol=1e-6):
        failed[name, "value"] = f"margin is {margin}"
    for answer in ("peak", "final rotation"):
        value, *derivatives = (part[names.index(answer)] for part in found)
        if value != np.dtype(value.dtype).type(end):
            failed[name, "value"] = f"{answer} is {value}"
        for what, derivative in zip(QUANTITIES[1:], derivatives, strict=False):
            if (derivative != 0).any():
                failed[name, what] = f"{answer} has derivatives {derivative}"
    return failed


def _list_errors(theirs, ours, scale):
    """Of value, gradient and Hessian of an answer, relative to what it hangs on."""
    sizes = [np.sum(abs(unit * exact)) for unit, exact in zip(scale, theirs, strict=False)]
    felt = [sizes[0] + sizes[1]] * 2 + [sum(sizes)]
    for what, exact, found, unit, size in zip(
        QUANTITIES, theirs, ours, scale, felt, strict=False
    ):
        off = abs(unit * (np.vectorize(mp.mpf, otypes=[object])(found.astype(float)) - exact))
        yield what, mp.nan if np.isnan(found).any() else np.max(off) / (size or 1)
