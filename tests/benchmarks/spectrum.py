"""A closed-form spectrum of a million points: jaxrock against the same formulas in NumPy.

Run as ``python tests/benchmarks/spectrum.py``. Slopes are those to slenderness, half-width,
restitution and intensity.
"""

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp
import numpy as np
from timing import time_in_turn

import jaxrock as jr

AXES = (np.linspace(3, 10, 100), np.linspace(0.2, 0.6, 100), np.linspace(0.5, 0.8, 100))
INTENSITY = 0.15


def compute_by_hand(linearized, slenderness, half_width, restitution, intensity):
    """Rotation ratios by NumPy; NaN where the block overturns."""
    square = 1 + slenderness**2
    angle = np.arctan(1 / slenderness)
    sine = np.sin(angle / 2)
    p = np.sqrt(0.75 * 9.81 / (half_width * np.sqrt(square)))
    critical = p * (angle if linearized else 2 * sine)
    x = 0.75 * slenderness * intensity / (half_width * square) / (1 - restitution) / critical
    root = np.sqrt(np.maximum((1 - x) * (1 + x), 0))
    ratio = x**2 / (1 + root) if linearized else 1 - 2 * np.arcsin(sine * root) / angle
    return np.where(x < 1, ratio, np.nan)


def take_differences(function, arguments):
    """Values, and slopes by central differences."""
    slopes = []
    for position, argument in enumerate(arguments):
        step = 1e-6 * argument
        up, down = list(arguments), list(arguments)
        up[position] = argument + step
        down[position] = argument - step
        slopes.append((function(*up) - function(*down)) / (2 * step))
    return function(*arguments), slopes


def compare(model, grid):
    """Print times and ratios of a model."""
    on_device = [jnp.asarray(axis) for axis in grid]

    def by_hand(*arguments):
        return compute_by_hand(model.name == "linearized", *arguments)

    def ratio(slenderness, half_width, restitution, intensity):
        scene = jr.Scene(jr.Block(half_width, slenderness), restitution, intensity)
        return jr.rotation_ratio(scene, model)

    sloped = jr.value_and_slopes(ratio, (0, 1, 2, 3))
    values = jax.jit(ratio)
    np.testing.assert_allclose(values(*on_device), by_hand(*grid), rtol=1e-9)
    times = time_in_turn(
        {
            "NumPy": lambda: by_hand(*grid),
            "central": lambda: take_differences(by_hand, grid),
            "jaxrock": lambda: values(*on_device),
            "slopes": lambda: sloped(*on_device),
        },
        repeats=5,
    )
    print(model.name)
    for name, seconds in times.items():
        print(f"  {name:34} {1e3 * seconds:7.1f} ms")
    for name, other in (("NumPy", "jaxrock"), ("slopes", "jaxrock"), ("central", "slopes")):
        print(f"  {f'{name} over {other}':34} {times[name] / times[other]:7.2f}")


if __name__ == "__main__":
    grid = [axis.ravel() for axis in np.meshgrid(*AXES, indexing="ij")]
    grid.append(np.full_like(grid[0], INTENSITY))
    for model in (jr.Linearized(), jr.Nonlinear()):
        compare(model, grid)
