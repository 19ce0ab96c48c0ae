"""What one follows many blocks under one-sine pulses with today, to be timed beside jaxrock.

`numba_taylor` is a scalar loop over Taylor polynomials with the series of the sine;
`heyoka_batch` the same by heyoka, four blocks side by side, impacts as terminal events. Both
begin where the pulse lifts the block, and neither knows rest. Numba and heyoka are asked for
on use; neither belongs to what the project needs.
"""

import functools
import math

import numpy as np


@functools.cache
def _compile_loop():
    import numba

    @numba.njit(fastmath=True, inline="always")
    def evaluate(c, time, order):
        """Value of a derivative, of order 0, 1 or 2."""
        total = 0.0
        for k in range(len(c) - 1, order - 1, -1):
            factor = 1 if order == 0 else k if order == 1 else k * (k - 1)
            total = total * time + factor * c[k]
        return total

    @numba.njit(fastmath=True)
    def expand(c, sine, cosine, u, p2, tilt, rate):
        """Fills in the series of the rotation, given its first two and those of the input."""
        sine[0] = math.sin(tilt - c[0])
        cosine[0] = math.cos(tilt - c[0])
        for k in range(len(c) - 2):
            if k:
                a = b = 0.0
                for j in range(1, k + 1):
                    a -= j * c[j] * cosine[k - j]
                    b += j * c[j] * sine[k - j]
                sine[k] = a / k
                cosine[k] = b / k
            if k > 1:
                u[k] = -rate * rate * u[k - 2] / (k * (k - 1))
            total = -sine[k]
            for j in range(k + 1):
                total += u[j] * cosine[k - j]
            c[k + 2] = p2 * total / ((k + 1) * (k + 2))

    @numba.njit(fastmath=True)
    def find_root(c, low, high, order):
        """Where the rotation (order 0) or its rate (1) falls through zero, in a bracket."""
        time = 0.5 * (low + high)
        for _ in range(60):
            f = evaluate(c, time, order)
            d = evaluate(c, time, order + 1)
            if f < 0:
                high = time
            else:
                low = time
            newton = time - f / d if d < 0 else 0.5 * (low + high)
            if not low < newton < high:
                newton = 0.5 * (low + high)
            if abs(newton - time) < 1e-14 * high:
                return newton
            time = newton
        return time

    @numba.njit(parallel=True, fastmath=True)
    def run(p2, tilt, restitution, level, rate, length, end, order, tolerance):
        peaks = np.zeros(len(p2))
        for i in numba.prange(len(p2)):
            c, sine, cosine, u = np.zeros((4, order + 1))
            time = math.asin(math.tan(tilt[i]) / level[i]) / rate
            x = v = 0.0
            side = 1.0
            while time < end and x < math.pi / 2:
                acts = time < length
                u[0] = side * level[i] * math.sin(rate * time) if acts else 0.0
                u[1] = side * level[i] * rate * math.cos(rate * time) if acts else 0.0
                c[0] = x
                c[1] = v
                expand(c, sine, cosine, u, p2[i], tilt[i], rate)
                step = (length if acts else end) - time
                for k in (order - 1, order):
                    if c[k] != 0:
                        step = min(step, (tolerance * tilt[i] / abs(c[k])) ** (1 / k))
                stop = step
                lands = False
                for k in range(1, 5):  # a dip between two of these times goes unseen
                    if evaluate(c, k * step / 4, 0) < 0:
                        before = 1e-9 * step if x == 0 and k == 1 else (k - 1) * step / 4
                        stop = find_root(c, before, k * step / 4, 0)
                        lands = True
                        break
                if v >= 0 and evaluate(c, stop, 1) < 0:
                    top = evaluate(c, find_root(c, 0.0, stop, 1), 0)
                    peaks[i] = max(peaks[i], top)
                x = evaluate(c, stop, 0)
                v = evaluate(c, stop, 1)
                time = time + stop
                peaks[i] = max(peaks[i], x)
                if lands:
                    x = 0.0
                    v = -restitution[i] * v
                    side = -side
                    if not acts and v * v < 1e-16 * p2[i] * tilt[i] ** 2:
                        break
        return peaks

    return run


def numba_taylor(p, angle, restitution, level, length, end, order=12, tolerance=1e-11):
    """Peaks of blocks under one sine of amplitude `level` in units of g, from rest."""
    rate = 2 * math.pi / length
    return _compile_loop()(
        p**2, angle, restitution, level, rate, length, end, order, tolerance
    )


@functools.cache
def _make_integrator(tolerance):
    import heyoka as hy

    x, v = hy.make_vars("x", "v")
    push = hy.par[2] * hy.sin(hy.par[3] * hy.time)
    restitution = np.ones(4)
    acceleration = hy.par[0] * (push * hy.cos(hy.par[1] - x) - hy.sin(hy.par[1] - x))

    def impact(integrator, sign, lane):
        del sign
        integrator.state[0, lane] = 0.0
        integrator.state[1, lane] *= -restitution[lane]
        integrator.pars[2, lane] *= -1
        return True

    falling = hy.event_direction.negative
    integrator = hy.taylor_adaptive_batch(
        [(x, v), (v, acceleration)],
        state=np.zeros((2, 4)),
        pars=np.ones((4, 4)),
        t_events=[hy.t_event_batch(x, callback=impact, direction=falling)],
        tol=tolerance,
    )
    return integrator, restitution


def heyoka_batch(p, angle, restitution, level, length, end, tolerance=1e-9):
    """Final rotations, a multiple of four blocks; it knows no peaks."""
    integrator, restitutions = _make_integrator(tolerance)
    rate = 2 * math.pi / length
    lifted = np.arcsin(np.tan(angle) / level) / rate
    begun = 1e-5  # after uplift; on the ground the event would fire at once
    jerk = p**2 * level * rate * np.cos(rate * lifted) * np.cos(angle)
    final = np.empty(len(p))
    for k in range(0, len(p), 4):
        four = slice(k, k + 4)
        integrator.set_time(list(lifted[four] + begun))
        integrator.state[:] = jerk[four] * begun**3 / 6, jerk[four] * begun**2 / 2
        integrator.pars[:] = p[four] ** 2, angle[four], level[four], [rate] * 4
        restitutions[:] = restitution[four]
        integrator.propagate_until([length] * 4)
        integrator.pars[2] = 0.0
        integrator.propagate_until([end] * 4)
        final[four] = integrator.state[0]
    return final
