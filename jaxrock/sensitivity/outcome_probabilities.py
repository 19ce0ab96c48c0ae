"""Probabilities that a block rocks or overturns, and the parameters that decide them."""

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import jax
import numpy as np

from ..block import Block
from ..driven import Batch, follow_batch, require_complete
from ..ground_motion import Motion, Suite, average_directions
from ..host import Shown, count_work, format_table
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..tables import UNITS
from ..validation import POSITIVE, Number, as_real, check
from .distributions import compute_scores, draw_normal_numbers, map_normal_numbers
from .driven_answer import BEYOND, change_motion, gather_parameters
from .outcome_statistics import compute_derivatives, compute_interval, compute_sobol_indices
from .parameters import describe_parameter, name_parameters
from .uncertain import ARGUMENT, Uncertain, list_single_coefficients

# Derivatives of probabilities, and the changes of a parameter that they belong to.
_CHANGES = {
    "by_median": "median +1 %",
    "by_coefficient_of_variation": "coefficient of variation +0.01",
}
# Smallest number of samples with an outcome, and without it, for indices and derivatives.
_FEWEST = 20
_LARGEST_ERROR = 0.25  # of an index that is given


@dataclass(frozen=True, repr=False)
class OutcomeProbabilities(Shown):
    """Probabilities of outcomes, and what they depend on; see `outcome_probabilities`.

    Indices and derivatives smaller than their sampling noise are not printed as numbers.

    Attributes
    ----------
    outcomes : tuple of str
        ``"rocks"``, ``"exceeds ..."`` the rotation ratio, ``"overturns"``.
    probability, low, high : ndarray, shape (outcomes,)
        Fraction of all samples, and its interval.
    by_record : ndarray, shape (records, outcomes)
        Probabilities under each record; one row for a single motion.
    names : tuple of str
        The uncertain parameters.
    median, coefficient_of_variation : ndarray, shape (parameters,)
        Their medians and coefficients of variation.
    answers : tuple of str
        Answers of which there are indices: ``"peak"`` and the outcomes.
    sources : tuple of str
        Sources of variance that have an index: the parameters, and under a suite
        ``"record"``.
    first, total, first_error, total_error : ndarray, shape (answers, sources)
        Sobol indices [-], first-order and total, and their standard errors; NaN if the answer
        is constant, or if fewer than 20 samples have, or lack, the outcome.
    by_median, by_coefficient_of_variation : ndarray, shape (outcomes, parameters)
        Derivatives of the probability with respect to the logarithm of the median, and to the
        coefficient of variation [-]; NaN where the indices are NaN.
    by_median_error, by_coefficient_of_variation_error : ndarray, shape (outcomes, parameters)
        Their standard errors.
    inputs : dict of ndarray, shape (samples,)
        Samples of the uncertain parameters, by name.
    peak : ndarray, shape (records, samples)
        Highest rotation over the critical angle, at most 1, and 1 where the block overturns.
    confidence : float
        Confidence level of the intervals.
    directions : int
        2 if the suite has each record in both directions, which count as one record.
    """

    outcomes: tuple[str, ...]
    probability: np.ndarray
    low: np.ndarray
    high: np.ndarray
    by_record: np.ndarray
    names: tuple[str, ...]
    median: np.ndarray
    coefficient_of_variation: np.ndarray
    answers: tuple[str, ...]
    sources: tuple[str, ...]
    first: np.ndarray
    total: np.ndarray
    first_error: np.ndarray
    total_error: np.ndarray
    by_median: np.ndarray
    by_median_error: np.ndarray
    by_coefficient_of_variation: np.ndarray
    by_coefficient_of_variation_error: np.ndarray
    inputs: dict[str, np.ndarray]
    peak: np.ndarray
    confidence: float
    directions: int = 1

    picture: ClassVar[str] = "plot_outcome_probabilities"

    def table(self) -> dict[str, list[Any]]:
        """List the outcomes with their probabilities.

        Returns
        -------
        dict of list
        """
        columns = {
            name: getattr(self, name).tolist() for name in ("probability", "low", "high")
        }
        return {"outcome": list(self.outcomes), **columns}

    def table_of_sources(self) -> dict[str, list[Any]]:
        """List Sobol indices and derivatives of probabilities, a row for each source.

        Returns
        -------
        dict of list
            NaN where an answer is constant, and for derivatives that noise hides.
        """
        units = [UNITS.get(name, "-") for name in self.sources]
        columns: dict[str, list[Any]] = {"quantity": list(self.sources), "unit": units}
        for kinds, answers in ((("first", "total"), self.answers), (_CHANGES, self.outcomes)):
            for (k, answer), kind in itertools.product(enumerate(answers), kinds):
                values, errors = self._get_pairs(kind, k)
                if kind in _CHANGES:
                    values = np.where(errors < abs(values), values, np.nan)
                head = f"{kind}_{answer.replace(' ', '_')}"
                columns |= {head: values.tolist(), f"{head}_error": errors.tolist()}
        return columns

    def __str__(self) -> str:
        records, samples = self.peak.shape
        ways = " in both directions" * (self.directions == 2)
        under = f"{records // self.directions} records{ways}, each with " * (records > 1)
        lines = [
            f"{under}{samples} samples, intervals with a confidence of {self.confidence:g}"
        ]
        for k, outcome in enumerate(self.outcomes):
            interval = f"{self.low[k]:.4f} to {self.high[k]:.4f}"
            lines.append(f"{outcome:20}{self.probability[k]:10.4f}   {interval}")
        for k, answer in enumerate(self.answers):
            if np.isfinite(self.first[k]).all():
                lines += ["", self._write_table(k)]
            elif k and 0 < self.probability[k - 1] < 1:
                lines += ["", f"{answer}: too few samples differ for indices and derivatives"]
        return "\n".join(lines)

    def _get_pairs(self, kind: str, k: int) -> np.ndarray:
        """Return values and errors of all sources, NaN for the record if it has none."""
        pairs = np.array([getattr(self, kind)[k], getattr(self, f"{kind}_error")[k]])
        padding = len(self.sources) - pairs.shape[1]
        return np.pad(pairs, ((0, 0), (0, padding)), constant_values=np.nan)

    def _write_table(self, k: int) -> str:
        """Write a table of an answer that varies: indices, derivatives of a probability."""
        columns = {
            "first order": [*map(describe_index, *self._get_pairs("first", k))],
            "total": [*map(describe_index, *self._get_pairs("total", k))],
        }
        for kind, head in _CHANGES.items() if k else ():
            columns[head] = [*map(_write_change, *self._get_pairs(kind, k - 1))]
        return format_table(
            self.answers[k], [*map(describe_parameter, self.sources)], **columns
        )


def is_index_known(value: float, error: float) -> bool:
    """Return whether an estimated Sobol index with this standard error is clear of noise.

    An index lies between 0 and 1: with an error of a quarter it may be almost anything.
    """
    return bool(2 * error <= value and error < _LARGEST_ERROR)


def describe_index(value: float, error: float) -> str:
    """Write an index with its standard error; a bound, or nothing, where noise hides it."""
    if not error < _LARGEST_ERROR:
        return "within noise"
    if not is_index_known(value, error):
        return f"below {math.ceil(100 * (max(value, 0.0) + 2 * error)) / 100:.2f}"
    return f"{value:.2f} +- {error:.2f}" if error else f"{value:.2f}"


def _write_change(value: float, error: float) -> str:
    """Write the change of a probability for a hundredth more; nothing if noise hides it."""
    if not error < abs(value):
        return "" if math.isnan(error) else "within noise"
    return f"{0.01 * value:+.4f} +- {0.01 * error:.4f}"


def outcome_probabilities(
    block: Block,
    restitution: Number,
    motion: Motion | Suite,
    uncertain: Uncertain,
    *,
    ratio: float = 0.5,
    confidence: float = 0.95,
    model: ModelLike = Nonlinear(),
) -> OutcomeProbabilities:
    """Compute the probabilities that a block with uncertain parameters rocks and overturns.

    Under a record, a response is not a smooth function of its parameters: above the weakest
    motion that overturns a block there are windows in which it survives, and derivatives say
    little about larger changes. Probabilities are smooth where the response is not.

    Parameters
    ----------
    block, restitution : Block, float
        The medians.
    motion : Motion or Suite
        With a suite, probabilities are averaged over samples and records. Confidence
        intervals treat the records as the independent units, not the samples.
    uncertain : Uncertain
        Names may be parameters of the block (see `Uncertain`) and ``restitution``; ``factor``,
        a factor on the motion with the median 1; ``amplitude`` and ``duration`` of a pulse;
        ``amplitude`` and ``frequency`` of a `Harmonic`. At least one is needed, each with one
        coefficient of variation greater than 0, without correlations. Under one motion 4,096
        samples give indices to a few hundredths; with the default of 64 only probabilities
        are accurate enough. The Sobol indices of n parameters need n + 1 times as many further
        responses.
    ratio : float
        Rotation ratio alpha_max / alpha_c [-] of the second outcome, greater than 0. A block
        that overturns exceeds it.
    confidence : float
        Confidence level of the intervals, between 0 and 1.
    model : Nonlinear or Linearized, or their names
        Equation of motion; see `respond`.

    Returns
    -------
    OutcomeProbabilities
        The Sobol indices are those of the outcomes, 0 or 1, and of ``"peak"``: the highest
        rotation over the critical angle, at most 1, and 1 where the block overturns.

    Raises
    ------
    ValueError
        If an argument is out of range, a name is unknown, parameters are correlated, or an
        integration did not finish.

    Notes
    -----
    All results use the same sample: scrambled Sobol points, simulated in one batch up to 10 s
    beyond the end of the motion. Derivatives of probabilities with respect to medians and
    coefficients of variation are means of the outcome times the derivative of the log-density
    (score function), so that no response is differentiated.

    Examples
    --------
    >>> import jaxrock as jr
    >>> record, block = jr.example_record().scaled(2.0), jr.Block.from_size(width=0.2, height=0.8)
    >>> coefficients = {"width": 0.02, "restitution": 0.05, "factor": 0.1}
    >>> uncertain = jr.Uncertain(coefficients, samples=4096)
    >>> result = jr.sensitivity.outcome_probabilities(block, 0.8, record, uncertain)
    >>> print(result.outcomes[2], f"{result.probability[2]:.2f}")
    overturns 0.54
    """
    check("ratio", as_real("ratio", ratio), POSITIVE)
    if not 0 < confidence < 1:
        raise ValueError(f"confidence must be between 0 and 1, got {confidence!r:.60}")
    variations = list_single_coefficients(uncertain)
    check(ARGUMENT, variations, POSITIVE)
    names = uncertain.names
    if not names or uncertain.correlated_pairs:
        raise ValueError(
            "uncertain must name at least one parameter and have no correlations, got"
            f" {len(names)} and {len(uncertain.correlated_pairs)} of them: Sobol indices are those"
            " of independent parameters"
        )
    point = gather_parameters(block, restitution, motion)
    parameters = name_parameters(point, names, ARGUMENT)
    values = parameters.get_values(names)
    samples = uncertain.samples
    normal = _draw_mixed_samples(len(names), samples, uncertain.seed)
    drawn = dict(
        zip(names, map_normal_numbers(names, normal, values, variations).T, strict=True)
    )
    with count_work(
        "samples", len(normal) * (len(motion) if isinstance(motion, Suite) else 1)
    ):
        answers = _simulate_samples(parameters.build(drawn), motion, as_model(model), ratio)
    answers = np.moveaxis(answers.reshape(*answers.shape[:2], -1, samples), 2, 0)
    outcomes = answers[0, 1:]
    # Errors estimated from a few samples are meaningless. The peak always has many values.
    happens = outcomes.sum(axis=(1, 2))
    clear = np.minimum(happens, outcomes[0].size - happens) >= _FEWEST
    blank = np.where(clear, 1.0, np.nan)[:, None]
    indices = compute_sobol_indices(answers[0], answers[1], answers[2:])
    blanks = np.concatenate([[[1.0]], blank])
    statistics = {name: part * blanks for name, part in indices._asdict().items()}
    # Both directions of a record count as one record, by their mean.
    directions = motion.directions if isinstance(motion, Suite) else 1
    recordings = [np.asarray(average_directions(part, directions)) for part in outcomes]
    inputs = {name: part[:samples] for name, part in drawn.items()}
    scores = [*map(compute_scores, names, inputs.values(), values, variations)]
    for kind, score in zip(_CHANGES, zip(*scores, strict=True), strict=True):
        columns = np.stack(score, axis=1)
        pairs = np.stack([compute_derivatives(outcome, columns) for outcome in recordings], 1)
        statistics[kind], statistics[f"{kind}_error"] = pairs * blank
    record_probabilities = outcomes.mean(axis=2).T
    intervals = [
        compute_interval(outcome.mean(axis=1), samples, confidence) for outcome in recordings
    ]
    low, high = np.array(intervals).T
    labels = ("rocks", f"exceeds {float(ratio):g}", "overturns")
    return OutcomeProbabilities(
        outcomes=labels,
        probability=record_probabilities.mean(axis=0),
        low=low,
        high=high,
        by_record=record_probabilities,
        names=names,
        median=values,
        coefficient_of_variation=variations,
        answers=("peak", *labels),
        sources=(*names, "record") if len(record_probabilities) > 1 else names,
        inputs=inputs,
        peak=answers[0, 0],
        confidence=float(confidence),
        directions=directions,
        **statistics,
    )


def _draw_mixed_samples(count: int, samples: int, seed: int) -> np.ndarray:
    """Draw two samples of normal numbers, then the first with a column from the second."""
    first, second = np.split(draw_normal_numbers(2 * count, samples, seed), 2, axis=1)
    mixed = np.repeat(first[None], count, axis=0)
    which = np.arange(count)
    mixed[which, :, which] = second.T
    return np.concatenate([first, second, *mixed])


def _simulate_samples(
    point: Mapping[str, Any], motion: Motion | Suite, model: RockingModel, ratio: float
) -> np.ndarray:
    """Simulate all samples; peak and outcomes, shape (answers, records, samples)."""
    # Samples are drawn in float64, and simulated in the precision of JAX.
    blocks = jax.device_put(point["block"])
    critical_angle = np.asarray(blocks.critical_angle)
    restitution, factor = (as_real(name, point[name]) for name in ("restitution", "factor"))
    answers = []
    # Records are simulated one by one: the samples fill the queue, and all records together
    # need not fit into memory.
    for part in list(motion) if isinstance(motion, Suite) else [change_motion(motion, point)]:
        batch = Batch.of(blocks, restitution, part).scaled(np.asarray(factor))
        response = follow_batch(replace(batch, until=batch.until + BEYOND), model)
        require_complete(response.complete, sample=None)
        rotation = np.asarray(response.peak_rotation) / critical_angle
        overturned = np.asarray(response.overturned)
        rows = [
            np.where(overturned, 1.0, np.minimum(rotation, 1.0)),
            rotation > 0,
            overturned | (rotation > ratio),
            overturned,
        ]
        answers.append(np.stack([row.astype(float) for row in rows]))
    return np.stack(answers, axis=1)
