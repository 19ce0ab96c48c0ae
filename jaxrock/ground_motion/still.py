"""Ground that does not move, for a block that rocks freely."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..validation import (
    FINITE,
    NON_NEGATIVE,
    Number,
    Reals,
    as_field,
    as_real,
    check,
    quantity,
)
from .motion import Motion


class Still(Motion):
    """Ground at rest: a block that is released or pushed rocks freely.

    It has no end, so that `respond` needs a duration, and a rotation or velocity to begin
    with.

    Examples
    --------
    >>> import jaxrock as jr
    >>> block = jr.Block(half_width=0.1, slenderness=5.0)
    >>> test = jr.respond(block, 0.9, jr.Still(), duration=2.0, rotation=0.1)
    >>> print(test.impact_times[:3])
    [0.35111985 0.90644083 1.36898   ]
    """

    start: Reals = quantity(NON_NEGATIVE, "s")

    name = "still ground"

    def __init__(self):
        self.start = as_field(Still, "start", 0.0)

    def __str__(self) -> str:
        return self.name

    @property
    def end(self) -> Reals:
        """Time from which on the ground is at rest [s]: 0."""
        return self.start

    @property
    def intensity(self) -> Reals:
        """Change of the ground velocity, I [m/s]: 0."""
        return jnp.zeros_like(self.start)

    def value(self, time: Reals) -> tuple[Reals, Reals]:
        """Return the acceleration of the ground, 0; see `Motion.value`."""
        return jnp.zeros_like(time), jnp.zeros_like(time)

    def knots(self) -> Float[Array, " knots"]:
        """Return the start [s]; see `Motion.knots`."""
        return self.start[None]

    def scaled(self, factor: Number) -> "Still":
        """Return the same; see `Motion.scaled`."""
        check("factor", as_real("factor", factor, unit=""), FINITE)
        return self
