"""Costs of simplifying a scene, predicted from closed forms.

The truth is the nonlinear equation under pulses of finite duration. Three things are cheaper:
linearizing, taking pulses as instantaneous, and single precision.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..ground_motion import HalfSine, Pulse, Rectangular
from ..host import Printed, format_number
from ..impact import count_half_cycles
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
    as_name,
    as_real,
    check_kind,
    check_shapes,
    describe,
    elementwise,
    is_traced,
    unify_precision,
)

# The estimate of what a duration costs is known up to this ratio of the acceleration that just
# lifts the block to the mean one of the pulse, and from this slenderness on.
_MAX_UPLIFT_RATIO = 0.8
_MIN_SLENDERNESS = 0.5
# Bounds on its remainder, of velocity, period and critical intensity, in units of
# `_estimate_shift`; the largest values found by a search are 0.239, 0.267 and 0.159.
_VELOCITY = 0.3
_TIME = 0.35
_CRITICAL = 0.2


class _Pulse(NamedTuple):
    """Numbers of a pulse of duration and intensity 1."""

    centroid: Number
    work: Number  # the integral of the pulse times its second integral
    slack: Number


# Under a half-sine a block launched with less than 3 e^2 (1 - C) / (4 pi^2) of the velocity
# comes back at once; that velocity may be half of what is estimated: hence the slack.
_PULSES = {
    None: _Pulse(0.0, 0.0, 0.0),
    Rectangular: _Pulse(0.5, 1 / 6, 0.0),
    HalfSine: _Pulse(0.5, 0.125, 0.2),
}
# Rounding of the closed forms, as a change of the intensity in units of the last place, and of
# the answer beside. Comparisons with 70 digits find 2 (1 + K), K the condition number.
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

    @property
    def largest(self) -> Reals:
        """The largest of the three, element by element."""
        return jnp.stack(jax.tree.leaves(self)).max(axis=0)

    def __str__(self) -> str:
        return ", ".join(
            f"{name.replace('_', ' ')} {format_number(v)}" for name, v in vars(self).items()
        )


class ModelError(Printed, eqx.Module):
    """Relative errors of simplifying a scene; see `model_error`.

    Attributes
    ----------
    linearization : Answers
        Answers of `Linearized` over those of `Nonlinear`, minus 1; exact up to rounding.
    duration : Answers
        Answers under instantaneous pulses over those under pulses of finite duration, minus 1;
        to first order in the duration.
    duration_bound : Answers
        Bound on the error of `duration`, with rounding; inf where nothing is known.
    rounding : dict
        Bound on the rounding error, for the models "linearized" and "nonlinear" and for 32
        and 64 bits. It includes rounding during the computation, and rounding of the
        arguments if they are given in a higher precision. For a scene given in float32, whose
        arguments need no rounding, the bound for 64 bits is given as well.
    """

    linearization: Answers
    duration: Answers
    duration_bound: Answers
    rounding: dict[str, dict[int, Answers]]

    def __str__(self) -> str:
        rows = vars(self).items()
        return "\n".join(f"{name.replace('_', ' '):20}{errors}" for name, errors in rows)

    def total(self, model: str, bits: int) -> Answers:
        """Bound on the error of a model in a precision; inf where nothing is known.

        It includes the rounding error of `linearization`, which was computed in the precision
        of the scene.

        Parameters
        ----------
        model, bits : str, int
            "linearized" or "nonlinear", under instantaneous pulses; 32 or 64.

        Returns
        -------
        Answers

        Raises
        ------
        ValueError
            If there is no such model.
        """
        model = as_name("model", model, self.rounding)
        linearization = self.linearization
        roundings = [self.rounding[model][bits]]
        if model == "linearized":
            # The ratio of two computed answers, each rounded as the scene was given.
            own_bits = int(jnp.finfo(linearization.period.dtype).bits)
            roundings += [by_bits[own_bits] for by_bits in self.rounding.values()]
        else:
            linearization = jax.tree.map(jnp.zeros_like, linearization)

        def add_costs(first: Reals, second: Reals, bound: Reals, *roundings: Reals) -> Reals:
            """Add the costs of one answer, as errors of factors that are multiplied."""
            # (1 + first) (1 + second) - 1 without the loss of digits; the bound is on `second`.
            total = jnp.abs(first + second + first * second) + bound * (1 + first)
            for rounding in roundings:  # each of what the others have left
                total = total + rounding * (1 + total)
            return jnp.where(jnp.isfinite(first + second), total, jnp.inf)

        return jax.tree.map(
            add_costs, linearization, self.duration, self.duration_bound, *roundings
        )


def model_error(
    scene: Scene, shape: type[Pulse] | None = None, duration: Number = 0.0
) -> ModelError:
    """Bound the errors of simplifying a scene, before computing anything expensive.

    Parameters
    ----------
    scene : Scene
    shape : type, optional
        Shape of the pulses, `Rectangular` or `HalfSine`: only these have an intensity. By
        default the pulses are instantaneous.
    duration : array_like, optional
        Duration of the pulses [s], at least 0.

    Returns
    -------
    ModelError
        Errors of the stabilized rotation ratio and period and of the critical intensity. If a
        simplification changes the outcome (standing or overturning), its error is inf. If the
        block certainly overturns with and without it, the error is 0.

    Raises
    ------
    ValueError
        If `shape` has no intensity, or a concrete argument is out of range.

    Notes
    -----
    To first order in their duration d, pulses change the stabilized velocity by the factor
    ``1 + e (w v* I / g - (1 - C) m)``. Here ``e = d g tan(alpha_c) / I`` is the quotient of
    two accelerations: the one that just lifts the block, and the mean one of the pulse. m is
    the centroid of the pulse in durations, and ``w = C m + (1 - C) n``, where n is the
    integral of the pulse times its own second integral. The remainder is at most
    ``0.3 e^2 (1 - C + v* I / g)``. This bound is empirical: a search compared the estimate
    with the equation of motion for slenderness from 0.5 on and e up to 0.8, and the largest
    remainder had a factor of 0.24 instead of 0.3. The bound is inf outside this range, and
    where a half-sine starts too weakly to keep a slow block off the ground.

    Examples
    --------
    >>> import jaxrock as jr
    >>> wall = jr.Scene(jr.Block(half_width=0.4, slenderness=5.0), 0.7, 0.15)
    >>> error = jr.accuracy.model_error(wall)
    >>> print(f"{100 * error.linearization.rotation_ratio:.2f} %")
    -0.61 %
    """
    check_kind("scene", scene, Scene)
    if shape not in tuple(_PULSES):
        raise ValueError(f"shape must be Rectangular or HalfSine, got {describe(shape)}")
    duration = as_real("duration", duration, unit="s")
    check_shapes(scene=scene, duration=duration)
    if shape is None and not is_traced(duration) and np.any(duration != 0):
        raise ValueError("shape must be given with a duration: Rectangular or HalfSine")
    # Broadcast here, so that what is compiled depends on the shape of the result alone.
    leaves, structure = jax.tree.flatten(unify_precision((scene, duration)))
    scene, duration = jax.tree.unflatten(structure, jnp.broadcast_arrays(*leaves))
    return _compute_model_error(scene, duration, _PULSES[shape])


@elementwise(duration=NON_NEGATIVE)
def _compute_model_error(scene: Scene, duration: Number, pulse: _Pulse) -> ModelError:
    """Compute all costs by one call of each closed form, on variants of the scene.

    There are seven variants, or ten. The first four are the scene itself and scenes of the
    intensity with the effect of pulses of finite duration, by the estimate and its bounds;
    three follow for each precision.
    """
    duration = jnp.asarray(duration)
    own = jnp.finfo(duration.dtype)
    precisions = {32: jnp.finfo(jnp.float32), int(own.bits): own}
    shift, unit, _ = _estimate_shift(scene, stabilized_velocity(scene), duration, pulse)
    # Impulses and velocities are proportional: a bound on the velocity is one on the
    # intensity.
    slip = _VELOCITY * unit + _ROUNDINGS * float(own.eps)
    # All at once, since each closed form takes long to compile.
    variants = [scene, *_vary_intensity(scene, 1 + shift, slip)]
    for kind in precisions.values():
        rounded = _round_scene(scene, kind)
        variants += _vary_intensity(rounded, 1.0, _ROUNDINGS * float(kind.eps))
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *variants)
    answers = {
        model.name: jnp.stack(jax.tree.leaves(compute_answers(stacked, model)), axis=1)
        for model in (Linearized(), Nonlinear())
    }
    roundings = {name: _bound_roundings(part, precisions) for name, part in answers.items()}
    linearized, nonlinear = answers.values()
    rounding = jnp.stack(jax.tree.leaves(roundings["nonlinear"][int(own.bits)]))
    costs = _estimate_duration_costs(scene, duration, pulse, nonlinear[:4], rounding)
    return ModelError(Answers(*compare(linearized[0], nonlinear[0])), *costs, roundings)


def _bound_roundings(answers: Reals, precisions: dict[int, np.finfo]) -> dict[int, Answers]:
    """Bound the rounding errors in each precision from the answers on all variants."""
    # What rounding the arguments does, and the most that rounding on the way may do beside.
    rounded, less, more = (answers[first::3] for first in (4, 5, 6))
    moved = jnp.maximum(*(jnp.abs(compare(varied, rounded)) for varied in (less, more)))
    errors = jnp.abs(compare(rounded, answers[:1])) + moved
    bounds = {
        bits: Answers(*(error + _ROUNDINGS * float(kind.eps)))
        for (bits, kind), error in zip(precisions.items(), errors, strict=True)
    }
    if 64 not in bounds:  # which grow at least as fast as the unit of the last place
        finer = float(jnp.finfo(jnp.float64).eps / jnp.finfo(jnp.float32).eps)
        bounds[64] = jax.tree.map(lambda bound: finer * bound, bounds[32])
    return bounds


def _vary_intensity(scene: Scene, factor: Reals | float, slip: Reals | float) -> list[Scene]:
    """Vary the intensity of a scene: times a factor, and times less and more than it."""
    factors = (factor, factor - slip, factor + slip)
    return [eqx.tree_at(lambda s: s.intensity, scene, scene.intensity * x) for x in factors]


def _round_scene(scene: Scene, kind: np.finfo) -> Scene:
    """Round the numbers of a scene to a precision, and keep them in their own."""

    def round_leaf(leaf: Reals) -> Reals:
        """Round one number; XLA would take away a conversion to float32 and back."""
        return jax.lax.reduce_precision(leaf, kind.nexp, kind.nmant)

    # Only the reciprocal of the inertia ratio counts, and that of 4 / 3 rounds to 0.75
    # everywhere.
    ratio = 1 / round_leaf(1 / round_leaf(scene.block.inertia_ratio))
    return eqx.tree_at(lambda s: s.block.inertia_ratio, jax.tree.map(round_leaf, scene), ratio)


def _estimate_duration_costs(
    scene: Scene, duration: Reals, pulse: _Pulse, answers: Reals, rounding: Reals
) -> tuple[Answers, Answers]:
    """Estimate what instantaneous pulses cost, and bound the errors of the estimates.

    `answers` are those at the intensity itself, and at the intensities that have the effect of
    pulses of finite duration by the estimate, and by its lower and upper bound.
    """
    _, unit, known = _estimate_shift(scene, stabilized_velocity(scene), duration, pulse)
    # A pulse acts at its centroid, and up to there the block goes at C of the velocity: in
    # each half-cycle it is late by 1 - C of that time.
    late = (1 - scene.restitution) * pulse.centroid * duration
    delay = count_half_cycles(scene.block) * late
    # The critical intensity is where the block settles at the critical velocity: there the
    # shift of the velocity says by how much the intensity has to change the other way.
    critical = answers[0, 2]
    at_limit = eqx.tree_at(lambda s: s.intensity, scene, critical)
    limit = Nonlinear().critical_velocity(scene.block)
    shift, unit_at_limit, known_at_limit = _estimate_shift(at_limit, limit, duration, pulse)

    def add_duration(sign: float, at: Reals) -> Reals:
        """Compute the answers under pulses of finite duration, with a bound of some sign."""
        period = at[1] * (1 + sign * _TIME * unit) + delay
        intensity = critical * (1 - shift + sign * _CRITICAL * unit_at_limit)
        return jnp.stack([at[0], period, intensity])

    finite = [*map(add_duration, (0.0, -1.0, 1.0), answers[1:])]
    estimate, low, high = (compare(answers[0], answer) for answer in finite)
    spread = jnp.maximum(jnp.abs(low - estimate), jnp.abs(high - estimate))
    # One that is not finite says only which side of the threshold the estimate is on.
    bound = jnp.where(jnp.isfinite(estimate), spread, jnp.inf) + rounding
    # If no answer is finite the block overturns in any case, and nothing is left to lose.
    some = jnp.isfinite(jnp.stack([answers[0], *finite])).any(axis=0)
    known = jnp.stack([known, known, known_at_limit])
    bound = jnp.where(known, jnp.where(some, bound, 0), jnp.inf)
    lasts = jnp.stack([duration > 0] * 3)
    return Answers(*jnp.where(lasts & known, estimate, 0)), Answers(
        *jnp.where(lasts, bound, 0)
    )


def _estimate_shift(
    scene: Scene, velocity: Reals, duration: Reals, pulse: _Pulse
) -> tuple[Reals, Reals, Booleans]:
    """Estimate the relative change of the velocity by the duration, and its bounds' unit.

    Also tell where the estimate is known to hold; see the notes of `model_error`.
    """
    slenderness = scene.block.slenderness
    gravity = scene.block.gravity
    c = scene.restitution
    lasts = (duration > 0) & (scene.intensity > 0)
    e = duration * gravity / (slenderness * jnp.where(lasts, scene.intensity, 1))
    known = lasts & (e <= _MAX_UPLIFT_RATIO) & (slenderness >= _MIN_SLENDERNESS)
    # A pulse that starts weak lets a slow block fall back to the ground before it pushes.
    known = known & (velocity < jnp.inf) & (c >= pulse.slack * e**2 * (1 - c))
    # Values that are not known are masked before they are used: their derivatives would be
    # NaN.
    e = jnp.where(known, e, 0)
    pushed = jnp.where(known, velocity, 0) * scene.intensity / gravity
    moved = (c * pulse.centroid + (1 - c) * pulse.work) * pushed
    return e * (moved - (1 - c) * pulse.centroid), e**2 * (1 - c + pushed), known


def compare(value: Reals, reference: Reals) -> Reals:
    """Compute ``value / reference - 1``.

    It is 0 where neither exists and for 0 / 0, and inf where only one of them exists.
    """
    exists = jnp.isfinite(value)
    reference_exists = jnp.isfinite(reference)
    compared = exists & reference_exists & (reference != 0)
    ratio = jnp.where(compared, value, 1) / jnp.where(compared, reference, 1)
    same = (exists == reference_exists) & (compared | (value == reference) | ~exists)
    return jnp.where(same, ratio - 1, jnp.inf)


def compute_answers(scene: Scene, model: RockingModel) -> Answers:
    """Compute the three answers by a closed form."""
    critical = critical_intensity(scene.block, scene.restitution, model=model)
    return Answers(rotation_ratio(scene, model), stabilized_period(scene, model), critical)


@jax.jit
def is_linearized_enough(scene: Scene, tolerance: Number) -> Booleans:
    """Return where the block stands and linearizing costs no answer more than the tolerance."""
    linearized, nonlinear = (compute_answers(scene, m) for m in (Linearized(), Nonlinear()))
    costs = jax.tree.map(lambda *pair: jnp.abs(compare(*pair)), linearized, nonlinear)
    # Less the rounding of the costs themselves, so that a tolerance that is kept is kept for
    # sure.
    allowed = tolerance - 16 * float(jnp.finfo(costs.period.dtype).eps)
    return jnp.isfinite(nonlinear.period) & (costs.largest <= allowed)
