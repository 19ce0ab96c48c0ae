"""Reports: the paper recomputed, one block assessed, a page about a table of objects."""

from . import assessment, paper
from .assessment import assess, assess_block
from .inventory_page import list_remarks as list_remarks
from .inventory_page import name_theory as name_theory
from .inventory_page import write_inventory_page

__all__ = ["assess", "assess_block", "assessment", "paper", "write_inventory_page"]
