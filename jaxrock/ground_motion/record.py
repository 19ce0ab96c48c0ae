"""Records: samples of the ground acceleration, with straight lines between them."""

from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..host import derivatives, shown
from ..validation import (
    FINITE,
    NON_NEGATIVE,
    POSITIVE,
    Number,
    Numbers,
    Reals,
    as_array,
    as_real,
    check,
    is_traced,
    quantity,
)
from .motion import Motion

# samples: to the one, or multiples of the other, records are padded
_SHORT = 2**14
_LONG = 2**16


class Record(Motion):
    """A recorded ground motion, linear between samples.

    Parameters
    ----------
    acceleration : array_like, shape (..., samples)
        Horizontal acceleration [m/s2], finite, at least two samples.
    time_step : array_like
        Time from one sample to the next [s], greater than 0.
    vertical : array_like, shape (..., samples), optional
        Vertical acceleration [m/s2], positive upward, with the same number of samples.
    scale : array_like, optional
        Factor on both components [-]. A gradient with respect to it costs one derivative, one
        with respect to the samples as many as there are.
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

    vertical: Reals | None = quantity(None, "m/s2", own_axes=1)
    acceleration: Reals = quantity(FINITE, "m/s2", own_axes=1)
    time_step: Reals = quantity(POSITIVE, "s")
    scale: Reals = quantity(FINITE)
    start: Reals = quantity(NON_NEGATIVE, "s")

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
        shape = self.acceleration.shape
        got = "got an array of shape"
        if shape[-1:] < (2,):
            raise ValueError(f"acceleration must have at least two samples, {got} {shape}")
        if len(shape) > 1 and shape[-1:] == (2,) and shape[-2:-1] > (2,):
            hint = (
                "which would be records of two samples; pass the column of accelerations alone"
            )
            raise ValueError(
                f"acceleration must be samples along the last axis, {got} {shape}, {hint}"
            )
        for name, value in vars(self).items():
            if value is not None and value.size == 0:
                raise ValueError(f"{name} must not be empty, {got} {value.shape}")
        if self.vertical is not None:
            check("vertical", self.vertical, FINITE)
            if self.vertical.shape[-1:] != shape[-1:]:
                must = f"vertical must have as many samples as acceleration, {self.samples}"
                raise ValueError(f"{must}, {got} {self.vertical.shape}")

    def __str__(self) -> str:
        return derivatives(self) or (
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
        record = self.bucketed()
        return self.scale * _sum(record.acceleration, record._last) * self.time_step

    def value(self, time: Reals) -> tuple[Reals, Reals]:
        """Acceleration of the ground; see `Motion.value`.

        A sample belongs to the interval before it, since integration steps end there.
        """
        position = (time - self.start) / self.time_step
        index = jnp.ceil(position - self._rounding(position)) - 1
        index = jnp.clip(index, 0, self._last - 1)
        along = position - index
        index = jax.lax.stop_gradient(index).astype(int)
        horizontal = self.scale * _interpolated(self.acceleration, index, along)
        if self.vertical is None:
            return horizontal, jnp.zeros_like(horizontal)
        return horizontal, self.scale * _interpolated(self.vertical, index, along)

    def knots(self) -> Float[Array, " knots"]:
        """Return the times of the samples [s], padded with the last; see `Motion.knots`."""
        numbers = jnp.arange(self.acceleration.shape[-1], dtype=self.time_step.dtype)
        return self.start + self.time_step * jnp.minimum(numbers, self._last)

    def next_kink(self, time: Reals) -> Reals:
        """Return the next sample's time [s], inf beyond the last; see `Motion.next_kink`."""
        position = (time - self.start) / self.time_step
        index = jnp.maximum(jnp.floor(position + self._rounding(position)) + 1, 0)
        kink = self.start + index * self.time_step
        return jnp.where(index <= self._last, kink, jnp.inf)

    @property
    def _last(self) -> Any:  # the index of the last sample
        return self.samples - 1

    def _rounding(self, position: Reals) -> Any:
        """Bound on the rounding of a position, in samples; it grows with the length."""
        return 4 * (self._last + 1) * float(jnp.finfo(position.dtype).eps)

    def bucketed(self) -> "Record":
        """Return the record padded, unless it is traced; see `Motion.bucketed`."""
        traced = is_traced(self)
        return self if traced else Padded(self)

    def scaled(self, factor: Number) -> "Record":
        """Return the record with another `scale`; see `Motion.scaled`."""
        factor = as_real("factor", factor)
        check("factor", factor, FINITE)
        return eqx.tree_at(lambda record: record.scale, self, self.scale * factor)


@jax.jit
def _sum(samples: Reals, last: Any) -> Reals:
    """Integrate over the time step, by the trapezoidal rule."""
    at_end = jnp.take(samples, jnp.asarray(last).astype(int), axis=-1)
    return samples.sum(axis=-1) - 0.5 * (samples[..., 0] + at_end)


class Padded(Record):
    """A concrete record with zeros after its end, so that many lengths share a program."""

    filled: Reals = quantity(NON_NEGATIVE)  # index of the last sample of the record itself

    def __init__(self, record: Record):
        # In NumPy: JAX would compile the padding for every length.
        room = room_for(record.samples)
        vertical = record.vertical
        self.acceleration = as_real("acceleration", padded(record.acceleration, room))
        self.vertical = (
            None if vertical is None else as_real("vertical", padded(vertical, room))
        )
        self.time_step = record.time_step
        self.scale = record.scale
        self.start = record.start
        self.filled = as_array(np.asarray(record._last, self.acceleration.dtype))

    @property
    def _last(self) -> Any:
        return self.filled

    def bucketed(self) -> "Padded":
        """Itself."""
        return self


def room_for(samples: int) -> int:
    """Return the padded length for a number of samples, one of few."""
    return _SHORT if samples <= _SHORT else -(-samples // _LONG) * _LONG


def padded(samples: Any, room: int) -> np.ndarray:
    """Pad samples with zeros, up to a length."""
    samples = np.asarray(samples)
    return np.pad(samples, [(0, 0)] * (samples.ndim - 1) + [(0, room - samples.shape[-1])])


def _interpolated(samples: Reals, index: Array, along: Reals) -> Reals:
    """Linear interpolation in the last axis; leading axes broadcast with those of `index`."""
    shape = jnp.broadcast_shapes(samples.shape[:-1], index.shape)
    samples = jnp.broadcast_to(samples, (*shape, samples.shape[-1]))
    index = jnp.broadcast_to(index, shape)[..., None]
    left, right = (
        jnp.take_along_axis(samples, at, axis=-1, mode="promise_in_bounds")[..., 0]
        for at in (index, index + 1)
    )
    return (1 - along) * left + along * right  # exact at both ends
