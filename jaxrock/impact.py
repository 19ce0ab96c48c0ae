"""The impact law: what an impact leaves of the velocity, and Housner's value of that share.

Every single impact is computed here, of closed forms and integrated motions. Powers of C, in
sums over many impacts such as ``(1 - C^i) / (1 - C)``, follow from the law's being linear.
"""

from typing import Any

import jax.numpy as jnp

from .block import Block, share_in_centre
from .validation import Reals, elementwise


def velocity_after_impact(restitution: Any, velocity: Any) -> Any:
    """Velocity of a block that goes on about its other corner, ``C`` times that before."""
    return restitution * velocity


@elementwise()
def housner_restitution(block: Block) -> Reals:
    """Housner's coefficient of restitution, a ratio of angular velocities (Housner 1963).

    From the angular momentum about the new edge, which the impact conserves. Negative for a
    stocky block, a rectangle below a slenderness of 0.707: such a block does not rock on.

    Parameters
    ----------
    block : Block

    Returns
    -------
    restitution : Array, shape (...)
        ``1 - (2 / kappa) sin(alpha_c)^2`` [-]; ``1 - (3/2) sin(alpha_c)^2`` of a rectangle.

    Examples
    --------
    >>> import jaxrock as jr
    >>> print(f"{jr.housner_restitution(jr.Block(half_width=0.4, slenderness=5.0)):.3f}")
    0.942
    """
    square = block.slenderness**2
    twice = 2 * share_in_centre(block.inertia_ratio)
    # For stocky blocks the first form cancels (a rectangle: near 0.707), for tall ones the
    # second.
    stocky = twice * square / (1 + square) - (twice - 1)
    return jnp.where(square > 1, 1 - twice / (1 + square), stocky)
