"""Values and slopes of elementwise functions, point by point."""

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, PyTree

_CHUNK = 2**14  # number of points; their intermediate results fit into a cache


def value_and_slopes(
    function: Callable[..., Array],
    argnums: int | Sequence[int] = 0,
) -> Callable[..., tuple[Array, Any]]:
    """Differentiate an elementwise function at every element, not only at a single one.

    For a single element, `jax.value_and_grad` does the same.

    Each function is compiled once. Large arrays are computed in chunks, so that intermediate
    results stay in the cache of a processor.

    Parameters
    ----------
    function : callable
        Any function of this package that returns one array, or a hashable function composed
        of such functions.
    argnums : int or sequence of int
        Arguments with respect to which to differentiate: numbers, arrays, or a `Scene` or
        `Block` of them.

    Returns
    -------
    callable
        It takes the arguments of `function`, and returns its values and the partial
        derivatives. The derivatives have the structure of the argument (a tuple of such
        structures if `argnums` is a sequence). Each has the shape of the values, also where
        the argument is broadcast. They are NaN where the value is NaN, as beyond the
        overturning threshold.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> import jaxrock as jr
    >>> wall = jr.Scene(jr.Block(half_width=0.4, slenderness=5.0), 0.7, jnp.array([0.1, 0.2]))
    >>> value, slope = jr.value_and_slopes(jr.rotation_ratio)(wall)
    >>> of_width = slope.block.half_width[1]
    >>> print(f"{value[1]:.3f}, {slope.restitution[1]:.2f} and {of_width:.2f}")
    0.233, 1.79 and -0.67
    """
    argnums = argnums if isinstance(argnums, int) else tuple(argnums)
    return functools.partial(_value_and_slopes, function, argnums)


@functools.partial(jax.jit, static_argnums=(0, 1))
def _value_and_slopes(
    function: Callable[..., Array],
    argnums: int | tuple[int, ...],
    *arguments: PyTree,
    **named: object,
) -> tuple[Array, PyTree]:
    """Compute values and slopes in one program for each function, form and shape."""
    value = functools.partial(function, **named)
    shape = jax.eval_shape(value, *arguments).shape
    # An argument that is broadcast has a slope at each point, so it is expanded first. Numbers
    # stay numbers: `vmap` gives their slopes the shape of the values.
    many, single = eqx.partition(arguments, lambda leaf: jnp.ndim(leaf) > 0)
    many = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, shape).reshape(-1), many)

    def differentiate_at(point: PyTree) -> tuple[Array, PyTree]:
        answer, slopes = jax.value_and_grad(value, argnums)(*eqx.combine(point, single))
        # Automatic derivatives are 0 where there is no answer, as if nothing had influence.
        missing = jnp.isnan(answer)
        return answer, jax.tree.map(lambda leaf: jnp.where(missing, jnp.nan, leaf), slopes)

    if not shape:
        return differentiate_at(many)
    chunk = max(1, min(math.prod(shape), _CHUNK))
    result = jax.lax.map(differentiate_at, many, batch_size=chunk)
    return jax.tree.map(lambda leaf: leaf.reshape(shape), result)
