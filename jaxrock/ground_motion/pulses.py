"""Pulses of the shapes in the literature."""

import abc
import math
from typing import ClassVar

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
    as_field,
    as_real,
    check,
    quantity,
)
from .motion import Motion
from .record import Record


class Pulse(Motion):
    """A single pulse; `Rectangular`, `HalfSine`, `Sine`, `Cosine` and `Ricker` are its shapes.

    Another shape is a subclass with a method `shape` and the constants `extremes`, `area` and
    `angle`. `respond` takes its pulses as they are. Batches, and what is built on them, take
    their samples: ``pulse.sampled(time_step)``.

    Parameters
    ----------
    amplitude : array_like
        a_p, the largest acceleration [m/s2], finite; negative for a pulse to the other side.
    duration : array_like
        Duration [s], greater than 0; of a `Ricker` its period, a quarter of its length in time.
    start : array_like, optional
        Time at which it begins [s], at least 0.

    Attributes
    ----------
    extremes : tuple of float
        Times at which the acceleration has its extremes, in durations from the start; the
        last one is the end.
    area : float
        Intensity over amplitude and duration [-].
    angle : float
        Angular frequency times duration [rad]: pi for half a period, 2 pi for a full one.
    harmonic : tuple of float, or None
        (a, b) if the acceleration over amplitude is sin(a x + b), x in durations; None for
        any other shape.

    Raises
    ------
    ValueError
        If a concrete value is out of range.

    Examples
    --------
    >>> import jaxrock as jr
    >>> pulse = jr.HalfSine(amplitude=3.0, duration=0.5)
    >>> print(f"{pulse.intensity:.3f} m/s, {pulse.horizontal(0.1):.3f} m/s2 after 0.1 s")
    0.955 m/s, 1.763 m/s2 after 0.1 s
    """

    amplitude: Reals = quantity(FINITE, "m/s2")
    duration: Reals = quantity(POSITIVE, "s")
    start: Reals = quantity(NON_NEGATIVE, "s")

    # Constants of the class: they are known when a program is compiled.
    extremes: ClassVar[tuple[float, ...]]
    area: ClassVar[float]
    angle: ClassVar[float]
    harmonic: ClassVar[tuple[float, float] | None] = None
    name: ClassVar[str] = "pulse"

    # Repeated in every subclass: otherwise type checkers generate one from the fields.
    def __init__(self, amplitude: Number, duration: Number, start: Number = 0.0):
        self.amplitude = as_field(Pulse, "amplitude", amplitude)
        self.duration = as_field(Pulse, "duration", duration)
        self.start = as_field(Pulse, "start", start)

    def __str__(self) -> str:
        return format_outside(self) or (
            f"{self.name} of {format_number(self.amplitude, 'm/s2')}, duration"
            f" {format_number(self.duration, 's')}, from {format_number(self.start, 's')} on"
        )

    @staticmethod
    @abc.abstractmethod
    def shape(phase: Reals) -> Reals:
        """Compute the acceleration over the amplitude.

        Parameters
        ----------
        phase : Array
            Time since the start, in durations [-].

        Returns
        -------
        ratio : Array, shape (...)
            Dimensionless acceleration [-].
        """

    @property
    def end(self) -> Reals:
        """Time from which on the ground is at rest [s]."""
        return self.start + self.extremes[-1] * self.duration

    @property
    def intensity(self) -> Reals:
        """Change of the ground velocity, I [m/s]."""
        return self.area * self.amplitude * self.duration

    @property
    def frequency(self) -> Reals:
        """Angular frequency of the pulse in the literature, omega_p [rad/s]."""
        return self.angle / self.duration

    def value(self, time: Reals) -> tuple[Reals, Reals]:
        """Compute the acceleration of the ground; see `Motion.value`."""
        horizontal = self.amplitude * self.shape((time - self.start) / self.duration)
        return horizontal, jnp.zeros_like(horizontal)

    def knots(self) -> Float[Array, " knots"]:
        """Return the `extremes` as times [s]; see `Motion.knots`."""
        return self.start + self.duration * jnp.asarray(self.extremes, self.duration.dtype)

    def scaled(self, factor: Number) -> "Pulse":
        """Return the pulse of another amplitude; see `Motion.scaled`."""
        factor = as_real("factor", factor, unit="")
        check("factor", factor, FINITE)
        return eqx.tree_at(lambda pulse: pulse.amplitude, self, self.amplitude * factor)

    def sampled(self, time_step: Number) -> Record:
        """Return the pulse as a record, which is linear between its samples.

        Parameters
        ----------
        time_step : float
            Time between samples [s], greater than 0. A jump of the pulse becomes a ramp of this
            duration.

        Returns
        -------
        Record
            From time 0 until the end of the pulse or, if it is no multiple of `time_step`, the
            next sample.

        Raises
        ------
        ValueError
            If the time step is not greater than 0.
        """
        step = as_real("time_step", time_step, unit="s")
        check("time_step", step, POSITIVE)
        times = step * np.arange(math.ceil(self.end / step) + 1, dtype=step.dtype)
        return Record(self.horizontal(times), step)


def check_pulse_class(shape: object) -> type[Pulse]:
    """Return the argument `shape`; a `ValueError` if it is no class of pulses."""
    if not (isinstance(shape, type) and issubclass(shape, Pulse)):
        raise ValueError(f"shape must be a class of pulses, for example Sine, got {shape!r}")
    return shape


class Rectangular(Pulse):
    """Constant acceleration, of intensity ``a_p duration``; see `Pulse` for the parameters.

    Examples
    --------
    >>> import jaxrock as jr
    >>> print(f"{jr.Rectangular(amplitude=3.0, duration=0.5).intensity:.3f} m/s")
    1.500 m/s
    """

    __init__ = Pulse.__init__
    name = "rectangular pulse"
    extremes = (0.0, 1.0)
    area = 1.0
    angle = math.pi  # as for half a period
    harmonic = (0.0, math.pi / 2)
    shape = staticmethod(lambda phase: jnp.ones_like(phase))


class HalfSine(Pulse):
    """Half a period of a sine, of intensity ``2 a_p duration / pi``; see `Pulse`.

    Examples
    --------
    >>> import jaxrock as jr
    >>> print(f"{jr.HalfSine(amplitude=3.0, duration=0.5).frequency:.3f} rad/s")
    6.283 rad/s
    """

    __init__ = Pulse.__init__
    name = "half-sine pulse"
    extremes = (0.0, 0.5, 1.0)
    area = 2 / math.pi
    angle = math.pi
    harmonic = (math.pi, 0.0)
    shape = staticmethod(lambda phase: jnp.sin(math.pi * phase))


class Sine(Pulse):
    """A period of a sine (type A, forward), of intensity 0; see `Pulse`.

    Examples
    --------
    >>> import jaxrock as jr
    >>> print(f"{jr.Sine(amplitude=3.0, duration=0.5).horizontal(0.375):.3f} m/s2")
    -3.000 m/s2
    """

    __init__ = Pulse.__init__
    name = "one-sine pulse"
    extremes = (0.0, 0.25, 0.75, 1.0)
    area = 0.0
    angle = 2 * math.pi
    harmonic = (2 * math.pi, 0.0)
    shape = staticmethod(lambda phase: jnp.sin(2 * math.pi * phase))


class Cosine(Pulse):
    """A period of a cosine (type B, forward and back), of intensity 0; see `Pulse`.

    Examples
    --------
    >>> import jaxrock as jr
    >>> print(f"{jr.Cosine(amplitude=3.0, duration=0.5).horizontal(0.25):.3f} m/s2")
    -3.000 m/s2
    """

    __init__ = Pulse.__init__
    name = "one-cosine pulse"
    extremes = (0.0, 0.5, 1.0)
    area = 0.0
    angle = 2 * math.pi
    harmonic = (2 * math.pi, math.pi / 2)
    shape = staticmethod(lambda phase: jnp.cos(2 * math.pi * phase))


class Ricker(Pulse):
    """Symmetric Ricker wavelet, whose `duration` is its period; see `Pulse` for the parameters.

    ``a_p (1 - 2 pi^2 x^2) exp(-pi^2 x^2)`` with x = time / duration - 2, cut off two durations
    before and after its peak, where it has fallen to 1e-15 of it. The duration is T_p, the
    period at which its Fourier spectrum is largest. The wavelet acts for four of them: until
    its `end`. Its intensity is 0.

    Examples
    --------
    >>> import jaxrock as jr
    >>> pulse = jr.Ricker(amplitude=3.0, duration=0.5)
    >>> print(f"{pulse.horizontal(1.0):.3f} m/s2 at its peak, ends at {pulse.end:.1f} s")
    3.000 m/s2 at its peak, ends at 2.0 s
    """

    __init__ = Pulse.__init__
    name = "symmetric Ricker wavelet"
    # The side peaks lie where pi^2 x^2 = 3 / 2.
    extremes = (0.0, 2 - math.sqrt(1.5) / math.pi, 2.0, 2 + math.sqrt(1.5) / math.pi, 4.0)
    # The intensity of the whole wavelet; the two tails that are cut off add up to 3e-17.
    area = 0.0
    angle = 2 * math.pi

    @staticmethod
    def shape(phase: Reals) -> Reals:
        """Compute the acceleration over the amplitude."""
        square = (math.pi * (phase - 2)) ** 2
        return (1 - 2 * square) * jnp.exp(-square)


PULSES: dict[str, type[Pulse]] = {
    "rectangular": Rectangular,
    "half-sine": HalfSine,
    "sine": Sine,
    "cosine": Cosine,
    "ricker": Ricker,
}
