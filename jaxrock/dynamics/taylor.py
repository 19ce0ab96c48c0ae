"""Truncated power series, and that of the rotation in time.

The equation of motion has one sine and one cosine, whose argument follows in time from the
equation itself: one evaluation gives the whole Taylor polynomial of the motion, which is its
own dense output.
"""

import itertools
import math
from typing import Any, NamedTuple, Union

import jax
import jax.numpy as jnp

from ..validation import Reals
from .equation import Equation

Coefficients = tuple[Reals | float, ...]


class Series(NamedTuple):
    """A polynomial ``sum c_k t^k``."""

    c: Coefficients

    def __add__(self, other: float) -> "Series":  # type: ignore[override]
        return Series((self.c[0] + other, *self.c[1:])) if self.c else Series((other,))

    def __sub__(self, other: "Series") -> "Series":
        pairs = itertools.zip_longest(self.c, other.c, fillvalue=0.0)
        return Series(tuple(a - b for a, b in pairs))

    def __mul__(self, other: Union["Series", Reals]) -> "Series":  # type: ignore[override]
        if not isinstance(other, Series):
            return Series(tuple(a * other for a in self.c))
        terms: dict[int, Any] = {}
        for (j, a), (k, b) in itertools.product(enumerate(self.c), enumerate(other.c)):
            terms[j + k] = terms[j + k] + a * b if j + k in terms else a * b
        return Series(tuple(terms.values()))


def sine_cosine(angle: Reals) -> tuple[Reals, Reals]:
    """Sine and cosine of angles up to pi / 2, to 2 eps.

    By polynomials, which run on SIMD lanes; the functions that XLA has for float64 do not.
    """
    square = angle * angle
    sine = cosine = jnp.zeros_like(angle)
    for k in reversed(range(11)):
        sine = sine * square + (-1) ** k / math.factorial(2 * k + 1)
    for k in reversed(range(12)):
        cosine = cosine * square + (-1) ** k / math.factorial(2 * k)
    return angle * sine, cosine


def materialized(values: Any) -> Any:
    """The values, computed here and once: XLA would compute them again wherever they are used."""
    return jax.lax.optimization_barrier(values)


def rotation_series(
    equation: Equation,
    rotation: Reals,
    velocity: Reals,
    push: Coefficients,
    lift: Coefficients,
    order: int,
) -> Coefficients:
    """Taylor coefficients of the rotation in time, up to an order, from those of the ground.

    With q = alpha_c - rotation, ``(sin q)' = q' cos q`` and ``(cos q)' = -q' sin q`` give the
    coefficients of sine and cosine one after the other.
    """
    c: list[Any] = [rotation, velocity]
    q: list[Any] = [equation.critical_angle - rotation, -velocity]
    if equation.linearized:
        sine, cosine = [q[0]], [1.0]
    else:
        # A barrier: both enter every coefficient.
        sine, cosine = ([part] for part in materialized(sine_cosine(q[0])))
    for k in range(order - 1):
        if k and equation.linearized:
            sine.append(q[k])
        elif k:
            sine.append(sum(j / k * q[j] * cosine[k - j] for j in range(1, k + 1)))
            cosine.append(sum(-j / k * q[j] * sine[k - j] for j in range(1, k + 1)))
        parts = (Series(tuple(part)) for part in (sine, cosine, push, lift))
        # A barrier: each coefficient enters all later ones, and XLA would compute it again there.
        c.append(materialized(equation.right_hand_side(*parts).c[k] * (1 / ((k + 1) * (k + 2)))))
        q.append(-c[-1])
    return tuple(c)


def evaluate(c: Coefficients, time: Reals) -> Reals:
    """The value of the series at a time."""
    total: Any = c[-1]
    for part in reversed(c[:-1]):
        total = total * time + part
    return total


def derivative(c: Coefficients) -> Coefficients:
    """The series of the derivative."""
    return tuple(k * part for k, part in enumerate(c))[1:]
