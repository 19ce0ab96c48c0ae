"""Restitution, and if need be shape and inertia, of a block from a shaking-table test."""

from collections.abc import Sequence

import equinox as eqx
import numpy as np
from jaxtyping import Array

from ..block import Block
from ..ground_motion import Motion
from ..host import Printed, Status, describe_status
from ..impact import housner_restitution, require_free_standing
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import (
    FINITE,
    NON_NEGATIVE,
    POSITIVE,
    UNIT_INTERVAL,
    Booleans,
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
from .least_squares import OUTSIDE, Values
from .shaking_measurement import (
    RESTITUTIONS,
    ShakingTest,
    Stage,
    detect_sides,
    estimate_rough_noise,
    fit_in_parts,
)

_PARAMETERS = "restitution", "slenderness", "half_width", "inertia_ratio"
_LEAST_ROOM = 512  # for impacts in a list, so that most tests take the same program


class DrivenFit(Printed, eqx.Module):
    """Parameters of a block fitted to a test on a shaking table; see `fit_driven_rocking`.

    Attributes
    ----------
    parameters : tuple of str
        The names of the fitted parameters.
    values, standard_errors : dict of Array
        Fitted values and their standard errors, by name of the parameter.
    covariance : Array, shape (parameters, parameters)
        Covariance of the fitted values, in the order of `parameters`.
    restitution, block : Array, Block
        The coefficient of restitution and the block, with the fitted values.
    rotation, residuals : Array, shape (n,)
        Computed rotation, and computed minus measured rotation [rad].
    rotation_noise : Array
        Standard deviation of a measured rotation [rad], given or estimated.
    used_until, last_time : Array
        Time up to which measurements are used, and time of the last one [s]. Beyond
        `used_until` the computed motion departs from the measured one: impacts come in
        another order, or the motion is so sensitive that derivatives are meaningless.
    same_order : Array of bool
        True if the computed and the measured block are at no time observed on opposite sides.
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
    same_order: Booleans
    status: Integers

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks to read before using the results."""
        sentences = []
        status = describe_status(self.status)
        if status:
            sentences.append(status)
        if not bool(self.same_order):
            sentences.append(
                "before the end, computed impacts come in another order than measured ones"
            )
        if float(self.used_until) < float(self.last_time):
            sentences.append(
                f"beyond {float(self.used_until):.4g} s the computed motion departs from the"
                " measured one or is too sensitive: later measurements are not used"
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
) -> DrivenFit:
    """Fit the restitution of a block to its rotation measured on a shaking table.

    The fit minimizes the sum of squared residuals with `respond` and its derivatives. It
    extends the fitted part of the motion step by step. Otherwise impacts could come in another
    order: the computed block would be on the wrong side, and no derivative would lead back.

    Parameters
    ----------
    time, rotation : array_like, shape (n,)
        Increasing times [s], and the rotations alpha measured at these times [rad], NaN where
        unknown. A positive acceleration pushes the block to positive rotations.
    block, motion : Block, Motion
        The block, and the motion of the table.
    restitution : float, optional
        Initial value of C, or its value if C is not fitted. By default the fit tries values
        from 0.5 to 0.98, and starts from the value that explains the first part of the motion
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
    >>> fit = jr.fit_driven_rocking(time, rotation, block, pulse)
    >>> print(f"{fit.restitution:.4f}", bool(fit.same_order))
    0.8500 True
    """
    test = _check_test(
        time,
        rotation,
        block,
        motion,
        restitution,
        parameters,
        rotation_noise,
        (initial_rotation, initial_velocity),
        as_model(model),
    )
    given = None if restitution is None else test.known["restitution"]
    stage = fit_in_parts(test, given, None if rotation_noise is None else test.noise)
    return _make_driven_fit(test, stage, block)


def _check_test(  # noqa: PLR0913
    time: Numbers,
    rotation: Numbers,
    block: Block,
    motion: Motion,
    restitution: Number | None,
    parameters: Sequence[str],
    noise: Number | None,
    initial: tuple[Number, Number],
    model: RockingModel,
) -> ShakingTest:
    """Check the test: all of it concrete and allowed."""
    check_kind("block", block, Block)
    require_free_standing(block, "a fit of driven rocking")
    check_kind("motion", motion, Motion)
    # A string is a sequence of its letters, which are no names.
    if isinstance(parameters, str) or not parameters:
        raise ValueError(f"parameters must be one or more names, got {parameters!r}")
    parameters = list(parameters)
    for name in parameters:
        is_known = isinstance(name, str) and name in _PARAMETERS
        if not is_known or parameters.count(name) > 1:
            allowed = ", ".join(_PARAMETERS)
            raise ValueError(f"parameters must be different names of {allowed}, got {name!r}")
    # Arguments that are not given have a value that passes the checks.
    times = as_real("time", time, unit="s")
    angles = as_real("rotation", rotation, unit="rad")
    start = as_real("restitution", 0.5 if restitution is None else restitution, unit="")
    first = as_real("initial_rotation", initial[0], unit="rad")
    speed = as_real("initial_velocity", initial[1], unit="rad/s")
    size = as_real("rotation_noise", 1.0 if noise is None else noise, unit="rad")
    tree = (times, angles, start, (first, speed), size, block, motion)
    check_concrete(tree, OUTSIDE)
    if times.ndim != 1 or times.size < 2 or angles.shape != times.shape:
        raise ValueError(
            "time and rotation must be one-dimensional and equally long, with at least 2 values,"
            f" got shapes {times.shape} and {angles.shape}"
        )
    check("time", times, NON_NEGATIVE)
    check_increasing("time", times)
    instants = np.asarray(times, float)  # in NumPy, which compiles nothing
    measured = np.asarray(angles, float)
    counts = ~np.isnan(measured)
    check("rotation", measured[counts], FINITE)
    if counts.sum() <= len(parameters):
        least = len(parameters) + 1
        raise ValueError(
            f"rotation must have at least {least} known values, got {counts.sum()}"
        )
    # The rest in the library's words for wrong values.
    check("restitution", start, UNIT_INTERVAL)
    check("initial_rotation", first, FINITE)
    check("initial_velocity", speed, FINITE)
    check("rotation_noise", size, POSITIVE)
    if restitution is None:
        start = housner_restitution(block)
    tree = unify_precision((times, start, (first, speed), block, motion))
    _, start, starts, block, motion = tree
    # Times and rotations stay in float64: only the motion is computed in the precision given.
    rough_noise = estimate_rough_noise(measured[counts]) if noise is None else float(size)
    if rough_noise == 0:
        raise ValueError("rotation must show a block that rocks, got 0 everywhere")
    test = ShakingTest(
        time=instants,
        # Without NaN, which would stay NaN when it is given no weight.
        measured=np.where(counts, measured, 0),
        counts=counts,
        noise=rough_noise,
        known={
            "restitution": float(start),
            "slenderness": float(block.slenderness),
            "half_width": float(block.half_width),
            "inertia_ratio": float(block.inertia_ratio),
        },
        gravity=block.gravity,
        motion=motion.bucketed(),
        initial=starts,
        parameters=tuple(parameters),
        model=model,
        room=_LEAST_ROOM,
    )
    return test._replace(room=_choose_room(test))


def _choose_room(test: ShakingTest) -> int:
    """Choose room for twice as many impacts as the most lively block that is tried has."""
    # The higher C, the longer a block rocks. Twice as many, since in the search C and the size
    # may become those of a block that strikes more often.
    trials = [test.known["restitution"]]
    if "restitution" in test.parameters:
        trials.append(RESTITUTIONS[-1])
    impacts = [test.follow(test.to_numbers(c), float(test.time[-1]))[2] for c in trials]
    room = test.room
    while room < 2 * max(impacts):
        room *= 4  # so that few are compiled
    return room


def _make_driven_fit(test: ShakingTest, stage: Stage, block: Block) -> DrivenFit:
    """Make the answer: the motion up to the end by the numbers of the last part."""
    rotation, _, _ = test.follow(stage.numbers, float(test.time[-1]))
    if not np.isfinite(rotation).all():
        raise ValueError(
            "integration did not finish with the fitted values; see the status of respond"
        )
    # On opposite sides where both are seen: an impact came in another order in between.
    opposite = detect_sides(test, test.measured) * detect_sides(test, rotation) < 0
    names = test.parameters
    values = test.known | dict(zip(names, stage.values, strict=True))
    errors = np.sqrt(np.diagonal(stage.covariance))

    def to_real(numbers: Values | float) -> Array:
        """Convert to the precision in which the test was given."""
        return as_array(np.asarray(numbers, test.dtype))

    fitted = {name: to_real(value) for name, value in values.items()}
    size = fitted["half_width"], fitted["slenderness"], test.gravity, fitted["inertia_ratio"]
    return DrivenFit(
        parameters=names,
        values={name: fitted[name] for name in names},
        standard_errors={name: to_real(e) for name, e in zip(names, errors, strict=True)},
        covariance=to_real(stage.covariance),
        restitution=fitted["restitution"],
        block=Block(*size),
        rotation=to_real(rotation),
        residuals=to_real(np.where(test.counts, rotation - test.measured, np.nan)),
        rotation_noise=to_real(stage.noise),
        used_until=to_real(stage.end),
        last_time=to_real(test.time[-1]),
        same_order=as_array(not opposite.any()),
        status=as_array(Status.COMPLETE if stage.converged else Status.NOT_CONVERGED),
    )
