"""Driven motion: the equation, the overturning criterion, one block and many blocks.

`one_block` integrates one motion from event to event with diffrax. `many_blocks` integrates
thousands of motions in parallel with Taylor series. Both use `equation` and
`overturning_criterion`.
"""

from .completeness import require_complete as require_complete
from .equation import Equation as Equation
from .equation import uplift_acceleration as uplift_acceleration
from .many_blocks import TOLERANCES as TOLERANCES
from .many_blocks import Batch as Batch
from .many_blocks import BatchResponse, EstimatedResponse, respond_batch, respond_within
from .many_blocks import GroundMotions as GroundMotions
from .many_blocks import RecordVariants as RecordVariants
from .many_blocks import SimulatedAnswer as SimulatedAnswer
from .many_blocks import call_as_one_function as call_as_one_function
from .many_blocks import check_batch as check_batch
from .many_blocks import differentiate_within as differentiate_within
from .many_blocks import find_slope_scale as find_slope_scale
from .many_blocks import follow_batch as follow_batch
from .many_blocks import follow_within as follow_within
from .many_blocks import jit_steps as jit_steps
from .many_blocks import simulate_batch as simulate_batch
from .one_block import FollowedMotion as FollowedMotion
from .one_block import Response, respond
from .one_block import follow_driven as follow_driven
from .overturning_criterion import TOPPLED_ROTATION as TOPPLED_ROTATION
from .overturning_criterion import free_motion_margin
from .scene import Driven as Driven

__all__ = [
    "BatchResponse",
    "EstimatedResponse",
    "Response",
    "free_motion_margin",
    "respond",
    "respond_batch",
    "respond_within",
]
