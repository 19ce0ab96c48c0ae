"""Many blocks side by side, each at its own pace, by Taylor polynomials."""

from .batch import Batch
from .compiler_options import jit_steps
from .ground_motions import GroundMotions, convert_motion
from .ground_motions import RecordVariants as RecordVariants
from .prepared_blocks import BatchArguments
from .respond_many import (
    BatchResponse,
    SimulatedAnswer,
    check_batch,
    follow_batch,
    respond_batch,
    simulate_batch,
)
from .to_tolerance import (
    TOLERANCES,
    EstimatedResponse,
    differentiate_within,
    find_slope_scale,
    follow_within,
    respond_within,
)

__all__ = [
    "TOLERANCES",
    "Batch",
    "BatchArguments",
    "BatchResponse",
    "EstimatedResponse",
    "GroundMotions",
    "SimulatedAnswer",
    "check_batch",
    "convert_motion",
    "differentiate_within",
    "find_slope_scale",
    "follow_batch",
    "follow_within",
    "jit_steps",
    "respond_batch",
    "respond_within",
    "simulate_batch",
]
