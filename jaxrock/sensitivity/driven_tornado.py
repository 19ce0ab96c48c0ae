"""The tornado of an answer of a block on moving ground, and its derivatives by the same names."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import jax
import numpy as np

from ..block import Block
from ..driven import require_complete, respond_batch
from ..ground_motion import Motion
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import Number, as_name
from .derivatives import Derivatives, derivatives_within
from .driven_answer import BEYOND, change_motion, gather_parameters
from .measures import Ranges, TornadoBars, arrange_bars, list_ends
from .parameters import name_parameters

_ANSWERS = "rotation_ratio", "peak_rotation", "margin"
_TOLERANCE = 1e-6  # of derivatives
# Of the unit of its parameter, in what `Derivatives` has for each of them.
_POWERS = {"at": 1, "derivative": -1, "error": -1, "below": 1, "above": 1}
_POWERS |= dict.fromkeys(("within_tolerance", "below_reason", "above_reason"), 0)


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
        As in `derivatives_within`; NaN at an end at which the block overturns.
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
    as_name("answer", answer, _ANSWERS)
    model = as_model(model)
    at = gather_parameters(block, restitution, motion, scale)
    parameters = name_parameters(at, ranges, "ranges")
    points = list_ends(parameters.get_values(ranges), ranges)
    at = parameters.build(dict(zip(ranges, points.T, strict=True)))
    values = _evaluate(at, motion, answer, model)
    return arrange_bars(values, ranges)


def differentiate_driven(
    block: Block,
    restitution: Number,
    motion: Motion,
    names: Iterable[str],
    *,
    answer: str,
    scale: Number,
    model: ModelLike,
) -> Derivatives:
    """Differentiate an answer of `driven_tornado` with respect to the parameters it names.

    To `derivatives_within` the scaled motion is given: there the factor is 1.
    """
    renamed = {"factor": "scale"}
    found = derivatives_within(
        block,
        restitution,
        motion.scaled(scale),
        _TOLERANCE,
        _choose_duration(motion, answer),
        of=answer,
        by=["factor" if name == "scale" else name for name in names],
        model=model,
    )
    factor = np.asarray(scale, float).item()
    units = {"factor": factor, "amplitude": 1 / factor}
    parts = {}
    for part, power in _POWERS.items():
        columns = getattr(found, part).items()
        parts[part] = {
            renamed.get(name, name): column * units.get(name, 1.0) ** power
            if power
            else column
            for name, column in columns
        }
    return replace(found, **parts)


def list_derivatives(found: Derivatives) -> dict[str, list[float]]:
    """List values, derivatives with errors, elasticities and ranges of one block, by column."""
    slopes = found.derivative
    elasticity = {name: slopes[name] * x / found.value for name, x in found.at.items()}
    parts = {"value": found.at, "derivative": slopes, "error": found.error}
    parts |= {"elasticity": elasticity, "below": found.below, "above": found.above}
    return {head: [*map(float, part.values())] for head, part in parts.items()}


def _evaluate(
    at: Mapping[str, Any], motion: Motion, answer: str, model: RockingModel
) -> np.ndarray:
    """Compute the answers for many blocks; a `ValueError` if an integration did not finish."""
    blocks = jax.device_put(at["block"])
    # The scale last, since an amplitude replaces the one of the motion.
    scaled = change_motion(motion, at).scaled(at["scale"])
    duration = _choose_duration(scaled, answer)
    response = respond_batch(blocks, at["restitution"], scaled, duration, model=model)
    require_complete(response.complete, sample=None)
    if answer == "margin":
        return np.asarray(response.margin)
    # A block that has fallen lies where nothing changes: its peak is no answer.
    peak = np.where(response.overturned, np.nan, response.peak_rotation)
    return peak / np.asarray(blocks.critical_angle) if answer == "rotation_ratio" else peak


def _choose_duration(motion: Motion, answer: str) -> Number | None:
    """Choose how long to simulate: the margin is known at the end of the motion, by energy."""
    return None if answer == "margin" else motion.end + BEYOND
