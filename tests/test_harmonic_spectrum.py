"""Spectra of steady rocking on a harmonic floor: labels, regions, and what SciPy says of them."""

import jax
import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray
from scipy.integrate import solve_ivp
from tools.cf_conventions import assert_follows_cf
from tools.command import run

import jaxrock as jr
from jaxrock.plot import plot_harmonic
from jaxrock.spectra import add_size, harmonic_spectrum
from jaxrock.steady import (
    harmonic_orbit,
    least_harmonic_amplitude,
    symmetry_breaking_amplitude,
)

MEANINGS = {
    "region": "no_orbit stable symmetry_broken overturned",
    "from_rest": "stays_at_rest rocks overturned",
}


@pytest.mark.thorough
def test_labels(tmp_path):
    found = harmonic_spectrum(
        [2.0, 4.0, 7.0], [0.01, 1.5], slenderness=4.0, restitution=0.85, cycles=10
    )
    assert dict(found.sizes) == {"frequency_ratio": 3, "amplitude_ratio": 2}
    assert set(found.data_vars) == {"velocity_ratio", "rotation_ratio", "phase", "trace",
                                    "multiplier", "region", "from_rest"}  # fmt: skip
    for name, meanings in MEANINGS.items():
        assert found[name].dtype == np.int8
        assert found[name].flag_meanings == meanings
        assert found[name].flag_values.tolist() == list(range(len(meanings.split())))
    assert found.attrs["cycles"] == 10
    assert found.attrs["model"] == "nonlinear"
    assert "floor" in found.frequency_ratio.long_name
    assert found.phase.units == "rad"
    assert found.region.values.tolist() == [[0, 1]] * 3
    assert found.from_rest.values[:, 0].tolist() == [0, 0, 0]
    assert np.isnan(found.trace.values[:, 0]).all()
    found.to_netcdf(tmp_path / "harmonic.nc")
    assert_follows_cf(tmp_path / "harmonic.nc")


@pytest.mark.thorough
@pytest.mark.float64
@pytest.mark.parametrize(
    "model", [pytest.param(jr.Linearized(), marks=pytest.mark.thorough), jr.Nonlinear()]
)
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
    block = jr.Block(0.2, 5.0)
    frequency = ratio * block.frequency_parameter
    unit = block.gravity * block.critical_angle
    edges = [limit(block, 0.9, frequency) / unit
             for limit in (least_harmonic_amplitude, symmetry_breaking_amplitude)]  # fmt: skip
    strengths = np.ravel([float(edge) * np.array([1 - 1e-6, 1 + 1e-6]) for edge in edges])
    found = harmonic_spectrum(ratio, strengths, restitution=0.9, model="linearized", cycles=2)
    region = found.region.values
    assert region[:3].tolist() == [0, 1, 1]
    assert region[3] >= 2
    assert float(found.multiplier[3]) > 1


class Shaken:
    """The block of a spectrum by DOP853, in units of 1 / p: does it rock, or topple?"""

    def __init__(self, ratio, strength, c, cycles, slenderness=5.0):
        self.angle = np.arctan(1 / slenderness)
        self.c = c
        self.ratio = ratio
        self.push = strength / slenderness
        self.end = 2 * np.pi * cycles / ratio

    def topples(self, time, state):
        """From a state on the positive side on: whether it reaches pi / 2."""
        side = 1

        def field(time, state):
            tilt = self.angle - state[0]
            push = side * self.push * np.sin(self.ratio * time)
            return state[1], push * np.cos(tilt) - np.sin(tilt)

        def lands(time, state):
            return state[0]

        def lies(time, state):
            return state[0] - np.pi / 2

        lands.terminal = True
        lands.direction = -1
        lies.terminal = True
        while True:
            flight = solve_ivp(
                field,
                (time, self.end),
                state,
                "DOP853",
                events=[lands, lies],
                rtol=1e-11,
                atol=1e-14,
                max_step=0.1,
            )
            if not flight.t_events[0].size:
                return bool(flight.t_events[1].size)
            time = flight.t[-1]
            side = -side
            state = (0.0, -self.c * flight.y[1, -1])
            assert state[1] > 1e-6, "a block that comes to rest is beyond this reference"

    def outcome_from_rest(self):
        """0 where it is not lifted, 1 where it rocks, 2 where it topples."""
        uplift = np.tan(self.angle)
        if self.push <= uplift:
            return 0
        # Just after it is lifted, the push exceeds what lifts it in proportion to time.
        begin = np.arcsin(uplift / self.push) / self.ratio
        later = 1e-4
        rate = self.push * self.ratio * np.cos(self.ratio * begin) * np.cos(self.angle)
        return 1 + self.topples(begin + later, (rate * later**3 / 6, rate * later**2 / 2))


@pytest.mark.float64
@pytest.mark.thorough
def test_what_happens_elsewhere():
    """Near orbits that are not stable, and from rest: of points that are not chaotic."""
    ratios = np.array([1.0, 2.0, 3.0, 5.0])
    strengths = np.array([0.5, 2.6, 4.5, 9.0])
    cycles = 12
    found = harmonic_spectrum(ratios, strengths, restitution=0.9, cycles=cycles)
    scale = 2 * np.sin(0.5 * np.arctan(0.2))
    regions = set()
    from_rest = set()
    for i, ratio in enumerate(ratios):
        for j, strength in enumerate(strengths):
            point = found.isel(frequency_ratio=i, amplitude_ratio=j)
            shaken = Shaken(ratio, strength, 0.9, cycles)
            region = int(point.region)
            rest = int(point.from_rest)
            assert rest == shaken.outcome_from_rest(), (ratio, strength)
            if region >= 2:
                launch = 1.001 * float(point.velocity_ratio) * scale
                topples = shaken.topples(float(point.phase) / ratio, (0.0, launch))
                assert region == 2 + topples, (ratio, strength)
            regions.add(region)
            from_rest.add(rest)
    assert {1, 2, 3} <= regions
    assert from_rest == {0, 1, 2}


@pytest.mark.thorough
@pytest.mark.float64
def test_from_rest_is_what_the_batch_says():
    found = harmonic_spectrum(3.0, np.geomspace(0.9, 12, 15), restitution=0.85, cycles=15)
    block = jr.Block(0.2, 5.0)
    motion = jr.ground_motion.Harmonic(
        found.amplitude_ratio.values * 9.81 / 5, 3.0 * float(block.frequency_parameter), 15
    )
    response = jr.respond_batch(block, 0.85, motion)
    peak = np.asarray(response.peak_rotation)
    expected = (peak > 0).astype(int) + (peak >= 0.5 * np.pi)
    np.testing.assert_array_equal(found.from_rest, expected)


@pytest.mark.thorough
def test_chunks_change_nothing(monkeypatch):
    arguments = [2.0, 3.0], np.geomspace(0.5, 9, 5)
    whole = harmonic_spectrum(*arguments, restitution=0.9, cycles=4)
    monkeypatch.setattr("jaxrock.spectra.harmonic._LARGEST", 3)
    parts = harmonic_spectrum(*arguments, restitution=0.9, cycles=4)
    for name in whole.data_vars:
        np.testing.assert_allclose(whole[name], parts[name], rtol=1e-4)


@pytest.mark.thorough
@pytest.mark.float64
def test_picture():
    ratios = np.array([1.0, 2.0, 3.0, 5.0])
    strengths = np.array([0.05, 0.5, 2.6, 4.5, 9.0])
    found = harmonic_spectrum(ratios, strengths, restitution=0.9, cycles=12)
    _, given = plt.subplots()
    ax = plot_harmonic(found, given)
    assert ax is given
    np.testing.assert_array_equal(ax.collections[0].get_array(), found.region.T)
    entries = [text.get_text() for text in ax.get_legend().get_texts()]
    assert len(set(entries)) == 6
    assert "lifts a block at rest" in entries
    assert ax.get_yscale() == "log"
    assert r"\omega/p$ [-]" in ax.get_xlabel()
    assert r"\tan\alpha_c" in ax.get_ylabel()
    levels = {text.get_text() for text in ax.texts}
    assert {"0.1", "0.2"} & levels
    one = plot_harmonic(found.isel(frequency_ratio=[0], amplitude_ratio=[0, 1]))
    assert one is not given


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
    assert "[Hz]" in ax.get_xlabel()
    assert "[m/s²]" in ax.get_ylabel()
    lifts = next(x for x in ax.get_lines() if x.get_label() == "lifts a block at rest")
    assert set(lifts.get_ydata()) == {sized.uplift_amplitude}
    low, high = ax.get_ylim()
    assert low < sized.amplitude.values[0] < sized.amplitude.values[-1] < high
    plt.close("all")


@pytest.mark.thorough
@pytest.mark.float64
def test_the_command_in_hertz(capsys, tmp_path):
    """From which amplitude on the block goes on rocking, beside what lifts it from rest."""
    size = ("harmonic", "--width", 0.4, "--height", 2, "--restitution", 0.9, "--cycles", 2)
    grid = ("--frequency", 1, 2, "--amplitude", "0.1:0.5:41", "--model", "linearized")
    code, text, _ = run(capsys, *size, *grid, "--out", tmp_path / "out")
    assert code == 0
    block = jr.Block(0.2, 5.0)
    for frequency in (1, 2):
        least = least_harmonic_amplitude(block, 0.9, 2 * np.pi * frequency)
        on_grid = np.ceil(float(least) * 100) / 100
        line = f"at {frequency} Hz: keeps rocking from {on_grid:.3g} m/s2 on\n"
        assert line in text
    assert_follows_cf(tmp_path / "out" / "harmonic.nc")
    with xarray.open_dataset(tmp_path / "out" / "harmonic.nc") as dataset:
        assert dataset.frequency.values.tolist() == [1, 2]
    table = (tmp_path / "out" / "harmonic.csv").read_text(encoding="utf-8")
    assert "frequency [Hz],amplitude [m/s2]" in table


@pytest.mark.float64
@pytest.mark.thorough
def test_floors_of_single_precision_are_followed():
    """Without 64 bits the regions are the same, but for chaotic points."""
    arguments = [2.0, 4.0], [0.05, 1.5, 5.0]
    exact = harmonic_spectrum(*arguments, restitution=0.9, cycles=5)
    with jax.enable_x64(False):
        rough = harmonic_spectrum(*arguments, restitution=0.9, cycles=5)
    np.testing.assert_array_equal(rough.region, exact.region)
    np.testing.assert_allclose(rough.rotation_ratio, exact.rotation_ratio, rtol=1e-5)
