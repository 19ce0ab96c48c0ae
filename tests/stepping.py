"""Driven rocking again, twice, without JAX: a plain loop, and SciPy with events.

The plain loop takes fixed Runge-Kutta steps and starts afresh at every impact and every
kink of the input; SciPy's DOP853 at every impact and every jump. ``python
tests/stepping.py`` searches the shipped record for cases in which two step sizes agree.
"""

import csv
import itertools
import math
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

GRAVITY = 9.81
CASES = Path(__file__).parent / "ridgecrest_cases.csv"


class Piece(NamedTuple):
    """A stretch of the input without jumps or kinks."""

    begin: float
    end: float
    ground: Callable  # time -> horizontal, vertical acceleration


class Outcome(NamedTuple):
    peak: float
    overturned: bool
    impacts: list
    rotation: float
    velocity: float
    margin: float


SHAPES = {
    "Rectangular": lambda x: 1.0,
    "HalfSine": lambda x: math.sin(math.pi * x),
    "Sine": lambda x: math.sin(2 * math.pi * x),
    "Cosine": lambda x: math.cos(2 * math.pi * x),
    "Ricker": lambda x: (1 - 2 * (math.pi * (x - 2)) ** 2) * math.exp(-((math.pi * (x - 2)) ** 2)),
}


def pulse(shape, amplitude, duration, parts=1):
    """A pulse from time 0 on, in equal parts."""
    of, length = SHAPES[shape], duration * (4 if shape == "Ricker" else 1)
    edges = [length * k / parts for k in range(parts + 1)]
    return [
        Piece(a, b, lambda t: (amplitude * of(t / duration), 0.0))
        for a, b in itertools.pairwise(edges)
    ]


def record(horizontal, vertical, step):
    """A record, a piece each sample."""

    def line(k):
        begin, h0, v0 = k * step, horizontal[k], vertical[k]
        h1, v1 = (horizontal[k + 1] - h0) / step, (vertical[k + 1] - v0) / step
        return Piece(begin, begin + step, lambda t: (h0 + h1 * (t - begin), v0 + v1 * (t - begin)))

    return [line(k) for k in range(len(horizontal) - 1)]


class Rocker:
    """The equation of motion, and what energy says of the fate."""

    def __init__(self, half_width, slenderness, restitution, linearized=False):
        self.angle = math.atan(1 / slenderness)
        self.p = math.sqrt(0.75 * GRAVITY / (half_width * math.hypot(1, slenderness)))
        self.c, self.linearized = restitution, linearized
        self.tangent = self.angle if linearized else math.tan(self.angle)

    def acceleration(self, alpha, side, ground):
        horizontal, vertical = ground
        q = self.angle * side - alpha
        if self.linearized:
            return -(self.p**2) * ((1 + vertical / GRAVITY) * q - horizontal / GRAVITY)
        return -(self.p**2) * (
            (1 + vertical / GRAVITY) * math.sin(q) - horizontal / GRAVITY * math.cos(q)
        )

    def lifted(self, ground):
        horizontal, vertical = ground
        return abs(horizontal) > (GRAVITY + vertical) * self.tangent

    def margin(self, alpha, velocity, side):
        rest = self.angle - side * alpha
        back = self.p * rest if self.linearized else 2 * self.p * math.sin(rest / 2)
        half = self.angle if self.linearized else 2 * math.sin(self.angle / 2)
        critical = self.p * half
        landing = math.sqrt(max(velocity**2 + critical**2 - back**2, 0))
        return min((back - side * velocity) / critical, 1 - self.c * landing / critical)


def loop(rocker, pieces, substeps, negligible=1e-9, settle=0.0):
    """Fixed steps by Runge-Kutta, `substeps` a piece; then `settle` seconds of free motion."""
    alpha = velocity = peak = 0.0
    side, resting, impacts = 1, True, []
    margin, free = None, []
    if settle:
        last = pieces[-1].end
        count = math.ceil(settle / 0.002)
        edges = [last + settle * k / count for k in range(count + 1)]
        free = [Piece(a, b, lambda t: (0.0, 0.0)) for a, b in itertools.pairwise(edges)]

    def advance(t, h, alpha, velocity):
        def f(t, x):
            return rocker.acceleration(x, side, piece.ground(t))

        k1 = f(t, alpha)
        k2 = f(t + h / 2, alpha + h / 2 * velocity)
        k3 = f(t + h / 2, alpha + h / 2 * (velocity + h / 2 * k1))
        k4 = f(t + h, alpha + h * (velocity + h / 2 * k2))
        return (
            alpha + h * velocity + h * h / 6 * (k1 + k2 + k3),
            velocity + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4),
        )

    for piece in pieces + free:
        if margin is None and piece.begin >= pieces[-1].end:
            margin = rocker.margin(alpha, velocity, side)
        h0 = (piece.end - piece.begin) / (substeps if piece.begin < pieces[-1].end else 1)
        t = piece.begin
        while t < piece.end - 1e-12:
            if resting:
                if not rocker.lifted(piece.ground(t)):
                    if not rocker.lifted(piece.ground(piece.end)):
                        t = piece.end
                        continue
                    low, high = t, piece.end
                    while high - low > 4e-16 * high:
                        middle = 0.5 * (low + high)
                        if middle in (low, high):
                            break
                        low, high = (
                            (low, middle) if rocker.lifted(piece.ground(middle)) else (middle, high)
                        )
                    t = high
                side = 1 if piece.ground(t)[0] > 0 else -1
                resting = False
                continue
            h = min(h0, piece.end - t)
            # No step over more than a quarter of the arc of a small bounce.
            push = abs(rocker.acceleration(alpha, side, piece.ground(t)))
            if alpha == 0 and velocity != 0 and push > 0:
                h = min(h, 0.5 * abs(velocity) / push)
            there, speed = advance(t, h, alpha, velocity)
            if side * there < 0:
                low, high = 0.0, h
                for _ in range(60):
                    middle = 0.5 * (low + high)
                    if side * advance(t, middle, alpha, velocity)[0] > 0:
                        low = middle
                    else:
                        high = middle
                h = high
                _, speed = advance(t, h, alpha, velocity)
                impacts.append((t + h, speed))
                there, speed, side = 0.0, rocker.c * speed, -side
                onward = side * rocker.acceleration(0.0, side, piece.ground(t + h))
                bounces = 2 * abs(speed) * rocker.p
                if onward < 0 and bounces <= negligible * -onward * (1 - rocker.c):
                    resting, speed = True, 0.0
            elif velocity * speed < 0 and side * velocity > 0:
                low, high = 0.0, h
                for _ in range(60):
                    middle = 0.5 * (low + high)
                    if side * advance(t, middle, alpha, velocity)[1] > 0:
                        low = middle
                    else:
                        high = middle
                peak = max(peak, abs(advance(t, high, alpha, velocity)[0]))
            t, alpha, velocity = t + h, there, speed
            peak = max(peak, abs(alpha))
            if abs(alpha) >= math.pi / 2:
                return Outcome(math.pi / 2, True, impacts, alpha, velocity, -1.0)
    if margin is None:
        margin = rocker.margin(alpha, velocity, side)
    return Outcome(peak, margin < 0, impacts, alpha, velocity, margin)


def with_events(rocker, pieces, settle=0.0, rtol=1e-12, start=(0.0, 0.0)):
    """SciPy's DOP853, restarted at every impact; for pulses."""
    alpha, velocity = start
    peak, impacts, margin = abs(alpha), [], None
    side, resting = (-1 if (alpha or velocity) < 0 else 1), start == (0.0, 0.0)
    last = pieces[-1].end
    for piece in [*pieces, Piece(last, last + settle, lambda t: (0.0, 0.0))]:
        if margin is None and piece.begin >= last:
            margin = rocker.margin(alpha, velocity, side)
        t = piece.begin
        if resting:
            times = np.linspace(piece.begin, piece.end, 2001)
            first = next((s for s in times if rocker.lifted(piece.ground(s))), None)
            if first is None:
                continue
            low, high = max(piece.begin, first - (times[1] - times[0])), first
            while low < 0.5 * (low + high) < high and not rocker.lifted(piece.ground(low)):
                middle = 0.5 * (low + high)
                low, high = (low, middle) if rocker.lifted(piece.ground(middle)) else (middle, high)
            t = low if rocker.lifted(piece.ground(low)) else high
            side, resting = (1 if piece.ground(t)[0] > 0 else -1), False
        while t < piece.end - 1e-13:

            def field(tau, y, t=t, side=side, piece=piece):
                return [y[1], rocker.acceleration(y[0], side, piece.ground(t + tau))]

            def ground(tau, y, side=side):
                return side * y[0] if tau > 1e-9 else 1.0

            def top(tau, y, side=side):
                return side * y[1] if tau > 1e-9 else 1.0

            def fallen(tau, y):
                return math.pi / 2 - abs(y[0])

            for event in (ground, fallen):
                event.terminal = True
            ground.direction = top.direction = -1
            solution = solve_ivp(
                field,
                (0, piece.end - t),
                [alpha, velocity],
                "DOP853",
                rtol=rtol,
                atol=1e-3 * rtol,
                events=(ground, top, fallen),
                max_step=0.02,
            )
            alpha, velocity = solution.y[:, -1]
            t = piece.end if solution.status == 0 else t + solution.t[-1]
            peak = max([peak, abs(alpha), *(abs(y[0]) for y in solution.y_events[1])])
            if solution.t_events[2].size:
                return Outcome(math.pi / 2, True, impacts, alpha, velocity, -1.0)
            if solution.t_events[0].size:
                impacts.append((t, velocity))
                alpha, velocity, side = 0.0, rocker.c * velocity, -side
                if abs(velocity) < 1e-7 * rocker.p:
                    resting, velocity = True, 0.0
                    break
    if margin is None:
        margin = rocker.margin(alpha, velocity, side)
    return Outcome(peak, margin < 0, impacts, alpha, velocity, margin)


def _case(arguments):
    half_width, slenderness, restitution, component, vertical, scale, samples = arguments
    rocker = Rocker(half_width, slenderness, restitution)
    horizontal = samples[0 if component == "east" else 1] * scale
    up = samples[2] * scale * vertical
    pieces = record(horizontal.tolist(), up.tolist(), 0.01)
    coarse, fine = (loop(rocker, pieces, n) for n in (4, 8))
    stable = coarse.overturned == fine.overturned
    if not fine.overturned:
        stable = stable and fine.peak > 0 and abs(coarse.peak / fine.peak - 1) < 1e-6
    return (*arguments[:-1], repr(fine.peak), int(fine.overturned), len(fine.impacts), int(stable))


def main():
    """Search for cases at random and write them."""
    rng = np.random.default_rng(1)
    file = Path(__file__).parent.parent / "jaxrock" / "data" / "ridgecrest_2019_clc.csv"
    samples = np.loadtxt(file, delimiter=",", skiprows=6).T * 9.80665
    jobs = []
    for k in range(int(sys.argv[1]) if len(sys.argv) > 1 else 160):
        slenderness = round(float(rng.uniform(2, 9)), 2)
        housner = round(1 - 1.5 / (1 + slenderness**2), 4)
        restitution = housner if k % 3 == 0 else round(float(rng.uniform(0.5, 0.95)), 3)
        half_width = round(float(10 ** rng.uniform(-1.3, 0.3)), 3)
        scale = round(float(rng.uniform(0.4, 3)), 2)
        component = "east" if rng.random() < 0.5 else "north"
        jobs.append((half_width, slenderness, restitution, component, k % 2, scale, samples))
    with ProcessPoolExecutor(2) as pool:
        rows = list(pool.map(_case, jobs))
    names = "half_width slenderness restitution component vertical scale peak_rotation overturned"
    with open(CASES, "w", newline="", encoding="utf-8") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow([*names.split(), "impacts", "stable"])
        writer.writerows(row for row in rows if float(row[6]) > 0)


if __name__ == "__main__":
    main()
