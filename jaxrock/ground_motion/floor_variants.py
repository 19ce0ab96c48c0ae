"""Floors that differ a little from the one on which a suite is."""

from ..validation import Numbers
from .floor import compute_floor_motion, multiply_floor, replace_motion
from .record import Record
from .suite import Suite


def vary_floor(
    suite: Suite, period_factor: Numbers, damping_factor: Numbers
) -> tuple[Record, ...]:
    """Compute the motions of floors whose periods and dampings are multiplied by factors.

    Parameters
    ----------
    suite : Suite
        On a floor.
    period_factor, damping_factor : array_like, shape (floors,)
        Factors on the periods, greater than 0, and on the dampings, at least 0 [-].

    Returns
    -------
    tuple of Record
        One for each record, whose samples have an axis of floors.
    """
    assert suite.ground is not None
    assert suite.floor is not None
    floors = multiply_floor(suite.floor, period_factor, damping_factor)
    motions = [
        compute_floor_motion(record.acceleration, record.vertical, record.time_step, floors)
        for record in suite.ground
    ]
    pairs = zip(suite.ground, motions, strict=True)
    return tuple(replace_motion(record, motion) for record, motion in pairs)
