"""What is measured where: ``python tests/tools/measured.py`` writes the table into the docs.

Each row is measured afresh, in about three minutes; what it says is tested in the file that
stands in the row, on more cases and against its bound. Times are medians on the machine that
this runs on, after compilation.
"""

import os
import sys
from importlib.metadata import version
from pathlib import Path

import jax

TESTS = Path(__file__).parent.parent
if __name__ == "__main__":
    sys.path[:0] = [str(TESTS), str(TESTS / "benchmarks")]
    jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp
import mpmath as mp
import numpy as np
from benchmarks.response import make_batch, measure, respond
from references.stepping import Rocker, follow, pulse
from tables.closed_form_cases import CASES, evaluate

import jaxrock as jr
from jaxrock.reports import paper

PAGE = TESTS.parent / "docs" / "speed_and_accuracy.md"
BEGIN = "<!-- measured: begin -->\n"
END = "<!-- measured: end -->\n"
BLOCK = jr.Block(0.25, 5.0)
RICKER = jr.Ricker(3.2, 0.7)


def find_exact(case, row):
    """The exact value and slopes at the arguments of a sample, and its condition number."""
    arguments = tuple(mp.mpf(float(a)) for a in row)
    value = case.theirs(*arguments)
    # Rounding the arguments may take it past the threshold, where it is complex.
    if isinstance(value, mp.mpc):
        return None
    orders = np.eye(len(arguments), dtype=int)
    slopes = [mp.diff(case.theirs, arguments, tuple(map(int, order))) for order in orders]
    products = (abs(a * s) for a, s in zip(arguments, slopes, strict=True))
    return value, slopes, float(sum(products) / abs(value))


def list_samples(dtype):
    """Samples of each closed form, and what is exact there."""
    for case in CASES.values():
        samples = case.sample(np.random.default_rng(7), 20, dtype)
        yield (
            case,
            samples,
            [find_exact(case, r) for r in zip(*samples.arguments, strict=True)],
        )


def measure_values(dtype):
    """Units in the last place over 1 + condition number, the worst of all closed forms."""
    eps = float(np.finfo(dtype).eps)
    worst = 0.0
    for case, samples, exact in list_samples(dtype):
        for ours, known in zip(evaluate(case, samples, dtype), exact, strict=True):
            if known is not None and known[2] * eps < 0.01:
                unit = mp.mpf(2) ** mp.floor(mp.log(abs(known[0]), 2)) * eps
                error = float(abs(mp.mpf(float(ours)) - known[0]) / unit)
                worst = max(worst, error / (1 + known[2]))
    return f"{worst:.1f} (1 + K) units in the last place"


def measure_slopes():
    """The worst relative error of a slope, where a thousandth of the barrier or more is left."""
    worst = 0.0
    for case, samples, exact in list_samples(np.float64):
        if case.path:
            continue
        arguments = tuple(map(jnp.asarray, samples.arguments))
        differentiate = jax.grad(case.ours, tuple(range(len(arguments))))
        ours = np.transpose(jax.jit(jax.vmap(differentiate))(*arguments))
        for row, x, known in zip(ours, samples.x, exact, strict=True):
            if known is not None and 1 - x**2 >= 1e-3:
                for slope, right in zip(row, known[1], strict=True):
                    if not isinstance(right, mp.mpc) and abs(right) > 1e-60 * abs(known[0]):
                        worst = max(worst, float(abs(mp.mpf(float(slope)) / right - 1)))
    return f"{worst:.0e}"


def count_entries():
    """How many of the paper's printed entries come out."""
    count = paper.regenerate().summarize()
    compared = f"{count['agreeing']} of {count['printed']} to the last digit"
    return f"{compared}, {count['known_faults_in_tables']} a fault of the paper"


def measure_impacts():
    """The worst relative error of the times of 20 impacts of free rocking."""
    block = jr.Block(0.4, 5.0)
    model = jr.Nonlinear()
    launch = 0.9 * model.critical_velocity(block)
    times = np.cumsum(model.half_cycle_duration(block, launch * 0.9 ** jnp.arange(20)))
    still = jr.Rectangular(0.0, 1.0)
    options = {"velocity": launch, "rtol": 1e-11}
    response = jr.respond(block, 0.9, still, float(times[-1]) * 1.001, **options)
    return f"{np.max(np.abs(response.impact_times[:20] / times - 1)):.0e}"


def respond_to_ricker(c):
    return jr.respond(BLOCK, c, RICKER, 4.0, rtol=1e-11)


def follow_ricker(c):
    return follow(Rocker(0.25, 5.0, c), pulse("Ricker", 3.2, 0.7), 1.2)


def compare_motions():
    """Peak and margin after several impacts against SciPy with events."""
    ours, theirs = respond_to_ricker(0.85), follow_ricker(0.85)
    apart = (ours.peak_rotation / theirs.peak[0] - 1, ours.margin / theirs.margin[0] - 1)
    return f"{max(abs(float(each)) for each in apart):.0e}"


def compare_derivatives():
    """Of a peak after several impacts to C, against extrapolated differences of SciPy."""

    def difference(h):
        up, down = (follow_ricker(0.85 + sign * h).peak[0] for sign in (1, -1))
        return (up - down) / (2 * h)

    exact = (4 * difference(2e-4) - difference(4e-4)) / 3
    slope = jax.jacfwd(lambda c: respond_to_ricker(c).peak_rotation)(0.85)
    return f"{abs(float(slope) / exact - 1):.0e}"


def measure_thresholds():
    """Housner's rectangular pulses, linearized: A = 1 / (1 - exp(-p t))."""
    block = jr.Block(0.3, 6.0)
    times = np.array([0.5, 1.0, 2.0])
    durations = times / block.frequency_parameter
    shape = jr.Rectangular
    found = jr.critical_amplitude(block, 0.9, shape, durations, model="linearized")
    ratio = found.value[:, 0] / (9.81 * block.critical_angle)
    return f"{np.abs(ratio * -np.expm1(-times) - 1).max():.0e}"


def measure_tolerance():
    """Peaks at the default tolerance against 1e-13 on the record, of blocks that stay regular."""
    block = jr.Block(jnp.linspace(0.2, 1.0, 40), 5.0)
    record = jr.example_record().scaled(1.3)
    regular = np.asarray(jr.respond_within(block, 0.9, record, 1e-6).within_tolerance)
    usual = jr.respond_batch(block, 0.9, record).peak_rotation
    exact = jr.respond_batch(block, 0.9, record, rtol=1e-13).peak_rotation
    apart = np.abs(np.asarray(usual / exact) - 1)[regular]
    return f"{np.median(apart):.0e} in the median of {regular.sum()}"


def format_time(call, digits=0):
    return f"{1e3 * measure(call):.{digits}f} ms"


def time_million(model, sloped=False):
    """A million rotation ratios, without or with their slopes."""
    scenes = jr.Scene(jr.Block(jnp.linspace(0.2, 0.6, 1_000_000), 5.0), 0.7, 0.15)

    def ratio(scene):
        return jr.rotation_ratio(scene, model)

    run = jr.value_and_slopes(ratio) if sloped else jax.jit(ratio)
    return format_time(lambda: run(scenes))


def time_intensities():
    """A hundred thousand critical intensities in five half-cycles."""
    run = jax.jit(lambda block: jr.critical_intensity(block, 0.7, 5.0, jr.Nonlinear()))
    block = jr.Block(jnp.linspace(0.2, 0.6, 100_000), 5.0)
    return format_time(lambda: run(block), 1)


def time_single():
    """One block on the record, 40 s, adaptively."""
    record = jr.example_record()
    run = jax.jit(lambda c: jr.respond(jr.Block(0.2, 5.0), c, record, 40.0).peak_rotation)
    return format_time(lambda: run(jnp.asarray(0.9)))


def time_batch(count):
    """Blocks of all sizes and shapes on the record, 40 s, side by side."""
    batch = make_batch(count)
    return format_time(lambda: respond(batch))


LINEARIZED, NONLINEAR = jr.Linearized(), jr.Nonlinear()
TIMES = "times of 20 impacts of free rocking, relative"
SLOPE = "derivative of a peak with respect to C through impacts, relative"
# What, the measurement, and the file of the test or benchmark.
ROWS = (
    (
        "closed forms in float64 against 70 digits",
        lambda: measure_values(np.float64),
        "accuracy",
    ),
    (
        "closed forms in float32 against 70 digits",
        lambda: measure_values(np.float32),
        "accuracy",
    ),
    ("derivatives of closed forms, relative, float64", measure_slopes, "accuracy"),
    ("the paper's tables", count_entries, "paper"),
    (TIMES, measure_impacts, "response"),
    ("peak and margin through impacts against SciPy, relative", compare_motions, "response"),
    (SLOPE, compare_derivatives, "response"),
    ("Housner's critical rectangular pulses, relative", measure_thresholds, "boundaries"),
    ("the default tolerance against 1e-13 on a record", measure_tolerance, "choose"),
    ("a million rotation ratios, linearized", lambda: time_million(LINEARIZED), "/spectrum"),
    ("a million rotation ratios, nonlinear", lambda: time_million(NONLINEAR), "/spectrum"),
    (
        "nonlinear, with their four derivatives",
        lambda: time_million(NONLINEAR, True),
        "/spectrum",
    ),
    ("100,000 critical intensities, nonlinear", time_intensities, "/critical"),
    ("one block on 40 s of a record, `respond`", time_single, "/response"),
    ("1,000 of them, `respond_batch`", lambda: time_batch(1000), "/response"),
    ("10,000 of them", lambda: time_batch(10_000), "/response"),
)


def main():
    """Measure, print and write."""
    mp.mp.dps = 70
    device = jax.devices()[0].device_kind
    lines = [f"Measured with JAX {version('jax')} on {os.cpu_count()} cores ({device})."]
    lines += ["", "| what | measured | tested in |", "|---|---|---|"]
    for what, run, where in ROWS:
        file = f"benchmarks{where}" if where.startswith("/") else f"test_{where}"
        lines.append(f"| {what} | {run()} | `tests/{file}.py` |")
        print(lines[-1], flush=True)
    before, after = PAGE.read_text(encoding="utf-8").split(BEGIN)
    table = BEGIN + "\n".join(lines) + "\n" + END
    PAGE.write_text(before + table + after.split(END)[1], encoding="utf-8")


if __name__ == "__main__":
    main()
