"""Values and slopes of an elementwise function, point by point."""

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

_CHUNK = 2**14  # points, whose intermediate results fit into the cache of a processor


def value_and_slopes(
    function: Callable[..., Array], argnums: int | Sequence[int] = 0
) -> Callable[..., tuple[Array, Any]]:
    """What `jax.value_and_grad` is to a number, for an elementwise function of arrays.

    Parameters
    ----------
    function : callable
        Any function of this package with one array as its answer, or one made of such.
    argnums : int or sequence of int
        Which arguments to differentiate with respect to: numbers, arrays, or a `Scene` or
        `Block` of them.

    Returns
    -------
    callable
        Takes what `function` takes. Returns its values, and the partial derivatives in the
        form of the argument (a tuple of them if `argnums` is a sequence), each in the shape
        of the values, also where the argument is broadcast.

    Notes
    -----
    It is compiled, once for a function, and runs over large arrays in chunks, so that a processor
    need not write to memory what it does not return.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> import jaxrock as jr
    >>> wall = jr.Scene(jr.Block(half_width=0.4, slenderness=5.0), 0.7, jnp.array([0.1, 0.2]))
    >>> value, slope = jr.value_and_slopes(jr.rotation_ratio)(wall)
    >>> print(f"{value[1]:.3f}, {slope.restitution[1]:.2f} and {slope.block.half_width[1]:.2f}")
    0.233, 1.79 and -0.67
    """
    argnums = argnums if isinstance(argnums, int) else tuple(argnums)
    try:
        hash(function)
    except TypeError:  # a module with arrays, say: compiled for this wrapper alone
        held = functools.partial(function)
    else:
        held = function

    @functools.wraps(function)
    def differentiated(*arguments: Any, **named: Any) -> tuple[Array, Any]:
        return _both(held, argnums, arguments, named)

    return differentiated


@functools.partial(jax.jit, static_argnums=(0, 1))
def _both(
    function: Callable[..., Array],
    argnums: int | tuple[int, ...],
    arguments: tuple[Any, ...],
    named: dict[str, Any],
) -> tuple[Array, Any]:
    def at(*arguments: Any) -> Array:
        return function(*arguments, **named)

    leaves, form = jax.tree.flatten(arguments)
    shape = jax.eval_shape(at, *arguments).shape
    several = [jnp.ndim(leaf) > 0 for leaf in leaves]
    spread = [
        jnp.broadcast_to(leaf, shape).reshape(-1) if ndim else leaf
        for leaf, ndim in zip(leaves, several, strict=True)
    ]

    def one(point: list[Array]) -> tuple[Array, Any]:
        return jax.value_and_grad(at, argnums)(*jax.tree.unflatten(form, point))

    size = math.prod(shape)
    along = [0 if ndim else None for ndim in several]
    points = jax.vmap(one, (along,), axis_size=size)
    answer = jax.lax.platform_dependent(
        spread, cpu=functools.partial(_in_chunks, one, along, size), default=points
    )
    return jax.tree.map(lambda leaf: leaf.reshape(shape), answer)


def _in_chunks(one: Callable[[Any], Any], along: list[int | None], size: int, spread: Any) -> Any:
    """`one` of all points, chunk by chunk; the last one overlaps with the one before it."""
    chunk = min(size, _CHUNK)
    points = jax.vmap(one, (along,), axis_size=chunk)
    if chunk == size:
        return points(spread)

    def step(number: Array, answer: Any) -> Any:
        start = jnp.minimum(number * chunk, size - chunk)
        part = [
            leaf if axis is None else jax.lax.dynamic_slice_in_dim(leaf, start, chunk)
            for leaf, axis in zip(spread, along, strict=True)
        ]
        return jax.tree.map(
            lambda whole, new: jax.lax.dynamic_update_slice_in_dim(whole, new, start, 0),
            answer,
            points(part),
        )

    form = jax.eval_shape(jax.vmap(one, (along,), axis_size=size), spread)
    begin = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), form)
    return jax.lax.fori_loop(0, -(-size // chunk), step, begin)
