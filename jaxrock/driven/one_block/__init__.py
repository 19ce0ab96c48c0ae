"""One block, from event to event by diffrax: the reference, with derivatives in both modes."""

from .impact_to_impact import FollowedMotion, follow_scene
from .respond_one import respond
from .response import Response, Status

__all__ = ["FollowedMotion", "Response", "Status", "follow_scene", "respond"]
