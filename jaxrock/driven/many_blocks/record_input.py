"""Records for the batch: a line between samples, and the next interval that is strong enough."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp

from ...validation import Booleans, Integers, Reals
from ..equation import Equation
from .ground_input import (
    Excitation,
    HostBooleans,
    HostIntegers,
    HostReals,
    rounding_margin,
)
from .taylor import Coefficients, evaluate

GRADES = 16  # of strength, each sqrt(2) below the one before
_STRIDE_BITS = 3
STRIDE = 1 << _STRIDE_BITS  # intervals that are passed over together


class RecordInput(eqx.Module):
    """The intervals of one or more records, one after the other in flat arrays.

    A table says for each stride of intervals and each grade of strength which stride is the
    next one that is stronger: a block at rest goes there at once.
    """

    # An array for each power of the time in intervals, 0 and 1.
    horizontal: tuple[HostReals, ...]
    vertical: tuple[HostReals, ...]  # none where there is no such component
    strongest: HostReals  # the largest magnitude of all samples
    finite: HostBooleans  # of each motion
    following: HostIntegers  # next stronger stride, flattened from (strides, grades)
    first_intervals: HostIntegers  # place of the first interval of each motion
    intervals: HostIntegers  # of each motion

    # As those of `PulseInput`. Samples keep steps short, so that high orders would be wasted.
    orders: ClassVar[dict[int, int]] = {8: 9, 4: 8}
    intervals_end_steps: ClassVar[bool] = True
    steps_between_refills: ClassVar[int] = 64

    def fewest_for_two_threads(self) -> int:
        """Return how many blocks one thread follows as fast as two threads do."""
        return 16

    def find_rate(self, length: Reals) -> Reals:
        """Compute the rate of the samples."""
        return 1 / length

    def excite(
        self, motion: Integers, strength: Reals, length: Reals, rate: Reals, tangent: Reals
    ) -> tuple[Excitation, Booleans]:
        """Describe the input as blocks feel it, and return whether their motions are finite.

        The grade is the strongest one that is not above what a block needs: it misses none.
        """
        needed = tangent / jnp.abs(strength)
        if self.vertical:
            # The grade is about the larger of both components. If s is the larger of abs(push)
            # and abs(lift), uplift needs s > (1 - s) tangent: s > tangent / (1 + tangent).
            needed = needed / (1 + tangent)
        steps = jnp.ceil(2 * jnp.log2(jnp.asarray(self.strongest) / needed))
        grade = jnp.clip(steps, 0, GRADES - 1).astype(jnp.int32)
        table = self.first_intervals, self.intervals, self.finite
        first, intervals, finite = (jnp.asarray(column)[motion] for column in table)
        return Excitation(strength, length, rate, first, intervals, grade, ()), finite

    def read(self, place: Integers) -> tuple:
        """Read the lines through both samples, horizontal and vertical."""
        lines = self.horizontal, self.vertical
        return jax.tree.map(lambda c: jnp.asarray(c).at[place].get(mode="clip"), lines)

    def expand(
        self, excitation: Excitation, line: tuple, along: Reals, order: int
    ) -> tuple[Coefficients, Coefficients]:
        """Expand both accelerations over g: move the origin of their lines to `along`."""
        del order
        share = along * excitation.rate

        def move(powers: tuple[Reals, ...]) -> Coefficients:
            c = tuple(power * excitation.strength for power in powers)
            return (evaluate(c, share), c[1] * excitation.rate) if c else ()

        horizontal, vertical = line
        return move(horizontal), move(vertical)

    def find_uplift(
        self,
        excitation: Excitation,
        equation: Equation,
        along: Reals,
        horizontal: Coefficients,
        vertical: Coefficients,
        time_left: Reals,
    ) -> tuple[Booleans, Reals, Reals]:
        """Find where the line crosses the push that lifts the block."""
        del excitation, along
        tangent = equation.tangent
        # The push needed is linear in time as well, if the ground moves vertically.
        needed = (tangent * (1 + rounding_margin(time_left.dtype)), jnp.zeros_like(time_left))
        if vertical:
            needed = (needed[0] + tangent * vertical[0], needed[1] + tangent * vertical[1])
        last = evaluate(horizontal, time_left)
        needed_last = evaluate(needed, time_left)
        magnitude = jnp.asarray if equation.one_sided else jnp.abs
        at_once = magnitude(horizontal[0]) > needed[0]
        lifted = at_once | (magnitude(last) > needed_last)
        backward = jnp.where(at_once, horizontal[0], last) < 0
        side = jnp.where(backward & (not equation.one_sided), -1.0, 1.0)
        if vertical and not equation.one_sided:
            # Where the ground falls away faster than g, the push needed is negative, and both
            # sides are lifted within the interval: the first one counts.
            begin_right = horizontal[0] - needed[0]
            begin_left = -horizontal[0] - needed[0]
            end_right = last - needed_last
            end_left = -last - needed_last
            right_first = begin_right * (end_left - begin_left) >= begin_left * (
                end_right - begin_right
            )
            both = (end_right > 0) & (end_left > 0) & ~at_once
            side = jnp.where(both, jnp.where(right_first, 1.0, -1.0), side)
        excess = side * horizontal[0] - needed[0]
        growth = side * horizontal[1] - needed[1]
        wait = -excess / jnp.where(growth > 0, growth, 1)
        return lifted, jnp.where(at_once, 0, wait), side

    def find_next_interval(self, interval: Integers, excitation: Excitation) -> Integers:
        """Find the first interval from `interval` on that may lift a block, or the end."""
        place = excitation.first_interval + interval
        index = (place >> _STRIDE_BITS) * GRADES + excitation.grade
        following = jnp.asarray(self.following).at[index].get(mode="clip") * STRIDE
        # Only from the beginning of a stride on: within one, intervals are taken one by one.
        place = jnp.where(place & (STRIDE - 1) == 0, following, place)
        return jnp.minimum(place - excitation.first_interval, excitation.intervals)
