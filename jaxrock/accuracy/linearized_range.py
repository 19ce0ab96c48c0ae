"""Test of scenes for which the linearized equation is enough."""

import equinox as eqx
import jax
import jax.numpy as jnp

from ..resonance import Linearized, Nonlinear, Scene, stabilized_velocity
from ..validation import Booleans, Integers, Number, Reals
from .model_errors import compare


@jax.jit
def is_linearized_enough(scene: Scene, tolerance: Number) -> Booleans:
    """Tell where the block stands and linearizing costs no answer more than the tolerance.

    Cheaper than either closed form: the cost grows with the velocity, so that it is within the
    tolerance up to one velocity, which in units of the critical one depends on the slenderness
    alone.
    """
    # In units of the critical velocity the size and gravity drop out.
    ones = jnp.ones_like(scene.block.slenderness)
    block = eqx.tree_at(lambda b: (b.half_width, b.gravity), scene.block, (ones, ones))
    linearized = Linearized()
    nonlinear = Nonlinear()
    critical = nonlinear.critical_velocity(block)
    over = critical / linearized.critical_velocity(block)
    single = critical / block.pulse_velocity(1.0)
    # Less the rounding of the costs themselves, so that a tolerance that is kept is kept for
    # sure.
    allowed = jnp.asarray(tolerance, over.dtype) - 16 * float(jnp.finfo(over.dtype).eps)

    def is_enough(x: Reals) -> Booleans:
        """Return whether it is enough at a velocity in units of the critical one."""
        sides = ((linearized, x * over), (nonlinear, x))
        ratios = (model._rotation_ratio(block, v) for model, v in sides)
        durations = (model._half_cycle_duration(block, v, x * single) for model, v in sides)
        costs = jnp.maximum(jnp.abs(compare(*ratios)), jnp.abs(compare(*durations)))
        return jnp.maximum(costs, jnp.abs(1 / over - 1)) <= allowed

    def bisect(_: Integers, interval: tuple[Reals, Reals]) -> tuple[Reals, Reals]:
        """Halve an interval: enough at its lower end, too much at its upper one."""
        low, high = interval
        middle = 0.5 * (low + high)
        within = is_enough(middle)
        return jnp.where(within, middle, low), jnp.where(within, high, middle)

    # Forty halvings leave 1e-12. A block that hardly rocks must pass as well, or none does.
    ones = jnp.ones_like(over)
    fastest, _ = jax.lax.fori_loop(0, 40, bisect, (0 * ones, ones))
    fastest = jnp.where(is_enough(1e-3 * ones), fastest, -1.0)
    return stabilized_velocity(scene) <= fastest * nonlinear.critical_velocity(scene.block)
