"""Refinement of the brackets of sign changes, to rounding.

All brackets are refined together. Outside of a transformation NumPy does the bookkeeping, and
the margin is computed only for brackets that are still wide.
"""

from collections.abc import Callable
from types import ModuleType
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..validation import AnyArray
from .brackets import Brackets

# So many values take about as long as one: 64 lanes of a batch on each of two cores. A fixed
# number, so that every machine finds the same sign changes to the last bit.
_LANES = 128
_MOST_LEVELS = 5  # of bisections at once
_ITERATIONS = 200  # bisection alone needs fewer from any bracket of two floating-point numbers

# From indices of cases and values: the margins there.
Margin = Callable[[AnyArray, AnyArray], AnyArray]


class _Iterate(NamedTuple):
    """Three values and their margins; the sign changes between the first two.

    The first is the newest value, the second the other end, the third was an end before.
    """

    x: tuple[AnyArray, ...]
    f: tuple[AnyArray, ...]
    tolerance: AnyArray

    def has_converged(self) -> AnyArray:
        """Tell where the bracket is as narrow as rounding allows."""
        return abs(self.x[1] - self.x[0]) <= self.tolerance


def refine_brackets(
    margin: Margin, pairs: Brackets, traced: bool, alone: bool = False
) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Refine each bracket until its ends are neighbours, to rounding.

    Parameters
    ----------
    margin : callable
    pairs : Brackets
    traced : bool
        Under a transformation all are refined in one loop, by one method.
    alone : bool
        Whether each sign change is found to the same bits as if there were no others. Else
        the method is the one that is fastest for so many.

    Returns
    -------
    stands, falls : Array
        The ends at which the margin is not negative, and at which it is.
    margin : Array
        At `stands`. NaN where the search failed.
    """
    library: ModuleType = jnp if traced else np
    ends = pairs.ends
    margins = pairs.margins
    eps = float(jnp.finfo(ends[0].dtype).eps)
    tolerance = 4 * eps * library.maximum(abs(ends[0]), abs(ends[1]))
    iterate = _Iterate(ends, margins, tolerance)
    if traced:
        _, iterate = jax.lax.while_loop(
            lambda state: (state[0] < _ITERATIONS) & ~state[1].has_converged().all(),
            lambda state: (
                state[0] + 1,
                _step_chandrupatla(margin, state[1], pairs.case, jnp),
            ),
            (0, iterate),
        )
    else:
        iterate = jax.tree.map(np.array, iterate)  # which is then changed in place
        for _ in range(_ITERATIONS):
            wide = np.flatnonzero(~iterate.has_converged())
            if not wide.size:
                break
            # Only those that are still wide: each margin is the motion of a block.
            leaves, structure = jax.tree.flatten(iterate)
            selected = jax.tree.unflatten(structure, [leaf[wide] for leaf in leaves])
            # Few values take as long as a batch of them, so that all of it is used.
            parts = _LANES // wide.size
            if alone:
                levels = max((parts + 1).bit_length() - 1, 1)
                better = _step_ahead(
                    margin, selected, pairs.case[wide], min(levels, _MOST_LEVELS)
                )
            elif parts >= 4:
                better = _multisect(margin, selected, pairs.case[wide], parts // 4 * 4)
            else:
                better = _step_chandrupatla(margin, selected, pairs.case[wide], np)
            # `leaves` are the arrays of `iterate` itself.
            for leaf, new in zip(leaves, jax.tree.leaves(better), strict=True):
                leaf[wide] = new

    x1, x2, _ = iterate.x
    f1, f2, _ = iterate.f
    first = f1 >= 0
    success = iterate.has_converged() & library.isfinite(f1 + f2)
    stands = library.where(first, x1, x2)
    falls = library.where(first, x2, x1)
    return stands, falls, library.where(success, library.where(first, f1, f2), library.nan)


def _step_chandrupatla(
    margin: Margin, iterate: _Iterate, case: AnyArray, library: ModuleType
) -> _Iterate:
    """Take a step of Chandrupatla's method (1997, doi:10.1016/S0965-9978(96)00051-8)."""
    x = _propose_value(iterate, library)
    return _shrink_bracket(iterate, x, margin(case, x), library)


def _propose_value(iterate: _Iterate, library: ModuleType) -> AnyArray:
    """Propose where to look next, by Chandrupatla's method.

    By inverse quadratic interpolation where that is safe, bisection where not, as at a jump.
    """
    (x1, x2, x3), (f1, f2, f3), tolerance = iterate
    # Quotients by 0, where values or margins are equal, make comparisons False: bisection.
    with np.errstate(all="ignore"):
        xi = (x1 - x2) / (x3 - x2)
        phi = (f1 - f2) / (f3 - f2)
        inner = f1 / (f2 - f1) * f3 / (f2 - f3)
        outer = (x3 - x1) / (x2 - x1) * f1 / (f3 - f1) * f2 / (f3 - f2)
        least = tolerance / (2 * abs(x2 - x1))
        smooth = (phi**2 < xi) & ((1 - phi) ** 2 < 1 - xi)
        share = library.where(smooth, inner + outer, 0.5)
    # Not closer to an end than half of the tolerance, where the margin would be the same.
    share = library.clip(share, least, 1 - least)
    return library.where(iterate.has_converged(), x1, x1 + share * (x2 - x1))


def _shrink_bracket(
    iterate: _Iterate, x: AnyArray, f: AnyArray, library: ModuleType
) -> _Iterate:
    """Shrink the interval of the sign change to one that ends at a value inside."""
    (x1, x2, _), (f1, f2, _), tolerance = iterate
    same = (f < 0) == (f1 < 0)
    others = [library.where(same, *pair) for pair in ((x2, x1), (x1, x2), (f2, f1), (f1, f2))]
    new = _Iterate((x, *others[:2]), (f, *others[2:]), tolerance)
    # Converged ones must stay: in a loop they wait for the others.
    done = iterate.has_converged()
    return jax.tree.map(lambda old, new: library.where(done, old, new), iterate, new)


def _step_ahead(margin: Margin, iterate: _Iterate, case: AnyArray, levels: int) -> _Iterate:
    """Take up to `levels` steps of Chandrupatla's method at once, to the same bits.

    At a jump nearly all of them are bisections: margins are computed where these would look,
    and the method is followed as far as they go.
    """
    (x1, x2, _), _, _ = iterate

    # The tree of bisections that may follow: 1, 2, 4, ... values. They are computed by the
    # formula of `_propose_value`, so that their bits are those that it will ask for.
    x = _propose_value(iterate, np)
    tried = [x]
    halves = [(x, x2), (x, x1)]
    for _ in range(levels - 1):
        middles = [near + 0.5 * (far - near) for near, far in halves]
        tried += middles
        halves = [
            (middle, end)
            for middle, ends in zip(middles, halves, strict=True)
            for end in reversed(ends)
        ]
    at = np.stack(tried, axis=1)
    margins = margin(np.repeat(case, at.shape[1]), at.reshape(-1)).reshape(at.shape)

    # Follow the method as long as it asks for known margins; the rest waits for another call.
    rows = np.arange(len(at))
    for _ in range(levels):
        x = _propose_value(iterate, np)
        found = at == x[:, None]
        known = found.any(axis=1)
        better = _shrink_bracket(iterate, x, margins[rows, found.argmax(axis=1)], np)
        iterate = jax.tree.map(
            lambda old, new, k=known: np.where(k, new, old), iterate, better
        )
    return iterate


def _multisect(margin: Margin, iterate: _Iterate, case: AnyArray, parts: int) -> _Iterate:
    """Divide a bracket at `parts` values, and keep the first part with a sign change.

    Half of the values are equidistant, the others approach the secant's root from both sides.
    """
    (x1, x2, _), (f1, f2, _), tolerance = iterate
    span = x2 - x1
    with np.errstate(all="ignore"):
        guess = f1 / (f1 - f2)
        least = tolerance / (4 * abs(span))
    # Of infinite margins there is no secant.
    guess = np.where(np.isfinite(guess), guess, 0.5)
    even = (np.arange(parts // 2) + 1) / (parts // 2 + 1)
    # In a geometric sequence, down to where floating-point numbers no longer differ.
    near = least[:, None] ** (1 - np.arange(parts // 4) / (parts // 4))[None]
    near = np.concatenate([guess[:, None] - near, guess[:, None] + near], axis=1)
    share = np.concatenate([np.broadcast_to(even, (len(x1), even.size)), near], axis=1)
    share = np.sort(np.clip(share, least[:, None], 1 - least[:, None]), axis=1)
    x = (x1[:, None] + share * span[:, None]).astype(x1.dtype)
    f = margin(np.repeat(case, x.shape[1]), x.reshape(-1)).reshape(x.shape)

    # The first of the intervals with a sign change, and the value next to it.
    x = np.concatenate([x1[:, None], x, x2[:, None]], axis=1)
    f = np.concatenate([f1[:, None], f, f2[:, None]], axis=1)
    left = ((f[:, 1:] < 0) != (f[:, :-1] < 0)).argmax(axis=1)
    third = np.where(left > 0, left - 1, left + 2)
    rows = np.arange(len(x1))
    x, f = (tuple(part[rows, at] for at in (left, left + 1, third)) for part in (x, f))
    return _Iterate(x, f, tolerance)
