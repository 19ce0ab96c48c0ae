"""The command about the parameters that an answer depends on.

Of resonance here; under a pulse, a record or a suite in ``driven_sensitivity.py``.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from .. import resonance
from ..block import block_of
from ..host import write_whole
from ..sensitivity import (
    MomentEstimate,
    Sensitivities,
    TornadoBars,
    propagate,
    sensitivities,
    tornado,
    value_and_slopes,
)
from ..tables import write_csv
from ..validation import NON_NEGATIVE, Number, Reals, check
from .answers import Answer, describe_options, list_rows, save_picture
from .driven_sensitivity import answer_driven, ask_driven
from .motion_options import MOTION, MotionOptions
from .options import (
    BlockOptions,
    Count,
    FileOutput,
    Folder,
    ModelName,
    refuse,
    refuse_beside,
    warn_of_intensity,
)
from .sensitivity_question import UNITS_OF_PARAMETERS, AnswerName, Question, ask

_FILES = ("sensitivity.csv", "tornado.png", "map.png")
_SAMPLES = 1024  # that check moments
_OF_SCENE = {
    "rotation-ratio": resonance.rotation_ratio,
    "rotation": resonance.stabilized_rotation,
    "stabilized-period": resonance.stabilized_period,
    "amplification": resonance.amplification,
    "margin": resonance.overturning_margin,
}


def sensitivity(  # noqa: PLR0913
    *,
    answer: AnswerName | None = None,
    intensity: float | None = None,
    model: ModelName | None = None,
    relative_change: float | None = None,
    coefficient_of_variation: float = 0.05,
    ratio: float | None = None,
    samples: Count | None = None,
    seed: Count | None = None,
    records: Annotated[str | None, Parameter(group=MOTION)] = None,
    block_options: BlockOptions = BlockOptions(),
    motion_options: MotionOptions = MotionOptions(),
    out: Folder = Path("sensitivity"),
    output: FileOutput = FileOutput(),
) -> Answer:
    """Find what an answer depends on: probabilities of outcomes, derivatives, a tornado.

    For resonance under instantaneous pulses, it computes derivatives, elasticities, a tornado
    and the effect of uncertainty. Writes sensitivity.csv, tornado.png and map.png. The map
    shows the elasticity with respect to the restitution over slenderness and restitution.

    With a pulse, a record or a suite, it computes the probabilities that the block rocks and
    overturns, Sobol indices, and derivatives of the probabilities with respect to the median
    and the coefficient of variation of each parameter. Under one motion it adds a tornado,
    and derivatives of the answer where they are meaningful, as
    `jaxrock.sensitivity.local_dependence` decides. Writes sensitivity.csv, probabilities.csv,
    probabilities.png and tornado.png.

    With a height, the parameters are the width at this height and the height at this width.
    Else they are the half-width at this slenderness and the slenderness.

    Example: jaxrock sensitivity --answer rotation-ratio --restitution 0.7

    Parameters
    ----------
    answer
        Answer to examine. By default the critical intensity; under a pulse or a record, the
        rotation ratio.
    intensity
        Change of ground velocity in each instantaneous pulse [m/s]. 0.15 if not given.
    model
        Equation of motion. By default nonlinear under a pulse or a record, else linearized.
    relative_change
        Relative change by which the tornado lowers and raises parameters. 0.1 if not given.
    coefficient_of_variation
        Coefficient of variation of each parameter.
    ratio
        Rotation ratio alpha_max / alpha_c whose probability is computed [-]. 0.5 if not given.
    samples
        Number of samples of the parameters under each motion, a power of 2. 4096 if not
        given.
    seed
        Seed of the samples. 0 if not given.
    records
        Folder of records, "example" for jaxrock's twenty, or a set of FEMA P695, such as
        fema-far-field.
    out
        Folder to write to; made if it is missing.
    """
    options = dict(locals())
    driven = motion_options.given or records is not None
    if records is not None:
        refuse_beside("--records", answer=answer, relative_change=relative_change)
    question = ask(
        answer or ("rotation-ratio" if driven else "critical-intensity"),
        model or ("nonlinear" if driven else "linearized"),
        block_options,
        0.1 if relative_change is None else relative_change,
        coefficient_of_variation,
    )
    if driven:
        refuse_beside("a ground motion", intensity=intensity)
        asked = ask_driven(question, motion_options, records, ratio, samples, seed)
        options |= {"ratio": asked.ratio, "samples": asked.samples, "seed": asked.seed}
        if records is None:
            options["relative_change"] = question.relative_change
        return answer_driven(asked, out, output, describe_options("sensitivity", options))
    motion_options.refuse_all("--pulse or --record")
    refuse("--pulse, --record or --records", ratio=ratio, samples=samples, seed=seed)
    question = _add_intensity(question, intensity)
    options["relative_change"] = question.relative_change
    options["intensity"] = question.at.get("intensity")
    return _answer_resonance(question, out, output, describe_options("sensitivity", options))


def _answer_resonance(
    question: Question, out: Path, output: FileOutput, about: Mapping[str, object]
) -> Answer:
    """Compute derivatives, a tornado and moments of an answer of resonance; write the files."""
    with write_whole("out", out, _FILES, output.force) as folder:
        from ..plot import plot_tornado

        def compute(at: Mapping[str, Number]) -> Reals:
            """Compute the answer."""
            return _compute_answer(question, at)

        local = replace(sensitivities(compute, question.at), sides=question.sizes)
        if not math.isfinite(local.value):
            raise ValueError(question.describe_missing())
        bars = tornado(compute, question.at, question.make_ranges())
        bars = replace(bars, sides=question.sizes)
        moments = propagate(compute, question.at, question.make_uncertain(_SAMPLES))
        columns = _tabulate(local, bars, moments)
        write_csv(folder / "sensitivity.csv", columns, {}, about)
        save_picture(plot_tornado(bars, label=question.label), folder / "tornado.png")
        _draw_map(question, folder / "map.png")
    text = (
        f"{question.scene_text}; by the {question.model} model\n"
        f"{question.answer} {local}\n{_write_moments(question, moments)}"
    )
    known = moments.within_tolerance
    data = {
        "answer": question.answer,
        "model": question.model,
        "value": local.value,
        "mean": moments.mean if known else None,
        "standard_deviation": moments.standard_deviation if known else None,
        "within_tolerance": known,
        "rows": list_rows(columns),
    }
    return Answer(text, data, output, [out / name for name in _FILES])


def _add_intensity(question: Question, intensity: float | None) -> Question:
    """Add the intensity of the pulses to the parameters, unless it is the answer."""
    if question.answer == "critical-intensity":
        if intensity is not None:
            raise ValueError(
                f"--intensity is sought by --answer critical-intensity, got {intensity:g}: leave"
                " it out, or give another --answer, such as rotation-ratio"
            )
        return question
    pulse = 0.15 if intensity is None else intensity
    check("intensity", pulse, NON_NEGATIVE)
    warn_of_intensity(pulse)
    return question._replace(at=question.at | {"intensity": pulse})


def _compute_answer(question: Question, at: Mapping[str, Number]) -> Reals:
    """Compute an answer of resonance from the parameters, which may be traced."""
    constant = {name: getattr(question.block, name) for name in ("gravity", "inertia_ratio")}
    block = block_of({**at, **constant}, question.block.one_sided)
    c = at["restitution"]
    if question.answer == "critical-intensity":
        return resonance.critical_intensity(block, c, math.inf, question.model)
    scene = resonance.Scene(block, c, at["intensity"])
    return _OF_SCENE[question.answer](scene, question.model)


def _tabulate(
    local: Sensitivities, bars: TornadoBars, moments: MomentEstimate
) -> dict[str, list[object]]:
    """Tabulate derivatives, the tornado and the fractions of the variance by parameter."""
    # The bars begin with the longest, the derivatives go by the order of the parameters.
    order = [bars.names.index(name) for name in local.names]
    columns = {
        "quantity": list(local.names),
        "unit": [UNITS_OF_PARAMETERS.get(name, "-") for name in local.names],
        "value": local.at,
        "derivative": local.gradient,
        "elasticity": local.elasticity,
        "low": bars.low[order],
        "high": bars.high[order],
        "at_low": bars.at_low[order],
        "at_high": bars.at_high[order],
        "fraction_of_variance": [moments.variance_fractions[name] for name in local.names],
    }
    return {name: np.asarray(column).tolist() for name, column in columns.items()}


def _write_moments(question: Question, moments: MomentEstimate) -> str:
    """Write mean and standard deviation, or why there are none to be trusted."""
    given = f"with a coefficient of variation of {question.coefficient_of_variation:g} in each"
    if moments.within_tolerance:
        return f"{given}: {moments.mean:.6g} +- {moments.standard_deviation:.3g}"
    if moments.left_out:
        return f"{given}, {moments.left_out:.1%} of samples overturn: there is no mean"
    return f"{given}, derivatives do not describe the answer: no mean is given"


def _draw_map(question: Question, path: Path) -> None:
    """Draw the elasticity with respect to the restitution, over it and the slenderness."""
    import xarray

    from ..plot import plot_sensitivity_map

    # Over the slenderness of blocks that are as wide, however their size is described.
    half_width = float(question.block.half_width)
    pulses = {}
    if "intensity" in question.at:
        pulses["intensity"] = question.at["intensity"]

    def compute_answer(c: Number, slenderness: Number) -> Reals:
        """Compute the answer at a restitution and a slenderness."""
        size = {"half_width": half_width, "slenderness": slenderness}
        return _compute_answer(question, {**size, "restitution": c, **pulses})

    # So fine that the edge of the hatched area is a smooth line at the resolution of the file.
    c = np.linspace(0.3, 0.95, 521)
    slenderness = np.linspace(3, 10, 561)
    value, derivative = value_and_slopes(compute_answer, mask_beyond=True)(
        c[:, None], slenderness[None]
    )
    elasticity = np.asarray(derivative * c[:, None] / value)
    axes = [("restitution", c), ("slenderness", slenderness)]
    answer = question.answer.replace("-", " ")
    attributes = {
        "units": "1",
        "long_name": f"elasticity of {answer} with respect to restitution",
    }
    ax = plot_sensitivity_map(xarray.DataArray(elasticity, axes, attrs=attributes))
    pulse = f"$I$ = {pulses['intensity']:g} m/s, " if pulses else ""
    title = f"{2 * half_width:g} m wide, {pulse}{question.model}"
    ax.set_title(title, fontsize="medium")
    save_picture(ax, path)
