"""Shared parts of spectra: axes, variables, blocks and their restitutions."""

from collections.abc import Sequence

import numpy as np

from ..block import Block
from ..grids import DataType, GridVariable, Values, as_axis
from ..impact import ONE_SIDED_RESTITUTION, compute_restitution_by_size, read_restitution
from ..validation import Reals, as_real, check, check_concrete

SharedBlock = tuple[Block, Reals]  # with its restitution
VariableTable = dict[str, tuple[DataType, str, str]]  # type, long name and unit


def make_axes(**values: Values | None) -> dict[str, np.ndarray]:
    """Check the values along the axes that are given."""
    return {name: as_axis(name, given) for name, given in values.items() if given is not None}


def make_variables(dims: Sequence[str], table: VariableTable) -> dict[str, GridVariable]:
    """Make variables along dimensions of a table of types, long names and units."""
    return {
        name: GridVariable(dims, dtype, {"long_name": long_name, "units": units})
        for name, (dtype, long_name, units) in table.items()
    }


def estimate_restitution(block: Block) -> np.ndarray | np.floating:
    """Compute the restitutions that follow from size; 0 for blocks that an impact stops."""
    return np.maximum(compute_restitution_by_size(block), 0)


def take_magnitudes(restitution: Values) -> np.ndarray:
    """Take the magnitudes of restitutions of one-sided blocks, along an axis of a spectrum."""
    # This raises for numbers that are not allowed: an axis of magnitudes has lost their signs.
    check("restitution", as_real("restitution", restitution, unit=""), ONE_SIDED_RESTITUTION)
    return np.abs(np.asarray(restitution, dtype=float))


def describe_blocks(
    model: str, gravity: float, inertia_ratio: float, one_sided: bool
) -> tuple[Block, dict[str, str | float]]:
    """Make a block whose size the axes replace, and the attributes that all blocks share."""
    block = Block(1.0, 1.0, gravity, inertia_ratio, one_sided=one_sided)
    numbers = {"gravity": float(gravity), "inertia_ratio": float(inertia_ratio)}
    side = {"one_sided": 1} if one_sided else {}
    return block, {"model": model, **numbers, "gravity_units": "m s-2", **side}


def make_unit_block(
    slenderness: float,
    restitution: float | None,
    inertia_ratio: float,
    one_sided: bool = False,
) -> tuple[SharedBlock, dict[str, str | float]]:
    """Make a block of some size with its restitution, and the attributes that describe it.

    Ratios to the scales of a block do not depend on its size: any size serves.
    """
    check_concrete((slenderness, restitution, inertia_ratio), "a spectrum is a dataset")
    block = Block(0.2, slenderness, inertia_ratio=inertia_ratio, one_sided=one_sided)
    c = float(estimate_restitution(block)) if restitution is None else restitution
    shared = (block, read_restitution(block, c))
    about = {"slenderness": slenderness, "restitution": abs(c), "inertia_ratio": inertia_ratio}
    return shared, about | ({"one_sided": 1} if one_sided else {})
