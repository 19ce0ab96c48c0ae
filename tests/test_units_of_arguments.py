"""Numbers that carry a unit: converted as their own package says, or refused, never stripped."""

import astropy.units as u
import jaxtyping
import numpy as np
import pint
import pytest
import xarray

import jaxrock as jr
from jaxrock.validation import (
    NON_NEGATIVE,
    Checked,
    Reals,
    as_field,
    as_real,
    elementwise,
    quantity,
)

REGISTRY = pint.UnitRegistry()
BLOCK = jr.Block(0.2, 5.0)
PULSE = jr.Sine(3.0, 0.5)


@pytest.fixture(autouse=True)
def as_users_have_it():
    """Without the types that the tests check: quantities are no arrays for them."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


def of_pint(value, unit):
    return REGISTRY.Quantity(value, unit)


def of_astropy(value, unit):
    return u.Quantity(value, unit)


def labelled(value, unit):
    return xarray.DataArray(np.asarray(value), attrs={"units": unit})


@pytest.mark.parametrize("carry", [of_pint, of_astropy])
@pytest.mark.parametrize(
    ("make", "read", "expected"),
    [
        (
            lambda q: jr.Block.from_size(width=q(60.0, "cm"), height=q(1.8, "m")),
            "half_width",
            0.3,
        ),
        (lambda q: jr.Block(q([30.0, 40.0], "mm"), q(5.0, "")), "half_width", [0.03, 0.04]),
        (lambda q: jr.Block(0.3, q(2.0, "m/cm")), "slenderness", 200.0),
        (lambda q: jr.Record(q([0.0, 2.0], "cm/s**2"), 0.01), "acceleration", [0.0, 0.02]),
        (lambda q: jr.Record([0.0, 2.0], q(10, "ms")), "time_step", 0.01),
        (lambda q: jr.Sine(3.0, q(0.01, "min")), "duration", 0.6),
        (lambda q: jr.Harmonic(3.0, q(0.002, "rad/ms")), "frequency", 2.0),
        (lambda q: jr.Scene(BLOCK, q(80.0, "percent"), 0.1), "restitution", 0.8),
        (lambda q: jr.Scene(BLOCK, 0.8, q(36.0, "cm/s")), "intensity", 0.36),
        (lambda q: jr.Block([q(30.0, "cm"), q(0.4, "m")], 5.0), "half_width", [0.3, 0.4]),
        (lambda q: jr.DrivenScene(BLOCK, q(80.0, "percent"), PULSE), "restitution", 0.8),
        (lambda q: jr.respond(BLOCK, 0.9, PULSE, q(0.01, "min")).scene, "duration", 0.6),
    ],
)
def test_a_unit_is_converted(carry, make, read, expected, eps):
    np.testing.assert_allclose(getattr(make(carry), read), expected, rtol=2 * eps)


def test_labels_of_xarray_are_not_stripped(eps):
    block = jr.Block(labelled([0.1, 0.2], "m"), 5.0)
    np.testing.assert_allclose(block.half_width, [0.1, 0.2], rtol=eps)
    for unit in ("m s-2", "m/s2", "m s**-2", "m/s^2"):
        record = jr.Record(labelled([0.0, 1.0], unit), 0.01)
        np.testing.assert_array_equal(record.acceleration, [0.0, 1.0])


def test_axes_of_spectra_are_converted():
    plain = jr.resonance_spectrum([3.0, 5.0], [0.04, 0.08], [0.6], 0.15)
    widths = u.Quantity([4.0, 8.0], "cm")
    found = jr.resonance_spectrum([3.0, 5.0], widths, [0.6], u.Quantity(15.0, "cm/s"))
    np.testing.assert_allclose(found.width, plain.width, rtol=1e-15)
    np.testing.assert_allclose(found.rotation_ratio, plain.rotation_ratio, rtol=1e-6)


@pytest.mark.parametrize("carry", [of_pint, of_astropy])
def test_a_critical_angle_of_a_spectrum_is_converted(carry):
    angles = carry([9.0, 18.0], "deg")
    spectrum = jr.rocking_spectrum(PULSE, [2.0], critical_angle=angles)
    expected = 1 / np.tan(np.pi / np.array([20, 10]))
    np.testing.assert_allclose(np.sort(spectrum.slenderness), np.sort(expected), rtol=1e-12)


class Storm(Checked):
    """A class with a time in hours, and a count that declares no unit."""

    time: Reals = quantity(NON_NEGATIVE, "h")
    count: Reals = quantity(NON_NEGATIVE)

    def __init__(self, time, count=0.0):
        self.time = as_field(Storm, "time", time)
        self.count = as_field(Storm, "count", count)


@elementwise(time=quantity(NON_NEGATIVE, "h"), duration=NON_NEGATIVE)
def sum_times(time, duration=0.0):
    return time + duration


@pytest.mark.parametrize("carry", [of_pint, of_astropy])
@pytest.mark.parametrize(
    "convert", [lambda t: Storm(t).time, sum_times, lambda t: as_real("time", t, unit="h")]
)
def test_an_argument_has_the_unit_that_it_declares(carry, convert, eps):
    """Whatever its name is elsewhere in the package."""
    np.testing.assert_allclose(convert(carry(90.0, "min")), 1.5, rtol=2 * eps)
    with pytest.raises(ValueError, match=r"^time must be .* a unit like h, got 3.0 m"):
        convert(carry(3.0, "m"))


@pytest.mark.parametrize("carry", [of_pint, of_astropy])
@pytest.mark.parametrize(
    ("name", "convert"),
    [
        ("count", lambda t: Storm(1.0, t)),
        ("duration", lambda t: sum_times(1.0, t)),
        ("time", lambda t: as_real("time", t)),
    ],
)
def test_an_argument_that_declares_no_unit_takes_none(carry, name, convert):
    with pytest.raises(ValueError, match=f"^{name} must be a number without a unit, in SI"):
        convert(carry(3.0, "s"))


@pytest.mark.parametrize("carry", [of_pint, of_astropy])
def test_one_name_has_two_units(carry, eps):
    """The velocity of an oscillator is none of a rotation."""
    oscillator = jr.resonance.Oscillator(carry(6.0, "rad/s"), 0.05)
    peak = oscillator.peak_displacement(carry(30.0, "cm/s"))
    np.testing.assert_allclose(peak, oscillator.peak_displacement(0.3), rtol=4 * eps)
    with pytest.raises(ValueError, match=r"^velocity must be in the unit rad/s, got 30.0 c"):
        jr.Linearized().peak_rotation(BLOCK, carry(30.0, "cm/s"))


@pytest.mark.parametrize("carry", [of_pint, of_astropy])
def test_times_of_a_floor_are_converted(carry):
    record = jr.Record([0.0, 1.0, 0.0], 0.1)
    options = {"time_step": carry(25.0, "ms"), "free_vibration": carry(0.01, "min")}
    floor = record.on_floor(carry(600.0, "ms"), carry(5.0, "percent"), **options)
    plain = record.on_floor(0.6, 0.05, time_step=0.025, free_vibration=0.6)
    np.testing.assert_allclose(floor.acceleration, plain.acceleration, rtol=1e-6)
