"""Derivatives of boundaries, by the implicit function theorem."""

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..driven import TOPPLED_ROTATION, compiler_options
from ..ground_motion import Pulse
from ..host import mapped, processors
from ..validation import is_traced
from .quantities import Search, Subject, respond_at, split, subject_at

# Columns of one program, each a derivative of one boundary: so many that one program serves
# all numbers of boundaries, and derivatives with respect to whatever moves.
_ROOM = 512


def moved(subject: Subject, changes: Any, values: Any, found: Any, search: Search) -> Any:
    """Compute how far the boundaries move when the numbers of the subject change.

    Elementwise in all numbers that are perturbed; 0 where there is no boundary.
    """
    traced = is_traced(found)
    library: Any = jnp if traced else np
    numbers, samples = split(subject)
    leaves, form = jax.tree.flatten(numbers)
    tangents = form.flatten_up_to(changes)
    moving = [k for k, tangent in enumerate(tangents) if tangent is not None]
    # Padded to a power of two, so that few programs serve all numbers of boundaries.
    columns = found.value.shape[-1]
    room = 1 << (max(columns, 1) - 1).bit_length()
    padding = [(0, 0)] * (found.value.ndim - 1) + [(0, room - columns)]

    def padded(entries: Any, missing: Any) -> Any:
        return library.pad(library.asarray(entries), padding, constant_values=missing)

    value = padded(found.value, library.nan)
    exists = library.isfinite(value)
    # In a transformation all are followed, and what is none from a value that there is.
    chosen = library.ones_like(exists) if traced else exists

    def flat(entries: Any) -> Any:
        wide = library.broadcast_to(library.asarray(entries), value.shape)
        return wide.reshape(-1) if traced else wide[chosen]

    at = library.where(exists, value, library.asarray(values)[..., :1])
    rows = [flat(at), *(flat(library.asarray(leaf)[..., None]) for leaf in leaves)]
    toppled = flat(padded(found.toppled, False))
    edges = _Edges(samples, form, library.stack(rows), toppled, search)
    with np.errstate(all="ignore"):
        if traced or isinstance(subject.motion, Pulse):
            slopes = edges.slopes(moving, None)
            if search.drop_unknown:
                slopes = library.where(library.isfinite(slopes), slopes, 0)
        else:
            times = _while_balanced(edges, flat(padded(found.overturns_beyond, False)))
            early, late = (edges.slopes(moving, until) for until in times)
            # Those taken late, where those taken early are the same.
            same = (abs(late - early) <= _SETTLED * abs(late)).all(axis=0)
            slopes = np.where(same, late, 0.0 if search.drop_unknown else np.nan)
    if traced:
        slopes = jnp.where(exists, slopes.reshape(-1, *value.shape), 0)
    else:
        known = slopes
        slopes = np.zeros((len(moving), *value.shape), value.dtype)
        slopes[:, exists] = known
    total = _products(slopes, [tangents[k] for k in moving])
    return total if room == columns else total[..., :columns]


@jax.jit
def _products(slopes: Any, tangents: Sequence[Any]) -> Any:
    return sum(
        slope * jnp.broadcast_to(jnp.asarray(tangent)[..., None], slope.shape)
        for slope, tangent in zip(slopes, tangents, strict=True)
    )


class _Edges(NamedTuple):
    """Boundaries, one after the other, and the blocks on them."""

    samples: Any
    form: Any  # of the tree of numbers
    rows: Any  # (1 + numbers, boundaries): first the values of the quantity
    toppled: Any
    search: Search

    @property
    def subject(self) -> Subject:
        return eqx.combine(jax.tree.unflatten(self.form, list(self.rows[1:])), self.samples)

    def slopes(self, moving: Sequence[int], until: Any) -> Any:
        """Compute derivatives (numbers, boundaries) with respect to the numbers that move."""
        number = self.rows.shape[1]
        directions = np.repeat(np.array([0, *(k + 1 for k in moving)], np.int32), number)
        times = len(moving) + 1
        traced = is_traced(self.rows)
        library: Any = jnp if traced else np

        def repeated(entries: Any) -> Any:
            return library.tile(entries, times)

        columns = (*map(repeated, (self.rows, self.toppled)), directions)
        if until is not None:
            columns = (*columns, repeated(until))
        static = {
            "form": self.form,
            "search": self.search._replace(max_boundaries=0, halvings=0, alone=False),
        }
        if traced:
            derivatives = _vanishing_slopes(self.samples, directions.size, *columns, **static)
        else:
            derivatives = _shared_out(self.samples, columns, static)
        to_value, *to_numbers = derivatives.reshape(times, number)
        return library.stack([-part / to_value for part in to_numbers])


def _vanishing_slopes(
    samples: Any,
    count: Any,
    rows: Any,
    toppled: Any,
    directions: Any,
    until: Any = None,
    *,
    form: Any,
    search: Search,
) -> Any:
    """Differentiate what is 0 at a boundary, each column in the direction of its row."""

    def vanishing(rows: Any) -> Any:
        at, *numbers = rows
        subject = eqx.combine(jax.tree.unflatten(form, numbers), samples)
        response = respond_at(subject, at, search, until, count)
        margin = response.margin
        if until is not None:
            end = subject_at(subject, at, search).motion.end
            margin = jnp.where(until < end, response.final_rotation, margin)
        return jnp.where(toppled, TOPPLED_ROTATION - response.peak_rotation, margin)

    # One tangent for many blocks compiles faster than many tangents for one.
    tangents = (jnp.arange(len(rows), dtype=jnp.int32)[:, None] == directions[None]).astype(
        rows.dtype
    )
    return jax.jvp(vanishing, (rows,), (tangents,))[1]


@functools.cache
def _compiled(platform: str) -> Callable[..., Any]:
    """`_vanishing_slopes` for a platform."""
    options = compiler_options(platform)
    return jax.jit(
        _vanishing_slopes, static_argnames=("form", "search"), compiler_options=options
    )


def _shared_out(samples: Any, columns: Sequence[Any], static: dict[str, Any]) -> np.ndarray:
    """`_vanishing_slopes` of all columns, by all processors."""
    size = columns[0].shape[-1]
    pieces = -(-size // _ROOM)
    derive = _compiled(jax.default_backend())

    def of_piece(k: int) -> np.ndarray:
        parts = [each[..., k::pieces] for each in columns]
        count = parts[0].shape[-1]
        # Filled up with the last column, which is not followed again.
        room = [
            np.pad(p, [(0, 0)] * (p.ndim - 1) + [(0, _ROOM - count)], "edge") for p in parts
        ]
        return np.asarray(derive(samples, count, *room, **static))[:count]

    whole = np.empty(size, columns[0].dtype)
    separate = mapped(of_piece, range(pieces), max(1, min(pieces, processors())))
    for k, part in enumerate(separate):
        whole[k::pieces] = part
    return whole


# How far motions from both sides of a boundary have come apart when its derivatives are taken,
# in radians and as powers of eps: twice, to compare. What comes later is missing in the first.
_APART = (0.4, 0.2)
_SETTLED = 1e-3  # relative difference of the two, at most


def _while_balanced(edges: _Edges, overturns_beyond: np.ndarray) -> list[np.ndarray]:
    """Two times up to which the motion at each boundary under a long motion is known.

    A block that balances falls to one side or the other before a long motion ends, by what
    rounding says, so that the margin at its end has no derivatives. But as long as it
    balances, every change grows in the same ratio, from which the boundary follows: it does so
    until motions from both sides of the boundary have come apart.
    """
    subject = edges.subject
    at = edges.rows[0]
    eps = float(np.finfo(at.dtype).eps)
    motion = subject_at(subject, at, edges.search).motion
    start = np.broadcast_to(motion.start, at.shape)
    end = np.broadcast_to(motion.end, at.shape)
    # Both sides of the boundary at once.
    sides = np.stack([at, at * (1 + np.where(overturns_beyond, 8, -8) * eps)])

    def apart(until: Any) -> Any:
        response = respond_at(subject, sides[:, None], edges.search, until)
        final, other = np.asarray(response.final_rotation)
        return abs(final - other)

    # Bisected for both distances at once.
    distance = (eps ** np.array(_APART)[:, None]).astype(at.dtype)
    low, high = (np.broadcast_to(time, (len(_APART), at.size)) for time in (start, end))
    together = apart(high) < distance
    for _ in range(12):
        middle = 0.5 * (low + high)
        close = apart(middle) < distance
        low = np.where(close, middle, low)
        high = np.where(close, high, middle)
    # Beyond the end by rounding, which no program then takes for a time before it.
    return [*np.where(together, end * (1 + 16 * eps), high)]
