"""The paper regenerated, one block assessed, a table of objects, the conformance table."""

from . import assessment, conformance, paper
from .assessment import assess
from .inventory_page import list_remarks as list_remarks
from .inventory_page import write_inventory_page

__all__ = ["assess", "assessment", "conformance", "paper", "write_inventory_page"]
