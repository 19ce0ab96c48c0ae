"""Everything that pulses right after each impact just overturn, in one table."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ..block import Block
from ..host import Printed, format_table
from ..impact import describe_scene
from ..validation import NON_NEGATIVE, Reals, check
from .inverse_design import (
    critical_intensity,
    critical_restitution,
    critical_slenderness,
    critical_width,
)

_HEADS = {
    "intensity [m/s]": "critical_intensity",
    "width [m]": "width_at_this_height",
    "size [m]": "width_at_this_slenderness",
    "height [m]": "height_at_this_width",
    "restitution": "critical_restitution",
}


@dataclass(frozen=True, repr=False)
class CriticalValues(Printed):
    """Critical values of a block under pulses right after each impact; see `critical_values`.

    Attributes
    ----------
    block, restitution, intensity : Block, float, float
        The arguments.
    columns : dict of list
        A value for each number of half-cycles and each model.
    """

    block: Block
    restitution: float | Reals
    intensity: float
    columns: dict[str, list[Any]]

    def table(self) -> dict[str, list[Any]]:
        """List the columns of the table by name.

        Returns
        -------
        dict of list
        """
        return self.columns

    def __str__(self) -> str:
        cases = zip(self.columns["half_cycles"], self.columns["model"], strict=True)
        names = [f"{count:g}, {model}".replace("inf", "unlimited") for count, model in cases]
        shown = {head: map(_format_value, self.columns[_HEADS[head]]) for head in _HEADS}
        sentence = (
            "intensity: the pulses that just overturn this block in so many half-cycles; width"
            " at this height,\nsize as the width at this slenderness, height at this width,"
            f" restitution: of the block that pulses of {self.intensity:g} m/s just overturn"
        )
        scene = describe_scene(self.block, self.restitution)
        return f"{scene}\n{format_table(sentence, names, **shown)}"


def _format_value(value: float) -> str:
    """Format a critical value in words where there is none, or any will do."""
    return f"{value:.5g}".replace("nan", "none").replace("inf", "any")


def critical_values(
    block: Block,
    restitution: float | Reals,
    intensity: float = 0.15,
    half_cycles: Sequence[float] = (1.0, 2.0, 5.0, math.inf),
) -> CriticalValues:
    """Compute by both models what just overturns one block in each number of half-cycles.

    Parameters
    ----------
    block, restitution : Block, float
        A single block, and C [-].
    intensity : float
        Change of ground velocity in each pulse [m/s], under which the critical sizes and the
        critical restitution are sought.
    half_cycles : sequence of float
        Whole numbers from 1 on, or inf.

    Returns
    -------
    CriticalValues

    Raises
    ------
    ValueError
        If an argument is out of range, or not single.

    Examples
    --------
    >>> import jaxrock as jr
    >>> values = jr.resonance.critical_values(jr.Block(0.4, 5.0), 0.7)
    >>> print(f"{values.table()['critical_intensity'][1]:.3f} m/s")
    1.038 m/s
    """
    check("intensity", intensity, NON_NEGATIVE)
    given = (block, restitution, intensity)
    rows = []
    for case in itertools.product(half_cycles, ("linearized", "nonlinear")):
        slenderness = critical_slenderness(*given, *case)
        numbers = {
            "critical_intensity": critical_intensity(block, restitution, *case),
            "width_at_this_height": critical_width(*given, *case, fixed="height"),
            "width_at_this_slenderness": critical_width(*given, *case),
            "critical_slenderness": slenderness,
            "critical_restitution": critical_restitution(block, intensity, *case),
            "height_at_this_width": block.width * slenderness,
        }
        row: dict[str, Any] = dict(zip(("half_cycles", "model"), case, strict=True))
        rows.append(row | {name: float(value) for name, value in numbers.items()})
    columns = {name: [row[name] for row in rows] for name in rows[0]}
    return CriticalValues(block, restitution, intensity, columns)
