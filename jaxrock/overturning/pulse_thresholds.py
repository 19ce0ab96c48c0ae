"""Inverse design in driven motion: amplitudes of a pulse that just overturn."""

import math
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..driven import uplift_acceleration
from ..ground_motion import Pulse, check_pulse_class
from ..resonance import ModelLike, Nonlinear, as_model
from ..validation import Number, check_kind, choose_namespace
from .boundaries import Boundaries, search_boundaries
from .quantities import Search

# The first values are 2**6 = 64 times as far apart as the resolution. Only intervals in which
# a window might hide, a small part of the range, are halved down to it.
_HALVINGS = 6


def critical_amplitude(
    block: Block,
    restitution: Number,
    shape: type[Pulse],
    duration: Number,
    ratios: Sequence[float] = (1.0, 10.0),
    *,
    resolution: float = 0.01,
    model: ModelLike = Nonlinear(),
    max_boundaries: int = 8,
) -> Boundaries:
    """Find every amplitude of a pulse that separates standing from overturning.

    Among them are the first overturning, the ends of windows in which the block survives, and
    the first overturning without an impact.

    Parameters
    ----------
    block, restitution, model, max_boundaries
        As in `overturning_boundaries`.
    shape : type
        `Rectangular`, `HalfSine`, `Sine`, `Cosine` or `Ricker`.
    duration : array_like
        Duration of the pulse [s], greater than 0; of a `Ricker` its period.
    ratios : sequence of two floats
        The range of amplitudes, as multiples of the amplitude that just lifts the block:
        g tan(alpha_c),
        or g alpha_c with `Linearized`.
    resolution : float
        Windows wider than this fraction of their amplitude are detected; where a block
        bounces often, a few may be missed (1 of 46,163 in trials).

    Returns
    -------
    Boundaries
        Of amplitudes [m/s2].

    Raises
    ------
    ValueError
        If `shape` is no class of pulses, or a concrete argument is out of range.

    Examples
    --------
    >>> import jaxrock as jr
    >>> print(jr.critical_amplitude(jr.Block(0.1, 5.0), 0.9, jr.Sine, 0.5))
    overturns beyond 2.92824 m/s2 (0.298 g) (overturning after 1 impact)
    stands beyond 7.706 m/s2 (0.786 g) (overturning after 1 impact)
    overturns beyond 8.08528 m/s2 (0.824 g) (overturning without an impact)
    """
    pulse = check_pulse_class(shape)(1.0, duration)
    levels = make_ratios(ratios, resolution)
    check_kind("block", block, Block)
    # The range follows the block, but a boundary does not depend on where it was sought: the
    # implicit function theorem takes no derivative with respect to these values.
    uplift = jax.lax.stop_gradient(jnp.asarray(uplift_acceleration(block, as_model(model))))
    amplitudes = choose_namespace(uplift).asarray(uplift)[..., None] * levels.astype(
        uplift.dtype
    )
    search = Search("amplitude", model, max_boundaries, _HALVINGS)
    return search_boundaries(block, restitution, pulse, amplitudes, search)


def make_ratios(ratios: Sequence[float], resolution: float) -> np.ndarray:
    """Make ratios in a range, so close that halvings bring them to the resolution."""
    if len(ratios) != 2 or not 0 < ratios[0] < ratios[1] < math.inf:
        raise ValueError(f"ratios must be two increasing positive numbers, got {ratios}")
    if not 1e-6 < resolution < 1:
        raise ValueError(f"resolution must be between 1e-6 and 1, got {resolution:g}")
    # The resolution is relative, so that values make a geometric sequence.
    low, high = ratios
    steps = math.log(high / low) / math.log(1 + resolution * 2**_HALVINGS)
    return np.geomspace(low, high, math.ceil(steps) + 1)
