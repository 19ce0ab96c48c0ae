"""Fits of free and driven tests, and of populations to what fell and stood."""

import functools

import numpy as np
from scenes import impact_times

import jaxrock as jr

from .table import group, list_fields, list_variables, stack_fields

BLOCK = jr.Block(0.1, 5.0)
OF_FREE_FIT = (
    "restitution frequency_parameter critical_angle launch_ratio first_impact covariance"
    " time_residuals rotation_residuals time_noise rotation_noise impact_numbers used"
    " velocity_ratios restitutions restitution_errors restitution_change"
    " restitution_change_error degrees_of_freedom"
)


def measure_impacts(count=13):
    """Times with a millisecond of noise, and peaks with a hundredth."""
    noise = np.random.default_rng(5).normal(0, 1.0, (2, count))
    times = 0.5 + impact_times(BLOCK, 0.9, 0.9, count) + 1e-3 * noise[0]
    ratios = 0.9 * 0.9 ** np.arange(count - 1)
    peaks = float(BLOCK.critical_angle) * (1 - np.sqrt(1 - ratios**2))
    return times, peaks * (1 + 0.01 * noise[1, : count - 1])


@group("calibration/free", 1e-7, by_default=True)
def fit_free_rocking():
    """Where a sum of squares is least is known to half of the digits of the sum."""
    times, _ = measure_impacts()
    fit = jr.calibration.fit_free_rocking(times, BLOCK, model="linearized")
    yield from list_fields(fit, OF_FREE_FIT)


@group("calibration/free_otherwise", 1e-6)
def fit_free_rocking_otherwise():
    times, peaks = measure_impacts()
    linear = {"model": "linearized"}
    cases = {
        "nonlinear": (times, BLOCK, {}),
        "no_block": (times, None, {}),
        "free_frequency": (times, BLOCK, {"frequency_known": False, "time_noise": 2e-3}),
        "peaks": (times, BLOCK, {"peak_rotations": peaks, **linear}),
        "missing_impact": (np.delete(times, [5]), BLOCK, linear),
    }
    fits = [
        jr.calibration.fit_free_rocking(measured, block, **options)
        for measured, block, options in cases.values()
    ]
    names = "restitution frequency_parameter critical_angle launch_ratio degrees_of_freedom"
    yield from stack_fields(fits, names)
    errors = [list(fit.standard_errors.values()) for fit in fits]
    yield "standard_errors", errors, 1e-4
    for name, value in stack_fields(fits, "restitutions"):
        yield name, value, 1e-5
    for name, fit in zip(cases, fits, strict=True):
        yield f"repairs/{name}", list(map(str, fit.repairs))


@group("calibration/driven", 1e-5)
def fit_driven_rocking():
    """By a search, which ends where a step changes nothing within the errors."""
    pulse = jr.Sine(2.5, 0.8)
    block = jr.Block(0.2, 5.0)
    time = np.linspace(0, 4, 101)
    rotation = np.asarray(jr.respond(block, 0.85, pulse, 4.0, rtol=1e-11).history(time)[0])
    noise = np.random.default_rng(0).normal(0, 5e-4, time.size)
    cases = {
        "restitution": ("restitution",),
        "slenderness": ("restitution", "slenderness"),
    }
    for name, parameters in cases.items():
        fit = jr.calibration.fit_driven_rocking(
            time, rotation + noise, jr.Block(0.2, 5.05), pulse, parameters=parameters
        )
        yield f"{name}/values", list(fit.values.values())
        yield f"{name}/standard_errors", list(fit.standard_errors.values()), 1e-4
        names = "rotation_noise used_until last_time status"
        yield from list_fields(fit, names, f"{name}/")
        yield f"{name}/rotation", fit.rotation[::10]


@functools.cache
def make_tests():
    """Twenty-four wavelets, and blocks of a population under them."""
    random = np.random.default_rng(0)
    periods = np.exp(random.uniform(np.log(0.3), np.log(1.2), 24))
    strengths = np.exp(random.uniform(np.log(1.0), np.log(8.0), 24))
    phases = (np.pi * np.linspace(-1.6, 1.6, 81) / periods[:, None]) ** 2
    waves = strengths[:, None] * (1 - 2 * phases) * np.exp(-phases)
    suite = jr.Suite([jr.Record(wave, 0.04) for wave in waves])
    blocks = jr.Block.from_parameters(
        4.2 * np.exp(0.1 * random.standard_normal(24)),
        0.17 * np.exp(0.2 * random.standard_normal(24)),
    )
    found = jr.respond_batch(blocks, 0.85, suite)
    overturned = np.diagonal(np.asarray(found.overturned))
    groups = [f"earthquake {k % 6}" for k in range(24)]
    return suite, overturned, groups


@group("calibration/outcomes", 1e-3)
def fit_populations():
    """The search ends where the gradient is small, and the posterior is sampled around it."""
    suite, overturned, groups = make_tests()
    yield "overturned", overturned
    prior = {"critical_angle": (0.2, 0.1), "restitution": (0.8, 0.05)}
    fit = jr.calibration.fit_outcomes(suite, overturned, prior=prior, samples=512, seed=1)
    yield from list_fit(fit, suite, "prior/")
    fit = jr.calibration.fit_outcomes(suite, overturned, samples=512, seed=1, groups=groups)
    yield from list_fit(fit, suite, "grouped/")


def list_fit(fit, suite, prefix):
    yield f"{prefix}population", [float(v) for v in vars(fit.population).values()], 0.2
    yield f"{prefix}probability", fit.probability(suite), 3e-2
    yield f"{prefix}restitution", fit.restitution, 1e-2
    yield f"{prefix}half_width", fit.block.half_width, 1e-2
    ends = list(fit.compute_intervals().values())
    yield f"{prefix}intervals", np.asarray(ends), 0.1
    coefficients = fit.uncertain.coefficients_of_variation
    yield f"{prefix}coefficients", [float(v) for v in coefficients.values()], 5e-2


@group("calibration/cross_validation", 1e-3)
def score_predictions():
    suite, overturned, groups = make_tests()
    scores = jr.calibration.cross_validate(
        suite, overturned, groups, splits=2, samples=512, seed=1
    )
    yield from list_variables(scores)
