"""Steady rocking of the nonlinear block on a harmonic floor, by collocation.

The unknowns are the angular acceleration at nodes in the half period, from which the rotation
follows by integrating a polynomial twice, and beta sin(phase) and beta cos(phase). They follow
from the equation of motion at the nodes, the impact law and the given beta. This boundary
value problem is well conditioned however unstable the motion is. Between two impacts the
motion is smooth, so that the polynomial converges to rounding.

Newton's method starts at the linearized motion under a floor that is strong enough, and goes
down to the given floor. On the way beta^2 is a nearly parabolic function of the landing
velocity, so that the method converges without overshooting if the upper branch reaches the
given floor.
"""

import dataclasses
import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from numpy.polynomial import chebyshev

from ..validation import Booleans, Integers, Reals
from .harmonic_linearized import HarmonicScene, SteadyMotion, least_amplitude, solve_linearized

# Number of nodes; the polynomial resolves motions on floors faster than about 0.3 p.
_NODES = 36
# Largest number of Newton's steps.
_ITERATIONS = 60
# The search starts at this multiple of the least amplitude, plus this amplitude over g
# alpha_c. The start is well above the fold, where the linearized motion is close to the
# nonlinear one.
_START_TIMES = 1.5
_START_BEYOND = 0.2


class _Collocation(NamedTuple):
    """Linear maps of a polynomial given by its values at the nodes, on the interval -1 to 1.

    Its double integral is 0 at both ends, like the rotation at impacts.
    """

    elapsed: np.ndarray  # time since launch at the nodes, in half intervals
    sine: np.ndarray  # of the phase since launch, at the nodes
    cosine: np.ndarray
    series: np.ndarray  # Chebyshev coefficients of double integral, integral and polynomial
    between: np.ndarray  # the double integral at the nodes
    first_slope: np.ndarray  # slope of the double integral at the first end
    last_slope: np.ndarray  # the same at the last end


@functools.cache
def _make_collocation(dtype: np.dtype) -> _Collocation:
    """Make the linear maps, computed in double precision."""
    # Chebyshev nodes, which cluster at the ends: interpolation there converges geometrically.
    nodes = -np.cos(np.pi * (np.arange(_NODES) + 0.5) / _NODES)
    # A column for each order of the polynomial, a row for each order of its double integral.
    orders = np.eye(_NODES + 2)[:, :_NODES]
    twice, once = (chebyshev.chebint(orders, m, lbnd=-1)[: _NODES + 2] for m in (2, 1))
    # Subtract the line from 0 to the value at the last end: half of this value times 1 + x.
    half_end = 0.5 * twice.sum(axis=0)
    twice[:2] -= half_end
    once[0] -= half_end
    interpolation = np.linalg.inv(chebyshev.chebvander(nodes, _NODES - 1))
    series = np.stack([twice, once, orders]) @ interpolation
    between = chebyshev.chebvander(nodes, _NODES + 1) @ series[0]
    end_slopes = chebyshev.chebvander(np.array([-1.0, 1.0]), _NODES + 1) @ series[1]
    phase = 0.5 * np.pi * (1 + nodes)
    maps = (1 + nodes, np.sin(phase), np.cos(phase), series, between, *end_slopes)
    return _Collocation(*(part.astype(dtype) for part in maps))


# In full precision, which is not the default of accelerators.
_multiply_precisely = functools.partial(jnp.matmul, precision=jax.lax.Precision.HIGHEST)


def _compute_node_accelerations(scene: HarmonicScene, unknowns: Reals) -> tuple[Reals, ...]:
    """Compute the acceleration at the nodes, and its derivatives over rotation and push."""
    maps = _make_collocation(unknowns.dtype)
    rotation = (0.5 * scene.half_period) ** 2 * _multiply_precisely(
        maps.between, unknowns[:-2]
    )
    push = unknowns[-2] * maps.cosine + unknowns[-1] * maps.sine
    # The function is elementwise, so that each derivative is a diagonal.
    value, pull = jax.vjp(scene.acceleration, rotation, push)
    return value, *pull(jnp.ones_like(value))


def _compute_residuals(scene: HarmonicScene, unknowns: Reals) -> tuple[Reals, Reals]:
    """Compute the residuals of a steady motion, and their Jacobian matrix.

    The residuals are those of the equation of motion at the nodes, of the impact law, which
    joins the velocities at both ends, and of beta^2.
    """
    maps = _make_collocation(unknowns.dtype)
    half = 0.5 * scene.half_period
    needed, stiffness, leverage = _compute_node_accelerations(scene, unknowns)
    impact_row = half * (maps.first_slope + scene.restitution * maps.last_slope)
    law = _multiply_precisely(impact_row, unknowns[:-2])
    strength = (unknowns[-2:] ** 2).sum() - scene.amplitude**2
    push_map = jnp.stack([maps.cosine, maps.sine], axis=1)
    identity = jnp.eye(needed.size, dtype=needed.dtype)
    jacobian = [
        [
            identity - stiffness[:, None] * half**2 * maps.between,
            -leverage[:, None] * push_map,
        ],
        [impact_row[None], jnp.zeros_like(unknowns[None, -2:])],
        [jnp.zeros_like(needed[None]), 2 * unknowns[None, -2:]],
    ]
    return jnp.hstack([unknowns[:-2] - needed, law, strength]), jnp.block(jacobian)


class _Newton(NamedTuple):
    """The state of the search; see the table in `_search_unknowns`."""

    unknowns: Reals
    amplitude: Reals  # beta for which the equations are being solved
    solved: Booleans
    goes_on: Booleans
    steps: Integers


def _search_unknowns(scene: HarmonicScene) -> tuple[Reals, Booleans]:
    """Find the unknowns by Newton's method, and whether they exist; 1 if not."""
    # State of the search   | What is known                     | What happens next
    # ----------------------|-----------------------------------|------------------------------
    # stronger floor        | the linearized motion under it    | Newton's steps for that floor
    # arrived there         | a point on the upper branch       | Newton's steps for the given
    #                       |                                   |   floor, all the way down
    # arrived at the given  | the unknowns                      | found: the end
    #   floor               |                                   |
    # past the fold, or NaN | the upper branch does not go as   | not found: the end
    #                       |   far down                        |
    dtype = scene.amplitude.dtype
    maps = _make_collocation(dtype)
    first = _START_TIMES * least_amplitude(scene.restitution, scene.frequency) + _START_BEYOND
    # A stocky block needs more, in proportion to its uplift acceleration.
    first = first * scene.equation.tangent / scene.equation.critical_angle
    first = jnp.maximum(scene.amplitude, first)
    begin = solve_linearized(dataclasses.replace(scene, amplitude=first))
    fractions = jnp.asarray(0.5 * maps.elapsed)
    unknowns = jnp.append(begin.path(fractions)[2], jnp.stack([begin.sine, begin.cosine]))
    # Newton's method squares the error: after a step of this size the error is rounding.
    tolerance = 0.1 * float(jnp.finfo(dtype).eps) ** 0.5
    # Right-hand side for the derivative of the unknowns with respect to beta^2.
    last = jnp.zeros_like(unknowns).at[-1].set(1)

    def take_step(state: _Newton) -> _Newton:
        floor = dataclasses.replace(scene, amplitude=state.amplitude)
        residual, jacobian = _compute_residuals(floor, state.unknowns)
        change, slope = jnp.linalg.solve(jacobian, jnp.stack([residual, last], axis=1)).T
        unknowns = state.unknowns - change
        # On the upper branch a stronger floor means a faster landing. If it does not, the step
        # has passed the fold and would go on to the other branch.
        rising = _multiply_precisely(maps.last_slope, slope[:-2]) < 0
        sound = rising & jnp.isfinite(unknowns).all()
        # Accelerations and beta are tested separately: beta may be small.
        small = [
            jnp.abs(change[part]).max() <= tolerance * jnp.abs(unknowns[part]).max()
            for part in (slice(-2), slice(-2, None))
        ]
        arrived = sound & small[0] & small[1]
        # A floor at rest has no phase, which the equations would need.
        solved = arrived & (scene.amplitude > 0) & (state.amplitude == scene.amplitude)
        steps = state.steps + 1
        return _Newton(
            unknowns=unknowns,
            amplitude=jnp.where(arrived, scene.amplitude, state.amplitude),
            solved=solved,
            goes_on=sound & ~solved & (steps < _ITERATIONS),
            steps=steps,
        )

    no = jnp.zeros((), bool)
    start = _Newton(unknowns, first, no, jnp.isfinite(unknowns).all(), jnp.zeros((), int))
    final = jax.lax.while_loop(lambda state: state.goes_on, take_step, start)
    return jnp.where(final.solved, final.unknowns, 1), final.solved


# Derivatives come from the implicit function theorem: none passes through the search.
_solve_equations = eqx.filter_custom_jvp(_search_unknowns)


@_solve_equations.def_jvp
def _(
    primals: tuple[HarmonicScene], tangents: tuple[HarmonicScene]
) -> tuple[tuple[Reals, Booleans], tuple[Reals, None]]:
    """Differentiate the unknowns by the implicit function theorem."""
    (scene,) = primals
    unknowns, solved = _solve_equations(scene)
    change = eqx.filter_jvp(lambda s: _compute_residuals(s, unknowns)[0], primals, tangents)[1]
    jacobian = _compute_residuals(scene, unknowns)[1]
    # Unknowns that were not found are constants: a singular Jacobian would make them NaN.
    jacobian = jnp.where(solved, jacobian, jnp.eye(unknowns.size, dtype=unknowns.dtype))
    move = jnp.linalg.solve(jacobian, jnp.where(solved, -change, 0))
    return (unknowns, solved), (move, None)


def solve_nonlinear(scene: HarmonicScene) -> SteadyMotion:
    """Solve for the steady motion on the branch that begins as the linearized one."""
    unknowns, solved = _solve_equations(scene)
    maps = _make_collocation(unknowns.dtype)
    half = 0.5 * scene.half_period
    acceleration = unknowns[:-2]
    landing = -half * _multiply_precisely(maps.last_slope, acceleration)
    units = jnp.stack([half**2, half, jnp.ones_like(half)])
    series = units[:, None] * _multiply_precisely(maps.series, acceleration)
    # Where the last coefficients have not become small, more nodes would be needed.
    coefficients = jnp.abs(series[2, :_NODES])
    size = coefficients.max()
    resolved = coefficients[-2:].max() <= 0.1 * float(jnp.finfo(size.dtype).eps) ** 0.5 * size
    exists = solved & resolved & (landing > 0)

    def path(fraction: Reals) -> tuple[Reals, ...]:
        # T_n(x) = cos(n arccos(x)).
        angle = jnp.arccos(2 * fraction - 1)
        orders = jnp.arange(_NODES + 2, dtype=angle.dtype)
        polynomials = jnp.cos(jnp.multiply.outer(angle, orders))
        return tuple(_multiply_precisely(polynomials, part) for part in series)

    trace = _compute_trace(scene, unknowns, jnp.where(exists, landing, 1))
    return SteadyMotion(landing, unknowns[-2], unknowns[-1], trace, exists, path)


def _compute_trace(scene: HarmonicScene, unknowns: Reals, landing: Reals) -> Reals:
    """Compute the trace of the derivative of the map from one launch to the next.

    The map takes time and velocity of a launch. A later launch, and a faster one, change
    rotation and velocity at the time of the next impact by solutions of the linear equation
    along the motion. They are found by collocation too: `begun` is the solution without
    stiffness, `bent` the acceleration that the stiffness adds. Integrals of `bent` begin with
    value and slope 0.
    """
    maps = _make_collocation(unknowns.dtype)
    half = 0.5 * scene.half_period
    c = scene.restitution
    stiffness = _compute_node_accelerations(scene, unknowns)[1][:, None]
    ones = jnp.ones_like(unknowns[:-2])
    # Solutions of unit rotation, and of unit velocity.
    begun = jnp.stack([ones, half * maps.elapsed], axis=1)
    onward = maps.between - np.outer(maps.elapsed, maps.first_slope)
    matrix = jnp.eye(ones.size, dtype=ones.dtype) - stiffness * (half**2 * onward)
    bent = jnp.linalg.solve(matrix, stiffness * begun)
    first, last = _multiply_precisely(jnp.stack([maps.first_slope, maps.last_slope]), bent)
    zero = jnp.zeros_like(half)
    end = jnp.stack([zero + 1, 2 * half]) - 2 * half**2 * first
    rate = jnp.stack([zero, zero + 1]) + half * (last - first)
    sine = unknowns[-2]
    leaving, arriving = (scene.acceleration(zero, push) for push in (sine, -sine))
    return -c * (end[0] + rate[1]) - end[1] * (leaving + c * arriving) / landing
