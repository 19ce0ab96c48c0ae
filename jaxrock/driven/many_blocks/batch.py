"""A batch: blocks under ground motions, brought to one type and ready to be simulated."""

from collections.abc import Hashable
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ...block import Block
from ...ground_motion import Motion, Suite
from ...validation import Number, choose_namespace, is_traced
from .ground_input import HostNumbers, HostReals
from .ground_motions import GroundMotions, RecordVariants, convert_motion

# The part of the tolerance that a step may use up: errors of steps add up, and impacts amplify
# them. Less below 1e-10, where rounding uses up a part.
_FRACTION = 0.05
_FRACTION_OF_TIGHT = 0.02
_TIGHT = 1e-10


def choose_step_tolerance(
    rtol: float | HostNumbers, dtype: np.dtype, factor: float = 1.0
) -> HostNumbers:
    """Choose the tolerance of a step, or a factor times it, within what rounding allows."""
    fraction = np.where(np.asarray(rtol) >= _TIGHT, _FRACTION, _FRACTION_OF_TIGHT)
    return np.maximum(fraction * factor * rtol, np.finfo(dtype).eps).astype(dtype)


class StepControl(NamedTuple):
    """The length of each step of a block, and the terms of its polynomial that count.

    A step ends at the next sample of a record, however loose the tolerance. So a tolerance
    alone does not make two motions whose steps differ; companions, which omit terms, do.
    """

    tolerance: HostNumbers  # of the last two terms of a polynomial, relative to its first ones
    companion: HostNumbers  # 1 or 2 for a companion of `to_tolerance`, 0 for a response


class Batch(eqx.Module):
    """Blocks under ground motions, all of one type, in NumPy where they are concrete.

    What has been checked once is a batch: functions that take one check nothing.

    Attributes
    ----------
    block, restitution : Block, Array
    ground : GroundMotions
    until : Array
        Time up to which each block is followed [s].
    rotation, velocity : Array or None
        At time 0 [rad], [rad/s]. Both are None for blocks at rest, which take a program without
        them.
    control : StepControl
        Of the response, or of its companions in `to_tolerance`.
    answer : Array or None
        Of which answer derivatives are wanted, a real like all other numbers.
    directions : tuple of Batch, or None
        How `arguments` move with each parameter.
    """

    block: Block
    restitution: HostNumbers
    ground: GroundMotions
    until: HostNumbers
    rotation: HostNumbers | None
    velocity: HostNumbers | None
    control: StepControl
    answer: HostNumbers | None = None
    directions: "tuple[Batch, ...] | None" = None

    @classmethod
    def of(
        cls,
        block: Block,
        restitution: Number,
        motion: Motion | Suite | RecordVariants | GroundMotions,
        duration: Number | None = None,
        axes: int = 0,
        *,
        rotation: Number | None = None,
        velocity: Number | None = None,
        rtol: float | HostNumbers | None = None,
    ) -> "Batch":
        """Make the batch, to be simulated to the end of the motion or for a duration.

        At rest at time 0, unless rotation or velocity are given. The answers have as many `axes`
        at least, behind the axis of the records of a suite. `rtol` is that of `respond_batch`.
        """
        numbers = block, restitution, duration, rotation, velocity
        leaves = jax.tree.leaves((numbers, motion))
        # Strict promotion, which users may have set, refuses a sum of float32 and float64.
        with jax.numpy_dtype_promotion("standard"):
            # The arrays, not their types: defaults and Python numbers are weakly typed.
            floats = [leaf for leaf in leaves if jnp.issubdtype(leaf.dtype, jnp.floating)]
            dtype = jnp.result_type(*floats)
        namespace = choose_namespace(leaves)

        def convert(tree: PyTree) -> PyTree:
            return jax.tree.map(lambda leaf: namespace.asarray(leaf, dtype), tree)

        if isinstance(motion, GroundMotions):
            ground = motion.map_numbers(convert)
        else:
            axes = max(axes, *(np.ndim(leaf) for leaf in jax.tree.leaves(numbers)))
            ground = convert_motion(convert(motion), axes)
            if namespace is jnp:
                # Only `advance` may lead to a start before time 0; NaN is not valid.
                start = jnp.where(ground.start >= 0, ground.start, jnp.nan)
                ground = replace(ground, start=start)
        if rotation is not None or velocity is not None:
            rotation = 0.0 if rotation is None else rotation
            velocity = 0.0 if velocity is None else velocity
        if rtol is None:
            rtol = 1e-9 if dtype == np.float64 else 1e-5
        control = choose_step_tolerance(rtol, dtype), 0
        return cls(
            block=convert(block),
            restitution=convert(restitution),
            ground=ground,
            until=ground.end if duration is None else convert(duration),
            rotation=convert(rotation),
            velocity=convert(velocity),
            control=StepControl(*(np.asarray(number, dtype) for number in control)),
        )

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
        # Not from `arguments`: a batch is asked for its shape again and again.
        ground = self.ground.factor, self.ground.length, self.ground.start, self.ground.motion
        numbers = vars(self) | {"ground": ground}
        return np.broadcast_shapes(*(leaf.shape for leaf in jax.tree.leaves(numbers)))

    @property
    def arguments(self) -> "Batch":
        """The numbers that differ from block to block: the batch without what blocks share."""
        return eqx.tree_at(lambda b: (b.ground.input, b.ground.end), self, (None, None))

    def flatten(self) -> tuple[HostReals, Hashable]:
        """Flatten the arguments: a row each number, a column each block; with their structure.

        One array instead of a dozen: a queue is filled, cut and sent to a device at once.
        """
        leaves, form = jax.tree.flatten(self.arguments)
        namespace = choose_namespace(leaves)
        shape = self.shape
        flat = [namespace.broadcast_to(leaf, shape).reshape(-1) for leaf in leaves]
        return namespace.stack(flat), form

    def select(self, index: np.ndarray) -> "Batch":
        """Select some blocks of a concrete batch, by their places in the flat one."""
        shape = self.shape

        def take(leaf: HostNumbers) -> np.ndarray:
            # Not by `reshape`, which would copy all blocks to take a few.
            return np.broadcast_to(leaf, shape).flat[index]

        numbers = {name: value for name, value in vars(self).items() if name != "ground"}
        return Batch(ground=self.ground.map_numbers(take), **jax.tree.map(take, numbers))

    def scaled(self, factor: Number) -> "Batch":
        """Multiply the motions by a factor."""
        ground = replace(self.ground, factor=self.ground.factor * factor)
        return replace(self, ground=ground)

    def advance(self, time: HostNumbers) -> "Batch":
        """Start the motions a time earlier [s], so that they are under way at time 0.

        For blocks that move at time 0, and a time within the first interval of the input, such
        as the first period of a `Harmonic`. The end of the motions moves as well.
        """
        time = choose_namespace([time]).asarray(time, self.dtype)
        ground = self.ground
        earlier = replace(ground, start=ground.start - time, end=ground.end - time)
        return replace(self, ground=earlier, until=self.until - time)
