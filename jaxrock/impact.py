"""The impact law: the velocity after an impact, and Housner's coefficient of restitution.

Every single impact is computed here, of closed forms and of integrated motions. Sums over many
impacts contain powers of C instead, such as ``(1 - C^i) / (1 - C)``: the law is linear.
"""

import jax.numpy as jnp

from .block import Block, share_in_centre
from .validation import Reals, elementwise


def velocity_after_impact(restitution: Reals, velocity: Reals) -> Reals:
    """Compute the velocity with which a block goes on about its other corner."""
    return restitution * velocity


@elementwise()
def housner_restitution(block: Block) -> Reals:
    """Compute Housner's coefficient of restitution, a ratio of angular velocities.

    It follows from the angular momentum about the new edge, which the impact conserves
    (Housner 1963, doi:10.1785/BSSA0530020403). It is negative for a stocky block, a rectangle
    below a slenderness of 0.707: such a block does not rock on.

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
