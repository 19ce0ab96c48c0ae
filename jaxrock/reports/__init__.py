"""Reports: the paper recomputed, and one block assessed."""

from . import paper
from .assessment import Assessment, assess, assess_block

__all__ = ["Assessment", "assess", "assess_block", "paper"]
