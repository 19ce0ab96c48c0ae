"""An answer as a compiled function of the numbers it depends on."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .distributions import Distributions

Answer = Callable[[Any], Any]


_TOGETHER = 2**14  # samples computed at once


class Numbers(NamedTuple):
    """A pytree as a list of named numbers."""

    names: tuple[str, ...]
    values: Any  # (numbers,)
    form: Any  # of the pytree

    @classmethod
    def of(cls, at: Any) -> "Numbers":
        """The numbers of a pytree, or a `ValueError`."""
        leaves = jax.tree.leaves_with_path(at)
        if not leaves:
            raise ValueError("at must contain at least one number")
        for path, leaf in leaves:
            if jnp.ndim(leaf):
                name = jax.tree_util.keystr(path)
                raise ValueError(f"at must consist of single numbers, got an array in {name}")
        at = jax.tree.map(lambda leaf: jnp.asarray(leaf, float), at)
        values, form = jnp.stack(jax.tree.leaves(at)), jax.tree.structure(at)
        keys = [[_key(part) for part in path] for path, _ in leaves]
        last = [key[-1] if key else "value" for key in keys]
        names = [
            short if last.count(short) == 1 else ".".join(key)
            for short, key in zip(last, keys, strict=True)
        ]
        return cls(tuple(names), values, form)

    def chosen(self, what: str, given: Mapping[str, Any]) -> list[int]:
        """Places of the names in a mapping."""
        for name in given:
            if name not in self.names:
                raise ValueError(f"{what} has {name!r}, which is none of {', '.join(self.names)}")
        return [self.names.index(name) for name in given]

    def asked(self, answer: Answer, places: Any = None, drawn: Any = None) -> "Asked":
        """The answer as a function of the numbers at some places, or of what they are drawn by."""
        places = range(len(self.names)) if places is None else places
        drawn = None if drawn is None else jax.tree.map(jnp.asarray, drawn)
        return Asked(answer, self.values, self.form, tuple(map(int, places)), drawn)


class Asked(eqx.Module):
    """An answer as a function of some of its numbers, which is compiled once.

    What it is called with may be independent standard normal numbers, if the numbers are
    `drawn` by them.
    """

    answer: Answer
    values: Any  # (numbers,)
    form: Any = eqx.field(static=True)
    places: tuple[int, ...] = eqx.field(static=True)
    drawn: Distributions | None

    def numbers(self, some: Any) -> Any:
        """All numbers, as a list."""
        if self.drawn is not None:
            some = self.drawn.at(some)
        return self.values.at[np.asarray(self.places, int)].set(some)

    def __call__(self, some: Any) -> Any:
        """The answer."""
        value = jnp.asarray(self.answer(jax.tree.unflatten(self.form, list(self.numbers(some)))))
        if value.ndim:
            raise ValueError(f"answer must be one number, got an array of shape {value.shape}")
        return value


@eqx.filter_jit
def value_of(asked: Asked, some: Any) -> Any:
    """The answer."""
    return asked(some)


@eqx.filter_jit
def slope_of(asked: Asked, some: Any) -> Any:
    """Its gradient."""
    return jax.jacfwd(asked)(some)


@eqx.filter_jit
def expanded(asked: Asked, some: Any) -> tuple[Any, Any, Any]:
    """Value, slopes and second derivatives."""
    slope = jax.jacfwd(asked)
    return asked(some), slope(some), jax.jacfwd(slope)(some)


@eqx.filter_jit
def values_at(asked: Asked, points: Any) -> Any:
    """The answers at many points."""
    return jax.vmap(asked)(points)


@eqx.filter_jit
def slopes_and_values_at(asked: Asked, points: Any) -> Any:
    """Gradients at many points, with the answers as their last column."""
    return jax.vmap(lambda some: jnp.append(jax.jacfwd(asked)(some), asked(some)))(points)


def _key(part: Any) -> str:
    return str(getattr(part, "name", getattr(part, "key", getattr(part, "idx", part))))


def scattering(
    answer: Answer, at: Any, coefficients_of_variation: Mapping[str, float]
) -> tuple[Asked, tuple[str, ...], np.ndarray]:
    """The answer for independent standard normal numbers, the names, and what scatters."""
    numbers = Numbers.of(at)
    places = np.asarray(numbers.chosen("coefficients_of_variation", coefficients_of_variation), int)
    spread = np.asarray(list(coefficients_of_variation.values()), float)
    if not ((spread >= 0) & (spread < np.inf)).all():
        raise ValueError("coefficients_of_variation must be at least 0 for every number")
    drawn = Distributions.of(
        tuple(coefficients_of_variation), np.asarray(numbers.values)[places], spread
    )
    return numbers.asked(answer, places, drawn), numbers.names, spread


def sampled(program: Callable[..., Any], asked: Asked, points: np.ndarray) -> np.ndarray:
    """What is asked at every point, in parts that fit into memory."""
    parts = [
        np.asarray(program(asked, jnp.asarray(points[k : k + _TOGETHER])))
        for k in range(0, len(points), _TOGETHER)
    ]
    return np.concatenate(parts)
