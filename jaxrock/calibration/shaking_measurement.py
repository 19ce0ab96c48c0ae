"""A test on a shaking table, fitted to one more part of the motion after another."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..block import Block
from ..dynamics import Status, respond
from ..ground_motion import Motion
from ..resonance import RockingModel
from ..validation import Booleans, Reals

RESTITUTIONS = tuple(0.5 + 0.0025 * k for k in range(193))  # to begin with
_STARTS = 4  # of them from which the first part is fitted
_STAGES = (0.03, 0.06, 0.1, 0.2, 0.3, 0.4, 0.55, 0.7, 0.85, 1.0)  # of the impacts, by parts
_STEP_LEFT = 0.1  # that the search would still make, in standard errors
_BENDING = 0.5  # part by which a change of one standard error may differ from its derivative
_ROUGHER = 1.3  # times the noise of the part before: then it is another motion
_MOVED = 5.0  # standard errors of the part before, too
_OFF = 1.5  # times the noise that is seen in the measurements: then it is not their motion
_EXACT = 1e-9  # differences of what has no noise
_MAX_STEPS = 30
_SEEN = 4.0  # rotations over the noise, from which on they tell the side


class ShakingTest(eqx.Module):
    """A test: what is measured, what is known, and which numbers are fitted."""

    time: Reals
    measured: Reals
    counts: Booleans
    noise: Reals
    block: Block
    restitution: Reals
    motion: Motion
    initial: tuple[Reals, Reals]
    parameters: tuple[str, ...] = eqx.field(static=True)
    model: RockingModel = eqx.field(static=True)
    room: int = eqx.field(static=True)  # for impacts

    def scene(self, numbers: Reals) -> tuple[Block, Reals]:
        """The block and its restitution by the numbers."""
        values = dict(zip(self.parameters, numbers, strict=True))
        restitution = jax.nn.sigmoid(values.pop("restitution", _logit(self.restitution)))
        block = self.block
        for name, value in values.items():
            known = 1 + jnp.exp(value) if name == "inertia_ratio" else jnp.exp(value)
            block = eqx.tree_at(lambda b, name=name: getattr(b, name), block, known)
        return block, restitution

    def numbers(self, restitution: Any) -> np.ndarray:
        """The numbers of the block that is given, with some restitution."""
        found = []
        for name in self.parameters:
            value = float(restitution if name == "restitution" else getattr(self.block, name))
            if name == "restitution":
                value = min(max(value, 0.01), 0.999)
                found.append(np.log(value / (1 - value)))
            else:
                least = max(value - 1, 0.01)  # a point mass would never move away from 1
                found.append(np.log(least if name == "inertia_ratio" else value))
        return np.asarray(found, self.time.dtype)

    def rotations(self, numbers: Reals) -> Reals:
        """Rotations computed [rad], at the times of the measured ones."""
        block, restitution = self.scene(numbers)
        rotation, velocity = self.initial
        response = respond(
            block,
            restitution,
            self.motion,
            self.time[-1],
            rotation=rotation,
            velocity=velocity,
            model=self.model,
            max_impacts=self.room,
        )
        complete = response.status == Status.COMPLETE
        rotations = response.history(jnp.where(complete, self.time, 0))[0]
        return jnp.where(complete, rotations, jnp.nan)

    def residuals(self, numbers: Reals) -> Reals:
        """Computed less measured, over the noise, where it counts."""
        off = (self.rotations(numbers) - self.measured) / self.noise
        return jnp.where(self.counts, off, 0)


def _logit(share: Reals) -> Reals:
    return jnp.log(share) - jnp.log1p(-share)


class Stage(NamedTuple):
    """The fit to a part of the motion."""

    end: float
    numbers: Any
    values: np.ndarray
    covariance: np.ndarray
    rotation: np.ndarray
    noise: float
    off: float  # root of the mean square of the residuals
    converged: bool

    @classmethod
    def of(cls, test: ShakingTest, numbers: Any, end: float, noise: Any) -> "Stage":
        """What the numbers are worth, by the measurements up to a time."""
        values, slopes, rotation, jacobian = map(np.asarray, _natural(test, numbers))
        counts = np.asarray(test.counts & (test.time <= end))
        off, steep = (rotation - np.asarray(test.measured))[counts], jacobian[counts]
        known = noise is not None
        noise = (
            float(noise) if known else float(np.sqrt(off @ off / max(1, off.size - values.size)))
        )
        scale = np.sqrt(np.sum(steep**2, axis=0))
        covariance, converged = np.full((values.size,) * 2, np.nan), False
        if np.isfinite(scale).all() and (scale > 0).all() and np.isfinite(off).all():
            inverse = np.linalg.pinv(steep / scale)
            inverse = inverse / scale[:, None]
            covariance = noise**2 * inverse @ inverse.T
            errors = np.sqrt(np.diagonal(covariance))
            straight = all(
                _bending(test, numbers, k, errors[k], counts, rotation, steep[:, k])
                for k in range(values.size)
            )
            exact = errors <= 64 * np.finfo(values.dtype).eps
            converged = bool(np.all(exact | (abs(inverse @ off) <= _STEP_LEFT * errors)))
            converged = converged and (straight or bool(exact.all()))
            seen = noise if known else _seen_noise(np.asarray(test.measured)[counts])
            converged = converged and float(np.sqrt(np.mean(off**2))) <= _OFF * seen
        covariance = covariance * slopes * slopes[:, None] if converged else covariance * np.nan
        off = float(np.sqrt(np.mean(off**2)))
        return cls(end, numbers, values, covariance, rotation, noise, off, converged)

    def follows(self, last: "Stage") -> bool:
        """Whether it is the same motion as that of the part before, and still tells something."""
        if not self.converged or not last.converged:
            return self.converged
        errors = np.sqrt(np.diagonal(last.covariance))
        near = np.abs(self.values - last.values) <= _MOVED * errors + _EXACT
        return self.off <= _ROUGHER * last.off + _EXACT and bool(near.all())

    def closer(self, other: "Stage") -> bool:
        """Whether it is the better one of two fits to the same part."""
        if self.converged != other.converged:
            return self.converged
        return not self.off >= other.off


def _bending(
    test: ShakingTest,
    numbers: Any,
    place: int,
    error: float,
    counts: np.ndarray,
    rotation: np.ndarray,
    slope: np.ndarray,
) -> bool:
    """Whether a change of one standard error does what the derivative says."""
    moved = jnp.asarray(numbers).at[place].add(error)
    change = (np.asarray(_rotations(test, moved)) - rotation)[counts]
    expected = slope * error
    return bool(np.linalg.norm(change - expected) <= _BENDING * np.linalg.norm(expected))


@eqx.filter_jit
def _rotations(test: ShakingTest, numbers: Any) -> Reals:
    return test.rotations(numbers)


@eqx.filter_jit
def _natural(test: ShakingTest, numbers: Any) -> tuple[Reals, Reals, Reals, Reals]:
    """The parameters themselves and their slopes, the rotations and their Jacobian."""

    def parameters(at: Any) -> Reals:
        block, restitution = test.scene(at)
        values = {"restitution": restitution, **vars(block)}
        return jnp.stack([values[name] for name in test.parameters])

    jacobian = jax.jacfwd(test.rotations)(numbers)
    slopes = jnp.diagonal(jax.jacfwd(parameters)(numbers))
    return parameters(numbers), slopes, test.rotations(numbers), jacobian


@eqx.filter_jit
def _improved(test: ShakingTest, numbers: Any) -> Reals:
    """The numbers that fit best, as far as the search gets."""
    import optimistix  # which loads slowly

    solver = optimistix.LevenbergMarquardt(rtol=1e-6, atol=1e-6)
    found = optimistix.least_squares(
        lambda at, _: test.residuals(at), solver, numbers, max_steps=_MAX_STEPS, throw=False
    )
    return found.value


@eqx.filter_jit
def _residuals(test: ShakingTest, numbers: Any) -> Reals:
    return test.residuals(numbers)


def _first_numbers(test: ShakingTest, restitution: Any) -> list[np.ndarray]:
    """Numbers to begin with, those with restitutions that fit best first."""
    if restitution is not None or "restitution" not in test.parameters:
        return [test.numbers(test.restitution)]
    trials = [test.numbers(value) for value in RESTITUTIONS]
    squares = [float(jnp.sum(_residuals(test, trial) ** 2)) for trial in trials]
    order = np.argsort(np.nan_to_num(squares, nan=np.inf))
    return [trials[k] for k in order[:_STARTS]]


def _part(test: ShakingTest, end: float) -> ShakingTest:
    """The test up to a time."""
    return eqx.tree_at(lambda t: t.counts, test, test.counts & (test.time <= end))


def _ends(time: np.ndarray, sides: np.ndarray) -> list[float]:
    """Times up to which one more part of the impacts is over."""
    seen = np.flatnonzero(sides)
    changes = seen[1:][np.diff(sides[seen]) != 0]
    if not changes.size:
        raise ValueError("rotation must be of a block that rocks, got one without an impact")
    places = [min(changes.size - 1, int(share * changes.size) + 1) for share in _STAGES[:-1]]
    return [*dict.fromkeys(float(time[changes[place]]) for place in places), float(time[-1])]


def sides_of(test: ShakingTest, rotation: np.ndarray) -> np.ndarray:
    """The side on which a block is seen at each time, 0 where it is not."""
    seen = np.abs(rotation) > _SEEN * float(test.noise)
    return np.where(seen & np.asarray(test.counts), np.sign(rotation), 0)


def rough_noise(rotation: np.ndarray) -> float:
    """A noise beyond which a rotation tells the side."""
    return max(_seen_noise(rotation), 0.01 * float(np.max(np.abs(rotation))))


def _seen_noise(rotation: np.ndarray) -> float:
    """By the second differences, in which smooth motion nearly vanishes; at least rounding."""
    bends = np.abs(np.diff(rotation, 2))
    by_bends = float(np.median(bends)) / (0.6745 * 6**0.5) if bends.size else 0.0
    return max(by_bends, 1e-6 * float(np.max(np.abs(rotation))))


def fitted_in_parts(test: ShakingTest, restitution: Any, noise: Any) -> Stage:
    """The fit to as much of the motion as can be followed from one part to the next."""
    first, *ends = _ends(np.asarray(test.time), sides_of(test, np.asarray(test.measured)))
    begin, last = _part(test, first), None
    for numbers in _first_numbers(begin, restitution):
        stage = Stage.of(test, _improved(begin, numbers), first, noise)
        if last is None or stage.closer(last):
            last = stage
    assert last is not None
    for end in ends:
        stage = Stage.of(test, _improved(_part(test, end), last.numbers), end, noise)
        if not stage.follows(last):
            break
        last = stage
    return last
