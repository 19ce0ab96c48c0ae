"""Refinement of the brackets of sign changes, to a tolerance or to rounding.

All brackets are refined together, by Chandrupatla's method (1997,
doi:10.1016/S0965-9978(96)00051-8) or by bisection, each as if there were no others. Outside of
a transformation NumPy does the bookkeeping, and evaluations are made only for brackets that are
still wide.
"""

from types import ModuleType
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from ..host import count_work
from ..validation import AnyArray, Integers
from .brackets import Brackets, Evaluate, EvaluatedMargin

_Tree = TypeVar("_Tree")

# So many values take little longer than one: 64 lanes of a batch on each of two cores.
_LANES = 128
_MOST_LEVELS = 5  # of bisections at once
_ITERATIONS = 200  # bisection alone needs fewer from any bracket of two floating-point numbers


class SignChanges(NamedTuple):
    """Both ends of brackets that have been refined, with what is known there."""

    stands: AnyArray  # the values at which the margin is not negative
    falls: AnyArray  # the values at which it is negative
    at_stands: EvaluatedMargin
    at_falls: EvaluatedMargin
    success: AnyArray  # False where a margin is not finite, or the bracket is still wide


class _Iterate(NamedTuple):
    """Three values and the evaluations there; the sign changes between the first two.

    The first is the newest value, the second the other end, the third was an end before.
    """

    x: tuple[AnyArray, ...]
    at: tuple[EvaluatedMargin, ...]
    tolerance: AnyArray

    def has_converged(self) -> AnyArray:
        """Check where the bracket is as narrow as the tolerance."""
        return abs(self.x[1] - self.x[0]) <= self.tolerance


def refine_brackets(
    evaluate: Evaluate, pairs: Brackets, traced: bool, tolerance: float | None = None
) -> SignChanges:
    """Refine each bracket until it is as narrow as a tolerance.

    Parameters
    ----------
    evaluate : callable
    pairs : Brackets
    traced : bool
        Under a transformation all are refined in one loop.
    tolerance : float, optional
        Width relative to the values at the ends, at which a bracket is not refined further
        [-]. With a tolerance brackets are bisected: of several sign changes in one the same is
        found whatever the tolerance is. By default, and at least, as rounding allows: the ends
        are neighbours.

    Returns
    -------
    SignChanges
    """
    library: ModuleType = jnp if traced else np
    ends = pairs.ends
    relative = max(4 * float(jnp.finfo(ends[0].dtype).eps), tolerance or 0.0)
    widest = relative * library.maximum(abs(ends[0]), abs(ends[1]))
    iterate = _Iterate(ends, pairs.evaluations, widest)
    bisects = tolerance is not None
    if traced:

        def take_step(state: tuple[Integers, _Iterate]) -> tuple[Integers, _Iterate]:
            count, iterate = state
            x = _propose_value(iterate, bisects, jnp)
            return count + 1, _shrink_bracket(iterate, x, evaluate(pairs.case, x), jnp)

        _, iterate = jax.lax.while_loop(
            lambda state: (state[0] < _ITERATIONS) & ~state[1].has_converged().all(),
            take_step,
            (jnp.asarray(0), iterate),
        )
    else:
        iterate = jax.tree.map(np.array, iterate)  # which is then changed in place
        with count_work("boundaries between values"):
            for _ in range(_ITERATIONS):
                wide = np.flatnonzero(~iterate.has_converged())
                if not wide.size:
                    break
                # Only those that are still wide: each evaluation is the motion of a block.
                selected = jax.tree.map(lambda leaf, wide=wide: leaf[wide], iterate)
                better = _step_ahead(evaluate, bisects, selected, pairs.case[wide])
                jax.tree.map(
                    lambda leaf, new, wide=wide: np.put(leaf, wide, new), iterate, better
                )

    x1, x2, _ = iterate.x
    at1, at2, _ = iterate.at
    first = at1.margin >= 0
    stands, at_stands = select_tree(first, (x1, at1), (x2, at2), library)
    falls, at_falls = select_tree(first, (x2, at2), (x1, at1), library)
    success = iterate.has_converged() & library.isfinite(at1.margin + at2.margin)
    return SignChanges(stands, falls, at_stands, at_falls, success)


def select_tree(
    condition: AnyArray, first: _Tree, second: _Tree, library: ModuleType = jnp
) -> _Tree:
    """Select the entries of one tree where a condition is true, and else of the other."""
    return jax.tree.map(lambda a, b: library.where(condition, a, b), first, second)


def _propose_value(iterate: _Iterate, bisects: bool, library: ModuleType) -> AnyArray:
    """Propose where to look next: the middle, or where Chandrupatla's method interpolates."""
    x1, x2, _ = iterate.x
    fraction = 0.5 if bisects else _interpolate(iterate, library)
    return library.where(iterate.has_converged(), x1, x1 + fraction * (x2 - x1))


def _interpolate(iterate: _Iterate, library: ModuleType) -> AnyArray:
    """Interpolate inverse quadratically where that is safe, else bisect, as at a jump.

    Returns the place as a fraction of the bracket.
    """
    x1, x2, x3 = iterate.x
    f1, f2, f3 = (evaluation.margin for evaluation in iterate.at)
    # Quotients by 0, where values or margins are equal, make comparisons False: bisection.
    with np.errstate(all="ignore"):
        xi = (x1 - x2) / (x3 - x2)
        phi = (f1 - f2) / (f3 - f2)
        inner = f1 / (f2 - f1) * f3 / (f2 - f3)
        outer = (x3 - x1) / (x2 - x1) * f1 / (f3 - f1) * f2 / (f3 - f2)
        least = iterate.tolerance / (2 * abs(x2 - x1))
        smooth = (phi**2 < xi) & ((1 - phi) ** 2 < 1 - xi)
        fraction = library.where(smooth, inner + outer, 0.5)
    # Not closer to an end than half of the tolerance, where the margin would be the same.
    return library.clip(fraction, least, 1 - least)


def _shrink_bracket(
    iterate: _Iterate, x: AnyArray, at: EvaluatedMargin, library: ModuleType
) -> _Iterate:
    """Shrink the interval of the sign change to one that ends at a value inside."""
    first, second, _ = zip(iterate.x, iterate.at, strict=True)
    same = (at.margin < 0) == (first[1].margin < 0)
    end, at_end = select_tree(same, second, first, library)
    before, at_before = select_tree(same, first, second, library)
    better = _Iterate((x, end, before), (at, at_end, at_before), iterate.tolerance)
    # Converged ones must stay: in a loop they wait for the others.
    return select_tree(iterate.has_converged(), iterate, better, library)


def _step_ahead(
    evaluate: Evaluate, bisects: bool, iterate: _Iterate, case: AnyArray
) -> _Iterate:
    """Take several steps at once, to the same bits, as far as a batch has lanes for them.

    At a jump nearly all steps are bisections: evaluations are made where these would look, and
    the method goes on as far as they reach.
    """
    x1, x2, _ = iterate.x
    x = _propose_value(iterate, bisects, np)
    # Where all are interpolated, no bisection is expected to follow.
    if not (x == x1 + 0.5 * (x2 - x1)).any():
        return _shrink_bracket(iterate, x, evaluate(case, x), np)
    levels = min(max((_LANES // x.size + 1).bit_length() - 1, 1), _MOST_LEVELS)

    # The tree of bisections that may come next: 1, 2, 4, ... values. They are computed by the
    # formula of the proposals, so that their bits are those that these will ask for.
    tree = [x[:, None]]
    newest = np.stack([x, x], axis=1)
    other = np.stack([x1, x2], axis=1)
    for _ in range(levels - 1):
        middle = newest + 0.5 * (other - newest)
        tree.append(middle)
        other = np.concatenate([newest, other], axis=1)
        newest = np.concatenate([middle, middle], axis=1)
    values = np.concatenate(tree, axis=1)
    flat = evaluate(np.repeat(case, values.shape[1]), values.reshape(-1))
    known = jax.tree.map(lambda leaf: leaf.reshape(values.shape), flat)

    # Go on as long as the method asks for known values; what is left waits for another call.
    rows = np.arange(len(values))
    for _ in range(levels):
        x = _propose_value(iterate, bisects, np)
        equal = values == x[:, None]
        column = equal.argmax(axis=1)
        at = jax.tree.map(lambda leaf, column=column: leaf[rows, column], known)
        better = _shrink_bracket(iterate, x, at, np)
        iterate = select_tree(equal.any(axis=1), better, iterate, np)
    return iterate
