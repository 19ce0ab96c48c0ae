"""Least squares of several sets of measurements side by side, by Levenberg and Marquardt.

The search runs in NumPy: sets that have arrived leave it, and JAX would compile a program for
each number of sets that remain. The function it calls computes residuals and derivatives in a
program that was compiled once. See Levenberg (1944, 10.1090/qam/10666) and Marquardt (1963,
10.1137/0111030).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from typing_extensions import TypeAliasType

Values = TypeAliasType("Values", Float[np.ndarray, "..."])
Flags = TypeAliasType("Flags", Bool[np.ndarray, "..."])
Places = TypeAliasType("Places", Int[np.ndarray, "..."])

# Part of the root of the sum of squares that one more step would take away. Its square, 1e-14,
# is some fifty units in the last place of the sum: a smaller fall drowns in rounding.
_ARRIVED = 1e-7
_DAMPING = 1e-3  # to begin with, of the squares of the derivatives
# Factors of the damping after a step that does what it should, and after one that does harm.
_LESS = 0.1
_MORE = 4.0
_AS_EXPECTED = 0.9  # part of the expected fall, from which on a step does what it should
# The scaled normal matrix has a diagonal of 1: this is above its rounding, and keeps the rows
# of numbers that are held, which are zero, from making it singular.
_LEAST_DAMPING = 1e-13
_MOST_DAMPING = 1e6  # steps are then about a millionth of Gauss-Newton steps


# Why no argument of a fit may be traced.
OUTSIDE = "a fit searches on the host"


class Least(NamedTuple):
    """The best numbers of each set, the residuals there, and their derivatives."""

    numbers: Float[np.ndarray, "sets numbers"]
    residuals: Float[np.ndarray, "sets measurements"]
    jacobian: Float[np.ndarray, "sets measurements numbers"]


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
    # A set is in one of these states; every turn of the loop moves each of those in `places`.
    #
    # state     | how it is told                                 | what happens next
    # ----------|------------------------------------------------|-----------------------------
    # searching | an undamped step would still lower the sum     | it tries a damped step
    # better    | the trial has a lower sum of squares           | it goes there
    #           | ... and by at least 0.9 of what was expected   | and damping falls to a tenth
    # worse     | the trial has no lower sum, or is no number    | it stays, damping times four
    # arrived   | an undamped step would lower nothing           | it leaves `places`
    # lost      | its sum is infinite, or its damping too high   | it leaves `places`
    numbers = start.copy()
    places = np.arange(len(start))
    residuals, jacobian = evaluate(numbers, places)
    damping = np.full(len(start), _DAMPING)
    for _ in range(most_steps):
        squares = np.sum(residuals[places] ** 2, axis=1)
        with np.errstate(over="ignore", invalid="ignore"):
            steps, fall, left = _compute_steps(
                residuals[places], jacobian[places], damping[places]
            )
        # The undamped step decides: a damped one is short far from the minimum, too.
        searching = ~(left <= _ARRIVED**2 * squares + negligible)
        # Nothing is found where nothing can be computed, and where no step is short enough.
        searching &= np.isfinite(squares) & (damping[places] <= _MOST_DAMPING)
        places = places[searching]
        if not places.size:
            break
        trials = numbers[places] + steps[searching]
        new_residuals, new_jacobian = evaluate(trials, places)
        gain = squares[searching] - np.sum(new_residuals**2, axis=1)
        better = gain > 0  # false if the trial is not a number, as where a motion overturns
        # A step that helps less than expected has left the range in which the problem is
        # linear: it counts, but with less damping the next one would only go further astray.
        as_expected = gain >= _AS_EXPECTED * fall[searching]
        damping[places] *= np.where(better, np.where(as_expected, _LESS, 1), _MORE)
        damping = np.maximum(damping, _LEAST_DAMPING)
        moved = places[better]
        numbers[moved] = trials[better]
        residuals[moved] = new_residuals[better]
        jacobian[moved] = new_jacobian[better]
    return Least(numbers, residuals, jacobian)


def _compute_steps(
    residuals: Values, jacobian: Values, damping: Values
) -> tuple[Values, Values, Values]:
    """Compute the next steps, the falls of the sums of squares expected, and without damping.

    The falls are those of the linearized problem: with J'J d + k d = J'r, the sum of squares
    falls by d (J'r + k d).
    """
    # Columns of length 1 make the damping independent of units, as Marquardt has it.
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


def orthonormalize(jacobian: Float[np.ndarray, "measurements free"]) -> Values:
    """Return orthonormal vectors that span all changes of the residuals by the numbers.

    The part of the residuals along them is what a Gauss-Newton step would take away; their
    squares, summed over a row, are the leverage of that measurement.
    """
    return np.linalg.qr(_scale_columns(jacobian)[0])[0]


def compute_covariance(jacobian: Float[np.ndarray, "measurements free"]) -> Values:
    """Compute the covariance of numbers fitted to residuals of standard deviation 1.

    It is NaN if one of the numbers has no effect.
    """
    scaled, scale = _scale_columns(jacobian)
    if not (np.isfinite(jacobian).all() and (scale > 0).all()):
        return np.full((scale.size, scale.size), np.nan)
    # By the Jacobian itself: the normal matrix would square its condition, and with it lose
    # the errors of a p that hardly shows.
    inverse = np.linalg.pinv(scaled) / scale[:, None]
    return inverse @ inverse.T


def _scale_columns(jacobian: Values) -> tuple[Values, Values]:
    """Scale columns to length 1, and return how long they were."""
    scale = np.sqrt(np.sum(jacobian**2, axis=0))
    return jacobian / np.where(scale > 0, scale, 1), scale
