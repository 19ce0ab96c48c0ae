"""Derivatives of boundaries, by the implicit function theorem.

At a boundary a residual vanishes: the margin or, where the block topples, the distance of its
peak rotation from pi / 2. When a parameter of the scene changes, the boundary moves so that
the residual stays 0,

    d value / d parameter = -(d residual / d parameter) / (d residual / d value),

with both derivatives at the boundary itself. No derivative passes through the search: its
loops run forward only, and its comparisons have no derivatives. Only the motions on the
boundaries are differentiated, one for each boundary.

Under a long motion, a record or a `Harmonic`, the margin jumps at most boundaries: a block
there balances on its corner while the ground still moves, and topples or falls back long
before the end. While it balances, its distance from balance grows exponentially, whatever has
caused it, and all that happens later depends on that distance. So the quotient of two
derivatives of any later quantity is the derivative of the boundary; influences other than the
distance add a relative error of about one over its growth. The residual is therefore the
velocity with which the block passes pi / 2 on the falling side of the bracket.
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
from ..host import count_processors, count_work, map_in_threads
from ..validation import AnyArray, choose_namespace, is_traced
from .quantities import Search, Subject, respond_at, split_parameters

# Columns of one program, each a derivative of one boundary. Their number is fixed, so that one
# program serves any count of boundaries and any set of parameters.
_ROOM = 512
# The velocity of a block that topples from balance depends on the logarithm of the distance
# from the boundary: its derivative with respect to the value, times that distance, is about
# the velocity itself. Where the derivative is less than this fraction of the velocity over the
# width of the bracket, rounding moves the block more than the distance does, or the block does
# not balance. Then the derivative of the boundary is not known.
_PART_OF_RESIDUAL = 1e-3


class BoundarySides(NamedTuple):
    """Both sides of boundaries, shape (..., boundaries)."""

    value: AnyArray  # values of the quantity at which the block does not overturn
    falls: AnyArray  # values at which it overturns
    toppled: AnyArray  # as in `Boundaries`


def compute_tangents(
    subject: Subject,
    changes: Subject,
    values: AnyArray,
    sides: BoundarySides,
    search: Search,
) -> jax.Array:
    """Compute how far the boundaries move when the parameters of the subject change.

    Elementwise in all parameters that are perturbed; 0 where there is no boundary.
    """
    traced = is_traced(sides)
    library = choose_namespace(sides)
    parameters, samples = split_parameters(subject)
    leaves, form = jax.tree.flatten(parameters)
    tangents = form.flatten_up_to(changes)
    moving = [k for k, tangent in enumerate(tangents) if tangent is not None]
    # Padded to a power of two, so that few programs serve any count of boundaries.
    columns = sides.value.shape[-1]
    room = 1 << (max(columns, 1) - 1).bit_length()
    padding = [(0, 0)] * (sides.value.ndim - 1) + [(0, room - columns)]

    def pad_columns(entries: AnyArray, missing: float | int) -> AnyArray:
        return library.pad(library.asarray(entries), padding, constant_values=missing)

    value = pad_columns(sides.value, library.nan)
    exists = library.isfinite(value)
    # In a transformation shapes must not depend on the number of boundaries: all columns are
    # simulated, those without a boundary at the first value.
    chosen = library.ones_like(exists) if traced else exists

    def flatten(entries: AnyArray) -> AnyArray:
        wide = library.broadcast_to(library.asarray(entries), value.shape)
        return wide.reshape(-1) if traced else wide[chosen]

    toppled = pad_columns(sides.toppled, False)
    falls = pad_columns(sides.falls, library.nan)
    width = abs(falls - value)
    # The listed value is a zero of the margin under a pulse, and of the distance from pi / 2
    # where the block topples.
    continuous = toppled | isinstance(subject.motion, Pulse)
    point = library.where(continuous, value, falls)
    point = library.where(exists, point, library.asarray(values)[..., :1])
    rows = [flatten(point), *(flatten(library.asarray(leaf)[..., None]) for leaf in leaves)]
    edges = _Edges(
        samples, form, library.stack(rows), flatten(toppled), flatten(width), search
    )
    with np.errstate(all="ignore"):
        derivatives = edges.compute_derivatives(moving)
    if search.drop_unknown:
        derivatives = library.where(library.isfinite(derivatives), derivatives, 0)
    if traced:
        derivatives = jnp.where(exists, derivatives.reshape(-1, *value.shape), 0)
    else:
        known = derivatives
        derivatives = np.zeros((len(moving), *value.shape), value.dtype)
        derivatives[:, exists] = known
    total = _sum_products(derivatives, [tangents[k] for k in moving])
    return total if room == columns else total[..., :columns]


@jax.jit
def _sum_products(derivatives: AnyArray, tangents: Sequence[AnyArray]) -> jax.Array | int:
    """Sum up derivatives times tangents, which have no axis of boundaries."""
    return sum(
        derivative * jnp.broadcast_to(jnp.asarray(tangent)[..., None], derivative.shape)
        for derivative, tangent in zip(derivatives, tangents, strict=True)
    )


class _Edges(NamedTuple):
    """Boundaries, one after the other, and the blocks on them.

    Attributes
    ----------
    samples : Subject
        Common to all blocks; see `split_parameters`.
    form : PyTreeDef
        Structure of the tree of parameters.
    rows : array, shape (1 + parameters, boundaries)
        Values of the quantity, then the parameters of the blocks.
    toppled : array of bool, shape (boundaries,)
        Whether the rotation reaches pi / 2.
    width : array, shape (boundaries,)
        Of the brackets [unit of the quantity].
    search : Search
        The search by which they were found.
    """

    samples: Subject
    form: Hashable
    rows: AnyArray
    toppled: AnyArray
    width: AnyArray
    search: Search

    def compute_derivatives(self, moving: Sequence[int]) -> AnyArray:
        """Compute derivatives (parameters, boundaries), NaN where they are not known."""
        # Each boundary and direction has a column; the first direction is the value of the
        # quantity. So one program serves derivatives with respect to any parameters.
        count = self.rows.shape[1]
        directions = np.repeat(np.array([0, *(k + 1 for k in moving)], np.int32), count)
        times = len(moving) + 1
        library = choose_namespace(self.rows)
        columns = (
            library.tile(self.rows, times),
            library.tile(self.toppled, times),
            directions,
        )
        # Fields of the search that play no role here are left out, so that searches share a
        # program.
        search = Search(self.search.along, self.search.model, 0)
        if is_traced(self.rows):
            result = _differentiate_residual(
                self.samples, directions.size, *columns, form=self.form, search=search
            )
        else:
            result = _differentiate_in_pieces(self.samples, columns, self.form, search)
        residuals, derivatives = result.reshape(2, times, count)
        value_derivative, *parameter_derivatives = derivatives
        # Rounding moves a boundary by some eps, whatever the bracket is.
        eps = float(jnp.finfo(self.rows.dtype).eps)
        width = library.maximum(self.width, 8 * eps * abs(self.rows[0]))
        known = abs(value_derivative) * width >= _PART_OF_RESIDUAL * abs(residuals[0])
        divisor = library.where(known, -value_derivative, library.nan)
        return library.stack([part / divisor for part in parameter_derivatives])


def _differentiate_residual(
    samples: Subject,
    count: jax.Array | int,
    rows: AnyArray,
    toppled: AnyArray,
    directions: AnyArray,
    *,
    form: Hashable,
    search: Search,
) -> jax.Array:
    """Differentiate the residual of the first `count` columns, each in its own direction.

    A direction is the index of a row. Returns the residuals and their derivatives.
    """

    def compute_residual(rows: jax.Array) -> jax.Array:
        point, *parameters = rows
        subject = eqx.combine(jax.tree.unflatten(form, parameters), samples)
        response = respond_at(subject, point, search, count)
        residual = response.margin
        if not isinstance(subject.motion, Pulse):
            # Its value is not 0, but only derivatives count; see the top of this file.
            passes = response.peak_rotation >= TOPPLED_ROTATION
            residual = jnp.where(passes, response.final_velocity, residual)
        # Toppling ends the motion while the margin is still far from 0: there the distance of
        # the peak from pi / 2 vanishes.
        return jnp.where(toppled, TOPPLED_ROTATION - response.peak_rotation, residual)

    # One tangent for many blocks compiles faster than many tangents for one.
    tangents = (jnp.arange(len(rows), dtype=jnp.int32)[:, None] == directions[None]).astype(
        rows.dtype
    )
    return jnp.stack(jax.jvp(compute_residual, (rows,), (tangents,)))


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
        piece = [entries[..., k::pieces] for entries in columns]
        count = piece[0].shape[-1]
        # The rest is filled with copies of the last column, which are valid but not simulated:
        # the program stops after `count` columns.
        room = [
            np.pad(p, [(0, 0)] * (p.ndim - 1) + [(0, _ROOM - count)], "edge") for p in piece
        ]
        result = derive(samples, count, *room, form=form, search=search)
        result = np.asarray(result)[:, :count]
        work.update(count)
        return result

    whole = np.empty((2, size), columns[0].dtype)
    workers = max(1, min(pieces, count_processors()))
    with count_work("derivatives of boundaries", size) as work:
        separate = map_in_threads(differentiate_piece, range(pieces), workers)
    for k, part in enumerate(separate):
        whole[:, k::pieces] = part
    return whole
