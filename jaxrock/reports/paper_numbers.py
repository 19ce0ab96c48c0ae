"""Numbers of the paper, computed: those that it prints and those that its claims are about.

C. Casapulla, On the Resonance Conditions of Rigid Rocking Blocks. Numbers bear the names by
which ``data/paper.json`` asks for them. Fractions and changes are in percent; a pair of numbers
is the least and the largest.
"""

import math
from typing import TYPE_CHECKING

import numpy as np

from .. import resonance
from ..block import Block
from ..resonance import Linearized, Nonlinear, Oscillator, Scene
from ..spectra import resonance_spectrum

if TYPE_CHECKING:
    import xarray

_LINEARIZED = Linearized()
_MODELS = (_LINEARIZED, Nonlinear())
INTENSITY = 0.15
_WIDTHS = np.array([0.4, 0.6, 0.8, 1.0, 1.2])
_SLENDERNESS = np.linspace(3.0, 10.0, 701)
# Rounded, so that the values of the figures are found by their decimals. Claims are about all
# values of 0.5 to 0.7, and some beyond.
_RESTITUTION = np.append(np.linspace(0.5, 0.7, 41).round(3), [0.75, 0.8, 0.85])


def compute_numbers() -> dict[str, np.ndarray]:
    """Compute all numbers of the paper, by name."""
    parts = (
        _compute_tables,
        _compute_one_pulse,
        _compute_spectrum_claims,
        _compute_map_claims,
        _compute_damping_claims,
        _compute_linearization_claims,
    )
    return {name: np.asarray(value) for part in parts for name, value in part().items()}


def make_scene(
    slenderness: np.ndarray | float,
    width: np.ndarray | float,
    restitution: np.ndarray | float,
) -> Scene:
    """Make a block, or an array of them, under the pulses of the paper."""
    return Scene(Block(width / 2, slenderness), restitution, INTENSITY)


def compute_spectrum() -> "xarray.Dataset":
    """Compute the stabilized phase over all that the paper draws and makes claims about."""
    return resonance_spectrum(_SLENDERNESS, _WIDTHS, _RESTITUTION, INTENSITY)


def _compute_tables() -> dict[str, object]:
    """Compute the tables by both models; NaN where no block is involved."""
    block = Block(_WIDTHS[:, None] / 2, np.array([[3.0, 5.0, 8.0, 10.0]]))
    velocity = block.pulse_velocity(INTENSITY)
    durations = np.stack([model.half_cycle_duration(block, velocity) for model in _MODELS])
    oscillator = Oscillator(1.0, np.append(0.0, np.arange(1, 18, 2) / 100))
    decay = np.array([1.0, 0.97, 0.91, 0.85, 0.80, 0.75, 0.71, 0.66, 0.62, 0.58])
    restitution = np.arange(100, 50, -5) / 100
    # Of an oscillator and not of a block: no model is involved, and there is one column.
    elastic = {
        "velocity_decay": oscillator.velocity_decay,
        "damping_from_decay": resonance.damping_from_decay(decay),
        "elastic_amplification": oscillator.amplification,
        "equivalent_damping": resonance.equivalent_damping_as_printed(restitution),
    }
    scene = make_scene(4.0, 1.2, restitution)
    rocking = np.stack([resonance.amplification(scene, model) for model in _MODELS])
    return {
        "peaks": [model.peak_rotation(block, velocity) for model in _MODELS],
        "durations": durations,
        "duration_differences": 100 * (1 - durations[:, -1:] / durations[:, :1]),
        **{n: np.stack([v, np.full_like(v, np.nan)])[..., None] for n, v in elastic.items()},
        "rocking_amplification": rocking[..., None],
    }


def _compute_one_pulse() -> dict[str, object]:
    """Compute the claims on one pulse (Eq. 2, Tables I and II), by slenderness and width."""
    scene = make_scene(_SLENDERNESS[:, None], _WIDTHS[None], 0.6)
    block = scene.block
    launch = np.asarray(resonance.launch_velocity(scene))
    peak = np.asarray(_LINEARIZED.peak_rotation(block, launch))
    duration = np.asarray(_LINEARIZED.half_cycle_duration(block, launch))
    doubled = np.asarray(resonance.launch_velocity(Scene(block, 0.6, 2 * INTENSITY)))
    return {
        "launch": (launch[-1, -1], launch[0, 0]),
        "launch_doubled": _find_range(doubled / launch),
        "launch_by_slenderness": _find_range_of_steps(launch, 0),
        "launch_by_size": _find_range_of_steps(launch, 1),
        "peak_by_slenderness": _find_range_of_steps(peak, 0),
        "peak_by_size": _find_range_of_steps(peak, 1),
        "peak_growth": _find_range(100 * (peak[-1] / peak[0] - 1)),
        "duration_by_slenderness": _find_range_of_steps(duration, 0),
        "duration_and_size": 100 * (1 - duration[:, -1] / duration[:, 0]).max(),
    }


def _compute_spectrum_claims() -> dict[str, object]:
    """Compute the claims on Figs. 3 to 8 and on the amplification of Table III."""
    spectrum = compute_spectrum()
    at_05, at_06, at_08 = (spectrum.sel(restitution=c) for c in (0.5, 0.6, 0.8))
    upward = spectrum.sel(restitution=slice(0.5, 0.7))
    period, ratio = (at_06[name].values for name in ("stabilized_period", "rotation_ratio"))
    # By how much the narrowest block's is longer than the widest's.
    narrow, wide = (upward.stabilized_period.sel(width=width) for width in (0.4, 1.2))
    longer = 100 * (narrow / wide - 1).max("slenderness")
    zeta = spectrum.amplification.sel(restitution=[0.6, 0.7, 0.8])
    of_08 = upward.stabilized_period.sel(width=0.8).values
    growth = (at_08.amplification / at_05.amplification)[0]
    by_size = (part.amplification.sel(slenderness=4.0).values for part in (at_05, at_08))
    # In closed form, as Fig. 8 has them: a grid would end up to a step before them.
    limits = resonance.critical_slenderness(Block(_WIDTHS / 2, 1.0), 0.8, INTENSITY)
    highest = float(spectrum.amplification.sel(slenderness=4.0, width=1.2, restitution=0.85))
    elastic = float(Oscillator(1.0, 0.05).amplification)
    return {
        "period_by_slenderness": _find_range_of_steps(period, 0),
        "period_growth": _find_range(period[-1] / period[0]),
        "period_and_size": longer.sel(restitution=[0.6, 0.7]),
        "period_by_restitution": _find_range_of_steps(of_08, 1),
        "period_stocky": of_08[0, [0, -1]],
        "period_slender": of_08[-1, [0, -1]],
        "amplification_growth": _find_range(growth),
        "amplification_and_slenderness": (100 * (zeta / zeta[0] - 1)).max(zeta.dims[:2]),
        "amplification_and_size": [100 * np.ptp(zeta) / zeta.min() for zeta in by_size],
        "margin": _find_range(at_06.overturning_margin),
        "limits": limits,
        "ratio_by_slenderness": _find_range_of_steps(ratio, 0),
        "ratio_by_size": _find_range_of_steps(ratio, 1),
        "ratio_by_restitution": _find_range_of_steps(upward.rotation_ratio.sel(width=1.2), 1),
        "ratio_power": _find_powers(ratio),
        "ratio_power_beyond": _find_powers(upward.rotation_ratio.sel(restitution=0.7).values),
        "amplifications": (highest, elastic, highest / elastic),
    }


def _compute_map_claims() -> dict[str, object]:
    """Compute Eq. 8, its sum as printed beside its recursion, and Table III at C = 0.9."""
    scene = make_scene(4.0, 1.2, 0.6)
    # Of C = 0.6, and of B of 5 % of damping.
    decay = np.array([0.6, float(Oscillator(1.0, 0.05).velocity_decay)])
    recursion = (decay[:, None] ** np.arange(5)).sum(axis=1)
    fifth = float(resonance.half_cycle_velocity(scene, 5) / resonance.launch_velocity(scene))
    # The sums as printed end one pulse too early.
    printed = recursion - decay**4
    scene = make_scene(4.0, 1.2, 0.9)
    settled = resonance.stabilized_velocity(scene) / _LINEARIZED.critical_velocity(scene.block)
    velocity = resonance.half_cycle_velocity(scene, np.array([1.0, 30.0]))
    first, last = np.asarray(_LINEARIZED.peak_rotation(scene.block, velocity))
    return {
        "sums": (*printed, *recursion),
        "sum_fraction": (*(printed / recursion), fifth / recursion[0]),
        "settled": settled,
        "overturns": resonance.overturning_half_cycle(scene),
        "last_amplification": last / first,
    }


def _compute_damping_claims() -> dict[str, object]:
    """Compute the damping ratios of Eqs. 13, 18 and 22, as printed and as they are meant."""
    printed = float(resonance.equivalent_damping_as_printed(0.85))
    meant = float(resonance.equivalent_damping(0.85))
    elastic = float(resonance.damping_from_decay(0.85))
    # As it is meant, 5 % is a restitution under which the block of Table III overturns.
    restitution = math.exp(-0.05 / float(resonance.equivalent_damping(math.exp(-1))))
    margin = resonance.overturning_margin(make_scene(4.0, 1.2, restitution))
    oscillator = Oscillator(2 * math.pi, np.array([0.05, 0.17]))
    largest = oscillator.peak_displacement(1.0)
    return {
        "dampings": (printed, meant, elastic),
        "restitution_meant": restitution,
        "margin_meant": margin,
        "damping_ratios": (meant / printed, printed / elastic, meant / elastic),
        "psi": (Oscillator(1.0, 0.01).amplification, 1 / (1 - 0.97)),
        "excess": 100 * (largest / oscillator.quarter_cycle_displacement(1.0) - 1),
    }


def _compute_linearization_claims() -> dict[str, object]:
    """Compute what linearizing costs at slenderness 3, up to 0.9 of v_c and close to it."""
    block = Block(0.5, 3.0)
    critical, true = (float(model.critical_velocity(block)) for model in _MODELS)
    velocity = np.append(np.linspace(1e-3, 0.9, 200), 0.995) * critical
    peak, true_peak = (np.asarray(model.peak_rotation(block, velocity)) for model in _MODELS)
    time, true_time = (
        np.asarray(model.half_cycle_duration(block, velocity)) for model in _MODELS
    )
    peak = 100 * (1 - peak / true_peak)
    time = 100 * (1 - time / true_time)
    return {
        "short_peak": _find_range(peak[:-1]),
        "short_duration": _find_range(time[:-1]),
        "at_the_threshold": (peak[-1], time[-1], 100 * (critical / true - 1)),
    }


def _find_range(values: "np.ndarray | xarray.DataArray") -> tuple[object, object]:
    """Find the least and the largest of values."""
    return np.min(values), np.max(values)


def _find_powers(values: np.ndarray) -> tuple[object, object]:
    """Find the least and the largest power with which values go over slenderness."""
    # The exponent of a power law is the derivative of one logarithm with respect to the other.
    logarithms = np.log(values), np.log(_SLENDERNESS)
    return _find_range(np.gradient(*logarithms, axis=0, edge_order=2))


def _find_range_of_steps(
    values: "np.ndarray | xarray.DataArray", axis: int
) -> tuple[object, object]:
    """Find the range of steps from one value to the next.

    Both ends are above 0 if the values rise everywhere, and below 0 if they fall everywhere.
    """
    return _find_range(np.diff(values, axis=axis))
