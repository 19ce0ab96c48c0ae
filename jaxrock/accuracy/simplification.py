"""What simplifying a scene costs, predicted from closed forms.

The truth is the nonlinear equation under pulses as long as they are. Three things are
cheaper: linearizing, taking pulses as instantaneous, and single precision.
"""

import functools
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np

from ..ground_motion import Pulse
from ..host import shown
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
    elementwise,
    of_one_precision,
)

# What just lifts the block over the mean strength of the pulse, up to which the cost of its
# duration is known, and the slenderness from which on; and the bounds on what is left, of
# which the largest found by a search are 0.239, 0.267 and 0.159.
_LONGEST, _STOCKIEST = 0.8, 0.5
_VELOCITY, _TIME, _CRITICAL = 0.3, 0.35, 0.2
# Under a half-sine a block launched with less than 3 e^2 (1 - C) / (4 pi^2) of the velocity
# comes back at once; that velocity may be half of what is estimated.
_FALLS = 0.2
# Rounding of the closed forms, as a change of the intensity in units of the last place.
_ROUNDINGS = 3.5


class Answers(NamedTuple):
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
        named = self._asdict().items()
        return ", ".join(f"{name.replace('_', ' ')} {shown(answer)}" for name, answer in named)


class ModelError(eqx.Module):
    """What simplifying a scene costs; see `model_error`. All are relative.

    Attributes
    ----------
    linearization : Answers
        `Linearized` over `Nonlinear`, less 1: exact up to rounding.
    duration : Answers
        Instantaneous pulses over pulses that last, less 1: to first order in the duration.
    duration_bound : Answers
        What the estimate of `duration` may be off by, with rounding; inf where nothing is
        known.
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
        """Bound on the error of a model in a precision.

        With the rounding of what the costs were found from, so that it is no better than
        the precision the scene was given in.

        Parameters
        ----------
        model : str
            "linearized" or "nonlinear", under instantaneous pulses.
        bits : int
            32 or 64.

        Returns
        -------
        Answers
            Relative; inf where nothing is known.
        """
        given = int(jnp.finfo(self.linearization.period.dtype).bits)
        roundings = [self.rounding[model][bits]]
        if model == "linearized":  # which was compared with the other in the precision given
            roundings += [by_bits[given] for by_bits in self.rounding.values()]

        def added(simpler: Reals, duration: Reals, unsure: Reals, *roundings: Reals) -> Reals:
            simpler = simpler if model == "linearized" else jnp.zeros_like(simpler)
            both = jnp.abs(simpler + duration + simpler * duration)
            unsure = unsure + functools.reduce(jnp.add, roundings)
            known = jnp.isfinite(simpler + duration)
            return jnp.where(known, both + unsure * (1 + simpler), jnp.inf)

        return jax.tree.map(
            added, self.linearization, self.duration, self.duration_bound, *roundings
        )


def model_error(
    scene: Scene, shape: type[Pulse] | None = None, duration: Number = 0.0
) -> ModelError:
    """What simplifications cost a scene, before anything expensive is computed.

    Parameters
    ----------
    scene : Scene
    shape : type, optional
        `Rectangular` or `HalfSine`, if the pulses last: those that have an intensity.
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
    To first order in the duration d of the pulses, those that last settle at a velocity that
    is ``1 + e (w v* I / g - (1 - C) m)`` times that of instantaneous ones, with ``e = d g
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
    centroid, work, slack = (0.0, 0.0, 0.0) if shape is None else _moments(shape)
    duration = as_real("duration", duration)
    if shape is None and not isinstance(duration, jax.core.Tracer) and np.any(duration != 0):
        raise ValueError("shape must be given with a duration: Rectangular or HalfSine")
    # Broadcast here, so that what is compiled depends on the shape of the result alone.
    return _model_error(*_together(scene, duration), centroid, work, slack)


@elementwise(duration=NON_NEGATIVE)
def _model_error(
    scene: Scene, duration: Number, centroid: Number, work: Number, slack: Number
) -> ModelError:
    duration = jnp.asarray(duration)
    pulse = (duration, centroid, work, slack)
    shift, unsure, known = _shift(scene, stabilized_velocity(scene), *pulse)
    given = jnp.finfo(duration.dtype)
    slip = _VELOCITY * unsure + _ROUNDINGS * float(given.eps)
    variants = {
        "given": scene,
        "lasting": _scaled(scene, 1 + shift),
        "weaker": _scaled(scene, 1 + shift - slip),
        "stronger": _scaled(scene, 1 + shift + slip),
    }
    precisions = {32: jnp.finfo(jnp.float32), int(given.bits): given}
    for bits, kind in precisions.items():
        rounded = jax.tree.map(
            lambda leaf, kind=kind: jax.lax.reduce_precision(leaf, kind.nexp, kind.nmant), scene
        )
        slip = _ROUNDINGS * float(kind.eps)
        variants |= {
            f"{bits}": rounded,
            f"{bits}-": _scaled(rounded, 1 - slip),
            f"{bits}+": _scaled(rounded, 1 + slip),
        }

    # All at once, since each closed form takes long to compile.
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *variants.values())

    def answered(model: RockingModel) -> dict[str, Answers]:
        found = answers_of(stacked, model)
        return {
            name: jax.tree.map(lambda leaf, k=k: leaf[k], found) for k, name in enumerate(variants)
        }

    nonlinear, linearized = answered(Nonlinear()), answered(Linearized())

    def rounding(found: dict[str, Answers], bits: int) -> Answers:
        if bits not in precisions:  # which grows at least as fast as the slip
            finer = float(jnp.finfo(jnp.float64).eps) / float(given.eps)
            return jax.tree.map(lambda bound: finer * bound, rounding(found, int(given.bits)))
        eps = float(precisions[bits].eps)

        def bound(exact: Reals, rounded: Reals, less: Reals, more: Reals) -> Reals:
            moved = jnp.maximum(jnp.abs(_apart(less, rounded)), jnp.abs(_apart(more, rounded)))
            return jnp.abs(_apart(rounded, exact)) + moved + _ROUNDINGS * eps

        names = ("given", f"{bits}", f"{bits}-", f"{bits}+")
        return jax.tree.map(bound, *(found[name] for name in names))

    linearized_rounding, nonlinear_rounding = (
        {bits: rounding(found, bits) for bits in (32, 64)} for found in (linearized, nonlinear)
    )
    estimate, bound = _duration_costs(
        scene, pulse, nonlinear, unsure, known, nonlinear_rounding[int(given.bits)]
    )
    return ModelError(
        linearization=jax.tree.map(_apart, linearized["given"], nonlinear["given"]),
        duration=estimate,
        duration_bound=bound,
        rounding={"linearized": linearized_rounding, "nonlinear": nonlinear_rounding},
    )


def _duration_costs(
    scene: Scene,
    pulse: tuple[Reals, Number, Number, Number],
    nonlinear: dict[str, Answers],
    unsure: Reals,
    known: Booleans,
    rounding: Answers,
) -> tuple[Answers, Answers]:
    """What instantaneous pulses cost and what that may be off by, from the variants."""
    duration, centroid, *_ = pulse
    later = 2 * duration * (1 - scene.restitution) * centroid
    now, then, less, more = (nonlinear[n] for n in ("given", "lasting", "weaker", "stronger"))
    critical = now.critical_intensity
    at_verge = Nonlinear().critical_velocity(scene.block)
    by, unsure_there, known_there = _shift(_with_intensity(scene, critical), at_verge, *pulse)
    periods = (
        then.period + later,
        less.period * (1 - _TIME * unsure) + later,
        more.period * (1 + _TIME * unsure) + later,
    )
    intensities = tuple(
        critical * (1 - by + sign * _CRITICAL * unsure_there) for sign in (0.0, -1.0, 1.0)
    )
    costs = (
        _cost(
            now.rotation_ratio,
            (then.rotation_ratio, less.rotation_ratio, more.rotation_ratio),
            known,
            duration > 0,
            rounding.rotation_ratio,
        ),
        _cost(now.period, periods, known, duration > 0, rounding.period),
        _cost(critical, intensities, known_there, duration > 0, rounding.critical_intensity),
    )
    estimates, bounds = zip(*costs, strict=True)
    return Answers(*estimates), Answers(*bounds)


@jax.jit
def linearized_is_enough(scene: Scene, tolerance: Number) -> Booleans:
    """Where the block stands and linearizing costs no answer more than the tolerance.

    For less than either closed form takes: what it costs grows with the velocity, so that
    there is one up to which it is little, and in units of the critical velocity that follows
    from the slenderness alone.
    """
    block = eqx.tree_at(lambda b: b.half_width, scene.block, jnp.ones_like(scene.block.slenderness))
    block = eqx.tree_at(lambda b: b.gravity, block, jnp.ones_like(scene.block.slenderness))
    linearized, nonlinear = Linearized(), Nonlinear()
    over = nonlinear.critical_velocity(block) / linearized.critical_velocity(block)
    single = nonlinear.critical_velocity(block) / block.pulse_velocity(1.0)
    least = 16 * float(jnp.finfo(over.dtype).eps)
    allowed = jnp.asarray(tolerance, over.dtype) - least

    def little(x: Reals) -> Booleans:
        ratios = (m._rotation_ratio(block, v) for m, v in ((linearized, x * over), (nonlinear, x)))
        durations = (
            m._half_cycle_duration(block, v, x * single)
            for m, v in ((linearized, x * over), (nonlinear, x))
        )
        costs = jnp.maximum(jnp.abs(_apart(*ratios)), jnp.abs(_apart(*durations)))
        return jnp.maximum(costs, jnp.abs(1 / over - 1)) <= allowed

    def halved(_: Any, between: tuple[Reals, Reals]) -> tuple[Reals, Reals]:
        low, high = between
        middle = 0.5 * (low + high)
        enough = little(middle)
        return jnp.where(enough, middle, low), jnp.where(enough, high, middle)

    one = jnp.ones_like(over)
    fastest, _ = jax.lax.fori_loop(0, 40, halved, (0 * one, one))
    fastest = jnp.where(little(1e-3 * one), fastest, -1.0)
    return stabilized_velocity(scene) <= fastest * nonlinear.critical_velocity(scene.block)


def answers_of(scene: Scene, model: RockingModel) -> Answers:
    """The three answers by a closed form."""
    critical = critical_intensity(scene.block, scene.restitution, model=model)
    return Answers(rotation_ratio(scene, model), stabilized_period(scene, model), critical)


def _with_intensity(scene: Scene, intensity: Reals) -> Scene:
    return eqx.tree_at(lambda s: s.intensity, scene, intensity)


def _scaled(scene: Scene, factor: Any) -> Scene:
    return _with_intensity(scene, scene.intensity * factor)


def _together(scene: Scene, duration: Reals) -> tuple[Scene, Reals]:
    leaves, form = jax.tree.flatten(of_one_precision((scene, duration)))
    leaves = jnp.broadcast_arrays(*leaves)
    return jax.tree.unflatten(form, leaves)


def _apart(value: Reals, of: Reals) -> Reals:
    """``value / of - 1``: 0 where neither exists, inf where one does, 0 for 0 / 0."""
    here, there = jnp.isfinite(value), jnp.isfinite(of)
    compared = here & there & (of != 0)
    ratio = jnp.where(compared, value, 1) / jnp.where(compared, of, 1)
    return jnp.where((here == there) & (compared | (value == of) | ~here), ratio - 1, jnp.inf)


def _shift(
    scene: Scene, velocity: Reals, duration: Reals, centroid: Number, work: Number, slack: Number
) -> tuple[Reals, Reals, Booleans]:
    """Relative change of the velocity if pulses last, unit of its bounds, whether known."""
    block, c, intensity = scene.block, scene.restitution, scene.intensity
    lasts = (duration > 0) & (intensity > 0)
    e = duration * block.gravity / (block.slenderness * jnp.where(lasts, intensity, 1))
    # One that starts weak lets a slow block fall back to the ground before it pushes.
    known = lasts & (e <= _LONGEST) & (velocity < jnp.inf) & (c >= slack * e**2 * (1 - c))
    known = known & (block.slenderness >= _STOCKIEST)
    e = jnp.where(known, e, 0)
    pushed = jnp.where(known, velocity, 0) * intensity / block.gravity
    shift = e * ((c * centroid + (1 - c) * work) * pushed - (1 - c) * centroid)
    return shift, e**2 * (1 - c + pushed), known


def _cost(
    now: Reals, lasting: tuple[Reals, ...], known: Booleans, lasts: Booleans, rounding: Reals
) -> tuple[Reals, Reals]:
    """What `now` is off by if the first that is `lasting` is right, or else one of the others."""
    then, less, more = lasting
    estimate = _apart(now, then)
    spread = [
        jnp.where(jnp.isfinite(estimate), jnp.abs(_apart(now, other) - estimate), 0)
        for other in (less, more)
    ]
    # Where nothing is left to lose: the block overturns in any case.
    some = jnp.isfinite(now) | jnp.isfinite(then) | jnp.isfinite(less) | jnp.isfinite(more)
    unsure = jnp.where(some, jnp.maximum(*spread) + rounding, 0)
    unsure = jnp.where(known, unsure, jnp.inf)
    return jnp.where(lasts & known, estimate, 0), jnp.where(lasts, unsure, 0)


@functools.cache
def _moments(shape: type[Pulse]) -> tuple[float, float, float]:
    """Centroid of a pulse, the integral of it times its second integral, and `_FALLS`.

    Of a pulse of duration 1 and intensity 1.
    """
    if not (isinstance(shape, type) and issubclass(shape, Pulse)) or shape.area == 0:
        raise ValueError(f"shape must be Rectangular or HalfSine, got {shape!r}")
    node, weight = np.polynomial.legendre.leggauss(32)
    node, weight = 0.5 * (node + 1), 0.5 * weight

    def strength(phase: np.ndarray) -> np.ndarray:
        return np.asarray(shape.shape(jnp.asarray(phase))) / shape.area

    # The second integral of f up to t is the integral of (t - u) f(u).
    twice = [np.sum(weight * t * t * (1 - node) * strength(t * node)) for t in node]
    pulse = weight * strength(node)
    slack = 0.0 if strength(np.zeros(1))[0] > 0 else _FALLS
    return float(np.sum(pulse * node)), float(np.sum(pulse * np.array(twice))), slack
