"""The paper regenerated, one block assessed, a table of objects."""

from . import assessment, paper
from .assessment import assess
from .inventory_details import list_remarks as list_remarks
from .inventory_details import name_theory as name_theory
from .inventory_page import write_inventory_page

__all__ = ["assess", "assessment", "paper", "write_inventory_page"]
