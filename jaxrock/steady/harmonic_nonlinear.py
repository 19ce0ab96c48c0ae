"""Steady rocking of the nonlinear block on a harmonic floor, by collocation.

The unknowns are the angular acceleration at nodes in the half period, from which the rotation
follows by integrating a polynomial twice, and beta sin(phase) and beta cos(phase). The
equation of motion at the nodes, the impact law and the given beta decide on them. As a
boundary value problem this is well conditioned however unstable the motion is, and without
impacts in between it is smooth: the polynomial converges to rounding.

Newton's method starts at the linearized motion under a floor that is strong enough, and from
there goes down to the given one. There beta^2 is a nearly parabolic function of the landing
velocity, so that it arrives without overshooting wherever the upper branch goes as far down.
"""

import functools
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from numpy.polynomial import chebyshev

from ..validation import Booleans, Reals
from .harmonic_linearized import HarmonicScene, Steady, least_amplitude, linearized_steady

_NODES = 36
_ITERATIONS = 60
_ABOVE = 1.5, 0.2  # where the search starts: times the least amplitude, and over g alpha_c


class _Collocation(NamedTuple):
    """Linear maps from what a polynomial is at the nodes, on the interval from -1 to 1."""

    elapsed: Any  # since launch, in half intervals, at the nodes
    sine: Any  # of the phase since launch
    cosine: Any
    coefficients: Any  # of Chebyshev polynomials
    between: Any  # double integral that is 0 at both ends, at the nodes
    first_slope: Any  # of that, at the ends
    last_slope: Any
    onward: Any  # double integral from the first end, at the nodes
    onward_end: Any  # and at the other end
    integral: Any  # from the first end to the other
    path: Any  # coefficients of the double integral that is 0 at both ends
    velocity: Any  # and of its derivative


@functools.cache
def _maps() -> _Collocation:
    nodes = -np.cos(np.pi * (np.arange(_NODES) + 0.5) / _NODES)
    coefficients = np.linalg.inv(chebyshev.chebvander(nodes, _NODES - 1))
    unit = np.eye(_NODES)
    once = np.stack([chebyshev.chebint(row, lbnd=-1) for row in unit], axis=1)
    twice = np.stack([chebyshev.chebint(row, 2, lbnd=-1) for row in unit], axis=1)
    end = twice.sum(axis=0)
    integral = once.sum(axis=0)
    # Less the line to the end, half of it times 1 + x.
    path = twice.copy()
    velocity = once.copy()
    path[:2] -= 0.5 * end
    velocity[0] -= 0.5 * end

    def at(points: Any, series: np.ndarray) -> np.ndarray:
        return chebyshev.chebvander(points, len(series) - 1) @ series @ coefficients

    phase = 0.5 * np.pi * (1 + nodes)
    return _Collocation(
        elapsed=1 + nodes,
        sine=np.sin(phase),
        cosine=np.cos(phase),
        coefficients=coefficients,
        between=at(nodes, path),
        first_slope=at(-1.0, velocity)[0],
        last_slope=at(1.0, velocity)[0],
        onward=at(nodes, twice),
        onward_end=end @ coefficients,
        integral=integral @ coefficients,
        path=path @ coefficients,
        velocity=velocity @ coefficients,
    )


def _maps_in(dtype: Any) -> _Collocation:
    return jax.tree.map(lambda part: jnp.asarray(part, dtype), _maps())


def _times(matrix: Reals, values: Reals) -> Reals:
    """Multiply in full precision, on accelerators too."""
    return jnp.matmul(matrix, values, precision=jax.lax.Precision.HIGHEST)


class PolynomialPath(eqx.Module):
    """Rotation, velocity and acceleration over time, by their Chebyshev coefficients."""

    rotation: Reals
    velocity: Reals
    acceleration: Reals

    def at(self, share: Reals) -> tuple[Reals, Reals, Reals]:
        """All three at a share of the half period."""
        angle = jnp.arccos(2 * share - 1)
        orders = jnp.arange(_NODES + 2, dtype=angle.dtype)
        polynomials = jnp.cos(jnp.multiply.outer(angle, orders))
        series = self.rotation, self.velocity, self.acceleration
        rotation, velocity, acceleration = (
            _times(polynomials[..., : each.size], each) for each in series
        )
        return rotation, velocity, acceleration


def nonlinear_steady(scene: HarmonicScene) -> Steady:
    """Compute the steady motion on the branch that begins as the linearized one."""
    unknowns, found = _solution(scene)
    return _steady(scene, unknowns, found)


@eqx.filter_custom_jvp
def _solution(scene: HarmonicScene) -> tuple[Reals, Booleans]:
    """Find the unknowns, differentiated by the implicit function theorem; tell if found."""
    return _search(scene)


@_solution.def_jvp
def _(primals: Any, tangents: Any) -> Any:
    (scene,) = primals
    unknowns, found = _solution(scene)

    def residual(scene: HarmonicScene) -> Reals:
        return _equations(scene, scene.amplitude, unknowns)[0]

    change = eqx.filter_jvp(residual, primals, tangents)[1]
    jacobian = _equations(scene, scene.amplitude, unknowns)[1]
    # What does not exist does not move.
    identity = jnp.eye(unknowns.size, dtype=unknowns.dtype)
    move = jnp.linalg.solve(jnp.where(found, jacobian, identity), jnp.where(found, -change, 0))
    return (unknowns, found), (move, None)


def _equations(scene: HarmonicScene, amplitude: Reals, unknowns: Reals) -> tuple[Reals, Reals]:
    """Compute the residuals of a steady motion, and their Jacobian matrix."""
    maps = _maps_in(unknowns.dtype)
    half = 0.5 * scene.half_period
    acceleration = unknowns[:-2]
    sine, cosine = unknowns[-2:]
    to_rotation = half**2 * maps.between
    to_impact = half * (maps.first_slope + scene.restitution * maps.last_slope)
    needed, (by_rotation, by_push) = _acceleration(scene, unknowns)
    residual = [acceleration - needed, jnp.stack([
        _times(to_impact, acceleration), sine**2 + cosine**2 - amplitude**2,
    ])]  # fmt: skip
    identity = jnp.eye(needed.size, dtype=needed.dtype)
    beside = -by_push[:, None] * jnp.stack([maps.cosine, maps.sine], axis=1)
    nodes = jnp.concatenate([identity - by_rotation[:, None] * to_rotation, beside], axis=1)
    impact = jnp.concatenate([to_impact, jnp.zeros_like(unknowns[-2:])])
    strength = jnp.concatenate([jnp.zeros_like(needed), 2 * unknowns[-2:]])
    return jnp.concatenate(residual), jnp.concatenate([nodes, impact[None], strength[None]])


def _acceleration(scene: HarmonicScene, unknowns: Reals) -> tuple[Reals, Reals]:
    """Compute the acceleration at the nodes, and its derivatives by rotation and push."""
    maps = _maps_in(unknowns.dtype)
    half = 0.5 * scene.half_period
    rotation = half**2 * _times(maps.between, unknowns[:-2])
    push = unknowns[-2] * maps.cosine + unknowns[-1] * maps.sine
    one = jnp.ones_like(push)
    zero = jnp.zeros_like(push)
    # Elementwise, so that each derivative is a diagonal.
    return jax.vmap(
        lambda *direction: jax.jvp(scene.acceleration, (rotation, push), direction),
        out_axes=(None, 0),
    )(jnp.stack([one, zero]), jnp.stack([zero, one]))


class _Newton(NamedTuple):
    unknowns: Reals
    amplitude: Reals  # for which the equations are being solved
    found: Booleans
    goes_on: Booleans
    count: Any


def _search(scene: HarmonicScene) -> tuple[Reals, Booleans]:
    """Find the unknowns, arbitrary where there is no steady motion; tell if there is one."""
    maps = _maps_in(scene.amplitude.dtype)
    dtype = scene.amplitude.dtype
    times, beyond = _ABOVE
    first = times * least_amplitude(scene.restitution, scene.frequency) + beyond
    # A stocky block takes more, in proportion to what lifts it.
    first = first * scene.equation.tangent / scene.equation.critical_angle
    first = jnp.maximum(scene.amplitude, first)
    given = scene.amplitude > 0
    begin = linearized_steady(eqx.tree_at(lambda s: s.amplitude, scene, first))
    shares = jnp.asarray(0.5 - 0.5 * np.cos(np.pi * (np.arange(_NODES) + 0.5) / _NODES), dtype)
    unknowns = jnp.append(begin.path.at(shares)[2], jnp.stack([begin.sine, begin.cosine]))
    tolerance = 0.1 * float(jnp.finfo(dtype).eps) ** 0.5
    last = jnp.zeros_like(unknowns).at[-1].set(1)

    def step(state: _Newton) -> _Newton:
        residual, jacobian = _equations(scene, state.amplitude, state.unknowns)
        change, slope = jnp.linalg.solve(jacobian, jnp.stack([residual, last], axis=1)).T
        unknowns = state.unknowns - change
        # On the upper branch a stronger floor means a faster landing.
        rising = _times(maps.last_slope, slope[:-2]) < 0
        sound = rising & jnp.isfinite(unknowns).all()
        # Each compared with its like: beta may be small.
        small = [
            jnp.abs(change[part]).max() <= tolerance * jnp.abs(unknowns[part]).max()
            for part in (slice(-2), slice(-2, None))
        ]
        arrived = sound & small[0] & small[1]
        found = arrived & given & (state.amplitude == scene.amplitude)
        count = state.count + 1
        return _Newton(
            unknowns=unknowns,
            amplitude=jnp.where(arrived, scene.amplitude, state.amplitude),
            found=found,
            goes_on=sound & ~found & (count < _ITERATIONS),
            count=count,
        )

    no = jnp.zeros((), bool)
    start = _Newton(unknowns, first, no, jnp.isfinite(unknowns).all(), jnp.zeros((), int))
    end = jax.lax.while_loop(lambda state: state.goes_on, step, start)
    return jnp.where(end.found, end.unknowns, 1), end.found


def _steady(scene: HarmonicScene, unknowns: Reals, found: Booleans) -> Steady:
    """Compute the steady motion that belongs to the unknowns."""
    maps = _maps_in(unknowns.dtype)
    half = 0.5 * scene.half_period
    acceleration = unknowns[:-2]
    sine, cosine = unknowns[-2:]
    coefficients = _times(maps.coefficients, acceleration)
    landing = -half * _times(maps.last_slope, acceleration)
    size = jnp.abs(coefficients).max()
    rest = jnp.abs(coefficients[-2:]).max()
    resolved = rest <= 0.1 * float(jnp.finfo(size.dtype).eps) ** 0.5 * size
    exists = found & resolved & (landing > 0)
    path = PolynomialPath(
        rotation=half**2 * _times(maps.path, acceleration),
        velocity=half * _times(maps.velocity, acceleration),
        acceleration=coefficients,
    )
    trace = _trace(scene, unknowns, jnp.where(exists, landing, 1))
    return Steady(landing, sine, cosine, trace, exists, path)


def _trace(scene: HarmonicScene, unknowns: Reals, landing: Reals) -> Reals:
    """Of the derivative of the map from launch to launch, in time and velocity.

    A later launch, and a faster one, change rotation and velocity at the time of the next
    impact by solutions of the linear equation along the motion.
    """
    maps = _maps_in(unknowns.dtype)
    half = 0.5 * scene.half_period
    c = scene.restitution
    _, along = _acceleration(scene, unknowns)
    stiffness = along[0][:, None]
    one = jnp.ones_like(along[0])
    begun = jnp.stack([one, half * maps.elapsed], axis=1)  # of unit rotation, of unit velocity
    matrix = jnp.eye(one.size, dtype=one.dtype) - stiffness * (half**2 * maps.onward)
    bent = jnp.linalg.solve(matrix, stiffness * begun)
    zero = jnp.zeros_like(half)
    end = jnp.stack([zero + 1, 2 * half]) + half**2 * _times(maps.onward_end, bent)
    rate = jnp.stack([zero, zero + 1]) + half * _times(maps.integral, bent)
    sine = unknowns[-2]
    leaving, arriving = (scene.acceleration(zero, push) for push in (sine, -sine))
    return -c * (end[0] + rate[1]) - end[1] * (leaving + c * arriving) / landing
