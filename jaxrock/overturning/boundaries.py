"""Where a block in driven motion changes from standing to overturning, and back."""

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from ..block import Block
from ..dynamics import TOPPLED_ROTATION, BatchResponse, DrivenScene, compiler_options, respond_batch
from ..ground_motion import Motion, Pulse, Record
from ..host import listed, with_clock
from ..numerics import brackets, brackets_traced, located
from ..resonance import ModelLike, Nonlinear, as_model
from ..validation import (
    AT_LEAST_ONE,
    FINITE,
    NON_NEGATIVE,
    POSITIVE,
    UNIT_INTERVAL,
    Booleans,
    Domain,
    Number,
    Numbers,
    Reals,
    as_real,
    check,
    of_one_precision,
)


class Boundaries(eqx.Module):
    """Every boundary between standing and overturning in a range.

    The last axis of shape (..., boundaries) is in the order of the range; entries beyond the
    number of boundaries are NaN, False or -1.

    Attributes
    ----------
    value : Array, shape (..., boundaries)
        Of the quantity, on the side on which the block stands. Has derivatives in both modes.
    overturns_beyond : Array of bool, shape (..., boundaries)
        Whether the block overturns beyond the boundary; if not, it does before it.
    impacts : Array of int, shape (..., boundaries)
        The mode: number of impacts before it overturns. Where a block comes to rest in
        infinitely many impacts and is lifted again later, only the first few are counted.
    toppled : Array of bool, shape (..., boundaries)
        Whether the rotation reaches pi / 2 there while the ground still moves; if not, the
        block is left balanced on its corner when the ground has come to rest.
    count : Array of int, shape (...)
        Number of boundaries; under a transformation only `max_boundaries` of them are listed.
    overturns_first : Array of bool, shape (...)
        Whether the block overturns at the first of the values.
    complete : Array of bool, shape (...)
        Whether all motions were followed to their ends. If not, values are NaN.
    """

    value: Reals
    overturns_beyond: Booleans
    impacts: Int[Array, "..."]
    toppled: Booleans
    count: Int[Array, "..."]
    overturns_first: Booleans
    complete: Booleans

    def __str__(self) -> str:
        if jnp.ndim(self.count) or _traced(self.count):
            return listed(self, count="", value="", overturns_first="", complete="")
        does = {True: "overturns", False: "stands"}
        if not self.count:
            return f"no boundary: it {does[bool(self.overturns_first)]} always"
        lines = []
        for k in range(min(int(self.count), self.value.size)):
            number = int(self.impacts[k])
            mode = f"after {number} impact{'s' * (number > 1)}" if number else "without an impact"
            beyond = does[bool(self.overturns_beyond[k])]
            lines.append(f"{beyond} beyond {self.value[k]:.6g} (overturning {mode})")
        return "\n".join(lines)


class Search(NamedTuple):
    """What is sought, and how; static in compiled programs."""

    along: str
    model: Any
    max_boundaries: int
    halvings: int = 0  # of intervals in which the mode changes, or the margin comes near 0


def _strength(scene: Any) -> Any:
    return scene.motion.scale if isinstance(scene.motion, Record) else scene.motion.amplitude


# What boundaries are sought along: its domain, the motions that have it, its place in a scene.
_QUANTITIES: dict[str, tuple[Domain, type[Motion], Callable[[Any], Any]]] = {
    "amplitude": (FINITE, Pulse, _strength),
    "duration": (POSITIVE, Pulse, lambda scene: scene.motion.duration),
    "factor": (NON_NEGATIVE, Motion, _strength),  # on what is there
    "half_width": (POSITIVE, Motion, lambda scene: scene.block.half_width),
    "slenderness": (POSITIVE, Motion, lambda scene: scene.block.slenderness),
    "inertia_ratio": (AT_LEAST_ONE, Motion, lambda scene: scene.block.inertia_ratio),
    "restitution": (UNIT_INTERVAL, Motion, lambda scene: scene.restitution),
}


def overturning_boundaries(
    block: Block,
    restitution: Number,
    motion: Motion,
    along: str,
    values: Numbers,
    *,
    model: ModelLike = Nonlinear(),
    max_boundaries: int = 8,
) -> Boundaries:
    """Every boundary between standing and overturning along one quantity.

    Overturning is not monotone: above the first strength that overturns a block there are
    windows in which it survives, since the ground can pull it back. The outcome is computed at
    all values, and each change of it is located on the margin. Two boundaries between
    neighbouring values go unseen.

    Parameters
    ----------
    block : Block
    restitution : array_like
        C [-], between 0 and 1.
    motion : Motion
        A pulse, or a `Record` with one-dimensional samples.
    along : str
        ``"amplitude"`` or ``"duration"`` of a pulse, ``"factor"`` on any motion,
        ``"half_width"``, ``"slenderness"``, ``"inertia_ratio"`` or ``"restitution"``. What the
        scene has for it does not matter (but for the factor, which multiplies it).
    values : array_like, shape (..., n)
        Increasing values [unit of the quantity], at least two. All else broadcasts against
        their leading axes.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.
    max_boundaries : int
        How many are listed under a transformation, where shapes must be known beforehand.

    Returns
    -------
    Boundaries

    Raises
    ------
    ValueError
        If a concrete argument is outside of what is allowed.

    Notes
    -----
    The derivatives are those of the implicit function theorem: at a boundary the margin
    stays 0 (where the block is `toppled`, its peak stays pi / 2).

    Examples
    --------
    >>> import jaxrock as jr
    >>> import numpy as np
    >>> block, pulse = jr.Block(0.2, 5.0), jr.HalfSine(4.0, 0.4)
    >>> print(jr.overturning_boundaries(block, 0.9, pulse, "slenderness", np.linspace(2, 9, 8)))
    overturns beyond 5.80354 (overturning without an impact)
    """
    return searched(block, restitution, motion, values, Search(along, model, max_boundaries))


@with_clock("boundaries")
def searched(
    block: Block, restitution: Number, motion: Motion, values: Numbers, search: Search
) -> Boundaries:
    """The boundaries in a range; a `ValueError` if an argument is not allowed."""
    scene, places = checked(block, restitution, motion, search.along, values)
    if search.max_boundaries < 1:
        raise ValueError(f"max_boundaries must be at least 1, got {search.max_boundaries}")
    return _boundaries(scene, places, search=search._replace(model=as_model(search.model)))


def checked(
    block: Block, restitution: Number, motion: Motion, along: str, values: Numbers
) -> tuple[DrivenScene, Array]:
    """The scene and the values of a search; a `ValueError` if they are not allowed."""
    if not isinstance(motion, Pulse | Record):
        raise ValueError(f"motion must be a pulse or a Record, got {type(motion).__name__}")
    allowed = [name for name, (_, has, _) in _QUANTITIES.items() if isinstance(motion, has)]
    if along not in allowed:
        raise ValueError(f"along must be one of {', '.join(allowed)}, got {along!r}")
    places = as_real("values", values)
    check("values", places, _QUANTITIES[along][0])
    scene = DrivenScene(block, restitution, motion)
    samples = jax.tree.leaves(_split(scene)[1])
    if any(np.ndim(direction) > 1 for direction in samples):
        raise ValueError("motion must be one record, got an array of them")
    if places.ndim == 0 or places.shape[-1] < 2:
        raise ValueError(
            f"values must be at least two values, got an array of shape {places.shape}"
        )
    if not _traced(places) and (np.diff(np.asarray(places)) <= 0).any():
        raise ValueError("values must be increasing, got values that do not increase")
    return of_one_precision((scene, places))


def _split(scene: DrivenScene) -> tuple[Any, Any]:
    """The numbers of a scene, one a block, and the samples of its record, which all share."""
    samples = ("acceleration", "vertical")
    is_number = jax.tree.map_with_path(
        lambda path, _: getattr(path[-1], "name", "") not in samples, scene
    )
    return eqx.partition(scene, is_number)


def _traced(tree: Any) -> bool:
    return any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(tree))


def _followed(scene: DrivenScene, value: Any, search: Search) -> BatchResponse:
    """The response at a value, to the end of the input."""
    *_, place = _QUANTITIES[search.along]
    value = place(scene) * value if search.along == "factor" else value
    scene = eqx.tree_at(place, scene, value)  # unchecked: the values have been
    return respond_batch(scene.block, scene.restitution, scene.motion, model=search.model)


@eqx.filter_custom_jvp
def _boundaries(scene: DrivenScene, values: Any, *, search: Search) -> Boundaries:
    """The search. All boundaries are listed, under a transformation `max_boundaries`."""
    traced = _traced((scene, values))
    library: Any = jnp if traced else np
    numbers, samples = _split(scene)
    numbers, values = jax.tree.map(library.asarray, (numbers, values))
    shape = np.broadcast_shapes(*(n.shape for n in jax.tree.leaves(numbers)), values.shape[:-1])
    size, places = math.prod(shape), values.shape[-1]
    numbers = jax.tree.map(lambda leaf: library.broadcast_to(leaf, shape).reshape(-1), numbers)
    values = library.broadcast_to(values, (*shape, places)).reshape(size, places)

    def followed(index: Any, value: Any) -> BatchResponse:
        chosen = eqx.combine(jax.tree.map(lambda leaf: leaf[index], numbers), samples)
        return jax.tree.map(library.asarray, _followed(chosen, value, search))

    def margin_and_mode(index: Any, value: Any) -> tuple[Any, Any]:
        response = followed(index, value)
        return response.margin, library.where(response.overturned, response.mode, response.impacts)

    if traced:
        pairs = brackets_traced(margin_and_mode, values, search.halvings, search.max_boundaries)
    else:
        pairs = brackets(margin_and_mode, values, search.halvings)
    stands, falls, margin = located(lambda *at: followed(*at).margin, pairs, traced)
    eps = float(jnp.finfo(values.dtype).eps)
    # The number of impacts is taken a little further into overturning, or right behind the
    # boundary where the window of overturning is narrower than that.
    further = falls + library.sign(falls - stands) * eps**0.4 * abs(falls)
    around = library.concatenate([further, falls, stands])
    responses = followed(library.concatenate([pairs.case] * 3), around)
    beyond, at_falls, at_stands = (
        jax.tree.map(lambda leaf, k=k: leaf.reshape(3, -1)[k], responses) for k in range(3)
    )
    # Toppling does not bring the margin to 0 but ends the motion: the margin jumps there.
    toppled = (margin > eps**0.25) & (at_stands.peak_rotation > TOPPLED_ROTATION - eps**0.25)
    valid = pairs.valid & library.isfinite(margin) & beyond.complete
    columns = search.max_boundaries if traced else int(pairs.count.max(initial=0))

    def table(entries: Any, missing: Any, listed: Any = valid) -> Any:
        entries = library.where(listed, entries, missing)
        filled = library.full((size, columns), missing, entries.dtype)
        if traced:
            filled = filled.at[pairs.case, pairs.column].set(entries)
        else:
            filled[pairs.case, pairs.column] = entries
        return filled.reshape(*shape, columns)

    answers = dict(
        value=table(stands, library.nan),
        overturns_beyond=table(falls > stands, False),
        impacts=table(library.where(beyond.overturned, beyond.mode, at_falls.mode), -1),
        toppled=table(toppled, False),
        count=pairs.count.reshape(shape),
        overturns_first=pairs.negative_first.reshape(shape),
        complete=pairs.complete.reshape(shape) & table(valid, True, pairs.valid).all(axis=-1),
    )
    return Boundaries(**jax.tree.map(jnp.asarray, answers))


@_boundaries.def_jvp
def _boundaries_jvp(primals: Any, tangents: Any, *, search: Search) -> tuple[Any, Any]:
    """By the implicit function theorem, elementwise in all numbers that are perturbed."""
    scene, values = primals
    changes, sample_changes = _split(tangents[0])
    if jax.tree.leaves(sample_changes):
        raise ValueError("boundaries have no derivatives with respect to the samples of a record")
    found = _boundaries(scene, values, search=search)
    traced = _traced(found)
    library: Any = jnp if traced else np
    # Padded to a power of two, so that few programs serve all numbers of boundaries.
    columns = found.value.shape[-1]
    room = 1 << (max(columns, 1) - 1).bit_length()
    padding = [(0, 0)] * (found.value.ndim - 1) + [(0, room - columns)]
    value = library.pad(found.value, padding, constant_values=library.nan)
    toppled = library.pad(found.toppled, padding)
    numbers, samples = _split(scene)
    perturbed = jax.tree.map(lambda t: t is not None, changes, is_leaf=lambda t: t is None)
    parts = (*eqx.partition(numbers, perturbed), samples)
    compiled = _compiled_slopes("" if traced else jax.default_backend())
    slopes = compiled(parts, values, value, toppled, search._replace(max_boundaries=0, halvings=0))
    total = _moved(slopes, changes)
    total = total if room == columns else total[..., :columns]
    nothing = jax.tree.map(lambda leaf: None, found)
    return found, eqx.tree_at(lambda b: b.value, nothing, total, is_leaf=lambda leaf: leaf is None)


def _widened(leaf: Any, shape: tuple[int, ...]) -> Any:
    """The number of a block at each of its boundaries."""
    return jnp.broadcast_to(jnp.asarray(leaf)[..., None], shape)


def _slopes(
    parts: tuple[Any, Any, Any], values: Any, value: Any, toppled: Any, search: Search
) -> Any:
    """Derivatives of the boundaries with respect to the numbers that move; 0 where none is.

    The parts of the scene are the numbers that move, those that do not, and the samples.
    """
    exists = jnp.isfinite(value)
    # Where there is no boundary, any value serves for the derivatives that are thrown away.
    stand_in = jax.lax.stop_gradient(_widened(jnp.asarray(values)[..., 0], value.shape))
    moving, fixed = jax.tree.map(lambda leaf: _widened(leaf, value.shape)[None], parts[:2])
    numbers, form = jax.tree.flatten(moving)
    point = [jnp.where(exists, value, stand_in)[None], *numbers]

    def vanishing(shifts: Any) -> Any:
        """What is 0 at a boundary, where the value and the numbers are shifted."""
        shifts = shifts.reshape(*shifts.shape, *[1] * value.ndim)
        at, *moving = (number + shift for number, shift in zip(point, shifts, strict=True))
        scene = eqx.combine(jax.tree.unflatten(form, moving), fixed, parts[2])
        response = _followed(scene, at, search)
        return jnp.where(toppled[None], TOPPLED_ROTATION - response.peak_rotation, response.margin)

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
def _moved(slopes: Any, changes: Any) -> Any:
    products = jax.tree.map(lambda slope, t: slope * _widened(t, slope.shape), slopes, changes)
    return sum(jax.tree.leaves(products))
