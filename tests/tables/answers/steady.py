"""Periodic driven motion: pulses of finite duration, harmonic floors."""

import jax
import jax.numpy as jnp
import numpy as np

import jaxrock as jr

from .half_cycle_map import spread
from .table import group, list_fields, stack_fields

OF_ORBIT = (
    "launch_velocity phase peak_rotation rotation_ratio multipliers trace determinant exists"
    " stable symmetry_broken below_uplift"
)
OF_PHASE = (
    "velocity rate period peak_rotation rotation_ratio stands from_rest settles overturns"
)
OF_THRESHOLD = "amplitude intensity rate lifts from_rest"


def make_floors():
    """Blocks, restitution, amplitudes [m/s2] and angular frequencies [rad/s]."""
    block = jr.Block(spread(0.1, 0.6, 1), spread(3.0, 8.0, 5))
    amplitude = spread(0.3, 4.0, 11) * 9.81 * np.asarray(block.critical_angle)
    frequency = spread(2.0, 12.0, 7) * np.asarray(block.frequency_parameter)
    return block, spread(0.7, 0.95, 5), amplitude, frequency


@group("steady/orbit_linearized", 1e-10, by_default=True)
def find_linearized_orbits():
    block, c, amplitude, frequency = make_floors()
    found = jr.steady.harmonic_orbit(block, c, amplitude, frequency, model="linearized")
    yield from list_fields(found, OF_ORBIT)
    for name in ("least_harmonic_amplitude", "symmetry_breaking_amplitude"):
        yield name, getattr(jr.steady, name)(block, c, frequency)


@group("steady/orbit_nonlinear", 1e-9)
def find_nonlinear_orbits():
    found = jr.steady.harmonic_orbit(*make_floors())
    yield from list_fields(found, OF_ORBIT)


@group("steady/orbit_derivatives", 1e-8)
def differentiate_orbits():
    def launch(at):
        block = jr.Block(at[0], at[1])
        return jr.steady.harmonic_orbit(block, at[2], at[3], at[4]).rotation_ratio

    yield "rotation_ratio", jax.jacfwd(launch)(jnp.array([0.2, 5.0, 0.9, 3.0, 15.0]))


def make_blocks():
    """Four blocks, which are asked one by one: half-width, slenderness, C, duration."""
    columns = (spread(0.2, 0.8, 1), spread(3.0, 8.0, 5), spread(0.3, 0.8, 5))
    return np.stack([*columns, spread(0.02, 0.2, 7)], axis=-1)[::3]


@group("steady/pulses", 1e-8)
def settle_under_pulses():
    for shape in (jr.HalfSine, jr.Rectangular):
        phases = []
        for half_width, slenderness, c, duration in make_blocks():
            block = jr.Block(half_width, slenderness)
            pulse = shape(0.15 / (shape.area * duration), duration)
            phases.append(jr.steady.pulsed_phase(block, c, pulse))
        yield from stack_fields(phases, OF_PHASE, f"{shape.__name__}/")


@group("steady/thresholds", 1e-8)
def find_thresholds():
    thresholds = [
        jr.steady.critical_pulsed_amplitude(
            jr.Block(half_width, slenderness), c, jr.HalfSine, duration
        )
        for half_width, slenderness, c, duration in make_blocks()
    ]
    yield from stack_fields(thresholds, OF_THRESHOLD)


@group("steady/derivatives", 1e-7)
def differentiate():
    def ratio(at):
        pulse = jr.HalfSine(at[3], at[4])
        return jr.steady.pulsed_phase(jr.Block(at[0], at[1]), at[2], pulse).rotation_ratio

    yield "rotation_ratio", jax.grad(ratio)(jnp.array([0.4, 5.0, 0.7, 5.9, 0.04]))

    def amplitude(at):
        block = jr.Block(at[0], at[1])
        return jr.steady.critical_pulsed_amplitude(block, at[2], jr.HalfSine, at[3]).amplitude

    yield "amplitude", jax.grad(amplitude)(jnp.array([0.4, 5.0, 0.7, 0.04]))
