"""What all ground motions have in common.

The sign is the paper's (Eq. 1): a positive acceleration pushes the block to positive
rotations. Most of the literature has it the other way round.

A motion is zero before its start and after its end; in between it is smooth from one kink to
the next. The integrators call `value`, which continues the motion smoothly beyond both ends,
so that no integration step contains a jump.
"""

import abc
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..host import Printed
from ..validation import (
    NON_NEGATIVE,
    Booleans,
    Checked,
    Number,
    Numbers,
    Reals,
    as_real,
    check,
)


class Motion(Printed, Checked):
    """A ground motion: a `Pulse` of some shape, a `Harmonic`, a `Record` or `Still` ground.

    Attributes
    ----------
    name : str
        Kind of motion, in words.
    start : Array
        Time up to which the ground is at rest [s].
    """

    name: ClassVar[str]

    start: eqx.AbstractVar[Reals]

    @property
    @abc.abstractmethod
    def end(self) -> Reals:
        """Time from which on the ground is at rest [s]."""

    @property
    @abc.abstractmethod
    def intensity(self) -> Reals:
        """Change of the ground velocity, the integral of the acceleration, I [m/s]."""

    @abc.abstractmethod
    def value(self, time: Reals) -> tuple[Reals, Reals]:
        """Acceleration of the ground, continued smoothly beyond start and end.

        Parameters
        ----------
        time : Array
            Times [s].

        Returns
        -------
        horizontal, vertical : Array, shape (...)
            Accelerations [m/s2], the vertical one positive upward.
        """

    @abc.abstractmethod
    def knots(self) -> Float[Array, " knots"]:
        """Return times between which the horizontal acceleration is monotone.

        Returns
        -------
        times : Array, shape (knots,)
            From start to end [s].
        """

    @abc.abstractmethod
    def next_kink(self, time: Reals) -> Reals:
        """Return the next time inside the motion at which its acceleration has a kink.

        Parameters
        ----------
        time : Array
            Times [s]. A time within rounding of a kink counts as later than it.

        Returns
        -------
        kink : Array, shape (...)
            Time [s]; inf if no kink follows.
        """

    @abc.abstractmethod
    def scaled(self, factor: Number) -> "Motion":
        """Multiply all accelerations by a factor.

        Parameters
        ----------
        factor : array_like
            Finite [-].

        Returns
        -------
        Motion

        Raises
        ------
        ValueError
            If a concrete factor is not finite.
        """

    def shifted(self, delay: Number) -> "Motion":
        """Delay the motion.

        Parameters
        ----------
        delay : array_like
            Delay [s].

        Returns
        -------
        Motion

        Raises
        ------
        ValueError
            If the motion would begin before time 0.
        """
        start = self.start + as_real("delay", delay)
        check("start", start, NON_NEGATIVE)
        return eqx.tree_at(lambda motion: motion.start, self, start)

    def horizontal(self, time: Numbers) -> Reals:
        """Horizontal acceleration of the ground.

        Parameters
        ----------
        time : array_like
            Times [s].

        Returns
        -------
        acceleration : Array, shape (...)
            Signed [m/s2]; 0 before the start and from the end on.
        """
        return _acceleration(self.bucketed(), as_real("time", time))[0]

    def upward(self, time: Numbers) -> Reals:
        """Vertical acceleration of the ground, positive upward; otherwise as `horizontal`.

        Parameters
        ----------
        time : array_like
            Times [s].

        Returns
        -------
        acceleration : Array, shape (...)
            Signed [m/s2].
        """
        return _acceleration(self.bucketed(), as_real("time", time))[1]

    def acts(self, time: Reals) -> Booleans:
        """Tell whether the ground moves: from the start on and before the end.

        Parameters
        ----------
        time : Array
            Times [s].

        Returns
        -------
        acts : Array of bool, shape (...)
        """
        return (time >= self.start) & (time < self.end)

    def bucketed(self) -> "Motion":
        """Give the motion one of few shapes, so that records of many lengths share a program.

        Returns
        -------
        Motion
            A concrete record padded with zeros; any other motion itself.
        """
        return self


@eqx.filter_jit
def _acceleration(motion: Motion, time: Reals) -> tuple[Reals, Reals]:
    acts = motion.acts(time)
    inside = jnp.where(acts, time, motion.start)
    return jax.tree.map(lambda a: jnp.where(acts, a, 0), motion.value(inside))
