"""What it costs a train of pulses not to come right after the impacts."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..host import with_clock
from ..validation import UNIT_INTERVAL, Number, as_real, check, of_one_precision
from .free_rocking import Linearized, ModelLike, as_model
from .pulse_train import Rocker, follow
from .timed_train import Train, shot

_LATE = (0.05, 0.1, 0.2)  # half-cycles
_ROUNDS = 200  # of corrections
_STEP = 0.005  # relative, of spacings and strengths
_TOGETHER = 1024  # trains


@with_clock("timing costs")
def timing_costs(
    block: Block, restitution: Number, count: int, model: ModelLike = Linearized()
) -> dict[str, float]:
    """Largest pulse with which differently timed trains of equal pulses overturn a block.

    Parameters
    ----------
    block, restitution : Block, float
        One block and its C [-], between 0 and 1.
    count : int
        Number of pulses, at least 2.
    model : Linearized or Nonlinear
        Equation of the motion between the pulses.

    Returns
    -------
    dict
        Intensities [m/s] of pulses that come right after the impacts, right before them,
        some parts of a half-cycle after them, and alternating at the best of equal spacings
        (to 0.5 %, as the spacing may be off by as much); none needs to be larger than the
        one that overturns alone. NaN where the search for it did not converge.

    Raises
    ------
    ValueError
        If `restitution` is not between 0 and 1, or `count` less than 2.

    Examples
    --------
    >>> import jaxrock as jr
    >>> for timing, intensity in jr.resonance.timing_costs(jr.Block(0.4, 5.0), 0.7, 3).items():
    ...     print(f"{intensity:.3f} m/s {timing}")
    0.475 m/s right after the impacts
    0.619 m/s right before the impacts
    0.495 m/s 0.05 half-cycles after the impacts
    0.517 m/s 0.1 half-cycles after the impacts
    0.568 m/s 0.2 half-cycles after the impacts
    0.577 m/s at the best of equal spacings
    """
    restitution = as_real("restitution", restitution)
    check("restitution", restitution, UNIT_INTERVAL)
    block.check()
    if count < 2:
        raise ValueError(f"count must be at least 2, got {count}")
    block, restitution = of_one_precision((block, restitution))
    dtype = restitution.dtype
    rocker = Rocker(block, restitution, as_model(model))
    unit = float(rocker.unit)
    ones, first = jnp.ones(count, dtype), jnp.arange(count) == 0
    after = Train(jnp.zeros(count, dtype), ones, jnp.ones(count, int))
    # The second pulse comes before the first impact, each further one before the next.
    skips = jnp.where(jnp.arange(count) > 1, 1, 0)
    before = Train(ones, jnp.where(first, 1.0, -1.0).astype(dtype), skips)
    costs = {
        "right after the impacts": _needed(rocker, after, None),
        "right before the impacts": _needed(rocker, before, None),
    }
    for late in _LATE:
        costs[f"{late:g} half-cycles after the impacts"] = _needed(rocker, after, late)
    costs = {timing: strength * unit for timing, strength in costs.items()}
    costs["at the best of equal spacings"] = unit * _equally_spaced(
        rocker, count, costs["right after the impacts"] / unit
    )
    return costs


@jax.jit
def _one(rocker: Rocker, train: Train, strength: jax.Array) -> tuple[jax.Array, jax.Array]:
    outcome = shot(rocker, train, strength, timed=True)
    return outcome.x, outcome.delays


def _needed(rocker: Rocker, train: Train, late: float | None) -> float:
    """The strength with which a train just overturns, its pulses so late; at most 1.

    Both adjusted in proportion, which is nearly how they act. NaN if that does not converge.
    """
    near = float(jnp.finfo(rocker.restitution.dtype).eps) ** 0.75
    strength = 1 / train.weight.size * jnp.ones_like(rocker.restitution)
    # Of the velocity at the launch, so much is lost: in weak motion this is the time.
    lost = jnp.full_like(train.phase, late or 0.0)
    for _ in range(_ROUNDS):
        if late is not None:
            train = train._replace(phase=jnp.arccos(1 - 2 * jnp.minimum(lost, 0.5)) / jnp.pi)
        x, found = _one(rocker, train, strength)
        if not x > 0:
            return 1.0  # impacts leave nothing: only a pulse alone overturns
        strength = strength / x
        change = abs(float(x) - 1)
        if late is not None:
            factor = late / jnp.where(found > 0, found, late)
            lost = lost * factor
            change += float(abs(factor - 1).max())
        if change < near:
            return min(float(strength), 1.0)
    return math.nan


def _equally_spaced(rocker: Rocker, count: int, least: float) -> float:
    """The smallest strength of alternating pulses that overturns at some equal spacing.

    NaN if that is not where it was looked for.
    """
    if math.isnan(least):
        return math.nan
    rate = float(rocker.block.frequency_parameter)
    simple = rocker._replace(model=Linearized())
    spacing, strength = _lowest(simple, count, (0.05 / rate, 4 / rate), (least, 1.0))
    if rocker.model != simple.model and spacing > 0:
        # What is alike in both is only looked for in the cheap one.
        around = (0.95 * spacing, 1.05 * spacing)
        least, most = max(least, 0.95 * strength), min(1.1 * strength, 1.0)
        spacing, strength = _lowest(rocker, count, around, (least, most))
        # At an end of the range it is not known whether it is the best, or that there is none.
        if (spacing == 0 and most < 1) or spacing in around or strength <= least * (1 + 1e-9):
            return math.nan
    return strength


@eqx.filter_jit
def _overturn(rocker: Rocker, count: int, spacings: jax.Array, strengths: jax.Array) -> jax.Array:
    """Which of many trains of alternating pulses, equally spaced, overturn the block."""
    dtype = rocker.restitution.dtype
    signs = jnp.where(jnp.arange(count) % 2 == 0, 1.0, -1.0).astype(dtype)

    def one(spacing: jax.Array, strength: jax.Array) -> jax.Array:
        times = spacing * jnp.arange(count, dtype=dtype)
        return follow(rocker, times, strength * rocker.unit * signs).overturned

    return jax.vmap(one)(spacings, strengths)


def _lowest(
    rocker: Rocker, count: int, spacings: tuple[float, float], strengths: tuple[float, float]
) -> tuple[float, float]:
    """In ranges, the spacing that overturns with the smallest strength, and that; or 0 and 1.

    Only what overturns with spacings that are a step longer and shorter, too, counts: that
    may be narrow wedges over the spacings, whose very tips nobody hits.
    """
    spacing, strength = (
        np.geomspace(low, high, 1 + round(np.log(high / low) / _STEP))
        for low, high in (spacings, strengths)
    )
    # From the weakest on, so many at once.
    some = max(1, _TOGETHER // spacing.size)
    for start in range(0, strength.size, some):
        now = strength[start : start + some]
        now = np.pad(now, (0, some - now.size), mode="edge")
        grid = np.meshgrid(now, spacing, indexing="ij")
        dtype = rocker.restitution.dtype
        each, every = (jnp.asarray(part.reshape(-1), dtype) for part in grid)
        falls = np.asarray(_overturn(rocker, count, every, each)).reshape(grid[0].shape)
        falls = falls[:, :-2] & falls[:, 1:-1] & falls[:, 2:]
        if falls.any():
            k = int(falls.any(axis=1).argmax())
            return float(spacing[1 + falls[k].argmax()]), float(now[k])
    return 0.0, 1.0
