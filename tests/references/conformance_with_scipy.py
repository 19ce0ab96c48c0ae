"""The cases of the conformance table computed again, from their files alone, without jaxrock.

    python tests/references/conformance_with_scipy.py FOLDER [--only ID ...]

Closed forms in mpmath, driven motion by SciPy with events and by a plain loop, thresholds by
Brent's method, derivatives by extrapolated differences. Prints a line a case; ends with 1 if
an answer is off by more than the tolerance or could not be computed.
"""

import argparse
import csv
import functools
import json
import math
import sys
from pathlib import Path

import mpmath as mp

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parent.parent))

from scipy.optimize import brentq

from references import closed_forms, stepping

MODELS = {"linearized": closed_forms.Linearized, "nonlinear": closed_forms.Nonlinear}
SHAPES = {
    "rectangular": "Rectangular",
    "half-sine": "HalfSine",
    "sine": "Sine",
    "cosine": "Cosine",
    "ricker": "Ricker",
}
CLOSED = ("none", "train")


def block_of(case):
    return tuple(mp.mpf(case[name]) for name in ("half_width", "slenderness", "gravity"))


def scene_of(case):
    return (*block_of(case), *(mp.mpf(case[name]) for name in ("restitution", "intensity")))


def model_of(case):
    return MODELS["nonlinear" if case["model"] == "either" else case["model"]]


def launch(case):
    """Velocity with which the half-cycle asked for begins."""
    if case["input"] == "train":
        b, slenderness, gravity = block_of(case)
        intensity = mp.mpf(case["intensity"])
        c = mp.mpf(case["restitution"] or 0)
        return closed_forms.half_cycle_velocity(
            b, slenderness, gravity, c, intensity, case["number"]
        )
    if case["initial_rotation"]:
        return arrival(case) * mp.mpf(case["restitution"]) ** (case["number"] - 1)
    return mp.mpf(case["initial_velocity"])


def arrival(case):
    """Velocity with which a block released from a rotation meets the ground, by energy."""
    b, slenderness, gravity = block_of(case)
    p = closed_forms.frequency(b, slenderness, gravity)
    angle = closed_forms.critical_angle(slenderness)
    start = mp.mpf(case["initial_rotation"])
    if case["model"] == "linearized":
        return p * mp.sqrt(angle**2 - (angle - start) ** 2)
    return p * mp.sqrt(2 * (mp.cos(angle - start) - mp.cos(angle)))


def half_cycle_peak_rotation(case):
    if case["initial_rotation"] and case["model"] == "linearized":  # Housner's decay
        angle = closed_forms.critical_angle(mp.mpf(case["slenderness"]))
        first = mp.mpf(case["initial_rotation"]) / angle
        r = mp.mpf(case["restitution"]) ** 2
        left = r ** (case["number"] - 1) * (1 - (1 - first) ** 2)
        return angle * (1 - mp.sqrt(1 - left))
    return model_of(case).peak_rotation(*block_of(case), launch(case))


def half_cycle_duration(case):
    return model_of(case).half_cycle_duration(*block_of(case), launch(case))


def impact_time(case):
    speeds = [arrival(case) * mp.mpf(case["restitution"]) ** k for k in range(case["number"])]
    durations = [model_of(case).half_cycle_duration(*block_of(case), v) for v in speeds]
    return durations[0] / 2 + sum(durations[1:])


def motion(case):
    return model_of(case).motion(*block_of(case), launch(case), mp.mpf(case["time"]))


def critical_intensity(case):
    number = mp.inf if case["number"] is None else case["number"]
    c = mp.mpf(case["restitution"])
    return closed_forms.critical_intensity(model_of(case), *block_of(case), c, number)


def overturning_half_cycle(case):
    critical = model_of(case).critical_velocity(*block_of(case))
    number = 1
    while closed_forms.half_cycle_velocity(*scene_of(case), number) < critical:
        number += 1
    return number


def of_limit(name, case):
    return closed_forms.stabilized(name)(model_of(case), *scene_of(case))


ANSWERS = {
    "critical_angle": lambda case: closed_forms.critical_angle(mp.mpf(case["slenderness"])),
    "frequency_parameter": lambda case: closed_forms.frequency(*block_of(case)),
    "housner_restitution": lambda case: (
        1 - mp.mpf(1.5) / (1 + mp.mpf(case["slenderness"]) ** 2)
    ),
    "critical_velocity": lambda case: model_of(case).critical_velocity(*block_of(case)),
    "peak_rotation": half_cycle_peak_rotation,
    "half_cycle_peak_rotation": half_cycle_peak_rotation,
    "half_cycle_duration": half_cycle_duration,
    "impact_time": impact_time,
    "rotation": lambda case: motion(case)[0],
    "velocity": lambda case: motion(case)[1],
    "half_cycle_velocity": launch,
    "critical_intensity": critical_intensity,
    "stabilized_velocity": lambda case: closed_forms.half_cycle_velocity(
        *scene_of(case), mp.inf
    ),
    "overturning_half_cycle": overturning_half_cycle,
} | {
    name: functools.partial(of_limit, name)
    for name in (
        "stabilized_rotation",
        "stabilized_period",
        "rotation_ratio",
        "amplification",
        "overturning_margin",
    )
}


@functools.cache
def samples(path):
    with open(path, newline="", encoding="utf-8") as file:
        rows = [[float(field) for field in row] for row in list(csv.reader(file))[1:]]
    columns = list(zip(*rows, strict=True))
    vertical = columns[2] if len(columns) > 2 else [0.0] * len(rows)
    return columns[1], vertical, (columns[0][-1] - columns[0][0]) / (len(rows) - 1)


def driven(case, folder):
    """The outcome of `stepping`: peak, fate, impacts, final state, margin."""
    rocker = stepping.Rocker(
        case["half_width"],
        case["slenderness"],
        case["restitution"],
        case["model"] == "linearized",
        case["gravity"],
    )
    if case["input"] == "file":
        ground = stepping.record(*samples(folder / case["file"]), case["scale"])
        settle = 0.0
    else:
        ground = stepping.pulse(SHAPES[case["input"]], case["amplitude"], case["duration"])
        settle = 0.0 if case["time"] is None else max(case["time"] - ground.edges[0, -1], 0.0)
    start = (case["initial_rotation"] or 0.0, case["initial_velocity"] or 0.0)
    outcome = stepping.follow(rocker, ground, settle, start=start)
    return stepping.Outcome(*(part[0] for part in outcome))


def threshold(case, folder):
    along = case["quantity"].removeprefix("critical_")

    def margin(value):
        if case["from"] == "closed form":
            return growth(case, value)
        return driven(case | {along: value, "time": None}, folder).margin

    return brentq(margin, case["low"], case["high"], xtol=1e-11, rtol=1e-12)


def growth(case, amplitude):
    """What the growing mode of the linearized block lacks for overturning without an impact."""
    b, slenderness, gravity, duration = (
        case[name] for name in ("half_width", "slenderness", "gravity", "duration")
    )
    p = math.sqrt(0.75 * gravity / (b * math.hypot(1, slenderness)))
    need = gravity * math.atan(1 / slenderness)
    if case["input"] == "rectangular":
        return need - amplitude * -math.expm1(-p * duration)
    w = {"half-sine": 1, "sine": 2}[case["input"]] * math.pi / duration
    uplift = math.asin(min(need / amplitude, 1.0)) / w

    def integral(t):
        wave = p * math.sin(w * t) + w * math.cos(w * t)
        return -math.exp(-p * (t - uplift)) * wave / (p**2 + w**2)

    return need - p * amplitude * (integral(duration) - integral(uplift))


def answer(case, folder):
    if case["variable"] is not None:
        return derivative(case, folder)
    if case["input"] in CLOSED:
        return ANSWERS[case["quantity"]](case)
    if case["quantity"] in ("critical_amplitude", "critical_scale"):
        return threshold(case, folder)
    outcome = driven(case, folder)
    return {
        "peak_rotation": outcome.peak,
        "rotation": outcome.rotation,
        "velocity": outcome.velocity,
        "margin": outcome.margin,
        "impacts": int(outcome.impacts),
        "overturned": float(outcome.overturned),
    }[case["quantity"]]


def derivative(case, folder):
    """By central differences at three steps; what is left is of sixth order in them."""
    variable = case["variable"]
    step = 4e-4 * case[case["variable"]]

    def central(h):
        high, low = (
            answer(case | {variable: case[variable] + s * h, "variable": None}, folder)
            for s in (1, -1)
        )
        return (high - low) / (2 * h)

    return (central(step) - 20 * central(step / 2) + 64 * central(step / 4)) / 45


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", nargs="+", metavar="ID", help="names of cases")
    given = parser.parse_args(arguments)
    mp.mp.dps = 40
    cases = json.loads((given.folder / "cases.json").read_text(encoding="utf-8"))["cases"]
    if given.only:
        missing = set(given.only) - {case["id"] for case in cases}
        if missing:
            parser.error(f"there is no case {', '.join(sorted(missing))}")
        cases = [case for case in cases if case["id"] in given.only]
    print(f"{'id':44} {'value':>18} {'own value':>18} {'deviation':>10} {'tolerance':>10}  ok")
    off = []
    for case in cases:
        value = case["value"]
        tolerance = case["absolute"] + case["relative"] * abs(value)
        try:
            own = float(answer(case, given.folder))
        except Exception as error:  # whatever it is, the case counts as not computed
            print(f"{case['id']:44} could not be computed: {error!r}", flush=True)
            off.append(case["id"])
            continue
        good = abs(own - value) <= tolerance
        print(
            f"{case['id']:44} {value:18.12g} {own:18.12g} {own - value:10.1e} {tolerance:10.1e}"
            f"  {'yes' if good else 'NO'}",
            flush=True,
        )
        if not good:
            off.append(case["id"])
    print(f"{len(cases) - len(off)} of {len(cases)} agree")
    if off:
        print("off:", ", ".join(off))
    return 1 if off else 0


if __name__ == "__main__":
    sys.exit(main())
