"""Today's answers, room by room: ``python tests/tools/write_answers.py`` writes the table."""

from . import (
    accuracy,
    calibration,
    commands,
    driven,
    ground_motion,
    half_cycle_map,
    overturning,
    risk,
    sensitivity,
    spectra,
    steady,
    trains,
)

# Their groups are registered when they are imported.
ROOMS = (half_cycle_map, trains, ground_motion, driven, steady, overturning)
ROOMS += (sensitivity, calibration, accuracy, spectra, risk, commands)
