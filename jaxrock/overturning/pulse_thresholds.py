"""Inverse design in driven motion: strengths and durations of a motion that just overturn."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..driven import require_complete, uplift_acceleration
from ..ground_motion import Motion, Pulse, check_pulse_class
from ..host import Printed, format_number
from ..resonance import ModelLike, Nonlinear, as_model
from ..validation import Number, Numbers, as_real, check_concrete, check_kind, choose_namespace
from .boundaries import Boundaries, overturning_boundaries, search_boundaries
from .quantities import Search

# The first values are 2**6 = 64 times as far apart as the resolution demands. Only intervals
# in which a window might hide are halved down to it, a small part of the range.
_HALVINGS = 6


@dataclass(frozen=True, repr=False)
class SurvivalWindows(Printed):
    """Windows in which a block stands, above the first strength of a motion that overturns it.

    Attributes
    ----------
    first_overturning : float
        Smallest factor that overturns the block; the first of the range if that one does; inf
        if none does.
    windows : ndarray, shape (windows, 2)
        Factors above `first_overturning` between which the block stands; inf where the range
        ends before the window does.
    """

    first_overturning: float
    windows: np.ndarray

    def __str__(self) -> str:
        if np.isinf(self.first_overturning):
            return "stands everywhere in the range"
        lines = [f"overturns from {format_number(self.first_overturning)} on"]
        for low, high in self.windows:
            end = "to the end of the range" if np.isinf(high) else f"to {high:.6g}"
            lines.append(f"stands again from {low:.6g} {end}")
        return "\n".join(lines)


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
    search = Search("amplitude", model, max_boundaries, _HALVINGS)
    return _search_amplitudes(ratios, block, restitution, shape, duration, resolution, search)


def _search_amplitudes(
    ratios: Sequence[float],
    block: Block,
    restitution: Number,
    shape: type[Pulse],
    duration: Number,
    resolution: float,
    search: Search,
) -> Boundaries:
    """Search critical amplitudes, as `critical_amplitude` does, by a search of any kind."""
    pulse = check_pulse_class(shape)(1.0, duration)
    levels = make_levels("ratios", ratios, resolution)
    check_kind("block", block, Block)
    # The range follows the block, but a boundary does not depend on where it was sought: the
    # implicit function theorem takes no derivative with respect to these values.
    uplift = jax.lax.stop_gradient(
        jnp.asarray(uplift_acceleration(block, as_model(search.model)))
    )
    namespace = choose_namespace(uplift)
    amplitudes = namespace.asarray(uplift)[..., None] * levels.astype(uplift.dtype)
    return search_boundaries(block, restitution, pulse, amplitudes, search)


def check_range(ratios: Sequence[float], resolution: float) -> None:
    """Raise `ValueError` if a search between these ratios to a resolution is not allowed."""
    make_levels("ratios", ratios, resolution)


def search_amplitudes_alone(
    block: Block,
    restitution: Number,
    shape: type[Pulse],
    duration: Number,
    ratios: Sequence[float],
    resolution: float,
    model: ModelLike,
) -> Boundaries:
    """Search critical amplitudes; the bits for each duration do not depend on the others.

    So a map that is computed in parts is the same map.
    """
    search = Search("amplitude", model, 1, _HALVINGS, alone=True)
    return _search_amplitudes(ratios, block, restitution, shape, duration, resolution, search)


def critical_duration(
    block: Block,
    restitution: Number,
    shape: type[Pulse],
    amplitude: Number,
    durations: Sequence[float],
    *,
    resolution: float = 0.01,
    model: ModelLike = Nonlinear(),
    max_boundaries: int = 8,
) -> Boundaries:
    """Find every duration of a given pulse that separates standing from overturning.

    Parameters
    ----------
    block, restitution, shape, resolution, model, max_boundaries
        As in `critical_amplitude`.
    amplitude : array_like
        Amplitude of the pulse [m/s2].
    durations : sequence of two floats
        The range [s].

    Returns
    -------
    Boundaries
        Of durations [s].

    Raises
    ------
    ValueError
        If `shape` is no class of pulses, or a concrete argument is out of range.

    Examples
    --------
    >>> import jaxrock as jr
    >>> print(jr.critical_duration(jr.Block(0.1, 5.0), 0.9, jr.HalfSine, 4.0, (0.01, 1.0)))
    overturns beyond 0.333271 s (overturning without an impact)
    """
    levels = make_levels("durations", durations, resolution)
    pulse = check_pulse_class(shape)(amplitude, 1.0)
    search = Search("duration", model, max_boundaries, _HALVINGS)
    return search_boundaries(block, restitution, pulse, levels, search)


def make_levels(
    name: str, ends: Sequence[float], resolution: float, halvings: int = _HALVINGS
) -> np.ndarray:
    """Make values between two ends, so close that halvings bring them to the resolution."""
    if len(ends) != 2 or not 0 < ends[0] < ends[1] < math.inf:
        raise ValueError(f"{name} must be two increasing positive numbers, got {ends}")
    low, high = ends
    if not 1e-6 < resolution < 1:
        raise ValueError(f"resolution must be between 1e-6 and 1, got {resolution:g}")
    # The resolution is a share of the value, so that values make a geometric sequence.
    ratio = 1 + resolution * 2**halvings
    return np.geomspace(low, high, math.ceil(math.log(high / low) / math.log(ratio)) + 1)


def survival_windows(
    block: Block,
    restitution: Number,
    motion: Motion,
    factors: Numbers,
    *,
    model: ModelLike = Nonlinear(),
) -> SurvivalWindows:
    """Find the windows in which one block survives, above the first factor that overturns it.

    They are pairs of boundaries of `overturning_boundaries` along the factor on a motion.

    Parameters
    ----------
    block, restitution, motion, model
        One block; otherwise as in `overturning_boundaries`.
    factors : array_like, shape (n,)
        Increasing factors on the motion. A window between two of them is not detected.

    Returns
    -------
    SurvivalWindows

    Raises
    ------
    ValueError
        If an argument is not allowed, or an integration did not finish.

    Examples
    --------
    >>> import jaxrock as jr
    >>> block, pulse = jr.Block(half_width=0.1, slenderness=5.0), jr.Sine(1.0, 0.5)
    >>> found = jr.survival_windows(block, 0.9, pulse, [2.0, 5.0, 7.9, 9.0])
    >>> print(f"{found.first_overturning:.3f}", found.windows.round(3))
    2.928 [[7.706 8.085]]
    """
    check_concrete(
        (block, restitution, motion, factors),
        "the number of windows depends on the answers; overturning_boundaries works under jit",
    )
    boundaries = overturning_boundaries(
        block, restitution, motion, "factor", factors, model=model
    )
    if boundaries.count.ndim:
        raise ValueError(
            f"one block at a time here, got an array of shape {boundaries.count.shape}"
        )
    low, high = np.asarray(factors)[[0, -1]]
    require_complete(boundaries.complete, factor=f"between {low:g} and {high:g}")
    edges = np.asarray(boundaries.value)
    if boundaries.overturns_first:
        edges = np.append(as_real("factors", factors)[0], edges)
    # From the first overturning on, edges alternate. An even number means that the block
    # stands at the end of the range, or that it never overturns: the window, if any, is open.
    if edges.size % 2 == 0:
        edges = np.append(edges, np.inf)
    return SurvivalWindows(float(edges[0]), edges[1:].reshape(-1, 2))
