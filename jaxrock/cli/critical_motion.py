"""Limits of a block under a longer pulse or a record: boundaries along a quantity."""

import functools
import math
from dataclasses import replace
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from ..block import SIDES, SIZES_IN_WORDS, Block
from ..driven import require_complete
from ..ground_motion import Motion, Pulse
from ..overturning import (
    Boundaries,
    check_subject,
    critical_amplitude,
    critical_factor,
    overturning_boundaries,
    uplift_factor,
)
from .critical_pulses import Limits
from .motion_options import MotionOptions
from .options import BlockOptions, Grid, ModelName, read_numbers, refuse, write_option

if TYPE_CHECKING:
    import matplotlib.axes

Quantity = Literal[
    "amplitude",
    "duration",
    "factor",
    "width",
    "height",
    "half_width",
    "slenderness",
    "inertia_ratio",
    "restitution",
]
# Ranges of factors and amplitudes, over the one that lifts the block. High amplitudes, of
# short pulses, are examined if there is no boundary among the lower ones.
_FACTORS = (1.0, 50.0)
_AMPLITUDES = (1.0, 10.0)
_HIGH_AMPLITUDES = (10.0, 100.0)
_MAX_LINES = 12  # of boundaries that are printed; the table has all


class BoundarySearch(NamedTuple):
    """A search for boundaries that has been checked.

    The values are None for amplitudes of a pulse and for factors, where the library knows
    where to look.
    """

    block: Block
    restitution: float
    motion: Motion
    along: Quantity
    values: np.ndarray | None
    model: ModelName
    title: str


def plan_search(
    block_options: BlockOptions,
    options: MotionOptions,
    along: Quantity | None,
    values: Grid | None,
    model: ModelName | None,
) -> BoundarySearch:
    """Plan the search: the motion, the quantity, the values to examine."""
    block = block_options.block
    restitution = block_options.coefficient
    # Where the restitution is sought, the one that is given does not matter.
    is_sought = along == "restitution"
    block_text = block_options.size_text if is_sought else block_options.scene_text
    title = f"{block_text}; {options.text}"
    if options.pulse and options.pulse_duration is not None:
        title += f" of {options.pulse_duration:g} s"
    along = along or ("amplitude" if options.pulse else "factor")
    if along in ("amplitude", "duration"):
        name = "amplitude" if along == "amplitude" else "pulse_duration"
        if options.pulse is None:
            raise ValueError(
                f"--along {along} goes with --pulse only; with --record seek --along factor"
            )
        if getattr(options, name) is not None:
            raise ValueError(
                f"{write_option(name)} is sought, got {getattr(options, name):g}: leave it"
                " out, or seek another quantity with --along"
            )
        if along == "amplitude":
            refuse("--amplitude and --along", scale=options.scale)
        # A pulse needs a value of the quantity sought, which the search replaces: 1 stands in.
        options = replace(options, **{name: 1.0})
    motion = options.read()
    examined = None
    if values is not None:
        examined = np.asarray(read_numbers("values", values))
        check_subject(block, restitution, motion, along, examined)
    elif along not in ("factor", "amplitude"):
        raise ValueError(
            f"--values must be given with --along {along}, such as --values START:STOP:COUNT"
        )
    return BoundarySearch(
        block, restitution, motion, along, examined, model or "nonlinear", title
    )


def find_limits(search: BoundarySearch) -> Limits:
    """Find the boundaries of overturning, and what lifts the block; describe both."""
    block, restitution, motion, along, values, model, _ = search
    # The motion has 1 m/s2 where the amplitude is sought: this factor is the amplitude then.
    uplift = float(uplift_factor(block, motion, model=model))
    if values is not None:
        boundaries = overturning_boundaries(
            block, restitution, motion, along, values, model=model
        )
        ends = (float(values[0]), float(values[-1]))
    elif along == "factor":
        boundaries = critical_factor(block, restitution, motion, _FACTORS, model=model)
        ends = (_FACTORS[0] * uplift, _FACTORS[1] * uplift)
    else:
        boundaries, ratio = _find_amplitudes(search)
        ends = (uplift, ratio * uplift)
    # A boundary may be hidden among values that were given up. A table with gaps would
    # mislead, so none is written.
    require_complete(boundaries.complete, **{along: f"between {ends[0]:g} and {ends[1]:g}"})
    names = ("overturns_beyond", "impacts", "toppled")
    columns = {along: np.asarray(boundaries.value).tolist()}
    columns |= {name: np.asarray(getattr(boundaries, name)).tolist() for name in names}
    uplift_name = "amplitude" if along == "amplitude" else "factor"
    data = {
        "along": along,
        "model": model,
        f"uplift_{uplift_name}": uplift,
        "examined": list(ends),
    }
    text = "\n".join(_write_lines(search, boundaries, ends, uplift))
    draw = functools.partial(_draw, boundaries, ends, uplift)
    return Limits(columns, text, data, draw)


def _find_amplitudes(search: BoundarySearch) -> tuple[Boundaries, float]:
    """Find the amplitudes of a pulse, and the ratio to uplift up to which was examined."""
    pulse = search.motion
    assert isinstance(pulse, Pulse)
    find = functools.partial(
        critical_amplitude,
        search.block,
        search.restitution,
        type(pulse),
        pulse.duration,
        model=search.model,
    )
    boundaries = find(_AMPLITUDES)
    if boundaries.count:
        return boundaries, _AMPLITUDES[1]
    return find(_HIGH_AMPLITUDES), _HIGH_AMPLITUDES[1]


def _write_lines(
    search: BoundarySearch, boundaries: Boundaries, ends: tuple[float, float], uplift: float
) -> list[str]:
    """Write what lifts the block, what stays along a side, the boundaries, the range."""
    along = search.along
    lines = [search.title, _describe_uplift(along, uplift)]
    if along in SIDES:
        side = "height" if along == "width" else "width"
        lines.append(f"{SIZES_IN_WORDS[along]} of {getattr(search.block, side):.6g} m")
    if along == "half_width":
        lines.append(f"{SIZES_IN_WORDS[along]} of {search.block.slenderness:.6g}")
    listed = _shorten(str(boundaries))
    if search.values is not None:
        hint = "" if boundaries.count else "; --values sets other values"
        return [*lines, f"{listed}{hint}"]
    end = f"{ends[1]:.4g} m/s2" if along == "amplitude" else f"factor {ends[1]:.4g}"
    end = f"{end}, {ends[1] / uplift:.3g} times uplift"
    if boundaries.count:
        return [*lines, listed, f"the search ended at {end}"]
    return [*lines, f"the block stands up to {end}; --values sets other values"]


def _describe_uplift(along: str, uplift: float) -> str:
    """Describe what lifts the block: an amplitude where it is sought, else a factor."""
    if math.isinf(uplift):
        return "no factor on the motion lifts the block"
    if along == "amplitude":
        return f"the pulse lifts the block once its amplitude is {uplift:.4g} m/s2 or more"
    lifts = f"lifts once the motion is multiplied by {uplift:.4g} or more"
    return f"the block {lifts}" if along == "factor" else f"the block as given {lifts}"


def _shorten(text: str) -> str:
    """Leave out lines in the middle of many, and write how many."""
    lines = text.split("\n")
    if len(lines) <= _MAX_LINES:
        return text
    missing = len(lines) - _MAX_LINES + 1
    return "\n".join(
        [*lines[: _MAX_LINES - 2], f"... {missing} more boundaries ...", lines[-1]]
    )


def _draw(
    boundaries: Boundaries, ends: tuple[float, float], uplift: float
) -> "matplotlib.axes.Axes":
    """Draw the boundaries; what lifts the block on the axis of factors or amplitudes only."""
    from ..plot import plot_boundaries

    on_axis = boundaries.along in ("factor", "amplitude")
    return plot_boundaries(boundaries, ends, uplift=uplift if on_axis else None)
