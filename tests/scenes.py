"""Scenes that tests share: of few shapes, so that what one test compiles serves others."""

import numpy as np

GRID = {
    "slenderness": np.linspace(3, 10, 8),
    "width": [0.4, 0.8, 1.2],
    "restitution": [0.6, 0.9],
    "intensity": 0.15,
}
