"""What one computes driven rocking with today, to be timed side by side with jaxrock.

`numba_loop` is the loop that an engineer writes, `scipy_events` the same for one block with
SciPy's solver, `ceiling` the bare arithmetic in C. Nonlinear blocks at rest at first, a
horizontal record with straight lines between its samples. Numba and a C compiler are
asked for on use; neither belongs to what the project needs.
"""

import ctypes
import functools
import math
import os
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

REST = 1e-6  # speed over the critical one below which a landing block stays


@functools.cache
def _compile_loop():
    import numba

    @numba.njit(inline="always")
    def acceleration(square, lean, x, u):
        return -square * (math.sin(lean - x) - u * math.cos(lean - x))

    @numba.njit(inline="always")
    def advance(square, lean, x, v, u, du, h):
        """One step of Runge and Kutta; u and du are the input in g at its start and its slope."""
        middle = u + du * h / 2
        k1 = acceleration(square, lean, x, u)
        v2 = v + h / 2 * k1
        k2 = acceleration(square, lean, x + h / 2 * v, middle)
        v3 = v + h / 2 * k2
        k3 = acceleration(square, lean, x + h / 2 * v2, middle)
        v4 = v + h * k3
        k4 = acceleration(square, lean, x + h * v3, u + du * h)
        return x + h / 6 * (v + 2 * v2 + 2 * v3 + v4), v + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)

    @numba.njit(inline="always")
    def find_impact(x, a, xn, b):
        """Where the cubic through both ends is 0, by Newton's method from a line or a bounce."""
        cubic = 2 * x + a - 2 * xn + b
        quadratic = -3 * x - 2 * a + 3 * xn - b
        part = min(-a / quadratic, 1.0) if x == 0 else x / (x - xn)
        for _ in range(8):
            value = x + part * (a + part * (quadratic + part * cubic))
            slope = a + part * (2 * quadratic + part * 3 * cubic)
            if slope == 0:
                break
            part = min(max(part - value / slope, 0.0), 1.0)
        return part

    @numba.njit(parallel=True)
    def loop(p, ac, restitution, y, time_step, gravity, steps):
        peaks = np.zeros(len(p))
        for j in numba.prange(len(p)):
            square = p[j] ** 2
            threshold = math.tan(ac[j])
            still = REST * 2 * p[j] * math.sin(ac[j] / 2)
            x = v = 0.0
            s = 1.0
            resting = True
            for n in range(steps):
                u = y[n] / gravity
                du = (y[n + 1] / gravity - u) / time_step
                left = time_step
                if resting:
                    last = u + du * time_step
                    if abs(u) <= threshold:
                        if abs(last) <= threshold:
                            continue
                        # the input lifts the block inside the step
                        lifting = math.copysign(threshold, last)
                        left -= (lifting - u) / du
                        u = lifting
                    resting = False
                    s = math.copysign(1.0, u)
                for _ in range(20):  # impacts in one step; more are rest
                    xn, vn = advance(square, ac[j] * s, x, v, u, du, left)
                    if s * xn >= 0:
                        x = xn
                        v = vn
                        break
                    hit = left * find_impact(x, left * v, xn, left * vn)
                    _, v = advance(square, ac[j] * s, x, v, u, du, hit)
                    x = 0.0
                    v = restitution[j] * v
                    s = -s
                    u += du * hit
                    left -= hit
                    if abs(v) < still and abs(u) <= threshold:
                        v = 0.0
                        resting = True
                    if resting or left <= 0:
                        break
                peaks[j] = max(peaks[j], abs(x))
                if peaks[j] > math.pi / 2:
                    break
        return peaks

    return loop


def numba_loop(p, ac, restitution, y, time_step, gravity, steps):
    """Peaks of the blocks; one step a sample, `steps` + 1 samples."""
    return _compile_loop()(p, ac, restitution, y, time_step, gravity, steps)


def scipy_events(p, ac, restitution, y, time_step, gravity, steps):
    """Peak of one block, from impact to impact; lifted at samples."""
    times = np.arange(steps + 1) * time_step
    level = y[: steps + 1] / gravity
    threshold = math.tan(ac)
    still = REST * 2 * p * math.sin(ac / 2)

    def motion(time, state, side):
        q = ac * side - state[0]
        u = np.interp(time, times, level)
        return [state[1], -(p**2) * (math.sin(q) - u * math.cos(q))]

    def impact(time, state, side):
        return side * state[0]

    def toppled(time, state, side):
        return abs(state[0]) - math.pi / 2

    impact.terminal = toppled.terminal = True
    impact.direction = -1
    time = velocity = peak = 0.0
    resting = True
    while time < times[-1] and peak < math.pi / 2:
        if resting:
            lifted = np.flatnonzero((abs(level) > threshold) & (times >= time))
            if not lifted.size:
                break
            time = times[lifted[0]]
            side = math.copysign(1.0, level[lifted[0]])
        solution = solve_ivp(
            motion,
            (time, times[-1]),
            # off the ground by a little, so that the event does not fire where it starts
            [side * 1e-14, velocity],
            events=(impact, toppled),
            args=(side,),
            rtol=1e-8,
            atol=1e-10,
            max_step=2 * time_step,
        )
        peak = max(peak, np.abs(solution.y[0]).max())
        time = solution.t[-1]
        velocity = restitution * solution.y[1, -1]
        side = -side
        resting = abs(velocity) < still and abs(np.interp(time, times, level)) <= threshold
        velocity *= not resting
    return peak


@functools.cache
def _compile_ceiling():
    target = os.path.join(tempfile.mkdtemp(), "contenders.so")
    flags = ["-O3", "-march=native", "-fopenmp", "-ffast-math", "-shared", "-fPIC"]
    command = [os.environ.get("CC", "gcc"), *flags, Path(__file__).with_suffix(".c")]
    subprocess.run([*command, "-o", target, "-lm"], check=True)
    return ctypes.CDLL(target).rock


def ceiling(p, ac, restitution, y, time_step, gravity, steps):
    """Peaks of the bare arithmetic in C: no believable figures, a bound for the time."""
    rock = _compile_ceiling()
    pointer = np.ctypeslib.ndpointer(float, flags="C")
    rock.argtypes = [ctypes.c_int, ctypes.c_int, ctypes.c_double, *[pointer] * 6]
    rock.restype = None
    level = y[: steps + 1] / gravity
    halves = np.interp(np.arange(2 * steps + 1) / 2, np.arange(steps + 1), level)
    peaks = np.empty(len(p))
    inputs = (p, ac, restitution, np.sqrt(1 + halves**2), np.arctan(halves))
    rock(len(p), steps, time_step, *map(np.ascontiguousarray, inputs), peaks)
    return peaks
