"""Responses over grids: rocking spectra of records, overturning spectra of pulses."""

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import jax
import numpy as np
from jaxtyping import PyTree

from ..block import RECTANGLE_INERTIA_RATIO, Block
from ..driven import (
    Batch,
    follow_batch,
    follow_within,
    require_complete,
    uplift_acceleration,
)
from ..grids import (
    DataType,
    Grid,
    GridVariable,
    Values,
    apply_padded,
    as_axis,
    list_points,
)
from ..ground_motion import (
    Harmonic,
    Motion,
    Pulse,
    Record,
    Suite,
    check_pulse_class,
    describe_suite,
)
from ..host import add_names
from ..impact import read_restitution
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import (
    AT_LEAST_ONE,
    POSITIVE,
    RIGHT_ANGLE,
    Reals,
    as_flag,
    as_real,
    check,
    check_concrete,
    check_kind,
)
from .restitutions import estimate_restitution, take_magnitudes

if TYPE_CHECKING:
    import xarray

    from ..grids import Chunks

_LARGEST = 2**14  # blocks of a spectrum that are followed at once

# Type, long name and unit.
_VARIABLES: dict[str, tuple[DataType, str, str]] = {
    "rotation_ratio": (float, "peak rotation over critical angle", "1"),
    "peak_rotation": (float, "peak rotation", "rad"),
    "overturned": (np.int8, "1 where the block overturns", "1"),
    "margin": (float, "margin at the end of the input, overturns below 0", "1"),
    "impacts": (int, "number of impacts", "1"),
}
_ESTIMATES: dict[str, tuple[DataType, str, str]] = {
    "rtol": (float, "tolerance used for this block", "1"),
    "error": (float, "upper bound of the relative error of the peak rotation", "1"),
    "within_tolerance": (np.int8, "1 where the error is within the tolerance", "1"),
}


def rocking_spectrum(  # noqa: PLR0913
    motion: Motion | Suite,
    free_period: Values,
    slenderness: Values | None = None,
    restitution: Values | None = None,
    *,
    critical_angle: Values | None = None,
    gravity: float = 9.81,
    inertia_ratio: float = RECTANGLE_INERTIA_RATIO,
    one_sided: bool = False,
    factor: Values | None = None,
    model: ModelLike = Nonlinear(),
    tolerance: float | None = None,
    chunks: "Chunks | None" = None,
) -> "xarray.Dataset":
    """Compute responses of blocks of many sizes and shapes to one or several ground motions.

    Parameters
    ----------
    motion : Motion or Suite
        A pulse, a `Harmonic` or a `Record`, the same for all blocks; or a `Suite`, each
        record of which acts on all blocks.
    free_period : array_like
        2 pi / p of the blocks [s], a number or one-dimensional. Here and below an array makes
        a dimension of the dataset, a number a scalar coordinate.
    slenderness, critical_angle : array_like
        lambda [-] or alpha_c [rad] of the blocks: one of the two.
    restitution : array_like, optional
        C [-]. By default Housner's value for each block, which adds no dimension.
    gravity, inertia_ratio, one_sided : float, float, bool
        g [m/s2], kappa [-], and whether all blocks stand against a wall; see `Block`. For
        one-sided blocks the restitution is by default `one_sided_restitution`, and its axis
        has magnitudes.
    factor : array_like, optional
        Factors on the ground motion [-].
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.
    tolerance : float, optional
        Compute each block to this relative error of the peak rotation; see `respond_within`.
        The dataset then also has the variables rtol, error and within_tolerance. The last is
        0 where the response is so chaotic that no tolerance suffices.
    chunks : mapping of str to int or "auto", optional
        For a lazy dataset; see `resonance_spectrum`.

    Returns
    -------
    xarray.Dataset
        Has the dimensions or scalar coordinates (record,) free_period, slenderness
        (, restitution and factor), and the variables rotation_ratio, peak_rotation,
        overturned, margin and impacts at the end of the input.

    Raises
    ------
    ValueError
        If an argument is out of range, or an integration did not finish.

    Examples
    --------
    >>> import jaxrock as jr
    >>> spectrum = jr.rocking_spectrum(jr.Sine(4.0, 0.5), [2.0, 4.0], slenderness=5.0)
    >>> print(spectrum.overturned.values)
    [1 0]
    """
    check("gravity", as_real("gravity", gravity), POSITIVE)
    check("inertia_ratio", as_real("inertia_ratio", inertia_ratio, unit=""), AT_LEAST_ONE)
    check_kind("motion", motion, Pulse, Harmonic, Record, Suite)
    records = [*motion] if isinstance(motion, Suite) else [motion]
    if any(map(_is_several, records)):
        raise ValueError(
            "motion must be a single motion, or a Suite of records, got an array of motions"
        )
    if (slenderness is None) == (critical_angle is None):
        given = "neither" if slenderness is None else "both"
        raise ValueError(f"either slenderness or critical_angle must be given, got {given}")
    # By the domain of the slenderness an angle beyond pi / 2 would only be called negative.
    if critical_angle is not None:
        as_real("critical_angle", critical_angle, unit="rad")  # raises for what is no number
        angle = np.asarray(critical_angle, float)
        check("critical_angle", angle, RIGHT_ANGLE)
        slenderness = 1 / np.tan(angle)
    if as_flag("one_sided", one_sided) and restitution is not None:
        restitution = take_magnitudes(restitution)
    values = {"free_period": free_period, "slenderness": slenderness}
    values |= {"restitution": restitution, "factor": factor}
    axes = {name: as_axis(name, given) for name, given in values.items() if given is not None}
    gravity = float(gravity)
    inertia_ratio = float(inertia_ratio)
    about: dict[str, str | float] = {
        "motion": records[0].name,
        "gravity": gravity,
        "inertia_ratio": inertia_ratio,
        **(describe_suite(motion) if isinstance(motion, Suite) else {}),
    }
    if one_sided:
        about["one_sided"] = 1
    problem = functools.partial(_make_blocks, (*axes,), gravity, inertia_ratio, one_sided)
    grid = _make_response_grid(
        "Rocking spectrum", axes, problem, motion, model, tolerance, about
    )
    dataset = grid.build_dataset(chunks)
    if isinstance(motion, Suite):
        return add_names(dataset, record=(motion.names, "ground motion"))
    return dataset


def _is_several(motion: Motion) -> bool:
    """Return whether a motion stands for an array of motions."""
    # Samples of a record have an axis of their own, along time; anything else with an axis
    # makes several motions.
    names = ("acceleration", "vertical")
    sample_ids = {id(getattr(motion, name, None)) for name in names}
    return any(np.ndim(leaf) > (id(leaf) in sample_ids) for leaf in jax.tree.leaves(motion))


def _make_blocks(
    names: Sequence[str],
    gravity: float,
    inertia_ratio: float,
    one_sided: bool,
    motion: Motion | Suite,
    *values: np.ndarray,
) -> tuple[Block, Reals, Motion | Suite]:
    """Make blocks, restitutions and motions at points of a rocking spectrum."""
    at = dict(zip(names, values, strict=True))
    # p^2 = g / (kappa R), with kappa = I / (m R^2).
    half_diagonal = 1 / inertia_ratio * gravity * (at["free_period"] / (2 * math.pi)) ** 2
    half_width = half_diagonal / np.sqrt(1 + at["slenderness"] ** 2)
    block = Block(half_width, at["slenderness"], gravity, inertia_ratio, one_sided=one_sided)
    c = at["restitution"] if "restitution" in at else apply_padded(estimate_restitution, block)
    # A suite wants a factor for each of its records, here the same for all.
    if "factor" in at:
        records = (len(motion),) if isinstance(motion, Suite) else ()
        motion = motion.scaled(np.broadcast_to(at["factor"], (*records, *at["factor"].shape)))
    return block, as_real("restitution", c, unit=""), motion


def overturning_spectrum(  # noqa: PLR0913
    shape: type[Pulse],
    frequency_ratio: Values,
    amplitude_ratio: Values,
    *,
    slenderness: float = 5.0,
    restitution: float | None = None,
    inertia_ratio: float = RECTANGLE_INERTIA_RATIO,
    one_sided: bool = False,
    model: ModelLike = Nonlinear(),
    tolerance: float | None = None,
    chunks: "Chunks | None" = None,
) -> "xarray.Dataset":
    """Compute which pulses of one shape overturn a block, over frequency and amplitude ratio.

    Parameters
    ----------
    shape : type
        `Rectangular`, `HalfSine`, `Sine`, `Cosine` or `Ricker`.
    frequency_ratio : array_like
        omega_p / p [-], a number or one-dimensional; see `Pulse.frequency`.
    amplitude_ratio : array_like
        a_p / (g tan(alpha_c)), or a_p / (g alpha_c) with `Linearized` [-], a number or
        one-dimensional. Above 1 a pulse lifts the block.
    slenderness, restitution, inertia_ratio : float
        lambda [-]; C [-], by default Housner's; and kappa [-], which affects only this
        default.
    one_sided : bool
        Whether the block stands against a wall, from which a positive acceleration pushes it
        away. C is then by default the magnitude of `one_sided_restitution`.
    model, tolerance, chunks
        As in `rocking_spectrum`.

    Returns
    -------
    xarray.Dataset
        Has frequency_ratio and amplitude_ratio as dimensions or scalar coordinates, and the
        variables of `rocking_spectrum`. It holds for every size of block.

    Raises
    ------
    ValueError
        If an argument is out of range, or an integration did not finish.

    Examples
    --------
    >>> import jaxrock as jr
    >>> spectrum = jr.overturning_spectrum(jr.Sine, [2.0, 4.0], [1.5, 6.0])
    >>> print(spectrum.overturned.values.tolist())
    [[1, 1], [0, 1]]
    """
    given = {"frequency_ratio": frequency_ratio, "amplitude_ratio": amplitude_ratio}
    axes = {name: as_axis(name, values) for name, values in given.items()}
    kind = check_pulse_class(shape)
    shared, uplift = make_unit_block(slenderness, restitution, inertia_ratio, one_sided, model)
    block, _ = shared
    scales = (uplift, float(block.frequency_parameter))
    about: dict[str, str | float] = {
        "motion": kind.name,
        "gravity": float(block.gravity),
        "inertia_ratio": inertia_ratio,
    }
    if one_sided:
        about["one_sided"] = 1
    problem = functools.partial(_make_pulses, kind, *scales)
    return _make_response_grid(
        "Overturning spectrum", axes, problem, shared, model, tolerance, about
    ).build_dataset(chunks)


def _make_pulses(
    kind: type[Pulse],
    uplift: float,
    rate: float,
    shared: tuple[Block, Reals],
    *ratios: np.ndarray,
) -> tuple[Block, Reals, Motion]:
    """Make the block, its restitution, and the pulses at points of an overturning spectrum."""
    frequency_ratio, amplitude_ratio = ratios
    return *shared, kind(amplitude_ratio * uplift, kind.angle / (frequency_ratio * rate))


def make_unit_block(
    slenderness: float,
    restitution: float | None,
    inertia_ratio: float,
    one_sided: bool,
    model: ModelLike,
) -> tuple[tuple[Block, Reals], float]:
    """Make a block of some size and its restitution, and the acceleration that just lifts it.

    Ratios to the scales of the block do not depend on its size, so that any size serves.
    """
    check_concrete((slenderness, restitution, inertia_ratio), "a spectrum is a dataset")
    block = Block(0.2, slenderness, inertia_ratio=inertia_ratio, one_sided=one_sided)
    c = float(estimate_restitution(block)) if restitution is None else restitution
    read_restitution(block, c)  # raises for what is not allowed
    magnitude = as_real("restitution", abs(c) if one_sided else c, unit="")
    return (block, magnitude), float(uplift_acceleration(block, as_model(model)))


def _make_response_grid(
    title: str,
    axes: Mapping[str, np.ndarray],
    problem: Callable[..., tuple[Block, Reals, Motion | Suite]],
    shared: PyTree,
    model: ModelLike,
    tolerance: float | None,
    about: Mapping[str, str | float],
) -> Grid:
    """Make the grid of responses; `problem` makes the blocks and motions at points of it.

    If the shared pytree is a suite, its records make an axis.
    """
    model = as_model(model)
    table = _VARIABLES
    attributes = {"model": model.name, **about, "gravity_units": "m s-2"}
    if tolerance is not None:
        check("tolerance", as_real("tolerance", tolerance), POSITIVE)
        attributes["tolerance"] = tolerance
        table = _VARIABLES | _ESTIMATES
    compute = functools.partial(_follow_part, problem, model, tolerance, (*table,), (*axes,))
    if isinstance(shared, Suite):
        axes = {"record": np.arange(len(shared)), **axes}
        compute = functools.partial(_simulate_some_records, compute)
    variables = {
        name: GridVariable(tuple(axes), dtype, {"long_name": long_name, "units": units})
        for name, (dtype, long_name, units) in table.items()
    }
    return Grid(
        title,
        axes,
        variables,
        attributes,
        compute,
        _LARGEST,
        shared=shared,
    )


def _simulate_some_records(
    compute: Callable[..., dict[str, np.ndarray]],
    suite: Suite,
    records: np.ndarray,
    *parts: np.ndarray,
) -> dict[str, np.ndarray]:
    """Simulate blocks over a part of a grid whose first axis are records, by their numbers."""
    # A chunk has neighbouring records, of some perhaps one direction only. A slice of a suite
    # in both directions would refuse that: hence a plain suite.
    part = slice(records[0], records[-1] + 1)
    return compute(Suite(suite.records[part], suite.names[part]), *parts)


def _follow_part(
    problem: Callable[..., tuple[Block, Reals, Motion | Suite]],
    model: RockingModel,
    tolerance: float | None,
    names: Sequence[str],
    axes: Sequence[str],
    shared: PyTree,
    *parts: np.ndarray,
) -> dict[str, np.ndarray]:
    """Simulate blocks over a part of a grid, the values along whose axes are the parts."""
    shape, points = list_points(*parts)
    labels: dict[str, np.ndarray | Sequence[str]] = dict(
        zip(axes, map(np.atleast_1d, parts), strict=True)
    )
    if isinstance(shared, Suite):
        shape = (len(shared), *shape)
        labels = {"record": shared.names, **labels}
    batch = Batch.of(*problem(shared, *points))
    if tolerance is None:
        response = estimate = follow_batch(batch, model)
    else:
        estimate = follow_within(batch, tolerance, model)
        response = estimate.response
    complete = np.reshape(response.complete, [len(values) for values in labels.values()])
    require_complete(complete, **labels)
    # One value for blocks of one shape, else one for each point.
    angles = apply_padded(lambda block: block.critical_angle, batch.block)
    ratio = np.asarray(response.peak_rotation) / angles
    # The estimate has what it says of itself, and the response within it all else.
    values = {"rotation_ratio": ratio, **vars(estimate), **vars(response)}
    return {name: np.asarray(values[name]).reshape(shape) for name in names}
