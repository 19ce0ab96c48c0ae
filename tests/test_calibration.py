"""Fits to free and driven rocking: independent data, statistics of simulated tests, bad input."""

import re

import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from references import closed_forms
from scipy import stats

import jaxrock as jr
from jaxrock.calibration import fit_driven_rocking, fit_free_rocking

DOUBLE = pytest.mark.float64
SLOW = pytest.mark.thorough
MODELS = ("linearized", "nonlinear")
BLOCK = jr.Block(0.1, 5.0)
ANGLE = np.arctan(1 / 5)
P = np.sqrt(9.81 * np.sin(ANGLE) / (4 / 3 * 0.1))
NODES, WEIGHTS = np.polynomial.legendre.leggauss(40)
NAN = float("nan")


def body(half_width, slenderness):
    """Frequency parameter and critical angle."""
    angle = np.arctan(1 / slenderness)
    return np.sqrt(9.81 * np.sin(angle) / (4 / 3 * half_width)), angle


def durations(model, p, angle, ratios):
    """Half-cycles after launches at so many times the critical velocity; nonlinear by energy."""
    if model == "linearized":
        return 2 / p * np.arctanh(ratios)
    # sin(theta / 2) = least * cosh(u) for the angle theta from the vertical takes the root
    # away.
    end = np.arctanh(ratios)[..., None]
    least = np.sin(angle / 2) * np.sqrt(1 - ratios**2)[..., None]
    steep = 1 / np.sqrt(1 - (least * np.cosh(end * (NODES + 1) / 2)) ** 2)
    return np.sum(steep * WEIGHTS * end, axis=-1) / p


def peaks_of(model, angle, ratios):
    least = np.sqrt(1 - ratios**2)
    if model == "linearized":
        return angle * (1 - least)
    return angle - 2 * np.arcsin(np.sin(angle / 2) * least)


def launches(launch, restitution, count, change=0.0):
    """Velocity ratios; C linear in that before an impact, its mean as without a change."""
    constant = launch * restitution ** np.arange(count - 1)
    before = constant[:-1]
    ratios = [launch]
    slope = change / np.ptp(before)
    for _ in before:
        ratios.append(ratios[-1] * (restitution + slope * (ratios[-1] - before.mean())))
    return np.array(ratios)


def impacts(launch, restitution, count, model="nonlinear", p=P, angle=ANGLE, change=0.0):
    """Times of impacts, the first at 1 s."""
    ratios = launches(launch, restitution, count, change)
    return np.cumsum(np.append(1.0, durations(model, p, angle, ratios)))


def true_errors(noise, launch, restitution, count, model="nonlinear", p=P, angle=ANGLE):
    """Of C where p is known, of C and p where not: normal equations, by differences."""
    full = np.array([launch, restitution, p])
    columns = [np.ones(count)]
    for k, step in enumerate(1e-4 * np.array([1 - launch, restitution, p])):
        ends = [full + sign * step * np.eye(3)[k] for sign in (-1, 1)]
        low, high = (impacts(*at[:2], count, model, at[2], angle) for at in ends)
        columns.append((high - low) / (2 * step))
    errors = []
    for free in (3, 4):
        jacobian = np.transpose(columns[:free])
        scale = np.linalg.norm(jacobian, axis=0)
        inverse = np.linalg.pinv(jacobian / scale)
        errors.append(noise * np.linalg.norm(inverse, axis=1)[2:] / scale[2:])
    return errors[0][0], errors[1]


@pytest.mark.thorough
@DOUBLE
@pytest.mark.parametrize(
    ("launch", "of_restitution", "of_p"), [(0.95, 2.5e-4, 0.0028), (0.5, 1.1e-3, 0.076)]
)
def test_stated_errors(launch, of_restitution, of_p):
    """Of 13 impacts with 1 ms of noise, as the docstring says, and by differences."""
    times = impacts(launch, 0.9, 13)
    fits = [
        fit_free_rocking(times, BLOCK, frequency_known=k, time_noise=1e-3)
        for k in (True, False)
    ]
    known, unknown = true_errors(1e-3, launch, 0.9, 13)
    assert fits[0].standard_errors["restitution"] == pytest.approx(known, rel=1e-5)
    assert fits[0].standard_errors["frequency_parameter"] == 0
    found = [float(fits[1].standard_errors[k]) for k in ("restitution", "frequency_parameter")]
    np.testing.assert_allclose(found, unknown, rtol=1e-5)
    np.testing.assert_allclose([found[0], found[1] / P], [of_restitution, of_p], rtol=0.05)


WAYS = [
    (model, way)
    for model in MODELS
    for way in ("block", "free p", "peaks", "free p and peaks", "peaks alone", "no block")
    if (model, way) != ("nonlinear", "no block")
] + [("linearized", "no block, peaks")]
SHORT = {("linearized", "block")}


@DOUBLE
@pytest.mark.parametrize(
    ("model", "way"),
    [pytest.param(*case, marks=() if case in SHORT else SLOW) for case in WAYS],
)
def test_exact_measurements(model, way):
    p, angle = body(0.3, 3.0)
    times = impacts(0.9, 0.85, 12, model, p, angle)
    peaks = None
    if "peaks" in way:
        peaks = peaks_of(model, angle, launches(0.9, 0.85, 12)) * (-1) ** np.arange(11)
        peaks[4] = NAN
    alone = way == "peaks alone"
    fit = fit_free_rocking(
        None if alone else times,
        None if "no block" in way else jr.Block(0.3, 3.0),
        peak_rotations=peaks,
        model=model,
        frequency_known="free p" not in way,
    )
    expected = np.array([1.0, 0.9, 0.85, p, angle])
    unknown = [alone, False, False, False, way == "no block"]
    found = np.array([float(getattr(fit, name)) for name in fit.names])
    np.testing.assert_array_equal(np.isnan(found), unknown)
    np.testing.assert_allclose(found, np.where(unknown, NAN, expected), rtol=1e-9)
    if way in ("block", "peaks", "peaks alone"):
        assert fit.standard_errors["frequency_parameter"] == 0
    np.testing.assert_allclose(fit.time_residuals, 0, atol=1e-9)
    each = np.asarray(fit.restitutions)
    ratios = np.asarray(fit.velocity_ratios)
    lost = [4, 3] if alone else []
    np.testing.assert_allclose(np.delete(each, lost), 0.85, rtol=1e-7)
    before = launches(0.9, 0.85, 12)[:-1]
    np.testing.assert_allclose(np.delete(ratios, lost), np.delete(before, lost), rtol=1e-7)
    assert np.isnan(each[lost]).all()
    assert fit.repairs == ()
    assert fit.block is None or fit.block.frequency_parameter == pytest.approx(p, rel=1e-9)


def drawn(rng, model, count=None):
    """A test of a block of any kind, without and with noise, half-cycles above six noises."""
    while True:
        half_width = rng.uniform(0.05, 0.5)
        slenderness = rng.uniform(2, 12)
        restitution = rng.uniform(0.5, 0.98)
        launch = rng.uniform(0.3, 0.95)
        noise = 10 ** rng.uniform(-4, -2)
        impacts_ = count or int(rng.integers(5, 21))
        p, angle = body(half_width, slenderness)
        times = impacts(launch, restitution, impacts_, model, p, angle)
        seen = 1 + int((np.diff(times) > 6 * noise).sum())
        if seen < (count or 5):
            continue
        exact = noise, launch, restitution, seen, model, p, angle
        return exact, (half_width, slenderness), times[:seen] + rng.normal(0, noise, seen)


def assert_honest(off, stated, factor=1.0):
    """No bias, and errors stated as large as they are; both over the true ones."""
    off = np.array(off)
    stated = np.array(stated)
    assert abs(off.mean()) < 2 * factor * off.std() / off.size**0.5
    chance = 3 / (2 * off.size) ** 0.5  # three standard errors of a scatter
    assert abs(np.sqrt(np.mean(stated**2)) / off.std() - 1) < max(0.1, 1.5 * chance)


def several(times, shapes, **options):
    """Restitution, its standard error, its change and the p-value of that, of many tests."""
    rows = []
    for test, shape in zip(times, shapes, strict=True):
        fit = fit_free_rocking(test, jr.Block(*shape), repair=False, **options)
        error = fit.standard_errors["restitution"]
        change = fit.restitution_change, fit.restitution_change_p_value
        rows.append([float(number) for number in (fit.restitution, error, *change)])
    return np.transpose(rows)


@pytest.mark.thorough
@DOUBLE
@pytest.mark.parametrize("frequency_known", [True, pytest.param(False, marks=SLOW)])
def test_bias_and_errors_of_many_tests(frequency_known):
    """Of nine impacts each; where p is hardly known, C is not linear in the times."""
    rng = np.random.default_rng(5)
    cases = [drawn(rng, "nonlinear", 9) for _ in range(200)]
    errors = [true_errors(*case[0]) for case in cases]
    steady = [
        frequency_known or e[1][1] < 0.2 * c[0][5] for e, c in zip(errors, cases, strict=True)
    ]
    times, shapes = (np.array([case[k] for case in cases])[steady] for k in (2, 1))
    true = np.array([case[0][2] for case in cases])[steady]
    of_restitution = np.array([e[0] if frequency_known else e[1][0] for e in errors])[steady]
    found, stated, _, _ = several(times, shapes, frequency_known=frequency_known)
    assert_honest((found - true) / of_restitution, stated / of_restitution)


@DOUBLE
@SLOW
@pytest.mark.release
@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("frequency_known", [True, False])
def test_bias_and_errors_of_a_thousand_tests(model, frequency_known):
    """From 5 to 20 impacts."""
    rng = np.random.default_rng(7)
    off = []
    stated = []
    refused = 0
    outside = 0
    while len(off) < 1000:
        exact, shape, times = drawn(rng, model)
        known, (unknown, of_p) = true_errors(*exact)
        if not frequency_known and of_p > 0.2 * exact[5]:
            outside += 1
            continue
        options = {"model": model, "frequency_known": frequency_known, "repair": False}
        try:
            fit = fit_free_rocking(times, jr.Block(*shape), **options)
        except ValueError:
            refused += 1
            continue
        true = known if frequency_known else unknown
        off.append((float(fit.restitution) - exact[2]) / true)
        stated.append(float(fit.standard_errors["restitution"]) / true)
    print(model, frequency_known, np.mean(off), np.std(off), np.mean(np.square(stated)) ** 0.5)
    print("refused", refused, "p hardly known", outside)
    assert refused < 5
    assert_honest(off, stated)


def faulty(fault, place, times):
    if fault == "missing":
        return np.delete(times, place), f"between {times[place - 1]:.4f} s and", "is missing"
    if fault == "again":
        late = times[place] + 0.008
        return np.insert(times, place + 1, late), f"{late:.4f} s", "counts an impact again"
    wrong = times.copy()
    wrong[place] += 0.03
    return wrong, f"{wrong[place]:.4f} s", "is out of line"


FAULTS = [("missing", k) for k in (2, 7, 11)] + [
    (fault, k) for fault in ("again", "out of line") for k in (0, 7, 13)
]


@pytest.mark.thorough
@DOUBLE
@pytest.mark.parametrize(
    ("model", "frequency_known"),
    [
        ("linearized", True),
        pytest.param("linearized", False, marks=SLOW),
        pytest.param("nonlinear", True, marks=SLOW),
        pytest.param("nonlinear", False, marks=SLOW),
    ],
)
def test_repairs(model, frequency_known):
    """Of fourteen impacts with 1 ms of noise; the times that are left say what C is."""
    rng = np.random.default_rng(11)
    exact = impacts(0.9, 0.9, 14, model)
    errors = true_errors(1e-3, 0.9, 0.9, 14, model)
    error = errors[0] if frequency_known else errors[1][0]
    options = {"model": model, "frequency_known": frequency_known}
    for fault, place in FAULTS:
        if not frequency_known and place == 0 and fault == "out of line":
            continue  # what the first half-cycle alone says, a free p takes up
        times, where, what = faulty(fault, place, exact + rng.normal(0, 1e-3, 14))
        fit = fit_free_rocking(times, BLOCK, **options)
        assert len(fit.repairs) == 1, (fault, place, fit.repairs)
        assert what in fit.repairs[0] or place in (0, 13), (fault, place, fit.repairs)
        assert where in fit.repairs[0] or fault == "again", (fault, place, fit.repairs)
        assert abs(float(fit.restitution) - 0.9) < 5 * error, (fault, place)
        assert fit.remarks[0] == fit.repairs[0]
        assert fit.used.sum() == times.size - (fault != "missing")


@pytest.mark.thorough
@DOUBLE
def test_two_missing_impacts():
    times = impacts(0.9, 0.9, 16) + np.random.default_rng(2).normal(0, 1e-3, 16)
    for gone in ([4, 9], [6, 7]):
        fit = fit_free_rocking(np.delete(times, gone), BLOCK)
        assert len(fit.repairs) == 2
        assert all(said.endswith("is missing") for said in fit.repairs)
        np.testing.assert_array_equal(fit.impact_numbers, np.delete(np.arange(16), gone))
        assert fit.used.all()
        assert abs(float(fit.restitution) - 0.9) < 4 * true_errors(1e-3, 0.9, 0.9, 16)[0]


@DOUBLE
@SLOW
@pytest.mark.release
@pytest.mark.parametrize("model", MODELS)
def test_nothing_to_repair(model):
    rng = np.random.default_rng(3)
    repaired = 0
    for _ in range(200):
        _, shape, times = drawn(rng, model)
        repaired += len(fit_free_rocking(times, jr.Block(*shape), model=model).repairs) > 0
    print(model, "repaired without need", repaired)
    assert repaired <= 2


def exact_times(half_width, slenderness, launch, restitution, count):
    """Impacts of a nonlinear block, by elliptic integrals in mpmath."""
    shape = [mpmath.mpf(number) for number in (half_width, slenderness, "9.81")]
    critical = closed_forms.Nonlinear.critical_velocity(*shape)
    velocities = [launch * critical * restitution**k for k in range(count - 1)]
    halves = [closed_forms.Nonlinear.half_cycle_duration(*shape, v) for v in velocities]
    return np.cumsum([0.0, *map(float, halves)])


@DOUBLE
def test_the_model_is_nonlinear_and_says_where_it_matters():
    """Of a stocky block; the number that a remark names is that of the other fit."""
    stocky = jr.Block(0.3, 2.0)
    exact = exact_times(0.3, 2.0, 0.8, 0.85, 12)
    rng = np.random.default_rng(0)
    off = []
    for _ in range(20):
        times = exact + rng.normal(0, 1e-3, exact.size)
        fit = fit_free_rocking(times, stocky, repair=False)
        other = fit_free_rocking(times, stocky, repair=False, model="linearized")
        assert (fit.model, other.model) == ("nonlinear", "linearized")
        for one, another in ((fit, other), (other, fit)):
            (remark,) = [text for text in one.remarks if "the model matters" in text]
            assert f"the {another.model} one" in remark
            named = float(re.search(r"a C of about ([\d.]+),", remark)[1])
            error = float(one.standard_errors["restitution"])
            # By one step, and of four digits.
            assert abs(named - float(another.restitution)) < 0.5 * error + 5e-5
            away = float(re.search(r"([\d.]+) standard errors", remark)[1])
            assert away == pytest.approx(abs(named - float(one.restitution)) / error, rel=0.2)
        off.append((float(fit.restitution) - 0.85) / float(fit.standard_errors["restitution"]))
        assert float(other.restitution) - 0.85 > 6 * float(
            other.standard_errors["restitution"]
        )
        assert "by the nonlinear model\nthe model matters" in str(fit)
    assert abs(np.mean(off)) < 3 * np.std(off) / 20**0.5


@DOUBLE
def test_models_that_agree_and_a_block_that_is_not_known():
    slender = exact_times(0.3, 12.0, 0.5, 0.85, 12)
    assert fit_free_rocking(slender, jr.Block(0.3, 12.0), time_noise=1e-3).notes == ()
    fit = fit_free_rocking(slender)
    assert fit.model == "linearized"
    assert "by the linearized model, the only one without a block" in str(fit)
    # Without a block peaks tell the shape.
    times = exact_times(0.3, 2.0, 0.8, 0.85, 12)
    peaks = peaks_of("nonlinear", np.arctan(0.5), launches(0.8, 0.85, 12))
    fit = fit_free_rocking(times, peak_rotations=peaks, time_noise=1e-4, rotation_noise=1e-4)
    assert any("the model matters: the nonlinear one" in text for text in fit.remarks)


@pytest.mark.thorough
@DOUBLE
def test_ordinary_tests_are_not_refused():
    """Nor does rounding keep the search from ending."""
    rng = np.random.default_rng(0)
    exact = impacts(0.95, 0.9, 20)
    for _ in range(40):
        fit_free_rocking(exact + rng.normal(0, 1e-3, 20), BLOCK, repair=False)


def changes(count, change, noise_known, tests, seed):
    """Changes of C and their p-values in many tests."""
    exact = impacts(0.95, 0.9, count, change=change)
    noise = np.random.default_rng(seed).normal(0, 1e-3, (tests, count))
    shapes = np.tile([0.1, 5.0], (tests, 1))
    known = 1e-3 if noise_known else None
    return several(exact + noise, shapes, time_noise=known)[2:]


@pytest.mark.thorough
@DOUBLE
@pytest.mark.parametrize(
    ("count", "noise_known"),
    [
        (9, False),
        *(
            pytest.param(n, k, marks=[SLOW, pytest.mark.release])
            for n in (12, 16, 20)
            for k in (False, True)
        ),
    ],
)
def test_constancy_of_restitution(count, noise_known):
    """Found as often as Student's test finds it, and not more often where there is no change."""
    tests = 400 if count == 9 else 2000
    fit = fit_free_rocking(impacts(0.95, 0.9, count), BLOCK, time_noise=1e-3)
    error = float(fit.restitution_change_error)
    freedom = count - 4
    null = stats.t(freedom)
    power = stats.nct(freedom, 3.0)
    if noise_known:
        null = stats.norm()
        power = stats.norm(3.0)
    change, p_value = changes(count, 0.0, noise_known, tests, 1)
    alarms = [np.mean(p_value < 0.05), np.mean((p_value < 0.1) & (change > 0))]
    assert change.std() == pytest.approx(error, rel=4 / (2 * tests) ** 0.5)
    change, p_value = changes(count, 3 * error, noise_known, tests, 2)
    noticed = [np.mean(p_value < 0.05), np.mean((p_value < 0.1) & (change > 0))]
    expected = [power.sf(null.ppf(1 - level)) for level in (0.025, 0.05)]
    print(
        "change", count, noise_known, "alarms", alarms, "noticed", noticed, "theory", expected
    )
    assert change.mean() == pytest.approx(3 * error, rel=0.1)
    np.testing.assert_allclose(alarms, 0.05, atol=3 * (0.05 * 0.95 / tests) ** 0.5)
    np.testing.assert_allclose(noticed, expected, atol=3 * (0.15 * 0.85 / tests) ** 0.5)


@DOUBLE
def test_a_change_is_said():
    times = impacts(0.95, 0.9, 14, change=0.05) + np.random.default_rng(4).normal(0, 1e-3, 14)
    fit = fit_free_rocking(times, BLOCK)
    ratios = launches(0.95, 0.9, 14, 0.05)
    true = np.ptp(ratios[1:] / ratios[:-1])
    assert float(fit.restitution_change) == pytest.approx(true, rel=0.1)
    (said,) = [text for text in fit.remarks if "one constant C does not explain" in text]
    assert f"changes by {-float(fit.restitution_change):.3g} " in said
    assert said in str(fit)


@DOUBLE
def test_repairs_do_not_hide_another_block():
    """Exact times of a block twice as large: leaving times out would fit them as well as noise."""
    p, angle = body(0.2, 5.0)
    times = impacts(0.9, 0.9, 12, p=p, angle=angle)
    fit = fit_free_rocking(times, BLOCK)
    assert any("the durations are not those of this block" in text for text in fit.remarks)
    assert fit.repairs == ()
    assert fit.restitution == fit_free_rocking(times, BLOCK, repair=False).restitution
    right = fit_free_rocking(np.delete(times, 5), jr.Block(0.2, 5.0))
    assert len(right.repairs) == 1
    assert float(right.restitution) == pytest.approx(0.9, rel=1e-9)


@pytest.mark.thorough
@DOUBLE
def test_both_another_block_and_a_missing_impact():
    """Both are said, and what the times said before the repairs."""
    p, angle = body(0.13, 5.0)
    times = impacts(0.9, 0.85, 16, p=p, angle=angle)
    times = times + np.random.default_rng(3).normal(0, 3e-4, 16)
    fit = fit_free_rocking(np.delete(times, 6), BLOCK)
    assert [said.endswith("is missing") for said in fit.repairs] == [True]
    assert any("the durations are not those of this block" in text for text in fit.remarks)


@DOUBLE
@SLOW
def test_what_measurements_leave_in_doubt():
    times = impacts(0.9, 0.9, 5)
    times = times + np.random.default_rng(4).normal(0, 1e-3, 5)
    guess = "2 degrees of freedom: the noise, and with it every standard error, is a guess"
    assert guess in fit_free_rocking(times, BLOCK).remarks
    known = fit_free_rocking(times, BLOCK, time_noise=1e-3).notes
    assert not any("freedom" in text for text in known)
    peaks = peaks_of("nonlinear", ANGLE, launches(0.9, 0.9, 10)) * np.array([3] + [1] * 8)
    above = fit_free_rocking(impacts(0.9, 0.9, 10), BLOCK, peak_rotations=peaks)
    assert any("1 peak rotation is at or above the critical angle" in s for s in above.remarks)


@pytest.mark.thorough
@DOUBLE
@pytest.mark.parametrize("model", MODELS)
def test_another_block(model):
    """30 % off in width: said, and mended by a free p."""
    times = impacts(0.9, 0.85, 14, model) + np.random.default_rng(6).normal(0, 1e-3, 14)
    for wrong in (jr.Block(0.13, 5.0), jr.Block(0.07, 5.0)):
        fit = fit_free_rocking(times, wrong, model=model)
        assert fit.frequency_p_value < 1e-3
        assert any("the durations are not those of this block" in text for text in fit.remarks)
        free = fit_free_rocking(times, wrong, model=model, frequency_known=False)
        error = float(free.standard_errors["frequency_parameter"])
        assert abs(float(free.frequency_parameter) - P) < 4 * error < 0.1
        assert free.block.half_width == pytest.approx(0.1, rel=0.05)
        assert np.isnan(free.frequency_p_value)
        assert free.repairs == free.remarks == ()
    assert fit_free_rocking(times, BLOCK, model=model).frequency_p_value > 0.01


@pytest.mark.thorough
@DOUBLE
def test_motions_that_are_no_free_rocking():
    growing = np.append(0, np.cumsum(2 / P * np.arctanh(0.3 * 1.1 ** np.arange(9))))
    random = [np.random.default_rng(seed).exponential(0.4, 12).cumsum() for seed in range(10)]
    for times in (growing, *random):
        with pytest.raises(ValueError, match=r"^impact_times must be from .*$"):
            fit_free_rocking(times, BLOCK)


@pytest.mark.thorough
def test_either_precision(eps):
    """Times to a microsecond, as well as a float32 holds them."""
    tolerance = max(1e-3 if eps > 1e-10 else 1e-5, eps)
    times = impacts(0.9, 0.9, 12) - 1
    for options in ({}, {"frequency_known": False}):
        fit = fit_free_rocking(jnp.asarray(np.round(times, 6)), BLOCK, **options)
        assert fit.restitution.dtype == jnp.result_type(float)
        assert float(fit.restitution) == pytest.approx(0.9, rel=tolerance)
        assert float(fit.frequency_parameter) == pytest.approx(P, rel=tolerance)
        assert float(fit.launch_ratio) == pytest.approx(0.9, rel=tolerance)


# A block on a table that moves like one sine, and what is measured of it.
TABLE = jr.Block(0.2, 5.0)
SINE = jr.Sine(amplitude=2.5, duration=0.8)
SAMPLES = 201
TIME = np.linspace(0, 4, SAMPLES)


def rotations(restitution=0.85, block=TABLE, motion=SINE, time=TIME, **begin):
    response = jr.respond(block, restitution, motion, float(time[-1]), **begin)
    return np.asarray(response.history(jnp.asarray(time))[0])


def noisy(rotation, size=0.005, seed=0):
    noise = size * np.abs(rotation).max()
    return rotation + np.random.default_rng(seed).normal(0, noise, rotation.shape), noise


@pytest.mark.thorough
@DOUBLE
def test_driven_restitution():
    exact = rotations()
    fit = fit_driven_rocking(TIME, exact, TABLE, SINE)
    assert float(fit.restitution) == pytest.approx(0.85, abs=1e-7)
    assert fit.same_order
    assert fit.status == jr.Status.COMPLETE
    assert fit.remarks == ()
    np.testing.assert_allclose(fit.rotation, exact, atol=1e-7)
    measured, noise = noisy(exact)
    measured[50:60] = NAN
    fit = fit_driven_rocking(TIME, measured, TABLE, SINE)
    error = float(fit.standard_errors["restitution"])
    assert abs(float(fit.restitution) - 0.85) < 4 * error < 4e-3
    assert float(fit.rotation_noise) == pytest.approx(noise, rel=0.2)
    np.testing.assert_array_equal(np.isnan(fit.residuals), np.isnan(measured))
    assert float(fit.used_until) == float(fit.last_time) == 4.0


@DOUBLE
@SLOW
def test_driven_errors_by_differences():
    measured, noise = noisy(rotations())
    fit = fit_driven_rocking(TIME, measured, TABLE, SINE, rotation_noise=noise)
    at = float(fit.restitution)
    slope = (rotations(at + 1e-5) - rotations(at - 1e-5)) / 2e-5
    expected = noise / np.linalg.norm(slope)
    assert float(fit.standard_errors["restitution"]) == pytest.approx(expected, rel=0.01)


@DOUBLE
@SLOW
@pytest.mark.release
def test_driven_errors_by_repetition():
    exact = rotations()
    off = []
    stated = []
    for seed in range(40):
        fit = fit_driven_rocking(TIME, noisy(exact, seed=seed)[0], TABLE, SINE, 0.8)
        off.append(float(fit.restitution) - 0.85)
        stated.append(float(fit.standard_errors["restitution"]))
    print(
        "scatter over stated",
        np.std(off) / np.mean(stated),
        "mean",
        np.mean(off) / np.mean(stated),
    )
    assert abs(np.mean(off)) < 3 * np.mean(stated) / 40**0.5
    assert np.std(off) / np.mean(stated) == pytest.approx(1, abs=0.35)


@DOUBLE
@SLOW
@pytest.mark.parametrize(
    "parameters",
    [("restitution", "slenderness"), ("restitution", "slenderness", "inertia_ratio")],
)
def test_driven_parameters(parameters):
    """From a block that is 2 % off."""
    measured, _ = noisy(rotations())
    guess = jr.Block(0.2, 5.1, inertia_ratio=1.36 if len(parameters) == 3 else 4 / 3)
    fit = fit_driven_rocking(TIME, measured, guess, SINE, parameters=parameters)
    true = {"restitution": 0.85, "slenderness": 5.0, "inertia_ratio": 4 / 3}
    for name in parameters:
        error = float(fit.standard_errors[name])
        assert abs(float(fit.values[name]) - true[name]) < 4 * error < 0.04 * true[name], name
    assert float(fit.block.slenderness) == float(fit.values["slenderness"])
    assert fit.covariance.shape == (len(parameters),) * 2
    assert fit.status == jr.Status.COMPLETE
    assert fit.same_order


@DOUBLE
@SLOW
def test_driven_from_a_point_mass():
    """An inertia ratio of 1, the least there is, is a start like another one."""
    measured, _ = noisy(rotations())
    guess = jr.Block(0.2, 5.0, inertia_ratio=1.0)
    names = ("restitution", "inertia_ratio")
    fit = fit_driven_rocking(TIME, measured, guess, SINE, parameters=names)
    error = float(fit.standard_errors["restitution"])
    assert abs(float(fit.restitution) - 0.85) < 4 * error < 0.04
    assert float(fit.values["inertia_ratio"]) == pytest.approx(4 / 3, rel=0.02)


@DOUBLE
@SLOW
@pytest.mark.release
def test_driven_by_a_record():
    record = jr.example_record()
    block = jr.Block(0.3, 5.0)
    time = np.linspace(0, 40, 2001)
    measured, noise = noisy(rotations(0.9, block, record, time))
    fit = fit_driven_rocking(time, measured, block, record)
    error = float(fit.standard_errors["restitution"])
    print("record", fit.restitution, error, fit.used_until, fit.remarks)
    assert abs(float(fit.restitution) - 0.9) < 4 * error < 4e-3
    assert float(fit.rotation_noise) == pytest.approx(noise, rel=0.1)
    assert fit.status == jr.Status.COMPLETE


@DOUBLE
@SLOW
@pytest.mark.parametrize("wrong", ["block", "motion"])
def test_driven_by_something_else(wrong):
    """It cannot pass for a fit."""
    measured, _ = noisy(rotations())
    block = jr.Block(0.2, 5.5) if wrong == "block" else TABLE
    motion = jr.Sine(amplitude=3.2, duration=0.7) if wrong == "motion" else SINE
    fit = fit_driven_rocking(TIME, measured, block, motion)
    assert fit.status == jr.Status.NOT_CONVERGED
    assert "the search has not converged" in fit.remarks


@DOUBLE
@SLOW
def test_a_table_that_stands_still():
    """Free rocking from a tilt; the two fits agree."""
    still = jr.Record(np.zeros(11), 0.4)
    measured, _ = noisy(rotations(0.9, TABLE, still, rotation=0.15))
    fit = fit_driven_rocking(TIME, measured, TABLE, still, initial_rotation=0.15)
    error = float(fit.standard_errors["restitution"])
    assert abs(float(fit.restitution) - 0.9) < 4 * error < 0.01
    p, angle = body(0.2, 5.0)
    launch = 0.9 * np.sqrt((np.cos(angle - 0.15) - np.cos(angle)) / (1 - np.cos(angle)))
    times = impacts(launch, 0.9, 8, "nonlinear", p, angle)
    free = fit_free_rocking(times, TABLE, model="nonlinear")
    assert abs(float(free.restitution) - float(fit.restitution)) < 4 * error
