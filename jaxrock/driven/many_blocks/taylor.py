"""Truncated power series, and the Taylor series of the rotation in time.

The equation of motion has one sine and one cosine, whose argument follows in time from the
equation itself: one evaluation gives the whole Taylor polynomial of the motion, which is its
own dense output.
"""

import math
from functools import partial
from typing import Any, cast

import jax
import jax.numpy as jnp
from jax.typing import DTypeLike

from ...validation import Booleans, Number, Reals
from ..equation import Equation
from .single_kernels import materialize

Coefficients = tuple[Reals | float, ...]


@jax.custom_jvp
def sine_cosine(angle: Reals) -> tuple[Reals, Reals]:
    """Sine and cosine of angles up to pi / 2, to 2 eps.

    By polynomials, which run on SIMD lanes; the functions that XLA has for float64 do not.
    """
    # Taylor's own: the first term left out is below eps / 2 at pi / 2.
    square = angle * angle
    sine = cosine = jnp.zeros_like(angle)
    for k in reversed(range(11)):
        sine = sine * square + (-1) ** k / math.factorial(2 * k + 1)
    for k in reversed(range(12)):
        cosine = cosine * square + (-1) ** k / math.factorial(2 * k)
    return angle * sine, cosine


@sine_cosine.defjvp
def _turn_sine_cosine(
    primals: tuple[Reals], tangents: tuple[Reals]
) -> tuple[tuple[Reals, Reals], tuple[Reals, Reals]]:
    # The derivatives of the polynomials would be polynomials as long as they are.
    sine, cosine = sine_cosine(*primals)
    (turn,) = tangents
    return (sine, cosine), (cosine * turn, -sine * turn)


def tilt_sine_cosine(equation: Equation, tilt: Reals) -> tuple[Reals, Reals]:
    """Compute sine and cosine of a tilt from balance, as the equation of motion has them."""
    if equation.linearized:
        return tilt, jnp.ones_like(tilt)
    return sine_cosine(tilt)


def _multiply(a: Coefficients, b: Coefficients, k: int) -> Reals | float | int:
    """Compute coefficient `k` of the product of two series."""
    return sum(a[j] * b[k - j] for j in range(len(a)) if 0 <= k - j < len(b))


def expand_rotation(
    equation: Equation,
    rotation: Reals,
    velocity: Reals,
    push: Coefficients,
    lift: Coefficients,
    order: int,
) -> tuple[Reals, ...]:
    """Expand the rotation in time, up to an order, from the series of the ground."""
    block = equation.p_squared, equation.critical_angle
    return _expand(equation.linearized, order, block, (rotation, velocity), push, lift)


def _expand_all(
    linearized: bool,
    order: int,
    block: tuple[Reals, Reals],
    state: tuple[Reals, Reals],
    push: Coefficients,
    lift: Coefficients,
) -> tuple[tuple[Reals, ...], Coefficients, Coefficients]:
    """Expand the rotation, and sine and cosine of the tilt from balance.

    With q = alpha_c - rotation, ``(sin q)' = q' cos q`` and ``(cos q)' = -q' sin q`` give the
    coefficients of sine and cosine one after the other.
    """
    p_squared, angle = block
    rotation, velocity = state
    c: list[Reals] = [rotation, velocity]
    tilt = angle - rotation
    rate: list[Reals] = [-velocity]  # coefficients of q'
    sine: list[Reals | float]
    cosine: list[Reals | float]
    if linearized:
        sine = [tilt]
        cosine = [1.0]
    else:
        # A barrier, as for the higher coefficients below: each of them enters all later ones.
        first_sine, first_cosine = materialize(sine_cosine(tilt))
        sine = [first_sine]
        cosine = [first_cosine]
    for k in range(order - 1):
        if k and linearized:
            sine.append(rate[k - 1] * (1 / k))
        elif k:
            parts = tuple(
                _multiply(tuple(rate), tuple(part), k - 1) for part in (cosine, sine)
            )
            next_sine, next_cosine = materialize((parts[0] * (1 / k), parts[1] * (-1 / k)))
            sine.append(next_sine)
            cosine.append(next_cosine)
        pull = sine[k] + _multiply(tuple(sine), lift, k)
        acceleration = (_multiply(tuple(cosine), push, k) - pull) * p_squared
        c.append(materialize(acceleration * (1 / ((k + 1) * (k + 2)))))
        if k == 0:
            # Lifted at this moment, a block does not accelerate to the ground: rounding may.
            c[2] = jnp.where(_starts(state), jnp.maximum(c[2], 0), c[2])
        rate.append(-(k + 2) * c[-1])
    return tuple(c), tuple(sine), tuple(cosine)


def _starts(state: tuple[Reals, Reals]) -> Booleans:
    """Return which blocks are lifted at this moment."""
    rotation, velocity = state
    return (rotation == 0) & (velocity == 0)


@partial(jax.custom_jvp, nondiff_argnums=(0, 1))
def _expand(linearized: bool, order: int, *arguments: Any) -> tuple[Reals, ...]:
    return _expand_all(linearized, order, *arguments)[0]


@_expand.defjvp
def _solve_variational_equation(
    linearized: bool, order: int, primals: tuple, tangents: tuple
) -> tuple[tuple[Reals, ...], tuple[Reals, ...]]:
    """Expand the variational equation: one product of series for each parameter.

    The derivatives of the recurrences, which are the same, are four.
    """
    (p_squared, _), state, push, lift = primals
    (p_squared_slope, angle_slope), state_slopes, push_slopes, lift_slopes = tangents
    c, sine, cosine = _expand_all(linearized, order, *primals)
    slopes = list(state_slopes)
    stiffness = []  # the derivative of the acceleration over the rotation
    for k in range(order - 1):
        straight = cosine[k] if k < len(cosine) else 0.0
        bent = 0.0 if linearized else _multiply(sine, push, k)
        stiffness.append(p_squared * (straight + bent + _multiply(cosine, lift, k)))
        change = _multiply(cosine, push_slopes, k) - _multiply(sine, lift_slopes, k)
        change = p_squared * change - stiffness[k] * angle_slope
        change += _multiply(tuple(stiffness), tuple(slopes), k)
        change *= 1 / ((k + 1) * (k + 2))
        change += c[k + 2] * (p_squared_slope / p_squared)
        if k == 0:
            change = jnp.where(_starts(state) & (c[2] <= 0), 0, change)
        slopes.append(materialize(change))
        stiffness[k] = materialize(stiffness[k])
    return c, tuple(slopes)


def evaluate(c: Coefficients, time: Reals) -> Reals:
    """Evaluate the series at a time."""
    total = cast("Reals", c[-1])
    for part in reversed(c[:-1]):
        total = total * time + part
    return total


def differentiate(c: Coefficients) -> Coefficients:
    """Differentiate the series."""
    return tuple(k * part for k, part in enumerate(c))[1:]


def evaluate_derivatives(c: Coefficients, time: Reals, count: int) -> tuple[Reals, ...]:
    """Evaluate the series and its first derivatives at a time, `count` in all."""
    derivatives = (
        tuple(math.perm(k, j) * c[k] for k in range(j, len(c))) for j in range(count)
    )
    return materialize(tuple(evaluate(derivative, time) for derivative in derivatives))


def binary_logarithm(x: Reals) -> Reals:
    """2^20 log2(abs(x)) within 9 % of 2^20, up to a constant of the type, in float32."""
    if x.dtype == jnp.float64:
        bits = jax.lax.bitcast_convert_type(jnp.abs(x), jnp.int64) >> 32
        return bits.astype(jnp.int32).astype(jnp.float32)
    return jax.lax.bitcast_convert_type(jnp.abs(x), jnp.int32).astype(jnp.float32) * 2.0**-3


def binary_power(y: Reals, dtype: DTypeLike) -> Reals:
    """2^(2^-20 y) within 6 %, from a float32."""
    if dtype == jnp.float64:
        bits = (jnp.clip(y, -1000 * 2.0**20, 1000 * 2.0**20) + 1023 * 2.0**20).astype(
            jnp.int32
        )
        return jax.lax.bitcast_convert_type(bits.astype(jnp.int64) << 32, dtype)
    bits = ((jnp.clip(y, -120 * 2.0**20, 120 * 2.0**20) + 127 * 2.0**20) * 8).astype(jnp.int32)
    return jax.lax.bitcast_convert_type(bits, dtype)


def choose_step(c: tuple[Reals, ...], tolerance: Number) -> Reals:
    """Choose the longest step in which the last two terms are small beside the first ones.

    The rule of Jorba and Zou (2005, doi:10.1080/10586458.2005.10128904), but relative to the
    motion in the step: right after uplift its third power is the whole motion. Logarithms to a
    few per cent, from the bits of the numbers, do for a length of step.
    """
    c = jax.lax.stop_gradient(c)
    order = len(c) - 1
    first = [binary_logarithm(part) for part in c[: min(4, order - 2)]]
    allowed = 2.0**20 * jnp.log2(jnp.asarray(tolerance, jnp.float32))
    lengths = []
    for last in (order, order - 1):
        small = allowed - binary_logarithm(c[last])
        terms = [(log + small) * (1 / (last - k)) for k, log in enumerate(first)]
        lengths.append(jax.tree.reduce(jnp.maximum, terms))
    return binary_power(jnp.minimum(*lengths), c[0].dtype)
