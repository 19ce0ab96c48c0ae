"""Figures. Each takes ``ax=None`` and returns the axes it drew on."""

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pathlib import Path

    import matplotlib.axes
    import matplotlib.figure
    import xarray

    from .response import Response

_LABELS = {
    "slenderness": r"slenderness $\lambda$",
    "width": "width $2b$",
    "restitution": "restitution $C$",
    "intensity": "pulse intensity $I$",
    "rotation_ratio": r"rotation ratio $\alpha^*_{max}/\alpha_c$",
    "peak_rotation": r"peak rotation $\alpha^*_{max}$",
    "period": "stabilized period $T^*$",
    "amplification": r"amplification $\zeta$",
    "overturning_margin": "overturning margin",
    "overturning_half_cycle": "half-cycle that overturns",
    "critical_intensity": "critical intensity",
}
_STYLES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)))
_UNITS = {"m s-1": "m/s", "1": ""}


def plot_curves(
    variable: "xarray.DataArray",
    hue: str,
    along: str = "slenderness",
    ax: "matplotlib.axes.Axes | None" = None,
) -> "matplotlib.axes.Axes":
    """Draw a variable of a spectrum along one dimension, one curve for each value of another.

    A curve ends where the block overturns; a cross marks the last value that there is.

    Parameters
    ----------
    variable : xarray.DataArray
        With dimensions `along` and `hue` only, for example
        ``spectrum.rotation_ratio.sel(restitution=0.6)``.
    hue : str
        Dimension that tells the curves apart.
    along : str
        Dimension of the horizontal axis.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    ValueError
        If `variable` has other dimensions.
    """
    if set(variable.dims) != {along, hue}:
        raise ValueError(
            f"variable must have the dimensions {along} and {hue}, got {variable.dims}"
        )
    import matplotlib
    import matplotlib.pyplot as plt

    if ax is None:
        _, ax = plt.subplots(layout="constrained")
    variable = variable.sortby(along)
    x = variable[along].values
    levels = variable[hue].values
    # Dark to light, stopping short of what is too pale to read; with a style of its own
    # each, so that the curves differ without colours.
    colours = matplotlib.colormaps["cividis"](np.linspace(0, 0.85, levels.size))
    for index, (level, colour) in enumerate(zip(levels, colours, strict=True)):
        y = variable.sel({hue: level}).values
        style = _STYLES[index % len(_STYLES)]
        marker = "o" if x.size == 1 else None
        ax.plot(x, y, color=colour, linestyle=style, marker=marker, label=f"{level:g}")
        standing = np.isfinite(y)
        last = standing & ~(np.append(standing[1:], True) & np.append(True, standing[:-1]))
        if last.any():
            ax.plot(x[last], y[last], linestyle="", marker="x", color=colour)
    ax.set_xlabel(_label(variable[along]))
    ax.set_ylabel(_label(variable))
    if x.size > 1:
        ax.set_xlim(x[0], x[-1])
    if not (variable < 0).any():
        ax.set_ylim(bottom=0, auto=True)
    ax.grid(alpha=0.3)
    ax.legend(
        title=_label(variable[hue]), loc="center left", bbox_to_anchor=(1, 0.5), frameon=False
    )
    return ax


def plot_spectrum(
    spectrum: "xarray.Dataset", variable: str = "rotation_ratio"
) -> "matplotlib.figure.Figure":
    """Draw a variable of `resonance_spectrum` over slenderness, a panel each restitution.

    A row of panels each intensity, a curve each width. Of a dimension with more values than
    can be told apart (4 panels a side, 7 curves) some are drawn, evenly chosen.

    Parameters
    ----------
    spectrum : xarray.Dataset
        From `jaxrock.resonance_spectrum`.
    variable : str
        Which of its variables.

    Returns
    -------
    matplotlib.figure.Figure
    """
    import matplotlib.pyplot as plt

    data = _some(spectrum[variable], width=7, restitution=4, intensity=4)
    restitutions = data.restitution.values
    has_rows = "intensity" in data.dims
    rows = data.intensity.values if has_rows else [None]
    figure, panels = plt.subplots(
        len(rows),
        restitutions.size,
        figsize=(0.8 + 3.2 * restitutions.size, 0.6 + 3.0 * len(rows)),
        sharex=True,
        sharey=True,
        squeeze=False,
        layout="constrained",
    )
    for row, intensity in zip(panels, rows, strict=True):
        for panel, restitution in zip(row, restitutions, strict=True):
            chosen = {"restitution": restitution} | ({"intensity": intensity} if has_rows else {})
            plot_curves(data.sel(chosen), hue="width", ax=panel)
            pulse = spectrum.intensity.item() if spectrum.intensity.ndim == 0 else intensity
            title = f"$C$ = {restitution:g}"
            panel.set_title(title if pulse is None else f"{title}, $I$ = {pulse:g} m/s")
            if panel is not panels[0, -1]:
                panel.get_legend().remove()
            panel.label_outer()
    return figure


def plot_rocking_spectrum(spectrum: "xarray.Dataset") -> "matplotlib.figure.Figure":
    """Draw peak rotation over the period 2 pi / p, a panel each restitution.

    A curve each slenderness; it ends where the block overturns. Of more values than can be
    told apart (4 panels, 5 curves) some are drawn, evenly chosen.

    Parameters
    ----------
    spectrum : xarray.Dataset
        From `jaxrock.rocking_spectrum`.

    Returns
    -------
    matplotlib.figure.Figure
    """
    import matplotlib.pyplot as plt

    standing = spectrum.rotation_ratio.where(spectrum.overturned == 0)
    data = _some(standing, slenderness=5, restitution=4)
    restitutions = data.restitution.values
    figure, panels = plt.subplots(
        1,
        restitutions.size,
        figsize=(2.4 + 4.0 * restitutions.size, 4.2),
        sharey=True,
        squeeze=False,
        layout="constrained",
    )
    for panel, restitution in zip(panels[0], restitutions, strict=True):
        chosen = data.sel(restitution=restitution)
        plot_curves(chosen, hue="slenderness", along="period", ax=panel)
        panel.set_xlabel(r"period $2\pi/p$ [s]")
        panel.set_ylabel(r"peak rotation $|\alpha|_{max}/\alpha_c$")
        panel.set_title(f"$C$ = {restitution:g}")
        if panel is not panels[0, -1]:
            panel.get_legend().remove()
        panel.label_outer()
    return figure


def plot_response(
    response: "Response", ax: "matplotlib.axes.Axes | None" = None
) -> "matplotlib.axes.Axes":
    """Draw rotation over critical angle against time, with a tick at every impact.

    Parameters
    ----------
    response : Response
        From `jaxrock.respond`.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
    """
    import matplotlib.pyplot as plt

    if ax is None:
        _, ax = plt.subplots(layout="constrained")
    times = np.linspace(0, float(response.scene.duration), 4000)
    ratio = np.asarray(response.history(times)[0]) / float(response.scene.block.critical_angle)
    ax.plot(times, ratio, color="#00204d", linewidth=0.9)
    impacts = np.asarray(response.impact_times)
    ax.plot(impacts, np.zeros_like(impacts), "|", color="#b5651d", markersize=6, label="impacts")
    for level in (-1, 1):
        ax.axhline(level, color="0.5", linestyle="--", linewidth=0.8)
    limit = min(1.4, 1.2 * float(np.max(np.abs(ratio))) or 1.4)
    ax.set_ylim(-limit, limit)
    if bool(response.overturned) and np.isfinite(float(response.overturning_time)):
        ax.axvline(float(response.overturning_time), color="0.2", linestyle=":")
    ax.set_xlim(0, times[-1])
    ax.set_xlabel("time [s]")
    ax.set_ylabel(r"rotation $\alpha/\alpha_c$")
    ax.legend(frameon=False, loc="upper right")
    ax.grid(alpha=0.3)
    return ax


def plot_phase(
    response: "Response", ax: "matplotlib.axes.Axes | None" = None
) -> "matplotlib.axes.Axes":
    """Draw the phase portrait, with the separatrix of free motion.

    Parameters
    ----------
    response : Response
        From `jaxrock.respond`.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; new ones by default.

    Returns
    -------
    matplotlib.axes.Axes
    """
    import jax.numpy as jnp
    import matplotlib.pyplot as plt

    from .equation import Equation

    if ax is None:
        _, ax = plt.subplots(layout="constrained")
    block = response.scene.block
    angle, rate = float(block.critical_angle), float(block.frequency_parameter)
    times = np.linspace(0, float(response.scene.duration), 8000)
    rotation, velocity = (np.array(part) for part in response.history(times))
    # Impacts change the velocity at once: no line from before to after.
    broken = np.diff(np.searchsorted(np.asarray(response.impact_times), times)) > 0
    velocity[1:][broken] = np.nan
    ax.plot(rotation / angle, velocity / (rate * angle), color="#00204d", linewidth=0.8)
    lean = np.linspace(0, 1.5 * angle, 200)
    equation = Equation.of(block, response.linearized)
    back = np.asarray(equation.returning_speed(jnp.asarray(lean))) / (rate * angle)
    for side in (-1, 1):
        for sign in (-1, 1):
            label = "separatrix" if side == sign == 1 else None
            ax.plot(side * lean / angle, side * sign * back, "--", color="0.5", label=label)
    ax.set_xlim(-1.5, 1.5)
    largest = np.nanmax(np.abs(velocity)) / (rate * angle)
    ax.set_ylim(-max(1.2, min(largest, 3)), max(1.2, min(largest, 3)))
    ax.set_xlabel(r"rotation $\alpha/\alpha_c$")
    ax.set_ylabel(r"velocity $\dot\alpha/(p\,\alpha_c)$")
    ax.legend(frameon=False, loc="upper right")
    ax.grid(alpha=0.3)
    return ax


def animate(response: "Response", path: "str | Path", frames_per_second: int = 20) -> None:
    """Write a GIF of the block on the ground, in real time.

    Parameters
    ----------
    response : Response
        From `jaxrock.respond`.
    path : path
        File to write.
    frames_per_second : int
        Frames a second, at most; less where that makes more than 300 of them, at least 1.
    """
    import matplotlib.pyplot as plt
    from matplotlib.animation import FuncAnimation, PillowWriter
    from matplotlib.patches import Polygon

    block, duration = response.scene.block, float(response.scene.duration)
    rate = int(np.clip(300 / duration, 1, frames_per_second))
    frames = max(2, round(duration * rate))
    times = np.linspace(0, duration, frames)
    rotations = np.asarray(response.history(times)[0])
    b, height = float(block.half_width), 2 * float(block.half_height)
    corners = np.array([[-b, 0], [b, 0], [b, height], [-b, height]])
    figure, ax = plt.subplots(figsize=(4, 4), layout="constrained")
    size = 1.1 * np.hypot(2 * b, height)
    ax.set_xlim(-size, size)
    ax.set_ylim(-0.1 * size, 1.3 * size)
    ax.set_aspect("equal")
    ax.axhspan(-0.1 * size, 0, color="0.8")
    ax.set_xlabel("[m]")
    ax.set_ylabel("[m]")
    shape = Polygon(corners, closed=True, facecolor="#7c7b78", edgecolor="#00204d")
    ax.add_patch(shape)

    def draw(frame: int) -> tuple[Polygon]:
        rotation = rotations[frame]
        pivot = np.array([b if rotation > 0 else -b, 0.0])
        cosine, sine = np.cos(rotation), np.sin(rotation)
        turned = (corners - pivot) @ np.array([[cosine, -sine], [sine, cosine]])
        shape.set_xy(turned + pivot)
        ax.set_title(f"{times[frame]:.2f} s, {np.degrees(rotation):+.1f}°")
        return (shape,)

    animation = FuncAnimation(figure, draw, frames=frames)
    animation.save(path, writer=PillowWriter(fps=rate))
    plt.close(figure)


def _some(variable: "xarray.DataArray", **most: int) -> "xarray.DataArray":
    """At most so many values of each dimension, evenly chosen."""
    for name, number in most.items():
        size = variable.sizes.get(name, 1)
        if size > number:
            variable = variable.isel({name: np.linspace(0, size - 1, number).round().astype(int)})
    return variable


def _label(variable: "xarray.DataArray") -> str:
    name = str(variable.name)
    units = variable.attrs.get("units", "1")
    units = _UNITS.get(units, units)
    return _LABELS.get(name, name) + (f" [{units}]" if units else "")
