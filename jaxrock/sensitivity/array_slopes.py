"""Values and slopes of elementwise functions, point by point."""

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ..validation import check_kind

_CHUNK = 2**14  # number of points; their intermediate results fit into a cache
_Tree = TypeVar("_Tree")


def value_and_slopes(
    function: Callable[..., Array],
    argnums: int | Sequence[int] = 0,
    *,
    mask_beyond: bool = False,
) -> Callable[..., tuple[Array, Any]]:
    """Differentiate an elementwise function at every element, not only at a single one.

    For a single element, `jax.value_and_grad` does the same.

    Each function is compiled once. On a processor, large arrays are computed in chunks, so
    that intermediate results stay in its cache.

    Parameters
    ----------
    function : callable
        Any function of this package that returns one array, or a hashable function composed
        of such functions.
    argnums : int or sequence of int
        Arguments with respect to which to differentiate: numbers, arrays, or a `Scene` or
        `Block` of them.
    mask_beyond : bool
        Whether derivatives are NaN where the value is NaN, as beyond the overturning
        threshold. By default they are 0 there, which keeps sums finite but does not mean "no
        influence".

    Returns
    -------
    callable
        It takes the arguments of `function`, and returns its values and the partial
        derivatives. The derivatives have the structure of the argument (a tuple of such
        structures if `argnums` is a sequence). Each has the shape of the values, also where
        the argument is broadcast.

    Raises
    ------
    ValueError
        If `argnums` is an empty sequence.

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
    check_kind("function", function, Callable)
    argnums = argnums if isinstance(argnums, int) else tuple(argnums)
    if argnums == ():
        raise ValueError("argnums must not be empty, got ()")

    @functools.wraps(function)
    def differentiate(*arguments: PyTree, **named: object) -> tuple[Array, PyTree]:
        value, slopes = _value_and_slopes(function, argnums, arguments, named)
        if mask_beyond:
            slopes = jax.tree.map(
                lambda leaf: jnp.where(jnp.isnan(value), jnp.nan, leaf), slopes
            )
        return value, slopes

    return differentiate


@functools.partial(jax.jit, static_argnums=(0, 1))
def _value_and_slopes(
    function: Callable[..., Array],
    argnums: int | tuple[int, ...],
    arguments: tuple[PyTree, ...],
    named: dict[str, object],
) -> tuple[Array, PyTree]:
    """Compute values and slopes in one program for each function, form and shape."""
    value = functools.partial(function, **named)
    shape = jax.eval_shape(value, *arguments).shape
    # An argument that is broadcast has a slope at each point, so it is expanded first. Numbers
    # stay numbers: `vmap` gives their slopes the shape of the values.
    many, single = eqx.partition(arguments, lambda leaf: jnp.ndim(leaf) > 0)
    many = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, shape).reshape(-1), many)

    def differentiate_at(point: PyTree) -> tuple[Array, PyTree]:
        return jax.value_and_grad(value, argnums)(*eqx.combine(point, single))

    # Only processors use chunks, since the intermediate results of a large array would leave
    # the cache. An accelerator needs all points at once.
    size = math.prod(shape)
    result = jax.lax.platform_dependent(
        many,
        cpu=functools.partial(_apply_in_chunks, differentiate_at, size),
        default=jax.vmap(differentiate_at, axis_size=size),
    )
    return jax.tree.map(lambda leaf: leaf.reshape(shape), result)


def _apply_in_chunks(function: Callable[[PyTree], _Tree], size: int, many: PyTree) -> _Tree:
    """Apply a function of one point to all points, chunk by chunk.

    The last chunk overlaps with the one before it: a chunk of another size would compile a
    second program.
    """
    chunk = min(size, _CHUNK)
    points = jax.vmap(function, axis_size=chunk)
    if chunk == size:
        return points(many)
    slice_of = jax.lax.dynamic_slice_in_dim
    update = jax.lax.dynamic_update_slice_in_dim

    def fill_chunk(number: Array, result: _Tree) -> _Tree:
        start = jnp.minimum(number * chunk, size - chunk)
        part = points(jax.tree.map(lambda leaf: slice_of(leaf, start, chunk), many))
        return jax.tree.map(lambda leaf, new: update(leaf, new, start, 0), result, part)

    # The result is filled in place. Its shapes come from tracing, which computes nothing.
    forms = jax.eval_shape(jax.vmap(function, axis_size=size), many)
    empty = jax.tree.map(lambda form: jnp.zeros(form.shape, form.dtype), forms)
    return jax.lax.fori_loop(0, -(-size // chunk), fill_chunk, empty)
