"""The cases of the conformance table, computed by jaxrock.

``python tests/tables/conformance_cases.py`` computes all of them again and prints where they
differ from the frozen ones by more than a tenth of their tolerance; with ``--write`` the
frozen ones are replaced. Takes minutes, most of them for compiling.
"""

import itertools
import json
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parent.parent))

from tools import conformance

import jaxrock as jr
from jaxrock import resonance
from jaxrock.block import Block
from jaxrock.driven import respond, respond_batch, uplift_acceleration
from jaxrock.ground_motion import PULSES, HalfSine, Motion, Pulse, Record, Ricker, Sine
from jaxrock.impact import housner_restitution
from jaxrock.overturning import critical_amplitude, overturning_boundaries
from jaxrock.reports.paper import read_printed_tables
from jaxrock.resonance import Linearized, Nonlinear, RockingModel, Scene

FROZEN = Path(jr.__file__).parent / "data" / "conformance.json"
RECORDS = conformance.RECORDS
FIELDS = tuple(conformance.read_table()["fields"])

_UNITS = {
    "critical_angle": "rad",
    "frequency_parameter": "1/s",
    "critical_velocity": "rad/s",
    "peak_rotation": "rad",
    "half_cycle_duration": "s",
    "half_cycle_peak_rotation": "rad",
    "impact_time": "s",
    "rotation": "rad",
    "velocity": "rad/s",
    "critical_amplitude": "m/s2",
    "half_cycle_velocity": "rad/s",
    "critical_intensity": "m/s",
    "stabilized_velocity": "rad/s",
    "stabilized_rotation": "rad",
    "stabilized_period": "s",
}
_FIELD_UNITS = {"half_width": "m", "amplitude": "m/s2", "duration": "s", "intensity": "m/s"}

_MODELS: dict[str, RockingModel] = {"linearized": Linearized(), "nonlinear": Nonlinear()}

# What a good program in double precision should reach.
_CLOSED = 1e-9
_EXACT_SLOPE = 1e-6
_PULSE = 1e-6
_RECORD = 1e-4
_SLOPE = 1e-4

HOUSNER = "Housner 1963, Bull. Seismol. Soc. Am. 53(2), 403-417"
MAKRIS = "Makris and Roussos 2000, Geotechnique 50(3)"
NABESHIMA = (
    "double impulse as in Nabeshima, Taniguchi, Kojima and Takewaki 2016, Front. Built Environ. "
    "2:9: V_c = 2 sin(alpha_c / 2) sqrt(4 g R / 3) / (cos(alpha_c) (1 + C))"
)
_CONVERGED = "adaptive Runge-Kutta pairs at rtol 1e-11 and Taylor polynomials at rtol 1e-13"
_BOUNDARY = (
    "zero of the margin by Taylor polynomials at rtol 1e-9, difference from that at 1e-13"
)
_AROUND = np.array([1 - 1e-5, 1 + 1e-5])

Row = dict[str, Any]
Motions = dict[str, Record]


def cases(parts: Sequence[Callable[[Motions], Iterator[Row]]] | None = None) -> Iterator[Row]:
    """All cases, or some parts of them, with their values."""
    motions = conformance.make_records()
    return itertools.chain.from_iterable(part(motions) for part in parts or _PARTS)


def _row(
    name: str, kind: str, quantity: str, what: str, block: Block, value: Any, **fields: Any
) -> Row:
    unit = _UNITS.get(quantity, "-")
    variable = fields.get("variable")
    if variable in _FIELD_UNITS:
        unit = f"{unit.replace('-', '1')} / ({_FIELD_UNITS[variable]})"
    known: Row = {
        "id": name,
        "kind": kind,
        "quantity": quantity,
        "what": what,
        "unit": unit,
        "model": "either",
        "half_width": float(block.half_width),
        "slenderness": float(block.slenderness),
        "gravity": float(block.gravity),
        "input": "none",
        "value": float(value),
        "relative": _CLOSED,
        "absolute": 0.0,
        "from": "closed form",
    } | {key.rstrip("_"): field for key, field in fields.items()}
    return {field: known.pop(field, None) for field in FIELDS} | known


# Half-width and slenderness: a slender block, one of usual shape, a stocky and a small one.
_SLENDER = (0.25, 8.0)
_WALL = (0.4, 5.0)
_STOCKY = (0.3, 1.5)
_SLIM = (0.1, 5.0)


def _geometry(_: Motions) -> Iterator[Row]:
    of = Block(*_STOCKY)
    for quantity, value, source in (
        ("critical_angle", of.critical_angle, "arctan(1 / lambda)"),
        ("frequency_parameter", of.frequency_parameter, "sqrt(3 g / (4 R))"),
        (
            "housner_restitution",
            housner_restitution(of),
            HOUSNER + ", as a ratio of velocities",
        ),
    ):
        what = f"The {quantity.replace('_', ' ')} of a stocky block."
        yield _row(
            f"geometry-{quantity}", "geometry", quantity, what, of, value, source=source
        )


def _free_rocking(_: Motions) -> Iterator[Row]:
    kind = "free rocking"
    shapes = (
        ("slender", Block(*_SLENDER), "linearized"),
        ("slender", Block(*_SLENDER), "nonlinear"),
        ("stocky", Block(*_STOCKY), "nonlinear"),
    )
    strengths = (("weak", 1e-3), ("half", 0.5), ("verge", 0.99999))
    for shape, block, equation in shapes:
        model = _MODELS[equation]
        for strength, x in strengths:
            velocity = float(x * model.critical_velocity(block))
            yield _row(
                f"free-peak-{equation}-{shape}-{strength}",
                kind,
                "peak_rotation",
                f"Largest rotation of a {shape} block launched with {x:g} times v_c.",
                block,
                model.peak_rotation(block, velocity),
                model=equation,
                initial_rotation=0.0,
                initial_velocity=velocity,
                source="Eq. 6"
                if equation == "linearized"
                else "alpha_c - arccos(cos(alpha_c) + v^2 / (2 p^2))",
            )
        for strength, x in strengths[1:]:
            velocity = float(x * model.critical_velocity(block))
            yield _row(
                f"free-duration-{equation}-{shape}-{strength}",
                kind,
                "half_cycle_duration",
                f"Time until a {shape} block launched with {x:g} times v_c meets the ground.",
                block,
                model.half_cycle_duration(block, velocity),
                model=equation,
                initial_rotation=0.0,
                initial_velocity=velocity,
                number=1,
                source="Eq. 7"
                if equation == "linearized"
                else "an elliptic integral of the first kind",
            )
    model = Nonlinear()
    velocity = float(0.6 * model.critical_velocity(Block(*_WALL)))
    time = float(f"{0.7 * model.half_cycle_duration(Block(*_WALL), velocity):.3g}")
    states = model.motion(Block(*_WALL), velocity, time)
    for quantity, value in zip(("rotation", "velocity"), states, strict=True):
        yield _row(
            f"free-{quantity}",
            kind,
            quantity,
            f"{quantity.capitalize()} on the way back of a block launched with 0.6 times v_c.",
            Block(*_WALL),
            value,
            model="nonlinear",
            initial_rotation=0.0,
            initial_velocity=velocity,
            time=time,
            source="Jacobi's elliptic functions",
        )
    yield from _decay()


def _decay() -> Iterator[Row]:
    kind = "free rocking"
    block = Block(0.3, 8.0)
    c = math.sqrt(0.7)
    for equation, number in (("linearized", 2), ("linearized", 7), ("nonlinear", 4)):
        model = _MODELS[equation]
        start = float(0.8 * block.critical_angle)
        arrival = _arrival(block, start, equation)
        yield _row(
            f"decay-{equation}-{number}",
            kind,
            "half_cycle_peak_rotation",
            f"Peak of half-cycle {number} of a block released from 0.8 alpha_c.",
            block,
            model.peak_rotation(block, arrival * c ** (number - 1)),
            model=equation,
            restitution=c,
            initial_rotation=start,
            initial_velocity=0.0,
            number=number,
            source=f"{HOUSNER}, decay of free rocking: phi_n = 1 - sqrt(1 - r^n (1 - (1 - "
            "phi_0)^2)), r = C^2"
            if equation == "linearized"
            else "energy, and the closed form of the peak",
        )
    arrival = _arrival(block, start, "nonlinear")
    duration = 0.5 * model.half_cycle_duration(block, arrival)
    for k in (1, 2):
        duration = duration + model.half_cycle_duration(block, arrival * c**k)
    yield _row(
        "decay-impact-time",
        kind,
        "impact_time",
        "When a block released from 0.8 alpha_c meets the ground for the third time.",
        block,
        duration,
        model="nonlinear",
        restitution=c,
        initial_rotation=start,
        initial_velocity=0.0,
        number=3,
        source="half a half-cycle and two whole ones, elliptic integrals",
    )


def _arrival(block: Block, rotation: float, equation: str) -> float:
    """Speed with which a block released from a rotation meets the ground [rad/s]."""
    p = float(block.frequency_parameter)
    angle = float(block.critical_angle)
    if equation == "linearized":
        return p * math.sqrt(rotation * (2 * angle - rotation))
    return 2 * p * math.sqrt(math.sin(rotation / 2) * math.sin(angle - rotation / 2))


def _thresholds(_: Motions) -> Iterator[Row]:
    kind = "threshold"
    for block, equation, formula in (
        (Block(*_SLENDER), "linearized", "alpha_c p"),
        (Block(*_STOCKY), "nonlinear", "2 p sin(alpha_c / 2)"),
    ):
        yield _row(
            f"critical-velocity-{equation}",
            kind,
            "critical_velocity",
            "Launch that just overturns the block in free motion.",
            block,
            _MODELS[equation].critical_velocity(block),
            model=equation,
            source=formula,
        )
    block = Block(0.3, 6.0)
    c = 0.9
    p = float(block.frequency_parameter)
    for p_duration in (0.5, 1.0, 2.0):
        (row,) = _amplitudes(
            f"rectangular-{p_duration:g}",
            kind,
            ["Smallest amplitude of a rectangular pulse that overturns the block."],
            (block, c, "rectangular", p_duration / p, "linearized", (1.01, 4.0)),
        )
        source = f"{HOUSNER}, Eq. 9: a_p / (g alpha_c) = 1 / (1 - exp(-p T))"
        value = 9.81 * float(block.critical_angle) / -math.expm1(-p_duration)
        exact = {"from": "closed form", "source": source, "relative": 1e-8}
        yield row | exact | {"value": value, "difference": None}
    block = Block(0.2, 3.0)
    c = float(housner_restitution(Block(0.2, 3.0)))
    growing = (
        f"{MAKRIS}, Eq. 27: (w/p) sin(psi) - cos(psi) = exp(-(p/w) (pi - psi)), a_p = g alpha_c "
        "/ sin(psi), w = pi / T"
    )
    what = ["Smallest amplitude of a half-sine pulse that overturns the block."]
    (row,) = _amplitudes(
        "half-sine-linearized",
        kind,
        what,
        (block, c, "half-sine", 0.5, "linearized", (1.0, 4.0)),
    )
    yield row | {"source": f"{_BOUNDARY}; in closed form {growing}", "relative": 1e-7}
    printed = {
        "id": "half-sine-published",
        "value": 0.5545 * 9.81,
        "relative": 1e-3,
        "difference": None,
        "from": "published",
        "source": f"{MAKRIS}: 0.5535 g stands, 0.5545 g overturns; three digits",
    }
    yield row | printed
    for shape, case in (
        ("half-sine", (block, c, "half-sine", 0.5, "nonlinear", (1.0, 4.0))),
        ("ricker", (Block(0.25, 5.0), 0.85, "ricker", 0.7, "nonlinear", (1.0, 4.0))),
    ):
        what = [f"Smallest amplitude of a {shape} pulse that overturns the block."]
        yield from _amplitudes(f"{shape}-nonlinear", kind, what, case)[:1]


def _windows(_: Motions) -> Iterator[Row]:
    kind = "survival window"
    angle = 0.25
    p = 2.14
    block = Block(0.75 * 9.81 / p**2 * math.sin(angle), 1 / math.tan(angle))
    edges = [
        "Smallest amplitude of a one-sine pulse that overturns the block, after one impact.",
        "Amplitude from which on the block survives again.",
        "Amplitude above that from which on it overturns without an impact.",
    ]
    first, back, last = _amplitudes(
        "sine-linearized",
        kind,
        edges,
        (block, 0.9, "sine", 2 * math.pi / (5 * p), "linearized", (1.0, 14.0)),
    )
    source = (
        "the growing mode: p times the integral of exp(-p (t - t0)) a(t) from the uplift t0 to "
        "the end of the pulse is g alpha_c"
    )
    yield first
    yield back
    yield last | {"source": f"{_BOUNDARY}; in closed form {source}", "relative": 1e-7}
    slim = Block(*_SLIM)
    yield from _amplitudes(
        "sine-nonlinear", kind, edges, (slim, 0.9, "sine", 0.5, "nonlinear", (1.0, 10.0))
    )
    cosine = [edge.replace("one-sine", "one-cosine") for edge in edges[:2]]
    yield from _amplitudes(
        "cosine-nonlinear",
        kind,
        cosine,
        (block, 0.9, "cosine", 2 * math.pi / (3 * p), "nonlinear", (1.0, 14.0)),
    )
    (row,) = _amplitudes(
        "sine-housner",
        kind,
        edges[:1],
        (
            Block(0.5, 3.0),
            float(housner_restitution(Block(0.5, 3.0))),
            "sine",
            1.0,
            "linearized",
            (1.0, 1.6),
        ),
    )
    yield row
    yield row | {
        "id": "sine-published",
        "value": 0.4514 * 9.81,
        "relative": 1e-3,
        "difference": None,
        "from": "published",
        "source": f"{MAKRIS}: 0.4513 g stands, 0.4514 g overturns; three digits",
    }
    edge = 9.81 / 5
    for name, ratio, what in (
        (
            "before",
            3.0,
            "Whether a pulse between the first two boundaries overturns the block.",
        ),
        ("inside", 8.0 / edge, "Whether a pulse inside the window overturns the block."),
    ):
        pulse = Sine(ratio * edge, 0.5)
        yield from _driven(
            f"sine-{name}", kind, {"overturned": what}, slim, 0.9, "sine", pulse, 0.5
        )
    what = "Largest rotation inside the window: beyond alpha_c, and yet the block stands."
    yield from _driven(
        "sine-inside", kind, {"peak_rotation": what}, slim, 0.9, "sine", Sine(8.0, 0.5), 1.5
    )


def _amplitudes(
    name: str,
    kind: str,
    what: Sequence[str],
    case: tuple[Block, float, str, float, str, tuple[float, float]],
) -> list[Row]:
    """A row for each of the first boundaries along the amplitude."""
    block, c, shape, duration, equation, ratios = case
    model = _MODELS[equation]
    found = critical_amplitude(
        block, c, PULSES[shape], duration, ratios, resolution=0.02, model=model
    )
    unit = float(uplift_acceleration(block, model))
    values = np.asarray(found.value).tolist()
    marks = [unit * ratios[0], *values, unit * ratios[1]]
    between = [0.5 * (a + b) for a, b in itertools.pairwise(marks)]
    between[0] = marks[0]
    between[-1] = marks[-1]
    rows = []
    for k, sentence in enumerate(what):
        near = values[k] * _AROUND
        pulses = PULSES[shape](near, duration)
        margins = respond_batch(block, c, pulses, model=model, rtol=1e-13).margin

        rows.append(
            _row(
                name if len(what) == 1 else f"{name}-{k + 1}",
                kind,
                "critical_amplitude",
                sentence,
                block,
                values[k],
                model=equation,
                restitution=c,
                input=shape,
                duration=duration,
                low=between[k],
                high=between[k + 1],
                relative=_PULSE,
                difference=abs(_zero(near, margins) - values[k]),
                from_="converged",
                source=_BOUNDARY,
            )
        )
    return rows


def _zero(places: np.ndarray, margins: Any) -> float:
    """Where the secant through two margins is 0."""
    low, high = places.tolist()
    at_low, at_high = np.asarray(margins).tolist()
    return low - at_low * (high - low) / (at_high - at_low)


def _half_cycles(_: Motions) -> Iterator[Row]:
    kind = "half-cycle map"
    scene = Scene(Block(*_WALL), 0.7, 0.15)

    def row(
        quantity: str,
        what: str,
        value: Any,
        equation: str = "either",
        at: Scene = scene,
        **rest,
    ) -> Row:
        tail = {"linearized": "-linearized", "nonlinear": "-nonlinear", "either": ""}[equation]
        number = rest.get("number")
        name = f"train-{quantity}{'' if number is None else f'-{number}'}{tail}"
        given = {"restitution": float(at.restitution), "input": "train", "model": equation}
        if quantity != "critical_intensity":
            given["intensity"] = float(at.intensity)
        return _row(name, kind, quantity, what, at.block, value, **given | rest)

    yield row(
        "half_cycle_velocity",
        "Angular velocity with which the fifth half-cycle begins.",
        resonance.half_cycle_velocity(scene, 5),
        number=5,
        source="Eq. 8, its recursion",
    )
    yield row(
        "stabilized_velocity",
        "Limit of the angular velocity after an impact and a pulse.",
        resonance.stabilized_velocity(scene),
        source="Eq. 10",
    )
    strong = Scene(Block(*_STOCKY), 0.8, 0.3)
    for equation, model in _MODELS.items():
        at = scene if equation == "linearized" else strong
        source = "Eq. 12" if equation == "linearized" else "Eq. 10 and energy"
        for quantity, what, function in (
            (
                "stabilized_rotation",
                "Limit of the peak rotation.",
                resonance.stabilized_rotation,
            ),
            ("stabilized_period", "Limit of the full period.", resonance.stabilized_period),
            (
                "amplification",
                "Limit of the peak rotation over the one after the first pulse.",
                resonance.amplification,
            ),
        ):
            how = (
                "Eq. 11"
                if (quantity, equation) == ("stabilized_period", "linearized")
                else source
            )
            if (quantity, equation) == ("stabilized_period", "nonlinear"):
                how = "Eq. 10 and an elliptic integral of the first kind"
            yield row(quantity, what, function(at, model), equation, at, source=how)
    yield row(
        "overturning_margin",
        "Share of the energy barrier that is left in the limit.",
        resonance.overturning_margin(scene, Nonlinear()),
        "nonlinear",
        source="Eq. 10 over v_c",
    )
    large = Scene(Block(*_WALL), 0.9, 0.2)
    yield row(
        "overturning_half_cycle",
        "The half-cycle in which the block overturns.",
        resonance.overturning_half_cycle(large, Nonlinear()),
        "nonlinear",
        large,
        relative=0.0,
        source="Eq. 8 and v_c",
    )
    for equation, number in (
        ("linearized", 1),
        ("linearized", None),
        ("nonlinear", 5),
    ):
        count = "an unlimited number of" if number is None else str(number)
        yield row(
            "critical_intensity",
            f"Intensity of pulses that just overturns the block in {count} half-cycles.",
            resonance.critical_intensity(
                Block(*_WALL), 0.7, math.inf if number is None else number, _MODELS[equation]
            ),
            equation,
            number=number,
            source="Eq. 10 and v_c" if number is None else "Eq. 8 and v_c",
        )
    for c in (0.8, float(housner_restitution(Block(0.4, 4.0)))):
        block = Block(0.4, 4.0)
        name = "double-impulse" if c == 0.8 else "double-impulse-housner"
        yield row(
            "critical_intensity",
            "Intensity V of an impulse and one of -V right after the first impact that just "
            "overturn the block.",
            resonance.critical_intensity(block, c, 2, Nonlinear()),
            "nonlinear",
            Scene(block, c, 0.0),
            number=2,
            source=NABESHIMA,
        ) | {"id": name}


def _published_tables(_: Motions) -> Iterator[Row]:
    article = "C. Casapulla, On the Resonance Conditions of Rigid Rocking"
    peaks, durations, *others = read_printed_tables()["tables"]
    for table, quantity, width, slenderness in (
        (peaks, "half_cycle_peak_rotation", 0.4, 3.0),
        (durations, "half_cycle_duration", 1.2, 10.0),
    ):
        i = table["rows"].index(f"2b = {width} m")
        j = table["columns"].index(f"lambda = {slenderness:g}")
        printed = table["printed"][i][j]
        numeral = table["table"]
        yield _row(
            f"table-{numeral}-{width:g}-{slenderness:g}",
            "half-cycle map",
            quantity,
            f"The {quantity.replace('_', ' ')} after one pulse, as printed.",
            Block(width / 2, slenderness),
            float(printed),
            model="linearized",
            input="train",
            intensity=0.15,
            number=1,
            relative=0.0,
            absolute=_half_unit(printed),
            from_="published",
            source=f"{article} Blocks, Table {numeral}: {printed}",
        )
    (printed,) = others[-1]["printed"][others[-1]["rows"].index("C = 0.85")]
    yield _row(
        "table-III-0.85",
        "half-cycle map",
        "amplification",
        "The amplification, as printed.",
        Block(0.6, 4.0),
        float(printed),
        model="linearized",
        restitution=0.85,
        input="train",
        intensity=0.15,
        relative=0.0,
        absolute=_half_unit(printed),
        from_="published",
        source=f"{article} Blocks, Table III: {printed}",
    )


def _half_unit(printed: str) -> float:
    """Half a unit of the last digit printed, and a little for the rounding of that."""
    mantissa, _, exponent = printed.partition("e")
    return 0.5001 * 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))


def _driven(  # noqa: PLR0913
    name: str,
    kind: str,
    wanted: dict[str, str],
    block: Block,
    c: float,
    input_: str,
    motion: Motion,
    time: float,
    equation: str = "nonlinear",
    file: str | None = None,
    start: tuple[float, float] | None = None,
) -> Iterator[Row]:
    """Rows for what is wanted of one driven motion, by both integrators."""
    model = _MODELS[equation]
    record = isinstance(motion, Record)
    given: Any = {"rotation": start[0], "velocity": start[1]} if start else {}
    adaptive = respond(
        block, c, motion, time, rtol=1e-11, model=model, max_impacts=256, **given
    )
    if start:  # The lockstep integrator begins at rest.
        other: Any = respond(
            block, c, motion, time, rtol=1e-10, model=model, solver="Dopri8", **given
        )
        how = "adaptive Runge-Kutta pairs of order 5 at rtol 1e-11 and of order 8 at 1e-10"
    else:
        other = respond_batch(block, c, motion, time, model=model, rtol=1e-13)
        how = _CONVERGED
    strength: dict[str, Any] = {}
    if isinstance(motion, Pulse):
        strength = {"amplitude": float(motion.amplitude), "duration": float(motion.duration)}
    elif isinstance(motion, Record):
        strength = {"file": file, "scale": float(motion.scale)}
    for quantity, what in wanted.items():
        attribute = {"rotation": "final_rotation", "velocity": "final_velocity"}.get(
            quantity, quantity
        )
        counted = quantity in ("impacts", "overturned")
        value, second = (float(getattr(r, attribute)) for r in (adaptive, other))
        yield _row(
            f"{name}-{quantity}",
            kind,
            quantity,
            what,
            block,
            value,
            model=equation,
            restitution=c,
            input=input_,
            initial_rotation=start[0] if start else 0.0,
            initial_velocity=start[1] if start else 0.0,
            time=time,
            relative=0.0 if counted else _RECORD if record else _PULSE,
            difference=abs(second - value),
            from_="converged",
            source=how,
            **strength,
        )


def _under_pulses(motions: Motions) -> Iterator[Row]:
    kind = "pulse"
    block = Block(0.25, 5.0)
    sampled = motions["sampled_pulse.csv"]
    yield from _driven(
        "half-sine",
        kind,
        {
            "peak_rotation": "Largest rotation under and after a half-sine pulse.",
            "rotation": "Rotation a while after it.",
        },
        Block(*_WALL),
        0.7,
        "half-sine",
        HalfSine(4.0, 0.3),
        1.0,
    )
    yield from _driven(
        "ricker",
        kind,
        {
            "peak_rotation": "Largest rotation under a Ricker wavelet and a while after.",
            "impacts": "Number of impacts until then.",
            "margin": "Margin at the end of the wavelet.",
            "velocity": "Angular velocity at the end of the time.",
        },
        block,
        0.85,
        "ricker",
        Ricker(3.2, 0.7),
        3.2,
    )
    yield from _driven(
        "sine-linearized",
        kind,
        {"peak_rotation": "Largest rotation under a one-sine pulse, linearized."},
        block,
        0.9,
        "sine",
        Sine(3.0, 0.6),
        1.2,
        "linearized",
    )
    angle = float(block.critical_angle)
    yield from _driven(
        "sine-in-motion",
        kind,
        {
            "peak_rotation": "Largest rotation of a block in motion when a one-sine pulse comes.",
            "rotation": "Rotation at the end of the time.",
        },
        block,
        0.9,
        "sine",
        Sine(2.5, 0.6),
        1.2,
        start=(-0.3 * angle, 0.2),
    )
    yield from _driven(
        "sampled",
        kind,
        {
            "peak_rotation": "Largest rotation under a pulse given by samples.",
            "margin": "Margin at its end.",
        },
        block,
        0.85,
        "file",
        sampled.scaled(1.0),
        float(sampled.end),
        file="sampled_pulse.csv",
    )


def _under_records(motions: Motions) -> Iterator[Row]:
    kind = "record"
    peak = {"peak_rotation": "Largest rotation under the record."}
    falls = {
        "overturned": "Whether the block overturns under the record.",
        "impacts": "Number of impacts until it lies on its side.",
    }
    margin = {"margin": "Margin at the end of the record."}
    impacts = {"impacts": "Number of impacts under the record."}
    north, east, piece, _ = RECORDS
    for name, file, wanted, half_width, slenderness, c, scale in (
        ("north-1", north, peak, 0.197, 6.06, 0.9602, 0.7),
        ("north-2", north, peak, 0.365, 4.24, 0.812, 2.71),
        ("north-3", north, falls, 0.253, 6.77, 0.968, 1.48),
        ("east-and-up-1", east, peak | margin | impacts, 1.635, 6.56, 0.9659, 2.49),
        ("east-and-up-2", east, peak, 0.296, 3.05, 0.8544, 2.73),
        ("piece", piece, peak | margin, 0.2, 5.0, 0.6, 1.0),
    ):
        block = Block(half_width, slenderness)
        motion = motions[file].scaled(scale)
        yield from _driven(
            name, kind, wanted, block, c, "file", motion, float(motion.end), file=file
        )
    yield _critical_scale(Block(0.2, 5.0), 0.6, motions[piece], piece)


def _critical_scale(block: Block, c: float, motion: Record, file: str) -> Row:
    found = overturning_boundaries(block, c, motion, "factor", np.linspace(1.0, 4.0, 61))
    value = float(found.value[0])

    margins = respond_batch(block, c, motion.scaled(value * _AROUND), rtol=1e-13).margin
    return _row(
        "piece-critical_scale",
        "record",
        "critical_scale",
        "Smallest scale of the record that overturns the block.",
        block,
        value,
        model="nonlinear",
        restitution=c,
        input="file",
        file=file,
        low=value * 0.98,
        high=value * 1.02,
        relative=_RECORD,
        difference=abs(_zero(value * _AROUND, margins) - value),
        from_="converged",
        source=_BOUNDARY,
    )


def _closed_derivatives(_: Motions) -> Iterator[Row]:
    scene = Scene(Block(*_WALL), 0.7, 0.15)
    near = Scene(Block(*_STOCKY), 0.8, 0.3)
    for equation, at in (("linearized", scene), ("nonlinear", near)):
        model = _MODELS[equation]
        slopes = jax.grad(resonance.rotation_ratio)(at, model)
        for variable, value in (
            ("restitution", slopes.restitution),
            ("slenderness", slopes.block.slenderness),
            ("half_width", slopes.block.half_width),
            ("intensity", slopes.intensity),
        ):
            yield _row(
                f"d-rotation_ratio-d-{variable}-{equation}",
                "derivative",
                "rotation_ratio",
                f"Derivative of the stabilized rotation over alpha_c to the {variable}.",
                at.block,
                value,
                model=equation,
                restitution=float(at.restitution),
                input="train",
                intensity=float(at.intensity),
                variable=variable,
                relative=_EXACT_SLOPE,
                source="derivative of Eq. 12"
                if equation == "linearized"
                else "derivative of the closed form",
            )


def _driven_derivatives(motions: Motions) -> Iterator[Row]:
    piece = motions["piece.csv"]
    end = 4.0

    def under_wavelet(
        half_width: Any, slenderness: Any, restitution: Any, amplitude: Any
    ) -> Any:
        block = Block(half_width, slenderness)
        pulse = Ricker(amplitude, 0.7)
        return respond_batch(block, restitution, pulse, end).peak_rotation

    yield from _slopes(
        "ricker",
        "peak_rotation",
        "Derivative of the largest rotation under a Ricker wavelet",
        under_wavelet,
        {"half_width": 0.25, "slenderness": 5.0, "restitution": 0.85, "amplitude": 3.2},
        {"input": "ricker", "duration": 0.7, "time": end},
        how="Taylor polynomials at rtol 1e-9, differentiated",
    )

    def under_piece(restitution: Any, scale: Any) -> Any:
        motion = piece.scaled(scale)
        return respond_batch(Block(*_SLIM), restitution, motion).peak_rotation

    yield from _slopes(
        "piece",
        "peak_rotation",
        "Derivative of the largest rotation under a piece of a record",
        under_piece,
        {"restitution": 0.6, "scale": 1.0},
        {"input": "file", "file": "piece.csv", "time": float(piece.end)},
        how="Taylor polynomials at rtol 1e-9, differentiated",
    )

    def edge(restitution: Any, duration: Any) -> Any:
        found = critical_amplitude(
            Block(*_SLIM), restitution, Sine, duration, (1.0, 3.0), resolution=0.05
        )
        return found.value[..., 0]

    at = {"restitution": 0.9, "duration": 0.5}
    value = float(edge(**at))
    yield from _slopes(
        "sine",
        "critical_amplitude",
        "Derivative of the smallest amplitude of a one-sine pulse that overturns the block",
        edge,
        at,
        {"input": "sine", "low": 0.95 * value, "high": 1.05 * value},
        how="implicit function theorem on the margin",
    )


def _slopes(
    name: str,
    quantity: str,
    what: str,
    answer: Callable[..., Any],
    at: dict[str, float],
    rest: dict[str, Any],
    how: str,
) -> Iterator[Row]:
    """A row for the derivative with respect to each parameter, beside extrapolated differences."""
    numbers = jnp.asarray(list(at.values()))
    slopes = np.asarray(jax.jacfwd(lambda numbers: answer(*numbers))(numbers))
    block = Block(at.get("half_width", _SLIM[0]), at.get("slenderness", _SLIM[1]))
    for k, variable in enumerate(at):
        step = 4e-4 * at[variable]
        moved = np.tile(np.asarray(numbers)[:, None], (1, 6))
        moved[k] += step * np.array([1.0, -1.0, 0.5, -0.5, 0.25, -0.25])
        values = np.asarray(answer(*moved))
        central = (values[::2] - values[1::2]) / (step * np.array([2.0, 1.0, 0.5]))
        yield _row(
            f"d-{quantity}-d-{variable}-{name}",
            "derivative",
            quantity,
            f"{what} to the {variable}.",
            block,
            slopes[k],
            **{
                "model": "nonlinear",
                "initial_rotation": 0.0,
                "initial_velocity": 0.0,
                "variable": variable,
                "relative": _SLOPE,
                "difference": abs(float(np.dot(central, [1, -20, 64]) / 45 - slopes[k])),
                "from": "converged",
                "source": f"{how}; difference from extrapolated differences",
            }
            | {
                key: number
                for key, number in at.items()
                if key not in ("half_width", "slenderness")
            }
            | rest,
        )


_PARTS: tuple[Callable[[Motions], Iterator[Row]], ...] = (
    _geometry,
    _free_rocking,
    _thresholds,
    _windows,
    _half_cycles,
    _published_tables,
    _under_pulses,
    _under_records,
    _closed_derivatives,
    _driven_derivatives,
)


def main() -> None:
    """Compare with the frozen cases, or replace them."""
    jax.config.update("jax_enable_x64", True)
    found = list(cases())
    frozen = json.loads(FROZEN.read_text(encoding="utf-8"))
    known = {case["id"]: case for case in conformance.read_table()["cases"]}
    for case in found:
        old = known.get(case["id"])
        off = abs(case["value"] - old["value"]) if old else math.inf
        if off > 0.1 * (case["absolute"] + case["relative"] * abs(case["value"])):
            print(case["id"], case["value"], "frozen is", old and old["value"])
    if "--write" in sys.argv:
        given = [
            {key: value for key, value in case.items() if value is not None} for case in found
        ]
        lines = ",\n  ".join(map(json.dumps, given))
        head = json.dumps({key: frozen[key] for key in frozen if key != "cases"}, indent=1)[
            :-2
        ]
        FROZEN.write_text(f'{head},\n "cases": [\n  {lines}\n ]\n}}\n', encoding="utf-8")


if __name__ == "__main__":
    main()
