"""Local derivatives of a driven answer, where they mean something within the uncertainty."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np

from ..block import Block
from ..driven import Batch, check_batch
from ..ground_motion import Harmonic, Motion, Pulse, Record
from ..host import Printed, format_table
from ..resonance import ModelLike, Nonlinear, as_model
from ..validation import POSITIVE, Number, as_real, check, check_kind
from .driven_answer import (
    AnswerOfResponse,
    DrivenAnswer,
    DrivenAnswerName,
    check_answer,
    list_motion_medians,
)
from .outcome_interval import OutcomeInterval, find_outcome_interval, write_outcome
from .parameters import describe_parameter, make_parametric
from .samples import (
    draw_normal_numbers,
    list_medians,
    map_normal_numbers,
)
from .uncertain import Uncertain, list_single_coefficients

# A tangent describes an answer if it explains this fraction of the variance.
_EXPLAINED = 0.8
_OMITTED = "; derivatives are not meaningful and are omitted"


@dataclass(frozen=True, repr=False)
class LocalDependence(Printed):
    """An answer, its derivatives, and whether these are meaningful; see `local_dependence`.

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
        Scale factors between which the outcome is the same, with all other parameters at
        their medians [-]; NaN where there is no boundary within `factor_range`.
    factor_range : tuple of float
        Lowest and highest scale factor at which the outcome was examined [-].
    meaningful : bool
        Whether derivatives describe the answer within the uncertainty.
    derivatives, elasticities : ndarray, shape (parameters,)
        ``dy / dx``, and relative ``(x / y) dy / dx`` [-]; NaN where they are not meaningful.
    explained_variance : float
        Fraction of the variance that the tangent explains, over the samples that have an
        answer. Where even the best plane explains less than 0.8, no derivatives are computed,
        and this is the fraction for that plane. NaN where the answer does not vary.
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

    def table(self) -> dict[str, list[Any]]:
        """List medians, derivatives and elasticities, a row for each parameter.

        Returns
        -------
        dict of list
        """
        columns = {"value": self.at, "derivative": self.derivatives}
        columns["elasticity"] = self.elasticities
        return {"quantity": list(self.names), **{n: v.tolist() for n, v in columns.items()}}

    def __str__(self) -> str:
        head = f"{self.answer} {self.value:.6g}"
        if np.isnan(self.value):
            head = f"{self.answer}: no value, the block {write_outcome(self.overturned)}"
        if self.standard_deviation == 0:
            head += ", in all samples as well"
        elif np.isfinite(self.mean):
            moments = f"{self.mean:.6g} +- {self.standard_deviation:.3g}"
            head += f", within the uncertainty {moments}"
        else:
            head += f"; no mean, since {100 * self.left_out:.3g} % of the samples have none"
        if self.meaningful:
            names = [describe_parameter(name) for name in self.names]
            columns = {"derivative": self.derivatives, "elasticity": self.elasticities}
            head = format_table(head, names, at=self.at, **columns)
        return f"{head}\n{self.reason}"


def local_dependence(
    block: Block,
    restitution: Number,
    motion: Motion,
    uncertain: Uncertain,
    *,
    answer: DrivenAnswerName | AnswerOfResponse = "rotation_ratio",
    scale: float = 1.0,
    model: ModelLike = Nonlinear(),
) -> LocalDependence:
    """Differentiate an answer of a driven block, where derivatives are meaningful.

    Above the weakest motion that overturns a block there are narrow ranges of scale factors
    in which it survives, and impacts make its response irregular elsewhere too. A derivative
    is exact there, but useless for parameters that are known to within 5 % only.
    So derivatives are given
    only if the outcome does not change nearby, and if a tangent describes the answer within
    the uncertainty.

    Parameters
    ----------
    block, restitution : Block, float
        The medians.
    motion : Motion
        A pulse, a `Harmonic` or a `Record`.
    uncertain : Uncertain
        Coefficients of variation, not all 0. Besides parameters of the block and
        ``restitution``, names may be ``scale``, a factor on the motion; ``amplitude`` and
        ``duration`` of a pulse; ``amplitude`` and ``frequency`` of a `Harmonic`. Derivatives
        are computed with respect to all of them.
    answer : {"rotation_ratio", "peak_rotation", "margin"} or callable
        alpha_max / alpha_c [-] or alpha_max [rad], which do not exist for a block that
        overturns; or the margin of `respond` [-], which always exists. A callable takes a
        block and its response up to 10 s beyond the end of the motion, or arrays of blocks
        and of responses as from `respond_batch`. It returns the answer, NaN where it does not
        exist.
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
    outcome_probabilities : Use it on the same samples where derivatives are not meaningful.

    Notes
    -----
    Derivatives are meaningful if three conditions hold. First, the answer exists at the
    medians. Second, no boundary of overturning is nearer than the largest coefficient of
    variation. Boundaries are sought along the factor on the motion, at 257 factors, up to
    four standard deviations of its logarithm to either side. Two boundaries between
    neighbouring factors are not detected, so that the range without a boundary may be narrower
    than it seems.
    Third, the tangent explains 80 % of the variance of the answer over the samples that have
    an answer.

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
    coefficients = _check_question(block, restitution, motion, uncertain, scale)
    names = tuple(coefficients)
    function = DrivenAnswer(
        block, restitution, motion, check_answer(answer), as_model(model), scale
    )
    medians = {
        name: float(value) for name, value in list_medians(block, restitution, names).items()
    }
    medians |= list_motion_medians(motion) | {"scale": float(scale)}
    sample = _sample_answers(function, medians, coefficients, uncertain)
    interval = find_outcome_interval(
        block,
        restitution,
        motion,
        scale=float(scale),
        uncertainty=max(coefficients.values()),
        model=model,
    )
    derivatives, explained = _differentiate(function, interval, sample)
    missing = np.full(len(names), np.nan)
    elasticities = missing
    if derivatives is not None:
        # An answer of 0 has no elasticity.
        with np.errstate(divide="ignore", invalid="ignore"):
            elasticities = derivatives * sample.at / sample.value
    return LocalDependence(
        answer=function.title,
        names=names,
        at=sample.at,
        value=sample.value,
        overturned=interval.overturned,
        factor_low=interval.low,
        factor_high=interval.high,
        factor_range=interval.range,
        meaningful=derivatives is not None,
        derivatives=missing if derivatives is None else derivatives,
        elasticities=elasticities,
        explained_variance=explained,
        mean=float(sample.answers.mean()),
        standard_deviation=float(sample.answers.std()),
        left_out=float(1 - np.isfinite(sample.answers).mean()),
        reason=_write_reason(interval, function.title, sample.value, explained),
    )


def _check_question(
    block: Block, restitution: Number, motion: Motion, uncertain: Uncertain, scale: float
) -> dict[str, float]:
    """Check the arguments; a `ValueError` if one is not allowed. Return the coefficients."""
    restitution, _ = check_batch(block, restitution, motion, None)
    check_kind("motion", motion, Pulse, Harmonic, Record)
    shape = Batch.of(block, restitution, motion).shape
    if shape:
        raise ValueError(
            f"block, restitution and motion must be single, got arrays of shape {shape}"
        )
    check_kind("uncertain", uncertain, Uncertain)
    check("scale", as_real("scale", scale, unit=""), POSITIVE)
    coefficients = list_single_coefficients(uncertain)
    if not any(coefficients.values()):
        raise ValueError("uncertain must have a coefficient greater than 0, got none")
    return coefficients


class _AnswerSample(NamedTuple):
    """An answer at the medians of the uncertain parameters, and at samples of them.

    Attributes
    ----------
    names, at : tuple of str, ndarray, shape (parameters,)
        The parameters, and their medians.
    steps : ndarray, shape (parameters, samples)
        The distances of the samples from the medians.
    value : float
        The answer at the medians.
    answers : ndarray, shape (samples,)
        Those of the samples, NaN where there is none.
    """

    names: tuple[str, ...]
    at: np.ndarray
    steps: np.ndarray
    value: float
    answers: np.ndarray


def _sample_answers(
    function: DrivenAnswer,
    medians: Mapping[str, float],
    coefficients: Mapping[str, float],
    uncertain: Uncertain,
) -> _AnswerSample:
    """Draw samples of the uncertain parameters, and compute the answer at all of them."""
    names = tuple(coefficients)
    # The samples of which `outcome_probabilities` counts the outcomes: half of its columns.
    normal = draw_normal_numbers(2 * len(names), uncertain.samples, uncertain.seed)
    correlated = uncertain.correlate(normal[:, : len(names)])
    drawn = map_normal_numbers(correlated, medians, coefficients)
    # With the medians as the last sample: one batch.
    points = {name: np.append(drawn[name], medians[name]) for name in names}
    answers = function.evaluate(points)
    answers = np.where(np.isfinite(answers), answers, np.nan)
    at = np.array([medians[name] for name in names])
    steps = np.stack([drawn[name] for name in names]) - at[:, None]
    return _AnswerSample(names, at, steps, float(answers[-1]), answers[:-1])


def _differentiate(
    function: DrivenAnswer, interval: OutcomeInterval, sample: _AnswerSample
) -> tuple[np.ndarray | None, float]:
    """Compute derivatives at the medians, and the fraction of the variance they explain.

    Returns
    -------
    derivatives : ndarray, shape (parameters,)
        None where they are not meaningful.
    explained : float
        NaN if all answers are equal, 0 if there is none.
    """
    finite = np.isfinite(sample.answers)
    answers = sample.answers[finite]
    steps = sample.steps[:, finite]
    if not answers.size:
        return None, 0.0
    # 64 units of rounding: a margin of 1 is not the same to its last digit in all samples.
    if np.ptp(answers) <= 64 * np.finfo(answers.dtype).eps * abs(answers).max():
        return None, np.nan
    columns = np.vstack([np.ones_like(answers), steps]).T
    plane = columns @ np.linalg.lstsq(columns, answers)[0]
    explained = _compute_explained_fraction(answers, plane)
    # No tangent explains more than the best plane: without that nothing is compiled.
    if interval.has_near_boundary or not np.isfinite(sample.value) or explained < _EXPLAINED:
        return None, explained
    parametric = make_parametric(
        eqx.tree_at(lambda part: part.motion, function, function.motion.bucketed()),
        dict(zip(sample.names, sample.at.tolist(), strict=True)),
    )
    value, gradient = parametric.evaluate(np.asarray(parametric.values), 1)
    # JAX sorts the names of a dictionary.
    derivatives = gradient[[parametric.names.index(name) for name in sample.names]]
    explained = _compute_explained_fraction(answers, value + derivatives @ steps)
    return derivatives if explained >= _EXPLAINED else None, explained


def _compute_explained_fraction(answers: np.ndarray, fitted: np.ndarray) -> float:
    """Compute the fraction of the variance of answers that fitted values explain [-]."""
    return 1 - float(((answers - fitted) ** 2).mean()) / float(answers.var())


def _write_reason(
    interval: OutcomeInterval, title: str, value: float, explained: float
) -> str:
    """Write in words what makes derivatives meaningful or not."""
    if interval.has_near_boundary:
        return f"{interval}{_OMITTED}"
    if not np.isfinite(value):
        return f"{interval}; there the {title} does not exist, nor do its derivatives"
    if np.isnan(explained):
        return f"{interval}; the {title} does not vary within the uncertainty{_OMITTED}"
    variance = f"{100 * max(explained, 0.0):.3g} % of the variance of the {title}"
    if explained < _EXPLAINED:
        return f"{interval}; a tangent explains at most {variance}{_OMITTED}"
    return f"{interval}; the tangent explains {variance}"
