"""Boundaries between standing and overturning."""

import jax
import jax.numpy as jnp
import numpy as np
from scenes import record, suite

import jaxrock as jr

from .table import group, list_fields, stack_fields

OF_BOUNDARIES = "value overturns_beyond impacts toppled count overturns_first complete"
SLIM = jr.Block(0.1, 5.0)


@group("overturning/amplitude", 1e-9, by_default=True)
def search_amplitudes():
    """A window of survival, one boundary, and none."""
    cases = [(SLIM, 0.9, 0.5), (jr.Block(0.2, 4.0), 0.8, 1.0), (jr.Block(1.0, 2.0), 0.5, 0.1)]
    found = [jr.critical_amplitude(block, c, jr.Sine, time) for block, c, time in cases]
    yield from stack_fields(found, OF_BOUNDARIES)


@group("overturning/other_amplitudes", 1e-9)
def search_other_amplitudes():
    shapes = (jr.HalfSine, jr.Cosine, jr.Rectangular, jr.Ricker)
    found = [jr.critical_amplitude(SLIM, 0.9, shape, 0.6) for shape in shapes]
    wall = jr.Block(0.1, 5.0, one_sided=True)
    found += [
        jr.critical_amplitude(SLIM, 0.9, jr.Sine, 0.5, model="linearized"),
        jr.critical_amplitude(wall, -0.6, jr.Sine, 0.5),
    ]
    yield from stack_fields(found, OF_BOUNDARIES)


@group("overturning/along", 1e-9, by_default=True)
def search_along_quantities():
    ranges = {
        "factor": (0.5, 2.0),
        "duration": (0.2, 1.0),
        "half_width": (0.05, 0.3),
        "width": (0.1, 0.6),
        "height": (0.5, 3.0),
        "slenderness": (2.0, 9.0),
        "inertia_ratio": (1.05, 2.0),
        "restitution": (0.5, 1.0),
    }
    pulse = jr.Sine(6.5, 0.5)
    found = [
        jr.overturning_boundaries(SLIM, 0.9, pulse, along, np.linspace(*ends, 31))
        for along, ends in ranges.items()
    ]
    yield from stack_fields(found, OF_BOUNDARIES)


@group("overturning/duration_and_windows", 1e-9, by_default=True)
def search_durations():
    pulse = jr.Sine(3.5, 1.0)
    durations = np.geomspace(0.1, 1.5, 30)
    found = jr.overturning_boundaries(jr.Block(0.2, 5.0), 0.9, pulse, "duration", durations)
    yield from list_fields(found, OF_BOUNDARIES, "critical_duration/")
    factors = np.linspace(0.5, 2.0, 61)
    found = jr.overturning_boundaries(SLIM, 0.9, jr.Sine(6.5, 0.5), "factor", factors)
    yield "survival_windows/first_overturning", factors[0] if found.overturns_first else np.inf
    yield "survival_windows/windows", found.windows


@group("overturning/records", 1e-9)
def search_records():
    """The first boundaries, below the chaotic ones."""
    block = jr.Block(0.1, 5.0)
    motion = record()
    uplift = jr.overturning.uplift_factor(block, motion)
    yield "uplift_factor", uplift, 1e-12
    factors = float(uplift) * np.geomspace(1, 9, 25)
    found = jr.overturning_boundaries(block, 0.7, motion, "factor", factors)
    yield "critical_factor/value", found.value[:2]
    yield "critical_factor/impacts", found.impacts[:2]
    factors = np.linspace(0.2, 2.0, 10)
    found = jr.overturning_boundaries(block, 0.7, suite(), "factor", factors)
    yield "of_suite/value", found.value[:, :1]
    yield "of_suite/overturns_first", found.overturns_first


@group("overturning/derivatives", 1e-7)
def differentiate():
    def amplitude(at):
        block = jr.Block(at[0], at[1], at[4])
        return jr.critical_amplitude(block, at[2], jr.Sine, at[3]).value[0]

    at = jnp.array([0.1, 5.0, 0.9, 0.5, 9.81])
    yield "amplitude", jax.jacfwd(amplitude)(at)

    def factor(at):
        block = jr.Block(at[0], at[1])
        factors = np.linspace(0.2, 2.0, 10)
        return jr.overturning_boundaries(block, at[2], record(), "factor", factors).value[0]

    yield "factor_of_a_record", jax.jacfwd(factor)(jnp.array([0.1, 5.0, 0.7]))
