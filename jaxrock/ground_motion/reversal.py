"""Records in the opposite direction, and parts of a suite that has records in both."""

import equinox as eqx
import numpy as np

from ..validation import AnyArray, as_array, is_traced
from .record import Record

REVERSED = " reversed"  # at the end of the names of such records


def reverse_record(record: Record) -> Record:
    """Reverse the sign of the horizontal acceleration of a record."""
    samples = record.acceleration
    # In NumPy: JAX would compile a program for each length.
    reverse = -samples if is_traced(samples) else as_array(-np.asarray(samples))
    return eqx.tree_at(lambda record: record.acceleration, record, reverse)


def average_directions(values: AnyArray, directions: int) -> AnyArray:
    """Average values of shape (records, ...) of a suite over the directions of each record."""
    if directions == 1:
        return values
    return values.reshape(directions, -1, *values.shape[1:]).mean(axis=0)


def find_directions(which: slice, recordings: int, directions: int) -> int:
    """Find in how many directions a part of a suite has its records.

    Raises a `ValueError` if that differs from record to record.
    """
    places = range(recordings * directions)[which]
    sources = [place % recordings for place in places]
    if len(set(sources)) == len(sources):
        return 1
    half = len(places) // 2
    if list(places[half:]) != [place + recordings for place in places[:half]]:
        raise ValueError(
            "a slice of a suite in both directions must take each of its records in one"
            " direction only, or first all as recorded and then the same reversed, got"
            f" {which.start}:{which.stop}:{which.step}"
        )
    return 2
