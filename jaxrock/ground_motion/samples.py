"""Samples of an acceleration along the last axis: checks, interpolation and integration."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..validation import Reals

# So many samples of an acceleration never all rise.
_RISING = 8
# Columns of a table: times and three components.
_FEW = 4


def refuse_empty(**numbers: Reals | None) -> None:
    """Raise `ValueError` if an array is empty."""
    for name, value in numbers.items():
        if value is not None and not value.size:
            raise ValueError(f"{name} must not be empty, got an array of shape {value.shape}")


def refuse_times(name: str, rows: np.ndarray) -> None:
    """Raise `ValueError` if one of several rows, or of few columns, holds times of samples."""
    # Times never fall, but may repeat where few digits are printed. Their unit does not
    # matter, since a factor has been applied to them as well. No ground accelerates ever more.
    for word, lines in (("row", rows), ("column", rows.T)):
        # A table of times has few columns: many columns are samples of records.
        if lines.shape[1] < _RISING or (word == "column" and len(lines) > _FEW):
            continue
        rises = (np.diff(lines, axis=1) >= 0).all(axis=1) & (lines[:, -1] > lines[:, 0])
        if rises.any() and not rises.all():
            raise ValueError(
                f"{name} must have its samples along the last axis, got an array of shape"
                f" {rows.shape} whose {word} {int(np.argmax(rises)) + 1} never falls, like times;"
                f" pass only the {word}s of accelerations, each as one row"
            )


@jax.jit
def integrate_samples(samples: Reals, last: int | Reals) -> Reals:
    """Integrate samples up to the `last` one by the trapezoidal rule, over the time step."""
    # The padding adds nothing to the sum.
    final = jnp.take(samples, jnp.asarray(last).astype(int), axis=-1)
    return samples.sum(axis=-1) - 0.5 * (samples[..., 0] + final)


def interpolate(samples: Reals, index: Array, along: Reals) -> Reals:
    """Interpolate in the last axis linearly; leading axes broadcast with those of `index`."""
    if samples.ndim == 1:
        # Both samples are read in one piece, which XLA fuses into later operations.
        shape = index.shape
        slices = jax.vmap(lambda start: jax.lax.dynamic_slice(samples, (start,), (2,)))
        left, right = slices(index.reshape(-1)).T.reshape(2, *shape)
        return (1 - along) * left + along * right
    shape = jnp.broadcast_shapes(samples.shape[:-1], index.shape)
    samples = jnp.broadcast_to(samples, (*shape, samples.shape[-1]))
    index = jnp.broadcast_to(index, shape)[..., None]
    # The index is in bounds: without the mode, JAX would check it again.
    left, right = (
        jnp.take_along_axis(samples, position, axis=-1, mode="promise_in_bounds")[..., 0]
        for position in (index, index + 1)
    )
    # Exact at both ends, unlike left + along * (right - left).
    return (1 - along) * left + along * right
