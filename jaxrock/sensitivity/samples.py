"""Samples of uncertain parameters: from Sobol points to standard normal numbers to blocks."""

import inspect
from collections.abc import Iterable, Mapping
from typing import Any

import jax
import numpy as np
from scipy.special import ndtri

from ..block import SIZE_NAMES, Block, block_of, size_of
from ..impact import read_restitution
from ..validation import Number, check_kind
from .distributions import find_widths, quantiles
from .parameters import choose_description, refuse_name

ARGUMENT = "coefficients_of_variation"  # of `Uncertain`, for messages
_BITS = 30  # of a Sobol point, the default of SciPy


def list_medians(
    block: Block, restitution: Number, names: Iterable[str]
) -> dict[str, np.ndarray]:
    """List the parameters of blocks and their restitutions, with the size that is named.

    In NumPy and float64, of shapes that broadcast.
    """
    check_kind("block", block, Block)
    restitution = read_restitution(block, restitution)
    by = choose_description(names, ARGUMENT)
    host, coefficient = jax.tree.map(
        lambda leaf: np.asarray(leaf, float), (block, restitution)
    )
    parameters = {**size_of(host, by), "restitution": coefficient}
    return {name: np.asarray(value) for name, value in parameters.items()}


def draw_normal_numbers(dimensions: int, samples: int, seed: int) -> np.ndarray:
    """Draw standard normal numbers, shape (samples, dimensions), by scrambled Sobol points.

    The number of samples is a power of 2.
    """
    from scipy.stats import qmc  # which loads slowly

    if not dimensions:
        return np.empty((samples, 0))
    # SciPy has renamed the argument in version 1.15, and will warn of the old name. From an integer
    # the older one would draw other points.
    name = "rng" if "rng" in inspect.signature(qmc.Sobol).parameters else "seed"
    options: dict[str, Any] = {name: np.random.default_rng(seed)}
    engine = qmc.Sobol(dimensions, scramble=True, bits=_BITS, **options)
    points = engine.random_base2(samples.bit_length() - 1)
    # A point stands for its cell: at the middle of it no point is 0, whose normal number would
    # be infinite.
    return ndtri(points + 0.5 ** (_BITS + 1))


def map_normal_numbers(
    normal: np.ndarray, medians: Mapping[str, float], coefficients: Mapping[str, float]
) -> dict[str, np.ndarray]:
    """Map standard normal numbers, a column for each uncertain parameter, to all parameters.

    Parameters
    ----------
    normal : ndarray, shape (samples, uncertain)
    medians : mapping
        Of all parameters, by name.
    coefficients : mapping
        Coefficients of variation of the uncertain ones.

    Returns
    -------
    dict of ndarray, shape (samples,)
        All parameters by name; those without uncertainty are constant.
    """
    for name in coefficients:
        if name not in medians:
            sizes = [size for names in SIZE_NAMES.values() for size in names]
            refuse_name(name, (*medians, *sizes), ARGUMENT)
    median = np.array([medians[name] for name in coefficients], float)
    width, bounded = find_widths(coefficients, median, np.array(list(coefficients.values())))
    samples = np.asarray(quantiles(normal, median, width, bounded))
    uncertain = dict(zip(coefficients, samples.T, strict=True))
    constant = {name: np.full(len(normal), float(value)) for name, value in medians.items()}
    return {**constant, **uncertain}


def make_drawn_blocks(samples: Mapping[str, np.ndarray], one_sided: bool) -> Block:
    """Make blocks of parameters that were drawn.

    Raises
    ------
    ValueError
        If an inertia ratio is below 1, or a critical angle not below pi / 2: no body has them.
    """
    ratio = samples["inertia_ratio"]
    if (ratio < 1).any():
        raise ValueError(
            f"{ARGUMENT} must leave inertia_ratio at 1 or more, got samples down to"
            f" {ratio.min():.3g}"
        )
    if "critical_angle" in samples:
        refuse_wide_angles("critical_angle", samples["critical_angle"])
    return block_of(samples, one_sided)


def refuse_wide_angles(name: str, angles: np.ndarray) -> None:
    """Raise `ValueError` if drawn critical angles reach pi / 2."""
    if (angles >= 0.5 * np.pi).any():
        raise ValueError(
            f"{ARGUMENT} must leave {name} below pi / 2, got samples up to {angles.max():.3g}"
        )
