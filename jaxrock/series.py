"""The finite geometric series: what a train of equal pulses adds up to."""

import jax
import jax.numpy as jnp
from jaxtyping import Array

from .arguments import Number, Reals

# x / expm1(x) - 1 + x / 2 = sum of B_2k x^2k / (2k)!, from k = 1 on.
_BERNOULLI = (1 / 12, -1 / 720, 1 / 30240, -1 / 1209600, 1 / 47900160, -691 / 1307674368000,
              1 / 74724249600, -3617 / 10670622842880000, 43867 / 5109094217170944000)  # fmt: skip


def share_of_one(ratio: Number, count: Number) -> Reals:
    """The first term's share in ``1 + ratio + ... + ratio**(count - 1)``.

    Parameters
    ----------
    ratio : array_like
        C, between 0 and 1; elementwise.
    count : array_like
        n, a whole number from 1 on, or inf.

    Returns
    -------
    Array
        ``(1 - C) / (1 - C^n)``, accurate and differentiable to C on all of [0, 1]: 1/n at
        C = 1, and 1 - C for unlimited n.
    """
    ratio = jnp.asarray(ratio)
    count = jax.lax.stop_gradient(jnp.asarray(count).astype(ratio.dtype))
    return _share_of_one(*jnp.broadcast_arrays(ratio, count))


@jax.custom_jvp
def _share_of_one(ratio: Array, count: Array) -> Array:
    limit = 1 - ratio
    several = (count > 1) & (count < jnp.inf) & (ratio > 0) & (ratio < 1)
    safe = jnp.where(several, ratio, 0.5)
    share = limit / -jnp.expm1(jnp.where(several, count, 2) * jnp.log(safe))
    share = jnp.where(several, share, jnp.where(count == 1, 1, limit))
    return jnp.where((ratio == 1) & (count < jnp.inf), 1 / count, share)


@_share_of_one.defjvp
def _share_of_one_jvp(primals, tangents):
    (ratio, count), (dratio, _) = primals, tangents
    share = _share_of_one(ratio, count)
    finite = count < jnp.inf
    n = jnp.where(finite, count, 2)
    # d ln(share) / dC, from the definition where C is small ...
    small = ratio < 0.4
    low = jnp.where(small, ratio, 0.25)
    from_definition = n * low ** (n - 1) / (1 - low**n) - 1 / (1 - low)
    # ... and elsewhere from l = -ln C, with g(x) = 1/x - 1/expm1(x).
    logarithm = -jnp.log(jnp.where(small, 0.5, ratio))
    from_logarithm = (_g(logarithm) - n * _g(n * logarithm)) / jnp.where(small, 1, ratio)
    slope = share * jnp.where(small, from_definition, from_logarithm)
    return share, jnp.where(finite, slope, -1) * dratio


def _g(x: Array) -> Array:
    """1 / x - 1 / expm1(x), for x >= 0; 1/2 at 0."""
    near = x < 1
    x_near, x_far = jnp.where(near, x, 0), jnp.where(near, 1, x)
    series = jnp.polyval(jnp.asarray(_BERNOULLI[::-1], x.dtype), x_near**2)
    return jnp.where(near, 0.5 - x_near * series, 1 / x_far - 1 / jnp.expm1(x_far))
