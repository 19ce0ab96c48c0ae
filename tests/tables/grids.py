"""Every function that takes chunks, on a small grid, with chunks that divide it and that do not."""

import numpy as np
from scenes import record, suite

import jaxrock as jr

BLOCK = jr.Block(0.1, 5.0)


AXES = (np.linspace(3, 9, 5), [0.4, 0.8, 1.2], [0.6, 0.9])
RATIOS = np.linspace(1.0, 4.0, 5)

GRIDS = {
    "resonance": (
        lambda **chunks: jr.resonance_spectrum(*AXES, [0.1, 0.15], **chunks),
        [{"slenderness": 5, "intensity": 1}, {"slenderness": 2, "width": 2}, "auto"],
    ),
    "resonance, each by its model": (
        lambda **chunks: jr.resonance_spectrum(
            *AXES, 0.15, model="auto", tolerance=0.01, **chunks
        ),
        [{"slenderness": 2}],
    ),
    "rocking": (
        lambda **chunks: jr.rocking_spectrum(
            record(200, 3), [1.0, 2.0, 3.0], [4.0, 6.0], **chunks
        ),
        [{"free_period": 1}, {"free_period": 2, "slenderness": 1}],
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
        [{"record": 1, "factor": 3}, {"record": 2, "factor": 2}],
    ),
    "overturning": (
        lambda **chunks: jr.overturning_spectrum(jr.Sine, RATIOS, [0.9, 2.0, 8.0], **chunks),
        [{"frequency_ratio": 2, "amplitude_ratio": 2}],
    ),
    "overturning map": (
        lambda **chunks: jr.overturning_map(jr.HalfSine, RATIOS, max_boundaries=2, **chunks),
        [{"frequency_ratio": 1}, {"frequency_ratio": 2}],
    ),
    "harmonic": (
        lambda **chunks: jr.harmonic_spectrum([3.0, 6.0, 9.0], [0.1, 1.2], cycles=3, **chunks),
        [{"frequency_ratio": 2}],
    ),
}


def same_bits(found, expected):
    """Two datasets, to the last bit and attribute; the names of what differs."""
    assert found.sizes == expected.sizes
    assert found.attrs == expected.attrs
    wrong = [
        name
        for name in (*expected.coords, *expected.data_vars)
        if found[name].values.tobytes() != expected[name].values.tobytes()
        or found[name].dtype != expected[name].dtype
        or found[name].dims != expected[name].dims
        or repr(found[name].attrs) != repr(expected[name].attrs)
    ]
    assert not wrong


def blocks(**chunks):
    """Fifteen chunks that take a moment each."""
    motion = jr.example_record().scaled(1.5)
    return jr.rocking_spectrum(
        motion, np.linspace(1, 4, 15), np.linspace(3, 9, 20), 0.9, **chunks
    )
