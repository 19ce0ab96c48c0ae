"""Truncated power series, and the one of a lean in time.

The equation of motion has one sine and one cosine, and what their argument does in time
follows from the equation itself: one evaluation gives the whole Taylor polynomial of the
motion, which is its own dense output.
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
    """Sine and cosine of angles of up to a right one, to 2 eps.

    By polynomials, which run on vectors of the processor; what XLA has for float64 does
    not.
    """
    square = angle * angle
    sine = cosine = jnp.zeros_like(angle)
    for k in reversed(range(11)):
        sine = sine * square + (-1) ** k / math.factorial(2 * k + 1)
    for k in reversed(range(12)):
        cosine = cosine * square + (-1) ** k / math.factorial(2 * k)
    return angle * sine, cosine


def kept(values: Any) -> Any:
    """Have values computed here, once: XLA would compute them again wherever they are used."""
    return jax.lax.optimization_barrier(values)


def lean_series(
    equation: Equation,
    lean: Reals,
    speed: Reals,
    push: Coefficients,
    lift: Coefficients,
    order: int,
) -> Coefficients:
    """Taylor coefficients of the lean in time, up to `order`, from those of the ground.

    With q = alpha_c - lean, ``(sin q)' = q' cos q`` and ``(cos q)' = -q' sin q`` give the
    coefficients of sine and cosine one after the other.
    """
    c: list[Any] = [lean, speed]
    q: list[Any] = [equation.critical_angle - lean, -speed]
    if equation.linearized:
        sine, cosine = [q[0]], [1.0]
    else:
        sine, cosine = ([part] for part in kept(sine_cosine(q[0])))
    for k in range(order - 1):
        if k and equation.linearized:
            sine.append(q[k])
        elif k:
            sine.append(sum(j / k * q[j] * cosine[k - j] for j in range(1, k + 1)))
            cosine.append(sum(-j / k * q[j] * sine[k - j] for j in range(1, k + 1)))
        parts = (Series(tuple(part)) for part in (sine, cosine, push, lift))
        c.append(kept(equation.lean_acceleration(*parts).c[k] * (1 / ((k + 1) * (k + 2)))))
        q.append(-c[-1])
    return tuple(c)


def evaluate(c: Coefficients, time: Reals) -> Reals:
    """The series at a time."""
    total: Any = c[-1]
    for part in reversed(c[:-1]):
        total = total * time + part
    return total


def derivative(c: Coefficients) -> Coefficients:
    """The series of the derivative."""
    return tuple(k * part for k, part in enumerate(c))[1:]
