"""One block, from event to event by diffrax: the reference, with derivatives in both modes."""

from .impact_to_impact import Followed, run
from .respond_one import respond
from .response import Response, Status

__all__ = ["Followed", "Response", "Status", "respond", "run"]
