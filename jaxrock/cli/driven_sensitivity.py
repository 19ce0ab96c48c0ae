"""Sensitivities under a pulse, a record or a suite: probabilities, meaningful derivatives."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..ground_motion import Motion, Pulse, Suite
from ..host import write_whole
from ..sensitivity import (
    DrivenAnswerName,
    LocalDependence,
    OutcomeProbabilities,
    TornadoBars,
    driven_tornado,
    is_index_known,
    local_dependence,
    outcome_probabilities,
)
from ..tables import write_csv
from ..validation import POSITIVE, check
from .answers import Answer, list_rows, save_picture
from .motion_options import MotionOptions, put_on_floor, read_records, turn_suite
from .options import FileOutput, refuse_beside
from .sensitivity_question import UNITS_OF_PARAMETERS, Question

_FILES = ("sensitivity.csv", "probabilities.csv", "probabilities.png")
# The answers by the names that the library has for them.
_ANSWERS: dict[str, DrivenAnswerName] = {
    "rotation-ratio": "rotation_ratio",
    "rotation": "peak_rotation",
    "margin": "margin",
}
# What the library says of derivatives, beside them.
_SUMMARY = (
    *("overturned", "factor_low", "factor_high", "meaningful", "explained_variance"),
    *("mean", "standard_deviation", "left_out", "reason"),
)


class DrivenQuestion(NamedTuple):
    """A question about a block on moving ground.

    Attributes
    ----------
    question : Question
        With the parameters of the motion.
    motion : Motion or Suite
        What shakes the block.
    scale : float
        Factor still to be put on the motion [-]: 1 for a pulse, which has it already.
    ratio : float
        Rotation ratio whose probability is computed [-].
    samples, seed : int
        Number and seed of the samples of the parameters.
    """

    question: Question
    motion: Motion | Suite
    scale: float
    ratio: float
    samples: int
    seed: int


def ask_driven(
    question: Question,
    options: MotionOptions,
    records: str | None,
    ratio: float | None,
    samples: int | None,
    seed: int | None,
) -> DrivenQuestion:
    """Read the motion, and add its parameters to the question."""
    if question.answer not in _ANSWERS:
        raise ValueError(
            "--answer must be rotation-ratio, rotation or margin under a ground motion,"
            f" got {question.answer}"
        )
    probable_ratio = 0.5 if ratio is None else ratio
    check("ratio", probable_ratio, POSITIVE)
    # Only a positive factor can be uncertain: a reversed motion has the sign itself.
    scale = abs(options.factor)
    direction = -1.0 if options.factor < 0 else 1.0
    at = question.at | {"scale": scale}
    if records is not None:
        motion = _read_suite(options, records, question.block.one_sided).scaled(direction)
    elif options.pulse is None:
        motion = options.read_unscaled().scaled(direction)
    else:
        motion = options.read()
        assert isinstance(motion, Pulse)
        scale = 1.0
        at = question.at | {
            "amplitude": float(motion.amplitude),
            "duration": float(motion.duration),
        }
    return DrivenQuestion(
        question._replace(at=at),
        motion,
        scale,
        probable_ratio,
        4096 if samples is None else samples,
        0 if seed is None else seed,
    )


def _read_suite(options: MotionOptions, records: str, one_sided: bool) -> Suite:
    """Read the records of a folder, or take those of a name; both directions if one-sided."""
    if options.given:
        motion = options.pulse or options.record
        raise ValueError(
            f"--records excludes --pulse and --record, got {records} and {motion}"
        )
    of_motion = ("amplitude", "pulse_duration", "column", "vertical")
    refuse_beside("--records", **{name: getattr(options, name) for name in of_motion})
    suite = read_records(records, options.unit, options.time_step)
    suite = put_on_floor(suite, *options.floor)
    return turn_suite(suite, None, one_sided)


def answer_driven(
    asked: DrivenQuestion, out: Path, output: FileOutput, about: Mapping[str, object]
) -> Answer:
    """Compute the probabilities, and under one motion look at the answer itself."""
    question = asked.question
    is_single = isinstance(asked.motion, Motion)
    names = (*_FILES, "tornado.png") if is_single else _FILES
    with write_whole("out", out, names, output.force) as folder:
        columns: dict[str, list[object]] = {}
        data: dict[str, object] = {"model": question.model}
        lines = [
            f"{question.scene_text}; by the {question.model} model",
            "coefficient of variation of each parameter:"
            f" {question.coefficient_of_variation:g}",
        ]
        if isinstance(asked.motion, Suite) and asked.motion.source:
            lines.append(f"records: {asked.motion.source}")
            data["record_source"] = asked.motion.source
        bars = _compute_bars(asked) if is_single else None
        outcomes = _compute_probabilities(asked)
        lines.append(str(outcomes))
        if bars is not None:
            from ..plot import plot_tornado

            dependence = _compute_dependence(asked)
            columns |= _tabulate_answer(bars, dependence)
            tornado = [] if bars.reason_without_bars else [f"{question.answer} {bars}"]
            lines += ["", *tornado, str(dependence)]
            save_picture(plot_tornado(bars, label=question.label), folder / "tornado.png")
            data |= {"answer": question.answer, "value": bars.value}
            data |= {name: getattr(dependence, name) for name in _SUMMARY}
        sources: dict[str, list[object]] = {
            "quantity": list(outcomes.sources),
            "unit": [UNITS_OF_PARAMETERS.get(name, "-") for name in outcomes.sources],
        }
        columns = sources | columns | _tabulate_indices(outcomes)
        write_csv(folder / "sensitivity.csv", columns, {}, about)
        probabilities = {
            "outcome": list(outcomes.outcomes),
            "probability": outcomes.probability.tolist(),
            "low": outcomes.low.tolist(),
            "high": outcomes.high.tolist(),
        }
        write_csv(folder / "probabilities.csv", probabilities, {}, about)
        _draw_probabilities(outcomes, folder / "probabilities.png")
    data |= {"probabilities": list_rows(probabilities), "rows": list_rows(columns)}
    return Answer("\n".join(lines), data, output, [out / name for name in names])


def _compute_probabilities(asked: DrivenQuestion) -> OutcomeProbabilities:
    """Compute the probabilities of outcomes of uncertain parameters."""
    question = asked.question
    return outcome_probabilities(
        question.block,
        question.at["restitution"],
        asked.motion.scaled(asked.scale),
        question.make_uncertain(asked.samples, asked.seed),
        ratio=asked.ratio,
        model=question.model,
    )


def _compute_dependence(asked: DrivenQuestion) -> LocalDependence:
    """Compute the local dependence of the answer on the parameters."""
    question = asked.question
    assert isinstance(asked.motion, Motion)
    return local_dependence(
        question.block,
        question.at["restitution"],
        asked.motion,
        question.make_uncertain(asked.samples, asked.seed),
        answer=_ANSWERS[question.answer],
        scale=asked.scale,
        model=question.model,
    )


def _compute_bars(asked: DrivenQuestion) -> TornadoBars:
    """Compute the tornado."""
    question = asked.question
    assert isinstance(asked.motion, Motion)
    bars = driven_tornado(
        question.block,
        question.at["restitution"],
        asked.motion,
        question.make_ranges(),
        answer=_ANSWERS[question.answer],
        scale=asked.scale,
        model=question.model,
    )
    # The user chose the pulse: if it overturns the block there is no tornado to be drawn.
    if isinstance(asked.motion, Pulse) and not np.isfinite(bars.value):
        raise ValueError(question.describe_missing())
    return replace(bars, sides=question.sizes)


def _tabulate_answer(
    bars: TornadoBars, dependence: LocalDependence
) -> dict[str, list[object]]:
    """Tabulate the answer at the ends of ranges, and its derivatives where there are any."""
    order = [bars.names.index(name) for name in dependence.names]
    columns = {
        "value": dependence.at.tolist(),
        "derivative": _list_numbers(dependence.derivatives),
        "elasticity": _list_numbers(dependence.elasticities),
    }
    for name in ("low", "high", "at_low", "at_high"):
        values = np.asarray(getattr(bars, name))[order].tolist()
        columns[name] = [value if np.isfinite(value) else "overturns" for value in values]
    return columns


def _tabulate_indices(outcomes: OutcomeProbabilities) -> dict[str, list[object]]:
    """Tabulate Sobol indices of all answers, and derivatives of the probabilities."""
    columns: dict[str, list[object]] = {}
    for k, answer in enumerate(outcomes.answers):
        word = answer.replace(" ", "_")
        for kind in ("first", "total"):
            columns[f"{kind}_{word}"] = _list_numbers(getattr(outcomes, kind)[k])
            columns[f"{kind}_{word}_error"] = _list_numbers(
                getattr(outcomes, f"{kind}_error")[k]
            )
    # The record has no derivatives.
    missing = [None] * (len(outcomes.sources) - len(outcomes.names))
    for k, outcome in enumerate(outcomes.outcomes):
        word = outcome.replace(" ", "_")
        for kind in ("by_median", "by_coefficient_of_variation"):
            derivatives = getattr(outcomes, kind)[k]
            errors = getattr(outcomes, f"{kind}_error")[k]
            clear = np.where(errors < abs(derivatives), derivatives, np.nan)
            columns[f"{kind}_{word}"] = [*_list_numbers(clear), *missing]
            columns[f"{kind}_{word}_error"] = [*_list_numbers(errors), *missing]
    return columns


def _list_numbers(values: np.ndarray) -> list[object]:
    """List numbers, None for those that do not exist."""
    return [value if np.isfinite(value) else None for value in values.tolist()]


def _draw_probabilities(outcomes: OutcomeProbabilities, path: Path) -> None:
    """Draw the probabilities, and the indices of the answers that vary."""
    import matplotlib.pyplot as plt

    from ..plot import plot_outcome_probabilities, plot_sobol_indices

    # Of which noise hides not all indices.
    answers = [
        name
        for name, *row in zip(
            outcomes.answers, outcomes.total, outcomes.total_error, strict=True
        )
        if any(map(is_index_known, *row))
    ]
    # Of the outcomes, the last one that varies is the one that matters most.
    chosen = [name for name in ("peak", answers[-1] if answers else "") if name in answers]
    chosen = list(dict.fromkeys(chosen))
    figure, axes = plt.subplots(
        1 + len(chosen),
        layout="constrained",
        figsize=(6.4, 2.6 + 2.6 * len(chosen)),
        squeeze=False,
    )
    plot_outcome_probabilities(outcomes, axes[0, 0])
    for name, ax in zip(chosen, axes[1:, 0], strict=True):
        plot_sobol_indices(outcomes, name, ax)
    save_picture(figure, path)
