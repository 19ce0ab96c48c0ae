"""An answer of a block on moving ground as a function of named parameters, and its tornado."""

from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..driven import check_batch, require_complete, respond, respond_batch
from ..ground_motion import Harmonic, Motion, Pulse, Suite
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import POSITIVE, Number, Reals, as_field, as_name, as_real, check
from .measures import Ranges, TornadoBars, arrange_bars, list_ends
from .parameters import name_parameters

# The answers that have a name, in words.
ANSWERS = {
    "rotation_ratio": "rotation ratio",
    "peak_rotation": "peak rotation",
    "margin": "overturning margin",
}
# The highest rotation may come after the end of the ground motion [s].
BEYOND = 10.0


def gather_parameters(
    block: Block, restitution: Number, motion: Motion | Suite, scale: Number
) -> dict[str, Any]:
    """Gather what may vary; `scale` is a factor on any motion, besides its own numbers.

    Raises
    ------
    ValueError
        If an argument is out of range or not single.
    """
    restitution, _ = check_batch(block, restitution, motion, None)
    check("scale", as_real("scale", scale), POSITIVE)
    at = {name: getattr(motion, name) for name in name_fields(motion)}
    at |= {"block": block, "restitution": restitution, "scale": scale}
    if any(np.ndim(leaf) for leaf in jax.tree.leaves(at)):
        raise ValueError("block, restitution and motion must be single, got arrays")
    return at


def change_motion(motion: Motion, at: Mapping[str, Any]) -> Motion:
    """Replace the numbers of a motion by those that `gather_parameters` names."""
    for name in name_fields(motion):
        value = as_field(type(motion), name, at[name])
        motion = eqx.tree_at(lambda part, name=name: getattr(part, name), motion, value)
    return motion


def name_fields(motion: Motion | Suite) -> tuple[str, ...]:
    """Name the numbers of a motion that may vary."""
    if isinstance(motion, Pulse):
        return ("amplitude", "duration")
    return ("amplitude", "frequency") if isinstance(motion, Harmonic) else ()


class DrivenAnswer(eqx.Module):
    """An answer of a block on moving ground, as a function of what `gather_parameters` lists.

    Attributes
    ----------
    motion : Motion
    answer : str
        One of `ANSWERS`.
    model : RockingModel
        Equation of motion.
    """

    motion: Motion
    answer: str = eqx.field(
        static=True, converter=lambda answer: as_name("answer", answer, ANSWERS)
    )
    model: RockingModel = eqx.field(static=True)

    def __call__(self, at: Mapping[str, Any]) -> Reals:
        """Compute the answer for one block, which may be traced."""
        return self._choose_answer(at["block"], self._simulate(respond, at))

    def evaluate(self, at: Mapping[str, Any]) -> np.ndarray:
        """Compute the answers for many blocks in a batch.

        Raises
        ------
        ValueError
            If an integration did not finish.
        """
        blocks = jax.device_put(at["block"])
        response = self._simulate(respond_batch, {**at, "block": blocks})
        require_complete(response.complete, sample=None)
        return np.asarray(self._choose_answer(blocks, response))

    def _simulate(self, simulate: Callable[..., Any], at: Mapping[str, Any]) -> Any:
        """Simulate one response or many."""
        # The scale last, since an amplitude replaces the one of the motion.
        motion = change_motion(self.motion, at).scaled(at["scale"])
        # The margin is known at the end of the motion, by energy.
        duration = motion.end + (0.0 if self.answer == "margin" else BEYOND)
        return simulate(at["block"], at["restitution"], motion, duration, model=self.model)

    def _choose_answer(self, block: Block, response: Any) -> Reals:
        """Choose the answer among the results of responses."""
        if self.answer == "margin":
            return response.margin
        # A block that has fallen lies where nothing changes: its peak is no answer.
        peak = jnp.where(response.overturned, jnp.nan, response.peak_rotation)
        return peak / block.critical_angle if self.answer == "rotation_ratio" else peak


def driven_tornado(
    block: Block,
    restitution: Number,
    motion: Motion,
    ranges: Ranges,
    *,
    answer: str = "rotation_ratio",
    scale: Number = 1.0,
    model: ModelLike = Nonlinear(),
) -> TornadoBars:
    """Vary each parameter of a block on moving ground within its range, one at a time.

    Parameters
    ----------
    block, restitution, motion : Block, float, Motion
        One scene.
    ranges : dict
        Low and high value of each parameter to vary, by name, with its own value between them:
        ``restitution``, ``width`` (at this height) and ``height`` (at this width) or
        ``half_width`` (at this slenderness) and ``slenderness``, ``scale``, and of a pulse
        ``amplitude`` and ``duration``.
    answer : {"rotation_ratio", "peak_rotation", "margin"}
        As in `local_dependence`; NaN at an end at which the block overturns.
    scale : float
        Factor on the motion [-], also where the amplitude is varied.
    model : Nonlinear or Linearized, or their names
        Equation of motion.

    Returns
    -------
    TornadoBars

    Raises
    ------
    ValueError
        If a name is none of these, an argument is out of range, a range does not hold the
        value of its parameter, or an integration did not finish.

    Examples
    --------
    >>> import jaxrock as jr
    >>> pulse = jr.Sine(3.0, 0.5)
    >>> ranges = {"restitution": (0.8, 0.9), "amplitude": (2.8, 3.2)}
    >>> print(jr.sensitivity.driven_tornado(jr.Block(0.4, 5.0), 0.85, pulse, ranges))
    0.132752
                                 range        at low       at high
    amplitude               2.8 to 3.2      0.104106      0.157563
    restitution             0.8 to 0.9      0.123243      0.142628
    """
    function = DrivenAnswer(motion, answer, as_model(model))
    at = gather_parameters(block, restitution, motion, scale)
    parameters = name_parameters(at, ranges, "ranges")
    points = list_ends(parameters.get_values(ranges), ranges)
    at = parameters.build(dict(zip(ranges, points.T, strict=True)))
    return arrange_bars(function.evaluate(at), ranges)
