"""The command about what just overturns a block.

In closed form under instantaneous pulses (``critical_pulses.py``), by a search under a longer
pulse or a record (``critical_motion.py``).
"""

import contextlib
import math

from ..host import write_whole
from ..overturning import UNITS
from ..tables import write_csv
from ..validation import COUNT, NON_NEGATIVE, check
from .answers import Answer, describe_options, list_rows, save_picture
from .critical_motion import Quantity, find_limits, plan_search
from .critical_pulses import UNITS_OF_LIMITS, compute_limits
from .motion_options import MotionOptions
from .options import (
    BlockOptions,
    FileOutput,
    Folder,
    Grid,
    ModelName,
    read_numbers,
    refuse,
    refuse_beside,
    warn_of_intensity,
)

_FILES = ("critical.csv", "critical.png")
_UNITS = {
    **UNITS,
    **UNITS_OF_LIMITS,
    **dict.fromkeys(("factor", "slenderness", "inertia_ratio", "restitution"), "-"),
}


def critical(  # noqa: PLR0913
    *,
    intensity: float | None = None,
    half_cycles: tuple[float, ...] | None = None,
    along: Quantity | None = None,
    values: Grid | None = None,
    model: ModelName | None = None,
    block_options: BlockOptions = BlockOptions(),
    motion_options: MotionOptions = MotionOptions(),
    out: Folder | None = None,
    output: FileOutput = FileOutput(),
) -> Answer:
    """Find the limits at which a block overturns: in resonance, under one pulse or a record.

    Without a pulse or a record, the command computes, in closed form and by both equations,
    the critical intensities of pulses right after each impact, and the sizes and the
    restitution with which the given intensity just overturns the block. With a pulse or a
    record, it finds the amplitude or factor that just lifts the block, and every boundary
    between standing and overturning along a quantity. With --out it writes critical.csv and
    critical.png.

    Example: jaxrock critical --width 0.2 --pulse sine --pulse-duration 0.5

    Parameters
    ----------
    intensity
        Change of ground velocity in each instantaneous pulse [m/s]. 0.15 if not given.
    half_cycles
        Numbers of half-cycles within which instantaneous pulses just overturn the block. 1, 2,
        5 and inf if not given.
    along
        Quantity whose boundaries are sought. By default the amplitude of a pulse, or the
        factor on a record.
    values
        Values to examine. If not given, factors from 1 to 50 times the one that just lifts the
        block, or amplitudes from 1 to 10 times the one that just lifts it, and from 10 to 100
        times if there is no boundary among these.
    model
        Equation of motion under a pulse or a record; nonlinear if not given.
    out
        Folder for critical.csv and critical.png; none is written if not given.
    """
    options = dict(locals())
    search = None
    pulse = 0.15 if intensity is None else intensity
    counts = (1.0, 2.0, 5.0, math.inf) if half_cycles is None else half_cycles
    if motion_options.given:
        refuse_beside("--pulse or --record", intensity=intensity, half_cycles=half_cycles)
        search = plan_search(block_options, motion_options, along, values, model)
    else:
        refuse("--pulse or --record", along=along, values=values, model=model)
        motion_options.refuse_all("--pulse or --record")
        check("intensity", pulse, NON_NEGATIVE)
        warn_of_intensity(pulse)
        options |= {"intensity": pulse, "half_cycles": counts}
        for count in read_numbers("half_cycles", counts):
            check("half_cycles", count, COUNT)
    writing = contextlib.nullcontext()
    if out is not None:
        writing = write_whole("out", out, _FILES, output.force)
    with writing as folder:
        limits = (
            find_limits(search) if search else compute_limits(block_options, pulse, counts)
        )
        if folder is not None:
            about = describe_options("critical", options)
            write_csv(folder / "critical.csv", limits.columns, _UNITS, about)
            picture = limits.draw()
            if search:
                picture.figure.suptitle(search.title, fontsize="medium")
            save_picture(picture, folder / "critical.png")
    files = [] if out is None else [out / name for name in _FILES]
    data = {"rows": list_rows(limits.columns), **limits.data}
    return Answer(limits.text, data, output, files)
