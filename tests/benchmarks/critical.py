"""Critical pulses by the hundred thousand, beside a loop over SciPy's brentq.

``python tests/benchmarks/critical.py``: on the closed-form kinds the intensity that just
overturns in five half-cycles, in driven motion every critical amplitude of half-sine pulses
in ratios from 1 to 10, where brentq looks for one in a bracket that it is given.
"""

import math
import sys
import time
from pathlib import Path

import jax
import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

sys.path.insert(0, str(Path(__file__).parent.parent))
from references import stepping

import jaxrock as jr

NUMBER = 100_000
FEW = 20
GRAVITY = 9.81


def median(function, times=25):
    function()
    taken = []
    for _ in range(times):
        begin = time.perf_counter()
        jax.block_until_ready(function())
        taken.append(time.perf_counter() - begin)
    return float(np.median(taken))


def closed_form_by_brentq(b, slenderness, c, count, linearized):
    angle = math.atan(1 / slenderness)
    p = math.sqrt(0.75 * GRAVITY / (b * math.hypot(1, slenderness)))
    critical = p * angle if linearized else 2 * p * math.sin(angle / 2)

    def excess(intensity):
        launch = 0.75 * slenderness / (1 + slenderness**2) * intensity / b
        velocity = 0.0
        for _ in range(count):
            velocity = c * velocity + launch
        return velocity - critical

    return brentq(excess, 0, 100, xtol=1e-14)


def driven_by_brentq(b, slenderness, c, duration, bracket, watched):
    """Watching for impacts or not: none comes before a half-sine pulse overturns a block."""
    angle = math.atan(1 / slenderness)
    square = 0.75 * GRAVITY / (b * math.hypot(1, slenderness))
    rocker = stepping.Rocker(b, slenderness, c)

    def margin(amplitude):
        t = math.asin(GRAVITY / slenderness / amplitude) / math.pi * duration
        y = [0.0, 0.0]
        side = 1
        while True:

            def field(t, y, side=side):
                push = amplitude * math.sin(math.pi * t / duration)
                q = angle * side - y[0]
                return [y[1], square * (push / GRAVITY * math.cos(q) - math.sin(q))]

            def landing(t, y, side=side):
                return side * y[0] + 1e-15

            landing.terminal = True
            landing.direction = -1
            end = solve_ivp(
                field, (t, duration), y, "DOP853", rtol=1e-10, atol=1e-13,
                events=landing if watched else None,
            )  # fmt: skip
            if not (watched and end.t_events[0].size):
                return rocker.margin(*end.y[:, -1], side)
            t = end.t[-1]
            y = [0.0, c * end.y[1, -1]]
            side = -side

    return brentq(margin, *bracket, xtol=1e-10)


def main():
    jax.config.update("jax_enable_x64", True)
    rng = np.random.default_rng(0)
    b = rng.uniform(0.1, 1, NUMBER)
    slenderness = rng.uniform(3, 8, NUMBER)
    c = rng.uniform(0.5, 0.95, NUMBER)
    duration = rng.uniform(0.3, 1.0, NUMBER)
    block = jr.Block(b, slenderness)
    print(f"{'':34}{'jaxrock':>12}{'brentq':>12}{'ratio':>10}{'agree to':>10}")

    def row(name, ours, theirs, error):
        print(f"{name:34}{ours:10.4g} s{theirs:10.4g} s{theirs / ours:10.0f}{error:10.1e}")

    for model in (jr.Linearized(), jr.Nonlinear()):
        found = np.asarray(jr.critical_intensity(block, c, 5.0, model))
        compiled = jax.jit(lambda *at, model=model: jr.critical_intensity(*at, 5.0, model))
        ours = median(lambda compiled=compiled: compiled(block, c))
        begin = time.perf_counter()
        few = 50 * FEW
        others = [
            closed_form_by_brentq(b[k], slenderness[k], c[k], 5, model == jr.Linearized())
            for k in range(few)
        ]
        theirs = (time.perf_counter() - begin) / few * NUMBER
        row(f"intensity, {model}", ours, theirs, np.abs(found[:few] / others - 1).max())

    def driven():
        return jr.critical_amplitude(block, c, jr.HalfSine, duration)

    found = driven()
    ours = median(driven, 3)
    edge = np.asarray(found.value[:, 0])
    single = np.flatnonzero(np.asarray(found.impacts[:, 0]) == 0)[:FEW]
    for name, watched in (("", False), (" with events", True)):
        begin = time.perf_counter()
        others = [
            driven_by_brentq(
                b[k],
                slenderness[k],
                c[k],
                duration[k],
                (0.9 * edge[k], 1.1 * edge[k]),
                watched,
            )
            for k in single
        ]
        theirs = (time.perf_counter() - begin) / FEW * NUMBER
        error = np.abs(edge[single] / others - 1).max()
        row(f"half-sine amplitude, SciPy{name}", ours, theirs, error)
    count = np.asarray(found.count)
    print(f"{count.sum()} boundaries of {NUMBER} blocks, at most {count.max()} of one")


if __name__ == "__main__":
    main()
