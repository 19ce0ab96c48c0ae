"""Ground motions: pulses of the shapes in the literature, and records.

The sign is the paper's (Eq. 1): a positive acceleration pushes the block to positive
rotations. Most of the literature has it the other way round.

A motion is zero before its start and after its end, and in between is smooth from one
kink to the next. The integrators ask for a motion through `value`, which continues what is
inside over both ends, so that none of their steps ever sees a jump.
"""

import abc
from typing import ClassVar

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
from jaxtyping import Array, Float

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


class Motion(Checked):
    """What all ground motions have in common; see `Rectangular`, ..., `Ricker`, `Record`.

    Attributes
    ----------
    name : str
        Of the kind of motion, in words.
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
        """Change of the ground velocity, the integral of the acceleration [m/s]."""

    @abc.abstractmethod
    def value(self, time: Reals) -> tuple[Reals, Reals]:
        """Acceleration of the ground, continued beyond start and end.

        Parameters
        ----------
        time : Array
            Times [s].

        Returns
        -------
        horizontal, vertical : Array, shape (...)
            Accelerations [m/s2], the vertical one upward.
        """

    @abc.abstractmethod
    def knots(self) -> Float[Array, " knots"]:
        """Between which the horizontal acceleration is monotone.

        Returns
        -------
        times : Array, shape (knots,)
            From start to end [s].
        """

    @abc.abstractmethod
    def next_kink(self, time: Reals) -> Reals:
        """The next time inside at which the acceleration has a kink.

        Parameters
        ----------
        time : Array
            Times [s]; within rounding of a kink they count as past it.

        Returns
        -------
        kink : Array, shape (...)
            Time [s]; inf if there is none.
        """

    @abc.abstractmethod
    def scaled(self, factor: Number) -> "Motion":
        """The same motion, stronger.

        Parameters
        ----------
        factor : array_like
            How many times as strong [-], finite.

        Returns
        -------
        Motion

        Raises
        ------
        ValueError
            If a concrete factor is not finite.
        """

    def shifted(self, delay: Number) -> "Motion":
        """The same motion, later.

        Parameters
        ----------
        delay : array_like
            How much later [s].

        Returns
        -------
        Motion

        Raises
        ------
        ValueError
            If it would begin before time 0.
        """
        start = self.start + as_real("delay", delay)
        check("start", start, NON_NEGATIVE)
        return eqx.tree_at(lambda motion: motion.start, self, start)

    def horizontal(self, time: Numbers) -> Reals:
        """Horizontal acceleration of the ground.

        Parameters
        ----------
        time : array_like
            At which it is asked for [s].

        Returns
        -------
        acceleration : Array, shape (...)
            Signed [m/s2]; 0 before the start and from the end on.
        """
        return self._within(time)[0]

    def upward(self, time: Numbers) -> Reals:
        """Vertical acceleration of the ground.

        Parameters
        ----------
        time : array_like
            As in `horizontal`.

        Returns
        -------
        upward : Array, shape (...)
            Acceleration [m/s2]; 0 before the start and from the end on.
        """
        return self._within(time)[1]

    def acts(self, time: Reals) -> Booleans:
        """Whether a time is from the start on and before the end.

        Parameters
        ----------
        time : Array
            Of any shape [s].

        Returns
        -------
        acts : Array of bool, shape (...)
        """
        return (time >= self.start) & (time < self.end)

    def bucketed(self) -> "Motion":
        """The same motion in one of few shapes, so that few programs are compiled for all.

        Returns
        -------
        Motion
            Itself, but for a record that is concrete: that is padded with zeros.
        """
        return self

    def _within(self, time: Numbers) -> tuple[Reals, Reals]:
        return _asked(self.bucketed(), as_real("time", time))


@eqx.filter_jit
def _asked(motion: Motion, time: Reals) -> tuple[Reals, Reals]:
    acts = motion.acts(time)
    inside = jnp.where(acts, time, motion.start)
    return jax.tree.map(lambda a: jnp.where(acts, a, 0), motion.value(inside))
