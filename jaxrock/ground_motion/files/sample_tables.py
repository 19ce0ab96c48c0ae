"""Tables of samples: columns of accelerations in time, by their names and units.

What is an acceleration is told by its name: one of `_WORDS`, alone or with an axis before or after
it, or an axis alone beside a unit of acceleration. Nothing else is one, unless a caller names it.
"""

import re

import numpy as np

from ...tables import Head, Table, TextFile, quote_names
from .components import UNIFORM, Caller, Component, Direction, NotAcceleration, find_direction

_WORDS = ("acceleration", "acc", "a")
_AXES = {"x", "y", "z", "1", "2", "3", "h1", "h2", "v", "ns", "ew", "ud", "n", "e"}
_AXES |= {"north", "east", "up", "down"}
# An azimuth, or a channel of SEED.
_OTHER_AXES = re.compile(r"h?[0-3]\d\d|[behs][hlgn][zne12]")
_TIMES = ("time", "Time", "TIME", "t")
# Times whose steps differ by more than this fraction of a step leave out a sample.
_COARSEST = 0.25


def read_samples(text: TextFile, caller: Caller, *named: str) -> list[Component]:
    """Read the accelerations of a table, or else the columns that a caller names.

    A `NotAcceleration` says that there is none. Horizontal ones differ by their axes alone, or
    else the caller has to name one.
    """

    def has_samples(heads: list[Head]) -> bool:
        """Return whether heads name an acceleration, or what the caller names."""
        return any(head.label in named or read_axis(head) for head in heads)

    try:
        table = Table(text, has_samples, "a line with a head such as 'acceleration [g]'")
    except ValueError as error:
        raise NotAcceleration(
            f"{error}: column names another one; numbers without heads are"
            " jr.Record(np.loadtxt(path), time_step, unit=...)"
        ) from None
    heads = quote_names(head.label for head in table.heads)
    for name in named:
        if name not in [head.label for head in table.heads]:
            raise table.error(f"there is no column {name!r}: columns are {heads}")
    axes = {k: axis for k, head in enumerate(table.heads) if (axis := read_axis(head))}
    axes |= {
        k: ("", "") for k, h in enumerate(table.heads) if h.label in named and k not in axes
    }
    level = [k for k, (_, direction) in axes.items() if direction in ("level", "")]
    kinds = {axes[k][0] for k in level}
    is_clear = len(level) < 2 or all(axes[k][1] for k in level)
    if not named and (len(level) > 2 or len(kinds) > 1 or not is_clear):
        names = quote_names(table.heads[k].label for k in level)
        raise table.error(f"which is the acceleration of the ground? column names it: {names}")
    times = [k for k, head in enumerate(table.heads) if head.name in _TIMES and k not in axes]
    units = [unit for k in times if (unit := table.heads[k].unit) and unit.dimension == "time"]
    if len(times) > 1 or (len(times) > len(units) and caller.step is None):
        raise table.error(f"one column of times was expected, 'time [s]', got {heads}")
    times = times if units else []
    values = table.read_samples([*axes, *times])
    step = find_step(text, units[0].factor * values[-1], table.line) if times else None
    step = caller.choose_step(text, step)
    components = []
    for (k, (_, direction)), row in zip(axes.items(), values, strict=False):
        head = table.heads[k]
        factor = caller.choose_unit(text, head.unit.spelling if head.unit else "")
        name = f"{str(text.path)!r}, column {head.label!r}"
        components.append(Component(name, factor * row, step, head.label, direction))
    return components


def read_axis(head: Head) -> tuple[str, Direction] | None:
    """Read the name of an acceleration without its axis, and its direction; None for others."""
    words = head.name.lower().replace("-", " ").split()
    kinds = [word for word in words if word in _WORDS]
    axes = [word for word in words if word not in kinds]
    is_known = all(axis in _AXES or _OTHER_AXES.fullmatch(axis) for axis in axes)
    # A minus sign is none of the signs between words.
    if not words or len(kinds) > 1 or len(axes) > 1 or not is_known or " -" in head.name:
        return None
    # An axis alone, such as n, says nothing without its unit, and neither does a.
    is_named = bool(kinds) and words != ["a"]
    is_stated = head.unit.dimension == "acceleration" if head.unit else is_named
    return ("".join(kinds), find_direction("".join(axes))) if is_stated else None


def find_step(text: TextFile, times: np.ndarray, line: int) -> float:
    """Find the uniform step of times [s], which are printed with few digits perhaps."""
    step = float(f"{(times[-1] - times[0]) / max(times.size - 1, 1):.12g}")
    decimals = next((d for d in range(16) if np.array_equal(np.round(times, d), times)), 16)
    near = max(UNIFORM * step, min(1.01 * 10.0**-decimals, _COARSEST * step))
    deviations = abs(times - times[0] - step * np.arange(times.size))
    worst = int(np.argmax(deviations))
    if not (step > 0 and deviations[worst] <= near):
        raise text.error(
            f"times must rise in equal steps of {step:.6g} s, got {times[worst]:g} s",
            line + 1 + worst,
        )
    return step
