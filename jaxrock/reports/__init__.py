"""Reports: the paper recomputed, and one block assessed."""

from . import paper
from .assessment import Assessment, assess

__all__ = ["Assessment", "assess", "paper"]
