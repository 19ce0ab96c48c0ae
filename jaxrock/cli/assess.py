"""The command that assesses one block."""

from .. import resonance
from ..reports import assessment
from ..validation import POSITIVE, check
from .answers import Answer
from .options import BlockOptions, Output, refuse, warn_of_intensity


def assess(
    *,
    intensity: float | None = None,
    tolerance: float | None = None,
    block_options: BlockOptions = BlockOptions(),
    output: Output = Output(),
) -> Answer:
    """Assess one block: its geometry, and the ground pulses that overturn it.

    Critical intensities are for pulses at the worst moments, right after each impact. With an
    intensity, the command also computes the response to one pulse of this intensity, the
    stabilized phase or the half-cycle in which the block overturns, and sensitivities. Answers
    of the linearized and the nonlinear equation stand side by side. With a height, it gives
    sensitivities to the width at this height and to the height at this width. Without one, it
    gives them to the half-width at this slenderness and to the slenderness.

    Example: jaxrock assess --width 0.8 --height 4 --restitution 0.7 --intensity 0.15

    Parameters
    ----------
    intensity
        Change of ground velocity in each pulse [m/s].
    tolerance
        With an intensity, name the equation and the precision that are good enough for this
        relative error.
    """
    block = block_options.block
    c = block_options.coefficient
    if intensity is None:
        refuse("--intensity", tolerance=tolerance)
        answers = assessment.assess_block(block, c)
    else:
        warn_of_intensity(intensity)
        if tolerance is not None:
            check("tolerance", tolerance, POSITIVE)
        answers = assessment.assess(resonance.Scene(block, c, intensity), tolerance)
    answers["scene"]["restitution_assumed"] = block_options.restitution is None
    # Who gives a height thinks of sides, and who gives none of size and slenderness.
    by_sides = block_options.height is not None
    text = assessment.write_text(
        answers, by_sides=by_sides, restitution=block_options.restitution_text
    )
    return Answer(text, answers, output)
