"""Forces on a rocking block by SciPy: DOP853 from corner to corner of the input, without JAX."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, minimize_scalar


class Piece(NamedTuple):
    """A stretch of the input without corners."""

    begin: float
    end: float
    ground: Callable  # time -> horizontal, vertical acceleration


def pieces_of(motion):
    """The pieces of a single motion of `stepping`."""

    def piece(k, begin, end):
        def ground(t):
            values = motion.value(np.array([0]), np.array([k]), np.array([t - begin]))
            return tuple(float(part[0]) for part in values)

        return Piece(begin, end, ground)

    edges = motion.edges[0].tolist()
    return [piece(k, *edges[k : k + 2]) for k in range(len(edges) - 1)]


class Trajectory:
    """Driven rocking by DOP853 from corner to corner, and the forces over all of it.

    The centre of mass, seen from the corner on which the block turns, is the complex number
    ``i R exp(i q)``, with the tilt q of the diagonal; what holds the block up follows from its
    acceleration, differentiated by hand, and that of the ground.
    """

    def __init__(self, rocker, pieces, settle, rtol=1e-12):
        self.rocker = rocker
        self.rtol = rtol
        self.grid = 2 if len(pieces) > 5 else 2001  # a record is linear in between
        self.radius = rocker.radius
        self.demand = 0.0
        self.normal = math.inf
        self.loss = math.inf
        self.alpha = self.velocity = 0.0
        self.side = 1
        self.resting = True
        self.over = False
        last = pieces[-1].end
        for piece in [*pieces, Piece(last, last + settle, lambda t: (0.0, 0.0))]:
            self.follow(piece)
            if self.over:
                break

    def forces(self, y, ground):
        """Horizontal and normal force over weight."""
        q = self.side * self.rocker.angle - y[0]
        second = -self.rocker.acceleration(y[0], self.side, ground)
        centre = 1j * self.radius * (1j * second - y[1] ** 2) * np.exp(1j * q)
        gravity = self.rocker.gravity
        force = centre - ground[0] + 1j * (ground[1] + gravity)
        return force.real / gravity, force.imag / gravity

    def lifted(self, ground):
        return max(self.rocker.excess(side, ground) for side in (1, -1)) > 0

    def note(self, force):
        """How steep a force is [rad]; keep the extremes."""
        horizontal, normal = force
        self.normal = min(self.normal, normal)
        demand = abs(horizontal) / normal if normal > 0 else math.inf
        self.demand = max(self.demand, demand)
        return math.atan2(abs(horizontal), normal)

    def over_the_segment(self, begin, times, forces_at):
        """Extremes on a grid, and between its points by a search."""
        forces = [forces_at(t) for t in times]
        if times[-1] < 1e-6:  # one of the last bounces
            for force in forces:
                self.note(force)
            return
        gone = [k for k, force in enumerate(forces) if force[1] <= 0]
        if gone and self.loss == math.inf:
            k = gone[0]
            self.loss = begin + (
                brentq(lambda t: forces_at(t)[1], times[k - 1], times[k]) if k else times[0]
            )
        for which in (lambda f: -self.note(f), lambda f: f[1]):
            values = np.array([which(f) for f in forces])
            best = int(np.argmin(values))
            around = times[max(best - 1, 0)], times[min(best + 1, len(times) - 1)]
            found = minimize_scalar(
                lambda t, which=which: which(forces_at(t)),
                bounds=around,
                method="bounded",
                options={"xatol": 1e-9 * (times[-1] - times[0])},
            )
            self.note(forces_at(found.x))
        if self.loss == math.inf and forces_at(found.x)[1] <= 0:
            root = brentq(lambda t: forces_at(t)[1], around[0], found.x)
            self.loss = begin + root

    def rest(self, begin, piece):
        """Wait for uplift; the end of the wait."""
        steady = 1 + 1e-13
        times = np.linspace(begin, piece.end, self.grid)
        lifted = [self.lifted(np.divide(piece.ground(t), steady)) for t in times]
        if True in lifted:
            first = lifted.index(True)
            low = times[max(first - 1, 0)]
            high = times[first]
            for _ in range(60):
                middle = 0.5 * (low + high)
                up = self.lifted(np.divide(piece.ground(middle), steady))
                low, high = (low, middle) if up else (middle, high)
            until = high
            self.resting = False
            self.side = 1 if piece.ground(until)[0] > 0 else -1
        else:
            until = piece.end
        # A block that is lifted at once does not stand still.
        for t in [*times[times <= until], until] if until > begin else ():
            horizontal, vertical = np.divide(piece.ground(t), self.rocker.gravity)
            self.note((-horizontal, 1 + vertical))
            if vertical <= -1 and self.loss == math.inf:
                self.loss = t
        return until

    def follow(self, piece):
        t = piece.begin
        while t < piece.end - 1e-13 and not self.over:
            if self.resting:
                t = self.rest(t, piece)
                continue
            path, times, landed = self.segment(t, piece)
            self.over_the_segment(
                t,
                times,
                lambda tau, t=t, path=path: self.forces(path(tau), piece.ground(t + tau)),
            )
            self.alpha, self.velocity = path(times[-1])
            t = piece.end if not (landed or self.over) else t + times[-1]
            if landed:
                self.alpha = 0.0
                self.side = -self.side
                self.velocity *= self.rocker.c
                onward = self.side * self.rocker.acceleration(0.0, self.side, piece.ground(t))
                # Further bounces take this much time.
                if 2 * abs(self.velocity) <= -1e-9 * onward * (1 - self.rocker.c):
                    self.resting = True
                    self.velocity = 0.0

    def segment(self, t, piece):
        """The path to the end of the piece or the impact, times along it, and whether it landed."""
        side = self.side
        # From an impact, the first step is a part of the arc; uplift has no acceleration.
        slowing = abs(self.rocker.acceleration(self.alpha, side, piece.ground(t)))
        arc = abs(self.velocity) / max(slowing, 1e-9) if self.alpha == 0 else math.inf
        grace = 1e-9 if arc == 0 else 0.0

        def field(tau, y):
            return y[1], self.rocker.acceleration(y[0], side, piece.ground(t + tau))

        def ground(tau, y):
            return side * y[0] if tau > grace else 1.0

        def fallen(tau, y):
            return math.pi / 2 - abs(y[0])

        def dip(tau, y):
            return side * y[1]

        ground.terminal = fallen.terminal = True
        ground.direction = -1
        dip.direction = 1
        solution = solve_ivp(
            field,
            (0, piece.end - t),
            (self.alpha, self.velocity),
            "DOP853",
            rtol=self.rtol,
            atol=1e-3 * self.rtol,
            events=(ground, fallen, dip),
            dense_output=True,
            first_step=min(0.2 * arc, 0.5 * (piece.end - t)) if 0 < arc < math.inf else None,
            max_step=0.2 / self.rocker.p,
        )
        path = solution.sol
        steps = zip(solution.t, solution.t[1:], strict=False)
        times = np.unique(np.concatenate([np.linspace(a, b, 5) for a, b in steps]))
        landed = bool(solution.t_events[0].size)
        self.over = bool(solution.t_events[1].size)
        # A step may go into the ground and out again.
        for tau, y in zip(solution.t_events[2], solution.y_events[2], strict=True):
            if side * y[0] < 0 and tau > grace:
                before = [s for s in times if s < tau and side * path(s)[0] > 0]
                tau = brentq(lambda s: side * path(s)[0], before[-1], tau, xtol=1e-15)
                return path, np.append(times[times < tau], tau), True
        return path, times, landed
