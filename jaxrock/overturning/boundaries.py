"""Boundaries between standing and overturning in driven motion, along any quantity."""

import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..driven import TOPPLED_ROTATION, BatchResponse, require_complete
from ..ground_motion import Motion, Suite
from ..host import Printed, count_work, format_fields
from ..numerics import EvaluatedMargin, find_brackets, find_brackets_traced, refine_brackets
from ..resonance import ModelLike, Nonlinear, as_model
from ..validation import (
    AnyArray,
    Booleans,
    Integers,
    Number,
    Numbers,
    Reals,
    check_concrete,
    choose_namespace,
    is_traced,
)
from .boundary_derivatives import BoundarySides, compute_tangents
from .quantities import (
    Search,
    Subject,
    check_subject,
    format_value,
    respond_at,
    split_parameters,
)

# Relative width of the brackets at which derivatives are taken, unless they are narrower
# anyway. The derivatives depend on the distance from the boundary. At this width their
# relative change is at most 1e-6, under records, and typically 1e-11.
_TOLERANCE_OF_DERIVATIVES = 1e-12
_MAX_LINES = 12  # number of boundaries that are printed


class Boundaries(Printed, eqx.Module):
    """Every boundary between standing and overturning in a range.

    The last axis of shape (..., boundaries) is in the order of the range; entries beyond the
    number of boundaries are NaN, False or -1.

    Attributes
    ----------
    value : Array, shape (..., boundaries)
        Value of the quantity at the boundary, accurate to rounding (in an `OverturningRate`
        to a relative 1e-9). At this value the block does not overturn. It has derivatives in
        both modes.
    overturns_beyond : Array of bool, shape (..., boundaries)
        Whether the block overturns beyond the boundary; if not, it overturns before it.
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
        Whether all integrations finished. If not, values are NaN.
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
            return format_fields(self, count="", value="", overturns_first="", complete="")
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
            value = format_value(self.along, float(self.value[k]))
            lines.append(f"{beyond} beyond {value} (overturning {mode})")
        if len(lines) > _MAX_LINES:
            left_out = f"... {len(lines) - _MAX_LINES + 1} more boundaries ..."
            lines[_MAX_LINES - 2 : -1] = [left_out]
        return "\n".join(lines)

    @property
    def windows(self) -> np.ndarray:
        """Windows in which one block stands although a lower value overturns it.

        Returns
        -------
        ndarray, shape (windows, 2)
            Ends of the windows [unit of the quantity]; inf where the values end before the
            window does.

        Raises
        ------
        ValueError
            If these are boundaries of several blocks, or an integration did not finish.
        """
        check_concrete(self, "the number of windows depends on the answers")
        if self.count.ndim:
            raise ValueError(f"windows are of one block, got shape {self.count.shape}")
        require_complete(self.complete, quantity=self.along)
        value = np.append(self.value[: int(self.count)], np.inf)
        stands = ~np.asarray(self.overturns_beyond)[: value.size - 1]
        return np.column_stack([value[:-1], value[1:]])[stands]

    def table(self) -> dict[str, list[Any]]:
        """List the boundaries of one block as columns.

        Returns
        -------
        dict of list
            The quantity, ``overturns_beyond``, ``impacts``, ``toppled``.
        """
        names = ("overturns_beyond", "impacts", "toppled")
        columns = {self.along: np.asarray(self.value).tolist()}
        return columns | {name: np.asarray(getattr(self, name)).tolist() for name in names}


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
    """Find every boundary between standing and overturning along one quantity.

    Overturning is not monotone: above the weakest motion that overturns a block there are
    windows in which the block survives, since the ground can pull it back. The outcome is
    computed at all values, and each change of the outcome is located as a zero of the margin.
    Two boundaries between neighbouring values are not detected.

    Parameters
    ----------
    block : Block
    restitution : array_like
        C [-], between 0 and 1.
    motion : Motion or Suite
        A pulse, a `Harmonic`, a `Record` with one-dimensional samples, or a `Suite`, whose
        records make the leading axis of the result.
    along : str
        ``"amplitude"`` of a pulse or a `Harmonic`, ``"duration"`` of a pulse, ``"frequency"``
        of a `Harmonic`, ``"factor"`` on any motion; ``"width"`` [m] at this height,
        ``"height"`` [m] at this width, ``"half_width"`` [m] at this slenderness,
        ``"slenderness"`` at this width, ``"inertia_ratio"`` or ``"restitution"``. Each value
        replaces the one that the block, the restitution or the motion has; only a factor
        multiplies the motion.
    values : array_like, shape (..., n)
        Increasing values [unit of the quantity], at least two. All other arguments broadcast
        against their leading axes.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.
    max_boundaries : int
        Number of boundaries that are listed under a transformation, where shapes must be
        known beforehand.

    Returns
    -------
    Boundaries

    Raises
    ------
    ValueError
        If a concrete argument is not allowed.

    Notes
    -----
    Derivatives follow from the implicit function theorem: at a boundary the margin stays 0
    (where the block is `toppled`, its peak stays pi / 2). Under a record or a `Harmonic` they
    follow from the velocity with which the block topples right beside the boundary. Where
    rounding hides this velocity they are NaN.

    Examples
    --------
    >>> import jaxrock as jr
    >>> import numpy as np
    >>> block, pulse = jr.Block(0.2, 5.0), jr.HalfSine(4.0, 0.4)
    >>> print(jr.overturning_boundaries(block, 0.9, pulse, "slenderness", np.linspace(2, 9, 8)))
    overturns beyond 5.80354 (overturning without an impact)
    """
    search = Search(along, model, max_boundaries)
    return search_boundaries(block, restitution, motion, values, search)


def search_boundaries(
    block: Block, restitution: Number, motion: Motion | Suite, values: Numbers, search: Search
) -> Boundaries:
    """Search the boundaries in a range; a `ValueError` if an argument is not allowed."""
    subject, levels = check_subject(block, restitution, motion, search.along, values)
    return find_boundaries(subject, levels, search)[0]


# The boundaries, and the values right behind them at which the block overturns.
_Sides = tuple[Boundaries, AnyArray]


def find_boundaries(subject: Subject, values: Reals, search: Search) -> _Sides:
    """Find both sides of the boundaries between values, for a subject that has been checked."""
    if search.max_boundaries < 1:
        raise ValueError(f"max_boundaries must be at least 1, got {search.max_boundaries}")
    search = search._replace(model=as_model(search.model))
    return _compute_boundaries(subject, values, search=search)


@eqx.filter_custom_jvp
def _compute_boundaries(subject: Subject, values: AnyArray, *, search: Search) -> _Sides:
    """Find the boundaries, and the values right behind them at which the block overturns.

    Finds all boundaries, or under a transformation `max_boundaries` of them.
    """
    traced = is_traced((subject, values))
    library = choose_namespace((subject, values))
    # All cases one after the other: parameters of shape (cases,), values of shape (cases, n).
    parameters, samples = split_parameters(subject)
    parameters, values = jax.tree.map(library.asarray, (parameters, values))
    shape = np.broadcast_shapes(
        *(leaf.shape for leaf in jax.tree.leaves(parameters)), values.shape[:-1]
    )
    size = math.prod(shape)
    parameters = jax.tree.map(
        lambda leaf: library.broadcast_to(leaf, shape).reshape(-1), parameters
    )
    length = values.shape[-1]
    table = library.broadcast_to(values, (*shape, length)).reshape(size, length)

    def simulate(index: AnyArray, value: AnyArray) -> BatchResponse:
        """Simulate the motions of cases, by their indices, at values of the quantity."""
        chosen = eqx.combine(jax.tree.map(lambda leaf: leaf[index], parameters), samples)
        return jax.tree.map(library.asarray, respond_at(chosen, value, search))

    def evaluate(index: AnyArray, value: AnyArray) -> EvaluatedMargin:
        """Evaluate the margins, with the numbers of impacts and the peaks of the rotation."""
        response = simulate(index, value)
        mode = library.where(response.overturned, response.mode, response.impacts)
        return EvaluatedMargin(response.margin, mode, response.peak_rotation)

    # First find pairs of values between which the outcome changes, then refine each pair.
    if traced:
        pairs = find_brackets_traced(evaluate, table, search.halvings, search.max_boundaries)
    else:
        with count_work("search for boundaries", table.size):
            pairs = find_brackets(evaluate, table, search.halvings)
    changes = refine_brackets(evaluate, pairs, traced, search.tolerance)
    stands = changes.stands
    falls = changes.falls
    eps = float(jnp.finfo(table.dtype).eps)
    # The mode is the number of impacts before overturning. Within rounding of the boundary a
    # block balances so long that rounding decides about further impacts. So impacts are
    # counted a little further into overturning: by eps**0.4 of the value, 5e-7 in double
    # precision. The distance from the boundary is then known to 60 % of the digits, and is far
    # below 1 %, the width of the windows that are sought. Where a window of overturning is
    # narrower still, so that the block stands again there, impacts are counted right behind
    # the boundary.
    further = falls + library.sign(falls - stands) * eps**0.4 * abs(falls)
    beyond = simulate(pairs.case, further)
    mode = library.where(beyond.overturned, beyond.mode, changes.at_falls.mode)
    # Toppling does not bring the margin to 0 but ends the motion: the margin jumps there. On
    # the standing side the margin is near rounding at a zero, and of order 1 at a jump; a
    # threshold of a quarter of the digits, 1e-4 in double precision, separates the two. The
    # peak has to be as close to pi / 2, since chaos makes the margin steep beside a zero as
    # well.
    margin, _, peak = changes.at_stands
    toppled = (margin > eps**0.25) & (peak > TOPPLED_ROTATION - eps**0.25)
    valid = pairs.valid & changes.success & beyond.complete
    columns = search.max_boundaries if traced else int(pairs.sign_changes.max(initial=0))

    def fill_table(
        entries: AnyArray, missing: float | int, listed: AnyArray = valid
    ) -> AnyArray:
        """Arrange entries of pairs by case and order, and fill with `missing`."""
        entries = library.where(listed, entries, missing)
        rows = library.full((size, columns), missing, entries.dtype)
        if traced:
            rows = rows.at[pairs.case, pairs.column].set(entries)
        else:
            rows[pairs.case, pairs.column] = entries
        return rows.reshape(*shape, columns)

    answers = dict(
        value=fill_table(stands, library.nan),
        overturns_beyond=fill_table(falls > stands, False),
        impacts=fill_table(mode, -1),
        toppled=fill_table(toppled, False),
        count=pairs.sign_changes.reshape(shape),
        overturns_first=pairs.negative_first.reshape(shape),
        complete=pairs.complete.reshape(shape)
        & fill_table(valid, True, pairs.valid).all(axis=-1),
    )
    # `device_put` compiles nothing, unlike `jnp.asarray` of shapes that differ from call to
    # call.
    answers, falls = jax.device_put((answers, fill_table(falls, library.nan)))
    return Boundaries(along=search.along, **answers), falls


@_compute_boundaries.def_jvp
def _differentiate_boundaries(
    primals: tuple[Subject, AnyArray],
    tangents: tuple[Subject, AnyArray | None],
    *,
    search: Search,
) -> tuple[_Sides, _Sides]:
    """Differentiate boundaries, elementwise in all parameters that are perturbed.

    The implicit function theorem is used; see `compute_tangents`. The values between which
    boundaries are sought do not move the boundaries, so that their tangents are dropped. All
    fields but `value` have no tangent.

    If the search has a tolerance, boundaries are refined further before they are
    differentiated.
    """
    subject, values = primals
    changes, sample_changes = split_parameters(tangents[0])
    if jax.tree.leaves(sample_changes):
        raise ValueError(
            "boundaries have no derivatives with respect to the samples of a record"
        )
    # The derivatives of a boundary are those at the falling side of its bracket.
    if search.tolerance is not None:
        search = search._replace(tolerance=min(search.tolerance, _TOLERANCE_OF_DERIVATIVES))
    boundaries, falls = _compute_boundaries(subject, values, search=search)
    sides = BoundarySides(boundaries.value, falls, boundaries.toppled)
    total = compute_tangents(subject, changes, values, sides, search)
    nothing = jax.tree.map(lambda leaf: None, boundaries)
    tangent = eqx.tree_at(lambda b: b.value, nothing, total, is_leaf=lambda leaf: leaf is None)
    return (boundaries, falls), (tangent, total)
