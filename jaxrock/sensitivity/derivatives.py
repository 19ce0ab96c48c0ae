"""Derivatives of an answer under a motion, with their errors and the ranges in which they hold."""

import math
from collections.abc import Callable, Mapping, Sequence
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
    check_batch,
    differentiate_within,
    find_slope_scale,
    simulate_batch,
)
from ..ground_motion import Harmonic, Motion, Pulse, Record, Suite
from ..host import Printed
from ..resonance import ModelLike, Nonlinear, RockingModel, Scene, as_model
from ..validation import POSITIVE, Number, Reals, as_name, as_real, check, check_concrete
from .derivative_validity import differentiate_closed_form
from .driven_answer import change_motion, name_fields
from .parameters import Parameters, describe_parameter, name_parameters

# The answers as `Batch` numbers them.
_CODES = {"peak_rotation": 0, "rotation_ratio": 1, "margin": 2}
_SYMBOLS = {
    "restitution": "C",
    "half_width": "b",
    "slenderness": "lambda",
    "critical_angle": "alpha_c",
    "frequency_parameter": "p",
    "intensity": "I",
}
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
        symbol = _SYMBOLS.get(name, name)
        columns = self.at, self.derivative, self.error, self.below, self.above
        x, slope, error, low, high = (float(column[name]) for column in columns)
        head = f"d({self.of.replace('_', ' ')})/d{symbol}"
        if math.isnan(slope):
            return f"{head} does not exist: the block overturns"
        if math.isinf(error):
            return f"{head} is not known: less accurate simulations go another way"
        digits = _count_digits(slope, error)
        limits = " to ".join(
            f"{limit:.{max(4, 1 + _count_digits(x, abs(x - limit)))}g}"
            for limit in (low, high)
        )
        text = f"{head} = {slope:.{digits}g} +- {error:.1g}, for {symbol} from {limits}"
        sides = (
            ("below", "larger", low, self.below_reason),
            ("above", "smaller", high, self.above_reason),
        )
        for side, inside, limit, column in sides:
            reason = int(column[name])
            if limit == x and reason == _LIMIT:
                text += f"; one-sided, for a {inside} {symbol}"
            elif limit == x:
                text += f"; no range {side} was confirmed: {REASONS[reason]}"
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
            certified = {k: float(np.mean(v)) for k, v in self.within_tolerance.items()}
            lines = [f"{describe_parameter(k)}: {v:.1%}" for k, v in certified.items()]
            return "\n".join(["derivatives within the tolerance, by parameter", *lines])
        head = f"{self.of.replace('_', ' ')} {float(self.value):.6g}"
        return "\n".join([head, *map(self.explain, self.derivative)])


def _count_digits(value: float, error: float) -> int:
    """Count the digits of a value that its error leaves."""
    if not (value and error and math.isfinite(error)):
        return 6
    return int(
        np.clip(1 + math.floor(math.log10(abs(value))) - math.floor(math.log10(error)), 1, 12)
    )


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
        return _differentiate_closed_form(of, scene, tolerance, by, model)
    motion = cast("Motion | Suite", motion)
    restitution, duration = check_batch(blocks, restitution, motion, duration)
    as_name("of", of, _CODES)
    scene = {name: getattr(motion, name) for name in name_fields(motion)}
    scene |= {"block": blocks, "restitution": restitution, "factor": 1.0}
    check_concrete((scene, motion, duration), "errors follow from the answers")
    names = (*_BY, "factor") if by is None else tuple(by)
    parameters = name_parameters(scene, names, "by")
    batch = _make_batch(parameters, {}, motion, duration)
    batch = replace(batch, answer=np.asarray(_CODES[of], batch.dtype))
    values = [parameters.values[parameters.names.index(name)] for name in names]
    at = np.stack([np.broadcast_to(value, batch.shape) for value in values], -1)
    # Records of many lengths share one program.
    traced = motion.bucketed() if isinstance(motion, Record) else motion
    directions = _find_directions(parameters, names, values, traced, duration)
    moved = replace(batch, directions=_drop_zeros(directions, batch.dtype))
    equation = as_model(Nonlinear() if model is None else model)
    response, answer, slopes, error = differentiate_within(moved, tolerance, equation, at)
    derivative = np.where(np.isnan(answer.value)[..., None], np.nan, slopes.value)
    scenes = _Scenes(parameters, names, motion, duration, batch, equation)
    distances, reasons = scenes.find_ranges(at, answer, slopes, response, tolerance)
    columns = at, derivative, error, at - distances[0], at + distances[1], *reasons
    return _make_derivatives(of, names, tolerance, response, answer.value, columns)


def _differentiate_closed_form(
    function: Callable[..., Reals],
    scene: Scene,
    tolerance: float,
    by: Sequence[str] | None,
    model: ModelLike | None,
) -> Derivatives:
    """Differentiate a function of scenes, all of whose numbers may be arrays."""
    shape = np.broadcast_shapes(*(np.shape(leaf) for leaf in jax.tree.leaves(scene)))
    names = (*_BY, "intensity") if by is None else tuple(by)
    parameters = name_parameters(scene, names, "by")
    listed = parameters.names
    at = np.stack([np.broadcast_to(value, shape) for value in parameters.values], -1)
    answer = eqx.Partial(function, **({} if model is None else {"model": model}))
    found = differentiate_closed_form(answer, parameters, listed, at)
    limits = found.below, found.above
    limited = [np.isinf(end) | ((end == k) & (k == 0)) for k, end in enumerate(limits)]
    reasons = [np.where(part, _EXAMINED, _OVERTURNS) for part in limited]
    kept = [listed.index(name) for name in names]
    columns = (at, found.gradient, found.error, *limits, *reasons)
    columns = [column[..., kept] for column in columns]
    name = getattr(function, "__name__", "answer")
    return _make_derivatives(name, names, tolerance, None, found.value, columns)


def _make_derivatives(
    of: str,
    names: tuple[str, ...],
    tolerance: float,
    response: EstimatedResponse | None,
    value: Any,
    columns: Sequence[np.ndarray],
) -> Derivatives:
    """Decide which derivatives are within the tolerance, and give all columns by name."""
    at, derivative, error, below, above, *reasons = columns
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.fmax(np.abs(derivative), np.abs(value[..., None] / at))
    within_tolerance = error <= tolerance * scale
    rounding = _ROUNDING * np.finfo(at.dtype).eps * np.abs(at)
    within_tolerance &= np.minimum(at - below, above - at) > rounding
    if response is not None:
        within_tolerance &= np.asarray(response.within_tolerance)[..., None]
    by_name = (
        {name: jax.device_put(column[..., k]) for k, name in enumerate(names)}
        for column in (at, derivative, error, below, above, within_tolerance, *reasons)
    )
    return Derivatives(of, jax.device_put(value), response, *by_name)


def _make_batch(
    parameters: Parameters,
    changes: Mapping[str, Reals | np.ndarray],
    motion: Motion | Suite,
    duration: Number | None,
) -> Batch:
    """Make the batch for other values of some parameters, which may be traced."""
    scene = parameters.build(changes)
    motion = change_motion(motion, scene).scaled(scene["factor"])
    return Batch.of(scene["block"], scene["restitution"], motion, duration)


@eqx.filter_jit
def _find_directions(
    parameters: Parameters,
    names: tuple[str, ...],
    values: Sequence[Any],
    motion: Motion | Suite,
    duration: Number | None,
) -> list[Batch]:
    """Find how the numbers of a batch move with each parameter."""

    def list_arguments(values: Sequence[Reals]) -> Batch:
        changes = dict(zip(names, values, strict=True))
        return _make_batch(parameters, changes, motion, duration).arguments

    def move_one(k: int) -> Batch:
        along = [jnp.full_like(value, float(j == k)) for j, value in enumerate(values)]
        return jax.jvp(list_arguments, (list(values),), (along,))[1]

    return [move_one(k) for k in range(len(names))]


def _drop_zeros(directions: Sequence[Batch], dtype: np.dtype) -> tuple[Batch, ...]:
    """Replace by None what moves with no parameter: of that nothing has to be computed."""
    moves = jax.tree.map(lambda *leaves: any(np.any(leaf) for leaf in leaves), *directions)
    return tuple(
        jax.tree.map(lambda move, leaf: np.asarray(leaf, dtype) if move else None, moves, part)
        for part in directions
    )


class _Scenes(NamedTuple):
    """Scenes of which derivatives are wanted."""

    parameters: Parameters
    names: tuple[str, ...]
    motion: Motion | Suite
    duration: Number | None
    batch: Batch
    model: RockingModel

    def find_ranges(
        self,
        at: np.ndarray,
        answer: SimulatedAnswer,
        slopes: SimulatedAnswer,
        response: EstimatedResponse,
        tolerance: float,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Find how far slopes go on below and above, and what ends them there.

        Returns
        -------
        distances, reasons : ndarray, shape (2, ..., parameters)
        """
        pairs = slopes.events.nearest, slopes.change, slopes.overturning
        rates = np.stack([[pair.below, pair.above] for pair in pairs])
        with np.errstate(divide="ignore"):
            coincidences = _NEARER / rates
        farthest = np.broadcast_to(_FARTHEST * np.abs(at), coincidences.shape[1:])
        limits = np.full_like(farthest, np.inf)
        if "restitution" in self.names:
            k = self.names.index("restitution")
            # A restitution stays between its limits 0 and 1.
            limits[..., k] = 0.9 * np.stack([c := np.abs(at[..., k]), 1 - c])
        candidates = np.stack([farthest, limits, *coincidences])
        reasons = np.argmin(candidates, axis=0)
        unknown = np.isnan(answer.value)[..., None]
        distances = candidates.min(axis=0)
        least = _ROUNDING * np.finfo(at.dtype).eps * np.abs(at)
        distances = np.where(unknown, np.nan, np.where(distances > least, distances, 0))
        bends = np.full_like(distances, np.nan)
        valid = np.zeros(distances.shape, bool)
        allowed = tolerance * find_slope_scale(answer, slopes, at)
        rtol = np.asarray(response.rtol)
        for _ in range(_ROUNDS):
            pending = ~valid & (distances > 0)
            if not pending.any():
                break
            moved = self._simulate_limits(at, distances, pending, rtol)
            failure = _check_limits(moved, answer, slopes, distances, pending, bends, allowed)
            fails = failure >= 0
            valid |= pending & ~fails
            reasons = np.where(fails & (reasons <= _LIMIT), failure, reasons)
            distances = np.where(fails, _REDUCTION * distances, distances)
        return np.where(valid | unknown, distances, 0), reasons

    def _simulate_limits(
        self, at: np.ndarray, distances: np.ndarray, pending: np.ndarray, rtol: np.ndarray
    ) -> SimulatedAnswer:
        """Simulate the limits of ranges that are pending, in the order of `np.nonzero`."""
        count = len(self.names)
        flat = at.reshape(-1, count)
        side, block, parameter = np.nonzero(pending.reshape(2, -1, count))
        distance = distances[pending]
        values = flat[block]
        values[np.arange(block.size), parameter] += np.where(side, distance, -distance)
        changes = dict(zip(self.names, values.T, strict=True))
        shape = self.batch.shape

        def take(leaf: Any) -> np.ndarray:
            return np.broadcast_to(leaf, shape).flat[block]

        numbers = [take(value) for value in self.parameters.values]
        scene = replace(self.parameters, values=numbers).build(changes)
        part = self.batch.select(block)
        motion = part.ground
        if isinstance(self.motion, Pulse | Harmonic):
            motion = change_motion(jax.tree.map(take, self.motion), scene)
        until = None if self.duration is None else part.until
        levels = np.broadcast_to(rtol, shape).flat[block]
        moved = Batch.of(scene["block"], scene["restitution"], motion, until, rtol=levels)
        moved = replace(moved.scaled(scene["factor"]), answer=part.answer)
        return cast("SimulatedAnswer", simulate_batch(moved, self.model).answer)


def _check_limits(
    moved: SimulatedAnswer,
    answer: SimulatedAnswer,
    slopes: SimulatedAnswer,
    distances: np.ndarray,
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
        return np.broadcast_to(column, distances.shape)[pending]

    distance = distances[pending]
    step = np.where(np.nonzero(pending)[0], distance, -distance)
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
    failure = np.full(distances.shape, -1)
    failure[pending] = np.select(
        [np.isnan(moved.value), other_events, other_time, unsteady & matters, bent],
        [_OVERTURNS, _IMPACT, _LIFTED, _CHANGE, _BENDS],
        -1,
    )
    return failure
