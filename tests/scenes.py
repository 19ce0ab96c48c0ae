"""Scenes that tests share: of few shapes, so that what one test compiles serves others."""

import numpy as np

import jaxrock as jr

GRID = {
    "slenderness": np.linspace(3, 10, 8),
    "width": [0.4, 0.8, 1.2],
    "restitution": [0.6, 0.9],
    "intensity": 0.15,
}


def record(samples=200, seed=0):
    """Noise that rises and falls, strong enough for slender blocks."""
    noise = np.random.default_rng(seed).standard_normal(samples)
    return jr.Record(5 * noise * np.sin(np.pi * np.linspace(0, 1, samples)), 0.02)


def suite(seed=0):
    """Three records of three lengths."""
    records = [record(samples, seed + k) for k, samples in enumerate((150, 200, 120))]
    return jr.Suite(records, ["first", "second", "third"])


def impact_times(block, launch, restitution, count=12):
    """Of a linearized block that is launched at so many times its critical velocity."""
    ratios = launch * restitution ** np.arange(count - 1)
    halves = 2 / float(block.frequency_parameter) * np.arctanh(ratios)
    return np.cumsum([0.0, *halves])
