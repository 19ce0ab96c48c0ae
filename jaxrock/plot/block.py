"""The block itself, with its symbols, and moving."""

from typing import TYPE_CHECKING

import numpy as np

from .axes import ACCENT, INK, NEUTRAL, axes_or_new, draws

if TYPE_CHECKING:
    from pathlib import Path

    import matplotlib.axes
    from matplotlib.patches import Polygon

    from ..block import Block
    from ..dynamics import Response


@draws
def plot_block(
    block: "Block", rotation: float | None = None, ax: "matplotlib.axes.Axes | None" = None
) -> "matplotlib.axes.Axes":
    """Draw a block, to scale, with the symbols of Fig. 1.

    Parameters
    ----------
    block : Block
        One block.
    rotation : float, optional
        alpha [rad], positive to the right; half the critical angle by default.
    """
    from matplotlib.patches import Arc

    critical = float(block.critical_angle)
    rotation = 0.5 * critical if rotation is None else float(rotation)
    side = 1 if rotation >= 0 else -1
    ax = axes_or_new(ax, figsize=(4.2, 4.4))
    b, a = float(block.half_width), float(block.half_height)
    reach = max(2 * b + 0.6 * a, 1.1 * (b + 2 * a * abs(np.sin(rotation))))
    shape = _block_on(ax, block, reach, max(2.2 * a, 2.1 * float(block.half_diagonal)))
    shape.set_xy(_turned(_corners(block), block, rotation))
    pivot = np.array([side * b, 0.0])
    inside = np.array([[0.0, a], [0.0, 2 * a], [-side * b, a]])
    centre, top, across = _turned(inside, block, rotation)

    def write(name: str, place: np.ndarray, right: int, up: int, colour: str) -> None:
        """Beside a point, so many points away from the side to which the block leans."""
        ax.annotate(
            name,
            (place[0], place[1]),
            (side * right, up),
            textcoords="offset points",
            color=colour,
            ha="center",
            va="center",
        )

    for end, look in ((pivot, "--"), (top, "-"), (across, "-")):
        ax.plot(*np.transpose([centre, end]), look, color=INK, linewidth=1)
    write("$R$", (centre + pivot) / 2, -10, 0, INK)
    write("$a$", (centre + top) / 2, -8, 0, INK)
    write("$b$", (centre + across) / 2, 0, 8, INK)
    write("$G$", centre, -9, -9, INK)
    write("$O$", pivot, 0, -11, ACCENT)
    ax.plot(*centre, "o", color=INK, markersize=4)
    ax.plot(*pivot, "o", color=ACCENT, markersize=4)
    # At O, the angles from the edge to the vertical and to the centre.
    ax.plot([pivot[0]] * 2, [0, 2.1 * a], ":", color=ACCENT, linewidth=1)
    edge = 90 - np.degrees(rotation)
    for name, radius, other in (
        (r"$\alpha$", 1.75 * a, 90.0),
        (r"$\alpha_c$", 0.6 * a, edge + side * np.degrees(critical)),
    ):
        arc = Arc((float(pivot[0]), 0.0), 2 * radius, 2 * radius, color=ACCENT, linewidth=1.5)
        arc.theta1, arc.theta2 = sorted((edge, other))
        ax.add_patch(arc)
        on_edge = np.array([np.cos(np.radians(edge)), np.sin(np.radians(edge))])
        write(name, pivot + radius * on_edge, 10, 0, ACCENT)
    # The ground pushed like this turns the block to the right: accelerations count to the left.
    tail, below = (-1.6 * b if side > 0 else 1.6 * b + 0.4 * a), -0.1 * a
    ax.annotate("", (tail - 0.4 * a, below), (tail, below), arrowprops={"arrowstyle": "->"})
    ax.annotate(r"$\ddot y$", (tail, below), (3, -4), textcoords="offset points")
    return ax


def animate(
    response: "Response",
    path: "str | Path",
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
        Frames a second, at most; less where that makes more than 300 of them, at least 1.
    span : tuple of float, optional
        First and last time [s]; everything unless given.

    Raises
    ------
    ValueError
        If the span is not within the time that the response was followed for.
    """
    import matplotlib.pyplot as plt
    from matplotlib.animation import FuncAnimation, PillowWriter

    block, end = response.scene.block, float(response.scene.duration)
    first, last = (0.0, end) if span is None else span
    if not 0 <= first < last <= end:
        raise ValueError(f"span must be increasing and within 0 and {end:g} s, got {span}")
    rate = int(np.clip(300 / (last - first), 1, frames_per_second))
    frames = max(2, round((last - first) * rate))
    times = np.linspace(first, last, frames)
    rotations = np.asarray(response.history(times)[0]).tolist()
    figure, ax = plt.subplots(figsize=(5, 3.6), layout="constrained")
    corners = _corners(block)
    half, height = corners[2]
    diagonal = np.hypot(2 * half, height)
    # Room for it to fall to either side.
    shape = _block_on(ax, block, 1.05 * max(half + height, diagonal), 1.1 * diagonal)

    def draw(frame: int) -> "tuple[Polygon]":
        shape.set_xy(_turned(corners, block, rotations[frame]))
        ax.set_title(f"{times[frame]:.2f} s, {np.degrees(rotations[frame]):+.1f}°")
        return (shape,)

    draw(0)
    figure.canvas.draw()
    figure.set_layout_engine("none")  # else laid out anew for every frame
    animation = FuncAnimation(figure, draw, frames=frames)
    animation.save(path, writer=PillowWriter(fps=rate))
    plt.close(figure)


def _corners(block: "Block") -> np.ndarray:
    b, height = float(block.half_width), 2 * float(block.half_height)
    return np.array([[-b, 0], [b, 0], [b, height], [-b, height]])


def _turned(points: np.ndarray, block: "Block", rotation: float) -> np.ndarray:
    """Points of the upright block where they are once it has turned about a corner."""
    b = float(block.half_width)
    pivot = np.array([b if rotation > 0 else -b, 0.0])
    cosine, sine = np.cos(rotation), np.sin(rotation)
    return (points - pivot) @ np.array([[cosine, -sine], [sine, cosine]]) + pivot


def _block_on(ax: "matplotlib.axes.Axes", block: "Block", reach: float, top: float) -> "Polygon":
    """The upright block on the ground, shown so far to either side and up [m]."""
    from matplotlib.patches import Polygon

    bottom = -0.12 * top
    ax.set_xlim(-reach, reach)
    ax.set_ylim(bottom, top)
    ax.set_aspect("equal")
    ax.axhspan(bottom, 0, color="0.85")
    ax.axhline(0, color=NEUTRAL, linewidth=0.8)
    ax.set_xlabel("horizontal [m]")
    ax.set_ylabel("height [m]")
    shape = Polygon(_corners(block), closed=True, facecolor="0.92", edgecolor=INK)
    ax.add_patch(shape)
    return shape
