"""The numbers that the paper's claims and faults are about, by their names in ``data/paper.json``.

Shares and changes are in percent; a pair is the least and the largest.
"""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ..block import Block
from ..resonance import (
    Linearized,
    Nonlinear,
    Oscillator,
    Scene,
    damping_from_decay,
    equivalent_damping,
    equivalent_damping_as_printed,
    half_cycle_velocity,
    launch_velocity,
    overturning_half_cycle,
    stabilized_velocity,
)
from ..spectra import resonance_spectrum

if TYPE_CHECKING:
    import xarray

MODELS = LINEARIZED, NONLINEAR = Linearized(), Nonlinear()
INTENSITY = 0.15
_WIDTHS = np.array([0.4, 0.6, 0.8, 1.0, 1.2])
_SLENDERNESS = np.linspace(3.0, 10.0, 701)
_RESTITUTION = np.append(np.linspace(0.5, 0.7, 41).round(3), [0.75, 0.8, 0.85])


def paper_scene(slenderness: Any, width: Any, restitution: Any) -> Scene:
    """A block under the pulses of the paper."""
    return Scene(Block(width / 2, slenderness), restitution, INTENSITY)


def paper_spectrum() -> "xarray.Dataset":
    """The stabilized phase over all that the paper draws and makes claims about."""
    return resonance_spectrum(_SLENDERNESS, _WIDTHS, _RESTITUTION, INTENSITY, chunk=2**20)


def paper_numbers() -> dict[str, np.ndarray]:
    """All of them."""
    parts = _of_one_pulse, _of_the_spectrum, _of_the_map, _of_damping, _of_linearizing
    return {name: np.asarray(value) for part in parts for name, value in part().items()}


def _of_one_pulse() -> dict[str, Any]:
    """Eq. 2, Tables I and II: axis 0 is the slenderness, axis 1 the width."""
    scene = paper_scene(_SLENDERNESS[:, None], _WIDTHS[None], 0.6)
    block, launch = scene.block, np.asarray(launch_velocity(scene))
    peak = np.asarray(LINEARIZED.peak_rotation(block, launch))
    duration = np.asarray(LINEARIZED.half_cycle_duration(block, launch))
    doubled = np.asarray(launch_velocity(Scene(block, 0.6, 2 * INTENSITY)))
    return {
        "launch": (launch[-1, -1], launch[0, 0]),
        "launch_doubled": _range(doubled / launch),
        "launch_by_slenderness": _steps(launch, 0),
        "launch_by_size": _steps(launch, 1),
        "peak_by_slenderness": _steps(peak, 0),
        "peak_by_size": _steps(peak, 1),
        "peak_growth": _range(100 * (peak[-1] / peak[0] - 1)),
        "duration_by_slenderness": _steps(duration, 0),
        "duration_and_size": 100 * (1 - duration[:, -1] / duration[:, 0]).max(),
    }


def _of_the_spectrum() -> dict[str, Any]:
    """Figs. 3 to 8 and the amplification of Table III."""
    spectrum = paper_spectrum()
    at_05, at_06, at_08 = (spectrum.sel(restitution=c) for c in (0.5, 0.6, 0.8))
    upward = spectrum.sel(restitution=slice(0.5, 0.7))
    period, ratio, zeta = (
        at_06[name].values for name in ("period", "rotation_ratio", "amplification")
    )
    of_08 = upward.period.sel(width=0.8).values
    growth = (at_08.amplification / at_05.amplification)[0]
    by_size = (each.amplification.sel(slenderness=4.0).values for each in (at_05, at_08))
    limits = np.where(at_08.overturning_margin > 0, _SLENDERNESS[:, None], 0).max(axis=0)
    highest = float(spectrum.amplification.sel(slenderness=4.0, width=1.2, restitution=0.85))
    elastic = float(Oscillator(1.0, 0.05).amplification)
    return {
        "period_by_slenderness": _steps(period, 0),
        "period_growth": _range(period[-1] / period[0]),
        "period_and_size": _range(100 * (1 - period[:, -1] / period[:, 0])),
        "period_by_restitution": _steps(of_08, 1),
        "period_stocky": of_08[0, [0, -1]],
        "period_slender": of_08[-1, [0, -1]],
        "amplification_growth": _range(growth),
        "amplification_and_slenderness": 100 * (zeta[-1] / zeta[0] - 1).max(),
        "amplification_and_size": [100 * np.ptp(each) / each.min() for each in by_size],
        "margin": _range(at_06.overturning_margin),
        "limits": limits,
        "ratio_by_slenderness": _steps(ratio, 0),
        "ratio_by_size": _steps(ratio, 1),
        "ratio_by_restitution": _steps(upward.rotation_ratio.sel(width=1.2), 1),
        "ratio_power": _range(
            np.gradient(np.log(ratio), np.log(_SLENDERNESS), axis=0, edge_order=2)
        ),
        "amplifications": (highest, elastic, highest / elastic),
    }


def _of_the_map() -> dict[str, Any]:
    """Eq. 8, whose sum as printed stands beside its recursion, and Table III at C = 0.9."""
    scene = paper_scene(4.0, 1.2, 0.6)
    recursion = sum(0.6**j for j in range(5))
    fifth = float(half_cycle_velocity(scene, 5) / launch_velocity(scene))
    printed = recursion - 0.6**4
    scene = paper_scene(4.0, 1.2, 0.9)
    settled = stabilized_velocity(scene) / LINEARIZED.critical_velocity(scene.block)
    velocity = half_cycle_velocity(scene, np.array([1.0, 30.0]))
    first, last = np.asarray(LINEARIZED.peak_rotation(scene.block, velocity))
    return {
        "sums": (printed, recursion),
        "sum_share": (printed / recursion, fifth / recursion),
        "settled": settled,
        "overturns": overturning_half_cycle(scene),
        "last_amplification": last / first,
    }


def _of_damping() -> dict[str, Any]:
    """Eqs. 13, 18 and 22."""
    functions = (equivalent_damping_as_printed, equivalent_damping, damping_from_decay)
    printed, meant, elastic = (float(function(0.85)) for function in functions)
    oscillator = Oscillator(2 * math.pi, np.array([0.05, 0.17]))
    largest = oscillator.peak_displacement(1.0)
    return {
        "dampings": (printed, meant, elastic),
        "damping_ratios": (meant / printed, printed / elastic, meant / elastic),
        "psi": (Oscillator(1.0, 0.01).amplification, 1 / (1 - 0.97)),
        "excess": 100 * (largest / oscillator.quarter_cycle_displacement(1.0) - 1),
    }


def _of_linearizing() -> dict[str, Any]:
    """What it costs at slenderness 3, up to 0.9 of the critical velocity and close to it."""
    block = Block(0.5, 3.0)
    critical, true = (float(model.critical_velocity(block)) for model in MODELS)
    velocity = np.append(np.linspace(1e-3, 0.9, 200), 0.995) * critical
    peak, true_peak = (np.asarray(model.peak_rotation(block, velocity)) for model in MODELS)
    time, true_time = (np.asarray(model.half_cycle_duration(block, velocity)) for model in MODELS)
    peak, time = 100 * (1 - peak / true_peak), 100 * (1 - time / true_time)
    return {
        "short_peak": _range(peak[:-1]),
        "short_duration": _range(time[:-1]),
        "at_the_verge": (peak[-1], time[-1], 100 * (critical / true - 1)),
    }


def _range(values: Any) -> tuple[Any, Any]:
    return np.min(values), np.max(values)


def _steps(values: Any, axis: int) -> tuple[Any, Any]:
    """From one value to the next: above 0 where they rise, below 0 where they fall."""
    return _range(np.diff(values, axis=axis))
