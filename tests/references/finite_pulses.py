"""The half-cycle map under pulses that last, in NumPy: what `model_error` is compared with.

Runge and Kutta's method over the pulse, the conservation of energy and Carlson's integral
after it. Time is in units of 1 / p, acceleration in units of g. The landing velocity is given
and the intensity sought that keeps it, which is smooth up to the verge of overturning.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import elliprf

import jaxrock as jr

STEPS = 96
ITERATIONS = 15
STRENGTH = {
    jr.Rectangular: np.ones_like,
    jr.HalfSine: lambda phase: np.pi / 2 * np.sin(np.pi * phase),
}


class Lasting(NamedTuple):
    """Steady rocking under pulses that last."""

    intensity: np.ndarray  # over g / p
    ratio: np.ndarray  # peak over critical angle
    period: np.ndarray  # over 1 / p
    lifted: np.ndarray  # off the ground all through the pulse, and not overturned in it


def critical_velocity(slenderness):
    """Of the nonlinear equation, over p."""
    return 2 * np.sin(0.5 * np.arctan(1 / slenderness))


def steady(slenderness, restitution, velocity, duration, shape):
    """Rocking at a landing velocity, under the pulses of this duration that keep it."""
    angle = np.arctan(1 / slenderness)
    critical = critical_velocity(slenderness)

    def end_of_pulse(intensity):
        rotation = np.zeros_like(angle)
        speed = restitution * velocity
        lifted = True
        h = duration / STEPS

        def acceleration(rotation, phase):
            push = intensity / duration * STRENGTH[shape](np.full_like(angle, phase))
            return push * np.cos(angle - rotation) - np.sin(angle - rotation)

        for k in range(STEPS):
            a = acceleration(rotation, k / STEPS)
            b = acceleration(rotation + h / 2 * speed, (k + 0.5) / STEPS)
            c = acceleration(rotation + h / 2 * (speed + h / 2 * a), (k + 0.5) / STEPS)
            d = acceleration(rotation + h * (speed + h / 2 * b), (k + 1) / STEPS)
            rotation = rotation + h * (speed + h / 6 * (a + b + c))
            speed = speed + h / 6 * (a + 2 * b + 2 * c + d)
            lifted = lifted & (rotation > 0) & (rotation < angle)
        return rotation, speed, lifted

    def excess(intensity):
        rotation, speed, _ = end_of_pulse(intensity)
        gained = 2 * np.sin(angle - 0.5 * rotation) * np.sin(0.5 * rotation)
        return np.sqrt(np.maximum(speed**2 + 2 * gained, 0)) - velocity

    unit = (1 - restitution) * velocity / np.cos(angle)
    intensity = unit
    before = 1.01 * unit
    now = excess(intensity)
    then = excess(before)
    for _ in range(ITERATIONS):  # secants
        moved = now != then
        slope = np.where(moved, now - then, 1) / np.where(moved, intensity - before, 1)
        change = np.clip(-now / slope, -0.3 * unit, 0.3 * unit)
        before = intensity
        intensity = intensity + np.where(moved, change, 0)
        then = now
        now = excess(intensity)
    rotation, speed, lifted = end_of_pulse(intensity)
    lifted = lifted & (np.abs(now) < 1e-13 * velocity)

    def to_peak(rotation, speed):
        y = np.sin(0.5 * (angle - rotation)) ** 2
        left = np.sin(0.5 * angle) ** 2 * (1 - (velocity / critical) ** 2)
        return speed / 2 * elliprf(left * (1 - left), y * (1 - left), left * (1 - y))

    period = 2 * (duration + to_peak(rotation, speed) + to_peak(0 * angle, velocity))
    # 1 - cos(angle - peak) is the energy left to the barrier.
    barrier = np.sin(0.5 * angle) * np.sqrt(1 - (velocity / critical) ** 2)
    return Lasting(intensity, 1 - 2 * np.arcsin(barrier) / angle, period, lifted)
