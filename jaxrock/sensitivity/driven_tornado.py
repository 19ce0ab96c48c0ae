"""A tornado of a driven answer: each parameter moved within its range, in one batch."""

from collections.abc import Mapping

import numpy as np

from ..block import SIDES, Block, size_of
from ..driven import check_batch
from ..ground_motion import Motion
from ..resonance import ModelLike, Nonlinear, as_model
from ..validation import Number, as_name, check_kind
from .driven_answer import (
    AnswerOfResponse,
    DrivenAnswer,
    DrivenAnswerName,
    check_answer,
    list_motion_medians,
)
from .measures import TornadoBars, arrange_bars, list_ends
from .parameters import choose_description


def driven_tornado(
    block: Block,
    restitution: Number,
    motion: Motion,
    ranges: Mapping[str, tuple[float, float]],
    *,
    answer: DrivenAnswerName | AnswerOfResponse = "rotation_ratio",
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
    answer : str or callable
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
                                   low          high        at low       at high
    amplitude                      2.8           3.2      0.104106      0.157563
    restitution                    0.8           0.9      0.123243      0.142628
    """
    check_kind("block", block, Block)
    restitution, _ = check_batch(block, restitution, motion, None)
    function = DrivenAnswer(
        block, restitution, motion, check_answer(answer), as_model(model), scale
    )
    medians = {
        **size_of(block, choose_description(ranges, "ranges")),
        "restitution": restitution,
        **list_motion_medians(motion),
        "scale": function.scale,
    }
    names = [as_name("ranges", name, medians) for name in ranges]
    points = list_ends(np.array([float(medians[name]) for name in names]), ranges)
    answers = function.evaluate(dict(zip(names, points.T, strict=True)))
    sides = tuple(name for name in SIDES if name in ranges)
    return arrange_bars(answers, ranges, sides)
