"""Ground motions as the batch takes them: inputs that blocks share, and the numbers of each.

Records of all lengths lie one after the other in flat arrays, which have room for more, so
that one program follows blocks under most suites.
"""

import functools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ...ground_motion import Harmonic, Motion, Pulse, Record, Sine, Suite
from ...validation import choose_namespace, is_traced
from .ground_input import HostNumbers
from .pulse_inputs import PulseInput, make_pulse_input
from .record_input import GRADES, STRIDE, RecordInput

# Samples and records that there is room for, at least and in steps of a factor of 4: the fewer
# sizes, the fewer programs, and a sample that is not used costs a few bytes. In steps of 2 from
# a million samples on, for the sake of memory.
_LEAST_ROOM = 2**14
_LARGE_ROOM = 2**20
_LEAST_RECORDS = 64

GroundInput = PulseInput | RecordInput


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
    input : GroundInput
        The motions for a factor of 1, which the blocks share.
    factor, length, start, end, motion : Array
        The numbers of each block's motion, which broadcast with the block's own numbers: the
        factor on the input (amplitude or scale), the length of an interval [s], start and end
        [s], and the index of the motion, where there are several.
    """

    input: GroundInput
    factor: HostNumbers
    length: HostNumbers
    start: HostNumbers
    end: HostNumbers
    motion: HostNumbers

    def map_numbers(self, function: Callable[[HostNumbers], HostNumbers]) -> "GroundMotions":
        """Apply a function to all numbers that differ from block to block."""
        numbers = self.factor, self.length, self.start, self.end, self.motion
        return GroundMotions(self.input, *map(function, numbers))


def convert_motion(motion: Motion | Suite | RecordVariants, axes: int = 0) -> GroundMotions:
    """Convert a motion or a suite, whose arrays are of one type, to what the batch takes.

    The records of a suite make the leading axis of the numbers, followed by at least `axes`.
    """
    if isinstance(motion, Pulse | Harmonic):
        dtype = motion.amplitude.dtype
        if isinstance(motion, Pulse):
            ground = make_pulse_input(type(motion), dtype)
            length = motion.duration * motion.extremes[-1]
            periods = 1
        else:
            periods = motion._period_count
            ground = make_pulse_input(Sine, dtype, periods)
            length = 2 * math.pi / motion.frequency
        end = motion.start + periods * length
        only = np.zeros((), dtype)
        return GroundMotions(ground, motion.amplitude, length, motion.start, end, only)
    assert isinstance(motion, Record | Suite | RecordVariants)
    records = [motion] if isinstance(motion, Record) else motion.records
    which = getattr(motion, "which", 0)
    axes = max(axes, np.ndim(records[0].scale), np.ndim(which))

    def make_column(values: Sequence[HostNumbers] | np.ndarray) -> HostNumbers:
        if isinstance(motion, Record):
            return values[0]
        column = choose_namespace(values).stack(values)
        own_axes = column.shape[1:]
        return column.reshape(len(records), *[1] * (axes - len(own_axes)), *own_axes)

    indices = make_column(np.arange(len(records), dtype=records[0].acceleration.dtype))
    if isinstance(motion, RecordVariants):
        indices = indices * records[0].acceleration.shape[0] + which
    elif isinstance(motion, Record):
        components = jax.tree.leaves((motion.acceleration, motion.vertical))
        *shape, _ = np.broadcast_shapes(*(samples.shape for samples in components))
        indices = np.arange(math.prod(shape), dtype=indices.dtype).reshape(shape)
    ends = [record.start + record._last_index * record.time_step for record in records]
    return GroundMotions(
        _make_record_input(records),
        make_column([record.scale for record in records]),
        make_column([record.time_step for record in records]),
        make_column([record.start for record in records]),
        make_column(ends),
        indices,
    )


def _make_record_input(records: Sequence[Record]) -> RecordInput:
    """Lay records, or arrays of records of one length, one after the other."""
    components = [(record.acceleration, record.vertical) for record in records]
    namespace = choose_namespace(components)
    has_vertical = any(vertical is not None for _, vertical in components)
    flat_samples = []
    counts = []
    for record, (horizontal, vertical) in zip(records, components, strict=True):
        samples = [horizontal]
        if has_vertical:
            samples.append(namespace.zeros_like(horizontal) if vertical is None else vertical)
        last = record._last_index
        # A padded record ends before its last sample.
        count = record.samples if is_traced(last) else int(last) + 1
        samples = namespace.broadcast_arrays(*(part[..., :count] for part in samples))
        flat_samples.append([part.reshape(-1) for part in samples])
        counts += [count] * math.prod(samples[0].shape[:-1])
    components = [namespace.concatenate(parts) for parts in zip(*flat_samples, strict=True)]

    # Traced samples have a program of their own anyway.
    size = components[0].size
    room = size if namespace is jnp else _LEAST_ROOM
    while room < size:
        room *= 4 if room < _LARGE_ROOM else 2
    # Places in the table of strides are 32-bit integers.
    if room * GRADES >= 2**31:
        raise ValueError(f"motion has {size} samples, more than 2^26 in one batch")
    samples = [namespace.pad(component, (0, room - size)) for component in components]
    places = _LEAST_RECORDS
    while places < len(counts):
        places *= 4
    # Where there is no record, one without an interval at the very end.
    first = np.full(places, room - 1, np.int32)
    first[: len(counts)] = np.cumsum([0, *counts[:-1]])
    intervals = np.zeros(places, np.int32)
    intervals[: len(counts)] = np.asarray(counts) - 1
    # From the last sample of a record to the next record there is no interval.
    exists = np.ones(room, bool)
    exists[first + intervals] = False

    # A record is finite if the running number of wrong samples is the same at its last sample
    # as before its first one.
    finite = namespace.isfinite(sum(samples))
    nonfinite_count = namespace.cumsum(~finite, dtype=np.int32)
    before = namespace.concatenate([namespace.zeros(1, np.int32), nonfinite_count])[first]

    # The strength of an interval is the largest magnitude at its ends. Its grade says how much
    # weaker than the strongest one it is. The threshold of the last grade is 0, which every
    # interval exceeds in which the ground moves.
    # Whether a block might be lifted has no derivative.
    fixed = jax.lax.stop_gradient(samples) if namespace is jnp else samples
    magnitude = functools.reduce(namespace.maximum, map(abs, fixed))
    strength = namespace.where(
        finite[1:] & finite[:-1] & exists[:-1],
        namespace.maximum(magnitude[1:], magnitude[:-1]),
        0,
    )
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
