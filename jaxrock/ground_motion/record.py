"""Records: samples of the ground acceleration, with straight lines between them."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..host import format_number, format_outside
from ..validation import (
    FINITE,
    NON_NEGATIVE,
    POSITIVE,
    Number,
    Numbers,
    Reals,
    as_array,
    as_field,
    as_real,
    check,
    is_traced,
    quantity,
)
from .floor import FLOOR_DAMPING, Floor, compute_floor_motion
from .motion import Motion
from .samples import integrate_samples, interpolate, refuse_empty, refuse_times
from .units import require_unit

# Records are padded to the first number of samples, or else to a multiple of the second. Each
# padded length costs a compilation, each sample only memory.
_LEAST_LENGTH = 2**14
_LENGTH_STEP = 2**16


class Record(Motion):
    """A recorded ground motion, linear between samples.

    For `respond_batch` and for intensity measures, the property
    ``_last_index`` is the index of the
    last sample. All later samples are padding (see `bucketed`).

    Parameters
    ----------
    acceleration : array_like, shape (..., samples)
        Horizontal acceleration [m/s2], finite, at least two samples.
    time_step : array_like
        Time from one sample to the next [s], greater than 0.
    vertical : array_like, shape (..., samples), optional
        Vertical acceleration [m/s2], positive upward, with the same number of samples.
    scale : array_like, optional
        Factor on both components [-].
    start : array_like, optional
        Time of the first sample [s], at least 0.
    unit : str, optional
        Unit of both accelerations, as for `read_record`, if it is not m/s2. They are converted
        here; the record itself is always in m/s2.

    Raises
    ------
    ValueError
        If a concrete value is out of range, if the numbers of samples differ or are less than
        two, if an array is empty, or if the unit is not understood.

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
    scale: Reals = quantity(FINITE, "")
    start: Reals = quantity(NON_NEGATIVE, "s")

    name = "record"

    def __init__(
        self,
        acceleration: Numbers,
        time_step: Number,
        vertical: Numbers | None = None,
        scale: Number = 1.0,
        start: Number = 0.0,
        *,
        unit: str | None = None,
    ):
        self.acceleration = _convert_samples("acceleration", acceleration, unit)
        self.time_step = as_field(Record, "time_step", time_step)
        self.vertical = (
            None if vertical is None else _convert_samples("vertical", vertical, unit)
        )
        self.scale = as_field(Record, "scale", scale)
        self.start = as_field(Record, "start", start)
        shape = self.acceleration.shape
        # `Checked`, which runs later, checks leading axes only: the axis of samples is checked
        # here.
        if shape[-1:] < (2,):
            raise ValueError(
                f"acceleration must have at least two samples, got an array of shape {shape}"
            )
        # Columns of times and accelerations, as `numpy.loadtxt` reads them, are a likely
        # mistake; nobody measures many records of two samples each.
        if len(shape) > 1 and shape[-1:] == (2,) and shape[-2:-1] > (2,):
            raise ValueError(
                "acceleration must have its samples along the last axis, got an array of shape"
                f" {shape}, which would be records of two samples each;"
                " pass only the column of accelerations"
            )
        if self.time_step.shape == shape:
            raise ValueError(
                "time_step must be one number, the time from one sample to the next, got an array"
                f" of shape {shape}, the shape of the samples: these may be their times"
            )
        for name in ("acceleration", "vertical"):
            samples = getattr(self, name)
            if samples is not None and samples.ndim == 2 and not is_traced(samples):
                refuse_times(name, np.asarray(samples))
        refuse_empty(**vars(self))
        if self.vertical is not None:
            check("vertical", self.vertical, FINITE)
            if self.vertical.shape[-1:] != shape[-1:]:
                raise ValueError(
                    f"vertical must have as many samples as acceleration, {self.samples},"
                    f" got an array of shape {self.vertical.shape}"
                )

    def __str__(self) -> str:
        return format_outside(self) or (
            f"record of {self.samples} samples, step {format_number(self.time_step, 's')},"
            f" from {format_number(self.start, 's')} on:"
            f" {format_number(self.acceleration, 'm/s2')}, scale {format_number(self.scale)}"
            f"{'' if self.vertical is None else ', with vertical'}"
        )

    @property
    def samples(self) -> int:
        """Number of samples [-]."""
        return self.acceleration.shape[-1]

    @property
    def end(self) -> Reals:
        """Time of the last sample, from which on the ground is at rest [s]."""
        return self.start + self._last_index * self.time_step

    @property
    def intensity(self) -> Reals:
        """Change of the ground velocity, I [m/s]."""
        # Padded, so that one program sums up records of many lengths.
        record = self.bucketed()
        return (
            self.scale
            * integrate_samples(record.acceleration, record._last_index)
            * self.time_step
        )

    def value(self, time: Reals) -> tuple[Reals, Reals]:
        """Compute the acceleration of the ground; see `Motion.value`.

        A sample belongs to the interval before it, since integration steps end there.
        """
        position = (time - self.start) / self.time_step
        # The time of a sample may round to either side. A little is subtracted, so that the
        # sample belongs to the line before it: otherwise a step that ends there would end on
        # the next line.
        index = jnp.ceil(position - self.time_rounding(time) / self.time_step) - 1
        # Before the start and after the end, the outer lines are continued.
        index = jnp.clip(index, 0, self._last_index - 1)
        along = position - index
        # The interval is piecewise constant: its derivative is 0, also where it jumps.
        index = jax.lax.stop_gradient(index).astype(int)
        horizontal = self.scale * interpolate(self.acceleration, index, along)
        if self.vertical is None:
            return horizontal, jnp.zeros_like(horizontal)
        return horizontal, self.scale * interpolate(self.vertical, index, along)

    def knots(self) -> Float[Array, " knots"]:
        """Return the times of the samples [s], padded with the last; see `Motion.knots`."""
        numbers = jnp.arange(self.acceleration.shape[-1], dtype=self.time_step.dtype)
        return self.start + self.time_step * jnp.minimum(numbers, self._last_index)

    def next_kink(self, time: Reals) -> Reals:
        """Return the next sample's time [s], inf beyond the last; see `Motion.next_kink`."""
        # A time within rounding of a sample counts as the sample: without this tolerance, a
        # step might have to end where it begins.
        position = (time + self.time_rounding(time) - self.start) / self.time_step
        index = jnp.maximum(jnp.floor(position) + 1, 0)
        kink = self.start + index * self.time_step
        return jnp.where(index <= self._last_index, kink, jnp.inf)

    @property
    def _last_index(self) -> int | Reals:
        """Index of the last sample that is no padding, for the other packages."""
        return self.samples - 1

    def bucketed(self) -> "Record":
        """Return the record padded, unless it is traced; see `Motion.bucketed`."""
        # A traced record already belongs to a program of its shape.
        traced = is_traced(self)
        return self if traced else PaddedRecord(self)

    def scaled(self, factor: Number) -> "Record":
        """Return the record with another `scale`; see `Motion.scaled`."""
        factor = as_real("factor", factor, unit="")
        check("factor", factor, FINITE)
        return eqx.tree_at(lambda record: record.scale, self, self.scale * factor)

    def on_floor(
        self,
        period: Numbers = 0.5,
        damping: Numbers = FLOOR_DAMPING,
        participation: Numbers = 1.0,
        *,
        time_step: Number | None = None,
        free_vibration: Number | None = None,
    ) -> "Record":
        """Compute the motion of a floor of a building on the ground of this record.

        Modes are linear oscillators. The acceleration of the floor has two parts: the sum over
        all modes of their participation times their absolute acceleration; and the acceleration
        of the ground, times 1 minus the sum of the participations.

        Parameters
        ----------
        period : array_like
            Periods of the modes [s], greater than 0.
        damping : array_like
            Damping ratios [-], at least 0 and less than 1, which is critical damping.
        participation : array_like
            Participation of each mode in the motion of the floor [-]: the modal participation
            factor times the mode shape there. A single number stands for one mode; arrays of
            periods or dampings then stand for several floors. The last axis of an array runs
            over modes, the axes before it over floors.
        time_step : float, optional
            Upper bound of the floor's time step [s]. The step of the record is divided by a
            whole number to meet it. By default the step stays that of the record.
        free_vibration : float, optional
            Free vibration after the end of this record [s], at least 0. By default it lasts
            until all floors stay below 1/1000 of their peaks, but at most as long as this
            record. If a value is traced, it is as long as this record.

        Returns
        -------
        Record
            A record with the same scale and start. Floors are leading axes of its samples,
            and broadcast with the leading axes of this record. The vertical component is that
            of the ground.

        Raises
        ------
        ValueError
            If a concrete value is out of range, shapes do not broadcast, or `time_step` or
            `free_vibration` is traced.

        Notes
        -----
        The accelerations at the samples are exact (N. C. Nigam and P. C. Jennings, Bull.
        Seismol. Soc. Am. 59 (1969) 909-922, doi:10.1785/BSSA0590020909): the modes start from
        rest at the first sample, and the acceleration of the ground is linear between samples
        and 0 from the end on. Between samples the returned record is a straight line, the
        true motion of the floor is not. If the acceleration of the ground jumps to 0 at the
        end of this record, the modes respond to the jump; the part that moves with the
        ground, and the vertical component, fall to 0 within one step.

        The object does not act back on its floor.

        Examples
        --------
        >>> import jaxrock as jr
        >>> record = jr.example_record()
        >>> floor = record.on_floor(period=0.5, damping=0.05, participation=1.3)
        >>> for motion in record, floor:
        ...     print(f"{jr.ground_motion.intensity_measure(motion, 'pga'):.2f} m/s2")
        5.01 m/s2
        10.42 m/s2
        """
        floor = Floor(
            period,
            damping,
            participation,
            time_step=time_step,
            free_vibration=free_vibration,
        )
        return put_on_floor(self, floor)


def put_on_floor(record: Record, floor: Floor) -> Record:
    """Compute the motion of a floor, or of several, on the ground of a record."""
    components = (record.acceleration, record.vertical, record.time_step)
    motion, upward, step = compute_floor_motion(components, floor)
    return Record(motion, step, upward, record.scale, record.start)


def _convert_samples(name: str, samples: Numbers, unit: str | None) -> Reals:
    """Convert the samples of an argument from a unit to an array in m/s2."""
    if unit is None:
        return as_field(Record, name, samples)
    factor = require_unit(unit)
    samples = as_field(Record, name, samples)
    if is_traced(samples):
        return factor * samples
    # NumPy is used: JAX would compile the product for every length. Values that overflow are
    # refused.
    with np.errstate(over="ignore"):
        return as_field(Record, name, factor * np.asarray(samples))


class PaddedRecord(Record):
    """A concrete record with zeros after its end, so that many lengths share a program.

    The index of the last sample of the record itself, `filled`, is not static: otherwise there
    would be a program for each length again.
    """

    filled: Reals = quantity(NON_NEGATIVE)

    def __init__(self, record: Record):
        # NumPy pads: JAX would compile the padding for every length.
        room = choose_padded_length(record.samples)
        vertical = record.vertical
        self.acceleration = as_array(pad_samples(record.acceleration, room))
        self.vertical = None if vertical is None else as_array(pad_samples(vertical, room))
        self.time_step = record.time_step
        self.scale = record.scale
        self.start = record.start
        self.filled = as_array(np.asarray(record._last_index, self.acceleration.dtype))

    @property
    def _last_index(self) -> Reals:
        """Index of the last sample of the record itself."""
        return self.filled

    def bucketed(self) -> "PaddedRecord":
        """Return itself."""
        return self


def choose_padded_length(samples: int) -> int:
    """Choose the padded length for a number of samples, one of few."""
    return (
        _LEAST_LENGTH
        if samples <= _LEAST_LENGTH
        else -(-samples // _LENGTH_STEP) * _LENGTH_STEP
    )


def pad_samples(samples: ArrayLike, room: int) -> np.ndarray:
    """Pad the last axis of samples with zeros, up to a length."""
    samples = np.asarray(samples)
    return np.pad(samples, [(0, 0)] * (samples.ndim - 1) + [(0, room - samples.shape[-1])])
