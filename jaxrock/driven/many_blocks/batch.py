"""A batch: blocks under ground motions, brought to one type and ready to be simulated."""

from collections.abc import Hashable
from dataclasses import replace

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
from .prepared_blocks import BatchArguments


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
    """

    block: Block
    restitution: HostNumbers
    ground: GroundMotions
    until: HostNumbers
    rotation: HostNumbers | None
    velocity: HostNumbers | None

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
    ) -> "Batch":
        """Make the batch, to be simulated to the end of the motion or for a duration.

        At rest at time 0, unless rotation or velocity are given. The answers have as many `axes`
        at least, behind the axis of the records of a suite.
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
            ground = motion.replace_numbers(convert(motion.numbers))
        else:
            axes = max(axes, *(np.ndim(leaf) for leaf in jax.tree.leaves(numbers)))
            if isinstance(motion, Suite):
                axes = max(axes, np.ndim(motion.records[0].scale))
            if isinstance(motion, RecordVariants):
                axes = max(axes, np.ndim(motion.which))
            ground = convert_motion(convert(motion), axes, grouped=namespace is np)
            if namespace is jnp:
                # Only `advance` may lead to a start before time 0; NaN is not valid.
                start = jnp.where(ground.start >= 0, ground.start, jnp.nan)
                ground = ground.replace_numbers(ground.numbers._replace(start=start))
        if rotation is not None or velocity is not None:
            rotation = 0.0 if rotation is None else rotation
            velocity = 0.0 if velocity is None else velocity
        return cls(
            block=convert(block),
            restitution=convert(restitution),
            ground=ground,
            until=ground.end if duration is None else convert(duration),
            rotation=convert(rotation),
            velocity=convert(velocity),
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
        return np.broadcast_shapes(*(leaf.shape for leaf in jax.tree.leaves(self.arguments)))

    @property
    def arguments(self) -> BatchArguments:
        """The numbers that differ from block to block."""
        motion = self.ground.numbers
        return BatchArguments(
            block=self.block,
            restitution=self.restitution,
            factor=motion.factor,
            length=motion.length,
            start=motion.start,
            duration=self.until,
            rotation=self.rotation,
            velocity=self.velocity,
            motion=motion.motion,
        )

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

        numbers = jax.tree.map(take, self.ground.numbers)
        ground = self.ground.replace_numbers(numbers)
        block_values = (self.block, self.restitution, self.until, self.rotation, self.velocity)
        block, restitution, until, rotation, velocity = jax.tree.map(take, block_values)
        return Batch(block, restitution, ground, until, rotation, velocity)

    def scaled(self, factor: Number) -> "Batch":
        """Multiply the motions by a factor."""
        return replace(self, ground=self.ground.scaled(factor))

    def advance(self, time: HostNumbers) -> "Batch":
        """Start the motions a time earlier [s], so that they are under way at time 0.

        For blocks that move at time 0, and a time within the first interval of the input, such
        as the first period of a `Harmonic`. The end of the motions moves as well.
        """
        time = choose_namespace([time]).asarray(time, self.dtype)
        ground = self.ground
        numbers = ground.numbers._replace(start=ground.start - time, end=ground.end - time)
        return replace(self, ground=ground.replace_numbers(numbers), until=self.until - time)
