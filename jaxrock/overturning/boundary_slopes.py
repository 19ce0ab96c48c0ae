"""Derivatives of boundaries, by the implicit function theorem."""

import functools
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..dynamics import TOPPLED_ROTATION, DrivenScene, compiler_options
from ..ground_motion import Harmonic, Pulse
from .quantities import Search, is_traced, respond_at, scene_at, split


def moved(scene: DrivenScene, changes: Any, values: Any, found: Any, search: Search) -> Any:
    """How far the boundaries move when the numbers of the scene change.

    Elementwise in all numbers that are perturbed; 0 where there is no boundary.
    """
    traced = is_traced(found)
    library: Any = jnp if traced else np
    # Padded to a power of two, so that few programs serve all numbers of boundaries.
    columns = found.value.shape[-1]
    room = 1 << (max(columns, 1) - 1).bit_length()
    padding = [(0, 0)] * (found.value.ndim - 1) + [(0, room - columns)]
    value = library.pad(found.value, padding, constant_values=library.nan)
    toppled = library.pad(found.toppled, padding)
    numbers, samples = split(scene)
    perturbed = jax.tree.map(lambda t: t is not None, changes, is_leaf=lambda t: t is None)
    parts = (*eqx.partition(numbers, perturbed), samples)
    compiled = _compiled_slopes("" if traced else jax.default_backend())
    static = search._replace(max_boundaries=0, halvings=0)

    def slopes_at(until: Any) -> Any:
        return compiled(parts, values[..., 0], value, toppled, until, static)

    if traced or isinstance(scene.motion, Pulse):
        slopes = slopes_at(None)
        if search.drop_unknown:
            slopes = jax.tree.map(lambda s: jnp.where(jnp.isfinite(s), s, 0), slopes)
    else:
        overturns_beyond = library.pad(found.overturns_beyond, padding)
        times = _while_balanced(scene, value, overturns_beyond, search)
        early, late = map(slopes_at, times)
        slopes = _settled(early, late, 0.0 if search.drop_unknown else np.nan)
    total = _products(slopes, changes)
    return total if room == columns else total[..., :columns]


# How far motions from both sides of a boundary have come apart when its derivatives are taken, in
# radians and as powers of eps: twice, to compare. What comes later is missing in the first.
_APART = (0.4, 0.2)
_SETTLED = 1e-3  # relative difference of the two, at most


def _while_balanced(
    scene: DrivenScene, value: Any, overturns_beyond: Any, search: Search
) -> list[Any]:
    """Two times up to which the motion at each boundary under a long motion is known.

    A block that balances falls to one side or the other before a long motion ends, by what
    rounding says, so that the margin at its end has no derivatives. But as long as it balances,
    every change grows in the same ratio, from which the boundary follows: it does so until motions
    from both sides of the boundary have come apart.
    """
    numbers, samples = split(scene)
    exists = np.isfinite(value)
    eps = float(jnp.finfo(value.dtype).eps)
    chosen = eqx.combine(
        jax.tree.map(
            lambda leaf: np.broadcast_to(np.asarray(leaf)[..., None], value.shape)[exists], numbers
        ),
        samples,
    )
    at = value[exists]
    motion: Any = scene_at(chosen, at, search).motion
    # In NumPy: under some transformations all that JAX computes here would be traced.
    if isinstance(motion, Harmonic):
        number, length = motion._number, 2 * np.pi / motion.frequency
    else:
        number, length = motion._last, motion.time_step
    start = motion.start
    end = start + np.asarray(number) * length
    # Both sides of the boundary at once.
    sides = np.stack([at, at * (1 + np.where(overturns_beyond[exists], 8, -8) * eps)])

    def apart(until: Any) -> Any:
        final, other = np.asarray(respond_at(chosen, sides[:, None], search, until).final_rotation)
        return abs(final - other)

    # Bisected for both distances at once.
    distance = eps ** np.array(_APART)[:, None]
    low, high = (np.broadcast_to(time, (len(_APART), at.size)) for time in (start, end))
    together = apart(high) < distance
    for _ in range(12):
        middle = 0.5 * (low + high)
        close = apart(middle) < distance
        low, high = np.where(close, middle, low), np.where(close, high, middle)
    until = np.full((len(_APART), *value.shape), end.max(initial=1.0))
    # Beyond the end by rounding, which no program then takes for a time before it.
    until[:, exists] = np.where(together, end * (1 + 16 * eps), high)
    return [*until]


def _settled(early: Any, late: Any, unknown: float) -> Any:
    """The derivatives taken late, where those taken early are the same."""
    pairs = zip(jax.tree.leaves(early), jax.tree.leaves(late), strict=True)
    same = np.all([np.abs(b - a) <= _SETTLED * np.abs(b) for a, b in pairs], axis=0)
    return jax.tree.map(lambda slope: np.where(same, slope, unknown), late)


def _widened(leaf: Any, shape: tuple[int, ...]) -> Any:
    """The number of a block at each of its boundaries."""
    return jnp.broadcast_to(jnp.asarray(leaf)[..., None], shape)


def _slopes(
    parts: tuple[Any, Any, Any], first: Any, value: Any, toppled: Any, until: Any, search: Search
) -> Any:
    """Derivatives of the boundaries with respect to the numbers that move; 0 where none is.

    The parts of the scene are the numbers that move, those that do not, and the samples; `first`
    is the first of the values that were tried.
    """
    exists = jnp.isfinite(value)
    # Where there is no boundary, any value serves for the derivatives that are thrown away.
    stand_in = jax.lax.stop_gradient(_widened(first, value.shape))
    moving, fixed = jax.tree.map(lambda leaf: _widened(leaf, value.shape)[None], parts[:2])
    numbers, form = jax.tree.flatten(moving)
    point = [jnp.where(exists, value, stand_in)[None], *numbers]

    def vanishing(shifts: Any) -> Any:
        """What is 0 at a boundary, where the value and the numbers are shifted."""
        shifts = shifts.reshape(*shifts.shape, *[1] * value.ndim)
        at, *moving = (number + shift for number, shift in zip(point, shifts, strict=True))
        scene = eqx.combine(jax.tree.unflatten(form, moving), fixed, parts[2])
        response = respond_at(scene, at, search, until)
        margin = response.margin
        if until is not None:
            end = scene_at(scene, at, search).motion.end
            margin = jnp.where(until[None] < end, response.final_rotation, margin)
        return jnp.where(toppled[None], TOPPLED_ROTATION - response.peak_rotation, margin)

    # Each derivative is taken on a copy of the block: one tangent for many blocks compiles
    # faster than many tangents for one.
    each = jnp.eye(len(point), dtype=value.dtype)
    to_value, *to_numbers = jax.jvp(vanishing, (jnp.zeros_like(each),), (each,))[1]
    return jax.tree.unflatten(form, [jnp.where(exists, -s / to_value, 0) for s in to_numbers])


@functools.cache
def _compiled_slopes(platform: str) -> Callable[..., Any]:
    """`_slopes` for a platform; for "" as a part of another program, whose options apply."""
    options = compiler_options(platform) if platform else None
    return jax.jit(_slopes, static_argnames="search", compiler_options=options)


@jax.jit
def _products(slopes: Any, changes: Any) -> Any:
    products = jax.tree.map(lambda slope, t: slope * _widened(t, slope.shape), slopes, changes)
    return sum(jax.tree.leaves(products))
