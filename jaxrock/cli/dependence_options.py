"""Options of the command about dependence, the numbers they give, and the answer to them."""

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from .. import resonance
from ..block import (
    SHAPE,
    SIDES,
    SIZES_IN_WORDS,
    SizeDescription,
    block_of,
    size_of,
)
from ..ground_motion import Suite
from ..overturning import UNITS
from ..validation import NON_NEGATIVE, POSITIVE, Number, Reals, check
from .command import OF_MOTION, Count, ModelName, Writing
from .options import BlockOptions, MotionOptions, read_records

AnswerName = Literal[
    "rotation-ratio", "rotation", "period", "amplification", "margin", "critical-intensity"
]

_UNITS_OF_ANSWERS = {"rotation": "rad", "period": "s", "critical-intensity": "m/s"}
UNITS_OF_NUMBERS = {**UNITS, "intensity": "m/s"}
_OF_SAMPLES = ("ratio", "samples", "seed")


class DependenceOptions(MotionOptions, BlockOptions, Writing):
    """Options of the command about dependence."""

    answer: AnswerName | None = None
    """Answer to examine; by default the critical intensity, under a pulse or record the ratio."""
    intensity: float = 0.15
    """Change of ground velocity in each instantaneous pulse [m/s]."""
    model: ModelName | None = None
    """Equation of motion; by default nonlinear under a pulse or a record, else linearized."""
    relative_change: float = 0.1
    """Relative change by which the tornado lowers and raises parameters."""
    coefficient_of_variation: float = 0.05
    """Coefficient of variation of each number."""
    records: Annotated[str | None, OF_MOTION] = None
    """A folder of records, "example" for twenty, or a set of FEMA P695, as fema-far-field."""
    ratio: float = 0.5
    """Rotation ratio alpha_max / alpha_c whose probability is computed [-]."""
    samples: Count = 4096
    """Samples of the numbers under each motion, a power of 2."""
    seed: Count = 0
    """Seed of the samples."""

    @property
    def shaken(self) -> bool:
        """True if a pulse, a record or a suite is given."""
        return super().shaken or self.records is not None

    def check(self) -> None:
        """Raise `ValueError` also for options of samples where none are drawn."""
        if not self.shaken:
            only = "a pulse, a record or a suite"
            self.refuse(*_OF_SAMPLES, only_with=only)
        super().check()

    def _collect_options(self) -> dict[str, object]:
        """Collect the options; without motion of the ground there are no samples to speak of."""
        found = super()._collect_options()
        left_out = () if self.shaken else _OF_SAMPLES
        return {name: value for name, value in found.items() if name not in left_out}

    @property
    def answer_name(self) -> AnswerName:
        """The answer that is examined."""
        return self.answer or ("rotation-ratio" if self.shaken else "critical-intensity")

    @property
    def axis_label(self) -> str:
        """The answer and its unit, for an axis."""
        unit = _UNITS_OF_ANSWERS.get(self.answer_name, "-")
        return f"{self.answer_name.replace('-', ' ')} [{unit}]"

    @property
    def model_name(self) -> ModelName:
        """The equation of motion."""
        return self.model or ("nonlinear" if self.shaken else "linearized")

    def read_suite(self) -> Suite:
        """Read the records of a folder, or take those of a name."""
        if self.record is not None or self.pulse is not None:
            raise ValueError("pulse, record or records must be given, one of the three")
        names = ("amplitude", "pulse_duration", "column", "vertical")
        self.refuse(*names, only_with="one motion")
        assert self.records is not None
        found = read_records(self.records, self.unit, self.time_step)
        return Suite([record.scaled(self.scale) for record in found], found.names)

    @property
    def size_description(self) -> SizeDescription:
        """The description of the size: by its sides where a height is given."""
        return "shape" if self.height is None else "sides"

    def name_sides(self) -> tuple[str, ...]:
        """Name the sides of the block, if it is described by them."""
        return () if self.height is None else SIDES

    def name_sizes(self) -> tuple[str, ...]:
        """Name the two parameters that describe the size of the block."""
        return self.name_sides() or SHAPE

    def write_sizes(self) -> str:
        """Write in words what a change of size leaves as it is."""
        sizes = [name for name in self.name_sizes() if name in SIZES_IN_WORDS]
        return ", ".join(f"{name} is the {SIZES_IN_WORDS[name]}" for name in sizes)

    def collect_numbers(self) -> dict[str, float]:
        """Check the options, and collect the numbers that the answer depends on, by name."""
        size = size_of(self.block, self.size_description)
        at = {name: float(size[name]) for name in self.name_sizes()}
        at["restitution"] = self.coefficient
        check("intensity", self.intensity, NON_NEGATIVE)
        check("relative_change", self.relative_change, POSITIVE)
        if self.relative_change >= 1:
            raise ValueError(
                f"relative_change must be less than 1, got {self.relative_change:g}"
            )
        check("coefficient_of_variation", self.coefficient_of_variation, POSITIVE)
        if not self.shaken:
            if self.answer_name == "critical-intensity":
                self.refuse(
                    "intensity", only_with="another answer than the critical intensity"
                )
                return at
            return at | {"intensity": self.intensity}
        self.refuse("intensity", only_with="instantaneous pulses")
        if self.answer_name not in ("rotation-ratio", "rotation", "margin"):
            raise ValueError(
                "answer must be rotation-ratio, rotation or margin under a pulse or a record,"
                f" got {self.answer_name}"
            )
        check("ratio", self.ratio, POSITIVE)
        if self.records is not None:
            self.refuse("answer", "relative_change", only_with="one motion")
            return at | {"scale": self.scale}
        motion: Any = self.motion
        if self.pulse is None:
            return at | {"scale": self.scale}
        # The amplitude of the motion has the factor on it already.
        return at | {"amplitude": float(motion.amplitude), "duration": float(motion.duration)}

    def make_ranges(self, at: Mapping[str, float]) -> dict[str, tuple[float, float]]:
        """Make the ranges of the tornado."""
        low = 1 - self.relative_change
        high = 1 + self.relative_change
        ranges = {name: (value * low, value * high) for name, value in at.items()}
        # Beyond 1 an impact would give energy to the block.
        c = at["restitution"]
        return ranges | {"restitution": (c * low, min(c * high, 1.0))}

    def refuse_answer(self, at: Mapping[str, float]) -> str:
        """Write that the answer does not exist for a block that overturns."""
        given = f"restitution {at['restitution']:.4g}"
        given += "" if self.shaken else f" and {at['intensity']:g} m/s"
        return f"answer {self.answer_name} does not exist here: the block overturns at {given}"

    def compute_answer(self, at: Mapping[str, Number]) -> Reals:
        """Compute an answer of resonance from the parameters, which may be traced."""
        constant = {"gravity": self.gravity, "inertia_ratio": self.inertia_ratio}
        block = block_of({**at, **constant})
        if self.answer_name == "critical-intensity":
            return resonance.critical_intensity(
                block, at["restitution"], math.inf, self.model_name
            )
        scene = resonance.Scene(block, at["restitution"], at["intensity"])
        return _OF_SCENE[self.answer_name](scene, self.model_name)


_OF_SCENE = {
    "rotation-ratio": resonance.rotation_ratio,
    "rotation": resonance.stabilized_rotation,
    "period": resonance.stabilized_period,
    "amplification": resonance.amplification,
    "margin": resonance.overturning_margin,
}
