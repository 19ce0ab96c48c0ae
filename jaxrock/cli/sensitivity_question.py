"""The question of the command about sensitivities: an answer, and what it depends on."""

from typing import Literal, NamedTuple

from ..block import SHAPE, SIDES, Block, size_of
from ..overturning import UNITS
from ..sensitivity import Uncertain
from ..validation import POSITIVE, check
from .options import BlockOptions, ModelName

AnswerName = Literal[
    "rotation-ratio",
    "rotation",
    "stabilized-period",
    "amplification",
    "margin",
    "critical-intensity",
]
UNITS_OF_PARAMETERS = {**UNITS, "intensity": "m/s"}
_UNITS_OF_ANSWERS = {"rotation": "rad", "stabilized-period": "s", "critical-intensity": "m/s"}


class Question(NamedTuple):
    """An answer, the values of the parameters it depends on, and how uncertain these are.

    Attributes
    ----------
    answer : str
        Its name.
    model : str
        Equation of motion.
    block : Block
        With the parameters that are constant.
    sizes : tuple of str
        Names of the parameters that describe the size of the block.
    at : dict
        Values of the parameters, by name.
    relative_change : float
        By which the tornado lowers and raises each of them [-].
    coefficient_of_variation : float
        Of each of them [-].
    scene_text : str
        The size and the restitution of the block in words.
    """

    answer: AnswerName
    model: ModelName
    block: Block
    sizes: tuple[str, ...]
    at: dict[str, float]
    relative_change: float
    coefficient_of_variation: float
    scene_text: str

    @property
    def label(self) -> str:
        """The answer and its unit, for an axis."""
        unit = _UNITS_OF_ANSWERS.get(self.answer, "-")
        return f"{self.answer.replace('-', ' ')} [{unit}]"

    def make_ranges(self) -> dict[str, tuple[float, float]]:
        """Make the ranges of the tornado."""
        part = self.relative_change
        # An amplitude may be negative.
        ranges = {name: (x - part * abs(x), x + part * abs(x)) for name, x in self.at.items()}
        # Beyond 1 an impact would give energy to the block.
        low, high = ranges["restitution"]
        return ranges | {"restitution": (low, min(high, 1.0))}

    def make_uncertain(self, samples: int, seed: int = 0) -> Uncertain:
        """Make all parameters uncertain."""
        coefficients = dict.fromkeys(self.at, self.coefficient_of_variation)
        return Uncertain(coefficients, samples=samples, seed=seed)

    def describe_missing(self) -> str:
        """Say that there is no answer, since the block overturns."""
        given = f"restitution {self.at['restitution']:.4g}"
        if "intensity" in self.at:
            given += f" and {self.at['intensity']:g} m/s"
        return f"--answer {self.answer} does not exist here: the block overturns at {given}"


def ask(
    answer: AnswerName,
    model: ModelName,
    options: BlockOptions,
    relative_change: float,
    coefficient_of_variation: float,
) -> Question:
    """Check the options, and make the question; the motion adds parameters to it."""
    check("relative_change", relative_change, POSITIVE)
    if relative_change >= 1:
        raise ValueError(f"relative_change must be less than 1, got {relative_change:g}")
    check("coefficient_of_variation", coefficient_of_variation, POSITIVE)
    block = options.block
    names = SHAPE if options.height is None else SIDES
    size = size_of(block, "shape" if options.height is None else "sides")
    at = {name: float(size[name]) for name in names}
    at["restitution"] = options.coefficient
    return Question(
        answer,
        model,
        block,
        names,
        at,
        relative_change,
        coefficient_of_variation,
        options.scene_text,
    )
