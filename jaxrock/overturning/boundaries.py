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
from ..dynamics import BatchResponse, compiler_options, respond_batch
from ..ground_motion import Motion, Pulse, Record
from ..host import listed, with_clock
from ..numerics import brackets, brackets_traced, located
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import (
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


class _Case(NamedTuple):
    block: Block
    restitution: Any
    motion: Any


class _Along(NamedTuple):
    """A quantity to seek boundaries along."""

    domain: Domain
    kind: type[Motion]
    change: Callable[[_Case, Any], _Case]


def _leaf(domain: Domain, kind: type[Motion], where: Callable[[_Case], Any]) -> _Along:
    return _Along(domain, kind, lambda case, value: eqx.tree_at(where, case, value))


def _strength(case: _Case) -> Any:
    return case.motion.scale if isinstance(case.motion, Record) else case.motion.amplitude


_ALONG = {
    "amplitude": _leaf(FINITE, Pulse, lambda case: case.motion.amplitude),
    "duration": _leaf(POSITIVE, Pulse, lambda case: case.motion.duration),
    "factor": _Along(
        NON_NEGATIVE,
        Motion,
        lambda case, value: eqx.tree_at(_strength, case, _strength(case) * value),
    ),
    "half_width": _leaf(POSITIVE, Motion, lambda case: case.block.half_width),
    "slenderness": _leaf(POSITIVE, Motion, lambda case: case.block.slenderness),
    "restitution": _leaf(UNIT_INTERVAL, Motion, lambda case: case.restitution),
}


class Boundaries(eqx.Module):
    """Every boundary between standing and overturning in a range.

    The last axis of the arrays of shape (..., boundaries) is that of the boundaries, in the
    order in which they come in the range; where there are fewer, values are NaN.

    Attributes
    ----------
    value : Array, shape (..., boundaries)
        Where they are [unit of the quantity], on the side on which the block stands. Has
        derivatives in both modes.
    overturns_beyond : Array of bool, shape (..., boundaries)
        Whether the block overturns beyond the boundary; if not, it does before it.
    impacts : Array of int, shape (..., boundaries)
        The mode: number of impacts before it overturns; -1 where there is no boundary.
        Where a block comes to rest in infinitely many impacts and is lifted again later,
        only the first few of them are counted.
    toppled : Array of bool, shape (..., boundaries)
        Whether the block overturns there by falling flat while the ground still moves, and
        not by being balanced on the verge when it has come to rest.
    count : Array of int, shape (...)
        How many there are; under a transformation only `max_boundaries` of them are listed.
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
        if jnp.ndim(self.count) or isinstance(self.count, jax.core.Tracer):
            return listed(self, count="", value="", overturns_first="", complete="")
        lines = [] if self.count else [f"no boundary: it {self._does(self.overturns_first)} always"]
        for k in range(min(int(self.count), self.value.size)):
            number = int(self.impacts[k])
            mode = f"after {number} impact{'s' * (number > 1)}" if number else "without an impact"
            lines.append(
                f"{self._does(self.overturns_beyond[k])} beyond {self.value[k]:.6g}"
                f" (overturning {mode})"
            )
        return "\n".join(lines)

    @staticmethod
    def _does(overturns: Any) -> str:
        return "overturns" if overturns else "stands"


@with_clock("boundaries")
def overturning_boundaries(
    block: Block,
    restitution: Number,
    motion: Motion,
    along: str,
    values: Numbers,
    *,
    halvings: int = 0,
    model: ModelLike = Nonlinear(),
    max_boundaries: int = 8,
) -> Boundaries:
    """Every boundary between standing and overturning along one quantity.

    Overturning is not monotone: above the first strength that overturns a block there are
    windows in which it survives, since the ground can pull it back. The fate is computed at
    all values, and each change of it is located on the margin.

    Parameters
    ----------
    block : Block
    restitution : array_like
        C, velocity after an impact over velocity before it [-], between 0 and 1.
    motion : Motion
        A pulse, or a `Record` with one-dimensional samples.
    along : str
        ``"amplitude"`` or ``"duration"`` of a pulse, ``"factor"`` on any motion,
        ``"half_width"``, ``"slenderness"`` or ``"restitution"``. What is given for it
        otherwise does not matter (but for the factor, which multiplies it).
    values : array_like, shape (..., n)
        Increasing values to try [unit of the quantity], at least two.
    halvings : int
        How many times the intervals between them are halved where boundaries might hide:
        where the number of impacts changes, or the margin is small beside its changes. Two
        boundaries in an interval that is not halved any more go unseen.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.
    max_boundaries : int
        How many boundaries are listed under a transformation, where their number must be
        known beforehand.

    Returns
    -------
    Boundaries
        Everything else broadcasts against the leading axes of `values`.

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
    case, places = checked(block, restitution, motion, along, values)
    if max_boundaries < 1:
        raise ValueError(f"max_boundaries must be at least 1, got {max_boundaries}")
    if not 0 <= halvings <= 20:
        raise ValueError(f"halvings must be between 0 and 20, got {halvings}")
    return _boundaries(
        case,
        places,
        along=along,
        halvings=halvings,
        model=as_model(model),
        max_boundaries=max_boundaries,
    )


def checked(
    block: Block, restitution: Number, motion: Motion, along: str, values: Numbers
) -> tuple[_Case, Any]:
    """What `overturning_boundaries` is asked for; a `ValueError` if that is not allowed."""
    if not isinstance(motion, Pulse | Record):
        raise ValueError(f"motion must be a pulse or a Record, got {type(motion).__name__}")
    allowed = [name for name, quantity in _ALONG.items() if isinstance(motion, quantity.kind)]
    if along not in allowed:
        raise ValueError(f"along must be one of {', '.join(allowed)}, got {along!r}")
    restitution, places = as_real("restitution", restitution), as_real("values", values)
    check("restitution", restitution, UNIT_INTERVAL)
    check("values", places, _ALONG[along].domain)
    block.check()
    motion.check()
    if isinstance(motion, Record) and (
        motion.acceleration.ndim > 1 or (motion.vertical is not None and motion.vertical.ndim > 1)
    ):
        raise ValueError("motion must be one record, got an array of them")
    if places.ndim == 0 or places.shape[-1] < 2:
        raise ValueError(
            f"values must be at least two values, got an array of shape {places.shape}"
        )
    if not isinstance(places, jax.core.Tracer) and (np.diff(np.asarray(places)) <= 0).any():
        raise ValueError("values must be increasing, got values that do not increase")
    return of_one_precision((_Case(block, restitution, motion), places))


def _is_sample(path: Any) -> bool:
    return getattr(path[-1], "name", "") in ("acceleration", "vertical")


def _split(case: Any) -> tuple[list[Any], list[Any]]:
    """The leaves that are numbers, one a block, and the samples of a record."""
    leaves = jax.tree.leaves_with_path(case, is_leaf=lambda leaf: leaf is None)
    numbers = [leaf for path, leaf in leaves if not _is_sample(path)]
    return numbers, [leaf for path, leaf in leaves if _is_sample(path)]


def _joined(case: _Case, numbers: Any) -> _Case:
    """The case with other numbers."""
    rest = iter(numbers)
    return jax.tree.map_with_path(lambda path, leaf: leaf if _is_sample(path) else next(rest), case)


def _followed(case: _Case, along: str, value: Any, model: RockingModel) -> BatchResponse:
    """The response at a value, to the end of the input."""
    case = _ALONG[along].change(case, value)
    return respond_batch(*case, model=model)


@eqx.filter_custom_jvp
def _boundaries(
    case: _Case, values: Any, *, along: str, halvings: int, model: RockingModel, max_boundaries: int
) -> Boundaries:
    """The search. Where values are concrete, all boundaries are listed, else `max_boundaries`."""
    leaves = jax.tree.leaves((case, values))
    traced = any(isinstance(leaf, jax.core.Tracer) for leaf in leaves)
    library: Any = jnp if traced else np
    numbers = [library.asarray(leaf) for leaf in _split(case)[0]]
    values = library.asarray(values)
    shape = np.broadcast_shapes(*(leaf.shape for leaf in numbers), values.shape[:-1])
    size, places = math.prod(shape), values.shape[-1]
    numbers = [library.broadcast_to(leaf, shape).reshape(-1) for leaf in numbers]
    values = library.broadcast_to(values, (*shape, places)).reshape(size, places)

    def followed(index: Any, value: Any) -> Any:
        chosen = _joined(case, [leaf[index] for leaf in numbers])
        response = _followed(chosen, along, value, model)
        return jax.tree.map(library.asarray, response)

    def margin(index: Any, value: Any) -> Any:
        return followed(index, value).margin

    def margin_and_mode(index: Any, value: Any) -> tuple[Any, Any]:
        response = followed(index, value)
        mode = library.where(response.overturned, response.mode, response.impacts)
        return response.margin, mode

    if traced:
        found = brackets_traced(margin_and_mode, values, halvings, max_boundaries)
    else:
        found = brackets(margin_and_mode, values, halvings)
    listed = max_boundaries if traced else int(found.count.max(initial=0))
    stands, falls, left = located(margin, found, traced)
    eps = float(jnp.finfo(values.dtype).eps)
    # The number of impacts is taken a little further into overturning, or right behind the
    # boundary where the window of overturning is narrower than that.
    further = falls + library.sign(falls - stands) * eps**0.4 * abs(falls)
    together = library.concatenate([further, falls, stands])
    seen = followed(library.concatenate([found.case] * 3), together)
    beyond, at_falls, at_stands = (
        jax.tree.map(lambda leaf, k=k: leaf.reshape(3, -1)[k], seen) for k in range(3)
    )
    mode = library.where(beyond.overturned, beyond.mode, at_falls.mode)
    highest = at_stands.peak_rotation
    toppled = (left > eps**0.25) & (highest > 0.5 * math.pi - eps**0.25)
    known = found.valid & library.isfinite(left) & beyond.complete

    def table(entries: Any, missing: Any) -> Any:
        empty = library.full((size, listed), missing, library.asarray(entries).dtype)
        place = (found.case, found.column)
        if traced:
            return empty.at[place].set(entries).reshape(*shape, listed)
        empty[place] = entries
        return empty.reshape(*shape, listed)

    def spread(entries: Any, missing: Any) -> Any:
        return table(library.where(known, entries, missing), missing)

    answers = {
        "value": spread(stands, library.nan),
        "overturns_beyond": spread(falls > stands, False),
        "impacts": spread(mode, -1),
        "toppled": spread(toppled, False),
        "count": library.asarray(found.count).reshape(shape),
        "overturns_first": library.asarray(found.negative_first).reshape(shape),
        "complete": library.asarray(found.complete).reshape(shape)
        & table(known | ~found.valid, True).all(axis=-1),
    }
    return Boundaries(**jax.tree.map(jnp.asarray, answers))


@_boundaries.def_jvp
def _boundaries_jvp(primals: Any, tangents: Any, **options: Any) -> tuple[Any, Any]:
    """By the implicit function theorem, elementwise in all numbers that are perturbed."""
    case, values = primals
    changes, samples = _split(tangents[0])
    if any(tangent is not None for tangent in samples):
        raise ValueError("boundaries have no derivatives to the samples of a record")
    found = _boundaries(case, values, **options)
    # Padded to a power of two, so that few programs serve all numbers of boundaries.
    listed = found.value.shape[-1]
    room = 1 << (max(listed, 1) - 1).bit_length()
    library: Any = jnp if isinstance(found.value, jax.core.Tracer) else np
    lack = [(0, 0)] * (found.value.ndim - 1) + [(0, room - listed)]
    value = library.pad(found.value, lack, constant_values=library.nan)
    toppled = library.pad(found.toppled, lack)
    moves = tuple(tangent is not None for tangent in changes)
    leaves = jax.tree.leaves((case, values, value))
    traced = any(isinstance(leaf, jax.core.Tracer) for leaf in leaves)
    slopes = _compiled_slopes("" if traced else jax.default_backend())(
        case,
        values,
        value,
        toppled,
        moves=moves,
        along=options["along"],
        model=options["model"],
    )
    total = _moved(slopes, [tangent for tangent in changes if tangent is not None])
    total = total if room == listed else total[..., :listed]
    nothing = jax.tree.map(lambda leaf: None, found)
    return found, eqx.tree_at(lambda b: b.value, nothing, total, is_leaf=lambda leaf: leaf is None)


def _widened(leaf: Any, shape: tuple[int, ...]) -> Any:
    return jnp.broadcast_to(leaf[..., None], shape)


def _slopes(
    case: _Case,
    values: Any,
    value: Any,
    toppled: Any,
    moves: tuple[bool, ...],
    along: str,
    model: RockingModel,
) -> list[Any]:
    """Derivatives of the boundaries with respect to the numbers that move; 0 where none is."""
    there = jnp.isfinite(value)
    first = jax.lax.stop_gradient(_widened(jnp.asarray(values)[..., 0], value.shape))
    value = jnp.where(there, value, first)
    numbers = [_widened(jnp.asarray(leaf), value.shape) for leaf in _split(case)[0]]

    def left(point: list[Any]) -> Any:
        """What vanishes at a boundary."""
        place, *moving = point
        rest = iter(moving)
        whole = [next(rest) if m else n[None] for m, n in zip(moves, numbers, strict=True)]
        response = _followed(_joined(case, whole), along, place, model)
        return jnp.where(toppled, 0.5 * jnp.pi - response.peak_rotation, response.margin)

    point = [value, *(number for number, m in zip(numbers, moves, strict=True) if m)]
    # Each derivative is taken on a copy of the block: one tangent for many blocks compiles
    # faster than many tangents for one.
    shape = (len(point), *value.shape)
    moved = jnp.eye(len(point), dtype=value.dtype).reshape(-1, len(point), *[1] * value.ndim)
    point = [jnp.broadcast_to(part, shape) for part in point]
    basis = [jnp.broadcast_to(moved[:, k], shape) for k in range(len(point))]
    to_place, *to_numbers = jax.jvp(left, (point,), (basis,))[1]
    return [jnp.where(there, -slope / to_place, 0) for slope in to_numbers]


@functools.cache
def _compiled_slopes(platform: str) -> Callable[..., list[Any]]:
    """`_slopes` for a platform; for "" as a part of another program, whose options hold."""
    options = compiler_options(platform) if platform else None
    static = ("moves", "along", "model")
    return jax.jit(_slopes, static_argnames=static, compiler_options=options)


@jax.jit
def _moved(slopes: list[Any], changes: list[Any]) -> Any:
    pairs = zip(slopes, changes, strict=True)
    return sum(slope * _widened(change, slope.shape) for slope, change in pairs)
