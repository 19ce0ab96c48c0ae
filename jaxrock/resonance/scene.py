"""The scene of resonance: a block, its restitution, and the pulses that drive it."""

from ..block import Block
from ..host import Printed, format_number, format_outside
from ..impact import read_restitution
from ..validation import (
    NON_NEGATIVE,
    UNIT_INTERVAL,
    Checked,
    Number,
    Reals,
    as_field,
    check_kind,
    quantity,
)


class Scene(Printed, Checked):
    """A block, its coefficient of restitution, and the pulses that drive it; they broadcast.

    Parameters
    ----------
    block : Block
    restitution : array_like
        C, velocity after an impact over the velocity before it [-], between 0 and 1; of a
        one-sided block its magnitude counts.
    intensity : array_like
        I, the change of ground velocity in each pulse [m/s], finite and at least 0.

    Notes
    -----
    To `jax.vmap` over only those parameters that are arrays, pass
    ``in_axes=jax.tree.map(lambda leaf: 0 if leaf.ndim else None, scene)``.

    `jax.grad` returns derivatives in a `Scene`. It prints them as derivatives if at least a
    third of its numbers cannot be those of a scene; if fewer cannot, it prints only these, as
    outside of their domains.

    Examples
    --------
    >>> import jaxrock as jr
    >>> print(jr.Scene(jr.Block(half_width=0.4, slenderness=5.0), 0.7, intensity=0.15))
    half-width 0.4 m, slenderness 5, gravity 9.81 m/s2
    restitution 0.7, pulses of 0.15 m/s
    """

    block: Block
    restitution: Reals = quantity(UNIT_INTERVAL, "")
    intensity: Reals = quantity(NON_NEGATIVE, "m/s")

    def __init__(self, block: Block, restitution: Number, intensity: Number):
        check_kind("block", block, Block)
        self.block = block
        self.restitution = read_restitution(block, restitution)
        self.intensity = as_field(Scene, "intensity", intensity)

    def __str__(self) -> str:
        return format_outside(self) or (
            f"{self.block}\nrestitution {format_number(self.restitution)},"
            f" pulses of {format_number(self.intensity, 'm/s')}"
        )
