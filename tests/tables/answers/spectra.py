"""Spectra: grids of blocks, labelled."""

import numpy as np
from scenes import GRID, record, suite

import jaxrock as jr

from .table import group, list_variables

group("spectra/resonance", by_default=True)(
    lambda: list_variables(jr.resonance_spectrum(**GRID))
)


@group("spectra/resonance_of_models")
def compute_resonance_of_models():
    nonlinear = jr.resonance_spectrum(**GRID, model="nonlinear")
    yield from list_variables(nonlinear, "nonlinear/")
    grid = GRID | {"intensity": [0.02, 0.2]}
    cheapest = jr.resonance_spectrum(**grid, model="auto", tolerance=0.01)
    yield from list_variables(cheapest, "auto/")
    walls = jr.resonance_spectrum(**GRID, one_sided=True, gravity=1.62, inertia_ratio=1.5)
    yield from list_variables(walls, "one_sided/")


@group("spectra/rocking", 1e-8)
def compute_rocking():
    found = jr.rocking_spectrum(record(), [1.0, 2.0, 3.0], [4.0, 6.0], 0.7)
    yield from list_variables(found, "record/")
    found = jr.rocking_spectrum(suite(), [1.0, 2.0], 5.0, [0.5, 0.7], factor=[0.5, 1.0])
    yield from list_variables(found, "suite/")


group("spectra/overturning", 1e-9, by_default=True)(
    lambda: list_variables(
        jr.overturning_map(jr.Sine, [2.0, 4.0], amplitude_ratio=[0.9, 2.0, 8.0])
    )
)


@group("spectra/overturning_map", 1e-9)
def map_overturning():
    ratios = np.linspace(1.0, 4.0, 4)
    found = jr.overturning_map(jr.Sine, ratios, restitution=0.9)
    yield from list_variables(found, "sine/")
    found = jr.overturning_map(jr.HalfSine, ratios, one_sided=True, model="linearized")
    yield from list_variables(found, "one_sided/")


@group("spectra/harmonic", 1e-8)
def compute_harmonic():
    ratios = ([2.0, 4.0, 7.0], [0.1, 0.9, 1.5, 4.0])
    found = jr.spectra.harmonic_spectrum(*ratios, slenderness=4.0, restitution=0.85, cycles=10)
    yield from list_variables(found, "nonlinear/")
    found = jr.spectra.harmonic_spectrum(
        *ratios, restitution=0.85, cycles=10, model="linearized"
    )
    yield from list_variables(found, "linearized/")
