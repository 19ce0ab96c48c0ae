"""Inverse design: the pulses that put a block on the verge of overturning."""

import jax.numpy as jnp

from .arguments import COUNT, UNIT_INTERVAL, Number, Reals, elementwise
from .block import Block
from .elementary import share_of_one
from .free import FreeRocking, Linearized


@elementwise(restitution=UNIT_INTERVAL, half_cycles=COUNT)
def critical_intensity(
    block: Block,
    restitution: Number,
    half_cycles: Number = jnp.inf,
    model: FreeRocking = Linearized(),
) -> Reals:
    """Intensity of the pulses that just overturn the block within so many half-cycles.

    Solves ``half_cycle_velocity = critical_velocity`` (Eqs. 2 and 8) for the intensity.

    Parameters
    ----------
    block : Block
    restitution : array_like
        C, between 0 and 1 [-].
    half_cycles : array_like, optional
        n, a whole number from 1 on (1 is the single pulse), or inf.
    model : Linearized or Nonlinear

    Returns
    -------
    Array
        I [m/s]; 0 for C = 1 without limit on the half-cycles.
    """
    unit_velocity = block.pulse_velocity(1.0)
    single = model._critical_velocity(block) / unit_velocity
    return single * share_of_one(restitution, half_cycles)
