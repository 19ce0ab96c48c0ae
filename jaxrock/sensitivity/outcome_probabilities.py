"""Probabilities that a block rocks or overturns, and the parameters that decide them."""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..block import Block
from ..ground_motion import Motion, Suite, average_directions
from ..host import Shown, count_work, format_table
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..tables import UNITS
from ..validation import POSITIVE, Number, as_real, check
from .distributions import compute_scores, draw_normal_numbers, map_normal_numbers
from .driven_scenes import gather_scene, simulate_scenes
from .outcome_statistics import compute_derivatives, compute_interval, compute_sobol_indices
from .parameters import describe_parameter, name_parameters
from .uncertain import ARGUMENT, Uncertain, list_single_coefficients

# What is known of each answer and source, with a standard error.
_KINDS = ("first", "total", "by_median")
# Smallest number of samples with an outcome, and without it, for indices and derivatives.
_FEWEST = 20


@dataclass(frozen=True, repr=False)
class OutcomeProbabilities(Shown):
    """Probabilities of outcomes, and what they depend on; see `outcome_probabilities`.

    Attributes
    ----------
    outcomes : tuple of str
        ``"rocks"``, ``"exceeds ..."`` the rotation ratio, ``"overturns"``.
    probability, low, high : ndarray, shape (outcomes,)
        Fraction of all samples, and its 95 % interval.
    by_record : ndarray, shape (records, outcomes)
        Probabilities under each record; one row for a single motion.
    answers : tuple of str
        Answers of which there are indices: ``"peak"`` and the outcomes.
    sources : tuple of str
        Sources of variance that have an index: the parameters, and under a suite
        ``"record"``.
    first, total, first_error, total_error : ndarray, shape (answers, sources)
        Sobol indices [-], first-order and total, and their standard errors; NaN if the answer
        is constant, or if fewer than 20 samples have, or lack, the outcome.
    by_median, by_median_error : ndarray, shape (answers, sources)
        Derivatives of the mean of the answer, which of an outcome is its probability, with
        respect to the logarithm of the median [-], and their standard errors; NaN where the
        indices are NaN, and for the record.
    inputs : dict of ndarray, shape (samples,)
        Samples of the uncertain parameters, by name.
    peak : ndarray, shape (records, samples)
        Highest rotation over the critical angle, at most 1, and 1 where the block overturns.
    """

    outcomes: tuple[str, ...]
    probability: np.ndarray
    low: np.ndarray
    high: np.ndarray
    by_record: np.ndarray
    answers: tuple[str, ...]
    sources: tuple[str, ...]
    first: np.ndarray
    total: np.ndarray
    first_error: np.ndarray
    total_error: np.ndarray
    by_median: np.ndarray
    by_median_error: np.ndarray
    inputs: dict[str, np.ndarray]
    peak: np.ndarray

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
            NaN where an answer is constant.
        """
        units = [UNITS.get(name, "-") for name in self.sources]
        columns: dict[str, list[Any]] = {"quantity": list(self.sources), "unit": units}
        for (k, answer), kind in itertools.product(enumerate(self.answers), _KINDS):
            head = f"{kind}_{answer.replace(' ', '_')}"
            columns[head] = getattr(self, kind)[k].tolist()
            columns[f"{head}_error"] = getattr(self, f"{kind}_error")[k].tolist()
        return columns

    def __str__(self) -> str:
        records, samples = self.peak.shape
        under = f"{records} records, each with " * (records > 1)
        lines = [f"{under}{samples} samples, with 95 % intervals"]
        for k, outcome in enumerate(self.outcomes):
            interval = f"{self.low[k]:.4f} to {self.high[k]:.4f}"
            lines.append(f"{outcome:20}{self.probability[k]:10.4f}   {interval}")
        names = [*map(describe_parameter, self.sources)]
        for k, answer in enumerate(self.answers):
            if np.isfinite(self.first[k]).all():
                pairs = [(getattr(self, n)[k], getattr(self, f"{n}_error")[k]) for n in _KINDS]
                texts = [map("{:.3f} +- {:.3f}".format, *pair) for pair in pairs]
                columns = dict(zip(("first_order", *_KINDS[1:]), texts, strict=True))
                lines += ["", format_table(answer, names, **columns)]
        return "\n".join(lines)


def outcome_probabilities(
    block: Block,
    restitution: Number,
    motion: Motion | Suite,
    uncertain: Uncertain,
    *,
    ratio: float = 0.5,
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
    variations = list_single_coefficients(uncertain)
    check(ARGUMENT, variations, POSITIVE)
    names = uncertain.names
    if not names or uncertain.correlations:
        raise ValueError(
            "uncertain must name at least one parameter and have no correlations, got"
            f" {len(names)} and {len(uncertain.correlations)} of them: Sobol indices are those"
            " of independent parameters"
        )
    scene, _ = gather_scene(block, restitution, motion)
    parameters = name_parameters(scene, names, ARGUMENT)
    values = parameters.get_values(names)
    samples = uncertain.samples
    normal = _draw_mixed_samples(len(names), samples, uncertain.seed)
    columns = map_normal_numbers(names, normal, values, variations).T
    drawn = dict(zip(names, columns, strict=True))
    scenes = parameters.build(drawn)
    motions = list(motion) if isinstance(motion, Suite) else [motion]
    # Records are simulated one by one: the samples fill the queue, and all records together
    # need not fit into memory.
    with count_work("samples", len(normal) * len(motions)):
        answers = np.stack(
            [_simulate_samples(scenes, part, as_model(model), ratio) for part in motions], 1
        )
    answers = np.moveaxis(answers.reshape(*answers.shape[:2], -1, samples), 2, 0)
    outcomes = answers[0, 1:]
    # Errors estimated from a few samples are meaningless. The peak always has many values.
    happens = outcomes.sum(axis=(1, 2))
    clear = np.minimum(happens, outcomes[0].size - happens) >= _FEWEST
    blank = np.where([True, *clear], 1.0, np.nan)[:, None]
    statistics = compute_sobol_indices(answers[0], answers[1], answers[2:])
    # Both directions of a record count as one record, by their mean.
    directions = motion.directions if isinstance(motion, Suite) else 1
    recordings = [np.asarray(average_directions(part, directions)) for part in answers[0]]
    inputs = {name: part[:samples] for name, part in drawn.items()}
    scores = [*map(compute_scores, names, inputs.values(), values, variations)]
    scores += [np.full(samples, np.nan)] * (len(motions) > 1)
    slopes = [compute_derivatives(part, np.stack(scores, 1)) for part in recordings]
    by_record = outcomes.mean(axis=2).T
    intervals = [compute_interval(part.mean(axis=1), samples) for part in recordings[1:]]
    low, high = np.transpose(intervals)
    statistics["by_median"], statistics["by_median_error"] = np.stack(slopes, 1)
    labels = ("rocks", f"exceeds {float(ratio):g}", "overturns")
    return OutcomeProbabilities(
        outcomes=labels,
        probability=by_record.mean(axis=0),
        low=low,
        high=high,
        by_record=by_record,
        answers=("peak", *labels),
        sources=(*names, "record") if len(motions) > 1 else names,
        inputs=inputs,
        peak=answers[0, 0],
        **{name: part * blank for name, part in statistics.items()},
    )


def _draw_mixed_samples(count: int, samples: int, seed: int) -> np.ndarray:
    """Draw two samples of normal numbers, then the first with a column from the second."""
    first, second = np.split(draw_normal_numbers(2 * count, samples, seed), 2, axis=1)
    is_exchanged = np.eye(count, dtype=bool)[:, None]
    return np.concatenate([first, second, *np.where(is_exchanged, second, first)])


def _simulate_samples(
    scenes: Mapping[str, Any], motion: Motion, model: RockingModel, ratio: float
) -> np.ndarray:
    """Simulate all samples under one motion; peak and outcomes, shape (answers, samples)."""
    response = simulate_scenes(scenes, motion, model)
    rotation = response.peak_rotation / np.asarray(scenes["block"].critical_angle)
    overturned = response.overturned
    peak = np.where(overturned, 1.0, np.minimum(rotation, 1.0))
    rows = [peak, rotation > 0, overturned | (rotation > ratio), overturned]
    return np.stack(np.broadcast_arrays(*rows)).astype(float)
