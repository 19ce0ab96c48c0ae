"""Scattered inputs on the host: Sobol points as parameters, blocks and restitutions."""

import inspect
from collections.abc import Iterable, Mapping
from typing import Any

import jax
import numpy as np
from scipy.special import ndtri

from ..block import Block
from ..validation import NON_NEGATIVE, Number, check, check_kind
from .parameters import Spread, choose_sides, find_widths, quantiles

_BITS = 30  # of a Sobol point, the default of SciPy


def draw_normal_numbers(dimensions: int, samples: int, seed: int) -> np.ndarray:
    """Draw standard normal numbers, shape (samples, dimensions), by scrambled Sobol points.

    Raises
    ------
    ValueError
        If the number of samples is not a power of 2.
    """
    from scipy.stats import qmc  # which loads slowly

    # The points are balanced in powers of 2 only, and their errors of order 1 / n there.
    if not isinstance(samples, int) or samples < 1 or samples & (samples - 1):
        raise ValueError(f"samples must be a power of 2, got {samples!r:.60}")
    if not dimensions:
        return np.empty((samples, 0))
    # SciPy has renamed the argument in version 1.15, and will warn of the old name.
    name = "rng" if "rng" in inspect.signature(qmc.Sobol).parameters else "seed"
    options: dict[str, Any] = {name: seed}
    engine = qmc.Sobol(dimensions, scramble=True, bits=_BITS, **options)
    points = engine.random_base2(samples.bit_length() - 1)
    # A point stands for its cell: at the middle of it no point is 0, whose normal number would
    # be infinite.
    return ndtri(points + 0.5 ** (_BITS + 1))


def draw_parameters(
    medians: Mapping[str, float], variations: Spread, samples: int, seed: int
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Draw independent parameters by scrambled Sobol points, in NumPy.

    Parameters
    ----------
    medians : mapping
        By name, those without scatter as well.
    variations : mapping
        Coefficients of variation by name, of distributions as in `propagate`.
    samples, seed : int
        Number of samples, a power of 2, and the seed of the scrambling.

    Returns
    -------
    values, z : dict of ndarray, shape (samples,), and ndarray, shape (samples, varied)
        All parameters by name, and the standard normal numbers of those that vary.

    Raises
    ------
    ValueError
        If a name is not among the medians, or a coefficient is not allowed.
    """
    z = draw_normal_numbers(len(variations), samples, seed)
    return map_normal_numbers(z, medians, variations), z


def map_normal_numbers(
    z: np.ndarray,
    medians: Mapping[str, float],
    variations: Spread,
    argument: str = "variations",
) -> dict[str, np.ndarray]:
    """Map standard normal numbers, a column each varied parameter, to all parameters."""
    for name in variations:
        if name not in medians:
            raise ValueError(f"{argument} has {name!r}, which is none of {', '.join(medians)}")
    wanted = np.asarray(list(variations.values()), float)
    check(argument, wanted, NON_NEGATIVE)
    median = np.array([medians[name] for name in variations], float)
    drawn = np.asarray(quantiles(z, median, *find_widths(variations, median, wanted)))
    varied = dict(zip(variations, drawn.T, strict=True))
    constant = {name: np.full(len(z), float(value)) for name, value in medians.items()}
    return {**constant, **varied}


def list_medians(
    block: Block, restitution: Number, names: Iterable[str], argument: str
) -> dict[str, float]:
    """List the parameters of a block and its restitution, by sides where the names say so."""
    check_kind("block", block, Block)
    for leaf in jax.tree.leaves((block, restitution)):
        if np.ndim(leaf):
            raise ValueError("block and restitution must be single ones, got arrays of them")
    size = {"half_width": block.half_width, "slenderness": block.slenderness}
    if choose_sides(names, argument):
        width = 2 * float(block.half_width)
        size = {"width": width, "height": width * float(block.slenderness)}
    rest = {"gravity": block.gravity, "inertia_ratio": block.inertia_ratio}
    every = {**size, **rest, "restitution": restitution}
    return {name: float(value) for name, value in every.items()}


def make_blocks(values: Mapping[str, np.ndarray]) -> Block:
    """Make blocks of parameters that were drawn.

    Raises
    ------
    ValueError
        If an inertia ratio is below 1, which no body has.
    """
    ratio = values["inertia_ratio"]
    if (ratio < 1).any():
        raise ValueError(
            "variations must leave inertia_ratio at 1 or more, got samples down to"
            f" {ratio.min():.3g}"
        )
    if "width" in values:
        half_width = values["width"] / 2
        slenderness = values["height"] / values["width"]
    else:
        half_width = values["half_width"]
        slenderness = values["slenderness"]
    return Block(half_width, slenderness, values["gravity"], ratio)


def draw_blocks(
    block: Block,
    restitution: Number,
    variations: Spread,
    samples: int,
    seed: int,
    argument: str = "variations",
) -> tuple[Block, np.ndarray, np.ndarray]:
    """Draw blocks and restitutions around one block, as `draw_parameters` draws.

    Parameters
    ----------
    block, restitution : Block, float
        The medians.
    variations : mapping
        Coefficients of variation of ``width`` (at this height) and ``height`` (at this width),
        or of ``half_width`` (at this slenderness) and ``slenderness``; of ``gravity``,
        ``inertia_ratio`` and ``restitution``.
    samples, seed : int
        As in `draw_parameters`.
    argument : str
        The name of the variations, for messages.

    Returns
    -------
    blocks, restitutions, z : Block of arrays, ndarray, shape (samples,), and as above

    Raises
    ------
    ValueError
        As `draw_parameters`; also if block or restitution are arrays, if both descriptions of
        a size are mixed, or if an inertia ratio falls below 1.
    """
    medians = list_medians(block, restitution, variations, argument)
    z = draw_normal_numbers(len(variations), samples, seed)
    values = map_normal_numbers(z, medians, variations, argument)
    return make_blocks(values), values["restitution"], z
