"""Spectra of steady rocking on a harmonic floor: labels, regions, and what SciPy says of them."""

import numpy as np
import pytest
from references import stepping
from tools.cf_conventions import assert_follows_cf

import jaxrock as jr
from jaxrock.plot import plot_harmonic
from jaxrock.spectra import add_size, harmonic_spectrum
from jaxrock.steady import (
    harmonic_orbit,
    least_harmonic_amplitude,
    symmetry_breaking_amplitude,
)

BLOCK = jr.Block(0.2, 5.0)


@pytest.mark.thorough
@pytest.mark.float64
@pytest.mark.parametrize("model", [jr.Linearized(), jr.Nonlinear()])
def test_points_are_orbits_of_every_size(model):
    ratios = np.array([1.5, 3.0, 6.0])
    strengths = np.array([0.4, 1.2, 3.0, 9.0])
    found = harmonic_spectrum(
        ratios, strengths, restitution=0.8, inertia_ratio=1.25, model=model, cycles=3
    )
    block = jr.Block(0.7, 5.0, 1.62, 1.25)
    uplift = block.gravity * (block.critical_angle if model.name == "linearized" else 0.2)
    frequency, amplitude = np.meshgrid(
        ratios * float(block.frequency_parameter), strengths * float(uplift), indexing="ij"
    )
    orbit = harmonic_orbit(block, 0.8, amplitude, frequency, model=model)
    velocity = orbit.launch_velocity / model.critical_velocity(block)
    expected = {
        "velocity_ratio": velocity,
        "rotation_ratio": orbit.rotation_ratio,
        "phase": orbit.phase,
        "trace": orbit.trace,
        "multiplier": np.abs(orbit.multipliers).max(axis=-1),
    }
    for name, values in expected.items():
        np.testing.assert_allclose(found[name], values, rtol=1e-9)
    np.testing.assert_array_equal(found.region == 1, orbit.stable)
    np.testing.assert_array_equal(found.region == 0, ~orbit.exists)


@pytest.mark.thorough
@pytest.mark.float64
@pytest.mark.parametrize("ratio", [2.0, 4.0, 8.0])
def test_regions_end_where_the_closed_forms_say(ratio):
    frequency = ratio * BLOCK.frequency_parameter
    unit = BLOCK.gravity * BLOCK.critical_angle
    edges = [limit(BLOCK, 0.9, frequency) / unit
             for limit in (least_harmonic_amplitude, symmetry_breaking_amplitude)]  # fmt: skip
    strengths = np.ravel([float(edge) * np.array([1 - 1e-6, 1 + 1e-6]) for edge in edges])
    found = harmonic_spectrum(ratio, strengths, restitution=0.9, model="linearized", cycles=2)
    region = found.region.values
    assert region[:3].tolist() == [0, 1, 1]
    assert region[3] >= 2
    assert float(found.multiplier[3]) > 1


@pytest.mark.float64
@pytest.mark.thorough
def test_what_happens_elsewhere():
    """Near orbits that are not stable, and from rest: of points that are not chaotic."""
    axes = np.array([1.0, 2.0, 3.0, 5.0]), np.array([0.5, 2.6, 4.5, 9.0])
    cycles = 12
    found = harmonic_spectrum(*axes, restitution=0.9, cycles=cycles)
    p = float(BLOCK.frequency_parameter)
    scale = float(jr.Nonlinear().critical_velocity(BLOCK))
    ratio, strength = (x.ravel() for x in np.meshgrid(*axes, indexing="ij"))
    floor = stepping.harmonic(strength * 9.81 / 5, ratio * p, cycles)
    rocker = stepping.Rocker(0.2, 5.0, 0.9)
    from_rest = stepping.follow(rocker, floor, 0.0, rtol=1e-11).peak
    expected = (from_rest > 0).astype(int) + (from_rest >= 0.5 * np.pi)
    np.testing.assert_array_equal(found.from_rest.values.ravel(), expected)
    region = found.region.values.ravel()
    assert {1, 2, 3} <= {*region}
    assert {*expected} == {0, 1, 2}
    # Launched a little faster than the orbit, at its phase: the floor begins there.
    phase = found.phase.values.ravel()
    launch = 1.001 * found.velocity_ratio.values.ravel() * scale

    unstable = region >= 2
    # So that what has no orbit does not matter.
    phase, launch = (np.where(unstable, x, 0.0) for x in (phase, launch))
    floor = stepping.harmonic(strength * 9.81 / 5, ratio * p, cycles, phase)
    path = stepping.follow(rocker, floor, 0.0, 1e-11, (0 * launch, launch))
    topples = path.peak >= 0.5 * np.pi
    np.testing.assert_array_equal(region[unstable], 2 + topples[unstable])


@pytest.mark.thorough
@pytest.mark.float64
def test_in_units_of_one_block(tmp_path):
    """Coordinates in Hz and m/s2, in which each point is the orbit of that block."""
    block = jr.Block(0.3, 4.0, 3.7)
    ratios = np.array([2.0, 5.0])
    strengths = np.array([0.05, 0.6, 1.4])
    found = harmonic_spectrum(
        ratios, strengths, slenderness=4.0, restitution=0.85, cycles=3, model="linearized"
    )
    sized = add_size(found, block)
    assert sized.uplift_amplitude == pytest.approx(3.7 * float(block.critical_angle))
    assert (sized.frequency.units, sized.amplitude.units) == ("Hz", "m s-2")
    frequency, amplitude = np.meshgrid(sized.frequency, sized.amplitude, indexing="ij")
    orbit = harmonic_orbit(
        block, 0.85, amplitude, 2 * np.pi * frequency, model=jr.Linearized()
    )
    np.testing.assert_allclose(sized.rotation_ratio, orbit.rotation_ratio, rtol=1e-9)
    sized.to_netcdf(tmp_path / "harmonic.nc")
    assert_follows_cf(tmp_path / "harmonic.nc")
    ax = plot_harmonic(sized)
    lifts = next(x for x in ax.get_lines() if x.get_label() == "lifts a block at rest")
    assert set(lifts.get_ydata()) == {sized.uplift_amplitude}
