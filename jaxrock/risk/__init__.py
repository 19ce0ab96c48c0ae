"""Risk of motion beyond a limit: fragility under a suite of records, yearly rates."""

from .fragility_curves import fragility
from .fragility_curves import name_thresholds as name_thresholds
from .hazard import Hazard
from .hazard_files import read_hazard
from .lognormal import LognormalFit as LognormalFit
from .overturning_rate import OverturningRate, overturning_rate
from .rate_elasticities import RateElasticities, rate_elasticities

__all__ = ["Hazard", "OverturningRate", "RateElasticities", "fragility", "overturning_rate"]
__all__ += ["rate_elasticities", "read_hazard"]
