"""``jaxrock assess``."""

from dataclasses import dataclass

from ..reports import assessment
from ..resonance import Scene
from ..validation import POSITIVE, check
from .options import Answer, BlockOptions


@dataclass(frozen=True, kw_only=True)
class Assess(BlockOptions):
    """Assess one block under pulses timed to its impacts.

    Geometry, the response to one pulse, the stabilized phase or the half-cycle in which the
    block overturns, critical pulse intensities and sensitivities, by the linearized and the
    nonlinear equation side by side.

    Example: jaxrock assess --width 0.8 --height 4 --restitution 0.7
    """

    intensity: float = 0.15
    """Change of ground velocity in each pulse [m/s]."""
    tolerance: float | None = None
    """Name the equation and the precision that are good enough for this relative error."""

    @property
    def scene(self) -> Scene:
        """The block under its pulses."""
        return Scene(self.block, self.coefficient, self.intensity)

    def check(self) -> None:
        """The scene, and the tolerance."""
        _ = self.scene
        if self.tolerance is not None:
            check("tolerance", self.tolerance, POSITIVE)

    def run(self) -> Answer:
        """Assess the scene."""
        result = assessment.assess(self.scene, self.tolerance)
        return Answer(assessment.text(result), result)
