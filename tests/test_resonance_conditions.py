"""The page on resonance conditions: every number in it is what the library computes."""

import re
from pathlib import Path

import numpy as np
import pytest

import jaxrock as jr
from jaxrock.steady import least_harmonic_amplitude

PAGE = Path(__file__).parent.parent / "docs" / "resonance_conditions.md"
TEXT = PAGE.read_text(encoding="utf-8")

BLOCK = jr.Block(0.2, 5.0)
C = 0.9
UPLIFT = float(BLOCK.gravity / BLOCK.slenderness)
P = float(BLOCK.frequency_parameter)
ANGLE = float(BLOCK.critical_angle)
BEGIN = 12.0  # frequency ratio from which the floor becomes slower

pytestmark = pytest.mark.float64


def table(number):
    """The cells of a table of the page, below its names."""
    tables = re.findall(r"(?:^\|.*\n)+", TEXT, re.MULTILINE)
    rows = [line.strip("|\n").split("|") for line in tables[number].splitlines(keepends=True)]
    return np.array([[cell.strip() for cell in row] for row in rows[2:]])


def assert_rounded(cells, values):
    """That the cells are the values, rounded to as many digits; a dash is NaN."""
    for cell, value in zip(np.ravel(cells), np.ravel(values), strict=True):
        if cell == "-":
            assert np.isnan(value)
        else:
            digits = len(cell.partition(".")[2])
            assert abs(float(cell) - value) < 0.51 * 10.0**-digits, (cell, value)


def after_pulses(c, strength, w):
    """Rotation ratio where each pulse brings what half a period of the floor brings."""
    c, intensity = np.broadcast_arrays(c, 2 * strength * UPLIFT / (w * P))
    return jr.rotation_ratio(jr.Scene(BLOCK, c, intensity), jr.Nonlinear())


def orbits(c, strength, w):
    """Rotation ratio, phase and launch velocity of stable motions, by one program for all tests."""
    broadcast = np.broadcast_arrays(c, strength, w)
    flat = [np.pad(np.ravel(x), (0, 32 - np.size(x)), mode="edge") for x in broadcast]
    found = jr.steady.harmonic_orbit(BLOCK, flat[0], flat[1] * UPLIFT, flat[2] * P)
    assert found.stable.all()
    values = found.rotation_ratio, found.phase, found.launch_velocity
    return [np.asarray(x)[: broadcast[0].size].reshape(broadcast[0].shape) for x in values]


def floor_from(phase, strength, ratio, samples=64):
    """A floor each of whose half periods is `ratio` times as long as the one before."""
    frequency = BEGIN * P
    rate = np.log(ratio)
    time = np.arange(25_600) * np.pi / frequency / samples
    elapsed = frequency * time
    angle = np.pi / rate * np.log1p(rate * elapsed / np.pi) if rate else elapsed
    return jr.Record(strength * UPLIFT * np.sin(phase + angle), time[1])


def assert_said(words):
    """That the page says this, in whatever lines."""
    assert words in " ".join(TEXT.split())


@pytest.mark.thorough
def test_frequencies():
    cells = table(0)
    w = cells[:, 0].astype(float)
    strength = np.array([0.15, 0.3, 1.0])
    assert_rounded(cells[:, 1], 1 - 1 / np.cosh(np.pi / (2 * w)))
    assert_rounded(cells[:, 2], least_harmonic_amplitude(BLOCK, C, w * P) / UPLIFT)
    ratio = orbits(C, strength, w[:, None])[0]
    assert_rounded(cells[:, 3:6], ratio)
    assert_rounded(cells[:, 6:], after_pulses(C, strength[:2], w[:, None]))
    linearized = jr.steady.harmonic_orbit(
        BLOCK, C, strength[None] * UPLIFT, w[:, None] * P, model="linearized"
    )
    off = np.max(np.abs(linearized.rotation_ratio / ratio - 1))
    assert_said(f"by up to {100 * off:.1f} %")


@pytest.mark.thorough
def test_restitutions():
    cells = table(1)
    c = cells[:, 0].astype(float)
    ratio, phase, _ = orbits(c, 0.3, 8.0)
    assert_rounded(cells[:, 1], np.degrees(phase))
    assert_rounded(cells[:, 2], ratio)
    assert_rounded(cells[:, 3], after_pulses(c, 0.3, 8.0))
    near = C + np.array([-1e-4, 1e-4])
    both = orbits(near, 0.3, 8.0)[0], after_pulses(near, 0.3, 8.0)
    on_floor, timed = (np.diff(np.log(x))[0] / np.diff(np.log(near))[0] for x in both)
    assert_said(
        f"elasticity of the peak to C is {on_floor:.1f} on the floor and {timed:.0f} after"
    )


def test_overturning_from_rest():
    cells = table(2)
    strength = cells[:, 0].astype(float)
    w = np.arange(5, 121) / 10
    every = np.append(strength, 0.999)[:, None]
    response = jr.respond_batch(BLOCK, C, jr.Harmonic(every * UPLIFT, w * P, cycles=25))
    peak = np.asarray(response.peak_rotation)
    assert (peak[-1] == 0).all()
    overturned = peak[:-1] > 1.5
    last = overturned.shape[1] - 1 - np.argmax(overturned[:, ::-1], axis=1)
    impacts = np.asarray(response.impacts)[np.arange(last.size), last]
    assert_rounded(cells[:, 1], w[last])
    assert_rounded(cells[:, 2], impacts)
    critical = jr.critical_intensity(BLOCK, C, model=jr.Nonlinear())
    assert_rounded(cells[:, 3], 2 * strength * UPLIFT / (P * critical))


@pytest.mark.thorough
def test_frequency_that_falls():
    cells = table(3).astype(float)
    least = float(least_harmonic_amplitude(BLOCK, C, BEGIN * P)) / UPLIFT
    assert_rounded(table(3)[:, 1], 1 + (1 - C) * (cells[:, 0] / least - 1))
    _, phases, launches = orbits(C, cells[:, 0], BEGIN)
    for (strength, _, ratio), phase, launch in zip(cells, phases, launches, strict=True):
        for slower in (ratio, ratio + 0.01):
            floor = floor_from(phase, strength, slower)
            response = jr.respond(BLOCK, C, floor, velocity=launch)
            assert (response.peak_rotation > 1.5) == (slower == ratio)


@pytest.mark.thorough
def test_slow_and_fast_floors():
    slow = (1 - C) / (1 + C)
    fast = np.pi**2 / 4 * (1 - C) / np.hypot(1 + C, np.pi / 2 * (1 - C))
    assert_said(f"from {slow:.3f} on a slow floor to {fast:.3f} on a fast one")
    unit = float(BLOCK.gravity * BLOCK.critical_angle)
    computed = least_harmonic_amplitude(BLOCK, C, np.array([1e-2, 1e4]) * P) / unit
    np.testing.assert_allclose(computed, [slow, fast], rtol=1e-3)
    w = 200.0
    strength = np.array([0.1, 1.0, 3.0])
    orbit = jr.steady.harmonic_orbit(
        BLOCK, 1 - 1e-6, strength * unit, w * P, model="linearized"
    )
    np.testing.assert_allclose(
        orbit.rotation_ratio, (np.pi**2 / 8 + strength) / w**2, rtol=2e-4
    )


@pytest.mark.thorough
def test_half_cycles_of_three_half_periods():
    c = 0.97
    w = BEGIN
    strength = 0.5
    t = np.tanh(np.array([0.5, 1.5]) * np.pi / w)
    squares = (1 + c) ** 2 + (w * t * (1 - c)) ** 2
    least = t**2 * (1 - c) / np.sqrt(squares)
    k = strength / (1 + w**2)
    assert least[1] / least[0] == pytest.approx(9, rel=0.1)
    # The motion itself, in which the block stays although it is launched for the linearized
    # one.
    m = (t * (1 + c) + w * np.sqrt(squares * (k**2 - least**2)))[1] / squares[1]
    phase = np.arctan2(t[1] * (1 - c) * m, (t[1] - (1 + c) * m) / w)
    floor = floor_from(phase, strength, 1.0, samples=128)
    response = jr.respond(BLOCK, c, floor, velocity=2 * m * c * ANGLE * P)
    lasted = np.diff(np.asarray(response.impact_times)[:60]) * w * P / np.pi
    np.testing.assert_allclose(lasted[-10:], 3, rtol=1e-2)
