"""An answer of a block on moving ground, as a function of some of its parameters."""

import functools
from collections.abc import Callable, Mapping
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..block import Block, block_of, size_of
from ..driven import require_complete, respond, respond_batch
from ..ground_motion import Harmonic, Motion, Pulse, Suite
from ..resonance import RockingModel
from ..validation import AnyArray, Number, Reals, as_field, as_name, as_real
from .parameters import choose_description
from .samples import make_drawn_blocks

# The answers that have a name, in words.
ANSWERS = {
    "rotation_ratio": "rotation ratio",
    "peak_rotation": "peak rotation",
    "margin": "overturning margin",
}
DrivenAnswerName = Literal["rotation_ratio", "peak_rotation", "margin"]
# Of a block and its response, or of blocks and the responses of a batch.
AnswerOfResponse = Callable[[Block, Any], AnyArray]
# The highest rotation may come after the end of the ground motion [s].
_BEYOND = 10.0


def list_motion_medians(motion: Motion | Suite) -> dict[str, float]:
    """List the parameters of a motion with their medians; `scale` is a factor on any motion."""
    return {"scale": 1.0} | {
        name: float(getattr(motion, name)) for name in _name_fields(motion)
    }


def change_motion(motion: Motion, parameters: Mapping[str, Number]) -> Motion:
    """Replace the fields of a motion that are among the parameters; `scale` is no field."""
    for name in _name_fields(motion):
        if name in parameters:
            value = as_field(type(motion), name, parameters[name])
            motion = eqx.tree_at(lambda part, name=name: getattr(part, name), motion, value)
    return motion


def _name_fields(motion: Motion | Suite) -> tuple[str, ...]:
    """Name the fields of a motion that may be uncertain."""
    if isinstance(motion, Pulse):
        return ("amplitude", "duration")
    return ("amplitude", "frequency") if isinstance(motion, Harmonic) else ()


def check_answer(answer: DrivenAnswerName | AnswerOfResponse) -> str | AnswerOfResponse:
    """Return an answer, given by its name or as a function; a `ValueError` if it is neither."""
    return answer if callable(answer) else as_name("answer", answer, ANSWERS)


class DrivenAnswer(eqx.Module):
    """An answer of a block on moving ground, as a function of some of its parameters.

    Attributes
    ----------
    block, restitution, motion : Block, Array, Motion
        The scene, with the values of all parameters that are not given.
    answer : str or callable
        As `check_answer` returns it.
    model : RockingModel
        Equation of motion.
    scale : Array
        Factor on the motion, whatever its amplitude is.
    """

    block: Block
    restitution: Reals = eqx.field(
        converter=functools.partial(as_real, "restitution", unit="")
    )
    motion: Motion
    answer: str | AnswerOfResponse = eqx.field(static=True)
    model: RockingModel = eqx.field(static=True)
    scale: Reals = eqx.field(converter=functools.partial(as_real, "scale", unit=""))

    @property
    def title(self) -> str:
        """The answer in words."""
        if isinstance(self.answer, str):
            return ANSWERS[self.answer]
        name = getattr(self.answer, "__name__", "")
        return name.replace("_", " ").strip() if name.isidentifier() else "answer"

    def __call__(self, parameters: Mapping[str, Number]) -> Reals:
        """Compute the answer at one value of each parameter, which may be traced."""
        size = size_of(self.block, choose_description(parameters, "parameters"))
        block = block_of({**size, **parameters}, self.block.one_sided)
        restitution, motion = self._change_scene(parameters)
        duration = self._choose_duration(motion)
        response = respond(block, restitution, motion, duration, model=self.model)
        return self._choose_answer(block, response)

    def evaluate(self, parameters: Mapping[str, np.ndarray]) -> np.ndarray:
        """Compute the answers at many values of the parameters, shape (samples,), in a batch.

        Raises
        ------
        ValueError
            If an integration did not finish.
        """
        size = size_of(self.block, choose_description(parameters, "parameters"))
        constant = {name: np.asarray(value) for name, value in size.items()}
        drawn = make_drawn_blocks({**constant, **parameters}, self.block.one_sided)
        blocks = jax.device_put(drawn)
        restitution, motion = self._change_scene(parameters)
        duration = self._choose_duration(motion)
        response = respond_batch(blocks, restitution, motion, duration, model=self.model)
        require_complete(response.complete, sample=None)
        return np.asarray(self._choose_answer(blocks, response))

    def _change_scene(self, parameters: Mapping[str, Number]) -> tuple[Number, Motion]:
        """Change restitution and motion to given values."""
        # The scale last: an amplitude that is varied replaces the one that the motion has.
        scale = parameters.get("scale", self.scale)
        motion = change_motion(self.motion, parameters).scaled(scale)
        return parameters.get("restitution", self.restitution), motion

    def _choose_duration(self, motion: Motion) -> Reals:
        """Choose the time up to which responses are computed [s]."""
        # The margin is known at the end of the motion, by energy.
        return motion.end + (0.0 if self.answer == "margin" else _BEYOND)

    def _choose_answer(self, block: Block, response: Any) -> Reals:
        """Choose the answer among the results of responses."""
        if not isinstance(self.answer, str):
            return jnp.asarray(self.answer(block, response))
        if self.answer == "margin":
            return response.margin
        # A block that has fallen lies where nothing changes: its peak is no answer.
        peak = jnp.where(response.overturned, jnp.nan, response.peak_rotation)
        return peak / block.critical_angle if self.answer == "rotation_ratio" else peak
