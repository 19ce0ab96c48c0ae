"""Trains of instantaneous pulses by SciPy: jumps of the velocity, DOP853's events in between."""

import math
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

LEAST = 1e-7  # velocity after an impact, below which a block rests [rad/s]
FALLEN = 1.5  # rotation of a block that has overturned [rad]


class Path(NamedTuple):
    """Rotation and velocity at the samples, NaN once it has overturned; peak and outcome."""

    rotation: np.ndarray
    velocity: np.ndarray
    peak: float
    overturned: bool


def follow_train(rocker, times, intensities, samples):
    """Follow one block of `stepping`; a sample at the time of a pulse comes after it."""
    jump = rocker.p**2 / rocker.gravity * math.cos(rocker.angle)
    alpha = velocity = peak = now = 0.0
    side = 0.0  # of a block at rest
    found = []
    stops = [*zip(times, intensities, strict=True), *((time, None) for time in samples)]
    for time, intensity in sorted(stops, key=lambda stop: (stop[0], stop[1] is None)):
        while side and now < time and peak < FALLEN:
            path = _fly(rocker, side, now, time, (alpha, velocity))
            now = path.t[-1]
            alpha, velocity = path.y[:, -1]
            peak = max(peak, *abs(path.y[0]), *(abs(y[0]) for y in path.y_events[1]))
            if path.t_events[0].size:
                alpha = 0.0
                velocity *= -rocker.c if rocker.one_sided else rocker.c
                side = side if rocker.one_sided else -side
            if alpha == 0 and abs(velocity) < LEAST:
                velocity = side = 0.0
        now = time
        if intensity is None:
            found.append((alpha, velocity) if peak < FALLEN else (np.nan, np.nan))
        elif side or not (rocker.one_sided and intensity < 0):  # else pushed into the wall
            side = side or math.copysign(1, intensity)
            turned = math.cos(rocker.angle - abs(alpha)) / math.cos(rocker.angle)
            velocity += jump * intensity * (1.0 if rocker.linearized else turned)
    return Path(*np.transpose(found), peak, peak >= FALLEN)


def _fly(rocker, side, begin, end, state):
    """Follow a block until it lands or has overturned."""

    def field(_, y):
        return [y[1], rocker.acceleration(y[0], side, (0.0, 0.0))]

    def lands(time, y):
        return side * y[0] if time > begin + 1e-9 else 1.0

    def turns(_, y):
        return y[1]

    def falls(_, y):
        return abs(y[0]) - FALLEN - 1e-6

    lands.terminal = falls.terminal = True
    lands.direction = -1
    events = (lands, turns, falls)
    return solve_ivp(
        field, (begin, end), state, "DOP853", rtol=1e-11, atol=1e-14, events=events
    )
