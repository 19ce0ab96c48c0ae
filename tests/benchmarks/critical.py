"""Critical pulses by the hundred thousand, beside a loop over SciPy's brentq.

``python tests/benchmarks/critical.py``: the intensity that just overturns in five half-cycles,
in closed form, and in driven motion every critical amplitude of half-sine pulses in ratios from
1 to 10, where brentq looks for one in a bracket that it is given.
"""

import math
import time

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from timing import measure

import jaxrock as jr

NUMBER = 100_000
FEW = 20
GRAVITY = 9.81


def solve_closed_form(b, slenderness, c, count, linearized):
    """The intensity at which a loop over half-cycles reaches the critical velocity."""
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


def solve_driven(b, slenderness, duration, bracket):
    """The amplitude that leaves no energy to the barrier; no impact comes before."""
    angle = math.atan(1 / slenderness)
    square = 0.75 * GRAVITY / (b * math.hypot(1, slenderness))

    def margin(amplitude):
        def field(t, y):
            push = amplitude * math.sin(math.pi * t / duration) / GRAVITY
            return [y[1], square * (push * math.cos(angle - y[0]) - math.sin(angle - y[0]))]

        uplift = math.asin(GRAVITY / slenderness / amplitude) / math.pi * duration
        span = (uplift, duration)
        end = solve_ivp(field, span, [0.0, 0.0], "DOP853", rtol=1e-10, atol=1e-13)
        rotation, velocity = end.y[:, -1]
        return 4 * square * math.sin((angle - rotation) / 2) ** 2 - velocity**2

    return brentq(margin, *bracket, xtol=1e-10)


def print_row(name, seconds, found, solve, indices):
    """Print the time of jaxrock, and that of brentq for as many, from a few."""
    begin = time.perf_counter()
    others = np.array([solve(k) for k in indices])
    theirs = (time.perf_counter() - begin) / len(indices) * NUMBER
    error = np.abs(found[indices] / others - 1).max()
    print(f"{name:34}{seconds:10.4g} s{theirs:10.4g} s{theirs / seconds:10.0f}{error:10.1e}")


def main():
    """Print the table."""
    random = np.random.default_rng(0)
    ranges = ((0.1, 1), (3, 8), (0.5, 0.95), (0.3, 1.0))
    b, slenderness, c, duration = (random.uniform(*ends, NUMBER) for ends in ranges)
    block = jr.Block(b, slenderness)
    print(f"{'':34}{'jaxrock':>12}{'brentq':>12}{'ratio':>10}{'agree to':>10}")
    for model in (jr.Linearized(), jr.Nonlinear()):
        compiled = jax.jit(lambda *at, model=model: jr.critical_intensity(*at, 5.0, model))

        def solve(k, linearized=model.name == "linearized"):
            return solve_closed_form(b[k], slenderness[k], c[k], 5, linearized)

        seconds = measure(lambda compiled=compiled: compiled(block, c))
        found = np.asarray(compiled(block, c))
        print_row(f"intensity, {model.name}", seconds, found, solve, range(50 * FEW))
    boundaries = jr.critical_amplitude(block, c, jr.HalfSine, duration)
    seconds = measure(lambda: jr.critical_amplitude(block, c, jr.HalfSine, duration).value, 3)
    found = np.asarray(boundaries.value[:, 0])
    without_impact = np.flatnonzero(np.asarray(boundaries.impacts[:, 0]) == 0)[:FEW]

    def solve(k):
        bracket = 0.9 * found[k], 1.1 * found[k]
        return solve_driven(b[k], slenderness[k], duration[k], bracket)

    print_row("half-sine amplitude, SciPy", seconds, found, solve, without_impact)
    count = np.asarray(boundaries.count)
    print(f"{count.sum()} boundaries of {NUMBER} blocks, at most {count.max()} of one")


if __name__ == "__main__":
    main()
