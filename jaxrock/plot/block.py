"""The block itself, with its symbols, and moving."""

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.axes import Axes
from matplotlib.patches import Arc, Polygon

from ..block import Block
from ..dynamics import Response
from .axes import ACCENT, INK, NEUTRAL, axes_or_new, draws

_OFFSET: dict[str, Any] = {"textcoords": "offset points"}


@draws
def plot_block(block: Block, rotation: float | None = None, ax: Axes | None = None) -> Axes:
    """Draw a block, to scale, with the symbols of Fig. 1.

    Parameters
    ----------
    block : Block
        One block.
    rotation : float, optional
        alpha [rad], positive to the right; half the critical angle by default.
    """
    critical = float(block.critical_angle)
    rotation = 0.5 * critical if rotation is None else float(rotation)
    side = 1 if rotation >= 0 else -1
    ax = axes_or_new(ax, figsize=(4.2, 4.4))
    b, a = float(block.half_width), float(block.half_height)
    reach = max(2 * b + 0.6 * a, 1.1 * (b + 2 * a * abs(np.sin(rotation))))
    shape = _block_on(ax, block, reach, max(2.2 * a, 2.1 * float(block.half_diagonal)))
    shape.set_xy(_rotated(_corners(block), block, rotation))
    pivot = np.array([side * b, 0.0])
    inside = np.array([[0.0, a], [0.0, 2 * a], [-side * b, a]])
    centre, top, across = _rotated(inside, block, rotation)
    for end, look in ((pivot, "--"), (top, "-"), (across, "-")):
        ax.plot(*np.transpose([centre, end]), look, color=INK, linewidth=1)
    ax.plot(*centre, "o", color=INK, markersize=4)
    ax.plot(*pivot, "o", color=ACCENT, markersize=4)
    # At O, the angles from the edge to the vertical and to the centre.
    ax.plot([pivot[0]] * 2, [0, 2.1 * a], ":", color=ACCENT, linewidth=1)
    edge = 90 - np.degrees(rotation)
    for radius, other in ((1.75 * a, 90.0), (0.6 * a, edge + side * np.degrees(critical))):
        arc = Arc((pivot[0], 0), 2 * radius, 2 * radius, color=ACCENT, linewidth=1.5)
        arc.theta1, arc.theta2 = sorted((edge, other))
        ax.add_patch(arc)
    along_edge = np.array([np.sin(rotation), np.cos(rotation)])
    for symbol, (x, y), right, up, colour in (
        ("$R$", (centre + pivot) / 2, -10, 0, INK),
        ("$a$", (centre + top) / 2, -8, 0, INK),
        ("$b$", (centre + across) / 2, 0, 8, INK),
        ("$G$", centre, -9, -9, INK),
        ("$O$", pivot, 0, -11, ACCENT),
        (r"$\alpha$", pivot + 1.75 * a * along_edge, 10, 0, ACCENT),
        (r"$\alpha_c$", pivot + 0.6 * a * along_edge, 10, 0, ACCENT),
    ):
        offset = (side * right, up)  # mirrored with the block
        ax.annotate(symbol, (x, y), offset, color=colour, ha="center", va="center", **_OFFSET)
    # This push of the ground rotates the block to the right: accelerations count to the left.
    tail, below = (-1.6 * b if side > 0 else 1.6 * b + 0.4 * a), -0.1 * a
    ax.annotate("", (tail - 0.4 * a, below), (tail, below), arrowprops={"arrowstyle": "->"})
    ax.annotate(r"$\ddot y$", (tail, below), (3, -4), **_OFFSET)
    return ax


def animate(
    response: Response,
    path: str | Path,
    frames_per_second: int = 20,
    span: tuple[float, float] | None = None,
) -> None:
    """Write a GIF of the block on the ground, in real time.

    Parameters
    ----------
    response : Response
        From `jaxrock.respond`.
    path : path
        File to write.
    frames_per_second : int
        At most; fewer, but at least 1, where that makes more than 300 frames.
    span : tuple of float, optional
        First and last time [s]; the whole response by default.

    Raises
    ------
    ValueError
        If the span is not within the time that the response was followed for.
    """
    block, end = response.scene.block, float(response.scene.duration)
    first, last = (0.0, end) if span is None else span
    if not 0 <= first < last <= end:
        raise ValueError(f"span must be increasing and within 0 and {end:g} s, got {span}")
    rate = int(np.clip(300 / (last - first), 1, frames_per_second))
    times = np.linspace(first, last, max(2, round((last - first) * rate)))
    rotations = np.asarray(response.history(times)[0]).tolist()
    figure, ax = plt.subplots(figsize=(5, 3.6), layout="constrained")
    corners = _corners(block)
    half, height = corners[2]
    diagonal = np.hypot(2 * half, height)
    # Room for the block to fall to either side.
    shape = _block_on(ax, block, 1.05 * max(half + height, diagonal), 1.1 * diagonal)

    def draw(frame: int) -> tuple[Polygon]:
        shape.set_xy(_rotated(corners, block, rotations[frame]))
        ax.set_title(f"{times[frame]:.2f} s, {np.degrees(rotations[frame]):+.1f}°")
        return (shape,)

    draw(0)
    figure.canvas.draw()
    figure.set_layout_engine("none")  # else every frame is laid out anew
    FuncAnimation(figure, draw, frames=times.size).save(path, writer=PillowWriter(fps=rate))
    plt.close(figure)


def _corners(block: Block) -> np.ndarray:
    b, height = float(block.half_width), 2 * float(block.half_height)
    return np.array([[-b, 0], [b, 0], [b, height], [-b, height]])


def _rotated(points: np.ndarray, block: Block, rotation: float) -> np.ndarray:
    """Points of the upright block after its rotation about a corner."""
    b = float(block.half_width)
    pivot = np.array([b if rotation > 0 else -b, 0.0])
    cosine, sine = np.cos(rotation), np.sin(rotation)
    return (points - pivot) @ np.array([[cosine, -sine], [sine, cosine]]) + pivot


def _block_on(ax: Axes, block: Block, reach: float, top: float) -> Polygon:
    """The upright block on the ground, on axes that show so much to either side and up [m]."""
    bottom = -0.12 * top
    ax.set(xlim=(-reach, reach), ylim=(bottom, top), aspect="equal")
    ax.set(xlabel="horizontal [m]", ylabel="height [m]")
    ax.axhspan(bottom, 0, color="0.85")
    ax.axhline(0, color=NEUTRAL, linewidth=0.8)
    shape = Polygon(_corners(block), closed=True, facecolor="0.92", edgecolor=INK)
    ax.add_patch(shape)
    return shape
