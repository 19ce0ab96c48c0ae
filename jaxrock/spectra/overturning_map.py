"""The overturning map: every boundary of a block, over the frequency of a pulse."""

import functools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np

from ..block import RECTANGLE_INERTIA_RATIO, Block
from ..driven import require_complete
from ..grids import DataType, Grid, GridVariable, Values, as_axis
from ..ground_motion import Pulse, check_pulse_class
from ..overturning import check_range, search_amplitudes_alone
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import Reals
from .driven import make_unit_block

if TYPE_CHECKING:
    import xarray

    from ..grids import Chunks

_LARGEST = 2**8  # frequencies of a grid whose boundaries are searched at once
_LISTED = 16  # boundaries at each frequency in a lazy dataset
_PLANE = ("frequency_ratio", "boundary")
_LINE = ("frequency_ratio",)
_BOUNDARIES: dict[str, tuple[Sequence[str], DataType, str]] = {  # dimensions, type, long name
    "amplitude_ratio": (
        _PLANE,
        float,
        "amplitude of the pulse over the one that just lifts the block",
    ),
    "overturns_beyond": (_PLANE, np.int8, "1 where the block overturns beyond the boundary"),
    "impacts": (_PLANE, int, "impacts before it overturns, -1 if there is no boundary"),
    "overturns_first": (_LINE, np.int8, "1 where it overturns at the lowest amplitude"),
    "count": (_LINE, int, "number of all boundaries, listed or not"),
}


def overturning_map(  # noqa: PLR0913
    shape: type[Pulse],
    frequency_ratio: Values,
    amplitude_ratios: Sequence[float] = (1.0, 10.0),
    *,
    slenderness: float = 5.0,
    restitution: float | None = None,
    inertia_ratio: float = RECTANGLE_INERTIA_RATIO,
    one_sided: bool = False,
    resolution: float = 0.01,
    model: ModelLike = Nonlinear(),
    max_boundaries: int | None = None,
    chunks: "Chunks | None" = None,
) -> "xarray.Dataset":
    """Find every boundary of overturning under pulses, over frequency and amplitude ratio.

    Parameters
    ----------
    shape, frequency_ratio, slenderness, restitution, inertia_ratio, one_sided, model
        As in `overturning_spectrum`.
    amplitude_ratios : sequence of two floats
        The range of a_p / (g tan(alpha_c)), or of a_p / (g alpha_c) with `Linearized` [-].
    resolution : float
        Windows wider than this fraction of their amplitude are detected; see
        `critical_amplitude`.
    max_boundaries : int, optional
        Number of boundaries that are listed at each frequency, the lowest ones. By default
        all are listed, in a lazy dataset 16, since its size must be known beforehand.
    chunks : mapping of str to int or "auto", optional
        Along frequency_ratio, for a lazy dataset; see `resonance_spectrum`.

    Returns
    -------
    xarray.Dataset
        Has frequency_ratio as a dimension or scalar coordinate, the dimension boundary, and
        along both the variables amplitude_ratio (NaN beyond the number of boundaries),
        overturns_beyond and impacts. Along frequency_ratio alone it has overturns_first and
        count, the number of all boundaries, listed or not; see `Boundaries`. All hold for
        every size of block.

    Raises
    ------
    ValueError
        If an argument is out of range, or an integration did not finish.

    Examples
    --------
    >>> import jaxrock as jr
    >>> found = jr.overturning_map(jr.Sine, [4.0], restitution=0.9)
    >>> print(found.amplitude_ratio.values.round(2), found.overturns_beyond.values)
    [[1.8  4.93 5.29]] [[1 0 1]]
    """
    model = as_model(model)
    ratios = as_axis("frequency_ratio", frequency_ratio)
    if max_boundaries is not None and max_boundaries < 1:
        raise ValueError(f"max_boundaries must be at least 1, got {max_boundaries}")
    kind = check_pulse_class(shape)
    shared, uplift = make_unit_block(slenderness, restitution, inertia_ratio, one_sided, model)
    block, c = shared
    lows_and_highs = tuple(map(float, amplitude_ratios))
    check_range(lows_and_highs, resolution)
    rate = float(block.frequency_parameter)
    search = (lows_and_highs, resolution, model)
    compute = functools.partial(_search_boundaries, kind, uplift, rate, search)
    # By default all boundaries are listed, and how many there are is known once they have been
    # found. A lazy dataset must state its size before.
    boundaries = None
    if max_boundaries is None and chunks is None:
        boundaries = compute(0, shared, ratios)
        max_boundaries = boundaries["amplitude_ratio"].shape[-1]
    columns = _LISTED if max_boundaries is None else max_boundaries
    variables: dict[str, GridVariable] = {}
    for name, (dims, dtype, long_name) in _BOUNDARIES.items():
        about = {"long_name": long_name, "units": "1"}
        # In the precision of JAX, which the amplitudes come in.
        kind_of_number = jnp.result_type(float) if dtype is float else dtype
        variables[name] = GridVariable(dims, kind_of_number, about)
    attributes = {
        "model": model.name,
        "motion": kind.name,
        "slenderness": slenderness,
        "restitution": float(c),
        "inertia_ratio": inertia_ratio,
        "lowest_amplitude_ratio": lows_and_highs[0],
        "highest_amplitude_ratio": lows_and_highs[1],
        "resolution": resolution,
    }
    if one_sided:
        attributes["one_sided"] = 1
    grid = Grid(
        "Overturning map",
        {"frequency_ratio": ratios},
        variables,
        attributes,
        functools.partial(compute, columns),
        _LARGEST,
        columns={"boundary": columns},
        shared=shared,
    )
    if boundaries is None:
        return grid.build_dataset(chunks)
    return grid.label({n: np.asarray(boundaries[n], v.dtype) for n, v in variables.items()})


def _search_boundaries(
    kind: type[Pulse],
    uplift: float,
    rate: float,
    search: tuple[Sequence[float], float, RockingModel],
    columns: int,
    shared: tuple[Block, Reals],
    ratios: np.ndarray,
) -> dict[str, np.ndarray]:
    """Search boundaries at some frequencies; list `columns` of them, or all if it is 0."""
    shape = ratios.shape  # () of a single frequency
    ratios = np.atleast_1d(ratios)
    durations = kind.angle / (ratios * rate)
    block, c = shared
    boundaries = search_amplitudes_alone(block, c, kind, durations, *search)
    require_complete(boundaries.complete, frequency_ratio=ratios)
    answers = {
        "amplitude_ratio": np.asarray(boundaries.value) / uplift,
        "overturns_beyond": np.asarray(boundaries.overturns_beyond, np.int8),
        "impacts": np.asarray(boundaries.impacts),
    }
    # The search has as many columns as the frequency with most boundaries in this chunk needs:
    # fewer or more than the dataset has.
    room = max(0, columns - boundaries.value.shape[1])
    missing = {"amplitude_ratio": math.nan, "overturns_beyond": 0, "impacts": -1}
    padded = {
        name: np.pad(values, ((0, 0), (0, room)), constant_values=missing[name])
        for name, values in answers.items()
    }
    answers = {name: values[:, : columns or None] for name, values in padded.items()}
    answers["overturns_first"] = np.asarray(boundaries.overturns_first, np.int8)
    answers["count"] = np.asarray(boundaries.count)
    return {name: v.reshape((*shape, *v.shape[1:])) for name, v in answers.items()}
