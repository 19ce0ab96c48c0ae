"""Restitution, and if need be shape and inertia, of a block from a shaking-table test."""

from collections.abc import Sequence

import equinox as eqx
import jax
import numpy as np

from ..block import Block
from ..ground_motion import Motion
from ..host import Printed, Status, describe_status
from ..impact import housner_restitution, require_free_standing
from ..resonance import ModelLike, Nonlinear, as_model
from ..validation import (
    FINITE,
    NON_NEGATIVE,
    POSITIVE,
    UNIT_INTERVAL,
    Integers,
    Number,
    Numbers,
    Reals,
    as_array,
    as_real,
    check,
    check_concrete,
    check_increasing,
    check_kind,
    unify_precision,
)
from .free_rocking_motion import OUTSIDE
from .shaking_measurement import PARAMETERS, ShakingTest, WindowFit, fit_windows

_OPTIONS = {
    "restitution": (UNIT_INTERVAL, ""),
    "initial_rotation": (FINITE, "rad"),
    "initial_velocity": (FINITE, "rad/s"),
    "rotation_noise": (POSITIVE, "rad"),
    "window": (POSITIVE, "s"),
}


class DrivenFit(Printed, eqx.Module):
    """Parameters of a block fitted to a test on a shaking table; see `fit_driven_rocking`.

    Attributes
    ----------
    parameters : tuple of str
        The names of the fitted parameters.
    values, standard_errors : dict of Array
        Fitted values and their standard errors, by name of the parameter; errors are NaN if
        the search has not converged.
    covariance : Array, shape (parameters, parameters)
        Covariance of the fitted values, in the order of `parameters`.
    restitution, block : Array, Block
        The coefficient of restitution and the block, with the fitted values.
    rotation, residuals : Array, shape (n,)
        Computed rotation, and computed minus measured rotation [rad]; NaN if the integration
        up to the last time does not finish.
    rotation_noise : Array
        Standard deviation of a measured rotation [rad], given or estimated.
    used_until, last_time : Array
        Time up to which measurements are used, and time of the last one [s]. Beyond
        `used_until`, which is at most `window`, the computed motion departs from the measured
        one.
    status : Array of int
        A `jaxrock.Status`: COMPLETE, or NOT_CONVERGED for the part that is used.
    """

    parameters: tuple[str, ...] = eqx.field(static=True)
    values: dict[str, Reals]
    standard_errors: dict[str, Reals]
    covariance: Reals
    restitution: Reals
    block: Block
    rotation: Reals
    residuals: Reals
    rotation_noise: Reals
    used_until: Reals
    last_time: Reals
    status: Integers

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks to read before using the results."""
        sentences = list(filter(None, [describe_status(self.status)]))
        if float(self.used_until) < float(self.last_time):
            sentences.append(
                f"measurements beyond {float(self.used_until):.4g} s are not used, since the"
                " computed motion departs from them or the window ends"
            )
        return tuple(sentences)

    def __str__(self) -> str:
        lines = [
            f"{name.replace('_', ' '):20}{float(self.values[name]):.6g}"
            f" +- {float(self.standard_errors[name]):.2g}"
            for name in self.parameters
        ]
        lines.append(f"{'rotation noise':20}{float(self.rotation_noise):.3g} rad")
        return "\n".join([*lines, *self.remarks])


def fit_driven_rocking(  # noqa: PLR0913
    time: Numbers,
    rotation: Numbers,
    block: Block,
    motion: Motion,
    restitution: Number | None = None,
    *,
    parameters: Sequence[str] = ("restitution",),
    initial_rotation: Number = 0.0,
    initial_velocity: Number = 0.0,
    model: ModelLike = Nonlinear(),
    rotation_noise: Number | None = None,
    window: Number | None = None,
) -> DrivenFit:
    """Fit the restitution of a block to its rotation measured on a shaking table.

    The fit minimizes the sum of squared residuals with `respond` and its derivatives, over the
    first impacts and then over more and more of them. Otherwise impacts could come in another
    order: the computed block would be on the wrong side, and no derivative would lead back.

    Parameters
    ----------
    time, rotation : array_like, shape (n,)
        Increasing times [s], and the rotations alpha measured at these times [rad], NaN where
        unknown. A positive acceleration pushes the block to positive rotations.
    block, motion : Block, Motion
        The block, and the motion of the table.
    restitution : float, optional
        Initial value of C, or its value if C is not fitted. By default the fit starts from five
        values between 0.5 and 0.96, and goes on from the one that explains the first impacts
        best. If C is not fitted, Housner's value is the default.
    parameters : sequence of str
        Names of the fitted parameters: "restitution", "slenderness", "half_width",
        "inertia_ratio".
    initial_rotation, initial_velocity : float
        At time 0 [rad], [rad/s]; at rest by default.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.
    rotation_noise : float, optional
        Standard deviation of the measured rotations [rad], taken as independent; by default
        estimated from the residuals.
    window : float, optional
        Time up to which measurements are used [s]; by default all of them.

    Returns
    -------
    DrivenFit

    Raises
    ------
    ValueError
        If an argument is out of range, traced or of the wrong shape; if the block is
        one-sided; if the measured block hardly moves; or if the computed block overturns, or
        does not move, for all initial values of C.

    Notes
    -----
    Standard errors are local: they describe the neighbourhood of the fitted motion. A longer
    test has smaller standard errors, but also more different motions that fit nearly as well.
    A C many standard errors away may still explain the test, if it is within the standard
    errors of a fit to the first impacts alone.

    Examples
    --------
    >>> import jaxrock as jr, numpy as np
    >>> block, pulse = jr.Block(0.2, 5.0), jr.Sine(amplitude=2.5, duration=0.8)
    >>> time = np.linspace(0, 4, 201)
    >>> rotation, _ = jr.respond(block, 0.85, pulse, 4.0).history(time)
    >>> fit = jr.calibration.fit_driven_rocking(time, rotation, block, pulse)
    >>> print(f"{fit.restitution:.4f}", f"up to {fit.used_until} s")
    0.8500 up to 4.0 s
    """
    check_kind("block", block, Block)
    require_free_standing(block, "a fit of driven rocking")
    check_kind("motion", motion, Motion)
    # A string is a sequence of letters, not of names.
    names = () if isinstance(parameters, str) else tuple(map(str, parameters))
    if not names or len(set(names)) < len(names) or not set(names) <= set(PARAMETERS):
        allowed = ", ".join(PARAMETERS)
        raise ValueError(
            f"parameters must be one or more different names of {allowed}, got {parameters!r}"
        )
    times = as_real("time", time, unit="s")
    rotations = as_real("rotation", rotation, unit="rad")
    options = {
        "restitution": restitution,
        "initial_rotation": initial_rotation,
        "initial_velocity": initial_velocity,
        "rotation_noise": rotation_noise,
        "window": window,
    }
    given = {
        name: as_real(name, value, unit=_OPTIONS[name][1])
        for name, value in options.items()
        if value is not None
    }
    check_concrete((times, rotations, given, block, motion), OUTSIDE)
    if times.ndim != 1 or times.size < 2 or rotations.shape != times.shape:
        raise ValueError(
            "time and rotation must be one-dimensional and equally long, with at least 2 values,"
            f" got shapes {times.shape} and {rotations.shape}"
        )
    for name, value in given.items():
        check(name, value, _OPTIONS[name][0])
    check("time", times, NON_NEGATIVE)
    check_increasing("time", times)
    # Times and rotations stay in float64: only the motion has the precision of the arguments.
    instants = np.asarray(times, float)
    values = np.asarray(rotations, float)
    end = min(float(given.get("window", np.inf)), float(instants[-1]))
    check("rotation", values[~np.isnan(values)], FINITE)
    known = values[(instants <= end) & ~np.isnan(values)]
    if known.size <= len(names):
        raise ValueError(
            f"rotation must have at least {len(names) + 1} known values, got {known.size}"
        )
    start = given.get("restitution", housner_restitution(block))
    initial = given["initial_rotation"], given["initial_velocity"]
    _, start, initial, block, motion = unify_precision((times, start, initial, block, motion))
    sizes = ("slenderness", "half_width", "inertia_ratio")
    test = ShakingTest(
        time=instants,
        measured=values,
        window=end,
        noise=float(given["rotation_noise"]) if "rotation_noise" in given else None,
        known={"restitution": float(start), **{n: float(getattr(block, n)) for n in sizes}},
        start_given="restitution" in given,
        gravity=block.gravity,
        motion=motion.bucketed(),
        initial=initial,
        parameters=names,
        model=as_model(model),
    )
    return _make_driven_fit(test, fit_windows(test))


def _make_driven_fit(test: ShakingTest, fit: WindowFit) -> DrivenFit:
    """Make the answer: the motion up to the end, with the values fitted to the last window."""
    rotation, _ = test.simulate(fit.values, float(test.time[-1]))
    names = test.parameters
    fitted = {**test.known, **dict(zip(names, fit.values, strict=True))}
    errors = np.sqrt(np.diagonal(fit.covariance))
    reals = {
        "values": {name: fitted[name] for name in names},
        "standard_errors": dict(zip(names, errors, strict=True)),
        "covariance": fit.covariance,
        "restitution": fitted["restitution"],
        "rotation": rotation,
        "residuals": rotation - test.measured,
        "rotation_noise": test.noise or fit.rms,
        "used_until": fit.end,
        "last_time": test.time[-1],
    }
    reals, fitted = jax.tree.map(lambda leaf: np.asarray(leaf, test.dtype), (reals, fitted))
    size = fitted["half_width"], fitted["slenderness"], test.gravity, fitted["inertia_ratio"]
    return DrivenFit(
        parameters=names,
        **jax.device_put(reals),
        block=Block(*size),
        status=as_array(Status.COMPLETE if fit.converged else Status.NOT_CONVERGED),
    )
