"""The motion of one block over time."""

import numpy as np
from matplotlib.axes import Axes

from ..driven import Response, uplift_acceleration
from ..ground_motion import Motion, Record
from ..validation import Numbers
from .axes import (
    ABOVE,
    ACCENT,
    INK,
    LINE,
    NEUTRAL,
    RATIO,
    add_strip_above,
    check_result,
    get_axes,
    label_axes,
)

_LIMIT = 1.4  # rotation ratio up to which the motion over time is drawn
# For a one-sided block, the lower limit is this fraction of the upper limit below 0.
_ROOM_AT_WALL = 0.3


def plot_response(
    response: Response, ax: Axes | None = None, sensitivity: Numbers | None = None
) -> Axes:
    """Draw the acceleration of the ground and, below it, rotation over critical angle.

    The picture runs from shortly before the block moves until it rests or has fallen. Every
    impact is a line at the foot, whose height is in proportion to the velocity before it. The
    acceleration, with the level that lifts the block, has its own axes, a child of the
    returned axes.

    Parameters
    ----------
    response : Response
        From `jaxrock.respond`.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; new ones by default.
    sensitivity : array_like, shape (samples,), optional
        Derivative of an answer with respect to each sample of the record, as `jax.grad` gives
        it [unit of the answer / (m/s2)]: which part of the record matters. It has axes of its
        own below, the second child of the returned axes.

    Returns
    -------
    matplotlib.axes.Axes
        The axes drawn on.

    Raises
    ------
    ValueError
        If `sensitivity` does not have a number for each sample of a record.
    """
    check_result("response", response, Response, "respond(block, restitution, motion)")
    ax = get_axes(ax, figsize=(7.2, 4.8 if sensitivity is None else 6.4))
    block = response.scene.block
    motion = response.scene.motion
    first, last = _find_moving_span(response)
    times = np.linspace(first, last, 4000)
    ratio = np.asarray(response.history(times)[0]) / float(block.critical_angle)
    ax.plot(times, ratio, color=INK, linewidth=0.9)
    # A block that never moves has a ratio of 0, which makes no limits.
    limit = min(_LIMIT, 1.2 * float(np.abs(ratio).max()) or _LIMIT)
    bottom = -_ROOM_AT_WALL * limit if block.one_sided else -limit
    ax.set_xlim(first, last)
    speeds = np.abs(np.asarray(response.impact_velocities))
    # Without an impact the largest velocity is 0, which cannot be a divisor.
    heights = 0.1 * speeds / max(speeds.max(initial=0), 1e-300)
    foot = {"transform": ax.get_xaxis_transform(), "color": ACCENT, "linewidth": 0.8}
    ax.vlines(response.impact_times, 0, heights, label="impacts (height: velocity)", **foot)
    name = "critical angle" if limit > 1 else ""
    ax.hlines([-1, 1], first, last, NEUTRAL, "--", linewidth=0.8, label=name)
    if bool(response.overturned):
        time = float(response.overturning_time)
        ax.axvline(time, color=LINE, linestyle=":", label="overturning")

    above = add_strip_above(ax, bottom, limit)
    # A vertical component changes the weight of the block, and with it the uplift
    # acceleration.
    weight = 1 + np.asarray(motion.upward(times)) / float(block.gravity)
    lifting = float(uplift_acceleration(block, response.model)) * weight
    above.plot(times, np.asarray(motion.horizontal(times)), color=NEUTRAL, linewidth=0.7)
    levels = [lifting] if block.one_sided else [lifting, -lifting]
    look = {"color": LINE, "linestyle": "-.", "linewidth": 0.8}
    above.plot(times, np.transpose(levels), **look)
    # A line without points gives the levels one entry in the legend.
    ax.plot([], label="lifts the block", **look)
    ax.legend(**ABOVE, ncols=4)
    # The motion may be of the ground or of a floor: a record does not tell.
    label_axes(above, "", "base [m/s²]")
    label_axes(ax, "time [s]", RATIO)
    if sensitivity is not None:
        _draw_sensitivity(ax, motion, np.asarray(sensitivity))
    return ax


def _draw_sensitivity(ax: Axes, motion: Motion, sensitivity: np.ndarray) -> None:
    """Draw the derivative with respect to each sample below `ax`, over the same time."""
    if not isinstance(motion, Record) or sensitivity.shape != (motion.samples,):
        raise ValueError(
            "sensitivity must have a number for each sample of the record, got an array of"
            f" shape {sensitivity.shape}"
        )
    below = ax.inset_axes((0, -0.34, 1, 0.3), sharex=ax)
    below.fill_between(np.asarray(motion.knots()), sensitivity, color=ACCENT, linewidth=0.7)
    below.axhline(0, color=LINE, linewidth=0.6)
    label_axes(below, "time [s]", "derivative\n[1/(m/s²)]")
    ax.tick_params(labelbottom=False)
    ax.set_xlabel("")
    # Matplotlib finds the room for axes outside of others iteratively, by drawing.
    ax.figure.figure.draw_without_rendering()


def _find_moving_span(response: Response) -> tuple[float, float]:
    """Find the time from shortly before a block moves until it rests, or falls.

    The whole simulated time if it never moves.
    """
    end = float(response.scene.duration)
    times = np.linspace(0, end, 4000)
    ratio = np.abs(response.history(times)[0]) / float(response.scene.block.critical_angle)
    moving = np.flatnonzero((ratio > 0) & ((ratio < _LIMIT) | (not bool(response.overturned))))
    if not moving.size:
        return 0.0, end
    first, last = times[moving[[0, -1]]]
    # A twentieth is added on either side, and at least one step: a single sample has no
    # length.
    margin = 0.05 * (last - first) + times[1]
    return max(0.0, float(first - margin)), min(end, float(last + margin))
