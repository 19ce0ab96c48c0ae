"""Refinement of the brackets of sign changes, to a tolerance or to rounding.

All brackets are refined together. Outside of a transformation NumPy does the bookkeeping, and
evaluations are made only for brackets that are still wide.
"""

from collections.abc import Callable
from types import ModuleType
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from ..host import count_work
from ..validation import AnyArray
from .brackets import Brackets, Evaluate, EvaluatedMargin

_Tree = TypeVar("_Tree")

# So many values take about as long as one: 64 lanes of a batch on each of two cores. A fixed
# number, so that every machine finds the same sign changes to the last bit.
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

    @property
    def f(self) -> list[AnyArray]:
        """The margins."""
        return [evaluation.margin for evaluation in self.at]

    def has_converged(self) -> AnyArray:
        """Check where the bracket is as narrow as the tolerance."""
        return abs(self.x[1] - self.x[0]) <= self.tolerance


def refine_brackets(
    evaluate: Evaluate,
    pairs: Brackets,
    traced: bool,
    alone: bool = False,
    tolerance: float | None = None,
) -> SignChanges:
    """Refine each bracket until it is as narrow as a tolerance.

    Parameters
    ----------
    evaluate : callable
    pairs : Brackets
    traced : bool
        Under a transformation all are refined in one loop, by one method.
    alone : bool
        Whether each sign change is found to the same bits as if there were no others. Else
        the method is the one that is fastest for so many.
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
    propose = _propose_value if tolerance is None else _propose_middle
    if traced:
        _, iterate = jax.lax.while_loop(
            lambda state: (state[0] < _ITERATIONS) & ~state[1].has_converged().all(),
            lambda state: (
                state[0] + 1,
                _take_step(evaluate, propose, state[1], pairs.case, jnp),
            ),
            (0, iterate),
        )
    else:
        iterate = jax.tree.map(np.array, iterate)  # which is then changed in place
        with count_work("boundaries between values"):
            for _ in range(_ITERATIONS):
                wide = np.flatnonzero(~iterate.has_converged())
                if not wide.size:
                    break
                # Only those that are still wide: each evaluation is the motion of a block.
                leaves, structure = jax.tree.flatten(iterate)
                selected = jax.tree.unflatten(structure, [leaf[wide] for leaf in leaves])
                # Few values take as long as a batch of them, so that all of it is used.
                parts = _LANES // wide.size
                case = pairs.case[wide]
                if alone:
                    levels = min(max((parts + 1).bit_length() - 1, 1), _MOST_LEVELS)
                    better = _step_ahead(evaluate, propose, selected, case, levels)
                elif parts >= 4 and tolerance is None:
                    better = _multisect(evaluate, selected, case, parts // 4 * 4)
                else:
                    better = _take_step(evaluate, propose, selected, case, np)
                # `leaves` are the arrays of `iterate` itself.
                for leaf, new in zip(leaves, jax.tree.leaves(better), strict=True):
                    leaf[wide] = new

    x1, x2, _ = iterate.x
    at1, at2, _ = iterate.at
    first = at1.margin >= 0
    stands, at_stands = _select(first, (x1, at1), (x2, at2), library)
    falls, at_falls = _select(first, (x2, at2), (x1, at1), library)
    success = iterate.has_converged() & library.isfinite(at1.margin + at2.margin)
    return SignChanges(stands, falls, at_stands, at_falls, success)


def _select(where: AnyArray, this: _Tree, that: _Tree, library: ModuleType) -> _Tree:
    """Select the entries of one tree where a condition is true, and else of the other."""
    return jax.tree.map(lambda a, b: library.where(where, a, b), this, that)


# Proposes where to look next.
_Propose = Callable[[_Iterate, ModuleType], AnyArray]


def _take_step(
    evaluate: Evaluate,
    propose: _Propose,
    iterate: _Iterate,
    case: AnyArray,
    library: ModuleType,
) -> _Iterate:
    """Take a step of a method: evaluate where it proposes, and shrink the bracket."""
    x = propose(iterate, library)
    return _shrink_bracket(iterate, x, evaluate(case, x), library)


def _propose_middle(iterate: _Iterate, library: ModuleType) -> AnyArray:
    """Propose the middle of the bracket."""
    x1, x2, _ = iterate.x
    return library.where(iterate.has_converged(), x1, compute_middle(x1, x2))


def compute_middle(low: AnyArray, high: AnyArray) -> AnyArray:
    """Compute the middle of intervals, to the same bits in all searches for boundaries."""
    return 0.5 * (low + high)


def _propose_value(iterate: _Iterate, library: ModuleType) -> AnyArray:
    """Propose where to look next, by Chandrupatla's method.

    After Chandrupatla (1997, doi:10.1016/S0965-9978(96)00051-8). By inverse quadratic
    interpolation where that is safe, bisection where not, as at a jump.
    """
    x1, x2, x3 = iterate.x
    f1, f2, f3 = iterate.f
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
    fraction = library.clip(fraction, least, 1 - least)
    return library.where(iterate.has_converged(), x1, x1 + fraction * (x2 - x1))


def _shrink_bracket(
    iterate: _Iterate, x: AnyArray, at: EvaluatedMargin, library: ModuleType
) -> _Iterate:
    """Shrink the interval of the sign change to one that ends at a value inside."""
    first, second, _ = zip(iterate.x, iterate.at, strict=True)
    same = (at.margin < 0) == (first[1].margin < 0)
    end, at_end = _select(same, second, first, library)
    before, at_before = _select(same, first, second, library)
    better = _Iterate((x, end, before), (at, at_end, at_before), iterate.tolerance)
    # Converged ones must stay: in a loop they wait for the others.
    return _select(iterate.has_converged(), iterate, better, library)


def _step_ahead(
    evaluate: Evaluate, propose: _Propose, iterate: _Iterate, case: AnyArray, levels: int
) -> _Iterate:
    """Take up to `levels` steps of a method at once, to the same bits.

    At a jump nearly all of them are bisections: evaluations are made where these would look,
    and the method goes on as far as they reach.
    """
    x1, x2, _ = iterate.x

    # The tree of bisections that may come next: 1, 2, 4, ... values. They are computed by the
    # formulas of the proposals, so that their bits are those that these will ask for.
    x = propose(iterate, np)
    tried = [x]
    halves = [(x, x2), (x, x1)]
    for _ in range(levels - 1):
        if propose is _propose_middle:
            middles = [compute_middle(near, far) for near, far in halves]
        else:
            middles = [near + 0.5 * (far - near) for near, far in halves]
        tried += middles
        halves = [
            (middle, end)
            for middle, ends in zip(middles, halves, strict=True)
            for end in reversed(ends)
        ]
    values = np.stack(tried, axis=1)
    known = _evaluate_table(evaluate, case, values)

    # Go on as long as the method asks for known values; what is left waits for another call.
    rows = np.arange(len(values))
    for _ in range(levels):
        x = propose(iterate, np)
        equal = values == x[:, None]
        column = equal.argmax(axis=1)
        at = jax.tree.map(lambda leaf, column=column: leaf[rows, column], known)
        better = _shrink_bracket(iterate, x, at, np)
        iterate = _select(equal.any(axis=1), better, iterate, np)
    return iterate


def _evaluate_table(evaluate: Evaluate, case: AnyArray, values: AnyArray) -> EvaluatedMargin:
    """Evaluate at several values of each case, shape (cases, values)."""
    flat = evaluate(np.repeat(case, values.shape[1]), values.reshape(-1))
    return jax.tree.map(lambda leaf: leaf.reshape(values.shape), flat)


def _multisect(evaluate: Evaluate, iterate: _Iterate, case: AnyArray, parts: int) -> _Iterate:
    """Divide a bracket at `parts` values, and keep the first part with a sign change.

    Half of the values are equidistant, the others approach the secant's root from both sides.
    """
    x1, x2, _ = iterate.x
    f1, f2, _ = iterate.f
    span = x2 - x1
    with np.errstate(all="ignore"):
        guess = f1 / (f1 - f2)
        least = iterate.tolerance / (4 * abs(span))
    # Of infinite margins there is no secant.
    guess = np.where(np.isfinite(guess), guess, 0.5)
    even = (np.arange(parts // 2) + 1) / (parts // 2 + 1)
    # In a geometric sequence, down to where floating-point numbers no longer differ.
    near = least[:, None] ** (1 - np.arange(parts // 4) / (parts // 4))[None]
    near = np.concatenate([guess[:, None] - near, guess[:, None] + near], axis=1)
    even = np.broadcast_to(even, (len(x1), even.size))
    fraction = np.concatenate([even, near], axis=1)
    fraction = np.sort(np.clip(fraction, least[:, None], 1 - least[:, None]), axis=1)
    x = (x1[:, None] + fraction * span[:, None]).astype(x1.dtype)
    at = _evaluate_table(evaluate, case, x)

    # The first of the intervals with a sign change, and the value next to it.
    first, second, _ = zip(iterate.x, iterate.at, strict=True)
    x, at = jax.tree.map(
        lambda begin, inner, end: np.concatenate(
            [begin[:, None], inner, end[:, None]], axis=1
        ),
        first,
        (x, at),
        second,
    )
    negative = at.margin < 0
    left = (negative[:, 1:] != negative[:, :-1]).argmax(axis=1)
    third = np.where(left > 0, left - 1, left + 2)
    rows = np.arange(len(x1))
    chosen = [
        jax.tree.map(lambda leaf, column=column: leaf[rows, column], (x, at))
        for column in (left, left + 1, third)
    ]
    ends, evaluations = zip(*chosen, strict=True)
    return _Iterate(ends, evaluations, iterate.tolerance)
