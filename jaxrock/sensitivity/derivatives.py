"""Derivatives of an answer under a motion, with their errors and the ranges in which they hold."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..driven import (
    Batch,
    EstimatedResponse,
    SimulatedAnswer,
    differentiate_within,
    find_slope_scale,
    simulate_batch,
)
from ..ground_motion import Motion, Record, Suite
from ..host import Printed
from ..resonance import ModelLike, Nonlinear, RockingModel, Scene, as_model
from ..validation import POSITIVE, Number, Reals, as_name, as_real, check
from .closed_forms import differentiate_at
from .driven_scenes import gather_scene, make_batch
from .parameters import Parameters, name_parameters

# The answers as `Batch` numbers them.
_CODES = {"peak_rotation": 0, "rotation_ratio": 1, "margin": 2}
_SYMBOLS = {"restitution": "C", "half_width": "b", "slenderness": "lambda", "intensity": "I"}
_BY = "restitution", "half_width", "slenderness"
# Ranges are examined up to this fraction of a parameter. An end is put at this fraction of the
# distance to a coincidence, which is known to first order; where a simulation there shows that it
# has been passed, the distance is reduced by this factor, so many times.
_FARTHEST = 0.2
_NEARER = 0.75
_REDUCTION = 0.15
_ROUNDS = 5
# Of a parameter, in eps: a range that is shorter is none.
_ROUNDING = 64
# What a parabola through both ends of a range may leave unexplained, over what it explains.
_UNEXPLAINED = 0.1
# What gaps and sums over impacts may differ from their tangents, over themselves.
_UNSTEADY = 0.12
# Why a range ends where it does.
REASONS = (
    "as far as examined",
    "what is allowed ends",
    "an impact appears or vanishes",
    "another bounce is the highest",
    "the block overturns",
    "the answer jumps or bends",
    "the block is lifted at another moment",
)
_EXAMINED, _LIMIT, _IMPACT, _CHANGE, _OVERTURNS, _BENDS, _LIFTED = range(len(REASONS))


class Derivatives(Printed, eqx.Module):
    """Derivatives of answers with errors and ranges; see `derivatives_within`.

    Attributes
    ----------
    of : str
        The answer y.
    value : Array
        y; NaN for the peak of a block that overturns, and for the margin of one that lies on its
        side before the motion ends.
    response : EstimatedResponse or None
        As `respond_within` gives it; None for closed forms.
    at, derivative, error : dict of Array
        By the name of each parameter x: its value, ``dy / dx``, and the absolute error of that.
    below, above : dict of Array
        From where to where value and slope go on without a jump. A limit that is x itself says
        that no range was confirmed on this side; at the end of what is allowed, such as C = 1,
        the derivative is one-sided.
    within_tolerance : dict of Array of bool
        Whether the error is at most the tolerance times ``max(abs(dy / dx), abs(y / x))``, and x
        lies inside the range by more than rounding.
    below_reason, above_reason : dict of Array of int
        Why the range ends there, as a number; `explain` has it in words.
    """

    of: str = eqx.field(static=True)
    value: Reals
    response: EstimatedResponse | None
    at: dict[str, Reals]
    derivative: dict[str, Reals]
    error: dict[str, Reals]
    below: dict[str, Reals]
    above: dict[str, Reals]
    within_tolerance: dict[str, Any]
    below_reason: dict[str, Any]
    above_reason: dict[str, Any]

    def explain(self, name: str) -> str:
        """Say what is known of the derivative of one block.

        Parameters
        ----------
        name : str
            The parameter.

        Returns
        -------
        str
            The derivative with its error and range, and what ends that; or why there is none.
        """
        columns = self.at, self.derivative, self.error, self.below, self.above
        x, slope, error, low, high = (float(column[name]) for column in columns)
        symbol = _SYMBOLS.get(name, name)
        head = f"d({self.of.replace('_', ' ')})/d{symbol}"
        if math.isnan(slope):
            return f"{head} does not exist: the block overturns"
        if math.isinf(error):
            return f"{head} is not known: less accurate simulations go another way"
        text = f"{head} = {_write(slope, error)} +- {error:.1g}, for {symbol} from "
        text += " to ".join(_write(limit, 0.1 * abs(x - limit)) for limit in (low, high))
        for side, limit, column in (
            ("below", low, self.below_reason),
            ("above", high, self.above_reason),
        ):
            reason = int(column[name])
            if limit == x and reason == _LIMIT:
                inside = {"below": "larger", "above": "smaller"}[side]
                text += f"; one-sided, for a {inside} {symbol}"
            elif limit == x:
                text += f"; no range {side}: {REASONS[reason]}"
            elif reason != _EXAMINED:
                text += f"; {side}, {REASONS[reason]}"
        return text

    def table(self) -> dict[str, list[float]]:
        """List values, derivatives with errors, elasticities and ranges of one block.

        Returns
        -------
        dict of list
            A row for each parameter.
        """
        slopes = self.derivative
        elasticity = {name: slopes[name] * x / self.value for name, x in self.at.items()}
        columns = {"value": self.at, "derivative": slopes, "error": self.error}
        columns |= {"elasticity": elasticity, "below": self.below, "above": self.above}
        return {head: [*map(float, part.values())] for head, part in columns.items()}

    def __str__(self) -> str:
        if np.ndim(self.value):
            lines = [f"{k}: {np.mean(v):.1%}" for k, v in self.within_tolerance.items()]
            return "\n".join(["derivatives within the tolerance", *lines])
        head = f"{self.of.replace('_', ' ')} {float(self.value):.6g}"
        return "\n".join([head, *map(self.explain, self.derivative)])


def _write(value: float, error: float) -> str:
    """Write a value with the digits that its error leaves."""
    digits = 6.0
    if value and error:
        digits = 1 + np.floor(np.log10(abs(value))) - np.floor(np.log10(error))
    return f"{value:.{np.clip(digits, 4, 12):.0f}g}"


def derivatives_within(
    blocks: Block,
    restitution: Number,
    motion: "Motion | Suite | Number",
    tolerance: float,
    duration: Number | None = None,
    *,
    of: str | Callable[..., Reals] = "peak_rotation",
    by: Sequence[str] | None = None,
    model: ModelLike | None = None,
) -> Derivatives:
    """Differentiate an answer of many blocks, with the error and the range of each derivative.

    Parameters
    ----------
    blocks, restitution, duration
        As in `respond_batch`, where everything broadcasts.
    motion : Motion, Suite or array_like
        As in `respond_batch`; or, for closed forms, the change I of the ground's velocity in
        each instantaneous pulse of the paper [m/s].
    tolerance : float
        Relative tolerance of the peak rotation, and of each derivative; see `Derivatives`.
    of : {"peak_rotation", "rotation_ratio", "margin"} or callable
        The answer y: alpha_max [rad] or alpha_max / alpha_c [-], which do not exist for a block
        that overturns, or the margin of `respond` [-]; for closed forms a function of a `Scene`,
        such as `rotation_ratio`.
    by : sequence of str, optional
        Parameters x: ``restitution``, ``factor`` (on the motion), the sizes and constants of a
        `Block` (``half_width`` and ``slenderness``, or ``width`` and ``height``, ...),
        ``amplitude`` and ``duration`` of a pulse, ``amplitude`` and ``frequency`` of a
        `Harmonic`. By default restitution, half_width, slenderness, and factor (for closed
        forms intensity).
    model : Nonlinear or Linearized, or their names, optional
        Equation of motion; by default that of `respond_batch`, or of the closed form.

    Returns
    -------
    Derivatives

    Raises
    ------
    ValueError
        If an argument is not allowed.

    Notes
    -----
    The derivatives run beside each response and its companions (see `respond_within`), as the
    solutions of the variational equation through every impact. Their error is estimated as that
    of the response is: three times the difference from the derivative of a less accurate
    simulation, whose last Taylor terms, input and restitution differ. Assumed is what is
    assumed there, and that the derivatives of all these simulations belong to the same events.

    A range ends where the impacts before the answer, the highest bounce, the moment of uplift
    or the outcome change, where the answer departs from a parabola by a tenth, or at 20 % of
    the parameter, beyond which nothing is examined. To first order the margin of each event
    (squared velocity of an impact, height of a low point, gap to each other top, margin of
    overturning) says how far away the nearest coincidence is. A simulation at 3/4 of that
    distance checks it, and the distance is reduced until one confirms it. Between the ends
    a narrow interval may not be detected, in which another bounce is the highest.

    Of closed forms the error is that of rounding, and a range ends where the block overturns.

    Examples
    --------
    >>> import jaxrock as jr
    >>> block, pulse = jr.Block(half_width=0.2, slenderness=5.0), jr.Sine(3.0, 0.5)
    >>> found = jr.derivatives_within(block, 0.9, pulse, 1e-6, 3.0, by=("restitution",))
    >>> print(found.explain("restitution").partition(", for")[0])
    d(peak rotation)/dC = 0.1005515539 +- 4e-10
    >>> print(f"for C from {found.below['restitution']:.2f} to {found.above['restitution']:.2f}")
    for C from 0.87 to 0.99
    """
    check("tolerance", as_real("tolerance", tolerance), POSITIVE)
    if callable(of):
        scene = Scene(blocks, restitution, cast("Number", motion))
        answer = eqx.Partial(of, **({} if model is None else {"model": model}))
        return _differentiate_closed_form(answer, scene, tolerance, by)
    motion = cast("Motion | Suite", motion)
    as_name("of", of, _CODES)
    scene, duration = gather_scene(blocks, restitution, motion, duration)
    names = (*_BY, "factor") if by is None else tuple(by)
    parameters = name_parameters(scene, names, "by")
    batch = make_batch(parameters.build({}), motion, duration)
    batch = replace(batch, answer=np.asarray(_CODES[of], batch.dtype))
    at = np.stack(
        [np.broadcast_to(parameters.values[name], batch.shape) for name in names], -1
    )
    # Records of many lengths share one program.
    traced = motion.bucketed() if isinstance(motion, Record) else motion
    directions = _find_directions(parameters, names, traced, duration)
    # What moves with no parameter becomes None: of that nothing has to be computed.
    moves = jax.tree.map(lambda *leaves: any(map(np.any, leaves)), *directions)
    directions = tuple(
        jax.tree.map(
            lambda move, leaf: np.asarray(leaf, batch.dtype) if move else None, moves, part
        )
        for part in directions
    )
    moved = replace(batch, directions=directions)
    equation = as_model(Nonlinear() if model is None else model)
    response, answer, slopes, error = differentiate_within(moved, tolerance, equation, at)
    derivative = np.where(np.isnan(answer.value)[..., None], np.nan, slopes.value)
    scenes = _Scenes(parameters, names, at, motion, duration, batch, equation)
    limits, reasons = scenes.find_ranges(answer, slopes, np.asarray(response.rtol), tolerance)
    columns = at, derivative, error, *limits, *reasons
    numbered = dict(enumerate(names))
    return _make_derivatives(of, numbered, tolerance, response, answer.value, columns)


def _differentiate_closed_form(
    answer: eqx.Partial, scene: Scene, tolerance: float, by: Sequence[str] | None
) -> Derivatives:
    """Differentiate a function of scenes, all of whose numbers may be arrays."""
    names = (*_BY, "intensity") if by is None else by
    parameters = name_parameters(scene, names, "by")
    at = np.stack(np.broadcast_arrays(*parameters.values.values()), -1)
    found = differentiate_at(answer, parameters, at)
    limits = found.below, found.above
    reasons = [
        np.where(np.isinf(limit) | (limit == 0), _EXAMINED, _OVERTURNS) for limit in limits
    ]
    columns = at, found.gradient, found.error, *limits, *reasons
    numbered = {[*parameters.values].index(name): name for name in names}
    of = getattr(answer.func, "__name__", "answer")
    return _make_derivatives(of, numbered, tolerance, None, found.value, columns)


def _make_derivatives(
    of: str,
    names: dict[int, str],
    tolerance: float,
    response: EstimatedResponse | None,
    value: Any,
    columns: Sequence[np.ndarray],
) -> Derivatives:
    """Decide which derivatives are within the tolerance, and give columns by name and index."""
    at, derivative, error, below, above, *reasons = columns
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.fmax(np.abs(derivative), np.abs(value[..., None] / at))
    within_tolerance = error <= tolerance * scale
    rounding = _ROUNDING * np.finfo(at.dtype).eps * np.abs(at)
    within_tolerance &= np.minimum(at - below, above - at) > rounding
    if response is not None:
        within_tolerance &= np.asarray(response.within_tolerance)[..., None]
    by_name = (
        {name: jax.device_put(column[..., k]) for k, name in names.items()}
        for column in (at, derivative, error, below, above, within_tolerance, *reasons)
    )
    return Derivatives(of, jax.device_put(value), response, *by_name)


@eqx.filter_jit
def _find_directions(
    parameters: Parameters,
    names: tuple[str, ...],
    motion: Motion | Suite,
    duration: Number | None,
) -> list[Batch]:
    """Find how the numbers of a batch move with each parameter."""
    values = [jnp.asarray(parameters.values[name]) for name in names]

    def list_arguments(values: Sequence[Reals]) -> Batch:
        scene = parameters.build(dict(zip(names, values, strict=True)))
        return make_batch(scene, motion, duration).arguments

    def move_along(row: np.ndarray) -> Batch:
        unit = [jnp.full_like(x, component) for x, component in zip(values, row, strict=True)]
        return jax.jvp(list_arguments, (values,), (unit,))[1]

    return [*map(move_along, np.eye(len(names)))]


class _Scenes(NamedTuple):
    """Scenes of which derivatives are wanted."""

    parameters: Parameters
    names: tuple[str, ...]
    at: np.ndarray
    motion: Motion | Suite
    duration: Number | None
    batch: Batch
    model: RockingModel

    def find_ranges(
        self,
        answer: SimulatedAnswer,
        slopes: SimulatedAnswer,
        rtol: np.ndarray,
        tolerance: float,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Find up to where slopes go on below and above, and what ends them there.

        Returns
        -------
        limits, reasons : ndarray, shape (2, ..., parameters)
        """
        size = np.abs(self.at)
        # A restitution stays between its limits 0 and 1.
        is_restitution = np.array(self.names) == "restitution"
        domain = np.where(is_restitution, 0.9 * np.stack([size, 1 - size]), np.inf)
        farthest = np.broadcast_to(_FARTHEST * size, domain.shape)
        pairs = slopes.events.nearest, slopes.change, slopes.overturning
        with np.errstate(divide="ignore"):
            coincidences = [_NEARER / np.stack([pair.below, pair.above]) for pair in pairs]
        candidates = np.stack([farthest, domain, *coincidences])
        reasons = np.argmin(candidates, axis=0)
        steps = candidates.min(axis=0)
        unknown = np.isnan(answer.value)[..., None]
        least = _ROUNDING * np.finfo(size.dtype).eps * size
        steps = np.where(unknown, np.nan, np.where(steps > least, steps, 0))
        steps[0] *= -1
        bends = np.full_like(steps, np.nan)
        valid = np.zeros(steps.shape, bool)
        allowed = tolerance * find_slope_scale(answer, slopes, self.at)
        for _ in range(_ROUNDS):
            pending = ~valid & (np.abs(steps) > 0)
            if not pending.any():
                break
            moved = self._simulate_limits(steps, pending, rtol)
            failure = _check_limits(moved, answer, slopes, steps, pending, bends, allowed)
            fails = failure >= 0
            valid |= pending & ~fails
            reasons = np.where(fails & (reasons <= _LIMIT), failure, reasons)
            steps = np.where(fails, _REDUCTION * steps, steps)
        return self.at + np.where(valid | unknown, steps, 0), reasons

    def _simulate_limits(
        self, steps: np.ndarray, pending: np.ndarray, rtol: np.ndarray
    ) -> SimulatedAnswer:
        """Simulate the limits of ranges that are pending, in the order of `np.nonzero`."""
        flat = self.at.reshape(-1, len(self.names))
        _, block, parameter = np.nonzero(pending.reshape(2, *flat.shape))
        values = flat[block]
        values[np.arange(block.size), parameter] += steps[pending]

        def take(leaf: Any) -> np.ndarray:
            return np.broadcast_to(leaf, self.batch.shape).flat[block]

        numbers = {name: take(value) for name, value in self.parameters.values.items()}
        numbers |= dict(zip(self.names, values.T, strict=True))
        part = self.batch.select(block)
        is_sampled = isinstance(self.motion, Record | Suite)
        motion = part.ground if is_sampled else jax.tree.map(take, self.motion)
        until = None if self.duration is None else part.until
        moved = make_batch(self.parameters.build(numbers), motion, until, rtol=take(rtol))
        moved = replace(moved, answer=part.answer)
        return cast("SimulatedAnswer", simulate_batch(moved, self.model).answer)


def _check_limits(
    moved: SimulatedAnswer,
    answer: SimulatedAnswer,
    slopes: SimulatedAnswer,
    steps: np.ndarray,
    pending: np.ndarray,
    bends: np.ndarray,
    allowed: np.ndarray,
) -> np.ndarray:
    """Check whether answers go on smoothly to limits of ranges that are pending.

    `bends`, the curvature towards each limit, is filled in.

    Returns
    -------
    ndarray of int, shape (2, ..., parameters)
        Why one does not, by its number; -1 where it does.
    """

    def select(column: np.ndarray) -> np.ndarray:
        return np.broadcast_to(column, steps.shape)[pending]

    step = steps[pending]
    distance = np.abs(step)
    here = jax.tree.map(lambda column: select(column[..., None]), answer)
    slope = jax.tree.map(select, slopes)
    linear = jax.tree.map(lambda part: part * step, slope)
    excess = jax.tree.map(lambda there, x, move: np.abs(there - x - move), moved, here, linear)
    rounding = 1e4 * np.finfo(distance.dtype).eps

    # Events that change the slope by less than its error do not matter.
    matters = ~(excess.value <= select(allowed) * distance)
    other_events = matters & (moved.events.sequence != here.events.sequence)
    largest_delay = 2 * np.abs(linear.events.lifted) + rounding * (1 + here.events.lifted)
    other_time = matters & (excess.events.lifted > largest_delay)
    # What departs from its tangent may depart further between both: the gap to the second
    # highest top, and all motion by its sum over impacts.
    unsteady = excess.gap > _UNSTEADY * here.gap
    allowed_sum = _UNSTEADY * np.abs(linear.impact_sum) + 1e-3 * here.impact_sum
    unsteady |= excess.impact_sum > allowed_sum

    bend = (moved.value - here.value - linear.value) / distance**2
    bends[pending] = np.where(other_events | other_time | unsteady, np.nan, bend)
    opposite = select(bends[::-1])
    mean = np.where(np.isnan(opposite), 0, 0.5 * (opposite + bend))
    explained = np.abs(linear.value) + np.abs(mean) * distance**2
    bent = np.abs(bend - mean) * distance**2 > (
        _UNEXPLAINED * explained + rounding * np.abs(here.value)
    )
    failure = np.full(steps.shape, -1)
    failure[pending] = np.select(
        [np.isnan(moved.value), other_events, other_time, unsteady & matters, bent],
        [_OVERTURNS, _IMPACT, _LIFTED, _CHANGE, _BENDS],
        -1,
    )
    return failure
