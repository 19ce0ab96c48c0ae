"""What boundaries are sought along, and the motions that are followed for it."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.core
import numpy as np
from jaxtyping import Array

from ..block import Block
from ..dynamics import BatchResponse, DrivenScene, respond_batch
from ..ground_motion import Harmonic, Motion, Pulse, Record, Suite
from ..validation import (
    AT_LEAST_ONE,
    FINITE,
    NON_NEGATIVE,
    POSITIVE,
    UNIT_INTERVAL,
    Domain,
    Number,
    Numbers,
    as_real,
    check,
    check_kind,
    of_one_precision,
)


class Search(NamedTuple):
    """What is sought, and how; static in compiled programs."""

    along: str
    model: Any
    max_boundaries: int
    halvings: int = 0  # of intervals in which the mode changes, or the margin comes near 0
    drop_unknown: bool = False  # derivatives that cannot be had are 0 then, and not NaN
    alone: bool = False  # the same bits whatever else is sought at the same time


def _strength(scene: Any) -> Any:
    return scene.motion.scale if isinstance(scene.motion, Record) else scene.motion.amplitude


# What boundaries are sought along: its domain, the motions that have it, its place in a scene.
_QUANTITIES: dict[str, tuple[Domain, Any, Callable[[Any], Any]]] = {
    "amplitude": (FINITE, Pulse | Harmonic, _strength),
    "duration": (POSITIVE, Pulse, lambda scene: scene.motion.duration),
    "frequency": (POSITIVE, Harmonic, lambda scene: scene.motion.frequency),
    "factor": (NON_NEGATIVE, Motion, _strength),  # on what is there
    "half_width": (POSITIVE, Motion, lambda scene: scene.block.half_width),
    "slenderness": (POSITIVE, Motion, lambda scene: scene.block.slenderness),
    "inertia_ratio": (AT_LEAST_ONE, Motion, lambda scene: scene.block.inertia_ratio),
    "restitution": (UNIT_INTERVAL, Motion, lambda scene: scene.restitution),
}


UNITS = {"amplitude": "m/s2", "duration": "s", "frequency": "rad/s", "half_width": "m"}


def with_unit(along: str, value: float) -> str:
    """A value of a quantity as one writes it, an acceleration also in g."""
    text = f"{value:.6g} {UNITS.get(along, '')}".rstrip()
    return f"{text} ({value / 9.81:.3g} g)" if along == "amplitude" else text


def checked(
    block: Block, restitution: Number, motion: Motion, along: str, values: Numbers
) -> tuple[DrivenScene, Array]:
    """The scene and the values of a search; a `ValueError` if they are not allowed."""
    check_kind("motion", motion, Pulse, Harmonic, Record, Suite)
    allowed = [name for name, (_, has, _) in _QUANTITIES.items() if isinstance(motion, has)]
    if along not in allowed:
        raise ValueError(f"along must be one of {', '.join(allowed)}, got {along!r}")
    places = as_real("values", values)
    check("values", places, _QUANTITIES[along][0])
    scene = DrivenScene(block, restitution, motion)
    samples = jax.tree.leaves(split(scene)[1])
    if any(np.ndim(direction) > 1 for direction in samples):
        raise ValueError("motion must be one record, got an array of them")
    if places.ndim == 0 or places.shape[-1] < 2:
        raise ValueError(
            f"values must be at least two values, got an array of shape {places.shape}"
        )
    if not is_traced(places) and (np.diff(np.asarray(places)) <= 0).any():
        raise ValueError("values must be increasing, got values that do not increase")
    return of_one_precision((scene, places))


def split(scene: DrivenScene) -> tuple[Any, Any]:
    """The numbers of a scene, one a block, and the samples of its record, which all share.

    How many of these a padded record has goes with them.
    """
    samples = ("acceleration", "vertical", "filled")
    is_number = jax.tree.map_with_path(
        lambda path, _: getattr(path[-1], "name", "") not in samples, scene
    )
    return eqx.partition(scene, is_number)


def is_traced(tree: Any) -> bool:
    """Whether any number of a tree is traced."""
    return any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(tree))


def scene_at(scene: DrivenScene, value: Any, search: Search) -> DrivenScene:
    """The scene at a value of the quantity."""
    *_, place = _QUANTITIES[search.along]
    value = place(scene) * value if search.along == "factor" else value
    return eqx.tree_at(place, scene, value)  # unchecked: the values have been


def respond_at(scene: DrivenScene, value: Any, search: Search, until: Any = None) -> BatchResponse:
    """The response at a value, to a time or to the end of the input."""
    scene = scene_at(scene, value, search)
    return respond_batch(scene.block, scene.restitution, scene.motion, until, model=search.model)
