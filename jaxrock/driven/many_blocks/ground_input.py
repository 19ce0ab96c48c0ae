"""The ground motion in the batch: intervals of time with one power series each.

A pulse is one interval. A harmonic motion is a one-sine pulse, interval after interval: the
phase begins anew in each, so that it keeps its digits however many there are. A record is a line
in each interval between two samples. `PulseInput`, with a subclass for each shape, and
`RecordInput` have the same methods. These are elementwise over blocks, or lanes, and traced. An
input knows nothing of the blocks, which share it: their numbers come in an `Excitation`.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Float, Int

# Arrays outside of programs are NumPy's, which compile nothing; inside they are traced.
HostReals = Float[Array | np.ndarray, "..."]
HostNumbers = Float[Array | np.ndarray | np.floating, "..."]
HostIntegers = Int[Array | np.ndarray, "..."]
HostBooleans = Bool[Array | np.ndarray, "..."]
# One number for each block, or for each lane in which a block is followed: of one size in all
# fields of an object, which the tests check wherever one is made.
PerBlock = Float[Array, " blocks"]
CountPerBlock = Int[Array, " blocks"]
TruthPerBlock = Bool[Array, " blocks"]


def rounding_margin(dtype: DTypeLike) -> float:
    """Return the number below which something is nothing beside 1."""
    # A handful of operations, each of which rounds, with a margin.
    return 64 * float(jnp.finfo(dtype).eps)


class Excitation(eqx.Module):
    """The input as each block feels it; times are in the block's unit."""

    strength: PerBlock  # factor on the input over g
    length: PerBlock  # of an interval
    rate: PerBlock  # of the phase of the input in time
    first_interval: CountPerBlock  # place of the first interval of the motion
    intervals: CountPerBlock  # of the motion
    grade: CountPerBlock  # of the intervals that might lift the block
    # When a pulse might lift the block, from the beginning of its interval on.
    uplift_times: tuple[PerBlock, ...]
