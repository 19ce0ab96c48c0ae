"""Driven rocking again, without JAX: an independent reference for peaks, impacts and outcomes.

Many blocks side by side in NumPy, each at its own pace, by the stages of SciPy's DOP853. A
step ends where the input has a corner and never goes beyond the next peak, dip or impact:
those are found by taking the step again with another length, so that neither an interpolant
nor the ends of steps decide what the largest rotation is.
The tables named here have its answers for blocks and pulses drawn at random, at a relative
tolerance of 1e-12 (1e-13 for blocks that are barely lifted or stand against a wall). Under the
shipped record, a case is stable where an input that is off by 1e-12 gives the same outcome and
the same peak to 1e-9.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import DOP853

TABLES = Path(__file__).parent.parent / "tables"
CASES = TABLES / "ridgecrest_cases.csv"
PULSES = TABLES / "pulse_cases.csv"
BARELY_LIFTED = TABLES / "barely_lifted_cases.csv"
AGAINST_WALL = TABLES / "one_sided_pulse_cases.csv"
STRONG = 0.01  # an impact counts there if it is that fast, over the fastest one
_FIRST_STEP = 1e-3  # of a motion that begins at rest, over the length of its piece
_NEGLIGIBLE = 1e-9  # share of the acceleration that all further bounces of a block may change


class Outcome(NamedTuple):
    """What the blocks did; `impacts` are those that are followed, one by one."""

    peak: Any
    overturned: Any
    impacts: Any
    rotation: Any
    velocity: Any
    margin: Any  # to overturning by energy, where the input ends
    impact_times: Any  # a list for each block
    impact_velocities: Any  # just before


class Ground(NamedTuple):
    """Ground motions in pieces, in which both components are smooth and the first is monotone."""

    edges: np.ndarray  # (motions, pieces + 1)
    value: Callable  # motion, piece, time since its begin -> horizontal, vertical acceleration


SHAPES = {
    "Rectangular": np.ones_like,
    "HalfSine": lambda x: np.sin(np.pi * x),
    "Sine": lambda x: np.sin(2 * np.pi * x),
    "Cosine": lambda x: np.cos(2 * np.pi * x),
    "Ricker": lambda x: (1 - 2 * (np.pi * (x - 2)) ** 2) * np.exp(-((np.pi * (x - 2)) ** 2)),
}
_TURN = np.sqrt(1.5) / np.pi
TURNS = {
    "Rectangular": [0, 1],
    "HalfSine": [0, 0.5, 1],
    "Sine": [0, 0.25, 0.75, 1],
    "Cosine": [0, 0.5, 1],
    "Ricker": [0, 2 - _TURN, 2, 2 + _TURN, 4],
}


def pulse(shape, amplitude, duration):
    """Pulses of one shape from time 0 on."""
    amplitude, duration = np.broadcast_arrays(
        np.atleast_1d(np.asarray(amplitude, float)), np.atleast_1d(np.asarray(duration, float))
    )

    turns = np.asarray(TURNS[shape], float)

    def value(motion, piece, time):
        there = amplitude[motion] * SHAPES[shape](turns[piece] + time / duration[motion])
        return there, np.zeros_like(there)

    return Ground(duration[:, None] * turns, value)


def record(horizontal, vertical, step, scale=1.0):
    """One record at one or more scales, linear between samples."""
    samples = np.stack(np.broadcast_arrays(horizontal, vertical)).astype(float)
    scale = np.atleast_1d(np.asarray(scale, float))
    edges = step * np.arange(samples.shape[1])

    def value(motion, piece, time):
        left = samples[:, piece]
        right = samples[:, piece + 1]
        return tuple(scale[motion] * (left + time / step * (right - left)))

    return Ground(np.broadcast_to(edges, (scale.size, edges.size)), value)


def harmonic(amplitude, frequency, cycles, phase=0.0):
    """Sines of so many periods, from time 0 on."""
    amplitude, frequency, phase = np.broadcast_arrays(
        *(np.atleast_1d(np.asarray(x, float)) for x in (amplitude, frequency, phase))
    )
    turns = np.r_[0, np.arange(2 * cycles) / 2 + 0.25, cycles] * 2 * np.pi

    def value(motion, piece, time):
        angle = phase[motion] + turns[piece] + frequency[motion] * time
        return amplitude[motion] * np.sin(angle), np.zeros_like(angle)

    return Ground(turns / frequency[:, None], value)


def within(ground, start, duration):
    """The motions from `start` on, as far as they are followed, and how long after their end."""
    start = np.asarray(start, float)[:, None]
    duration = np.asarray(duration, float)[:, None]
    later = start + ground.edges
    edges = np.minimum(np.concatenate([np.zeros_like(start), later], axis=1), duration)

    def value(motion, piece, time):
        values = ground.value(motion, np.maximum(piece - 1, 0), time)
        return tuple(np.where(piece > 0, part, 0.0) for part in values)

    return Ground(edges, value), np.maximum(duration - later[:, -1:], 0)[:, 0]


class Rocker:
    """The equation of motion of one or more blocks, and what energy says of the outcome."""

    def __init__(
        self,
        half_width,
        slenderness,
        restitution,
        linearized=False,
        gravity=9.81,
        share=0.75,
        one_sided=False,
    ):
        self.angle = np.arctan(1 / np.asarray(slenderness, float))
        # Of the moment of inertia about the edge, `share` is what the mass in its centre has.
        self.radius = half_width * np.hypot(1, slenderness)
        self.p = np.sqrt(share * gravity / self.radius)
        self.c = restitution
        self.linearized = linearized
        # Against a wall: to positive angles only, and thrown back from 0.
        self.one_sided = one_sided
        self.gravity = gravity
        self.tangent = self.angle if linearized else np.tan(self.angle)

    def of(self, which, size):
        """Some of the blocks, of which there are `size` in all."""
        some = object.__new__(type(self))
        some.linearized = self.linearized
        some.one_sided = self.one_sided
        for name in ("angle", "radius", "p", "c", "gravity", "tangent"):
            setattr(some, name, np.broadcast_to(getattr(self, name), (size,))[which])
        return some

    def acceleration(self, alpha, side, ground):
        horizontal, vertical = ground
        q = self.angle * side - alpha
        upright = 1 + vertical / self.gravity
        sideways = horizontal / self.gravity
        if self.linearized:
            return -(self.p**2) * (upright * q - sideways)
        return -(self.p**2) * (upright * np.sin(q) - sideways * np.cos(q))

    def leave(self, velocity):
        """Outward velocity after an impact at a velocity."""
        return -self.c * velocity

    def excess(self, side, ground):
        """What the ground has to one side over what lifts the block."""
        horizontal, vertical = ground
        return side * horizontal - (self.gravity + vertical) * self.tangent

    def margin(self, alpha, velocity, side):
        rest = self.angle - side * alpha
        back = self.p * rest if self.linearized else 2 * self.p * np.sin(rest / 2)
        half = self.angle if self.linearized else 2 * np.sin(self.angle / 2)
        critical = self.p * half
        landing = np.sqrt(np.maximum(velocity**2 + critical**2 - back**2, 0))
        return np.minimum((back - side * velocity) / critical, 1 - self.c * landing / critical)


def _stepped(field, time, x, v, h, rounding=0.0):
    """A step of DOP853 from every state: the new one, and its relative error.

    `rounding` is the least acceleration that counts: errors beside less are not looked at.
    """
    kx = np.empty((13, *x.shape))
    kv = np.empty((13, *x.shape))
    kx[0] = v
    kv[0] = field(time, x)
    for s in range(1, 12):
        a = DOP853.A[s, :s]
        kx[s] = v + h * (a @ kv[:s])
        kv[s] = field(time + DOP853.C[s] * h, x + h * (a @ kx[:s]))
    there = x + h * (DOP853.B @ kx[:12])
    speed = v + h * (DOP853.B @ kv[:12])
    kx[12] = speed
    kv[12] = field(time + h, there)

    def estimate(k, scale):
        fifth = (DOP853.E5 @ k) / scale
        third = (DOP853.E3 @ k) / scale
        return h * fifth**2 / np.sqrt(np.maximum(fifth**2 + 0.01 * third**2, 1e-300))

    # Small bounces are followed as exactly as large ones.
    scale_v = (np.max(np.abs(kv), axis=0) + rounding) * h + np.abs(v) + 1e-280
    error = np.maximum(estimate(kx, scale_v * h + np.abs(x)), estimate(kv, scale_v))
    return there, speed, error


def _bracketed(value_and_slope, low, high, falling):
    """Where something changes its sign in brackets: Newton's method, halved where it leaves."""
    time = 0.5 * (low + high)
    for _ in range(80):
        value, slope = value_and_slope(time)
        before = (value > 0) == falling
        low = np.where(before, time, low)
        high = np.where(before, high, time)
        better = time - value / np.where(slope == 0, np.inf, slope)
        inside = (better > low) & (better < high)
        better = np.where(inside, better, 0.5 * (low + high))
        done = (np.abs(better - time) <= 4e-16 * time) | (high - low <= 4e-16 * high)
        time = np.where(value == 0, time, better)
        if (done | (value == 0)).all():
            break
    return time


def _risen(positive, low, high, at_low, at_high):
    """From when on something monotone is positive, where it becomes so between two times."""
    wanted = (at_low <= 0) & (at_high > 0)
    slope = np.where(wanted, at_high - at_low, 1)
    guess = low - at_low * (high - low) / slope
    near = 1e-14 * high
    for side in (-1, 1):  # of a line it is close already
        there = np.clip(guess + side * near, low, high)
        above = positive(there)
        low = np.where(above, low, there)
        high = np.where(above, there, high)
    while (wanted & (high - low > 4e-16 * high)).any():
        middle = 0.5 * (low + high)
        above = positive(middle)
        low = np.where(above, low, middle)
        high = np.where(above, middle, high)
    return high


class _Motion:
    """Where the blocks are, in time and in rotation from the side on which they stand."""

    def __init__(self, rocker, ground, settle, rtol, start, landings):
        shapes = (np.shape(v) for v in (rocker.p, rocker.c, *start))
        (size,) = np.broadcast_shapes(ground.edges.shape[:1], *shapes)
        self.all = rocker
        self.size = size
        self.ground = ground
        self.rtol = rtol
        self.edges = np.broadcast_to(ground.edges, (size, ground.edges.shape[1]))
        self.motion = np.broadcast_to(np.arange(ground.edges.shape[0]), (size,))
        self.pieces = self.edges.shape[1] - 1
        self.to_next_peak = settle is None
        self.landings = landings
        self.settle = np.broadcast_to(np.inf if settle is None else settle, (size,))
        # Since the begin of the piece: what has just been lifted needs all digits.
        self.time = np.zeros(size)
        self.piece = np.zeros(size, int)
        alpha, velocity = (np.broadcast_to(np.asarray(v, float), (size,)) for v in start)
        self.side = np.where(np.where(alpha == 0, velocity, alpha) < 0, -1.0, 1.0)
        self.x = self.side * alpha
        self.v = self.side * velocity
        self.rest = (self.x == 0) & (self.v == 0)
        self.peak = self.x.copy()
        self.wish = np.full(size, np.inf)
        self.margin = np.full(size, np.nan)
        self.overturned = np.zeros(size, bool)
        self.active = np.ones(size, bool)
        self.impacts = [[] for _ in range(size)]
        self.next_piece()
        onward = self.field(np.arange(size))(self.time, self.x)
        self.rising = np.where((self.x > 0) & (self.v == 0), onward > 0, self.v >= 0)

    def rocker(self, k):
        return self.all.of(k, self.size)

    def input_of(self, k, t):
        acts = self.piece[k] < self.pieces
        last = np.minimum(self.piece[k], self.pieces - 1)
        found = self.ground.value(self.motion[k], last, t)
        return tuple(np.where(acts, part, 0.0) for part in found)

    def field(self, k):
        some = self.rocker(k)
        side = self.side[k]
        return lambda t, x: side * some.acceleration(side * x, side, self.input_of(k, t))

    def next_piece(self):
        """Go over what has no length."""
        while True:
            k = np.minimum(self.piece, self.pieces - 1)
            all_of = np.arange(self.piece.size)
            empty = (self.piece < self.pieces) & (
                self.edges[all_of, k + 1] <= self.edges[all_of, k]
            )
            if not empty.any():
                break
            self.piece += empty

    def read_outcomes(self):
        """Where the input ends; what rests from there on is done."""
        after = self.piece >= self.pieces
        k = np.flatnonzero(self.active & after & np.isnan(self.margin))
        self.margin[k] = self.rocker(k).margin(self.x[k], self.v[k], 1.0)
        self.overturned[k] = self.margin[k] < 0
        self.active &= ~(after & (self.rest | (self.time >= self.settle)))

    def until(self, k):
        last = np.minimum(self.piece[k], self.pieces - 1)
        length = self.edges[k, last + 1] - self.edges[k, last]
        return np.where(self.piece[k] < self.pieces, length, self.settle[k])

    def wait(self, k):
        """At rest: lifted now, or within this piece, or not; of both sides to the stronger one."""
        stop = self.until(k)
        begin = self.time[k]
        when = np.full(k.size, np.inf)
        side = np.ones(k.size)
        strength = np.full(k.size, -np.inf)
        for s in (1.0,) if self.all.one_sided else (1.0, -1.0):

            def excess(t, s=s, some=self.rocker(k)):
                return some.excess(s, self.input_of(k, t))

            now = excess(begin)
            later = excess(stop)
            high = _risen(lambda t: excess(t) > 0, begin, stop, now, later)
            found = np.where(now > 0, begin, np.where(later > 0, high, np.inf))
            first = (found < when) | ((found == when) & (now > strength))
            side = np.where(first, s, side)
            strength = np.where(first, now, strength)
            when = np.minimum(found, when)
        lifts = when < stop
        self.side[k] = np.where(lifts, side, self.side[k])
        self.time[k] = np.where(lifts, when, 0)
        self.piece[k] += ~lifts
        self.rest[k] = ~lifts
        self.rising[k] = True
        self.wish[k] = np.where(lifts, _FIRST_STEP * (stop - when), np.inf)

    def step(self, k):
        """One step, if it is exact enough; else the next one is shorter."""
        until = self.until(k)
        some = self.rocker(k)
        field = self.field(k)
        time = self.time[k]
        x = self.x[k]
        v = self.v[k]
        # Over at most one peak or dip, and over no more than a quarter of a small bounce.
        now = field(time, x)
        slowing = (v * now < 0) & (v != 0)
        brake = np.where(x == 0, 0.5, 2.0) * np.abs(v / np.where(slowing, now, 1))
        h = np.minimum(np.minimum(self.wish[k], until - time), 0.5 / some.p)
        h = np.where(slowing, np.minimum(h, brake), h)
        rounding = 2e-15 / self.rtol * some.p**2 * some.angle
        there, speed, error = _stepped(field, time, x, v, h, rounding)
        better = h * np.clip(0.9 * (self.rtol / np.maximum(error, 1e-30)) ** 0.125, 0.2, 5.0)
        good = error <= self.rtol
        # A step cut short says nothing against the length wished for before.
        cut = good & (h < self.wish[k])
        self.wish[k] = np.where(cut, np.maximum(self.wish[k], better), better)
        if good.any():
            self.end(*(part[good] for part in (k, h, h >= until - time, there, speed)))

    def end(self, k, h, whole, there, speed):
        """At the end of a step: at an edge of the input, a peak, a dip, the ground, or on the way.

        Peaks, dips and impacts are sought by taking the step again with another length.
        """
        time = self.time[k]
        x = self.x[k]
        v = self.v[k]

        def again(w, length):
            field = self.field(k[w])
            lean, rate, _ = _stepped(field, time[w], x[w], v[w], length)
            return lean, rate, field(time[w] + length, lean)

        def shorten(w, value, falling):
            h[w] = _bracketed(
                lambda z: again(w, z)[value : value + 2], np.zeros(w.size), h[w], falling
            )
            whole[w] = False
            there[w], speed[w], _ = again(w, h[w])

        up = self.rising[k]
        turns = np.flatnonzero(np.where(up, speed < 0, speed > 0))
        if turns.size:
            shorten(turns, 1, up[turns])
            speed[turns] = 0
        lands = np.flatnonzero((there < 0) & ~up)
        if lands.size:
            shorten(lands, 0, np.array(True))
            there[lands] = 0
        free = self.piece[k] >= self.pieces
        self.time[k] = np.where(whole & ~free, 0, time + h)
        self.piece[k] += whole & ~free
        self.peak[k] = np.maximum(self.peak[k], there)
        turned = np.isin(np.arange(k.size), turns) & ~np.isin(np.arange(k.size), lands)
        self.rising[k] = np.where(turned, ~up, up)
        # What was lifted and does not rise rests again.
        still = turned & up & (there <= 0)
        self.rest[k] = still
        self.x[k] = np.where(still, 0, there)
        self.v[k] = speed
        if self.to_next_peak:
            self.active[k[turned & up & (self.piece[k] >= self.pieces)]] = False
        self.land(k[lands])
        falls = k[self.x[k] >= 0.5 * np.pi]
        self.peak[falls] = 0.5 * np.pi
        self.overturned[falls] = True
        self.active[falls] = False
        self.margin[falls] = np.where(np.isnan(self.margin[falls]), -1.0, self.margin[falls])

    def land(self, k):
        """Go on, also from a wall, or rest where all further bounces amount to nothing."""
        some = self.rocker(k)
        for each in k:
            begin = self.edges[each, min(self.piece[each], self.pieces)]
            velocity = self.side[each] * self.v[each]
            self.impacts[each].append((begin + self.time[each], velocity))
            self.active[each] &= len(self.impacts[each]) != self.landings
        speed = some.leave(self.v[k])
        if not some.one_sided:
            self.side[k] = -self.side[k]
        onward = self.field(k)(self.time[k], np.zeros(k.size))
        lost = -onward * (1 - some.c)
        settles = (onward < 0) & (2 * speed * some.p <= _NEGLIGIBLE * lost)
        self.v[k] = np.where(settles, 0, speed)
        self.rest[k] = settles
        self.rising[k] = True
        self.wish[k] = np.inf


def follow(rocker, ground, settle=None, rtol=1e-12, start=(0.0, 0.0), landings=None):
    """Follow blocks through the input and then `settle` seconds, or until the next peak.

    No further than to as many `landings`.
    """
    m = _Motion(rocker, ground, settle, rtol, start, landings)
    while True:
        m.next_piece()
        m.read_outcomes()
        if not m.active.any():
            break
        moving = np.flatnonzero(m.active & ~m.rest)
        waiting = np.flatnonzero(m.active & m.rest)
        if waiting.size:
            m.wait(waiting)
        if moving.size:
            m.step(moving)
    times, velocities = (
        [np.array([i[n] for i in each]) for each in m.impacts] for n in (0, 1)
    )
    counts = np.array([len(each) for each in m.impacts])
    rotation = m.side * m.x
    velocity = m.side * m.v
    return Outcome(
        m.peak, m.overturned, counts, rotation, velocity, m.margin, times, velocities
    )


def count_strong(velocities):
    """Count the impacts that are not tiny bounces."""
    speeds = np.abs(velocities)
    return int((speeds > STRONG * speeds.max(initial=0.0)).sum())
