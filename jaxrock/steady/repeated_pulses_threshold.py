"""The pulses of finite duration that just overturn in resonance.

Without end, a block that lands with the critical velocity v_c is at the threshold if the next
pulse just fails to overturn it: then it lands with v_c again. With a finite number of pulses
they are followed from rest, and the last one decides. In both cases the margin at the end of
the pulse is a function of the amplitude, whose lowest root is sought.
"""

import math
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import ArrayLike

from ..block import Block
from ..driven import Equation, Response, uplift_acceleration
from ..ground_motion import Pulse, check_pulse_class
from ..host import Printed, format_fields
from ..numerics import ABOVE, BELOW, Root, Sample, Scan, differentiate_implicitly, select_tree
from ..resonance import ModelLike, Nonlinear, RockingModel, as_model
from ..validation import Booleans, Integers, Number, Reals, is_traced
from .repeated_pulses import PulsedPhase, compute_phase
from .repeated_pulses_map import (
    LONGEST_WAIT,
    RESTS,
    PulsedScene,
    check_pulsed_arguments,
    follow_half_cycle,
    limit_tolerance,
    read_landing,
)

# Step of the logarithm of the amplitude, on the way up until a pulse overturns the block.
_STEP = 0.2
# Steps on the way up, at most.
_STEPS = 300
# Half-cycles that may be counted.
_MAX_HALF_CYCLES = 10**6
# Part by which pulses are weaker for which `from_rest` is computed: at the threshold itself
# rounding decides.
_WEAKER = 1e-6
# Distance of their landing velocity from the expected one, over the critical velocity.
_NEAR = 1e-3


class PulsedThreshold(Printed, eqx.Module):
    """Pulses of finite duration, each after an impact, that just overturn a block; NaN if none.

    Attributes
    ----------
    amplitude, intensity : Array
        Amplitude [m/s2] and intensity [m/s] of the pulses.
    rate : Array
        Derivative of the half-cycle map there; NaN for a finite number of half-cycles.
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
        units = dict.fromkeys(self.__dataclass_fields__, "")
        units |= {"amplitude": "m/s2", "intensity": "m/s"}
        if not is_traced(self.rate) and jnp.isnan(self.rate).all():
            del units["rate"]
        return format_fields(self, **units)


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
    """Find the amplitude of pulses that just overturn a block within a number of half-cycles.

    The first pulse acts on the block at rest, each further one begins at an impact. An
    endless sequence overturns the block once the fixed point of `pulsed_next_velocity` has
    disappeared. At this threshold a block that lands with the critical velocity just fails to
    overturn under the next pulse. For short pulses the intensity tends to
    `critical_intensity`.

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
        For a finite number of pulses, the lowest amplitude that overturns the block, searched
        upwards from uplift in steps of 20 %. For an endless sequence, the lowest amplitude
        at which a fixed point reaches the threshold; NaN if the `rate` of the map there is
        not between -1 and 1. A rate above 1, as under long pulses, means that the stable
        fixed point has met an unstable one at a lower amplitude, and both have disappeared. A
        rate below -1 means that half-cycles alternate at a lower amplitude already. NaN also
        if no amplitude brings the block to the threshold: a block that loses most of its
        velocity at impacts is caught by a long pulse, or overturns at once.

    Raises
    ------
    ValueError
        If `shape` is no class of pulses, or a concrete argument is out of range.

    Examples
    --------
    >>> import jaxrock as jr
    >>> block = jr.Block(half_width=0.1, slenderness=5.0)
    >>> found = jr.critical_pulsed_amplitude(block, 0.9, jr.HalfSine, 0.1, half_cycles=2)
    >>> print(f"{found.amplitude:.3f} m/s2, intensity {found.intensity:.3f} m/s")
    5.526 m/s2, intensity 0.352 m/s
    """
    pulse = check_pulse_class(shape)(1.0, duration)
    scene, _ = check_pulsed_arguments(block, restitution, pulse, 0.0, rtol)
    model = as_model(model)
    allowed = f"half_cycles must be a whole number from 1 to {_MAX_HALF_CYCLES}, or inf"
    if is_traced(half_cycles):
        raise ValueError(f"{allowed}, got a traced value")
    if half_cycles != math.inf:
        if half_cycles not in range(1, _MAX_HALF_CYCLES + 1):
            raise ValueError(f"{allowed}, got {half_cycles!r:.60}")
        return _compute_threshold(scene, model, rtol, jnp.asarray(half_cycles, int))[0]
    threshold, weaker, expected = _compute_threshold(scene, model, rtol, None)
    # Without derivatives, which a yes or no does not have; and apart, since this program is
    # likely to be compiled already.
    weaker, expected = jax.lax.stop_gradient(((*scene[:2], weaker), expected))
    phase = compute_phase(weaker, model, max(rtol, 1e-9))
    leads = _is_reached_from_rest(phase, *expected)
    return eqx.tree_at(lambda t: t.from_rest, threshold, threshold.from_rest & leads)


class _Outcome(NamedTuple):
    """The end of the pulse that decides."""

    velocity: Reals  # away from the ground
    lands: Booleans  # whether the block landed while the pulse acted
    early: Booleans | bool  # whether a pulse before it overturned the block


def _compute_margin(
    scene: PulsedScene,
    logarithm: Reals,
    direction: tuple[Reals, Reals],
    count: Integers | None,
    model: RockingModel,
    rtol: float,
) -> tuple[Reals, Reals, _Outcome]:
    """Compute the margin to overturning at the end of the pulse, and its slope.

    Parameters
    ----------
    scene : PulsedScene
    logarithm : Array
        Logarithm of the amplitude.
    direction : tuple of Array
        Direction of the slope: change of that logarithm, and of the landing velocity before.
    count : Array of int or None
        None for the pulse after a landing with the critical velocity; else the last of so many
        pulses from rest.
    model : RockingModel
    rtol : float

    Returns
    -------
    margin, slope : Array
    outcome : _Outcome
    """
    block, restitution, pulse = scene
    equation = Equation.of(block, model)

    def margin_when_pulse_ends(logarithm: Reals, velocity: Reals) -> tuple[Reals, _Outcome]:
        stronger = block, restitution, pulse.scaled(jnp.exp(logarithm))
        if count is None:
            response = follow_half_cycle(stronger, velocity, 0.0, model, rtol).response
            early = False
        else:
            response, early = _follow_last_pulse(count, stronger, velocity, model, rtol)
        side = jnp.where(response.final_rotation < 0, -1, 1)
        outward = side * response.final_velocity
        returning = equation.returning_velocity(side * response.final_rotation)
        margin = (returning - outward) / equation.critical_velocity
        return margin, _Outcome(outward, response.impacts > 0, early)

    start = equation.critical_velocity if count is None else jnp.zeros_like(logarithm)
    return jax.jvp(margin_when_pulse_ends, (logarithm, start), direction, has_aux=True)


# Pulses that remain, landing velocity, whether one overturned early, and the last response.
_LastPulse = tuple[Integers, Reals, Booleans, Response]


def _follow_last_pulse(
    count: Integers, scene: PulsedScene, velocity: Reals, model: RockingModel, rtol: float
) -> tuple[Response, Booleans]:
    """Follow the last of some pulses, or an earlier one that overturns; tell if it was one."""

    def follow_next_pulse(state: _LastPulse) -> _LastPulse:
        left, velocity, early, _ = state
        last = left == 0
        # The last pulse until it ends, the others until the block lands.
        followed = follow_half_cycle(
            scene, velocity, jnp.where(last, 0.0, LONGEST_WAIT), model, rtol
        )
        landing, (outcome, *_) = read_landing(followed)
        over = ~last & (outcome > RESTS)
        left = jnp.where(over, 0, left - 1)
        return left, jnp.where(last | over, velocity, landing), early | over, followed.response

    # The loop needs a response to begin with: the shapes of one, filled with zeros.
    response = jax.eval_shape(
        lambda: follow_half_cycle(scene, velocity, velocity, model, rtol).response
    )
    response = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), response)
    begin = count - 1, velocity, jnp.zeros((), bool), response
    _, _, early, response = jax.lax.while_loop(
        lambda state: state[0] >= 0, follow_next_pulse, begin
    )
    return response, early


def _compute_threshold_residual(
    scene: PulsedScene,
    logarithm: Reals,
    *,
    count: Integers | None,
    model: RockingModel,
    rtol: float,
) -> tuple[Reals, tuple[Reals, ...]]:
    """Compute the margin, 0 at the threshold, and the rate of the half-cycle map there."""
    along_velocity = jnp.zeros_like(logarithm), jnp.ones_like(logarithm)
    margin, slope, (velocity, *_) = _compute_margin(
        scene, logarithm, along_velocity, count, model, rtol
    )
    # The block lands with sqrt(v_c^2 + v^2 - D^2), where v is its velocity at the end of the
    # pulse and D the one at which it just fails to come back. The margin is (D - v) / v_c, and
    # at the threshold v is D: so the landing velocity changes by -v times the margin.
    return margin, (-velocity * slope,)


class _ThresholdSearch(NamedTuple):
    """The state of the search; see the table in `_search_threshold`."""

    scan: (
        Scan  # of minus the logarithm of the amplitude: a scan goes down, and the amplitude up
    )
    located: Booleans
    goes_on: Booleans
    gain: Reals  # slope of the landing velocity there, with respect to the logarithm
    rate: Reals  # of the half-cycle map there, which takes one evaluation more


def _search_threshold(
    scene: PulsedScene, *, count: Integers | None, model: RockingModel, rtol: float
) -> Root:
    """Search for the lowest amplitude that overturns, up from almost 0 or from uplift."""
    # State of the search | What is known                      | What happens next
    # --------------------|------------------------------------|-------------------------------
    # on the way up       | no amplitude so far overturns      | the next one, a fifth larger
    # between two points  | the upper one overturns, the lower | Newton's method and bisection
    #                     |   one does not                     |
    # jump                | the block is caught before it      | not found: the end
    #                     |   lands, or overturns at once      |
    # found               | the threshold, and its slope along | one evaluation more, along
    #                     |   the amplitude                    |   the velocity, for the rate
    #                     |                                    |   of the map: the end
    #
    # One evaluation a turn, along one direction, so that its program is compiled once.
    block, _, pulse = scene
    tolerance = limit_tolerance(pulse.amplitude, rtol)
    eps = float(jnp.finfo(pulse.amplitude.dtype).eps)
    # A block in motion may be overturned by far less than lifts it: in float64 the way up
    # begins at 5e-7 of uplift.
    below = 0.4 * math.log(eps) if count is None else 0.0
    first = jnp.log(uplift_acceleration(block, model)) + below
    no = jnp.zeros((), bool)
    zero = jnp.zeros_like(first)

    def place_point(index: ArrayLike) -> Reals:
        return -first - _STEP * index

    def evaluate_margin(search: _ThresholdSearch) -> _ThresholdSearch:
        scan = search.scan
        unit = zero + 1
        # Once the threshold is found, along the velocity, for the rate of the map.
        along = jnp.where(search.located, zero, unit), jnp.where(search.located, unit, zero)
        margin, slope, (velocity, lands, early) = _compute_margin(
            scene, -scan.trial, along, count, model, rtol
        )
        # Written so that NaN, of an integration that did not finish, counts as overturned.
        overturns = ~lands & ~(margin >= 0) | early
        kind = jnp.where(overturns, ABOVE, BELOW)
        new = Sample(scan.trial, -margin, jnp.where(lands | early, 0, slope), kind)
        # Newton's steps that no longer shrink are the error of the integration.
        size = jnp.abs(new.newton)
        last = jnp.abs(scan.last.newton)
        close = (size <= tolerance) | (size <= 1e3 * tolerance) & (size >= 0.5 * last)
        located = close & (overturns | (scan.since > 0))
        following = scan.advance(new, located, place_point)
        # Where the block begins to be caught before it lands, it may overturn at once, with no
        # threshold in between.
        at_once = (following.since == 0) & (following.right.kind == ABOVE)
        goes_on = located | ~at_once & (following.point <= _STEPS)
        following = following._replace(trial=jnp.where(located, scan.trial, following.trial))
        onward = _ThresholdSearch(following, located, goes_on, -velocity * slope, zero)
        done = search._replace(goes_on=no, rate=-velocity * slope)
        return select_tree(search.located, done, onward)

    scan = Scan.start(place_point(0))._replace(point=jnp.zeros((), int))
    begin = _ThresholdSearch(scan, no, ~no, zero, zero)
    end = jax.lax.while_loop(lambda search: search.goes_on, evaluate_margin, begin)
    root, rate, gain = (
        jnp.where(end.located, x, 0) for x in (-end.scan.trial, end.rate, end.gain)
    )
    return Root(root, (rate,), end.located, (gain,))


_find_threshold = differentiate_implicitly(_search_threshold, _compute_threshold_residual)


@eqx.filter_jit
def _compute_threshold(
    scene: PulsedScene, model: RockingModel, rtol: float, count: Integers | None
) -> tuple[PulsedThreshold, Pulse, tuple[Reals, Reals]]:
    """Find the threshold, and what says whether it is reached from rest.

    Returns
    -------
    threshold : PulsedThreshold
    weaker : Pulse
        Slightly weaker than the threshold.
    expected : tuple of Array
        Landing velocity of its fixed point, and how near it must be.
    """
    block, _, pulse = scene
    root = _find_threshold(scene, count=count, model=model, rtol=rtol)
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
    weaker = pulse.scaled(jnp.where(stable, amplitude, 1) * (1 - _WEAKER))
    critical = Equation.of(block, model).critical_velocity
    # Short cosines nearly cancel: there a little less amplitude is much less velocity. The
    # fixed point moves by the gain of the map over 1 less its rate.
    less = _WEAKER * gain / jnp.where(rate < 1, 1 - rate, 1)
    return threshold, weaker, (critical - less, _NEAR * critical + 0.5 * jnp.abs(less))


@jax.jit
def _is_reached_from_rest(phase: PulsedPhase, expected: Reals, near: Reals) -> Booleans:
    """Return whether a phase from rest is the expected fixed point."""
    return phase.stands & phase.from_rest & (jnp.abs(phase.velocity - expected) <= near)
