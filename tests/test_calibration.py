"""Fits to free and driven rocking: independent data, honest errors, repairs."""

import jax.numpy as jnp
import numpy as np
import pytest
from scenes import impact_times
from tools.selection import first_by_default

import jaxrock as jr
from jaxrock.calibration import fit_driven_rocking, fit_free_rocking

DOUBLE = pytest.mark.float64
SLOW = pytest.mark.thorough
BLOCK = jr.Block(0.1, 5.0)
NODES, WEIGHTS = np.polynomial.legendre.leggauss(40)
NAN = float("nan")


def describe_body(half_width, slenderness):
    """Frequency parameter and critical angle."""
    angle = np.arctan(1 / slenderness)
    return np.sqrt(9.81 * np.sin(angle) / (4 / 3 * half_width)), angle


P, ANGLE = describe_body(0.1, 5.0)


def launches(launch, restitution, count, change=0.0):
    """Velocity ratios; C linear in that before an impact, its mean as without a change."""
    constant = launch * restitution ** np.arange(count - 1)
    before = constant[:-1]
    ratios = [launch]
    for _ in before:
        slope = change / np.ptp(before)
        ratios.append(ratios[-1] * (restitution + slope * (ratios[-1] - before.mean())))
    return np.array(ratios)


def impacts(launch, restitution, count, p=P, angle=ANGLE, change=0.0):
    """Times of impacts of a nonlinear block, the first at 1 s, by energy."""
    ratios = launches(launch, restitution, count, change)
    # sin(theta / 2) = least * cosh(u) for the angle theta from the vertical takes the root away.
    end = np.arctanh(ratios)[:, None]
    least = np.sin(angle / 2) * np.sqrt(1 - ratios**2)[:, None]
    steep = 1 / np.sqrt(1 - (least * np.cosh(end * (NODES + 1) / 2)) ** 2)
    return np.cumsum(np.append(1.0, np.sum(steep * WEIGHTS * end, axis=-1) / p))


def disturb(times, noise=1e-3, seed=0):
    return times + np.random.default_rng(seed).normal(0, noise, times.shape)


def compute_errors(noise, launch, restitution, count, p=P, angle=ANGLE):
    """Of C where p is known, of C and p where not: normal equations, by differences."""
    full = np.array([launch, restitution, p])
    columns = [np.ones(count)]
    for k, step in enumerate(1e-4 * np.array([1 - launch, restitution, p])):
        moved = [full + sign * step * np.eye(3)[k] for sign in (-1, 1)]
        low, high = (impacts(*at[:2], count, at[2], angle) for at in moved)
        columns.append((high - low) / (2 * step))
    errors = []
    for free in (3, 4):
        jacobian = np.transpose(columns[:free])
        scale = np.linalg.norm(jacobian, axis=0)
        inverse = np.linalg.pinv(jacobian / scale)
        errors.append(noise * np.linalg.norm(inverse, axis=1)[2:] / scale[2:])
    return errors[0][0], errors[1]


@DOUBLE
def test_exact_measurements():
    """Of an unknown frequency parameter and with a peak that is missing; without a block."""
    p, angle = describe_body(0.3, 3.0)
    ratios = launches(0.9, 0.85, 12)
    peaks = angle - 2 * np.arcsin(np.sin(angle / 2) * np.sqrt(1 - ratios**2))
    peaks *= (-1) ** np.arange(11)
    peaks[4] = NAN
    options = {"peak_rotations": peaks, "frequency_known": False}
    fit = fit_free_rocking(impacts(0.9, 0.85, 12, p, angle), jr.Block(0.3, 3.0), **options)
    values = [float(getattr(fit, name)) for name in fit.names]
    np.testing.assert_allclose(values, [1.0, 0.9, 0.85, p, angle], rtol=1e-9)
    np.testing.assert_allclose(fit.time_residuals, 0, atol=1e-9)
    np.testing.assert_allclose(fit.restitutions, 0.85, rtol=1e-7)
    np.testing.assert_allclose(fit.velocity_ratios, ratios[:-1], rtol=1e-7)
    assert fit.repairs == ()
    alone = fit_free_rocking(impact_times(BLOCK, 0.9, 0.85))
    pair = (float(alone.restitution), float(alone.frequency_parameter))
    np.testing.assert_allclose(pair, (0.85, P), rtol=1e-9)


def draw_test(rng, count=9):
    """A test of a block of any kind, without and with noise, half-cycles above six noises."""
    while True:
        half_width, slenderness = rng.uniform(0.05, 0.5), rng.uniform(2, 12)
        restitution, launch = rng.uniform(0.5, 0.98), rng.uniform(0.3, 0.95)
        noise = 10 ** rng.uniform(-4, -2)
        p, angle = describe_body(half_width, slenderness)
        times = impacts(launch, restitution, count, p, angle)
        if (np.diff(times) > 6 * noise).all():
            exact = noise, launch, restitution, count, p, angle
            block = jr.Block(half_width, slenderness)
            return exact, block, times + rng.normal(0, noise, count)


@SLOW
@DOUBLE
@pytest.mark.parametrize("frequency_known", [True, False])
def test_bias_and_errors_of_many_tests(frequency_known):
    """Of nine impacts each; where p is hardly known, C is not linear in the times."""
    rng = np.random.default_rng(5)
    off, stated = [], []
    repaired = 0
    for _ in range(200):
        exact, block, times = draw_test(rng)
        known, unknown = compute_errors(*exact)
        if not frequency_known and unknown[1] > 0.2 * exact[4]:
            continue
        fit = fit_free_rocking(times, block, frequency_known=frequency_known, repair=False)
        true = known if frequency_known else unknown[0]
        off.append((float(fit.restitution) - exact[2]) / true)
        stated.append(float(fit.standard_errors["restitution"]) / true)
        if frequency_known and len(off) <= 40:
            repaired += len(fit_free_rocking(times, block).repairs)
    off, stated = np.array(off), np.array(stated)
    assert abs(off.mean()) < 2 * off.std() / off.size**0.5
    chance = 3 / (2 * off.size) ** 0.5  # three standard errors of a standard deviation
    assert abs(np.sqrt(np.mean(stated**2)) / off.std() - 1) < max(0.1, 1.5 * chance)
    assert repaired <= 1


@SLOW
@DOUBLE
@pytest.mark.parametrize("frequency_known", [True, False])
def test_repairs(frequency_known):
    """Of fourteen impacts with 1 ms of noise; the times that are left say what C is."""
    exact = impacts(0.9, 0.9, 14)
    known, unknown = compute_errors(1e-3, 0.9, 0.9, 14)
    error = known if frequency_known else unknown[0]
    for place in (2, 7, 11):
        times = disturb(exact, seed=place)
        faults = {
            "is missing": np.delete(times, place),
            "counts an impact again": np.insert(times, place + 1, times[place] + 0.008),
            "is out of line": times + 0.03 * (np.arange(times.size) == place),
        }
        for fault, damaged in faults.items():
            fit = fit_free_rocking(damaged, BLOCK, frequency_known=frequency_known)
            assert len(fit.repairs) == 1, (fault, place, fit.repairs)
            assert fault in fit.repairs[0], (place, fit.repairs)
            assert abs(float(fit.restitution) - 0.9) < 5 * error, (fault, place)
    for gone in ([4, 9], [6, 7]):
        fit = fit_free_rocking(np.delete(disturb(exact), gone), BLOCK)
        np.testing.assert_array_equal(fit.impact_numbers, np.delete(np.arange(14), gone))


@DOUBLE
def test_another_block():
    """It is named, and not hidden by repairs."""
    p, angle = describe_body(0.2, 5.0)
    fit = fit_free_rocking(impacts(0.9, 0.9, 12, p, angle), BLOCK)
    assert any("the durations are not those of this block" in text for text in fit.remarks)
    assert fit.repairs == ()


@DOUBLE
def test_a_change_of_restitution():
    """It is as large as it is said to be, and seldom said where there is none."""
    times = disturb(impacts(0.95, 0.9, 14, change=0.05), seed=4)
    fit = fit_free_rocking(times, BLOCK, repair=False)
    ratios = launches(0.95, 0.9, 14, 0.05)
    true = np.ptp(ratios[1:] / ratios[:-1])
    assert abs(float(fit.restitution_change)) == pytest.approx(true, rel=0.1)
    assert not fit.is_constant
    assert "one constant C does not explain" in str(fit)
    exact = impacts(0.95, 0.9, 9)
    fits = [fit_free_rocking(disturb(exact, seed=k), BLOCK, repair=False) for k in range(40)]
    changes = [float(fit.restitution_change / fit.restitution_change_error) for fit in fits]
    assert abs(np.mean(changes)) < 0.5
    # 2.571 is the 95 % quantile of Student's distribution.
    assert np.mean(np.abs(changes) > 2.571) < 0.13
    assert np.mean([not fit.is_constant for fit in fits]) < 0.11
    # The error of C at each impact is the one that is stated, too.
    stated = np.mean([fit.restitution_errors**2 for fit in fits], axis=0) ** 0.5
    deviations = np.std([fit.restitutions for fit in fits], axis=0)
    assert np.mean(deviations / stated) == pytest.approx(1, rel=0.15)


@DOUBLE
@pytest.mark.parametrize("kind", first_by_default(["growing", "random"]))
def test_motions_that_are_no_free_rocking(kind):
    times = np.append(0, np.cumsum(2 / P * np.arctanh(0.3 * 1.1 ** np.arange(9))))
    if kind == "random":
        times = np.random.default_rng(0).exponential(0.4, 12).cumsum()
    with pytest.raises(ValueError, match=r"^impact_times must be from free rocking"):
        fit_free_rocking(times, BLOCK)


# A block on a table that moves like one sine, and what is measured of it.
TABLE = jr.Block(0.2, 5.0)
SINE = jr.Sine(amplitude=2.5, duration=0.8)
TIME = np.linspace(0, 4, 201)


def rotations(restitution=0.85, block=TABLE, motion=SINE, time=TIME, **begin):
    response = jr.respond(block, restitution, motion, float(time[-1]), **begin)
    return np.asarray(response.history(jnp.asarray(time))[0])


def noisy(rotation, size=0.005):
    noise = size * np.abs(rotation).max()
    return disturb(rotation, noise), noise


@SLOW
@DOUBLE
def test_driven_restitution():
    exact = rotations()
    fit = fit_driven_rocking(TIME, exact, TABLE, SINE)
    assert float(fit.restitution) == pytest.approx(0.85, abs=1e-7)
    assert fit.status == jr.Status.COMPLETE
    assert fit.remarks == ()
    np.testing.assert_allclose(fit.rotation, exact, atol=1e-7)
    measured, noise = noisy(exact)
    measured[50:60] = NAN
    fit = fit_driven_rocking(TIME, measured, TABLE, SINE)
    error = float(fit.standard_errors["restitution"])
    slope = (rotations(0.85 + 1e-5) - rotations(0.85 - 1e-5)) / 2e-5
    slope[50:60] = 0
    assert error == pytest.approx(noise / np.linalg.norm(slope), rel=0.2)
    assert abs(float(fit.restitution) - 0.85) < 4 * error
    assert float(fit.rotation_noise) == pytest.approx(noise, rel=0.2)
    np.testing.assert_array_equal(np.isnan(fit.residuals), np.isnan(measured))
    assert float(fit.used_until) == float(fit.last_time) == 4.0
    # Beyond its window a test may be of something else.
    measured[TIME > 2.5] = 0.01
    fit = fit_driven_rocking(TIME, measured, TABLE, SINE, window=2.5)
    error = float(fit.standard_errors["restitution"])
    assert abs(float(fit.restitution) - 0.85) < 4 * error < 0.01
    assert float(fit.used_until) == 2.5
    assert fit.remarks


@SLOW
@DOUBLE
def test_driven_parameters():
    """From a block that is 2 % off, and a point mass, the least inertia there is."""
    names = ("restitution", "slenderness", "inertia_ratio")
    guess = jr.Block(0.2, 5.1, inertia_ratio=1.0)
    fit = fit_driven_rocking(TIME, noisy(rotations())[0], guess, SINE, parameters=names)
    for name, true in zip(names, (0.85, 5.0, 4 / 3), strict=True):
        error = float(fit.standard_errors[name])
        assert abs(float(fit.values[name]) - true) < 4 * error < 0.04 * true, name
    assert float(fit.block.slenderness) == float(fit.values["slenderness"])
    assert fit.status == jr.Status.COMPLETE


@SLOW
@DOUBLE
@pytest.mark.parametrize("wrong", ["block", "motion"])
def test_driven_by_something_else(wrong):
    """It cannot pass for a fit."""
    block = jr.Block(0.2, 5.5) if wrong == "block" else TABLE
    motion = jr.Sine(amplitude=3.2, duration=0.7) if wrong == "motion" else SINE
    fit = fit_driven_rocking(TIME, noisy(rotations())[0], block, motion)
    assert fit.status == jr.Status.NOT_CONVERGED
    assert "the search has not converged" in fit.remarks
