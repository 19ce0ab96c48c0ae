"""Tornados: an answer at both ends of the range of each parameter, one at a time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..block import Block
from ..ground_motion import Motion
from ..host import Shown, format_table
from ..resonance import ModelLike, Nonlinear, as_model
from ..validation import Number, as_name, as_real, describe
from .closed_forms import find_finite_ranges, format_ranges
from .driven_scenes import gather_scene, simulate_scenes
from .parameters import Answer, describe_parameter, evaluate, name_parameters

Ranges = Mapping[str, tuple[float, float]]


@dataclass(frozen=True, repr=False)
class TornadoBars(Shown):
    """Changes of an answer within the range of each parameter; see `tornado`.

    Attributes
    ----------
    names : tuple of str
        The parameter with the widest bar first.
    low, high, at_low, at_high : ndarray, shape (parameters,)
        The ranges, and the answer at their ends, the other parameters unchanged.
    below, above : ndarray, shape (parameters,)
        From where to where the answer goes on, as in `Sensitivities`; NaN where not known.
    value : float
        The answer with all parameters unchanged. NaN stands for a block that overturns.
    """

    names: tuple[str, ...]
    low: np.ndarray
    high: np.ndarray
    at_low: np.ndarray
    at_high: np.ndarray
    below: np.ndarray
    above: np.ndarray
    value: float

    picture: ClassVar[str] = "plot_tornado"

    def table(self, names: Sequence[str] = ()) -> dict[str, list[Any]]:
        """List ranges and answers, a row for each parameter.

        Parameters
        ----------
        names : sequence of str
            The order of the rows; by default that of the bars.

        Returns
        -------
        dict of list
        """
        names = names or self.names
        order = [self.names.index(name) for name in names]
        columns = ("low", "high", "at_low", "at_high")
        listed = {name: getattr(self, name)[order].tolist() for name in columns}
        return {"quantity": list(names), **listed}

    def __str__(self) -> str:
        columns: dict[str, Any] = {"range": format_ranges(self.low, self.high)}
        columns |= {"at_low": self.at_low, "at_high": self.at_high}
        if not np.isnan(self.above).all():
            columns["holds_for"] = format_ranges(self.below, self.above)
        head = f"{self.value:.6g}" if np.isfinite(self.value) else "overturns"
        text = format_table(head, [*map(describe_parameter, self.names)], **columns)
        # Answers of this package are NaN where a block overturns.
        return text.replace("           nan", "     overturns")


def tornado(answer: Answer, at: Any, ranges: Ranges) -> TornadoBars:
    """Vary each parameter within its range, one at a time, and compute the answer.

    Parameters
    ----------
    answer, at, ranges : callable, pytree, dict
        As in `sensitivities`; low and high value of each parameter to vary, by name, with its
        value in `at` between them. Of a `Block` these are its fields, or ``width`` (at this
        height) and ``height`` (at this width).

    Returns
    -------
    TornadoBars

    Raises
    ------
    ValueError
        If a name is not one of `at`, or a range does not hold the value of its parameter.

    Examples
    --------
    >>> import jaxrock as jr
    >>> wall = jr.Scene(jr.Block(0.4, 5.0), restitution=0.7, intensity=0.15)
    >>> ranges = {"slenderness": (4.0, 6.0), "restitution": (0.6, 0.8)}
    >>> print(jr.tornado(jr.rotation_ratio, wall, ranges))
    0.123215
                                 range        at low       at high     holds for
    restitution             0.6 to 0.8     0.0673033      0.307402   0 to 0.8557
    slenderness                 4 to 6     0.0954255       0.15161    0 to 20.97
    """
    parameters = name_parameters(at, ranges, "ranges")
    points = _list_points(parameters.get_values(ranges), ranges)
    question = answer, parameters, tuple(ranges)
    (values,) = evaluate(*question, points)
    return _arrange_bars(values, ranges, find_finite_ranges(*question, points[0]))


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
    as_name("answer", answer, ("rotation_ratio", "peak_rotation", "margin"))
    scene, _ = gather_scene(block, restitution, motion)
    parameters = name_parameters(scene, ranges, "ranges")
    points = _list_points(parameters.get_values(ranges), ranges)
    scenes = parameters.build(dict(zip(ranges, points.T, strict=True)))
    response = simulate_scenes(scenes, motion, as_model(model))
    # A block that has fallen lies where nothing changes: its peak is no answer.
    values = np.where(response.overturned, np.nan, response.peak_rotation)
    if answer == "rotation_ratio":
        values = values / np.asarray(scenes["block"].critical_angle)
    elif answer == "margin":
        values = np.asarray(response.margin)
    return _arrange_bars(values, ranges)


def _list_points(point: np.ndarray, ranges: Ranges) -> np.ndarray:
    """List the point itself, then for each parameter both ends of its range, as rows.

    Raises
    ------
    ValueError
        If a range is not a low and a high value around the value of the point.
    """
    # All points are one batch for one program.
    points = np.tile(point, (1 + 2 * len(ranges), 1))
    for k, (name, limits) in enumerate(ranges.items()):
        pair = as_real(f"ranges of {name}", limits)
        # A value in float32, or computed from other values, may differ by rounding from the
        # number that was typed.
        rounding = 1e-6 * abs(point[k])
        if pair.shape != (2,) or not pair[0] - rounding <= point[k] <= pair[1] + rounding:
            raise ValueError(
                f"ranges of {name} must be a low and a high value around {point[k]:g}, got"
                f" {describe(limits)}"
            )
        points[2 * k + 1 : 2 * k + 3, k] = limits
    return points


def _arrange_bars(values: np.ndarray, ranges: Ranges, limits: Any = np.nan) -> TornadoBars:
    """Arrange answers at the points of `_list_points` as bars, the widest first.

    `limits` are the limits of finite answers along each parameter.
    """
    bounds = np.asarray(list(ranges.values()), float)
    answers = values[1:].reshape(-1, 2)
    # An end at which the block overturns has no answer: such a bar is the widest of all.
    # The sort is stable, so that equal bars keep the order in which they were asked for.
    width = np.nan_to_num(abs(np.diff(answers)[:, 0]), nan=np.inf)
    order = np.argsort(-width, kind="stable")
    names = tuple(list(ranges)[k] for k in order)
    columns = np.vstack([bounds.T, answers.T, np.broadcast_to(limits, (2, width.size))])
    return TornadoBars(names, *columns[:, order], value=float(values[0]))
