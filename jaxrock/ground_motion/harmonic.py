"""Harmonic ground motion: a sine of whole periods."""

import math
import operator
from typing import Any, SupportsIndex

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..host import format_number, format_outside
from ..validation import (
    FINITE,
    NON_NEGATIVE,
    POSITIVE,
    Number,
    Reals,
    as_array,
    as_field,
    as_real,
    check,
    is_traced,
    quantity,
)
from .motion import Motion

_MOST_CYCLES = 10**6
# Least room for periods. Like all larger sizes it is a power of two: so there are few sizes,
# and all numbers of periods up to this one share a program.
_LEAST_ROOM = 256


class Harmonic(Motion):
    """A sine for whole periods, ``amplitude sin(frequency (t - start))``, then rest.

    For `respond_batch`, the property ``_period_count`` is the number of periods after which the
    ground is at rest. It is `cycles`, unless `bucketed` has made room for more periods.

    Parameters
    ----------
    amplitude : array_like
        Largest acceleration [m/s2], finite; negative for a motion that begins to the other
        side.
    frequency : array_like
        omega, the angular frequency [rad/s], greater than 0.
    cycles : int
        Number of periods, from 1 to 1,000,000; 20 by default. Under `jit` it is static.
    start : array_like, optional
        Time at which it begins [s], at least 0.

    Raises
    ------
    ValueError
        If a concrete value is out of range.

    Examples
    --------
    >>> import jaxrock as jr
    >>> shaking = jr.Harmonic(amplitude=2.5, frequency=10.0, cycles=5)
    >>> print(f"ends at {shaking.end:.3f} s, {shaking.horizontal(0.1):.3f} m/s2 after 0.1 s")
    ends at 3.142 s, 2.104 m/s2 after 0.1 s
    """

    cycles: int = eqx.field(static=True)
    amplitude: Reals = quantity(FINITE, "m/s2")
    frequency: Reals = quantity(POSITIVE, "rad/s")
    start: Reals = quantity(NON_NEGATIVE, "s")

    name = "harmonic motion"

    def __init__(
        self,
        amplitude: Number,
        frequency: Number,
        cycles: SupportsIndex = 20,
        start: Number = 0.0,
    ):
        self.amplitude = as_field(Harmonic, "amplitude", amplitude)
        self.frequency = as_field(Harmonic, "frequency", frequency)
        self.start = as_field(Harmonic, "start", start)
        self.cycles = _check_cycles(cycles)

    def __str__(self) -> str:
        return format_outside(self) or (
            f"{self.name} of {format_number(self.amplitude, 'm/s2')}, frequency"
            f" {format_number(self.frequency, 'rad/s')}, for {self.cycles}"
            f" period{'s' * (self.cycles > 1)} from {format_number(self.start, 's')} on"
        )

    @property
    def period(self) -> Reals:
        """Duration of one period, 2 pi / omega [s]."""
        return 2 * math.pi / self.frequency

    @property
    def end(self) -> Reals:
        """Time from which on the ground is at rest [s]."""
        return self.start + self._period_count * self.period

    @property
    def intensity(self) -> Reals:
        """Change of the ground velocity, I [m/s]: 0 after whole periods."""
        return 0 * self.amplitude / self.frequency

    def value(self, time: Reals) -> tuple[Reals, Reals]:
        """Compute the acceleration of the ground; see `Motion.value`."""
        horizontal = self.amplitude * jnp.sin(self.frequency * (time - self.start))
        return horizontal, jnp.zeros_like(horizontal)

    def knots(self) -> Float[Array, " knots"]:
        """Return start, extremes and end [s]; see `Motion.knots`."""
        # The sine has its extremes at odd multiples of a quarter of a period. The clip turns
        # the knot before the first extreme into the start, and the spare room into the end.
        numbers = 0.5 * jnp.arange(2 * self.cycles + 2, dtype=self.frequency.dtype) - 0.25
        return self.start + jnp.clip(numbers, 0, self._period_count) * self.period

    def scaled(self, factor: Number) -> "Harmonic":
        """Return the motion of another amplitude; see `Motion.scaled`."""
        factor = as_real("factor", factor, unit="")
        check("factor", factor, FINITE)
        return eqx.tree_at(lambda motion: motion.amplitude, self, self.amplitude * factor)

    @property
    def _period_count(self) -> int | Reals:
        """Number of periods until the end, for the batch."""
        return self.cycles

    def bucketed(self) -> "Harmonic":
        """Make room for more periods, unless the motion is traced; see `Motion.bucketed`."""
        traced = is_traced(self)
        return self if traced else PaddedHarmonic(self)


class PaddedHarmonic(Harmonic):
    """A concrete harmonic motion with room for more periods: many numbers share a program.

    Here `cycles`, which is static and determines shapes, is the room; the periods of the
    motion itself are `filled`, a number like others.
    """

    filled: Reals = quantity(POSITIVE)

    def __init__(self, motion: Harmonic):
        self.amplitude = motion.amplitude
        self.frequency = motion.frequency
        self.start = motion.start
        # The next power of two.
        self.cycles = max(_LEAST_ROOM, 1 << (motion.cycles - 1).bit_length())
        self.filled = as_array(np.asarray(motion.cycles, motion.frequency.dtype))

    @property
    def _period_count(self) -> Reals:
        """Number of periods of the motion itself."""
        return self.filled

    def bucketed(self) -> "PaddedHarmonic":
        """Return itself."""
        return self


def _check_cycles(cycles: Any) -> int:
    """Convert the argument `cycles` to an int; a `ValueError` if it counts no periods."""
    # A number that is not allowed, such as 0 here, leads to the error below. Python takes True
    # for an index, but it is a mistake here; a traced number raises a TypeError.
    try:
        number = 0 if isinstance(cycles, bool | np.bool_) else operator.index(cycles)
    except TypeError:
        number = 0
    if not 1 <= number <= _MOST_CYCLES:
        raise ValueError(
            f"cycles must be a whole number from 1 to {_MOST_CYCLES}, got {cycles!r:.60}"
        )
    return number
