"""What boundaries are sought along, and the motions that are followed for it."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.core
import numpy as np
from jaxtyping import Array

from ..block import Block
from ..driven import Batch, BatchResponse, GroundMotions, follow_batch
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
    check_shapes,
    is_traced,
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


class Subject(eqx.Module):
    """Blocks on moving ground, of which boundaries are sought."""

    block: Block
    restitution: Any
    motion: Pulse | Harmonic | GroundMotions


def _strength(subject: Any) -> Any:
    motion = subject.motion
    return motion.factor if isinstance(motion, GroundMotions) else motion.amplitude


# What boundaries are sought along: its domain, the motions that have it, its place in a
# subject.
_QUANTITIES: dict[str, tuple[Domain, Any, Callable[[Any], Any]]] = {
    "amplitude": (FINITE, Pulse | Harmonic, _strength),
    "duration": (POSITIVE, Pulse, lambda subject: subject.motion.duration),
    "frequency": (POSITIVE, Harmonic, lambda subject: subject.motion.frequency),
    "factor": (NON_NEGATIVE, Motion, _strength),  # on what is there
    "half_width": (POSITIVE, Motion, lambda subject: subject.block.half_width),
    "slenderness": (POSITIVE, Motion, lambda subject: subject.block.slenderness),
    "inertia_ratio": (AT_LEAST_ONE, Motion, lambda subject: subject.block.inertia_ratio),
    "restitution": (UNIT_INTERVAL, Motion, lambda subject: subject.restitution),
}


UNITS = {"amplitude": "m/s2", "duration": "s", "frequency": "rad/s", "half_width": "m"}


def with_unit(along: str, value: float) -> str:
    """Write a value of a quantity, an acceleration also in g."""
    text = f"{value:.6g} {UNITS.get(along, '')}".rstrip()
    return f"{text} ({value / 9.81:.3g} g)" if along == "amplitude" else text


def checked(
    block: Block, restitution: Number, motion: Motion | Suite, along: str, values: Numbers
) -> tuple[Subject, Array]:
    """Check the subject and the values of a search; a `ValueError` if they are not allowed."""
    check_kind("block", block, Block)
    check_kind("motion", motion, Pulse, Harmonic, Record, Suite)
    single = motion[0] if isinstance(motion, Suite) else motion
    allowed = [name for name, (_, has, _) in _QUANTITIES.items() if isinstance(single, has)]
    if along not in allowed:
        raise ValueError(f"along must be one of {', '.join(allowed)}, got {along!r}")
    places = as_real("values", values)
    check("values", places, _QUANTITIES[along][0])
    restitution = as_real("restitution", restitution)
    check("restitution", restitution, UNIT_INTERVAL)
    if isinstance(single, Record) and single.acceleration.ndim > 1:
        raise ValueError("motion must be one record, got an array of them")
    if places.ndim == 0 or places.shape[-1] < 2:
        raise ValueError(
            f"values must be at least two values, got an array of shape {places.shape}"
        )
    of_each = np.broadcast_to(0.0, places.shape[:-1])
    check_shapes(block=block, restitution=restitution, motion=single, values=of_each)
    if not is_traced(places) and (np.diff(np.asarray(places)) <= 0).any():
        raise ValueError("values must be increasing, got values that do not increase")
    numbers = of_one_precision((block, restitution, motion, places))
    block, restitution, motion, places = numbers
    if isinstance(motion, Record | Suite):
        batch = Batch.of(block, restitution, motion, axes=places.ndim - 1)
        return Subject(batch.block, batch.restitution, batch.ground), places
    assert isinstance(motion, Pulse | Harmonic)
    return Subject(block, restitution, motion), places


def split(subject: Subject) -> tuple[Any, Any]:
    """Return the numbers of a subject, one a block, and the samples that all share."""
    is_number = jax.tree.map_with_path(
        lambda path, _: all(getattr(step, "name", "") != "parts" for step in path), subject
    )
    return eqx.partition(subject, is_number)


def subject_at(subject: Subject, value: Any, search: Search) -> Subject:
    """Return the subject at a value of the quantity."""
    *_, place = _QUANTITIES[search.along]
    value = place(subject) * value if search.along == "factor" else value
    return eqx.tree_at(place, subject, value)  # unchecked: the values have been


def respond_at(
    subject: Subject, value: Any, search: Search, until: Any = None, count: Any = None
) -> BatchResponse:
    """Follow the response at a value, to a time or to the end of the input."""
    at = subject_at(subject, value, search)
    batch = Batch.of(at.block, at.restitution, at.motion, until)
    return follow_batch(batch, search.model, count=count)
