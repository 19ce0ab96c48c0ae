"""Where a block in driven motion changes from standing to overturning, and back."""

import math
from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..driven import TOPPLED_ROTATION, BatchResponse, GroundMotions
from ..ground_motion import Motion, Suite
from ..host import Printed, listed, with_clock
from ..numerics import brackets, brackets_traced, located
from ..resonance import ModelLike, Nonlinear, as_model
from ..validation import Booleans, Integers, Number, Numbers, Reals, is_traced
from .boundary_slopes import moved
from .quantities import Search, Subject, checked, respond_at, split, with_unit


class Boundaries(Printed, eqx.Module):
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
    along : str
        The quantity.
    """

    value: Reals
    overturns_beyond: Booleans
    impacts: Integers
    toppled: Booleans
    count: Integers
    overturns_first: Booleans
    complete: Booleans
    along: str = eqx.field(static=True)

    def __str__(self) -> str:
        if jnp.ndim(self.count) or is_traced(self.count):
            return listed(self, count="", value="", overturns_first="", complete="")
        does = {True: "overturns", False: "stands"}
        if not self.count:
            outcome = does[bool(self.overturns_first)]
            return f"no boundary: it {outcome} at all of the values examined"
        lines = []
        for k in range(min(int(self.count), self.value.size)):
            number = int(self.impacts[k])
            mode = (
                f"after {number} impact{'s' * (number > 1)}" if number else "without an impact"
            )
            beyond = does[bool(self.overturns_beyond[k])]
            place = with_unit(self.along, float(self.value[k]))
            lines.append(f"{beyond} beyond {place} (overturning {mode})")
        return "\n".join(lines)


def overturning_boundaries(
    block: Block,
    restitution: Number,
    motion: Motion | Suite,
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
    motion : Motion or Suite
        A pulse, a `Harmonic`, a `Record` with one-dimensional samples, or a `Suite`, whose
        records make the leading axis of the result.
    along : str
        ``"amplitude"`` of a pulse or a `Harmonic`, ``"duration"`` of the one, ``"frequency"``
        of the other, ``"factor"`` on any motion, ``"half_width"``, ``"slenderness"``,
        ``"inertia_ratio"`` or ``"restitution"``. What the scene has for it does not matter
        (but for the factor, which multiplies it).
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
    stays 0 (where the block is `toppled`, its peak stays pi / 2). Under a record or a
    `Harmonic` they are taken while the block still balances; where chaos hides that in
    rounding they are NaN, and under `jit`, where the margin at the end has to do, at most
    boundaries of long ones.

    Examples
    --------
    >>> import jaxrock as jr
    >>> import numpy as np
    >>> block, pulse = jr.Block(0.2, 5.0), jr.HalfSine(4.0, 0.4)
    >>> print(jr.overturning_boundaries(block, 0.9, pulse, "slenderness", np.linspace(2, 9, 8)))
    overturns beyond 5.80354 (overturning without an impact)
    """
    return searched(block, restitution, motion, values, Search(along, model, max_boundaries))


def searched(
    block: Block, restitution: Number, motion: Motion | Suite, values: Numbers, search: Search
) -> Boundaries:
    """Search the boundaries in a range; a `ValueError` if an argument is not allowed."""
    subject, places = checked(block, restitution, motion, search.along, values)
    return boundaries_of(subject, places, search)


@with_clock("boundaries")
def boundaries_of(subject: Subject, places: Reals, search: Search) -> Boundaries:
    """Search the boundaries between values, of a subject that has been checked."""
    if search.max_boundaries < 1:
        raise ValueError(f"max_boundaries must be at least 1, got {search.max_boundaries}")
    # What is found for a record does not depend on the others.
    alone = search.alone or isinstance(subject.motion, GroundMotions)
    search = search._replace(model=as_model(search.model), alone=alone)
    return _boundaries(subject, places, search=search)


@eqx.filter_custom_jvp
def _boundaries(subject: Subject, values: Any, *, search: Search) -> Boundaries:
    """Search. All boundaries are listed, under a transformation `max_boundaries`."""
    traced = is_traced((subject, values))
    library: Any = jnp if traced else np
    numbers, samples = split(subject)
    numbers, values = jax.tree.map(library.asarray, (numbers, values))
    shape = np.broadcast_shapes(
        *(n.shape for n in jax.tree.leaves(numbers)), values.shape[:-1]
    )
    size = math.prod(shape)
    places = values.shape[-1]
    numbers = jax.tree.map(lambda leaf: library.broadcast_to(leaf, shape).reshape(-1), numbers)
    values = library.broadcast_to(values, (*shape, places)).reshape(size, places)

    def followed(index: Any, value: Any) -> BatchResponse:
        chosen = eqx.combine(jax.tree.map(lambda leaf: leaf[index], numbers), samples)
        return jax.tree.map(library.asarray, respond_at(chosen, value, search))

    def margin_and_mode(index: Any, value: Any) -> tuple[Any, Any]:
        response = followed(index, value)
        return response.margin, library.where(
            response.overturned, response.mode, response.impacts
        )

    if traced:
        pairs = brackets_traced(
            margin_and_mode, values, search.halvings, search.max_boundaries
        )
    else:
        pairs = brackets(margin_and_mode, values, search.halvings)
    stands, falls, margin = located(
        lambda *at: followed(*at).margin, pairs, traced, search.alone
    )
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
        rows = library.full((size, columns), missing, entries.dtype)
        if traced:
            rows = rows.at[pairs.case, pairs.column].set(entries)
        else:
            rows[pairs.case, pairs.column] = entries
        return rows.reshape(*shape, columns)

    answers = dict(
        value=table(stands, library.nan),
        overturns_beyond=table(falls > stands, False),
        impacts=table(library.where(beyond.overturned, beyond.mode, at_falls.mode), -1),
        toppled=table(toppled, False),
        count=pairs.count.reshape(shape),
        overturns_first=pairs.negative_first.reshape(shape),
        complete=pairs.complete.reshape(shape) & table(valid, True, pairs.valid).all(axis=-1),
    )
    return Boundaries(along=search.along, **jax.device_put(answers))  # compiles nothing


@_boundaries.def_jvp
def _boundaries_jvp(primals: Any, tangents: Any, *, search: Search) -> tuple[Any, Any]:
    """By the implicit function theorem, elementwise in all numbers that are perturbed."""
    subject, values = primals
    changes, sample_changes = split(tangents[0])
    if jax.tree.leaves(sample_changes):
        raise ValueError(
            "boundaries have no derivatives with respect to the samples of a record"
        )
    found = _boundaries(subject, values, search=search)
    total = moved(subject, changes, values, found, search)
    nothing = jax.tree.map(lambda leaf: None, found)
    return found, eqx.tree_at(
        lambda b: b.value, nothing, total, is_leaf=lambda leaf: leaf is None
    )
