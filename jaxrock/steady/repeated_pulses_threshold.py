"""The pulses of finite duration that just overturn in resonance.

A block that lands with the critical velocity v_c is at the threshold if the next pulse just
fails to overturn it: then it lands with v_c again. The margin at the end of the pulse is a
function of the amplitude; its lowest root is sought.
"""

import math
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from ..block import Block
from ..driven import Equation, uplift_acceleration
from ..ground_motion import Pulse, check_pulse_class
from ..host import Printed, format_fields
from ..numerics import Root, differentiate_implicitly, select_tree
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import Booleans, Integers, Number, Reals
from .repeated_pulses import PulsedPhase, compute_phase
from .repeated_pulses_map import (
    PulsedScene,
    check_pulsed_arguments,
    follow_half_cycle,
    limit_tolerance,
)

# Step of the logarithm of the amplitude on the way up.
_STEP = 0.2
_MAX_STEPS = 300  # on the way up
# For `from_rest` the pulses are weaker by this fraction: at the threshold itself rounding
# decides.
_WEAKER = 1e-6
# Largest difference of their landing velocity from the expected one, over the critical
# velocity.
_NEAR = 1e-3


class PulsedThreshold(Printed, eqx.Module):
    """Pulses of finite duration, each after an impact, that just overturn a block; NaN if none.

    Attributes
    ----------
    amplitude, intensity : Array
        Amplitude [m/s2] and intensity [m/s] of the pulses.
    rate : Array
        Derivative of the half-cycle map there.
    lifts : Array of bool
        Whether the pulses lift the block from rest. If not, they only sustain a block that
        already moves.
    from_rest : Array of bool
        Whether pulses weaker by a relative 1e-6 lead to the fixed point from rest. If not,
        they do not lift the block, its motion dies out, or even weaker ones overturn it: a
        one-sine pulse can overturn a block at rest, yet sustain a block that moves fast
        enough.
    """

    amplitude: Reals
    intensity: Reals
    rate: Reals
    lifts: Booleans
    from_rest: Booleans

    def __str__(self) -> str:
        unitless = dict.fromkeys(("rate", "lifts", "from_rest"), "")
        return format_fields(self, amplitude="m/s2", intensity="m/s", **unitless)


def critical_pulsed_amplitude(
    block: Block,
    restitution: Number,
    shape: type[Pulse],
    duration: Number,
    *,
    model: ModelLike = Nonlinear(),
    rtol: float = 1e-10,
) -> PulsedThreshold:
    """Find the amplitude of pulses that just overturn a block, without end one after another.

    Each pulse begins at an impact. They overturn the block once the fixed point of the
    half-cycle map, the stabilized phase of `pulsed_phase`, has disappeared. At this threshold a
    block that lands with the critical velocity just fails to overturn under the next pulse. For
    short pulses the intensity tends to `critical_intensity`.

    Parameters
    ----------
    block, restitution, model, rtol
        As in `pulsed_phase`.
    shape : type
        `Rectangular`, `HalfSine`, `Sine`, `Cosine` or `Ricker`.
    duration : float
        Duration of the pulses [s], greater than 0.

    Returns
    -------
    PulsedThreshold
        The lowest amplitude at which a fixed point reaches the threshold, searched upwards in
        steps of 20 %; NaN if the `rate` of the map there is not between -1 and 1. A rate above
        1, as under long pulses, means that the stable fixed point has met an unstable one at a
        lower amplitude, and both have disappeared. A rate below -1 means that half-cycles
        alternate at a lower amplitude already. NaN also if no amplitude brings the block to the
        threshold: a block that loses most of its velocity at impacts is caught by a long pulse,
        or overturns at once.

    Raises
    ------
    ValueError
        If `shape` is no class of pulses, or a concrete argument is out of range.

    Examples
    --------
    >>> import jaxrock as jr
    >>> block = jr.Block(half_width=0.1, slenderness=5.0)
    >>> found = jr.steady.critical_pulsed_amplitude(block, 0.9, jr.HalfSine, 0.1)
    >>> print(f"{found.amplitude:.3f} m/s2, intensity {found.intensity:.3f} m/s")
    0.976 m/s2, intensity 0.062 m/s
    """
    pulse = check_pulse_class(shape)(1.0, duration)
    scene = check_pulsed_arguments(block, restitution, pulse, rtol)
    model = as_model(model)
    threshold, weaker, expected = _compute_threshold(scene, model, rtol)
    # The phase is computed separately, since this program is likely to be compiled already.
    phase = compute_phase(weaker, model, max(rtol, 1e-9))
    leads = _is_reached_from_rest(phase, *expected)
    return eqx.tree_at(lambda t: t.from_rest, threshold, threshold.from_rest & leads)


def _compute_margin(
    scene: PulsedScene, logarithm: Reals, direction: Reals, model: RockingModel, rtol: float
) -> tuple[Reals, Reals, tuple[Reals, Booleans]]:
    """Compute the margin to overturning at the end of the pulse, after a landing with v_c.

    Parameters
    ----------
    scene : PulsedScene
    logarithm : Array
        Logarithm of the amplitude.
    direction : Array, shape (2,)
        Direction of the slope: change of this logarithm, and of the landing velocity before.
    model : RockingModel
    rtol : float

    Returns
    -------
    margin, slope : Array
    outcome : tuple of Array
        Velocity away from the ground, and whether the block landed while the pulse acted.
    """
    block, restitution, pulse = scene
    equation = Equation.of(block, model)

    def margin_when_pulse_ends(point: Reals) -> tuple[Reals, tuple[Reals, Booleans]]:
        stronger = block, restitution, pulse.scaled(jnp.exp(point[0]))
        response = follow_half_cycle(stronger, point[1], 0.0, model, rtol).response
        side = jnp.where(response.final_rotation < 0, -1, 1)
        outward = side * response.final_velocity
        returning = equation.returning_velocity(side * response.final_rotation)
        margin = (returning - outward) / equation.critical_velocity
        return margin, (outward, response.impacts > 0)

    point = jnp.stack([logarithm, equation.critical_velocity])
    return jax.jvp(margin_when_pulse_ends, (point,), (direction,), has_aux=True)


def _compute_threshold_residual(
    scene: PulsedScene, logarithm: Reals, *, model: RockingModel, rtol: float
) -> tuple[Reals, tuple[Reals, ...]]:
    """Compute the margin, 0 at the threshold, and the rate of the half-cycle map there."""
    direction = jnp.array([0, 1], logarithm.dtype)
    margin, slope, (velocity, _) = _compute_margin(scene, logarithm, direction, model, rtol)
    # The block lands with sqrt(v_c^2 + v^2 - D^2), where v is its velocity at the end of the
    # pulse and D the velocity at which it just fails to come back. The margin is
    # (D - v) / v_c, and at the threshold v is D: so the landing velocity changes by -v times
    # the margin.
    return margin, (-velocity * slope,)


class _ThresholdSearch(NamedTuple):
    """The state of the search, in logarithms of the amplitude; see `_search_threshold`."""

    trial: Reals  # where the margin is computed next
    low: Reals  # the largest below all that overturn
    high: Reals  # the smallest that overturns; inf on the way up
    step: Reals  # the last step of Newton's method
    since: Integers  # number of evaluations since the way up ended
    located: Booleans
    goes_on: Booleans
    gain: Reals  # slope of the landing velocity there, with respect to the logarithm
    rate: Reals  # rate of the half-cycle map there, which takes one more evaluation


def _search_threshold(scene: PulsedScene, *, model: RockingModel, rtol: float) -> Root:
    """Search for the lowest amplitude that overturns, upwards from almost 0."""
    # State of the search | What is known                      | What happens next
    # --------------------|------------------------------------|-------------------------------
    # on the way up       | no amplitude so far overturns      | the next one, a fifth larger
    # between two         | the upper one overturns, the lower | Newton's method and bisection
    #                     |   one does not                     |
    # jump                | the block is caught before it      | not found: the end
    #                     |   lands, or overturns at once      |
    # found               | the threshold, and its slope along | one evaluation more, along
    #                     |   the amplitude                    |   the velocity, for the rate
    #                     |                                    |   of the map: the end
    #
    # Each iteration makes one evaluation, along one direction, so that one program is
    # compiled.
    block, _, pulse = scene
    tolerance = limit_tolerance(pulse.amplitude, rtol)
    eps = float(jnp.finfo(pulse.amplitude.dtype).eps)
    # A moving block may be overturned by far less than the uplift acceleration: in float64 the
    # way up begins at 5e-7 of it.
    first = jnp.log(uplift_acceleration(block, model)) + 0.4 * math.log(eps)
    no = jnp.zeros((), bool)
    zero = jnp.zeros_like(first)

    def evaluate_margin(search: _ThresholdSearch) -> _ThresholdSearch:
        trial = search.trial
        # Once the threshold is found, along the velocity, for the rate of the map.
        along = jnp.stack([~search.located, search.located]).astype(trial.dtype)
        margin, slope, (velocity, lands) = _compute_margin(scene, trial, along, model, rtol)
        gain = -velocity * slope
        # Written so that the NaN of an unfinished integration counts as overturned.
        overturns = ~lands & ~(margin >= 0)
        low = jnp.where(overturns, search.low, trial)
        high = jnp.where(overturns, trial, search.high)
        between = high < jnp.inf
        step = jnp.where(lands, jnp.inf, -margin / slope)
        # Newton's steps that no longer shrink show the error of the integration.
        size = jnp.abs(step)
        stuck = (size <= 1e3 * tolerance) & (size >= 0.5 * jnp.abs(search.step))
        located = between & ((size <= tolerance) | stuck)
        newton = trial + step
        inside = (newton > low) & (newton < high) & (search.since % 4 != 3)
        inner = jnp.where(inside, newton, 0.5 * (low + high))
        # Where the pulse begins to catch the block before it lands, the outcome may jump to
        # overturning without a threshold.
        wide = jnp.where(
            between, high - low > 4 * eps * jnp.abs(high), trial < first + _MAX_STEPS * _STEP
        )
        onward = _ThresholdSearch(
            trial=jnp.select([located, between], [trial, inner], trial + _STEP),
            low=low,
            high=high,
            step=step,
            since=jnp.where(between, search.since + 1, 0),
            located=located,
            goes_on=located | wide,
            gain=gain,
            rate=zero,
        )
        return select_tree(search.located, search._replace(goes_on=no, rate=gain), onward)

    begin = _ThresholdSearch(
        first, first, zero + jnp.inf, zero, jnp.zeros((), int), no, ~no, zero, zero
    )
    end = jax.lax.while_loop(lambda search: search.goes_on, evaluate_margin, begin)
    root, rate, gain = (jnp.where(end.located, x, 0) for x in (end.trial, end.rate, end.gain))
    return Root(root, (rate,), end.located, (gain,))


_find_threshold = differentiate_implicitly(_search_threshold, _compute_threshold_residual)


@eqx.filter_jit
def _compute_threshold(
    scene: PulsedScene, model: RockingModel, rtol: float
) -> tuple[PulsedThreshold, PulsedScene, tuple[Reals, Reals]]:
    """Find the threshold, and the data to check whether it is reached from rest.

    Returns
    -------
    threshold : PulsedThreshold
    weaker : PulsedScene
        With a pulse slightly weaker than the threshold.
    expected : tuple of Array
        Landing velocity at the fixed point of this pulse, and its tolerance. A boolean follows
        from both, so that they have no derivatives.
    """
    block, restitution, pulse = scene
    root = _find_threshold(scene, model=model, rtol=rtol)
    (rate,) = root.values
    (gain,) = root.flags
    amplitude = jnp.exp(root.root)
    stable = root.exists & (jnp.abs(rate) <= 1)
    threshold = PulsedThreshold(
        amplitude=jnp.where(stable, amplitude, jnp.nan),
        intensity=jnp.where(stable, pulse.scaled(amplitude).intensity, jnp.nan),
        rate=jnp.where(root.exists, rate, jnp.nan),
        lifts=stable & (amplitude > uplift_acceleration(block, model)),
        from_rest=stable,
    )
    weaker = pulse.scaled(jnp.where(stable, amplitude, 1) * (1 - _WEAKER))
    critical = Equation.of(block, model).critical_velocity
    # Short cosines nearly cancel: slightly less amplitude is much less velocity. The fixed
    # point moves by the gain of the map over 1 minus its rate.
    less = _WEAKER * gain / jnp.where(rate < 1, 1 - rate, 1)
    expected = (critical - less, _NEAR * critical + 0.5 * jnp.abs(less))
    return threshold, *jax.lax.stop_gradient(((block, restitution, weaker), expected))


@jax.jit
def _is_reached_from_rest(phase: PulsedPhase, expected: Reals, near: Reals) -> Booleans:
    """Return whether a phase from rest is the expected fixed point."""
    return phase.stands & phase.from_rest & (jnp.abs(phase.velocity - expected) <= near)
