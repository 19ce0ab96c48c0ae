"""Ground motions as the batch takes them: inputs that blocks share, and the numbers of each.

Records of all lengths lie one after the other in flat arrays, which have room for more, so
that one program follows blocks under most suites.
"""

import functools
import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ...ground_motion import Harmonic, Motion, Pulse, Record, Sine, Suite
from ...validation import Number, choose_namespace, is_traced
from .ground_input import GroundInput, HostNumbers, HostReals
from .pulse_inputs import PulseInput, make_pulse_input
from .record_input import GRADES, STRIDE, RecordInput

# Samples that there is room for, in steps of a factor of 4: the fewer lengths, the fewer
# programs, and a sample that is not used costs a few bytes. A group of records has so much
# room at most, unless it is one long record.
_LEAST_ROOM = 2**14
_GROUP_ROOM = 2**20
_RECORDS = 64  # that there is room for, at least


class MotionNumbers(NamedTuple):
    """The numbers of each block's motion; they broadcast with the block's own numbers."""

    factor: HostNumbers  # on the input: amplitude or scale
    length: HostNumbers  # of an interval [s]
    start: HostNumbers  # of the motion [s]
    end: HostNumbers
    motion: HostNumbers  # index among the records of all parts


class RecordVariants(NamedTuple):
    """Records of a suite in several variants, and which of them each block feels.

    Attributes
    ----------
    records : tuple of Record
        Samples of shape (variants, samples), as many variants of each record.
    which : Array, shape (...)
        The variant of each block; these axes follow the axis of the records.
    """

    records: tuple[Record, ...]
    which: HostNumbers


class GroundMotions(eqx.Module):
    """Ground motions of the blocks of a batch.

    Attributes
    ----------
    parts : tuple of GroundInput
        Inputs for a factor of 1. There is one, unless records are so many that they are
        followed in groups, for the sake of memory.
    factor, length, start, end, motion : Array
        See `MotionNumbers`.
    begins : tuple of int
        The first record of each part.
    """

    parts: tuple[GroundInput, ...]
    factor: HostNumbers
    length: HostNumbers
    start: HostNumbers
    end: HostNumbers
    motion: HostNumbers
    begins: tuple[int, ...] = eqx.field(static=True, default=(0,))

    @property
    def numbers(self) -> MotionNumbers:
        """The numbers that differ from block to block."""
        return MotionNumbers(self.factor, self.length, self.start, self.end, self.motion)

    def replace_numbers(self, numbers: MotionNumbers) -> "GroundMotions":
        """Return the same inputs for other blocks."""
        return GroundMotions(self.parts, *numbers, begins=self.begins)

    def scaled(self, factor: Number) -> "GroundMotions":
        """Return stronger or weaker motions."""
        return eqx.tree_at(lambda ground: ground.factor, self, self.factor * factor)


def convert_motion(
    motion: Motion | Suite | RecordVariants, axes: int = 0, grouped: bool = False
) -> GroundMotions:
    """Convert a motion or a suite, whose arrays are of one type, to what the batch takes.

    The records of a suite make the leading axis of the numbers, followed by `axes` others.
    Outside of a transformation they may be `grouped`.
    """
    if isinstance(motion, Pulse):
        length = motion.duration * motion.extremes[-1]
        ground = make_pulse_input(type(motion), motion.amplitude.dtype)
        return _convert_pulses(ground, motion, length, motion.start + length)
    if isinstance(motion, Harmonic):
        length = 2 * math.pi / motion.frequency
        end = motion.start + motion._period_count * length
        ground = make_pulse_input(Sine, motion.amplitude.dtype, motion._period_count)
        return _convert_pulses(ground, motion, length, end)
    if isinstance(motion, Suite):
        return _convert_suite(motion.records, axes, grouped)
    if isinstance(motion, RecordVariants):
        ground = _convert_suite(motion.records, axes, grouped)
        numbers = ground.numbers
        variants = motion.records[0].acceleration.shape[0]
        numbers = numbers._replace(motion=numbers.motion * variants + motion.which)
        return ground.replace_numbers(numbers)
    assert isinstance(motion, Record)
    return _convert_record(motion, grouped)


def _convert_pulses(
    ground: PulseInput, motion: Pulse | Harmonic, length: HostNumbers, end: HostNumbers
) -> GroundMotions:
    only = np.zeros((), ground.extent.dtype)
    return GroundMotions((ground,), motion.amplitude, length, motion.start, end, only)


def _convert_record(record: Record, grouped: bool) -> GroundMotions:
    """Convert a record, or an array of records of one length."""
    samples = [record.acceleration]
    if record.vertical is not None:
        samples.append(record.vertical)
    namespace = choose_namespace(samples)
    samples = namespace.broadcast_arrays(*samples)
    shape = samples[0].shape[:-1]
    number = math.prod(shape)
    end = record.start + record._last_index * record.time_step
    if not shape and namespace is np:
        # A padded record ends before its last sample.
        samples = [part[: int(record._last_index) + 1] for part in samples]
    counts = [samples[0].shape[-1]] * number
    parts, begins = _lay_out([part.reshape(-1) for part in samples], counts, grouped)
    motions = np.arange(number, dtype=samples[0].dtype).reshape(shape)
    return GroundMotions(
        parts, record.scale, record.time_step, record.start, end, motions, begins
    )


def _convert_suite(records: Sequence[Record], axes: int, grouped: bool) -> GroundMotions:
    """Convert the records of a suite, whose numbers get a leading axis of records."""
    has_vertical = any(record.vertical is not None for record in records)
    names = ["acceleration", "vertical"] if has_vertical else ["acceleration"]

    def join_samples(name: str) -> HostReals:
        samples = [getattr(record, name) for record in records]
        namespace = choose_namespace(samples)
        zeros = [namespace.zeros_like(record.acceleration) for record in records]
        pairs = zip(samples, zeros, strict=True)
        # Variants of a record, which have an axis, lie one after the other.
        parts = [
            zero if part is None else namespace.broadcast_to(part, zero.shape)
            for part, zero in pairs
        ]
        return namespace.concatenate([part.reshape(-1) for part in parts])

    def make_column(values: Sequence[HostNumbers]) -> HostNumbers:
        value_shape = values[0].shape
        namespace = choose_namespace(values)
        shape = (len(records), *[1] * (axes - len(value_shape)), *value_shape)
        return namespace.stack([namespace.asarray(value) for value in values]).reshape(shape)

    counts = [
        record.samples
        for record in records
        for _ in range(math.prod(record.acceleration.shape[:-1]))
    ]
    parts, begins = _lay_out([join_samples(name) for name in names], counts, grouped)
    ends = [record.start + record._last_index * record.time_step for record in records]
    dtype = records[0].acceleration.dtype
    return GroundMotions(
        parts,
        make_column([record.scale for record in records]),
        make_column([record.time_step for record in records]),
        make_column([record.start for record in records]),
        make_column(ends),
        make_column([np.asarray(k, dtype) for k in range(len(records))]),
        begins,
    )


def _lay_out(
    samples: Sequence[HostReals], counts: Sequence[int], grouped: bool
) -> tuple[tuple[RecordInput, ...], tuple[int, ...]]:
    """Lay records out in groups, as memory allows; return the first record of each as well.

    `samples` has an array for each component, all records one after the other; `counts` says
    how many each record has.
    """
    edges = np.concatenate([[0], np.cumsum(counts)])
    begins = [0]
    traced = is_traced(samples)
    for k in range(1, len(counts)):
        if grouped and edges[k + 1] - edges[begins[-1]] > _GROUP_ROOM:
            begins.append(k)
    limits = list(itertools.pairwise([*begins, len(counts)]))
    most = int(max(edges[end] - edges[begin] for begin, end in limits))
    # Traced samples have a program of their own anyway.
    room = most if traced else _choose_room(most)
    # Places in the table of strides are 32-bit integers.
    if room * GRADES >= 2**31:
        raise ValueError(
            f"motion has {most} samples, more than {2**31 // GRADES} in one batch"
        )
    number = max(end - begin for begin, end in limits)
    places = _RECORDS
    while places < number:
        places *= 4
    parts = []
    for begin, end in limits:
        part = [component[edges[begin] : edges[end]] for component in samples]
        if not traced:
            part = [
                np.pad(np.asarray(component), (0, room - component.size)) for component in part
            ]
        # Where there is no record, one without an interval at the very end.
        first = np.full(places, room - 1, np.int32)
        first[: end - begin] = edges[begin:end] - edges[begin]
        intervals = np.zeros(places, np.int32)
        intervals[: end - begin] = np.asarray(counts[begin:end]) - 1
        parts.append(_make_record_input(part, first, intervals))
    return tuple(parts), tuple(begins)


def _choose_room(samples: int) -> int:
    """Return the padded length for a number of samples, one of few."""
    room = _LEAST_ROOM
    while room < min(samples, _GROUP_ROOM):
        room *= 4
    return (
        max(room, -(-samples // _GROUP_ROOM) * _GROUP_ROOM) if samples > _GROUP_ROOM else room
    )


def _make_record_input(
    samples: Sequence[HostReals], first: np.ndarray, intervals: np.ndarray
) -> RecordInput:
    """Make the input of components of one length, in which records begin at `first`."""
    namespace = choose_namespace(samples)
    room = samples[0].shape[0]
    places = np.arange(room - 1, dtype=np.int32)
    # From the last sample of a record to the next record there is no interval.
    record = np.searchsorted(first, places, side="right") - 1
    exists = places < (first + intervals)[record]

    # A record is finite if the running number of wrong samples is the same at its last sample
    # as before its first one.
    finite = namespace.isfinite(sum(samples))
    nonfinite_count = namespace.cumsum(~finite, dtype=np.int32)
    before = namespace.concatenate([namespace.zeros(1, np.int32), nonfinite_count])[first]

    # The strength of an interval is the largest magnitude at its ends. Its grade says how much
    # weaker than the strongest one it is. The threshold of the last grade is 0, which every
    # interval exceeds in which the ground moves.
    ends = [namespace.maximum(abs(part[1:]), abs(part[:-1])) for part in samples]
    strength = functools.reduce(namespace.maximum, ends)
    strength = namespace.where(finite[1:] & finite[:-1] & exists, strength, 0)
    strongest = strength.max()
    grades = np.append(2 ** (-0.5 * np.arange(GRADES - 1)), 0).astype(strength.dtype)

    # For each stride and grade the next stride that exceeds it. With the grades last, the
    # minimum over all that follows runs on SIMD lanes.
    strides = -(-room // STRIDE)
    in_strides = namespace.pad(strength, (0, strides * STRIDE - strength.size))
    in_strides = in_strides.reshape(strides, STRIDE).max(axis=1)
    strong = in_strides[:, None] > (strongest * grades)[None]
    beyond = namespace.where(
        strong, np.arange(strides, dtype=np.int32)[:, None], np.int32(strides)
    )
    if namespace is np:
        following = np.minimum.accumulate(beyond[::-1])[::-1]
    else:
        following = jax.lax.cummin(beyond, reverse=True)

    components = [(part[:-1], namespace.diff(part)) for part in samples]
    ground = RecordInput(
        horizontal=components[0],
        vertical=components[1] if components[1:] else (),
        strongest=namespace.asarray(strongest),
        finite=nonfinite_count[first + intervals] == before,
        following=following.reshape(-1),
        first_intervals=first,
        intervals=intervals,
    )
    return jax.tree.map(jnp.asarray, ground) if namespace is jnp else jax.device_put(ground)
