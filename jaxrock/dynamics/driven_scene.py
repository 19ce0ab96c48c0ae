"""A block on moving ground: what every driven computation is about."""

from ..block import Block
from ..ground_motion import Motion
from ..host import shown
from ..validation import UNIT_INTERVAL, Checked, Number, Reals, as_real, quantity


class DrivenScene(Checked):
    """A block, what an impact leaves of its velocity, and a ground motion.

    Parameters
    ----------
    block : Block
    restitution : array_like
        C [-], between 0 and 1.
    motion : Motion
        A pulse or a `Record`.

    Raises
    ------
    ValueError
        If a concrete value is outside of what is allowed.
    """

    block: Block
    motion: Motion
    restitution: Reals = quantity(UNIT_INTERVAL)

    def __init__(self, block: Block, restitution: Number, motion: Motion):
        self.block = block
        self.motion = motion
        self.restitution = as_real("restitution", restitution)

    def __str__(self) -> str:
        return f"{self.block}\nrestitution {shown(self.restitution)}\n{self.motion}"
