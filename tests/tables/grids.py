"""Every function that takes chunks, on a small grid, with chunks that do not divide it evenly."""

import numpy as np
from scenes import record, suite

import jaxrock as jr

AXES = (np.linspace(3, 9, 5), [0.4, 0.8, 1.2], [0.6, 0.9])
RATIOS = np.linspace(1.0, 4.0, 5)

GRIDS = {
    "resonance": (
        lambda **chunks: jr.resonance_spectrum(*AXES, [0.1, 0.15], **chunks),
        {"slenderness": 2, "width": 2, "intensity": 1},
    ),
    "resonance, each by its model": (
        lambda **chunks: jr.resonance_spectrum(
            *AXES, 0.15, model="auto", tolerance=0.01, **chunks
        ),
        {"slenderness": 2},
    ),
    "rocking": (
        lambda **chunks: jr.rocking_spectrum(
            record(200, 3), [1.0, 2.0, 3.0], [4.0, 6.0], **chunks
        ),
        {"free_period": 2, "slenderness": 1},
    ),
    "rocking of a suite": (
        lambda **chunks: jr.rocking_spectrum(
            suite(),
            [1.0, 2.0],
            5.0,
            [0.7, 0.9],
            factor=[0.5, 1.0, 2.0],
            tolerance=1e-3,
            **chunks,
        ),
        {"record": 2, "factor": 2},
    ),
    "overturning": (
        lambda **chunks: jr.overturning_map(
            jr.Sine, RATIOS, amplitude_ratio=[0.9, 2.0, 8.0], **chunks
        ),
        {"frequency_ratio": 2, "amplitude_ratio": 2},
    ),
    "overturning map": (
        lambda **chunks: jr.overturning_map(jr.HalfSine, RATIOS, **chunks).isel(boundary=[0]),
        {"frequency_ratio": 2},
    ),
    "harmonic": (
        lambda **chunks: jr.spectra.harmonic_spectrum(
            [3.0, 6.0, 9.0], [0.1, 1.2], cycles=3, **chunks
        ),
        {"frequency_ratio": 2},
    ),
}
