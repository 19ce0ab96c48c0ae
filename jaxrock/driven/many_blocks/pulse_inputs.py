"""Pulses and harmonic motions for the batch: each shape a class with its own power series."""

import abc
import math
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike

from ...ground_motion import Pulse, Ricker
from ...validation import Booleans, Integers, Number, Reals
from ..equation import Equation
from .ground_input import Excitation, GroundInput, HostIntegers, HostReals, rounding_margin
from .taylor import Coefficients, sine_cosine


class PulseInput(GroundInput):
    """Intervals with one pulse each, of amplitude 1, as long as `extent` times its duration."""

    extent: HostReals
    intervals: HostIntegers

    orders: ClassVar[dict[int, int]] = {8: 14, 4: 8}
    intervals_end_steps: ClassVar[bool] = False
    steps_between_refills: ClassVar[int] = 4

    # The sign of the first extreme of the pulse, and of the third.
    first_sign: ClassVar[float]

    @property
    def has_vertical(self) -> bool:
        """False: pulses are horizontal."""
        return False

    def fewest_for_two_threads(self) -> int:
        """Return how many blocks one thread follows as fast as two, through all intervals."""
        return max(512 // int(self.intervals), 1)

    def find_fastest(self, natural: Reals, rate: Reals) -> Reals:
        """Choose the faster one, so that the coefficients of both series stay of order 1."""
        return jnp.maximum(natural, jnp.abs(rate))

    @abc.abstractmethod
    def compute_phase(self, rate: Reals, along: Reals) -> Reals:
        """Compute the argument of the pulse's formula at a time."""

    def find_uplift(
        self,
        excitation: Excitation,
        equation: Equation,
        along: Reals,
        horizontal: Coefficients,
        vertical: Coefficients,
        time_left: Reals,
    ) -> tuple[Booleans, Reals, Reals]:
        """Find the first of `uplift_times` that is still to come."""
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

    def find_intervals(self, motion: Integers) -> tuple[Integers, Integers]:
        """Return place 0 and the number of intervals, which all motions have."""
        return jnp.zeros_like(motion), jnp.broadcast_to(self.intervals, motion.shape)

    def is_finite(self, motion: Integers) -> Booleans:
        """Return True: a pulse is finite if its amplitude is, which is the block's number."""
        return jnp.ones(motion.shape, bool)

    def choose_grade(self, needed: Reals) -> Integers:
        """Return 0: `find_next_interval` needs none."""
        return jnp.zeros(needed.shape, jnp.int32)

    def find_next_interval(self, interval: Integers, excitation: Excitation) -> Integers:
        """Return the interval itself: all are equally strong."""
        return jnp.minimum(interval, excitation.intervals)


class SineInput(PulseInput):
    """Pulses that are a sine of a phase: rectangular, half-sine, sine, cosine, harmonic."""

    phase_rate: HostReals  # times the duration of the pulse; see `Pulse.harmonic`
    first_phase: HostReals

    first_sign: ClassVar[float] = 1.0

    def find_rate(self, length: Reals) -> Reals:
        """Compute the rate of the phase in time, for intervals of a length."""
        return jnp.asarray(self.phase_rate) * self.extent / length

    def expand(
        self, excitation: Excitation, line: tuple, along: Reals, order: int
    ) -> tuple[Coefficients, Coefficients]:
        """Expand the sine: its second derivative is -rate^2 times itself."""
        del line
        rate = excitation.rate
        sine, cosine = _compute_sine_cosine(self.compute_phase(rate, along))
        c = [excitation.strength * sine, excitation.strength * cosine * rate]
        square = rate * rate
        for k in range(2, order - 1):
            c.append(c[k - 2] * square * (-1 / (k * (k - 1))))
        return tuple(c), ()

    def compute_phase(self, rate: Reals, along: Reals) -> Reals:
        """Compute the argument of the sine at a time."""
        return rate * along + jnp.asarray(self.first_phase)

    def find_uplift_times(self, rate: Reals, needed: Reals) -> tuple[Reals, ...]:
        """Find when the magnitude of the sine rises through a ratio, in three half-waves."""
        first = jnp.where(needed < 1, jnp.arcsin(jnp.where(needed < 1, needed, 0)), jnp.inf)
        phases = tuple(k * math.pi + first for k in range(3))
        return _times_of_phases(phases, rate, self.compute_phase(rate, jnp.zeros_like(rate)))


class RickerInput(PulseInput):
    """Ricker's wavelet: -1/2 of the second derivative of a bell exp(-phase^2)."""

    first_sign: ClassVar[float] = -1.0

    def find_rate(self, length: Reals) -> Reals:
        """Compute the rate of the phase in time, for intervals of a length."""
        return math.pi * jnp.asarray(self.extent) / length

    def expand(
        self, excitation: Excitation, line: tuple, along: Reals, order: int
    ) -> tuple[Coefficients, Coefficients]:
        """Expand the bell by its differential equation bell' = -2 phase bell."""
        del line
        rate = excitation.rate
        phase = self.compute_phase(rate, along)
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

    def compute_phase(self, rate: Reals, along: Reals) -> Reals:
        """Compute the argument of the bell at a time, which is 0 at the peak."""
        return rate * along + -2 * math.pi

    def find_uplift_times(self, rate: Reals, needed: Reals) -> tuple[Reals, ...]:
        """Find when the magnitude rises through a ratio: at a side, the main, a side peak."""
        inner, outer = _find_wavelet_crossings(needed)
        phases = (-outer, -inner[0], inner[1])
        return _times_of_phases(phases, rate, self.compute_phase(rate, jnp.zeros_like(rate)))


def make_pulse_input(
    kind: type[Pulse], dtype: DTypeLike, intervals: Number = 1
) -> SineInput | RickerInput:
    """Make the input for pulses of a kind, or for as many of them without a break."""
    extent = np.asarray(kind.extremes[-1], dtype)
    number = np.asarray(intervals, np.int32)
    if kind.harmonic is not None:
        rate, phase = (np.asarray(part, dtype) for part in kind.harmonic)
        return SineInput(extent, number, rate, phase)
    if issubclass(kind, Ricker):
        return RickerInput(extent, number)
    raise ValueError(
        f"{kind.__name__} has no power series: batches take pulse.sampled(time_step) instead"
    )


def _times_of_phases(
    phases: tuple[Reals, ...], rate: Reals, begin: Reals
) -> tuple[Reals, ...]:
    """Convert phases to times from the beginning of an interval; inf for phases before it."""
    moving = jnp.where(rate > 0, rate, 1)
    times = []
    for phase in phases:
        comes = (rate > 0) & (phase > begin) & (phase < jnp.inf)
        # Derivatives in reverse mode would be NaN from an infinite phase.
        time = (jnp.where(comes, phase, 0) - begin) / moving
        times.append(jnp.where(comes, time, jnp.inf))
    return tuple(times)


def _compute_sine_cosine(phase: Reals) -> tuple[Reals, Reals]:
    """Compute sine and cosine of a phase of a few periods."""
    turns = jnp.round(phase * (1 / math.pi))
    # The remainder keeps its digits if pi is subtracted in two parts: the first one has few
    # bits, so that its product with a small integer is exact (Cody and Waite 1980).
    sine, cosine = sine_cosine((phase - turns * 3.140625) - turns * (math.pi - 3.140625))
    odd = turns != 2 * jnp.round(0.5 * turns)
    return jnp.where(odd, -sine, sine), jnp.where(odd, -cosine, cosine)


def _find_wavelet_crossings(ratio: Reals) -> tuple[tuple[Reals, Reals], Reals]:
    """Find the phases at which the magnitude of Ricker's wavelet is a ratio, all positive.

    On the slope of the main peak and the inner slope of a side peak, and on its outer slope;
    inf where there is none.
    """
    tail = 2 * math.exp(-1.5)  # height of the side peaks, where the square is 1.5

    def solve(square: Reals, exists: Booleans, sign: float, iterations: int) -> Reals:
        """Solve for the square of the phase by Newton's method, in logarithms."""
        target = jnp.log(jnp.where(exists, jax.lax.stop_gradient(ratio), 0.1))

        def improve(square: Reals, target: Reals) -> Reals:
            inside = sign * (1 - 2 * square)
            return square - (jnp.log(inside) - square - target) / (-2 * sign / inside - 1)

        for _ in range(iterations):
            square = improve(square, target)
        # A last iteration from a constant has the derivative of the root.
        square = improve(jax.lax.stop_gradient(square), jnp.log(jnp.where(exists, ratio, 0.1)))
        return jnp.where(exists, jnp.sqrt(jnp.where(exists, square, 1)), jnp.inf)

    fixed = jax.lax.stop_gradient(ratio)
    low = fixed < tail
    # The functions are concave in the square of the phase: Newton's method is monotone, and
    # cannot leave their domain, from starting points on the far side of the root.
    main = solve(0.5 * (1 - fixed), fixed < 1, 1.0, 5)
    # Near the top of a side peak the roots are close together, by a square root.
    gap = jnp.sqrt(jnp.maximum(tail - fixed, 0) * math.exp(1.5))
    near = solve(jnp.maximum(1.5 - gap, 0.5 + 0.25 * fixed), low, -1.0, 10)
    far = solve(1.5 + gap - 1.5 * jnp.log(jnp.where(low, fixed, tail) / tail), low, -1.0, 10)
    return (main, near), far
