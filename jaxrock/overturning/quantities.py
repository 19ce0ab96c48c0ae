"""Quantities along which boundaries are sought, and the motions that are simulated for it."""

from types import UnionType
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array

from ..block import SHAPE, SIDES, SIZES_IN_WORDS, Block, change_block
from ..driven import Batch, BatchResponse, GroundMotions, follow_batch
from ..ground_motion import Harmonic, Motion, Pulse, Record, Suite
from ..impact import read_restitution
from ..resonance import ModelLike, as_model
from ..tables import QUANTITIES
from ..tables import UNITS as ALL_UNITS
from ..validation import (
    FINITE,
    NON_NEGATIVE,
    AnyArray,
    Number,
    Numbers,
    as_name,
    as_real,
    check,
    check_increasing,
    check_kind,
    check_shapes,
    unify_precision,
)


class Search(NamedTuple):
    """The kind of a search; static in compiled programs.

    Attributes
    ----------
    along : str
        The quantity.
    model : Nonlinear or Linearized, or their names
        Equation of motion.
    max_boundaries : int
        Number of boundaries that are listed under a transformation.
    halvings : int
        Number of times that an interval is halved in which the mode changes, or in which the
        margin comes near 0.
    drop_unknown : bool
        Whether derivatives that cannot be had are 0 instead of NaN, so that a sum over many
        boundaries has the derivatives of all others.
    tolerance : float or None
        Relative width [-] of the bracket around a boundary at which refinement ends. None: to
        rounding.
    """

    along: str
    model: ModelLike
    max_boundaries: int
    halvings: int = 0
    drop_unknown: bool = False
    tolerance: float | None = None


class Subject(eqx.Module):
    """Blocks on moving ground, whose boundaries are sought."""

    block: Block
    restitution: AnyArray | np.floating
    motion: Pulse | Harmonic | GroundMotions


# Quantities of motions; all others belong to the block and its impacts.
_MOTIONS: dict[str, type[Motion] | UnionType] = {
    "amplitude": Pulse | Harmonic,
    "duration": Pulse,
    "frequency": Harmonic,
    "factor": Motion,
}
_NAMES = (*_MOTIONS, *SHAPE, *SIDES, "inertia_ratio", "restitution")
# Domains in which a search differs from an axis of a dataset.
_DOMAINS = {"amplitude": FINITE, "factor": NON_NEGATIVE}


# Ratios are printed without a unit.
UNITS = {name: ALL_UNITS[name] for name in _NAMES if ALL_UNITS[name] != "-"}


def format_value(along: str, value: float) -> str:
    """Write a value of a quantity, an acceleration also in g."""
    text = f"{value:.6g} {UNITS.get(along, '')}".rstrip()
    if along in SIZES_IN_WORDS:
        return f"{text}, {SIZES_IN_WORDS[along]}"
    return f"{text} ({value / 9.81:.3g} g)" if along == "amplitude" else text


def check_subject(
    block: Block, restitution: Number, motion: Motion | Suite, along: str, values: Numbers
) -> tuple[Subject, Array]:
    """Check the subject and the values of a search; a `ValueError` if they are not allowed."""
    check_kind("block", block, Block)
    check_kind("motion", motion, Pulse, Harmonic, Record, Suite)
    single = motion[0] if isinstance(motion, Suite) else motion
    allowed = [name for name in _NAMES if isinstance(single, _MOTIONS.get(name, Motion))]
    along = as_name("along", along, allowed)
    levels = as_real("values", values)
    check("values", levels, _DOMAINS.get(along, QUANTITIES[along].domain))
    restitution = read_restitution(block, restitution)
    if isinstance(single, Record) and single.acceleration.ndim > 1:
        raise ValueError("motion must be one record, got an array of them")
    if levels.ndim == 0 or levels.shape[-1] < 2:
        raise ValueError(
            f"values must have at least two elements, got an array of shape {levels.shape}"
        )
    cases = np.broadcast_to(0.0, levels.shape[:-1])
    check_shapes(block=block, restitution=restitution, motion=single, values=cases)
    check_increasing("values", levels)
    block, restitution, motion, levels = unify_precision((block, restitution, motion, levels))
    # The samples of records are converted to the form of the batch once for all values.
    if isinstance(motion, Record | Suite):
        batch = Batch.of(block, restitution, motion, axes=levels.ndim - 1)
        return Subject(batch.block, batch.restitution, batch.ground), levels
    assert isinstance(motion, Pulse | Harmonic)
    return Subject(block, restitution, motion), levels


def split_parameters(subject: Subject) -> tuple[Subject, Subject]:
    """Split a subject into the parameters of each block, and the samples common to all."""
    # The samples are the `input` of `GroundMotions`.
    is_parameter = jax.tree.map_with_path(
        lambda path, _: all(getattr(step, "name", "") != "input" for step in path), subject
    )
    return eqx.partition(subject, is_parameter)


def set_quantity(subject: Subject, value: AnyArray, search: Search) -> Subject:
    """Give a subject a value of the quantity that the search is along."""
    # There is no check: `check_subject` has checked all values.
    along = search.along
    if along == "restitution":
        return eqx.tree_at(lambda s: s.restitution, subject, value)
    if along not in _MOTIONS:
        block = change_block(subject.block, along, value)
        return eqx.tree_at(lambda s: s.block, subject, block)
    name = along
    if along == "factor":
        name = "factor" if isinstance(subject.motion, GroundMotions) else "amplitude"
        value = value * getattr(subject.motion, name)
    return eqx.tree_at(lambda s: getattr(s.motion, name), subject, value)


def respond_at(
    subject: Subject,
    value: AnyArray,
    search: Search,
    count: jax.Array | int | None = None,
) -> BatchResponse:
    """Simulate the response at a value, until the end of the input.

    In a transformation, only the first `count` blocks need be simulated.
    """
    at = set_quantity(subject, value, search)
    batch = Batch.of(at.block, at.restitution, at.motion)
    return follow_batch(batch, as_model(search.model), count=count)
