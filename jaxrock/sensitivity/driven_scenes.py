"""Blocks on moving ground whose numbers may vary, those of the motion included."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import equinox as eqx

from ..block import Block
from ..driven import Batch, BatchResponse, check_batch, follow_batch, require_complete
from ..ground_motion import Harmonic, Motion, Pulse, Suite
from ..resonance import RockingModel
from ..validation import Number, choose_namespace

# The highest rotation may come after the end of the ground motion [s].
BEYOND = 10.0


def gather_scene(
    block: Block, restitution: Number, motion: Motion | Suite, duration: Number | None = None
) -> tuple[dict[str, Any], Number | None]:
    """Gather what may vary, and the duration; a `ValueError` if an argument is not allowed.

    A factor on any motion is among it, besides its own numbers.
    """
    restitution, duration = check_batch(block, restitution, motion, duration)
    numbers = {name: getattr(motion, name) for name in _name_fields(motion)}
    return numbers | {"block": block, "restitution": restitution, "factor": 1.0}, duration


def make_batch(
    scene: Mapping[str, Any], motion: Any, duration: Number | None = None, **options: Any
) -> Batch:
    """Make the batch of values, which may be traced, of what `gather_scene` gathers."""
    for name in _name_fields(motion):
        motion = eqx.tree_at(lambda part, name=name: getattr(part, name), motion, scene[name])
    batch = Batch.of(scene["block"], scene["restitution"], motion, duration, **options)
    factor = scene["factor"]
    return batch.scaled(choose_namespace([factor]).asarray(factor, batch.dtype))


def simulate_scenes(
    scene: Mapping[str, Any], motion: Motion, model: RockingModel
) -> BatchResponse:
    """Simulate blocks under one kind of motion; a `ValueError` if one did not finish."""
    batch = make_batch(scene, motion)
    response = follow_batch(replace(batch, until=batch.until + BEYOND), model)
    require_complete(response.complete, sample=None)
    return response


def _name_fields(motion: object) -> tuple[str, ...]:
    """Name the numbers of a motion that may vary."""
    if isinstance(motion, Pulse):
        return ("amplitude", "duration")
    return ("amplitude", "frequency") if isinstance(motion, Harmonic) else ()
