"""Ground motions: pulses of the shapes in the literature, and records.

The sign is the paper's (Eq. 1): a positive acceleration pushes the block to positive
rotations. Most of the literature has it the other way round.

A motion is zero before its start and after its end, and in between is smooth from one
kink to the next. The integrators ask for a motion through `value`, which continues what is
inside over both ends, so that none of their steps ever sees a jump.
"""

import abc
import math
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .arguments import (
    FINITE,
    NON_NEGATIVE,
    POSITIVE,
    Booleans,
    Checked,
    Number,
    Numbers,
    Reals,
    as_array,
    as_real,
    check,
    quantity,
)
from .printing import shown

_LONG = 2**16  # from so many samples on, room is made for multiples of that


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

    def _within(self, time: Numbers) -> tuple[Reals, Reals]:
        return _asked(bucketed(self), as_real("time", time))


@eqx.filter_jit
def _asked(motion: Motion, time: Reals) -> tuple[Reals, Reals]:
    acts = motion.acts(time)
    inside = jnp.where(acts, time, motion.start)
    return jax.tree.map(lambda a: jnp.where(acts, a, 0), motion.value(inside))


class Pulse(Motion):
    """A single pulse of a given shape.

    Parameters
    ----------
    amplitude : array_like
        a_p, largest acceleration [m/s2], finite; negative for a pulse to the other side.
    duration : array_like
        Duration [s], greater than 0.
    start : array_like, optional
        Time at which it begins [s], at least 0.

    Attributes
    ----------
    turns : tuple of float
        Where the acceleration turns, in durations from the start; the last one is the end.
    area : float
        Intensity over amplitude and duration [-].
    angle : float
        Angular frequency times duration [rad].

    Raises
    ------
    ValueError
        If a concrete value is outside of what is allowed.

    Examples
    --------
    >>> import jaxrock as jr
    >>> pulse = jr.HalfSine(amplitude=3.0, duration=0.5)
    >>> print(f"{pulse.intensity:.3f} m/s, {pulse.horizontal(0.1):.3f} m/s2 after 0.1 s")
    0.955 m/s, 1.763 m/s2 after 0.1 s
    """

    amplitude: Reals = quantity(FINITE)
    duration: Reals = quantity(POSITIVE)
    start: Reals = quantity(NON_NEGATIVE)

    turns: ClassVar[tuple[float, ...]]
    area: ClassVar[float]
    angle: ClassVar[float]

    # Named again in every shape of pulse: type checkers would make another from the fields.
    def __init__(self, amplitude: Number, duration: Number, start: Number = 0.0):
        self.amplitude = as_real("amplitude", amplitude)
        self.duration = as_real("duration", duration)
        self.start = as_real("start", start)

    def __str__(self) -> str:
        return (
            f"{self.name} of {shown(self.amplitude, 'm/s2')}, duration"
            f" {shown(self.duration, 's')}, from {shown(self.start, 's')} on"
        )

    @staticmethod
    @abc.abstractmethod
    def shape(phase: Reals) -> Reals:
        """Acceleration over amplitude.

        Parameters
        ----------
        phase : Array
            Time since the start, in durations [-].

        Returns
        -------
        share : Array, shape (...)
            Of the amplitude [-].
        """

    @property
    def end(self) -> Reals:
        """Time from which on the ground is at rest [s]."""
        return self.start + self.turns[-1] * self.duration

    @property
    def intensity(self) -> Reals:
        """Change of the ground velocity, I [m/s]."""
        return self.area * self.amplitude * self.duration

    @property
    def frequency(self) -> Reals:
        """Angular frequency of the pulse in the literature, omega_p [rad/s]."""
        return self.angle / self.duration

    def value(self, time: Reals) -> tuple[Reals, Reals]:
        """Acceleration of the ground; see `Motion.value`."""
        horizontal = self.amplitude * self.shape((time - self.start) / self.duration)
        return horizontal, jnp.zeros_like(horizontal)

    def knots(self) -> Float[Array, " knots"]:
        """The `turns` as times [s]; see `Motion.knots`."""
        return self.start + self.duration * jnp.asarray(self.turns, self.duration.dtype)

    def next_kink(self, time: Reals) -> Reals:
        """The next kink: inf, a pulse has none inside; see `Motion.next_kink`."""
        return jnp.full_like(time, jnp.inf)

    def scaled(self, factor: Number) -> "Pulse":
        """The same pulse, stronger; see `Motion.scaled`."""
        factor = as_real("factor", factor)
        check("factor", factor, FINITE)
        return eqx.tree_at(lambda pulse: pulse.amplitude, self, self.amplitude * factor)


def pulse_class(shape: Any) -> type[Pulse]:
    """The shape of a pulse as it is given to functions, or a `ValueError`."""
    if not (isinstance(shape, type) and issubclass(shape, Pulse)):
        raise ValueError(f"shape must be a class of pulses, for example Sine, got {shape!r}")
    return shape


class Rectangular(Pulse):
    """Rectangular pulse: constant acceleration; see `Pulse` for the parameters.

    Intensity ``a_p duration``; angular frequency pi / duration, as for half a period.
    """

    __init__ = Pulse.__init__
    name = "rectangular pulse"
    turns = (0.0, 1.0)
    area = 1.0
    angle = math.pi

    @staticmethod
    def shape(phase: Reals) -> Reals:
        """Acceleration over amplitude."""
        return jnp.ones_like(phase)


class HalfSine(Pulse):
    """Half-sine pulse: half a period of a sine; see `Pulse` for the parameters.

    Intensity ``2 a_p duration / pi``; angular frequency pi / duration.
    """

    __init__ = Pulse.__init__
    name = "half-sine pulse"
    turns = (0.0, 0.5, 1.0)
    area = 2 / math.pi
    angle = math.pi

    @staticmethod
    def shape(phase: Reals) -> Reals:
        """Acceleration over amplitude."""
        return jnp.sin(math.pi * phase)


class Sine(Pulse):
    """One-sine pulse (type A, a forward pulse of velocity); see `Pulse` for the parameters.

    A full period of a sine, so that its intensity is 0; angular frequency 2 pi / duration.
    """

    __init__ = Pulse.__init__
    name = "one-sine pulse"
    turns = (0.0, 0.25, 0.75, 1.0)
    area = 0.0
    angle = 2 * math.pi

    @staticmethod
    def shape(phase: Reals) -> Reals:
        """Acceleration over amplitude."""
        return jnp.sin(2 * math.pi * phase)


class Cosine(Pulse):
    """One-cosine pulse (type B, forward and back); see `Pulse` for the parameters.

    A full period of a cosine, so that its intensity is 0; angular frequency 2 pi /
    duration.
    """

    __init__ = Pulse.__init__
    name = "one-cosine pulse"
    turns = (0.0, 0.5, 1.0)
    area = 0.0
    angle = 2 * math.pi

    @staticmethod
    def shape(phase: Reals) -> Reals:
        """Acceleration over amplitude."""
        return jnp.cos(2 * math.pi * phase)


class Ricker(Pulse):
    """Symmetric Ricker wavelet; see `Pulse` for the parameters.

    ``a_p (1 - 2 pi^2 x^2) exp(-pi^2 x^2)`` with x = time / duration - 2, cut off two
    durations before and after its peak, where it is 1e-15 of it. The duration is T_p, the
    period at which its Fourier spectrum is largest; it acts for four of them. Intensity 0;
    angular frequency 2 pi / duration.
    """

    __init__ = Pulse.__init__
    name = "symmetric Ricker wavelet"
    turns = (0.0, 2 - math.sqrt(1.5) / math.pi, 2.0, 2 + math.sqrt(1.5) / math.pi, 4.0)
    area = 0.0
    angle = 2 * math.pi

    @staticmethod
    def shape(phase: Reals) -> Reals:
        """Acceleration over amplitude."""
        square = (math.pi * (phase - 2)) ** 2
        return (1 - 2 * square) * jnp.exp(-square)


PULSES: dict[str, type[Pulse]] = {
    "rectangular": Rectangular,
    "half-sine": HalfSine,
    "sine": Sine,
    "cosine": Cosine,
    "ricker": Ricker,
}


class Record(Motion):
    """A recorded ground motion, linear between samples.

    Parameters
    ----------
    acceleration : array_like, shape (..., samples)
        Horizontal acceleration [m/s2], finite, at least two samples.
    time_step : array_like
        Time from one sample to the next [s], greater than 0.
    vertical : array_like, shape (..., samples), optional
        Vertical acceleration [m/s2], upward, of as many samples.
    scale : array_like, optional
        Factor on both [-]. What is differentiated to it costs one derivative; to the samples,
        as many as there are.
    start : array_like, optional
        Time of the first sample [s], at least 0.

    Raises
    ------
    ValueError
        If a concrete value is outside of what is allowed, if the numbers of samples differ or
        are less than two, or if an array is empty.

    Examples
    --------
    >>> import jaxrock as jr
    >>> record = jr.Record([0.0, 2.0, -1.0, 0.0], time_step=0.1)
    >>> print(f"{record.horizontal(0.05):.2f} m/s2, ends at {record.end:.1f} s")
    1.00 m/s2, ends at 0.3 s
    """

    vertical: Reals | None
    acceleration: Reals = quantity(FINITE)
    time_step: Reals = quantity(POSITIVE)
    scale: Reals = quantity(FINITE)
    start: Reals = quantity(NON_NEGATIVE)

    name = "record"

    def __init__(
        self,
        acceleration: Numbers,
        time_step: Number,
        vertical: Numbers | None = None,
        scale: Number = 1.0,
        start: Number = 0.0,
    ):
        self.acceleration = as_real("acceleration", acceleration)
        self.time_step = as_real("time_step", time_step)
        self.vertical = None if vertical is None else as_real("vertical", vertical)
        self.scale = as_real("scale", scale)
        self.start = as_real("start", start)
        if self.acceleration.ndim == 0 or self.samples < 2:
            raise ValueError(
                "acceleration must have at least two samples, got an array of shape"
                f" {self.acceleration.shape}"
            )
        for name in ("acceleration", "time_step", "vertical", "scale", "start"):
            value = getattr(self, name)
            if value is not None and value.size == 0:
                raise ValueError(f"{name} must not be empty, got an array of shape {value.shape}")
        if self.vertical is not None:
            check("vertical", self.vertical, FINITE)
            if self.vertical.ndim == 0 or self.vertical.shape[-1] != self.samples:
                raise ValueError(
                    f"vertical must have as many samples as acceleration, {self.samples},"
                    f" got an array of shape {self.vertical.shape}"
                )

    def __str__(self) -> str:
        return (
            f"record of {self.samples} samples, step {shown(self.time_step, 's')}, from"
            f" {shown(self.start, 's')} on: {shown(self.acceleration, 'm/s2')}, scale"
            f" {shown(self.scale)}{'' if self.vertical is None else ', with vertical'}"
        )

    @property
    def samples(self) -> int:
        """Number of samples [-]."""
        return self.acceleration.shape[-1]

    @property
    def end(self) -> Reals:
        """Time of the last sample, from which on the ground is at rest [s]."""
        return self.start + self._last * self.time_step

    @property
    def intensity(self) -> Reals:
        """Change of the ground velocity, I [m/s]."""
        record = bucketed(self)
        return self.scale * _total(record.acceleration, record._last) * self.time_step

    def value(self, time: Reals) -> tuple[Reals, Reals]:
        """Acceleration of the ground; see `Motion.value`.

        At a sample, with the derivative of the time before it: integrators end steps there.
        """
        position = (time - self.start) / self.time_step
        index = jnp.ceil(position - self._rounding(position)) - 1
        index = jnp.clip(index, 0, self._last - 1)
        along = position - index
        index = jax.lax.stop_gradient(index).astype(int)
        horizontal = self.scale * _between(self.acceleration, index, along)
        if self.vertical is None:
            return horizontal, jnp.zeros_like(horizontal)
        return horizontal, self.scale * _between(self.vertical, index, along)

    def knots(self) -> Float[Array, " knots"]:
        """The times of the samples [s]; see `Motion.knots`."""
        numbers = jnp.arange(self.acceleration.shape[-1], dtype=self.time_step.dtype)
        return self.start + self.time_step * jnp.minimum(numbers, self._last)

    def next_kink(self, time: Reals) -> Reals:
        """The time of the next sample [s], inf beyond the last one; see `Motion.next_kink`."""
        position = (time - self.start) / self.time_step
        index = jnp.maximum(jnp.floor(position + self._rounding(position)) + 1, 0)
        kink = self.start + index * self.time_step
        return jnp.where(index <= self._last, kink, jnp.inf)

    @property
    def _last(self) -> Any:
        """Number of the last sample, counted from 0."""
        return self.samples - 1

    def _rounding(self, position: Reals) -> Any:
        return 4 * (self._last + 1) * float(jnp.finfo(position.dtype).eps)

    def scaled(self, factor: Number) -> "Record":
        """The same record, both components stronger; see `Motion.scaled`."""
        factor = as_real("factor", factor)
        check("factor", factor, FINITE)
        return eqx.tree_at(lambda record: record.scale, self, self.scale * factor)


@jax.jit
def _total(samples: Reals, last: Any) -> Reals:
    """By the trapezoidal rule, over the time step."""
    at_end = jnp.take(samples, jnp.asarray(last).astype(int), axis=-1)
    return samples.sum(axis=-1) - 0.5 * (samples[..., 0] + at_end)


class Padded(Record):
    """A record with zeros behind its end: records of many lengths are the same to a compiler.

    Its knots go on at the end.
    """

    filled: Reals = quantity(NON_NEGATIVE)  # number of the last sample that counts

    def __init__(self, record: Record):
        """Pad a record that is concrete, without JAX, which would compile that."""
        room, vertical = room_for(record.samples), record.vertical
        self.acceleration = as_real("acceleration", padded(record.acceleration, room))
        self.vertical = None if vertical is None else as_real("vertical", padded(vertical, room))
        self.time_step = record.time_step
        self.scale = record.scale
        self.start = record.start
        self.filled = as_array(np.asarray(record._last, self.acceleration.dtype))

    @property
    def _last(self) -> Any:
        return self.filled


def room_for(samples: int) -> int:
    """One of a few numbers, no less than that of the samples."""
    if samples > _LONG:
        return -(-samples // _LONG) * _LONG
    return max(256, 1 << (samples - 1).bit_length())


def padded(samples: Any, room: int) -> np.ndarray:
    """Samples with zeros behind them."""
    samples = np.asarray(samples)
    whole = np.zeros((*samples.shape[:-1], room), samples.dtype)
    whole[..., : samples.shape[-1]] = samples
    return whole


def bucketed(motion: Any) -> Any:
    """The motion, a record outside of a transformation as one of few lengths."""
    if not isinstance(motion, Record) or isinstance(motion, Padded):
        return motion
    traced = any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(motion))
    return motion if traced else Padded(motion)


def _between(samples: Reals, index: Array, along: Reals) -> Reals:
    """Linear interpolation in the last axis; leading axes broadcast with those of `index`."""
    shape = jnp.broadcast_shapes(samples.shape[:-1], index.shape)
    samples = jnp.broadcast_to(samples, (*shape, samples.shape[-1]))
    index = jnp.broadcast_to(index, shape)[..., None]
    left, right = (
        jnp.take_along_axis(samples, at, axis=-1, mode="promise_in_bounds")[..., 0]
        for at in (index, index + 1)
    )
    return (1 - along) * left + along * right  # exact at both ends
