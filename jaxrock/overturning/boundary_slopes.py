"""Derivatives of boundaries, by the implicit function theorem.

At a boundary a residual vanishes: the margin or, where the block topples, the distance of its
peak rotation from pi / 2. When a number of the scene changes, the boundary moves so that the
residual stays 0,

    d value / d number = -(d residual / d number) / (d residual / d value),

with both derivatives at the boundary itself. No derivative passes through the search: its
loops run forward only, and its comparisons have no derivatives. Only the motions on the
boundaries are differentiated, one for each boundary.

Under a long motion, a record or a `Harmonic`, the residual is another one. A block on the
boundary is in balance on its corner, and falls to one side or the other before the motion
ends, as rounding decides: the margin at the end has no derivatives. But as long as the block
balances, every small change of its rotation grows in the same ratio, whatever causes it. So
the quotient of two derivatives of the rotation, at a time at which changes have grown much and
the block has not fallen yet, is the derivative of the boundary.
"""

import functools
from collections.abc import Callable, Hashable, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..driven import TOPPLED_ROTATION, jit_steps
from ..ground_motion import Pulse
from ..host import count_processors, map_in_threads
from ..validation import AnyArray, choose_namespace, is_traced
from .quantities import Search, Subject, respond_at, set_quantity, split_numbers

# Columns of one program, each a derivative of one boundary. So many that one program serves
# all numbers of boundaries, and derivatives with respect to whatever moves.
_ROOM = 512


class FoundBoundaries(NamedTuple):
    """The fields of `Boundaries` on which derivatives depend, shape (..., boundaries)."""

    value: AnyArray
    overturns_beyond: AnyArray
    toppled: AnyArray


def compute_tangents(
    subject: Subject,
    changes: Subject,
    values: AnyArray,
    found: FoundBoundaries,
    search: Search,
) -> jax.Array:
    """Compute how far the boundaries move when the numbers of the subject change.

    Elementwise in all numbers that are perturbed; 0 where there is no boundary.
    """
    traced = is_traced(found)
    library = choose_namespace(found)
    numbers, samples = split_numbers(subject)
    leaves, form = jax.tree.flatten(numbers)
    tangents = form.flatten_up_to(changes)
    moving = [k for k, tangent in enumerate(tangents) if tangent is not None]
    # Padded to a power of two, so that few programs serve all numbers of boundaries.
    columns = found.value.shape[-1]
    room = 1 << (max(columns, 1) - 1).bit_length()
    padding = [(0, 0)] * (found.value.ndim - 1) + [(0, room - columns)]

    def pad_columns(entries: AnyArray, missing: float | int) -> AnyArray:
        return library.pad(library.asarray(entries), padding, constant_values=missing)

    value = pad_columns(found.value, library.nan)
    exists = library.isfinite(value)
    # In a transformation shapes must not depend on how many there are: all columns are
    # followed, those without a boundary from the first of the values.
    chosen = library.ones_like(exists) if traced else exists

    def flatten(entries: AnyArray) -> AnyArray:
        wide = library.broadcast_to(library.asarray(entries), value.shape)
        return wide.reshape(-1) if traced else wide[chosen]

    at = library.where(exists, value, library.asarray(values)[..., :1])
    rows = [flatten(at), *(flatten(library.asarray(leaf)[..., None]) for leaf in leaves)]
    toppled = flatten(pad_columns(found.toppled, False))
    edges = _Edges(samples, form, library.stack(rows), toppled, search)
    with np.errstate(all="ignore"):
        # Under a pulse, the margin at the end has derivatives. In a transformation the time
        # until which a block balances is not sought, so that the end has to do as well.
        if traced or isinstance(subject.motion, Pulse):
            slopes = edges.compute_slopes(moving, None)
            if search.drop_unknown:
                slopes = library.where(library.isfinite(slopes), slopes, 0)
        else:
            beyond = flatten(pad_columns(found.overturns_beyond, False))
            times = _find_balanced_times(edges, beyond)
            early, late = (edges.compute_slopes(moving, until) for until in times)
            # Changes have grown more at the later time, so that its derivatives are better.
            # How good they are is known from the earlier ones: where both differ, rounding or
            # the fall itself is in them, and they are not known.
            same = (abs(late - early) <= _SETTLED * abs(late)).all(axis=0)
            slopes = np.where(same, late, 0.0 if search.drop_unknown else np.nan)
    if traced:
        slopes = jnp.where(exists, slopes.reshape(-1, *value.shape), 0)
    else:
        known = slopes
        slopes = np.zeros((len(moving), *value.shape), value.dtype)
        slopes[:, exists] = known
    total = _sum_products(slopes, [tangents[k] for k in moving])
    return total if room == columns else total[..., :columns]


@jax.jit
def _sum_products(slopes: AnyArray, tangents: Sequence[AnyArray]) -> jax.Array | int:
    """Sum up slopes times tangents, which have no axis of boundaries."""
    return sum(
        slope * jnp.broadcast_to(jnp.asarray(tangent)[..., None], slope.shape)
        for slope, tangent in zip(slopes, tangents, strict=True)
    )


class _Edges(NamedTuple):
    """Boundaries, one after the other, and the blocks on them.

    Attributes
    ----------
    samples : Subject
        What all blocks share; see `split_numbers`.
    form : PyTreeDef
        Structure of the tree of numbers.
    rows : array, shape (1 + numbers, boundaries)
        Values of the quantity, then the numbers of the blocks.
    toppled : array of bool, shape (boundaries,)
        Whether the rotation reaches pi / 2.
    search : Search
        The search by which they were found.
    """

    samples: Subject
    form: Hashable
    rows: AnyArray
    toppled: AnyArray
    search: Search

    @property
    def subject(self) -> Subject:
        """The blocks on the boundaries, still with their own values of the quantity."""
        return eqx.combine(jax.tree.unflatten(self.form, list(self.rows[1:])), self.samples)

    def compute_slopes(self, moving: Sequence[int], until: AnyArray | None) -> AnyArray:
        """Compute derivatives (numbers, boundaries) with respect to the numbers that move.

        The residual is taken at the times `until`, or at the end of the motion.
        """
        # A column for each boundary and direction, first the derivatives with respect to the
        # value: so one program serves derivatives with respect to any numbers.
        number = self.rows.shape[1]
        directions = np.repeat(np.array([0, *(k + 1 for k in moving)], np.int32), number)
        times = len(moving) + 1
        traced = is_traced(self.rows)
        library = choose_namespace(self.rows)

        def repeat(entries: AnyArray) -> AnyArray:
            return library.tile(entries, times)

        columns = (repeat(self.rows), repeat(self.toppled), directions)
        if until is not None:
            columns = (*columns, repeat(until))
        # Searches that differ in what plays no role here share a program.
        search = self.search._replace(max_boundaries=0, halvings=0, alone=False)
        if traced:
            derivatives = _differentiate_residual(
                self.samples, directions.size, *columns, form=self.form, search=search
            )
        else:
            derivatives = _differentiate_in_pieces(self.samples, columns, self.form, search)
        to_value, *to_numbers = derivatives.reshape(times, number)
        return library.stack([-part / to_value for part in to_numbers])


def _differentiate_residual(
    samples: Subject,
    count: jax.Array | int,
    rows: AnyArray,
    toppled: AnyArray,
    directions: AnyArray,
    until: AnyArray | None = None,
    *,
    form: Hashable,
    search: Search,
) -> jax.Array:
    """Differentiate the residual of the first `count` columns, each in its own direction.

    A direction is the number of a row.
    """

    def compute_residual(rows: jax.Array) -> jax.Array:
        at, *numbers = rows
        subject = eqx.combine(jax.tree.unflatten(form, numbers), samples)
        response = respond_at(subject, at, search, until, count)
        margin = response.margin
        if until is not None:
            # Before the end, the rotation of a block that balances; see the top of this file.
            # Its value there is not 0, but only derivatives count.
            end = set_quantity(subject, at, search).motion.end
            margin = jnp.where(until < end, response.final_rotation, margin)
        # Toppling ends the motion while the margin is still far from 0: what vanishes there is
        # the distance of the peak from pi / 2.
        return jnp.where(toppled, TOPPLED_ROTATION - response.peak_rotation, margin)

    # One tangent for many blocks compiles faster than many tangents for one.
    tangents = (jnp.arange(len(rows), dtype=jnp.int32)[:, None] == directions[None]).astype(
        rows.dtype
    )
    return jax.jvp(compute_residual, (rows,), (tangents,))[1]


@functools.cache
def _compile(platform: str) -> Callable[..., jax.Array]:
    """Make `_differentiate_residual` a program for a platform, with its options."""
    return jit_steps(_differentiate_residual, platform, ("form", "search"))


def _differentiate_in_pieces(
    samples: Subject,
    columns: Sequence[AnyArray],
    form: Hashable,
    search: Search,
) -> np.ndarray:
    """Differentiate the residual of all columns, in pieces of one size, on all processors."""
    size = columns[0].shape[-1]
    pieces = -(-size // _ROOM)
    derive = _compile(jax.default_backend())

    def differentiate_piece(k: int) -> np.ndarray:
        parts = [each[..., k::pieces] for each in columns]
        count = parts[0].shape[-1]
        # Filled up with copies of the last column, valid numbers that are not followed: the
        # program stops after `count` columns.
        room = [
            np.pad(p, [(0, 0)] * (p.ndim - 1) + [(0, _ROOM - count)], "edge") for p in parts
        ]
        return np.asarray(derive(samples, count, *room, form=form, search=search))[:count]

    whole = np.empty(size, columns[0].dtype)
    workers = max(1, min(pieces, count_processors()))
    separate = map_in_threads(differentiate_piece, range(pieces), workers)
    for k, part in enumerate(separate):
        whole[k::pieces] = part
    return whole


# How far motions from both sides of a boundary have come apart when its derivatives are taken,
# in radians and as powers of eps. The motions start about eps apart. The first time is where
# they are eps**0.4 apart, the second where they are eps**0.2 apart. Changes have then grown by
# eps**-0.6 and eps**-0.8, beside which the terms that do not grow are lost, but the distance
# is still small beside a radian, so that the equation of motion is linear in it. The later
# time is better, as changes have grown more and less of the ground motion is left out, until
# the fall itself begins: so there are two, which are compared.
_APART = (0.4, 0.2)
# Relative difference of derivatives at both times that still count as the same. In double
# precision it is about eps**0.2, the distance at the second time.
_SETTLED = 1e-3


def _find_balanced_times(edges: _Edges, overturns_beyond: AnyArray) -> list[np.ndarray]:
    """Find two times up to which the block at each boundary still balances.

    It does so until motions from both sides of the boundary have come apart, by each of the
    distances in `_APART`. Where they never do, the time is beyond the end of the motion.
    """
    subject = edges.subject
    at = edges.rows[0]
    eps = float(np.finfo(at.dtype).eps)
    motion = set_quantity(subject, at, edges.search).motion
    start = np.broadcast_to(motion.start, at.shape)
    end = np.broadcast_to(motion.end, at.shape)
    # Both sides of the boundary at once. A boundary is known to 4 eps (see `refine_brackets`):
    # twice as far beyond it, the block falls.
    sides = np.stack([at, at * (1 + np.where(overturns_beyond, 8, -8) * eps)]).astype(at.dtype)

    def compute_distance(until: np.ndarray) -> np.ndarray:
        response = respond_at(subject, sides[:, None], edges.search, until)
        final, other = np.asarray(response.final_rotation)
        return abs(final - other)

    # Bisected for both distances at once, to 1/4096 of the motion: changes grow with the
    # block's own rate, which is slow beside that, so that the time need not be known better.
    distance = (eps ** np.array(_APART)[:, None]).astype(at.dtype)
    low, high = (np.broadcast_to(time, (len(_APART), at.size)) for time in (start, end))
    together = compute_distance(high) < distance
    for _ in range(12):
        middle = 0.5 * (low + high)
        close = compute_distance(middle) < distance
        low = np.where(close, middle, low)
        high = np.where(close, high, middle)
    # A program may compute the end as a number a little later than this one, and would then
    # take the rotation for the margin: a little is added.
    return [*np.where(together, end * (1 + 16 * eps), high)]
