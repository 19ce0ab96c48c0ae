"""The pulses of finite duration that just overturn in resonance."""

import math
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp

from ..block import Block
from ..driven import Equation, Response, uplift_acceleration
from ..ground_motion import Pulse, pulse_class
from ..host import Printed, listed, with_clock
from ..numerics import ABOVE, BELOW, Root, Sample, Scan, chosen, through_residual
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import Booleans, Integers, Number, Reals, is_traced
from .repeated_pulses import (
    LONGEST,
    RESTS,
    PulsedPhase,
    PulsedScene,
    checked,
    half_cycle,
    landing_of,
    phase_of,
    tolerance_of,
)

_STEP = 0.2  # of the logarithm of the amplitude, until a pulse overturns the block
_STEPS = 300  # at most
_MOST = 10**6  # half-cycles, if they are counted
_BELOW = 1e-6  # part by which pulses are weaker for which `from_rest` is computed
_NEAR = 1e-3  # how close the block lands then to what is expected, in critical velocities


class PulsedThreshold(Printed, eqx.Module):
    """Pulses of finite duration that just overturn, each right after an impact; NaN for none.

    Attributes
    ----------
    amplitude, intensity : Array
        Of the pulses [m/s2], [m/s].
    rate : Array
        Slope of the half-cycle map there; NaN for a finite number of half-cycles.
    lifts : Array of bool
        Whether they lift the block from rest. If not, only a block in motion is kept in
        motion.
    from_rest : Array of bool
        Whether pulses weaker by 1e-6 lead to that fixed point from rest. If not, they do not
        lift the block, or its motion dies out; or they, and weaker ones, overturn it: a
        one-sine pulse can overturn a block at rest and keep one up that moves fast enough.
    """

    amplitude: Reals
    intensity: Reals
    rate: Reals
    lifts: Booleans
    from_rest: Booleans

    def __str__(self) -> str:
        units = dict.fromkeys(self.__dataclass_fields__, "")
        units |= {"amplitude": "m/s2", "intensity": "m/s"}
        if not is_traced(self.rate) and jnp.isnan(self.rate).all():
            del units["rate"]
        return listed(self, **units)


@with_clock("critical amplitude of pulses")
def critical_pulsed_amplitude(
    block: Block,
    restitution: Number,
    shape: type[Pulse],
    duration: Number,
    *,
    half_cycles: Number = math.inf,
    model: ModelLike = Nonlinear(),
    rtol: float = 1e-10,
) -> PulsedThreshold:
    """Amplitude of the pulses that just overturn a block within so many half-cycles.

    The first pulse meets the block at rest, each other one follows an impact. Without end,
    they overturn it from where the fixed point of `pulsed_next_velocity` disappears: there a
    block that lands with the critical velocity just fails to overturn under the next pulse.
    For short pulses the intensity is that of `critical_intensity`.

    Parameters
    ----------
    block, restitution, model, rtol
        As in `pulsed_next_velocity`.
    shape : type
        `Rectangular`, `HalfSine`, `Sine`, `Cosine` or `Ricker`.
    duration : float
        Duration of the pulses [s], greater than 0.
    half_cycles : int or inf
        Number of pulses, from 1 on; by default they go on without end.

    Returns
    -------
    PulsedThreshold
        For a finite number the lowest amplitude that overturns, up from uplift in steps of a
        fifth. Without end NaN where the fixed point is unstable there. Under long pulses its
        rate exceeds 1, and it disappears before, by meeting another one; with a rate below -1,
        half-cycles alternate before. NaN also where no amplitude brings the block to the
        threshold: one that loses most of its velocity at impacts is caught by a long pulse, or
        overturns at once.

    Raises
    ------
    ValueError
        If `shape` is no class of pulses, or a concrete argument is out of range.
    """
    pulse = pulse_class(shape)(1.0, duration)
    scene, _ = checked(block, restitution, pulse, 0.0, rtol)
    model = as_model(model)
    allowed = f"half_cycles must be a whole number from 1 to {_MOST}, or inf"
    if is_traced(half_cycles):
        raise ValueError(f"{allowed}, got a traced value")
    if half_cycles != math.inf:
        if half_cycles not in range(1, _MOST + 1):
            raise ValueError(f"{allowed}, got {half_cycles!r:.60}")
        return _threshold(scene, model, rtol, jnp.asarray(half_cycles, int))[0]
    threshold, weaker, expected = _threshold(scene, model, rtol, None)
    # Without derivatives, which a yes or no has not; and apart, since this program is likely
    # to be compiled already.
    weaker, expected = jax.lax.stop_gradient(((*scene[:2], weaker), expected))
    phase = phase_of(weaker, model, max(rtol, 1e-9))
    leads = _leads_there(phase, *expected)
    return eqx.tree_at(lambda t: t.from_rest, threshold, threshold.from_rest & leads)


def _margin(
    scene: PulsedScene,
    logarithm: Reals,
    direction: Any,
    count: Integers | None,
    model: RockingModel,
    rtol: float,
) -> tuple[Reals, Reals, tuple[Reals, Booleans, Any]]:
    """Compute the margin at the end of the pulse, its slope; the velocity then; the outcome.

    That is whether the block landed under the pulse, and whether it overturned under one
    before.

    Of a block that landed with the critical velocity or, with a count, of the last of so many
    pulses from rest. The direction is one of the logarithm of the amplitude and of that
    velocity.
    """
    block, restitution, pulse = scene
    equation = Equation.of(block, model)

    def margin(logarithm: Reals, velocity: Reals) -> tuple[Reals, tuple[Reals, Booleans, Any]]:
        stronger = block, restitution, pulse.scaled(jnp.exp(logarithm))
        if count is None:
            response = half_cycle(stronger, velocity, 0.0, model, rtol).response
            early = False
        else:
            response, early = _last_of(count, stronger, velocity, model, rtol)
        side = jnp.where(response.final_rotation < 0, -1, 1)
        outward = side * response.final_velocity
        returning = equation.returning_velocity(side * response.final_rotation)
        left = (returning - outward) / equation.critical_velocity
        return left, (outward, response.impacts > 0, early)

    start = equation.critical_velocity if count is None else jnp.zeros_like(logarithm)
    return jax.jvp(margin, (logarithm, start), direction, has_aux=True)


def _last_of(
    count: Integers, scene: PulsedScene, velocity: Reals, model: RockingModel, rtol: float
) -> tuple[Response, Booleans]:
    """Follow the last pulse, or the one before if that overturns; tell which it is."""

    def step(state: Any) -> Any:
        left, velocity, early, _ = state
        last = left == 0
        # The last pulse until it ends, the others until the block lands.
        followed = half_cycle(scene, velocity, jnp.where(last, 0.0, LONGEST), model, rtol)
        landing, (outcome, *_) = landing_of(followed)
        over = ~last & (outcome > RESTS)
        left = jnp.where(over, 0, left - 1)
        return left, jnp.where(last | over, velocity, landing), early | over, followed.response

    response = jax.eval_shape(
        lambda: half_cycle(scene, velocity, velocity, model, rtol).response
    )
    response = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), response)
    begin = count - 1, velocity, jnp.zeros((), bool), response
    _, _, early, response = jax.lax.while_loop(lambda state: state[0] >= 0, step, begin)
    return response, early


def _residual(
    scene: PulsedScene,
    logarithm: Reals,
    *,
    count: Integers | None,
    model: RockingModel,
    rtol: float,
) -> tuple[Reals, tuple[Reals, ...]]:
    """Compute what is 0 at the threshold, and the rate of the half-cycle map there."""
    along_velocity = jnp.zeros_like(logarithm), jnp.ones_like(logarithm)
    margin, slope, (velocity, *_) = _margin(
        scene, logarithm, along_velocity, count, model, rtol
    )
    # The block lands with sqrt(v_c^2 + v^2 - D^2), D being the velocity at which it just fails
    # to come back, and at the threshold its velocity v is D.
    return margin, (-velocity * slope,)


class _ThresholdSearch(NamedTuple):
    scan: Scan  # of minus the logarithm of the amplitude, so that it goes up
    found: Booleans
    goes_on: Booleans
    gain: Reals  # slope of the landing velocity there, with respect to the logarithm
    rate: Reals  # of the half-cycle map there, which takes one evaluation more


def _search(
    scene: PulsedScene, *, count: Integers | None, model: RockingModel, rtol: float
) -> Root:
    """Up from next to nothing (uplift, with a count) until it overturns, and to the threshold."""
    block, _, pulse = scene
    tolerance = tolerance_of(pulse.amplitude, rtol)
    eps = float(jnp.finfo(pulse.amplitude.dtype).eps)
    below = 0.4 * math.log(eps) if count is None else 0.0
    first = jnp.log(uplift_acceleration(block, model)) + below
    no = jnp.zeros((), bool)
    zero = jnp.zeros_like(first)

    def points(index: Any) -> Reals:
        return -first - _STEP * index

    def step(search: _ThresholdSearch) -> _ThresholdSearch:
        scan = search.scan
        one = zero + 1
        # Once the threshold is found, along the velocity, for the rate of the map.
        along = jnp.where(search.found, zero, one), jnp.where(search.found, one, zero)
        margin, slope, (velocity, lands, early) = _margin(
            scene, -scan.trial, along, count, model, rtol
        )
        overturns = ~lands & ~(margin >= 0) | early
        kind = jnp.where(overturns, ABOVE, BELOW)
        new = Sample(scan.trial, -margin, jnp.where(lands | early, 0, slope), kind)
        # Newton's steps that no longer shrink are the error of the integration.
        size = jnp.abs(new.newton)
        last = jnp.abs(scan.last.newton)
        close = (size <= tolerance) | (size <= 1e3 * tolerance) & (size >= 0.5 * last)
        found = close & (overturns | (scan.since > 0))
        following = scan.after(new, found, points)
        # Where the block begins to be caught before it lands, it may overturn at once, with no
        # threshold in between.
        at_once = (following.since == 0) & (following.right.kind == ABOVE)
        goes_on = found | ~at_once & (following.point <= _STEPS)
        following = following._replace(trial=jnp.where(found, scan.trial, following.trial))
        onward = _ThresholdSearch(following, found, goes_on, -velocity * slope, zero)
        done = search._replace(goes_on=no, rate=-velocity * slope)
        return chosen(search.found, done, onward)

    scan = Scan.beginning(points(0))._replace(point=jnp.zeros((), int))
    begin = _ThresholdSearch(scan, no, ~no, zero, zero)
    end = jax.lax.while_loop(lambda search: search.goes_on, step, begin)
    root, rate, gain = (
        jnp.where(end.found, x, 0) for x in (-end.scan.trial, end.rate, end.gain)
    )
    return Root(root, (rate,), end.found, (gain,))


_root = through_residual(_search, _residual)


@eqx.filter_jit
def _threshold(
    scene: PulsedScene, model: RockingModel, rtol: float, count: Integers | None
) -> tuple[PulsedThreshold, Pulse, tuple[Reals, Reals]]:
    """Find the threshold; a slightly weaker pulse, the landing velocity due then, how near."""
    block, _, pulse = scene
    root = _root(scene, count=count, model=model, rtol=rtol)
    (rate,) = root.values
    (gain,) = root.flags
    rate = rate if count is None else jnp.full_like(rate, jnp.nan)
    amplitude = jnp.exp(root.root)
    stable = root.exists & ((count is not None) | (jnp.abs(rate) <= 1))
    threshold = PulsedThreshold(
        amplitude=jnp.where(stable, amplitude, jnp.nan),
        intensity=jnp.where(stable, pulse.scaled(amplitude).intensity, jnp.nan),
        rate=jnp.where(root.exists, rate, jnp.nan),
        lifts=stable & (amplitude > uplift_acceleration(block, model)),
        from_rest=stable,
    )
    weaker = pulse.scaled(jnp.where(stable, amplitude, 1) * (1 - _BELOW))
    critical = Equation.of(block, model).critical_velocity
    # Short cosines nearly cancel: there a little less amplitude is much less velocity.
    less = _BELOW * gain / jnp.where(rate < 1, 1 - rate, 1)
    return threshold, weaker, (critical - less, _NEAR * critical + 0.5 * jnp.abs(less))


@jax.jit
def _leads_there(phase: PulsedPhase, expected: Reals, near: Reals) -> Booleans:
    return phase.stands & phase.from_rest & (jnp.abs(phase.velocity - expected) <= near)
