"""Suites: several records, of any lengths and time steps, as one argument."""

from collections.abc import Iterator, Sequence
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..host import Printed
from ..validation import (
    FINITE,
    POSITIVE,
    Number,
    Numbers,
    Reals,
    as_real,
    as_text,
    check,
    describe,
    is_traced,
)
from .drift import warn_of_drifts
from .intensity import intensity_measure
from .record import Record


class Suite(Printed, eqx.Module):
    """Several recorded ground motions, each with its own number of samples and time step.

    What takes one `Record` and many blocks takes a suite as well, and answers with a leading
    axis for its records.

    Parameters
    ----------
    records : sequence of Record
        At least one, each with one-dimensional samples and scales of one common shape.
    names : sequence of str, optional
        Different from each other; by default ``"1"``, ``"2"`` and so on.

    Raises
    ------
    ValueError
        If there is no record, if one is an array of them, if scales differ in shape, or if the
        names are not one different word for each.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> import jaxrock as jr
    >>> suite = jr.Suite([jr.example_record("north"), jr.example_record("east")], ["N", "E"])
    >>> blocks = jr.Block(half_width=jnp.array([0.1, 0.2, 0.4]), slenderness=5.0)
    >>> print(jr.respond_batch(blocks, 0.8, suite).peak_rotation.shape)
    (2, 3)
    """

    records: tuple[Record, ...]
    names: tuple[str, ...] = eqx.field(static=True)

    # For messages, as in `check_kind`.
    _reader: ClassVar[str] = "read_suite"
    _element: ClassVar[type[Record]] = Record

    def __init__(self, records: Sequence[Record], names: Sequence[str] | None = None):
        if isinstance(records, Record) or not isinstance(records, Sequence):
            raise ValueError(f"records must be a list of records, got {describe(records)}")
        if not records:
            raise ValueError("records must be at least one record, got none")
        self.records = tuple(records)
        # A string is a sequence of strings as well, of its letters.
        if isinstance(names, str):
            raise ValueError(f"names must be a list of names, got {names!r}")
        if names is None:
            names = [str(number) for number in range(1, len(records) + 1)]
        self.names = tuple(map(as_text, names))
        for k, record in enumerate(self.records):
            if not isinstance(record, Record):
                raise ValueError(
                    f"records must be records, got a {type(record).__name__} as number {k + 1}"
                )
            samples = (record.acceleration, record.vertical)
            if any(np.ndim(component) > 1 for component in jax.tree.leaves(samples)):
                raise ValueError(
                    f"records must be single ones, number {k + 1} is an array of them"
                )
            if np.shape(record.time_step) or np.shape(record.start):
                raise ValueError(
                    f"records must have one time step and start, not number {k + 1}"
                )
            shape = np.shape(record.scale)
            first = np.shape(self.records[0].scale)
            if shape != first:
                differs = f"got {first} and, in number {k + 1}, {shape}"
                raise ValueError(f"records must have scales of one shape, {differs}")
        not_text = [name for name in self.names if not isinstance(name, str)]
        if not_text:
            raise ValueError(f"names must be words, got {not_text[0]!r}")
        if len(self.names) != len(self.records):
            counts = f"got {len(self.names)} names of {len(self.records)} records"
            raise ValueError(f"names must be as many as records, {counts}")
        twice = [name for k, name in enumerate(self.names) if name in self.names[:k]]
        if twice:
            raise ValueError(f"names must differ from each other, got {twice[0]!r} twice")

    def __str__(self) -> str:
        samples, steps = (
            sorted({number(record) for record in self.records})
            for number in (
                lambda record: record.samples,
                lambda record: float(record.time_step),
            )
        )

        def format_range(values: list[int] | list[float]) -> str:
            """Write the smallest and the largest of sorted values, or the only one."""
            words = [
                f"{value:,}" if value == int(value) else f"{value:.4g}" for value in values
            ]
            return words[0] if len(words) == 1 else f"{words[0]} to {words[-1]}"

        return (
            f"suite of {len(self)} record{'s' * (len(self) > 1)} of {format_range(samples)}"
            f" samples, {format_range(steps)} s apart"
        )

    def __len__(self) -> int:
        return len(self.records)

    def __iter__(self) -> Iterator[Record]:
        return iter(self.records)

    def __getitem__(self, which: "int | str | slice") -> "Record | Suite":
        """Select one record, by its number from 0 on or its name, or a part of the suite."""
        if isinstance(which, slice):
            return Suite(self.records[which], self.names[which])
        which = as_text(which)
        if isinstance(which, str):
            if which not in self.names:
                raise KeyError(f"no record is named {which!r}")
            which = self.names.index(which)
        return self.records[which]

    def measure(self, measure: str, block: Block | None = None) -> Reals:
        """Measure the intensity of each record, as it is scaled now.

        Parameters
        ----------
        measure, block
            As in `intensity_measure`.

        Returns
        -------
        Array, shape (records, ...)
            In the unit of the measure.

        Raises
        ------
        ValueError
            If there is no such measure, or a ratio is asked for without a block.
        """
        measures = [intensity_measure(record, measure, block) for record in self.records]
        if is_traced(measures):
            return jnp.stack(measures)
        # `jnp.stack` would compile a program for each number of records.
        return jax.device_put(np.stack(measures))

    def factors(self, levels: Numbers, measure: str, block: Block | None = None) -> Reals:
        """Compute the factors that bring each record to levels of an intensity measure.

        Parameters
        ----------
        levels : array_like
            Greater than 0 [unit of the measure].
        measure, block
            As in `intensity_measure`.

        Returns
        -------
        Array, shape (records, ...)
            For `scaled` [-], with the axes of the levels last.

        Raises
        ------
        ValueError
            If a level is not greater than 0, or if a record has none of the measure.
        """
        levels = as_real("levels", levels)
        check("levels", levels, POSITIVE)
        # `scaled` takes an axis for the records and then broadcasts against the scales: axes
        # of levels would meet those of the scales.
        shape = np.shape(self.records[0].scale)
        if shape and levels.ndim:
            raise ValueError(
                f"levels must be one where scales are arrays, of shape {shape} here"
            )
        measures = require_positive_measures(self, measure, block)
        return levels[(None,) * measures.ndim] / measures.reshape(
            *measures.shape, *[1] * levels.ndim
        )

    def scaled(self, factors: Number) -> "Suite":
        """Scale the records.

        Parameters
        ----------
        factors : array_like, shape () or (records, ...)
            Finite [-].

        Returns
        -------
        Suite

        Raises
        ------
        ValueError
            If a factor is not finite, or the leading axis is not that of the records.
        """
        factors = as_real("factors", factors, unit="")
        check("factors", factors, FINITE)
        if factors.ndim and len(factors) != len(self):
            raise ValueError(
                f"factors must be one, or one for each of {len(self)} records,"
                f" got an array of shape {factors.shape}"
            )
        if not factors.ndim:
            record_factors = [factors] * len(self)
        elif is_traced(factors):
            record_factors = list(factors)
        else:
            # In NumPy: JAX would compile a program to take the array apart.
            record_factors = list(np.asarray(factors))
        scaled = [
            record.scaled(factor)
            for record, factor in zip(self.records, record_factors, strict=True)
        ]
        return Suite(scaled, self.names)


def require_positive_measures(suite: Suite, measure: str, block: Block | None = None) -> Reals:
    """Measure the records, each of which has to be above 0, so that a factor can scale it.

    Raises a `ValueError` otherwise, and warns where PGV is due to a drift.
    """
    measures = suite.measure(measure, block)
    if not is_traced(measures):
        if as_text(measure).startswith("pgv"):
            warn_of_drifts(suite.names, suite.records)
        for name, value in zip(suite.names, np.asarray(measures), strict=True):
            if not (value > 0).all():
                raise ValueError(
                    f"every record must have a {as_text(measure)} greater than 0 to be scaled,"
                    f" got {value.min():.9g} for {name!r}"
                )
    return measures
