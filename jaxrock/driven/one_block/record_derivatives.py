"""A response with derivatives with respect to the samples of a record, in both modes."""

import equinox as eqx
import jax

from ...numerics import refuse_reverse_mode, transpose_by
from ...validation import Reals
from ..many_blocks import Batch, follow_batch
from ..scene import Driven
from .response import Response

# Steps of the batch end at each sample anyway: for this tolerance few are added.
_TOLERANCE = 1e-12
_SWEPT = "final_rotation", "final_velocity", "peak_rotation", "margin"


def transpose_by_sweep(driven: Driven, response: Response) -> Response:
    """Give a response, differentiable in forward mode, reverse mode with respect to samples.

    The batch solves the same equation, and its sweep goes back from the final state and from the
    peak. Reverse mode of the other answers is refused.
    """

    def follow(driven: Driven) -> list[Reals]:
        batch = Batch.of(
            driven.block,
            driven.restitution,
            driven.motion,
            driven.duration,
            rotation=driven.rotation,
            velocity=driven.velocity,
            rtol=_TOLERANCE,
        )
        answers = follow_batch(batch, response.model)
        return [getattr(answers, name) for name in _SWEPT]

    def pull(driven: Driven, cotangents: list[Reals]) -> Driven:
        return eqx.filter_vjp(follow, driven)[1](cotangents)[0]

    def get_swept(response: Response) -> list[Reals]:
        return [getattr(response, name) for name in _SWEPT]

    swept = transpose_by(pull, driven, get_swept(response))
    name = f"with respect to samples, whatever is not {', '.join(_SWEPT)}"
    return eqx.tree_at(get_swept, refuse_reverse_mode(name, response), swept)
