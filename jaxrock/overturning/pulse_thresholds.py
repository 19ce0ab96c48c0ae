"""Inverse design in driven motion: the strength and length of a motion that overturn."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.core
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..dynamics import uplift_acceleration
from ..ground_motion import Motion, Pulse, pulse_class
from ..host import shown
from ..resonance import ModelLike, Nonlinear, as_model
from ..validation import Number, Numbers, as_real
from .boundaries import Boundaries, overturning_boundaries

_HALVINGS = 4  # from first steps of 16 times the resolution


class SurvivalWindows(NamedTuple):
    """Where a block stands and where it overturns, over the strength of a motion.

    Attributes
    ----------
    first_overturning : float
        Smallest factor in the range that overturns the block, which is the first one of it
        if that does; inf if none does.
    windows : ndarray, shape (windows, 2)
        Factors between which it stands again, above that; inf where the range ends before
        the window does.
    """

    first_overturning: float
    windows: np.ndarray

    def __str__(self) -> str:
        if np.isinf(self.first_overturning):
            return "stands everywhere in the range"
        lines = [f"overturns from {shown(self.first_overturning)} on"]
        lines += [f"stands again from {low:.6g} to {high:.6g}" for low, high in self.windows]
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
    """Every amplitude of a pulse between standing and overturning.

    First overturning, windows in which the block survives, overturning without an impact;
    see `overturning_boundaries`.

    Parameters
    ----------
    block : Block
    restitution : array_like
        C, velocity after an impact over velocity before it [-], between 0 and 1.
    shape : type
        `Rectangular`, `HalfSine`, `Sine`, `Cosine` or `Ricker`.
    duration : array_like
        Duration of the pulse [s], greater than 0.
    ratios : sequence of two floats
        The range of amplitudes, over the one that just lifts the block: that is g
        tan(alpha_c), linearized g alpha_c.
    resolution : float
        Windows wider than this share of their amplitude are found, and where a block bounces
        often nearly all (in trials 46,162 of 46,163).
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.
    max_boundaries : int
        How many boundaries are listed under a transformation.

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
    overturns beyond 2.92824 (overturning after 1 impact)
    stands beyond 7.706 (overturning after 1 impact)
    overturns beyond 8.08528 (overturning without an impact)
    """
    pulse = pulse_class(shape)(1.0, duration)
    places = _places("ratios", ratios, resolution)
    if not isinstance(block, Block):
        raise ValueError(f"block must be a Block, got {block!r:.60}")
    block.check()
    lifting = jax.lax.stop_gradient(jnp.asarray(uplift_acceleration(block, as_model(model))))
    library: Any = jnp if isinstance(lifting, jax.core.Tracer) else np
    shape_of_all = (*lifting.shape, places.size)
    lifting = library.broadcast_to(library.asarray(lifting)[..., None], shape_of_all)
    values = lifting * library.broadcast_to(places.astype(lifting.dtype), shape_of_all)
    return overturning_boundaries(
        block,
        restitution,
        pulse,
        "amplitude",
        values,
        halvings=_HALVINGS,
        model=model,
        max_boundaries=max_boundaries,
    )


def critical_duration(
    block: Block,
    restitution: Number,
    pulse: Pulse,
    durations: Sequence[float],
    *,
    resolution: float = 0.01,
    model: ModelLike = Nonlinear(),
    max_boundaries: int = 8,
) -> Boundaries:
    """Every duration of a pulse of given amplitude between standing and overturning.

    Parameters
    ----------
    block : Block
    restitution : array_like
        C, velocity after an impact over velocity before it [-], between 0 and 1.
    pulse : Pulse
        Its duration does not matter.
    durations : sequence of two floats
        The range [s].
    resolution : float
        Windows wider than this share of their duration are found; see `critical_amplitude`.
    model, max_boundaries
        As there.

    Returns
    -------
    Boundaries
        Of durations [s].

    Raises
    ------
    ValueError
        If `pulse` is a record, or a concrete argument is out of range.

    Examples
    --------
    >>> import jaxrock as jr
    >>> print(jr.critical_duration(jr.Block(0.1, 5.0), 0.9, jr.HalfSine(4.0, 1.0), (0.01, 1.0)))
    overturns beyond 0.333271 (overturning without an impact)
    """
    if not isinstance(pulse, Pulse):
        raise ValueError(f"pulse must be a Pulse, got {type(pulse).__name__}")
    places = _places("durations", durations, resolution)
    return overturning_boundaries(
        block,
        restitution,
        pulse,
        "duration",
        places,
        halvings=_HALVINGS,
        model=model,
        max_boundaries=max_boundaries,
    )


def survival_windows(
    block: Block,
    restitution: Number,
    motion: Motion,
    factors: Numbers,
    *,
    model: ModelLike = Nonlinear(),
) -> SurvivalWindows:
    """Windows above the first overturning strength in which one block survives.

    `overturning_boundaries` along the factor on a motion, in pairs.

    Parameters
    ----------
    block, restitution : Block, float
        One block and its C [-], between 0 and 1.
    motion : Motion
        A pulse or a `Record`.
    factors : array_like, shape (n,)
        Increasing factors on the motion to try. A window between two of them goes unseen.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.

    Returns
    -------
    SurvivalWindows

    Raises
    ------
    ValueError
        If an argument is outside of what is allowed, or a motion could not be followed.
    """
    found = overturning_boundaries(block, restitution, motion, "factor", factors, model=model)
    if found.count.ndim:
        raise ValueError(f"one block at a time here, got an array of shape {found.count.shape}")
    if not bool(found.complete):
        raise ValueError("motion could not be followed to its end for every factor")
    edges = np.asarray(found.value)
    if found.overturns_first:
        edges = np.append(as_real("factors", factors)[0], edges)
    if edges.size == 0:
        return SurvivalWindows(np.inf, np.empty((0, 2)))
    rest = edges[1:]
    if rest.size % 2:
        rest = np.append(rest, np.inf)
    return SurvivalWindows(float(edges[0]), rest.reshape(-1, 2))


def _places(name: str, between: Sequence[float], resolution: float) -> np.ndarray:
    """So many places between two that, halved, none is further from the next than asked."""
    low, high = between
    if not 0 < low < high < math.inf:
        raise ValueError(f"{name} must be two increasing positive numbers, got {between}")
    if not 1e-6 < resolution < 1:
        raise ValueError(f"resolution must be between 1e-6 and 1, got {resolution:g}")
    ratio = 1 + resolution * 2**_HALVINGS
    return np.geomspace(low, high, math.ceil(math.log(high / low) / math.log(ratio)) + 1)
