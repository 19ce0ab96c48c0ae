"""One block, from event to event by diffrax: the reference, with derivatives in both modes."""

from .event_loop import FollowedMotion, follow_driven
from .respond_one import respond
from .response import Response

__all__ = ["FollowedMotion", "Response", "follow_driven", "respond"]
