"""Many blocks side by side, each at its own pace, by Taylor polynomials."""

from .batch import Batch, GroundMotions, ground_of
from .launched_blocks import peak_after_launch
from .respond_many import (
    BatchResponse,
    check_batch,
    compiler_options,
    follow_batch,
    respond_batch,
)
from .to_tolerance import TOLERANCES, EstimatedResponse, follow_within, respond_within

__all__ = [
    "TOLERANCES",
    "Batch",
    "BatchResponse",
    "EstimatedResponse",
    "GroundMotions",
    "check_batch",
    "compiler_options",
    "follow_batch",
    "follow_within",
    "ground_of",
    "peak_after_launch",
    "respond_batch",
    "respond_within",
]
