"""Truncated power series, and the one of a lean in time.

The equation of motion has one sine and one cosine, and what their argument does in time
follows from the equation itself: one evaluation gives the whole Taylor polynomial of the
motion, which is its own dense output.
"""

import math
from typing import Any, NamedTuple, Union

import jax.numpy as jnp

from .arguments import Reals
from .equation import Equation

Coefficients = tuple[Reals, ...]


class Series(NamedTuple):
    """``sum c_k t^k``; sums and products are cut off at the shorter one."""

    c: Coefficients

    def __add__(self, other: Union["Series", float, int]) -> "Series":  # type: ignore[override]
        if isinstance(other, Series):
            return Series(tuple(a + b for a, b in zip(self.c, other.c, strict=False)))
        return Series((self.c[0] + other, *self.c[1:]))

    def __sub__(self, other: "Series") -> "Series":
        return Series(tuple(a - b for a, b in zip(self.c, other.c, strict=False)))

    def __mul__(self, other: Union["Series", Reals]) -> "Series":  # type: ignore[override]
        if not isinstance(other, Series):
            return Series(tuple(a * other for a in self.c))
        orders = range(min(len(self.c), len(other.c)))
        return Series(
            tuple(
                sum(
                    (self.c[j] * other.c[k - j] for j in range(1, k + 1)),
                    start=self.c[0] * other.c[k],
                )
                for k in orders
            )
        )


def sine_cosine(angle: Reals) -> tuple[Reals, Reals]:
    """Sine and cosine of angles of a few pi at most, to 2 eps.

    By polynomials on a quarter period each, which run on vectors of the processor; what XLA
    has for float64 does not.
    """
    turns = jnp.round(angle * (1 / math.pi))
    # pi in two parts, of which the first times a small number is exact
    rest = (angle - turns * 3.140625) - turns * 9.67653589793115997963e-4
    sign = 1 - 2 * (turns - 2 * jnp.floor(0.5 * turns))
    square = rest * rest
    sine = cosine = jnp.zeros_like(rest)
    for k in reversed(range(10)):
        sine = sine * square + (-1) ** k / math.factorial(2 * k + 1)
    for k in reversed(range(11)):
        cosine = cosine * square + (-1) ** k / math.factorial(2 * k)
    return sign * rest * sine, sign * cosine


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
    zero = jnp.zeros_like(lean)
    push, lift = ((*c, *(zero for _ in range(order))) for c in (push, lift))
    c: list[Any] = [lean, speed]
    q: list[Any] = [equation.critical_angle - lean, -speed]
    sine: list[Any]
    cosine: list[Any]
    if equation.linearized:
        sine, cosine = [q[0]], [jnp.ones_like(lean)]
    else:
        s, k = sine_cosine(q[0])
        sine, cosine = [s], [k]
    for k in range(order - 1):
        if k and equation.linearized:
            sine.append(q[k])
            cosine.append(zero)
        elif k:
            sine.append(sum(j * q[j] * cosine[k - j] for j in range(1, k + 1)) / k)
            cosine.append(-sum(j * q[j] * sine[k - j] for j in range(1, k + 1)) / k)
        parts = (Series(tuple(part[: k + 1])) for part in (sine, cosine, push, lift))
        c.append(equation.lean_acceleration(*parts).c[k] / ((k + 1) * (k + 2)))
        q.append(-c[-1])
    return tuple(c)


def evaluate(c: Coefficients, time: Reals) -> Reals:
    """The series at a time."""
    total = c[-1]
    for part in reversed(c[:-1]):
        total = total * time + part
    return total


def derivative(c: Coefficients) -> Coefficients:
    """The series of the derivative."""
    return tuple(k * part for k, part in enumerate(c))[1:]
