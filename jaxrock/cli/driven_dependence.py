"""Dependence of driven motion: probabilities of outcomes, and meaningful derivatives."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..ground_motion import Motion
from ..resonance import as_model
from ..sensitivity import (
    DrivenAnswer,
    DrivenAnswerName,
    LocalDependence,
    OutcomeProbabilities,
    TornadoBars,
    Uncertain,
    arrange_bars,
    list_ends,
    local_dependence,
    outcome_probabilities,
)
from ..tables import write_csv
from .command import Answer, save_picture
from .dependence_options import UNITS_OF_NUMBERS, DependenceOptions

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


class DrivenDependence(DependenceOptions):
    """The command about dependence, under a pulse, a record or a suite."""

    def name_driven_files(self) -> tuple[str, ...]:
        """Name the files; under a suite there is no tornado."""
        if self.records is not None:
            self.read_suite()
            return ("sensitivity.csv", "probabilities.csv", "probabilities.png")
        return ("sensitivity.csv", "probabilities.csv", "probabilities.png", "tornado.png")

    def answer_driven(self, at: dict[str, float], folder: Path) -> Answer:
        """Compute the probabilities, and under one motion look at the answer itself."""
        from ..plot import plot_tornado

        bars = None if self.records is not None else self._compute_bars(at)
        # Pulses are made to measure: one that overturns the block is a wrong question.
        if bars is not None and not np.isfinite(bars.value) and self.pulse is not None:
            raise ValueError(self.refuse_answer(at))
        outcomes = self._compute_probabilities(at)
        columns: dict[str, list[object]] = {
            "quantity": list(outcomes.sources),
            "unit": [UNITS_OF_NUMBERS.get(name, "-") for name in outcomes.sources],
        }
        coefficient = (
            f"a coefficient of variation of {self.coefficient_of_variation:g} in each"
        )
        text = f"by the {self.model_name} model, with {coefficient}; {self.write_sizes()}"
        lines = [text, str(outcomes)]
        data: dict[str, object] = {"model": self.model_name}
        if bars is not None:
            dependence = self._compute_dependence(at)
            columns |= _tabulate_answer(bars, dependence)
            lines += ["", f"{self.answer_name} {bars}", str(dependence)]
            save_picture(plot_tornado(bars, label=self.axis_label), folder / "tornado.png")
            data |= {"answer": self.answer_name, "value": bars.value}
            data |= {name: getattr(dependence, name) for name in _SUMMARY}
        columns |= _tabulate_indices(outcomes)
        write_csv(folder / "sensitivity.csv", columns, {}, self.about)
        probabilities = {
            "outcome": list(outcomes.outcomes),
            "probability": outcomes.probability.tolist(),
            "low": outcomes.low.tolist(),
            "high": outcomes.high.tolist(),
        }
        write_csv(folder / "probabilities.csv", probabilities, {}, self.about)
        _draw_probabilities(outcomes, folder / "probabilities.png")
        data |= {"probabilities": _list_rows(probabilities), "rows": _list_rows(columns)}
        return Answer("\n".join(lines), data)

    def _compute_probabilities(self, at: Mapping[str, float]) -> OutcomeProbabilities:
        """Compute the probabilities of outcomes of uncertain parameters."""
        return outcome_probabilities(
            self.block,
            at["restitution"],
            self.motion if self.records is None else self.read_suite(),
            self._make_uncertain(at),
            ratio=self.ratio,
            model=self.model_name,
        )

    def _compute_dependence(self, at: Mapping[str, float]) -> LocalDependence:
        """Compute the local dependence of the answer on the parameters."""
        return local_dependence(
            self.block,
            at["restitution"],
            self._read_motion(),
            self._make_uncertain(at),
            answer=_ANSWERS[self.answer_name],
            scale=at.get("scale", 1.0),
            model=self.model_name,
        )

    def _make_uncertain(self, at: Mapping[str, float]) -> Uncertain:
        """Make all parameters uncertain."""
        coefficients = dict.fromkeys(at, self.coefficient_of_variation)
        return Uncertain(coefficients, samples=self.samples, seed=self.seed)

    def _read_motion(self) -> Motion:
        """Read the motion: a record without its scale, which is a parameter."""
        return self.motion if self.record is None else replace(self, scale=1.0).motion

    def _compute_bars(self, at: Mapping[str, float]) -> TornadoBars:
        """Compute the tornado, in one batch."""
        answer = DrivenAnswer(
            self.block,
            at["restitution"],
            self._read_motion(),
            _ANSWERS[self.answer_name],
            as_model(self.model_name),
        )
        ranges = self.make_ranges(at)
        points = list_ends(np.array(list(at.values())), ranges)
        answers = answer.evaluate(dict(zip(at, points.T, strict=True)))
        return arrange_bars(answers, ranges, self.name_sides())


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


def _list_rows(columns: Mapping[str, list[object]]) -> list[dict[str, object]]:
    """List the rows of a table as dictionaries."""
    return [
        dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)
    ]


def _draw_probabilities(outcomes: OutcomeProbabilities, path: Path) -> None:
    """Draw the probabilities, and the indices of the answers that vary."""
    import matplotlib.pyplot as plt

    from ..plot import plot_outcome_probabilities, plot_sobol_indices

    vary = np.isfinite(outcomes.first).all(axis=1)
    answers = [name for name, varies in zip(outcomes.answers, vary, strict=True) if varies]
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
