"""The command that assesses one block."""

from .. import resonance
from ..reports import assessment
from ..validation import POSITIVE, check
from .answers import Answer
from .options import BlockOptions, Output


def assess(
    *,
    intensity: float = 0.15,
    tolerance: float | None = None,
    block_options: BlockOptions = BlockOptions(),
    output: Output = Output(),
) -> Answer:
    """Assess one block under pulses timed to its impacts.

    Prints geometry, the response to one pulse, the stabilized phase or the half-cycle in
    which the block overturns, critical pulse intensities and sensitivities, by the linearized
    and the nonlinear equation side by side. With a height, sensitivities are with respect to
    the width at this height and the height at this width. Else they are with respect to the
    half-width at this slenderness and the slenderness.

    Example: jaxrock assess --width 0.8 --height 4 --restitution 0.7

    Parameters
    ----------
    intensity
        Change of ground velocity in each pulse [m/s].
    tolerance
        Relative error [-]: name the cheapest equation and precision within it.
    """
    block = block_options.block
    c = block_options.coefficient
    if tolerance is not None:
        check("tolerance", tolerance, POSITIVE)
    scene = resonance.Scene(block, c, intensity)
    answers = assessment.assess(scene, tolerance)
    # Who gives a height thinks of sides, and who gives none of size and slenderness.
    by_sides = block_options.height is not None
    return Answer(assessment.write_text(answers, by_sides=by_sides), answers, output)
