"""Elementary functions whose automatic derivative would lose digits, be NaN, or a mean of two.

Each is a plain expression; its derivative is accurate over the whole domain and can be
differentiated again.
"""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..validation import Number, Reals
from .elliptic import carlson_rd


def quotient(numerator: Reals, denominator: Reals) -> Reals:
    """Divide, for a result that is used several times."""
    # XLA would store a quotient in memory, but fuses a product with what uses it.
    return numerator * (1 / denominator)


def pick_larger(first: Reals, second: Reals) -> Reals:
    """Pick the larger of two; of equal ones the first, with all of its derivative.

    ``jnp.maximum`` would take the mean of both derivatives, which belongs to neither.
    """
    return jnp.where(second > first, second, first)


def pick_smaller(first: Reals, second: Reals) -> Reals:
    """Pick the smaller of two, as in `pick_larger`."""
    return jnp.where(second < first, second, first)


def pick_largest(values: Reals) -> Reals:
    """Pick the largest along the last axis, as in `pick_larger`."""
    index = jnp.expand_dims(jnp.argmax(values, axis=-1), -1)
    return jnp.take_along_axis(values, index, axis=-1)[..., 0]


@jax.custom_jvp
def one_minus_square(x: Reals) -> Reals:
    """Compute ``1 - x^2``, accurate for x near 1, with a derivative accurate for small x."""
    # The product rule would give the derivative as (1 - x) - (1 + x), which cancels.
    return (1 - x) * (1 + x)


one_minus_square.defjvps(lambda dx, _, x: -2 * x * dx)


# Coefficients of a polynomial P: arctan(u) / u = 1 + u^2 P(u^2) to 2e-17, for u from 0 to 1/2.
_ARCTANGENT = (-0.33333333333333326, 0.199999999999916, -0.14285714284106285,
               0.11111110990139533, -0.09090904370311348, 0.07692198451257941,
               -0.06665052856794013, 0.058664967492257074, -0.05157516225552972,
               0.04283578705573422, -0.02895352123252625, 0.011152908092096216)  # fmt: skip


@jax.custom_jvp
def angle(opposite: Reals | float, adjacent: Reals | float) -> Reals:
    """Compute ``arctan2`` of numbers from 0 on: the angle of a right triangle, 0 to pi/2."""
    # XLA does not vectorize its own arctan2 on processors.
    short = jnp.minimum(opposite, adjacent)
    long = jnp.maximum(opposite, adjacent)
    # arctan(s / l) = pi/4 + arctan((s - l) / (s + l)), where s - l is exact
    near_diagonal = short > 0.5 * long
    steep = opposite > adjacent
    numerator = jnp.where(near_diagonal, short - long, short)
    u = quotient(numerator, jnp.where(near_diagonal, short + long, long))
    square = u * u
    series = functools.reduce(lambda sum, term: sum * square + term, reversed(_ARCTANGENT))
    part = u + u * (square * series)
    whole = jnp.where(near_diagonal, jnp.pi / 4, jnp.where(steep, jnp.pi / 2, 0))
    return whole + jnp.where(steep, -part, part)


@angle.defjvp
def _angle_jvp(primals, tangents):
    """Differentiate as `arctan2`, without its branches."""
    opposite, adjacent = primals
    turned, stretched = tangents
    slope = 1 / (opposite**2 + adjacent**2)
    return angle(opposite, adjacent), (adjacent * turned - opposite * stretched) * slope


@jax.custom_jvp
def arcsin(q: Reals) -> Reals:
    """Compute the inverse sine for 0 <= q < 1."""
    # From the half angle, in which the root is used only once and never stored in memory.
    return 2 * angle(q, 1 + jnp.sqrt(one_minus_square(q)))


arcsin.defjvps(lambda dq, _, q: dq / jnp.sqrt(one_minus_square(q)))


def _ratio(function: Callable[[Array], Array], argument: Array) -> Array:
    """Compute ``function(x) / x`` of an odd function of slope 1 at 0."""
    # Up to the root of the rounding unit the ratio is 1 to all digits, and 0 / 0 at 0.
    differs = argument**2 > jnp.finfo(argument.dtype).eps
    divisor = jnp.where(differs, argument, 0.5)
    return jnp.where(differs, function(divisor) / divisor, 1)


@jax.custom_jvp
def arctan_ratio(z: Reals) -> Reals:
    """Compute ``arctan(z) / z`` for z > 0, with a derivative accurate for small z."""
    return angle(z, 1.0) / z


@jax.custom_jvp
def artanh_ratio(x: Reals) -> Reals:
    """Compute ``artanh(x) / x`` for 0 <= x < 1, with a derivative accurate for small x."""
    return _ratio(lambda t: jnp.log1p(2 * t / (1 - t)) / 2, x)


@jax.custom_jvp
def arcsin_ratio(q: Reals) -> Reals:
    """Compute ``arcsin(q) / q`` for 0 <= q < 1, with a derivative accurate for small q."""
    return _ratio(arcsin, q)


# The derivatives of these ratios are differences that cancel at 0, but each of them is an R_D
# of arguments that are close to 1 there.
def _rd(y: Array, second: Array) -> Array:
    """Compute R_D(1, second, y)."""
    return carlson_rd(jnp.ones_like(y), second, y)


arctan_ratio.defjvps(lambda dz, _, z: -2 / 3 * z * _rd(1 + z**2, 1 + z**2) * dz)
artanh_ratio.defjvps(
    lambda dx, _, x: 2 / 3 * x * _rd(one_minus_square(x), one_minus_square(x)) * dx
)
arcsin_ratio.defjvps(lambda dq, _, q: q / 3 * _rd(one_minus_square(q), jnp.ones_like(q)) * dq)


def quotient_or_infinite(numerator: Reals, denominator: Reals) -> Reals:
    """Divide numbers from 0 on; ``x / 0`` is inf, but ``0 / 0`` is 0.

    The derivative is 0 there, so that such elements do not spoil the derivatives of others.
    """
    limited = denominator > 0
    unlimited = jnp.where(numerator > 0, jnp.inf, 0)
    limit = quotient(numerator, jnp.where(limited, denominator, 1))
    return jnp.where(limited, limit, unlimited)


def minus_log(ratio: Reals) -> Reals:
    """Compute ``-log(ratio)`` for 0 <= ratio <= 1; inf at 0, with derivative 0 there."""
    # A stand-in for 0, since the derivative of `where` takes both branches.
    positive = ratio > 0
    return jnp.where(positive, -jnp.log(jnp.where(positive, ratio, 1)), jnp.inf)


def share_of_one(ratio: Number, count: Number) -> Reals:
    """Compute the share of the first term in ``1 + C + ... + C^(n - 1)``.

    The ratio C is between 0 and 1; the share is 1/n at C = 1. The count n is from 1 to inf;
    the share is not differentiated with respect to it.
    """
    ratio = jnp.asarray(ratio)
    count = jax.lax.stop_gradient(jnp.asarray(count).astype(ratio.dtype))
    return _share_of_one(*jnp.broadcast_arrays(ratio, count))


@jax.custom_jvp
def _share_of_one(ratio: Array, count: Array) -> Array:
    """Compute ``(1 - C) / (1 - C^n)``, and its limits one by one."""
    limit = 1 - ratio
    several = (count > 1) & (count < jnp.inf) & (ratio > 0) & (ratio != 1)
    safe = jnp.where(several, ratio, 0.5)
    share = limit / -jnp.expm1(jnp.where(several, count, 2) * jnp.log(safe))
    share = jnp.where(several, share, jnp.where(count == 1, 1, limit))
    return jnp.where((ratio == 1) & (count < jnp.inf), 1 / count, share)


def _share_of_one_jvp(dratio, share, ratio, count):
    """Differentiate the share with respect to the ratio, by its logarithm."""
    # With one term the share is 1, with infinitely many it is 1 - C.
    several = (count > 1) & (count < jnp.inf)
    n = jnp.where(several, count, 2)
    # From the definition where C is small, from the logarithm elsewhere: near 1 the two terms
    # of the definition cancel, near 0 the logarithm is infinite.
    small = ratio < 0.4
    low = jnp.where(small, ratio, 0.25)
    high = jnp.where(small, 0.5, ratio)
    from_definition = n * low ** (n - 1) / (1 - low**n) - 1 / (1 - low)
    # Both terms without their poles, which cancel: 1 / expm1(d) = 1 / d - gap(d).
    decay = -jnp.log(high)
    from_logarithm = (_gap(decay) - n * _gap(n * decay)) / high
    slope = share * jnp.where(small, from_definition, from_logarithm)
    return jnp.where(several, slope, jnp.where(count == 1, 0, -1)) * dratio


_share_of_one.defjvps(_share_of_one_jvp, None)


# x / expm1(x) - 1 + x / 2 = sum of B_2k x^2k / (2k)!, from k = 1 on.
_BERNOULLI = (1 / 12, -1 / 720, 1 / 30240, -1 / 1209600, 1 / 47900160, -691 / 1307674368000,
              1 / 74724249600, -3617 / 10670622842880000, 43867 / 5109094217170944000)  # fmt: skip


def _gap(x: Array) -> Array:
    """Compute ``1 / x - 1 / expm1(x)`` for x >= 0; 1/2 at 0."""
    near = x < 1
    low = jnp.where(near, x, 0)
    high = jnp.where(near, 1, x)
    series = jnp.polyval(jnp.asarray(_BERNOULLI[::-1], x.dtype), low**2)
    # 1 / expm1(x), without overflow in its derivatives.
    return jnp.where(near, 0.5 - low * series, 1 / high - jnp.exp(-high) / -jnp.expm1(-high))
