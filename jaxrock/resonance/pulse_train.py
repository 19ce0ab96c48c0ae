"""Trains of instantaneous pulses at given times.

Between the pulses the block rocks freely, in closed form, and through impacts; nothing is
integrated. The block is followed from pulse to pulse by a scan, and from impact to impact in
between by a loop.
"""

import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..host import Printed, Status, format_fields
from ..impact import read_restitution, side_after_impact
from ..numerics import pick_larger, refuse_reverse_mode, select_tree
from ..validation import (
    FINITE,
    NON_NEGATIVE,
    Booleans,
    Integers,
    Number,
    Numbers,
    Reals,
    as_real,
    check,
    check_kind,
    is_traced,
    unify_precision,
)
from .free_rocking import Linearized, ModelLike, as_model
from .rocker import Rocker

# In double precision a block comes to rest (see `_rock_freely`) after about 72 / -ln(C)
# impacts, which is more than this limit only if C is above 0.9992.
_MAX_IMPACTS = 10**5
_TIMES = 512  # of a history: a multiple


class FreeMotion(NamedTuple):
    """The motion of a block in a half-cycle, and its past.

    Attributes
    ----------
    x
        Launch velocity of the half-cycle over the critical one [-].
    duration, since
        Duration of the half-cycle, and time since its launch [s].
    side
        Side to which the block is rotated, 1 or -1, 0 at rest.
    peak
        Largest rotation so far [rad].
    overturned, impacts
        Whether the block has overturned so far, and the number of its impacts.
    """

    x: Reals
    duration: Reals
    since: Reals
    side: Reals
    peak: Reals
    overturned: Booleans
    impacts: Integers


class TrainResponse(Printed, eqx.Module):
    """Response of a block to a train of pulses.

    Attributes
    ----------
    velocity_ratio : Array, shape (pulses,)
        Launch velocity over the critical velocity [-], for the motion after each pulse. The
        launch velocity is the one with which a block would have to leave the ground to move in
        the same way. The block lands with the same velocity.
    side : Array, shape (pulses,)
        Side to which the block is rotated before each pulse, 1 or -1, 0 at rest.
    peak_rotation : Array
        Largest rotation, also after the last pulse [rad]; pi / 2 if the block overturns.
    overturned : Array of bool
        Whether the block has ever moved outward with more energy than the barrier, even if a
        later pulse would have brought it back.
    status : Array of int
        A `jaxrock.Status`: COMPLETE, or STOPPED after too many impacts, where the numbers are
        NaN.
    times, after_pulses, rocker
        Times of the pulses [s], the motion after each, and the block, from which `history`
        computes the motion.
    """

    velocity_ratio: Reals
    peak_rotation: Reals
    overturned: Booleans
    side: Reals
    status: Integers
    times: Reals
    after_pulses: FreeMotion
    rocker: Rocker

    def history(self, time: Numbers) -> tuple[Reals, Reals]:
        """Compute rotation and angular velocity over time.

        Parameters
        ----------
        time : array_like
            Times [s].

        Returns
        -------
        rotation, velocity : Array, shape (...)
            alpha [rad] and its rate [rad/s]; at the time of a pulse, their values right after
            it. The motion of a block that overturns continues, without any later pulse, up to
            twice the critical angle, or to pi / 2 if that is less. Beyond, and after too many
            impacts, both are NaN.

        Examples
        --------
        >>> import jaxrock as jr
        >>> train = jr.respond_to_train(jr.Block(0.4, 5.0), 0.7, [0.0, 0.6], [0.3, -0.3])
        >>> rotation, velocity = train.history([0.0, 0.1, 0.5])
        >>> print(rotation.round(4), velocity.round(4))
        [ 0.      0.0073 -0.0019] [0.1082 0.0385 0.0556]
        """
        wanted = as_real("time", time, unit="s")
        flat = wanted.astype(self.times.dtype).reshape(-1)
        if not is_traced((self, wanted)):
            # A program of one size for most numbers of times.
            flat = jnp.pad(flat, (0, -flat.size % _TIMES))
        rotation, velocity = _sample_motion(self, flat)
        shape = wanted.shape
        return rotation[: wanted.size].reshape(shape), velocity[: wanted.size].reshape(shape)

    def __str__(self) -> str:
        return format_fields(self, overturned="", peak_rotation="rad", velocity_ratio="")


def respond_to_train(
    block: Block,
    restitution: Number,
    times: Numbers,
    intensities: Numbers,
    model: ModelLike = Linearized(),
) -> TrainResponse:
    """Compute the response of one block to pulses at given times, through every impact.

    Parameters
    ----------
    block : Block
        One block.
    restitution : float
        Its C [-], between 0 and 1; of a one-sided block its magnitude counts.
    times : array_like, shape (pulses,)
        Times of the instantaneous pulses [s], finite, at least 0 and not decreasing.
    intensities : array_like, shape (pulses,)
        I of each pulse [m/s], finite. A positive one pushes the block to positive rotations.
        A negative one pushes a one-sided block towards its wall. A block at rest stays there;
        a moving block is slowed or reversed, and the wall throws it back when it lands.
    model : Linearized or Nonlinear
        With `Nonlinear`, a pulse changes the velocity of a rotated block by ``cos(alpha_c -
        alpha) / cos(alpha_c)`` times the value of Eq. 2.

    Returns
    -------
    TrainResponse

    Raises
    ------
    ValueError
        If there are no times, or not as many as intensities, if the times decrease, or a
        concrete argument is out of range.

    Examples
    --------
    >>> import jaxrock as jr
    >>> train = jr.respond_to_train(jr.Block(0.4, 5.0), 0.7, [0.0, 0.6], [0.3, -0.3])
    >>> print(train.overturned, f"{train.peak_rotation:.4f} rad")
    False 0.0084 rad
    """
    c = read_restitution(block, restitution)
    t = as_real("times", times, unit="s")
    pulses = as_real("intensities", intensities, unit="m/s")
    check("times", t, NON_NEGATIVE)
    check("intensities", pulses, FINITE)
    check_kind("block", block, Block)
    block.check()
    if t.ndim != 1 or t.shape != pulses.shape or not t.size:
        raise ValueError(
            "times and intensities must be one-dimensional, equally long and not empty,"
            f" got shapes {t.shape} and {pulses.shape}"
        )
    if not is_traced(t) and (np.diff(np.asarray(t)) < 0).any():
        raise ValueError(f"times must not decrease, got {np.asarray(t)}")
    block, c, t, pulses = unify_precision((block, c, t, pulses))
    response = follow_timed_train(Rocker(block, c, as_model(model)), t, pulses)
    traced = is_traced(response)
    return refuse_reverse_mode("respond_to_train", response) if traced else response


@eqx.filter_jit
def follow_timed_train(rocker: Rocker, times: Reals, intensities: Reals) -> TrainResponse:
    """Follow a block as `respond_to_train` does, with nothing checked."""

    def advance_to_pulse(
        motion: FreeMotion, interval_and_intensity: tuple[Reals, Reals]
    ) -> tuple[FreeMotion, tuple[Reals, Reals, FreeMotion]]:
        """Rock to a pulse and apply it; list velocity, side before, and motion after it."""
        interval, intensity = interval_and_intensity
        now = _rock_freely(rocker, motion, interval)
        flight = rocker.flight_at(now.x, now.since, now.duration)
        peak = pick_larger(now.peak, rocker.rotation(flight))
        side, outward = rocker.strike(now.side, intensity)
        flight = rocker.apply_pulse(flight, outward / rocker.unit)
        x = flight.x
        duration = rocker.duration(x)
        after = now._replace(
            x=x,
            duration=duration,
            since=rocker.time_since_launch(flight, duration),
            side=side.astype(x.dtype),
            peak=peak,
            # Inward it first lands, and may lose enough there.
            overturned=now.overturned | ((x >= 1) & (flight.q >= 0)),
        )
        # A block that has overturned goes on as if no pulse came any more.
        after = select_tree(now.overturned, now, after)
        return after, (x, now.side, after)

    zero = jnp.zeros_like(times[0])
    at_rest = FreeMotion(zero, zero, zero, zero, zero, zero > 1, jnp.zeros((), int))
    intervals = jnp.diff(times, prepend=times[:1])
    last, (ratios, sides, after_pulses) = jax.lax.scan(
        advance_to_pulse, at_rest, (intervals, intensities)
    )
    # After the last pulse the highest peak is the next one. A block that falls then may leave
    # the impact faster than it ever was.
    rises = last.since <= 0.5 * last.duration
    x = jnp.where(rises, last.x, rocker.launch_after_impact(last.x))
    overturned = last.overturned | (x >= 1)
    peak = pick_larger(last.peak, rocker.launch_peak(x))
    complete = last.impacts < _MAX_IMPACTS
    return TrainResponse(
        velocity_ratio=jnp.where(complete, ratios, jnp.nan),
        peak_rotation=jnp.where(complete, jnp.where(overturned, 0.5 * jnp.pi, peak), jnp.nan),
        overturned=overturned & complete,
        side=sides,
        status=jnp.where(complete, Status.COMPLETE, Status.STOPPED),
        times=times,
        after_pulses=after_pulses,
        rocker=rocker,
    )


@eqx.filter_jit
@functools.partial(jax.vmap, in_axes=(None, 0))
def _sample_motion(train: TrainResponse, time: Reals) -> tuple[Reals, Reals]:
    """Compute rotation [rad] and velocity [rad/s] at a time [s]."""
    rocker = train.rocker
    pulse = jnp.maximum((train.times <= time).sum() - 1, 0)
    motion = jax.tree.map(lambda part: part[pulse], train.after_pulses)
    # Before the first pulse the block rests.
    motion = motion._replace(x=jnp.where(time < train.times[0], 0, motion.x))
    now = _rock_freely(rocker, motion, time - train.times[pulse])
    # A block that has overturned never falls back.
    duration = jnp.where(now.overturned, jnp.inf, now.duration)
    rotation, velocity, falls = rocker.motion(now.x, now.since, duration)
    # The pendulum of the full equation would go round, and come back. By symmetry about the
    # critical angle, the block reaches twice that angle in twice the time.
    lies = (now.since > 2 * rocker.time_to_critical_angle(now.x)) | (rotation > 0.5 * jnp.pi)
    unknown = (now.overturned & lies) | (now.impacts >= _MAX_IMPACTS) | jnp.isnan(rotation)
    side = jnp.where(unknown, jnp.nan, now.side)
    return side * rotation, jnp.where(falls, -side, side) * velocity


def _rock_freely(rocker: Rocker, motion: FreeMotion, interval: Reals) -> FreeMotion:
    """Let a block rock over an interval [s], through impacts."""
    # Below this velocity the block counts as resting: its impacts would never end.
    least_velocity = float(jnp.finfo(motion.x.dtype).eps) ** 2

    # The loop goes from impact to impact; `left` is what remains of the interval.
    #
    # state                          | known                    | next
    # at rest, x <= least_velocity   | nothing moves any more   | ends, at rest
    # overturned                     | it never lands           | ends, rotation grows
    # too many impacts               | not how it goes on       | ends, answers become NaN
    # in flight, lands after `left`  | the half-cycle           | ends in this half-cycle
    # in flight, lands before        | velocity of the impact   | impact, the next half-cycle

    def update_peak(motion: FreeMotion, until: Reals) -> Reals:
        """Take in the peak of this half-cycle, if the block passes it until a time."""
        # It does in the middle, unless the half-cycle began on the way down.
        half = 0.5 * motion.duration
        passes = (motion.since <= half) & (until >= half)
        peak = pick_larger(motion.peak, rocker.launch_peak(motion.x))
        return jnp.where(passes, peak, motion.peak)

    def is_landing(carry: tuple[FreeMotion, Reals]) -> Booleans:
        """Return whether the block lands before the interval ends."""
        motion, left = carry
        goes_on = (
            (motion.x > least_velocity) & (motion.impacts < _MAX_IMPACTS) & ~motion.overturned
        )
        return goes_on & (motion.since + left >= motion.duration)

    def apply_impact(carry: tuple[FreeMotion, Reals]) -> tuple[FreeMotion, Reals]:
        """Go on to the launch after the next impact, and shorten the interval by the way."""
        motion, left = carry
        x = rocker.launch_after_impact(motion.x)
        after = FreeMotion(
            x=x,
            duration=rocker.duration(x),
            since=jnp.zeros_like(x),
            side=side_after_impact(rocker.block.one_sided, motion.side),
            peak=update_peak(motion, motion.duration),
            overturned=x >= 1,
            impacts=motion.impacts + 1,
        )
        # Below 0 only by rounding.
        return after, jnp.maximum(left - (motion.duration - motion.since), 0)

    motion, left = jax.lax.while_loop(is_landing, apply_impact, (motion, interval))
    until = motion.since + left
    now = motion._replace(since=until, peak=update_peak(motion, until))
    zero = jnp.zeros_like(until)
    at_rest = now._replace(x=zero, since=zero, side=zero)
    return select_tree(motion.x > least_velocity, now, at_rest)
