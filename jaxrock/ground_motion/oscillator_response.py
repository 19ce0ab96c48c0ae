"""Linear oscillators under acceleration that is linear between samples, solved exactly.

The equation in units of the time step h, of an oscillator that is at rest at the first sample:

    d'' + 2 c d' + x^2 d = -a,        x = 2 pi h / T,  c = zeta x,

with the displacement d relative to the ground over h^2. The recursion from sample to sample is
that of Nigam and Jennings (1969, doi:10.1785/BSSA0590020909). What it needs are the impulse
response g after one step and its first two integrals,

    s = integral of g,  r = integral of s,

and it is written in the changes over a step, so that no digits cancel: an oscillator of a long
period moves little in a step, and one of a short period moves with the ground. Concrete values
are computed in NumPy, so that no program is compiled for each length; traced values in JAX, by
the same lines.
"""

import math
from collections.abc import Callable
from types import ModuleType
from typing import Any, NamedTuple

import jax

from ..validation import AnyArray, choose_namespace

# Below this x the coefficients are summed as power series, above they are closed expressions
# whose differences lose no more than a digit there.
_SERIES_BELOW = 2.0
# The series is summed for a step that is 2^6 times as short, and the step doubled so often: for
# damping ratios up to 10, the terms fall from the first one on.
_DOUBLINGS = 6
_TERMS = 16
# Terms of the series in w = x^2 - c^2, for |w| < 1: around critical damping.
_TERMS_IN_W = 12
# Samples in a block: blocks are convolutions, and only what carries over from one to the next
# is a loop.
_BLOCK = 64


class StepCoefficients(NamedTuple):
    """Impulse response after a step, its integral, and the integral of that."""

    impulse: AnyArray
    step: AnyArray
    ramp: AnyArray


def compute_coefficients(x: AnyArray, damping: AnyArray) -> StepCoefficients:
    """Compute the coefficients of a step; smooth through critical damping."""
    library = choose_namespace((x, damping))
    is_short = x < _SERIES_BELOW
    series = _sum_series(library.where(is_short, x, 1.0), damping)
    closed = _evaluate_closed(library.where(is_short, 2 * _SERIES_BELOW, x), damping)
    pairs = zip(series, closed, strict=True)
    return StepCoefficients(*(library.where(is_short, low, high) for low, high in pairs))


def _sum_series(x: AnyArray, damping: AnyArray) -> StepCoefficients:
    """Sum the power series of a part of the step, and double it up to the step."""
    part = 0.5**_DOUBLINGS
    decay = 2 * damping * x
    square = x * x
    # Derivatives of g at 0, each in units of the part: g'' = -2 c g' - x^2 g, and so on.
    before = 0 * x
    term = 1 + 0 * x
    impulse = step = ramp = 0 * x
    for order in range(1, _TERMS):
        factorial = float(math.factorial(order))
        impulse = impulse + term / factorial
        step = step + term / (factorial * (order + 1))
        ramp = ramp + term / (factorial * (order + 1) * (order + 2))
        following = -part * decay * term - part * part * square * before
        before = term
        term = following
    impulse = impulse * part
    step = step * part**2
    ramp = ramp * part**3
    for _ in range(_DOUBLINGS):
        # The same oscillator goes on from the state at the end of the first half.
        stays = 1 - square * step
        velocity = stays - decay * impulse
        ramp = 2 * ramp + step * (2 * impulse + decay * step)
        step = step * (1 + stays) + impulse * impulse
        impulse = impulse * (stays + velocity)
    return StepCoefficients(impulse, step, ramp)


def _evaluate_closed(x: AnyArray, damping: AnyArray) -> StepCoefficients:
    """Evaluate the closed expressions, for x that is not small."""
    library = choose_namespace((x, damping))
    c = damping * x
    w = x * x * (1 - damping) * (1 + damping)
    is_near = abs(w) < 1
    is_under = ~is_near & (w > 0)
    is_over = ~is_near & (w < 0)
    near = library.where(is_near, w, 0.0)
    cosine = sine = 0 * near
    for order in reversed(range(_TERMS_IN_W)):
        cosine = 1 - near / ((2 * order + 1) * (2 * order + 2)) * cosine
        sine = 1 - near / ((2 * order + 2) * (2 * order + 3)) * sine
    frequency = library.sqrt(library.where(is_under, w, 1.0))
    rate = library.sqrt(library.where(is_over, -w, 1.0))
    # c - rate cancels far above critical damping.
    slow = library.exp(-x * x / (c + rate))
    fast = library.expm1(-2 * rate)
    decayed = library.exp(-c)
    cosine = library.where(
        is_over,
        slow * (1 + 0.5 * fast),
        decayed * library.where(is_near, cosine, library.cos(frequency)),
    )
    sine = library.where(
        is_over,
        slow * fast / (-2 * rate),
        decayed * library.where(is_near, sine, library.sin(frequency) / frequency),
    )
    step = (1 - cosine - c * sine) / (x * x)
    ramp = (1 - sine - 2 * c * step) / (x * x)
    return StepCoefficients(sine, step, ramp)


class _BlockResponse(NamedTuple):
    """Responses within a block of steps; leading axes are those of the oscillators.

    Attributes
    ----------
    state : Array, shape (..., steps, 2)
        Acceleration after each step, for unit displacement and velocity before the first.
    last_state : Array, shape (..., 2, 2)
        Displacement and velocity at the end for these.
    samples : Array, shape (..., steps, steps + 1)
        Acceleration after each step for a unit of each sample.
    last_samples : Array, shape (..., 2, steps + 1)
        Displacement and velocity at the end for these.
    left : Array, shape (..., steps, 3)
        Acceleration, displacement and velocity for a unit at the beginning of the first step
        alone.
    """

    state: AnyArray
    last_state: AnyArray
    samples: AnyArray
    last_samples: AnyArray
    left: AnyArray


def _compute_block_response(x: AnyArray, damping: AnyArray) -> _BlockResponse:
    """Compute the responses within a block, by the recursion."""
    library = choose_namespace((x, damping))
    impulse, step, ramp = (part[..., None] for part in compute_coefficients(x, damping))
    square = (x * x)[..., None]
    decay = (2 * damping * x)[..., None]

    def advance(
        state: tuple[AnyArray, AnyArray], ends: tuple[AnyArray, AnyArray]
    ) -> tuple[tuple[AnyArray, AnyArray], tuple[AnyArray, ...]]:
        displacement, velocity = state
        left, right = ends
        rise = right - left
        force = square * displacement + left
        relative = force + decay * velocity
        moved = impulse * velocity - step * force - ramp * rise
        faster = -impulse * relative - step * (square * velocity + rise)
        displacement = displacement + moved
        velocity = velocity + faster
        acceleration = -(square * displacement + decay * velocity)
        return (displacement, velocity), (acceleration, displacement, velocity)

    # Four motions at once: a displacement, a velocity, a sample at the beginning of the first
    # step, and one at the end of it, which is at the beginning of the second one.
    zero = library.zeros_like(square)
    unit = zero + 1
    state = (
        library.concatenate([unit, zero, zero, zero], axis=-1),
        library.concatenate([zero, unit, zero, zero], axis=-1),
    )
    left = library.zeros((_BLOCK, 4), x.dtype)
    right = library.zeros((_BLOCK, 4), x.dtype)
    if library is jax.numpy:
        left = left.at[0, 2].set(1).at[1, 3].set(1)
        right = right.at[0, 3].set(1)
    else:
        left[0, 2] = left[1, 3] = right[0, 3] = 1
    shape = (_BLOCK, *[1] * (x.ndim), 4)
    ends = (left.reshape(shape), right.reshape(shape))
    _, answers = _scan(library, advance, state, ends)
    # Axes: oscillators, motions, steps.
    acceleration, displacement, velocity = (
        library.moveaxis(answer, 0, -1) for answer in answers
    )
    # The response to a sample depends only on the steps since then: a triangular matrix.
    steps = library.arange(1, _BLOCK + 1)[:, None]
    places = library.arange(1, _BLOCK + 1)[None]
    lag = steps - places
    triangle = library.where(lag >= 0, acceleration[..., 3, :][..., abs(lag)], 0.0)
    samples = library.concatenate([acceleration[..., 2, :, None], triangle], axis=-1)
    last = [
        library.concatenate([part[..., 2, -1:], part[..., 3, ::-1]], axis=-1)
        for part in (displacement, velocity)
    ]
    last_state = [part[..., :2, -1] for part in (displacement, velocity)]
    left = [part[..., 2, :] for part in (acceleration, displacement, velocity)]
    return _BlockResponse(
        library.moveaxis(acceleration[..., :2, :], -1, -2),
        library.stack(last_state, axis=-2),
        samples,
        library.stack(last, axis=-2),
        library.stack(left, axis=-1),
    )


def _scan(library: ModuleType, function: Callable[..., Any], carry: Any, inputs: Any) -> Any:
    """Carry a state through inputs along their first axis; a loop where all is concrete."""
    if library is jax.numpy:
        return jax.lax.scan(function, carry, inputs)
    outputs = []
    leaves, form = jax.tree.flatten(inputs)
    for rows in zip(*leaves, strict=True):
        carry, output = function(carry, jax.tree.unflatten(form, rows))
        outputs.append(output)
    return carry, jax.tree.map(lambda *parts: library.stack(parts), *outputs)


def compute_absolute_accelerations(
    samples: AnyArray, x: AnyArray, damping: AnyArray, extension: int
) -> AnyArray:
    """Compute the absolute accelerations of oscillators at the samples, from rest on.

    Parameters
    ----------
    samples : Array, shape (..., samples)
        Acceleration of the ground, linear between samples; it is 0 behind the last one.
    x : Array, shape (...)
        2 pi times time step over period [-]; broadcasts with the leading axes of the samples.
    damping : Array, shape (...)
        Damping ratio [-].
    extension : int
        Number of samples that are added behind the last one.

    Returns
    -------
    Array, shape (..., samples + extension)
        In the unit of the samples.
    """
    library = choose_namespace((samples, x, damping))
    count = samples.shape[-1]
    steps = count - 1 + extension
    blocks = -(-steps // _BLOCK)
    response = _compute_block_response(x, damping)
    leading = [(0, 0)] * (samples.ndim - 1)
    # The zeros behind the last sample fall in one step, which is corrected below.
    padded = library.pad(samples, [*leading, (0, blocks * _BLOCK + 1 - count)])
    rows = padded[..., :-1].reshape(*padded.shape[:-1], blocks, _BLOCK)
    ends = padded[..., _BLOCK::_BLOCK, None]
    rows = library.concatenate([rows, ends], axis=-1)
    driven = library.matmul(rows, library.swapaxes(response.samples, -1, -2))
    kicks = library.matmul(rows, library.swapaxes(response.last_samples, -1, -2))
    if extension:
        # The ground jumps to rest: what the fall within a step adds is taken off again, from
        # that step to the end of its block.
        block, place = divmod(count - 1, _BLOCK)
        fall = samples[..., -1, None, None] * response.left[..., : _BLOCK - place, :]
        driven = _subtract(driven, fall[..., 0], block, place)
        kicks = _subtract(kicks, fall[..., -1, 1:], block, 0)

    def advance(state: AnyArray, kick: AnyArray) -> tuple[AnyArray, AnyArray]:
        return (response.last_state * state[..., None, :]).sum(axis=-1) + kick, state

    kicks = library.moveaxis(kicks, -2, 0)
    _, states = _scan(library, advance, library.zeros_like(kicks[0]), kicks)
    free = library.matmul(
        library.moveaxis(states, 0, -2), library.swapaxes(response.state, -1, -2)
    )
    moved = (driven + free).reshape(*driven.shape[:-2], blocks * _BLOCK)
    at_rest = library.zeros_like(moved[..., :1])
    return library.concatenate([at_rest, moved[..., :steps]], axis=-1)


def _subtract(values: AnyArray, part: AnyArray, row: int, column: int) -> AnyArray:
    """Subtract a part from one row of values, from a column on."""
    if isinstance(values, jax.Array):
        return values.at[..., row, column:].add(-part)
    values[..., row, column:] -= part
    return values
