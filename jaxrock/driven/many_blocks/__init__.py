"""Many blocks side by side, each at its own pace, by Taylor polynomials."""

from .batch import Batch
from .compiler_options import jit_steps
from .ground_motions import GroundMotions, convert_motion
from .ground_motions import RecordVariants as RecordVariants
from .respond_many import (
    BatchResponse,
    check_batch,
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
    "convert_motion",
    "follow_batch",
    "follow_within",
    "jit_steps",
    "respond_batch",
    "respond_within",
]
