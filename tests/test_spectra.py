import functools

import numpy as np
import pytest
import xarray
from scenes import GRID
from tools.cf_conventions import assert_follows_cf
from tools.selection import first_by_default

import jaxrock as jr
from jaxrock.spectra import resonance as spectra


def test_a_grid_is_its_scenes_one_by_one():
    spectrum = jr.resonance_spectrum(**GRID, model=jr.Nonlinear())
    assert dict(spectrum.sizes) == {"slenderness": 8, "width": 3, "restitution": 2}
    for at in (
        {"slenderness": 2, "width": 1, "restitution": 0},
        {"slenderness": 7, "width": 0},
    ):
        point = spectrum.isel({"restitution": 1} | at)
        scene = jr.Scene(
            jr.Block(float(point.width) / 2, float(point.slenderness)),
            float(point.restitution),
            0.15,
        )
        expected = {
            "rotation_ratio": jr.rotation_ratio,
            "peak_rotation": jr.stabilized_rotation,
            "stabilized_period": jr.stabilized_period,
            "amplification": jr.amplification,
            "overturning_margin": jr.overturning_margin,
            "overturning_half_cycle": jr.overturning_half_cycle,
        }
        for name, function in expected.items():
            value = function(scene, jr.Nonlinear())
            np.testing.assert_allclose(point[name], value, rtol=1e-4, err_msg=name)
        critical = jr.critical_intensity(scene.block, scene.restitution, model=jr.Nonlinear())
        np.testing.assert_allclose(point.critical_intensity, critical, rtol=1e-5)


@pytest.mark.parametrize("intensity", [0.15, [0.1, 0.15]])
@pytest.mark.parametrize("options", [{}, {"model": "auto"}])
def test_files_follow_the_conventions(tmp_path, monkeypatch, intensity, options):
    """Whatever the numbers are."""

    def zeros(function, points, *_):
        flat = np.zeros(points.shape[1])
        single = function is not spectra._compute_scene
        return flat > 0 if single else dict.fromkeys(spectra._VARIABLES, flat)

    monkeypatch.setattr(spectra, "_compute_at_points", zeros)
    grid = GRID | {"intensity": intensity} | options
    with jr.resonance_spectrum(**grid, store=tmp_path / "stored.nc") as stored:
        jr.resonance_spectrum(**grid).to_netcdf(tmp_path / "memory.nc")
        assert stored.Conventions == "CF-1.9"
    for name in ("stored.nc", "memory.nc"):
        assert_follows_cf(tmp_path / name)
    up_and_down = GRID | {"width": [0.4, 1.2, 0.8]}  # which they do not allow
    assert "Conventions" not in jr.resonance_spectrum(**up_and_down).attrs
    assert "Conventions" in jr.resonance_spectrum(**GRID | {"width": [1.2, 0.8, 0.4]}).attrs


BY_AXIS = {  # each function of spectra with a value of each of its axes
    "resonance": (
        jr.resonance_spectrum,
        {"slenderness": 5.0, "width": 0.8, "restitution": 0.6, "intensity": 0.15},
    ),
    "rocking": (
        functools.partial(jr.rocking_spectrum, jr.Sine(4.0, 0.5)),
        {"free_period": 2.0, "slenderness": 5.0, "restitution": 0.9, "factor": 0.5},
    ),
    "overturning": (
        functools.partial(jr.overturning_map, jr.Sine),
        {"frequency_ratio": 2.0, "amplitude_ratio": 1.5},
    ),
    "harmonic": (
        functools.partial(jr.spectra.harmonic_spectrum, cycles=3),
        {"frequency_ratio": 3.0, "amplitude_ratio": 1.2},
    ),
}


@pytest.mark.parametrize("name", first_by_default(BY_AXIS))
def test_a_number_is_a_scalar_coordinate(name):
    """In memory and lazily: of each axis alone, and of all."""
    function, axes = BY_AXIS[name]
    whole = function(**{axis: [value] for axis, value in axes.items()})
    assert {*axes} <= {*whole.dims}
    for numbers in (*([axis] for axis in axes), [*axes]):
        given = {axis: axes[axis] if axis in numbers else [axes[axis]] for axis in axes}
        found = function(**given)
        expected = whole.squeeze(numbers)
        xarray.testing.assert_identical(found.drop_attrs(), expected.drop_attrs())
        xarray.testing.assert_identical(function(**given, chunks="auto").compute(), found)


@pytest.mark.parametrize("largest", first_by_default([7, 1, 1000]))
def test_parts_and_files_change_nothing(tmp_path, monkeypatch, largest):
    """Not the last bit of a number."""
    grid = GRID | {"intensity": [0.1, 0.15]}
    whole = jr.resonance_spectrum(**grid)
    monkeypatch.setattr(spectra, "_LARGEST", largest)
    assert jr.resonance_spectrum(**grid).identical(whole)
    path = tmp_path / "new" / "spectrum.nc"
    with jr.resonance_spectrum(**grid, store=path) as stored:
        for name, values in whole.items():
            assert stored[name].values.tobytes() == values.values.tobytes(), name
        assert stored.attrs == whole.attrs
        assert stored.stabilized_period.attrs == whole.stabilized_period.attrs
    assert [entry.name for entry in path.parent.iterdir()] == ["spectrum.nc"]


@pytest.mark.thorough
@pytest.mark.float64
@pytest.mark.parametrize(
    ("tolerance", "sizes"),
    [(1e-2, (8, 3, 1)), pytest.param(1e-4, (20, 2, 7), marks=pytest.mark.thorough)],
)
def test_each_point_by_its_model(tmp_path, tolerance, sizes):
    """By default on a grid of the size of the others here, whose program is there already."""
    slenderness, width, intensity = (
        np.geomspace(*ends, size)
        for ends, size in zip([(2, 60), (0.4, 1.2), (0.05, 1e-3)], sizes, strict=True)
    )
    grid = (slenderness, width, [0.4, 0.9], intensity)
    auto = jr.resonance_spectrum(
        *grid, model="auto", tolerance=tolerance, store=tmp_path / "a.nc"
    )
    kinds = [jr.resonance_spectrum(*grid, model=m) for m in (jr.Linearized(), jr.Nonlinear())]
    with auto:
        assert auto.model.attrs["flag_meanings"] == "linearized nonlinear"
        assert set(np.unique(auto.model)) == {0, 1}
        for name in ("rotation_ratio", "peak_rotation", "stabilized_period", "amplification"):
            own = np.where(auto.model == 1, kinds[1][name], kinds[0][name])
            np.testing.assert_allclose(auto[name], own, rtol=1e-12)
            np.testing.assert_allclose(auto[name], kinds[1][name], rtol=tolerance)
        for name in ("critical_intensity", "overturning_half_cycle"):
            np.testing.assert_allclose(auto[name], kinds[1][name], rtol=1e-12)
        assert auto.attrs["tolerance"] == tolerance
