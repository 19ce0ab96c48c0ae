"""The protocol of all ground motions.

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
    """A ground motion: a `Pulse` of some shape, a `Harmonic` or a `Record`.

    A new motion provides a `name`, a field `start`, and `end`, `intensity`, `value`, `knots`,
    `next_kink` and `scaled`, which are abstract here. It inherits `shifted`, `horizontal`,
    `upward` and `acts`. It overrides `bucketed` if compiled programs would depend on its
    length. Integrators rely on these properties:

    - A motion is an immutable pytree, and all methods work on traced numbers. Except `knots`,
      which takes a single motion, they are elementwise: fields may be arrays, which broadcast
      against each other and against the time.
    - The ground is at rest before `start` and from `end` on. Between the two, the
      acceleration is `value`. Outside of them `value` continues it smoothly, so that an
      integration step that ends at `start` or `end` meets no jump; only `acts` says whether
      the ground moves.
    - Between neighbouring kinks (see `next_kink`) `value` is smooth. For a motion without
      kinks `next_kink` returns inf.
    - Between neighbouring `knots`, the horizontal acceleration is monotone. So if it exceeds
      a level within such an interval, it does so at one of the ends.
    - Times are differentiable like values: `end`, the knots and the kinks move with the start
      and the duration, and a step that ends at a kink moves with it.

    `respond_batch` does not call these methods. It has its own representation of each kind of
    motion, for which `Harmonic` and `Record` have one more property each.

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
        """Compute the acceleration of the ground, continued smoothly beyond start and end.

        At a kink the value is that of the interval before it, since integration steps end
        there.

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

        Their number depends only on shapes, so that it is known at compile time. Times may
        repeat.

        Returns
        -------
        times : Array, shape (knots,)
            From start to end [s].
        """

    def next_kink(self, time: Reals) -> Reals:
        """Return the next time inside the motion at which its acceleration has a kink.

        Parameters
        ----------
        time : Array
            Times [s]. A time within rounding of a kink counts as after it.

        Returns
        -------
        kink : Array, shape (...)
            Time [s]; inf if no kink follows, as in all motions but records.
        """
        return jnp.full_like(time, jnp.inf)

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
        start = self.start + as_real("delay", delay, unit="s")
        # `tree_at` does not call `__init__`: traced fields stay as they are, and nothing is
        # checked. So the one number that changes is checked here.
        check("start", start, NON_NEGATIVE)
        return eqx.tree_at(lambda motion: motion.start, self, start)

    def horizontal(self, time: Numbers) -> Reals:
        """Compute the horizontal acceleration of the ground.

        Parameters
        ----------
        time : array_like
            Times [s].

        Returns
        -------
        acceleration : Array, shape (...)
            Signed [m/s2]; 0 before the start and from the end on.
        """
        return _compute_acceleration(self.bucketed(), as_real("time", time, unit="s"))[0]

    def upward(self, time: Numbers) -> Reals:
        """Compute the vertical acceleration, positive upward; otherwise as `horizontal`.

        Parameters
        ----------
        time : array_like
            Times [s].

        Returns
        -------
        acceleration : Array, shape (...)
            Signed [m/s2].
        """
        return _compute_acceleration(self.bucketed(), as_real("time", time, unit="s"))[1]

    def acts(self, time: Reals) -> Booleans:
        """Return whether the ground moves: from the start on and before the end.

        Parameters
        ----------
        time : Array
            Times [s].

        Returns
        -------
        acts : Array of bool, shape (...)
        """
        return (time >= self.start) & (time < self.end)

    def time_rounding(self, time: Reals) -> Reals:
        """Bound the rounding error of a time: closer than that it coincides with a corner.

        This is the only rule for coincidences: a step that ends at a kink for one rule and not
        for another would go on with the slope of the wrong interval.

        Parameters
        ----------
        time : Array
            Times [s].

        Returns
        -------
        bound : Array, shape (...)
            Time [s].
        """
        # Corners and times follow from the start and the length of the motion by at most six
        # operations, each rounding by eps / 2.
        return 2 * float(jnp.finfo(time.dtype).eps) * (time + self.end)

    def bucketed(self) -> "Motion":
        """Pad the motion to one of few shapes, so that motions of many lengths share a program.

        XLA compiles one program for each shape. The returned motion gives the same answers.

        Returns
        -------
        Motion
            A concrete record padded with zeros, a concrete harmonic motion with room for more
            periods; any other motion itself.
        """
        return self


@eqx.filter_jit
def _compute_acceleration(motion: Motion, time: Reals) -> tuple[Reals, Reals]:
    """Compute both components of the acceleration, 0 where the motion does not act."""
    acts = motion.acts(time)
    # Far outside, the continuation of `value` may overflow. The derivative of `where` would
    # multiply the infinite slope of the unused branch by 0, which is NaN.
    inside = jnp.where(acts, time, motion.start)
    return jax.tree.map(lambda a: jnp.where(acts, a, 0), motion.value(inside))
