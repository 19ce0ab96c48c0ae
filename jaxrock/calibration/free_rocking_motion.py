"""Free rocking as a function of few numbers, beside measurements of it.

The numbers, in the order of `NUMBERS`: time of the first impact; launch ratio x, the velocity
after that impact over the critical one, as log(artanh(x)); logarithms of C, p and alpha_c; and
C of the largest impact less C of the smallest.

Logarithms have no bounds, so that no step of the search leads where there is no motion.
The linearized half-cycle lasts 2 artanh(x) / p (Housner 1963, 10.1785/BSSA0530020403): its
logarithm is linear in those of artanh(x) and p, which makes the problem nearly so.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from ..block import Block
from ..resonance import RockingModel
from ..validation import Reals
from .least_squares import Places, Values

NUMBERS = (
    "first_impact",
    "launch_ratio",
    "restitution",
    "frequency_parameter",
    "critical_angle",
)
TIME, LAUNCH, RESTITUTION, FREQUENCY, ANGLE, CHANGE = range(6)
_LARGEST = 0.999999  # velocity ratio: from 1 on there is no next impact
# Of the velocity that an impact leaves. A C that changes would become negative in some steps
# of the search, and with it the velocities.
_LEAST_SHARE = 1e-6
_TOGETHER = 512  # half-cycles, so that one program computes any number of them


class Measured(NamedTuple):
    """Measurements, and which of them count."""

    times: Float[np.ndarray, " times"]
    time_counts: Bool[np.ndarray, " times"]
    impacts: Int[np.ndarray, " times"]  # which one each time belongs to, from 0 on
    peaks: Float[np.ndarray, " peaks"]
    peak_counts: Bool[np.ndarray, " peaks"]
    arcs: Int[np.ndarray, " peaks"]  # the number of the impact before each peak

    @property
    def counted(self) -> int:
        """The number of those that count."""
        return int(self.time_counts.sum() + self.peak_counts.sum())


class Noises(NamedTuple):
    """Standard deviations of times [s] and of rotations [rad], and which of them are known."""

    times: float
    rotations: float
    known: tuple[bool, bool]


class Known(NamedTuple):
    """All that is given: model, a block of the right shape, numbers, and which are free."""

    model: RockingModel
    shape: Block  # in the precision in which the motion is computed
    numbers: Float[np.ndarray, "6"]
    free: Bool[np.ndarray, "6"]

    @property
    def dtype(self) -> np.dtype:
        """The precision."""
        return self.shape.half_width.dtype

    def set_free(self, place: int, free: bool = True) -> "Known":
        """Return a copy with one more number that is fitted, or one less."""
        flags = self.free.copy()
        flags[place] = free
        return self._replace(free=flags)


class HalfCycles(NamedTuple):
    """Durations times p, peak rotations over alpha_c, and their slopes along the ratio."""

    durations: Values
    rotations: Values
    duration_slopes: Values
    rotation_slopes: Values


# Values only, for the model of a comparison: without derivatives it compiles in a fifth of the
# time.
@jax.jit
def _compute_values(model: RockingModel, shape: Block, ratios: Reals) -> Reals:
    """Compute durations in units of 1 / p and peak rotations in units of alpha_c, a row each."""
    velocities = ratios * model.critical_velocity(shape)
    durations = model.half_cycle_duration(shape, velocities) * shape.frequency_parameter
    return jnp.stack(
        [durations, model.peak_rotation(shape, velocities) / shape.critical_angle]
    )


@jax.jit
def _compute_half_cycles(model: RockingModel, shape: Block, ratios: Reals) -> Reals:
    """Compute durations, peak rotations and the slopes of both along the ratio, a row each."""
    # Each quantity depends on its own ratio only: one tangent of ones has all slopes.
    values, slopes = jax.jvp(
        lambda ratios: _compute_values(model, shape, ratios),
        (ratios,),
        (jnp.ones_like(ratios),),
    )
    return jnp.concatenate([values, slopes])


def _compute_in_rows(compute: Callable[..., Reals], known: Known, ratios: Values) -> Values:
    """Compute quantities, shape (quantities, ...), by one program for any number of ratios."""
    # The last row is filled with copies of the ratios, for which the motion exists.
    rows = np.resize(ratios.astype(known.dtype), (-(-ratios.size // _TOGETHER), _TOGETHER))
    parts = [np.asarray(compute(known.model, known.shape, row)) for row in rows]
    joined = np.concatenate(parts, axis=1)[:, : ratios.size].astype(float)
    return joined.reshape(-1, *ratios.shape)


def compute_half_cycles(known: Known, ratios: Values) -> HalfCycles:
    """Compute half-cycles after launches at so many times the critical velocity.

    They are in units of the block, and so do not depend on p and alpha_c: a fit of those needs
    no other program, and the slopes along them are known.
    """
    return HalfCycles(*_compute_in_rows(_compute_half_cycles, known, ratios))


class Rows(NamedTuple):
    """Several numberings of the same measurements, a row each, and which numbers are free."""

    times: Float[np.ndarray, " times"]
    time_counts: Bool[np.ndarray, "sets times"]
    impacts: Int[np.ndarray, "sets times"]
    peaks: Float[np.ndarray, " peaks"]
    peak_counts: Bool[np.ndarray, "sets peaks"]
    arcs: Int[np.ndarray, "sets peaks"]
    free: Bool[np.ndarray, "sets 6"]

    @classmethod
    def of(cls, tests: Sequence[Measured], kinds: Sequence[Known]) -> "Rows":
        """Stack numberings of one test, each with its own free numbers."""
        first = tests[0]
        columns = (np.stack(column) for column in zip(*tests, strict=True))
        _, time_counts, impacts, _, peak_counts, arcs = columns
        free = np.stack([kind.free for kind in kinds])
        return cls(first.times, time_counts, impacts, first.peaks, peak_counts, arcs, free)

    def at(self, places: Places) -> "Rows":
        """Return the rows at some places; a place may occur several times."""
        parts = self.time_counts, self.impacts, self.peak_counts, self.arcs, self.free
        time_counts, impacts, peak_counts, arcs, free = (part[places] for part in parts)
        return Rows(self.times, time_counts, impacts, self.peaks, peak_counts, arcs, free)

    @property
    def room(self) -> int:
        """The number of impacts, up to the one that ends the last peak."""
        return 1 + int(max(self.impacts.max(initial=0), self.arcs.max(initial=0) + 1))


def compute_velocity_ratios(numbers: Values, amplitudes: Values) -> tuple[Values, Values]:
    """Compute launch velocities over the critical one, after each impact, and the shares left.

    `amplitudes` are those in which C is linear; see `Fitted`.
    """
    changing = np.exp(numbers[..., RESTITUTION, None])
    changing = changing + numbers[..., CHANGE, None] * amplitudes[..., 1:]
    shares = np.maximum(changing, _LEAST_SHARE)
    launch = np.tanh(np.exp(numbers[..., LAUNCH, None]))
    ratios = np.concatenate([launch, launch * np.cumprod(shares, axis=-1)], axis=-1)
    return np.minimum(ratios, _LARGEST), shares


def _sum_before(steps: Values) -> Values:
    """Sum all steps before each: an impact comes after the half-cycles before it."""
    return np.concatenate([np.zeros_like(steps[:, :1]), np.cumsum(steps, axis=1)], axis=1)


def compute_residuals(
    numbers: Values,
    amplitudes: Values,
    rows: Rows,
    known: Known,
    noises: Noises,
    with_jacobian: bool = True,
) -> tuple[Values, Values]:
    """Compute residuals over the noise: computed less measured, of times, then of peaks.

    Also compute their Jacobian, which is left at 0 if it is not asked for.
    """
    take = np.take_along_axis
    ratios, shares = compute_velocity_ratios(numbers, amplitudes)
    motion = compute_half_cycles(known, ratios)
    unit = np.exp(-numbers[:, FREQUENCY, None])
    angle = np.exp(numbers[:, ANGLE, None])
    durations = take(_sum_before(motion.durations * unit), rows.impacts, 1)
    rotations = take(motion.rotations, rows.arcs, 1) * angle
    # What does not count has a weight of 0: it stays in the arrays, whose shape is then the
    # same for all numberings.
    late = numbers[:, TIME, None] + durations - rows.times
    weights = [rows.time_counts / noises.times, rows.peak_counts / noises.rotations]
    weights = np.concatenate(weights, axis=1)
    residuals = np.concatenate([late, rotations - rows.peaks], axis=1) * weights
    jacobian = np.zeros((*residuals.shape, 6))
    if not with_jacobian:
        return residuals, jacobian
    # Views: to write to them is to write to the Jacobian.
    of_times, of_peaks = np.split(jacobian, [rows.times.size], axis=1)
    of_times[..., TIME] = 1
    of_times[..., FREQUENCY] = -durations
    of_peaks[..., ANGLE] = rotations
    # Slopes of the logarithm of each ratio. Along the launch number, with x = tanh(u) and
    # u = exp(number), it is u / (sinh u cosh u) = u (1 - x^2) / x, for all ratios alike; along
    # C each impact adds the slope of the logarithm of its share.
    growth = np.exp(numbers[:, LAUNCH, None])
    launch = np.tanh(growth)
    of_launch = np.broadcast_to(growth * (1 - launch**2) / launch, ratios.shape)
    constant = np.exp(numbers[:, RESTITUTION, None])
    # Where a bound holds the motion, it does not follow the numbers.
    moves = shares > _LEAST_SHARE
    of_restitution = _sum_before(np.where(moves, constant / shares, 0))
    of_change = _sum_before(np.where(moves, amplitudes[:, 1:] / shares, 0))
    free_ratios = np.where(ratios < _LARGEST, ratios, 0)
    # By the chain rule from the logarithm to the ratio, and from that to the half-cycle.
    slopes = {LAUNCH: of_launch, RESTITUTION: of_restitution, CHANGE: of_change}
    for place, slope in slopes.items():
        change = slope * free_ratios
        of_times[..., place] = take(
            _sum_before(motion.duration_slopes * change * unit), rows.impacts, 1
        )
        of_peaks[..., place] = take(motion.rotation_slopes * change * angle, rows.arcs, 1)
    return residuals, np.where(rows.free[:, None], jacobian * weights[..., None], 0)


def compute_change_by_model(
    numbers: Float[np.ndarray, "6"],
    measured: Measured,
    known: Known,
    noises: Noises,
    other: Known,
) -> Float[np.ndarray, " measurements"]:
    """Compute by how much another model changes the residuals, with the same numbers."""
    room = 1 + int(max(measured.impacts.max(), measured.arcs.max(initial=-1) + 1))
    ratios, _ = compute_velocity_ratios(numbers, np.zeros(room))
    change = _compute_in_rows(_compute_values, other, ratios)
    change = change - _compute_in_rows(_compute_half_cycles, known, ratios)[:2]
    durations = _sum_before(change[:1] * np.exp(-numbers[FREQUENCY]))[0]
    rotations = change[1] * np.exp(numbers[ANGLE])
    return np.concatenate(
        [
            durations[measured.impacts] * measured.time_counts / noises.times,
            rotations[measured.arcs] * measured.peak_counts / noises.rotations,
        ]
    )
