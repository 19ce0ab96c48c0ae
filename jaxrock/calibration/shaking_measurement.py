"""A test on a shaking table, and its fit over longer and longer windows.

Small changes grow from impact to impact: over a long test the misfit as a function of C has
many minima, and its derivatives do not lead from one to the next. Over the first impacts it
has few. Values that fit these impacts are close enough to fit a few more, and so on.
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
# Trial values of C, where none is given, and the number of them that begin a search. A window
# shows few impacts, but there may be many smaller ones, and as many minima of the misfit.
_RESTITUTIONS = np.linspace(0.5, 0.98, 97)
_STARTS = 5
_FIRST = 3  # impacts in the first window
_GROWTH = 1.5  # factor on the number of impacts from one window to the next
_OFF = 1.2  # largest root mean square of a fit to the first window, over the noise
# Fraction of the noise by which the residuals of the next window may exceed it. Its unit is
# 1 / sqrt(2 n), the relative error of a noise estimated from n residuals.
_ROUGHER = 3.0
_EXACT = 1e-6  # noise over rotation below which all noise is numerical
_MOVED = 5.0  # largest move of a value between windows, in standard errors
_SEEN = 4.0  # rotation over the noise above which its side is certain
_TOLERANCE = {8: 1e-8, 4: 1e-5}  # relative change at which a search ends, by bytes of a number
_IMPACTS = 2048  # largest number of impacts
# Times are padded to a multiple of the first number. Rotations are computed in pieces of the
# second number, each in the time of its slowest one.
_TIMES = 1024
_PIECE = 16


class ShakingTest(NamedTuple):
    """A test: its measurements, the known data, and the names of the fitted parameters."""

    time: Float[np.ndarray, " times"]
    measured: Float[np.ndarray, " times"]  # NaN where unknown
    window: float  # time up to which measurements are used
    noise: float | None
    known: dict[str, float]  # by the names in `PARAMETERS`
    start_given: bool  # whether C is given, at which the search begins
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
        """Compute rotations [rad] at all times until `end`, and their Jacobian."""
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

    It takes one direction at a time: a Jacobian would need a program for each set of
    parameters.
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

        # The number of pieces is an argument: unused room for times costs nothing.
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
    rms: float  # root mean square of the residuals [rad]
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
    rms = seen * float(np.sum(result.fun**2) / max(count - start.size, 1)) ** 0.5
    covariance = ((test.noise or rms) / seen) ** 2 * compute_covariance(result.jac)
    # Residuals are compared with the noise of the measurements, and later with the residuals
    # of the last window: a noise estimated from the residuals themselves would fit any motion.
    # Values that move by many standard errors belong to another motion.
    limit = _OFF * (test.noise or seen)
    moved = np.zeros(start.size)
    if last is not None:
        limit = (test.noise or last.rms) * (1 + _ROUGHER / (2 * last.measurements) ** 0.5)
        moved = np.abs(result.x - last.values) / np.sqrt(np.diagonal(last.covariance))
    exact = rms <= _EXACT * np.abs(measured[counts]).max()
    follows = exact or (rms <= limit and (moved <= _MOVED).all())
    converged = bool(result.success and follows and np.isfinite(covariance).all())
    covariance *= 1 if converged else np.nan
    return WindowFit(end, result.x, covariance, rms, count, converged)


def fit_windows(test: ShakingTest) -> WindowFit:
    """Fit windows that grow as long as the motion is reproduced in them.

    The first window that is fitted takes the best of several initial values of C. If no window
    is fitted, the answer is the fit to the longest.
    """
    rotation = test.measured[test.time <= test.window]
    known = rotation[~np.isnan(rotation)]
    # With exact rotations tiny ones would count, whose side a computed motion need not share.
    noise = max(test.noise or _estimate_noise(known), 0.01 * np.abs(known).max())
    sides = np.where(np.abs(rotation) > _SEEN * noise, np.sign(rotation), 0)
    # An impact lies before the first rotation on the other side.
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
        windows.append(min(fits, key=lambda fit: (not fit.converged, fit.rms)))
        starts = [fit.values for fit in fits]
        if windows[-1].converged:
            last = windows[-1]
            starts = [last.values]
        elif last is not None:
            break
    return last or windows[-1]


def _choose_starts(test: ShakingTest, end: float) -> list[Values]:
    """Choose initial values: the trial values of C that explain the first window best."""
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

    It is at least the noise of the integrator.
    """
    # The variance of 1, -2, 1 times noise is 6, and the median of the sizes of normal numbers
    # is 0.6745. The median ignores the few times at which an impact bends the motion.
    bends = np.abs(np.diff(rotation, 2))
    median_noise = float(np.median(bends)) / (0.6745 * 6**0.5) if bends.size else 0.0
    return max(median_noise, _EXACT * float(np.max(np.abs(rotation), initial=0)))
