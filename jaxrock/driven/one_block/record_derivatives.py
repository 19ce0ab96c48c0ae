"""Reverse mode of a response with respect to the samples of a record."""

from typing import Any

import equinox as eqx

from ...numerics import refuse_reverse_mode, transpose_by
from ...validation import Reals
from .. import Batch, follow_batch
from ..scene import Driven
from .response import Response

# Steps of the batch end at each sample anyway: this tolerance adds few.
_TOLERANCE = 1e-12
_SWEPT = "peak_rotation", "final_rotation", "final_velocity", "margin"


def transpose_by_sweep(driven: Driven, response: Response) -> Response:
    """Give a response, which has derivatives in forward mode, reverse mode as well.

    Reverse mode uses the sweep of the batch, which solves the same equation. The sweep goes
    back from the peak and from the final state: for other answers reverse mode is refused.
    """

    def get_swept(response: Any) -> list:
        return [getattr(response, name) for name in _SWEPT]

    def follow(driven: Driven) -> list[Reals]:
        batch = Batch.of(**vars(driven), rtol=_TOLERANCE)
        return get_swept(follow_batch(batch, response.model))

    def pull(driven: Driven, cotangents: list[Reals]) -> Driven:
        return eqx.filter_vjp(follow, driven)[1](cotangents)[0]

    swept = transpose_by(driven, get_swept(response), pull=pull)
    name = f"with respect to samples, an answer that is not {', '.join(_SWEPT)}"
    return eqx.tree_at(get_swept, refuse_reverse_mode(name, response), swept)
