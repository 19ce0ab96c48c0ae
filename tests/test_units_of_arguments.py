"""Numbers that carry a unit: converted as their own package says, or refused, never stripped."""

from functools import partial

import astropy.units
import jaxtyping
import numpy as np
import pint
import pytest
import xarray

import jaxrock as jr
from jaxrock.validation import NON_NEGATIVE, Checked, Reals, as_field, elementwise, quantity

BLOCK = jr.Block(0.2, 5.0)
PULSE = jr.Sine(3.0, 0.5)
RECORD = jr.Record([0.0, 1.0, 0.0], 0.1)
rocking = partial(jr.rocking_spectrum, PULSE, [2.0])
resonance = partial(jr.resonance_spectrum, 3.0, restitution=0.6, intensity=0.15)
both_packages = pytest.mark.parametrize(
    "carry", [pint.UnitRegistry().Quantity, astropy.units.Quantity], ids=("pint", "astropy")
)


@pytest.fixture(autouse=True)
def as_users_have_it(monkeypatch):
    """Without the types that the tests check: quantities are no arrays for them."""
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)


@both_packages
@pytest.mark.parametrize(
    ("make", "read", "expected"),
    [
        (lambda q: jr.Block.from_size(width=q(60, "cm"), height=q(1.8, "m")), "width", 0.6),
        (lambda q: jr.Block(q([30.0, 40.0], "mm"), q(5.0, "")), "half_width", [0.03, 0.04]),
        (lambda q: jr.Block([q(30.0, "cm"), q(0.4, "m")], 5.0), "half_width", [0.3, 0.4]),
        (lambda q: jr.Record(q([0.0, 2.0], "cm/s**2"), 0.01), "acceleration", [0.0, 0.02]),
        (lambda q: jr.Record([0.0, 2.0], q(10, "ms")), "time_step", 0.01),
        (lambda q: jr.Harmonic(3.0, q(0.002, "rad/ms")), "frequency", 2.0),
        (lambda q: jr.Scene(BLOCK, q(80.0, "percent"), q(0.1, "m/s")), "restitution", 0.8),
        (lambda q: jr.respond(BLOCK, 0.9, PULSE, q(0.01, "min")).scene, "duration", 0.6),
        (
            lambda q: RECORD.on_floor(q(600, "ms"), time_step=q(25, "ms")),
            "acceleration",
            RECORD.on_floor(0.6, time_step=0.025).acceleration,
        ),
        (lambda q: rocking(critical_angle=q([45.0], "deg")), "slenderness", [1.0]),
        (lambda q: resonance(width=q([4.0, 8.0], "cm")), "width", [0.04, 0.08]),
    ],
)
def test_a_unit_is_converted(carry, make, read, expected, eps):
    np.testing.assert_allclose(getattr(make(carry), read), expected, rtol=9 * eps, atol=eps)


def test_labels_of_xarray_and_a_unit_of_a_record_are_not_stripped(eps):
    samples = np.array([0.0, 0.5])
    for unit in ("m s-2", "m/s2", "m s**-2", "m/s^2"):
        record = jr.Record(xarray.DataArray(samples, attrs={"units": unit}), 0.01)
        np.testing.assert_array_equal(record.acceleration, samples)
    for unit, factor in (("g", 9.80665), ("%g", 0.0980665), ("cm/s^2", 0.01)):
        record = jr.Record(samples, 0.1, samples, unit=unit)
        np.testing.assert_allclose(record.acceleration, factor * samples, rtol=4 * eps)
        np.testing.assert_allclose(record.vertical, factor * samples, rtol=4 * eps)


class Storm(Checked):
    """A class with a time in hours, whatever the unit of this name is elsewhere."""

    time: Reals = quantity(NON_NEGATIVE, "h")
    count: Reals = quantity(NON_NEGATIVE)

    def __init__(self, time, count=0.0):
        self.time = as_field(Storm, "time", time)
        self.count = as_field(Storm, "count", count)


@elementwise(time=quantity(NON_NEGATIVE, "h"), count=NON_NEGATIVE)
def sum_times(time, count=0.0):
    return time + count


@both_packages
@pytest.mark.parametrize("take", [lambda *given: Storm(*given).time, sum_times])
def test_an_argument_has_the_unit_that_it_declares_or_takes_none(carry, take, eps):
    np.testing.assert_allclose(take(carry(90.0, "min")), 1.5, rtol=2 * eps)
    with pytest.raises(ValueError, match=r"^time .* like h, got 3.0 m"):
        take(carry(3.0, "m"))
    with pytest.raises(ValueError, match=r"^count .* without a unit"):
        take(1.0, carry(3.0, "s"))
