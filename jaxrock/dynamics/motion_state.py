"""The state of the event loop, and what its steps have in common."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from ..ground_motion import Motion
from ..validation import Booleans, Reals
from .driven_scene import Driven
from .equation import Equation
from .solver_steps import Segment, Stepper
from .uplift import Uplifts

REST, RISING, FALLING, TOPPLED = range(4)
Ints = Int[Array, "..."]


class State(NamedTuple):
    """The motion up to an event."""

    time: Reals
    side: Reals
    rotation: Reals
    velocity: Reals
    phase: Ints
    events: Ints
    impacts: Ints
    last_impact: Reals  # its time, and the velocity just before it
    peak: Reals
    peak_time: Reals
    crossing: Reals
    margin: Reals
    forces: tuple[Reals, Reals]  # largest friction demand, smallest normal force
    failed: Booleans

    @classmethod
    def beginning(cls, dtype: Any, failed: Booleans) -> "State":
        """Before the first event."""
        zero, none = jnp.zeros((), dtype), jnp.zeros((), int)
        fields: dict[str, Any] = dict.fromkeys(cls._fields, zero)
        fields |= dict.fromkeys(("phase", "events", "impacts"), none)
        fields |= {"last_impact": jnp.zeros(2, dtype), "forces": (zero, zero), "failed": failed}
        return cls(**fields)

    @property
    def y(self) -> Reals:
        """Rotation and velocity."""
        return jnp.stack([self.rotation, self.velocity])


@dataclass(frozen=True)
class Problem:
    """What all steps of the loop have in common."""

    driven: Driven
    equation: Equation
    stepper: Stepper
    rtol: Any
    with_forces: bool
    uplifts: Uplifts
    just_lifted: Reals  # time for which a block that has been lifted stays so

    @classmethod
    def of(
        cls, driven: Driven, equation: Equation, stepper: Stepper, rtol: Any, with_forces: bool
    ) -> "Problem":
        """With what follows from the motion of the ground."""
        motion, uplifts = driven.motion, Uplifts.of(equation, driven.motion)
        # Little beside the block's own time and that in which the input changes.
        intervals = jnp.sum(uplifts.knots < motion.end).astype(equation.p_squared.dtype)
        changes = (motion.end - motion.start) / intervals
        just_lifted = 1e-6 * jnp.minimum(1 / jnp.sqrt(equation.p_squared), changes)
        just_lifted = jax.lax.stop_gradient(just_lifted)
        return cls(driven, equation, stepper, rtol, with_forces, uplifts, just_lifted)

    @property
    def motion(self) -> Motion:
        """That of the ground."""
        return self.driven.motion

    def segment(self, time: Reals, side: Reals, acts: Booleans) -> Segment:
        """The one that begins at a time."""
        return Segment(self.equation, self.motion, time, side, acts)
