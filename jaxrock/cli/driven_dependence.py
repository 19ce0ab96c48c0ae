"""Dependence of driven motion: probabilities of outcomes, slopes where they make sense."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..driven import require_complete, respond_batch
from ..ground_motion import Motion
from ..host import format_table
from ..overturning import overturning_boundaries
from ..sensitivity import (
    OutcomeProbabilities,
    TornadoBars,
    Uncertain,
    arrange_bars,
    describe_parameter,
    list_ends,
    make_parametric,
    outcome_probabilities,
)
from ..tables import write_csv
from .command import Answer, save_picture
from .dependence_options import UNITS_OF_NUMBERS, DependenceOptions

# Boundaries are sought up to so many widths of the scatter away, at so many strengths. Odd, so
# that the strength itself is among them, however narrow its window is.
_RANGE = 4.0
_STRENGTHS = 257
# A tangent describes an answer if it explains so much of the variance within the scatter.
_EXPLAINED = 0.8
# Names of parameters of a pulse among those that are uncertain.
_NAMES_OF_UNCERTAIN = {"amplitude": "scale", "pulse_duration": "duration"}


class _Window(NamedTuple):
    """The factors on a motion between which the outcome is that of the scene itself.

    Attributes
    ----------
    low, high : float or None
        None where there is no boundary within the range.
    overturns : bool
        The outcome.
    ends : tuple of float
        The range in which boundaries were sought.
    """

    low: float | None
    high: float | None
    overturns: bool
    ends: tuple[float, float]

    def is_narrow(self, scatter: float) -> bool:
        """Tell whether a boundary is nearer than the scatter."""
        return any(abs(1 - end) < scatter for end in (self.low, self.high) if end is not None)

    def write_text(self, scatter: float) -> str:
        """Write a sentence about the window, beside the scatter."""
        does = "overturns" if self.overturns else "stands"
        near = self.is_narrow(scatter)
        if self.low is None and self.high is None:
            low, high = self.ends
            return (
                f"the block {does} at all factors on the motion from {low:.3g} to {high:.3g}"
            )
        if self.low is not None and self.high is not None:
            size = self.high - self.low
            compared = (
                "narrower" if size < scatter else "with a boundary nearer" if near else "wider"
            )
            return (
                f"the block {does} in a window of factors on the motion from {self.low:.5g} to"
                f" {self.high:.5g}, {size:.2g} wide, {compared} than the scatter of {scatter:g}"
            )
        compared = f"{'nearer' if near else 'further away'} than the scatter of {scatter:g}"
        if self.low is None:
            return (
                f"the block {does} up to a factor of {self.high:.5g} on the motion, {compared}"
            )
        return f"the block {does} from a factor of {self.low:.5g} on the motion on, {compared}"


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

        scatter = self.coefficient_of_variation
        bars = None if self.records is not None else self._compute_bars(at)
        # Pulses are made to measure: one that overturns the block is a wrong question.
        if bars is not None and not np.isfinite(bars.value) and self.pulse is not None:
            raise ValueError(self.refuse_answer(at))
        found = self._compute_probabilities(at)
        # The numbers, which of a pulse have other names than its inputs, and the record.
        names = [*at, *found.sources[len(at) :]]
        columns: dict[str, list[object]] = {
            "quantity": list(names),
            "unit": [UNITS_OF_NUMBERS.get(name, "-") for name in names],
        }
        text = f"by the {self.model_name} model, with a coefficient of variation of"
        lines = [f"{text} {scatter:g} in each; {self.write_sizes()}", str(found)]
        data: dict[str, object] = {"model": self.model_name}
        if bars is not None:
            window = self._find_window(self.motion)
            slopes, words = self._find_slopes(at, found, window)
            columns |= _tabulate_answer(at, bars, slopes)
            lines += ["", *self._write_answer(at, bars, slopes), words]
            save_picture(plot_tornado(bars, label=self.axis_label), folder / "tornado.png")
            data |= {"answer": self.answer_name, "value": bars.value, "about_slopes": words}
            data |= {"window": [window.low, window.high], "overturns": window.overturns}
        columns |= _tabulate_indices(found)
        write_csv(folder / "sensitivity.csv", columns, {}, self.about)
        probabilities = {
            "outcome": list(found.outcomes),
            "probability": found.probability.tolist(),
            "low": found.low.tolist(),
            "high": found.high.tolist(),
        }
        write_csv(folder / "probabilities.csv", probabilities, {}, self.about)
        _draw_probabilities(found, folder / "probabilities.png")
        data |= {"probabilities": _list_rows(probabilities), "rows": _list_rows(columns)}
        return Answer("\n".join(lines), data)

    def _compute_probabilities(self, at: Mapping[str, float]) -> OutcomeProbabilities:
        """Compute the probabilities of outcomes of uncertain parameters."""
        scatter = self.coefficient_of_variation
        # A pulse of another amplitude is the pulse by a factor.
        coefficients = {_NAMES_OF_UNCERTAIN.get(name, name): scatter for name in at}
        uncertain = Uncertain(coefficients, samples=self.samples, seed=self.seed)
        return outcome_probabilities(
            self.block,
            at["restitution"],
            self.motion if self.records is None else self.read_suite(),
            uncertain,
            ratio=self.ratio,
            model=self.model_name,
        )

    def _follow(self, values: Mapping[str, np.ndarray]) -> np.ndarray:
        """Compute the answer at many numbers, in one batch."""
        block, c, motion = self.make_scene(values)
        assert motion is not None
        duration = self.find_duration(motion)
        found = respond_batch(block, c, motion, duration, model=self.model_name)
        require_complete(found.complete, sample=None)
        parts = (found.peak_rotation, found.margin, found.overturned)
        return np.asarray(self.choose_answer(block, *parts))

    def _compute_bars(self, at: Mapping[str, float]) -> TornadoBars:
        """Compute the tornado, in one batch."""
        ranges = self.make_ranges(at)
        points = list_ends(np.array(list(at.values())), ranges)
        answers = self._follow(dict(zip(at, points.T, strict=True)))
        return arrange_bars(answers, ranges, self.name_sides())

    def _find_window(self, motion: Motion) -> _Window:
        """Find the boundaries on both sides of the strength that the motion has."""
        width = _RANGE * float(np.log1p(self.coefficient_of_variation**2) ** 0.5)
        factors = np.exp(np.linspace(-width, width, _STRENGTHS))
        found = overturning_boundaries(
            self.block, self.coefficient, motion, "factor", factors, model=self.model_name
        )
        low, high = factors[[0, -1]]
        require_complete(found.complete, factor=f"between {low:g} and {high:g}")
        places = np.asarray(found.value)
        below = places[places <= 1]
        above = places[places > 1]
        # The outcome changes at each boundary below the scene.
        overturns = bool(found.overturns_first) != bool(len(below) % 2)
        return _Window(
            float(below[-1]) if below.size else None,
            float(above[0]) if above.size else None,
            overturns,
            (float(factors[0]), float(factors[-1])),
        )

    def _find_slopes(
        self, at: Mapping[str, float], found: OutcomeProbabilities, window: _Window
    ) -> tuple[np.ndarray | None, str]:
        """Find slopes of the answer where they mean something, and say what decides."""
        scatter = self.coefficient_of_variation
        words = window.write_text(scatter)
        if window.is_narrow(scatter):
            return None, f"{words}: local slopes say nothing here and are not given"
        if window.overturns and self.answer_name != "margin":
            return None, f"{words}: the {self.answer_name} has no slopes there"
        inputs = {
            name: found.inputs[_NAMES_OF_UNCERTAIN.get(name, name)]
            * (at[name] if name in ("amplitude", "scale") else 1.0)
            for name in at
        }
        answers = self._follow(inputs)
        steps = np.stack([inputs[name] - at[name] for name in at])
        finite = np.isfinite(answers)
        explained = _explain_by_plane(answers[finite], steps[:, finite])
        slopes = None
        # No tangent explains more than the best plane: without that nothing is compiled.
        if explained >= _EXPLAINED:
            function = make_parametric(self.compute_answer, dict(at))
            value, unordered = function.evaluate(np.asarray(function.values), 1)
            # JAX sorts the names of a dictionary.
            slopes = unordered[[function.names.index(name) for name in at]]
            rest = answers[finite] - value - slopes @ steps[:, finite]
            explained = 1 - float((rest**2).mean() / answers[finite].var())
        if explained < _EXPLAINED:
            return None, (
                f"{words}; but within the scatter no tangent describes the {self.answer_name}:"
                " local slopes say little here and are not given"
            )
        if not finite.all():
            share = f"{1 - finite.mean():.2%} of the samples overturn"
            return slopes, f"{words}; {share}, so there is no mean of the {self.answer_name}"
        return slopes, (
            f"{words}; tangents explain {explained:.0%} of the variance within the scatter,"
            f" mean and standard deviation {answers.mean():.6g} +- {answers.std():.3g}"
        )

    def _write_answer(
        self, at: Mapping[str, float], bars: TornadoBars, slopes: np.ndarray | None
    ) -> list[str]:
        """Write the answer itself: slopes where there are any, and the tornado."""
        lines = [f"{self.answer_name} {bars}"]
        if slopes is not None:
            numbers = np.array(list(at.values()))
            with np.errstate(divide="ignore", invalid="ignore"):
                elasticity = slopes * numbers / bars.value
            names = [describe_parameter(name) for name in at]
            columns = {"at": numbers, "slope": slopes, "elasticity": elasticity}
            lines.append(format_table("slopes", names, **columns))
        return lines


def _tabulate_answer(
    at: Mapping[str, float], bars: TornadoBars, slopes: np.ndarray | None
) -> dict[str, list[object]]:
    """Tabulate the answer at the ends of ranges, and its slopes; None for what is not given."""
    order = [bars.names.index(name) for name in at]
    missing: list[object] = [None] * len(at)
    columns: dict[str, list[object]] = {"value": list(at.values()), "slope": missing}
    columns["elasticity"] = missing
    if slopes is not None:
        columns["slope"] = slopes.tolist()
        elasticity = slopes * np.array(list(at.values())) / bars.value
        columns["elasticity"] = elasticity.tolist()
    for name in ("low", "high", "at_low", "at_high"):
        values = np.asarray(getattr(bars, name))[order].tolist()
        columns[name] = [value if np.isfinite(value) else "overturns" for value in values]
    return columns


def _tabulate_indices(found: OutcomeProbabilities) -> dict[str, list[object]]:
    """Tabulate Sobol indices of all answers, and derivatives of the probabilities."""
    columns: dict[str, list[object]] = {}
    for k, answer in enumerate(found.answers):
        word = answer.replace(" ", "_")
        for kind in ("first", "total"):
            columns[f"{kind}_{word}"] = _list_numbers(getattr(found, kind)[k])
            columns[f"{kind}_{word}_error"] = _list_numbers(getattr(found, f"{kind}_error")[k])
    rest = [None] * (len(found.sources) - len(found.names))  # the record has no slopes
    for k, outcome in enumerate(found.outcomes):
        word = outcome.replace(" ", "_")
        for kind in ("by_median", "by_coefficient_of_variation"):
            slopes = getattr(found, kind)[k]
            errors = getattr(found, f"{kind}_error")[k]
            clear = np.where(errors < abs(slopes), slopes, np.nan)
            columns[f"{kind}_{word}"] = [*_list_numbers(clear), *rest]
            columns[f"{kind}_{word}_error"] = [*_list_numbers(errors), *rest]
    return columns


def _list_numbers(values: np.ndarray) -> list[object]:
    """List numbers, None for those that do not exist."""
    return [value if np.isfinite(value) else None for value in values.tolist()]


def _list_rows(columns: Mapping[str, list[object]]) -> list[dict[str, object]]:
    """List the rows of a table as dictionaries."""
    return [
        dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)
    ]


def _explain_by_plane(answers: np.ndarray, steps: np.ndarray) -> float:
    """Compute which share of the variance of answers a plane through them explains at best."""
    variance = float(answers.var()) if answers.size else 0.0
    # An answer that does not vary, such as one of 0 below uplift, has no slopes worth a word.
    if not variance:
        return 0.0
    columns = np.vstack([np.ones_like(answers), steps]).T
    fitted = columns @ np.linalg.lstsq(columns, answers)[0]
    return 1 - float(((answers - fitted) ** 2).mean()) / variance


def _draw_probabilities(found: OutcomeProbabilities, path: Path) -> None:
    """Draw the probabilities, and the indices of the answers that vary."""
    import matplotlib.pyplot as plt

    from ..plot import plot_outcome_probabilities, plot_sobol_indices

    vary = np.isfinite(found.first).all(axis=1)
    answers = [name for name, varies in zip(found.answers, vary, strict=True) if varies]
    # Of the outcomes, the last one that varies is the one that matters most.
    chosen = [name for name in ("peak", answers[-1] if answers else "") if name in answers]
    chosen = list(dict.fromkeys(chosen))
    figure, axes = plt.subplots(
        1 + len(chosen),
        layout="constrained",
        figsize=(6.4, 2.6 + 2.6 * len(chosen)),
        squeeze=False,
    )
    plot_outcome_probabilities(found, axes[0, 0])
    for name, ax in zip(chosen, axes[1:, 0], strict=True):
        plot_sobol_indices(found, name, ax)
    save_picture(figure, path)
