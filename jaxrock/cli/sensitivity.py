"""The commands about the parameters that an answer depends on, in resonance and under motions."""

import math
from collections.abc import Mapping
from typing import Annotated, Literal

from cyclopts import Parameter

from .. import resonance
from .. import sensitivity as dependence
from ..block import SIZE_NAMES, block_of, size_of
from ..ground_motion import Suite
from ..sensitivity import Uncertain
from ..tables import write_label
from ..validation import Number, Reals
from .answers import Answer, list_rows
from .motion_options import MOTION, MotionOptions
from .options import BlockOptions, Count, FileOutput, ModelName, refuse

_TOLERANCE = 1e-6  # of derivatives


def sensitivity(
    *,
    answer: Literal[
        "rotation-ratio",
        "stabilized-rotation",
        "stabilized-period",
        "amplification",
        "overturning-margin",
        "critical-intensity",
    ] = "critical-intensity",
    intensity: float | None = None,
    model: ModelName = "linearized",
    coefficient_of_variation: float = 0.05,
    block_options: BlockOptions = BlockOptions(),
    output: FileOutput = FileOutput(),
) -> Answer:
    """Find what an answer of resonance depends on: derivatives, a tornado, uncertainty.

    Under instantaneous pulses right after each impact. Derivatives come with their errors by
    rounding, and with the ranges in which the answer goes on. With a height, the parameters are the
    width at this height and the height at this width. Else they are the half-width at this
    slenderness and the slenderness. Writes sensitivity.csv and tornado.png.

    Example: jaxrock sensitivity --width 0.8 --height 4 --restitution 0.7 --answer rotation-ratio

    Parameters
    ----------
    answer
        Answer to examine.
    intensity
        Change of ground velocity in each instantaneous pulse [m/s]. 0.15 if not given.
    model
        Equation of motion.
    coefficient_of_variation
        Coefficient of variation of each parameter.
    """
    at = _list_parameters(block_options)
    if answer == "critical-intensity":
        refuse("where it is sought", intensity=intensity)
    else:
        at["intensity"] = 0.15 if intensity is None else intensity
    block = block_options.block
    constant = {"gravity": block.gravity, "inertia_ratio": block.inertia_ratio}

    def compute(parameters: Mapping[str, Number]) -> Reals:
        """Compute the answer from the parameters, which may be traced."""
        changed = block_of({**parameters, **constant}, block.one_sided)
        c = parameters["restitution"]
        function = getattr(resonance, answer.replace("-", "_"))
        if answer == "critical-intensity":
            return function(changed, c, math.inf, model)
        return function(resonance.Scene(changed, c, parameters["intensity"]), model)

    with output.write("sensitivity", "sensitivity.csv", "tornado.png", dataset=False) as files:
        from ..plot import plot_tornado

        local = dependence.sensitivities(compute, at)
        if not math.isfinite(local.value):
            raise ValueError(f"--answer {answer} does not exist here: the block overturns")
        bars = dependence.tornado(compute, at, _make_ranges(at))
        uncertain = Uncertain(dict.fromkeys(at, coefficient_of_variation), samples=1024)
        moments = dependence.propagate(compute, at, uncertain)
        columns = local.table() | bars.table(local.names)
        columns["fraction_of_variance"] = [moments.variance_fractions[n] for n in local.names]
        files.write_csv("sensitivity.csv", columns, block=block_options.text)
        label = write_label(answer.replace("-", "_"))
        files.save_picture("tornado.png", plot_tornado(bars, label=label))
    data = {"answer": answer, "model": model, "value": local.value, "rows": list_rows(columns)}
    for name in ("mean", "standard_deviation", "within_tolerance"):
        data[name] = getattr(moments, name)
    spread = "not known, as samples show"
    if moments.within_tolerance:
        spread = f"{moments.mean:.6g} +- {moments.standard_deviation:.3g}"
    given = f"by the {model} model, with a variation of {coefficient_of_variation:g} in each"
    text = f"{block_options.text}\n{answer} {local}\n{given}: {spread}"
    return Answer(text, data, output, files.paths)


def driven_sensitivity(  # noqa: PLR0913
    *,
    answer: Literal["rotation-ratio", "peak-rotation", "margin"] = "rotation-ratio",
    model: ModelName = "nonlinear",
    coefficient_of_variation: float = 0.05,
    samples: Count = 4096,
    seed: Count = 0,
    records: Annotated[str | None, Parameter(group=MOTION)] = None,
    block_options: BlockOptions = BlockOptions(),
    motion_options: MotionOptions = MotionOptions(),
    output: FileOutput = FileOutput(),
) -> Answer:
    """Find what the outcome under a pulse, a record or a suite depends on.

    It computes the probabilities that the block rocks and overturns, Sobol indices, and
    derivatives of the probabilities with respect to the logarithm of the median of each
    parameter. Under one motion it adds a tornado, and derivatives of the answer with their
    errors and the ranges in which they hold, by `jaxrock.derivatives_within`. Parameters of the
    size are those of the command sensitivity. Writes sensitivity.csv, probabilities.csv,
    probabilities.png, and tornado.png under one motion.

    Example: jaxrock driven-sensitivity --width 0.4 --height 2 --record example --scale 1.5

    Parameters
    ----------
    answer
        Answer whose derivatives are computed under one motion.
    model
        Equation of motion.
    coefficient_of_variation
        Coefficient of variation of each parameter.
    samples
        Number of samples of the parameters under each motion, a power of 2.
    seed
        Seed of the samples.
    records
        Folder of records, "example" for jaxrock's twenty, or a set of FEMA P695, such as
        fema-far-field. Give this, a record or a pulse.
    """
    block, c = block_options.block, block_options.coefficient
    at = _list_parameters(block_options)
    if records is not None:
        alone = ("record", "pulse", "amplitude", "pulse_duration", "column", "vertical")
        refuse("with --records", **{name: getattr(motion_options, name) for name in alone})
        suite = motion_options.read_records(records)
        suite = suite.both_directions() if block.one_sided else suite
        motion = suite.scaled(motion_options.factor)
    else:
        motion = motion_options.read()
    if motion_options.pulse is None:
        at["factor"] = 1.0
    else:
        at |= {name: float(getattr(motion, name)) for name in ("amplitude", "duration")}
    coefficients = dict.fromkeys(at, coefficient_of_variation)
    uncertain = Uncertain(coefficients, samples=samples, seed=seed)
    names = ["sensitivity.csv", "probabilities.csv", "probabilities.png"]
    names += [] if records else ["tornado.png"]
    with output.write("driven_sensitivity", *names, dataset=False) as files:
        from ..plot import plot_tornado

        outcomes = dependence.outcome_probabilities(block, c, motion, uncertain, model=model)
        columns = outcomes.table_of_sources()
        source = getattr(motion, "source", "")
        head = f"{block_options.text}; by the {model} model; {source}".rstrip("; ")
        texts = [head, outcomes]
        data: dict[str, object] = {"model": model, "record_source": source}
        if not isinstance(motion, Suite):
            name = answer.replace("-", "_")
            duration = motion.end + dependence.BEYOND
            local = dependence.derivatives_within(
                block, c, motion, _TOLERANCE, duration, of=name, by=tuple(at), model=model
            )
            bars = dependence.driven_tornado(
                block, c, motion, _make_ranges(at), answer=name, model=model
            )
            columns |= local.table() | bars.table(list(at))
            texts += ["", f"{answer} {bars}", local]
            data |= {"answer": answer, "value": bars.value}
            label = write_label(name)
            files.save_picture("tornado.png", plot_tornado(bars, label=label))
        files.write_csv("sensitivity.csv", columns, block=block_options.text)
        files.write_csv("probabilities.csv", outcomes.table(), block=block_options.text)
        files.save_picture("probabilities.png", outcomes.plot())
    data |= {"probabilities": list_rows(outcomes.table()), "rows": list_rows(columns)}
    return Answer("\n".join(map(str, texts)), data, output, files.paths)


def _list_parameters(options: BlockOptions) -> dict[str, float]:
    """List the parameters: two sizes, by how the block was given, and the restitution."""
    by = "shape" if options.height is None else "sides"
    sizes = size_of(options.block, by)
    at = {name: float(sizes[name]) for name in SIZE_NAMES[by]}
    return at | {"restitution": options.coefficient}


def _make_ranges(at: Mapping[str, float]) -> dict[str, tuple[float, float]]:
    """Make the ranges of the tornado, 10 % to either side."""
    # An amplitude may be negative.
    ranges = {name: (x - 0.1 * abs(x), x + 0.1 * abs(x)) for name, x in at.items()}
    # Beyond 1 an impact would give energy to the block.
    low, high = ranges["restitution"]
    return ranges | {"restitution": (low, min(high, 1.0))}
