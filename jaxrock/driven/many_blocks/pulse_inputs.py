"""Pulses and harmonic motions for the batch: each shape a class with its own power series."""

import math
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike

from ...ground_motion import Pulse, Ricker
from ...validation import Booleans, Integers, Number, Reals
from ..equation import Equation
from .ground_input import Excitation, HostIntegers, HostReals, rounding_margin
from .taylor import Coefficients, sine_cosine


class PulseInput(eqx.Module):
    """Intervals with one pulse of amplitude 1 each, here a sine of a phase.

    Such pulses are the rectangular, half-sine, sine and cosine ones, and the harmonic motion.
    """

    intervals: HostIntegers
    phases: HostReals  # by which the phase grows in an interval
    first_phase: HostReals

    # Orders of the Taylor polynomials of the rotation, by the bytes of a number.
    orders: ClassVar[dict[int, int]] = {8: 14, 4: 8}
    # Whether most steps end with an interval, whatever the tolerance.
    intervals_end_steps: ClassVar[bool] = False
    # Steps between two refills of the lanes: few where a block needs few.
    steps_between_refills: ClassVar[int] = 4
    # The sign of the first extreme of the pulse, and of the third.
    first_sign: ClassVar[float] = 1.0

    def fewest_for_two_threads(self) -> int:
        """Return how many blocks one thread follows as fast as two, through all intervals."""
        return max(512 // int(self.intervals), 1)

    def find_rate(self, length: Reals) -> Reals:
        """Compute the rate of the phase in time, for intervals of a length."""
        return jnp.asarray(self.phases) / length

    def find_phases(self, needed: Reals) -> tuple[Reals, ...]:
        """Find where the magnitude rises through a ratio, in three half-waves; inf for never."""
        first = jnp.where(needed < 1, jnp.arcsin(jnp.where(needed < 1, needed, 0)), jnp.inf)
        return tuple(k * math.pi + first for k in range(3))

    def excite(
        self, motion: Integers, strength: Reals, length: Reals, rate: Reals, tangent: Reals
    ) -> tuple[Excitation, Booleans | bool]:
        """Describe the input as blocks feel it; it is finite if their amplitudes are."""
        # By rounding alone no block is lifted, as in `find_uplift`.
        needed = tangent / jnp.abs(strength) * (1 + rounding_margin(rate.dtype))
        moving = jnp.where(rate > 0, rate, 1)
        times = []
        for phase in self.find_phases(needed):
            comes = (rate > 0) & (phase > self.first_phase) & (phase < jnp.inf)
            # Derivatives in reverse mode would be NaN from an infinite phase.
            time = (jnp.where(comes, phase, 0) - self.first_phase) / moving
            times.append(jnp.where(comes, time, jnp.inf))
        none = jnp.zeros_like(motion)
        intervals = none + self.intervals
        return Excitation(strength, length, rate, none, intervals, none, tuple(times)), True

    def read(self, place: Integers) -> tuple:
        """Return nothing: all intervals are alike."""
        del place
        return ()

    def expand(
        self, excitation: Excitation, line: tuple, along: Reals, order: int
    ) -> tuple[Coefficients, Coefficients]:
        """Expand the acceleration over g in powers of the time from `along` on.

        The second derivative of the sine is -rate^2 times itself. There is no vertical
        acceleration.
        """
        del line
        rate = excitation.rate
        sine, cosine = _compute_sine_cosine(rate * along + self.first_phase)
        c = [excitation.strength * sine, excitation.strength * cosine * rate]
        square = rate * rate
        for k in range(2, order - 1):
            c.append(c[k - 2] * square * (-1 / (k * (k - 1))))
        return tuple(c), ()

    def find_uplift(
        self,
        excitation: Excitation,
        equation: Equation,
        along: Reals,
        horizontal: Coefficients,
        vertical: Coefficients,
        time_left: Reals,
    ) -> tuple[Booleans, Reals, Reals]:
        """Find whether a block at rest is lifted, after how long, and to which side.

        It is at the first of `uplift_times` that is still to come. A one-sided block is lifted
        to the side 1 only.
        """
        del vertical, time_left
        push = horizontal[0] if equation.one_sided else jnp.abs(horizontal[0])
        at_once = push > equation.tangent * (1 + rounding_margin(along.dtype))
        time = jnp.full_like(along, jnp.inf)
        side = jnp.ones_like(along)
        signs = (self.first_sign, -self.first_sign, self.first_sign)
        # The latest first, so that the earlier extreme counts where two coincide.
        for rise, sign in reversed(list(zip(excitation.uplift_times, signs, strict=True))):
            sooner = (rise >= along) & (rise <= time)
            if equation.one_sided:
                sooner = sooner & (sign * excitation.strength > 0)
            time = jnp.where(sooner, rise, time)
            side = jnp.where(sooner, sign, side)
        negative = jnp.where(at_once, horizontal[0], side * excitation.strength) < 0
        lifted = at_once | (time < excitation.length)
        wait = jnp.where(at_once | ~lifted, 0, time - along)
        return lifted, wait, jnp.where(negative, -1.0, 1.0)

    def find_next_interval(self, interval: Integers, excitation: Excitation) -> Integers:
        """Return the interval itself, or the end: all are equally strong."""
        return jnp.minimum(interval, excitation.intervals)


class RickerInput(PulseInput):
    """Ricker's wavelet: -1/2 of the second derivative of a bell exp(-phase^2)."""

    first_sign: ClassVar[float] = -1.0

    def expand(
        self, excitation: Excitation, line: tuple, along: Reals, order: int
    ) -> tuple[Coefficients, Coefficients]:
        """Expand the bell by its differential equation bell' = -2 phase bell."""
        del line
        rate = excitation.rate
        phase = rate * along + self.first_phase
        bell = [excitation.strength * jnp.exp(-phase * phase)]
        bell.append(-2 * phase * bell[0])
        for k in range(1, order):
            bell.append((phase * bell[k] + bell[k - 1]) * (-2 / (k + 1)))
        c = []
        unit: Number = 1.0
        for k in range(order - 1):
            c.append(bell[k + 2] * unit * (-0.5 * (k + 1) * (k + 2)))
            unit = unit * rate
        return tuple(c), ()

    def find_phases(self, needed: Reals) -> tuple[Reals, ...]:
        """Find where the magnitude rises through a ratio: at a side, the main, a side peak."""
        tail = 2 * math.exp(-1.5)  # height of the side peaks, where the square is 1.5

        def solve(square: Reals, exists: Booleans, sign: float, iterations: int) -> Reals:
            """Solve for the phase, whose square Newton's method finds, in logarithms."""
            target = jnp.log(jnp.where(exists, needed, 0.1))

            def improve(square: Reals, target: Reals) -> Reals:
                inside = sign * (1 - 2 * square)
                return square - (jnp.log(inside) - square - target) / (-2 * sign / inside - 1)

            for _ in range(iterations):
                square = improve(square, jax.lax.stop_gradient(target))
            # A last iteration from a constant has the derivative of the root.
            square = improve(jax.lax.stop_gradient(square), target)
            return jnp.where(exists, jnp.sqrt(jnp.where(exists, square, 1)), jnp.inf)

        fixed = jax.lax.stop_gradient(needed)
        low = fixed < tail
        # The functions are concave in the square of the phase: Newton's method is monotone, and
        # cannot leave their domain, from starting points on the far side of the root.
        main = solve(0.5 * (1 - fixed), fixed < 1, 1.0, 5)
        # Near the top of a side peak the roots are close together, by a square root.
        gap = jnp.sqrt(jnp.maximum(tail - fixed, 0) * math.exp(1.5))
        inner = solve(jnp.maximum(1.5 - gap, 0.5 + 0.25 * fixed), low, -1.0, 10)
        logarithm = jnp.log(jnp.where(low, fixed, tail) / tail)
        return -solve(1.5 + gap - 1.5 * logarithm, low, -1.0, 10), -main, inner


def make_pulse_input(kind: type[Pulse], dtype: DTypeLike, intervals: Number = 1) -> PulseInput:
    """Make the input for pulses of a kind, or for as many of them without a break."""
    harmonic = kind.harmonic
    shape = PulseInput
    if harmonic is None and issubclass(kind, Ricker):
        harmonic = math.pi, -2 * math.pi
        shape = RickerInput
    if harmonic is None:
        raise ValueError(
            f"{kind.__name__} has no power series: batches take pulse.sampled(time_step) instead"
        )
    # The rate is for a pulse of duration 1, see `Pulse.harmonic`.
    rate, first_phase = harmonic
    phases = np.asarray(rate, dtype) * np.asarray(kind.extremes[-1], dtype)
    return shape(
        np.asarray(intervals, np.int32), np.asarray(phases), np.asarray(first_phase, dtype)
    )


def _compute_sine_cosine(phase: Reals) -> tuple[Reals, Reals]:
    """Compute sine and cosine of a phase of a few periods."""
    turns = jnp.round(phase * (1 / math.pi))
    # The remainder keeps its digits if pi is subtracted in two parts: the first one has few
    # bits, so that its product with a small integer is exact (Cody and Waite 1980).
    sine, cosine = sine_cosine((phase - turns * 3.140625) - turns * (math.pi - 3.140625))
    odd = turns != 2 * jnp.round(0.5 * turns)
    return jnp.where(odd, -sine, sine), jnp.where(odd, -cosine, cosine)
