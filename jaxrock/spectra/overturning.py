"""The overturning map: boundaries or responses of a block, over the frequency of a pulse."""

import functools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..block import RECTANGLE_INERTIA_RATIO
from ..driven import Batch, require_complete, uplift_acceleration
from ..grids import Chunks, Grid, Values, list_points
from ..ground_motion import Pulse, check_pulse_class
from ..overturning import critical_amplitude, make_ratios
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from .blocks import SharedBlock, VariableTable, make_axes, make_unit_block, make_variables
from .rocking import LARGEST, RESPONSES, compute_responses

if TYPE_CHECKING:
    import xarray

_TITLE = "Overturning map"
_LARGEST = 2**8  # number of frequencies whose boundaries are searched at once
_LISTED = 16  # largest number of boundaries at each frequency
# Type, long name and unit.
_ALONG_BOUNDARIES: VariableTable = {
    "amplitude_ratio": (float, "amplitude of the pulse over uplift amplitude", "1"),
    "overturns_beyond": (np.int8, "1 where the block overturns beyond the boundary", "1"),
    "impacts": (int, "impacts before it overturns, -1 if there is no boundary", "1"),
}
_OF_ALL: VariableTable = {
    "overturns_first": (np.int8, "1 where it overturns at the lowest amplitude", "1"),
    "count": (int, "number of all boundaries, listed or not", "1"),
}


def overturning_map(  # noqa: PLR0913
    shape: type[Pulse],
    frequency_ratio: Values,
    ratios: Sequence[float] = (1.0, 10.0),
    *,
    amplitude_ratio: Values | None = None,
    slenderness: float = 5.0,
    restitution: float | None = None,
    inertia_ratio: float = RECTANGLE_INERTIA_RATIO,
    one_sided: bool = False,
    resolution: float = 0.01,
    model: ModelLike = Nonlinear(),
    chunks: Chunks | None = None,
) -> "xarray.Dataset":
    """Find every boundary of overturning under pulses of one shape, over their frequency.

    With amplitudes, compute the responses to pulses of these amplitudes instead.

    Parameters
    ----------
    shape : type
        `Rectangular`, `HalfSine`, `Sine`, `Cosine` or `Ricker`.
    frequency_ratio : array_like
        omega_p / p [-], a number or one-dimensional; see `Pulse.frequency`.
    ratios : sequence of two floats
        The range of a_p / (g tan(alpha_c)), or of a_p / (g alpha_c) with `Linearized` [-], in
        which boundaries are sought. Above 1 a pulse lifts the block.
    amplitude_ratio : array_like, optional
        The same ratio, a number or one-dimensional: amplitudes at which responses are
        computed, and no boundaries.
    slenderness, restitution, inertia_ratio : float
        lambda [-]; C [-], by default Housner's; and kappa [-], which affects only this
        default.
    one_sided : bool
        Whether the block stands against a wall, from which a positive acceleration pushes it
        away. C is then by default the magnitude of `one_sided_restitution`.
    resolution : float
        Windows wider than this fraction of their amplitude are detected; see
        `critical_amplitude`.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.
    chunks : mapping of str to int or "auto", optional
        For a lazy dataset; see `resonance_spectrum`.

    Returns
    -------
    xarray.Dataset
        Has frequency_ratio as a dimension or scalar coordinate, the dimension boundary, and
        along both the variables amplitude_ratio (NaN beyond the number of boundaries),
        overturns_beyond and impacts. Along frequency_ratio alone it has overturns_first and
        count, the number of all boundaries; see `Boundaries`. The 16 lowest ones are listed.
        With amplitudes it has frequency_ratio and amplitude_ratio as dimensions or scalar
        coordinates, and the variables of `rocking_spectrum`. All hold for every size of
        block.

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
    >>> found = jr.overturning_map(jr.Sine, [2.0, 4.0], amplitude_ratio=[1.5, 6.0])
    >>> print(found.overturned.values.tolist())
    [[1, 1], [0, 1]]
    """
    kind = check_pulse_class(shape)
    model = as_model(model)
    axes = make_axes(frequency_ratio=frequency_ratio, amplitude_ratio=amplitude_ratio)
    shared, about = make_unit_block(slenderness, restitution, inertia_ratio, one_sided)
    about = {"model": model.name, "motion": kind.name, **about}
    if amplitude_ratio is not None:
        variables = make_variables((*axes,), RESPONSES)
        compute = functools.partial(_simulate_pulses, kind, model)
        grid = Grid(_TITLE, axes, variables, about, compute, LARGEST, shared=shared)
        return grid.build_dataset(chunks)
    make_ratios(ratios, resolution)  # raises before any work if they are not allowed
    low, high = map(float, ratios)
    about |= {"lowest_amplitude_ratio": low, "highest_amplitude_ratio": high}
    dataset = Grid(
        _TITLE,
        axes,
        make_variables((*axes, "boundary"), _ALONG_BOUNDARIES)
        | make_variables((*axes,), _OF_ALL),
        {**about, "resolution": resolution},
        functools.partial(_search_boundaries, kind, model, (low, high), resolution),
        _LARGEST,
        columns={"boundary": _LISTED},
        shared=shared,
    ).build_dataset(chunks)
    # A lazy dataset must state its size before the boundaries are counted.
    if chunks is not None:
        return dataset
    return dataset.isel(boundary=slice(int(dataset["count"].max())))


def _simulate_pulses(
    kind: type[Pulse], model: RockingModel, shared: SharedBlock, *coordinates: np.ndarray
) -> dict[str, np.ndarray]:
    """Simulate the block under the pulses of a part of the plane."""
    block, restitution = shared
    _, (ratios, strengths) = list_points(*coordinates)
    amplitude = strengths * float(uplift_acceleration(block, model))
    pulses = kind(amplitude, kind.angle / (ratios * float(block.frequency_parameter)))
    labels: Any = dict(zip(("frequency_ratio", "amplitude_ratio"), coordinates, strict=True))
    return compute_responses(Batch.of(block, restitution, pulses), model, None, labels)


def _search_boundaries(
    kind: type[Pulse],
    model: RockingModel,
    ratios: Sequence[float],
    resolution: float,
    shared: SharedBlock,
    frequency_ratio: np.ndarray,
) -> dict[str, np.ndarray]:
    """Search boundaries at some frequencies, and list the lowest ones."""
    block, restitution = shared
    duration = kind.angle / (frequency_ratio * float(block.frequency_parameter))
    options = {"resolution": resolution, "model": model}
    boundaries = critical_amplitude(block, restitution, kind, duration, ratios, **options)
    complete = np.atleast_1d(boundaries.complete)
    require_complete(complete, frequency_ratio=np.atleast_1d(frequency_ratio))
    strength = np.asarray(boundaries.value) / float(uplift_acceleration(block, model))
    answers = {name: np.asarray(getattr(boundaries, name)) for name in _OF_ALL}
    for name, values, missing in (
        ("amplitude_ratio", strength, math.nan),
        ("overturns_beyond", boundaries.overturns_beyond, 0),
        ("impacts", boundaries.impacts, -1),
    ):
        listed = np.asarray(values)[..., :_LISTED]
        room = [(0, 0)] * frequency_ratio.ndim + [(0, _LISTED - listed.shape[-1])]
        answers[name] = np.pad(listed, room, constant_values=missing)
    return answers
