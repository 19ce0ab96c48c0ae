"""The tornado of an answer of a block on moving ground."""

from collections.abc import Mapping
from typing import Any

import jax
import numpy as np

from ..block import Block
from ..driven import require_complete, respond_batch
from ..ground_motion import Motion
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import Number, as_name
from .driven_answer import change_motion, choose_duration, gather_parameters
from .measures import Ranges, TornadoBars, arrange_bars, list_ends
from .parameters import name_parameters

_ANSWERS = "rotation_ratio", "peak_rotation", "margin"


def driven_tornado(
    block: Block,
    restitution: Number,
    motion: Motion,
    ranges: Ranges,
    *,
    answer: str = "rotation_ratio",
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
        ``half_width`` (at this slenderness) and ``slenderness``, ``factor`` (on the motion),
        ``amplitude`` and ``duration`` of a pulse, ``amplitude`` and ``frequency`` of a
        `Harmonic`.
    answer : {"rotation_ratio", "peak_rotation", "margin"}
        As in `derivatives_within`; NaN at an end at which the block overturns.
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
    as_name("answer", answer, _ANSWERS)
    model = as_model(model)
    at = gather_parameters(block, restitution, motion)
    parameters = name_parameters(at, ranges, "ranges")
    points = list_ends(parameters.get_values(ranges), ranges)
    at = parameters.build(dict(zip(ranges, points.T, strict=True)))
    values = _evaluate(at, motion, answer, model)
    return arrange_bars(values, ranges)


def _evaluate(
    at: Mapping[str, Any], motion: Motion, answer: str, model: RockingModel
) -> np.ndarray:
    """Compute the answers for many blocks; a `ValueError` if an integration did not finish."""
    blocks = jax.device_put(at["block"])
    scaled = change_motion(motion, at).scaled(at["factor"])
    duration = choose_duration(scaled, answer)
    response = respond_batch(blocks, at["restitution"], scaled, duration, model=model)
    require_complete(response.complete, sample=None)
    if answer == "margin":
        return np.asarray(response.margin)
    # A block that has fallen lies where nothing changes: its peak is no answer.
    peak = np.where(response.overturned, np.nan, response.peak_rotation)
    return peak / np.asarray(blocks.critical_angle) if answer == "rotation_ratio" else peak
