"""Every public closed-form function, what it should be, and where to ask.

A case evaluates the library at floating-point arguments and the reference at exactly the
same numbers. `x` says how close to the verge of overturning each sample is.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest
from references import closed_forms

import jaxrock as jr

MODELS = {"Linearized": jr.Linearized(), "Nonlinear": jr.Nonlinear()}
GRAVITY = 9.81
# of the samples that are frozen
NUMBER = 100
SEED = 20150403


class Samples(NamedTuple):
    arguments: tuple[np.ndarray, ...]
    x: np.ndarray


class Case(NamedTuple):
    name: str
    ours: Callable
    theirs: Callable
    sample: Callable[[np.random.Generator, int, type], Samples]
    path: bool = False  # over time: its derivatives pass through zero
    ulps: int = 2


def _log_uniform(rng, low, high, n):
    return 10 ** rng.uniform(np.log10(low), np.log10(high), n)


def _near_one(rng, n, dtype, smallest_gap):
    gap = max(smallest_gap, 16 * float(np.finfo(dtype).eps))
    return 1 - _log_uniform(rng, gap, 1, n)


def _round(dtype, *arrays):
    return tuple(np.asarray(array, dtype).astype(float) for array in arrays)


def _blocks(rng, n, dtype):
    slenderness = _log_uniform(rng, 0.1, 1e4, n)
    width = _log_uniform(rng, 1e-4, 1e3, n)
    return _round(dtype, width, slenderness, np.full(n, GRAVITY))


def _speed_ratios(rng, n, dtype):
    kind = rng.random(n)
    x = np.where(kind < 0.4, _log_uniform(rng, 1e-15, 1, n), _near_one(rng, n, dtype, 1e-12))
    return np.where(kind < 0.6, x, np.where(kind < 0.8, rng.uniform(0, 1, n), x))


def _restitutions(rng, n, dtype):
    kind = rng.random(n)
    some = np.where(kind < 0.4, rng.uniform(0, 1, n), _near_one(rng, n, dtype, 1e-12))
    some = np.where(kind < 0.2, _log_uniform(rng, 1e-15, 1, n), some)
    return _round(dtype, np.where(kind < 0.1, 0, some))[0]


def only_blocks(rng, n, dtype):
    return Samples(_blocks(rng, n, dtype), np.zeros(n))


def with_intensity(rng, n, dtype):
    intensity = _log_uniform(rng, 1e-12, 1e2, n)
    return Samples((*_blocks(rng, n, dtype), *_round(dtype, intensity)), np.zeros(n))


def with_restitution(rng, n, dtype):
    arguments = (*_blocks(rng, n, dtype), _restitutions(rng, n, dtype))
    return Samples(arguments, np.zeros(n))


def scenes_anywhere(rng, n, dtype):
    blocks = _blocks(rng, n, dtype)
    intensity = _log_uniform(rng, 1e-12, 1e2, n)
    arguments = (*blocks, _restitutions(rng, n, dtype), *_round(dtype, intensity))
    return Samples(arguments, np.zeros(n))


def on_the_verge(kind, count):
    """Of overturning in so many half-cycles, anywhere in the box of the blocks."""

    def sample(rng, n, dtype):
        blocks = _blocks(rng, n, dtype)
        restitution = _restitutions(rng, n, dtype)
        theirs = getattr(closed_forms, kind)
        intensity = [
            float(closed_forms.critical_intensity(theirs, *_exact(each), count))
            for each in zip(*blocks, restitution, strict=True)
        ]
        return Samples(
            (*blocks, restitution, *_round(dtype, np.array(intensity))), np.zeros(n)
        )

    return sample


def with_velocity(kind):
    def sample(rng, n, dtype):
        blocks = _blocks(rng, n, dtype)
        x = _speed_ratios(rng, n, dtype)
        velocity = x * _critical_velocity(kind, blocks)
        return Samples((*blocks, *_round(dtype, velocity)), x)

    return sample


def standing_scenes(kind):
    def sample(rng, n, dtype):
        blocks = _blocks(rng, n, dtype)
        x = _speed_ratios(rng, n, dtype)
        restitution = _restitutions(rng, n, dtype)
        width, slenderness, _ = blocks
        unit = 0.75 * slenderness / (width * (1 + slenderness**2))
        intensity = x * _critical_velocity(kind, blocks) / unit * (1 - restitution)
        return Samples((*blocks, restitution, *_round(dtype, intensity)), x)

    return sample


def with_critical_restitution(kind, count):
    """Where there is a restitution that just overturns the block."""

    def sample(rng, n, dtype):
        blocks = _blocks(rng, n, dtype)
        x = rng.uniform(0.01, 0.99, n)
        width, slenderness, _ = blocks
        least = 0 if count == mp.inf else 1 / count
        share = least + (1 - least) * x
        unit = 0.75 * slenderness / (width * (1 + slenderness**2))
        intensity = share * _critical_velocity(kind, blocks) / unit
        return Samples((*blocks, *_round(dtype, np.full(n, 0.5), intensity)), x)

    return sample


def in_motion(kind):
    """Up to the next impact, and beyond the barrier until the block lies on its side."""

    def sample(rng, n, dtype):
        blocks = _blocks(rng, n, dtype)
        over = rng.random(n) < 0.3
        x = np.where(over, rng.uniform(1.05, 3, n), _speed_ratios(rng, n, dtype) * 0.99)
        velocity = x * _critical_velocity(kind, blocks)
        theirs = getattr(closed_forms, kind)
        share = rng.uniform(0.01, 0.95, n)
        durations = [
            1 / float(closed_forms.frequency(*_exact(block)))
            if beyond
            else float(theirs.half_cycle_duration(*_exact(block), mp.mpf(v)))
            for beyond, v, *block in zip(over, velocity, *blocks, strict=True)
        ]
        time = share * np.array(durations)
        return Samples((*blocks, *_round(dtype, velocity, time)), np.where(over, 0, x))

    return sample


def oscillators(rng, n, dtype):
    omega = _log_uniform(rng, 0.1, 1e3, n)
    damping = _log_uniform(rng, 1e-8, 0.99, n)
    velocity = _log_uniform(rng, 1e-6, 10, n)
    time = rng.uniform(0.05, 0.9, n) * np.pi / omega
    return Samples(_round(dtype, omega, damping, velocity, time), np.zeros(n))


def _exact(numbers):
    return tuple(mp.mpf(float(number)) for number in numbers)


def _critical_velocity(kind, blocks):
    theirs = getattr(closed_forms, kind).critical_velocity
    return np.array([float(theirs(*_exact(block))) for block in zip(*blocks, strict=True)])


def _cases():  # noqa: C901
    def block_property(name):
        return lambda b, slenderness, g: getattr(jr.Block(b, slenderness, g), name)

    for name, theirs in {
        "half_height": lambda b, s, g: s * b,
        "half_diagonal": lambda b, s, g: closed_forms.half_diagonal(b, s),
        "critical_angle": lambda b, s, g: closed_forms.critical_angle(s),
        "frequency_parameter": closed_forms.frequency,
    }.items():
        yield Case(f"Block.{name}", block_property(name), theirs, only_blocks)
    yield Case(
        "housner_restitution",
        lambda *b: jr.housner_restitution(jr.Block(*b)),
        lambda b, s, g: 1 - mp.mpf(3) / 2 * mp.sin(closed_forms.critical_angle(s)) ** 2,
        only_blocks,
    )
    yield Case(
        "Block.pulse_velocity",
        lambda b, s, g, i: jr.Block(b, s, g).pulse_velocity(i),
        closed_forms.launch_velocity,
        with_intensity,
    )

    def scene(b, slenderness, g, restitution, intensity):
        return jr.Scene(jr.Block(b, slenderness, g), restitution, intensity)

    yield Case(
        "launch_velocity",
        lambda *a: jr.launch_velocity(scene(*a)),
        lambda b, s, g, c, i: closed_forms.launch_velocity(b, s, g, i),
        scenes_anywhere,
    )
    yield Case(
        "next_velocity",
        lambda *a: jr.resonance.next_velocity(scene(*a), a[0]),
        lambda b, s, g, c, i: c * b + closed_forms.launch_velocity(b, s, g, i),
        scenes_anywhere,
    )
    yield Case(
        "stabilized_velocity",
        lambda *a: jr.stabilized_velocity(scene(*a)),
        lambda *a: closed_forms.half_cycle_velocity(*a, mp.inf),
        scenes_anywhere,
    )
    for count in (1, 2, 5, 30, mp.inf):
        yield Case(
            f"half_cycle_velocity({count})",
            lambda *a, n=float(count): jr.half_cycle_velocity(scene(*a), n),
            lambda *a, n=count: closed_forms.half_cycle_velocity(*a, n),
            scenes_anywhere,
        )
    for kind, model in MODELS.items():
        theirs = getattr(closed_forms, kind)

        def method(name, model=model):
            return lambda b, s, g, *a: getattr(model, name)(jr.Block(b, s, g), *a)

        yield Case(
            f"{kind}.critical_velocity",
            method("critical_velocity"),
            theirs.critical_velocity,
            only_blocks,
        )
        for name in ("peak_rotation", "half_cycle_duration"):
            yield Case(
                f"{kind}.{name}", method(name), getattr(theirs, name), with_velocity(kind)
            )
        for index, name in enumerate(("rotation", "velocity")):
            yield Case(
                f"{kind}.motion {name}",
                lambda *a, motion=method("motion"), index=index: motion(*a)[index],
                lambda *a, motion=theirs.motion, index=index: motion(*a)[index],
                in_motion(kind),
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
                lambda *a, f=getattr(jr, name), model=model: f(scene(*a), model),
                lambda *a, f=closed_forms.stabilized(name), theirs=theirs: f(theirs, *a),
                standing_scenes(kind),
            )
        for count in (1, 2, 5, 30, mp.inf):
            yield Case(
                f"{kind} critical_intensity({count})",
                lambda b, s, g, c, n=float(count), model=model: jr.critical_intensity(
                    jr.Block(b, s, g), c, n, model
                ),
                lambda b, s, g, c, n=count, theirs=theirs: closed_forms.critical_intensity(
                    theirs, b, s, g, c, n
                ),
                with_restitution,
            )

        count = 5 if kind == "Linearized" else mp.inf
        yield Case(
            f"{kind} critical_width({count})",
            lambda *a, n=float(count), model=model: jr.critical_width(
                jr.Block(*a[:3]), *a[3:], n, model
            ),
            lambda *a, n=count, theirs=theirs: closed_forms.critical_width(theirs, *a, n),
            on_the_verge(kind, count),
        )
        yield Case(
            f"{kind} critical_slenderness({count})",
            lambda *a, n=float(count), model=model: jr.critical_slenderness(
                jr.Block(*a[:3]), *a[3:], n, model
            ),
            lambda *a, n=count, theirs=theirs: closed_forms.critical_slenderness(
                theirs, *a, n
            ),
            on_the_verge(kind, count),
            ulps=8,  # Newton's method, on logarithms
        )
        yield Case(
            f"{kind} critical_restitution({count})",
            lambda *a, n=float(count), model=model: jr.critical_restitution(
                jr.Block(*a[:3]), a[4], n, model
            ),
            lambda *a, n=count, theirs=theirs: closed_forms.critical_restitution(
                theirs, *a, n
            ),
            with_critical_restitution(kind, count),
            ulps=8,
        )

    for name, factor, as_printed in (
        ("equivalent_damping", mp.mpf("-0.68"), False),
        ("equivalent_damping_as_printed", mp.mpf("-0.34"), True),
    ):
        yield Case(
            name,
            lambda omega, xi, v, t, printed=as_printed: jr.resonance.equivalent_damping(
                xi, printed
            ),
            lambda omega, xi, v, t, factor=factor: factor * mp.log(xi),
            oscillators,
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
ON_SCENES = [
    name
    for name, case in CASES.items()
    if case.sample in (scenes_anywhere, with_restitution)
    or case.sample.__qualname__.startswith("standing_scenes")
]
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
