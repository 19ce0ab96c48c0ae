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
import pathlib
import subprocess
import tempfile

import numpy as np
from scipy.integrate import solve_ivp

REST = 1e-6  # speed over the critical one below which a landing block stays


@functools.cache
def _compiled():
    try:
        import numba
    except ImportError as error:
        raise ImportError(
            "the loop in Numba needs numba, which jaxrock does not: pip install numba"
        ) from error

    @numba.njit(fastmath=False, inline="always")
    def acceleration(square, lean, x, u):
        return -square * (math.sin(lean - x) - u * math.cos(lean - x))

    @numba.njit(fastmath=False, inline="always")
    def advance(square, lean, x, v, u, du, h):
        """One step of Runge and Kutta; u and du are the input in g at its start and its slope."""
        middle = u + du * h / 2
        last = u + du * h
        k1 = acceleration(square, lean, x, u)
        v2 = v + h / 2 * k1
        k2 = acceleration(square, lean, x + h / 2 * v, middle)
        v3 = v + h / 2 * k2
        k3 = acceleration(square, lean, x + h / 2 * v2, middle)
        v4 = v + h * k3
        k4 = acceleration(square, lean, x + h * v3, last)
        return x + h / 6 * (v + 2 * v2 + 2 * v3 + v4), v + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)

    @numba.njit(parallel=True, fastmath=False)
    def loop(p, ac, restitution, y, time_step, gravity, steps):
        blocks = len(p)
        peaks = np.zeros(blocks)
        overturned = np.zeros(blocks, np.bool_)
        impacts = np.zeros(blocks, np.int64)
        for j in numba.prange(blocks):
            square = p[j] ** 2
            angle = ac[j]
            threshold = math.tan(angle)
            still = REST * 2 * p[j] * math.sin(angle / 2)
            x = 0.0
            v = 0.0
            s = 1.0
            peak = 0.0
            resting = True
            for n in range(steps):
                u = y[n] / gravity
                du = (y[n + 1] / gravity - u) / time_step
                left = time_step
                if resting:
                    if abs(u) <= threshold:
                        last = u + du * time_step
                        if abs(last) <= threshold:
                            continue
                        # the input lifts the block inside the step
                        wait = (math.copysign(threshold, last) - u) / du
                        left -= wait
                        u = math.copysign(threshold, last)
                    resting = False
                    s = math.copysign(1.0, u)
                for _ in range(20):  # impacts in one step; more are rest
                    lean = angle * s
                    xn, vn = advance(square, lean, x, v, u, du, left)
                    if s * xn >= 0:
                        x = xn
                        v = vn
                        break
                    # The impact on the cubic through both ends, by Newton's method from
                    # the line between them, or from the time that a bounce takes.
                    a = left * v
                    b = left * vn
                    cubic = 2 * x + a - 2 * xn + b
                    quadratic = -3 * x - 2 * a + 3 * xn - b
                    part = min(-a / quadratic, 1.0) if x == 0 else x / (x - xn)
                    for _ in range(8):
                        value = x + part * (a + part * (quadratic + part * cubic))
                        slope = a + part * (2 * quadratic + part * 3 * cubic)
                        if slope == 0:
                            break
                        part = min(max(part - value / slope, 0.0), 1.0)
                    hit = part * left
                    _, v = advance(square, lean, x, v, u, du, hit)
                    impacts[j] += 1
                    x = 0.0
                    v = restitution[j] * v
                    s = -s
                    u += du * hit
                    left -= hit
                    if abs(v) < still and abs(u) <= threshold:
                        v = 0.0
                        resting = True
                        break
                    if left <= 0:
                        break
                peak = max(peak, abs(x))
                if peak > math.pi / 2:
                    overturned[j] = True
                    break
            peaks[j] = peak
        return peaks, overturned, impacts

    return loop


def numba_loop(p, ac, restitution, y, time_step, gravity, steps):
    """Peaks, overturned, and impacts of the blocks; one step a sample, `steps` + 1 samples."""
    return _compiled()(p, ac, restitution, y, time_step, gravity, steps)


def scipy_events(
    p, ac, restitution, y, time_step, gravity, steps, method="RK45", rtol=1e-8, atol=1e-10
):
    """Peak, overturned, and impacts of one block."""
    times = np.arange(steps + 1) * time_step
    end = times[-1]
    threshold = math.tan(ac)
    still = REST * 2 * p * math.sin(ac / 2)
    level = np.asarray(y[: steps + 1], float) / gravity
    side = 1.0

    def motion(time, state):
        q = ac * side - state[0]
        u = np.interp(time, times, level)
        return [state[1], -(p**2) * (math.sin(q) - u * math.cos(q))]

    def impact(time, state):
        return side * state[0]

    def over(time, state):
        return abs(state[0]) - math.pi / 2

    impact.terminal = True
    impact.direction = -1
    over.terminal = True
    time = 0.0
    velocity = 0.0
    peak = 0.0
    impacts = 0
    resting = True
    while time < end:
        if resting:
            later = np.flatnonzero((np.abs(level) > threshold) & (times > time))
            if len(later) == 0:
                break
            n = later[0]
            before = max(n - 1, 0)
            sign = math.copysign(1.0, level[n])
            if sign * level[before] < threshold:
                rise = (level[n] - level[before]) / time_step
                lift = times[before] + (sign * threshold - level[before]) / rise
            else:
                lift = times[before]
            time = max(lift, time)
            velocity = 0.0
            side = sign
            resting = False
        # off the ground by a little, so that the event does not fire where it starts
        start = [side * 1e-14, velocity]
        longest = time_step if velocity == 0 else 2 * time_step
        result = solve_ivp(
            motion,
            (time, end),
            start,
            method,
            events=(impact, over),
            rtol=rtol,
            atol=atol,
            max_step=longest,
        )
        peak = max(peak, np.abs(result.y[0]).max())
        if len(result.t_events[1]):
            return peak, True, impacts
        if not len(result.t_events[0]):
            break
        impacts += 1
        time = result.t[-1]
        velocity = restitution * result.y[1, -1]
        side = -side
        if abs(velocity) < still and abs(np.interp(time, times, level)) <= threshold:
            resting = True
    return peak, False, impacts


@functools.cache
def _library():
    source = pathlib.Path(__file__).with_suffix(".c")
    folder = tempfile.mkdtemp()
    target = os.path.join(folder, "contenders.so")
    flags = ["-O3", "-march=native", "-fopenmp", "-ffast-math", "-shared", "-fPIC"]
    try:
        subprocess.run(
            [os.environ.get("CC", "gcc"), *flags, source, "-o", target, "-lm"], check=True
        )
    except FileNotFoundError as error:
        raise FileNotFoundError(
            "the ceiling needs a C compiler, gcc or the one in CC"
        ) from error
    return ctypes.CDLL(target)


def ceiling(p, ac, restitution, y, time_step, gravity, steps):
    """Peaks of the bare arithmetic in C: no believable figures, a bound for the time."""
    pointer = np.ctypeslib.ndpointer(float, flags="C")
    rock = _library().rock
    rock.argtypes = [ctypes.c_int, ctypes.c_int, ctypes.c_double, *[pointer] * 6]
    rock.restype = None
    p, ac, restitution = (np.ascontiguousarray(a, float) for a in (p, ac, restitution))
    level = np.asarray(y[: steps + 1], float) / gravity
    halves = np.empty(2 * steps + 1)
    halves[::2] = level
    halves[1::2] = (level[1:] + level[:-1]) / 2
    peaks = np.empty(len(p))
    root = np.sqrt(1 + halves**2)
    shift = np.arctan(halves)
    rock(len(p), steps, time_step, p, ac, restitution, root, shift, peaks)
    return peaks
