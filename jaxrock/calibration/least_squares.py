"""Least squares of several sets of measurements side by side, by Levenberg and Marquardt.

The search runs in NumPy; what it calls computes residuals and their derivatives, in a program
that was compiled once.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, PyTree
from typing_extensions import TypeAliasType

from ..validation import is_traced

Values = TypeAliasType("Values", Float[np.ndarray, "..."])
Flags = TypeAliasType("Flags", Bool[np.ndarray, "..."])
Places = TypeAliasType("Places", Int[np.ndarray, "..."])

_ARRIVED = 1e-7  # part of the root of the sum of squares that one more step would take away
_DAMPING = 1e-3  # to begin with, of the squares of the derivatives
# after a step that does what it should, and after one that does harm
_LESS = 0.1
_MORE = 4.0
_AS_EXPECTED = 0.9  # part of the expected fall, from which on a step does what it should
_LEAST_DAMPING = 1e-13
_MOST_DAMPING = 1e6


class Least(NamedTuple):
    """The best numbers of each set, the residuals there, and their derivatives."""

    numbers: Float[np.ndarray, "sets numbers"]
    residuals: Float[np.ndarray, "sets measurements"]
    jacobian: Float[np.ndarray, "sets measurements numbers"]


def check_concrete(tree: PyTree) -> None:
    """Raise `ValueError` if any of the numbers is traced."""
    if is_traced(tree):
        raise ValueError(
            "arguments must be concrete here: a fit is made outside of jit and vmap"
        )


def minimize(
    evaluate: Callable[[Values, Places], tuple[Values, Values]],
    start: Float[np.ndarray, "sets numbers"],
    negligible: float,
    most_steps: int,
) -> Least:
    """Lower the sum of squares of each set as far as it goes.

    `evaluate` takes numbers, a row for each of the sets that are named by their places, and
    returns residuals and their Jacobians; a number that is held has a column of zeros. Sums of
    squares that differ by `negligible` are the same.
    """
    numbers = start.copy()
    places = np.arange(len(start))
    residuals, jacobian = evaluate(numbers, places)
    damping = np.full(len(start), _DAMPING)
    for _ in range(most_steps):
        squares = np.sum(residuals[places] ** 2, axis=1)
        with np.errstate(over="ignore", invalid="ignore"):
            steps, fall, left = _steps(residuals[places], jacobian[places], damping[places])
        searching = ~(left <= _ARRIVED**2 * squares + negligible)
        # Nothing is found where nothing can be computed, and where no step is short enough.
        searching &= np.isfinite(squares) & (damping[places] <= _MOST_DAMPING)
        places = places[searching]
        if not places.size:
            break
        trials = numbers[places] + steps[searching]
        new_residuals, new_jacobian = evaluate(trials, places)
        gain = squares[searching] - np.sum(new_residuals**2, axis=1)
        better = gain > 0
        as_expected = gain >= _AS_EXPECTED * fall[searching]
        damping[places] *= np.where(better, np.where(as_expected, _LESS, 1), _MORE)
        damping = np.maximum(damping, _LEAST_DAMPING)
        moved = places[better]
        numbers[moved] = trials[better]
        residuals[moved] = new_residuals[better]
        jacobian[moved] = new_jacobian[better]
    return Least(numbers, residuals, jacobian)


def _steps(
    residuals: Values, jacobian: Values, damping: Values
) -> tuple[Values, Values, Values]:
    """Compute the next steps; how much sums of squares should fall, and would undamped."""
    scale = np.sqrt(np.sum(jacobian**2, axis=1))
    scale[scale == 0] = 1
    scaled = jacobian / scale[:, None]
    transposed = scaled.swapaxes(1, 2)
    gradient = transposed @ residuals[..., None]
    normal = transposed @ scaled
    identity = np.eye(scale.shape[1])
    newton = np.linalg.solve(normal + _LEAST_DAMPING * identity, gradient)[..., 0]
    damped = np.linalg.solve(normal + damping[:, None, None] * identity, gradient)[..., 0]
    gradient = gradient[..., 0]
    fall = np.sum(damped * (gradient + damping[:, None] * damped), axis=1)
    return -damped / scale, fall, np.sum(newton * gradient, axis=1)


def directions_of(jacobian: Float[np.ndarray, "measurements free"]) -> Values:
    """Orthonormal changes of the residuals that the numbers can make."""
    return np.linalg.qr(_scaled(jacobian)[0])[0]


def covariance_of(jacobian: Float[np.ndarray, "measurements free"]) -> Values:
    """Covariance of the numbers, of residuals of standard deviation 1; NaN if one has no effect."""
    scaled, scale = _scaled(jacobian)
    if not (np.isfinite(jacobian).all() and (scale > 0).all()):
        return np.full((scale.size, scale.size), np.nan)
    inverse = np.linalg.pinv(scaled) / scale[:, None]
    return inverse @ inverse.T


def _scaled(jacobian: Values) -> tuple[Values, Values]:
    """Columns of length 1, and how long they were."""
    scale = np.sqrt(np.sum(jacobian**2, axis=0))
    return jacobian / np.where(scale > 0, scale, 1), scale
