"""Trains of instantaneous pulses: the block rocks freely, and through impacts, between them."""

import functools
from types import ModuleType
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..block import Block
from ..host import Printed, listed
from ..impact import velocity_after_impact
from ..numerics import larger
from ..validation import (
    FINITE,
    NON_NEGATIVE,
    UNIT_INTERVAL,
    Booleans,
    Integers,
    Number,
    Numbers,
    Reals,
    as_array,
    as_real,
    check,
    check_kind,
    is_traced,
    of_one_precision,
)
from .free_rocking import Linearized, ModelLike, as_model
from .rocker import Flight, Rocker

_MAX_IMPACTS = 10**5
_TIMES = 512  # of a history at once

_Samples = Float[Array | np.ndarray, "..."]


class FreeMotion(NamedTuple):
    """A block in its half-cycle, and what it has done so far."""

    x: Reals  # launch velocity of the half-cycle, over the critical one
    duration: Reals  # of the half-cycle
    since: Reals  # time since its launch
    side: Reals
    peak: Reals  # rotation
    overturned: Booleans
    impacts: Integers


class TrainResponse(Printed, eqx.Module):
    """Response of a block to a train of pulses.

    Attributes
    ----------
    velocity_ratio, side : Array, shape (pulses,)
        After each pulse, the velocity with which the block would have left the ground (and
        will land) over the critical one [-]; to which side it is rotated, 1 or -1, 0 at rest.
    peak_rotation : Array
        Largest rotation, also after the last pulse [rad]; pi / 2 if it overturns.
    overturned, complete : Array of bool
        Whether it has ever moved outward with more energy than the barrier, even if a later
        pulse would have caught it. False if there were too many impacts to follow: then the
        numbers are NaN.
    times, after_pulses, rocker
        From which `history` follows the block.
    """

    velocity_ratio: Reals
    peak_rotation: Reals
    overturned: Booleans
    side: Reals
    complete: Booleans
    times: Reals
    after_pulses: FreeMotion
    rocker: Rocker

    def history(self, time: Numbers) -> tuple[Reals, Reals]:
        """Compute rotation and angular velocity over time.

        Parameters
        ----------
        time : array_like
            [s]

        Returns
        -------
        rotation, velocity : Array, shape (...)
            alpha [rad] and its rate [rad/s], at the time of a pulse right after it. A block
            that overturns is followed, without any later pulse, up to twice the critical
            angle, or to pi / 2 if that is less; after that, and after too many impacts, both
            are NaN.

        Examples
        --------
        >>> import jaxrock as jr
        >>> train = jr.respond_to_train(jr.Block(0.4, 5.0), 0.7, [0.0, 0.6], [0.3, -0.3])
        >>> rotation, velocity = train.history([0.0, 0.1, 0.5])
        >>> print(rotation.round(4), velocity.round(4))
        [ 0.      0.0073 -0.0019] [0.1082 0.0385 0.0556]
        """
        wanted = as_real("time", time)
        shape = wanted.shape
        if is_traced((self, wanted)):
            flat = wanted.astype(self.times.dtype).reshape(-1)
            found = _sample(self.rocker, *_select(jnp, flat, self.times, self.after_pulses))
            return found[0].reshape(shape), found[1].reshape(shape)
        # One program for all numbers of times and pulses; in NumPy, which compiles nothing.
        times, after_pulses = jax.device_get((self.times, self.after_pulses))
        pieces = max(1, -(-wanted.size // _TIMES))
        flat = np.resize(np.asarray(wanted, times.dtype), (pieces, _TIMES))
        parts = [_sample(self.rocker, *_select(np, at, times, after_pulses)) for at in flat]
        joined = np.concatenate(parts, axis=-1)[:, : wanted.size]
        return as_array(joined[0].reshape(shape)), as_array(joined[1].reshape(shape))

    def __str__(self) -> str:
        return listed(self, overturned="", peak_rotation="rad", velocity_ratio="", complete="")


def respond_to_train(
    block: Block,
    restitution: Number,
    times: Numbers,
    intensities: Numbers,
    model: ModelLike = Linearized(),
) -> TrainResponse:
    """Response of one block to instantaneous pulses at given times, through every impact.

    Parameters
    ----------
    block, restitution : Block, float
        One block and its C [-], between 0 and 1.
    times, intensities : array_like, shape (pulses,)
        When the pulses come [s], not decreasing, and I of each [m/s], pushing the block to
        positive rotations where positive.
    model : Linearized or Nonlinear
        In the nonlinear equation a pulse acts ``cos(alpha_c - alpha) / cos(alpha_c)`` times
        stronger on a rotated block than Eq. 2 says.

    Returns
    -------
    TrainResponse

    Raises
    ------
    ValueError
        If there are not as many times as intensities, the times decrease, or a concrete
        argument is out of range.

    Examples
    --------
    >>> import jaxrock as jr
    >>> train = jr.respond_to_train(jr.Block(0.4, 5.0), 0.7, [0.0, 0.6], [0.3, -0.3])
    >>> print(train.overturned, f"{train.peak_rotation:.4f} rad")
    False 0.0084 rad
    """
    c = as_real("restitution", restitution)
    t = as_real("times", times)
    pulses = as_real("intensities", intensities)
    check("restitution", c, UNIT_INTERVAL)
    check("times", t, NON_NEGATIVE)
    check("intensities", pulses, FINITE)
    check_kind("block", block, Block)
    block.check()
    if t.ndim != 1 or t.shape != pulses.shape or not t.size:
        raise ValueError(
            "times and intensities must be two lists of one length, got shapes"
            f" {t.shape} and {pulses.shape}"
        )
    if not is_traced(t) and (np.diff(np.asarray(t)) < 0).any():
        raise ValueError("times must not decrease")
    block, c, t, pulses = of_one_precision((block, c, t, pulses))
    return follow(Rocker(block, c, as_model(model)), t, pulses)


@eqx.filter_jit
def follow(rocker: Rocker, times: Reals, intensities: Reals) -> TrainResponse:
    """`respond_to_train`, with nothing checked."""

    def pulse(
        motion: FreeMotion, interval_and_intensity: tuple[Reals, Reals]
    ) -> tuple[FreeMotion, tuple[Reals, Reals, FreeMotion]]:
        interval, intensity = interval_and_intensity
        now = _rocked(rocker, motion, interval)
        flight = rocker.on_flight(now.x, now.since, now.duration)
        peak = larger(now.peak, rocker.rotation(flight))
        side = jnp.where(now.side == 0, jnp.where(intensity < 0, -1, 1), now.side)
        flight = rocker.struck(flight, side * intensity / rocker.unit)
        x = flight.x
        duration = rocker.duration(x)
        after = now._replace(
            x=x,
            duration=duration,
            since=rocker.since_launch(flight, duration),
            side=side.astype(x.dtype),
            peak=peak,
            overturned=now.overturned | ((x >= 1) & (flight.q >= 0)),
        )
        # A block that has overturned goes on as if no pulse came any more.
        after = jax.tree.map(lambda new, old: jnp.where(now.overturned, old, new), after, now)
        return after, (x, now.side, after)

    zero = jnp.zeros_like(times[0])
    at_rest = FreeMotion(zero, zero, zero, zero, zero, zero > 1, jnp.zeros((), int))
    intervals = jnp.diff(times, prepend=times[:1])
    last, (ratios, sides, after_pulses) = jax.lax.scan(
        pulse, at_rest, (intervals, intensities)
    )
    # A block that falls after the last pulse may leave the impact faster than it ever was.
    rises = last.since <= 0.5 * last.duration
    x = jnp.where(rises, last.x, velocity_after_impact(rocker.restitution, last.x))
    overturned = last.overturned | (x >= 1)
    peak = larger(last.peak, _peak(rocker, x))
    complete = last.impacts < _MAX_IMPACTS
    return TrainResponse(
        velocity_ratio=jnp.where(complete, ratios, jnp.nan),
        peak_rotation=jnp.where(complete, jnp.where(overturned, 0.5 * jnp.pi, peak), jnp.nan),
        overturned=overturned & complete,
        side=sides,
        complete=complete,
        times=times,
        after_pulses=after_pulses,
        rocker=rocker,
    )


def _select(
    namespace: ModuleType, time: _Samples, times: _Samples, after_pulses: FreeMotion
) -> tuple[FreeMotion, Reals]:
    """Take the motion after the last pulse that has come at each time, and the time since [s]."""
    pulse = namespace.searchsorted(times, time, side="right") - 1
    pulse = namespace.maximum(pulse, 0)
    motion = jax.tree.map(lambda part: part[pulse], after_pulses)
    # Before the first pulse the block rests.
    motion = motion._replace(x=namespace.where(time < times[0], 0, motion.x))
    return jax.tree.map(as_array, (motion, time - times[pulse]))


@eqx.filter_jit
@functools.partial(jax.vmap, in_axes=(None, 0, 0))
def _sample(rocker: Rocker, motion: FreeMotion, interval: Reals) -> tuple[Reals, Reals]:
    """Compute rotation [rad] and velocity [rad/s] at an interval after a motion."""
    now = _rocked(rocker, motion, interval)
    # A block that has overturned never falls back.
    duration = jnp.where(now.overturned, jnp.inf, now.duration)
    rotation, velocity, falls = rocker.motion(now.x, now.since, duration)
    # The pendulum of the full equation would go round, and come back.
    lies = (now.since > 2 * rocker.passing_time(now.x)) | (rotation > 0.5 * jnp.pi)
    unknown = (now.overturned & lies) | (now.impacts >= _MAX_IMPACTS) | jnp.isnan(rotation)
    side = jnp.where(unknown, jnp.nan, now.side)
    return side * rotation, jnp.where(falls, -side, side) * velocity


def _rocked(rocker: Rocker, motion: FreeMotion, interval: Reals) -> FreeMotion:
    """Free rocking over an interval, through impacts."""
    # Below this velocity the block counts as resting: its impacts would never end.
    rest = float(jnp.finfo(motion.x.dtype).eps) ** 2

    def highest(motion: FreeMotion, until: Any) -> Any:
        """With the peak of this half-cycle, if the block passes it until then."""
        half = 0.5 * motion.duration
        passes = (motion.since <= half) & (until >= half)
        return jnp.where(passes, larger(motion.peak, _peak(rocker, motion.x)), motion.peak)

    def lands(carry: Any) -> Any:
        motion, left = carry
        goes_on = (motion.x > rest) & (motion.impacts < _MAX_IMPACTS) & ~motion.overturned
        return goes_on & (motion.since + left >= motion.duration)

    def impact(carry: Any) -> Any:
        motion, left = carry
        x = velocity_after_impact(rocker.restitution, motion.x)
        after = FreeMotion(
            x=x,
            duration=rocker.duration(x),
            since=jnp.zeros_like(x),
            side=-motion.side,
            peak=highest(motion, motion.duration),
            overturned=x >= 1,
            impacts=motion.impacts + 1,
        )
        return after, jnp.maximum(left - (motion.duration - motion.since), 0)

    motion, left = jax.lax.while_loop(lands, impact, (motion, interval))
    moves = motion.x > rest
    until = motion.since + left
    return motion._replace(
        x=jnp.where(moves, motion.x, 0),
        since=jnp.where(moves, until, 0),
        side=jnp.where(moves, motion.side, 0),
        peak=highest(motion, until),
    )


def _peak(rocker: Rocker, x: Reals) -> Reals:
    return rocker.rotation(Flight(x, jnp.zeros_like(x)))
