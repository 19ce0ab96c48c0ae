"""The contract of ground motions in the batch: power series, and uplift of a block at rest.

Time is divided into intervals, in each of which the acceleration is one power series. A pulse
is one interval. A harmonic motion is a one-sine pulse, interval after interval: the phase
begins anew in each, so that it keeps its digits however many there are. A record is a line in
each interval between two samples. A new shape of ground motion is a class of its own with the
methods of `GroundInput`.
"""

import abc
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Float, Int

from ...validation import Booleans, Integers, Reals
from ..equation import Equation
from .taylor import Coefficients

# Arrays outside of programs are NumPy's, which compile nothing; inside they are traced.
HostReals = Float[Array | np.ndarray, "..."]
HostNumbers = Float[Array | np.ndarray | np.floating, "..."]
HostIntegers = Int[Array | np.ndarray, "..."]
HostBooleans = Bool[Array | np.ndarray, "..."]
# One number for each block, or for each lane in which a block is followed: of one size in all
# fields of an object, which the tests check wherever one is made.
PerBlock = Float[Array, " blocks"]
CountPerBlock = Int[Array, " blocks"]
TruthPerBlock = Bool[Array, " blocks"]


def rounding_margin(dtype: DTypeLike) -> float:
    """Return the number below which something is nothing beside 1."""
    # A handful of operations, each of which rounds, with a margin.
    return 64 * float(jnp.finfo(dtype).eps)


class Excitation(eqx.Module):
    """The input as each block feels it; times are in the block's unit."""

    strength: PerBlock  # factor on the input over g
    length: PerBlock  # of an interval
    rate: PerBlock  # of the phase of the input in time
    first_interval: CountPerBlock  # place of the first interval of the motion
    intervals: CountPerBlock  # of the motion
    grade: CountPerBlock  # of the intervals that might lift the block
    # When a pulse might lift the block, from the beginning of its interval on.
    uplift_times: tuple[PerBlock, ...]


class GroundInput(eqx.Module):
    """The contract of an input, which all blocks of a program share.

    The methods are elementwise over blocks, or lanes, and are traced. An input knows nothing
    of the blocks: their numbers come in an `Excitation`.
    """

    # Orders of the Taylor polynomials of the rotation, by the bytes of a number.
    orders: ClassVar[dict[int, int]]
    # Whether most steps end with an interval, whatever the tolerance.
    intervals_end_steps: ClassVar[bool]
    # Steps between two refills of the lanes: few where a block needs few.
    steps_between_refills: ClassVar[int]

    @property
    @abc.abstractmethod
    def has_vertical(self) -> bool:
        """True if the ground moves vertically as well."""

    @abc.abstractmethod
    def fewest_for_two_threads(self) -> int:
        """Return how many blocks one thread follows as fast as two threads do."""

    @abc.abstractmethod
    def find_rate(self, length: Reals) -> Reals:
        """Compute the rate of the phase in time, for intervals of a length."""

    def find_fastest(self, natural: Reals, rate: Reals) -> Reals:
        """Choose the rate by which times are measured, of the block or of the phase."""
        del rate
        return natural

    def read(self, place: Integers) -> tuple:
        """Read what `expand` needs to know of the intervals at some places."""
        del place
        return ()

    @abc.abstractmethod
    def expand(
        self, excitation: Excitation, line: tuple, along: Reals, order: int
    ) -> tuple[Coefficients, Coefficients]:
        """Expand both accelerations over g in powers of the time from `along` on.

        Horizontal and vertical; the latter is empty where there is none. `line` comes from
        `read`, and `along` is the time since the beginning of the interval.
        """

    @abc.abstractmethod
    def find_uplift_times(self, rate: Reals, needed: Reals) -> tuple[Reals, ...]:
        """Find times at which an input of factor 1 rises to `needed`; inf for never.

        Once for all steps, where that is possible for all intervals. A pulse has three such
        times, to alternate sides (see `PulseInput.first_sign`); another shape overrides
        `find_uplift`.
        """

    @abc.abstractmethod
    def find_uplift(
        self,
        excitation: Excitation,
        equation: Equation,
        along: Reals,
        horizontal: Coefficients,
        vertical: Coefficients,
        time_left: Reals,
    ) -> tuple[Booleans, Reals, Reals]:
        """Find whether a block at rest is lifted in the interval, after how long, which side.

        The series come from `expand`, `time_left` is the rest of the interval. A one-sided
        block is lifted to the side 1 only.
        """

    @abc.abstractmethod
    def find_intervals(self, motion: Integers) -> tuple[Integers, Integers]:
        """Return the place of the first interval of a motion, and its number of intervals."""

    @abc.abstractmethod
    def is_finite(self, motion: Integers) -> Booleans:
        """Return whether all numbers of a motion are finite."""

    @abc.abstractmethod
    def choose_grade(self, needed: Reals) -> Integers:
        """Choose the strongest grade that is not above what a block needs: it misses none."""

    @abc.abstractmethod
    def find_next_interval(self, interval: Integers, excitation: Excitation) -> Integers:
        """Find the first interval from `interval` on that may lift a block, or the end."""
