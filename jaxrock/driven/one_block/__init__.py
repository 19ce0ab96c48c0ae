"""One block, from event to event by diffrax: the reference, with derivatives in both modes."""

from .event_loop import FollowedMotion as FollowedMotion
from .event_loop import follow_driven as follow_driven
from .respond_one import respond as respond
from .response import Response as Response
