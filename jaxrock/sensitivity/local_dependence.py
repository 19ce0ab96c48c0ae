"""Local derivatives of a driven answer, where they mean something within the uncertainty."""

from dataclasses import dataclass
from typing import NamedTuple

import equinox as eqx
import numpy as np

from ..block import Block
from ..driven import Batch, check_batch, require_complete
from ..ground_motion import Harmonic, Motion, Pulse, Record
from ..host import Printed, format_table
from ..overturning import overturning_boundaries
from ..resonance import ModelLike, Nonlinear, as_model
from ..validation import POSITIVE, Number, as_real, check, check_kind
from .driven_answer import (
    AnswerName,
    AnswerOfResponse,
    DrivenAnswer,
    check_answer,
    list_motion_medians,
)
from .parameters import describe_parameter, make_parametric
from .uncertain import (
    Uncertain,
    draw_normal_numbers,
    list_medians,
    list_single_coefficients,
    map_normal_numbers,
)

# Boundaries are sought up to so many standard deviations of the logarithm away, at so many
# factors. Odd, so that the motion itself is among them, however narrow its interval is.
_RANGE = 4.0
_FACTORS = 257
# A tangent describes an answer if it explains this fraction of the variance.
_EXPLAINED = 0.8
_OMITTED = "; derivatives are not meaningful and are omitted"


@dataclass(frozen=True, repr=False)
class LocalDependence(Printed):
    """An answer, its derivatives, and whether these mean something; see `local_dependence`.

    Attributes
    ----------
    answer : str
        In words.
    names, at : tuple of str and ndarray, shape (parameters,)
        The uncertain parameters, and their medians.
    value : float
        The answer at the medians; NaN where it does not exist.
    overturned : bool
        Whether the block overturns at the medians.
    factor_low, factor_high : float
        The scale factors between which this outcome stays, all else at the medians [-]; NaN
        where there is no boundary within `factor_range`.
    factor_range : tuple of float
        Lowest and highest scale factor at which the outcome was examined [-].
    meaningful : bool
        Whether derivatives describe the answer within the uncertainty.
    derivatives, elasticities : ndarray, shape (parameters,)
        ``dy / dx``, and relative ``(x / y) dy / dx`` [-]; NaN where they are not meaningful.
    explained_variance : float
        Fraction of the variance that the tangent explains, over the samples that have an
        answer. Where even the best plane explains less than 0.8, no derivatives are computed,
        and this is the fraction that the plane explains. NaN where the answer does not vary.
    mean, standard_deviation : float
        Over all samples; NaN if one of them has no answer.
    left_out : float
        Fraction of samples without an answer.
    reason : str
        What makes derivatives meaningful or not, in words.
    """

    answer: str
    names: tuple[str, ...]
    at: np.ndarray
    value: float
    overturned: bool
    factor_low: float
    factor_high: float
    factor_range: tuple[float, float]
    meaningful: bool
    derivatives: np.ndarray
    elasticities: np.ndarray
    explained_variance: float
    mean: float
    standard_deviation: float
    left_out: float
    reason: str

    def __str__(self) -> str:
        head = f"{self.answer} {self.value:.6g}"
        if np.isnan(self.value):
            head = f"{self.answer}: none, the block {_write_outcome(self.overturned)}"
        if np.isfinite(self.mean):
            moments = f"{self.mean:.6g} +- {self.standard_deviation:.3g}"
            head += f", within the uncertainty {moments}"
        else:
            head += f"; no mean, since {100 * self.left_out:.3g} % of the samples have none"
        if self.meaningful:
            names = [describe_parameter(name) for name in self.names]
            columns = {"derivative": self.derivatives, "elasticity": self.elasticities}
            head = format_table(head, names, at=self.at, **columns)
        return f"{head}\n{self.reason}"


class _Interval(NamedTuple):
    """The scale factors around a motion at which the outcome stays.

    Attributes
    ----------
    scale : float
        The factor on the motion itself.
    low, high : float
        The ends, NaN where there is no boundary within the range.
    range : tuple of float
        The factors between which boundaries were sought.
    overturned : bool
        The outcome.
    uncertainty : float
        The largest coefficient of variation.
    """

    scale: float
    low: float
    high: float
    range: tuple[float, float]
    overturned: bool
    uncertainty: float

    @property
    def nearest(self) -> float:
        """The distance to the nearest boundary over the scale, inf if there is none."""
        ends = np.array([self.low, self.high])
        return float(np.nan_to_num(abs(ends / self.scale - 1), nan=np.inf).min())

    @property
    def narrow(self) -> bool:
        """True if a boundary is nearer than the uncertainty."""
        return self.nearest < self.uncertainty

    def __str__(self) -> str:
        block = f"the block {_write_outcome(self.overturned)}"
        if np.isnan(self.low) and np.isnan(self.high):
            low, high = self.range
            return f"{block} for all scale factors from {low:.3g} to {high:.3g}"
        uncertainty = f"than the assumed uncertainty ({100 * self.uncertainty:.3g} %)"
        compared = f"{'nearer' if self.narrow else 'further away'} {uncertainty}"
        if np.isnan(self.low):
            return f"{block} up to a scale factor of {self.high:.5g}, {compared}"
        if np.isnan(self.high):
            return f"{block} from a scale factor of {self.low:.5g} on, {compared}"
        factors = f"{block} only for scale factors {self.low:.5g} to {self.high:.5g}"
        if self.high - self.low < self.uncertainty * self.scale:
            return f"{factors}, a range narrower {uncertainty}"
        if self.narrow:
            return f"{factors}, of which one is {compared}"
        return f"{factors}, a range wider {uncertainty}"


def local_dependence(
    block: Block,
    restitution: Number,
    motion: Motion,
    uncertain: Uncertain,
    *,
    answer: AnswerName | AnswerOfResponse = "rotation_ratio",
    scale: float = 1.0,
    model: ModelLike = Nonlinear(),
) -> LocalDependence:
    """Differentiate an answer of a driven block, where derivatives mean something.

    Above the weakest motion that overturns a block there are narrow ranges of the strength in
    which it survives, and between them and below, impacts make a response a rough function of
    all parameters. A derivative is right there, and worthless for parameters that are known to
    5 %. Derivatives are given if the outcome does not change nearby, and if a tangent describes
    the answer over the whole uncertainty.

    Parameters
    ----------
    block, restitution : Block, float
        The medians.
    motion : Motion
        A pulse, a `Harmonic` or a `Record`.
    uncertain : Uncertain
        Coefficients of variation, not all 0. Beside parameters of the block and
        ``restitution`` these may be of ``scale``, a factor on the motion; of ``amplitude`` and
        ``duration`` of a pulse, ``amplitude`` and ``frequency`` of a `Harmonic`. Of all of
        them derivatives are computed.
    answer : {"rotation_ratio", "peak_rotation", "margin"} or callable
        alpha_max / alpha_c [-] or alpha_max [rad], which a block that overturns does not have,
        or the margin of `respond` [-], which is defined for all. A callable takes a block and
        its response to 10 s beyond the end of the motion, or arrays of blocks and of responses
        as from `respond_batch`, and returns the answer, NaN where it does not exist.
    scale : float
        A factor on the motion, greater than 0: the median of ``scale``.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.

    Returns
    -------
    LocalDependence

    Raises
    ------
    ValueError
        If an argument is out of range or not single, a name is not known, or an integration
        did not finish.

    See Also
    --------
    outcome_probabilities : Of the same samples, where derivatives mean nothing.

    Notes
    -----
    Derivatives are meaningful if three conditions hold. The answer exists at the medians. No
    boundary of overturning is nearer than the largest coefficient of variation: boundaries
    are sought along the factor on the motion, four standard deviations of its logarithm to
    either side, at 257 factors. And the tangent explains 80 % of the variance of the answer
    over the samples that have one.

    Examples
    --------
    >>> import jaxrock as jr
    >>> block, record = jr.Block.from_size(width=0.2, height=0.8), jr.example_record()
    >>> uncertain = jr.Uncertain({"width": 0.05, "scale": 0.05})
    >>> local = jr.sensitivity.local_dependence(block, 0.8, record, uncertain, scale=2.0)
    >>> print(local.meaningful, local.overturned)
    False False
    >>> print(local.reason.partition("; ")[0])
    the block stands only for scale factors 1.9979 to 2.0017, a range narrower than the assumed \
uncertainty (5 %)
    """
    restitution, _ = check_batch(block, restitution, motion, None)
    check_kind("motion", motion, Pulse, Harmonic, Record)
    shape = Batch.of(block, restitution, motion).shape
    if shape:
        raise ValueError(
            f"block, restitution and motion must be single ones, got arrays of shape {shape}"
        )
    check_kind("uncertain", uncertain, Uncertain)
    check("scale", as_real("scale", scale), POSITIVE)
    coefficients = list_single_coefficients(uncertain)
    uncertainty = max(coefficients.values(), default=0.0)
    if not uncertainty:
        raise ValueError("uncertain must have a coefficient greater than 0, got none")
    strength = 1.0 if "scale" in coefficients else scale
    function = DrivenAnswer(
        block, restitution, motion.scaled(strength), check_answer(answer), as_model(model)
    )
    medians = {
        name: float(value)
        for name, value in list_medians(block, restitution, coefficients).items()
    }
    medians |= list_motion_medians(motion) | {"scale": float(scale)}
    names = tuple(coefficients)
    # The samples of which `outcome_probabilities` counts the outcomes: half of its columns.
    normal = draw_normal_numbers(2 * len(names), uncertain.samples, uncertain.seed)
    samples = map_normal_numbers(normal[:, : len(names)], medians, coefficients)
    at = np.array([medians[name] for name in names])
    points = {name: np.append(samples[name], medians[name]) for name in names}
    answers = function.evaluate(points)
    value = float(answers[-1])
    answers = answers[:-1]
    interval = _find_interval(function, float(scale), strength, uncertainty)
    steps = np.stack([samples[name] for name in names]) - at[:, None]
    explained = _explain_by_plane(answers, steps)
    derivatives = np.full(at.shape, np.nan)
    differentiable = np.isfinite(value) and not interval.narrow
    # No tangent explains more than the best plane: without that nothing is compiled.
    if differentiable and explained >= _EXPLAINED:
        derivatives, explained = _compute_tangent(function, names, at, answers, steps)
    meaningful = bool(differentiable and explained >= _EXPLAINED)
    if not meaningful:
        derivatives = np.full(at.shape, np.nan)
    # An answer of 0 has no elasticity.
    with np.errstate(divide="ignore", invalid="ignore"):
        elasticities = derivatives * at / value
    return LocalDependence(
        answer=function.title,
        names=names,
        at=at,
        value=value,
        overturned=interval.overturned,
        factor_low=interval.low,
        factor_high=interval.high,
        factor_range=interval.range,
        meaningful=meaningful,
        derivatives=derivatives,
        elasticities=elasticities,
        explained_variance=explained,
        mean=float(answers.mean()),
        standard_deviation=float(answers.std()),
        left_out=float(1 - np.isfinite(answers).mean()),
        reason=_write_reason(interval, function.title, value, explained),
    )


def _find_interval(
    function: DrivenAnswer, scale: float, strength: float, uncertainty: float
) -> _Interval:
    """Find the scale factors around a motion at which the outcome stays.

    Parameters
    ----------
    function : DrivenAnswer
        With the motion by the factor `strength`, which is 1 or `scale`.
    scale, strength, uncertainty : float
    """
    width = _RANGE * float(np.log1p(uncertainty**2) ** 0.5)
    factors = np.exp(np.linspace(-width, width, _FACTORS))
    boundaries = overturning_boundaries(
        function.block,
        function.restitution,
        function.motion.scaled(scale / strength),
        "factor",
        factors,
        model=function.model,
    )
    low, high = (scale * factors[[0, -1]]).tolist()
    require_complete(boundaries.complete, scale=f"from {low:.3g} to {high:.3g}")
    places = np.asarray(boundaries.value, float)
    below = places[places <= 1]
    above = places[places > 1]
    return _Interval(
        scale=scale,
        low=scale * float(below[-1]) if below.size else np.nan,
        high=scale * float(above[0]) if above.size else np.nan,
        range=(low, high),
        # The outcome changes at each boundary below the scene.
        overturned=bool(boundaries.overturns_first) != bool(len(below) % 2),
        uncertainty=uncertainty,
    )


def _explain_by_plane(answers: np.ndarray, steps: np.ndarray) -> float:
    """Compute the fraction of the variance of answers that the best plane explains.

    Parameters
    ----------
    answers, steps : ndarray, shape (samples,), (parameters, samples)
        The answers, NaN where there is none, and the distances from the medians.

    Returns
    -------
    float
        NaN if all answers are equal, 0 if there is none.
    """
    finite = np.isfinite(answers)
    answers = answers[finite]
    if not answers.size:
        return 0.0
    # 64 units of rounding: a margin of 1 is not the same to its last digit in all samples.
    if np.ptp(answers) <= 64 * np.finfo(answers.dtype).eps * abs(answers).max():
        return np.nan
    columns = np.vstack([np.ones_like(answers), steps[:, finite]]).T
    plane = columns @ np.linalg.lstsq(columns, answers)[0]
    return _compute_explained_fraction(answers, plane)


def _compute_tangent(
    function: DrivenAnswer,
    names: tuple[str, ...],
    at: np.ndarray,
    answers: np.ndarray,
    steps: np.ndarray,
) -> tuple[np.ndarray, float]:
    """Compute the derivatives at the medians, and the fraction that the tangent explains."""
    finite = np.isfinite(answers)
    parametric = make_parametric(
        eqx.tree_at(lambda part: part.motion, function, function.motion.bucketed()),
        dict(zip(names, at.tolist(), strict=True)),
    )
    value, gradient = parametric.evaluate(np.asarray(parametric.values), 1)
    # JAX sorts the names of a dictionary.
    derivatives = gradient[[parametric.names.index(name) for name in names]]
    tangent = value + derivatives @ steps[:, finite]
    return derivatives, _compute_explained_fraction(answers[finite], tangent)


def _compute_explained_fraction(answers: np.ndarray, fitted: np.ndarray) -> float:
    """Compute the fraction of the variance of answers that fitted values explain [-]."""
    return 1 - float(((answers - fitted) ** 2).mean()) / float(answers.var())


def _write_outcome(overturned: bool) -> str:
    """Write what the block does."""
    return "overturns" if overturned else "stands"


def _write_reason(interval: _Interval, title: str, value: float, explained: float) -> str:
    """Write in words what makes derivatives meaningful or not."""
    if interval.narrow:
        return f"{interval}{_OMITTED}"
    if np.isnan(value):
        return f"{interval}; there the {title} does not exist, nor do its derivatives"
    if np.isnan(explained):
        return f"{interval}; the {title} does not vary within the uncertainty{_OMITTED}"
    variance = f"{100 * max(explained, 0.0):.3g} % of the variance of the {title}"
    if explained < _EXPLAINED:
        return f"{interval}; a tangent explains at most {variance}{_OMITTED}"
    return f"{interval}; the tangent explains {variance}"
