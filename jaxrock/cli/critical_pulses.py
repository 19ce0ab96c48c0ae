"""Limits of a block under instantaneous pulses, in closed form."""

import functools
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

from ..block import Block
from ..resonance import (
    critical_intensity,
    critical_restitution,
    critical_slenderness,
    critical_width,
)
from ..validation import Reals
from .options import BlockOptions

if TYPE_CHECKING:
    import matplotlib.axes

UNITS_OF_LIMITS = {
    "critical_intensity": "m/s",
    **dict.fromkeys(
        ("width_at_this_height", "width_at_this_slenderness", "height_at_this_width"), "m"
    ),
    **dict.fromkeys(("critical_slenderness", "critical_restitution"), "-"),
}
# The columns that are printed, and their heads in three lines.
_PRINTED = (
    *("half_cycles", "model", "critical_intensity", "width_at_this_height"),
    *("width_at_this_slenderness", "height_at_this_width", "critical_restitution"),
)
_HEADS = (
    ("", "", "", "width at", "size at this", "height at", ""),
    ("", "", "intensity", "this height", "slenderness,", "this width", "restitution"),
    ("half-cycles", "model", "[m/s]", "[m]", "width [m]", "[m]", "[-]"),
)
_LINE = "{:<11}  {:<10}  {:<9}  {:<11}  {:<16}  {:<10}  {}"


class Limits(NamedTuple):
    """Limits at which a block overturns: a table, text, more data, and how to draw them."""

    columns: Mapping[str, Sequence[object]]
    text: str
    data: Mapping[str, object]
    draw: "Callable[[], matplotlib.axes.Axes]"


def compute_limits(
    options: BlockOptions, intensity: float, half_cycles: Sequence[float]
) -> Limits:
    """Compute what overturns a block in each number of half-cycles, by both equations."""
    block = options.block
    restitution = options.coefficient
    cases = list(itertools.product(half_cycles, ("linearized", "nonlinear")))
    columns: dict[str, Sequence[object]] = {
        "half_cycles": [count for count, _ in cases],
        "model": [model for _, model in cases],
    }

    def compute(critical: Callable[..., Reals], *arguments: object) -> list[float]:
        """Compute the critical value of each case."""
        return [float(critical(*arguments, *case)) for case in cases]

    of_block = (block, restitution, intensity)
    columns["critical_intensity"] = compute(critical_intensity, block, restitution)
    for fixed in ("height", "slenderness"):
        width = functools.partial(critical_width, fixed=fixed)
        columns[f"width_at_this_{fixed}"] = compute(width, *of_block)
    slenderness = compute(critical_slenderness, *of_block)
    columns["critical_slenderness"] = slenderness
    columns["height_at_this_width"] = [float(block.width) * value for value in slenderness]
    columns["critical_restitution"] = compute(critical_restitution, block, intensity)
    rows = zip(*(columns[name] for name in _PRINTED), strict=True)
    lines = [
        options.scene_text,
        "intensity: the pulses that just overturn this block; width, size, height and"
        f" restitution: the block that pulses of {intensity:g} m/s just overturn",
        *(_LINE.format(*heads).rstrip() for heads in _HEADS),
        *(_LINE.format(*map(_write_cell, row)) for row in rows),
    ]
    draw = functools.partial(_draw, *of_block)
    return Limits(columns, "\n".join(lines), {}, draw)


def _draw(block: Block, restitution: float, intensity: float) -> "matplotlib.axes.Axes":
    """Draw critical intensities over the number of half-cycles."""
    from ..plot import plot_critical_intensity

    return plot_critical_intensity(block, restitution, intensity)


def _write_cell(value: object) -> str:
    """Write a cell of the table that is printed."""
    if not isinstance(value, float):
        return str(value)
    if math.isnan(value):
        return "none"
    return "unlimited" if math.isinf(value) else f"{value:.5g}"
