"""Risk of motion beyond a limit: fragility under a suite of records, yearly rates."""

from .fragility_curves import fragility
from .fragility_curves import name_thresholds as name_thresholds
from .hazard import Hazard
from .hazard_files import read_hazard
from .inventory import Inventory
from .inventory_assessment import assess_inventory
from .inventory_assessment import describe_need as describe_need
from .inventory_files import read_inventory
from .lognormal import LognormalFit as LognormalFit
from .overturning_rate import OverturningRate, overturning_rate
from .rate_elasticities import RateElasticities, rate_elasticities
from .required_value import RequiredValue, required_value

__all__ = ["Hazard", "OverturningRate", "RateElasticities", "fragility", "overturning_rate"]
__all__ += ["RequiredValue", "rate_elasticities", "read_hazard", "required_value"]
__all__ += ["Inventory", "assess_inventory", "read_inventory"]
