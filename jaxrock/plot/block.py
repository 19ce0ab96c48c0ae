"""One block: its symbols, and its motion over time, in the phase plane and as a film."""

from pathlib import Path

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.axes import Axes
from matplotlib.patches import Arc, Polygon, Rectangle
from matplotlib.ticker import MaxNLocator

from ..block import Block, is_rectangle
from ..driven import TOPPLED_ROTATION, Equation, Response, uplift_acceleration
from ..ground_motion import Motion
from .axes import (
    ABOVE,
    ACCENT,
    INK,
    LINE,
    NEUTRAL,
    RATIO,
    add_level,
    add_strip_above,
    check_result,
    get_axes,
    label_axes,
)

_STAND_IN = "a rectangle stands in for the outline"
_LIMIT = 1.4  # rotation ratio up to which the motion over time is drawn
# Fraction of the upper limit that is left below 0 for impacts of a one-sided block.
_ROOM_AT_WALL = 0.3
_FRAMES = 400  # of a film, at most


def plot_block(block: Block, rotation: float | None = None, ax: Axes | None = None) -> Axes:
    """Draw a block, to scale, with the symbols of Fig. 1.

    The outline of a body that is not a homogeneous rectangle is unknown. It is drawn as a
    dashed rectangle with the same base and centre of mass.

    Parameters
    ----------
    block, rotation : Block, float
        One block, and alpha [rad], positive to the right; half the critical angle by default.
        A one-sided block is drawn with its wall, to the left.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        The axes drawn on.

    Raises
    ------
    ValueError
        If `rotation` of a one-sided block is negative.

    Examples
    --------
    >>> import jaxrock as jr
    >>> axes = jr.plot.plot_block(jr.Block(half_width=0.4, slenderness=3.0))
    """
    check_result("block", block, Block, "Block.from_size(width=..., height=...)")
    critical = float(block.critical_angle)
    rotation = 0.5 * critical if rotation is None else float(rotation)
    if block.one_sided and rotation < 0:
        raise ValueError(
            f"rotation of a one-sided block must be at least 0, got {rotation:.6g} rad"
        )
    side = 1 if rotation >= 0 else -1
    b = float(block.half_width)
    a = float(block.half_height)
    ax = get_axes(ax, figsize=(4.2, 4.4))
    # Wide enough for the arrow on one side, and for the top edge of a block that lies down.
    reach = max(2 * b + 0.6 * a, 1.1 * (b + 2 * a * abs(np.sin(rotation))))
    top = max(2.2 * a, 2.1 * float(block.half_diagonal))
    shape = _draw_block(ax, block, reach, top)
    if block.one_sided:
        _draw_wall(ax, block, top)
    shape.set_xy(_rotate(_compute_corners(block), block, rotation))

    # Lines from G to the pivot, to the top and across: R, a and b.
    pivot = np.array([side * b, 0.0])
    inside = np.array([[0.0, a], [0.0, 2 * a], [-side * b, a]])
    centre, top, across = _rotate(inside, block, rotation)
    for end, look in ((pivot, "--"), (top, "-"), (across, "-")):
        ax.plot(*np.transpose([centre, end]), look, color=INK, linewidth=1)
    ax.plot(*centre, "o", color=INK, markersize=4)
    ax.plot(*pivot, "o", color=ACCENT, markersize=4)

    # At O, the angles from the edge to the vertical and to the centre.
    ax.plot([pivot[0]] * 2, [0, 2.1 * a], ":", color=ACCENT, linewidth=1)
    edge = 90 - np.degrees(rotation)
    # Radii that differ keep the two angles and their symbols apart.
    for radius, far in ((1.75 * a, 90.0), (0.6 * a, edge + side * np.degrees(critical))):
        first, last = sorted((edge, far))
        size = {"width": 2 * radius, "height": 2 * radius, "theta1": first, "theta2": last}
        ax.add_patch(Arc((pivot[0], 0), **size, color=ACCENT, linewidth=1.5))

    along_edge = a * np.array([np.sin(rotation), np.cos(rotation)])
    for symbol, (x, y), right, up, colour in (
        ("$R$", (centre + pivot) / 2, -10, 0, INK),
        ("$a$", (centre + top) / 2, -8, 0, INK),
        ("$b$", (centre + across) / 2, 0, 8, INK),
        ("$G$", centre, -9, -9, INK),
        ("$O$", pivot, 0, -11, ACCENT),
        (r"$\alpha$", pivot + 1.75 * along_edge, 10, 0, ACCENT),
        (r"$\alpha_c$", pivot + 0.6 * along_edge, 10, 0, ACCENT),
    ):
        by = (side * right, up)  # mirrored with the block
        ax.annotate(
            symbol,
            (x, y),
            by,
            textcoords="offset points",
            color=colour,
            ha="center",
            va="center",
        )

    # This push of the ground rotates the block to the right: accelerations count to the left.
    tail = -1.6 * b if side > 0 else 1.6 * b + 0.4 * a
    below = -0.1 * a
    ax.annotate("", (tail - 0.4 * a, below), (tail, below), arrowprops={"arrowstyle": "->"})
    ax.annotate(r"$\ddot y$", (tail, below), (3, -4), textcoords="offset points")
    return ax


def plot_response(response: Response, ax: Axes | None = None) -> Axes:
    """Draw the acceleration of the ground and, under it, rotation over critical angle.

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

    Returns
    -------
    matplotlib.axes.Axes
        The axes drawn on.
    """
    check_result("response", response, Response, "respond(block, restitution, motion)")
    ax = get_axes(ax, figsize=(7.2, 4.8))
    scene = response.scene
    first, last = _find_moving_span(response)
    times = np.linspace(first, last, 4000)
    ratio = np.array(response.history(times)[0]) / float(scene.block.critical_angle)
    ax.plot(times, ratio, color=INK, linewidth=0.9)
    # A block that never moves has a ratio of 0, which makes no limits.
    limit = min(_LIMIT, 1.2 * float(np.max(np.abs(ratio))) or _LIMIT)

    impacts = np.asarray(response.impact_times)
    speeds = np.abs(np.asarray(response.impact_velocities))
    # Without an impact the largest velocity is 0, by which nothing can be divided.
    bottom = -_ROOM_AT_WALL * limit if scene.block.one_sided else -limit
    tips = bottom + limit * 0.25 * speeds / max(speeds.max(initial=0), 1e-300)
    name = "impacts (height: velocity)" if impacts.size else ""
    ax.vlines(impacts, bottom, tips, color=ACCENT, linewidth=0.8, label=name)
    # Without an entry in the legend where the lines lie outside of the limits.
    add_level(ax, 1.0, "critical angle" if limit > 1 else None)
    if bool(response.overturned) and np.isfinite(response.overturning_time):
        ax.axvline(
            float(response.overturning_time), color=LINE, linestyle=":", label="overturning"
        )

    ax.set_xlim(first, last)
    above = add_strip_above(ax, bottom, limit)
    # A vertical component makes the block lighter or heavier, and so easier to lift or harder.
    weight = 1 + np.asarray(scene.motion.upward(times)) / float(scene.block.gravity)
    lifting = float(uplift_acceleration(scene.block, response.model)) * weight
    above.plot(times, np.asarray(scene.motion.horizontal(times)), color=NEUTRAL, linewidth=0.7)
    levels = above.plot(times, lifting)
    if not scene.block.one_sided:
        levels += above.plot(times, -lifting)
    # The legend is one, below: it gets its entry from a line without points.
    for line in (*levels, *ax.plot([], label="lifts the block")):
        line.set(color=LINE, linestyle="-.", linewidth=0.8)
    # The ground, or a floor: a record does not know.
    label_axes(above, "", "base [m/s²]")
    ax.legend(**ABOVE, ncols=4)
    return label_axes(ax, "time [s]", RATIO)


def plot_phase(response: Response, ax: Axes | None = None) -> Axes:
    """Draw the phase portrait and the separatrix of free motion; a block overturns beyond it.

    Parameters
    ----------
    response : Response
        From `jaxrock.respond`.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
        The axes drawn on.
    """
    check_result("response", response, Response, "respond(block, restitution, motion)")
    ax = get_axes(ax)
    block = response.scene.block
    angle = float(block.critical_angle)
    unit = float(block.frequency_parameter) * angle  # of the velocity
    times = np.linspace(*_find_moving_span(response), 8000)
    rotation, velocity = (np.array(values) for values in response.history(times))
    # Impacts change the velocity at once: no line from before to after.
    broken = np.diff(np.searchsorted(np.asarray(response.impact_times), times)) > 0
    velocity[1:][broken] = np.nan
    ax.plot(rotation / angle, velocity / unit, color=INK, linewidth=0.8, label="motion")
    outward = np.linspace(0, 1.5 * angle, 200)  # from the side that the block stands on
    # The separatrix belongs to free motion: its energy is that with which a block balances.
    equation = Equation.of(block, response.model)
    returning = np.asarray(equation.returning_velocity(jnp.asarray(outward)))
    # On the side of a wall there is none.
    sides = np.array([1, 1] if block.one_sided else [1, 1, -1, -1])
    velocities = np.array([1, -1, 1, -1][: sides.size])
    mirrored = outward[:, None] * sides / angle, returning[:, None] * velocities / unit
    labels = ["separatrix", None, None, None][: sides.size]
    ax.plot(*mirrored, "--", color=NEUTRAL, label=labels)
    shown = np.abs(velocity[np.abs(rotation) <= 1.5 * angle]) / unit
    # The fall, much faster than what came before it, does not set the limits.
    limit = max(1.2, 1.1 * min(float(np.nanmax(shown)), 3))
    reach = min(1.5, 1.2 * float(np.max(np.abs(rotation))) / angle or 1.5)
    leftmost = -0.05 * reach if block.one_sided else -reach
    ax.set(xlim=(leftmost, reach), ylim=(-limit, limit))
    # Small ratios have long numbers, which would touch.
    ax.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    ax.legend(**ABOVE, ncols=2)
    return label_axes(ax, RATIO, r"velocity ratio $\dot\alpha/(p\,\alpha_c)$ [-]")


def _find_moving_span(response: Response, limit: float = _LIMIT) -> tuple[float, float]:
    """Find the time from shortly before a block moves until it rests, or falls beyond a limit.

    All of the time that was simulated if it never moves.
    """
    end = float(response.scene.duration)
    times = np.linspace(0, end, 4000)
    ratio = np.abs(response.history(times)[0]) / float(response.scene.block.critical_angle)
    moving = np.flatnonzero((ratio > 0) & ((ratio < limit) | (not bool(response.overturned))))
    if not moving.size:
        return 0.0, end
    first, last = times[moving[[0, -1]]]
    # A twentieth on either side, and at least one step: a single sample has no length.
    margin = 0.05 * (last - first) + times[1]
    return max(0.0, float(first - margin)), min(end, float(last + margin))


def animate(
    response: Response,
    path: str | Path,
    frames_per_second: int = 20,
    span: tuple[float, float] | None = None,
) -> None:
    """Write a GIF of the block on the moving ground, with its rotation traced under it.

    The film has at most 400 frames; if it is faster than real time, the title says so. Since
    records drift, the ground is drawn relative to its mean position over two seconds.

    Parameters
    ----------
    response, path : Response, path
        From `jaxrock.respond`; the file to write.
    frames_per_second : int
        Frames per second.
    span : tuple of float, optional
        First and last time [s]; by default from shortly before the block moves until it rests
        or lies on its side.

    Raises
    ------
    ValueError
        If the span is not within the time that was simulated.
    """
    check_result("response", response, Response, "respond(block, restitution, motion)")
    block = response.scene.block
    end = float(response.scene.duration)
    angle = float(block.critical_angle)
    first, last = (
        _find_moving_span(response, 0.999 * TOPPLED_ROTATION / angle) if span is None else span
    )
    if not 0 <= first < last <= end:
        raise ValueError(f"span must be increasing and within 0 and {end:g} s, got {span}")
    count = int(np.clip(round((last - first) * frames_per_second), 2, _FRAMES))
    times = np.linspace(first, last, count)
    rotations = np.asarray(response.history(times)[0]).tolist()
    shifts = _compute_ground_shift(response.scene.motion, times)
    drawn = np.stack(
        [_rotate(_compute_corners(block), block, rotation) for rotation in rotations]
    )
    drawn[..., 0] += shifts[:, None]
    reach, top = np.abs(drawn).max((0, 1))

    figure, (ax, below) = plt.subplots(
        2, figsize=(5, 5), height_ratios=(3, 1), layout="constrained"
    )
    # As large as the height of the panel allows.
    shape = _draw_block(ax, block, max(1.1 * reach, 0.8 * top), 1.08 * top)
    walls = [_draw_wall(ax, block, 1.08 * top)] if block.one_sided else []
    # Marks on the ground, without which nobody would see it move.
    stones = np.linspace(-8, 8, 65) * top
    (ground,) = ax.plot(stones, 0 * stones - 0.06 * top, "|", color=NEUTRAL, markersize=8)
    ratios = np.array(rotations) / angle
    below.plot(times, ratios, color="0.8", linewidth=1)
    (trace,) = below.plot([], [], color=INK, linewidth=1)
    (now,) = below.plot([], [], "o", color=ACCENT, markersize=5)
    limit = min(_LIMIT, 1.2 * float(np.abs(ratios).max()) or _LIMIT)
    below.set(xlim=(first, last), ylim=(-limit, limit))
    label_axes(below, "time [s]", r"$\alpha/\alpha_c$ [-]")
    faster = (last - first) * frames_per_second / count
    speed = f", {faster:.1f} times as fast" if faster > 1.05 else ""

    def draw(frame: int) -> tuple[Polygon]:
        """Move everything to its place in a frame."""
        shape.set_xy(drawn[frame])
        ground.set_xdata(stones + shifts[frame])
        for wall in walls:
            wall.set_x(shifts[frame] - wall.get_width() - float(block.half_width))
        trace.set_data(times[: frame + 1], ratios[: frame + 1])
        now.set_data(times[frame : frame + 1], ratios[frame : frame + 1])
        ax.set_title(f"{times[frame]:.2f} s, {np.degrees(rotations[frame]):+.1f}°{speed}")
        return (shape,)

    draw(0)
    figure.canvas.draw()
    figure.set_layout_engine("none")  # else every frame is laid out anew
    FuncAnimation(figure, draw, frames=count).save(path, PillowWriter(fps=frames_per_second))
    plt.close(figure)


def _compute_ground_shift(motion: Motion, times: np.ndarray) -> np.ndarray:
    """Compute how far right of its mean over two seconds the ground is [m] at rising times."""
    step = 0.005
    around = 200
    fine = np.arange(0, times[-1] + 1 + step, step)
    # Integrated twice by sums, as exact as a film needs. Accelerations count to the left.
    place = -np.cumsum(np.cumsum(np.asarray(motion.horizontal(fine)))) * step**2
    # A record is not free of drift: of the place itself the block would leave the picture.
    window = np.full(2 * around + 1, 1 / (2 * around + 1))
    mean = np.convolve(np.pad(place, around, "edge"), window, mode="valid")
    return np.interp(times, fine, place - mean)


def _compute_corners(block: Block) -> np.ndarray:
    """Compute the corners of the upright block [m], counterclockwise from the left edge."""
    b = float(block.half_width)
    height = 2 * float(block.half_height)
    return np.array([[-b, 0], [b, 0], [b, height], [-b, height]])


def _rotate(points: np.ndarray, block: Block, rotation: float) -> np.ndarray:
    """Rotate points of the upright block about the corner on which it then stands."""
    pivot = np.array([float(block.half_width) * (1 if rotation > 0 else -1), 0.0])
    cosine = np.cos(rotation)
    sine = np.sin(rotation)
    return (points - pivot) @ np.array([[cosine, -sine], [sine, cosine]]) + pivot


def _draw_block(ax: Axes, block: Block, reach: float, top: float) -> Polygon:
    """Draw the upright block on the ground, in axes of this reach sideways and top [m]."""
    bottom = -0.12 * top
    ax.set(xlim=(-reach, reach), ylim=(bottom, top), aspect="equal")
    ax.set(xlabel="horizontal [m]", ylabel="height [m]")
    ax.axhspan(bottom, 0, color="0.85")
    ax.axhline(0, color=NEUTRAL, linewidth=0.8)
    shape = Polygon(_compute_corners(block), closed=True, facecolor="0.92", edgecolor=INK)
    if not is_rectangle(block):
        shape.set_linestyle("--")
        ax.text(0.02, 0.98, _STAND_IN, transform=ax.transAxes, va="top", fontsize="small")
    ax.add_patch(shape)
    return shape


def _draw_wall(ax: Axes, block: Block, top: float) -> Rectangle:
    """Draw the wall to the left of a one-sided block, as thick as half of its width."""
    b = float(block.half_width)
    wall = Rectangle((-2 * b, 0), b, top, facecolor="0.85", edgecolor=NEUTRAL, hatch="///")
    ax.add_patch(wall)
    return wall
