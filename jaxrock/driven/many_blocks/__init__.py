"""Many blocks side by side, each at its own pace, by Taylor polynomials."""

from .batch import Batch as Batch
from .ground_motions import GroundMotions as GroundMotions
from .ground_motions import RecordVariants as RecordVariants
from .respond_many import BatchResponse as BatchResponse
from .respond_many import SimulatedAnswer as SimulatedAnswer
from .respond_many import check_batch as check_batch
from .respond_many import follow_batch as follow_batch
from .respond_many import respond_batch as respond_batch
from .respond_many import simulate_batch as simulate_batch
from .single_kernels import call_as_one_function as call_as_one_function
from .single_kernels import jit_steps as jit_steps
from .to_tolerance import TOLERANCES as TOLERANCES
from .to_tolerance import EstimatedResponse as EstimatedResponse
from .to_tolerance import differentiate_within as differentiate_within
from .to_tolerance import find_slope_scale as find_slope_scale
from .to_tolerance import follow_within as follow_within
from .to_tolerance import respond_within as respond_within
