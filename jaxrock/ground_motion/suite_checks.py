"""The records of a suite: checks of them, their names and intensities, and their description."""

from collections.abc import Sequence

import jax
import numpy as np

from ..validation import describe
from .drift import warn_of_drifts
from .record import Record


def check_records(records: Sequence[Record]) -> tuple[Record, ...]:
    """Return the records of a suite; a `ValueError` if they are not allowed."""
    if isinstance(records, Record) or not isinstance(records, Sequence):
        raise ValueError(f"records must be a list of records, got {describe(records)}")
    if not records:
        raise ValueError("records must be at least one record, got none")
    for k, record in enumerate(records):
        if not isinstance(record, Record):
            raise ValueError(
                f"records must be Records, got a {type(record).__name__} as number {k + 1}"
            )
        samples = (record.acceleration, record.vertical)
        if any(np.ndim(component) > 1 for component in jax.tree.leaves(samples)):
            raise ValueError(
                f"records must be single records, but number {k + 1} is an array of records"
            )
        if np.shape(record.time_step) or np.shape(record.start):
            raise ValueError(
                f"records must have a single time step and start, but number {k + 1} has several"
            )
        shape = np.shape(record.scale)
        first = np.shape(records[0].scale)
        if shape != first:
            differs = f"got {first} and, in number {k + 1}, {shape}"
            raise ValueError(f"records must have scales of one shape, {differs}")
    return tuple(records)


def check_names(names: Sequence[str] | None, count: int) -> tuple[str, ...]:
    """Return the names of so many records, by default numbers; a `ValueError` if not allowed."""
    # A string is a sequence of strings as well, of its letters.
    if isinstance(names, str):
        raise ValueError(f"names must be a list of names, got {names!r}")
    if names is None:
        names = [str(number) for number in range(1, count + 1)]
    words = tuple(names)
    not_text = [name for name in words if not isinstance(name, str)]
    if not_text:
        raise ValueError(f"names must be words, got {not_text[0]!r}")
    if len(words) != count:
        counts = f"got {len(words)} for {count} records"
        raise ValueError(f"names must be one for each record, {counts}")
    twice = [name for k, name in enumerate(words) if name in words[:k]]
    if twice:
        raise ValueError(f"names must differ from each other, got {twice[0]!r} twice")
    return tuple(map(str, words))  # plain ones: Equinox takes those of NumPy for arrays


def check_measures(
    measures: np.ndarray, measure: str, names: Sequence[str], records: Sequence[Record]
) -> None:
    """Raise `ValueError` if a measure is not above 0, and warn where PGV is due to a drift."""
    if measure.startswith("pgv"):
        warn_of_drifts(names, records)
    for name, value in zip(names, measures, strict=True):
        if not (value > 0).all():
            raise ValueError(
                f"every record must have a {measure} greater than 0 to be scaled,"
                f" got {value.min():.9g} for {name!r}"
            )


def describe_samples(records: Sequence[Record]) -> str:
    """Describe how many samples concrete records have, and how far apart."""
    samples = sorted({record.samples for record in records})
    steps = sorted({float(record.time_step) for record in records})
    return f"{_format_range(samples)} samples, {_format_range(steps)} s apart"


def _format_range(values: list[int] | list[float]) -> str:
    """Write the smallest and the largest of sorted values, or the only one."""
    words = [f"{value:,}" if value == int(value) else f"{value:.4g}" for value in values]
    return words[0] if len(words) == 1 else f"{words[0]} to {words[-1]}"
