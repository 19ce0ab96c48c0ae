"""An answer as a compiled function of the parameters that it depends on."""

import dataclasses
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import keystr
from jaxtyping import Array

from .distributions import Distributions

Answer = Callable[[Any], Any]
Ranges = Mapping[str, tuple[float, float]]
Spread = Mapping[str, float]  # coefficients of variation by name

_CHUNK = 2**14  # points evaluated at once


class ParametricAnswer(eqx.Module):
    """An answer as a function of its varied parameters, or of standard normal numbers.

    What is static decides which program is compiled; other values use the same one.
    """

    answer: Answer
    values: Array  # of all parameters
    names: tuple[str, ...] = eqx.field(static=True)
    form: Any = eqx.field(static=True)  # of the pytree that the answer takes
    varied: tuple[int, ...] = eqx.field(static=True)
    distributions: Distributions | None = None

    def parameters(self, point: Array) -> Array:
        """All parameters at a point."""
        if self.distributions is not None:
            point = self.distributions.quantiles(point)
        return self.values.at[np.asarray(self.varied, int)].set(point)

    def __call__(self, point: Array) -> Array:
        """The answer at a point."""
        parameters = jax.tree.unflatten(self.form, list(self.parameters(point)))
        value = jnp.asarray(self.answer(parameters))
        if value.ndim:
            raise ValueError(f"answer must be one number, got an array of shape {value.shape}")
        return value


def parametric(
    answer: Answer, at: Any, argument: str = "", varied: Iterable[str] | None = None
) -> ParametricAnswer:
    """The answer as a function of the parameters that an `argument` names, or of all."""
    leaves = jax.tree.leaves_with_path(at)
    if not leaves:
        raise ValueError("at must contain at least one number")
    for path, leaf in leaves:
        if jnp.ndim(leaf):
            raise ValueError(f"at must consist of single numbers, got an array in {keystr(path)}")
    last = [keystr(path[-1:], simple=True) or "value" for path, _ in leaves]
    names = tuple(
        short if last.count(short) == 1 else keystr(path, simple=True, separator=".")
        for short, (path, _) in zip(last, leaves, strict=True)
    )
    varied = names if varied is None else tuple(varied)
    for name in varied:
        if name not in names:
            raise ValueError(f"{argument} has {name!r}, which is none of {', '.join(names)}")
    values = jnp.asarray(np.array([float(leaf) for _, leaf in leaves]))
    places = tuple(map(names.index, varied))
    return ParametricAnswer(answer, values, names, jax.tree.structure(at), places)


def under_scatter(
    answer: Answer, at: Any, variations: Spread, samples: int, seed: int
) -> tuple[ParametricAnswer, np.ndarray]:
    """The answer as a function of independent standard normal numbers, and samples of these."""
    function = parametric(answer, at, "coefficients_of_variation", variations)
    wanted = np.asarray(list(variations.values()), float)
    if not ((wanted >= 0) & (wanted < np.inf)).all():
        raise ValueError("coefficients_of_variation must be at least 0 for every number")
    medians = np.asarray(function.values)[np.asarray(function.varied, int)]
    distributions = jax.tree.map(jnp.asarray, Distributions.of(tuple(variations), medians, wanted))
    z = np.random.default_rng(seed).standard_normal((samples, wanted.size))
    return dataclasses.replace(function, distributions=distributions), z


def expansion(answer: Callable[[Array], Array]) -> Callable[[Array], tuple[Array, Array, Array]]:
    """Value, gradient and Hessian of an answer."""
    gradient = jax.jacfwd(answer)
    return lambda point: (answer(point), gradient(point), jax.jacfwd(gradient)(point))


@eqx.filter_jit
def evaluated(transform: Callable[..., Any], answer: ParametricAnswer, point: Array) -> Any:
    """A transformed answer at a point, compiled once for all values of the parameters."""
    return transform(answer)(point)


def sampled(
    transform: Callable[..., Any], answer: ParametricAnswer, points: np.ndarray
) -> np.ndarray:
    """As `evaluated`, at many points, in chunks that fit into memory."""
    chunks = [jnp.asarray(points[k : k + _CHUNK]) for k in range(0, len(points), _CHUNK)]
    return np.concatenate([np.asarray(evaluated(transform, answer, chunk)) for chunk in chunks])
