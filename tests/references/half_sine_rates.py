"""Rates of overturning in closed form: half-sine pulses overturn beyond one boundary each.

A linearized block under a half-sine pulse overturns without an impact, beyond the level at which
alpha' + p (alpha - alpha_c) = 0 at the end of the pulse. Levels of acceleration and of velocity
are proportional for a pulse.
"""

import mpmath
import numpy as np

import jaxrock as jr

DURATIONS = (0.4, 0.7, 1.1)
# the hazard is OFTEN / level**POWER
OFTEN = 2e-4
POWER = 2.3


def pulses(samples):
    """A suite of the pulses as records of so many straight lines."""
    along = np.sin(np.linspace(0, np.pi, samples + 1))
    return jr.Suite([jr.Record(along, duration / samples) for duration in DURATIONS])


# Log-log linear, a power is the curve between two points.
_ENDS = np.array([1e-3, 1e5])
hazard = jr.risk.Hazard(_ENDS, OFTEN * _ENDS**-POWER)


def verge(measure, duration, half_width, slenderness, inertia_ratio):
    """The boundary in levels of PGA or PGV, from alpha' + p (alpha - alpha_c) = 0 at the end."""
    numbers = map(mpmath.mpf, (duration, half_width, slenderness, inertia_ratio))
    duration, half_width, slenderness, inertia_ratio = numbers
    angle = mpmath.acot(slenderness)
    gravity = mpmath.mpf("9.81")
    w = mpmath.pi / duration
    p = mpmath.sqrt(gravity * mpmath.sin(angle) / (inertia_ratio * half_width))

    def at_the_end(beta):
        uplift = mpmath.asin(1 / beta) / w
        start = mpmath.exp(-p * uplift)
        end = mpmath.exp(-p * duration)
        pushed = start * (p / beta + w * mpmath.cos(w * uplift)) + w * end
        return p * beta * pushed / (p**2 + w**2) - start

    beta = mpmath.findroot(at_the_end, (1.001, 60), solver="anderson", tol=1e-60)
    return beta * gravity * angle * (1 if measure == "pga" else 2 / w)


def closed_rate(measure, *shape, often=OFTEN, power=POWER):
    """The yearly rate of a block of this half-width, slenderness and inertia ratio."""
    return sum(often * verge(measure, d, *shape) ** -power for d in DURATIONS) / len(DURATIONS)
