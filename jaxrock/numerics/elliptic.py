"""Elliptic integrals and functions, which JAX lacks.

Carlson's symmetric integrals R_F and R_D by duplication and the series to order 7 (Carlson
1995, doi:10.1007/BF02198293; DLMF 19.36(i)), and Jacobi's sn, cn, dn by the
arithmetic-geometric mean (DLMF 22.20(ii)). All are elementwise and differentiable any number
of times.
"""

import functools

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array

from ..validation import Reals

_STAGES = 10  # of an arithmetic-geometric mean, each with twice as many digits as before


def _duplicate_arguments(
    arguments: tuple[Array, ...], slopes: tuple[int, ...] = ()
) -> tuple[tuple[Array, ...], list[Array], Array]:
    """Duplicate the arguments of R_F until they are equal within what the series can bridge.

    Each duplication splits a part off R_D and leaves a quarter of an R_D of closer arguments.

    Parameters
    ----------
    arguments : tuple of Array
    slopes : tuple of int
        Indices of the arguments that R_D is wanted for, each as its last argument.

    Returns
    -------
    arguments : tuple of Array
        Duplicated.
    parts : list of Array
        The sum of the parts that have been split off, for each of `slopes`.
    factor : Array
        By which the R_D of the duplicated arguments is multiplied before it is added.
    """
    arguments = tuple(jnp.broadcast_arrays(*arguments))
    kind = jnp.finfo(arguments[0].dtype)
    mean = sum(arguments) / 3
    spread = functools.reduce(jnp.maximum, (abs(t - mean) for t in arguments))
    # The series to order 7 leaves a term of order 8 in the relative differences: it is below
    # the rounding unit from here on.
    widest = spread / (float(kind.eps) / 64) ** 0.125
    factor = jnp.ones_like(mean)
    parts = [jnp.zeros_like(mean) for _ in slopes]

    def duplicate(_: object, state: tuple) -> tuple:
        arguments, parts, factor = state
        # A duplication divides the differences by four; one too many would only add rounding.
        apart = widest * factor > sum(arguments) / 3
        roots = [jnp.sqrt(t) for t in arguments]
        shift = roots[0] * (roots[1] + roots[2]) + roots[1] * roots[2]
        terms = [3 * factor / (roots[i] * (arguments[i] + shift)) for i in slopes]
        new = tuple((t + shift) / 4 for t in arguments)
        new = (new, [p + t for p, t in zip(parts, terms, strict=True)], factor / 4)
        return jax.tree.map(lambda n, old: jnp.where(apart, n, old), new, state)

    # In a loop, since XLA would compute each duplication of an unrolled one again within the
    # next: ten times the code to compile, and two to three times as slow. So many duplications
    # are enough for ratios of the arguments up to 1/eps: each about halves the logarithm of
    # the ratio while that is large.
    count = 11 if kind.bits > 32 else 7
    return jax.lax.fori_loop(0, count, duplicate, (arguments, parts, factor))


def _rf_series(x: Array, y: Array, z: Array) -> Array:
    """Expand R_F of almost equal arguments (DLMF 19.36.1)."""
    mean = (x + y + z) / 3
    dx = (mean - x) / mean
    dy = (mean - y) / mean
    dz = -dx - dy
    e2 = dx * dy - dz * dz
    e3 = dx * dy * dz
    in_e2 = e2 * (-1 / 10 + e2 * (1 / 24 - e2 * (5 / 208) + e3 / 16) - e3 * (3 / 44))
    return (in_e2 + e3 * (1 / 14 + e3 * (3 / 104)) + 1) / jnp.sqrt(mean)


def _rd_series(x: Array, y: Array, z: Array) -> Array:
    """Expand R_D of almost equal arguments (DLMF 19.36.2)."""
    mean = (x + y + 3 * z) / 5
    dx = (mean - x) / mean
    dy = (mean - y) / mean
    dz = -(dx + dy) / 3
    xy = dx * dy
    zz = dz * dz
    e2 = xy - 6 * zz
    e3 = (3 * xy - 8 * zz) * dz
    e4 = 3 * (xy - zz) * zz
    e5 = xy * zz * dz
    series = (
        1
        + e2 * (-3 / 14 + e2 * (9 / 88 - e2 / 16) - e3 * (9 / 52 - e2 * (45 / 272)))
        + e3 * (1 / 6 + e3 * (3 / 40))
        + e4 * (-3 / 22 + e2 * (3 / 20) - e3 * (9 / 68))
        + e5 * (3 / 26 - e2 * (9 / 68))
    )
    return series / (mean * jnp.sqrt(mean))


@jax.custom_jvp
def carlson_rf(x: Reals, y: Reals, z: Reals) -> Reals:
    """Compute Carlson's integral of the first kind, R_F(x, y, z) (DLMF 19.16.1).

    The arguments are greater than 0, their ratios within 1/eps of the dtype. R_F is symmetric
    and homogeneous of degree -1/2, with ``R_F(x, x, x) = 1 / sqrt(x)``.
    """
    arguments, _, _ = _duplicate_arguments((x, y, z))
    return _rf_series(*arguments)


def _carlson_rf_jvp(primals, tangents):
    """Differentiate R_F with respect to the arguments that are perturbed, by R_D."""
    # dR_F/dz = -R_D(x, y, z) / 6, and so for x and y: all from the same duplications.
    moving = tuple(i for i, t in enumerate(tangents) if not isinstance(t, SymbolicZero))
    arguments, parts, factor = _duplicate_arguments(primals, moving)
    value = _rf_series(*arguments)
    slope = jnp.zeros_like(value)
    for i, part in zip(moving, parts, strict=True):
        x, y = (t for j, t in enumerate(arguments) if j != i)
        rd = part + factor * _rd_series(x, y, arguments[i])
        slope = slope - rd / 6 * tangents[i]
    return value, slope


carlson_rf.defjvp(_carlson_rf_jvp, symbolic_zeros=True)


def carlson_rd(x: Reals, y: Reals, z: Reals) -> Reals:
    """Compute Carlson's integral of the second kind, R_D(x, y, z) (DLMF 19.16.5).

    The arguments are as in `carlson_rf`. R_D is symmetric in x and y only, and homogeneous of
    degree -3/2, with ``R_D(x, x, x) = x**(-3/2)``.
    """
    arguments, (part,), factor = _duplicate_arguments((x, y, z), (2,))
    return part + factor * _rd_series(*arguments)


def jacobi(argument: Reals, complement: Reals) -> tuple[Reals, Reals, Reals]:
    """Compute Jacobi's elliptic functions ``sn(u|m), cn(u|m), dn(u|m)`` (DLMF 22.2).

    Parameters
    ----------
    argument : Array
        u, any real number.
    complement : Array
        1 - m, of the parameter m: close to m = 1 it has digits that m has lost. It may be
        negative (m > 1).

    Returns
    -------
    sn, cn, dn : Array
    """
    # Reciprocal parameter (DLMF 22.17(i)) where m > 1. At m = 1 the mean never converges.
    eps = jnp.finfo(jnp.result_type(argument, complement)).eps
    parabolic = abs(complement) < eps**2
    beyond = complement < 0
    stretch = jnp.sqrt(1 - jnp.where(beyond, complement, 0))
    m1 = jnp.where(beyond, -complement / stretch**2, complement)
    m1 = jnp.where(parabolic, 0.5, m1)

    def average(means: tuple, _: object) -> tuple:
        """Take one stage of the mean; keep the root and the gap for the way back."""
        mean, root = means
        gap = (mean - root) / 2
        root = jnp.sqrt(mean * root)
        return (mean - gap, root), (root, gap)

    def halve_phase(phase: Array, stage: tuple) -> tuple:
        """Take the phase back by one stage."""
        root, gap = stage
        # arcsin(gap sin(phase) / mean), without its cancellation near pi/2
        adjacent = jnp.sqrt(root**2 + (gap * jnp.cos(phase)) ** 2)
        return (phase + jnp.arctan2(gap * jnp.sin(phase), adjacent)) / 2, None

    means = (jnp.ones_like(m1), jnp.sqrt(m1))
    (mean, _), stages = jax.lax.scan(average, means, length=_STAGES)
    phase = 2.0**_STAGES * mean * stretch * argument
    phase, _ = jax.lax.scan(halve_phase, phase, stages, reverse=True)
    sn = jnp.sin(phase)
    cn = jnp.cos(phase)
    dn = jnp.sqrt(m1 + (1 - m1) * cn**2)
    # With the reciprocal parameter cn and dn change places.
    cn, dn = jnp.where(beyond, dn, cn), jnp.where(beyond, cn, dn)
    limits = _jacobi_near_one(*(jnp.where(parabolic, x, 0) for x in (argument, complement)))
    pairs = zip(limits, (sn / stretch, cn, dn), strict=True)
    sn, cn, dn = (jnp.where(parabolic, limit, regular) for limit, regular in pairs)
    return sn, cn, dn


def _jacobi_near_one(argument: Array, complement: Array) -> tuple[Array, Array, Array]:
    """Expand sn, cn and dn to first order in the complement (DLMF 22.10(ii))."""
    tanh = jnp.tanh(argument)
    sech = 1 / jnp.cosh(argument)
    even = jnp.sinh(argument) * tanh / 4
    odd = argument * tanh * sech / 4
    sn = tanh + complement * (tanh - argument * sech**2) / 4
    return sn, sech - complement * (even - odd), sech + complement * (even + odd)
