"""A closed-form spectrum of a million points: jaxrock against the same formulas in NumPy.

Run as ``python tests/benchmarks/spectrum.py``. All are timed in turn in one run, after
compilation, five times in a row each: the first call after another contender's pays for
memory that the other one gave back, and does not count. The ratios of the medians count,
since single times depend on what else runs.
Slopes are those to slenderness, half-width, restitution and intensity.
"""

import statistics
import time

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp
import numpy as np

import jaxrock as jr

AXES = (np.linspace(3, 10, 100), np.linspace(0.2, 0.6, 100), np.linspace(0.5, 0.8, 100))
INTENSITY = 0.15
GRAVITY = 9.81
ROUNDS = 7
REPEATS = 5


def linearized_by_hand(slenderness, half_width, restitution, intensity):
    square = 1 + slenderness**2
    critical = np.arctan(1 / slenderness) * np.sqrt(
        0.75 * GRAVITY / (half_width * np.sqrt(square))
    )
    launch = 0.75 * slenderness * intensity / (half_width * square)
    x = launch / (1 - restitution) / critical
    return np.where(x < 1, x**2 / (1 + np.sqrt(np.maximum((1 - x) * (1 + x), 0))), np.nan)


def nonlinear_by_hand(slenderness, half_width, restitution, intensity):
    diagonal = np.sqrt(1 + slenderness**2)
    angle = np.arctan(1 / slenderness)
    sine = np.sin(angle / 2)
    critical = 2 * np.sqrt(0.75 * GRAVITY / (half_width * diagonal)) * sine
    launch = 0.75 * slenderness * intensity / (half_width * diagonal**2)
    x = launch / (1 - restitution) / critical
    left = np.maximum((1 - x) * (1 + x), 0)
    return np.where(x < 1, 1 - 2 * np.arcsin(sine * np.sqrt(left)) / angle, np.nan)


def differences(function, arguments, central):
    """Values, and slopes by finite differences."""
    values = function(*arguments)
    slopes = []
    for position, argument in enumerate(arguments):
        step = 1e-6 * argument
        up = list(arguments)
        down = list(arguments)
        up[position] = argument + step
        if central:
            down[position] = argument - step
            slopes.append((function(*up) - function(*down)) / (2 * step))
        else:
            slopes.append((function(*up) - values) / step)
    return values, slopes


def with_jaxrock(model):
    def ratio(slenderness, half_width, restitution, intensity):
        block = jr.Block(half_width, slenderness, GRAVITY)
        return jr.rotation_ratio(jr.Scene(block, restitution, intensity), model)

    return ratio


def peak_memory(function, arguments):
    """Of a compiled function, over its inputs and outputs."""
    memory = jax.jit(function).lower(*arguments).compile().memory_analysis()
    both = memory.argument_size_in_bytes + memory.output_size_in_bytes
    return (both + memory.temp_size_in_bytes) / both


def kind(name, by_hand, model, grid):
    on_device = [jnp.asarray(a) for a in grid]
    ratio = with_jaxrock(model)
    sloped = jr.value_and_slopes(ratio, (0, 1, 2, 3))
    values = jax.jit(ratio)
    contenders = {
        "NumPy": lambda: by_hand(*grid),
        "NumPy, forward differences": lambda: differences(by_hand, grid, False),
        "NumPy, central differences": lambda: differences(by_hand, grid, True),
        "jaxrock": lambda: values(*on_device),
        "jaxrock, 4 slopes": lambda: sloped(*on_device),
    }
    np.testing.assert_allclose(values(*on_device), by_hand(*grid), rtol=1e-9)
    for ours, theirs in zip(
        sloped(*on_device)[1], differences(by_hand, grid, True)[1], strict=True
    ):
        np.testing.assert_allclose(np.nanmedian(np.abs(ours / theirs - 1)), 0, atol=1e-6)
    times = {contender: [] for contender in contenders}
    for _ in range(ROUNDS):
        for contender, run in contenders.items():
            for repeat in range(REPEATS + 1):
                start = time.perf_counter()
                jax.block_until_ready(run())
                if repeat:
                    times[contender].append(time.perf_counter() - start)
    taken = {contender: statistics.median(times[contender]) for contender in times}
    print(name)
    for contender, median in taken.items():
        print(f"  {contender:28} {1e3 * median:7.1f} ms")

    def against(label, one, other, bar):
        print(f"  {label:52} {taken[one] / taken[other]:6.2f}   (bar: {bar})")

    against("NumPy over jaxrock, values", "NumPy", "jaxrock", "at least 2")
    against("4 slopes over values", "jaxrock, 4 slopes", "jaxrock", "below 3")
    slopes = "jaxrock, 4 slopes"
    against(
        "central differences over 4 slopes", "NumPy, central differences", slopes, "at least 5"
    )
    against("forward differences over 4 slopes", "NumPy, forward differences", slopes, "none")
    for label, function in (("values", ratio), ("4 slopes", sloped)):
        peak = peak_memory(function, on_device)
        print(
            f"  {f'peak memory over inputs and outputs, {label}':52} {peak:6.2f}   (bar: below 2)"
        )


def main():
    """Print times and ratios, with the bar beside each ratio."""
    grid = [a.ravel() for a in np.meshgrid(*AXES, indexing="ij")]
    grid.append(np.full_like(grid[0], INTENSITY))
    kind("linearized", linearized_by_hand, jr.Linearized(), grid)
    kind("nonlinear", nonlinear_by_hand, jr.Nonlinear(), grid)


if __name__ == "__main__":
    main()
