"""The claims of the paper and its known faults, each with the computation that checks it."""

import functools
import json
import math
from collections.abc import Callable
from importlib.resources import files
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..resonance import (
    Linearized,
    Nonlinear,
    Oscillator,
    RockingModel,
    Scene,
    amplification,
    damping_from_decay,
    equivalent_damping,
    equivalent_damping_as_printed,
    half_cycle_velocity,
    launch_velocity,
    overturning_half_cycle,
    overturning_margin,
    rotation_ratio,
    stabilized_period,
    stabilized_velocity,
)

SLENDERNESS = (3.0, 10.0)
WIDTHS = (0.4, 0.6, 0.8, 1.0, 1.2)
INTENSITY = 0.15
_LINEARIZED, _NONLINEAR = Linearized(), Nonlinear()


def printed_tables() -> dict:
    """The tables as printed, with their source."""
    return json.loads((files("jaxrock") / "data" / "paper.json").read_text(encoding="utf-8"))


def paper_scene(slenderness: Any, width: Any, restitution: Any) -> Scene:
    """A block under the pulses of the paper."""
    return Scene(Block(width / 2, slenderness), restitution, INTENSITY)


def both(function: Callable[[RockingModel], Any]) -> tuple[np.ndarray, np.ndarray]:
    """The answers of both models."""
    return np.asarray(function(_LINEARIZED)), np.asarray(function(_NONLINEAR))


_C_05, _C_06, _C_07, _C_08, _C_085 = 0, 20, 40, 41, 42
_SLENDERNESS_4, _WIDTH_08, _WIDTH_12 = 100, 2, 4


class Grid:
    """Every quantity that claims are about, over slenderness, width and restitution.

    Each is computed at once for all claims, since every shape is compiled anew, and looked at
    with NumPy for the same reason.
    """

    def __init__(self) -> None:
        self.slenderness = np.linspace(*SLENDERNESS, 701)[:, None]
        self.restitution = np.append(np.linspace(0.5, 0.7, 41), [0.8, 0.85])
        axes = np.meshgrid(self.slenderness, WIDTHS, self.restitution, indexing="ij", sparse=True)
        scene = paper_scene(*axes)
        self.period, self.amplification, self.margin, self.ratio = (
            np.asarray(quantity(scene))
            for quantity in (stabilized_period, amplification, overturning_margin, rotation_ratio)
        )
        self.scene = paper_scene(self.slenderness, np.asarray(WIDTHS)[None], 0.6)
        self.launch = np.asarray(launch_velocity(self.scene))
        # Of one pulse.
        self.peak = np.asarray(_LINEARIZED.peak_rotation(self.scene.block, self.launch))
        self.duration = np.asarray(_LINEARIZED.half_cycle_duration(self.scene.block, self.launch))


Check = Callable[[Grid], tuple[Any, str]]  # whether it is so, and the figure that shows it
CLAIMS: list[tuple[str, str, Check]] = []  # where in the paper, statement, check
FAULTS: list[tuple[str, str, Check]] = []


def _listed(
    table: list[tuple[str, str, Check]], where: str, statement: str
) -> Callable[[Check], Check]:
    def add(check: Check) -> Check:
        table.append((where, statement, check))
        return check

    return add


_claim, _fault = functools.partial(_listed, CLAIMS), functools.partial(_listed, FAULTS)


@_claim("Eq. 2", "the launch velocity is proportional to I and falls with size and slenderness")
def _launch_velocity(grid: Grid) -> tuple[Any, str]:
    launch = grid.launch
    double = launch_velocity(Scene(grid.scene.block, 0.6, 2 * INTENSITY))
    valid = np.allclose(double, 2 * launch, rtol=1e-12) & _falls(launch, 0) & _falls(launch, 1)
    return valid, f"from {launch[0, 0]:.4f} to {launch[-1, -1]:.4f} rad/s over the paper's grid"


@_claim("Table I", "the peak after one pulse falls with size and rises slightly with slenderness")
def _single_peak(grid: Grid) -> tuple[Any, str]:
    growth = grid.peak[-1] / grid.peak[0] - 1
    valid = _falls(grid.peak, 1) & _rises(grid.peak, 0) & np.all(growth < 0.15)
    ends = "from slenderness {:g} to {:g}".format(*SLENDERNESS)
    return valid, f"by at most {100 * growth.max():.1f} % {ends}"


@_claim(
    "Table II",
    "the half-cycle rises with slenderness and hardly depends on size, at most by 1.97 %",
)
def _single_half_cycle(grid: Grid) -> tuple[Any, str]:
    largest = 100 * (1 - grid.duration[:, -1] / grid.duration[:, 0]).max()
    valid = _rises(grid.duration, 0) & (np.round(largest, 2) == 1.97)
    return valid, f"size changes it by at most {largest:.2f} %"


@_claim("Fig. 3", "the stabilized period rises sharply with slenderness and hardly depends on size")
def _period_and_slenderness(grid: Grid) -> tuple[Any, str]:
    period = grid.period[..., _C_06]
    size_effect = 1 - period[:, -1] / period[:, 0]
    rise = period[-1] / period[0]
    valid = _rises(period, 0) & np.all(rise > 3) & np.all(size_effect < 0.2)
    return valid, (
        f"{rise.min():.2f} to {rise.max():.2f} times"
        f" from slenderness {SLENDERNESS[0]:g} to {SLENDERNESS[1]:g};"
        f" size changes it by {100 * size_effect.min():.1f} to {100 * size_effect.max():.1f} %"
    )


@_claim("Fig. 5", "the stabilized period rises with C")
def _period_and_restitution(grid: Grid) -> tuple[Any, str]:
    period = grid.period[:, _WIDTH_08, : _C_07 + 1]
    (first, last), (low, high) = SLENDERNESS, period[[0, -1]]
    return _rises(period, 1), (
        f"from {low[0]:.3f} to {low[-1]:.3f} s at slenderness {first:g}"
        f" for C from 0.5 to 0.7, from {high[0]:.3f} to {high[-1]:.3f} s at {last:g}"
    )


@_claim(
    "Fig. 4",
    "the amplification rises sharply with C, hardly depends on slenderness, and on size"
    " slightly where C is large",
)
def _amplification(grid: Grid) -> tuple[Any, str]:
    zeta = grid.amplification
    growth = zeta[0, :, _C_08] / zeta[0, :, _C_05]
    slenderness_effect = zeta[-1, :, _C_06] / zeta[0, :, _C_06] - 1
    low, high = (
        np.ptp(zeta[_SLENDERNESS_4, :, c]) / zeta[_SLENDERNESS_4, :, c].min()
        for c in (_C_05, _C_08)
    )
    valid = np.all(growth > 6) & np.all(slenderness_effect < 0.15) & (low < 0.02) & (high > low)
    return valid, (
        f"{growth.min():.1f} times from C = 0.5 to 0.8;"
        f" slenderness changes it by at most {100 * slenderness_effect.max():.1f} % at C = 0.6;"
        f" size by {100 * low:.1f} % at C = 0.5 and {100 * high:.0f} % at C = 0.8 (slenderness 4)"
    )


@_claim("Fig. 6", "for C = 0.6 every block reaches the stabilized phase")
def _all_stand(grid: Grid) -> tuple[Any, str]:
    smallest = grid.margin[..., _C_06].min()
    return smallest > 0, f"smallest margin {smallest:.3f}"


@_claim(
    "Fig. 8",
    "for C = 0.8 the width 0.6 m reaches it up to slenderness 7, and only widths above"
    " 0.8 m reach it up to 10",
)
def _limits_of_standing(grid: Grid) -> tuple[Any, str]:
    stands = grid.margin[..., _C_08] > 0
    limits = np.where(stands, grid.slenderness, 0).max(axis=0)
    valid = math.floor(limits[1]) == 7 and limits[:3].max() < 10 and limits[3:].min() == 10
    each = (f"{limit:.2f} ({width} m)" for limit, width in zip(limits, WIDTHS, strict=True))
    return valid, f"up to slenderness {', '.join(each)}"


@_claim(
    "Figs. 6 to 8",
    "the rotation ratio rises as size falls, almost in proportion to slenderness, and with C",
)
def _rotation_ratio(grid: Grid) -> tuple[Any, str]:
    ratio, scene = grid.ratio[..., _C_06], grid.scene

    def logarithm(log_slenderness: Any) -> Any:
        block = Block(scene.block.half_width, jnp.exp(log_slenderness))
        return jnp.log(rotation_ratio(Scene(block, scene.restitution, scene.intensity)))

    at = np.log(np.broadcast_to(grid.slenderness, ratio.shape))
    elasticity = np.asarray(jax.jvp(logarithm, (at,), (np.ones_like(at),))[1])
    valid = _falls(ratio, 1) & _rises(ratio, 0) & _rises(grid.ratio[:, _WIDTH_12, : _C_07 + 1], 1)
    low, high = elasticity.min(), elasticity.max()
    return valid & (low > 0.95) & (high < 1.5), (
        f"it goes as slenderness to the power {low:.2f} to {high:.2f} at C = 0.6"
    )


@_claim(
    "Table III",
    "at about 5 % of damping the block amplifies 52 times, nearly eight times as much as"
    " the oscillator",
)
def _against_the_oscillator(grid: Grid) -> tuple[Any, str]:
    zeta = grid.amplification[_SLENDERNESS_4, _WIDTH_12, _C_085]
    psi = float(Oscillator(1.0, 0.05).amplification)
    valid = (np.round(zeta) == 52) & (np.round(psi, 2) == 6.87) & (zeta / psi > 7)
    return valid, f"{zeta:.2f} against {psi:.2f}, {zeta / psi:.2f} times"


def _rises(values: np.ndarray, axis: int) -> bool:
    return bool(np.all(np.diff(values, axis=axis) > 0))


def _falls(values: np.ndarray, axis: int) -> bool:
    return _rises(-values, axis)


@_fault("Eq. 8", "the closed sum lacks its last power of C; the limit is not affected")
def _closed_sum(_: Grid) -> tuple[Any, str]:
    """The sum as printed, against the recursion printed beside it."""
    scene = paper_scene(4.0, 1.2, 0.6)
    first = float(launch_velocity(scene))
    recursion = first
    for _step in range(4):
        recursion = 0.6 * recursion + first
    printed = first * ((1 + sum(0.6**j for j in range(1, 5))) - 0.6**4)
    same = np.isclose(float(half_cycle_velocity(scene, 5)), recursion, rtol=1e-12)
    return same & (printed < 0.96 * recursion), (
        f"half-cycle 5 at C = 0.6: printed sum {printed / first:.4f}, recursion"
        f" {recursion / first:.4f} times the first velocity"
    )


@_fault(
    "Table III, C = 0.9",
    "the block overturns; the amplification printed is that of the last half-cycle it"
    " survives, not a stabilized one",
)
def _last_half_cycle(_: Grid) -> tuple[Any, str]:
    scene = paper_scene(4.0, 1.2, 0.9)
    ratio = float(stabilized_velocity(scene)) / float(_LINEARIZED.critical_velocity(scene.block))
    half_cycle = float(overturning_half_cycle(scene))
    velocity = half_cycle_velocity(scene, np.asarray([30.0, 1.0]))
    last, first = np.asarray(_LINEARIZED.peak_rotation(scene.block, velocity))
    valid = (ratio > 1) & (half_cycle == 31) & (abs(last / first - 182.37) < 0.5)
    return valid, (
        f"v*/v_c = {ratio:.4f}, overturns in half-cycle {half_cycle:.0f}, amplification"
        f" {last / first:.2f} in half-cycle 30, printed 182.37"
    )


@_fault(
    "Eq. 13",
    "the source fits the ratio of kinetic energies, C squared; as printed, with C, the"
    " damping is half of what is meant, and only so comes close to Eq. 19",
)
def _equivalent_damping(_: Grid) -> tuple[Any, str]:
    printed, meant, elastic = (
        float(damping(0.85))
        for damping in (equivalent_damping_as_printed, equivalent_damping, damping_from_decay)
    )
    valid = np.isclose(meant, 2 * printed) & (printed < 1.1 * elastic) & (meant > 2 * elastic)
    return valid, (
        f"C = 0.85: {printed:.4f} as printed, {meant:.4f} as meant, Eq. 19 gives {elastic:.4f}"
    )


@_fault(
    "Table III, psi",
    "computed from the damping through the exact Eq. 18, not from the rounded B beside it",
)
def _exact_decay(_: Grid) -> tuple[Any, str]:
    table = printed_tables()["table_3"]
    from_damping = float(Oscillator(1.0, 0.01).amplification)
    from_decay = 1 / (1 - float(table["B"][table["xi"].index("0.01")]))
    valid = (np.round(from_damping, 2) == 32.33) & (abs(from_decay - 32.33) > 0.5)
    return valid, (
        f"xi = 0.01: {from_damping:.2f} from xi, {from_decay:.2f} from B = 0.97, printed 32.33"
    )


@_fault(
    "Eq. 22",
    "the displacement at a quarter of the damped period, not the largest, which comes"
    " earlier; the ratio (Eq. 23) is not affected",
)
def _quarter_cycle(_: Grid) -> tuple[Any, str]:
    oscillator = Oscillator(2 * math.pi, np.asarray([0.05, 0.17]))
    largest = np.asarray(oscillator.peak_displacement(1.0))
    excess = 100 * (largest / np.asarray(oscillator.quarter_cycle_displacement(1.0)) - 1)
    return np.all(excess > 0), (
        f"the maximum is {excess[0]:.3f} % larger at xi = 0.05, {excess[1]:.2f} % at 0.17"
    )


@_fault(
    "Eq. 4, slenderness 3",
    "a size rather than a fault: what linearizing costs at the limit given for it, where"
    " the critical velocity is on the unsafe side",
)
def _cost_of_linearizing(_: Grid) -> tuple[Any, str]:
    block = Block(0.5, 3.0)
    critical, true_critical = both(lambda model: model.critical_velocity(block))
    # Up to 0.9 of the critical velocity, then close to it.
    velocity = np.append(np.linspace(1e-3, 0.9, 200), 0.995) * critical
    peak, true_peak = both(lambda model: model.peak_rotation(block, velocity))
    duration, true_duration = both(lambda model: model.half_cycle_duration(block, velocity))
    short_peak, short_duration = 100 * (1 - peak / true_peak), 100 * (1 - duration / true_duration)
    excess = 100 * (critical / true_critical - 1)
    short = np.stack([short_peak, short_duration])
    (low_peak, low_duration), (high_peak, high_duration) = (
        short[:, :-1].min(axis=1),
        short[:, :-1].max(axis=1),
    )
    valid = (
        min(low_peak, low_duration) > 1.5
        and max(high_peak, high_duration) < 1.95
        and round(float(short_peak[-1]), 1) == 6.5
        and round(float(short_duration[-1])) == 25
        and round(float(excess), 2) == 0.43
    )
    return valid, (
        f"peak {low_peak:.2f} to {high_peak:.2f} % and duration {low_duration:.2f} to"
        f" {high_duration:.2f} % too small up to 0.9 v_c, {short_peak[-1]:.1f} and"
        f" {short_duration[-1]:.0f} % at 0.995 v_c; critical velocity {excess:.2f} % too large"
    )
