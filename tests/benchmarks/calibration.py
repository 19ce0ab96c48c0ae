"""Fits of tests and steady orbits: first calls and next ones.

Run as ``python tests/benchmarks/calibration.py``.
"""

import statistics
import time

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np

import jaxrock as jr

BLOCK = jr.Block(half_width=0.1, slenderness=5.0)


def show(name, run, repeats=5):
    """Print the time of the first call and the median of the next ones."""
    times = []
    for _ in range(repeats + 1):
        start = time.perf_counter()
        jax.block_until_ready(jax.tree.leaves(run()))
        times.append(time.perf_counter() - start)
    print(f"{name:44} first {times[0]:6.2f} s, next {statistics.median(times[1:]):7.4f} s")


def impact_times(count, impacts, seed=0):
    """Tests of a block with restitutions from 0.7 to 0.95, with 1 ms of noise."""
    random = np.random.default_rng(seed)
    restitution = random.uniform(0.7, 0.95, (count, 1))
    ratios = 0.9 * restitution ** np.arange(impacts - 1)
    durations = 2 * np.arctanh(ratios) / float(BLOCK.frequency_parameter)
    times = np.concatenate([np.zeros((count, 1)), np.cumsum(durations, axis=1)], axis=1)
    return times + 1e-3 * random.standard_normal(times.shape)


def main():
    """Print all."""
    tests = impact_times(1000, 9)

    def many(**options):
        return [
            jr.calibration.fit_free_rocking(t, BLOCK, repair=False, **options).restitution
            for t in tests
        ]

    show("1,000 fits, p known", many, 1)
    show("1,000 fits, p fitted", lambda: many(frequency_known=False), 1)
    show("one fit, repairs sought", lambda: jr.calibration.fit_free_rocking(tests[0], BLOCK))
    show(
        "another, of fewer impacts",
        lambda: jr.calibration.fit_free_rocking(tests[1][:7], BLOCK),
    )
    pulse = jr.Sine(2.5, 0.8)
    samples = np.linspace(0, 4, 201)
    rotation, _ = jr.respond(jr.Block(0.2, 5.0), 0.85, pulse, 4.0).history(samples)
    test = samples, rotation, jr.Block(0.2, 5.0), pulse
    show("a test on a shaking table, pulse", lambda: jr.calibration.fit_driven_rocking(*test))
    amplitudes = np.linspace(1.0, 10.0, 10_000)
    for model in (jr.Linearized(), jr.Nonlinear()):
        show(
            f"10,000 steady orbits, {model.name}",
            lambda model=model: jr.steady.harmonic_orbit(
                BLOCK, 0.9, amplitudes, 20.0, model=model
            ),
        )
    grid = np.linspace(1, 12, 100), np.geomspace(0.05, 12, 100)
    show(
        "spectrum of 10,000 points, 100 periods",
        lambda: jr.spectra.harmonic_spectrum(*grid).region,
        2,
    )


if __name__ == "__main__":
    main()
