"""Suites: several records, of any lengths and time steps, as one argument."""

from collections.abc import Iterator, Sequence
from typing import cast

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
    check,
    check_kind,
    is_traced,
)
from .floor import (
    FLOOR_DAMPING,
    Floor,
    compute_floor_motion,
    replace_motion,
    warn_of_coarse_step,
)
from .intensity import intensity_measure
from .record import Record
from .reversal import REVERSED, find_directions, reverse_record
from .suite_checks import check_measures, check_names, check_records, describe_samples


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
        self.records = check_records(records)
        self.names = check_names(names, len(self.records))
        if directions not in (1, 2) or len(self.records) % directions:
            raise ValueError(
                "directions must be 1, or 2 if the second half reverses the first, got"
                f" {directions!r:.60} for {len(self.records)} records"
            )
        if ground is not None:
            check_kind("ground", ground, Suite)
            numbers = (len(ground), np.shape(ground.records[0].scale), ground.directions)
            expected = (len(self.records), np.shape(self.records[0].scale), directions)
            if numbers != expected or ground.ground is not None:
                raise ValueError(
                    "ground must be a suite on the ground, with as many records, scales and"
                    f" directions as this suite, got {ground}"
                )
            if ground.names != self.names:
                names = f"{ground.names} and {self.names}"
                raise ValueError(f"ground must have the names of the records, got {names}")
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
        words = (
            f"suite of {self.recordings} record{'s' * (self.recordings > 1)}{ways} of"
            f" {describe_samples(self.records)}"
        )
        if self.ground is None:
            return words
        floor = "floors" if self.floor is None else f"a {self.floor}"
        return f"{words}, on {floor}; intensities are those of the ground"

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
            ground = None if self.ground is None else self.ground[which]
            directions = find_directions(which, self.recordings, self.directions)
            number = len(self.names[which]) // directions
            part = f"{number} of " if self.source and number < self.recordings else ""
            return Suite(
                self.records[which],
                self.names[which],
                ground=cast("Suite | None", ground),
                floor=self.floor,
                directions=directions,
                source=part + self.source,
            )
        if isinstance(which, str):
            if which not in self.names:
                raise KeyError(f"no record is named {which!r}")
            which = self.names.index(which)
        return self.records[which]

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
        # `scaled` takes an axis for the records and then broadcasts against the scales: axes
        # of levels would meet those of the scales.
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
        return Suite(
            scaled,
            self.names,
            ground=None if self.ground is None else self.ground.scaled(factors),
            floor=self.floor,
            directions=self.directions,
            source=self.source,
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

        Warns
        -----
        UserWarning
            As in `Record.on_floor`, for the record whose peak the straight lines miss most.

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
        motions = [
            compute_floor_motion(record.acceleration, record.vertical, record.time_step, floor)
            for record in self.records
        ]
        worst = max(range(len(motions)), key=lambda k: motions[k].missed)
        warn_of_coarse_step(motions[worst], self.names[worst])
        pairs = zip(self.records, motions, strict=True)
        return Suite(
            [replace_motion(record, motion) for record, motion in pairs],
            self.names,
            ground=self,
            floor=floor,
            directions=self.directions,
            source=self.source,
        )

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
        return Suite(
            [*self.records, *map(reverse_record, self.records)],
            [*self.names, *(f"{name}{REVERSED}" for name in self.names)],
            ground=None if self.ground is None else self.ground.both_directions(),
            floor=self.floor,
            directions=2,
            source=self.source,
        )


def require_positive_measures(suite: Suite, measure: str, block: Block | None = None) -> Reals:
    """Measure the records, each of which has to be above 0, so that a factor can scale it.

    Raises a `ValueError` otherwise, and warns where PGV is due to a drift.
    """
    measures = suite.measure(measure, block)
    if not is_traced(measures):
        ground = suite if suite.ground is None else suite.ground
        check_measures(np.asarray(measures), measure, ground.names, ground.records)
    return measures
