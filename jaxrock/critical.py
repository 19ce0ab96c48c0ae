"""Inverse design in closed form: what puts a block under the paper's pulses on the verge."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from .arguments import COUNT, UNIT_INTERVAL, Number, Reals, elementwise
from .block import Block
from .elementary import quotient_or_infinite, share_of_one
from .free import FreeRocking, Linearized
from .resonance import Scene


@elementwise(restitution=UNIT_INTERVAL, half_cycles=COUNT)
def critical_intensity(
    block: Block,
    restitution: Number,
    half_cycles: Number = jnp.inf,
    model: FreeRocking = Linearized(),
) -> Reals:
    """Intensity of the pulses that just overturn the block within so many half-cycles.

    Solves ``half_cycle_velocity = critical_velocity`` (Eqs. 2 and 8) for the intensity.

    Parameters
    ----------
    block : Block
    restitution : array_like
        C [-], between 0 and 1.
    half_cycles : array_like, optional
        n, a whole number from 1 on (1 is the single pulse), or inf.
    model : Linearized or Nonlinear
        Linearized, I is 0.16 % too large at slenderness 5: the unsafe side.

    Returns
    -------
    intensity : Array, shape (...)
        I [m/s]; 0 for C = 1 without limit on the half-cycles.

    Raises
    ------
    ValueError
        If a concrete `restitution` or `half_cycles` is out of range; traced, it gives NaN.

    Examples
    --------
    >>> import jaxrock as jr
    >>> block = jr.Block(half_width=0.4, slenderness=5.0)
    >>> print(f"{jr.critical_intensity(block, 0.7, half_cycles=5.0):.3f} m/s")
    0.375 m/s
    """
    return _single(block, model) * share_of_one(restitution, half_cycles)


@elementwise(half_cycles=COUNT)
def critical_width(
    scene: Scene, half_cycles: Number = jnp.inf, model: FreeRocking = Linearized()
) -> Reals:
    """Width of the block of this slenderness that the pulses just overturn.

    Critical intensities grow with the square root of the size.

    Parameters
    ----------
    scene : Scene
        Its half-width does not matter.
    half_cycles : array_like, optional
        n, a whole number from 1 on (1 is the single pulse), or inf.
    model : Linearized or Nonlinear
        Linearized, 2b is 0.32 % too small at slenderness 5: the unsafe side.

    Returns
    -------
    width : Array, shape (...)
        2b [m]: wider blocks stand, narrower ones overturn. 0 without pulses; inf for C = 1
        without limit on the half-cycles.

    Raises
    ------
    ValueError
        If a concrete `half_cycles` is out of range; traced, it gives NaN.
    """
    block = eqx.tree_at(lambda b: b.half_width, scene.block, jnp.ones_like(scene.block.half_width))
    return 2 * (_together(scene, half_cycles) / _single(block, model)) ** 2


@elementwise(half_cycles=COUNT)
def critical_slenderness(
    scene: Scene, half_cycles: Number = jnp.inf, model: FreeRocking = Linearized()
) -> Reals:
    """Slenderness of the block of this width that the pulses just overturn.

    Parameters
    ----------
    scene : Scene
        Its slenderness does not matter.
    half_cycles : array_like, optional
        As in `critical_width`.
    model : Linearized or Nonlinear
        Linearized, lambda is too large: the unsafe side.

    Returns
    -------
    slenderness : Array, shape (...)
        lambda [-]: stockier blocks stand, more slender ones overturn. inf without pulses; 0
        for C = 1 without limit on the half-cycles.

    Raises
    ------
    ValueError
        If a concrete `half_cycles` is out of range; traced, it gives NaN.
    """
    together = _together(scene, half_cycles)
    some = (together > 0) & (together < jnp.inf)

    def excess(logarithm: Reals, given: Any) -> Reals:
        half_width, gravity, intensity = given
        return jnp.log(_single(Block(half_width, jnp.exp(logarithm), gravity), model) / intensity)

    # From what it tends to for slender blocks.
    half_width, gravity = scene.block.half_width, scene.block.gravity
    together_or_one = jnp.where(some, together, 1)
    slender = jnp.log(gravity * half_width / 0.75) - 2 * jnp.log(together_or_one)
    logarithm = _root(excess, slender, None, half_width, gravity, together_or_one)
    return jnp.where(some, jnp.exp(logarithm), jnp.where(together > 0, 0, jnp.inf))


@elementwise(half_cycles=COUNT)
def critical_restitution(
    scene: Scene, half_cycles: Number = jnp.inf, model: FreeRocking = Linearized()
) -> Reals:
    """Restitution with which the pulses just overturn the block.

    Parameters
    ----------
    scene : Scene
        Its restitution does not matter.
    half_cycles : array_like, optional
        As in `critical_width`.
    model : Linearized or Nonlinear
        Linearized, C is too large: the unsafe side.

    Returns
    -------
    restitution : Array, shape (...)
        C [-]: the block stands with less, overturns with more. NaN where there is none: if
        the first pulse overturns the block, and if it stands even with C = 1.

    Raises
    ------
    ValueError
        If a concrete `half_cycles` is out of range; traced, it gives NaN.
    """
    share = scene.intensity / _single(scene.block, model)
    half_cycles = jnp.asarray(half_cycles, share.dtype)
    exists = (share < 1) & (half_cycles * share > 1)
    several = exists & (half_cycles < jnp.inf)

    def excess(restitution: Reals, given: Any) -> Reals:
        count, share = given
        return share_of_one(restitution, count) - share

    restitution = _root(
        excess,
        jnp.full_like(share, 0.5),
        (0.0, 1.0),
        jnp.where(several, half_cycles, 2),
        jnp.where(several, share, 0.75),
    )
    return jnp.where(exists, jnp.where(several, restitution, 1 - share), jnp.nan)


def _single(block: Block, model: FreeRocking) -> Reals:
    """The one pulse that just overturns."""
    return model._critical_velocity(block) / block.pulse_velocity(1.0)


def _together(scene: Scene, half_cycles: Number) -> Reals:
    """The one pulse that does as much as so many, each after an impact."""
    return quotient_or_infinite(scene.intensity, share_of_one(scene.restitution, half_cycles))


def _root(
    function: Callable[[Reals, Any], Reals],
    start: Reals,
    between: tuple[float, float] | None,
    *given: Reals,
) -> Reals:
    """Root of a falling function, elementwise, with the derivatives of an implicit function.

    By Newton's method, after bisection `between` two numbers where these are given.
    """
    import optimistix

    dtype = jnp.result_type(*given)
    eps = float(jnp.finfo(dtype).eps)

    def one(guess: Reals, *given: Reals) -> Reals:
        if between is not None:
            guess = optimistix.root_find(
                function,
                optimistix.Bisection(rtol=0.0, atol=eps, flip=True),
                guess,
                jax.lax.stop_gradient(given),
                options=dict(zip(("lower", "upper"), between, strict=True)),
                throw=False,
            ).value
        return optimistix.root_find(
            function, optimistix.Newton(rtol=4 * eps, atol=4 * eps), guess, given, throw=False
        ).value

    return jnp.vectorize(one)(jax.lax.stop_gradient(start), *given)
