"""Risk at a site: fragility curves, rates of overturning, and sizes that meet a target rate."""

from .fragility_curves import describe_fragility as describe_fragility
from .fragility_curves import fragility
from .fragility_curves import tabulate_fragility as tabulate_fragility
from .hazard import Hazard
from .hazard import write_years as write_years
from .hazard_files import read_hazard
from .inventory import Inventory
from .inventory_assessment import assess_inventory
from .inventory_dataset import describe_inventory as describe_inventory
from .inventory_dataset import describe_place as describe_place
from .inventory_dataset import describe_years as describe_years
from .inventory_dataset import list_remarks as list_remarks
from .inventory_dataset import tabulate_inventory as tabulate_inventory
from .inventory_files import EXAMPLE_FILES as EXAMPLE_FILES
from .inventory_files import read_example_inventory as read_example_inventory
from .inventory_files import read_inventory
from .inventory_files import write_example_inventory as write_example_inventory
from .inventory_page import write_inventory_page
from .lognormal import LognormalFit as LognormalFit
from .overturning_rate import OverturningRate, overturning_rate
from .rate_elasticities import RateElasticities, rate_elasticities
from .required_value import RequiredValue, required_value
from .site import Site

__all__ = ["Hazard", "OverturningRate", "RateElasticities", "Site", "fragility"]
__all__ += ["RequiredValue", "overturning_rate", "rate_elasticities", "read_hazard"]
__all__ += ["Inventory", "assess_inventory", "read_inventory", "required_value"]
__all__ += ["write_inventory_page"]
