"""The paper regenerated, one block assessed, the conformance table."""

from . import assessment, conformance, paper
from .assessment import assess

__all__ = ["assess", "assessment", "conformance", "paper"]
