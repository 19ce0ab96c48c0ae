"""Local derivatives of a driven answer, where they mean something within the uncertainty."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import numpy as np

from ..block import Block
from ..driven import require_complete
from ..ground_motion import Harmonic, Motion, Pulse, Record
from ..host import Printed, format_table
from ..overturning import overturning_boundaries
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import Number, check_kind
from .distributions import draw_normal_numbers, map_normal_numbers
from .driven_answer import (
    ANSWERS,
    DrivenAnswer,
    gather_parameters,
)
from .parameters import describe_parameter, evaluate_answer, name_parameters
from .uncertain import ARGUMENT, Uncertain, list_single_coefficients

# A tangent describes an answer if it explains this fraction of the variance.
_EXPLAINED = 0.8
# Boundaries are sought up to so many standard deviations of the logarithm away, at so many
# factors. Odd, so that the motion itself is among them, however narrow its interval is.
_RANGE = 4.0
_FACTORS = 257


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
        their medians [-]; NaN where there is no boundary within four standard deviations.
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
        columns = [self.names, self.at, self.derivatives, self.elasticities]
        heads = ("quantity", "value", "derivative", "elasticity")
        return {head: [*column] for head, column in zip(heads, columns, strict=True)}

    def __str__(self) -> str:
        moments = f"{self.mean:.6g} +- {self.standard_deviation:.3g}"
        if self.left_out:
            moments = f"no mean, since {100 * self.left_out:.3g} % of the samples have none"
        head = f"{self.answer} {self.value:.6g}, within the uncertainty {moments}"
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
    answer: str = "rotation_ratio",
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
    answer : {"rotation_ratio", "peak_rotation", "margin"}
        alpha_max / alpha_c [-] or alpha_max [rad], which do not exist for a block that
        overturns; or the margin of `respond` [-], which always exists.
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
    the block stands for scale factors 1.9979 to 2.0017, nearer than the uncertainty (5 %)
    """
    check_kind("motion", motion, Pulse, Harmonic, Record)
    scene = gather_parameters(block, restitution, motion, scale)
    variations = list_single_coefficients(uncertain)
    if not variations.any():
        raise ValueError("uncertain must have a coefficient greater than 0, got none")
    function = DrivenAnswer(motion, answer, as_model(model))
    names = uncertain.names
    parameters = name_parameters(scene, names, ARGUMENT)
    at = parameters.get_values(names)
    # The samples of which `outcome_probabilities` counts the outcomes: half of its columns.
    normal = draw_normal_numbers(2 * len(names), uncertain.samples, uncertain.seed)
    normal = uncertain.correlate(normal[:, : len(names)])
    samples = map_normal_numbers(names, normal, at, variations)
    # With the parameters themselves as the last sample: one batch.
    points = np.vstack([samples, at]).T
    answers = function.evaluate(parameters.build(dict(zip(names, points, strict=True))))
    answers = np.where(np.isfinite(answers), answers, np.nan)
    value = float(answers[-1])
    answers = answers[:-1]
    steps = (samples - at).T
    uncertainty = float(variations.max())
    low, high, overturned, reason = _find_interval(scene, motion, uncertainty, function.model)
    is_near = scale - low < uncertainty * scale or high - scale < uncertainty * scale
    if is_near:
        reason += f", nearer than the uncertainty ({100 * uncertainty:.3g} %)"
    tangent, explained = _fit_plane(answers, steps)
    # No tangent explains more than the best plane: without that nothing is compiled.
    meaningful = not is_near and bool(np.isfinite(value)) and explained >= _EXPLAINED
    if meaningful:
        bucketed = eqx.tree_at(lambda part: part.motion, function, motion.bucketed())
        _, tangent = evaluate_answer(bucketed, parameters, names, at, 1)
        explained = _explain_variance(answers, value + tangent @ steps)
        meaningful = explained >= _EXPLAINED
    derivatives = np.where(meaningful, tangent, np.nan)
    # An answer of 0 has no elasticity.
    with np.errstate(divide="ignore", invalid="ignore"):
        elasticities = derivatives * at / value
    if np.isfinite(explained):
        percent = 100 * max(explained, 0.0)
        reason += f"; a linear function explains {percent:.3g} % of the variance"
    return LocalDependence(
        answer=ANSWERS[function.answer],
        names=names,
        at=at,
        value=value,
        overturned=overturned,
        factor_low=low,
        factor_high=high,
        meaningful=meaningful,
        derivatives=derivatives,
        elasticities=elasticities,
        explained_variance=explained,
        mean=float(answers.mean()),
        standard_deviation=float(answers.std()),
        left_out=float(1 - np.isfinite(answers).mean()),
        reason=reason + "; derivatives are not meaningful and are omitted" * (not meaningful),
    )


def _find_interval(
    scene: Mapping[str, Any], motion: Motion, uncertainty: float, model: RockingModel
) -> tuple[float, float, bool, str]:
    """Find the scale factors between which the outcome stays, the outcome, and both in words.

    An end is NaN where there is no boundary within the range.
    """
    scale = scene["scale"]
    width = _RANGE * np.log1p(uncertainty**2) ** 0.5
    factors = scale * np.exp(np.linspace(-width, width, _FACTORS))
    boundaries = overturning_boundaries(
        scene["block"], scene["restitution"], motion, "factor", factors, model=model
    )
    require_complete(boundaries.complete)
    places = np.asarray(boundaries.value, float)
    low = float(max(places[places <= scale], default=np.nan))
    high = float(min(places[places > scale], default=np.nan))
    # The outcome changes at each boundary below the scale.
    overturned = bool(boundaries.overturns_first) != bool((places <= scale).sum() % 2)
    outcome = "overturns" if overturned else "stands"
    first = f"below {factors[0]:.3g}" if np.isnan(low) else f"{low:.5g}"
    last = f"above {factors[-1]:.3g}" if np.isnan(high) else f"{high:.5g}"
    return low, high, overturned, f"the block {outcome} for scale factors {first} to {last}"


def _fit_plane(answers: np.ndarray, steps: np.ndarray) -> tuple[np.ndarray, float]:
    """Fit a plane to answers; return its slopes, and the fraction of the variance it explains.

    The fraction is NaN if all answers are equal, or there is none.
    """
    finite = np.isfinite(answers)
    known = answers[finite]
    # 64 units of rounding: a margin of 1 is not the same to its last digit in all samples.
    rounding = 64 * np.finfo(answers.dtype).eps
    if not known.size or np.ptp(known) <= rounding * abs(known).max():
        return np.zeros(len(steps)), np.nan
    columns = np.vstack([np.ones(known.size), steps[:, finite]]).T
    plane = np.linalg.lstsq(columns, known)[0]
    return plane[1:], _explain_variance(known, columns @ plane)


def _explain_variance(answers: np.ndarray, fitted: np.ndarray) -> float:
    """Compute the fraction of the variance of answers that fitted values explain [-]."""
    return 1 - float(np.nanmean((answers - fitted) ** 2) / np.nanvar(answers))
