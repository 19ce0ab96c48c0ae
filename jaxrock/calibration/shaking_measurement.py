"""A test on a shaking table, and its fit up to one time after another.

Small changes grow from impact to impact: over the whole of a long test the misfit as a
function of C has many minima, and derivatives say nothing about the next one. Over the first
impacts it has few. Values that fit these are near enough to fit some impacts more, and so on.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..block import Block
from ..driven import respond
from ..ground_motion import Motion
from ..host import Status
from ..resonance import RockingModel
from ..validation import Integers, Reals
from .free_rocking_motion import Values, compute_covariance

_BOUNDS = {
    "restitution": (0.0, 1.0),
    "slenderness": (0.0, np.inf),
    "half_width": (0.0, np.inf),
    "inertia_ratio": (1.0, np.inf),
}
PARAMETERS = tuple(_BOUNDS)
# Values of C, where none is given, and how many of them begin a search. A window shows few
# impacts, but there may be many smaller ones, and as many minima of the misfit.
_RESTITUTIONS = np.linspace(0.5, 0.98, 97)
_STARTS = 5
_FIRST = 3  # impacts in the first window
_GROWTH = 1.5  # of the number of impacts from one window to the next
_OFF = 1.2  # times the noise that is seen in the first window: then it is not their motion
# Of the noise of a window, by which the residuals of the next one may exceed it, over
# 1 / sqrt(2 n), the relative error of an estimate from n residuals.
_ROUGHER = 3.0
_EXACT = 1e-6  # part of a rotation, from which on there is no noise but that of the integrator
_MOVED = 5.0  # standard errors by which values may move from one window to the next
_SEEN = 4.0  # rotations over the noise, from which on they tell the side
_TOLERANCE = {8: 1e-8, 4: 1e-5}  # relative change at which a search ends, by bytes of a number
_IMPACTS = 2048  # there is room for
# Times there is room for, at least, and those whose rotations are computed together: mapped
# over, they take as long as the last of them.
_TIMES = 1024
_PIECE = 16


class ShakingTest(NamedTuple):
    """A test: its measurements, all that is known, and which parameters are fitted."""

    time: Float[np.ndarray, " times"]
    measured: Float[np.ndarray, " times"]  # NaN where unknown
    window: float  # up to which measurements are used
    noise: float | None
    known: dict[str, float]  # by the names in `PARAMETERS`
    start_given: bool  # whether C is, from which the search begins
    gravity: Reals
    motion: Motion
    initial: tuple[Reals, Reals]
    parameters: tuple[str, ...]
    model: RockingModel

    @property
    def dtype(self) -> np.dtype:
        """The precision in which the motion is computed."""
        return self.gravity.dtype

    def simulate(self, values: Values, end: float) -> tuple[Values, Values]:
        """Compute rotations at all times up to one [rad], and their Jacobian."""
        known = self.known | dict(zip(self.parameters, values, strict=True))
        until = int(np.searchsorted(self.time, end, side="right"))
        # Few lengths are compiled.
        times = np.pad(self.time[:until], (0, -(-self.time.size // _TIMES) * _TIMES - until))
        pieces = np.asarray(-(-until // _PIECE))
        fixed = self.gravity, self.motion, self.initial, self.model
        outputs = []
        for name in self.parameters:
            along = {parameter: float(parameter == name) for parameter in known}
            arguments = (known, along, times, np.asarray(end))
            arguments = jax.tree.map(lambda leaf: np.asarray(leaf, self.dtype), arguments)
            outputs.append(_compute_rotations(*arguments, pieces, *fixed))
        rotations, slopes = np.asarray(outputs, float)[..., :until].swapaxes(0, 1)
        return rotations[0], slopes.T


@jax.jit
def _compute_rotations(  # noqa: PLR0913
    known: dict[str, Reals],
    along: dict[str, Reals],
    times: Reals,
    end: Reals,
    pieces: Integers,
    gravity: Reals,
    motion: Motion,
    initial: tuple[Reals, Reals],
    model: RockingModel,
) -> tuple[Reals, Reals]:
    """Compute rotations [rad], NaN if the integration does not finish, and derivatives.

    One direction at a time: a Jacobian would be another program for each set of parameters.
    """

    def compute(known: dict[str, Reals]) -> Reals:
        size = known["half_width"], known["slenderness"], gravity, known["inertia_ratio"]
        response = respond(
            Block(*size),
            known["restitution"],
            motion,
            end,
            rotation=initial[0],
            velocity=initial[1],
            model=model,
            max_impacts=_IMPACTS,
        )
        complete = response.status == Status.COMPLETE
        # Where the integration did not finish, the motion is known at time 0 only.
        asked = jnp.where(complete, times, 0)

        # The number of pieces is an argument: room for times that is not used costs nothing.
        def fill_piece(k: Integers, rotations: Reals) -> Reals:
            some = jax.lax.dynamic_slice(asked, (k * _PIECE,), (_PIECE,))
            return jax.lax.dynamic_update_slice(
                rotations, response.history(some)[0], (k * _PIECE,)
            )

        rotations = jax.lax.fori_loop(0, pieces, fill_piece, jnp.zeros_like(times))
        return jnp.where(complete, rotations, jnp.nan)

    return jax.jvp(compute, (known,), (along,))


class WindowFit(NamedTuple):
    """The fit to the measurements up to a time."""

    end: float  # [s]
    values: Values
    covariance: Values
    scatter: float  # standard deviation of the residuals [rad]
    measurements: int
    converged: bool


def _fit_window(
    test: ShakingTest, start: Values, end: float, last: WindowFit | None
) -> WindowFit:
    """Fit the measurements up to a time, from the values of the last window if there is one."""
    from scipy.optimize import least_squares  # which loads slowly

    measured = test.measured[test.time <= end]
    counts = ~np.isnan(measured)
    seen = _estimate_noise(measured[counts])

    @functools.lru_cache(maxsize=1)  # SciPy asks for the Jacobian after the residuals
    def evaluate(*values: float) -> tuple[Values, Values]:
        rotation, jacobian = test.simulate(np.array(values), end)
        return (rotation - measured)[counts] / seen, jacobian[counts] / seen

    count = int(counts.sum())
    if not np.isfinite(evaluate(*start)[0]).all():
        return WindowFit(end, start, np.diag(start * np.nan), np.inf, count, False)
    tolerance = _TOLERANCE[test.dtype.itemsize]
    result = least_squares(
        lambda values: evaluate(*values)[0],
        start,
        jac=lambda values: evaluate(*values)[1],  # pyright: ignore[reportArgumentType]
        bounds=np.transpose([_BOUNDS[name] for name in test.parameters]),
        x_scale="jac",
        ftol=tolerance,
        xtol=tolerance,
        gtol=tolerance,
        max_nfev=30,
    )
    scatter = seen * float(np.sum(result.fun**2) / max(count - start.size, 1)) ** 0.5
    covariance = ((test.noise or scatter) / seen) ** 2 * compute_covariance(result.jac)
    # Residuals are compared with the scatter of the measurements themselves, and then with
    # those of the last window: a noise estimated from them would fit any motion. Values that
    # move by many standard errors have found another motion.
    limit = _OFF * (test.noise or seen)
    moved = np.zeros(start.size)
    if last is not None:
        limit = (test.noise or last.scatter) * (1 + _ROUGHER / (2 * last.measurements) ** 0.5)
        moved = np.abs(result.x - last.values) / np.sqrt(np.diagonal(last.covariance))
    exact = scatter <= _EXACT * np.abs(measured[counts]).max()
    follows = exact or (scatter <= limit and (moved <= _MOVED).all())
    converged = bool(result.success and follows and np.isfinite(covariance).all())
    covariance *= 1 if converged else np.nan
    return WindowFit(end, result.x, covariance, scatter, count, converged)


def fit_windows(test: ShakingTest) -> WindowFit:
    """Fit windows that grow as long as the motion is reproduced in them.

    The first one that is fitted is the best of several initial values of C. If none is, the
    answer is that of the longest.
    """
    rotation = test.measured[test.time <= test.window]
    known = rotation[~np.isnan(rotation)]
    # Exact rotations would show sides so small that no computed motion needs to share them.
    noise = max(test.noise or _estimate_noise(known), 0.01 * np.abs(known).max())
    sides = np.where(np.abs(rotation) > _SEEN * noise, np.sign(rotation), 0)
    # An impact is over where the block is first seen on the other side.
    observed = np.flatnonzero(sides)
    changes = observed[1:][np.diff(sides[observed]) != 0]
    if not changes.size:
        raise ValueError("rotation must show a block that rocks, got no impact")
    counts = [_FIRST]
    while counts[-1] * _GROWTH < changes.size:
        counts.append(int(counts[-1] * _GROWTH))
    window_ends = [*test.time[changes[counts[:-1]]], test.window]

    starts = _choose_starts(test, window_ends[0])
    last = None
    windows = list[WindowFit]()
    for end in window_ends:
        fits = [_fit_window(test, start, end, last) for start in starts]
        windows.append(min(fits, key=lambda fit: (not fit.converged, fit.scatter)))
        starts = [fit.values for fit in fits]
        if windows[-1].converged:
            last = windows[-1]
            starts = [last.values]
        elif last is not None:
            break
    return last or windows[-1]


def _choose_starts(test: ShakingTest, end: float) -> list[Values]:
    """Choose values to begin with: those of C that explain the first window best."""
    known = np.array([test.known[name] for name in test.parameters])
    if test.start_given or "restitution" not in test.parameters:
        return [known]
    fitted = np.array(test.parameters) == "restitution"
    trials = [np.where(fitted, value, known) for value in _RESTITUTIONS]
    measured = test.measured[test.time <= end]
    counts = ~np.isnan(measured)
    # NaN, where the integration does not finish, comes last.
    squares = [np.sum((test.simulate(t, end)[0] - measured)[counts] ** 2) for t in trials]
    return [trials[k] for k in np.argsort(squares)[:_STARTS]]


def _estimate_noise(rotation: np.ndarray) -> float:
    """Estimate the noise by second differences, in which smooth motion nearly vanishes.

    It is at least that of the integrator.
    """
    # The variance of 1, -2, 1 times noise is 6, and the median of the sizes of normal numbers
    # is 0.6745. The median passes over the few times at which an impact bends the motion.
    bends = np.abs(np.diff(rotation, 2))
    median_noise = float(np.median(bends)) / (0.6745 * 6**0.5) if bends.size else 0.0
    return max(median_noise, _EXACT * float(np.max(np.abs(rotation), initial=0)))
