"""What simplifying a scene costs, predicted from closed forms.

The truth is the nonlinear equation under pulses of finite duration. Three things are cheaper:
linearizing, taking pulses as instantaneous, and single precision.
"""

from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np

from ..ground_motion import HalfSine, Pulse, Rectangular
from ..host import Printed, shown
from ..resonance import (
    Linearized,
    Nonlinear,
    RockingModel,
    Scene,
    critical_intensity,
    rotation_ratio,
    stabilized_period,
    stabilized_velocity,
)
from ..validation import (
    NON_NEGATIVE,
    Booleans,
    Number,
    Reals,
    as_real,
    check_kind,
    check_shapes,
    describe,
    elementwise,
    is_traced,
    of_one_precision,
)

# The estimate of what a duration costs is known up to this ratio of the acceleration that just
# lifts the block to the mean one of the pulse, and from this slenderness on.
_MAX_UPLIFT_RATIO = 0.8
_MIN_SLENDERNESS = 0.5
# Bounds on its remainder; the largest values found by a search are 0.239, 0.267 and 0.159.
_VELOCITY = 0.3
_TIME = 0.35
_CRITICAL = 0.2
# Of pulses of duration and intensity 1: the centroid, the integral of the pulse times its
# second integral, and a slack for those that start weakly. Under a half-sine a block launched
# with less than 3 e^2 (1 - C) / (4 pi^2) of the velocity comes back at once; that velocity may
# be half of what is estimated.
_PULSES = {None: (0.0, 0.0, 0.0), Rectangular: (0.5, 1 / 6, 0.0), HalfSine: (0.5, 0.125, 0.2)}
# Rounding of the closed forms, as a change of the intensity in units of the last place.
_ROUNDINGS = 3.5


class Answers(Printed, eqx.Module):
    """The three answers about which errors are stated.

    Attributes
    ----------
    rotation_ratio, period, critical_intensity : Array, shape (...)
        [-], [s] and [m/s]; their errors relative [-].
    """

    rotation_ratio: Reals
    period: Reals
    critical_intensity: Reals

    def __str__(self) -> str:
        return ", ".join(
            f"{name.replace('_', ' ')} {shown(v)}" for name, v in vars(self).items()
        )


class ModelError(Printed, eqx.Module):
    """What simplifying a scene costs, relative; see `model_error`.

    Attributes
    ----------
    linearization : Answers
        `Linearized` over `Nonlinear`, less 1: exact up to rounding.
    duration : Answers
        Instantaneous pulses over pulses of finite duration, less 1: to first order in it.
    duration_bound : Answers
        Bound on the error of `duration`, with rounding; inf where nothing is known.
    rounding : dict
        For the models "linearized" and "nonlinear" and 32 and 64 bits: bound on what rounding
        costs, of the arguments (if they are given in a higher precision) and on the way. Of
        a scene given in float32, whose arguments need no rounding, also for 64 bits.
    """

    linearization: Answers
    duration: Answers
    duration_bound: Answers
    rounding: dict[str, dict[int, Answers]]

    def __str__(self) -> str:
        rows = {
            "linearizing": self.linearization,
            "instantaneous pulses": self.duration,
            "  known to": self.duration_bound,
        } | {
            f"{model} in float{bits}": errors
            for model, by_bits in self.rounding.items()
            for bits, errors in by_bits.items()
        }
        return "\n".join(f"{name:24}{errors}" for name, errors in rows.items())

    def total(self, model: str, bits: int) -> Answers:
        """Bound on the error of a model in a precision; inf where nothing is known.

        It includes the rounding of `linearization` itself, so that it is no better than the
        precision the scene was given in.

        Parameters
        ----------
        model, bits : str, int
            "linearized" or "nonlinear", under instantaneous pulses; 32 or 64.

        Returns
        -------
        Answers
        """
        own_bits = int(jnp.finfo(self.linearization.period.dtype).bits)
        roundings = [self.rounding[model][bits]]
        share = self.linearization
        if model == "linearized":
            roundings += [by_bits[own_bits] for by_bits in self.rounding.values()]
        else:
            share = jax.tree.map(jnp.zeros_like, share)

        def added(simpler: Reals, duration: Reals, bound: Reals, *roundings: Reals) -> Reals:
            known = jnp.isfinite(simpler + duration)
            total = jnp.abs(simpler + duration + simpler * duration) + bound * (1 + simpler)
            for rounding in roundings:  # each of what the others have left
                total = total + rounding * (1 + total)
            return jnp.where(known, total, jnp.inf)

        return jax.tree.map(added, share, self.duration, self.duration_bound, *roundings)


def model_error(
    scene: Scene, shape: type[Pulse] | None = None, duration: Number = 0.0
) -> ModelError:
    """Bound what simplifications cost a scene, before anything expensive is computed.

    Parameters
    ----------
    scene : Scene
    shape : type, optional
        `Rectangular` or `HalfSine`, the pulses that have an intensity; instantaneous unless
        given.
    duration : array_like, optional
        Of the pulses [s], at least 0.

    Returns
    -------
    ModelError
        Of the stabilized rotation ratio and period and of the critical intensity. Where a
        simplification lets a block stand that overturns, or the other way round, its cost
        is inf; where it overturns for sure with and without, 0.

    Raises
    ------
    ValueError
        If `shape` has no intensity, or a concrete argument is out of range.

    Notes
    -----
    To first order in the duration d of the pulses, the velocity at which the block settles
    is ``1 + e (w v* I / g - (1 - C) m)`` times that under instantaneous ones, with ``e = d g
    tan(alpha_c) / I`` (what just lifts the block over the mean acceleration of the pulse), m
    the centroid of the pulse in durations and ``w = C m + (1 - C) n``, n the integral of the
    pulse times the second integral of itself. The remainder, bounded by
    ``0.3 e^2 (1 - C + v* I / g)``, is from a search for the largest one by comparisons with
    the equation of motion, for slenderness from 0.5 and e up to 0.8: 0.24 instead of 0.3.
    Beyond, and where a half-sine starts too weakly to hold a slow block up, the bound is inf.

    Examples
    --------
    >>> import jaxrock as jr
    >>> wall = jr.Scene(jr.Block(half_width=0.4, slenderness=5.0), 0.7, 0.15)
    >>> error = jr.model_error(wall)
    >>> print(f"{100 * error.linearization.rotation_ratio:.2f} %")
    -0.61 %
    """
    check_kind("scene", scene, Scene)
    if shape not in tuple(_PULSES):
        raise ValueError(f"shape must be Rectangular or HalfSine, got {describe(shape)}")
    duration = as_real("duration", duration)
    check_shapes(scene=scene, duration=duration)
    if shape is None and not is_traced(duration) and np.any(duration != 0):
        raise ValueError("shape must be given with a duration: Rectangular or HalfSine")
    # Broadcast here, so that what is compiled depends on the shape of the result alone.
    leaves, structure = jax.tree.flatten(of_one_precision((scene, duration)))
    scene, duration = jax.tree.unflatten(structure, jnp.broadcast_arrays(*leaves))
    return _model_error(scene, duration, *_PULSES[shape])


@elementwise(duration=NON_NEGATIVE)
def _model_error(
    scene: Scene, duration: Number, centroid: Number, work: Number, slack: Number
) -> ModelError:
    pulse = (jnp.asarray(duration), centroid, work, slack)
    shift, unit, known = _shift(scene, stabilized_velocity(scene), *pulse)
    own = jnp.finfo(pulse[0].dtype)
    precisions = {32: jnp.finfo(jnp.float32), int(own.bits): own}
    slip = _VELOCITY * unit + _ROUNDINGS * float(own.eps)
    # As it is; then with the effect of pulses of finite duration, and rounded, each of these
    # also with less and more. All at once, since each closed form takes long to compile.
    variants = [scene, *_around(scene, 1 + shift, slip)]
    for kind in precisions.values():
        variants += _around(_rounded(scene, kind), 1.0, _ROUNDINGS * float(kind.eps))
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *variants)
    answers = {
        model.name: jnp.stack(jax.tree.leaves(answers_of(stacked, model)), axis=1)
        for model in (Linearized(), Nonlinear())
    }
    roundings: dict[str, dict[int, Reals]] = {}
    for name, (exact, _, _, _, *rest) in answers.items():
        bounds = roundings[name] = {}
        for bits, kind in precisions.items():
            rounded, less, more, *rest = rest
            moved = (jnp.abs(_relative(each, rounded)) for each in (less, more))
            off = jnp.abs(_relative(rounded, exact)) + jnp.maximum(*moved)
            bounds[bits] = off + _ROUNDINGS * float(kind.eps)
        if 64 not in bounds:  # which grow at least as fast as the unit of the last place
            bounds[64] = float(jnp.finfo(jnp.float64).eps) / float(own.eps) * bounds[32]
    linearization = _relative(answers["linearized"][0], answers["nonlinear"][0])
    own_rounding = roundings["nonlinear"][int(own.bits)]
    costs = _duration_costs(scene, pulse, answers["nonlinear"][:4], unit, known, own_rounding)
    linearizing, estimate, bound = (Answers(*cost) for cost in (linearization, *costs))
    by_model = {
        name: {bits: Answers(*bound) for bits, bound in bounds.items()}
        for name, bounds in roundings.items()
    }
    return ModelError(linearizing, estimate, bound, by_model)


def _around(scene: Scene, factor: Any, slip: Any) -> list[Scene]:
    """Scenes of the intensity times a factor, and of less and more."""
    factors = (factor, factor - slip, factor + slip)
    return [_with_intensity(scene, scene.intensity * each) for each in factors]


def _rounded(scene: Scene, kind: Any) -> Scene:
    """Round the numbers of a scene to a precision."""

    def rounded(leaf: Reals) -> Reals:
        return jax.lax.reduce_precision(leaf, kind.nexp, kind.nmant)

    # Only the reciprocal of the inertia ratio counts, and that of 4 / 3 rounds to 0.75
    # everywhere.
    ratio = 1 / rounded(1 / rounded(scene.block.inertia_ratio))
    return eqx.tree_at(lambda s: s.block.inertia_ratio, jax.tree.map(rounded, scene), ratio)


def _with_intensity(scene: Scene, intensity: Reals) -> Scene:
    return eqx.tree_at(lambda s: s.intensity, scene, intensity)


def _duration_costs(
    scene: Scene, pulse: Any, answers: Reals, unit: Reals, known: Booleans, rounding: Reals
) -> tuple[Reals, Reals]:
    """Estimates of what instantaneous pulses cost, and bounds on their errors.

    From the answers at the intensity itself, and at that which has the effect of pulses of
    finite duration by the estimate, and by its lower and upper bound.
    """
    duration, centroid, *_ = pulse
    later = 2 * duration * (1 - scene.restitution) * centroid
    critical = answers[0, 2]
    limit = Nonlinear().critical_velocity(scene.block)
    shift, unit_at_limit, known_at_limit = _shift(
        _with_intensity(scene, critical), limit, *pulse
    )

    def lasting(sign: float, at: Reals) -> Reals:
        period = at[1] * (1 + sign * _TIME * unit) + later
        intensity = critical * (1 - shift + sign * _CRITICAL * unit_at_limit)
        return jnp.stack([at[0], period, intensity])

    finite = [*map(lasting, (0.0, -1.0, 1.0), answers[1:])]
    estimate, low, high = (_relative(answers[0], each) for each in finite)
    spread = jnp.maximum(jnp.abs(low - estimate), jnp.abs(high - estimate))
    # One that is not finite says only which side of the threshold the estimate is on.
    bound = jnp.where(jnp.isfinite(estimate), spread, jnp.inf) + rounding
    # If no answer is finite the block overturns in any case, and nothing is left to lose.
    some = jnp.isfinite(jnp.stack([answers[0], *finite])).any(axis=0)
    known = jnp.stack([known, known, known_at_limit])
    bound = jnp.where(known, jnp.where(some, bound, 0), jnp.inf)
    lasts = jnp.stack([duration > 0] * 3)
    return jnp.where(lasts & known, estimate, 0), jnp.where(lasts, bound, 0)


def _shift(
    scene: Scene,
    velocity: Reals,
    duration: Reals,
    centroid: Number,
    work: Number,
    slack: Number,
) -> tuple[Reals, Reals, Booleans]:
    """Relative change of the velocity due to the duration, unit of its bounds, whether known."""
    block = scene.block
    c = scene.restitution
    intensity = scene.intensity
    lasts = (duration > 0) & (intensity > 0)
    e = duration * block.gravity / (block.slenderness * jnp.where(lasts, intensity, 1))
    # A pulse that starts weak lets a slow block fall back to the ground before it pushes.
    known = (
        lasts & (e <= _MAX_UPLIFT_RATIO) & (velocity < jnp.inf) & (c >= slack * e**2 * (1 - c))
    )
    known = known & (block.slenderness >= _MIN_SLENDERNESS)
    e = jnp.where(known, e, 0)
    pushed = jnp.where(known, velocity, 0) * intensity / block.gravity
    shift = e * ((c * centroid + (1 - c) * work) * pushed - (1 - c) * centroid)
    return shift, e**2 * (1 - c + pushed), known


def _relative(value: Reals, reference: Reals) -> Reals:
    """``value / reference - 1``: 0 where neither exists, inf where one does, 0 for 0 / 0."""
    exists = jnp.isfinite(value)
    reference_exists = jnp.isfinite(reference)
    compared = exists & reference_exists & (reference != 0)
    ratio = jnp.where(compared, value, 1) / jnp.where(compared, reference, 1)
    same = (exists == reference_exists) & (compared | (value == reference) | ~exists)
    return jnp.where(same, ratio - 1, jnp.inf)


def answers_of(scene: Scene, model: RockingModel) -> Answers:
    """Compute the three answers by a closed form."""
    critical = critical_intensity(scene.block, scene.restitution, model=model)
    return Answers(rotation_ratio(scene, model), stabilized_period(scene, model), critical)


@jax.jit
def linearized_is_enough(scene: Scene, tolerance: Number) -> Booleans:
    """Tell where the block stands and linearizing costs no answer more than the tolerance.

    Cheaper than either closed form: the cost grows with the velocity, so that it is within the
    tolerance up to one velocity, which in units of the critical one depends on the slenderness
    alone.
    """
    one = jnp.ones_like(scene.block.slenderness)
    block = eqx.tree_at(lambda b: (b.half_width, b.gravity), scene.block, (one, one))
    linearized = Linearized()
    nonlinear = Nonlinear()
    critical = nonlinear.critical_velocity(block)
    over = critical / linearized.critical_velocity(block)
    single = critical / block.pulse_velocity(1.0)
    allowed = jnp.asarray(tolerance, over.dtype) - 16 * float(jnp.finfo(over.dtype).eps)

    def enough(x: Reals) -> Booleans:
        """Tell whether it is enough at a velocity in units of the critical one."""
        sides = ((linearized, x * over), (nonlinear, x))
        ratios = (model._rotation_ratio(block, v) for model, v in sides)
        durations = (model._half_cycle_duration(block, v, x * single) for model, v in sides)
        costs = jnp.maximum(jnp.abs(_relative(*ratios)), jnp.abs(_relative(*durations)))
        return jnp.maximum(costs, jnp.abs(1 / over - 1)) <= allowed

    def halved(_: Any, interval: tuple[Reals, Reals]) -> tuple[Reals, Reals]:
        low, high = interval
        middle = 0.5 * (low + high)
        within = enough(middle)
        return jnp.where(within, middle, low), jnp.where(within, high, middle)

    one = jnp.ones_like(over)
    fastest, _ = jax.lax.fori_loop(0, 40, halved, (0 * one, one))
    fastest = jnp.where(enough(1e-3 * one), fastest, -1.0)
    return stabilized_velocity(scene) <= fastest * nonlinear.critical_velocity(scene.block)
