"""Ground motions as the batch takes them: what blocks share, and the numbers of each.

Records of all lengths lie one after the other in flat arrays, which have room for more, so
that one program follows blocks under most suites.
"""

import functools
import math
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np

from ...block import Block
from ...ground_motion import Harmonic, Motion, Pulse, Record, Sine, Suite
from ...validation import Number, is_traced, namespace_of
from .ground_inputs import GRADES, STRIDE, PulseInput, RecordInput

# samples that there is room for, in steps of a factor of 4
_LEAST = 2**14
_MOST = 2**20
_RECORDS = 64  # that there is room for, at least


class GroundMotions(eqx.Module):
    """Ground motions of the blocks of a batch.

    All but `parts` and `begins` have shapes that broadcast with those of the blocks.

    Attributes
    ----------
    parts : tuple
        Inputs for a factor of 1. There is one, unless records are so many that they are
        followed in groups, for the sake of memory.
    factor : Array
        On the input: amplitude or scale.
    length : Array
        Of an interval [s].
    start, end : Array
        Of the motion [s].
    motion : Array
        Which of the records of all parts it is, where there are several.
    begins : tuple of int
        The first record of each part.
    """

    parts: tuple[PulseInput | RecordInput, ...]
    factor: Any
    length: Any
    start: Any
    end: Any
    motion: Any
    begins: tuple[int, ...] = eqx.field(static=True, default=(0,))

    @property
    def numbers(self) -> tuple[Any, ...]:
        """The numbers that differ from block to block, in the order of the fields."""
        return self.factor, self.length, self.start, self.end, self.motion

    def with_numbers(self, numbers: tuple[Any, ...]) -> "GroundMotions":
        """Return the same inputs for other blocks."""
        return GroundMotions(self.parts, *numbers, begins=self.begins)

    def scaled(self, factor: Any) -> "GroundMotions":
        """Stronger or weaker motions."""
        return eqx.tree_at(lambda ground: ground.factor, self, self.factor * factor)


class Batch(eqx.Module):
    """Blocks under ground motions, all of one type, in NumPy where they are concrete.

    Attributes
    ----------
    block, restitution : Block, Array
    ground : GroundMotions
    until : Array
        Time up to which each block is followed [s].
    """

    block: Block
    restitution: Any
    ground: GroundMotions
    until: Any

    @classmethod
    def of(
        cls,
        block: Block,
        restitution: Number,
        motion: Motion | Suite | GroundMotions,
        duration: Number | None = None,
        axes: int = 0,
    ) -> "Batch":
        """Make the batch, to be followed to the end of the motion or for a duration.

        The answers have as many `axes` at least, behind that of the records of a suite.
        """
        leaves = jax.tree.leaves((block, restitution, motion, duration))
        with jax.numpy_dtype_promotion("standard"):
            floats = [
                leaf.dtype for leaf in leaves if jnp.issubdtype(leaf.dtype, jnp.floating)
            ]
            dtype = jnp.result_type(*floats)
        namespace = namespace_of(leaves)

        def converted(tree: Any) -> Any:
            return jax.tree.map(lambda leaf: namespace.asarray(leaf, dtype), tree)

        if isinstance(motion, GroundMotions):
            ground = motion.with_numbers(converted(motion.numbers))
        else:
            others = jax.tree.leaves((block, restitution, duration))
            axes = max(axes, *(np.ndim(leaf) for leaf in others))
            if isinstance(motion, Suite):
                axes = max(axes, np.ndim(motion.records[0].scale))
            ground = ground_of(converted(motion), axes, grouped=namespace is np)
        until = ground.end if duration is None else converted(duration)
        return cls(converted(block), converted(restitution), ground, until)

    @property
    def traced(self) -> bool:
        """True if it is part of a transformation."""
        return is_traced(self)

    @property
    def dtype(self) -> np.dtype:
        """The type of all numbers."""
        return self.restitution.dtype

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the answers."""
        return np.broadcast_shapes(*(leaf.shape for leaf in jax.tree.leaves(self._numbers)))

    @property
    def _numbers(self) -> Any:
        factor, length, start, _, motion = self.ground.numbers
        return self.block, self.restitution, factor, length, start, self.until, motion

    def rows(self) -> tuple[Any, Any]:
        """Flatten the numbers, a column each block; return the tree's structure as well."""
        leaves, form = jax.tree.flatten(self._numbers)
        namespace = namespace_of(leaves)
        shape = self.shape
        flat = [namespace.broadcast_to(leaf, shape).reshape(-1) for leaf in leaves]
        return namespace.stack(flat), form

    def part(self, index: np.ndarray) -> "Batch":
        """Select some of a concrete batch, by their places in the flat one."""
        shape = self.shape

        def taken(leaf: Any) -> Any:
            return np.broadcast_to(leaf, shape).reshape(-1)[index]

        numbers = jax.tree.map(taken, self.ground.numbers)
        ground = self.ground.with_numbers(numbers)
        rest = (self.block, self.restitution, self.until)
        block, restitution, until = jax.tree.map(taken, rest)
        return Batch(block, restitution, ground, until)

    def scaled(self, factor: Any) -> "Batch":
        """Under stronger or weaker motions."""
        return Batch(self.block, self.restitution, self.ground.scaled(factor), self.until)


def ground_of(motion: Motion | Suite, axes: int = 0, grouped: bool = False) -> GroundMotions:
    """Convert a motion or a suite, whose arrays are of one type, to what the batch takes.

    The records of a suite make the leading axis of the numbers, followed by `axes` others.
    Outside of a transformation they may be `grouped`.
    """
    if isinstance(motion, Pulse):
        length = motion.duration * motion.extremes[-1]
        ground = PulseInput.of(type(motion), motion.amplitude.dtype)
        return _of_one_kind(ground, motion, motion.amplitude, length, motion.start + length)
    if isinstance(motion, Harmonic):
        length = 2 * math.pi / motion.frequency
        end = motion.start + motion._number * length
        ground = PulseInput.of(Sine, motion.amplitude.dtype, motion._number)
        return _of_one_kind(ground, motion, motion.amplitude, length, end)
    if isinstance(motion, Suite):
        return _of_suite(motion, axes, grouped)
    assert isinstance(motion, Record)
    return _of_record(motion, grouped)


def _of_one_kind(
    ground: PulseInput, motion: Pulse | Harmonic, factor: Any, length: Any, end: Any
) -> GroundMotions:
    none = np.zeros((), ground.extent.dtype)
    return GroundMotions((ground,), factor, length, motion.start, end, none)


def _of_record(record: Record, grouped: bool) -> GroundMotions:
    """Of a record, or an array of them."""
    samples = [record.acceleration]
    if record.vertical is not None:
        samples.append(record.vertical)
    namespace = namespace_of(samples)
    samples = namespace.broadcast_arrays(*samples)
    shape = samples[0].shape[:-1]
    number = math.prod(shape)
    end = record.start + record._last * record.time_step
    if not shape and namespace is np:
        # Of a padded one what counts.
        samples = [part[: int(record._last) + 1] for part in samples]
    counts = [samples[0].shape[-1]] * number
    parts, begins = _dealt([part.reshape(-1) for part in samples], counts, grouped)
    motions = np.arange(number, dtype=samples[0].dtype).reshape(shape)
    return GroundMotions(
        parts, record.scale, record.time_step, record.start, end, motions, begins
    )


def _of_suite(suite: Suite, axes: int, grouped: bool) -> GroundMotions:
    has_vertical = any(record.vertical is not None for record in suite)
    names = ["acceleration", "vertical"] if has_vertical else ["acceleration"]

    def all_samples(name: str) -> Any:
        each = [getattr(record, name) for record in suite]
        namespace = namespace_of(each)
        zeros = [namespace.zeros_like(record.acceleration) for record in suite]
        pairs = zip(each, zeros, strict=True)
        return namespace.concatenate([zero if part is None else part for part, zero in pairs])

    def column(values: Sequence[Any]) -> Any:
        own = values[0].shape
        namespace = namespace_of(values)
        shape = (len(suite), *[1] * (axes - len(own)), *own)
        return namespace.stack([namespace.asarray(value) for value in values]).reshape(shape)

    counts = [record.samples for record in suite]
    parts, begins = _dealt([all_samples(name) for name in names], counts, grouped)
    ends = [record.start + record._last * record.time_step for record in suite]
    return GroundMotions(
        parts,
        column([record.scale for record in suite]),
        column([record.time_step for record in suite]),
        column([record.start for record in suite]),
        column(ends),
        column(
            [np.asarray(k, suite.records[0].acceleration.dtype) for k in range(len(suite))]
        ),
        begins,
    )


def _dealt(
    samples: Sequence[Any], counts: Sequence[int], grouped: bool
) -> tuple[tuple[RecordInput, ...], tuple[int, ...]]:
    """Group records, one after the other, as memory allows; with the first of each group."""
    edges = np.concatenate([[0], np.cumsum(counts)])
    begins = [0]
    traced = is_traced(samples)
    for k in range(1, len(counts)):
        if grouped and edges[k + 1] - edges[begins[-1]] > _MOST:
            begins.append(k)
    ends = [*begins[1:], len(counts)]
    most = max(edges[end] - edges[begin] for begin, end in zip(begins, ends, strict=True))
    room = int(most) if traced else _room_for(int(most))
    if room * GRADES >= 2**31:
        raise ValueError(
            f"motion has {most} samples, more than {2**31 // GRADES} in one batch"
        )
    number = max(end - begin for begin, end in zip(begins, ends, strict=True))
    places = _RECORDS
    while places < number:
        places *= 4
    parts = []
    for begin, end in zip(begins, ends, strict=True):
        part = [all_[edges[begin] : edges[end]] for all_ in samples]
        if not traced:
            part = [np.pad(np.asarray(each), (0, room - each.size)) for each in part]
        # Where there is no record, one without an interval at the very end.
        first = np.full(places, room - 1, np.int32)
        first[: end - begin] = edges[begin:end] - edges[begin]
        intervals = np.zeros(places, np.int32)
        intervals[: end - begin] = np.asarray(counts[begin:end]) - 1
        parts.append(_record_input(part, first, intervals))
    return tuple(parts), tuple(begins)


def _room_for(samples: int) -> int:
    """Return the padded length for a number of samples, one of few."""
    room = _LEAST
    while room < min(samples, _MOST):
        room *= 4
    return max(room, -(-samples // _MOST) * _MOST) if samples > _MOST else room


def _record_input(
    samples: Sequence[Any], first: np.ndarray, intervals: np.ndarray
) -> RecordInput:
    """Of components of the same length, in which records begin at their first places."""
    namespace = namespace_of(samples)
    room = samples[0].shape[0]
    places = np.arange(room - 1, dtype=np.int32)
    # From the last sample of a record to the next record there is no interval.
    record = np.searchsorted(first, places, side="right") - 1
    exists = places < (first + intervals)[record]
    finite = namespace.isfinite(sum(samples))
    wrong = namespace.cumsum(~finite, dtype=np.int32)
    before = namespace.concatenate([namespace.zeros(1, np.int32), wrong])[first]
    ends = [namespace.maximum(abs(part[1:]), abs(part[:-1])) for part in samples]
    strength = functools.reduce(namespace.maximum, ends)
    strength = namespace.where(finite[1:] & finite[:-1] & exists, strength, 0)
    strongest = strength.max()
    grades = np.append(2 ** (-0.5 * np.arange(GRADES - 1)), 0).astype(strength.dtype)
    # With the grades last, the minimum over all that follows runs on SIMD lanes.
    strides = -(-room // STRIDE)
    within = namespace.pad(strength, (0, strides * STRIDE - strength.size))
    within = within.reshape(strides, STRIDE).max(axis=1)
    strong = within[:, None] > (strongest * grades)[None]
    beyond = namespace.where(
        strong, np.arange(strides, dtype=np.int32)[:, None], np.int32(strides)
    )
    if namespace is np:
        following = np.minimum.accumulate(beyond[::-1])[::-1]
    else:
        following = jax.lax.cummin(beyond, reverse=True)
    components = [(part[:-1], namespace.diff(part)) for part in samples]
    ground = RecordInput(
        components[0],
        components[1] if components[1:] else (),
        strongest,
        wrong[first + intervals] == before,
        following.reshape(-1),
        first,
        intervals,
    )
    return jax.tree.map(jnp.asarray, ground) if namespace is jnp else jax.device_put(ground)
