"""What is measured where: ``python tests/tools/measured.py`` writes the table into the docs.

Each row is measured afresh, in about three minutes; what it says is tested in the file that
stands in the row, on more cases and against its bound. Times are medians on the machine that
this runs on, after compilation.
"""

import functools
import os
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import jax

TESTS = Path(__file__).parent.parent
if __name__ == "__main__":
    sys.path.insert(0, str(TESTS))
    jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp
import mpmath as mp
import numpy as np
from benchmarks.response import batch, median
from references.stepping import Rocker, follow, pulse
from tables.closed_form_cases import CASES, evaluate

import jaxrock as jr

PAGE = TESTS.parent / "docs" / "speed_and_accuracy.md"
BEGIN = "<!-- measured: begin -->\n"
END = "<!-- measured: end -->\n"
SEED = 7
SAMPLES = 20
STILL = jr.Rectangular(0.0, 1.0)


class Row(NamedTuple):
    what: str
    where: str
    measure: Callable[[], str]


def _exact(case, samples):
    """Values and slopes in 70 digits at exactly the same arguments."""
    for index, arguments in enumerate(zip(*samples.arguments, strict=True)):
        exact = tuple(mp.mpf(float(a)) for a in arguments)
        value = case.theirs(*exact)
        if isinstance(value, mp.mpc):  # rounding the arguments took it past the verge
            continue
        orders = np.eye(len(exact), dtype=int)
        slopes = [mp.diff(case.theirs, exact, tuple(map(int, order))) for order in orders]
        condition = sum(abs(a * s) for a, s in zip(exact, slopes, strict=True)) / abs(value)
        yield index, value, slopes, float(condition)


def values(dtype):
    """Units in the last place over 1 + condition number, the worst of all closed forms."""
    eps = float(np.finfo(dtype).eps)
    worst = 0.0
    for case in CASES.values():
        samples = case.sample(np.random.default_rng(SEED), SAMPLES, dtype)
        ours = evaluate(case, samples, dtype)
        for index, value, _, condition in _exact(case, samples):
            if condition * eps < 0.01:
                unit = mp.mpf(2) ** mp.floor(mp.log(abs(value), 2)) * eps
                error = float(abs(mp.mpf(float(ours[index])) - value) / unit)
                worst = max(worst, error / (1 + condition))
    return f"{worst:.1f} (1 + K) units in the last place"


def closed_slopes():
    """The worst relative error of a slope, where a thousandth of the barrier or more is left."""
    worst = 0.0
    for case in CASES.values():
        if case.path:
            continue
        samples = case.sample(np.random.default_rng(SEED), SAMPLES, np.float64)
        arguments = tuple(map(jnp.asarray, samples.arguments))
        found = jax.jit(jax.vmap(jax.grad(case.ours, tuple(range(len(arguments))))))(
            *arguments
        )
        for index, value, slopes, _ in _exact(case, samples):
            if 1 - samples.x[index] ** 2 < 1e-3:
                continue
            for ours, exact in zip(found, slopes, strict=True):
                if not isinstance(exact, mp.mpc) and abs(exact) > 1e-60 * abs(value):
                    worst = max(worst, float(abs(mp.mpf(float(ours[index])) / exact - 1)))
    return f"{worst:.0e}"


def paper():
    """How many of the printed entries come out."""
    from jaxrock.reports import paper

    count = paper.regenerate().summarize()
    faults = count["known_faults_in_tables"]
    compared = f"{count['agreeing']} of {count['printed']} to the last digit"
    return f"{compared}, {faults} a fault of the paper"


def impacts():
    """The worst relative error of the times of 20 impacts of free rocking."""
    block = jr.Block(0.4, 5.0)
    c = 0.9
    model = jr.Nonlinear()
    launch = 0.9 * model.critical_velocity(block)
    times = np.cumsum(model.half_cycle_duration(block, launch * c ** jnp.arange(20)))
    found = jr.respond(block, c, STILL, float(times[-1]) * 1.001, velocity=launch, rtol=1e-11)
    return f"{np.max(np.abs(found.impact_times[:20] / times - 1)):.0e}"


def scipy():
    """Peak and margin after several impacts against SciPy with events."""
    block = jr.Block(0.25, 5.0)
    c = 0.85
    ricker = jr.Ricker(3.2, 0.7)
    ours = jr.respond(block, c, ricker, 4.0, rtol=1e-11)
    theirs = follow(Rocker(0.25, 5.0, c), pulse("Ricker", 3.2, 0.7), 1.2)
    apart = (ours.peak_rotation / theirs.peak[0] - 1, ours.margin / theirs.margin[0] - 1)
    return f"{max(abs(float(each)) for each in apart):.0e}"


def thresholds():
    """Housner's rectangular pulses, linearized: A = 1 / (1 - exp(-p t))."""
    block = jr.Block(0.3, 6.0)
    worst = 0.0
    for duration in (0.5, 1.0, 2.0):
        found = jr.critical_amplitude(
            block,
            0.9,
            jr.Rectangular,
            duration / block.frequency_parameter,
            model="linearized",
        )
        ratio = found.value[0] / (9.81 * block.critical_angle)
        worst = max(worst, abs(float(ratio * -np.expm1(-duration)) - 1))
    return f"{worst:.0e}"


def driven_slope():
    """Of a peak after several impacts to C, against extrapolated differences of SciPy."""

    def ours(c):
        return jr.respond(
            jr.Block(0.25, 5.0), c, jr.Ricker(3.2, 0.7), 4.0, rtol=1e-11
        ).peak_rotation

    def theirs(h):
        def peak(c):
            return follow(Rocker(0.25, 5.0, c), pulse("Ricker", 3.2, 0.7), 1.2).peak[0]

        return (peak(0.85 + h) - peak(0.85 - h)) / (2 * h)

    exact = (4 * theirs(2e-4) - theirs(4e-4)) / 3
    return f"{abs(float(jax.jacfwd(ours)(0.85)) / exact - 1):.0e}"


def tolerances():
    """Peaks at the default tolerance against 1e-13 on the record, of blocks that stay regular."""
    block = jr.Block(jnp.linspace(0.2, 1.0, 40), 5.0)
    within = jr.respond_within(block, 0.9, jr.example_record().scaled(1.3), 1e-6)
    regular = np.asarray(within.within_tolerance)
    peaks = [
        np.asarray(
            jr.respond_batch(block, 0.9, jr.example_record().scaled(1.3), **rtol).peak_rotation
        )
        for rtol in ({}, {"rtol": 1e-13})
    ]
    apart = np.abs(peaks[0] / peaks[1] - 1)[regular]
    return f"{np.median(apart):.0e} in the median of {regular.sum()}"


def million(model, slopes=False):
    """A million rotation ratios, without or with their slopes."""
    half_width = jnp.linspace(0.2, 0.6, 1_000_000)
    scenes = jr.Scene(jr.Block(half_width, 5.0), 0.7, 0.15)

    def ratio(scene):
        return jr.rotation_ratio(scene, model)

    run = jr.value_and_slopes(ratio) if slopes else jax.jit(ratio)
    return f"{1e3 * median(lambda: jax.block_until_ready(run(scenes)), 9):.0f} ms"


def intensities():
    """A hundred thousand critical intensities in five half-cycles."""
    run = jax.jit(lambda block: jr.critical_intensity(block, 0.7, 5.0, jr.Nonlinear()))
    block = jr.Block(jnp.linspace(0.2, 0.6, 100_000), 5.0)
    return f"{1e3 * median(lambda: jax.block_until_ready(run(block)), 9):.1f} ms"


def one():
    """One block on the record, 40 s, adaptively."""
    record = jr.example_record()
    run = jax.jit(lambda c: jr.respond(jr.Block(0.2, 5.0), c, record, 40.0).peak_rotation)
    return f"{1e3 * median(lambda: jax.block_until_ready(run(jnp.asarray(0.9))), 9):.0f} ms"


def many(count):
    """Blocks of all sizes and shapes on the record, 40 s, side by side."""
    block, c, record = batch(count, jnp.float64)
    run = functools.partial(jr.respond_batch, block, c, record, 40.0)
    return f"{1e3 * median(lambda: jax.block_until_ready(run()), 9):.0f} ms"


ACCURACY = "tests/test_accuracy.py"
RESPONSE = "tests/test_response.py"
SPEED = "tests/benchmarks/spectrum.py"
ROWS = (
    Row("closed forms in float64 against 70 digits", ACCURACY, lambda: values(np.float64)),
    Row("closed forms in float32 against 70 digits", ACCURACY, lambda: values(np.float32)),
    Row("derivatives of closed forms, relative, float64", ACCURACY, closed_slopes),
    Row("the paper's tables", "tests/test_paper.py", paper),
    Row("times of 20 impacts of free rocking, relative", RESPONSE, impacts),
    Row("peak and margin through impacts against SciPy, relative", RESPONSE, scipy),
    Row(
        "derivative of a peak with respect to C through impacts, relative",
        RESPONSE,
        driven_slope,
    ),
    Row(
        "Housner's critical rectangular pulses, relative",
        "tests/test_boundaries.py",
        thresholds,
    ),
    Row("the default tolerance against 1e-13 on a record", "tests/test_choose.py", tolerances),
    Row("a million rotation ratios, linearized", SPEED, lambda: million(jr.Linearized())),
    Row("a million rotation ratios, nonlinear", SPEED, lambda: million(jr.Nonlinear())),
    Row(
        "nonlinear, with their four derivatives", SPEED, lambda: million(jr.Nonlinear(), True)
    ),
    Row(
        "100,000 critical intensities, nonlinear", "tests/benchmarks/critical.py", intensities
    ),
    Row("one block on 40 s of a record, `respond`", "tests/benchmarks/response.py", one),
    Row("1,000 of them, `respond_batch`", "tests/benchmarks/response.py", lambda: many(1000)),
    Row("10,000 of them", "tests/benchmarks/response.py", lambda: many(10_000)),
)


def table(figures):
    """The table in Markdown."""
    rows = [f"| {row.what} | {figure} | `{row.where}` |" for row, figure in figures]
    device = jax.devices()[0].device_kind
    where = f"Measured with JAX {version('jax')} on {os.cpu_count()} cores ({device})."
    return "\n".join(
        [where, "", "| what | measured | tested in |", "|---|---|---|", *rows, ""]
    )


def main():
    """Measure, print and write."""
    mp.mp.dps = 70
    figures = []
    for row in ROWS:
        figures.append((row, row.measure()))
        print(f"{row.what}: {figures[-1][1]}", flush=True)
    text = PAGE.read_text(encoding="utf-8")
    if text.count(BEGIN) != 1 or text.count(END) != 1:
        sys.exit(f"{PAGE} must have the two marks of the table once each")
    before, rest = text.split(BEGIN)
    PAGE.write_text(
        before + BEGIN + table(figures) + END + rest.split(END)[1], encoding="utf-8"
    )


if __name__ == "__main__":
    main()
