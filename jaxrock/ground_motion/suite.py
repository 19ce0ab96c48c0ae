"""Suites: several records, of any lengths and time steps, as one argument."""

from collections.abc import Iterator, Sequence
from typing import Any, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..host import Printed, format_number
from ..validation import (
    FINITE,
    POSITIVE,
    AnyArray,
    Number,
    Numbers,
    Reals,
    as_array,
    as_real,
    check,
    check_kind,
    choose_namespace,
    describe,
    is_traced,
)
from .drift import warn_of_drifts
from .floor import FLOOR_DAMPING, Floor
from .intensity import intensity_measure
from .record import Record, put_on_floor

REVERSED = " reversed"  # at the end of the names of records in the opposite direction


class Suite(Printed, eqx.Module):
    """Several recorded ground motions, each with its own number of samples and time step.

    Functions that take one `Record` and many blocks take a suite as well. Their answers then
    have a leading axis for the records.

    Parameters
    ----------
    records : sequence of Record
        At least one, each with one-dimensional samples and scales of one common shape.
    names : sequence of str, optional
        Different from each other; by default ``"1"``, ``"2"`` and so on.
    ground : Suite, optional
        The motions of the ground, if the records are motions of a floor: one for each record,
        as `on_floor` sets them. Intensities are then those of the ground.
    floor : Floor, optional
        The floor with which the records were computed from the records of the ground.
    directions : {1, 2}
        2 if the second half of the records is the first half with the opposite sign of the
        horizontal acceleration, as `both_directions` gives it. The two directions of a record
        count as one record wherever the number of independent records matters.
    source : str
        Where the records come from; empty if unknown.

    Raises
    ------
    ValueError
        If there is no record, a record is an array of records, scales differ in shape, names
        are not different words, or the ground differs in records, names, scales or directions.

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
    ground: "Suite | None"
    floor: Floor | None
    directions: int = eqx.field(static=True)
    source: str = eqx.field(static=True)

    def __init__(
        self,
        records: Sequence[Record],
        names: Sequence[str] | None = None,
        *,
        ground: "Suite | None" = None,
        floor: Floor | None = None,
        directions: int = 1,
        source: str = "",
    ):
        self.records = _check_records(records)
        self.names = _check_names(names, len(self.records))
        if directions not in (1, 2) or len(self.records) % directions:
            raise ValueError(
                "directions must be 1, or 2 if the second half reverses the first, got"
                f" {directions!r:.60} for {len(self.records)} records"
            )
        if ground is not None:
            check_kind("ground", ground, Suite)
            shapes = [np.shape(part[0].scale) for part in (self.records, ground.records)]
            same = (ground.names, ground.directions) == (self.names, directions)
            if not same or shapes[0] != shapes[1] or ground.ground is not None:
                raise ValueError(
                    "ground must be a suite on the ground, with the names, shape of scales and"
                    f" directions of this suite, got {ground}"
                )
        if floor is not None:
            check_kind("floor", floor, Floor)
            if ground is None or floor.shape:
                raise ValueError(
                    f"floor must be a single floor, given together with ground, got {floor}"
                )
        self.ground = ground
        self.floor = floor
        self.directions = int(directions)
        self.source = source

    def __str__(self) -> str:
        ways = " in both directions" * (self.directions == 2)
        if all(name.endswith(REVERSED) for name in self.names):
            ways = " in reverse direction"
        samples = format_number(np.array([record.samples for record in self.records]))
        steps = format_number(np.array([float(record.time_step) for record in self.records]))
        summary = (
            f"suite of {self.recordings} record{'s' * (self.recordings > 1)}{ways} of"
            f" {samples} samples, {steps} s apart"
        )
        if self.ground is None:
            return summary
        floor = "floors" if self.floor is None else f"a {self.floor}"
        return f"{summary}, on {floor}; intensities are those of the ground"

    @property
    def recordings(self) -> int:
        """Number of records; both directions of a record count as one [-]."""
        return len(self.records) // self.directions

    def __len__(self) -> int:
        return len(self.records)

    def __iter__(self) -> Iterator[Record]:
        return iter(self.records)

    def __getitem__(self, which: "int | str | slice") -> "Record | Suite":
        """Select one record, by its number from 0 on or its name, or a part of the suite.

        A part of a suite in both directions has both of each of its records, or one.
        """
        if isinstance(which, slice):
            directions = self._find_directions(which)
            names = self.names[which]
            number = len(names) // directions
            part = f"{number} of " if self.source and number < self.recordings else ""
            return self._replace(
                records=self.records[which],
                names=names,
                ground=None if self.ground is None else self.ground[which],
                directions=directions,
                source=part + self.source,
            )
        if isinstance(which, str):
            if which not in self.names:
                raise KeyError(f"no record is named {which!r}")
            which = self.names.index(which)
        return self.records[which]

    def _replace(self, **fields: Any) -> "Suite":
        """Make a suite with some other fields."""
        return Suite(**{**vars(self), **fields})

    def _find_directions(self, which: slice) -> int:
        """Find in how many directions a part of the suite has its records."""
        indices = range(len(self))[which]
        recordings = [index % self.recordings for index in indices]
        if len(set(recordings)) == len(recordings):
            return 1
        half = len(indices) // 2
        if list(indices[half:]) != [index + self.recordings for index in indices[:half]]:
            raise ValueError(
                "a slice of a suite in both directions must take each of its records in one"
                " direction only, or first all as recorded and then the same reversed, got"
                f" {which.start}:{which.stop}:{which.step}"
            )
        return 2

    def measure(self, measure: str, block: Block | None = None) -> Reals:
        """Measure the intensity of each record, as it is scaled now.

        For a suite on a floor it is the intensity of the ground, as in hazard curves.

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
        records = self.records if self.ground is None else self.ground.records
        measures = [intensity_measure(record, measure, block) for record in records]
        if is_traced(measures):
            return jnp.stack(measures)
        # `jnp.stack` would compile a program for each number of records.
        return jax.device_put(np.stack(measures))

    def factors(self, levels: Numbers, measure: str, block: Block | None = None) -> Reals:
        """Compute the factors that bring each record to levels of an intensity measure.

        For a suite on a floor, they bring the ground to the levels. A floor is linear:
        scaling its motion or the ground is the same.

        Parameters
        ----------
        levels : array_like
            Greater than 0 [unit of the measure].
        measure, block
            As in `intensity_measure`.

        Returns
        -------
        Array, shape (records, ...)
            Factors for `scaled` [-], with the axes of the levels last.

        Raises
        ------
        ValueError
            If a level is not greater than 0, or if the measure of a record is 0.
        """
        levels = as_real("levels", levels)
        check("levels", levels, POSITIVE)
        # `scaled` takes an axis of records and then broadcasts against the scales: axes of
        # levels would collide with axes of scales.
        shape = np.shape(self.records[0].scale)
        if shape and levels.ndim:
            raise ValueError(f"levels must be one level if scales are arrays, here of {shape}")
        measures = require_positive_measures(self, measure, block)
        return levels[(None,) * measures.ndim] / measures.reshape(
            *measures.shape, *[1] * levels.ndim
        )

    def scaled(self, factors: Number) -> "Suite":
        """Scale the records, and the ground below them.

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
                f"factors must be one factor, or one for each of {len(self)} records,"
                f" got an array of shape {factors.shape}"
            )
        # NumPy is used: JAX would compile a program to split the array.
        rows = (
            choose_namespace(factors).asarray(factors)
            if factors.ndim
            else [factors] * len(self)
        )
        return self._replace(
            records=[
                record.scaled(row) for record, row in zip(self.records, rows, strict=True)
            ],
            ground=None if self.ground is None else self.ground.scaled(factors),
        )

    def on_floor(
        self,
        period: Numbers = 0.5,
        damping: Numbers = FLOOR_DAMPING,
        participation: Numbers = 1.0,
        *,
        time_step: Number | None = None,
        free_vibration: Number | None = None,
    ) -> "Suite":
        """Compute the motions of a floor on the ground of each record; see `Record.on_floor`.

        Parameters
        ----------
        period, damping, participation
            As in `Record.on_floor`, of a single floor.
        time_step, free_vibration : float, optional
            As in `Record.on_floor`. A record with a finer step keeps it.

        Returns
        -------
        Suite
            Its `ground` is this suite. Its intensities are still those of the ground, to
            which hazards and levels refer.

        Raises
        ------
        ValueError
            As in `Record.on_floor`, if there are several floors, or the suite is on a floor.

        Examples
        --------
        >>> import jaxrock as jr
        >>> suite = jr.example_suite()[:2].on_floor(period=0.4, damping=0.05)
        >>> on_floor = jr.Suite(suite.records)  # without its ground
        >>> print(suite.measure("pga").round(1), on_floor.measure("pga").round(1))
        [2.5 2.5] [5.5 3.7]
        """
        if self.ground is not None:
            raise ValueError(f"suite must be on the ground to be put on a floor, got {self}")
        floor = Floor(
            period,
            damping,
            participation,
            time_step=time_step,
            free_vibration=free_vibration,
        )
        if floor.shape:
            raise ValueError(
                "period, damping and participation must describe one floor, got floors of"
                f" shape {floor.shape}"
            )
        records = [put_on_floor(record, floor) for record in self.records]
        return self._replace(records=records, ground=self, floor=floor)

    def both_directions(self) -> "Suite":
        """Add the reverse of each record: its horizontal acceleration in the other direction.

        Use it for one-sided blocks. The two directions of a record are not independent, so
        fragility curves and rates take the mean of both.

        Returns
        -------
        Suite
            First all records as they are, then all reversed, named ``"x"`` and ``"x reversed"``.

        Raises
        ------
        ValueError
            If the suite is in both directions already.

        Examples
        --------
        >>> import jaxrock as jr
        >>> print(jr.example_suite().both_directions().names[::20])
        ('anchorage_2018_delaney_park east', 'anchorage_2018_delaney_park east reversed')
        """
        if self.directions == 2:
            raise ValueError(f"suite must be in one direction, got {self}")
        return self._replace(
            records=[*self.records, *map(_reverse_record, self.records)],
            names=[*self.names, *(f"{name}{REVERSED}" for name in self.names)],
            ground=None if self.ground is None else self.ground.both_directions(),
            directions=2,
        )


def _check_records(records: Sequence[Record]) -> tuple[Record, ...]:
    """Return the records of a suite; a `ValueError` if they are not allowed."""
    if not isinstance(records, Sequence) or not records:
        raise ValueError(
            f"records must be a list of at least one record, got {describe(records)}"
        )
    for number, record in enumerate(records, 1):
        check_kind(f"record {number}", record, Record)
        samples = [record.acceleration, record.vertical]
        axes = [np.ndim(part) - 1 for part in jax.tree.leaves(samples)]
        if any((*axes, np.ndim(record.time_step), np.ndim(record.start))):
            raise ValueError(
                "records must be single records with one time step and start, got several as"
                f" number {number}"
            )
        shape, first = np.shape(record.scale), np.shape(records[0].scale)
        if shape != first:
            raise ValueError(
                f"records must have scales of one shape, got {first} and, in number {number},"
                f" {shape}"
            )
    return tuple(records)


def _check_names(names: Sequence[str] | None, count: int) -> tuple[str, ...]:
    """Return the names of records, by default numbers; a `ValueError` if not allowed."""
    if names is None:
        return tuple(str(number) for number in range(1, count + 1))
    # A string is a sequence of strings as well: its letters.
    allowed = not isinstance(names, str) and all(isinstance(name, str) for name in names)
    if not allowed or len(names) != count or len(set(names)) != count:
        raise ValueError(
            f"names must be a list of different names, one for each of {count} records, got"
            f" {describe(names)}"
        )
    return tuple(map(str, names))  # plain strings: Equinox takes NumPy strings for arrays


def _reverse_record(record: Record) -> Record:
    """Reverse the sign of the horizontal acceleration of a record."""
    samples = record.acceleration
    # NumPy is used: JAX would compile a program for each length.
    reverse = as_array(choose_namespace(samples).negative(samples))
    return eqx.tree_at(lambda record: record.acceleration, record, reverse)


def average_directions(values: AnyArray, directions: int) -> AnyArray:
    """Average values of shape (records, ...) of a suite over the directions of each record."""
    if directions == 1:
        return values
    return values.reshape(directions, -1, *values.shape[1:]).mean(axis=0)


def require_positive_measures(suite: Suite, measure: str, block: Block | None = None) -> Reals:
    """Measure the records; each measure has to be above 0, so that a factor can scale it.

    Raises a `ValueError` otherwise, and warns where PGV is due to a drift.
    """
    measures = suite.measure(measure, block)
    if is_traced(measures):
        return measures
    ground = suite if suite.ground is None else suite.ground
    if measure.startswith("pgv"):
        warn_of_drifts(ground.names, ground.records)
    for name, value in zip(ground.names, np.asarray(measures), strict=True):
        if not (value > 0).all():
            raise ValueError(
                f"every record must have a {measure} greater than 0 to be scaled,"
                f" got {value.min():.9g} for {name!r}"
            )
    return measures


def describe_suite(suite: Suite) -> dict[str, int | str]:
    """Make the attributes of a dataset about the source of the records, directions and floor."""
    described: dict[str, int | str] = {}
    if suite.source:
        described["record_source"] = suite.source
    if suite.directions != 1:
        described["directions"] = suite.directions
    if suite.ground is not None:
        described["floor"] = "given by records" if suite.floor is None else str(suite.floor)
    return described


def vary_floor(
    suite: Suite, period_factor: np.ndarray, damping_factor: np.ndarray
) -> tuple[Record, ...]:
    """Compute the motions of floors that differ from the floor of a suite.

    Parameters
    ----------
    suite : Suite
        On a floor.
    period_factor, damping_factor : Array, shape (floors,)
        Factors on the periods and the dampings of all modes [-].

    Returns
    -------
    tuple of Record
        One for each record, whose samples have an axis of floors.
    """
    ground = cast("Suite", suite.ground)
    floor = cast("Floor", suite.floor)
    shape = (-1, *[1] * floor.participation.ndim)
    floors = Floor(
        np.asarray(floor.period) * period_factor.reshape(shape),
        np.asarray(floor.damping) * damping_factor.reshape(shape),
        floor.participation,
        time_step=floor.time_step,
        free_vibration=floor.free_vibration,
    )
    return tuple(put_on_floor(record, floors) for record in ground)
